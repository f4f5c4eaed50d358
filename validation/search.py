"""The path search on the reference instrument: what it costs, what its bound saves, and what 512 probes miss.

    uv run python -m validation.search [BAND …] [--probes N] [--json]

Per band: ghosts by order, by first parasitic surface, and above 1e-5 of the nominal power, beside the paper's number
(families: paths that differ only in the arms they took);
visits with and without the bound on what can still reach the detector; and the same search with N probes (4096), which
contains the first: how many further ghosts it finds, their power together and the strongest of them.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import asdict
from typing import Any

from cgi_wave.budget.select import POWER_FLOOR
from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.paths import PROBES, Path, Search, explore
from cgi_wave.report.output import to_json

#: Ghosts that the paper found in its VIS/NIR and SWIR channels; its instrument is another one, and its limit the same.
PAPER = {"VIS": 39, "NIR": 39, "SWIR": 35}


def timed(*args: Any, **options: Any) -> tuple[Search, float]:
    """A search and its time, s: the shorter of two."""
    best = float("inf")
    for _ in range(2):
        start = time.perf_counter()
        found = explore(*args, **options)
        best = min(best, time.perf_counter() - start)
    return found, best


def census(paths: list[Path]) -> dict[str, Any]:
    """Counts of ghosts and their power together, relative to the nominal beams."""
    return {
        "ghosts": len(paths),
        "above": sum(path.estimate > POWER_FLOOR for path in paths),
        "families_above": len({path.history for path in paths if path.estimate > POWER_FLOOR}),
        "by_order": dict(sorted(Counter(path.order for path in paths).items())),
        "by_first_surface": dict(Counter(path.history[0][0] for path in paths).most_common()),
        "power": sum(path.estimate for path in paths),
        "strongest": max((path.estimate for path in paths), default=0.0),
    }


def study_band(name: str, probes: int) -> dict[str, Any]:
    """One band of the reference instrument."""
    system = load_instrument().band(name)
    found, seconds = timed(system)
    whole, unpruned = timed(system, prune=False)
    more, longer = timed(system, probes=probes)
    known = {path.steps for path in found.paths}
    ghosts = [path for path in found.paths if path.order > 0]
    statistics = {key: value for key, value in asdict(found).items() if key != "paths"}
    return {
        "band": name, "paper": next((n for key, n in PAPER.items() if name.startswith(key)), None), "probes": PROBES,
        **census(ghosts), "seconds": seconds, "search": statistics,
        "visits_without_bound": whole.visits, "seconds_without_bound": unpruned,
        "same_without_bound": whole.paths == found.paths,
        "more_probes": probes, "seconds_more": longer,
        "missing_with_more": len(known - {path.steps for path in more.paths}),
        "further": census([path for path in more.paths if path.steps not in known]),
    }  # fmt: skip


def study(bands: list[str] | None = None, probes: int = 4096) -> list[dict[str, Any]]:
    """All bands asked for (none: all) as plain data."""
    return [study_band(name, probes) for name in bands or load_instrument().bands]


def main() -> None:
    """Print the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bands", nargs="*", help="bands of the reference instrument (all)")
    parser.add_argument("--probes", type=int, default=4096, help="of the finer search, a power of two (4096)")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    arguments = parser.parse_args()
    results = study(arguments.bands, arguments.probes)
    if arguments.json:
        print(to_json({"bands": results}))
        return
    for r in results:
        print(f"{r['band']}: {r['ghosts']} ghosts, by order {r['by_order']}; power together {r['power']:.4f}")
        print(f"  {r['above']} above {POWER_FLOOR:g} of the nominal power, in {r['families_above']} families "
              f"(paper: {r['paper']} ghosts)")  # fmt: skip
        print(f"  turned first at {', '.join(f'{k} {v}' for k, v in r['by_first_surface'].items())}")
        print(f"  {r['seconds']:.2f} s: {r['search']}")
        print(f"  without the bound {r['visits_without_bound']} visits, {r['seconds_without_bound']:.2f} s, "
              f"{'the same' if r['same_without_bound'] else 'OTHER'} paths")  # fmt: skip
        f = r["further"]
        print(f"  {r['more_probes']} probes, {r['seconds_more']:.2f} s: {f['ghosts']} further ghosts "
              f"({f['by_order']}), power together {f['power']:.2e}, strongest {f['strongest']:.1e}; "
              f"{r['missing_with_more']} lost")  # fmt: skip


if __name__ == "__main__":
    main()
