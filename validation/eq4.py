"""Eq. 4, a ratio of RMS spot sizes, beside |γ|: where it holds, where not and why, and a better estimate.

    uv run python -m validation.eq4 [--json] [--out DIR] [--bands NIR VIS] [--pairs N] [--seconds S]

Three parts. Charts of |γ|/Eq. 4 for two circular pupils over defocus (0 to 2000 waves) and aberration of the nominal
beam, for several astigmatisms, shears and tilts. Every ghost of every band of the reference instrument, from the
zone's centre: |γ| of traced fields with its bound, Eq. 4, the overlap with diffraction and without phase (where it is
expected to take at most ``--seconds`` a ghost), the overlap of the geometric spots. And the closed-form estimate
``contrast_stationary`` on random pairs and on the same ghosts. ``--bands`` without a name leaves the ghosts out.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cgi_wave.report.output import to_json
from validation.eq4_ghosts import band, ghost_rows
from validation.eq4_page import band_table, plane_table, usable, write
from validation.eq4_plane import (
    CAUSES,
    WITHIN,
    Panel,
    known,
    panels,
    ratios,
    summary,
    trial_rows,
    trials,
)
from validation.study_page import table

Row = dict[str, Any]


def study(
    out: Path | None = None,
    bands: Sequence[str] | None = None,
    pairs: int = 2000,
    seconds: float = 3.0,
    points: int = 56,
    levels: int = 18,
    progress: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """All figures of the study; writes ``out/eq4.md`` and its plots where ``out`` is given.

    bands: all of the reference instrument unless named; pairs: random ones of each kind; seconds: for the incoherent
    overlap of one ghost; points, levels: of the charts along defocus and nominal aberration.
    """
    if bands is None:
        from cgi_wave.analysis import list_bands

        bands = list_bands()
    progress("charts")
    charts = panels(points, levels)
    progress("random pairs")
    random = trial_rows(trials(pairs))
    ghosts = {name: ghost_rows(band(name), seconds, progress) for name in bands}
    every = known([c for chart in charts for c in chart.found])
    found: dict[str, Any] = {
        "plane": {
            **summary(ratios(every)),
            "bound": max(c.bound for c in every),
            "estimate": summary(ratios([c for c in every if c.apart <= WITHIN], "estimate")),
            "from_spots": summary(ratios([c for c in every if c.apart <= WITHIN], "from_spots")),
            "not_known": sum(len(chart.found) for chart in charts) - len(every),
            "charts": [_chart(chart) for chart in charts],
            "causes": [
                {"cause": why, **summary(ratios([c for c in every if c.cause == why]))}
                for why in CAUSES
                if any(c.cause == why for c in every)
            ],
        },
        "random": random,
        "bands": {name: band_figures(rows) for name, rows in ghosts.items()},
        "ghosts": [row for rows in ghosts.values() for row in rows],
    }
    # One figure each over pairs in the estimate's range, and over those of them without a caustic.
    for name, reach in (("", "spots together"), ("_no_caustic", "and no caustic")):
        for of in dict.fromkeys(row["of"] for row in random if row["range"] == reach):
            part = [row for row in random if row["of"] == of and row["range"] == reach and row["count"]]
            weight = np.array([row["count"] for row in part], float)
            for figure in ("within_30_percent", "within_2", "off_by_3"):
                share = np.array([row[figure] for row in part], float) @ weight / max(weight.sum(), 1.0)
                found[f"{of}{name}_{figure}"] = float(share)
    if out is not None:
        write(out, charts, found)
    return found


def _chart(chart: Panel) -> Row:
    pairs = known(chart.found)
    return {"chart": chart.name, **summary(ratios(pairs)), "bound": max(c.bound for c in pairs)}


def band_figures(rows: Sequence[Row]) -> dict[str, Any]:
    """Shares and quantiles of the ghosts of one band."""
    good = usable(rows)

    def over(of: str, part: Sequence[Row]) -> dict[str, Any]:
        return summary(np.array([row["gamma"] / row[of] for row in part if row[of]]))

    computed = [row for row in rows if row["gamma"] is not None]
    near = [row for row in good if row["apart"] <= WITHIN]
    loose = over("incoherent", good)
    return {
        **over("eq4", good),
        "ghosts": len(rows),
        "without_gamma": len(rows) - len(computed),
        "not_known": len(computed) - len(good),
        "bound": max(row["bound"] for row in good) if good else None,
        "bound_over_gamma_median": float(np.median([row["bound"] / row["gamma"] for row in good])) if good else None,
        "estimate": over("estimate", good),
        "estimate_in_range": over("estimate", near),
        "from_spots_in_range": over("from_spots", near),
        "estimate_within_30_percent": over("estimate", near)["within_30_percent"],
        "estimate_within_2": over("estimate", near)["within_2"],
        "estimate_median_ratio": over("estimate", near)["median_ratio"],
        "incoherent": loose,
        "spots": over("spots", good),
        "eq4_over_incoherent_median": _median([r["eq4"] / r["incoherent"] for r in good if r["incoherent"]]),
        "spots_over_eq4_median": _median([r["spots"] / r["eq4"] for r in good if r["spots"]]),
        "incoherent_left_out": sum(row["incoherent"] is None for row in good),
        "cut_by_detector": over("eq4", [row for row in good if row["cut"]]),
        "cut_by_detector_estimate": over("estimate", [row for row in good if row["cut"]]),
        "causes": [
            {"cause": why, **over("eq4", [row for row in good if row["cause"] == why])}
            for why in dict.fromkeys(row["cause"] for row in good)
        ],
    }


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def main() -> None:
    """Print the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.add_argument("--out", type=Path, help="folder for the page and its plots")
    parser.add_argument("--bands", nargs="*", help="bands of the reference instrument; all unless named")
    parser.add_argument("--pairs", type=int, default=2000, help="random pairs of each kind")
    parser.add_argument("--seconds", type=float, default=3.0, help="for the incoherent overlap of one ghost")
    options = parser.parse_args()
    found = study(
        options.out, options.bands, options.pairs, options.seconds, progress=lambda text: print(text, file=sys.stderr)
    )
    if options.json:
        print(to_json(found))
        return
    plane = found["plane"]
    print(table(plane["charts"]))
    print(table(plane["causes"]))
    print(table(plane_table(plane)))
    print(table(band_table(found)))
    for name, figures in found["bands"].items():
        print(name, {key: value for key, value in figures.items() if not isinstance(value, dict | list)})
        print(table(figures["causes"]))
    print(table(found["random"]))
    for key, value in found.items():
        if isinstance(value, float):
            print(f"{key}: {value:.4g}")


if __name__ == "__main__":
    main()
