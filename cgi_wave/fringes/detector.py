"""Detector noise by seed: shot, read, full well, quantisation.

Numbers come from a counter-based generator, keyed by the seed, with frame and block of rows as its counter: a frame's
noise is the same in whatever order, chunks or threads frames are made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError

Real = NDArray[np.floating]
Array = NDArray[np.float64]
BLOCK = 128  # rows per counter
#: Part of a frame's largest value below zero that convolutions and interpolated kernels may leave: counted as dark.
ROUNDING = 1e-4


@dataclass(frozen=True)
class Detector:
    """electrons : at relative irradiance 1; read_electrons : standard deviation; full_well : electrons at which a pixel
    saturates; bits : of the converter, whose last step is the full well (None: not quantised)
    shot : ``poisson``, its ``gaussian`` limit (several times faster; skewness 1/√electrons is lost), or ``none``
    """

    electrons: float
    read_electrons: float = 0.0
    full_well: float = np.inf
    bits: int | None = None
    shot: Literal["poisson", "gaussian", "none"] = "poisson"

    def __post_init__(self) -> None:
        for name, value in (("electrons", self.electrons), ("full_well", self.full_well)):
            if not value > 0.0:
                raise InputError("detector", name, value, "must be positive", "give electrons")
        if not self.read_electrons >= 0.0:
            raise InputError("detector", "read_electrons", self.read_electrons, "is negative", "give electrons rms")
        if self.bits is not None and not (1 <= self.bits <= 32 and np.isfinite(self.full_well)):
            raise InputError("detector", "bits", self.bits, "needs 1 to 32 bits and a finite full well",
                             "declare the full well, at which the converter ends")  # fmt: skip

    @property
    def step(self) -> float:
        """Electrons per count; 0 where nothing is quantised."""
        return 0.0 if self.bits is None else self.full_well / (2**self.bits - 1)

    def variance(self, irradiance: Array) -> Array:
        """Variance of the recorded relative irradiance, below saturation."""
        shot = 0.0 if self.shot == "none" else np.maximum(irradiance, 0.0) / self.electrons
        constant = (self.read_electrons**2 + self.step**2 / 12.0) / self.electrons**2
        return np.asarray(shot + constant)

    def record(self, frame: Real, number: int, seed: int) -> tuple[Real, int]:
        """What is recorded of frame ``number``, as relative irradiance, and the number of saturated pixels.

        Raises InputError for negative irradiance, beyond ROUNDING, under shot noise.
        """
        out = np.empty_like(frame)
        saturated = 0
        darkest = -ROUNDING * float(frame.max()) * self.electrons
        for block in range(-(-len(frame) // BLOCK)):
            rows = slice(block * BLOCK, (block + 1) * BLOCK)
            electrons = frame[rows].astype(np.float64) * self.electrons
            rng = np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, block, number]))
            if self.shot != "none" and electrons.min() < 0.0:
                if electrons.min() < darkest:
                    raise InputError("detector", "frame", float(electrons.min()),
                                     "negative irradiance has no shot noise", "check scene and patterns")  # fmt: skip
                np.maximum(electrons, 0.0, out=electrons)
            if self.shot == "gaussian":
                noise = rng.standard_normal(electrons.shape, dtype=np.float32)
                electrons += np.sqrt(electrons + self.read_electrons**2) * noise
            else:
                if self.shot == "poisson":
                    electrons = rng.poisson(electrons).astype(np.float64)
                if self.read_electrons:
                    electrons += self.read_electrons * rng.standard_normal(electrons.shape, dtype=np.float32)
            saturated += int((electrons >= self.full_well).sum())
            np.minimum(electrons, self.full_well, out=electrons)
            if self.bits is not None:
                electrons = np.rint(np.maximum(electrons, 0.0) / self.step) * self.step
            out[rows] = electrons / self.electrons
        return out, saturated
