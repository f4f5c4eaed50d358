"""Speed in the study `contrast`: timings at given defocus, charts of time against true error, peers, and the report."""

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
from cgi_wave.wave.methods.base import OverlapMethod
from validation import cases as library
from validation.oracles.agree import Reference, all_references
from validation.peers import available

if TYPE_CHECKING:
    from validation.contrast import Method

ACCURACY = 1e-8
TIMED = {10.0: 100, 1000.0: 60, 5000.0: 24}  # waves -> typical cases
CAUSTICS = 24
REGIMES = (0.0, 1.25, 10.25, 137.3, 1000.25, 5000.25)
GEOMETRIES = {
    "centred": {},
    "sheared": {"shift_x": 0.37, "shift_y": -0.46},
    "sheared, obscured": {"shift_x": 0.37, "shift_y": -0.46, "obscuration": 0.33},
}
#: 10 % of every other aberration, of mixed signs; of one wave where there is no defocus.
OTHERS = {"w040": 0.1, "w131": -0.1, "w222": 0.1, "w111": 0.1}
TOLERANCES = tuple(10.0**-k for k in range(2, 13))
SAMPLES = (64, 128, 256, 512, 1024, 2048, 4096)
HEAVY = {"hcipy": 1024}  # its supersampling takes sixteen times the memory
LONGEST = 3.0  # seconds after which a method or a peer is not asked for more
TARGETS = (1e-3, 1e-4, 1e-5, 1e-6)
PEER_REGIME = 137.3

Point = tuple[float, float]  # true error, seconds


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


def clock(call: Callable[[], Any], least: float = 0.03) -> tuple[Any, float]:
    """Result and shortest wall time of three calls if they fit into a second, of more while they last below `least`."""
    times: list[float] = []
    while len(times) < 3 or (sum(times) < least and len(times) < 200):
        started = time.perf_counter()
        result = call()
        times.append(time.perf_counter() - started)
        if sum(times) > 1.0:
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


def regimes(largest: float) -> dict[tuple[float, str, str], library.Case]:
    """One case for each chart: defocus, geometry, other aberrations."""
    found = {}
    for w in REGIMES:
        for geometry, where in GEOMETRIES.items():
            for others in ("no others", "10 % of others"):
                size = 0.0 if others == "no others" else (w or 1.0)
                values = {name: size * share for name, share in OTHERS.items()}
                if w <= largest:
                    found[w, geometry, others] = library.Case("chart", w, **values, **where)
    return found


def _curve(ask: Callable[[Any], Any], values: Sequence[float], truth: complex) -> list[Point]:
    points = []
    for value in values:
        try:
            found, seconds = clock(lambda value=value: ask(value))
        except CgiWaveError:
            break
        points.append((abs(getattr(found, "value", found) - truth), seconds))
        if seconds > LONGEST:
            break
    return points


def charts(
    method: Method,
    methods: Sequence[OverlapMethod],
    out: Path,
    jobs: int,
    largest: float,
    samples: int,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Work-precision diagrams as PNG, one figure for each defocus; and how far the method is ahead of each peer."""
    chosen = regimes(largest)
    truth = dict(zip(chosen, all_references(list(chosen.values()), out / "oracles", jobs, say), strict=True))
    peers = available()
    curves: dict[tuple[float, str, str], dict[str, list[Point]]] = {}
    for key, case in chosen.items():
        say(f"chart: {key[0]:g} waves, {key[1]}, {key[2]}")
        pair, value = HopkinsPair(**case.coefficients), truth[key].value
        with one_thread():
            found = {"this package": _curve(lambda tol, pair=pair: method(pair, tol), TOLERANCES, value)}
            m, l = pair.pupil_fields()  # noqa: E741
            for each in methods:
                if each.supports(m, l, 1.0) is None:
                    ask = lambda tol, each=each, m=m, l=l: each.evaluate(m, l, 1.0, tol)  # noqa: E731, E741
                    found[each.name] = _curve(ask, TOLERANCES, value)
            for name, peer in peers.items():
                sizes = [n for n in SAMPLES if n <= min(samples, HEAVY.get(name, samples))]
                found[name] = _curve(lambda n, peer=peer, pair=pair: peer(pair, n), sizes, value)
        curves[key] = found
    files = [_draw(w, {k: v for k, v in curves.items() if k[0] == w}, truth, out) for w in REGIMES if w <= largest]
    return {
        "charts": files,
        "curves": [{"w020": w, "geometry": g, "others": o, "methods": found} for (w, g, o), found in curves.items()],
        **speedups({k: v for k, v in curves.items() if k[0] == PEER_REGIME}, list(peers)),
    }


def time_to(points: Sequence[Point], target: float) -> float | None:
    """Seconds at which a curve, ordered by effort, has come below an error for good."""
    reached = None
    for error, seconds in reversed(points):
        if error > target:
            break
        reached = seconds
    return reached


def speedups(curves: dict[tuple[float, str, str], dict[str, list[Point]]], peers: Sequence[str]) -> dict[str, Any]:
    """Time of each peer over ours at equal error, the median over the charts of one defocus.

    `at_best`: at the smallest error that the peer reaches with any number of samples. The headline is against the peer
    with the least such ratio.
    """
    table: dict[str, dict[str, float | None]] = {}
    for name in peers:
        row: dict[str, float | None] = {}
        for target in TARGETS:
            row[f"{target:g}"] = _middle_ratio(curves, name, lambda _, target=target: target)
        row["at_best"] = _middle_ratio(curves, name, lambda points: min(error for error, _ in points))
        table[name] = row
    best = [row["at_best"] for row in table.values() if row["at_best"] is not None]
    return {"speedup_vs_best_peer": min(best) if best else None, "speedup_vs_peers": table}


def _middle_ratio(curves: dict[Any, dict[str, list[Point]]], name: str, target: Callable[..., float]) -> float | None:
    ratios = []
    for found in curves.values():
        theirs, ours = found.get(name, []), found["this package"]
        if not theirs:
            continue
        at = target(theirs)
        spent = min((s for error, s in theirs if error <= at), default=None)
        own = time_to(ours, at)
        if spent is not None and own is not None:
            ratios.append(spent / own)
    return float(np.median(ratios)) if ratios else None


def _draw(
    w: float,
    curves: dict[tuple[float, str, str], dict[str, list[Point]]],
    truth: dict[tuple[float, str, str], Reference],
    out: Path,
) -> str:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(13, 7.5), sharex=True, sharey=True, layout="constrained")
    for row, others in enumerate(("no others", "10 % of others")):
        for column, geometry in enumerate(GEOMETRIES):
            ax, key = axes[row, column], (w, geometry, others)
            for name, points in curves[key].items():
                style = {"lw": 2.2, "color": "black", "marker": "o"} if name == "this package" else {"marker": "."}
                ax.loglog([max(e, 1e-16) for e, _ in points], [1e3 * s for _, s in points], label=name, **style)
            ax.axvline(abs(truth[key].value), color="grey", ls=":", lw=1)
            ax.set_title(f"{geometry}, {others}, |γ| = {abs(truth[key].value):.2g} (dotted)", fontsize=9)
            ax.grid(alpha=0.3)
    for ax in axes[1]:
        ax.set_xlabel("true error")
    for ax in axes[:, 0]:
        ax.set_ylabel("time / ms, one thread")
    axes[0, 0].invert_xaxis()
    handles = {label: h for ax in axes.flat for h, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    axes[0, 0].legend(handles.values(), handles.keys(), fontsize=8)
    figure.suptitle(f"W020 = {w:g}: time against true error; to the right is better, lower is faster")
    name = f"work-precision-{w:g}.png"
    figure.savefig(out / name, dpi=110)
    plt.close(figure)
    return name
