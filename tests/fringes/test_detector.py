"""Detector noise: its statistics, saturation, quantisation, and independence of how frames are cut."""

import numpy as np
import pytest

from cgi_wave.errors import InputError
from cgi_wave.fringes.detector import BLOCK, Detector

FRAME = np.full((300, 200), 0.4)


@pytest.mark.parametrize("shot", ["poisson", "gaussian"])
def test_mean_and_variance(shot):
    camera = Detector(5e3, 30.0, shot=shot)
    out, saturated = camera.record(FRAME, 3, 11)
    n = FRAME.size
    variance = (0.4 * 5e3 + 30.0**2) / 5e3**2
    assert camera.variance(np.array(0.4)) == pytest.approx(variance)
    assert saturated == 0
    assert abs(out.mean() - 0.4) < 4 * np.sqrt(variance / n)
    assert out.var() == pytest.approx(variance, rel=4 * np.sqrt(2 / n))


def test_seed_and_frame_number_fix_the_noise():
    camera = Detector(1e4, 20.0)
    one = camera.record(FRAME, 5, 1)[0]
    np.testing.assert_array_equal(one, camera.record(FRAME, 5, 1)[0])
    others = [camera.record(FRAME, 6, 1)[0], camera.record(FRAME, 5, 2)[0]]
    for other in others:
        assert abs(np.corrcoef((one - 0.4).ravel(), (other - 0.4).ravel())[0, 1]) < 0.02
    # a shorter frame has the noise of the longer one's first rows
    np.testing.assert_array_equal(camera.record(FRAME[:BLOCK], 5, 1)[0], one[:BLOCK])


def test_full_well_and_counts():
    frame = np.array([[0.0, 0.25, 0.5, 2.0]])
    camera = Detector(1000.0, full_well=1000.0, bits=3, shot="none")
    out, saturated = camera.record(frame, 0, 0)
    assert saturated == 1
    np.testing.assert_allclose(out, [[0.0, 2 / 7, 4 / 7, 1.0]])  # 1.75 and 3.5 of seven steps; a half to the even one
    fine = np.linspace(0.0, 1.0, 100001)[None]
    error = Detector(1000.0, full_well=1000.0, bits=6, shot="none").record(fine, 0, 0)[0] - fine
    assert error.var() == pytest.approx((1 / 63) ** 2 / 12, rel=1e-3)


def test_refusals():
    for values, word in [((0.0,), "electrons"), ((1.0, -1.0), "read_electrons"), ((1.0, 0.0, np.inf, 12), "bits")]:
        with pytest.raises(InputError, match=word):
            Detector(*values)
    with pytest.raises(InputError, match="negative irradiance"):
        Detector(1e3).record(np.array([[-0.1]]), 0, 0)


@pytest.mark.parametrize("shot", ["poisson", "gaussian"])
def test_what_convolutions_leave_below_zero_counts_as_dark(shot):
    frame = np.array([[1.0, 0.5, -3e-5, -1e-17]])
    out, _ = Detector(1e4, shot=shot).record(frame, 0, 0)
    np.testing.assert_array_equal(out[0, 2:], 0.0)
    assert frame[0, 2] == -3e-5
