"""Compiled quadrature over a pupil region bounded by polynomial clearances, ray by ray (see ``kernels.outline``).

A node costs one Horner chain per polynomial. Coefficient arrays are (P, n, n) with coef[p, i, j] multiplying x^i y^j
and i + j < n; phases are in cycles; angles in rad; lengths are those of the frame.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cgi_wave.kernels.outline import GAUSS, GW, GX, MAX_INTERVALS, cast, restrict, warp
from cgi_wave.kernels.polynomials import JIT, horner
from cgi_wave.kernels.turns import FAST, half_turn

_CHUNK = 64  # nodes handed to the vectorised inner function at a time
_RADIAL_SCAN = 33  # points per ray on which the phase variation is measured
_FRACTIONS = 9  # radial fractions at which the phase variation in angle is measured


@njit(**JIT)
def angle_panels(clear, ellipses, phase, tilt, span, turning, cycles, turn, extra, limit):
    """Panel breakpoints in t for the segment span = (theta0, theta1), of even phase variation and turning.

    phase (P, n, n) in cycles; tilt is an extra phase rate in cycles per unit length that the caller will add;
    cycles and turn (rad) are what one panel may hold; extra panels are added to that, so that two levels never share
    a quadrature (a nearly tangent boundary is not seen by either measure). Returns the breakpoints, or an array of
    one element that holds the number needed when that exceeds `limit`.
    """
    width = span[1] - span[0]
    points = 12 + math.ceil(96.0 * width / (2.0 * math.pi))
    ends, which = np.empty((MAX_INTERVALS, 2)), np.empty((MAX_INTERVALS, 2), np.int64)
    rays, n = phase.shape[0], phase.shape[1]
    poly = np.empty((rays, n))
    mark = np.zeros((MAX_INTERVALS, _FRACTIONS, rays))
    place = np.zeros((MAX_INTERVALS, _FRACTIONS, 2))
    size, between, count_before = np.zeros((MAX_INTERVALS, 2)), np.empty(2), -1
    total = np.zeros(points + 1)
    for i in range(points + 1):
        t = (i + 0.5) / (points + 1)  # never at the ends, where a tangent interval has no length
        theta = span[0] + width * warp(t, turning)[0]
        count = cast(clear, ellipses, theta, ends, which, between)
        restrict(phase, theta, poly)
        worst, bend = 0.0, 0.0
        for j in range(count):
            for f in range(_FRACTIONS):
                rho = ends[j, 0] + (ends[j, 1] - ends[j, 0]) * f / (_FRACTIONS - 1.0)
                x, y = rho * math.cos(theta), rho * math.sin(theta)
                if count == count_before:
                    move = tilt * math.hypot(x - place[j, f, 0], y - place[j, f, 1])
                    for p in range(rays):
                        worst = max(worst, abs(horner(poly[p], rho) - mark[j, f, p]) + move)
                for p in range(rays):
                    mark[j, f, p] = horner(poly[p], rho)
                place[j, f, 0], place[j, f, 1] = x, y
            for e in range(2):
                if count == count_before and ends[j, e] > 0.0 and size[j, e] > 0.0:
                    bend = max(bend, abs(math.log(ends[j, e] / size[j, e])))
                size[j, e] = ends[j, e]
        arc = width / (points + 1)
        total[i] = (total[i - 1] if i else 0.0) + worst / cycles + (bend + arc) / turn
        count_before = count
    needed = max(1.0, math.ceil(total[points])) + extra
    if needed > limit:
        return np.full(1, needed)
    panels = int(needed)
    breaks = np.empty(panels + 1)
    breaks[0], breaks[panels], i = 0.0, 1.0, 0
    for k in range(1, panels):
        target = total[points] * k / panels
        while total[i] < target:
            i += 1
        before, at_before = (total[i - 1], i - 0.5) if i else (0.0, 0.0)
        share = (target - before) / (total[i] - before)
        breaks[k] = (at_before + share * (i + 0.5 - at_before)) / (points + 1)
    return breaks


@njit(**JIT)
def segment_rays(clear, ellipses, span, turning, breaks):
    """Rays of one segment: columns theta, weight d(theta), rho from, rho to; and the clearances at the two ends.

    Third, the area between boundaries that were taken as one.
    """
    panels = breaks.shape[0] - 1
    rays = np.empty((panels * GAUSS * MAX_INTERVALS, 4))
    owner = np.empty((panels * GAUSS * MAX_INTERVALS, 2), np.int64)
    ends, which, found = np.empty((MAX_INTERVALS, 2)), np.empty((MAX_INTERVALS, 2), np.int64), 0
    width, between, area = span[1] - span[0], np.empty(2), 0.0
    for p in range(panels):
        for g in range(GAUSS):
            t = breaks[p] + (breaks[p + 1] - breaks[p]) * GX[g]
            place, slope = warp(t, turning)
            theta = span[0] + width * place
            weight = width * slope * (breaks[p + 1] - breaks[p]) * GW[g]
            for j in range(cast(clear, ellipses, theta, ends, which, between)):
                rays[found, 0], rays[found, 1] = theta, weight
                rays[found, 2], rays[found, 3] = ends[j, 0], ends[j, 1]
                owner[found, 0], owner[found, 1] = which[j, 0], which[j, 1]
                found += 1
            area += between[1] * weight
    return rays[:found].copy(), owner[:found].copy(), area


@njit(**JIT)
def _variation(poly, tilt, lo, hi, total):
    """Accumulated phase variation (cycles) along a ray, the worst of the given phases, on the scan points."""
    step = (hi - lo) / (_RADIAL_SCAN - 1)
    total[0] = 0.0
    for i in range(1, _RADIAL_SCAN):
        worst = 0.0
        for p in range(poly.shape[0]):
            change = abs(horner(poly[p], lo + i * step) - horner(poly[p], lo + (i - 1) * step))
            worst = max(worst, change)
        total[i] = total[i - 1] + worst + tilt * step


@njit(**JIT)
def count_panels(rays, phase, tilt, cycles, extra):
    """(R,) number of radial panels of each ray, for at most `cycles` of phase in each, and `extra` more."""
    poly = np.empty((phase.shape[0], phase.shape[1]))
    total, panels = np.empty(_RADIAL_SCAN), np.empty(rays.shape[0], np.int64)
    for r in range(rays.shape[0]):
        restrict(phase, rays[r, 0], poly)
        _variation(poly, tilt, rays[r, 2], rays[r, 3], total)
        panels[r] = max(1, math.ceil(total[_RADIAL_SCAN - 1] / cycles)) + extra
    return panels


@njit(**JIT)
def _radial_nodes(poly, tilt, lo, hi, weight, panels, rho, w):
    """Nodes and weights (rho d(rho) d(theta)) of one ray, in panels of even phase variation."""
    total = np.empty(_RADIAL_SCAN)
    _variation(poly, tilt, lo, hi, total)
    last = total[_RADIAL_SCAN - 1]
    step, i, x0 = (hi - lo) / (_RADIAL_SCAN - 1), 1, lo
    for k in range(1, panels + 1):
        x1 = hi
        if k < panels:
            # a tenth of even spacing keeps panels apart where the phase stands still
            target = last * k / panels
            while i < _RADIAL_SCAN - 1 and total[i] < target:
                i += 1
            even = lo + (i - 1 + (target - total[i - 1]) / max(total[i] - total[i - 1], 1e-300)) * step
            x1 = 0.9 * even + 0.1 * (lo + (hi - lo) * k / panels)
        for g in range(GAUSS):
            j = (k - 1) * GAUSS + g
            rho[j] = x0 + (x1 - x0) * GX[g]
            w[j] = (x1 - x0) * GW[g] * rho[j] * weight
        x0 = x1


@njit(cache=True, nogil=True, fastmath=FAST)
def _slice(rho, w, cp, ca, cb, phi, a, b):
    """Sums over one slice of nodes: Re and Im of a b exp(i 2 pi phi), a b, a a, b b (each weighted).

    exp(i 2 pi phi) by the half angle, so that the loop has no branch and no library call and vectorises.
    """
    size = rho.shape[0]
    top = cp.shape[0] - 1
    for i in range(size):
        phi[i], a[i], b[i] = cp[top], ca[top], cb[top]
    for k in range(top - 1, -1, -1):
        p, q, s = cp[k], ca[k], cb[k]
        for i in range(size):
            x = rho[i]
            phi[i] = phi[i] * x + p
            a[i] = a[i] * x + q
            b[i] = b[i] * x + s
    re, im, cross, aa, bb = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(size):
        sine, cosine = half_turn((phi[i] - math.floor(phi[i] + 0.5)) * math.pi)
        ab = a[i] * b[i] * w[i]
        re += ab * (1.0 - 2.0 * sine * sine)
        im += ab * 2.0 * sine * cosine
        cross += ab
        aa += a[i] * a[i] * w[i]
        bb += b[i] * b[i] * w[i]
    return re, im, cross, aa, bb


@njit(**JIT)
def integrate(rays, owner, panels, steering, tilt, phase, amp_a, amp_b, weight, middle, clear, residual):
    """Integrals over the region, for T triples (phase, amp_a, amp_b) of (T, n, n) polynomials.

    steering (P, n, n) are the phases that place the radial panels; weight (n, n) is a further factor applied at the
    triple `middle`; residual (K,) is the error of each clearance.

    Returns (sums (T, 5): Re and Im of the integral of a b exp(i 2 pi phase), of a b, a a, b b;
    weighted (4,): Re and Im of the integral of weight a b exp(i 2 pi phase), of weight a b, and the area;
    edge: the integral of a b over the strip that the residual of the clearances leaves open).
    """
    count_t, n = phase.shape[0], phase.shape[1]
    sums, weighted, edge = np.zeros((count_t, 5)), np.zeros(4), 0.0
    cp, ca, cb = np.empty((count_t, n)), np.empty((count_t, n)), np.empty((count_t, n))
    cs, ck = np.empty((steering.shape[0], n)), np.empty(clear.shape[:2])
    cw, one = np.empty((1, n)), np.empty((1, n, n))
    one[0] = weight
    longest = panels.max() * GAUSS
    rho, w, ww = np.empty(longest), np.empty(longest), np.empty(_CHUNK)
    phi, a, b = np.empty(_CHUNK), np.empty(_CHUNK), np.empty(_CHUNK)
    for r in range(rays.shape[0]):
        theta, lo, hi = rays[r, 0], rays[r, 2], rays[r, 3]
        restrict(phase, theta, cp)
        restrict(amp_a, theta, ca)
        restrict(amp_b, theta, cb)
        restrict(steering, theta, cs)
        restrict(clear, theta, ck)
        restrict(one, theta, cw)
        _radial_nodes(cs, tilt, lo, hi, rays[r, 1], panels[r], rho, w)
        size = panels[r] * GAUSS
        for i in range(0, size, _CHUNK):
            stop = min(i + _CHUNK, size)
            m = stop - i
            for t in range(count_t):
                part = _slice(rho[i:stop], w[i:stop], cp[t], ca[t], cb[t], phi[:m], a[:m], b[:m])
                for q in range(5):
                    sums[t, q] += part[q]
            for j in range(m):
                ww[j] = w[i + j] * horner(cw[0], rho[i + j])
                weighted[3] += w[i + j]
            part = _slice(rho[i:stop], ww[:m], cp[middle], ca[middle], cb[middle], phi[:m], a[:m], b[:m])
            for q in range(3):
                weighted[q] += part[q]
        for e in range(2):
            k, x = owner[r, e], rays[r, 2 + e]
            if k >= 0:
                slope = 0.0
                for i in range(ck.shape[1] - 1, 0, -1):
                    slope = slope * x + i * ck[k, i]
                strip = min(residual[k] / max(abs(slope), 1e-300), hi - lo)
                edge += abs(horner(ca[middle], x) * horner(cb[middle], x)) * x * strip * rays[r, 1]
    return sums, weighted, edge


@njit(**JIT)
def list_nodes(rays, panels, steering, tilt):
    """The quadrature itself: (M, 3) of x, y and weight in frame units."""
    out = np.empty((panels.sum() * GAUSS, 3))
    longest = panels.max() * GAUSS
    rho, w = np.empty(longest), np.empty(longest)
    cs, found = np.empty((steering.shape[0], steering.shape[1])), 0
    for r in range(rays.shape[0]):
        theta = rays[r, 0]
        restrict(steering, theta, cs)
        _radial_nodes(cs, tilt, rays[r, 2], rays[r, 3], rays[r, 1], panels[r], rho, w)
        for j in range(panels[r] * GAUSS):
            out[found, 0], out[found, 1], out[found, 2] = rho[j] * math.cos(theta), rho[j] * math.sin(theta), w[j]
            found += 1
    return out
