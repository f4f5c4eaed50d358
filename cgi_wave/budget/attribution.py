"""What each surface, and each family of ghosts, costs at one field point: power, contrast, O/B, M*/M, NMA error.

A ghost belongs to its **faces**, the surfaces where it does what light is not meant to do there. Two questions have two
answers, and a third column adds up:

* ``removed``: the whole retrieval again without the ghosts that touch the face; the fall of the NMA error is what an
  ideal coating there would gain;
* ``alone``: the retrieval with these ghosts only. They differ, since the ratio is not linear, a ghost with two faces
  counts at both, and ghosts interfere;
* ``share``: each term of the interferogram (a power, or the fringes of a pair) split evenly over the faces that it
  needs. This is the Shapley value of O/B and of M*/M, and the shares add up to the band's. So do those of the exact NMA
  error, since 1 − (1 + m)/(1 + o) = (o − m)/(1 + o).

Nothing is traced again: removing a ghost removes terms of the interferogram.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.fieldpoint import FieldPoint
from cgi_wave.budget.pointsource import PointSource
from cgi_wave.budget.select import Untraced
from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.nma import Parasitic, Retrieval, retrieve
from cgi_wave.fringes.terms import Factors, Terms
from cgi_wave.rays.paths import Path

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Effect:
    """O/B, M*/M and NMA error of some ghosts, or the fall of each; coherent book-keeping. The error is of the last."""

    offset: float
    modulation: float
    nma: float
    error: float


@dataclass(frozen=True)
class Cost:
    """One face, or one family, at one field point. Powers are relative to the nominal beams together.

    ghosts: traced ones that touch it and arrive; power: their sum; power_share: split evenly over
    their faces;
    share, alone, removed: see the module; contrast_nominal, contrast_family: |J| under a uniform scene with the
    nominal beams and with the ghosts of the own family; contrast: |γ| of a point source with the nominal beam of arm 1.
    These three are means weighted by power over the ghosts of which a pair was computed: None says that all pairs were
    bounded and left out. untraced: power of the ghosts that touch it and were not traced, which stands in the errors.
    """

    ghosts: int
    power: float
    power_share: float
    share: Effect
    alone: Effect
    removed: Effect
    contrast_nominal: float | None
    contrast_family: float | None
    contrast: float | None
    untraced: float


@dataclass(frozen=True)
class FieldCosts:
    """Costs at one field point, by surface and by family, and what all ghosts together do there."""

    surfaces: dict[str, Cost]
    families: dict[str, Cost]
    total: Effect


def faces(path: Path) -> frozenset[str]:
    """Surfaces where a path does what light is not meant to do."""
    return frozenset(name for name, _ in path.history)


def family_of(path: Path) -> frozenset[str]:
    """The one name of a ghost's family: its parasitic history, as labels start with it."""
    name = " ".join(f"{name}:{act[0]}" for name, act in path.history)
    return frozenset((name,)) if name else frozenset()


def attribute(
    point: FieldPoint, terms: Terms, untraced: Untraced | None = None, source: PointSource | None = None
) -> FieldCosts:
    """Costs of every surface and every family at one field point.

    terms: of ``point.coherency`` (``fringes.psi.interferogram_terms``); untraced: enters the errors; source: for |γ|.

    Raises MethodLimitError if M, B and NMA cannot be retrieved.
    """
    untraced = untraced or Untraced()
    whole = retrieve(terms.psi())
    contrasts = _contrasts(point, source)

    def costs(names: Callable[[Path], frozenset[str]]) -> dict[str, Cost]:
        of_beam = [names(path) for path in point.paths]
        unseen = [names(path) for path in untraced.paths]
        shares = _shares(terms, whole, of_beam)
        split = np.array([1.0 / max(len(own), 1) for own in of_beam])
        rows = {
            name: _cost(
                terms, whole, untraced, contrasts, np.array([name in own for own in of_beam]), split,
                np.array([name in own for own in unseen], dtype=bool), shares[name],
            )
            for name in {name for own in of_beam for name in own}
        }  # fmt: skip
        return {name: rows[name] for name in sorted(rows, key=lambda name: (-rows[name].share.nma, name))}

    return FieldCosts(costs(faces), costs(family_of), effect(whole))


def effect(retrieval: Retrieval) -> Effect:
    """What all ghosts of a retrieval do, coherent book-keeping."""
    part = retrieval.coherent
    return Effect(
        part.offset_over_baseline.value, part.parasitic_over_modulation.value, part.nma_error.value,
        part.nma_error.error,
    )  # fmt: skip


def only(terms: Terms, beams: Mask) -> Factors:
    """Factors that keep the nominal beams and the ghosts of a mask (B,)."""
    keep = beams.copy()
    keep[:2] = True
    return Factors.of_powers(terms.coherency, keep.astype(np.float64))


def fall(whole: Parasitic, after: Parasitic, taken: Parasitic, extra: tuple[float, float] = (0.0, 0.0)) -> Effect:
    """Fall of O/B, M*/M and the NMA error between two retrievals of which one has the terms of the other, scaled.

    taken: retrieval of the terms that were taken away, whose errors are those of the difference; what both retrievals
    hold alike cancels but for the curvature of the ratio. extra: further bounds of the change of O/B and M*/M.
    """
    o, m = (getattr(whole, name).value for name in ("offset_over_baseline", "parasitic_over_modulation"))
    o2, m2 = (getattr(after, name).value for name in ("offset_over_baseline", "parasitic_over_modulation"))
    by_o, by_m, by_o2, by_m2 = *_slopes(o, m), *_slopes(o2, m2)
    error = abs(by_o) * (taken.offset_over_baseline.error + extra[0])
    error += abs(by_m) * (taken.parasitic_over_modulation.error + extra[1])
    error += abs(by_o - by_o2) * after.offset_over_baseline.error
    error += abs(by_m - by_m2) * after.parasitic_over_modulation.error
    return Effect(o - o2, m - m2, whole.nma_error.value - after.nma_error.value, error)


def _slopes(o: float, m: float) -> tuple[float, float]:
    """∂/∂o and ∂/∂m of 1 − (1 + m)/(1 + o)."""
    return (1.0 + m) / (1.0 + o) ** 2, -1.0 / (1.0 + o)


def _cost(
    terms: Terms, whole: Retrieval, untraced: Untraced, contrasts: tuple[Array, Array, Array], touches: Mask,
    split: Array, unseen: Mask, share: Effect,
) -> Cost:  # fmt: skip
    """One row; touches (B,), unseen (U,): the ghosts it is about, traced and not; split (B,): their parts of it."""
    without = only(terms, ~touches)
    extra = untraced.bounds(unseen.astype(np.float64))
    taken = retrieve(terms.psi(without.complement(terms.coherency))).coherent
    removed = fall(whole.coherent, retrieve(terms.psi(without)).coherent, taken, extra)
    alone = retrieve(terms.psi(only(terms, touches))).coherent
    nominal = float(terms.coherency.transmission[:2].sum())
    power = terms.coherency.transmission / nominal
    by_o, by_m = _slopes(alone.offset_over_baseline.value, alone.parasitic_over_modulation.value)
    return Cost(
        ghosts=int(touches.sum()),
        power=float(power[touches].sum()),
        power_share=float((power * split)[touches].sum()),
        # What touches the face bounds what it shares: each of its terms is counted once at most.
        share=Effect(share.offset, share.modulation, share.nma, removed.error),
        alone=Effect(
            alone.offset_over_baseline.value, alone.parasitic_over_modulation.value, alone.nma_error.value,
            alone.nma_error.error + abs(by_o) * extra[0] + abs(by_m) * extra[1],
        ),
        removed=removed,
        contrast_nominal=_weighted(contrasts[0], power, touches),
        contrast_family=_weighted(contrasts[1], power, touches),
        contrast=_weighted(contrasts[2], power, touches),
        untraced=float(untraced.power[unseen].sum()),
    )  # fmt: skip


def _shares(terms: Terms, whole: Retrieval, needs: Sequence[frozenset[str]]) -> dict[str, Effect]:
    """Every term split evenly over the names that it needs; needs: of each beam, and a pair needs those of both.

    Terms with like needs are fitted together: the fit is linear, so that all parts add up to the whole.
    """
    coherency = terms.coherency
    of_pair = [needs[pair.m] | needs[pair.l] for pair in coherency.pairs]
    rising = 1.0 + whole.coherent.offset_over_baseline.value
    sums: dict[str, Array] = {}
    for group in sorted({*needs, *of_pair} - {frozenset()}, key=sorted):
        beam = np.array([need == group for need in needs], dtype=np.float64)
        pair = np.array([need == group for need in of_pair], dtype=np.float64)
        beam[:2] = 1.0
        pair[coherency.nominal_pair] = 1.0
        fitted = retrieve(terms.psi(Factors(beam, pair, np.zeros(len(coherency.left_out))))).coherent
        o, m = fitted.offset_over_baseline.value, fitted.parasitic_over_modulation.value
        for name in group:
            sums[name] = sums.get(name, np.zeros(3)) + np.array([o, m, (o - m) / rising]) / len(group)
    return {name: Effect(float(row[0]), float(row[1]), float(row[2]), 0.0) for name, row in sums.items()}


def _contrasts(point: FieldPoint, source: PointSource | None) -> tuple[Array, Array, Array]:
    """(B,) each, NaN where none was computed: |J| with the nominal beams and with the own family, |γ| with arm 1.

    |J| is taken at the filter's centre, and is the mean over the ghost's computed pairs of that kind.
    """
    coherency = point.coherency
    found: list[list[list[float]]] = [[[] for _ in coherency.labels] for _ in range(2)]
    for pair in coherency.pairs:
        middle = np.array([0.5 * (pair.sigma[0] + pair.sigma[-1])])
        value = float(abs((chebyshev.interpolation_matrix(pair.sigma, middle) @ pair.gamma)[0]))
        ends = [number for number in (pair.m, pair.l) if number >= 2]
        if len(ends) == 1:
            found[0][ends[0]].append(value)
        elif ends and coherency.family[pair.m] == coherency.family[pair.l]:
            for number in ends:
                found[1][number].append(value)
    by_label = {} if source is None else {ghost.path.label: ghost.contrast for ghost in source.ghosts}
    nominal, family = (np.array([np.mean(v) if v else np.nan for v in values]) for values in found)
    gamma = [by_label.get(label) for label in coherency.labels]
    return nominal, family, np.array([np.nan if value is None else value for value in gamma])


def _weighted(values: Array, power: Array, chosen: Mask) -> float | None:
    """Mean of the known values of a mask, weighted by power."""
    known = chosen & np.isfinite(values)
    carried = float(power[known].sum())
    return float((values[known] * power[known]).sum() / carried) if carried > 0.0 else None
