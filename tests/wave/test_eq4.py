"""Eq. 4 as printed, and what it refuses."""

import math

import pytest

from cgi_wave.errors import InputError
from cgi_wave.wave.eq4 import contrast_eq4


def test_ratio_of_areas():
    assert contrast_eq4(2e-6, 2e-6, 4e-6, 4e-6) == 0.5
    assert contrast_eq4(2e-6, 8e-6, 4e-6, 4e-6) == 1.0
    assert contrast_eq4(0.0, 8e-6, 4e-6, 4e-6) == 0.0


@pytest.mark.parametrize("size", [0.0, -1.0, math.nan, math.inf])
def test_a_ghost_without_size_is_refused(size):
    with pytest.raises(InputError, match="ghost_rms_y"):
        contrast_eq4(1e-6, 1e-6, 1e-6, size)
