"""Beams: one path at one field point, traced from one source direction and towards one detector point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError
from cgi_wave.kernels.trace import clearance_rows
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import Path
from cgi_wave.rays.trace import (
    Sequence,
    aim,
    aim_and_trace,
    caustics,
    compile_sequence,
    jacobian,
    trace,
    trace_with_derivatives,
    trouble,
)

Array = NDArray[np.float64]

#: Rays per beam: enough for a polynomial of degree 12 with a third to spare.
NODES = 280
#: Rays without which a beam is given up.
FEWEST = 30
#: Share of rays that must pass before a beam is sampled; below it the sampled disc is drawn in around those that do.
FILLED = 0.55
#: Points at which clearances are compared, and the most by which one changes between two of them: an aperture is
#: carried along if its clearance falls below this where all others are above minus this.
COMPARED = 1500
COMFORTABLE = 0.25
LIMITING = 0.05
#: Apertures whose clearances agree to this everywhere are one (the stop and its image, a plate's two passes).
SAME = 1e-6


#: The even part of a sampled disc ends at this share of its radius; the rest lines its edge, for the fits.
EVEN = 0.985


def _ring(count: int) -> int:
    """How many of ``count`` points line the edge of the disc."""
    return int(3.0 * np.sqrt(count))


RING = _ring(NODES)


@dataclass(frozen=True)
class Rays:
    """Rays of one path, at S wavenumbers, that share one source direction or one detector point.

    u (S, N, 2): direction cosines (shared direction) or pupil points in m (shared point); opl (S, N) m;
    amplitude (S, N): √(power · Jacobian); clearance (K, S, N); direction (S, N, 2); pupil (S, N, 2) m;
    x (S, N, 2) m on the detector; phase rad.
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
        centre, half = p.mean(axis=0), float(np.sqrt(((p - p.mean(axis=0)) ** 2).sum(axis=1)).max())
        product = self.opl * sigma[:, None]
        group = (product[-1] - product[0]) / (sigma[-1] - sigma[0]) if len(sigma) > 1 else self.opl[0]
        values = np.column_stack([self.opl[middle], group, self.direction[middle, :, 1]])
        degree = 8 if len(p) >= 90 else 4
        q, r = np.linalg.qr(monomials((p - centre) / half, degree))
        lit = (self.clearance[:, middle] > 0).all(axis=0)
        return Sheet(p[lit], centre, half, degree, np.linalg.solve(r, q.T @ values))


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


@lru_cache(maxsize=8)
def disc(count: int) -> Array:
    """Points (count, 2) spread evenly over the unit disc (sunflower), with a ring on its edge; not to be written to."""
    ring = _ring(count)
    k = np.arange(count - ring) + 0.5
    radius, angle = np.sqrt(k / (count - ring)), np.pi * (1 + 5**0.5) * k
    edge = 2 * np.pi * np.arange(ring) / ring
    inner = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]) * EVEN
    points = np.concatenate([inner, np.column_stack([np.cos(edge), np.sin(edge)])])
    points.flags.writeable = False
    return points


def nominal_direction(system: OpticalSystem, path: Path, x0: Array) -> Array:
    """Source direction (2,) whose ray through the pupil's centre meets the detector point ``x0`` (2,; m)."""
    theta, ok = aim(compile_sequence(system, path, system.sigma0), np.zeros((1, 2)), x0, np.zeros(2))
    if not ok[0]:
        raise EmptyBeamError(f"{system.band}: no ray of {path.label} through the pupil's centre reaches {x0 * 1e3} mm")
    return theta[0]


def spot(system: OpticalSystem, path: Path, theta: Array, sigma: float, count: int = 2000) -> Spot:
    """Geometric spot of ``path`` for source direction ``theta`` (2,). Raises EmptyBeamError if no ray arrives."""
    points = disc(count)[: count - _ring(count)] / EVEN * system.pupil_radius
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
    guess = _linear_guess(sequence, x0, start)
    radius = system.pupil_radius
    centre, half = np.zeros(2), radius * 1.03
    for last in (False, False, False, True):
        p = centre + half * disc(NODES)
        aimed = aim_and_trace(sequence, p, x0, guess(p))
        inside = aimed.ok & aimed.traced.passes & ((p**2).sum(axis=1) < radius**2)
        if not inside.any():
            raise EmptyBeamError(f"{path.label}: no ray reaches {x0 * 1e3} mm; {trouble(sequence, aimed.traced)}")
        if last or inside.mean() >= FILLED:  # p and half leave the loop together: they give a ray its cell
            break
        centre, half = _bounding_disc(p[inside], half)
    beams = []
    for s, sigma in enumerate(sigmas):
        at = compile_sequence(system, path, float(sigma))
        beams.append(aimed if s == middle else aim_and_trace(at, p, x0, aimed.theta))
    keep = np.all([beam.ok for beam in beams], axis=0)
    if keep.sum() < FEWEST:
        raise EmptyBeamError(
            f"{path.label}: {keep.sum()} of {len(p)} rays can be aimed at {x0 * 1e3} mm, {FEWEST} are needed"
        )
    p = p[keep]
    parts = []
    for beam in beams:
        traced = beam.traced if keep.all() else beam.traced.some(keep)
        # What is left of the aiming error moves the end of the ray by δx: to first order Λ changes by q·δx.
        opl = traced.opl + (traced.direction * (x0 - traced.x)).sum(axis=1)
        amplitude = np.sqrt(traced.power / np.maximum(np.abs(_det(beam.by_theta[keep])), 1e-300))
        parts.append((p, opl, amplitude, clearance_rows(sequence.aperture, traced.foot), traced.direction, p, traced.x))
    nearest = int(np.argmin(((p - p.mean(axis=0)) ** 2).sum(axis=1)))
    crossed = caustics(sequence, p[nearest], aimed.theta[keep][nearest], "theta")
    even = (np.arange(NODES) < NODES - RING)[keep]
    return _stack(parts, radius, sequence.phase - 0.5 * np.pi * crossed, even, half)


def rays_from_direction(system: OpticalSystem, path: Path, theta: Array, x0: Array, sigmas: Array) -> Rays:
    """Rays of ``path`` from one source direction; phases about the detector point ``x0``.

    Â(q) has amplitude |∂p/∂q|^½. Raises EmptyBeamError if no ray arrives.
    """
    middle = len(sigmas) // 2
    sequence = compile_sequence(system, path, float(sigmas[middle]))
    radius = system.pupil_radius
    centre, half = np.zeros(2), radius * 1.03
    for last in (False, False, False, True):
        p = centre + half * disc(NODES)
        found = trace_with_derivatives(sequence, p, theta, "p")
        traced = found.traced
        inside = traced.passes & ((p**2).sum(axis=1) < radius**2)
        if not inside.any():
            raise EmptyBeamError(f"{path.label}: no ray of direction {theta} arrives; {trouble(sequence, traced)}")
        if last or inside.mean() >= FILLED:  # p and half leave the loop together: they give a ray its cell
            break
        centre, half = _bounding_disc(p[inside], half)
    keep = traced.valid
    even = (np.arange(NODES) < NODES - RING)[keep]
    nearest = int(np.argmin(((p[keep] - p[keep].mean(axis=0)) ** 2).sum(axis=1)))
    curvature = found.dq[keep][nearest] @ np.linalg.inv(found.dx[keep][nearest])
    p = p[keep]
    parts = []
    for s, sigma in enumerate(sigmas):
        at = compile_sequence(system, path, float(sigma))
        here = found if s == middle else trace_with_derivatives(at, p, theta, "p")
        traced, by_p = here.traced, here.dq
        if len(traced.opl) > len(p):
            traced, by_p = traced.some(keep), by_p[keep]
        # The incoming plane wave reaches pupil point p with the phase of p·θ.
        opl = traced.opl + p @ theta - (traced.direction * (traced.x - x0)).sum(axis=1)
        amplitude = np.sqrt(traced.power / np.maximum(np.abs(_det(by_p)), 1e-300))
        clearance = clearance_rows(sequence.aperture, traced.foot)
        parts.append((traced.direction, opl, amplitude, clearance, traced.direction, p, traced.x))
    crossed = caustics(sequence, p[nearest], theta, "p")
    # From position to direction by stationary phase: exp(iπ/4 · signature of ∂q/∂x).
    signature = np.sign(np.linalg.eigvals(curvature).real).sum()
    phase = sequence.phase - 0.5 * np.pi * crossed + 0.25 * np.pi * signature
    return _stack(parts, radius, phase, even, half)


def _det(matrices: Array) -> Array:
    """Determinants (N,) of (N, 2, 2)."""
    value: Array = matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]
    return value


def _linear_guess(sequence: Sequence, x0: Array, start: Array):  # type: ignore[no-untyped-def]
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
    return lambda p: np.clip(theta[0] + p @ matrix.T, -0.4, 0.4)


def _bounding_disc(points: Array, half: float) -> tuple[Array, float]:
    """Disc around the points that arrived, with room for what lies between them and the next ones."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    spacing = 1.8 * half / np.sqrt(NODES)
    return centre, float(np.sqrt(((points - centre) ** 2).sum(axis=1)).max() + 1.5 * spacing)


def _stack(parts: list, radius: float, phase: float, even: NDArray[np.bool_], half: float) -> Rays:
    u, opl, amplitude, clearance, direction, p, x = (np.stack([part[i] for part in parts]) for i in range(7))
    pupil = 1.0 - (p**2).sum(axis=2) / radius**2
    cell = float(np.pi * (EVEN * half) ** 2 / (NODES - RING))
    clearance = np.concatenate([pupil[None], clearance.transpose(1, 0, 2)])
    # An aperture that is passed with this much room over the whole sampled disc cannot cut the beam.
    near = clearance.min(axis=(1, 2)) < COMFORTABLE
    near[0] = True
    return Rays(u, opl, amplitude, clearance[near], direction, p, x, phase, even, cell)


def limiting(clearance: Array, p: Array) -> Array:
    """The clearances (K', S, N) of (K, S, N) that bound the beam; at least one. p (N, 2): pupil points.

    Most apertures on a long path are passed with room to spare, or lie in the shadow of another (a mirror next to an
    image of the stop). Polynomials through the samples say which, on points much denser than the rays.
    """
    centre = 0.5 * (p.min(axis=0) + p.max(axis=0))
    x = (p - centre) / np.sqrt(((p - centre) ** 2).sum(axis=1)).max()
    # The usual disc has its operator kept; a beam that lost rays needs one of its own.
    to_dense = _usual_operator() if len(x) == NODES else _operator(x, 8 if len(x) >= 90 else 4)
    dense = clearance[:, clearance.shape[1] // 2] @ to_dense.T
    order = np.argsort(dense.min(axis=1))
    kept: list[int] = []
    for k in order:
        others = dense[kept].min(axis=0) if kept else np.full(dense.shape[1], np.inf)
        cuts = bool(((dense[k] < LIMITING) & (others > -LIMITING)).any())
        if cuts and all(np.abs(dense[k] - dense[j]).max() > SAME for j in kept):
            kept.append(int(k))
    for k in list(kept):
        rest = [j for j in kept if j != k]
        if rest and not ((dense[k] < LIMITING) & (dense[rest].min(axis=0) > -LIMITING)).any():
            kept = rest
    return clearance[kept or [int(order[0])]]


@lru_cache(maxsize=1)
def _usual_operator() -> Array:
    return _operator(disc(NODES))


def _operator(x: Array, degree: int = 8) -> Array:
    """(COMPARED, N): values of the polynomial through samples at ``x`` on dense points of the unit disc."""
    q, r = np.linalg.qr(monomials(x, degree))
    operator: Array = np.linalg.solve(r.T, monomials(disc(COMPARED), degree).T).T @ q.T
    return operator


def monomial_powers(degree: int) -> list[tuple[int, int]]:
    """Powers (i, j), i + j ≤ degree, in the order of ``monomials``."""
    return [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]


def monomials(x: Array, degree: int = 8) -> Array:
    """(N, T) products x^i y^j, i + j ≤ degree, of points (N, 2) in the unit disc."""
    i, j = np.array(monomial_powers(degree)).T
    powers = np.ones((degree + 1, *x.shape))
    for k in range(1, degree + 1):
        powers[k] = powers[k - 1] * x
    values: Array = (powers[i, :, 0] * powers[j, :, 1]).T
    return values
