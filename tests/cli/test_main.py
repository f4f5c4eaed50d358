"""The face: what goes to which stream, with which exit status, and what is left on disk."""

import json
import os
import subprocess
import sys

import pytest

from cgi_wave import __version__
from cgi_wave.cli.main import status
from cgi_wave.errors import CgiWaveError, InputError


@pytest.fixture
def call(capsys, tmp_path, monkeypatch, analysis):
    """Run a command line in an empty folder: (status, standard output, standard error)."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        code = status(arguments)
        streams = capsys.readouterr()
        return code, streams.out, streams.err

    return run


@pytest.mark.parametrize("arguments", [["--help"], ["-h"], ["run", "--help"], ["ghosts", "--help"], ["--version"]])
def test_help_and_version_import_nothing_heavy(arguments):
    script = (
        "import sys; from cgi_wave.cli.main import status; code = status(sys.argv[1:]);"
        "heavy = {'numpy', 'scipy', 'numba', 'matplotlib', 'xarray', 'jinja2'} & set(sys.modules);"
        "sys.exit(f'imported {heavy}' if heavy else code)"
    )
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert ("Usage" in done.stdout) or done.stdout == f"cgi-wave, version {__version__}\n"
    assert done.stderr == ""


def test_every_command_is_in_the_help(call):
    code, out, _ = call("--help")
    assert code == 0
    assert all(f"\n  {name} " in out for name in ("run", "ghosts", "psi", "plan", "draw"))


JSON_CALLS = {
    "run": (["run", "NIR", "--json"], {"bands", "provenance"}),
    "ghosts": (["ghosts", "NIR", "--json"], {"band", "counts", "ghosts", "provenance"}),
    "psi": (["psi", "NIR", "--json"], {"opd_m", "nominal", "with_stray_light", "modulation", "baseline", "nma"}),
    "plan": (["plan", "NIR", "--tolerance", "1e-3", "--json"], {"band", "tolerance", "plan"}),
    "draw": (["draw", "NIR", "--json"], {"band", "file"}),
}


@pytest.mark.parametrize("command", list(JSON_CALLS))
def test_json_is_one_document_on_standard_output(call, command):
    arguments, keys = JSON_CALLS[command]
    code, out, err = call(*arguments)
    assert code == 0, err
    assert keys <= set(json.loads(out))
    if command != "draw":
        assert "field 1 of 2" in err and "chatter" in err


@pytest.mark.parametrize("command", list(JSON_CALLS))
def test_text_keeps_progress_off_standard_output(call, command):
    code, out, err = call(*(argument for argument in JSON_CALLS[command][0] if argument != "--json"))
    assert code == 0, err
    assert out.strip() and "chatter" not in out and "field 1" not in out


def test_run_writes_the_folder_that_it_promises(call, tmp_path):
    code, out, _ = call("run", "VIS", "NIR", "VIS", "--out", "made/here", "--tolerance", "1e-3", "--json")
    assert code == 0
    folder = tmp_path / "made" / "here"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary == json.loads(out)
    assert list(summary["bands"]) == ["VIS", "NIR"]
    for band in summary["bands"].values():
        for row in ("offset_over_baseline", "parasitic_over_modulation", "nma_error"):
            assert {"mean", "spread"} <= set(band[row])
        # Power 0.01 without interference on a baseline of 0.5, and 1 − 1/1.02.
        assert band["offset_over_baseline"]["mean"] == pytest.approx(0.02, abs=1e-4)
        assert band["nma_error"]["mean"] == pytest.approx(1 - 1 / 1.02, abs=1e-4)
        assert (band["ghost_count"], band["fields"]) == (1, 2)
    assert summary["provenance"]["options"] == {
        "bands": ["VIS", "NIR"],
        "instrument": None,
        "tolerance": 1e-3,
        "cross_family": False,
    }
    names = {path.name for path in folder.iterdir()}
    assert {"index.html", "layout.png", "NIR-ghosts.csv", "NIR-ghosts.nc", "NIR-ghosts.mat", "NIR-psi.png"} <= names
    page = (folder / "index.html").read_text()
    assert all(name in page for name in names - {"index.html"})


def test_run_without_a_band_takes_them_all(call):
    assert list(json.loads(call("run", "--json")[1])["bands"]) == ["NIR", "VIS"]


@pytest.mark.parametrize("suffix", [".csv", ".nc", ".mat"])
def test_ghosts_writes_the_format_of_the_suffix(call, tmp_path, suffix):
    code, out, _ = call("ghosts", "NIR", "--out", f"table{suffix}")
    assert (code, out) == (0, "")
    start = {".csv": b"# provenance: {", ".nc": b"\x89HDF", ".mat": b"MATLAB 5.0"}[suffix]
    assert (tmp_path / f"table{suffix}").read_bytes().startswith(start)


@pytest.mark.parametrize(("suffix", "start"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_draw_writes_the_format_of_the_suffix(call, tmp_path, suffix, start):
    assert call("draw", "--out", f"layout{suffix}")[:2] == (0, f"layout{suffix}\n")
    assert (tmp_path / f"layout{suffix}").read_bytes().startswith(start)


REFUSALS = [
    (["run", "UV"], ["BAND", "'UV'", "NIR or VIS"]),
    (["psi", "nir"], ["BAND", "'nir'", "NIR or VIS"]),
    (["run", "--tolerance", "0"], ["--tolerance", "0.0", "above 0"]),
    (["run", "--tolerance", "nan"], ["--tolerance", "nan"]),
    (["run", "--tolerance", "two"], ["--tolerance", "two"]),
    (["run", "--out", "taken"], ["--out", "taken", "is a file", "name a folder"]),
    (["run", "--out", "/proc/cgi-wave"], ["--out", "/proc/cgi-wave", "cannot write"]),
    (["ghosts", "NIR", "--out", "table.xlsx"], ["--out", ".xlsx", ".csv, .nc, .mat"]),
    (["ghosts", "NIR", "--out", "none/table.csv"], ["--out", "none/table.csv", "create none first"]),
    (["draw", "--out", "layout.bmp"], ["--out", "layout.bmp", ".png, .svg, .pdf"]),
    (["ghosts"], ["BAND"]),
    (["flatten"], ["flatten"]),
    (["run", "--colour"], ["--colour"]),
]


@pytest.mark.parametrize(("arguments", "words"), REFUSALS, ids=lambda value: " ".join(value) if value else None)
def test_refused_input_is_named_and_nothing_is_written(call, analysis, tmp_path, arguments, words):
    (tmp_path / "taken").write_text("")

    def analyse(*_):
        pytest.fail("the work started before the refusal")

    analysis.analyse = analyse
    for extra in ([], ["--json"]):
        code, out, err = call(*arguments, *extra)
        assert (code, out) == (2, "")
        assert all(word in err for word in words), err
        assert "Traceback" not in err
    assert os.listdir(tmp_path) == ["taken"]


@pytest.mark.parametrize(
    ("failure", "code", "word"),
    [
        (InputError("a.toml", "bands.NIR.filter", -1, "is negative", "give a width"), 2, "bands.NIR.filter = -1"),
        (CgiWaveError("no rays"), 1, "no rays"),
        (OSError(28, "No space left on device"), 1, "No space left"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
@pytest.mark.parametrize("arguments", [["run", "--json"], ["ghosts", "NIR", "--out", "ghosts.csv"]])
def test_failures_have_their_status_one_message_and_leave_nothing(
    call, analysis, tmp_path, arguments, failure, code, word
):
    def analyse(*_):
        raise failure

    analysis.analyse = analyse
    got, out, err = call(*arguments)
    assert (got, out) == (code, "")
    assert word in err and len(err.strip().splitlines()) == 1
    assert os.listdir(tmp_path) == []


def test_a_failure_while_writing_leaves_the_old_results(call, tmp_path, fields, monkeypatch):
    assert call("run", "NIR")[0] == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    from cgi_wave.report import page

    def fails(_):
        raise CgiWaveError("the page failed")

    monkeypatch.setattr(page, "render", fails)
    assert call("run", "NIR")[0] == 1
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


def test_a_number_that_is_not_finite_is_a_failure_not_a_result(call, analysis, fields, tmp_path):
    analyse = analysis.analyse

    def broken(*arguments):
        result = analyse(*arguments)
        result.bands["NIR"].table1["nma_error"]["mean"] = float("nan")
        return result

    analysis.analyse = broken
    code, out, err = call("run", "NIR", "--json")
    assert (code, out) == (1, "")
    assert "bands.NIR.nma_error.mean" in err
    assert os.listdir(tmp_path) == []
