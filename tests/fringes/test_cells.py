"""Blurs by cells of the scene: what they are by definition, and that their bound holds and says something."""

import numpy as np
import pytest
from scroll_cases import gaussian, scene

from cgi_wave.fringes import blur
from cgi_wave.fringes.cells import EPSILON, cells, coarse


def grainy(rng, height, width):
    """A kernel drawn by rays: a wide blur with the noise of counts."""
    kernel = rng.poisson(20.0, (height, width)).astype(float)
    kernel[np.hypot(*np.ogrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]) > 1.0] = 0.0
    return kernel / kernel.sum()


def exact_at(maps, kernel, rows, columns):
    """The blurred scene at some samples, its edge going on, by the definition."""
    tall, wide = kernel.shape[0] // 2, kernel.shape[1] // 2
    out = np.empty((len(maps), len(rows), len(columns)))
    for i, row in enumerate(rows):
        along = np.clip(np.arange(row - tall, row + tall + 1), 0, maps.shape[1] - 1)
        for j, column in enumerate(columns):
            across = np.clip(np.arange(column - wide, column + wide + 1), 0, maps.shape[2] - 1)
            out[:, i, j] = (kernel * maps[:, along[:, None], across]).sum(axis=(1, 2))
    return out


@pytest.mark.parametrize("step", [2, 4, 8, 16])
@pytest.mark.parametrize("size", [(33, 41), (65, 37)])
def test_the_bound_holds_and_is_no_phrase(step, size):
    """In the middle of the scene, across its edges and beyond; two modes, one of them of any sign."""
    rng = np.random.default_rng(step)
    kernel = grainy(rng, *size)
    maps = scene(75, 70, modes=2)
    maps[1] -= 0.5
    blurred, ground = coarse(kernel, step), cells(maps, step)
    bound = blurred.error(ground)
    rows, columns = (-3, 75 // step + 4), (-2, 70 // step + 3)
    found = blurred.image(ground, rows, columns)
    middles = [np.arange(*span) * step + step // 2 for span in (rows, columns)]
    error = np.abs(found - exact_at(maps, kernel, *middles)).max(axis=(1, 2))
    assert np.all(error <= bound)
    assert np.all(bound < 60.0 * error)
    assert blurred.weights.sum() == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("step", [2, 4, 8])
def test_nothing_is_lost_where_scene_or_kernel_is_even_in_cells(step):
    rng = np.random.default_rng(1)
    count = 5
    even = np.kron(rng.random((count, count)), np.ones((step, step)))
    # cells of offsets begin at −(step // 2): pad to a size that is odd, and has them there
    half = (count * step) // 2 + step // 2 + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    first = half - step // 2 - (count // 2) * step
    kernel[first : first + count * step, first : first + count * step] = even / even.sum()
    maps = scene(12 * step, 10 * step)
    blurred = coarse(kernel, step)
    assert blurred.grain < 1e-9
    at = np.arange(2, 8) * step + step // 2
    found = blurred.image(cells(maps, step), (2, 8), (2, 8))
    np.testing.assert_allclose(found, exact_at(maps, kernel, at, at), atol=2.0 * EPSILON)
    blocks = np.kron(scene(12, 10)[0], np.ones((step, step)))[None]
    noisy = coarse(grainy(rng, 4 * step + 1, 4 * step + 1), step)
    ground = cells(blocks, step)
    assert float(ground.unrest.max()) < 1e-12 and np.all(noisy.error(ground) < 1e-6)


def test_an_even_scene_stays_as_it_is():
    ground = cells(np.full((1, 40, 50), 0.3), 4)
    np.testing.assert_allclose(coarse(gaussian(5.0), 4).image(ground, (-4, 14), (-4, 16)), 0.3, rtol=2e-7)


def test_parts_of_a_blur_join_without_a_seam():
    """Rows are convolved strip by strip: many at once and few at a time are the same."""
    maps, kernel = scene(900, 40), gaussian(6.0)
    how = blur.choose(kernel, 0.0, maps.size)
    full = blur.part(maps, how, kernel, False, (-30, 930), (3, 37))
    for rows in ((-30, 100), (100, 611), (611, 930)):
        np.testing.assert_allclose(
            blur.part(maps, how, kernel, False, rows, (3, 37)), full[:, rows[0] + 30 : rows[1] + 30], atol=1e-13
        )
    whole = blur.correlate(np.pad(maps, [(0, 0), (60, 60), (0, 0)], mode="edge"), how, kernel, False)
    np.testing.assert_allclose(full, whole[:, 30:990, 3:37], atol=1e-13)
