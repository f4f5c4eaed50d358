"""Many paths traced together: prefixes are shared, rays are dropped as they die, and what arrives is added up."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError, InputError
from cgi_wave.kernels.trace import BEYOND, FILM, NUMBER
from cgi_wave.kernels.tree import ARRIVE, BEND, FATES, MEET, OFF_TABLE, SUMS, VIGNETTED, trace_branches
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import Path
from cgi_wave.rays.sharing import check_threads
from cgi_wave.rays.trace import WORDS, Sequence, compile_sequence, pad_films

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
#: Pupil points (n, 2) in m, and direction cosines (n, 2) or (1, 2), of rays ``begin`` to ``end``.
Fan = Callable[[int, int], tuple[Array, Array]]

#: Fates that are no trouble of ``kernels.trace``, or have another number there.
OTHERS = {VIGNETTED: "vignetted at", OFF_TABLE: WORDS[BEYOND]}
#: Rays of one call of the kernel: sums of blocks are added in order, whichever thread made them.
BLOCK = 16384


@dataclass(frozen=True)
class Tree:
    """Paths compiled for one wavenumber, their common beginnings shared; see ``kernels.tree.trace_branches``.

    operations (5, O): kind, source, target, step, skip; steps: arrays over the steps that are taken; where: the name of
    the surface of each operation; belongs: numbers of the operations along each path; factor (P,): power of coatings.
    """

    paths: tuple[Path, ...]
    operations: Ints
    steps: tuple[Array, ...]
    where: tuple[str, ...]
    belongs: tuple[tuple[int, ...], ...]
    factor: Array
    buffers: int
    back_off: float

    @property
    def visits(self) -> int:
        """Surfaces met by a ray that dies nowhere."""
        return int((self.operations[0] == MEET).sum())


@dataclass(frozen=True)
class Arrivals:
    """What a fan of ``launched`` rays, each of power 1, brought to the detector on each of P paths.

    survivors (P,): rays; power (P,): their sum. lost (O, FATES): what became of the others, by operation of the tree.
    """

    tree: Tree
    launched: int
    sums: Array
    lost: Ints = field(repr=False)

    @property
    def survivors(self) -> Ints:
        """Rays that arrive, (P,)."""
        return self.sums[:, 0].astype(np.int64)

    @property
    def power(self) -> Array:
        """Their power, (P,)."""
        return self.sums[:, 1]

    def centroid(self, k: int) -> Array:
        """Mean detector point (2,) of path k, by power, m. Raises EmptyBeamError if no ray arrives on it."""
        return self._means(k)[:2]

    def rms(self, k: int) -> Array:
        """Root mean square distance from the centroid along x and y (2,), m. Raises EmptyBeamError."""
        mean = self._means(k)
        return np.sqrt(np.maximum(mean[2:4] - mean[:2] ** 2, 0.0))

    def length(self, k: int) -> float:
        """Mean optical path length from the entrance pupil plane, m. Raises EmptyBeamError."""
        return float(self._means(k)[4])

    def trouble(self, k: int) -> dict[str, int]:
        """Counts of what stopped the rays of path k, by kind and surface."""
        counts: dict[str, int] = {}
        for o in self.tree.belongs[k]:
            for fate in np.flatnonzero(self.lost[o]):
                word = OTHERS.get(int(fate)) or WORDS[int(fate)]
                key = f"{word} {self.tree.where[o]}"
                counts[key] = counts.get(key, 0) + int(self.lost[o, fate])
        return counts

    def _means(self, k: int) -> Array:
        if self.sums[k, 0] == 0:
            raise EmptyBeamError(f"no ray arrives on {self.tree.paths[k]}: {self.trouble(k)}")
        return self.sums[k, 2:] / self.sums[k, 1]


def grow_tree(system: OpticalSystem, paths: tuple[Path, ...], sigma: float) -> Tree:
    """Compile paths, of which no two may be equal, for wavenumber ``sigma`` (1/m).

    Raises InputError where media do not join, for a path given twice, or for none.
    """
    if not paths:
        raise InputError("paths", "paths", "()", "are none", "give at least one path")
    root: dict[tuple[str, str], dict] = {}
    compiled = [compile_sequence(system, path, sigma) for path in paths]
    rows: list[tuple[Sequence, int]] = []
    origin: dict[int, int] = {}
    ends: dict[int, int] = {}
    for number, (path, sequence) in enumerate(zip(paths, compiled, strict=True)):
        node = root
        for k, key in enumerate([*path.steps, (sequence.names[-1], "absorb")]):
            if key not in node:
                node[key] = {}
                origin[id(node[key])] = len(rows)
                rows.append((sequence, k))
            node = node[key]
        if id(node) in ends:
            raise InputError("paths", f"paths[{number}]", str(path), "is given twice", "leave one of them out")
        ends[id(node)] = number
    plan = _Plan(origin, ends)
    plan.branch(root, 0, 1, ())
    columns = [
        np.array([getattr(sequence, name)[k] for sequence, k in rows])
        for name in ("rot", "shift", "curvature", "conic", "n1", "n2", "mode", "side", "bare", "aperture")
    ]
    columns.append(_films(rows, columns[-2]))
    factor = np.array([np.prod(np.where(sequence.bare == NUMBER, sequence.weight, 1.0)) for sequence in compiled])
    names = tuple(rows[k][0].names[rows[k][1]] if kind != ARRIVE else "" for kind, _, _, k, _ in plan.operations)
    return Tree(
        tuple(paths), np.array(plan.operations, dtype=np.int64).T.copy(), tuple(columns), names,
        tuple(plan.belongs[k] for k in range(len(paths))), factor, plan.buffers, compiled[0].back_off,
    )  # fmt: skip


def _films(rows: list[tuple[Sequence, int]], bare: Ints) -> Array:
    """Tables of all steps (F, M, 5), of one length; ``bare`` (steps,) gets their numbers, in place."""
    found: list[Array] = []
    for step, (sequence, k) in enumerate(rows):
        if sequence.bare[k] >= FILM:
            bare[step] = FILM + len(found)
            found.append(sequence.film[sequence.bare[k] - FILM])
    return pad_films(found)


class _Plan:
    """The walk through a tree, written down as operations."""

    def __init__(self, origin: dict[int, int], ends: dict[int, int]) -> None:
        self.origin, self.ends = origin, ends
        self.operations: list[list[int]] = []
        self.belongs: dict[int, tuple[int, ...]] = {}
        self.buffers = 1

    def emit(self, kind: int, source: int, target: int, step: int) -> int:
        self.buffers = max(self.buffers, target + 1)
        self.operations.append([kind, source, target, step, 0])
        return len(self.operations) - 1

    def branch(self, node: dict, buffer: int, free: int, done: tuple[int, ...]) -> None:
        """Operations of all that grows from a node whose rays are in ``buffer``; those from ``free`` on may be used."""
        # What is done at one surface shares the way to it.
        surfaces: dict[str, list[tuple[str, dict]]] = {}
        for (name, act), child in node.items():
            surfaces.setdefault(name, []).append((act, child))
        for k, acts in enumerate(surfaces.values()):
            own = buffer if k == len(surfaces) - 1 else free
            meet = self.emit(MEET, buffer, own, self.origin[id(acts[0][1])])
            above = free if own == buffer else free + 1
            through = [child for act, child in acts if act != "absorb"]
            for act, child in acts:
                if act == "absorb":
                    path = self.ends[id(child)]
                    self.emit(ARRIVE, own, own, path)
                    self.belongs[path] = (*done, meet)
            for j, child in enumerate(through):
                last = j == len(through) - 1
                into = own if last else above
                bend = self.emit(BEND, own, into, self.origin[id(child)])
                self.branch(child, into, above if last else above + 1, (*done, meet, bend))
                self.operations[bend][4] = len(self.operations)
            self.operations[meet][4] = len(self.operations)


def trace_tree(tree: Tree, p: Array, theta: Array, threads: int = 1) -> Arrivals:
    """Trace rays from pupil points p (N, 2), m, with direction cosines theta (N, 2) or (2,), along every path."""
    points, cosines = np.ascontiguousarray(p, dtype=np.float64), np.atleast_2d(np.asarray(theta, dtype=np.float64))
    one = len(cosines) == 1
    return stream_tree(tree, lambda a, b: (points[a:b], cosines if one else cosines[a:b]), len(points), threads)


def stream_tree(tree: Tree, fan: Fan, count: int, threads: int = 1) -> Arrivals:
    """``trace_tree`` for more rays than should be kept: ``fan(begin, end)`` makes a block of them when it is needed.

    fan has to give the same rays for the same numbers, on any thread. The result does not depend on ``threads``.
    """
    check_threads(threads)
    sums, lost = np.zeros((len(tree.paths), SUMS)), np.zeros((tree.operations.shape[1], FATES), dtype=np.int64)

    def block(begin: int) -> tuple[Array, Ints]:
        p, theta = fan(begin, min(begin + BLOCK, count))
        some, gone = np.zeros_like(sums), np.zeros_like(lost)
        trace_branches(*tree.operations, *tree.steps, tree.buffers, tree.factor, tree.back_off,
                       np.ascontiguousarray(p), np.ascontiguousarray(theta), some, gone)  # fmt: skip
        return some, gone

    begins = range(0, count, BLOCK)
    if threads == 1:
        for some, gone in map(block, begins):
            sums += some
            lost += gone
    else:
        with ThreadPoolExecutor(threads) as pool:
            for some, gone in pool.map(block, begins):
                sums += some
                lost += gone
    return Arrivals(tree, count, sums, lost)
