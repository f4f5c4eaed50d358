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
_LANES = 8  # numbers that a processor works on at once, at most
_TWICE = 0.5  # a row that loses more than this share of its length to others is freed of them again
_SLICE = 64  # points that are looked up together
_GONE = 1e-9  # a row that keeps no more than this depends on the others

_JIT = {"cache": True, "nogil": True}
# Reassociation lets the sums over samples vectorise; NaN and infinity keep their meaning.
_FAST = {"reassoc", "contract", "arcp", "nsz"}
_LARGEST = {"reassoc", "contract", "nsz", "nnan"}  # nor does the largest of several vectorise without the last


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
def _free_block(a, b, size, upto, d):
    """Take out of four rows b their parts along four rows a, orthonormal by their first ``size`` places; d (4, 4)
    receives these, [a, b].

    What stands in the places from there up to ``upto`` takes part in the subtraction only.
    """
    # Only loops over whole arrays are sure to vectorise.
    a0, a1, a2, a3 = a[0, :size], a[1, :size], a[2, :size], a[3, :size]
    b0, b1, b2, b3 = b[0, :size], b[1, :size], b[2, :size], b[3, :size]
    d00 = d01 = d02 = d03 = d10 = d11 = d12 = d13 = 0.0
    d20 = d21 = d22 = d23 = d30 = d31 = d32 = d33 = 0.0
    for i in range(a0.shape[0]):
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
    a0, a1, a2, a3 = a[0, :upto], a[1, :upto], a[2, :upto], a[3, :upto]
    b0, b1, b2, b3 = b[0, :upto], b[1, :upto], b[2, :upto], b[3, :upto]
    for i in range(a0.shape[0]):
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
def _dots(a, b, d):
    """d (4,) receives the sums of products of four rows a (4, N) with b (N,)."""
    a0, a1, a2, a3 = a[0], a[1], a[2], a[3]
    d0 = d1 = d2 = d3 = 0.0
    for i in range(b.shape[0]):
        v = b[i]
        d0 += a0[i] * v
        d1 += a1[i] * v
        d2 += a2[i] * v
        d3 += a3[i] * v
    d[0], d[1], d[2], d[3] = d0, d1, d2, d3


@njit(**_JIT, fastmath=_FAST)
def _add(a, d, b):
    """b (M,) receives four rows a (4, M), each d (4,) times."""
    a0, a1, a2, a3 = a[0], a[1], a[2], a[3]
    d0, d1, d2, d3 = d[0], d[1], d[2], d[3]
    for i in range(b.shape[0]):
        b[i] += a0[i] * d0 + a1[i] * d1 + a2[i] * d2 + a3[i] * d3


@njit(**_JIT)
def _free_row(rows, j, low, size, upto):
    """Free row j of rows low…j − 1: as ``_free_block``."""
    whole, d = low + (j - low) // _BLOCK * _BLOCK, np.empty(_BLOCK)
    for k in range(low, whole, _BLOCK):
        _dots(rows[k : k + _BLOCK, :size], rows[j, :size], d)
        for i in range(_BLOCK):
            d[i] = -d[i]
        _add(rows[k : k + _BLOCK, :upto], d, rows[j, :upto])
    for k in range(whole, j):
        _subtract(rows[j, :upto], _dot(rows[k, :size], rows[j, :size]), rows[k, :upto])


@njit(**_JIT)
def _times(c, degree, axis, out):
    """Coefficients of x or y (axis) times a polynomial of this degree: rows of products T_i T_j, lowest degree
    first."""
    for d in range(degree + 1):
        row, up, down = d * (d + 1) // 2, (d + 1) * (d + 2) // 2, d * (d - 1) // 2
        shift = 1 - axis  # i grows by one with x and stays with y
        for i in range(d + 1):
            out[up + shift + i] += 0.5 * c[row + i]
        for i in range(d):
            out[down + i] += 0.5 * c[row + shift + i]
        # T_1 T_0 is whole
        out[up + (0 if axis == 0 else d) + shift] += 0.5 * c[row + (0 if axis == 0 else d)]


@njit(**_JIT)
def orthonormalise(rows, x, size, first, last):
    """Polynomials of total degrees first…last − 1, orthonormal at points x (N, 2), to go on from those of lower degree.

    rows (P + 3, size + P), lowest degree first, receives their values, up to ``size`` >= N with 0 behind them, and then
    their coefficients of the products T_i T_j in the same order; rows behind the last are 0. One that depends on the
    others at the points gets 0.
    """
    count, d4 = x.shape[0], np.empty((_BLOCK, _BLOCK))
    for degree in range(first, last):
        start, stop = degree * (degree + 1) // 2, (degree + 1) * (degree + 2) // 2
        rows[start:stop, count:] = 0.0
        rows[stop : stop + _BLOCK - 1] = 0.0
        upto = size + stop
        if degree == 0:
            rows[0, :count] = rows[0, size] = 1.0 / math.sqrt(count)
            continue
        for j in range(start, stop):
            # x times the rows of the last degree, and y times the first of them
            parent, axis = (j - degree - 1, 0) if j > start else (j - degree, 1)
            for p in range(count):
                rows[j, p] = x[p, axis] * rows[parent, p]
            _times(rows[parent, size:], degree - 1, axis, rows[j, size:])
        least = (degree - 1) * (degree - 2) // 2
        for j in range(start, stop, _BLOCK):
            # Of the degree before the last, only rows whose product with x reaches the row that this one is made of.
            # Four and four: with up to three rows that are 0 behind, and up to three more before.
            low = least + max(j - start - 2, 0)
            low -= (low - j) % _BLOCK
            for i in range(low if low >= 0 else j, j, _BLOCK):
                _free_block(rows[i : i + _BLOCK], rows[j : j + _BLOCK], size, upto, d4)
            for k in range(j, min(j + _BLOCK, stop)):
                own = rows[k, :size]
                before = math.sqrt(_dot(own, own))
                _free_row(rows, k, j if low >= 0 else least, size, upto)
                norm = math.sqrt(_dot(own, own))
                if norm < _TWICE * before:
                    _free_row(rows, k, least, size, upto)
                    norm = math.sqrt(_dot(own, own))
                if norm <= _GONE * before:
                    rows[k, :upto] = 0.0
                else:
                    inverse = 1.0 / norm
                    for i in range(upto):
                        rows[k, i] *= inverse


@njit(**_JIT)
def project(rows, first, last, residual, share, along):
    """Take the parts along orthonormal rows first…last − 1 of ``orthonormalise`` out of residual (Q, size), in place; Q
    is a multiple of four.

    along (Q, P + 3) receives them; share (N,): one minus the diagonal of the hat matrix, lowered by what these rows
    add.
    """
    size, d4 = residual.shape[1], np.empty((_BLOCK, _BLOCK))
    for j in range(first, last, _BLOCK):
        q0, q1, q2, q3 = rows[j], rows[j + 1], rows[j + 2], rows[j + 3]
        for i in range(share.shape[0]):
            share[i] -= q0[i] * q0[i] + q1[i] * q1[i] + q2[i] * q2[i] + q3[i] * q3[i]
        for v in range(0, residual.shape[0], _BLOCK):
            _free_block(rows[j : j + _BLOCK], residual[v : v + _BLOCK], size, size, d4)
            for a in range(_BLOCK):
                for b in range(_BLOCK):
                    along[v + b, j + a] = d4[a, b]


@njit(**_JIT, fastmath=_LARGEST)
def _largest_of(residual, weight, chosen):
    """The largest size of residual (N,) times weight (N,), over the chosen (N,) and over all."""
    some = every = 0.0
    for i in range(residual.shape[0]):
        misfit = abs(residual[i]) * weight[i]
        every = max(every, misfit)
        some = max(some, misfit * chosen[i])
    return some, every


@njit(**_JIT)
def largest(residual, share, free, chosen):
    """(Q, 2) largest leave-one-out misfit of each value, by residual (Q', N'), at least (Q, N), and share (N,), which
    is at least ``free``: over its chosen (Q, N) samples, and over all.
    """
    out, weight = np.empty((chosen.shape[0], 2)), np.empty(share.shape[0])
    for i in range(share.shape[0]):
        weight[i] = 1.0 / max(share[i], free)
    for v in range(chosen.shape[0]):
        out[v, 0], out[v, 1] = _largest_of(residual[v, : share.shape[0]], weight, chosen[v])
    return out


@njit(**_JIT)
def padded(count):
    """The least multiple of _LANES that is not below a count: loops up to there leave no rest."""
    return -(-count // _LANES) * _LANES


@njit(**_JIT)
def _padded(values):
    """Values (Q, N) with 0 behind them, so that rows are a multiple of four, and their length as ``padded``."""
    out = np.zeros((-(-values.shape[0] // _BLOCK) * _BLOCK, padded(values.shape[1])))
    out[: values.shape[0], : values.shape[1]] = values
    return out


@njit(**_JIT)
def climb(x, values, chosen, clearance, edge, terms, count_s, weight, target, limit, doubt, free):
    """Fits of values (Q, N) at points x (N, 2) for total degrees below terms (D,), one after the other, until one does.

    The rows of values: paths and amplitudes at count_s wavenumbers, clearances at the middle one, more. chosen (Q, N):
    samples of which the misfit counts. clearance, edge (count_s, K, N): clearances at all
    wavenumbers, and where they count; of the others than the middle one the change is part of the misfit.

    weight (2,): of the largest misfits of path and amplitude, which with the least of a clearance's make a score: the
    last degree is the first whose score is below target; or the one after which it is plain that the last of all stays
    above ``doubt`` times ``limit``, if the score goes on falling as it did.

    Returns rows, along (Q, P + 3) of ``combine``, and (D', Q, 2) the largest leave-one-out misfits, over chosen samples
    and over all, of the degrees that were tried.
    """
    size, most, middle = padded(x.shape[0]), terms.shape[0], count_s // 2
    count, count_k = terms[-1] * (terms[-1] + 1) // 2, clearance.shape[1]
    rows = np.empty((count + _BLOCK - 1, size + padded(count)))
    residual, worst = _padded(values), np.zeros((most, values.shape[0], 2))
    along, share = np.zeros((residual.shape[0], count + _BLOCK - 1)), np.ones(x.shape[0])
    before = last = 0.0
    n = tried = 0
    for t in range(most):
        orthonormalise(rows, x, size, n, terms[t])
        project(rows, n * (n + 1) // 2, terms[t] * (terms[t] + 1) // 2, residual, share, along)
        n, tried = terms[t], t + 1
        worst[t] = largest(residual, share, free, chosen)
        path, amplitude, open_edge = 0.0, 0.0, np.inf
        for s in range(count_s):
            path, amplitude = max(path, worst[t, s, 0]), max(amplitude, worst[t, count_s + s, 0])
        for k in range(count_k):
            row = 2 * count_s + k
            for s in range(count_s):
                if s == middle:
                    continue
                for i in range(x.shape[0]):
                    if edge[s, k, i]:
                        off = abs(clearance[s, k, i] - clearance[middle, k, i] + residual[row, i])
                        worst[t, row, 0] = max(worst[t, row, 0], off)
            open_edge = min(open_edge, worst[t, row, 0])
        before, last = last, weight[0] * path + weight[1] * amplitude + open_edge
        if last < target:
            break
        if t > 1 and limit < np.inf:
            fall = math.log(last / before) / (terms[t] - terms[t - 1])
            if math.log(last) + min(fall, 0.0) * (terms[-1] - terms[t]) > math.log(doubt * limit):
                break
    return rows, along[: values.shape[0]], worst[:tried]


@njit(**_JIT, fastmath=_FAST)
def combine(rows, size, along, terms, n):
    """Coefficients (Q, n, n) of the products T_i T_j from the parts along (Q, P) of the first rows of
    ``orthonormalise``, of each value below its own total degree terms (Q,), at most n."""
    out = np.zeros((along.shape[0], n, n))
    total = np.empty(n * (n + 1) // 2)
    for v in range(along.shape[0]):
        total[:] = 0.0
        for degree in range(terms[v]):
            stop = (degree + 1) * (degree + 2) // 2
            first = stop - degree - 1
            whole = first + (degree + 1) // _BLOCK * _BLOCK
            for j in range(first, whole, _BLOCK):
                c0, c1, c2, c3 = rows[j, size:], rows[j + 1, size:], rows[j + 2, size:], rows[j + 3, size:]
                d0, d1, d2, d3 = along[v, j], along[v, j + 1], along[v, j + 2], along[v, j + 3]
                for i in range(stop):
                    total[i] += c0[i] * d0 + c1[i] * d1 + c2[i] * d2 + c3[i] * d3
            for j in range(whole, stop):
                _subtract(total[:stop], -along[v, j], rows[j, size : size + stop])
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
    residual, share = _padded(values.T), np.ones(p.shape[0])
    size = residual.shape[1]
    basis = np.empty((rows + _BLOCK - 1, size + padded(rows)))
    along = np.empty((residual.shape[0], rows + _BLOCK - 1))
    orthonormalise(basis, x, size, 0, n)
    project(basis, 0, rows, residual, share, along)
    found = largest(residual, share, free, np.ones((2, p.shape[0])))
    slopes = polynomials(combine(basis, size, along[:2], np.full(2, n), n), x)
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
