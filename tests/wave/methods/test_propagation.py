"""Propagation against the Gaussian beam, its own composition, and the PSF by quadrature."""

import math

import numpy as np
import pytest
from cases import PAIRS, cut_pair, defocus, quadrature

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods import nufft
from cgi_wave.wave.methods.patch import Patch
from cgi_wave.wave.methods.propagation import Fresnel, choose_plane, propagate, to_detector, transfer_limit
from cgi_wave.wave.methods.shape import beam_at, edge_of

SIGMA, N, PITCH, WAIST = 1.0 / 0.5e-6, 256, 2e-6, 40e-6


def gaussian(z):
    x = (np.arange(N) - N // 2) * PITCH
    rayleigh = np.pi * WAIST**2 * SIGMA
    one = np.exp(-(x**2) / (WAIST**2 * (1.0 + 1j * z / rayleigh))) / np.sqrt(1.0 + 1j * z / rayleigh)
    return one[:, None] * one[None, :]


@pytest.mark.parametrize("kernel", ["Fresnel", "angular spectrum"])
def test_gaussian_beam(kernel):
    z = 8e-3
    found = propagate(gaussian(0.0), PITCH, SIGMA, z, kernel, steepest=0.02)
    # the angular spectrum has the term beyond Fresnel's: 2πσz q⁴/8 is 1e-6 here
    assert np.abs(found - gaussian(z)).max() < 1e-5


@pytest.mark.parametrize("kernel", ["Fresnel", "angular spectrum"])
def test_keeps_the_power_and_adds_up(kernel):
    rng = np.random.default_rng(5)
    field = rng.normal(size=(64, 64)) + 1j * rng.normal(size=(64, 64))
    once = propagate(field, PITCH, SIGMA, 3e-4, kernel, steepest=0.1)
    twice = propagate(propagate(field, PITCH, SIGMA, 1e-4, kernel, steepest=0.1), PITCH, SIGMA, 2e-4, kernel, 0.1)
    assert np.vdot(once, once).real == pytest.approx(np.vdot(field, field).real, rel=1e-12)
    assert twice == pytest.approx(once, abs=1e-11)


def test_sampling_test_names_the_factor():
    with pytest.raises(MethodLimitError, match="wider") as info:
        propagate(gaussian(0.0), PITCH, SIGMA, 0.1)
    # all that the pitch holds: directions up to 1/(2σ·pitch) = 0.125
    assert info.value.factor == pytest.approx(0.1 * 0.125 / math.sqrt(1 - 0.125**2) / (0.5 * N * PITCH))
    assert transfer_limit(N, PITCH, SIGMA, 1e-3, 0.01) == pytest.approx(1e-5 / (128 * PITCH), rel=1e-3)
    with pytest.raises(InputError, match="square"):
        propagate(np.zeros((3, 4), complex), PITCH, SIGMA, 1e-3)
    with pytest.raises(InputError, match="lengths"):
        propagate(np.zeros((4, 4), complex), 0.0, SIGMA, 1e-3)


def test_psf_converges_with_the_fresnel_number():
    field = HopkinsPair(w020=3.7).pupil_fields()[0]
    beam, edge = beam_at(field, 1.0), edge_of(field)
    errors = []
    for n in (256, 512, 1024):
        plane = choose_plane((beam,), (edge,), 2.0 / n)
        found = to_detector(beam, edge, plane, 24)
        patch = Patch((-12, -12), (24, 24), (plane.pitch, plane.pitch))
        exact = nufft.amplitude(field, patch, 1.0, 1e-9).field
        errors.append(np.abs(found.field * beam.constant - exact).max() / np.abs(exact).max())
    assert errors[2] < 2e-3
    assert errors[2] < errors[1] / 2.0 < errors[0] / 4.0


@pytest.mark.parametrize("name", PAIRS)
def test_overlap_bounds_hold(name):
    m, l = PAIRS[name].pupil_fields()  # noqa: E741
    exact, own = quadrature(m, l)
    method = Fresnel()
    assert method.supports(m, l, 1.0) is None
    for tol in (1e-2, 2e-3):
        found = method.evaluate(m, l, 1.0, tol)
        assert abs(found.value - exact) <= found.error_bound + own
        assert found.error_bound == method.error_bound(m, l, 1.0, tol) <= tol


def test_overlap_of_fitted_beams():
    m, l = cut_pair()  # noqa: E741
    exact, own = quadrature(m, l, 1.0e6)
    found = Fresnel().evaluate(m, l, 1.0e6, 1e-2)
    assert abs(found.value - exact) <= found.error_bound + own


def test_overlap_to_closed_form():
    found = Fresnel().evaluate(*HopkinsPair(w020=1.25).pupil_fields(), 1.0, 1e-4)
    assert abs(found.value - defocus(1.25)) <= found.error_bound <= 1e-4


def test_refuses_steep_wavefronts():
    fields = HopkinsPair(w020=2000.0).pupil_fields()
    assert "exceeded" in Fresnel().supports(*fields, 1.0)
    with pytest.raises(MethodLimitError) as info:
        Fresnel().evaluate(*fields, 1.0, 1e-2)
    assert info.value.factor > 1.0
