"""Beams: one path at one field point, traced from one source direction and towards one detector point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError
from cgi_wave.kernels.beams import chart_rays, lit_disc, valid_rays
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.charts import determinants, near_clearances, ray_phase
from cgi_wave.rays.disc import EVEN, NODES, disc, fitted, monomials, on_disc, rim
from cgi_wave.rays.feeding import FILLED, OVER, TURNS, rays_over_feed, with_room
from cgi_wave.rays.paths import Path
from cgi_wave.rays.trace import aim, aim_and_trace, caustics, compile_sequence, trace, trace_with_derivatives, trouble

Array = NDArray[np.float64]

#: Rays without which a beam is given up.
FEWEST = 30


@dataclass(frozen=True)
class Rays:
    """Rays of one path, at S wavenumbers, that share one source direction or one detector point.

    u (S, N, 2): direction cosines (shared direction) or pupil points in m (shared point); opl (S, N) m;
    amplitude (S, N): √(power · Jacobian); clearance (K, S, N), the entrance pupil's first; direction (S, N, 2);
    pupil (S, N, 2) m; x (S, N, 2) m on the detector; phase rad; theta (S, N, 2): cosines of the source direction;
    coating (S, N): power left by the coatings; catch (K', S, N): clearances of the detector's edge where it does not
    end the beam.
    even (N,): rays that are spread evenly over the pupil, each for a cell of ``cell`` m² (the others line the rim).
    """

    u: Array
    opl: Array
    amplitude: Array
    clearance: Array
    direction: Array
    pupil: Array
    x: Array
    phase: float
    even: NDArray[np.bool_]
    cell: float
    theta: Array
    coating: Array
    catch: Array

    def power(self) -> tuple[float, float]:
        """Sum of amplitude² over the even rays that pass (shared detector point, middle wavenumber), and its error.

        Even rays miss or add at the rim of the support what a few of them carry: three standard errors.
        """
        middle = self.amplitude.shape[0] // 2
        lit = self.even & (self.clearance[:, middle] > 0).all(axis=0)
        total = float((self.amplitude[middle, lit] ** 2).sum() * self.cell)
        count = max(int(lit.sum()), 1)
        return total, 3.0 * 0.3 * float(np.sqrt(2.0 * np.sqrt(np.pi * count))) / count * total

    def sheet(self, sigma: Array) -> Sheet:
        """Path lengths and directions as polynomials over the pupil; sigma (S,) as traced.

        Traced at one wavenumber, phase path length stands for group path length: the caller allows for dispersion.
        """
        middle = len(sigma) // 2
        p = self.pupil[middle]
        x, centre, half = on_disc(p)
        product = self.opl * sigma[:, None]
        group = (product[-1] - product[0]) / (sigma[-1] - sigma[0]) if len(sigma) > 1 else self.opl[0]
        values = np.column_stack([self.opl[middle], group, self.direction[middle, :, 1]])
        degree = 8 if len(p) >= 90 else 4
        lit = (self.clearance[:, middle] > 0).all(axis=0)
        return Sheet(p[lit], centre, half, degree, fitted(x, values, degree))


@dataclass(frozen=True)
class Sheet:
    """The rays of a beam that reach one detector point, in short: pupil points p (N, 2), m, of those that pass, and
    polynomials over the pupil of path length, group path length d(σ·opl)/dσ, m, and direction cosine along y."""

    p: Array
    centre: Array
    half: float
    degree: int
    coefficient: Array

    def covers(self, points: Array) -> NDArray[np.bool_]:
        """Whether pupil points (N, 2) lie within reach of the rays that pass."""
        middle = self.p.mean(axis=0)
        reach = np.sqrt(((self.p - middle) ** 2).sum(axis=1)).max() + 0.1 * self.half
        inside: NDArray[np.bool_] = ((points - middle) ** 2).sum(axis=1) <= reach**2
        return inside

    def at(self, points: Array) -> Array:
        """Path length, group path length, m, and direction cosine along y, (N, 3), at pupil points (N, 2)."""
        values: Array = monomials((points - self.centre) / self.half, self.degree) @ self.coefficient
        return values

    def opl_at(self, points: Array) -> Array:
        """Path length, m, of the rays through pupil points (N, 2)."""
        return self._at(points, 0)

    def group_at(self, points: Array) -> Array:
        """Group path length, m, of the rays through pupil points (N, 2)."""
        return self._at(points, 1)

    def y_at(self, points: Array) -> Array:
        """Direction cosine along y, at the detector, of the rays through pupil points (N, 2)."""
        return self._at(points, 2)

    def _at(self, points: Array, column: int) -> Array:
        values: Array = monomials((points - self.centre) / self.half, self.degree) @ self.coefficient[:, column]
        return values


@dataclass(frozen=True)
class Spot:
    """Geometric footprint on the detector of one path for one source direction.

    power: relative to the light through the entrance pupil (coatings and vignetting included); centroid (2,), rms (2,),
    m; x (N, 2) m: where the rays of an even pupil grid land.
    """

    power: float
    centroid: Array
    rms: Array
    x: Array


def nominal_direction(system: OpticalSystem, path: Path, x0: Array) -> Array:
    """Source direction (2,) whose ray through the pupil's centre meets the detector point ``x0`` (2,; m)."""
    theta, ok = aim(compile_sequence(system, path, system.sigma0), np.zeros((1, 2)), x0, np.zeros(2))
    if not ok[0]:
        raise EmptyBeamError(f"{system.band}: no ray of {path.label} through the pupil's centre reaches {x0 * 1e3} mm")
    return theta[0]


def spot(system: OpticalSystem, path: Path, theta: Array, sigma: float, count: int = 2000) -> Spot:
    """Geometric spot of ``path`` for source direction ``theta`` (2,). Raises EmptyBeamError if no ray arrives."""
    points = disc(count)[: count - rim(count)] / EVEN * system.pupil_radius
    traced = trace(compile_sequence(system, path, sigma), points, theta)
    ok = traced.passes
    if not ok.any():
        raise EmptyBeamError(f"{path.label}: no ray of direction {theta} reaches the detector")
    x, weight = traced.x[ok], traced.power[ok]
    centre = weight @ x / weight.sum()
    rms = np.sqrt(weight @ (x - centre) ** 2 / weight.sum())
    return Spot(float(weight.sum() / len(points)), centre, rms, x)


def rays_to_point(system: OpticalSystem, path: Path, x0: Array, sigmas: Array, start: Array) -> Rays:
    """Rays of ``path`` that end on the detector point ``x0``, over the part of the entrance pupil that feeds it.

    One ray per pupil point; G(p, x0) has amplitude |∂q/∂p|^½ = |det ∂x/∂θ|^−½ (the map is symplectic).
    start (2,): first guess of the source direction. Raises EmptyBeamError if no ray arrives.
    """
    middle = len(sigmas) // 2
    sequence = compile_sequence(system, path, float(sigmas[middle]))
    p, half, aimed = rays_over_feed(system, path, sequence, x0, start)
    beams = []
    for s, sigma in enumerate(sigmas):
        at = compile_sequence(system, path, float(sigma))
        beams.append(aimed if s == middle else aim_and_trace(at, p, x0, aimed.theta))
    keep = np.all([beam.ok for beam in beams], axis=0)
    if keep.sum() < FEWEST:
        raise EmptyBeamError(
            f"{path.label}: {keep.sum()} of {len(p)} rays can be aimed at {x0 * 1e3} mm, {FEWEST} are needed"
        )
    radius, feet = system.pupil_radius, [beam.traced.foot for beam in beams]
    clearance, none = near_clearances(sequence.aperture, feet, keep, p, radius)
    p = p[keep]
    opl, amplitude, direction, x, theta, coating = [], [], [], [], [], []
    for beam in beams:
        traced = beam.traced if keep.all() else beam.traced.some(keep)
        # What is left of the aiming error moves the end of the ray by δx: to first order Λ changes by q·δx.
        opl.append(traced.opl + (traced.direction * (x0 - traced.x)).sum(axis=1))
        amplitude.append(np.sqrt(traced.power / np.maximum(np.abs(determinants(beam.by_theta[keep])), 1e-300)))
        direction.append(traced.direction)
        x.append(traced.x)
        theta.append(beam.theta[keep])
        coating.append(traced.power)
    nearest = int(np.argmin(((p - p.mean(axis=0)) ** 2).sum(axis=1)))
    crossed = caustics(sequence, p[nearest], aimed.theta[keep][nearest], "theta")
    pupil = np.array([p] * len(beams))
    return Rays(pupil, np.array(opl), np.array(amplitude), clearance, np.array(direction), pupil, np.array(x),
                sequence.phase - 0.5 * np.pi * crossed, even_rays(NODES)[keep], cell_of(half, NODES),
                np.array(theta), np.array(coating), none)  # fmt: skip


def rays_from_direction(
    system: OpticalSystem,
    path: Path,
    theta: Array,
    x0: Array,
    sigmas: Array,
    count: int = NODES,
    bend: float = 0.0,
    beyond: bool = False,
) -> Rays:
    """Rays of ``path`` from one source direction; phases about the detector point ``x0``; ``count`` of them.

    Â(u) has amplitude |∂p/∂u|^½, u = q − bend (x − x0): see ``rays.charts`` on ``bend``, 1/m. beyond: whether rays
    that miss the detector, in its plane, belong to the beam. Raises EmptyBeamError if no ray arrives.
    """
    middle = len(sigmas) // 2
    sequence = compile_sequence(system, path, float(sigmas[middle]))
    aperture = sequence.aperture
    if beyond:
        sequence = sequence.beyond()
    radius = system.pupil_radius
    (x, y), half, found = (0.0, 0.0), radius * OVER, None
    for turn in range(TURNS + 1):
        p = half * disc(count)
        p += x, y
        # Most beams fill the pupil, and are done. Where light is sought further, derivatives would cost twice as much
        # as the rays.
        found = trace_with_derivatives(sequence, p, theta, "p") if turn in (0, TURNS) else None
        seen = trace(sequence, p, theta) if found is None else found.traced
        lit, *middle_of, reach = lit_disc(seen.status, seen.clearance, p, radius)
        if not lit:
            raise EmptyBeamError(f"{path.label}: no ray of direction {theta} arrives; {trouble(sequence, seen)}")
        if lit / count >= FILLED or turn == TURNS:  # p and half leave the loop together: they give a ray its cell
            break
        (x, y), half = middle_of, with_room(reach, half, count)
    found = found or trace_with_derivatives(sequence, p, theta, "p")
    keep = np.empty(count, dtype=np.bool_)
    left, nearest = valid_rays(found.traced.status, found.traced.opl, p, keep)
    phase = ray_phase(sequence, p[nearest], theta, found.dx[nearest], found.dq[nearest], bend)
    size = len(sigmas), left
    u, direction, x_end = np.empty((*size, 2)), np.empty((*size, 2)), np.empty((*size, 2))
    opl, amplitude, coating, feet = np.empty(size), np.empty(size), np.empty(size), []
    for s, sigma in enumerate(sigmas):
        at = sequence if s == middle else compile_sequence(system, path, float(sigma))
        here = found if s == middle else trace_with_derivatives(at, p, theta, "p")
        feet.append(here.traced.foot)
        coating[s] = here.traced.power if left == count else here.traced.power[keep]
        chart_rays(keep, p, theta, x0, bend, here.traced.x, here.traced.direction, here.traced.opl, here.traced.power,
                   here.dx, here.dq, u[s], opl[s], amplitude[s], direction[s], x_end[s])  # fmt: skip
    clearance, catch = near_clearances(aperture, feet, keep, p, radius, beyond)
    even, same, pupil = even_rays(count), np.empty((*size, 2)), np.empty((*size, 2))
    if left < count:
        even, p = even[keep], p[keep]
    same[:], pupil[:] = theta, p
    return Rays(u, opl, amplitude, clearance, direction, pupil, x_end, phase, even, cell_of(half, count), same, coating,
                catch)  # fmt: skip


@lru_cache(maxsize=16)
def even_rays(count: int) -> NDArray[np.bool_]:
    """Which points of ``disc`` are spread evenly over it, (count,); not to be written to."""
    even: NDArray[np.bool_] = np.arange(count) < count - rim(count)
    even.flags.writeable = False
    return even


def cell_of(half: float, count: int) -> float:
    """Area that each even ray over a disc of radius ``half`` stands for."""
    return float(np.pi * (EVEN * half) ** 2 / (count - rim(count)))
