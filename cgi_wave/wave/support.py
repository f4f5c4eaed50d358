"""Where a field is lit: the domain of its polynomials, the clearances that bound it, a fence where nothing is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import FoldedFieldError, MethodLimitError
from cgi_wave.wave.basis import Array, evaluate
from cgi_wave.wave.fitting import polynomials
from cgi_wave.wave.region import Support
from cgi_wave.wave.samples import PupilSamples

MARGIN = 1.5  # sample spacings beyond the lit samples within which the true boundary must lie
MANY, SHADOW_GRID = 4, 121  # clearances beyond which shadowed ones are looked for, and points per axis for that
TANGENTS, INWARD = 16, 0.5  # tangents of the lit samples; those matter that cut the domain by this many spacings
FENCE_GRID = 61  # points per axis on which clearances are looked at beyond a tangent
METHOD = "polynomial pupil field"


def domain(samples: PupilSamples, lit: NDArray[np.bool_]) -> tuple[Array, Array, float]:
    """Centre and semi-axes of the ellipse that bounds the lit samples with a margin; sample spacing in its unit.

    The margin is where the true boundary must lie, beyond the last lit sample.
    """
    points = samples.u[lit]
    lo, hi = points.min(axis=0), points.max(axis=0)
    centre, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
    if np.any(half <= 0.0):
        raise FoldedFieldError(f"{samples.label}: the samples lie on a line; use the position-space field")
    reach = float(np.sqrt((((points - centre) / half) ** 2).sum(axis=1).max()))
    spacing = min(float(np.sqrt(np.pi / lit.sum(axis=1).min())), 0.4)
    return centre, half * reach * (1.0 + MARGIN * spacing), spacing


def cutting(least: Array, worst: Array, coef: Array, x: Array, spacing: float) -> NDArray[np.bool_]:
    """(K,) which clearances can reach zero within two sample spacings of the lit samples.

    least (K,): their smallest value there; worst (K,): largest misfit; coef (K, n, n), x (N, 2): polynomials and points
    at the middle sigma.
    """
    slopes = polynomials(coef, x)[:, 1:]
    steepest = np.hypot(slopes[:, 0], slopes[:, 1]).max(axis=1)
    cut: NDArray[np.bool_] = least < 2.0 * spacing * steepest + worst
    return cut


def unshadowed(support: Support) -> Support:
    """Without the clearances that stay positive wherever all others are: every one costs the boundary search.

    Only beams with more than MANY of them are worth it. On a grid, all clearances but one show a region; the one has to
    exceed, at its nodes and where lines of the grid leave it, the residuals and half of what it changes by from one
    node to the next there. They go one by one, the most positive first.
    """
    if len(support.clearance) <= MANY:
        return support
    axis = np.linspace(-1.0, 1.0, SHADOW_GRID)
    values = evaluate(support.clearance, axis, axis)
    # The domain's own edge bounds what the polynomials are asked for.
    disc = 1.0 - axis[:, None] ** 2 - axis[None, :] ** 2
    kept = list(range(len(values)))
    lit = (values > 0.0).all(axis=0) & (disc > 0.0)
    for k in np.argsort([-value[lit].min(initial=np.inf) for value in values]):
        others = [j for j in kept if j != k]
        if len(others) < 2:
            break
        rest = np.minimum(values[others].min(axis=0), disc)
        here = np.array([rest, values[k]])
        least, step = float(values[k][rest > 0.0].min(initial=np.inf)), 0.0
        for a, b in ((here[:, 1:], here[:, :-1]), (here[:, :, 1:], here[:, :, :-1])):
            leaves = (a[0] > 0.0) != (b[0] > 0.0)
            (rest_a, own_a), (rest_b, own_b) = a[:, leaves], b[:, leaves]
            crossing = own_a + rest_a / (rest_a - rest_b) * (own_b - own_a)
            least = min(least, float(crossing.min(initial=np.inf)))
            step = max(step, float(np.abs(own_b - own_a).max(initial=0.0)))
        if least > support.residual[k] + 2.0 * support.residual[others].max() + 0.5 * step:
            kept = others
    return Support(support.centre, support.scale, support.clearance[kept], support.residual[kept])


def fenced(support: Support, x: Array, spacing: float, label: str) -> Support:
    """The support without what polynomials make of places where no sample takes part in their fit.

    x (N, 2): lit samples. Beyond their convex hull and the margin, clearances that nothing holds may all be positive,
    with any amplitude there. Straight edges keep that out, tangents of the hull moved out by the margin: those beyond
    which, on a grid, the clearances come near zero. Raises MethodLimitError where they are positive at such an edge, or
    at the edge of the domain: the boundary is then not known.
    """
    angle = 2.0 * np.pi * np.arange(TANGENTS) / TANGENTS
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    height = (x @ normal.T).max(axis=0) + MARGIN * spacing
    inward = np.flatnonzero(height < 1.0 - INWARD * spacing)
    if len(inward) and len(support.clearance):
        at = _nearly_lit(support)
        inward = inward[(at @ normal[inward].T > height[inward]).any(axis=0)]
    normal, height = normal[inward], height[inward]
    turn = np.linspace(0.0, 2.0 * np.pi, 256, endpoint=False)
    rim = [np.column_stack([np.cos(turn), np.sin(turn)])]
    along = np.linspace(-1.0, 1.0, 101)[:, None]
    rim += [h * d + along * np.array([-d[1], d[0]]) for d, h in zip(normal, height, strict=True)]
    edge = np.concatenate(rim)
    edge = edge[((edge**2).sum(axis=1) <= 1.0 + 1e-9) & (edge @ normal.T <= height + 1e-9).all(axis=1)]
    open_edge = polynomials(support.clearance, edge)[:, 0].min(axis=0, initial=np.inf) > 0.0
    if np.any(open_edge):
        raise MethodLimitError(
            METHOD,
            f"{label}: the clearances leave {np.mean(open_edge):.0%} of the edge of the sampled domain open",
            1.0 + float(np.mean(open_edge)),
            "sample beyond the aperture, or give the clearance of the aperture that the rays were launched into",
        )
    fence = np.zeros((len(height), *support.clearance.shape[1:]))
    fence[:, 0, 0], fence[:, 1, 0], fence[:, 0, 1] = height, -normal[:, 0], -normal[:, 1]
    return Support(support.centre, support.scale, np.concatenate([support.clearance, fence]),
                   np.append(support.residual, np.zeros(len(height))))  # fmt: skip


def _nearly_lit(support: Support) -> Array:
    """Points (P, 2) of a grid over the domain where all clearances are positive, or could be before the next point."""
    axis = np.linspace(-1.0, 1.0, FENCE_GRID)
    least = evaluate(support.clearance, axis, axis).min(axis=0)
    change = np.zeros_like(least)
    for axes in (change, least), (change.T, least.T):  # along rows, then along columns
        step = np.abs(np.diff(axes[1], axis=0))
        np.maximum(axes[0][1:], step, out=axes[0][1:])
        np.maximum(axes[0][:-1], step, out=axes[0][:-1])
    i, j = np.nonzero((least > -change) & (axis[:, None] ** 2 + axis[None, :] ** 2 <= 1.0))
    return np.column_stack([axis[i], axis[j]])
