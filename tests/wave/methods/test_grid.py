"""Gray cells and the law of their error."""

import numpy as np
import pytest
from cases import PAIRS, cut_pair, quadrature

from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods.fft import overlap_on_window
from cgi_wave.wave.methods.grid import covering, edge_error, edge_law, sampled, shares, steepest_step
from cgi_wave.wave.methods.shape import beam_at, edge_of, find_pair


def test_share_of_a_straight_edge_is_exact():
    m, _ = cut_pair()
    grid = covering(np.array([0.3, -0.2]), np.array([0.8, 0.2]), (0.07, 0.05))
    share = shares([m.support], grid)
    x = grid.axis(0)
    want = np.clip((0.55 - (x - 0.035)) / 0.07, 0.0, 1.0)
    assert share[:, grid.count[1] // 2] == pytest.approx(want, abs=1e-6)


def test_shares_add_up_to_the_area():
    # straight cuts through the parts of a cell leave (curvature) part² / 12 along the edge
    for n in (32, 128):
        field = HopkinsPair(obscuration=0.37).pupil_fields()[1]
        grid = covering(-np.ones(2), np.ones(2), (2.0 / n, 2.0 / n))
        total = shares([field.support], grid).sum() * grid.cell
        assert abs(total / (np.pi * (1 - 0.37**2)) - 1.0) < 4.0 / (n * 8) ** 2


def test_an_edge_that_two_pupils_share_counts_once():
    m, l = HopkinsPair().pupil_fields()  # noqa: E741
    grid = covering(-np.ones(2), np.ones(2), (0.05, 0.05))
    assert shares([m.support, l.support], grid) == pytest.approx(shares([m.support], grid))


def test_edge_law_limits():
    theta = np.array([1e-3, 0.1])
    assert edge_law(theta) == pytest.approx(theta / 8.0, rel=1e-3)
    assert np.all(np.diff(edge_law(np.linspace(0.0, 6.2, 200))) > 0.0)


@pytest.mark.parametrize("offset", [0.0, 0.25, 0.5, 0.9])
def test_edge_law_bounds_an_edge_along_the_grid(offset):
    """One dimension: Σ share exp(iθj) over a long smooth window that ends at an edge, against the integral."""
    for theta in (0.3, 1.5, 3.0, 5.5):
        j = np.arange(-4000, 2)
        window = np.exp(-((j / 900.0) ** 2))
        share = np.clip(offset - (j - 0.5), 0.0, 1.0)
        total = np.sum(share * window * np.exp(1j * theta * j))
        x, w = np.polynomial.legendre.leggauss(40)
        t = np.linspace(-4000.0, offset, 8001)
        middle, half = 0.5 * (t[1:] + t[:-1]), 0.5 * np.diff(t)
        at = middle[:, None] + half[:, None] * x
        exact = np.sum(w * half[:, None] * np.exp(-((at / 900.0) ** 2) + 1j * theta * at))
        assert abs(total - exact) <= edge_law(np.array(theta)) * 1.001


@pytest.mark.parametrize("waves", [1.25, 10.25, 137.3])
def test_defocus_follows_four_pi_thirds_w_over_n_squared(waves):
    pair = find_pair(*HopkinsPair(w020=waves).pupil_fields(), 1.0)
    n = int(16 * waves) + 256  # the law is the leading term of the pupil's curvature and of the phase in a cell
    pitch = (2.0 / n, 2.0 / n)
    exact = np.exp(1j * np.pi * waves) * np.sinc(waves)
    error = abs(overlap_on_window(pair, pitch, n + 2) - exact)
    assert error == pytest.approx(4.0 * np.pi / 3.0 * waves / n**2, rel=0.05)
    # the bound allows for edges along the grid, which triple it
    assert edge_error(pair.m, pair.l, pair.common, pitch) / np.pi == pytest.approx(3.0 * error, rel=0.1)


def test_overlap_breaks_below_four_samples_per_wave():
    pair = find_pair(*HopkinsPair(w020=40.3).pupil_fields(), 1.0)
    exact = np.exp(1j * np.pi * 40.3) * np.sinc(40.3)

    def wrong(n):
        return abs(overlap_on_window(pair, (2.0 / n, 2.0 / n), n + 2) - exact) / abs(exact)

    for n in (180, 200, 250):  # the edge law, and no more
        assert wrong(n) == pytest.approx(4.0 * np.pi / 3.0 * 40.3 / n**2 / abs(exact), rel=0.2)
    assert min(wrong(n) for n in (80, 130, 140, 150)) > 1.5  # replicas of the spot arrive
    steps = steepest_step(pair.m, pair.l, pair.common, (2.0 / 161.2, 2.0 / 161.2))
    assert steps / (2.0 * np.pi) == pytest.approx(1.0, abs=2e-3)  # N = 4 W020 is one turn per cell


@pytest.mark.parametrize("name", PAIRS)
def test_bound_holds_on_any_sampling(name):
    m, l = PAIRS[name].pupil_fields()  # noqa: E741
    pair = find_pair(m, l, 1.0)
    exact, _ = quadrature(m, l)
    lo, hi = pair.box
    for n in (90, 150, 380):
        pitch = tuple((hi - lo) / n)
        bound = edge_error(pair.m, pair.l, pair.common, pitch) / pair.norm
        assert abs(overlap_on_window(pair, pitch, n + 2) - exact) <= bound


def test_bound_holds_for_edges_along_the_grid_and_apodised_beams():
    m, l = cut_pair()  # noqa: E741
    pair = find_pair(m, l, 1.0e6)
    exact, misfit = quadrature(m, l, 1.0e6)
    lo, hi = pair.box
    for n in range(60, 90, 2):  # the edge at x = 0.55 at many places in its cell
        pitch = tuple((hi - lo) / n)
        bound = edge_error(pair.m, pair.l, pair.common, pitch) / pair.norm
        assert abs(overlap_on_window(pair, pitch, n + 2) - exact) <= bound + misfit


def test_samples_carry_the_power():
    m, _ = cut_pair()
    beam, edge = beam_at(m, 1.0e6), edge_of(m)
    grid = covering(edge.u.min(axis=0), edge.u.max(axis=0), (0.01, 0.01))
    power = np.sum(np.abs(sampled(beam, grid, np.sqrt(shares([m.support], grid)))) ** 2) * grid.cell
    assert power == pytest.approx(beam.power, rel=2e-5)
