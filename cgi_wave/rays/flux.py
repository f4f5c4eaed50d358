"""Light walked through the instrument by lots: a ledger of where it went, and a check of paths and powers.

Nothing here knows a sequence of surfaces. What ``find_paths`` lists and ``trace`` weighs must come out again, within
its standard errors, among the paths by which light is found to arrive.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.kernels import walk as kernel
from cgi_wave.kernels.walk import GROUPS, SINGLE, SLICE, UNIT, walk_rays
from cgi_wave.optics.coatings import Film
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.ledger import Entry, Flux, Kind, Map, PathShare, Share, errors, share
from cgi_wave.rays.paths import MAX_DEPTH, Interaction, _bounds, make_path

Array = NDArray[np.float64]
Progress = Callable[[str], None]

RAYS, THREADS, CELLS, KEPT = 100_000, 2, 64, 100
#: Weight from which on both branches of an event are followed. Lots then decide for what is weaker.
SPLIT = 1e-3
#: Paths that a slice of rays keeps apart.
MAX_PATHS = 4096
#: Seconds between two lines of progress.
PAUSE = 2.0
ARRIVED = ("nominal", "order 1", "order 2", "order 3 and more", "scattered")
PLACES: tuple[Kind, ...] = ("absorbed", "rim", "back", "beyond table")


@dataclass(frozen=True)
class Source:
    """Light through the entrance pupil, even over its area and, if extended, of one radiance.

    kind: ``kernels.walk``'s; a, b: direction cosines, half widths of a rectangle of direction cosines, or the radius of
    a disc of them. An area of direction cosines is a projected solid angle: even over it is Lambertian within it.
    """

    kind: int
    a: float
    b: float
    name: str

    @property
    def projected(self) -> float:
        """Projected solid angle; NaN for a single direction."""
        return {kernel.RECTANGLE: 4 * self.a * self.b, kernel.DISC: np.pi * self.a**2}.get(self.kind, float("nan"))


def from_direction(theta: Array | tuple[float, float]) -> Source:
    """A distant point: direction cosines (2,) in the pupil's frame. Raises InputError beyond the unit circle."""
    a, b = float(theta[0]), float(theta[1])
    if not a * a + b * b < 1.0:
        raise InputError("flux", "direction", (a, b), "are no direction cosines", "keep their squares' sum below 1")
    return Source(kernel.DIRECTION, a, b, f"direction {a:g}, {b:g}")


def from_degrees(angles: tuple[float, float]) -> Source:
    """A distant point, by its angles from the pupil's axis in x and y, degrees. Raises InputError as before."""
    return from_direction((float(np.sin(np.radians(angles[0]))), float(np.sin(np.radians(angles[1])))))


def from_field(system: OpticalSystem) -> Source:
    """A uniform scene over the declared field (``entrance.half_field_deg``)."""
    a, b = np.sin(np.radians(system.document.entrance.half_field_deg))
    return Source(kernel.RECTANGLE, float(a), float(b), "declared field")


def lambertian(half_angle_deg: float = 90.0) -> Source:
    """A Lambertian source in the pupil, within a cone about its axis. Raises InputError beyond 90 degrees."""
    if not 0.0 < half_angle_deg <= 90.0:
        raise InputError("flux", "half angle", half_angle_deg, "is no cone", "give degrees above 0 and up to 90")
    radius = float(np.sin(np.radians(half_angle_deg)))
    return Source(kernel.DISC, radius, 0.0, f"Lambertian within {half_angle_deg:g} deg")


def flux(
    system: OpticalSystem,
    rays: int = RAYS,
    seed: int = 1,
    source: Source | None = None,
    *,
    split: float = SPLIT,
    sigma: float | None = None,
    cells: tuple[int, int] = (CELLS, CELLS),
    max_depth: int = MAX_DEPTH,
    kept: int = KEPT,
    threads: int = THREADS,
    progress: Progress = lambda _: None,
) -> Flux:
    """Walk ``rays`` rays of a source (None: the declared field) through one band of an instrument.

    At each surface the weight is divided by its coating (Fresnel for bare faces): a branch of at least ``split`` of the
    input ray is followed for itself, weaker ones are drawn by lot, with weights that conserve the power of every event.
    split = inf is the analog walk: one branch, drawn by its power, with all the weight. sigma: wavenumber, 1/m (the
    band's σ0). cells: of the map, along y and x. kept: strongest paths returned. The result depends on seed and number
    of rays, not on threads.

    Raises InputError for values that make no walk.
    """
    if not 1 <= rays <= 10**12 or not 0 <= seed < 2**63:
        raise InputError(
            "flux", "rays, seed", (rays, seed), "are no numbers of rays and seed", "give rays ≥ 1, seed ≥ 0"
        )
    if not split > 0.0 or not 1 <= max_depth <= MAX_DEPTH or min(cells) < 1 or threads < 1:
        remedy = f"give split > 0, depth 1 to {MAX_DEPTH}, at least one cell and one thread"
        raise InputError("flux", "options", (split, max_depth, cells, threads), "make no walk", remedy)
    source = source or from_field(system)
    sigma = system.sigma0 if sigma is None else sigma
    arguments = _arguments(system, source, sigma, split, cells, max_depth)
    sums = _Sums()
    shown = time.monotonic()
    for first, part in _slices(rays, seed, arguments, threads):
        sums.add(part)
        if time.monotonic() - shown > PAUSE:
            shown = time.monotonic()
            progress(f"{system.band}: {min(first + SLICE, rays)} of {rays} rays")
    return _result(system, source, sigma, rays, seed, split, cells, max_depth, kept, sums)


def _slices(rays: int, seed: int, arguments: tuple[Any, ...], threads: int) -> Iterator[tuple[int, tuple[Any, ...]]]:
    """Slices of rays in their order, whichever thread walks them; a few are in hand at a time."""
    starts = iter(range(0, rays, SLICE))

    def walk(first: int) -> tuple[int, tuple[Any, ...]]:
        return first, walk_rays(first, min(SLICE, rays - first), seed, *arguments)

    with ThreadPoolExecutor(threads) as pool:
        waiting: list[Future[tuple[int, tuple[Any, ...]]]] = []
        try:
            for first in starts:
                waiting.append(pool.submit(walk, first))
                if len(waiting) >= 2 * threads:
                    yield waiting.pop(0).result()
            while waiting:
                yield waiting.pop(0).result()
        finally:
            pool.shutdown(cancel_futures=True)


class _Sums:
    """Sums over slices: Python's own integers for weights, so that nothing is rounded and nothing overflows."""

    def __init__(self) -> None:
        self.total: Any = 0
        self.square: Any = 0.0
        self.count: Any = 0
        self.map_total: Any = 0.0
        self.map_square: Any = 0.0
        self.map_count: Any = 0
        self.paths: dict[int, list[Any]] = {}
        self.events, self.total_reflections = 0, 0

    def add(self, part: tuple[Any, ...]) -> None:
        (total, square, count, mtotal, msquare, mcount, keys, ptotal, psquare, pcount, trail, length, order, events,
         total_reflections) = part  # fmt: skip
        self.total = self.total + total.astype(object)
        self.square, self.count = self.square + square, self.count + count
        self.map_total = self.map_total + mtotal / UNIT
        self.map_square, self.map_count = self.map_square + msquare, self.map_count + mcount
        self.events += int(events)
        self.total_reflections += int(total_reflections)
        for k, key in enumerate(keys.tolist()):
            if key not in self.paths:
                self.paths[key] = [0, 0.0, 0, tuple(trail[k, : length[k]].tolist()), int(order[k])]
            known = self.paths[key]
            known[0] += int(ptotal[k])
            known[1] += float(psquare[k])
            known[2] += int(pcount[k])


def _arguments(
    system: OpticalSystem, source: Source, sigma: float, split: float, cells: tuple[int, int], max_depth: int
) -> tuple[Any, ...]:
    """What ``walk_rays`` takes after the seed."""
    surfaces = system.surfaces
    entrance = system.document.entrance
    axes, centre = system.pupil_frame()
    members, start = _bounds(system)
    faces = [[s.face(side) for side in (0, 1)] for s in surfaces]
    films = {id(table): table for pair in faces for _, table in pair if table is not None}
    number = {key: k for k, key in enumerate(films)}
    film = np.array([[number.get(id(table), -1) for _, table in pair] for pair in faces])
    tables = [table.film(sigma) for table in films.values()] or [Film(np.zeros(1), np.zeros((1, 4)), np.zeros((1, 4)))]
    lobes = [s.coating.scatter for s in surfaces]
    scatter = [(lobe.tis, lobe.width, lobe.slope) if lobe else (0.0, 1.0, -2.0) for lobe in lobes]
    parasitic = np.array([int(s.nominal in ("transmit", "absorb")) for s in surfaces])
    det = system.document.detector
    half = 0.5 * np.array([det.columns, det.rows]) * system.pixel
    grid = np.array([-half[0], -half[1], 0.5 * cells[1] / half[0], 0.5 * cells[0] / half[1]])
    return (
        np.array([source.kind, source.a, source.b]), system.pupil_radius, entrance.back_off_mm * 1e-3, axes, centre,
        system.spaces.index(entrance.space), np.array([s.rotation for s in surfaces]),
        np.array([s.origin for s in surfaces]), np.array([s.curvature for s in surfaces]),
        np.array([s.conic for s in surfaces]), np.array([s.aperture for s in surfaces]),
        np.array([[s.before, s.after] for s in surfaces]), start, members, system.index(sigma),
        np.array([[coating.transmittance for coating, _ in pair] for pair in faces]),
        np.array([[coating.reflectance for coating, _ in pair] for pair in faces]),
        np.array([[coating.bare for coating, _ in pair] for pair in faces], dtype=np.int64), film,
        np.cumsum([0, *(len(one.knot) for one in tables)]), np.concatenate([one.knot for one in tables]),
        np.concatenate([one.r for one in tables]), np.concatenate([one.t for one in tables]),
        np.array(scatter), parasitic, system.detector,
        int(min(split, 2.0) * UNIT) if split < 1.0 else 2 * UNIT, max_depth, grid, np.array(cells), MAX_PATHS,
    )  # fmt: skip


def _result(
    system: OpticalSystem, source: Source, sigma: float, rays: int, seed: int, split: float, cells: tuple[int, int],
    max_depth: int, kept: int, sums: _Sums,
) -> Flux:  # fmt: skip
    surfaces = [s.name for s in system.surfaces]
    places: list[tuple[Kind, str]] = [("detector", surfaces[system.detector]), ("depth", "")]
    places += [(kind, name) for kind in PLACES for name in surfaces] + [("left", space) for space in system.spaces]
    assert len(places) == SINGLE + GROUPS * len(surfaces) + len(system.spaces)
    every = [share(u, q, c, rays) for u, q, c in zip(sums.total, sums.square, sums.count, strict=True)]
    entries = [
        Entry(one.share, one.error, one.count, kind, where, int(units))
        for (kind, where), one, units in zip(places, every, sums.total, strict=False)
        if units
    ]
    strongest = sorted(sums.paths.values(), key=lambda known: (-known[0], known[3]))[:kept]
    paths = tuple(_path(system, share(units, square, count, rays), trail, order)
                  for units, square, count, trail, order in strongest)  # fmt: skip
    arrived = dict(zip(ARRIVED, every[len(places) :], strict=True))
    named = sum(known[0] for known in sums.paths.values())
    lost = sum(sums.total[len(places) :]) - named
    return Flux(
        system.instrument, system.band, source.name, rays, seed, sigma, split, max_depth,
        tuple(sorted(entries, key=lambda e: (-e.units, e.kind, e.where))), arrived,
        paths, float(lost / (rays * UNIT)),
        _map(system, rays, cells, sums), 1.0 / (np.pi * system.pupil_radius**2 * source.projected), sums.events,
        sums.total_reflections,
    )  # fmt: skip


def _path(system: OpticalSystem, one: Share, trail: tuple[int, ...], order: int) -> PathShare:
    """An arrival with its path in words; trail: 4·surface + event."""
    names = [system.surfaces[code // 4].name for code in trail]
    text = " ".join(name + ("", ":r", ":s", ":rs")[code % 4] for name, code in zip(names, trail, strict=True))
    acts: tuple[Interaction, Interaction] = ("transmit", "reflect")
    label = make_path(system, [(name, acts[code % 2]) for name, code in zip(names, trail, strict=True)]).label
    dull = [name for name, code in zip(names, trail, strict=True) if code % 4 >= kernel.SCATTER]
    label += f" scattered at {', '.join(dull)}" if dull else ""
    return PathShare(one.share, one.error, one.count, text, label, order, bool(dull))


def _map(system: OpticalSystem, rays: int, cells: tuple[int, int], sums: _Sums) -> Map:
    det = system.document.detector
    x = (np.linspace(-0.5, 0.5, cells[1] + 1)) * det.columns * system.pixel
    y = (np.linspace(-0.5, 0.5, cells[0] + 1)) * det.rows * system.pixel
    area = (x[1] - x[0]) * (y[1] - y[0])
    mean = (sums.map_total / rays).reshape(2, *cells)
    error = errors(mean, sums.map_square.reshape(2, *cells), rays)
    return Map(x, y, mean[0] / area, error[0] / area, mean[1] / area, error[1] / area,
               sums.map_count.reshape(2, *cells)[0])  # fmt: skip
