"""Kernels of blurs from rays."""

import numpy as np
import pytest

from cgi_wave.budget.sceneview import _kernel
from cgi_wave.rays.disc import disc

PIXEL = 1e-5


@pytest.mark.parametrize("radius", [5.0, 50.0, 400.0])
def test_rays_of_an_even_disc_make_an_even_kernel(radius):
    stretch = np.array([1.0, 0.8])
    place = disc(10_000) * radius * PIXEL * stretch
    kernel = _kernel(place, np.full(len(place), 1.0 / len(place)), PIXEL)
    half = np.array(kernel.shape) // 2
    y, x = np.mgrid[-half[0] : half[0] + 1, -half[1] : half[1] + 1]
    assert kernel.sum() == pytest.approx(1.0)
    # The second moments of a uniform disc; the pixel's own is 1/12, what rays are spread over adds less than a percent.
    for axis, size in ((x, radius), (y, 0.8 * radius)):
        assert (kernel * axis**2).sum() == pytest.approx(size**2 / 4.0 + 1.0 / 12.0, rel=0.02)
    inside = (x / radius) ** 2 + (y / (0.8 * radius)) ** 2 < 0.6
    assert kernel[inside] * np.pi * 0.8 * radius**2 == pytest.approx(1.0, abs=0.25)
    assert kernel[inside].std() * np.pi * 0.8 * radius**2 < 0.05


def test_a_line_of_rays_stays_a_line():
    place = np.stack([np.linspace(-1.0, 1.0, 2001) * 200 * PIXEL, np.zeros(2001)], axis=1)
    kernel = _kernel(place, np.full(2001, 1.0 / 2001), PIXEL)
    assert kernel[kernel.shape[0] // 2].sum() == pytest.approx(1.0)
