"""The two closed forms of ghosts that pass the interferometer again, on the reference instrument's traced rays."""

from functools import cache

import numpy as np
import pytest
from chain_cases import (
    account,
    displacement,
    even_pupil,
    face_power,
    family,
    filter_at,
    filter_face,
    landed_from,
    landing_power,
    pupil_field,
    retro_power,
    with_splitter_phase,
)

from cgi_wave.fringes.nma import nma_error_exact
from cgi_wave.rays.beams import nominal_direction, rays_to_point, spot
from cgi_wave.rays.trace import compile_sequence, trace
from cgi_wave.scene.coherence import coherence
from cgi_wave.scene.filters import Filter
from cgi_wave.wave.field import power

#: y blur of the intermediate image at the mirrors, m rms: the nominal fringes lose 3e-4 of their contrast by it.
NOMINAL_BLUR = 2.8e-6


@pytest.fixture(scope="module")
def retro(nir, setting, paths):
    """Detector's retro-ghost: account in monochromatic light."""
    return account(nir, setting, family(paths, "detector"))


@pytest.fixture(scope="module")
def blur(nir, paths, retro):
    """Phase, rad rms, by which the retro-ghost smears the fringes of its first pass, from traced rays.

    Its rays come back to the detector some micrometres off where they left it (4.6 µm rms in y), the fringes are
    676 µm long; what the ghost leaves uncancelled is of the order of half the square of this phase.
    """
    ghost = next(path for path in paths if path.label == "detector:r arms 1-2")
    off = displacement(nir, ghost, paths[0], nir.field_points()[0])
    assert off.std() < 8e-6
    return 2 * np.pi * (off.std() + NOMINAL_BLUR) / retro.fringe_period


def test_retro_ghost_has_the_power_of_its_coatings(instrument, retro):
    """Four beams of ρτ²/4 of a nominal one each: no light is lost on the way, none is counted twice."""
    t = retro.point.coherency.transmission
    np.testing.assert_allclose(t[2:] / t[:2].mean(), retro_power(instrument) / 4, rtol=1e-4)
    assert retro.retrieval.paper.offset_over_baseline.value == pytest.approx(retro_power(instrument) / 2, rel=1e-4)


def test_retro_ghost_halves_its_baseline_and_doubles_its_frequency(instrument, retro, blur):
    """N(1 − N) = (1 − cos 2φ)/8: O/B = ρτ²/4, nothing at the fringe frequency, ρτ²/4 at twice of it, NMA falls."""
    rt2, got = retro_power(instrument), retro.retrieval.coherent
    loss = 0.5 * blur**2
    assert 1e-4 < loss < 4e-3
    assert got.offset_over_baseline.value == pytest.approx(rt2 / 4, rel=loss + 1e-4)
    assert abs(got.parasitic_over_modulation.value) < 1.2 * rt2 / 2 * loss
    # The doubled fringe is that of pair (1,1)–(2,2), whose blur is the nominal one's twice and the ghost's once.
    assert got.second_over_modulation == pytest.approx(rt2 / 4, rel=4 * loss)
    assert got.nma_error.value > 0
    assert got.nma_error.value == pytest.approx(nma_error_exact(0.0, rt2 / 4), rel=3 * loss)


def test_arm_pairs_of_equal_length_cancel(nir, paths, retro):
    """Pairs (1,2) and (2,1) are opposite; what is left is the mean of exp(i 2πδy/Λ) over rays traced on their own."""
    gamma = retro.gamma("detector:r arms 1-2", "detector:r arms 2-1")
    ghost = next(path for path in paths if path.label == "detector:r arms 1-2")
    off = displacement(nir, ghost, paths[0], nir.field_points()[0])
    mean = np.exp(2j * np.pi * off / retro.fringe_period).mean()
    assert gamma.real < -0.998
    assert abs(gamma) == pytest.approx(abs(mean), abs=3e-5)
    assert abs(np.angle(-gamma)) < 0.01


def test_wrong_splitter_phase_turns_the_sign(instrument, setting, paths, retro, blur):
    """Both reflections alike (which makes energy): the ghost is N², O/B = 3ρτ²/4 and M*/M = ρτ²; the NMA rises."""
    system = with_splitter_phase(instrument, 0.0, "NIR")
    got = account(system, setting, family(paths, "detector")).retrieval.coherent
    rt2, loss = retro_power(instrument), 0.5 * blur**2
    assert got.offset_over_baseline.value == pytest.approx(0.75 * rt2, rel=loss)
    assert got.parasitic_over_modulation.value == pytest.approx(rt2, rel=loss)
    assert got.nma_error.value == pytest.approx(nma_error_exact(rt2, 0.75 * rt2), rel=3 * loss)
    assert got.nma_error.value < -0.01 < 0.01 < retro.retrieval.coherent.nma_error.value


def test_retro_ghost_in_the_bands_own_light(instrument, nir, setting, paths, retro, blur):
    """The same under the O2 A band: O/B stays; the doubled fringe takes the coherence at twice the OPD, 2.66 mm."""
    real = account(nir, setting, family(paths, "detector"), real_light=True).retrieval
    rt2, loss = retro_power(instrument), 0.5 * blur**2
    assert real.coherent.offset_over_baseline.value == pytest.approx(rt2 / 4, rel=loss + 2e-4)
    assert abs(real.coherent.parasitic_over_modulation.value) < 1.2 * rt2 / 2 * loss
    spec = nir.spec.filter
    band_filter = Filter(spec.centre_nm * 1e-9, spec.fwhm_nm * 1e-9, spec.shape)
    once, twice = np.abs(coherence(setting.spectrum, band_filter, [1.33e-3, 2.66e-3]))
    assert real.nominal.nma.value == pytest.approx(once, rel=2e-3)
    # The coherence at 2.66 mm changes by 6 % over the zone's 15 µm of path difference: its mean is not its middle.
    assert real.coherent.second_over_modulation == pytest.approx(rt2 / 4 * twice / once, rel=0.06)


# ------------------------------------------------------------------------------------------------ filter face


@pytest.fixture(scope="module")
def face_blur(blur):
    """As ``blur``, for the radius of the blurred disc (twice its rms along y)."""
    return 2 * blur


@pytest.fixture(scope="module")
def at(instrument, setting, paths):
    """System and account of the filter's retro-ghost with the filter at a distance, kept."""

    @cache
    def run(gap):
        system = filter_at(instrument, "NIR", gap)
        return system, account(system, setting, family(paths, "filter_front"))

    return run


@pytest.mark.parametrize("gap", [1.0, 0.2, 2.0, 4.0])
def test_filter_face_at_a_distance(instrument, paths, at, face_blur, gap):
    """O/B = (R/2)(1 − J/2), M*/M = −(R/2)(1 − J): beams of half the path smear the fringes of their first pass away.

    The closed form has a plane fringe pattern and perfect foci. The blur of relay and objective may change z by its
    radius in radians of fringe, and J by 0.37 of that, the steepest slope of 2J1(z)/z.
    """
    system, got = at(gap)
    x0 = system.field_points()[0]
    near = spot(system, paths[0], nominal_direction(system, paths[0], x0), system.sigma0)
    assert np.hypot(*near.rms) < 5e-6, "the filter's glass is as it was: the focus stays"
    want = filter_face(instrument, system, paths[0], got.fringe_period)
    assert want.distance == pytest.approx((2.4282 / 1.4539 + gap) * 1e-3, rel=1e-4)
    t = got.point.coherency.transmission
    np.testing.assert_allclose(t[2:] / t[:2].mean(), want.kappa * face_power(instrument) / 4, rtol=1e-3)
    half, slack = face_power(instrument) / 2, 0.37 * face_blur
    assert slack < 0.055
    coherent, j = got.retrieval.coherent, -got.gamma("filter_front:r arms 1-2", "filter_front:r arms 2-1").real
    assert j == pytest.approx(want.j, abs=slack)
    assert coherent.offset_over_baseline.value == pytest.approx(want.offset, abs=half * (slack / 2 + 1e-3))
    assert coherent.parasitic_over_modulation.value == pytest.approx(want.parasitic, abs=half * (slack + 1e-3))
    assert coherent.parasitic_over_modulation.value < -0.02


@pytest.mark.parametrize("gap", [0.2, 1.0, 2.0])
def test_filter_face_against_its_own_rays(paths, at, gap):
    """The same J as the mean of exp(i 2πδy/Λ) over the traced blur, aberrations and all: closer by a factor of 30.

    1e-3 is the limit of that picture: the fringes lie at two sloped faces 1.5 mm apart, not in one plane.
    """
    system, got = at(gap)
    ghost = next(path for path in paths if path.label == "filter_front:r arms 1-2")
    off = displacement(system, ghost, paths[0], system.field_points()[0])
    mean = np.exp(2j * np.pi * off / got.fringe_period).mean()
    gamma = got.gamma("filter_front:r arms 1-2", "filter_front:r arms 2-1")
    assert abs(gamma) == pytest.approx(abs(mean), abs=1e-3)


# ------------------------------------------------------------------------------------------------ power at a point


@pytest.mark.parametrize(
    ("label", "half"),
    [("nominal arms 1", 3e-4), ("detector:r arms 1-2", 3e-4), ("filter_front:r arms 2-1", 3e-4),
     ("filter_back:r arms 1-1", 3e-4), ("detector:r filter_front:r arms 1-2-2", 3e-4), ("L2_back:r arms 1-2", 2e-3)],
)  # fmt: skip
def test_power_at_a_point_is_what_lands_there(nir, paths, label, half):
    """∫A² d²p of rays aimed at x0 is the light that random rays of a uniform scene bring to a square about x0."""
    path = next(path for path in paths if path.label == label)
    x0 = nir.field_points()[0]
    field = pupil_field(nir, path, x0, nominal_direction(nir, paths[0], x0))
    landed, relative = landing_power(nir, path, x0, half, 200_000)
    assert relative < 0.05
    assert power(field)[0][0] == pytest.approx(landed, rel=4 * relative)


@pytest.mark.parametrize("field", range(5))
@pytest.mark.parametrize("arms", ["1-2", "2-2"])
def test_a_ghost_that_images_the_pupil_is_found(nir, paths, arms, field):
    """Off the front of L3 the pupil lies nearly on the detector: a hundredth of it or less feeds a point.

    The light that lands is a quarter of a thousandth of the nominal beams, over the whole detector.
    """
    path = next(path for path in paths if path.label == f"L3_front:r arms {arms}")
    x0 = nir.field_points()[field]
    rays = rays_to_point(nir, path, x0, np.array([nir.sigma0]), nominal_direction(nir, paths[0], x0))
    lit = (rays.clearance[:, 0] > 0).all(axis=0)
    assert np.ptp(rays.pupil[0][lit], axis=0).max() < 0.3 * nir.pupil_radius
    corner = 1.2 * np.sin(np.radians(np.array(nir.document.entrance.half_field_deg)))
    light, relative = landed_from(nir, path, x0, 1e-3, 200_000, (-corner, corner))
    power, error = rays.power()
    assert relative < 0.05
    assert abs(power - light) < error + 3 * relative * light


def test_transmission_is_relative_to_the_input(nir, paths, retro):
    """t of a nominal beam is the share of the pupil's light that its coatings pass: 0.5² and 20 faces' losses."""
    x0 = nir.field_points()[0]
    theta = nominal_direction(nir, paths[0], x0)
    ray = trace(compile_sequence(nir, paths[0], nir.sigma0), even_pupil(nir), theta)
    assert ray.passes.all()
    coating = nir.document.coating
    ar, high = coating["ar"].transmittance, coating["ar_high"].transmittance
    hand = ar**10 * coating["dichroic"].reflectance * high**9 * 0.25 * coating["bandpass"].transmittance
    assert ray.power == pytest.approx(hand, rel=1e-12)
    np.testing.assert_allclose(retro.point.coherency.transmission[:2], hand, rtol=1e-4)
