"""Pictures of frames and scrolls. Each ``plot_*(result, ax=None)`` draws what it is given and returns the Axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

    from cgi_wave.frames import Frame
    from cgi_wave.mosaic import DetectorFrame
    from cgi_wave.pointparts import PointParts
    from cgi_wave.scrolling import Scrolled

#: Families of ghosts drawn each on its own; the weaker ones are in the sum only.
FAMILIES = 8
#: Fringe frequencies marked in the spectrum.
MARKS = 12


def plot_frame(result: Frame, ax: Axes | None = None) -> Axes:
    """The frame on the detector, in mm; edges of dead zones dashed."""
    ax = _axes(ax, (7.0, 4.2))
    x, y = result.x_m * 1e3, result.y_m * 1e3
    low, high = np.percentile(result.frame, [0.2, 99.8])  # a few bright roofs would leave the rest dark
    image = ax.imshow(result.frame, origin="lower", extent=_extent(x, y), cmap="gray", interpolation="nearest",
                      vmin=low, vmax=high)  # fmt: skip
    _bar(ax, image, "irradiance / input (dimensionless)")
    pitch = y[1] - y[0]
    for span in result.dead_rows:
        for edge in span:
            at = y[0] + (edge - result.rows[0] - 0.5) * pitch
            if y[0] < at < y[-1]:
                ax.axhline(at, color="C3", lw=0.8, ls="--")
    ax.set(xlabel="x across track (mm)", ylabel="y along track (mm)", title=f"{result.band}: {_first(result.scene)}")
    return ax


def plot_detector(result: DetectorFrame, ax: Axes | None = None) -> Axes:
    """The whole detector, in mm; edges of dead zones dashed, bands named beside their rows."""
    ax = _axes(ax, (7.0, 6.0))
    x, y = result.x_m * 1e3, result.y_m * 1e3
    lit = result.frame[result.band != ""]
    low, high = np.percentile(lit, [0.2, 99.8])
    image = ax.imshow(result.frame, origin="lower", extent=_extent(x, y), cmap="gray", interpolation="nearest",
                      vmin=low, vmax=high)  # fmt: skip
    _bar(ax, image, "irradiance / the band's input (dimensionless)", at=1.06)
    pitch = y[1] - y[0]
    for part in result.parts:
        for span in part.dead_rows:
            for edge in span:
                at = y[0] + (edge - 0.5) * pitch
                if y[0] < at < y[-1]:
                    ax.axhline(at, color="C3", lw=0.6, ls="--")
        middle = y[0] + (0.5 * sum(part.rows) - 0.5) * pitch
        ax.text(1.01, middle, part.band, transform=ax.get_yaxis_transform(), rotation=90, va="center", ha="left",
                fontsize="small")  # fmt: skip
    ax.set(xlabel="x across track (mm)", ylabel="y along track (mm)",
           title=f"{result.detector}: {_first(result.scene)}")  # fmt: skip
    return ax


def plot_point(result: PointParts, ax: Axes | None = None) -> Axes:
    """Nominal interferogram of one ground point (left axis), and what ghosts add, in all and by family (right axis)."""
    ax = _axes(ax, (9.0, 4.8))
    y = result.y_m * 1e3
    ax.plot(y, result.nominal, color="0.6", label="nominal (left)")
    ax.set(xlabel="y along track (mm)", ylabel="irradiance / input (dimensionless)")
    ax.text(0.01, 0.01, _point(result), transform=ax.transAxes, fontsize="small", va="bottom")
    right = ax.twinx()
    right.plot(y, result.parasitic, color="black", lw=1.2, label="parasitic, all (right)")
    strongest = sorted(result.parts, key=lambda name: -float(np.abs(result.parts[name]).max()))
    for number, name in enumerate(strongest[:FAMILIES]):
        right.plot(y, result.parts[name], color=f"C{number % 10}", lw=0.8, ls="--", label=f"{name} (right)")
    right.plot(y, result.rest, color="0.3", lw=0.8, ls=":", label="between families (right)")
    right.set_ylabel("parasitic part / input (dimensionless)")
    lines = [*ax.get_lines(), *right.get_lines()]
    ax.legend(lines, [str(line.get_label()) for line in lines], loc="lower center", bbox_to_anchor=(0.5, 1.0),
              ncols=3, frameon=False, fontsize="small")  # fmt: skip
    return ax


def plot_point_spectrum(result: PointParts, ax: Axes | None = None) -> Axes:
    """Spectrum of the interferogram along y, with the fringe frequency of the strongest pairs with a ghost marked."""
    ax = _axes(ax, (8.0, 4.5))
    frequency = result.frequency * 1e-3
    floor = 1e-9 * float(result.nominal_spectrum.max())
    ax.semilogy(frequency, np.maximum(result.nominal_spectrum, floor), color="0.5", label="nominal")
    ax.semilogy(frequency, np.maximum(result.parasitic_spectrum, floor), color="black", lw=1.2, label="parasitic")
    drawn: dict[str, int] = {}
    for name, at, amplitude in result.lines[:MARKS]:
        new = name not in drawn
        colour = drawn.setdefault(name, len(drawn))
        ax.plot([at * 1e-3], [max(amplitude, floor)], "v", color=f"C{colour % 10}", label=name if new else None)
        ax.axvline(at * 1e-3, color=f"C{colour % 10}", lw=0.6, ls=":")
    edge = 0.02 * float(frequency[-1])  # a mark at no frequency at all stands whole
    ax.set(xlim=(-edge, frequency[-1] + edge), xlabel="fringe frequency along y (1/mm)",
           ylabel="amplitude / input (dimensionless)", title=_point(result))  # fmt: skip
    ax.legend(fontsize="small", frameon=False)
    return ax


def plot_nma_error(result: Scrolled, ax: Axes | None = None) -> Axes:
    """Map of the NMA error on the ground, per cent; positive where the NMA falls."""
    ax = _axes(ax, (7.0, 4.8))
    values = 100.0 * result.errors.error
    x, y = result.x_m * 1e3, result.y_m * 1e3
    image = ax.imshow(values, origin="lower", extent=_extent(x, y), cmap="viridis", interpolation="nearest",
                      vmin=100.0 * result.errors.low, vmax=100.0 * result.errors.high)  # fmt: skip
    _bar(ax, image, "NMA error (%)")
    ax.set(xlabel="X across track (mm on the detector)", ylabel="Y along track (mm on the detector)",
           title=f"{result.band}: {_first(result.scene)}")  # fmt: skip
    return ax


def plot_waterfall(result: Scrolled, ax: Axes | None = None, shown: int = 4) -> Axes:
    """Some frames of the scroll side by side, from left to right, in mm on the detector; ghosts and noise included."""
    ax = _axes(ax, (12.0, 3.0))
    chosen = np.unique(np.linspace(0, len(result.stills) - 1, shown).astype(int))
    zone = result.ready.zone
    x0, x1, y0, y1 = _extent(zone.x_m * 1e3, zone.y_m * 1e3)
    # stills leave out the last rows and columns where their step does not divide the zone
    x1, y1 = (
        low + n * result.still_step * zone.pitch * 1e3
        for low, n in zip((x0, y0), result.stills.shape[:0:-1], strict=True)
    )
    width, gap = x1 - x0, 0.06 * (x1 - x0)
    low, high = np.percentile(result.stills, [0.2, 99.8])
    ticks: list[tuple[float, str]] = []
    for place, k in enumerate(chosen.tolist()):
        left = place * (width + gap)
        image = ax.imshow(result.stills[k], origin="lower", extent=(left, left + width, y0, y1), cmap="gray", vmin=low,
                          vmax=high, interpolation="nearest")  # fmt: skip
        ax.text(left + 0.5 * width, y1 + 0.02 * (y1 - y0), f"frame {result.still_frames[k]}", ha="center", va="bottom",
                fontsize="small")  # fmt: skip
        ticks += [(left + share * width, f"{x0 + share * width:.1f}") for share in (0.1, 0.5, 0.9)]
    ax.set_xticks([at for at, _ in ticks], [text for _, text in ticks], fontsize="x-small")
    ax.set(xlim=(0.0, len(chosen) * (width + gap) - gap), ylim=(y0, y1), xlabel="x across track in each frame (mm)",
           ylabel="y along track (mm)")  # fmt: skip
    ax.spines[:].set_visible(False)
    _bar(ax, image, "irradiance / input\n(dimensionless)", at=1.01, width=0.008)
    return ax


def _axes(ax: Axes | None, size: tuple[float, float]) -> Axes:
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    _, made = plt.subplots(figsize=size, layout="constrained")
    return made


def _bar(ax: Axes, image: AxesImage, label: str, at: float = 1.02, width: float = 0.025) -> None:
    """A colour bar as high as the picture; pointed, since a few values lie beyond its ends."""
    ax.figure.colorbar(image, cax=ax.inset_axes((at, 0.0, width, 1.0)), label=label, extend="both")


def _point(result: PointParts) -> str:
    return f"ground row {result.ground}, x = {result.x_m * 1e3:.2f} mm"


def _extent(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float, float]:
    half = 0.5 * float(x[1] - x[0])
    return float(x[0]) - half, float(x[-1]) + half, float(y[0]) - half, float(y[-1]) + half


def _first(source: str) -> str:
    return source.partition("; ")[0].partition(", ")[0]
