"""Files are whole or absent, refusals come before the work, and JSON is strict."""

import json
import os
import signal
import stat

import numpy as np
import pytest

from cgi_wave.errors import CgiWaveError, InputError
from cgi_wave.report import output


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_file_appears_whole_with_the_suffix_kept_and_ordinary_permissions(tmp_path):
    target = tmp_path / "ghosts.csv"
    with output.whole_file(target) as temporary:
        assert temporary.suffix == ".csv"
        temporary.write_text("half")
        assert not target.exists()
        temporary.write_text("whole")
    assert target.read_text() == "whole"
    assert names(tmp_path) == ["ghosts.csv"]
    umask = os.umask(0)
    os.umask(umask)
    assert stat.S_IMODE(target.stat().st_mode) == 0o666 & ~umask


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt])
def test_failed_file_leaves_the_old_one_and_nothing_else(tmp_path, failure):
    target = tmp_path / "ghosts.csv"
    target.write_text("old")
    with pytest.raises(failure), output.whole_file(target) as temporary:
        temporary.write_text("half")
        raise failure
    assert target.read_text() == "old"
    assert names(tmp_path) == ["ghosts.csv"]


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt])
def test_failed_folder_leaves_nothing_at_all(tmp_path, failure):
    target = tmp_path / "a" / "b"
    with pytest.raises(failure), output.whole_folder(target) as stage:
        (stage / "one.txt").write_text("1")
        raise failure
    assert names(tmp_path) == []


def test_folder_appears_with_its_parents(tmp_path):
    target = tmp_path / "a" / "b"
    with output.whole_folder(target) as stage:
        (stage / "one.txt").write_text("1")
        assert not target.exists()
    assert names(target) == ["one.txt"]
    assert names(tmp_path) == ["a"] and names(tmp_path / "a") == ["b"]


def test_existing_folder_keeps_what_is_not_ours(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "summary.json").write_text("old")
    with output.whole_folder(tmp_path) as stage:
        (stage / "summary.json").write_text("new")
        (stage / "NIR").mkdir()
        (stage / "NIR" / "psi.csv").write_text("1")
        assert (tmp_path / "summary.json").read_text() == "old"
    assert names(tmp_path) == ["NIR", "notes.txt", "summary.json"]
    assert (tmp_path / "summary.json").read_text() == "new"
    assert (tmp_path / "NIR" / "psi.csv").read_text() == "1"
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_summary_is_absent_while_files_of_two_runs_are_mixed(tmp_path, monkeypatch):
    (tmp_path / "summary.json").write_text("old")
    seen = []
    replace = os.replace

    def watched(source, place):
        seen.append((place.name, (tmp_path / "summary.json").exists()))
        replace(source, place)

    monkeypatch.setattr(output.os, "replace", watched)
    with output.whole_folder(tmp_path) as stage:
        for name in ("summary.json", "a.csv", "z.csv"):
            (stage / name).write_text("new")
    assert seen == [("a.csv", False), ("z.csv", False), ("summary.json", False)]


def test_interrupt_during_the_move_waits_for_its_end(tmp_path, monkeypatch):
    replace = os.replace

    def interrupted(source, place):
        signal.raise_signal(signal.SIGINT)
        replace(source, place)

    monkeypatch.setattr(output.os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt), output.whole_folder(tmp_path) as stage:
        for name in ("a.csv", "b.csv"):
            (stage / name).write_text("new")
    assert names(tmp_path) == ["a.csv", "b.csv"]


def test_refusals_name_the_place_before_any_work(tmp_path):
    (tmp_path / "file").write_text("")
    cases = [
        (output.whole_file, tmp_path, "is a folder"),
        (output.whole_file, tmp_path / "none" / "a.csv", "does not exist"),
        (output.whole_folder, tmp_path / "file", "is a file"),
        (output.whole_folder, tmp_path / "file" / "under", "is a file"),
        (output.whole_folder, "/proc/cgi-wave/out", "cannot write"),
        (output.whole_file, "/proc/ghosts.csv", "cannot write"),
    ]
    for writer, target, problem in cases:
        with pytest.raises(InputError, match=problem) as refused, writer(target):
            pytest.fail("the work started")
        assert refused.value.field == "--out"
        assert refused.value.value == str(target)
    assert names(tmp_path) == ["file"]


def test_json_has_only_json_types():
    document = {"z": np.array([1 + 2j]), "n": np.float64(0.5), "i": np.int64(3), "t": (True, None), "s": "σ"}
    assert json.loads(output.to_json(document)) == {
        "z": [[1.0, 2.0]],
        "n": 0.5,
        "i": 3,
        "t": [True, None],
        "s": "σ",
    }


@pytest.mark.parametrize("bad", [float("nan"), np.inf, complex(0, float("nan"))])
def test_json_refuses_what_is_not_finite_and_says_where(bad):
    with pytest.raises(CgiWaveError, match=r"bands\.NIR\[1\]"):
        output.to_json({"bands": {"NIR": [1.0, bad]}})


def test_provenance_is_json_and_names_every_library():
    made = output.provenance("instrument.toml", "abc", {"tolerance": 1e-4})
    assert json.loads(output.to_json(made)) == made
    assert set(made["libraries"]) == set(output.LIBRARIES)
    assert made["time"].endswith("+00:00")
