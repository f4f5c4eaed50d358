"""Polarisation by faces along a path, against Snell and Fresnel."""

import numpy as np
import pytest
from small_instruments import build, detector, frame, singlet, surface

from cgi_wave.rays.paths import find_paths, parse_path
from cgi_wave.rays.polarisation import incidences, polarised_range
from cgi_wave.rays.trace import compile_sequence

N = 1.5
MIDDLE = np.zeros((1, 2))


def tilted(angle, coating="bare", **table):
    faces = (surface("one", "glass", 2.0, coating=coating), surface("two", "back", coating=coating))
    frames = [frame("plate", "front", *faces, start_mm=30.0, rotate_deg=[float(angle), 0.0, 0.0]),
              frame("end", "back", detector(), shift_mm=[0.0, 0.0, 100.0])]  # fmt: skip
    return build(frames, {"front": 1.0, "glass": N, "back": 1.0}, radius=1.0, coating=table)


def fresnel(theta):
    inner = np.arcsin(np.sin(theta) / N)
    s = (np.sin(theta - inner) / np.sin(theta + inner)) ** 2
    p = (np.tan(theta - inner) / np.tan(theta + inner)) ** 2
    return s, p


def test_incidence_is_met_on_planes_and_spheres():
    system = tilted(40.0)
    path = find_paths(system)[0]
    cosine = incidences(compile_sequence(system, path, system.sigma0), MIDDLE, MIDDLE)
    inner = np.arcsin(np.sin(np.radians(40)) / N)
    assert cosine[:, 0] == pytest.approx([np.cos(np.radians(40)), np.cos(inner), 1.0], abs=1e-12)
    lens = singlet(60.0)
    p = np.array([[0.0, 1.5e-3]])
    first = incidences(compile_sequence(lens, find_paths(lens)[0], lens.sigma0), p, np.zeros((1, 2)))[0, 0]
    assert first == pytest.approx(np.cos(np.arcsin(1.5 / 100.0)), abs=1e-12)


@pytest.mark.parametrize("angle", [20.0, 50.0, np.degrees(np.arctan(N))])
def test_a_tilted_plate_passes_p_best(angle):
    """Both faces alike: T_p² and T_s² over the square of their mean; at Brewster's angle T_p = 1."""
    system = tilted(angle)
    s, p = fresnel(np.radians(angle))
    mean = 1.0 - 0.5 * (s + p)
    low, high = polarised_range(system, parse_path(system, "one two"), MIDDLE, MIDDLE, system.sigma0)
    assert low[0] == pytest.approx(((1 - s) / mean) ** 2, rel=1e-12)
    assert high[0] == pytest.approx(((1 - p) / mean) ** 2, rel=1e-12)


def test_a_ghost_between_the_faces_is_all_s_at_brewsters_angle():
    angle = np.degrees(np.arctan(N))
    system = tilted(angle)
    low, high = polarised_range(system, parse_path(system, "one two:r one:r two"), MIDDLE, MIDDLE, system.sigma0)
    s, _ = fresnel(np.radians(angle))
    assert low[0] == pytest.approx(0.0, abs=1e-12)
    assert high[0] >= 4.0 * ((1 - s) / (1 - s / 2)) ** 2  # each face by itself may take the better one


def test_coatings_without_s_and_p_count_as_alike_and_tables_with_them_do_not():
    plain = tilted(30.0, "face", face={"reflectance": 0.1, "transmittance": 0.9})
    low, high = polarised_range(plain, parse_path(plain, "one two"), MIDDLE, MIDDLE, plain.sigma0)
    assert low[0] == high[0] == 1.0
    grid = {"wavelengths_nm": [400.0, 600.0], "angles_deg": [0.0, 60.0]}
    table = {"table": grid | {"reflectance_s": [[0.3, 0.3]] * 2, "reflectance_p": [[0.1, 0.1]] * 2}}
    parted = tilted(30.0, "face", face=table)
    path = parse_path(parted, "one two")
    low, high = polarised_range(parted, path, MIDDLE, MIDDLE, parted.sigma0)
    assert (low[0], high[0]) == pytest.approx(((0.7 / 0.8) ** 2, (0.9 / 0.8) ** 2))
    low, high = polarised_range(parted, path, MIDDLE, MIDDLE, parted.sigma0, without="one")
    assert (low[0], high[0]) == pytest.approx((0.7 / 0.8, 0.9 / 0.8))
