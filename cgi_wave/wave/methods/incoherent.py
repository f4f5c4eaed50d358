"""Incoherent overlap ∫√(I_m I_l) with diffraction, I = |h|²: an upper bound of |γ| that keeps no phase.

Against a perfect beam it falls as 0.57/√W020, where |γ| falls as 1/(πW020).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import MethodLimitError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods.base import Estimate
from cgi_wave.wave.methods.fft import PrunedFft
from cgi_wave.wave.methods.geometric import SpotOverlap
from cgi_wave.wave.methods.grid import covering, shares, steepest_step
from cgi_wave.wave.methods.patch import Patch, choose_patch
from cgi_wave.wave.methods.shape import TURN, Beam, Edge, Pair, beam_at, check_pair, edge_of

NAME = "incoherent overlap, pruned FFT"
SIDE_CAP = 2048  # points along one side of a patch, before they are doubled
CELL_CAP = 8192  # samples across a pupil
_FFT = PrunedFft()


def incoherent_overlap(m: PupilField, l: PupilField, sigma: float, tol: float = 1e-2) -> SpotOverlap:  # noqa: E741
    """∫|h_m||h_l| d²x / √(P_m P_l) at sigma, 1/m, as a sum over a patch with twice the points that h needs.

    ``error`` adds what the patch leaves out (√(E_m E_l), by Cauchy and Schwarz), the change from half the points (|h|
    has kinks where h has zeros) and the change from pupil samples 1.5 times wider. Asked to be below ``tol``, which
    is reached by finer pupils; the patch and its points are as ``tol`` asks for beforehand.

    Raises MethodLimitError beyond the caps, naming the factor, InputError for fields that do not go together.
    """
    started = time.perf_counter()
    plan = _choose(m, l, sigma, tol)
    pair, patch, pitch, before = plan.pair, plan.patch, plan.pitch, None
    while True:
        _check_cells(pair, pitch)
        beams = (pair.m, pair.l)
        h = [_modulus(b, e, pair, patch, pitch) for b, e in zip(beams, pair.own, strict=True)]
        cell = patch.pitch[0] * patch.pitch[1]
        product = h[0] * h[1]
        value = float(product.sum()) * cell / pair.norm
        missed = [max(1.0 - float(np.vdot(a, a)) * cell / b.power, 0.0) for a, b in zip(h, beams, strict=True)]
        steps = abs(value - float(product[::2, ::2].sum()) * 4.0 * cell / pair.norm)
        if before is not None:
            error = math.sqrt(missed[0] * missed[1]) + steps + abs(value - before)
            if error <= tol or abs(value - before) <= 0.1 * tol:
                seconds = time.perf_counter() - started
                return SpotOverlap(min(value, 1.0), error, NAME, _cells(pair, pitch) ** 2, seconds)
        before, pitch = value, pitch / 1.5


@dataclass(frozen=True)
class _Choice:
    """Beams, points of the detector, and the pitch (2,) of the first samples of the pupils."""

    pair: Pair
    patch: Patch
    pitch: Array


def _choose(m: PupilField, l: PupilField, sigma: float, tol: float) -> _Choice:  # noqa: E741
    """Patch and first pitch. Raises MethodLimitError."""
    check_pair(m, l)
    edges = edge_of(m), edge_of(l)
    # Supports that do not meet have PSFs that do: the overlap of irradiances knows no common support.
    pair = Pair(beam_at(m, sigma), beam_at(l, sigma), edges[0], edges)
    coarse, _ = choose_patch(pair, tol / 3.0, NAME, SIDE_CAP)
    patch = Patch(
        (2 * coarse.start[0], 2 * coarse.start[1]),
        (2 * coarse.count[0], 2 * coarse.count[1]),
        (0.5 * coarse.pitch[0], 0.5 * coarse.pitch[1]),
    )
    beams = (pair.m, pair.l)
    turns = np.max([steepest_step(b, None, e, (1.0, 1.0)) / TURN for b, e in zip(beams, edges, strict=True)], axis=0)
    pitch = np.minimum(0.6 / (turns + sigma * patch.farthest), np.ptp(np.array(pair.box), axis=0) / 48.0)
    _check_cells(pair, pitch)
    return _Choice(pair, patch, pitch)


def _cells(pair: Pair, pitch: Array) -> int:
    return math.ceil(float((np.ptp(np.array(pair.box), axis=0) / pitch).max()))


def _check_cells(pair: Pair, pitch: Array) -> None:
    count = _cells(pair, pitch)
    if count > CELL_CAP:
        raise MethodLimitError(
            NAME,
            f"{count} samples across the pupils (limit {CELL_CAP})",
            count / CELL_CAP,
            "ask for a larger tolerance, or use the geometric overlap of the spots",
        )


def _modulus(beam: Beam, edge: Edge, pair: Pair, patch: Patch, pitch: Array) -> NDArray[np.float64]:
    chosen = _FFT.pitch_for(pair, patch, pitch)
    grid = covering(edge.u.min(axis=0), edge.u.max(axis=0), chosen)
    return np.abs(_FFT.amplitude(beam, grid, shares([beam.support], grid), patch).field)


class Incoherent:
    """The incoherent overlap in the place of |γ|: never below it, and without a bound on the difference."""

    name = NAME

    def supports(self, m: PupilField, l: PupilField, sigma: float) -> str | None:  # noqa: E741
        """None, or the limit that a patch for one part in ten meets."""
        try:
            _choose(m, l, sigma, 0.1)
        except MethodLimitError as limit:
            return f"{limit.limit}, exceeded {limit.factor:.3g} times; {limit.remedy}"
        return None

    def error_bound(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """inf: an upper bound of |γ| says nothing about how far below it lies."""
        return math.inf

    def cost(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """Samples of both PSFs times their logarithm; inf where refused."""
        try:
            plan = _choose(m, l, sigma, tol)
        except MethodLimitError:
            return math.inf
        points = 4.0 * plan.patch.count[0] * plan.patch.count[1] + 3.25 * float(_cells(plan.pair, plan.pitch)) ** 2
        return 4.0 * points * math.log2(points)

    def evaluate(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> Estimate:  # noqa: E741
        """The incoherent overlap, real, with bound inf."""
        found = incoherent_overlap(m, l, sigma, tol)
        return Estimate(complex(found.value), math.inf, self.name, found.count, found.seconds)
