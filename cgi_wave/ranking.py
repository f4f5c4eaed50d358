"""Who is to blame, and what would help: attribution and the ranking of remedies of one band."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Literal

from threadpoolctl import threadpool_limits

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.analysis import PROCESSES, Progress, setting_of, zone_rows
from cgi_wave.budget.attribution import FieldCosts, attribute, faces
from cgi_wave.budget.cost_table import cost_table, remedy_rows
from cgi_wave.budget.outcome import Outcome, Seen, rescaled, retraced, see
from cgi_wave.budget.remedies import (
    TILTS_DEG,
    Remedy,
    Target,
    coating_remedies,
    scales_exactly,
    tilt,
    unimproved,
)
from cgi_wave.budget.select import select_ghosts, untraced
from cgi_wave.errors import CgiWaveError
from cgi_wave.optics.alter import plane_bodies
from cgi_wave.optics.system import Instrument, OpticalSystem, from_document
from cgi_wave.rays.paths import find_paths

Fields = Literal["centre", "all"]


@dataclass(frozen=True)
class Ranking:
    """What ``rank_remedies`` returns.

    fields: how many field points; costs: ``budget.cost_table.cost_table``; remedies: rows, best first (see
    ``budget.cost_table.remedy_rows``); unimproved: surfaces with ghosts and without a coating remedy, and why.
    """

    band: str
    fields: int
    costs: dict[str, Any]
    remedies: list[dict[str, Any]]
    unimproved: dict[str, str]
    seconds: float


def rank_remedies(
    instrument: Instrument,
    band: str,
    target: Target | None = None,
    moves: Sequence[Remedy] | None = None,
    fields: Fields = "centre",
    tolerance: float = DEFAULT_TOLERANCE,
    progress: Progress = lambda _: None,
) -> Ranking:
    """Attribute the ghosts of a band to surfaces, and rank what could be done, each by recomputation.

    target: of coatings (default: halve what makes ghosts); each coating of the file and each surface is tried. moves:
    tilts, shifts and other values (``budget.remedies``), each traced again from the search of paths on; None tilts
    every body with plane faces that has ghosts by each of TILTS_DEG about x. fields: the zone's centre or all five
    points. A remedy that no light or no method survives is listed with the reason and without a gain.

    Raises InputError, EmptyBeamError, MethodLimitError.
    """
    started = time.perf_counter()
    system = instrument.band(band)
    count = 1 if fields == "centre" else len(system.field_points())
    with ProcessPoolExecutor(PROCESSES) as pool:
        progress(f"{band}: tracing {count} field point{'s' * (count > 1)} of the instrument as it is")
        base = pool.submit(trace_remedy, instrument.raw, instrument.file, band, None, count, tolerance).result()
        before, costs = [seen for seen, _ in base], [cost for _, cost in base if cost is not None]
        ghosts = [path for seen in before for path in (*seen.point.paths[2:], *seen.untraced.paths)]
        coatings = coating_remedies(system, ghosts, target or Target())
        tried = (*coatings, *(default_tilts(system, before) if moves is None else moves))
        again = [remedy for remedy in tried if not scales_exactly(system, remedy)]
        progress(f"{band}: {len(tried) - len(again)} remedies by scaling, {len(again)} to be traced again")
        jobs = [
            pool.submit(trace_remedy, instrument.raw, instrument.file, band, remedy, count, tolerance)
            for remedy in again
        ]
        results: list[tuple[Remedy, str, list[Outcome], str]] = [
            (remedy, "rescaled", [rescaled(system, seen, remedy) for seen in before], "")
            for remedy in tried
            if scales_exactly(system, remedy)
        ]
        for number, (remedy, job) in enumerate(zip(again, jobs, strict=True), 1):
            try:
                after = [seen for seen, _ in job.result()]
                outcomes = [retraced(system, b, a, remedy) for b, a in zip(before, after, strict=True)]
                results.append((remedy, "traced again", outcomes, ""))
            except CgiWaveError as error:
                results.append((remedy, "traced again", [], str(error)))
            progress(f"{band}: {number} of {len(again)} traced again: {remedy.name}, {remedy.change}")
    return Ranking(
        band, count, cost_table(system, costs), remedy_rows(before, results), unimproved(system, ghosts, coatings),
        time.perf_counter() - started,
    )  # fmt: skip


def default_tilts(system: OpticalSystem, before: Sequence[Seen]) -> tuple[Remedy, ...]:
    """Bodies with plane faces only that ghosts touch, each tilted by every one of TILTS_DEG about x."""
    touched = {name for seen in before for path in seen.point.paths for name in faces(path)}
    bodies = [name for name, surfaces in plane_bodies(system).items() if touched & set(surfaces)]
    return tuple(tilt(system, name, angle) for name in bodies for angle in TILTS_DEG)


def trace_remedy(
    raw: dict[str, Any], file: str, band: str, remedy: Remedy | None, count: int, tolerance: float
) -> list[tuple[Seen, FieldCosts | None]]:
    """Search, select and trace the first ``count`` field points of a band with a remedy; without one, with its costs.

    One process does all of it: the remedies keep both busy.
    """
    setting = setting_of(raw, file, band)
    if remedy is not None:
        setting = replace(setting, system=remedy.apply(setting.system, from_document(raw, file)))
    system = setting.system
    with threadpool_limits(1):
        found = find_paths(system)
        paths = select_ghosts(setting, found)
        unseen = untraced(setting, found, paths)
        made: list[tuple[Seen, FieldCosts | None]] = []
        for x0 in system.field_points()[:count]:
            seen = see(setting, paths, unseen, x0, zone_rows(system, x0), tolerance)
            made.append((seen, attribute(seen.point, seen.terms, unseen) if remedy is None else None))
    return made
