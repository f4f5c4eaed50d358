"""A pupil field on a regular grid, its edge gray, and what that sampling costs in accuracy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.wave.basis import Array, at_points, evaluate
from cgi_wave.wave.methods.shape import TURN, Beam, Edge, edge_law
from cgi_wave.wave.region import Support

PARTS = 8  # an edge cell is divided into PARTS² of them, each cut by a straight line


@dataclass(frozen=True)
class Grid:
    """Cells of a plane: cell (i, j) has its centre at (first + (i, j)) * pitch; count (2,) of them."""

    pitch: tuple[float, float]
    first: tuple[int, int]
    count: tuple[int, int]

    def axis(self, a: int) -> Array:
        """(count[a],) centres along axis a, unit of u."""
        return np.asarray((np.arange(self.count[a]) + self.first[a]) * self.pitch[a], np.float64)

    @property
    def cell(self) -> float:
        """Area of a cell, unit of u²."""
        return self.pitch[0] * self.pitch[1]


def covering(lo: Array, hi: Array, pitch: tuple[float, float]) -> Grid:
    """The grid of that pitch whose cells cover the box lo (2,) to hi (2,), with a cell to spare on each side."""
    first = [int(np.floor(lo[a] / pitch[a] - 0.5)) for a in (0, 1)]
    last = [int(np.ceil(hi[a] / pitch[a] + 0.5)) for a in (0, 1)]
    return Grid(pitch, (first[0], first[1]), (last[0] - first[0] + 1, last[1] - first[1] + 1))


def half_plane(value: Array, a: Array, b: Array) -> Array:
    """Share of a unit cell where value + a s + b t > 0, |s|, |t| <= 1/2; exact."""
    whole = np.abs(a) + np.abs(b)
    a = np.maximum(np.abs(a), 1e-5 * whole + 1e-300)
    b = np.maximum(np.abs(b), 1e-5 * whole + 1e-300)

    def ramp(z: Array) -> Array:
        return 0.5 * np.maximum(z, 0.0) ** 2

    up, down = 0.5 * (a + b), 0.5 * (a - b)
    share = (ramp(value + up) - ramp(value + down) - ramp(value - down) + ramp(value - up)) / (a * b)
    # Where all of the cell is on one side, the differences of squares would only add rounding.
    return np.asarray(np.where(value >= up, 1.0, np.where(value <= -up, 0.0, np.clip(share, 0.0, 1.0))))


def shares(supports: Sequence[Support], grid: Grid, parts: int = PARTS) -> Array:
    """(X, Y) share of each cell inside all the supports.

    Edge cells are divided into parts²; every clearance is the quadratic about the cell's centre, its edge straight in
    each part.
    """
    out = np.ones(grid.count)
    u = [grid.axis(a) for a in (0, 1)]
    pieces = []
    for s in supports:
        x, y = ((u[a] - s.centre[a]) / s.scale[a] for a in (0, 1))
        step = np.array(grid.pitch) / s.scale
        # Beyond the domain (and half a cell) polynomials say nothing.
        out[(x[:, None] ** 2 + y[None, :] ** 2) > (1.0 + 0.5 * float(np.hypot(*step))) ** 2] = 0.0
        for coef in s.clearance:
            pieces.append((coef, x, y, step))
    values = []
    edge = np.zeros(grid.count, bool)
    for coef, x, y, step in pieces:
        value = evaluate(coef, x, y)
        reach = _reach(coef, step)
        out[value <= -reach] = 0.0
        edge |= np.abs(value) < reach
        values.append(value)
    i, j = np.nonzero(edge & (out > 0.0))
    if i.size == 0:
        return out
    offset = (np.arange(parts) + 0.5) / parts - 0.5
    p, q = np.repeat(offset, parts), np.tile(offset, parts)
    lit = np.ones((i.size, parts * parts))
    for (coef, x, y, step), value in zip(pieces, values, strict=True):
        at = np.column_stack([x[i], y[j]])
        d = 0.5 * np.diag(step)
        plus = [at_points(coef, at + way * d[a]) for a in (0, 1) for way in (1.0, -1.0)]
        corner = at_points(coef, at + d.sum(axis=0)) - at_points(coef, at + d[0] - d[1])
        corner += at_points(coef, at - d.sum(axis=0)) - at_points(coef, at - d[0] + d[1])
        here = value[i, j]
        ga, gb = plus[0] - plus[1], plus[2] - plus[3]
        haa, hbb = 4.0 * (plus[0] + plus[1] - 2.0 * here), 4.0 * (plus[2] + plus[3] - 2.0 * here)
        v = here[:, None] + ga[:, None] * p + gb[:, None] * q
        v += 0.5 * (haa[:, None] * p**2 + hbb[:, None] * q**2) + corner[:, None] * p * q
        a = (ga[:, None] + haa[:, None] * p + corner[:, None] * q) / parts
        b = (gb[:, None] + hbb[:, None] * q + corner[:, None] * p) / parts
        # The least, not the product: two pupils often share an edge, and it must not count twice.
        lit = np.minimum(lit, half_plane(v, a, b))
    out[i, j] = lit.mean(axis=1)
    return out


def _reach(coef: Array, step: Array) -> float:
    """What a clearance can change from a cell's centre to its corners, with a fifth to spare."""
    line = np.linspace(-1.0, 1.0, 61)
    value = evaluate(coef, line, line)
    pace = [np.abs(np.diff(value, axis=a)).max() / (line[1] - line[0]) for a in (0, 1)]
    return 0.6 * float(pace[0] * step[0] + pace[1] * step[1]) + 1e-12


def sampled(beam: Beam, grid: Grid, share: Array) -> NDArray[np.complex128]:
    """(X, Y) field times share at the cells' centres, without the beam's constant; 0 where the share is 0."""
    x, y = ((grid.axis(a) - beam.support.centre[a]) / beam.support.scale[a] for a in (0, 1))
    waves = evaluate(beam.path, x, y)
    waves *= beam.sigma
    waves -= np.rint(waves)
    field: NDArray[np.complex128] = np.exp(2j * np.pi * waves)
    field *= np.where(share > 0.0, evaluate(beam.amplitude, x, y) * share, 0.0)
    return field


def steepest_step(beam: Beam, other: Beam | None, edge: Edge, pitch: tuple[float, float]) -> Array:
    """(2,) largest phase step (rad) per cell along each axis, of beam or of beam against other, over the support."""
    u = np.concatenate([edge.u, edge.inside])
    slope = beam.slope_at(u) - (other.slope_at(u) if other is not None else 0.0)
    return np.asarray(TURN * beam.sigma * np.abs(slope).max(axis=0) * np.array(pitch))


def edge_error(
    beam: Beam, other: Beam | None, edge: Edge, pitch: tuple[float, float], at: Array | None = None
) -> float:
    """Bound of the error of Σ share·A exp(iφ)·cell against the integral, unit of A u², from the law of gray edges.

    φ is the phase of ``beam``, less that of ``other`` where given (A then is the product of their amplitudes);
    ``at`` (2,), m, adds 2πσ u·x: the bound then holds for all |x| up to it. The share's own error, that of straight
    cuts through the parts of a cell, is added: curvature times part² / 12 along every edge.
    """
    p = np.array(pitch)
    slope = beam.slope_at(edge.u) - (other.slope_at(edge.u) if other is not None else 0.0)
    weight = beam.amplitude_at(edge.u) * (other.amplitude_at(edge.u) if other is not None else 1.0)
    # In units of cells the edge element is (n_x dl / p_y, n_y dl / p_x).
    normal = edge.normal / p[::-1]
    length = np.hypot(*normal.T)
    theta = np.abs(np.sum(TURN * beam.sigma * slope * p * normal, axis=1)) / length
    if at is not None:
        theta = theta + TURN * beam.sigma * np.sum(np.abs(at) * p * np.abs(normal), axis=1) / length
    cell = float(np.prod(p))
    loss = cell * float(np.sum(np.abs(weight) * length * edge_law(theta)))
    change = _change(beam, other, edge, p, normal / length[:, None])
    loss += cell * float(np.sum(change * length)) / 8.0
    return loss + float(np.abs(weight).max()) * edge.curves * TURN * float(p.max()) ** 2 / (12.0 * PARTS**2)


def _change(beam: Beam, other: Beam | None, edge: Edge, pitch: Array, normal: Array) -> Array:
    """(B,) |change of the amplitude product| per cell along the edge's normal (in units of cells)."""
    step = 1e-4 * pitch * normal

    def product(u: Array) -> Array:
        return beam.amplitude_at(u) * (other.amplitude_at(u) if other is not None else 1.0)

    return np.asarray(np.abs(product(edge.u + step) - product(edge.u - step)) / 2e-4)
