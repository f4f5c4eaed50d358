"""Sine and cosine for loops that must vectorise: no branch, no call. Inlined where it is used.

A change here leaves the cached code of all that use it stale (see CONTRIBUTING.md).
"""

from __future__ import annotations

from numba import njit

# Reassociation lets loops over nodes and pixels vectorise; NaN and infinity keep their meaning.
FAST = {"reassoc", "contract", "arcp", "nsz"}


@njit(cache=True, nogil=True, fastmath=FAST, inline="always")
def half_turn(r):
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
