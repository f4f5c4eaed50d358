"""A frame of a band: its fringe field, traced or read from a file, over a scene, with and without ghosts."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.budget.fringefield import zone_of, zone_rows_lit
from cgi_wave.budget.scenes import NAMES, band_scene
from cgi_wave.budget.setting import filter_of
from cgi_wave.errors import InputError
from cgi_wave.fields import fringe_field
from cgi_wave.fringes.beams_on_scene import Beams, LayerPlan
from cgi_wave.fringes.edge import edge_error
from cgi_wave.fringes.field import FringeField, Shadow, at_sigma
from cgi_wave.fringes.field_file import load_field, save_field
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.mutual_error import mutual_error
from cgi_wave.fringes.nominal_image import NominalImage, nominal_image
from cgi_wave.fringes.pattern import Layer, fringe_patterns
from cgi_wave.fringes.preparation import prepare
from cgi_wave.fringes.subfield import with_families
from cgi_wave.optics.system import Instrument, OpticalSystem, load_instrument
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.ground import Scene, on_zone

Array = NDArray[np.float64]
Real = NDArray[np.floating]
Progress = Callable[[str], None]
#: x0, x1, y0, y1 of the pixels' outer edges, m.
ZoneEdges = tuple[float, float, float, float]
#: Largest error that the choices for images add to a frame, relative irradiance times the scene's largest value.
IMAGES = 1e-4
#: Pixels beyond the zone up to which a scene that needs no file goes on, where beams look; beyond, its edge does.
WIDEST_MARGIN = 256


@dataclass(frozen=True)
class Ready:
    """All that frames of a band need. layers and beams with ghosts, nominal_layers and nominal_beams without.

    scene : placed on the zone; phase (R, X) : rad, 2πσ0 times the nominal OPD; image : the scene through the nominal
    PSF, None if the field has none; edge, mutual : errors by what lies beyond the scene, and by pairs' own images, see
    ``errors_of``
    uniform (R, X) : frame of a uniform scene of the reference albedo
    layers : without their patterns, which frames do not need any more
    """

    instrument: Instrument
    field: FringeField
    scene: Scene
    band_filter: Filter
    zone: Zone
    phase: Array
    uniform: Array
    layers: tuple[Layer, ...]
    beams: Beams
    nominal_layers: tuple[Layer, ...]
    nominal_beams: Beams
    image: NominalImage | None
    edge: float
    mutual: tuple[float, float]


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
    between = shift % 1.0 != 0.0
    ready = ready_for(loaded, traced, scene, shift, ghosts, "float64", progress, watch, between, across)
    taken, nominal = ready.beams.frame(shift), ready.nominal_beams.frame(shift)
    watch.lap("frames")
    errors = errors_of(ready)
    dark, lit = dead_rows(traced), lit_rows(traced)
    contrast = _fringe_contrast(ready.uniform[lit], ready.phase[lit])
    return Frame(
        traced.band, ready.zone.x_m, ready.zone.y_m, traced.rows, traced.columns, taken, nominal,
        ready.phase / (2.0 * np.pi * traced.sigma0), traced.sigma0, float(taken.mean()),
        float(taken.std() / taken.mean()), contrast, sum(errors.values()), errors,
        tuple(layer.name for layer in ready.layers), ready.beams.plans, traced.shadows,
        tuple((a + traced.rows[0], b + traced.rows[0]) for a, b in dark), ready.scene.source, shift, loaded.name,
        loaded.hash, watch.seconds,
    )  # fmt: skip


class Stopwatch:
    """Seconds per step."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Add the time since the last lap to a step."""
        now = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self._last
        self._last = now


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
    if field is not None:
        save_field(traced, field, made)
    return traced


def ready_for(
    loaded: Instrument, field: FringeField, scene: str | Path | Scene, reach: float, ghosts: bool,
    precision: Literal["float32", "float64"], progress: Progress, watch: Stopwatch, fractions: bool = True,
    across: ZoneEdges | None = None,
) -> Ready:  # fmt: skip
    """Scene, patterns and images. reach : rows by which the ground will have moved at most; fractions : whether it will
    stop between rows; across : what the scene is placed on (the field's zone if None). Raises InputError."""
    system = loaded.band(field.band)
    progress(f"{field.band}: scene")
    placed = place_scene(system, across or field.zone, scene, reach, _margin(field, ghosts) if scene in NAMES else 0)
    band_filter = filter_of(system)
    weights = band_filter.transmission(placed.sigma) * placed.shapes
    watch.lap("scene")
    progress(f"{field.band}: patterns of {len(field.pairs)} pairs of beams and {len(placed.shapes)} spectral shapes")
    own = np.dtype(precision).type
    nominal = fringe_patterns(with_families(field, ()), placed.sigma, weights, dtype=own)
    layers = fringe_patterns(field, placed.sigma, weights, dtype=own) if ghosts else nominal
    watch.lap("patterns")
    at_y, at_x = field.to(field.y_pixels, field.x_pixels)
    phase = 2.0 * np.pi * field.sigma0 * (at_y @ at_sigma(field.nominal, field.sigma0)[1] @ at_x)
    zone = zone_on(field, placed, phase)
    image = None
    if field.psf is not None:
        progress(f"{field.band}: nominal image")
        image = nominal_image(field.psf, field.zone, zone, placed.maps, IMAGES, own)
        watch.lap("nominal image")
    progress(f"{field.band}: images of {len(layers)} layers")

    def made(of: tuple[Layer, ...]) -> Beams:
        return prepare(of, placed.maps, zone, tolerance=IMAGES, precision=precision, nominal=image, fractions=fractions)

    beams = made(layers)
    bare = made(nominal) if ghosts else beams
    watch.lap("images")
    edge = edge_error(layers, field.psf, placed.maps, zone, reach)
    apart = mutual_error(field, placed.maps[0]) if ghosts else (0.0, 0.0)
    watch.lap("errors")
    uniform = np.zeros(zone.shape)
    for layer in layers:  # one by one: all of them at once would be the largest array of all
        uniform += layer.pattern[0]
    if ghosts:
        layers = tuple(replace(layer, pattern=layer.pattern[:, :0].copy()) for layer in layers)  # a view keeps all
    return Ready(
        loaded, field, placed, band_filter, zone, phase, uniform, layers, beams, nominal, bare, image, edge, apart
    )


def zone_on(field: FringeField, scene: Scene, phase: Array) -> Zone:
    """The field's pixels on a placed scene. phase (R, X) : rad, of the nominal OPD."""
    x, y = field.x_pixels, field.y_pixels
    column, row = ((at - origin) / scene.pixel_m for at, origin in zip((x[0], y[0]), scene.origin_m, strict=True))
    dark = tuple(row for first, last in dead_rows(field) for row in range(first, last))
    return Zone(x, y, _whole(row), _whole(column), phase, dark)


def errors_of(ready: Ready) -> dict[str, float]:
    """Parts of the error of a frame, relative irradiance, at the scene's brightest pixel; see ``pattern.Layer``.

    not_computed : what tracing left out, times the largest nominal modulation; images : choices for blurs and maps;
    scene : what the low-rank form of the scene leaves; edge : what ghosts and the nominal PSF see beyond the scene,
    where its edge goes on: the kernels' weight there times the scene's range
    psf_between, psf_window, psf_arms : of the nominal PSF between traced points, beyond its window, and by beam
    mutual, mutual_bound : what pairs with ghosts have of images of their own, measured on the scene, and bounded
    """
    bright = float(ready.scene.maps[0].max())
    nominal = ready.nominal_layers[0].pattern[0]
    modulation = 0.5 * float(np.ptp(nominal))
    parts = {
        name: bright * sum(getattr(layer, name) for layer in ready.layers)
        for name in ("contrast", "power", "interpolation", "left_out", "numerical")
    }
    field = ready.field if len(ready.field.labels) > 2 else None
    missed = 0.0 if field is None or ready.layers is ready.nominal_layers else field.left_out + field.left_out_baseline
    return (
        parts
        | {
            "not_computed": bright * modulation * missed,
            "images": ready.beams.error,
            "scene": ready.scene.rank_residual * bright * float(np.abs(nominal).max()),
            "edge": ready.edge,
            "mutual": ready.mutual[0],
            "mutual_bound": ready.mutual[1],
        }
        | _psf_errors(ready.image, float(np.abs(nominal).max()))
    )


def _psf_errors(image: NominalImage | None, most: float) -> dict[str, float]:
    if image is None:
        return {}
    return {"psf_between": most * image.between, "psf_window": most * image.window, "psf_arms": most * image.arms}


def lit_rows(field: FringeField) -> NDArray[np.bool_]:
    """(R,) rows of the zone in which no arm is shaded."""
    lit = np.ones(len(field.y_pixels), bool)
    for shadow in field.shadows:
        lit &= shadow.passed(field.y_pixels) >= 1.0
    return lit


def dead_rows(field: FringeField) -> tuple[tuple[int, int], ...]:
    """First and last + 1 row of the zone, counted from its first, in which an arm is shaded."""
    shaded = ~lit_rows(field)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], shaded.astype(int), [0]])))
    return tuple((int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True))


def place_scene(
    system: OpticalSystem, zone: ZoneEdges, scene: str | Path | Scene, reach: float, margin: int = 0
) -> Scene:
    """A scene by name, file or as it is on a zone that it has to cover, also when the ground has moved by reach rows.

    Raises InputError.
    """
    if isinstance(scene, Scene):
        return on_zone(scene, zone, 2, reach)
    return band_scene(system, scene, 2, reach, margin, zone=zone)


def _margin(field: FringeField, ghosts: bool) -> int:
    """Pixels beyond the zone that beams look at, on the side where they look farthest, at most WIDEST_MARGIN."""
    x0, x1, y0, y1 = field.zone
    corners = np.array([(x, y, 1.0) for x in (x0, x1) for y in (y0, y1)])
    most = 0.0 if field.psf is None else 0.5 * max(field.psf.kernel.shape[2:])
    for view in field.views if ghosts else ():
        low, high = (pick(corners @ view.affine.T, axis=0) / field.pixel_m for pick in (np.min, np.max))
        half = np.array(view.kernel.shape[::-1]) // 2
        beyond = [np.array([x0, y0]) / field.pixel_m - low + half, high + half - np.array([x1, y1]) / field.pixel_m]
        most = max(most, float(np.max(beyond)))
    return min(int(np.ceil(most)), WIDEST_MARGIN)


def _whole(place: float) -> float:
    """Rounding of coordinates is not a fraction of a pixel."""
    return float(np.rint(place)) if abs(place - np.rint(place)) < 1e-6 else float(place)


def _fringe_contrast(pattern: Array, phase: Array) -> float:
    """M/B by least squares of baseline and one fringe on all pixels."""
    terms: Sequence[Array] = (np.ones_like(phase), np.cos(phase), np.sin(phase))
    normal = np.array([[float((a * b).sum()) for b in terms] for a in terms])
    right = np.array([float((a * pattern).sum()) for a in terms])
    base, cosine, sine = np.linalg.lstsq(normal, right, rcond=None)[0]
    return float(np.hypot(cosine, sine) / base)
