"""Polynomials in two variables and in the wavenumber: the arithmetic that fields and regions share.

A field keeps its polynomials as products of Chebyshev polynomials, coef[..., i, j] T_i(x) T_j(y) with i + j < n, on
scaled coordinates (u - centre) / scale. The quadrature wants monomials about a pivot; ``expand`` goes from one to the
other exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from cgi_wave.kernels.fit import values
from cgi_wave.kernels.polynomials import expanded

Array = NDArray[np.float64]


def total_degree_terms(n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices (i, j) of the terms with i + j < n, lowest total degree first: two arrays of length n (n + 1) / 2."""
    pairs = np.array([(i, d - i) for d in range(n) for i in range(d + 1)])
    return pairs[:, 0], pairs[:, 1]


def vandermonde(x: Array, n: int) -> Array:
    """(N, n (n + 1) / 2) values of the Chebyshev products at scaled coordinates x (N, 2)."""
    i, j = total_degree_terms(n)
    product: Array = chebyshev.chebvander(x[:, 0], n - 1)[:, i] * chebyshev.chebvander(x[:, 1], n - 1)[:, j]
    return product


def evaluate(coef: Array, x: Array, y: Array) -> Array:
    """Values (..., X, Y) of Chebyshev-product polynomials coef (..., n, n) on the scaled grid x (X,) by y (Y,)."""
    n = coef.shape[-1]
    found: Array = chebyshev.chebvander(x, n - 1) @ coef @ chebyshev.chebvander(y, n - 1).T
    return found


def at_points(coef: Array, x: Array) -> Array:
    """Values (..., N) of Chebyshev-product polynomials coef (..., n, n) at scaled points x (N, 2)."""
    stack = np.ascontiguousarray(coef.reshape(-1, *coef.shape[-2:]))
    found: Array = values(stack, np.ascontiguousarray(x))
    return found.reshape(*coef.shape[:-2], len(x))


def expand(coef: Array, centre: Array, scale: Array, pivot: Array, frame: Array, n: int) -> Array:
    """Powers (..., n, n) about ``pivot`` in units ``frame`` of Chebyshev products (..., k, k), k <= n; exact."""
    shape = coef.shape
    stacked = np.ascontiguousarray(coef).reshape(-1, shape[-1], shape[-1])
    return expanded(stacked, (pivot - centre) / scale, frame / scale, n).reshape(*shape[:-2], n, n)


def lagrange(nodes: Array, sigma: Array) -> Array:
    """(T, S) values at ``sigma`` of the Lagrange polynomials through ``nodes`` (S,)."""
    weights = np.ones((sigma.size, nodes.size))
    for s in range(nodes.size):
        for r in range(nodes.size):
            if r != s:
                weights[:, s] *= (sigma - nodes[r]) / (nodes[s] - nodes[r])
    return weights


def chebyshev_wavenumbers(sigma_min: float, sigma_max: float, n: int) -> Array:
    """(n,) ascending Chebyshev nodes of the first kind on [sigma_min, sigma_max], 1/m; the middle for n = 1."""
    k = np.arange(n, 0, -1)
    return 0.5 * (sigma_min + sigma_max) + 0.5 * (sigma_max - sigma_min) * np.cos(np.pi * (k - 0.5) / n)


def chebyshev_tail(values: NDArray[np.complex128]) -> float:
    """Size of what is missing from the polynomial through ``values`` at first-kind nodes.

    Taken as twice the sum of the magnitudes of the last quarter (at least two) of the Chebyshev coefficients: they
    fall off geometrically once the oscillation is resolved.
    """
    n = values.size
    if n < 3:
        return float("inf")
    k = np.arange(n, 0, -1)
    angle = np.pi * (k - 0.5) / n
    coefficients = 2.0 / n * np.cos(np.outer(np.arange(n), angle)) @ values
    return 2.0 * float(np.abs(coefficients[n - max(2, n // 4) :]).sum())
