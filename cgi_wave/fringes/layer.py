"""What a frame is made of: layers of beams that see the scene alike, and the zone of the detector they fall on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError

Array = NDArray[np.float64]
Real = NDArray[np.floating]


@dataclass(frozen=True)
class Layer:
    """Beams that see the scene alike: all nominal beams and their pairs, or one family of ghosts.

    name : ``nominal``, or the family's history
    pattern : (C, R, X) relative irradiance per spectral mode of a uniform scene, pixel integration included
    affine : (2, 3) scene coordinates (X, Y) = affine @ (x, y, 1) of a detector point, m; the identity for the nominal
        beams, since scene coordinates are where they image a ground point at scroll 0
    kernel : blur over scene coordinates at the detector's pitch, odd sizes, sum 1: the image is the scene convolved
        with it (true convolution). None: sharp
    error : bound of the pattern, relative irradiance
    """

    name: str
    pattern: Real
    affine: Array
    kernel: Array | None
    error: float


@dataclass(frozen=True)
class Zone:
    """Pixels of a frame, and which sample of the scene the nominal beam images on the first of them.

    x_m : (X,) columns, y_m : (R,) rows, m, pixel centres, ascending at one pitch
    row, column : scene sample seen by pixel (0, 0) at scroll 0; sample (row + j, column + i) by pixel (j, i)
    """

    x_m: Array
    y_m: Array
    row: int = 0
    column: int = 0

    @property
    def pitch(self) -> float:
        """Pixel pitch, m."""
        return float(self.x_m[-1] - self.x_m[0]) / (len(self.x_m) - 1)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.y_m), len(self.x_m)


def check_layers(layers: tuple[Layer, ...], modes: int, zone: Zone) -> None:
    """Raise InputError for a pattern, map or kernel of the wrong shape or with values that are not finite."""
    for layer in layers:
        wanted = (modes, *zone.shape)
        if layer.pattern.shape != wanted:
            raise InputError("frames", f"layer {layer.name}.pattern", layer.pattern.shape, f"must have shape {wanted}",
                             "synthesise the pattern for this zone and these spectral modes")  # fmt: skip
        if layer.affine.shape != (2, 3) or not np.all(np.isfinite(layer.affine)):
            raise InputError("frames", f"layer {layer.name}.affine", layer.affine.shape, "must be a finite (2, 3) map",
                             "fit it to traced field points")  # fmt: skip
        kernel = layer.kernel
        if kernel is None:
            continue
        if kernel.ndim != 2 or kernel.shape[0] % 2 == 0 or kernel.shape[1] % 2 == 0 or not np.all(np.isfinite(kernel)):
            raise InputError("frames", f"layer {layer.name}.kernel", kernel.shape, "must be finite, with odd sizes",
                             "centre the kernel on a pixel")  # fmt: skip
        if abs(float(kernel.sum()) - 1.0) > 1e-6:
            raise InputError("frames", f"layer {layer.name}.kernel", float(kernel.sum()), "must have the sum 1",
                             "divide it by its sum; power belongs to the pattern")  # fmt: skip
