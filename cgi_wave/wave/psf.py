"""Point-spread function of a direction-space field: pruned FFT for pictures, direct summation as its oracle.

h(x) = σ ∫ A(q) exp(i 2πσ (opl(q) + q·x)) d²q with x measured from the field's reference point, so that
∫|h|² d²x = ∫A² d²q, the power. The transforms are those of ``cgi_wave.wave.methods``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods import fft, huygens
from cgi_wave.wave.methods import nodes as rules
from cgi_wave.wave.methods.grid import covering, sampled, shares
from cgi_wave.wave.methods.patch import Patch
from cgi_wave.wave.methods.plans import fast_length
from cgi_wave.wave.methods.shape import Beam, Edge, beam_at, edge_of
from cgi_wave.wave.region import METHOD

FFT_CAP = 8192  # samples along one side of the transform
_FFT_METHOD = "padded FFT, gray edge"
_PARTS = 2  # an edge cell's share by four straight cuts is good to some 1e-3 of a cell: enough for a picture


@dataclass(frozen=True)
class Psf:
    """PSF on a detector grid centred on the reference point.

    x, y : (n,) m; irradiance : (n, n) power per m², indexed [ix, iy]; field : (n, n) complex, |field|² = irradiance
    sigma : 1/m; fft_size : samples along the transform's side (0 for quadrature)
    power_error : |power in the pupil samples / power of the field - 1|, what the sampled edge costs
    field_error : largest |error of field| / max |field|: for the FFT the difference from quadrature at nine points of
        the window (nan, and said so in the note, where quadrature would cost too much) or the edge law's bound, for
        quadrature its own bound
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


def _check(field: PupilField) -> None:
    if field.space != "direction":
        raise InputError(field.label, "space", field.space, "a PSF needs a direction-space field", "sample with u = q")


def _middle(field: PupilField, sigma: float | None) -> float:
    return float(field.sigma[field.sigma.size // 2]) if sigma is None else sigma


def fft_size(field: PupilField, pixel_m: float, n: int, sigma: float) -> int:
    """Side of the transform that samples the field: at least two samples per cycle of the steepest phase.

    In pupil samples N this is N >= 8 W020 for pure defocus; on the detector it says that the window must hold every
    ray. Raises MethodLimitError when the pixel is too coarse for the field's cone (by what factor), or when more than
    FFT_CAP samples would be needed.
    """
    return _size(beam_at(field, sigma), edge_of(field), pixel_m, n)


def _size(beam: Beam, edge: Edge, pixel_m: float, n: int) -> int:
    s = beam.support
    cone = float(np.max(np.abs(s.centre) + s.scale)) * 2.0
    coarse = pixel_m * beam.sigma * cone
    if coarse > 1.0:
        raise MethodLimitError(
            _FFT_METHOD,
            f"pixels of {pixel_m:.3g} m undersample a cone of {cone:.3g} in direction cosine",
            coarse,
            f"resample with pixels {coarse:.3g} times smaller and bin them",
        )
    steepest = float(np.abs(beam.slope_at(np.concatenate([edge.u, edge.inside]))).max())
    needed = max(2.0 * n, 2.2 * steepest / pixel_m, 256.0 / max(coarse, 1e-9))
    if needed > FFT_CAP:
        raise MethodLimitError(
            _FFT_METHOD,
            f"the wavefront needs {needed:.0f} samples along a side (limit {FFT_CAP})",
            needed / FFT_CAP,
            f"use pixels {needed / FFT_CAP:.3g} times larger where the cone allows it, or psf_direct on a patch",
        )
    return min(fast_length(math.ceil(needed)), FFT_CAP)


def psf(field: PupilField, pixel_m: float, n: int, sigma: float | None = None, measure: bool = True) -> Psf:
    """PSF on n x n detector points pixel_m (m) apart at wavenumber sigma (1/m; the field's middle one by default).

    The point (n // 2, n // 2) is the reference point. The complex field is sampled on a q grid whose pitch is
    1/(σ·N·pixel_m), with cells at the edge weighted by their share inside. ``measure`` compares nine points with
    quadrature, which can take longer than the transform; without it ``field_error`` is the bound of the edge law.

    Raises InputError for a pupil-space field, MethodLimitError when the sampling does not hold (``fft_size``).
    """
    _check(field)
    beam, edge = beam_at(field, _middle(field, sigma)), edge_of(field)
    size = _size(beam, edge, pixel_m, n)
    pitch = 1.0 / (beam.sigma * size * pixel_m)
    grid = covering(edge.u.min(axis=0), edge.u.max(axis=0), (pitch, pitch))
    share = shares([beam.support], grid, _PARTS)
    patch = Patch((-(n // 2), -(n // 2)), (n, n), (pixel_m, pixel_m))
    field_q = sampled(beam, grid, share)
    out = fft.transform(field_q, beam.sigma, grid, patch, (size, size))
    out *= beam.constant
    error = abs(float(np.vdot(field_q, field_q).real) * grid.cell / beam.power - 1.0)
    axis = patch.axis(0)
    if measure:
        measured, note = _measure(beam, axis, out)
    else:
        measured = fft.edge_noise(beam, edge, grid, patch) / float(np.abs(out).max())
        note = f"field wrong by at most {measured:.1e} of its peak (sampled edge); for pictures, not for contrasts"
    return Psf(axis, axis, np.abs(out) ** 2, out, beam.sigma, _FFT_METHOD, size, error, measured, note)


def _measure(beam: Beam, axis: Array, out: NDArray[np.complex128]) -> tuple[float, str]:
    """Error of a transformed field at nine points, relative to its peak; and a note that says what it is."""
    at = np.array([axis.size // 4, axis.size // 2, 3 * axis.size // 4])
    x = axis[at]
    try:
        nodes = rules.panel_nodes(beam, rules.farthest(x, x), 1)
    except MethodLimitError as limit:
        return math.nan, f"not measured ({limit}); sampled edge, for pictures, not for contrasts"
    direct = rules.direct_sum(nodes, beam.sigma, x, x) * beam.constant
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
    h = huygens.amplitude(field, x, y, _middle(field, sigma), level)
    note = "quadrature; the misfit of the pupil field comes on top"
    relative = h.error / float(np.abs(h.field).max())
    return Psf(x, y, np.abs(h.field) ** 2, h.field, h.sigma, METHOD, 0, 0.0, relative, note)
