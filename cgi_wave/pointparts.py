"""The interferogram of one ground point, taken apart: nominal beams, each family of ghosts, and the rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.field import FieldPair, FringeField
from cgi_wave.fringes.imaging import Span
from cgi_wave.fringes.nominal_image import NominalImage
from cgi_wave.fringes.pattern import Layer, fringe_patterns
from cgi_wave.fringes.preparation import choose
from cgi_wave.fringes.scroll import Motion
from cgi_wave.fringes.subfield import with_families
from cgi_wave.ready import IMAGES, Ready, nominal_phase, zone_on

Array = NDArray[np.float64]
#: Columns about the point for which patterns are made.
STRIP = 32
#: Fringes of ghosts weaker than this share of the strongest are not listed.
WEAK = 1e-3


@dataclass(frozen=True)
class PointParts:
    """One ground point. rows (J,) : of the zone, that saw it; y_m (J,); ground : row of the scene; x_m : its column

    nominal, parasitic (J,) : irradiance without ghosts, and what all ghosts add
    parts : what each family adds to the nominal beams, by name; rest : fringes between families
    frequency (F,) 1/m along y; nominal_spectrum, parasitic_spectrum (F,) : amplitudes, Hann window, means taken out
    lines : (family, fringe frequency 1/m, amplitude under uniform light) of pairs with ghosts, at the zone's centre
    """

    ground: int
    x_m: float
    rows: NDArray[np.int64]
    y_m: Array
    nominal: Array
    parasitic: Array
    parts: dict[str, Array]
    rest: Array
    frequency: Array
    nominal_spectrum: Array
    parasitic_spectrum: Array
    lines: tuple[tuple[str, float, float], ...]


def point_parts(ready: Ready, moves: Motion, ground: int, column: int) -> PointParts:
    """Take the interferogram of a ground point (row of the scene, column of the zone) apart, without noise.

    Raises InputError for a point that fewer than eight rows see, or outside the zone.
    """
    field = ready.field
    count = len(field.x_pixels)
    if not 0 <= column < count:
        raise InputError("ground point", "column", column, f"is outside the zone of {count}", "name a column of it")
    row = ground - round(ready.zone.row) - moves.whole
    seen = np.flatnonzero((row >= 0) & (row < len(field.y_pixels)))
    if len(seen) < 8:
        raise InputError("ground point", "ground", ground, f"is seen by {len(seen)} rows", "take more frames")
    seen = seen[np.argsort(row[seen], kind="stable")]
    first = min(max(0, column - STRIP // 2), max(0, count - STRIP))
    strip = slice(first, min(first + STRIP, count))
    narrow = _columns(field, strip)
    sigma = ready.scene.sigma
    weights = ready.band_filter.transmission(sigma) * ready.scene.shapes
    point = _Point(ready, narrow, strip, moves.rows[seen], row[seen], column - first)
    bare = fringe_patterns(with_families(narrow, ()), sigma, weights)
    nominal = point.along(bare)
    parasitic = point.along(fringe_patterns(narrow, sigma, weights)) - nominal
    parts: dict[str, Array] = {}
    for view in narrow.views:
        layers = fringe_patterns(with_families(narrow, (view.family,)), sigma, weights)
        own = (replace(layers[0], pattern=layers[0].pattern - bare[0].pattern), *layers[1:])
        parts[view.name] = point.along(own)
    rest = parasitic - np.sum([*parts.values(), np.zeros_like(nominal)], axis=0)
    frequency: Array = np.fft.rfftfreq(len(seen), field.pixel_m).astype(np.float64)
    return PointParts(
        ground, float(field.x_pixels[column]), row[seen], field.y_pixels[row[seen]], nominal, parasitic, parts, rest,
        frequency, _spectrum(nominal), _spectrum(parasitic), _lines(field, sigma, weights[0], column),
    )  # fmt: skip


def _columns(field: FringeField, strip: slice) -> FringeField:
    x0 = field.zone[0]
    zone = (x0 + strip.start * field.pixel_m, x0 + strip.stop * field.pixel_m, *field.zone[2:])
    return replace(field, zone=zone, columns=(field.columns[0] + strip.start, field.columns[0] + strip.stop))


class _Point:
    """A ground point on the rows (J,) of a strip of the zone that see it, each at a scroll (J,) of its own."""

    def __init__(
        self, ready: Ready, narrow: FringeField, strip: slice, scrolls: Array, row: NDArray[np.int64], column: int
    ) -> None:  # fmt: skip
        self.maps, self.zone = ready.scene.maps, zone_on(narrow, ready.scene, nominal_phase(narrow))
        self.span = Span(float(scrolls.min()), float(scrolls.max()))
        self.places = list(zip(scrolls.tolist(), row.tolist(), strict=True))
        self.column = column
        self.image: NominalImage | None = None
        if ready.blur is not None:
            whole = ready.blur
            blur = replace(whole, weights=whole.weights[..., strip], column=whole.column[strip], precision=np.float64)
            self.image = blur.over(self.maps, self.zone, self.span)

    def along(self, layers: tuple[Layer, ...]) -> Array:
        """(J,) what the layers give on each row, in its frame."""
        beams = choose(
            layers, self.maps, self.zone, tolerance=IMAGES, precision="float64", span=self.span
        ).beams(self.span, self.image)  # fmt: skip
        return np.array([beams.frame(scroll)[j, self.column] for scroll, j in self.places])


def _spectrum(values: Array) -> Array:
    taper = np.hanning(len(values) + 2)[1:-1]
    mean = (values * taper).sum() / taper.sum()
    return np.asarray(2.0 * np.abs(np.fft.rfft((values - mean) * taper)) / taper.sum())


def _lines(field: FringeField, sigma: Array, weight: Array, column: int) -> tuple[tuple[str, float, float], ...]:
    """Fringe frequencies of all pairs with a ghost at a column of the zone's middle row, with their amplitudes."""
    middle = 0.5 * (field.zone[2] + field.zone[3])
    y = middle + field.pixel_m * np.array([-0.5, 0.0, 0.5])
    at_y, at_x = field.to(y, field.x_pixels[column : column + 1])
    names = {0: "nominal", **{view.family: view.name for view in field.views}}
    found = []
    for pair in field.pairs:
        ghosts = [int(field.family[beam]) for beam in (pair.m, pair.l) if field.family[beam] > 0]
        if ghosts:
            frequency, amplitude = _fringes(field, pair, sigma, weight, at_y, at_x)
            found.append((names.get(ghosts[0], f"family {ghosts[0]}"), frequency, amplitude))
    strongest = max((amplitude for *_, amplitude in found), default=0.0)
    return tuple(line for line in sorted(found, key=lambda line: -line[2]) if line[2] > WEAK * strongest)


def _fringes(
    field: FringeField, pair: FieldPair, sigma: Array, weight: Array, at_y: Array, at_x: Array
) -> tuple[float, float]:
    """Frequency (1/m) and amplitude of a pair's fringes behind the filter, from three places half a pixel apart."""
    low, high = pair.sigma[0], pair.sigma[-1]
    inside = (sigma >= low) & (sigma <= high) if len(pair.sigma) > 1 else np.ones(len(sigma), bool)
    wave, share = sigma[inside], weight[inside] / weight.sum()
    to = chebyshev.interpolation_matrix(pair.sigma, wave) if len(pair.sigma) > 1 else np.ones((len(wave), 1))
    gamma, opd = (to @ (at_y @ values @ at_x)[..., 0] for values in (pair.gamma, pair.opd_m))
    strength = (at_y @ field.strength(pair) @ at_x)[:, 0]
    term = 2.0 * strength * (share[:, None] * gamma * np.exp(2j * np.pi * wave[:, None] * opd)).sum(axis=0)
    frequency = abs(float(np.angle(term[2] * term[0].conj()))) / (2.0 * np.pi * field.pixel_m)
    return frequency, float(abs(term[1]))
