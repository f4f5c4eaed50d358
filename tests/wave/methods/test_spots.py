"""Overlaps without phase: discs of rays, and diffraction's 0.57/√W020."""

import math

import numpy as np
import pytest
from cases import PAIRS, quadrature

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods.geometric import Geometric, geometric_overlap
from cgi_wave.wave.methods.incoherent import Incoherent, incoherent_overlap


def beam(**waves):
    return HopkinsPair(**waves).pupil_fields()[0]


@pytest.mark.parametrize(
    ("m", "l", "want"),
    [
        (beam(w020=3.0), beam(w020=5.0), 0.6),  # uniform discs: what Eq. 4 says
        (beam(w020=3.0, w222=4.0), beam(w020=9.0), math.sqrt(3 * 7 / 81)),  # an ellipse in a disc
        (beam(w020=3.0, obscuration=0.5), beam(w020=3.0), math.sqrt(0.75)),  # a ring in a disc
        (beam(w020=3.0, w111=4.0), beam(w020=3.0), 2 / np.pi * (math.acos(1 / 3) - math.sqrt(8) / 9)),  # a lens
        (beam(w020=3.0, w111=13.0), beam(w020=3.0), 0.0),
    ],
)
def test_spots(m, l, want):  # noqa: E741
    found = geometric_overlap(m, l, 1.0)
    assert abs(found.value - want) <= found.error
    assert found.error < 0.03


def test_points():
    assert geometric_overlap(beam(w020=3.0), beam(), 1.0).value == 0.0
    assert geometric_overlap(beam(), beam(), 1.0).value == 1.0
    assert geometric_overlap(beam(w111=2.0), beam(), 1.0).value == 0.0
    assert geometric_overlap(beam(), beam(shift_x=3.0), 1.0).value == 1.0  # pupils apart, spots together


def test_methods_promise_nothing():
    m, l = HopkinsPair(w020=2.0).pupil_fields()  # noqa: E741
    for method in (Geometric(), Incoherent()):
        assert method.supports(m, l, 1.0) is None
        assert method.error_bound(m, l, 1.0, 1e-3) == math.inf
        assert 0.0 < method.cost(m, l, 1.0, 3e-2) < math.inf
        found = method.evaluate(m, l, 1.0, 3e-2)
        assert found.error_bound == math.inf
        assert found.value.imag == 0.0


@pytest.mark.parametrize("waves", [20.25, 60.3])
def test_diffraction_falls_as_the_root_of_defocus(waves):
    found = incoherent_overlap(*HopkinsPair(w020=waves).pupil_fields(), 1.0, 1e-2)
    assert found.value == pytest.approx(0.57 / math.sqrt(waves), rel=0.03)
    assert found.error < 0.06 * found.value + 0.005


@pytest.mark.parametrize("name", PAIRS)
def test_is_an_upper_bound_of_the_contrast(name):
    m, l = PAIRS[name].pupil_fields()  # noqa: E741
    found = incoherent_overlap(m, l, 1.0, 3e-2)
    exact, own = quadrature(m, l)
    assert abs(exact) - own <= found.value + found.error
    assert found.value <= 1.0


def test_refines_to_its_own_error():
    m, l = HopkinsPair(w020=1.25).pupil_fields()  # noqa: E741
    rough, fine = (incoherent_overlap(m, l, 1.0, tol) for tol in (5e-2, 4e-3))
    assert abs(rough.value - fine.value) <= rough.error
    same = incoherent_overlap(l, l, 1.0, 1e-2)
    assert abs(same.value - 1.0) <= same.error


def test_refuses():
    with pytest.raises(MethodLimitError, match="leaves out"):
        incoherent_overlap(*HopkinsPair().pupil_fields(), 1.0, 1e-5)
    assert "exceeded" in Incoherent().supports(*HopkinsPair(w111=5000.0).pupil_fields(), 1.0)
    m, l = HopkinsPair().pupil_fields()  # noqa: E741
    with pytest.raises(InputError):
        geometric_overlap(m, l, -1.0)
