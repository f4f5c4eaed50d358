"""The largest |G| over a range of OPDs."""

import numpy as np
import pytest

from cgi_wave.errors import InputError
from cgi_wave.fringes.envelope import max_envelope

SIGMA0 = 1.3e6


def test_bounds_the_gaussian_envelope_closely():
    width = 4.4e3
    sigma = SIGMA0 + np.linspace(-4 * width, 4 * width, 4001)
    envelope = max_envelope(sigma, np.exp(-4 * np.log(2) * ((sigma - SIGMA0) / width) ** 2))
    for low, high in [(0.0, 1e-5), (5e-5, 3e-4), (-3e-4, -5e-5), (-2e-4, 3e-4), (2e-4, 2e-4)]:
        near = 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))
        exact = np.exp(-((np.pi * width * near) ** 2) / (4 * np.log(2)))
        assert exact <= envelope(low, high) <= min(1.0, 1.1 * exact)


def test_bounds_every_opd_of_a_spectrum_with_lines():
    rng = np.random.default_rng(3)
    sigma = SIGMA0 + np.linspace(-5e3, 5e3, 3000)
    weight = np.exp(-((sigma - SIGMA0) / 2e3) ** 2)
    for centre in np.arange(-4e3, 4e3, 400.0):  # a comb: coherent rises every 2.5 mm
        weight = weight * (1.0 - 0.9 / (1.0 + ((sigma - SIGMA0 - centre) / 20.0) ** 2))
    envelope = max_envelope(sigma, weight)
    for _ in range(40):
        low = rng.uniform(0.0, 8e-3)
        high = low + rng.uniform(0.0, 4e-4)
        opd = np.linspace(low, high, 60)
        value = np.abs(np.exp(2j * np.pi * np.outer(opd, sigma - SIGMA0)) @ weight).max() / weight.sum()
        assert value <= envelope(low, high)
    assert envelope(2.4e-3, 2.6e-3) > 20 * envelope(1.2e-3, 1.3e-3)  # the rise is seen, and the quiet beside it
    assert envelope(1.0, 2.0) == envelope(3.0, 3.0) > 0.0  # beyond the grid: the last known octave stands in


def test_refuses_an_uneven_grid():
    with pytest.raises(InputError, match="uniform"):
        max_envelope(np.array([1.0, 2.0, 4.0]), np.ones(3))
