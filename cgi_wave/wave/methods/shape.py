"""What a sampling method has to know of its beams beforehand: edges, slopes, extents, and the light that edges scatter.

h(x) = σ ∫ A(u) exp(i 2πσ (opl(u) + u·x)) d²u is the amplitude PSF of a field, x the coordinate conjugate to u (m on the
detector in direction space), so that ∫|h|² d²x = ∫A² d²u. Rays of slope ∂opl/∂u land at x = −∂opl/∂u.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError, InputError
from cgi_wave.wave.basis import Array, at_points
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.region import Support, build, find_region

TURN = 2.0 * np.pi
#: A straight edge spreads ∮A² dl / (2π²σR) of its light beyond a distance R: half each way. For a disc this is the
#: 2/(πv), v = 2πσaR, by which the encircled energy of Airy's pattern falls short of 1.
EDGE_SPREAD = 1.0 / (2.0 * np.pi**2)


@dataclass(frozen=True)
class Beam:
    """One field at one wavenumber sigma, 1/m.

    path : (n, n) m, without its constant term; slopes : (2, n, n) ∂opl/∂u, m per unit of u; amplitude : (n, n), all
    Chebyshev products on the support's scaled coordinates. constant : exp(i 2πσ·path constant + i phase).
    phase_misfit : rad; amplitude_misfit : unit of the amplitude; power_error : relative
    """

    label: str
    support: Support
    sigma: float
    path: Array
    slopes: Array
    amplitude: Array
    constant: complex
    power: float
    phase_misfit: float
    amplitude_misfit: float
    power_error: float

    def scaled(self, u: Array) -> Array:
        """Points u (N, 2) in the coordinates of the polynomials."""
        return (u - self.support.centre) / self.support.scale

    def slope_at(self, u: Array) -> Array:
        """(N, 2) ∂opl/∂u at points u (N, 2), m per unit of u: minus where the ray lands."""
        return at_points(self.slopes, self.scaled(u)).T

    def amplitude_at(self, u: Array) -> Array:
        """(N,) amplitude at points u (N, 2)."""
        return at_points(self.amplitude, self.scaled(u))

    def values(self, u: Array) -> NDArray[np.complex128]:
        """(N,) complex field at points u (N, 2), without ``constant``."""
        at = self.scaled(u)
        waves = at_points(self.path, at) * self.sigma
        field: NDArray[np.complex128] = at_points(self.amplitude, at) * np.exp(2j * np.pi * (waves - np.rint(waves)))
        return field


@dataclass(frozen=True)
class Edge:
    """The boundary of a common support as a rule for line integrals, and points inside.

    u : (B, 2) points; normal : (B, 2) outward normal times the line element, unit of u
    strip : area that the misfit of the clearances leaves open, u²; area : of the support, u²
    inside : (G, 2) points of a grid inside; curves : number of clearances that bound it
    """

    u: Array
    normal: Array
    strip: float
    area: float
    inside: Array
    curves: int

    @property
    def length(self) -> Array:
        """(B,) line elements, unit of u."""
        return np.hypot(*self.normal.T)


def beam_at(field: PupilField, sigma: float) -> Beam:
    """A field at one wavenumber (1/m). Raises MethodLimitError outside those it was traced for."""
    if not np.isfinite(sigma) or sigma <= 0.0:
        raise InputError(field.label, "sigma", sigma, "not a positive wavenumber", "give 1/m")
    weights = field.weights(np.array([sigma]))[0]
    path = np.tensordot(weights, field.opl, 1)
    cycles = float(path[0, 0]) * sigma
    constant = complex(np.exp(2j * np.pi * (cycles - np.rint(cycles)) + 1j * field.phase))
    path[0, 0] = 0.0
    n = path.shape[-1]
    slopes = np.zeros((2, n, n))
    slopes[0, : n - 1], slopes[1, :, : n - 1] = chebyshev.chebder(path, axis=0), chebyshev.chebder(path, axis=1)
    return Beam(
        field.label,
        field.support,
        sigma,
        path,
        slopes / field.support.scale[:, None, None],
        np.tensordot(weights, field.amplitude, 1),
        constant,
        float(field.power_at(np.array([sigma]))[0]),
        2.0 * np.pi * sigma * field.opl_residual,
        field.amplitude_residual,
        field.power_error,
    )


def find_edge(supports: Sequence[Support]) -> Edge | None:
    """The boundary of the supports' common region, or None when they do not meet."""
    region = find_region(supports)
    if region is None:
        return None
    q = build(region, np.zeros((1, 2, 2)), 0.0, 0)
    theta = q.rays[:, 0]
    points, normals, strip = [], [], 0.0
    for end in (0, 1):
        rho, owner = q.rays[:, 2 + end], q.owner[:, end]
        for k in range(len(region.clearance)):
            on = owner == k
            if not on.any():
                continue
            x, y = rho[on] * np.cos(theta[on]), rho[on] * np.sin(theta[on])
            gx, gy = _gradient(region.clearance[k], x, y)
            # Along the boundary dr = (−g_y, g_x) ρ/(g·e_ρ) dθ; the frame's stretch turns it into du.
            pace = rho[on] * q.rays[on, 1] / (gx * np.cos(theta[on]) + gy * np.sin(theta[on])) * (1 - 2 * (1 - end))
            tangent = np.column_stack([-gy, gx]) * pace[:, None] * region.frame
            normals.append(np.column_stack([tangent[:, 1], -tangent[:, 0]]))
            points.append(region.pivot + region.frame * np.column_stack([x, y]))
            width = region.residual[k] / np.hypot(gx / region.frame[0], gy / region.frame[1])
            strip += float(np.sum(width * np.hypot(*tangent.T)))
    if not points:
        raise EmptyBeamError("the common support has no edge of its own: its clearances do not bound it")
    u, normal = np.concatenate(points), np.concatenate(normals)
    area = 0.5 * float(np.sum((u - region.pivot) * normal))
    return Edge(u, normal, strip, area, region.pivot + region.frame * region.extent, len(region.clearance))


def _gradient(coef: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """∂/∂x, ∂/∂y of powers (n, n) at points."""
    gx = polynomial.polyval2d(x, y, polynomial.polyder(coef, axis=0))
    gy = polynomial.polyval2d(x, y, polynomial.polyder(coef, axis=1))
    return np.asarray(gx), np.asarray(gy)


@dataclass(frozen=True)
class Pair:
    """Two beams of one space about one reference point, and the edges of each and of their common support."""

    m: Beam
    l: Beam  # noqa: E741
    common: Edge
    own: tuple[Edge, Edge]

    @property
    def norm(self) -> float:
        """√(P_m P_l)."""
        return float(np.sqrt(self.m.power * self.l.power))

    @property
    def constant(self) -> complex:
        """Phase of m against l that both fields carry everywhere."""
        return self.m.constant * self.l.constant.conjugate()

    @property
    def misfit(self) -> float:
        """What the residuals of the two fits can change of γ: phase, amplitude, power, and the strip at the edge."""
        m, l = self.m, self.l  # noqa: E741
        phase = min(m.phase_misfit + l.phase_misfit, 2.0)
        amplitude = sum(b.amplitude_misfit * np.sqrt(self.common.area / b.power) for b in (m, l))
        product = np.abs(m.amplitude_at(self.common.u) * l.amplitude_at(self.common.u)).max()
        return phase + amplitude + 0.5 * (m.power_error + l.power_error) + self.common.strip * product / self.norm

    @property
    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner (2,), (2,) of what holds both supports, units of u."""
        u = np.concatenate([e.u for e in self.own])
        return u.min(axis=0), u.max(axis=0)

    @property
    def rounding(self) -> float:
        """What double precision leaves of the phases."""
        size = sum(float(np.abs(b.path).sum()) * b.sigma for b in (self.m, self.l))
        return 4e-16 * (TURN * size + 10.0)


def check_pair(m: PupilField, l: PupilField) -> None:  # noqa: E741
    """Raises InputError for fields of different spaces or about different reference points."""
    if m.space != l.space or not np.allclose(m.reference_point, l.reference_point, rtol=0, atol=1e-12):
        raise InputError(
            f"pair {m.label} | {l.label}",
            "reference_point",
            (m.space, m.reference_point, l.space, l.reference_point),
            "the two fields stand in different spaces or about different points",
            "sample both about one detector point",
        )


def find_pair(m: PupilField, l: PupilField, sigma: float) -> Pair | None:  # noqa: E741
    """Both beams at sigma, 1/m; None when their supports do not meet.

    Raises InputError for fields of different spaces or reference points, EmptyBeamError for a support without light.
    """
    check_pair(m, l)
    common = find_edge([m.support, l.support])
    if common is None:
        return None
    own = tuple(edge_of(field) for field in (m, l))
    return Pair(beam_at(m, sigma), beam_at(l, sigma), common, (own[0], own[1]))


def edge_of(field: PupilField) -> Edge:
    """The edge of one field's own support. Raises EmptyBeamError where there is none."""
    edge = find_edge([field.support])
    if edge is None:
        raise EmptyBeamError(f"{field.label}: the fitted support is empty")
    return edge


def edge_law(theta: Array) -> Array:
    """Error of a gray sampled edge per unit of A dl · pitch, for a phase step theta (rad) per cell along its normal.

    The edge of ∫exp(iθt) dt contributes 1/(iθ). With cells at the edge weighted by their share, the sum is that times
    sinc(θ/2π) on the mean over all positions of the edge in its cell: a loss of (1 − sinc)/θ → θ/24. Replicas at
    θ + 2πn add at most Σ 2|sin(θ/2)|/(θ + 2πn)², in full when an edge lies along the grid: → θ/12 more. The bound is
    the sum. It is finite for |θ| < 2π, where a replica of the geometric spot would arrive.
    """
    t = np.maximum(np.abs(np.asarray(theta, float)), 1e-4)
    half = np.abs(np.sin(0.5 * np.minimum(t, TURN * (1.0 - 1e-3))))
    mean = (1.0 - np.sinc(t / TURN)) / t
    return np.asarray(mean + 0.5 / half - 2.0 * half / t**2)


def scattered(beam: Beam, edge: Edge, centre: Array, half: Array) -> float:
    """Estimate of the share of a beam's light outside the rectangle centre ± half (2,), m: what its edges scatter.

    Each edge element sends half of it along either normal from where its ray lands. Rays that land outside count 1.
    The estimate is 1.2 times the asymptotic law, whose ripple it covers beyond the first few rings.
    """
    inside = np.abs(-beam.slope_at(edge.inside) - centre) < half
    if not inside.all():
        return 1.0
    lands = -beam.slope_at(edge.u) - centre
    length = edge.length
    n = edge.normal / length[:, None]
    total = 0.0
    for way in (1.0, -1.0):
        with np.errstate(divide="ignore"):
            reach = np.where(np.abs(n) > 1e-12, (half - way * np.sign(n) * lands) / np.abs(n), np.inf).min(axis=1)
        if np.any(reach <= 0.0):
            return 1.0
        total += 0.5 * float(np.sum(beam.amplitude_at(edge.u) ** 2 * length / reach))
    return min(1.0, 1.2 * EDGE_SPREAD * total / (beam.sigma * beam.power))
