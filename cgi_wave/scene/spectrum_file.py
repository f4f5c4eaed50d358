"""A user's radiance spectrum from a CSV or NetCDF file."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.scene.filters import Filter, require_coverage
from cgi_wave.scene.spectrum import Spectrum

Array = NDArray[np.float64]
MAX_SAMPLES = 4_000_000
_RESAMPLING_TARGET = 1e-4
SCALE = {"nm": 1e-9, "um": 1e-6, "m": 1.0, "cm-1": 1e2, "m-1": 1.0}  # one unit in m (lengths) or 1/m (wavenumbers)
AXES = {"wavelength": ("nm", "um", "m"), "wavenumber": ("cm-1", "m-1")}
_COLUMNS = (
    "columns wavelength_{nm,um,m} or wavenumber_{cm-1,m-1}, and radiance_W_m2_sr_{nm,um,m,cm-1,m-1}, "
    "such as wavelength_nm,radiance_W_m2_sr_nm"
)
_VARIABLES = (
    "variables wavelength (units nm, um, m) or wavenumber (cm-1, m-1), and radiance (units such as 'W m-2 sr-1 nm-1' "
    "or 'W m-2 sr-1 (cm-1)-1')"
)


def load_spectrum(path: str | Path, band_filter: Filter | None = None, max_opd_m: float | None = None) -> Spectrum:
    """Read, check, convert to radiance per wavenumber and resample to a uniform grid.

    CSV (any suffix but .nc): a header whose names hold the units, ``#`` lines are skipped, other columns ignored.
    NetCDF (.nc): one-dimensional variables with a ``units`` attribute. Wavelengths are those of the vacuum. Rows may
    ascend or descend. Radiance per wavelength is multiplied by λ² to be per wavenumber.

    A grid already uniform in wavenumber is kept. Else the new one is straight between the file's points, fine enough
    that at these it is within 1e-4 of the largest radiance (or what 4 million samples reach); ``source`` says which.
    With ``band_filter``, the file must cover it, and only its support is kept. With ``max_opd_m``, the file's own
    widest spacing (over the support) must be at most 1/(4·max_opd_m): interpolating would hide that it is too coarse.

    Raises InputError with file, field, value and remedy for anything that cannot be used.
    """
    path = Path(path)
    axis, axis_unit, x, per, radiance = _read_netcdf(path) if path.suffix == ".nc" else _read_csv(path)
    _check(path, axis, x, radiance)
    sigma = 1 / (x * SCALE[axis_unit]) if axis == "wavelength" else x * SCALE[axis_unit]
    per_sigma = radiance / SCALE[per]
    if per in AXES["wavelength"]:
        per_sigma = per_sigma / sigma**2  # L_σ = L_λ |dλ/dσ|
    if sigma[0] > sigma[-1]:
        sigma, per_sigma = sigma[::-1], per_sigma[::-1]
    if band_filter is not None:
        require_coverage(Spectrum(sigma, per_sigma, str(path)), band_filter)
        low, high = np.searchsorted(sigma, band_filter.support())
        kept = slice(max(int(low) - 1, 0), int(high) + 1)
        sigma, per_sigma = sigma[kept], per_sigma[kept]
    widest = float(np.diff(sigma).max())
    if max_opd_m is not None and widest > (1 + 1e-6) / (4 * max_opd_m):
        raise InputError(
            str(path),
            axis,
            f"widest spacing {widest / 100:.4g} cm-1",
            f"carries OPDs to {1 / (4 * widest):.4g} m only",
            f"give a spacing of at most {1 / (400 * max_opd_m):.4g} cm-1 for an OPD of {max_opd_m:g} m",
        )
    return _uniform(path, sigma, per_sigma, max_opd_m)


def _uniform(path: Path, sigma: Array, radiance: Array, max_opd_m: float | None) -> Spectrum:
    spacing = np.diff(sigma)
    span = sigma[-1] - sigma[0]
    if np.ptp(spacing) <= 1e-6 * spacing.mean():
        return Spectrum(np.linspace(sigma[0], sigma[-1], sigma.size), radiance, f"{path}, on its own grid")
    step = float(spacing.min())
    if max_opd_m is not None:
        step = min(step, 1 / (4 * max_opd_m))
    samples = min(int(np.ceil(span / step)) + 1, MAX_SAMPLES)
    while True:
        grid = np.linspace(sigma[0], sigma[-1], samples)
        values = np.interp(grid, sigma, radiance)
        error = float(np.max(np.abs(np.interp(sigma, grid, values) - radiance)) / radiance.max())
        if error <= _RESAMPLING_TARGET or samples >= MAX_SAMPLES:
            return Spectrum(grid, values, f"{path}, resampled to {samples} samples within {error:.1e} of its maximum")
        samples = min(2 * samples, MAX_SAMPLES)


def _check(path: Path, axis: str, x: Array, radiance: Array) -> None:
    for field, values in ((axis, x), ("radiance", radiance)):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                str(path),
                field,
                float(values[bad[0]]),
                f"not finite at data row {bad[0] + 1}",
                "remove or fill the row",
            )
    if x.size < 2:
        raise InputError(str(path), axis, x.size, "fewer than two data rows", "give a spectrum")
    if x.min() <= 0:
        raise InputError(str(path), axis, float(x.min()), "not positive", "give vacuum wavelengths or wavenumbers > 0")
    rising = np.diff(x) * np.sign(x[-1] - x[0])
    if rising.min() <= 0:
        row = int(np.argmin(rising > 0)) + 2
        raise InputError(
            str(path),
            axis,
            float(x[row - 1]),
            f"not strictly monotone at data row {row}",
            "sort the rows, drop repeats",
        )
    if radiance.min() < 0:
        row = int(np.argmin(radiance)) + 1
        raise InputError(
            str(path), "radiance", float(radiance.min()), f"negative at data row {row}", "give radiances ≥ 0"
        )
    if radiance.max() == 0:
        raise InputError(str(path), "radiance", 0.0, "zero everywhere", "give a spectrum with light in it")


def _read_csv(path: Path) -> tuple[str, str, Array, str, Array]:
    """(axis, its unit, values, unit that the radiance is per, values)."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = [row for row in csv.reader(line for line in stream if not line.lstrip().startswith("#")) if row]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            str(path), "file", path.name, f"cannot be read as text ({error})", "give a CSV file"
        ) from error
    header = [name.strip() for name in rows[0]] if rows else []
    found_axis, found_radiance = [], []
    for index, name in enumerate(header):
        if match := re.fullmatch(r"(wavelength|wavenumber)_(\S+)", name):
            found_axis.append((index, name, match[1], match[2]))
        elif match := re.fullmatch(r"radiance_(\S+)", name):
            found_radiance.append((index, name, match[1].removeprefix("W_m2_sr_"), match[1]))
    for what, found in (("wavelength or wavenumber", found_axis), ("radiance", found_radiance)):
        if len(found) != 1:
            problem = f"{'no' if not found else 'more than one'} {what} column"
            raise InputError(str(path), "header", ",".join(header), problem, f"give {_COLUMNS}")
    x_column, x_name, axis, axis_unit = found_axis[0]
    y_column, y_name, per, y_units = found_radiance[0]
    if axis_unit not in AXES[axis]:
        raise InputError(str(path), x_name, axis_unit, "unknown unit", f"give {_COLUMNS}")
    if per not in SCALE or not y_units.startswith("W_m2_sr_"):
        raise InputError(str(path), y_name, y_units, "unknown unit", f"give {_COLUMNS}")
    return axis, axis_unit, _column(path, rows, x_column, x_name), per, _column(path, rows, y_column, y_name)


def _column(path: Path, rows: list[list[str]], column: int, name: str) -> Array:
    values = np.empty(len(rows) - 1)
    for index, row in enumerate(rows[1:]):
        text = row[column] if column < len(row) else ""
        try:
            values[index] = float(text)
        except ValueError as error:
            raise InputError(
                str(path), name, text, f"not a number at data row {index + 1}", "give plain decimal numbers"
            ) from error
    return values


def _read_netcdf(path: Path) -> tuple[str, str, Array, str, Array]:
    import xarray

    try:
        with xarray.open_dataset(path, engine="h5netcdf", decode_times=False) as data:
            variables = {name: data[name].load() for name in ("wavelength", "wavenumber", "radiance") if name in data}
    except (OSError, ValueError) as error:
        raise InputError(
            str(path), "file", path.name, f"not a NetCDF-4 file ({error})", "give NetCDF-4 or CSV"
        ) from error
    axes = [name for name in AXES if name in variables]
    if len(axes) != 1 or "radiance" not in variables:
        raise InputError(
            str(path), "variables", sorted(variables), "not one axis and one radiance", f"give {_VARIABLES}"
        )
    axis = axes[0]
    shapes = {name: variables[name].shape for name in (axis, "radiance")}
    if len(shapes[axis]) != 1 or shapes["radiance"] != shapes[axis]:
        raise InputError(str(path), "shape", shapes, "not two vectors of one length", f"give {_VARIABLES}")
    units = {name: str(variables[name].attrs.get("units", "")) for name in (axis, "radiance")}
    axis_unit = plain_units(units[axis])
    if axis_unit not in AXES[axis]:
        raise InputError(str(path), f"{axis}.units", units[axis], "unknown unit", f"give {_VARIABLES}")
    per = next((unit for unit in SCALE if plain_units(units["radiance"]) in spellings(unit)), None)
    if per is None:
        raise InputError(str(path), "radiance.units", units["radiance"], "unknown unit", f"give {_VARIABLES}")
    x, y = (np.asarray(variables[name].values, dtype=np.float64) for name in (axis, "radiance"))
    return axis, axis_unit, x, per, y


def plain_units(units: str) -> str:
    """A unit without blanks, brackets and the marks of powers."""
    return re.sub(r"[\s^*()·.]", "", units.replace("µ", "u").replace("μ", "u").replace("1/cm", "cm-1"))


def spellings(unit: str) -> tuple[str, ...]:
    """Ways to write W m⁻² sr⁻¹ per ``unit``, stripped of blanks, brackets and the marks of powers."""
    return f"Wm-2sr-1{unit}-1", f"W/m2/sr/{unit}", f"W/m2sr{unit}", f"Wm-2sr-1/{unit}"
