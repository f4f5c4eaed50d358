"""PSFs stand where the rays land, carry the beam's power, and say so where they are rays only."""

import numpy as np
import pytest

from cgi_wave.budget import pictures
from cgi_wave.budget.pointsource import point_source
from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.beams import nominal_direction
from cgi_wave.rays.paths import find_paths

LABELS = ("detector:r arms 1-1", "plate1_back:r arms 1", "cube_arm1:r arms 1")


@pytest.fixture(scope="module")
def system():
    return load_instrument().band("NIR")


@pytest.fixture(scope="module")
def source(system):
    """A refocused ghost, one out of focus by 0.1 mm RMS, and one too large for the transform; no contrasts."""
    found = find_paths(system, max_order=1)
    paths = [*found[:2], *(next(path for path in found if path.label == label) for label in LABELS)]
    x0 = system.field_points()[0]
    return point_source(system, paths, nominal_direction(system, paths[0], x0), x0, orders=0)


@pytest.fixture(scope="module")
def psfs(system, source):
    return {picture["label"]: picture for picture in pictures.psf_pictures(system, source)}


def moments(picture):
    """Centroid and RMS of a picture, m, (x, y) each."""
    weight = np.asarray(picture["psf"]) / np.sum(picture["psf"])
    found = []
    for axis, marginal in ((picture["x_m"], weight.sum(axis=0)), (picture["y_m"], weight.sum(axis=1))):
        centre = marginal @ axis
        found.append((centre, np.sqrt(marginal @ (axis - centre) ** 2)))
    return np.array(found).T


def test_nominal_psf_stands_on_the_spot_within_diffraction(source, psfs):
    picture = psfs[pictures.NOMINAL]
    centre, rms = moments(picture)
    airy = 0.764e-6 * 4.0
    assert picture["x_m"][1] - picture["x_m"][0] == pytest.approx(0.3 * airy, rel=0.2)
    assert np.abs(centre).max() < 0.1 * airy
    # Diffraction adds its own width, which the window keeps finite; the spot is well below λ·F#.
    assert np.all(rms > source.nominal_spot.rms) and np.all(rms < source.nominal_spot.rms + airy)
    assert 0.95 < picture["share"] < 1.0


@pytest.mark.parametrize("number", [0, 1])
def test_ghost_psf_has_centroid_size_and_power_of_its_rays(source, psfs, number):
    here, picture = source.ghosts[number].spot, psfs[LABELS[number]]
    centre, rms = moments(picture)
    np.testing.assert_allclose(centre, here.centroid - source.nominal_spot.centroid, atol=1e-7)
    slack = 2e-6 if number == 0 else 0.01 * here.rms[0]
    np.testing.assert_allclose(rms, here.rms, atol=slack)
    assert 0.98 < picture["share"] < 1.0


def test_a_ghost_too_large_for_the_transform_is_shown_by_its_rays(source, psfs):
    here, picture = source.ghosts[2].spot, psfs[LABELS[2]]
    assert picture["share"] is None and picture["method"].startswith("geometric (padded FFT")
    centre, rms = moments(picture)
    np.testing.assert_allclose(centre, here.centroid - source.nominal_spot.centroid, atol=1e-6)
    np.testing.assert_allclose(rms, here.rms, rtol=0.02)


def test_irradiance_maps_share_one_scale_and_hold_their_power(source):
    maps = pictures.spot_pictures(source)
    assert maps[0]["label"] == pictures.NOMINAL and {here["label"] for here in maps[1:]} == set(LABELS)
    assert [here["power"] for here in maps] == sorted((here["power"] for here in maps), reverse=True)
    for here in maps:
        np.testing.assert_array_equal(here["x_m"], maps[0]["x_m"])
        cell = (here["x_m"][1] - here["x_m"][0]) * (here["y_m"][1] - here["y_m"][0])
        assert here["irradiance"].sum() * cell == pytest.approx(here["power"], rel=1e-3)
    assert maps[0]["power"] == 1.0
