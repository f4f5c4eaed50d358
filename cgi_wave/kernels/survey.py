"""Where several clearances are positive together, on grids; and the range of polynomials there.

Clearances are Chebyshev products coef[i, j] T_i(X) T_j(Y), i + j < n, on coordinates (u − centre) / scale of the
support they belong to, which is an ellipse of unit radius in these.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cgi_wave.kernels.polynomials import JIT, expanded

GRID = 41
_ROUNDS = 14  # refinements of the grid: slivers down to 1e-7 of the box are found
_CHUNK = 64


@njit(**JIT)
def _chebyshev(at, centre, scale, out):
    """T_i at (at − centre) / scale: out (n, G)."""
    for g in range(at.shape[0]):
        x = (at[g] - centre) / scale
        out[0, g] = 1.0
        if out.shape[0] > 1:
            out[1, g] = x
        for i in range(2, out.shape[0]):
            out[i, g] = 2.0 * x * out[i - 1, g] - out[i - 2, g]


@njit(**JIT)
def _on_grid(clearance, support, centre, scale, x, y, every, least):
    """Fills every (K, G, G) with all clearances on a grid, and least (G, G) with the least, the domains among them."""
    n, first = clearance.shape[1], 0
    across, along = np.empty((n, x.shape[0])), np.empty((n, y.shape[0]))
    least[:] = np.inf
    for s in range(centre.shape[0]):
        a, b = ((x - centre[s, 0]) / scale[s, 0]) ** 2, ((y - centre[s, 1]) / scale[s, 1]) ** 2
        for g in range(x.shape[0]):
            for h in range(y.shape[0]):
                least[g, h] = min(least[g, h], 1.0 - a[g] - b[h])
        _chebyshev(x, centre[s, 0], scale[s, 0], across)
        _chebyshev(y, centre[s, 1], scale[s, 1], along)
        while first < clearance.shape[0] and support[first] == s:
            every[first] = np.dot(across.T, np.dot(clearance[first], along))
            for g in range(x.shape[0]):
                for h in range(y.shape[0]):
                    least[g, h] = min(least[g, h], every[first, g, h])
            first += 1


@njit(**JIT)
def _cells(grid):
    """(K,) largest changes of functions (K, G, G) over one cell."""
    out = np.zeros(grid.shape[0])
    for k in range(grid.shape[0]):
        across, along = 0.0, 0.0
        for g in range(grid.shape[1]):
            for h in range(grid.shape[2]):
                if g > 0:
                    across = max(across, abs(grid[k, g, h] - grid[k, g - 1, h]))
                if h > 0:
                    along = max(along, abs(grid[k, g, h] - grid[k, g, h - 1]))
        out[k] = across + along
    return out


@njit(**JIT)
def _needless(grid, cell, keep, k):
    """Whether clearance k is positive wherever the other kept ones are, by more than changes over a cell."""
    for g in range(grid.shape[1]):
        for h in range(grid.shape[2]):
            if grid[k, g, h] > cell[k]:
                continue
            shut = False
            for j in range(grid.shape[0]):
                shut = shut or (keep[j] and j != k and grid[j, g, h] <= -cell[j])
            if not shut:
                return False
    return True


@njit(**JIT)
def _bounding(grids, refined):
    """Which clearances, given on two grids (2, K, G, G), can bound the region: others are positive where the rest are.

    All comparisons leave the change over one cell as a margin. Clearances go one by one, the most positive first. One
    of the grids, the first, has to cover all that rays can reach, or a piece that only a dropped clearance excludes
    would appear; the second counts if ``refined``.
    """
    count, used = grids.shape[1], 2 if refined else 1
    keep, left, lowest, cells = np.ones(count, np.bool_), count, np.empty(count), np.empty((used, count))
    for k in range(count):
        lowest[k] = -grids[used - 1, k].min()
    for q in range(used):
        cells[q] = _cells(grids[q])
    for k in np.argsort(lowest):
        needless = left > 1
        for q in range(used):
            needless = needless and _needless(grids[q], cells[q], keep, k)
        if needless:
            keep[k] = False
            left -= 1
    return keep


@njit(**JIT)
def survey(clearance, support, centre, scale):
    """Where all clearances (K, n, n) and all domains are positive together: (pivot (2,), frame (2,), points, keep).

    support (K,): which of the domains centre, scale (S, 2) each belongs to, ascending. A grid over the common box is
    refined about its best point until it shows positive clearance, then about the lit points until they fill it; these
    are points (G, 2) in units of frame about pivot, none if there are none. keep (K,): clearances that can bound them.
    """
    lo, hi = np.empty(2), np.empty(2)
    pivot, frame, step = np.zeros(2), np.ones(2), np.empty(2)
    for a in range(2):
        lo[a], hi[a] = (centre[:, a] - scale[:, a]).max(), (centre[:, a] + scale[:, a]).min()
    count = clearance.shape[0]
    keep = np.ones(count, np.bool_)
    if hi[0] <= lo[0] or hi[1] <= lo[1]:
        return pivot, frame, np.empty((0, 2)), keep
    grids, least = np.empty((2, count, GRID, GRID)), np.empty((GRID, GRID))
    x, y = np.linspace(lo[0], hi[0], GRID), np.linspace(lo[1], hi[1], GRID)
    _on_grid(clearance, support, centre, scale, x, y, grids[0], least)
    points, lit, refined = np.empty((GRID * GRID, 2)), 0, False
    for _ in range(_ROUNDS):
        step[0], step[1] = x[1] - x[0], y[1] - y[0]
        lit, top, right, left, most, best = 0, 0, 0, GRID, -np.inf, (0, 0)
        bottom = GRID
        for g in range(GRID):
            for h in range(GRID):
                if least[g, h] > most:
                    most, best = least[g, h], (g, h)
                if least[g, h] > 0.0:
                    points[lit, 0], points[lit, 1] = x[g], y[h]
                    lit += 1
                    bottom, top, left, right = min(bottom, g), max(top, g), min(left, h), max(right, h)
        if lit == 0:
            lo[0], hi[0] = x[best[0]] - 6.0 * step[0], x[best[0]] + 6.0 * step[0]
            lo[1], hi[1] = y[best[1]] - 6.0 * step[1], y[best[1]] + 6.0 * step[1]
        else:
            if lit >= GRID * GRID // 5 or (top - bottom > GRID // 2 and right - left > GRID // 2):
                break
            lo[0], hi[0] = x[bottom] - 1.5 * step[0], x[top] + 1.5 * step[0]
            lo[1], hi[1] = y[left] - 1.5 * step[1], y[right] + 1.5 * step[1]
        x, y = np.linspace(lo[0], hi[0], GRID), np.linspace(lo[1], hi[1], GRID)
        _on_grid(clearance, support, centre, scale, x, y, grids[1], least)
        refined = True
    found = points[:lit].copy()
    if lit > 0:
        for a in range(2):
            pivot[a] = found[:, a].mean()
            frame[a] = np.abs(found[:, a] - pivot[a]).max() + 1.5 * step[a]
            found[:, a] = (found[:, a] - pivot[a]) / frame[a]
        keep = _bounding(grids, refined)
    return pivot, frame, found, keep


@njit(**JIT)
def common(clearance, support, centre, scale):
    """``survey``, and what bounds it in its own frame: (pivot, frame, points, keep, powers, ellipses).

    powers (kept, k, k): of the kept clearances, no larger than their degree asks for; ellipses (S, 4): centres and
    semi-axes of the domains.
    """
    pivot, frame, points, keep = survey(clearance, support, centre, scale)
    n, top, kept, row = clearance.shape[1], 1, 0, 0
    powers, ellipses = np.empty((clearance.shape[0], n, n)), np.empty((centre.shape[0], 4))
    for s in range(centre.shape[0]):
        ellipses[s, :2], ellipses[s, 2:] = (centre[s] - pivot) / frame, scale[s] / frame
        first = row
        while row < clearance.shape[0] and support[row] == s:
            row += 1
        here = expanded(clearance[first:row], (pivot - centre[s]) / scale[s], frame / scale[s], n)
        for k in range(first, row):
            if keep[k]:
                powers[kept] = here[k - first]
                kept += 1
    for k in range(kept):
        for i in range(n):
            for j in range(n - i):
                if powers[k, i, j] != 0.0:
                    top = max(top, i + 1, j + 1)
    return pivot, frame, points, keep, powers[:kept, :top, :top].copy(), ellipses


@njit(**JIT)
def spread(poly, points):
    """max − min over points (G, 2) of a polynomial (n, n), powers of their coordinates."""
    n, least, largest = poly.shape[0], np.inf, -np.inf
    x, y, row, value = np.empty(_CHUNK), np.empty(_CHUNK), np.empty(_CHUNK), np.empty(_CHUNK)
    for start in range(0, points.shape[0], _CHUNK):
        count = min(_CHUNK, points.shape[0] - start)
        for p in range(_CHUNK):
            q = start + min(p, count - 1)
            x[p], y[p], value[p] = points[q, 0], points[q, 1], 0.0
        for i in range(n - 1, -1, -1):
            row[:] = 0.0
            for j in range(n - 1 - i, -1, -1):
                c = poly[i, j]
                for p in range(_CHUNK):
                    row[p] = row[p] * y[p] + c
            for p in range(_CHUNK):
                value[p] = value[p] * x[p] + row[p]
        for p in range(_CHUNK):
            least, largest = min(least, value[p]), max(largest, value[p])
    return largest - least
