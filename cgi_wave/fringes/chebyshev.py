"""Chebyshev tools of the interferogram: interpolation between nodes, and a spectrum reduced to few nodes.

A spectral sum Σ_s w_s f(σ_s) over tens of thousands of samples costs as many evaluations of f for every pair and row.
But f, a contrast times a fringe phase, is smooth: over a band of half-width Δ and up to an OPD D it is a polynomial of
degree about 2πΔD. The same sum is therefore Σ_j W_j f(σ_j) over that many Chebyshev nodes, with weights W that hold
the Chebyshev moments of w. Nothing of the spectrum is smoothed: only f is interpolated.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray

Array = NDArray[np.float64]


def degree_for(bandwidth: float, extra: int = 0) -> int:
    """Number of nodes that hold exp(i c x), |x| ≤ 1, c = ``bandwidth`` in rad, to about 1e-13.

    Its Chebyshev coefficients are 2 J_n(c), which fall as Ai(2^⅓ (n − c)/c^⅓) beyond n = c: hence c + 10 c^⅓.
    ``extra`` is the degree of what multiplies the exponential.
    """
    return int(np.ceil(bandwidth + 10.0 * np.cbrt(bandwidth) + 16.0)) + extra


def nodes(count: int, low: float, high: float) -> Array:
    """``count`` Chebyshev nodes of the first kind in [low, high], ascending."""
    x = -np.cos(np.pi * (np.arange(count) + 0.5) / count)
    return 0.5 * (low + high) + 0.5 * (high - low) * x


def barycentric_weights(x: Array) -> Array:
    """(n,) barycentric weights of any n distinct nodes, scaled so that the largest is 1 (logarithms avoid overflow)."""
    difference = x[:, None] - x[None, :]
    np.fill_diagonal(difference, 1.0)
    log = -np.log(np.abs(difference)).sum(axis=1)
    sign = np.prod(np.sign(difference), axis=1)
    return np.asarray(sign * np.exp(log - log.max()))


def interpolation_matrix(x: Array, target: Array) -> Array:
    """(len(target), len(x)) matrix from values at the nodes ``x`` to values at ``target`` (second barycentric form)."""
    weight = barycentric_weights(x)
    difference = target[:, None] - x[None, :]
    hit_row, hit_column = np.nonzero(difference == 0.0)
    difference[hit_row, hit_column] = 1.0
    matrix = weight / difference
    matrix /= matrix.sum(axis=1, keepdims=True)
    matrix[hit_row] = 0.0
    matrix[hit_row, hit_column] = 1.0
    return matrix


def derivative_matrix(x: Array) -> Array:
    """(n, n) matrix that takes values at the nodes ``x`` to derivatives there; zero for a single node."""
    weight = barycentric_weights(x)
    difference = x[:, None] - x[None, :]
    np.fill_diagonal(difference, 1.0)
    matrix = (weight[None, :] / weight[:, None]) / difference
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return matrix


def compress(sigma: Array, weight: Array, count: int, low: float, high: float) -> tuple[Array, Array]:
    """Reduce Σ_s weight_s f(sigma_s) to Σ_j W_j f(sigma_j), exact for polynomials of degree < ``count``.

    sigma : (S,) within [low, high]; weight : (C, S), C weightings of the same samples.
    Returns the nodes (count,), ascending, and W (C, count).
    """
    x = (sigma - 0.5 * (low + high)) / (0.5 * (high - low))
    moments = np.empty((len(weight), count))
    previous, current = x.copy(), np.ones_like(x)  # T_{-1} = T_1 = x starts the recurrence
    for n in range(count):
        moments[:, n] = np.einsum("cs,s->c", weight, current)  # no BLAS: its threads only wait for so short a product
        previous *= -1.0
        previous += (2.0 * x) * current
        previous, current = current, previous
    # W_j = (1/N)[μ_0 + 2 Σ μ_n T_n(x_j)] at x_j = cos(π(j+½)/N): a cosine transform; reversed to ascending nodes
    return nodes(count, low, high), scipy.fft.dct(moments, type=3, axis=1)[:, ::-1] / count


def tail(values: NDArray[np.complex128]) -> Array:
    """(...,) size of the last Chebyshev coefficients of functions given at first-kind nodes along the last axis.

    Four times the largest of the last four: the interpolation error of a function whose coefficients have begun to
    fall at least as fast as a geometric series of ratio 1/2.
    """
    count = values.shape[-1]
    coefficient = scipy.fft.dct(values.real, type=2, axis=-1) + 1j * scipy.fft.dct(values.imag, type=2, axis=-1)
    return np.asarray(4.0 * np.abs(coefficient[..., -4:]).max(axis=-1) / count)
