"""Eq. 4 as printed, and what it refuses."""

import math

import numpy as np
import pytest
from scipy.special import j0

from cgi_wave.errors import InputError
from cgi_wave.wave.eq4 import contrast_eq4, contrast_stationary


def test_ratio_of_areas():
    assert contrast_eq4(2e-6, 2e-6, 4e-6, 4e-6) == 0.5
    assert contrast_eq4(2e-6, 8e-6, 4e-6, 4e-6) == 1.0
    assert contrast_eq4(0.0, 8e-6, 4e-6, 4e-6) == 0.0


@pytest.mark.parametrize("size", [0.0, -1.0, math.nan, math.inf])
def test_a_ghost_without_size_is_refused(size):
    with pytest.raises(InputError, match="ghost_rms_y"):
        contrast_eq4(1e-6, 1e-6, 1e-6, size)


def saddle(a, b):
    """|γ| of W = a x² + b y² waves over a disc: γ = ∫ J0(π(a − b)u) exp(iπ(a + b)u) du over 0 < u < 1."""
    t, weight = np.polynomial.legendre.leggauss(400)
    u = 0.5 * (t + 1.0)
    return abs(np.sum(0.5 * weight * j0(np.pi * (a - b) * u) * np.exp(1j * np.pi * (a + b) * u)))


@pytest.mark.parametrize("ratio", [-1.0, -0.4, 0.3, 0.6])
def test_stationary_phase_with_more_waves(ratio):
    """The distance to the law falls with the waves: the edge of the disc is what it leaves out."""
    wavelength, aperture = 0.764e-6, 0.125
    worst = []
    for waves in (10.0, 100.0):
        off = []
        for a in np.linspace(waves, waves + 5.0, 21):
            blur = [abs(v) * wavelength / aperture for v in (a, ratio * a)]
            off.append(abs(saddle(a, ratio * a) / contrast_stationary(*blur, wavelength, aperture) - 1.0))
        worst.append(np.sqrt(np.mean(np.square(off))))
    # The edge has stationary points of its own: |γ| gains terms of W^(−3/2), 1/√W of the law.
    assert worst[1] < 0.45 * worst[0] < 0.25


def test_defocus_alone_has_twice_the_estimate_as_envelope():
    waves = 40.5  # |γ| = |sinc| is at its largest
    assert saddle(waves, waves) / contrast_stationary(waves, waves, 1.0, 1.0) == pytest.approx(2.0, rel=1e-3)


def test_without_blur_what_is_shared_remains():
    assert contrast_stationary(0.0, 1e-6, 1e-6, 0.125) == 1.0
    assert contrast_stationary(0.0, 0.0, 1e-6, 0.125, 0.4) == pytest.approx(0.4, rel=1e-14)


@pytest.mark.parametrize(
    "name, bad",
    [("blur_1", -1.0), ("blur_2", math.nan), ("wavelength", 0.0), ("aperture", -0.1), ("shared", 0.0), ("shared", 1.1)],
)
def test_estimate_refuses_what_is_no_size(name, bad):
    given = {"blur_1": 1e-6, "blur_2": 1e-6, "wavelength": 1e-6, "aperture": 0.1, "shared": 1.0} | {name: bad}
    with pytest.raises(InputError, match=name):
        contrast_stationary(**given)
