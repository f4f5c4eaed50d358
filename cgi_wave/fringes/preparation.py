"""Layers made ready for frames over a scene: how each layer's image is made, and what that choice adds to the error.

``choose`` looks at a part of a scroll and decides; ``Choice.beams`` makes what frames of any part take. ``prepare`` is
both at once, for all of a scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.fringes import blur, smooth
from cgi_wave.fringes.beams_on_scene import WHOLE, Beams, LayerPlan, Sharp, Warped
from cgi_wave.fringes.cells import STEPS, coarse
from cgi_wave.fringes.imaging import Ground, Seen, Span, looked_at, turning, whole
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.nominal_image import NominalImage
from cgi_wave.fringes.pattern import Layer
from cgi_wave.fringes.ways import (
    IDENTITY,
    Placed,
    Samples,
    SharpWay,
    SmoothWay,
    View,
    flatness,
    gathered,
    sampled_pixels,
    truth,
    turn_of,
)

Array = NDArray[np.float64]
Real = NDArray[np.floating]
Interpolation = Literal["area", "cubic"]
Precision = Literal["float32", "float64"]
#: Part of what blurs may err by that cells may; the rest is for reading between their middles. Cells across a kernel.
CELLS, FEWEST = 0.8, 4


class Choice:
    """The way of every layer, the nominal one first. ``beams`` makes the images for a part of a scroll."""

    def __init__(
        self, zone: Zone, ground: Ground, dtype: type, ways: Sequence[SharpWay | SmoothWay], turn: Real | None,
        first: tuple[Span, dict[int, Placed]], fractions: bool,
    ) -> None:  # fmt: skip
        self.zone, self.ground, self.dtype = replace(zone, phase=None), ground, dtype
        self.ways, self._turn, self._first, self._fractions = tuple(ways), turn, first, fractions

    def beams(self, span: Span | None = None, nominal: NominalImage | None = None) -> Beams:
        """What frames take whose scrolls lie in ``span`` (None: all at which the nominal beam sees the scene).

        nominal : what the first layer sees, on the zone's columns (None: the scene as it is). Errors are those measured
        on this part.
        """
        ground, zone = self.ground, self.zone
        span = whole(ground.height, zone) if span is None else span
        held, known = self._first
        self._first = (held, {})  # images of the part that was looked at first are given away once
        sharp: list[Sharp] = []
        warped: list[Warped] = []
        placed: list[Placed] = []
        plans: list[LayerPlan] = []
        grid = None
        for number, way in enumerate(self.ways):
            if isinstance(way, SmoothWay):
                grid = way.where
                assert self._turn is not None
                if span == held and number in known:
                    one, plan = known[number], way.plan(known[number])
                else:
                    one, plan = way.made(ground, zone, span, self._turn, self.dtype)
                placed.append(one)
            elif number == 0 and nominal is not None:
                parts, plan = self._nominal(way, nominal)
                sharp.extend(parts)
            else:
                part, plan = way.made(ground, zone, span, self.dtype)
                (sharp if isinstance(part, Sharp) else warped).append(part)  # type: ignore[arg-type]
            plans.append(plan)
        together = None
        if placed:
            assert grid is not None and self._turn is not None
            together = gathered(placed, zone, grid, self._turn, ground.tile, self.dtype)
        return Beams(
            zone, self.dtype, ground.tile, ground.height, tuple(sharp), tuple(warped), together, tuple(plans),
            sum(plan.error for plan in plans), None if ground.tile else (span.low, span.high),
        )  # fmt: skip

    def _nominal(self, way: SharpWay, nominal: NominalImage) -> tuple[list[Sharp], LayerPlan]:
        """The first layer through the nominal PSF, one term along track after the other."""
        rows = self.zone.row - nominal.first + np.arange(self.zone.shape[0], dtype=np.float64)
        parts = [
            Sharp(way.view.name, way.pattern, image.astype(self.dtype, copy=False), rows, 4, -nominal.first, k == 0,
                  along if k else None)  # T_0 is 1
            for k, (image, along) in enumerate(zip(nominal.maps, nominal.along, strict=True))
        ]  # fmt: skip
        between = 0.0
        if self._fractions or self.zone.row % 1.0:
            between = float(Seen(nominal.maps[0], 0.0, 0.0, 1).reading(4).max())
        error = (float(way.view.strength.max()) or 1.0) * (nominal.error + between)
        return parts, LayerPlan(way.view.name, "sharp", nominal.blur, 1, error)


def choose(
    layers: Sequence[Layer],
    maps: Real,
    zone: Zone,
    *,
    tolerance: float = 1e-6,
    tile: bool = False,
    interpolation: Interpolation = "area",
    precision: Precision = "float32",
    fractions: bool = True,
    span: Span | None = None,
) -> Choice:
    """Choose how each layer's image is made, by what it takes on the scrolls of ``span``; see ``prepare``."""
    dtype = np.dtype(precision).type
    maps = np.asarray(maps)
    _check(layers, maps, zone)
    ground = Ground(np.ascontiguousarray(maps, dtype=dtype), tile)
    span = whole(ground.height, zone) if span is None else span
    budget = tolerance * ground.scale
    blurs = [
        _Blurs.of(layer, ground, zone, span, 0.5 * budget / len(layers), precision == "float32") for layer in layers
    ]
    views = [one.view for one in blurs]
    steps = _steps(blurs, zone, 0.5 * budget)
    taken, placed = _Grids(layers, views, steps, ground, zone, span, 0.5 * budget, dtype).best()
    ground.keep({way.view.by_cells.step for way in taken.values() if way.view.by_cells is not None})
    share = 0.5 * budget / (len(layers) - len(taken))
    ways: list[SharpWay | SmoothWay] = []
    for number, (layer, view) in enumerate(zip(layers, views, strict=True)):
        if number in taken:
            ways.append(taken[number])
            continue
        count = 4 if view.how.method != "nothing" or interpolation == "cubic" else 2
        pattern: Real = np.ascontiguousarray(layer.pattern, dtype=dtype)
        turned = _turns(view) and _turning(view, ground, zone, span, dtype) > share
        ways.append(SharpWay(view, pattern, count, number == 0, turned))
    turn = None if not taken else turn_of(zone, next(iter(taken.values())).where, dtype)
    return Choice(zone, ground, dtype, ways, turn, (span, placed), fractions)


def prepare(
    layers: Sequence[Layer],
    maps: Real,
    zone: Zone,
    *,
    tolerance: float = 1e-6,
    tile: bool = False,
    interpolation: Interpolation = "area",
    precision: Precision = "float32",
    nominal: NominalImage | None = None,
    fractions: bool = True,
) -> Beams:
    """Get layers and scene ready for frames.

    layers : the nominal one first; maps (C, H, W) : the scene, relative radiance per mode, [Y, X] at the zone's
    pitch; tolerance : largest error that the choices for all ghosts together may add, relative irradiance times the
    scene's largest value; tile : along track the scene repeats; interpolation : see ``beams_on_scene``; nominal : what
    the first layer sees, on the zone's columns (None: the maps as they are); fractions : whether it is read between
    rows.

    Ghosts that look beyond the scene see its edge go on. The nominal beam may not.

    Raises InputError for a scene narrower than the swath (how many columns are missing), for shapes that do not fit,
    and values that are not finite.
    """
    return choose(
        layers, maps, zone, tolerance=tolerance, tile=tile, interpolation=interpolation, precision=precision,
        fractions=fractions,
    ).beams(nominal=nominal)  # fmt: skip


@dataclass(frozen=True)
class _Blurs:
    """A layer's blur sample by sample, and errors of blurs by cells, relative irradiance; what each takes, in units of
    time and memory, by the size of cells (1: samples)."""

    view: View
    error: dict[int, float]
    cost: dict[int, float]

    @classmethod
    def of(cls, layer: Layer, ground: Ground, zone: Zone, span: Span, allowed: float, single: bool) -> _Blurs:
        """All that can be told without an image. allowed : error of a blur sample by sample.

        Raises InputError for a kernel whose sum is not 1.
        """
        strength = np.abs(layer.pattern).max(axis=(1, 2)).astype(np.float64)
        largest = float(strength @ ground.largest) or 1.0
        if layer.view is None or not layer.view.blurs:
            affine = IDENTITY if layer.view is None else layer.view.affine
            return cls(View(layer.name, affine, strength, layer.view, blur.choose(None, 0.0, 0), None, 0.0), {}, {})
        kernel = layer.view.kernel
        total = float(kernel.sum(dtype=np.float64))
        if abs(total - 1.0) > 1e-6:
            raise InputError("frames", f"layer {layer.name}.kernel", total, "must add up to 1",
                             "divide it by its sum; power belongs to the pattern")  # fmt: skip
        how = blur.choose(kernel.astype(np.float64), allowed / largest, ground.samples, single)
        view = View(layer.name, layer.view.affine, strength, layer.view, how, None, how.error * largest)
        error, cost = {1: view.error}, {}
        for step in STEPS if not ground.tile else ():
            if FEWEST * step <= min(kernel.shape):
                error[step] = float(strength @ coarse(kernel, step).error(ground.cells(step)))
        looked = looked_at(view.affine, zone, span)
        area = float(np.prod([last - first + size for (first, last), size in zip(looked, kernel.shape, strict=True)]))
        cost = {step: area / step**2 for step in error}
        return cls(view, error, cost)


def _steps(blurs: Sequence[_Blurs], zone: Zone, budget: float) -> list[int]:
    """The size of cells for every layer: the largest ones, made smaller where that gains most error for its price,
    until what is left of the errors, together, is within CELLS of the budget."""
    steps = [max(one.error, default=1) for one in blurs]
    if min(zone.shape) < 4:
        return [1] * len(blurs)
    total = sum(one.error[step] for one, step in zip(blurs, steps, strict=True) if one.error)

    def gain(number: int) -> float:
        one, step = blurs[number], steps[number]
        finer = max((other for other in one.error if other < step), default=0)
        if not finer:
            return -np.inf
        return (one.error[step] - one.error[finer]) / (one.cost[finer] - one.cost[step])

    while total > CELLS * budget:
        number = max(range(len(blurs)), key=gain)
        if gain(number) == -np.inf:
            break
        one, step = blurs[number], steps[number]
        steps[number] = max(other for other in one.error if other < step)
        total += one.error[steps[number]] - one.error[step]
    return steps


def _turns(view: View) -> bool:
    return bool(view.affine[0, 1] or view.affine[1, 0])


def _turning(view: View, ground: Ground, zone: Zone, span: Span, dtype: type) -> float:
    part = view.seen(ground, zone, span, dtype)
    return float(view.strength.max()) * turning(view.affine, zone, part.image)


class _Grids:
    """The grids of nodes, and which layers each could take."""

    def __init__(
        self, layers: Sequence[Layer], views: Sequence[View], steps: Sequence[int], ground: Ground, zone: Zone,
        span: Span, budget: float, dtype: type,
    ) -> None:  # fmt: skip
        self.ground, self.zone, self.span, self.budget, self.dtype = ground, zone, span, budget, dtype
        self.grids = [smooth.grid(zone.shape, pitch, dtype) for pitch in sorted(smooth.PITCHES)
                      if 4 * pitch <= max(zone.shape)]  # fmt: skip
        self.turns: dict[int, Real] = {}
        self.pixels = sampled_pixels(zone.shape)
        self.found: dict[int, dict[int, tuple[SmoothWay, Placed]]] = {}
        able = [
            number for number, (layer, view) in enumerate(zip(layers, views, strict=True))
            if number and layer.view is not None and view.how.method != "nothing"
            and min(*zone.shape, *ground.maps.shape[1:]) >= 4
        ]  # fmt: skip
        envelopes = smooth.Envelopes(zone) if able and self.grids else None
        for number in able if envelopes is not None else ():
            assert envelopes is not None
            fits = [envelopes.fit(part, 0.5 * budget / len(layers) / ground.scale) for part in layers[number].pattern]
            terms = [fit for fit in fits if fit is not None]
            if len(terms) == len(fits):
                view, part = self._seen(views[number], steps[number], (1.0 - CELLS) * budget / len(able))
                self.found[number] = self._tried(layers[number], terms, envelopes, view, part)

    def best(self) -> tuple[dict[int, SmoothWay], dict[int, Placed]]:
        """As many layers as go onto one grid with their errors together within the budget: the coarsest of those that
        take as many."""
        best: tuple[int, list[int]] = 0, []
        for pitch in smooth.PITCHES:
            errors = sorted((found[pitch][1].error, number) for number, found in self.found.items() if pitch in found)
            total = np.cumsum([error for error, _ in errors])
            taken = [number for (_, number), so_far in zip(errors, total, strict=True) if so_far <= self.budget]
            if len(taken) > len(best[1]):
                best = pitch, taken
        pitch, taken = best
        chosen = {number: self.found[number][pitch] for number in taken}
        return {number: way for number, (way, _) in chosen.items()}, {
            number: one for number, (_, one) in chosen.items()
        }

    def _seen(self, view: View, step: int, allowed: float) -> tuple[View, Seen]:
        """The layer's image by cells of ``step``, or smaller ones if reading between them errs by more than allowed."""
        assert view.of is not None
        while step > 1:
            kernel = coarse(view.of.kernel, step)
            error = float(view.strength @ kernel.error(self.ground.cells(step)))
            by_cells = replace(view, by_cells=kernel, error=error)
            part = by_cells.seen(self.ground, self.zone, self.span, self.dtype)
            if float(view.strength @ part.reading(4)) <= allowed:
                return by_cells, part
            step //= 2
        return view, view.seen(self.ground, self.zone, self.span, self.dtype)

    def _tried(
        self, layer: Layer, terms: Sequence[tuple[tuple[int, int], Array]], envelopes: smooth.Envelopes, view: View,
        part: Seen,
    ) -> dict[int, tuple[SmoothWay, Placed]]:  # fmt: skip
        """The layer on every grid on which its error is within the budget, finest first."""
        found: dict[int, tuple[SmoothWay, Placed]] = {}
        dark = list(self.zone.dark)
        uniform = layer.pattern.sum(axis=0)
        samples = Samples.of(layer.pattern, self.pixels)
        expected = truth(view, part, samples, self.zone, self.span, self.ground)
        for where in self.grids:
            if where.pitch not in self.turns:
                self.turns[where.pitch] = turn_of(self.zone, where, self.dtype)
            turn = self.turns[where.pitch]
            envelope: Real = np.array(
                [envelopes.on_nodes(*fit, where, one[dark]) for fit, one in zip(terms, layer.pattern, strict=True)],
                dtype=self.dtype,
            )
            least = 1e-4 * self.budget / len(envelope)
            if np.abs(envelope[:, 1:]).sum(axis=1, initial=0.0).max() * self.ground.scale < least:
                envelope = envelope[:, :1].copy()
            flat = flatness(envelope, uniform, self.zone, where, turn, self.dtype)
            way = SmoothWay(view, where, envelope, flat, samples)
            placed = way.placed(part, self.ground, self.zone, turn, expected, self.dtype)
            if placed.error > self.budget:
                break
            found[where.pitch] = way, placed
        return found


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
    left = int(np.ceil(max(-zone.column, 0.0) - WHOLE))
    right = int(np.ceil(max(zone.column + zone.shape[1] - maps.shape[2], 0.0) - WHOLE))
    if left + right:
        refuse("scene", f"{maps.shape[2]} columns", f"is smaller than the swath: {left + right} columns are missing",
               "give a wider scene, or tile it across track")  # fmt: skip
