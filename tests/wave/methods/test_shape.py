"""Edges as line integrals, slopes, and the light that edges scatter: against closed forms."""

import numpy as np
import pytest
from cases import area, cut_pair
from scipy.special import j0, j1

from cgi_wave.errors import InputError
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods.shape import beam_at, edge_of, find_pair, scattered


def lens(d):
    """Area and perimeter common to two unit discs whose centres are d apart."""
    half = np.arccos(0.5 * d)
    return 2.0 * half - d * np.sqrt(1.0 - 0.25 * d**2), 4.0 * half


def test_edge_of_annulus():
    edge = edge_of(HopkinsPair(obscuration=0.3).pupil_fields()[0])
    assert edge.length.sum() == pytest.approx(2.0 * np.pi * 1.3, rel=1e-12)
    assert edge.area == pytest.approx(np.pi * (1.0 - 0.09), rel=1e-12)
    outward = np.sum(edge.u * edge.normal, axis=1) / edge.length
    assert set(np.round(outward, 9)) == {1.0, -0.3}


@pytest.mark.parametrize("d", [0.05, 0.7, 1.9])
def test_edge_of_lens(d):
    pair = find_pair(*HopkinsPair(shift_x=0.8 * d, shift_y=0.6 * d).pupil_fields(), 1.0)
    want = lens(d)
    assert pair.common.area == pytest.approx(want[0], rel=1e-9)
    assert pair.common.length.sum() == pytest.approx(want[1], rel=1e-9)


def test_edge_of_cut_pupil_closes_and_holds_its_area():
    for field in cut_pair():
        edge = edge_of(field)
        assert np.abs(edge.normal.sum(axis=0)).max() < 1e-8  # sixteen points a panel, as bounds of errors ask for
        low, high = area(field.support)
        assert low < edge.area < high


def test_slopes_are_where_rays_land():
    pair = HopkinsPair(w020=3.0, w131=0.7, w111=-1.2, shift_x=0.2)
    beam = beam_at(pair.pupil_fields()[0], 1.0)
    u = np.random.default_rng(2).uniform(-0.6, 0.6, (20, 2))
    for a in (0, 1):
        d = 1e-5 * np.eye(2)[a]
        slope = (pair.wavefront(*(u + d).T) - pair.wavefront(*(u - d).T)) / 2e-5
        assert beam.slope_at(u)[:, a] == pytest.approx(slope, abs=1e-8)


def test_scattered_light_is_that_of_airy():
    """1 − encircled energy = J0² + J1² on a circle; the square around it must hold more, the square inside less."""
    field = HopkinsPair().pupil_fields()[1]
    beam, edge = beam_at(field, 1.0), edge_of(field)
    for reach in (4.0, 11.3, 60.0):
        v = 2.0 * np.pi * reach
        outside = j0(v) ** 2 + j1(v) ** 2
        found = scattered(beam, edge, np.zeros(2), np.full(2, reach))
        # 1.2 is the safety, and a square holds the mean of 1/max(|cos|, |sin|) = 1.11 times more distance
        assert found == pytest.approx(outside * 1.2 / (np.log(1 + np.sqrt(2)) * 4 / np.pi), rel=0.05)
    assert scattered(beam, edge, np.array([2.0, 0.0]), np.array([1.0, 5.0])) == 1.0


def test_refuses_what_does_not_go_together():
    m, l = HopkinsPair().pupil_fields()  # noqa: E741
    with pytest.raises(InputError, match="wavenumber"):
        find_pair(m, l, -1.0)
    assert find_pair(*HopkinsPair(shift_x=2.5).pupil_fields(), 1.0) is None
