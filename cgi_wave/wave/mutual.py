"""What a detector makes of PSFs: the mutual PSF of two beams, encircled energy, and pixels that average fringes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods.grid import half_plane
from cgi_wave.wave.methods.shape import check_pair
from cgi_wave.wave.overlap import Overlap
from cgi_wave.wave.psf import Psf, psf


@dataclass(frozen=True)
class MutualPsf:
    """h_m h_l* on detector points about the reference point that both beams share: the light of their fringes.

    x, y : (n,) m; value : (n, n) complex, √(power_m power_l) per m², indexed [ix, iy], path difference and constant
    phases included; its integral over the plane is γ √(P_m P_l).
    power : of m and of l in the field; held : power of each on the patch, as sums over its points
    error : largest absolute error of ``value``, from those of the two PSFs
    """

    x: Array
    y: Array
    value: NDArray[np.complex128]
    sigma: float
    power: tuple[float, float]
    held: tuple[float, float]
    error: float

    @property
    def pixel(self) -> float:
        """Distance of the points, m."""
        return float(self.x[1] - self.x[0])

    @property
    def contrast(self) -> complex:
        """Sum over the patch / √(P_m P_l): γ but for what lies outside."""
        return complex(self.value.sum()) * self.pixel**2 / float(np.sqrt(self.power[0] * self.power[1]))

    @property
    def outside(self) -> float:
        """Bound of what the patch leaves out of the contrast: √(E_m E_l), with E the missing shares of power."""
        missing = [max(1.0 - h / p, 0.0) for h, p in zip(self.held, self.power, strict=True)]
        return float(np.sqrt(missing[0] * missing[1]))

    def binned(self, factor: int) -> MutualPsf:
        """Means over factor × factor points: what square pixels of that size measure, with the fringes in it.

        Raises InputError if the points cannot be divided so.
        """
        n = self.x.size
        if factor < 1 or n % factor:
            raise InputError("mutual PSF", "factor", factor, f"does not divide {n} points", "give a divisor")
        k = n // factor
        value = self.value.reshape(k, factor, k, factor).mean(axis=(1, 3))
        x, y = (a.reshape(k, factor).mean(axis=1) for a in (self.x, self.y))
        return replace(self, x=x, y=y, value=value)


def mutual_psf(
    m: PupilField,
    l: PupilField,  # noqa: E741
    pixel_m: float,
    n: int,
    sigma: float | None = None,
) -> MutualPsf:
    """h_m h_l* on n × n points pixel_m (m) apart; the point (n // 2, n // 2) is the reference point.

    Raises InputError for fields of different spaces or reference points and for pupil-space fields, MethodLimitError
    where the sampling does not hold (see ``psf``).
    """
    check_pair(m, l)
    made = [psf(field, pixel_m, n, sigma, measure=False) for field in (m, l)]
    peak = [float(np.abs(p.field).max()) for p in made]
    wrong = [p.field_error * top for p, top in zip(made, peak, strict=True)]
    at = np.array([made[0].sigma])
    power = tuple(float(field.power_at(at)[0]) for field in (m, l))
    held = tuple(float(p.irradiance.sum()) * pixel_m**2 for p in made)
    # The constant part of a path length, metres of it, is in the fields themselves.
    return MutualPsf(
        made[0].x,
        made[0].y,
        made[0].field * made[1].field.conj(),
        made[0].sigma,
        (power[0], power[1]),
        (held[0], held[1]),
        wrong[0] * peak[1] + wrong[1] * peak[0] + wrong[0] * wrong[1],
    )


@dataclass(frozen=True)
class EncircledEnergy:
    """Share of the power of a field within circles.

    radius : (R,) m; value : (R,) share; error : (R,) change from every second point of the PSF, an estimate
    centre : (2,) m, from the reference point
    """

    radius: Array
    value: Array
    error: Array
    centre: tuple[float, float]


def encircled_energy(
    made: Psf, power: float, radius: Array, centre: tuple[float, float] | None = None
) -> EncircledEnergy:
    """Encircled energy of a PSF whose field has ``power``, about ``centre`` (m; the centroid on the patch if None).

    Points stand for square cells, those on a circle by their share inside. Raises InputError for circles that leave
    the patch or that are smaller than a point's cell.
    """
    radius = np.atleast_1d(np.asarray(radius, float))
    if centre is None:
        total = made.irradiance.sum()
        centre = (
            float((made.irradiance.sum(axis=1) * made.x).sum() / total),
            float((made.irradiance.sum(axis=0) * made.y).sum() / total),
        )
    pixel = float(made.x[1] - made.x[0])
    room = min(made.x[-1] - centre[0], centre[0] - made.x[0], made.y[-1] - centre[1], centre[1] - made.y[0])
    if np.any(radius < pixel) or np.any(radius > room):
        raise InputError(
            "encircled energy", "radius", radius.tolist(), "smaller than a point's cell or beyond the patch",
            f"give {pixel:.3g} to {room:.3g} m",
        )  # fmt: skip
    fine = _within(made.x, made.y, made.irradiance, radius, centre) / power
    coarse = _within(made.x[::2], made.y[::2], made.irradiance[::2, ::2], radius, centre) / power
    return EncircledEnergy(radius, fine, np.abs(fine - coarse), centre)


def _within(x: Array, y: Array, irradiance: Array, radius: Array, centre: tuple[float, float]) -> Array:
    pixel = float(x[1] - x[0])
    dx, dy = x[:, None] - centre[0], y[None, :] - centre[1]
    distance = np.hypot(dx, dy)
    a, b = (d * pixel / np.maximum(distance, 1e-30) for d in (dx, dy))
    return np.array([float((half_plane(r - distance, a, b) * irradiance).sum()) * pixel**2 for r in radius])


def pixel_mtf(frequency: Array | float, pixel_m: float, fill: float = 1.0) -> Array:
    """Contrast that a square pixel leaves fringes of ``frequency`` (..., 2) or across its side (...), 1/m.

    sin(πfp)/(πfp) along each axis; ``fill`` is the share of the side that is sensitive. Raises InputError for a pixel
    that is not positive or a fill outside (0, 1].
    """
    if not (pixel_m > 0.0 and 0.0 < fill <= 1.0):
        raise InputError("pixel", "pixel_m, fill", (pixel_m, fill), "not a side and its share", "give m and 0 to 1")
    f = np.asarray(frequency, float)
    sides = np.sinc(f * pixel_m * fill)
    return np.asarray(sides.prod(axis=-1) if f.ndim and f.shape[-1] == 2 else sides)


def fringe_frequency(pair: Overlap, sigma: float) -> float:
    """Fringes per metre along y of a pair of beams: σ times the slope of its path difference (pupil space)."""
    return sigma * pair.slope


def pixel_contrast(
    pair: Overlap, sigma: Array, pixel_m: float, fill: float = 1.0
) -> tuple[NDArray[np.complex128], Array]:
    """(T,) contrast of a pair as square pixels see it, and its error bound: both times the pixel's MTF.

    The frequency is the pair's own, σ·slope along y; along x the exact slope is not kept and is taken as 0, which
    makes the result an upper bound where fringes are tilted.
    """
    mtf = pixel_mtf(np.asarray(sigma, float) * pair.slope, pixel_m, fill)
    return (pair.value * mtf).astype(np.complex128), np.asarray(pair.error_bound * np.abs(mtf))
