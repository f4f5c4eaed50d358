"""The terms of an interferogram before they are added, and its three book-keepings.

Every term is a power or the fringes of one pair. An instrument with another coating has the same terms times a number
each, so that its interferogram takes a sum and no wave optics; without some ghosts, the numbers are zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes.coherency import Coherency, LeftOutPairs

Array = NDArray[np.float64]
Bookkeeping = Literal["nominal", "paper", "coherent"]
METHOD = "compressed spectral sum"
#: Least squares over ten fringes tells frequencies apart that differ by more than this share of the nominal one, but
#: for this part of the amplitude (1/(2π·10·0.6) of a sinc's side lobe, three times).
NEAR, LEAKAGE = 0.6, 0.08


@dataclass(frozen=True)
class Interferogram:
    """One book-keeping of a PSI. Irradiance is relative (∫w = 1), see the module.

    irradiance : (R,) per row
    error : absolute bound that holds on every row, the sum of the next four
    power_error : from the errors of the beams' powers, added without cancellation
    contrast_error : from the error bounds of the pairs' γ, added without cancellation
    sampling_error : |sum on the given σ grid − sum on every second sample|, added over pairs
    numerical_error : reduction of the spectral sum, interpolation along y, lost spectral tails, rounding
    left_out : what the pairs that belong here and were left out can add to the modulation, relative to the nominal M:
        bounds added plainly within two families, whose arm pairs keep their phases, and in squares over families,
        whose surfaces no one places to a fraction of a wavelength. A standard error. A pair whose fringes are far from
        the nominal frequency counts by LEAKAGE
    left_out_baseline : the same for the baseline, where pairs without fringes count; in units of the nominal M too
    left_out_bound : the plain sum of all those bounds
    unbounded : number of pairs that belong here and are neither computed nor left out with a bound
    """

    bookkeeping: Bookkeeping
    irradiance: Array
    error: float
    power_error: float
    contrast_error: float
    sampling_error: float
    numerical_error: float
    left_out: float
    left_out_baseline: float
    left_out_bound: float
    unbounded: int


@dataclass(frozen=True)
class Psi:
    """The PSI of one field point.

    y_m : (R,) m, row centres measured from the field point along the OPD axis, ascending
    opd_m : (R,) m, phase OPD of the nominal pair at ``sigma0`` on each row
    sigma0 : 1/m, centroid of w: it depends on the band only, not on the field, and fixes the fringe frequency
    slope : dOPD/dy of the nominal pair; row_height_m : height over which each row integrates (0: a point)
    """

    y_m: Array
    opd_m: Array
    sigma0: float
    slope: float
    row_height_m: float
    nominal: Interferogram
    paper: Interferogram
    coherent: Interferogram
    spectral_nodes: int
    row_nodes: int
    method: str = METHOD


@dataclass(frozen=True)
class Factors:
    """What every term is multiplied by.

    beam (B,): the beams' powers; pair (P,): the fringes of the computed pairs; left_out (L,): the bounds of the pairs
    left out, which are relative to the nominal modulation. Order as in the ``Coherency``.
    """

    beam: Array
    pair: Array
    left_out: Array

    @staticmethod
    def of_powers(coherency: Coherency, beam: Array) -> Factors:
        """Powers of the beams times ``beam`` (B,) ≥ 0, and their pairs with them: an amplitude goes with the root.

        beam[0] and beam[1], of the nominal beams, must not be zero: bounds are relative to their modulation.
        """
        root = np.sqrt(beam)
        ends = np.array([(pair.m, pair.l) for pair in coherency.pairs], dtype=np.int64).reshape(-1, 2)
        out = coherency.left_out
        return Factors(beam, root[ends].prod(axis=1), root[out.m] * root[out.l] / (root[0] * root[1]))

    def complement(self, coherency: Coherency) -> Factors:
        """What these factors take away, measured against nominal beams that stay as they are: 1 − factor.

        A change of the nominal beams themselves is divided out by its geometric mean.
        """
        unit = float(np.sqrt(self.beam[0] * self.beam[1]))
        beam, pair = 1.0 - self.beam / unit, 1.0 - self.pair / unit
        beam[:2] = 1.0
        pair[coherency.nominal_pair] = 1.0
        return Factors(beam, pair, 1.0 - self.left_out)


@dataclass(frozen=True)
class Terms:
    """What ``synthesise`` adds up.

    part (R, P): every computed pair's part of the irradiance on every row; bounds: (P,) each, of a pair's contrast,
    sampling and numerical error on any row. The rest as in ``Psi``.
    """

    coherency: Coherency
    y_m: Array
    opd_m: Array
    sigma0: float
    slope: float
    row_height_m: float
    part: Array
    bounds: Mapping[str, Array]
    spectral_nodes: int
    row_nodes: int

    def psi(self, factors: Factors | None = None) -> Psi:
        """The PSI in its three book-keepings, with the terms as they are or times ``factors``.

        A factor may be negative: it turns the sign of a part, and its bound counts in full.
        """
        nominal, paper, coherent = (self._book(book, factors) for book in ("nominal", "paper", "coherent"))
        return Psi(
            y_m=self.y_m, opd_m=self.opd_m, sigma0=self.sigma0, slope=self.slope, row_height_m=self.row_height_m,
            nominal=nominal, paper=paper, coherent=coherent, spectral_nodes=self.spectral_nodes,
            row_nodes=self.row_nodes,
        )  # fmt: skip

    def _book(self, bookkeeping: Bookkeeping, factors: Factors | None) -> Interferogram:
        coherency = self.coherency
        beams = len(coherency.labels)
        used, out = self._members[bookkeeping]
        taken = slice(0, 2) if bookkeeping == "nominal" else slice(None)
        power, uncertain = coherency.transmission[taken], coherency.transmission_error[taken]
        part, bound = self.part[:, used], coherency.left_out.bound[out]
        pair = np.ones(part.shape[1])
        if factors is not None:
            power, pair = power * factors.beam[taken], factors.pair[used]
            uncertain = uncertain * np.abs(factors.beam[taken]) if len(uncertain) else uncertain
            bound = bound * np.abs(factors.left_out[out])
        doubt = float(uncertain.sum())
        contrast, sampling, numerical = (
            float((self.bounds[name][used] * np.abs(pair)).sum()) for name in ("contrast", "sampling", "numerical")
        )
        wanted = {"nominal": 1, "paper": 1 + 2 * (beams - 2), "coherent": beams * (beams - 1) // 2}[bookkeeping]
        return Interferogram(
            bookkeeping=bookkeeping,
            irradiance=float(power.sum()) + part @ pair,
            error=doubt + contrast + sampling + numerical,
            power_error=doubt,
            contrast_error=contrast,
            sampling_error=sampling,
            numerical_error=numerical,
            left_out=self._standard_error(bookkeeping, bound, "modulation"),
            left_out_baseline=self._standard_error(bookkeeping, bound, "baseline"),
            left_out_bound=float(bound.sum()),
            unbounded=wanted - int(used.sum()) - int(out.sum()),
        )

    @cached_property
    def _members(self) -> dict[str, tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
        """Which computed pairs and which left-out ones belong to each book-keeping."""
        ends = np.array([(pair.m, pair.l) for pair in self.coherency.pairs])
        out = self.coherency.left_out
        return {
            book: (belongs(ends[:, 0], ends[:, 1], book), belongs(out.m, out.l, book))
            for book in ("nominal", "paper", "coherent")
        }

    @cached_property
    def _groups(self) -> dict[str, tuple[NDArray[np.int64], dict[str, Array]]]:
        """By book-keeping, of the left-out pairs: pair of families, and weight on the modulation and the baseline."""
        out = self.coherency.left_out
        both = _family_pairs(self.coherency, out)
        weights = {"modulation": _counts(out, 1.0), "baseline": _counts(out, 0.0)}
        return {
            book: (both[mask], {name: weight[mask] for name, weight in weights.items()})
            for book, (_, mask) in self._members.items()
        }

    def _standard_error(self, bookkeeping: Bookkeeping, bound: Array, on: str) -> float:
        both, weights = self._groups[bookkeeping]
        return _in_squares(both, bound * weights[on])


def standard_error(coherency: Coherency, out: LeftOutPairs, frequency: float) -> float:
    """Bounds added plainly within each pair of families, and in squares over the pairs of families.

    A pair counts in full within NEAR of ``frequency`` (in nominal fringe frequencies) or if its own is not known.
    """
    return _in_squares(_family_pairs(coherency, out), out.bound * _counts(out, frequency))


def _family_pairs(coherency: Coherency, out: LeftOutPairs) -> NDArray[np.int64]:
    """(L,) number of the pair of families that each left-out pair belongs to."""
    one, other = coherency.family[out.m], coherency.family[out.l]
    both = np.minimum(one, other) * (int(coherency.family.max()) + 1) + np.maximum(one, other)
    number: NDArray[np.int64] = np.unique(both, return_inverse=True)[1]
    return number


def _counts(out: LeftOutPairs, frequency: float) -> Array:
    """(L,) 1, or LEAKAGE for fringes that are known to be far from ``frequency``."""
    far = np.abs(np.abs(out.frequency) - frequency) > NEAR  # False for NaN
    return np.where(far, LEAKAGE, 1.0)


def _in_squares(both: NDArray[np.int64], bound: Array) -> float:
    return float(np.sqrt((np.bincount(both, bound) ** 2).sum()))


def belongs(m: NDArray[np.int64], l: NDArray[np.int64], bookkeeping: Bookkeeping) -> NDArray[np.bool_]:  # noqa: E741
    """Which of the pairs (m, l), (P,) each, are part of a book-keeping; beams 0 and 1 are the nominal ones."""
    nominals = np.add(np.less(m, 2), np.less(l, 2), dtype=np.int64)
    mask: NDArray[np.bool_] = nominals >= {"coherent": 0, "paper": 1, "nominal": 2}[bookkeeping]
    return mask
