"""Overlap of the geometric spots, ∫√(I_m I_l): what a ratio of RMS spot sizes (Eq. 4) imitates. No phase in it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from cgi_wave.wave.basis import Array, at_points
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods.base import Estimate
from cgi_wave.wave.methods.shape import Beam, Edge, beam_at, check_pair, edge_of

RAYS = 400_000  # per beam
BINS = 96  # along each side of what both spots share
_PLASTIC = 1.32471795724474602596  # x³ = x + 1: multiples of 1/x and 1/x² fill a square evenly (Roberts 2018)
_POINT = 1e-9  # a spot smaller than this part of the other, or of a wavelength over the cone, is a point


@dataclass(frozen=True)
class SpotOverlap:
    """∫√(I_m I_l) d²x / √(P_m P_l) of two irradiances.

    value : in [0, 1]; error : estimate of what bins and rays (or points and edges) leave of it; method; count : rays
    or samples; seconds : wall time
    """

    value: float
    error: float
    method: str
    count: int
    seconds: float


def _rays(beam: Beam, edge: Edge, count: int) -> tuple[Array, Array]:
    """Landing points (N, 2), m, and powers (N,) of evenly spread rays."""
    lo, hi = edge.u.min(axis=0), edge.u.max(axis=0)
    k = np.arange(1, count + 1)
    u = lo + (hi - lo) * np.column_stack([np.mod(k / _PLASTIC, 1.0), np.mod(k / _PLASTIC**2, 1.0)])
    lit = (beam.scaled(u) ** 2).sum(axis=1) <= 1.0
    u = u[lit]
    u = u[(at_points(beam.support.clearance, beam.scaled(u)) > 0.0).all(axis=0)]
    power = beam.amplitude_at(u) ** 2 * float(np.prod(hi - lo)) / count
    return -beam.slope_at(u), power


def _binned(spots: list[tuple[Array, Array]], lo: Array, hi: Array, bins: int) -> float:
    """Σ √(power of m in a bin · power of l in it)."""
    grid = [(lo[a], hi[a]) for a in (0, 1)]
    power = [np.histogram2d(x[:, 0], x[:, 1], bins=bins, range=grid, weights=w)[0] for x, w in spots]
    return float(np.sqrt(power[0] * power[1]).sum())


def geometric_overlap(
    m: PupilField,
    l: PupilField,  # noqa: E741
    sigma: float,
    rays: int = RAYS,
    bins: int = BINS,
) -> SpotOverlap:
    """Overlap of two ray spots at sigma, 1/m, from even rays in bins over what both spots share.

    A perfect beam lands on a point: its overlap with an extended spot is 0, with another point at the same place 1.
    Bins raise the value (Cauchy and Schwarz), sparse rays lower it; ``error`` adds the change from half the bins and
    from a quarter of the rays. Raises InputError for fields that do not go together.
    """
    started = time.perf_counter()
    check_pair(m, l)
    beams, edges = [beam_at(f, sigma) for f in (m, l)], [edge_of(f) for f in (m, l)]
    spots = [_rays(b, e, rays) for b, e in zip(beams, edges, strict=True)]
    norm = math.sqrt(beams[0].power * beams[1].power)
    size = [float(np.ptp(x, axis=0).max()) for x, _ in spots]
    wave = 1.0 / (sigma * float(np.ptp(edges[0].u, axis=0).max()))
    floor = _POINT * max(*size, wave)
    if min(size) <= floor:
        together = max(size) <= floor and np.abs(spots[0][0][0] - spots[1][0][0]).max() <= floor
        seconds = time.perf_counter() - started
        return SpotOverlap(float(together), 0.0, "geometric spots: a point", 2 * rays, seconds)
    lo = np.max([x.min(axis=0) for x, _ in spots], axis=0)
    hi = np.min([x.max(axis=0) for x, _ in spots], axis=0)
    if np.any(hi <= lo):
        return SpotOverlap(0.0, 0.0, "geometric spots", 2 * rays, time.perf_counter() - started)
    value = _binned(spots, lo, hi, bins) / norm
    coarse = _binned(spots, lo, hi, bins // 2) / norm
    fewer = [_rays(b, e, rays // 4) for b, e in zip(beams, edges, strict=True)]
    sparse = _binned(fewer, lo, hi, bins) / norm
    error = abs(value - coarse) + abs(value - sparse)
    return SpotOverlap(min(value, 1.0), error, "geometric spots", 2 * rays, time.perf_counter() - started)


class Geometric:
    """The geometric overlap in the place of |γ|: an imitation without a bound, always to be had."""

    name = "geometric spots"

    def supports(self, m: PupilField, l: PupilField, sigma: float) -> str | None:  # noqa: E741
        """None: rays always land."""
        return None

    def error_bound(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """inf: it knows neither phase nor diffraction."""
        return math.inf

    def cost(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """Rays traced."""
        return 2.5 * RAYS

    def evaluate(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> Estimate:  # noqa: E741
        """The overlap of the spots, real, with bound inf."""
        found = geometric_overlap(m, l, sigma)
        return Estimate(complex(found.value), math.inf, self.name, found.count, found.seconds)
