"""How the charts of the study `contrast` look: a colour and a mark for every method and peer, the same on all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from validation.contrast_charts import Curve, Key

OWN = "this package"
#: Colour and mark. The package's methods are cold colours and solid lines, peers warm ones and dashed.
SOLID = {
    "panels": ("#0072b2", "s"),
    "fft": ("#56b4e9", "^"),
    "pruned-fft": ("#44aa99", "v"),
    "chirp-z": ("#117733", "D"),
    "nufft": ("#332288", "P"),
    "fresnel": ("#8c8c8c", "X"),
}
DASHED = {
    "prysm": ("#d55e00", "s"),
    "poppy": ("#e69f00", "^"),
    "hcipy": ("#882255", "v"),
    "finufft": ("#ee6677", "D"),
}
#: What the legend says beside a name.
WORDS = {
    "panels": "Gauss panels fitted to the boundary",
    "fft": "whole window",
    "nufft": "nodes fitted to the boundary",
    "fresnel": "propagation",
    "hcipy": "edges supersampled",
    "poppy": "grey edges",
    "prysm": "binary edges",
    "finufft": "polar nodes",
}
#: Errors below that of double precision are drawn there.
LEAST = 1e-16


def style(name: str) -> dict[str, Any]:
    """Keywords of a line; a method that is not known yet is grey and dotted, so that somebody notices."""
    if name == OWN:
        return {"color": "black", "marker": "o", "lw": 2.2, "ms": 5, "zorder": 4}
    if name in SOLID:
        colour, mark = SOLID[name]
        return {"color": colour, "marker": mark, "lw": 1.3, "ms": 5, "zorder": 3}
    colour, mark = DASHED.get(name, ("#bbbbbb", "*"))
    return {"color": colour, "marker": mark, "lw": 1.3, "ms": 4.5, "ls": (0, (4, 2)), "zorder": 2}


def draw(
    w: float,
    curves: dict[Key, dict[str, Curve]],
    sizes: dict[Key, float],
    geometries: Sequence[str],
    others: Sequence[str],
    limit: str,
    out: Path,
) -> str:
    """One figure for one defocus as PNG in ``out``; its name.

    sizes : |γ| of each chart; limit : what a point may take, in words.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    shape = len(others), len(geometries)
    figure, axes = plt.subplots(*shape, figsize=(14, 8.6), sharex=True, sharey=True, layout="constrained")
    for row, aberrations in enumerate(others):
        for column, geometry in enumerate(geometries):
            ax, key = axes[row, column], (w, geometry, aberrations)
            for name, found in curves[key].items():
                if found.points:
                    _line(ax, name, found)
            _notes(ax, curves[key])
            ax.axvline(sizes[key], color="black", ls=":", lw=1.2, label="|γ| itself")
            ax.set_title(f"{geometry}; {aberrations}; |γ| = {sizes[key]:.2g}", fontsize=10)
            ax.grid(alpha=0.25)
    for ax in axes[-1]:
        ax.set_xlabel("true error of γ, absolute (no unit): more accurate →")
    for ax in axes[:, 0]:
        ax.set_ylabel("time of one overlap, ms (one thread)")
    axes[0, 0].set_xscale("log")
    axes[0, 0].set_yscale("log")
    axes[0, 0].invert_xaxis()
    handles = {label: h for ax in axes.flat for h, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, fontsize=9, handlelength=3.5)
    figure.suptitle(
        f"Overlap contrast at W020 = {w:g} waves: further right is more accurate, lower is faster. Solid: this "
        f"package, dashed: others.\nA hollow last mark: stopped, the next point would take too long ({limit}). "
        f"Errors below {LEAST:g} are drawn there.",
        fontsize=11,
    )
    name = f"work-precision-{w:g}.png"
    figure.savefig(out / name, dpi=110)
    plt.close(figure)
    return name


def _line(ax: Any, name: str, found: Curve) -> None:
    """A curve; where it was stopped its last mark is hollow, with the time of the point that is missing."""
    errors, times = [max(e, LEAST) for e, _ in found.points], [1e3 * s for _, s in found.points]
    how = style(name)
    ax.plot(errors, times, label=f"{name}: {WORDS[name]}" if name in WORDS else name, **how)
    if found.left > 0.0:
        ax.plot(errors[-1:], times[-1:], **{**how, "mfc": "white", "ms": how["ms"] + 2, "zorder": 5})


def _notes(ax: Any, curves: dict[str, Curve]) -> None:
    """What is missing, where no curve goes: between what grids reach and what the package does."""
    lines = [(f"{name}: next {found.left:.2g} s", style(name)["color"]) for name, found in curves.items() if found.left]
    nothing = [name for name, found in curves.items() if not found.points and not found.left]
    for k in range(0, len(nothing), 2):
        lines.append((("refused: " if k == 0 else "   ") + ", ".join(nothing[k : k + 2]), "#555555"))
    for k, (text, colour) in enumerate(lines):
        ax.text(0.62, 0.97 - 0.048 * k, text, transform=ax.transAxes, fontsize=7.5, va="top", color=colour, zorder=6)
