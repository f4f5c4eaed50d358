"""Coatings given as tables, where they are used: Fresnel's closed form in a table must act as a bare face does."""

import numpy as np
import pytest
from small_instruments import build, detector, document, frame, surface

from cgi_wave.errors import InputError
from cgi_wave.optics.system import from_document
from cgi_wave.rays.flux import flux, from_direction
from cgi_wave.rays.paths import find_paths, parse_path
from cgi_wave.rays.trace import compile_sequence, trace, trouble
from cgi_wave.rays.tree import grow_tree, trace_tree

N = 1.5


def fresnel(theta, n=N):
    """R_s and R_p of a face between 1 and n, from Snell and Fresnel."""
    inner = np.arcsin(np.sin(theta) / n)
    s = ((np.cos(theta) - n * np.cos(inner)) / (np.cos(theta) + n * np.cos(inner))) ** 2
    p = ((n * np.cos(theta) - np.cos(inner)) / (n * np.cos(theta) + np.cos(inner))) ** 2
    return s, p


def fresnel_table(last=80.0, count=41):
    angle = np.linspace(0.0, last, count)
    s, p = fresnel(np.radians(angle))
    return {"wavelengths_nm": [400.0, 600.0], "angles_deg": angle.tolist(), "reflectance_s": [s.tolist()] * 2,
            "reflectance_p": [p.tolist()] * 2}  # fmt: skip


def window(coating, tilt=0.0):
    """A plate of glass with coated faces, turned about x."""
    faces = (surface("one", "glass", 2.0, coating="face"), surface("two", "back", coating="face"))
    frames = [frame("plate", "front", *faces, start_mm=30.0, rotate_deg=[tilt, 0.0, 0.0]),
              frame("end", "back", detector(), shift_mm=[0.0, 0.0, 100.0])]  # fmt: skip
    return build(frames, {"front": 1.0, "glass": N, "back": 1.0}, radius=1.0, coating={"face": coating})


def power(system, text, theta=(0.0, 0.0)):
    traced = trace(compile_sequence(system, parse_path(system, text), system.sigma0), np.zeros((1, 2)), np.array(theta))
    return traced.power[0], traced.status[0]


@pytest.mark.parametrize("path", ["one two", "one two:r one:r two"])
@pytest.mark.parametrize("tilt", [0.0, 10.0, 33.0])
def test_fresnel_in_a_table_acts_as_a_bare_face_on_either_side(path, tilt):
    """The second face is met from the glass: Snell's law leads back to the table's angle in air."""
    tabled, bare = (power(window(coating, tilt), path) for coating in ({"table": fresnel_table()}, {"bare": True}))
    assert tabled[1] == bare[1] == 0
    assert tabled[0] == pytest.approx(bare[0], rel=2e-6)


def test_walk_and_sequence_read_a_table_alike():
    system = window({"table": fresnel_table()}, 25.0)
    found = {one.path: one for one in flux(system, 200, split=1e-6, source=from_direction((0.0, 0.0))).paths}
    for path in find_paths(system, max_order=2):
        assert found[str(path)].share == pytest.approx(power(system, str(path))[0], rel=1e-9)


def test_a_table_of_one_value_is_that_constant():
    flat = {"wavelengths_nm": [400.0, 450.0, 520.0, 600.0], "angles_deg": [0.0, 10.0, 25.0, 60.0],
            "reflectance": [[0.03] * 4] * 4, "absorptance": 0.01}  # fmt: skip
    tabled = window({"table": flat, "reverse": "face"}, 20.0)
    plain = window({"reflectance": 0.03, "transmittance": 0.96}, 20.0)
    for path in ("one two", "one two:r one:r two"):
        assert power(tabled, path)[0] == pytest.approx(power(plain, path)[0], rel=1e-14)


def test_beyond_its_angles_a_table_says_nothing():
    system = window({"table": fresnel_table(30.0)}, 29.5)
    path = parse_path(system, "one two")
    sequence = compile_sequence(system, path, system.sigma0)
    theta = np.zeros((2, 2))
    theta[:, 1] = np.sin(np.radians([-1.0, 1.0]))
    traced = trace(sequence, np.zeros((2, 2)), theta)
    steeper = int(np.argmax(traced.status))
    assert sorted(traced.passes) == [False, True]
    assert not traced.valid[steeper]
    assert trouble(sequence, traced) == {"beyond the coating's table at one": 1}
    lost = flux(system, 100, source=from_direction(tuple(theta[steeper])))
    assert lost.at("beyond table", "one").share == lost.sum("pruned") == 1.0
    assert lost.imbalance == 0
    assert flux(system, 100, source=from_direction(tuple(theta[1 - steeper]))).sum("pruned") == 0.0


def test_a_tree_of_paths_reads_tables_as_single_paths_do():
    """Power and what is lost, path by path, of a fan of which a part meets the faces beyond the table."""
    system = window({"table": fresnel_table(30.0)}, 25.0)
    paths = find_paths(system, max_order=2)
    rng = np.random.default_rng(2)
    p, theta = rng.uniform(-1e-3, 1e-3, (600, 2)), rng.uniform(-0.15, 0.15, (600, 2))
    arrivals = trace_tree(grow_tree(system, paths, system.sigma0), p, theta)
    for k, path in enumerate(paths):
        traced = trace(compile_sequence(system, path, system.sigma0), p, theta)
        assert 0 < traced.passes.sum() < 500
        assert arrivals.survivors[k] == traced.passes.sum()
        assert arrivals.power[k] == pytest.approx(traced.power[traced.passes].sum(), rel=1e-12)
        beyond = arrivals.trouble(k)["beyond the coating's table at one"]
        assert (
            beyond
            == trouble(compile_sequence(system, path, system.sigma0), traced)["beyond the coating's table at one"]
        )


def test_total_reflection_inside_reads_the_tables_end():
    """Light in glass beyond the critical angle grazes the air: 90° of the table, where Fresnel says 1."""
    tilted = surface("face", "air", coating="face", tilt_deg=[60.0, 0.0, 0.0])
    side = frame("side", "glass", detector(), attach="face", rotate_deg=[-60.0, 0.0, 0.0], start_mm=15.0)
    system = build([frame("a", "glass", tilted, start_mm=20.0), side], {"glass": N, "air": 1.0}, radius=1.0,
                   coating={"face": {"table": fresnel_table(90.0, 181)}})  # fmt: skip
    assert power(system, "face:r")[0] == pytest.approx(1.0, abs=1e-12)
    assert flux(system, 100).sum("detector") == pytest.approx(1.0, abs=1e-12)


def test_light_from_behind_meets_the_reverse_coating():
    coating = {"face": {"reflectance": 0.1, "transmittance": 0.9, "reverse": "inside"},
               "inside": {"reflectance": 0.3, "transmittance": 0.6}}  # fmt: skip
    faces = (surface("one", "glass", 2.0, coating="face"), surface("two", "back", 20.0, coating="face"))
    system = build([frame("plate", "front", *faces, detector(), start_mm=30.0)],
                   {"front": 1.0, "glass": N, "back": 1.0}, radius=1.0, coating=coating)  # fmt: skip
    expected = {"one two": 0.9 * 0.9, "one two:r one:r two": 0.9 * 0.1 * 0.3 * 0.9}
    found = {one.path: one.share for one in flux(system, 50, split=1e-9, source=from_direction((0.0, 0.0))).paths}
    for path, value in expected.items():
        assert power(system, path)[0] == pytest.approx(value, rel=1e-14)
        assert found[path] == pytest.approx(value, rel=1e-12)


def test_a_band_outside_a_tables_wavelengths_is_refused():
    frames = [frame("a", "front", surface("one", "back", 20.0, coating="face"), detector(), start_mm=20.0)]
    coating = {"face": {"table": fresnel_table()}}
    with pytest.raises(InputError, match=r"coating\.face\.table\.wavelengths_nm = 700.*400 to 600 nm"):
        from_document(document(frames, {"front": 1.0, "back": N}, wavelength=700.0, coating=coating))
    system = build(frames, {"front": 1.0, "back": N}, coating=coating)
    with pytest.raises(InputError, match="399"):
        compile_sequence(system, find_paths(system)[0], 1 / 399e-9)


def test_the_search_takes_a_tables_largest_reflectance():
    """A coating that reflects at other angles than these is not lost by the search, whose powers are bounds."""
    angle = [0.0, 15.0, 30.0, 45.0]
    table = {"wavelengths_nm": [400.0, 600.0], "angles_deg": angle, "reflectance": [[0.0, 0.0, 0.02, 0.3]] * 2}
    found = find_paths(window({"table": table}), min_power=0.08)
    assert [path.order for path in found] == [0, 2]
