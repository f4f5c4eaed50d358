"""Point-spread function of a direction-space field: padded FFT for pictures, direct quadrature as its oracle.

h(x) = σ ∫ A(q) exp(i 2πσ (opl(q) + q·x)) d²q with x measured from the field's reference point, so that
∫|h|² d²x = ∫A² d²q, the power.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.kernels import pupil
from cgi_wave.wave.basis import Array, at_points, evaluate, expand
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.region import METHOD, SAFETY, build, find_region

FFT_CAP = 8192  # samples along one side of the transform
_FFT_METHOD = "padded FFT, gray edge"
_PLANNER = threading.Lock()  # planning is not safe in several threads, and a plan owns its array


@dataclass(frozen=True)
class Psf:
    """PSF on a detector grid centred on the reference point.

    x, y : (n,) m; irradiance : (n, n) power per m², indexed [ix, iy]; field : (n, n) complex, |field|² = irradiance
    sigma : 1/m; fft_size : samples along the transform's side (0 for quadrature)
    power_error : |power in the pupil samples / power of the field - 1|, what the sampled edge costs
    field_error : largest |error of field| / max |field|: for the FFT the difference from quadrature at nine points of
        the window (nan, and said so in the note, where quadrature would cost too much), for quadrature its own bound
    error_note : what the error is and is not
    """

    x: Array
    y: Array
    irradiance: Array
    field: NDArray[np.complex128]
    sigma: float
    method: str
    fft_size: int
    power_error: float
    field_error: float
    error_note: str


@lru_cache(maxsize=4)
def _plan(size: int) -> tuple[NDArray[np.complex128], Any]:
    """An in-place forward plan and its array; kept within the process (planning costs more than transforming)."""
    import pyfftw

    buffer = pyfftw.empty_aligned((size, size), dtype="complex128")
    return buffer, pyfftw.FFTW(buffer, buffer, axes=(0, 1), direction="FFTW_BACKWARD", flags=("FFTW_ESTIMATE",))


def _check(field: PupilField) -> None:
    if field.space != "direction":
        raise InputError(field.label, "space", field.space, "a PSF needs a direction-space field", "sample with u = q")


def _at_sigma(field: PupilField, sigma: float) -> tuple[Array, Array]:
    """Path length (m, without its mean) and amplitude coefficients (n, n) at one wavenumber."""
    weights = field.weights(np.array([sigma]))[0]
    path = np.tensordot(weights, field.opl, 1)
    return path, np.tensordot(weights, field.amplitude, 1)


def _steepest(field: PupilField, path: Array) -> float:
    """max |∂opl/∂q_x|, |∂opl/∂q_y| over the support, m: how far from the reference point its rays land."""
    s = field.support
    grid = np.linspace(-1.0, 1.0, 61)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid, indexing="ij"))
    points = np.column_stack([x, y])
    lit = (x**2 + y**2 <= 1.0) & (at_points(s.clearance, points) > 0.0).all(axis=0)
    step = 1e-4
    slopes = [
        np.abs(at_points(path, points[lit] + d) - at_points(path, points[lit] - d)).max() / (2 * step * scale)
        for d, scale in zip(step * np.eye(2), s.scale, strict=True)
    ]
    return float(max(slopes))


def _mask(field: PupilField, x: Array, y: Array, step: Array) -> Array:
    """Share of each cell inside the support: linear in the clearance across the edge (a gray edge), (X, Y)."""
    s = field.support
    share = ((x[:, None] ** 2 + y[None, :] ** 2) <= 1.0).astype(float)
    for coef in s.clearance:
        value = evaluate(coef, x, y)
        dx = 0.5 * (evaluate(coef, x + step[0], y) - evaluate(coef, x - step[0], y))
        dy = 0.5 * (evaluate(coef, x, y + step[1]) - evaluate(coef, x, y - step[1]))
        share *= np.clip(0.5 + value / np.maximum(np.abs(dx) + np.abs(dy), 1e-300), 0.0, 1.0)
    return share


def fft_size(field: PupilField, pixel_m: float, n: int, sigma: float) -> int:
    """Side of the transform that samples the field: at least two samples per cycle of the steepest phase.

    In pupil samples N this is N >= 8 W020 for pure defocus; on the detector it says that the window must hold every
    ray. Raises MethodLimitError when the pixel is too coarse for the field's cone (by what factor), or when more than
    FFT_CAP samples would be needed.
    """
    path, _ = _at_sigma(field, sigma)
    s = field.support
    cone = float(np.max(np.abs(s.centre) + s.scale)) * 2.0
    coarse = pixel_m * sigma * cone
    if coarse > 1.0:
        raise MethodLimitError(
            _FFT_METHOD,
            f"pixels of {pixel_m:.3g} m undersample a cone of {cone:.3g} in direction cosine",
            coarse,
            f"resample with pixels {coarse:.3g} times smaller and bin them",
        )
    needed = max(2.0 * n, 2.2 * _steepest(field, path) / pixel_m, 256.0 / max(coarse, 1e-9))
    if needed > FFT_CAP:
        raise MethodLimitError(
            _FFT_METHOD,
            f"the wavefront needs {needed:.0f} samples along a side (limit {FFT_CAP})",
            needed / FFT_CAP,
            f"use pixels {needed / FFT_CAP:.3g} times larger where the cone allows it, or psf_direct on a patch",
        )
    return int(2 ** math.ceil(math.log2(needed)))


def psf(field: PupilField, pixel_m: float, n: int, sigma: float | None = None, measure: bool = True) -> Psf:
    """PSF on n x n detector points pixel_m (m) apart at wavenumber sigma (1/m; the field's middle one by default).

    The point (n // 2, n // 2) is the reference point. The complex field is sampled on a q grid whose pitch is
    1/(σ·N·pixel_m), with cells at the edge weighted by their share inside. ``measure`` compares nine points with
    quadrature, which can take longer than the transform; without it ``field_error`` is NaN.

    Raises InputError for a pupil-space field, MethodLimitError when the sampling does not hold (``fft_size``).
    """
    _check(field)
    sigma = float(field.sigma[field.sigma.size // 2]) if sigma is None else sigma
    size = fft_size(field, pixel_m, n, sigma)
    path, amplitude = _at_sigma(field, sigma)
    s = field.support
    pitch = 1.0 / (sigma * size * pixel_m)
    index = np.arange(size) - size // 2
    held = [np.nonzero(np.abs(index * pitch - s.centre[a]) <= s.scale[a])[0] for a in (0, 1)]
    x, y = ((index[held[a]] * pitch - s.centre[a]) / s.scale[a] for a in (0, 1))
    share = _mask(field, x, y, pitch / s.scale)
    waves = evaluate(path, x, y) * sigma
    sampled = evaluate(amplitude, x, y) * share * np.exp(2j * np.pi * (waves - np.rint(waves)) + 1j * field.phase)
    rows, columns = (np.mod(index[h], size) for h in held)
    crop = np.mod(np.arange(n) - n // 2, size)
    with _PLANNER:
        buffer, transform = _plan(size)
        buffer[:] = 0.0
        buffer[np.ix_(rows, columns)] = sampled
        transform.execute()
        out = buffer[np.ix_(crop, crop)] * (sigma * pitch**2)
    power = float(field.power_at(np.array([sigma]))[0])
    error = abs(float(np.sum(np.abs(sampled) ** 2)) * pitch**2 / power - 1.0)
    axis = np.asarray((np.arange(n) - n // 2) * pixel_m, np.float64)
    unmeasured = (math.nan, "not measured (not asked for); sampled edge, for pictures, not for contrasts")
    measured, note = _measure(field, axis, out, sigma) if measure else unmeasured
    return Psf(axis, axis, np.abs(out) ** 2, out, sigma, _FFT_METHOD, size, error, measured, note)


def _measure(field: PupilField, axis: Array, out: NDArray[np.complex128], sigma: float) -> tuple[float, str]:
    """Error of a transformed field at nine points, relative to its peak; and a note that says what it is."""
    at = np.array([axis.size // 4, axis.size // 2, 3 * axis.size // 4])
    try:
        direct = _direct(field, axis[at], axis[at], sigma, 1)
    except MethodLimitError as limit:
        return math.nan, f"not measured ({limit}); sampled edge, for pictures, not for contrasts"
    error = float(np.abs(out[np.ix_(at, at)] - direct).max() / np.abs(out).max())
    return (
        error,
        f"field wrong by {error:.1e} of its peak at nine points (sampled edge); for pictures, not for contrasts",
    )


def psf_direct(field: PupilField, x: Array, y: Array, sigma: float | None = None, level: int = 2) -> Psf:
    """PSF at the points of a small grid x (X,), y (Y,) in m, by boundary-fitted quadrature at a refinement level.

    Slow (nodes times X + Y exponentials and a product), made for oracles and small patches. ``field_error``
    is twice the largest change from the level below. Raises MethodLimitError beyond the node cap.
    """
    _check(field)
    sigma = float(field.sigma[field.sigma.size // 2]) if sigma is None else sigma
    coarse, fine = (_direct(field, x, y, sigma, k) for k in (level - 1, level))
    error = SAFETY * float(np.abs(fine - coarse).max() / np.abs(fine).max())
    note = "quadrature; the misfit of the pupil field comes on top"
    return Psf(x, y, np.abs(fine) ** 2, fine, sigma, METHOD, 0, 0.0, error, note)


def _direct(field: PupilField, x: Array, y: Array, sigma: float, level: int) -> NDArray[np.complex128]:
    s = field.support
    region = find_region([s])
    assert region is not None  # a field with power has a region
    n = region.clearance.shape[-1]
    path, amplitude = _at_sigma(field, sigma)
    phase = expand(path, s.centre, s.scale, region.pivot, region.frame, n) * sigma
    reach = max(float(np.abs(x).max()), float(np.abs(y).max()))
    tilt = sigma * reach * float(region.frame.max()) * math.sqrt(2.0)
    q = build(region, phase[None], tilt, level)
    nodes = pupil.list_nodes(q.rays, q.panels, phase[None], tilt)
    u = region.pivot + region.frame * nodes[:, :2]
    scaled = (u - s.centre) / s.scale
    waves = at_points(path, scaled) * sigma
    weight = nodes[:, 2] * float(np.prod(region.frame)) * at_points(amplitude, scaled)
    source = weight * np.exp(2j * np.pi * (waves - np.rint(waves)) + 1j * field.phase)
    out = np.zeros((x.size, y.size), np.complex128)
    for start in range(0, len(u), 20_000):
        part = slice(start, start + 20_000)
        left = np.exp(2j * np.pi * sigma * np.outer(x, u[part, 0])) * source[part]
        out += left @ np.exp(2j * np.pi * sigma * np.outer(u[part, 1], y))
    return out * sigma
