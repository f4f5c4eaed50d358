"""One field point of one band: every beam that feeds it, its power, and the coherence of the pairs that matter."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.plan import PairPlan, plan_pairs
from cgi_wave.budget.ranges import pair_ranges
from cgi_wave.budget.setting import Setting
from cgi_wave.errors import CgiWaveError, EmptyBeamError
from cgi_wave.fringes.coherency import Coherency, LeftOut, Pair
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.beams import Rays, Sheet, nominal_direction, rays_to_point, spot
from cgi_wave.rays.clearances import limiting
from cgi_wave.rays.paths import Path
from cgi_wave.wave.basis import chebyshev_wavenumbers
from cgi_wave.wave.field import PupilField, fit_field, power
from cgi_wave.wave.overlap import overlap_spectrum
from cgi_wave.wave.samples import PupilSamples, Space

Array = NDArray[np.float64]

#: Wavenumbers at which beams are traced; path lengths are the parabola through them.
TRACED_WAVENUMBERS = 3
#: Ghost–nominal pairs are computed down to this part of the tolerance: they are few, and all that the paper keeps.
NOMINAL_SHARE = 0.1
#: What a computed pair may add to the error of M, as a share of the tolerance.
PAIR_SHARE = 0.1
#: Misfit of pupil fields (rad of phase, amplitude and clearance together) at which a degree is enough.
FIT_TARGET = 1e-5
#: Misfit of two pupil fields' phases, rad, beyond which their overlap would carry an error bound as large as itself.
UNRESOLVED = 0.5


@dataclass(frozen=True)
class Unresolved:
    """A beam whose field could not be made: its label, why, and its power by the path search (relative to t1 + t2)."""

    label: str
    reason: str
    estimate: float


@dataclass(frozen=True)
class FieldPoint:
    """Beams and coherence at detector point x0 (m), seen from source direction theta (cosines).

    sheets: of ``paths``, in the order of ``coherency.labels``; empty: labels of paths that do not reach this point;
    unresolved: beams that a pair needed and whose field could not be made (the pair is then left out with its bound).
    fields: pupil fields of the beams in pairs, by their number, if they were to be kept
    """

    x0: Array
    theta: Array
    paths: tuple[Path, ...]
    sheets: tuple[Sheet, ...]
    coherency: Coherency
    plan: PairPlan
    empty: tuple[str, ...]
    unresolved: tuple[Unresolved, ...]
    fields: Mapping[int, PupilField] = field(default_factory=dict, repr=False, compare=False)


def pupil_samples(rays: Rays, path: Path, space: Space, sigma: Array, x0: Array, bend: float = 0.0) -> PupilSamples:
    """Rays of one path as the payload of the wave floor; bend, 1/m: of the chart that they were traced for."""
    clearance = limiting(rays.clearance, rays.pupil[0])
    point = (float(x0[0]), float(x0[1]))
    return PupilSamples(path.label, space, rays.u, sigma, rays.opl, rays.amplitude, clearance, rays.direction,
                        rays.phase, point, bend)  # fmt: skip


def families(paths: Sequence[Path]) -> NDArray[np.int64]:
    """Family number of each path: 0 for the nominal ones, equal for paths with the same parasitic history."""
    known: dict[object, int] = {(): 0}
    return np.array([known.setdefault(path.history, len(known)) for path in paths], dtype=np.int64)


@dataclass(frozen=True)
class Beams:
    """What tracing says of one field point before anything is computed of waves: rays, powers, and the plan.

    paths, rays, sheets: of the beams that arrive; power (B, 2): sums over rays and their errors, in units of J.
    """

    theta: Array
    paths: tuple[Path, ...]
    rays: tuple[Rays, ...]
    sheets: tuple[Sheet, ...]
    power: Array
    plan: PairPlan
    empty: tuple[str, ...]


def trace_beams(
    setting: Setting,
    paths: Sequence[Path],
    x0: Array,
    tolerance: float,
    cross_family: bool = False,
    wanted: Collection[frozenset[str]] = (),
) -> Beams:
    """Trace every path to ``x0`` and plan which pairs of beams are worth computing; arguments as in ``field_point``."""
    system, envelope, nma = setting.system, setting.envelope, setting.nma
    # One wavenumber is enough to plan with; beams that get a pupil field are traced again at all of them.
    sigma = chebyshev_wavenumbers(*setting.support, TRACED_WAVENUMBERS)[[TRACED_WAVENUMBERS // 2]]
    theta = nominal_direction(system, paths[0], x0)
    traced: list[Rays] = []
    kept: list[Path] = []
    empty: list[str] = []
    for path in paths:
        try:
            traced.append(rays_to_point(system, path, x0, sigma, theta))
            kept.append(path)
        except EmptyBeamError:
            if path.order == 0:
                raise
            empty.append(path.label)
    sums = np.array([rays.power() for rays in traced])
    sheets = tuple(rays.sheet(sigma) for rays in traced)
    group = families(kept)
    weight = sums[:, 0] / (nma * sums[0, 0])
    low, high, gamma, slope = pair_ranges(sheets, system.sigma0, weight, envelope, tolerance)
    frequency = slope / slope[0, 1] if slope[0, 1] != 0.0 else None
    labels = tuple(path.label for path in kept)
    plan = plan_pairs(
        labels,
        sums[:, 0],
        group,
        low,
        high,
        gamma,
        envelope,
        nma,
        tolerance,
        cross_family,
        frequency,
        NOMINAL_SHARE,
        wanted,
    )
    return Beams(theta, tuple(kept), tuple(traced), sheets, sums, plan, tuple(empty))


def field_point(
    setting: Setting,
    paths: Sequence[Path],
    x0: Array,
    tolerance: float,
    cross_family: bool = False,
    wanted: Collection[frozenset[str]] = (),
) -> FieldPoint:
    """Trace every path to ``x0``, fit its pupil field, and compute the mutual coherence of the pairs that matter.

    paths: nominal arm 1, nominal arm 2, then ghosts. tolerance: largest part of the nominal modulation that one pair
    may add and be left out. cross_family: compute pairs of ghosts off different surfaces too. Their phase hangs on
    distances that no drawing gives to a fraction of a wavelength, so that a number for them is one of many; by default
    they are left out with their bounds. wanted: pairs of labels that are computed whatever their bound.

    A beam of which every pair stays below the tolerance adds its power only: that is summed over its rays, with the
    error of such a sum, and no field is fitted to it.

    Raises EmptyBeamError if a nominal beam does not arrive.
    """
    return coherence_of(setting, trace_beams(setting, paths, x0, tolerance, cross_family, wanted), x0, tolerance)


def coherence_of(setting: Setting, beams: Beams, x0: Array, tolerance: float, keep: bool = False) -> FieldPoint:
    """The second half of ``field_point``: pupil fields and mutual coherence of what ``trace_beams`` found.

    keep: the fields go into the result.
    """
    system = setting.system
    sigma = chebyshev_wavenumbers(*setting.support, TRACED_WAVENUMBERS)
    fields, unresolved = _fields(system, beams, sigma, x0)
    # J is in units of solid angle; the nominal beam of arm 1 says what that is as a share of the input.
    nominal = spot(system, beams.paths[0], beams.theta, system.sigma0).power
    share = nominal / power(fields[0])[0][TRACED_WAVENUMBERS // 2]
    transmission, error = beams.power.T * share
    for number, one in fields.items():
        value, relative = power(one)
        transmission[number] = value[TRACED_WAVENUMBERS // 2] * share
        error[number] = transmission[number] * relative
    pairs, failed = _pairs(fields, transmission, beams.plan, setting, tolerance)
    orders = np.array([path.order for path in beams.paths], dtype=np.int64)
    coherency = Coherency(
        beams.plan.labels,
        families(beams.paths),
        orders,
        transmission,
        tuple(pairs),
        beams.plan.left_out.extended(failed),
        error,
    )
    return FieldPoint(x0, beams.theta, beams.paths, beams.sheets, coherency, beams.plan, beams.empty, unresolved,
                      fields if keep else {})  # fmt: skip


def _fields(
    system: OpticalSystem, beams: Beams, sigma: Array, x0: Array
) -> tuple[dict[int, PupilField], tuple[Unresolved, ...]]:
    """Pupil fields of the beams that a kept pair needs; a ghost whose field cannot be made is named with the reason."""
    fields: dict[int, PupilField] = {}
    unresolved: list[Unresolved] = []
    for number in sorted({number for pair in beams.plan.kept for number in (pair.m, pair.l)}):
        path = beams.paths[number]
        try:
            rays = rays_to_point(system, path, x0, sigma, beams.theta)
            fields[number] = fit_field(pupil_samples(rays, path, "pupil", sigma, x0), target=FIT_TARGET)
        except CgiWaveError as error:
            if number < 2:
                raise
            unresolved.append(Unresolved(path.label, str(error), path.estimate))
    return fields, tuple(unresolved)


def _pairs(
    fields: Mapping[int, PupilField],
    transmission: Array,
    plan: PairPlan,
    setting: Setting,
    tolerance: float,
) -> tuple[list[Pair], list[LeftOut]]:
    """Contrasts of the kept pairs; a pair that no method resolves is left out with its bound, and says why."""
    pairs: list[Pair] = []
    failed: list[LeftOut] = []
    for item in plan.kept:
        if item.m not in fields or item.l not in fields:
            failed.append(LeftOut(item.m, item.l, item.modulation, "not resolved: no pupil field"))
            continue
        blur = 2.0 * np.pi * setting.support[1] * (fields[item.m].opl_residual + fields[item.l].opl_residual)
        if blur > UNRESOLVED and item.l >= 2:
            failed.append(LeftOut(item.m, item.l, item.modulation, f"not resolved: phases misfit by {blur:.2g} rad"))
            continue
        weight = (
            np.sqrt(transmission[item.m] * transmission[item.l] / (transmission[0] * transmission[1])) / setting.nma
        )
        tol = float(np.clip(PAIR_SHARE * tolerance / weight, 1e-7, 1e-2))
        try:
            nodes, found = overlap_spectrum(fields[item.m], fields[item.l], *setting.support, tol)
        except CgiWaveError as error:
            if item.l < 2:
                raise
            failed.append(LeftOut(item.m, item.l, item.modulation, f"not resolved: {error}"))
            continue
        pairs.append(
            Pair(
                item.m,
                item.l,
                nodes,
                found.value,
                found.error_bound,
                found.opd_m,
                found.slope,
                found.method,
                found.pivot,
            )
        )
    return pairs, failed
