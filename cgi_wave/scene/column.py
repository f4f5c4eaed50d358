"""A gas column that varies over the scene, as a few spectral modes.

L(X, Y, σ) = a(X, Y)·L₀(σ)·exp(−τ(σ)·e(X, Y)): e is the excess of the column over the one in L₀, in units of the column
that τ belongs to. Over the range of e these spectra span a space of few dimensions. It is found from spectra at
Chebyshev points of e, by a singular value decomposition weighed with the filter; the weights of its modes are
polynomials in e, so that each becomes a map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.ground import Scene, refuse_bad, require_filter

Array = NDArray[np.float64]

TOLERANCE = 1e-6
#: Maps are float32: the low-rank form can do no better.
FINEST = 1e-7
_COLUMNS = (4, 8, 16, 32, 64)
#: exp(−τ e) may grow by this many e-folds where there is less gas, before radiance that has underflowed matters.
_UNDERFLOW = 700.0
_FAINT = 40.0
#: Between the columns held out the residual has been seen up to 4 % above its largest there.
_MARGIN = 1.1


@dataclass(frozen=True)
class ColumnModes:
    """exp(−τ e) − 1 times the reference radiance, for e in [low, high], as Σ_c coefficient_c(e)·shapes[c].

    shapes : (R, S) in units of the reference radiance; coefficients : (N, R) Chebyshev series in e mapped to [−1, 1],
    of magnitude about 1 or less
    residual : ∫F|ΔL| dσ / ∫F L₀ dσ at most: 1.1 times the largest of the ``held_out`` columns, none of which the modes
        were made from
    """

    shapes: Array
    coefficients: Array
    low: float
    high: float
    residual: float
    held_out: int

    def weights(self, excess: Array) -> NDArray[np.float32]:
        """(R, …) weights of the modes at any array of excesses within [low, high]."""
        half = 0.5 * (self.high - self.low) or 1.0
        x = (np.asarray(excess, dtype=np.float64) - 0.5 * (self.high + self.low)) / half
        values: NDArray[np.float32] = chebyshev.chebval(x, self.coefficients).astype(np.float32)
        return values


def column_modes(
    sigma: Array,
    radiance: Array,
    depth: Array,
    band_filter: Filter,
    low: float,
    high: float,
    tolerance: float = TOLERANCE,
) -> ColumnModes:
    """The modes of radiance·(exp(−depth·e) − 1) for low ≤ e ≤ high.

    radiance (S,) is that at e = 0, depth (S,) ≥ 0 the optical depth along the slant path of one unit of e. The number
    of modes is the smallest whose residual at held-out columns (between those sampled, and at both ends) is below
    ``tolerance``, with weights rounded to float32 as maps are.

    Raises InputError for a depth or range that cannot be, MethodLimitError if 64 columns are too few.
    """

    def refuse(field: str, value: object, problem: str, remedy: str) -> InputError:
        return InputError("gas column", field, value, problem, remedy)

    if depth.shape != sigma.shape:
        raise refuse("depth", depth.shape, f"not {sigma.shape}", "give it at the spectrum's wavenumbers")
    refuse_bad("gas column", "depth", depth, ("sample",))
    refuse_bad("gas column", "depth", depth, ("sample",), negative=True)
    if not (np.isfinite(low) and np.isfinite(high) and low <= high):
        raise refuse("excess", (low, high), "not a range", "give finite values")
    if not tolerance >= FINEST:
        raise refuse("tolerance", tolerance, "finer than float32 maps can hold", f"give {FINEST:g} or more")
    dark = (radiance <= 0) & (depth > 0)
    if low < 0 and dark.any() and _UNDERFLOW * (1 + low) < _FAINT:
        raise refuse(
            "excess", low, "the background radiance is zero where less gas lets light through", "give −0.94 or more"
        )

    passed = band_filter.transmission(sigma)
    passed = passed / (passed @ radiance)  # ∫F L₀ = 1 from here on
    log = np.log(radiance, out=np.full_like(radiance, -np.inf), where=radiance > 0)

    def change(excess: Array) -> Array:
        with np.errstate(over="ignore"):
            exponent = log[:, None] - depth[:, None] * excess
            # exp(…) − 1 keeps its digits where the change is small
            small = np.abs(depth[:, None] * excess) < 1
            value = np.where(
                small, radiance[:, None] * np.expm1(np.where(small, -depth[:, None] * excess, 0.0)),
                np.exp(exponent) - radiance[:, None],
            )  # fmt: skip
        if not np.isfinite(value).all():
            raise refuse("excess", low, "the radiance overflows", "give a background with less gas in it")
        return value

    middle, half = 0.5 * (high + low), 0.5 * (high - low)
    residual = np.inf
    for count in _COLUMNS if half > 0 else (1,):
        angle = np.pi * (np.arange(count) + 0.5) / count
        nodes = -np.cos(angle)
        # Both ends, and three columns or so between two nodes, none of them a node.
        held_out = -np.cos(np.pi * np.arange(3 * count + 1) / (3 * count))
        sampled, truth = change(middle + half * nodes), change(middle + half * held_out)
        # By Cauchy and Schwarz ∫F|Δ| ≤ √∫(FΔ)²/q for any density q: one that follows the mean light of these columns
        # and the background.
        density = passed * (2 * radiance + np.maximum(sampled.mean(axis=1), -radiance))
        root = np.sqrt(density / density.sum())
        weighed = np.divide(
            passed[:, None] * sampled, root[:, None], out=np.zeros_like(sampled), where=root[:, None] > 0
        )
        *_, right = np.linalg.svd(np.linalg.qr(weighed, mode="r"))
        series = np.linalg.solve(chebyshev.chebvander(nodes, count - 1), right.T)
        scale = np.abs(right).max(axis=1)
        shapes = scale[:, None] * (right @ sampled.T)

        every = ColumnModes(shapes, series / scale, low, high, 0.0, held_out.size)
        best = _fewest(every, truth, middle + half * held_out, passed, tolerance)
        residual = best.residual
        if residual <= tolerance:
            return best
    raise MethodLimitError(
        "column_modes",
        f"{_COLUMNS[-1]} columns from {low:g} to {high:g} leave a residual of {residual:.1e}",
        residual / tolerance,
        "narrow the range of columns or allow a larger tolerance",
    )


def _fewest(every: ColumnModes, truth: Array, excess: Array, passed: Array, tolerance: float) -> ColumnModes:
    """The fewest leading modes that keep the tolerance at the held-out columns; all of them if none do.

    truth (S, M): change of the radiance at ``excess`` (M,); passed (S,): filter over ∫F L₀ dσ.
    """

    def leading(rank: int) -> ColumnModes:
        modes = replace(every, shapes=every.shapes[:rank], coefficients=every.coefficients[:, :rank])
        left = truth - modes.shapes.T @ modes.weights(excess).astype(np.float64)
        return replace(modes, residual=_MARGIN * float((passed @ np.abs(left)).max()))

    best, too_few = leading(len(every.shapes)), 0
    if best.residual > tolerance:
        return best
    while len(best.shapes) - too_few > 1:
        tried = leading((too_few + len(best.shapes)) // 2)
        if tried.residual <= tolerance:
            best = tried
        else:
            too_few = len(tried.shapes)
    return best


def with_column(
    scene: Scene,
    excess: Array,
    depth: Array,
    band_filter: Filter,
    tolerance: float = TOLERANCE,
    what: str = "gas column",
) -> Scene:
    """The scene seen through more (or less) of a gas: its radiance times exp(−depth(σ)·excess(X, Y)).

    scene : of one spectral mode, which stays mode 0
    excess : (H, W) dimensionless: extra column over that for which ``depth`` is given. With the depth of the whole
        background column along the slant path, a column factor f (more gas, a higher surface pressure, another air
        mass) is an excess of f − 1. It scales the depth without changing line shapes, which is exact for more of the
        same air; gas near the ground has broader lines: give ``depth`` of that layer then.
    depth : (S,) ≥ 0 optical depth along the slant path for an excess of 1

    ``rank_residual`` of the result is relative to ∫filter·shapes[0]. Raises InputError for a scene that has several
    modes already, arrays that do not fit, a spectrum that does not cover the filter; and as ``column_modes`` does.
    """
    if len(scene.maps) != 1:
        raise InputError(
            scene.name, "modes", len(scene.maps), "a gas column has been applied already",
            "add up all excesses and apply the sum once to the scene of one mode",
        )  # fmt: skip
    if excess.shape != scene.maps.shape[1:]:
        raise InputError(what, "excess", excess.shape, f"not {scene.maps.shape[1:]}", "give one value per pixel")
    refuse_bad(what, "excess", excess, ("row", "column"))
    require_filter(scene, band_filter)
    low, high = float(excess.min()), float(excess.max())
    if low == high == 0:
        return scene
    modes = column_modes(scene.sigma, scene.shapes[0], depth, band_filter, low, high, tolerance)
    maps = np.empty((1 + len(modes.shapes), *excess.shape), dtype=np.float32)
    maps[0] = scene.maps[0]
    for row in range(scene.rows):
        maps[1:, row] = modes.weights(excess[row]) * scene.maps[0, row]
    source = (
        f"{scene.source}; {what}, excess {low:.3g} to {high:.3g} in {len(modes.shapes)} modes, "
        f"residual {modes.residual:.1e} at {modes.held_out} columns held out"
    )
    return replace(
        scene, maps=maps, shapes=np.vstack([scene.shapes, modes.shapes]), source=source, rank_residual=modes.residual
    )
