"""Where one or several pupil fields are lit together, and integrals over it with an error that is measured.

The region is the set where every clearance of every support is positive. It may be anything the clearances bound:
cut, cornered, holed or in pieces. The quadrature (``cgi_wave.kernels.pupil``) follows its boundary.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import MethodLimitError
from cgi_wave.kernels import curves, enclosed, outline, pupil, survey
from cgi_wave.wave.basis import Array

METHOD = "boundary-fitted Gauss panels"
NODE_CAP = 4_000_000  # nodes of one quadrature, before its T wavenumbers
SAFETY = 2.0  # the error bound is this times the difference of the last two levels
FIRST_CYCLES, FIRST_TURN, REFINEMENT = 5.0, 1.6, 1.5  # phase (cycles) and turning (rad) of a panel at level 0
_LEVELS = 8
_BREAK_LIMIT = 200
_SCANS = (120, 240, 480)  # rays on which the boundary's corners are looked for, per level
_MOST_CURVES = 512
_CURVES = 1e-13, 1e-9  # frame units: the finest and the coarsest curves that are asked for


@dataclass(frozen=True)
class Support:
    """Where a field is lit: inside an ellipse (the domain of its polynomials) and where all clearances are positive.

    centre, scale : (2,) centre and semi-axes of the domain in units of u
    clearance : (K, n, n) Chebyshev-product coefficients on (u - centre) / scale
    residual : (K,) largest error of each clearance polynomial on held-out samples
    """

    centre: Array
    scale: Array
    clearance: Array
    residual: Array

    @cached_property
    def trimmed(self) -> Array:
        """``clearance`` without the powers that none of them has."""
        return trimmed(self.clearance)


@dataclass(frozen=True, eq=False)
class Region:
    """The common support of some fields in a frame of its own: u = pivot + frame * (x, y).

    clearance (K, k, k) in powers of (x, y), no larger than their degree asks for; residual (K,); ellipses (E, 4) the
    domains; extent (G, 2) sample points (x, y) inside; terms: n of the fields' polynomials (n, n).
    """

    pivot: Array
    frame: Array
    clearance: Array
    residual: Array
    ellipses: Array
    extent: Array
    terms: int

    @property
    def unit(self) -> float:
        """Area of the frame's unit square in units of u²."""
        return float(self.frame[0] * self.frame[1])


def trimmed(clearance: Array) -> Array:
    """Polynomials (K, n, n) without the powers that none of them has: each costs the boundary search a pass."""
    _, i, j = np.nonzero(clearance)
    n = 1 + max(int(i.max(initial=0)), int(j.max(initial=0)))
    return np.ascontiguousarray(clearance[:, :n, :n])


@dataclass(frozen=True)
class Quadrature:
    """Rays and radial panels of one level; ``nodes`` is their number.

    between: area (frame units) between boundaries that are too close to be told apart.
    """

    rays: Array
    owner: NDArray[np.int64]
    panels: NDArray[np.int64]
    nodes: int
    between: float


@dataclass(frozen=True)
class Integral:
    """Integrals over a region for T triples (phase, a, b), in units of a b d²u.

    value (T,) of a b exp(i 2π phase); cross, aa, bb (T,) of a b, a², b²; weighted, unweighted: of the extra factor
    times a b with and without the phase, at the middle triple; area in units of u²; edge: what the error of the
    clearances can add; error (T,): numerical error bound of value; change_power (T,): |difference| of max(aa, bb)
    between the last two levels; nodes of the last level.
    """

    value: NDArray[np.complex128]
    cross: Array
    aa: Array
    bb: Array
    weighted: complex
    unweighted: float
    area: float
    edge: float
    error: Array
    change_power: Array
    nodes: int


def find_region(supports: Sequence[Support]) -> Region | None:
    """The common region of the supports, or None when they do not meet (slivers down to 1e-7 of the box are found)."""
    centre, scale = np.array([s.centre for s in supports]), np.array([s.scale for s in supports])
    polynomials = [s.trimmed for s in supports]
    most = max(p.shape[-1] for p in polynomials)
    stacked, owner = np.zeros((sum(map(len, polynomials)), most, most)), list[int]()
    for number, polynomial in enumerate(polynomials):
        size = polynomial.shape[-1]
        stacked[len(owner) : len(owner) + len(polynomial), :size, :size] = polynomial
        owner += [number] * len(polynomial)
    pivot, frame, extent, keep, powers, ellipses = survey.common(stacked, np.array(owner, np.int64), centre, scale)
    if extent.size == 0:
        return None
    residual = np.concatenate([s.residual for s in supports])[keep]
    return Region(pivot, frame, powers, residual, ellipses, extent, max(s.clearance.shape[-1] for s in supports))


def segments(region: Region, level: int = 0) -> tuple[Array, NDArray[np.bool_]]:
    """Angle ranges (B, 2) between corners, and whether the number of intervals changes at one of their ends (B,).

    Two levels share a search, so that a corner that the coarse one missed is found before the fine one is believed.
    Raises MethodLimitError beyond _BREAK_LIMIT corners.
    """
    return _spans(region, _SCANS[min(level // 2, len(_SCANS) - 1)])


@lru_cache(maxsize=8)
def _spans(region: Region, scan: int) -> tuple[Array, NDArray[np.bool_]]:
    ranges, turning, corners = outline.spans(region.clearance, region.ellipses, scan, _BREAK_LIMIT)
    _check_corners(corners)
    return ranges, turning


def _check_corners(count: int) -> None:
    if count > _BREAK_LIMIT:
        raise MethodLimitError(
            METHOD,
            f"the boundary of the common support has more than {_BREAK_LIMIT} corners or eight pieces along a line",
            count / _BREAK_LIMIT,
            "lower the degree of the fit or merge the apertures that nearly coincide",
        )


@dataclass(frozen=True, eq=False)
class Boundary:
    """Boundary of a region as smooth curves (C, 2, 16), powers of s in [-1, 1] in frame units, region to their left.

    owner (C,): the clearance that is 0 on each, negative for a domain; missed: the largest distance (frame units) by
    which a curve may be off.
    """

    curves: Array
    owner: NDArray[np.int64]
    missed: float


def boundary(region: Region, tolerance: float) -> Boundary:
    """Boundary of the region, its curves good to ``tolerance`` (frame units) within what _CURVES allows.

    Raises MethodLimitError when a part of the boundary cannot be followed.
    """
    fine = min(max(tolerance, _CURVES[0]), _CURVES[1])
    found, owner, missed, corners = curves.boundary(
        region.clearance, region.ellipses, _SCANS[0], _BREAK_LIMIT, fine, _MOST_CURVES
    )
    _check_corners(corners)
    if missed == np.inf:
        raise MethodLimitError(
            METHOD,
            "a part of the boundary of the common support cannot be followed",
            1.0,
            "lower the degree of the fit or merge the apertures that nearly coincide",
        )
    return Boundary(found, owner, missed)


def _refuse(nodes: float, waves: float) -> MethodLimitError:
    return MethodLimitError(
        METHOD,
        f"{nodes:.3g} nodes for a path difference that spans {waves:.4g} waves (limit {NODE_CAP:.3g} nodes)",
        nodes / NODE_CAP,
        "ask for a larger tolerance, or bound the contrast and leave the pair out",
    )


def spread(region: Region, poly: Array) -> float:
    """max - min of the polynomials (P, n, n) over the region's sample points: the largest of the P, in their unit."""
    return max(survey.spread(p, region.extent) for p in poly)


def build(region: Region, steering: Array, tilt: float, level: int) -> Quadrature:
    """Rays and panels for phases ``steering`` (P, n, n; cycles) plus a phase rate ``tilt`` (cycles per frame unit).

    Raises MethodLimitError beyond NODE_CAP nodes, naming the waves and the factor.
    """
    cycles, turn = FIRST_CYCLES / REFINEMENT**level, FIRST_TURN / REFINEMENT**level
    rays, owner, between = [], [], 0.0
    limit = NODE_CAP // outline.GAUSS**2
    for span, turning in zip(*segments(region, level), strict=True):
        breaks = pupil.angle_panels(
            region.clearance, region.ellipses, steering, tilt, span, turning, cycles, turn, level, limit
        )
        if breaks.size == 1:
            raise _refuse(float(breaks[0]) ** 2 * outline.GAUSS**2, spread(region, steering))
        part, ends, gaps = pupil.segment_rays(region.clearance, region.ellipses, span, turning, breaks)
        between += gaps
        rays.append(part)
        owner.append(ends)
    all_rays, all_ends = np.concatenate(rays), np.concatenate(owner)
    panels = pupil.count_panels(all_rays, steering, tilt, cycles, level)
    nodes = int(panels.sum()) * outline.GAUSS
    if nodes > NODE_CAP:
        raise _refuse(nodes, spread(region, steering))
    return Quadrature(all_rays, all_ends, panels, nodes, between)


@dataclass(frozen=True)
class Rough:
    """Integrals over a region of a b, a², b²; its area; what the error of the clearances can add to the first.

    strip: what the boundary's curves can.
    """

    cross: float
    aa: float
    bb: float
    area: float
    edge: float
    strip: float


def rough(region: Region, around: Boundary, a: Array, b: Array) -> Rough:
    """Integrals over a region of the polynomials a, b (n, n), powers of its frame, from its boundary.

    For bounds: nothing oscillates, and the nodes leave far less than the hundredth part that is added to what bounds
    are made of (cross, area, edge, strip).
    """
    cross, aa, bb, size, edge, rim = enclosed.enclosed(
        around.curves, around.owner, region.clearance, region.residual, a, b
    )
    area = region.unit
    more = 1.01 * area
    return Rough(cross * more, aa * area, bb * area, size * more, edge * more, around.missed * rim * more)


def integrate(region: Region, phase: Array, a: Array, b: Array, weight: Array, norm: Array, tol: float) -> Integral:
    """Integrals of a b exp(i 2π phase) over the region, refined until SAFETY * change / norm <= tol.

    phase (T, n, n) in cycles, a, b (T, n, n), weight (n, n): powers of the region's frame; norm (T,).
    Raises MethodLimitError when NODE_CAP or the number of levels does not suffice.
    """
    middle = phase.shape[0] // 2
    steering = phase[[int(np.argmax(np.abs(phase).sum(axis=(1, 2))))]]
    area = region.unit
    before: tuple[Array, Array, float] | None = None
    worst = np.inf
    for level in range(_LEVELS):
        q = build(region, steering, 0.0, level)
        if before is None and q.nodes * REFINEMENT**2 > NODE_CAP:  # the level that it takes to know the error
            raise _refuse(q.nodes * REFINEMENT**2, spread(region, steering))
        sums, weighted, edge = pupil.integrate(
            q.rays, q.owner, q.panels, steering, 0.0, phase, a, b, weight, middle, region.clearance, region.residual
        )
        # |x|, |y| <= 1 in the frame: the sum of the coefficients bounds a polynomial there
        edge += q.between * float(np.abs(a[middle]).sum() * np.abs(b[middle]).sum())
        sums, weighted, edge = sums * area, weighted * area, edge * area
        if before is not None:
            change = np.hypot(*(sums - before[0])[:, :2].T)
            change_power = np.abs(sums - before[0])[:, 2:].max(axis=1)
            worst = float(np.max(SAFETY * change / norm))
            if worst <= tol:
                return Integral(
                    sums[:, 0] + 1j * sums[:, 1],
                    sums[:, 2],
                    sums[:, 3],
                    sums[:, 4],
                    complex(weighted[0], weighted[1]),
                    float(weighted[2]),
                    float(weighted[3]),
                    float(edge),
                    SAFETY * change,
                    change_power,
                    q.nodes,
                )
        before = sums, weighted, edge
    raise MethodLimitError(
        METHOD, f"{_LEVELS} levels leave an error of {worst:.2g}", worst / tol, "ask for a larger tolerance"
    )
