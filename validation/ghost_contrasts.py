"""Every γ of every ghost with the nominal beam, all field points and bands: bounds, refusals, and what it takes.

    uv run python -m validation.ghost_contrasts [--json] [--bands NIR VIS] [--fields N] [--every N] [--threads N]
                                                [--tolerance T] [--charts BAND]

One process, kernels compiled beforehand. Seconds are told apart: tracing the ghosts' rays, fitting their fields over
direction cosines, the contrasts of these, and what remains, whose bounds exceed the tolerance or which have no such
field: more rays, or the ghost's own pupil (docs/contrast.md). Finding paths and nominal fields is not counted. CPU
seconds stand beside wall time, which other jobs stretch.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cgi_wave.analysis import list_bands
from cgi_wave.budget.pointsource import (
    CONTRAST_TOLERANCE,
    FINE_RAYS,
    SHARE,
    Contrast,
    OverDirections,
    contrast_of,
    field_of,
    nominal_fields,
    over_directions,
)
from cgi_wave.budget.select import select_ghosts
from cgi_wave.budget.setting import band_setting
from cgi_wave.errors import CgiWaveError, EmptyBeamError
from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.rays.beams import Rays, nominal_direction, rays_from_direction
from cgi_wave.rays.charts import rays_from_points
from cgi_wave.rays.paths import Path, find_paths
from cgi_wave.report.output import to_json
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.overpupil import contrast_over_pupil

Array = NDArray[np.float64]
STEPS = ("tracing", "fitting", "contrasts", "rest")


@dataclass(frozen=True)
class Place:
    """One field point: the nominal beam's source direction and fields, and the detector point."""

    system: OpticalSystem
    theta: Array
    x0: Array
    nominal: Callable[[float], PupilField]


def study(
    bands: Sequence[str] | None = None,
    fields: int = 5,
    every: int = 1,
    threads: int = 2,
    tolerance: float = CONTRAST_TOLERANCE,
    progress: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Figures by band and together. fields: how many of the field points; every: one ghost in so many."""
    found = []
    for name in bands or list_bands():
        system = load_instrument().band(name)
        paths = select_ghosts(band_setting(system), find_paths(system))
        found.append(_band(system, paths[:1], paths[2::every], fields, threads, tolerance))
        progress(f"{name}: {found[-1]['pairs']} pairs, {sum(found[-1]['seconds'].values()):.1f} s")
    summed = ("pairs", "no_light", "refused", "above_tolerance", "over_the_pupil", "bent_charts")
    total: dict[str, Any] = {key: sum(row[key] for row in found) for key in summed}
    for kind in ("seconds", "cpu_seconds"):
        total[kind] = {step: sum(row[kind][step] for row in found) for step in STEPS}
    total["seconds_all"] = sum(total["seconds"].values())
    total["cpu_ms_per_contrast"] = 1e3 * total["cpu_seconds"]["contrasts"] / max(total["pairs"], 1)
    return {"tolerance": tolerance, "threads": threads, **total, "bands": found}


def _band(
    system: OpticalSystem, nominal: Sequence[Path], ghosts: Sequence[Path], fields: int, threads: int, tolerance: float
) -> dict[str, Any]:
    places = []
    for x0 in system.field_points()[:fields]:
        theta = nominal_direction(system, nominal[0], x0)
        places.append(Place(system, theta, x0, nominal_fields(system, nominal[0], theta, x0)))
        places[-1].nominal(0.0)
    _warm(places[0], ghosts, tolerance)
    seconds, cpu, contrasts = dict.fromkeys(STEPS, 0.0), dict.fromkeys(STEPS, 0.0), []
    reasons: Counter[str] = Counter()
    dark = 0
    with threadpool_limits(1), ThreadPoolExecutor(threads) as pool:
        for place in places:
            done, empty = _place(place, ghosts, tolerance, pool, seconds, cpu)
            dark += empty
            for path, item in done:
                if isinstance(item, Contrast):
                    contrasts.append(item)
                else:
                    reasons[f"{path.label}: {item}"] += 1
    error = np.array([item.error for item in contrasts])
    over = [item for item in contrasts if item.method.startswith("over")]
    return {
        "band": system.band,
        "pairs": len(contrasts) + sum(reasons.values()),
        "no_light": dark,
        "refused": sum(reasons.values()),
        "refusals": dict(reasons),
        "above_tolerance": int((error > tolerance).sum()),
        "above": {f"{limit:g}": int((error > limit).sum()) for limit in (1e-6, 1e-5, 1e-4, 1e-2)},
        "largest_error": float(error.max(initial=0.0)),
        "median_error": float(np.median(error)) if len(error) else None,
        "over_the_pupil": len(over),
        "bent_charts": sum("lens" in item.method for item in over),
        "seconds": seconds,
        "cpu_seconds": cpu,
    }


def _warm(place: Place, ghosts: Sequence[Path], tolerance: float) -> None:
    """Compile what will be timed: some ghosts, each both ways."""
    for path in ghosts[:: max(1, len(ghosts) // 6)]:
        trace = partial(rays_from_points, place.system, path, place.theta, place.x0, place.system.sigma0)
        for both in (
            lambda path=path: contrast_of(place.system, path, place.theta, place.x0, place.nominal, tolerance),
            lambda path=path, trace=trace: contrast_over_pupil(
                trace, place.system.pupil_radius, place.nominal, place.system.sigma0, path.label, 1e-4
            ),
        ):
            try:
                both()
            except CgiWaveError:
                continue


def _place(
    place: Place,
    ghosts: Sequence[Path],
    tolerance: float,
    pool: ThreadPoolExecutor,
    seconds: dict[str, float],
    cpu: dict[str, float],
) -> tuple[list[tuple[Path, Contrast | str]], int]:
    """γ of every ghost, or why there is none; and how many do not arrive."""
    sigma = np.array([place.system.sigma0])

    def timed(step: str, work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
        started, used = time.perf_counter(), time.process_time()
        done = list(pool.map(work, items))
        seconds[step] += time.perf_counter() - started
        cpu[step] += time.process_time() - used
        return done

    def trace(path: Path) -> Rays | None:
        try:
            return rays_from_direction(place.system, path, place.theta, place.x0, sigma, FINE_RAYS)
        except EmptyBeamError:
            return None

    def fit(item: tuple[Path, Rays]) -> Callable[[], PupilField]:
        try:
            field = field_of(place.system, *item, place.x0, SHARE * tolerance)
        except CgiWaveError as limit:
            return partial(_refuse, limit)
        return lambda: field

    def overlap(field: Callable[[], PupilField]) -> OverDirections:
        return over_directions(field, place.nominal, tolerance)

    def rest(item: tuple[Path, OverDirections]) -> Contrast | str:
        path, first = item
        try:
            return contrast_of(place.system, path, place.theta, place.x0, place.nominal, tolerance, first)
        except CgiWaveError as limit:
            return str(limit)

    rays = timed("tracing", trace, ghosts)
    arrived = [(path, beam) for path, beam in zip(ghosts, rays, strict=True) if beam is not None]
    values = timed("contrasts", overlap, timed("fitting", fit, arrived))
    left = [
        (path, value)
        for (path, _), value in zip(arrived, values, strict=True)
        if value.contrast is None or value.contrast.error > tolerance
    ]
    again = {path.label: item for (path, _), item in zip(left, timed("rest", rest, left), strict=True)}
    done = [
        (path, again[path.label] if path.label in again else value.contrast)
        for (path, _), value in zip(arrived, values, strict=True)
    ]
    return done, len(ghosts) - len(arrived)


def _refuse(limit: CgiWaveError) -> PupilField:
    raise limit


def other_charts(name: str, every: int, bends: Sequence[float] = (-5.0, 5.0)) -> dict[str, Any]:
    """By how much γ in bent charts, 1/m, differs from that over directions, as a share of |γ|, at the zone's centre.

    Over the pupil in each; what differs is light diffracted at edges between aperture and detector.
    """
    system = load_instrument().band(name)
    paths = select_ghosts(band_setting(system), find_paths(system))
    x0 = system.field_points()[0]
    theta = nominal_direction(system, paths[0], x0)
    nominal = nominal_fields(system, paths[0], theta, x0)
    shares = []
    with threadpool_limits(1):
        for path in paths[2::every]:
            trace = partial(rays_from_points, system, path, theta, x0, system.sigma0)
            try:
                values = [
                    contrast_over_pupil(
                        trace, system.pupil_radius, nominal, system.sigma0, path.label, 1e-6, bend
                    ).value
                    for bend in (0.0, *bends)
                ]
            except CgiWaveError:
                continue
            shares += [abs(value / values[0] - 1.0) for value in values[1:] if values[0]]
    low, middle, high = (float(value) for value in np.quantile(shares, (0.1, 0.5, 0.9)))
    return {"band": name, "bends": list(bends), "count": len(shares), "10%": low, "median": middle, "90%": high}


def text(result: dict[str, Any]) -> str:
    """The figures as lines."""
    columns = ("pairs", "no_light", "refused", "above_tolerance", "over_the_pupil", "bent_charts")
    names = ("pairs", "no light", "refused", f"> {result['tolerance']:g}", "over pupil", "bent chart")
    lines = [f"{'band':10}" + "".join(f"{name:>12}" for name in (*names, *(f"{step} / s" for step in STEPS)))]
    for row in (*result["bands"], {"band": "all", **result}):
        cells = [str(row[key]) for key in columns] + [f"{row['seconds'][step]:.2f}" for step in STEPS]
        lines.append(f"{row['band']:10}" + "".join(f"{cell:>12}" for cell in cells))
    lines.append(f"{'CPU':10}" + " " * 72 + "".join(f"{result['cpu_seconds'][step]:>12.2f}" for step in STEPS))
    lines.append(
        f"{result['threads']} threads, {result['seconds_all']:.1f} s in all; {result['cpu_ms_per_contrast']:.2f} ms of "
        "CPU a contrast, given its field"
    )
    for row in result["bands"]:
        lines += [f"refused, {row['band']}: {reason}" for reason in row["refusals"]]
    return "\n".join(lines)


def main(words: Sequence[str] | None = None) -> None:
    """The study from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bands", nargs="*", metavar="BAND", help="all unless named")
    parser.add_argument("--fields", type=int, default=5, help="field points of a band, from the zone's centre on")
    parser.add_argument("--every", type=int, default=1, help="one ghost in so many")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--tolerance", type=float, default=CONTRAST_TOLERANCE)
    parser.add_argument("--charts", metavar="BAND", help="instead: what γ of one band is in charts bent by 5 1/m")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    given = parser.parse_args(words)

    def say(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    if given.charts:
        print(to_json(other_charts(given.charts, given.every)))
        return
    result = study(given.bands, given.fields, given.every, given.threads, given.tolerance, say)
    print(to_json(result) if given.json else text(result))


if __name__ == "__main__":
    main()
