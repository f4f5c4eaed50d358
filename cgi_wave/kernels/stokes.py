"""Compiled boundary integrals for oscillating integrands: the area integral of a b exp(i 2π f) by Stokes' theorem.

On every line along one direction (x here, after a rotation) the integrand has an antiderivative Φ in x, so that the
area integral is the boundary integral ∮ Φ dy. Φ is known cheaply wherever the phase f runs fast along the line: the
one antiderivative that does not oscillate beyond exp(i 2π f) itself is E exp(i 2π f), with E from a few
Gauss–Laguerre nodes on the complex path of steepest descent (numerical steepest descent, Huybrechs and Vandewalle,
SIAM J. Numer. Anal. 44, 1026, 2006). Within WAVES of the line's stationary point X, Φ is integrated directly from the
nearest point where E is good; beyond X, E exp(i 2π f) and Φ differ by the stationary point's own term S exp(i 2π f(X)).

What remains are integrals along the boundary of (slow amplitude) × exp(i 2π φ), φ = f on the boundary or f(X):
16-point Gauss panels on interpolated amplitudes, a handful of nodes per wave of φ. The cost grows with the length of
the boundary in waves, and with a factor of some ns only.

A line may have one stationary point at most. Where the second derivative along every direction changes sign, or the
polynomials run through too little phase for an asymptotic regime, the region is cut into boxes, each with its own
direction, down to boxes of a few waves, in which Φ is integrated directly from the box's middle line.

Conventions: polynomials are powers, coef[i, j] x^i y^j, i + j < n; f in cycles; boundary panels are curves
x(s), y(s), s in [-1, 1], powers of s, with the region to their left. The call tree runs through
``panels``, ``descent`` and ``polynomials``: after a change in one of them the others' cached code is stale (see
CONTRIBUTING).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cgi_wave.kernels.descent import GAUSS, I2PI, WAVES, from_far, point_away
from cgi_wave.kernels.panels import (
    CURVE_MODE,
    DIRECT_MODE,
    OK,
    RADIAL_MODE,
    SADDLE_MODE,
    SLOPE_MODE,
    add_panel,
    amplitudes,
    even_slope,
)
from cgi_wave.kernels.polynomials import (
    JIT,
    affine,
    along_ray,
    bernstein,
    bernstein_matrix,
    derivative_x,
    gradient,
    horner,
    reparameter,
    second_order,
)
from cgi_wave.kernels.series import centre_amplitude

DIRECT = 10.0  # boxes with less phase than this (cycles, range of Bernstein coefficients) are integrated directly
STRETCH = 1.6  # part of a box, in half-widths, in which a line's stationary point is looked for
EDGE = 3e-2  # distance of a boundary from a stationary point, in half-widths, below which rays from it are not used
SERIES = 1e-3  # part of the tolerance that the series of a stationary point may take
ROUND = 0.03  # least det/trace² of the second derivatives at a stationary point from which rays are used


@njit(**JIT)
def _centre(f):
    """Stationary point of f by Newton's method from the origin; (x, y, found), found within 2 of it."""
    n, x, y = f.shape[0], 0.0, 0.0
    for _ in range(30):
        local = affine(f, x, y, 1.0, 0.0, 0.0, 1.0) if n <= 6 else second_order(f, x, y)
        gx, gy, hxx, hxy, hyy = local[1, 0], local[0, 1], 2.0 * local[2, 0], local[1, 1], 2.0 * local[0, 2]
        det = hxx * hyy - hxy * hxy
        # definite, and not so elongated that rays along its long axis hardly turn
        if det <= ROUND * (hxx + hyy) ** 2:
            return x, y, False
        dx, dy = (hyy * gx - hxy * gy) / det, (hxx * gy - hxy * gx) / det
        x -= dx
        y -= dy
        if not math.hypot(x, y) < 2.0:
            return x, y, False
        if math.hypot(dx, dy) < 1e-15:
            return x, y, True
    return x, y, math.hypot(dx, dy) < 1e-12


@njit(**JIT)
def _all_round(f, a, b, w, by_series, tol, full, ws):
    """∮ C(θ) dθ over a full turn: trapezoidal rule, doubled until good to tol. Fills full (4,); (error, ok).

    C: what ∫ from the centre and E exp(i 2π f) differ by along each ray; it hangs on θ alone. By series it is the mean
    of a ray and its opposite.
    """
    n, m = f.shape[0], a.shape[0]
    fl, al, bl, wl = np.empty(n), np.empty(m + 1), np.empty(b.shape[0] + 1), np.empty(w.shape[0])
    out, before, error, missed = np.zeros(4), np.zeros(4), 1e300, 0.0
    period, rays = (math.pi, 2) if by_series else (2.0 * math.pi, 4)
    for doubling in range(7):
        rays *= 2
        for q in range(4):
            before[q] = full[q]
            full[q] *= 0.5
        for k in range(rays):
            if doubling > 0 and k % 2 == 0:
                continue  # counted in the rule before
            c, s = math.cos(period * k / rays), math.sin(period * k / rays)
            along_ray(f, c, s, fl)
            if by_series:
                along_ray(a, c, s, al[:-1])
                along_ray(b, c, s, bl[:-1])
                along_ray(w, c, s, wl)
                missed = max(missed, centre_amplitude(fl, al[:-1], bl[:-1], wl, out))
            else:
                amplitudes(a, b, w, np.int64(RADIAL_MODE), c, s, al, bl, wl)
                out[:] = 0.0
                far = point_away(fl, 0.0, 1.0, WAVES)
                if math.isnan(far) or not even_slope(fl, far):
                    return 0.0, False
                if not from_far(fl, al, bl, wl, 0.0, 0.0, fl[0], out, ws):
                    return 0.0, False
                for q in range(4):
                    out[q] = -out[q]
            for q in range(4):
                full[q] += out[q] * 2.0 * math.pi / rays
        if 2.0 * math.pi * missed > tol:
            return 0.0, False
        if doubling > 0:
            # the rule converges geometrically: twice the rays square the relative error
            change = math.hypot(full[0] - before[0], full[1] - before[1])
            error = min(change, 4.0 * change * change / max(math.hypot(full[0], full[1]), 1e-300))
            if error <= tol:
                break
    return error + 2.0 * math.pi * missed, True


@njit(**JIT)
def _centre_term(f, a, b, w, tol, sums, ws):
    """Adds the stationary point's own term, by its series if that is good to a part of tol; (error, ok)."""
    full = np.zeros(4)
    error, ok = _all_round(f, a, b, w, True, SERIES * tol, full, ws)
    if not ok:
        full[:] = 0.0
        error, ok = _all_round(f, a, b, w, False, tol, full, ws)
        if not ok:
            return 0.0, False
    turn = np.exp(I2PI * (f[0, 0] - math.floor(f[0, 0])))
    sums[0] += full[0] * turn.real - full[1] * turn.imag
    sums[1] += full[0] * turn.imag + full[1] * turn.real
    sums[2] += full[2] * turn.real - full[3] * turn.imag
    sums[3] += full[2] * turn.imag + full[3] * turn.real
    return error, True


@njit(**JIT)
def _choose(f, convert, waves):
    """(mode, cosine, sine, sign of the second derivative, stretch) of the direction in which lines are integrated.

    f in the box's own frame, |u|, |v| <= 1. Along the direction of the largest curvature lines may have one
    stationary point if the second derivative keeps its sign; along the gradient they have none if the first does.
    """
    stretch = 1.0 + min(STRETCH - 1.0, 1.3 * math.sqrt(8.0 / max(waves, 1e-300)))
    gx, gy = f[1, 0], f[0, 1]
    hxx, hxy, hyy = 2.0 * f[2, 0], f[1, 1], 2.0 * f[0, 2]
    angle = 0.5 * math.atan2(2.0 * hxy, hxx - hyy)
    if abs(hxx + hyy) > 0.0 and hxx + hyy < 0.0:
        angle += 0.5 * math.pi  # the other principal axis has the larger curvature
    slope_angle = math.atan2(gy, gx)
    for attempt in range(2):
        turn = angle if attempt == 0 else slope_angle
        c, s = math.cos(turn), math.sin(turn)
        first = derivative_x(affine(f, 0.0, 0.0, c, -s, s, c))
        if attempt == 0:
            low, high = bernstein(derivative_x(first), stretch, 1.0, convert)
            margin = 0.04
        else:
            low, high = bernstein(first, stretch, 1.0, convert)
            margin = 0.3
        if low > 0.0 and low >= margin * high:
            return np.int64(SADDLE_MODE if attempt == 0 else SLOPE_MODE), c, s, 1.0, stretch
        if high < 0.0 and -high >= margin * -low:
            return np.int64(SADDLE_MODE if attempt == 0 else SLOPE_MODE), c, s, -1.0, stretch
    return np.int64(DIRECT_MODE), 1.0, 0.0, 1.0, stretch


@njit(**JIT)
def _frame(panels, f, a, b, w, mode, cx, cy, radius, c, s, bend_sign, stretch, tol, result):
    """One box in one mode, in the frame centred on (cx, cy), of unit `radius`, turned by the angle of (c, s)."""
    xu, xv, yu, yv = radius * c, -radius * s, radius * s, radius * c
    lf = affine(f, cx, cy, xu, xv, yu, yv)
    la, lb, lw = affine(a, cx, cy, xu, xv, yu, yv), affine(b, cx, cy, xu, xv, yu, yv), affine(w, cx, cy, xu, xv, yu, yv)
    constant = lf[0, 0]
    lf[0, 0] = 0.0
    if mode == RADIAL_MODE:
        lf[1, 0], lf[0, 1] = 0.0, 0.0  # zero to the rounding of the search for the centre
    area = radius * radius
    own_tol = tol / area
    sums, spans, used = np.zeros(6), np.empty((512, 2)), np.int64(0)
    px, py = np.empty(panels.shape[2]), np.empty(panels.shape[2])
    error, nodes, turned, ws = 0.0, 0, 0.0, np.empty((21, 4 * GAUSS))
    for k in range(panels.shape[0]):
        for i in range(panels.shape[2]):
            shift_x = cx if i == 0 else 0.0
            shift_y = cy if i == 0 else 0.0
            x, y = (panels[k, 0, i] - shift_x) / radius, (panels[k, 1, i] - shift_y) / radius
            px[i], py[i] = c * x + s * y, -s * x + c * y
        if mode == RADIAL_MODE:
            angle, nearest = _turning(px, py)
            if nearest < EDGE:
                return False  # a stationary point on the boundary: half of its own term would count
            turned += angle
        part, count, used, status = add_panel(
            px, py, lf, la, lb, lw, mode, bend_sign, stretch, own_tol, sums, spans, used, ws
        )
        error += part
        nodes += count
        if status != OK:
            return False
    if mode == RADIAL_MODE and round(turned / (2.0 * math.pi)) != 0:
        part, ok = _centre_term(lf, la, lb, lw, own_tol, sums, ws)
        error += part
        if not ok:
            return False
    if used > 0:
        part, count, status = _curves(spans[:used], lf, la, lb, lw, bend_sign, stretch, own_tol, sums, ws)
        error += part
        nodes += count
        if status != OK:
            return False
    turn = np.exp(I2PI * (constant - math.floor(constant)))
    result[0] += area * (sums[0] * turn.real - sums[1] * turn.imag)
    result[1] += area * (sums[0] * turn.imag + sums[1] * turn.real)
    result[2] += area * (sums[2] * turn.real - sums[3] * turn.imag)
    result[3] += area * (sums[2] * turn.imag + sums[3] * turn.real)
    result[4] += area * error
    result[5] += area * sums[4]
    result[6] = max(result[6], sums[5] + abs(constant))
    result[7] += nodes
    return True


@njit(**JIT)
def _sampled_waves(f):
    """Cycles through which f runs on the unit disc at least: by its values at the centre and on two circles."""
    least, largest = f[0, 0], f[0, 0]
    for k in range(12):
        radius = 1.0 if k % 3 else 0.5
        value, _, _ = gradient(f, radius * math.cos(math.pi * k / 6.0), radius * math.sin(math.pi * k / 6.0))
        least, largest = min(least, value), max(largest, value)
    return largest - least


@njit(**JIT)
def _box(panels, f, a, b, w, convert, tol, result):
    """Adds one box's integral to result (8: Re, Im, Re1, Im1, error, ∫|Φ|, largest phase, nodes); False: cut it."""
    cx, cy, radius = _middle(panels)
    if radius == 0.0:
        return True
    own = affine(f, cx, cy, radius, 0.0, 0.0, radius)
    # Where samples say that it is many waves, bounds of the range are not needed: they cost as much as a piece.
    waves, bounded = _sampled_waves(own), False
    if waves <= DIRECT:
        low, high = bernstein(own, 1.0, 1.0, convert)
        waves, bounded = high - low, True
    # One call for all modes: each call of a compiled function with another constant would be compiled on its own.
    for attempt in range(2):
        mode, x, y, c, s, bend_sign, stretch = np.int64(DIRECT_MODE), 0.0, 0.0, 1.0, 0.0, 1.0, 1.0
        if waves > DIRECT and attempt == 0:
            x, y, found = _centre(own)
            mode = np.int64(RADIAL_MODE)
            if not found:
                continue
        elif waves > DIRECT:
            if not bounded:
                low, high = bernstein(own, 1.0, 1.0, convert)
                waves, bounded = high - low, True
            mode, c, s, bend_sign, stretch = _choose(own, convert, waves)
            if mode == DIRECT_MODE:
                return False
        if _frame(panels, f, a, b, w, mode, cx + radius * x, cy + radius * y, radius, c, s, bend_sign, stretch, tol,
                  result):  # fmt: skip
            return True
    return False


@njit(**JIT)
def _curves(spans, f, a, b, w, bend_sign, stretch, tol, sums, ws):
    """Adds the stationary points' own terms: S exp(i 2π f(X(y), y)) over the y that the spans cover on balance.

    S hangs on y alone, so that what the left boundary of a line adds and what another boundary of it takes away
    cancel exactly: only the lines with a boundary on both sides of X remain.
    """
    count = spans.shape[0]
    marks, steps = np.empty(2 * count), np.empty(2 * count)
    for i in range(count):
        marks[2 * i], steps[2 * i] = spans[i, 0], 1.0
        marks[2 * i + 1], steps[2 * i + 1] = spans[i, 1], -1.0
    order = np.argsort(marks)
    px, py = np.zeros(2), np.zeros(2)
    error, nodes, covered = 0.0, 0, 0.0
    none = np.empty((0, 2))
    part_sums = np.zeros(6)
    i = 0
    start = 0.0
    while i < 2 * count:
        y, before = marks[order[i]], covered
        while i < 2 * count and marks[order[i]] - y <= 1e-14:
            covered += steps[order[i]]
            i += 1
        if before != covered:
            if before != 0.0:
                py[0], py[1] = 0.5 * (start + y), 0.5 * (y - start)
                part_sums[:] = 0.0
                part, more, _, status = add_panel(
                    px, py, f, a, b, w, np.int64(CURVE_MODE), bend_sign, stretch, tol, part_sums, none, np.int64(0), ws
                )
                error += abs(before) * part
                nodes += more
                if status != OK:
                    return error, nodes, status
                for q in range(4):
                    sums[q] += before * part_sums[q]
                sums[4] += abs(before) * part_sums[4]
                sums[5] = max(sums[5], part_sums[5])
            start = y
    return error, nodes, OK


@njit(**JIT)
def _turning(px, py):
    """Angle by which a panel turns about the origin, rad, and how near it comes to it: by 16 chords.

    A chord leaves its arc by some 1e-3 of the region's size, far less than EDGE; nearer than that the angle could be
    mistaken.
    """
    total, steps, nearest = 0.0, 16, 1e300
    x0, y0 = horner(px, -1.0), horner(py, -1.0)
    for i in range(1, steps + 1):
        s = -1.0 + 2.0 * i / steps
        x1, y1 = horner(px, s), horner(py, s)
        dx, dy = x1 - x0, y1 - y0
        at = min(max(-(x0 * dx + y0 * dy) / max(dx * dx + dy * dy, 1e-300), 0.0), 1.0)
        nearest = min(nearest, math.hypot(x0 + at * dx, y0 + at * dy))
        total += math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
        x0, y0 = x1, y1
    return total, nearest


@njit(**JIT)
def _middle(panels):
    """Centre of the panels' bounding box and the largest distance of the boundary from it."""
    lo_x, hi_x, lo_y, hi_y = 1e300, -1e300, 1e300, -1e300
    for k in range(panels.shape[0]):
        for i in range(-1, 9):
            s = -1.0 if i < 0 else -0.75 + 0.25 * i
            x, y = horner(panels[k, 0], min(s, 1.0)), horner(panels[k, 1], min(s, 1.0))
            lo_x, hi_x, lo_y, hi_y = min(lo_x, x), max(hi_x, x), min(lo_y, y), max(hi_y, y)
    cx, cy, radius = 0.5 * (lo_x + hi_x), 0.5 * (lo_y + hi_y), 0.0
    for k in range(panels.shape[0]):
        for i in range(-1, 9):
            s = -1.0 if i < 0 else -0.75 + 0.25 * i
            radius = max(radius, math.hypot(horner(panels[k, 0], min(s, 1.0)) - cx,
                                            horner(panels[k, 1], min(s, 1.0)) - cy))  # fmt: skip
    return cx, cy, 1.001 * radius


@njit(**JIT)
def _split(panels, axis, value):
    """The region on both sides of a line (coordinate `axis` = value), as panels; (low, high, ok).

    ok is False when the boundary crosses the line an odd number of times: it touches it within rounding.
    """
    count, d = panels.shape[0], panels.shape[2]
    low, high = np.empty((2 * count + 64, 2, d)), np.empty((2 * count + 64, 2, d))
    n_low, n_high, crossings, found = 0, 0, np.empty(64), 0
    roots = np.empty(34)
    for k in range(count):
        c = panels[k, axis].copy()
        c[0] -= value
        used, s0 = 0, -1.0
        f0 = horner(c, s0)
        for i in range(1, 17):
            s1 = -1.0 + i / 8.0
            f1 = horner(c, s1)
            if (f0 < 0.0) != (f1 < 0.0):
                lo, hi = s0, s1
                for _ in range(60):
                    mid = 0.5 * (lo + hi)
                    if (horner(c, mid) < 0.0) == (f0 < 0.0):
                        lo = mid
                    else:
                        hi = mid
                roots[used] = 0.5 * (lo + hi)
                used += 1
                if found == crossings.size:
                    return low[:0], high[:0], False
                crossings[found] = horner(panels[k, 1 - axis], roots[used - 1])
                found += 1
            s0, f0 = s1, f1
        before = -1.0
        for r in range(used + 1):
            after = roots[r] if r < used else 1.0
            below = horner(c, 0.5 * (before + after)) < 0.0
            if (n_low if below else n_high) >= 2 * count:
                return low[:0], high[:0], False
            for q in range(2):
                part = low[n_low, q] if below else high[n_high, q]
                reparameter(panels[k, q], 0.5 * (before + after), 0.5 * (after - before), part)
            if below:
                n_low += 1
            else:
                n_high += 1
            before = after
    if found % 2:
        return low[:0], high[:0], False
    ordered = np.sort(crossings[:found])
    for p in range(found // 2):
        y0, y1 = ordered[2 * p], ordered[2 * p + 1]
        up = axis == 0  # the low side has the line on its right (axis 0) or above it (axis 1)
        for side in range(2):
            part = low[n_low] if side == 0 else high[n_high]
            part[:, :] = 0.0
            part[axis, 0] = value
            part[1 - axis, 0] = 0.5 * (y0 + y1)
            part[1 - axis, 1] = 0.5 * (y1 - y0) * (1.0 if up == (side == 0) else -1.0)
        n_low += 1
        n_high += 1
    return low[:n_low].copy(), high[:n_high].copy(), True


@njit(**JIT)
def integrate(panels, f, a, b, w, tol, most_boxes):
    """Integral over the region of a b exp(i 2π f), and of w a b exp(i 2π f).

    panels (K, 2, D): closed oriented boundary, the region to its left, powers of s in [-1, 1]. f (n, n) in cycles;
    a (m, m), b (k, k); w (q, q), q = 0 for none. tol: absolute error asked of each boundary panel.

    Returns (result (8,): Re, Im, Re and Im with w, error, ∫|amplitude| along the boundary, largest phase in cycles,
    nodes; boxes; ok).
    """
    result, convert = np.zeros(8), bernstein_matrix(f.shape[0])
    stack = [panels]
    boxes = 0
    while len(stack) > 0:
        here = stack.pop()
        if here.shape[0] == 0:
            continue
        boxes += 1
        if boxes > most_boxes:
            return result, boxes, False
        if _box(here, f, a, b, w, convert, tol, result):
            continue
        cx, cy, _ = _middle(here)
        lo_x, hi_x, lo_y, hi_y = cx, cx, cy, cy
        for k in range(here.shape[0]):
            for i in range(9):
                x, y = horner(here[k, 0], -1.0 + 0.25 * i), horner(here[k, 1], -1.0 + 0.25 * i)
                lo_x, hi_x, lo_y, hi_y = min(lo_x, x), max(hi_x, x), min(lo_y, y), max(hi_y, y)
        axis = 0 if hi_x - lo_x >= hi_y - lo_y else 1
        size, centre = max(hi_x - lo_x, hi_y - lo_y), (cx if axis == 0 else cy)
        done = False
        for attempt in range(6):
            # never through the middle of a symmetric pupil, where corners and stationary points like to stand
            low, high, ok = _split(here, axis, centre + size * (0.0137 + 0.0211 * attempt))
            if ok:
                stack.append(low)
                stack.append(high)
                done = True
                break
        if not done:
            return result, boxes, False
    return result, boxes, True
