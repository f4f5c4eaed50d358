"""Published ray listings, and the pieces of the studies of listings, slopes and reversed ghosts."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.paths import find_paths

sys.path.append(str(Path(__file__).parents[2] / "validation"))

import listing_codev
import listing_cooke
import listings
import reversal
import slopes

HALF = listings.HALF


def stored(name):
    return json.loads((listings.DATA / f"{name}.json").read_text(encoding="utf-8"))


def test_every_ray_of_the_double_gauss_to_the_last_printed_digit():
    """CODE V's listing: positions, slopes, lengths and angles at every surface, ends of the rays between."""
    found = listings.codev("codev_double_gauss")
    assert found["figures"] == found["agree"] == 854
    # Which sphere the wave aberrations were taken on is not printed: one of 28 hangs on it.
    assert found["opd_figures"] == 28 and found["opd_agree"] >= 27 and found["opd_worst_waves"] < 5e-3


def test_rays_of_the_tilted_mirrors_within_the_digits_of_their_prescription():
    """Tilts rounded at 5e-7° turn rays by 2e-8 rad over 300 mm: 5 units of the last digit of a position, at most."""
    document = stored("codev_three_mirror")
    lens = listing_codev.load(listings.DATA / "codev_three_mirror.seq", listings.LISTINGS["codev_three_mirror"])
    some = [field | {"fan": []} for field in document["fields"][3:]]
    rows, ends = listings.residuals(lens, some, document["pupil_radius_mm"])
    assert len(rows) == 50
    assert (np.abs(rows[:, 3:5]) <= HALF).all() and (np.abs(rows[:, 6:]) <= HALF).all()
    assert np.abs(rows).max() < 5.0 and np.abs(ends).max() < 10.0
    # The coefficient of r⁴ that the import leaves out moves rays by hundreds of units: the comparison sees it.
    lens.bent = (*lens.bent[:3], 0.0)
    assert np.abs(listings.residuals(lens, some[:1], document["pupil_radius_mm"])[0]).max() > 100.0


def test_extraction_reads_what_is_stored():
    """A listing made of stored rows comes back as they are."""
    field = stored("codev_double_gauss")["fields"][1]
    lines = ["CODE V> ana", "ANA> go"]
    for ray in field["rays"]:
        lines.append(" OBJ            0.00E+00  -0.18E+12   0.00E+00" + "".join(f"{v:13.6f}" for v in field["tangent"]))
        for k, row in enumerate(ray["rows"]):
            texts = [
                f"{v:{w}.{d}f}"
                for v, w, d in zip(row, (20, 11, 11, 13, 11, 11, 12, 11), [6] * 6 + [2] * 2, strict=True)
            ]
            lines.append(f"{k + 1:4d} " + "".join(texts))
        if ray["pupil"] == [0.0, 0.0]:
            lines.append("  0.00  0.00" + "".join(f"{v:12.6f}" for v in field["image"]) + "   0.000000")
        lines.append("")
    found = listing_codev.extract("\n".join(lines), 25.0)
    assert len(found) == 1 and found[0]["image"] == field["image"]
    assert found[0]["rays"] == field["rays"]


def test_zemax_ghost_listing_of_the_triplet():
    """28 printed figures of ghost 2-1: to the last digit, but for F-numbers, which know an index to seven digits."""
    found = listing_cooke.study()
    assert found["figures"] == 28
    assert found["f_numbers_apart_worst_units"] <= HALF
    assert found["worst_units_fitted"] <= HALF
    assert abs(found["index_shift"]["SK16"]) < 2e-6 and abs(found["index_shift"]["F2"]) < 1e-6


@pytest.fixture(scope="module")
def band():
    system = load_instrument().band("NIR")
    return system, find_paths(system, max_order=1)


def test_reversed_ghosts_end_where_they_began(band):
    """A ghost in the lens, one in the interferometer, one off the detector through other arms."""
    system, paths = band
    back = reversal.reversed_system(system)
    wanted = ("L3_front:r", "plate2_back:r", "detector:r arms 1-2")
    chosen = [next(path for path in paths if path.label.startswith(label)) for label in wanted]
    for path in chosen:
        p, theta = reversal.beam(system, path, system.field_points()[0])
        found = reversal.there_and_back(system, back, path, p, theta)
        assert found["rays"] >= 5 and found["lost"] == 0
        assert found["position_m"] < 1e-13 and found["direction"] < 1e-12
        assert found["opl_m"] < 1e-12 and found["power"] < 1e-12 and found["etendue"] < 1e-12


def test_branches_of_a_plate_stack_add_up():
    found = reversal.energy(order=5)
    assert found["cut"] > 1e-8  # else nothing is tested
    assert abs(found["missing"]) < 1e-14


def test_slopes_say_why_the_count_is_wrong(band):
    """Light reflected inside plate 2 has the nominal slope, the count says a third; the filter's ghost has more."""
    system, paths = band
    straight = slopes.straightened("NIR", None)
    nominal = [path for path in paths if path.order == 0][:2]

    def row(label):
        path = next(path for path in paths if path.label == label)
        return slopes.compare(system, straight, path, nominal, system.field_points()[0])

    inside = row("plate2_back:r arms 2")
    assert inside["reason"] == slopes.PIECES["weights"]
    assert inside["ratio"] == pytest.approx(3.0, abs=0.05)
    assert inside["nominal_check"] < 1e-3
    filtered = row("filter_front:r arms 2-1")
    assert filtered["reason"] == slopes.PIECES["geometry"]
    assert filtered["exact"] - filtered["counted"] == pytest.approx(filtered["geometry"], rel=0.01)
    assert row("plate1_back:r arms 1")["reason"] == ""
