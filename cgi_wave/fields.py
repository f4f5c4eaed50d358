"""Fringe fields of a band: field points traced over its zone by several processes, and put together."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.analysis import PROCESSES, Task, prepare_band, setting_of
from cgi_wave.budget.fringefield import (
    CHECKS,
    NODES,
    TracedPoint,
    assemble,
    missing_pairs,
    node_points,
    traced_point,
    wanted_pairs,
    zone_of,
    zone_rows_lit,
)
from cgi_wave.budget.nominal_psf import PointPsf, assembled, point_psf, psf_points
from cgi_wave.budget.setting import Setting, band_setting
from cgi_wave.fringes.field import FringeField
from cgi_wave.optics.system import load_instrument

Array = NDArray[np.float64]
Progress = Callable[[str], None]


@dataclass(frozen=True)
class BandField:
    """A band's fringe field, and the setting whose light it is for."""

    field: FringeField
    setting: Setting


def fringe_field(
    band: str,
    instrument: str | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    nodes: tuple[int, int] = NODES,
    progress: Progress = lambda _: None,
) -> BandField:
    """Trace a band at nodes[0] × nodes[1] field points (along, across track) and at a few between, and interpolate.

    tolerance: part of the nominal modulation that a pair of beams may add and be left out, as in ``analyse``. Pairs
    that some points keep and others do not are computed at all of them.

    Raises InputError, EmptyBeamError, MethodLimitError.
    """
    loaded = load_instrument(instrument)
    system = loaded.band(band)
    rows, _ = zone_rows_lit(loaded, system)
    zone = zone_of(system, rows)[0]
    _, _, places = node_points(zone, nodes)
    x, y, seen = psf_points(zone, CHECKS)
    centre = nodes[0] * nodes[1] // 2
    with ProcessPoolExecutor(PROCESSES) as pool:
        progress(f"{band}: searching ghost paths")
        task, _ = pool.submit(prepare_band, loaded.raw, loaded.file, band, tolerance, False).result()
        pending = [pool.submit(_trace, task, place, k == centre) for k, place in enumerate(places)]
        images = [pool.submit(_image, task, place) for place in seen]
        points = []
        for future in pending:
            points.append(future.result())
            progress(f"{band}: field point {len(points)} of {len(places)}: {len(points[-1].pairs)} pairs of beams")
        wanted = wanted_pairs(points)
        again = [
            pool.submit(_complete, task, point.x0, keys) if keys else None
            for point, keys in zip(points, wanted, strict=True)
        ]
        more = [None if future is None else future.result() for future in again]
        progress(f"{band}: {sum(map(bool, wanted))} field points completed with pairs that others keep")
        progress(f"{band}: nominal point-spread functions at {len(seen)} points")
        psf = assembled([future.result() for future in images], x, y, seen)
    setting = band_setting(system)
    return BandField(replace(assemble(loaded, setting, task.paths, points, more, nodes), psf=psf), setting)


def _trace(task: Task, place: Array, dense: bool) -> TracedPoint:
    with threadpool_limits(1):
        setting = setting_of(task.raw, task.file, task.band)
        return traced_point(setting, task.paths, place, task.tolerance, dense)


def _image(task: Task, place: Array) -> PointPsf:
    with threadpool_limits(1):
        return point_psf(setting_of(task.raw, task.file, task.band), task.paths[:2], place)


def _complete(task: Task, place: Array, keys: list[tuple[str, str]]) -> TracedPoint:
    with threadpool_limits(1):
        setting = setting_of(task.raw, task.file, task.band)
        return missing_pairs(setting, task.paths, place, task.tolerance, keys)
