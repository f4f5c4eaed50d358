"""Which ghosts are traced: those with power, and the weak ones whose amplitude could still matter."""

from __future__ import annotations

from collections.abc import Sequence

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
