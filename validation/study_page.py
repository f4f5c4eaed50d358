"""A study's report: a Markdown page with tables and the plots beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """A Markdown table of rows that have the same keys; numbers to four digits."""
    if not rows:
        return "(nothing)\n"
    names = list(rows[0])
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    for row in rows:
        lines.append("| " + " | ".join(_cell(row[name]) for name in names) + " |")
    return "\n".join(lines) + "\n"


def _cell(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "—"}[value]
    return f"{value:.4g}" if isinstance(value, float) else str(value).replace("|", "\\|")


def finite(value: Any) -> Any:
    """The same without numbers that are not finite: JSON has none, and None says that there is no bound, no border."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_page(folder: Path, name: str, parts: Sequence[str]) -> Path:
    """Write ``folder/name.md`` from its parts, whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / f"{name}.md"
    draft = page.with_suffix(".md.part")
    draft.write_text("\n".join(parts), encoding="utf-8")
    draft.replace(page)
    return page


def save_figure(figure: Any, folder: Path, name: str) -> str:
    """Save a figure in the folder and return the Markdown that shows it."""
    import matplotlib.pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / f"{name}.png", dpi=120, bbox_inches="tight")
    plt.close(figure)
    return f"![{name}]({name}.png)\n"
