"""The payload between rays and waves: samples of one beam's field over a two-dimensional pupil coordinate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Space = Literal["direction", "pupil"]


@dataclass(frozen=True)
class PupilSamples:
    """Traced samples of one beam (one path, one field point), at S wavenumbers and N rays.

    ``space`` says what the coordinate u is:

    * ``"direction"`` (point source): u = q, the direction cosines at the detector; ``opl`` is
      Λ − q·(x − x0) about the reference point x0, so that ∫Â_m Â_l* d²q is the overlap of two PSFs.
      With ``bend`` b (1/m) other than 0, u = q − b (x − x0) instead, both beams seen through one thin lens on the
      detector (``rays.charts``); ``opl`` is about u, and the overlap of a pair is the same for every b.
    * ``"pupil"`` (uniform scene, fixed detector point x0): u = p, the point of the entrance pupil in metres;
      ``opl`` is the point-to-point Λ(p; x0) and ∫G_m G_l* d²p is the mutual intensity at x0.

    Shapes and units
    ----------------
    u : (S, N, 2), dimensionless (q) or m (p)
    sigma : (S,) vacuum wavenumbers, 1/m, ascending
    opl : (S, N) m, positive along the ray (field phase exp(+i 2πσ·opl))
    amplitude : (S, N), ≥ 0, with the Jacobian and the coatings' power in it: ∫ amplitude² d²u is the power
    clearance : (K, S, N) signed clearance of each of the K apertures that can cut this beam, > 0 inside,
        dimensionless and smooth in u; the support is where all K are positive. K ≥ 1.
    direction : (S, N, 2) direction cosines (x, y) at the detector; equal to u in direction space with bend 0
    phase : constant phase of the path in rad (coatings, splitter, Maslov)
    reference_point : (2,) detector coordinates x0 in m
    """

    label: str
    space: Space
    u: NDArray[np.float64]
    sigma: NDArray[np.float64]
    opl: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    clearance: NDArray[np.float64]
    direction: NDArray[np.float64]
    phase: float
    reference_point: tuple[float, float]
    bend: float = 0.0
