"""A tree of paths against its paths traced one by one, and against batoid's split of the same rays."""

import json

import numpy as np
import pytest
from small_instruments import DATA, michelson, published, singlet

from cgi_wave.errors import EmptyBeamError, InputError
from cgi_wave.kernels.tree import SLICE
from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.paths import find_paths, parse_path
from cgi_wave.rays.trace import compile_sequence, trace, trouble
from cgi_wave.rays.tree import BLOCK, grow_tree, stream_tree, trace_tree


def spiral(radius, count):
    """Points (count, 2) in a disc, even."""
    k = np.arange(count)
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    return radius * np.sqrt((k + 0.5) / count)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def field(system, count, seed=4):
    """Random directions (count, 2) over the declared field."""
    half = np.sin(np.radians(system.document.entrance.half_field_deg))
    return np.random.default_rng(seed).uniform(-half, half, (count, 2))


SYSTEMS = {
    "double Gauss": published("double_gauss"),
    "Michelson": michelson(ar=0.01, rho=0.05, tilt=0.3),
    "bare singlet": singlet(60.0, half_field_deg=[8.0, 8.0]),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_tree_brings_what_its_paths_bring_one_by_one(name):
    """Survivors to the ray; power, centroid, spread and path length to rounding; every lost ray is accounted for."""
    system = SYSTEMS[name]
    paths, count = find_paths(system), 2 * SLICE + 77
    p, theta = spiral(5.0 * system.pupil_radius, count), field(system, count)
    got = trace_tree(grow_tree(system, paths, system.sigma0), p, theta)
    some_lost = 0
    for k, path in enumerate(paths):
        traced = trace(compile_sequence(system, path, system.sigma0), p, theta)
        keep = traced.passes
        assert got.survivors[k] == keep.sum()
        assert sum(got.trouble(k).values()) == count - keep.sum()
        some_lost += count - keep.sum()
        if not keep.any():
            with pytest.raises(EmptyBeamError):
                got.centroid(k)
            continue
        power = traced.power[keep]
        np.testing.assert_allclose(got.power[k], power.sum(), rtol=1e-13)
        mean = power @ traced.x[keep] / power.sum()
        np.testing.assert_allclose(got.centroid(k), mean, rtol=0, atol=1e-15)
        spread = np.sqrt(power @ (traced.x[keep] - mean) ** 2 / power.sum())
        np.testing.assert_allclose(got.rms(k), spread, rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(got.length(k), power @ traced.opl[keep] / power.sum(), rtol=1e-13)
    assert some_lost > 0


def test_prefixes_are_traced_once():
    system = published("double_gauss")
    paths = find_paths(system)
    tree = grow_tree(system, paths, system.sigma0)
    prefixes = {(path.steps[:k], path.steps[k][0]) for path in paths for k in range(len(path.steps))}
    arrivals = len(paths)
    assert tree.visits == len(prefixes) + arrivals
    assert tree.visits < 0.5 * sum(len(path.steps) + 1 for path in paths)


def test_every_ghost_of_the_double_gauss_is_batoids():
    """Stored answers of batoid's traceSplit: same survivors, power, centroid and mean path length on all 56 paths."""
    stored = json.loads((DATA / "batoid_ghosts.json").read_text(encoding="utf-8"))
    instrument = load_instrument(DATA / "double_gauss.toml").with_values({"image.coating": "glass"})
    system = instrument.band(instrument.bands[0])
    paths = tuple(parse_path(system, text) for text in stored["paths"])
    assert len(paths) == 1 + 55
    got = trace_tree(grow_tree(system, paths, system.sigma0), spiral(stored["radius_m"], stored["rays"]),
                     np.array(stored["theta"]))  # fmt: skip
    for k, theirs in enumerate(stored["paths"].values()):
        assert got.survivors[k] == theirs["survivors"]
        assert got.power[k] == pytest.approx(theirs["power"], rel=1e-13)
        np.testing.assert_allclose(got.centroid(k), theirs["centroid_m"], rtol=0, atol=1e-15)
        assert got.length(k) == pytest.approx(theirs["length_m"], abs=1e-14)
    assert min(got.survivors) < 0.6 * stored["rays"]


def test_streams_and_threads_do_not_show():
    system, count = michelson(ar=0.01, rho=0.05), 2 * BLOCK + 500
    tree = grow_tree(system, find_paths(system, max_order=1), system.sigma0)
    p, theta = spiral(8e-3, count), 4.0 * field(system, count)
    whole = trace_tree(tree, p, theta)
    for threads in (1, 2, 3):
        other = stream_tree(tree, lambda a, b: (p[a:b], theta[a:b]), count, threads)
        np.testing.assert_array_equal(whole.sums, other.sums)
        np.testing.assert_array_equal(whole.lost, other.lost)
    assert 0 < whole.survivors[0] < count


def test_trouble_is_told_per_path():
    """Kinds and surfaces as from a trace of the path alone, apertures besides; an empty path says what stopped it."""
    system = published("double_gauss")
    paths = tuple(parse_path(system, text) for text in (
        "S1 S2 S3 S4 S5 stop S7 S8 S9 S10 S11",
        "S1 S2 S3 S4 S5:r S4 S3 S2 S1:r S2 S3 S4 S5 stop S7 S8 S9 S10 S11",
        "S1 S2:r S2",
    ))  # fmt: skip
    p, theta = spiral(0.06, 3000), np.array([0.0, 0.1])
    got = trace_tree(grow_tree(system, paths[:2], system.sigma0), p, theta)
    for k, path in enumerate(paths[:2]):
        alone = trouble(sequence := compile_sequence(system, path, system.sigma0), trace(sequence, p, theta))
        told = got.trouble(k)
        # A ray that an aperture has stopped is not followed to where it would have failed.
        assert all(told.get(key, 0) <= value for key, value in alone.items())
        assert sum(told.values()) == 3000 - got.survivors[k]
        assert any(key.startswith("missed") for key in told) and any(key.startswith("vignetted at") for key in told)
    with pytest.raises(InputError, match="media do not join"):
        grow_tree(system, paths, system.sigma0)
    wrong = parse_path(system, "S1 S2:r S2 S3 S4 S5 stop S7 S8 S9 S10 S11")
    got = trace_tree(grow_tree(system, (wrong,), system.sigma0), p[:100], theta)
    assert got.trouble(0) == {"on the wrong side of S2": 100}
    with pytest.raises(EmptyBeamError, match="wrong side of S2"):
        got.length(0)


def test_what_makes_no_tree_is_refused():
    system = published("double_gauss")
    path = find_paths(system, max_order=0)[0]
    with pytest.raises(InputError, match="given twice"):
        grow_tree(system, (path, path), system.sigma0)
    with pytest.raises(InputError, match="at least one"):
        grow_tree(system, (), system.sigma0)
    tree = grow_tree(system, (path,), system.sigma0)
    with pytest.raises(InputError, match="threads"):
        trace_tree(tree, np.zeros((1, 2)), np.zeros(2), threads=0)
    assert trace_tree(tree, np.zeros((0, 2)), np.zeros(2)).survivors[0] == 0
