"""What a remedy does at one field point: NMA error before and after, what it gains and what it costs.

Beside the gain by recomputation stand two guesses that need none, so that one sees where they mislead:

* ``guess``: for a coating, the power of the ghosts off its surfaces goes with the coefficient, and the NMA error falls
  by what the power falls (Eq. 1 without M*); for an element that is moved, the fringes of its ghosts vanish and their
  power stays;
* ``tangent``: for a coating, the exact derivative of the NMA error by the coefficient, continued straight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.attribution import faces, fall
from cgi_wave.budget.fieldpoint import FieldPoint, field_point
from cgi_wave.budget.remedies import Remedy, between, meets_otherwise, parasitic, power_factors
from cgi_wave.budget.select import Untraced
from cgi_wave.budget.setting import Setting
from cgi_wave.fringes.nma import Parasitic, Retrieval, retrieve
from cgi_wave.fringes.psi import interferogram_terms
from cgi_wave.fringes.terms import Factors, Terms
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.beams import spot
from cgi_wave.rays.paths import Path

Array = NDArray[np.float64]

#: Step of the derivative, as a share of the way to the new coefficient.
STEP = 1e-4


@dataclass(frozen=True)
class Seen:
    """One field point of an instrument as it is, or changed.

    transmission: t1 + t2 of the input; spot_m: radial RMS of the nominal spot, the larger of both arms, m; fringes: of
    the nominal beams in the zone; untraced: ghosts that were found and not traced.
    """

    point: FieldPoint
    terms: Terms
    retrieval: Retrieval
    transmission: float
    spot_m: float
    fringes: float
    untraced: Untraced


@dataclass(frozen=True)
class Outcome:
    """A remedy at one field point; NMA errors with their error bars, coherent book-keeping.

    gain: fall of |NMA error|, with the error of the difference; guess, tangent: see the module (tangent: None where
    nothing is scaled). The rest as in ``Seen``, after the change; nma: the nominal beams' own.
    """

    offset: float
    modulation: float
    nma_error: float
    nma_error_bar: float
    gain: float
    gain_error: float
    guess: float
    tangent: float | None
    transmission: float
    spot_m: float
    fringes: float
    nma: float


def see(
    setting: Setting, paths: Sequence[Path], untraced: Untraced, x0: Array, y_m: Array, tolerance: float
) -> Seen:  # fmt: skip
    """Trace a field point, and retrieve M, B and NMA; paths: nominal arm 1, arm 2, then ghosts; y_m (R,): the rows.

    Raises EmptyBeamError, MethodLimitError.
    """
    system = setting.system
    point = field_point(setting, paths, x0, tolerance)
    terms = interferogram_terms(point.coherency, setting.spectrum.sigma, setting.weight, y_m, system.pixel)
    spots = [spot(system, path, point.theta, system.sigma0) for path in point.paths[:2]]
    _, _, low, high = system.zone()
    return Seen(
        point, terms, retrieve(terms.psi()), float(point.coherency.transmission[:2].sum()),
        max(float(np.hypot(*one.rms)) for one in spots), abs(terms.slope) * (high - low) * system.sigma0, untraced,
    )  # fmt: skip


def rescaled(system: OpticalSystem, before: Seen, remedy: Remedy) -> Outcome:
    """Outcome of other constant coatings, from the stored terms; see ``budget.remedies.scales_exactly``."""
    assert remedy.coatings is not None  # the caller has asked scales_exactly
    terms, whole = before.terms, before.retrieval.coherent
    power = power_factors(system, before.point.paths, remedy.coatings)
    factors = Factors.of_powers(terms.coherency, power)
    retrieval = retrieve(terms.psi(factors))
    taken = retrieve(terms.psi(factors.complement(terms.coherency))).coherent
    unseen = power_factors(system, before.untraced.paths, remedy.coatings) / np.sqrt(power[0] * power[1])
    change = fall(whole, retrieval.coherent, taken, before.untraced.bounds(1.0 - unseen))
    step = {
        name: between(system.surfaces[system.number[name]].coating, new, STEP) for name, new in remedy.coatings.items()
    }
    near = retrieve(terms.psi(Factors.of_powers(terms.coherency, power_factors(system, before.point.paths, step))))
    slope = (abs(whole.nma_error.value) - abs(near.coherent.nma_error.value)) / STEP
    t = terms.coherency.transmission
    return _outcome(
        before, retrieval, change.error, guess(system, before, remedy), slope, float(power[:2] @ t[:2]), before.spot_m,
        before.fringes,
    )  # fmt: skip


def retraced(system: OpticalSystem, before: Seen, after: Seen, remedy: Remedy) -> Outcome:
    """Outcome of a change that was traced again; system: the one before it.

    Pairs that were left out have unknown phases. Those of ghosts that meet the changed surfaces otherwise than the
    nominal beams do take others, and both their bounds count, in squares; the phases of the rest are held to stay.
    """
    error = np.zeros(2)
    left = np.zeros(2)
    for seen in (before, after):
        own, book = seen.retrieval.coherent, seen.terms.psi().coherent
        nominal = seen.retrieval.nominal
        ratio = nominal.modulation.value / nominal.baseline.value
        error += [
            own.offset_over_baseline.error - book.left_out_baseline * ratio,
            own.parasitic_over_modulation.error - book.left_out,
        ]
        paths = seen.point.paths
        turned = np.array([path.order > 0 and meets_otherwise(path, paths[:2], remedy.surfaces) for path in paths])
        out = seen.terms.coherency.left_out
        none = np.zeros(len(seen.terms.coherency.pairs))
        none[seen.terms.coherency.nominal_pair] = 1.0
        beams = np.array([1.0, 1.0, *([0.0] * (len(paths) - 2))])
        some = seen.terms.psi(Factors(beams, none, (turned[out.m] | turned[out.l]).astype(np.float64))).coherent
        unseen = [meets_otherwise(path, paths[:2], remedy.surfaces) for path in seen.untraced.paths]
        hidden = seen.untraced.bounds(np.array(unseen, dtype=np.float64))[1]
        left = np.hypot(left, [some.left_out_baseline * ratio, np.hypot(some.left_out, hidden)])
    error[0] += abs(float(before.untraced.power.sum()) - float(after.untraced.power.sum()))
    slopes = np.maximum(_slopes(before.retrieval.coherent), _slopes(after.retrieval.coherent))
    return _outcome(
        before, after.retrieval, float(slopes @ (error + left)), guess(system, before, remedy), None,
        after.transmission, after.spot_m, after.fringes,
    )  # fmt: skip


def guess(system: OpticalSystem, before: Seen, remedy: Remedy) -> float:
    """The gain that needs no computation; see the module."""
    whole = before.retrieval.coherent.nma_error.value
    terms, paths = before.terms, before.point.paths
    ghosts = [bool(faces(path) & set(remedy.surfaces)) for path in paths]
    if remedy.coatings is None:
        ends = np.array([ghosts[pair.m] or ghosts[pair.l] for pair in terms.coherency.pairs])
        still = Factors(np.ones(len(paths)), (~ends).astype(np.float64), np.ones(len(terms.coherency.left_out)))
        return abs(whole) - abs(retrieve(terms.psi(still)).coherent.nma_error.value)
    lost = {}
    for name, new in remedy.coatings.items():
        surface = system.surfaces[system.number[name]]
        now = parasitic(system, surface) or 0.0
        lost[name] = 1.0 - (new.transmittance if surface.nominal == "reflect" else new.reflectance) / now
    power = terms.coherency.transmission / before.transmission
    share = [max((lost[name] for name in faces(path) & set(lost)), default=0.0) for path in paths]
    return float(np.sign(whole) * (np.array(share) @ power))


def _slopes(part: Parasitic) -> Array:
    """(2,) sizes of the derivatives of the exact NMA error by O/B and M*/M."""
    o, m = part.offset_over_baseline.value, part.parasitic_over_modulation.value
    return np.array([abs(1.0 + m) / (1.0 + o) ** 2, 1.0 / (1.0 + o)])


def _outcome(
    before: Seen, retrieval: Retrieval, error: float, guessed: float, tangent: float | None, transmission: float,
    spot_m: float, fringes: float,
) -> Outcome:  # fmt: skip
    part = retrieval.coherent
    return Outcome(
        offset=part.offset_over_baseline.value,
        modulation=part.parasitic_over_modulation.value,
        nma_error=part.nma_error.value,
        nma_error_bar=part.nma_error.error,
        gain=abs(before.retrieval.coherent.nma_error.value) - abs(part.nma_error.value),
        gain_error=error,
        guess=guessed,
        tangent=tangent,
        transmission=transmission,
        spot_m=spot_m,
        fringes=fringes,
        nma=retrieval.nominal.nma.value,
    )
