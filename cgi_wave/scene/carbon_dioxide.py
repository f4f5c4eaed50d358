"""Four bands of ¹²C¹⁶O2 near 1.6 and 2.0 µm, line by line from molecular constants.

A linear molecule without electronic angular momentum: levels B·J(J + 1) − D·[J(J + 1)]² + H·[J(J + 1)]³, parallel
bands with P and R branches, Hönl–London factors |m| (m = −J″ in P, J″ + 1 in R). The ¹⁶O nuclei have no spin: only even
J″ exist in the ground state.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.scene.lines import C2_M_K, REFERENCE_TEMPERATURE_K, LineList

# Ground state, 1/m.
_B, _D = 0.39021894e2, 1.3337e-5

_MASS_KG = 43.98983 * 1.66053906660e-27
_MOLE_FRACTION = 400e-6
_ATM_PA = 101325.0
#: Fundamentals (1/m) and their degeneracies; the stretch is the mean of its Fermi pair.
_VIBRATIONS = ((667.38e2, 2), (1336.8e2, 1), (2349.14e2, 1))
_J_MAX_PARTITION = 300


@dataclass(frozen=True)
class Band:
    """A band from the ground state: origin, B′, D′, H′ (1/m), intensity at 296 K per molecule of natural CO2 (m).

    tilt, bend: Herman–Wallis factor (1 + tilt·m + bend·m²)².
    """

    origin: float
    b: float
    strength: float
    d: float = _D
    h: float = 0.0
    tilt: float = 0.0
    bend: float = 0.0


#: 30012: least squares, made for this module, over the positions (J′ ≤ 60, largest residual 6e-5 cm⁻¹) and intensities
#: of the HITRAN-derived list in the NIST MATS repository; it is no independent check of them. The others: established
#: origins and B′, with D′ = D″ (an error of 0.02 cm⁻¹ at J = 30), and band intensities from memory, rounded to two
#: digits: no list was at hand to compare them with.
BANDS = {
    "30013": Band(6227.917e2, 0.386713e2, 4.4e-24),
    "30012": Band(6347.85088e2, 0.386455097e2, 4.489e-24, 9.83675e-6, 6.0096e-11, 2.808e-4, -1.542e-5),
    "20013": Band(4853.623e2, 0.386618e2, 7.8e-23),
    "20012": Band(4977.835e2, 0.386480e2, 3.5e-22),
}


def lower_energy(j: NDArray[np.int64]) -> NDArray[np.float64]:
    """Energy in 1/m of the rotational levels J of the ground state."""
    x = j * (j + 1.0)
    energy: NDArray[np.float64] = _B * x - _D * x**2
    return energy


def partition_function(temperature_k: float) -> float:
    """Q(T) of ¹²C¹⁶O2: sum over even J times harmonic vibrational factors."""
    j = np.arange(0, _J_MAX_PARTITION, 2)
    rotation = np.sum((2 * j + 1) * np.exp(-C2_M_K * lower_energy(j) / temperature_k))
    vibration = np.prod([np.expm1(-C2_M_K * v / temperature_k) ** g for v, g in _VIBRATIONS])
    return float(rotation / abs(vibration))


def air_half_width(m: NDArray[np.int64]) -> NDArray[np.float64]:
    """Half-width in air at 296 K, 1/m per Pa, for |m|: a smooth function drawn through the list's values for 30012.

    Within 3 % of them for 2 ≤ |m| ≤ 56; the vibrational dependence of widths (1 %) is left out.
    """
    width: NDArray[np.float64] = (0.0655 + 0.0225 * np.exp(-np.abs(m) / 20.0)) * 100 / _ATM_PA
    return width


@cache
def carbon_dioxide(j_max: int = 70) -> LineList:
    """All four bands up to J″ = ``j_max``, sorted; branches are named like ``"30012 R"``, N″ = J″.

    Intensities per molecule of natural CO2, each band's lines adding up to its band intensity. Left out: other
    isotopologues and hot bands (8 % of the absorption near 30012), line mixing, pressure shifts (0.007 cm⁻¹ per atm).
    """
    j = np.arange(0, j_max + 1, 2)
    parts = []
    for name, band in BANDS.items():
        low = np.concatenate([j[1:], j])  # P(0) does not exist
        m = np.concatenate([-j[1:], j + 1])
        x = np.where(m < 0, low - 1, low + 1) * (np.where(m < 0, low - 1, low + 1) + 1.0)
        energy = lower_energy(low)
        sigma = band.origin + band.b * x - band.d * x**2 + band.h * x**3 - energy
        moment = np.abs(m) * (1 + band.tilt * m + band.bend * m**2) ** 2
        relative = sigma * moment * np.exp(-C2_M_K * energy / REFERENCE_TEMPERATURE_K)
        branch = np.array([f"{name} {'P' if k < 0 else 'R'}" for k in m])
        parts.append((branch, low, sigma, relative * band.strength / relative.sum(), energy, air_half_width(m)))
    branch, low, sigma, strength, energy, width = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(sigma)
    return LineList(
        branch=branch[order],
        n_lower=low[order],
        j_lower=low[order],
        sigma=sigma[order],
        strength=strength[order],
        lower_energy=energy[order],
        half_width=width[order],
        exponent=np.full(sigma.size, 0.72),
        mass_kg=_MASS_KG,
        mole_fraction=_MOLE_FRACTION,
        partition=partition_function,
        source="CO2 computed from molecular constants, 400 ppm",
    )
