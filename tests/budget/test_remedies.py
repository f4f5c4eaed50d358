"""Remedies: scaled terms beside another file traced again, what a better coating is, guesses against the exact gain."""

import copy

import msgspec
import numpy as np
import pytest
from small_instruments import michelson

from cgi_wave.analysis import zone_rows
from cgi_wave.budget.outcome import STEP, rescaled, retraced, see
from cgi_wave.budget.remedies import (
    Remedy,
    Target,
    better,
    coating_remedies,
    meets_otherwise,
    parasitic,
    power_factors,
    scales_exactly,
    shift,
    tilt,
    values,
)
from cgi_wave.budget.select import Untraced, select_ghosts, untraced
from cgi_wave.budget.setting import band_setting
from cgi_wave.errors import InputError
from cgi_wave.optics.schema import CoatingSpec
from cgi_wave.optics.system import from_document
from cgi_wave.ranking import rank_remedies
from cgi_wave.rays.paths import find_paths

AR, RHO = 0.01, 0.05
#: Fine enough that the same pairs are computed for half of a coating.
TOLERANCE = 1e-5


@pytest.fixture(scope="module")
def raw():
    """A cube Michelson with four fringes over its zone."""
    return msgspec.to_builtins(michelson("front", ar=AR, rho=RHO, tilt=0.08).document)


@pytest.fixture(scope="module")
def small(raw):
    return from_document(raw).band("B")


@pytest.fixture(scope="module")
def light(small):
    return band_setting(small)


@pytest.fixture(scope="module")
def ghosts(small):
    """Nominal paths, the detectors' arm pairs, and the cube's faces towards the mirrors."""
    return find_paths(small, max_order=1)[:14]


def traced(system, paths, unseen=None):
    x0 = system.field_points()[1]
    return see(band_setting(system), paths, unseen or Untraced(), x0, zone_rows(system, x0), TOLERANCE)


@pytest.fixture(scope="module")
def before(small, ghosts):
    return traced(small, ghosts)


def coated(raw, **reflectance):
    """The instrument file with other reflectances, what is not reflected going on where it was transmitted."""
    other = copy.deepcopy(raw)
    for name, value in reflectance.items():
        coating = other["coating"][name]
        coating["transmittance"] = coating["transmittance"] and 1.0 - value
        coating["reflectance"] = value
    return from_document(other).band("B")


def remedy(system, name, factor):
    (found,) = (r for r in coating_remedies(system, find_paths(system, max_order=1), Target(factor)) if r.name == name)
    return found


@pytest.mark.parametrize(("name", "factor"), [("ar", 0.4), ("ar", 0.0), ("detector", 0.5)])
def test_scaled_terms_are_those_of_another_file_traced_again(raw, small, ghosts, before, name, factor):
    """To rounding: nothing but powers depends on a constant coating, nominal beams included."""
    change = remedy(small, name, factor)
    assert scales_exactly(small, change)
    got = rescaled(small, before, change)
    level = {"ar": AR, "detector": RHO}[name] * factor
    other = coated(raw, **{name: level})
    assert change.apply(small, from_document(raw)).surfaces[0].coating == other.surfaces[0].coating
    # Without any reflectance left these ghosts are gone, and a search would not find them.
    alive = [p for p in ghosts if level > 0.0 or not any("cube" in step for step, _ in p.history)]
    again = traced(other, alive)
    part = again.retrieval.coherent
    if len(alive) == len(ghosts):
        assert len(again.terms.coherency.pairs) == len(before.terms.coherency.pairs)
    assert got.nma_error == pytest.approx(part.nma_error.value, rel=1e-9)
    assert got.offset == pytest.approx(part.offset_over_baseline.value, rel=1e-9)
    assert got.modulation == pytest.approx(part.parasitic_over_modulation.value, rel=1e-8)
    assert got.transmission == pytest.approx(again.transmission, rel=1e-12)
    assert got.nma_error_bar == pytest.approx(part.nma_error.error, rel=1e-3)
    assert abs(got.gain) > 1e-4


def test_gain_of_a_scaled_remedy_is_surer_than_the_errors_that_it_is_made_of(small, before):
    """What both retrievals hold alike cancels; of what is scaled by a half, half of its doubt is in the difference."""
    outcome = rescaled(small, before, remedy(small, "detector", 0.5))
    assert 0.0 < outcome.gain_error < 0.9 * before.retrieval.coherent.nma_error.error
    nothing = rescaled(small, before, remedy(small, "detector", 1.0 - 1e-9))
    assert abs(nothing.gain) < 1e-9 and nothing.gain_error < 1e-6


def test_tangent_is_the_derivative_and_misses_by_the_curvature(small, before):
    """Ten times less of the way, ten times less gain and a hundred times less difference to the tangent."""
    misses = []
    for share in (0.5, 0.05):
        got = rescaled(small, before, remedy(small, "ar", 1.0 - share))
        misses.append(abs(got.tangent - got.gain))
        assert abs(got.tangent - got.gain) < 0.2 * abs(got.gain)
    assert misses[1] < 2e-2 * misses[0] + STEP * 1e-3


def test_power_factors_count_every_meeting(small, ghosts):
    """A path to the power of how often it is reflected and transmitted, counted on its printed form."""
    change = {name: CoatingSpec(reflectance=0.002, transmittance=0.998) for name in ("cube_arm1", "cube_in")}
    for path, factor in zip(ghosts, power_factors(small, ghosts, change), strict=True):
        words = str(path).split()
        reflected = sum(words.count(f"{name}:r") for name in change)
        passed = sum(words.count(name) for name in change)
        assert factor == pytest.approx((0.002 / AR) ** reflected * (0.998 / (1 - AR)) ** passed, rel=1e-12)


def test_a_better_coating_sends_the_light_where_it_is_meant_to_go(instrument):
    system = instrument.band("NIR")
    by_name = {s.name: s for s in system.surfaces}
    half = Target(0.5)
    lens, front, detector = (better(system, by_name[n], half) for n in ("L1_front", "dichroic_front", "detector"))
    assert (lens.reflectance, lens.transmittance) == pytest.approx((0.005, 0.995))
    assert (front.reflectance, front.transmittance) == pytest.approx((0.99, 0.01))
    assert front.reflect_phase_deg == by_name["dichroic_front"].coating.reflect_phase_deg
    assert (detector.reflectance, detector.transmittance) == (0.025, 0.0)
    assert better(system, by_name["splitter"], half) is None and better(system, by_name["M1"], half) is None
    value = Target(value=0.006)
    assert better(system, by_name["L1_front"], value).reflectance == 0.006
    assert better(system, by_name["cube_in"], value) is None


def test_bare_faces_and_new_phases_are_traced_again(raw):
    other = copy.deepcopy(raw)
    other["coating"]["ar"] = {"bare": True}
    system = from_document(other).band("B")
    face = system.surfaces[system.number["cube_in"]]
    assert parasitic(system, face) == pytest.approx(((1.5 - 1.0) / (1.5 + 1.0)) ** 2)
    new = better(system, face, Target(0.25))
    assert (new.reflectance, new.transmittance) == pytest.approx((0.01, 0.99))
    assert not scales_exactly(system, Remedy("surface", "cube_in", "", ("cube_in",), {"cube_in": new}))
    plain = from_document(raw).band("B")
    turned = CoatingSpec(reflectance=0.005, transmittance=0.995, reflect_phase_deg=90.0)
    assert not scales_exactly(plain, Remedy("surface", "cube_in", "", ("cube_in",), {"cube_in": turned}))
    assert not scales_exactly(plain, tilt(plain, "cube_in", 0.1))


def test_targets_that_improve_nothing_are_refused():
    for factor, value in ((1.0, None), (-0.1, None), (float("nan"), None), (0.5, 1.0), (0.5, -1.0)):
        with pytest.raises(InputError, match=r"rank.*coating"):
            Target(factor, value)


def test_untraced_ghosts_are_all_the_others_with_their_power(nir, setting, paths):
    taken = select_ghosts(setting, paths, 1e-2)[:20]
    rest = untraced(setting, paths, taken)
    assert len(rest.paths) == len(paths) - 20
    power, modulation = rest.bounds(np.ones(len(rest.paths)))
    assert power == pytest.approx(sum(p.estimate for p in paths if p.order and p not in taken))
    root = sum(2.1 * np.sqrt(p.estimate / paths[0].estimate) for p in rest.paths) / setting.nma
    assert 0.0 < modulation < root
    assert rest.bounds(np.zeros(len(rest.paths))) == (0.0, 0.0)


def test_a_move_that_moves_nothing_gains_nothing(raw, small, before, ghosts):
    """Traced again: gain zero, and an error that holds the doubt about the phases that a move would turn."""
    still = tilt(small, "cube_arm1", 0.0)
    got = retraced(small, before, traced(still.apply(small, from_document(raw)), ghosts), still)
    assert got.gain == pytest.approx(0.0, abs=1e-12) and got.gain_error > 0.0
    assert (got.spot_m, got.fringes) == pytest.approx((before.spot_m, before.fringes))


def test_which_ghosts_take_other_phases_from_a_move(small, ghosts):
    """The detector's retro-ghost meets mirror 2 twice in arms 2-2, otherwise than a nominal beam."""
    named = {p.label: p for p in ghosts}
    assert meets_otherwise(named["front:r arms 2-2"], ghosts[:2], ["mirror2"])
    assert not meets_otherwise(named["front:r arms 1-1"], ghosts[:2], ["mirror2"])
    assert meets_otherwise(named["cube_arm1:r arms 1"], ghosts[:2], ["cube_arm1"])
    assert not meets_otherwise(ghosts[1], ghosts[:2], ["mirror2"])


def test_ranking_orders_by_gain_and_says_what_a_remedy_costs(raw):
    """Both kinds of remedy, a coating's on the whole zone; mirror 2 tilted twice as far has twice the fringes."""
    instrument = from_document(raw)
    system = instrument.band("B")
    moves = [tilt(system, "mirror2", 0.08), shift(system, "mirror1", 0.01), tilt(system, "mirror2", 20.0),
             values(system, {"mirror2.tilt_deg": [0.16, 0.0, 0.0]})]  # fmt: skip
    said = []
    found = rank_remedies(instrument, "B", moves=moves, progress=said.append)
    rows = found.remedies
    gains = [row["gain"] for row in rows if row["gain"] is not None]
    assert gains == sorted(gains, reverse=True) and rows[-1]["gain"] is None
    assert "20°" in rows[-1]["change"] and rows[-1]["reason"]
    by = {(row["remedy"], row["change"]): row for row in rows}
    steeper = by["mirror2", "0.08° about x"]
    assert steeper["fringes_after"] == pytest.approx(2 * steeper["fringes_before"], rel=1e-2)
    same = by["values", "mirror2.tilt_deg = [0.16, 0.0, 0.0]"]
    assert same["nma_error_after"] == pytest.approx(steeper["nma_error_after"], abs=1e-8)
    assert {row["method"] for row in rows} == {"rescaled", "traced again"}
    assert by["ar", "R 0.01 to 0.005"]["transmission_after"] > by["ar", "R 0.01 to 0.005"]["transmission_before"]
    assert found.unimproved == {} and found.costs["total"]["nma"] == rows[0]["nma_error_before"]
    assert len(said) == 2 + len(moves)
