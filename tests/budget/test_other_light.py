"""Light of the other channel on a channel's detector: a plate that sends it there, by closed forms; refusals."""

import copy

import numpy as np
import pytest

from cgi_wave.budget.other_light import other_light
from cgi_wave.errors import InputError
from cgi_wave.optics.schema import read_document
from cgi_wave.optics.system import REFERENCE, from_document
from cgi_wave.rays.paths import find_paths
from cgi_wave.scene.radiance import solar_irradiance

#: Dichroic front in the light of each channel, AR back: (reflectance, transmittance).
VISIBLE, SWIR, BACK = (0.98, 0.02), (0.02, 0.98), (0.01, 0.99)


@pytest.fixture(scope="module")
def small():
    """The reference with bare continuum in every band and a SWIR band at the VIS band's wavelength.

    Geometry and glass are then the same for both lights, and powers follow from the coatings alone.
    """
    raw = copy.deepcopy(read_document(REFERENCE))
    vis = raw["band"]["VIS"]
    raw["band"] = {"VIS": vis, "SWIR2": {**raw["band"]["SWIR2"]}}
    raw["band"]["SWIR2"] |= {key: vis[key] for key in ("filter", "wavelengths_nm")}
    raw["band"]["SWIR2"]["spectrum"] = vis["spectrum"]
    raw["channel"]["VISNIR"]["out_of_band"] |= {"range_nm": [440.0, 460.0]}
    return raw


@pytest.fixture(scope="module")
def found(small):
    return other_light(from_document(small), "VIS")


def test_the_other_light_has_the_coatings_of_its_channel_and_the_optics_of_this_one(small):
    instrument = from_document(small)
    system = instrument.other_light("VIS", "SWIR2")
    front = system.surfaces[system.number["dichroic_front"]]
    assert (front.coating.reflectance, front.coating.transmittance) == SWIR
    assert front.nominal == "reflect"
    assert system.surfaces[system.detector].name == "detector"
    assert np.array_equal(system.field_points(), instrument.band("VIS").field_points())
    assert str(find_paths(system, 0, 0)[0]) == str(find_paths(instrument.band("VIS"), 0, 0)[0])


def test_front_face_sends_what_its_reflectance_says(found):
    """Same wavelength, same rays: the ratio of powers is that of the reflectances and of the radiance let in."""
    row = next(row for row in found["rows"] if row["order"] == 0)
    sigma = np.linspace(1 / 460e-9, 1 / 440e-9, 2000)
    light = np.trapezoid(solar_irradiance(sigma), sigma)
    passband = np.linspace(1 / 470e-9, 1 / 430e-9, 4000)
    through = np.exp(-np.log(2) * (2 * (1 / passband - 450e-9) / 5e-9) ** 2) * solar_irradiance(passband)
    expected = SWIR[0] / VISIBLE[0] * light / np.trapezoid(through, passband)
    assert row["paths"] == 2
    assert row["unrejected"] == pytest.approx(expected, rel=1e-3)
    assert row["power"] == pytest.approx(expected * 1e-4 * 1e-2 / 0.95, rel=1e-3)


def test_back_face_sends_what_passes_the_front_twice(found):
    """T·R·T of the faces against the front's R, but for what the displacement by 5 mm of silica loses."""
    front = next(row for row in found["rows"] if row["order"] == 0)
    back = next(row for row in found["rows"] if row["reflections"].count("dichroic_back:r") == 1)
    assert back["reflections"] == "dichroic_front:t dichroic_back:r dichroic_front:t"
    ratio = SWIR[1] ** 2 * BACK[0] / SWIR[0]
    assert 0.8 * ratio < back["power"] / front["power"] < 1.02 * ratio
    assert back["power"] == max(row["power"] for row in found["rows"] if row["order"] == 1)


def test_power_is_proportional_to_what_is_assumed(small, found):
    raw = copy.deepcopy(small)
    raw["channel"]["VISNIR"]["out_of_band"] |= {"filter_transmittance": 1e-3, "detector_response": 0.5}
    again = other_light(from_document(raw), "VIS")
    assert again["power"] == pytest.approx(500 * found["power"], rel=1e-12)
    assert again["unrejected"] == pytest.approx(found["unrejected"], rel=1e-12)


def test_nothing_declared_is_nothing_computed(small):
    assert other_light(from_document(small), "SWIR2") is None


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"filter": "pane"}, "filter"),
        ({"filter_transmittance": 1.5}, "filter_transmittance"),
        ({"detector_response": -0.1}, "detector_response"),
        ({"range_nm": [2500.0, 1100.0]}, "range_nm"),
    ],
)
def test_assumptions_that_make_no_sense_are_refused(small, change, field):
    raw = copy.deepcopy(small)
    raw["channel"]["VISNIR"]["out_of_band"] |= change
    with pytest.raises(InputError) as caught:
        from_document(raw)
    assert caught.value.field == f"channel.VISNIR.out_of_band.{field}"
