"""The slope of every ghost's path difference: exact rays beside the count of sloped surfaces, and why they part.

    uv run python -m validation.slopes [BAND…] [--instrument FILE] [--out DIR] [--json]

The exact slope of a ghost against the nominal beam of arm 1 is the difference of their direction cosines along y at
one detector point, for rays of one pupil point, mean over the pupil. The paper counts: every sloped surface that is met
adds an equal share. What is left out is put back, piece by piece, until the count comes to the exact slope:

* weights: moving a face by h along its normal N adds (n1 d1 − n2 d2)·N h, which differs between a mirror and a face met
  from inside or outside;
* heights: the ghost meets the surface at another height than the nominal beam does for the same detector point, in
  particular at the inverted one after a relay of magnification −1;
* geometry: the slope that is there although the sloped surfaces are set straight.

The smallest set of pieces that comes within 2 % of the slope, or of the nominal one if that is larger, is the reason
that is given. None does: "not explained". Ghosts are those that the analysis traces.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.ghosts import count_slope
from cgi_wave.budget.select import select_ghosts
from cgi_wave.budget.setting import band_setting
from cgi_wave.errors import EmptyBeamError
from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.rays.beams import nominal_direction, rays_to_point
from cgi_wave.rays.paths import Path, find_paths
from cgi_wave.rays.trace import aim_and_trace, compile_sequence, history
from cgi_wave.report.output import to_json
from validation.study_page import table, write_page

Array = NDArray[np.float64]
#: Two slopes are taken as one within this part of the larger of the ghost's slope and the nominal one.
TOLERANCE = 0.02
#: Pupil points that stand for a ghost's beam, and the step on the detector (m) over which heights are differenced.
POINTS, STEP = 24, 2e-5
#: Source directions that differ by more than this (tilts are a tenth of it) belong to another ray.
JUMP = 1e-2
PIECES = {
    "weights": "faces and mirror do not count alike",
    "heights": "met at another height",
    "geometry": "slope without sloped surfaces",
}
#: What is said if nothing fits and aiming once more from elsewhere finds another ray.
FOLDED = "two rays lead from one pupil point to the detector point"


def straightened(name: str, file: str | None) -> OpticalSystem:
    """A band with its sloped surfaces set straight about x, in the frame they stand in."""
    instrument = load_instrument(file)
    system = instrument.band(name)
    inter = system.document.interferometer
    assert inter is not None
    values: dict[str, float | str | list[float]] = {}
    for frame in system.document.frame:
        for surface in frame.surface:
            if surface.name in {*inter.arm1.sloped, *inter.arm2.sloped}:
                values[f"{surface.name}.tilt_deg"] = [0.0, *surface.tilt_deg[1:]]
    return instrument.with_values(values, name).band(name)


def beam(system: OpticalSystem, path: Path, x0: Array, start: Array) -> tuple[Array, Array]:
    """Pupil points (N, 2) of a path that reach a detector point, a few of those that pass, and their directions there.

    Raises EmptyBeamError if none does.
    """
    rays = rays_to_point(system, path, x0, np.array([system.sigma0]), start)
    lit = np.flatnonzero((rays.clearance[:, 0] > 0).all(axis=0))
    if not len(lit):
        raise EmptyBeamError(f"{path.label}: no ray passes")
    few = lit[:: max(1, len(lit) // POINTS)]
    return rays.pupil[0, few], rays.direction[0, few]


def crossings(system: OpticalSystem, path: Path, p: Array, x0: Array, start: Array) -> list[tuple[str, Array, Array]]:
    """Sloped surfaces met: name, path length per height (N,) times their slope, and heights per detector y (N,)."""
    inter = system.document.interferometer
    assert inter is not None
    sloped = {*inter.arm1.sloped, *inter.arm2.sloped}
    tilts = {s.name: s.tilt_deg[0] for frame in system.document.frame for s in frame.surface}
    sequence = compile_sequence(system, path, system.sigma0)
    ends = [aim_and_trace(sequence, p, x0 + np.array([0.0, s * STEP]), start) for s in (-1, 0, 1)]
    points = history(sequence, p, ends[1].theta)
    axes, _ = system.pupil_frame()
    found = []
    for k, name in enumerate(sequence.names):
        if name not in sloped:
            continue
        surface = system.surfaces[system.number[name]]
        normal = axes @ surface.rotation[2]
        before, after = (points[j + 1] - points[j] for j in (k, k + 1))
        before, after = (d / np.linalg.norm(d, axis=1, keepdims=True) for d in (before, after))
        n1 = sequence.n1[k]
        n2 = n1 if sequence.mode[k] == 1 else sequence.n2[k]
        per_height = (n1 * before - n2 * after) @ normal * np.sin(np.radians(tilts[name]))
        height = (ends[2].traced.foot[k, 1] - ends[0].traced.foot[k, 1]) / (2 * STEP)
        found.append((name, per_height, height))
    return found


def compare(
    system: OpticalSystem, straight: OpticalSystem, path: Path, nominal: Sequence[Path], x0: Array
) -> dict[str, Any]:
    """One ghost at one detector point: exact slope, count, pieces. Raises EmptyBeamError where it does not arrive."""
    theta = nominal_direction(system, nominal[0], x0)
    p, q = beam(system, path, x0, theta)
    one, two = (aim_and_trace(compile_sequence(system, n, system.sigma0), p, x0, theta) for n in nominal)
    ok = one.ok & two.ok
    if not ok.any():
        raise EmptyBeamError(f"{path.label}: the nominal beam does not use these pupil points")
    p, q = p[ok], q[ok]
    # A second pass for the ghost's own directions at the pupil, from which heights are differenced.
    start = _directions(system, path, p, x0, theta)
    again = aim_and_trace(compile_sequence(system, path, system.sigma0), p, x0, start)
    folded = bool(np.abs(again.traced.direction - q).max() > 1e-6)
    exact = float(np.mean(q[:, 1] - one.traced.direction[ok, 1]))
    nominal_slope = float(np.mean(one.traced.direction[ok, 1] - two.traced.direction[ok, 1]))
    counted = count_slope(system, nominal[0], nominal[1], path, nominal_slope)
    assert counted is not None
    own = crossings(system, path, p, x0, start)
    first, second = (crossings(system, n, p, x0, theta) for n in nominal)
    # Heights of the nominal beams on each sloped surface, and the equal share that the count gives to each crossing.
    usual = {name: float(np.mean(height)) for name, _, height in (*first, *second)}
    share = nominal_slope / (len(first) - len(second))

    def total(some: list[tuple[str, Array, Array]], weights: bool, heights: bool) -> float:
        parts = []
        for name, per_height, height in some:
            ratio = height / usual[name] if heights else 1.0
            parts.append(np.mean((per_height * usual[name] if weights else share) * ratio))
        return float(sum(parts))

    geometry, jumps = _straight_slope(straight, path, nominal, p, x0, theta, start)
    folded |= jumps
    missing = abs(total(second, True, True) - total(first, True, True) + nominal_slope)
    reason, left, scale = "", abs(exact - counted), max(abs(nominal_slope), abs(exact))
    if left > TOLERANCE * scale:
        reason = FOLDED if folded else "not explained"
        for size in (1, 2, 3):
            tries = []
            for pieces in combinations(PIECES, size):
                value = total(own, "weights" in pieces, "heights" in pieces)
                value -= total(first, "weights" in pieces, "heights" in pieces)
                value += geometry if "geometry" in pieces and geometry is not None else 0.0
                if np.isfinite(value):  # not where a ray beside has no end
                    tries.append((abs(exact - value), pieces))
            if not tries:
                break
            left, best = min(tries)
            if left <= TOLERANCE * scale:
                reason = "; ".join(PIECES[piece] for piece in best)
                break
    ratios = [(float(np.mean(height)) / usual[name]) for name, _, height in own]
    magnification = [round(ratio, 3) if np.isfinite(ratio) else None for ratio in ratios]
    return {
        "label": path.label, "order": path.order, "exact": exact, "counted": counted, "nominal": nominal_slope,
        "ratio": exact / counted if counted else None, "met": len(own), "heights": magnification,
        "geometry": geometry, "reason": reason, "left": left / scale,
        "nominal_check": missing / abs(nominal_slope),
    }  # fmt: skip


def _directions(system: OpticalSystem, path: Path, p: Array, x0: Array, theta: Array) -> Array:
    """Source directions (N, 2) of the rays of a path from pupil points that end on x0."""
    sequence = compile_sequence(system, path, system.sigma0)
    aimed = aim_and_trace(sequence, p, x0, theta)
    if not aimed.ok.all():
        good = aimed.ok
        if not good.any():
            return np.broadcast_to(theta, p.shape).copy()
        nearest = np.argmin(((p[:, None] - p[good][None]) ** 2).sum(axis=2), axis=1)
        aimed = aim_and_trace(sequence, p, x0, aimed.theta[good][nearest])
    return np.where(aimed.ok[:, None], aimed.theta, theta)


def _straight_slope(
    system: OpticalSystem, path: Path, nominal: Sequence[Path], p: Array, x0: Array, theta: Array, start: Array
) -> tuple[float | None, bool]:
    """Slope of a ghost against arm 1 with straight surfaces, None where it does not arrive then; whether aiming found
    another ray there than in the instrument itself."""
    ghost = aim_and_trace(compile_sequence(system, path, system.sigma0), p, x0, start)
    arm1 = aim_and_trace(compile_sequence(system, nominal[0], system.sigma0), p, x0, theta)
    ok = ghost.ok & arm1.ok
    if not ok.any():
        return None, False
    jumps = bool(np.abs(ghost.theta - start)[ok].max() > JUMP)
    return float(np.mean((ghost.traced.direction - arm1.traced.direction)[ok, 1])), jumps


def band(name: str, file: str | None) -> dict[str, Any]:
    """All ghosts of a band, at the first field point that each reaches."""
    system, straight = load_instrument(file).band(name), straightened(name, file)
    paths = select_ghosts(band_setting(system), find_paths(system))
    nominal, ghosts = [path for path in paths if path.order == 0], [path for path in paths if path.order > 0]
    rows, unreached = [], 0
    for path in ghosts:
        for x0 in system.field_points():
            try:
                rows.append(compare(system, straight, path, nominal[:2], x0))
                break
            except EmptyBeamError:
                continue
        else:
            unreached += 1
    reasons = Counter(row["reason"] or "count right" for row in rows)
    return {
        "band": name, "ghosts": len(ghosts), "compared": len(rows), "reach_no_field_point": unreached,
        "nominal_slope": rows[0]["nominal"] if rows else None, "reasons": dict(reasons.most_common()), "rows": rows,
        "worst_nominal_check": max((row["nominal_check"] for row in rows), default=None),
    }  # fmt: skip


def study(bands: Sequence[str] = (), file: str | None = None) -> dict[str, Any]:
    """Everything, as plain data: per band counts of reasons and a row per ghost."""
    instrument = load_instrument(file)
    found = [band(name, file) for name in bands or instrument.bands]
    return {"instrument": instrument.name, "tolerance": TOLERANCE, "bands": found}


def main() -> None:
    """Print the study and write its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bands", nargs="*", metavar="BAND")
    parser.add_argument("--instrument", metavar="FILE")
    parser.add_argument("--out", type=File, metavar="DIR", help="write a page with a row per ghost there")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    arguments = parser.parse_args()
    result = study(arguments.bands, arguments.instrument)
    if arguments.out:
        parts = ["# Slopes of ghosts: rays beside the count\n"]
        for part in result["bands"]:
            rows = [{key: row[key] for key in ("label", "exact", "counted", "ratio", "met", "heights", "reason")}
                    for row in part["rows"]]  # fmt: skip
            parts += [f"## {part['band']}\n", table(rows)]
        write_page(arguments.out, "slopes", parts)
    if arguments.json:
        print(to_json(result))
        return
    for part in result["bands"]:
        print(f"{part['band']}: {part['compared']} of {part['ghosts']} ghosts, {part['reach_no_field_point']} reach no "
              f"field point; nominal slope {part['nominal_slope']:.4e}, to which the pieces add up within "
              f"{part['worst_nominal_check']:.1e}")  # fmt: skip
        for reason, count in part["reasons"].items():
            some = [row for row in part["rows"] if (row["reason"] or "count right") == reason]
            print(f"  {count:4d}  {reason}; e.g. {some[0]['label']}: rays {some[0]['exact']:+.4e}, "
                  f"count {some[0]['counted']:+.4e}")  # fmt: skip


if __name__ == "__main__":
    main()
