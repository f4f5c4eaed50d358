"""What the commands share: options, checks that need no computation, and what goes to which stream."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import click

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.errors import InputError

Command = TypeVar("Command", bound=Callable[..., Any])


def instrument_option(function: Command) -> Command:
    """Adds ``--instrument``."""
    text = "Instrument file (TOML); the reference instrument if not given."
    return click.option("--instrument", metavar="FILE", help=text)(function)


def tolerance_option(function: Command) -> Command:
    """Adds ``--tolerance``."""
    text = "Leave out pairs of beams that can change the modulation by less than this part of it."
    return click.option(
        "--tolerance", type=float, default=DEFAULT_TOLERANCE, show_default=True, metavar="T", help=text
    )(function)


def json_option(function: Command) -> Command:
    """Adds ``--json``."""
    return click.option("--json", "as_json", is_flag=True, help="One JSON document on standard output.")(function)


def number(name: str, text: str) -> float:
    """The number that a word of the command line stands for; InputError names the option."""
    try:
        return float(text)
    except ValueError:
        raise InputError("command line", name, text, "not a number", "write it as 10.25") from None


def check_tolerance(tolerance: float) -> None:
    """Refuse a tolerance outside 0…1 (InputError)."""
    if not 0.0 < tolerance < 1.0:  # also refuses NaN
        remedy = f"give a number above 0 and below 1, such as {DEFAULT_TOLERANCE:g}"
        raise InputError("command line", "--tolerance", tolerance, "bounds nothing", remedy)


def check_bands(bands: Sequence[str], instrument: str | None) -> list[str]:
    """The bands asked for, each once and in that order; all of the instrument's if none is."""
    from cgi_wave import analysis

    known = list(analysis.list_bands(instrument))
    for band in bands:
        if band not in known:
            raise InputError(
                "command line", "BAND", band, "the instrument has no such band", f"use {' or '.join(known)}"
            )
    return list(dict.fromkeys(bands)) or known


@contextmanager
def computing() -> Iterator[None]:
    """Standard output is for the result: what libraries print goes to standard error."""
    output, sys.stdout = sys.stdout, sys.stderr
    try:
        yield
    finally:
        sys.stdout = output


def progress(message: str) -> None:
    """One line to standard error."""
    click.echo(message, err=True)
