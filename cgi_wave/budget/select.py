"""Which ghosts are traced: those with power, and the weak ones whose amplitude could still matter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.setting import Setting
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import PROBES, Path, pupil_probes
from cgi_wave.rays.trace import compile_sequence, trace

Array = NDArray[np.float64]

#: Ghosts above this power (of the nominal beams together) are traced whatever their path difference, as in the paper.
POWER_FLOOR = 1e-5
#: Weaker ghosts are traced if they could change the modulation by this part.
AMPLITUDE_FLOOR = 1e-4
#: Room around the measured OPD, m: ghost and nominal rays of one probe end apart (a direction of 0.12 over 8 mm), and
#: group and phase path lengths differ (by 0.012 over the glass that a ghost crosses more than a nominal beam).
MARGIN = 2e-3


@dataclass(frozen=True)
class Untraced:
    """Ghosts that were found and not traced.

    power (U,): by the path search, relative to the nominal beams together; modulation (U,): bound of what each could
    add to M with both nominal beams, relative to M, for |γ| = 1.
    """

    paths: tuple[Path, ...] = ()
    power: Array = field(default_factory=lambda: np.zeros(0))
    modulation: Array = field(default_factory=lambda: np.zeros(0))

    def bounds(self, factor: Array) -> tuple[float, float]:
        """Of what ghosts add whose terms count ``factor`` (U,) times: to O/B and to M*/M.

        Powers add. Amplitudes add plainly within a family and in squares over families, as everywhere.
        """
        if not self.paths:
            return 0.0, 0.0
        sums = np.bincount(self._family, np.abs(factor) * self.modulation)
        return float((np.abs(factor) * self.power).sum()), float(np.sqrt((sums**2).sum()))

    @cached_property
    def _family(self) -> NDArray[np.int64]:
        known: dict[object, int] = {}
        return np.array([known.setdefault(path.history, len(known)) for path in self.paths], dtype=np.int64)


def untraced(setting: Setting, found: Sequence[Path], selected: Sequence[Path]) -> Untraced:
    """The paths of ``found`` (nominal ones first) that are not among ``selected``, with their bounds."""
    taken = set(selected)
    paths = tuple(path for path in found if path.order > 0 and path not in taken)
    if not paths:
        return Untraced()
    power = np.array([path.estimate for path in paths])
    low, high = opd_ranges(setting.system, paths, found[:2])
    t1, t2 = found[0].estimate, found[1].estimate
    root = np.sqrt(power / t1) + np.sqrt(power / t2)
    return Untraced(paths, power, root * setting.envelope(low, high) / setting.nma)


def select_ghosts(setting: Setting, paths: Sequence[Path], floor: float = AMPLITUDE_FLOOR) -> tuple[Path, ...]:
    """The nominal paths, the ghosts above POWER_FLOOR, and weaker ones that could matter against a nominal beam.

    A weak ghost of power t (from the path search, relative to t1 + t2) adds at most √(t/t1)·|G|/NMA to the modulation,
    with the largest coherence |G| over its path difference; it is kept if that exceeds ``floor`` for |γ| = 1.
    """
    t1, nma = paths[0].estimate, setting.nma
    strong = [path for path in paths if path.order == 0 or path.estimate > POWER_FLOOR]
    weak = [
        path
        for path in paths
        if path.order > 0 and path.estimate <= POWER_FLOOR and np.sqrt(path.estimate / t1) / nma > floor
    ]
    low, high = opd_ranges(setting.system, weak, paths[:2])
    bound = np.sqrt(np.array([path.estimate for path in weak]) / t1) * setting.envelope(low, high) / nma
    return (*strong, *(path for path, b in zip(weak, bound, strict=True) if b > floor))


def opd_ranges(system: OpticalSystem, paths: Sequence[Path], nominal: Sequence[Path]) -> tuple[Array, Array]:
    """Ranges of found ghosts' OPDs to both nominal beams, m: of the probes that found them, with MARGIN; (P,) each."""
    p, theta = pupil_probes(system, max((path.probes for path in paths), default=PROBES))
    straight = np.array([trace(compile_sequence(system, path, system.sigma0), p, theta).opl for path in nominal])
    own = np.array([path.length for path in paths])
    differences = own - straight[:, np.array([path.probe for path in paths], dtype=np.int64)]
    return differences.min(axis=0) - MARGIN, differences.max(axis=0) + MARGIN
