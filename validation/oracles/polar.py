"""Slow oracle B: the overlap of two circular pupils by rays from the centre of beam m.

    γ = ∫ exp(i 2πW) ρ dρ dθ / (π(1 − e²))   over the intersection of two annuli of radii e and 1

On a ray the intervals inside both annuli follow from two quadratic equations, and W is a quartic of ρ. The angle runs
over sectors between every direction where those intervals change their form: tangents to beam l's circles, corners
where circles of the two beams meet, and the two directions at right angles to the displacement. A ray's end on a
circle about a point at distance d is a square root of r² − d² sin²φ, whose branch points lie at φ = ±asin(r/d), or at
±π/2 plus an imaginary part: always above or below the end of a sector. In v, θ = θ0 + (θ1 − θ0)/(1 + exp(−2v)), all of
them are at least π/2 away from the real axis; so v is cut into Gauss panels of width 1 or less, without special cases.

Panels with too much phase are halved until they hold little, then cut evenly by the largest rate in them. Along a ray
panels are marched from one end to the other, with a bound of the phase rate from the quartic's Taylor coefficients.

Nothing here is shared with the package or with the other oracle. Lengths in pupil radii, W in waves.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_NODE, _WEIGHT = np.polynomial.legendre.leggauss(16)  # on (−1, 1)
_VECTOR = {"reassoc", "contract", "nsz"}
_REACH = 18.0  # |v| ≤ 18 leaves out 1/(1 + exp(36)) = 2e-16 of a sector at either end
_RUN = 32  # panels of a ray that are sized together
_PLACES = np.array([0.0, 0.06, 0.2, 0.35, 0.5, 0.65, 0.8, 0.94, 1.0])  # on a ray's interval, to follow the phase
_SAMPLES = 16  # steps over a panel of v on which the phase is followed

# cos(πt) and sin(πt)/t for t in (−1, 1) as Chebyshev series in 2t² − 1: interpolated, good to rounding
_COS = np.polynomial.chebyshev.chebinterpolate(lambda z: np.cos(np.pi * np.sqrt(0.5 * (z + 1.0))), 12)
_SIN = np.polynomial.chebyshev.chebinterpolate(lambda z: np.pi * np.sinc(np.sqrt(0.5 * (z + 1.0))), 12)

# steady cycles in a panel, width of a panel in v, share of a panel that each unit of that width takes up (θ(v) is not
# straight), panels added to each run along a ray, so that two levels never share a panel
_ROUGH = (4.3, 1.0, 0.65, 0)
_SHARP = (3.4, 0.8, 0.85, 1)


@njit(cache=True, nogil=True)
def _sectors(e, d, axis):
    """Directions, ascending over one turn, between which the intervals on a ray change smoothly."""
    found, n = np.empty(20), 0
    found[0], found[1], n = 0.5 * math.pi, -0.5 * math.pi, 2
    for r in (1.0, e):
        if 0.0 < r <= d:
            tangent = math.asin(r / d)
            for angle in (tangent, -tangent):
                found[n] = angle
                n += 1
        for s in (1.0, e):
            if d > 0.0 and r > 0.0 and s > 0.0:
                cosine = (d * d + (s - r) * (s + r)) / (2.0 * s * d)  # the ray that meets radius r of l at radius s
                if abs(cosine) <= 1.0:
                    corner = math.acos(cosine)
                    for angle in (corner, -corner):
                        found[n] = angle
                        n += 1
    found = np.sort(found[:n]) + axis
    return np.append(found, found[0] + 2.0 * math.pi)


@njit(cache=True, nogil=True)
def _intervals(cosine, sine, e, lx, ly, out):
    """Intervals of ρ (rows of out) on a ray that lie in both annuli; returns their number, 0 to 2."""
    middle, off = cosine * lx + sine * ly, abs(cosine * ly - sine * lx)
    if off >= 1.0:
        return 0
    half = math.sqrt((1.0 - off) * (1.0 + off))
    a, b = max(e, middle - half), min(1.0, middle + half)
    if a >= b:
        return 0
    if off >= e:
        out[0, 0], out[0, 1] = a, b
        return 1
    half = math.sqrt((e - off) * (e + off))
    n = 0
    if middle - half > a:
        out[0, 0], out[0, 1] = a, min(b, middle - half)
        n = 1
    if middle + half < b:
        out[n, 0], out[n, 1] = max(a, middle + half), b
        n += 1
    return n


@njit(cache=True, nogil=True)
def _quartic(w, cosine, sine, q):
    """W = ρ (q1 + ρ (q2 + ρ (q3 + ρ q4))) along a ray, from w = (w020, w040, w131, w222, w111)."""
    q[0], q[1], q[2], q[3] = w[4] * sine, w[0] + w[3] * sine * sine, w[2] * sine, w[1]


@njit(cache=True, nogil=True)
def _turned(v, left, width):
    """Angle, and its derivative, at v; the complement keeps the far end exact."""
    small = 1.0 / (1.0 + math.exp(2.0 * abs(v)))
    theta = left + width * small if v < 0.0 else left + width - width * small
    return theta, 2.0 * width * small * (1.0 - small)


@njit(cache=True, nogil=True)
def _followed(w, e, lx, ly, left, width, v0, v1):
    """Phase over a panel of v, at fixed places on the rays' intervals: total change and largest rate, in cycles."""
    ends, q = np.empty((2, 2)), np.empty(4)
    before, count_before = np.zeros((2, _PLACES.size)), -1
    total, fastest = 0.0, 0.0
    for i in range(_SAMPLES + 1):
        theta, _ = _turned(v0 + (v1 - v0) * i / _SAMPLES, left, width)
        c, s = math.cos(theta), math.sin(theta)
        count = _intervals(c, s, e, lx, ly, ends)
        _quartic(w, c, s, q)
        step = 0.0
        for j in range(count):
            for p in range(_PLACES.size):
                r = ends[j, 0] + (ends[j, 1] - ends[j, 0]) * _PLACES[p]
                value = r * (q[0] + r * (q[1] + r * (q[2] + r * q[3])))
                if count == count_before:
                    step = max(step, abs(value - before[j, p]))
                before[j, p] = value
        total += step
        fastest = max(fastest, step * _SAMPLES)
        count_before = count
    return total, fastest


@njit(cache=True, nogil=True)
def _rays(w, e, lx, ly, cycles, span, bend):
    """Angles and weights of all rays."""
    theta, weight, n = np.empty(4096), np.empty(4096), 0
    marks = _sectors(e, math.hypot(lx, ly), math.atan2(ly, lx))
    stack = np.empty((64, 2))
    start = math.ceil(2.0 * _REACH / span)
    for m in range(marks.size - 1):
        left, width = marks[m], marks[m + 1] - marks[m]
        if width <= 0.0:
            continue
        for p in range(start):
            stack[0, 0], stack[0, 1] = -_REACH + 2.0 * _REACH * p / start, -_REACH + 2.0 * _REACH * (p + 1) / start
            depth = 1
            while depth > 0:
                depth -= 1
                v0, v1 = stack[depth, 0], stack[depth, 1]
                total, fastest = _followed(w, e, lx, ly, left, width, v0, v1)
                uneven = total > 8.0 * cycles or (total > cycles and fastest > 2.0 * total)
                if uneven and v1 - v0 > 1e-7:  # never without end, should rounding move a corner into a sector
                    middle = 0.5 * (v0 + v1)
                    stack[depth, 0], stack[depth, 1] = middle, v1
                    stack[depth + 1, 0], stack[depth + 1, 1] = v0, middle
                    depth += 2
                    continue
                parts = min(max(1, math.ceil(fastest / cycles + bend * (v1 - v0))), 128)
                while n + 16 * parts > theta.size:
                    theta = np.concatenate((theta, np.empty(theta.size)))
                    weight = np.concatenate((weight, np.empty(weight.size)))
                half = 0.5 * (v1 - v0) / parts
                for k in range(parts):
                    for g in range(16):
                        angle, rate = _turned(v0 + half * (2 * k + 1 + _NODE[g]), left, width)
                        theta[n], weight[n] = angle, half * _WEIGHT[g] * rate
                        n += 1
    return theta[:n], weight[:n]


@njit(cache=True, nogil=True, fastmath=_VECTOR)
def _add(rho, weight, q1, q2, q3, q4):
    """Σ weight · ρ · exp(i 2πW): Chebyshev series of cosine and sine by Clenshaw's rule. No branches."""
    re, im = 0.0, 0.0
    for i in range(rho.size):
        r = rho[i]
        w = r * (q1 + r * (q2 + r * (q3 + r * q4)))
        t = 2.0 * (w - math.floor(w + 0.5))
        z = 4.0 * t * t - 2.0
        c1, c2, s1, s2 = _COS[12], 0.0, _SIN[12], 0.0
        c1, c2, s1, s2 = z * c1 - c2 + _COS[11], c1, z * s1 - s2 + _SIN[11], s1
        c1, c2, s1, s2 = z * c1 - c2 + _COS[10], c1, z * s1 - s2 + _SIN[10], s1
        c1, c2, s1, s2 = z * c1 - c2 + _COS[9], c1, z * s1 - s2 + _SIN[9], s1
        c1, c2, s1, s2 = z * c1 - c2 + _COS[8], c1, z * s1 - s2 + _SIN[8], s1
        c1, c2, s1, s2 = z * c1 - c2 + _COS[7], c1, z * s1 - s2 + _SIN[7], s1
        c1, c2, s1, s2 = z * c1 - c2 + _COS[6], c1, z * s1 - s2 + _SIN[6], s1
        c1, c2, s1, s2 = z * c1 - c2 + _COS[5], c1, z * s1 - s2 + _SIN[5], s1
        c1, c2, s1, s2 = z * c1 - c2 + _COS[4], c1, z * s1 - s2 + _SIN[4], s1
        c1, c2, s1, s2 = z * c1 - c2 + _COS[3], c1, z * s1 - s2 + _SIN[3], s1
        c1, c2, s1, s2 = z * c1 - c2 + _COS[2], c1, z * s1 - s2 + _SIN[2], s1
        c1, c2, s1, s2 = z * c1 - c2 + _COS[1], c1, z * s1 - s2 + _SIN[1], s1
        re += weight[i] * r * (0.5 * z * c1 - c2 + _COS[0])
        im += weight[i] * r * (0.5 * z * s1 - s2 + _SIN[0]) * t
    return re, im


@njit(cache=True, nogil=True, fastmath=_VECTOR)
def _fill(centre, half, rho, weight):
    for k in range(16):
        rho[k] = centre + half * _NODE[k]
        weight[k] = half * _WEIGHT[k]


@njit(cache=True, nogil=True)
def _ray(a, b, q, cycles, more, rho, weight):
    """∫ exp(i 2πW) ρ dρ over one interval: real part, imaginary part, number of nodes."""
    re, im, nodes, at = 0.0, 0.0, 0, a
    while at < b:
        # Taylor's coefficients of W' about this point bound it over the next h
        c1 = abs(q[0] + at * (2.0 * q[1] + at * (3.0 * q[2] + at * 4.0 * q[3])))
        c2 = abs(2.0 * q[1] + at * (6.0 * q[2] + at * 12.0 * q[3]))
        c3, c4 = abs(3.0 * q[2] + at * 12.0 * q[3]), abs(4.0 * q[3])
        h = b - at
        budget = _RUN * cycles
        while h * (c1 + h * (c2 + h * (c3 + h * c4))) > budget:
            rate = c1 + h * (c2 + h * (c3 + h * c4))
            h *= max(0.5, min(0.95, budget / (h * rate)))
        parts = max(1, min(_RUN, math.ceil(h * (c1 + h * (c2 + h * (c3 + h * c4))) / cycles))) + more
        half = 0.5 * h / parts
        for k in range(parts):
            _fill(at + half * (2 * k + 1), half, rho[16 * k : 16 * k + 16], weight[16 * k : 16 * k + 16])
        r, i = _add(rho[: 16 * parts], weight[: 16 * parts], q[0], q[1], q[2], q[3])
        re += r
        im += i
        nodes += 16 * parts
        at = at + h if h < b - at else b
    return re, im, nodes


@njit(cache=True, nogil=True)
def _integral(w, e, lx, ly, cycles, span, bend, more):
    """∫ exp(i 2πW) over the region: real part, imaginary part, number of nodes."""
    theta, turn = _rays(w, e, lx, ly, cycles, span, bend)
    size = 16 * (_RUN + more)
    rho, weight, ends, q = np.empty(size), np.empty(size), np.empty((2, 2)), np.empty(4)
    re, im, nodes = 0.0, 0.0, 0
    for k in range(theta.size):
        c, s = math.cos(theta[k]), math.sin(theta[k])
        _quartic(w, c, s, q)
        for j in range(_intervals(c, s, e, lx, ly, ends)):
            r, i, n = _ray(ends[j, 0], ends[j, 1], q, cycles, more, rho, weight)
            re += turn[k] * r
            im += turn[k] * i
            nodes += n
    return re, im, nodes


def contrast(
    w020: float = 0.0,
    w040: float = 0.0,
    w131: float = 0.0,
    w222: float = 0.0,
    w111: float = 0.0,
    obscuration: float = 0.0,
    shift_x: float = 0.0,
    shift_y: float = 0.0,
    finer: float = 1.0,
) -> tuple[complex, float, int]:
    """γ, its error estimate, and the nodes summed; coefficients in waves at the edge, lengths in pupil radii.

    The error is what a second, rougher set of panels changes, plus rounding; the sharper result is returned, and is
    usually far better than that. All panels shrink `finer` times: for finding out which oracle is wrong.
    """
    if shift_x**2 + shift_y**2 >= 4.0:
        return 0j, 0.0, 0
    w = np.array([w020, w040, w131, w222, w111], float)
    geometry = float(obscuration), -float(shift_x), -float(shift_y)
    rough, sharp = (
        _integral(w, *geometry, cycles / finer, span / finer, bend * finer, more)
        for cycles, span, bend, more in (_ROUGH, _SHARP)
    )
    change = abs(complex(sharp[0] - rough[0], sharp[1] - rough[1]))
    power = math.pi * (1.0 - obscuration) * (1.0 + obscuration)
    return complex(sharp[0], sharp[1]) / power, change / power + 2e-14 + 1e-15 / power, rough[2] + sharp[2]
