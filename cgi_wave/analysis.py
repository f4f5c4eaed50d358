"""The main job: from an instrument file to ghosts, contrasts, interferograms and Table 1, band by band."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.budget.attribution import FieldCosts, attribute
from cgi_wave.budget.cost_table import cost_table
from cgi_wave.budget.fieldpoint import FieldPoint, field_point, trace_beams
from cgi_wave.budget.ghosts import families, ghost_rows
from cgi_wave.budget.other_light import other_light
from cgi_wave.budget.pictures import psf_pictures, spot_pictures
from cgi_wave.budget.plan import PairPlan
from cgi_wave.budget.pointfields import CONTRAST_TOLERANCE, without_directions
from cgi_wave.budget.pointsource import PointSource, point_source
from cgi_wave.budget.polarisation import PolarisationBound, polarisation_bound
from cgi_wave.budget.select import AMPLITUDE_FLOOR, POWER_FLOOR, Untraced, select_ghosts, untraced
from cgi_wave.budget.setting import Setting, band_setting
from cgi_wave.budget.table1 import table1
from cgi_wave.fringes.coherency import Coherency
from cgi_wave.fringes.nma import Retrieval, retrieve
from cgi_wave.fringes.psi import Psi, interferogram_terms
from cgi_wave.optics.system import Instrument, OpticalSystem, from_document, load_instrument
from cgi_wave.rays.paths import Path, find_paths

Progress = Callable[[str], None]

PROCESSES = 2
#: Field points at which a point source's contrasts are computed; range(5) is all of them. They change little over the
#: zone, whose centre stands for it; each point more costs as much as all the rest of it.
CONTRAST_FIELDS = (0,)


@dataclass(frozen=True)
class FieldResult:
    """Everything at one field point (index; detector coordinates in m)."""

    index: int
    x_m: float
    y_m: float
    point: FieldPoint
    source: PointSource
    psi: Psi
    retrieval: Retrieval
    costs: FieldCosts
    spots: Sequence[Mapping[str, Any]]
    psfs: Sequence[Mapping[str, Any]]
    polarisation: PolarisationBound | None = None

    @property
    def coherency(self) -> Coherency:
        """Powers and mutual coherence of the beams here."""
        return self.point.coherency


@dataclass(frozen=True)
class BandResult:
    """One band: its field points, Table 1's column, the ghost table (rows as in the command ``ghosts``), the plan, and
    what each surface costs (``budget.cost_table.cost_table``).

    other_light: of other channels on this one's detector, see ``budget.other_light``; None where nothing is declared.
    """

    name: str
    fields: tuple[FieldResult, ...]
    table1: dict[str, Any]
    ghosts: list[dict[str, Any]]
    plan: str
    costs: dict[str, Any]
    other_light: dict[str, Any] | None = None

    @property
    def ghost_count(self) -> int:
        """Ghost paths in the table."""
        return len(self.ghosts)


@dataclass(frozen=True)
class Analysis:
    """What ``analyse`` returns."""

    bands: dict[str, BandResult]
    instrument_name: str
    instrument_hash: str
    provenance: dict[str, Any]
    seconds: float


def list_bands(instrument: str | None = None) -> tuple[str, ...]:
    """Names of the bands of an instrument file (the reference instrument if None). Raises InputError."""
    return load_instrument(instrument).bands


def analyse(
    bands: Sequence[str],
    instrument: str | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    progress: Progress = lambda _: None,
    cross_family: bool = False,
) -> Analysis:
    """Analyse bands of an instrument file (None: the reference instrument; no band: all of them).

    tolerance: part of the nominal modulation that a pair of beams may add and be left out. progress receives one line
    of text at a time. cross_family: see ``budget.fieldpoint.field_point``.

    Raises InputError, EmptyBeamError, MethodLimitError.
    """
    started = time.perf_counter()
    loaded = load_instrument(instrument)
    results = analyse_bands(loaded, bands or loaded.bands, tolerance, progress, cross_family)
    return Analysis(results, loaded.name, loaded.hash, {}, time.perf_counter() - started)


def analyse_band(
    instrument: Instrument,
    name: str,
    tolerance: float = DEFAULT_TOLERANCE,
    progress: Progress = lambda _: None,
    cross_family: bool = False,
) -> BandResult:
    """One band at its five field points; see ``analyse``."""
    return analyse_bands(instrument, [name], tolerance, progress, cross_family)[name]


def analyse_bands(
    instrument: Instrument, names: Sequence[str], tolerance: float, progress: Progress, cross_family: bool
) -> dict[str, BandResult]:
    """Bands by name; all their field points share one pool of processes."""
    systems = {name: instrument.band(name) for name in names}
    results: dict[str, BandResult] = {}
    # Processes, not threads: half of the work is Python between short compiled loops.
    with ProcessPoolExecutor(PROCESSES) as pool:
        progress(f"{', '.join(names)}: searching ghost paths")
        searches = [
            pool.submit(prepare_band, instrument.raw, instrument.file, n, tolerance, cross_family) for n in names
        ]
        tasks: dict[str, Task] = {}
        for name, search in zip(names, searches, strict=True):
            tasks[name], found = search.result()
            count, traced = len(systems[name].field_points()), len(tasks[name].paths) - 2
            progress(f"{name}: {found - 2} ghost paths found, {traced} to be traced at {count} field points")
        # The zones' centres first: they take longest, and the others fill up what time the last of them leaves.
        pending: dict[str, list[Future[FieldResult]]] = {name: [] for name in names}
        for index in range(max(len(systems[name].field_points()) for name in names)):
            for name in names:
                if index < len(systems[name].field_points()):
                    pending[name].append(pool.submit(analyse_field, tasks[name], index))
        other = {name: pool.submit(other_light_of, instrument.raw, instrument.file, name) for name in names}
        for name, futures in pending.items():
            fields = []
            for future in futures:
                fields.append(future.result())
                pairs = len(fields[-1].coherency.pairs)
                progress(f"{name}: field point {len(fields)} of {len(futures)}: {pairs} pairs of beams")
            rows = ghost_rows(systems[name], [(field.point, field.source) for field in fields])
            column = table1(name, [field.retrieval for field in fields], families=families(rows))
            bound = fields[0].polarisation
            column["polarisation"] = bound.document() if bound else None
            costs = cost_table(systems[name], [field.costs for field in fields])
            plan = fields[0].point.plan.table(60)
            results[name] = BandResult(name, tuple(fields), column, rows, plan, costs, other[name].result())
    return results


def other_light_of(raw: dict[str, Any], file: str, name: str) -> dict[str, Any] | None:
    """Light of other channels in a band, from the instrument's plain data: what a process can be asked for."""
    with threadpool_limits(1):
        return other_light(from_document(raw, file), name)


def prepare_band(raw: dict[str, Any], file: str, name: str, tolerance: float, cross_family: bool) -> tuple[Task, int]:
    """Search and select the ghost paths of a band: the task of its field points, and how many paths were found."""
    here = setting_of(raw, file, name)
    found = find_paths(here.system)
    paths = select_ghosts(here, found)
    unseen = untraced(here, found, paths)
    return Task(raw, file, name, paths, tolerance, cross_family, unseen), len(found)


def plan_band(
    band: str, instrument: str | None = None, tolerance: float = DEFAULT_TOLERANCE, progress: Progress = lambda _: None,
    cross_family: bool = False,
) -> tuple[PairPlan, str]:  # fmt: skip
    """What ``analyse`` would compute at the zone's centre of a band, without computing it: the plan, and as text.

    Beams are traced and bounded; pupil fields are not fitted and contrasts not evaluated, but for the nominal pair,
    whose time prices the rest. Raises InputError, EmptyBeamError.
    """
    loaded = load_instrument(instrument)
    system = loaded.band(band)
    here = band_setting(system)
    progress(f"{band}: searching ghost paths")
    found = find_paths(system)
    paths = select_ghosts(here, found)
    x0 = system.field_points()[0]
    progress(f"{band}: tracing {len(paths) - 2} of {len(found) - 2} ghost paths to the zone's centre")
    with threadpool_limits(1):
        beams = trace_beams(here, paths, x0, tolerance, cross_family)
        field_point(here, paths[:2], x0, tolerance, cross_family)
        started = time.perf_counter()
        field_point(here, paths[:2], x0, tolerance, cross_family)
        price = time.perf_counter() - started
    fitted = len({number for pair in beams.plan.kept for number in (pair.m, pair.l)})
    seconds = price * (fitted + len(beams.plan.kept)) / 3.0
    text = (
        f"{band}: {len(found) - 2} ghost paths found, {len(paths) - 2} traced (power above {POWER_FLOOR:g} of the "
        f"nominal, or amplitude above {AMPLITUDE_FLOOR:g} of the modulation), "
        f"{len(beams.empty)} of them do not reach the zone's centre\n"
        f"pupil fields: {fitted} of {len(beams.paths)} beams; the others add their power, summed over rays\n"
        f"contrasts: {len(beams.plan.kept)} pairs, boundary-fitted Gauss panels; about {seconds:.0f} s per field "
        f"point on one core (nominal pair: {price:.2f} s)\n"
        f"{_point_source_text(system, paths[2:], beams.theta, x0)}\n\n{beams.plan.table(60)}"
    )
    return beams.plan, text


def _point_source_text(
    system: OpticalSystem, ghosts: Sequence[Path], theta: NDArray[np.float64], x0: NDArray[np.float64]
) -> str:
    """How point-source contrasts would be found, and which of them not over direction cosines, and why."""
    with threadpool_limits(1):
        other = without_directions(system, ghosts, theta, x0)
    lines = [
        f"point source: {len(ghosts) - len(other)} ghosts over direction cosines (over their own pupil where the "
        f"fit leaves more than {CONTRAST_TOLERANCE:g}), {len(other)} over their own pupil"
    ]
    return "\n".join(lines + [f"  {label}: {reason}" for label, reason in other.items()])


@dataclass(frozen=True)
class Task:
    """What a process needs to analyse a field point: the instrument's plain data, the band, its paths, the options, and
    the ghosts that were found and are not traced."""

    raw: dict[str, Any]
    file: str
    band: str
    paths: tuple[Path, ...]
    tolerance: float
    cross_family: bool
    untraced: Untraced | None = None


_settings: dict[tuple[str, str, str], Setting] = {}


def setting_of(raw: dict[str, Any], file: str, band: str) -> Setting:
    """The band's setting, made once in a process; those of another instrument are forgotten."""
    instrument = from_document(raw, file)
    key = (instrument.hash, file, band)
    if key not in _settings:
        if any(known[:2] != key[:2] for known in _settings):
            _settings.clear()
        _settings[key] = band_setting(instrument.band(band))
    return _settings[key]


def analyse_field(task: Task, index: int) -> FieldResult:
    """One field point of one band: beams, coherence, point-source contrasts, interferogram, M, B and NMA."""
    here = setting_of(task.raw, task.file, task.band)
    system = here.system
    x0 = system.field_points()[index]
    # A BLAS that starts threads of its own for 300 × 150 matrices only waits for them.
    with threadpool_limits(1):
        point = field_point(here, task.paths, x0, task.tolerance, task.cross_family)
        orders = 2 if index in CONTRAST_FIELDS else 0
        source = point_source(system, task.paths, point.theta, x0, orders)
        rows = zone_rows(system, x0)
        terms = interferogram_terms(point.coherency, here.spectrum.sigma, here.weight, rows, system.pixel)
        psi, costs = terms.psi(), attribute(point, terms, task.untraced, source)
        bound = None
        if index == 0:
            bound = polarisation_bound(
                system, point.coherency, point.paths, here.spectrum.sigma, here.weight, rows, point.theta
            )
        spots, psfs = (spot_pictures(source), psf_pictures(system, source)) if index == 0 else ((), ())
    x, y = float(x0[0]), float(x0[1])
    return FieldResult(index, x, y, point, source, psi, retrieve(psi), costs, spots, psfs, bound)


def zone_rows(system: OpticalSystem, x0: NDArray[np.float64]) -> NDArray[np.float64]:
    """Row centres of the band's zone along y, m, measured from the field point ``x0``.

    The interferogram of a field point is that of the whole zone with powers and contrasts frozen at x0 and OPDs
    continued along their slopes, as in the paper's 1D generator.
    """
    _, _, y0, y1 = system.zone()
    count = round((y1 - y0) / system.pixel)
    return np.asarray(y0 + (np.arange(count) + 0.5) * system.pixel - float(x0[1]), dtype=np.float64)
