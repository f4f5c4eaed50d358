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

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.fringes.coherency import LeftOut

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


@dataclass(frozen=True)
class PairPlan:
    """``kept`` pairs, largest bound first, and ``skipped`` ones; ``left_out`` goes into the Coherency payload.

    left_out_modulation, left_out_baseline : plain sums of the bounds of the skipped pairs
    largest_opd : m, largest |group OPD| of a kept pair: the spectral step must stay below 1/(4·largest_opd)
    """

    labels: tuple[str, ...]
    tolerance: float
    kept: tuple[PlannedPair, ...]
    skipped: tuple[PlannedPair, ...]
    left_out: tuple[LeftOut, ...]
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
        for kind in sorted({pair.kind for pair in self.skipped}):
            out = [pair for pair in self.skipped if pair.kind == kind]
            lines.append(f"  {kind}: {len(out)} left out, at most {sum(pair.modulation for pair in out):.2e} of M")
        return "\n".join(lines)


def modulation_bound(
    t_m: float, t_l: float, gamma_max: float, envelope: float, t1: float, t2: float, nma: float
) -> float:
    """√(t_m t_l)·γ_max·envelope / (√(t1 t2)·NMA): what the pair can add to M, relative to M. Powers, not amplitudes."""
    return float(np.sqrt(t_m * t_l) * gamma_max * envelope / (np.sqrt(t1 * t2) * nma))


def baseline_bound(t_m: float, t_l: float, gamma_max: float, envelope: float, t1: float, t2: float) -> float:
    """2√(t_m t_l)·γ_max·envelope / (t1 + t2): what the pair adds to B at most (if without fringes), relative to B."""
    return float(2.0 * np.sqrt(t_m * t_l) * gamma_max * envelope / (t1 + t2))


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
    Powers of the beams themselves are never left out here: they belong to the baseline in full.

    Raises InputError for shapes, negative powers, γ above 1, and an NMA or tolerance that is not positive.
    """
    _check(labels, transmission, family, opd_lo, opd_hi, gamma_max, nma, tolerance)
    t1, t2 = float(transmission[0]), float(transmission[1])
    kept: list[PlannedPair] = []
    skipped: list[PlannedPair] = []
    left_out: list[LeftOut] = []
    upper = np.triu_indices(len(labels), 1)
    tops = envelope(opd_lo[upper], opd_hi[upper])
    for m, l, top in zip(*map(np.ndarray.tolist, (*upper, tops)), strict=True):  # noqa: E741
        kind = _kind(m, l, family)
        args = (float(transmission[m]), float(transmission[l]), float(gamma_max[m, l]), top, t1, t2)
        pair = PlannedPair(
            m, l, kind, modulation_bound(*args, nma), baseline_bound(*args),
            float(gamma_max[m, l]), top, float(opd_lo[m, l]), float(opd_hi[m, l]),
        )  # fmt: skip
        least = tolerance * (nominal_share if kind == "ghost-nominal" else 1.0)
        if kind == "nominal" or (pair.modulation > least and (cross_family or kind != "cross-family")):
            kept.append(pair)
            continue
        skipped.append(pair)
        switched = "cross-family pairs switched off; " if pair.modulation > tolerance else ""
        reason = f"{switched}bound {pair.modulation:.2e} of M, tolerance {tolerance:g}"
        share = float("nan") if frequency is None else float(frequency[m, l])
        left_out.append(LeftOut(m, l, pair.modulation, reason, share))
    kept.sort(key=lambda pair: -pair.modulation)
    skipped.sort(key=lambda pair: -pair.modulation)
    return PairPlan(
        labels=labels,
        tolerance=tolerance,
        kept=tuple(kept),
        skipped=tuple(skipped),
        left_out=tuple(left_out),
        left_out_modulation=sum(pair.modulation for pair in skipped),
        left_out_baseline=sum(pair.baseline for pair in skipped),
        largest_opd=max(max(abs(pair.opd_lo), abs(pair.opd_hi)) for pair in kept),
    )


def _kind(m: int, l: int, family: NDArray[np.int64]) -> str:  # noqa: E741
    if l < 2:
        return "nominal"
    if m < 2:
        return "ghost-nominal"
    return "one family" if family[m] == family[l] else "cross-family"


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
