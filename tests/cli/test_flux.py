"""The command ``flux``: its document closes, its file is whole, it refuses what makes no walk."""

import json
from pathlib import Path

import pytest

from cgi_wave.cli.main import status
from cgi_wave.kernels.walk import SLICE
from cgi_wave.rays import flux as walk

TRIPLET = str(Path(__file__).parents[1] / "data" / "cooke_triplet.toml")


@pytest.fixture
def call(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        code = status(["flux", "green", "--instrument", TRIPLET, *arguments])
        streams = capsys.readouterr()
        return code, streams.out, streams.err

    return run


def test_document_closes_and_names_what_made_it(call):
    code, out, _ = call("--rays", "3000", "--seed", "5", "--json")
    found = json.loads(out)
    assert code == 0
    assert sum(found["sums"].values()) == pytest.approx(1.0, abs=1e-14) and found["imbalance"] == 0
    assert found["rays"] == found["provenance"]["options"]["rays"] == 3000
    assert found["provenance"]["options"]["seed"] == 5
    assert found["paths"][0]["path"] == "S1 S2 S3 S4 S5 S6"
    assert len(found["map"]["irradiance"]) == 64


def test_the_file_holds_the_same_and_the_screen_the_sums(call):
    code, out, _ = call("--rays", "500", "--analog", "--direction", "0,0.5", "--out", "flux.json")
    found = json.loads(Path("flux.json").read_text())
    assert code == 0
    assert found["split"] is None and found["radiance"] is None
    assert f"{found['sums']['detector']:.12f}" in out and "closes to the last unit" in out
    assert found["source"].startswith("direction 0, 0.0087")
    assert [path.name for path in Path().iterdir()] == ["flux.json"]


def test_an_interrupted_walk_leaves_nothing(call, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(walk, "walk_rays", stop)
    code, out, err = call("--rays", str(3 * SLICE), "--out", "flux.json")
    assert code == 130 and out == "" and "interrupted" in err
    assert list(Path().iterdir()) == []


def test_progress_goes_to_standard_error(call, monkeypatch):
    monkeypatch.setattr(walk, "PAUSE", 0.0)
    code, out, err = call("--rays", str(SLICE + 1), "--json", "--lambertian", "20")
    assert code == 0
    assert json.loads(out)["source"] == "Lambertian within 20 deg"
    assert err.splitlines() == [f"green: {SLICE} of {SLICE + 1} rays", f"green: {SLICE + 1} of {SLICE + 1} rays"]


@pytest.mark.parametrize(
    "arguments, field",
    [
        (["--rays", "0"], "rays"),
        (["--split", "-1"], "options"),
        (["--split", "nan"], "options"),
        (["--lambertian", "100"], "half angle"),
        (["--lambertian", "10", "--direction", "0,0"], "--lambertian"),
        (["--direction", "1"], "--direction"),
        (["--out", "flux.csv"], "--out"),
    ],
)
def test_bad_input_is_named_and_refused(call, arguments, field):
    code, out, err = call(*arguments)
    assert code == 2 and out == "" and field in err
