"""The retrieval without frames: where all rows see a ground row alike, its fit is linear in the ground's image.

At one whole row per frame, ground row g is on detector row j as image_k(g, x) with the pattern P(j, x)·T_k(j), so that
the right-hand sides of its fit are Σ_k image_k(g, x)·Σ_j model(j, x) P(j, x) T_k(j): the second sum is the same for
every g. Beams whose images keep their rows need no frames then: neither frames nor sums of ground rows that are open.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes.maps import TERMS, Window

Array = NDArray[np.float64]
Real = NDArray[np.floating]


class SteadyFit:
    """Terms of the fit of ground rows from their images. pattern (C, R, X); along (K, R): T_k on the zone's rows."""

    def __init__(self, fit: Window, pattern: Real, along: Array) -> None:
        inverse = fit.inverse()
        self._solve: Array = np.zeros((len(along), len(pattern), TERMS, pattern.shape[2]))
        for n, j in enumerate(fit.rows.tolist()):
            term = fit.terms(n)
            for k in range(len(along)):
                for c in range(len(pattern)):
                    self._solve[k, c] += along[k, j] * pattern[c, j].astype(np.float64) * term
        for k in range(len(along)):
            for c in range(len(pattern)):
                self._solve[k, c] = np.einsum("xab,bx->ax", inverse, self._solve[k, c])

    def terms(self, image: Real) -> Array:
        """(6, X) the terms of a ground row, as ``GroundFit.add`` gives them. image (K, C, X) : of that row."""
        return np.asarray((self._solve * image[:, :, None, :]).sum(axis=(0, 1)))
