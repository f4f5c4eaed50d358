"""The nominal point-spread function over a band's zone, as weights of ground cells for a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.fieldpoint import FIT_TARGET, TRACED_WAVENUMBERS, pupil_samples
from cgi_wave.budget.setting import Setting
from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.field import NominalPsf
from cgi_wave.fringes.spectral import trapezoid
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.beams import nominal_direction, rays_to_point
from cgi_wave.rays.paths import Path
from cgi_wave.wave.basis import chebyshev_wavenumbers, lagrange
from cgi_wave.wave.field import fit_field
from cgi_wave.wave.psf import Psf
from cgi_wave.wave.seen import cell_kernel, source_amplitude, source_pitch

Array = NDArray[np.float64]
#: Nodes along and across track. Aberrations change faster over a zone than contrasts and path differences do.
PSF_NODES = (5, 5)
#: Pixels on each side of the middle: what edges of the pupil scatter beyond is given as a number.
HALF = 24
#: Half of the step, m on the detector, over which source directions are taken to be linear in place.
STEP = 1e-4


@dataclass(frozen=True)
class PointPsf:
    """At one detector point: kernel (h, w) of sum 1; outside, arms: see ``NominalPsf``."""

    kernel: Array
    outside: float
    arms: float


def psf_points(
    zone: tuple[float, float, float, float], checks: Sequence[tuple[float, float]], nodes: tuple[int, int] = PSF_NODES
) -> tuple[Array, Array, Array]:
    """x (X,), y (Y,) of the nodes over a zone, m, and all points (Y·X + checks, 2); checks: (y, x) in half zones."""
    x, y = chebyshev.nodes(nodes[1], *zone[:2]), chebyshev.nodes(nodes[0], *zone[2:])
    middle = np.array([zone[0] + zone[1], zone[2] + zone[3]]) / 2
    half = np.array([zone[1] - zone[0], zone[3] - zone[2]]) / 2
    grid = np.array([(a, b) for b in y for a in x])
    return x, y, np.concatenate([grid, middle + half * np.array(checks)[:, ::-1]])


def directions_to_pixels(system: OpticalSystem, nominal: Path, x0: Array) -> tuple[Array, Array]:
    """Source direction (2,) of a detector point, and pixels of place per unit of direction (2, 2) about it."""
    around = [
        (nominal_direction(system, nominal, x0 + STEP * unit) - nominal_direction(system, nominal, x0 - STEP * unit))
        for unit in np.eye(2)
    ]
    to_direction = np.array(around).T / (2.0 * STEP)
    to_pixels = np.asarray(np.linalg.inv(to_direction) / system.pixel, np.float64)
    return nominal_direction(system, nominal, x0), to_pixels


def point_psf(setting: Setting, nominal: Sequence[Path], x0: Array) -> PointPsf:
    """The band's PSF of both nominal beams together, as the detector point x0 (m) sees the ground.

    Polychromatic: from the wavenumbers at which beams are traced, a parabola between them, weighed with radiance and
    filter. Diffraction, aberrations, vignetting and the splitter's shares are those of the traced rays.
    Raises EmptyBeamError, MethodLimitError.
    """
    system = setting.system
    sigma = chebyshev_wavenumbers(*setting.support, TRACED_WAVENUMBERS)
    theta, to_pixels = directions_to_pixels(system, nominal[0], x0)
    reach = (HALF + 1.0) * float(np.abs(np.linalg.inv(to_pixels)).sum(axis=1).max())
    fields = []
    for path in nominal:
        rays = rays_to_point(system, path, x0, sigma, theta)
        fields.append(fit_field(pupil_samples(rays, path, "pupil", sigma, x0), target=FIT_TARGET))
    measure = setting.weight * trapezoid(setting.spectrum.sigma)
    weights = (measure @ lagrange(sigma, setting.spectrum.sigma)) / measure.sum()
    power = sum(weights @ field.power_at(sigma) for field in fields)
    pitch = max(source_pitch(field) for field in fields)
    mixed: Array | float = 0.0
    for k, (s, weight) in enumerate(zip(sigma, weights, strict=True)):
        one, two = (source_amplitude(field, theta, reach, pitch, float(s)) for field in fields)
        mixed = mixed + weight * (one.irradiance + two.irradiance)
        if k == len(sigma) // 2:
            apart = _apart(one, two, setting.nma, to_pixels)
    total = cell_kernel(np.asarray(mixed), one.x, one.y, to_pixels, HALF)
    return PointPsf(np.asarray(total / total.sum(), np.float64), 1.0 - float(total.sum() / power), apart)


def _apart(one: Psf, two: Psf, nma: float, to_pixels: Array) -> float:
    """Σ|difference| of what two interfering beams see from their kernels' mean, relative to the sum of their light.

    nma : of the light where fringes are strongest
    """
    own = [cell_kernel(h.irradiance, h.x, h.y, to_pixels, HALF) for h in (one, two)]
    both = cell_kernel(one.field * two.field.conj(), one.x, one.y, to_pixels, HALF)
    mean = (own[0] + own[1]) / (own[0] + own[1]).sum()
    alone = sum(float(np.abs(part - part.sum() * mean).sum()) for part in own)
    fringes = float(np.abs(both - both.sum() * mean).sum())
    return (alone + 2.0 * nma * fringes) / float((own[0] + own[1]).sum())


def assembled(points: Sequence[PointPsf], x: Array, y: Array, places: Array) -> NominalPsf:
    """All points of ``psf_points``, nodes first."""
    kernels = np.array([point.kernel for point in points])
    count = len(x) * len(y)
    return NominalPsf(
        x, y, kernels[:count].reshape(len(y), len(x), *kernels.shape[1:]), places[count:], kernels[count:],
        max(point.outside for point in points), max(point.arms for point in points),
    )  # fmt: skip
