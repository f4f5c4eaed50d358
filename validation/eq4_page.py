"""Page and plots of the study of Eq. 4. Part of ``eq4``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from validation.eq4_plane import KNOWN, Panel
from validation.study_page import save_figure, table, write_page

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


def usable(rows: Sequence[Row]) -> list[Row]:
    """Ghosts whose |γ| is known to a tenth, and that have an estimate to hold against it."""
    return [row for row in rows if row["gamma"] and row["bound"] <= KNOWN * row["gamma"] and row["estimate"]]


def plane_table(plane: dict[str, Any]) -> list[Row]:
    """A row per estimate over the charts."""
    eq4 = {key: plane[key] for key in plane["estimate"]}
    parts = {"Eq. 4, all": eq4, "estimate, spots together": plane["estimate"]}
    parts |= {"estimate from spots, together": plane["from_spots"]}
    return [{"γ modulus over": of, **part} for of, part in parts.items()]


def band_table(found: dict[str, Any]) -> list[Row]:
    """A row per band and estimate."""
    rows = []
    for name, figures in found["bands"].items():
        eq4 = {key: figures[key] for key in figures["estimate"]}
        parts = {"Eq. 4": eq4, "estimate, all": figures["estimate"]}
        parts |= {"estimate, spots together": figures["estimate_in_range"]}
        parts |= {"estimate from spots, together": figures["from_spots_in_range"]}
        parts |= {"incoherent overlap": figures["incoherent"], "geometric spots": figures["spots"]}
        rows += [{"band": name, "γ modulus over": of, **part} for of, part in parts.items()]
    return rows


def write(out: Path, charts: Sequence[Panel], found: dict[str, Any]) -> None:
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
        "The estimate on the same pairs, spots together; from the spots alone it cannot know that the ghost shares the "
        "nominal beam's aberration:\n",
        table(plane_table(plane)),
        "## Ghosts of the reference instrument\n",
        table(band_table(found)) if found["bands"] else "not asked for\n",
    ]
    for name, figures in found["bands"].items():
        rows = [row for row in found["ghosts"] if row["band"] == name]
        parts += [
            f"### {name}\n",
            f"{figures['ghosts']} ghosts, {figures['without_gamma']} without a |γ|, {figures['not_known']} known to "
            "less than a tenth or without a field for the estimate; incoherent overlap left out for "
            f"{figures['incoherent_left_out']}.\n",
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
