"""Fringe patterns against the sum of every term, and against closed forms."""

import numpy as np
import pytest
from fringe_scenes import PITCH, ROWS, retro_family
from synthetic_fields import BAND, SIGMA0, dark_row, direct, field, michelson, spectrum

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.fringes.field import frozen
from cgi_wave.fringes.pattern import fringe_patterns
from cgi_wave.fringes.psi import synthesise


def test_every_layer_and_shape_is_the_sum_of_all_terms():
    zone = michelson()
    sigma, weights = spectrum(400)
    nominal, family = fringe_patterns(zone, sigma, weights, pixel=False)
    assert (nominal.name, nominal.view) == ("nominal", None)
    assert family.name == "flipped"
    mean = direct(zone, sigma, weights)[0].mean()
    for layer, families in ((nominal, {0, 2}), (family, {1})):
        exact = direct(zone, sigma, weights, layer=families)
        apart = np.abs(layer.pattern - exact).max()
        assert apart < 1e-8 * mean
        assert np.abs(layer.pattern[0] - exact[0]).max() <= layer.error


def test_pixels_average_the_fringes():
    """Gauss points within every pixel; what a pixel changes in third order is left out."""
    zone = michelson()
    sigma, weights = spectrum(200)
    exact = direct(zone, sigma, weights, pixel=4)
    pattern = sum(layer.pattern for layer in fringe_patterns(zone, sigma, weights))
    points = direct(zone, sigma, weights)
    assert np.abs(pattern - exact).max() < 1e-6 * exact[0].mean()
    assert np.abs(points - exact).max() > 1e-3 * exact[0].mean()


def test_fringes_of_one_wavenumber_are_a_cosine():
    tilt = 3.8e-6
    zone = field([(0, 1, lambda s, u, v: 1.0, lambda s, u, v: tilt * v)], [lambda u, v: 0.25] * 2, [0, 0],
                 [(1, 0), (0, 1)])  # fmt: skip
    (layer,) = fringe_patterns(zone, np.array([SIGMA0]), np.ones(1), pixel=False)
    half = 0.5 * (zone.zone[3] - zone.zone[2])
    v = (zone.y_pixels - 0.5 * (zone.zone[2] + zone.zone[3])) / half
    exact = 0.5 * (1.0 + np.cos(2.0 * np.pi * SIGMA0 * tilt * v))
    np.testing.assert_allclose(layer.pattern[0], np.repeat(exact[:, None], 20, axis=1), atol=1e-12)


def test_two_ports_of_a_lossless_splitter_sum_to_the_input():
    """The other port has the same beams with the opposite phase between them."""
    sigma, weights = spectrum(200)
    ports = []
    for sign in (1.0, -1.0):
        zone = field([(0, 1, lambda s, u, v, sign=sign: sign, lambda s, u, v: 1.3e-3 + 3e-6 * v)],
                     [lambda u, v: 0.25] * 2, [0, 0], [(1, 0), (0, 1)])  # fmt: skip
        ports.append(fringe_patterns(zone, sigma, weights)[0].pattern)
    np.testing.assert_allclose(sum(ports)[0], 1.0, atol=1e-12)


def test_dead_zone_takes_the_fringes_and_one_arm():
    """At the step the arm is dark: half of the light, no fringes; beyond its half width nothing is lost."""
    row = 112
    zone = michelson(shadows=[dark_row(row)])
    sigma, weights = spectrum(200)
    pattern = sum(layer.pattern for layer in fringe_patterns(zone, sigma, weights, pixel=False))
    np.testing.assert_allclose(pattern, direct(zone, sigma, weights), atol=1e-9)
    bright = sum(layer.pattern for layer in fringe_patterns(michelson(), sigma, weights, pixel=False))
    away = np.abs(np.arange(*zone.rows) + 0.5 - row) > 3.3
    np.testing.assert_allclose(pattern[:, away], bright[:, away], rtol=1e-12)
    step = dark_row(row)
    assert step.passed(np.array([step.y_m]))[0] == pytest.approx(0.0, abs=1e-15)
    # Over the shadow the mean loss is ∫ 2·segment: 4/(3π) of twice its half width.
    y = step.y_m + step.half_width_m * np.linspace(-1.0, 1.0, 200_001)
    assert np.trapezoid(1.0 - step.passed(y), y) / step.half_width_m == pytest.approx(
        4.0 * 2.0 / (3.0 * np.pi), rel=1e-6
    )


def test_refusals():
    zone = michelson()
    sigma, weights = spectrum(200)
    with pytest.raises(InputError, match="weights"):
        fringe_patterns(zone, sigma, weights[:, :-1])
    with pytest.raises(MethodLimitError, match="spectral step"):
        fringe_patterns(zone, np.linspace(*BAND, 40), np.ones((1, 40)))
    wide = np.linspace(SIGMA0 - 9e3, SIGMA0 + 9e3, 2000)
    with pytest.raises(MethodLimitError, match="lies outside the pairs' range"):
        fringe_patterns(zone, wide, np.ones((1, 2000)))


def test_fringes_that_no_grid_resolves_are_left_out_with_their_amplitude():
    """Ghost fringes far finer than the nominal ones, and no multiple of them; those of the nominal pair are refused."""
    views = michelson().views[:1]
    fine = [
        (0, 1, lambda s, u, v: 1.0, lambda s, u, v: 1e-6 * v),
        (2, 0, lambda s, u, v: 0.5, lambda s, u, v: 3e-4 * u),
    ]
    powers = [lambda u, v: 0.25, lambda u, v: 0.25, lambda u, v: 0.01]
    arms = [(1, 0), (0, 1), (1, 0)]
    layer = fringe_patterns(field(fine, powers, [0, 0, 1], arms, views=views), *spectrum(400))[0]
    plain = fringe_patterns(field(fine[:1], powers, [0, 0, 1], arms, views=views), *spectrum(400))[0]
    np.testing.assert_allclose(layer.pattern, plain.pattern, atol=1e-14)
    assert layer.left_out == pytest.approx(2.0 * np.sqrt(0.25 * 0.01) * 0.5)
    assert layer.error >= layer.left_out
    rough = [(0, 1, lambda s, u, v: np.sign(u - v), lambda s, u, v: 1e-6 * v)]
    with pytest.raises(MethodLimitError, match="nominal contrast"):
        fringe_patterns(field(rough, powers[:2], [0, 0], arms[:2], nodes=(60, 50)), *spectrum(400))


def test_layers_together_are_their_sum():
    zone, light = michelson(shadows=[dark_row(112)]), spectrum(200)
    (whole,) = fringe_patterns(zone, *light, apart=False)
    parts = fringe_patterns(zone, *light)
    np.testing.assert_allclose(whole.pattern, sum(layer.pattern for layer in parts), atol=1e-13)
    assert whole.error == pytest.approx(sum(layer.error for layer in parts), rel=1e-3)


def test_a_field_point_held_over_the_zone_gives_the_interferogram_of_one_dimension():
    """Every book-keeping's beams and pairs, rows of finite height, a spectrum with a coherent rise, odd columns."""
    rows, height = 450, PITCH
    held = retro_family(1.33e-3, 0.045, shear=0.7)
    sigma = np.linspace(SIGMA0 - 4e3, SIGMA0 + 4e3, 400)
    weight = np.exp(-(((sigma - SIGMA0) / 1.7e3) ** 4)) * (1.0 + 0.5 * np.cos(2.0 * np.pi * (sigma - SIGMA0) * 1.33e-3))
    exact = synthesise(held, sigma, weight, ROWS, height).coherent.irradiance
    zone = (-4.5 * PITCH, 2.5 * PITCH, ROWS[0] - 0.5 * PITCH, ROWS[-1] + 0.5 * PITCH)
    (layer,) = fringe_patterns(frozen(held, SIGMA0, zone, (0, rows), (0, 7), PITCH), sigma, weight)
    np.testing.assert_allclose(layer.pattern[0], np.repeat(exact[:, None], 7, axis=1), atol=1e-11)
