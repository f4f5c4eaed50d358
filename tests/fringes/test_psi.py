"""The interferogram: oracle, closed forms of spectra, two ports, pixel integration, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from fringe_scenes import PERIOD, PITCH, ROWS, SIGMA0, SLOPE, coherency, direct_sum, lossless_splitter, pair

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.coherency import LeftOut, Pair
from cgi_wave.fringes.psi import belongs, synthesise

ONE = np.ones(1)


def lines_spectrum(samples=20_000, seed=1):
    """A filter with many deep, narrow absorption lines: nothing smooth about it."""
    rng = np.random.default_rng(seed)
    sigma = SIGMA0 + np.linspace(-9e3, 9e3, samples)
    depth = np.zeros(samples)
    for centre in rng.uniform(sigma[0], sigma[-1], 60):
        depth += rng.uniform(0.5, 3.0) / (1.0 + ((sigma - centre) / 10.0) ** 2)
    return sigma, np.exp(-depth) * np.exp(-(((sigma - SIGMA0) / 3.5e3) ** 2))


def random_coherency(ghosts=8, seed=2, nodes=9):
    rng = np.random.default_rng(seed)
    at = chebyshev.nodes(nodes, SIGMA0 - 9.001e3, SIGMA0 + 9.001e3)
    x = (at - SIGMA0) / 9e3
    beams = 2 + ghosts
    t = np.concatenate([[0.23, 0.22], rng.uniform(1e-5, 1e-3, ghosts)])
    pairs = []
    for m in range(beams):
        for l in range(m + 1, beams):  # noqa: E741
            gamma = rng.uniform(0.1, 0.7) * np.exp(1j * (rng.uniform(0, 6) + 0.7 * x + 0.3 * x**2)) * (1 - 0.2 * x)
            opd = rng.uniform(-9e-3, 9e-3) + 4e-6 * x + 3e-7 * x**2
            pairs.append(Pair(m, l, at, gamma, np.full(nodes, 1e-6), opd, rng.uniform(-3, 3) * SLOPE, "random"))
    return coherency(t, [0, 0, *range(1, ghosts + 1)], pairs)


def test_equals_the_direct_sum_of_every_term():
    sigma, weight = lines_spectrum()
    coh, y = random_coherency(), ROWS[::30]
    psi = synthesise(coh, sigma, weight, ROWS, row_height_m=PITCH)
    for book in (psi.nominal, psi.paper, psi.coherent):
        power = coh.transmission[:2].sum() if book.bookkeeping == "nominal" else coh.transmission.sum()
        oracle = power + direct_sum(coh, sigma, weight, y, PITCH, lambda p, b=book.bookkeeping: belongs(p.m, p.l, b))
        worst = np.abs(book.irradiance[::30] - oracle).max()
        assert worst < 1e-9 * psi.nominal.irradiance.mean()
        assert worst < book.numerical_error < 1e-7
    assert psi.spectral_nodes < len(sigma) / 10
    assert psi.row_nodes < len(ROWS) / 10


def test_error_adds_the_contrast_bounds_of_the_pairs_that_are_in():
    sigma, weight = lines_spectrum()
    coh = random_coherency()
    psi = synthesise(coh, sigma, weight, ROWS)
    for book in (psi.nominal, psi.paper, psi.coherent):
        inside = [p for p in coh.pairs if belongs(p.m, p.l, book.bookkeeping)]
        bound = sum(2.0 * np.sqrt(coh.transmission[p.m] * coh.transmission[p.l]) * 1e-6 for p in inside)
        assert book.contrast_error == pytest.approx(bound, rel=1e-12)
        assert book.error == book.contrast_error + book.sampling_error + book.numerical_error
        assert book.unbounded == 0
    # and the bound holds when every γ is moved by it
    moved = [replace(p, gamma=p.gamma + 1e-6 * np.exp(1j * p.m)) for p in coh.pairs]
    other = synthesise(coherency(coh.transmission, coh.family, moved), sigma, weight, ROWS)
    difference = np.abs(other.coherent.irradiance - psi.coherent.irradiance).max()
    assert 0.0 < difference <= psi.coherent.error


def two_beams(opd, slope=SLOPE, gamma=1.0):
    return coherency([0.25, 0.25], [0, 0], [pair(0, 1, gamma, opd, slope)])


def visibility(psi):
    """(max − min)/(max + min) over rows: the NMA of slow envelopes."""
    i = psi.nominal.irradiance
    return (i.max() - i.min()) / (i.max() + i.min())


# very fine rows over one fringe near the field point: the envelope is at its value there to 1e-6
FINE = np.linspace(-0.5, 0.5, 4001) * PERIOD


@pytest.mark.parametrize("opd", [2e-5, 1e-4, 2.4e-4])
def test_gaussian_line_has_a_gaussian_envelope(opd):
    width = 2.0e3  # FWHM, 1/m
    sigma = SIGMA0 + np.linspace(-5 * width, 5 * width, 4001)
    weight = np.exp(-4.0 * np.log(2.0) * ((sigma - SIGMA0) / width) ** 2)
    psi = synthesise(two_beams(opd), sigma, weight, FINE)
    expected = np.exp(-((np.pi * width * opd) ** 2) / (4.0 * np.log(2.0)))
    assert visibility(psi) == pytest.approx(expected, rel=5e-3 * opd / 1e-4)  # the envelope's slope over half a fringe
    phase = 2.0 * np.pi * SIGMA0 * (opd + SLOPE * FINE[2000])
    assert psi.nominal.irradiance[2000] == pytest.approx(0.5 * (1.0 + expected * np.cos(phase)), abs=1e-10)


@pytest.mark.parametrize("cycles", [0.3, 0.9, 1.0, 2.6])
def test_box_filter_has_a_sinc_envelope(cycles):
    width = 4.0e3
    sigma = SIGMA0 + np.linspace(-0.5, 0.5, 2001) * width
    opd = cycles / width
    psi = synthesise(two_beams(opd), sigma, np.ones(2001), np.array([0.0]))
    expected = 0.5 * (1.0 + np.sinc(width * opd) * np.cos(2.0 * np.pi * SIGMA0 * opd))
    # the filter's edges leave the trapezoid an error of second order in the step, which the sampling error covers
    assert abs(psi.nominal.irradiance[0] - expected) < psi.nominal.error < 1e-5


def test_single_wavenumber_and_row_integration():
    opd = 12.34e-6
    for height in (0.0, 20e-6, 150e-6):
        psi = synthesise(two_beams(opd), np.array([SIGMA0]), ONE, ROWS, row_height_m=height)
        damped = np.sinc(height / PERIOD)
        expected = 0.5 * (1.0 + damped * np.cos(2.0 * np.pi * SIGMA0 * (opd + SLOPE * ROWS)))
        np.testing.assert_allclose(psi.nominal.irradiance, expected, atol=1e-11)
    np.testing.assert_allclose(psi.opd_m, opd + SLOPE * ROWS, rtol=1e-14)


def test_row_integration_is_the_mean_over_the_row_for_a_broad_band():
    sigma = SIGMA0 + np.linspace(-2e5, 2e5, 801)
    weight = np.exp(-(((sigma - SIGMA0) / 5e4) ** 2))
    height = 0.3e-3
    whole = synthesise(two_beams(3e-6), sigma, weight, np.array([0.1e-3]), row_height_m=height)
    x, w = np.polynomial.legendre.leggauss(40)
    points = synthesise(two_beams(3e-6), sigma, weight, 0.1e-3 + 0.5 * height * x)
    assert whole.nominal.irradiance[0] == pytest.approx(0.5 * w @ points.nominal.irradiance, abs=1e-12)


@pytest.mark.parametrize("reflectance", [0.5, 0.42])
def test_two_ports_of_a_lossless_splitter_sum_to_the_input_at_every_opd(reflectance):
    t, r, r_back = lossless_splitter(reflectance)
    assert abs(t * np.conj(r) + np.conj(t) * r_back) < 1e-15
    detector, entrance = np.array([t * r_back, r * t]), np.array([r * r, t * t])
    sigma, weight = lines_spectrum(4000)
    total = 0.0
    for port in (detector, entrance):
        gamma = np.exp(1j * np.angle(port[0] * np.conj(port[1])))
        coh = coherency(np.abs(port) ** 2, [0, 0], [pair(0, 1, gamma, 1.33e-3, SLOPE)])
        total = total + synthesise(coh, sigma, weight, ROWS, PITCH).nominal.irradiance
    np.testing.assert_allclose(total, 1.0, atol=1e-12)


def test_sampling_error_covers_the_grid():
    """The spectral sum on a coarse grid, against a fine one, within the bound; and a tenth of a bound is not enough."""
    coh, y = two_beams(1.0e-3), ROWS[::10]

    def on(samples):
        sigma = SIGMA0 + np.linspace(-6e3, 6e3, samples)
        return synthesise(coh, sigma, np.exp(-(((sigma - SIGMA0) / 3e3) ** 2)) / (1 + ((sigma - SIGMA0) / 70) ** 2), y)

    fine, coarse = on(24_001).nominal, on(161).nominal
    assert 1e-4 < np.abs(coarse.irradiance - fine.irradiance).max() < coarse.error
    assert fine.error < 1e-9


def test_book_keepings_count_their_pairs():
    t = [0.25, 0.25, 1e-3, 4e-3]
    pairs = [pair(0, 1, 1.0, 0.0, SLOPE), pair(0, 2, 0.5, 0.0), pair(2, 3, 0.25, 0.0)]
    out = [LeftOut(0, 3, 1e-5, "small"), LeftOut(1, 2, 2e-5, "small")]
    psi = synthesise(coherency(t, [0, 0, 1, 1], pairs, out), np.array([SIGMA0]), ONE, ROWS)
    ghost_nominal, ghost_ghost = 2.0 * np.sqrt(0.25e-3) * 0.5, 2.0 * np.sqrt(4e-6) * 0.25
    added = psi.paper.irradiance - psi.nominal.irradiance
    np.testing.assert_allclose(added, 5e-3 + ghost_nominal, atol=1e-14)
    np.testing.assert_allclose(psi.coherent.irradiance - psi.paper.irradiance, ghost_ghost, atol=1e-14)
    assert (psi.nominal.left_out, psi.paper.left_out, psi.coherent.left_out) == pytest.approx((0.0, 3e-5, 3e-5))
    assert (psi.nominal.unbounded, psi.paper.unbounded, psi.coherent.unbounded) == (0, 1, 1)


def test_refuses_a_spectral_step_that_would_alias():
    sigma = SIGMA0 + np.linspace(-5e3, 5e3, 101)
    weight = np.exp(-(((sigma - SIGMA0) / 1e3) ** 2))
    limit = 1.0 / (4.0 * 100.0)
    synthesise(two_beams(0.9 * limit), sigma, weight, ROWS)
    with pytest.raises(MethodLimitError, match=r"1/\(4 OPD\)") as caught:
        synthesise(two_beams(3.0 * limit), sigma, weight, ROWS)
    assert caught.value.factor == pytest.approx(3.0, rel=1e-2)


def test_step_limit_takes_the_group_opd():
    at = chebyshev.nodes(5, SIGMA0 - 5e3, SIGMA0 + 5e3)
    opd = 1e-3 + 2e-3 * (at - SIGMA0) / SIGMA0  # phase 1 mm, group 3 mm
    coh = coherency([0.25, 0.25], [0, 0], [Pair(0, 1, at, np.ones(5, complex), np.zeros(5), opd, SLOPE, "")])
    sigma = SIGMA0 + np.arange(-5e3, 5e3, 1.0 / (4 * 2e-3))
    with pytest.raises(MethodLimitError):
        synthesise(coh, sigma, np.exp(-(((sigma - SIGMA0) / 1e3) ** 2)), ROWS)


def test_refuses_contrasts_that_miss_the_spectrum():
    at = chebyshev.nodes(7, SIGMA0 - 2e3, SIGMA0 + 2e3)
    coh = coherency([0.25, 0.25], [0, 0], [pair(0, 1, 1.0, 1e-4, SLOPE, sigma=at)])
    sigma = SIGMA0 + np.linspace(-8e3, 8e3, 3001)
    with pytest.raises(MethodLimitError, match="outside the pairs' range"):
        synthesise(coh, sigma, np.exp(-(((sigma - SIGMA0) / 3e3) ** 2)), ROWS)
    # a tail of 2e-6 is let go, and the error says so
    psi = synthesise(coh, sigma, np.exp(-(((sigma - SIGMA0) / 0.6e3) ** 2)), ROWS)
    assert 1e-6 < psi.nominal.numerical_error < 1e-5
    whole = synthesise(two_beams(1e-4), sigma, np.exp(-(((sigma - SIGMA0) / 0.6e3) ** 2)), ROWS)
    assert np.abs(whole.nominal.irradiance - psi.nominal.irradiance).max() <= psi.nominal.error


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"weight": np.array([1.0, np.nan, 1.0])}, "weight"),
        ({"weight": np.zeros(3)}, "weight"),
        ({"weight": np.ones(2)}, "sigma, weight"),
        ({"sigma": np.array([3.0, 2.0, 1.0])}, "sigma"),
        ({"y_m": np.array([1.0, 0.0])}, "y_m"),
        ({"row_height_m": -1.0}, "row_height_m"),
    ],
)
def test_refuses_broken_input(change, field):
    good = {"sigma": SIGMA0 + np.arange(3.0), "weight": np.ones(3), "y_m": ROWS, "row_height_m": 0.0}
    with pytest.raises(InputError) as caught:
        synthesise(two_beams(1e-5), **{**good, **change})
    assert caught.value.field == field


def test_refuses_doubled_and_missing_pairs():
    sigma = np.array([SIGMA0])
    twice = [pair(0, 1, 1.0, 0.0, SLOPE), pair(1, 0, 1.0, 0.0, SLOPE)]
    with pytest.raises(InputError, match="twice"):
        synthesise(coherency([0.25, 0.25], [0, 0], twice), sigma, ONE, ROWS)
    with pytest.raises(InputError, match="nominal pair"):
        synthesise(coherency([0.25, 0.25], [0, 0], [], [LeftOut(0, 1, 0.1, "")]), sigma, ONE, ROWS)


def test_left_out_pairs_count_where_their_fringes_fall():
    """Plain sums within two families, squares over families; a pair without fringes is the baseline's, not M's."""
    t = (0.25, 0.25, 0.01, 0.01, 0.01, 0.01)
    out = (
        LeftOut(2, 3, 3e-5, "", frequency=1.0),
        LeftOut(2, 4, 4e-5, "", frequency=0.0),
        LeftOut(3, 4, 4e-5, "", frequency=0.1),
        LeftOut(4, 5, 1e-5, ""),
    )
    made = coherency(t, (0, 0, 1, 1, 2, 3), [pair(0, 1, 1.0, 1e-4, SLOPE)], out)
    whole = synthesise(made, np.array([SIGMA0]), ONE, ROWS).coherent
    leak = 0.08
    assert whole.left_out == pytest.approx(np.sqrt(3e-5**2 + (leak * 8e-5) ** 2 + 1e-5**2))
    assert whole.left_out_baseline == pytest.approx(np.sqrt((leak * 3e-5) ** 2 + 8e-5**2 + 1e-5**2))
    assert whole.left_out_bound == pytest.approx(12e-5)
