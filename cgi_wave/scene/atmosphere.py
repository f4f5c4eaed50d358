"""A layered, plane-parallel, purely absorbing atmosphere and its line-by-line transmission."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import voigt_profile

from cgi_wave.scene.lines import LineList

BOLTZMANN = 1.380649e-23
LIGHT_SPEED = 299_792_458.0
_G = 9.80665
_AIR_MASS_KG = 0.0289644 / 6.02214076e23  # mean mass of a molecule of dry air
_R_SPECIFIC = 287.05287
SURFACE_PRESSURE_PA = 101325.0

# US Standard Atmosphere 1976: geopotential base height (m) and gradient (K/m) of each stratum, from 288.15 K.
_STRATA = ((0.0, -6.5e-3), (11e3, 0.0), (20e3, 1e-3), (32e3, 2.8e-3), (47e3, 0.0))

# Within this distance of its centre a line is a Voigt profile per layer; outside, two terms of its expansion.
VOIGT_REACH = 200.0  # 1/m


@dataclass(frozen=True)
class Layer:
    """One homogeneous layer: pressure_pa and temperature_k of the profile, air_column in molecules per m², vertical."""

    pressure_pa: float
    temperature_k: float
    air_column: float


def standard_temperature(pressure_pa: float) -> float:
    """Temperature in K of the US Standard Atmosphere 1976 at a pressure (isothermal above 47 km)."""
    base_pressure, base_temperature = SURFACE_PRESSURE_PA, 288.15
    for index, (height, gradient) in enumerate(_STRATA):
        last = index == len(_STRATA) - 1
        thickness = 0.0 if last else _STRATA[index + 1][0] - height
        top_temperature = base_temperature + gradient * thickness
        if gradient == 0.0:
            top_pressure = base_pressure * np.exp(-_G * thickness / (_R_SPECIFIC * base_temperature))
        else:
            top_pressure = base_pressure * (top_temperature / base_temperature) ** (-_G / (_R_SPECIFIC * gradient))
        if pressure_pa >= top_pressure or last:
            if gradient == 0.0:
                return base_temperature
            ratio = (pressure_pa / base_pressure) ** (-_R_SPECIFIC * gradient / _G)
            return float(base_temperature * ratio)
        base_pressure, base_temperature = float(top_pressure), top_temperature
    raise AssertionError("unreachable: the last stratum has no top")


def standard_atmosphere(layers: int = 8) -> tuple[Layer, ...]:
    """The US Standard Atmosphere 1976 in ``layers`` layers, bottom first.

    The edges are p = p0·(i/layers)², finer towards the top, where the cores of strong lines form; each layer has the
    mean pressure of its mass and the temperature at that pressure. Raises ValueError for layers < 1.
    """
    if layers < 1:
        raise ValueError(f"layers = {layers}: an atmosphere needs at least one layer")
    edges = SURFACE_PRESSURE_PA * (np.arange(layers, -1, -1) / layers) ** 2
    return tuple(
        Layer(
            pressure_pa=float((bottom + top) / 2),
            temperature_k=standard_temperature(float((bottom + top) / 2)),
            air_column=float((bottom - top) / (_G * _AIR_MASS_KG)),
        )
        for bottom, top in pairwise(edges)
    )


def doppler_sigma(lines: LineList, temperature_k: float) -> NDArray[np.float64]:
    """(L,) standard deviation of the Doppler profile in 1/m."""
    width: NDArray[np.float64] = lines.sigma * np.sqrt(BOLTZMANN * temperature_k / lines.mass_kg) / LIGHT_SPEED
    return width


def transmission(
    lines: LineList,
    sigma: NDArray[np.float64],
    air_mass: float = 2.0,
    atmosphere: tuple[Layer, ...] | None = None,
) -> NDArray[np.float64]:
    """(S,) transmission of the slant path at ascending vacuum wavenumbers ``sigma`` in 1/m, exp(−air_mass·τ_vertical).

    ``air_mass`` counts the whole path (sun to ground and ground to sensor). No line is cut off: beyond ``VOIGT_REACH``
    of its centre each is a/x² + b/x⁴ with its layers summed beforehand, whose relative error there is below
    (half-width/VOIGT_REACH)⁴, 1e-6 for lines under 6 1/m. Raises ValueError for a negative or non-finite air mass.
    """
    if not (np.isfinite(air_mass) and air_mass >= 0):
        raise ValueError(f"air_mass = {air_mass}: must be finite and ≥ 0")
    depth = optical_depth(lines, np.asarray(sigma, dtype=np.float64), atmosphere or standard_atmosphere())
    result: NDArray[np.float64] = np.exp(-air_mass * depth)
    return result


def column_mass(lines: LineList, atmosphere: tuple[Layer, ...]) -> float:
    """Mass of the absorber in a vertical column, kg/m²."""
    return lines.mass_kg * lines.mole_fraction * sum(layer.air_column for layer in atmosphere)


def optical_depth(lines: LineList, sigma: NDArray[np.float64], atmosphere: tuple[Layer, ...]) -> NDArray[np.float64]:
    """(S,) vertical optical depth at ascending wavenumbers ``sigma`` in 1/m."""
    column = np.array([layer.air_column * lines.mole_fraction for layer in atmosphere])[:, None]
    area = column * np.array([lines.strength_at(layer.temperature_k) for layer in atmosphere])  # (K, L)
    lorentz = np.array([lines.half_width_at(layer.temperature_k, layer.pressure_pa) for layer in atmosphere])
    doppler = np.array([doppler_sigma(lines, layer.temperature_k) for layer in atmosphere])

    # Voigt = γ/(π x²)·[1 + (3s² − γ²)/x² + O(x⁻⁴)], s the Doppler deviation: the layers add up in two numbers a line.
    second = np.sum(area * lorentz, axis=0) / np.pi
    fourth = np.sum(area * lorentz * (3 * doppler**2 - lorentz**2), axis=0) / np.pi
    depth = np.zeros_like(sigma)
    inverse = np.empty_like(sigma)
    for index in range(lines.sigma.size):
        first, last = np.searchsorted(sigma, lines.sigma[index] + np.array([-VOIGT_REACH, VOIGT_REACH]))
        for part in (slice(0, first), slice(last, None)):
            np.subtract(sigma[part], lines.sigma[index], out=inverse[part])
            np.multiply(inverse[part], inverse[part], out=inverse[part])
            np.reciprocal(inverse[part], out=inverse[part])
            depth[part] += inverse[part] * (second[index] + fourth[index] * inverse[part])
        offset = sigma[first:last] - lines.sigma[index]
        profile = voigt_profile(offset[None, :], doppler[:, index, None], lorentz[:, index, None])
        depth[first:last] += area[:, index] @ profile
    return depth
