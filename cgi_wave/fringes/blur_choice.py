"""How each layer's blur is done: sample by sample, or by cells of the scene as large as all errors together allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cgi_wave.errors import InputError
from cgi_wave.fringes import blur
from cgi_wave.fringes.cells import STEPS, coarse
from cgi_wave.fringes.imaging import Ground, Span, looked_at
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.pattern import Layer
from cgi_wave.fringes.ways import IDENTITY, View

#: Part of what blurs may err by that cells may; the rest is for reading between their middles. Cells across a kernel.
CELLS, FEWEST = 0.8, 4


@dataclass(frozen=True)
class Blurs:
    """A layer's blur sample by sample, and errors of blurs by cells, relative irradiance; what each takes, in units of
    time and memory, by the size of cells (1: samples)."""

    view: View
    error: dict[int, float]
    cost: dict[int, float]

    @classmethod
    def of(cls, layer: Layer, ground: Ground, zone: Zone, span: Span, allowed: float, single: bool) -> Blurs:
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


def steps_of(blurs: Sequence[Blurs], zone: Zone, budget: float) -> list[int]:
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
