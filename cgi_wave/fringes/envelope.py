"""How much of a pair's fringes the spectrum lets stand: the largest |G(D)| = |∫ w(σ) exp(i2πσD) dσ| / ∫ w dσ."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from cgi_wave.errors import InputError

Array = NDArray[np.float64]
_OVERSAMPLING = 8


def max_envelope(sigma: Array, weight: Array) -> Callable[[float, float], float]:
    """Return ``envelope(opd_lo, opd_hi)``, the largest |G| for any **group** OPD in that range (m, signs allowed).

    sigma (S,) 1/m, uniform and ascending; weight (S,) ≥ 0, filter × radiance.
    G is tabulated 8 times finer than 1/(σ_max − σ_min), where a function of that band exceeds its largest sample by
    1/cos(π/16) = 1.02 at most: the values carry that factor. Beyond 1/(4·step), the sampling limit of the
    interferogram, nothing is known from this grid; the largest |G| between half that OPD and that OPD stands for all
    beyond, which holds for a spectrum without structure finer than its grid.

    Raises InputError for a grid that is not uniform.
    """
    step = np.diff(sigma)
    if len(step) < 1 or np.ptp(step) > 1e-6 * step.mean():
        raise InputError("max_envelope", "sigma", sigma.shape, "must be a uniform grid", "resample the spectrum")
    size = scipy.fft.next_fast_len(_OVERSAMPLING * len(sigma), real=True)
    amplitude = np.abs(scipy.fft.rfft(weight, size)) / weight.sum() / np.cos(np.pi / (2 * _OVERSAMPLING))
    opd_step = 1.0 / (size * float(step.mean()))
    last = size // 4
    amplitude = np.minimum(amplitude[: last + 1], 1.0)
    beyond = float(amplitude[last // 2 :].max())

    def envelope(opd_lo: float, opd_hi: float) -> float:
        low, high = sorted((opd_lo, opd_hi))
        near = 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))
        first = int(near / opd_step)
        end = int(np.ceil(max(abs(low), abs(high)) / opd_step))
        inside = float(amplitude[first : end + 1].max()) if first <= last else 0.0
        return max(inside, beyond) if end > last else inside

    return envelope
