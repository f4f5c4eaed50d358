"""Asymptotic series of ``kernels.stokes``: amplitudes far from any stationary point, and a stationary point's own term.

Both are what ∫ g exp(i 2π f) along a path of steepest descent leaves, expanded in the inverse of the phase: real sums
and products of Taylor coefficients where Gauss–Laguerre nodes take a search on complex paths. Terms fall like k!/P^k,
P rad of phase to the nearest other stationary point; the first term left out is the error, about.

Part of the call tree of ``kernels.stokes``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cgi_wave.kernels.polynomials import BATCH, JIT, taylors

MOST = 12  # terms after the first
_FACTORIAL = np.array([float(math.factorial(k)) for k in range(MOST + 2)])
_HALVES = 5  # terms of a stationary point after the first


@njit(**JIT)
def distance(d1, c2, c3):
    """Rad of phase to the nearest stationary point, from a phase's Taylor coefficients, with a fifth of margin."""
    found = 1e300
    if c2 != 0.0:
        found = min(found, d1 * d1 / (4.0 * abs(c2)))
    if c3 != 0.0:
        found = min(found, 0.66 * abs(d1) * math.sqrt(abs(d1) / (3.0 * abs(c3))))
    return 0.8 * 2.0 * math.pi * found


@njit(**JIT)
def terms_for(nearest, allowed):
    """(terms after the first that leave a relative error of ``allowed``, what they leave); −1 if MOST do not."""
    for k in range(1, MOST + 1):
        missed = _FACTORIAL[k + 1] / nearest ** (k + 1)
        if missed <= allowed:
            return k, missed
    return -1, 0.0


@njit(**JIT)
def _times(p, q, last, out):
    """Product of two series (terms, BATCH) up to the power ``last``."""
    for k in range(last + 1):
        for r in range(BATCH):
            out[k, r] = 0.0
        for j in range(k + 1):
            for r in range(BATCH):
                out[k, r] += p[j, r] * q[k - j, r]


@njit(**JIT)
def far_amplitudes(c, als, bls, wls, x, terms, nearest, work, out):
    """E of BATCH lines at x, and of the same times the further factor: fills out (4, BATCH); largest relative error.

    c (> terms + 1, BATCH): Taylor coefficients of the phases at x (BATCH,); als, bls, wls (BATCH, m): amplitudes along
    the lines. E = (1/2πi) Σ (i/2π)^k D^k (a b / f'), D = (1/f') d/dx. nearest: rad; work (6, MOST + 2, BATCH).
    """
    inverse, product, here, there = work[0], work[1], work[2], work[3]
    for r in range(BATCH):
        inverse[0, r] = 1.0 / c[1, r]
    for k in range(1, terms + 1):
        for r in range(BATCH):
            inverse[k, r] = 0.0
        for j in range(1, k + 1):
            for r in range(BATCH):
                inverse[k, r] -= (j + 1) * c[j + 1, r] * inverse[k - j, r]
        for r in range(BATCH):
            inverse[k, r] *= inverse[0, r]
    taylors(als, x, here[: terms + 1])
    taylors(bls, x, there[: terms + 1])
    _times(here, there, terms, product)
    worst = 0.0
    for channel in range(2 if wls.shape[1] > 0 else 1):
        if channel == 1:
            taylors(wls, x, here[: terms + 1])
            _times(product, here, terms, there)
            product, there = there, product
        _times(product, inverse, terms, here)
        re, im, last, size = work[4, 0], work[4, 1], work[4, 2], 1.0 / (2.0 * math.pi)
        for r in range(BATCH):
            re[r], im[r], last[r] = 0.0, -here[0, r] * size, abs(here[0, r]) * size
        at, spare = here, work[5]
        for k in range(1, terms + 1):
            for q in range(terms - k + 1):
                for r in range(BATCH):
                    at[q, r] = (q + 1) * at[q + 1, r]
            _times(at, inverse, terms - k, spare)
            at, spare = spare, at
            size /= 2.0 * math.pi
            sign = size if k % 4 < 2 else -size  # i^(k − 1): 1 and i, then −1 and −i
            if k % 2 == 1:
                sign = size if k % 4 == 1 else -size
                for r in range(BATCH):
                    re[r] += sign * at[0, r]
            else:
                sign = size if k % 4 == 2 else -size
                for r in range(BATCH):
                    im[r] += sign * at[0, r]
            for r in range(BATCH):
                last[r] = max(abs(at[0, r]) * size, last[r] * k / nearest)
        for r in range(BATCH):
            out[2 * channel, r], out[2 * channel + 1, r] = re[r], im[r]
            if channel == 0:
                worst = max(worst, last[r] / max(math.hypot(re[r], im[r]), 1e-300))
    return worst * (terms + 1) / nearest


@njit(**JIT)
def centre_amplitude(f, a, b, w, out):
    """∫ a b r exp(i 2π f) dr from a stationary point outwards, the mean of a ray and its opposite: fills out (4,).

    f, a, b, w: powers of r, f[0] = f[1] = 0. With f = c r² / U: ½ Σ l! (i / 2πc)^(l + 1) [r^2l] a b U^(l + 1)
    (Lagrange's inversion of √f; odd powers of √f cancel between a ray and its opposite). Returns the larger of the last
    two terms.
    """
    top = 2 * _HALVES + 1
    inverse, series, spare = np.zeros(top), np.zeros(top), np.zeros(top)
    inverse[0] = 1.0
    for k in range(1, top):
        for j in range(1, min(k, f.shape[0] - 3) + 1):
            inverse[k] -= f[j + 2] / f[2] * inverse[k - j]
    missed = 0.0
    out[:] = 0.0
    for channel in range(2 if w.shape[0] > 0 else 1):
        for k in range(top):
            series[k] = 0.0
            for j in range(max(0, k - b.shape[0] + 1), min(k, a.shape[0] - 1) + 1):
                series[k] += a[j] * b[k - j]
        if channel == 1:
            _multiply(series, w, spare)
        scale, value, before = 0.5, 0.0, 0.0
        for half in range(_HALVES + 1):
            _multiply(series, inverse, spare)
            scale *= max(half, 1) / (2.0 * math.pi * f[2])
            value, before = scale * series[2 * half], value
            turn = (half + 1) % 4  # of i^(half + 1)
            out[2 * channel + turn % 2] += value if turn < 2 else -value
        if channel == 0:
            missed = max(abs(value), abs(before))
    return missed


@njit(**JIT)
def _multiply(series, factor, spare):
    """series times factor, in place, up to its own length."""
    top = series.shape[0]
    for k in range(top):
        spare[k] = 0.0
        for j in range(max(0, k - factor.shape[0] + 1), k + 1):
            spare[k] += series[j] * factor[k - j]
    for k in range(top):
        series[k] = spare[k]
