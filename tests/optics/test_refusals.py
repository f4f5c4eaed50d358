"""A broken instrument file is refused with the file, the field, the value and a remedy."""

import copy
import re

import pytest

from cgi_wave.errors import InputError
from cgi_wave.optics.schema import read_document
from cgi_wave.optics.system import REFERENCE, from_document, load_instrument

RAW = read_document(REFERENCE)
FILE = "broken.toml"


def surface(raw, name):
    return next(item for frame in raw["frame"] for item in frame["surface"] if item["name"] == name)


def frame(raw, name):
    return next(item for item in raw["frame"] if item["name"] == name)


def _unknown_glass(raw):
    raw["space"]["L1"] = "N-PSK53B"


def _unknown_page(raw):
    # Close to a page that exists: a fuzzy search would take it.
    raw["glass"]["N-PK52A"] = "specs/SCHOTT-optical/N-PK52"


def _missing_arm(raw):
    del raw["channel"]["VISNIR"]["interferometer"]["arm2"]


def _empty_arm(raw):
    raw["channel"]["VISNIR"]["interferometer"]["arm2"]["surfaces"] = []


def _arm_of_nothing(raw):
    raw["channel"]["VISNIR"]["interferometer"]["arm1"]["surfaces"] = ["cube_arm1", "mirror9"]


def _no_interferometer(raw):
    del raw["channel"]["VISNIR"]["interferometer"]


def _crossing(raw):
    # The front of lens 1 behind its back: at the vertex still in order, at the rim not.
    surface(raw, "L1_front")["thickness_mm"] = 1.0


def _crossing_in_band(raw):
    raw["band"]["VIS"]["set"]["L1_front.thickness_mm"] = 1.0


def _negative_in_band(raw):
    raw["band"]["VIS"]["set"]["plate2_back.thickness_mm"] = -0.5


def _negative(raw):
    surface(raw, "L2_front")["thickness_mm"] = -4.0


def _filter_outside(raw):
    raw["band"]["NIR"]["filter"]["centre_nm"] = 785.0


def _no_width(raw):
    raw["band"]["VIS"]["filter"]["fwhm_nm"] = 0.0


def _unknown_coating(raw):
    surface(raw, "L1_front")["coating"] = "gold"


def _unknown_space(raw):
    surface(raw, "L1_front")["after"] = "L9"


def _beyond_sphere(raw):
    surface(raw, "L5_front")["aperture"] = {"radius_mm": 45.0}


def _no_aperture(raw):
    surface(raw, "stop")["aperture"] = {}


def _gain(raw):
    raw["coating"]["ar"]["transmittance"] = 1.2


def _zone_outside(raw):
    raw["band"]["VIS"]["zone_rows"] = [543, 1993]


def _attach_forward(raw):
    frame(raw, "front")["attach"] = "detector"


def _twice(raw):
    surface(raw, "L2_front")["name"] = "L1_front"


def _misspelt(raw):
    surface(raw, "L1_front")["raduis_mm"] = 10.0


def _wrong_type(raw):
    raw["entrance"]["radius_mm"] = "wide"


def _set_nothing(raw):
    raw["band"]["NIR"]["set"]["plate7_front.thickness_mm"] = 1.0


def _beyond_catalogue(raw):
    raw["band"]["VIS"]["wavelengths_nm"] = [90.0, 450.0]


CASES = [
    # what is broken, part of the field named, part of the value shown, part of the remedy
    (_unknown_glass, "space.L1", "N-PSK53B", r"declare it in \[glass\]"),
    (_unknown_page, "N-PK52", "specs/SCHOTT-optical/N-PK52", "shelf/book/page"),
    (_missing_arm, "interferometer", "arm2", "docs/instrument.md"),
    (_empty_arm, "interferometer.arm2", "[]", "mirror last"),
    (_arm_of_nothing, "interferometer.arm1", "mirror9", "surfaces of the file"),
    (_no_interferometer, "interferometer", "None", "arm1 and arm2"),
    (_crossing, "L1_front.thickness_mm", "1.0", "increase the thickness"),
    (_crossing_in_band, "L1_front.thickness_mm", "1.0", "increase the thickness"),
    (_negative_in_band, "plate2_back.thickness_mm", "-0.5", "along z"),
    (_negative, "L2_front.thickness_mm", "-4.0", "along z"),
    (_filter_outside, "band.NIR.filter.centre_nm", "785.0", "move the filter"),
    (_no_width, "band.VIS.filter", "0.0", "positive"),
    (_unknown_coating, "L1_front.coating", "gold", "declare it"),
    (_unknown_space, "L1_front.after", "L9", r"\[space\]"),
    (_beyond_sphere, "L5_front.aperture", "45.0", "reduce it"),
    (_no_aperture, "stop.aperture", "[]", "radius_mm or half_width_mm"),
    (_gain, "coating.ar", "1.2", "reflectance or transmittance"),
    (_zone_outside, "band.VIS.zone_rows", "1993", "1024"),
    (_attach_forward, "frame.front.attach", "detector", "earlier surface"),
    (_twice, "frame.front.surface", "L1_front", "own name"),
    (_misspelt, "surface[1]", "raduis_mm", "docs/instrument.md"),
    (_wrong_type, "entrance.radius_mm", "wide", "docs/instrument.md"),
    (_set_nothing, "plate7_front.thickness_mm", "1.0", "surface.field"),
    (_beyond_catalogue, "glass", "90", "nm"),
]


@pytest.mark.parametrize(("damage", "field", "value", "remedy"), CASES, ids=[case[0].__name__ for case in CASES])
def test_a_broken_instrument_is_refused(damage, field, value, remedy):
    raw = copy.deepcopy(RAW)
    damage(raw)
    with pytest.raises(InputError) as caught:
        from_document(raw, FILE)
    text = str(caught.value)
    assert caught.value.file == FILE
    assert text.startswith(f"{FILE}: ")
    assert field in caught.value.field
    assert value in text
    assert re.search(remedy, caught.value.remedy)


@pytest.mark.parametrize(
    ("line", "number", "field"),
    [
        (f"radius_mm = {surface(RAW, 'L4_front')['radius_mm']}", "nan", "frame["),
        (f'"focal.start_mm" = {RAW["band"]["NIR"]["set"]["focal.start_mm"]}', "inf", "band.NIR.set.focal.start_mm"),
    ],
)
def test_numbers_that_are_not_finite_are_refused(line, number, field, tmp_path):
    text = REFERENCE.read_text(encoding="utf-8")
    assert line in text
    file = tmp_path / FILE
    file.write_text(text.replace(line, f"{line.partition(' = ')[0]} = {number}"), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_instrument(file)
    assert caught.value.file == str(file)
    assert field in caught.value.field
    assert number in str(caught.value)
    assert "finite" in caught.value.remedy


def test_a_file_that_is_not_toml_is_refused_with_the_line(tmp_path):
    file = tmp_path / FILE
    file.write_text("name = half\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 1") as caught:
        load_instrument(file)
    assert caught.value.file == str(file)
    assert "not TOML" in str(caught.value) and "line" in caught.value.remedy


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read") as caught:
        load_instrument(tmp_path / "none.toml")
    assert "none.toml" in caught.value.file and "existing" in caught.value.remedy


def test_an_unknown_band_is_refused_with_those_that_there_are():
    with pytest.raises(InputError) as caught:
        load_instrument().band("nir")
    assert caught.value.file == str(REFERENCE)
    assert (caught.value.field, caught.value.value) == ("band", "nir")
    assert "NIR" in caught.value.remedy and "VIS" in caught.value.remedy


def test_the_file_as_it_is_passes():
    assert from_document(copy.deepcopy(RAW), FILE).bands == ("NIR", "VIS", "SWIR1-CH4", "SWIR1-CO2", "SWIR2")
