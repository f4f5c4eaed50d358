"""The pair of circular pupils: its fields say the same as its formula, and broken input is refused."""

import math

import numpy as np
import pytest

from cgi_wave.errors import InputError
from cgi_wave.wave.basis import at_points
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.overlap import overlap

PAIR = HopkinsPair(w020=3.1, w040=-0.7, w131=0.4, w222=0.9, w111=-1.3, obscuration=0.3, shift_x=0.2, shift_y=-0.1)


def test_fields_carry_the_formula():
    m, _ = PAIR.pupil_fields()
    x, y = np.random.default_rng(1).uniform(-0.8, 0.8, (2, 50))
    scaled = (np.column_stack([x, y]) - m.support.centre) / m.support.scale
    assert at_points(m.opl[0], scaled) == pytest.approx(PAIR.wavefront(x, y), abs=1e-13)
    own = (x - PAIR.shift_x) ** 2 + (y - PAIR.shift_y) ** 2
    disc, hole = at_points(m.support.clearance, scaled)
    assert disc == pytest.approx(1.0 - own, abs=1e-14)
    assert hole == pytest.approx(own - PAIR.obscuration**2, abs=1e-14)


def test_each_coefficient_is_the_aberration_at_the_edge():
    for name in ("w020", "w040", "w131", "w222", "w111"):
        assert HopkinsPair(**{name: 2.5}).wavefront(0.0, 1.0) == pytest.approx(2.5)


def test_defocus_alone_is_sinc():
    fields = HopkinsPair(w020=1.25).pupil_fields()
    found = overlap(*fields, np.array([1.0]), 1e-9)
    value = found.value[0] * np.exp(2j * np.pi * found.opd_m[0])
    # ∫ exp(i 2π W ρ²) over the unit disc / π = exp(iπW) sinc(W)
    assert value == pytest.approx(np.exp(1j * np.pi * 1.25) * np.sinc(1.25), abs=1e-10)


@pytest.mark.parametrize(
    "name, value", [("w020", math.nan), ("w131", math.inf), ("obscuration", 1.0), ("shift_x", math.nan)]
)
def test_broken_input_is_refused(name, value):
    with pytest.raises(InputError, match=name):
        HopkinsPair(**{name: value})
