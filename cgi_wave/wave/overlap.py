"""Overlap of two pupil fields: the complex contrast γ (direction space) or the mutual intensity J (pupil space)."""

from __future__ import annotations

import cmath
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.wave.basis import Array, chebyshev_tail, chebyshev_wavenumbers, expand
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.region import METHOD as PANELS
from cgi_wave.wave.region import (
    SAFETY,
    Boundary,
    Integral,
    Region,
    Rough,
    boundary,
    build,
    find_region,
    integrate,
    rough,
    spread,
)
from cgi_wave.wave.stokes import BOUNDARY_METHOD as BOUNDARY
from cgi_wave.wave.stokes import NO_FACTOR, boundary_integral

# Spread of the path difference, in waves, up to which panels are the cheaper way, and the number of wavenumbers from
# which they are: these share their nodes (docs/contrast.md).
FEW_WAVES, MANY_TONES = 12.0, 4
CURVES = 1e-3  # error of the boundary's curves, frame units, for a tolerance of 1
NODE_LIMIT = 129  # wavenumbers at which one pair may be computed
_ONE = np.ones((1, 1))
_TINY = 1e-3  # |value| below which the slope is the plain mean: the weighted one loses its meaning


@dataclass(frozen=True)
class Overlap:
    """∫ A_m A_l exp(i 2πσ(opl_m − opl_l) + i(phase_m − phase_l)) d²u / √(P_m P_l), at T wavenumbers.

    The complex contrast is value · exp(i 2πσ·opd_m).

    value : (T,) complex, the constant phase difference included, the pivot's path difference left out
    opd_m : (T,) m, opl_m − opl_l at the pivot
    slope : dOPD/dy at the middle sigma, the integrand-weighted mean of the difference of the y direction cosines
    slope_weighted : False where |value| was too small for that and the mean over the shared support stands instead
    error_bound : (T,) absolute, on value
    shared : √(∫A_m² ∫A_l²) over the shared support / √(P_m P_l), at the middle sigma: |value| cannot exceed it
    pivot : (2,) in units of u
    nodes : quadrature nodes; method : its name; seconds : wall time
    """

    value: NDArray[np.complex128]
    opd_m: Array
    slope: float
    slope_weighted: bool
    error_bound: Array
    shared: float
    pivot: tuple[float, float]
    nodes: int
    method: str
    seconds: float


@dataclass(frozen=True)
class _Pair:
    """The polynomials of two fields in their common frame: phase in cycles, without its value at the pivot.

    steer: difference of the y direction cosines; None where both are the coordinate itself. norm, powers (T,): of the
    two fields, and the root of their product.
    """

    region: Region
    phase: Array
    opd_m: Array
    a: Array
    b: Array
    steer: Array | None
    norm: Array
    powers: tuple[Array, Array]


def _pair(m: PupilField, l: PupilField, sigma: Array, region: Region) -> _Pair:  # noqa: E741
    weights, n = (_weights(m, sigma), _weights(l, sigma)), region.terms
    path, a = _in_frame(m, weights[0], region)
    path_l, b = _in_frame(l, weights[1], region)
    path -= path_l
    opd_m = path[:, 0, 0].copy()
    path[:, 0, 0] = 0.0
    path *= sigma[:, None, None]
    steer = None
    if m.space != "direction" or m.bend != 0.0:
        directions = [
            expand(f.direction[1], f.support.centre, f.support.scale, region.pivot, region.frame, n) for f in (m, l)
        ]
        steer = directions[0] - directions[1]
    powers = _powers(m, weights[0]), _powers(l, weights[1])
    return _Pair(region, path, opd_m, a, b, steer, np.sqrt(powers[0] * powers[1]), powers)


def _powers(field: PupilField, weights: Array) -> Array:
    """(T,) power of a field where its wavenumbers have ``weights`` (T, S)."""
    found: Array = field.power_gram[0] if weights is _ONE else ((weights @ field.power_gram) * weights).sum(axis=1)
    return found


def _weights(field: PupilField, sigma: Array) -> Array:
    """``field.weights``, without the search where a field of one wavenumber is asked for at that."""
    if field.sigma.size == sigma.size == 1 and field.sigma[0] == sigma[0]:
        return _ONE
    return field.weights(sigma)


def _in_frame(field: PupilField, weights: Array, region: Region) -> tuple[Array, Array]:
    """Path length and amplitude (T, n, n) of a field as powers of a region's frame; weights (T, S)."""
    support, n = field.support, region.terms
    both = np.concatenate((field.opl, field.amplitude))
    powers = expand(both, support.centre, support.scale, region.pivot, region.frame, n)
    if weights is _ONE:
        return powers[:1], powers[1:]
    found = weights @ powers.reshape(2, weights.shape[1], n * n)
    return found[0].reshape(-1, n, n), found[1].reshape(-1, n, n)


def _check_pair(m: PupilField, l: PupilField) -> None:  # noqa: E741
    apart = max(abs(p - q) for p, q in zip(m.reference_point, l.reference_point, strict=True))
    if (m.space, m.bend) != (l.space, l.bend) or apart > 1e-12:
        raise InputError(
            f"pair {m.label} | {l.label}",
            "reference_point",
            (m.space, m.bend, m.reference_point, l.space, l.bend, l.reference_point),
            "the two fields stand in different spaces or charts, or about different points",
            "sample both about one detector point and in one chart",
        )


def _panels(pair: _Pair, tol: float) -> tuple[Integral, str]:
    """All integrals of a pair by boundary-fitted Gauss panels; all wavenumbers share the nodes."""
    steer = np.zeros(pair.phase.shape[1:]) if pair.steer is None else pair.steer
    return integrate(pair.region, pair.phase, pair.a, pair.b, steer, pair.norm, tol), PANELS


def _boundary(pair: _Pair, tol: float) -> tuple[Integral, str]:
    """The oscillating integrals along the boundary, one wavenumber at a time; what has no phase in it by panels."""
    region, middle, count = pair.region, pair.phase.shape[0] // 2, pair.phase.shape[0]
    around = boundary(region, CURVES * tol)
    flat, change, unweighted = _flat(pair, around, slice(middle, middle + 1))
    area = region.unit
    factor = NO_FACTOR if pair.steer is None else pair.steer
    found = [
        boundary_integral(around.curves, phase, a, b, factor if t == middle else NO_FACTOR, tol * norm / area)
        for t, (phase, a, b, norm) in enumerate(zip(pair.phase, pair.a, pair.b, pair.norm, strict=True))
    ]
    error = area * np.array([f.error for f in found]) + flat.strip
    worst = float((error / pair.norm).max())
    if worst > 2.0 * tol:
        raise MethodLimitError(
            BOUNDARY, f"error bound {worst:.2g} for a tolerance of {tol:.2g}", worst / tol, f"ask for {worst:.2g}"
        )
    cross, aa, bb, changes = np.array([[flat.cross], [flat.aa], [flat.bb], [change]]).repeat(count, axis=1)
    return Integral(
        np.array([area * f.value for f in found], np.complex128),
        cross,
        aa,
        bb,
        area * found[middle].weighted,
        unweighted,
        flat.area,
        flat.edge,
        error,
        changes,
        max(f.nodes for f in found),
    ), BOUNDARY


def _flat(pair: _Pair, around: Boundary, still: slice) -> tuple[Rough, float, float]:
    """What has no phase in it, at the middle wavenumber; how far max(aa, bb) is off; mean of ``steer`` times cross.

    Where the slope is 0 by definition, all of it goes into bounds only.
    """
    a, b = pair.a[still], pair.b[still]
    found = rough(pair.region, around, a[0], b[0])
    if pair.steer is None:
        return found, 0.01 * max(found.aa, found.bb), 0.0
    flat = integrate(pair.region, np.zeros_like(pair.phase[still]), a, b, pair.steer, pair.norm[still], 1e-6)
    sums = Rough(float(flat.cross[0]), float(flat.aa[0]), float(flat.bb[0]), flat.area, flat.edge, found.strip)
    return sums, float(flat.change_power[0]), flat.unweighted


def _auto(pair: _Pair, tol: float) -> tuple[Integral, str]:
    """Panels for many wavenumbers of few waves, since they share nodes, else along the boundary; or the other way."""
    few = len(pair.phase) >= MANY_TONES and spread(pair.region, pair.phase) <= FEW_WAVES
    order = (_panels, _boundary) if few else (_boundary, _panels)
    try:
        return order[0](pair, tol)
    except MethodLimitError as first:
        try:
            return order[1](pair, tol)
        except MethodLimitError:
            raise first from None


_METHODS: dict[str, Callable[[_Pair, float], tuple[Integral, str]]] = {
    "auto": _auto,
    "panels": _panels,
    "boundary": _boundary,
}


def overlap(m: PupilField, l: PupilField, sigma: Array, tol: float = 1e-6, method: str = "auto") -> Overlap:  # noqa: E741
    """Overlap of two fields at wavenumbers ``sigma`` (T,), 1/m, by quadrature that follows the boundary.

    ``tol`` is the numerical error allowed on ``value``; the misfit of the two fields comes on top in the bound. Fields
    whose supports do not meet give exactly 0 with bound 0. ``method``: "panels" (Gauss panels over the area),
    "boundary" (boundary integrals by steepest descent), or "auto": panels for MANY_TONES or more wavenumbers of up to
    FEW_WAVES waves, the boundary otherwise.

    Raises MethodLimitError beyond the node cap (naming waves and factor) or outside the fields' wavenumbers,
    InputError for fields of different spaces or reference points, or a method of another name.
    """
    if method not in _METHODS:
        raise InputError("overlap", "method", method, "unknown", f"one of {', '.join(_METHODS)}")
    started = time.perf_counter()
    _check_pair(m, l)
    sigma = np.atleast_1d(np.asarray(sigma, float))
    region = find_region([m.support, l.support])
    if region is None:
        zero = np.zeros(sigma.size)
        seconds = time.perf_counter() - started
        dark = np.zeros(sigma.size, np.complex128)
        return Overlap(dark, zero, 0.0, False, zero, 0.0, (0.0, 0.0), 0, "no shared support", seconds)
    pair = _pair(m, l, sigma, region)
    total, name = _METHODS[method](pair, tol)
    raw = total.value / pair.norm
    value = raw * cmath.exp(1j * (m.phase - l.phase))
    middle = sigma.size // 2
    weighted = abs(raw[middle]) > _TINY
    slope = (
        (total.weighted / total.value[middle]).real if weighted else total.unweighted / max(total.cross[middle], 1e-300)
    )
    share = math.sqrt(total.aa[middle] * total.bb[middle]) / float(pair.norm[middle])
    fit = _misfit(m, l, sigma, pair.powers, total.cross / pair.norm, np.abs(raw), total.area)
    rounding = 4e-16 * (2.0 * np.pi * np.abs(pair.phase).sum(axis=(1, 2)) + 10.0)
    error = (total.error + total.edge) / pair.norm + fit + rounding
    pivot = (float(region.pivot[0]), float(region.pivot[1]))
    seconds = time.perf_counter() - started
    return Overlap(value, pair.opd_m, float(slope), bool(weighted), error, share, pivot, total.nodes, name, seconds)


def integral_over(field: PupilField, tol: float) -> tuple[complex, float, float, str]:
    """∫ A exp(i 2πσ·opl + i·phase) d²u over a field's own support at its middle σ: value, error, ∫A d²u, method.

    ``tol``: absolute numerical error allowed. The error holds that, the misfit of the field and the strip that its
    clearances leave open. 0, 0, 0 for an empty support. Raises MethodLimitError as ``overlap`` does.
    """
    region = find_region([field.support])
    if region is None:
        return 0.0, 0.0, 0.0, "no shared support"
    middle, n = field.sigma.size // 2, region.terms
    sigma = float(field.sigma[middle])

    def in_frame(coef: Array) -> Array:
        return expand(coef, field.support.centre, field.support.scale, region.pivot, region.frame, n)[None]

    path = in_frame(field.opl[middle])
    pivot_phase = 2.0 * np.pi * sigma * path[0, 0, 0] + field.phase
    path[:, 0, 0] = 0.0
    one = np.zeros((1, n, n))
    one[0, 0, 0] = 1.0
    unit = np.ones(1)
    pair = _Pair(region, path * sigma, np.zeros(1), in_frame(field.amplitude[middle]), one, None, unit, (unit, unit))
    total, name = _auto(pair, tol)
    cross = float(total.cross[0])
    misfit = min(2.0 * np.pi * sigma * field.opl_residual, 2.0) * cross + field.amplitude_residual * total.area
    rounding = 4e-16 * (2.0 * np.pi * float(np.abs(pair.phase).sum()) + 10.0) * cross
    error = float(total.error[0]) + total.edge + misfit + rounding
    return complex(total.value[0] * np.exp(1j * pivot_phase)), error, cross, name


def _misfit(
    m: PupilField,
    l: PupilField,  # noqa: E741
    sigma: Array,
    powers: tuple[Array, Array],
    cross: Array,
    size: Array,
    area: float,
) -> Array:
    """(T,) what the residuals of the two fits can change: phase, amplitudes, and the powers in the normaliser."""
    phase = np.minimum(2.0 * np.pi * sigma * (m.opl_residual + l.opl_residual), 2.0) * cross
    root = area**0.5
    amplitude = root * (m.amplitude_residual / np.sqrt(powers[0]) + l.amplitude_residual / np.sqrt(powers[1]))
    return phase + amplitude + 0.5 * size * (m.power_error + l.power_error)


def mutual_power_bound(m: PupilField, l: PupilField) -> float:  # noqa: E741
    """Cauchy-Schwarz bound of |value|: √(∫A_m² ∫A_l²) over the shared support / √(P_m P_l), at the middle sigma.

    Good to 1 %, upwards; 0 when the supports do not meet. Needs no phase and costs a few thousand nodes.
    """
    _check_pair(m, l)
    region = find_region([m.support, l.support])
    if region is None:
        return 0.0
    sigma = m.sigma[[m.sigma.size // 2]]
    pair = _pair(m, l, sigma, region)
    none = np.zeros(pair.phase.shape[1:])
    total = integrate(region, np.zeros_like(pair.phase), pair.a, pair.b, none, pair.norm, 1e-3)
    strip = (total.edge + SAFETY * float(total.change_power.max())) / float(pair.norm[0])
    return min(1.0, 1.005 * float(np.sqrt(total.aa[0] * total.bb[0]) / pair.norm[0]) + strip)


def overlap_spectrum(
    m: PupilField,
    l: PupilField,  # noqa: E741
    sigma_min: float,
    sigma_max: float,
    tol: float = 1e-5,
) -> tuple[Array, Overlap]:
    """Overlap at as many Chebyshev wavenumbers as interpolation between them to ``tol`` needs.

    The path difference ranges over the region by R metres, so that value(σ) turns through R·(σmax − σmin) cycles: that
    sets the first count; the tail of its Chebyshev series decides, and is added to the error bound.

    Raises MethodLimitError when more than NODE_LIMIT wavenumbers would be needed.
    """
    _check_pair(m, l)
    region = find_region([m.support, l.support])
    cycles = 0.0
    if region is not None:
        middle = np.array([0.5 * (sigma_min + sigma_max)])
        pair = _pair(m, l, middle, region)
        cycles = spread(region, pair.phase) * (sigma_max - sigma_min) / middle[0]
    count = 5 + int(np.ceil(1.1 * np.pi * cycles))
    while count <= NODE_LIMIT:
        nodes = chebyshev_wavenumbers(sigma_min, sigma_max, count)
        result = overlap(m, l, nodes, tol)
        tail = chebyshev_tail(result.value)
        if tail <= tol:
            return nodes, replace(result, error_bound=result.error_bound + tail)
        count = count + max(4, count // 2)
    raise MethodLimitError(
        "overlap over a band",
        f"{m.label} | {l.label}: {cycles:.3g} cycles of path difference over the band need {count} wavenumbers "
        f"(limit {NODE_LIMIT})",
        count / NODE_LIMIT,
        "narrow the band, or bound the contrast and leave the pair out",
    )


def phase_spread(m: PupilField, l: PupilField, sigma: float) -> float:  # noqa: E741
    """Waves through which the path difference of two fields runs over their common support; 0 if there is none."""
    _check_pair(m, l)
    region = find_region([m.support, l.support])
    return 0.0 if region is None else spread(region, _pair(m, l, np.array([sigma]), region).phase)


def quadrature_nodes(m: PupilField, l: PupilField, sigma: float) -> float:  # noqa: E741
    """Nodes of the first two levels of Gauss panels for a pair. Raises MethodLimitError beyond the node cap."""
    _check_pair(m, l)
    region = find_region([m.support, l.support])
    if region is None:
        return 0.0
    phase = _pair(m, l, np.array([sigma]), region).phase
    return float(sum(build(region, phase, 0.0, level).nodes for level in (0, 1)))
