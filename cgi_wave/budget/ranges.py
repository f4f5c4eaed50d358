"""How far apart the beams of every pair are over the pupil: path differences, their slopes, and what that does to γ."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cgi_wave.kernels.pairs import curvatures, ranges
from cgi_wave.rays.beams import Sheet
from cgi_wave.rays.disc import disc

Array = NDArray[np.float64]

#: Pupil points at which path differences are compared.
COMMON_POINTS = 300
#: Pairs whose bound is below this share of the tolerance need no estimate of γ.
FAR_BELOW = 0.03
#: Safety of the stationary-phase estimate, per principal direction.
SAFE = 2.5
#: Room when the OPD range of a pair is bounded from its phase OPDs: for the zone's own fringes, m, and for group OPDs,
#: which differ by dispersion (2 to 4 % of a path in silica or flint, less where air takes part).
OPD_MARGIN, DISPERSION = 2e-5, 0.05
#: Shared points without which no quadratic is fitted.
FEWEST = 12


def pair_ranges(
    sheets: Sequence[Sheet], sigma0: float, weight: Array, envelope: Callable[[Array, Array], Array], tolerance: float
) -> tuple[Array, Array, Array, Array]:
    """Range of every pair's group OPD over the pupil points that both feed, its |γ|, its dOPD/dy; (B, B) each.

    weight (B,): power over nominal power and NMA, so that √(weight_m weight_l)·|G| bounds what a pair adds to M. Pairs
    for which that is far below the tolerance keep |γ| ≤ 1, for the others see ``stationary_phase``; |γ| is that of
    pairs m < l. Pairs that share no point get the whole range of both, |γ| ≤ 1, and a slope of NaN.
    """
    lo = np.min([sheet.p.min(axis=0) for sheet in sheets], axis=0)
    hi = np.max([sheet.p.max(axis=0) for sheet in sheets], axis=0)
    points = 0.5 * (lo + hi) + 0.5 * (hi - lo) * disc(COMMON_POINTS)
    values = np.full((3, len(sheets), len(points)), np.nan)
    least, most = np.empty(len(sheets)), np.empty(len(sheets))
    for b, sheet in enumerate(sheets):
        near = sheet.covers(points)
        values[:, b, near] = sheet.at(points[near]).T
        own = sheet.group_at(sheet.p)
        least[b], most[b] = own.min(), own.max()
    phase, group, tilt = values
    low, high, slope = ranges(group, tilt, least, most)
    margin = OPD_MARGIN + DISPERSION * np.maximum(np.abs(low), np.abs(high))
    low, high = low - margin, high + margin
    gamma = np.ones_like(low)
    first, second = np.triu_indices(len(sheets), 1)
    bound = np.sqrt(weight[first] * weight[second]) * envelope(low[first, second], high[first, second])
    close = bound > FAR_BELOW * tolerance
    first, second = first[close], second[close]
    gamma[first, second] = stationary_phase(points, phase * sigma0, first, second)
    return low, high, gamma, slope


def stationary_phase(points: Array, waves: Array, first: NDArray[np.int64], second: NDArray[np.int64]) -> Array:
    """Estimate, on the safe side, of |γ| of pairs of beams (first, second), (P,), from their paths over the pupil.

    points (N, 2); waves (B, N): path of each beam, NaN where it does not reach. A quadratic fitted to the path
    difference has principal values a and b, in waves at the rim of the shared points. Each lowers |γ| like a Fresnel
    integral: by at most SAFE·0.354/√|a| (the whole stationary zone inside; a disc of pure defocus W has 1/(πW), this
    gives 2.5/(πW)). An estimate, since it rests on the quadratic: what it leaves out of a plan is reported as such.
    """
    bent = np.abs(curvatures(points, waves, first, second, FEWEST))
    with np.errstate(divide="ignore"):
        factors = np.minimum(1.0, SAFE * 0.354 / np.sqrt(bent))
    # Where no quadratic was fitted, nothing is known.
    estimate: Array = np.where(np.isfinite(bent[:, 0]), factors[:, 0] * factors[:, 1], 1.0)
    return estimate
