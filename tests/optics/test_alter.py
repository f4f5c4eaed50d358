"""Changed systems: the same as another file, rigid bodies, and what a coating without one number is."""

import numpy as np
import pytest
from small_instruments import build, detector, frame, surface

from cgi_wave.errors import InputError
from cgi_wave.optics.alter import is_constant, members, moved, plane_bodies, recoated
from cgi_wave.optics.schema import CoatingSpec
from cgi_wave.optics.system import load_instrument, rotation
from cgi_wave.rays.paths import find_paths
from cgi_wave.rays.trace import compile_sequence, trace


@pytest.fixture(scope="module")
def reference():
    return load_instrument()


def test_tilting_one_surface_is_its_tilt_in_the_file(reference):
    """Axes and vertices of a surface that has no tilt of its own, to rounding."""
    system = moved(reference.band("NIR"), ["filter_back"], (0.3, 0.0))
    other = reference.with_values({"filter_back.tilt_deg": [0.3, 0.0, 0.0]}, "NIR").band("NIR")
    for one, two in zip(system.surfaces, other.surfaces, strict=True):
        np.testing.assert_allclose(one.rotation, two.rotation, atol=1e-15)
        np.testing.assert_allclose(one.origin, two.origin, atol=1e-15)


def test_shifting_a_body_is_its_thicknesses_in_the_file(reference):
    """The filter 0.4 mm towards the relay, its own thickness kept; the detector stays."""
    system = moved(reference.band("NIR"), ["filter_front", "filter_back"], shift_mm=-0.4)
    values = {"filter_back.thickness_mm": 1.4, "focal.start_mm": -3.8282}
    other = reference.with_values(values, "NIR").band("NIR")
    for one, two in zip(system.surfaces, other.surfaces, strict=True):
        np.testing.assert_allclose(one.origin, two.origin, atol=1e-15)


def test_a_moved_body_is_rigid_about_its_middle(reference):
    system = reference.band("NIR")
    names = members(system, "cube_a") + members(system, "cube_b")
    turned = moved(system, names, (2.0, -1.0), 0.7)
    old, new = (np.array([s.surfaces[s.number[n]].origin for n in names]) for s in (system, turned))
    distances = [np.linalg.norm(points[:, None] - points[None], axis=2) for points in (old, new)]
    np.testing.assert_allclose(*distances, atol=1e-16)
    axes = system.surfaces[system.number[names[0]]].rotation
    np.testing.assert_allclose(new.mean(axis=0) - old.mean(axis=0), 0.7e-3 * axes[2], atol=1e-16)
    first = turned.surfaces[turned.number[names[0]]].rotation
    np.testing.assert_allclose(axes @ first.T, rotation((2.0, -1.0, 0.0)), atol=1e-15)
    still = [n for n in system.number if n not in names]
    assert all(turned.surfaces[turned.number[n]] is system.surfaces[system.number[n]] for n in still)


def test_a_tilted_plate_shifts_the_beam_as_snell_says():
    """d = t sin(θ)(1 − cos θ/√(n² − sin² θ)) for a collimated beam through a plate tilted by θ."""
    n, thickness, theta = 1.5, 4.0, np.radians(10.0)
    faces = (surface("front_face", "glass", thickness), surface("back_face", "back", 20.0), detector())
    system = build([frame("plate", "front", *faces, start_mm=20.0)], {"front": 1.0, "glass": n, "back": 1.0})
    tilted = moved(system, members(system, "glass"), (10.0, 0.0))
    (path,) = (p for p in find_paths(tilted, max_order=0) if p.order == 0)
    ray = trace(compile_sequence(tilted, path, tilted.sigma0), np.zeros((1, 2)), np.zeros(2))
    want = 1e-3 * thickness * np.sin(theta) * (1 - np.cos(theta) / np.sqrt(n**2 - np.sin(theta) ** 2))
    assert abs(ray.x[0, 1]) == pytest.approx(want, rel=1e-12) and ray.x[0, 0] == 0.0
    assert np.allclose(ray.direction[0], 0.0, atol=1e-15)


def test_names_stand_for_surfaces_bodies_and_frames(reference):
    system = reference.band("NIR")
    assert members(system, "filter_back") == ("filter_back",)
    assert members(system, "filter") == ("filter_front", "filter_back")
    assert members(system, "focal") == ("filter_front", "filter_back", "detector")
    with pytest.raises(InputError, match=r"filtre.*no surface, space or frame"):
        members(system, "filtre")


def test_what_may_be_tilted_by_itself_is_plane(reference):
    """Lenses and curved mirrors are not offered; the cemented cube is one body; so are mirrors and the detector."""
    bodies = plane_bodies(reference.band("NIR"))
    assert bodies["filter"] == ("filter_front", "filter_back")
    assert set(bodies["cube_a"]) == {"cube_in", "splitter", "cube_arm1", "cube_arm2", "cube_exit"}
    assert {"detector", "mirror1", "dichroic"} <= set(bodies)
    assert not any({"L3_front", "M1", "stop"} & {name, *names} for name, names in bodies.items())


def test_only_plain_numbers_are_constant():
    """A field that is not known here and says something makes a coating vary, whatever it is."""

    class Later(CoatingSpec, frozen=True, forbid_unknown_fields=True, kw_only=True):
        table: str | None = None

    assert is_constant(CoatingSpec(reflectance=0.3, transmittance=0.6, reflect_phase_deg=20.0))
    assert not is_constant(CoatingSpec(bare=True))
    assert is_constant(Later(reflectance=0.1))
    assert not is_constant(Later(reflectance=0.1, table="measured.csv"))


def test_recoating_changes_one_surface_and_makes_a_new_system(reference):
    system = reference.band("NIR")
    new = recoated(system, {"L1_front": CoatingSpec(reflectance=0.002, transmittance=0.998)})
    changed = [s.name for s, t in zip(new.surfaces, system.surfaces, strict=True) if s.coating != t.coating]
    assert changed == ["L1_front"] and new is not system
    assert system.surfaces[system.number["L1_front"]].coating.reflectance == 0.01
