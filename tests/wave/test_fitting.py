"""Nested least squares: against a library's, degree by degree, and against leaving each sample out in turn."""

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.spatial import KDTree

from cgi_wave.kernels import fit as kernel
from cgi_wave.kernels.samples import near_points
from cgi_wave.wave.basis import total_degree_terms, vandermonde
from cgi_wave.wave.fitting import Climb, mapping, polynomials


def disc(count, seed=0):
    r, angle = np.random.default_rng(seed).random((2, count))
    return np.sqrt(r)[:, None] * np.stack([np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)], axis=1)


def wavy(x):
    return np.array([np.sin(3 * x[:, 0] + x[:, 1]), 1 / (1.5 + x[:, 0] * x[:, 1])])


def test_rows_are_orthonormal_polynomials():
    x = disc(200)
    rows = np.empty((94, 303))
    kernel.orthonormalise(rows, x, 208, 0, 13)
    q, c = rows[:91, :200], rows[:91, 208:299]
    assert not rows[91:].any()
    assert not rows[:, 200:208].any()
    np.testing.assert_allclose(q @ q.T, np.eye(91), atol=1e-11)
    np.testing.assert_allclose(c @ vandermonde(x, 13).T, q, rtol=0, atol=1e-11)


def climb(x, values, terms, chosen=None, weight=(1.0, 1.0), target=-1.0, limit=np.inf):
    """Two values as path and amplitude, and the first of them as a clearance, which counts everywhere."""
    rows = np.concatenate([values, values[:1]])
    chosen = np.ones(rows.shape, bool) if chosen is None else chosen
    edge = np.ones((1, 1, len(x)), bool)
    return Climb(x, rows, chosen, values[None, :1], edge, np.array(terms), np.array(weight), target, limit)


@pytest.mark.parametrize("count", [130, 300])
def test_every_degree_is_the_least_squares_solution(count):
    x = disc(count)
    values, terms = wavy(x), (5, 9, 12)
    fits = climb(x, values, terms)
    for t, n in enumerate(terms):
        i, j = total_degree_terms(n)
        exact = np.linalg.lstsq(vandermonde(x, n), values.T, rcond=None)[0].T
        found = fits.coefficients(0, 2, n)
        np.testing.assert_allclose(found[:, i, j], exact, rtol=0, atol=1e-11)
        off = np.abs(values - exact @ vandermonde(x, n).T) / (
            1.0 - (np.linalg.qr(vandermonde(x, n))[0] ** 2).sum(axis=1)
        )
        np.testing.assert_allclose(fits.worst[t, :2, 1], off.max(axis=1), rtol=1e-6)
    each = fits.coefficients(0, 2, 12, np.array([12, 5]))
    i, j = total_degree_terms(5)
    lower = np.linalg.lstsq(vandermonde(x, 5), values.T, rcond=None)[0].T
    np.testing.assert_allclose(each[1, i, j], lower[1], atol=1e-12)
    higher = np.ones(each.shape[1:], bool)
    higher[i, j] = False
    assert higher.any() and not each[1, higher].any()


def test_misfit_is_what_a_sample_left_out_is_missed_by():
    x = disc(90)
    values, rows, off = wavy(x), vandermonde(x, 7), []
    for k in range(90):
        others = np.arange(90) != k
        coefficients = np.linalg.lstsq(rows[others], values[:, others].T, rcond=None)[0]
        off.append(np.abs(values[:, k] - rows[k] @ coefficients))
    off = np.array(off).T
    chosen = np.random.default_rng(2).random((3, 90)) < 0.2
    worst = climb(x, values, (7,), chosen).worst[0, :2]
    np.testing.assert_allclose(worst.T, [np.where(chosen[:2], off, 0.0).max(axis=1), off.max(axis=1)], rtol=1e-8)


def test_the_last_degree_is_the_first_that_does():
    """A score is the weighted misfits of path and amplitude and the least of a clearance's."""
    x = disc(300)
    every = climb(x, wavy(x), range(4, 16, 2), weight=(2.0, 3.0)).worst[:, :, 0]
    score = 2.0 * every[:, 0] + 3.0 * every[:, 1] + every[:, 2]
    assert (np.diff(score) < 0.0).all()
    found = climb(x, wavy(x), range(4, 16, 2), weight=(2.0, 3.0), target=0.5 * (score[2] + score[3])).worst
    np.testing.assert_array_equal(found[:, :, 0], every[:4])


def test_degrees_that_lead_nowhere_are_not_climbed():
    """An edge falls too slowly for a limit; a smooth value is followed to the end, whatever its last misfit."""
    x = disc(300)
    kink = np.array([np.abs(x[:, 0] - 0.1), x[:, 1]])
    assert len(climb(x, kink, range(4, 16, 2), limit=1e-6).worst) == 3
    assert len(climb(x, wavy(x), range(4, 16, 2), limit=1e-6).worst) == 6


def test_a_clearance_that_moves_with_the_wavenumber_is_missed_by_that():
    x = disc(100)
    still = np.array([x[:, 0], x[:, 0], x[:, 0], x[:, 1], x[:, 1], x[:, 1], 1.0 + x[:, 0]])
    moving = np.array([1.0 + x[:, 0] + move for move in (0.0, 0.0, 0.01)])[:, None]
    edge = np.ones((3, 1, 100), bool)
    fits = Climb(x, still, np.ones(still.shape, bool), moving, edge, np.array([3]), np.ones(2))
    assert fits.worst[0, 6, 0] == pytest.approx(0.01)
    assert fits.worst[0, :, 1].max() < 1e-12


def test_points_on_a_line_leave_out_what_they_cannot_tell():
    """y = x: of the three terms of degree 1 two are independent, and the fit is the one on the line."""
    x = np.repeat(np.linspace(-0.7, 0.7, 30)[:, None], 2, axis=1)
    assert climb(x, np.array([x[:, 0] + 2.0, x[:, 0]]), (2,)).worst.max() < 1e-14


def test_determinant_of_a_map():
    p = 3.0 * disc(200) + np.array([5.0, -1.0])
    a, b = p.T
    det, misfit, radius = mapping(p, np.column_stack([a * b, a + b**2]), 4)
    np.testing.assert_allclose(det, 2.0 * b**2 - a, rtol=1e-9, atol=1e-9)
    assert misfit < 1e-12
    assert radius == pytest.approx(np.sqrt(2.0 * ((p - p.mean(axis=0)) ** 2).sum(axis=1).mean()))


def test_rows_close_to_each_other_come_out_orthogonal():
    """A tight cluster of points: each row loses all but a hundredth of itself to the others, and is freed twice.

    Of rows two degrees below and more it is free by what it is made of, which costs rounding a digit or two.
    """
    x = 0.3 + 1e-2 * disc(60)
    rows = np.empty((18, 75))
    kernel.orthonormalise(rows, x, 60, 0, 5)
    q = rows[:15, :60]
    np.testing.assert_allclose(q @ q.T, np.eye(15), atol=1e-11)


def test_near_points_are_those_of_a_tree():
    x, chosen = disc(200, 3) * 1.2, np.random.default_rng(1).random(200) < 0.3
    gap, _ = KDTree(x[chosen]).query(x)
    for reach in (0.05, 0.1, 0.3):
        np.testing.assert_array_equal(near_points(x, chosen, reach), (gap <= reach) & ((x**2).sum(axis=1) <= 1))


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
