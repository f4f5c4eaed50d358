"""The scroll: one-dimensional truth from the synthesis of a PSI, shifts, ports, regrouping, motion."""

import numpy as np
import pytest
from fringe_scenes import PITCH, SIGMA0, amplitudes, coherency, pair, retro_family
from scroll_cases import layer, scene, zone

from cgi_wave.errors import InputError
from cgi_wave.fringes.maps import retrieve_ground
from cgi_wave.fringes.nma import retrieve
from cgi_wave.fringes.preparation import prepare
from cgi_wave.fringes.psi import synthesise
from cgi_wave.fringes.scroll import motion, regrouped, stream

ROWS, COLUMNS = 120, 6
PERIOD = 12.0  # rows
SLOPE = 1.0 / (SIGMA0 * PERIOD * PITCH)
POWER = 0.05 * 0.95**2


def frozen(opd=1.33e-3, power=POWER):
    """The synthesised PSI of one field point with a retro-ghost, pixels included."""
    y = (np.arange(ROWS) - 0.5 * (ROWS - 1)) * PITCH
    sigma = SIGMA0 + np.linspace(-2e3, 2e3, 401)
    weight = np.exp(-(((sigma - SIGMA0) / 300.0) ** 2))
    return synthesise(retro_family(opd, power, slope=SLOPE), sigma, weight, y, PITCH)


def phase_of(psi):
    return np.broadcast_to((2.0 * np.pi * psi.sigma0 * psi.opd_m)[:, None], (ROWS, COLUMNS))


def patterns(curve):
    return np.broadcast_to(curve[:, None], (ROWS, COLUMNS))


@pytest.mark.parametrize(("precision", "bound"), [("float64", 1e-12), ("float32", 2e-7)])
def test_scroll_and_regroup_of_a_uniform_scene_is_the_psi(precision, bound):
    """Every ground point shows the interferogram of the field point; float32 to its rounding."""
    psi = frozen()
    z = zone(ROWS, COLUMNS)
    ghost = layer(patterns(psi.coherent.irradiance - psi.nominal.irradiance), [[-1.0, 0, 0], [0, -1.0, 0]])
    beams = prepare(
        [layer(patterns(psi.nominal.irradiance)), ghost], np.ones((1, 320, COLUMNS)), z, precision=precision
    )
    frames = np.array([frame.copy() for frame in stream(beams, motion(ROWS + 9))])
    cube = regrouped(frames)
    assert cube.shape == (10, ROWS, COLUMNS) and np.shares_memory(cube, frames)
    assert np.abs(cube - psi.coherent.irradiance[None, :, None]).max() <= bound


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_ground_maps_are_the_retrieval_of_the_field_point(precision):
    """M, B, NMA and the NMA error of a frozen field point come out of the two-dimensional chain."""
    psi = frozen()
    truth = retrieve(psi)
    found = {}
    for name, book in (("nominal", psi.nominal), ("coherent", psi.coherent)):
        beams = prepare([layer(patterns(book.irradiance))], np.ones((1, 320, COLUMNS)), zone(ROWS, COLUMNS),
                        precision=precision)  # fmt: skip
        found[name] = retrieve_ground(stream(beams, motion(ROWS + 9)), phase_of(psi), motion(ROWS + 9),
                                      dtype=np.dtype(precision).type)  # fmt: skip
    close = {"float64": 1e-9, "float32": 4e-6}[precision]
    nominal = found["nominal"]
    assert nominal.nma.shape == (10, COLUMNS) and nominal.fringes == truth.nominal.fringes
    np.testing.assert_allclose(nominal.baseline, truth.nominal.baseline.value, rtol=close)
    np.testing.assert_allclose(nominal.modulation, truth.nominal.modulation.value, rtol=close)
    error = 1.0 - found["coherent"].nma / nominal.nma
    np.testing.assert_allclose(error, truth.coherent.nma_error.value, atol=3 * close)
    assert truth.coherent.nma_error.value > 0.01


def test_two_ports_sum_to_the_input():
    """Lossless splitter: the other port's contrast is the negative; frames of both add up to the scene."""
    forward, _ = amplitudes()
    other = np.sqrt(0.5) * np.array([forward[0], -forward[1]]) / np.abs(forward)
    y = (np.arange(ROWS) - 0.5 * (ROWS - 1)) * PITCH
    sigma = SIGMA0 + np.linspace(-2e3, 2e3, 401)
    weight = np.exp(-(((sigma - SIGMA0) / 300.0) ** 2))
    curves = []
    for field in (forward, other * np.abs(forward) / np.sqrt(0.5)):
        gamma = np.exp(1j * np.angle(field[0] * np.conj(field[1])))
        coh = coherency(np.abs(field) ** 2, [0, 0], [pair(0, 1, gamma, 1e-5, SLOPE)])
        curves.append(synthesise(coh, sigma, weight, y, PITCH).nominal.irradiance)
    image = scene(150, COLUMNS)
    ports = [prepare([layer(patterns(curve))], image, zone(ROWS, COLUMNS), precision="float64") for curve in curves]
    assert np.ptp(curves[0]) > 0.5
    for shift in (0.0, 7.0):
        total = ports[0].frame(shift) + ports[1].frame(shift)
        np.testing.assert_allclose(total, image[0, int(shift) : int(shift) + ROWS], atol=1e-12)


def test_a_scene_one_row_on_shifts_the_result_by_one_row():
    image = scene(320, COLUMNS)
    psi = frozen()
    z = zone(ROWS, COLUMNS)
    layers = [
        layer(patterns(psi.nominal.irradiance)),
        layer(0.01 * patterns(psi.nominal.irradiance), [[1.0, 0, 0], [0, -1.0, 0]]),
    ]
    moves = motion(ROWS + 20)
    maps = [
        retrieve_ground(
            stream(prepare(layers, part, z, precision="float64"), moves), phase_of(psi), moves, dtype=np.float64
        )
        for part in (image, np.roll(image, 1, axis=1))
    ]
    np.testing.assert_allclose(maps[1].nma[1:], maps[0].nma[:-1], rtol=1e-12)
    assert np.ptp(maps[0].nma) > 1e-3  # ghosts of other ground make it vary


def test_nominal_light_of_a_point_sees_one_ground_point_only():
    """Without ghosts every ground point has the NMA of the instrument, whatever the scene."""
    psi = frozen()
    image = 0.2 + scene(320, COLUMNS)
    moves = motion(ROWS + 30)
    beams = prepare([layer(patterns(psi.nominal.irradiance))], image, zone(ROWS, COLUMNS), precision="float64")
    found = retrieve_ground(stream(beams, moves), phase_of(psi), moves, dtype=np.float64)
    np.testing.assert_allclose(found.nma, retrieve(psi).nominal.nma.value, rtol=1e-9)
    expected = image[0, found.ground] * retrieve(psi).nominal.baseline.value
    np.testing.assert_allclose(found.baseline, expected, rtol=1e-9)


def test_streamed_sums_are_the_batch_fit():
    """Least squares on the regrouped cube with NumPy's solver, column by column, tilted fringes and a real scene."""
    z = zone(60, 8, period=12.3, tilt=0.1)
    frames = np.random.default_rng(1).random((75, 60, 8))
    found = retrieve_ground(frames, z.phase, motion(75), dtype=np.float64)
    cube = regrouped(frames)
    rows = np.arange(60)
    frequency = 1.0 / 12.3
    fringes = int(np.floor(frequency * 61))
    offset = rows - 29.5
    half = 0.5 * fringes / frequency
    inside = (offset >= -half * (1 + 1e-9)) & (offset < half * (1 - 1e-9))
    assert found.fringes == fringes and found.window == inside.sum()
    for x in range(8):
        theta, u = z.phase[inside, x], offset[inside] / half
        model = np.stack([np.ones_like(u), u, *(f(n * theta) for n in (1, 2) for f in (np.cos, np.sin))], axis=1)
        term = np.linalg.lstsq(model, cube[:, inside, x].T, rcond=None)[0]
        # the window's ground rows are more than those that passed every row of the frame
        ground = 59 + np.arange(len(cube))
        here = np.searchsorted(found.ground, ground)
        np.testing.assert_allclose(found.baseline[here, x], term[0], rtol=1e-11)
        np.testing.assert_allclose(found.modulation[here, x], np.hypot(term[2], term[3]), rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize("move", [motion(150, 1.0, 0.4, 1.5, 31.0, seed=4), motion(280, 0.5)])
def test_any_motion_gives_uniform_ground_its_nma(move):
    """Jitter, attitude, half the row rate: rows met twice or never do not bias the fit."""
    psi = frozen()
    z = zone(ROWS, COLUMNS, row=5.0)
    beams = prepare([layer(patterns(psi.nominal.irradiance))], np.ones((1, 320, COLUMNS)), z, precision="float64")
    found = retrieve_ground(stream(beams, move), phase_of(psi), move, 5, dtype=np.float64)
    assert len(found.ground) > 10 and (move.regular or found.seen.min() >= 0.75 * found.window)
    np.testing.assert_allclose(found.nma, retrieve(psi).nominal.nma.value, rtol=3e-3)
    np.testing.assert_allclose(found.baseline, retrieve(psi).nominal.baseline.value, rtol=3e-3)


def test_ground_that_every_second_row_sees_is_refused():
    """Two rows per frame: half of the window, below the least share of it."""
    psi, move = frozen(), motion(90, 2.0)
    beams = prepare([layer(patterns(psi.nominal.irradiance))], np.ones((1, 320, COLUMNS)), zone(ROWS, COLUMNS, row=5.0))
    with pytest.raises(InputError):
        retrieve_ground(stream(beams, move), phase_of(psi), move, 5)


def test_motion_is_the_sum_of_its_parts_and_repeats_by_seed():
    plain = motion(50, 0.75, 0.0, 2.0, 20.0, start=3.0)
    np.testing.assert_allclose(plain.rows, 3 + 0.75 * np.arange(50) + 2 * np.sin(2 * np.pi * np.arange(50) / 20))
    jitter = motion(4000, 1.0, 0.3, seed=7)
    assert np.std(jitter.rows - np.arange(4000)) == pytest.approx(0.3, rel=0.05)
    np.testing.assert_array_equal(jitter.rows[:100], motion(100, 1.0, 0.3, seed=7).rows)
    assert not np.array_equal(jitter.rows, motion(4000, 1.0, 0.3, seed=8).rows)
    assert motion(10).regular and not motion(10, 0.5).regular
    with pytest.raises(InputError, match="step"):
        motion(10, 0.0)


def test_regrouped_by_the_definition_and_read_only():
    frames = np.arange(9 * 4 * 3).reshape(9, 4, 3)
    cube = regrouped(frames)
    for g in range(6):
        for j in range(4):
            np.testing.assert_array_equal(cube[g, j], frames[3 + g - j, j])
    with pytest.raises(ValueError, match="read-only"):
        cube[0, 0, 0] = 1
    with pytest.raises(InputError, match="no ground point has passed all 4 rows"):
        regrouped(frames[:3])


def test_a_scene_too_short_for_the_scroll_is_refused_before_the_first_frame():
    beams = prepare([layer(np.ones((12, 10)))], scene(30, 10), zone(12, 10))
    with pytest.raises(InputError, match="needs 1 rows more"):
        next(stream(beams, motion(20)))
