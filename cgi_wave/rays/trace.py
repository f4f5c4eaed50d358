"""Tracing along a path: sequences compiled for the kernel, rays from the entrance pupil, aiming at a detector point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.kernels.aiming import aim_rays, count_caustics
from cgi_wave.kernels.trace import (
    BACKWARD,
    BEYOND,
    FILM,
    KINDS,
    MISS,
    REFLECT,
    REFRACT,
    TIR,
    WRONG_SIDE,
    launch,
    trace_fan,
    trace_sequence,
)
from cgi_wave.optics.coatings import CoatingTable
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import Path
from cgi_wave.rays.sharing import share_out

Array = NDArray[np.float64]
#: Kinds of trouble in words that the name of a surface follows.
WORDS = {
    BEYOND: "beyond the coating's table at",
    MISS: "missed",
    TIR: "total internal reflection at",
    BACKWARD: "virtual at",
    WRONG_SIDE: "on the wrong side of",
}


@dataclass(frozen=True)
class Sequence:
    """A path compiled for one wavenumber: the arrays of ``kernels.trace.trace_sequence``, the detector last.

    phase: constant phase of the coatings along the path, rad. names: surface of each step.
    """

    rot: Array
    shift: Array
    curvature: Array
    conic: Array
    n1: Array
    n2: Array
    mode: NDArray[np.int64]
    side: Array
    weight: Array
    bare: NDArray[np.int64]
    aperture: Array
    film: Array
    phase: float
    names: tuple[str, ...]
    back_off: float

    @property
    def kernel(self):  # type: ignore[no-untyped-def]
        """The arrays as ``kernels.trace`` takes them."""
        return (
            self.rot, self.shift, self.curvature, self.conic, self.n1, self.n2, self.mode, self.side, self.weight,
            self.bare, self.aperture, self.film,
        )  # fmt: skip

    def beyond(self) -> Sequence:
        """The same with a last surface that has no edge."""
        aperture = self.aperture.copy()
        aperture[-1, 0] = 0.0
        return replace(self, aperture=aperture)

    def upto(self, count: int) -> Sequence:
        """The first ``count`` surfaces of the sequence."""
        return Sequence(
            self.rot[:count], self.shift[:count], self.curvature[:count], self.conic[:count], self.n1[:count],
            self.n2[:count], self.mode[:count], self.side[:count], self.weight[:count], self.bare[:count],
            self.aperture[:count], self.film, self.phase, self.names[:count], self.back_off,
        )  # fmt: skip


@dataclass(frozen=True)
class Traced:
    """Rays on the last surface of a sequence, in its local frame.

    x (N, 2) m, direction (N, 2) cosines along x and y, opl (N,) m from the entrance pupil plane, power (N,) of the
    coatings, clearance (N,): the smallest over all apertures (> 0: passes), status (N,): see ``kernels.trace``;
    foot (K, 2, N): local x, y on every surface, or K = 0.
    """

    x: Array
    direction: Array
    opl: Array
    power: Array
    clearance: Array
    status: NDArray[np.int64]
    foot: Array

    def some(self, keep: NDArray[np.bool_]) -> Traced:
        """The rays of a mask (N,)."""
        return Traced(self.x[keep], self.direction[keep], self.opl[keep], self.power[keep], self.clearance[keep],
                      self.status[keep], self.foot[:, :, keep])  # fmt: skip

    @property
    def passes(self) -> NDArray[np.bool_]:
        """Rays that reach the last surface inside every aperture, really and not virtually."""
        return (self.status == 0) & (self.clearance > 0)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Rays that have an intersection everywhere (apertures and virtual surfaces disregarded)."""
        return ((self.status == 0) | (self.status % KINDS >= BACKWARD)) & np.isfinite(self.opl)


@dataclass(frozen=True)
class _Route:
    """What of a sequence does not depend on the wavenumber; before, after (K,): spaces on both sides of each step."""

    rot: Array
    shift: Array
    curvature: Array
    conic: Array
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    mode: NDArray[np.int64]
    side: Array
    weight: Array
    bare: NDArray[np.int64]
    aperture: Array
    phase: float
    flips: NDArray[np.int64]
    tables: tuple[CoatingTable | None, ...]
    names: tuple[str, ...]
    back_off: float


@lru_cache(maxsize=16)
def _poses(system: OpticalSystem) -> tuple[Array, Array]:
    """Rotation (S + 1, S, 3, 3) and shift (S + 1, S, 3) from each surface's frame, the pupil's last, to each other."""
    axes, origin = system.pupil_frame()
    own = np.array([surface.rotation for surface in system.surfaces])
    at = np.array([surface.origin for surface in system.surfaces])
    every, start = np.concatenate([own, axes[None]]), np.concatenate([at, origin[None]])
    return own[None] @ every[:, None].transpose(0, 1, 3, 2), np.einsum("aij,abj->abi", every, at[None] - start[:, None])


@lru_cache(maxsize=4096)
def _route(system: OpticalSystem, path: Path) -> _Route:
    surfaces = system.surfaces
    space = system.spaces.index(system.document.entrance.space)
    numbers, before, after, mode, side, weight, bare, flips = [], [], [], [], [], [], [], []
    tables: list[CoatingTable | None] = []
    phase = 0.0
    steps = [*path.steps, (surfaces[system.detector].name, "absorb")]
    for k, (name, act) in enumerate(steps):
        number = system.number[name]
        surface = surfaces[number]
        if space not in (surface.before, surface.after):
            problem = f"is not reached from {system.spaces[space]!r} (media do not join)"
            raise InputError("path", name, str(path), problem, "give the steps in the order in which light meets them")
        other = surface.after if space == surface.before else surface.before
        numbers.append(number)
        side.append(0.0 if surface.before == surface.after else 1.0 if space == surface.before else -1.0)
        before.append(space)
        coating, table = surface.face(int(space != surface.before))
        tables.append(table if act != "absorb" else None)
        mode.append(REFLECT if act == "reflect" else REFRACT)
        if act == "reflect":
            # Fresnel's factor and a table's angles need what lies behind.
            after.append(other if (coating.bare or table) and other >= 0 else space)
            weight.append(coating.reflectance)
            flips += [k] if coating.bare and other >= 0 else []
            phase += np.radians(coating.reflect_phase_deg)
        elif act == "transmit":
            if other < 0:
                raise InputError("path", name, str(path), "has nothing behind it", "reflect there")
            after.append(other)
            weight.append(coating.transmittance)
            phase += np.radians(coating.transmit_phase_deg)
            space = other
        else:
            after.append(space)
            weight.append(1.0)
        bare.append(int(coating.bare and act != "absorb"))
    rot, shift = _poses(system)
    start = [len(surfaces), *numbers[:-1]]
    return _Route(
        rot[start, numbers], shift[start, numbers], np.array([surfaces[k].curvature for k in numbers]),
        np.array([surfaces[k].conic for k in numbers]), np.array(before), np.array(after),
        np.array(mode, dtype=np.int64), np.array(side), np.array(weight), np.array(bare, dtype=np.int64),
        np.array([surfaces[k].aperture for k in numbers]), float(phase), np.array(flips, dtype=np.int64),
        tuple(tables), tuple(name for name, _ in steps), system.document.entrance.back_off_mm * 1e-3,
    )  # fmt: skip


@lru_cache(maxsize=4096)
def compile_sequence(system: OpticalSystem, path: Path, sigma: float) -> Sequence:
    """Arrays for one path at wavenumber ``sigma`` (1/m). Raises InputError where media do not join."""
    route, index = _route(system, path), system.index(sigma)
    n1, n2 = index[route.before], index[route.after]
    # A bare face turns the phase of what it reflects by π if light comes from the thinner medium.
    phase = route.phase + np.pi * int((n2[route.flips] > n1[route.flips]).sum())
    film, bare = _films(route, sigma)
    return Sequence(
        route.rot, route.shift, route.curvature, route.conic, n1, n2, route.mode, route.side, route.weight, bare,
        route.aperture, film, phase, route.names, route.back_off,
    )  # fmt: skip


def _films(route: _Route, sigma: float) -> tuple[Array, NDArray[np.int64]]:
    """Tables met along a route at one wavenumber (F, M, 5), padded behind their ends; ``bare`` with their numbers."""
    if not any(route.tables):
        return np.empty((0, 0, 5)), route.bare
    rows: list[Array] = []
    bare = route.bare.copy()
    for k, table in enumerate(route.tables):
        if table is not None:
            film = table.film(sigma)
            cubics = film.r if route.mode[k] == REFLECT else film.t
            bare[k] = FILM + len(rows)
            rows.append(np.column_stack([film.knot, cubics]))
    return pad_films(rows), bare


def pad_films(rows: list[Array]) -> Array:
    """Tables of coatings (M, 5) as one array (F, M, 5): the shorter ones repeat what stands behind their ends."""
    longest = max((len(row) for row in rows), default=0)
    padded = [np.vstack([row, np.tile(row[-1:], (longest - len(row), 1))]) for row in rows]
    return np.array(padded).reshape(len(rows), longest, 5)


def trace(sequence: Sequence, p: Array, theta: Array, footprints: bool = False, threads: int = 1) -> Traced:
    """Trace rays from entrance-pupil points along a sequence.

    p : (N, 2) m in the entrance pupil plane; theta : (N, 2) or (2,) direction cosines of the incoming light there.
    threads : how many share the rays; the result does not depend on it. Footprints are traced on one.
    """
    if footprints:
        return _run(sequence, p, theta, footprints)[0]
    count = len(p)
    ends, status = np.empty((7, count)), np.empty(count, dtype=np.int64)
    start, direction = np.ascontiguousarray(p), np.ascontiguousarray(np.atleast_2d(theta))

    def part(begin: int, end: int) -> None:
        trace_fan(*sequence.kernel, sequence.back_off, start, direction, begin, end, ends, status)

    share_out(part, count, threads)
    return Traced(ends[:2].T, ends[2:4].T, ends[4], ends[5], ends[6], status, np.empty((0, 2, count)))


def _run(sequence: Sequence, p: Array, theta: Array, footprints: bool, of: str = "") -> tuple[Traced, Array]:
    """Rays on the last surface, and their derivatives (T, 6, N): none, by "theta", by "p", or by both in that order."""
    p, theta = np.ascontiguousarray(p), np.ascontiguousarray(np.broadcast_to(theta, p.shape))
    count = len(p)
    tangents = {"": 0, "both": 4}.get(of, 2)
    rays, tangent, opl = np.empty((6, count)), np.empty((tangents, 6, count)), np.empty(count)
    power, clearance, status = np.ones(count), np.full(count, np.inf), np.zeros(count, dtype=np.int64)
    foot = np.empty((len(sequence.curvature) if footprints else 0, 2, count))
    launch(p, theta, sequence.back_off, sequence.n1[0], 2 if of == "p" else 0, rays, tangent, opl)
    trace_sequence(*sequence.kernel, rays, tangent, opl, power, status, clearance, foot)
    return Traced(rays[:2].T, rays[3:5].T, opl, power, clearance, status, foot), tangent


def trouble(sequence: Sequence, traced: Traced) -> dict[str, int]:
    """Counts of what stopped rays, by kind and surface, e.g. ``{"total internal reflection at L5_back": 12}``."""
    counts: dict[str, int] = {}
    for code in traced.status[traced.status > 0]:
        key = f"{WORDS[int(code) % KINDS]} {sequence.names[int(code) // KINDS - 1]}"
        counts[key] = counts.get(key, 0) + 1
    return counts


def jacobian(sequence: Sequence, p: Array, theta: Array, of: str = "theta") -> tuple[Array, Array]:
    """∂(x, q)/∂theta (or ∂/∂p), two (N, 2, 2) arrays [output, input]: the rays' own equations, differentiated.

    Infinite or NaN for rays that have no end.
    """
    return _matrices(_run(sequence, p, theta, False, of)[1])


@dataclass(frozen=True)
class Differentiated:
    """Rays with footprints, and ∂x, ∂q on the last surface by theta or p: (N, 2, 2) each, [output, input]; by both,
    (N, 2, 4), theta first."""

    traced: Traced
    dx: Array
    dq: Array


def trace_with_derivatives(sequence: Sequence, p: Array, theta: Array, of: str) -> Differentiated:
    """``trace`` with footprints and ``jacobian`` in one; of: "theta", "p" or "both"."""
    traced, tangent = _run(sequence, p, theta, True, of)
    return Differentiated(traced, *_matrices(tangent))


def _matrices(tangent: Array) -> tuple[Array, Array]:
    """∂x and ∂q, (N, 2, T) each, of tangents (T, 6, N)."""
    return tangent[:, :2].transpose(2, 1, 0), tangent[:, 3:5].transpose(2, 1, 0)


#: Aiming stops here: the first-order correction of the OPL then leaves less than 1e-16 m.
AIM_TOLERANCE = 1e-10
#: Traces of a ray at most, and its longest step in theta.
ROUNDS, LONGEST = 12, 0.1


@dataclass(frozen=True)
class Aimed:
    """Rays aimed at one detector point: theta (N, 2), 0 where ``ok`` (N,) is False; traced, with footprints if asked
    for; by_theta (N, 2, 2): ∂x/∂theta. Rows of rays that are not ok mean nothing."""

    theta: Array
    ok: NDArray[np.bool_]
    traced: Traced
    by_theta: Array


def aim_and_trace(sequence: Sequence, p: Array, target: Array, start: Array, footprints: bool = True) -> Aimed:
    """Aim rays from pupil points ``p`` (N, 2) at the detector point ``target`` (2,), from ``start`` (2,) or (N, 2)."""
    theta, count = np.array(np.broadcast_to(start, p.shape), dtype=np.float64, order="C"), len(p)
    rays, tangent, opl, power = np.empty((6, count)), np.empty((2, 6, count)), np.empty(count), np.empty(count)
    clearance, status = np.empty(count), np.empty(count, dtype=np.int64)
    foot = np.zeros((len(sequence.curvature) if footprints else 0, 2, count))
    ok = aim_rays(*sequence.kernel, sequence.back_off, np.ascontiguousarray(p), np.ascontiguousarray(target), theta,
                  AIM_TOLERANCE, LONGEST, ROUNDS, rays, tangent, opl, power, status, clearance, foot)  # fmt: skip
    traced = Traced(rays[:2].T, rays[3:5].T, opl, power, clearance, status, foot)
    return Aimed(np.where(ok[:, None], theta, 0.0), ok, traced, _matrices(tangent)[0])


def aim(sequence: Sequence, p: Array, target: Array, start: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Directions with which rays from pupil points ``p`` (N, 2) end on the detector point ``target`` (2,), by Newton.

    start : (2,) or (N, 2) first guess. Returns theta (N, 2) and a mask of the rays that converged.
    """
    aimed = aim_and_trace(sequence, p, target, start, footprints=False)
    return aimed.theta, aimed.ok


def history(sequence: Sequence, p: Array, theta: Array) -> Array:
    """Points (K + 1, N, 3) in the pupil's frame, m, where rays start and where they meet every surface.

    NaN from where a ray meets nothing.
    """
    foot = trace(sequence, p, theta, footprints=True).foot
    foot = np.where(np.isfinite(foot), foot, np.nan)
    points = np.empty((len(sequence.curvature) + 1, len(p), 3))
    points[0] = np.column_stack([p, np.zeros(len(p))])
    axes, origin = np.eye(3), np.zeros(3)
    for k, (x, y) in enumerate(foot):
        origin = origin + axes.T @ sequence.shift[k]
        axes = sequence.rot[k] @ axes
        c, r2 = sequence.curvature[k], x * x + y * y
        z = c * r2 / (1 + np.sqrt(np.maximum(1 - (1 + sequence.conic[k]) * c * c * r2, 0)))
        points[k + 1] = np.column_stack([x, y, z]) @ axes + origin
    return points


def caustics(sequence: Sequence, p: Array, theta: Array, vary: str) -> int:
    """Number of caustics that the ray (p, theta) crosses before the end of its sequence (Maslov index).

    vary : "theta" for light from one pupil point (conjugate points of G(p, x)), "p" for light from one direction
    (foci of a plane wave).
    """
    # Planes make no caustic; before the first curved surface the only zero is the pupil that was launched from.
    powered = np.flatnonzero(sequence.curvature)
    if len(powered) == 0:
        return 0
    rays, tangent, opl = np.empty((6, 1)), np.empty((2, 6, 1)), np.empty(1)
    launch(p[None], theta[None], sequence.back_off, sequence.n1[0], 0 if vary == "theta" else 2, rays, tangent, opl)
    s = sequence
    return int(count_caustics(s.rot, s.shift, s.curvature, s.conic, s.n1, s.n2, s.mode, powered[0], rays, tangent))
