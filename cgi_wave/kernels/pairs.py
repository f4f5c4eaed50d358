"""Every beam against every other on shared pupil points: what a plan of pairs asks, in one pass each."""

from __future__ import annotations

import numpy as np
from numba import njit

_JIT = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(**_JIT)
def ranges(group, tilt, least, most):
    """Least and largest difference of group (B, N), mean difference of tilt (B, N), of all pairs: (B, B) each.

    Values are NaN at points that a beam does not cover; only points that both cover count. Pairs without one get the
    range that least and most (B,), of all of each beam, leave open, and NaN.
    """
    beams, points = group.shape
    low, high = np.zeros((beams, beams)), np.zeros((beams, beams))
    mean = np.zeros((beams, beams))
    for m in range(beams):
        for l in range(m + 1, beams):  # noqa: E741
            lo, hi, total, count = np.inf, -np.inf, 0.0, 0
            for i in range(points):
                difference = group[m, i] - group[l, i]
                if difference == difference:  # not NaN
                    lo, hi = min(lo, difference), max(hi, difference)
                    total += tilt[m, i] - tilt[l, i]
                    count += 1
            if count == 0:
                lo, hi, total = least[m] - most[l], most[m] - least[l], np.nan
            low[m, l], high[m, l] = lo, hi
            low[l, m], high[l, m] = -hi, -lo
            mean[m, l] = total / max(count, 1)
            mean[l, m] = -mean[m, l]
    return low, high, mean


@njit(**_JIT)
def curvatures(points, phase, first, second, fewest):
    """Principal curvatures of the phase differences of P pairs (first, second), fitted by a quadratic: (P, 2).

    points (N, 2); phase (B, N), NaN where a beam does not cover a point. The unit of length is half the larger side of
    the box around the shared points. NaN where fewer than ``fewest`` are shared or the difference spans less than 1.
    """
    out = np.full((first.shape[0], 2), np.nan)
    basis = np.empty(6)
    for pair in range(first.shape[0]):
        difference = phase[first[pair]] - phase[second[pair]]
        lo, hi = np.full(3, np.inf), np.full(3, -np.inf)
        middle, count = np.zeros(2), 0
        for i in range(points.shape[0]):
            if difference[i] == difference[i]:
                count += 1
                for axis in range(3):
                    value = points[i, axis] if axis < 2 else difference[i]
                    lo[axis], hi[axis] = min(lo[axis], value), max(hi[axis], value)
                middle += points[i]
        if count < fewest or hi[2] - lo[2] < 1.0:
            continue
        middle /= count
        half = 0.5 * max(hi[0] - lo[0], hi[1] - lo[1])
        normal, right = np.zeros((6, 6)), np.zeros(6)
        for i in range(points.shape[0]):
            if difference[i] == difference[i]:
                x, y = (points[i, 0] - middle[0]) / half, (points[i, 1] - middle[1]) / half
                basis[0], basis[1], basis[2], basis[3], basis[4], basis[5] = 1.0, y, y * y, x, x * y, x * x
                for a in range(6):
                    right[a] += basis[a] * difference[i]
                    for b in range(6):
                        normal[a, b] += basis[a] * basis[b]
        c = np.linalg.solve(normal, right)
        # Eigenvalues of [[c5, c4/2], [c4/2, c2]].
        centre, radius = 0.5 * (c[5] + c[2]), np.sqrt((0.5 * (c[5] - c[2])) ** 2 + (0.5 * c[4]) ** 2)
        out[pair, 0], out[pair, 1] = centre - radius, centre + radius
    return out
