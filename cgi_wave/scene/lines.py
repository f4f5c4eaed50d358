"""Spectral lines of one absorber, as any line-by-line sum needs them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

REFERENCE_TEMPERATURE_K = 296.0
C2_M_K = 1.438776877e-2  # second radiation constant hc/k (CODATA 2018, exact)


@dataclass(frozen=True)
class LineList:
    """L lines of one molecule, sorted by position, SI units throughout.

    branch : (L,) label such as ``"PQ"`` (ΔN then ΔJ)
    n_lower, j_lower : (L,) rotational quantum numbers N″ and J″
    sigma : (L,) positions, 1/m, vacuum
    strength : (L,) line intensity at 296 K per molecule, m (1 cm = 0.01 m); says in ``source`` for which isotopic mix
    lower_energy : (L,) 1/m above the ground level
    half_width : (L,) air-broadened half-width at half maximum at 296 K, 1/m per Pa
    exponent : (L,) n of half_width·(296 K/T)^n
    mass_kg : mass of one molecule
    mole_fraction : of the molecule in dry air
    partition : Q(T), any common factor
    source : where the numbers are from
    """

    branch: NDArray[np.str_]
    n_lower: NDArray[np.int64]
    j_lower: NDArray[np.int64]
    sigma: NDArray[np.float64]
    strength: NDArray[np.float64]
    lower_energy: NDArray[np.float64]
    half_width: NDArray[np.float64]
    exponent: NDArray[np.float64]
    mass_kg: float
    mole_fraction: float
    partition: Callable[[float], float]
    source: str

    def near(self, low: float, high: float) -> LineList:
        """The lines whose positions lie between two wavenumbers, 1/m."""
        kept = (self.sigma >= low) & (self.sigma <= high)
        values: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        values |= {name: value[kept] for name, value in values.items() if isinstance(value, np.ndarray)}
        return LineList(**values)

    def strength_at(self, temperature_k: float) -> NDArray[np.float64]:
        """(L,) intensity in m per molecule at T: Boltzmann factor, partition function, stimulated emission."""
        t, t0 = temperature_k, REFERENCE_TEMPERATURE_K
        boltzmann = np.exp(-C2_M_K * self.lower_energy * (1 / t - 1 / t0))
        emission = np.expm1(-C2_M_K * self.sigma / t) / np.expm1(-C2_M_K * self.sigma / t0)
        scaled: NDArray[np.float64] = self.strength * boltzmann * emission * (self.partition(t0) / self.partition(t))
        return scaled

    def half_width_at(self, temperature_k: float, pressure_pa: float) -> NDArray[np.float64]:
        """(L,) Lorentz half-width at half maximum in 1/m."""
        ratio = REFERENCE_TEMPERATURE_K / temperature_k
        width: NDArray[np.float64] = self.half_width * pressure_pa * ratio**self.exponent
        return width
