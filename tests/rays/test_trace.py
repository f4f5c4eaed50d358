"""Tracing along paths: closed forms of mirrors, lenses and plates, path length, reversibility, aiming."""

import json

import numpy as np
import pytest
from small_instruments import DATA, build, detector, frame, michelson, published, singlet, surface

from cgi_wave.errors import InputError
from cgi_wave.kernels.trace import BACKWARD, KINDS, trace_sequence
from cgi_wave.rays.paths import find_paths, parse_path
from cgi_wave.rays.trace import aim, compile_sequence, history, jacobian, trace, trouble

AXIS = np.zeros(2)


def disc(radius, count=200, seed=0):
    """Random points (count, 2) in a disc."""
    r, angle = np.random.default_rng(seed).random((2, count))
    return radius * np.sqrt(r)[:, None] * np.stack([np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)], axis=1)


def sequence_of(system, text):
    return compile_sequence(system, parse_path(system, text), system.sigma0)


def nominal(system):
    return compile_sequence(system, find_paths(system, max_order=0)[0], system.sigma0)


# ------------------------------------------------------------------------------------------------ closed forms


def test_parabola_focuses_collimated_light():
    """z = r²/2R, focus at R/2: one point, and one path length, pupil to vertex and back to the focus."""
    mirror = frame("mirror", "room", surface("parabola", "", radius=-200.0, aperture=60.0, conic=-1.0, coating="mirror",
                                             nominal="reflect"), start_mm=150.0)  # fmt: skip
    focus = frame(
        "focus", "room", detector(), attach="parabola", shift_mm=[0.0, 0.0, -100.0], rotate_deg=[180.0, 0.0, 0.0]
    )
    system = build([mirror, focus], {"room": 1.0}, radius=50.0)
    traced = trace(sequence_of(system, "parabola:r"), disc(0.05), AXIS)
    assert traced.passes.all()
    np.testing.assert_allclose(traced.x, 0.0, atol=1e-16)
    np.testing.assert_allclose(traced.opl, 0.150 + 0.100, atol=1e-16)


def test_ellipse_images_one_focus_on_the_other():
    """Every ray from focus to focus by way of the mirror measures the major axis 2a."""
    a, c = 100.0, 60.0
    b2 = a**2 - c**2
    mirror = frame("mirror", "room", surface("ellipse", "", radius=-b2 / a, aperture=40.0, conic=-((c / a) ** 2),
                                             coating="mirror", nominal="reflect"), start_mm=a + c)  # fmt: skip
    focus = frame(
        "focus", "room", detector(), attach="ellipse", shift_mm=[0.0, 0.0, -(a - c)], rotate_deg=[180.0, 0.0, 0.0]
    )
    system = build([mirror, focus], {"room": 1.0}, entrance={"back_off_mm": 0.0})
    theta = disc(0.15)
    traced = trace(sequence_of(system, "ellipse:r"), np.zeros_like(theta), theta)
    np.testing.assert_allclose(traced.x, 0.0, atol=1e-16)
    np.testing.assert_allclose(traced.opl, 2e-3 * a, atol=1e-16)


@pytest.mark.parametrize("n", [1.5, 1.9])
def test_ball_lens(n):
    """A ray at height h leaves a ball under 2(i − i′) and crosses the axis R sin i / sin 2(i − i′) from its centre."""
    radius, distance = 10.0, 40.0
    halves = surface("in", "glass", 2 * radius, radius, 9.9), surface("out", "back", distance, -radius, 9.9)
    ball = frame("ball", "room", *halves, detector(), start_mm=5.0)
    system = build([ball], {"room": 1.0, "glass": n, "back": 1.0}, radius=9.0)
    h = np.array([1e-3, 3e-3, 5e-3])
    p = np.column_stack([0 * h, h])
    traced = trace(sequence_of(system, "in out"), p, AXIS)
    i = np.arcsin(h / (radius * 1e-3))
    turn = 2 * (i - np.arcsin(h / (radius * 1e-3) / n))
    np.testing.assert_allclose(traced.direction[:, 1], -np.sin(turn), atol=1e-15)
    cross = h / np.sin(turn)
    np.testing.assert_allclose(
        traced.x[:, 1], -(distance + radius) * 1e-3 * np.tan(turn) + cross * np.tan(turn), atol=1e-15
    )


def test_plane_parallel_plate():
    """Shift t sin θ (1 − cos θ/(n cos θ′)) across the ray; path n t/cos θ′ instead of the air's."""
    n, t, gap = 1.6, 8.0, 30.0
    tilted = frame("plate", "room", surface("in", "glass", t, aperture=80.0), surface("out", "back", aperture=80.0),
                   shift_mm=[0.0, 0.0, 20.0], rotate_deg=[37.0, 0.0, 0.0])  # fmt: skip
    end = frame("end", "back", detector(), start_mm=20.0 + gap)
    system = build([tilted, end], {"room": 1.0, "glass": n, "back": 1.0})
    traced = trace(sequence_of(system, "in out"), disc(0.004), AXIS)
    angle = np.radians(37.0)
    inside = np.arcsin(np.sin(angle) / n)
    shift = t * 1e-3 * np.sin(angle - inside) / np.cos(inside)
    np.testing.assert_allclose(np.abs(traced.x - disc(0.004))[:, 1], shift, atol=1e-16)
    assert shift == pytest.approx(t * 1e-3 * np.sin(angle) * (1 - np.cos(angle) / (n * np.cos(inside))), rel=1e-12)
    along = t * 1e-3 * np.cos(angle - inside) / np.cos(inside)
    opl = (20.0 + gap) * 1e-3 - along + n * t * 1e-3 / np.cos(inside)
    np.testing.assert_allclose(traced.opl, opl, atol=1e-16)
    np.testing.assert_allclose(traced.direction, 0.0, atol=1e-15)


def test_tilts_follow_each_other_about_new_axes():
    """First α about x, then β about the new y: the normal becomes (sin β, −sin α cos β, cos α cos β)."""
    alpha, beta, gamma = np.radians([11.0, -7.0, 40.0])
    tilt = np.degrees([alpha, beta, gamma]).tolist()
    mirror = frame(
        "mirror", "room", surface("flat", "", coating="mirror", nominal="reflect", tilt_deg=tilt), start_mm=50.0
    )
    end = frame("end", "room", detector(), rotate_deg=[180.0, 0.0, 0.0], start_mm=10.0)
    traced = trace(sequence_of(build([mirror, end], {"room": 1.0}), "flat:r"), np.zeros((1, 2)), AXIS)
    normal = np.array([np.sin(beta), -np.sin(alpha) * np.cos(beta), np.cos(alpha) * np.cos(beta)])
    reflected = np.array([0.0, 0.0, 1.0]) - 2 * normal[2] * normal
    np.testing.assert_allclose(traced.direction[0], [reflected[0], -reflected[1]], atol=1e-15)


def test_opl_starts_at_the_pupil_in_its_medium():
    """The stretch from where rays start to the pupil is taken off with the index of the space it lies in."""
    system = build([frame("end", "water", detector(), start_mm=20.0)], {"water": 1.33})
    theta = np.array([0.0, 0.3])
    traced = trace(sequence_of(system, ""), disc(0.004), theta)
    np.testing.assert_allclose(traced.opl, 1.33 * 0.020 / np.sqrt(1 - 0.09), rtol=1e-15)


# ------------------------------------------------------------------------------------------------ path length


def optical_length(sequence, points):
    """Σ n·|segment|; the first one is negative where the entrance pupil lies behind the first surface."""
    along = np.diff(points, axis=0)
    length = np.linalg.norm(along, axis=2)
    length[0] *= np.sign(along[0, :, 2])
    return sequence.n1 @ length


@pytest.mark.parametrize(
    "text", ["S1 S2 S3 S4 S5 S6", "S1 S2:r S1:r S2 S3 S4 S5 S6", "S1 S2 S3 S4:r S3 S2:r S3 S4 S5 S6"]
)
def test_opl_is_index_times_length(text):
    system = published("cooke_triplet")
    sequence = sequence_of(system, text)
    p, theta = disc(0.001), np.array([0.01, -0.03])
    points = history(sequence, p, theta)
    np.testing.assert_allclose(optical_length(sequence, points), trace(sequence, p, theta).opl, atol=1e-15)


def test_opl_is_stationary():
    """Fermat: moving one of the points where a ray meets surfaces along its surface leaves its length alone."""
    system = published("double_gauss")
    sequence = nominal(system)
    points = history(sequence, disc(0.008, 20), np.array([0.02, 0.01]))
    surfaces = [system.surfaces[system.number[name]] for name in sequence.names]
    axes, centre = system.pupil_frame()

    for k, s in enumerate(surfaces[:-1]):
        sides = []
        for step in (2e-6, -2e-6):
            moved = points.copy()
            local = (points[k + 1] @ axes + centre - s.origin) @ s.rotation.T
            x, y = local[:, 0] + step, local[:, 1] - step
            moved[k + 1] = (np.stack([x, y, s.sag(x, y)], axis=1) @ s.rotation + s.origin - centre) @ axes.T
            sides.append(optical_length(sequence, moved))
        # The derivative along the surface; the cosines on both sides of it, which cancel, are of order 0.1.
        np.testing.assert_allclose((sides[0] - sides[1]) / 4e-6, 0.0, atol=5e-6)
        assert (np.abs(sides[0] - optical_length(sequence, points)) > 1e-13).all()  # it does change


def reverse(sequence, rays):
    """The rays at a sequence's end, turned round and sent back: rays in the pupil frame, path length, power."""
    count, back = len(sequence.curvature), rays.copy()
    back[3:] *= -1.0
    order = np.arange(count - 1)[::-1]
    rot = np.array([sequence.rot[k + 1].T for k in order] + [sequence.rot[0].T])
    shift = np.array(
        [-sequence.rot[k + 1] @ sequence.shift[k + 1] for k in order] + [-sequence.rot[0] @ sequence.shift[0]]
    )

    def turned(values, plane):
        return np.append(values[order], plane)

    reflect = sequence.mode == 1
    n1, n2 = np.where(reflect, sequence.n1, sequence.n2), np.where(reflect, sequence.n2, sequence.n1)
    opl, power, clearance = np.zeros(rays.shape[1]), np.ones(rays.shape[1]), np.full(rays.shape[1], np.inf)
    status = np.zeros(rays.shape[1], dtype=np.int64)
    space = sequence.n1[0]
    # A transmitted ray comes from the other side, a reflected one from the same.
    side = np.where(reflect, sequence.side, -sequence.side)
    trace_sequence(rot, shift, turned(sequence.curvature, 0.0), turned(sequence.conic, 0.0), turned(n1, space),
                   turned(n2, space), turned(sequence.mode, 0), turned(side, 0.0), turned(sequence.weight, 1.0),
                   turned(sequence.bare, 0), np.vstack([sequence.aperture[order], np.zeros(5)]), back,
                   np.empty((0, *rays.shape)), opl, power, status, clearance,
                   np.empty((0, 2, rays.shape[1])))  # fmt: skip
    # Only the pupil plane may lie where the ray is virtual: behind the first surface.
    assert ((status == 0) | (status == KINDS * count + BACKWARD)).all()
    return back, opl, power


@pytest.mark.parametrize(
    ("system", "text"),
    [
        (published("double_gauss"), "S1 S2 S3 S4 S5 stop S7 S8 S9 S10 S11"),
        (published("cooke_triplet"), "S1 S2:r S1:r S2 S3 S4 S5 S6"),
        (singlet(90.0), "front_face back_face:r front_face:r back_face"),
        (
            michelson(ar=0.01, tilt=0.1),
            "cube_in splitter:r cube_arm1 mirror1:r cube_arm1:r mirror1:r cube_arm1 splitter cube_exit",
        ),
    ],
    ids=["double Gauss", "ghost of a triplet", "ghost of bare faces", "twice at mirror 1"],
)
def test_light_returns_along_its_path(system, text):
    """Reversed rays come back to where they started, as long and with as much power lost: reciprocity."""
    sequence = sequence_of(system, text)
    p, theta = disc(0.0015, 50), np.array([0.004, -0.003])
    traced = trace(sequence, p, theta)
    assert traced.passes.all()
    n = -np.sqrt(1 - (traced.direction**2).sum(axis=1))
    # The rays' own z direction at the detector: along +z there, since every detector faces its light.
    rays = np.vstack([traced.x.T, np.zeros(len(p)), traced.direction.T, -n])
    back, opl, power = reverse(sequence, rays)
    np.testing.assert_allclose(back[:2].T, p, atol=1e-15)
    np.testing.assert_allclose(back[3:5].T, -np.broadcast_to(theta, p.shape), atol=1e-13)
    np.testing.assert_allclose(opl, traced.opl, atol=1e-15)
    np.testing.assert_allclose(power, traced.power, rtol=1e-12)


# ------------------------------------------------------------------------------------------------ what can go wrong


def test_trouble_names_kind_and_surface():
    # A half ball: parallel rays meet its round back beyond the critical angle; a sphere of 4 mm is missed at 5 mm.
    lens = surface("flat", "glass", 8.0, aperture=9.0), surface("round", "back", 30.0, -10.0, 9.0)
    frames = [frame("lens", "room", *lens, surface("small", "end", 5.0, 4.0, 3.9), detector(), start_mm=2.0)]
    system = build(frames, {"room": 1.0, "glass": 1.5, "back": 1.0, "end": 1.0}, radius=9.0)
    sequence = sequence_of(system, "flat round small")
    h = np.array([0.0, 1.0, 5.0, 6.5, 7.5, 8.5]) * 1e-3
    traced = trace(sequence, np.column_stack([h, 0 * h]), AXIS)
    critical = 10e-3 / 1.5
    beyond = int((h > critical).sum())
    counts = trouble(sequence, traced)
    assert counts["total internal reflection at round"] == beyond
    assert counts["missed small"] >= 1
    assert sum(counts.values()) == int((traced.status != 0).sum())
    assert not traced.passes[h > critical].any() and not traced.valid[h > critical].any()


def two_faces(detector_at):
    """Glass between z = 2 and 7 mm, the detector at ``detector_at`` mm."""
    frames = [frame("glass", "room", surface("first", "glass", 5.0), surface("second", "back"), start_mm=2.0),
              frame("end", "back", detector(), start_mm=detector_at)]  # fmt: skip
    return build(frames, {"room": 1.0, "glass": 1.5, "back": 1.0})


def test_virtual_ray_is_named_and_valid():
    """A detector drawn before the last face is reached backwards: traced, and flagged."""
    sequence = sequence_of(two_faces(4.0), "first second")
    traced = trace(sequence, np.zeros((1, 2)), AXIS)
    assert trouble(sequence, traced) == {"virtual at detector": 1}
    assert not traced.passes[0] and traced.valid[0]
    np.testing.assert_allclose(traced.opl, 2e-3 + 1.5 * 5e-3 - 3e-3, rtol=1e-14)


def test_surface_hit_from_the_wrong_side_is_named():
    """Media join, but light that has turned round at a face cannot leave through it: it moves away from the step."""
    system = two_faces(12.0)
    sequence = sequence_of(system, "first second:r second")
    traced = trace(sequence, np.zeros((3, 2)), AXIS)
    assert trouble(sequence, traced) == {"on the wrong side of second": 3}
    assert not traced.passes.any()
    # The same steps with light that does come from there.
    assert trace(sequence_of(system, "first second:r first:r second"), np.zeros((3, 2)), AXIS).passes.all()


def test_an_empty_beam_has_no_trouble_and_no_rays():
    sequence = sequence_of(two_faces(12.0), "first second")
    traced = trace(sequence, np.zeros((0, 2)), AXIS)
    assert trouble(sequence, traced) == {} and traced.x.shape == (0, 2)


def test_threads_do_not_show():
    """The same rays on one, two and three threads, to the last bit; with footprints, too."""
    system = published("double_gauss")
    sequence, p = nominal(system), disc(0.02, 5000)
    theta = disc(0.1, 5000, 1)
    one = trace(sequence, p, theta)
    for other in (trace(sequence, p, theta, threads=2), trace(sequence, p, theta, threads=3),
                  trace(sequence, p, theta, footprints=True)):  # fmt: skip
        for column in ("x", "direction", "opl", "power", "clearance", "status"):
            np.testing.assert_array_equal(getattr(one, column), getattr(other, column))
    assert 0 < one.passes.sum() < 5000
    with pytest.raises(InputError, match="threads"):
        trace(sequence, p, theta, threads=0)


def test_media_that_do_not_join_are_refused():
    system = published("cooke_triplet")
    with pytest.raises(InputError, match="media do not join"):
        sequence_of(system, "S1 S3 S4 S5 S6")
    with pytest.raises(InputError, match="nothing behind"):
        sequence_of(michelson(), "cube_in splitter cube_arm2 mirror2")


def test_vignetting_is_the_overlap_of_two_circles():
    """Pupil and a hole of the same radius, seen from an angle: the lens-shaped share of rays passes."""
    a, distance = 5.0, 60.0
    frames = [frame("hole", "room", surface("hole", "behind", 5.0, aperture=a), detector(), start_mm=distance)]
    sequence = sequence_of(build(frames, {"room": 1.0, "behind": 1.0}, radius=a), "hole")
    grid = np.linspace(-a, a, 801) * 1e-3
    p = np.array(np.meshgrid(grid, grid)).reshape(2, -1).T
    p = p[(p**2).sum(axis=1) < (a * 1e-3) ** 2]
    tangent = 0.07
    traced = trace(sequence, p, np.array([tangent, 0.0]) / np.hypot(1, tangent))
    d = distance * tangent
    share = (2 * a**2 * np.arccos(d / (2 * a)) - 0.5 * d * np.sqrt(4 * a**2 - d**2)) / (np.pi * a**2)
    assert traced.passes.mean() == pytest.approx(share, abs=1e-4)


# ------------------------------------------------------------------------------------------------ aiming, derivatives


def test_aim_ends_on_the_target():
    sequence = nominal(published("double_gauss"))
    target, p = np.array([1.5e-3, -2.5e-3]), disc(0.008)
    theta, ok = aim(sequence, p, target, AXIS)
    assert ok.all()
    np.testing.assert_allclose(trace(sequence, p, theta).x, np.broadcast_to(target, p.shape), atol=1e-10)


def test_aim_gives_up_where_no_ray_goes():
    """Light cannot leave a plate of glass at 80 degrees: such targets are reported, not invented."""
    frames = [frame("glass", "glass", surface("out", "back", 1.0), detector(), start_mm=2.0)]
    system = build(frames, {"glass": 1.5, "back": 1.0})
    _, ok = aim(sequence_of(system, "out"), np.zeros((1, 2)), np.array([0.9, 0.0]), AXIS)
    assert not ok.any()


@pytest.mark.parametrize("text", ["S1 S2 S3 S4 S5 S6", "S1 S2 S3 S4:r S3 S2:r S3 S4 S5 S6"])
def test_map_of_rays_is_symplectic(text):
    """[∂x/∂p ∂x/∂θ; ∂q/∂p ∂q/∂θ] keeps the area dp∧dθ: Mᵀ J M = J."""
    sequence = sequence_of(published("cooke_triplet"), text)
    p, theta = disc(0.0005, 40), np.array([0.01, 0.02])
    by_p, by_theta = jacobian(sequence, p, theta, of="p"), jacobian(sequence, p, theta)
    m = np.block([[by_p[0], by_theta[0]], [by_p[1], by_theta[1]]])
    j = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
    np.testing.assert_allclose(m.transpose(0, 2, 1) @ j @ m, np.broadcast_to(j, m.shape), atol=1e-12)


# ------------------------------------------------------------------------------------------------ another tracer


@pytest.mark.parametrize("name", ["cooke_triplet", "double_gauss"])
def test_published_lens_agrees_with_batoid(name):
    """Rays stored by validation/rays.py: nominal path and a ghost, on and off axis."""
    system = published(name)
    stored = json.loads((DATA / f"batoid_{name}.json").read_text())
    for case in stored["cases"]:
        traced = trace(sequence_of(system, case["path"]), np.array(case["p_m"]), np.array(case["theta"]))
        np.testing.assert_allclose(traced.x, case["x_m"], rtol=0, atol=1e-13)
        np.testing.assert_allclose(traced.direction, case["direction"], rtol=0, atol=1e-12)
        np.testing.assert_allclose(traced.opl, case["opl_m"], rtol=0, atol=1e-13)
