"""Charts of the study `contrast`: time against true error of every method and peer, within a budget, and who is ahead.

A curve goes on to the next tolerance, or to twice as many samples, as long as that is expected to take less than a
number of seconds: expected from the time of the point before and how the cost grows, which is known. At the defocus at
which peers are compared, they get all the samples. What was left out is told, on the charts and beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cgi_wave.errors import CgiWaveError
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods.auto import prices
from cgi_wave.wave.methods.base import OverlapMethod
from validation import cases as library
from validation.contrast_plots import OWN, draw
from validation.contrast_speed import clock, one_thread
from validation.oracles.agree import all_references
from validation.peers import Peer, available

if TYPE_CHECKING:
    from validation.contrast import Method

REGIMES = (0.0, 1.25, 10.25, 137.3, 1000.25, 5000.25)
GEOMETRIES = {
    "centred": {},
    "sheared": {"shift_x": 0.37, "shift_y": -0.46},
    "sheared, obscured": {"shift_x": 0.37, "shift_y": -0.46, "obscuration": 0.33},
}
#: 10 % of every other aberration, of mixed signs; of one wave where there is no defocus.
ABERRATIONS = ("no others", "10 % of others")
OTHERS = {"w040": 0.1, "w131": -0.1, "w222": 0.1, "w111": 0.1}
TOLERANCES = tuple(10.0**-k for k in range(2, 13))
SAMPLES = (64, 128, 256, 512, 1024, 2048, 4096)
HEAVY = {"hcipy": 1024}  # its supersampling takes sixteen times the memory
TARGETS = (1e-3, 1e-4, 1e-5, 1e-6)
PEER_REGIME = 137.3
#: Seconds that one point of a peer may take there, so that no slow machine is held up for long.
PEER_SECONDS = 60.0

Key = tuple[float, str, str]  # defocus, geometry, other aberrations


@dataclass
class Curve:
    """Points (true error, seconds) in the order of effort; end: why there are no more; left: seconds that the next
    one would have taken, 0 where that is not the reason."""

    points: list[tuple[float, float]] = field(default_factory=list)
    end: str = ""
    left: float = 0.0


def regimes(largest: float) -> dict[Key, library.Case]:
    """One case for each chart."""
    found = {}
    for w in REGIMES:
        for geometry, where in GEOMETRIES.items():
            for others in ABERRATIONS:
                size = 0.0 if others == ABERRATIONS[0] else (w or 1.0)
                values = {name: size * share for name, share in OTHERS.items()}
                if w <= largest:
                    found[w, geometry, others] = library.Case("chart", w, **values, **where)
    return found


def curve(
    ask: Callable[[Any], Any],
    values: Sequence[Any],
    truth: complex,
    expected: Callable[[Any, Any, float], float],
    seconds: float,
    what: str,
    most: float = 0.15,
) -> Curve:
    """Time and true error for each of ``values``, until one is refused or expected to take more than ``seconds``.

    expected(value, value before or None, its seconds): seconds of the next point. what: "samples" or "tolerance";
    most : seconds over which a call is repeated.
    """
    found, before, spent = Curve(), None, 0.0
    for value in values:
        needs = expected(value, before, spent)
        if needs > seconds:
            return Curve(found.points, f"stopped: {what} {value:g} would take {needs:.2g} s", needs)
        try:
            result, spent = clock(lambda value=value: ask(value), most=most)
        except CgiWaveError as error:
            return Curve(found.points, f"refused: {what} {value:g}: {type(error).__name__}: {error}")
        found.points.append((abs(getattr(result, "value", result) - truth), spent))
        before = value
    return Curve(found.points, "all asked for")


def _package(method: Method, pair: HopkinsPair, truth: complex, seconds: float) -> Curve:
    return curve(lambda tol: method(pair, tol), TOLERANCES, truth, lambda *of: of[2], seconds, "tolerance")


def _method(name: str, each: OverlapMethod, pair: HopkinsPair, truth: complex, seconds: float) -> Curve:
    """A method of the package; its first point is expected to take what its price on this machine says."""
    m, l = pair.pupil_fields()  # noqa: E741
    reason = each.supports(m, l, 1.0)
    if reason is not None:
        return Curve(end=f"refused: {reason}")
    call, step = prices().get(name, (0.0, 0.0))

    def expected(tol: float, before: float | None, spent: float) -> float:
        steps = each.cost(m, l, 1.0, tol)
        if not np.isfinite(steps):
            return 0.0  # it refuses at once, and says why
        if before is None:
            return call + step * steps
        return float(spent * max(steps / max(each.cost(m, l, 1.0, before), 1.0), 1.0))

    return curve(lambda tol: each.evaluate(m, l, 1.0, tol), TOLERANCES, truth, expected, seconds, "tolerance")


def _peer(name: str, peer: Peer, pair: HopkinsPair, truth: complex, seconds: float, samples: int) -> Curve:
    """A peer; its time grows as the number of samples, the square of what they are across."""
    most = min(samples, HEAVY.get(name, samples))
    sizes = [n for n in SAMPLES if n <= most]
    found = curve(
        lambda n: peer(pair, n), sizes, truth, lambda n, before, spent: spent * (n / (before or n)) ** 2, seconds,
        "samples", 1.0 if seconds >= PEER_SECONDS else 0.15,
    )  # fmt: skip
    return Curve(found.points, f"all asked for, up to {most} samples") if found.end == "all asked for" else found


def _given(w020: float, seconds: float) -> float:
    """Seconds that a peer's point may take."""
    return max(seconds, PEER_SECONDS) if w020 == PEER_REGIME else seconds


def _warm(methods: Sequence[OverlapMethod]) -> None:
    """Compile and plan before a clock runs."""
    for pair in (HopkinsPair(w020=0.5, shift_x=0.3), HopkinsPair(w020=0.5, shift_x=0.3, obscuration=0.3)):
        fields = pair.pupil_fields()
        for each in methods:
            try:
                each.evaluate(*fields, 1.0, 0.03)
            except CgiWaveError:  # told where its curve would be
                continue


def charts(
    method: Method,
    methods: Mapping[str, OverlapMethod],
    out: Path,
    jobs: int,
    largest: float,
    samples: int,
    seconds: float,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Work-precision diagrams as PNG, one figure for each defocus; and how far the method is ahead of each peer.

    seconds : that a point may be expected to take; samples : the most given to peers.
    """
    chosen = regimes(largest)
    truth = dict(zip(chosen, all_references(list(chosen.values()), out / "oracles", jobs, say), strict=True))
    peers = available()
    curves: dict[Key, dict[str, Curve]] = {}
    with one_thread():
        _warm(list(methods.values()))
        for key, case in chosen.items():
            say(f"chart: {key[0]:g} waves, {key[1]}, {key[2]}")
            pair, value = HopkinsPair(**case.coefficients), truth[key].value
            method(pair, TOLERANCES[0])
            found = {OWN: _package(method, pair, value, seconds)}
            found |= {name: _method(name, each, pair, value, seconds) for name, each in methods.items()}
            given = _given(key[0], seconds)
            found |= {name: _peer(name, peer, pair, value, given, samples) for name, peer in peers.items()}
            curves[key] = found
    sizes = {key: abs(reference.value) for key, reference in truth.items()}
    limits = {w: f"limit {seconds:g} s" + (f", for others {_given(w, seconds):g} s" if w == PEER_REGIME else "")
              for w in REGIMES if w <= largest}  # fmt: skip
    files = [draw(w, curves, sizes, list(GEOMETRIES), ABERRATIONS, limit, out) for w, limit in limits.items()]
    places = [{"w020": w, "geometry": g, "others": o} for w, g, o in curves]
    return {
        "charts": files,
        "seconds_per_point": seconds,
        "curves": [
            {**place, "methods": {name: each.points for name, each in found.items()}}
            for place, found in zip(places, curves.values(), strict=True)
        ],
        "curves_end": [
            {**place, **{name: each.end for name, each in found.items()}}
            for place, found in zip(places, curves.values(), strict=True)
        ],
        "curves_cut_short": sum(each.left > 0.0 for found in curves.values() for each in found.values()),
        **speedups({k: v for k, v in curves.items() if k[0] == PEER_REGIME}, list(peers)),
    }


def time_to(points: Sequence[tuple[float, float]], target: float) -> float | None:
    """Seconds at which a curve, ordered by effort, has come below an error for good."""
    reached = None
    for error, seconds in reversed(points):
        if error > target:
            break
        reached = seconds
    return reached


def speedups(curves: dict[Key, dict[str, Curve]], peers: Sequence[str]) -> dict[str, Any]:
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


def _middle_ratio(curves: dict[Key, dict[str, Curve]], name: str, target: Callable[..., float]) -> float | None:
    ratios = []
    for found in curves.values():
        theirs, ours = found[name].points if name in found else [], found[OWN].points
        if not theirs:
            continue
        at = target(theirs)
        spent = min((s for error, s in theirs if error <= at), default=None)
        own = time_to(ours, at)
        if spent is not None and own is not None:
            ratios.append(spent / own)
    return float(np.median(ratios)) if ratios else None
