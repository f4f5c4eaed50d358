"""Ghost paths: ordered lists of surface names with an interaction each, found from the instrument's geometry."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from cgi_wave.errors import EmptyBeamError, InputError, MethodLimitError
from cgi_wave.kernels import search as walk
from cgi_wave.kernels import trace as kernel
from cgi_wave.optics.system import OpticalSystem

Interaction = Literal["transmit", "reflect"]
Step = tuple[str, Interaction]

MAX_DEPTH = 160
MAX_PATHS = 20000
#: Probe rays of a search.
PROBES = 512


@dataclass(frozen=True)
class Path:
    """A path from the entrance to the detector; the detector's arrival is not a step.

    order: parasitic reflections; splits: interactions beyond the nominal ones (level of ancestry; the splitter's own
    add none); arms: which interferometer arms are passed, in order; history: the parasitic interactions (paths that
    share it and differ in arms form a family); twin: number among paths of equal history and arms (a plate's face met
    from inside on the way in, or between mirror and plate on the way out); estimate: power on the detector relative to
    the nominal beams together, from the probes of the search (a few per cent; NaN for a path written by hand); probe:
    number of the first probe (of ``pupil_probes``) that arrived on it; length: its optical path from the pupil plane to
    the detector, m.
    """

    steps: tuple[Step, ...]
    order: int
    splits: int
    arms: tuple[int, ...]
    history: tuple[Step, ...]
    twin: int = 1
    estimate: float = float("nan")
    probe: int = -1
    length: float = float("nan")

    def __str__(self) -> str:
        return " ".join(f"{name}:r" if act == "reflect" else name for name, act in self.steps)

    @property
    def probes(self) -> int:
        """How many probes hold the one that found the path: PROBES, or the power of two that does."""
        return max(PROBES, 1 << max(self.probe, 0).bit_length())

    @property
    def label(self) -> str:
        """Short name: parasitic interactions and arms, e.g. ``detector:r arms 1-2`` (unique within a band)."""
        history = " ".join(f"{name}:{act[0]}" for name, act in self.history) or "nominal"
        arms = f" arms {'-'.join(map(str, self.arms))}" if self.arms else ""
        return history + arms + (f" #{self.twin}" if self.twin > 1 else "")


def make_path(system: OpticalSystem, steps: Iterable[Step]) -> Path:
    """Classify a list of steps. Raises InputError if a name is unknown."""
    steps = tuple(steps)
    history: list[Step] = []
    order = 0
    for name, act in steps:
        if name not in system.number:
            raise InputError("path", name, name, "is no surface of the instrument", f"use {', '.join(system.number)}")
        nominal = system.surfaces[system.number[name]].nominal
        if nominal != "both" and nominal != act:
            history.append((name, act))
            order += act == "reflect"
    arms: list[int] = []
    inter = system.document.interferometer
    if inter is not None:
        ends = {inter.arm1.surfaces[0]: 1, inter.arm2.surfaces[0]: 2}
        # The outermost face of an arm is met going in and coming out (or reflects): count entries only.
        inside = False
        for name, act in steps:
            if name in ends:
                if not inside:
                    arms.append(ends[name])
                inside = (not inside) if act == "transmit" else inside
    return Path(steps, order, len(history), tuple(arms), tuple(history))


def parse_path(system: OpticalSystem, text: str) -> Path:
    """The inverse of ``str(path)``."""
    steps: list[Step] = []
    for token in text.split():
        name, _, act = token.partition(":")
        if act not in ("", "r", "t"):
            raise InputError("path", token, act, "is no interaction", 'write "name" to transmit, "name:r" to reflect')
        steps.append((name, "reflect" if act == "r" else "transmit"))
    return make_path(system, steps)


def pupil_probes(system: OpticalSystem, count: int, seed: int = 1) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pupil points (count, 2) in m and direction cosines (count, 2) that fill pupil and field evenly (Sobol points)."""
    points = qmc.Sobol(4, seed=seed).random(count)
    radius, angle = system.pupil_radius * np.sqrt(points[:, 0]), 2 * np.pi * points[:, 1]
    field = np.sin(np.radians(system.document.entrance.half_field_deg)) * (2 * points[:, 2:] - 1)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), field


def probe_rays(system: OpticalSystem, count: int, seed: int = 1) -> NDArray[np.float64]:
    """World rays (6, count) of ``pupil_probes``, moved back to where light comes from."""
    p, field = pupil_probes(system, count, seed)
    d = np.column_stack([field, np.sqrt(1 - (field**2).sum(axis=1))])
    start = np.column_stack([p, np.zeros(count)]) - d * system.document.entrance.back_off_mm * 1e-3
    axes, origin = system.pupil_frame()
    return np.ascontiguousarray(np.concatenate([start @ axes + origin, d @ axes], axis=1).T)


@dataclass(frozen=True)
class Search:
    """What a search found, and what it cost.

    paths: see ``find_paths``; visits: interactions tried, each with all probes that had come so far. Branches ended by
    order, splits, power: that limit; by unreachable: no way leads to the detector within order and splits; by bound:
    one does, but not with ``min_power``; by lost: no probe survived the interaction (total reflection); by left: no
    probe met a surface again. wrong_side: probes stopped since they met a surface from the side of another space than
    theirs.
    """

    paths: tuple[Path, ...]
    visits: int
    order: int
    splits: int
    power: int
    unreachable: int
    bound: int
    lost: int
    left: int
    wrong_side: int


def find_paths(
    system: OpticalSystem,
    max_order: int = 2,
    max_splits: int = 3,
    min_power: float = 1e-9,
    probes: int = PROBES,
) -> tuple[Path, ...]:
    """Every path that reaches the detector: nominal ones first (arm 1, arm 2), then by order and falling power.

    min_power: coating power, relative to the nominal beams together, below which a branch is not followed. The
    default keeps whatever could reach 1e-4 of the modulation in amplitude. A path is found if one of ``probes`` rays
    (even over pupil and field; a power of two) reaches the detector on it. More probes find what fewer found, and more.

    Raises EmptyBeamError if no nominal path exists, MethodLimitError if the search overflows.
    """
    return explore(system, max_order, max_splits, min_power, probes).paths


def explore(
    system: OpticalSystem,
    max_order: int = 2,
    max_splits: int = 3,
    min_power: float = 1e-9,
    probes: int = PROBES,
    prune: bool = True,
) -> Search:
    """``find_paths`` with the statistics of the search.

    prune: end branches of which nothing can reach the detector within order, splits and power, by a bound from the
    spaces alone. It changes what the search costs, not what it finds.
    """
    surfaces = system.surfaces
    members, start = _bounds(system)
    nominal = [s.nominal for s in surfaces]
    extra_t = np.array([int(k in ("reflect", "absorb")) for k in nominal])
    extra_r = np.array([int(k in ("transmit", "absorb")) for k in nominal])
    sigma = system.sigma0
    index = system.index(sigma)
    power_t = np.array([1.0 if s.coating.bare else s.coating.transmittance for s in surfaces])
    power_r = np.array([_bare_reflectance(s, index) if s.coating.bare else s.coating.reflectance for s in surfaces])

    sides = np.array([[s.before, s.after] for s in surfaces])
    graph = (sides, start, members)
    costs = (power_t, power_r, extra_t, extra_r, np.zeros_like(extra_t), extra_r, system.detector)

    def search(order: int, splits: int, least: float):  # type: ignore[no-untyped-def]
        reach = walk.reach_table(*graph, *costs, order, splits)
        return walk.search_paths(
            probe_rays(system, probes), system.spaces.index(system.document.entrance.space),
            np.array([s.rotation for s in surfaces]), np.array([s.origin for s in surfaces]),
            np.array([s.curvature for s in surfaces]), np.array([s.conic for s in surfaces]),
            np.array([s.aperture for s in surfaces]), *graph, index, *costs,
            reach if prune else np.ones_like(reach), order, splits, least, MAX_DEPTH, MAX_PATHS,
        )  # fmt: skip

    first = search(0, 0, 1e-12)
    if len(first[0]) == 0:
        raise EmptyBeamError(f"{system.file}: band {system.band}: no nominal path reaches the detector")
    input_power, nominal_power = float(np.sum(first[5])), float(np.sum(first[5] * first[2]))
    rows, lengths, counts, arrived, opl, powers, _, visits, ends, wrong, overflow = search(
        max_order, max_splits, min_power * input_power
    )
    if overflow:
        raise MethodLimitError(
            "path search", f"{MAX_PATHS} paths or {MAX_DEPTH} surfaces", 1.0, "raise min_power or lower max_order"
        )
    steps: list[Step] = [(s.name, act) for s in surfaces for act in ("transmit", "reflect")]
    before_pupil = (
        system.document.entrance.back_off_mm * 1e-3 * index[system.spaces.index(system.document.entrance.space)]
    )
    found: list[tuple[tuple[float, ...], Path]] = []
    for row, length, count, probe, way, power in zip(rows, lengths, counts, arrived, opl, powers, strict=True):
        path = replace(
            make_path(system, [steps[code] for code in row[:length].tolist()]),
            estimate=float(power * count / nominal_power), probe=int(probe), length=float(way - before_pupil),
        )  # fmt: skip
        key = (path.order, *path.arms) if path.order == 0 else (path.order, -power * count)
        found.append((key, path))
    ordered = [path for _, path in sorted(found, key=lambda item: (item[0], str(item[1])))]
    seen: Counter[str] = Counter()
    for k, path in enumerate(ordered):
        seen[path.label] += 1
        ordered[k] = replace(path, twin=seen[path.label])
    return Search(
        tuple(ordered), int(visits), order=int(ends[walk.ORDER]), splits=int(ends[walk.SPLITS]),
        power=int(ends[walk.POWER]), unreachable=int(ends[walk.UNREACHABLE]), bound=int(ends[walk.BOUND]),
        lost=int(ends[walk.LOST]), left=int(ends[walk.LEFT]), wrong_side=int(wrong),
    )  # fmt: skip


def _bounds(system: OpticalSystem) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Surfaces that bound each space, as compressed rows (members, start)."""
    rows = [
        [i for i, s in enumerate(system.surfaces) if space in (s.before, s.after)]
        for space in range(len(system.spaces))
    ]
    start = np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int64)
    return np.array([i for row in rows for i in row], dtype=np.int64), start


def _bare_reflectance(surface, index: NDArray[np.float64]) -> float:  # type: ignore[no-untyped-def]
    n1, n2 = index[surface.before], index[surface.after]
    return float(((n1 - n2) / (n1 + n2)) ** 2)


# The search returns 2·surface + interaction, and both kernels mean the same by an interaction.
assert (walk.REFRACT, walk.REFLECT) == (kernel.REFRACT, kernel.REFLECT) == (0, 1)
