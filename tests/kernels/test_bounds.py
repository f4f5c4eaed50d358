"""Which clearances bound a beam: the compiled comparisons against the same ones written with arrays, slowly."""

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from cgi_wave.kernels import bounds

AXIS = np.linspace(-1.0, 1.0, 41)
X, Y = np.meshgrid(AXIS, AXIS, indexing="ij")
DISC = 1.0 - X**2 - Y**2


def planes(seed, count):
    """Clearances of straight edges at random distances, some of them beyond others."""
    rng = np.random.default_rng(seed)
    angle, away = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(0.1, 2.0, count)
    return np.array([a - np.cos(t) * X - np.sin(t) * Y for t, a in zip(angle, away, strict=True)])


def grid(values):
    """Values (K, G, G) as the kernels take them."""
    return np.ascontiguousarray(np.moveaxis(values, 0, 1))


def slow_in_light(values, disc, residual):
    kept = list(range(len(values)))
    lit = (values > 0.0).all(axis=0) & (disc > 0.0)
    for k in np.argsort([-value[lit].min(initial=np.inf) for value in values]):
        others = [j for j in kept if j != k]
        if len(others) < 2:
            break
        rest = np.minimum(values[others].min(axis=0), disc)
        here = np.array([rest, values[k]])
        least, step = values[k][rest > 0.0].min(initial=np.inf), 0.0
        for a, b in ((here[:, 1:], here[:, :-1]), (here[:, :, 1:], here[:, :, :-1])):
            leaves = (a[0] > 0.0) != (b[0] > 0.0)
            (rest_a, own_a), (rest_b, own_b) = a[:, leaves], b[:, leaves]
            least = min(least, (own_a + rest_a / (rest_a - rest_b) * (own_b - own_a)).min(initial=np.inf))
            step = max(step, np.abs(own_b - own_a).max(initial=0.0))
        if least > residual[k] + 2.0 * residual[others].max() + 0.5 * step:
            kept = others
    return kept


@pytest.mark.parametrize("seed", range(12))
def test_what_lies_in_the_shadow_of_others_goes(seed):
    values = planes(seed, 8)
    kept, cuts = bounds.in_light(grid(values), DISC, np.full(8, 1e-3))
    np.testing.assert_array_equal(np.flatnonzero(kept), slow_in_light(values, DISC, np.full(8, 1e-3)))
    assert 2 <= kept.sum() < 8
    dark = (values <= 0.0) & (DISC > 0.0)
    alone = dark[kept] & (dark[kept].sum(axis=0) == 1)
    np.testing.assert_array_equal(cuts[kept], alone.any(axis=(1, 2)))


def slow_bounding(dense, limiting, same):
    kept, others = [], np.full(dense.shape[1], np.inf)
    for k in np.argsort(dense.min(axis=1)):
        if dense[k].min() >= limiting:
            break
        if ((dense[k] < limiting) & (others > -limiting)).any():
            if all(np.abs(dense[k] - dense[j]).max() > same for j in kept):
                kept, others = [*kept, k], np.minimum(others, dense[k])
    for k in list(kept):
        rest = [j for j in kept if j != k]
        if rest and not ((dense[k] < limiting) & (dense[rest].min(axis=0) > -limiting)).any():
            kept = rest
    return kept


@pytest.mark.parametrize("seed", range(12))
def test_apertures_that_bound_a_beam(seed):
    values = planes(seed, 10)
    values[9] = values[0] + 1e-9
    dense = values[:, DISC > 0.0]
    found = bounds.bounding(dense, 0.05, 1e-6)
    np.testing.assert_array_equal(found, slow_bounding(dense, 0.05, 1e-6))


def test_tangents_that_matter_are_those_with_light_beyond():
    normal, height = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]), np.array([0.5, 0.5, 0.5])
    values = np.array([0.2 - X, 0.9 - Y])
    # Light reaches x = 0.2, y = 0.9 and the disc's edge at x = -1.
    np.testing.assert_array_equal(bounds.beyond(grid(values), AXIS, normal, height), [False, True, True])


def test_open_points_of_an_edge():
    """Points of the circle, and of a tangent within it, with all polynomials positive."""
    rng = np.random.default_rng(0)
    i, j = np.indices((5, 5))
    coef = np.where(i + j < 5, rng.normal(size=(2, 5, 5)), 0.0) + np.where(i + j == 0, 1.0, 0.0)
    t, along = np.linspace(0.0, 2.0 * np.pi, 200), np.linspace(-1.0, 1.0, 101)
    rim = np.column_stack([np.cos(t), np.sin(t)])
    normal, height = np.array([[0.6, 0.8]]), np.array([0.3])
    edge = np.concatenate([rim, 0.3 * normal + along[:, None] * np.array([-0.8, 0.6])])
    inside = edge[((edge**2).sum(axis=1) <= 1.0 + 1e-9) & (edge @ normal[0] <= 0.3 + 1e-9)]
    opened = (np.array([chebyshev.chebval2d(*inside.T, c) for c in coef]) > 0.0).all(axis=0)
    assert bounds.count_open(coef, rim, along, normal, height) == (len(inside), opened.sum())
    assert 0 < opened.sum() < len(inside)


def test_how_far_points_reach():
    rng = np.random.default_rng(1)
    x, normal = rng.normal(size=(2, 30, 2))
    np.testing.assert_allclose(bounds.heights(x, normal), (x @ normal.T).max(axis=0), rtol=1e-15)


@pytest.mark.parametrize("places, terms", [([], 1), ([(0, 0)], 1), ([(0, 3), (2, 1)], 4), ([(5, 0)], 6)])
def test_terms_that_polynomials_use(places, terms):
    coef = np.zeros((2, 7, 7))
    for i, j in places:
        coef[1, i, j] = -1.0
    assert bounds.terms_used(coef) == terms
