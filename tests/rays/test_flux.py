"""The Monte-Carlo walk: where light goes in systems with a closed form, exact sums, the sequential tracer beside it."""

import dataclasses

import numpy as np
import pytest
from small_instruments import build, detector, frame, michelson, published, singlet, surface

from cgi_wave.errors import InputError
from cgi_wave.kernels.walk import SLICE, UNIT, walk_rays
from cgi_wave.rays.flux import _arguments, flux, from_direction, from_field, lambertian
from cgi_wave.rays.ledger import SUMS
from cgi_wave.rays.paths import find_paths, parse_path
from cgi_wave.rays.trace import compile_sequence, trace

AHEAD = from_direction((0.0, 0.0))
ANALOG = float("inf")


def plate(coating=None, n=1.5, **first):
    """Two parallel faces 1 mm apart and a detector that takes all."""
    faces = (surface("one", "glass", 1.0, coating="face", **first), surface("two", "back", 5.0, coating="face"))
    return build([frame("plate", "front", *faces, detector(), start_mm=20.0)],
                 {"front": 1.0, "glass": n, "back": 1.0}, coating={"face": coating or {"bare": True}})  # fmt: skip


def near(found, value, sigmas=4.0):
    """Whether a share agrees with a closed form within its standard error (and rounding)."""
    return abs(found.share - value) <= sigmas * found.error + 1e-14


@pytest.mark.parametrize("split", [1e-4, 0.01, ANALOG])
def test_a_bare_plate_passes_airys_incoherent_sum(split):
    """T = (1 − R)²/(1 − R²): every order of reflection counts."""
    r = (0.5 / 2.5) ** 2
    found = flux(plate(), 5_000, source=AHEAD, split=split)
    assert near(found.at("detector", "detector"), (1 - r) ** 2 / (1 - r * r))
    assert near(found.at("left", "front"), 2 * r / (1 + r))
    assert found.imbalance == 0
    if split < 1:  # followed for itself but for the last 1e-4: almost no error is left
        assert found.at("detector", "detector").error < 1e-2 * split


@pytest.mark.parametrize("split", [1e-3, ANALOG])
def test_absorption_is_found_at_the_face_that_took_it(split):
    r, t, a = 0.3, 0.6, 0.1
    found = flux(plate({"reflectance": r, "transmittance": t}), 20_000, source=AHEAD, split=split)
    turns = 1 / (1 - r * r)
    assert near(found.at("detector", "detector"), t * t * turns)
    assert near(found.at("absorbed", "one"), a + a * t * r * turns)
    assert near(found.at("absorbed", "two"), a * t * turns)
    assert near(found.at("left", "front"), r + t * t * r * turns)
    assert found.imbalance == 0


def test_a_michelson_gives_half_to_each_port_and_half_of_that_by_each_arm():
    found = flux(michelson(), 2000)
    assert found.at("detector", "front").share == found.at("absorbed", "back").share == 0.5
    assert [path.share for path in found.paths] == [0.25, 0.25]
    assert found.imbalance == 0


def test_ghosts_of_a_michelson_weigh_the_product_of_their_coatings():
    ar, rho = 0.04, 0.2
    system = michelson(ar=ar, rho=rho)
    found = {path.path: path for path in flux(system, 300, split=1e-5, source=AHEAD).paths}
    for path in find_paths(system, max_order=1):
        weights = compile_sequence(system, path, system.sigma0).weight
        assert near(found[str(path)], np.prod(weights)), path.label
        assert found[str(path)].order == path.order
    orders = flux(system, 4000, split=1e-3, source=AHEAD).arrived
    first = sum(np.prod(compile_sequence(system, path, system.sigma0).weight)
                for path in find_paths(system, max_order=1) if path.order == 1)  # fmt: skip
    assert near(orders["order 1"], first)


@pytest.mark.parametrize("system", [singlet(60.0), published("cooke_triplet")], ids=["singlet", "triplet"])
def test_paths_carry_what_the_sequential_tracer_says(system):
    """Independent rays: random walks beside traced sequences, aperture by aperture, Fresnel by Fresnel."""
    found = flux(system, 60_000, split=3e-4, seed=3)
    rng = np.random.default_rng(11)
    r, angle = rng.random((2, 20_000))
    p = system.pupil_radius * np.sqrt(r)[:, None] * np.stack([np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)], 1)
    source = from_field(system)
    theta = rng.uniform(-1, 1, (len(p), 2)) * [source.a, source.b]
    compared = set()
    for path in found.paths:
        if path.order > 2:
            continue
        traced = trace(compile_sequence(system, parse_path(system, path.path), system.sigma0), p, theta)
        power = np.where(traced.passes, traced.power, 0.0)
        error = np.hypot(path.error, power.std() / np.sqrt(len(p)))
        assert abs(path.share - power.mean()) < 4.5 * error + 1e-14, path.path
        compared.add(path.path)
    assert len(compared) >= 2
    assert compared == {str(path) for path in find_paths(system)}


@pytest.mark.parametrize("split", [1e-5, 0.02, 0.3, ANALOG])
def test_the_ledger_closes_to_the_last_unit(split):
    """Whatever the lots do: scattering, absorption, vignetting, a depth that cuts, weights that are not round."""
    coating = {"reflectance": 0.21, "transmittance": 0.7, "scatter": {"tis": 0.07, "l": 0.02, "s": -1.6}}
    found = flux(plate(coating, aperture=3.0), 3 * SLICE + 7, split=split, max_depth=3, source=lambertian(20.0))
    assert found.imbalance == 0
    assert sum(found.sum(name) for name in SUMS) == pytest.approx(1.0, abs=1e-15)
    assert {entry.kind for entry in found.entries} == {"detector", "absorbed", "rim", "left", "depth"}
    paths = sum(path.share for path in found.paths) + found.others
    arrived = sum(share.share for share in found.arrived.values())
    assert paths <= arrived * (1 + 1e-12)
    assert found.arrived["scattered"].share > 0


def test_weights_do_not_bias():
    """Splitting changes the error, not the answer; rare branches gain from it."""
    system = michelson(ar=0.01, rho=0.05)
    analog, fine = (flux(system, 20_000, split=split, seed=9) for split in (ANALOG, 1e-3))
    for name in ("nominal", "order 1", "order 2"):
        one, other = analog.arrived[name], fine.arrived[name]
        assert abs(one.share - other.share) < 4 * np.hypot(one.error, other.error)
        assert other.error < 0.3 * one.error


def test_threads_and_slices_change_no_bit():
    system = michelson(ar=0.02, rho=0.1)
    one, two = (flux(system, 2 * SLICE + 100, threads=threads) for threads in (1, 2))
    for field in dataclasses.fields(one):
        if field.name != "map":
            assert repr(getattr(one, field.name)) == repr(getattr(two, field.name)), field.name
    for field in dataclasses.fields(one.map):
        assert np.array_equal(getattr(one.map, field.name), getattr(two.map, field.name))
    assert flux(system, SLICE, seed=2).entries != flux(system, SLICE, seed=3).entries
    rest = _arguments(system, from_field(system), system.sigma0, 1e-3, (4, 4), 160)
    whole = walk_rays(0, 50, 4, *rest)[0]
    parts = sum(walk_rays(first, 1, 4, *rest)[0] for first in reversed(range(50)))
    assert np.array_equal(whole, parts) and whole[0] > 0


def test_what_passes_outside_a_ring_is_vignetted_and_a_mask_absorbs():
    mask = surface("mask", "glass", 1.0, coating="black", nominal="absorb", aperture={"half_width_mm": [0.5, 8.0]})
    stop = surface("stop", "mid", 5.0, aperture=4.0)
    black = {"reflectance": 0.0, "transmittance": 0.0}
    system = build([frame("all", "front", stop, mask | {"after": "mid"}, detector(), start_mm=20.0)],
                   {"front": 1.0, "mid": 1.0}, coating={"black": black})  # fmt: skip
    found = flux(system, 20_000, source=AHEAD)
    assert near(found.at("rim", "stop"), 1 - 16 / 25)
    half = np.arcsin(0.5 / 4)
    strip = (2 * half + np.sin(2 * half)) / np.pi * 16 / 25
    assert near(found.at("absorbed", "mask"), strip)
    assert near(found.at("detector", "detector"), 16 / 25 - strip)
    assert found.sum("vignetted") == pytest.approx(found.at("rim", "stop").share)


def test_light_onto_the_back_of_a_mirror_is_told_apart():
    """A mirror that bounds the room on one side only, met from the other."""
    blind = surface("blind", "front", 1.0, coating="mirror", nominal="reflect", aperture=3.0)
    frames = [frame("a", "", blind, start_mm=10.0), frame("b", "front", detector(), start_mm=30.0)]
    found = flux(build(frames, {"front": 1.0}), 5000, source=AHEAD)
    assert near(found.at("back", "blind"), 9 / 25)
    assert near(found.at("detector", "detector"), 16 / 25)


def test_light_still_on_its_way_after_the_last_event_is_pruned():
    """Half and half at each face: an eighth goes on after four events, half of it on its way to the detector."""
    found = flux(plate({"reflectance": 0.5, "transmittance": 0.5}), 10, source=AHEAD, split=1e-6, max_depth=4)
    assert found.at("depth", "").share == found.sum("pruned") == 0.125
    assert found.sum("detector") == 0.25 and found.sum("left") == 0.625


def test_total_reflection_at_a_coated_face_sends_back_all_that_is_not_absorbed():
    """In glass onto a face at 45 degrees: nothing gets out of n = 1.5."""
    tilted = surface("face", "air", 0.0, coating="face", tilt_deg=[45.0, 0.0, 0.0])
    side = frame("side", "glass", detector(), attach="face", rotate_deg=[-90.0, 0.0, 0.0], start_mm=15.0)
    system = build([frame("a", "glass", tilted, start_mm=20.0), side], {"glass": 1.5, "air": 1.0},
                   coating={"face": {"reflectance": 0.1, "transmittance": 0.8}})  # fmt: skip
    found = flux(system, 4000, source=AHEAD)
    assert found.sum("absorbed") == pytest.approx(0.1, abs=1e-12)
    assert found.total_reflections == 4000
    assert found.sum("detector") == pytest.approx(0.9, abs=1e-12)


def test_a_scattering_window_fills_the_detector_by_harveys_law():
    """Share on a detector that takes in the sine 0.8: tis·lobe(0.8)/lobe(1); what is wider passes its rim."""
    tis, width, slope = 0.2, 0.05, -1.8
    window = surface("window", "back", 30.0, coating="dull", aperture=1000.0)
    record = surface("detector", "", aperture=40.0, nominal="absorb")
    system = build([frame("a", "front", window, record, start_mm=20.0)], {"front": 1.0, "back": 1.0}, radius=1e-3,
                   coating={"dull": {"scatter": {"tis": tis, "l": width, "s": slope}}})  # fmt: skip

    def inside(b):
        return (1 + (b / width) ** 2) ** (1 + slope / 2) - 1

    for split in (1e-3, ANALOG):
        found = flux(system, 40_000, source=AHEAD, split=split)
        assert near(found.arrived["scattered"], tis * inside(0.8) / inside(1.0))
        assert near(found.arrived["nominal"], 1 - tis)
        assert near(found.at("rim", "detector"), tis * (1 - inside(0.8) / inside(1.0)))
        assert {path.path: path.scattered for path in found.paths} == {"window": False, "window:s": True}


def test_a_lambertian_pupil_lights_a_plane_by_the_closed_form():
    """E = (πL/2)[1 − (z² + x² − a²)/√((z² + x² + a²)² − 4a²x²)] under a disc; cos⁴ where the disc is small."""
    distance, radius = 20e-3, 2e-3
    system = build([frame("a", "front", detector(), start_mm=20.0)], {"front": 1.0}, radius=2.0,
                   detector={"surface": "detector", "pixel_um": 200.0, "columns": 100, "rows": 100})  # fmt: skip
    found = flux(system, 400_000, source=lambertian(60.0), cells=(10, 10))
    edges = found.map.x
    # Each cell holds the mean of the closed form over it; beyond 60° no light was sent.
    fine = np.linspace(edges[0], edges[-1], 401)
    middle = 0.5 * (fine[1:] + fine[:-1])
    r2 = middle[:, None] ** 2 + middle[None] ** 2
    whole = distance**2 + r2 + radius**2
    closed = 0.5 * np.pi * found.radiance * (1 - (whole - 2 * radius**2) / np.sqrt(whole**2 - 4 * radius**2 * r2))
    cells = closed.reshape(10, 40, 10, 40).mean(axis=(1, 3))
    score = (found.map.irradiance - cells) / found.map.error
    assert np.abs(score).max() < 4.5
    assert 0.7 < (score**2).mean() < 1.4
    cos4 = (distance / np.sqrt(distance**2 + r2)) ** 4
    assert closed[200, 200] / closed[0, 0] == pytest.approx(cos4[200, 200] / cos4[0, 0], rel=0.03)


def test_the_map_and_the_paths_hold_all_that_arrived():
    system = michelson(ar=0.02, rho=0.1)
    found = flux(system, 4000, cells=(7, 5))
    area = np.diff(found.map.y)[:, None] * np.diff(found.map.x)
    inside = (found.map.irradiance * area).sum()
    arrived = sum(share.share for share in found.arrived.values())
    assert inside < arrived  # the detector is larger than its pixels
    stray = (found.map.stray * area).sum()
    assert 0 < stray <= arrived - found.arrived["nominal"].share
    assert found.map.count.shape == (7, 5)
    document = found.document()
    assert document["imbalance"] == 0 and document["sums"]["detector"] == found.sum("detector")


@pytest.mark.parametrize(
    "options, word",
    [({"rays": 0}, "rays"), ({"seed": -1}, "seed"), ({"split": 0.0}, "options"), ({"max_depth": 1000}, "options"),
     ({"cells": (0, 4)}, "options"), ({"threads": 0}, "options")],
)  # fmt: skip
def test_values_that_make_no_walk_are_refused(options, word):
    with pytest.raises(InputError, match=word):
        flux(michelson(), **({"rays": 10} | options))


def test_sources_that_do_not_exist_are_refused():
    with pytest.raises(InputError, match="direction"):
        from_direction((0.8, 0.8))
    with pytest.raises(InputError, match="half angle"):
        lambertian(91.0)
    assert lambertian().projected == pytest.approx(np.pi)


def test_a_unit_is_exact_in_floating_point():
    assert float(UNIT) == UNIT and UNIT * SLICE < 2**63
