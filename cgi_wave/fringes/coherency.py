"""The payload between waves and fringes: powers and mutual coherence of all beams of one field point."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Pair:
    """Mutual coherence of beams m and l at S wavenumbers.

    The pair's part of the irradiance at detector coordinate y (measured from the field point, along the OPD axis) is
    Σ_σ I0(σ) · 2√(t_m t_l) · Re[gamma(σ) · exp(i 2πσ (opd_m(σ) + slope·y))]   (Eq. 2 with a complex contrast).

    m, l : indices into ``Coherency.labels``
    sigma : (S,) 1/m, Chebyshev nodes over the band's spectral range, ascending
    gamma : (S,) complex, |gamma| ≤ 1, slowly varying in σ
    error : (S,) absolute bound on the error of gamma
    opd_m : (S,) m, phase OPD at each σ (group OPD follows from its variation with σ)
    slope : dOPD/dy, dimensionless
    method : name of the method that produced gamma
    """

    m: int
    l: int  # noqa: E741  (the paper's symbol)
    sigma: NDArray[np.float64]
    gamma: NDArray[np.complex128]
    error: NDArray[np.float64]
    opd_m: NDArray[np.float64]
    slope: float
    method: str


@dataclass(frozen=True)
class LeftOut:
    """A pair that was not computed, with the bound of what it could add to the modulation (relative to M).

    frequency : of the pair's fringes along y, as a share of the nominal fringe frequency; NaN if it is not known
    """

    m: int
    l: int  # noqa: E741
    bound: float
    reason: str
    frequency: float = float("nan")


@dataclass(frozen=True)
class Coherency:
    """All beams of one field point: labels[0] and labels[1] are the nominal beams of arms 1 and 2.

    labels : B path labels
    family : (B,) int, equal for beams with the same parasitic history (the nominals are family 0)
    order : (B,) int, number of parasitic reflections
    transmission : (B,) power of each beam relative to the input (vignetting included)
    transmission_error : (B,) absolute error of each; empty where it is nil
    """

    labels: tuple[str, ...]
    family: NDArray[np.int64]
    order: NDArray[np.int64]
    transmission: NDArray[np.float64]
    pairs: tuple[Pair, ...]
    left_out: tuple[LeftOut, ...] = field(default=())
    transmission_error: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
