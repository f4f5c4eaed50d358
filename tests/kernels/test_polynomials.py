"""Polynomials on many lines at once, moved and expanded: against values at points."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import chebyshev, polynomial

from cgi_wave.kernels.polynomials import BATCH, affine, expanded, on_lines, on_rays, powers, taylors


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def random(rng: np.random.Generator, n: int) -> np.ndarray:
    """Coefficients (n, n) with i + j < n."""
    i = np.arange(n)
    return np.where(i[:, None] + i < n, rng.standard_normal((n, n)), 0.0)


@pytest.mark.parametrize("n", [1, 5, 14])
def test_rays_and_lines(rng, n):
    coef, angle, y, r = random(rng, n), rng.uniform(0.0, 6.3, BATCH), rng.uniform(-1.0, 1.0, BATCH), 0.7
    out, power = np.empty((BATCH, n)), np.empty((n, BATCH))
    c, s = np.cos(angle), np.sin(angle)
    powers(c, power)
    on_rays(coef, power, s, out)
    along = [polynomial.polyval(r, line) for line in out]
    np.testing.assert_allclose(along, polynomial.polyval2d(r * c, r * s, coef), rtol=0, atol=1e-13)
    on_lines(coef, y, out)
    along = [polynomial.polyval(r, line) for line in out]
    np.testing.assert_allclose(along, polynomial.polyval2d(np.full(BATCH, r), y, coef), rtol=0, atol=1e-13)


def test_taylor_coefficients(rng):
    n = 9
    lines, x, out = rng.standard_normal((BATCH, n)), rng.uniform(-1.0, 1.0, BATCH), np.empty((n + 2, BATCH))
    few = np.empty((4, BATCH))
    taylors(lines, x, out)
    taylors(lines, x, few)
    np.testing.assert_array_equal(few, out[:4])
    assert not out[n:].any()
    for line, at, moved in zip(lines, x, out.T, strict=True):
        assert polynomial.polyval(0.3, moved) == pytest.approx(polynomial.polyval(at + 0.3, line), abs=1e-12)


def test_moved_without_turning_as_with(rng):
    """A turn by nothing takes the short way, one by a rounding error the long one."""
    coef = random(rng, 8)
    short = affine(coef, 0.1, -0.2, 0.9, 0.0, 0.0, 0.7)
    np.testing.assert_allclose(short, affine(coef, 0.1, -0.2, 0.9, 1e-300, 0.0, 0.7), rtol=1e-12, atol=1e-13)
    x, y = 0.1 + 0.9 * 0.4, -0.2 + 0.7 * -0.3
    assert polynomial.polyval2d(0.4, -0.3, short) == pytest.approx(polynomial.polyval2d(x, y, coef), abs=1e-13)


@pytest.mark.parametrize(("k", "n"), [(1, 1), (4, 6), (12, 12)])
def test_chebyshev_products_as_powers(rng, k, n):
    coef = np.array([random(rng, k), random(rng, k)])
    shift, stretch, at = np.array([0.1, -0.2]), np.array([0.5, 0.8]), np.array([0.3, -0.6])
    for before, after in zip(coef, expanded(coef, shift, stretch, n), strict=True):
        value = chebyshev.chebval2d(*(shift + stretch * at), before)
        assert polynomial.polyval2d(*at, after) == pytest.approx(value, abs=1e-12)
