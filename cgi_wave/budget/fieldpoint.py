"""One field point of one band: every beam that feeds it, its power, and the mutual coherence of the pairs that matter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.plan import PairPlan, plan_pairs
from cgi_wave.errors import CgiWaveError, EmptyBeamError
from cgi_wave.fringes.coherency import Coherency, LeftOut, Pair
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.beams import Rays, nominal_direction, rays_to_point, spot
from cgi_wave.rays.paths import Path
from cgi_wave.wave.basis import at_points, chebyshev_wavenumbers
from cgi_wave.wave.field import PupilField, fit_field, power
from cgi_wave.wave.overlap import overlap_spectrum
from cgi_wave.wave.samples import PupilSamples, Space

Array = NDArray[np.float64]

#: Wavenumbers at which beams are traced; path lengths are the parabola through them.
TRACED_WAVENUMBERS = 3
#: What a computed pair may add to the error of M, as a share of the tolerance.
PAIR_SHARE = 0.1
#: Room for the zone's own fringes and for the parabola in σ, m, when the OPD range of a pair is bounded.
OPD_MARGIN = 2e-5


@dataclass(frozen=True)
class Unresolved:
    """A beam whose field could not be made: its label, why, and its power from the path search (relative to t1 + t2)."""

    label: str
    reason: str
    estimate: float


@dataclass(frozen=True)
class FieldPoint:
    """Beams and coherence at detector point x0 (m), seen from source direction theta (cosines).

    fields: pupil fields (uniform scene) of ``paths``, in the order of ``coherency.labels``; empty: labels of paths that
    do not reach this point; unresolved: see there.
    """

    x0: Array
    theta: Array
    paths: tuple[Path, ...]
    fields: tuple[PupilField, ...]
    coherency: Coherency
    plan: PairPlan
    empty: tuple[str, ...]
    unresolved: tuple[Unresolved, ...]


def pupil_samples(rays: Rays, path: Path, space: Space, sigma: Array, x0: Array) -> PupilSamples:
    """Rays of one path as the payload of the wave floor."""
    return PupilSamples(path.label, space, rays.u, sigma, rays.opl, rays.amplitude, rays.clearance, rays.direction,
                        rays.phase, (float(x0[0]), float(x0[1])))  # fmt: skip


def families(paths: Sequence[Path]) -> NDArray[np.int64]:
    """Family number of each path: 0 for the nominal ones, equal for paths with the same parasitic history."""
    known: dict[object, int] = {(): 0}
    return np.array([known.setdefault(path.history, len(known)) for path in paths], dtype=np.int64)


def field_point(
    system: OpticalSystem,
    paths: Sequence[Path],
    x0: Array,
    sigma_range: tuple[float, float],
    envelope: Callable[[Array, Array], Array],
    nma: float,
    tolerance: float,
) -> FieldPoint:
    """Trace every path to ``x0``, fit its pupil field, and compute the mutual coherence of the pairs that matter.

    paths: nominal arm 1, nominal arm 2, then ghosts. sigma_range (1/m): the filter's support. envelope(opd_lo, opd_hi):
    largest coherence of the filtered spectrum over a range of OPDs (m). nma: the nominal one, for the bounds.
    tolerance: largest part of the nominal modulation that one pair may add and be left out.

    Raises EmptyBeamError if a nominal beam does not arrive.
    """
    sigma = chebyshev_wavenumbers(*sigma_range, TRACED_WAVENUMBERS)
    theta = nominal_direction(system, paths[0], x0)
    fields: list[PupilField] = []
    kept: list[Path] = []
    empty: list[str] = []
    unresolved: list[Unresolved] = []
    for path in paths:
        try:
            rays = rays_to_point(system, path, x0, sigma, theta)
            fields.append(fit_field(pupil_samples(rays, path, "pupil", sigma, x0)))
            kept.append(path)
        except EmptyBeamError:
            if path.order == 0:
                raise
            empty.append(path.label)
        except CgiWaveError as error:
            if path.order == 0:
                raise
            unresolved.append(Unresolved(path.label, str(error), path.estimate))
    middle = TRACED_WAVENUMBERS // 2
    powers = np.array([power(field)[0][middle] for field in fields])
    # J is in units of solid angle; the nominal beam of arm 1 says what that is as a share of the input.
    transmission = powers / powers[0] * spot(system, kept[0], theta, system.sigma0).power
    low, high = opd_ranges(fields)
    plan = plan_pairs(
        tuple(path.label for path in kept), transmission, families(kept), low, high, np.ones_like(low), envelope, nma, tolerance,
    )  # fmt: skip
    pairs, failed = _pairs(fields, transmission, plan, sigma_range, nma, tolerance)
    coherency = Coherency(
        tuple(path.label for path in kept), families(kept), np.array([path.order for path in kept], dtype=np.int64),
        transmission, tuple(pairs), (*plan.left_out, *failed),
    )  # fmt: skip
    return FieldPoint(x0, theta, tuple(kept), tuple(fields), coherency, plan, tuple(empty), tuple(unresolved))


def _pairs(
    fields: Sequence[PupilField],
    transmission: Array,
    plan: PairPlan,
    sigma_range: tuple[float, float],
    nma: float,
    tolerance: float,
) -> tuple[list[Pair], list[LeftOut]]:
    """Contrasts of the kept pairs; a pair that no method resolves is left out with its bound, and says why."""
    pairs: list[Pair] = []
    failed: list[LeftOut] = []
    for item in plan.kept:
        weight = np.sqrt(transmission[item.m] * transmission[item.l] / (transmission[0] * transmission[1])) / nma
        tol = float(np.clip(PAIR_SHARE * tolerance / weight, 1e-7, 1e-2))
        try:
            nodes, found = overlap_spectrum(fields[item.m], fields[item.l], *sigma_range, tol)
        except CgiWaveError as error:
            if item.l < 2:
                raise
            failed.append(LeftOut(item.m, item.l, item.modulation, f"not resolved: {error}"))
            continue
        pairs.append(Pair(item.m, item.l, nodes, found.value, found.error_bound, found.opd_m, found.slope, found.method))
    return pairs, failed


def opd_ranges(fields: Sequence[PupilField]) -> tuple[Array, Array]:
    """Smallest and largest group OPD of every pair over the pupil points that both feed, (B, B) m each.

    Group path length = d(σ·opl)/dσ. Pairs that share no sampled point get the whole range of both.
    """
    count = 400
    k = np.arange(count) + 0.5
    spiral = np.column_stack([np.cos(np.pi * (1 + 5**0.5) * k), np.sin(np.pi * (1 + 5**0.5) * k)]) * np.sqrt(k / count)[:, None]
    centres = np.array([field.support.centre for field in fields])
    scales = np.array([field.support.scale for field in fields])
    lo, hi = (centres - scales).min(axis=0), (centres + scales).max(axis=0)
    points = 0.5 * (lo + hi) + 0.5 * (hi - lo) * spiral
    group = np.full((len(fields), count), np.nan)
    for b, field in enumerate(fields):
        x = (points - field.support.centre) / field.support.scale
        near = (x**2).sum(axis=1) <= 1.0
        s = field.sigma
        # d(σ·opl)/dσ at the middle node from the parabola through three nodes.
        product = field.opl * s[:, None, None]
        coefficient = (product[-1] - product[0]) / (s[-1] - s[0])
        group[b, near] = at_points(coefficient, x[near])
    low, high = np.empty((len(fields),) * 2), np.empty((len(fields),) * 2)
    least, most = np.nanmin(group, axis=1), np.nanmax(group, axis=1)
    for m in range(len(fields)):
        difference = group[m] - group
        shared = np.isfinite(difference).any(axis=1)
        low[m] = np.where(shared, np.nanmin(np.where(shared[:, None], difference, 0.0), axis=1), least[m] - most)
        high[m] = np.where(shared, np.nanmax(np.where(shared[:, None], difference, 0.0), axis=1), most[m] - least)
    return low - OPD_MARGIN, high + OPD_MARGIN
