"""Synthetic beams: PupilSamples of analytic fields, on a jittered polar cloud that reaches beyond the aperture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cgi_wave.wave.samples import PupilSamples, Space

Array = NDArray[np.float64]
Function = Callable[[Array, Array], Array]
SIGMA = 1.0e6  # 1/m: a path of 1 um is one wave


def cloud(reach: float, count: int, centre: tuple[float, float] = (0.0, 0.0)) -> Array:
    """(N, 2) sunflower points over a disc: even, and without symmetry."""
    k = np.arange(count) + 0.5
    radius, angle = reach * np.sqrt(k / count), k * np.pi * (3.0 - np.sqrt(5.0))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]) + np.array(centre)


def beam(
    waves: Function | float = 0.0,
    clearances: list[Function] | None = None,
    amplitude: Function | float = 1.0,
    *,
    centre: tuple[float, float] = (0.0, 0.0),
    reach: float = 1.25,
    count: int = 700,
    sigma: Array | None = None,
    path: Callable[[Array, Array, float], Array] | None = None,
    direction: Function | None = None,
    phase: float = 0.0,
    space: Space = "direction",
) -> PupilSamples:
    """A beam with W (waves at SIGMA) or path(x, y, sigma) in m; unit circular pupil about ``centre`` by default."""
    sigma = np.array([SIGMA]) if sigma is None else sigma
    u = cloud(reach, count, centre)
    x, y = u.T
    if clearances is None:
        clearances = [lambda x, y: 1.0 - (x - centre[0]) ** 2 - (y - centre[1]) ** 2]

    def values(f: Function | float) -> Array:
        return np.asarray(f(x, y) if callable(f) else np.full(count, f), float)

    s = sigma.size
    opl = np.array([path(x, y, v) if path else values(waves) / SIGMA for v in sigma])
    edges = np.array([np.tile(values(c), (s, 1)) for c in clearances])
    ways = u if direction is None else np.column_stack([np.zeros(count), direction(x, y)])
    return PupilSamples(
        label="synthetic",
        space=space,
        u=np.tile(u, (s, 1, 1)),
        sigma=sigma,
        opl=opl,
        amplitude=np.tile(values(amplitude), (s, 1)),
        clearance=edges,
        direction=np.tile(ways, (s, 1, 1)),
        phase=phase,
        reference_point=(0.0, 0.0),
    )


def disc(radius: float = 1.0, x0: float = 0.0, y0: float = 0.0) -> Function:
    """Clearance of a disc, positive inside."""
    return lambda x, y: radius**2 - (x - x0) ** 2 - (y - y0) ** 2


def hole(radius: float, x0: float = 0.0, y0: float = 0.0) -> Function:
    """Clearance of a central obscuration, positive outside it."""
    return lambda x, y: (x - x0) ** 2 + (y - y0) ** 2 - radius**2
