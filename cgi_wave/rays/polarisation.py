"""What faces along a path may do to linearly polarised light, which the tracer takes as unpolarised."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import Path
from cgi_wave.rays.trace import Sequence, compile_sequence, history

Array = NDArray[np.float64]


def incidences(sequence: Sequence, p: Array, theta: Array) -> Array:
    """|cos| of the angle of incidence (K, N) on every surface of a sequence; p (N, 2), m, theta (N, 2) as in ``trace``.

    Rays that fail on the way leave values that mean nothing.
    """
    points = history(sequence, p, theta)
    axes, cosines = np.eye(3), np.empty((len(sequence.curvature), len(p)))
    origin = np.zeros(3)
    for k, (c, conic) in enumerate(zip(sequence.curvature, sequence.conic, strict=True)):
        origin = origin + axes.T @ sequence.shift[k]
        axes = sequence.rot[k] @ axes
        local = (points[k + 1] - origin) @ axes.T
        normal = np.column_stack([-c * local[:, :2], 1.0 - c * (1.0 + conic) * local[:, 2]])
        way = points[k + 1] - points[k]
        if k == 0:  # the pupil plane may lie in the first surface, and leave no way to it
            q = np.broadcast_to(theta, p.shape)
            way = np.column_stack([q, np.sqrt(1.0 - (q**2).sum(axis=1))])
        along = np.abs(((way @ axes.T) * normal).sum(axis=1))
        cosines[k] = along / np.sqrt((normal**2).sum(axis=1) * (way**2).sum(axis=1))
    return cosines


def polarised_range(
    system: OpticalSystem, path: Path, p: Array, theta: Array, sigma: float, without: str = ""
) -> tuple[Array, Array]:
    """Least and largest power (N,) of fully polarised light over that of unpolarised light as traced, along a path.

    Bare faces by Fresnel, tables that part s and p by those; each face by itself takes the worse of its two, so that
    planes of incidence need not be known. Coatings of which no s and p are known count as alike. without: a surface
    that is left out (a splitter that is looked at by itself).
    """
    sequence = compile_sequence(system, path, sigma)
    cosine = incidences(sequence, p, theta)
    index, space = system.index(sigma), system.spaces.index(system.document.entrance.space)
    low, high = np.ones(len(p)), np.ones(len(p))
    for k, (name, act) in enumerate(path.steps):
        surface = system.surfaces[system.number[name]]
        side = int(space != surface.before)
        coating, table = surface.face(side)
        other = surface.before if side else surface.after
        n1, n2 = index[space], index[other] if other >= 0 else index[space]
        inner = np.sqrt(np.maximum(1.0 - (n1 / n2) ** 2 * (1.0 - cosine[k] ** 2), 0.0))
        pair: tuple[Array, Array] | None = None
        if coating.bare and other >= 0:
            s = ((n1 * cosine[k] - n2 * inner) / (n1 * cosine[k] + n2 * inner)) ** 2
            t = ((n2 * cosine[k] - n1 * inner) / (n2 * cosine[k] + n1 * inner)) ** 2
            pair = (s, t) if act == "reflect" else (1.0 - s, 1.0 - t)
        elif table is not None and table.s is not None:
            u = 1.0 - (cosine[k] if n1 <= n2 else inner)
            which = 0 if act == "reflect" else 1
            pair = table.film(sigma, "s").at(u)[which], table.film(sigma, "p").at(u)[which]
        if pair is not None and name != without:
            mean = np.maximum(0.5 * (pair[0] + pair[1]), 1e-300)
            low, high = low * np.minimum(*pair) / mean, high * np.maximum(*pair) / mean
        space = other if act == "transmit" else space
    return low, high
