"""Compiled integrals of products of amplitudes over a pupil region, ray by ray (see ``kernels.outline``), by adaptive
panels.

Nothing oscillates here, so that one level of panels tells its own error: by the end of the Legendre series in angle
through a panel's nodes. Along a ray all is polynomial, and enough nodes are exact.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cgi_wave.kernels.outline import (
    GAUSS,
    GW,
    GX,
    MAX_INTERVALS,
    crossings,
    intervals_of,
    restrict_many,
    warp,
)
from cgi_wave.kernels.polynomials import horner

_FIRST = 1.6  # angle (rad) of a panel before any is halved
_DEEPEST = 12  # how often one is
_LAST = 3  # Legendre coefficients at the end of a panel's series that bound what follows them
_LEGENDRE = np.polynomial.legendre.legvander(2.0 * GX - 1.0, GAUSS - 1)[:, GAUSS - _LAST :]
# Row l: (2 l + 1) times the weights, for the coefficient of P_l on (0, 1).
_TAIL = np.ascontiguousarray(_LEGENDRE.T * GW * (2.0 * np.arange(GAUSS - _LAST, GAUSS) + 1.0)[:, None])


@njit(cache=True, nogil=True)
def products(clear, ellipses, residual, spans, turning, amp, gx, gw, tol):
    """Integrals over the region of all products of amplitudes amp (S, n, n), powers of the frame.

    residual (K,): error of each clearance; spans (B, 2), turning (B,): segments of angle; gx, gw: Gauss nodes and
    weights on (0, 1) that integrate 2 n − 1 powers; tol: absolute error per rad above which a panel is halved.

    Returns (sums (S, S), area, edge: integral of the middle amplitude squared over the strip that the residual leaves
    open, tail: error of the largest square, between: area between boundaries that were taken as one).
    """
    count_s, n, nodes = amp.shape[0], amp.shape[1], gx.shape[0]
    middle = count_s // 2
    sums, part = np.zeros((count_s, count_s)), np.empty((count_s, count_s))
    at, power = np.empty(count_s), np.empty((max(n, clear.shape[1]), GAUSS))
    lines, edges = np.empty((GAUSS, count_s, n)), np.empty((GAUSS, *clear.shape[:2]))
    cosine, sine, slopes = np.empty(GAUSS), np.empty(GAUSS), np.empty(GAUSS)
    size = clear.shape[0] * clear.shape[1] + 1
    places, owner = np.empty(size), np.empty(size, np.int64)
    ends, which, gap = np.empty((MAX_INTERVALS, 2)), np.empty((MAX_INTERVALS, 2), np.int64), np.empty(2)
    f = np.empty(GAUSS)
    area, edge, tail, between = 0.0, 0.0, 0.0, 0.0
    left = np.empty((_DEEPEST + 64, 3))
    for b in range(spans.shape[0]):
        width = spans[b, 1] - spans[b, 0]
        first = max(1, math.ceil(width / _FIRST))
        for k in range(first):
            waiting = 1
            left[0, 0], left[0, 1], left[0, 2] = k / first, (k + 1.0) / first, 0.0
            while waiting > 0:
                waiting -= 1
                t0, t1, depth = left[waiting, 0], left[waiting, 1], left[waiting, 2]
                part[:, :] = 0.0
                here_area, here_edge, here_between = 0.0, 0.0, 0.0
                for g in range(GAUSS):
                    place, slopes[g] = warp(t0 + (t1 - t0) * GX[g], turning[b])
                    theta = spans[b, 0] + width * place
                    cosine[g], sine[g] = math.cos(theta), math.sin(theta)
                restrict_many(amp, cosine, sine, power[:n], lines)
                restrict_many(clear, cosine, sine, power[: clear.shape[1]], edges)
                for g in range(GAUSS):
                    poly, ck, slope, total = lines[g], edges[g], slopes[g], 0.0
                    weight = width * slope * (t1 - t0) * GW[g]
                    found = crossings(ck, ellipses, cosine[g], sine[g], -1, places, owner)
                    count = intervals_of(ck, places, owner, found, ends, which, gap)
                    for j in range(count):
                        lo, length = ends[j, 0], ends[j, 1] - ends[j, 0]
                        for i in range(nodes):
                            rho = lo + length * gx[i]
                            w = length * gw[i] * rho
                            for s in range(count_s):
                                at[s] = horner(poly[s], rho)
                                total += w * at[s] * at[s]
                                for r in range(s + 1):
                                    part[s, r] += weight * w * at[s] * at[r]
                        here_area += weight * 0.5 * (ends[j, 1] ** 2 - lo * lo)
                        for e in range(2):
                            c, x = which[j, e], ends[j, e]
                            if c >= 0:
                                steep = 0.0
                                for i in range(ck.shape[1] - 1, 0, -1):
                                    steep = steep * x + i * ck[c, i]
                                strip = min(residual[c] / max(abs(steep), 1e-300), length)
                                here_edge += horner(poly[middle], x) ** 2 * x * strip * weight
                    here_between += gap[1] * weight
                    f[g] = total * slope
                # The integral is the first coefficient; those at the end of the series bound what nodes miss.
                last = 0.0
                for l in range(_LAST):  # noqa: E741
                    value = 0.0
                    for g in range(GAUSS):
                        value += _TAIL[l, g] * f[g]
                    last += abs(value)
                if last > tol and depth < _DEEPEST:
                    half = 0.5 * (t0 + t1)
                    left[waiting, 0], left[waiting, 1], left[waiting, 2] = t0, half, depth + 1.0
                    left[waiting + 1, 0], left[waiting + 1, 1], left[waiting + 1, 2] = half, t1, depth + 1.0
                    waiting += 2
                    continue
                tail += last * width * (t1 - t0)
                area, edge, between = area + here_area, edge + here_edge, between + here_between
                sums += part
    for s in range(count_s):
        for r in range(s):
            sums[r, s] = sums[s, r]
    return sums, area, edge, tail, between
