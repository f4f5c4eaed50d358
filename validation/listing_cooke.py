"""Zemax's published ghost-focus listing of its Cooke triplet, ghost 2 then 1, line by line.

Figures from the listing printed in "How do I account for energy losses when performing a sequential ghost analysis?",
Zemax knowledge base, 24 June 2008 (www.zemax.com/kb/articles/249). It prints this one ghost in full; no other ghost of
the lens has been found in print.

Two things had to be found out. The listing's RMS is taken from three rings of rays by Gauss's rule (more rings move
one figure by 8 units of its last digit), and its chief ray passes the stop where it meets it on the ghost's own way.
What remains are F-numbers of seven digits, off by 1e-6: an index of the crown lower by 1e-6 than Schott's formula gives
today accounts for them, which ``fitted`` shows.
"""

from __future__ import annotations

import copy
from pathlib import Path as File
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from cgi_wave.optics.system import OpticalSystem, from_document, load_instrument
from cgi_wave.rays.paths import parse_path
from cgi_wave.rays.trace import compile_sequence, trace, trace_with_derivatives

#: Surface, marginal height mm, F-number behind it, RMS mm of the rays there (0: could not be computed).
ROWS = (
    ("S1", 5.0, 5.737068, 3.5355),
    ("S2", 4.7160, 4.595701, 3.3570),
    ("S1", 4.3614, 0.990012, 3.1277),
    ("S2", 2.7155, 0.607262, 1.9876),
    ("S3", -2.2309, 0.916280, 2.6065),
    ("S4", -2.7766, 0.514753, 0.0),
    ("S5", -7.3909, 0.888038, 0.0),
    ("S6", -9.0530, 0.823473, 0.0),
    ("image", -34.681, 0.823473, 0.0),
)
TOTALS = {"marginal": -34.6809, "chief": -24.8107, "pupil": -50.9613, "focus": -57.1176, "efl": 8.2347}
LENS = File(__file__).parents[1] / "tests" / "data" / "cooke_triplet.toml"
GHOST = "S1 S2:r S1:r S2 S3 S4 S5 S6"
#: Marginal ray at the entrance pupil's rim, and the field's edge.
RADIUS, FIELD = 5e-3, np.tan(np.radians(20.0))
#: The stop of the lens is the second face of its second element; rings of rays behind the listing's RMS.
STOP, RINGS = "S4", 3


def _digits(value: float, shown: float, last: float) -> dict[str, float]:
    return {"ours": float(value), "printed": shown, "units_of_last_digit": float((value - shown) / last)}


def compare(system: OpticalSystem) -> list[dict[str, Any]]:
    """Each printed figure beside ours, the difference in units of its last digit."""
    sequence = compile_sequence(system, parse_path(system, GHOST), system.sigma0)
    origin = np.zeros((1, 2))
    rows: list[dict[str, Any]] = []
    # Rays even over the pupil, by Gauss's rule in the square of the radius: RMS of what is round.
    node, weight = np.polynomial.legendre.leggauss(RINGS)
    p = RADIUS * np.column_stack([np.sqrt((1 + node) / 2), np.zeros(RINGS)])
    feet = trace(sequence, p, np.zeros(2), footprints=True)
    for k, (name, height, f_number, rms) in enumerate(ROWS):
        part = trace_with_derivatives(sequence.upto(k + 1), origin, np.zeros(2), "p")
        y, slope = part.dx[0][0, 0] * RADIUS, part.dq[0][0, 0] * RADIUS
        rows.append({"figure": f"{k + 1} {name}: marginal height", **_digits(y * 1e3, height, 1e-4 if k < 8 else 1e-3)})
        rows.append({"figure": f"{k + 1} {name}: F-number", **_digits(1 / (2 * abs(slope)), f_number, 1e-6)})
        if rms:
            found = float(np.sqrt(weight @ (feet.foot[k] ** 2).sum(axis=0) / 2)) * 1e3
            rows.append({"figure": f"{k + 1} {name}: RMS of rays", **_digits(found, rms, 1e-4)})
    names = [name for name, _ in parse_path(system, GHOST).steps]
    stop = trace_with_derivatives(sequence.upto(names.index(STOP) + 1), origin, np.zeros(2), "both")
    centre = -stop.dx[0][0, 0] / stop.dx[0][0, 2] * FIELD  # where the chief ray meets the plane of our pupil
    end = trace_with_derivatives(sequence, origin, np.zeros(2), "both")
    (x_t, _, x_p, _), (q_t, _, q_p, _) = end.dx[0][0], end.dq[0][0]
    height, slope = x_t * FIELD + x_p * centre, q_t * FIELD + q_p * centre
    rows.append({"figure": "marginal height at the image", **_digits(x_p * RADIUS * 1e3, TOTALS["marginal"], 1e-4)})
    rows.append({"figure": "chief height at the image", **_digits(height * 1e3, TOTALS["chief"], 1e-4)})
    rows.append({"figure": "distance to ghost pupil", **_digits(-height / slope * 1e3, TOTALS["pupil"], 1e-4)})
    rows.append({"figure": "distance to ghost focus", **_digits(-x_p / q_p * 1e3, TOTALS["focus"], 1e-4)})
    rows.append({"figure": "effective focal length", **_digits(abs(1 / q_p) * 1e3, TOTALS["efl"], 1e-4)})
    return rows


def with_indices(crown: float, flint: float) -> OpticalSystem:
    """The lens with its two indices changed by so much."""
    raw = copy.deepcopy(load_instrument(LENS).raw)
    raw["glass"]["SK16"] += float(crown)
    raw["glass"]["F2"] += float(flint)
    instrument = from_document(raw)
    return instrument.band(instrument.bands[0])


def fitted() -> dict[str, Any]:
    """The two changes of index that fit the printed figures best, and the figures with them."""

    def misfit(shift: np.ndarray) -> np.ndarray:
        rows = compare(with_indices(*(shift * 1e-6)))
        return np.array([row["units_of_last_digit"] for row in rows])

    found = least_squares(misfit, np.zeros(2), diff_step=0.1)
    return {
        "shift": {"SK16": float(found.x[0]) * 1e-6, "F2": float(found.x[1]) * 1e-6},
        "rows": compare(with_indices(*(found.x * 1e-6))),
    }


def study() -> dict[str, Any]:
    """Every printed figure beside ours, with the indices of the stored lens and with those that fit best."""
    rows, fit = compare(with_indices(0.0, 0.0)), fitted()

    def worst(some: list[dict[str, Any]]) -> float:
        return max(abs(row["units_of_last_digit"]) for row in some)

    return {"figures": len(rows), "worst_units": worst(rows), "rows": rows, "index_shift": fit["shift"],
            "worst_units_fitted": worst(fit["rows"]),
            "f_numbers_apart_worst_units": worst([row for row in rows if "F-number" not in row["figure"]])}  # fmt: skip
