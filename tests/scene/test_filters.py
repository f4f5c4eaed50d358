"""Filters: shape, support, refusals, coverage."""

from __future__ import annotations

import numpy as np
import pytest

from cgi_wave.errors import InputError
from cgi_wave.scene.filters import Filter, require_coverage
from cgi_wave.scene.spectrum import Spectrum


@pytest.mark.parametrize("shape", ["gaussian", "flat-top"])
def test_half_maximum_stands_at_the_stated_width_in_wavelength(shape):
    band = Filter(764e-9, 2.6e-9, shape, peak=0.9)
    half = band.transmission(1 / np.array([762.7e-9, 764e-9, 765.3e-9]))
    assert half == pytest.approx([0.45, 0.9, 0.45], rel=1e-9)


@pytest.mark.parametrize("shape", ["gaussian", "flat-top"])
def test_support_holds_all_but_a_millionth(shape):
    band = Filter(764e-9, 2.6e-9, shape)
    low, high = band.support()
    outside = np.concatenate((np.linspace(0.9 * low, low, 50), np.linspace(high, 1.1 * high, 50)))
    assert np.all(band.transmission(outside) <= 1e-6 * (1 + 1e-9))
    assert np.all(band.transmission(np.array([low + 200, high - 200])) > 1e-6)


def test_tabulated_filter_measures_itself_and_ends_where_its_table_does():
    wavelength = np.linspace(440e-9, 460e-9, 201)
    band = Filter.tabulated(wavelength, 0.8 * np.clip(1 - np.abs(wavelength - 450e-9) / 5e-9, 0, None))
    assert (band.centre_m, band.fwhm_m) == (pytest.approx(450e-9, abs=2e-11), pytest.approx(5e-9, abs=2e-11))
    assert band.transmission(1 / np.array([430e-9, 447.5e-9])) == pytest.approx([0.0, 0.4], abs=1e-12)
    assert band.support() == (pytest.approx(1 / 455e-9, rel=1e-9), pytest.approx(1 / 445e-9, rel=1e-9))


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"centre_m": -1.0}, "centre_m"),
        ({"centre_m": float("nan")}, "centre_m"),
        ({"fwhm_m": 0.0}, "fwhm_m"),
        ({"fwhm_m": 764e-9}, "fwhm_m"),
        ({"peak": 1.5}, "peak"),
        ({"shape": "square"}, "shape"),
        ({"shape": "tabulated"}, "table"),
        ({"shape": "tabulated", "table": ((2e-7, 0.5), (1e-7, 0.5))}, "table"),
        ({"shape": "tabulated", "table": ((1e-7, 0.5), (2e-7, -0.5))}, "table"),
        ({"table": ((1e-7, 0.5), (2e-7, 0.5))}, "table"),
    ],
)
def test_what_cannot_be_a_filter_is_refused_by_field(changes, field):
    with pytest.raises(InputError) as caught:
        Filter(**{"centre_m": 764e-9, "fwhm_m": 2.6e-9, **changes})
    assert caught.value.field == field


def test_missing_range_is_named_in_nanometres():
    band = Filter(764e-9, 2.6e-9, "flat-top")
    low, high = band.support()
    whole = Spectrum(np.linspace(low, high, 100), np.ones(100), "lamp")
    require_coverage(whole, band)
    short = Spectrum(np.linspace(low, 1 / 763e-9, 100), np.ones(100), "lamp.csv")
    with pytest.raises(InputError, match=r"761\.\d+–763\.000 nm missing") as caught:
        require_coverage(short, band)
    assert caught.value.file == "lamp.csv"
