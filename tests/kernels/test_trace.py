"""The sequence tracer against a scalar one in world coordinates, and against closed forms of single surfaces."""

import numpy as np
import pytest
from sequences import place, random_rays, random_steps, run

from cgi_wave.kernels.trace import BACKWARD, KINDS, MISS, REFLECT, REFRACT, SLICE, TIR, WRONG_SIDE


def trace_slowly(steps, ray):
    """One ray, in the world: Newton on the implicit surface, Snell by the tangential component."""
    point, direction, opl = np.array(ray[:3]), np.array(ray[3:]), 0.0
    for s in steps:
        axes, vertex = s["rotation"], s["origin"]
        stretch = np.array([1.0, 1.0, 1.0 + s["conic"]])
        t = ((vertex - point) @ axes[2]) / (direction @ axes[2])
        for _ in range(60):
            v, d = axes @ (point + t * direction - vertex), axes @ direction
            value = s["curvature"] * (stretch * v) @ v - 2.0 * v[2]
            move = value / (2.0 * (s["curvature"] * (stretch * v) @ d - d[2]))
            t -= move
            if abs(move) < 1e-17:
                break
        point, opl = point + t * direction, opl + s["n1"] * t
        v = axes @ (point - vertex)
        normal = axes.T @ (s["curvature"] * stretch * v - np.array([0.0, 0.0, 1.0]))
        normal /= np.linalg.norm(normal)
        along = (direction @ normal) * normal
        tangent = direction - along
        if s["mode"] == REFLECT:
            direction = tangent - along
        else:
            tangent = tangent * s["n1"] / s["n2"]
            direction = tangent + along / np.linalg.norm(along) * np.sqrt(1.0 - tangent @ tangent)
    return axes @ (point - vertex), axes @ direction, opl


def test_random_systems_agree_with_the_slow_tracer():
    compared = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        steps, rays = random_steps(rng), random_rays(rng, 10)
        end, out = run(steps, rays)
        for i in np.flatnonzero(out["status"] == 0):
            point, direction, opl = trace_slowly(steps, rays[:, i])
            np.testing.assert_allclose(end[:3, i], point, rtol=0, atol=1e-14)
            np.testing.assert_allclose(end[3:, i], direction, rtol=0, atol=1e-13)
            assert out["opl"][i] == pytest.approx(opl, abs=1e-14)
            compared += 1
    assert compared > 250


@pytest.mark.parametrize("count", [1, SLICE - 1, SLICE, SLICE + 1])
def test_slices_do_not_show(count):
    rng = np.random.default_rng(3)
    steps, rays = random_steps(rng), random_rays(rng, count, 9e-3)
    steps[1]["bare"], steps[2]["aperture"] = 1, np.array([1.0, 5e-3, 5e-3, 0.0, 0.0])
    end, out = run(steps, rays, footprints=True)
    for i in {0, 1, count // 2, SLICE - 1, SLICE, count - 1} & set(range(count)):
        end_1, out_1 = run(steps, rays[:, i : i + 1], footprints=True)
        np.testing.assert_array_equal(end[:, i], end_1[:, 0])
        for key, value in out.items():
            np.testing.assert_array_equal(value[..., i], out_1[key][..., 0], err_msg=key)


def test_directions_stay_unit_vectors():
    rng = np.random.default_rng(1)
    end, out = run(random_steps(rng), random_rays(rng, 600))
    ok = out["status"] == 0
    assert ok.any()
    np.testing.assert_allclose((end[3:, ok] ** 2).sum(axis=0), 1.0, atol=1e-14)


@pytest.mark.parametrize("conic", [-3.0, -1.0, -0.4, 0.0, 0.7])
@pytest.mark.parametrize("radius", [-0.05, 0.08])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_parallel_ray_meets_the_conic_at_its_sag(conic, radius, way):
    """z = c r²/(1 + √(1 − (1 + κ)c²r²)), the root next to the vertex, whichever way the light runs."""
    h, c = np.array([0.0, 1e-3, 2e-2]), 1.0 / radius
    rays = np.array([h, 0 * h, 0 * h - 0.1 * way, 0 * h, 0 * h, 0 * h + way])
    end, out = run([place(0.0, curvature=c, conic=conic)], rays)
    sag = c * h**2 / (1 + np.sqrt(1 - (1 + conic) * (c * h) ** 2))
    np.testing.assert_allclose(end[2], sag, rtol=1e-14, atol=0)
    np.testing.assert_allclose(out["opl"], 0.1 + way * sag, rtol=1e-14)
    assert (out["status"] == 0).all()


def test_nearly_plane_surface_loses_no_digits():
    """A sphere of 1000 km: its sag of 5e-11 m comes out with full relative precision."""
    end, _ = run([place(0.0, curvature=1e-6)], [[0.01], [0.0], [-1.0], [0.0], [0.0], [1.0]])
    assert end[2, 0] == pytest.approx(0.5e-6 * 1e-4, rel=1e-14, abs=0)


@pytest.mark.parametrize(("n1", "n2"), [(1.0, 1.5), (1.5, 1.0), (1.5, 1.8)])
def test_snell_and_reflection_at_a_plane(n1, n2):
    angle = np.radians(np.array([0.0, 10.0, 35.0]))
    rays = np.array([0 * angle, 0 * angle, 0 * angle - 0.01, 0 * angle, np.sin(angle), np.cos(angle)])
    end, _ = run([place(0.0, n1=n1, n2=n2)], rays)
    np.testing.assert_allclose(n2 * end[4], n1 * np.sin(angle), atol=1e-15)
    end, _ = run([place(0.0, n1=n1, n2=n1, mode=REFLECT)], rays)
    np.testing.assert_allclose(end[4:], [np.sin(angle), -np.cos(angle)], atol=1e-15)


def fresnel(n1, n2, angle, mode):
    rays = [[0.0], [0.0], [-0.01], [0.0], [np.sin(angle)], [np.cos(angle)]]
    return run([place(0.0, n1=n1, n2=n2, mode=mode, bare=1)], rays)[1]


@pytest.mark.parametrize(("n1", "n2"), [(1.0, 1.5), (1.7, 1.0)])
def test_bare_face(n1, n2):
    """R = ((n1 − n2)/(n1 + n2))² at normal incidence; ½((n² − 1)/(n² + 1))² at Brewster's angle; R + T = 1."""
    n = n2 / n1
    assert fresnel(n1, n2, 0.0, REFLECT)["power"][0] == pytest.approx(((1 - n) / (1 + n)) ** 2, rel=1e-14)
    brewster = 0.5 * ((n**2 - 1) / (n**2 + 1)) ** 2
    assert fresnel(n1, n2, np.arctan(n), REFLECT)["power"][0] == pytest.approx(brewster, rel=1e-13)
    for angle in np.radians([0.0, 12.0, 33.0]):
        parts = [fresnel(n1, n2, angle, mode)["power"][0] for mode in (REFLECT, REFRACT)]
        assert sum(parts) == pytest.approx(1.0, abs=1e-14)


def test_total_internal_reflection():
    """Beyond the critical angle nothing is transmitted, and a reflection keeps all of the power."""
    beyond = np.arcsin(1 / 1.5) + 0.01
    out = fresnel(1.5, 1.0, beyond, REFRACT)
    assert out["status"][0] == KINDS + TIR and out["power"][0] == pytest.approx(0.0, abs=1e-15)
    out = fresnel(1.5, 1.0, beyond, REFLECT)
    assert out["status"][0] == 0 and out["power"][0] == pytest.approx(1.0, rel=1e-15)
    assert fresnel(1.5, 1.0, beyond - 0.02, REFRACT)["status"][0] == 0


def test_status_keeps_the_first_trouble():
    ahead, sphere, behind = place(0.01), place(0.1, curvature=20.0), place(0.05)
    rays = [[0.0, 0.049, 0.051], [0.0] * 3, [0.0] * 3, [0.0] * 3, [0.0] * 3, [1.0] * 3]
    _, out = run([ahead, sphere, behind], rays)
    # Beyond its 50 mm the sphere is missed; the last plane lies before it, so that the others reach it backwards.
    assert list(out["status"]) == [3 * KINDS + BACKWARD, 3 * KINDS + BACKWARD, 2 * KINDS + MISS]


def test_side_is_that_of_the_normal_met():
    """Light along +z meets a face from its −z side, after a mirror along −z from the other; 0 asks for neither."""
    mirror = place(0.02, mode=REFLECT)
    rays = [[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]]
    for side, fine in [(1.0, False), (-1.0, True), (0.0, True)]:
        _, out = run([place(0.01, side=-side), mirror, place(0.01, curvature=5.0, side=side)], rays)
        first = KINDS + WRONG_SIDE if side > 0 else 0
        assert out["status"][0] == (0 if fine else first)
    _, out = run([mirror, place(0.01, curvature=5.0, side=1.0)], rays)
    assert out["status"][0] == 2 * KINDS + WRONG_SIDE


@pytest.mark.parametrize("curvature", [0.0, 20.0])
@pytest.mark.parametrize("z", [0.0, -0.01])
def test_ray_along_the_vertex_plane_is_a_miss(curvature, z):
    _, out = run([place(0.0, curvature=curvature)], [[-1.0], [0.0], [z], [1.0], [0.0], [0.0]])
    assert out["status"][0] == KINDS + MISS


def test_apertures_lower_the_clearance():
    x = np.array([0.0, 1e-3, 2e-3, 3e-3])
    rays = np.array([x, 0 * x, 0 * x, 0 * x, 0 * x, 1 + 0 * x])
    circle = place(0.01, aperture=np.array([1.0, 2e-3, 2e-3, 0.0, 0.0]))
    oblong = place(0.02, aperture=np.array([2.0, 2e-3, 9e-3, 2e-3, 0.0]))
    np.testing.assert_allclose(run([circle], rays)[1]["clearance"], 1 - (x / 2e-3) ** 2, atol=1e-14)
    np.testing.assert_allclose(run([oblong], rays)[1]["clearance"], [0.0, 0.5, 1.0, 0.5], atol=1e-14)
    np.testing.assert_allclose(run([circle, oblong], rays)[1]["clearance"], [0.0, 0.5, 0.0, -1.25], atol=1e-14)


def test_coating_weights_multiply():
    rays = [[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]]
    _, out = run([place(0.01, weight=0.98), place(0.02, weight=0.05), place(0.03, weight=0.5)], rays)
    assert out["power"][0] == pytest.approx(0.98 * 0.05 * 0.5, rel=1e-15)
