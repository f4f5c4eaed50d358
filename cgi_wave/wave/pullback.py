"""A pair of beams over the entrance pupil of one of them: the other is looked up where its rays go; no map is inverted.

With u the coordinate of a chart (direction cosines, or directions behind a lens: ``rays.charts``), the rays of beam m
give u_m(p), and

    ∫ Â_m Â_l* d²u = ∫ a_m(p) |∂u_m/∂p|^½ Â_l(u_m(p))* exp(i 2πσ·opl_m(p)) d²p,

a_m being the amplitude in the pupil. The edge of m is a vignetted aperture here, however unevenly its directions crowd,
and l, a nominal beam, has polynomials in u that are easily had. The product is fitted as one field over p; where no
polynomial follows it, over parts of the pupil.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.wave.basis import Array, at_points
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.samples import PupilSamples


@dataclass(frozen=True)
class Lookup:
    """A field at given points: whether they lie in its domain (N,), and there path (M,) m, amplitude (M,), clearances
    (K, M)."""

    within: NDArray[np.bool_]
    opl: Array
    amplitude: Array
    clearance: Array


def look_up(field: PupilField, u: Array) -> Lookup:
    """Values of ``field`` at its middle σ at points u (N, 2)."""
    middle = field.sigma.size // 2
    x = (u - field.support.centre) / field.support.scale
    within = (x**2).sum(axis=1) <= 1.0
    stack = np.concatenate([field.opl[[middle]], field.amplitude[[middle]], field.support.clearance])
    values = at_points(stack, x[within])
    return Lookup(within, values[0], values[1], values[2:])


@dataclass(frozen=True)
class Meeting:
    """Rays of a beam in the chart of another beam's field, and that field where they go.

    u (N, 2), opl (N,) m, det (N,): as ``rays.charts.PupilRays.chart`` has them; found: the other field at u; lit (N,):
    rays that pass, where the other field is lit too.
    """

    u: Array
    opl: Array
    det: Array
    found: Lookup
    lit: NDArray[np.bool_]


def meeting(chart: tuple[Array, Array, Array], passes: NDArray[np.bool_], field: PupilField) -> Meeting:
    """Rays of a beam, u, path and determinant in a chart, of which some pass (N,), with a ``field`` in that chart."""
    found = look_up(field, chart[0])
    lit = found.within & passes
    lit[found.within] &= (found.clearance > 0.0).all(axis=0)
    return Meeting(*chart, found, lit)


def product_samples(
    label: str,
    p: Array,
    met: Meeting,
    same: NDArray[np.bool_],
    power: Array,
    direction: Array,
    clearance: Array,
    phase: float,
    field: PupilField,
) -> PupilSamples:
    """The product Â_m Â_l* |∂u/∂p| over the pupil of m, as one field: p (N, 2) m, clearance (K, N) of m.

    Of the rays ``same`` (N,) says which are on one sheet; those outside the domain of ``field``, which is dark there,
    are left out.
    """
    found = met.found
    keep, among = found.within & same, same[found.within]
    amplitude = np.sqrt(power[keep] * np.abs(met.det[keep])) * found.amplitude[among]
    edges = np.concatenate([clearance[:, keep], found.clearance[:, among]])
    sigma = field.sigma[[field.sigma.size // 2]]
    return PupilSamples(label, "pupil", p[keep][None], sigma, (met.opl[keep] - found.opl[among])[None], amplitude[None],
                        edges[:, None], direction[keep][None], phase - field.phase,
                        field.reference_point)  # fmt: skip
