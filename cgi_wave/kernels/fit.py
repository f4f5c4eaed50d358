"""Least squares on scattered samples by polynomials of growing degree, where each degree costs only what it adds.

Rows are values of basis functions at the samples, lowest total degree first. They are made orthonormal one by one, so
that any leading part of the result is the result for that part.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_BLOCK = 8  # rows that are freed of the earlier ones together: they stay in the first-level cache
_TWICE = 0.1  # a row that loses more than this share of its length to the earlier ones is freed of them again

_JIT = {"cache": True, "nogil": True}
# Reassociation lets the sums over samples vectorise; NaN and infinity keep their meaning.
_FAST = {"reassoc", "contract", "arcp", "nsz"}


@njit(**_JIT)
def chebyshev_rows(x, n):
    """(n (n + 1) / 2, N) products T_i(x) T_j(y), i + j < n, lowest total degree first, at points x (N, 2)."""
    count = x.shape[0]
    tx, ty = np.empty((n, count)), np.empty((n, count))
    for axis, t in ((0, tx), (1, ty)):
        t[0] = 1.0
        if n > 1:
            t[1] = x[:, axis]
        for k in range(2, n):
            for p in range(count):
                t[k, p] = 2.0 * x[p, axis] * t[k - 1, p] - t[k - 2, p]
    out = np.empty((n * (n + 1) // 2, count))
    row = 0
    for degree in range(n):
        for i in range(degree + 1):
            for p in range(count):
                out[row, p] = tx[i, p] * ty[degree - i, p]
            row += 1
    return out


@njit(**_JIT, fastmath=_FAST)
def _dot(a, b):
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@njit(**_JIT, fastmath=_FAST)
def _subtract(a, factor, b):
    for i in range(a.shape[0]):
        a[i] -= factor * b[i]


@njit(**_JIT)
def orthonormalise(q, r, first, last):
    """Make rows first…last − 1 of q (P, N) orthonormal, to each other and to those before, which are already.

    In place; r (P, P), zero there before, upper triangular: the rows that were are rᵀ q. Modified Gram-Schmidt, twice
    where a row loses much. A row that depends on the earlier ones gets q = 0 and r = 1 on the diagonal, hence a
    coefficient of 0.
    """
    before = np.empty(_BLOCK)
    for start in range(first, last, _BLOCK):
        stop = min(start + _BLOCK, last)
        for j in range(start, stop):
            before[j - start] = math.sqrt(_dot(q[j], q[j]))
        for i in range(start):
            for j in range(start, stop):
                d = _dot(q[i], q[j])
                r[i, j] = d
                _subtract(q[j], d, q[i])
        for j in range(start, stop):
            for i in range(start, j):
                d = _dot(q[i], q[j])
                r[i, j] = d
                _subtract(q[j], d, q[i])
            norm = math.sqrt(_dot(q[j], q[j]))
            if norm < _TWICE * before[j - start]:
                for i in range(j):
                    d = _dot(q[i], q[j])
                    r[i, j] += d
                    _subtract(q[j], d, q[i])
                norm = math.sqrt(_dot(q[j], q[j]))
            if norm <= 1e-9 * before[j - start]:
                q[j, :] = 0.0
                r[j, j] = 1.0
            else:
                r[j, j] = norm
                for i in range(q.shape[1]):
                    q[j, i] /= norm


@njit(**_JIT)
def project(q, first, last, residual, share, along):
    """Take the parts along orthonormal rows first…last − 1 of q (P, N) out of residual (Q, N), in place.

    along (Q, P) receives them; share (N,): one minus the diagonal of the hat matrix, lowered by what these rows add.
    """
    for j in range(first, last):
        for i in range(q.shape[1]):
            share[i] -= q[j, i] * q[j, i]
    for v in range(residual.shape[0]):
        for j in range(first, last):
            along[v, j] = _dot(q[j], residual[v])
            _subtract(residual[v], along[v, j], q[j])


@njit(**_JIT)
def solve(r, along, n):
    """Coefficients (Q, n, n) of the products T_i T_j from the parts along (Q, P) of n (n + 1) / 2 rows = rᵀ q."""
    count = n * (n + 1) // 2
    out = np.zeros((along.shape[0], n, n))
    c = np.empty(count)
    for v in range(along.shape[0]):
        c[:] = along[v, :count]
        for j in range(count - 1, -1, -1):
            c[j] /= r[j, j]
            for i in range(j):
                c[i] -= r[i, j] * c[j]
        row = 0
        for degree in range(n):
            for i in range(degree + 1):
                out[v, i, degree - i] = c[row]
                row += 1
    return out


@njit(**_JIT)
def near_points(x, chosen, reach):
    """(N,) which points x (N, 2) of the unit disc are chosen (N,), or within ``reach`` of one that is."""
    near = np.zeros(x.shape[0], dtype=np.bool_)
    for i in range(x.shape[0]):
        if x[i, 0] ** 2 + x[i, 1] ** 2 > 1.0:
            continue
        near[i] = chosen[i]
        j = 0
        while not near[i] and j < x.shape[0]:
            near[i] = chosen[j] and (x[i, 0] - x[j, 0]) ** 2 + (x[i, 1] - x[j, 1]) ** 2 <= reach * reach
            j += 1
    return near


@njit(**_JIT)
def polynomials(coef, x):
    """Values and both derivatives (K, 3, N) of Chebyshev products coef (K, n, n), i + j < n, at points x (N, 2)."""
    n = coef.shape[1]
    out = np.zeros((coef.shape[0], 3, x.shape[0]))
    t, dt = np.empty((2, n)), np.empty((2, n))
    for p in range(x.shape[0]):
        for axis in range(2):
            a = x[p, axis]
            t[axis, 0], dt[axis, 0] = 1.0, 0.0
            if n > 1:
                t[axis, 1], dt[axis, 1] = a, 1.0
            for k in range(2, n):
                t[axis, k] = 2.0 * a * t[axis, k - 1] - t[axis, k - 2]
                dt[axis, k] = 2.0 * t[axis, k - 1] + 2.0 * a * dt[axis, k - 1] - dt[axis, k - 2]
        for k in range(coef.shape[0]):
            value, by_x, by_y = 0.0, 0.0, 0.0
            for i in range(n):
                row, slope = 0.0, 0.0
                for j in range(n - i):
                    row += coef[k, i, j] * t[1, j]
                    slope += coef[k, i, j] * dt[1, j]
                value += row * t[0, i]
                by_x += row * dt[0, i]
                by_y += slope * t[0, i]
            out[k, 0, p], out[k, 1, p], out[k, 2, p] = value, by_x, by_y
    return out
