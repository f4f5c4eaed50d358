"""How many ghosts a band has: by order, by field point, by the surface that light is turned at first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cgi_wave.budget.select import POWER_FLOOR

Count = dict[str, int]


def count_ghosts(rows: Sequence[Mapping[str, Any]], above: float = POWER_FLOOR) -> dict[str, Any]:
    """Counts of the ghost table (``budget.ghosts.ghost_rows``), each ``{"all": n, "above": m}``.

    above: power relative to the nominal beams beyond which a ghost counts as strong; its mean over the field points in
    ``total``, ``by_order`` and ``by_first_surface``, that at the point itself in ``by_field``, where a ghost counts
    that arrives there at all. First surface: that of the first parasitic interaction; the arms of one history count
    one by one, as elsewhere in the table.
    """
    orders, surfaces = ({_key(row): None for row in rows} for _key in (_order, _first_surface))
    points = max((len(row["transmission_fields"]) for row in rows), default=0)
    return {
        "above": above,
        "total": _count([row["transmission"] for row in rows], above),
        "by_order": {
            key: _count([r["transmission"] for r in rows if _order(r) == key], above) for key in sorted(orders)
        },
        "by_field": [_count([row["transmission_fields"][k] for row in rows], above) for k in range(points)],
        "by_first_surface": {
            key: _count([r["transmission"] for r in rows if _first_surface(r) == key], above) for key in surfaces
        },
    }


def counts_text(counts: Mapping[str, Any]) -> str:
    """Counts on three lines, ``strong/all``."""

    def pair(count: Count) -> str:
        return f"{count['above']}/{count['all']}"

    orders = ", ".join(f"order {key}: {pair(count)}" for key, count in counts["by_order"].items())
    surfaces = ", ".join(f"{key} {pair(count)}" for key, count in counts["by_first_surface"].items())
    return (
        f"ghosts above {counts['above']:g} of the nominal power / in the table: {pair(counts['total'])}; {orders}\n"
        f"at the field points: {', '.join(pair(count) for count in counts['by_field'])}\n"
        f"turned first at: {surfaces}"
    )


def _count(powers: Sequence[float], above: float) -> Count:
    return {"all": sum(power > 0.0 for power in powers), "above": sum(power > above for power in powers)}


def _order(row: Mapping[str, Any]) -> str:
    return str(row["order"])


def _first_surface(row: Mapping[str, Any]) -> str:
    return str(row["label"].partition(":")[0])
