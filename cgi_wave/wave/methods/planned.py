"""Methods that decide on a sampling before they compute: the answers that follow from such a plan."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from cgi_wave.errors import MethodLimitError
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods.base import Estimate
from cgi_wave.wave.methods.shape import Pair, find_pair

LOOSEST = 0.1  # a method supports a pair if it can keep this tolerance on γ


@dataclass(frozen=True)
class Plan:
    """A sampling: the bound on γ that it promises, the steps that it takes, and what the method made of it."""

    bound: float
    cost: float
    sampling: Any


class Planned(ABC):
    """An ``OverlapMethod`` by a plan; sub-classes make plans and carry them out."""

    name: str

    @abstractmethod
    def plan(self, pair: Pair, tol: float) -> Plan:
        """The cheapest sampling that promises ``tol``. Raises MethodLimitError, naming limit and factor."""

    @abstractmethod
    def carry_out(self, pair: Pair, plan: Plan) -> tuple[complex, float, int]:
        """γ, its error bound, and the number of samples or nodes."""

    def supports(self, m: PupilField, l: PupilField, sigma: float) -> str | None:  # noqa: E741
        """None if γ can be had to 0.1 at least, or the reason why not."""
        pair = find_pair(m, l, sigma)
        try:
            if pair is not None:
                self.plan(pair, LOOSEST)
        except MethodLimitError as limit:
            return f"{limit.limit}, exceeded {limit.factor:.3g} times; {limit.remedy}"
        return None

    def error_bound(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """What the plan for ``tol`` promises; inf where there is none."""
        pair = find_pair(m, l, sigma)
        try:
            return 0.0 if pair is None else self.plan(pair, tol).bound
        except MethodLimitError:
            return math.inf

    def cost(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """Elementary steps that the plan for ``tol`` takes; inf where there is none."""
        pair = find_pair(m, l, sigma)
        try:
            return 0.0 if pair is None else self.plan(pair, tol).cost
        except MethodLimitError:
            return math.inf

    def evaluate(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> Estimate:  # noqa: E741
        """γ with the bound that the result itself allows; exactly 0 where the supports do not meet.

        Raises MethodLimitError where ``tol`` cannot be kept, InputError for fields that do not go together.
        """
        started = time.perf_counter()
        pair = find_pair(m, l, sigma)
        if pair is None:
            return Estimate(0j, 0.0, self.name, 0, time.perf_counter() - started)
        value, bound, nodes = self.carry_out(pair, self.plan(pair, tol))
        return Estimate(value, bound, self.name, nodes, time.perf_counter() - started)
