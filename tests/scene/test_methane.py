"""Methane's 2ν3 band: manifolds where they are found, spherical-top sum rules, the OPD of the rise."""

from __future__ import annotations

import numpy as np
import pytest

from cgi_wave.errors import InputError
from cgi_wave.scene.coherence import coherent_rise
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.lines import C2_M_K
from cgi_wave.scene.methane import methane, partition_function
from cgi_wave.scene.radiance import toa_radiance


def test_manifolds_between_and_beyond_those_that_set_the_constants():
    """R(2) and R(5), centres of gravity in cm⁻¹; R(3), R(4) and R(6) went into the constants."""
    lines = methane()
    for j, position in ((2, 6036.66), (5, 6067.1)):
        (found,) = np.flatnonzero((lines.branch == "R") & (lines.j_lower == j))
        assert lines.sigma[found] / 100 == pytest.approx(position, abs=0.05)


def test_branches_of_one_level_share_its_weight():
    lines = methane()
    bare = lines.strength / lines.sigma * np.exp(C2_M_K * lines.lower_energy / 296.0)
    sums = np.array([bare[lines.j_lower == j].sum() / (2 * j + 1) ** 2 for j in (0, 3, 8)])
    assert sums == pytest.approx(sums[0], rel=1e-12)
    assert lines.strength.sum() == pytest.approx(9.0e-22, rel=1e-12)


def test_partition_function_of_a_hot_spherical_top():
    """Rotation goes as T^1.5 (next term B/kT·¼, here below 0.3 %); vibration adds 1 % at 296 K."""
    ratio = partition_function(296.0) / partition_function(200.0)
    assert ratio == pytest.approx((296.0 / 200.0) ** 1.5, rel=0.015)
    assert ratio > (296.0 / 200.0) ** 1.5


def test_rise_is_where_the_line_spacing_says():
    """Only the OPD: near R(4) the manifolds stand 10.1 cm⁻¹ apart. 0.98 mm is what is known of it."""
    band = Filter(1652e-9, 12e-9, "flat-top")
    rise = coherent_rise(toa_radiance("ch4", band, 3e-3), band, 2.5e-3)
    assert rise.opd_m == pytest.approx(0.98e-3, abs=0.02e-3)
    assert rise.opd_m == pytest.approx(0.01 / 10.1, rel=0.01)


def test_a_gas_without_lines_in_the_band_is_refused():
    with pytest.raises(InputError, match="no line near 764 nm") as caught:
        toa_radiance("ch4", Filter(764e-9, 2.6e-9), 1e-3)
    assert caught.value.field == "kind"
