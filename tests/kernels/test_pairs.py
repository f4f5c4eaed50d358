"""Every beam against every other: ranges against a plain computation, curvatures against quadratics put in."""

import numpy as np
import pytest

from cgi_wave.kernels.pairs import curvatures, ranges


def beams(count=6, points=80, seed=2):
    """Values of some beams at shared points, NaN where a beam does not reach; the last two share none."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(count, points))
    values[rng.random((count, points)) < 0.3] = np.nan
    values[-1, : points // 2] = np.nan
    values[-2, points // 2 :] = np.nan
    return values


def test_ranges_are_those_of_the_shared_points():
    group, tilt = beams(), np.random.default_rng(5).normal(size=(6, 80))
    least, most = np.nanmin(group, axis=1), np.nanmax(group, axis=1)
    low, high, mean = ranges(group, tilt, least, most)
    for m in range(6):
        for l in range(m + 1, 6):  # noqa: E741
            shared = np.isfinite(group[m] - group[l])
            expected = (least[m] - most[l], most[m] - least[l], np.nan)
            if shared.any():
                difference = (group[m] - group[l])[shared]
                expected = (difference.min(), difference.max(), (tilt[m] - tilt[l])[shared].mean())
            np.testing.assert_allclose((low[m, l], high[m, l], mean[m, l]), expected, rtol=1e-13)
            np.testing.assert_allclose((low[l, m], high[l, m], mean[l, m]), (-high[m, l], -low[m, l], -mean[m, l]))
    assert np.isnan(mean[4, 5])


@pytest.mark.parametrize("turn", [0.0, 0.4, 2.0])
def test_curvatures_are_the_quadratics_own(turn):
    """a u² + b v² along turned axes, on a disc off centre, with tilt and constant: a and b in units of its radius."""
    rng, a, b = np.random.default_rng(0), -3.0, 7.0
    x = rng.uniform(-1, 1, (400, 2))
    x = x[(x**2).sum(axis=1) < 1]
    u, v = np.cos(turn) * x[:, 0] + np.sin(turn) * x[:, 1], np.cos(turn) * x[:, 1] - np.sin(turn) * x[:, 0]
    points = np.array([5.0, -2.0]) + 0.3 * x
    half = 0.5 * np.ptp(points, axis=0).max() / 0.3
    phase = np.array([2.0 + x[:, 0] + a * u**2 + b * v**2, np.full(len(x), 1.0), np.full(len(x), np.nan)])
    found = curvatures(points, phase, np.array([0, 0]), np.array([1, 2]), 12)
    np.testing.assert_allclose(found[0], np.array([a, b]) * half**2, rtol=1e-9)
    assert np.isnan(found[1]).all()  # no shared point


def test_a_difference_within_a_wave_has_no_quadratic():
    points = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    phase = np.array([0.4 * (points**2).sum(axis=1), np.zeros(50)])
    assert np.isnan(curvatures(points, phase, np.array([0]), np.array([1]), 12)).all()
