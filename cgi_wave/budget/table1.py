"""Table 1 of the paper: O/B, M*/M and the NMA error of one band, mean and spread over the field points.

Spread is the standard deviation over the fields with divisor n (the field points are the whole set that is described,
not a sample of it; one field has spread 0). Both book-keepings are given: ``coherent`` (every pair, the figures of the
band) and ``paper`` (powers added without interference, ghost–nominal pairs only), each with Eq. 1's linear value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

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
    "SWIR1_CH4": Printed((0.034, 0.006), (0.008, 0.006), 0.0397),
    "SWIR1_CO2": Printed((0.033, 0.005), (0.004, 0.009), 0.0277),
    "SWIR2": Printed((0.037, 0.002), (0.003, 0.006), 0.0324),
}

_OFFSET = (
    "Ours is larger since every anti-reflection face of plates and cube inside an arm is met on the way to the mirror "
    "and back and adds R/2 (0.25 %) each time, the detector ρτ²/2 and the filter's face R/2 (together above 4 % with "
    "the paper's coatings), and lens faces the rest; added coherently instead of by power, the arm pairs of the "
    "refocused detector ghost keep half of its mean, ρτ²/4."
)
_FACE = (
    "Ours is negative since the filter face's ghosts, which share both arms, interfere with each other: M*/M = "
    "−(R/2)(1 − J), ghost–ghost pairs that the paper drops as negligible; J falls with the face's distance from the "
    "detector, which is {} mm in the reference instrument by its own focus and not public for the paper's{}."
)
_RATIO = (
    "Ours follows from the two rows above by the exact ratio 1 − (1 + M*/M)/(1 + O/B), as the printed one does: a "
    "larger baseline offset and a modulation that falls both add to it."
)
_STAND_IN = (
    "; the paper states neither gas, filter nor path difference for VIS, so that a 450/5 nm filter at 20 µm stands in"
)

#: Why a reconstruction of the instrument need not land on the printed figures: one sentence for each of ROWS.
WHY_ROWS: dict[str, dict[str, str]] = {
    band: dict(zip(ROWS, (_OFFSET, _FACE.format(distance, note), _RATIO), strict=True))
    for band, distance, note in (("VIS", "2.0", _STAND_IN), ("NIR", "3.4", ""))
}
#: The same, one text for a band; a caller may pass its own.
WHY: dict[str, str] = {band: " ".join(rows.values()) for band, rows in WHY_ROWS.items()}


def table1(band: str, fields: Sequence[Retrieval], why: str | None = None) -> dict[str, Any]:
    """The column of one band, ready for JSON.

    ``{row: {"mean", "spread", "error"}}`` for the three rows in the coherent book-keeping; ``"paper_bookkeeping"`` with
    the same three; ``"nma_error_linear"`` (Eq. 1) beside each; ``"nominal"`` M, B and NMA; ``"fields"``, ``"printed"``
    (None for a band that the paper does not have), ``"why"`` and, by row, ``"why_rows"`` (None where the caller gave
    its own text). ``error`` is the largest error bar of any field.
    Sign of the NMA error: positive when the NMA falls.

    Raises InputError without a field, and for a printed band without a sentence on why the figures differ.
    """
    if not fields:
        raise InputError("table1", f"bands.{band}", 0, "has no field point", "give the retrieval of at least one")
    printed = PRINTED.get(band)
    sentence = why if why is not None else WHY.get(band)
    if printed is not None and sentence is None:
        raise InputError(
            "table1", f"bands.{band}.why", None, "is needed beside the printed figures", "say why ours differ"
        )
    coherent = _rows([field.coherent for field in fields])
    return {
        **coherent,
        "paper_bookkeeping": _rows([field.paper for field in fields]),
        "nominal": {
            name: _summary([getattr(field.nominal, name) for field in fields])
            for name in ("modulation", "baseline", "nma")
        },
        "fields": len(fields),
        "printed": None if printed is None else _printed(printed),
        "why": sentence,
        "why_rows": WHY_ROWS.get(band) if why is None else None,
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
