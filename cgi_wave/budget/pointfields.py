"""Fields of one source direction's beams over direction cosines at the detector, or in a bent chart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.fieldpoint import FIT_TARGET, pupil_samples
from cgi_wave.errors import CgiWaveError, EmptyBeamError, MethodLimitError
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.beams import Rays, rays_from_direction
from cgi_wave.rays.charts import rays_from_points
from cgi_wave.rays.clearances import bounding_rows, limiting
from cgi_wave.rays.disc import NODES
from cgi_wave.rays.paths import Path
from cgi_wave.wave.field import DEGREES, FINE_DEGREES, PupilField, fit_field, power
from cgi_wave.wave.fold import check_map
from cgi_wave.wave.pupilfields import PowerRays, own_field

Array = NDArray[np.float64]

#: Rays for the few beams whose path no polynomial through the usual number describes, and the misfit, in rad, that
#: says so.
MORE_RAYS, BLURRED = 1600, 1e-2
#: Lit rays from which on their map to directions is looked at.
FEWEST_FOR_MAP = 60
#: Error asked of a contrast in the ghost table; a third of it each is asked of the fits and of the quadrature.
CONTRAST_TOLERANCE, SHARE = 1e-6, 0.3
#: Rays of a ghost's field that is good to that.
FINE_RAYS = 400
#: Spacings of N rays, 1/√N of what they fill, by which light may go on between or beyond them.
BETWEEN = 2.0
#: Rays and misfit of the nominal field, which stands in every pair.
NOMINAL_RAYS, NOMINAL_TARGET = 1600, 1e-8


@dataclass(frozen=True)
class GhostField:
    """A ghost's field over direction cosines, in the whole plane of the detector.

    caught: share of its power that lands on the detector, and ``off``, how far that may be off as a share of itself.
    """

    field: PupilField
    caught: float
    off: float


def direction_field(system: OpticalSystem, path: Path, theta: Array, x0: Array) -> PupilField:
    """Â(q) of ``path`` for source direction ``theta``, about the detector point ``x0``, at the filter's centre.

    Of the rays that land on the detector. Raises EmptyBeamError, FoldedFieldError (folded, or collimated at the
    detector), MethodLimitError.
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


def chart_field(system: OpticalSystem, path: Path, theta: Array, x0: Array, bend: float = 0.0) -> PupilField:
    """The nominal beam's field as finely as contrasts ask for, in the chart of ``bend``, 1/m (``rays.charts``)."""
    return _field(system, path, theta, x0, NOMINAL_RAYS, NOMINAL_TARGET, bend, FINE_DEGREES)


def nominal_fields(system: OpticalSystem, path: Path, theta: Array, x0: Array) -> Callable[[float], PupilField]:
    """The nominal beam's field by the bend of its chart, each made once."""

    @lru_cache(maxsize=32)
    def field(bend: float) -> PupilField:
        return chart_field(system, path, theta, x0, bend)

    return field


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
    target: float,
    bend: float = 0.0,
    degrees: Sequence[int] = FINE_DEGREES,
) -> PupilField:
    """The field of rays of one source direction, traced about x0 in the chart of ``bend``, if their map has one."""
    lit = (rays.clearance[:, 0] > 0).all(axis=0)
    if lit.sum() >= FEWEST_FOR_MAP:
        check_map(rays.pupil[0][lit], rays.u[0][lit], system.sigma0, path.label)
    samples = pupil_samples(rays, path, "direction", np.array([system.sigma0]), x0, bend)
    return fit_field(samples, target=target, degrees=degrees)


def fine_rays(system: OpticalSystem, path: Path, theta: Array, x0: Array, count: int = FINE_RAYS) -> Rays:
    """Rays of a ghost for its contrasts: also those that miss the detector in its plane. Raises EmptyBeamError.

    The overlap with a beam focused on the detector does not end at the edge of the detector, where that beam has no
    light; an edge in the ghost's directions that is none in the pair would add light diffracted at it.
    """
    return rays_from_direction(system, path, theta, x0, np.array([system.sigma0]), count, beyond=True)


def fine_field(
    system: OpticalSystem, path: Path, theta: Array, x0: Array, rays: Rays, tolerance: float = CONTRAST_TOLERANCE
) -> GhostField:
    """A ghost's field by ``fine_rays``, as good as a contrast good to ``tolerance`` asks for.

    Raises EmptyBeamError (no ray lands on the detector), FoldedFieldError, MethodLimitError.
    """
    lit = (rays.clearance[:, 0] > 0).all(axis=0)
    caught: NDArray[np.bool_] = lit & np.all(rays.catch[:, 0] > 0, axis=0)
    if not caught.any():
        raise EmptyBeamError(f"{path.label}: no ray that passes all apertures lands on the detector")
    p = rays.pupil[0]
    rays = replace(rays, clearance=limiting(rays.clearance, p))
    share = float(caught.sum() / lit.sum())
    field = field_of(system, path, rays, x0, SHARE * tolerance * np.sqrt(share))
    edge = rays.catch[:, 0, lit]
    # Between rays, and between these and the edge of the light, a clearance goes on by what it changes from ray to ray.
    if not len(edge) or (edge.min(axis=1) > BETWEEN / np.sqrt(lit.sum()) * np.ptp(edge, axis=1)).all():
        return GhostField(field, 1.0, 0.0)
    clearance = np.concatenate([rays.clearance[:, 0], rays.catch[:, 0]])
    rows = bounding_rows(clearance, p)
    if rows.max() < len(rays.clearance):
        return GhostField(field, 1.0, 0.0)
    trace = partial(rays_from_points, system, path, theta, x0, system.sigma0)
    known = PowerRays(p, rays.coating[0], clearance[rows], rays.direction[0])
    own = own_field(trace, known, caught, path.label, tolerance)
    (whole, off), (mine, mine_off) = power(field), power(own)
    return GhostField(field, float(mine[0] / whole[0]), off + mine_off)


def without_directions(system: OpticalSystem, paths: Sequence[Path], theta: Array, x0: Array) -> dict[str, str]:
    """Labels of the ghosts whose rays have no field over direction cosines, with the reason: what a plan can say.

    By the map of rays alone; of fits that turn out too coarse it knows nothing.
    """
    reasons: dict[str, str] = {}
    for path in paths:
        try:
            rays = fine_rays(system, path, theta, x0, NODES)
            lit = (rays.clearance[:, 0] > 0).all(axis=0)
            if lit.sum() >= FEWEST_FOR_MAP:
                check_map(rays.pupil[0][lit], rays.u[0][lit], system.sigma0, path.label)
        except CgiWaveError as limit:
            reasons[path.label] = str(limit).removeprefix(f"{path.label}: ")
    return reasons
