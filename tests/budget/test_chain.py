"""The chain as a whole: both ports of an interferometer, a second band, one field point as a process analyses it."""

import pickle

import msgspec
import numpy as np
import pytest
from chain_cases import account, contrast, face_power, family, filter_face, pupil_field, retro_power
from small_instruments import michelson

from cgi_wave.analysis import Task, analyse_field
from cgi_wave.budget.fieldpoint import field_point
from cgi_wave.budget.select import POWER_FLOOR, select_ghosts
from cgi_wave.budget.setting import band_setting
from cgi_wave.fringes.nma import nma_error_exact
from cgi_wave.optics.system import from_document
from cgi_wave.rays.beams import nominal_direction
from cgi_wave.rays.paths import find_paths
from cgi_wave.wave.field import power

#: Distance of both ports' detectors from the cube, mm.
PORT = 70.0
WAVELENGTH = 500e-6


def port(name, extra, **splitter):
    """The cube Michelson of the small instruments, its detectors equally far from the cube in both ports."""
    raw = msgspec.to_builtins(michelson(name, extra=extra).document)
    for part in raw["frame"]:
        if part["name"] == "return":
            part["shift_mm"] = [0.0, 0.0, 30.0 - PORT]
        for face in part["surface"]:
            if face["name"] == "cube_exit":
                face["thickness_mm"] = PORT
    raw["coating"]["splitter"] |= splitter
    return from_document(raw).band("B")


def shared(name, extra, **splitter):
    """Powers of both arms at a point of one port, and their complex contrast."""
    system, x0 = port(name, extra, **splitter), np.array([3e-4, -2e-4])
    paths = find_paths(system, max_order=0)
    theta = nominal_direction(system, paths[0], x0)
    both = [pupil_field(system, path, x0, theta) for path in paths]
    gamma, bound = contrast(*both, system.sigma0)
    return np.array([power(field)[0][0] for field in both]), gamma, bound


@pytest.mark.parametrize("turn", [0.0, 0.125, 0.3])
def test_ports_share_the_light_of_the_whole_pupil(turn):
    """Under a uniform scene, 10 mm of OPD: a point of either port sees 1.6 waves over the pupil, fringes of 10 %; what
    one port loses the other has. Powers are those of the pupil's solid angle over the air-equivalent distance."""
    extra = 5.0 + turn * WAVELENGTH
    (front, gamma, bound), (back, other, _) = shared("front", extra), shared("back", extra)
    np.testing.assert_allclose(front, back, rtol=1e-10)
    assert abs(gamma + other) < 1e-9 and bound < 1e-5
    assert 0.09 < abs(gamma) < 0.12
    distance = np.array([30.0 + 40.0 / 1.5 + 2 * 5.0 + PORT, 30.0 + 40.0 / 1.5 + 2 * (5.0 + extra) + PORT])
    np.testing.assert_allclose(front, 0.25 * np.pi * 2.0**2 / distance**2, rtol=1e-3)


def test_ports_with_a_wrong_splitter_phase():
    """Both reflections alike: the two ports' fringes do not cancel, and energy comes and goes."""
    (_, gamma, _), (_, other, _) = (shared(name, 5.0, reflect_phase_deg=0.0) for name in ("front", "back"))
    assert abs(gamma - other) < 1e-9 < 0.09 < abs(gamma)


# ------------------------------------------------------------------------------------------------ the second band


@pytest.fixture(scope="module")
def vis(instrument):
    """System, setting and single reflections of the VIS band."""
    system = instrument.band("VIS")
    return system, band_setting(system), find_paths(system, max_order=1, probes=256)


def test_retro_ghost_in_the_visible(instrument, vis):
    """As in the NIR: half the baseline, nothing at the fringe's frequency; 2e-3 is the blur of relay and objective."""
    system, setting, paths = vis
    got = account(system, setting, family(paths, "detector")).retrieval.coherent
    assert got.offset_over_baseline.value == pytest.approx(retro_power(instrument) / 4, rel=2e-3)
    assert abs(got.parasitic_over_modulation.value) < 2e-3 * retro_power(instrument)
    assert got.second_over_modulation == pytest.approx(retro_power(instrument) / 4, rel=2e-2)
    assert got.nma_error.value == pytest.approx(nma_error_exact(0.0, retro_power(instrument) / 4), rel=1e-2)


def test_filter_face_in_the_visible(instrument, vis):
    """1.7 mm before the detector: O/B and M*/M of the closed form, to what 0.05 rad of blur makes of J."""
    system, setting, paths = vis
    got = account(system, setting, family(paths, "filter_front"))
    want = filter_face(instrument, system, paths[0], got.fringe_period)
    half = face_power(instrument) / 2
    coherent = got.retrieval.coherent
    assert coherent.offset_over_baseline.value == pytest.approx(want.offset, abs=0.01 * half)
    assert coherent.parasitic_over_modulation.value == pytest.approx(want.parasitic, abs=0.02 * half)


# ------------------------------------------------------------------------------------------------ one field point


@pytest.fixture(scope="module")
def task(instrument, paths):
    """What a process is given: the strongest paths of the NIR band."""
    return Task(instrument.raw, instrument.file, "NIR", tuple(paths[:8]), 1e-4, False)


def test_field_point_of_a_process(nir, setting, task):
    """The task goes to another process and back whole; the numbers are those of the chain run step by step."""
    result = analyse_field(pickle.loads(pickle.dumps(task)), 1)
    x0 = nir.field_points()[1]
    assert (result.x_m, result.y_m) == tuple(x0)
    point = field_point(setting, task.paths, x0, task.tolerance)
    np.testing.assert_array_equal(result.coherency.transmission, point.coherency.transmission)
    assert [(pair.m, pair.l) for pair in result.coherency.pairs] == [(p.m, p.l) for p in point.coherency.pairs]
    for pair, other in zip(result.coherency.pairs, point.coherency.pairs, strict=True):
        np.testing.assert_array_equal(pair.gamma, other.gamma)


def test_every_pair_is_computed_or_bounded(setting, task, nir):
    """No pair of beams is lost or counted twice; contrasts are at most one; every power has its error."""
    coherency = account(nir, setting, task.paths).point.coherency
    beams = len(coherency.labels)
    keys = [frozenset((pair.m, pair.l)) for pair in (*coherency.pairs, *coherency.left_out)]
    assert len(set(keys)) == len(keys) == beams * (beams - 1) // 2
    for pair in coherency.pairs:
        assert np.all(np.abs(pair.gamma) <= 1.0 + pair.error)
        assert np.all(pair.error < 1e-2)
    assert coherency.transmission_error.shape == coherency.transmission.shape
    assert np.all(coherency.transmission_error < 0.1 * coherency.transmission)


def test_selection_keeps_power_and_amplitude(nir, setting, paths):
    """Nominal paths, every ghost above the power floor, and weaker ones only while their amplitude can matter."""
    kept = select_ghosts(setting, paths, 1e-4)
    assert kept[:2] == tuple(paths[:2])
    strong = [path for path in paths if path.order > 0 and path.estimate > POWER_FLOOR]
    weak = [path for path in kept[2:] if path.estimate <= POWER_FLOOR]
    assert set(strong) <= set(kept) and len(kept) == 2 + len(strong) + len(weak)
    reach = np.sqrt([path.estimate / paths[0].estimate for path in weak]) / setting.nma
    assert np.all(reach > 1e-4)
    assert len(select_ghosts(setting, paths, 1e-2)) <= len(kept)
