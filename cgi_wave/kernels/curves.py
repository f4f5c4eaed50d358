"""The boundary of a pupil region as curves: polynomials through the ends of rays (``kernels.outline``)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cgi_wave.kernels.outline import GAUSS, GX, MAX_INTERVALS, crossings, intervals_of, restrict_many, spans, warp
from cgi_wave.kernels.polynomials import JIT

_TO_CHEB = np.linalg.inv(np.polynomial.chebyshev.chebvander(2.0 * GX - 1.0, GAUSS - 1))
_TO_POWER = np.zeros((GAUSS, GAUSS))  # Chebyshev coefficients -> powers
for _k in range(GAUSS):
    _TO_POWER[: _k + 1, _k] = np.polynomial.chebyshev.cheb2poly(np.eye(GAUSS)[_k])[: _k + 1]
_LAST = 3  # Chebyshev coefficients at the end of a series that say what follows
_WIDEST = 1.6  # rad of a piece before any is halved: few arcs resolve wider


@njit(**JIT)
def boundary(clear, ellipses, scan, limit, tolerance, most):
    """Boundary of a region as smooth curves, the region to their left.

    Returns (curves (C, 2, 16): powers of s in [-1, 1] of x(s) and y(s); owner (C,): the clearance that is 0 on each,
    or −2 for a domain; missed: largest of the series' last terms and of the gaps between boundaries taken as one, in
    frame units; the number of its corners). Pieces are halved until the series end below tolerance. No curves and
    missed = inf: more than ``most`` curves, or than ``limit`` corners, or a number of intervals that changes between.
    """
    out, owner, missed, found = np.empty((most, 2, GAUSS)), np.empty(most, np.int64), 0.0, 0
    ranges, turning, corners = spans(clear, ellipses, scan, limit)
    if ranges.shape[0] == 0:
        return out[:0], owner[:0], np.inf, corners
    for b in range(ranges.shape[0]):
        found, off = _between(clear, ellipses, ranges[b], turning[b], tolerance, out, owner, found)
        missed = max(missed, off)
        if missed == np.inf:
            return out[:0], owner[:0], missed, corners
    return out[:found].copy(), owner[:found].copy(), missed, corners


@njit(**JIT)
def _between(clear, ellipses, span, turning, tolerance, out, owner, found):
    """``boundary`` within one range of angles: appends to out and owner; (curves found, missed)."""
    ends, which = np.empty((MAX_INTERVALS, 2)), np.empty((MAX_INTERVALS, 2), np.int64)
    at = np.empty((MAX_INTERVALS, 2, 2, GAUSS))
    count_k, n = clear.shape[0], clear.shape[1]
    crossing, whose = np.empty(count_k * n + 1), np.empty(count_k * n + 1, np.int64)
    lines, cosine, sine = np.empty((GAUSS, count_k, n)), np.empty(GAUSS), np.empty(GAUSS)
    power, series = np.empty((n, GAUSS)), np.empty(GAUSS)
    side, between = np.empty((MAX_INTERVALS, 2), np.int64), np.empty(2)
    pieces, missed, width = np.empty((64, 2)), 0.0, span[1] - span[0]
    top = math.ceil(width / _WIDEST)
    for k in range(top):
        pieces[k, 0], pieces[k, 1] = k / top, (k + 1.0) / top
    while top > 0:
        top -= 1
        t0, t1, count = pieces[top, 0], pieces[top, 1], -1
        for g in range(GAUSS):
            theta = span[0] + width * warp(t0 + (t1 - t0) * GX[g], turning)[0]
            cosine[g], sine[g] = math.cos(theta), math.sin(theta)
        restrict_many(clear, cosine, sine, power, lines)
        for g in range(GAUSS):
            first = max(side[count - 1, 1], 0) if count > 0 else 0
            found_here = crossings(lines[g], ellipses, cosine[g], sine[g], first, crossing, whose)
            here = intervals_of(lines[g], crossing, whose, found_here, ends, which, between)
            if here < 0 or (count >= 0 and here != count):
                return found, np.inf
            count, missed = here, max(missed, between[0])
            for j in range(count):
                for e in range(2):
                    side[j, e] = which[j, e]
                    at[j, e, 0, g], at[j, e, 1, g] = ends[j, e] * cosine[g], ends[j, e] * sine[g]
        worst = 0.0
        for j in range(count):
            for e in range(2):
                for axis in range(2):
                    for k in range(GAUSS - _LAST, GAUSS):
                        worst = max(worst, abs(_dot(_TO_CHEB[k], at[j, e, axis])))
        if worst > tolerance and t1 - t0 > 1e-3:
            if top + 2 > pieces.shape[0]:
                return found, np.inf
            pieces[top, 0], pieces[top, 1] = t0, 0.5 * (t0 + t1)
            pieces[top + 1, 0], pieces[top + 1, 1] = 0.5 * (t0 + t1), t1
            top += 2
            continue
        missed = max(missed, worst)
        for j in range(count):
            for e in range(2):
                if side[j, e] == -1:
                    continue  # the pivot: a point, not a boundary
                if found == owner.shape[0]:
                    return found, np.inf
                for axis in range(2):
                    for k in range(GAUSS):
                        series[k] = _dot(_TO_CHEB[k], at[j, e, axis])
                    for k in range(GAUSS):
                        # outer ends run with growing angle, inner ones against it
                        sign = 1.0 if e == 1 or k % 2 == 0 else -1.0
                        out[found, axis, k] = sign * _dot(_TO_POWER[k, k:], series[k:])
                owner[found] = side[j, e]
                found += 1
    return found, missed


@njit(**JIT)
def _dot(a, b):
    """Sum of the products of two arrays (N,)."""
    total = 0.0
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    return total
