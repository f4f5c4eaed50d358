"""The study `contrast`: error bounds of the overlap contrast against two oracles, its speed, and its peers.

    uv run --group validation python -m validation.contrast [--json] [--cases N] [--jobs J] [--out DIR]

Random and adversarial cases (see `validation/cases.py`) go through both oracles, which have to agree, and through the
method. Oracle values for most pairs come with the source; `--minutes` computes others, and keeps them in DIR/oracles.
Charts of time against true error, and the report, are written to DIR. Some eight minutes; progress goes to standard
error.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import cgi_wave
from cgi_wave.errors import CgiWaveError, InputError
from cgi_wave.report.output import to_json
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods.auto import method
from cgi_wave.wave.methods.base import Estimate, OverlapMethod
from validation import cases as library
from validation.oracles.agree import Reference, disagreement, progress, references, waves

#: A method as the study calls it: the pair and the tolerance.
Method = Callable[[HopkinsPair, float], Estimate]
TOLERANCE = 1e-8
OUT = Path("out/validation/contrast")
#: That a point of a chart may be expected to take.
SECONDS = 1.0


def relative_tolerance(w020: float) -> float:
    """|γ| falls as 1/(π|W020|): a thousandth of half of that."""
    return 1e-3 / (2.0 * math.pi * max(abs(w020), 1.0))


def package(pair: HopkinsPair, tol: float) -> Estimate:
    """What the package answers when no method is named."""
    from cgi_wave.wave.hopkins import contrast

    return contrast(pair, tol=tol)


def quadrature(pair: HopkinsPair, tol: float) -> Estimate:
    """Boundary-fitted quadrature on the pupil fields of the pair."""
    from cgi_wave.wave.overlap import overlap

    found = overlap(*pair.pupil_fields(), np.array([1.0]), tol)
    value = found.value[0] * np.exp(2j * np.pi * found.opd_m[0])
    return Estimate(complex(value), float(found.error_bound[0]), found.method, found.nodes, found.seconds)


#: Methods of the package whose curves stand in the charts beside the boundary integrals.
CHARTED = ("panels", "fft", "pruned-fft", "chirp-z", "nufft", "fresnel")
METHODS: dict[str, Method] = {"package": package, "quadrature": quadrature}


@dataclass(frozen=True)
class Run:
    """One case at one tolerance: the method's estimate, or the reason why it refused."""

    case: library.Case
    reference: Reference
    tol: float
    estimate: Estimate | None
    refusal: str = ""

    @property
    def error(self) -> float:
        """|value − oracle|; NaN for a refusal."""
        return abs(self.estimate.value - self.reference.value) if self.estimate else math.nan

    @property
    def violated(self) -> bool:
        """The bound does not hold, whatever the oracle's own error may be. A value that is no number violates it."""
        return self.estimate is not None and not self.error <= self.estimate.error_bound + self.reference.error

    @property
    def doubtful(self) -> bool:
        """The bound does not hold if the better oracle is as good as the two agree (and they usually do to 1e-14)."""
        slack = self.reference.difference + 2e-14
        return self.estimate is not None and not self.error <= self.estimate.error_bound + slack

    @property
    def broken_promise(self) -> bool:
        """The bound exceeds the tolerance that was asked for: the method should have refused."""
        return self.estimate is not None and not self.estimate.error_bound <= self.tol

    def row(self) -> dict[str, Any]:
        """For the report."""
        row: dict[str, Any] = {"kind": self.case.kind, **self.case.coefficients, "tolerance": self.tol}
        row["oracle"] = [self.reference.value.real, self.reference.value.imag]
        if self.estimate is None:
            return {**row, "refusal": self.refusal}
        return {**row, "error": self.error, "error_bound": self.estimate.error_bound, "method": self.estimate.method}


def run(method: Method, case: library.Case, reference: Reference, tol: float) -> Run:
    """The method on one case; a named error is a refusal, any other is a defect and goes through."""
    try:
        estimate = method(HopkinsPair(**case.coefficients), tol)
    except CgiWaveError as error:
        return Run(case, reference, tol, None, f"{type(error).__name__}: {error}")
    return Run(case, reference, tol, estimate)


def bounds(runs: Sequence[Run]) -> dict[str, Any]:
    """What the runs say about error bounds.

    `bound_over_error_median` is over the runs whose true error the oracles can tell from zero (more than twice their
    own difference); `bound_over_error_floor_median` is over all, with that difference, or 1e-15, as least error.
    """
    done = [r for r in runs if r.estimate is not None]
    told = [r for r in done if r.error > 2.0 * r.reference.difference and r.error > 1e-15]
    floor = [r.estimate.error_bound / max(r.error, r.reference.difference, 1e-15) for r in done if r.estimate]
    ratio = [r.estimate.error_bound / r.error for r in told if r.estimate]
    reasons = Counter(r.refusal.split(":")[0] + ": " + r.refusal.split(":")[1].strip() for r in runs if r.refusal)
    return {
        "runs": len(runs),
        "bound_violations": sum(r.violated for r in runs),
        "bound_violations_if_oracles_are_as_good_as_they_agree": sum(r.doubtful for r in runs),
        "bounds_above_tolerance": sum(r.broken_promise for r in runs),
        "bound_over_error_median": float(np.median(ratio)) if ratio else None,
        "bound_over_error_90": float(np.quantile(ratio, 0.9)) if ratio else None,
        "bound_over_error_floor_median": float(np.median(floor)) if floor else None,
        "errors_told_from_zero": len(told),
        "largest_error": max((r.error for r in done), default=None),
        "refused": sum(r.estimate is None for r in runs),
        "refusals": dict(reasons.most_common(20)),
    }


def within(cases: Sequence[library.Case], largest: float) -> list[library.Case]:
    """Cases whose coefficients stay below `largest` waves together."""
    return [c for c in cases if waves(c) <= largest]


def study(
    cases: int = 11500,
    seed: int = 1,
    method: Method = package,
    methods: Mapping[str, OverlapMethod] = MappingProxyType({}),
    out: Path = OUT,
    jobs: int = 1,
    largest: float = math.inf,
    charts: bool = True,
    samples: int = 4096,
    minutes: float = 0.0,
    seconds: float = SECONDS,
    say: Callable[[str], None] = progress,
) -> dict[str, Any]:
    """Runs the study, writes DIR/report.md with its charts and DIR/contrast.json, returns the figures.

    cases : random ones, beside all adversarial ones; method : what is judged; methods : for the charts beside it, by
    name; jobs : threads for the oracles; minutes : that they may take for what is not on disk, the cheapest cases first
    (`not_computed` says how many were left; inf for all); seconds : that a point of a chart may take before its curve
    ends (see ``contrast_charts``). For trying out: largest : waves, leaves out cases and regimes above it; samples :
    across the pupil, the most that peers are given.
    """
    from validation import contrast_charts, contrast_report, contrast_speed

    out.mkdir(parents=True, exist_ok=True)
    drawn, hard = library.random_cases(cases, seed), library.adversarial_cases(largest)
    every = within([*drawn, *hard], largest)
    asked = references(every, out / "oracles", jobs, say, minutes)
    left = [c for c, r in zip(every, asked, strict=True) if r is None]
    every = [c for c, r in zip(every, asked, strict=True) if r is not None]
    truth = [r for r in asked if r is not None]
    if not truth:
        raise InputError("study contrast", "minutes", minutes, "leave no value of the oracles", "give --minutes 20")
    differing = [disagreement(c, r) for c, r in zip(every, truth, strict=True) if not r.agreed]
    runs: list[Run] = []
    for number, (case, reference) in enumerate(zip(every, truth, strict=True)):
        tolerances = {TOLERANCE, relative_tolerance(case.w020)} if case.w020 else {TOLERANCE}
        runs += [run(method, case, reference, tol) for tol in sorted(tolerances) if reference.agreed]
        if number % 500 == 499:
            say(f"method: {number + 1} of {len(every)} cases")
    random_kind = [r for r in runs if r.case.kind.startswith("random")]
    fixed, following = [r for r in runs if r.tol == TOLERANCE], [r for r in runs if r.tol != TOLERANCE]
    result: dict[str, Any] = {
        **bounds(fixed),
        # a violation counts at whichever tolerance it shows
        "bound_violations": sum(r.violated for r in runs),
        "tolerance": TOLERANCE,
        "at_tolerance_following_defocus": bounds(following),
        "cases": len(every),
        "not_computed": len(left),
        "most_waves": max((waves(c) for c in every), default=None),
        "random_cases": sum(c.kind.startswith("random") for c in every),
        "adversarial_cases": sum(not c.kind.startswith("random") for c in every),
        "random": bounds(random_kind),
        "oracles": {
            "agreed": sum(r.agreed for r in truth),
            "disagreements": differing,
            "largest_difference": max(r.difference for r in truth),
            "median_difference": float(np.median([r.difference for r in truth])),
            "largest_claim": max(r.error for r in truth),
            "seconds": sum(r.seconds for r in truth),
        },
        "violations": [r.row() for r in runs if r.violated][:200],
        "doubtful": [r.row() for r in runs if r.doubtful and not r.violated][:50],
        "refused_cases": [r.row() for r in runs if r.estimate is None][:200],
        **contrast_speed.timings(method, out, seed, jobs, largest, say),
    }
    if charts:
        result |= contrast_charts.charts(method, methods, out, jobs, largest, samples, seconds, say)
    result["provenance"] = {
        "version": cgi_wave.__version__, "seed": seed, "python": platform.python_version(),
        "numpy": np.__version__, "machine": platform.processor() or platform.machine(),
    }  # fmt: skip
    (out / "contrast.json").write_text(json.dumps(result, indent=1), encoding="utf-8")
    (out / "report.md").write_text(contrast_report.report(result), encoding="utf-8")
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; see the module's docstring."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print the figures as one JSON document")
    parser.add_argument("--cases", type=int, default=11500, help="random cases (default %(default)s)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", choices=sorted(METHODS), default="package")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--jobs", type=int, default=1, help="threads for the oracles")
    parser.add_argument(
        "--minutes", type=float, default=0.0,
        help="for oracle values that do not come with the source (default %(default)s, inf for all: hours)",
    )  # fmt: skip
    parser.add_argument("--largest", type=float, default=math.inf, help="leave out cases with more waves than this")
    parser.add_argument("--samples", type=int, default=4096, help="most samples across the pupil given to peers")
    parser.add_argument(
        "--seconds-per-point", type=float, default=SECONDS,
        help="a chart's curve ends where its next point would take longer (default %(default)s)",
    )  # fmt: skip
    parser.add_argument("--no-charts", dest="charts", action="store_false")
    options = parser.parse_args(arguments)
    try:
        result = study(
            options.cases, options.seed, METHODS[options.method], {n: method(n) for n in CHARTED},
            options.out, options.jobs, options.largest,
            options.charts, options.samples, options.minutes, options.seconds_per_point,
        )  # fmt: skip
    except KeyboardInterrupt:
        print(f"interrupted; what the oracles said is in {options.out / 'oracles'}", file=sys.stderr)
        return 130
    if options.json:
        print(to_json(result))
    else:
        for name, value in result.items():
            if not isinstance(value, dict | list):
                print(f"{name:55} {value}")
        print(f"report: {options.out / 'report.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
