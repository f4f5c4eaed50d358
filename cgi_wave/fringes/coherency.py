"""The payload between waves and fringes: powers and mutual coherence of all beams of one field point."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Pair:
    """Mutual coherence of beams m and l at S wavenumbers.

    The pair's part of the irradiance at detector coordinate y (measured from the field point, along the OPD axis) is
    Σ_σ I0(σ) · 2√(t_m t_l) · Re[gamma(σ) · exp(i 2πσ (opd_m(σ) + slope·y))]   (Eq. 2 with a complex contrast).

    m, l : indices into ``Coherency.labels``
    sigma : (S,) 1/m, Chebyshev nodes over the band's spectral range, ascending
    gamma : (S,) complex, |gamma| ≤ 1, slowly varying in σ
    error : (S,) absolute bound on the error of gamma
    opd_m : (S,) m, phase OPD at each σ (group OPD follows from its variation with σ)
    slope : dOPD/dy, dimensionless
    method : name of the method that produced gamma
    pivot : (2,) m, the entrance pupil point of which opd_m is the path difference; NaN where nobody asked
    """

    m: int
    l: int  # noqa: E741  (the paper's symbol)
    sigma: NDArray[np.float64]
    gamma: NDArray[np.complex128]
    error: NDArray[np.float64]
    opd_m: NDArray[np.float64]
    slope: float
    method: str
    pivot: tuple[float, float] = (float("nan"), float("nan"))


@dataclass(frozen=True)
class LeftOut:
    """A pair that was not computed, with the bound of what it could add to the modulation (relative to M).

    frequency : of the pair's fringes along y, as a share of the nominal fringe frequency; NaN if it is not known
    """

    m: int
    l: int  # noqa: E741
    bound: float
    reason: str
    frequency: float = float("nan")


@dataclass(frozen=True)
class LeftOutPairs:
    """Many ``LeftOut``, by columns: there are tens of thousands of them.

    m, l, bound, frequency : (L,) as in ``LeftOut``; why : (L,) index into ``reasons``
    """

    m: NDArray[np.int64]
    l: NDArray[np.int64]  # noqa: E741
    bound: NDArray[np.float64]
    frequency: NDArray[np.float64]
    why: NDArray[np.int64]
    reasons: tuple[str, ...]

    @staticmethod
    def of(pairs: Iterable[LeftOut]) -> LeftOutPairs:
        """Columns of single pairs."""
        rows = list(pairs)
        reasons = tuple(dict.fromkeys(row.reason for row in rows))
        return LeftOutPairs(
            np.array([row.m for row in rows], dtype=np.int64), np.array([row.l for row in rows], dtype=np.int64),
            np.array([row.bound for row in rows], dtype=np.float64),
            np.array([row.frequency for row in rows], dtype=np.float64),
            np.array([reasons.index(row.reason) for row in rows], dtype=np.int64), reasons,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.m)

    def __iter__(self) -> Iterator[LeftOut]:
        columns = (column.tolist() for column in (self.m, self.l, self.bound, self.why, self.frequency))
        for m, l, bound, why, frequency in zip(*columns, strict=True):  # noqa: E741
            yield LeftOut(m, l, bound, self.reasons[why], frequency)

    def some(self, chosen: NDArray[np.bool_]) -> LeftOutPairs:
        """The pairs of a mask (L,)."""
        return LeftOutPairs(self.m[chosen], self.l[chosen], self.bound[chosen], self.frequency[chosen],
                            self.why[chosen], self.reasons)  # fmt: skip

    def extended(self, pairs: Iterable[LeftOut]) -> LeftOutPairs:
        """With more pairs at the end."""
        more = LeftOutPairs.of(pairs)
        return LeftOutPairs(
            np.concatenate([self.m, more.m]), np.concatenate([self.l, more.l]),
            np.concatenate([self.bound, more.bound]), np.concatenate([self.frequency, more.frequency]),
            np.concatenate([self.why, more.why + len(self.reasons)]), (*self.reasons, *more.reasons),
        )  # fmt: skip


@dataclass(frozen=True)
class Coherency:
    """All beams of one field point: labels[0] and labels[1] are the nominal beams of arms 1 and 2.

    labels : B path labels
    family : (B,) int, equal for beams with the same parasitic history (the nominals are family 0)
    order : (B,) int, number of parasitic reflections
    transmission : (B,) power of each beam relative to the input (vignetting included)
    transmission_error : (B,) absolute error of each; empty where it is nil
    """

    labels: tuple[str, ...]
    family: NDArray[np.int64]
    order: NDArray[np.int64]
    transmission: NDArray[np.float64]
    pairs: tuple[Pair, ...]
    left_out: LeftOutPairs = field(default_factory=lambda: LeftOutPairs.of(()))
    transmission_error: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    @property
    def nominal_pair(self) -> int:
        """Number of the pair of both nominal beams among ``pairs``."""
        return next(k for k, pair in enumerate(self.pairs) if {pair.m, pair.l} == {0, 1})
