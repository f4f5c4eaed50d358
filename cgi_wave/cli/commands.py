"""The commands. Each checks what it was given, opens its output, computes, and hands a document to the report floor.

Heavy imports stand inside the functions. While a command computes, anything printed goes to standard error.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cgi_wave.cli.frame import frame, scroll
from cgi_wave.cli.rank import rank
from cgi_wave.cli.shared import check_bands as _check_bands
from cgi_wave.cli.shared import check_tolerance as _check_tolerance
from cgi_wave.cli.shared import computing as _computing
from cgi_wave.cli.shared import instrument_option as _instrument
from cgi_wave.cli.shared import json_option as _json
from cgi_wave.cli.shared import number as _number
from cgi_wave.cli.shared import progress as _progress
from cgi_wave.cli.shared import tolerance_option as _tolerance
from cgi_wave.errors import InputError

if TYPE_CHECKING:
    from cgi_wave.analysis import Analysis


PICTURES = (".png", ".svg", ".pdf")


@click.command()
@click.argument("bands", nargs=-1, metavar="[BAND]...")
@click.option("--out", default="out", show_default=True, metavar="DIR", help="Folder for the results.")
@click.option("--cross-family", is_flag=True, help="Interfere ghosts off different surfaces too, as drawn.")
@_tolerance
@_instrument
@_json
def run(
    bands: tuple[str, ...], out: str, cross_family: bool, tolerance: float, instrument: str | None, as_json: bool
) -> None:
    """Do the main job: from the instrument to Table 1.

    Finds the ghosts, their contrasts and what they do to the interferograms, and writes summary.json, the ghost tables,
    the pictures and index.html. Without a BAND, all bands of the instrument.
    """
    from cgi_wave.report import output

    with output.whole_folder(out) as stage:
        with _computing():
            result, provenance = _analyse(list(bands), instrument, tolerance, cross_family)
            from cgi_wave.report import build

            _progress("writing the report")
            summary = build.write(result, _views(next(iter(result.bands)), instrument), provenance, stage)
    if as_json:
        click.echo(output.to_json(summary))
    else:
        click.echo(build.run_text(result, Path(out)))


@click.command()
@click.argument("band")
@click.option("--out", metavar="FILE", help="Write the table as .csv, .nc (NetCDF) or .mat.")
@_tolerance
@_instrument
@_json
def ghosts(band: str, out: str | None, tolerance: float, instrument: str | None, as_json: bool) -> None:
    """List the ghosts of BAND.

    Path, power, spot size, OPD, contrast with its error bound, and Eq. 4 beside it. How many there are by order, field
    point and first surface goes to standard error, and is the field "counts" of the JSON document.
    """
    from cgi_wave.budget.counts import count_ghosts, counts_text
    from cgi_wave.report import output, tables

    suffix = tables.check_suffix(Path(out).suffix) if out else ""
    with output.whole_file(out) if out else nullcontext() as file:
        with _computing():
            result, provenance = _analyse([band], instrument, tolerance)
            rows = result.bands[band].ghosts
            counts = count_ghosts(rows)
            _progress(counts_text(counts))
        if file:
            tables.write_ghosts(file, rows, provenance, suffix)
    from cgi_wave.report import build

    if as_json:
        click.echo(output.to_json({"band": band, "counts": counts, "ghosts": rows, "provenance": provenance}))
    elif not out:
        click.echo(build.ghosts_text(rows))


@click.command()
@click.argument("band")
@_tolerance
@_instrument
@_json
def psi(band: str, tolerance: float, instrument: str | None, as_json: bool) -> None:
    """Give the interferogram of BAND.

    At the first field point, without and with stray light: irradiance along the OPD, M, B and NMA.
    """
    with _computing():
        result, provenance = _analyse([band], instrument, tolerance)
    from cgi_wave.report import build, output

    document = build.psi_document(result.bands[band])
    if as_json:
        click.echo(output.to_json({"band": band, **document, "provenance": provenance}))
    else:
        click.echo(build.psi_text(document))


@click.command()
@click.argument("band")
@_tolerance
@_instrument
@_json
def plan(band: str, tolerance: float, instrument: str | None, as_json: bool) -> None:
    """Show what is modelled for BAND at a tolerance.

    Which pairs of beams, by which method, at what cost, what is left out, and the bound of that; at the zone's centre.
    Contrasts are not computed.
    """
    _check_tolerance(tolerance)
    _check_bands([band], instrument)
    with _computing():
        from cgi_wave import analysis

        _, text = analysis.plan_band(band, instrument, tolerance, _progress)
    if as_json:
        from cgi_wave.optics.system import load_instrument
        from cgi_wave.report import output

        loaded = load_instrument(instrument)
        options = {"band": band, "instrument": instrument, "tolerance": tolerance}
        provenance = output.provenance(loaded.name, loaded.hash, options)
        click.echo(
            output.to_json({"band": band, "tolerance": tolerance, "plan": text.splitlines(), "provenance": provenance})
        )
    else:
        click.echo(text)


@click.command()
@click.argument("band")
@click.option("--rays", type=int, default=100_000, show_default=True, metavar="N", help="Rays through the pupil.")
@click.option("--seed", type=int, default=1, show_default=True, metavar="S", help="Of the random numbers.")
@click.option("--direction", metavar="X,Y", help="Light from one direction, degrees in the pupil's frame.")
@click.option("--lambertian", type=float, metavar="DEG", help="A Lambertian pupil, within DEG of its axis.")
@click.option("--split", type=float, default=1e-3, show_default=True, metavar="W", help="Follow branches above W.")
@click.option("--analog", is_flag=True, help="One branch per event, drawn by its power.")
@click.option("--out", metavar="FILE.json", help="Write everything, map and paths included.")
@_instrument
@_json
def flux(
    band: str, rays: int, seed: int, direction: str | None, lambertian: float | None, split: float, analog: bool,
    out: str | None, instrument: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Show where the light of BAND goes.

    Walks rays through the instrument by lots, without a list of paths: what the detector keeps, what surfaces absorb,
    what is vignetted, what leaves the system, and by which paths light arrives; with standard errors. The light comes
    from the declared field unless told otherwise. Powers add: interference is not in it.
    """
    if direction and lambertian is not None:
        raise InputError("command line", "--lambertian", lambertian, "stands beside --direction", "give one of them")
    if out and Path(out).suffix.lower() != ".json":
        raise InputError("command line", "--out", out, "is not a format for this", "end the file's name in .json")
    angles = _pair_of_numbers("--direction", direction) if direction else None
    from cgi_wave.report import output

    with output.whole_file(out) if out else nullcontext() as file:
        with _computing():
            from cgi_wave.optics.system import load_instrument
            from cgi_wave.rays import flux as walk

            loaded = load_instrument(instrument)
            system = loaded.band(band)
            source = walk.from_degrees(angles) if angles else None
            if lambertian is not None:
                source = walk.lambertian(lambertian)
            weight = float("inf") if analog else split
            found = walk.flux(system, rays, seed, source, split=weight, progress=_progress)
        options = {"band": band, "instrument": instrument, "rays": rays, "seed": seed, "source": found.source,
                   "split": None if analog else split}  # fmt: skip
        made = output.provenance(loaded.name, loaded.hash, options)
        document = found.document() | {"split": options["split"], "provenance": made}
        if file:
            file.write_text(output.to_json(document) + "\n", encoding="utf-8")
    if as_json:
        click.echo(output.to_json(document))
    else:
        from cgi_wave.report.ledger import flux_text

        click.echo(flux_text(found))


@click.command()
@click.argument("band", required=False)
@click.option("--out", default="layout.png", show_default=True, metavar="FILE", help="Picture: .png, .svg or .pdf.")
@_instrument
@_json
def draw(band: str | None, out: str, instrument: str | None, as_json: bool) -> None:
    """Draw the instrument with rays.

    The rays are those of BAND, the first band of the instrument if not given.
    """
    from cgi_wave.report import output

    suffix = Path(out).suffix.lower()
    if suffix not in PICTURES:
        remedy = f"end the file's name in one of {', '.join(PICTURES)}"
        raise InputError("command line", "--out", out, "is not a format for pictures", remedy)
    with output.whole_file(out) as file:
        with _computing():
            from cgi_wave.report import build

            (chosen, *_) = _check_bands([band] if band else [], instrument)
            build.layout_figure(_views(chosen, instrument)).savefig(file, format=suffix[1:], dpi=200)
    if as_json:
        click.echo(output.to_json({"band": chosen, "file": out}))
    else:
        click.echo(out)


@click.command()
@click.argument("coefficients", nargs=-1, metavar="W020=W [W040=W] [W131=W] [W222=W] [W111=W]")
@click.option("--obscuration", type=float, default=0.0, show_default=True, metavar="E", help="Of the pupil's radius.")
@click.option("--shift", default="0,0", show_default=True, metavar="SX,SY", help="Of beam m, in pupil radii.")
@click.option("--tol", type=float, default=1e-8, show_default=True, metavar="T", help="Absolute error allowed.")
@click.option("--method", default="auto", show_default=True, metavar="NAME", help="The cheapest, or one by name.")
@_json
def contrast(
    coefficients: tuple[str, ...], obscuration: float, shift: str, tol: float, method: str, as_json: bool
) -> None:
    """Overlap contrast of two circular pupils.

    Beam m is displaced by SX,SY pupil radii and has the given Hopkins coefficients, in waves at the edge of its own
    pupil and about its own centre (W111, W131 along y, W222 on y²; phase exp(+i2πW)). Beam l is centred and perfect.
    Both have the obscuration; each is normalised by its own power.
    """
    values = _coefficients(coefficients)
    shift_x, shift_y = _pair_of_numbers("--shift", shift)
    from cgi_wave.wave import hopkins
    from cgi_wave.wave.methods import auto

    pair = hopkins.HopkinsPair(**values, obscuration=obscuration, shift_x=shift_x, shift_y=shift_y)
    with _computing():
        found = auto.contrast(pair, tol, method)
    document = {
        "contrast": [found.value.real, found.value.imag],
        "magnitude": abs(found.value),
        "error_bound": found.error_bound,
        "method": found.method,
        "seconds": found.seconds,
        "eq4": hopkins.eq4(pair),
    }
    if as_json:
        from cgi_wave.report import output

        click.echo(output.to_json(document))
        return
    eq4 = "none: beam m is a point as well" if document["eq4"] is None else f"{document['eq4']:.6g}"
    click.echo(
        f"contrast    {found.value.real:+.10e} {found.value.imag:+.10e}i\n"
        f"magnitude   {abs(found.value):.10e}\n"
        f"error bound {found.error_bound:.2g}\n"
        f"method      {found.method} ({found.nodes} nodes, {found.seconds * 1e3:.3g} ms)\n"
        f"Eq. 4       {eq4} (a perfect beam l is a point to geometric optics)"
    )


@click.command("import")
@click.argument("file")
@click.option("--out", metavar="FILE", help="Instrument file to write (.toml); standard output if not given.")
@click.option("--glass", "glasses", multiple=True, metavar="NAME=PAGE", help="Catalogue page or index of a glass.")
@click.option("--primary-only", is_flag=True, help="Import the reference wavelength alone, as model glasses need.")
@_json
def import_(file: str, out: str | None, glasses: tuple[str, ...], primary_only: bool, as_json: bool) -> None:
    """Make an instrument file of a lens FILE of Zemax (.zmx) or CODE V (.seq).

    Prints what was substituted, dropped or ignored. What would bend light otherwise than the file says is refused.
    """
    from cgi_wave.report import output

    chosen = dict(_glass(word) for word in glasses)
    with output.whole_file(out) if out else nullcontext() as target:
        with _computing():
            from cgi_wave.lensfile.load import import_lens

            found = import_lens(file, chosen, primary_only)
        if target:
            Path(target).write_text(found.toml, encoding="utf-8")
    if as_json:
        click.echo(output.to_json(found.report() | {"out": out, "instrument": found.document}))
    elif out:
        click.echo(f"{found.text()}\n{out}")
    else:
        _progress(found.text())
        click.echo(found.toml, nl=False)


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("name", required=False)
@click.argument("options", nargs=-1, type=click.UNPROCESSED)
@_json
def validate(name: str | None, options: tuple[str, ...], as_json: bool) -> int:
    """Run the validation study NAME, or list the studies.

    Studies compare with closed forms, with other programs and with the paper, write a report where they have one, and
    print their figures. OPTIONS go to the study: `cgi-wave validate contrast -- --help` shows them. They come with the
    source of the package, not with the installed package.
    """
    import subprocess

    folder = Path(__file__).parents[2] / "validation"
    studies = {file.stem: file for file in sorted(folder.glob("*.py")) if _is_study(file)}
    if not studies:
        remedy = "run it from a copy of the source"
        raise InputError("command line", "validate", str(folder), "the studies are not there", remedy)
    if name is None:
        if as_json:
            from cgi_wave.report import output

            click.echo(output.to_json({"studies": {n: _first_line(f) for n, f in studies.items()}}))
        else:
            click.echo("\n".join(f"{n:15} {_first_line(f)}" for n, f in studies.items()))
        return 0
    if name not in studies:
        raise InputError("command line", "NAME", name, "there is no such study", f"use one of {', '.join(studies)}")
    words = [sys.executable, "-m", f"validation.{name}", *options, *(["--json"] if as_json else [])]
    path = os.pathsep.join([str(folder.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.run(words, check=False, env=os.environ | {"PYTHONPATH": path}).returncode


COMMANDS = (run, ghosts, psi, frame, scroll, plan, rank, flux, contrast, import_, validate, draw)


def _is_study(file: Path) -> bool:
    return '__name__ == "__main__"' in file.read_text(encoding="utf-8")


def _first_line(file: Path) -> str:
    """What a study says of itself in the first line of its docstring."""
    import ast

    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return text.splitlines()[0] if text else ""


def _coefficients(words: Sequence[str]) -> dict[str, float]:
    """NAME=WAVES words as keywords of HopkinsPair."""
    names = ("w020", "w040", "w131", "w222", "w111")
    found: dict[str, float] = {}
    for word in words:
        name, _, value = word.partition("=")
        if name.lower() not in names or name.lower() in found:
            problem = "given twice" if name.lower() in found else "no coefficient of that name"
            raise InputError("command line", "coefficient", word, problem, f"use {', '.join(names).upper()}, each once")
        found[name.lower()] = _number(name, value)
    return found


def _pair_of_numbers(name: str, text: str) -> tuple[float, float]:
    parts = text.split(",")
    if len(parts) != 2:
        raise InputError("command line", name, text, "not two numbers", "write them as 0.1,0.2")
    return _number(name, parts[0]), _number(name, parts[1])


def _glass(word: str) -> tuple[str, str | float]:
    """A NAME=PAGE word; the page may be a constant index."""
    name, equals, page = word.partition("=")
    if not (name and equals and page):
        raise InputError("command line", "--glass", word, "names no page", "write NAME=shelf/book/page or NAME=1.5")
    try:
        return name, float(page)
    except ValueError:
        return name, page


def _analyse(
    bands: list[str], instrument: str | None, tolerance: float, cross_family: bool = False
) -> tuple[Analysis, dict[str, Any]]:
    """The analysis and its provenance, after the checks that need no computation."""
    _check_tolerance(tolerance)
    bands = _check_bands(bands, instrument)
    from cgi_wave import analysis
    from cgi_wave.report import output

    result = analysis.analyse(bands, instrument, tolerance, _progress, cross_family)
    options = {"bands": bands, "instrument": instrument, "tolerance": tolerance, "cross_family": cross_family}
    made = output.provenance(result.instrument_name, result.instrument_hash, options)
    return result, made | result.provenance


def _views(band: str, instrument: str | None) -> list[dict[str, Any]]:
    """The layout of the instrument in one band."""
    from cgi_wave.optics.system import load_instrument
    from cgi_wave.report.layout import layout

    return layout(load_instrument(instrument).band(band))
