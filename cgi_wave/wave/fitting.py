"""Least squares on scattered samples, with the misfit that each sample would have if it were left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cgi_wave.kernels import fit
from cgi_wave.wave.basis import Array

OVERSAMPLING = 1.4  # samples per polynomial term that a fit asks for
_DOUBT = 30.0  # by how much a misfit that goes on falling may miss a limit in the end, and yet be waited for
_FREE = 1e-6  # a sample is never taken to decide its own value more than up to this


class Climb:
    """Fits of values at scaled points by Chebyshev products of growing total degree, until one serves.

    Each degree costs what it adds to the one before. worst (D, Q, 2): largest leave-one-out misfit of each value, by
    the hat matrix, for each degree tried: over its chosen samples, and over all.
    """

    def __init__(
        self,
        x: Array,
        values: Array,
        chosen: NDArray[np.bool_],
        clearance: Array,
        edge: NDArray[np.bool_],
        terms: NDArray[np.int64],
        weight: Array,
        target: float = -1.0,
        limit: float = np.inf,
    ) -> None:
        """Arguments as those of ``kernels.fit.climb``; x (N, 2) in the unit disc."""
        self._size = fit.padded(len(x))
        self._rows, self._along, self.worst = fit.climb(
            x, values, chosen, clearance, edge, terms, len(clearance), weight, target, limit, _DOUBT, _FREE
        )

    def coefficients(self, first: int, last: int | None, n: int, terms: NDArray[np.int64] | None = None) -> Array:
        """(Q', n, n) Chebyshev coefficients of some of the values, for total degrees below n, or below terms (Q',)."""
        along = self._along[first:last]
        solution: Array = fit.combine(
            self._rows, self._size, along, np.full(len(along), n) if terms is None else terms, n
        )
        return solution


def mapping(p: Array, values: Array, degree: int) -> tuple[Array, float, float]:
    """Determinant (N,) of the derivatives of two values (N, 2) by points p (N, 2), by a fit of a total degree; its
    largest leave-one-out misfit as a share of their range; RMS radius of the points times √2."""
    det, misfit, radius = fit.mapped(np.ascontiguousarray(p), np.ascontiguousarray(values), degree + 1, _FREE)
    return det, float(misfit), float(radius)


def polynomials(coef: Array, x: Array) -> Array:
    """Values and both derivatives (K, 3, N) of Chebyshev products coef (K, n, n) at scaled points x (N, 2)."""
    values: Array = fit.polynomials(np.ascontiguousarray(coef), np.ascontiguousarray(x))
    return values
