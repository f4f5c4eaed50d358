"""One boundary panel of ``kernels.stokes``: amplitudes at nodes, pieces that resolve them, and what that leaves."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cgi_wave.kernels.descent import (
    EXACT,
    GAUSS,
    I2PI,
    W16,
    WAVES,
    X16,
    add_span,
    descent_from,
    from_far,
    stationary_point,
    stationary_term,
    steepest_slope,
)
from cgi_wave.kernels.polynomials import (
    JIT,
    along_ray,
    horner,
    on_lines,
    on_rays,
    powers,
    restrict,
    slope_at,
    taylors,
)
from cgi_wave.kernels.series import MOST, distance, far_amplitudes, terms_for
from cgi_wave.kernels.turns import FAST, half_turn

CYCLES = 3.0  # phase per Gauss panel
WIDE, WIDE_CYCLES = 4 * GAUSS, 22.0  # nodes of a wide one, which takes half as many of them a cycle, and its phase
SPAN_CYCLES = 1.75  # the same across the area, where the phase is less even
PIECES = 600  # pieces of one boundary panel before another mode, or a smaller box, is tried
DEPTH = 26  # halvings of a boundary panel
RULES = 1e-6  # part of a panel's tolerance that rules at its nodes may take
WORTH = 1e-7  # the same for the end of its series
ROUGHEST = 1e-6  # of them, where so little is asked for
OK, DEEP, CROWDED = 0, 1, 2
DIRECT_MODE, RADIAL_MODE, SADDLE_MODE, SLOPE_MODE, CURVE_MODE = 0, 1, 2, 3, 4
NEAR, RIGHT, LEFT = 0, 1, -1

_X64, _W64 = np.polynomial.legendre.leggauss(WIDE)
TO_CHEBYSHEV = np.linalg.inv(np.polynomial.chebyshev.chebvander(X16, GAUSS - 1))
TO_POWERS = np.zeros((GAUSS, GAUSS))  # Chebyshev coefficients -> powers
for _k in range(GAUSS):
    TO_POWERS[: _k + 1, _k] = np.polynomial.chebyshev.cheb2poly(np.eye(GAUSS)[_k])[: _k + 1]


@njit(**JIT)
def even_slope(fl, r):
    """Whether f'(t)/t keeps its sign on 0 < t <= r (Bernstein coefficients of one sign): one stationary point, at 0."""
    n = fl.shape[0] - 2
    if n < 1 or fl[2] == 0.0:
        return False
    power, rest = 1.0, 0.0
    for k in range(1, n):
        power *= r
        rest += (k + 2) * abs(fl[k + 2]) * power
    if rest < 1.9 * abs(fl[2]):
        return True
    sign = 1.0 if fl[2] > 0.0 else -1.0
    for p in range(n):
        # Bernstein coefficient p of degree n - 1: sum_k C(p, k) / C(n - 1, k) d_k r^k
        total, choose, power = 2.0 * fl[2], 1.0, 1.0
        for k in range(1, p + 1):
            choose *= (p - k + 1.0) / (n - k)
            power *= r
            total += choose * (k + 2) * fl[k + 2] * power
        if total * sign <= 0.1 * abs(fl[2]):
            return False
    return True


@njit(**JIT)
def _classify(fl, x, bend_sign, stretch, guess):
    """(class, distance from the stationary point in waves, the point or NaN) of x on its line."""
    at = stationary_point(fl, -stretch, stretch, guess)
    if math.isnan(at):
        side = RIGHT if slope_at(fl, x) * bend_sign > 0.0 else LEFT
        return side, 1e300, at
    delta = abs(horner(fl, x) - horner(fl, at))
    if delta < WAVES:
        return NEAR, delta, at
    return (RIGHT if x > at else LEFT), delta, at


@njit(**JIT)
def _locate(px, py, f, mode, bend_sign, stretch, lo, hi, power, lines, place, delta, cls):
    """The 16 nodes of a piece of a panel: their lines and where on them they lie; False if a ray has two regimes.

    lines (16, n): powers of f along the line of each node; power: of their cosines; place (5, 16):
    coordinate along it, y of the line, weight dy (dθ for rays), stationary point, and the ray's cosine or 0.
    """
    half, guess = 0.5 * (hi - lo), 0.0
    for i in range(GAUSS):
        s = 0.5 * (lo + hi) + half * X16[i]
        x, y, dy = horner(px, s), horner(py, s), slope_at(py, s) * half
        place[3, i], place[4, i] = math.nan, 0.0
        if mode == RADIAL_MODE:
            r = math.hypot(x, y)
            if r == 0.0:
                return False
            place[0, i], place[1, i], place[2, i] = r, y / r, (x * dy - y * slope_at(px, s) * half) / (r * r)
            place[3, i], place[4, i] = 0.0, x / r
        else:
            place[0, i], place[1, i], place[2, i] = x, y, dy
    if mode == RADIAL_MODE:
        powers(place[4], power)
        on_rays(f, power, place[1], lines)
        for i in range(GAUSS):
            r = place[0, i]
            if not even_slope(lines[i], r):
                return False
            delta[i] = abs(horner(lines[i], r) - lines[i, 0])
            cls[i] = NEAR if delta[i] < WAVES else RIGHT
        return True
    on_lines(f, place[1], lines)
    for i in range(GAUSS):
        cls[i], delta[i] = RIGHT, 1e300
        if mode == SADDLE_MODE or mode == CURVE_MODE:
            cls[i], delta[i], place[3, i] = _classify(lines[i], place[0, i], bend_sign, stretch, guess)
            if not math.isnan(place[3, i]):
                guess = place[3, i]
    return True


@njit(**JIT)
def _side(place, delta, cls):
    """(class of all 16 nodes together, whether they have one). A node within a quarter of WAVES fits both classes."""
    nearest, furthest, right, left = 1e300, 0.0, False, False
    for i in range(GAUSS):
        nearest, furthest = min(nearest, delta[i]), max(furthest, delta[i])
        inside = not math.isnan(place[3, i]) and place[0, i] < place[3, i]
        if cls[i] == LEFT or (cls[i] == NEAR and inside):
            left = True
        else:
            right = True
    if furthest <= 1.25 * WAVES:
        return NEAR, True
    if nearest >= 0.8 * WAVES and left != right:
        return (LEFT if left else RIGHT), True
    return NEAR, False


@njit(**JIT)
def _cut(px, py, f, mode, bend_sign, stretch, lo, hi, delta, line):
    """Where to cut a piece whose nodes are of two classes: where the distance is about WAVES."""
    cut, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
    for i in range(GAUSS - 1):
        if (delta[i] < WAVES) != (delta[i + 1] < WAVES):
            s0, s1 = cut + half * X16[i], cut + half * X16[i + 1]
            below, middle = delta[i] < WAVES, cut
            for _ in range(20):
                middle = 0.5 * (s0 + s1)
                x, y = horner(px, middle), horner(py, middle)
                if mode == RADIAL_MODE:
                    r = math.hypot(x, y)
                    along_ray(f, x / r, y / r, line)
                    here = abs(horner(line, r) - line[0])
                else:
                    restrict(f, y, line)
                    _, here, _ = _classify(line, x, bend_sign, stretch, 0.0)
                if 0.9 * WAVES < here < 1.1 * WAVES:
                    break
                if (here < WAVES) == below:
                    s0 = middle
                else:
                    s1 = middle
            return middle
    return cut


@njit(**JIT)
def amplitudes(a, b, w, mode, c, s, al, bl, wl):
    """Amplitudes along a line at height s, or along the ray (c, s) with the r of the area element r dr dθ."""
    al[:], bl[:] = 0.0, 0.0
    if mode == RADIAL_MODE:
        along_ray(a, c, s, al[1:])
        along_ray(b, c, s, bl[:-1])
        if wl.shape[0] > 0:
            along_ray(w, c, s, wl)
    else:
        restrict(a, s, al[:-1])
        restrict(b, s, bl[:-1])
        if wl.shape[0] > 0:
            restrict(w, s, wl)


@njit(**JIT)
def _amplitudes(a, b, w, mode, power, place, als, bls, wls):
    """``amplitudes`` at all nodes of a piece: als, bls (16, one more than their terms), wls (16, terms)."""
    m, other = a.shape[0], b.shape[0]
    if mode == RADIAL_MODE:
        als[:, 0], bls[:, other] = 0.0, 0.0
        on_rays(a, power, place[1], als[:, 1:])
        on_rays(b, power, place[1], bls[:, :other])
        if w.shape[0] > 0:
            on_rays(w, power, place[1], wls)
    else:
        als[:, m], bls[:, other] = 0.0, 0.0
        on_lines(a, place[1], als[:, :m])
        on_lines(b, place[1], bls[:, :other])
        if w.shape[0] > 0:
            on_lines(w, place[1], wls)


@njit(**JIT)
def _far(lines, tangents, place, als, bls, wls, values, tol, work, ws):
    """``_values`` of nodes that are all beyond the stationary point: by one series, or else by steepest descent.

    tangents (n or more, 16), work (6, n, 16): working space. Errors allowed are a small part of ``tol`` each.
    """
    n, nearest, largest = lines.shape[1], 1e300, 0.0
    taylors(lines, place[0], tangents)
    for i in range(GAUSS):
        slope, x = tangents[1, i], place[0, i]
        if slope == 0.0:
            return False
        nearest = min(nearest, distance(slope, tangents[2, i], tangents[3, i]))
        largest = max(largest, abs(horner(als[i], x) * horner(bls[i], x) / slope * place[2, i]))
        values[0, i] = tangents[0, i]
    allowed = min(max(RULES * 2.0 * math.pi * tol / max(largest, 1e-300), EXACT), ROUGHEST)
    terms, missed = terms_for(nearest, allowed)
    if terms > 0:
        found = far_amplitudes(tangents, als, bls, wls, place[0], terms, nearest, work, values[1:])
        if found <= 4.0 * allowed:
            for q in range(4 if wls.shape[1] > 0 else 2):
                for i in range(GAUSS):
                    values[1 + q, i] *= place[2, i]
            ws[15, 0] = max(ws[15, 0], found, missed)
            return True
    c = ws[4][:n]
    for i in range(GAUSS):
        for k in range(n):
            c[k] = tangents[k, i]
        e0, e1, ok = descent_from(c, als[i], bls[i], wls[i], place[0, i], allowed, ws)
        if not ok:
            return False
        values[1, i], values[2, i] = e0.real * place[2, i], e0.imag * place[2, i]
        values[3, i], values[4, i] = e1.real * place[2, i], e1.imag * place[2, i]
    return True


@njit(**JIT)
def _values(mode, lines, place, als, bls, wls, values, ws):
    """Phase and amplitudes (5, 16) of Φ dy at the nodes; False where the asymptotic regime is not reached.

    values: phase in cycles; Re and Im of the amplitude; the same times the further factor.
    """
    out = np.zeros(4)
    for i in range(GAUSS):
        fl, x, at = lines[i], place[0, i], place[3, i]
        al, bl, wl = als[i], bls[i], wls[i]
        out[:] = 0.0
        values[0, i] = 0.0
        if mode == DIRECT_MODE:
            turns = steepest_slope(fl, min(0.0, x), max(0.0, x)) * abs(x)
            add_span(fl, al, bl, wl, 0.0, x, 1 + int(turns / SPAN_CYCLES), 0.0, out, ws)
        else:
            if math.isnan(at):
                return False
            values[0, i] = horner(fl, at)
            if mode == CURVE_MODE:
                ok = stationary_term(fl, al, bl, wl, at, values[0, i], out, ws)
            else:
                ok = from_far(fl, al, bl, wl, at, x, values[0, i], out, ws)
            if not ok:
                return False
        for q in range(4):
            values[1 + q, i] = out[q] * place[2, i]
    return True


@njit(**JIT)
def _series(values, cheb):
    """Chebyshev coefficients (5, 16) of values at the Gauss nodes."""
    for q in range(values.shape[0]):
        for k in range(GAUSS):
            total = 0.0
            for i in range(GAUSS):
                total += TO_CHEBYSHEV[k, i] * values[q, i]
            cheb[q, k] = total


@njit(**JIT)
def _decay(c, d):
    """(size of the last three coefficients of the pair c, d; factor per three degrees by which they fall).

    The factor is the slower one of the last two steps and of the mean of three, so that one accidentally small group
    does not look like convergence.
    """
    groups = np.zeros(4)
    for k in range(GAUSS - 12, GAUSS):
        groups[(k - GAUSS + 12) // 3] = max(groups[(k - GAUSS + 12) // 3], math.hypot(c[k], d[k]))
    end, largest = groups[3], 0.0
    for k in range(GAUSS):
        largest = max(largest, math.hypot(c[k], d[k]))
    if end <= 1e-15 * largest:
        return 0.0, 0.0  # down to rounding, which is counted with the sums
    rate = max(end / max(groups[2], 1e-300), math.sqrt(end / max(groups[1], 1e-300)))
    rate = max(rate, (end / max(groups[0], 1e-300)) ** (1.0 / 3.0))
    return end, min(rate, 1.0)


@njit(**JIT)
def _tail(c, d):
    """What lies beyond degree 15 of a series whose coefficients go on falling as the last ones do."""
    end, rate = _decay(c, d)
    return 2.0 * end * rate / (1.0 - min(rate, 0.8))


@njit(**JIT)
def _gauss_tail(c, d):
    """What 16 Gauss points miss of a function with these Chebyshev coefficients: its part beyond degree 31.

    Degree 32 lies six steps of three degrees beyond the last coefficients; five of them are believed.
    """
    end, rate = _decay(c, d)
    return 10.0 * end * rate**5 / (1.0 - min(rate, 0.8))


@njit(cache=True, nogil=True, fastmath=FAST)
def wave_sum(t, w, phase, re, im, turns, a, b):
    """Sum over nodes t of w (re + i im) exp(i 2π phase), all three given as powers of t, a multiple of four of them."""
    size = t.shape[0]
    for i in range(size):
        turns[i], a[i], b[i] = 0.0, 0.0, 0.0
    for k in range(phase.shape[0] - 4, -1, -4):  # four at a time: less to load and to store
        p0, p1, p2, p3 = phase[k], phase[k + 1], phase[k + 2], phase[k + 3]
        q0, q1, q2, q3 = re[k], re[k + 1], re[k + 2], re[k + 3]
        r0, r1, r2, r3 = im[k], im[k + 1], im[k + 2], im[k + 3]
        for i in range(size):
            x = t[i]
            turns[i] = (((turns[i] * x + p3) * x + p2) * x + p1) * x + p0
            a[i] = (((a[i] * x + q3) * x + q2) * x + q1) * x + q0
            b[i] = (((b[i] * x + r3) * x + r2) * x + r1) * x + r0
    real, imag = 0.0, 0.0
    for i in range(size):
        sine, cosine = half_turn((turns[i] - math.floor(turns[i] + 0.5)) * math.pi)
        co, si = (1.0 - 2.0 * sine * sine) * w[i], 2.0 * sine * cosine * w[i]
        real += a[i] * co - b[i] * si
        imag += a[i] * si + b[i] * co
    return real, imag


@njit(**JIT)
def _worth(cheb, largest, spare):
    """(how many coefficients of the series (Q, 16) are worth their time, what the others change by at most).

    A multiple of four. spare: what they may change the integral by; largest: amplitude.
    """
    used, left = GAUSS, 0.0
    while used > 4:
        here = 0.0
        for k in range(used - 4, used):
            here += 4.0 * math.pi * largest * abs(cheb[0, k])
            for q in range(1, cheb.shape[0]):
                here += 2.0 * abs(cheb[q, k])
        if left + here > spare:
            break
        left += here
        used -= 4
    return used, left


@njit(**JIT)
def _add(cheb, power, used, pieces, size, sums, ws):
    """Adds the integral over a piece of many waves: amplitude times exp(i 2π phase), interpolated to Gauss panels.

    pieces: panels; size: nodes of each, GAUSS or WIDE.
    """
    for q in range(cheb.shape[0]):
        for k in range(used):
            total = 0.0
            for j in range(k, used):
                total += TO_POWERS[k, j] * cheb[q, j]
            power[q, k] = total
    turns, are, aim = ws[18], ws[19], ws[20]
    x, w = (X16, W16) if size == GAUSS else (_X64, _W64)
    t, wt = ws[16, :size], ws[17, :size]
    for p in range(pieces):
        for g in range(size):
            t[g], wt[g] = -1.0 + (2.0 * p + 1.0 + x[g]) / pieces, w[g] / pieces
        for channel in range(cheb.shape[0] // 2):
            re, im = wave_sum(t, wt, power[0, :used], power[1 + 2 * channel, :used], power[2 + 2 * channel, :used],
                              turns, are, aim)  # fmt: skip
            sums[2 * channel] += re
            sums[2 * channel + 1] += im


@njit(**JIT)
def add_panel(px, py, f, a, b, w, mode, bend_sign, stretch, tol, sums, spans, spans_used, ws):
    """Adds ∮ Φ dy over one boundary panel to sums; returns (error, nodes, spans used, status).

    sums (6,): Re, Im of the integral, the same with the further factor, ∫|amplitude|, largest |phase|. spans collects
    the (y from, y to) of the parts that lie beyond the stationary point. status OK, DEEP (not resolved: another
    mode, or a smaller box, has to be tried) or CROWDED.
    """
    n, m = f.shape[0], a.shape[0]
    als, bls, wls = np.empty((GAUSS, m + 1)), np.empty((GAUSS, b.shape[0] + 1)), np.empty((GAUSS, w.shape[0]))
    most, line, tangents = max(n, m, b.shape[0], w.shape[0]), np.empty(n), np.empty((max(n, MOST + 2), GAUSS))
    work = np.empty((6, MOST + 2, GAUSS))
    cosines = np.empty((most, GAUSS))
    ends, level = np.empty((DEPTH + 4, 2)), np.empty(DEPTH + 4, np.int64)
    ends[0, 0], ends[0, 1], level[0] = -1.0, 1.0, 0
    top, error, nodes = 1, 0.0, 0
    lines, place = np.empty((GAUSS, n)), np.empty((5, GAUSS))
    cls, delta = np.empty(GAUSS, np.int64), np.empty(GAUSS)
    values, cheb, power = np.empty((5, GAUSS)), np.empty((5, GAUSS)), np.empty((5, GAUSS))
    wave, wave_cheb, pieces_used = np.empty((4, GAUSS)), np.empty((2, GAUSS)), 0
    channels = 5 if w.shape[0] > 0 else 3  # phase, and Re and Im of one amplitude or two
    while top > 0:
        pieces_used += 1
        if pieces_used > PIECES:
            return error, nodes, spans_used, DEEP
        top -= 1
        lo, hi, depth = ends[top, 0], ends[top, 1], level[top]
        if not _locate(px, py, f, mode, bend_sign, stretch, lo, hi, cosines, lines, place, delta, cls):
            return error, nodes, spans_used, DEEP
        whole, one = RIGHT, True
        if mode == SADDLE_MODE or mode == RADIAL_MODE:
            whole, one = _side(place, delta, cls)
        cut, values_found = math.nan, False
        nodes += GAUSS
        ws[15, 0] = 0.0
        if not one:
            cut = _cut(px, py, f, mode, bend_sign, stretch, lo, hi, delta, line)
        else:
            _amplitudes(a, b, w, mode, cosines, place, als, bls, wls)
            if mode == DIRECT_MODE or mode == CURVE_MODE or whole == NEAR:
                values_found = _values(mode, lines, place, als, bls, wls, values, ws)
            else:
                values_found = _far(lines, tangents, place, als, bls, wls, values, tol, work, ws)
        if one and not values_found:
            # nodes that reach neither regime: only a smaller part of the boundary may
            if mode == CURVE_MODE or hi - lo < 1e-3:
                return error, nodes, spans_used, DEEP
            cut = 0.5 * (lo + hi)
        elif one:
            largest, fastest, scale = 0.0, 0.0, 0.0
            for i in range(GAUSS):
                largest, scale = max(largest, math.hypot(values[1, i], values[2, i])), max(scale, abs(values[0, i]))
                if i > 0:
                    fastest = max(fastest, abs((values[0, i] - values[0, i - 1]) / (X16[i] - X16[i - 1])))
            pieces = 1 + int(2.4 * fastest / CYCLES)
            if pieces == 1:
                for i in range(GAUSS):
                    turn = np.exp(I2PI * (values[0, i] - math.floor(values[0, i])))
                    for q in range(0, channels - 1, 2):
                        wave[q, i] = values[1 + q, i] * turn.real - values[2 + q, i] * turn.imag
                        wave[q + 1, i] = values[1 + q, i] * turn.imag + values[2 + q, i] * turn.real
                _series(wave[:2], wave_cheb)
                here = _gauss_tail(wave_cheb[0], wave_cheb[1])
            else:
                _series(values[:channels], cheb)
                here = 2.0 * (_tail(cheb[1], cheb[2]) + 2.0 * math.pi * largest * _tail(cheb[0], cheb[0]))
            if here > tol and depth < DEPTH:
                cut = 0.5 * (lo + hi)
            elif here > 1e3 * tol:
                return error, nodes, spans_used, DEEP
            else:
                error += here + 2.0 * largest * ws[15, 0]
                sums[4] += 2.0 * largest
                sums[5] = max(sums[5], scale)
                if mode == SADDLE_MODE and whole == LEFT:
                    if spans_used >= spans.shape[0]:
                        return error, nodes, spans_used, CROWDED
                    spans[spans_used, 0], spans[spans_used, 1] = horner(py, lo), horner(py, hi)
                    spans_used += 1
                size = GAUSS
                if pieces > 4:
                    size, pieces = WIDE, 1 + int(2.4 * fastest / WIDE_CYCLES)
                nodes += pieces * size
                if pieces == 1 and size == GAUSS:
                    for q in range(channels - 1):
                        for i in range(GAUSS):
                            sums[q] += wave[q, i] * W16[i]
                else:
                    used, dropped = _worth(cheb[:channels], largest, WORTH * tol)
                    error += dropped
                    _add(cheb[:channels], power, used, pieces, size, sums, ws)
        if not math.isnan(cut):
            if depth >= DEPTH or top + 2 > ends.shape[0]:
                return error, nodes, spans_used, DEEP
            ends[top, 0], ends[top, 1], level[top] = lo, cut, depth + 1
            ends[top + 1, 0], ends[top + 1, 1], level[top + 1] = cut, hi, depth + 1
            top += 2
    return error, nodes, spans_used, OK
