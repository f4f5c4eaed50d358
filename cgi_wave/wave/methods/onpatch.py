"""Overlap on a patch from gray pupil samples: what pruned FFT, matrix transform and chirp-z share.

The errors are three. The patch leaves out √(E_m E_l). The gray edge at pitch p damps the light that an edge scatters
to a distance d by sinc(d σ p), so that of what the patch holds a part (π·half·σp)²/3 of what it leaves out is lost. And
where a wavefront is steep at an edge, the edge law of ``grid.edge_error`` holds for the pair's phase difference.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from cgi_wave.errors import MethodLimitError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.methods.grid import Grid, covering, edge_error, shares, steepest_step
from cgi_wave.wave.methods.patch import SIDE_CAP, Amplitude, Patch, choose_patch, overlap_sum
from cgi_wave.wave.methods.planned import Plan, Planned
from cgi_wave.wave.methods.shape import TURN, Beam, Pair

CELL_CAP = 8192  # cells along one side of a sampled pupil
_STEEPEST = 0.95  # turns of phase per cell, the patch's own included: beyond 1 a replica reaches the patch


@dataclass(frozen=True)
class _Sampling:
    """Cells of the pupil, points of the detector, and what the edges cost at that pitch (damping apart)."""

    pitch: tuple[float, float]
    patch: Patch
    edges: float
    damping: float


class SampledPatch(Planned):
    """Overlap on a patch from gray samples; sub-classes transform."""

    def __init__(self, cells: int = CELL_CAP, points: int = SIDE_CAP) -> None:
        self.cells, self.points = cells, points

    @abstractmethod
    def amplitude(self, beam: Beam, grid: Grid, share: Array, patch: Patch) -> Amplitude:
        """h on the patch, without the beam's constant."""

    @abstractmethod
    def steps(self, count: tuple[int, int], patch: Patch, pitch: tuple[float, float], sigma: float) -> float:
        """Elementary steps for two transforms of ``count`` cells."""

    def pitch_for(self, pair: Pair, patch: Patch, coarsest: Array) -> tuple[float, float]:
        """A pitch (unit of u) at or below ``coarsest`` (2,) that the transform can use."""
        return float(coarsest[0]), float(coarsest[1])

    def plan(self, pair: Pair, tol: float) -> Plan:
        """Half of the tolerance for the patch, the rest for the edges. Raises MethodLimitError."""
        fixed = pair.misfit + pair.rounding
        patch, left = choose_patch(pair, 0.5 * max(tol - fixed, 1e-300), self.name, self.points)
        coarsest = np.minimum(self._alias_free(pair, patch), np.ptp(np.array(pair.box), axis=0) / 8.0)
        while True:
            pitch = self.pitch_for(pair, patch, coarsest)
            lo, hi = pair.box
            count = [math.ceil(v) + 3 for v in (hi - lo) / pitch]
            if max(count) > self.cells:
                raise MethodLimitError(
                    self.name,
                    f"{max(count)} samples across the pupils (limit {self.cells}) for {patch.count[0]} points a side "
                    f"and a tolerance of {tol:.2g}",
                    max(count) / self.cells,
                    "ask for a larger tolerance, or sum over the pupil (cgi_wave.wave.overlap)",
                )
            damping = _damping(pair, patch, pitch)
            edges = edge_error(pair.m, pair.l, pair.common, pitch) / pair.norm
            bound = left * (1.0 + damping) + edges + fixed
            if bound <= tol:
                steps = self.steps((count[0], count[1]), patch, pitch, pair.m.sigma)
                return Plan(bound, steps, _Sampling(pitch, patch, edges, damping))
            coarsest = np.array(pitch) * max(0.5, min(0.95, math.sqrt(0.5 * tol / (left * damping + edges))))

    def carry_out(self, pair: Pair, plan: Plan) -> tuple[complex, float, int]:
        """The sum on the patch, its bound from the light that the patch is found to miss."""
        s: _Sampling = plan.sampling
        value, left, nodes = overlap_on_patch(self, pair, s.pitch, s.patch)
        # What the gray edges damp is missing from the sums of |h|² too, and so is in ``left``, all but products of it.
        return value, left * (1.0 + 0.25 * s.damping) + s.edges + pair.misfit + pair.rounding, nodes

    def _alias_free(self, pair: Pair, patch: Patch) -> Array:
        """(2,) coarsest pitch at which no replica of either spot reaches the patch."""
        turns = [
            steepest_step(b, None, edge, (1.0, 1.0)) / TURN for b, edge in zip((pair.m, pair.l), pair.own, strict=True)
        ]
        return np.asarray(_STEEPEST / (np.max(turns, axis=0) + pair.m.sigma * patch.farthest))


def _damping(pair: Pair, patch: Patch, pitch: tuple[float, float]) -> float:
    """Part of the light left out by which the gray edge weakens what the patch holds."""
    return float(np.max((np.pi * pair.m.sigma * 2.0 * patch.half * np.array(pitch)) ** 2)) / 3.0


def overlap_on_patch(
    method: SampledPatch, pair: Pair, pitch: tuple[float, float], patch: Patch
) -> tuple[complex, float, int]:
    """γ on a patch, the √(E_m E_l) that it misses, and the cells summed. No guard on the sampling."""
    grids = [covering(edge.u.min(axis=0), edge.u.max(axis=0), pitch) for edge in pair.own]
    h = [
        method.amplitude(b, grid, shares([b.support], grid), patch)
        for b, grid in zip((pair.m, pair.l), grids, strict=True)
    ]
    value, left = overlap_sum(pair, h[0], h[1], patch)
    return value, left, h[0].nodes + h[1].nodes
