"""What becomes of a traced fan, beside the same in plain array arithmetic."""

import numpy as np
import pytest

from cgi_wave.kernels.beams import chart_rays, clearance_rows, lit_disc, mark_near, rows_of, valid_rays
from cgi_wave.kernels.trace import BACKWARD, KINDS, MISS, WRONG_SIDE

CIRCLE, BOX = np.array([1.0, 2.0, 2.0, 0.5, 0.0]), np.array([2.0, 1.0, 4.0, 0.0, 1.0])


def test_rows_of_clearances():
    aperture = np.array([CIRCLE, BOX])
    foot = np.array([[[1.5, 0.5], [0.0, 2.0]], [[0.5, -1.0], [3.0, 5.0]]])
    rows = np.array([[0.75, 0.0], [0.5, 2.0], [1.5, 0.0], [0.5, 0.0], [1.5, 2.0]])
    assert rows_of(aperture) == 5
    p = np.array([[0.3, 0.4], [0.0, 1.0]])
    for keep in (np.array([True, True]), np.array([False, True]), np.array([True, False])):
        for limit in (0.1, 0.6, 3.0):
            near = np.zeros(5, dtype=bool)
            mark_near(aperture, foot, keep, limit, near)
            np.testing.assert_array_equal(near, (rows[:, keep] < limit).any(axis=1))
            out = np.full((1 + near.sum(), keep.sum()), np.nan)
            clearance_rows(aperture, foot, keep, p, 2.0, near, out)
            np.testing.assert_allclose(out[0], np.array([0.9375, 0.75])[keep])
            np.testing.assert_allclose(out[1:], rows[near][:, keep])


def test_rays_that_count_and_the_middle_one():
    p = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [9.0, 9.0], [8.0, 0.0]])
    status = np.array([0, KINDS + BACKWARD, 2 * KINDS + WRONG_SIDE, 0, KINDS + MISS, 0])
    opl = np.array([1.0, 1.0, 1.0, 1.0, 1.0, np.inf])
    keep = np.empty(6, dtype=bool)
    count, nearest = valid_rays(status, opl, p + 1e-3, keep)
    assert count == 4 and nearest in (1, 2)
    np.testing.assert_array_equal(keep, [True, True, True, True, False, False])


def test_lit_disc():
    p = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0], [0.0, 3.0], [0.5, 0.5]])
    status, clearance = np.array([0, 0, 0, 0, 5]), np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    count, x, y, reach = lit_disc(status, clearance, p, 2.5)
    assert (count, x, y) == (3, 0.5, 1.0)
    assert reach == pytest.approx(np.hypot(0.5, 1.0))
    assert lit_disc(status, -clearance, p, 2.5) == (0, 0.0, 0.0, 0.0)


def test_rays_in_a_chart():
    rng = np.random.default_rng(4)
    p, x, q = rng.normal(size=(3, 7, 2))
    opl, power, theta, x0, bend = rng.normal(size=7), rng.uniform(size=7), rng.normal(size=2), rng.normal(size=2), 0.7
    dx, dq = rng.normal(size=(2, 7, 2, 2))
    keep = np.array([True, False, True, True, True, False, True])
    u, end, direction = np.empty((3, 5, 2))
    path, amplitude = np.empty((2, 5))
    chart_rays(keep, p, theta, x0, bend, x, q, opl, power, dx, dq, u, path, amplitude, direction, end)
    away = x - x0
    np.testing.assert_allclose(u, (q - bend * away)[keep])
    along = opl + p @ theta - (q * away).sum(axis=1) + 0.5 * bend * (away**2).sum(axis=1)
    np.testing.assert_allclose(path, along[keep])
    np.testing.assert_allclose(amplitude, np.sqrt(power / np.abs(np.linalg.det(dq - bend * dx)))[keep])
    np.testing.assert_array_equal(direction, q[keep])
    np.testing.assert_array_equal(end, x[keep])
