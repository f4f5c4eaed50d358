"""TDI: contrast against its formula on frames, N = 1, repeated zones, refusals, smear."""

import numpy as np
import pytest
from scroll_cases import fringes, layer, scene, zone

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.fringes.preparation import prepare
from cgi_wave.fringes.scroll import motion, stream
from cgi_wave.fringes.tdi import Charge, plan_tdi, tdi_contrast

ROWS, PERIOD = 96, 16.0


def copies(beams, moves):
    return [frame.copy() for frame in stream(beams, moves)]


def means(frames, plan):
    """What a sequence gives, from the frame on that has filled the register."""
    charge = Charge(plan)
    return [mean for mean in map(charge.add, frames) if mean is not None]


def test_one_row_is_the_frame():
    z = zone(ROWS, 5, period=PERIOD)
    beams = prepare([layer(fringes(z))], scene(120, 5), z)
    frames = copies(beams, motion(20))
    for one, frame in zip(means(frames, plan_tdi(ROWS, 1, PERIOD, motion(20))), frames, strict=True):
        np.testing.assert_array_equal(one, frame)


@pytest.mark.parametrize("rows", [2, 3, 4])
def test_contrast_of_summed_rows(rows):
    """One sample at the mean OPD, fringes weaker by the formula; the scene's own structure is kept."""
    z = zone(ROWS, 5, period=PERIOD)
    image = scene(150, 5)
    beams = prepare([layer(fringes(z, 0.5, 0.4))], image, z, precision="float64")
    moves = motion(20)
    plan = plan_tdi(ROWS, rows, PERIOD, moves)
    assert plan.contrast == pytest.approx(abs(np.mean(np.exp(2j * np.pi * np.arange(rows) / PERIOD))), rel=1e-12)
    assert plan.contrast < 1.0 and plan.warning is None and plan.smear_rows == 0.0
    place = np.arange(ROWS)
    for n, out in enumerate(means(copies(beams, moves), plan)):
        mean = np.array([np.interp(plan.mean_row, place, z.phase[:, x]) for x in range(5)]).T
        ground = image[0, plan.first + plan.offsets[-1] + n]
        np.testing.assert_allclose(out, ground * 0.5 * (1 + 0.4 * plan.contrast * np.cos(mean)), atol=1e-12)


def test_repeated_zones_of_equal_opd_cost_nothing():
    z = zone(ROWS // 2, 5, period=PERIOD)
    pattern = np.concatenate([fringes(z), fringes(z)])
    whole = zone(ROWS, 5)
    image = scene(200, 5)
    moves = motion(70)
    frames = copies(prepare([layer(pattern)], image, whole, precision="float64"), moves)
    plan = plan_tdi(ROWS, 1, PERIOD, moves, repeats=2, spacing=ROWS // 2)
    assert plan.contrast == 1.0 and plan.gain == 2
    for n, out in enumerate(means(frames, plan)):
        ground = image[0, plan.first + plan.offsets[-1] + n]
        np.testing.assert_allclose(out, ground * fringes(z), atol=1e-12)


def test_more_than_a_quarter_fringe_is_refused():
    plan_tdi(ROWS, 4, PERIOD, motion(20))
    with pytest.raises(MethodLimitError, match="a quarter") as caught:
        plan_tdi(ROWS, 5, PERIOD, motion(20))
    assert caught.value.factor == pytest.approx(1.25)
    assert tdi_contrast(1, 3.0) == 1.0
    with pytest.raises(InputError, match="do not fit"):
        plan_tdi(ROWS, 1, PERIOD, motion(20), repeats=3, spacing=ROWS // 2)


def test_rate_out_of_step_is_said_with_its_number(capsys):
    calm = plan_tdi(ROWS, 4, PERIOD, motion(50, 1.1))
    assert calm.smear_rows == pytest.approx(0.3) and calm.warning is None and capsys.readouterr().err == ""
    fast = plan_tdi(ROWS, 4, PERIOD, motion(50, 1.25))
    assert fast.smear_rows == pytest.approx(0.75)
    said = capsys.readouterr()
    assert "0.75 rows" in said.err and said.out == "" and fast.warning in said.err
