"""Spectral sums over pairs of beams: trapezoidal weights, the range that all pairs cover, the step that they need."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import MethodLimitError

Array = NDArray[np.float64]
#: Weight outside the spectral range of the pairs that is let go, its bound going into the error; more is refused.
LOST_WEIGHT_LIMIT = 1e-4


def trapezoid(sigma: Array) -> Array:
    """(S,) weights of the trapezoidal rule on wavenumbers sigma (S,), 1/m, ascending; 1 for a single one."""
    if len(sigma) == 1:
        return np.ones(1)
    step = np.diff(sigma)
    return 0.5 * (np.append(step, 0.0) + np.append(0.0, step))


def within(nodes: Iterable[Array], sigma: Array, measures: Array, method: str) -> tuple[NDArray[np.bool_], float]:
    """Mask (S,) of the samples that every pair's Chebyshev range covers, and the weight lost with the others.

    nodes: each pair's wavenumbers, Chebyshev nodes of the first kind (a single one serves everywhere); measures (C, S):
    weights of the samples. The loss is the largest of the rows'. Raises MethodLimitError beyond LOST_WEIGHT_LIMIT.
    """
    low, high = -np.inf, np.inf
    for own in nodes:
        n = len(own)
        if n > 1:  # nodes of the first kind stop short of the range they serve, by this factor
            centre, half = 0.5 * (own[0] + own[-1]), 0.5 * (own[-1] - own[0])
            half *= (1.0 + 1e-9) / np.cos(np.pi / (2 * n))
            low, high = max(low, centre - half), min(high, centre + half)
    inside = (sigma >= low) & (sigma <= high)
    lost = float(np.abs(measures[:, ~inside]).sum(axis=1).max())
    if lost > LOST_WEIGHT_LIMIT:
        raise MethodLimitError(
            method,
            f"{lost:.2e} of the spectral weight lies outside the pairs' range {low:.6g}…{high:.6g} 1/m, "
            f"at most {LOST_WEIGHT_LIMIT:g} may",
            lost / LOST_WEIGHT_LIMIT,
            "compute the contrasts over a wider spectral range",
        )
    return inside, lost


def check_step(sigma: Array, reach: float, method: str) -> None:
    """Refuse (MethodLimitError) a spectral step above 1/(4 reach); reach: largest group OPD kept, m."""
    if len(sigma) < 2:
        return
    factor = 4.0 * reach * float(np.diff(sigma).max())
    if factor > 1.0:
        raise MethodLimitError(
            method,
            f"spectral step at most 1/(4 OPD) = {0.25 / reach:.4g} 1/m for the largest group OPD kept, {reach:.4g} m",
            factor,
            f"sample the spectrum {np.ceil(factor):.0f} times finer, or leave the pairs of longest OPD out, bounded",
        )
