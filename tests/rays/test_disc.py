"""Points on discs and polynomials through them."""

import numpy as np
import pytest

from cgi_wave.rays.disc import NODES, disc, fitted, monomial_powers, monomials, on_disc


def test_a_disc_moved_and_stretched_is_the_disc_again():
    x, centre, half = on_disc(np.array([3e-3, -1e-3]) + 0.016 * disc(NODES))
    np.testing.assert_allclose(x, disc(NODES), atol=1e-13)
    np.testing.assert_allclose([*centre, half], [3e-3, -1e-3, 0.016], rtol=1e-12)


@pytest.mark.parametrize("kept", [NODES, NODES - 1, 200])
def test_polynomials_come_back(kept):
    """Kept factors of the whole disc, and factors of a part of it: the same coefficients."""
    p = np.array([3e-3, -1e-3]) + 0.016 * disc(NODES)[:kept]
    x, _, _ = on_disc(p)
    exact = np.random.default_rng(0).normal(size=(len(monomial_powers(6)), 2))
    np.testing.assert_allclose(fitted(x, monomials(x, 6) @ exact, 6), exact, atol=1e-9)
