"""The pieces of the study of Eq. 4: pairs with two aberrated beams, difference of fields, causes, figures."""

import sys
from pathlib import Path

import numpy as np
import pytest

from cgi_wave.wave.hopkins import HopkinsPair, contrast
from cgi_wave.wave.overlap import overlap

sys.path.append(str(Path(__file__).parents[2] / "validation"))

import eq4
import eq4_ghosts
import eq4_page
import eq4_pairs
import eq4_plane
from eq4_pairs import Aberrated

ABERRATED = HopkinsPair(3.0, 0.4, -0.3, 0.7, 0.5)


def test_a_perfect_nominal_beam_is_the_calculators_pair():
    pair = HopkinsPair(3.0, 0.4, -0.3, 0.7, 0.5, 0.2, 0.3, -0.4)
    value, bound = Aberrated(pair, HopkinsPair()).contrast()
    known = contrast(pair, 1e-10)
    assert abs(value - known.value) <= bound + known.error_bound
    assert Aberrated(pair, HopkinsPair()).eq4() == 0.0


def test_like_aberrations_cancel_where_the_pupils_coincide():
    value, bound = Aberrated(ABERRATED, ABERRATED).contrast()
    assert abs(value - 1.0) <= bound + 1e-12
    more = HopkinsPair(3.0 + 1.3, 0.4, -0.3, 0.7, 0.5)
    value, bound = Aberrated(more, ABERRATED).contrast()
    assert abs(abs(value) - abs(np.sinc(1.3))) <= bound + 1e-12


def test_two_aberrated_displaced_beams_agree_with_an_even_sum():
    ghost = HopkinsPair(1.1, 0.2, 0.3, -0.4, 0.2, shift_x=0.3, shift_y=0.5)
    nominal = HopkinsPair(-0.7, 0.5, 0.4, 0.2, -0.3)
    value, _ = Aberrated(ghost, nominal).contrast()
    t = (np.arange(1500) + 0.5) / 750.0 - 1.0  # a grid knows nothing of polynomials about another centre
    x, y = np.meshgrid(t, t)
    lit = (np.hypot(x, y) <= 1.0) & (np.hypot(x - 0.3, y - 0.5) <= 1.0)
    w = ghost.wavefront(x, y) - nominal.wavefront(x, y)
    assert abs(value - np.mean(np.where(lit, np.exp(2j * np.pi * w), 0.0)) * 4.0 / np.pi) < 3e-4


def test_sizes_are_those_of_the_calculator():
    nominal, ghost = Aberrated(HopkinsPair(w020=2.0, w222=1.0), HopkinsPair(w020=0.5)).sizes()
    assert nominal == pytest.approx([0.5, 0.5], rel=2e-3)  # W r²: RMS slope along an axis is W
    assert ghost == pytest.approx([2.0, 3.0], rel=2e-3)
    w040 = eq4_page.diffraction_aberration()
    width = Aberrated(ABERRATED, eq4_plane.nominal(w040)).sizes()[0]
    assert width == pytest.approx([1 / (2 * np.pi)] * 2, rel=5e-3)


def test_estimate_of_a_pair_and_of_its_fields_is_one():
    pair = HopkinsPair(w020=12.0, w222=7.0, shift_x=0.3, shift_y=-0.2)
    of_pair = eq4_plane.compare(Aberrated(pair, HopkinsPair()))
    fields = pair.pupil_fields()
    between = eq4_ghosts.difference(*fields, 1.0)
    shared = overlap(*fields, np.array([1.0]), 1e-8).shared
    law = shared / between.area * np.sqrt(between.directions) / between.blur
    assert law == pytest.approx(of_pair.estimate, rel=0.01)
    assert law == pytest.approx(1.0 / (2.0 * np.pi * np.sqrt(12.0 * 19.0)), rel=0.01)
    assert between.apart == pytest.approx(of_pair.apart, rel=0.02)
    assert of_pair.size == pytest.approx(law, rel=0.2)


def test_rim_of_the_spot_is_at_one():
    """A tilt that brings the stationary point of pure defocus to the rim of the pupil."""
    found = eq4_plane.compare(Aberrated(HopkinsPair(w020=20.0, w111=40.0), HopkinsPair()))
    assert found.apart == pytest.approx(1.0, rel=1e-2)
    far = eq4_plane.compare(Aberrated(HopkinsPair(w020=20.0, w111=60.0), HopkinsPair(w020=0.2)))
    assert far.cause == eq4_plane.APART and far.size < 0.2 * far.estimate


@pytest.mark.parametrize(
    "w040, expected", [(0.03, eq4_plane.FOCUS), (3.0, eq4_plane.ABERRATED)], ids=["perfect", "aberrated"]
)
def test_causes_by_the_nominal_spot(w040, expected):
    beam = eq4_plane.nominal(w040)
    ghost = HopkinsPair(beam.w020 + 30.0, beam.w040, w222=15.0)
    assert eq4_plane.compare(Aberrated(ghost, beam)).cause == expected


def test_zero_of_the_sinc_is_an_oscillation():
    beam = eq4_plane.nominal(eq4_page.diffraction_aberration())
    assert eq4_plane.compare(Aberrated(HopkinsPair(beam.w020 + 5.001, beam.w040), beam)).cause == eq4_plane.BELOW


def test_summary_counts_both_ways():
    found = eq4_plane.summary(np.array([1.0, 1.09, 0.5, 3.5, 0.05]))
    assert found["within_10_percent"] == 0.4 and found["off_by_3"] == 0.4 and found["off_by_10"] == 0.2
    assert found["median_ratio"] == 1.0


def test_study_without_bands(tmp_path):
    found = eq4.study(tmp_path, bands=(), pairs=20, points=6, levels=3)
    assert found["plane"]["bound"] < 1e-8
    assert len(found["plane"]["charts"]) == 15
    assert found["estimate_within_2"] > found["eq4_within_2"]
    assert "nan" not in (tmp_path / "eq4.md").read_text()
    assert (tmp_path / "eq4-charts.png").exists()


def test_spherical_aberration_against_defocus_folds():
    """2 W020 + 12 W040 r² is zero inside the pupil."""
    x, y = eq4_pairs.annulus(0.0)
    assert eq4_pairs.folds(HopkinsPair(w020=3.0, w040=-0.8).powers(), x, y)
    assert not eq4_pairs.folds(HopkinsPair(w020=3.0, w040=0.8).powers(), x, y)
    assert not eq4_pairs.folds(HopkinsPair(w020=3.0, w222=-9.0).powers(), x, y)  # a saddle everywhere
