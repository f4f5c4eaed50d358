"""Ranking of remedies: scaled terms against a trace from the beginning, and linear guesses against the exact gain.

uv run python -m validation.ranking [--band NIR] [--instrument FILE] [--json]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.analysis import setting_of, zone_rows
from cgi_wave.budget.attribution import faces
from cgi_wave.budget.outcome import Seen, rescaled, see
from cgi_wave.budget.remedies import Remedy, Target, coating_remedies, power_factors, scales_exactly
from cgi_wave.fringes.nma import retrieve
from cgi_wave.fringes.terms import Factors
from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.ranking import trace_remedy
from cgi_wave.report.output import to_json
from validation.study_page import table

FACTORS = (0.9, 0.5, 0.25, 0.1, 0.0)
#: Remedies that are compared in detail: those with the largest gains.
LARGEST = 4


def study(band: str = "NIR", instrument: str | None = None, tolerance: float = DEFAULT_TOLERANCE) -> dict[str, Any]:
    """Three lists of rows, all of the NMA error at the zone's centre.

    ``traced``: the largest remedies by scaling beside the same coatings put into the instrument and everything done
    again, search and selection of ghosts included: some then fall below the power floor, and some pairs below the
    tolerance. ``same terms``: the difference if the unchanged instrument's ghosts are traced, and only
    pairs are taken that were computed in both: what is left is rounding, and contrasts computed to another accuracy.
    ``linear``: gains for
    several reflectances beside the guess by power and the tangent. ``sums``: the gain of a coating beside the sum of
    the gains of its surfaces one by one.
    """
    loaded = load_instrument(instrument)
    system = loaded.band(band)
    ((before, _),) = trace_remedy(loaded.raw, loaded.file, band, None, 1, tolerance)
    ghosts = [*before.point.paths[2:], *before.untraced.paths]

    def remedies(factor: float) -> dict[tuple[str, str], Any]:
        found = coating_remedies(system, ghosts, Target(factor))
        return {(remedy.kind, remedy.name): remedy for remedy in found if scales_exactly(system, remedy)}

    halves = {key: rescaled(system, before, remedy) for key, remedy in remedies(0.5).items()}
    largest = sorted(halves, key=lambda key: -abs(halves[key].gain))[:LARGEST]
    here = setting_of(loaded.raw, loaded.file, band)
    x0 = system.field_points()[0]
    traced = []
    for key in largest:
        remedy = remedies(0.5)[key]
        changed = replace(here, system=remedy.apply(system, loaded))
        same = see(changed, before.point.paths, before.untraced, x0, zone_rows(system, x0), tolerance)
        ((after, _),) = trace_remedy(loaded.raw, loaded.file, band, remedy, 1, tolerance)
        again = after.retrieval.coherent
        traced.append(
            {
                "remedy": key[1],
                "scaled": halves[key].nma_error,
                "traced again": again.nma_error.value,
                "difference": halves[key].nma_error - again.nma_error.value,
                "same terms": same_terms(system, before, same, remedy),
                "O/B difference": halves[key].offset - again.offset_over_baseline.value,
                "power not traced again": float(after.untraced.power.sum() - before.untraced.power.sum()),
                "ghosts traced": f"{len(before.point.paths) - 2}, {len(after.point.paths) - 2}",
                "pairs computed": f"{len(before.terms.coherency.pairs)}, {len(after.terms.coherency.pairs)}",
                "error bar": again.nma_error.error,
            }
        )
    linear = []
    for key in largest:
        for factor in FACTORS:
            got = rescaled(system, before, remedies(factor)[key])
            linear.append(
                {
                    "remedy": key[1],
                    "factor": factor,
                    "gain": got.gain,
                    "error": got.gain_error,
                    "guess": got.guess,
                    "guess − gain": got.guess - got.gain,
                    "tangent": got.tangent,
                    "tangent − gain": None if got.tangent is None else got.tangent - got.gain,
                }
            )
    sums = []
    for (kind, name), remedy in remedies(0.5).items():
        if kind == "coating":
            alone = [halves["surface", surface].gain for surface in remedy.surfaces]
            gain = halves[kind, name].gain
            sums.append({"coating": name, "surfaces": len(alone), "gain": gain, "sum of its surfaces": sum(alone)})
    return {
        "band": band,
        "nma_error": before.retrieval.coherent.nma_error.value,
        "nma_error_bar": before.retrieval.coherent.nma_error.error,
        "surfaces with ghosts": len({name for path in ghosts for name in faces(path)}),
        "traced": traced,
        "linear": linear,
        "sums": sums,
    }


def same_terms(system: OpticalSystem, before: Seen, after: Seen, remedy: Remedy) -> float:
    """Scaled less traced NMA error of the same ghosts, with the pairs that were computed in both."""
    ends = [{(pair.m, pair.l) for pair in seen.terms.coherency.pairs} for seen in (before, after)]
    assert before.point.coherency.labels == after.point.coherency.labels
    results = []
    for seen, power in (
        (before, power_factors(system, before.point.paths, remedy.coatings or {})),
        (after, np.ones(len(after.point.paths))),
    ):
        factors = Factors.of_powers(seen.terms.coherency, power)
        both = np.array([(pair.m, pair.l) in ends[0] & ends[1] for pair in seen.terms.coherency.pairs])
        found = retrieve(seen.terms.psi(replace(factors, pair=factors.pair * both)))
        results.append(found.coherent.nma_error.value)
    return results[0] - results[1]


def main() -> None:
    """Print the tables, or one JSON document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--band", default="NIR")
    parser.add_argument("--instrument")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = study(options.band, options.instrument)
    if options.json:
        print(to_json(found))
        return
    print(f"{found['band']}: NMA error {found['nma_error']:.5f} ± {found['nma_error_bar']:.5f}\n")
    for name in ("traced", "linear", "sums"):
        print(table(found[name]))


if __name__ == "__main__":
    main()
