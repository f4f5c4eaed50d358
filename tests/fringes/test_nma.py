"""M, B, NMA: recovery from known interferograms, the closed forms of retro-ghosts, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from fringe_scenes import PERIOD, PITCH, ROWS, SIGMA0, SLOPE, coherency, pair, retro_family
from scipy.special import j1

from cgi_wave.errors import MethodLimitError
from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.coherency import LeftOut, Pair
from cgi_wave.fringes.nma import nma_error_exact, nma_error_linear, retrieve
from cgi_wave.fringes.psi import Interferogram, Psi, synthesise

MONO = np.array([SIGMA0]), np.ones(1)
DETECTOR, PASS = 0.05, 0.95  # reflectance of the detector, transmission of the filter per pass


def psi_of(coh, rows=ROWS):
    return synthesise(coh, *MONO, rows)


def made(nominal, with_ghosts, rows=ROWS, error=0.0, ghost_error=0.0):
    """A Psi from two known curves."""

    def book(name, values, bound):
        return Interferogram(name, values, bound, 0.0, bound, 0.0, 0.0, 0.0, 0.0, 0.0, 0)

    total = book("coherent", with_ghosts, error + ghost_error)
    return Psi(rows, SLOPE * rows, SIGMA0, SLOPE, 0.0, book("nominal", nominal, error),
               replace(total, bookkeeping="paper"), total, 1, 1)  # fmt: skip


@pytest.mark.parametrize("opd", [0.0, 1.33e-3, 1.33e-3 + 0.3e-6])
def test_detector_retro_ghost_in_focus(opd):
    """N + ρτ² N(1 − N): a mean of ρτ²/4 of B, no fringe at the nominal frequency, all of it at twice that."""
    power = DETECTOR * PASS**2
    psi = psi_of(retro_family(opd, power))
    phase = 2.0 * np.pi * SIGMA0 * (opd + SLOPE * ROWS)
    expected = 0.5 * (1.0 + np.cos(phase))
    np.testing.assert_allclose(psi.nominal.irradiance, expected, atol=1e-9)
    np.testing.assert_allclose(psi.coherent.irradiance, expected + power * expected * (1.0 - expected), atol=1e-9)

    result = retrieve(psi)
    ghost = result.coherent
    assert ghost.offset_over_baseline.value == pytest.approx(power / 4.0, rel=1e-9)
    assert abs(ghost.parasitic_over_modulation.value) < 1e-10
    assert abs(ghost.quadrature_over_modulation) < 1e-10
    assert ghost.second_over_modulation == pytest.approx(power / 4.0, rel=1e-9)
    loss = (power / 4.0) / (1.0 + power / 4.0)  # the NMA falls by 1.1 %
    assert ghost.nma_error.value == pytest.approx(loss, rel=1e-9)
    assert ghost.nma_error.value == pytest.approx(0.0112, abs=2e-4)
    # powers added without interference: twice the offset, a loss of 2.2 %
    assert result.paper.offset_over_baseline.value == pytest.approx(power / 2.0, rel=1e-9)
    assert result.paper.nma_error.value == pytest.approx(0.0221, abs=2e-4)


def test_wrong_splitter_phase_turns_the_sign():
    """Both reflections taken alike give N²: baseline +3.4 %, NMA +1.1 %."""
    power = DETECTOR * PASS**2
    result = retrieve(psi_of(retro_family(1.33e-3, power, wrong_phase=True)))
    ghost = result.coherent
    assert ghost.offset_over_baseline.value == pytest.approx(0.75 * power, rel=1e-9)
    assert ghost.parasitic_over_modulation.value == pytest.approx(power, rel=1e-9)
    assert ghost.nma_error.value == pytest.approx(-0.011, abs=3e-4)


@pytest.mark.parametrize(
    ("distance", "offset", "modulation"), [(1e-5, None, None), (0.2e-3, 0.0128, -0.0007), (2e-3, 0.0265, -0.028)]
)
def test_filter_face_at_a_distance_from_the_detector(distance, offset, modulation):
    """O/B = (R/2)(1 − J/2), M*/M = −(R/2)(1 − J), J the pupil's mean of the phase between the two mirror visits."""
    reflectance, f_number = 0.05, 4.0
    # the retro-reflected cone returns through mirror points 2·distance·angle away: mean over the disc, by quadrature
    radius, weight = np.polynomial.legendre.leggauss(60)
    radius, weight = np.sqrt(0.5 * (radius + 1.0)), 0.5 * weight  # uniform in area
    azimuth = 2.0 * np.pi * (np.arange(128) + 0.5) / 128
    shift = 2.0 * distance * radius[:, None] * np.sin(azimuth) / (2.0 * f_number)
    shear = complex(weight @ np.exp(2j * np.pi * shift / PERIOD).mean(axis=1))
    z = 2.0 * np.pi * (distance / f_number) / PERIOD
    j = 2.0 * j1(z) / z
    assert shear == pytest.approx(j, abs=1e-10)

    ghost = retrieve(psi_of(retro_family(1.33e-3, reflectance, shear=shear))).coherent
    assert ghost.offset_over_baseline.value == pytest.approx(reflectance / 2 * (1 - j / 2), rel=1e-9)
    assert ghost.parasitic_over_modulation.value == pytest.approx(-reflectance / 2 * (1 - j), abs=1e-9)
    if offset is not None:
        assert ghost.offset_over_baseline.value == pytest.approx(offset, abs=6e-5)
        assert ghost.parasitic_over_modulation.value == pytest.approx(modulation, abs=6e-4)


@pytest.mark.parametrize("slope", [2 * SLOPE, 3 * SLOPE])
def test_ghost_at_the_nominal_frequency_is_projected_on_the_nominal_phase(slope):
    lag, t = 0.7, 1e-4
    coh = coherency(
        [0.25, 0.25, t], [0, 0, 1],
        [pair(0, 1, 1.0, 1e-5, SLOPE), pair(0, 2, 0.3 * np.exp(1j * lag), 1e-5, SLOPE), pair(1, 2, 0.3, 3e-3, slope)],
    )  # fmt: skip
    result = retrieve(psi_of(coh))
    part = 2.0 * np.sqrt(0.25 * t) * 0.3 / 0.5
    # fringes at twice the frequency are fitted apart; at three times they reach M* through the drift term, a little
    known = 1e-9 if slope == 2 * SLOPE else 0.01 * part
    for book in (result.paper, result.coherent):
        shift = abs(book.parasitic_over_modulation.value - part * np.cos(lag))
        assert shift < known
        assert shift <= max(book.parasitic_over_modulation.error, 1e-9)
        assert book.quadrature_over_modulation == pytest.approx(part * np.sin(lag), abs=known)
        assert book.offset_over_baseline.value == pytest.approx(t / 0.5, abs=known)
        assert book.nma == pytest.approx(book.modulation / book.baseline)


@pytest.mark.parametrize("rows", [ROWS, ROWS[:431], ROWS + 3e-4])
def test_recovers_known_terms_with_drift_and_second_harmonic(rows):
    """Ten fringes and a fraction: drift and second harmonic do not leak into B and M."""
    centre = 0.5 * (rows[0] + rows[-1])
    theta = 2.0 * np.pi * (rows - centre) / PERIOD
    fringes = int((np.ptp(rows) + PITCH) / PERIOD * (1 + 1e-9))
    u = (rows - centre) / (0.5 * fringes * PERIOD)
    nominal = 0.5 + 0.02 * u + 0.21 * np.cos(theta + 0.4) + 0.01 * np.cos(2 * theta - 1.0)
    ghosts = 0.015 - 0.003 * u - 0.004 * np.cos(theta + 0.4) + 0.006 * np.sin(2 * theta)
    result = retrieve(made(nominal, nominal + ghosts, rows))
    fit, ghost = result.nominal, result.coherent
    assert fit.fringes == fringes
    assert (fit.baseline.value, fit.modulation.value) == pytest.approx((0.5, 0.21), rel=1e-12)
    assert (fit.phase, fit.drift, fit.second) == pytest.approx((0.4, 0.02, 0.01), rel=1e-10)
    assert fit.nma.value == pytest.approx(0.42, rel=1e-12)
    assert ghost.offset_over_baseline.value == pytest.approx(0.03, rel=1e-12)
    assert ghost.parasitic_over_modulation.value == pytest.approx(-0.004 / 0.21, rel=1e-12)
    assert ghost.nma_error.value == pytest.approx(1 - (1 - 0.004 / 0.21) / 1.03, rel=1e-10)
    assert ghost.nma_error_linear.value == pytest.approx(0.03 + 0.004 / 0.21, rel=1e-10)


def test_a_row_short_of_ten_fringes_still_counts_ten():
    theta = 2.0 * np.pi * ROWS / PERIOD
    curve = 0.5 + 0.2 * np.cos(theta)
    for rows, fringes in [(450, 10), (449, 10), (447, 9)]:
        fit = retrieve(made(curve[:rows], curve[:rows], ROWS[:rows])).nominal
        assert fit.fringes == fringes
        assert fit.modulation.value == pytest.approx(0.2, rel=1e-12)


def test_error_bars_hold_for_the_worst_disturbance_and_are_not_idle():
    theta = 2.0 * np.pi * ROWS / PERIOD
    nominal = 0.5 + 0.2 * np.cos(theta)
    ghosts = 0.01 + 0.002 * np.cos(theta)
    bound = 1e-4
    # the disturbance within ± bound that moves M* most: a square wave in step with the fringes
    disturbed = ghosts + bound * np.sign(np.cos(theta))
    clean = retrieve(made(nominal, nominal + ghosts, ghost_error=bound)).coherent
    moved = retrieve(made(nominal, nominal + disturbed, ghost_error=bound)).coherent
    shift = abs(moved.parasitic_over_modulation.value - clean.parasitic_over_modulation.value)
    error = clean.parasitic_over_modulation.error
    assert 0.95 * error < shift <= error * (1 + 1e-9)
    assert abs(moved.nma_error.value - clean.nma_error.value) <= clean.nma_error.error
    # the nominal pair stands in both curves: its error weighs on M* only as a scale, on M in full
    shared = retrieve(made(nominal, nominal + ghosts, error=1e-3, ghost_error=bound))
    assert shared.coherent.parasitic_over_modulation.error < 1.2 * error
    assert shared.nominal.modulation.error == pytest.approx(1e-3 * 4.0 / np.pi, rel=1e-2)
    # noise of the residual: the standard error covers the shift in about two thirds of the draws
    rng = np.random.default_rng(5)
    hits = 0
    for _ in range(200):
        noisy = retrieve(made(nominal + rng.normal(0.0, 1e-3, len(ROWS)), nominal, ROWS)).nominal
        hits += abs(noisy.modulation.value - 0.2) < noisy.modulation.error
    assert 0.58 < hits / 200 < 0.78


def test_left_out_pairs_widen_the_error_bars():
    pairs = [pair(0, 1, 1.0, 1e-5, SLOPE)]
    t, family = [0.25, 0.25, 1e-3], [0, 0, 1]
    out = [LeftOut(0, 2, 2e-4, ""), LeftOut(1, 2, 1e-4, "")]
    bare = retrieve(psi_of(coherency(t, family, pairs))).paper
    wide = retrieve(psi_of(coherency(t, family, pairs, out))).paper
    grown = wide.parasitic_over_modulation.error - bare.parasitic_over_modulation.error
    assert grown == pytest.approx(3e-4, rel=1e-6)
    assert wide.offset_over_baseline.error - bare.offset_over_baseline.error == pytest.approx(3e-4, rel=1e-6)


def test_printed_ratio_and_its_linear_form():
    assert nma_error_exact(0.0, 0.05) == pytest.approx(0.05 / 1.05)
    assert nma_error_linear(0.01, 0.05) == pytest.approx(0.04)
    # they part in second order only
    for scale in (1e-2, 1e-3):
        part = nma_error_linear(-scale, 2 * scale) - nma_error_exact(-scale, 2 * scale)
        assert part == pytest.approx(6 * scale**2, rel=0.1)


def test_fringes_follow_the_filter_centroid_under_dispersion():
    """Dispersion moves the envelope (group OPD) and not the fringe frequency of a symmetric filter: no correction."""
    at = chebyshev.nodes(9, SIGMA0 - 9e3, SIGMA0 + 9e3)
    sigma = SIGMA0 + np.linspace(-8e3, 8e3, 4001)
    width = 4.45e3
    weight = np.exp(-4.0 * np.log(2.0) * ((sigma - SIGMA0) / width) ** 2)
    phase_opd, group_opd = 0.10e-3, 0.13e-3
    opd = phase_opd + (group_opd - phase_opd) * (at - SIGMA0) / SIGMA0
    coh = coherency([0.25, 0.25], [0, 0], [Pair(0, 1, at, np.ones(9, complex), np.zeros(9), opd, SLOPE, "")])
    fit = retrieve(synthesise(coh, sigma, weight, ROWS)).nominal
    expected = np.exp(-((np.pi * width * group_opd) ** 2) / (4.0 * np.log(2.0)))
    assert fit.nma.value == pytest.approx(expected, rel=3e-3)
    assert abs(fit.nma.value - expected) < fit.nma.error
    assert abs(fit.detuning) < 1e-3


def test_detuning_is_measured_and_refused_beyond_a_tenth_of_a_fringe():
    for fringes in (0.03, -0.06):
        theta = 2.0 * np.pi * (ROWS / PERIOD) * (1.0 + fringes / 10.0)
        curve = 0.5 + 0.2 * np.cos(theta + 0.3)
        assert retrieve(made(curve, curve)).nominal.detuning == pytest.approx(fringes, rel=0.02)
    theta = 2.0 * np.pi * (ROWS / PERIOD) * 1.02
    curve = 0.5 + 0.2 * np.cos(theta)
    with pytest.raises(MethodLimitError, match="run off"):
        retrieve(made(curve, curve))


def test_refuses_what_it_cannot_read():
    curve = 0.5 + 0.2 * np.cos(2 * np.pi * ROWS / PERIOD)
    psi = made(curve, curve)
    with pytest.raises(MethodLimitError, match="samples per fringe") as caught:
        retrieve(replace(psi, slope=SLOPE * PERIOD / (2.5 * PITCH)))
    assert caught.value.factor == pytest.approx(4 / 2.5)
    with pytest.raises(MethodLimitError, match="whole fringe") as caught:
        retrieve(replace(psi, slope=SLOPE / 20))
    assert caught.value.factor == pytest.approx(2.0)
    weak = 0.5 + 1e-4 * np.cos(2 * np.pi * ROWS / PERIOD)
    with pytest.raises(MethodLimitError, match="mean anything"):
        retrieve(made(weak, weak))
    with pytest.raises(MethodLimitError, match="mean anything"):  # well above the floor, but not above its own error
        retrieve(made(curve, curve, error=0.3))


def test_four_samples_per_fringe_are_enough():
    rows = (np.arange(40) - 19.5) * PERIOD / 4
    curve = 0.5 + 0.2 * np.cos(2 * np.pi * rows / PERIOD + 0.9)
    fit = retrieve(made(curve, curve, rows)).nominal
    assert (fit.modulation.value, fit.baseline.value, fit.phase) == pytest.approx((0.2, 0.5, 0.9), rel=1e-12)
