"""The Monte-Carlo walk beside paths traced in sequence: ledger, power by path, irradiance of a Lambertian pupil.

    uv run python -m validation.flux [--instrument FILE] [--band NIR] [--rays N] [--seed S] [--json]

The walk knows no list of paths, the sequences know no lots. Power: every listed path is traced with rays of its own
over the declared field and compared with the share that arrived on it, in units of the standard error of both. A walk
meets what stands in the way; a sequence passes through it, and differs where it does. Irradiance: light of a Lambertian
pupil, counted in cells of the detector, beside the solid angle from which the cell's centre sees the pupil
(``rays_to_point``), times radiance and coatings. Powers add in both: interference is in neither.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError
from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.rays.beams import nominal_direction, rays_to_point
from cgi_wave.rays.flux import flux, from_field, lambertian
from cgi_wave.rays.ledger import SUMS, Flux, PathShare
from cgi_wave.rays.paths import Path, find_paths, pupil_probes
from cgi_wave.rays.trace import compile_sequence, trace
from cgi_wave.report.output import to_json

Array = NDArray[np.float64]

#: Rays of a traced sequence, over pupil and field.
TRACED = 2**14
#: Rays that must have come by a path, or should have, for it to be compared by itself. Weaker ones are added up.
FEWEST = 25
#: Irradiance: rays of the Lambertian pupil per ray of the ledger, split coarsely; cells along each side.
MORE, COARSE, CELLS = 10, 0.05, 16
#: Estimated power of a ghost, relative to the nominal beams, below which it is left out of the stray irradiance.
FAINTEST = 1e-6


def ledger(found: Flux) -> dict[str, Any]:
    """The sums of the ledger and what arrived, by order, with standard errors."""
    arrived = {name: {"share": one.share, "error": one.error} for name, one in found.arrived.items()}
    return {"sums": {name: found.sum(name) for name in SUMS}, "imbalance": found.imbalance, "arrived": arrived,
            "total_reflections": found.total_reflections, "events": found.events}  # fmt: skip


def powers(system: OpticalSystem, paths: tuple[Path, ...], found: Flux) -> dict[str, Any]:
    """Share of every path by lots and in sequence: how many differ by how many standard errors, and which most."""
    p, theta = pupil_probes(system, TRACED, seed=77)
    walked = {path.path: path for path in found.paths}
    rows: list[dict[str, Any]] = []
    traced_order, faint = [0.0, 0.0, 0.0], {"paths": 0, "traced": 0.0, "walked": 0.0, "error": 0.0}
    for path in paths:
        traced = trace(compile_sequence(system, path, system.sigma0), p, theta)
        power = np.where(traced.passes, traced.power, 0.0)
        mean = float(power.mean())
        traced_order[path.order] += mean
        one = walked.get(str(path), PathShare(0.0, 0.0, 0, str(path), path.label, path.order, False))
        if max(one.count, mean * found.rays / (2 * found.split)) < FEWEST:
            faint["paths"] += 1
            faint["traced"] += mean
            faint["walked"] += one.share
            faint["error"] = float(np.hypot(faint["error"], one.error))
            continue
        # Even rays err less than random ones, whose error this is.
        error = float(np.hypot(one.error, power.std() / np.sqrt(TRACED)))
        rows.append({"label": path.label, "order": path.order, "traced": mean, "walked": one.share, "error": error,
                     "score": (one.share - mean) / error if error else 0.0})  # fmt: skip
    rows.sort(key=lambda row: -abs(row["score"]))
    score = np.array([row["score"] for row in rows])
    listed = {str(path) for path in paths}
    unlisted = [one for one in found.paths if one.order <= 2 and one.path not in listed]
    names = ("nominal", "order 1", "order 2")
    return {
        "compared": len(rows),
        "of": len(paths),
        "worst": rows[:8],
        "mean_square_score": float((score**2).mean()),
        "beyond_3": int((np.abs(score) > 3).sum()),
        "beyond_4": int((np.abs(score) > 4).sum()),
        "faint": faint,
        "by_order": {name: {"traced": traced_order[k], "walked": found.arrived[name].share,
                            "error": found.arrived[name].error} for k, name in enumerate(names)},
        "unlisted": [{"label": one.label, "path": one.path, "share": one.share, "error": one.error}
                     for one in unlisted[:10]],
        "unlisted_paths": len(unlisted),
        "unlisted_share": sum(one.share for one in unlisted),
    }  # fmt: skip


def irradiance(system: OpticalSystem, paths: tuple[Path, ...], rays: int, seed: int) -> dict[str, Any]:
    """Nominal and stray irradiance at the field points and over the zone, W/m² per W through the pupil, both ways."""
    half = float(np.degrees(np.arcsin(np.hypot(*np.sin(np.radians(system.document.entrance.half_field_deg))))))
    found = flux(system, MORE * rays, seed, lambertian(half), split=COARSE, cells=(CELLS, CELLS))
    rows: list[dict[str, Any]] = []
    for x0 in system.field_points():
        i, j = (int(np.searchsorted(edges, value)) - 1 for edges, value in ((found.map.y, x0[1]), (found.map.x, x0[0])))
        centre = np.array([found.map.x[j : j + 2].mean(), found.map.y[i : i + 2].mean()])
        start = nominal_direction(system, paths[0], centre)
        seen = {0: 0.0, 1: 0.0, 2: 0.0}
        for path in paths:
            if path.estimate > FAINTEST:
                try:
                    beam = rays_to_point(system, path, centre, np.array([system.sigma0]), start)
                    seen[path.order] += beam.power()[0] * found.radiance
                except EmptyBeamError:
                    continue
        stray, whole = float(found.map.stray[i, j]), float(found.map.irradiance[i, j])
        error, stray_error = float(found.map.error[i, j]), float(found.map.stray_error[i, j])
        rows.append({
            "x_m": centre.tolist(), "nominal_traced": seen[0], "nominal_walked": whole - stray, "nominal_error": error,
            "score": (whole - stray - seen[0]) / error, "stray_traced": seen[1] + seen[2], "stray_walked": stray,
            "stray_error": stray_error, "ratio_stray": stray / (seen[1] + seen[2]),
        })  # fmt: skip
    x0, x1, y0, y1 = system.zone()
    inside = np.outer((found.map.y[:-1] >= y0) & (found.map.y[1:] <= y1),
                      (found.map.x[:-1] >= x0) & (found.map.x[1:] <= x1))  # fmt: skip
    cells = int(inside.sum())
    walked, walked_stray = found.map.irradiance - found.map.stray, found.map.stray
    zone = {
        "cells": cells,
        "nominal_traced": float(np.mean([row["nominal_traced"] for row in rows])),
        "nominal_spread": float(np.std([row["nominal_traced"] for row in rows])),
        "nominal_walked": float(walked[inside].mean()),
        "nominal_error": float(np.sqrt((found.map.error[inside] ** 2).sum()) / cells),
        "stray_traced": float(np.mean([row["stray_traced"] for row in rows])),
        "stray_spread": float(np.std([row["stray_traced"] for row in rows])),
        "stray_walked": float(walked_stray[inside].mean()),
        "stray_error": float(np.sqrt((found.map.stray_error[inside] ** 2).sum()) / cells),
    }
    return {"source": found.source, "rays": found.rays, "cell_m": float(found.map.x[1] - found.map.x[0]),
            "points": rows, "zone": zone, "ledger": ledger(found)}  # fmt: skip


def study(instrument: str | None, band: str, rays: int, seed: int) -> dict[str, Any]:
    """Everything for one band as plain data."""
    system = load_instrument(instrument).band(band)
    paths = find_paths(system)
    flux(system, 10)  # compiled before the clock starts
    start = time.perf_counter()
    found = flux(system, rays, seed, from_field(system), kept=10_000)
    seconds = time.perf_counter() - start
    return {
        "band": band, "rays": rays, "seed": seed, "ledger": ledger(found), "powers": powers(system, paths, found),
        "irradiance": irradiance(system, paths, rays, seed), "events_per_s": found.events / seconds,
    }  # fmt: skip


def main() -> None:
    """Print the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instrument")
    parser.add_argument("--band", default="NIR")
    parser.add_argument("--rays", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    options = parser.parse_args()
    result = study(options.instrument, options.band, options.rays, options.seed)
    if options.json:
        print(to_json(result))
        return
    book, power = result["ledger"], result["powers"]
    print(f"{result['band']}, {result['rays']} rays over the declared field, seed {result['seed']}")
    print("  " + ", ".join(f"{name} {value:.6f}" for name, value in book["sums"].items()))
    print(f"  input less their sum: {book['imbalance']} units of 2^-50 of a ray; {book['events']} surfaces met")
    print(f"power of {power['compared']} of {power['of']} paths, by lots and in sequence")
    print(f"  mean square of the difference over its standard error {power['mean_square_score']:.2f}; "
          f"beyond 3: {power['beyond_3']}, beyond 4: {power['beyond_4']}")  # fmt: skip
    for name, one in power["by_order"].items():
        print(f"  {name:8} traced {one['traced']:.6e}  walked {one['walked']:.6e} ± {one['error']:.1e}")
    for row in power["worst"]:
        print(f"  {row['score']:+5.1f}  traced {row['traced']:.4e}  walked {row['walked']:.4e}  {row['label']}")
    faint = power["faint"]
    print(f"  {faint['paths']} faint ones together: traced {faint['traced']:.3e}  walked {faint['walked']:.3e} "
          f"± {faint['error']:.1e}")  # fmt: skip
    print(
        f"  up to second order and not in the list: {power['unlisted_paths']}, together {power['unlisted_share']:.1e}"
    )
    for one in power["unlisted"][:4]:
        print(f"    {one['share']:.1e} ± {one['error']:.1e}  {one['label']}")
    light = result["irradiance"]
    print(f"irradiance, {light['source']}, cells of {light['cell_m'] * 1e6:.0f} um, per W through the pupil")
    for row in light["points"]:
        x, y = (1e3 * value for value in row["x_m"])
        print(f"  ({x:+.2f}, {y:+.2f}) mm nominal traced {row['nominal_traced']:.1f} walked {row['nominal_walked']:.1f}"
              f" ± {row['nominal_error']:.1f} ({row['score']:+.1f})")  # fmt: skip
        print(f"  {'':18} stray traced {row['stray_traced']:.2f} walked {row['stray_walked']:.2f}"
              f" ± {row['stray_error']:.2f}")  # fmt: skip
    zone = light["zone"]
    print(f"  mean of {zone['cells']} cells of the zone, beside the mean and spread of the field points")
    for kind in ("nominal", "stray"):
        print(f"  {kind:8} walked {zone[kind + '_walked']:.2f} ± {zone[kind + '_error']:.2f}"
              f"  traced {zone[kind + '_traced']:.2f}, spread {zone[kind + '_spread']:.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
