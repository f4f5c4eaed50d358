"""What a design is judged by: spots on the arm mirrors, of the relay alone and at the detector; OPD; fringes.

SI units; spots are radial RMS about the centroid, every ray that passes the stop counted alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.kernels.trace import REFRACT, trace_sequence
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import Path, find_paths
from cgi_wave.rays.trace import Sequence, aim, compile_sequence, history, trace

Array = NDArray[np.float64]
#: Cone of the relay on its own: F/4, telecentric.
RELAY_SINE = 0.125


def disc(rings: int = 4, spokes: int = 8) -> tuple[Array, Array]:
    """Quadrature over the unit disc: points (N, 2) and weights (N,) of sum 1 (Gauss in radius squared)."""
    node, weight = np.polynomial.legendre.leggauss(rings)
    radius = np.sqrt((node + 1) / 2)
    # Odd and even rings are turned against each other, so that no azimuth is sampled more than the rest.
    angle = 2 * np.pi * (np.arange(spokes) + 0.25 + 0.5 * (np.arange(rings)[:, None] % 2)) / spokes
    points = np.stack([radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)], axis=2)
    return points.reshape(-1, 2), np.repeat(weight / 2 / spokes, spokes)


def spot(x: Array, weight: Array) -> tuple[Array, float]:
    """Rays (N, 2) relative to their centroid, and their radial RMS."""
    relative = x - weight @ x
    return relative, float(np.sqrt(weight @ (relative**2).sum(axis=1)))


def mirror_step(sequence: Sequence) -> int:
    """Number of the step at which a nominal path meets its arm mirror."""
    return next(k for k, name in enumerate(sequence.names) if name in ("mirror1", "mirror2"))


def relay_trace(sequence: Sequence, at: Array, sines: Array) -> Array:
    """Detector points (N, 2) of rays that leave the arm mirror at ``at`` (2,) with cosines ``sines`` (N, 2)."""
    first = mirror_step(sequence) + 1
    s, count = sequence, len(sines)
    rays = np.zeros((6, count))
    rays[:2] = at[:, None]
    rays[3:5] = sines.T
    rays[5] = -np.sqrt(1.0 - (sines**2).sum(axis=1))
    opl, power, clearance = np.zeros(count), np.ones(count), np.full(count, np.inf)
    status = np.zeros(count, dtype=np.int64)
    trace_sequence(s.rot[first:], s.shift[first:], s.curvature[first:], s.conic[first:], s.n1[first:], s.n2[first:],
                   s.mode[first:], s.side[first:], s.weight[first:], s.bare[first:], s.aperture[first:], rays,
                   np.empty((0, 6, count)), opl, power, status, clearance, np.empty((0, 2, count)))  # fmt: skip
    return rays[:2].T.copy()


@dataclass(frozen=True)
class Spots:
    """One field point, wavelength and arm.

    objective, relay, chain: RMS radii (m); mirror: chief ray on the arm mirror (m); telecentric: its angle to the
    mirror's normal (rad); passing: share of the rays that no aperture stops.
    """

    objective: float
    relay: float
    chain: float
    mirror: Array
    telecentric: float
    passing: float


def measure_spots(sequence: Sequence, pupil: Array, weight: Array, sines: Array, theta: Array) -> Spots:
    """Spots of one beam: pupil (N, 2) m, sines (N, 2) of the relay's cone, weight (N,) of both, theta (2,)."""
    step = mirror_step(sequence)
    whole = trace(sequence, pupil, theta, footprints=True)
    chief = trace(sequence.upto(step + 1), np.zeros((1, 2)), theta)
    relay = relay_trace(sequence, chief.x[0], sines)
    radii = spot(whole.foot[step].T, weight)[1], spot(relay, weight)[1], spot(whole.x, weight)[1]
    angle = float(np.arcsin(np.hypot(*chief.direction[0])))
    return Spots(*radii, chief.x[0], angle, float(weight @ whole.passes))


def nominal_paths(system: OpticalSystem) -> tuple[Path, Path]:
    """The nominal paths through arm 1 and arm 2."""
    first, second = find_paths(system, 0, 0)
    return first, second


def field_angles(sequence: Sequence, points: Array) -> Array:
    """Incoming direction cosines (N, 2) whose central chief rays end on detector points (N, 2)."""
    found = [aim(sequence, np.zeros((1, 2)), point, np.zeros(2)) for point in points]
    if not all(ok[0] for _, ok in found):
        raise RuntimeError("a chief ray does not reach its detector point")
    return np.concatenate([theta for theta, _ in found])


def phase_opd(system: OpticalSystem, paths: tuple[Path, Path], sigma: float, points: Array) -> Array:
    """OPD of arm 1 minus arm 2 (m) at detector points (N, 2), along the central chief rays, at wavenumber sigma."""
    opl = []
    for path in paths:
        sequence = compile_sequence(system, path, sigma)
        theta = field_angles(sequence, points)
        opl.append(trace(sequence, np.zeros((len(points), 2)), theta).opl)
    return opl[0] - opl[1]


def group_opd(system: OpticalSystem, paths: tuple[Path, Path], points: Array, relative_step: float = 1e-4) -> Array:
    """Group OPD d(σ·OPD)/dσ (m) at the filter's centre, at detector points (N, 2), by a central difference."""
    sigma, h = system.sigma0, relative_step * system.sigma0
    up, down = (phase_opd(system, paths, s, points) * s for s in (sigma + h, sigma - h))
    return (up - down) / (2 * h)


def aperture_margins(system: OpticalSystem, sequence: Sequence, pupil: Array, theta: Array) -> dict[str, float]:
    """Smallest distance (m) of the rays from the inside of each aperture on their way, the stop left out."""
    feet = trace(sequence, pupil, theta, footprints=True).foot
    found: dict[str, float] = {}
    for name, foot in zip(sequence.names, feet, strict=True):
        if name == "stop":
            continue
        margin = -float(outside(system.surfaces[system.number[name]].aperture, foot[0], foot[1]).max())
        found[name] = min(margin, found.get(name, np.inf))
    return found


def outside(aperture: Array, x: Array, y: Array) -> Array:
    """Distance (m) by which local points lie outside an aperture (negative inside)."""
    dx, dy = x - aperture[3], y - aperture[4]
    if aperture[0] == 1.0:
        return np.hypot(dx, dy) - aperture[1]
    return np.maximum(abs(dx) - aperture[1], abs(dy) - aperture[2])


def obstruction_margins(system: OpticalSystem, sequence: Sequence, pupil: Array, theta: Array) -> dict[str, float]:
    """Smallest distance (m) at which rays pass surfaces of the same space that they are not meant to meet.

    Negative: something stands in the way. Keys read "surface beside from>to".
    """
    points = history(sequence, pupil, theta)
    axes, centre = system.pupil_frame()
    points = points @ axes + centre
    space = system.spaces.index(system.document.entrance.space)
    found: dict[str, float] = {}
    share = np.linspace(0.0, 1.0, 201)[:, None, None]
    for k in range(1, len(points)):
        here = sequence.names[k - 1]
        last = sequence.names[k - 2] if k > 1 else "entrance"
        way = points[k - 1] + share * (points[k] - points[k - 1])
        for other in system.surfaces:
            if other.name in (here, last) or space not in (other.before, other.after):
                continue
            local = (way - other.origin) @ other.rotation.T
            height = local[..., 2] - other.sag(local[..., 0], local[..., 1])
            cross = height[:-1] * height[1:] <= 0.0
            if cross.any():
                away = outside(other.aperture, local[:-1, :, 0][cross], local[:-1, :, 1][cross])
                found[f"{other.name} beside {last}>{here}"] = float(away.min())
        surface = system.surfaces[system.number[here]]
        if sequence.mode[k - 1] == REFRACT:
            space = surface.after if space == surface.before else surface.before
    return found
