"""Both oracles on many cases, kept on disk as they come, and what to do when they differ.

One JSON line per case and oracle; the file's name holds a digest of the oracle's source, so that a changed oracle
starts afresh. An interrupted run loses what was being computed and nothing else.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from validation.cases import Case
from validation.oracles import polar, strips

ORACLES: dict[str, ModuleType] = {"strips": strips, "polar": polar}
#: Values that come with the source, in files of the same form: some hours of computing.
KEPT = Path(__file__).parent / "kept"
#: How far the two may differ before somebody has to look, beside what they say of themselves.
AGREEMENT = 1e-11


@dataclass(frozen=True)
class Reference:
    """What two oracles say of one case.

    value : of the oracle that claims the smaller error; error : its claim; difference : between the two;
    claimed : the sum of both claims; seconds : of both; nodes : of both
    """

    value: complex
    error: float
    difference: float
    claimed: float
    seconds: float
    nodes: int

    @property
    def agreed(self) -> bool:
        """Whether the oracles differ by no more than they claim, and by no more than AGREEMENT."""
        return self.difference <= min(self.claimed, AGREEMENT)


class Store:
    """One oracle's values on disk: key -> (re, im, error, nodes, seconds)."""

    def __init__(self, name: str, folder: Path) -> None:
        self.oracle = ORACLES[name]
        source = Path(str(self.oracle.__file__)).read_bytes()
        self.file = folder / f"{name}-{hashlib.sha256(source).hexdigest()[:12]}.jsonl"
        self.known: dict[str, list[float]] = {}
        kept = KEPT / f"{self.file.name}.gz"
        if kept.exists():
            self._take(gzip.decompress(kept.read_bytes()).decode("utf-8"))
        if self.file.exists():
            self._take(self.file.read_text(encoding="utf-8"))

    def _take(self, text: str) -> None:
        for line in text.splitlines():
            try:
                key, value = json.loads(line)
            except ValueError:  # the line that an interruption cut off
                continue
            self.known[key] = value

    def compute(self, case: Case) -> tuple[str, list[float]]:
        """Key and value of a case; does not write."""
        started = time.perf_counter()
        value, error, nodes = self.oracle.contrast(**case.coefficients)
        return key_of(case), [value.real, value.imag, error, nodes, time.perf_counter() - started]

    def add(self, key: str, value: list[float]) -> None:
        """Keeps a value, on disk first."""
        with self.file.open("a", encoding="utf-8") as out:
            out.write(json.dumps([key, value]) + "\n")
        self.known[key] = value


def key_of(case: Case) -> str:
    """All coefficients, exactly."""
    return " ".join(float(value).hex() for value in case.coefficients.values())


def progress(text: str) -> None:
    """One line on standard error, overwritten by the next where that is a terminal."""
    end = "\r" if sys.stderr.isatty() else "\n"
    print(text.ljust(100), end=end, file=sys.stderr, flush=True)


def references(
    cases: Sequence[Case],
    folder: Path,
    jobs: int = 1,
    say: Callable[[str], None] = progress,
    minutes: float = math.inf,
) -> list[Reference | None]:
    """Both oracles on every case, from disk where possible; `jobs` threads (the compiled loops hold no lock).

    No value is begun after `minutes`, the cheapest cases go first; None stands for a case that had to wait.
    """
    folder.mkdir(parents=True, exist_ok=True)
    stores = [Store(name, folder) for name in ORACLES]
    wanted = {key_of(case): case for case in cases}
    todo = [(store, case) for key, case in wanted.items() for store in stores if key not in store.known]
    if todo:
        for oracle in ORACLES.values():  # compile once, not in every thread
            oracle.contrast(w020=1.0)
        todo.sort(key=lambda item: waves(item[1]))
        _compute(todo, jobs, say, 60.0 * minutes)
    found: list[Reference | None] = []
    for case in cases:
        if not all(key_of(case) in store.known for store in stores):
            found.append(None)
            continue
        values = [store.known[key_of(case)] for store in stores]
        best = min(values, key=lambda v: v[2])
        difference = abs(complex(*values[0][:2]) - complex(*values[1][:2]))
        seconds, nodes = sum(v[4] for v in values), int(sum(v[3] for v in values))
        found.append(Reference(complex(*best[:2]), best[2], difference, values[0][2] + values[1][2], seconds, nodes))
    return found


def waves(case: Case) -> float:
    """Sum of the coefficients' sizes: what the cost of an oracle grows with the square of."""
    return sum(abs(w) for w in (case.w020, case.w040, case.w131, case.w222, case.w111))


def _compute(todo: list[tuple[Store, Case]], jobs: int, say: Callable[[str], None], limit: float) -> None:
    started, last, done = time.perf_counter(), 0.0, 0
    with ThreadPoolExecutor(jobs) as pool:
        queue = iter(todo)
        running: dict[Future[tuple[str, list[float]]], Store] = {}
        try:
            while True:
                while (
                    len(running) < jobs
                    and time.perf_counter() - started < limit
                    and (item := next(queue, None)) is not None
                ):
                    running[pool.submit(item[0].compute, item[1])] = item[0]
                if not running:
                    break
                finished, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    running.pop(future).add(*future.result())
                    done += 1
                now = time.perf_counter() - started
                if now - last > 5.0 or done == len(todo):
                    last = now
                    say(f"oracles: {done} of {len(todo)} values, {now:.0f} s")
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def all_references(
    cases: Sequence[Case], folder: Path, jobs: int = 1, say: Callable[[str], None] = progress
) -> list[Reference]:
    """As ``references``, and no case waits."""
    return [one for one in references(cases, folder, jobs, say) if one is not None]


def disagreement(case: Case, reference: Reference) -> dict[str, Any]:
    """Which oracle fails where the two differ: both again with panels half and a third as large.

    The one that moved is the one that was wrong; when both or none did, nobody knows.
    """
    first = {name: oracle.contrast(**case.coefficients)[0] for name, oracle in ORACLES.items()}
    finest = {name: oracle.contrast(**case.coefficients, finer=3.0)[0] for name, oracle in ORACLES.items()}
    settled = abs(finest["strips"] - finest["polar"]) <= AGREEMENT
    truth = 0.5 * (finest["strips"] + finest["polar"])
    wrong = [name for name in ORACLES if abs(first[name] - truth) > 0.5 * reference.difference] if settled else []
    return {
        "kind": case.kind,
        **case.coefficients,
        "difference": reference.difference,
        "claimed": reference.claimed,
        "wrong": wrong[0] if len(wrong) == 1 else "not settled",
        "difference_when_finer": abs(finest["strips"] - finest["polar"]),
    }
