"""What has to be computed: pairs of beams whose interference can matter, and the bound of what is left out.

A pair (m, l) adds at most 2√(t_m t_l)·|γ|·|G| to the irradiance, with |G| the spectrum's envelope at the pair's group
OPD. Against the nominal modulation 2√(t1 t2)·NMA that is the modulation bound; against t1 + t2, the baseline bound.
Bounds of several pairs add plainly: a root of squares would assume random phases, and is no bound.

|γ|·|G| as a product needs a word. With the OPD spread over the pupil, a(D) dD, the pair adds ∫ a(D) G(D) dD, where
γ = ∫ a(D) dD. With ``gamma_max`` = 1 the largest |G| is a bound whatever a is. The product is one when ``gamma_max``
also bounds every part ∫ a dD up to some D (that of pure defocus does, 1/(πW020)) and |G| does not oscillate over the
range; where that is in doubt, give ``gamma_max`` = 1.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.fringes.coherency import LeftOutPairs

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlannedPair:
    """A pair with its bounds; ``kind`` is nominal, ghost–nominal, one family or cross-family.

    modulation : relative to the nominal M; baseline : relative to t1 + t2
    opd_lo, opd_hi : m, range of the pair's group OPD over its pupil and its spectral range
    """

    m: int
    l: int  # noqa: E741
    kind: str
    modulation: float
    baseline: float
    gamma_max: float
    envelope: float
    opd_lo: float
    opd_hi: float


KINDS = ("nominal", "ghost-nominal", "one family", "cross-family")


@dataclass(frozen=True)
class PlannedPairs:
    """Many ``PlannedPair``, by columns (P,): there are tens of thousands of them. kind: index into KINDS."""

    m: NDArray[np.int64]
    l: NDArray[np.int64]  # noqa: E741
    kind: NDArray[np.int64]
    modulation: Array
    baseline: Array
    gamma_max: Array
    envelope: Array
    opd_lo: Array
    opd_hi: Array

    def __len__(self) -> int:
        return len(self.m)

    def __iter__(self) -> Iterator[PlannedPair]:
        columns = (getattr(self, column.name).tolist() for column in fields(self))
        for m, l, kind, *bounds in zip(*columns, strict=True):  # noqa: E741
            yield PlannedPair(m, l, KINDS[kind], *bounds)

    def some(self, chosen: NDArray[Any]) -> PlannedPairs:
        """The pairs of a mask (P,) or of numbers."""
        return PlannedPairs(*(getattr(self, column.name)[chosen] for column in fields(self)))


@dataclass(frozen=True)
class PairPlan:
    """``kept`` pairs, largest bound first, and ``skipped`` ones; ``left_out`` goes into the Coherency payload.

    left_out_modulation, left_out_baseline : plain sums of the bounds of the skipped pairs
    largest_opd : m, largest |group OPD| of a kept pair: the spectral step must stay below 1/(4·largest_opd)
    """

    labels: tuple[str, ...]
    tolerance: float
    kept: tuple[PlannedPair, ...]
    skipped: PlannedPairs
    left_out: LeftOutPairs
    left_out_modulation: float
    left_out_baseline: float
    largest_opd: float

    def table(self, rows: int | None = None) -> str:
        """Plain text: the kept pairs (the first ``rows``), and what was left out with its bound, by kind."""
        lines = [f"{'M bound':>10}{'B bound':>10}{'gamma':>8}{'env.':>8}{'OPD/mm':>21}  {'kind':<15}pair"]
        for pair in self.kept[:rows]:
            span = f"{pair.opd_lo * 1e3:.3f}…{pair.opd_hi * 1e3:.3f}"
            lines.append(
                f"{pair.modulation:>10.2e}{pair.baseline:>10.2e}{pair.gamma_max:>8.3f}{pair.envelope:>8.3f}{span:>21}  "
                f"{pair.kind:<15}{self.labels[pair.m]} × {self.labels[pair.l]}"
            )
        if rows is not None and len(self.kept) > rows:
            lines.append(f"... and {len(self.kept) - rows} more kept")
        lines.append(
            f"kept {len(self.kept)}, left out {len(self.skipped)} at tolerance {self.tolerance:g} per pair; "
            f"together at most {self.left_out_modulation:.2e} of M and {self.left_out_baseline:.2e} of B"
        )
        for kind in sorted(KINDS):
            out = self.skipped.some(self.skipped.kind == KINDS.index(kind))
            if len(out):
                lines.append(f"  {kind}: {len(out)} left out, at most {out.modulation.sum():.2e} of M")
        return "\n".join(lines)


def modulation_bound(
    t_m: Array, t_l: Array, gamma_max: Array, envelope: Array, t1: float, t2: float, nma: float
) -> Array:
    """√(t_m t_l)·γ_max·envelope / (√(t1 t2)·NMA): what the pair can add to M, relative to M. Powers, not amplitudes."""
    return np.sqrt(t_m * t_l) * gamma_max * envelope / (np.sqrt(t1 * t2) * nma)


def baseline_bound(t_m: Array, t_l: Array, gamma_max: Array, envelope: Array, t1: float, t2: float) -> Array:
    """2√(t_m t_l)·γ_max·envelope / (t1 + t2): what the pair adds to B at most (if without fringes), relative to B."""
    return 2.0 * np.sqrt(t_m * t_l) * gamma_max * envelope / (t1 + t2)


def plan_pairs(
    labels: tuple[str, ...],
    transmission: Array,
    family: NDArray[np.int64],
    opd_lo: Array,
    opd_hi: Array,
    gamma_max: Array,
    envelope: Callable[[Array, Array], Array],
    nma: float,
    tolerance: float,
    cross_family: bool = True,
    frequency: Array | None = None,
    nominal_share: float = 1.0,
    wanted: Collection[frozenset[str]] = (),
) -> PairPlan:
    """Decide which pairs are computed: those whose modulation bound exceeds ``tolerance``, and the nominal one always.

    labels, transmission, family : (B,) as in Coherency (0 and 1 are the nominal beams)
    opd_lo, opd_hi : (B, B) m, range of the group OPD of pair (m, l), m < l, over pupil, zone and band; upper triangle
    gamma_max : (B, B) bound of |γ|; 1 is always safe
    envelope : callable on arrays (opd_lo, opd_hi) → largest |G| between them, as
        :func:`cgi_wave.scene.coherence.coherence_envelope` returns it
    nma : expected nominal NMA (its smallest value over the zone keeps the bound a bound)
    nominal_share : part of the tolerance above which ghost–nominal pairs are kept: they are the paper's whole M*
    frequency : (B, B) fringe frequency of each pair relative to the nominal pair's, for what is left out
    cross_family : False leaves out pairs of ghosts of different families whatever their bound, which is reported
    wanted : pairs of labels that are kept whatever their bound
    Powers of the beams themselves are never left out here: they belong to the baseline in full.

    Raises InputError for shapes, negative powers, γ above 1, and an NMA or tolerance that is not positive.
    """
    _check(labels, transmission, family, opd_lo, opd_hi, gamma_max, nma, tolerance)
    t1, t2 = float(transmission[0]), float(transmission[1])
    m, l = np.triu_indices(len(labels), 1)  # noqa: E741
    gamma, low, high = gamma_max[m, l], opd_lo[m, l], opd_hi[m, l]
    top = envelope(low, high)
    args = (transmission[m], transmission[l], gamma, top, t1, t2)
    pairs = PlannedPairs(m, l, _kinds(m, l, family), modulation_bound(*args, nma), baseline_bound(*args), gamma, top,
                         low, high)  # fmt: skip
    nominal, ghost_nominal, crossing = (pairs.kind == KINDS.index(kind) for kind in (KINDS[0], KINDS[1], KINDS[3]))
    above = pairs.modulation > np.where(ghost_nominal, nominal_share, 1.0) * tolerance
    keep = nominal | (above & (cross_family | ~crossing))
    if wanted:
        keep |= np.array([{labels[i], labels[j]} in wanted for i, j in zip(m, l, strict=True)])
    switched_off = ~keep & (pairs.modulation > tolerance)
    share = np.full(len(m), np.nan) if frequency is None else frequency[m, l]
    reasons = (f"bound below the tolerance, {tolerance:g} of M", "cross-family pairs switched off")
    left_out = LeftOutPairs(m, l, pairs.modulation, share, switched_off.astype(np.int64), reasons).some(~keep)
    kept, skipped = (part.some(np.argsort(-part.modulation, kind="stable")) for part in map(pairs.some, (keep, ~keep)))
    return PairPlan(
        labels=labels,
        tolerance=tolerance,
        kept=tuple(kept),
        skipped=skipped,
        left_out=left_out,
        left_out_modulation=float(skipped.modulation.sum()),
        left_out_baseline=float(skipped.baseline.sum()),
        largest_opd=float(max(np.abs(kept.opd_lo).max(), np.abs(kept.opd_hi).max())),
    )


def _kinds(m: NDArray[np.int64], l: NDArray[np.int64], family: NDArray[np.int64]) -> NDArray[np.int64]:  # noqa: E741
    """(P,) kinds of pairs m < l, as indices into KINDS."""
    among_ghosts = np.where(family[m] == family[l], 2, 3)
    return np.where(l < 2, 0, np.where(m < 2, 1, among_ghosts))


def _check(
    labels: tuple[str, ...],
    transmission: Array,
    family: NDArray[np.int64],
    opd_lo: Array,
    opd_hi: Array,
    gamma_max: Array,
    nma: float,
    tolerance: float,
) -> None:
    beams = len(labels)
    shapes = (transmission.shape, family.shape, opd_lo.shape, opd_hi.shape, gamma_max.shape)
    if beams < 2 or shapes != ((beams,), (beams,), (beams, beams), (beams, beams), (beams, beams)):
        raise InputError("plan_pairs", "shapes", shapes, f"do not fit {beams} beams", "give (B,) and (B, B) arrays")
    upper = np.triu_indices(beams, 1)
    if not (np.all(transmission >= 0.0) and np.all(transmission[:2] > 0.0)):
        raise InputError("plan_pairs", "transmission", float(transmission.min()), "must be ≥ 0, the nominal ones > 0",
                         "leave empty beams out")  # fmt: skip
    if not np.all((gamma_max[upper] >= 0.0) & (gamma_max[upper] <= 1.0)):
        raise InputError("plan_pairs", "gamma_max", float(gamma_max[upper].max()), "must lie in 0…1", "use 1")
    if not np.all(opd_lo[upper] <= opd_hi[upper]):
        raise InputError("plan_pairs", "opd_lo", "above opd_hi", "is no range", "order the two ends")
    if not (nma > 0.0 and tolerance > 0.0):
        raise InputError("plan_pairs", "nma, tolerance", (nma, tolerance), "must be positive", "give both above zero")
