"""Matrix Fourier transform and chirp-z of the sampled pupil: any pitch on the detector for any pitch in the pupil."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cgi_wave.wave.basis import Array
from cgi_wave.wave.methods.grid import Grid, sampled
from cgi_wave.wave.methods.onpatch import SampledPatch
from cgi_wave.wave.methods.patch import Amplitude, Patch
from cgi_wave.wave.methods.shape import Beam


def matrix_transform(beam: Beam, grid: Grid, share: Array, patch: Patch) -> Amplitude:
    """h on a patch as two matrix products (Soummer et al. 2007), without the beam's constant."""
    samples = sampled(beam, grid, share)
    left = _kernel(beam.sigma, patch.axis(0), grid.axis(0))
    right = _kernel(beam.sigma, patch.axis(1), grid.axis(1))
    field = left @ samples @ right.T
    field *= beam.sigma * grid.cell
    return Amplitude(patch.axis(0), patch.axis(1), field, beam.sigma, "matrix transform", samples.size, math.nan)


def _kernel(sigma: float, x: Array, u: Array) -> NDArray[np.complex128]:
    """(X, U) exp(i 2πσ x u)."""
    turns = sigma * np.outer(x, u)
    kernel: NDArray[np.complex128] = np.exp(2j * np.pi * (turns - np.rint(turns)))
    return kernel


def chirp_transform(beam: Beam, grid: Grid, share: Array, patch: Patch) -> Amplitude:
    """h on a patch by chirp-z along both axes (Rabiner, Schafer and Rader 1969; ``scipy.signal.CZT``)."""
    samples = sampled(beam, grid, share)
    nodes = samples.size
    for axis in (0, 1):
        samples = _chirp(samples, beam.sigma, grid, patch, axis)
    samples *= beam.sigma * grid.cell
    return Amplitude(patch.axis(0), patch.axis(1), samples, beam.sigma, "chirp-z", nodes, math.nan)


def _chirp(
    samples: NDArray[np.complex128], sigma: float, grid: Grid, patch: Patch, axis: int
) -> NDArray[np.complex128]:
    """Along one axis, Σ_j s_j exp(i 2πσ x_k u_j): the sum from u_first with the phase of u_first put back."""
    from scipy.signal import CZT

    given, wanted = grid.count[axis], patch.count[axis]
    step = sigma * grid.pitch[axis]
    # CZT sums s_j (a w^-k)^-j, so that w = exp(-i 2π step·pitch) and a = exp(-i 2π step·x_0) give exp(+i 2π …).
    transform = CZT(
        given,
        wanted,
        np.exp(2j * np.pi * step * patch.pitch[axis]),
        np.exp(-2j * np.pi * step * patch.pitch[axis] * patch.start[axis]),
    )
    x = patch.axis(axis)
    shift = np.exp(2j * np.pi * sigma * x * grid.axis(axis)[0])
    out: NDArray[np.complex128] = transform(samples, axis=axis)
    out *= shift[:, None] if axis == 0 else shift[None, :]
    return out


class MatrixFourier(SampledPatch):
    """Overlap as a sum on a patch, its PSFs by matrix products."""

    name = "matrix transform"

    def steps(self, count: tuple[int, int], patch: Patch, pitch: tuple[float, float], sigma: float) -> float:
        """Multiplications of two products for each of two beams."""
        return 2.0 * patch.count[0] * count[1] * (count[0] + patch.count[1])

    def amplitude(self, beam: Beam, grid: Grid, share: Array, patch: Patch) -> Amplitude:
        """h on the patch."""
        return matrix_transform(beam, grid, share, patch)


class ChirpZ(SampledPatch):
    """Overlap as a sum on a patch, its PSFs by chirp-z transforms."""

    name = "chirp-z"

    def steps(self, count: tuple[int, int], patch: Patch, pitch: tuple[float, float], sigma: float) -> float:
        """Two transforms of length cells + points for every row and column, for two beams."""
        size = [count[a] + patch.count[a] for a in (0, 1)]
        return 4.0 * (count[1] * size[0] * math.log2(size[0]) + patch.count[0] * size[1] * math.log2(size[1]))

    def amplitude(self, beam: Beam, grid: Grid, share: Array, patch: Patch) -> Amplitude:
        """h on the patch."""
        return chirp_transform(beam, grid, share, patch)
