"""Two circular pupils with Hopkins coefficients: the pair of beams that the calculator and the studies speak of."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, fields

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval2d

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.eq4 import contrast_eq4
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods.base import Estimate
from cgi_wave.wave.region import Support
from cgi_wave.wave.stokes import BOUNDARY_METHOD, circular_pair

_SOURCE = "contrast"


@dataclass(frozen=True)
class HopkinsPair:
    """Beam m: unit circular pupil about (shift_x, shift_y) with W about its own centre; beam l: centred and perfect.

    W(x, y) = w020 r² + w040 r⁴ + w131 r² y + w222 y² + w111 y in waves, (x, y) from beam m's own centre in units of the
    pupil radius, so that each coefficient is the aberration at the edge of the pupil. ``obscuration`` is the radius
    of the central obscuration that both pupils have. Field phase exp(+i 2πW); amplitude 1; each beam is normalised by
    its own power π(1 − obscuration²).

    Raises InputError for a coefficient that is not finite and for an obscuration outside [0, 1).
    """

    w020: float = 0.0
    w040: float = 0.0
    w131: float = 0.0
    w222: float = 0.0
    w111: float = 0.0
    obscuration: float = 0.0
    shift_x: float = 0.0
    shift_y: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value):
                raise InputError(_SOURCE, field.name, value, "not finite", "give a number, in waves or pupil radii")
        if not 0.0 <= self.obscuration < 1.0:
            raise InputError(
                _SOURCE, "obscuration", self.obscuration, "outside [0, 1)", "give a part of the pupil's radius"
            )

    @property
    def power(self) -> float:
        """∫A² over one pupil, π(1 − obscuration²), in squared pupil radii."""
        return math.pi * (1.0 - self.obscuration**2)

    def wavefront(self, x: Array, y: Array) -> Array:
        """W of beam m in waves at points (x, y) of the common frame, which is centred on beam l."""
        x, y = np.asarray(x, float) - self.shift_x, np.asarray(y, float) - self.shift_y
        rr = x * x + y * y
        return rr * (self.w020 + self.w040 * rr + self.w131 * y) + y * (self.w222 * y + self.w111)

    def powers(self) -> Array:
        """W in waves as powers (5, 5) of (x, y) about beam m's own centre."""
        w = np.zeros((5, 5))
        w[2, 0], w[0, 2] = self.w020, self.w020 + self.w222
        w[4, 0], w[2, 2], w[0, 4] = self.w040, 2.0 * self.w040, self.w040
        w[2, 1], w[0, 3], w[0, 1] = self.w131, self.w131, self.w111
        return w

    def pupil_fields(self) -> tuple[PupilField, PupilField]:
        """Beams m and l as pupil fields over a dimensionless coordinate, for sigma = 1/m: one wave is one metre."""
        w = np.zeros((5, 5))  # Chebyshev products: t² = (1 + T2)/2, t³ = (3 T1 + T3)/4, t⁴ = (3 + 4 T2 + T4)/8
        square = np.array([0.5, 0.0, 0.5, 0.0, 0.0])
        fourth = np.array([0.375, 0.0, 0.5, 0.0, 0.125])
        one, first = np.eye(5)[0], np.eye(5)[1]
        third = np.array([0.0, 0.75, 0.0, 0.25, 0.0])
        w += self.w020 * (np.outer(square, one) + np.outer(one, square))
        w += self.w040 * (np.outer(fourth, one) + 2.0 * np.outer(square, square) + np.outer(one, fourth))
        w += self.w131 * (np.outer(square, first) + np.outer(one, third))
        w += self.w222 * np.outer(one, square) + self.w111 * np.outer(one, first)
        return self._field("m", w, (self.shift_x, self.shift_y)), self._field("l", np.zeros((5, 5)), (0.0, 0.0))

    def _field(self, label: str, waves: Array, centre: tuple[float, float]) -> PupilField:
        n = 5
        disc, hole = np.zeros((n, n)), np.zeros((n, n))
        disc[2, 0] = disc[0, 2] = -0.5  # 1 − x² − y² = −(T2(x) + T2(y))/2
        hole[0, 0], hole[2, 0], hole[0, 2] = 1.0 - self.obscuration**2, 0.5, 0.5
        clearance = np.array([disc, hole]) if self.obscuration > 0.0 else disc[None]
        # The domain lies a little outside the pupil: its edge is the clearance, not the end of the polynomials.
        reach = 1.05
        clearance = np.array([_rescale(c, reach) for c in clearance])
        one = np.zeros((1, n, n))
        one[0, 0, 0] = 1.0
        return PupilField(
            label,
            "direction",
            np.array([1.0]),
            Support(np.array(centre), np.full(2, reach), clearance, np.zeros(len(clearance))),
            _rescale(waves, reach)[None],
            one,
            np.zeros((2, n, n)),
            0.0,
            (0.0, 0.0),
            np.array([[self.power]]),
            0.0,
            0.0,
            0.0,
            4,
        )


def eq4(pair: HopkinsPair) -> float | None:
    """Eq. 4 for a pair: RMS spot sizes from the slopes of W, beam l (perfect: a point) over beam m.

    0 for any aberrated beam m, where the true overlap stays finite; None if beam m is a point along x or y as well.
    """
    t, weight = np.polynomial.legendre.leggauss(8)  # exact: W's slopes squared are of degree 6 in r
    inner = pair.obscuration**2
    r = np.sqrt(inner + (1.0 - inner) * 0.5 * (t + 1.0))
    angle = 2.0 * np.pi * np.arange(16) / 16
    x, y = np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle))
    share = np.repeat(weight[:, None] / 32.0, 16, axis=1)
    w = pair.powers()
    sizes = []
    for axis in (0, 1):
        slope = polyval2d(x, y, polyder(w, axis=axis))
        mean = (share * slope).sum()
        sizes.append(math.sqrt(max((share * (slope - mean) ** 2).sum(), 0.0)))
    scale = np.abs(w).sum()
    if min(sizes) <= 1e-12 * scale:
        return None
    return contrast_eq4(0.0, 0.0, sizes[0], sizes[1])


def contrast(pair: HopkinsPair, tol: float = 1e-8) -> Estimate:
    """γ of a pair of circular pupils by boundary integrals, with an error bound of at most ``tol`` (absolute).

    Pupils that do not meet give exactly 0. Raises InputError for a tolerance outside [1e-14, 1), MethodLimitError where
    rounding, or the number of boxes, does not let the bound come down to ``tol``.
    """
    started = time.perf_counter()
    if not 1e-14 <= tol < 1.0:
        raise InputError(_SOURCE, "tol", tol, "outside [1e-14, 1): double precision ends there", "give 1e-8, say")
    if math.hypot(pair.shift_x, pair.shift_y) >= 2.0:
        return Estimate(0j, 0.0, "no shared support", 0, time.perf_counter() - started)
    found = circular_pair(pair.powers(), (pair.shift_x, pair.shift_y), pair.obscuration, tol * pair.power)
    error = found.error / pair.power
    if error > tol:
        raise MethodLimitError(BOUNDARY_METHOD, f"error bound {error:.2g} for a tolerance of {tol:.2g}", error / tol,
                               f"ask for {error:.2g}")  # fmt: skip
    return Estimate(found.value / pair.power, error, BOUNDARY_METHOD, found.nodes, time.perf_counter() - started)


def _rescale(coef: Array, reach: float) -> Array:
    """Chebyshev products (n, n) on (x, y) as Chebyshev products on (x, y)/reach; exact."""
    n = coef.shape[0]
    nodes = np.cos(np.pi * (np.arange(n) + 0.5) / n)
    # T_i(reach·t) in T_k(t): interpolation at n nodes is exact for polynomials of degree below n
    values = np.polynomial.chebyshev.chebvander(reach * nodes, n - 1)
    to = np.linalg.solve(np.polynomial.chebyshev.chebvander(nodes, n - 1), values)
    return np.asarray(to @ coef @ to.T)
