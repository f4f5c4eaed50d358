"""Ghosts whose images are blurred: image and pattern on a coarse grid of nodes instead of on pixels.

The pattern of such a layer is a few smooth envelopes times 1, cos θ, sin θ, cos 2θ, sin 2θ, θ the nominal phase: the
light passes a sloped arm at most twice more than its partner. Envelopes are polynomials over the zone, fitted
here to the pattern; the image is the blurred scene on nodes every ``pitch`` pixels. Envelope times image is brought to
the pixels by cubic interpolation, for all ghosts at once. What all this misses is measured on the frames themselves:
under uniform light on every pixel, and with the scene on a sample of them. A layer that misses the tolerance at every
pitch is not smooth, and goes the long way (``beams_on_scene``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes.layer import Zone

Array = NDArray[np.float64]
Real = NDArray[np.floating]
PITCHES = (64, 32, 16, 8)
#: Degrees across and along track of the envelopes, tried in this order.
DEGREES = ((3, 4), (5, 8), (8, 14))
POINTS = 6000


@dataclass(frozen=True)
class Grid:
    """Nodes every ``pitch`` pixels, the first one pitch before pixel (0, 0) and the last beyond the end, so that every
    cell of pixels lies between the second and third of four nodes.

    table (4, pitch) : weights of the nodes at a cell's pixels
    """

    pitch: int
    rows: int
    columns: int
    table: Real

    @property
    def cells(self) -> tuple[int, int]:
        """Numbers of cells along and across track."""
        return -(-self.rows // self.pitch), -(-self.columns // self.pitch)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns of nodes."""
        return self.cells[0] + 3, self.cells[1] + 3

    @property
    def nodes(self) -> tuple[Array, Array]:
        """Pixels of the nodes along and across track, cells + 3 each."""
        along, across = (self.pitch * np.arange(-1.0, count + 2) for count in self.cells)
        return along, across


def grid(shape: tuple[int, int], pitch: int, dtype: type) -> Grid:
    """The grid of a zone."""
    return Grid(pitch, *shape, lagrange(np.arange(pitch) / pitch).astype(dtype))


def turns(phase: Array, where: Grid, dtype: type) -> Real:
    """(2, R, K) cos and sin of the phase (R, X) of every row, at the nodes."""
    ahead = at_nodes(phase, where)
    return np.array([np.cos(ahead), np.sin(ahead)], dtype=dtype)


def at_nodes(rows: Array, where: Grid) -> Array:
    """(…, K) rows of pixels (…, X) at the nodes; beyond the zone by the cubic through four pixels at its edge."""
    step = max(1, min(where.pitch, (where.columns - 1) // 3))
    at = where.nodes[1]
    left, right = step * np.arange(4), where.columns - 1 - step * np.arange(3, -1, -1)
    low, high = at < 0, at > where.columns - 1
    before, after = (lagrange((at[out] - own[1]) / step) for out, own in ((low, left), (high, right)))
    inside = rows[..., at[~low & ~high].astype(np.int64)]
    return np.concatenate([rows[..., left] @ before, inside, rows[..., right] @ after], axis=-1)


def lagrange(t: Array) -> Array:
    """(4, …) weights of samples at −1, 0, 1, 2 for the place t; error ≤ 3/128·f'''' in [0, 1], f''''/24 beside it."""
    return np.array(
        [
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t * t - 1.0) * (t - 2.0) / 2.0,
            -t * (t + 1.0) * (t - 2.0) / 2.0,
            t * (t * t - 1.0) / 6.0,
        ]
    )


def taps(position: Array, size: int | NDArray[np.int64], wrap: bool, count: int = 4) -> tuple[NDArray[np.int64], Array]:
    """(…, count) samples and weights that make up a line of ``size`` samples at ``position``: 4 cubic, 2 linear.

    ``size`` may be an array that broadcasts against ``position``. The line repeats if ``wrap``; else its ends go on.
    """
    size = np.asarray(size)
    if not wrap:
        position = np.clip(position, 0.0, size - 1.0)
    start = np.floor(position)
    if count == 4 and not wrap and size.min() >= 4:  # at the ends four samples on one side: repeating one makes a kink
        start = np.clip(start, 1.0, size - 3.0)
    t = position - start
    weight = np.moveaxis(lagrange(t), 0, -1) if count == 4 else np.stack([1.0 - t, t], axis=-1)
    index = start[..., None].astype(np.int64) + np.arange(count) - (count // 2 - 1)
    return (index % size[..., None] if wrap else np.clip(index, 0, size[..., None] - 1)), weight


def resampled(values: Real, position: Array, axis: int, wrap: bool, count: int = 4) -> Real:
    """``values`` along one axis at fractional positions."""
    index, weight = taps(position, values.shape[axis], wrap, count)
    shape = [1] * values.ndim
    shape[axis] = len(position)
    total = np.zeros([*values.shape[:axis], len(position), *values.shape[axis + 1 :]], dtype=values.dtype)
    for k in range(count):
        total += np.take(values, index[:, k], axis=axis) * weight[:, k].reshape(shape).astype(values.dtype)
    return total


class Envelopes:
    """Fits of patterns by polynomials times harmonics of the nominal phase; design matrices are made once."""

    def __init__(self, zone: Zone) -> None:
        rows, columns = zone.shape
        rng = np.random.default_rng(0)  # where the pattern is looked at: any points will do, the same ones each time
        lit = np.setdiff1d(np.arange(rows), zone.dark)
        self._j, self._i = lit[rng.integers(0, len(lit), POINTS)], rng.integers(0, columns, POINTS)
        self._shape = zone.shape
        self._turn = np.ones((1, POINTS))
        if zone.phase is not None:
            theta = zone.phase[self._j, self._i]
            self._turn = np.stack([np.ones(POINTS), np.cos(theta), np.sin(theta), np.cos(2 * theta), np.sin(2 * theta)])
        self._inverse: dict[tuple[int, int], tuple[Array, Array]] = {}

    def fit(self, pattern: Real, tolerance: float) -> tuple[tuple[int, int], Array] | None:
        """Degrees and coefficients (M, nx, ny) of one pattern (R, X); None if none of DEGREES holds it."""
        data = np.asarray(pattern[self._j, self._i], dtype=np.float64)
        for degree in DEGREES:
            if degree not in self._inverse:
                nx, ny = degree
                basis = _basis(self._i, self._shape[1], nx)[:, None] * _basis(self._j, self._shape[0], ny)[None]
                model = (self._turn[:, None, None] * basis[None]).reshape(-1, POINTS).T
                self._inverse[degree] = np.linalg.qr(model)
            q, r = self._inverse[degree]
            term = np.linalg.lstsq(r, q.T @ data, rcond=1e-12)[0]
            if np.abs(q @ (r @ term) - data).max() <= tolerance:
                return degree, np.asarray(term).reshape(len(self._turn), *degree)
        return None

    def on_nodes(self, degree: tuple[int, int], term: Array, where: Grid, dark: Array) -> Array:
        """(M, N, K) envelopes at the nodes, and behind them one row for each of the pattern's rows ``dark`` (D, X)."""
        along, across = where.nodes
        x, y = _basis(across, self._shape[1], degree[0]), _basis(along, self._shape[0], degree[1])
        own = np.zeros((len(term), len(dark), len(across)))
        own[0] = at_nodes(dark, where)
        return np.concatenate([np.einsum("mab,ak,bn->mnk", term, x, y, optimize=True), own], axis=1)


def _basis(at: NDArray[np.int64] | Array, size: int, count: int) -> Array:
    """(count, …) Chebyshev polynomials of a pixel number."""
    u = 2.0 * np.asarray(at, dtype=np.float64) / (size - 1) - 1.0
    return np.asarray(np.polynomial.chebyshev.chebvander(u, count - 1).T)
