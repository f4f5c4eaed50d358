"""Maps over the ground: noise against its prediction, error statistics, ghosts beside bright edges, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from scroll_cases import fringes, gaussian, layer, zone

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.fringes.detector import Detector
from cgi_wave.fringes.maps import albedo_contrast, bias_by_contrast, nma_errors, retrieve_ground, window
from cgi_wave.fringes.preparation import prepare
from cgi_wave.fringes.scroll import motion, stream

PERIOD = 12.0


def maps_of(layers, image, z, frames, detector=None, seed=0):
    moves = motion(frames)
    beams = prepare(layers, image, z, precision="float64")
    sequence = stream(beams, moves)
    if detector is not None:
        sequence = (detector.record(frame, k, seed)[0] for k, frame in enumerate(sequence))
    return retrieve_ground(sequence, z.phase, moves, detector=detector, dtype=np.float64)


def test_standard_error_is_the_scatter_of_noisy_maps():
    z = zone(60, 40, period=PERIOD)
    camera = Detector(2e4, 60.0, shot="gaussian")
    found = maps_of([layer(fringes(z))], np.ones((1, 300, 40)), z, 160, camera)
    scatter = found.nma.std(axis=None)
    assert scatter == pytest.approx(np.sqrt(np.mean(found.nma_error**2)), rel=0.05)
    assert found.nma.mean() == pytest.approx(0.4, abs=4 * scatter / np.sqrt(found.nma.size) + scatter**2)


def test_ghost_of_known_power_and_its_statistics():
    """Light without fringes of power p·B lowers the NMA by p/(1 + p), everywhere alike under a uniform scene."""
    z = zone(60, 10, period=PERIOD)
    ghost = layer(np.full(z.shape, 0.03 * 0.5), [[1.0, 0, 0], [0, -1.0, 0]])
    clean = maps_of([layer(fringes(z))], np.ones((1, 160, 10)), z, 75)
    dirty = maps_of([layer(fringes(z)), ghost], np.ones((1, 160, 10)), z, 75)
    found = nma_errors(clean, dirty)
    for value in (found.mean, found.low, found.high, found.size_95):
        assert value == pytest.approx(0.03 / 1.03, rel=1e-9)
    assert found.spread < 1e-12 and found.unlit == 0


def test_dark_ground_beside_bright_loses_most():
    """A blurred ghost carries bright ground's light onto dark ground: closed form, and error falling with contrast."""
    z = zone(60, 40, period=PERIOD)
    image = np.full((1, 200, 40), 0.2)
    image[:, :, 20:] = 1.0
    kernel = gaussian(3.0)
    ghost = layer(np.full(z.shape, 0.02 * 0.5), None, kernel)
    clean = maps_of([layer(fringes(z))], image, z, 75)
    dirty = maps_of([layer(fringes(z)), ghost], image, z, 75)
    found = nma_errors(clean, dirty)
    line = kernel.sum(axis=0)
    half = len(line) // 2
    padded = np.pad(image[0, 0], half, mode="edge")
    blurred = np.convolve(padded, line, mode="valid")
    share = 0.02 * blurred / image[0, 0]
    np.testing.assert_allclose(found.error, np.broadcast_to(share / (1 + share), found.error.shape), rtol=1e-6)
    relation = bias_by_contrast(found.error, albedo_contrast(clean.baseline, 9), 6)
    assert relation.slope < 0.0 and relation.correlation < -0.8
    assert relation.mean[0] > relation.mean[-1]
    assert relation.count.sum() == found.error.size


def test_contrast_and_bins_of_known_maps():
    flat = np.full((20, 20), 0.3)
    np.testing.assert_allclose(albedo_contrast(flat), 0.0, atol=1e-15)
    contrast = np.linspace(-1.0, 1.0, 400).reshape(20, 20)
    found = bias_by_contrast(0.01 - 0.02 * contrast, contrast, 8)
    assert found.slope == pytest.approx(-0.02) and found.correlation == pytest.approx(-1.0)
    np.testing.assert_allclose(found.mean, 0.01 - 0.02 * found.centre, atol=1e-15)
    with pytest.raises(InputError, match="same everywhere"):
        bias_by_contrast(flat, flat)


def test_refusals():
    z = zone(60, 4, period=PERIOD)
    with pytest.raises(MethodLimitError, match="samples per fringe") as caught:
        window(zone(60, 4, period=3.0).phase)
    assert caught.value.factor == pytest.approx(4.0 / 3.0)
    with pytest.raises(MethodLimitError, match="whole fringe"):
        window(zone(60, 4, period=200.0).phase)
    with pytest.raises(InputError, match="no ground point"):
        retrieve_ground([fringes(z)] * 9, z.phase, motion(9))
    with pytest.raises(InputError, match="more than the motion"):
        retrieve_ground([fringes(z)] * 70, z.phase, motion(69))
    found = maps_of([layer(fringes(z))], np.ones((1, 160, 4)), z, 75)
    with pytest.raises(InputError, match="do not cover"):
        nma_errors(found, replace(found, ground=found.ground + 1))
    with pytest.raises(MethodLimitError, match="no NMA above"):
        nma_errors(replace(found, nma=0.0 * found.nma), found)


@pytest.mark.parametrize("seed", [1, 2])
def test_rows_in_dead_zones_take_no_part(seed):
    """Noise, darkness or anything else in shaded rows inside the window changes no bit of the maps."""
    z = zone(60, 8, period=PERIOD)
    lit = np.ones(60, bool)
    lit[[0, 1, 2, 30, 57, 58, 59]] = False
    frames = [frame.copy() for frame in stream(prepare([layer(fringes(z))], np.ones((1, 160, 8)), z), motion(75))]
    clean = retrieve_ground(frames, z.phase, motion(75), lit=lit)
    rng = np.random.default_rng(seed)
    for k, frame in enumerate(frames):
        frame[~lit] = 0.0 if k % 2 else rng.normal(5.0, 9.0, (7, 8))
    dirty = retrieve_ground(frames, z.phase, motion(75), lit=lit)
    for name in ("baseline", "modulation", "nma", "phase"):
        np.testing.assert_array_equal(getattr(dirty, name), getattr(clean, name))
    np.testing.assert_allclose(clean.nma, 0.4, rtol=1e-5)
    assert clean.window == 53 and set(window(z.phase, lit=lit).rows) == set(np.flatnonzero(lit))
    spoilt = retrieve_ground(frames, z.phase, motion(75))
    assert np.abs(spoilt.nma - 0.4).max() > 1e-2


def test_a_zone_all_in_shadow_is_refused():
    with pytest.raises(MethodLimitError, match="outside dead zones"):
        window(zone(60, 4, period=PERIOD).phase, lit=np.zeros(60, bool))
