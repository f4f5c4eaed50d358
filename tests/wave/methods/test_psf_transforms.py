"""Complex PSFs of every transform: Airy, the annulus, Lommel's defocused disc, and each other."""

import numpy as np
import pytest
from cases import bessel, cut_pair, lommel

from cgi_wave.errors import MethodLimitError
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods import huygens, nufft
from cgi_wave.wave.methods.fft import PrunedFft, edge_noise
from cgi_wave.wave.methods.grid import covering, shares
from cgi_wave.wave.methods.matrix import ChirpZ, MatrixFourier
from cgi_wave.wave.methods.nodes import as_disc
from cgi_wave.wave.methods.patch import Patch
from cgi_wave.wave.methods.shape import beam_at, edge_of

pytest.importorskip("finufft")
PATCH = Patch((-40, -24), (64, 48), (0.2, 0.25))


def radius(patch):
    return np.hypot(patch.axis(0)[:, None], patch.axis(1)[None, :])


def test_nufft_is_airy_to_what_it_is_asked():
    field = HopkinsPair().pupil_fields()[1]
    exact = np.pi * bessel(2.0 * np.pi * radius(PATCH))
    for eps in (1e-5, 1e-8, 1e-12):
        found = nufft.amplitude(field, PATCH, 1.0, eps)
        error = np.abs(found.field - exact).max()
        assert error <= found.error <= 3.0 * np.pi * eps


def test_nufft_of_an_annulus_off_centre():
    field = HopkinsPair(obscuration=0.4, shift_x=0.3, shift_y=-0.2).pupil_fields()[0]
    v = 2.0 * np.pi * radius(PATCH)
    tilt = np.exp(2j * np.pi * (0.3 * PATCH.axis(0)[:, None] - 0.2 * PATCH.axis(1)[None, :]))
    exact = np.pi * (bessel(v) - 0.16 * bessel(0.4 * v)) * tilt
    assert np.abs(nufft.amplitude(field, PATCH, 1.0, 1e-10).field - exact).max() < 1e-9


@pytest.mark.parametrize("waves", [0.4, 3.7, -10.25])
def test_defocused_disc_is_lommels(waves):
    field = HopkinsPair(w020=waves).pupil_fields()[0]
    exact = np.pi * lommel(2.0 * np.pi * radius(PATCH), waves)
    found = nufft.amplitude(field, PATCH, 1.0, 1e-10)
    assert np.abs(found.field - exact).max() <= found.error + 1e-11
    assert found.error < 1e-7
    direct = huygens.amplitude(field, PATCH.axis(0), PATCH.axis(1), 1.0)
    assert np.abs(direct.field - exact).max() <= direct.error + 1e-11


@pytest.mark.parametrize("method", [PrunedFft(), MatrixFourier(), ChirpZ()], ids=lambda m: m.name)
def test_sampled_pupils_keep_the_edge_law_on_the_patch(method):
    beam, edge = (f(HopkinsPair(w020=3.7).pupil_fields()[0]) for f in (lambda f: beam_at(f, 1.0), edge_of))
    exact = np.pi * lommel(2.0 * np.pi * radius(PATCH), 3.7)
    for n in (128, 400):
        size = [round(n / 2.0 / p) for p in PATCH.pitch]  # fixes the pitch for the FFT
        pitch = tuple(1.0 / (size[a] * PATCH.pitch[a]) for a in (0, 1))
        grid = covering(edge.u.min(axis=0), edge.u.max(axis=0), pitch)
        found = method.amplitude(beam, grid, shares([beam.support], grid), PATCH).field * beam.constant
        error = np.abs(found - exact).max()
        bound = edge_noise(beam, edge, grid, PATCH)
        assert 0.02 * bound < error <= bound


def test_nufft_and_direct_summation_agree_on_a_cut_apodised_beam():
    for field in cut_pair():
        assert as_disc(beam_at(field, 1.0e6)) is None
        patch = Patch((-10, -12), (24, 20), (0.2e-6, 0.22e-6))
        fast = nufft.amplitude(field, patch, 1.0e6, 1e-10)
        slow = huygens.amplitude(field, patch.axis(0), patch.axis(1), 1.0e6)
        assert np.abs(fast.field - slow.field).max() <= fast.error + slow.error
        assert fast.error < 1e-6 * np.abs(fast.field).max()


def test_disc_is_recognised():
    found = as_disc(beam_at(HopkinsPair(obscuration=0.25, shift_y=0.5, w040=1.0).pupil_fields()[0], 1.0))
    assert found.centre == pytest.approx([0.0, 0.5])
    assert (found.inner, found.outer) == pytest.approx((0.25, 1.0), abs=1e-14)


def test_points_too_far_apart_are_refused_with_the_factor():
    with pytest.raises(MethodLimitError, match="smaller") as info:
        nufft.amplitude(HopkinsPair().pupil_fields()[1], Patch((-8, -8), (16, 16), (1.0, 1.0)), 1.0)
    assert info.value.factor == pytest.approx(2.0, rel=0.02)
