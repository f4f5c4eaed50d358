"""The O2 A band, b¹Σg⁺ – X³Σg⁻ (0–0) of ¹⁶O2, line by line from molecular constants.

Lower levels: the 2 × 2 (F1, F3) and 1 × 1 (F2) blocks of the ³Σ Hamiltonian B N² − D N⁴ + ⅔λ(3S_z² − S²) + γ N·S
in Hund's case (b), with centrifugal distortion of every constant. Intensities: the magnetic-dipole moment of this band
joins Ω″ = ±1 to Ω′ = 0 only, so each line carries the Ω = 1 weight of its lower level. Only odd N″ exist (nuclear spin
0) and, in the upper state, only even J′.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.scene.lines import C2_M_K, REFERENCE_TEMPERATURE_K, LineList

_MHZ = 1e6 / 299_792_458.0  # 1 MHz in 1/m

# X³Σg⁻, v = 0: the values of Drouin et al., JQSRT 111, 1167 (2010), MHz.
_B, _D, _H = 43100.44276 * _MHZ, 145.1271e-3 * _MHZ, 49e-9 * _MHZ
_LAMBDA, _LAMBDA_D, _LAMBDA_H = 59501.3438 * _MHZ, 58.3680e-3 * _MHZ, 290.8e-9 * _MHZ
_GAMMA, _GAMMA_D, _GAMMA_H = -252.58634 * _MHZ, -243.42e-6 * _MHZ, -1.46e-9 * _MHZ

# b¹Σg⁺, v = 0: term value above the zero of the Hamiltonian below, B′, D′, H′. Least squares, made for this module,
# over the upper term values J′ ≤ 30 that the positions of Drouin et al., JQSRT 186, 118 (2017) give with the constants
# of X above (largest residual 2e-4 cm⁻¹). These four are no independent check of those positions; the lower terms, the
# separations of the branches and the intensities are.
_T_B, _B_B, _D_B, _H_B = 13122.25190e2, 1.39124764e2, 5.36341e-4, -7.174e-10

# Integrated band intensity at 296 K, 2.231(7)e-22 cm/molecule of ¹⁶O2: Long et al., JQSRT 111, 2021 (2010).
_BAND_STRENGTH = 2.231e-24
_ABUNDANCE_16O2 = 0.995262  # natural oxygen; the isotopologues left out carry 0.47 %
_MASS_KG = 31.98983 * 1.66053906660e-27
_MOLE_FRACTION = 0.20946
_VIBRATION = 1556.38e2  # v = 1 of X, 1/m (Huber and Herzberg 1979)
_ATM_PA = 101325.0
_J_MAX_PARTITION = 90


def _rotation(n: int) -> float:
    x = n * (n + 1)
    return _B * x - _D * x**2 + _H * x**3


def _spin_spin(n: int) -> float:
    x = n * (n + 1)
    return _LAMBDA + _LAMBDA_D * x + _LAMBDA_H * x**2


def _spin_rotation(n: int) -> float:
    x = n * (n + 1)
    return _GAMMA + _GAMMA_D * x + _GAMMA_H * x**2


def _coupled_levels(j: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Energies (2,) in 1/m and Ω = 1 weights (2,) of the levels N = J − 1 and N = J + 1, J ≥ 1."""
    m, p = j - 1, j + 1
    low = _rotation(m) - 2 / 3 * _spin_spin(m) * (j - 1) / (2 * j + 1) + _spin_rotation(m) * (j - 1)
    high = _rotation(p) - 2 / 3 * _spin_spin(p) * (j + 2) / (2 * j + 1) - _spin_rotation(p) * (j + 2)
    coupling = np.sqrt(j * (j + 1)) / (2 * j + 1) * (_spin_spin(m) + _spin_spin(p))
    energy, vectors = np.linalg.eigh(np.array([[low, coupling], [coupling, high]]))
    # |Ω = 1⟩ in the case (b) basis; its sign follows from λ > 0 raising Ω = 1 above Ω = 0.
    omega1 = np.sqrt(np.array([j + 1, j]) / (2 * j + 1))
    return energy, (omega1 @ vectors) ** 2


def lower_energy(n: int, j: int) -> float:
    """Energy in 1/m of the level (N, J) of X³Σg⁻, v = 0, above its lowest level that exists (N = 1, J = 0).

    Raises ValueError if N is even (forbidden by the nuclear spin of ¹⁶O) or J is not N − 1, N or N + 1.
    """
    if n % 2 == 0 or abs(n - j) > 1 or j < 0:
        raise ValueError(f"X³Σg⁻ of ¹⁶O2 has no level N = {n}, J = {j}: N is odd and |N − J| ≤ 1")
    return _level(n, j) - _level(1, 0)


def _level(n: int, j: int) -> float:
    if n == j:
        return _rotation(n) + 2 / 3 * _spin_spin(n) - _spin_rotation(n)
    if j == 0:
        return _rotation(1) - 4 / 3 * _spin_spin(1) - 2 * _spin_rotation(1)
    energy, _ = _coupled_levels(j)
    return float(energy[0] if n == j - 1 else energy[1])


@cache
def _partition_levels() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    levels = [(2 * j + 1, lower_energy(n, j)) for n in range(1, _J_MAX_PARTITION, 2) for j in (n - 1, n, n + 1)]
    weight, energy = np.array(levels).T
    return weight, energy


def partition_function(temperature_k: float) -> float:
    """Q(T) of ¹⁶O2: direct sum over the X³Σg⁻ levels of v = 0 times the harmonic vibrational factor.

    Measured from the lowest level. Left out: the a¹Δ state and the change of B with v, below 1e-4 under 320 K.
    """
    weight, energy = _partition_levels()
    vibration = 1 / -np.expm1(-C2_M_K * _VIBRATION / temperature_k)
    return float(vibration * np.sum(weight * np.exp(-C2_M_K * energy / temperature_k)))


def air_half_width(j: NDArray[np.int64]) -> NDArray[np.float64]:
    """Half-width in air at 296 K in 1/m per Pa, from a smooth function of the rotational quantum number.

    The rational form of Yang et al., JQSRT 90, 309 (2005), A + B/(1 + c1·J + c2·J² + c3·J⁴) in cm⁻¹/atm. It stays
    within 2 % of the widths that Drouin et al. (2017) list to four digits for J ≤ 24, and is 6 % above them at J = 28.
    """
    x = j.astype(np.float64)
    per_atm = 0.02204 + 0.03749 / (1 + 0.05428 * x - 1.19e-3 * x**2 + 2.073e-6 * x**4)
    width: NDArray[np.float64] = per_atm * 100 / _ATM_PA
    return width


def _branches(n: int) -> list[tuple[str, int, int, float]]:
    """(branch, J″, J′, Hönl–London factor) of the up to four lines that leave N″ = n (even J′ only).

    The factors are those of a perpendicular transition Ω″ = ±1 → Ω′ = 0: J″/2 for ΔJ = +1, (J″ + 1)/2 for −1 and
    (2J + 1)/2 for 0, times the Ω = 1 weight of the lower level (1 for N″ = J″, whose parity excludes Ω = 0).
    """
    lines = [("PP", n, n - 1, (n + 1) / 2), ("RR", n, n + 1, n / 2)]
    above = _coupled_levels(n + 1)[1][0]  # J = n + 1 is the lower of its pair
    lines.append(("RQ", n + 1, n + 1, (2 * n + 3) / 2 * above))
    if n > 1:  # J = 0 has no Ω = 1 part
        below = _coupled_levels(n - 1)[1][1]
        lines.append(("PQ", n - 1, n - 1, (2 * n - 1) / 2 * below))
    return lines


@cache
def oxygen_a_band(n_max: int = 45) -> LineList:
    """The A band of ¹⁶O2 up to N″ = ``n_max``: the branches PP, PQ, RR and RQ.

    Intensities per molecule of natural oxygen, scaled so that all lines add up to the published band intensity (n_max
    ≥ 41 holds all but 1e-5 of it). Left out, and below 1 % of the absorption together: other isotopologues, hot bands,
    quadrupole lines; also line mixing, Dicke narrowing, collision-induced absorption and the pressure shift (at most
    1.2 1/m per atm). The exponent n is a straight line through the values of Drouin et al. (2017) for N″ ≤ 23.
    """
    rows = [(branch, n, j, jp, factor) for n in range(1, n_max + 1, 2) for branch, j, jp, factor in _branches(n)]
    n_low = np.array([row[1] for row in rows])
    j_low = np.array([row[2] for row in rows])
    jp = np.array([row[3] for row in rows], dtype=np.float64)
    factor = np.array([row[4] for row in rows])
    energy = np.array([lower_energy(n, j) for _, n, j, _, _ in rows])
    x = jp * (jp + 1)
    sigma = _T_B - _level(1, 0) + _B_B * x - _D_B * x**2 + _H_B * x**3 - energy
    relative = sigma * factor * np.exp(-C2_M_K * energy / REFERENCE_TEMPERATURE_K)
    order = np.argsort(sigma)
    return LineList(
        branch=np.array([row[0] for row in rows])[order],
        n_lower=n_low[order],
        j_lower=j_low[order],
        sigma=sigma[order],
        strength=(relative * (_BAND_STRENGTH * _ABUNDANCE_16O2 / relative.sum()))[order],
        lower_energy=energy[order],
        half_width=air_half_width(j_low)[order],
        exponent=np.clip(0.847 - 0.0044 * n_low, 0.63, None)[order],
        mass_kg=_MASS_KG,
        mole_fraction=_MOLE_FRACTION,
        partition=partition_function,
        source="O2 A band computed from molecular constants (Drouin 2010, 2017; Long 2010; Yang 2005)",
    )
