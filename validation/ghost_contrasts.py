"""Every γ of every ghost with the nominal beam, all field points and bands: bounds, refusals, and what it takes.

    uv run python -m validation.ghost_contrasts [--json] [--bands NIR VIS] [--fields N] [--every N] [--processes N]
                                                [--tolerance T]
    uv run python -m validation.ghost_contrasts --charts BAND [--bends B …] [--every N]
    uv run python -m validation.ghost_contrasts --edge BAND [--every N]

Kernels compiled beforehand, as many processes as asked for, each with its share of ghosts. Seconds are told apart:
tracing the ghosts' rays; fitting their fields over direction cosines; making other fields where these do not do, by
more rays or over the ghost's own pupil (docs/contrast.md); and the contrasts of all these fields. They are means over
the processes; ``elapsed`` is the time from the first one's start to the last one's end. Finding paths and nominal
fields is not counted.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cgi_wave.analysis import list_bands
from cgi_wave.budget.contrast import (
    FINER_RAYS,
    Contrast,
    better,
    contrast_of,
    direction_contrast,
    over_directions,
    over_either,
    pupil_fields,
)
from cgi_wave.budget.pointfields import (
    CONTRAST_TOLERANCE,
    FINE_RAYS,
    GhostField,
    field_of,
    fine_field,
    fine_rays,
    nominal_fields,
)
from cgi_wave.budget.select import select_ghosts
from cgi_wave.budget.setting import band_setting
from cgi_wave.errors import CgiWaveError, EmptyBeamError
from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.rays.beams import nominal_direction, rays_from_direction
from cgi_wave.rays.charts import rays_from_points
from cgi_wave.rays.paths import Path, find_paths
from cgi_wave.rays.trace import compile_sequence, jacobian
from cgi_wave.report.output import to_json
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.overpupil import contrast_over_pupil
from cgi_wave.wave.pupilfields import PupilFields

Array = NDArray[np.float64]
STEPS = ("tracing", "fitting", "other fields", "contrasts")


@dataclass(frozen=True)
class Place:
    """One field point: the nominal beam's source direction and fields, and the detector point."""

    system: OpticalSystem
    theta: Array
    x0: Array
    nominal: Callable[[float], PupilField]


class Clock:
    """Seconds of each step."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(STEPS, 0.0)

    @contextmanager
    def on(self, step: str) -> Iterator[None]:
        """What is done meanwhile counts for ``step``."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[step] += time.perf_counter() - started


@dataclass(frozen=True)
class Share:
    """What one process did: γ or why there is none, by ghost; ghosts that do not arrive; seconds of each step; start
    and end by the machine's clock."""

    done: list[tuple[str, Contrast | str]]
    dark: int
    seconds: dict[str, float]
    start: float
    end: float


def study(
    bands: Sequence[str] | None = None,
    fields: int = 5,
    every: int = 1,
    processes: int = 2,
    tolerance: float = CONTRAST_TOLERANCE,
    progress: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Figures by band and together. fields: how many of the field points; every: one ghost in so many."""
    found = []
    for name in bands or list_bands():
        found.append(_band(name, fields, every, processes, tolerance))
        progress(f"{name}: {found[-1]['pairs']} pairs, {found[-1]['elapsed']:.1f} s")
    summed = ("pairs", "no_light", "refused", "above_tolerance", "over_the_pupil", "bent_charts", "elapsed")
    total: dict[str, Any] = {key: sum(row[key] for row in found) for key in summed}
    total["seconds"] = {step: sum(row["seconds"][step] for row in found) for step in STEPS}
    total["ms_per_contrast"] = 1e3 * total["seconds"]["contrasts"] * processes / max(total["pairs"], 1)
    return {"tolerance": tolerance, "processes": processes, **total, "bands": found}


_together: Any = None


def _wait_for(barrier: Any) -> None:
    global _together
    _together = barrier


def _band(name: str, fields: int, every: int, processes: int, tolerance: float) -> dict[str, Any]:
    fresh = get_context("spawn")
    with ProcessPoolExecutor(processes, fresh, _wait_for, (fresh.Barrier(processes),)) as pool:
        work = partial(_share, name, fields, every, processes, tolerance)
        shares = list(pool.map(work, range(processes)))
    done = [item for share in shares for _, item in share.done]
    contrasts = [item for item in done if isinstance(item, Contrast)]
    reasons = Counter(f"{label}: {item}" for share in shares for label, item in share.done if isinstance(item, str))
    error = np.array([item.error for item in contrasts])
    over = [item for item in contrasts if item.method.startswith("over")]
    return {
        "band": name,
        "pairs": len(done),
        "no_light": sum(share.dark for share in shares),
        "refused": sum(reasons.values()),
        "refusals": dict(reasons),
        "above_tolerance": int((error > tolerance).sum()),
        "above": {f"{limit:g}": int((error > limit).sum()) for limit in (1e-6, 1e-5, 1e-4, 1e-2)},
        "largest_error": float(error.max(initial=0.0)),
        "median_error": float(np.median(error)) if len(error) else None,
        "over_the_pupil": len(over),
        "bent_charts": sum("lens" in item.method for item in over),
        "seconds": {step: sum(share.seconds[step] for share in shares) / processes for step in STEPS},
        "elapsed": max(share.end for share in shares) - min(share.start for share in shares),
    }


def _share(name: str, fields: int, every: int, processes: int, tolerance: float, number: int) -> Share:
    """One process's share of a band."""
    with threadpool_limits(1):
        system = load_instrument().band(name)
        paths = select_ghosts(band_setting(system), find_paths(system))
        places = []
        for x0 in system.field_points()[:fields]:
            theta = nominal_direction(system, paths[0], x0)
            places.append(Place(system, theta, x0, nominal_fields(system, paths[0], theta, x0)))
            places[-1].nominal(0.0)
        ghosts = paths[2::every]
        _warm(places[0], ghosts, tolerance)
        clock, done, dark = Clock(), [], 0
        _together.wait()
        start = time.monotonic()
        for place in places:
            for path in ghosts[number::processes]:
                found = _one(place, path, tolerance, clock)
                if found is None:
                    dark += 1
                else:
                    done.append((path.label, found))
        return Share(done, dark, clock.seconds, start, time.monotonic())


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


def _one(place: Place, path: Path, tolerance: float, clock: Clock) -> Contrast | str | None:
    """γ as ``contrast_of`` has it, step by step; why there is none; None for a ghost that does not arrive."""
    where = place.system, path, place.theta, place.x0

    def field(count: int, tracing: str, fitting: str) -> Callable[[], GhostField]:
        with clock.on(tracing):
            rays = fine_rays(*where, count)
        try:
            with clock.on(fitting):
                found = fine_field(*where, rays, tolerance)
        except CgiWaveError as limit:
            return partial(_refuse, limit)
        return lambda: found

    def over_pupil() -> PupilFields:
        with clock.on("other fields"):
            return pupil_fields(*where, place.nominal, tolerance)

    try:
        first = field(FINE_RAYS, "tracing", "fitting")
    except EmptyBeamError:
        return None
    with clock.on("contrasts"):
        found = over_directions(first, place.nominal, tolerance)
    if found.nearly(tolerance):
        more = field(FINER_RAYS, "other fields", "other fields")
        with clock.on("contrasts"):
            found = better(found, over_directions(more, place.nominal, tolerance))
    if found.within(tolerance):
        return found.contrast
    try:
        fields: Callable[[], PupilFields] = partial(_given, over_pupil())
    except CgiWaveError as limit:
        fields = partial(_refuse, limit)
    try:
        with clock.on("contrasts"):
            return over_either(found, fields, place.nominal, place.system.sigma0, tolerance)
    except EmptyBeamError:  # all that passes misses the detector
        return None
    except CgiWaveError as limit:
        return str(limit)


def _given(fields: PupilFields) -> PupilFields:
    return fields


def _refuse(limit: CgiWaveError) -> Any:
    raise limit


def _centre(name: str) -> tuple[Place, Sequence[Path]]:
    """The zone's centre of a band, and its paths, the nominal ones first."""
    system = load_instrument().band(name)
    paths = select_ghosts(band_setting(system), find_paths(system))
    x0 = system.field_points()[0]
    theta = nominal_direction(system, paths[0], x0)
    return Place(system, theta, x0, nominal_fields(system, paths[0], theta, x0)), paths


def _quantiles(shares: Sequence[float]) -> dict[str, float]:
    low, middle, high = (float(value) for value in np.quantile(shares, (0.1, 0.5, 0.9)))
    above = float(np.mean(np.array(shares) > 0.01))
    found = {"count": len(shares), "10%": low, "median": middle, "90%": high, "largest": max(shares)}
    return {**found, "share_above_0.01": above}


def other_charts(name: str, every: int, bends: Sequence[float] = (-5.0, 5.0)) -> dict[str, Any]:
    """By how much γ in bent charts, 1/m, differs from that over directions, as a share of |γ|, at the zone's centre.

    Over the pupil in each; what differs is light diffracted at edges between aperture and detector. pupil_image: bends,
    1/m, of the chart that is an image of the pupil for the nominal beam, along its axes, at all field points.
    """
    place, paths = _centre(name)
    system, shares = place.system, []
    with threadpool_limits(1):
        for path in paths[2::every]:
            trace = partial(rays_from_points, system, path, place.theta, place.x0, system.sigma0)
            try:
                values = [
                    contrast_over_pupil(
                        trace, system.pupil_radius, place.nominal, system.sigma0, path.label, 1e-6, bend
                    ).value
                    for bend in (0.0, *bends)
                ]
            except CgiWaveError:
                continue
            shares += [abs(value / values[0] - 1.0) for value in values[1:] if values[0]]
    images = np.array([_pupil_image(system, paths[0], x0) for x0 in system.field_points()])
    image = [float(images.min()), float(images.max())]
    return {"band": name, "bends": list(bends), **_quantiles(shares), "pupil_image": image}


def _pupil_image(system: OpticalSystem, path: Path, x0: Array) -> Array:
    """Bends (2,), 1/m, of the chart in which rays from the pupil's centre meet: u = q − b (x − x0) with ∂u/∂θ = 0."""
    sequence, theta = compile_sequence(system, path, system.sigma0), nominal_direction(system, path, x0)
    x_by_theta, q_by_theta = jacobian(sequence, np.zeros((1, 2)), theta)
    bend = q_by_theta[0] @ np.linalg.inv(x_by_theta[0])
    bends: Array = np.linalg.eigvalsh(0.5 * (bend + bend.T))
    return bends


def cut_at_the_edge(name: str, every: int) -> dict[str, Any]:
    """By how much γ of rays that end at the detector's edge differs from that in its plane, as a share of |γ|.

    At the zone's last field point, in its corner, for ghosts with a field over directions either way.
    """
    place, paths = _centre(name)
    system, x0 = place.system, place.system.field_points()[-1]
    theta = nominal_direction(system, paths[0], x0)
    near, shares = nominal_fields(system, paths[0], theta, x0)(0.0), []
    with threadpool_limits(1):
        for path in paths[2::every]:
            try:
                whole = fine_field(system, path, theta, x0, fine_rays(system, path, theta, x0))
                rays = rays_from_direction(system, path, theta, x0, np.array([system.sigma0]), FINE_RAYS)
                cut = GhostField(field_of(system, path, rays, x0, CONTRAST_TOLERANCE), 1.0, 0.0)
                plane, ended = (direction_contrast(field, near, CONTRAST_TOLERANCE).value for field in (whole, cut))
            except CgiWaveError:
                continue
            shares.append(abs(ended / plane - 1.0))
    return {"band": name, "x0_mm": [float(value) * 1e3 for value in x0], **_quantiles(shares)}


def text(result: dict[str, Any]) -> str:
    """The figures as lines."""
    columns = ("pairs", "no_light", "refused", "above_tolerance", "over_the_pupil", "bent_charts")
    names = ("pairs", "no light", "refused", f"> {result['tolerance']:g}", "over pupil", "bent chart")
    wide = max(len(step) for step in STEPS) + 6
    lines = [
        f"{'band':10}"
        + "".join(f"{name:>12}" for name in names)
        + "".join(f"{step + ' / s':>{wide}}" for step in (*STEPS, "elapsed"))
    ]
    for row in (*result["bands"], {"band": "all", **result}):
        seconds = [*(row["seconds"][step] for step in STEPS), row["elapsed"]]
        lines.append(
            f"{row['band']:10}"
            + "".join(f"{row[key]:>12}" for key in columns)
            + "".join(f"{value:>{wide}.2f}" for value in seconds)
        )
    lines.append(
        f"{result['processes']} processes, {result['elapsed']:.1f} s in all; contrasts of all fields "
        f"{result['seconds']['contrasts']:.1f} s, {result['ms_per_contrast']:.2f} ms of one process for each"
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
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--tolerance", type=float, default=CONTRAST_TOLERANCE)
    parser.add_argument("--charts", metavar="BAND", help="instead: by how much γ of one band differs in bent charts")
    parser.add_argument("--bends", nargs="+", type=float, default=[-5.0, 5.0], help="of these, 1/m")
    parser.add_argument("--edge", metavar="BAND", help="instead: by how much for rays cut at the detector's edge")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    given = parser.parse_args(words)

    def say(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    if given.charts:
        print(to_json(other_charts(given.charts, given.every, given.bends)))
        return
    if given.edge:
        print(to_json(cut_at_the_edge(given.edge, given.every)))
        return
    result = study(given.bands, given.fields, given.every, given.processes, given.tolerance, say)
    print(to_json(result) if given.json else text(result))


if __name__ == "__main__":
    main()
