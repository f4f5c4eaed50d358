"""Tracing along a path: sequences compiled for the kernel, rays from the entrance pupil, aiming at a detector point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.kernels.trace import BACKWARD, MISS, REFLECT, REFRACT, TIR, trace_sequence
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import Path

Array = NDArray[np.float64]


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
    weight: Array
    bare: NDArray[np.int64]
    aperture: Array
    phase: float
    names: tuple[str, ...]
    back_off: float

    def upto(self, count: int) -> Sequence:
        """The first ``count`` surfaces of the sequence."""
        return Sequence(
            self.rot[:count], self.shift[:count], self.curvature[:count], self.conic[:count], self.n1[:count],
            self.n2[:count], self.mode[:count], self.weight[:count], self.bare[:count], self.aperture[:count],
            self.phase, self.names[:count], self.back_off,
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

    @property
    def passes(self) -> NDArray[np.bool_]:
        """Rays that reach the last surface inside every aperture, really and not virtually."""
        return (self.status == 0) & (self.clearance > 0)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Rays that have an intersection everywhere (apertures and virtual surfaces disregarded)."""
        return ((self.status == 0) | (self.status % 4 == BACKWARD)) & np.isfinite(self.opl)


@lru_cache(maxsize=4096)
def compile_sequence(system: OpticalSystem, path: Path, sigma: float) -> Sequence:
    """Arrays for one path at wavenumber ``sigma`` (1/m). Raises InputError where media do not join."""
    index = system.index(sigma)
    axes, origin = system.pupil_frame()
    space = system.spaces.index(system.document.entrance.space)
    rot, shift, numbers = [], [], []
    n1, n2, mode, weight, bare = [], [], [], [], []
    phase = 0.0
    steps = [*path.steps, (system.surfaces[system.detector].name, "absorb")]
    for name, act in steps:
        surface = system.surfaces[system.number[name]]
        if space not in (surface.before, surface.after):
            problem = f"is not reached from {system.spaces[space]!r} (media do not join)"
            raise InputError("path", name, str(path), problem, "give the steps in the order in which light meets them")
        other = surface.after if space == surface.before else surface.before
        rot.append(surface.rotation @ axes.T)
        shift.append(axes @ (surface.origin - origin))
        axes, origin = surface.rotation, surface.origin
        numbers.append(surface)
        n1.append(index[space])
        coating = surface.coating
        if act == "reflect":
            mode.append(REFLECT)
            n2.append(index[other] if coating.bare and other >= 0 else index[space])
            weight.append(coating.reflectance)
            flip = coating.bare and other >= 0 and index[other] > index[space]
            phase += np.pi * flip + np.radians(coating.reflect_phase_deg)
        elif act == "transmit":
            if other < 0:
                raise InputError("path", name, str(path), "has nothing behind it", "reflect there")
            mode.append(REFRACT)
            n2.append(index[other])
            weight.append(coating.transmittance)
            phase += np.radians(coating.transmit_phase_deg)
            space = other
        else:
            mode.append(REFRACT)
            n2.append(index[space])
            weight.append(1.0)
        bare.append(int(coating.bare and act != "absorb"))
    return Sequence(
        np.array(rot), np.array(shift), np.array([s.curvature for s in numbers]), np.array([s.conic for s in numbers]),
        np.array(n1), np.array(n2), np.array(mode, dtype=np.int64), np.array(weight), np.array(bare, dtype=np.int64),
        np.array([s.aperture for s in numbers]), float(phase), tuple(name for name, _ in steps),
        system.document.entrance.back_off_mm * 1e-3,
    )  # fmt: skip


def trace(sequence: Sequence, p: Array, theta: Array, footprints: bool = False) -> Traced:
    """Trace rays from entrance-pupil points along a sequence.

    p : (N, 2) m in the entrance pupil plane; theta : (N, 2) or (2,) direction cosines of the incoming light there.
    """
    theta = np.broadcast_to(theta, p.shape)
    count = len(p)
    rays = np.zeros((6, count))
    rays[3:5] = theta.T
    rays[5] = np.sqrt(1.0 - (theta**2).sum(axis=1))
    rays[:2] = p.T
    rays[:3] -= sequence.back_off * rays[3:]
    opl, power, clearance = np.full(count, -sequence.back_off * sequence.n1[0]), np.ones(count), np.full(count, np.inf)
    status = np.zeros(count, dtype=np.int64)
    foot = np.empty((len(sequence.curvature) if footprints else 0, 2, count))
    s = sequence
    trace_sequence(s.rot, s.shift, s.curvature, s.conic, s.n1, s.n2, s.mode, s.weight, s.bare, s.aperture, rays, opl,
                   power, status, clearance, foot)  # fmt: skip
    return Traced(rays[:2].T.copy(), rays[3:5].T.copy(), opl, power, clearance, status, foot)


def trouble(sequence: Sequence, traced: Traced) -> dict[str, int]:
    """Counts of what stopped rays, by kind and surface, e.g. ``{"total internal reflection at L5_back": 12}``."""
    words = {MISS: "missed", TIR: "total internal reflection at", BACKWARD: "virtual at"}
    counts: dict[str, int] = {}
    for code in traced.status[traced.status > 0]:
        key = f"{words[int(code) % 4]} {sequence.names[int(code) // 4 - 1]}"
        counts[key] = counts.get(key, 0) + 1
    return counts


def jacobian(sequence: Sequence, p: Array, theta: Array, step: float, of: str = "theta") -> tuple[Array, Array]:
    """∂(x, q)/∂theta (or ∂/∂p), two (N, 2, 2) arrays [output, input], by central differences of ``step``."""
    columns = []
    for axis in range(2):
        delta = np.zeros(2)
        delta[axis] = step
        a, b = (
            (trace(sequence, p, theta + delta), trace(sequence, p, theta - delta))
            if of == "theta"
            else (trace(sequence, p + delta, theta), trace(sequence, p - delta, theta))
        )
        columns.append(((a.x - b.x) / (2 * step), (a.direction - b.direction) / (2 * step)))
    return np.stack([c[0] for c in columns], axis=2), np.stack([c[1] for c in columns], axis=2)


THETA_STEP = 2e-5
#: Aiming stops here: the first-order correction of the OPL then leaves less than 1e-16 m.
AIM_TOLERANCE = 1e-10


def aim(
    sequence: Sequence, p: Array, target: Array, start: Array, matrix: Array | None = None, iterations: int = 12
) -> tuple[Array, NDArray[np.bool_]]:
    """Directions with which rays from pupil points ``p`` (N, 2) end on the detector point ``target`` (2,), by Newton.

    start : (2,) or (N, 2) first guess; matrix (N, 2, 2): ∂x/∂theta where the guess is so good that it need not be
    renewed. Returns theta (N, 2) and a mask of the rays that converged.
    """
    theta = np.array(np.broadcast_to(start, p.shape))
    todo = np.ones(len(p), dtype=bool)
    renew = 3 if matrix is None else 0
    matrix = np.empty((len(p), 2, 2)) if matrix is None else matrix
    for turn in range(iterations):
        where = np.flatnonzero(todo)
        if len(where) == 0:
            break
        now = trace(sequence, p[where], theta[where])
        miss = target - now.x
        good = now.valid & (np.hypot(miss[:, 0], miss[:, 1]) < 1.0)
        done = good & (np.abs(miss).max(axis=1) < AIM_TOLERANCE)
        todo[where[done]] = False
        if turn < renew:
            # The map from theta to x is nearly linear: its matrix is renewed only while the steps are large.
            matrix[where] = jacobian(sequence, p[where], theta[where], THETA_STEP)[0]
        move = where[good & ~done]
        if len(move) == 0:
            break
        # Where a neighbouring ray fails there is no matrix; where it is singular, x does not answer to theta.
        move = move[np.isfinite(matrix[move]).all(axis=(1, 2))]
        move = move[np.abs(np.linalg.det(matrix[move])) > 1e-14]
        delta = np.linalg.solve(matrix[move], miss[np.isin(where, move)][:, :, None])[:, :, 0]
        # A ghost far out of focus can throw the first step out of the field: shorten it.
        size = np.hypot(delta[:, 0], delta[:, 1])
        theta[move] += delta * np.minimum(1.0, 0.1 / np.maximum(size, 1e-300))[:, None]
        lost = np.hypot(theta[:, 0], theta[:, 1]) > 0.5
        theta[lost] = np.nan
        todo &= ~lost
    final = ~todo & np.isfinite(theta).all(axis=1)
    return np.where(final[:, None], theta, 0.0), final


def history(sequence: Sequence, p: Array, theta: Array) -> Array:
    """Points (K + 1, N, 3) in the pupil's frame, m, where rays start and where they meet every surface."""
    foot = trace(sequence, p, theta, footprints=True).foot
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
    (foci of a plane wave). A wavefront's two focal points on each segment follow from three neighbouring rays.
    """
    step = 1e-6 if vary == "theta" else 1e-6 * 16.0
    steps = np.array([[0, 0], [step, 0], [0, step]])
    fixed = np.zeros_like(steps)
    points = history(sequence, p + (steps if vary == "p" else fixed), theta + (steps if vary == "theta" else fixed))
    # Planes make no caustic; before the first curved surface the only zero is the pupil that was launched from.
    powered = np.flatnonzero(sequence.curvature)
    first = powered[0] + 1 if len(powered) else len(points) - 1
    along = np.diff(points, axis=0)[first:]
    start = points[first:-1]
    length = np.linalg.norm(along, axis=2, keepdims=True)
    direction = along / length
    chief = direction[:, 0]
    helper = np.where(np.abs(chief[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    e1 = np.cross(chief, helper)
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    basis = np.stack([e1, np.cross(chief, e1)], axis=2)
    # Neighbours relative to the chief ray, in planes across it: base + s·rate, s along the chief ray.
    slope = direction[:, 1:] / np.einsum("kni,ki->kn", direction[:, 1:], chief)[:, :, None]
    gap = start[:, 1:] - start[:, :1]
    base = (gap - np.einsum("kni,ki->kn", gap, chief)[:, :, None] * slope) @ basis
    rate = slope @ basis
    # det(base + s·rate) = a s² + b s + c. A wavefront's curvature is symmetric: its roots are real but for rounding.
    a, c = np.linalg.det(rate), np.linalg.det(base)
    b = base[:, 0, 0] * rate[:, 1, 1] + rate[:, 0, 0] * base[:, 1, 1]
    b = b - base[:, 0, 1] * rate[:, 1, 0] - rate[:, 0, 1] * base[:, 1, 0]
    root = np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))
    # 1/s is finite where the wavefront is plane: count roots of c u² + b u + a beyond 1/length.
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.stack([(-b + root) / (2.0 * c), (-b - root) / (2.0 * c)])
    return int(np.count_nonzero(inverse > 1.0 / length[:, 0, 0]))
