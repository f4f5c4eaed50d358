"""The command ``cgi-wave``: its frame, and what becomes of an error.

Nothing here or in ``commands`` imports numpy at module level, so that ``--help`` costs an import of click.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import click

from cgi_wave import __version__
from cgi_wave.cli import commands
from cgi_wave.errors import CgiWaveError, InputError

DONE, FAILED, REFUSED, INTERRUPTED = 0, 1, 2, 130


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="cgi-wave")
def cgi_wave() -> None:
    """Ghosts of an imaging static Fourier-transform spectrometer, and what they do to its interferograms.

    Results go to standard output (with --json one JSON document and nothing else), progress to standard error. Exit
    status: 0 done, 1 failed, 2 input refused, 130 interrupted.
    """


for command in commands.COMMANDS:
    cgi_wave.add_command(command)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave with its exit status."""
    sys.exit(status(arguments))


def status(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; its exit status, after one message on standard error if it is not 0."""
    try:
        # Outside click's standalone mode --help and --version return their status, and errors come through.
        returned = cgi_wave.main(args=arguments, prog_name="cgi-wave", standalone_mode=False)
        return returned if isinstance(returned, int) else DONE
    except click.ClickException as refusal:
        refusal.show()
        return REFUSED
    except InputError as refusal:
        _say(refusal)
        return REFUSED
    except (CgiWaveError, OSError) as failure:
        _say(failure)
        return FAILED
    except (KeyboardInterrupt, click.Abort):
        _say("interrupted; nothing half-written is left")
        return INTERRUPTED


def _say(message: object) -> None:
    click.echo(f"cgi-wave: {message}", err=True)
