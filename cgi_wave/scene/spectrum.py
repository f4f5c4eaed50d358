"""The payload between scene and fringes: a spectral radiance on a uniform wavenumber grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Spectrum:
    """Spectral radiance L(σ) at the top of the atmosphere.

    sigma : (S,) vacuum wavenumbers in 1/m, uniform, ascending
    radiance : (S,) W m⁻² sr⁻¹ per (1/m)
    source : one line that says where it comes from and what is assumed
    """

    sigma: NDArray[np.float64]
    radiance: NDArray[np.float64]
    source: str
