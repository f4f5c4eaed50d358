"""Radiance at the top of the atmosphere: a smooth solar continuum, reflected, with or without a gas in its way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.spectrum import Spectrum

if TYPE_CHECKING:
    from cgi_wave.scene.lines import LineList

Kind = Literal["solar", "o2a", "co2", "ch4"]
PLANCK, LIGHT_SPEED, BOLTZMANN = 6.62607015e-34, 299_792_458.0, 1.380649e-23
# IAU 2015 Resolution B3 nominal values: effective temperature and radius of the Sun; the astronomical unit.
SUN_TEMPERATURE_K, SUN_RADIUS_M, ASTRONOMICAL_UNIT_M = 5772.0, 6.957e8, 1.495978707e11
MAX_SAMPLES = 4_000_000
_SAMPLES_PER_FWHM = 64
#: Lines farther than this from the filter's support (1/m) are left out. Their Lorentz wings would be too strong there
#: anyway: collisions last long enough to cut them off within a few cm⁻¹.
_WING = 2000.0


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
    kind: Kind,
    band_filter: Filter,
    max_opd_m: float,
    albedo: float = 0.3,
    air_mass: float = 2.0,
    layers: int = 8,
) -> Spectrum:
    """Nadir radiance over the filter's support: albedo/π · μ0 · solar irradiance [· transmission of a gas].

    kind: ``"solar"`` for the continuum alone, ``"o2a"``, ``"co2"`` or ``"ch4"`` with the lines of that gas in its way.
    Lambertian ground, no scattering. ``air_mass`` is that of the whole path, 1 (up, nadir) + 1/μ0 (down), hence
    μ0 = 1/(air_mass − 1); at least 2. ``layers`` of the US Standard Atmosphere 1976 for the absorption.
    The step is at most 1/(4·max_opd_m), FWHM/64 of the filter, and with a gas half the smallest Doppler deviation.

    Raises InputError for an unknown kind, a gas without a line near the filter, albedo outside (0, 1], air mass below 2
    or an OPD that is not positive, and MethodLimitError where the OPD would need more than 4 million samples.
    """

    def refuse(field: str, value: object, problem: str, remedy: str) -> InputError:
        return InputError("spectrum", field, value, problem, remedy)

    if kind not in get_args(Kind):
        raise refuse("kind", kind, "unknown", f"use one of {', '.join(get_args(Kind))}, or load a file")
    if not 0 < albedo <= 1:
        raise refuse("albedo", albedo, "outside (0, 1]", "give the ground's reflectance")
    if not (np.isfinite(air_mass) and air_mass >= 2):
        raise refuse("air_mass", air_mass, "sun and sensor overhead make 2", "give 2 or more: 1 + 1/cos(sun zenith)")
    if not (np.isfinite(max_opd_m) and max_opd_m > 0):
        raise refuse("max_opd_m", max_opd_m, "not a positive length", "give the largest |OPD| kept, in metres")

    low, high = band_filter.support()
    step = min(1 / (4 * max_opd_m), band_filter.fwhm_m / band_filter.centre_m**2 / _SAMPLES_PER_FWHM)
    lines = gas_lines(kind, band_filter)
    if lines is not None:
        step = min(step, _line_step(lines, layers))
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
    if lines is not None:
        from cgi_wave.scene.atmosphere import standard_atmosphere, transmission

        radiance = radiance * transmission(lines, sigma, air_mass, standard_atmosphere(layers))
        source += f"; {lines.source}; US Standard Atmosphere 1976 in {layers} layers, air mass {air_mass:g}"
    return Spectrum(sigma=sigma, radiance=radiance, source=source)


def gas_lines(kind: str, band_filter: Filter) -> LineList | None:
    """The lines that ``toa_radiance`` takes for a kind behind a filter; None for ``"solar"``.

    Raises InputError for a gas without a line near the filter.
    """
    if kind == "solar":
        return None
    low, high = band_filter.support()
    lines = _lines(kind).near(low - _WING, high + _WING)
    if lines.sigma.size == 0:
        raise InputError("spectrum", "kind", kind, f"has no line near {band_filter.centre_m * 1e9:g} nm",
                         "use another gas or 'solar', or move the filter")  # fmt: skip
    return lines


def _lines(kind: str) -> LineList:
    """All lines that are known of a gas."""
    if kind == "o2a":
        from cgi_wave.scene.oxygen import oxygen_a_band

        return oxygen_a_band()
    if kind == "co2":
        from cgi_wave.scene.carbon_dioxide import carbon_dioxide

        return carbon_dioxide()
    from cgi_wave.scene.methane import methane

    return methane()


def _line_step(lines: LineList, layers: int) -> float:
    """Step in 1/m that resolves the narrowest line (a Gaussian's trapezoid sum has converged there)."""
    from cgi_wave.scene.atmosphere import doppler_sigma, standard_atmosphere

    coldest = min(layer.temperature_k for layer in standard_atmosphere(layers))
    return float(doppler_sigma(lines, coldest).min()) / 2
