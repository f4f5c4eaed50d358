"""Derivatives of rays, aiming and focal points: against differences of traced rays and against closed forms."""

import numpy as np
import pytest
from sequences import place, random_rays, random_steps, run

from cgi_wave.kernels.aiming import aim_rays, count_caustics
from cgi_wave.kernels.trace import REFLECT, SLICE, launch, trace_sequence

PARAMETERS = 4


def launched(p, theta, back_off=0.03, index=1.0, first=0, tangents=PARAMETERS):
    count = len(p)
    rays, tangent, opl = np.empty((6, count)), np.empty((tangents, 6, count)), np.empty(count)
    launch(p, np.ascontiguousarray(np.broadcast_to(theta, p.shape)), back_off, index, first, rays, tangent, opl)
    return rays, tangent, opl


def sequence(steps):
    """The arrays of a sequence in the order in which the kernels take them."""
    axes, origin, rot, shift = np.eye(3), np.zeros(3), [], []
    for s in steps:
        rot.append(s["rotation"] @ axes.T)
        shift.append(axes @ (s["origin"] - origin))
        axes, origin = s["rotation"], s["origin"]
    names = ("curvature", "conic", "n1", "n2", "mode", "side", "weight", "bare", "aperture")
    columns = (np.array([s[name] for s in steps]) for name in names)
    return (np.array(rot), np.array(shift), *columns, np.empty((0, 0, 5)))


def test_launch_counts_path_from_the_pupil():
    """Where a ray crosses the pupil plane, its path length is 0 and its place is p."""
    p, theta = np.array([[1e-3, -2e-3]]), np.array([0.1, 0.05])
    rays, _, opl = launched(p, theta, 0.03, 1.4)
    at = -rays[2, 0] / rays[5, 0]
    np.testing.assert_allclose(rays[:2, 0] + at * rays[3:5, 0], p[0], atol=1e-18)
    assert opl[0] + 1.4 * at == pytest.approx(0.0, abs=1e-17)


@pytest.mark.parametrize("number", range(PARAMETERS))
def test_launch_is_differentiated(number):
    p, theta, step = np.array([[1e-3, -2e-3]]), np.array([[0.1, 0.05]]), 1e-6
    sides = []
    for sign in (1, -1):
        delta = np.zeros((2, 2))
        delta[number // 2, number % 2] = sign * step
        sides.append(launched(p + delta[1], theta + delta[0])[0])
    tangent = launched(p, theta)[1]
    np.testing.assert_allclose(tangent[number], (sides[0] - sides[1]) / (2 * step), atol=1e-9)
    np.testing.assert_array_equal(launched(p, theta, first=2, tangents=2)[1], tangent[2:])


def test_tangents_are_derivatives_of_the_rays():
    """Random tilted, decentred conics and mirrors: central differences of second order agree to their own error."""
    compared = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        steps, rays = random_steps(rng), random_rays(rng, 8, 2e-3)
        direction = rng.normal(size=(2, 6, 8)) * np.array([1e-2] * 3 + [1.0] * 3)[:, None]
        # A neighbour's direction is a unit vector, too.
        direction[:, 3:] -= (direction[:, 3:] * rays[3:]).sum(axis=1, keepdims=True) * rays[3:]
        _, out = run(steps, rays, tangent=(tangent := direction.copy()))
        step = 1e-5
        for t in range(2):
            ends = []
            for sign in (1, -1):
                moved = rays + sign * step * direction[t]
                moved[3:] /= np.sqrt((moved[3:] ** 2).sum(axis=0))
                ends.append(run(steps, moved))
            alive = (out["status"] == 0) & (ends[0][1]["status"] == 0) & (ends[1][1]["status"] == 0)
            difference = (ends[0][0] - ends[1][0])[:, alive] / (2 * step)
            np.testing.assert_allclose(tangent[t][:, alive], difference, rtol=0, atol=1e-5 * np.abs(difference).max())
            compared += int(alive.sum())
    assert compared > 350


KINDS_OF_FRAME = [
    {"curvature": curvature, "conic": conic, "tilt": tilt, **law}
    for curvature, conic in ((0.0, 0.0), (20.0, 0.0), (-15.0, -0.7))
    for tilt in ((0.0, 0.0, 0.0), (12.0, -7.0, 5.0))
    for law in ({"n2": 1.5}, {"mode": REFLECT}, {})
]


@pytest.mark.parametrize("kind", KINDS_OF_FRAME, ids=lambda kind: "-".join(str(value) for value in kind.values()))
def test_tangents_at_every_kind_of_frame(kind):
    """Each shape, turned and not, refracting, reflecting or neither: the fourth tangent like the first, by differences.

    Behind the surface stands a plane along the first one's axes, so that the frame's own turn is in play twice.
    """
    rng = np.random.default_rng(1)
    steps = [place(0.03, **kind), place(0.01 if kind.get("mode") == REFLECT else 0.05, n1=kind.get("n2", 1.0))]
    rays = random_rays(rng, 11, 3e-3)
    direction = rng.normal(size=(4, 6, 11)) * np.array([1e-2] * 3 + [1.0] * 3)[:, None]
    direction[:, 3:] -= (direction[:, 3:] * rays[3:]).sum(axis=1, keepdims=True) * rays[3:]
    _, out = run(steps, rays, tangent=(tangent := direction.copy()))
    assert (out["status"] == 0).all()
    step = 1e-5
    for t in range(4):
        ends = []
        for sign in (1, -1):
            moved = rays + sign * step * direction[t]
            moved[3:] /= np.sqrt((moved[3:] ** 2).sum(axis=0))
            ends.append(run(steps, moved)[0])
        difference = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(tangent[t], difference, rtol=0, atol=1e-8 * np.abs(difference).max())


def test_tangents_leave_the_rays_alone_and_slices_do_not_show():
    rng = np.random.default_rng(3)
    count = SLICE + 3
    steps, rays = random_steps(rng), random_rays(rng, count, 9e-3)
    plain, out = run(steps, rays, footprints=True)
    with_tangent, out_2 = run(steps, rays, footprints=True, tangent=(tangent := rng.normal(size=(2, 6, count))))
    np.testing.assert_array_equal(plain, with_tangent)
    for key, value in out.items():
        np.testing.assert_array_equal(value, out_2[key], err_msg=key)
    again = np.random.default_rng(3)
    random_steps(again), random_rays(again, count, 9e-3)
    one = again.normal(size=(2, 6, count))[:, :, -1:].copy()
    run(steps, rays[:, -1:], tangent=one)
    np.testing.assert_array_equal(one[:, :, 0], tangent[:, :, -1])


def thin_lens(focal, distance, start=0.01):
    """A lens of thickness nil (two faces in one place), index 1.5, and a plane ``distance`` behind it; m."""
    bend = 1.0 / focal
    faces = [place(start, curvature=bend, n2=1.5), place(start, curvature=-bend, n1=1.5)]
    return [*faces, place(start + distance)]


def aimed(steps, p, target, theta, rounds=12, tolerance=1e-12):
    count = len(p)
    rays, tangent, opl, power = np.empty((6, count)), np.empty((2, 6, count)), np.empty(count), np.empty(count)
    clearance, status, foot = np.empty(count), np.empty(count, dtype=np.int64), np.zeros((len(steps), 2, count))
    arrived = aim_rays(*sequence(steps), 0.0, p, target, theta, tolerance, 0.1, rounds, rays, tangent, opl, power,
                       status, clearance, foot)  # fmt: skip
    return arrived, rays, tangent, foot


def test_aimed_rays_end_on_the_target_and_know_their_derivatives():
    steps, target = thin_lens(0.1, 0.07), np.array([2e-3, -1e-3])
    p = np.random.default_rng(0).uniform(-3e-3, 3e-3, (50, 2))
    theta = np.zeros_like(p)
    arrived, rays, tangent, foot = aimed(steps, p, target, theta)
    assert arrived.all()
    np.testing.assert_allclose(rays[:2].T, np.broadcast_to(target, p.shape), atol=1e-12)
    again, derivative, opl = launched(p, theta, 0.0, 1.0, tangents=2)
    feet = np.empty_like(foot)
    trace_sequence(*sequence(steps), again, derivative, opl, np.ones(50), np.zeros(50, dtype=np.int64),
                   np.full(50, np.inf), feet)  # fmt: skip
    np.testing.assert_array_equal(again, rays)
    np.testing.assert_array_equal(derivative, tangent)
    np.testing.assert_array_equal(feet, foot)
    # Paraxially x = (1 − d/f) p + (s + d − s d/f) θ, s before the lens and d behind it.
    near = np.hypot(*p.T) < 1e-3
    np.testing.assert_allclose(tangent[0, 0, near], 0.01 + 0.07 - 0.01 * 0.7, rtol=1e-3)


def test_newton_converges_quadratically():
    """With exact derivatives each round squares the miss: 1e-12 m takes four or five, and three do not do."""
    steps, target = thin_lens(0.1, 0.07), np.array([2e-3, -1e-3])
    p = np.random.default_rng(0).uniform(-3e-3, 3e-3, (50, 2))
    assert aimed(steps, p, target, np.zeros_like(p), rounds=5)[0].all()
    assert not aimed(steps, p, target, np.zeros_like(p), rounds=2)[0].any()


def test_aim_gives_up_where_the_end_does_not_answer():
    """In the image of the pupil's centre all directions end on the same point."""
    steps = thin_lens(0.1, 0.2, start=0.2)
    arrived, *_ = aimed(steps, np.zeros((1, 2)), np.array([5e-3, 0.0]), np.zeros((1, 2)))
    assert not arrived.any()


@pytest.mark.parametrize(
    ("distance", "by_p", "by_theta"), [(0.09, 0, 0), (0.11, 2, 0), (0.19, 2, 0), (0.21, 2, 2), (5.0, 2, 2)]
)
def test_focal_points_are_counted(distance, by_p, by_theta):
    """f = 100 mm, pupil 200 mm before it: plane waves meet at 100 mm, the pupil's points at 200 mm."""
    steps = thin_lens(0.1, distance, start=0.2)
    for first, expected in ((2, by_p), (0, by_theta)):
        rays, tangent, _ = launched(np.zeros((1, 2)), np.zeros(2), 0.0, 1.0, first, 2)
        assert count_caustics(*sequence(steps)[:7], 0, rays, tangent) == expected


def test_focal_points_behind_a_mirror_are_counted_along_the_ray():
    """A mirror's focus lies on the way back: directions and distances are the reflected ray's own."""
    for distance, expected in ((0.049, 0), (0.051, 2)):
        steps = [place(0.1, curvature=-10.0, mode=REFLECT), place(0.1 - distance, tilt=(180.0, 0.0, 0.0))]
        rays, tangent, _ = launched(np.zeros((1, 2)), np.zeros(2), 0.0, 1.0, 2, 2)
        assert count_caustics(*sequence(steps)[:7], 0, rays, tangent) == expected
