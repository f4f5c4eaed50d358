"""Nested least squares: against a library's, degree by degree, and against leaving each sample out in turn."""

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.spatial import KDTree

from cgi_wave.kernels import fit as kernel
from cgi_wave.wave.basis import total_degree_terms, vandermonde
from cgi_wave.wave.fitting import Nested, polynomials


def disc(count, seed=0):
    r, angle = np.random.default_rng(seed).random((2, count))
    return np.sqrt(r)[:, None] * np.stack([np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)], axis=1)


def wavy(x):
    return np.array([np.sin(3 * x[:, 0] + x[:, 1]), 1 / (1.5 + x[:, 0] * x[:, 1])])


def test_rows_are_orthonormal_polynomials():
    x = disc(200)
    q, c = np.empty((91, 200)), np.zeros((91, 91))
    kernel.orthonormalise(q, c, x, 0, 13)
    np.testing.assert_allclose(q @ q.T, np.eye(91), atol=1e-11)
    np.testing.assert_allclose(c @ vandermonde(x, 13).T, q, rtol=0, atol=1e-11)


@pytest.mark.parametrize("count", [130, 300])
def test_every_degree_is_the_least_squares_solution(count):
    x = disc(count)
    values, fits = wavy(x), Nested(x, wavy(x), 12)
    for n in (5, 9, 12):
        fits.grow(n)
        i, j = total_degree_terms(n)
        exact = np.linalg.lstsq(vandermonde(x, n), values.T, rcond=None)[0].T
        found = fits.coefficients(slice(0, 2), n)
        np.testing.assert_allclose(found[:, i, j], exact, rtol=0, atol=1e-11)
        np.testing.assert_allclose(fits.residual, values - exact @ vandermonde(x, n).T, atol=1e-13)
    lower = np.linalg.lstsq(vandermonde(x, 5), values.T, rcond=None)[0].T
    i, j = total_degree_terms(5)
    np.testing.assert_allclose(fits.coefficients(slice(1, 2), 5)[0, i, j], lower[1], atol=1e-12)


def test_misfit_is_what_a_sample_left_out_is_missed_by():
    x = disc(90)
    values, fits = wavy(x), Nested(x, wavy(x), 7)
    fits.grow(7)
    rows = vandermonde(x, 7)
    for k in (0, 13, 89):
        others = np.arange(90) != k
        coefficients = np.linalg.lstsq(rows[others], values[:, others].T, rcond=None)[0]
        np.testing.assert_allclose(fits.misfit()[:, k], values[:, k] - rows[k] @ coefficients, rtol=1e-8)


def test_largest_misfits_are_those_of_the_chosen_samples():
    x = disc(90)
    fits, chosen = Nested(x, wavy(x), 7), np.random.default_rng(2).random((2, 90)) < 0.2
    fits.grow(7)
    misfit = np.abs(fits.misfit())
    np.testing.assert_array_equal(
        fits.largest(chosen).T, [np.where(chosen, misfit, 0.0).max(axis=1), misfit.max(axis=1)]
    )


def test_points_on_a_line_leave_out_what_they_cannot_tell():
    """y = x: of the three terms of degree 1 two are independent, and the fit is the one on the line."""
    x = np.repeat(np.linspace(-0.7, 0.7, 30)[:, None], 2, axis=1)
    fits = Nested(x, np.array([x[:, 0] + 2.0]), 2)
    fits.grow(2)
    assert np.abs(fits.residual).max() < 1e-14


def test_rows_close_to_each_other_come_out_orthogonal():
    """A tight cluster of points: each row loses all but a hundredth of itself to the others, and is freed twice.

    Of rows two degrees below and more it is free by what it is made of, which costs rounding a digit or two.
    """
    x = 0.3 + 1e-2 * disc(60)
    q, c = np.empty((15, 60)), np.zeros((15, 15))
    kernel.orthonormalise(q, c, x, 0, 5)
    np.testing.assert_allclose(q @ q.T, np.eye(15), atol=1e-11)


def test_near_points_are_those_of_a_tree():
    x, chosen = disc(200, 3) * 1.2, np.random.default_rng(1).random(200) < 0.3
    gap, _ = KDTree(x[chosen]).query(x)
    for reach in (0.05, 0.1, 0.3):
        np.testing.assert_array_equal(kernel.near_points(x, chosen, reach), (gap <= reach) & ((x**2).sum(axis=1) <= 1))


def test_polynomials_and_their_derivatives():
    rng, x = np.random.default_rng(0), disc(15)
    i, j = np.indices((6, 6))
    coef = np.where(i + j < 6, rng.normal(size=(3, 6, 6)), 0.0)
    found = polynomials(coef, x)
    for k in range(3):
        for row, c in enumerate((coef[k], chebyshev.chebder(coef[k], axis=0), chebyshev.chebder(coef[k], axis=1))):
            np.testing.assert_allclose(found[k, row], chebyshev.chebval2d(x[:, 0], x[:, 1], c), atol=1e-12)


def test_values_at_points_without_their_derivatives():
    rng, x = np.random.default_rng(0), disc(150)
    coef = rng.normal(size=(3, 6, 6))
    exact = [chebyshev.chebval2d(x[:, 0], x[:, 1], c) for c in coef]
    np.testing.assert_allclose(kernel.values(coef, x), exact, atol=1e-12)
