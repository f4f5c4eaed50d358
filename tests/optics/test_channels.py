"""Several channels in one file: a band gets the detector, the interferometer and the values of its own channel."""

import copy

import pytest
from small_instruments import WIDE, detector, document, frame, michelson, surface

from cgi_wave.errors import InputError
from cgi_wave.optics.system import from_document
from cgi_wave.rays.paths import find_paths


def two_channels():
    """A plate at 45° in front of two detectors: one behind it, one in the light that it reflects upwards."""
    plate = (surface("front", "glass", 2.0, aperture=WIDE, coating="short", nominal="reflect"),
             surface("back", "behind", aperture=WIDE))  # fmt: skip
    frames = [
        frame("plate", "room", *plate, rotate_deg=[45.0, 0.0, 0.0], start_mm=30.0),
        frame("straight", "behind", {**detector(), "name": "far"}, start_mm=80.0),
        frame("upwards", "room", {**detector(), "name": "near"}, shift_mm=[0.0, 0.0, 30.0],
              rotate_deg=[-90.0, 0.0, 0.0], start_mm=50.0),
    ]  # fmt: skip
    coating = {"short": {"reflectance": 0.9, "transmittance": 0.1}, "long": {"reflectance": 0.2, "transmittance": 0.8}}
    raw = document(frames, {"room": 1.0, "glass": 1.5, "behind": 1.0}, coating=coating)
    sensor = {"pixel_um": 10.0, "columns": 100, "rows": 100}
    del raw["detector"]
    raw["channel"] = {
        "SIDE": {"detector": {**sensor, "surface": "near"}},
        "THROUGH": {
            "detector": {**sensor, "surface": "far", "rows": 300},
            "set": {"front.nominal": "transmit", "front.coating": "long", "plate.shift_mm": [0.0, 0.0, 1.0]},
        },
    }
    band = raw["band"].pop("B")
    raw["band"] = {
        "S-1": {**band, "channel": "SIDE"},
        "T-1": {**band, "channel": "THROUGH", "zone_rows": [200, 300]},
        "T-2": {**band, "channel": "THROUGH", "set": {"front.coating": "short"}},
    }
    return raw


def test_a_band_is_resolved_with_its_channel():
    instrument = from_document(two_channels())
    assert instrument.channels == {"SIDE": ("S-1",), "THROUGH": ("T-1", "T-2")}
    side, first, second = (instrument.band(name) for name in instrument.bands)
    assert [s.surfaces[s.detector].name for s in (side, first, second)] == ["near", "far", "far"]
    assert (side.document.detector.rows, first.document.detector.rows) == (100, 300)
    # All surfaces stand in one world; a band's own values come after its channel's.
    assert [s.surfaces[0].nominal for s in (side, first)] == ["reflect", "transmit"]
    assert [s.surfaces[0].coating.transmittance for s in (side, first, second)] == [0.1, 0.8, 0.1]
    assert first.surfaces[0].origin[2] - side.surfaces[0].origin[2] == pytest.approx(1e-3, abs=1e-15)


def test_nominal_light_goes_where_the_channel_says():
    instrument = from_document(two_channels())
    assert [str(find_paths(instrument.band(b), 0, 0)[0]) for b in ("S-1", "T-1")] == ["front:r", "front back"]
    ghosts = find_paths(instrument.band("S-1"))
    assert [str(p) for p in ghosts if p.order == 1] == []  # the bare back face has no reflectance here


def test_a_file_without_channels_has_one():

    raw = copy.deepcopy(two_channels())
    raw["detector"] = raw.pop("channel")["SIDE"]["detector"]
    raw["band"] = {"S-1": {k: v for k, v in raw["band"]["S-1"].items() if k != "channel"}}
    assert from_document(raw).channels == {"": ("S-1",)}
    assert michelson().document.channel == {}


def _both(raw):
    raw["detector"] = raw["channel"]["SIDE"]["detector"]


def _neither(raw):
    del raw["channel"]


def _no_detector(raw):
    del raw["channel"]["SIDE"]["detector"]


def _records_nothing(raw):
    raw["channel"]["SIDE"]["detector"]["surface"] = "nowhere"


def _no_channel(raw):
    del raw["band"]["S-1"]["channel"]


def _unknown_channel(raw):
    raw["band"]["S-1"]["channel"] = "ASIDE"


def _channel_of_none(raw):
    raw["detector"] = raw.pop("channel")["SIDE"]["detector"]


def _zone_of_other_detector(raw):
    raw["band"]["S-1"]["zone_rows"] = [200, 300]


def _unknown_coating(raw):
    raw["channel"]["THROUGH"]["set"]["front.coating"] = "longer"


def _unknown_nominal(raw):
    raw["channel"]["THROUGH"]["set"]["front.nominal"] = "pass"


def _renamed(raw):
    raw["channel"]["THROUGH"]["set"]["front.name"] = "back"


def _splits(raw):
    for channel in raw["channel"].values():
        arms = {"arm1": {"surfaces": ["front"]}, "arm2": {"surfaces": ["back"]}}
        channel["interferometer"] = {"splitter": "front", **arms}
    raw["frame"][0]["surface"][1]["nominal"] = "both"


CASES = [
    # what is broken, part of the field named, part of the value shown, part of the remedy
    (_both, "detector", "table", "channel.NAME.detector"),
    (_neither, "detector", "None", "declare"),
    (_no_detector, "channel.SIDE.detector", "None", "detector of its own"),
    (_records_nothing, "channel.SIDE.detector.surface", "nowhere", "recording surface"),
    (_no_channel, "band.S-1.channel", "None", "SIDE, THROUGH"),
    (_unknown_channel, "band.S-1.channel", "ASIDE", "SIDE, THROUGH"),
    (_channel_of_none, "band.S-1.channel", "SIDE", "remove it"),
    (_zone_of_other_detector, "band.S-1.zone_rows", "300", "0 to 100"),
    (_unknown_coating, "front.coating", "longer", "declare it"),
    (_unknown_nominal, "nominal", "pass", "docs/instrument.md"),
    (_renamed, "channel.THROUGH.set.front.name", "back", "surface.field"),
    (_splits, "back.nominal", "both", "splitter"),
]


@pytest.mark.parametrize(("damage", "field", "value", "remedy"), CASES, ids=[case[0].__name__ for case in CASES])
def test_channels_that_make_no_sense_are_refused(damage, field, value, remedy):
    raw = two_channels()
    damage(raw)
    with pytest.raises(InputError) as caught:
        from_document(raw, "broken.toml")
    assert field in caught.value.field
    assert value in str(caught.value)
    assert remedy in caught.value.remedy
