"""Layers made ready for frames over a scene: how each layer's image is made, and what that choice adds to the error.

``choose`` looks at a part of a scroll and decides; ``Choice.beams`` makes what frames of any part take. ``prepare`` is
both at once, for all of a scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.fringes.beams_on_scene import WHOLE, Beams, LayerPlan, Sharp, Warped
from cgi_wave.fringes.blur_choice import Blurs, steps_of
from cgi_wave.fringes.grid_choice import Grids
from cgi_wave.fringes.imaging import Ground, Seen, Span, turning, whole
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.nominal_image import NominalImage
from cgi_wave.fringes.pattern import Layer
from cgi_wave.fringes.ways import (
    Placed,
    SharpWay,
    SmoothWay,
    View,
    gathered,
    turn_of,
)

Array = NDArray[np.float64]
Real = NDArray[np.floating]
Interpolation = Literal["area", "cubic"]
Precision = Literal["float32", "float64"]


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
                if isinstance(part, Sharp):
                    sharp.append(part)
                else:
                    warped.append(part)
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
        Blurs.of(layer, ground, zone, span, 0.5 * budget / len(layers), precision == "float32") for layer in layers
    ]
    views = [one.view for one in blurs]
    steps = steps_of(blurs, zone, 0.5 * budget)
    taken, placed = Grids(layers, views, steps, ground, zone, span, 0.5 * budget, dtype).best()
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


def _turns(view: View) -> bool:
    return bool(view.affine[0, 1] or view.affine[1, 0])


def _turning(view: View, ground: Ground, zone: Zone, span: Span, dtype: type) -> float:
    part = view.seen(ground, zone, span, dtype)
    return float(view.strength.max()) * turning(view.affine, zone, part.image)


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
