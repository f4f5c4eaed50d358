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
x(s), y(s), s in [-1, 1], powers of s, with the region to their left. One module holds the whole call tree.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

GAUSS = 16
WAVES = 4.0  # distance from a stationary point, in waves, from which the steepest-descent amplitude is used
DIRECT = 10.0  # boxes with less phase than this (cycles, sum of coefficients) are integrated directly
CYCLES = 3.0  # phase per Gauss panel
SPAN_CYCLES = 2.2  # the same across the area, where the phase is less even
STRETCH = 1.6  # part of a box, in half-widths, in which a line's stationary point is looked for
EDGE = 3e-2  # distance of a boundary from a stationary point, in half-widths, below which rays from it are not used
ROUND = 0.03  # least det/trace² of the second derivatives at a stationary point from which rays are used
PIECES = 600  # pieces of one boundary panel before another mode, or a smaller box, is tried
DEPTH = 26  # halvings of a boundary panel, and of a box
OK, DEEP, CROWDED = 0, 1, 2

_X, _W = np.polynomial.legendre.leggauss(GAUSS)
_TO_CHEB = np.linalg.inv(np.polynomial.chebyshev.chebvander(_X, GAUSS - 1))
_TO_POWER = np.zeros((GAUSS, GAUSS))  # Chebyshev coefficients -> powers
for _k in range(GAUSS):
    _TO_POWER[: _k + 1, _k] = np.polynomial.chebyshev.cheb2poly(np.eye(GAUSS)[_k])[: _k + 1]
# Gauss-Laguerre rules, and the least distance P (rad of phase to the nearest saddle) from which each is used: the
# error of n nodes on (1 + i p/P)^(-1/2), the amplitude of a quadratic phase, is below (n!)²/P^(2n); here 1e-12.
_COUNTS = np.array([2, 3, 4, 5, 6, 8, 10, 12, 16])
_LAG_X, _LAG_W = np.zeros((_COUNTS.size, 16)), np.zeros((_COUNTS.size, 16))
for _k, _n in enumerate(_COUNTS):
    _LAG_X[_k, :_n], _LAG_W[_k, :_n] = np.polynomial.laguerre.laggauss(int(_n))
_LAG_X /= 2.0 * np.pi  # cycles
_REACH = np.array([(math.factorial(int(n)) ** 2 / 1e-12) ** (0.5 / int(n)) for n in _COUNTS])
# Panels between a stationary point and WAVES from it: fractions at which the quadratic phase turns evenly enough.
_NEAR = np.array([0.0, 0.5, 0.77, 1.0])

_FAST = {"reassoc", "contract", "arcp", "nsz"}
_I2PI = 2j * math.pi


@njit(cache=True, nogil=True)
def _horner(c, x):
    value = 0.0
    for k in range(c.shape[0] - 1, -1, -1):
        value = value * x + c[k]
    return value


@njit(cache=True, nogil=True)
def _slope(c, x):
    value = 0.0
    for k in range(c.shape[0] - 1, 0, -1):
        value = value * x + k * c[k]
    return value


@njit(cache=True, nogil=True)
def affine(coef, cx, cy, xu, xv, yu, yv):
    """Powers (n, n) in (u, v) of the polynomial coef at x = cx + xu u + xv v, y = cy + yu u + yv v; exact."""
    n = coef.shape[0]
    out, inner = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n - 1, -1, -1):
        # out = out * x + sum_j coef[i, j] y^j, both by Horner on polynomials of growing degree
        _times(out, cx, xu, xv, n - 2 - i)
        inner[:, :] = 0.0
        for j in range(n - 1 - i, -1, -1):
            _times(inner, cy, yu, yv, n - 2 - i - j)
            inner[0, 0] += coef[i, j]
        for p in range(n - i):
            for q in range(n - i - p):
                out[p, q] += inner[p, q]
    return out


@njit(cache=True, nogil=True)
def _times(poly, c, u, v, degree):
    """poly (of at most this total degree) times c + u·(first variable) + v·(second), in place."""
    for p in range(degree + 1, -1, -1):
        for q in range(degree + 1 - p, -1, -1):
            value = c * poly[p, q]
            if p > 0:
                value += u * poly[p - 1, q]
            if q > 0:
                value += v * poly[p, q - 1]
            poly[p, q] = value


@njit(cache=True, nogil=True)
def _restrict(coef, y, out):
    """Powers of x of a polynomial on the line at y."""
    n = coef.shape[0]
    for i in range(n):
        value = 0.0
        for j in range(n - 1 - i, -1, -1):
            value = value * y + coef[i, j]
        out[i] = value


@njit(cache=True, nogil=True, fastmath=_FAST)
def _direct(lo, hi, fl, al, bl, wl, zero, ws):
    """Integral from lo to hi of a b exp(i 2π (f − zero)), and of the same times the further factor, by 16 Gauss points.

    exp(i 2π r) by the half angle: sine and cosine of π r, |r| <= 1/2, from their Taylor series to rounding, so that
    the loop has no branch and no library call and vectorises. ws (rows, 64): working space.
    """
    x, phi, a, b = ws[0], ws[1], ws[2], ws[3]
    middle, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
    for i in range(GAUSS):
        x[i], phi[i], a[i], b[i] = middle + half * _X[i], 0.0, 0.0, 0.0
    for k in range(fl.shape[0] - 1, -1, -1):
        p = fl[k]
        for i in range(GAUSS):
            phi[i] = phi[i] * x[i] + p
    for k in range(al.shape[0] - 1, -1, -1):
        p, q = al[k], bl[k]
        for i in range(GAUSS):
            a[i] = a[i] * x[i] + p
            b[i] = b[i] * x[i] + q
    re, im = 0.0, 0.0
    for i in range(GAUSS):
        turn = phi[i] - zero
        sine, cosine = _half((turn - math.floor(turn + 0.5)) * math.pi)
        ab = a[i] * b[i] * _W[i]
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


@njit(cache=True, nogil=True, fastmath=_FAST, inline="always")
def _half(r):
    """Sine and cosine of r, |r| <= π/2, to rounding."""
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
    return sine, cosine * z + 1.0


@njit(cache=True, nogil=True, fastmath=_FAST)
def _wave(t, w, phase, re, im, turns, a, b):
    """Sum over nodes t of w (re + i im) exp(i 2π phase), all three given as powers of t."""
    size = t.shape[0]
    for i in range(size):
        turns[i], a[i], b[i] = 0.0, 0.0, 0.0
    for k in range(phase.shape[0] - 1, -1, -1):
        p, q, r = phase[k], re[k], im[k]
        for i in range(size):
            turns[i] = turns[i] * t[i] + p
            a[i] = a[i] * t[i] + q
            b[i] = b[i] * t[i] + r
    real, imag = 0.0, 0.0
    for i in range(size):
        sine, cosine = _half((turns[i] - math.floor(turns[i] + 0.5)) * math.pi)
        co, si = (1.0 - 2.0 * sine * sine) * w[i], 2.0 * sine * cosine * w[i]
        real += a[i] * co - b[i] * si
        imag += a[i] * si + b[i] * co
    return real, imag


@njit(cache=True, nogil=True)
def _stationary(fl, lo, hi, guess):
    """Root of f' on [lo, hi], where f' is monotone; NaN if there is none. Newton kept inside the bracket."""
    s_lo, s_hi = _slope(fl, lo), _slope(fl, hi)
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


@njit(cache=True, nogil=True)
def _away(fl, x, side, waves):
    """Point where the line's phase has turned by `waves` from its stationary point x, on one side; NaN if not found."""
    f0, bend = _horner(fl, x), 0.0
    for k in range(fl.shape[0] - 1, 1, -1):
        bend = bend * x + k * (k - 1) * fl[k]
    if bend == 0.0:
        return math.nan
    sign = 1.0 if bend > 0.0 else -1.0
    at = x + side * math.sqrt(2.0 * waves / abs(bend))
    for _ in range(30):
        slope = _slope(fl, at)
        if slope * side * sign <= 0.0:
            return math.nan
        step = (_horner(fl, at) - f0 - sign * waves) / slope
        at -= step
        if (at - x) * side <= 0.0:
            return math.nan
        if abs(step) <= 1e-13 * abs(at - x):
            return at
    return math.nan


@njit(cache=True, nogil=True)
def _taylor(c, x, out):
    """Taylor coefficients of the polynomial c at x."""
    n = c.shape[0]
    for k in range(n):
        out[k] = c[k]
    for i in range(n - 1):
        for k in range(n - 2, i - 1, -1):
            out[k] += x * out[k + 1]


@njit(cache=True, nogil=True)
def _rule(c):
    """(index of the smallest Gauss-Laguerre rule that reaches 1e-12, its relative error) for Taylor coefficients c.

    By the distance in phase of the nearest saddle, from the first three derivatives of a line's phase, with a fifth of
    margin. Index -1 if none does.
    """
    d1, distance = abs(c[1]), 1e300
    if c.shape[0] > 2 and c[2] != 0.0:
        distance = min(distance, d1 * d1 / (4.0 * abs(c[2])))
    if c.shape[0] > 3 and c[3] != 0.0:
        distance = min(distance, 0.66 * d1 * math.sqrt(d1 / (3.0 * abs(c[3]))))
    distance *= 0.8 * 2.0 * math.pi
    for k in range(_COUNTS.size):
        if distance >= _REACH[k]:
            return k, 1e-12 * (_REACH[k] / distance) ** (2 * _COUNTS[k])
    return -1, 0.0


@njit(cache=True, nogil=True, fastmath=_FAST)
def _newton(c, target, count, ur, ui, sr, si, vr, vi):
    """One Newton step of sum_{k>0} c_k u^k = i target for `count` nodes u at a time; returns largest |step|/|u|.

    sr, si: the derivative before the step.
    """
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


@njit(cache=True, nogil=True, fastmath=_FAST)
def _at(c, count, zr, zi, vr, vi):
    """Values of a real polynomial at complex points."""
    for j in range(count):
        vr[j], vi[j] = 0.0, 0.0
    for k in range(c.shape[0] - 1, -1, -1):
        p = c[k]
        for j in range(count):
            a, b = vr[j] * zr[j] - vi[j] * zi[j] + p, vr[j] * zi[j] + vi[j] * zr[j]
            vr[j], vi[j] = a, b


@njit(cache=True, nogil=True)
def _descent(fl, al, bl, wl, x, ws):
    """The slow amplitude E at x, times 1 and times the further factor; ok False where no rule reaches.

    E = (1/2πi) ∫ a b / f' exp(−p) dp along the path f(z) = f(x) + i p/2π, all nodes of a rule at a time. The largest
    relative error of the rules is gathered in ws[15, 0].
    """
    c = ws[4][: fl.shape[0]]
    _taylor(fl, x, c)
    rule, miss = _rule(c)
    if rule < 0 or c[1] == 0.0:
        return 0j, 0j, False
    ws[15, 0] = max(ws[15, 0], miss)
    count, d1 = _COUNTS[rule], c[1]
    d2 = c[2] if fl.shape[0] > 2 else 0.0
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
    return e0 / _I2PI, e1 / _I2PI, True


@njit(cache=True, nogil=True)
def _span(fl, al, bl, wl, lo, hi, panels, zero, out, ws):
    """Adds to out the integral of a b exp(i 2π (f − zero)) from lo to hi in even panels (4 sums); lo > hi is fine."""
    for p in range(panels):
        part = _direct(lo + (hi - lo) * p / panels, lo + (hi - lo) * (p + 1) / panels, fl, al, bl, wl, zero, ws)
        for q in range(4):
            out[q] += part[q]


@njit(cache=True, nogil=True)
def _steep(fl, lo, hi):
    """Largest |f'| on nine points between lo and hi, with a tenth of margin."""
    worst = 0.0
    for i in range(9):
        worst = max(worst, abs(_slope(fl, lo + (hi - lo) * i / 8.0)))
    return 1.1 * worst


@njit(cache=True, nogil=True)
def _from_far(fl, al, bl, wl, at, x, zero, out, ws):
    """Φ exp(−i 2π zero) at x: E at the point WAVES away to the right of the stationary point `at`, and from there
    directly. out: 4 sums. Returns False when the asymptotic regime is not reached there.
    """
    far = _away(fl, at, 1.0, WAVES)
    if math.isnan(far):
        return False
    e0, e1, ok = _descent(fl, al, bl, wl, far, ws)
    if not ok:
        return False
    turn = np.exp(_I2PI * (_horner(fl, far) - zero))
    e0, e1 = e0 * turn, e1 * turn
    out[0], out[1], out[2], out[3] = e0.real, e0.imag, e1.real, e1.imag
    if x > far:
        _span(fl, al, bl, wl, far, x, 1, zero, out, ws)
        return True
    start = max((x - at) / (far - at), 0.0)
    for k in range(_NEAR.size - 1, 0, -1):
        if _NEAR[k] > start:
            stop = at + (far - at) * max(_NEAR[k - 1], start)
            _span(fl, al, bl, wl, at + (far - at) * _NEAR[k], stop, 1, zero, out, ws)
    if x < at:
        for k in range(1, _NEAR.size):
            _span(fl, al, bl, wl, at + (x - at) * _NEAR[k - 1], at + (x - at) * _NEAR[k], 1, zero, out, ws)
    return True


@njit(cache=True, nogil=True)
def _stationary_term(fl, al, bl, wl, at, zero, out, ws):
    """S exp(−i 2π zero): what Φ − E exp(i 2π f) is to the left of the stationary point; False if not reached."""
    far = _away(fl, at, -1.0, WAVES)
    if math.isnan(far) or not _from_far(fl, al, bl, wl, at, far, zero, out, ws):
        return False
    e0, e1, ok = _descent(fl, al, bl, wl, far, ws)
    turn = np.exp(_I2PI * (_horner(fl, far) - zero))
    e0, e1 = e0 * turn, e1 * turn
    out[0] -= e0.real
    out[1] -= e0.imag
    out[2] -= e1.real
    out[3] -= e1.imag
    return ok


DIRECT_MODE, RADIAL_MODE, SADDLE_MODE, SLOPE_MODE, CURVE_MODE = 0, 1, 2, 3, 4
NEAR, RIGHT, LEFT = 0, 1, -1


@njit(cache=True, nogil=True)
def _polar(coef, c, s, out):
    """Powers of r of a polynomial along the ray (r c, r s)."""
    n = coef.shape[0]
    for k in range(n):
        value, power = 0.0, 1.0
        for i in range(k + 1):  # c^i by running product, s^(k - i) by Horner in the other direction
            value = value * s + coef[i, k - i] * power
            power *= c
        out[k] = value


@njit(cache=True, nogil=True)
def _even_slope(fl, r):
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


@njit(cache=True, nogil=True)
def _classify(fl, x, bend_sign, stretch, guess):
    """(class, distance from the stationary point in waves, the point or NaN) of x on its line."""
    at = _stationary(fl, -stretch, stretch, guess)
    if math.isnan(at):
        side = RIGHT if _slope(fl, x) * bend_sign > 0.0 else LEFT
        return side, 1e300, at
    delta = abs(_horner(fl, x) - _horner(fl, at))
    if delta < WAVES:
        return NEAR, delta, at
    return (RIGHT if x > at else LEFT), delta, at


@njit(cache=True, nogil=True)
def _locate(px, py, f, mode, bend_sign, stretch, lo, hi, lines, place, delta, cls):
    """The 16 nodes of a piece of a panel: their lines and where on them they lie; False if a ray has two regimes.

    lines (16, n): powers of f along the line of each node; place (16, 5): coordinate along it, y of the line, weight
    dy (dθ for rays), stationary point, and the ray's cosine or 0.
    """
    half, guess = 0.5 * (hi - lo), 0.0
    for i in range(GAUSS):
        s = 0.5 * (lo + hi) + half * _X[i]
        x, y, dy = _horner(px, s), _horner(py, s), _slope(py, s) * half
        if mode == RADIAL_MODE:
            r = math.hypot(x, y)
            if r == 0.0:
                return False
            _polar(f, x / r, y / r, lines[i])
            if not _even_slope(lines[i], r):
                return False
            place[i, 0], place[i, 1], place[i, 2] = r, y / r, (x * dy - y * _slope(px, s) * half) / (r * r)
            place[i, 3], place[i, 4] = 0.0, x / r
            delta[i] = abs(_horner(lines[i], r) - lines[i, 0])
            cls[i] = NEAR if delta[i] < WAVES else RIGHT
            continue
        _restrict(f, y, lines[i])
        place[i, 0], place[i, 1], place[i, 2], place[i, 3], place[i, 4] = x, y, dy, math.nan, 0.0
        cls[i], delta[i] = RIGHT, 1e300
        if mode == SADDLE_MODE or mode == CURVE_MODE:
            cls[i], delta[i], place[i, 3] = _classify(lines[i], x, bend_sign, stretch, guess)
            if not math.isnan(place[i, 3]):
                guess = place[i, 3]
    return True


@njit(cache=True, nogil=True)
def _side(place, delta, cls):
    """(class of all 16 nodes together, whether they have one). A node within a quarter of WAVES fits both classes."""
    nearest, furthest, right, left = 1e300, 0.0, False, False
    for i in range(GAUSS):
        nearest, furthest = min(nearest, delta[i]), max(furthest, delta[i])
        inside = not math.isnan(place[i, 3]) and place[i, 0] < place[i, 3]
        if cls[i] == LEFT or (cls[i] == NEAR and inside):
            left = True
        else:
            right = True
    if furthest <= 1.25 * WAVES:
        return NEAR, True
    if nearest >= 0.8 * WAVES and left != right:
        return (LEFT if left else RIGHT), True
    return NEAR, False


@njit(cache=True, nogil=True)
def _cut(px, py, f, mode, bend_sign, stretch, lo, hi, delta, line):
    """Where to cut a piece whose nodes are of two classes: where the distance is about WAVES."""
    cut, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
    for i in range(GAUSS - 1):
        if (delta[i] < WAVES) != (delta[i + 1] < WAVES):
            s0, s1 = cut + half * _X[i], cut + half * _X[i + 1]
            below, middle = delta[i] < WAVES, cut
            for _ in range(20):
                middle = 0.5 * (s0 + s1)
                x, y = _horner(px, middle), _horner(py, middle)
                if mode == RADIAL_MODE:
                    r = math.hypot(x, y)
                    _polar(f, x / r, y / r, line)
                    here = abs(_horner(line, r) - line[0])
                else:
                    _restrict(f, y, line)
                    _, here, _ = _classify(line, x, bend_sign, stretch, 0.0)
                if 0.9 * WAVES < here < 1.1 * WAVES:
                    break
                if (here < WAVES) == below:
                    s0 = middle
                else:
                    s1 = middle
            return middle
    return cut


@njit(cache=True, nogil=True)
def _lines(a, b, w, mode, c, s, al, bl, wl):
    """Amplitudes along a line at height s, or along the ray (c, s) with the r of the area element r dr dθ."""
    al[:], bl[:] = 0.0, 0.0
    if mode == RADIAL_MODE:
        _polar(a, c, s, al[1:])
        _polar(b, c, s, bl[:-1])
        if wl.shape[0] > 0:
            _polar(w, c, s, wl)
    else:
        _restrict(a, s, al[:-1])
        _restrict(b, s, bl[:-1])
        if wl.shape[0] > 0:
            _restrict(w, s, wl)


@njit(cache=True, nogil=True)
def _values(a, b, w, mode, whole, lines, place, al, bl, wl, values, ws):
    """Phase and amplitudes (5, 16) of Φ dy at the nodes; False where the asymptotic regime is not reached.

    values: phase in cycles; Re and Im of the amplitude; the same times the further factor.
    """
    out = np.zeros(4)
    for i in range(GAUSS):
        fl, x, at = lines[i], place[i, 0], place[i, 3]
        _lines(a, b, w, mode, place[i, 4], place[i, 1], al, bl, wl)
        out[:] = 0.0
        values[0, i] = 0.0
        if mode == DIRECT_MODE:
            turns = _steep(fl, min(0.0, x), max(0.0, x)) * abs(x)
            _span(fl, al, bl, wl, 0.0, x, 1 + int(turns / SPAN_CYCLES), 0.0, out, ws)
        elif mode == CURVE_MODE or whole == NEAR:
            if math.isnan(at):
                return False
            values[0, i] = _horner(fl, at)
            if mode == CURVE_MODE:
                ok = _stationary_term(fl, al, bl, wl, at, values[0, i], out, ws)
            else:
                ok = _from_far(fl, al, bl, wl, at, x, values[0, i], out, ws)
            if not ok:
                return False
        else:
            values[0, i] = _horner(fl, x)
            e0, e1, ok = _descent(fl, al, bl, wl, x, ws)
            if not ok:
                return False
            out[0], out[1], out[2], out[3] = e0.real, e0.imag, e1.real, e1.imag
        for q in range(4):
            values[1 + q, i] = out[q] * place[i, 2]
    return True


@njit(cache=True, nogil=True)
def _series(values, cheb):
    """Chebyshev coefficients (5, 16) of values at the Gauss nodes."""
    for q in range(values.shape[0]):
        for k in range(GAUSS):
            total = 0.0
            for i in range(GAUSS):
                total += _TO_CHEB[k, i] * values[q, i]
            cheb[q, k] = total


@njit(cache=True, nogil=True)
def _decay(c, d):
    """(size of the last three coefficients of the pair c, d; factor per three degrees by which they fall).

    The factor is the slower one of the last two steps and of the mean of three, so that one accidentally small group
    does not look like convergence.
    """
    groups = np.zeros(4)
    for k in range(GAUSS - 12, GAUSS):
        groups[(k - GAUSS + 12) // 3] = max(groups[(k - GAUSS + 12) // 3], math.hypot(c[k], d[k]))
    end = groups[3]
    if end == 0.0:
        return 0.0, 0.0
    rate = max(end / max(groups[2], 1e-300), math.sqrt(end / max(groups[1], 1e-300)))
    rate = max(rate, (end / max(groups[0], 1e-300)) ** (1.0 / 3.0))
    return end, min(rate, 1.0)


@njit(cache=True, nogil=True)
def _tail(c, d):
    """What lies beyond degree 15 of a series whose coefficients go on falling as the last ones do."""
    end, rate = _decay(c, d)
    return 2.0 * end * rate / (1.0 - min(rate, 0.8))


@njit(cache=True, nogil=True)
def _gauss_tail(c, d):
    """What 16 Gauss points miss of a function with these Chebyshev coefficients: its part beyond degree 31.

    Degree 32 lies six steps of three degrees beyond the last coefficients; five of them are believed.
    """
    end, rate = _decay(c, d)
    return 10.0 * end * rate**5 / (1.0 - min(rate, 0.8))


@njit(cache=True, nogil=True)
def _add(values, cheb, power, pieces, sums, ws):
    """Adds the integral over one piece: amplitude times exp(i 2π phase), interpolated where the phase asks for it."""
    if pieces == 1:
        for i in range(GAUSS):
            turn = np.exp(_I2PI * (values[0, i] - math.floor(values[0, i])))
            co, si = turn.real * _W[i], turn.imag * _W[i]
            sums[0] += values[1, i] * co - values[2, i] * si
            sums[1] += values[1, i] * si + values[2, i] * co
            sums[2] += values[3, i] * co - values[4, i] * si
            sums[3] += values[3, i] * si + values[4, i] * co
        return
    used, further = 1, 0.0
    for q in range(5):
        size = 0.0
        for k in range(GAUSS):
            size = max(size, abs(cheb[q, k]))
        for k in range(GAUSS):
            if abs(cheb[q, k]) > 1e-17 * size:
                used = max(used, k + 1)
        if q > 2:
            further = max(further, size)
    for q in range(5):
        for k in range(used):
            total = 0.0
            for j in range(k, used):
                total += _TO_POWER[k, j] * cheb[q, j]
            power[q, k] = total
    t, wt, turns, are, aim = ws[16], ws[17], ws[18], ws[19], ws[20]
    count, longest = 0, ws.shape[1]
    for p in range(pieces):
        for g in range(GAUSS):
            t[count] = -1.0 + (2.0 * p + 1.0 + _X[g]) / pieces
            wt[count] = _W[g] / pieces
            count += 1
        if count == longest or p == pieces - 1:
            for channel in range(2 if further > 0.0 else 1):
                re, im = _wave(t[:count], wt[:count], power[0, :used], power[1 + 2 * channel, :used],
                               power[2 + 2 * channel, :used], turns, are, aim)  # fmt: skip
                sums[2 * channel] += re
                sums[2 * channel + 1] += im
            count = 0


@njit(cache=True, nogil=True)
def _panel(px, py, f, a, b, w, mode, bend_sign, stretch, tol, sums, spans, spans_used, ws):
    """Adds ∮ Φ dy over one boundary panel to sums; returns (error, nodes, spans used, status).

    sums (6,): Re, Im of the integral, the same with the further factor, ∫|amplitude|, largest |phase|. spans collects
    the (y from, y to) of the parts that lie beyond the stationary point. status OK, DEEP (not resolved: another
    mode, or a smaller box, has to be tried) or CROWDED.
    """
    n, m = f.shape[0], a.shape[0]
    al, bl, wl, line = np.empty(m + 1), np.empty(m + 1), np.empty(w.shape[0]), np.empty(n)
    ends, level = np.empty((DEPTH + 4, 2)), np.empty(DEPTH + 4, np.int64)
    ends[0, 0], ends[0, 1], level[0] = -1.0, 1.0, 0
    top, error, nodes = 1, 0.0, 0
    lines, place = np.empty((GAUSS, n)), np.empty((GAUSS, 5))
    cls, delta = np.empty(GAUSS, np.int64), np.empty(GAUSS)
    values, cheb, power = np.empty((5, GAUSS)), np.empty((5, GAUSS)), np.empty((5, GAUSS))
    wave, wave_cheb, pieces_used = np.empty((2, GAUSS)), np.empty((2, GAUSS)), 0
    while top > 0:
        pieces_used += 1
        if pieces_used > PIECES:
            return error, nodes, spans_used, DEEP
        top -= 1
        lo, hi, depth = ends[top, 0], ends[top, 1], level[top]
        if not _locate(px, py, f, mode, bend_sign, stretch, lo, hi, lines, place, delta, cls):
            return error, nodes, spans_used, DEEP
        whole, one = RIGHT, True
        if mode == SADDLE_MODE or mode == RADIAL_MODE:
            whole, one = _side(place, delta, cls)
        cut = math.nan
        nodes += GAUSS
        ws[15, 0] = 0.0
        if not one:
            cut = _cut(px, py, f, mode, bend_sign, stretch, lo, hi, delta, line)
        elif not _values(a, b, w, mode, whole, lines, place, al, bl, wl, values, ws):
            # nodes that reach neither regime: only a smaller part of the boundary may
            if mode == CURVE_MODE or hi - lo < 1e-3:
                return error, nodes, spans_used, DEEP
            cut = 0.5 * (lo + hi)
        else:
            _series(values, cheb)
            largest, fastest, scale = 0.0, 0.0, 0.0
            for i in range(GAUSS):
                largest, scale = max(largest, math.hypot(values[1, i], values[2, i])), max(scale, abs(values[0, i]))
                if i > 0:
                    fastest = max(fastest, abs((values[0, i] - values[0, i - 1]) / (_X[i] - _X[i - 1])))
            pieces = 1 + int(2.4 * fastest / CYCLES)
            if pieces == 1:
                for i in range(GAUSS):
                    turn = np.exp(_I2PI * (values[0, i] - math.floor(values[0, i])))
                    wave[0, i] = values[1, i] * turn.real - values[2, i] * turn.imag
                    wave[1, i] = values[1, i] * turn.imag + values[2, i] * turn.real
                _series(wave, wave_cheb)
                here = _gauss_tail(wave_cheb[0], wave_cheb[1])
            else:
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
                    spans[spans_used, 0], spans[spans_used, 1] = _horner(py, lo), _horner(py, hi)
                    spans_used += 1
                nodes += pieces * GAUSS
                _add(values, cheb, power, pieces, sums, ws)
        if not math.isnan(cut):
            if depth >= DEPTH or top + 2 > ends.shape[0]:
                return error, nodes, spans_used, DEEP
            ends[top, 0], ends[top, 1], level[top] = lo, cut, depth + 1
            ends[top + 1, 0], ends[top + 1, 1], level[top + 1] = cut, hi, depth + 1
            top += 2
    return error, nodes, spans_used, OK


@njit(cache=True, nogil=True)
def _centre(f):
    """Stationary point of f by Newton's method from the origin; (x, y, found), found within 2 of it."""
    n, x, y = f.shape[0], 0.0, 0.0
    for _ in range(30):
        local = affine(f, x, y, 1.0, 0.0, 0.0, 1.0) if n <= 6 else _second_order(f, x, y)
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


@njit(cache=True, nogil=True)
def _second_order(f, x, y):
    """Taylor coefficients up to second order of f at a point, as a (3, 3) array."""
    n, out = f.shape[0], np.zeros((3, 3))
    for i in range(n - 1, -1, -1):
        v0, v1, v2 = 0.0, 0.0, 0.0
        for j in range(n - 1 - i, -1, -1):
            v2 = v2 * y + v1
            v1 = v1 * y + v0
            v0 = v0 * y + f[i, j]
        out[2, 0] = out[2, 0] * x + out[1, 0]
        out[1, 0] = out[1, 0] * x + out[0, 0]
        out[0, 0] = out[0, 0] * x + v0
        out[1, 1] = out[1, 1] * x + out[0, 1]
        out[0, 1] = out[0, 1] * x + v1
        out[0, 2] = out[0, 2] * x + v2
    return out


@njit(cache=True, nogil=True)
def _centre_term(f, a, b, w, sums, ws):
    """Adds the stationary point's own term, ∮ C(θ) dθ over a full turn: trapezoidal rule, 16 against 32 rays.

    Returns (error, ok). C is what ∫ from the centre and E exp(i 2π f) differ by along each ray; it hangs on θ alone.
    """
    n, m, rays = f.shape[0], a.shape[0], 32
    fl, al, bl, wl = np.empty(n), np.empty(m + 1), np.empty(m + 1), np.empty(w.shape[0])
    out, half, full = np.zeros(4), np.zeros(4), np.zeros(4)
    for k in range(rays):
        c, s = math.cos(2.0 * math.pi * k / rays), math.sin(2.0 * math.pi * k / rays)
        _polar(f, c, s, fl)
        _lines(a, b, w, np.int64(RADIAL_MODE), c, s, al, bl, wl)
        out[:] = 0.0
        far = _away(fl, 0.0, 1.0, WAVES)
        if math.isnan(far) or not _even_slope(fl, far):
            return 0.0, False
        if not _from_far(fl, al, bl, wl, 0.0, 0.0, fl[0], out, ws):
            return 0.0, False
        for q in range(4):
            full[q] -= out[q] * 2.0 * math.pi / rays
            if k % 2 == 0:
                half[q] -= out[q] * 4.0 * math.pi / rays
    turn = np.exp(_I2PI * (f[0, 0] - math.floor(f[0, 0])))
    sums[0] += full[0] * turn.real - full[1] * turn.imag
    sums[1] += full[0] * turn.imag + full[1] * turn.real
    sums[2] += full[2] * turn.real - full[3] * turn.imag
    sums[3] += full[2] * turn.imag + full[3] * turn.real
    size = math.hypot(full[0], full[1])
    # the rule converges geometrically: twice the rays square the relative error
    change = math.hypot(full[0] - half[0], full[1] - half[1])
    return min(change, 4.0 * change * change / max(size, 1e-300)), True


@njit(cache=True, nogil=True)
def _bernstein(coef, ru, rv, convert):
    """(least, largest) Bernstein coefficient of a polynomial on |u| <= ru, |v| <= rv: bounds of its range."""
    n = coef.shape[0]
    scaled = np.zeros((n, n))
    pu = 1.0
    for i in range(n):
        pv = 1.0
        for j in range(n - i):
            scaled[i, j] = coef[i, j] * pu * pv
            pv *= rv
        pu *= ru
    half = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            total = 0.0
            for j in range(n - i):
                total += scaled[i, j] * convert[k, j]
            half[i, k] = total
    least, largest = 1e300, -1e300
    for k in range(n):
        for p in range(n):
            total = 0.0
            for i in range(n):
                total += convert[p, i] * half[i, k]
            least, largest = min(least, total), max(largest, total)
    return least, largest


@njit(cache=True, nogil=True)
def _bernstein_matrix(n):
    """(n, n) Bernstein coefficients on [-1, 1] of the powers t^j: convert[k, j]."""
    d = n - 1
    choose = np.zeros((n, n))
    for i in range(n):
        choose[i, 0] = 1.0
        for j in range(1, i + 1):
            choose[i, j] = choose[i - 1, j - 1] + (choose[i - 1, j] if j <= i - 1 else 0.0)
    convert = np.zeros((n, n))
    for j in range(n):
        for q in range(j + 1):  # (2x - 1)^j = sum_q C(j, q) (2x)^q (-1)^(j - q)
            c = choose[j, q] * 2.0**q * (-1.0) ** (j - q)
            for k in range(q, n):
                convert[k, j] += c * choose[k, q] / choose[d, q]
    return convert


@njit(cache=True, nogil=True)
def _derivative_x(coef):
    n = coef.shape[0]
    out = np.zeros((n, n))
    for i in range(1, n):
        for j in range(n - i):
            out[i - 1, j] = i * coef[i, j]
    return out


@njit(cache=True, nogil=True)
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
        first = _derivative_x(affine(f, 0.0, 0.0, c, -s, s, c))
        if attempt == 0:
            low, high = _bernstein(_derivative_x(first), stretch, 1.0, convert)
            margin = 0.04
        else:
            low, high = _bernstein(first, stretch, 1.0, convert)
            margin = 0.3
        if low > 0.0 and low >= margin * high:
            return np.int64(SADDLE_MODE if attempt == 0 else SLOPE_MODE), c, s, 1.0, stretch
        if high < 0.0 and -high >= margin * -low:
            return np.int64(SADDLE_MODE if attempt == 0 else SLOPE_MODE), c, s, -1.0, stretch
    return np.int64(DIRECT_MODE), 1.0, 0.0, 1.0, stretch


@njit(cache=True, nogil=True)
def _box(panels, f, a, b, w, convert, tol, result):
    """Adds one box's integral to result (8: Re, Im, Re1, Im1, error, ∫|Φ|, largest phase, nodes); False: cut it."""
    cx, cy, radius = _middle(panels)
    if radius == 0.0:
        return True
    own = affine(f, cx, cy, radius, 0.0, 0.0, radius)
    low, high = _bernstein(own, 1.0, 1.0, convert)
    waves = high - low
    # One call for all modes: each call of a compiled function with another constant would be compiled on its own.
    for attempt in range(2):
        mode, x, y, c, s, bend_sign, stretch = np.int64(DIRECT_MODE), 0.0, 0.0, 1.0, 0.0, 1.0, 1.0
        if waves > DIRECT and attempt == 0:
            x, y, found = _centre(own)
            mode = np.int64(RADIAL_MODE)
            if not found:
                continue
        elif waves > DIRECT:
            mode, c, s, bend_sign, stretch = _choose(own, convert, waves)
            if mode == DIRECT_MODE:
                return False
        if _frame(panels, f, a, b, w, mode, cx + radius * x, cy + radius * y, radius, c, s, bend_sign, stretch, tol,
                  result):  # fmt: skip
            return True
    return False


@njit(cache=True, nogil=True)
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
        part, count, used, status = _panel(
            px, py, lf, la, lb, lw, mode, bend_sign, stretch, own_tol, sums, spans, used, ws
        )
        error += part
        nodes += count
        if status != OK:
            return False
    if mode == RADIAL_MODE and round(turned / (2.0 * math.pi)) != 0:
        part, ok = _centre_term(lf, la, lb, lw, sums, ws)
        error += part
        if not ok:
            return False
    if used > 0:
        part, count, status = _curves(spans[:used], lf, la, lb, lw, bend_sign, stretch, own_tol, sums, ws)
        error += part
        nodes += count
        if status != OK:
            return False
    turn = np.exp(_I2PI * (constant - math.floor(constant)))
    result[0] += area * (sums[0] * turn.real - sums[1] * turn.imag)
    result[1] += area * (sums[0] * turn.imag + sums[1] * turn.real)
    result[2] += area * (sums[2] * turn.real - sums[3] * turn.imag)
    result[3] += area * (sums[2] * turn.imag + sums[3] * turn.real)
    result[4] += area * error
    result[5] += area * sums[4]
    result[6] = max(result[6], sums[5] + abs(constant))
    result[7] += nodes
    return True


@njit(cache=True, nogil=True)
def _turning(px, py):
    """Angle by which a panel turns about the origin, rad, and how near it comes to it: by 64 chords.

    A chord leaves its arc by some 1e-5 of the region's size: nearer than that the angle could be mistaken.
    """
    total, steps, nearest = 0.0, 64, 1e300
    x0, y0 = _horner(px, -1.0), _horner(py, -1.0)
    for i in range(1, steps + 1):
        s = -1.0 + 2.0 * i / steps
        x1, y1 = _horner(px, s), _horner(py, s)
        dx, dy = x1 - x0, y1 - y0
        at = min(max(-(x0 * dx + y0 * dy) / max(dx * dx + dy * dy, 1e-300), 0.0), 1.0)
        nearest = min(nearest, math.hypot(x0 + at * dx, y0 + at * dy))
        total += math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
        x0, y0 = x1, y1
    return total, nearest


@njit(cache=True, nogil=True)
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
                part, more, _, status = _panel(
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


@njit(cache=True, nogil=True)
def _middle(panels):
    """Centre of the panels' bounding box and the largest distance of the boundary from it."""
    lo_x, hi_x, lo_y, hi_y = 1e300, -1e300, 1e300, -1e300
    for k in range(panels.shape[0]):
        for i in range(-1, 9):
            s = -1.0 if i < 0 else -0.75 + 0.25 * i
            x, y = _horner(panels[k, 0], min(s, 1.0)), _horner(panels[k, 1], min(s, 1.0))
            lo_x, hi_x, lo_y, hi_y = min(lo_x, x), max(hi_x, x), min(lo_y, y), max(hi_y, y)
    cx, cy, radius = 0.5 * (lo_x + hi_x), 0.5 * (lo_y + hi_y), 0.0
    for k in range(panels.shape[0]):
        for i in range(-1, 9):
            s = -1.0 if i < 0 else -0.75 + 0.25 * i
            radius = max(radius, math.hypot(_horner(panels[k, 0], min(s, 1.0)) - cx,
                                            _horner(panels[k, 1], min(s, 1.0)) - cy))  # fmt: skip
    return cx, cy, 1.001 * radius


@njit(cache=True, nogil=True)
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
        f0 = _horner(c, s0)
        for i in range(1, 17):
            s1 = -1.0 + i / 8.0
            f1 = _horner(c, s1)
            if (f0 < 0.0) != (f1 < 0.0):
                lo, hi = s0, s1
                for _ in range(60):
                    mid = 0.5 * (lo + hi)
                    if (_horner(c, mid) < 0.0) == (f0 < 0.0):
                        lo = mid
                    else:
                        hi = mid
                roots[used] = 0.5 * (lo + hi)
                used += 1
                if found == crossings.size:
                    return low[:0], high[:0], False
                crossings[found] = _horner(panels[k, 1 - axis], roots[used - 1])
                found += 1
            s0, f0 = s1, f1
        before = -1.0
        for r in range(used + 1):
            after = roots[r] if r < used else 1.0
            below = _horner(c, 0.5 * (before + after)) < 0.0
            if (n_low if below else n_high) >= 2 * count:
                return low[:0], high[:0], False
            for q in range(2):
                part = low[n_low, q] if below else high[n_high, q]
                _reparameter(panels[k, q], 0.5 * (before + after), 0.5 * (after - before), part)
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


@njit(cache=True, nogil=True)
def _reparameter(c, mid, half, out):
    """Powers of t of the polynomial c at s = mid + half t."""
    d = c.shape[0]
    out[:] = 0.0
    for k in range(d - 1, -1, -1):
        for i in range(d - 1, 0, -1):
            out[i] = mid * out[i] + half * out[i - 1]
        out[0] = mid * out[0] + c[k]


@njit(cache=True, nogil=True)
def integrate(panels, f, a, b, w, tol, most_boxes):
    """Integral over the region of a b exp(i 2π f), and of w a b exp(i 2π f).

    panels (K, 2, D): closed oriented boundary, the region to its left, powers of s in [-1, 1]. f (n, n) in cycles;
    a, b (m, m); w (k, k), k = 0 for none. tol: absolute error asked of each boundary panel.

    Returns (result (8,): Re, Im, Re and Im with w, error, ∫|amplitude| along the boundary, largest phase in cycles,
    nodes; boxes; ok).
    """
    result, convert = np.zeros(8), _bernstein_matrix(f.shape[0])
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
                x, y = _horner(here[k, 0], -1.0 + 0.25 * i), _horner(here[k, 1], -1.0 + 0.25 * i)
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


@njit(cache=True, nogil=True)
def arc(cx, cy, radius, start, stop, count, out):
    """Fills out (count, 2, D) with a circle's arc from angle start to stop, rad, in even panels: its Taylor series."""
    d = out.shape[2]
    for k in range(count):
        half = 0.5 * (stop - start) / count
        middle = start + (2 * k + 1) * half
        c, s, term = math.cos(middle), math.sin(middle), radius
        for i in range(d):
            turn = i % 4
            out[k, 0, i] = term * (c if turn == 0 else -s if turn == 1 else -c if turn == 2 else s)
            out[k, 1, i] = term * (s if turn == 0 else c if turn == 1 else -s if turn == 2 else -c)
            term *= half / (i + 1)
        out[k, 0, 0] += cx
        out[k, 1, 0] += cy


@njit(cache=True, nogil=True)
def circle_region(circles, signs, out):
    """Boundary of the common inside of some circles (signs +1) without others (−1): panels in out, their number.

    circles (C, 3): centre x, y, radius. Each corner is computed once and used by both circles that meet there.
    """
    count, total = circles.shape[0], 0
    angles = np.empty(2 * count + 2)
    for i in range(count):
        xi, yi, ri = circles[i, 0], circles[i, 1], circles[i, 2]
        found = 0
        for j in range(count):
            if i == j:
                continue
            p, q = min(i, j), max(i, j)
            dx, dy = circles[q, 0] - circles[p, 0], circles[q, 1] - circles[p, 1]
            d, rp, rq = math.hypot(dx, dy), circles[p, 2], circles[q, 2]
            if d == 0.0:
                continue
            along = (d * d + (rp - rq) * (rp + rq)) / (2.0 * d)
            across = (rp - along) * (rp + along)
            # circles that touch to rounding: what lies between them is a sliver of area below 1e-18
            if across <= 1e-12 * rp * rp:
                continue
            across = math.sqrt(across)
            for side in (-1.0, 1.0):
                x = circles[p, 0] + (along * dx - side * across * dy) / d
                y = circles[p, 1] + (along * dy + side * across * dx) / d
                angles[found] = math.atan2(y - yi, x - xi)
                found += 1
        if found == 0:
            angles[0], angles[1], found = -math.pi, math.pi, 1
        else:
            angles[:found].sort()
            angles[found] = angles[0] + 2.0 * math.pi
        for k in range(found):
            a0, a1 = angles[k], angles[k + 1]
            if a1 - a0 < 1e-15:
                continue
            # judged where it is furthest from the other circles: circles that touch may do so at its middle
            inside, clearest = False, -1.0
            for fraction in (0.5, 0.3137, 0.7071):
                angle = a0 + (a1 - a0) * fraction
                mx, my, nearest, within = xi + ri * math.cos(angle), yi + ri * math.sin(angle), 1e300, True
                for j in range(count):
                    if j != i:
                        gap = (circles[j, 2] - math.hypot(mx - circles[j, 0], my - circles[j, 1])) * signs[j]
                        nearest, within = min(nearest, abs(gap)), within and gap > 0.0
                if nearest > clearest:
                    inside, clearest = within, nearest
            if inside:
                pieces = max(1, math.ceil((a1 - a0) / 0.8))
                if total + pieces > out.shape[0]:
                    return -1
                if signs[i] > 0.0:
                    arc(xi, yi, ri, a0, a1, pieces, out[total:])
                else:
                    arc(xi, yi, ri, a1, a0, pieces, out[total:])
                total += pieces
    return total
