"""Integrals of products of amplitudes over a region: closed forms on a disc and a part of it, and the error told."""

import numpy as np
import pytest

from cgi_wave.kernels.outline import spans
from cgi_wave.kernels.power import products

NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)
GAUSS = 0.5 * (NODES + 1.0), 0.5 * WEIGHTS
UNIT = np.array([[0.0, 0.0, 2.0, 2.0]])  # a domain that bounds nothing


def powers(*terms):
    out = np.zeros((4, 4))
    for i, j, value in terms:
        out[i, j] = value
    return out


CIRCLE = powers((0, 0, 1.0), (2, 0, -1.0), (0, 2, -1.0))


def test_closed_forms_on_a_disc():
    """∫1 = π, ∫x² = π/4, ∫x⁴ = π/8; a clearance that is off by r opens a strip r/2 wide all around."""
    amp = np.array([powers((0, 0, 1.0)), powers((2, 0, 1.0)), powers((1, 0, 1.0))])
    ranges, turning = np.array([[0.0, 2.0 * np.pi]]), np.array([False])
    sums, area, edge, tail, between = products(CIRCLE[None], UNIT, np.array([1e-3]), ranges, turning, amp, *GAUSS, 1e-9)
    exact = np.pi * np.array([[1.0, 0.25, 0.0], [0.25, 0.125, 0.0], [0.0, 0.0, 0.25]])
    np.testing.assert_allclose(sums, exact, rtol=1e-12, atol=1e-13)
    assert area == pytest.approx(np.pi, rel=1e-13)
    # The middle amplitude squared is x⁴, 3/8 in the mean over the circle.
    assert edge == pytest.approx(0.375 * 5e-4 * 2.0 * np.pi, rel=1e-9)
    assert 0.0 <= tail < 1e-8
    assert between == 0.0


@pytest.mark.parametrize("tol", [1e-3, 1e-7])
def test_error_that_is_told_holds_on_a_segment(tol):
    """The part of a disc with x < 1/2, whose corners lie far from even: area π − (π/3 − √3/4)."""
    clear = np.array([CIRCLE, powers((0, 0, 0.5), (1, 0, -1.0))])
    ranges, turning, corners = spans(clear, UNIT, 120, 200)
    assert corners == len(ranges) == 2
    assert not turning.any()  # the pivot is inside: one interval on every ray
    amp = powers((0, 0, 1.0))[None]
    sums, _, edge, tail, _ = products(clear, UNIT, np.zeros(2), ranges, turning, amp, *GAUSS, tol)
    off = abs(sums[0, 0] - (np.pi - np.pi / 3.0 + np.sqrt(3.0) / 4.0))
    assert off <= tail + 1e-13
    assert tail <= 2.0 * np.pi * tol
    assert edge == 0.0
