"""The PSF against Airy, Parseval and direct quadrature."""

import numpy as np
import pytest
from scipy.special import j1
from synthetic_beams import beam, disc

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.wave.field import fit_field
from cgi_wave.wave.psf import psf, psf_direct

CONE, SIGMA = 0.125, 1 / 0.764e-6  # F/4 at 764 nm: the Airy disc is 7.5 um across


def cone_beam(waves=0.0, space="direction"):
    def scaled(x, y):
        return waves * (x**2 + y**2) / CONE**2 + 0 * x

    def path(x, y, sigma):
        return scaled(x, y) / sigma

    return fit_field(beam(path=path, clearances=[disc(CONE)], reach=1.2 * CONE, sigma=np.array([SIGMA]), space=space))


def airy(r):
    z = 2 * np.pi * SIGMA * CONE * np.maximum(r, 1e-15)
    return (np.pi * CONE**2 * SIGMA * 2 * j1(z) / z) ** 2


def test_direct_psf_is_the_airy_pattern():
    x = np.linspace(-9e-6, 9e-6, 13)
    result = psf_direct(cone_beam(), x, x)
    np.testing.assert_allclose(result.irradiance, airy(np.hypot(*np.meshgrid(x, x))), atol=1e-9 * airy(0.0))


def test_fft_psf_is_the_airy_pattern_to_its_edge_error():
    result = psf(cone_beam(), 0.5e-6, 64)
    exact = airy(np.hypot(result.x[:, None], result.y[None, :]))
    assert np.abs(result.irradiance - exact).max() < 2e-3 * airy(0.0)
    assert result.power_error < 5e-3


def test_parseval():
    field = cone_beam(3.0)
    result = psf(field, 1e-6, 512)  # a window that holds nearly all the light
    total = result.irradiance.sum() * 1e-12
    assert total == pytest.approx(field.power_at(field.sigma)[0], rel=5e-3)


def test_fft_psf_matches_direct_quadrature_when_defocused():
    field = cone_beam(10.25)
    fft = psf(field, 0.5e-6, 128)
    middle = slice(48, 81, 4)
    direct = psf_direct(field, fft.x[middle], fft.y[middle])
    error = np.abs(fft.field[middle, middle] - direct.field).max() / np.abs(fft.field).max()
    assert direct.field_error < 1e-9
    # a sampled edge costs about 4 W020 / N² of the unaberrated peak: percents of the defocused one, and it says so
    assert error < 4e-2
    assert 0.1 * error < fft.field_error < 4e-2


def test_sampling_guard_follows_the_defocus_and_names_the_factor():
    assert psf(cone_beam(100.0), 1e-6, 64).fft_size >= 2 * psf(cone_beam(40.0), 1e-6, 64).fft_size
    with pytest.raises(MethodLimitError, match="wavefront needs") as info:
        psf(cone_beam(3000.0), 1e-6, 64)
    assert info.value.factor > 1.0
    with pytest.raises(MethodLimitError, match="times smaller") as info:
        psf(cone_beam(), 15e-6, 64)
    assert info.value.factor == pytest.approx(15e-6 * SIGMA * 2 * CONE, rel=0.2)
    with pytest.raises(InputError, match="direction-space"):
        psf(cone_beam(space="pupil"), 1e-6, 64)
