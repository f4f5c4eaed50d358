"""Scenes in files: written as NetCDF, read as NetCDF, NumPy or GeoTIFF and brought to the instrument's pixel."""

from __future__ import annotations

import os
import secrets
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.scene.builders import from_albedo
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.ground import Canvas, Scene, refuse_bad, require_filter, require_positive
from cgi_wave.scene.map_files import RawMaps, read_maps
from cgi_wave.scene.resample import box_resample, oriented
from cgi_wave.scene.spectrum_file import MAX_SAMPLES

Array = NDArray[np.float64]
_T = TypeVar("_T")

#: A reflectance above this is taken for one in percent, or for digital numbers.
_LARGEST_ALBEDO = 1.5


def save_scene(scene: Scene, path: str | Path) -> None:
    """Write a scene as NetCDF-4 with named dimensions, coordinates and units; whole or not at all.

    Variables maps (mode, y, x), shapes (mode, wavenumber), with x and y in m on the detector; the rest are attributes.
    Raises InputError if the file cannot be written.
    """
    import xarray

    path = Path(path)
    data = xarray.Dataset(
        {
            "maps": (("mode", "y", "x"), scene.maps, {"units": "1", "long_name": "weight of each spectral shape"}),
            "shapes": (
                ("mode", "wavenumber"),
                scene.shapes,
                {"units": "W m-2 sr-1 (m-1)-1", "long_name": "spectral radiance of each mode"},
            ),
        },
        coords={
            "mode": ("mode", np.arange(len(scene.maps)), {"units": "1", "long_name": "0: reference spectrum"}),
            "y": ("y", scene.y_m, {"units": "m", "long_name": "scene coordinate along track, on the detector"}),
            "x": ("x", scene.x_m, {"units": "m", "long_name": "scene coordinate across track, on the detector"}),
            "wavenumber": ("wavenumber", scene.sigma, {"units": "m-1", "long_name": "vacuum wavenumber"}),
        },
        attrs={
            "title": "ground scene: radiance = sum over mode of maps * shapes",
            "source": scene.source,
            "pixel_m": scene.pixel_m,
            "ground_pixel_m": scene.ground_pixel_m,
            "orientation": "+y+x",
            "rank_residual": scene.rank_residual,
        },
    )
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(4)}{path.suffix}")
    try:
        data.to_netcdf(temporary, engine="h5netcdf", encoding={"maps": {"zlib": True, "complevel": 1, "shuffle": True}})
        os.replace(temporary, path)
    except OSError as error:
        problem = f"cannot be written ({error.strerror or error})"
        raise InputError(str(path), "file", path.name, problem, "name a file in a folder that exists") from None
    finally:
        temporary.unlink(missing_ok=True)


def load_scene(
    path: str | Path,
    canvas: Canvas,
    band_filter: Filter | None = None,
    max_opd_m: float | None = None,
    file_pixel_m: float | tuple[float, float] | None = None,
    orientation: str | None = None,
    scale: float | None = None,
    offset: float = 0.0,
) -> Scene:
    """A scene from a file, turned into scene axes and resampled by area to the canvas's ground pixel.

    ``.nc``: ``albedo`` (two dimensions; units "1" or "%"), or ``maps`` (mode, rows, columns) with ``shapes`` (mode,
    wavenumber or wavelength) and that axis, as ``save_scene`` writes them. ``.npz``: arrays ``albedo``, or ``maps``,
    ``sigma`` (1/m) and ``shapes`` (W m⁻² sr⁻¹ per 1/m). ``.npy``: one albedo map. ``.tif``, ``.tiff``: one band of
    albedo; its pixel is read from the GeoTIFF tags, if they are in metres (needs the extra ``geotiff``).

    An albedo map takes the canvas's spectrum. Shapes of the file's own are kept, on a uniform grid; with
    ``band_filter`` they must cover it, with ``max_opd_m`` be spaced by 1/(4·max_opd_m) or less.

    file_pixel_m : pixel of the file on the ground, m, or (first axis, second axis); orientation : what these axes run
        along, as ``"+y+x"`` (``resample.ORIENTATIONS``). Each has to be stated once: in the file (attributes or arrays
        ``ground_pixel_m`` and ``orientation``) or here.
    scale, offset : albedo = scale·value + offset; required for integers, 1 and 0 otherwise

    Raises InputError with file, field, value and remedy for what is missing, contradictory, not finite, negative, or
    of the wrong shape; MissingPackageError for a GeoTIFF without its reader.
    """
    raw = read_maps(Path(path))
    name = str(path)
    pixel = _stated(name, "ground_pixel_m", raw.pixel_m, _pair(name, file_pixel_m), "the pixel's size on the ground, m")
    axes = _stated(name, "orientation", raw.orientation, orientation, "what the map's axes run along, such as '+y+x'")
    maps = _scaled(name, raw, scale, offset)
    refuse_bad(name, raw.field, maps, ("mode", "row", "column"))
    low = maps if raw.shapes is None else maps[:1]
    refuse_bad(name, raw.field, low, ("mode", "row", "column"), negative=True)
    maps = oriented(maps, axes, name)
    if axes[1] == "x":
        pixel = pixel[::-1]
    before = maps.shape[1:]
    maps = box_resample(maps, pixel, canvas.ground_pixel_m, name)
    source = name
    if maps.shape[1:] != before:
        source += f"; resampled from {pixel[0]:g} m × {pixel[1]:g} m to {canvas.ground_pixel_m:g} m"
    if raw.source:
        source += f"; {raw.source}"
    if raw.shapes is None or raw.sigma is None:
        if maps.max() > _LARGEST_ALBEDO:
            raise InputError(
                name,
                raw.field,
                float(maps.max()),
                f"no reflectance: above {_LARGEST_ALBEDO}",
                "give scale (0.01 for %)",
            )
        return from_albedo(canvas, maps[0], source)
    if raw.sigma.size < 2:
        raise InputError(name, "sigma", raw.sigma.size, "fewer than two samples", "give a spectrum")
    sigma, shapes = _uniform(name, raw.sigma, raw.shapes, max_opd_m)
    origin = (0.0, 0.0)
    if raw.corner_m is not None:  # scene coordinates of the outer corner, in ground metres
        turn = canvas.pixel_m / canvas.ground_pixel_m
        origin = (raw.corner_m[0] * turn + 0.5 * canvas.pixel_m, raw.corner_m[1] * turn + 0.5 * canvas.pixel_m)
    scene = Scene(
        maps=maps.astype(np.float32),
        sigma=sigma,
        shapes=shapes,
        pixel_m=canvas.pixel_m,
        ground_pixel_m=canvas.ground_pixel_m,
        source=source,
        rank_residual=raw.rank_residual,
        origin_m=origin,
    )
    if band_filter is not None:
        require_filter(scene, band_filter)
    require_positive(scene)
    return scene


def _scaled(name: str, raw: RawMaps, scale: float | None, offset: float) -> Array:
    if raw.values.ndim != 3 or 0 in raw.values.shape:
        raise InputError(
            name, raw.field, raw.values.shape, "not a map of rows and columns", "give a two-dimensional map"
        )
    if raw.shapes is not None:
        if scale is not None or offset:
            raise InputError(name, "scale, offset", (scale, offset), "are for albedo", "scale the shapes instead")
        if raw.sigma is None or raw.shapes.shape != (len(raw.values), raw.sigma.size):
            need = (len(raw.values), 0 if raw.sigma is None else raw.sigma.size)
            raise InputError(name, "shapes", raw.shapes.shape, f"not (modes, samples) = {need}", "give a shape per map")
        refuse_bad(name, "shapes", raw.shapes, ("mode", "sample"))
        return raw.values.astype(np.float64)
    if len(raw.values) != 1:
        raise InputError(name, raw.field, raw.values.shape, "several bands", "give one map, or maps with shapes")
    if scale is not None and raw.scale is not None:
        raise InputError(name, f"{raw.field}.units", scale, "the file states units already", "drop the argument scale")
    if scale is None and raw.scale is None and raw.values.dtype.kind in "iub":
        raise InputError(
            name,
            raw.field,
            str(raw.values.dtype),
            "integers, not reflectances",
            "give scale and offset: albedo = scale·value + offset",
        )
    values = raw.values.astype(np.float64)
    if raw.missing is not None:
        values[raw.values == raw.missing] = np.nan
    return values * (scale if scale is not None else raw.scale or 1.0) + offset


def _pair(name: str, pixel: float | tuple[float, float] | None) -> tuple[float, float] | None:
    if pixel is None:
        return None
    both = (pixel, pixel) if isinstance(pixel, int | float) else (float(pixel[0]), float(pixel[1]))
    if not (np.isfinite(both).all() and min(both) > 0):
        raise InputError(name, "file_pixel_m", pixel, "not a length", "give the pixel on the ground in m")
    return both


def _stated(name: str, field: str, in_file: _T | None, given: _T | None, what: str) -> _T:
    """The one statement of a fact, from the file or the caller."""
    value = given if in_file is None else in_file
    if value is None:
        raise InputError(name, field, None, "is not stated", f"state it in the file or as an argument: {what}")
    if in_file is not None and given is not None and in_file != given:
        raise InputError(name, field, in_file, f"contradicts the argument {given!r}", "state it once")
    return value


def _uniform(name: str, sigma: Array, shapes: Array, max_opd_m: float | None) -> tuple[Array, Array]:
    """Ascending uniform wavenumbers and the shapes on them, straight between the file's samples."""
    if sigma[0] > sigma[-1]:
        sigma, shapes = sigma[::-1], shapes[:, ::-1]
    spacing = np.diff(sigma)
    if sigma[0] <= 0 or not spacing.min() > 0:
        raise InputError(name, "sigma", float(sigma[0]), "not positive and strictly monotone", "sort the samples")
    widest = float(spacing.max())
    if max_opd_m is not None and widest > (1 + 1e-6) / (4 * max_opd_m):
        raise InputError(
            name,
            "sigma",
            f"widest spacing {widest:.4g} 1/m",
            f"carries OPDs to {1 / (4 * widest):.4g} m only",
            f"give a spacing of at most {1 / (4 * max_opd_m):.4g} 1/m for an OPD of {max_opd_m:g} m",
        )
    if np.ptp(spacing) <= 1e-6 * spacing.mean():
        return np.linspace(sigma[0], sigma[-1], sigma.size), shapes
    count = min(int(np.ceil((sigma[-1] - sigma[0]) / spacing.min())) + 1, MAX_SAMPLES)
    grid = np.linspace(sigma[0], sigma[-1], count)
    return grid, np.stack([np.interp(grid, sigma, shape) for shape in shapes])
