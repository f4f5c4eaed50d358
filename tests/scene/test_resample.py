"""Resampling conserves energy; orientations are permutations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cgi_wave.errors import InputError
from cgi_wave.scene.resample import ORIENTATIONS, box_resample, oriented


@given(st.floats(7.0, 200.0), st.floats(7.0, 200.0), st.integers(10, 23), st.integers(10, 23))
def test_energy_is_conserved_over_what_is_covered(across, along, rows, columns):
    """∫ values dA over the new pixels equals the same integral of the old ones, cut at the new outer edge."""
    values = np.random.default_rng(rows).uniform(0, 1, (rows, columns))
    out = box_resample(values, (along, across), 60.0)
    weight = [
        np.clip(60.0 * n / step - np.arange(count), 0, 1) * step
        for n, step, count in zip(out.shape, (along, across), values.shape, strict=True)
    ]
    assert out.sum() * 60.0**2 == pytest.approx(weight[0] @ values @ weight[1], rel=1e-10)
    assert values.min() - 1e-12 <= out.min() <= out.max() <= values.max() + 1e-12


def test_every_new_pixel_is_the_mean_of_what_it_covers():
    """2.5 source pixels a new one: weights ½, 1, 1 and their mirror image."""
    values = np.random.default_rng(1).uniform(0, 1, (5, 10))
    line = np.array([[1, 1, 0.5, 0, 0], [0, 0, 0.5, 1, 1]]) / 2.5
    across = np.kron(np.eye(2), line)
    assert box_resample(values, (30.0, 30.0), 75.0) == pytest.approx(line @ values @ across.T, rel=1e-12)


def test_finer_pixels_repeat_and_bring_back():
    values = np.random.default_rng(2).uniform(0, 1, (2, 3, 4))
    fine = box_resample(values, (90.0, 60.0), 30.0)
    assert fine.shape == (2, 9, 8)
    assert fine == pytest.approx(np.repeat(np.repeat(values, 3, 1), 2, 2))
    assert box_resample(fine, (30.0, 30.0), 60.0)[0, 0] == pytest.approx(values[0, 0], rel=1e-12)
    assert np.array_equal(box_resample(values, (75.0, 75.0), 75.0), values)


def test_map_smaller_than_a_pixel_is_refused():
    with pytest.raises(InputError, match="smaller than one pixel"):
        box_resample(np.ones((2, 2)), (30.0, 30.0), 75.0)


def test_orientations_put_the_named_corner_first():
    """A map with its value at the far end of Y and the near end of X."""
    scene = np.zeros((2, 3))
    scene[1, 0] = 1
    for word in ORIENTATIONS:
        first, second = word[:2], word[2:]
        stored = scene if first[1] == "y" else scene.T
        stored = stored[:: -1 if first[0] == "-" else 1, :: -1 if second[0] == "-" else 1]
        assert np.array_equal(oriented(stored, word), scene)
    with pytest.raises(InputError, match="unknown"):
        oriented(scene, "north")
