"""Coatings given as tables over wavelength and angle of incidence: read, checked, and made smooth.

A table's angles are those in the thinner of the two media that its face parts (in air, for a face of glass), on
whichever side the light is: Snell's law carries the others there. Between its points it is a cubic spline in wavelength
and in 1 − cos θ, in which a coating is smooth at normal incidence; outside of them it says nothing.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError

if TYPE_CHECKING:
    from cgi_wave.optics.schema import CoatingSpec

Array = NDArray[np.float64]

#: Columns of a table's file, or fields of it in the instrument file.
GRIDS = ("reflectance", "transmittance", "reflectance_s", "reflectance_p", "transmittance_s", "transmittance_p")
AXES = ("wavelengths_nm", "angles_deg")
#: How far a spline may pass below 0 or above 1 between the points of a table: rounding, not ringing.
RINGING = 1e-6
#: R + T may miss 1 by this much and still count as lossless.
LOSSLESS = 1e-9


@dataclass(frozen=True)
class Film:
    """A table at one wavelength: knots (A,) of u = 1 − cos θ and the cubic (A, 4) behind each, highest power first."""

    knot: Array
    r: Array
    t: Array

    def at(self, u: Array) -> tuple[Array, Array]:
        """R and T at u = 1 − cos θ within the knots."""
        k = np.clip(np.searchsorted(self.knot, u, side="right") - 1, 0, len(self.knot) - 2)
        step = u - self.knot[k]
        r, t = (((p[k, 0] * step + p[k, 1]) * step + p[k, 2]) * step + p[k, 3] for p in (self.r, self.t))
        return r, t


@dataclass(frozen=True, eq=False)
class CoatingTable:
    """Reflectance and transmittance r, t (L, A), unpolarised, over wavelength (L,), m, and u = 1 − cos θ (A,).

    s, p: R and T of both polarisations, (2, L, A), or None if the table does not part them.
    """

    file: str
    name: str
    wavelength: Array
    u: Array
    r: Array
    t: Array
    s: Array | None
    p: Array | None

    @lru_cache(maxsize=256)  # noqa: B019  (a table lives as long as its instrument)
    def film(self, sigma: float, polarisation: str = "") -> Film:
        """The table at wavenumber sigma (1/m), for "s", "p" or unpolarised light ("").

        Raises InputError outside its wavelengths, and where its spline leaves the range from 0 to 1.
        """
        from scipy.interpolate import CubicSpline

        self.covers(sigma)
        grids = {"": (self.r, self.t), "s": self.s, "p": self.p}[polarisation]
        assert grids is not None  # asked for only where the table parts them
        # Rounding of 1/σ may put the first or last wavelength just outside.
        nm = float(np.clip(1.0 / sigma, self.wavelength[0], self.wavelength[-1]))
        pieces, sums = [], 0.0
        fine = (self.u[:-1, None] + np.diff(self.u)[:, None] * np.linspace(0, 1, 17)).ravel()
        for grid in grids:
            spline = CubicSpline(self.u, CubicSpline(self.wavelength, grid, axis=0)(nm))
            value = spline(fine)
            sums = sums + value
            worst = float(max(-value.min(), np.max(sums) - 1.0))
            if worst > RINGING:
                raise InputError(self.file, f"coating.{self.name}.table", worst,
                                 f"leaves the range from 0 to 1 by that much between its points at {1e9 * nm:.2f} nm",
                                 "give it more angles or wavelengths there")  # fmt: skip
            cubic = np.zeros((len(self.u), 4))
            cubic[:-1, 4 - spline.c.shape[0] :] = spline.c.T
            cubic[-1, 3] = value[-1]  # behind the last knot only rounding lies
            pieces.append(cubic)
        return Film(self.u, pieces[0], pieces[1])

    def covers(self, sigma: float) -> None:
        """Raises InputError if the table does not hold the wavelength."""
        low, high = self.wavelength[0], self.wavelength[-1]
        if not low * (1 - 1e-12) <= 1.0 / sigma <= high * (1 + 1e-12):
            raise InputError(self.file, f"coating.{self.name}.table.wavelengths_nm", 1e9 / sigma,
                             f"the table goes from {1e9 * low:g} to {1e9 * high:g} nm",
                             "extend it, or set another coating for this band")  # fmt: skip

    def most(self, sigma: float) -> tuple[float, float]:
        """Largest R and T over the table's angles."""
        film = self.film(sigma)
        r, t = film.at(np.linspace(film.knot[0], film.knot[-1], 65))
        return float(r.max()), float(t.max())

    @property
    def lossless(self) -> bool:
        """Whether R + T = 1 throughout."""
        return bool(np.abs(self.r + self.t - 1.0).max() < LOSSLESS)


def coating_table(name: str, coating: CoatingSpec, file: str) -> CoatingTable | None:
    """The table of a coating, checked, or None if it has none. Raises InputError."""
    table = coating.table
    if table is None:
        return None

    def refuse(field: str, value: object, problem: str, remedy: str) -> NoReturn:
        raise InputError(file, f"coating.{name}.table.{field}", value, problem, remedy)

    if table.wavelengths_nm is None or table.angles_deg is None:
        if table.file is not None:
            refuse("file", table.file, "has not been read", "load the instrument from its file")
        missing = AXES[0] if table.wavelengths_nm is None else AXES[1]
        refuse(missing, None, "is missing", "give wavelengths_nm, angles_deg and reflectance, or a file")
    wavelength, angle = np.array(table.wavelengths_nm), np.array(table.angles_deg)
    for field, axis, low, high in ((AXES[0], wavelength, 1e-3, 1e9), (AXES[1], angle, 0.0, 90.0)):
        if len(axis) < 2 or not np.all(np.diff(axis) > 0) or axis[0] < low or axis[-1] > high:
            refuse(
                field, axis.tolist(), "do not rise, or are less than two", f"give at least two from {low:g} to {high:g}"
            )
    grids: dict[str, Array] = {}
    for field in GRIDS:
        rows = getattr(table, field)
        if rows is not None:
            shape = {len(row) for row in rows}
            if len(rows) != len(wavelength) or shape != {len(angle)}:
                problem = f"is no grid of {len(wavelength)} wavelengths by {len(angle)} angles"
                refuse(field, (len(rows), sorted(shape)), problem, "give one row per wavelength, one number per angle")
            grids[field] = np.array(rows)
            if grids[field].min() < 0.0 or grids[field].max() > 1.0:
                refuse(field, float(grids[field].max()), "leaves the range from 0 to 1", "give shares of power")
    plain, parted = "reflectance" in grids, {"reflectance_s", "reflectance_p"} <= set(grids)
    if plain == parted:
        refuse("reflectance", sorted(grids), "is given not at all, twice, or for one polarisation",
               "give reflectance, or reflectance_s and reflectance_p")  # fmt: skip

    def pair(suffix: str) -> Array:
        r = grids["reflectance" + suffix]
        t = grids.get("transmittance" + suffix, np.maximum(1.0 - r - table.absorptance, 0.0))
        if (r + t).max() > 1.0 + LOSSLESS:
            refuse("transmittance" + suffix, float((r + t).max()), "is R + T above 1", "mend R or T")
        return np.array([r, t])

    s, p = (None, None) if plain else (pair("_s"), pair("_p"))
    r, t = pair("") if s is None or p is None else 0.5 * (s + p)
    return CoatingTable(file, name, 1e-9 * wavelength, 1.0 - np.cos(np.radians(angle)), r, t, s, p)


def read_tables(document: dict[str, Any], path: Path) -> None:
    """Put what coating files (CSV or NPZ beside the instrument file) hold into the plain document, in place.

    CSV: a header of wavelength_nm, angle_deg and names of ``GRIDS``, one line per point of a whole grid. NPZ: arrays of
    the names that stand in the instrument file. Raises InputError.
    """
    coatings = document.get("coating")
    for name, coating in coatings.items() if isinstance(coatings, dict) else ():
        table = coating.get("table") if isinstance(coating, dict) else None
        if isinstance(table, dict) and isinstance(table.get("file"), str):
            field = f"coating.{name}.table.file"
            given = [key for key in (*AXES, *GRIDS) if key in table]
            if given:
                raise InputError(str(path), field, table["file"], f"stands beside {given[0]}", "give one of them")
            table.update(_read(path.parent / table["file"], str(path), field))


def _read(source: Path, file: str, field: str) -> dict[str, Any]:
    try:
        if source.suffix.lower() == ".npz":
            with np.load(source, allow_pickle=False) as arrays:
                return {key: arrays[key].tolist() for key in arrays.files}
        if source.suffix.lower() == ".csv":
            with source.open(newline="", encoding="utf-8") as lines:
                return _grid(list(csv.DictReader(line for line in lines if not line.startswith("#"))))
    except (OSError, ValueError, KeyError, TypeError) as error:
        problem = f"cannot be read as a table ({error})"
        raise InputError(file, field, str(source), problem, "see docs/instrument.md for its columns") from error
    raise InputError(file, field, str(source), "is neither .csv nor .npz", "name a file of one of them")


def _grid(rows: list[dict[str, str]]) -> dict[str, Any]:
    """Lines of points as axes and grids."""
    unknown = set(rows[0] if rows else {}) - {*GRIDS, "wavelength_nm", "angle_deg"}
    if not rows or unknown:
        raise ValueError(f"unknown columns: {', '.join(sorted(unknown))}" if unknown else "no lines")
    points = {(float(row["wavelength_nm"]), float(row["angle_deg"])): row for row in rows}
    wavelengths, angles = (sorted({point[axis] for point in points}) for axis in (0, 1))
    if len(points) != len(rows) or len(points) != len(wavelengths) * len(angles):
        raise ValueError(
            f"{len(rows)} lines are no whole grid of {len(wavelengths)} wavelengths by {len(angles)} angles"
        )
    grids = {
        name: [[float(points[w, a][name]) for a in angles] for w in wavelengths] for name in GRIDS if name in rows[0]
    }
    return {"wavelengths_nm": wavelengths, "angles_deg": angles, **grids}
