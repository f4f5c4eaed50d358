"""A band's scenes: what its instrument file says of the ground, and scenes by name or file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from cgi_wave.budget.setting import FILE_OPD, band_spectrum, filter_of
from cgi_wave.errors import InputError
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.scene.builders import edge, point, quadrants, uniform
from cgi_wave.scene.ground import Canvas, Scene, Tile, ground_sample, on_zone, tiled
from cgi_wave.scene.ground_file import load_scene
from cgi_wave.scene.landsat import landsat_crop

#: Scenes that come without a file.
NAMES = ("landsat", "uniform", "edge", "quadrants", "point")


def canvas(system: OpticalSystem, ground_pixel_m: float | None = None) -> Canvas:
    """Reference spectrum, its albedo, and the pixel of a band on the detector and on the ground.

    ground_pixel_m : given, or else pixel·altitude/focal length as declared in the instrument file's ``entrance``.
    Raises InputError if neither is there.
    """
    spectrum, _ = band_spectrum(system)
    if ground_pixel_m is None:
        declared = system.document.entrance
        scale = []
        for field in ("altitude_km", "focal_mm"):
            value = getattr(declared, field)
            if value is None or not value > 0:
                raise InputError(
                    system.file,
                    f"entrance.{field}",
                    value,
                    "gives no scale of the ground",
                    "declare altitude_km and focal_mm > 0, or give ground_pixel_m",
                )
            scale.append(value)
        ground_pixel_m = ground_sample(system.pixel, 1e3 * scale[0], 1e-3 * scale[1])
    return Canvas(spectrum, system.spec.spectrum.albedo, system.pixel, ground_pixel_m)


def band_scene(
    system: OpticalSystem,
    scene: str | Path = "landsat",
    frames: int = 1,
    step: float = 1.0,
    margin: int = 0,
    tile: Tile | None = None,
    file_pixel_m: float | None = None,
    orientation: str | None = None,
    scale: float | None = None,
    offset: float = 0.0,
    zone: tuple[float, float, float, float] | None = None,
) -> Scene:
    """A scene over the band's zone, large enough for ``frames`` frames, each ``step`` rows after the one before.

    scene : one of ``NAMES``, with the builders' default contrasts, or a file (``load_scene``, which takes
    ``file_pixel_m`` to ``offset``). The embedded image is mirrored to the size needed; a file only if ``tile`` says so.
    margin : pixels more on all sides, for blur and for ghosts that bring in what lies beside the zone
    zone : x_min, x_max, y_min, y_max on the detector, m, to be covered instead of the band's own (dead zones, say)

    Raises InputError for an unknown name, for a file that is too small, and as ``load_scene`` does.
    """
    x0, x1, y0, y1 = system.zone() if zone is None else zone
    columns = round((x1 - x0) / system.pixel) + 2 * margin
    rows = round((y1 - y0) / system.pixel) + int(np.ceil((frames - 1) * step - 1e-9)) + 2 * margin
    here = canvas(system)
    if scene == "landsat":
        made = landsat_crop(here, rows, columns)
    elif scene in NAMES:
        builders: dict[str, Callable[..., Scene]] = {
            "uniform": uniform,
            "edge": edge,
            "quadrants": quadrants,
            "point": point,
        }
        made = builders[str(scene)](here, rows, columns)
    elif Path(scene).suffix:
        band_filter = filter_of(system)
        opd = FILE_OPD * system.spec.target_opd_mm * 1e-3
        made = load_scene(scene, here, band_filter, opd, file_pixel_m, orientation, scale, offset)
        if tile is not None:
            made = tiled(made, max(rows, made.rows), max(columns, made.columns), tile)
    else:
        raise InputError("scene", "name", str(scene), "unknown", f"use {', '.join(NAMES)}, or name a file")
    return on_zone(made, (x0, x1, y0, y1), frames, step, margin)
