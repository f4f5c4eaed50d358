"""Antiderivatives along one line, exp(i 2π f) taken out: by steepest descent, and directly where that does not reach.

Polynomials are powers of the coordinate along the line, f in cycles; ws (rows, 64) is working space, ws[15, 0] gathers
the largest relative error of the rules used. Part of the call tree of ``kernels.stokes``, which says what it is for.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cgi_wave.kernels.polynomials import JIT, horner, slope_at, taylor
from cgi_wave.kernels.series import distance
from cgi_wave.kernels.turns import FAST, half_turn

GAUSS = 16
WAVES = 4.0  # distance from a stationary point, in waves, from which the steepest-descent amplitude is used
X16, W16 = np.polynomial.legendre.leggauss(GAUSS)

# Gauss-Laguerre rules, and the distance P (rad of phase to the nearest saddle) at which each is good to EXACT: the
# error of n nodes on (1 + i p/P)^(-1/2), the amplitude of a quadratic phase, is below (n!)²/P^(2n).
EXACT = 1e-12
_COUNTS = np.array([2, 3, 4, 5, 6, 8, 10, 12, 16])
_LAG_X, _LAG_W = np.zeros((_COUNTS.size, 16)), np.zeros((_COUNTS.size, 16))
for _k, _n in enumerate(_COUNTS):
    _LAG_X[_k, :_n], _LAG_W[_k, :_n] = np.polynomial.laguerre.laggauss(int(_n))
_LAG_X /= 2.0 * np.pi  # cycles
_LOG_REACH = np.array([math.log(math.factorial(int(n)) ** 2 / EXACT) / (2.0 * int(n)) for n in _COUNTS])
# Panels between a stationary point and WAVES from it: fractions at which the quadratic phase turns evenly enough.
_NEAR = np.array([0.0, 0.5, 0.77, 1.0])

I2PI = 2j * math.pi


@njit(cache=True, nogil=True, fastmath=FAST)
def _direct(lo, hi, fl, al, bl, wl, zero, ws):
    """Integral from lo to hi of a b exp(i 2π (f − zero)), and of the same times the further factor, by 16 Gauss points.

    exp(i 2π r) by the half angle: sine and cosine of π r, |r| <= 1/2, from their Taylor series to rounding, so that
    the loop has no branch and no library call and vectorises. ws (rows, 64): working space.
    """
    middle, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
    if fl.shape[0] == 5 and al.shape[0] == 2 and wl.shape[0] == 0:
        # Seidel's phase and even pupils: all in registers, in three fifths of the time.
        c0, c1, c2, c3, c4 = fl[0] - zero, fl[1], fl[2], fl[3], fl[4]
        a0, a1, b0, b1 = al[0], al[1], bl[0], bl[1]
        re, im = 0.0, 0.0
        for i in range(GAUSS):
            at = middle + half * X16[i]
            turn = (((c4 * at + c3) * at + c2) * at + c1) * at + c0
            sine, cosine = half_turn((turn - math.floor(turn + 0.5)) * math.pi)
            ab = (a1 * at + a0) * (b1 * at + b0) * W16[i]
            re += ab * (1.0 - 2.0 * sine * sine)
            im += ab * 2.0 * sine * cosine
        return re * half, im * half, 0.0, 0.0
    x, phi, a, b = ws[0], ws[1], ws[2], ws[3]
    for i in range(GAUSS):
        x[i], phi[i], a[i], b[i] = middle + half * X16[i], 0.0, 0.0, 0.0
    for k in range(fl.shape[0] - 1, -1, -1):
        p = fl[k]
        for i in range(GAUSS):
            phi[i] = phi[i] * x[i] + p
    for k in range(al.shape[0] - 1, -1, -1):
        p = al[k]
        for i in range(GAUSS):
            a[i] = a[i] * x[i] + p
    for k in range(bl.shape[0] - 1, -1, -1):
        p = bl[k]
        for i in range(GAUSS):
            b[i] = b[i] * x[i] + p
    re, im = 0.0, 0.0
    for i in range(GAUSS):
        turn = phi[i] - zero
        sine, cosine = half_turn((turn - math.floor(turn + 0.5)) * math.pi)
        ab = a[i] * b[i] * W16[i]
        a[i], b[i] = ab * (1.0 - 2.0 * sine * sine), ab * 2.0 * sine * cosine
        re += a[i]
        im += b[i]
    re1, im1 = 0.0, 0.0
    if wl.shape[0] > 0:
        for i in range(GAUSS):
            phi[i] = 0.0
        for k in range(wl.shape[0] - 1, -1, -1):
            p = wl[k]
            for i in range(GAUSS):
                phi[i] = phi[i] * x[i] + p
        for i in range(GAUSS):
            re1 += a[i] * phi[i]
            im1 += b[i] * phi[i]
    return re * half, im * half, re1 * half, im1 * half


@njit(**JIT)
def stationary_point(fl, lo, hi, guess):
    """Root of f' on [lo, hi], where f' is monotone; NaN if there is none. Newton kept inside the bracket."""
    s_lo, s_hi = slope_at(fl, lo), slope_at(fl, hi)
    if (s_lo < 0.0) == (s_hi < 0.0):
        return math.nan
    rising = s_hi > s_lo
    x = guess if lo < guess < hi else 0.5 * (lo + hi)
    for _ in range(80):
        slope, bend = 0.0, 0.0
        for k in range(fl.shape[0] - 1, 0, -1):
            bend = bend * x + slope
            slope = slope * x + k * fl[k]
        if (slope > 0.0) == rising:
            hi = x
        else:
            lo = x
        step = x - slope / bend if bend != 0.0 else lo
        if not (lo <= step <= hi):
            step = 0.5 * (lo + hi)
        if abs(step - x) <= 1e-15:
            return step
        x = step
    return x


@njit(**JIT)
def point_away(fl, x, side, waves):
    """Point where the line's phase has turned by `waves` from its stationary point x, on one side; NaN if not found."""
    f0, bend = horner(fl, x), 0.0
    for k in range(fl.shape[0] - 1, 1, -1):
        bend = bend * x + k * (k - 1) * fl[k]
    if bend == 0.0:
        return math.nan
    sign = 1.0 if bend > 0.0 else -1.0
    at = x + side * math.sqrt(2.0 * waves / abs(bend))
    for _ in range(30):
        slope = slope_at(fl, at)
        if slope * side * sign <= 0.0:
            return math.nan
        step = (horner(fl, at) - f0 - sign * waves) / slope
        at -= step
        if (at - x) * side <= 0.0:
            return math.nan
        if abs(step) <= 1e-13 * abs(at - x):
            return at
    return math.nan


@njit(**JIT)
def _rule(c, allowed):
    """(index of the smallest Gauss-Laguerre rule whose relative error is ``allowed``, that error); −1 if none is.

    c: Taylor coefficients of a line's phase, of which the first three tell how far the nearest saddle is.
    """
    nearest = distance(c[1], c[2] if c.shape[0] > 2 else 0.0, c[3] if c.shape[0] > 3 else 0.0)
    here, slack = math.log(nearest), math.log(allowed / EXACT)
    for k in range(_COUNTS.size):
        margin = 2.0 * _COUNTS[k] * (_LOG_REACH[k] - here)
        if margin <= slack:
            return k, EXACT * math.exp(margin)
    return -1, 0.0


@njit(cache=True, nogil=True, fastmath=FAST)
def _newton(c, target, count, ur, ui, sr, si, vr, vi):
    """One Newton step of sum_{k>0} c_k u^k = i target for `count` nodes u at a time; returns largest |step|/|u|.

    sr, si: the derivative before the step.
    """
    if c.shape[0] == 5:  # Seidel's phase: in registers
        c1, c2, c3, c4 = c[1], c[2], c[3], c[4]
        largest = 0.0
        for j in range(count):
            x, y = ur[j], ui[j]
            # value/u and derivative: ((c4 u + c3) u + c2) u + c1, ((4 c4 u + 3 c3) u + 2 c2) u + c1
            ar, ai = c4 * x + c3, c4 * y
            br, bi = ar * x - ai * y + c2, ar * y + ai * x
            ar, ai = br * x - bi * y + c1, br * y + bi * x
            dr, di = 4.0 * c4 * x + 3.0 * c3, 4.0 * c4 * y
            br, bi = dr * x - di * y + 2.0 * c2, dr * y + di * x
            dr, di = br * x - bi * y + c1, br * y + bi * x
            sr[j], si[j] = dr, di
            a, b = ar * x - ai * y, ar * y + ai * x - target[j]
            size = dr * dr + di * di
            dx, dy = (a * dr + b * di) / size, (b * dr - a * di) / size
            ur[j] = x - dx
            ui[j] = y - dy
            largest = max(largest, (dx * dx + dy * dy) / (x * x + y * y))
        return math.sqrt(largest)
    for j in range(count):
        vr[j], vi[j], sr[j], si[j] = 0.0, 0.0, 0.0, 0.0
    for k in range(c.shape[0] - 1, 0, -1):
        p = c[k]
        for j in range(count):
            x, y = ur[j], ui[j]
            # derivative and value by Horner: s = s u + v, v = v u + c
            a, b = sr[j] * x - si[j] * y + vr[j], sr[j] * y + si[j] * x + vi[j]
            sr[j], si[j] = a, b
            a, b = vr[j] * x - vi[j] * y + p, vr[j] * y + vi[j] * x
            vr[j], vi[j] = a, b
    worst = 0.0
    for j in range(count):
        x, y = ur[j], ui[j]
        # one more step: no constant term
        a, b = sr[j] * x - si[j] * y + vr[j], sr[j] * y + si[j] * x + vi[j]
        sr[j], si[j] = a, b
        a, b = vr[j] * x - vi[j] * y, vr[j] * y + vi[j] * x - target[j]
        size = sr[j] * sr[j] + si[j] * si[j]
        dx, dy = (a * sr[j] + b * si[j]) / size, (b * sr[j] - a * si[j]) / size
        ur[j] = x - dx
        ui[j] = y - dy
        worst = max(worst, (dx * dx + dy * dy) / (x * x + y * y))
    return math.sqrt(worst)


@njit(cache=True, nogil=True, fastmath=FAST)
def _at(c, count, zr, zi, vr, vi):
    """Values of a real polynomial at complex points."""
    for j in range(count):
        vr[j], vi[j] = 0.0, 0.0
    for k in range(c.shape[0] - 1, -1, -1):
        p = c[k]
        for j in range(count):
            a, b = vr[j] * zr[j] - vi[j] * zi[j] + p, vr[j] * zi[j] + vi[j] * zr[j]
            vr[j], vi[j] = a, b


@njit(**JIT)
def descent(fl, al, bl, wl, x, ws):
    """``descent_from`` with the Taylor coefficients of the phase at x, as good as rules are."""
    c = ws[4][: fl.shape[0]]
    taylor(fl, x, c)
    return descent_from(c, al, bl, wl, x, EXACT, ws)


@njit(**JIT)
def descent_from(c, al, bl, wl, x, allowed, ws):
    """The slow amplitude E at x, times 1 and times the further factor; ok False where no rule reaches.

    c: Taylor coefficients of the phase at x. E = (1/2πi) ∫ a b / f' exp(−p) dp along the path f(z) = f(x) + i p/2π, all
    nodes of a rule at a time. The largest relative error of the rules, ``allowed`` at most, is gathered in ws[15, 0].
    """
    rule, miss = _rule(c, allowed)
    if rule < 0 or c[1] == 0.0:
        return 0j, 0j, False
    ws[15, 0] = max(ws[15, 0], miss)
    count, d1 = _COUNTS[rule], c[1]
    d2 = c[2] if c.shape[0] > 2 else 0.0
    ur, ui, sr, si, vr, vi = ws[5], ws[6], ws[7], ws[8], ws[9], ws[10]
    target = _LAG_X[rule]
    for j in range(count):
        # start: the path of the quadratic through x, u = 2 i t / (d1 + sqrt(d1² + 4 i d2 t))
        q = 4.0 * d2 * target[j]
        re = math.sqrt(0.5 * (math.sqrt(d1 * d1 * d1 * d1 + q * q) + d1 * d1))
        im = 0.5 * q / re
        if d1 < 0.0:
            re, im = -re, -im
        re += d1
        size = re * re + im * im
        ur[j], ui[j] = 2.0 * target[j] * im / size, 2.0 * target[j] * re / size
    furthest = 0.0
    for j in range(count):
        furthest = max(furthest, ur[j] * ur[j] + ui[j] * ui[j])
    # Powers that stay below rounding of the phase, even at twice that distance, cost time only.
    size, reach, terms = 0.0, 2.0 * math.sqrt(furthest), c.shape[0]
    power = reach ** (terms - 1)
    while terms > 5:
        size += abs(c[terms - 1]) * power
        if size > 1e-17 * abs(d1) * reach:
            break
        terms -= 1
        power /= reach
    c = c[:terms]
    step = 1.0
    for _ in range(12):
        step = _newton(c, target, count, ur, ui, sr, si, vr, vi)
        if step <= 1e-6 or not step < 1e6:
            break
    if not step <= 1e-6:
        return 0j, 0j, False
    _newton(c, target, count, ur, ui, sr, si, vr, vi)  # for the derivative at the place
    for j in range(count):
        ur[j] += x
    ar, ai, br, bi = ws[11], ws[12], ws[13], ws[14]
    _at(al, count, ur, ui, ar, ai)
    _at(bl, count, ur, ui, br, bi)
    e0, e1 = 0j, 0j
    for j in range(count):
        size = sr[j] * sr[j] + si[j] * si[j]
        re, im = ar[j] * br[j] - ai[j] * bi[j], ar[j] * bi[j] + ai[j] * br[j]
        weight = _LAG_W[rule, j] / size
        ar[j], ai[j] = weight * (re * sr[j] + im * si[j]), weight * (im * sr[j] - re * si[j])
        e0 += complex(ar[j], ai[j])
    if wl.shape[0] > 0:
        _at(wl, count, ur, ui, br, bi)
        for j in range(count):
            e1 += complex(ar[j], ai[j]) * complex(br[j], bi[j])
    return e0 / I2PI, e1 / I2PI, True


@njit(**JIT)
def add_span(fl, al, bl, wl, lo, hi, panels, zero, out, ws):
    """Adds to out the integral of a b exp(i 2π (f − zero)) from lo to hi in even panels (4 sums); lo > hi is fine."""
    for p in range(panels):
        part = _direct(lo + (hi - lo) * p / panels, lo + (hi - lo) * (p + 1) / panels, fl, al, bl, wl, zero, ws)
        for q in range(4):
            out[q] += part[q]


@njit(**JIT)
def steepest_slope(fl, lo, hi):
    """Largest |f'| on nine points between lo and hi, with a tenth of margin."""
    worst = 0.0
    for i in range(9):
        worst = max(worst, abs(slope_at(fl, lo + (hi - lo) * i / 8.0)))
    return 1.1 * worst


@njit(**JIT)
def from_far(fl, al, bl, wl, at, x, zero, out, ws):
    """Φ exp(−i 2π zero) at x: E at the point WAVES away to the right of the stationary point `at`, and from there
    directly. out: 4 sums. Returns False when the asymptotic regime is not reached there.
    """
    far = point_away(fl, at, 1.0, WAVES)
    if math.isnan(far):
        return False
    e0, e1, ok = descent(fl, al, bl, wl, far, ws)
    if not ok:
        return False
    turn = np.exp(I2PI * (horner(fl, far) - zero))
    e0, e1 = e0 * turn, e1 * turn
    out[0], out[1], out[2], out[3] = e0.real, e0.imag, e1.real, e1.imag
    if x > far:
        add_span(fl, al, bl, wl, far, x, 1, zero, out, ws)
        return True
    start = max((x - at) / (far - at), 0.0)
    for k in range(_NEAR.size - 1, 0, -1):
        if _NEAR[k] > start:
            stop = at + (far - at) * max(_NEAR[k - 1], start)
            add_span(fl, al, bl, wl, at + (far - at) * _NEAR[k], stop, 1, zero, out, ws)
    if x < at:
        for k in range(1, _NEAR.size):
            add_span(fl, al, bl, wl, at + (x - at) * _NEAR[k - 1], at + (x - at) * _NEAR[k], 1, zero, out, ws)
    return True


@njit(**JIT)
def stationary_term(fl, al, bl, wl, at, zero, out, ws):
    """S exp(−i 2π zero): what Φ − E exp(i 2π f) is to the left of the stationary point; False if not reached."""
    far = point_away(fl, at, -1.0, WAVES)
    if math.isnan(far) or not from_far(fl, al, bl, wl, at, far, zero, out, ws):
        return False
    e0, e1, ok = descent(fl, al, bl, wl, far, ws)
    turn = np.exp(I2PI * (horner(fl, far) - zero))
    e0, e1 = e0 * turn, e1 * turn
    out[0] -= e0.real
    out[1] -= e0.imag
    out[2] -= e1.real
    out[3] -= e1.imag
    return ok
