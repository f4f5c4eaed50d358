"""Nodes and weights that follow the pupil's true boundary: what NUFFT and direct summation sum over.

h(x) = σ Σ_j c_j exp(i 2πσ u_j·x) for |x| up to a reach, c_j = weight · A(u_j) exp(i 2πσ·opl(u_j)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError, MethodLimitError
from cgi_wave.kernels import pupil
from cgi_wave.wave.basis import Array, expand
from cgi_wave.wave.methods.shape import TURN, Beam
from cgi_wave.wave.region import METHOD, NODE_CAP, build, find_region

_KEPT = 1000.0  # rad of phase up to which rings are kept for the next patch of that size: a hundred thousand nodes
_POLAR_CAP = 1500  # turns of phase from centre to rim beyond which panels take over from one Gauss rule


@dataclass(frozen=True)
class Nodes:
    """u (M, 2) and strengths (M,) complex, without the beam's constant."""

    u: Array
    strength: NDArray[np.complex128]


def panel_nodes(beam: Beam, reach: float, level: int) -> Nodes:
    """Gauss panels fitted to the boundary, for |x| <= reach (m) at a refinement level.

    Raises MethodLimitError beyond the node cap.
    """
    s = beam.support
    region = find_region([s])
    if region is None:
        raise EmptyBeamError(f"{beam.label}: the fitted support is empty")
    n = region.terms
    phase = expand(beam.path, s.centre, s.scale, region.pivot, region.frame, n)[None] * beam.sigma
    tilt = beam.sigma * reach * float(region.frame.max())
    q = build(region, phase, tilt, level)
    listed = pupil.list_nodes(q.rays, q.panels, phase, tilt)
    u = region.pivot + region.frame * listed[:, :2]
    return Nodes(u, listed[:, 2] * float(np.prod(region.frame)) * beam.values(u))


def estimate_nodes(beam: Beam, reach: float, level: int) -> int:
    """Number of nodes that ``panel_nodes`` will make. Raises MethodLimitError beyond the node cap."""
    s = beam.support
    region = find_region([s])
    if region is None:
        raise EmptyBeamError(f"{beam.label}: the fitted support is empty")
    n = region.terms
    phase = expand(beam.path, s.centre, s.scale, region.pivot, region.frame, n)[None] * beam.sigma
    nodes = build(region, phase, beam.sigma * reach * float(region.frame.max()), level).nodes
    if nodes > NODE_CAP:
        raise MethodLimitError(METHOD, f"{nodes} nodes (limit {NODE_CAP})", nodes / NODE_CAP, "take a smaller patch")
    return nodes


@dataclass(frozen=True)
class Disc:
    """A circular support, centre (2,), between two radii; units of u."""

    centre: Array
    inner: float
    outer: float


def as_disc(beam: Beam) -> Disc | None:
    """The disc or annulus that a beam's support is, or None: every clearance must be a multiple of r² − a²."""
    s = beam.support
    if abs(s.scale[0] / s.scale[1] - 1.0) > 1e-14 or not 1 <= len(s.clearance) <= 2:
        return None
    radii: dict[str, float] = {}
    centres = []
    for c in s.clearance:
        square = c[2, 0] if c.shape[0] > 2 else 0.0
        rest = c.copy()
        if square == 0.0 or abs(c[0, 2] / square - 1.0) > 1e-13:
            return None
        # square (T2(x) + T2(y)) = 2 square r² − 2 square; linear terms move the centre
        shift = -np.array([c[1, 0], c[0, 1]]) / (4.0 * square)
        rest[2, 0] = rest[0, 2] = rest[1, 0] = rest[0, 1] = rest[0, 0] = 0.0
        radius2 = 1.0 - c[0, 0] / (2.0 * square) + float(shift @ shift)
        if np.abs(rest).max() > 1e-13 * abs(square) or radius2 <= 0.0:
            return None
        radii["outer" if square < 0.0 else "inner"] = math.sqrt(radius2)
        centres.append(shift)
    inner, outer = radii.get("inner", 0.0), radii.get("outer", 0.0)
    if len(radii) != len(centres) or inner >= outer or np.ptp(centres, axis=0).max() > 1e-13:
        return None
    return Disc(s.centre + s.scale * centres[0], inner * s.scale[0], outer * s.scale[0])


@lru_cache(maxsize=32)
def _gauss(n: int) -> tuple[Array, Array]:
    """Gauss-Legendre rule on (0, 1)."""
    x, w = np.polynomial.legendre.leggauss(n)
    return 0.5 * (x + 1.0), 0.5 * w


def _count(phase: float, eps: float) -> float:
    """Order beyond which Bessel's J_n(phase) stays below eps: phase + turning-point width, from its Airy tail."""
    digits = -math.log(eps)
    return phase + (1.5 * digits) ** (2.0 / 3.0) * (0.5 * max(phase, 1.0)) ** (1.0 / 3.0) + 0.5 * digits


@lru_cache(maxsize=8)
def _kept_rings(ratio: float, phase: float, eps: float) -> tuple[Array, Array]:
    return _rings(ratio, phase, eps)


def _rings(ratio: float, phase: float, eps: float) -> tuple[Array, Array]:
    """Points (M, 2) and weights on the annulus ratio < r < 1 for exp(i k·r), |k| <= phase: rings of Gauss radii.

    On a ring the trapezoid rule errs by J_n(phase·r), n the points of the ring; so a ring has only as many as its
    radius asks for. A Gauss rule of n radii errs as J_2n of half the phase along the radius.
    """
    radii = math.ceil(0.5 * _count(0.5 * phase * (1.0 - ratio), eps)) + 2
    x, w = _gauss(radii)
    r = ratio + (1.0 - ratio) * x
    points, weights = [], []
    for k in range(radii):
        n = 4 * math.ceil(0.25 * (_count(phase * r[k], eps) + 2.0))
        angle = TURN * (np.arange(n) + 0.5 * (k % 2)) / n
        points.append(r[k] * np.column_stack([np.cos(angle), np.sin(angle)]))
        weights.append(np.full(n, TURN / n * (1.0 - ratio) * w[k] * r[k]))
    return np.concatenate(points), np.concatenate(weights)


def polar_nodes(beam: Beam, disc: Disc, reach: float, eps: float) -> Nodes | None:
    """Gauss rings on a disc or annulus, for |x| <= reach (m); None where there would be too many turns for one rule.

    The order is that of a plane wave as steep as the steepest slope plus the reach: sufficient for the few terms of
    low degree that an aberration has, and checked by the caller where there is one.
    """
    phase = TURN * beam.sigma * disc.outer * (reach + _steepest(beam, disc))
    if phase > TURN * _POLAR_CAP:
        return None
    # Rounded up, so that patches of nearly one size share their rule.
    make = _kept_rings if phase < _KEPT else _rings
    unit, weight = make(disc.inner / disc.outer, float(math.ceil(phase)), eps)
    at = disc.centre + disc.outer * unit
    weight = weight * disc.outer**2
    field = complex(beam.amplitude[0, 0]) if is_flat(beam) else beam.values(at)
    return Nodes(at, np.asarray(weight * field, np.complex128))


def count_polar(beam: Beam, disc: Disc, reach: float) -> int | None:
    """About how many nodes the rings have; None where there are none."""
    phase = TURN * beam.sigma * disc.outer * (reach + _steepest(beam, disc))
    return None if phase > TURN * _POLAR_CAP else int(_count(phase, 1e-6) ** 2 / 8.0)


def _steepest(beam: Beam, disc: Disc) -> float:
    """Largest |∂opl/∂u| on a polar grid over the disc, m."""
    if is_flat(beam):
        return 0.0
    angle = np.linspace(0.0, TURN, 48, endpoint=False)
    radius = disc.inner + (disc.outer - disc.inner) * np.linspace(0.0, 1.0, 9)
    u = [disc.centre[a] + np.outer(radius, (np.cos, np.sin)[a](angle)).ravel() for a in (0, 1)]
    return float(np.hypot(*beam.slope_at(np.column_stack(u)).T).max())


def is_flat(beam: Beam) -> bool:
    """Whether a beam has neither aberration nor apodisation."""
    amplitude = np.abs(beam.amplitude).sum() - abs(beam.amplitude[0, 0])
    return bool(amplitude == 0.0 and np.abs(beam.path).sum() == 0.0)


def direct_sum(nodes: Nodes, sigma: float, x: Array, y: Array) -> NDArray[np.complex128]:
    """(X, Y) σ Σ_j c_j exp(i 2πσ (x u_j + y v_j)): every node adds a plane wave to every point."""
    out = np.zeros((x.size, y.size), np.complex128)
    for start in range(0, len(nodes.u), 20_000):
        part = slice(start, start + 20_000)
        left = np.exp(2j * np.pi * sigma * np.outer(x, nodes.u[part, 0])) * nodes.strength[part]
        out += left @ np.exp(2j * np.pi * sigma * np.outer(nodes.u[part, 1], y))
    return out * sigma


def difference(one: Nodes, other: Nodes, sigma: float, x: Array, y: Array) -> float:
    """Largest |difference| of h by two sets of nodes, at nine points of a patch: middle, edges, and the corners, where
    the phase is steepest."""
    at = [np.unique(axis[np.linspace(0, axis.size - 1, 3).astype(int)]) for axis in (x, y)]
    return float(np.abs(direct_sum(one, sigma, *at) - direct_sum(other, sigma, *at)).max())


def farthest(x: Array, y: Array) -> float:
    """Distance of the farthest corner of a patch from the reference point, m."""
    return math.hypot(float(np.abs(x).max()), float(np.abs(y).max()))
