"""Polynomials in one and two variables, as powers: values, restriction to lines, substitution, bounds of their range.

coef[i, j] x^i y^j with i + j < n. Part of the call tree of ``kernels.stokes``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

#: How loops of the call tree are compiled: a product may be fused with the sum it goes into, nothing else is given up.
JIT = {"cache": True, "nogil": True, "fastmath": {"contract"}}

BATCH = 16  # rays, or lines, that are computed together


@njit(**JIT)
def horner(c, x):
    """Value at x of the polynomial with powers c."""
    value = 0.0
    for k in range(c.shape[0] - 1, -1, -1):
        value = value * x + c[k]
    return value


@njit(**JIT)
def slope_at(c, x):
    """Derivative at x of the polynomial with powers c."""
    value = 0.0
    for k in range(c.shape[0] - 1, 0, -1):
        value = value * x + k * c[k]
    return value


@njit(**JIT)
def gradient(c, x, y):
    """(value, derivatives by x and by y) at a point of a polynomial (n, n)."""
    n, gx, gy, value = c.shape[0], 0.0, 0.0, 0.0
    for i in range(n - 1, -1, -1):
        row, slope = 0.0, 0.0
        for j in range(n - 1 - i, -1, -1):
            slope = slope * y + row
            row = row * y + c[i, j]
        gx = gx * x + value
        value = value * x + row
        gy = gy * x + slope
    return value, gx, gy


@njit(**JIT)
def taylor(c, x, out):
    """Taylor coefficients of the polynomial c at x."""
    n = c.shape[0]
    for k in range(n):
        out[k] = c[k]
    for i in range(n - 1):
        for k in range(n - 2, i - 1, -1):
            out[k] += x * out[k + 1]


@njit(**JIT)
def restrict(coef, y, out):
    """Powers of x of a polynomial on the line at y."""
    n = coef.shape[0]
    for i in range(n):
        value = 0.0
        for j in range(n - 1 - i, -1, -1):
            value = value * y + coef[i, j]
        out[i] = value


@njit(**JIT)
def along_ray(coef, c, s, out):
    """Powers of r of a polynomial along the ray (r c, r s)."""
    n = coef.shape[0]
    for k in range(n):
        value, power = 0.0, 1.0
        for i in range(k + 1):  # c^i by running product, s^(k - i) by Horner in the other direction
            value = value * s + coef[i, k - i] * power
            power *= c
        out[k] = value


@njit(**JIT)
def powers(c, out):
    """c^i of BATCH numbers: fills out (n, BATCH)."""
    for r in range(BATCH):
        value = 1.0
        for i in range(out.shape[0]):
            out[i, r] = value
            value *= c[r]


# Below, eight rays or lines stand in eight variables: so the compiler keeps them in one vector register, which it does
# not do for a loop over arrays.


@njit(**JIT)
def on_rays(coef, power, s, out):
    """Powers of r of a polynomial (n, n) along BATCH rays (r c, r s): fills out (BATCH, n). power: ``powers`` of c."""
    for h in range(0, BATCH, 8):
        s0, s1, s2, s3, s4, s5, s6, s7 = s[h], s[h + 1], s[h + 2], s[h + 3], s[h + 4], s[h + 5], s[h + 6], s[h + 7]
        for k in range(coef.shape[0]):
            t0 = t1 = t2 = t3 = t4 = t5 = t6 = t7 = 0.0
            for i in range(k + 1):
                f = coef[i, k - i]
                t0 = t0 * s0 + f * power[i, h]
                t1 = t1 * s1 + f * power[i, h + 1]
                t2 = t2 * s2 + f * power[i, h + 2]
                t3 = t3 * s3 + f * power[i, h + 3]
                t4 = t4 * s4 + f * power[i, h + 4]
                t5 = t5 * s5 + f * power[i, h + 5]
                t6 = t6 * s6 + f * power[i, h + 6]
                t7 = t7 * s7 + f * power[i, h + 7]
            out[h, k] = t0
            out[h + 1, k] = t1
            out[h + 2, k] = t2
            out[h + 3, k] = t3
            out[h + 4, k] = t4
            out[h + 5, k] = t5
            out[h + 6, k] = t6
            out[h + 7, k] = t7


@njit(**JIT)
def on_lines(coef, y, out):
    """Powers of x of a polynomial (n, n) on BATCH lines at heights y: fills out (BATCH, n)."""
    n = coef.shape[0]
    for h in range(0, BATCH, 8):
        y0, y1, y2, y3, y4, y5, y6, y7 = y[h], y[h + 1], y[h + 2], y[h + 3], y[h + 4], y[h + 5], y[h + 6], y[h + 7]
        for i in range(n):
            t0 = t1 = t2 = t3 = t4 = t5 = t6 = t7 = 0.0
            for j in range(n - 1 - i, -1, -1):
                f = coef[i, j]
                t0 = t0 * y0 + f
                t1 = t1 * y1 + f
                t2 = t2 * y2 + f
                t3 = t3 * y3 + f
                t4 = t4 * y4 + f
                t5 = t5 * y5 + f
                t6 = t6 * y6 + f
                t7 = t7 * y7 + f
            out[h, i] = t0
            out[h + 1, i] = t1
            out[h + 2, i] = t2
            out[h + 3, i] = t3
            out[h + 4, i] = t4
            out[h + 5, i] = t5
            out[h + 6, i] = t6
            out[h + 7, i] = t7


@njit(**JIT)
def taylors(lines, x, out):
    """First Taylor coefficients (terms, BATCH), terms <= n, of BATCH polynomials (BATCH, n), each at its own x."""
    n, terms = lines.shape[1], out.shape[0]
    c = np.empty((n, 8))
    for h in range(0, BATCH, 8):
        x0, x1, x2, x3, x4, x5, x6, x7 = x[h], x[h + 1], x[h + 2], x[h + 3], x[h + 4], x[h + 5], x[h + 6], x[h + 7]
        for k in range(n):
            for q in range(8):
                c[k, q] = lines[h + q, k]
        for i in range(min(terms, n - 1)):
            t0, t1, t2, t3, t4, t5, t6, t7 = (
                c[n - 1, 0],
                c[n - 1, 1],
                c[n - 1, 2],
                c[n - 1, 3],
                c[n - 1, 4],
                c[n - 1, 5],
                c[n - 1, 6],
                c[n - 1, 7],
            )
            for k in range(n - 2, i - 1, -1):
                t0 = c[k, 0] + x0 * t0
                t1 = c[k, 1] + x1 * t1
                t2 = c[k, 2] + x2 * t2
                t3 = c[k, 3] + x3 * t3
                t4 = c[k, 4] + x4 * t4
                t5 = c[k, 5] + x5 * t5
                t6 = c[k, 6] + x6 * t6
                t7 = c[k, 7] + x7 * t7
                c[k, 0], c[k, 1], c[k, 2], c[k, 3], c[k, 4], c[k, 5], c[k, 6], c[k, 7] = t0, t1, t2, t3, t4, t5, t6, t7
        for k in range(terms):
            for q in range(8):
                out[k, h + q] = c[k, q] if k < n else 0.0


@njit(**JIT)
def affine(coef, cx, cy, xu, xv, yu, yv):
    """Powers (n, n) in (u, v) of the polynomial coef at x = cx + xu u + xv v, y = cy + yu u + yv v; exact.

    First moved and scaled, then turned: what turns mixes powers of one total degree only.
    """
    n, top = coef.shape[0], 0
    for i in range(coef.shape[0]):
        for j in range(coef.shape[0] - i):
            if coef[i, j] != 0.0:
                top = max(top, i + j + 1)
    out = np.zeros((n, n))
    if top == 0:
        return out
    if xv == 0.0 and yu == 0.0:
        out[:top, :top] = _moved(coef[:top, :top], cx, xu, cy, yv)
        return out
    scale = math.sqrt(abs(xu * yv - xv * yu))
    moved = coef[:top, :top]
    if cx != 0.0 or cy != 0.0 or scale != 1.0:
        moved = _moved(moved, cx, scale, cy, scale)
    _turned(moved, xu / scale, xv / scale, yu / scale, yv / scale, out)
    return out


@njit(**JIT)
def _turned(coef, xu, xv, yu, yv, out):
    """Powers in (u, v) of the polynomial coef (n, n) at x = xu u + xv v, y = yu u + yv v, into out (n or more, same).

    Degree by degree: Σ c[i] x^i y^(d - i) by Horner's rule in x, with the powers of y beside it.
    """
    n = coef.shape[0]
    total, power = np.empty(n), np.empty(n)
    for d in range(n):
        # total[k], power[k]: of u^k v^(degree - k)
        total[0], power[0] = coef[d, 0], 1.0
        for i in range(d - 1, -1, -1):
            size = d - i  # the degree after this step
            total[size], power[size] = xu * total[size - 1], yu * power[size - 1]
            for k in range(size - 1, 0, -1):
                total[k] = xv * total[k] + xu * total[k - 1]
                power[k] = yv * power[k] + yu * power[k - 1]
            total[0], power[0] = xv * total[0], yv * power[0]
            c = coef[i, size]
            for k in range(size + 1):
                total[k] += c * power[k]
        for k in range(d + 1):
            out[k, d - k] = total[k]


@njit(**JIT)
def _moved(coef, cx, xu, cy, yv):
    """``affine`` without turning: one variable after the other, each by Horner."""
    n = coef.shape[0]
    out, half = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n - 1, -1, -1):
        for k in range(n - 1 - i, 0, -1):
            for j in range(n - i):
                half[k, j] = cx * half[k, j] + xu * half[k - 1, j]
        for j in range(n - i):
            half[0, j] = cx * half[0, j] + coef[i, j]
    for j in range(n - 1, -1, -1):
        for k in range(n - 1 - j, 0, -1):
            for i in range(n - j):
                out[k, i] = cy * out[k, i] + yv * out[k - 1, i]
        for i in range(n - j):
            out[0, i] = cy * out[0, i] + half[i, j]
    return out.T.copy()


@njit(**JIT)
def _chebyshev_powers(shift, stretch, n):
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


@njit(**JIT)
def expanded(coef, shift, stretch, n):
    """Powers (C, n, n) of (x, y) of Chebyshev products (C, k, k) on (shift + stretch·(x, y)), k <= n; exact."""
    k = coef.shape[1]
    across, along = _chebyshev_powers(shift[0], stretch[0], k), _chebyshev_powers(shift[1], stretch[1], k)
    out, half = np.zeros((coef.shape[0], n, n)), np.empty((k, k))
    for c in range(coef.shape[0]):
        half[:, :] = 0.0
        for i in range(k):
            for j in range(k - i):
                factor = coef[c, i, j]
                if factor != 0.0:
                    for q in range(j + 1):
                        half[i, q] += factor * along[j, q]
        for i in range(k):
            for p in range(i + 1):
                factor = across[i, p]
                for q in range(k - i):
                    out[c, p, q] += factor * half[i, q]
    return out


@njit(**JIT)
def reparameter(c, mid, half, out):
    """Powers of t of the polynomial c at s = mid + half t."""
    d = c.shape[0]
    out[:] = 0.0
    for k in range(d - 1, -1, -1):
        for i in range(d - 1, 0, -1):
            out[i] = mid * out[i] + half * out[i - 1]
        out[0] = mid * out[0] + c[k]


@njit(**JIT)
def second_order(f, x, y):
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


@njit(**JIT)
def derivative_x(coef):
    """Powers (n, n) of the derivative by x."""
    n = coef.shape[0]
    out = np.zeros((n, n))
    for i in range(1, n):
        for j in range(n - i):
            out[i - 1, j] = i * coef[i, j]
    return out


@njit(**JIT)
def bernstein_matrix(n):
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


@njit(**JIT)
def bernstein(coef, ru, rv, convert):
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
