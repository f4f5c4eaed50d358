"""Frames: every way of imaging against the definition, exact shifts and flips, smooth ghosts within their error."""

import re
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scroll_cases import PITCH, SHARP, fringes, gaussian, layer, scene, slow_image, zone

from cgi_wave.errors import InputError
from cgi_wave.fringes.beams_on_scene import Sharp
from cgi_wave.fringes.preparation import prepare
from cgi_wave.kernels import frames as kernels

FLIP = [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]


def dark(z):
    return layer(np.zeros(z.shape))


@pytest.mark.parametrize("shift", [0.0, 3.0, 2.25])
@pytest.mark.parametrize(
    "affine",
    [
        FLIP,
        [[1.0, 0.0, 2 * PITCH], [0.0, 1.0, -3 * PITCH]],
        [[-1.0, 0.0, 0.3 * PITCH], [0.0, 1.0, 0.0]],
        [[0.4, 0.0, 0.0], [0.0, -1.7, 1e-5]],
        [[0.9, 0.2, 0.0], [-0.1, 1.1, 1e-5]],
    ],
)
def test_a_sharp_layer_is_what_its_map_says(affine, shift):
    """Shifts, flips, magnifications and a turn, at whole and fractional scroll: linear between samples."""
    z = zone(12, 10, 4.0, 3.0)
    image = scene(30, 18)
    pattern = scene(12, 10, 5)[0]
    beams = prepare([dark(z), layer(pattern, affine)], image, z, precision="float64")
    expected = pattern * slow_image(image[0], z, np.array(affine), SHARP, shift)
    np.testing.assert_allclose(beams.frame(shift), expected, atol=1e-12)
    assert beams.plans[1].way == ("warped" if affine[0][1] else "sharp")


def test_whole_offsets_are_slices_to_the_last_bit():
    z = zone(12, 10, 4.0, 3.0)
    image, one, two = scene(30, 18), scene(12, 10, 5)[0], scene(12, 10, 6)[0]
    beams = prepare([layer(one), layer(two, FLIP)], image, z, precision="float64")
    for k in range(5):
        straight = image[0, 4 + k : 16 + k, 3:13]
        turned = straight[::-1, ::-1]
        np.testing.assert_allclose(beams.frame(float(k)), one * straight + two * turned, rtol=3e-16)
    assert beams.error == 0.0


def test_spectral_modes_add_up():
    z = zone(12, 10, 4.0, 3.0)
    image, pattern = scene(30, 18, modes=3), scene(12, 10, 5, modes=3)
    beams = prepare([layer(pattern)], image, z, precision="float64")
    for shift in (0.0, 1.5):
        parts = sum(
            prepare([layer(pattern[c])], image[c : c + 1], z, precision="float64").frame(shift) for c in range(3)
        )
        np.testing.assert_allclose(beams.frame(shift), parts, atol=1e-14)


def test_cubic_reading_converges_at_the_fourth_order_and_area_at_the_second():
    errors = {}
    for how in ("area", "cubic"):
        for period in (16.0, 32.0):
            z = zone(12, 10, 4.0, 3.0)
            wave = np.sin(2 * np.pi * np.arange(40) / period)
            image = np.broadcast_to(wave[:, None], (40, 16))[None].copy()
            beams = prepare([layer(np.ones(z.shape))], image, z, precision="float64", interpolation=how)
            truth = np.sin(2 * np.pi * (np.arange(12) + 4.0 + 0.5) / period)
            errors[how, period] = np.abs(beams.frame(0.5)[:, 0] - truth).max()
            if how == "cubic":
                assert errors[how, period] <= beams.error
    assert errors["area", 16.0] / errors["area", 32.0] == pytest.approx(4.0, rel=0.1)
    assert errors["cubic", 16.0] / errors["cubic", 32.0] == pytest.approx(16.0, rel=0.1)


def test_a_small_blur_with_a_flip_is_the_sum_by_definition():
    z = zone(12, 10, 6.0, 5.0)
    kernel = np.arange(1.0, 16.0).reshape(3, 5)
    kernel /= kernel.sum()
    image = scene(30, 22)
    beams = prepare([dark(z), layer(np.ones(z.shape), FLIP, kernel)], image, z, precision="float64", tolerance=1e-9)
    expected = slow_image(image[0], z, np.array(FLIP), kernel, 2.0)
    np.testing.assert_allclose(beams.frame(2.0), expected, atol=1e-12)
    assert beams.plans[1].blur == "direct"


def ghosts(z, count=3):
    """Blurred ghosts with fringes of 0, 1 and 2 times the nominal phase, each with its own envelopes and map."""
    y, x = z.y_m[:, None] / np.ptp(z.y_m), z.x_m[None, :] / np.ptp(z.x_m)
    made = []
    for n in range(count):
        power = 1e-2 / (n + 1) * (1.0 + 0.2 * x * y - 0.1 * y**2)
        turned = power * (1.0 + 0.3 * np.cos(z.phase * (1.0 + 0.01 * n) + 0.2 * n) + 0.2 * np.sin(2.0 * z.phase + y))
        sign = -1.0 if n % 2 else 1.0
        affine = [[sign * (1.0 + 0.1 * n), 0.0, 4e-5 * n], [0.0, 1.0 - 0.2 * n, 2e-5]]
        made.append(layer(turned, affine, gaussian(22.0 + 4.0 * n, 5.0), f"ghost {n}"))
    return made


@pytest.mark.parametrize("tile", [False, True])
def test_smooth_ghosts_keep_the_tolerance(tile):
    """All on the coarse grid, against the long way of the same layers."""
    z = zone(150, 130, 30.0, 20.0, period=45.0, tilt=0.02)
    image = scene(320, 170)
    nominal = layer(fringes(z))
    kept = prepare([nominal, *ghosts(z)], image, z, tolerance=3e-5, tile=tile, precision="float64")
    assert [plan.way for plan in kept.plans] == ["sharp", "smooth", "smooth", "smooth"]
    assert {plan.pitch for plan in kept.plans[1:]} <= {8, 16, 32}
    full = prepare([nominal, *ghosts(z)], image, z, tolerance=1e-12, tile=tile, precision="float64")
    assert all(plan.way == "sharp" for plan in full.plans)
    for shift in (0.0, 11.3, 87.0):
        error = np.abs(kept.frame(shift) - full.frame(shift)).max()
        assert 1e-12 < error <= kept.error + full.error
    assert kept.error <= 3e-5


def test_single_precision_and_threads():
    """float32 errs by its rounding; two threads change no bit."""
    z = zone(150, 130, 30.0, 20.0, period=45.0)
    image = scene(320, 170)
    layers = [layer(fringes(z)), *ghosts(z), layer(1e-3 * fringes(z), FLIP)]
    exact = prepare(layers, image, z, tolerance=1e-5, precision="float64")
    short = prepare(layers, image, z, tolerance=1e-5)
    with ThreadPoolExecutor(2) as pool:
        for shift in (3.0, 4.7):
            one = short.frame(shift)
            assert one.dtype == np.float32
            np.testing.assert_allclose(one, exact.frame(shift), atol=5e-7)
            np.testing.assert_array_equal(short.frame(shift, None, pool), one)


@pytest.mark.parametrize("helper_fails", [True, False])
def test_a_thread_that_fails_with_a_piece_in_hand_stops_the_frame(monkeypatch, helper_fails):
    """Whichever of the two it is: the caller gets its exception, and nobody waits for the piece."""
    z = zone(40, 24, period=12.0)
    beams = prepare([layer(fringes(z))], scene(60, 24), z)
    right = beams.frame(0.0)
    taken = threading.Event()
    compiled = kernels.frame_rows

    def fails(*arguments):
        counter, from_top = arguments[-2:]
        if from_top == helper_fails:
            assert taken.wait(30.0)
            return compiled(*arguments)
        counter[0] += 1
        taken.set()
        raise FloatingPointError("a piece that nobody finishes")

    found = []

    def call():
        try:
            beams.frame(0.0, None, pool)
        except FloatingPointError as error:
            found.append(str(error))

    with ThreadPoolExecutor(1) as pool:
        with monkeypatch.context() as patched:
            patched.setattr(kernels, "frame_rows", fails)
            caller = threading.Thread(target=call, daemon=True)
            caller.start()
            caller.join(60.0)
            assert found == ["a piece that nobody finishes"]
            pool.submit(taken.is_set).result(60.0)  # the helper has come back, too
        np.testing.assert_array_equal(beams.frame(0.0, None, pool), right)


def test_uniform_scene_shows_the_patterns_whatever_the_maps():
    """Energy: every layer's light arrives, at whatever shift, blur and magnification."""
    z = zone(150, 130, 30.0, 20.0, period=45.0)
    layers = [layer(fringes(z)), *ghosts(z), layer(1e-3 * fringes(z), [[0.9, 0.2, 0.0], [-0.1, 1.1, 1e-5]])]
    beams = prepare(layers, np.full((1, 320, 170), 0.8), z, tolerance=1e-6, precision="float64")
    expected = 0.8 * sum(each.pattern[0] for each in layers)
    assert np.abs(beams.frame(20.0) - expected).max() <= beams.error + 1e-12


def test_ground_beyond_the_scene():
    z = zone(12, 10, 4.0, 3.0)
    with pytest.raises(InputError, match=r"smaller than the swath: 3 columns are missing"):
        prepare([layer(np.ones(z.shape))], scene(30, 10), z)
    beams = prepare([layer(np.ones(z.shape))], scene(30, 18), z)
    beams.frame(14.0)
    with pytest.raises(InputError, match=r"needs 2 rows more.*tile"):
        beams.frame(15.5)
    tiled = prepare([layer(np.ones(z.shape))], scene(30, 18), z, tile=True, precision="float64")
    np.testing.assert_array_equal(tiled.frame(14.0), tiled.frame(44.0))
    np.testing.assert_allclose(tiled.frame(20.0)[:, 0], np.roll(scene(30, 18)[0, :, 3], -24)[:12])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda z: ([layer(np.ones((3, 3)))], scene(30, 18)), "pattern = (1, 3, 3)"),
        (lambda z: ([layer(np.full(z.shape, np.nan))], scene(30, 18)), "must be finite"),
        (lambda z: ([layer(np.ones(z.shape))], np.full((1, 30, 18), np.nan)), "must be finite"),
        (lambda z: ([layer(np.ones(z.shape))], np.ones((30, 18))), "(modes, rows, columns)"),
        (lambda z: ([dark(z), layer(np.ones(z.shape), None, np.ones((3, 3)))], scene(30, 18)), "must add up to 1"),
    ],
)
def test_refusals(change, words):
    z = zone(12, 10, 4.0, 3.0)
    with pytest.raises(InputError, match=re.escape(words)):
        prepare(*change(z), z)


def test_a_layer_whose_pattern_and_image_do_not_fit_is_refused():
    """The compiled loops look at nothing: others would make them read beyond the arrays."""
    pattern, image, row = np.ones((2, 12, 10)), np.ones((2, 30, 10)), np.arange(12.0)
    Sharp("good", pattern, image, row, 2, 0, True)
    for a, b, c in (
        (pattern, image[:1], row), (pattern, image[:, :, :9], row), (pattern, image, row[:11]),
        (pattern, image.astype(np.float32), row), (pattern[:, :, ::2], image[:, :, ::2], row),
    ):  # fmt: skip
        with pytest.raises(InputError, match="do not fit each other"):
            Sharp("bad", a, b, c, 2, 0, True)
