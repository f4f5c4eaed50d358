"""Tables of ghosts on disk: CSV, NetCDF and .mat from the same rows.

A row is a dict; all rows have the same keys. A value is a number, a complex number, a string, None (not computed) or a
list of numbers, one per field point. The last word of a name is its unit (``rms_x_m`` in metres, ``tilt_rad`` in
radians); a number whose name ends in no unit is dimensionless.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cgi_wave.errors import CgiWaveError, InputError
from cgi_wave.report.output import to_json

Row = Mapping[str, Any]

UNITS = {"_per_m": "m-1", "_m": "m", "_rad": "rad", "_s": "s"}
"""Suffix of a column's name to its unit, longest first; SI only."""

NOT_COMPUTED = "NaN where the quantity was not computed"


def unit(name: str) -> str:
    """Unit of a column by the end of its name: "m", "rad", …; "1" for a dimensionless number."""
    return next((symbol for suffix, symbol in UNITS.items() if name.endswith(suffix)), "1")


def columns(rows: Sequence[Row]) -> dict[str, np.ndarray]:
    """One array per key: (ghost,) or, for values that are lists, (ghost, field). None becomes NaN, or "".

    Raises CgiWaveError when rows differ in their keys, or lists of one column in their lengths.
    """
    if not rows:
        return {}
    names = list(rows[0])
    for index, row in enumerate(rows):
        if list(row) != names:
            raise CgiWaveError(f"row {index} of the table has the columns {list(row)}, row 0 has {names}")
    return {name: _column(name, [row[name] for row in rows]) for name in names}


def write_ghosts(path: str | Path, rows: Sequence[Row], provenance: Mapping[str, Any], suffix: str) -> None:
    """Write the table to ``path`` in the format that ``suffix`` names (see ``WRITERS``).

    ``path`` and ``suffix`` are apart since ``path`` may be the temporary name of a file to come.
    """
    WRITERS[check_suffix(suffix)](Path(path), columns(rows), provenance)


def check_suffix(suffix: str, field: str = "--out") -> str:
    """The suffix in lower case; InputError when no writer has it."""
    if suffix.lower() not in WRITERS:
        remedy = f"end the file's name in one of {', '.join(WRITERS)}"
        raise InputError("command line", field, suffix, "is not a format for tables", remedy)
    return suffix.lower()


def _column(name: str, values: list[Any]) -> np.ndarray:
    if any(isinstance(value, str) for value in values):
        if not all(value is None or isinstance(value, str) for value in values):
            raise CgiWaveError(f"column {name} of the table mixes words and numbers")
        return np.array(["" if value is None else value for value in values], dtype=str)
    lengths = {np.size(value) for value in values if np.ndim(value)}
    if len(lengths) > 1 or (lengths and any(np.ndim(value) == 0 for value in values)):
        raise CgiWaveError(f"column {name} of the table has lists of different lengths: {sorted(lengths)}")
    if lengths:
        return np.array([[np.nan if item is None else item for item in value] for value in values])
    return np.array([np.nan if value is None else value for value in values])


def _write_csv(path: Path, table: Mapping[str, np.ndarray], provenance: Mapping[str, Any]) -> None:
    """First line: ``# provenance: {…}``. Lists spread over columns ``name[0]``…, complex numbers over ``re``, ``im``.

    Numbers are written so that reading gives back the same double; an empty cell was not computed.
    """
    flat: dict[str, np.ndarray] = {}
    for name, values in table.items():
        parts = {name: values} if values.ndim == 1 else {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}
        for title, part in parts.items():
            if np.iscomplexobj(part):
                flat |= {f"re {title}": part.real, f"im {title}": part.imag}
            else:
                flat[title] = part
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(f"# provenance: {json.dumps(json.loads(to_json(provenance)), ensure_ascii=False)}\n")
        writer = csv.writer(file)
        writer.writerow(flat)
        writer.writerows(zip(*(_cells(values) for values in flat.values()), strict=True))


def _cells(values: np.ndarray) -> list[str]:
    return ["" if value != value else str(value) for value in values.tolist()]


def _write_netcdf(path: Path, table: Mapping[str, np.ndarray], provenance: Mapping[str, Any]) -> None:
    """Dimensions ``ghost`` and ``field``; every number carries ``units``; provenance as a JSON attribute."""
    import h5netcdf
    import h5py

    with h5netcdf.File(path, "w") as file:
        file.attrs.update({"title": "ghosts", "provenance": to_json(provenance)})
        for name, values in table.items():
            dimensions = ("ghost", "field")[: values.ndim]
            file.dimensions.update(
                {d: n for d, n in zip(dimensions, values.shape, strict=True) if d not in file.dimensions}
            )
            words = values.dtype.kind == "U"
            variable = file.create_variable(name, dimensions, h5py.string_dtype() if words else values.dtype)
            variable[...] = values.astype(object) if words else values
            if not words:
                variable.attrs["units"] = unit(name)
            if values.dtype.kind in "fc" and np.isnan(values).any():
                variable.attrs["comment"] = NOT_COMPUTED


def _write_mat(path: Path, table: Mapping[str, np.ndarray], provenance: Mapping[str, Any]) -> None:
    """A struct ``ghosts`` with one N × 1 (or N × fields) member per column; strings as cells; provenance as JSON."""
    from scipy.io import savemat

    members = {}
    for name, values in table.items():
        column = values.astype(object) if values.dtype.kind == "U" else values
        members[name] = column[:, None] if column.ndim == 1 else column
    document = {"ghosts": members, "provenance": to_json(provenance)}
    savemat(path, document, appendmat=False, long_field_names=True, do_compression=True)


WRITERS = {".csv": _write_csv, ".nc": _write_netcdf, ".mat": _write_mat}
