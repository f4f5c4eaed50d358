"""A wide blur on cells of the scene: means over step × step samples, and a kernel that is the same within each.

For a kernel k, its mean k̄ over each cell of offsets, and a map m with the mean m̄ over each cell of samples,

    Σ_d k[d] m[p + d] = Σ_cells step² k̄ m̄ + Σ_d (k − k̄)[d] (m − m̄)[p + d]        (p in the middle of a cell)

and by Cauchy and Schwarz the second sum is at most ‖k − k̄‖ times the root of the largest Σ(m − m̄)² in a window of the
kernel's size. That is a bound; the more samples a blur covers the smaller it is, since neither the grain of a kernel
drawn by rays nor that of the scene adds up. The image between the middles of cells is read by cubics.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes import blur

Array = NDArray[np.float64]
Real = NDArray[np.floating]
#: Samples along the side of a cell, tried in this order.
STEPS = (16, 8, 4, 2)
EPSILON = 6e-8  # of the cells' means
BLOCK = 1 << 16  # numbers of a kernel that are squared at a time


@dataclass(frozen=True)
class Cells:
    """A scene (C, H, W) by cells, those beyond its edges, where the edge goes on, in a ring one cell wide.

    means, unrest (C, I + 2, J + 2), single : Σ(m − m̄)² is the second of them
    """

    step: int
    means: Real
    unrest: Real


def cells(maps: Real, step: int) -> Cells:
    """The cells of a scene, from its first sample on."""
    rows, columns = maps.shape[1:]
    after = [step + -n % step for n in (rows, columns)]
    along = np.clip(np.arange(-step, rows + after[0]), 0, rows - 1)
    across = np.clip(np.arange(-step, columns + after[1]), 0, columns - 1)
    shape = (len(maps), len(along) // step, len(across) // step)
    means, unrest = np.empty(shape, np.float32), np.empty(shape, np.float32)
    for number in range(shape[1]):  # one row of cells after the other: the scene is not copied
        band = maps[:, along[number * step : (number + 1) * step]][..., across].astype(np.float64)
        split = band.reshape(len(maps), step, shape[2], step)
        mean = split.mean(axis=(1, 3))
        means[:, number], unrest[:, number] = mean, ((split - mean[:, None, :, None]) ** 2).sum(axis=(1, 3))
    return Cells(step, means, unrest)


@dataclass(frozen=True)
class Coarse:
    """A kernel by cells of offsets. weights (h, w) : sums over them, both sizes odd; grain : ‖k − k̄‖; size : of k."""

    step: int
    weights: Array
    grain: float
    size: tuple[int, int]

    @cached_property
    def how(self) -> blur.Blur:
        """The convolution, exact but for rounding."""
        return blur.choose(self.weights, 0.0, self.weights.size)

    def error(self, scene: Cells) -> Array:
        """(C,) bound of |image − truth| in the middles of cells, in units of each mode's map; rounding included."""
        from scipy.ndimage import uniform_filter

        window = [n // self.step + 2 for n in self.size]
        most = [
            float(uniform_filter(one, window, mode="nearest").max()) * window[0] * window[1] for one in scene.unrest
        ]
        rounding = EPSILON * np.abs(scene.means).max(axis=(1, 2))
        return np.asarray(self.grain * np.sqrt(np.maximum(most, 0.0)) + rounding)

    def image(self, scene: Cells, rows: tuple[int, int], columns: tuple[int, int]) -> Array:
        """(C, I, J) the blurred scene in the middles of cells rows[0] … rows[1] − 1 and likewise across.

        The middle of cell I is sample I·step + step // 2.
        """
        rows, columns = (rows[0] + 1, rows[1] + 1), (columns[0] + 1, columns[1] + 1)  # beyond the ring
        return np.asarray(blur.part(scene.means, self.how, self.weights, False, rows, columns, np.float64))


def coarse(kernel: Real, step: int) -> Coarse:
    """A kernel (h, w), sizes odd, by cells whose first one about the middle holds offsets −(step // 2) … and so on."""
    sums: Real = kernel
    for axis in (0, 1):
        half = sums.shape[axis] // 2
        low, high = ((at + step // 2) // step for at in (-half, half))
        reach = max(-low, high)
        starts = np.arange(low, high + 1) * step - step // 2 + half
        starts[0] = 0
        sums = np.add.reduceat(sums, starts, axis=axis, dtype=np.float64)
        ends = [(0, 0), (0, 0)]
        ends[axis] = (reach + low, reach - high)
        sums = np.pad(sums, ends)
    grain = np.sqrt(max(_square(kernel) - float((sums**2).sum()) / step**2, 0.0))
    return Coarse(step, np.asarray(sums, np.float64), float(grain), (kernel.shape[0], kernel.shape[1]))


def _square(kernel: Real) -> float:
    """Σk², in double numbers without a copy of all."""
    flat = kernel.ravel()
    parts = (flat[start : start + BLOCK].astype(np.float64) for start in range(0, len(flat), BLOCK))
    return sum(float(part @ part) for part in parts)
