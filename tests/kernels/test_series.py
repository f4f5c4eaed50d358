"""Asymptotic series: closed forms, integrals along turned paths, and the errors they tell."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import erfc

from cgi_wave.kernels.panels import _add, _worth
from cgi_wave.kernels.polynomials import BATCH, taylors
from cgi_wave.kernels.series import MOST, centre_amplitude, distance, far_amplitudes, terms_for


def far(lines, x, terms, factor=None, a=(1.0, 0.0), b=(1.0, 0.0)):
    """E at x of one line, BATCH times over, the same with a factor, and the relative error that is told."""
    fl, al, bl = (np.tile(np.array(p, float), (BATCH, 1)) for p in (lines, a, b))
    wl = np.empty((BATCH, 0)) if factor is None else np.tile(np.array(factor, float), (BATCH, 1))
    at, c, out = np.full(BATCH, x), np.empty((MOST + 2, BATCH)), np.zeros((4, BATCH))
    taylors(fl, at, c)
    nearest = distance(c[1, 0], c[2, 0], c[3, 0])
    told = far_amplitudes(c, al, bl, wl, at, terms, nearest, np.empty((6, MOST + 2, BATCH)), out)
    assert np.ptp(out, axis=1).max() == 0.0  # lanes do not mix
    return complex(*out[:2, 0]), complex(*out[2:, 0]), told, nearest


@pytest.mark.parametrize("x", [1.2, 2.0, -1.5])
@pytest.mark.parametrize("terms", [1, 2, 3, 5, 8, 12])
def test_quadratic_phase_is_the_complementary_error_function(x, terms):
    # −∫_x^∞ exp(i 2πW t²) dt = −√π/(2a) erfc(a x), a = √(−2πi W)
    w = 9.0
    value, _, told, nearest = far([0.0, 0.0, w, 0.0], x, terms)
    a, side = np.sqrt(-2j * np.pi * w), math.copysign(1.0, x)
    exact = -side * np.sqrt(np.pi) / (2 * a) * erfc(a * abs(x)) * np.exp(-2j * np.pi * w * x * x)
    off = abs(value / exact - 1.0)
    rounding = 5e-14  # of the closed form: its phase is some 100 rad
    assert off <= told + rounding
    assert off <= math.factorial(terms + 1) / nearest ** (terms + 1) + rounding
    if terms <= 5:
        assert told <= 40.0 * off + rounding


def turned(f, g, x, slope):
    """−∫ g exp(i 2π (f − f(x))) from x along a straight path into the valley: by quadrature."""
    t, w = np.polynomial.legendre.leggauss(120)
    s = 0.5 * (t + 1.0) * 8.0 / abs(slope)  # exp(−2π 8) is nothing
    z = x + 1j * math.copysign(1.0, slope) * s
    values = g(z) * np.exp(2j * np.pi * (f(z) - f(x)))
    return -1j * math.copysign(1.0, slope) * np.sum(0.5 * w * 8.0 / abs(slope) * values)


def test_amplitudes_and_a_factor_beside_a_turned_path():
    line, a, b, factor = [3.0, 40.0, 5.0, -2.0, 0.7], [1.0, 0.3, -0.2], [0.8, -0.4, 0.1], [0.2, 1.0]
    value, further, told, _ = far(line, 0.9, 6, factor, a, b)
    p = [np.polynomial.Polynomial(q) for q in (line, a, b, factor)]
    slope = p[0].deriv()(0.9)
    exact = turned(p[0], lambda z: p[1](z) * p[2](z), 0.9, slope)
    exact_further = turned(p[0], lambda z: p[1](z) * p[2](z) * p[3](z), 0.9, slope)
    assert told < 1e-9
    assert abs(value / exact - 1.0) <= told + 1e-12
    assert further == pytest.approx(exact_further, rel=1e-8)


def test_as_many_terms_as_are_asked_for_or_none():
    assert terms_for(1000.0, 1e-12) == (4, pytest.approx(120 / 1e15))
    few, left = terms_for(1000.0, 1e-3)
    assert (few, left) == (1, pytest.approx(2e-6))
    assert terms_for(8.0, 1e-12)[0] == -1


@pytest.mark.parametrize("quartic", [0.0, 20.0, -20.0])
def test_a_stationary_points_own_term(quartic):
    """∫ r exp(i 2π (c r² + d r⁴)) dr with s = r²: for d = 0 it is i/(4πc); else by a turned path in s."""
    c, out = 60.0, np.empty(4)
    f = np.array([0.0, 0.0, c, 0.0, quartic])
    missed = centre_amplitude(f, np.ones(1), np.ones(1), np.empty(0), out)
    exact = -0.5 * turned(lambda s: c * s + quartic * s * s, lambda s: 1.0 + 0.0 * s, 0.0, c)
    if quartic == 0.0:
        assert exact == pytest.approx(1j / (4.0 * np.pi * c), rel=1e-12)
        assert missed == 0.0
    assert abs(complex(*out[:2]) - exact) <= missed + 1e-12 * abs(exact)
    assert missed < 1e-8 * abs(exact)


def test_of_a_ray_and_its_opposite_the_mean_with_amplitudes_and_a_factor():
    """Odd powers cancel between the two: both integrals along r = t exp(iπ/4), where the quadratic phase decays."""
    c = 80.0
    f = np.array([0.0, 0.0, c, 15.0, -6.0, 2.0])
    a, b, w, out = np.array([1.0, 0.3, -0.2]), np.array([0.7, -0.5]), np.array([0.4, 1.0]), np.empty(4)
    missed = centre_amplitude(f, a, b, w, out)
    t, weight = np.polynomial.legendre.leggauss(200)
    t, weight = 0.3 * (t + 1.0), 0.3 * weight
    means = []
    for factor in (np.ones(1), w):
        total = 0.0
        for side in (1.0, -1.0):
            r = t * np.exp(0.25j * np.pi)
            g = np.prod([np.polynomial.polynomial.polyval(side * r, p) for p in (a, b, factor)], axis=0) * r
            phase = np.polynomial.polynomial.polyval(side * r, f)
            total += 0.5 * np.sum(weight * g * np.exp(2j * np.pi * phase)) * np.exp(0.25j * np.pi)
        means.append(total)
    assert abs(complex(*out[:2]) - means[0]) <= missed
    assert missed < 1e-7 * abs(means[0])
    assert complex(*out[2:]) == pytest.approx(means[1], rel=1e-6)


@pytest.mark.parametrize("size", [16, 64])
def test_end_of_a_series_that_is_dropped_changes_no_more_than_is_told(size):
    """Amplitude and phase as Chebyshev series that fall; panels of either width, against a fine sum."""
    fall = 0.2 ** np.arange(16.0)
    cheb = np.array([fall * 3.0, fall, 0.5 * fall * (-1.0) ** np.arange(16)])
    cheb[0, 1] = 30.0
    used, dropped = _worth(cheb, 2.0, 1e-3)
    assert used == 8
    assert 0.0 < dropped <= 1e-3
    assert _worth(cheb, 2.0, 0.0) == (16, 0.0)
    sums = np.zeros(6)
    _add(cheb, np.empty((5, 16)), used, 40, size, sums, np.empty((21, 64)))
    t, w = np.polynomial.legendre.leggauss(900)
    phase, re, im = (np.polynomial.chebyshev.chebval(t, row) for row in cheb)
    exact = np.sum(w * (re + 1j * im) * np.exp(2j * np.pi * phase))
    assert abs(complex(*sums[:2]) - exact) <= dropped
