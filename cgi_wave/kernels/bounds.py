"""Which of several clearances bound a beam, and where nothing does: comparisons on many points, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

_JIT = {"cache": True, "nogil": True}


@njit(**_JIT)
def bounding(dense, limiting, same):
    """Indices of the rows of dense (K, N), clearances at points, that bound a beam: those below ``limiting`` somewhere
    where all others are above minus that. Rows that agree to ``same`` everywhere are one. None if all are above it.
    """
    rows, count = dense.shape
    least = np.empty(rows)
    for k in range(rows):
        least[k] = dense[k].min()
    kept, found = np.empty(rows, np.int64), 0
    others = np.full(count, np.inf)
    for k in np.argsort(least):
        if least[k] >= limiting:  # nor do those that follow come near zero
            break
        cuts = False
        for i in range(count):
            if dense[k, i] < limiting and others[i] > -limiting:
                cuts = True
                break
        for j in range(found):
            if not cuts:
                break
            alike = True
            for i in range(count):
                if abs(dense[k, i] - dense[kept[j], i]) > same:
                    alike = False
                    break
            cuts = not alike
        if cuts:
            kept[found] = k
            found += 1
            for i in range(count):
                others[i] = min(others[i], dense[k, i])
    first = 0
    for _ in range(found):
        # Again, now that all others are known.
        k = kept[first]
        cuts = found == 1
        for i in range(count):
            if dense[k, i] < limiting:
                least_other = np.inf
                for j in range(found):
                    if j != first:
                        least_other = min(least_other, dense[kept[j], i])
                if least_other > -limiting:
                    cuts = True
                    break
        if cuts:
            first += 1
        else:
            found -= 1
            for j in range(first, found):
                kept[j] = kept[j + 1]
    return kept[:found]


@njit(**_JIT)
def in_light(values, disc, residual):
    """(K,) which clearances, values (K, G, G) on a grid, remain when those go that are positive wherever the others
    are.

    disc (G, G): clearance of the domain; residual (K,). One goes that exceeds, at nodes where the others are positive
    and where lines of the grid leave these, the residuals and half of what it changes by from one node to the next
    there. They go one by one, the most positive first; two remain.
    """
    rows, size = values.shape[0], values.shape[1]
    kept = np.ones(rows, np.bool_)
    low = np.full(rows, np.inf)
    # The least two clearances at each node, and which the first of them is: what the others leave when one is taken
    # away.
    one, two, first = np.empty((size, size)), np.empty((size, size)), np.empty((size, size), np.int64)
    rest = np.empty((size, size))
    cuts = np.zeros(rows, np.bool_)
    for i in range(size):
        _least_two(values[:, i], kept, one[i], two[i], first[i])
        for j in range(size):
            if one[i, j] > 0.0 and disc[i, j] > 0.0:
                for k in range(rows):
                    low[k] = min(low[k], values[k, i, j])
            elif disc[i, j] > 0.0 and two[i, j] > 0.0:
                cuts[first[i, j]] = True  # dark by this one alone
    left = rows
    for k in np.argsort(-low):
        if left < 3:
            break
        worst = 0.0
        for j in range(rows):
            if kept[j] and j != k:
                worst = max(worst, residual[j])
        if cuts[k] or low[k] <= residual[k] + 2.0 * worst:
            continue
        least, step = np.inf, 0.0
        own = values[k]
        for i in range(size):
            for j in range(size):
                rest[i, j] = min(two[i, j] if first[i, j] == k else one[i, j], disc[i, j])
            for j in range(size):
                least = min(least, own[i, j] if rest[i, j] > 0.0 else np.inf)
        for i in range(size):
            for j in range(1, size):
                if (rest[i, j] > 0.0) != (rest[i, j - 1] > 0.0):
                    change = own[i, j - 1] - own[i, j]
                    least = min(least, own[i, j] + rest[i, j] / (rest[i, j] - rest[i, j - 1]) * change)
                    step = max(step, abs(change))
        for i in range(1, size):
            for j in range(size):
                if (rest[i, j] > 0.0) != (rest[i - 1, j] > 0.0):
                    change = own[i - 1, j] - own[i, j]
                    least = min(least, own[i, j] + rest[i, j] / (rest[i, j] - rest[i - 1, j]) * change)
                    step = max(step, abs(change))
        if least > residual[k] + 2.0 * worst + 0.5 * step:
            kept[k] = False
            left -= 1
            for i in range(size):
                _least_two(values[:, i], kept, one[i], two[i], first[i])
    return kept


@njit(**_JIT)
def _least_two(values, kept, one, two, first):
    """The least and the second of the kept rows of values (K, G), (G,) each, and the number of the least."""
    one[:] = np.inf
    two[:] = np.inf
    for k in range(values.shape[0]):
        if kept[k]:
            for j in range(one.shape[0]):
                v = values[k, j]
                two[j] = min(two[j], max(one[j], v))
                first[j] = k if v < one[j] else first[j]
                one[j] = min(one[j], v)


@njit(**_JIT)
def beyond(values, axis, normal, height):
    """(D,) beyond which tangents, normal (D, 2) · u = height (D,), clearances may all be positive.

    values (K, G, G) of these on a grid over the unit disc, axis (G,); between two nodes they may change by as much as
    from one to the next.
    """
    size = axis.shape[0]
    least = np.empty((size, size))
    for i in range(size):
        for j in range(size):
            least[i, j] = values[0, i, j]
            for k in range(1, values.shape[0]):
                least[i, j] = min(least[i, j], values[k, i, j])
    out = np.zeros(height.shape[0], np.bool_)
    for i in range(size):
        for j in range(size):
            if axis[i] ** 2 + axis[j] ** 2 > 1.0:
                continue
            change, here = 0.0, least[i, j]
            if i > 0:
                change = max(change, abs(here - least[i - 1, j]))
            if i < size - 1:
                change = max(change, abs(here - least[i + 1, j]))
            if j > 0:
                change = max(change, abs(here - least[i, j - 1]))
            if j < size - 1:
                change = max(change, abs(here - least[i, j + 1]))
            if here > -change:
                for d in range(height.shape[0]):
                    if axis[i] * normal[d, 0] + axis[j] * normal[d, 1] > height[d]:
                        out[d] = True
    return out


@njit(**_JIT)
def heights(x, normal):
    """(D,) how far points x (N, 2) reach along normals (D, 2)."""
    out = np.full(normal.shape[0], -np.inf)
    for d in range(normal.shape[0]):
        for i in range(x.shape[0]):
            out[d] = max(out[d], x[i, 0] * normal[d, 0] + x[i, 1] * normal[d, 1])
    return out


@njit(**_JIT)
def terms_used(coef):
    """Terms per axis up to the last that any of the polynomials (K, n, n) has."""
    for n in range(coef.shape[1], 1, -1):
        for k in range(coef.shape[0]):
            for i in range(n):
                if coef[k, i, n - 1] != 0.0 or coef[k, n - 1, i] != 0.0:
                    return n
    return 1


@njit(**_JIT)
def count_open(coef, rim, along, normal, height):
    """How many points of an edge lie in the unit disc and within all tangents, normal (D, 2) · u = height (D,), and at
    how many of these all Chebyshev products coef (K, n, n) are positive.

    The edge: points rim (R, 2) of the unit circle, and those at distances along (A,) from the foot of each tangent.
    """
    n = terms_used(coef)
    tx, ty = np.empty(n), np.empty(n)
    inside, open_there = 0, 0
    for p in range(rim.shape[0] + height.shape[0] * along.shape[0]):
        if p < rim.shape[0]:
            x, y = rim[p, 0], rim[p, 1]
        else:
            d, place = (p - rim.shape[0]) // along.shape[0], along[(p - rim.shape[0]) % along.shape[0]]
            x, y = height[d] * normal[d, 0] - place * normal[d, 1], height[d] * normal[d, 1] + place * normal[d, 0]
        within = x * x + y * y <= 1.0 + 1e-9
        for d in range(height.shape[0]):
            within = within and x * normal[d, 0] + y * normal[d, 1] <= height[d] + 1e-9
        if not within:
            continue
        inside += 1
        tx[0], ty[0] = 1.0, 1.0
        if n > 1:
            tx[1], ty[1] = x, y
        for k in range(2, n):
            tx[k] = 2.0 * x * tx[k - 1] - tx[k - 2]
            ty[k] = 2.0 * y * ty[k - 1] - ty[k - 2]
        positive = True
        for k in range(coef.shape[0]):
            value = 0.0
            for i in range(n):
                row = 0.0
                for j in range(n - i):
                    row += coef[k, i, j] * ty[j]
                value += row * tx[i]
            if not value > 0.0:
                positive = False
                break
        open_there += int(positive)
    return inside, open_there
