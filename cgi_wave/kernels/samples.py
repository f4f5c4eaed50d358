"""Samples of a field made ready for a fit: which are lit, which take part, what is fitted; which clearances cut."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_JIT = {"cache": True, "nogil": True}


@njit(**_JIT)
def not_finite(values):
    """How many of an array's values are not finite."""
    count, flat = 0, values.ravel()
    for i in range(flat.shape[0]):
        count += not math.isfinite(flat[i])
    return count


@njit(**_JIT)
def prepared(u, clearance, margin, sparse):
    """Which samples u (S, N, 2) are lit, clearance (K, S, N) > 0, and which take part in a fit.

    The domain is the ellipse that bounds the lit ones, wider by ``margin`` sample spacings, of which one is taken as
    ``sparse`` (in units of the ellipse) at most. Those in it take part that are lit or within a spacing of one that is:
    they hold the boundary; those further out would only ask the polynomial for what it need not do.

    Returns lit (S, N), counts (S,), centre, half (2,) of the box around the lit ones, scale (2,), spacing, x (S, N, 2)
    in units of the domain, inside (S, N). Where a count or a half is 0, what follows it means nothing.
    """
    count_k, count_s, count_n = clearance.shape
    lit, counts = np.ones((count_s, count_n), np.bool_), np.zeros(count_s, np.int64)
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for s in range(count_s):
        for k in range(count_k):
            for i in range(count_n):
                lit[s, i] = lit[s, i] and clearance[k, s, i] > 0.0
        for i in range(count_n):
            if lit[s, i]:
                counts[s] += 1
                for axis in range(2):
                    low[axis], high[axis] = min(low[axis], u[s, i, axis]), max(high[axis], u[s, i, axis])
    centre, half, x = 0.5 * (low + high), 0.5 * (high - low), np.empty(u.shape)
    inside = np.zeros((count_s, count_n), np.bool_)
    if counts.min() == 0 or not half.min() > 0.0:
        return lit, counts, centre, half, half, 0.0, x, inside
    reach = 0.0
    for s in range(count_s):
        for i in range(count_n):
            if lit[s, i]:
                a, b = (u[s, i, 0] - centre[0]) / half[0], (u[s, i, 1] - centre[1]) / half[1]
                reach = max(reach, a * a + b * b)
    spacing = min(math.sqrt(math.pi / counts.min()), sparse)
    scale = half * math.sqrt(reach) * (1.0 + margin * spacing)
    for s in range(count_s):
        for i in range(count_n):
            for axis in range(2):
                x[s, i, axis] = (u[s, i, axis] - centre[axis]) / scale[axis]
        inside[s] = near_points(x[s], lit[s], spacing)
    return lit, counts, centre, half, scale, spacing, x, inside


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
def gathered(opl, amplitude, clearance, direction, lit, take, with_rest, fewest):
    """What is fitted at the samples of a mask take (N,): see ``kernels.fit.climb`` for the order of its rows.

    opl, amplitude (S, N), lit (S, N), clearance (K, S, N), direction (N, 2); with_rest: with clearances and directions,
    those at the middle wavenumber. Clearances count within a quarter of their range from zero, since elsewhere a misfit
    moves nothing; everywhere, if that is at fewer than ``fewest`` samples.

    Returns values (Q, M), chosen (Q, M), clearance, edge (S, K, M) at all wavenumbers, and the mean path lengths (S,)
    that are left out of the values.
    """
    count_k, count_s, _ = clearance.shape
    at = np.flatnonzero(take)
    size, middle = at.shape[0], count_s // 2
    rows = 2 * count_s + (count_k + 2 if with_rest else 0)
    values, chosen = np.empty((rows, size)), np.zeros((rows, size), np.bool_)
    near, edge = np.empty((count_s, count_k, size)), np.zeros((count_s, count_k, size), np.bool_)
    means = np.empty(count_s)
    for s in range(count_s):
        means[s] = mean = opl[s].mean()
        for m in range(size):
            values[s, m], values[count_s + s, m] = opl[s, at[m]] - mean, amplitude[s, at[m]]
            chosen[s, m] = chosen[count_s + s, m] = lit[s, at[m]]
        for k in range(count_k):
            largest, count = 0.0, 0
            for m in range(size):
                near[s, k, m] = clearance[k, s, at[m]]
                if lit[s, at[m]]:
                    largest = max(largest, abs(near[s, k, m]))
            for m in range(size):
                edge[s, k, m] = abs(near[s, k, m]) <= 0.25 * largest
                count += edge[s, k, m]
            if count < fewest:
                edge[s, k] = True
    if with_rest:
        first = 2 * count_s
        values[first : first + count_k], chosen[first : first + count_k] = near[middle], edge[middle]
        for m in range(size):
            values[-2, m], values[-1, m] = direction[at[m], 0], direction[at[m], 1]
    return values, chosen, near, edge, means


@njit(**_JIT)
def least_and_range(clearance, lit):
    """(K, 2) least value of each clearance (K, S, N) over the lit samples (S, N), and its range there."""
    out = np.empty((clearance.shape[0], 2))
    for k in range(clearance.shape[0]):
        low, high = np.inf, -np.inf
        for s in range(clearance.shape[1]):
            for i in range(clearance.shape[2]):
                if lit[s, i]:
                    low, high = min(low, clearance[k, s, i]), max(high, clearance[k, s, i])
        out[k, 0], out[k, 1] = low, high - low
    return out
