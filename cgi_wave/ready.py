"""All that frames of a band need: scene, patterns, ways and images of its layers, and the parts of their error."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.scenes import NAMES, band_scene
from cgi_wave.budget.setting import filter_of
from cgi_wave.fringes.beams_on_scene import Beams
from cgi_wave.fringes.edge import edge_error
from cgi_wave.fringes.field import FringeField, at_sigma
from cgi_wave.fringes.imaging import Span
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.mutual_error import mutual_error
from cgi_wave.fringes.nominal_image import NominalBlur, NominalImage, nominal_blur
from cgi_wave.fringes.pattern import Layer, fringe_patterns
from cgi_wave.fringes.preparation import Choice, Precision, choose
from cgi_wave.fringes.subfield import with_families
from cgi_wave.optics.system import Instrument, OpticalSystem
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.ground import Scene, on_zone

Array = NDArray[np.float64]
Progress = Callable[[str], None]
#: x0, x1, y0, y1 of the pixels' outer edges, m.
ZoneEdges = tuple[float, float, float, float]
#: Largest error that the choices for images add to a frame, relative irradiance times the scene's largest value.
IMAGES = 1e-4
#: Pixels beyond the zone up to which a scene that needs no file goes on, where beams look; beyond, its edge does.
WIDEST_MARGIN = 256
#: Rows of scroll that images are made for at a time, and by which ways are chosen.
STRETCH = 512


@dataclass(frozen=True)
class Images:
    """What frames take whose scrolls lie in ``span``. beams with ghosts, nominal_beams without (None: not asked for);
    image : the scene through the nominal PSF, None if the field has none; errors : see ``Ready.at``"""

    span: Span
    beams: Beams
    nominal_beams: Beams | None
    image: NominalImage | None
    errors: dict[str, float]


@dataclass(frozen=True)
class Ready:
    """Scene and layers of a band. choice : of ways with ghosts, bare : without; blur : of the nominal image, None if
    the field has no PSF; ``at`` makes the images of a part of a scroll.

    scene : placed on the zone; contrast : M/B of the fringes under uniform light, rows of dead zones left out
    layers, nominal_layers : names and errors, with ghosts and without; patterns only of ``nominal_layers``
    fixed : parts of the error that are the same for all of a scroll, see ``at``; most : largest nominal |pattern|
    """

    instrument: Instrument
    field: FringeField
    scene: Scene
    band_filter: Filter
    zone: Zone
    contrast: float
    layers: tuple[Layer, ...]
    nominal_layers: tuple[Layer, ...]
    choice: Choice
    bare: Choice
    blur: NominalBlur | None
    fixed: dict[str, float]

    @property
    def phase(self) -> Array:
        """(R, X) rad, 2πσ0 times the nominal OPD."""
        return nominal_phase(self.field)

    def at(self, span: Span, nominal: bool = True) -> Images:
        """Images for scrolls in a span; ``nominal``: also for frames without ghosts.

        errors : parts of the error of a frame, relative irradiance, at the scene's brightest pixel; see
        ``pattern.Layer``. not_computed : what tracing left out, times the largest nominal modulation; images : choices
        for blurs and maps; places : of ghosts off their affine map, on the steepest ground; scene : what the low-rank
        form of the scene leaves; edge : what ghosts and the nominal PSF
        see beyond the scene, where its edge goes on: the kernels' weight there times the scene's range; psf_between,
        psf_window, psf_arms : of the nominal PSF between traced points, beyond its window, and by beam; mutual,
        mutual_bound : what pairs with ghosts have of images of their own, measured on the scene, and bounded
        """
        image = None if self.blur is None else self.blur.over(self.scene.maps, self.zone, span)
        beams = self.choice.beams(span, image)
        bare = beams if self.bare is self.choice else None
        if nominal and bare is None:
            bare = self.bare.beams(span, image)
        most = float(np.abs(self.nominal_layers[0].pattern[0]).max())
        own = {"images": beams.error, "places": sum(plan.places for plan in beams.plans)}
        return Images(span, beams, bare, image, self.fixed | own | _psf_errors(image, most))


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


def ready_for(
    loaded: Instrument, field: FringeField, scene: str | Path | Scene, span: Span, ghosts: bool,
    precision: Precision, progress: Progress, watch: Stopwatch, fractions: bool = True,
    across: ZoneEdges | None = None,
) -> Ready:  # fmt: skip
    """Scene, patterns, and the choice of images by the first STRETCH rows of the scroll. span : the scrolls that frames
    will be made at; fractions : whether the ground will stop between rows; across : what the scene is placed on (the
    field's zone if None). Raises InputError."""
    system = loaded.band(field.band)
    progress(f"{field.band}: scene")
    margin = _margin(field, ghosts) if scene in NAMES else 0
    placed = place_scene(system, across or field.zone, scene, span.high, margin)
    band_filter = filter_of(system)
    weights = band_filter.transmission(placed.sigma) * placed.shapes
    watch.lap("scene")
    progress(f"{field.band}: patterns of {len(field.pairs)} pairs of beams and {len(placed.shapes)} spectral shapes")
    own = np.dtype(precision).type
    nominal = fringe_patterns(with_families(field, ()), placed.sigma, weights, dtype=own)
    layers = fringe_patterns(field, placed.sigma, weights, dtype=own) if ghosts else nominal
    watch.lap("patterns")
    phase = nominal_phase(field)
    zone = zone_on(field, placed, phase)
    blur = None
    if field.psf is not None:
        blur = nominal_blur(field.psf, field.zone, zone, placed.maps, IMAGES, own)
    progress(f"{field.band}: images of {len(layers)} layers")
    looked = Span(span.low, min(span.high, span.low + STRETCH))

    def chosen(of: tuple[Layer, ...]) -> Choice:
        return choose(of, placed.maps, zone, tolerance=IMAGES, precision=precision, fractions=fractions, span=looked)

    choice = chosen(layers)
    bare = chosen(nominal) if ghosts else choice
    watch.lap("images")
    fixed = _errors(field if ghosts else None, layers, nominal, placed)
    fixed["edge"] = edge_error(layers, field.psf, placed.maps, zone, span.high)
    fixed["mutual"], fixed["mutual_bound"] = mutual_error(field, placed.maps[0]) if ghosts else (0.0, 0.0)
    watch.lap("errors")
    lit, uniform = lit_rows(field), np.zeros(zone.shape)
    for layer in layers:  # one by one: all of them at once would be the largest array of all
        uniform += layer.pattern[0]
    contrast = _fringe_contrast(uniform[lit], phase[lit])
    if ghosts:
        layers = tuple(replace(layer, pattern=layer.pattern[:, :0].copy()) for layer in layers)  # a view keeps all
    return Ready(
        loaded, field, placed, band_filter, replace(zone, phase=None), contrast, layers, nominal, choice, bare, blur,
        fixed,
    )  # fmt: skip


def nominal_phase(field: FringeField) -> Array:
    """(R, X) rad, 2πσ0 times the nominal OPD on a field's pixels."""
    at_y, at_x = field.to(field.y_pixels, field.x_pixels)
    return np.asarray(2.0 * np.pi * field.sigma0 * (at_y @ at_sigma(field.nominal, field.sigma0)[1] @ at_x))


def zone_on(field: FringeField, scene: Scene, phase: Array) -> Zone:
    """The field's pixels on a placed scene. phase (R, X) : rad, of the nominal OPD."""
    x, y = field.x_pixels, field.y_pixels
    column, row = ((at - origin) / scene.pixel_m for at, origin in zip((x[0], y[0]), scene.origin_m, strict=True))
    dark = tuple(row for first, last in dead_rows(field) for row in range(first, last))
    return Zone(x, y, _whole(row), _whole(column), phase, dark)


def _errors(
    field: FringeField | None, layers: Sequence[Layer], nominal: Sequence[Layer], scene: Scene
) -> dict[str, float]:  # fmt: skip
    """What is the same for all frames; field : None without ghosts."""
    bright = float(scene.maps[0].max())
    own = nominal[0].pattern[0]
    parts = {
        name: bright * sum(getattr(layer, name) for layer in layers)
        for name in ("contrast", "power", "interpolation", "left_out", "numerical")
    }
    missed = 0.0 if field is None or len(field.labels) <= 2 else field.left_out + field.left_out_baseline
    parts["not_computed"] = bright * 0.5 * float(np.ptp(own)) * missed
    parts["scene"] = scene.rank_residual * bright * float(np.abs(own).max())
    return parts


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
        half = np.array(view.shape[::-1]) // 2
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
