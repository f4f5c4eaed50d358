"""The embedded scene: a part of a Landsat 8 image (``data/landsat_crop.txt`` says which, and under what terms)."""

from __future__ import annotations

from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.scene.builders import from_albedo
from cgi_wave.scene.ground import Canvas, Scene, Tile, tiled
from cgi_wave.scene.resample import box_resample, oriented

#: Centres of the bands, m (Landsat 8 OLI).
BANDS = {"B2": 482e-9, "B3": 561e-9, "B4": 655e-9}
#: Assumed; not shipped with the data.
SUN_ELEVATION_DEG = 38.0


def landsat_reflectance(band: str, sun_elevation_deg: float = SUN_ELEVATION_DEG) -> tuple[NDArray[np.float64], float]:
    """Reflectance at the top of the atmosphere, (256, 272), north up, and its pixel in m.

    (2·10⁻⁵ DN − 0.1)/sin(sun elevation), the rescaling of Landsat 8's level-1 products. Raises InputError for an
    unknown band or a sun that is not above the horizon.
    """
    if band not in BANDS:
        raise InputError("landsat crop", "band", band, "unknown", f"use one of {', '.join(BANDS)}")
    if not 0 < sun_elevation_deg <= 90:
        raise InputError("landsat crop", "sun_elevation_deg", sun_elevation_deg, "no sun", "give 0 < elevation ≤ 90")
    with files("cgi_wave").joinpath("data/landsat_crop.npz").open("rb") as stream:
        data = np.load(stream)
        code, (low, high), pixel = data[band], data[f"{band}_range"], float(data["pixel_m"])
    number = low + (high - low) * (code / 255.0) ** 2
    return (2e-5 * number - 0.1) / np.sin(np.radians(sun_elevation_deg)), pixel


def landsat_crop(
    canvas: Canvas,
    rows: int = 256,
    columns: int = 272,
    band: str | None = None,
    tile: Tile | None = "mirror",
    orientation: str = "+y+x",
    mean_albedo: float | None = None,
    sun_elevation_deg: float = SUN_ELEVATION_DEG,
) -> Scene:
    """The embedded image as a scene of ``rows`` × ``columns`` pixels of the canvas, mirrored at its edges to fill them.

    band : which of B2, B3, B4 stands for the ground's reflectance; None takes the nearest in wavelength. All three are
        visible: beyond 700 nm B4 lends its pattern, while real fields are brighter there, and water darker.
    tile : None refuses a scene larger than the image
    orientation : what its axes run along (``resample.oriented``); by default the northern rows are seen first, east +X
    mean_albedo : rescale to this mean over the image; None keeps the reflectance as measured above the atmosphere
    sun_elevation_deg : assumed at the time of the image
    """
    if band is None:
        wavelength = 1 / float(np.mean(canvas.spectrum.sigma[[0, -1]]))
        band = min(BANDS, key=lambda name: abs(BANDS[name] - wavelength))
    albedo, pixel = landsat_reflectance(band, sun_elevation_deg)
    if mean_albedo is not None:
        if not 0 < mean_albedo <= 1:
            raise InputError("landsat crop", "mean_albedo", mean_albedo, "outside (0, 1]", "give a reflectance")
        albedo = albedo * (mean_albedo / albedo.mean())
    source = f"Landsat 8 {band} 2020-05-18 (USGS), sun elevation {sun_elevation_deg:g}° assumed"
    source += "" if mean_albedo is None else f", scaled to mean albedo {mean_albedo:g}"
    albedo = box_resample(oriented(albedo, orientation, source), (pixel, pixel), canvas.ground_pixel_m, source)
    return tiled(from_albedo(canvas, albedo, source), rows, columns, tile)
