"""The command ``rank``: what ghosts cost whom, and what would help."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cgi_wave.cli.shared import (
    check_bands,
    check_tolerance,
    computing,
    instrument_option,
    json_option,
    number,
    progress,
    tolerance_option,
)
from cgi_wave.errors import InputError

if TYPE_CHECKING:
    from cgi_wave.budget.remedies import Remedy
    from cgi_wave.optics.system import OpticalSystem


@click.command()
@click.argument("band")
@click.option(
    "--coating-factor",
    type=float,
    default=0.5,
    show_default=True,
    metavar="F",
    help="What coatings reflect (mirrors: let through) is brought to this part of it.",
)
@click.option("--coating-value", type=float, metavar="R", help="The same, to this value where it is above.")
@click.option(
    "--tilt",
    "tilts",
    multiple=True,
    metavar="NAME=DEG[,DEG]",
    help="Tilt a surface, the body that fills a space, or a frame, about its x (and y).",
)
@click.option("--shift", "shifts", multiple=True, metavar="NAME=MM", help="Shift one along its own z.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="SURFACE.FIELD=X[,…]",
    help="Trace the band with other values of the instrument file.",
)
@click.option("--no-moves", is_flag=True, help="Coatings only; nothing is traced again.")
@click.option(
    "--field",
    "fields",
    type=click.Choice(["centre", "all"]),
    default="centre",
    show_default=True,
    help="The zone's centre, or all five field points.",
)
@click.option("--out", metavar="FILE.csv", help="Write the ranking as a table.")
@tolerance_option
@instrument_option
@json_option
def rank(
    band: str, coating_factor: float, coating_value: float | None, tilts: tuple[str, ...], shifts: tuple[str, ...],
    settings: tuple[str, ...], no_moves: bool, fields: str, out: str | None, tolerance: float,
    instrument: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Say what ghosts of BAND cost whom, and rank remedies.

    Power, contrast and NMA error by surface; then every coating improved, every plane element tilted, each by
    recomputation, beside what a linear guess promises and what the change costs. Without --tilt, --shift and --set,
    every plane element that makes ghosts is tilted by 0.1, 0.5 and 1 degree.
    """
    from cgi_wave.report import output, tables

    check_tolerance(tolerance)
    check_bands([band], instrument)
    if out and Path(out).suffix.lower() != ".csv":
        raise InputError("command line", "--out", out, "is not a format for rankings", "end the file's name in .csv")
    if no_moves and (tilts or shifts or settings):
        raise InputError("command line", "--no-moves", True, "contradicts a move that is given", "leave out one")
    from cgi_wave.budget.remedies import Target
    from cgi_wave.optics.system import load_instrument

    loaded = load_instrument(instrument)
    target = Target(coating_factor, coating_value)
    system = loaded.band(band)
    given = _moves(system, tilts, shifts, settings)
    for move in given:
        move.apply(system, loaded)  # refuses what makes no instrument
    moves = given if given or no_moves else None
    with output.whole_file(out) if out else nullcontext() as file:
        with computing():
            from cgi_wave import ranking

            found = ranking.rank_remedies(loaded, band, target, moves, fields, tolerance, progress)  # type: ignore[arg-type]
        options = {
            "band": band, "instrument": instrument, "tolerance": tolerance, "coating_factor": coating_factor,
            "coating_value": coating_value, "tilt": list(tilts), "shift": list(shifts), "set": list(settings),
            "no_moves": no_moves, "field": fields,
        }  # fmt: skip
        made = output.provenance(loaded.name, loaded.hash, options)
        if file:
            tables.write_ghosts(file, found.remedies, made, ".csv")
    if as_json:
        document = {
            "band": band, "fields": found.fields, **found.costs, "remedies": found.remedies,
            "unimproved": found.unimproved, "seconds": found.seconds, "provenance": made,
        }  # fmt: skip
        click.echo(output.to_json(document))
    else:
        from cgi_wave.report import ranking as text

        click.echo(text.ranking_text(found))


def _moves(system: OpticalSystem, tilts: Sequence[str], shifts: Sequence[str], settings: Sequence[str]) -> list[Remedy]:
    """The moves that the command line names. Raises InputError."""
    from cgi_wave.budget import remedies

    found: list[Remedy] = []
    for word in tilts:
        name, angles = _named("--tilt", word, "filter=0.5 or filter=0.5,0.2", 2)
        found.append(remedies.tilt(system, name, *angles))
    for word in shifts:
        name, (millimetres,) = _named("--shift", word, "filter=-1.5", 1)
        found.append(remedies.shift(system, name, millimetres))
    for word in settings:
        pairs = [_named("--set", part, "filter_back.thickness_mm=2", 1) for part in word.split(",")]
        found.append(remedies.values(system, {field: value for field, (value,) in pairs}))
    return found


def _named(option: str, word: str, example: str, most: int) -> tuple[str, list[float]]:
    """NAME=NUMBER[,NUMBER] taken apart, with at most ``most`` numbers."""
    name, _, text = word.partition("=")
    parts = text.split(",")
    if not name or not text or len(parts) > most:
        raise InputError("command line", option, word, "is not a name and its numbers", f"write it as {example}")
    numbers = [number(option, part) for part in parts]
    if not all(map(math.isfinite, numbers)):
        raise InputError("command line", option, word, "is not finite", f"write it as {example}")
    return name, numbers
