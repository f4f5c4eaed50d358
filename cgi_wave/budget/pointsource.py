"""Point-source side of a field point: spots, Eq. 4, and the overlap contrast γ of every ghost with the nominal beam."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.fieldpoint import FIT_TARGET, pupil_samples
from cgi_wave.errors import CgiWaveError, EmptyBeamError, MethodLimitError
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.beams import Spot, rays_from_direction, spot
from cgi_wave.rays.disc import NODES
from cgi_wave.rays.paths import Path
from cgi_wave.wave.eq4 import contrast_eq4
from cgi_wave.wave.field import PupilField, fit_field
from cgi_wave.wave.fold import check_map
from cgi_wave.wave.overlap import overlap

Array = NDArray[np.float64]

#: Rays for the few beams whose path no polynomial through the usual number describes, and the misfit, in rad, that
#: says so.
MORE_RAYS, BLURRED = 1600, 1e-2
#: Numerical error asked of a contrast in the ghost table.
CONTRAST_TOLERANCE = 1e-5


@dataclass(frozen=True)
class PointGhost:
    """One ghost as a point source makes it.

    spot: None if no ray of the source's direction arrives; eq4: Eq. 4; contrast, error: |γ| with the nominal beam of
    arm 1 and its bound, or None with the reason in ``method``; phase: arg γ with the path difference left out, rad.
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


def direction_field(system: OpticalSystem, path: Path, theta: Array, x0: Array) -> PupilField:
    """Â(q) of ``path`` for source direction ``theta``, about the detector point ``x0``, at the filter's centre.

    Raises EmptyBeamError, FoldedFieldError (folded, or collimated at the detector), MethodLimitError.
    """
    sigma = np.array([system.sigma0])
    try:
        field = _field(system, path, theta, x0, sigma, NODES)
    except MethodLimitError:
        return _field(system, path, theta, x0, sigma, MORE_RAYS)
    if 2.0 * np.pi * system.sigma0 * field.opl_residual <= BLURRED:
        return field
    try:
        finer = _field(system, path, theta, x0, sigma, MORE_RAYS)
    except CgiWaveError:  # a map at the edge of what has a field: more rays find its worst place, and no better field
        return field
    return finer if finer.opl_residual < field.opl_residual else field


def _field(system: OpticalSystem, path: Path, theta: Array, x0: Array, sigma: Array, count: int) -> PupilField:
    rays = rays_from_direction(system, path, theta, x0, sigma, count)
    lit = (rays.clearance[:, 0] > 0).all(axis=0)
    if lit.sum() >= 60:
        check_map(rays.pupil[0][lit], rays.u[0][lit], system.sigma0, path.label)
    return fit_field(pupil_samples(rays, path, "direction", sigma, x0), target=FIT_TARGET)


def point_source(system: OpticalSystem, paths: Sequence[Path], theta: Array, x0: Array, orders: int = 2) -> PointSource:
    """Spots and contrasts of ``paths[2:]`` against the nominal beam of arm 1 for one source direction, at σ0.

    Ghosts of more than ``orders`` parasitic reflections get their spot and Eq. 4 only.
    """
    sigma0 = system.sigma0
    nominal_spot = spot(system, paths[0], theta, sigma0)
    nominal = direction_field(system, paths[0], theta, x0)
    ghosts = [
        _ghost(system, path, theta, x0, nominal_spot, nominal if path.order <= orders else None) for path in paths[2:]
    ]
    return PointSource(theta, x0, nominal_spot, nominal, tuple(ghosts))


def _ghost(
    system: OpticalSystem, path: Path, theta: Array, x0: Array, near: Spot, nominal: PupilField | None
) -> PointGhost:
    try:
        here = spot(system, path, theta, system.sigma0)
    except EmptyBeamError:
        return PointGhost(path, None, None, None, None, None, "no ray of this direction arrives")
    eq4 = contrast_eq4(near.rms[0], near.rms[1], here.rms[0], here.rms[1])
    if nominal is None:
        return PointGhost(path, here, eq4, None, None, None, "not asked for at this field point")
    try:
        field = direction_field(system, path, theta, x0)
        found = overlap(field, nominal, np.array([system.sigma0]), CONTRAST_TOLERANCE)
    except CgiWaveError as error:
        return PointGhost(path, here, eq4, None, None, None, f"none: {error}")
    value = complex(found.value[0])
    return PointGhost(path, here, eq4, abs(value), float(found.error_bound[0]), float(np.angle(value)), found.method)
