"""The ghost table: one row per ghost path, with what every field point says of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cgi_wave.budget.fieldpoint import FieldPoint
from cgi_wave.budget.pointsource import PointSource
from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.coherency import Pair
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import Path


def ghost_rows(system: OpticalSystem, fields: Sequence[tuple[FieldPoint, PointSource]]) -> list[dict[str, Any]]:
    """Rows of the ghost table, strongest first; None where a quantity does not exist.

    ``path`` is what ``rays.paths.parse_path`` takes back, ``label`` its short name. ``transmission``: power relative to
    the nominal beams together at a fixed detector point under a uniform scene, mean over the field points (a point that
    the ghost does not reach counts 0). The point-source columns (RMS sizes, Eq. 4, contrast |γ| with the nominal beam
    of arm 1, its bound and method) and ``opd_m``, ``opd_arm2_m`` (phase OPD to the nominal beams), ``slope`` and
    ``fringes`` in the zone are those of the first field point that the ghost reaches. ``slope_count``: the paper's
    count of sloped surfaces crossed. ``…_fields``, ``…_fields_m``: one value per field point.
    """
    labels = [path for path in fields[0][1].ghosts]
    rows = [_row(system, number, ghost.path, fields) for number, ghost in enumerate(labels)]
    return sorted((row for row in rows if row["transmission"] > 0), key=lambda row: -row["transmission"])


def families(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Power, relative to the nominal beams, of all ghosts of the table with the same parasitic history, by its name."""
    power: dict[str, float] = {}
    for row in rows:
        name = row["label"].partition(" arms ")[0].partition(" #")[0]
        power[name] = power.get(name, 0.0) + row["transmission"]
    return power


def _row(
    system: OpticalSystem, number: int, path: Path, fields: Sequence[tuple[FieldPoint, PointSource]]
) -> dict[str, Any]:
    power = [_power(point, path.label) for point, _ in fields]
    points = [source.ghosts[number] for _, source in fields]
    chosen = next((ghost for ghost in points if ghost.contrast is not None), points[0])
    geometries = [
        _geometry(system, point, path) if p > 0 else dict.fromkeys(GEOMETRY)
        for (point, _), p in zip(fields, power, strict=True)
    ]
    geometry = next((g for g, p in zip(geometries, power, strict=True) if p > 0), geometries[0])
    spots = [ghost.spot for ghost in points]
    return {
        "label": path.label,
        "path": str(path),
        "order": path.order,
        "ancestry": path.splits,
        "transmission": float(np.mean(power)),
        "rms_x_m": None if chosen.spot is None else float(chosen.spot.rms[0]),
        "rms_y_m": None if chosen.spot is None else float(chosen.spot.rms[1]),
        "centroid_x_m": None if chosen.spot is None else float(chosen.spot.centroid[0]),
        "centroid_y_m": None if chosen.spot is None else float(chosen.spot.centroid[1]),
        "contrast_eq4": chosen.eq4,
        "contrast": chosen.contrast,
        "contrast_error": chosen.error,
        "method": chosen.method,
        **geometry,
        "transmission_fields": power,
        "contrast_fields": [ghost.contrast for ghost in points],
        "contrast_error_fields": [ghost.error for ghost in points],
        "contrast_eq4_fields": [ghost.eq4 for ghost in points],
        "rms_x_fields_m": [None if spot is None else float(spot.rms[0]) for spot in spots],
        "rms_y_fields_m": [None if spot is None else float(spot.rms[1]) for spot in spots],
        "centroid_x_fields_m": [None if spot is None else float(spot.centroid[0]) for spot in spots],
        "centroid_y_fields_m": [None if spot is None else float(spot.centroid[1]) for spot in spots],
        "opd_fields_m": [g["opd_m"] for g in geometries],
        "opd_arm2_fields_m": [g["opd_arm2_m"] for g in geometries],
        "slope_fields": [g["slope"] for g in geometries],
    }


def _power(point: FieldPoint, label: str) -> float:
    """Power relative to t1 + t2 at one field point; 0 where the ghost does not arrive."""
    t = point.coherency.transmission
    return float(t[point.coherency.labels.index(label)] / (t[0] + t[1])) if label in point.coherency.labels else 0.0


GEOMETRY = ("opd_m", "opd_arm2_m", "slope", "slope_count", "fringes", "contrast_uniform", "contrast_uniform_error")


def _geometry(system: OpticalSystem, point: FieldPoint, path: Path) -> dict[str, float | None]:
    """OPD, slope and fringes against the nominal beams, and |J| under a uniform scene (None: bounded, not computed)."""
    number = point.coherency.labels.index(path.label)
    ghost, arm1, arm2 = (point.sheets[k] for k in (number, 0, 1))
    slope = float(np.mean(ghost.y_at(ghost.p) - arm1.y_at(ghost.p)))
    nominal = float(np.mean(arm1.y_at(ghost.p) - arm2.y_at(ghost.p)))
    middle_point = ghost.p[[int(np.argmin(((ghost.p - ghost.p.mean(axis=0)) ** 2).sum(axis=1)))]]
    length = float(ghost.opl_at(middle_point)[0])
    _, _, y0, y1 = system.zone()
    pair = next((pair for pair in point.coherency.pairs if (pair.m, pair.l) in ((0, number), (number, 0))), None)
    return {
        "opd_m": length - float(arm1.opl_at(middle_point)[0]),
        "opd_arm2_m": length - float(arm2.opl_at(middle_point)[0]),
        "slope": slope,
        "slope_count": count_slope(system, point.paths[0], point.paths[1], path, nominal),
        "fringes": abs(slope) * (y1 - y0) * system.sigma0,
        "contrast_uniform": None if pair is None else abs(_at_centre(pair, system.sigma0)),
        "contrast_uniform_error": None if pair is None else float(pair.error.max()),
    }


def _at_centre(pair: Pair, sigma0: float) -> complex:
    """γ of a pair at the filter's centre, between its Chebyshev nodes."""
    return complex((chebyshev.interpolation_matrix(pair.sigma, np.array([sigma0])) @ pair.gamma)[0])


def count_slope(system: OpticalSystem, arm1: Path, arm2: Path, path: Path, nominal_slope: float) -> float | None:
    """dOPD/dy of ``path`` against the nominal beam of arm 1, by the paper's count of sloped surfaces met.

    nominal_slope: dOPD/dy of arm 1 minus arm 2, to which the difference of their counts belongs.
    """
    inter = system.document.interferometer
    if inter is None:
        return None
    sloped = {*inter.arm1.sloped, *inter.arm2.sloped}
    met, met1, met2 = (sum(name in sloped for name, _ in p.steps) for p in (path, arm1, arm2))
    return None if met1 == met2 else nominal_slope * (met - met1) / (met1 - met2)
