"""Rays across regions: corners where circles and lines meet, the number of intervals, and the boundary as curves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cgi_wave.kernels.curves import boundary
from cgi_wave.kernels.outline import cast, crossings, find_breaks, intervals_of, restrict, spans

WIDE = np.array([[0.0, 0.0, 3.0, 3.0]])  # a domain that bounds nothing


def circle(x: float, y: float, radius: float, sign: float = 1.0) -> np.ndarray:
    """sign (radius² − |u − (x, y)|²) as powers."""
    out = np.zeros((3, 3))
    out[0, 0], out[1, 0], out[0, 1] = radius**2 - x * x - y * y, 2.0 * x, 2.0 * y
    out[2, 0] = out[0, 2] = -1.0
    return sign * out


def line(x: float) -> np.ndarray:
    """x − u_x."""
    out = np.zeros((3, 3))
    out[0, 0], out[1, 0] = x, -1.0
    return out


def area(curves: np.ndarray) -> float:
    """∮ x dy."""
    s, w = np.polynomial.legendre.leggauss(24)
    x = np.polynomial.polynomial.polyval(s, curves[:, 0].T)
    dy = np.polynomial.polynomial.polyval(s, np.polynomial.polynomial.polyder(curves[:, 1].T))
    return float((x * dy * w).sum())


@pytest.mark.parametrize("x", [0.9, 0.3, 1.0 - 1e-6])
def test_corners_of_a_cut_disc_to_rounding(x):
    """A disc with u_x < x has corners at ± acos x, at whatever angle the two meet."""
    angles, changes = find_breaks(np.array([circle(0.0, 0.0, 1.0), line(x)]), WIDE, 120, 200)
    exact = math.acos(x)
    # Two boundaries 1e-12 apart are one: that is sin(exact) times as near in angle.
    assert np.sort(angles % (2.0 * math.pi)) == pytest.approx(
        [exact, 2.0 * math.pi - exact], abs=1e-12 / math.sin(exact)
    )
    assert not changes.any()


def test_where_the_pivot_is_outside_the_number_of_intervals_changes():
    """A disc of radius 0.3 about (1, 0) is seen under ± asin 0.3; the ranges there turn, and nothing else is lit."""
    clear = np.array([circle(1.0, 0.0, 0.3)])
    angles, changes = find_breaks(clear, WIDE, 120, 200)
    exact = math.asin(0.3)
    assert np.sort(np.mod(angles + math.pi, 2.0 * math.pi) - math.pi) == pytest.approx([-exact, exact], abs=1e-12)
    assert changes.all()
    ranges, turning, corners = spans(clear, WIDE, 120, 200)
    assert corners == len(ranges) == 2
    assert turning.all()


def test_more_corners_than_are_allowed_are_said():
    ranges, _, corners = spans(np.array([circle(0.0, 0.0, 1.0), line(0.3)]), WIDE, 120, 1)
    assert len(ranges) == 0
    assert corners == 2


def test_intervals_are_where_all_clearances_are_positive():
    """Rays through stars, holes and pieces, against signs on a fine line; a ray told where light ends sees the same."""
    rng = np.random.default_rng(3)
    ends, which, gap = np.empty((8, 2)), np.empty((8, 2), np.int64), np.empty(2)
    at, owner, poly = np.empty(40), np.empty(40, np.int64), np.empty((4, 5))
    r, several = np.linspace(0.0, 3.0, 30001)[1:], 0
    for theta in rng.uniform(0.0, 2.0 * math.pi, 60):
        clear = np.where(np.add.outer(np.arange(5), np.arange(5)) < 5, rng.normal(size=(4, 5, 5)), 0.0)
        clear[:, 0, 0] += 1.5
        count = cast(clear, WIDE, theta, ends, which, gap)
        values = [np.polynomial.polynomial.polyval2d(r * math.cos(theta), r * math.sin(theta), c) for c in clear]
        lit = np.min(values, axis=0) > 0.0
        inside = np.zeros(len(r), bool)
        for lo, hi in ends[:count]:
            inside |= (r > lo) & (r < hi)
        assert (lit != inside).sum() <= 2 * count
        several += count > 1
        all_ends = ends[:count].copy()
        restrict(clear, theta, poly)
        found = crossings(poly, WIDE, math.cos(theta), math.sin(theta), 2, at, owner)
        assert intervals_of(poly, at, owner, found, ends, which, gap) == count
        np.testing.assert_allclose(ends[:count], all_ends, rtol=1e-12)
    assert several > 2


def test_a_circle_takes_four_curves_and_a_cut_one_few():
    curves, owner, missed, corners = boundary(np.array([circle(0.1, 0.05, 0.9)]), WIDE, 120, 200, 3e-10, 512)
    assert (len(curves), corners) == (4, 0)
    assert missed < 3e-10
    assert area(curves) == pytest.approx(math.pi * 0.81, abs=1e-9)
    clear = np.array([circle(0.0, 0.0, 1.0), line(0.5)])
    curves, owner, missed, corners = boundary(clear, WIDE, 120, 200, 1e-12, 512)
    assert corners == 2
    assert set(owner) == {0, 1}
    assert area(curves) == pytest.approx(math.pi - math.pi / 3.0 + math.sqrt(3.0) / 4.0, abs=20.0 * 1e-12)


def test_a_ring_seen_from_beside_has_all_its_boundary():
    clear = np.array([circle(0.9, 0.2, 0.8), circle(0.9, 0.2, 0.3, -1.0)])
    curves, _, missed, _ = boundary(clear, WIDE, 120, 200, 1e-11, 512)
    assert area(curves) == pytest.approx(math.pi * (0.64 - 0.09), abs=10.0 * max(missed, 1e-11))
    assert missed < 1e-8


def test_a_boundary_that_takes_too_many_curves_is_none():
    curves, _, missed, _ = boundary(np.array([circle(0.1, 0.05, 0.9)]), WIDE, 120, 200, 3e-10, 3)
    assert len(curves) == 0
    assert missed == np.inf
