"""The commands ``frame`` and ``scroll``: what the detector records of a scene, and what is retrieved from it."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

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
    from cgi_wave.frames import Frame
    from cgi_wave.fringes.detector import Detector
    from cgi_wave.mosaic import DetectorFrame
    from cgi_wave.scrolling import Scrolled

Command = TypeVar("Command", bound=Callable[..., Any])
Found = TypeVar("Found", "Frame", "DetectorFrame")


def _scene_options(function: Command) -> Command:
    for option in (
        click.option("--pictures", metavar="DIR", help="Write the pictures as PNG into this folder."),
        click.option("--field", "field", metavar="FILE.nc", help="Read the fringe field; trace and write it if new."),
        click.option(
            "--scene", default="landsat", show_default=True, metavar="NAME|FILE",
            help="landsat, uniform, edge, quadrants, point, or a file of your own.",
        ),
    ):  # fmt: skip
        function = option(function)
    return function


@click.command()
@click.argument("band")
@click.option("--shift", type=float, default=0.0, show_default=True, metavar="ROWS", help="The ground has moved by.")
@click.option("--no-ghosts", is_flag=True, help="Nominal beams only.")
@click.option("--out", metavar="FILE.nc", help="Write the frame as NetCDF.")
@_scene_options
@tolerance_option
@instrument_option
@json_option
def frame(
    band: str, shift: float, no_ghosts: bool, out: str | None, scene: str, field: str | None, pictures: str | None,
    tolerance: float, instrument: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Make the frame that the detector records in BAND.

    Nominal beams and all ghosts over a scene, each with its own image of it, and the same without ghosts. Tracing the
    fringe field takes most of the time: --field keeps it. BAND may be several with commas between (VIS,NIR), a channel
    or a detector: the frame is the whole detector's, and --field a folder with a file per band.
    """
    from cgi_wave.report import frame_file, output

    check_tolerance(tolerance)
    bands = _bands(band, instrument)
    if len(bands) > 1:
        _detector_frame(bands, shift, no_ghosts, out, scene, field, pictures, tolerance, instrument, as_json)
        return
    band = bands[0]
    options = {"band": band, "scene": scene, "shift": shift, "ghosts": not no_ghosts, "field": field,
               "tolerance": tolerance, "instrument": instrument}  # fmt: skip

    def compute() -> Frame:
        from cgi_wave import frames

        return frames.frame(band, scene, instrument, tolerance, shift, not no_ghosts, field, progress)

    found, made = _produced(compute, frame_file.write_frame, "band", "plot_frame", options, out, pictures)
    figures = frame_file.frame_figures(found)
    if as_json:
        click.echo(output.to_json({**figures, "out": out, "provenance": made}))
        return
    worst = max(found.errors, key=lambda name: found.errors[name])
    dead = ", ".join(f"{a} to {b - 1}" for a, b in found.dead_rows) or "none"
    click.echo(
        f"mean            {found.mean:.6g} of the input\n"
        f"contrast        {found.fringe_contrast:.4f} of the fringes, {found.rms_contrast:.4f} RMS with the scene\n"
        f"error bound     {found.error:.2g} of the input, most of it: {worst}\n"
        f"dead rows       {dead}\n"
        f"layers          {len(found.layers)}\n"
        f"seconds         {', '.join(f'{name} {value:.2f}' for name, value in found.seconds.items())}"
    )


def _produced(
    compute: Callable[[], Found], write: Callable[[Path, Found, dict[str, Any]], None], of: str, plot: str,
    options: dict[str, Any], out: str | None, pictures: str | None,
) -> tuple[Found, dict[str, Any]]:  # fmt: skip
    """A frame and its provenance, written and drawn; of: the attribute that names it, plot: function that draws it."""
    from cgi_wave.report import frame_file, output

    if out:
        frame_file.check_netcdf(out, "--out")
    with ExitStack() as stack:
        target = stack.enter_context(output.whole_file(out)) if out else None
        folder = stack.enter_context(output.whole_folder(pictures, "--pictures")) if pictures else None
        with computing():
            found = compute()
            made = output.provenance(found.instrument_name, found.instrument_hash, options)
            if target:
                write(target, found, made)
            if folder:
                from cgi_wave.report import frame_plots

                _save(folder / f"{getattr(found, of)}-frame.png", getattr(frame_plots, plot), found)
    return found, made


def _detector_frame(
    bands: tuple[str, ...], shift: float, no_ghosts: bool, out: str | None, scene: str, field: str | None,
    pictures: str | None, tolerance: float, instrument: str | None, as_json: bool,
) -> None:  # fmt: skip
    """The frame of a whole detector."""
    from cgi_wave.report import frame_file, output

    options = {"bands": bands, "scene": scene, "shift": shift, "ghosts": not no_ghosts, "field": field,
               "tolerance": tolerance, "instrument": instrument}  # fmt: skip
    if field and not Path(field).is_dir():
        raise InputError("command line", "--field", field, f"is no folder for the fields of {len(bands)} bands",
                         "create a folder and name it; each band has a file in it")  # fmt: skip
    fields = {band: Path(field) / f"{band}.nc" for band in bands} if field else {}

    def compute() -> DetectorFrame:
        from cgi_wave import mosaic

        return mosaic.detector_frame(bands, scene, instrument, tolerance, shift, not no_ghosts, fields, progress)

    found, made = _produced(compute, frame_file.write_detector, "detector", "plot_detector", options, out, pictures)
    figures = frame_file.detector_figures(found)
    if as_json:
        click.echo(output.to_json({**figures, "out": out, "provenance": made}))
        return
    for part in found.parts:
        click.echo(
            f"{part.band:<15} rows {part.rows[0]} to {part.rows[1] - 1}, mean {part.mean:.6g} of its input, fringes "
            f"{part.fringe_contrast:.4f}, error bound {part.error:.2g}"
        )
    empty = ", ".join(f"{a} to {b - 1}" for a, b in found.empty_rows) or "none"
    click.echo(f"rows of no band {empty}\nnot included    light of one band on another one's rows")


@click.command()
@click.argument("band")
@click.option("--frames", type=int, metavar="N", help="Of the sequence; twice the zone's rows if not given.")
@click.option("--step", type=float, default=1.0, show_default=True, metavar="ROWS", help="Per frame.")
@click.option("--jitter", type=float, default=0.0, show_default=True, metavar="ROWS", help="Standard deviation.")
@click.option("--attitude", default="0,100", show_default=True, metavar="ROWS,FRAMES", help="Amplitude and period.")
@click.option("--tdi", type=int, default=1, show_default=True, metavar="N", help="Rows added, P/4 at most.")
@click.option("--noise", type=float, metavar="ELECTRONS", help="Shot noise: electrons at relative irradiance 1.")
@click.option("--read", "read", type=float, default=0.0, show_default=True, metavar="ELECTRONS", help="Read noise.")
@click.option(
    "--shot",
    type=click.Choice(["poisson", "gaussian", "none"]),
    default="poisson",
    show_default=True,
    help="How the light's own noise is drawn.",
)
@click.option("--full-well", type=float, metavar="ELECTRONS", help="Where a pixel saturates.")
@click.option("--bits", type=int, metavar="N", help="Of the converter; its last step is the full well.")
@click.option("--seed", type=int, default=0, show_default=True, metavar="S", help="Of noise and jitter.")
@click.option("--out", metavar="FILE.nc", help="Write the maps as NetCDF.")
@click.option("--frames-out", metavar="FILE.nc", help="Write every frame as NetCDF.")
@click.option("--movie", metavar="FILE", help="Write the scroll as an animated .gif, or as .mp4 (needs ffmpeg).")
@_scene_options
@tolerance_option
@instrument_option
@json_option
def scroll(
    band: str, frames: int | None, step: float, jitter: float, attitude: str, tdi: int, noise: float | None,
    read: float, shot: str, full_well: float | None, bits: int | None, seed: int, out: str | None,
    frames_out: str | None, movie: str | None, scene: str, field: str | None,
    pictures: str | None, tolerance: float, instrument: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Scroll a scene past BAND, and retrieve M, B and NMA of the ground.

    Frame by frame, with and without ghosts: maps of M, B and NMA, of the NMA error, and how it goes with the contrast
    of albedo. Frames pass through one by one; the maps grow with the ground.
    """
    from cgi_wave.report import frame_file, output

    _check(band, tolerance, instrument)
    for name, value in (("--out", out), ("--frames-out", frames_out)):
        if value:
            frame_file.check_netcdf(value, name)
    if movie:
        from cgi_wave.report.movies import check_movie

        check_movie(movie, "--movie")
    for name, given in (("--read", read or None), ("--full-well", full_well), ("--bits", bits)):
        if given is not None and noise is None:
            raise InputError("command line", name, given, "stands without --noise", "give the electrons as well")
    detector = _detector(noise, read, full_well, bits, shot)
    amplitude, period = _attitude(attitude)
    options = {"band": band, "scene": scene, "frames": frames, "step": step, "jitter": jitter, "attitude": attitude,
               "tdi": tdi, "noise": noise, "read": read, "shot": shot, "full_well": full_well, "bits": bits,
               "seed": seed, "field": field, "tolerance": tolerance,
               "instrument": instrument}  # fmt: skip
    with ExitStack() as stack:
        target = stack.enter_context(output.whole_file(out)) if out else None
        film = stack.enter_context(output.whole_file(movie, "--movie")) if movie else None
        folder = stack.enter_context(output.whole_folder(pictures, "--pictures")) if pictures else None
        sequence = stack.enter_context(output.whole_file(frames_out, "--frames-out")) if frames_out else None
        with computing():
            from cgi_wave import scrolling
            from cgi_wave.optics.system import load_instrument

            loaded = load_instrument(instrument)
            made = output.provenance(loaded.name, loaded.hash, options)
            with ExitStack() as writing:
                sink = writing.enter_context(frame_file.frames_file(sequence, made)) if sequence else None
                found = scrolling.scroll(
                    band, scene, frames, step, jitter, amplitude, period, tdi, detector, seed, instrument, tolerance,
                    field, sink, progress,
                )  # fmt: skip
                if sink:
                    sink(0, x_m=found.x_m, y_m=found.ready.zone.y_m)
            if target:
                frame_file.write_maps(target, found, made)
            if folder:
                _pictures(folder, found)
            if film:
                from cgi_wave.report import movies

                movies.write_movie(film, found)
    figures = frame_file.scroll_figures(found)
    if as_json:
        click.echo(output.to_json({**figures, "out": out, "frames_out": frames_out, "provenance": made}))
        return
    errors, relation = found.errors, found.relation
    click.echo(
        f"ground          {len(found.nominal.ground)} rows of {len(found.x_m)} points, from {found.frames} frames\n"
        f"fit             {found.nominal.window} rows, {found.nominal.fringes} fringes, "
        f"{found.rows_per_fringe:.2f} rows each\n"
        f"NMA             {found.nominal.nma.mean():.5f} nominal, {found.recorded.nma.mean():.5f} recorded\n"
        f"NMA error       {errors.mean:+.5f} mean, {errors.spread:.5f} spread, {errors.low:+.5f} to {errors.high:+.5f} "
        "(95 %)\n"
        + ("" if relation is None else f"albedo contrast slope {relation.slope:+.5f}, r {relation.correlation:+.3f}\n")
        + ("" if found.tdi is None else f"TDI             {found.tdi.rows} rows keep {found.tdi.contrast:.4f}\n")
        + f"error bound     {found.error:.2g} of the input"
    )


COMMANDS = (frame, scroll)


def _bands(name: str, instrument: str | None) -> tuple[str, ...]:
    from cgi_wave.mosaic import bands_of
    from cgi_wave.optics.system import load_instrument

    return bands_of(load_instrument(instrument), name)


def _check(band: str, tolerance: float, instrument: str | None) -> None:
    check_tolerance(tolerance)
    check_bands([band], instrument)


def _detector(
    noise: float | None, read: float, full_well: float | None, bits: int | None, shot: str
) -> Detector | None:
    if noise is None:
        return None
    from cgi_wave.fringes.detector import Detector

    return Detector(noise, read, math.inf if full_well is None else full_well, bits, cast(Any, shot))


def _attitude(text: str) -> tuple[float, float]:
    amplitude, comma, period = text.partition(",")
    if not comma:
        raise InputError("command line", "--attitude", text, "is not amplitude and period", "write it as 0.3,120")
    return number("--attitude", amplitude), number("--attitude", period)


def _save(path: Path, plot: Callable[..., Any], result: object) -> None:
    import matplotlib

    with matplotlib.rc_context({"backend": "Agg"}):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.0, 5.0), layout="constrained")
        FigureCanvasAgg(figure)
        plot(result, figure.add_subplot())
        figure.savefig(path, dpi=150, bbox_inches="tight")


def _pictures(folder: Path, found: Scrolled) -> None:
    """The maps, the strip, and the interferogram of the ground point in the middle of the maps, taken apart."""
    from cgi_wave.pointparts import point_parts
    from cgi_wave.report import frame_plots

    progress("taking one interferogram apart")
    ground = int(found.nominal.ground[len(found.nominal.ground) // 2])
    parts = point_parts(found.ready, found.moves, ground, len(found.x_m) // 2)
    _save(folder / f"{found.band}-point.png", frame_plots.plot_point, parts)
    _save(folder / f"{found.band}-point-spectrum.png", frame_plots.plot_point_spectrum, parts)
    _save(folder / f"{found.band}-nma-error.png", frame_plots.plot_nma_error, found)
    _save(folder / f"{found.band}-waterfall.png", frame_plots.plot_waterfall, found)
