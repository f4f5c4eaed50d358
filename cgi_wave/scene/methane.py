"""The 2ν3 band of ¹²CH4 near 1.66 µm from molecular constants: crude, made for where its lines stand.

A spherical top with a Coriolis constant: branches ν0 + a·m + b·m² with m = J″ + 1 in R and −J″ in P, Q at
ν0 + b·J(J + 1); a = B′ + B″ − 2B′ζ, b = B′ − B″. Every J is one line: the tetrahedral splitting (0.02 cm⁻¹ at J = 3,
0.13 cm⁻¹ at J = 6, where a line's own width in air at the ground is 0.12 cm⁻¹) is left out.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.scene.lines import C2_M_K, REFERENCE_TEMPERATURE_K, LineList

# B″, B′ and the effective ν0 and ζ that put the R branch where the R(3), R(4) and R(6) manifolds are found, 6046.95,
# 6057.09 and 6077.0 cm⁻¹; ν0 is 0.4 cm⁻¹ off the band's true origin, which higher terms would make up for.
_B, _B_UPPER, _ORIGIN, _ZETA = 5.241e2, 5.178e2, 6005.12e2, -0.0280
#: At 296 K per molecule of natural methane, m; rounded, such that R(3) carries 3.2e-21 cm.
_BAND_STRENGTH = 9.0e-22
_MASS_KG = 16.0313 * 1.66053906660e-27
_MOLE_FRACTION = 1.87e-6
_ATM_PA = 101325.0
_HALF_WIDTH, _EXPONENT = 0.060e2 / _ATM_PA, 0.75
#: Fundamentals (1/m) and their degeneracies.
_VIBRATIONS = ((1310.8e2, 3), (1533.3e2, 2), (2916.5e2, 1), (3019.5e2, 3))


def lower_energy(j: NDArray[np.int64]) -> NDArray[np.float64]:
    """Energy in 1/m of the rotational levels J of the ground state, a rigid spherical top."""
    energy: NDArray[np.float64] = _B * j * (j + 1.0)
    return energy


def partition_function(temperature_k: float) -> float:
    """Q(T) up to a factor: sum of (2J + 1)² over the levels, mean spin weights, harmonic vibrations."""
    j = np.arange(60)
    rotation = np.sum((2 * j + 1) ** 2 * np.exp(-C2_M_K * lower_energy(j) / temperature_k))
    vibration = np.prod([-np.expm1(-C2_M_K * v / temperature_k) for v, g in _VIBRATIONS for _ in range(g)])
    return float(rotation / vibration)


@cache
def methane(j_max: int = 18) -> LineList:
    """Branches P, Q and R of 2ν3 up to J″ = ``j_max``.

    Shares of (2J + 1)² are (2J − 1)(2J + 1)/3, (2J + 1)²/3 and (2J + 1)(2J + 3)/3. Left out: everything else that
    absorbs there (other bands of methane carry a fifth of the absorption, water vapour more in a moist atmosphere),
    splittings, line mixing, shifts. Use it for the OPD of the rise, not for its height.
    """
    j = np.arange(j_max + 1)
    low = np.concatenate([j[1:], j[1:], j])
    branch = np.repeat(["P", "Q", "R"], [j_max, j_max, j_max + 1])
    a, b = _B_UPPER + _B - 2 * _B_UPPER * _ZETA, _B_UPPER - _B
    m = np.where(branch == "P", -low, low + 1)
    sigma = _ORIGIN + np.where(branch == "Q", b * low * (low + 1), a * m + b * m**2)
    ends = np.select([branch == "P", branch == "Q"], [2 * low - 1, 2 * low + 1], 2 * low + 3)
    energy = lower_energy(low)
    relative = sigma * (2 * low + 1) * ends * np.exp(-C2_M_K * energy / REFERENCE_TEMPERATURE_K)
    order = np.argsort(sigma)
    return LineList(
        branch=branch[order],
        n_lower=low[order],
        j_lower=low[order],
        sigma=sigma[order],
        strength=(relative * (_BAND_STRENGTH / relative.sum()))[order],
        lower_energy=energy[order],
        half_width=np.full(sigma.size, _HALF_WIDTH),
        exponent=np.full(sigma.size, _EXPONENT),
        mass_kg=_MASS_KG,
        mole_fraction=_MOLE_FRACTION,
        partition=partition_function,
        source="CH4 2ν3 computed from molecular constants, one line per J, 1.87 ppm",
    )
