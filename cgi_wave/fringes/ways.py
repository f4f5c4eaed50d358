"""The ways a layer goes into frames, sharp or smooth: what is kept, and what is made of it for a part of a scroll.

``preparation`` chooses them, ``imaging`` has the images. Whatever a way measures on the scene it measures anew for
every part of a scroll.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes import blur, smooth
from cgi_wave.fringes.beams_on_scene import Beams, LayerPlan, Sharp, Smooth, Warped
from cgi_wave.fringes.cells import Coarse
from cgi_wave.fringes.field import SceneView
from cgi_wave.fringes.imaging import Ground, Seen, Span, on_columns, seen, seen_by_cells, turning
from cgi_wave.fringes.layer import Zone
from cgi_wave.kernels import frames as kernels

Array = NDArray[np.float64]
Real = NDArray[np.floating]
Index = NDArray[np.int64]
BETWEEN = 1.5  # what is measured on some pixels and scrolls is taken as so much larger elsewhere
CHECKED, SCROLLS = 8000, 8  # pixels on which the image of a smooth layer is checked
IDENTITY = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class View:
    """What of the scene a layer sees. strength (C,) : largest |pattern| of each mode; of : the ghosts, None where the
    scene is seen as it is; how : of the blur, sample by sample, or by_cells; error : of it, relative irradiance"""

    name: str
    affine: Array
    strength: Array
    of: SceneView | None
    how: blur.Blur
    by_cells: Coarse | None
    error: float

    def seen(self, ground: Ground, zone: Zone, span: Span, dtype: type) -> Seen:
        """The scene through the layer's blur."""
        if self.by_cells is not None:
            return seen_by_cells(ground, self.by_cells, self.affine, zone, span, dtype)
        kernel = None if self.of is None or self.how.method == "nothing" else self.of.kernel
        return seen(ground, self.how, kernel, self.affine, zone, span)

    def off(self, part: Seen, zone: Zone) -> float:
        """What the distance of ghosts from their affine map may change, relative irradiance."""
        if self.of is None or not self.of.misfit_m:
            return 0.0
        return float(self.strength @ part.steepest()) * self.of.misfit_m / zone.pitch

    @property
    def blur(self) -> str:
        """What was done, in words."""
        return self.how.method if self.by_cells is None else f"cells of {self.by_cells.step}"


@dataclass(frozen=True)
class SharpWay:
    """A layer that is read row by row; or, if ``turned``, pixel by pixel."""

    view: View
    pattern: Real
    taps: int
    strict: bool
    turned: bool

    def made(self, ground: Ground, zone: Zone, span: Span, dtype: type) -> tuple[Sharp | Warped, LayerPlan]:
        """What frames take of it."""
        view = self.view
        part = view.seen(ground, zone, span, dtype)
        column, row = part.places(view.affine, zone)
        error, off = view.error + float(view.strength @ part.reading(self.taps)), view.off(part, zone)
        if self.turned:
            plan = LayerPlan(view.name, "warped", view.blur, 1, error, off)
            return Warped(view.name, self.pattern, part.image, column, row, self.taps), plan
        error += float(view.strength.max()) * turning(view.affine, zone, part.image)
        middle = zone.shape[0] // 2, zone.shape[1] // 2
        image = on_columns(part.image, column[middle[0]], self.taps)
        sharp = Sharp(view.name, self.pattern, image, row[:, middle[1]].copy(), self.taps, -round(part.row),
                      self.strict)  # fmt: skip
        return sharp, LayerPlan(view.name, "sharp", view.blur, 1, error, off)


@dataclass(frozen=True)
class Placed:
    """A smooth layer on a grid. envelope (C, M, N, K), M = 1 without fringes; coarse (C, V, K), row (N,), step: rows of
    the scene per coarse row; error, places : see ``LayerPlan``, without that of the blur"""

    envelope: Real
    coarse: Real
    row: Array
    step: float
    error: float
    places: float = 0.0


@dataclass(frozen=True)
class Samples:
    """Pixels, rows j and columns i, on which images of smooth layers are checked; pattern (C, N) on them."""

    j: Index
    i: Index
    pattern: Real

    @classmethod
    def of(cls, pattern: Real, pixels: tuple[Index, Index]) -> Samples:
        """The pattern (C, R, X) on ``pixels``, which all layers may share."""
        return cls(*pixels, pattern[:, pixels[0], pixels[1]])


def sampled_pixels(shape: tuple[int, int]) -> tuple[Index, Index]:
    """Rows and columns of CHECKED pixels anywhere in a zone, the same ones each time."""
    rng = np.random.default_rng(1)
    return rng.integers(0, shape[0], CHECKED), rng.integers(0, shape[1], CHECKED)


@dataclass(frozen=True)
class SmoothWay:
    """A layer that goes onto the grid: its envelope, and ``flat``, by how much that misses the pattern anywhere."""

    view: View
    where: smooth.Grid
    envelope: Real
    flat: float
    samples: Samples

    def made(self, ground: Ground, zone: Zone, span: Span, turn: Real, dtype: type) -> tuple[Placed, LayerPlan]:
        """What frames take of it."""
        part = self.view.seen(ground, zone, span, dtype)
        placed = self.placed(part, ground, zone, turn, truth(self.view, part, self.samples, zone, span, ground), dtype)
        return placed, self.plan(placed)

    def plan(self, placed: Placed) -> LayerPlan:
        """What was chosen, and its errors on a part of the scroll."""
        view = self.view
        return LayerPlan(view.name, "smooth", view.blur, self.where.pitch, view.error + placed.error, placed.places)

    def placed(
        self, part: Seen, ground: Ground, zone: Zone, turn: Real, expected: dict[float, Array], dtype: type
    ) -> Placed:
        """The image on the grid, and its error: under uniform light everywhere, with the scene at the samples."""
        height, pitch, tile, affine = part.image.shape[1], self.where.pitch, ground.tile, self.view.affine
        count = max(-(-height * part.step // pitch), 4)
        step = height / count if tile else (height - 1) / (count - 1)
        along, across = self.where.nodes
        middle = 0.5 * (zone.shape[0] - 1), 0.5 * (zone.shape[1] - 1)
        column, ahead = (place[0] for place in part.places(affine, zone, np.array([middle[0]]), across))
        lines = np.concatenate([along, np.array(zone.dark, np.float64)])
        row = part.places(affine, zone, lines, np.array([middle[1]]))[1][:, 0]
        centre = part.places(affine, zone, np.array([middle[0]]), np.array([middle[1]]))[1][0, 0]
        coarse = kernels.sampled(part.image, np.arange(count) * step, ahead - centre, column, tile)
        placed = Placed(self.envelope, coarse, row / step, step * part.step, 0.0)
        lone = alone(placed, zone, self.where, turn, tile, dtype)
        error = self.flat * (float(np.abs(part.image).max()) or 1.0)
        for shift, values in expected.items():
            off = np.abs(lone.frame(shift)[self.samples.j, self.samples.i] - values).max()
            error = max(error, BETWEEN * float(off))
        if part.step > 1:
            error += float(self.view.strength @ part.reading(4))
        return replace(placed, error=error, places=self.view.off(part, zone))


def flatness(envelope: Real, uniform: Array, zone: Zone, where: smooth.Grid, turn: Real, dtype: type) -> float:
    """Largest |envelope − pattern| over the zone. uniform (R, X) : the pattern's modes, added up."""
    ones: Real = np.ones((len(envelope), 4, envelope.shape[3]), dtype)
    placed = Placed(envelope, ones, np.zeros(envelope.shape[2]), 1.0, 0.0)
    return float(np.abs(alone(placed, zone, where, turn, False, dtype).frame(0.0) - uniform).max())


def truth(
    view: View, part: Seen, samples: Samples, zone: Zone, span: Span, ground: Ground
) -> dict[float, Array]:  # fmt: skip
    """What the layer gives at the samples at SCROLLS scrolls of a span, image and pattern read at each of them."""
    first, last = (0.0, float(ground.height)) if ground.tile else (max(span.low, 0.0), max(span.high, 0.0))
    shifts = first + (last - first) * np.modf(0.5 * (np.sqrt(5.0) - 1.0) * np.arange(SCROLLS))[0]
    height = part.image.shape[1]
    column, row = (place[samples.j, samples.i] for place in part.places(view.affine, zone))
    at_x, weight_x = smooth.taps(column, part.image.shape[2], False)
    found = {}
    for shift in np.unique(shifts).tolist():
        at_y, weight_y = smooth.taps(row + shift / part.step, height, ground.tile)
        image = np.zeros((len(part.image), len(column)))
        for a in range(4):
            for b in range(4):
                image += weight_y[:, a] * weight_x[:, b] * part.image[:, at_y[:, a], at_x[:, b]]
        found[shift] = (samples.pattern * image).sum(axis=0)
    return found


def alone(placed: Placed, zone: Zone, where: smooth.Grid, turn: Real, tile: bool, dtype: type) -> Beams:
    """Frames of nothing but one smooth layer."""
    nothing: Real = np.zeros((1, *zone.shape), dtype)
    dark = Sharp("nothing", nothing, np.zeros((1, 1, zone.shape[1]), dtype), np.zeros(zone.shape[0]), 2, 0, False)
    part = gathered([placed], zone, where, turn, tile, dtype)
    return Beams(zone, dtype, tile, 1, (dark,), (), part, (), 0.0)


def gathered(
    parts: Sequence[Placed], zone: Zone, where: smooth.Grid, turn: Real, tile: bool, dtype: type
) -> Smooth:  # fmt: skip
    """All smooth layers as frames take them. turn (2, R, K) : see ``turn_of``."""
    parts = sorted(parts, key=lambda part: -part.envelope.shape[1])
    modes, lines = len(parts[0].coarse), len(where.nodes[0])
    size = np.repeat([part.coarse.shape[1] for part in parts], modes)
    images = [image for part in parts for image in part.coarse]
    if tile:
        images = [np.concatenate([image[-1:], image, image[:2]]) for image in images]
    coarse: Real = np.zeros((len(size), max(len(image) for image in images), len(where.nodes[1])), dtype)
    for number, image in enumerate(images):
        coarse[number, : len(image)] = image
    which = np.full(zone.shape[0], -1)
    which[list(zone.dark)] = np.arange(len(zone.dark))
    envelopes = [one for part in parts for one in part.envelope]

    def of(kinds: int) -> Real:
        some = [one[:, :lines] for one in envelopes if len(one) == kinds]
        return np.array(some, dtype).reshape(-1, kinds, *where.shape)

    own: Real = np.array([one[0, lines:] for one in envelopes], dtype)
    return Smooth(
        where, turn, which,
        _grouped(of(5), (2, 3, 0, 1)), _grouped(of(1)[:, 0], (1, 2, 0)), _grouped(own, (1, 2, 0)),
        _grouped(coarse, (2, 0, 1)), np.repeat([part.row for part in parts], modes, axis=0),
        np.repeat([part.step for part in parts], modes), size,
    )  # fmt: skip


def turn_of(zone: Zone, where: smooth.Grid, dtype: type) -> Real:
    """(2, R, K) cos and sin of the nominal phase at the nodes of a grid, K filled up to a multiple of LANES."""
    phase = np.zeros(zone.shape) if zone.phase is None else zone.phase
    return _filled(smooth.turns(phase, where, dtype))


def _filled(nodes: Real) -> Real:
    """(…, K) with zeros behind, so that K is a multiple of LANES."""
    return np.pad(nodes, [(0, 0)] * (nodes.ndim - 1) + [(0, -nodes.shape[-1] % kernels.LANES)])


def _grouped(nodes: Real, order: tuple[int, ...]) -> Real:
    """(…, K) in groups of LANES nodes, (…, G, LANES), and the axes before the last in this order."""
    nodes = _filled(nodes)
    split = nodes.reshape(*nodes.shape[:-1], nodes.shape[-1] // kernels.LANES, kernels.LANES)
    return np.ascontiguousarray(split.transpose(*order, split.ndim - 1))
