"""Accuracy against cost of the plan: one field point at several tolerances, error bars beside the time they took.

uv run python -m validation.tolerance [--band NIR] [--json]
"""

from __future__ import annotations

import argparse
import time

from cgi_wave.analysis import Task, analyse_field
from cgi_wave.budget.select import select_ghosts
from cgi_wave.budget.setting import band_setting
from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.paths import find_paths
from cgi_wave.report.output import to_json

TOLERANCES = (3e-3, 1e-3, 3e-4, 1e-4, 3e-5)


def study(band: str = "NIR", field: int = 1) -> list[dict[str, float]]:
    """One row per tolerance: pairs computed, seconds on one core, NMA error with its error bar, what was left out."""
    instrument = load_instrument()
    system = instrument.band(band)
    here = band_setting(system)
    paths = select_ghosts(here, find_paths(system))
    rows = []
    for tolerance in (TOLERANCES[0], *TOLERANCES):  # the first pass compiles and is dropped
        started = time.process_time()
        result = analyse_field(Task(instrument.raw, instrument.file, band, paths, tolerance, False), field)
        coherent = result.retrieval.coherent
        rows.append(
            {
                "tolerance": tolerance,
                "pairs": len(result.coherency.pairs),
                "cpu_seconds": time.process_time() - started,
                "nma_error": coherent.nma_error.value,
                "nma_error_bar": coherent.nma_error.error,
                "contrast_part": result.psi.coherent.contrast_error / result.retrieval.nominal.modulation.value,
                "left_out_part": result.psi.coherent.left_out,
            }
        )
    return rows[1:]


def main() -> None:
    """Print the table, or one JSON document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--band", default="NIR")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = study(options.band)
    if options.json:
        print(to_json({"band": options.band, "rows": rows}))
        return
    print(" ".join(f"{name:>14}" for name in rows[0]))
    for row in rows:
        print(" ".join(f"{value:>14.5g}" for value in row.values()))


if __name__ == "__main__":
    main()
