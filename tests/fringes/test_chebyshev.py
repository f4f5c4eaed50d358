"""Reduction of a spectral sum to few nodes, and interpolation."""

import numpy as np
import pytest

from cgi_wave.fringes import chebyshev


def test_compressed_sum_is_exact_for_polynomials_below_the_node_count():
    rng = np.random.default_rng(0)
    sigma = np.sort(rng.uniform(2.0, 5.0, 1000))
    weight = rng.uniform(0.0, 1.0, (2, 1000))
    node, reduced = chebyshev.compress(sigma, weight, 12, 2.0, 5.0)
    for degree in (0, 5, 11):
        np.testing.assert_allclose(reduced @ node**degree, weight @ sigma**degree, rtol=1e-12)
    assert abs(reduced[0] @ node**14 / (weight[0] @ sigma**14) - 1.0) > 1e-9  # and only below it


@pytest.mark.parametrize("bandwidth", [0.01, 3.0, 60.0, 1500.0])
def test_degree_holds_the_exponential_and_the_tail_says_so(bandwidth):
    count = chebyshev.degree_for(bandwidth)
    x = chebyshev.nodes(count, -1.0, 1.0)
    target = np.linspace(-1.0, 1.0, 333)
    found = chebyshev.interpolation_matrix(x, target) @ np.exp(1j * bandwidth * x)
    error = np.abs(found - np.exp(1j * bandwidth * target))
    assert error.max() < 1e-12 * max(1.0, bandwidth)
    assert chebyshev.tail(np.exp(1j * bandwidth * x)) < 1e-11
    short = chebyshev.nodes(max(int(0.8 * bandwidth), 1), -1.0, 1.0)  # below the bandwidth, the tail raises its hand
    assert chebyshev.tail(np.exp(1j * bandwidth * short)) > 1e-3


def test_interpolation_and_derivative_of_a_polynomial():
    x = chebyshev.nodes(6, 1.0, 3.0)
    target = np.append(np.linspace(1.0, 3.0, 7), x[2])  # a node among the targets
    np.testing.assert_allclose(chebyshev.interpolation_matrix(x, target) @ x**5, target**5, rtol=1e-13)
    np.testing.assert_allclose(chebyshev.derivative_matrix(x) @ x**5, 5.0 * x**4, rtol=1e-11)
    assert chebyshev.derivative_matrix(x[:1]) == 0.0
