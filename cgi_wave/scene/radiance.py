"""Radiance at the top of the atmosphere: a smooth solar continuum, reflected, with or without the O2 A band."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.spectrum import Spectrum

PLANCK, LIGHT_SPEED, BOLTZMANN = 6.62607015e-34, 299_792_458.0, 1.380649e-23
# IAU 2015 Resolution B3 nominal values: effective temperature and radius of the Sun; the astronomical unit.
SUN_TEMPERATURE_K, SUN_RADIUS_M, ASTRONOMICAL_UNIT_M = 5772.0, 6.957e8, 1.495978707e11
MAX_SAMPLES = 4_000_000
_SAMPLES_PER_FWHM = 64


def solar_irradiance(sigma: NDArray[np.float64]) -> NDArray[np.float64]:
    """Irradiance outside the atmosphere at 1 au, W m⁻² per (1/m), at vacuum wavenumbers ``sigma`` in 1/m.

    A black body of 5772 K that fills the Sun's disk: π B(σ, T)·(R/au)². A smooth stand-in for the continuum, within
    about 20 % of the real one from 450 nm to 2 µm, and without Fraunhofer lines.
    """
    x = PLANCK * LIGHT_SPEED * np.asarray(sigma, dtype=np.float64) / (BOLTZMANN * SUN_TEMPERATURE_K)
    planck = 2 * PLANCK * LIGHT_SPEED**2 * sigma**3 / np.expm1(x)
    irradiance: NDArray[np.float64] = np.pi * planck * (SUN_RADIUS_M / ASTRONOMICAL_UNIT_M) ** 2
    return irradiance


def toa_radiance(
    kind: Literal["o2a", "solar"],
    band_filter: Filter,
    max_opd_m: float,
    albedo: float = 0.3,
    air_mass: float = 2.0,
    layers: int = 8,
) -> Spectrum:
    """Nadir radiance over the filter's support: albedo/π · μ0 · solar irradiance [· transmission for ``"o2a"``].

    Lambertian ground, no scattering. ``air_mass`` is that of the whole path, 1 (up, nadir) + 1/μ0 (down), hence
    μ0 = 1/(air_mass − 1); at least 2. ``layers`` of the US Standard Atmosphere 1976 for the absorption.
    The step is at most 1/(4·max_opd_m), FWHM/64 of the filter, and for ``"o2a"`` half the smallest Doppler deviation.

    Raises InputError for an unknown kind, albedo outside (0, 1], air mass below 2 or an OPD that is not positive, and
    MethodLimitError where the OPD would need more than 4 million samples.
    """

    def refuse(field: str, value: object, problem: str, remedy: str) -> InputError:
        return InputError("spectrum", field, value, problem, remedy)

    if kind not in ("o2a", "solar"):
        raise refuse("kind", kind, "unknown", "use 'o2a' or 'solar', or load a file")
    if not 0 < albedo <= 1:
        raise refuse("albedo", albedo, "outside (0, 1]", "give the ground's reflectance")
    if not (np.isfinite(air_mass) and air_mass >= 2):
        raise refuse("air_mass", air_mass, "sun and sensor overhead make 2", "give 2 or more: 1 + 1/cos(sun zenith)")
    if not (np.isfinite(max_opd_m) and max_opd_m > 0):
        raise refuse("max_opd_m", max_opd_m, "not a positive length", "give the largest |OPD| kept, in metres")

    low, high = band_filter.support()
    step = min(1 / (4 * max_opd_m), band_filter.fwhm_m / band_filter.centre_m**2 / _SAMPLES_PER_FWHM)
    if kind == "o2a":
        step = min(step, _line_step(layers))
    samples = int(np.ceil((high - low) / step)) + 1
    if samples > MAX_SAMPLES:
        raise MethodLimitError(
            "toa_radiance",
            f"{MAX_SAMPLES} spectral samples reach an OPD of {max_opd_m * MAX_SAMPLES / samples:.3g} m",
            samples / MAX_SAMPLES,
            "bound pairs of larger OPD instead of computing them",
        )
    sigma = np.linspace(low, high, samples)
    radiance = albedo / np.pi / (air_mass - 1) * solar_irradiance(sigma)
    source = f"5772 K solar continuum, albedo {albedo:g}, sun at cos(zenith) {1 / (air_mass - 1):.3g}"
    if kind == "o2a":
        from cgi_wave.scene.atmosphere import standard_atmosphere, transmission
        from cgi_wave.scene.oxygen import oxygen_a_band

        lines = oxygen_a_band()
        radiance = radiance * transmission(lines, sigma, air_mass, standard_atmosphere(layers))
        source += f"; {lines.source}; US Standard Atmosphere 1976 in {layers} layers, air mass {air_mass:g}"
    return Spectrum(sigma=sigma, radiance=radiance, source=source)


def _line_step(layers: int) -> float:
    """Step in 1/m that resolves the narrowest line of the A band (a Gaussian's trapezoid sum has converged there)."""
    from cgi_wave.scene.atmosphere import doppler_sigma, standard_atmosphere
    from cgi_wave.scene.oxygen import oxygen_a_band

    coldest = min(layer.temperature_k for layer in standard_atmosphere(layers))
    return float(doppler_sigma(oxygen_a_band(), coldest).min()) / 2
