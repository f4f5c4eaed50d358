"""What the pictures of a field point show, as plain arrays: footprints of rays, and point-spread functions."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from cgi_wave.budget.pointfields import direction_field
from cgi_wave.budget.pointsource import PointGhost, PointSource
from cgi_wave.errors import CgiWaveError, MethodLimitError
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.beams import Spot
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.psf import Psf, fft_size, psf

#: Pictures per band.
SHOWN = 8
#: Bins along one side of an irradiance map, and of the footprint that stands in for a PSF.
BINS = 96
#: Rays are single points: maps are blurred by this share of the beam's size.
BLUR = 0.035
#: Half-side of a window over the reach of the rays in it; leaves room for the blur.
MARGIN = 1.2
#: A PSF's window holds the rays and this many times λ·F# around them; its pixels are FINEST λ·F# or more.
RINGS = 8.0
FINEST = 0.3
#: PSF points along one side: aimed at, computed at most, and shown at most (binned beyond).
AIMED, MOST, SHARPEST = 256, 1024, 256
#: Largest transform that a picture is worth, samples a side: the next size up takes seconds.
LARGEST = 2048
#: Share of the coarsest pixel that still samples a beam's cone.
GUARD = 0.9

NOMINAL = "nominal, arm 1"


def strongest(source: PointSource, count: int) -> list[tuple[PointGhost, Spot]]:
    """The ghosts that carry most power, one of each parasitic history (its arm pairs look alike), and their spots."""
    seen: set[object] = set()
    chosen = []
    reached = [(ghost, ghost.spot) for ghost in source.ghosts if ghost.spot is not None]
    for ghost, here in sorted(reached, key=lambda pair: -pair[1].power):
        if ghost.path.history not in seen:
            seen.add(ghost.path.history)
            chosen.append((ghost, here))
    return chosen[:count]


def spot_pictures(source: PointSource) -> list[dict[str, Any]]:
    """Irradiance maps of the nominal beam and the strongest ghosts, for ``report.plots.plot_irradiance``.

    All on one square, in m from the nominal image point. ``power`` is relative to the nominal beam of arm 1, for the
    same point source; ``irradiance`` is that power per m².
    """
    named = [(NOMINAL, source.nominal_spot)]
    named += [(ghost.path.label, here) for ghost, here in strongest(source, SHOWN - 1)]
    half = MARGIN * max(float(np.abs(here.x - source.nominal_spot.centroid).max()) for _, here in named)
    return [_map(label, here, source.nominal_spot, half) for label, here in named]


def _map(label: str, here: Spot, nominal: Spot, half: float) -> dict[str, Any]:
    power = here.power / nominal.power
    edges, density = _density(here.x - nominal.centroid, half)
    return {
        "label": label, "x_m": edges, "y_m": edges, "irradiance": power * density.T, "power": power,
        "rms_x_m": float(here.rms[0]), "rms_y_m": float(here.rms[1]),
    }  # fmt: skip


def _density(x: NDArray[np.float64], half: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bin edges, m, and share of the rays per m² (BINS, BINS) of points x (N, 2), m, on a square of ±half."""
    counts, edges, _ = np.histogram2d(x[:, 0], x[:, 1], bins=BINS, range=[(-half, half)] * 2)
    bin_size = 2.0 * half / BINS
    blurred = gaussian_filter(counts, BLUR * np.ptp(x, axis=0) / bin_size, mode="constant")
    return np.asarray(edges, np.float64), np.asarray(blurred / len(x) / bin_size**2, np.float64)


def psf_pictures(system: OpticalSystem, source: PointSource) -> list[dict[str, Any]]:
    """PSFs of the nominal beam and of the strongest ghosts, for ``report.plots.plot_psf``.

    Positions are in m from the nominal image point; ``psf`` is power per m², ``share`` the part of the beam's power in
    the window. Where the transform cannot sample the wavefront, or no direction-space field exists, ``psf`` is the
    density of rays and ``method`` begins with "geometric" and gives the reason.
    """
    shown = [_picture(NOMINAL, lambda: source.nominal_field, source.nominal_spot, source)]
    for ghost, here in strongest(source, SHOWN - 1):
        # About its own centroid: the window of a displaced ghost need not hold the nominal image.
        field = partial(direction_field, system, ghost.path, source.theta, here.centroid)
        shown.append(_picture(ghost.path.label, field, here, source))
    return shown


def _picture(label: str, field: Callable[[], PupilField], here: Spot, source: PointSource) -> dict[str, Any]:
    """The PSF of one beam, or the density of its rays with the reason for it."""
    origin = source.nominal_spot.centroid
    try:
        beam = field()
        made = beam_psf(beam, here)
    except CgiWaveError as limit:
        edges, density = _density(here.x - here.centroid, _reach(here, here.centroid))
        middle = 0.5 * (edges[1:] + edges[:-1])
        x, y = (middle + shift for shift in here.centroid - origin)
        return {"label": label, "x_m": x, "y_m": y, "psf": density.T, "share": None, "method": f"geometric ({limit})"}
    factor = math.ceil(made.x.size / SHARPEST)
    n = made.x.size // factor
    x, y = (part[: n * factor].reshape(n, factor).mean(axis=1) for part in (made.x, made.y))
    shown = made.irradiance[: n * factor, : n * factor].reshape(n, factor, n, factor).mean(axis=(1, 3))
    x, y = x + beam.reference_point[0] - origin[0], y + beam.reference_point[1] - origin[1]
    return {"label": label, "x_m": x, "y_m": y, "psf": shown.T, "share": share(made, beam), "method": made.method}


def beam_psf(field: PupilField, here: Spot) -> Psf:
    """PSF about the field's reference point, on a window that holds the rays of the spot and a few rings around them.

    Raises MethodLimitError where that takes more than MOST points along a side, or a transform above LARGEST.
    """
    sigma, scale = float(field.sigma[field.sigma.size // 2]), field.support.scale
    airy = 0.5 / (sigma * float(scale.max()))  # λ·F# of this beam's own cone
    half = _reach(here, np.array(field.reference_point)) + RINGS * airy
    coarsest = GUARD / (2.0 * sigma * float(np.max(np.abs(field.support.centre) + scale)))
    pixel = min(max(2.0 * half / AIMED, FINEST * airy), coarsest)
    n = 2 * math.ceil(half / pixel)
    if n > MOST:
        remedy = "look at its rays, or ask wave.psf.psf_direct for a patch"
        limit = f"{field.label}: a window with all its rays has {n} pixels a side (limit {MOST})"
        raise MethodLimitError("padded FFT", limit, n / MOST, remedy)
    size = fft_size(field, pixel, n, sigma)
    if size > LARGEST:
        limit = f"{field.label}: its wavefront needs a transform of {size} (limit {LARGEST} for a picture)"
        raise MethodLimitError("padded FFT", limit, size / LARGEST, "ask wave.psf.psf for a transform of that size")
    return psf(field, pixel, n, measure=False)


def share(made: Psf, field: PupilField) -> float:
    """Part of a beam's power that falls into the window of its PSF."""
    pixel = float(made.x[1] - made.x[0])
    return float(made.irradiance.sum()) * pixel**2 / float(field.power_at(np.array([made.sigma]))[0])


def _reach(here: Spot, origin: NDArray[np.float64]) -> float:
    """Half-side, m, of the square about ``origin`` that holds all rays of a spot, with a margin."""
    return MARGIN * max(float(np.abs(here.x - origin).max()), 1e-6)
