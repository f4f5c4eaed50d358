"""Maps without frames: those of the frames, term by term."""

import numpy as np
import pytest
from scroll_cases import fringes, layer, scene, zone
from test_nominal_image import edges, psf_of

from cgi_wave.fringes.maps import GroundFit, retrieve_ground, window
from cgi_wave.fringes.nominal_image import nominal_image
from cgi_wave.fringes.preparation import prepare
from cgi_wave.fringes.scroll import motion, stream
from cgi_wave.fringes.steady import SteadyFit


@pytest.mark.parametrize("modes", [1, 2])
def test_terms_are_those_that_the_frames_give(modes):
    """A PSF that varies along track, several spectral modes, rows left out of the window."""
    z = zone(48, 20, 9.0, 9.0, period=12.0, tilt=0.02)
    maps = scene(130, 40, modes=modes)
    pattern = np.array([fringes(z, 0.5 / (c + 1), 0.4 - 0.1 * c) for c in range(modes)])
    image = nominal_image(psf_of(z), edges(z), z, maps, 1e-12)
    assert len(image.along) > 1
    lit = np.ones(48, bool)
    lit[[0, 1, 20]] = False
    moves = motion(70)
    fit = window(z.phase, np.float64, lit)
    beams = prepare([layer(pattern)], maps, z, precision="float64", nominal=image, fractions=False)
    run, steady = GroundFit(fit, moves, 9, dtype=np.float64), SteadyFit(fit, pattern, image.along)
    count = 0
    for frame in stream(beams, moves):
        for ground, term, _, seen in run.add(frame):
            np.testing.assert_allclose(steady.terms(image.maps[:, :, ground - image.first]), term, atol=1e-12)
            assert seen == len(fit.rows)
            count += 1
    assert count > 20


def test_a_scene_without_a_psf():
    z = zone(40, 12, 2.0, 3.0, period=10.0)
    maps = scene(100, 20)
    beams = prepare([layer(fringes(z))], maps, z, precision="float64")
    moves = motion(50)
    found = retrieve_ground(stream(beams, moves), z.phase, moves, 2, dtype=np.float64)
    steady = SteadyFit(window(z.phase, np.float64), fringes(z)[None], np.ones((1, 40)))
    terms = np.array([steady.terms(maps[None, :, ground, 3:15]) for ground in found.ground])
    np.testing.assert_allclose(terms[:, 0], found.baseline, atol=1e-12)
    np.testing.assert_allclose(np.hypot(terms[:, 2], terms[:, 3]), found.modulation, atol=1e-12)
