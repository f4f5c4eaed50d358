"""Other programs' transforms of the same 512² gray pupil onto 256² points, one thread, plans kept where they can be.

Each peer is a function that returns (call, points): the call repeats the transform alone, with everything that can be
prepared beforehand prepared, and returns a complex array [ix, iy] that is the amplitude on the points up to a
constant; points are its coordinates along both axes in λ over the pupil's radius.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

N, POINTS, PAD = 512, 256, 1024  # samples across the pupil, points a side, samples of the padded transform

Array = NDArray[np.float64]
Call = Callable[[], NDArray[np.complex128]]
Peer = Callable[[Array], tuple[Call, Array]]
#: Points at the middle of a sample grid, in λ over the radius: the pupil is 2 radii in N samples.
CENTRED = (np.arange(POINTS) - POINTS // 2) * N / (2.0 * PAD)
BETWEEN = CENTRED + 0.5 * N / (2.0 * PAD)


def padded_scipy(pupil: Array) -> tuple[Call, Array]:
    """scipy.fft on the padded square."""
    import scipy.fft

    square = _padded(pupil)

    def call() -> NDArray[np.complex128]:
        full = scipy.fft.fft2(square, workers=1)
        return _cropped(full)

    return call, CENTRED


def padded_pyfftw(pupil: Array) -> tuple[Call, Array]:
    """FFTW on the padded square, a measured plan."""
    import pyfftw

    source = pyfftw.empty_aligned((PAD, PAD), dtype="complex128")
    result = pyfftw.empty_aligned((PAD, PAD), dtype="complex128")
    plan = pyfftw.FFTW(source, result, axes=(0, 1), flags=("FFTW_MEASURE",), threads=1)
    source[:] = _padded(pupil)

    def call() -> NDArray[np.complex128]:
        plan.execute()
        return _cropped(result)

    return call, CENTRED


def _padded(pupil: Array) -> NDArray[np.complex128]:
    """Cell centres lie at half samples; the phase that follows is put right by comparing moduli with signs."""
    square = np.zeros((PAD, PAD), complex)
    square[:N, :N] = pupil
    return square


def _cropped(full: NDArray[np.complex128]) -> NDArray[np.complex128]:
    half = POINTS // 2
    rows = np.concatenate([full[-half:], full[:half]])
    return np.concatenate([rows[:, -half:], rows[:, :half]], axis=1)


def scipy_zoom(pupil: Array) -> tuple[Call, Array]:
    """scipy.signal.ZoomFFT along both axes."""
    from scipy.signal import ZoomFFT

    reach = POINTS / PAD
    zoom = ZoomFFT(N, [-0.5 * reach, 0.5 * reach], POINTS, fs=1.0)
    source = pupil.astype(complex)

    def call() -> NDArray[np.complex128]:
        return np.asarray(zoom(zoom(source, axis=0), axis=1))

    return call, CENTRED


def prysm_mdft(pupil: Array) -> tuple[Call, Array]:
    """prysm's matrix transform."""
    from prysm.fttools import mdft

    source = pupil.astype(complex)
    return (lambda: np.asarray(mdft.dft2(source, PAD / N, POINTS))), CENTRED


def prysm_czt(pupil: Array) -> tuple[Call, Array]:
    """prysm's chirp-z transform."""
    from prysm.fttools import czt

    source = pupil.astype(complex)
    return (lambda: np.asarray(czt.czt2(source, PAD / N, POINTS))), CENTRED


def poppy_mft(pupil: Array) -> tuple[Call, Array]:
    """poppy's matrix_dft."""
    from poppy.matrixDFT import matrix_dft

    source = pupil.astype(complex)
    width = POINTS * N / PAD  # in λ over the diameter
    return (lambda: np.asarray(matrix_dft(source, width, POINTS, centering="SYMMETRIC"))), BETWEEN


def _hcipy_grids() -> tuple[Any, Any]:
    import hcipy

    pupil = hcipy.make_uniform_grid([N, N], [2.0, 2.0])
    step = 2.0 * np.pi * N / (2.0 * PAD)
    focal = hcipy.CartesianGrid(
        hcipy.RegularCoords([step, step], [POINTS, POINTS], np.array([1.0, 1.0]) * step * -(POINTS // 2))
    )
    return pupil, focal


def hcipy_mft(pupil: Array) -> tuple[Call, Array]:
    """hcipy's matrix transform, matrices kept."""
    import hcipy

    grid, focal = _hcipy_grids()
    transform = hcipy.MatrixFourierTransform(grid, focal, precompute_matrices=True, allocate_intermediate=True)
    source = hcipy.Field(pupil.ravel().astype(complex), grid)
    return (lambda: np.asarray(transform.forward(source)).reshape(POINTS, POINTS)), CENTRED


def hcipy_zoom(pupil: Array) -> tuple[Call, Array]:
    """hcipy's zoom FFT."""
    import hcipy

    grid, focal = _hcipy_grids()
    transform = hcipy.ZoomFastFourierTransform(grid, focal)
    source = hcipy.Field(pupil.ravel().astype(complex), grid)
    return (lambda: np.asarray(transform.forward(source)).reshape(POINTS, POINTS)), CENTRED


def finufft_grid(pupil: Array) -> tuple[Call, Array]:
    """finufft type 1 from the lit cells of the gray pupil, eps 1e-6, plan kept."""
    import finufft

    i, j = np.nonzero(pupil)
    step = 2.0 * np.pi / PAD
    plan = finufft.Plan(1, (POINTS, POINTS), eps=1e-6, isign=-1, nthreads=1)
    plan.setpts((i - N / 2 + 0.5) * step, (j - N / 2 + 0.5) * step)
    strength = pupil[i, j].astype(complex)
    return (lambda: plan.execute(strength)), CENTRED


PEERS: dict[str, Peer] = {
    "scipy.fft, padded": padded_scipy,
    "pyfftw, padded, measured": padded_pyfftw,
    "scipy ZoomFFT": scipy_zoom,
    "prysm matrix DFT": prysm_mdft,
    "prysm chirp-z": prysm_czt,
    "poppy matrix DFT": poppy_mft,
    "hcipy matrix DFT": hcipy_mft,
    "hcipy zoom FFT": hcipy_zoom,
    "finufft from the gray grid": finufft_grid,
}


def available(pupil: Array) -> Iterator[tuple[str, Call | None, Array, str]]:
    """(name, call, points, "") of each peer, or (name, None, …, reason) for one that cannot be had."""
    for name, peer in PEERS.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                call, points = peer(pupil)
                call()
        except Exception as reason:
            yield name, None, CENTRED, f"{type(reason).__name__}: {reason}"
            continue
        yield name, call, points, ""
