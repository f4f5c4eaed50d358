"""What every method of overlap contrast answers, and what it returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from cgi_wave.wave.field import PupilField


@dataclass(frozen=True)
class Estimate:
    """γ(m, l) = ∫ A_m A_l exp(i 2πσ(opl_m − opl_l) + i(phase_m − phase_l)) d²u / √(P_m P_l) at one wavenumber.

    value : complex, path differences and constant phases included
    error_bound : absolute, on ``value``; inf where the method can guarantee nothing
    method : its name; nodes : samples, quadrature nodes or rays that were summed; seconds : wall time
    """

    value: complex
    error_bound: float
    method: str
    nodes: int
    seconds: float


class OverlapMethod(Protocol):
    """One method. ``m`` and ``l`` are fields in one space about one reference point; sigma in 1/m."""

    name: str

    def supports(self, m: PupilField, l: PupilField, sigma: float) -> str | None:  # noqa: E741
        """None if the method can treat this pair, else the reason why not, with the limit and what would do."""
        ...

    def error_bound(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """Absolute error that ``evaluate`` promises beforehand when it is asked for ``tol``."""
        ...

    def cost(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """Elementary steps (nodes, or transform samples times their logarithm) that ``evaluate`` will take."""
        ...

    def evaluate(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> Estimate:  # noqa: E741
        """The overlap. Raises MethodLimitError, naming limit and factor, where the method does not reach."""
        ...
