"""Where a field is lit: the domain of its polynomials, the clearances that bound it, a fence where nothing is known."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import MethodLimitError
from cgi_wave.kernels import bounds
from cgi_wave.wave.basis import Array
from cgi_wave.wave.fitting import polynomials
from cgi_wave.wave.region import Support

MARGIN = 1.5  # sample spacings beyond the lit samples within which the true boundary must lie
MANY = 4  # clearances beyond which shadowed ones are looked for
SHADOW_GRIDS = 41, 81  # points per axis for that: most are plain on the first grid, for a quarter of the price
TANGENTS, INWARD = 16, 0.5  # tangents of the lit samples; those matter that cut the domain by this many spacings
FENCE_GRID = 61  # points per axis on which clearances are looked at beyond a tangent
METHOD = "polynomial pupil field"


def cutting(extent: Array, worst: Array, coef: Array, x: Array, spacing: float) -> NDArray[np.bool_]:
    """(K,) which clearances can reach zero within two sample spacings of the lit samples.

    extent (K, 2): their least value over the lit samples and their range, at all wavenumbers; worst (K,): largest
    misfit; coef (K, n, n), x (N, 2): polynomials and points at the middle sigma.
    """
    least = extent[:, 0]
    # Within the unit disc a slope of half the range is met somewhere.
    cut: NDArray[np.bool_] = least < spacing * extent[:, 1] + worst
    doubtful = np.flatnonzero(~cut)
    if len(doubtful):
        n = bounds.terms_used(coef)
        slopes = polynomials(coef[doubtful, :n, :n], x)[:, 1:]
        steepest = np.hypot(slopes[:, 0], slopes[:, 1]).max(axis=1)
        cut[doubtful] = least[doubtful] < 2.0 * spacing * steepest + worst[doubtful]
    return cut


def unshadowed(support: Support) -> Support:
    """Without clearances that stay positive wherever all others are: every one costs the boundary search.

    Only beams with more than MANY of them are worth it. On a grid, all clearances but one show a region; the one has to
    exceed, at its nodes and where lines of the grid leave it, the residuals and half of what it changes by from one
    node to the next there. They go one by one, the most positive first.
    """
    if len(support.clearance) <= MANY:
        return support
    kept = bounds.unshadowed(support.clearance, support.residual, *map(_grid, SHADOW_GRIDS))
    return Support(support.centre, support.scale, support.clearance[kept], support.residual[kept])


def fenced(support: Support, x: Array, spacing: float, label: str) -> Support:
    """The support without what polynomials make of places where no sample takes part in their fit.

    x (N, 2): lit samples. Beyond their convex hull and the margin, clearances that nothing holds may all be positive,
    with any amplitude there. Straight edges keep that out, tangents of the hull moved out by the margin: those beyond
    which, on a grid, the clearances come near zero. Raises MethodLimitError where they are positive at such an edge, or
    at the edge of the domain: the boundary is then not known.
    """
    normal, rim, line = _tangents()
    height = bounds.heights(x, normal) + MARGIN * spacing
    inward = np.flatnonzero(height < 1.0 - INWARD * spacing)
    if len(inward) and len(support.clearance):
        along = _grid(FENCE_GRID)
        values = bounds.on_grid(support.clearance, along)
        inward = inward[bounds.beyond(values, along[1], normal[inward], height[inward])]
    normal, height = normal[inward], height[inward]
    count, opened = bounds.count_open(support.clearance, rim, line, normal, height)
    if opened:
        raise MethodLimitError(
            METHOD,
            f"{label}: the clearances leave {opened / count:.0%} of the edge of the sampled domain open",
            1.0 + opened / count,
            "sample beyond the aperture, or give the clearance of the aperture that the rays were launched into",
        )
    fence = np.zeros((len(height), *support.clearance.shape[1:]))
    fence[:, 0, 0], fence[:, 1, 0], fence[:, 0, 1] = height, -normal[:, 0], -normal[:, 1]
    return Support(support.centre, support.scale, np.concatenate([support.clearance, fence]),
                   np.append(support.residual, np.zeros(len(height))))  # fmt: skip


@lru_cache(maxsize=1)
def _tangents() -> tuple[Array, Array, Array]:
    """Normals of the tangents (TANGENTS, 2), points on the unit circle (256, 2), places along a tangent (101,)."""
    normal, rim = (np.linspace(0.0, 2.0 * np.pi, count, endpoint=False) for count in (TANGENTS, 256))
    along = np.linspace(-1.0, 1.0, 101)
    return np.column_stack([np.cos(normal), np.sin(normal)]), np.column_stack([np.cos(rim), np.sin(rim)]), along


@lru_cache(maxsize=4)
def _grid(count: int) -> Array:
    """The Chebyshev polynomials (32, count) at an axis of ``count`` points over the domain; the second is the axis."""
    axis = np.linspace(-1.0, 1.0, count)
    return np.ascontiguousarray(np.polynomial.chebyshev.chebvander(axis, 31).T)
