"""The mutual PSF against γ, encircled energy against Airy's, and pixels against the average of a fringe."""

import numpy as np
import pytest
from scipy.special import j0, j1
from synthetic_beams import SIGMA, beam, disc

from cgi_wave.errors import InputError
from cgi_wave.wave.field import fit_field
from cgi_wave.wave.mutual import encircled_energy, fringe_frequency, mutual_psf, pixel_contrast, pixel_mtf
from cgi_wave.wave.overlap import overlap
from cgi_wave.wave.psf import psf

CONE = 0.125
SIGMAS = np.array([1.0 / 0.764e-6])


def cone(waves=0.0, lead=0.0, phase=0.0):
    def path(x, y, sigma):
        return (waves * (x**2 + y**2) / CONE**2 + 0.0 * x) / sigma + lead

    clearance = [disc(CONE)]
    return fit_field(beam(path=path, clearances=clearance, reach=1.2 * CONE, sigma=SIGMAS, phase=phase))


def test_sum_of_the_mutual_psf_is_the_contrast():
    m, l = cone(2.3, lead=0.4e-6, phase=0.3), cone()  # noqa: E741
    found = mutual_psf(m, l, 1.5e-6, 256)
    truth = overlap(m, l, SIGMAS)
    exact = truth.value[0] * np.exp(2j * np.pi * SIGMAS[0] * truth.opd_m[0])
    assert abs(found.contrast - exact) <= found.outside + truth.error_bound[0] + 1e-4
    assert 0.0 < found.outside < 0.02
    assert np.abs(found.contrast - exact) < 0.02


def test_of_a_beam_with_itself_is_its_irradiance():
    field = cone(1.1)
    found = mutual_psf(field, field, 1e-6, 64)
    assert found.value == pytest.approx(psf(field, 1e-6, 64, measure=False).irradiance, rel=1e-12)
    assert found.held[0] <= found.power[0] * 1.001


def test_error_covers_a_finer_transform():
    m, l = cone(2.3), cone()  # noqa: E741
    coarse = mutual_psf(m, l, 1.5e-6, 32)
    fine = mutual_psf(m, l, 1.5e-6, 1024)
    middle = slice(512 - 16, 512 + 16)
    assert np.abs(fine.value[middle, middle] - coarse.value).max() <= coarse.error


def test_binning_keeps_the_sum_and_refuses_what_does_not_divide():
    found = mutual_psf(cone(0.7), cone(), 1e-6, 64)
    assert found.binned(4).contrast == pytest.approx(found.contrast, rel=1e-12)
    assert found.binned(4).pixel == pytest.approx(4e-6)
    with pytest.raises(InputError, match="divide"):
        found.binned(5)


def test_encircled_energy_is_airys():
    field = cone()
    made = psf(field, 0.4e-6, 200, measure=False)
    power = field.power_at(SIGMAS)[0]
    radius = np.array([2.3e-6, 3.73e-6, 6e-6, 15e-6, 35e-6])
    found = encircled_energy(made, power, radius)
    v = 2.0 * np.pi * SIGMAS[0] * CONE * radius
    want = 1.0 - j0(v) ** 2 - j1(v) ** 2
    assert np.all(np.abs(found.value - want) <= found.error + 1e-3)
    assert found.value == pytest.approx(want, abs=2e-3)
    assert found.centre == pytest.approx((0.0, 0.0), abs=1e-8)
    assert np.all(np.diff(found.value) > 0.0)


def test_encircled_energy_refuses_circles_it_cannot_hold():
    made = psf(cone(), 0.4e-6, 64, measure=False)
    for radius in (1e-7, 5e-5):
        with pytest.raises(InputError, match="patch"):
            encircled_energy(made, 1.0, np.array([radius]))


def test_pixel_mtf_is_the_average_of_a_fringe():
    pixel, frequency = 15e-6, np.array([2.1e4, 0.9e4])
    x = (np.arange(400) + 0.5) / 400 - 0.5
    fringe = np.exp(2j * np.pi * pixel * (frequency[0] * x[:, None] + frequency[1] * x[None, :]))
    assert pixel_mtf(frequency, pixel) == pytest.approx(fringe.mean().real, abs=1e-5)
    assert pixel_mtf(0.0, pixel) == 1.0
    assert pixel_mtf(1.0 / pixel, pixel) == pytest.approx(0.0, abs=1e-15)
    assert pixel_mtf(1.0 / pixel, pixel, 0.5) == pytest.approx(2.0 / np.pi)
    with pytest.raises(InputError):
        pixel_mtf(1.0, 0.0)
    with pytest.raises(InputError):
        pixel_mtf(1.0, pixel, 1.5)


def test_pixel_contrast_takes_the_pairs_own_frequency():
    # two plane fields over the entrance pupil whose directions differ by 0.02 along y: fringes of σ·0.02
    ways = [lambda x, y, tilt=tilt: np.full_like(y, tilt) for tilt in (0.015, -0.005)]
    m, l = (fit_field(beam(0.2, direction=way, space="pupil")) for way in ways)  # noqa: E741
    pair = overlap(m, l, np.array([SIGMA]))
    assert fringe_frequency(pair, SIGMA) == pytest.approx(0.02 * SIGMA, rel=1e-6)
    value, bound = pixel_contrast(pair, np.array([SIGMA]), 15e-6)
    assert value == pytest.approx(pair.value * np.sinc(0.02 * SIGMA * 15e-6))
    assert bound[0] <= pair.error_bound[0]
