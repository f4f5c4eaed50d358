"""The zone of the detector that frames are made for, and where its pixels stand in a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Zone:
    """Pixels of a frame, and which sample of the scene the nominal beam images on the first of them.

    x_m : (X,) columns, y_m : (R,) rows, m, pixel centres, ascending at one pitch (that of the scene's maps)
    row, column : scene sample seen by pixel (0, 0) at scroll 0; sample (row + j, column + i) by pixel (j, i). Fractions
        are allowed and cost an interpolation
    phase : (R, X) rad, 2πσ0 times the nominal OPD; None: no harmonics are taken out of ghost patterns
    dark : rows on which patterns do not continue those of their neighbours: dead zones
    """

    x_m: Array
    y_m: Array
    row: float = 0.0
    column: float = 0.0
    phase: Array | None = None
    dark: tuple[int, ...] = ()

    @property
    def pitch(self) -> float:
        """Pixel pitch, m."""
        return float(self.y_m[-1] - self.y_m[0]) / (len(self.y_m) - 1)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.y_m), len(self.x_m)
