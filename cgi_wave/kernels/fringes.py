"""Carriers and envelopes put together: the fringe pattern of a zone of the detector, row by row."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cgi_wave.kernels.turns import FAST, half_turn

CHUNK = 256


@njit(cache=True, nogil=True, fastmath=FAST)
def _carrier(phase, cosine, sine):
    """cos and sin of 2π phase (cycles) of a slice."""
    for i in range(phase.shape[0]):
        s, c = half_turn((phase[i] - math.floor(phase[i] + 0.5)) * math.pi)
        cosine[i] = 1.0 - 2.0 * s * s
        sine[i] = 2.0 * s * c


@njit(cache=True, nogil=True, fastmath=FAST)
def _turn(cosine, sine, co, si):
    """(co, si) turned on by the carrier, in place."""
    for i in range(co.shape[0]):
        a, b = co[i], si[i]
        co[i] = a * cosine[i] - b * sine[i]
        si[i] = a * sine[i] + b * cosine[i]


@njit(cache=True, nogil=True, fastmath=FAST)
def _add(out, re, im, co, si):
    for i in range(out.shape[0]):
        out[i] += re[i] * co[i] - im[i] * si[i]


@njit(cache=True, nogil=True)
def add_fringes(phase, envelope, first, last, out):
    """out (R, C) += Re Σ_h envelope_h exp(i 2π h phase) over rows first … last − 1.

    phase (R, C) in cycles; envelope (H, 2, R, C): real and imaginary parts of harmonics 1 … H.
    """
    width = phase.shape[1]
    cosine, sine = np.empty(CHUNK), np.empty(CHUNK)
    co, si = np.empty(CHUNK), np.empty(CHUNK)
    for row in range(first, last):
        for a in range(0, width, CHUNK):
            b = min(a + CHUNK, width)
            m = b - a
            _carrier(phase[row, a:b], cosine[:m], sine[:m])
            co[:m], si[:m] = cosine[:m], sine[:m]
            for h in range(envelope.shape[0]):
                if h > 0:
                    _turn(cosine[:m], sine[:m], co[:m], si[:m])
                _add(out[row, a:b], envelope[h, 0, row, a:b], envelope[h, 1, row, a:b], co[:m], si[:m])
