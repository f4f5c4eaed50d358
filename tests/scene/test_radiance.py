"""Radiance: the solar constant, the grid's convergence, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.scene.coherence import coherence, max_opd
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.radiance import solar_irradiance, toa_radiance

NIR = Filter(764e-9, 2.6e-9, "flat-top")


def test_continuum_integrates_to_the_solar_constant():
    """Stefan–Boltzmann: ∫ = σT⁴(R/au)² = 1361 W/m² for the nominal Sun."""
    sigma = np.linspace(1e3, 2e7, 200_001)
    total = np.sum(solar_irradiance(sigma)) * (sigma[1] - sigma[0])
    assert total == pytest.approx(5.670374419e-8 * 5772**4 * (6.957e8 / 1.495978707e11) ** 2, rel=1e-4)
    assert total == pytest.approx(1361, abs=1)


def test_radiance_scales_with_albedo_and_sun():
    one = toa_radiance("solar", NIR, 1e-3, albedo=0.2, air_mass=2.0)
    two = toa_radiance("solar", NIR, 1e-3, albedo=0.4, air_mass=3.0)  # sun at 60° from the zenith
    assert two.radiance == pytest.approx(one.radiance, rel=1e-12)
    assert one.radiance == pytest.approx(0.2 / np.pi * solar_irradiance(one.sigma), rel=1e-12)


@pytest.mark.parametrize("shape", ["gaussian", "flat-top"])
def test_halving_the_step_leaves_the_modulation(shape):
    band = Filter(764e-9, 2.6e-9, shape)
    coarse = toa_radiance("o2a", band, 2e-3)
    fine = toa_radiance("o2a", band, 2 * max_opd(coarse))
    assert fine.sigma.size > 1.9 * coarse.sigma.size
    opd = np.linspace(1.2e-3, 1.5e-3, 31)
    difference = np.abs(coherence(fine, band, opd) - coherence(coarse, band, opd))
    assert difference.max() < 1e-6


def test_layers_have_converged():
    opd = np.linspace(1.2e-3, 1.5e-3, 31)
    few, many = (coherence(toa_radiance("o2a", NIR, 2e-3, layers=n), NIR, opd) for n in (8, 40))
    assert np.abs(few - many).max() < 5e-4


def test_grid_carries_the_opd_asked_for():
    assert max_opd(toa_radiance("solar", NIR, 0.05)) >= 0.05
    with pytest.raises(MethodLimitError) as caught:
        toa_radiance("o2a", NIR, 1000.0)
    assert caught.value.factor > 1


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"kind": "lamp"}, "kind"),
        ({"albedo": 0.0}, "albedo"),
        ({"albedo": float("nan")}, "albedo"),
        ({"air_mass": 1.0}, "air_mass"),
        ({"max_opd_m": -1.0}, "max_opd_m"),
    ],
)
def test_scene_that_cannot_be_is_refused_by_field(changes, field):
    with pytest.raises(InputError) as caught:
        toa_radiance(**{"kind": "o2a", "band_filter": NIR, "max_opd_m": 1e-3, **changes})
    assert caught.value.field == field
