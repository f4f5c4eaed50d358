"""Least squares on scattered samples by polynomials of growing degree, where each degree costs only what it adds.

Polynomials that are orthonormal on the samples are built degree by degree: those of the last degree times x or y, freed
of those of the last two degrees and of each other. With earlier ones they have nothing in common, since ⟨x q, p⟩ = ⟨q,
x p⟩, and x p is of lower degree than q. So a degree costs what its square asks for, not what all terms before it do;
and any leading part of the result is the result for that part.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_BLOCK = 4  # rows that are freed of as many others at once: what they share stays in registers
_TWICE = 0.5  # a row that loses more than this share of its length to others is freed of them again
_SLICE = 64  # points that are looked up together
_GONE = 1e-9  # a row that keeps no more than this depends on the others

_JIT = {"cache": True, "nogil": True}
# Reassociation lets the sums over samples vectorise; NaN and infinity keep their meaning.
_FAST = {"reassoc", "contract", "arcp", "nsz"}


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


@njit(**_JIT, fastmath=_FAST)
def _free_block(a, b, d):
    """Take out of four rows b (4, N) their parts along four orthonormal rows a; d (4, 4) receives these, [a, b]."""
    a0, a1, a2, a3 = a[0], a[1], a[2], a[3]
    b0, b1, b2, b3 = b[0], b[1], b[2], b[3]
    d00 = d01 = d02 = d03 = d10 = d11 = d12 = d13 = 0.0
    d20 = d21 = d22 = d23 = d30 = d31 = d32 = d33 = 0.0
    for i in range(a.shape[1]):
        p, q, r, s = a0[i], a1[i], a2[i], a3[i]
        t, u, v, w = b0[i], b1[i], b2[i], b3[i]
        d00 += p * t
        d01 += p * u
        d02 += p * v
        d03 += p * w
        d10 += q * t
        d11 += q * u
        d12 += q * v
        d13 += q * w
        d20 += r * t
        d21 += r * u
        d22 += r * v
        d23 += r * w
        d30 += s * t
        d31 += s * u
        d32 += s * v
        d33 += s * w
    for i in range(a.shape[1]):
        p, q, r, s = a0[i], a1[i], a2[i], a3[i]
        b0[i] -= p * d00 + q * d10 + r * d20 + s * d30
        b1[i] -= p * d01 + q * d11 + r * d21 + s * d31
        b2[i] -= p * d02 + q * d12 + r * d22 + s * d32
        b3[i] -= p * d03 + q * d13 + r * d23 + s * d33
    d[0, 0], d[0, 1], d[0, 2], d[0, 3] = d00, d01, d02, d03
    d[1, 0], d[1, 1], d[1, 2], d[1, 3] = d10, d11, d12, d13
    d[2, 0], d[2, 1], d[2, 2], d[2, 3] = d20, d21, d22, d23
    d[3, 0], d[3, 1], d[3, 2], d[3, 3] = d30, d31, d32, d33


@njit(**_JIT, fastmath=_FAST)
def _follow_block(a, b, d):
    """Take the same combinations of four rows a (4, T) out of four rows b (4, T) as ``_free_block`` did."""
    a0, a1, a2, a3 = a[0], a[1], a[2], a[3]
    for k in range(4):
        d0, d1, d2, d3 = d[0, k], d[1, k], d[2, k], d[3, k]
        bk = b[k]
        for i in range(a.shape[1]):
            bk[i] -= a0[i] * d0 + a1[i] * d1 + a2[i] * d2 + a3[i] * d3


@njit(**_JIT, fastmath=_FAST)
def _project_block(a, b, d):
    """Take out of one row b (N,) its parts along four orthonormal rows a (4, N); d (4,) receives these."""
    a0, a1, a2, a3 = a[0], a[1], a[2], a[3]
    d0 = d1 = d2 = d3 = 0.0
    for i in range(a.shape[1]):
        v = b[i]
        d0 += a0[i] * v
        d1 += a1[i] * v
        d2 += a2[i] * v
        d3 += a3[i] * v
    for i in range(a.shape[1]):
        b[i] -= a0[i] * d0 + a1[i] * d1 + a2[i] * d2 + a3[i] * d3
    d[0], d[1], d[2], d[3] = d0, d1, d2, d3


@njit(**_JIT)
def _free_row(q, c, j, low, terms):
    """Free row j of q of rows low…j − 1, and its coefficients c with it."""
    d = np.empty(_BLOCK)
    whole = low + (j - low) // _BLOCK * _BLOCK
    for i in range(low, whole, _BLOCK):
        _project_block(q[i : i + _BLOCK], q[j], d)
        for a in range(_BLOCK):
            _subtract(c[j, :terms], d[a], c[i + a, :terms])
    for i in range(whole, j):
        only = _dot(q[i], q[j])
        _subtract(q[j], only, q[i])
        _subtract(c[j, :terms], only, c[i, :terms])


@njit(**_JIT)
def _times(c, degree, axis, out):
    """Coefficients of x or y (axis) times a polynomial of this degree: rows of products T_i T_j, lowest degree
    first."""
    row = 0
    for d in range(degree + 1):
        for i in range(d + 1):
            j = d - i
            half = 0.5 * c[row]
            if axis == 0:
                up = (d + 1) * (d + 2) // 2 + i + 1
                down = up if i == 0 else d * (d - 1) // 2 + i - 1
            else:
                up = (d + 1) * (d + 2) // 2 + i
                down = up if j == 0 else d * (d - 1) // 2 + i
            out[up] += half
            out[down] += half
            row += 1


@njit(**_JIT)
def orthonormalise(q, c, x, first, last):
    """Polynomials of total degrees first…last − 1, orthonormal at points x (N, 2), to go on from those of lower degree.

    q (P, N) receives their values, lowest degree first, and c (P, P), zero there before, their coefficients of the
    products T_i T_j in the same order. One that depends on the others at the points gets 0.
    """
    d4 = np.empty((_BLOCK, _BLOCK))
    for degree in range(first, last):
        start, stop = degree * (degree + 1) // 2, (degree + 1) * (degree + 2) // 2
        if degree == 0:
            c[0, 0] = 1.0 / math.sqrt(x.shape[0])
            q[0, :] = c[0, 0]
            continue
        for j in range(start, stop):
            # x times the rows of the last degree, and y times the first of them
            parent, axis = (j - degree - 1, 0) if j > start else (j - degree, 1)
            for p in range(x.shape[0]):
                q[j, p] = x[p, axis] * q[parent, p]
            _times(c[parent], degree - 1, axis, c[j])
        low = (degree - 1) * (degree - 2) // 2
        for j in range(start, stop, _BLOCK):
            end = min(j + _BLOCK, stop)
            whole = low + (j - low) // _BLOCK * _BLOCK if end - j == _BLOCK else low
            for i in range(low, whole, _BLOCK):
                _free_block(q[i : i + _BLOCK], q[j:end], d4)
                _follow_block(c[i : i + _BLOCK, :stop], c[j:end, :stop], d4)
            for k in range(j, end):
                before = math.sqrt(_dot(q[k], q[k]))
                _free_row(q, c, k, whole, stop)
                norm = math.sqrt(_dot(q[k], q[k]))
                if norm < _TWICE * before:
                    _free_row(q, c, k, low, stop)
                    norm = math.sqrt(_dot(q[k], q[k]))
                if norm <= _GONE * before:
                    q[k, :] = 0.0
                    c[k, :] = 0.0
                else:
                    for i in range(q.shape[1]):
                        q[k, i] /= norm
                    for i in range(stop):
                        c[k, i] /= norm


@njit(**_JIT)
def project(q, first, last, residual, share, along):
    """Take the parts along orthonormal rows first…last − 1 of q (P, N) out of residual (Q, N), in place.

    along (Q, P) receives them; share (N,): one minus the diagonal of the hat matrix, lowered by what these rows add.
    """
    for j in range(first, last):
        for i in range(q.shape[1]):
            share[i] -= q[j, i] * q[j, i]
    whole, d = first + (last - first) // _BLOCK * _BLOCK, np.empty(_BLOCK)
    for v in range(residual.shape[0]):
        for j in range(first, whole, _BLOCK):
            _project_block(q[j : j + _BLOCK], residual[v], d)
            along[v, j : j + _BLOCK] = d
        for j in range(whole, last):
            along[v, j] = _dot(q[j], residual[v])
            _subtract(residual[v], along[v, j], q[j])


@njit(**_JIT)
def largest(residual, share, free, chosen):
    """(Q, 2) largest leave-one-out misfit of each value, by residual (Q, N) and share (N,), which is at least ``free``:
    over its chosen (Q, N) samples, and over all.
    """
    out = np.zeros((residual.shape[0], 2))
    for v in range(residual.shape[0]):
        for i in range(residual.shape[1]):
            misfit = abs(residual[v, i]) / max(share[i], free)
            if misfit > out[v, 1]:
                out[v, 1] = misfit
            if chosen[v, i] and misfit > out[v, 0]:
                out[v, 0] = misfit
    return out


@njit(**_JIT)
def climb(x, values, chosen, clearance, edge, terms, count_s, weight, target, limit, doubt, free):
    """Fits of values (Q, N) at points x (N, 2) for total degrees below terms (D,), one after the other, until one does.

    The rows of values: paths and amplitudes at count_s wavenumbers, clearances at the middle one, more. chosen (Q, N):
    samples of which the misfit counts. clearance, edge (count_s, K, N): clearances at all wavenumbers, and where they
    count; of the others than the middle one the change is part of the misfit.

    weight (2,): of the largest misfits of path and amplitude, which with the least of a clearance's make a score: the
    last degree is the first whose score is below target; or the one after which it is plain that the last of all stays
    above ``doubt`` times ``limit``, if the score goes on falling as it did.

    Returns c (P, P), along (Q, P) of ``combine``, and (D', Q, 2) the largest leave-one-out misfits, over chosen samples
    and over all, of the degrees that were tried.
    """
    rows, most, middle = terms[-1] * (terms[-1] + 1) // 2, terms.shape[0], count_s // 2
    count_k = clearance.shape[1]
    q, c = np.empty((rows, x.shape[0])), np.zeros((rows, rows))
    along, share = np.zeros((values.shape[0], rows)), np.ones(x.shape[0])
    residual, worst = values.copy(), np.zeros((most, values.shape[0], 2))
    before = last = 0.0
    n = 0
    for t in range(most):
        orthonormalise(q, c, x, n, terms[t])
        project(q, n * (n + 1) // 2, terms[t] * (terms[t] + 1) // 2, residual, share, along)
        n = terms[t]
        worst[t] = largest(residual, share, free, chosen)
        path, amplitude, open_edge = 0.0, 0.0, np.inf
        for s in range(count_s):
            path, amplitude = max(path, worst[t, s, 0]), max(amplitude, worst[t, count_s + s, 0])
        for k in range(count_k):
            row = 2 * count_s + k
            for s in range(count_s):
                for i in range(x.shape[0]):
                    if s != middle and edge[s, k, i]:
                        off = abs(clearance[s, k, i] - clearance[middle, k, i] + residual[row, i])
                        worst[t, row, 0] = max(worst[t, row, 0], off)
            open_edge = min(open_edge, worst[t, row, 0])
        before, last = last, weight[0] * path + weight[1] * amplitude + open_edge
        if last < target:
            return c, along, worst[: t + 1]
        if t > 1 and limit < np.inf:
            fall = math.log(last / before) / (terms[t] - terms[t - 1])
            if math.log(last) + min(fall, 0.0) * (terms[-1] - terms[t]) > math.log(doubt * limit):
                return c, along, worst[: t + 1]
    return c, along, worst


@njit(**_JIT)
def combine(c, along, terms, n):
    """Coefficients (Q, n, n) of the products T_i T_j from the parts along (Q, P) of the first rows of c, of each value
    below its own total degree terms (Q,), at most n."""
    out = np.zeros((along.shape[0], n, n))
    total = np.empty(n * (n + 1) // 2)
    for v in range(along.shape[0]):
        total[:] = 0.0
        for degree in range(terms[v]):
            stop = (degree + 1) * (degree + 2) // 2
            for j in range(stop - degree - 1, stop):
                _subtract(total[:stop], -along[v, j], c[j, :stop])
        row = 0
        for degree in range(terms[v]):
            for i in range(degree + 1):
                out[v, i, degree - i] = total[row]
                row += 1
    return out


@njit(**_JIT)
def mapped(p, values, n, free):
    """Determinant (N,) of the derivatives of two values (N, 2) by points p (N, 2), of a fit of total degree below n;
    its largest leave-one-out misfit as a share of their range; RMS radius of the points times √2.
    """
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    rows, centre = n * (n + 1) // 2, np.zeros(2)
    for i in range(p.shape[0]):
        for axis in range(2):
            centre[axis] += p[i, axis] / p.shape[0]
            low[axis], high[axis] = min(low[axis], values[i, axis]), max(high[axis], values[i, axis])
    half, square = 0.0, 0.0
    for i in range(p.shape[0]):
        away = (p[i, 0] - centre[0]) ** 2 + (p[i, 1] - centre[1]) ** 2
        half, square = max(half, away), square + away / p.shape[0]
    half = math.sqrt(half)
    x = (p - centre) / half
    q, c = np.empty((rows, p.shape[0])), np.zeros((rows, rows))
    along, residual, share = np.zeros((2, rows)), values.T.copy(), np.ones(p.shape[0])
    orthonormalise(q, c, x, 0, n)
    project(q, 0, rows, residual, share, along)
    found = largest(residual, share, free, np.zeros(residual.shape, np.bool_))
    slopes = polynomials(combine(c, along, np.full(2, n), n), x)
    det = (slopes[0, 1] * slopes[1, 2] - slopes[0, 2] * slopes[1, 1]) / half**2
    return det, found[:, 1].max() / max((high - low).max(), 1e-300), math.sqrt(2.0 * square)


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


@njit(**_JIT)
def values(coef, x):
    """Values (K, N) of Chebyshev products coef (K, n, m), any i and j, at points x (N, 2), in slices of which loops
    vectorise."""
    n, m, count = coef.shape[1], coef.shape[2], x.shape[0]
    out = np.empty((coef.shape[0], count))
    tx, ty, row, total = np.empty((n, _SLICE)), np.empty((m, _SLICE)), np.empty(_SLICE), np.empty(_SLICE)
    for first in range(0, count, _SLICE):
        size = min(_SLICE, count - first)
        for axis, t in ((0, tx), (1, ty)):
            for p in range(size):
                t[0, p] = 1.0
            if t.shape[0] > 1:
                for p in range(size):
                    t[1, p] = x[first + p, axis]
            for k in range(2, t.shape[0]):
                for p in range(size):
                    t[k, p] = 2.0 * t[1, p] * t[k - 1, p] - t[k - 2, p]
        for k in range(coef.shape[0]):
            total[:] = 0.0
            for i in range(n):
                row[:] = 0.0
                for j in range(m):
                    c = coef[k, i, j]
                    if c != 0.0:
                        for p in range(size):
                            row[p] += c * ty[j, p]
                for p in range(size):
                    total[p] += row[p] * tx[i, p]
            out[k, first : first + size] = total[:size]
    return out
