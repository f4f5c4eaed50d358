"""A ranking of remedies, for reading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cgi_wave.ranking import Ranking

Row = Mapping[str, Any]


def ranking_text(found: Ranking) -> str:
    """What surfaces cost, then the remedies, best first. All of the NMA, O/B and M*/M in per cent."""
    total = found.costs["total"]
    points = f"{found.fields} field point{'s' * (found.fields > 1)}"
    lines = [
        f"{found.band}, {points}: O/B {_percent(total['offset'])} %, M*/M {_percent(total['modulation'])} %, NMA error "
        f"{_percent(total['nma'])} ± {_percent(total['nma_error'], sign=False)} %",
        "",
        "What each surface costs, in %: power of its ghosts; shares, which add up; the NMA error's fall without its "
        "ghosts; the NMA error of its ghosts alone",
        *_table(
            ("surface", "ghosts", "power", "|J| nominal", "|J| family", "O/B share", "M*/M share", "NMA share",
             "removed", "±", "alone", "±"),
            [
                (row["name"], str(row["ghosts"]), _percent(row["power"], sign=False), _plain(row["contrast_nominal"]),
                 _plain(row["contrast_family"]), *(_percent(row[f"share_{part}"]) for part in PARTS),
                 _percent(row["removed_nma"]), _percent(row["removed_nma_error"], sign=False),
                 _percent(row["alone_nma"]), _percent(row["alone_nma_error"], sign=False))
                for row in found.costs["surfaces"]
            ],
        ),
        "",
        "Remedies, in %: NMA error after; its fall, with the error of the difference (?: not beyond it); the linear "
        "guess and the tangent; nominal power, spot / µm and fringes after",
        *_table(
            ("remedy", "change", "NMA error", "±", "gain", "±", "guess", "tangent", "power", "spot", "fringes", "by"),
            [_remedy(row) for row in found.remedies],
        ),
    ]  # fmt: skip
    if found.remedies:
        row = found.remedies[0]
        power, spot = _percent(row["transmission_before"], sign=False), row["spot_before_m"] * 1e6
        lines.append(f"as it is: power {power} %, spot {spot:.2f} µm, {row['fringes_before']:.2f} fringes")
    refused = [f"{row['remedy']}, {row['change']}: {row['reason']}" for row in found.remedies if row["reason"]]
    kept = [f"{name}: no better coating tried, {why}" for name, why in found.unimproved.items()]
    return "\n".join([*lines, *refused, *kept, f"{found.seconds:.0f} s"])


PARTS = ("offset", "modulation", "nma")


def _remedy(row: Row) -> tuple[str, ...]:
    spot, fringes = row["spot_after_m"], row["fringes_after"]
    return (
        row["remedy"], row["change"], _percent(row["nma_error_after"]),
        _percent(row["nma_error_after_error"], sign=False), _percent(row["gain"]) + _doubt(row),
        _percent(row["gain_error"], sign=False), _percent(row["gain_guess"]), _percent(row["gain_tangent"]),
        _percent(row["transmission_after"], sign=False), "–" if spot is None else f"{spot * 1e6:.2f}",
        "–" if fringes is None else f"{fringes:.2f}", "refused" if row["reason"] else row["method"],
    )  # fmt: skip


def _percent(value: float | None, sign: bool = True) -> str:
    return "–" if value is None else f"{100.0 * value:{'+' if sign else ''}.3f}"


def _doubt(row: Row) -> str:
    return "" if row["gain"] is None or abs(row["gain"]) > row["gain_error"] else "?"


def _plain(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Columns of words to the left, of numbers to the right."""
    widths = [max(len(line[k]) for line in (heads, *rows)) for k in range(len(heads))]
    words = {"surface", "remedy", "change", "by"}
    return [
        "  ".join(
            cell.ljust(width) if head in words else cell.rjust(width)
            for cell, width, head in zip(line, widths, heads, strict=True)
        ).rstrip()
        for line in (heads, *rows)
    ]
