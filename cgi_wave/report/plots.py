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

TITLE_WIDTH = 40
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
    """Irradiance of one beam on the detector, linear scale from zero, in shares of the nominal beam's power per mm².

    spot : ``label``, ``x_m`` (Nx + 1,) and ``y_m`` (Ny + 1,) bin edges in m, ``irradiance`` (Ny, Nx) ≥ 0 in 1/m²,
    ``power`` (its integral) and ``rms_x_m``, ``rms_y_m``.
    """
    from matplotlib.ticker import MaxNLocator

    ax = _axes(ax, (3.4, 3.0))
    x, y = np.asarray(spot["x_m"]) * 1e3, np.asarray(spot["y_m"]) * 1e3
    mesh = ax.pcolormesh(x, y, np.asarray(spot["irradiance"]) * 1e-6, cmap="magma", vmin=0.0, rasterized=True)
    ax.figure.colorbar(mesh, ax=ax, label="power / nominal, per mm²", ticks=MaxNLocator(4))
    rms = " × ".join(f"{spot[key] * 1e6:.3g}" for key in ("rms_x_m", "rms_y_m"))
    _square(ax, f"{_wrap(spot['label'])}\npower {spot['power']:.3g}, RMS {rms} µm", "mm")
    return ax


def plot_psf(psf: Mapping[str, Any], ax: Axes | None = None) -> Axes:
    """Point spread function on a logarithmic scale of ``PSF_DECADES`` decades below its peak.

    psf : ``label``, ``x_m`` (Nx,) and ``y_m`` (Ny,) uniform sample positions in m, ``psf`` (Ny, Nx) ≥ 0, ``method``,
    and ``share``, the part of the beam's power in the window (None for the rays of a "geometric" picture).
    """
    from matplotlib.colors import LogNorm

    ax = _axes(ax, (3.4, 3.0))
    values = np.asarray(psf["psf"])
    peak = float(values.max())
    extent = (*_edges(np.asarray(psf["x_m"]) * 1e6), *_edges(np.asarray(psf["y_m"]) * 1e6))
    norm = LogNorm(vmin=10.0**-PSF_DECADES, vmax=1.0, clip=True)
    values = values / peak if peak > 0 else values
    image = ax.imshow(values, cmap="magma", norm=norm, origin="lower", extent=extent)
    # Ticks take longer to draw than all the rest, and minor ones say nothing on a scale of decades.
    ticks = 10.0 ** np.arange(-PSF_DECADES, 1, 2)
    ax.figure.colorbar(image, ax=ax, label="irradiance / its peak", ticks=ticks).minorticks_off()
    about = psf["method"].split(" ")[0] if psf["share"] is None else f"{psf['share']:.1%} of its power in the window"
    _square(ax, f"{_wrap(psf['label'])}\n{about}", "µm")
    return ax


def plot_layout(layout: Mapping[str, Any], ax: Axes | None = None) -> Axes:
    """One view of the instrument with rays.

    layout : a view of ``report.layout``: ``title``; ``axes``, the names of the two coordinates shown; ``surfaces``, a
    list of {``name`` or "", ``points_m`` (P, 2)}, each a profile, with ``name_at_m`` (2,) and ``outward`` (2,) where it
    has a name: the point it stands at, and the unit vector in which it leaves it; ``rays``, a list of {``points_m``
    (V, 2), ``group``}, each a polyline, coloured by its group (field point or arm).
    """
    ax = _axes(ax, (11.0, 5.0))
    for ray in layout["rays"]:
        points = np.asarray(ray["points_m"]) * 1e3
        ax.plot(points[:, 0], points[:, 1], color=COLOURS[ray["group"] % len(COLOURS)], linewidth=0.4, alpha=0.8)
    for surface in layout["surfaces"]:
        points = np.asarray(surface["points_m"]) * 1e3
        ax.plot(points[:, 0], points[:, 1], color="black", linewidth=1.1)
    for surface in layout["surfaces"]:
        if surface["name"]:
            _name(ax, surface["name"], np.asarray(surface["name_at_m"]) * 1e3, np.asarray(surface["outward"]))
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
    ax.locator_params(nbins=4)
    ax.set_xlabel(f"x / {unit}")
    ax.set_ylabel(f"y / {unit}")
    ax.set_title(title, fontsize=8)


def _wrap(label: str) -> str:
    return textwrap.fill(label, TITLE_WIDTH)


def _edges(samples: np.ndarray) -> tuple[float, float]:
    """Outer edges of the pixels around uniform samples."""
    half = 0.5 * (samples[1] - samples[0])
    return float(samples[0] - half), float(samples[-1] + half)


def _name(ax: Axes, name: str, at: np.ndarray, outward: np.ndarray) -> None:
    """A name beside a point, on its outward side."""
    from matplotlib.patheffects import withStroke

    x, y = (float(part) for part in outward)
    words = ax.annotate(
        name,
        (float(at[0]), float(at[1])),
        fontsize=7,
        xytext=(4 * x, 4 * y),
        textcoords="offset points",
        ha=("right", "center", "left")[round(x) + 1],
        va=("top", "center", "bottom")[round(y) + 1],
    )
    words.set_path_effects([withStroke(linewidth=2, foreground="white")])
