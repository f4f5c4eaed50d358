"""Readers of map files: what stands in them, before it is judged."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MissingPackageError
from cgi_wave.scene.spectrum_file import AXES, SCALE, plain_units, spellings

Array = NDArray[np.float64]

#: GeoTIFF keys: model type 1 is a projected one; code of the metre.
_PROJECTED, _METRE = 1, 9001


@dataclass(frozen=True)
class RawMaps:
    """Maps as a file has them.

    values : (modes, first axis, second axis) of any number type; field : their name in the file
    sigma (S,) 1/m and shapes (modes, S) per (1/m), or None for albedo; the order of the samples is the file's
    pixel_m : along the first and the second axis, on the ground; orientation : see ``resample.oriented``
    scale : of the stated units; missing : the value that stands for none
    corner_m : scene coordinates (X, Y) of the outer corner, in m on the ground, of a scene that was placed
    """

    values: NDArray[Any]
    field: str
    sigma: Array | None = None
    shapes: Array | None = None
    pixel_m: tuple[float, float] | None = None
    orientation: str | None = None
    scale: float | None = None
    missing: float | None = None
    corner_m: tuple[float, float] | None = None
    rank_residual: float = 0.0
    source: str = ""


def read_maps(path: Path) -> RawMaps:
    """Read by suffix. Raises InputError for another suffix, an unreadable file, or variables that are missing."""
    readers = {".nc": _netcdf, ".npy": _npy, ".npz": _npz, ".tif": _tiff, ".tiff": _tiff}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(str(path), "file", path.suffix, "unknown kind of file", f"give {', '.join(readers)}")
    if not path.is_file():
        raise InputError(str(path), "file", path.name, "does not exist", "name an existing file")
    return reader(path)


def _netcdf(path: Path) -> RawMaps:
    import xarray

    try:
        with xarray.open_dataset(path, engine="h5netcdf", decode_times=False) as file:
            data = file.load()
    except (OSError, ValueError) as error:
        raise InputError(str(path), "file", path.name, f"not a NetCDF-4 file ({error})", "give NetCDF-4") from error
    pixel, axes = data.attrs.get("ground_pixel_m"), data.attrs.get("orientation")
    common: dict[str, Any] = {
        "pixel_m": None if pixel is None else _sizes(path, pixel),
        "orientation": None if axes is None else str(axes),
        "source": str(data.attrs.get("source", "")),
    }
    if "maps" not in data:
        if "albedo" not in data:
            raise _missing(path, sorted(map(str, data.variables)), "albedo, or maps and shapes")
        units = str(data["albedo"].attrs.get("units", ""))
        if units not in ("1", "%"):
            raise InputError(str(path), "albedo.units", units, "not those of a reflectance", "give units '1' or '%'")
        return RawMaps(data["albedo"].values[None], "albedo", scale=1.0 if units == "1" else 0.01, **common)

    found = [axis for axis in AXES if axis in data]
    if "shapes" not in data or len(found) != 1:
        raise _missing(path, sorted(map(str, data.variables)), "maps, shapes, and wavenumber or wavelength")
    axis = found[0]
    unit = plain_units(str(data[axis].attrs.get("units", "")))
    if unit not in AXES[axis]:
        raise InputError(str(path), f"{axis}.units", unit, "unknown unit", f"give one of {', '.join(AXES[axis])}")
    stated = plain_units(str(data["shapes"].attrs.get("units", "")))
    per = next((name for name in SCALE if stated in spellings(name)), None)
    if per is None:
        raise InputError(
            str(path), "shapes.units", stated, "not a spectral radiance", "give such as 'W m-2 sr-1 (m-1)-1'"
        )
    x = np.asarray(data[axis].values, dtype=np.float64) * SCALE[unit]
    if x.ndim != 1 or not (np.isfinite(x).all() and (x > 0).all()):
        raise InputError(str(path), axis, x.shape, "not a vector of positive numbers", "give one value per sample")
    sigma = 1 / x if axis == "wavelength" else x
    shapes = np.asarray(data["shapes"].values, dtype=np.float64) / SCALE[per]
    if per in AXES["wavelength"] and shapes.shape[-1:] == sigma.shape:
        shapes = shapes / sigma**2  # L_σ = L_λ |dλ/dσ|
    corner = None
    if "pixel_m" in data.attrs and common["pixel_m"] is not None and {"x", "y"} <= set(data.coords):
        own, ground = float(data.attrs["pixel_m"]), common["pixel_m"][0]
        first = [float(data[name].values[0]) for name in ("x", "y")]
        corner = ((first[0] / own - 0.5) * ground, (first[1] / own - 0.5) * ground)
    residual = float(data.attrs.get("rank_residual", 0.0))
    return RawMaps(data["maps"].values, "maps", sigma, shapes, corner_m=corner, rank_residual=residual, **common)


def _npy(path: Path) -> RawMaps:
    return RawMaps(_stack(_load(path)), "albedo")


def _npz(path: Path) -> RawMaps:
    with _load(path) as file:
        data = {name: file[name] for name in file.files}
    common: dict[str, Any] = {
        "pixel_m": _sizes(path, data["ground_pixel_m"]) if "ground_pixel_m" in data else None,
        "orientation": str(data["orientation"]) if "orientation" in data else None,
    }
    if "albedo" in data:
        return RawMaps(_stack(data["albedo"]), "albedo", **common)
    if not {"maps", "sigma", "shapes"} <= set(data):
        raise _missing(path, sorted(data), "albedo, or maps, sigma and shapes")
    sigma, shapes = (np.asarray(data[name], dtype=np.float64) for name in ("sigma", "shapes"))
    refused = sigma.ndim != 1 or not np.isfinite(sigma).all()
    if refused:
        raise InputError(str(path), "sigma", sigma.shape, "not a vector of finite numbers", "give wavenumbers in 1/m")
    return RawMaps(data["maps"], "maps", sigma, shapes, **common)


def _load(path: Path) -> Any:
    try:
        return np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(
            str(path), "file", path.name, f"not a NumPy file of numbers ({error})", "write it by numpy.save or savez"
        ) from error


def _tiff(path: Path) -> RawMaps:
    try:
        import tifffile
    except ImportError as error:
        raise MissingPackageError("tifffile", "geotiff") from error

    try:
        with tifffile.TiffFile(path) as file:
            page = file.pages.first
            values, tags = page.asarray(), page.geotiff_tags or {}
            bands, nodata = len(file.pages), page.nodata if "GDAL_NODATA" in page.tags else None
    except (OSError, ValueError, tifffile.TiffFileError) as error:
        raise InputError(
            str(path),
            "file",
            path.name,
            f"cannot be read as TIFF ({error})",
            "give an uncompressed or deflated GeoTIFF",
        ) from error
    if values.ndim == 3 and values.shape[-1] == 1:
        values = values[..., 0]
    if bands != 1 or values.ndim != 2:
        raise InputError(str(path), "bands", (bands, *values.shape), "not one band", "give a GeoTIFF of one band")
    pixel = None
    if "ModelPixelScale" in tags:
        model, unit = tags.get("GTModelTypeGeoKey"), tags.get("ProjLinearUnitsGeoKey", _METRE)
        if int(model or 0) == _PROJECTED and int(unit) == _METRE:
            across, down = (float(step) for step in tags["ModelPixelScale"][:2])
            pixel = (down, across)
    return RawMaps(values[None], "band 1", pixel_m=pixel, missing=None if nodata is None else float(nodata))


def _stack(values: NDArray[Any]) -> NDArray[Any]:
    return values[None] if values.ndim == 2 else values


def _sizes(path: Path, pixel: Any) -> tuple[float, float]:
    sizes = np.atleast_1d(np.asarray(pixel, dtype=np.float64))
    if sizes.size not in (1, 2) or not (np.isfinite(sizes).all() and (sizes > 0).all()):
        raise InputError(str(path), "ground_pixel_m", sizes.tolist(), "not one or two lengths", "give metres > 0")
    return float(sizes.flat[0]), float(sizes.flat[-1])


def _missing(path: Path, have: list[str], need: str) -> InputError:
    return InputError(str(path), "variables", have, "do not make a scene", f"give {need}")
