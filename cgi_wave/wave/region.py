"""Where one or several pupil fields are lit together, and integrals over it with an error that is measured.

The region is the set where every clearance of every support is positive. It may be anything the clearances bound:
cut, cornered, holed or in pieces. The quadrature (``cgi_wave.kernels.pupil``) follows its boundary.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import MethodLimitError
from cgi_wave.kernels import outline, pupil
from cgi_wave.wave.basis import Array, evaluate, expand

METHOD = "boundary-fitted Gauss panels"
NODE_CAP = 4_000_000  # nodes of one quadrature, before its T wavenumbers
SAFETY = 2.0  # the error bound is this times the difference of the last two levels
FIRST_CYCLES, FIRST_TURN, REFINEMENT = 5.0, 1.6, 1.5  # phase (cycles) and turning (rad) of a panel at level 0
_LEVELS = 8
_BREAK_LIMIT = 200
_SCANS = (120, 240, 480)  # rays on which the boundary's corners are looked for, per level
_GRID = 41
_CURVE_TOLERANCE = 1e-13  # frame units


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


def _on_grid(supports: Sequence[Support], polynomials: Sequence[Array], lo: Array, hi: Array) -> _Grid:
    """All clearances of all supports on a grid over a box, and the least with the domains in it."""
    x, y = np.linspace(lo[0], hi[0], _GRID), np.linspace(lo[1], hi[1], _GRID)
    least, values = np.full((_GRID, _GRID), np.inf), []
    for s, clearance in zip(supports, polynomials, strict=True):
        sx, sy = (x - s.centre[0]) / s.scale[0], (y - s.centre[1]) / s.scale[1]
        least = np.minimum(least, 1.0 - sx[:, None] ** 2 - sy[None, :] ** 2)
        if len(clearance):
            values.append(evaluate(clearance, sx, sy))
            least = np.minimum(least, values[-1].min(axis=0))
    every = np.concatenate(values) if values else np.empty((0, _GRID, _GRID))
    return _Grid(x, y, least, every)


@dataclass(frozen=True)
class _Grid:
    """Axes x, y (G,), the least clearance (G, G), and each of them (K, G, G)."""

    x: Array
    y: Array
    least: Array
    every: Array


def _bounding(grids: Sequence[Array]) -> NDArray[np.int64]:
    """Which clearances, given on grids (K, X, Y), can bound the region: the others stay positive where the rest are.

    All comparisons leave the change over one cell as a margin. Clearances go one by one, the most positive first. One
    of the grids has to cover all that rays can reach, or a piece that only a dropped clearance excludes would appear.
    """
    cells = [sum(np.abs(np.diff(g, axis=axis)).max(axis=(1, 2)) for axis in (1, 2)) for g in grids]
    kept = list(range(len(grids[0])))
    for k in np.argsort([-c.min() for c in grids[-1]]):
        others = [j for j in kept if j != k]
        if others and all(
            np.all((g[k] > cell[k]) | np.any(g[others] <= -cell[others, None, None], axis=0))
            for g, cell in zip(grids, cells, strict=True)
        ):
            kept = others
    return np.array(kept, np.int64)


def find_region(supports: Sequence[Support]) -> Region | None:
    """The common region of the supports, or None when they do not meet.

    A grid over the common box is refined about its best point until it shows positive clearance (slivers down to
    1e-7 of the box are found), then about the lit points until they fill it.
    """
    lo = np.max([s.centre - s.scale for s in supports], axis=0)
    hi = np.min([s.centre + s.scale for s in supports], axis=0)
    if np.any(hi <= lo):
        return None
    polynomials = [trimmed(s.clearance) for s in supports]
    first = grid = _on_grid(supports, polynomials, lo, hi)
    points = np.empty((0, 2))
    for _ in range(14):
        i, j = np.nonzero(grid.least > 0.0)
        step = np.array([grid.x[1] - grid.x[0], grid.y[1] - grid.y[0]])
        if i.size == 0:
            row, column = np.unravel_index(np.argmax(grid.least), grid.least.shape)
            best = np.array([grid.x[row], grid.y[column]])
            lo, hi = best - 6.0 * step, best + 6.0 * step
        else:
            points = np.column_stack([grid.x[i], grid.y[j]])
            if i.size >= _GRID * _GRID // 5 or (i.max() - i.min() > _GRID // 2 and j.max() - j.min() > _GRID // 2):
                break
            lo, hi = points.min(axis=0) - 1.5 * step, points.max(axis=0) + 1.5 * step
        grid = _on_grid(supports, polynomials, lo, hi)
    if points.size == 0:
        return None
    pivot = points.mean(axis=0)
    frame = np.abs(points - pivot).max(axis=0) + 1.5 * step
    extent = (points - pivot) / frame
    n = max(s.clearance.shape[-1] for s in supports)
    kept = _bounding([first.every, grid.every])
    clearance = np.concatenate([expand(s.clearance, s.centre, s.scale, pivot, frame, n) for s in supports])
    ellipses = np.array([[*((s.centre - pivot) / frame), *(s.scale / frame)] for s in supports])
    residual = np.concatenate([s.residual for s in supports])
    return Region(pivot, frame, trimmed(clearance[kept]), residual[kept], ellipses, extent, n)


def _segments(region: Region, level: int) -> list[tuple[Array, bool]]:
    """Angle ranges (theta0, theta1) between corners, and whether their ends are corners (not so for a full turn).

    Two levels share a search, so that a corner that the coarse one missed is found before the fine one is believed.
    """
    return _corners(region, _SCANS[min(level // 2, len(_SCANS) - 1)])


def segments(region: Region) -> tuple[Array, NDArray[np.bool_]]:
    """``_segments`` of the coarsest levels as arrays: angle ranges (B, 2), and whether their ends are corners (B,)."""
    found = _segments(region, 0)
    return np.array([span for span, _ in found]), np.array([cornered for _, cornered in found])


@lru_cache(maxsize=8)
def _corners(region: Region, scan: int) -> list[tuple[Array, bool]]:
    angles = outline.find_breaks(region.clearance, region.ellipses, scan, _BREAK_LIMIT)
    if angles.size > _BREAK_LIMIT:
        raise MethodLimitError(
            METHOD,
            f"the boundary of the common support has more than {_BREAK_LIMIT} corners or eight pieces along a line",
            angles.size / _BREAK_LIMIT,
            "lower the degree of the fit or merge the apertures that nearly coincide",
        )
    if angles.size == 0:
        return [(np.array([0.0, 2.0 * np.pi]), False)]
    ends = np.append(angles, angles[0] + 2.0 * np.pi)
    return [(ends[b : b + 2], True) for b in range(angles.size) if ends[b + 1] - ends[b] > 1e-13]


def boundary(region: Region) -> tuple[Array, float]:
    """Boundary of the region as smooth curves (C, 2, 16), powers of s in [-1, 1] in frame units, region to their left.

    With it, the largest distance (frame units) by which a curve may be off. Raises MethodLimitError when a part of the
    boundary cannot be followed.
    """
    curves, missed = [], 0.0
    for span, cornered in _segments(region, 0):
        part, off = outline.boundary_curves(region.clearance, region.ellipses, span, cornered, _CURVE_TOLERANCE, 512)
        if not np.isfinite(off):
            raise MethodLimitError(
                METHOD,
                f"the boundary between {span[0]:.4g} and {span[1]:.4g} rad cannot be followed",
                1.0,
                "lower the degree of the fit or merge the apertures that nearly coincide",
            )
        curves.append(part)
        missed = max(missed, off)
    return np.concatenate(curves), missed


def _refuse(nodes: float, waves: float) -> MethodLimitError:
    return MethodLimitError(
        METHOD,
        f"{nodes:.3g} nodes for a path difference that spans {waves:.4g} waves (limit {NODE_CAP:.3g} nodes)",
        nodes / NODE_CAP,
        "ask for a larger tolerance, or bound the contrast and leave the pair out",
    )


def spread(region: Region, poly: Array) -> float:
    """max - min of the polynomials (P, n, n) over the region's sample points: the largest of the P, in their unit."""
    n = poly.shape[-1]
    across, along = (np.vander(axis, n, increasing=True) for axis in region.extent.T)
    values = ((across @ poly) * along).sum(axis=2)
    return float(np.ptp(values, axis=1).max())


def build(region: Region, steering: Array, tilt: float, level: int) -> Quadrature:
    """Rays and panels for phases ``steering`` (P, n, n; cycles) plus a phase rate ``tilt`` (cycles per frame unit).

    Raises MethodLimitError beyond NODE_CAP nodes, naming the waves and the factor.
    """
    cycles, turn = FIRST_CYCLES / REFINEMENT**level, FIRST_TURN / REFINEMENT**level
    rays, owner, between = [], [], 0.0
    limit = NODE_CAP // outline.GAUSS**2
    for span, cornered in _segments(region, level):
        breaks = pupil.angle_panels(
            region.clearance, region.ellipses, steering, tilt, span, cornered, cycles, turn, level, limit
        )
        if breaks.size == 1:
            raise _refuse(float(breaks[0]) ** 2 * outline.GAUSS**2, spread(region, steering))
        part, ends, gaps = pupil.segment_rays(region.clearance, region.ellipses, span, cornered, breaks)
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
    """Integrals over a region of a b, a², b²; its area; and what the error of the clearances can add to the first."""

    cross: float
    aa: float
    bb: float
    area: float
    edge: float


def rough(region: Region, a: Array, b: Array) -> Rough:
    """Integrals of the polynomials a, b (n, n), powers of the region's frame, by one level of panels.

    For bounds: nothing oscillates, and 16 nodes a panel leave far less than the hundredth part that is added to what
    bounds are made of (cross, area, edge).
    """
    flat, none = np.zeros((1, *a.shape)), np.zeros(a.shape)
    q = build(region, flat, 0.0, 0)
    sums, weighted, edge = pupil.integrate(
        q.rays, q.owner, q.panels, flat, 0.0, flat, a[None], b[None], none, 0, region.clearance, region.residual
    )
    edge += q.between * float(np.abs(a).sum() * np.abs(b).sum())
    area = float(np.prod(region.frame))
    more = 1.01 * area
    return Rough(
        float(sums[0, 2]) * more,
        float(sums[0, 3]) * area,
        float(sums[0, 4]) * area,
        float(weighted[3]) * more,
        float(edge) * more,
    )


def integrate(region: Region, phase: Array, a: Array, b: Array, weight: Array, norm: Array, tol: float) -> Integral:
    """Integrals of a b exp(i 2π phase) over the region, refined until SAFETY * change / norm <= tol.

    phase (T, n, n) in cycles, a, b (T, n, n), weight (n, n): powers of the region's frame; norm (T,).
    Raises MethodLimitError when NODE_CAP or the number of levels does not suffice.
    """
    middle = phase.shape[0] // 2
    steering = phase[[int(np.argmax(np.abs(phase).sum(axis=(1, 2))))]]
    area = float(np.prod(region.frame))
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
