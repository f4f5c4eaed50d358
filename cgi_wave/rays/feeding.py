"""Where in the entrance pupil, and from which directions, the light of one detector point comes."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.disc import NODES, disc, monomials, rim
from cgi_wave.rays.paths import Path, pupil_probes
from cgi_wave.rays.trace import (
    Aimed,
    Sequence,
    aim,
    aim_and_trace,
    compile_sequence,
    jacobian,
    trace,
    trace_with_derivatives,
    trouble,
)

Array = NDArray[np.float64]
Guess = Callable[[Array], Array]

#: Share of rays that must pass before a beam is sampled; below it the sampled disc is drawn in around those that do.
FILLED = 0.55
#: Share of rays below which it is in doubt whether the pupil was searched in the right place.
SCARCE = 0.1
#: Room around the pupil, so that its edge lies between rays.
OVER = 1.03
RIM = rim(NODES)
#: How often the disc is drawn in.
TURNS = 3
#: Growth of a disc whose rim is lit.
WIDER = 1.5
#: Probes moved onto the detector point, rounds of Newton's method for them, and where they have to end, m.
MOVED, ROUNDS, LANDED = 64, 8, 1e-9
#: Largest direction cosine along x or y that a guess may have.
STEEPEST = 0.4


def rays_over_feed(
    system: OpticalSystem, path: Path, sequence: Sequence, x0: Array, start: Array
) -> tuple[Array, float, Aimed]:
    """Pupil points (NODES, 2), m, over the part of the pupil that feeds the detector point x0; rays aimed from them.

    Between the two the radius of the disc that the points fill. start (2,): first guess of the source direction.

    Most ghosts are fed by the whole pupil, from directions that change linearly over it. Where few rays arrive that
    way, the probes of the path search are asked: a ghost that images the pupil near the detector is fed by a small part
    of it, from all directions. Raises EmptyBeamError if no ray arrives.
    """
    radius = system.pupil_radius

    def attempt(centre: Array, half: float, guess: Guess) -> tuple[Array, Aimed, NDArray[np.bool_]]:
        p = centre + half * disc(NODES)
        aimed = aim_and_trace(sequence, p, x0, guess(p))
        return p, aimed, aimed.ok & aimed.traced.passes & ((p**2).sum(axis=1) < radius**2)

    centre, half, guess = np.zeros(2), radius * OVER, _linear_guess(sequence, x0, start)
    p, aimed, inside = attempt(centre, half, guess)
    if inside.mean() < SCARCE:
        known = _probed_feed(system, path, sequence, x0)
        if known is not None:
            centre, half, guess = known
            p, aimed, inside = attempt(centre, half, guess)
            # A few probes do not show where the light ends: the rim of the disc does.
            while inside[-RIM:].any() and half < radius * OVER + float(np.hypot(*centre)):
                half *= WIDER
                p, aimed, inside = attempt(centre, half, guess)
    for _ in range(TURNS):
        if inside.mean() >= FILLED or not inside.any():
            break
        centre, half = bounding_disc(p[inside], half, NODES)
        p, aimed, inside = attempt(centre, half, guess)
    if not inside.any():
        raise EmptyBeamError(f"{path.label}: no ray reaches {x0 * 1e3} mm; {trouble(sequence, aimed.traced)}")
    return p, half, aimed


def _linear_guess(sequence: Sequence, x0: Array, start: Array) -> Guess:
    """Source directions for all pupil points, from the linear map about one ray that ends on ``x0``."""
    pivot = np.zeros((1, 2))
    theta, ok = aim(sequence, pivot, x0, start)
    if not ok[0]:
        theta = start[None]
    by_theta = jacobian(sequence, pivot, theta)[0][0]
    by_p = jacobian(sequence, pivot, theta, of="p")[0][0]
    if not (np.isfinite(by_theta).all() and np.isfinite(by_p).all()) or abs(np.linalg.det(by_theta)) < 1e-14:
        return lambda p: np.broadcast_to(start, p.shape)
    matrix = -np.linalg.solve(by_theta, by_p)
    return lambda p: np.clip(theta[0] + p @ matrix.T, -STEEPEST, STEEPEST)


@lru_cache(maxsize=4096)
def _arriving(system: OpticalSystem, path: Path) -> tuple[Array, Array]:
    """Probes of the path search that arrive: (pupil point, direction) (P, 4) and where they end (P, 2), m."""
    p, theta = pupil_probes(system, path.probes)
    traced = trace(compile_sequence(system, path, system.sigma0), p, theta)
    return np.column_stack([p, theta])[traced.passes], traced.x[traced.passes]


def _probed_feed(system: OpticalSystem, path: Path, sequence: Sequence, x0: Array) -> tuple[Array, float, Guess] | None:
    """Disc of the pupil that feeds x0, centre and radius, and source directions over it, from what probes arrive.

    The nearest probes are moved onto x0 by the least change of place and direction, measured in pupil radii and half
    fields; a polynomial through those that still arrive gives the directions. None if fewer than three do.
    """
    launched, ends = _arriving(system, path)
    nearest = np.argsort(((ends - x0) ** 2).sum(axis=1))[:MOVED]
    at = launched[nearest]
    field = np.sin(np.radians(system.document.entrance.half_field_deg))
    unit = np.array([system.pupil_radius, system.pupil_radius, *np.broadcast_to(field, 2)])
    for _ in range(ROUNDS):
        if len(at) == 0:
            return None
        here = trace_with_derivatives(sequence, at[:, :2], at[:, 2:], "both")
        # Derivatives come with those by direction first.
        matrix, miss = here.dx[:, :, [2, 3, 0, 1]] * unit, x0 - here.traced.x
        fine = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(miss).all(axis=1)
        arrived = fine & here.traced.passes & (np.abs(miss).max(axis=1) < LANDED)
        if arrived.all():
            break
        at = at[fine] + np.einsum("nij,nj->ni", np.linalg.pinv(matrix[fine]), miss[fine]) * unit
        at = at[(np.abs(at[:, 2:]) < STEEPEST).all(axis=1)]
    landed = trace(sequence, at[:, :2], at[:, 2:])
    at = at[landed.passes & (np.abs(landed.x - x0).max(axis=1) < LANDED)]
    if len(at) < 3:
        return None
    centre, half = bounding_disc(at[:, :2], 0.5 * float(np.ptp(at[:, :2], axis=0).max()), len(at))
    degree = 2 if len(at) >= 24 else 1 if len(at) >= 9 else 0
    x = (at[:, :2] - centre) / half
    coefficient = np.linalg.lstsq(monomials(x, degree), at[:, 2:], rcond=None)[0]

    def guess(p: Array) -> Array:
        return np.clip(monomials((p - centre) / half, degree) @ coefficient, -STEEPEST, STEEPEST)

    return centre, min(half, system.pupil_radius * OVER + float(np.hypot(*centre))), guess


def bounding_disc(points: Array, half: float, count: int) -> tuple[Array, float]:
    """Disc around the points that arrived, with room for what lies between them and the next ones.

    They are some of ``count`` points over a disc of radius ``half``.
    """
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return centre, with_room(float(np.sqrt(((points - centre) ** 2).sum(axis=1)).max()), half, count)


def with_room(reach: float, half: float, count: int) -> float:
    """``reach`` of points, widened by what may lie between them and the next ones, as in ``bounding_disc``."""
    return reach + 1.5 * 1.8 * half / float(np.sqrt(count))
