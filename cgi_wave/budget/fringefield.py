"""From traced field points to a fringe field over a zone: nodes, what lies between, dead zones, views of the scene."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.fieldpoint import FieldPoint, coherence_of, families, trace_beams
from cgi_wave.budget.mutual_psf import mutual_kernels
from cgi_wave.budget.sceneview import Spread, spread_of, views
from cgi_wave.budget.setting import Setting
from cgi_wave.errors import InputError
from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.coherency import Pair
from cgi_wave.fringes.field import FieldPair, FringeField, MutualKernel, Shadow, at_sigma
from cgi_wave.fringes.psi import standard_error
from cgi_wave.optics.system import Instrument, OpticalSystem
from cgi_wave.rays.beams import Rays, Sheet
from cgi_wave.rays.paths import Path

Array = NDArray[np.float64]
Key = tuple[str, str]
#: Nodes along and across track at which field points are traced.
NODES = (4, 3)
#: Points between the nodes, in half zones (y, x), at which the polynomials are checked.
CHECKS = ((0.55, -0.45), (-0.7, 0.1), (-0.05, 0.75))


@dataclass(frozen=True)
class TracedPoint:
    """What one field point gives to the fringe field.

    x0 (2,) m; theta (2,) source direction; labels, transmission, error (B,): beams that arrive; pairs by their labels
    in the order of the band's paths; sheets of the beams that a pair needs; spreads: of each family's light over source
    directions; half_angle: sine of the half angle of the nominal cone; left_out, left_out_baseline: see ``FringeField``
    mutual: of pairs, at a dense point
    """

    x0: Array
    theta: Array
    labels: tuple[str, ...]
    transmission: Array
    error: Array
    pairs: dict[Key, Pair]
    sheets: dict[str, Sheet]
    spreads: dict[int, Spread]
    half_angle: float
    left_out: float
    left_out_baseline: float
    mutual: Mapping[Key, MutualKernel]


def zone_rows_lit(
    instrument: Instrument, system: OpticalSystem
) -> tuple[tuple[int, int], tuple[str | None, str | None]]:
    """Rows (first, last + 1) that a band's plates and filter fill, and the bands beyond its two edges (None: none).

    Zones of one detector part half-way between them; beyond the outermost ones they reach as far as on the other side,
    and not beyond the detector.
    """
    first, last = system.spec.zone_rows
    here = system.document.detector.surface
    low, high, below, above = 0, system.document.detector.rows, None, None
    for name in instrument.bands:
        other = instrument.band(name) if name != system.band else None
        if other is None or other.document.detector.surface != here:
            continue
        a, b = other.spec.zone_rows
        if b <= first and (b + first) // 2 >= low:
            low, below = (b + first) // 2, name
        if a >= last and (a + last) // 2 <= high:
            high, above = (a + last) // 2, name
    if below is None and above is not None:
        low = max(0, first - (high - last))
    if above is None and below is not None:
        high = min(system.document.detector.rows, last + first - low)
    return (low, high), (below, above)


def node_points(zone: tuple[float, float, float, float], nodes: tuple[int, int] = NODES) -> tuple[Array, Array, Array]:
    """x (X,), y (Y,) of the nodes over a zone (x0, x1, y0, y1; m), and all points to trace (Y·X + checks, 2)."""
    x, y = chebyshev.nodes(nodes[1], *zone[:2]), chebyshev.nodes(nodes[0], *zone[2:])
    grid = np.array([(a, b) for b in y for a in x])
    middle = np.array([zone[0] + zone[1], zone[2] + zone[3]]) / 2
    half = np.array([zone[1] - zone[0], zone[3] - zone[2]]) / 2
    return x, y, np.concatenate([grid, middle + half * np.array(CHECKS)[:, ::-1]])


def traced_point(setting: Setting, paths: Sequence[Path], x0: Array, tolerance: float, dense: bool) -> TracedPoint:
    """Trace one field point; dense: with the fine spread of every family's light, for the kernels, and of pairs."""
    beams = trace_beams(setting, paths, x0, tolerance)
    point = coherence_of(setting, beams, x0, tolerance, keep=dense)
    reduced = _reduced(point, beams.rays, paths, dense)
    if not dense:
        return reduced
    coherency = point.coherency
    kernels = mutual_kernels(setting, paths[0], x0, point.fields, coherency.pairs, coherency.family)
    # Which of the two beams stands first changes the sign of the imaginary part only, and no error.
    rank = {path.label: k for k, path in enumerate(paths)}
    named: dict[Key, MutualKernel] = {}
    for pair, kernel in zip(coherency.pairs, kernels, strict=True):
        one, other = coherency.labels[pair.m], coherency.labels[pair.l]
        named[(one, other) if rank[one] < rank[other] else (other, one)] = kernel
    return replace(reduced, mutual=named)


def missing_pairs(
    setting: Setting, paths: Sequence[Path], x0: Array, tolerance: float, wanted: Sequence[Key]
) -> TracedPoint:
    """Trace the beams of some pairs only, and compute these pairs whatever their bound."""
    named = {label for key in wanted for label in key}
    some = [path for path in paths if path.order == 0 or path.label in named]
    beams = trace_beams(setting, some, x0, tolerance, wanted=[frozenset(key) for key in wanted])
    return _reduced(coherence_of(setting, beams, x0, tolerance), beams.rays, paths, dense=False)


def _reduced(point: FieldPoint, rays: Sequence[Rays], paths: Sequence[Path], dense: bool) -> TracedPoint:
    rank = {path.label: k for k, path in enumerate(paths)}
    number = dict(zip([path.label for path in paths], families(paths).tolist(), strict=True))
    coherency = point.coherency
    labels = coherency.labels
    pairs: dict[Key, Pair] = {}
    for pair in coherency.pairs:
        one, other = labels[pair.m], labels[pair.l]
        pairs[(one, other) if rank[one] < rank[other] else (other, one)] = (
            pair if rank[one] < rank[other] else _reversed(pair)
        )
    needed = {label for key in pairs for label in key}
    sheets = {label: sheet for label, sheet in zip(labels, point.sheets, strict=True) if label in needed}
    groups: dict[int, list[tuple[Rays, float]]] = {}
    for label, ray, power in zip(labels, rays, coherency.transmission.tolist(), strict=True):
        groups.setdefault(number[label], []).append((ray, power))
    spreads = {family: spread_of(members, dense) for family, members in groups.items()}
    nominal = rays[0]
    lit = (nominal.clearance[:, 0] > 0).all(axis=0)
    cone = nominal.direction[0][lit]
    left = [standard_error(coherency, coherency.left_out, frequency) for frequency in (1.0, 0.0)]
    return TracedPoint(
        point.x0, point.theta, labels, coherency.transmission, coherency.transmission_error, pairs, sheets, spreads,
        0.5 * float(np.ptp(cone, axis=0).max()), left[0], left[1], {},
    )  # fmt: skip


def _reversed(pair: Pair) -> Pair:
    return Pair(pair.l, pair.m, pair.sigma, pair.gamma.conj(), pair.error, -pair.opd_m, -pair.slope, pair.method,
                pair.pivot)  # fmt: skip


def wanted_pairs(points: Sequence[TracedPoint]) -> list[list[Key]]:
    """For each point, the pairs that other points keep and it lacks, as far as both beams arrive there."""
    union = {key: None for point in points for key in point.pairs}
    return [
        [key for key in union if key not in point.pairs and all(label in point.labels for label in key)]
        for point in points
    ]


def assemble(
    instrument: Instrument, setting: Setting, paths: Sequence[Path], points: Sequence[TracedPoint],
    more: Sequence[TracedPoint | None], nodes: tuple[int, int] = NODES,
) -> FringeField:  # fmt: skip
    """The fringe field of all traced points, nodes first (see ``node_points``); more: results of ``missing_pairs``."""
    system = setting.system
    rows, beyond = zone_rows_lit(instrument, system)
    zone, columns = zone_of(system, rows)
    x, y, _ = node_points(zone, nodes)
    count = len(x) * len(y)
    labels = tuple(path.label for path in paths)
    power = np.array([_powers(point, labels) for point in points])
    grid = power[:count].T.reshape(len(labels), len(y), len(x))
    places = np.array([point.x0 for point in points])
    error = np.zeros(len(labels))
    for point in points[:count]:
        for label, value in zip(point.labels, point.error.tolist(), strict=True):
            k = labels.index(label)
            error[k] = max(error[k], value)
    sigma0 = system.sigma0
    made = _pairs(points, more, labels, power, (y, x), sigma0)
    between = [_at(grid, y, x, place) for place in places[count:]]
    apart = [abs(float(truth.sum() - value.sum())) for truth, value in zip(power[count:], between, strict=True)]
    number = families(paths)
    centre = points[count // 2]
    names = {int(f): " ".join(f"{n}:{a[0]}" for n, a in p.history) for f, p in zip(number, paths, strict=True) if f}
    seen = views([(point.x0, point.theta, point.spreads) for point in points[:count]], centre.spreads, names,
                 system.pixel)  # fmt: skip
    dead = shadows(instrument, system, rows, beyond, centre.half_angle)
    return FringeField(
        system.band, x, y, zone, rows, columns, system.pixel, labels, number,
        np.array([path.order for path in paths], dtype=np.int64),
        np.array([[path.arms.count(1), path.arms.count(2)] for path in paths], dtype=np.int64),
        grid, error, max(apart, default=0.0), made, sigma0, dead, seen,
        max(point.left_out for point in points), max(point.left_out_baseline for point in points),
    )  # fmt: skip


def zone_of(system: OpticalSystem, rows: tuple[int, int]) -> tuple[tuple[float, float, float, float], tuple[int, int]]:
    """x0, x1, y0, y1 (m, pixel edges) of rows of the band's columns; and the columns."""
    det = system.document.detector
    columns = system.spec.zone_columns or (0, det.columns)
    x0, x1 = ((edge - 0.5 * det.columns) * system.pixel for edge in columns)
    y0, y1 = ((edge - 0.5 * det.rows) * system.pixel for edge in rows)
    return (x0, x1, y0, y1), (int(columns[0]), int(columns[1]))


def _powers(point: TracedPoint, labels: Sequence[str]) -> Array:
    known = dict(zip(point.labels, point.transmission.tolist(), strict=True))
    return np.array([known.get(label, 0.0) for label in labels])


def _at(values: NDArray[Any], y: Array, x: Array, place: Array) -> Any:
    """Values (..., Y, X) at the nodes, interpolated to one place (2,)."""
    to_y = chebyshev.interpolation_matrix(y, place[1:2])[0]
    to_x = chebyshev.interpolation_matrix(x, place[:1])[0]
    return np.tensordot(values @ to_x, to_y, 1)


def _pairs(
    points: Sequence[TracedPoint], more: Sequence[TracedPoint | None], labels: Sequence[str], power: Array,
    grid: tuple[Array, Array], sigma0: float,
) -> tuple[FieldPair, ...]:  # fmt: skip
    """All pairs, each about one pupil point, with what interpolation leaves over at the checks."""
    y, x = grid
    count = len(x) * len(y)
    places = np.array([point.x0 for point in points])
    known: list[Mapping[Key, tuple[Pair, TracedPoint]]] = []
    for point, extra in zip(points, more, strict=True):
        here = {key: (pair, point) for key, pair in point.pairs.items()}
        known.append({**({k: (p, extra) for k, p in extra.pairs.items()} if extra else {}), **here})
    found = []
    for key in {key: None for here in known for key in here}:
        have = [here.get(key) for here in known]
        pivot = np.mean([pair.pivot for pair, _ in filter(None, have)], axis=0)
        about = [None if item is None else _about(*item, key, pivot) for item in have]
        size = max(len(pair.sigma) for pair in about if pair is not None)
        sigma = next(pair.sigma for pair in about if pair is not None and len(pair.sigma) == size)
        gamma = np.zeros((len(points), size), np.complex128)
        opd = np.zeros((len(points), size))
        for k, pair in enumerate(about):
            if pair is not None:
                to = chebyshev.interpolation_matrix(pair.sigma, sigma) if len(pair.sigma) != size else np.eye(size)
                gamma[k], opd[k] = to @ pair.gamma, to @ pair.opd_m
        dark = np.array([pair is None for pair in about])
        if dark.any():  # a path difference that goes on as elsewhere, so that the polynomial does not mind
            flat = np.column_stack([np.ones(len(places)), places])
            opd[dark] = flat[dark] @ np.linalg.lstsq(flat[~dark], opd[~dark], rcond=None)[0]
        shape = (size, len(y), len(x))
        made = FieldPair(
            labels.index(key[0]), labels.index(key[1]), sigma, gamma[:count].T.reshape(shape),
            opd[:count].T.reshape(shape), max(float(p.error.max()) for p in about[:count] if p is not None), 0.0,
        )  # fmt: skip
        contrast, path = at_sigma(made, sigma0)
        row = chebyshev.interpolation_matrix(sigma, np.array([sigma0]))[0] if size > 1 else np.ones(1)
        strength = np.sqrt(power[:, made.m] * power[:, made.l])
        contrast = contrast * strength[:count].reshape(contrast.shape)
        apart = 0.0
        for k in range(count, len(points)):
            turn = np.exp(2j * np.pi * sigma0 * (float(row @ opd[k]) - _at(path, y, x, places[k])))
            apart = max(apart, abs(strength[k] * complex(row @ gamma[k]) * turn - _at(contrast, y, x, places[k])))
        mutual = next((point.mutual[key] for point in points if key in point.mutual), None)
        found.append(FieldPair(made.m, made.l, sigma, made.gamma, made.opd_m, made.error, float(apart), mutual))
    return tuple(found)


def _about(pair: Pair, point: TracedPoint, key: Key, pivot: Array) -> Pair:
    """The pair with its path difference at another pupil point: what changes goes into the phase of gamma."""
    places = np.array([pair.pivot, pivot])
    path = point.sheets[key[0]].opl_at(places) - point.sheets[key[1]].opl_at(places)
    move = float(path[1] - path[0])
    gamma = pair.gamma * np.exp(-2j * np.pi * pair.sigma * move)
    return Pair(pair.m, pair.l, pair.sigma, gamma, pair.error, pair.opd_m + move, pair.slope, pair.method,
                (float(pivot[0]), float(pivot[1])))  # fmt: skip


def shadows(
    instrument: Instrument, system: OpticalSystem, rows: tuple[int, int], beyond: tuple[str | None, str | None],
    half_angle: float,
) -> tuple[Shadow, ...]:  # fmt: skip
    """Dead zones at both edges of the band's rows: where the glass in an arm steps to that of the next zone.

    Where no zone follows, the thicker arm steps to the glass of the thinner one. half_angle: sine at the detector;
    the relay has magnification −1, so that it holds at the arms' mirrors too.
    """
    if system.document.interferometer is None:
        return ()
    det = system.document.detector
    found = []
    own = [_glass(system, arm) for arm in (1, 2)]
    for edge, name in zip(rows, beyond, strict=True):
        y = (edge - 0.5 * det.rows) * system.pixel
        for arm in (1, 2):
            thickness, index = own[arm - 1]
            other = _glass(instrument.band(name), arm)[0] if name else min(own[0][0], own[1][0])
            step = abs(thickness - other)
            if step > 0.0:
                found.append(Shadow(arm, y, step * half_angle / np.sqrt(index**2 - half_angle**2)))
    return tuple(found)


def _glass(system: OpticalSystem, arm: int) -> tuple[float, float]:
    """Thickness of all glass between the surfaces of an arm, m, and its index (of the last piece)."""
    inter = system.document.interferometer
    if inter is None:
        raise InputError(system.file, "interferometer", None, "is missing", "declare splitter, arm1 and arm2")
    names = (inter.arm1 if arm == 1 else inter.arm2).surfaces
    index = system.index(system.sigma0)
    total, last = 0.0, 1.0
    surfaces = [system.surfaces[system.number[name]] for name in names]
    for one, other in itertools.pairwise(surfaces):
        n = float(index[one.after])
        if n > 1.0:
            total += float(np.linalg.norm(other.origin - one.origin))
            last = n
    return total, last
