"""Which of several clearances bound a beam, and where nothing does: comparisons on many points, compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_JIT = {"cache": True, "nogil": True}
_LANES = 32  # numbers that are compared at once: a single least one does not vectorise


@njit(**_JIT)
def _least(values):
    """Least of values (N,)."""
    lane, whole = np.full(_LANES, np.inf), values.shape[0] // _LANES * _LANES
    for first in range(0, whole, _LANES):
        block = values[first : first + _LANES]
        for i in range(_LANES):
            lane[i] = min(lane[i], block[i])
    out = np.inf
    for i in range(_LANES):
        out = min(out, lane[i])
    for i in range(whole, values.shape[0]):
        out = min(out, values[i])
    return out


@njit(**_JIT)
def same_disc(p, disc):
    """Whether points p (N, 2), moved onto the unit disc about the middle of the box around them, are those of disc."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for i in range(p.shape[0]):
        for axis in range(2):
            low[axis], high[axis] = min(low[axis], p[i, axis]), max(high[axis], p[i, axis])
    centre, square = 0.5 * (low + high), 0.0
    for i in range(p.shape[0]):
        square = max(square, (p[i, 0] - centre[0]) ** 2 + (p[i, 1] - centre[1]) ** 2)
    half = math.sqrt(square)
    for i in range(p.shape[0]):
        for axis in range(2):
            if not abs(p[i, axis] - centre[axis] - half * disc[i, axis]) < 1e-9 * half:
                return False
    return True


@njit(**_JIT)
def near_zero(clearance, ample):
    """Rows of clearance (K, N) that somewhere are below ``ample``, their numbers; the least of all if there is none."""
    least, rows, found, lowest = np.empty(clearance.shape[0]), np.empty(clearance.shape[0], np.int64), 0, 0
    for k in range(clearance.shape[0]):
        least[k] = _least(clearance[k])
        lowest = k if least[k] < least[lowest] else lowest
        if least[k] < ample:
            rows[found] = k
            found += 1
    if found == 0:
        rows[0], found = lowest, 1
    taken = np.empty((found, clearance.shape[1]))
    for k in range(found):
        taken[k] = clearance[rows[k]]
    return taken, rows[:found]


@njit(**_JIT)
def _on_grid(stacked, along):
    """Values (G, K, G) on a grid of the sums of stacked (n, K, n) times along (n, G) in either direction, x first."""
    n, rows, size = stacked.shape[0], stacked.shape[1], along.shape[1]
    half = np.dot(stacked.reshape(n * rows, n), along)
    return np.dot(np.ascontiguousarray(along.T), half.reshape(n, rows * size)).reshape(size, rows, size)


@njit(**_JIT)
def on_grid(coef, along):
    """Values (G, K, G) of Chebyshev products coef (K, n, n) on a grid, x first; along (n', G), n' >= n: the Chebyshev
    polynomials on its axes."""
    n = terms_used(coef)
    stacked = np.empty((n, coef.shape[0], n))
    for i in range(n):
        for k in range(coef.shape[0]):
            stacked[i, k] = coef[k, i, :n]
    return _on_grid(stacked, along[:n])


@njit(**_JIT)
def bounding_polynomials(coef, order, powers, limiting, same):
    """``bounding`` of polynomials on a grid over the unit disc; the one that is least there if none bounds.

    coef (K, T) of products of powers order (T, 2) of x and y; powers (n, G): those of an axis over [-1, 1].
    """
    n, size = powers.shape
    stacked, count, middle = np.zeros((n, coef.shape[0], n)), 0, size // 2
    away = np.empty(size, np.int64)  # nodes of each line from the middle to the edge
    for i in range(size):
        away[i] = int(middle * math.sqrt(max(1.0 - powers[1, i] ** 2, 0.0)) + 1e-9)
        count += 2 * away[i] + 1
    for k in range(coef.shape[0]):
        for t in range(order.shape[0]):
            stacked[order[t, 0], k, order[t, 1]] = coef[k, t]
    values, dense, at = _on_grid(stacked, powers), np.empty((coef.shape[0], count)), 0
    for i in range(size):
        for k in range(coef.shape[0]):
            dense[k, at : at + 2 * away[i] + 1] = values[i, k, middle - away[i] : middle + away[i] + 1]
        at += 2 * away[i] + 1
    kept = bounding(dense, limiting, same)
    if len(kept):
        return kept
    lowest, least = 0, np.inf
    for k in range(coef.shape[0]):
        low = _least(dense[k])
        lowest, least = (k, low) if low < least else (lowest, least)
    return np.array([lowest])


@njit(**_JIT)
def _below(row, others, limiting):
    """Whether a row (C,) is below ``limiting`` where others (C,) are above minus that."""
    for first in range(0, row.shape[0], 4 * _LANES):
        one, rest, count = row[first : first + 4 * _LANES], others[first : first + 4 * _LANES], 0
        for i in range(one.shape[0]):
            count += (one[i] < limiting) & (rest[i] > -limiting)
        if count > 0:
            return True
    return False


@njit(**_JIT)
def bounding(dense, limiting, same):
    """Indices of the rows of dense (K, N), clearances at points, that bound a beam: those below ``limiting`` somewhere
    where all others are above minus that. Rows that agree to ``same`` everywhere are one. None if all are above it.
    """
    rows, count = dense.shape
    least = np.empty(rows)
    for k in range(rows):
        least[k] = _least(dense[k])
    kept, found = np.empty(rows, np.int64), 0
    others = np.full(count, np.inf)
    for k in np.argsort(least):
        if least[k] >= limiting:  # nor do those that follow come near zero
            break
        row = dense[k]
        cuts = _below(row, others, limiting)
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
                others[i] = min(others[i], row[i])
    first = 0
    for _ in range(found):
        # Again, now that all others are known.
        others[:] = np.inf
        for j in range(found):
            if j != first:
                row = dense[kept[j]]
                for i in range(count):
                    others[i] = min(others[i], row[i])
        if found == 1 or _below(dense[kept[first]], others, limiting):
            first += 1
        else:
            found -= 1
            for j in range(first, found):
                kept[j] = kept[j + 1]
    return kept[:found]


@njit(**_JIT)
def in_light(values, disc, residual):
    """Which clearances, values (G, K, G) on a grid, remain when those go that are positive wherever the others are:
    (K,); and which of them darken a node that all others leave lit, and so remain on every finer grid.

    disc (G, G): clearance of the domain; residual (K,). One goes that exceeds, at nodes where the others are positive
    and where lines of the grid leave these, the residuals and half of what it changes by from one node to the next
    there. They go one by one, the most positive first; two remain.
    """
    size, rows = values.shape[0], values.shape[1]
    kept, cuts, low = np.ones(rows, np.bool_), np.zeros(rows, np.bool_), np.full(rows, np.inf)
    # How many clearances darken each node, and the sum of their numbers: that of the one where it is one.
    dark, who = np.zeros((size, size), np.int32), np.zeros((size, size), np.int32)
    for k in range(rows):
        _darken(values, dark, who, k, 1)
    _alone(dark, who, disc, cuts)
    # One that darkens no node alone takes none from the others: where these are positive, all are.
    lit, shown = np.empty((size, size), np.bool_), np.empty((size, size))
    for i in range(size):
        for j in range(size):
            lit[i, j] = dark[i, j] == 0 and disc[i, j] > 0.0
    for k in range(rows):
        if not cuts[k]:
            for i in range(size):
                for j in range(size):
                    shown[i, j] = values[i, k, j] if lit[i, j] else np.inf
            low[k] = _least(shown.reshape(size * size))
        else:
            low[k] = -np.inf
    edges = _leaving(lit)
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
        least, step = low[k], 0.0
        for e in range(edges.shape[0]):
            i, j, di, dj = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
            here, there = disc[i, j], disc[i - di, j - dj]
            for m in range(rows):
                if kept[m] and m != k:
                    here, there = min(here, values[i, m, j]), min(there, values[i - di, m, j - dj])
            change = values[i - di, k, j - dj] - values[i, k, j]
            least = min(least, values[i, k, j] + here / (here - there) * change)
            step = max(step, abs(change))
        if least > residual[k] + 2.0 * worst + 0.5 * step:
            kept[k] = False
            left -= 1
            _darken(values, dark, who, k, -1)
            _alone(dark, who, disc, cuts)
    return kept, cuts


@njit(**_JIT)
def _darken(values, dark, who, k, sign):
    """Count clearance k of values (G, K, G) in at the nodes that it darkens, or out (sign)."""
    number = np.int32(sign * k)
    one = np.int32(sign)
    none = np.int32(0)
    for i in range(values.shape[0]):
        row, count, name = values[i, k], dark[i], who[i]
        for j in range(row.shape[0]):
            count[j] += none if row[j] > 0.0 else one
            name[j] += none if row[j] > 0.0 else number


@njit(**_JIT)
def _alone(dark, who, disc, cuts):
    """Mark in cuts (K,) the clearances that darken a node of the domain alone; see ``in_light``."""
    for i in range(dark.shape[0]):
        for j in range(dark.shape[1]):
            if dark[i, j] == 1 and disc[i, j] > 0.0:
                cuts[who[i, j]] = True


@njit(**_JIT)
def _leaving(lit):
    """(E, 4) where lines of a grid leave its nodes lit (G, G): a node, and the step back to the one before it."""
    size = lit.shape[0]
    out, found = np.empty((2 * size * size, 4), np.int64), 0
    for i in range(size):
        for j in range(size):
            for di, dj in ((0, 1), (1, 0)):
                if i >= di and j >= dj and lit[i, j] != lit[i - di, j - dj]:
                    out[found, 0], out[found, 1], out[found, 2], out[found, 3] = i, j, di, dj
                    found += 1
    return out[:found]


@njit(**_JIT)
def unshadowed(coef, residual, coarse, fine):
    """(K,) which clearances, Chebyshev products coef (K, n, n), remain of ``in_light`` on two grids, one after the
    other; coarse, fine (n', G): the Chebyshev polynomials on their axes."""
    kept = np.ones(coef.shape[0], np.bool_)
    for along in (coarse, fine):
        rows = np.flatnonzero(kept)
        size = along.shape[1]
        disc = np.empty((size, size))
        for i in range(size):
            for j in range(size):
                disc[i, j] = 1.0 - along[1, i] ** 2 - along[1, j] ** 2
        left, cuts = in_light(on_grid(coef[rows], along), disc, residual[rows])
        kept[rows] = left
        if np.all(cuts[left]):
            break
    return kept


@njit(**_JIT)
def beyond(values, axis, normal, height):
    """(D,) beyond which tangents, normal (D, 2) · u = height (D,), clearances may all be positive.

    values (G, K, G) of these on a grid over the unit disc, axis (G,); between two nodes they may change by as much as
    from one to the next.
    """
    size = axis.shape[0]
    least = np.empty((size, size))
    for i in range(size):
        for j in range(size):
            least[i, j] = values[i, 0, j]
        for k in range(1, values.shape[1]):
            for j in range(size):
                least[i, j] = min(least[i, j], values[i, k, j])
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
    by_x, by_y = np.ascontiguousarray(normal[:, 0]), np.ascontiguousarray(normal[:, 1])
    for i in range(x.shape[0]):
        a, b = x[i, 0], x[i, 1]
        for d in range(out.shape[0]):
            out[d] = max(out[d], a * by_x[d] + b * by_y[d])
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
