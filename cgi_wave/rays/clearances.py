"""Which apertures bound a beam."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.kernels.bounds import bounding_polynomials, near_zero
from cgi_wave.rays.disc import fitted_rows, monomial_powers

Array = NDArray[np.float64]

#: Points across the disc at which clearances are compared, and the most by which one changes between two of them: an
#: aperture is carried along if its clearance falls below this where all others are above minus this.
COMPARED = 45
LIMITING = 0.05
#: Room at every ray with which there is no need to look between rays.
AMPLE = 0.15
#: Apertures whose clearances agree to this everywhere are one (the stop and its image, a plate's two passes).
SAME = 1e-6
#: Degree of the polynomials through clearances, and the lower one for beams of fewer rays than FULL.
DEGREE, LOW_DEGREE, FULL = 8, 4, 90


def limiting(clearance: Array, p: Array) -> Array:
    """The clearances (K', S, N) of (K, S, N) that bound the beam; at least one. p (N, 2): pupil points."""
    return clearance[bounding_rows(clearance[:, clearance.shape[1] // 2], p)]


def bounding_rows(clearance: Array, p: Array) -> NDArray[np.int64]:
    """Which clearances (K, N) bound a beam: their indices, at least one. p (N, 2): pupil points.

    Most apertures on a long path are passed with room to spare, or lie in the shadow of another (a mirror next to an
    image of the stop). Polynomials through the samples say which, on points much denser than the rays.
    """
    taken, rows = near_zero(clearance, AMPLE)
    if len(rows) == 1:
        return rows
    degree = DEGREE if len(p) >= FULL else LOW_DEGREE
    coef = fitted_rows(p, taken, degree)
    order, powers = _compared(degree)
    kept: NDArray[np.int64] = bounding_polynomials(coef, order, powers, LIMITING, SAME)
    return rows[kept]


@lru_cache(maxsize=2)
def _compared(degree: int) -> tuple[NDArray[np.int64], Array]:
    axis = np.linspace(-1.0, 1.0, COMPARED)
    return np.array(monomial_powers(degree)), np.ascontiguousarray(np.vander(axis, degree + 1, increasing=True).T)
