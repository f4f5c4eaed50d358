"""The report of the study `contrast` as Markdown."""

from __future__ import annotations

from typing import Any


def report(result: dict[str, Any]) -> str:
    """The page; tables hold what `contrast.json` holds."""
    oracles = result["oracles"]
    lines = [
        "# Overlap contrast against two oracles",
        "",
        f"{result['random_cases']} random and {result['adversarial_cases']} adversarial cases, {result['runs']} runs "
        "(each case at 1e-8 and at a thousandth of the size of γ).",
        "",
        "| | all | random cases |",
        "|---|---|---|",
    ]
    for name in (
        "bound_violations", "bound_violations_if_oracles_are_as_good_as_they_agree", "bounds_above_tolerance",
        "bound_over_error_median", "bound_over_error_90", "bound_over_error_floor_median", "errors_told_from_zero",
        "largest_error", "refused",
    ):  # fmt: skip
        lines.append(f"| {name.replace('_', ' ')} | {_text(result[name])} | {_text(result['random'][name])} |")
    lines += [
        "",
        f"The oracles agree on {oracles['agreed']} of {result['cases']} cases; their difference is "
        f"{_text(oracles['median_difference'])} in the median and {_text(oracles['largest_difference'])} at most.",
        "",
    ]
    lines += _table("Where the oracles differ", oracles["disagreements"], ("kind", "difference", "claimed", "wrong"))
    lines += _table("Violations", result["violations"], ("kind", "w020", "tolerance", "error", "error_bound"))
    lines += _table("Doubtful", result["doubtful"], ("kind", "w020", "tolerance", "error", "error_bound"))
    reasons = [{"reason": reason, "runs": count} for reason, count in result["refusals"].items()]
    lines += _table("Refusals", reasons, ("reason", "runs"))
    timed = [{"set": name, **found} for name, found in result["timings"].items()]
    lines += _table(
        "Times, one thread", timed,
        ("set", "tolerance", "ms", "ms_90", "largest_error", "nodes", "refused", "failed", "cases"),
    )  # fmt: skip
    if "speedup_vs_peers" in result:
        rows = [{"peer": name, **row} for name, row in result["speedup_vs_peers"].items()]
        columns = tuple(rows[0]) if rows else ("peer",)
        lines += _table("Peers' time over ours at equal true error, W020 = 137.3", rows, columns)
        lines += [
            f"Charts: a curve ends where its next point would take more than {result['seconds_per_point']:g} s "
            f"(peers at 137.3 waves get all samples); {result['curves_cut_short']} curves do. Why each ends stands in "
            "contrast.json, as `curves_end`.",
            "",
        ]
        lines += [f"![time against true error]({name})" for name in result["charts"]]
    made = result["provenance"]
    return "\n".join([*lines, "", "Made with " + ", ".join(f"{k} {v}" for k, v in made.items()) + ".", ""])


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    return "–" if value is None else str(value)


def _table(title: str, rows: list[dict[str, Any]], columns: tuple[str, ...]) -> list[str]:
    lines = [f"## {title}", ""]
    if not rows:
        return [*lines, "None.", ""]
    lines += ["| " + " | ".join(columns).replace("_", " ") + " |", "|---" * len(columns) + "|"]
    for row in rows[:40]:
        lines.append("| " + " | ".join(_text(row.get(column)).replace("|", "\\|") for column in columns) + " |")
    if len(rows) > 40:
        lines.append(f"\nand {len(rows) - 40} more, in contrast.json.")
    return [*lines, ""]
