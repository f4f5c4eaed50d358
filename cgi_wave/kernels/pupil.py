"""Compiled quadrature over a pupil region bounded by polynomial clearances.

The region is {all clearances > 0}. It is cut by rays from a pivot (the origin of the frame used here): along a ray
every bivariate polynomial becomes a univariate one, so that a node costs one Horner chain per polynomial. A ray may
meet the region in any number of intervals: stars, holes and pieces need no special case.

Conventions: coefficient arrays are (P, n, n) with coef[p, i, j] multiplying x^i y^j and i + j < n; phases are in
cycles; angles in rad; lengths are those of the frame. One module holds the whole call tree (Numba's cache does not see
changes made in another file).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

GAUSS = 16
_X16, _W16 = np.polynomial.legendre.leggauss(GAUSS)
_GX = 0.5 * (_X16 + 1.0)  # nodes and weights on (0, 1)
_GW = 0.5 * _W16
_TO_CHEB = np.linalg.inv(np.polynomial.chebyshev.chebvander(_X16, GAUSS - 1))
_TO_POWER = np.zeros((GAUSS, GAUSS))  # Chebyshev coefficients -> powers
for _k in range(GAUSS):
    _TO_POWER[: _k + 1, _k] = np.polynomial.chebyshev.cheb2poly(np.eye(GAUSS)[_k])[: _k + 1]
_TIE = 1e-9  # two boundaries closer than this (frame units) are the same boundary
_CHUNK = 64  # nodes handed to the vectorised inner function at a time
_RADIAL_SCAN = 33  # points per ray on which the phase variation is measured
_FRACTIONS = 9  # radial fractions at which the phase variation in angle is measured
_MAX_INTERVALS = 8

# Reassociation lets the sums over nodes vectorise; NaN and infinity keep their meaning.
_FAST = {"reassoc", "contract", "arcp", "nsz"}


@njit(cache=True, nogil=True)
def _horner(c, x):
    value = 0.0
    for k in range(c.shape[0] - 1, -1, -1):
        value = value * x + c[k]
    return value


@njit(cache=True, nogil=True)
def chebyshev_powers(shift, stretch, n):
    """(n, n) matrix of T_i(shift + stretch t) in powers of t."""
    rows = np.zeros((n, n))
    rows[0, 0] = 1.0
    if n > 1:
        rows[1, 0], rows[1, 1] = shift, stretch
    for i in range(2, n):
        for k in range(i + 1):
            value = 2.0 * shift * rows[i - 1, k] - rows[i - 2, k]
            if k > 0:
                value += 2.0 * stretch * rows[i - 1, k - 1]
            rows[i, k] = value
    return rows


@njit(cache=True, nogil=True)
def _restrict(coef, theta, out):
    """Univariate coefficients (P, n) of (P, n, n) polynomials along the ray at angle theta."""
    n = coef.shape[1]
    cs, sn = np.empty(n), np.empty(n)
    cs[0] = sn[0] = 1.0
    c, s = math.cos(theta), math.sin(theta)
    for k in range(1, n):
        cs[k] = cs[k - 1] * c
        sn[k] = sn[k - 1] * s
    for p in range(coef.shape[0]):
        for k in range(n):
            value = 0.0
            for i in range(k + 1):
                value += coef[p, i, k - i] * cs[i] * sn[k - i]
            out[p, k] = value


@njit(cache=True, nogil=True)
def _root_between(f, m, x0, x1, f0):
    """Root of the polynomial f[:m] in (x0, x1), where its sign changes once: Newton kept inside the bracket."""
    lo, hi, negative_lo = x0, x1, f0 < 0.0
    x = 0.5 * (lo + hi)
    for _ in range(80):
        value, slope = 0.0, 0.0
        for k in range(m - 1, -1, -1):
            slope = slope * x + value
            value = value * x + f[k]
        if value == 0.0:
            return x
        if (value < 0.0) == negative_lo:
            lo = x
        else:
            hi = x
        step = x - value / slope if slope != 0.0 else lo
        if not (lo < step < hi):
            step = 0.5 * (lo + hi)
        if abs(step - x) <= 4e-15 * (x1 + abs(x)):
            return step
        x = step
    return x


@njit(cache=True, nogil=True)
def _roots(c, top, out):
    """All sign changes of the polynomial c on (0, top), ascending: between the roots of its derivatives, in turn."""
    n = c.shape[0] - 1
    while n > 1 and c[n] == 0.0:  # most clearances are of low degree, and each degree costs a pass
        n -= 1
    # Two cases that need no derivatives, and that nearly all rays are: a concave polynomial that starts positive (an
    # aperture seen from inside), and a monotone one (a straight edge), by bounds of their derivatives on (0, top).
    slope, bend, power = 0.0, 0.0, 1.0
    for k in range(2, n + 1):
        bend += k * (k - 1) * abs(c[k]) * power if k > 2 else 0.0
        power *= top
        slope += k * abs(c[k]) * power
    concave = n >= 2 and c[0] > 0.0 and 2.0 * c[2] + bend < 0.0
    if concave or abs(c[1]) > slope:
        if (c[0] < 0.0) == (_horner(c[: n + 1], top) < 0.0):
            return 0
        out[0] = _root_between(c, n + 1, 0.0, top, c[0])
        return 1
    f = np.empty(n + 1)
    previous = np.empty(n + 2)
    count = 0
    for order in range(n - 1, -1, -1):
        m = n - order + 1
        for i in range(m):
            factor = 1.0
            for j in range(i + 1, i + order + 1):
                factor *= j
            f[i] = c[i + order] * factor
        for i in range(count):
            previous[i] = out[i]
        previous[count] = top
        found, x0, f0 = 0, 0.0, f[0]
        for i in range(count + 1):
            x1 = previous[i]
            f1 = _horner(f[:m], x1)
            if (f0 < 0.0) != (f1 < 0.0):
                out[found] = _root_between(f, m, x0, x1, f0)
                found += 1
            x0, f0 = x1, f1
        count = found
    return count


@njit(cache=True, nogil=True)
def _reach(ellipses, theta):
    """Distance from the origin to the nearest of the domain ellipses (rows: centre x, y, semi-axes x, y)."""
    c, s, reach = math.cos(theta), math.sin(theta), np.inf
    for e in range(ellipses.shape[0]):
        cx, cy, ax, ay = ellipses[e, 0], ellipses[e, 1], ellipses[e, 2], ellipses[e, 3]
        qa = (c / ax) ** 2 + (s / ay) ** 2
        qb = -(c * cx / ax**2 + s * cy / ay**2)
        qc = (cx / ax) ** 2 + (cy / ay) ** 2 - 1.0
        root = (-qb + math.sqrt(max(qb * qb - qa * qc, 0.0))) / qa
        reach = min(reach, root)
    return reach


@njit(cache=True, nogil=True)
def _cast(clear, ellipses, theta, ends, which):
    """Intervals of one ray inside the region: fills ends (I, 2) and which (I, 2), returns their number.

    which names the clearance that bounds each end: -1 the pivot, -2 the domain. Returns -1 for too many intervals.
    """
    count_k, n = clear.shape[0], clear.shape[1]
    poly = np.empty((count_k, n))
    _restrict(clear, theta, poly)
    top = _reach(ellipses, theta)
    at, owner, found = np.empty(count_k * n + 1), np.empty(count_k * n + 1, np.int64), 0
    roots = np.empty(n + 1)
    for k in range(count_k):
        for r in range(_roots(poly[k], top, roots)):
            j = found
            while j > 0 and at[j - 1] > roots[r]:
                at[j], owner[j] = at[j - 1], owner[j - 1]
                j -= 1
            at[j], owner[j] = roots[r], k
            found += 1
    at[found], owner[found] = top, -2
    found += 1
    intervals, inside, x0, k0, i = 0, False, 0.0, -1, 0
    while i < found:
        x1, k1, j = at[i], owner[i], i
        while j + 1 < found and at[j + 1] - x1 < _TIE:
            j += 1
            if owner[j] != -2:
                k1 = min(k1, owner[j]) if k1 != -2 else owner[j]
        mid, positive = 0.5 * (x0 + x1), x1 - x0 >= _TIE
        for k in range(count_k):
            if positive and _horner(poly[k], mid) <= 0.0:
                positive = False
        if positive and not inside:
            if intervals == _MAX_INTERVALS:
                return -1
            ends[intervals, 0], which[intervals, 0] = x0, k0
            intervals += 1
        if positive:
            ends[intervals - 1, 1], which[intervals - 1, 1] = x1, k1
        inside = positive
        x0, k0, i = x1, k1, j + 1
    return intervals


@njit(cache=True, nogil=True)
def _signature(clear, ellipses, theta, ends, which):
    """A code of the intervals and the clearances that bound them, constant where the boundary is smooth.

    -1 when there are too many intervals.
    """
    count = _cast(clear, ellipses, theta, ends, which)
    code = count
    for i in range(count):
        code = (code * 31 + which[i, 0] + 3) * 31 + which[i, 1] + 3
    return code


@njit(cache=True, nogil=True)
def find_breaks(clear, ellipses, scan, limit):
    """Angles where the boundary is not smooth, found on `scan` rays and bisected to rounding.

    Returns angles (B,), ascending, within one turn. B = limit + 1 says that there are more than
    `limit`, or that a ray has more than eight intervals.
    """
    ends, which = np.empty((_MAX_INTERVALS, 2)), np.empty((_MAX_INTERVALS, 2), np.int64)
    angles, found = np.zeros(limit + 1), 0
    step = 2.0 * math.pi / scan
    start = 0.1234  # no ray along an axis, where symmetric pupils have their corners
    left, code_left = start, _signature(clear, ellipses, start, ends, which)
    for s in range(1, scan + 1):
        right = start + s * step
        code_right = _signature(clear, ellipses, right, ends, which)
        while code_left != code_right:
            lo, hi, code_hi = left, right, code_right
            for _ in range(60):
                mid = 0.5 * (lo + hi)
                if mid <= lo or mid >= hi:
                    break
                code_mid = _signature(clear, ellipses, mid, ends, which)
                if code_mid == code_left:
                    lo = mid
                else:
                    hi, code_hi = mid, code_mid
            if found == limit or code_hi < 0 or code_left < 0:
                return angles
            angles[found] = hi
            found += 1
            left, code_left = hi, code_hi
        left = right
    if code_left < 0:
        return angles
    return angles[:found].copy()


@njit(cache=True, nogil=True)
def _warp(t, cornered):
    """Map (0, 1) to itself, with a vanishing slope at both ends when they are corners; returns value and slope.

    Interval ends move like a square root where a ray is tangent to the boundary, and nearly so close to there.
    """
    if cornered:
        return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)
    return t, 1.0


@njit(cache=True, nogil=True)
def angle_panels(clear, ellipses, phase, tilt, span, cornered, cycles, turn, extra, limit):
    """Panel breakpoints in t for the segment span = (theta0, theta1), of even phase variation and turning.

    phase (P, n, n) in cycles; tilt is an extra phase rate in cycles per unit length that the caller will add;
    cycles and turn (rad) are what one panel may hold; extra panels are added to that, so that two levels never share
    a quadrature (a nearly tangent boundary is not seen by either measure). Returns the breakpoints, or an array of
    one element that holds the number needed when that exceeds `limit`.
    """
    width = span[1] - span[0]
    points = 12 + math.ceil(96.0 * width / (2.0 * math.pi))
    ends, which = np.empty((_MAX_INTERVALS, 2)), np.empty((_MAX_INTERVALS, 2), np.int64)
    rays, n = phase.shape[0], phase.shape[1]
    poly = np.empty((rays, n))
    mark = np.zeros((_MAX_INTERVALS, _FRACTIONS, rays))
    place = np.zeros((_MAX_INTERVALS, _FRACTIONS, 2))
    size, count_before = np.zeros((_MAX_INTERVALS, 2)), -1
    total = np.zeros(points + 1)
    for i in range(points + 1):
        t = (i + 0.5) / (points + 1)  # never at the ends, where a tangent interval has no length
        theta = span[0] + width * _warp(t, cornered)[0]
        count = _cast(clear, ellipses, theta, ends, which)
        _restrict(phase, theta, poly)
        worst, bend = 0.0, 0.0
        for j in range(count):
            for f in range(_FRACTIONS):
                rho = ends[j, 0] + (ends[j, 1] - ends[j, 0]) * f / (_FRACTIONS - 1.0)
                x, y = rho * math.cos(theta), rho * math.sin(theta)
                if count == count_before:
                    move = tilt * math.hypot(x - place[j, f, 0], y - place[j, f, 1])
                    for p in range(rays):
                        worst = max(worst, abs(_horner(poly[p], rho) - mark[j, f, p]) + move)
                for p in range(rays):
                    mark[j, f, p] = _horner(poly[p], rho)
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


@njit(cache=True, nogil=True)
def segment_rays(clear, ellipses, span, cornered, breaks):
    """Rays of one segment: columns theta, weight d(theta), rho from, rho to; and the clearances at the two ends."""
    panels = breaks.shape[0] - 1
    rays = np.empty((panels * GAUSS * _MAX_INTERVALS, 4))
    owner = np.empty((panels * GAUSS * _MAX_INTERVALS, 2), np.int64)
    ends, which, found = np.empty((_MAX_INTERVALS, 2)), np.empty((_MAX_INTERVALS, 2), np.int64), 0
    width = span[1] - span[0]
    for p in range(panels):
        for g in range(GAUSS):
            t = breaks[p] + (breaks[p + 1] - breaks[p]) * _GX[g]
            place, slope = _warp(t, cornered)
            theta = span[0] + width * place
            weight = width * slope * (breaks[p + 1] - breaks[p]) * _GW[g]
            for j in range(_cast(clear, ellipses, theta, ends, which)):
                rays[found, 0], rays[found, 1] = theta, weight
                rays[found, 2], rays[found, 3] = ends[j, 0], ends[j, 1]
                owner[found, 0], owner[found, 1] = which[j, 0], which[j, 1]
                found += 1
    return rays[:found].copy(), owner[:found].copy()


@njit(cache=True, nogil=True)
def boundary_curves(clear, ellipses, span, cornered, tolerance, limit):
    """Boundary of the region within one angle range as smooth curves, the region to their left.

    Returns (curves (C, 2, 16): powers of s in [-1, 1] of x(s) and y(s); missed: largest of the series' last terms, in
    frame units). Pieces are halved until that is below tolerance. No curves and missed = inf: more than `limit`
    curves, or a number of intervals that changes inside the range.
    """
    out = np.empty((limit, 2, GAUSS))
    ends, which = np.empty((_MAX_INTERVALS, 2)), np.empty((_MAX_INTERVALS, 2), np.int64)
    at = np.empty((GAUSS, _MAX_INTERVALS, 2, 2))
    inner = np.empty(_MAX_INTERVALS, np.int64)
    pieces = np.empty((64, 2))
    pieces[0, 0], pieces[0, 1] = 0.0, 1.0
    top, found, missed, width = 1, 0, 0.0, span[1] - span[0]
    series = np.empty((2, GAUSS))
    while top > 0:
        top -= 1
        t0, t1, count = pieces[top, 0], pieces[top, 1], -1
        for g in range(GAUSS):
            theta = span[0] + width * _warp(t0 + (t1 - t0) * _GX[g], cornered)[0]
            here = _cast(clear, ellipses, theta, ends, which)
            if here < 0 or (count >= 0 and here != count):
                return out[:0], np.inf
            count = here
            for j in range(count):
                inner[j] = which[j, 0]
                for e in range(2):
                    at[g, j, e, 0], at[g, j, e, 1] = ends[j, e] * math.cos(theta), ends[j, e] * math.sin(theta)
        worst = 0.0
        for j in range(count):
            for e in range(2):
                for axis in range(2):
                    for k in range(GAUSS - 3, GAUSS):
                        total = 0.0
                        for g in range(GAUSS):
                            total += _TO_CHEB[k, g] * at[g, j, e, axis]
                        worst = max(worst, abs(total))
        if worst > tolerance and t1 - t0 > 1e-3:
            if top + 2 > pieces.shape[0]:
                return out[:0], np.inf
            pieces[top, 0], pieces[top, 1] = t0, 0.5 * (t0 + t1)
            pieces[top + 1, 0], pieces[top + 1, 1] = 0.5 * (t0 + t1), t1
            top += 2
            continue
        missed = max(missed, worst)
        for j in range(count):
            for e in range(2):
                if e == 0 and inner[j] == -1:
                    continue  # the pivot: a point, not a boundary
                if found == limit:
                    return out[:0], np.inf
                for axis in range(2):
                    for k in range(GAUSS):
                        series[axis, k] = 0.0
                        for g in range(GAUSS):
                            series[axis, k] += _TO_CHEB[k, g] * at[g, j, e, axis]
                    for k in range(GAUSS):
                        total = 0.0
                        for q in range(k, GAUSS):
                            total += _TO_POWER[k, q] * series[axis, q]
                        # outer ends run with growing angle, inner ones against it
                        out[found, axis, k] = total if e == 1 or k % 2 == 0 else -total
                found += 1
    return out[:found].copy(), missed


@njit(cache=True, nogil=True)
def _variation(poly, tilt, lo, hi, total):
    """Accumulated phase variation (cycles) along a ray, the worst of the given phases, on the scan points."""
    step = (hi - lo) / (_RADIAL_SCAN - 1)
    total[0] = 0.0
    for i in range(1, _RADIAL_SCAN):
        worst = 0.0
        for p in range(poly.shape[0]):
            change = abs(_horner(poly[p], lo + i * step) - _horner(poly[p], lo + (i - 1) * step))
            worst = max(worst, change)
        total[i] = total[i - 1] + worst + tilt * step


@njit(cache=True, nogil=True)
def count_panels(rays, phase, tilt, cycles, extra):
    """(R,) number of radial panels of each ray, for at most `cycles` of phase in each, and `extra` more."""
    poly = np.empty((phase.shape[0], phase.shape[1]))
    total, panels = np.empty(_RADIAL_SCAN), np.empty(rays.shape[0], np.int64)
    for r in range(rays.shape[0]):
        _restrict(phase, rays[r, 0], poly)
        _variation(poly, tilt, rays[r, 2], rays[r, 3], total)
        panels[r] = max(1, math.ceil(total[_RADIAL_SCAN - 1] / cycles)) + extra
    return panels


@njit(cache=True, nogil=True)
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
            rho[j] = x0 + (x1 - x0) * _GX[g]
            w[j] = (x1 - x0) * _GW[g] * rho[j] * weight
        x0 = x1


@njit(cache=True, nogil=True, fastmath=_FAST)
def _slice(rho, w, cp, ca, cb, phi, a, b):
    """Sums over one slice of nodes: Re and Im of a b exp(i 2 pi phi), a b, a a, b b (each weighted).

    exp(i 2 pi phi) by the half angle: sine and cosine of pi r, |r| <= 1/2, from their Taylor series to rounding,
    so that the loop has no branch and no library call and vectorises.
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
        r = (phi[i] - math.floor(phi[i] + 0.5)) * math.pi
        z = r * r
        sine = -1.0 / 51090942171709440000.0
        sine = sine * z + 1.0 / 121645100408832000.0
        sine = sine * z - 1.0 / 355687428096000.0
        sine = sine * z + 1.0 / 1307674368000.0
        sine = sine * z - 1.0 / 6227020800.0
        sine = sine * z + 1.0 / 39916800.0
        sine = sine * z - 1.0 / 362880.0
        sine = sine * z + 1.0 / 5040.0
        sine = sine * z - 1.0 / 120.0
        sine = sine * z + 1.0 / 6.0
        sine = r - r * z * sine
        cosine = -1.0 / 1124000727777607680000.0
        cosine = cosine * z + 1.0 / 2432902008176640000.0
        cosine = cosine * z - 1.0 / 6402373705728000.0
        cosine = cosine * z + 1.0 / 20922789888000.0
        cosine = cosine * z - 1.0 / 87178291200.0
        cosine = cosine * z + 1.0 / 479001600.0
        cosine = cosine * z - 1.0 / 3628800.0
        cosine = cosine * z + 1.0 / 40320.0
        cosine = cosine * z - 1.0 / 720.0
        cosine = cosine * z + 1.0 / 24.0
        cosine = cosine * z - 0.5
        cosine = cosine * z + 1.0
        ab = a[i] * b[i] * w[i]
        re += ab * (1.0 - 2.0 * sine * sine)
        im += ab * 2.0 * sine * cosine
        cross += ab
        aa += a[i] * a[i] * w[i]
        bb += b[i] * b[i] * w[i]
    return re, im, cross, aa, bb


@njit(cache=True, nogil=True)
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
    cs, ck = np.empty((steering.shape[0], n)), np.empty((clear.shape[0], n))
    cw, one = np.empty((1, n)), np.empty((1, n, n))
    one[0] = weight
    longest = panels.max() * GAUSS
    rho, w, ww = np.empty(longest), np.empty(longest), np.empty(_CHUNK)
    phi, a, b = np.empty(_CHUNK), np.empty(_CHUNK), np.empty(_CHUNK)
    for r in range(rays.shape[0]):
        theta, lo, hi = rays[r, 0], rays[r, 2], rays[r, 3]
        _restrict(phase, theta, cp)
        _restrict(amp_a, theta, ca)
        _restrict(amp_b, theta, cb)
        _restrict(steering, theta, cs)
        _restrict(clear, theta, ck)
        _restrict(one, theta, cw)
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
                ww[j] = w[i + j] * _horner(cw[0], rho[i + j])
                weighted[3] += w[i + j]
            part = _slice(rho[i:stop], ww[:m], cp[middle], ca[middle], cb[middle], phi[:m], a[:m], b[:m])
            for q in range(3):
                weighted[q] += part[q]
        for e in range(2):
            k, x = owner[r, e], rays[r, 2 + e]
            if k >= 0:
                slope = 0.0
                for i in range(n - 1, 0, -1):
                    slope = slope * x + i * ck[k, i]
                strip = min(residual[k] / max(abs(slope), 1e-300), hi - lo)
                edge += abs(_horner(ca[middle], x) * _horner(cb[middle], x)) * x * strip * rays[r, 1]
    return sums, weighted, edge


@njit(cache=True, nogil=True)
def list_nodes(rays, panels, steering, tilt):
    """The quadrature itself: (M, 3) of x, y and weight in frame units."""
    out = np.empty((panels.sum() * GAUSS, 3))
    longest = panels.max() * GAUSS
    rho, w = np.empty(longest), np.empty(longest)
    cs, found = np.empty((steering.shape[0], steering.shape[1])), 0
    for r in range(rays.shape[0]):
        theta = rays[r, 0]
        _restrict(steering, theta, cs)
        _radial_nodes(cs, tilt, rays[r, 2], rays[r, 3], rays[r, 1], panels[r], rho, w)
        for j in range(panels[r] * GAUSS):
            out[found, 0], out[found, 1], out[found, 2] = rho[j] * math.cos(theta), rho[j] * math.sin(theta), w[j]
            found += 1
    return out
