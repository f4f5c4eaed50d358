"""Direct summation: every node of the pupil adds its plane wave to every point. Slow, and little can go wrong."""

from __future__ import annotations

import numpy as np

from cgi_wave.errors import MethodLimitError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods import nodes as rules
from cgi_wave.wave.methods.patch import Amplitude, Patch, choose_patch, overlap_sum, patch_noise
from cgi_wave.wave.methods.planned import Plan, Planned
from cgi_wave.wave.methods.shape import Beam, Pair, beam_at
from cgi_wave.wave.region import SAFETY

NAME = "direct summation"
LEVEL = 2
SIDE_CAP = 512  # points along one side of a patch: seconds for a pupil of few waves
STEP_CAP = 4e11  # node-point products in one sum: minutes


def amplitude(field: PupilField, x: Array, y: Array, sigma: float, level: int = LEVEL) -> Amplitude:
    """Complex PSF at the points of a grid x (X,) by y (Y,), m, by quadrature on boundary-fitted panels.

    ``error`` is twice the largest change of |h| from the level below, over all points.
    Raises MethodLimitError beyond the node cap.
    """
    beam = beam_at(field, sigma)
    reach = rules.farthest(x, y)
    coarse = rules.direct_sum(rules.panel_nodes(beam, reach, level - 1), sigma, x, y)
    nodes = rules.panel_nodes(beam, reach, level)
    fine = rules.direct_sum(nodes, sigma, x, y)
    error = SAFETY * float(np.abs(fine - coarse).max())
    return Amplitude(x, y, fine * beam.constant, sigma, NAME, len(nodes.u), error)


class Huygens(Planned):
    """Overlap as a sum on a patch, its PSFs by direct summation."""

    name = NAME

    def __init__(self, points: int = SIDE_CAP) -> None:
        self.points = points

    def plan(self, pair: Pair, tol: float) -> Plan:
        """The patch that ``tol`` asks for. Raises MethodLimitError."""
        fixed = pair.misfit + pair.rounding
        patch, left = choose_patch(pair, 0.9 * max(tol - fixed, 1e-300), self.name, self.points)
        reach = rules.farthest(patch.axis(0), patch.axis(1))
        nodes = sum(rules.estimate_nodes(b, reach, LEVEL) for b in (pair.m, pair.l))
        steps = float(nodes) * patch.count[0] * patch.count[1]
        if steps > STEP_CAP:
            raise MethodLimitError(
                self.name,
                f"{nodes} nodes on {patch.count[0]} × {patch.count[1]} points (limit {STEP_CAP:.0e} products)",
                steps / STEP_CAP,
                "use the NUFFT of the same nodes, or sum over the pupil (cgi_wave.wave.overlap)",
            )
        return Plan(left + 0.05 * tol + fixed, steps, patch)

    def carry_out(self, pair: Pair, plan: Plan) -> tuple[complex, float, int]:
        """The sum on the patch; its bound from the light that the patch is found to miss, and from two levels."""
        patch: Patch = plan.sampling
        h = [self._one(b, patch) for b in (pair.m, pair.l)]
        value, left = overlap_sum(pair, h[0], h[1], patch)
        noise = sum(patch_noise(a, patch, b.power) for a, b in zip(h, (pair.m, pair.l), strict=True))
        return value, left + noise + pair.misfit + pair.rounding, h[0].nodes + h[1].nodes

    def _one(self, beam: Beam, patch: Patch) -> Amplitude:
        x, y = patch.axis(0), patch.axis(1)
        reach = rules.farthest(x, y)
        nodes = rules.panel_nodes(beam, reach, LEVEL)
        error = SAFETY * rules.difference(nodes, rules.panel_nodes(beam, reach, LEVEL - 1), beam.sigma, x, y)
        return Amplitude(x, y, rules.direct_sum(nodes, beam.sigma, x, y), beam.sigma, NAME, len(nodes.u), error)
