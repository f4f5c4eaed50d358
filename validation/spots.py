"""The instrument's nominal spots beside batoid: the check that every import of an instrument gets.

    uv run --group validation python -m validation.spots [--instrument FILE] [--json]

For every band, at its central wavelength, for its five field points and every nominal path: the same rays from one
source direction, traced by both programs from the same surfaces, indices and rays. Prints both RMS radii about the
centroid and the largest difference of any ray on the detector.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.beams import nominal_direction
from cgi_wave.rays.paths import find_paths
from cgi_wave.rays.trace import compile_sequence, trace
from cgi_wave.report.output import to_json
from validation.rays import as_traced, batoid_tracer, pupil_points

Array = NDArray[np.float64]


def rms_radius(x: Array) -> float:
    """Radial RMS (m) of points (N, 2) about their centroid."""
    return float(np.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean()))


def study(instrument: str | None = None, bands: tuple[str, ...] = (), count: int = 1000) -> dict[str, Any]:
    """Spots of ``bands`` (all if none is named) of an instrument file (None: the reference), with ``count`` rays each.

    Returns ``rows`` (band, wavelength_m, field point x0_m (2), path number, rays that pass, rms_m, batoid_rms_m, and
    x_m, the largest difference of a ray on the detector) and the largest differences, ``rms_m`` and ``x_m``.
    """
    loaded = load_instrument(instrument)
    rows = []
    for band in bands or loaded.bands:
        system = loaded.band(band)
        p = pupil_points(0.999 * system.pupil_radius, count)
        for number, path in enumerate(find_paths(system, 0, 0), 1):
            sequence, (launch, run) = compile_sequence(system, path, system.sigma0), batoid_tracer(system, str(path))
            for x0 in system.field_points():
                theta = nominal_direction(system, path, x0)
                own = trace(sequence, p, theta)
                x = as_traced(run(launch(p, theta)))[0]
                ok = own.passes
                rows.append({
                    "band": band, "wavelength_m": 1 / system.sigma0, "x0_m": x0.tolist(), "path": number,
                    "rays": int(ok.sum()), "rms_m": rms_radius(own.x[ok]), "batoid_rms_m": rms_radius(x[ok]),
                    "x_m": float(np.abs(own.x - x)[ok].max()),
                })  # fmt: skip
    apart = max(abs(row["rms_m"] - row["batoid_rms_m"]) for row in rows)
    return {"rays": count, "rows": rows, "rms_m": apart, "x_m": max(row["x_m"] for row in rows)}


def main(arguments: list[str] | None = None) -> None:
    """Run the study and print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instrument", help="instrument file (default: the reference)")
    parser.add_argument("--json", action="store_true", help="one JSON document and nothing else")
    options = parser.parse_args(arguments)
    found = study(options.instrument)
    if options.json:
        print(to_json(found))
        return
    print("band        wavelength / nm   field x, y / mm    path   rays   RMS / um   batoid's / um")
    for row in found["rows"]:
        x, y = (1e3 * value for value in row["x0_m"])
        print(f"{row['band']:<12}{row['wavelength_m'] * 1e9:>15.2f}{x:>10.3f}{y:>8.3f}{row['path']:>8}"
              f"{row['rays']:>7}{row['rms_m'] * 1e6:>11.4f}{row['batoid_rms_m'] * 1e6:>16.4f}")  # fmt: skip
    print(f"largest difference of an RMS {found['rms_m']:.1e} m, of a ray on the detector {found['x_m']:.1e} m")


if __name__ == "__main__":
    main()
