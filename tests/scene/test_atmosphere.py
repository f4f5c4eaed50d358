"""Line-by-line transmission against closed forms and a slow oracle."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.special import voigt_profile

from cgi_wave.scene.atmosphere import (
    SURFACE_PRESSURE_PA,
    Layer,
    doppler_sigma,
    standard_atmosphere,
    standard_temperature,
    transmission,
)
from cgi_wave.scene.lines import LineList
from cgi_wave.scene.oxygen import oxygen_a_band


def one_line(strength: float, half_width: float, mass_kg: float) -> LineList:
    return LineList(
        branch=np.array(["PP"]),
        n_lower=np.array([1]),
        j_lower=np.array([1]),
        sigma=np.array([1.31e6]),
        strength=np.array([strength]),
        lower_energy=np.array([0.0]),
        half_width=np.array([half_width]),
        exponent=np.array([0.7]),
        mass_kg=mass_kg,
        mole_fraction=1.0,
        partition=lambda t: 1.0,
        source="test",
    )


def test_standard_atmosphere_has_the_published_temperatures_and_the_whole_column():
    pressures = (101325.0, 22632.06, 5474.889, 868.0187, 110.9063)  # US Standard Atmosphere 1976, 0 … 47 km
    kelvin = (288.15, 216.65, 216.65, 228.65, 270.65)
    assert [standard_temperature(p) for p in pressures] == pytest.approx(kelvin, abs=0.01)
    column = sum(layer.air_column for layer in standard_atmosphere(7))
    assert column == pytest.approx(SURFACE_PRESSURE_PA * 6.02214076e23 / (9.80665 * 0.0289644), rel=1e-12)


def test_transmission_agrees_with_the_full_voigt_sum():
    """Every line as a Voigt profile at every distance, summed one by one: the split at the reach is invisible."""
    lines, layers = oxygen_a_band(), standard_atmosphere(3)
    sigma = np.sort(np.random.default_rng(1).uniform(13000e2, 13180e2, 400))
    depth = np.zeros_like(sigma)
    for layer in layers:
        strength = lines.strength_at(layer.temperature_k)
        gamma = lines.half_width_at(layer.temperature_k, layer.pressure_pa)
        doppler = doppler_sigma(lines, layer.temperature_k)
        for i in range(lines.sigma.size):
            shape = voigt_profile(sigma - lines.sigma[i], doppler[i], gamma[i])
            depth += layer.air_column * lines.mole_fraction * strength[i] * shape
    assert transmission(lines, sigma, 2.0, layers) == pytest.approx(np.exp(-2 * depth), abs=2e-7)


def test_weak_line_absorbs_its_strength_times_the_column():
    layer = Layer(pressure_pa=100.0, temperature_k=296.0, air_column=1e22)
    line = one_line(strength=1e-26, half_width=1e-3, mass_kg=5e-26)
    sigma = 1.31e6 + np.arange(-4000.0, 4000.0, 0.05)
    width = np.sum(1 - transmission(line, sigma, 1.0, (layer,))) * 0.05
    wings = 1e-4 * 2 / np.pi * 0.1 / 4000.0  # what a Lorentzian of 0.1 1/m leaves outside ±4000 1/m
    assert width + wings == pytest.approx(1e-4, rel=2e-5)  # saturation takes 1.1e-5: 1e-4/(4·√π·s), s = 1.25 1/m


def test_strong_lorentz_line_follows_the_square_root_of_growth():
    """Ladenburg–Reiche for large x = S·u/(2πγ): W = 2√(S·u·γ)·(1 − 1/(8x)); a heavy molecule has no Doppler width."""
    layer = Layer(pressure_pa=1e5, temperature_k=296.0, air_column=1e24)
    line = one_line(strength=1e-20, half_width=5e-5, mass_kg=1.0)
    area, gamma = 1e4, 5.0
    sigma = 1.31e6 + np.arange(-40000.0, 40000.0, 0.5)
    width = np.sum(1 - transmission(line, sigma, 1.0, (layer,))) * 0.5 + 2 * area * gamma / np.pi / 40000.0
    x = area / (2 * np.pi * gamma)
    assert width == pytest.approx(2 * np.sqrt(area * gamma) * (1 - 1 / (8 * x)), rel=2e-4)


def test_air_masses_multiply():
    sigma = np.linspace(13080e2, 13100e2, 500)
    lines = oxygen_a_band()
    assert transmission(lines, sigma, 3.0) == pytest.approx(transmission(lines, sigma, 1.0) ** 3, rel=1e-10)
    assert np.all(transmission(lines, sigma, 0.0) == 1.0)


def test_vacuum_is_finite_and_impossible_arguments_are_refused():
    sigma = np.linspace(13080e2, 13100e2, 50)
    vacuum = dataclasses.replace(standard_atmosphere(1)[0], pressure_pa=0.0)
    assert np.all(np.isfinite(transmission(oxygen_a_band(), sigma, 2.0, (vacuum,))))
    with pytest.raises(ValueError, match="air_mass"):
        transmission(oxygen_a_band(), sigma, -1.0)
    with pytest.raises(ValueError, match="layers"):
        standard_atmosphere(0)
