"""Picture of the study `fringes`: time of a frame against its error, with the defaults marked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

LABELS = {
    "samples": "part of the wavenumbers",
    "pairs": "number of pairs of beams",
    "kernels": "tolerance of images; none: no blur",
    "rank": "number of spectral modes",
    "ghosts": "number of ghost families",
}
MARKS = {"samples": "s", "pairs": "o", "kernels": "s", "rank": "^", "ghosts": "o"}
FLOOR = 1e-16  # an error of 0 on a logarithmic axis


def draw(found: dict[str, Any], file: Path) -> Path:
    """The fringe pattern of a zone (``chart``) and, if it was made, a frame over a scene (``scene_chart``)."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    panels: list[tuple[Any, str, str, str]] = [
        (found["chart"], "Pattern of 1024 × 1024 pixels, uniform scene", "time / s",
         "largest error / nominal baseline"),
    ]  # fmt: skip
    if "scene_chart" in found:
        rows, columns = found["scene_shape"]
        title = f"Frame of {rows} × {columns} pixels over a scene"
        panels.append((found["scene_chart"], title, "time per frame / ms", "largest error / mean irradiance"))
    figure, axes = plt.subplots(1, len(panels), figsize=(6.4 * len(panels), 4.6), layout="constrained", squeeze=False)
    for ax, (points, title, time, error) in zip(axes[0], panels, strict=True):
        scale = 1e3 if time.endswith("ms") else 1.0
        for colour, series in enumerate(dict.fromkeys(point["series"] for point in points)):
            some = [point for point in points if point["series"] == series]
            x = [scale * point["seconds"] for point in some]
            y = [max(point["error"], FLOOR) for point in some]
            if series == "default":
                ax.loglog(x, y, "r*", ms=15, zorder=3, label=_default(some[0]))
                continue
            ax.loglog(x, y, MARKS[series], color=f"C{colour - 1}", ms=6, label=LABELS[series])
            for point, at, height in zip(some, x, y, strict=True):
                ax.annotate(point["what"], (at, height), xytext=(6, 5), textcoords="offset points", fontsize=8)
        ax.margins(0.15)
        ax.xaxis.set_major_locator(matplotlib.ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter(matplotlib.ticker.FuncFormatter(lambda value, _: f"{value:g}"))
        ax.xaxis.set_minor_formatter(matplotlib.ticker.NullFormatter())
        ax.grid(visible=True, alpha=0.3)
        ax.set(title=title, xlabel=time, ylabel=error)
        ax.legend(fontsize=8)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=120)
    plt.close(figure)
    return file


def _default(point: dict[str, Any]) -> str:
    if "pairs" in point:
        return f"default: {point['pairs']} pairs, {point['samples']} wavenumbers"
    return f"default: {point['layers'] - 1} ghost families, {point['modes']} modes, {point['tolerance']:g}"
