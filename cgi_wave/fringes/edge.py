"""What beams see beyond the scene, where its edge goes on instead of the ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes.field import NominalPsf
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.pattern import Layer

Array = NDArray[np.float64]
Real = NDArray[np.floating]
IDENTITY = np.eye(2, 3)
#: Pixels along each side of the zone, and scrolls between none and the farthest, at which weights are looked up.
ALONG, SCROLLS = 9, 3


def weight_beyond(
    affine: Array, kernel: NDArray[np.floating], zone: Zone, shape: tuple[int, int], reach: float = 0.0
) -> float:
    """Largest part of a kernel that falls beyond a scene of ``shape`` rows and columns.

    affine (2, 3), kernel (h, w) : as of ``SceneView``; reach : rows by which the ground moves at most. Looked for on a
    grid of pixels that holds the zone's corners, where beams look farthest.
    """
    rows, columns = zone.shape
    j, i = (np.unique(np.rint(np.linspace(0, n - 1, ALONG))) for n in (rows, columns))
    y, x = (zone.y_m[0] + j * zone.pitch)[:, None], (zone.x_m[0] + i * zone.pitch)[None, :]
    column = zone.column + (affine[0, 0] * x + affine[0, 1] * y + affine[0, 2] - zone.x_m[0]) / zone.pitch
    row = zone.row + (affine[1, 0] * x + affine[1, 1] * y + affine[1, 2] - zone.y_m[0]) / zone.pitch
    sums = np.zeros((kernel.shape[0] + 1, kernel.shape[1] + 1))
    sums[1:, 1:] = kernel.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)
    total, least = float(sums[-1, -1]), np.inf
    for shift in np.linspace(0.0, reach, SCROLLS):
        low, high = _inside(row + shift, kernel.shape[0], shape[0])
        left, right = _inside(column, kernel.shape[1], shape[1])
        held = sums[high, right] - sums[low, right] - sums[high, left] + sums[low, left]
        least = min(least, float(held.min()))
    return max(total - least, 0.0) if total - least > 1e-12 * total else 0.0


def _inside(place: Array, size: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last + 1 element of a line of ``size`` about ``place`` that lies on samples 0 … count − 1."""
    start = np.rint(place).astype(np.int64) - size // 2
    low = np.clip(-start, 0, size)
    return low, np.maximum(np.clip(count - start, 0, size), low)


def edge_error(
    layers: Sequence[Layer], psf: NominalPsf | None, maps: Real, zone: Zone, reach: float = 0.0
) -> float:  # fmt: skip
    """Bound of what the ground beyond the scene may change of a frame, relative irradiance.

    Over all layers: strength of the pattern × the kernel's weight beyond the scene × range of maps[0] (C, H, W). The
    ground beyond is taken to be within the scene's range.
    """
    total = 0.0
    for layer in layers:
        kernel: NDArray[np.floating] = np.ones((1, 1))
        affine = IDENTITY
        if layer.view is not None:
            kernel, affine = layer.view.kernel, layer.view.affine
        elif psf is not None:
            kernel = np.abs(psf.kernel).max(axis=(0, 1))
        beyond = weight_beyond(affine, kernel, zone, (maps.shape[1], maps.shape[2]), reach)
        total += float(np.abs(layer.pattern[0]).max()) * beyond
    return total * float(np.ptp(maps[0]))
