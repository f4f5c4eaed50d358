"""Points spread over the unit disc, and polynomials on it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.kernels.bounds import same_disc

Array = NDArray[np.float64]

#: Rays per beam: enough for a polynomial of degree 12 with a third to spare.
NODES = 280
#: Numbers of rays whose fits over a whole disc are prepared.
WHOLE = (NODES, 400, 800, 1000, 1600, 2000)
#: The even part of a disc ends at this share of its radius; the rest lines its edge, for the fits.
EVEN = 0.985


def rim(count: int) -> int:
    """How many of ``count`` points line the edge of the disc."""
    return int(3.0 * np.sqrt(count))


@lru_cache(maxsize=16)
def disc(count: int) -> Array:
    """Points (count, 2) spread evenly over the unit disc (sunflower), with a ring on its edge; not to be written to."""
    ring = rim(count)
    k = np.arange(count - ring) + 0.5
    radius, angle = np.sqrt(k / (count - ring)), np.pi * (1 + 5**0.5) * k
    edge = 2 * np.pi * np.arange(ring) / ring
    inner = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]) * EVEN
    points = np.concatenate([inner, np.column_stack([np.cos(edge), np.sin(edge)])])
    points.flags.writeable = False
    return points


@lru_cache(maxsize=8)
def monomial_powers(degree: int) -> tuple[tuple[int, int], ...]:
    """Powers (i, j), i + j ≤ degree, in the order of ``monomials``."""
    return tuple((i, j) for i in range(degree + 1) for j in range(degree + 1 - i))


def monomials(x: Array, degree: int = 8) -> Array:
    """(N, T) products x^i y^j, i + j ≤ degree, of points (N, 2) in the unit disc."""
    i, j = np.array(monomial_powers(degree)).T
    powers = np.ones((degree + 1, *x.shape))
    for k in range(1, degree + 1):
        powers[k] = powers[k - 1] * x
    values: Array = (powers[i, :, 0] * powers[j, :, 1]).T
    return values


def on_disc(p: Array) -> tuple[Array, Array, float]:
    """Points (N, 2) moved onto the unit disc, and the centre and radius there were. All points of a disc become it."""
    centre = 0.5 * (p.min(axis=0) + p.max(axis=0))
    half = float(np.sqrt(((p - centre) ** 2).sum(axis=1)).max())
    return (p - centre) / half, centre, half


def fitted(x: Array, values: Array, degree: int) -> Array:
    """Least squares on points ``on_disc`` (N, 2): coefficients (T, Q) of ``monomials`` for values (N, Q)."""
    if _whole(x):  # nearly every beam: all rays of the disc, whose factors are kept
        return _projector(len(x), degree) @ values
    q, r = np.linalg.qr(monomials(x, degree))
    coefficient: Array = np.linalg.solve(r, q.T @ values)
    return coefficient


def fitted_rows(p: Array, values: Array, degree: int) -> Array:
    """``fitted`` for points p (N, 2) anywhere and values (Q, N): coefficients (Q, T)."""
    if len(p) in WHOLE and same_disc(p, disc(len(p))):
        found: Array = values @ _projector(len(p), degree).T
        return found
    return np.ascontiguousarray(fitted(on_disc(p)[0], values.T, degree).T)


def _whole(x: Array) -> bool:
    """Whether points are those of a ``disc`` that beams are traced over."""
    return len(x) in WHOLE and bool(np.abs(x - disc(len(x))).max() < 1e-9)


@lru_cache(maxsize=16)
def _projector(count: int, degree: int) -> Array:
    q, r = np.linalg.qr(monomials(disc(count), degree))
    projector: Array = np.linalg.solve(r, q.T)
    return projector
