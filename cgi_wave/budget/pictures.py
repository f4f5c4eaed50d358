"""What the pictures of a field point show, as plain arrays: footprints of rays, and point-spread functions."""

from __future__ import annotations

from typing import Any

import numpy as np

from cgi_wave.budget.pointsource import PointGhost, PointSource, direction_field
from cgi_wave.errors import CgiWaveError
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.beams import Spot
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.psf import psf

#: Pictures per band.
SHOWN = 8
BINS = 40
PSF_POINTS = 256


def strongest(source: PointSource, count: int) -> list[PointGhost]:
    """The ghosts that carry most power, one of each parasitic history (its arm pairs look alike)."""
    seen: set[object] = set()
    chosen = []
    for ghost in sorted((g for g in source.ghosts if g.spot is not None), key=lambda g: -g.spot.power):  # type: ignore[union-attr]
        if ghost.path.history not in seen:
            seen.add(ghost.path.history)
            chosen.append(ghost)
    return chosen[:count]


def spot_pictures(source: PointSource) -> list[dict[str, Any]]:
    """Irradiance maps of the nominal beam and the strongest ghosts, for ``report.plots.plot_irradiance``."""
    named = [("nominal arms 1", source.nominal_spot)]
    named += [(ghost.path.label, ghost.spot) for ghost in strongest(source, SHOWN - 1) if ghost.spot is not None]
    return [_map(label, here) for label, here in named]


def _map(label: str, here: Spot) -> dict[str, Any]:
    counts, x, y = np.histogram2d(here.x[:, 0], here.x[:, 1], bins=BINS, range=_range(here))
    return {"label": label, "x_m": x, "y_m": y, "irradiance": counts.T / counts.max(), "unit": "irradiance / its peak"}


def _range(here: Spot) -> list[tuple[float, float]]:
    middle = 0.5 * (here.x.min(axis=0) + here.x.max(axis=0))
    half = 0.55 * max(float(np.ptp(here.x, axis=0).max()), 1e-6)
    return [(float(c - half), float(c + half)) for c in middle]


def psf_pictures(system: OpticalSystem, source: PointSource) -> list[dict[str, Any]]:
    """PSFs by FFT of the nominal beam and of the strongest ghosts whose defocus the transform can sample."""
    shown = [_psf("nominal arms 1", source.nominal_field)]
    for ghost in strongest(source, 4 * SHOWN):
        if len(shown) == SHOWN:
            break
        try:
            shown.append(_psf(ghost.path.label, direction_field(system, ghost.path, source.theta, source.x0)))
        except CgiWaveError:
            continue  # beyond the FFT's sampling guard: its footprint stands among the irradiance maps
    return shown


def _psf(label: str, field: PupilField) -> dict[str, Any]:
    """One PSF, on a grid that holds the geometric spot (size from the spread of ray ends) and resolves λ·F#."""
    finest = 0.25 / (field.sigma[0] * float(field.support.scale.max()))
    made = psf(field, finest, PSF_POINTS)
    return {"label": label, "x_m": made.x, "y_m": made.y, "psf": made.irradiance.T}
