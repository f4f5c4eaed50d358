"""Nominal PSFs and mutual kernels of the reference instrument: against its rays, mirrored, and the light they lose."""

import numpy as np
import pytest

from cgi_wave.budget.fringefield import traced_point
from cgi_wave.budget.nominal_psf import HALF, assembled, directions_to_pixels, point_psf, psf_points
from cgi_wave.rays.beams import rays_to_point

CENTRE = np.array([0.0, -3.84e-3])
SIDE = np.array([5.0e-3, -6.0e-3])


@pytest.fixture(scope="module")
def kernels(setting, paths):
    """At the zone's centre, and at two places that mirror each other."""
    return [point_psf(setting, paths[:2], place) for place in (CENTRE, SIDE, SIDE * [-1.0, 1.0])]


def test_kernels_are_shares_of_the_light(setting, paths, kernels):
    """Sum 1, nothing negative; what is beyond the window is what a round pupil's edge scatters there."""
    _, to_pixels = directions_to_pixels(setting.system, paths[0], CENTRE)
    pixel = 1.0 / np.abs(np.diag(to_pixels)).mean()
    law = 1.0 / (np.pi**2 * setting.system.sigma0 * setting.system.pupil_radius * (HALF + 0.5) * pixel)
    for found in kernels:
        assert found.kernel.shape == (2 * HALF + 1, 2 * HALF + 1)
        assert found.kernel.sum() == pytest.approx(1.0, rel=1e-12) and found.kernel.min() > 0.0
        assert 0.8 * law < found.outside < 1.2 * law  # a square, and polygons of stops: not quite a disc's
        assert 0.0 < found.arms < 0.05


def test_the_instrument_mirrored_has_the_kernel_mirrored(kernels):
    """All its surfaces are symmetric in x: the sense of columns is right, and of rows not turned with them."""
    _, here, there = (found.kernel for found in kernels)
    np.testing.assert_allclose(here, there[:, ::-1], atol=2e-5)
    assert np.abs(here - there).max() > 0.02 and np.abs(here - here[::-1]).max() > 0.02


def test_kernels_stand_where_the_rays_do(setting, paths, kernels):
    """Their middle is that of the rays that end on the point, and they are wider by the boxes of cell and pixel."""
    sigma = np.array([setting.system.sigma0])
    inner = slice(HALF - 4, HALF + 5)
    offset = np.arange(-4, 5)
    for place, found in zip((CENTRE, SIDE), kernels, strict=False):
        theta, to_pixels = directions_to_pixels(setting.system, paths[0], place)
        rays = rays_to_point(setting.system, paths[0], place, sigma, theta)
        lit = rays.even & (rays.clearance[:, 0] > 0).all(axis=0)
        weight = rays.amplitude[0, lit] ** 2
        at = (rays.theta[0, lit] - theta) @ to_pixels.T
        middle = weight @ at / weight.sum()
        core = found.kernel[inner, inner] / found.kernel[inner, inner].sum()
        assert core.sum(axis=0) @ offset == pytest.approx(middle[0], abs=0.03)
        assert core.sum(axis=1) @ offset == pytest.approx(middle[1], abs=0.03)
        spread = weight @ (at - middle) ** 2 / weight.sum() + 1.0 / 6.0  # each box adds 1/12 of a pixel squared
        for axis, expected in zip((0, 1), spread, strict=True):
            line = core.sum(axis=axis)
            found_here = line @ offset**2 - (line @ offset) ** 2
            assert expected < found_here < expected + 0.2  # diffraction spreads it further, within ±4 pixels


def test_nodes_come_first_and_checks_last(kernels):
    zone = (-7.68e-3, 7.68e-3, -7.68e-3, 0.0)
    x, y, places = psf_points(zone, ((0.5, -0.25),), (1, 2))
    assert places[-1] == pytest.approx([-1.92e-3, -1.92e-3])
    made = assembled(kernels, x, y, places)
    assert made.kernel.shape == (1, 2, 49, 49) and made.check.shape == (1, 49, 49)
    np.testing.assert_array_equal(made.kernel[0, 1], kernels[1].kernel)
    assert made.outside == max(found.outside for found in kernels)


def test_mutual_kernels_of_the_filters_and_the_plates_ghosts(setting, paths):
    """Of sum 0; small for a ghost out of coherence with the nominal beam, large where fringes lie in the blur."""
    chosen = [
        p
        for p in paths[2:]
        if p.order == 1 and p.history[0][0] in ("filter_front", "plate1_back") and p.history[0][1] == "reflect"
    ]
    point = traced_point(setting, [*paths[:2], *chosen], CENTRE, 1e-3, dense=True)
    assert set(point.mutual) == set(point.pairs) and len(point.pairs) > 6
    for key, kernel in point.mutual.items():
        assert abs(kernel.apart.sum()) < 1e-9 and kernel.apart.shape[0] % 2 == 1
        contrast = float(np.abs(point.pairs[key].gamma).max())
        if "nominal" in key[0] and "nominal" in key[1]:
            assert kernel.most == 0.0
        elif "nominal" in key[0]:
            assert np.abs(kernel.apart).sum() <= kernel.most < 0.01
        elif contrast > 0.99:
            assert kernel.most < 0.05  # |κ − γ·blur| ≤ √(1 − γ²)
        else:
            assert kernel.most <= np.sqrt(1.0 - min(contrast, 1.0) ** 2) + 0.02
    assert max(kernel.most for kernel in point.mutual.values()) > 0.9
