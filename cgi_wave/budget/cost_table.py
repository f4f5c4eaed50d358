"""Tables of what surfaces and families cost, and of what remedies gain: means over the field points, ready for JSON.

A number whose name ends in no unit is dimensionless. Errors are the largest of any field point, as in Table 1; spreads
are standard deviations over the field points with divisor n.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cgi_wave.budget.attribution import Cost, Effect, FieldCosts
from cgi_wave.budget.outcome import Outcome, Seen
from cgi_wave.budget.remedies import Remedy
from cgi_wave.optics.system import OpticalSystem

MEANS = ("power", "power_share", "untraced")
CONTRASTS = ("contrast_nominal", "contrast_family", "contrast")
EFFECTS = ("share", "alone", "removed")
NOTHING = Effect(0.0, 0.0, 0.0, 0.0)


def cost_table(system: OpticalSystem, fields: Sequence[FieldCosts]) -> dict[str, Any]:
    """``{"surfaces": rows, "families": rows, "total": row}``, largest share of the NMA error first.

    A row has ``name``; for surfaces ``coating``; ``ghosts`` (the most at any point); ``power`` and ``power_share``,
    relative to the nominal beams; contrasts (None: none computed); and for each of ``share``, ``alone`` and ``removed``
    (see ``budget.attribution``) ``…_offset`` (O/B), ``…_modulation`` (M*/M), ``…_nma`` and ``…_nma_error``; for
    ``removed`` also ``removed_nma_spread``. A point that no ghost of a row reaches counts 0 there. ``total``: the sums
    of the shares, and what all ghosts together do (``offset``, ``modulation``, ``nma``, ``nma_error``).
    """
    coating = {spec.name: spec.coating for frame in system.document.frame for spec in frame.surface}
    surfaces = _rows([field.surfaces for field in fields])
    for row in surfaces:
        row["coating"] = coating[row["name"]]
    whole = [field.total for field in fields]
    total = {
        **{
            name: float(np.mean([getattr(effect, name) for effect in whole]))
            for name in ("offset", "modulation", "nma")
        },
        "nma_error": max(effect.error for effect in whole),
        **{
            name: float(sum(row[name] for row in surfaces))
            for name in ("power_share", "share_offset", "share_modulation", "share_nma")
        },
    }
    return {"surfaces": surfaces, "families": _rows([field.families for field in fields]), "total": total}


def _rows(fields: Sequence[Mapping[str, Cost]]) -> list[dict[str, Any]]:
    names = {name for field in fields for name in field}
    rows = [_row(name, [field.get(name) for field in fields]) for name in names]
    return sorted(rows, key=lambda row: (-row["share_nma"], row["name"]))


def _row(name: str, costs: Sequence[Cost | None]) -> dict[str, Any]:
    there = [cost for cost in costs if cost is not None]
    row: dict[str, Any] = {"name": name, "ghosts": max(cost.ghosts for cost in there)}
    for key in MEANS:
        row[key] = float(sum(getattr(cost, key) for cost in there) / len(costs))
    for key in CONTRASTS:
        known = [getattr(cost, key) for cost in there if getattr(cost, key) is not None]
        row[key] = float(np.mean(known)) if known else None
    for key in EFFECTS:
        effects = [NOTHING if cost is None else getattr(cost, key) for cost in costs]
        for part in ("offset", "modulation", "nma"):
            row[f"{key}_{part}"] = float(np.mean([getattr(effect, part) for effect in effects]))
        row[f"{key}_nma_error"] = max(effect.error for effect in effects)
        if key == "removed":
            row["removed_nma_spread"] = float(np.std([effect.nma for effect in effects]))
    return row


def remedy_rows(
    before: Sequence[Seen], results: Sequence[tuple[Remedy, str, Sequence[Outcome], str]]
) -> list[dict[str, Any]]:
    """Rows of the ranking, largest gain first; a remedy that could not be computed stands last, with the reason.

    ``nma_error_before`` and ``…_after`` with ``…_after_error``; ``gain``, mean fall of |NMA error| over the field
    points, with ``gain_error``, the bar of the difference; ``gain_guess`` and ``gain_tangent``, the linear guesses of
    ``budget.outcome``, and how much they promise beyond the gain (``guess_excess``, ``tangent_excess``);
    ``offset_after`` and ``modulation_after``. What it costs, before and after: nominal ``transmission``, ``spot`` (m,
    radial RMS, worst), ``fringes`` in the zone, and the nominal beams' own ``nma``. ``method``: rescaled or
    traced again.
    """
    rows = [_remedy_row(before, *result) for result in results]
    return sorted(rows, key=lambda row: -row["gain"] if row["gain"] is not None else np.inf)


def _remedy_row(
    before: Sequence[Seen], remedy: Remedy, method: str, outcomes: Sequence[Outcome], reason: str
) -> dict[str, Any]:
    def mean(name: str) -> float | None:
        known = [getattr(outcome, name) for outcome in outcomes]
        return float(np.mean(known)) if known and None not in known else None

    def largest(name: str) -> float | None:
        return max((float(getattr(outcome, name)) for outcome in outcomes), default=None)

    gain, guessed, tangent = mean("gain"), mean("guess"), mean("tangent")
    return {
        "remedy": remedy.name,
        "kind": remedy.kind,
        "change": remedy.change,
        "nma_error_before": float(np.mean([seen.retrieval.coherent.nma_error.value for seen in before])),
        "nma_error_after": mean("nma_error"),
        "nma_error_after_error": largest("nma_error_bar"),
        "gain": gain,
        "gain_error": largest("gain_error"),
        "gain_guess": guessed,
        "guess_excess": None if gain is None or guessed is None else guessed - gain,
        "gain_tangent": tangent,
        "tangent_excess": None if gain is None or tangent is None else tangent - gain,
        "offset_after": mean("offset"),
        "modulation_after": mean("modulation"),
        "transmission_before": float(np.mean([seen.transmission for seen in before])),
        "transmission_after": mean("transmission"),
        "spot_before_m": max(seen.spot_m for seen in before),
        "spot_after_m": largest("spot_m"),
        "fringes_before": float(np.mean([seen.fringes for seen in before])),
        "fringes_after": mean("fringes"),
        "nma_before": float(np.mean([seen.retrieval.nominal.nma.value for seen in before])),
        "nma_after": mean("nma"),
        "method": method,
        "surfaces": " ".join(remedy.surfaces),
        "reason": reason,
    }
