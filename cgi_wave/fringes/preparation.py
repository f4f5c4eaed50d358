"""Layers and scene made ready for frames: how each layer's image is made, and what that choice adds to the error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.fringes import blur, smooth
from cgi_wave.fringes.beams_on_scene import WHOLE, Beams, LayerPlan, Sharp, Smooth, Warped
from cgi_wave.fringes.field import SceneView
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.nominal_image import NominalImage
from cgi_wave.fringes.pattern import Layer
from cgi_wave.kernels import frames as kernels

Array = NDArray[np.float64]
Real = NDArray[np.floating]
Index = NDArray[np.int64]
Interpolation = Literal["area", "cubic"]
AROUND = 32  # pixels around the zone where the nodes of a smooth layer may stand
BETWEEN = 1.5  # what is measured on some pixels and scrolls is taken as so much larger elsewhere
CHECKED, SCROLLS = 8000, 8  # pixels on which the image of a smooth layer is checked
IDENTITY = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def prepare(
    layers: Sequence[Layer],
    maps: Real,
    zone: Zone,
    *,
    tolerance: float = 1e-6,
    tile: bool = False,
    interpolation: Interpolation = "area",
    precision: Literal["float32", "float64"] = "float32",
    nominal: NominalImage | None = None,
    fractions: bool = True,
) -> Beams:
    """Get layers and scene ready for frames.

    layers : the nominal one first; maps (C, H, W) : the scene, relative radiance per mode, [Y, X] at the zone's
    pitch; tolerance : largest error that the choices for all ghosts together may add, relative irradiance times the
    scene's largest value; tile : along track the scene repeats; interpolation : see the module; nominal : what the
    first layer sees, on the zone's columns (None: the maps as they are); fractions : whether it is read between rows.

    Ghosts that look beyond the scene see its edge go on. The nominal beam may not.

    Raises InputError for a scene narrower than the swath (how many columns are missing), for shapes that do not fit,
    and values that are not finite.
    """
    dtype = np.dtype(precision).type
    maps = np.asarray(maps)
    _check(layers, maps, zone)
    maps = np.ascontiguousarray(maps, dtype=dtype)
    scale, height = float(np.abs(maps).max()) or 1.0, maps.shape[1]
    budget = tolerance * scale
    blurs = [_blur_of(layer, maps, 0.5 * budget / len(layers), scale, precision == "float32") for layer in layers]
    together, found = _smooth(layers, blurs, maps, zone, 0.5 * budget, scale, tile, dtype)
    left = [number for number in range(len(layers)) if number not in found]
    share = 0.5 * budget / len(left)
    sharp: list[Sharp] = []
    warped: list[Warped] = []
    plans: list[LayerPlan] = []
    for number, (layer, how) in enumerate(zip(layers, blurs, strict=True)):
        if number == 0 and nominal is not None:
            for k, (image, along) in enumerate(zip(nominal.maps, nominal.along, strict=True)):
                pattern = np.ascontiguousarray(layer.pattern * along[None, :, None], dtype=dtype)
                rows = zone.row + np.arange(zone.shape[0], dtype=np.float64)
                sharp.append(Sharp(layer.name, pattern, image.astype(dtype, copy=False), rows, 4, 0, k == 0))
            between = _reading(nominal.maps[0], 4) if fractions or zone.row % 1.0 else 0.0
            error = (float(np.abs(layer.pattern).max()) or 1.0) * (nominal.error + between)
            plans.append(LayerPlan(layer.name, "sharp", nominal.blur, 1, error))
            continue
        weight = float(np.abs(layer.pattern).max()) or 1.0
        error = weight * scale * how.error
        if number in found:
            assert together is not None
            plans.append(LayerPlan(layer.name, "smooth", how.method, together.grid.pitch, error + found[number]))
            continue
        affine = IDENTITY if layer.view is None else layer.view.affine
        seen, margin = _blurred(maps, how, layer.view, zone, tile)
        count = 4 if how.method != "nothing" or interpolation == "cubic" else 2
        pattern = np.ascontiguousarray(layer.pattern, dtype=dtype)
        column, row = _places(affine, zone, margin)
        error += weight * _reading(seen, count)
        turning = weight * _turning(affine, zone, seen)
        if turning <= share:
            middle = zone.shape[0] // 2, zone.shape[1] // 2
            image = _columns(seen, column[middle[0]], count)
            sharp.append(Sharp(layer.name, pattern, image, row[:, middle[1]].copy(), count, margin[0], number == 0))
            plans.append(LayerPlan(layer.name, "sharp", how.method, 1, error + turning))
        else:
            warped.append(Warped(layer.name, pattern, seen, column, row, count))
            plans.append(LayerPlan(layer.name, "warped", how.method, 1, error))
    return Beams(
        replace(zone, phase=None), dtype, tile, height, tuple(sharp), tuple(warped), together, tuple(plans),
        sum(plan.error for plan in plans),
    )  # fmt: skip


def _blur_of(layer: Layer, maps: Real, allowed: float, scale: float, single: bool) -> blur.Blur:
    """How the layer's blur is done: its error, times pattern and scene, within ``allowed``."""
    seen = layer.view is not None and layer.view.kernel.size > 1
    kernel = layer.view.kernel.astype(np.float64) if layer.view is not None and seen else None
    weight = float(np.abs(layer.pattern).max()) or 1.0
    return blur.choose(kernel, allowed / (weight * scale), maps.shape[1] * maps.shape[2], single)


@dataclass(frozen=True)
class _Candidate:
    """One layer on one grid: envelope (C, M, N, K), M = 1 without fringes; coarse (C, V, K), row (N,), step: rows of
    the scene per coarse row."""

    envelope: Real
    coarse: Real
    row: Array
    step: float
    error: float


def _blurred(
    maps: Real, how: blur.Blur, view: SceneView | None, zone: Zone, tile: bool
) -> tuple[Real, tuple[int, int]]:
    """The blurred scene wherever the layer looks while the nominal beam stays on the scene, and how many samples before
    the scene's first row and column it begins."""
    if view is None or how.method == "nothing":
        return maps, (0, 0)
    reach = np.array([zone.y_m[[0, -1]], zone.x_m[[0, -1]]])
    reach += AROUND * zone.pitch * np.array([-1.0, 1.0])
    corners = np.array([(x, y, 1.0) for y in reach[0] for x in reach[1]]) @ view.affine.T
    column = zone.column + (corners[:, 0] - zone.x_m[0]) / zone.pitch
    row = zone.row + (corners[:, 1] - zone.y_m[0]) / zone.pitch
    first, last = _scrolls(maps.shape[1], zone)
    rows = (0, maps.shape[1]) if tile else (int(row.min() + first) - 4, int(row.max() + last) + 5)
    columns = int(column.min()) - 4, int(column.max()) + 5
    return blur.part(maps, how, view.kernel.astype(np.float64), tile, rows, columns), (-rows[0], -columns[0])


def _scrolls(height: int, zone: Zone) -> tuple[float, float]:
    """Least and largest scroll at which the nominal beam sees nothing but the scene."""
    return -zone.row, max(height - zone.shape[0] - zone.row, -zone.row)


def _places(
    affine: Array, zone: Zone, margin: tuple[int, int], rows: Array | None = None, columns: Array | None = None
) -> tuple[Array, Array]:
    """Column and row of the scene, in samples, under detector points (default: the zone's pixels), at scroll 0."""
    x = zone.x_m if columns is None else zone.x_m[0] + columns * zone.pitch
    y = zone.y_m if rows is None else zone.y_m[0] + rows * zone.pitch
    big_x = affine[0, 0] * x[None, :] + affine[0, 1] * y[:, None] + affine[0, 2]
    big_y = affine[1, 0] * x[None, :] + affine[1, 1] * y[:, None] + affine[1, 2]
    column, row = zone.column + (big_x - zone.x_m[0]) / zone.pitch, zone.row + (big_y - zone.y_m[0]) / zone.pitch
    return column + margin[1], row + margin[0]


def _turning(affine: Array, zone: Zone, seen: Real) -> float:
    """What neglecting that a map turns rows may cost: largest step between neighbours times the pixels it moves by."""
    across = abs(affine[1, 0]) * np.ptp(zone.x_m) / zone.pitch / 2.0
    along = abs(affine[0, 1]) * np.ptp(zone.y_m) / zone.pitch / 2.0
    if across + along <= WHOLE:
        return 0.0
    step_y, step_x = (float(np.abs(np.diff(seen, axis=axis)).max()) for axis in (1, 2))
    return across * step_y + along * step_x


def _columns(seen: Real, column: Array, count: int) -> Real:
    """(C, H, X) the map at the columns of the image: a view for whole ones in order, else a copy."""
    nearest = np.rint(column)
    if np.abs(column - nearest).max() < WHOLE and nearest.min() >= 0 and nearest.max() < seen.shape[2]:
        index = nearest.astype(np.int64)
        if np.all(np.diff(index) == 1):
            return seen[:, :, index[0] : index[-1] + 1]
        return np.ascontiguousarray(seen[:, :, index])
    return smooth.resampled(seen, column, 2, False, count)


def _reading(seen: Real, count: int) -> float:
    """Error of reading a map between samples, in its units: 0 for cells (two taps); else from fourth differences."""
    if count == 2:
        return 0.0
    return sum(float(np.abs(np.diff(seen, n=4, axis=axis)).max()) for axis in (1, 2)) / 24.0


def _smooth(
    layers: Sequence[Layer], blurs: Sequence[blur.Blur], maps: Real, zone: Zone, budget: float, scale: float,
    tile: bool, dtype: type,
) -> tuple[Smooth | None, dict[int, float]]:  # fmt: skip
    """As many layers as go onto one grid with their errors together within the budget, and the error of each.

    The coarsest grid of those that take as many.
    """
    envelopes = None
    every: dict[int, dict[int, _Candidate]] = {}
    for number, (layer, how) in enumerate(zip(layers, blurs, strict=True)):
        if number == 0 or layer.view is None or how.method == "nothing" or min(*zone.shape, *maps.shape[1:]) < 4:
            continue
        envelopes = envelopes or smooth.Envelopes(zone)
        fits = [envelopes.fit(part, 0.5 * budget / len(layers) / scale) for part in layer.pattern]
        terms = [fit for fit in fits if fit is not None]
        if len(terms) == len(fits):
            every[number] = _candidates(layer, layer.view, terms, how, maps, zone, envelopes, budget, tile, dtype)
    best: tuple[int, dict[int, float]] = 0, {}
    for pitch in smooth.PITCHES:
        errors = sorted((found[pitch].error, number) for number, found in every.items() if pitch in found)
        total = np.cumsum([error for error, _ in errors])
        taken = {
            number: error for (error, number), sum_so_far in zip(errors, total, strict=True) if sum_so_far <= budget
        }
        if len(taken) > len(best[1]):
            best = pitch, taken
    pitch, taken = best
    if not taken:
        return None, {}
    return _gather(
        [every[number][pitch] for number in taken], zone, smooth.grid(zone.shape, pitch, dtype), dtype, tile
    ), taken


def _candidates(
    layer: Layer, view: SceneView, terms: Sequence[tuple[tuple[int, int], Array]], how: blur.Blur, maps: Real,
    zone: Zone, envelopes: smooth.Envelopes, most: float, tile: bool, dtype: type,
) -> dict[int, _Candidate]:  # fmt: skip
    """The layer on every grid on which its error is below ``most``, finest first."""
    found: dict[int, _Candidate] = {}
    seen, margin = _blurred(maps, how, view, zone, tile)
    first, last = (0.0, float(maps.shape[1])) if tile else _scrolls(maps.shape[1], zone)
    shifts = max(first, 0.0) + (last - max(first, 0.0)) * np.modf(0.5 * (np.sqrt(5.0) - 1.0) * np.arange(SCROLLS))[0]
    check = _Check.of(layer, view, seen, margin, zone, tile, shifts)
    height = seen.shape[1]
    for pitch in sorted(smooth.PITCHES):
        if 4 * pitch > max(zone.shape):
            break
        where = smooth.grid(zone.shape, pitch, dtype)
        dark = list(zone.dark)
        envelope: Real = np.array(
            [envelopes.on_nodes(*fit, where, part[dark]) for fit, part in zip(terms, layer.pattern, strict=True)],
            dtype=dtype,
        )
        if np.abs(envelope[:, 1:]).sum(axis=1, initial=0.0).max() * check.scale < 1e-4 * most / len(envelope):
            envelope = envelope[:, :1]
        count = max(-(-height // pitch), 4)
        step = height / count if tile else (height - 1) / (count - 1)
        along, across = where.nodes
        middle = 0.5 * (zone.shape[0] - 1), 0.5 * (zone.shape[1] - 1)
        column, ahead = (place[0] for place in _places(view.affine, zone, margin, np.array([middle[0]]), across))
        _, row = _places(view.affine, zone, margin, np.concatenate([along, dark]), np.array([middle[1]]))
        centre = _places(view.affine, zone, margin, np.array([middle[0]]), np.array([middle[1]]))[1]
        coarse = kernels.sampled(seen, np.arange(count) * step, ahead - centre[0, 0], column, tile)
        candidate = _Candidate(envelope, coarse, row[:, 0] / step, step, 0.0)
        error = check.error(candidate, zone, where, tile, dtype)
        if error > most:
            break
        found[pitch] = replace(candidate, error=error)
    return found


@dataclass(frozen=True)
class _Check:
    """What a layer adds to frames: under uniform light everywhere, (R, X); and with the scene at CHECKED pixels, rows j
    and columns i, at the scrolls that are the keys of ``truth``. scale: the image's largest value."""

    uniform: Array
    scale: float
    height: int
    j: Index
    i: Index
    truth: dict[float, Array]

    @classmethod
    def of(
        cls, layer: Layer, view: SceneView, seen: Real, margin: tuple[int, int], zone: Zone, tile: bool,
        shifts: Array,
    ) -> _Check:  # fmt: skip
        rng = np.random.default_rng(1)
        j, i = rng.integers(0, zone.shape[0], CHECKED), rng.integers(0, zone.shape[1], CHECKED)
        height = seen.shape[1]
        column, row = (place[j, i] for place in _places(view.affine, zone, margin))
        at_x, weight_x = smooth.taps(column, seen.shape[2], False)
        truth = {}
        for shift in shifts.tolist():
            at_y, weight_y = smooth.taps(row + shift, height, tile)
            image = np.zeros((len(seen), CHECKED))
            for a in range(4):
                for b in range(4):
                    image += weight_y[:, a] * weight_x[:, b] * seen[:, at_y[:, a], at_x[:, b]]
            truth[shift] = (layer.pattern[:, j, i] * image).sum(axis=0)
        return cls(layer.pattern.sum(axis=0), float(np.abs(seen).max()) or 1.0, height, j, i, truth)

    def error(self, candidate: _Candidate, zone: Zone, where: smooth.Grid, tile: bool, dtype: type) -> float:
        """Largest difference of frames from these, with room for what lies between the samples."""
        alone = _alone(candidate, zone, where, tile, self.height, dtype)
        flat = replace(candidate, coarse=np.ones_like(candidate.coarse))
        uniform = _alone(flat, zone, where, tile, self.height, dtype).frame(0.0)
        worst = float(np.abs(uniform - self.uniform).max()) * self.scale
        for shift, truth in self.truth.items():
            worst = max(worst, BETWEEN * float(np.abs(alone.frame(shift)[self.j, self.i] - truth).max()))
        return worst


def _alone(candidate: _Candidate, zone: Zone, where: smooth.Grid, tile: bool, height: int, dtype: type) -> Beams:
    """Frames of nothing but one smooth layer."""
    nothing: Real = np.zeros((1, *zone.shape), dtype)
    dark = Sharp("nothing", nothing, np.zeros((1, height, zone.shape[1]), dtype), np.zeros(zone.shape[0]), 2, 0, False)
    part = _gather([candidate], zone, where, dtype, tile)
    return Beams(zone, dtype, tile, height, (dark,), (), part, (), 0.0)


def _gather(parts: Sequence[_Candidate], zone: Zone, where: smooth.Grid, dtype: type, tile: bool) -> Smooth:
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
    phase = np.zeros(zone.shape) if zone.phase is None else zone.phase
    return Smooth(
        where, _filled(smooth.turns(phase, where, dtype)), which,
        _grouped(of(5), (2, 3, 0, 1)), _grouped(of(1)[:, 0], (1, 2, 0)), _grouped(own, (1, 2, 0)),
        _grouped(coarse, (2, 0, 1)), np.repeat([part.row for part in parts], modes, axis=0),
        np.repeat([part.step for part in parts], modes), size,
    )  # fmt: skip


def _filled(nodes: Real) -> Real:
    """(…, K) with zeros behind, so that K is a multiple of LANES."""
    return np.pad(nodes, [(0, 0)] * (nodes.ndim - 1) + [(0, -nodes.shape[-1] % kernels.LANES)])


def _grouped(nodes: Real, order: tuple[int, ...]) -> Real:
    """(…, K) in groups of LANES nodes, (…, G, LANES), and the axes before the last in this order."""
    nodes = _filled(nodes)
    split = nodes.reshape(*nodes.shape[:-1], nodes.shape[-1] // kernels.LANES, kernels.LANES)
    return np.ascontiguousarray(split.transpose(*order, split.ndim - 1))


def _check(layers: Sequence[Layer], maps: Real, zone: Zone) -> None:
    def refuse(name: str, value: object, problem: str, remedy: str) -> None:
        raise InputError("frames", name, value, problem, remedy)

    if maps.ndim != 3 or maps.dtype.kind != "f":
        refuse("scene", f"{maps.dtype} {maps.shape}", "must be floating (modes, rows, columns)", "give maps of a Scene")
    if not np.all(np.isfinite(maps)):
        refuse("scene", "NaN or infinity", "must be finite", "fill the gaps of the scene")
    for layer in layers:
        if layer.pattern.shape != (len(maps), *zone.shape):
            refuse(f"layer {layer.name}.pattern", layer.pattern.shape, f"must be {(len(maps), *zone.shape)}",
                   "synthesise it for this zone and these spectral modes")  # fmt: skip
        if not np.all(np.isfinite(layer.pattern)):
            refuse(f"layer {layer.name}.pattern", "NaN or infinity", "must be finite", "synthesise it again")
        if layer.view is not None and abs(float(layer.view.kernel.sum(dtype=np.float64)) - 1.0) > 1e-6:
            refuse(f"layer {layer.name}.kernel", float(layer.view.kernel.sum(dtype=np.float64)), "must add up to 1",
                   "divide it by its sum; power belongs to the pattern")  # fmt: skip
    left = int(np.ceil(max(-zone.column, 0.0) - WHOLE))
    right = int(np.ceil(max(zone.column + zone.shape[1] - maps.shape[2], 0.0) - WHOLE))
    if left + right:
        refuse("scene", f"{maps.shape[2]} columns", f"is smaller than the swath: {left + right} columns are missing",
               "give a wider scene, or tile it across track")  # fmt: skip
