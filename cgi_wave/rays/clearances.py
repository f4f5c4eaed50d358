"""Which apertures bound a beam."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.rays.disc import disc, fitted, monomials, on_disc

Array = NDArray[np.float64]

#: Points at which clearances are compared, and the most by which one changes between two of them: an aperture is
#: carried along if its clearance falls below this where all others are above minus this.
COMPARED = 1500
LIMITING = 0.05
#: Apertures whose clearances agree to this everywhere are one (the stop and its image, a plate's two passes).
SAME = 1e-6
#: Degree of the polynomials through clearances, and the lower one for beams of fewer rays than FULL.
DEGREE, LOW_DEGREE, FULL = 8, 4, 90


def limiting(clearance: Array, p: Array) -> Array:
    """The clearances (K', S, N) of (K, S, N) that bound the beam; at least one. p (N, 2): pupil points.

    Most apertures on a long path are passed with room to spare, or lie in the shadow of another (a mirror next to an
    image of the stop). Polynomials through the samples say which, on points much denser than the rays.
    """
    x, _, _ = on_disc(p)
    degree = DEGREE if len(x) >= FULL else LOW_DEGREE
    dense = (_compared(degree) @ fitted(x, clearance[:, clearance.shape[1] // 2].T, degree)).T
    least = dense.min(axis=1)
    order = np.argsort(least)
    kept: list[int] = []
    others = np.full(dense.shape[1], np.inf)
    for k in order:
        if least[k] >= LIMITING:  # nor do those that follow come near zero
            break
        cuts = bool(((dense[k] < LIMITING) & (others > -LIMITING)).any())
        if cuts and all(np.abs(dense[k] - dense[j]).max() > SAME for j in kept):
            kept.append(int(k))
            others = np.minimum(others, dense[k])
    for k in list(kept):
        rest = [j for j in kept if j != k]
        if rest and not ((dense[k] < LIMITING) & (dense[rest].min(axis=0) > -LIMITING)).any():
            kept = rest
    return clearance[kept or [int(order[0])]]


@lru_cache(maxsize=2)
def _compared(degree: int) -> Array:
    return monomials(disc(COMPARED), degree)
