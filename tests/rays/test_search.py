"""The path search: what may end a branch, and that nothing is missed; against brute force and lists in closed form."""

import itertools

import numpy as np
import pytest
from small_instruments import DATA, build, detector, frame, michelson, published, singlet, surface
from test_paths import faces, ghost, probes

from cgi_wave.budget.select import opd_ranges
from cgi_wave.errors import EmptyBeamError
from cgi_wave.kernels import search as walk
from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.paths import PROBES, explore, find_paths, parse_path, pupil_probes
from cgi_wave.rays.trace import compile_sequence, trace

R = 0.02
GLASS = {"reflectance": R, "transmittance": 1 - R}


def doublet(plate=False):
    """A cemented doublet, the detector in its focus; with a plate between them if asked for."""
    faces = [surface("a", "crown", 6.0, 61.0, 14.0, coating="glass"), surface("b", "flint", 2.5, -45.0, 14.0,
             coating="glass"), surface("c", "air_behind", 30.0, -128.0, 14.0, coating="glass")]  # fmt: skip
    space = {"room": 1.0, "crown": 1.517, "flint": 1.62, "air_behind": 1.0}
    if plate:
        faces += [surface("d", "plate", 3.0, aperture=16.0, coating="glass"),
                  surface("e", "last", 10.0, aperture=16.0, coating="glass")]  # fmt: skip
        space |= {"plate": 1.5, "last": 1.0}
    return build([frame("lens", "room", *faces, detector(), start_mm=5.0)], space, coating={"glass": GLASS},
                 entrance={"half_field_deg": [1.0, 1.0]})  # fmt: skip


def texts(paths):
    return {str(path) for path in paths}


# ------------------------------------------------------------------------------------------------ nothing is missed


def joining(system, length):
    """Every list of up to ``length`` interactions whose media join, at most two of them reflections, as text."""
    lists = [([], system.document.entrance.space, 0)]
    for steps, space, turns in lists:
        if steps:
            yield " ".join(steps), space
        if len(steps) == length:
            continue
        for s in system.surfaces[:-1]:
            sides = [system.spaces[k] for k in (s.before, s.after)]
            if space in sides:
                other = sides[1 - sides.index(space)]
                lists.append(([*steps, s.name], other, turns))
                if turns < 2:
                    lists.append(([*steps, f"{s.name}:r"], space, turns + 1))


def test_brute_force_finds_the_same_paths_in_a_doublet():
    """Every list of up to seven interactions whose media join, each traced on its own with 500 rays."""
    system = doublet()
    p, theta = probes(system, 500)
    alive, tried = set(), 0
    for text, space in joining(system, 7):
        if space != "air_behind":
            continue
        tried += 1
        if trace(compile_sequence(system, parse_path(system, text), system.sigma0), p, theta).passes.any():
            alive.add(text)
    assert tried > 200
    assert alive == texts(find_paths(system))
    assert len(alive) == 1 + 3


@pytest.mark.parametrize("plate", [False, True])
def test_a_cemented_doublet_and_a_plate_give_all_pairs(plate):
    system = doublet(plate)
    names = faces(system)
    expected = {ghost(names, i, j) for i, j in itertools.combinations(range(len(names)), 2)}
    assert texts(find_paths(system)) == {" ".join(names)} | expected
    assert len(expected) == (10 if plate else 3)


def test_more_probes_find_what_fewer_found_and_more():
    """Probes are one sequence: each number is the same ray, however many are sent."""
    p, theta = pupil_probes(doublet(), PROBES)
    again, direction = pupil_probes(doublet(), 4 * PROBES)
    np.testing.assert_array_equal(p, again[:PROBES])
    np.testing.assert_array_equal(theta, direction[:PROBES])
    # A small detector: most ghosts, out of focus, send it a few rays only.
    instrument = load_instrument(DATA / "double_gauss.toml")
    small = instrument.with_values({"image.aperture": {"radius_mm": 2.0}}).band(instrument.bands[0])
    few, many = (find_paths(small, probes=count) for count in (64, 1024))
    assert texts(few) < texts(many)
    assert all(path.probe < path.probes for path in many) and max(path.probes for path in many) > PROBES


def test_probes_beyond_the_default_are_known_to_the_chain():
    """What a finer search found has a path difference to the nominal beams, and rays that feed it."""
    instrument = load_instrument(DATA / "double_gauss.toml")
    small = instrument.with_values({"image.aperture": {"radius_mm": 2.0}}).band(instrument.bands[0])
    found = find_paths(small, probes=4 * PROBES)
    late = [path for path in found if path.probe >= PROBES]
    assert late
    low, high = opd_ranges(small, late, [found[0], found[0]])
    for k, path in enumerate(late):
        p, theta = (values[path.probe] for values in pupil_probes(small, path.probes))
        own, straight = (
            trace(compile_sequence(small, which, small.sigma0), p[None], theta) for which in (path, found[0])
        )
        assert own.passes[0] and low[k] < own.opl[0] - straight.opl[0] < high[k]
        assert own.opl[0] == pytest.approx(path.length, abs=1e-12)


# ------------------------------------------------------------------------------------------------ what ends a branch


@pytest.mark.parametrize(
    ("system", "limits"),
    [
        (published("cooke_triplet"), (4, 4, 1e-10)),
        (published("double_gauss"), (2, 2, 3e-4)),
        (michelson(ar=0.01, rho=0.05), (2, 3, 1e-6)),
        (singlet(60.0), (4, 4, 1e-9)),
    ],
    ids=["triplet", "double Gauss", "Michelson", "bare singlet"],
)
def test_pruning_loses_nothing(system, limits):
    """With and without the bound: the same paths with the same powers, at less cost."""
    pruned, whole = explore(system, *limits), explore(system, *limits, prune=False)
    assert pruned.paths == whole.paths
    assert pruned.visits < whole.visits
    assert pruned.unreachable + pruned.bound > 0


def test_pruning_loses_nothing_of_the_reference_instrument():
    instrument = load_instrument()
    system = instrument.band(instrument.bands[0])
    pruned, whole = (explore(system, 1, 1, 1e-6, 128, prune) for prune in (True, False))
    assert pruned.paths == whole.paths and pruned.visits < whole.visits


def test_statistics_of_a_lens_are_countable():
    """Six faces met once, no reflection allowed: each face refuses one, the detector its reflection and its way on."""
    found = explore(published("cooke_triplet"), max_order=0, max_splits=0)
    assert (found.visits, found.order, found.splits) == (6, 7, 1)
    assert (found.power, found.unreachable, found.bound, found.lost, found.left, found.wrong_side) == (0,) * 6
    # One reflection: light that has turned round at face j has no way to the detector, and is not followed.
    found = explore(published("cooke_triplet"), max_order=1, max_splits=1)
    assert (found.visits, found.unreachable, found.power, len(found.paths)) == (6, 7, 1, 1)
    without = explore(published("cooke_triplet"), max_order=1, max_splits=1, prune=False)
    assert without.visits > 6 + 6 and without.left > 0


def table(system, order, splits):
    """The bound of what can reach the detector, per surface and side, with so many reflections and splits left."""
    surfaces = system.surfaces
    rows = [[i for i, s in enumerate(surfaces) if space in (s.before, s.after)] for space in range(len(system.spaces))]
    start = np.cumsum([0, *map(len, rows)])
    members = np.array([i for row in rows for i in row])
    extra = np.array([int(s.nominal != "reflect") for s in surfaces])
    through = np.array([int(s.nominal != "transmit") for s in surfaces])
    power = [np.array([getattr(s.coating, name) for s in surfaces]) for name in ("transmittance", "reflectance")]
    return walk.reach_table(np.array([[s.before, s.after] for s in surfaces]), start, members, *power,
                            through, extra, 0 * extra, extra, system.detector, order, splits)  # fmt: skip


def test_bound_of_a_lens_is_a_product_of_its_faces():
    system, t = published("cooke_triplet"), 0.98
    reach = table(system, 2, 2)
    for k in range(6):
        # Forward from face k: all faces behind it. Backward from it: only a reflection before it helps, nearest best.
        assert reach[k, 1, 0, 0] == pytest.approx(t ** (5 - k), rel=1e-14)
        assert reach[k, 0, 0, 0] == 0.0 == reach[k, 0, 1, 0]
        assert reach[k, 0, 1, 1] == pytest.approx(R * t ** (6 - k) if k else 0.0, rel=1e-14)
    assert (reach <= 1.0).all()


def test_powers_bound_ends_branches():
    """All that face 6 could still do after a reflection at it costs 0.02 more: below least power nothing goes there."""
    system = published("cooke_triplet")
    found = explore(system, min_power=0.5 * R)
    assert len(found.paths) == 1 and found.bound > 0
    assert found.visits == 6


def test_surface_from_the_wrong_side_stops_probes():
    """A small face drawn the wrong way round stands in the way: its space is ahead of it, not behind."""
    turned = frame("turned", "glass", surface("back", "room", aperture=2.0), start_mm=5.0)
    end = frame("end", "room", detector(), start_mm=20.0)
    system = build([turned, end], {"room": 1.0, "glass": 1.5}, radius=4.0, entrance={"half_field_deg": [0.01, 0.01]})
    found = explore(system)
    assert texts(found.paths) == {""}
    # A quarter of the pupil's area is behind the face; three searches are not counted, only the last.
    assert found.wrong_side == pytest.approx(PROBES / 4, abs=4)
    alone = frame("turned", "glass", surface("back", "room", aperture=9.0), start_mm=5.0)
    with pytest.raises(EmptyBeamError, match="no nominal path"):
        explore(build([alone, end], {"room": 1.0, "glass": 1.5}, radius=4.0))


def test_without_its_masks_the_reference_relay_passes_light_beside_a_mirror():
    """The black surfaces of the file are what keeps the search from it: from M1 past M2 and M3 onto the filter."""
    instrument, limits = load_instrument(), (1, 1, 1e-6, 512)
    band = instrument.bands[0]
    with_masks = texts(explore(instrument.band(band), *limits).paths)
    hole = {"relay_mask.aperture": {"radius_mm": 1e-3}}
    without = texts(explore(instrument.with_values(hole).band(band), *limits).paths)
    extra = without - with_masks
    assert with_masks <= without and extra
    assert all("M1:r filter_front" in text for text in extra)
    assert not any("M1:r filter_front" in text for text in with_masks)
