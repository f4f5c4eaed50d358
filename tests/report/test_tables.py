"""What goes into a table comes back from it, bit for bit, with its units."""

import csv
import json

import numpy as np
import pytest
import xarray
from scipy.io import loadmat

from cgi_wave.errors import CgiWaveError, InputError
from cgi_wave.report import tables

PROVENANCE = {"version": "0", "options": {"tolerance": 1e-4}, "instrument": "σ.toml"}
ROWS = [
    {
        "path": "L1 > filter.front, r > detector",
        "order": 1,
        "transmission": 0.1 + 0.2,
        "rms_x_m": 1.2345678901234567e-5,
        "tilt_rad": 1e-3,
        "gamma": 0.25 - 1j / 3,
        "contrast_error": None,
        "contrast_fields": [0.1, 1 / 3],
    },
    {
        "path": "L2",
        "order": 2,
        "transmission": 5e-324,
        "rms_x_m": 1.0,
        "tilt_rad": -2.0,
        "gamma": 1 + 0j,
        "contrast_error": 1e-7,
        "contrast_fields": [None, 1.0],
    },
]


def write(folder, suffix, rows=ROWS):
    path = folder / f"ghosts{suffix}"
    tables.write_ghosts(path, rows, PROVENANCE, suffix)
    return path


def test_csv_gives_back_the_same_doubles(tmp_path):
    first, *rest = write(tmp_path, ".csv").read_text(encoding="utf-8").splitlines()
    assert json.loads(first.removeprefix("# provenance: ")) == PROVENANCE
    read = list(csv.DictReader(rest))
    assert [row["path"] for row in read] == [row["path"] for row in ROWS]
    for row, original in zip(read, ROWS, strict=True):
        for name in ("order", "transmission", "rms_x_m", "tilt_rad"):
            assert float(row[name]) == original[name]
        assert complex(float(row["re gamma"]), float(row["im gamma"])) == original["gamma"]
    assert read[0]["order"] == "1"
    assert [row["contrast_error"] for row in read] == ["", "1e-07"]
    assert [row["contrast_fields[0]"] for row in read] == ["0.1", ""]
    assert float(read[0]["contrast_fields[1]"]) == 1 / 3


def test_netcdf_has_dimensions_units_and_complex_numbers(tmp_path):
    read = xarray.load_dataset(write(tmp_path, ".nc"), engine="h5netcdf")
    assert dict(read.sizes) == {"ghost": 2, "field": 2}
    assert read["path"].values.tolist() == [row["path"] for row in ROWS]
    for name, symbol in {"order": "1", "transmission": "1", "rms_x_m": "m", "tilt_rad": "rad", "gamma": "1"}.items():
        assert read[name].values.tolist() == [row[name] for row in ROWS]
        assert read[name].attrs["units"] == symbol
    assert read["order"].dtype.kind == "i" and read["gamma"].dtype == np.complex128
    np.testing.assert_array_equal(read["contrast_error"], [np.nan, 1e-7])
    assert read["contrast_error"].attrs["comment"] == tables.NOT_COMPUTED
    np.testing.assert_array_equal(read["contrast_fields"], [[0.1, 1 / 3], [np.nan, 1.0]])
    assert read["contrast_fields"].dims == ("ghost", "field")
    assert json.loads(read.attrs["provenance"]) == PROVENANCE


def test_mat_struct_has_columns_as_columns(tmp_path):
    read = loadmat(write(tmp_path, ".mat"), simplify_cells=False)
    ghosts = read["ghosts"][0, 0]
    assert set(ghosts.dtype.names) == set(ROWS[0])
    assert [cell.item() for cell in ghosts["path"][:, 0]] == [row["path"] for row in ROWS]
    for name in ("order", "transmission", "rms_x_m", "gamma"):
        assert ghosts[name].shape == (2, 1)
        assert ghosts[name][:, 0].tolist() == [row[name] for row in ROWS]
    np.testing.assert_array_equal(ghosts["contrast_fields"], [[0.1, 1 / 3], [np.nan, 1.0]])
    assert json.loads(read["provenance"].item()) == PROVENANCE


def test_a_missing_word_is_empty():
    assert tables.columns([{"method": "panels"}, {"method": None}])["method"].tolist() == ["panels", ""]


@pytest.mark.parametrize("suffix", list(tables.WRITERS))
def test_a_table_without_ghosts_is_still_a_table(tmp_path, suffix):
    assert write(tmp_path, suffix, rows=[]).stat().st_size > 0


@pytest.mark.parametrize(
    "rows",
    [
        [{"a": 1}, {"b": 1}],
        [{"a": 1}, {"a": "one"}],
        [{"a": [1, 2]}, {"a": [1]}],
        [{"a": [1, 2]}, {"a": 1}],
    ],
)
def test_rows_that_do_not_match_are_refused(rows):
    with pytest.raises(CgiWaveError, match="table"):
        tables.columns(rows)


def test_unknown_format_names_those_that_exist():
    with pytest.raises(InputError, match=r"\.csv, \.nc, \.mat"):
        tables.check_suffix(".xlsx")
    assert tables.check_suffix(".NC") == ".nc"
