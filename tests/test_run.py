"""The main job end to end: real rays of the reference instrument, and a few of its ghosts to keep it quick."""

import csv
import io
import json
import os
from contextlib import redirect_stderr, redirect_stdout
from types import SimpleNamespace

import pytest
import xarray
from scipy.io import loadmat

import cgi_wave
from cgi_wave import analysis
from cgi_wave.cli.main import status
from cgi_wave.optics.system import REFERENCE

ROWS = ("offset_over_baseline", "parasitic_over_modulation", "nma_error")
PICTURES = {"layout.png", *(f"NIR-{kind}.png" for kind in ("psi", "contrast", "spots", "psfs"))}
TABLES = {f"NIR-ghosts{suffix}" for suffix in (".csv", ".nc", ".mat")} | {"NIR-surfaces.csv", "NIR-families.csv"}


def a_few(system, paths, *_):
    """Nominal beams, the detector's four retro-ghosts, a plate's ghost, and the two strongest of second order."""
    first = [path for path in paths if path.label.startswith("detector:r arms") or path.label == "plate1_back:r arms 1"]
    second = sorted((path for path in paths if path.order == 2), key=lambda path: -path.estimate)[:2]
    return (*paths[:2], *(path for path in first if path.order == 1), *second)


def call(*arguments):
    """Exit status, standard output, standard error of a command line."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = status(arguments)
    return code, out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "made"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(analysis, "select_ghosts", a_few)
        code, out, err = call("run", "NIR", "--out", str(folder), "--tolerance", "1e-3", "--json")
    assert code == 0, err
    return SimpleNamespace(folder=folder, out=out, err=err)


@pytest.fixture(scope="module")
def ghosts(run):
    with (run.folder / "NIR-ghosts.csv").open(encoding="utf-8", newline="") as file:
        assert file.readline().startswith("# provenance: {")
        return list(csv.DictReader(file))


def test_standard_output_is_the_summary_and_nothing_else(run):
    assert json.loads(run.out) == json.loads((run.folder / "summary.json").read_text(encoding="utf-8"))
    assert "field point 5 of 5" in run.err


def test_summary_has_its_fields(run):
    summary = json.loads(run.out)
    band = summary["bands"]["NIR"]
    for row in ROWS:
        assert {"mean", "spread", "error"} <= set(band[row])
    assert (band["ghost_count"], band["fields"]) == (7, 5)
    assert set(band["why_rows"]) == set(ROWS) <= set(band["printed"])
    provenance = summary["provenance"]
    assert {"version", "instrument", "options", "libraries"} <= set(provenance)


def test_detector_ghost_and_plate_give_the_offset_that_their_coatings_allow(run):
    band = json.loads(run.out)["bands"]["NIR"]
    plate, detector = 0.005 / 2, 0.05 * 0.95**2
    # Coherently between ρτ²/4 (refocused) and ρτ²/2 (powers added), and the plate's R/2; second order below 0.5 %
    assert detector / 4 < band["offset_over_baseline"]["mean"] < detector / 2 + plate + 0.005
    paper = band["paper_bookkeeping"]["offset_over_baseline"]["mean"]
    assert detector / 2 + plate == pytest.approx(paper, abs=0.005)
    assert band["offset_over_baseline"]["mean"] < paper


def test_folder_holds_every_file_and_the_page_names_them(run):
    names = {path.name for path in run.folder.iterdir()}
    assert names == PICTURES | TABLES | {"summary.json", "index.html", "NIR-psi.json"}
    page = (run.folder / "index.html").read_text(encoding="utf-8")
    assert all(name in page for name in names - {"index.html"})
    assert all((run.folder / name).read_bytes().startswith(b"\x89PNG") for name in PICTURES)
    psi = json.loads((run.folder / "NIR-psi.json").read_text(encoding="utf-8"))
    assert [len(field["opd_m"]) == len(field["with_stray_light"]) for field in psi["fields"]] == [True] * 5


def test_what_surfaces_cost_adds_up_to_table_1(run):
    with (run.folder / "NIR-surfaces.csv").open(encoding="utf-8", newline="") as file:
        assert file.readline().startswith("# provenance: {")
        rows = list(csv.DictReader(file))
    assert {"detector", "plate1_back"} <= {row["name"] for row in rows}
    band = json.loads(run.out)["bands"]["NIR"]
    for column, row in (("share_offset", "offset_over_baseline"), ("share_nma", "nma_error")):
        assert sum(float(line[column]) for line in rows) == pytest.approx(band[row]["mean"], rel=1e-9)


def test_ghosts_of_both_orders_have_contrasts_bounds_and_eq4(ghosts):
    assert {row["order"] for row in ghosts} == {"1", "2"}
    for row in ghosts:
        contrast, error, eq4 = (float(row[key]) for key in ("contrast", "contrast_error", "contrast_eq4"))
        assert 0.0 < error < 1e-3 and error < contrast < 1.0, row["label"]
        assert 0.0 < eq4 < 1.0
        assert float(row["transmission"]) > 0.0 and row["method"]


def test_tables_agree(run, ghosts):
    labels = [row["label"] for row in ghosts]
    read = xarray.load_dataset(run.folder / "NIR-ghosts.nc", engine="h5netcdf")
    assert read["label"].values.tolist() == labels
    assert read["transmission"].values.tolist() == [float(row["transmission"]) for row in ghosts]
    members = loadmat(run.folder / "NIR-ghosts.mat", simplify_cells=True)["ghosts"]
    assert list(members["label"]) == labels


def test_paths_in_the_table_are_taken_back(ghosts):
    system = cgi_wave.load_instrument().band("NIR")
    for row in ghosts:
        path = cgi_wave.parse_path(system, row["path"])
        assert (str(path), path.order, path.splits) == (row["path"], int(row["order"]), int(row["ancestry"]))


TEXT = REFERENCE.read_text(encoding="utf-8")
BROKEN = {
    "not TOML": ("[space", "[[space", "TOML"),
    "unknown glass": ('filter = "silica"', 'filter = "silicon"', "silicon"),
    "not a number": ("thickness_mm = 24.478", "thickness_mm = nan", "nan"),
    "missing arm": ("[channel.VISNIR.interferometer.arm2]", "[channel.VISNIR.interferometer.arm3]", "arm"),
}


@pytest.mark.parametrize("name", list(BROKEN))
def test_a_broken_instrument_is_refused_before_anything_is_written(tmp_path, name):
    old, new, word = BROKEN[name]
    assert old in TEXT
    file = tmp_path / "broken.toml"
    file.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    refused(tmp_path, ["run", "--instrument", str(file)], [str(file), word])


def test_what_the_command_line_gets_wrong_is_refused(tmp_path):
    refused(tmp_path, ["run", "UV"], ["BAND", "'UV'", "NIR"])
    refused(tmp_path, ["run", "--instrument", str(tmp_path / "none.toml")], ["none.toml"])


def refused(folder, arguments, words):
    before = sorted(os.listdir(folder))
    code, out, err = call(*arguments, "--out", str(folder / "made"), "--json")
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1 and all(word in err for word in words), err
    # File, field and value before the problem; what would do after it.
    assert " = " in err and "; " in err
    assert sorted(os.listdir(folder)) == before


def test_a_folder_that_cannot_be_written_is_refused():
    code, out, err = call("run", "NIR", "--out", "/proc/cgi-wave", "--json")
    assert (code, out) == (2, "") and "--out" in err and len(err.strip().splitlines()) == 1
