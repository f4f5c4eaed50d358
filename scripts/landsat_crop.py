"""Make the embedded scene from a Landsat 8 crop: python scripts/landsat_crop.py CROP.npz

Reads the arrays B2, B3 and B4 (uint16 digital numbers, 30 m pixels), resamples them by area to the reference
instrument's 75 m, and writes cgi_wave/data/landsat_crop.npz, in 8 bits on a square-root scale: steps grow with the
signal as its noise does. What it is and where from stands beside it, in cgi_wave/data/landsat_crop.txt.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from cgi_wave.scene.resample import box_resample

PIXEL_M, TO_M = 30.0, 75.0
OUT = Path(__file__).parents[1] / "cgi_wave" / "data" / "landsat_crop.npz"


def main(crop: str) -> None:
    source = np.load(crop)
    arrays: dict[str, np.ndarray] = {"pixel_m": np.array(TO_M)}
    for band in ("B2", "B3", "B4"):
        number = box_resample(source[band].astype(np.float64), (PIXEL_M, PIXEL_M), TO_M)
        low, high = number.min(), number.max()
        code = np.round(255 * np.sqrt((number - low) / (high - low))).astype(np.uint8)
        error = 2e-5 * np.abs(low + (high - low) * (code / 255) ** 2 - number)
        rms = np.sqrt(np.mean(error**2))
        print(f"{band}: {number.shape}, coding error of the reflectance {error.max():.1e} at most, {rms:.1e} RMS")
        arrays |= {band: code, f"{band}_range": np.array([low, high])}
    np.savez_compressed(OUT, allow_pickle=False, **arrays)
    print(f"{OUT}: {OUT.stat().st_size} bytes")


if __name__ == "__main__":
    main(sys.argv[1])
