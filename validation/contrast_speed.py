"""Speed in the study `contrast`: timings at given defocus, at two tolerances, on one thread."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cgi_wave.errors import CgiWaveError
from cgi_wave.wave.hopkins import HopkinsPair
from validation import cases as library
from validation.oracles.agree import Reference, all_references

if TYPE_CHECKING:
    from validation.contrast import Method

ACCURACY = 1e-8
TIMED = {10.0: 100, 1000.0: 60, 5000.0: 24}  # waves -> typical cases
CAUSTICS = 24


@contextmanager
def one_thread() -> Iterator[None]:
    """No library takes a second thread inside."""
    import numba
    from threadpoolctl import threadpool_limits

    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        numba.set_num_threads(before)


def clock(call: Callable[[], Any], least: float = 0.03, most: float = 1.0) -> tuple[Any, float]:
    """Result and shortest wall time of three calls if they fit into `most` s, of more while they last below `least`."""
    times: list[float] = []
    while len(times) < 3 or (sum(times) < least and len(times) < 200):
        started = time.perf_counter()
        result = call()
        times.append(time.perf_counter() - started)
        if sum(times) > most:
            break
    return result, min(times)


def _timed(method: Method, cases: Sequence[library.Case], truth: Sequence[Reference], tol: float) -> dict[str, Any]:
    """Median time in ms over cases; a refusal, or an error above what was asked for, counts as endless."""
    spent, worst, refused, nodes = [], 0.0, 0, []
    for case, reference in zip(cases, truth, strict=True):
        pair = HopkinsPair(**case.coefficients)
        try:
            estimate, seconds = clock(lambda pair=pair: method(pair, tol))
        except CgiWaveError:
            refused += 1
            spent.append(math.inf)
            continue
        error = abs(estimate.value - reference.value)
        worst = max(worst, error)
        nodes.append(estimate.nodes)
        spent.append(1e3 * seconds if error <= tol + reference.error else math.inf)
    middle = float(np.median(spent)) if spent else math.inf
    return {
        "ms": middle if math.isfinite(middle) else None,
        "ms_90": next((t for t in sorted(spent)[math.ceil(0.9 * len(spent)) - 1 :] if math.isfinite(t)), None),
        "largest_error": worst,
        "refused": refused,
        "failed": sum(not math.isfinite(t) for t in spent) - refused,
        "cases": len(cases),
        "nodes": float(np.median(nodes)) if nodes else None,
        "tolerance": tol,
    }


def timings(
    method: Method, out: Path, seed: int, jobs: int, largest: float, say: Callable[[str], None]
) -> dict[str, Any]:
    """Times on typical and caustic cases at given defocus, at 1e-8 and at a tolerance that follows 1/|W020|."""
    sets = {f"at_{w:.0f}_waves": (w, library.typical_cases(n, w, seed)) for w, n in TIMED.items() if w <= largest}
    if largest >= 1000.0:
        caustics = library.caustic_cases(CAUSTICS, 1000.0, seed)
        sets["caustic_1000"] = (1000.0, caustics)
        for kind in sorted({c.kind for c in caustics}):
            sets[f"{kind.replace(' ', '_')}_1000"] = (1000.0, [c for c in caustics if c.kind == kind])
    details: dict[str, Any] = {}
    for name, (w, cases) in sets.items():
        truth = all_references(cases, out / "oracles", jobs, say)
        say(f"timing: {name}")
        with one_thread():
            details[name] = _timed(method, cases, truth, ACCURACY)
            details[f"{name}_relative"] = _timed(method, cases, truth, 1e-3 / (2.0 * math.pi * w))
    return {**{f"ms_{name}": found["ms"] for name, found in details.items()}, "timings": details}
