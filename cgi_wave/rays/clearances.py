"""Which apertures bound a beam."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.kernels.bounds import bounding
from cgi_wave.rays.disc import disc, fitted, monomials, on_disc

Array = NDArray[np.float64]

#: Points at which clearances are compared, and the most by which one changes between two of them: an aperture is
#: carried along if its clearance falls below this where all others are above minus this.
COMPARED = 1500
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
    x, _, _ = on_disc(p)
    degree = DEGREE if len(x) >= FULL else LOW_DEGREE
    least = clearance.min(axis=1)
    rows = np.flatnonzero(least < AMPLE)
    if not len(rows):
        return np.array([int(least.argmin())])
    dense = fitted(x, clearance[rows].T, degree).T @ _compared(degree)
    kept: NDArray[np.int64] = bounding(dense, LIMITING, SAME)
    return rows[kept if len(kept) else [int(dense.min(axis=1).argmin())]]


@lru_cache(maxsize=2)
def _compared(degree: int) -> Array:
    return np.ascontiguousarray(monomials(disc(COMPARED), degree).T)
