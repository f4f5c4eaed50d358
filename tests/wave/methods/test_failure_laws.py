"""The laws that the study of failures draws, against what they predict."""

import sys
from pathlib import Path

import numpy as np
import pytest
from cases import quadrature

sys.path.insert(0, str(Path(__file__).parents[3] / "validation"))

from failures_maps import Map, edge_term

from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods.fft import overlap_on_window
from cgi_wave.wave.methods.shape import find_pair


def test_edge_term_of_defocus():
    # ∮ 2π · 2W dl around the unit circle; a 24th of it, (2/N)² / π, is the 4π/3 · W/N² of the gray edge
    terms = edge_term(HopkinsPair(w020=3.3))
    assert abs(terms[0] + terms[1]) == pytest.approx(8.0 * np.pi**2 * 3.3, rel=1e-9)


@pytest.mark.parametrize(
    "pair", [HopkinsPair(w020=2.3, w131=1.7, shift_x=0.4, obscuration=0.3), HopkinsPair(w222=6.3, w040=1.1)]
)
def test_edge_term_predicts_the_error_itself(pair):
    found = find_pair(*pair.pupil_fields(), 1.0)
    exact, _ = quadrature(*pair.pupil_fields())
    lo, hi = found.box
    n = 420
    pitch = (hi - lo) / n
    error = overlap_on_window(found, tuple(pitch), n + 2) - exact
    terms = edge_term(pair)
    predicted = (terms[0] * pitch[0] ** 2 + terms[1] * pitch[1] ** 2) / 24.0 / found.norm
    # an edge contributes 1/(iθ), of which the sum lacks θ²/24: it is off by +iθ/24
    assert error == pytest.approx(1j * predicted, rel=0.25)


def test_agreement_counts_points_on_the_right_side():
    error = np.array([[1.0, 1.0], [1e-6, 1.0], [np.nan, 1e-6]])
    drawn = Map("", "", "x", [0.0, 1.0], "y", [1.0, 2.0, 3.0], error, {"law": np.array([1.5, 1.5])})
    assert drawn.agreement == pytest.approx(4.0 / 5.0)
