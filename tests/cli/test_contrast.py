"""The calculator: its numbers are those of closed forms, its document is what is promised, bad input is named."""

import json

import numpy as np
import pytest

from cgi_wave.cli.main import status


@pytest.fixture
def call(capsys):
    def run(*arguments):
        code = status(["contrast", *arguments])
        streams = capsys.readouterr()
        return code, streams.out, streams.err

    return run


def test_document_of_pure_defocus(call):
    code, out, _ = call("W020=10.25", "--json")
    found = json.loads(out)
    assert code == 0
    assert set(found) == {"contrast", "magnitude", "error_bound", "method", "seconds", "eq4"}
    value = complex(*found["contrast"])
    assert abs(value - np.exp(1j * np.pi * 10.25) * np.sinc(10.25)) <= found["error_bound"] <= 1e-8
    assert found["magnitude"] == pytest.approx(abs(value))
    assert found["eq4"] == 0.0


def test_two_perfect_beams_are_alike(call):
    code, out, _ = call("--json")
    found = json.loads(out)
    assert code == 0
    assert found["contrast"] == pytest.approx([1.0, 0.0], abs=1e-12)
    assert found["eq4"] is None  # 0/0


@pytest.mark.parametrize("method", ["boundary", "panels", "fft", "chirp-z", "nufft", "fresnel"])
def test_every_method_by_name(call, method):
    tol = "1e-8" if method in ("boundary", "panels") else "0.05"
    code, out, _ = call("W020=1.25", "--shift", "0.3,0", "--tol", tol, "--method", method, "--json")
    _, exact, _ = call("W020=1.25", "--shift", "0.3,0", "--tol", "1e-10", "--json")
    found, true = json.loads(out), json.loads(exact)
    assert code == 0
    error = abs(complex(*found["contrast"]) - complex(*true["contrast"]))
    assert error <= found["error_bound"] + true["error_bound"]
    assert found["error_bound"] <= float(tol) * 1.000001


@pytest.mark.parametrize(
    "arguments, field",
    [
        (["W020=nan"], "w020"),
        (["W020=ten"], "W020"),
        (["W021=1"], "W021=1"),
        (["W020=1", "w020=2"], "w020=2"),
        (["--obscuration", "1"], "obscuration"),
        (["--shift", "1"], "--shift"),
        (["--shift", "1,x"], "--shift"),
        (["--shift", "inf,0"], "shift_x"),
        (["W020=3", "--tol", "1e-17"], "tol"),
        (["--method", "guess"], "method"),
    ],
)
def test_bad_input_is_named_and_refused(call, arguments, field):
    code, out, err = call(*arguments)
    assert code == 2
    assert out == ""
    assert field in err


def test_a_method_outside_its_range_refuses_with_a_factor(call):
    code, out, err = call("W020=3000", "--method", "fft", "--tol", "1e-3")
    assert code == 1
    assert out == ""
    assert "exceeded" in err
    assert "times" in err


def test_text_says_what_eq4_is(call):
    code, out, _ = call("W020=2", "W111=0.5", "--obscuration", "0.2")
    assert code == 0
    assert "Eq. 4" in out
    assert "error bound" in out


def test_validate_lists_the_studies_and_refuses_others(capfd):
    assert status(["validate"]) == 0
    assert "contrast" in capfd.readouterr().out
    assert status(["validate", "nothing"]) == 2
    assert "contrast" in capfd.readouterr().err
    assert status(["validate", "contrast", "--", "--help"]) == 0
    assert "--cases" in capfd.readouterr().out
