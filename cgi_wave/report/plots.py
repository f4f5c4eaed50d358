"""Pictures of results. Each ``plot_*(result, ax=None)`` draws what it is given, computes nothing and returns the Axes.

Arrays come in SI units; axes are labelled in the unit shown on them. Without ``ax`` a new pyplot figure is made.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#1b5e9b", "#c2571a", "#4b7f34", "#7a4a92")
"""By order of the ghost, nominal beams first; chosen to stay apart in grey and for the colour-blind."""

TITLE_WIDTH = 36
"""Letters of a title in one line above a small picture."""

PSF_DECADES = 6
"""How far below its peak a PSF is shown."""


def plot_contrast(ghosts: Sequence[Mapping[str, Any]], ax: Axes | None = None) -> Axes:
    """Overlap contrast of each ghost with its error bar against Eq. 4, both axes logarithmic, with the 1:1 line.

    ghosts : rows with ``contrast_eq4``, ``contrast``, ``contrast_error`` (all dimensionless) and ``order``. Rows whose
    contrast is None or 0 have no place on a logarithmic axis; the legend says how many.
    """
    ax = _axes(ax, (5.2, 4.6))
    shown = [row for row in ghosts if row["contrast"] and row["contrast_eq4"]]
    for order in sorted({row["order"] for row in shown}):
        rows = [row for row in shown if row["order"] == order]
        contrast = np.array([row["contrast"] for row in rows])
        error = np.array([row["contrast_error"] or 0.0 for row in rows])
        ax.errorbar(
            [row["contrast_eq4"] for row in rows],
            contrast,
            # A bar that reaches zero would leave the axis: it stops at a hundredth of the value.
            yerr=np.stack([np.minimum(error, 0.99 * contrast), error]),
            fmt="o",
            markersize=4,
            capsize=2,
            color=COLOURS[order % len(COLOURS)],
            label=f"order {order}",
        )
    ax.set_xscale("log")
    ax.set_yscale("log")
    if shown:
        values = [row[key] for row in shown for key in ("contrast_eq4", "contrast")]
        ends = [0.5 * min(values), 2.0 * max(values)]
        ax.plot(ends, ends, color="0.6", linewidth=1, zorder=0, label="1:1")
    if len(shown) < len(ghosts):
        ax.plot([], [], " ", label=f"{len(ghosts) - len(shown)} without a contrast")
    ax.set_xlabel("contrast by Eq. 4 (RMS spot sizes), dimensionless")
    ax.set_ylabel("overlap contrast |γ|, dimensionless")
    if ghosts:
        ax.legend(frameon=False)
    return ax


def plot_irradiance(spot: Mapping[str, Any], ax: Axes | None = None) -> Axes:
    """Where the rays of one beam land on the detector, linear scale from zero.

    spot : ``label``, ``x_m`` (Nx + 1,) and ``y_m`` (Ny + 1,) bin edges in m, ``irradiance`` (Ny, Nx) ≥ 0, normalised
    as the caller likes and said so in ``unit``.
    """
    ax = _axes(ax, (3.4, 3.0))
    x, y = np.asarray(spot["x_m"]) * 1e3, np.asarray(spot["y_m"]) * 1e3
    mesh = ax.pcolormesh(x, y, spot["irradiance"], cmap="magma", vmin=0.0, rasterized=True)
    ax.figure.colorbar(mesh, ax=ax, label=spot["unit"])
    _square(ax, spot["label"], "mm")
    return ax


def plot_psf(psf: Mapping[str, Any], ax: Axes | None = None) -> Axes:
    """Point spread function on a logarithmic grey scale of ``PSF_DECADES`` decades below its peak.

    psf : ``label``, ``x_m`` (Nx,) and ``y_m`` (Ny,) uniform sample positions in m, ``psf`` (Ny, Nx) ≥ 0.
    """
    from matplotlib.colors import LogNorm

    ax = _axes(ax, (3.4, 3.0))
    values = np.asarray(psf["psf"])
    peak = float(values.max())
    x, y = np.asarray(psf["x_m"]) * 1e6, np.asarray(psf["y_m"]) * 1e6
    norm = LogNorm(vmin=10.0**-PSF_DECADES, vmax=1.0, clip=True)
    mesh = ax.pcolormesh(x, y, values / peak if peak > 0 else values, cmap="magma", norm=norm, shading="nearest")
    mesh.set_rasterized(True)
    ax.figure.colorbar(mesh, ax=ax, label="PSF / peak")
    _square(ax, psf["label"], "µm")
    return ax


def plot_layout(layout: Mapping[str, Any], ax: Axes | None = None) -> Axes:
    """One view of the instrument with rays.

    layout : a view of ``report.layout``: ``title``; ``axes``, the names of the two coordinates shown; ``surfaces``, a
    list of {``name`` or "", ``points_m`` (P, 2)}, each a profile; ``rays``, a list of {``points_m`` (V, 2), ``group``},
    each a polyline, coloured by its group (field point or arm).
    """
    ax = _axes(ax, (11.0, 5.0))
    for ray in layout["rays"]:
        points = np.asarray(ray["points_m"]) * 1e3
        ax.plot(points[:, 0], points[:, 1], color=COLOURS[ray["group"] % len(COLOURS)], linewidth=0.4, alpha=0.8)
    for surface in layout["surfaces"]:
        points = np.asarray(surface["points_m"]) * 1e3
        ax.plot(points[:, 0], points[:, 1], color="black", linewidth=1.1)
        ax.annotate(surface["name"], points[-1], fontsize=6, rotation=40, xytext=(1, 1), textcoords="offset points")
    ax.set_aspect("equal")
    ax.set_xlabel(f"{layout['axes'][0]} / mm")
    ax.set_ylabel(f"{layout['axes'][1]} / mm")
    ax.set_title(layout["title"])
    return ax


def figure(plot: Callable[..., Axes], result: Any, size: tuple[float, float]) -> Figure:
    """A figure of its own, outside pyplot (no window, no global state), with one ``plot`` in it; size in inches."""
    from matplotlib.figure import Figure

    made = Figure(figsize=size, layout="constrained")
    plot(result, ax=made.subplots())
    return made


def grid(
    plot: Callable[..., Axes], results: Sequence[Any], columns: int = 4, cell: tuple[float, float] = (3.5, 3.0)
) -> Figure:
    """One ``plot`` for each of ``results`` in rows of ``columns``, as a figure outside pyplot; cell size in inches."""
    from matplotlib.figure import Figure

    columns = max(1, min(columns, len(results)))
    rows = max(1, -(-len(results) // columns))
    made = Figure(figsize=(cell[0] * columns, cell[1] * rows), layout="constrained")
    places = made.subplots(rows, columns, squeeze=False).flat
    for result, place in zip(results, places, strict=False):
        plot(result, ax=place)
    for place in places:  # the iterator goes on where the results ended
        place.set_axis_off()
    return made


def _axes(ax: Axes | None, size: tuple[float, float]) -> Axes:
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=size, layout="constrained")[1]


def _square(ax: Axes, title: str, unit: str) -> None:
    ax.set_aspect("equal")
    ax.set_xlabel(f"x / {unit}")
    ax.set_ylabel(f"y / {unit}")
    ax.set_title(textwrap.fill(title, TITLE_WIDTH), fontsize=8)
