"""Blurs: every method against the sum by definition, its bound, closed forms, conservation."""

import numpy as np
import pytest
from scipy.special import erf
from scroll_cases import gaussian, scene

from cgi_wave.fringes import blur

RNG = np.random.default_rng(8)
LOPSIDED = RNG.random((5, 7))
LOPSIDED /= LOPSIDED.sum()
BOX = np.zeros((7, 9))
BOX[1:5, 3:8] = 1.0 / 20.0  # off the middle: an offset as well as a width


def by_definition(image, kernel, wrap):
    height, width = image.shape
    out = np.zeros_like(image)
    half = np.array(kernel.shape) // 2
    for a in range(kernel.shape[0]):
        for b in range(kernel.shape[1]):
            rows = np.arange(height) + a - half[0]
            rows = rows % height if wrap else np.clip(rows, 0, height - 1)
            columns = np.clip(np.arange(width) + b - half[1], 0, width - 1)
            out += kernel[a, b] * image[np.ix_(rows, columns)]
    return out


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize(
    ("make", "kernel"),
    [(blur._direct, LOPSIDED), (blur._box, BOX), (blur._separable, gaussian(1.3)), (blur._fourier, LOPSIDED),
     (blur._separable, LOPSIDED), (blur._box, LOPSIDED), (blur._nothing, LOPSIDED)],
)  # fmt: skip
def test_each_method_keeps_its_bound(make, kernel, wrap):
    image = scene(31, 26)[0]
    how = make(kernel, image.size, False) if make is blur._fourier else make(kernel)
    found = blur.correlate(image, how, kernel, wrap)
    error = np.abs(found - by_definition(image, kernel, wrap)).max()
    assert error <= how.error + 2e-15
    if make in (blur._separable, blur._box, blur._nothing) and kernel is LOPSIDED:
        assert error > 0.01 * how.error  # the bound is not idle
        assert how.error > 0.05
    else:
        assert how.error < 1e-9


def test_single_precision_transform_keeps_its_bound():
    image, kernel = scene(64, 50)[0].astype(np.float32), gaussian(3.0)
    how = blur._fourier(kernel, image.size, True)
    found = blur.correlate(image, how, kernel, False)
    assert found.dtype == np.float32
    error = np.abs(found - by_definition(image.astype(float), kernel, False)).max()
    assert 0.0 < error <= how.error < 1e-4


def test_a_kernel_taller_than_a_repeating_map_folds_onto_it():
    image, kernel = scene(6, 10)[0], RNG.random((15, 3))
    kernel /= kernel.sum()
    found = blur.correlate(image, blur._fourier(kernel, image.size, False), kernel, True)
    np.testing.assert_allclose(found, by_definition(image, kernel, True), atol=1e-14)


def test_the_cheapest_allowed_method_is_chosen():
    sharp = np.zeros((3, 3))
    sharp[1, 1], sharp[0, 1] = 1.0 - 1e-6, 1e-6
    samples = 1_000_000
    assert blur.choose(None, 0.0, samples).method == "nothing"
    assert blur.choose(sharp, 1e-5, samples).method == "nothing"
    assert blur.choose(sharp, 1e-7, samples).method != "nothing"
    assert blur.choose(BOX, 1e-9, samples).method == "box"
    assert blur.choose(gaussian(2.0), 1e-9, samples).method == "separable"
    assert blur.choose(LOPSIDED, 1e-9, samples).method == "direct"
    disc = (np.hypot(*np.mgrid[-40:41, -40:41]) < 38).astype(float)
    assert blur.choose(disc / disc.sum(), 1e-9, samples).method == "fourier"


def test_line_source_through_a_gaussian_and_a_box():
    """A bright column one pixel wide: the kernel's own sums over columns come out."""
    image = np.zeros((5, 81))
    image[:, 40] = 1.0
    for kernel in (gaussian(4.0), BOX):
        how = blur.choose(kernel, 1e-9, image.size)
        found = blur.correlate(image, how, kernel, False)
        half = kernel.shape[1] // 2
        expected = np.zeros(81)
        expected[40 - half : 41 + half] = kernel.sum(axis=0)[::-1]
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-13)


def test_edge_through_a_gaussian_is_an_error_function():
    sigma = 6.0  # sums over whole pixels differ from the integral by g'/12, and g' of a Gaussian is 0.242/σ² at most
    image = np.where(np.arange(121) > 60, 1.0, 0.0) + np.where(np.arange(121) == 60, 0.5, 0.0)
    image = np.broadcast_to(image, (4, 121)).copy()
    kernel = gaussian(sigma, 6.0)
    found = blur.correlate(image, blur.choose(kernel, 1e-9, image.size), kernel, False)[0]
    np.testing.assert_allclose(
        found, 0.5 * (1 + erf((np.arange(121) - 60) / sigma / np.sqrt(2))), atol=1.02 * 0.242 / 12 / sigma**2
    )


@pytest.mark.parametrize("kernel", [gaussian(2.0), BOX, LOPSIDED])
def test_uniform_light_stays_what_it_is(kernel):
    image = np.full((40, 30), 0.7)
    for make in (blur._direct, blur._separable, blur._box):
        np.testing.assert_allclose(blur.correlate(image, make(kernel), kernel, False), 0.7, atol=1e-14)
    found = blur.correlate(image, blur._fourier(kernel, 1200, False), kernel, False)
    np.testing.assert_allclose(found, 0.7, atol=1e-14)


def test_wide_kernels_that_single_precision_does_not_keep_are_transformed_in_double():
    """A kernel of 40 000 taps: applied directly its tables would take 13 GB."""
    line = np.hanning(203)[1:-1] ** 2
    kernel = np.outer(line, line) + 0.3 * np.outer(line**3, line**2)
    kernel /= kernel.sum()
    found = blur.choose(kernel, 1e-9, 300 * 300, single=True)
    assert (found.method, found.single) == ("fourier", False)
    flat = blur.correlate(np.ones((1, 300, 300), dtype=np.float32), found, kernel, wrap=False)
    np.testing.assert_allclose(flat, 1.0, atol=1e-7)


@pytest.mark.parametrize("method", ["box", "separable", "direct", "fourier"])
@pytest.mark.parametrize("wrap", [False, True])
def test_a_part_is_that_of_a_map_that_goes_on(method, wrap):
    """Rows and columns beyond the map included, against the whole of a map continued by hand."""
    rng = np.random.default_rng(5)
    kernel = np.outer([1.0, 1.0, 1.0], np.ones(5)) if method == "box" else np.outer(rng.random(3), rng.random(5))
    if method in ("direct", "fourier"):
        kernel = rng.random((3, 5))
    kernel /= kernel.sum()
    ways = {"box": blur._box, "separable": blur._separable, "direct": blur._direct}
    how = ways[method](kernel) if method in ways else blur._fourier(kernel, 300, False)
    maps = rng.random((2, 20, 15))
    rows, columns = ((0, 20) if wrap else (-6, 27)), (-4, 9)
    tall = maps if wrap else np.pad(maps, ((0, 0), (10, 10), (0, 0)), mode="edge")
    whole = blur.correlate(np.pad(tall, ((0, 0), (0, 0), (10, 10)), mode="edge"), how, kernel, wrap)
    top = 0 if wrap else 10
    expected = whole[:, rows[0] + top : rows[1] + top, columns[0] + 10 : columns[1] + 10]
    np.testing.assert_allclose(blur.part(maps, how, kernel, wrap, rows, columns), expected, atol=1e-13)
