"""Complex coherence of filtered light against the optical path difference, exact and as a bound that holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import next_fast_len, rfft
from scipy.optimize import minimize_scalar

from cgi_wave.errors import MethodLimitError
from cgi_wave.scene.filters import Filter, require_coverage
from cgi_wave.scene.spectrum import Spectrum

Array = NDArray[np.float64]
_MARGIN = 2e-5  # what the envelope may add between its grid points
_MAX_FFT = 1 << 22
_TABLE = 1 << 17  # entries of the range-maximum table
_BLOCK = 1024  # OPDs summed at a time


def max_opd(spectrum: Spectrum) -> float:
    """Largest |OPD| in m that the spectrum's step carries: 1/(4·step), half of the Nyquist limit 1/(2·step)."""
    return float((spectrum.sigma.size - 1) / (4 * (spectrum.sigma[-1] - spectrum.sigma[0])))


def coherence(
    spectrum: Spectrum, band_filter: Filter, opd_m: ArrayLike, sigma0: float | None = None
) -> NDArray[np.complex128]:
    """G(τ) = ∫F L exp(i2π(σ − σ0)τ)dσ / ∫F L dσ at OPDs ``opd_m`` in m (any shape); |G| is the NMA of two equal beams.

    ``sigma0`` (1/m) only sets the phase; default 1/centre of the filter. The trapezoid sum over the spectrum's own
    samples, evaluated without interpolation (error of rounding only, 1e-12); how well the samples stand for the
    spectrum is settled where the spectrum is made.

    Raises InputError if the spectrum does not cover the filter, MethodLimitError for |τ| > 1/(4·step).
    """
    tau = np.asarray(opd_m, dtype=np.float64)
    limit = max_opd(spectrum)
    largest = float(np.max(np.abs(tau), initial=0.0))
    if not largest <= limit * (1 + 1e-9):
        raise MethodLimitError(
            "coherence",
            f"|OPD| ≤ 1/(4·spectral step) = {limit:.4g} m",
            largest / limit,
            "use a spectrum with a finer step (max_opd_m of toa_radiance), or a bound: coherence_envelope",
        )
    weight, start, step = _weights(spectrum, band_filter)
    origin = 1 / band_filter.centre_m if sigma0 is None else sigma0

    # σ_j = start + (pQ + q)·step: one small sum over q, one over p, instead of one exponential per sample and OPD.
    columns = int(np.ceil(np.sqrt(weight.size)))
    rows = -(-weight.size // columns)
    table = np.pad(weight.astype(np.complex128), (0, rows * columns - weight.size)).reshape(rows, columns)
    flat = tau.ravel()
    result = np.empty(flat.size, dtype=np.complex128)
    for first in range(0, flat.size, _BLOCK):
        part = flat[first : first + _BLOCK]
        fine = np.exp(2j * np.pi * step * np.arange(columns)[:, None] * part)
        coarse = np.exp(2j * np.pi * (start - origin + step * columns * np.arange(rows)[:, None]) * part)
        result[first : first + _BLOCK] = np.einsum("pt,pt->t", coarse, table @ fine)
    return result.reshape(tau.shape)


def _weights(spectrum: Spectrum, band_filter: Filter) -> tuple[Array, float, float]:
    """Filter × radiance on the samples inside the filter's support, adding up to 1; first wavenumber and step, 1/m."""
    require_coverage(spectrum, band_filter)
    low, high = band_filter.support()
    step = float((spectrum.sigma[-1] - spectrum.sigma[0]) / (spectrum.sigma.size - 1))
    inside = slice(*np.searchsorted(spectrum.sigma, [low - step, high + step]))
    weight = band_filter.transmission(spectrum.sigma[inside]) * spectrum.radiance[inside]
    return weight / weight.sum(), float(spectrum.sigma[inside][0]), step


def coherence_envelope(spectrum: Spectrum, band_filter: Filter) -> Callable[[ArrayLike, ArrayLike], Array]:
    """A function (opd_lo, opd_hi) → upper bound of |G| over that range of OPDs (m, any sign, arrays broadcast).

    Up to 1/(4·step), the range of ``coherence``, the bound is the largest |G| on an FFT grid plus the most that a
    function with this spectrum can rise above the chord between two grid points, (2π σ_rms·δ)²/8 — 2e-5 where the
    FFT may be that fine (up to 4 million points) — and hardly more than the true maximum. Beyond, the FFT would
    repeat itself and is not used: there the bound is that of the spectrum as drawn, straight between its samples,
    the smaller of TV/(2π|τ|) and TV′/(2π|τ|)², with TV and TV′ the total variations of the normalised filter ×
    radiance and of its slope. They hold at any OPD, fall with it and never alias. 1 is the bound of all bounds.

    Raises InputError if the spectrum does not cover the filter.
    """
    weight, _, step = _weights(spectrum, band_filter)
    limit = max_opd(spectrum)
    density = np.concatenate(([0.0], weight, [0.0])) / step
    variation = float(np.sum(np.abs(np.diff(density))))
    slope_variation = float(np.sum(np.abs(np.diff(density, 2, prepend=0.0, append=0.0)))) / step
    tops, spacing = _grid_maxima(weight, step, limit)

    # levels[k][i] is the maximum of tops[i … i + 2^k − 1]: any range is the larger of two overlapping entries.
    levels = [tops]
    while (1 << len(levels)) <= tops.size:
        half = 1 << (len(levels) - 1)
        levels.append(np.maximum(levels[-1][:-half], levels[-1][half:]))

    def far(tau: Array) -> Array:
        turns = 2 * np.pi * np.maximum(tau, limit)
        bound: Array = np.minimum(np.minimum(variation / turns, slope_variation / turns**2), 1.0)
        return bound

    def envelope(opd_lo: ArrayLike, opd_hi: ArrayLike) -> Array:
        ends = np.sort(np.stack(np.broadcast_arrays(opd_lo, opd_hi)).astype(np.float64), axis=0)
        near = np.where(ends[0] * ends[1] <= 0, 0.0, np.min(np.abs(ends), axis=0))
        distant = np.max(np.abs(ends), axis=0)
        first = np.minimum((np.minimum(near, limit) / spacing).astype(np.int64), tops.size - 1)
        last = np.minimum((np.minimum(distant, limit) / spacing).astype(np.int64), tops.size - 1)
        power = np.log2(last - first + 1).astype(np.int64)
        inside = np.empty(first.shape)
        for k in np.unique(power):
            chosen = power == k
            ahead, behind = first[chosen], last[chosen] - (1 << int(k)) + 1
            inside[chosen] = np.maximum(levels[k][ahead], levels[k][behind])
        outside = far(near)
        inside = np.where(near > limit, outside, inside)
        return np.where(distant > limit, np.maximum(inside, outside), inside)

    return envelope


def _grid_maxima(weight: Array, step: float, limit: float) -> tuple[Array, float]:
    """Upper bounds of |G| over the cells [i, i + 1]·spacing that cover 0 … limit, at most 2^17 of them; the spacing."""
    offset = step * (np.arange(weight.size) - np.sum(weight * np.arange(weight.size)))
    curvature = float(np.sum(weight * (2 * np.pi * offset) ** 2))  # bound of |G″| about the mean wavenumber
    wanted = np.sqrt(8 * _MARGIN / curvature) if curvature > 0 else limit
    size = next_fast_len(int(np.clip(np.ceil(1 / (step * wanted)), weight.size, max(_MAX_FFT, weight.size))), real=True)
    delta = 1 / (size * step)
    magnitude = np.abs(rfft(weight, size))
    cells = int(np.ceil(limit / delta))
    cell = np.maximum(magnitude[:cells], magnitude[1 : cells + 1]) + curvature * delta**2 / 8
    group = -(-cells // _TABLE)
    padded = np.concatenate((cell, np.zeros(-cells % group)))
    return np.minimum(padded.reshape(-1, group).max(axis=1), 1.0), group * delta


@dataclass(frozen=True)
class CoherentRise:
    """Where a band of regularly spaced lines brings the coherence back: opd_m (group OPD, m) and nma = |G| there."""

    opd_m: float
    nma: float


def coherent_rise(spectrum: Spectrum, band_filter: Filter, opd_to_m: float | None = None) -> CoherentRise:
    """The strongest return of |G| after the filter's own coherence has died, up to ``opd_to_m`` (default 1/(4·step)).

    The filter's own coherence counts as dead once a flat spectrum behind it stays below 1e-3. Located to 1e-9 m.
    Raises MethodLimitError if ``opd_to_m`` is beyond 1/(4·step) or lies before that point.
    """
    limit = max_opd(spectrum) if opd_to_m is None else opd_to_m
    flat = Spectrum(spectrum.sigma, np.ones_like(spectrum.sigma), "flat")
    width = band_filter.fwhm_m / band_filter.centre_m**2
    own = np.linspace(0.0, min(limit, max_opd(spectrum), 20 / width), 1000)
    alive = np.flatnonzero(np.abs(coherence(flat, band_filter, own)) > 1e-3)
    start = own[alive[-1]]
    grid = np.arange(start, limit, 0.1 / width)
    if grid.size < 3:
        raise MethodLimitError(
            "coherent_rise",
            f"the filter's own coherence lasts to {start:.4g} m",
            start / limit,
            "search to a larger OPD, on a spectrum with a finer step",
        )
    best = grid[1:-1][np.argmax(np.abs(coherence(spectrum, band_filter, grid[1:-1])))]

    def negative(tau: float) -> float:
        return -float(np.abs(coherence(spectrum, band_filter, tau)))

    found = minimize_scalar(
        negative, bounds=(best - 0.1 / width, best + 0.1 / width), method="bounded", options={"xatol": 1e-9}
    )
    return CoherentRise(opd_m=float(found.x), nma=-float(found.fun))
