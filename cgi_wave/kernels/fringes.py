"""Carriers and envelopes put together: the fringe pattern of a zone of the detector, row by row.

Everything here stands in one module, since Numba's cache does not notice changes in other files.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

CHUNK = 256
# Reassociation lets the loops over pixels vectorise; NaN and infinity keep their meaning.
_FAST = {"reassoc", "contract", "arcp", "nsz"}


@njit(cache=True, nogil=True, fastmath=_FAST)
def _carrier(phase, cosine, sine):
    """cos and sin of 2π phase (cycles) of a slice, by Taylor series of half the angle: no branch, no call."""
    for i in range(phase.shape[0]):
        r = (phase[i] - math.floor(phase[i] + 0.5)) * math.pi
        z = r * r
        s = -1.0 / 51090942171709440000.0
        s = s * z + 1.0 / 121645100408832000.0
        s = s * z - 1.0 / 355687428096000.0
        s = s * z + 1.0 / 1307674368000.0
        s = s * z - 1.0 / 6227020800.0
        s = s * z + 1.0 / 39916800.0
        s = s * z - 1.0 / 362880.0
        s = s * z + 1.0 / 5040.0
        s = s * z - 1.0 / 120.0
        s = s * z + 1.0 / 6.0
        s = r - r * z * s
        c = -1.0 / 1124000727777607680000.0
        c = c * z + 1.0 / 2432902008176640000.0
        c = c * z - 1.0 / 6402373705728000.0
        c = c * z + 1.0 / 20922789888000.0
        c = c * z - 1.0 / 87178291200.0
        c = c * z + 1.0 / 479001600.0
        c = c * z - 1.0 / 3628800.0
        c = c * z + 1.0 / 40320.0
        c = c * z - 1.0 / 720.0
        c = c * z + 1.0 / 24.0
        c = c * z - 0.5
        c = c * z + 1.0
        cosine[i] = 1.0 - 2.0 * s * s
        sine[i] = 2.0 * s * c


@njit(cache=True, nogil=True, fastmath=_FAST)
def _turn(cosine, sine, co, si):
    """(co, si) turned on by the carrier, in place."""
    for i in range(co.shape[0]):
        a, b = co[i], si[i]
        co[i] = a * cosine[i] - b * sine[i]
        si[i] = a * sine[i] + b * cosine[i]


@njit(cache=True, nogil=True, fastmath=_FAST)
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
