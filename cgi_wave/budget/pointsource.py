"""Point-source side of a field point: spots, Eq. 4, and the overlap contrast γ of every ghost with the nominal beam."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.contrast import Nominal, contrast_of
from cgi_wave.budget.pointfields import nominal_fields
from cgi_wave.errors import CgiWaveError, EmptyBeamError
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.beams import Spot, spot
from cgi_wave.rays.paths import Path
from cgi_wave.wave.eq4 import contrast_eq4
from cgi_wave.wave.field import PupilField

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PointGhost:
    """One ghost as a point source makes it.

    spot: None if no ray of the source's direction arrives; eq4: Eq. 4; contrast, error: |γ| with the nominal beam of
    arm 1 and its bound, or None with the reason in ``method``; phase: arg γ with the path difference in it, rad.
    """

    path: Path
    spot: Spot | None
    eq4: float | None
    contrast: float | None
    error: float | None
    phase: float | None
    method: str


@dataclass(frozen=True)
class PointSource:
    """Nominal field and spot of source direction ``theta``, and each ghost's part; x0 (m): reference point."""

    theta: Array
    x0: Array
    nominal_spot: Spot
    nominal_field: PupilField
    ghosts: tuple[PointGhost, ...]


def point_source(system: OpticalSystem, paths: Sequence[Path], theta: Array, x0: Array, orders: int = 2) -> PointSource:
    """Spots and contrasts of ``paths[2:]`` against the nominal beam of arm 1 for one source direction, at σ0.

    Ghosts of more than ``orders`` parasitic reflections get their spot and Eq. 4 only.
    """
    nominal_spot = spot(system, paths[0], theta, system.sigma0)
    nominal = nominal_fields(system, paths[0], theta, x0)
    ghosts = [
        _ghost(system, path, theta, x0, nominal_spot, nominal if path.order <= orders else None) for path in paths[2:]
    ]
    return PointSource(theta, x0, nominal_spot, nominal(0.0), tuple(ghosts))


def _ghost(
    system: OpticalSystem,
    path: Path,
    theta: Array,
    x0: Array,
    near: Spot,
    nominal: Nominal | None,
) -> PointGhost:
    try:
        here = spot(system, path, theta, system.sigma0)
    except EmptyBeamError:
        return PointGhost(path, None, None, None, None, None, "no ray of this direction arrives")
    eq4 = contrast_eq4(near.rms[0], near.rms[1], here.rms[0], here.rms[1])
    if nominal is None:
        return PointGhost(path, here, eq4, None, None, None, "not asked for at this field point")
    try:
        found = contrast_of(system, path, theta, x0, nominal)
    except CgiWaveError as error:
        return PointGhost(path, here, eq4, None, None, None, f"none: {error}")
    value = found.value
    return PointGhost(path, here, eq4, abs(value), found.error, float(np.angle(value)), found.method)
