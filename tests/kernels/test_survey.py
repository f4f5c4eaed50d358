"""Where clearances are positive together: lenses, slivers, and clearances that bound nothing."""

from __future__ import annotations

import numpy as np
import pytest

from cgi_wave.kernels.survey import common, spread, survey


def circle(x: float, radius: float, sign: float = 1.0) -> np.ndarray:
    """sign · (radius² − |u − (x, 0)|²) as Chebyshev products on the unit disc."""
    out = np.zeros((3, 3))
    # (u − x)² = T2/2 + 1/2 − 2 x T1 + x²
    out[0, 0] = radius**2 - 0.5 - x * x - 0.5
    out[2, 0], out[1, 0], out[0, 2] = -0.5, 2.0 * x, -0.5
    return sign * out


UNIT = np.zeros((1, 2)), np.ones((1, 2))


def test_annulus_fills_its_frame():
    clear = np.array([circle(0.0, 0.5), circle(0.0, 0.2, -1.0)])
    pivot, frame, points, keep = survey(clear, np.zeros(2, np.int64), *UNIT)
    u = pivot + frame * points
    assert keep.all()
    assert np.hypot(*u.T).min() > 0.2
    assert np.hypot(*u.T).max() < 0.5
    assert 0.45 < np.hypot(*u.T).max()
    assert np.abs(points).max() <= 1.0


def test_clearance_that_bounds_nothing_is_left_out():
    clear = np.array([circle(0.0, 0.5), circle(0.1, 0.9)])
    *_, keep = survey(clear, np.zeros(2, np.int64), *UNIT)
    assert keep.tolist() == [True, False]


@pytest.mark.parametrize("gap", [1e-2, 1e-6])
def test_sliver_between_two_circles(gap):
    """Two discs that overlap by ``gap``; apart by as much, nothing is found."""
    clear = np.array([circle(-0.4, 0.4 + gap / 2.0), circle(0.4, 0.4 + gap / 2.0)])
    pivot, frame, points, _ = survey(clear, np.zeros(2, np.int64), *UNIT)
    assert len(points) > 0
    assert abs(pivot[0]) < gap
    assert frame[0] < 2.0 * gap
    apart = np.array([circle(-0.4, 0.4 - gap / 2.0), circle(0.4, 0.4 - gap / 2.0)])
    assert len(survey(apart, np.zeros(2, np.int64), *UNIT)[2]) == 0


def test_domains_that_do_not_meet():
    centre, scale = np.array([[0.0, 0.0], [3.0, 0.0]]), np.ones((2, 2))
    assert len(survey(np.empty((0, 1, 1)), np.empty(0, np.int64), centre, scale)[2]) == 0


def test_spread_of_a_polynomial():
    points = np.random.default_rng(5).uniform(-1.0, 1.0, (333, 2))
    poly = np.zeros((4, 4))
    poly[0, 0], poly[2, 1], poly[0, 3] = 7.0, 1.5, -2.0
    values = 7.0 + 1.5 * points[:, 0] ** 2 * points[:, 1] - 2.0 * points[:, 1] ** 3
    assert spread(poly, points) == pytest.approx(np.ptp(values), rel=1e-13)


def test_clearances_in_the_frame_of_their_region():
    """Two discs on supports of their own: the same values as powers of the frame, and only those that bound."""
    supports = np.array([[0.0, 0.0], [0.5, -0.1]]), np.array([[1.0, 1.0], [0.9, 0.8]])
    padded = np.zeros((3, 5, 5))  # powers that none of them has are left out
    padded[:, :3, :3] = circle(0.0, 0.6), circle(0.0, 0.99), circle(0.1, 0.5)
    owner = np.array([0, 0, 1])
    pivot, frame, points, keep, powers, ellipses = common(padded, owner, *supports)
    assert keep.tolist() == [True, False, True]
    assert powers.shape == (2, 3, 3)
    u = pivot + frame * points
    for power, k in zip(powers, (0, 2), strict=True):
        x = (u - supports[0][owner[k]]) / supports[1][owner[k]]
        exact = np.polynomial.chebyshev.chebval2d(*x.T, padded[k])
        assert np.polynomial.polynomial.polyval2d(*points.T, power) == pytest.approx(exact, abs=1e-13)
    np.testing.assert_allclose(pivot + frame * ellipses[:, :2], supports[0], atol=1e-15)
    np.testing.assert_allclose(frame * ellipses[:, 2:], supports[1], rtol=1e-15)
