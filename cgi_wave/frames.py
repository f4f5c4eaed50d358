"""A frame of a band: its fringe field, traced or read from a file, over a scene, with and without ghosts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.budget.fringefield import zone_of, zone_rows_lit
from cgi_wave.errors import InputError
from cgi_wave.fields import fringe_field
from cgi_wave.fringes.beams_on_scene import LayerPlan
from cgi_wave.fringes.field import FringeField, Shadow
from cgi_wave.fringes.field_file import load_field, save_field
from cgi_wave.fringes.imaging import Span
from cgi_wave.optics.system import Instrument, load_instrument
from cgi_wave.ready import Progress, Stopwatch, ZoneEdges, dead_rows, place_scene, ready_for
from cgi_wave.scene.ground import Scene

Array = NDArray[np.float64]
Real = NDArray[np.floating]


@dataclass(frozen=True)
class Frame:
    """One frame. x_m (X,), y_m (R,) : pixel centres on the detector, m; rows, columns : first and last + 1 pixel.

    frame, nominal (R, X) : irradiance relative to the input, with and without ghosts; a uniform scene of the reference
    albedo gives the band's interferogram
    opd_m (R, X) : of the nominal beams at the carrier's wavenumber sigma0 (1/m)
    mean : of the frame; rms_contrast : standard deviation over mean, which the scene has a part in; fringe_contrast :
    M/B of the fringes under uniform light, rows of dead zones left out
    error : bound of what is wrong anywhere in ``frame``, relative irradiance: the sum of ``errors``
    plans : how each layer's image is made; layers : their names; shift : rows by which the scene has moved
    """

    band: str
    x_m: Array
    y_m: Array
    rows: tuple[int, int]
    columns: tuple[int, int]
    frame: Real
    nominal: Real
    opd_m: Array
    sigma0: float
    mean: float
    rms_contrast: float
    fringe_contrast: float
    error: float
    errors: dict[str, float]
    layers: tuple[str, ...]
    plans: tuple[LayerPlan, ...]
    shadows: tuple[Shadow, ...]
    dead_rows: tuple[tuple[int, int], ...]
    scene: str
    shift: float
    instrument_name: str
    instrument_hash: str
    seconds: dict[str, float]


def frame(
    band: str,
    scene: str | Path | Scene = "landsat",
    instrument: str | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    shift: float = 0.0,
    ghosts: bool = True,
    field: FringeField | str | Path | None = None,
    progress: Progress = lambda _: None,
) -> Frame:
    """What the detector records of a scene in one frame.

    scene : a name (``budget.scenes.NAMES``), a file, or a Scene; tolerance : part of the nominal modulation that a pair
    of beams may add and be left out; shift : rows, ≥ 0, by which the ground has moved along −y; ghosts : without,
    ``frame`` is ``nominal``; field : a fringe field, or its file (see ``field_of``)

    Raises InputError, EmptyBeamError, MethodLimitError.
    """
    check_shift(shift)
    watch = Stopwatch()
    loaded = load_instrument(instrument)
    traced = field_of(loaded, band, instrument, tolerance, field, scene, shift, progress)
    watch.lap("field")
    return framed(loaded, traced, scene, shift, ghosts, progress, watch)


def check_shift(shift: float) -> None:
    """Refuse rows that the ground cannot have moved by. Raises InputError."""
    if not (np.isfinite(shift) and shift >= 0.0):
        raise InputError("frame", "shift", shift, "is out of range", "give rows, 0 or more")


def framed(
    loaded: Instrument, traced: FringeField, scene: str | Path | Scene, shift: float, ghosts: bool, progress: Progress,
    watch: Stopwatch, across: ZoneEdges | None = None,
) -> Frame:  # fmt: skip
    """The frame of a fringe field; arguments as of ``frame``. across : what the scene is placed on, if not the zone."""
    here, between = Span(shift, shift), shift % 1.0 != 0.0
    ready = ready_for(loaded, traced, scene, here, ghosts, "float64", progress, watch, between, across)
    images = ready.at(here)
    assert images.nominal_beams is not None
    taken, nominal = images.beams.frame(shift), images.nominal_beams.frame(shift)
    watch.lap("frames")
    return Frame(
        traced.band, ready.zone.x_m, ready.zone.y_m, traced.rows, traced.columns, taken, nominal,
        ready.phase / (2.0 * np.pi * traced.sigma0), traced.sigma0, float(taken.mean()),
        float(taken.std() / taken.mean()), ready.contrast, sum(images.errors.values()), images.errors,
        tuple(layer.name for layer in ready.layers), images.beams.plans, traced.shadows,
        tuple((a + traced.rows[0], b + traced.rows[0]) for a, b in dead_rows(traced)), ready.scene.source, shift,
        loaded.name, loaded.hash, watch.seconds,
    )  # fmt: skip


def field_of(
    loaded: Instrument,
    band: str,
    instrument: str | None,
    tolerance: float,
    field: FringeField | str | Path | None = None,
    scene: str | Path | Scene = "landsat",
    reach: float = 0.0,
    progress: Progress = lambda _: None,
) -> FringeField:
    """The fringe field of a band: given, read from a file, or traced, and then written to that file if one is named.

    A file is refused that was made for another instrument, band or tolerance; a scene that does not cover the zone and
    the rows that the ground moves by (``reach``) is refused before anything is traced. Raises InputError.
    """
    system = loaded.band(band)
    if isinstance(field, FringeField):
        if field.band != band:
            raise InputError("fringe field", "band", field.band, f"is not {band}", "give the field of this band")
        return field
    made: dict[str, str | float] = {"instrument_hash": loaded.hash, "tolerance": tolerance}
    if field is not None and Path(field).exists():
        progress(f"{band}: reading the fringe field from {field}")
        return load_field(field, {**made, "band": band})
    if field is not None and not Path(field).parent.is_dir():
        raise InputError(str(field), "file", Path(field).name, "its folder does not exist", "create the folder first")
    if scene != "landsat":
        zone, _ = zone_of(system, zone_rows_lit(loaded, system)[0])
        place_scene(system, zone, scene, reach)
    traced = fringe_field(band, instrument, tolerance, progress=progress).field
    if field is None:
        return traced
    save_field(traced, field, made)
    return load_field(field)  # its kernels stay in the file
