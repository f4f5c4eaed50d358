"""Every sampling method against closed forms and pupil quadrature: its bound holds, its promise is kept."""

import math

import numpy as np
import pytest
from cases import PAIRS, cut_pair, defocus, quadrature

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods.fft import PrunedFft, WindowFft
from cgi_wave.wave.methods.huygens import Huygens
from cgi_wave.wave.methods.matrix import ChirpZ, MatrixFourier
from cgi_wave.wave.methods.nufft import Nufft

pytest.importorskip("finufft")
PATCHED = [PrunedFft(), MatrixFourier(), ChirpZ(), Nufft()]
ALL = [WindowFft(), *PATCHED]


def names(method):
    return method.name


@pytest.mark.parametrize("method", ALL, ids=names)
@pytest.mark.parametrize("name", PAIRS)
def test_bounds_hold(method, name):
    m, l = PAIRS[name].pupil_fields()  # noqa: E741
    exact, own = quadrature(m, l)
    for tol in (3e-2, 6e-3):
        assert method.supports(m, l, 1.0) is None
        promise = method.error_bound(m, l, 1.0, tol)
        found = method.evaluate(m, l, 1.0, tol)
        assert abs(found.value - exact) <= found.error_bound + own
        assert found.error_bound <= promise * (1.0 + 1e-9)
        assert promise <= tol
        assert 0.0 < method.cost(m, l, 1.0, tol) < math.inf
        assert found.nodes > 0
        assert found.method == method.name


@pytest.mark.parametrize("method", ALL, ids=names)
def test_fitted_apodised_cut_beams_with_a_phase(method):
    m, l = cut_pair()  # noqa: E741
    exact, own = quadrature(m, l, 1.0e6)
    found = method.evaluate(m, l, 1.0e6, 2e-2)
    assert abs(found.value - exact) <= found.error_bound + own
    assert found.error_bound <= 2e-2


def test_whole_window_to_closed_form_at_a_fine_tolerance():
    for waves in (0.0, 1.25, 10.25, 137.3):
        m, l = HopkinsPair(w020=waves).pupil_fields()  # noqa: E741
        tol = 1e-5 * max(1.0, waves)
        found = WindowFft().evaluate(m, l, 1.0, tol)
        assert abs(found.value - defocus(waves)) <= found.error_bound <= tol


def test_direct_summation_agrees_with_the_closed_form():
    m, l = HopkinsPair(w020=1.25).pupil_fields()  # noqa: E741
    found = Huygens().evaluate(m, l, 1.0, 3e-2)
    assert abs(found.value - defocus(1.25)) <= found.error_bound <= 3e-2


@pytest.mark.parametrize("method", [*ALL, Huygens()], ids=names)
def test_refuses_beyond_its_limit_and_names_the_factor(method):
    m, l = HopkinsPair(w020=20_000.0).pupil_fields()  # noqa: E741
    assert "exceeded" in method.supports(m, l, 1.0)
    assert method.error_bound(m, l, 1.0, 1e-3) == math.inf
    assert method.cost(m, l, 1.0, 1e-3) == math.inf
    with pytest.raises(MethodLimitError) as info:
        method.evaluate(m, l, 1.0, 1e-3)
    assert info.value.factor > 1.0
    assert info.value.method


def test_whole_window_names_the_factor_of_four_samples_per_wave():
    m, l = HopkinsPair(w020=2048.0).pupil_fields()  # noqa: E741
    with pytest.raises(MethodLimitError, match="finer") as info:
        WindowFft(cap=2048).evaluate(m, l, 1.0, 1e-2)
    assert info.value.factor == pytest.approx(4.0 / 0.95, rel=0.01)


@pytest.mark.parametrize("method", PATCHED, ids=names)
def test_a_patch_cannot_keep_a_small_tolerance(method):
    # the light beyond a patch falls as 1/side: 1e-6 would take a million points a side
    m, l = HopkinsPair().pupil_fields()  # noqa: E741
    with pytest.raises(MethodLimitError, match="leaves out"):
        method.evaluate(m, l, 1.0, 1e-6)


@pytest.mark.parametrize("method", ALL, ids=names)
def test_pupils_that_do_not_meet_give_zero(method):
    found = method.evaluate(*HopkinsPair(shift_x=2.2).pupil_fields(), 1.0, 1e-3)
    assert found.value == 0.0
    assert found.error_bound == 0.0


@pytest.mark.parametrize("method", ALL, ids=names)
def test_refuses_a_wavenumber_that_was_not_traced(method):
    m, l = HopkinsPair().pupil_fields()  # noqa: E741
    with pytest.raises(MethodLimitError):
        method.evaluate(m, l, 2.0, 1e-2)
    with pytest.raises(InputError):
        method.evaluate(m, l, np.nan, 1e-2)
