"""Samples made ready for a fit, against the same with arrays."""

import numpy as np
from scipy.spatial import KDTree

from cgi_wave.kernels import samples


def scattered(seed=0, wavenumbers=2, count=300):
    """Points, one set a wavenumber, and two clearances: a circle that shrinks, a straight edge."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1.0, 1.0, (wavenumbers, count, 2)) * [1.0, 0.4] + [3.0, 0.0]
    x, y = np.moveaxis(u, 2, 0)
    circle = 0.8 - 0.02 * np.arange(wavenumbers)[:, None] - (x - 3.0) ** 2 - (2.0 * y) ** 2
    return u, np.array([circle, 3.2 - x])


def test_samples_that_take_part_lie_in_the_ellipse_of_the_lit_ones_and_near_one():
    u, clearance = scattered()
    lit, counts, centre, half, scale, spacing, x, inside = samples.prepared(u, clearance, 1.5, 0.4)
    np.testing.assert_array_equal(lit, (clearance > 0.0).all(axis=0))
    np.testing.assert_array_equal(counts, lit.sum(axis=1))
    points = u[lit]
    np.testing.assert_allclose([centre - half, centre + half], [points.min(axis=0), points.max(axis=0)])
    assert spacing == np.sqrt(np.pi / counts.min()) < 0.4
    reach = np.sqrt((((points - centre) / half) ** 2).sum(axis=1).max())
    np.testing.assert_allclose(scale, half * reach * (1.0 + 1.5 * spacing))
    np.testing.assert_allclose(x, (u - centre) / scale)
    for here, shines, part in zip(x, lit, inside, strict=True):
        gap, _ = KDTree(here[shines]).query(here)
        np.testing.assert_array_equal(part, (gap <= spacing) & ((here**2).sum(axis=1) <= 1.0))
        assert shines.sum() < part.sum() < len(here)


def test_no_light_and_light_on_a_line():
    u, clearance = scattered()
    assert samples.prepared(u, clearance - 10.0, 1.5, 0.4)[1].tolist() == [0, 0]
    u[:, :, 1] = 0.5
    assert samples.prepared(u, np.ones_like(clearance), 1.5, 0.4)[3][1] == 0.0


def test_what_is_fitted_stands_in_rows():
    _, clearance = scattered()
    rng = np.random.default_rng(3)
    opl, amplitude, direction = rng.normal(size=(2, 300)) + 5.0, rng.normal(size=(2, 300)), rng.normal(size=(300, 2))
    lit, take = (clearance > 0.0).all(axis=0), rng.random(300) < 0.8
    values, chosen, near, edge, mean = samples.gathered(opl, amplitude, clearance, direction, lit, take, True, 12)
    np.testing.assert_allclose(mean, opl.mean(axis=1))
    rows = [*(opl - mean[:, None]), *amplitude, *clearance[:, 1], *direction.T]
    np.testing.assert_array_equal(values, np.array(rows)[:, take])
    np.testing.assert_array_equal(near, clearance.transpose(1, 0, 2)[:, :, take])
    for s in range(2):
        for k in range(2):
            limit = 0.25 * np.abs(clearance[k, s, lit[s] & take]).max()
            np.testing.assert_array_equal(edge[s, k], np.abs(clearance[k, s, take]) <= limit)
    np.testing.assert_array_equal(chosen[:4], lit[[0, 1, 0, 1]][:, take])
    np.testing.assert_array_equal(chosen[4:6], edge[1])
    assert not chosen[6:].any()
    short = samples.gathered(opl, amplitude, clearance, direction, lit, take, False, 1000)
    np.testing.assert_array_equal(short[0], values[:4])
    assert short[3].all()  # too few near zero: all of them


def test_least_values_and_ranges_of_clearances():
    _, clearance = scattered()
    lit = (clearance > 0.0).all(axis=0)
    exact = [[c[lit].min(), np.ptp(c[lit])] for c in clearance]
    np.testing.assert_allclose(samples.least_and_range(clearance, lit), exact)


def test_values_that_are_not_finite_are_counted():
    values = np.ones((3, 4))
    assert samples.not_finite(values) == 0
    values[0, 1], values[2, 3], values[1, 0] = np.nan, np.inf, -np.inf
    assert samples.not_finite(values) == 3
