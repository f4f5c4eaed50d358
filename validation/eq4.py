"""Eq. 4, a ratio of RMS spot sizes, beside |γ|: where it holds, where not and why, and a better estimate.

    uv run python validation/eq4.py [--json] [--out DIR] [--bands NIR VIS] [--pairs N] [--seconds S]

Three parts. Charts of |γ|/Eq. 4 for two circular pupils over defocus (0 to 2000 waves) and aberration of the nominal
beam, for several astigmatisms, shears and tilts. Every ghost of every band of the reference instrument, from the
zone's centre: |γ| of traced fields with its bound, Eq. 4, the overlap with diffraction and without phase (where it is
expected to take at most ``--seconds`` a ghost), the overlap of the geometric spots. And the closed-form estimate
``contrast_stationary`` on random pairs and on the same ghosts. ``--bands`` without a name leaves the ghosts out.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE)]

import numpy as np  # noqa: E402
from eq4_ghosts import band, ghost_rows  # noqa: E402
from eq4_plane import (  # noqa: E402
    CAUSES,
    KNOWN,
    WITHIN,
    Panel,
    known,
    panels,
    ratios,
    summary,
    trial_rows,
    trials,
)
from study_page import save_figure, table, write_page  # noqa: E402

Row = dict[str, Any]

WHY = """Both sides are laws of the size of the ghost: Eq. 4 divides the nominal beam's RMS spot by the ghost's, |γ|
divides the width w = λ/(2π NA) of a diffraction spot by the RMS difference of the two beams' rays. They fall with
defocus alike, and their ratio is about w over the nominal RMS:

- **Near focus** the nominal RMS is below w: Eq. 4 is too small, without limit for a perfect nominal beam.
- **An aberrated nominal spot** counts in Eq. 4 as room for the ghost; in |γ| it counts only as far as the ghost
  does not share it. Eq. 4 is too large by RMS/w.
- **Oscillation**: for defocus alone |γ| is a sinc, zero at whole waves; Eq. 4 has no phase. Astigmatism or shear
  of a few tenths of a wave fills the zeros.
- **Spots apart**: at equal RMS, tilt (or shear beyond the other pupil) leaves no direction in which both beams send
  light to one point; |γ| falls far below both laws. Eq. 4 does not see where the spots lie.
- **Spots cut** by the detector or an aperture on the way: what is left has a smaller RMS, so that Eq. 4 rises;
  |γ| keeps, and by its smaller power may gain, if the shared directions are in what is left, else it vanishes.
"""


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
    # One figure each over pairs in the estimate's range, and over all ghosts.
    for of in ("eq4", "estimate", "from_spots"):
        part = [row for row in random if row["of"] == of and row["range"] != "all"]
        weight = np.array([row["count"] for row in part], float)
        for figure in ("within_30_percent", "within_2", "off_by_3"):
            found[f"{of}_{figure}"] = float(np.array([row[figure] for row in part], float) @ weight / weight.sum())
    if out is not None:
        _page(out, charts, found)
    return found


def _chart(chart: Panel) -> Row:
    pairs = known(chart.found)
    return {"chart": chart.name, **summary(ratios(pairs)), "bound": max(c.bound for c in pairs)}


def usable(rows: Sequence[Row]) -> list[Row]:
    """Ghosts whose |γ| is known to a tenth."""
    return [row for row in rows if row["gamma"] and row["bound"] <= KNOWN * row["gamma"] and row["estimate"]]


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


def band_table(found: dict[str, Any]) -> list[Row]:
    """A row per band and estimate."""
    rows = []
    for name, figures in found["bands"].items():
        eq4 = {key: figures[key] for key in figures["estimate"]}
        parts = {"Eq. 4": eq4, "estimate, all": figures["estimate"]}
        parts |= {"estimate, spots together": figures["estimate_in_range"]}
        parts |= {"estimate from spots, together": figures["from_spots_in_range"]}
        parts |= {"incoherent overlap": figures["incoherent"], "geometric spots": figures["spots"]}
        rows += [{"band": name, "|γ| over": of, **part} for of, part in parts.items()]
    return rows


def _page(out: Path, charts: Sequence[Panel], found: dict[str, Any]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    plane = found["plane"]
    parts = [
        "# Eq. 4 beside |γ|\n",
        WHY,
        "## Over defocus and nominal aberration\n",
        f"{plane['count']} pairs, {plane['not_known']} more with |γ| not known to a tenth or a ghost that is a point. "
        f"The largest error bound is {plane['bound']:.2g}. The ghost carries the nominal beam's aberration and defocus "
        "of its own; tilt is in units of what brings the nominal spot to the ghost's rim. Lines at 0.1, 0.9, 1.1 and "
        "10; dashes: RMS of the nominal spot = w.\n",
        _charts(out, charts),
        table(plane["charts"]),
        table(plane["causes"]),
        "## Ghosts of the reference instrument\n",
        table(band_table(found)) if found["bands"] else "not asked for\n",
    ]
    for name, figures in found["bands"].items():
        rows = [row for row in found["ghosts"] if row["band"] == name]
        parts += [
            f"### {name}\n",
            f"{figures['ghosts']} ghosts, {figures['without_gamma']} without a |γ|, {figures['not_known']} known to "
            f"less than a tenth; incoherent overlap left out for {figures['incoherent_left_out']}.\n",
            _scatter(out, name, rows),
            table(figures["causes"]),
            table(sorted(rows, key=lambda row: -(row["gamma"] or 0.0))),
        ]
    parts += ["## The estimate on random pairs\n", table(found["random"])]
    write_page(out, "eq4", parts)


def _charts(out: Path, charts: Sequence[Panel]) -> str:
    import matplotlib.pyplot as plt

    across = 3
    down = -(-len(charts) // across)
    figure, axes = plt.subplots(down, across, figsize=(4.6 * across, 3.2 * down), sharex=True, sharey=True)
    mesh = None
    for ax, chart in zip(np.ravel(axes), charts, strict=False):
        # Defocus 0 is shown at half of the least that is not.
        x = np.where(chart.defocus > 0.0, chart.defocus, 0.5 * chart.defocus[1])
        shown = np.log10(chart.ratio)
        mesh = ax.pcolormesh(x, chart.aberration, shown, cmap="RdBu", vmin=-2.0, vmax=2.0, shading="nearest")
        levels, colours = np.log10([0.1, 0.9, 1.1, 10.0]), ["darkred", "k", "k", "darkblue"]
        ax.contour(x, chart.aberration, shown, levels=levels, colors=colours, linewidths=0.8, linestyles="-")
        ax.axhline(diffraction_aberration(), color="k", ls="--", lw=0.8)
        ax.set(xscale="log", yscale="log")
        ax.set_title(chart.name, fontsize=8)
    for ax in np.atleast_2d(axes)[-1]:
        ax.set_xlabel("defocus / waves")
    for ax in np.atleast_2d(axes)[:, 0]:
        ax.set_ylabel("nominal W040 / waves")
    if mesh is not None:
        figure.colorbar(mesh, ax=axes, label="log₁₀ |γ| / Eq. 4", shrink=0.5)
    return save_figure(figure, out, "eq4-charts")


def diffraction_aberration() -> float:
    """Waves of W040 at its best focus whose RMS spot along an axis is the diffraction width λ/(2π NA).

    Slopes 4 W (r³ − 2r/3): their mean square over the disc is 16 W² (1/4 − 4/9 + 2/9), half of it along each axis.
    """
    return float(1.0 / (2.0 * np.pi * np.sqrt(16.0 * (1.0 / 4.0 - 4.0 / 9.0 + 2.0 / 9.0) / 2.0)))


def _scatter(out: Path, name: str, rows: Sequence[Row]) -> str:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(14, 4.4), sharey=True)
    good = usable(rows)
    labels = {
        "eq4": "Eq. 4",
        "estimate": "estimate from the difference of the beams",
        "incoherent": "incoherent overlap",
    }
    for ax, (of, label) in zip(axes, labels.items(), strict=True):
        for why in dict.fromkeys(row["cause"] for row in good):
            part = [row for row in good if row["cause"] == why and row[of]]
            ax.loglog([row[of] for row in part], [row["gamma"] for row in part], "o", ms=3, label=why)
        line = np.array([1e-4, 1.0])
        for factor, style in ((1.0, "k-"), (0.1, "k:"), (10.0, "k:")):
            ax.loglog(line, factor * line, style, lw=0.7)
        ax.set(xlabel=label, xlim=(1e-4, 1.5), ylim=(1e-5, 1.5))
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("|γ|")
    axes[0].legend(fontsize=6)
    figure.suptitle(f"{name}: ghosts beside the nominal beam of arm 1", fontsize=9)
    return save_figure(figure, out, f"eq4-{name.lower()}")


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
        print(json.dumps(found, indent=1))
        return
    plane = found["plane"]
    print(table(plane["charts"]))
    print(table(plane["causes"]))
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
