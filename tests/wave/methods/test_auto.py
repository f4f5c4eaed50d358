"""The choice of method: what is promised is kept, the cheapest goes first, prices are kept between runs."""

import json
import math

import numpy as np
import pytest

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods import auto, plans

PRICES = {"boundary": (3e-3, 6e-9), "panels": (2e-3, 2e-8), "fft": (1e-2, 4e-8), "fresnel": (9e-3, 3e-9)}


def prices():
    return PRICES


@pytest.mark.parametrize("w020, tol", [(0.3, 1e-9), (5.25, 1e-2), (50.1, 1e-6), (700.3, 1e-8)])
def test_chosen_methods_promise_and_keep(w020, tol):
    pair = HopkinsPair(w020=w020)
    exact = np.exp(1j * np.pi * w020) * np.sinc(w020)
    chosen = auto.choose(*pair.pupil_fields(), 1.0, tol, price=prices)
    assert [s for _, s in chosen] == sorted(s for _, s in chosen)
    for name, _ in chosen[:2]:
        found = auto.contrast(pair, tol, name)
        assert abs(found.value - exact) <= found.error_bound <= tol


def test_few_waves_go_by_area_and_many_along_the_boundary():
    few, many = HopkinsPair(w020=0.5), HopkinsPair(w020=800.0)
    assert auto.choose(*few.pupil_fields(), 1.0, 1e-8, price=prices)[0][0] == "panels"
    assert auto.choose(*many.pupil_fields(), 1.0, 1e-8, price=prices)[0][0] == "boundary"


def test_a_tolerance_that_no_grid_keeps_is_refused_with_what_can_be_had():
    fields = HopkinsPair(w020=20.0).pupil_fields()
    with pytest.raises(MethodLimitError, match="ask for") as info:
        auto.choose(*fields, 1.0, 1e-9, names=("fft",), price=prices)
    assert info.value.factor > 1.0


def test_unknown_method():
    with pytest.raises(InputError, match="boundary"):
        auto.method("guess")


def test_prices_are_measured_once_and_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    calls = []
    monkeypatch.setattr(auto, "_price", lambda way, many: calls.append(way.name) or (1e-3, 1e-9))
    auto.prices.cache_clear()
    first = auto.prices()
    auto.prices.cache_clear()
    assert auto.prices() == first
    assert len(calls) == len(first) == len(auto.CHOICE)
    kept = json.loads((plans.cache_folder() / "prices.json").read_text())
    assert all(math.isfinite(call + step) for call, step in kept["prices"].values())
    (plans.cache_folder() / "prices.json").write_text("torn")
    auto.prices.cache_clear()
    assert auto.prices() == first
    auto.prices.cache_clear()


def test_cost_of_a_step_is_measured_on_this_machine():
    call, step = auto._price(auto.method("panels"), 10.0)
    assert 0.0 < call < 10.0
    assert 0.0 < step < 1e-3
