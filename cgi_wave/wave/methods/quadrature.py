"""The two quadratures that know no grid, as methods: Gauss panels over the area, and integrals along the boundary."""

from __future__ import annotations

import math
import time

import numpy as np

from cgi_wave.errors import MethodLimitError
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods.base import Estimate
from cgi_wave.wave.overlap import overlap, phase_spread, quadrature_nodes
from cgi_wave.wave.region import METHOD as PANELS_METHOD
from cgi_wave.wave.stokes import BOUNDARY_METHOD


class _Quadrature:
    """``overlap`` by one of its methods at one wavenumber."""

    name = ""
    _way = ""

    def supports(self, m: PupilField, l: PupilField, sigma: float) -> str | None:  # noqa: E741
        """None: both take every pair of fields, as far as their cost allows."""
        return None

    def error_bound(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """The tolerance, and the misfit of the two fields' paths (rad) on a contrast of at most 1."""
        return tol + 2.0 * math.pi * sigma * (m.opl_residual + l.opl_residual)

    def evaluate(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> Estimate:  # noqa: E741
        """See ``overlap``; raises what it raises."""
        started = time.perf_counter()
        found = overlap(m, l, np.array([sigma]), tol, self._way)
        value = complex(found.value[0] * np.exp(2j * np.pi * sigma * found.opd_m[0]))
        seconds = time.perf_counter() - started
        return Estimate(value, float(found.error_bound[0]), found.method, found.nodes, seconds)


class Panels(_Quadrature):
    """Boundary-fitted Gauss panels over the common support: cheap for few waves, dear (W to W²) for many."""

    name = PANELS_METHOD
    _way = "panels"

    def cost(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """Nodes of the first two levels; inf beyond the node cap."""
        try:
            return quadrature_nodes(m, l, sigma)
        except MethodLimitError:
            return math.inf


class Boundary(_Quadrature):
    """Boundary integrals by steepest descent: a few thousand nodes, and some twenty more for every wave."""

    name = BOUNDARY_METHOD
    _way = "boundary"

    def cost(self, m: PupilField, l: PupilField, sigma: float, tol: float) -> float:  # noqa: E741
        """Boundary nodes, from the spread of the path difference (measured: 22 a wave on sheared, obscured pupils)."""
        return 3000.0 + 25.0 * phase_spread(m, l, sigma)
