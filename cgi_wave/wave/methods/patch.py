"""Complex PSFs on a patch of the detector, and the overlap as a sum over its points.

With points closer than 1/(σD), D the width of what holds both pupils, Σ h_m h_l* dx² over the whole plane is ∫ h_m h_l*
d²x exactly (their product has no frequency beyond D). What lies outside the patch is bounded by Cauchy and Schwarz:
√(E_m E_l), with E the share of each beam's light that its own sum on the patch misses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import MethodLimitError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.methods.shape import Pair, scattered

SIDE_CAP = 4096  # points along one side of a patch
SAMPLING = 0.98  # spacing of the points, of the coarsest that holds all frequencies


@dataclass(frozen=True)
class Patch:
    """Points start + pitch · (0 … count − 1) along each axis, m in direction space (conjugate to u)."""

    start: tuple[int, int]
    count: tuple[int, int]
    pitch: tuple[float, float]

    def axis(self, a: int) -> Array:
        """(count[a],) coordinates along axis a."""
        return np.asarray((np.arange(self.count[a]) + self.start[a]) * self.pitch[a], np.float64)

    @property
    def half(self) -> Array:
        """(2,) half-sides, the cells of the outermost points included."""
        return 0.5 * np.array(self.count) * np.array(self.pitch)

    @property
    def centre(self) -> Array:
        """(2,) middle."""
        return (np.array(self.start) + 0.5 * (np.array(self.count) - 1)) * np.array(self.pitch)

    @property
    def farthest(self) -> Array:
        """(2,) largest |coordinate| along each axis."""
        return np.array([np.abs(self.axis(a)[[0, -1]]).max() for a in (0, 1)])


@dataclass(frozen=True)
class Amplitude:
    """Complex PSF on the points x (X,), y (Y,): field (X, Y) with |field|² power per unit area (m² on the detector).

    method : its name; nodes : samples or quadrature nodes summed; error : bound on |field|, absolute, nan if none
    """

    x: Array
    y: Array
    field: NDArray[np.complex128]
    sigma: float
    method: str
    nodes: int
    error: float


def nyquist(pair: Pair) -> tuple[float, float]:
    """Coarsest spacing of points along each axis that holds all frequencies of both PSFs, 1/(σD)."""
    lo, hi = pair.box
    pitch = 1.0 / (pair.m.sigma * (hi - lo))
    return float(pitch[0]), float(pitch[1])


def lost(pair: Pair, patch: Patch) -> float:
    """Estimate beforehand of what a patch leaves out of γ, √(E_m E_l), from the light that edges scatter."""
    e = [scattered(b, edge, patch.centre, patch.half) for b, edge in zip((pair.m, pair.l), pair.own, strict=True)]
    return math.sqrt(e[0] * e[1])


def choose_patch(pair: Pair, tol: float, method: str, cap: int = SIDE_CAP) -> tuple[Patch, float]:
    """The smallest patch that is estimated to leave out at most ``tol`` of γ, and the estimate.

    Its middle is where the beam with the smaller spot lands. The light outside falls as 1/side only: a tenth of the
    error takes ten times the side. Raises MethodLimitError beyond ``cap`` points along a side.
    """
    pitch = tuple(SAMPLING * p for p in nyquist(pair))
    spots = [-b.slope_at(np.concatenate([e.u, e.inside])) for b, e in zip((pair.m, pair.l), pair.own, strict=True)]
    size = [np.ptp(s, axis=0).max() for s in spots]
    small = spots[int(np.argmin(size))]
    middle = 0.5 * (small.min(axis=0) + small.max(axis=0)) / np.array(pitch)
    side = 32
    best = math.inf
    while side <= cap:
        start = [round(float(c)) - side // 2 for c in middle]
        patch = Patch((start[0], start[1]), (side, side), (pitch[0], pitch[1]))
        left = lost(pair, patch)
        best = min(best, left)
        if left <= tol:
            return patch, left
        side = 2 * math.ceil(0.5 * side * min(2.0, max(1.06, left / tol)))
    raise MethodLimitError(
        method,
        f"a patch of {cap} points a side leaves out {best:.2g} of the overlap, more than {tol:.2g}",
        best / tol,
        f"ask for a tolerance of {best:.1g} or more, or sum over the pupil (cgi_wave.wave.overlap)",
    )


def overlap_sum(pair: Pair, m: Amplitude, l: Amplitude, patch: Patch) -> tuple[complex, float]:  # noqa: E741
    """γ from the sum on a patch, and √(E_m E_l) of what the two sums of |h|² miss of the powers.

    The two fields lack the beams' constants, which come back here.
    """
    cell = patch.pitch[0] * patch.pitch[1]
    value = complex(np.vdot(l.field, m.field)) * cell / pair.norm * pair.constant
    missed = [
        max(1.0 - float(np.vdot(h.field, h.field).real) * cell / b.power, 1e-15) for h, b in ((m, pair.m), (l, pair.l))
    ]
    return value, math.sqrt(missed[0] * missed[1])


def patch_noise(h: Amplitude, patch: Patch, power: float) -> float:
    """Norm on the patch of an error of ``h.error`` everywhere, over √power: what it can change of γ."""
    return h.error * math.sqrt(patch.count[0] * patch.count[1] * patch.pitch[0] * patch.pitch[1] / power)
