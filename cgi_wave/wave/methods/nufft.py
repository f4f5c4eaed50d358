"""Non-uniform FFT from boundary-fitted nodes: no sampled edge, so that errors are those of quadrature.

Needs finufft, the extra ``nufft``; it is imported when first used.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import MethodLimitError, MissingPackageError
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods import nodes as rules
from cgi_wave.wave.methods.nodes import Nodes
from cgi_wave.wave.methods.patch import SIDE_CAP, Amplitude, Patch, choose_patch, overlap_sum, patch_noise
from cgi_wave.wave.methods.planned import Plan, Planned
from cgi_wave.wave.methods.shape import TURN, Beam, Pair, beam_at
from cgi_wave.wave.region import SAFETY

NAME = "NUFFT from boundary-fitted nodes"
LEVEL = 1  # of the panels: 3.3 cycles in 16 points leave some 1e-11
_SMALL = 40_000  # nodes, in the order of rings or rays, that finufft spreads fastest without sorting them
_NODES = 1e-11  # asked of rings whose PSF is summed: their error counts at every point, and another digit costs little
_FINEST = 1e-13  # smallest precision that finufft is asked for


def _finufft() -> Any:
    try:
        import finufft
    except ImportError as absent:
        raise MissingPackageError("finufft", "nufft") from absent
    return finufft


@dataclass(frozen=True)
class _Transform:
    """A type-1 plan of one size and precision, and the lock that goes with it: a plan keeps its points."""

    plan: Any
    lock: threading.Lock


@lru_cache(maxsize=8)
def _plan(count: tuple[int, int], digits: int, ordered: bool) -> _Transform:
    # Loose precisions do with a fine grid of 1.25 times the modes, which is a third of the FFT's work.
    options = {"nthreads": 1, "upsampfac": 1.25 if digits < 9 else 2.0, "spread_sort": 0 if ordered else 2}
    plan = _finufft().Plan(1, count, eps=10.0**-digits, isign=1, dtype="complex128", **options)
    return _Transform(plan, threading.Lock())


def transform(nodes: Nodes, sigma: float, patch: Patch, eps: float) -> tuple[NDArray[np.complex128], float]:
    """h (X, Y) on a patch and the bound of finufft's own error, eps · σ Σ|c|; eps is rounded down to a power of ten.

    Raises MissingPackageError without finufft, MethodLimitError when the points are too far apart for the nodes.
    """
    # Column by column: a reduction over rows of two numbers would take as long as the spreading.
    columns = [np.ascontiguousarray(nodes.u[:, a]) for a in (0, 1)]
    lo, hi = (np.array([f(c) for c in columns]) for f in (np.min, np.max))
    middle = np.where(np.abs(lo + hi) < 1e-9 * (hi - lo), 0.0, 0.5 * (lo + hi))
    step = TURN * sigma * np.array(patch.pitch)
    at = [(columns[a] - middle[a]) * step[a] for a in (0, 1)]
    coarse = float(np.max(0.5 * (hi - lo) * step)) / np.pi
    if coarse > 1.0:
        raise MethodLimitError(
            NAME, "points too far apart for the cone", coarse, f"resample with a pitch {coarse:.3g} times smaller"
        )
    digits = math.ceil(-math.log10(max(eps, _FINEST)) - 1e-9)
    # Modes run from −count//2; the patch may start elsewhere.
    shift = np.array([patch.start[a] + patch.count[a] // 2 for a in (0, 1)], float)
    strength = nodes.strength
    if shift.any():
        strength = strength * np.exp(1j * (at[0] * shift[0] + at[1] * shift[1]))
    made = _plan(patch.count, digits, len(nodes.u) < _SMALL)
    with made.lock:
        made.plan.setpts(at[0], at[1])
        field: NDArray[np.complex128] = made.plan.execute(np.ascontiguousarray(strength))
    field *= sigma
    if middle.any():
        turns = [np.exp(2j * np.pi * sigma * middle[a] * patch.axis(a)) for a in (0, 1)]
        field *= turns[0][:, None] * turns[1][None, :]
    return field, 10.0**-digits * sigma * float(np.abs(nodes.strength).sum())


def nodes_for(beam: Beam, patch: Patch, eps: float) -> tuple[Nodes, float]:
    """Nodes for one beam and a patch, and what they leave of |h|: the change to finer nodes at nine points, twice.

    Rings on a disc or annulus, else panels. Raises MethodLimitError beyond the node cap.
    """
    x, y = patch.axis(0), patch.axis(1)
    reach = rules.farthest(x, y)
    disc = rules.as_disc(beam)
    rings = rules.polar_nodes(beam, disc, reach, eps) if disc is not None else None
    if disc is None or rings is None:
        made = rules.panel_nodes(beam, reach, LEVEL)
        finer: Nodes | None = rules.panel_nodes(beam, reach, LEVEL + 1)
    else:
        made = rings
        if rules.is_flat(beam):
            # The order of the rings follows from Bessel functions alone: what they leave is below eps of the whole.
            return made, eps * beam.sigma * float(np.abs(made.strength).sum())
        finer = rules.polar_nodes(beam, disc, 1.2 * reach, eps)
        finer = rules.panel_nodes(beam, reach, LEVEL) if finer is None else finer
    assert finer is not None
    return made, SAFETY * rules.difference(made, finer, beam.sigma, x, y)


def amplitude(field: PupilField, patch: Patch, sigma: float, eps: float = 1e-9) -> Amplitude:
    """Complex PSF of a field on a patch by NUFFT, to eps of σ∫A d²u (the peak of the field without aberration).

    ``error`` bounds the numerical error of h; the misfit of the pupil field comes on top.

    Raises MissingPackageError without finufft, MethodLimitError for points too far apart (by what factor) and beyond
    the node cap.
    """
    return _amplitude(beam_at(field, sigma), patch, eps, True)


def _amplitude(beam: Beam, patch: Patch, eps: float, constant: bool) -> Amplitude:
    """``constant``: a PSF to be looked at, with the beam's constant and finufft's error at any one point in ``error``.

    Without, for a sum over the patch: finufft's eps is the relative error of such sums.
    """
    nodes, error = nodes_for(beam, patch, eps if constant else _NODES)
    h, own = transform(nodes, beam.sigma, patch, eps)
    if constant:
        error += own
        if beam.constant != 1.0:
            h *= beam.constant
    return Amplitude(patch.axis(0), patch.axis(1), h, beam.sigma, NAME, len(nodes.u), error)


class Nufft(Planned):
    """Overlap as a sum on a patch, its PSFs by NUFFT: only what the patch leaves out is lost."""

    name = NAME

    def __init__(self, points: int = SIDE_CAP) -> None:
        self.points = points

    def supports(self, m: PupilField, l: PupilField, sigma: float) -> str | None:  # noqa: E741
        """None, or the limit that is met; without finufft, the extra that brings it."""
        try:
            _finufft()
        except MissingPackageError as absent:
            return str(absent)
        return super().supports(m, l, sigma)

    def plan(self, pair: Pair, tol: float) -> Plan:
        """The patch that ``tol`` asks for. Raises MethodLimitError."""
        fixed = pair.misfit + pair.rounding
        patch, left = choose_patch(pair, 0.9 * max(tol - fixed, 1e-300), self.name, self.points)
        nodes = 0
        for b in (pair.m, pair.l):
            reach = rules.farthest(patch.axis(0), patch.axis(1))
            disc = rules.as_disc(b)
            rings = rules.count_polar(b, disc, reach) if disc is not None else None
            nodes += rules.estimate_nodes(b, reach, LEVEL) if rings is None else rings
        eps = 0.01 * tol
        width = math.ceil(-math.log10(eps)) + 1.0
        grid = 4.0 * patch.count[0] * patch.count[1]
        return Plan(left + 0.05 * tol + fixed, nodes * width**2 + 2.0 * grid * math.log2(grid), (patch, eps))

    def carry_out(self, pair: Pair, plan: Plan) -> tuple[complex, float, int]:
        """The sum on the patch, its bound from the light that the patch is found to miss and from the nodes."""
        patch, eps = plan.sampling
        m, l = (_amplitude(b, patch, eps, False) for b in (pair.m, pair.l))  # noqa: E741
        value, left = overlap_sum(pair, m, l, patch)
        noise = patch_noise(m, patch, pair.m.power) + patch_noise(l, patch, pair.l.power) + 4.0 * eps
        return value, left + noise + pair.misfit + pair.rounding, m.nodes + l.nodes
