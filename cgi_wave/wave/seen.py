"""What one detector point sees: amplitudes over source directions, and their products gathered into pixels.

The light of source direction θ on a fixed detector point has the amplitude

    H(θ) = σ ∫ A(p) exp(i 2πσ (Λ(p; x) + p·θ)) d²p

over the entrance pupil, with the pupil field whose overlap is the mutual intensity J: ∫ H_m H_l* d²θ = ∫ A_m A_l* d²p
(Parseval). So |H|² says how much each ground point gives to a detector point, and H_m H_l* where the light of a pair's
fringes comes from. Directions stand for places by the nominal image.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.wave.basis import Array, at_points
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods.shape import beam_at
from cgi_wave.wave.psf import Psf, psf

#: Points per shortest period of |H|². At 1 a sum over points is the integral; the sum over every second one, which
#: ``cell_kernel`` takes too, is it nearly at 1.5.
OVERSAMPLING = 1.5


def about_direction(field: PupilField, theta: Array) -> PupilField:
    """A pupil-space field with the plane wave of source direction theta (2,) taken out, as one whose PSF is H.

    The points x of that PSF are source directions (cosines) less theta. Raises InputError for a field of directions.
    """
    if field.space != "pupil":
        raise InputError(field.label, "space", field.space, "a point sees through the pupil", "sample with u = p")
    opl, support = field.opl.copy(), field.support
    opl[:, 0, 0] += float(support.centre @ theta)
    opl[:, 1, 0] += support.scale[0] * theta[0]
    opl[:, 0, 1] += support.scale[1] * theta[1]
    return replace(field, space="direction", opl=opl)


def source_pitch(field: PupilField, oversampling: float = OVERSAMPLING) -> float:
    """Step of source directions (cosine) at which |H|² is sampled, for the field's largest wavenumber."""
    widest = float(np.max(np.abs(field.support.centre) + field.support.scale))
    return 1.0 / (4.0 * oversampling * float(field.sigma.max()) * widest)


def source_amplitude(field: PupilField, theta: Array, reach: float, pitch: float, sigma: float) -> Psf:
    """H on a square of source directions within ±reach (cosine) of theta (2,), ``pitch`` apart, of a pupil-space field.

    x, y : directions less theta; irradiance : |H|², power per solid angle. Raises InputError, MethodLimitError
    (``wave.psf.psf``).
    """
    return psf(about_direction(field, theta), pitch, 2 * math.ceil(reach / pitch), sigma, measure=False)


def gathered(values: NDArray[np.inexact], at: Array, half: int) -> NDArray[np.inexact]:
    """(2·half + 1,)² shares [Y, X] of point values (N,) at places ``at`` (N, 2), in pixels from the middle.

    Ground cells and pixels are both one pixel wide: light at a distance u counts with the triangle max(0, 1 − |d − u|)
    to offset d along each axis, which is the cell's and the pixel's box together. What lies outside is left out.
    """
    size = 2 * half + 1
    out = np.zeros(size * size, values.dtype)
    low = np.floor(at).astype(np.int64)
    part = at - low
    for dx in (0, 1):
        for dy in (0, 1):
            i, j = low[:, 0] + dx + half, low[:, 1] + dy + half
            inside = (i >= 0) & (i < size) & (j >= 0) & (j < size)
            share = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1]) * values
            place = (j * size + i)[inside]
            if np.iscomplexobj(values):
                out += np.bincount(place, share[inside].real, size * size)
                out += 1j * np.bincount(place, share[inside].imag, size * size)
            else:
                out += np.bincount(place, share[inside], size * size)
    return out.reshape(size, size)


def cell_kernel(product: NDArray[np.inexact], x: Array, y: Array, to_pixels: Array, half: int) -> NDArray[np.inexact]:
    """(2·half + 1,)² ∫ H_m H_l* over ground cells and pixels [Y, X], from the product on points x (X,) by y (Y,).

    product (X, Y) : H_m H_l*, or |H|² for one beam; x, y : as of ``source_amplitude``; to_pixels (2, 2) : pixels of
    place per unit of direction. The sum over an endless window is ∫ A_m A_l* d²p, in the unit of the power.

    The triangle has kinks, where a sum over points errs by the square of their distance: that is taken out by means of
    every second point (Richardson).
    """
    sums = []
    for step in (1, 2):
        first = [len(axis) // 2 % step for axis in (x, y)]  # the middle one is in both
        at = [axis[start::step] for axis, start in zip((x, y), first, strict=True)]
        where = np.stack(np.meshgrid(*at, indexing="ij"), axis=-1).reshape(-1, 2) @ to_pixels.T
        cell = float(at[0][1] - at[0][0]) * float(at[1][1] - at[1][0])
        sums.append(gathered(product[first[0] :: step, first[1] :: step].ravel() * cell, where, half))
    return (4.0 * sums[0] - sums[1]) / 3.0


def rays_of_pair(
    m: PupilField, l: PupilField, sigma: float, points: Array,  # noqa: E741
) -> tuple[NDArray[np.complex128], Array, Array, Array]:  # fmt: skip
    """What two beams are by geometrical optics at pupil points (N, 2, in units of the disc): where both are lit.

    product (P,) : A_m A_l* with its phase; power (P, 2) : A² of m and of l; direction (P, 2) : the mean of both beams'
    source directions; group (P,) : difference of group path lengths, m. A pair's light comes from where its rays do as
    long as neither beam is sharper than a pixel. points : covering the unit disc, which becomes the first beam's domain
    """
    u = m.support.centre + m.support.scale * points
    beams = [beam_at(field, sigma) for field in (m, l)]
    lit = np.ones(len(u), bool)
    for beam in beams:
        at = beam.scaled(u)
        lit &= ((at**2).sum(axis=1) <= 1.0) & (at_points(beam.support.clearance, at) > 0.0).all(axis=0)
    u = u[lit]
    waves = [beam.values(u) * beam.constant for beam in beams]
    direction = -0.5 * (beams[0].slope_at(u) + beams[1].slope_at(u))
    group = np.zeros(len(u))
    for sign, field in ((1.0, m), (-1.0, l)):
        if len(field.sigma) > 1:
            opl = (field.sigma[-1] * field.opl[-1] - field.sigma[0] * field.opl[0]) / np.ptp(field.sigma)
        else:
            opl = field.opl[0]
        group += sign * at_points(opl, (u - field.support.centre) / field.support.scale)
    power = np.stack([np.abs(wave) ** 2 for wave in waves], axis=1)
    return waves[0] * waves[1].conj(), power, direction, group
