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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError, MethodLimitError
from cgi_wave.kernels.beams import clearance_rows, mark_near, rows_of, valid_rays
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import Path
from cgi_wave.rays.trace import Sequence as Surfaces
from cgi_wave.rays.trace import caustics, compile_sequence, trace_with_derivatives, trouble

Array = NDArray[np.float64]

#: An aperture that is passed with this much room over the whole sampled disc cannot cut the beam.
COMFORTABLE = 0.25


@dataclass(frozen=True)
class PupilRays:
    """Rays of one path and one source direction from chosen points of the entrance pupil; those that failed are out.

    p (N, 2) m; x (N, 2) m from x0, on the detector; q (N, 2) direction cosines there; opl (N,) m: Λ − q·(x − x0), with
    the p·θ of the incoming plane wave in it; power (N,) of the coatings; clearance (K, N), that of the entrance pupil
    first, then those of apertures that these rays come near to; catch (K', N): those of the detector's edge, which does
    not end them; dx, dq (N, 2, 2): ∂x/∂p and ∂q/∂p.
    """

    sequence: Surfaces
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
    keep = np.empty(len(points), dtype=np.bool_)
    count, _ = valid_rays(found.traced.status, found.traced.opl, points, keep)
    if not count:
        raise EmptyBeamError(f"{path.label}: no ray of direction {theta} arrives; {trouble(sequence, found.traced)}")
    phantom = int((keep & (found.traced.clearance > 0.0) & ~found.traced.passes).sum())
    if phantom:
        raise MethodLimitError(
            "rays over the pupil",
            f"{path.label}: {phantom} of {len(points)} rays pass every aperture, but {trouble(sequence, found.traced)}",
            phantom / len(points),
            "give the aperture that stops them",
        )
    rows = near_clearances(edged.aperture, [found.traced.foot], keep, points, system.pupil_radius, True)
    clearance, catch = rows[0][:, 0], rows[1][:, 0]
    traced, p, dx, dq = found.traced, points, found.dx, found.dq
    if count < len(points):
        traced, p, dx, dq = traced.some(keep), p[keep], dx[keep], dq[keep]
    away = traced.x - x0
    # The incoming plane wave reaches pupil point p with the phase of p·θ.
    opl = traced.opl + p @ theta - (traced.direction * away).sum(axis=1)
    return PupilRays(sequence, theta, p, away, traced.direction, opl, traced.power, clearance, catch, dx, dq)


def near_clearances(
    aperture: Array, feet: Sequence[Array], keep: NDArray[np.bool_], p: Array, radius: float, beyond: bool = False
) -> tuple[Array, Array]:
    """Clearances (K', S, M) of the rays of a mask (N,): that of the pupil, then those that are not comfortable.

    Those of the last aperture are told apart if the beam goes on ``beyond`` it, (K'', S, M), else none.

    aperture (K, APERTURE_COLUMNS); feet: footprints (K, 2, N) at S wavenumbers; p (N, 2): pupil points, m, and the
    pupil's radius. 1 at the centre of an aperture, 0 at its edge, smooth: a rectangle has four.
    """
    near = np.zeros(rows_of(aperture), dtype=np.bool_)
    for foot in feet:
        mark_near(aperture, foot, keep, COMFORTABLE, near)
    out = np.empty((1 + np.count_nonzero(near), len(feet), np.count_nonzero(keep)))
    for s, foot in enumerate(feet):
        clearance_rows(aperture, foot, keep, p, radius, near, out[:, s])
    bounding = len(out) - (int(np.count_nonzero(near[rows_of(aperture[:-1]) :])) if beyond else 0)
    return out[:bounding], out[bounding:]


def ray_phase(sequence: Surfaces, p: Array, theta: Array, dx: Array, dq: Array, bend: float) -> float:
    """Constant phase of a path in the chart of ``bend``, rad: coatings, caustics crossed, the turn from x to u.

    By one ray; the same for all between which det ∂u/∂p has one sign.
    """
    crossed = caustics(sequence, p, theta, "p")
    # From position to u by stationary phase: exp(iπ/4 · signature of ∂u/∂x).
    # Both eigenvalues have the sign of the trace, or opposite ones.
    (a, b), (c, d) = dx.tolist()
    (e, f), (g, h) = dq.tolist()
    det = a * d - b * c
    a, b, c, d = (e * d - f * c) / det, (f * a - e * b) / det, (g * d - h * c) / det, (h * a - g * b) / det
    a, d = a - bend, d - bend
    signature = (2.0 if a + d > 0.0 else -2.0) if a * d - b * c > 0.0 else 0.0
    return sequence.phase - 0.5 * np.pi * crossed + 0.25 * np.pi * signature


def determinants(matrices: Array) -> Array:
    """Determinants (N,) of (N, 2, 2)."""
    value: Array = matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]
    return value
