"""Least squares on scattered samples, with the misfit that each sample would have if it were left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cgi_wave.kernels import pupil
from cgi_wave.wave.basis import Array, total_degree_terms, vandermonde

OVERSAMPLING = 1.4  # samples per polynomial term that a fit asks for


@dataclass(frozen=True)
class Fit:
    """Chebyshev coefficients (Q, n, n) of Q quantities and the leave-one-out misfit (Q, N) at the samples."""

    coef: Array
    misfit: Array


@dataclass(frozen=True)
class Basis:
    """Chebyshev products at the points of a fit, orthonormalised with the lowest degree first."""

    q: Array
    r: Array

    @staticmethod
    def at(x: Array, n: int) -> Basis:
        """For scaled points x (N, 2) and total degrees below n."""
        return Basis(*pupil.orthonormalise(np.ascontiguousarray(vandermonde(x, n).T)))

    def fit(self, values: Array, n: int) -> Fit:
        """Least squares of values (Q, N) with total degrees below n; misfits by the hat matrix."""
        i, j = total_degree_terms(n)
        solution, misfit = pupil.least_squares(self.q[: i.size], self.r[: i.size, : i.size], values)
        coef = np.zeros((values.shape[0], n, n))
        coef[:, i, j] = solution
        return Fit(coef, misfit)
