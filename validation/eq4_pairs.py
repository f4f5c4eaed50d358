"""Two circular pupils, both aberrated: |γ| with a bound, Eq. 4, and what the estimate needs. Part of ``eq4``.

Lengths on the detector are in units of λ/NA: a wavefront of W waves over a pupil of unit radius moves its rays by
∂W/∂x of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval2d
from numpy.typing import NDArray

from cgi_wave.wave.eq4 import contrast_eq4
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.stokes import circular_pair

Array = NDArray[np.float64]
TOLERANCE = 1e-9  # of γ


@dataclass(frozen=True)
class Aberrated:
    """Beam m of ``ghost`` (displaced, with its coefficients) against a centred beam l with those of ``nominal``.

    Both have the obscuration of the ghost's pair; shift and obscuration of ``nominal`` are not used.
    """

    ghost: HopkinsPair
    nominal: HopkinsPair

    @property
    def shift(self) -> tuple[float, float]:
        """Displacement of beam m, pupil radii."""
        return self.ghost.shift_x, self.ghost.shift_y

    def waves(self) -> Array:
        """W_m − W_l in waves as powers (5, 5) about beam m's centre."""
        return self.ghost.powers() - displaced(self.nominal.powers(), *self.shift)

    def contrast(self, tol: float = TOLERANCE) -> tuple[complex, float]:
        """γ and its error bound; exactly 0 for pupils that do not meet."""
        if math.hypot(*self.shift) >= 2.0:
            return 0j, 0.0
        found = circular_pair(self.waves(), self.shift, self.ghost.obscuration, tol * self.ghost.power)
        return complex(found.value / self.ghost.power), float(found.error / self.ghost.power)

    def sizes(self) -> tuple[Array, Array]:
        """RMS (2,) along x and y of the nominal spot and of the ghost's, λ/NA."""
        x, y = annulus(self.ghost.obscuration)
        return rms(self.nominal.powers(), x, y), rms(self.ghost.powers(), x, y)

    def eq4(self) -> float | None:
        """Eq. 4; None for a ghost that is a point along x or y."""
        nominal, ghost = self.sizes()
        if min(ghost) <= 1e-9:
            return None
        return contrast_eq4(nominal[0], nominal[1], ghost[0], ghost[1])

    def common(self) -> tuple[Array, Array]:
        """Even points of the shared pupil, about beam m's centre."""
        x, y = annulus(self.ghost.obscuration)
        r = np.hypot(x + self.ghost.shift_x, y + self.ghost.shift_y)
        lit = (r <= 1.0) & (r >= self.ghost.obscuration)
        return x[lit], y[lit]

    def share(self) -> float:
        """Shared area over that of one pupil."""
        return len(self.common()[0]) / len(annulus(self.ghost.obscuration)[0])


@lru_cache
def annulus(obscuration: float, rings: int = 24, spokes: int = 64) -> tuple[Array, Array]:
    """Points of equal weight over an annulus of outer radius 1."""
    r = np.sqrt(obscuration**2 + (1.0 - obscuration**2) * (np.arange(rings) + 0.5) / rings)
    angle = 2.0 * np.pi * (np.arange(spokes)[None, :] + 0.5 * (np.arange(rings)[:, None] % 2)) / spokes
    return (r[:, None] * np.cos(angle)).ravel(), (r[:, None] * np.sin(angle)).ravel()


def slopes(w: Array, x: Array, y: Array) -> Array:
    """(2, N) ∂W/∂x, ∂W/∂y of powers (n, n) at points."""
    return np.array([polyval2d(x, y, polyder(w, axis=a)) for a in (0, 1)])


def folds(w: Array, x: Array, y: Array) -> bool:
    """Whether the determinant of W's Hessian changes its sign over the points: a caustic crosses the pupil."""
    xx, yy, xy = (polyval2d(x, y, polyder(polyder(w, i, axis=0), j, axis=1)) for i, j in ((2, 0), (0, 2), (1, 1)))
    determinant = xx * yy - xy**2
    return bool(determinant.min() < 0.0 < determinant.max())


def rms(w: Array, x: Array, y: Array) -> Array:
    """(2,) RMS of the slopes about their mean over points of equal weight."""
    return np.asarray(slopes(w, x, y).std(axis=1))


def displaced(w: Array, sx: float, sy: float) -> Array:
    """Powers (n, n) of W(x + sx, y + sy); exact."""
    n = w.shape[0]

    def shifted(s: float) -> Array:
        return np.array([[math.comb(i, k) * s ** (i - k) if i >= k else 0.0 for k in range(n)] for i in range(n)])

    return np.asarray(shifted(sx).T @ w @ shifted(sy))
