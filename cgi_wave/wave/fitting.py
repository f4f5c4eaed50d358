"""Least squares on scattered samples, with the misfit that each sample would have if it were left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cgi_wave.kernels import fit
from cgi_wave.wave.basis import Array

OVERSAMPLING = 1.4  # samples per polynomial term that a fit asks for
_FREE = 1e-6  # a sample is never taken to decide its own value more than up to this


class Nested:
    """Fits of values (Q, N) at scaled points (N, 2) by Chebyshev products of total degree below n, for growing n.

    Each degree costs what it adds to the one before. ``n`` is the present one, 0 at first.
    """

    def __init__(self, x: Array, values: Array, most: int) -> None:
        """For total degrees below ``most`` at most."""
        self.n = 0
        terms = most * (most + 1) // 2
        self._x = np.ascontiguousarray(x)
        self._q, self._c = np.empty((terms, len(x))), np.zeros((terms, terms))
        self._along = np.zeros((len(values), terms))
        self.residual = np.array(values, dtype=np.float64, order="C")
        self._share = np.ones(len(x))

    def grow(self, n: int) -> None:
        """Go on to total degrees below n."""
        first, last = (k * (k + 1) // 2 for k in (self.n, n))
        fit.orthonormalise(self._q, self._c, self._x, self.n, n)
        fit.project(self._q, first, last, self.residual, self._share, self._along)
        self.n = n

    def misfit(self) -> Array:
        """(Q, N) leave-one-out misfits, by the hat matrix."""
        return self.residual / np.maximum(self._share, _FREE)

    def largest(self, chosen: NDArray[np.bool_]) -> Array:
        """(Q, 2) largest leave-one-out misfit of each of the values, over its chosen (Q, N) samples and over all."""
        found: Array = fit.largest(self.residual, self._share, _FREE, chosen)
        return found

    def coefficients(self, rows: slice, n: int) -> Array:
        """(Q', n, n) Chebyshev coefficients of some of the values, for total degrees below n (the present or lower)."""
        solution: Array = fit.combine(self._c, self._along[rows], n)
        return solution


def polynomials(coef: Array, x: Array) -> Array:
    """Values and both derivatives (K, 3, N) of Chebyshev products coef (K, n, n) at scaled points x (N, 2)."""
    values: Array = fit.polynomials(np.ascontiguousarray(coef), np.ascontiguousarray(x))
    return values
