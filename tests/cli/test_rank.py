"""The command ``rank``: what it hands on, what it prints and writes, what it refuses before any work."""

import csv
import json
import sys
from types import ModuleType

import pytest

import cgi_wave
from cgi_wave.cli.main import status
from cgi_wave.ranking import Ranking

ROW = {
    "remedy": "filter_front", "kind": "surface", "change": "R 0.05 to 0.025", "nma_error_before": 0.1,
    "nma_error_after": 0.08, "nma_error_after_error": 0.02, "gain": 0.02, "gain_error": 0.005, "gain_guess": 0.015,
    "guess_excess": -0.005, "gain_tangent": 0.0199, "tangent_excess": -1e-4, "offset_after": 0.07,
    "modulation_after": -0.01, "transmission_before": 0.4, "transmission_after": 0.41, "spot_before_m": 3.2e-6,
    "spot_after_m": 3.3e-6, "fringes_before": 10.0, "fringes_after": 9.98, "nma_before": 0.39, "nma_after": 0.39,
    "method": "rescaled", "surfaces": "filter_front", "reason": "",
}  # fmt: skip
REFUSED = {key: None if value is not None and key.endswith(("after", "gain", "error", "m")) else value
           for key, value in ROW.items()} | {
    "remedy": "cube", "change": "1° about x", "gain_guess": None, "gain_tangent": None, "spot_before_m": 3.2e-6,
    "method": "traced again", "reason": "too steep",
}  # fmt: skip


@pytest.fixture
def call(capsys, tmp_path, monkeypatch, costs):
    """Run a command line in an empty folder with a stand-in for the work; ``call.asked`` is what it was asked for."""
    monkeypatch.chdir(tmp_path)
    module = ModuleType("cgi_wave.ranking")

    def rank_remedies(instrument, band, target, moves, fields, tolerance, progress):
        progress("1 of 2 traced again")
        run.asked = (target, moves, fields, tolerance)
        return Ranking(band, 1, costs, [ROW, ROW | {"gain": 1e-3, "remedy": "lens"}, REFUSED], {"M": "why"}, 1.5)

    module.rank_remedies = rank_remedies
    monkeypatch.setitem(sys.modules, "cgi_wave.ranking", module)
    monkeypatch.setattr(cgi_wave, "ranking", module, raising=False)

    def run(*arguments):
        code = status(arguments)
        streams = capsys.readouterr()
        return code, streams.out, streams.err

    run.asked = None
    return run


def test_text_has_both_tables_in_per_cent_and_marks_what_is_not_sure(call):
    code, out, err = call("rank", "NIR")
    assert (code, err) == (0, "1 of 2 traced again\n")
    lines = {line.split()[0]: line for line in out.splitlines() if line.strip()}
    assert "+8.000" in lines["filter_front"] and "+2.000 " in lines["filter_front"] and "3.30" in lines["filter_front"]
    assert "+0.100?" in lines["lens"]
    assert "cube, 1° about x: too steep" in out and "M: no better coating tried, why" in out
    assert call.asked[1] is None and call.asked[2] == "centre" and call.asked[0].factor == 0.5


def test_json_is_one_document(call):
    code, out, _ = call("rank", "NIR", "--json", "--field", "all", "--coating-value", "0.0025", "--no-moves")
    document = json.loads(out)
    assert code == 0
    assert {"band", "surfaces", "families", "total", "remedies", "unimproved", "provenance"} <= set(document)
    assert document["remedies"][0]["gain"] == 0.02 and document["remedies"][2]["gain"] is None
    assert document["provenance"]["options"]["coating_value"] == 0.0025
    assert call.asked[0].value == 0.0025 and call.asked[1] == [] and call.asked[2] == "all"


def test_table_on_disk_has_units_in_its_columns_and_provenance(call, tmp_path):
    assert call("rank", "NIR", "--out", "ranking.csv")[0] == 0
    with (tmp_path / "ranking.csv").open(encoding="utf-8", newline="") as file:
        assert file.readline().startswith("# provenance: {")
        rows = list(csv.DictReader(file))
    assert rows[0]["spot_after_m"] == "3.3e-06" and rows[2]["gain"] == "" and rows[2]["reason"] == "too steep"


def test_moves_of_the_command_line_name_parts_of_the_instrument(call):
    words = ["--tilt", "filter=0.5,-0.2", "--shift", "focal=0.1",
             "--set", "filter_back.thickness_mm=2,focal.start_mm=-4.4282"]  # fmt: skip
    assert call("rank", "NIR", *words)[0] == 0
    tilted, shifted, valued = call.asked[1]
    assert (tilted.surfaces, tilted.tilt_deg) == (("filter_front", "filter_back"), (0.5, -0.2))
    assert (len(shifted.surfaces), shifted.shift_mm) == (3, 0.1)
    assert valued.values == {"filter_back.thickness_mm": 2.0, "focal.start_mm": -4.4282}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["UV"], ["BAND", "UV"]),
        (["NIR", "--tilt", "filtre=1"], ["filtre", "no surface, space or frame"]),
        (["NIR", "--tilt", "filter"], ["--tilt", "filter=0.5"]),
        (["NIR", "--tilt", "filter=1,2,3"], ["--tilt", "filter=0.5"]),
        (["NIR", "--shift", "filter=far"], ["--shift", "far", "not a number"]),
        (["NIR", "--shift", "filter=nan"], ["--shift", "nan"]),
        (["NIR", "--set", "filter_front.weight=1"], ["filter_front.weight"]),
        (["NIR", "--coating-factor", "1"], ["coating factor", "1.0"]),
        (["NIR", "--coating-value", "2"], ["coating value", "2.0"]),
        (["NIR", "--no-moves", "--tilt", "filter=1"], ["--no-moves", "contradicts"]),
        (["NIR", "--out", "ranking.nc"], ["--out", ".csv"]),
        (["NIR", "--field", "edge"], ["--field", "edge"]),
    ],
)
def test_what_cannot_be_done_is_refused_before_the_work(call, tmp_path, words, said):
    code, out, err = call("rank", *words)
    assert (code, out, call.asked) == (2, "", None)
    assert all(word in err for word in said), err
    assert list(tmp_path.iterdir()) == []
