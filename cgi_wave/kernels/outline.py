"""The outline of a pupil region: where rays from a pivot cross its boundary, and where that has corners.

The region is {all clearances > 0}, bounded by polynomials. Along a ray from the pivot (the origin of the frame used
here) every bivariate polynomial becomes a univariate one. A ray may meet the region in any number of intervals: stars,
holes and pieces need no special case.

Conventions: coefficient arrays are (P, n, n) with coef[p, i, j] multiplying x^i y^j and i + j < n; angles in rad;
lengths are those of the frame. ``kernels.pupil`` builds its quadrature on this module: after a change here, its
compiled code in Numba's cache is stale (see CONTRIBUTING.md).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cgi_wave.kernels.polynomials import BATCH, JIT, gradient, horner, on_rays, powers

GAUSS = BATCH  # nodes of a panel, whose rays are computed together
_X16, _W16 = np.polynomial.legendre.leggauss(GAUSS)
GX = 0.5 * (_X16 + 1.0)  # nodes and weights on (0, 1)
GW = 0.5 * _W16
_TIE = 1e-12  # two boundaries closer than this (frame units) are the same boundary; what lies between them is counted
_CLOSE = 0.05  # share of its own curvature below which a gap between boundaries is followed to its least width
_SHARP = 1e-13  # rad to which a corner's angle is found: what _TIE leaves of it
MAX_INTERVALS = 8


@njit(**JIT)
def restrict(coef, theta, out):
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


@njit(**JIT)
def restrict_many(coef, cosine, sine, power, out):
    """``restrict`` for BATCH rays: out (BATCH, P, n); power (n, BATCH) is working space."""
    powers(cosine, power)
    for p in range(coef.shape[0]):
        on_rays(coef[p], power, sine, out[:, p])


@njit(**JIT)
def _root_between(f, m, x0, x1, f0, start):
    """Root of the polynomial f[:m] in (x0, x1), where its sign changes once: Newton from start, kept in the bracket.

    Ends where what a step leaves, about its square and no more than the last steps say, is rounding, or where steps
    stop to shrink.
    """
    lo, hi, negative_lo, before = x0, x1, f0 < 0.0, 0.0
    x = start if lo < start < hi else 0.5 * (lo + hi)
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
        newton = lo < step < hi
        if not newton:
            step = 0.5 * (lo + hi)
        size = abs(step - x)
        if size <= 4e-15 * (x1 + abs(x)):
            return step
        if newton and size <= 1e-8 * x1 and (size**3 <= 1e-16 * before**2 * x1 or size >= 0.5 * before):
            return step
        x, before = step, size if newton else 0.0
    return x


@njit(**JIT)
def _sign_changes(c, n, top):
    """Roots of the polynomial c[:n + 1] on (0, top) if there are none or one for sure (Descartes' rule), else 2.

    The Bernstein coefficients' changes of sign; one that rounding may have turned decides nothing.
    """
    b, power, choose = np.empty(n + 1), 1.0, 1.0
    for j in range(n + 1):
        b[j] = c[j] * power / choose
        power *= top
        choose *= (n - j) / (j + 1.0)
    for i in range(n):
        for k in range(n, i, -1):
            b[k] += b[k - 1]
    least, largest, changes = abs(b[0]), abs(b[0]), 0
    for k in range(1, n + 1):
        least, largest = min(least, abs(b[k])), max(largest, abs(b[k]))
        changes += (b[k] < 0.0) != (b[k - 1] < 0.0)
    return changes if changes < 2 and least > 1e-11 * largest else 2


@njit(**JIT)
def _roots(c, top, out):
    """All sign changes of the polynomial c on (0, top), ascending: between the roots of its derivatives, in turn."""
    n = c.shape[0] - 1
    while n > 1 and c[n] == 0.0:  # most clearances are of low degree, and each degree costs a pass
        n -= 1
    # Cases that need no derivatives, and that nearly all rays are: a concave polynomial that starts positive (an
    # aperture seen from inside), a monotone one (a straight edge), by bounds of their derivatives on (0, top), and
    # what Descartes' rule decides.
    slope, bend, power = 0.0, 0.0, 1.0
    for k in range(2, n + 1):
        bend += k * (k - 1) * abs(c[k]) * power if k > 2 else 0.0
        power *= top
        slope += k * abs(c[k]) * power
    concave = n >= 2 and c[0] > 0.0 and 2.0 * c[2] + bend < 0.0
    if concave or abs(c[1]) > slope:
        if (c[0] < 0.0) == (horner(c[: n + 1], top) < 0.0):
            return 0
        start = 0.5 * top
        if concave:  # most apertures are nearly quadratic
            start = 2.0 * c[0] / (math.sqrt(max(c[1] * c[1] - 4.0 * c[0] * c[2], 0.0)) - c[1])
        out[0] = _root_between(c, n + 1, 0.0, top, c[0], start)
        return 1
    few = _sign_changes(c, n, top)
    if few == 0:
        return 0
    if few == 1:
        out[0] = _root_between(c, n + 1, 0.0, top, c[0], 0.5 * top)
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
            f1 = horner(f[:m], x1)
            if (f0 < 0.0) != (f1 < 0.0):
                out[found] = _root_between(f, m, x0, x1, f0, 0.5 * (x0 + x1))
                found += 1
            x0, f0 = x1, f1
        count = found
    return count


@njit(**JIT)
def _reach(ellipses, c, s):
    """Distance from the origin to the nearest domain ellipse (rows: centre x, y, semi-axes x, y) along (c, s)."""
    reach = np.inf
    for e in range(ellipses.shape[0]):
        cx, cy = ellipses[e, 0] / ellipses[e, 2], ellipses[e, 1] / ellipses[e, 3]
        dx, dy = c / ellipses[e, 2], s / ellipses[e, 3]
        qa, qb, qc = dx * dx + dy * dy, dx * cx + dy * cy, cx * cx + cy * cy - 1.0
        reach = min(reach, (qb + math.sqrt(max(qb * qb - qa * qc, 0.0))) / qa)
    return reach


@njit(**JIT)
def crossings(poly, ellipses, c, s, first, at, owner):
    """Where the ray (c, s) crosses any clearance or leaves the domain (-2), ascending: fills at, owner; their number.

    poly (K, n): the clearances along the ray. first: a clearance that probably ends the light; where it does, all that
    lies beyond is left out. -1: nothing is.
    """
    count, top, found = poly.shape[0], _reach(ellipses, c, s), 0
    reach, roots = top, np.empty(poly.shape[1] + 1)
    for i in range(count):
        k = (first + i) % count if first >= 0 else i
        number = _roots(poly[k], top, roots)
        for r in range(number):
            j = found
            while j > 0 and at[j - 1] > roots[r]:
                at[j], owner[j] = at[j - 1], owner[j - 1]
                j -= 1
            at[j], owner[j] = roots[r], k
            found += 1
        if first >= 0 and number == 1 and poly[k, 0] > 0.0:
            top = roots[0]
    if top < reach:
        return found
    at[found], owner[found] = top, -2
    return found + 1


@njit(**JIT)
def intervals_of(poly, at, owner, found, ends, which, between):
    """Intervals of one ray inside the region, from its crossings: see ``cast``. Each changes a clearance's sign."""
    between[0] = between[1] = 0.0
    dark = 0  # clearances that are negative here
    for k in range(poly.shape[0]):
        dark += poly[k, 0] < 0.0
    intervals, inside, x0, k0, i = 0, False, 0.0, -1, 0
    while i < found:
        x1, k1, j = at[i], owner[i], i
        while j + 1 < found and at[j + 1] - x1 < _TIE:
            j += 1
            if owner[j] != -2:
                k1 = min(k1, owner[j]) if k1 != -2 else owner[j]
        between[0], between[1] = max(between[0], at[j] - x1), between[1] + (at[j] - x1) * at[j]
        positive = dark == 0 and x1 - x0 >= _TIE
        if positive and not inside:
            if intervals == MAX_INTERVALS:
                return -1
            ends[intervals, 0], which[intervals, 0] = x0, k0
            intervals += 1
        if positive:
            ends[intervals - 1, 1], which[intervals - 1, 1] = x1, k1
        inside = positive
        x0, k0 = x1, k1
        while i <= j:
            if owner[i] >= 0:
                now = 0  # its crossings up to here
                for q in range(i):
                    now += owner[q] == owner[i]
                dark += 1 if (poly[owner[i], 0] < 0.0) == (now % 2 == 1) else -1
            i += 1
    return intervals


@njit(**JIT)
def cast(clear, ellipses, theta, ends, which, between):
    """Intervals of one ray inside the region: fills ends (I, 2) and which (I, 2), returns their number.

    which names the clearance that bounds each end: -1 the pivot, -2 the domain. between (2,) receives the width of the
    widest stretch between boundaries taken as one, and the sum of such widths times their distances from the pivot.
    Returns -1 for too many intervals.
    """
    count_k, n = clear.shape[0], clear.shape[1]
    poly, at, owner = np.empty((count_k, n)), np.empty(count_k * n + 1), np.empty(count_k * n + 1, np.int64)
    restrict(clear, theta, poly)
    found = crossings(poly, ellipses, math.cos(theta), math.sin(theta), -1, at, owner)
    return intervals_of(poly, at, owner, found, ends, which, between)


@njit(**JIT)
def _code(count, which):
    """A code of a ray's intervals and the clearances that bound them, constant where the boundary is smooth.

    Negative when there are too many intervals.
    """
    code = count
    for i in range(count):
        code = (code * 31 + which[i, 0] + 3) * 31 + which[i, 1] + 3
    return code


@njit(**JIT)
def _signature(clear, ellipses, theta, ends, which, between):
    """(``_code`` of the ray at theta, the number of its intervals)."""
    count = cast(clear, ellipses, theta, ends, which, between)
    return _code(count, which), count


@njit(**JIT)
def _meeting(clear, ends, which, count, theta):
    """Where two rays' intervals are bounded by different clearances: (angle at which these meet, half a width).

    ends, which (2, I, 2), count, theta (2,): intervals of both rays. By Newton's method on both clearances, from the
    point between the rays. Within the width two boundaries may be one to _TIE. NaN where nothing is found.
    """
    if count[0] != count[1]:
        return math.nan, math.nan
    for j in range(count[0]):
        for e in range(2):
            first, second = which[0, j, e], which[1, j, e]
            if first == second:
                continue
            if first < 0 or second < 0:
                return math.nan, math.nan
            x = 0.5 * (ends[0, j, e] * math.cos(theta[0]) + ends[1, j, e] * math.cos(theta[1]))
            y = 0.5 * (ends[0, j, e] * math.sin(theta[0]) + ends[1, j, e] * math.sin(theta[1]))
            for _ in range(12):
                v0, gx0, gy0 = gradient(clear[first], x, y)
                v1, gx1, gy1 = gradient(clear[second], x, y)
                det = gx0 * gy1 - gx1 * gy0
                if det == 0.0:
                    break
                dx, dy = (v0 * gy1 - v1 * gy0) / det, (v1 * gx0 - v0 * gx1) / det
                x, y = x - dx, y - dy
                size = math.hypot(x, y)
                if not math.hypot(dx, dy) < size:
                    break
                if math.hypot(dx, dy) <= 1e-9 * size:  # what a further step would leave is about the square
                    along0, along1 = gx0 * x + gy0 * y, gx1 * x + gy1 * y
                    if along0 == 0.0 or along1 == 0.0:
                        break
                    apart = abs((gy0 * x - gx0 * y) / along0 - (gy1 * x - gx1 * y) / along1) * size  # of dr/dθ
                    angle = math.atan2(y, x)
                    angle += 2.0 * math.pi * math.ceil((theta[0] - angle) / (2.0 * math.pi))
                    return angle, 2.0 * _TIE / max(apart, 1e-300) + 1e-15
            return math.nan, math.nan
    return math.nan, math.nan


@njit(**JIT)
def _closest(clear, ellipses, lo, hi, j, code, ends, which, between):
    """The angle in (lo, hi) where crossings j and j + 1 of a ray come closest, or where the code is another one.

    Golden section: between lo and hi the crossings keep their order unless two of them pass each other.
    """
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    count_k, n = clear.shape[0], clear.shape[1]
    poly, at, owner = np.empty((count_k, n)), np.empty(count_k * n + 1), np.empty(count_k * n + 1, np.int64)
    inner = np.array([hi - golden * (hi - lo), lo + golden * (hi - lo)])
    gap = np.full(2, np.nan)
    for _ in range(48):
        for e in range(2):
            if np.isnan(gap[e]):
                restrict(clear, inner[e], poly)
                found = crossings(poly, ellipses, math.cos(inner[e]), math.sin(inner[e]), -1, at, owner)
                count = intervals_of(poly, at, owner, found, ends, which, between)
                if _code(count, which) != code:
                    return inner[e]
                gap[e] = at[j + 1] - at[j] if j + 1 < found else np.inf
        if gap[0] < gap[1]:
            hi, inner[1], gap[1] = inner[1], inner[0], gap[0]
            inner[0], gap[0] = hi - golden * (hi - lo), np.nan
        else:
            lo, inner[0], gap[0] = inner[0], inner[1], gap[1]
            inner[1], gap[1] = lo + golden * (hi - lo), np.nan
        if hi - lo < 1e-9:
            break
    return 0.5 * (lo + hi)


@njit(**JIT)
def _scan_rays(clear, ellipses, scan, start, ends, which, between):
    """Angles (ascending, one turn from start) at which codes are compared: even ones, and close encounters; the codes.

    Where two boundaries come close between two rays and part again, they may have crossed twice: the place of closest
    approach, by a parabola through three rays that nearly touches zero and then exactly, is looked at as well.
    """
    step = 2.0 * math.pi / scan
    count_k, n = clear.shape[0], clear.shape[1]
    size = count_k * n + 1
    lines, cosine, sine = np.empty((BATCH, count_k, n)), np.empty(BATCH), np.empty(BATCH)
    power = np.empty((n, BATCH))
    at, owner = np.empty((3, size)), np.empty((3, size), np.int64)
    found = np.zeros(3, np.int64)
    rays, code, more = np.empty(5 * scan + 1), np.empty(5 * scan + 1, np.int64), scan + 1
    for s in range(-1, scan + 1):
        now, before, first = (s + 1) % 3, s % 3, (s - 1) % 3
        theta = start + s * step
        poly = lines[(s + 1) % BATCH]
        if (s + 1) % BATCH == 0:
            for r in range(BATCH):
                cosine[r], sine[r] = math.cos(start + (s + r) * step), math.sin(start + (s + r) * step)
            restrict_many(clear, cosine, sine, power, lines)
        r = (s + 1) % BATCH
        found[now] = crossings(poly, ellipses, cosine[r], sine[r], -1, at[now], owner[now])
        here = _code(intervals_of(poly, at[now], owner[now], found[now], ends, which, between), which)
        if s >= 0:
            rays[s], code[s] = theta, here
        if s < 1 or not found[now] == found[before] == found[first]:
            continue
        same = True
        for j in range(found[now]):
            same = same and owner[now, j] == owner[before, j] == owner[first, j]
        if not same:
            continue
        for j in range(found[now] - 1):
            a = at[first, j + 1] - at[first, j]
            b = at[before, j + 1] - at[before, j]
            c = at[now, j + 1] - at[now, j]
            bend = a - 2.0 * b + c
            if not (b <= a and b <= c and bend > 0.0 and owner[now, j] != owner[now, j + 1]):
                continue
            if b - (c - a) ** 2 / (8.0 * bend) > _CLOSE * bend or more == rays.size:
                continue
            place = _closest(clear, ellipses, theta - 2.0 * step, theta, j, here, ends, which, between)
            if start < place < start + 2.0 * math.pi:
                rays[more] = place
                code[more], _ = _signature(clear, ellipses, place, ends, which, between)
                more += 1
    order = np.argsort(rays[:more])
    return rays[order], code[order]


@njit(**JIT)
def find_breaks(clear, ellipses, scan, limit):
    """Angles where the boundary is not smooth, found on `scan` rays, by Newton's method or bisected to rounding.

    Returns angles (B,), ascending, within one turn, and whether the number of intervals changes at each (B,). B =
    limit + 1 says that there are more than `limit`, or that a ray has more than eight intervals.
    """
    ends, which = np.empty((2, MAX_INTERVALS, 2)), np.empty((2, MAX_INTERVALS, 2), np.int64)
    angles, changes, between = np.zeros(limit + 1), np.zeros(limit + 1, np.bool_), np.empty(2)
    start = 0.1234  # no ray along an axis, where symmetric pupils have their corners
    rays, codes = _scan_rays(clear, ellipses, scan, start, ends[0], which[0], between)
    side, count, found = np.empty(2), np.empty(2, np.int64), 0
    left, code_left = rays[0], codes[0]
    for ray in range(1, rays.size):
        right, code_right = rays[ray], codes[ray]
        while code_left != code_right:
            lo, hi, code_hi = left, right, code_right
            side[0], side[1] = lo, hi
            for e in range(2):
                count[e] = cast(clear, ellipses, side[e], ends[e], which[e], between)
            count_lo, count_hi = count[0], count[1]
            place, width = _meeting(clear, ends, which, count, side)
            met = lo < place - width and place + width < hi and width < 1e-9
            if met:
                before, _ = _signature(clear, ellipses, place - width, ends[0], which[0], between)
                after, count_after = _signature(clear, ellipses, place + width, ends[0], which[0], between)
                met = before == code_left and after != code_left
                if met:
                    hi, code_hi, count_hi = place + width, after, count_after
            if not met:
                for _ in range(60):
                    place = 0.5 * (lo + hi)
                    if hi - lo <= _SHARP:
                        break
                    middle, count_middle = _signature(clear, ellipses, place, ends[0], which[0], between)
                    if middle == code_left:
                        lo = place
                    else:
                        hi, code_hi, count_hi = place, middle, count_middle
                place = hi
            if found == limit or code_hi < 0 or code_left < 0:
                return angles, changes
            angles[found], changes[found] = place, count_lo != count_hi
            found += 1
            left, code_left = hi, code_hi
        left = right
    if code_left < 0:
        return angles, changes
    return angles[:found].copy(), changes[:found].copy()


@njit(**JIT)
def warp(t, turning):
    """Map (0, 1) to itself, with a vanishing slope at both ends of a range that turns; returns value and slope.

    Interval ends move like a square root where a ray is tangent to the boundary, which is where their number changes.
    """
    if turning:
        return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)
    return t, 1.0


@njit(**JIT)
def spans(clear, ellipses, scan, limit):
    """Angle ranges (B, 2) between places where the boundary is not smooth, and whether they turn (B,): ``warp``.

    A range turns if the number of intervals changes at one of its ends. None, with more than ``limit`` such places:
    these are the third.
    """
    angles, changes = find_breaks(clear, ellipses, scan, limit)
    count = angles.size
    if count == 0:
        return np.array([[0.0, 2.0 * math.pi]]), np.zeros(1, np.bool_), 0
    out, turning, found = np.empty((count, 2)), np.empty(count, np.bool_), 0
    if count <= limit:
        for b in range(count):
            start, stop = angles[b], angles[b + 1] if b + 1 < count else angles[0] + 2.0 * math.pi
            if stop - start > _SHARP:
                out[found, 0], out[found, 1] = start, stop
                turning[found] = changes[b] or changes[(b + 1) % count]
                found += 1
    return out[:found], turning[:found], count
