"""Slow oracle A: the overlap of two circular pupils by horizontal strips and chords.

    γ = ∫ exp(i 2πW) dx dy / (π(1 − e²))   over the intersection of two annuli of radii e and 1

Origin and W are those of beam m; beam l's annulus is centred on (−shift_x, −shift_y). The plane is cut into strips at
every ordinate where the list of chords changes its form: tops and bottoms of the four circles, and the points where
circles meet. Each strip is cut into panels that shrink threefold towards both of its ends: the chord ends are square
roots of y whose branch points are tops of circles, hence ends of strips, so that no panel is wider than twice its
distance from any of them. Panels with too much phase in them are cut further. On each of the 16 Gauss lines of a panel
the chords are exact, and are cut into Gauss panels of even phase variation, measured on dense samples.

Nothing here is shared with the package or with the other oracle. Lengths in pupil radii, W in waves.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_X, _W = np.polynomial.legendre.leggauss(16)
_X, _W = 0.5 * (_X + 1.0), 0.5 * _W  # nodes and weights on (0, 1)
_FAST = {"reassoc", "contract", "nsz"}  # sums may be reordered so that they vectorise
_SHARES = 9  # relative places on a chord at which the phase is followed from line to line
_BLOCK = 32  # panels whose nodes are summed in one call

# cycles of steady phase in a panel; factor by which panels shrink towards the end of a strip; panels added everywhere,
# so that two levels never share a panel
_COARSE = (4.5, 3.0, 0)
_FINE = (3.5, 2.5, 1)


@njit(cache=True, nogil=True)
def _meeting_ordinates(x1, y1, r1, x2, y2, r2, out, n):
    """Appends the ordinates of the points where two circles meet."""
    dx, dy = x2 - x1, y2 - y1
    d = math.hypot(dx, dy)
    if r1 <= 0.0 or r2 <= 0.0 or d == 0.0 or d > r1 + r2 or d < abs(r1 - r2):
        return n
    along = 0.5 * (d + (r1 - r2) * (r1 + r2) / d)
    across = math.sqrt(max((r1 - along) * (r1 + along), 0.0))
    out[n] = y1 + (along * dy + across * dx) / d
    out[n + 1] = y1 + (along * dy - across * dx) / d
    return n + 2


@njit(cache=True, nogil=True)
def _ordinates(e, lx, ly):
    """All ordinates, ascending, between which the chords are smooth functions of y."""
    out, n = np.empty(16), 0
    for r in (1.0, e):
        for c in (0.0, ly):
            if r > 0.0:
                out[n], out[n + 1] = c - r, c + r
                n += 2
    for r in (1.0, e):
        for s in (1.0, e):
            n = _meeting_ordinates(0.0, 0.0, r, lx, ly, s, out, n)
    return np.sort(out[:n])


@njit(cache=True, nogil=True)
def _half_chord(y, r):
    return math.sqrt((r - y) * (r + y)) if abs(y) < r else 0.0


@njit(cache=True, nogil=True)
def _chords(y, e, lx, ly, out):
    """Intervals of x (rows of out) that lie in both annuli at ordinate y; returns their number, at most 3."""
    if abs(y) >= 1.0 or abs(y - ly) >= 1.0:
        return 0
    reach_m, reach_l = _half_chord(y, 1.0), _half_chord(y - ly, 1.0)
    x, end = max(-reach_m, lx - reach_l), min(reach_m, lx + reach_l)
    hole_m, hole_l = _half_chord(y, e), _half_chord(y - ly, e)
    first, first_half, second, second_half = 0.0, hole_m, lx, hole_l
    if second - second_half < first - first_half:
        first, first_half, second, second_half = second, second_half, first, first_half
    n = 0
    for i in range(2):
        centre, half = (first, first_half) if i == 0 else (second, second_half)
        if half == 0.0 or centre + half <= x:
            continue
        if min(centre - half, end) > x:
            out[n, 0], out[n, 1] = x, min(centre - half, end)
            n += 1
        x = centre + half
    if end > x:
        out[n, 0], out[n, 1] = x, end
        n += 1
    return n


@njit(cache=True, nogil=True)
def _along(c, y):
    """W on the horizontal line y is w0 + w2 x² + w4 x⁴; c = (w020, w040, w131, w222, w111)."""
    return y * (y * (c[0] + c[3] + y * (c[2] + y * c[1])) + c[4]), c[0] + y * (c[2] + 2.0 * c[1] * y), c[1]


@njit(cache=True, nogil=True)
def _wanted(slope, bend, cycles):
    """Panels per unit length for a phase of this slope and second derivative.

    `cycles` of a steady phase go into one panel; around a stationary point 0.3 of a cycle on either side, for there
    the integrand grows faster off the real axis.
    """
    return math.sqrt(slope * slope / cycles**2 + abs(bend) / (0.2 * cycles**2))


@njit(cache=True, nogil=True)
def _panels_across(c, e, lx, ly, a, b, cycles, total):
    """Cumulated number of panels wanted from y = a to b: the most that the phase at any relative place asks for."""
    bins = total.size - 1
    ends = np.empty((3, 2))
    now, last, change = np.zeros((3, _SHARES)), np.zeros((3, _SHARES)), np.zeros((3, _SHARES))
    count_last, steady = -1, 0
    total[0] = 0.0
    for i in range(bins + 1):
        y = a + (b - a) * i / bins
        count = _chords(y, e, lx, ly, ends)
        steady = steady + 1 if count == count_last else 0
        w0, w2, w4 = _along(c, y)
        most = 0.0
        for j in range(count):
            for s in range(_SHARES):
                x = ends[j, 0] + (ends[j, 1] - ends[j, 0]) * s / (_SHARES - 1.0)
                now[j, s] = w0 + x * x * (w2 + x * x * w4)
                if steady > 0:
                    step = now[j, s] - last[j, s]
                    bend = step - change[j, s] if steady > 1 else 0.0
                    most = max(most, _wanted(step, bend, cycles))
                    change[j, s] = step
        if i > 0:
            total[i] = total[i - 1] + most + 1e-3 / bins  # no phase at all: even panels
        last[:] = now
        count_last = count


@njit(cache=True, nogil=True)
def _even(total, a, b, pieces, out):
    """Places out[:pieces + 1] from a to b that share out the sampled cumulated variation evenly."""
    bins = total.size - 1
    i = 0
    out[0], out[pieces] = a, b
    for k in range(1, pieces):
        target = total[bins] * k / pieces
        while total[i + 1] < target:
            i += 1
        out[k] = a + (b - a) * (i + (target - total[i]) / (total[i + 1] - total[i])) / bins


@njit(cache=True, nogil=True)
def _lines(c, e, lx, ly, cycles, ratio, extra):
    """Ordinates and weights of all lines."""
    marks = _ordinates(e, lx, ly)
    ys, ws, n = np.empty(4096), np.empty(4096), 0
    depth = math.ceil(26.4 / math.log(ratio))  # the panel at the very end has 1/ratio**depth = 3e-12 of the strip
    rough = np.empty(33)
    for strip in range(marks.size - 1):
        y0, y1 = marks[strip], marks[strip + 1]
        if not y1 > y0:
            continue
        half = 0.5 * (y1 - y0)
        for side in range(2):
            for level in range(depth + 1):
                far = half * ratio ** (-level)
                near = half * ratio ** (-level - 1) if level < depth else 0.0
                a, b = (y0 + near, y0 + far) if side == 0 else (y1 - far, y1 - near)
                _panels_across(c, e, lx, ly, a, b, cycles, rough)
                total = np.empty(33 + int(8.0 * math.sqrt(rough[32])))
                _panels_across(c, e, lx, ly, a, b, cycles, total)
                pieces = max(1, math.ceil(total[-1])) + extra
                at = np.empty(pieces + 1)
                _even(total, a, b, pieces, at)
                if n + 16 * pieces > ys.size:
                    ys = np.concatenate((ys, np.empty(ys.size + 16 * pieces)))
                    ws = np.concatenate((ws, np.empty(ws.size + 16 * pieces)))
                for k in range(pieces):
                    for g in range(16):
                        ys[n] = at[k] + (at[k + 1] - at[k]) * _X[g]
                        ws[n] = (at[k + 1] - at[k]) * _W[g]
                        n += 1
    return ys[:n], ws[:n]


@njit(cache=True, nogil=True, fastmath=_FAST)
def _sum(x, weight, w0, w2, w4):
    """Σ weight · exp(i 2πW(x)): quarter of the angle by Taylor's series, doubled twice. No branches."""
    re, im = 0.0, 0.0
    for i in range(x.size):
        u = x[i] * x[i]
        w = w0 + u * (w2 + u * w4)
        t = (w - math.floor(w + 0.5)) * 1.5707963267948966  # within ±π/4
        q = t * t
        s, c = 1.0 - q * (1.0 / 210.0), 1.0 - q * (1.0 / 240.0)
        s, c = 1.0 - q * (1.0 / 156.0) * s, 1.0 - q * (1.0 / 182.0) * c
        s, c = 1.0 - q * (1.0 / 110.0) * s, 1.0 - q * (1.0 / 132.0) * c
        s, c = 1.0 - q * (1.0 / 72.0) * s, 1.0 - q * (1.0 / 90.0) * c
        s, c = 1.0 - q * (1.0 / 42.0) * s, 1.0 - q * (1.0 / 56.0) * c
        s, c = 1.0 - q * (1.0 / 20.0) * s, 1.0 - q * (1.0 / 30.0) * c
        s, c = t * (1.0 - q * (1.0 / 6.0) * s), 1.0 - q * (1.0 / 12.0) * c
        c = 1.0 - 0.5 * q * c
        s2, c2 = 2.0 * s * c, 1.0 - 2.0 * s * s
        re += weight[i] * (1.0 - 2.0 * s2 * s2)
        im += weight[i] * (2.0 * s2 * c2)
    return re, im


@njit(cache=True, nogil=True, fastmath=_FAST)
def _nodes(a, b, x, weight):
    for k in range(16):
        x[k] = a + (b - a) * _X[k]
        weight[k] = (b - a) * _W[k]


@njit(cache=True, nogil=True, fastmath=_FAST)
def _wanted_along(a, step, w2, w4, cycles, out):
    """Panels wanted in each bin of a chord, from the derivatives of W in its middle."""
    for i in range(out.size):
        x = a + (i + 0.5) * step
        slope, bend = x * (2.0 * w2 + 4.0 * w4 * x * x), 2.0 * w2 + 12.0 * w4 * x * x
        out[i] = step * math.sqrt(slope * slope / cycles**2 + abs(bend) / (0.2 * cycles**2))


@njit(cache=True, nogil=True)
def _chord(a, b, w0, w2, w4, cycles, extra, total, at, x, weight):
    """∫ exp(i 2πW) dx over one chord: real part, imaginary part, number of nodes."""
    most = max(a * a, b * b)
    bins = 16 + int(6.0 * math.sqrt(most * (abs(w2) + 2.0 * most * abs(w4))))
    step = (b - a) / bins
    _wanted_along(a, step, w2, w4, cycles, total[1 : bins + 1])
    total[0] = 0.0
    for i in range(1, bins + 1):
        total[i] += total[i - 1] + 1e-3 / bins
    pieces = max(1, math.ceil(total[bins])) + extra
    _even(total[: bins + 1], a, b, pieces, at)
    re, im, filled = 0.0, 0.0, 0
    for k in range(pieces):
        _nodes(at[k], at[k + 1], x[filled : filled + 16], weight[filled : filled + 16])
        filled += 16
        if filled == x.size or k == pieces - 1:
            r, i = _sum(x[:filled], weight[:filled], w0, w2, w4)
            re += r
            im += i
            filled = 0
    return re, im, 16 * pieces


@njit(cache=True, nogil=True)
def _integral(c, e, lx, ly, cycles, ratio, extra):
    """∫ exp(i 2πW) over the region: real part, imaginary part, number of nodes."""
    ys, ws = _lines(c, e, lx, ly, cycles, ratio, extra)
    waves = abs(c[0]) + 2.0 * abs(c[1]) + abs(c[2])
    total = np.empty(18 + int(12.0 * math.sqrt(waves)))
    at = np.empty(16 + int((8.0 * waves + 16.0 * math.sqrt(waves)) / cycles))
    x, weight, ends = np.empty(16 * _BLOCK), np.empty(16 * _BLOCK), np.empty((3, 2))
    re, im, nodes = 0.0, 0.0, 0
    for k in range(ys.size):
        w0, w2, w4 = _along(c, ys[k])
        w0 -= math.floor(w0)
        for j in range(_chords(ys[k], e, lx, ly, ends)):
            r, i, n = _chord(ends[j, 0], ends[j, 1], w0, w2, w4, cycles, extra, total, at, x, weight)
            re += ws[k] * r
            im += ws[k] * i
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

    The error is what a second, coarser set of panels changes, plus rounding; the finer result is returned, and is
    usually far better than that. All panels shrink `finer` times: for finding out which oracle is wrong.
    """
    c, e = np.array([w020, w040, w131, w222, w111], float), float(obscuration)
    if math.hypot(shift_x, shift_y) >= 2.0:
        return 0j, 0.0, 0
    power = math.pi * (1.0 - obscuration**2)
    found = [
        _integral(c, e, -float(shift_x), -float(shift_y), cycles / finer, ratio ** (1.0 / finer), extra)
        for cycles, ratio, extra in (_COARSE, _FINE)
    ]
    coarse, fine = (complex(re, im) / power for re, im, _ in found)
    return fine, abs(fine - coarse) + 2e-14 + 1e-15 / power, sum(n for _, _, n in found)
