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


def shared(field: PupilField, u: Array, clearance: Array) -> NDArray[np.bool_]:
    """(N,) which rays at u (N, 2), with clearances (K, N) of their own, are lit together with ``field``."""
    found = look_up(field, u)
    lit = found.within & (clearance > 0.0).all(axis=0)
    lit[found.within] &= (found.clearance > 0.0).all(axis=0)
    return lit


def product_samples(
    label: str,
    p: Array,
    u: Array,
    opl: Array,
    power: Array,
    det: Array,
    direction: Array,
    clearance: Array,
    phase: float,
    field: PupilField,
) -> PupilSamples:
    """The product Â_m Â_l* |∂u/∂p| over the pupil of m, as one field: p (N, 2) m, clearance (K, N) of m.

    Rays outside the domain of ``field``, which is dark there, are left out.
    """
    found = look_up(field, u)
    keep = found.within
    amplitude = np.sqrt(power[keep] * np.abs(det[keep])) * found.amplitude
    edges = np.concatenate([clearance[:, keep], found.clearance])
    sigma = field.sigma[[field.sigma.size // 2]]
    return PupilSamples(label, "pupil", p[keep][None], sigma, (opl[keep] - found.opl)[None], amplitude[None],
                        edges[:, None], direction[keep][None], phase - field.phase,
                        field.reference_point)  # fmt: skip
