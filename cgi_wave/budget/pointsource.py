"""Point-source side of a field point: spots, Eq. 4, and the overlap contrast γ of every ghost with the nominal beam."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.fieldpoint import FIT_TARGET, pupil_samples
from cgi_wave.errors import CgiWaveError, EmptyBeamError, MethodLimitError
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.beams import Rays, Spot, rays_from_direction, spot
from cgi_wave.rays.charts import rays_from_points
from cgi_wave.rays.disc import NODES
from cgi_wave.rays.paths import Path
from cgi_wave.wave.eq4 import contrast_eq4
from cgi_wave.wave.field import DEGREES, FINE_DEGREES, PupilField, fit_field
from cgi_wave.wave.fold import check_map
from cgi_wave.wave.overlap import overlap
from cgi_wave.wave.overpupil import contrast_over_pupil

Array = NDArray[np.float64]

#: Rays for the few beams whose path no polynomial through the usual number describes, and the misfit, in rad, that
#: says so.
MORE_RAYS, BLURRED = 1600, 1e-2
#: Error asked of a contrast in the ghost table: where that of the direction-space field is larger, the ghost's pupil is
#: tried. A third of it each is asked of the fits and of the quadrature.
CONTRAST_TOLERANCE, SHARE = 1e-6, 0.3
#: Lit rays from which on their map to directions is looked at.
FEWEST_FOR_MAP = 60
#: Rays of a ghost's field that is good to that; how many more are tried, and up to which excess of the bound.
FINE_RAYS, FINER_RAYS, NEARLY = 400, 800, 10.0
#: Misfit of a field's phases, rad over the tolerance, beyond which its contrast is computed only if the ghost's pupil
#: is of no help.
HOPELESS = 100.0
#: Rays and misfit of the nominal field, which stands in every pair.
NOMINAL_RAYS, NOMINAL_TARGET = 1600, 1e-8


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


@dataclass(frozen=True)
class Contrast:
    """γ of a ghost with a nominal beam, the path difference in it; its bound; and how it was found."""

    value: complex
    error: float
    method: str


def direction_field(system: OpticalSystem, path: Path, theta: Array, x0: Array) -> PupilField:
    """Â(q) of ``path`` for source direction ``theta``, about the detector point ``x0``, at the filter's centre.

    Raises EmptyBeamError, FoldedFieldError (folded, or collimated at the detector), MethodLimitError.
    """
    try:
        field = _field(system, path, theta, x0, NODES, FIT_TARGET)
    except MethodLimitError:
        return _field(system, path, theta, x0, MORE_RAYS, FIT_TARGET)
    if 2.0 * np.pi * system.sigma0 * field.opl_residual <= BLURRED:
        return field
    try:
        finer = _field(system, path, theta, x0, MORE_RAYS, FIT_TARGET)
    except CgiWaveError:  # a map at the edge of what has a field: more rays find its worst place, and no better field
        return field
    return finer if finer.opl_residual < field.opl_residual else field


def fine_field(
    system: OpticalSystem,
    path: Path,
    theta: Array,
    x0: Array,
    tolerance: float = CONTRAST_TOLERANCE,
    count: int = FINE_RAYS,
) -> PupilField:
    """As ``direction_field``, by as many rays and as high a degree as a contrast good to ``tolerance`` asks for."""
    return _field(system, path, theta, x0, count, SHARE * tolerance, degrees=FINE_DEGREES)


def chart_field(system: OpticalSystem, path: Path, theta: Array, x0: Array, bend: float = 0.0) -> PupilField:
    """The nominal beam's field as finely as contrasts ask for, in the chart of ``bend``, 1/m (``rays.charts``)."""
    return _field(system, path, theta, x0, NOMINAL_RAYS, NOMINAL_TARGET, bend, FINE_DEGREES)


def _field(
    system: OpticalSystem,
    path: Path,
    theta: Array,
    x0: Array,
    count: int,
    target: float,
    bend: float = 0.0,
    degrees: Sequence[int] = DEGREES,
) -> PupilField:
    rays = rays_from_direction(system, path, theta, x0, np.array([system.sigma0]), count, bend)
    return field_of(system, path, rays, x0, target, bend, degrees)


def field_of(
    system: OpticalSystem,
    path: Path,
    rays: Rays,
    x0: Array,
    target: float = SHARE * CONTRAST_TOLERANCE,
    bend: float = 0.0,
    degrees: Sequence[int] = FINE_DEGREES,
) -> PupilField:
    """The field of rays of one source direction, traced about x0 in the chart of ``bend``, if their map has one."""
    lit = (rays.clearance[:, 0] > 0).all(axis=0)
    if lit.sum() >= FEWEST_FOR_MAP:
        check_map(rays.pupil[0][lit], rays.u[0][lit], system.sigma0, path.label)
    samples = pupil_samples(rays, path, "direction", np.array([system.sigma0]), x0, bend)
    return fit_field(samples, target=target, degrees=degrees)


def without_directions(system: OpticalSystem, paths: Sequence[Path], theta: Array, x0: Array) -> dict[str, str]:
    """Labels of the ghosts whose rays have no field over direction cosines, with the reason: what a plan can say.

    By the map of rays alone; of fits that turn out too coarse it knows nothing.
    """
    reasons: dict[str, str] = {}
    for path in paths:
        try:
            rays = rays_from_direction(system, path, theta, x0, np.array([system.sigma0]))
            lit = (rays.clearance[:, 0] > 0).all(axis=0)
            if lit.sum() >= FEWEST_FOR_MAP:
                check_map(rays.pupil[0][lit], rays.u[0][lit], system.sigma0, path.label)
        except CgiWaveError as limit:
            reasons[path.label] = str(limit).removeprefix(f"{path.label}: ")
    return reasons


@dataclass(frozen=True)
class OverDirections:
    """What a ghost's field over direction cosines gave: γ, or ``why`` there is none; ``rough``: the field, where it
    misses phases by so much that its γ says little."""

    contrast: Contrast | None
    rough: PupilField | None
    why: str


def over_directions(
    field: Callable[[], PupilField], nominal: Callable[[float], PupilField], tolerance: float = CONTRAST_TOLERANCE
) -> OverDirections:
    """γ by a ghost's field over direction cosines, unless that is refused or of little use; see ``contrast_of``."""
    try:
        ghost = field()
        missed = 2.0 * np.pi * float(ghost.sigma[ghost.sigma.size // 2]) * ghost.opl_residual
        if missed > HOPELESS * tolerance:
            return OverDirections(None, ghost, f"phases missed by {missed:.1e} rad over directions")
        here = direction_contrast(ghost, nominal(0.0), SHARE * tolerance)
    except CgiWaveError as limit:
        return OverDirections(None, None, str(limit))
    return OverDirections(here, None, f"bound {here.error:.1e} over directions")


def contrast_of(
    system: OpticalSystem,
    path: Path,
    theta: Array,
    x0: Array,
    nominal: Callable[[float], PupilField],
    tolerance: float = CONTRAST_TOLERANCE,
    first: OverDirections | None = None,
) -> Contrast:
    """γ of ``path`` for source direction ``theta``, to ``tolerance`` where that can be had.

    nominal: the nominal beam's field in the chart of a bend, 1/m. By the ghost's field over direction cosines; where
    there is none, or one that leaves more than ``tolerance`` open, over the ghost's own pupil, and the better of the
    two is kept. In a bent chart the error holds by how much others differ. first: what the field of FINE_RAYS rays
    gave, if that is known.

    Raises EmptyBeamError, FoldedFieldError, MethodLimitError: what either way refused.
    """
    sigma0, share = system.sigma0, SHARE * tolerance
    if first is None:
        first = over_directions(partial(fine_field, system, path, theta, x0, tolerance), nominal, tolerance)
    found, rough, why = first.contrast, first.rough, first.why
    if found is not None and tolerance < found.error <= NEARLY * tolerance:
        more = over_directions(partial(fine_field, system, path, theta, x0, tolerance, FINER_RAYS), nominal, tolerance)
        rough, why = more.rough, more.why
        if more.contrast is not None and more.contrast.error < found.error:
            found = more.contrast
    if found is not None and found.error <= tolerance:
        return found
    trace = partial(rays_from_points, system, path, theta, x0, sigma0)
    over = refused = None
    try:
        over = contrast_over_pupil(trace, system.pupil_radius, nominal, sigma0, path.label, share)
    except CgiWaveError as limit:
        refused = limit
    if found is None and rough is not None and (over is None or over.error + over.charts > tolerance):
        try:
            found = direction_contrast(rough, nominal(0.0), share)
        except CgiWaveError as limit:
            why = str(limit)
    if over is None:
        if found is None:
            raise refused or MethodLimitError("contrast", why, 1.0, "trace more rays")
        return found
    error = over.error + over.charts
    if found is not None and found.error <= error:
        return found
    parts = f"{over.parts} part{'s' if over.parts > 1 else ''}"
    how = f"over the ghost's pupil in {parts} ({why})"
    if over.bend:
        how = (
            f"over the ghost's pupil in {parts}, lens of {over.bend:.3g} 1/m on the detector ({over.note}; numerical "
            f"bound {over.error:.1e}, charts differ by {over.charts:.1e})"
        )
    return Contrast(over.value, error, how)


def direction_contrast(ghost: PupilField, nominal: PupilField, tol: float) -> Contrast:
    """γ of two fields over direction cosines at their σ; tol: numerical error allowed. Raises MethodLimitError."""
    sigma = nominal.sigma[[nominal.sigma.size // 2]]
    pair = overlap(ghost, nominal, sigma, tol)
    turned = complex(pair.value[0] * np.exp(2j * np.pi * sigma[0] * pair.opd_m[0]))
    return Contrast(turned, float(pair.error_bound[0]), pair.method)


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


def nominal_fields(system: OpticalSystem, path: Path, theta: Array, x0: Array) -> Callable[[float], PupilField]:
    """The nominal beam's field by the bend of its chart, each made once."""

    @lru_cache(maxsize=32)
    def field(bend: float) -> PupilField:
        return chart_field(system, path, theta, x0, bend)

    return field


def _ghost(
    system: OpticalSystem,
    path: Path,
    theta: Array,
    x0: Array,
    near: Spot,
    nominal: Callable[[float], PupilField] | None,
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
