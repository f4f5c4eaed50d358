"""Fringe patterns over a zone of the detector: Eq. 2 for every pixel, under uniform light of given spectral shapes.

    P_c(x, y) = Σ_m t_m b_c + ∫ w_c(σ) Σ_pairs 2√(t_m t_l) Re[γ_ml(σ) exp(i 2πσ OPD_ml(σ))] dσ,   b_c = ∫ w_c dσ

t, γ and OPD are those of the fringe field at each pixel, averaged over the pixel. A direct sum costs pixels × pairs ×
spectral samples. Here

* the spectrum is reduced to the few wavenumbers that its product with γ exp(i 2πσ OPD) needs (``chebyshev.compress``);
* from each pair's fringes the nearest whole multiple h of the nominal phase φ = 2πσ0·OPD is taken out. What is left is
  smooth: it is summed over pairs on a small grid of Chebyshev nodes, and carried to the pixels by two matrix products;
* all pairs of one multiple share one carrier exp(ihφ), and all carriers one sine and cosine per pixel.

Beams that see the scene alike make one layer: the nominal beams, what interferes with them, and ghosts that image the
scene onto itself; every other family of ghosts, with its own map and blur, makes a layer of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.field import FieldPair, FringeField, SceneView, at_sigma
from cgi_wave.fringes.spectral import check_step, trapezoid, within
from cgi_wave.kernels.fringes import add_fringes

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
METHOD = "fringe pattern"
#: Nodes along y and x of the grids on which what is left of a pair's fringes is looked for, one after the other.
GRIDS = ((16, 12), (32, 24), (64, 48))
THREADS = 2
#: Distance, in pixels, from the nominal image below which a ghost is taken to image the scene onto itself.
SAME_IMAGE = 0.25


@dataclass(frozen=True)
class Layer:
    """Fringe pattern of beams that see the scene alike.

    name : "nominal", or the parasitic history of a family; pattern (C, R, K) : relative irradiance per spectral shape
    over the zone's rows and columns; view : how the scene is seen, None for the nominal image
    error : bound of what is wrong with ``pattern[0]`` anywhere, relative irradiance: the sum of the next five
    contrast : bounds of the contrasts at the traced points; power : of the powers; interpolation : measured between
    traced points, over pairs added plainly; left_out : amplitudes of pairs that no grid resolves; numerical : reduction
    of the spectrum and of the smooth part
    """

    name: str
    pattern: NDArray[np.floating]
    view: SceneView | None
    error: float
    contrast: float
    power: float
    interpolation: float
    left_out: float
    numerical: float


@dataclass(frozen=True)
class _Resolved:
    """A pair's fringes: multiple of the carrier, what is left of them (C, My, Mx) or None, largest amplitude, error."""

    harmonic: int
    envelope: Complex | None
    amplitude: float
    missed: float


@dataclass
class _Group:
    """Smooth parts on the grid (C, My, Mx): baseline, and a complex envelope per harmonic; shaded alike by the arms."""

    base: Array
    harmonics: dict[int, Complex] = field(default_factory=dict)


@dataclass
class _Sums:
    """What one layer gathers: groups by how often its light passes the arms, and its errors."""

    view: SceneView | None
    grid: tuple[Array, Array]
    groups: dict[tuple[int, int], _Group] = field(default_factory=dict)
    contrast: float = 0.0
    power: float = 0.0
    interpolation: float = 0.0
    left_out: float = 0.0
    numerical: float = 0.0


def fringe_patterns(
    zone: FringeField, sigma: Array, weights: Array, tolerance: float = 1e-7, pixel: bool = True, apart: bool = True,
    dtype: type = np.float64,
) -> tuple[Layer, ...]:  # fmt: skip
    """Patterns of all layers of a fringe field, the nominal one first.

    sigma (S,) 1/m ascending; weights (C, S): filter × spectral shape, the first ≥ 0: its integral makes the unit.
    tolerance: largest error of the reduction, as a share of the nominal baseline; pixel: average over pixels (to second
    order of what changes within one), or take their centres; apart: False puts all families into the first layer, which
    is all that a uniform scene needs; dtype: of the patterns, which take most of the memory until images are made.

    A pair whose fringes, less a multiple of the nominal ones, are not smooth on the finest of GRIDS is left out, with
    its amplitude as the bound. Raises InputError for weights that do not fit; MethodLimitError if the spectral step
    exceeds 1/(4·largest group OPD), the pairs' spectral range misses more than 1e-4 of the weight, or the nominal pair
    is not smooth.
    """
    sigma, measures = _measures(sigma, np.atleast_2d(weights))
    inside, lost = within([pair.sigma for pair in zone.pairs], sigma, measures, METHOD)
    sigma, measures = sigma[inside], measures[:, inside]
    node, reduced = _spectrum(zone, sigma, measures)
    allowed = tolerance * float(zone.transmission[:2].sum(axis=0).mean()) / len(zone.pairs)
    found = [_resolved(zone, pair, node, reduced, allowed, pixel) for pair in zone.pairs]
    nominal = found[zone.pairs.index(zone.nominal)]
    if nominal.envelope is None:
        raise MethodLimitError(
            METHOD, f"{zone.band}: on {GRIDS[-1]} nodes the nominal contrast is known to {nominal.missed:.2g}",
            nominal.missed / allowed, "trace fewer field points, or raise the tolerance",
        )  # fmt: skip
    layers = []
    for name, s in _layers(zone, found, reduced, zone.views if apart else ()).items():
        pattern: NDArray[np.floating] = _to_pixels(zone, s).astype(dtype, copy=False)
        numerical = s.numerical + 2.0 * lost * float(np.abs(pattern[0]).max())
        error = s.contrast + s.power + s.interpolation + s.left_out + numerical
        layers.append(Layer(name, pattern, s.view, error, s.contrast, s.power, s.interpolation, s.left_out, numerical))
    return tuple(layers)


def _measures(sigma: Array, weights: Array) -> tuple[Array, Array]:
    """Wavenumbers and trapezoidal measures (C, S), those of the first adding up to 1."""
    if sigma.ndim != 1 or weights.shape != (len(weights), len(sigma)) or not np.all(np.isfinite(weights)):
        raise InputError(METHOD, "weights", weights.shape, f"do not fit {sigma.shape} wavenumbers, or are not finite",
                         "give one row per spectral shape, on the grid of sigma")  # fmt: skip
    if not (np.all(np.diff(sigma) > 0.0) and np.all(weights[0] >= 0.0) and weights[0].sum() > 0.0):
        raise InputError(METHOD, "weights", float(weights[0].min()), "of the first shape must be ≥ 0 and not all zero, "
                         "and wavenumbers ascend", "check that the filter lies inside the spectrum")  # fmt: skip
    step = trapezoid(sigma)
    return sigma, weights * step / float(weights[0] @ step)


def _group_opd(pair: FieldPair) -> float:
    """Largest |d(σ·OPD)/dσ| of a pair over the zone's nodes, m."""
    if len(pair.sigma) == 1:
        return float(np.abs(pair.opd_m).max())
    product = pair.sigma[:, None, None] * pair.opd_m
    return float(np.abs(np.tensordot(chebyshev.derivative_matrix(pair.sigma), product, 1)).max())


def _spectrum(zone: FringeField, sigma: Array, measures: Array) -> tuple[Array, Array]:
    """Few wavenumbers (J,) and weights (C, J) that stand for the spectrum, up to the largest group OPD."""
    if len(sigma) == 1:
        return sigma, measures
    reach = max(_group_opd(pair) for pair in zone.pairs)
    check_step(sigma, reach, METHOD)
    degree = max(len(pair.sigma) for pair in zone.pairs)
    count = chebyshev.degree_for(np.pi * float(np.ptp(sigma)) * reach, degree)
    return chebyshev.compress(sigma, measures, count, sigma[0], sigma[-1])


def _grid(zone: FringeField, size: tuple[int, int]) -> tuple[Array, Array]:
    return chebyshev.nodes(size[0], *zone.zone[2:]), chebyshev.nodes(size[1], *zone.zone[:2])


def _resolved(
    zone: FringeField, pair: FieldPair, node: Array, reduced: Array, allowed: float, pixel: bool
) -> _Resolved:
    """One pair's fringes on the first of GRIDS where their series has ended in both directions of the field."""
    _, opd = at_sigma(zone.nominal, zone.sigma0)
    largest, missed, h = 0.0, np.inf, 0
    for size in GRIDS:
        y, x = _grid(zone, size)
        to = zone.to(y, x)
        amplitude = 2.0 * (to[0] @ zone.strength(pair) @ to[1])
        largest = float(np.abs(amplitude).max())
        h, left, missed = _envelope(zone, pair, amplitude, zone.sigma0 * opd, node, reduced, (y, x), to, pixel)
        missed += float(max(chebyshev.tail(np.moveaxis(left, 1, -1)).max(), chebyshev.tail(left).max()))
        if missed <= allowed:
            return _Resolved(h, left, largest, missed)
    return _Resolved(h, None, largest * float(np.abs(pair.gamma).max()), missed)


def _layers(
    zone: FringeField, found: Sequence[_Resolved], reduced: Array, views: Sequence[SceneView]
) -> dict[str, _Sums]:
    """Sums of all layers, the nominal one first, each on the finest grid that one of its pairs needs.

    Families without a view belong to the nominal layer.
    """
    seen = dict.fromkeys(zone.family.tolist(), "nominal")
    sums = {"nominal": _Sums(None, _grid(zone, GRIDS[0]))}
    for view in views:
        same = _onto_itself(zone, view)
        seen[view.family] = "nominal" if same else view.name
        if not same:
            sums[view.name] = _Sums(view, _grid(zone, GRIDS[0]))
    for pair, one in zip(zone.pairs, found, strict=True):
        own = sums[seen[_layer_of(zone, pair)]]
        if one.envelope is not None and one.envelope.shape[1] > len(own.grid[0]):
            own.grid = _grid(zone, one.envelope.shape[1:])
    unit = reduced.sum(axis=1)
    for number, family in enumerate(zone.family.tolist()):
        own = sums[seen[family]]
        to_y, to_x = zone.to(*own.grid)
        group = _group(own, _passes(zone, (number,)), len(unit))
        group.base += unit[:, None, None] * (to_y @ zone.transmission[number] @ to_x)
        own.power += float(zone.transmission_error[number])
    sums["nominal"].interpolation += zone.transmission_interpolation
    for pair, one in zip(zone.pairs, found, strict=True):
        own = sums[seen[_layer_of(zone, pair)]]
        if one.envelope is None:
            own.left_out += one.amplitude
            continue
        from_y, from_x = _grid(zone, one.envelope.shape[1:])
        to_y = chebyshev.interpolation_matrix(from_y, own.grid[0])
        to_x = chebyshev.interpolation_matrix(from_x, own.grid[1]).T
        envelope = to_y @ one.envelope @ to_x
        group = _group(own, _passes(zone, (pair.m, pair.l)), len(unit))
        if one.harmonic == 0:
            group.base += envelope.real
        else:
            group.harmonics[one.harmonic] = group.harmonics.get(one.harmonic, np.zeros_like(envelope)) + envelope
        own.contrast += one.amplitude * pair.error
        own.interpolation += 2.0 * pair.interpolation
        own.numerical += one.missed
    return sums


def _envelope(
    zone: FringeField, pair: FieldPair, amplitude: Array, carrier: Array, node: Array, reduced: Array,
    grid: tuple[Array, Array], to: tuple[Array, Array], pixel: bool,
) -> tuple[int, Complex, float]:  # fmt: skip
    """Multiple h ≥ 0 of the carrier (cycles, at the zone's nodes), what is left (C, My, Mx), the spectrum's error."""
    y, x = grid
    _, own = at_sigma(pair, zone.sigma0)
    own = zone.sigma0 * own
    spread, other = carrier - carrier.mean(), own - own.mean()
    h = int(np.rint((spread * other).sum() / max((spread * spread).sum(), 1e-300)))
    smooth, opd = amplitude * (to[0] @ pair.gamma @ to[1]), to[0] @ pair.opd_m @ to[1]
    if pixel:  # at the pair's own wavenumbers: what a pixel takes away hardly changes over the band
        smooth = _pixel_mean(smooth, pair.sigma[:, None, None] * opd, y, x, zone.pixel_m)
    to_node = chebyshev.interpolation_matrix(pair.sigma, node) if len(pair.sigma) > 1 else np.ones((len(node), 1))
    turns = node[:, None, None] * np.tensordot(to_node, opd, 1) - h * (to[0] @ carrier @ to[1])
    term = np.tensordot(to_node, smooth, 1) * np.exp(2j * np.pi * turns)
    left = np.tensordot(reduced, term, 1)
    error = 0.0
    if len(node) > 1:
        error = 2.0 * float(chebyshev.tail(np.moveaxis(term, 0, -1)).max()) * float(np.abs(reduced).sum(axis=1).max())
    return (h, left, error) if h >= 0 else (-h, left.conj(), error)


def _pixel_mean(envelope: Complex, cycles: Array, y: Array, x: Array, pitch: float) -> Complex:
    """Envelope (S, My, Mx) of the fringes exp(i 2π cycles), averaged over pixels of ``pitch``.

    To the second order of what envelope and phase change by within a pixel, beyond a phase that is linear there: with
    its slope k (rad/m) and S(k) = sin(k pitch/2)/(k pitch/2), the means of δⁿ exp(ikδ) are (−i d/dk)ⁿ S.
    """
    to_y, to_x = chebyshev.derivative_matrix(y), chebyshev.derivative_matrix(x).T
    phase = 2.0 * np.pi * cycles
    slope_y, slope_x = to_y @ phase, phase @ to_x
    mean_y, mean_x = _box(slope_y, pitch), _box(slope_x, pitch)
    first_y, first_x = to_y @ envelope, envelope @ to_x
    bend_y = to_y @ first_y + 1j * (to_y @ slope_y) * envelope
    bend_x = first_x @ to_x + 1j * (slope_x @ to_x) * envelope
    twist = to_y @ first_x + 1j * (to_y @ slope_x) * envelope
    total = envelope * mean_y[0] * mean_x[0]
    total = total - 1j * (first_y * mean_y[1] * mean_x[0] + first_x * mean_y[0] * mean_x[1])
    total -= twist * mean_y[1] * mean_x[1]
    total -= 0.5 * (bend_y * mean_y[2] * mean_x[0] + bend_x * mean_y[0] * mean_x[2])
    return np.asarray(total)


def _box(k: Array, pitch: float) -> tuple[Array, Array, Array]:
    """S(k), dS/dk and d²S/dk² of a box of width ``pitch``."""
    z = 0.5 * pitch * k
    small = np.abs(z) < 1e-2
    safe = np.where(small, 1.0, z)
    mean = np.where(small, 1.0 - z * z / 6.0 * (1.0 - z * z / 20.0), np.sin(safe) / safe)
    slope = np.where(small, -z / 3.0 * (1.0 - z * z / 10.0), (np.cos(safe) - mean) / safe)
    bend = np.where(small, -1.0 / 3.0 + z * z / 10.0, -mean - 2.0 * slope / safe)
    return mean, 0.5 * pitch * slope, 0.25 * pitch * pitch * bend


def _passes(zone: FringeField, beams: tuple[int, ...]) -> tuple[int, int]:
    """How often the light passes each arm: for a pair the larger number, since only light that both have interferes."""
    first, second = zone.arms[list(beams)].max(axis=0)
    return int(first), int(second)


def _group(sums: _Sums, passes: tuple[int, int], shapes: int) -> _Group:
    return sums.groups.setdefault(passes, _Group(np.zeros((shapes, len(sums.grid[0]), len(sums.grid[1])))))


def _layer_of(zone: FringeField, pair: FieldPair) -> int:
    """Family whose image a pair's light carries: the nominal one if a beam is nominal, else the sharper of the two."""
    one, other = int(zone.family[pair.m]), int(zone.family[pair.l])
    if 0 in (one, other) or one == other:
        return min(one, other)
    size = {view.family: view.shape[0] * view.shape[1] for view in zone.views}
    return min((one, other), key=lambda family: size[family])


def _onto_itself(zone: FringeField, view: SceneView) -> bool:
    """Whether a family images the scene where the nominal beams do, all over the zone and within SAME_IMAGE pixels."""
    x0, x1, y0, y1 = zone.zone
    corners = np.array([(x, y, 1.0) for x in (x0, x1) for y in (y0, y1)])
    apart = np.abs(corners @ view.affine.T - corners[:, :2]).max() + view.misfit_m
    return not view.blurs and bool(apart < SAME_IMAGE * zone.pixel_m)


def _to_pixels(zone: FringeField, sums: _Sums) -> Array:
    """(C, R, K) pattern: all groups together where no arm is shaded, one by one where one is."""
    groups, (y, x) = sums.groups, sums.grid
    rows, columns = zone.y_pixels, zone.x_pixels
    shade = np.ones((2, len(rows)))
    for shadow in zone.shadows:
        shade[shadow.arm - 1] *= shadow.passed(rows)
    dark = np.flatnonzero((shade < 1.0).any(axis=0))
    whole = _Group(np.sum([g.base for g in groups.values()], axis=0))
    for g in groups.values():
        for h, part in g.harmonics.items():
            whole.harmonics[h] = whole.harmonics.get(h, 0.0) + part
    pattern = _rows(zone, whole, y, x, rows, columns)
    if len(dark):
        pattern[:, dark] = 0.0
        for (one, two), g in groups.items():
            factor = shade[0, dark] ** one * shade[1, dark] ** two
            pattern[:, dark] += factor[:, None] * _rows(zone, g, y, x, rows[dark], columns)
    return pattern


def _rows(zone: FringeField, group: _Group, y: Array, x: Array, rows: Array, columns: Array) -> Array:
    """(C, R, K) one group at given rows."""
    to_y, to_x = chebyshev.interpolation_matrix(y, rows), chebyshev.interpolation_matrix(x, columns).T
    out = to_y @ group.base @ to_x
    if not group.harmonics:
        return np.asarray(out)
    at_y, at_x = zone.to(rows, columns)
    phase = at_y @ (zone.sigma0 * at_sigma(zone.nominal, zone.sigma0)[1]) @ at_x
    top = max(group.harmonics)
    edges = np.linspace(0, len(rows), 4 * THREADS + 1).astype(int)
    envelope = np.zeros((top, 2, len(rows), len(columns)))
    with ThreadPoolExecutor(THREADS) as pool:
        for c in range(len(out)):
            for h, part in group.harmonics.items():
                np.matmul(to_y @ part.real[c], to_x, out=envelope[h - 1, 0])
                np.matmul(to_y @ part.imag[c], to_x, out=envelope[h - 1, 1])
            list(pool.map(lambda k, c=c: add_fringes(phase, envelope, edges[k], edges[k + 1], out[c]),
                          range(len(edges) - 1)))  # fmt: skip
    return np.asarray(out)
