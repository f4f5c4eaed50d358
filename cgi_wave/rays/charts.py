"""Charts: coordinates in which the rays of a point source are one to one with their field, and its phase in them.

A field on the detector is a sum over rays where one ray goes through each point x; its transform is one where one ray
goes in each direction q. A ghost that is collimated at the detector, or whose directions fold, has the first and not
the second; a focused beam has the second and not the first. In between lies a family of charts,

    u = q − b (x − x0),

the directions behind a thin lens of power b that is held onto the detector. A lens turns the phase of both beams of a
pair at each point by the same, so that their overlap ∫ h_m h_l* d²x is what it was; b = 0 are the directions
themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError, MethodLimitError
from cgi_wave.kernels.trace import clearance_rows
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import Path
from cgi_wave.rays.trace import Sequence, Traced, caustics, compile_sequence, trace_with_derivatives, trouble

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PupilRays:
    """Rays of one path and one source direction from chosen points of the entrance pupil; those that failed are out.

    p (N, 2) m; x (N, 2) m from x0, on the detector; q (N, 2) direction cosines there; opl (N,) m: Λ − q·(x − x0), with
    the p·θ of the incoming plane wave in it; power (N,) of the coatings; clearance (K, N), that of the entrance pupil
    first; catch (K', N): of the detector's edge, which is not among these; dx, dq (N, 2, 2): ∂x/∂p and ∂q/∂p.
    """

    sequence: Sequence
    theta: Array
    p: Array
    x: Array
    q: Array
    opl: Array
    power: Array
    clearance: Array
    catch: Array
    dx: Array
    dq: Array

    def chart(self, bend: float) -> tuple[Array, Array, Array]:
        """u (N, 2), path length about it (N,), m, and det ∂u/∂p (N,), 1/m², in the chart of ``bend``, 1/m."""
        opl = self.opl + 0.5 * bend * (self.x**2).sum(axis=1)
        return self.q - bend * self.x, opl, determinants(self.dq - bend * self.dx)

    def phase(self, ray: int, bend: float) -> float:
        """Constant phase of the path in the chart of ``bend``, by one ray; see ``ray_phase``."""
        return ray_phase(self.sequence, self.p[ray], self.theta, self.dx[ray], self.dq[ray], bend)

    def some(self, keep: NDArray[np.bool_]) -> PupilRays:
        """The rays of a mask (N,)."""
        return PupilRays(self.sequence, self.theta, self.p[keep], self.x[keep], self.q[keep], self.opl[keep],
                         self.power[keep], self.clearance[:, keep], self.catch[:, keep],
                         self.dx[keep], self.dq[keep])  # fmt: skip


def rays_from_points(
    system: OpticalSystem, path: Path, theta: Array, x0: Array, sigma: float, points: Array
) -> PupilRays:
    """Rays from pupil points (N, 2), m, of source direction theta (2,), on the plane of the detector, also beyond it.

    Raises EmptyBeamError if all of them fail, MethodLimitError if rays pass every aperture and yet are no light (lines
    carried backwards): no clearance tells where these end.
    """
    edged = compile_sequence(system, path, sigma)
    sequence = edged.beyond()
    found = trace_with_derivatives(sequence, points, theta, "p")
    keep = found.traced.valid
    if not keep.any():
        raise EmptyBeamError(f"{path.label}: no ray of direction {theta} arrives; {trouble(sequence, found.traced)}")
    phantom = int((keep & (found.traced.clearance > 0.0) & ~found.traced.passes).sum())
    if phantom:
        raise MethodLimitError(
            "rays over the pupil",
            f"{path.label}: {phantom} of {len(points)} rays pass every aperture, but {trouble(sequence, found.traced)}",
            phantom / len(points),
            "give the aperture that stops them",
        )
    traced, p, dx, dq = found.traced, points, found.dx, found.dq
    if not keep.all():
        traced, p, dx, dq = traced.some(keep), p[keep], dx[keep], dq[keep]
    q, opl = in_chart(traced, p, theta, x0, 0.0)
    pupil = 1.0 - (p**2).sum(axis=1) / system.pupil_radius**2
    clearance = np.concatenate([pupil[None], clearance_rows(sequence.aperture[:-1], traced.foot)])
    catch = clearance_rows(edged.aperture[-1:], traced.foot[-1:])
    return PupilRays(sequence, theta, p, traced.x - x0, q, opl, traced.power, clearance, catch, dx, dq)


def in_chart(traced: Traced, p: Array, theta: Array, x0: Array, bend: float) -> tuple[Array, Array]:
    """u (N, 2) and path length (N,), m, about it."""
    away = traced.x - x0
    # The incoming plane wave reaches pupil point p with the phase of p·θ.
    opl = traced.opl + p @ theta - (traced.direction * away).sum(axis=1)
    if bend == 0.0:
        return traced.direction, opl
    return traced.direction - bend * away, opl + 0.5 * bend * (away**2).sum(axis=1)


def ray_phase(sequence: Sequence, p: Array, theta: Array, dx: Array, dq: Array, bend: float) -> float:
    """Constant phase of a path in the chart of ``bend``, rad: coatings, caustics crossed, the turn from x to u.

    By one ray; the same for all between which det ∂u/∂p has one sign.
    """
    crossed = caustics(sequence, p, theta, "p")
    # From position to u by stationary phase: exp(iπ/4 · signature of ∂u/∂x).
    # Both eigenvalues have the sign of the trace, or opposite ones.
    (a, b), (c, d) = dx.tolist()
    inverse = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    (a, b), (c, d) = (dq @ inverse).tolist()
    a, d = a - bend, d - bend
    signature = 2.0 * np.sign(a + d) if a * d - b * c > 0.0 else 0.0
    return float(sequence.phase - 0.5 * np.pi * crossed + 0.25 * np.pi * signature)


def determinants(matrices: Array) -> Array:
    """Determinants (N,) of (N, 2, 2)."""
    value: Array = matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]
    return value
