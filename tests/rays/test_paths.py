"""The path finder against lists made by hand and by brute force; energy and reciprocity of a small Michelson."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from small_instruments import build, detector, frame, michelson, published, singlet, surface

from cgi_wave.errors import EmptyBeamError, InputError
from cgi_wave.rays.paths import find_paths, parse_path
from cgi_wave.rays.trace import compile_sequence, jacobian, trace

LENSES = {"cooke_triplet": 15, "double_gauss": 45}
#: What a search knows of a path beyond its steps.
FOUND = ("estimate", "probe", "length")


def faces(system):
    """Surfaces of a lens in the order of the light, the detector left out."""
    return [s.name for s in system.surfaces[:-1]]


def ghost(names, i, j):
    """The path that reflects at face j, then at face i before it."""
    out, back, again = names[:j], names[i + 1 : j][::-1], names[i + 1 :]
    return " ".join([*out, f"{names[j]}:r", *back, f"{names[i]}:r", *again])


def probes(system, count=512):
    """Random rays over pupil and field: points (count, 2) m and directions (count, 2)."""
    rng = np.random.default_rng(5)
    r, angle = rng.random((2, count))
    p = (
        system.pupil_radius
        * np.sqrt(r)[:, None]
        * np.stack([np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)], axis=1)
    )
    half = np.sin(np.radians(system.document.entrance.half_field_deg))
    return p, rng.uniform(-half, half, (count, 2))


# ------------------------------------------------------------------------------------------------ lenses


@pytest.mark.parametrize("name", LENSES)
def test_every_pair_of_faces_makes_a_ghost(name):
    """n(n − 1)/2 pairs of n coated faces, all found; most of them pass light when traced on their own."""
    system = published(name)
    names = faces(system)
    coated = [i for i, face in enumerate(names) if face != "stop"]
    pairs = list(itertools.combinations(coated, 2))
    assert len(pairs) == LENSES[name]
    p, theta = probes(system)
    alive = set()
    for i, j in pairs:
        path = parse_path(system, ghost(names, i, j))
        if trace(compile_sequence(system, path, system.sigma0), p, theta).passes.mean() > 0.01:
            alive.add(str(path))
    found = find_paths(system)
    assert str(found[0]) == " ".join(names) and found[0].order == 0
    assert all(path.order == path.splits == 2 for path in found[1:])
    assert len(found) == len({str(path) for path in found})
    assert {str(path) for path in found[1:]} == {ghost(names, i, j) for i, j in pairs}
    assert len(alive) > 0.6 * len(pairs)
    assert len(found) == 1 + len(pairs)


@pytest.mark.parametrize("name", LENSES)
def test_estimated_power_is_the_traced_one(name):
    system = published(name)
    p, theta = probes(system, 4000)

    def power(path):
        traced = trace(compile_sequence(system, path, system.sigma0), p, theta)
        return float(traced.power[traced.passes].sum())

    found = find_paths(system)
    whole, unit = power(found[0]), 0.02**2
    for path in found[1:]:
        share = power(path) / whole / unit
        # Counting errors of 512 and of 4000 rays, four standard deviations.
        assert path.estimate / unit == pytest.approx(share, abs=0.02 + 4 * np.sqrt(share / 400))


def test_published_ghost_focus():
    """Zemax's ghost focus listing of its Cooke triplet: off surface 2, then 1: focus at −57.1176 mm, EFL 8.2347 mm."""
    system = published("cooke_triplet")
    sequence = compile_sequence(system, parse_path(system, "S1 S2:r S1:r S2 S3 S4 S5 S6"), system.sigma0)
    x_by_p, q_by_p = jacobian(sequence, np.zeros((1, 2)), np.zeros(2), of="p")
    assert -x_by_p[0, 0, 0] / q_by_p[0, 0, 0] == pytest.approx(-57.1176e-3, abs=1e-7)
    assert -1 / q_by_p[0, 0, 0] == pytest.approx(8.2347e-3, abs=1e-7)


def test_limits_of_the_search():
    system = published("cooke_triplet")
    assert len(find_paths(system, max_order=0)) == 1
    # Faces i and j: 0.02², and 0.98 twice for every face between them.
    counts = [len(find_paths(system, min_power=4e-4 * 0.98 ** (2 * k - 1))) for k in range(6)]
    assert counts == [1, 1 + 5, 1 + 5 + 4, 1 + 5 + 4 + 3, 1 + 5 + 4 + 3 + 2, 1 + 15]
    assert len(find_paths(system, max_order=2, max_splits=1)) == 1
    four = find_paths(system, max_order=4, max_splits=4, min_power=1e-12)
    assert {path.order for path in four} == {0, 2, 4}
    assert {str(path) for path in four if path.order <= 2} == {str(path) for path in find_paths(system)}


def test_no_path_is_an_error():
    aside = surface("hole", "behind", 5.0, aperture={"radius_mm": 0.1, "centre_mm": [40.0, 0.0]})
    frames = [frame("wall", "room", aside, detector(), start_mm=5.0)]
    with pytest.raises(EmptyBeamError, match="no nominal path"):
        find_paths(build(frames, {"room": 1.0, "behind": 1.0}))


def test_text_of_a_path_is_checked():
    system = published("cooke_triplet")
    with pytest.raises(InputError, match="no surface"):
        parse_path(system, "S1 S9")
    with pytest.raises(InputError, match="no interaction"):
        parse_path(system, "S1:x")


@pytest.mark.parametrize(
    "system",
    [published("cooke_triplet"), published("double_gauss"), michelson(ar=0.01, rho=0.05, tilt=0.05), singlet(60.0)],
    ids=["triplet", "double Gauss", "Michelson", "bare singlet"],
)
def test_paths_survive_being_written_down(system):
    """str → parse gives the path back, and its rays are the same to the last bit."""
    p, theta = probes(system, 40)
    for path in find_paths(system):
        again = parse_path(system, str(path))
        assert replace(again, twin=path.twin, **{name: getattr(path, name) for name in FOUND}) == path
        a, b = (trace(compile_sequence(system, which, system.sigma0), p, theta) for which in (path, again))
        for column in ("x", "direction", "opl", "power", "clearance", "status"):
            np.testing.assert_array_equal(getattr(a, column), getattr(b, column))


# ------------------------------------------------------------------------------------------------ Michelson

IN = {1: "splitter:r cube_arm1 mirror1:r cube_arm1", 2: "splitter cube_arm2 mirror2:r cube_arm2"}
OUT = {1: "splitter", 2: "splitter:r"}
#: From the exit port back into an arm: the other way through the splitter.
AGAIN = {1: "splitter cube_arm1 mirror1:r cube_arm1", 2: "splitter:r cube_arm2 mirror2:r cube_arm2"}
#: On the way back to the entrance: what the splitter does to light of each arm.
HOME = {1: "splitter:r", 2: "splitter"}

PAIRS = [(1, 1), (1, 2), (2, 1), (2, 2)]
ONE_REFLECTION = {
    # Round the interferometer twice, turned round by the entrance face, the exit face, or what stands in the ports.
    *(f"cube_in {IN[a]} {HOME[a]} cube_in:r {IN[b]} {OUT[b]} cube_exit" for a, b in PAIRS),
    *(f"cube_in {IN[a]} {OUT[a]} cube_exit:r {AGAIN[b]} {OUT[b]} cube_exit" for a, b in PAIRS),
    *(f"cube_in {IN[a]} {OUT[a]} cube_exit front:r cube_exit {AGAIN[b]} {OUT[b]} cube_exit" for a, b in PAIRS),
    *(f"cube_in {IN[a]} {HOME[a]} cube_in back:r cube_in {IN[b]} {OUT[b]} cube_exit" for a, b in PAIRS),
    # An arm's face instead of its mirror; and twice at the mirror, between it and the face.
    "cube_in splitter:r cube_arm1:r splitter cube_exit",
    "cube_in splitter cube_arm2:r splitter:r cube_exit",
    "cube_in splitter:r cube_arm1 mirror1:r cube_arm1:r mirror1:r cube_arm1 splitter cube_exit",
    "cube_in splitter cube_arm2 mirror2:r cube_arm2:r mirror2:r cube_arm2 splitter:r cube_exit",
}


def test_two_nominal_paths():
    found = find_paths(michelson(ar=0.01, rho=0.05), max_order=0)
    assert [str(path) for path in found] == [f"cube_in {IN[a]} {OUT[a]} cube_exit" for a in (1, 2)]
    assert [path.arms for path in found] == [(1,), (2,)]
    found = find_paths(michelson("back", ar=0.01, rho=0.05), max_order=0)
    assert [str(path) for path in found] == [f"cube_in {IN[a]} {HOME[a]} cube_in" for a in (1, 2)]


def test_single_reflections_are_those_listed_by_hand():
    found = find_paths(michelson(ar=0.01, rho=0.05), max_order=1)
    assert {str(path) for path in found if path.order == 1} == ONE_REFLECTION
    assert len(found) == 2 + 20
    assert len({path.label for path in found}) == len(found)


def test_families_and_arms():
    """Paths of one history differ in their arms; a face met from both sides makes twins."""
    found = find_paths(michelson(ar=0.01, rho=0.05), max_order=1)
    arms = {}
    for path in found:
        arms.setdefault(path.history, []).append(path.arms)
    for name in ("cube_in", "cube_exit", "front", "back"):
        assert sorted(arms[(name, "reflect"),]) == PAIRS
    assert arms[("cube_arm1", "reflect"),] == [(1,), (1,)]
    assert sorted(path.twin for path in found if path.history == (("cube_arm1", "reflect"),)) == [1, 2]


def amplitude(system, text):
    """Complex amplitude of the axial ray along a path: coatings, their phases, and the path length."""
    sequence = compile_sequence(system, parse_path(system, text), system.sigma0)
    ray = trace(sequence, np.zeros((1, 2)), np.zeros(2))
    assert ray.passes.all()
    return np.sqrt(ray.power[0]) * np.exp(1j * (sequence.phase + 2 * np.pi * system.sigma0 * ray.opl[0]))


def ports(extra, **kwargs):
    """Power at the exit port and back at the entrance, by the sum of the amplitudes of both arms."""
    front, back = (michelson(port, extra=extra, **kwargs) for port in ("front", "back"))
    return (
        abs(sum(amplitude(front, f"cube_in {IN[a]} {OUT[a]} cube_exit") for a in (1, 2))) ** 2,
        abs(sum(amplitude(back, f"cube_in {IN[a]} {HOME[a]} cube_in") for a in (1, 2))) ** 2,
    )


#: A long wavelength (1 mm): rounding of 0.1 m of path is then 1e-13 rad, and 0 to 3 mm of OPD are three whole fringes.
SCAN = np.linspace(0.0, 1.5, 37).tolist()


@pytest.mark.parametrize("reflectance", [0.5, 0.3])
def test_the_two_ports_share_the_input(reflectance):
    """A lossless splitter: both ports together give what came in, at every OPD; alone they swing fully, or by 4RT."""
    coating = {"reflectance": reflectance, "transmittance": 1 - reflectance, "reflect_phase_deg": 90.0}
    power = np.array([ports(extra, wavelength=1e6, splitter=coating) for extra in SCAN])
    np.testing.assert_allclose(power.sum(axis=1), 1.0, atol=1e-12)
    fringe = 2 * reflectance * (1 - reflectance) * (1 + np.cos(2 * np.pi * 2 * np.array(SCAN)))
    np.testing.assert_allclose(power[:, 0], fringe, atol=1e-11)


def test_ports_at_a_short_wavelength():
    power = np.array([ports(extra) for extra in np.linspace(0.0, 1e-3, 9).tolist()])
    np.testing.assert_allclose(power.sum(axis=1), 1.0, atol=1e-8)


def splitter(reflect, transmit):
    """Half and half, with these phases in degrees."""
    phases = {"reflect_phase_deg": reflect, "transmit_phase_deg": transmit}
    return {"reflectance": 0.5, "transmittance": 0.5} | phases


@pytest.mark.parametrize(("reflect", "transmit"), [(90.0, 0.0), (-90.0, 0.0), (130.0, 40.0), (0.0, 90.0)])
def test_splitters_phases_a_quarter_apart_keep_energy(reflect, transmit):
    assert sum(ports(0.17, wavelength=1e6, splitter=splitter(reflect, transmit))) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("both", [0.0, 90.0])
def test_a_wrong_splitter_phase_makes_energy(both):
    """Reflection and transmission in phase give 2 at OPD 0 and 0 half a wave on: the checks above can fail."""
    assert sum(ports(0.0, wavelength=1e6, splitter=splitter(both, both))) == pytest.approx(2.0, abs=1e-12)
    assert sum(ports(0.25, wavelength=1e6, splitter=splitter(both, both))) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("extra", [0.0, 0.1, 0.37])
def test_retro_ghost_of_the_detector(extra):
    """The exit passes N = (1 + cos φ)/2, and of what the detector returns 1 − N comes back to it: ρ N (1 − N)."""
    rho = 0.04
    system = michelson(rho=rho, extra=extra, wavelength=1e6)
    turn = "cube_exit front:r cube_exit"
    sent = {
        (a, b): amplitude(system, f"cube_in {IN[a]} {OUT[a]} {turn} {AGAIN[b]} {OUT[b]} cube_exit") for a, b in PAIRS
    }
    share = (1 + np.cos(2 * np.pi * 2 * extra)) / 2
    assert abs(sum(sent.values())) ** 2 == pytest.approx(rho * share * (1 - share), abs=1e-12)
    # Reciprocity: arms 1-2 and 2-1 are equally long; the splitter makes them opposite, so that they cancel.
    assert sent[1, 2] + sent[2, 1] == pytest.approx(0.0, abs=1e-12)
    assert abs(sent[1, 2]) ** 2 == pytest.approx(rho / 16, abs=1e-14)


@pytest.mark.parametrize("phase", [0.0, 180.0, 37.0])
def test_mirrors_phase_is_common_to_both_arms(phase):
    np.testing.assert_allclose(ports(0.1, wavelength=1e6, mirror_phase=phase), ports(0.1, wavelength=1e6), atol=1e-12)


def test_bare_face_turns_the_sign_towards_denser_glass():
    """Fresnel: −1 from thin to dense, +1 the other way; two reflections inside a lens are both of the second kind."""
    system = singlet(60.0)

    def phase(text):
        return compile_sequence(system, parse_path(system, text), system.sigma0).phase

    assert phase("front_face back_face") == 0.0
    assert phase("front_face back_face:r front_face:r back_face") == 0.0
    # From the air in front: only the compiled phase is asked for, the path goes away from the detector.
    outside = build(
        [frame("glass", "room", surface("face", "glass", coating="bare"), start_mm=5.0),
         frame("end", "room", detector(), shift_mm=[0.0, 0.0, -30.0], rotate_deg=[180.0, 0.0, 0.0])],
        {"room": 1.0, "glass": 1.5},
    )  # fmt: skip
    assert compile_sequence(outside, parse_path(outside, "face:r"), outside.sigma0).phase == pytest.approx(np.pi)


def test_bare_faces_of_a_plate_sum_to_airy():
    """Amplitudes of all orders between the bare faces of a plate: Airy's transmission (1 + F sin²δ/2)⁻¹."""
    n, t = 1.5, 2.0
    faces = surface("a", "glass", t, coating="bare"), surface("b", "back", 5.0, coating="bare")
    plate = frame("plate", "room", *faces, detector(), start_mm=5.0)
    r2 = ((n - 1) / (n + 1)) ** 2
    for wavelength in (1e6, 1.1e6, 1.3e6):
        system = build([plate], {"room": 1.0, "glass": n, "back": 1.0}, wavelength=wavelength)
        total = abs(sum(amplitude(system, "a " + "b:r a:r " * k + "b") for k in range(12))) ** 2
        delta = 4 * np.pi * system.sigma0 * n * t * 1e-3
        assert total == pytest.approx(1 / (1 + 4 * r2 / (1 - r2) ** 2 * np.sin(delta / 2) ** 2), abs=1e-12)
