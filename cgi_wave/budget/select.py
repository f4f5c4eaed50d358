"""Which ghosts are traced: those with power, and the weak ones whose amplitude could still matter."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

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


def select_ghosts(
    system: OpticalSystem,
    paths: Sequence[Path],
    envelope: Callable[[Array, Array], Array],
    nma: float,
    floor: float = AMPLITUDE_FLOOR,
) -> tuple[Path, ...]:
    """The nominal paths, the ghosts above POWER_FLOOR, and weaker ones that could matter against a nominal beam.

    A weak ghost of power t (from the path search, relative to t1 + t2) adds at most √(t/t1)·|G|/NMA to the modulation,
    with the largest coherence |G| over its path difference; it is kept if that exceeds ``floor`` for |γ| = 1.
    """
    t1 = paths[0].estimate
    strong = [path for path in paths if path.order == 0 or path.estimate > POWER_FLOOR]
    weak = [
        path
        for path in paths
        if path.order > 0 and path.estimate <= POWER_FLOOR and np.sqrt(path.estimate / t1) / nma > floor
    ]
    ranges = np.array([opd_range(system, path, paths[:2]) for path in weak]).reshape(-1, 2)
    bound = np.sqrt(np.array([path.estimate for path in weak]) / t1) * envelope(ranges[:, 0], ranges[:, 1]) / nma
    return (*strong, *(path for path, b in zip(weak, bound, strict=True) if b > floor))


def opd_range(system: OpticalSystem, path: Path, nominal: Sequence[Path]) -> tuple[float, float]:
    """Range of a found ghost's OPD to both nominal beams, m: of the probe that found it, with MARGIN."""
    p, theta = (values[[path.probe]] for values in pupil_probes(system, PROBES))
    lengths = [trace(compile_sequence(system, each, system.sigma0), p, theta).opl[0] for each in (path, *nominal)]
    differences = lengths[0] - np.array(lengths[1:])
    return float(differences.min() - MARGIN), float(differences.max() + MARGIN)
