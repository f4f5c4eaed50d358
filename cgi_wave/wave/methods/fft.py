"""Fourier transforms of the sampled pupil: over the whole window, and pruned to a patch of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import MethodLimitError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.methods.grid import Grid, covering, edge_error, sampled, shares, steepest_step
from cgi_wave.wave.methods.onpatch import SampledPatch
from cgi_wave.wave.methods.patch import Amplitude, Patch
from cgi_wave.wave.methods.planned import Plan, Planned
from cgi_wave.wave.methods.plans import fast_length, transform_rows
from cgi_wave.wave.methods.shape import TURN, Beam, Edge, Pair

WINDOW_CAP = 4096  # samples along one side of a transform that keeps its whole window
#: Phase (turns) that one cell may hold at most. At 1 a replica of the geometric spot arrives and the edge law ends.
STEEPEST = 0.95


def transform(
    samples: NDArray[np.complex128], sigma: float, grid: Grid, patch: Patch, size: tuple[int, int]
) -> NDArray[np.complex128]:
    """h (X, Y) on a patch by pruned row–column FFT of samples on a grid: σ Σ samples · exp(i 2πσ u·x) · cell.

    ``size`` samples make a period: patch.pitch · grid.pitch = 1/(σ·size) along each axis, or ValueError.
    """
    for a in (0, 1):
        if abs(sigma * patch.pitch[a] * grid.pitch[a] * size[a] - 1.0) > 1e-9:
            raise ValueError("pitch on the detector times pitch in the pupil is not 1/(σ·size)")
    samples = _folded(_folded(samples, size[0]).T, size[1]).T
    half = transform_rows(samples, grid.first[1], size[1], patch.start[1], patch.count[1])
    field = transform_rows(half, grid.first[0], size[0], patch.start[0], patch.count[0])
    field *= sigma * grid.cell
    return field


def _folded(samples: NDArray[np.complex128], size: int) -> NDArray[np.complex128]:
    """Rows beyond a period added to those that they equal on the detector's points.

    A spare cell or two; more where the points are further apart than all frequencies ask for.
    """
    if len(samples) <= size:
        return samples
    out = samples[:size].copy()
    for start in range(size, len(samples), size):
        part = samples[start : start + size]
        out[: len(part)] += part
    return out


@dataclass(frozen=True)
class _Window:
    """``size`` cells of ``pitch`` along each axis cover both pupils, and as many points the detector."""

    pitch: tuple[float, float]
    size: int


class WindowFft(Planned):
    """Overlap by FFT over the whole window: Σ h_m h_l* over one period of the transform.

    A period of the discrete transform holds all light: what the edges scatter beyond it comes back on the other side,
    so that the sum equals that over the pupil's samples (Parseval). With two gray edges an edge cell would count as
    share², and the light lost, 2/(3N) for a disc, would be what lies beyond the window. So the edge of the common
    support is put on m alone; l is cut at whole cells outside it, where m has no light. The error is then that of
    the gray edge, 4π/3 · W020/N² for defocus; below N = 4·W020 samples a replica of the spot arrives.
    """

    name = "whole-window FFT"

    def __init__(self, cap: int = WINDOW_CAP) -> None:
        self.cap = cap

    def plan(self, pair: Pair, tol: float) -> Plan:
        """The fewest samples whose bound by the edge law is at most ``tol``. Raises MethodLimitError."""
        lo, hi = pair.box
        steps = steepest_step(pair.m, pair.l, pair.common, (1.0, 1.0)) * (hi - lo)
        least = max(16, math.ceil(float(steps.max()) / (TURN * STEEPEST)))
        if least > self.cap:
            raise MethodLimitError(
                self.name,
                f"the difference of the two wavefronts takes {least} samples across the pupils (limit {self.cap})",
                least / self.cap,
                f"resample {least / self.cap:.3g} times finer, or use boundary-fitted quadrature",
            )
        size = fast_length(least)
        fixed = pair.misfit + pair.rounding
        while True:
            pitch = (hi - lo) / (size - 2)  # two cells to spare
            window = _Window((float(pitch[0]), float(pitch[1])), size)
            bound = edge_error(pair.m, pair.l, pair.common, window.pitch) / pair.norm + fixed
            if bound <= tol:
                return Plan(bound, 4.0 * size**2 * math.log2(size), window)
            if size >= self.cap or fixed >= tol:
                factor = math.sqrt(bound / tol) if fixed < tol else bound / tol
                raise MethodLimitError(
                    self.name,
                    f"{size} samples across the pupils bound the error by {bound:.2g}, more than {tol:.2g}",
                    factor,
                    f"ask for a tolerance of {bound:.1g} or more, or use boundary-fitted quadrature",
                )
            grown = size * min(2.0, max(1.05, math.sqrt((bound - fixed) / (tol - fixed))))
            size = min(fast_length(math.ceil(grown)), self.cap)

    def carry_out(self, pair: Pair, plan: Plan) -> tuple[complex, float, int]:
        """The sum over the window."""
        window: _Window = plan.sampling
        return overlap_on_window(pair, window.pitch, window.size), plan.bound, window.size**2


def overlap_on_window(pair: Pair, pitch: tuple[float, float], size: int) -> complex:
    """γ by Σ h_m h_l* over a whole window of size × size points. No guard: the caller knows what the sampling holds."""
    lo, hi = pair.box
    grid = covering(lo, hi, pitch)
    grid = Grid(pitch, grid.first, (min(grid.count[0], size), min(grid.count[1], size)))
    share = shares([pair.m.support, pair.l.support], grid)
    detector = tuple(1.0 / (pair.m.sigma * size * p) for p in pitch)
    patch = Patch((-(size // 2), -(size // 2)), (size, size), (detector[0], detector[1]))
    h_m, h_l = (
        transform(sampled(beam, grid, weight), beam.sigma, grid, patch, (size, size))
        for beam, weight in ((pair.m, share), (pair.l, (share > 0.0).astype(float)))
    )
    return complex(np.vdot(h_l, h_m)) * detector[0] * detector[1] / pair.norm * pair.constant


class PrunedFft(SampledPatch):
    """Overlap as a sum on a patch, its PSFs by pruned row–column FFT of the gray pupils."""

    name = "pruned FFT"

    def pitch_for(self, pair: Pair, patch: Patch, coarsest: Array) -> tuple[float, float]:
        """The transform's length ties the two pitches together: the next fast length."""
        sizes = self._sizes(pair, patch, coarsest)
        pitch = [1.0 / (pair.m.sigma * patch.pitch[a] * sizes[a]) for a in (0, 1)]
        return pitch[0], pitch[1]

    def steps(self, count: tuple[int, int], patch: Patch, pitch: tuple[float, float], sigma: float) -> float:
        """Rows of the pupil and columns of the patch, each a transform of the full length."""
        size = [1.0 / (sigma * patch.pitch[a] * pitch[a]) for a in (0, 1)]
        return 2.0 * (
            count[0] * size[1] * math.log2(size[1] + 2.0) + patch.count[1] * size[0] * math.log2(size[0] + 2.0)
        )

    def amplitude(self, beam: Beam, grid: Grid, share: Array, patch: Patch) -> Amplitude:
        """h on the patch."""
        size = [round(1.0 / (beam.sigma * patch.pitch[a] * grid.pitch[a])) for a in (0, 1)]
        samples = sampled(beam, grid, share)
        h = transform(samples, beam.sigma, grid, patch, (size[0], size[1]))
        return Amplitude(patch.axis(0), patch.axis(1), h, beam.sigma, self.name, samples.size, math.nan)

    def _sizes(self, pair: Pair, patch: Patch, coarsest: Array) -> list[int]:
        return [
            fast_length(max(math.ceil(1.0 / (pair.m.sigma * patch.pitch[a] * coarsest[a])), patch.count[a]))
            for a in (0, 1)
        ]


def edge_noise(beam: Beam, edge: Edge, grid: Grid, patch: Patch) -> float:
    """Bound of |error of h| anywhere on a patch from the gray edge, same unit as h; inf where a replica arrives."""
    reach = steepest_step(beam, None, edge, grid.pitch) / TURN
    reach = reach + beam.sigma * patch.farthest * np.array(grid.pitch)
    if np.any(reach >= 1.0):
        return math.inf
    return beam.sigma * edge_error(beam, None, edge, grid.pitch, patch.farthest)
