"""Table 1 of the paper: O/B, M*/M and the NMA error of one band, mean and spread over the field points.

Spread is the standard deviation over the fields with divisor n (the field points are the whole set that is described,
not a sample of it; one field has spread 0). Both book-keepings are given: ``coherent`` (every pair, the figures of the
band) and ``paper`` (powers added without interference, ghost–nominal pairs only), each with Eq. 1's linear value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cgi_wave.budget.why import why_rows
from cgi_wave.errors import InputError
from cgi_wave.fringes.nma import Estimate, Parasitic, Retrieval

ROWS = ("offset_over_baseline", "parasitic_over_modulation", "nma_error")


@dataclass(frozen=True)
class Printed:
    """One column of the paper's Table 1; no spread is printed for the NMA error."""

    offset_over_baseline: tuple[float, float]
    parasitic_over_modulation: tuple[float, float]
    nma_error: float


#: Khodnevych and Simeoni, "Stray light analysis of Compact Gas Imager", Table 1: (mean, variation over the field).
PRINTED: dict[str, Printed] = {
    "VIS": Printed((0.037, 0.005), (3e-4, 5e-4), 0.0355),
    "NIR": Printed((0.034, 0.005), (2e-4, 8e-4), 0.0328),
    "SWIR1-CH4": Printed((0.034, 0.006), (0.008, 0.006), 0.0397),
    "SWIR1-CO2": Printed((0.033, 0.005), (0.004, 0.009), 0.0277),
    "SWIR2": Printed((0.037, 0.002), (0.003, 0.006), 0.0324),
}


def table1(
    band: str, fields: Sequence[Retrieval], why: str | None = None, families: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """The column of one band, ready for JSON.

    ``{row: {"mean", "spread", "error"}}`` for the three rows in the coherent book-keeping; ``"paper_bookkeeping"`` with
    the same three; ``"nma_error_linear"`` (Eq. 1) beside each; ``"nominal"`` M, B and NMA; ``"fields"``, ``"printed"``
    (None for a band that the paper does not have); where it has one, ``"why_rows"``, by row a sentence on why the
    figures differ, and ``"why"``, all of them, or the caller's own text in their place. ``error`` is the largest error
    bar of any field. families: see ``budget.why``. Sign of the NMA error: positive when the NMA falls.

    Raises InputError without a field.
    """
    if not fields:
        raise InputError("table1", f"bands.{band}", 0, "has no field point", "give the retrieval of at least one")
    coherent, paper = (_rows([getattr(field, book) for field in fields]) for book in ("coherent", "paper"))
    printed = _printed(PRINTED[band]) if band in PRINTED else None
    rows = None
    if printed is not None and why is None:
        rows = why_rows(band, _means(coherent), _means(paper), _means(printed), families)
    return {
        **coherent,
        "paper_bookkeeping": paper,
        "nominal": {
            name: _summary([getattr(field.nominal, name) for field in fields])
            for name in ("modulation", "baseline", "nma")
        },
        "fields": len(fields),
        "printed": printed,
        "why": " ".join(rows.values()) if rows is not None else why,
        "why_rows": rows,
    }


def format_table1(columns: dict[str, dict[str, Any]]) -> str:
    """Plain text of Table 1 for ``{band: table1(...)}``: ours in both book-keepings, and the paper's."""
    lines = [
        f"{'band':<11}{'':<20}{'coherent':>21}{'ghost-nominal only':>21}{'printed':>21}",
    ]
    labels = {"offset_over_baseline": "O/B", "parasitic_over_modulation": "M*/M", "nma_error": "dNMA/NMA",
              "nma_error_linear": "dNMA/NMA, Eq. 1"}  # fmt: skip
    for band, column in columns.items():
        for row, label in labels.items():
            printed = (column["printed"] or {}).get(row)
            cells = [_cell(column[row]), _cell(column["paper_bookkeeping"][row]), _cell(printed)]
            lines.append(f"{band:<11}{label:<20}" + "".join(f"{cell:>21}" for cell in cells))
        if column["why"]:
            lines.append(f"{band:<11}{column['why']}")
    return "\n".join(lines)


def _cell(entry: dict[str, float] | None) -> str:
    if entry is None:
        return "-"
    spread = "" if entry["spread"] is None else f" ± {entry['spread']:.4f}"
    return f"{entry['mean']:+.4f}{spread}"


def _rows(parts: Sequence[Parasitic]) -> dict[str, dict[str, float]]:
    return {name: _summary([getattr(part, name) for part in parts]) for name in (*ROWS, "nma_error_linear")}


def _means(part: Mapping[str, Mapping[str, float | None]]) -> dict[str, float]:
    return {row: float(part[row]["mean"] or 0.0) for row in ROWS}


def _summary(estimates: Sequence[Estimate]) -> dict[str, float]:
    values = np.array([estimate.value for estimate in estimates])
    return {
        "mean": float(values.mean()),
        "spread": float(values.std()),
        "error": max(estimate.error for estimate in estimates),
    }


def _printed(column: Printed) -> dict[str, dict[str, float | None]]:
    o, m = column.offset_over_baseline, column.parasitic_over_modulation
    return {
        "offset_over_baseline": {"mean": o[0], "spread": o[1]},
        "parasitic_over_modulation": {"mean": m[0], "spread": m[1]},
        "nma_error": {"mean": column.nma_error, "spread": None},
    }
