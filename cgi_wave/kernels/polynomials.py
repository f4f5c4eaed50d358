"""Polynomials in one and two variables, as powers: values, restriction to lines, substitution, bounds of their range.

coef[i, j] x^i y^j with i + j < n. Part of the call tree of ``kernels.stokes``.
"""

from __future__ import annotations

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
def along_rays(coef, c, s, out):
    """Powers of r of polynomials (P, n, n) along BATCH rays (r c, r s) at a time: fills out (BATCH, P, n).

    All rays take a term together, so that the compiler computes them in vector registers.
    """
    n = coef.shape[1]
    terms, total = np.empty((n, n, BATCH)), np.empty(BATCH)  # c^i s^(k - i)
    for r in range(BATCH):
        terms[0, 0, r] = 1.0
    for k in range(1, n):
        for r in range(BATCH):
            terms[0, k, r] = terms[0, k - 1, r] * s[r]
        for i in range(1, k + 1):
            for r in range(BATCH):
                terms[i, k, r] = terms[i - 1, k - 1, r] * c[r]
    for p in range(coef.shape[0]):
        for k in range(n):
            for r in range(BATCH):
                total[r] = 0.0
            for i in range(k + 1):
                factor = coef[p, i, k - i]
                for r in range(BATCH):
                    total[r] += factor * terms[i, k, r]
            for r in range(BATCH):
                out[r, p, k] = total[r]


@njit(**JIT)
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


@njit(**JIT)
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
