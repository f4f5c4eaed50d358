"""Beams: power as étendue, Jacobians, caustics and their phase, slopes of the path difference, spots, clearances."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from small_instruments import build, detector, frame, michelson, published, singlet, surface

from cgi_wave.errors import EmptyBeamError
from cgi_wave.rays.beams import nominal_direction, rays_from_direction, rays_to_point, spot
from cgi_wave.rays.disc import disc, monomials
from cgi_wave.rays.paths import find_paths, parse_path
from cgi_wave.rays.trace import aim, caustics, compile_sequence, trace

AXIS = np.zeros(2)


def free_space(distance=50.0, radius=5.0):
    """Nothing between the pupil and the detector."""
    return build([frame("end", "room", detector(), start_mm=distance)], {"room": 1.0}, radius=radius)


def to_point(system, path, x0, start=AXIS):
    return rays_to_point(system, path, np.asarray(x0, dtype=float), np.array([system.sigma0]), start)


def cone(system, path, x0, count=720):
    """Area in direction cosines of the cone of rays that ends on ``x0``: the polygon of the pupil's rim rays."""
    angle = 2 * np.pi * np.arange(count) / count
    p = system.pupil_radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    sequence = compile_sequence(system, path, system.sigma0)
    theta, ok = aim(sequence, p, np.asarray(x0, dtype=float), AXIS)
    assert ok.all()
    q = trace(sequence, p, theta).direction
    area = 0.5 * abs(np.sum(q[:, 0] * np.roll(q[:, 1], -1) - q[:, 1] * np.roll(q[:, 0], -1)))
    return area / np.sinc(2 / count)  # a regular polygon falls short of its circle by this


def disc_integral(system, rays):
    """∫ amplitude² over the pupil disc: a polynomial through the samples, integrated with Gauss points on rings."""
    nodes, weight = np.polynomial.legendre.leggauss(12)
    r = np.sqrt(0.5 * (nodes + 1))
    angle = 2 * np.pi * np.arange(24) / 24
    points = np.stack([np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel()], axis=1)
    basis = partial(monomials, degree=10)
    fit = np.linalg.lstsq(basis(rays.pupil[0] / system.pupil_radius), rays.amplitude[0] ** 2, rcond=None)[0]
    return np.pi * system.pupil_radius**2 * np.mean(0.5 * np.repeat(weight, 24) * len(nodes) * (basis(points) @ fit))


# ------------------------------------------------------------------------------------------------ power, Jacobians


def test_even_points_fill_the_disc():
    points = disc(2000)
    r2 = (points**2).sum(axis=1)
    assert r2.max() == pytest.approx(1.0)
    even = points[r2 < 0.985**2] / 0.985
    np.testing.assert_allclose(even.mean(axis=0), 0.0, atol=2e-3)
    np.testing.assert_allclose(np.mean((even**2).sum(axis=1)), 0.5, atol=2e-3)


@pytest.mark.parametrize("distance", [20.0, 200.0])
def test_power_through_free_space_is_the_solid_angle(distance):
    """π sin²θ′ for a disc seen from its axis."""
    system = free_space(distance)
    rays = to_point(system, parse_path(system, ""), AXIS)
    exact = np.pi * 5.0**2 / (5.0**2 + distance**2)
    assert disc_integral(system, rays) == pytest.approx(exact, rel=1e-6)
    power, error = rays.power()
    assert abs(power - exact) < error < 0.05 * exact


@pytest.mark.parametrize("name", ["cooke_triplet", "double_gauss"])
@pytest.mark.parametrize("x0", [(0.0, 0.0), (1.2e-3, -1.5e-3)])
def test_power_is_the_etendue_of_the_rays(name, x0):
    """∫ |∂q/∂p| d²p is the area that the same cone covers in direction cosines, whatever the aberrations."""
    system = published(name)
    path = find_paths(system, max_order=0)[0]
    rays = to_point(system, path, x0)
    coatings = 0.98 ** (len(path.steps) - ("stop" in str(path)))
    exact = coatings * cone(system, path, x0)
    assert disc_integral(system, rays) == pytest.approx(exact, rel=1e-5)
    power, error = rays.power()
    assert abs(power - exact) < error


def test_power_follows_the_sine_condition():
    """f/5 on axis: π sin²θ′ with sin θ′ = a/f, within twice the relative offence against the sine condition."""
    system = published("double_gauss")
    path = find_paths(system, max_order=0)[0]
    sequence = compile_sequence(system, path, system.sigma0)
    heights = np.array([[1e-6, 0.0], [system.pupil_radius, 0.0]])
    q = trace(sequence, heights, AXIS).direction[:, 0]
    focal, marginal = -heights[:, 0] / q
    offence = abs(marginal / focal - 1)
    assert offence < 5e-3
    rays = to_point(system, path, AXIS)
    aplanatic = 0.98**10 * np.pi * (system.pupil_radius / focal) ** 2
    assert disc_integral(system, rays) == pytest.approx(aplanatic, rel=3 * offence + 1e-3)


@pytest.mark.parametrize("text", ["S1 S2 S3 S4 S5 S6", "S1 S2 S3 S4:r S3 S2:r S3 S4 S5 S6"])
def test_amplitude_is_the_jacobian_at_a_fixed_point(text):
    """|det ∂q/∂p| with the end held: neighbouring pupil points aimed anew, against 1/|det ∂x/∂θ|."""
    system = published("cooke_triplet")
    path = parse_path(system, text)
    sequence = compile_sequence(system, path, system.sigma0)
    p, x0 = disc(30) * 5e-4, np.array([4e-4, -3e-4])
    start, ok = aim(sequence, p, x0, AXIS)
    assert ok.all()
    step = 2e-6
    columns = []
    for delta in ([step, 0.0], [0.0, step]):
        q = []
        for sign in (1, -1):
            at = p + sign * np.array(delta)
            theta, ok = aim(sequence, at, x0, start)
            assert ok.all()
            q.append(trace(sequence, at, theta).direction)
        columns.append((q[0] - q[1]) / (2 * step))
    by_p = np.abs(np.linalg.det(np.stack(columns, axis=2)))
    rays = to_point(system, path, x0)
    # The beam's own rays: a polynomial through amplitude² / power, read at the points above.
    scale = np.abs(rays.pupil[0]).max() * 1.05
    lit = np.hypot(*rays.pupil[0].T) < 2e-3
    values = rays.amplitude[0, lit] ** 2 / np.unique(trace(sequence, p, start).power)[0]
    fit = np.linalg.lstsq(monomials(rays.pupil[0, lit] / scale, 5), values, rcond=None)[0]
    np.testing.assert_allclose(monomials(p / scale, 5) @ fit, by_p, rtol=2e-3)


def test_direction_rays_carry_the_same_power():
    """Σ amplitude² over q of a plane wave is the area of the pupil: |∂p/∂q| d²q = d²p."""
    system = singlet(60.0)
    path = parse_path(system, "front_face back_face")
    rays = rays_from_direction(system, path, AXIS, AXIS, np.array([system.sigma0]))
    q, amplitude = rays.u[0], rays.amplitude[0]
    fit = np.linalg.lstsq(monomials(q / np.abs(q).max(), 8), amplitude**2, rcond=None)[0]
    edge = np.hypot(*q[np.abs(np.hypot(*rays.pupil[0].T) / np.hypot(*rays.pupil[0].T).max() - 1) < 1e-9].T).mean()
    nodes, weight = np.polynomial.legendre.leggauss(12)
    r = edge * np.sqrt(0.5 * (nodes + 1))
    radial = monomials(np.stack([r, 0 * r], axis=1) / np.abs(q).max(), 8) @ fit
    power = np.pi * edge**2 * (0.5 * weight @ radial)
    pupil = np.pi * np.hypot(*rays.pupil[0].T).max() ** 2
    assert power / pupil == pytest.approx((1 - 0.04) ** 2, rel=1e-4)


# ------------------------------------------------------------------------------------------------ caustics


def count(system, text, vary):
    sequence = compile_sequence(system, parse_path(system, text), system.sigma0)
    return caustics(sequence, np.zeros(2), np.zeros(2), vary)


#: Thin enough to be a lens of f = R/2(n − 1) = 100 mm, to within its thickness.
FOCUS = 100.0


@pytest.mark.parametrize(("distance", "expected"), [(0.5, 0), (0.97, 0), (1.03, 2), (3.0, 2)])
def test_caustics_of_a_focus(distance, expected):
    assert count(singlet(distance * FOCUS), "front_face back_face", "p") == expected


@pytest.mark.parametrize(("distance", "expected"), [(0.97, 0), (1.03, 2)])
def test_caustics_of_the_pupils_image(distance, expected):
    """Light from a point of a pupil 150 mm before the lens meets again at 300 mm; from within f it never does."""
    far = singlet(distance * 300.0, at_mm=[0.0, 0.0, -130.0])
    assert count(far, "front_face back_face", "theta") == expected
    assert count(singlet(900.0), "front_face back_face", "theta") == 0


def tilted_mirror(distance, radius=200.0, tilt=30.0):
    """A sphere hit at ``tilt``: line foci at R cos i/2 (86.6 mm) and R/(2 cos i) (115.5 mm)."""
    sphere = surface("sphere", "", 0.0, -radius, 20.0, coating="mirror", nominal="reflect", tilt_deg=[tilt, 0.0, 0.0])
    mirror = frame("mirror", "room", sphere, start_mm=50.0)
    end = frame("end", "room", detector(), attach="sphere", rotate_deg=[2 * tilt - 180.0, 0.0, 0.0], start_mm=distance)
    return build([mirror, end], {"room": 1.0}, radius=1.0)


@pytest.mark.parametrize(
    ("distance", "expected"), [(80.0, 0), (86.0, 0), (87.2, 1), (100.0, 1), (115.0, 1), (116.0, 2), (150.0, 2)]
)
def test_caustics_between_line_foci(distance, expected):
    assert count(tilted_mirror(distance), "sphere:r", "p") == expected


@pytest.mark.parametrize("distance", [80.0, 100.0, 150.0])
def test_directions_know_nothing_of_foci(distance):
    """Â(q) belongs to the wave, not to a plane: caustics and signature of ∂q/∂x leave −π/2 before, between, after."""
    system = tilted_mirror(distance)
    path = parse_path(system, "sphere:r")
    rays = rays_from_direction(system, path, AXIS, AXIS, np.array([system.sigma0]))
    assert rays.phase - compile_sequence(system, path, system.sigma0).phase == pytest.approx(-0.5 * np.pi)


@pytest.mark.parametrize(("distance", "expected"), [(0.9, 0.0), (1.1, -np.pi)])
def test_point_focus_turns_the_phase_by_pi(distance, expected):
    """−π/2 for each caustic between a pupil point and the detector point."""
    system = singlet(distance * 300.0, at_mm=[0.0, 0.0, -130.0])
    rays = to_point(system, parse_path(system, "front_face back_face"), AXIS)
    assert rays.phase == pytest.approx(expected)


def test_gouy_phase_against_a_gaussian_beam():
    """A paraxial Gaussian beam through the focus of the mirror: exp(i·arg) of its amplitude tends to the counted phase.

    In each plane the amplitude is (1 + s/q)^−½ with 1/q = −1/f + iλ/πw²: its phase goes from 0 to −π/2 at that focus.
    """
    foci = np.array([100.0 * np.cos(np.pi / 6), 100.0 / np.cos(np.pi / 6)])
    for distance in (60.0, 100.0, 180.0):
        exact = np.angle(np.prod((1 - distance / foci + 1e-6j * distance) ** -0.5))
        counted = -0.5 * np.pi * count(tilted_mirror(distance), "sphere:r", "p")
        assert np.exp(1j * exact) == pytest.approx(np.exp(1j * counted), abs=1e-3)


# ------------------------------------------------------------------------------------------------ path difference


def test_path_length_changes_by_the_direction():
    """∂Λ(p; x)/∂x = q for every pupil point: central difference of two aimed beams."""
    system = published("cooke_triplet")
    path = find_paths(system, max_order=0)[0]
    x0, step = np.array([5e-4, -8e-4]), 1e-5
    middle = to_point(system, path, x0)
    for axis in range(2):
        delta = step * np.eye(2)[axis]
        up, down = (to_point(system, path, x0 + sign * delta) for sign in (1, -1))
        np.testing.assert_array_equal(up.pupil, down.pupil)
        slope = (up.opl - down.opl) / (2 * step)
        np.testing.assert_allclose(slope, middle.direction[:, :, axis], atol=1e-8)


def test_slope_of_a_tilted_mirror():
    """Two arms to one point, one mirror tilted by α: the OPD grows by sin 2α per metre along y."""
    tilt = 0.05
    system = michelson(tilt=tilt)
    arms = find_paths(system, max_order=0)
    pivot = np.zeros((1, 2))

    def opl(path, y):
        sequence = compile_sequence(system, path, system.sigma0)
        theta, ok = aim(sequence, pivot, np.array([0.0, y]), AXIS)
        assert ok.all()
        end = trace(sequence, pivot, theta)
        return end.opl[0], end.direction[0, 1]

    step = 1e-4
    up, down, here = ([opl(path, y) for path in arms] for y in (step, -step, 0.0))
    slope = ((up[1][0] - up[0][0]) - (down[1][0] - down[0][0])) / (2 * step)
    assert slope == pytest.approx(here[1][1] - here[0][1], abs=1e-9)
    # A plane wave leaves arm 2 at 2α; between one pupil point and one detector point the lengths share that angle.
    plane = [trace(compile_sequence(system, path, system.sigma0), pivot, AXIS).direction[0, 1] for path in arms]
    assert abs(plane[1] - plane[0]) == pytest.approx(np.sin(2 * np.radians(tilt)), rel=1e-5)


def test_path_length_does_not_depend_on_how_well_it_was_aimed():
    """Free space: Λ is the distance, to rounding, though aiming stops at 1e-10 m."""
    system = free_space(50.0)
    x0 = np.array([1e-3, -4e-3])
    rays = to_point(system, parse_path(system, ""), x0)
    exact = np.sqrt(((rays.pupil[0] - x0) ** 2).sum(axis=1) + 0.05**2)
    np.testing.assert_allclose(rays.opl[0], exact, rtol=0, atol=1e-16)
    np.testing.assert_allclose(rays.x[0], np.broadcast_to(x0, rays.x[0].shape), atol=1e-10)


@pytest.mark.parametrize("name", ["cooke_triplet", "double_gauss"])
def test_a_tilted_plane_waves_eikonal_lands_on_its_rays(name):
    """∂(Λ − q·(x − x0))/∂q = −(x − x0): holds only if Λ is counted from the wave's own, tilted front."""
    system = published(name)
    path = find_paths(system, max_order=0)[0]
    x0, theta = np.array([1e-3, 2e-3]), np.array([0.03, 0.05])
    rays = rays_from_direction(system, path, theta, x0, np.array([system.sigma0]))
    lit = (rays.clearance[:, 0] > 0).all(axis=0)
    q, x, opl = rays.u[0, lit], rays.x[0, lit], rays.opl[0, lit]
    centre, half = q.mean(axis=0), np.abs(q - q.mean(axis=0)).max() * 1.01
    coefficient = np.linalg.lstsq(monomials((q - centre) / half, 8), opl, rcond=None)[0]
    step = 1e-4
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        ahead, behind = (monomials((q - centre) / half + s * shift, 8) @ coefficient for s in (1, -1))
        slope = (ahead - behind) / (2 * step * half)
        # Blur of the lenses is tens of micrometres, f·θ some millimetres: the fit follows the rays to a micrometre.
        np.testing.assert_allclose(slope, -(x - x0)[:, axis], atol=2e-6)


def test_plane_waves_phase_stands_about_the_point():
    """Free space: opl − q·(x − x0) is the same for every ray of a plane wave, (p − x0)·q apart from none."""
    system = singlet(100.4)
    path = parse_path(system, "front_face back_face")
    x0 = np.array([2e-5, -1e-5])
    rays = rays_from_direction(system, path, AXIS, x0, np.array([system.sigma0]))
    about_axis = rays_from_direction(system, path, AXIS, AXIS, np.array([system.sigma0]))
    np.testing.assert_allclose(rays.opl - about_axis.opl, rays.direction @ x0, atol=1e-16)


# ------------------------------------------------------------------------------------------------ spots, clearances


def test_spot_of_a_plane_wave_is_the_pupil():
    """Uniform disc: rms a/2 on each axis, centroid at L·tan θ."""
    system = free_space(50.0)
    theta = np.array([0.06, -0.08])
    got = spot(system, parse_path(system, ""), theta, system.sigma0)
    np.testing.assert_allclose(got.rms, 2.5e-3, rtol=2e-3)
    np.testing.assert_allclose(got.centroid, 0.05 * theta / np.sqrt(1 - 0.01), atol=5e-6)
    assert got.power == pytest.approx(1.0)


def test_spot_carries_coatings_and_vignetting():
    """Half of the pupil behind an edge: half the power, centroid at 4a/3π."""
    edge = surface(
        "edge", "behind", 5.0, aperture={"half_width_mm": [50.0, 50.0], "centre_mm": [0.0, 50.0]}, coating="grey"
    )
    grey = {"grey": {"reflectance": 0.0, "transmittance": 0.7}}
    system = build([frame("end", "room", edge, detector(), start_mm=1.0)], {"room": 1.0, "behind": 1.0}, coating=grey)
    got = spot(system, parse_path(system, "edge"), AXIS, system.sigma0, 20000)
    assert got.power == pytest.approx(0.35, rel=2e-3)
    np.testing.assert_allclose(got.centroid, [0.0, 4 * 5e-3 / (3 * np.pi)], atol=1e-5)


def test_clearances_hold_what_cuts():
    """The zero line of the smallest clearance is the edge of the light: here the pupil's left half."""
    edge = surface("edge", "behind", 5.0, aperture={"half_width_mm": [50.0, 50.0], "centre_mm": [-50.0, 0.0]})
    wide = surface("wide", "again", 5.0, aperture=80.0)
    system = build(
        [frame("end", "room", edge, wide, detector(), start_mm=1.0)], {"room": 1.0, "behind": 1.0, "again": 1.0}
    )
    path = parse_path(system, "edge wide")
    rays = rays_from_direction(system, path, AXIS, AXIS, np.array([system.sigma0]))
    lit = (rays.clearance[:, 0] > 0).all(axis=0)
    p = rays.pupil[0]
    np.testing.assert_array_equal(lit, (p[:, 0] < 0) & ((p**2).sum(axis=1) < 5e-3**2))
    assert len(rays.clearance) <= 3  # pupil and edge; the wide ones cannot cut


def test_sampled_disc_closes_in_on_a_small_beam():
    """A hole of a twentieth of the pupil's area: the rays are drawn in around it."""
    hole = surface("hole", "behind", 30.0, aperture={"radius_mm": 1.1, "centre_mm": [2.0, -1.0]})
    system = build([frame("end", "room", hole, detector(), start_mm=1.0)], {"room": 1.0, "behind": 1.0})
    rays = to_point(system, parse_path(system, "hole"), AXIS)
    lit = (rays.clearance[:, 0] > 0).all(axis=0)
    assert lit.mean() > 0.3
    power, error = rays.power()
    # Seen from the detector, 30 mm behind the hole.
    solid = _solid_angle(np.array([2.0, -1.0]), 1.1, 30.0)
    assert abs(power - solid) < error


@pytest.mark.parametrize("seed", range(12))
def test_error_of_the_power_holds(seed):
    """A hole somewhere in the pupil, of some size: the sum over even rays lies within its error of the integral."""
    rng = np.random.default_rng(seed)
    size, (x, y) = rng.uniform(0.4, 2.0), rng.uniform(-1.8, 1.8, 2)
    hole = surface("hole", "behind", 30.0, aperture={"radius_mm": size, "centre_mm": [float(x), float(y)]})
    system = build([frame("end", "room", hole, detector(), start_mm=1.0)], {"room": 1.0, "behind": 1.0})
    power, error = to_point(system, parse_path(system, "hole"), AXIS).power()
    assert abs(power - _solid_angle(np.array([x, y]), size, 30.0)) < error < 0.1 * power


def _solid_angle(centre, radius, distance):
    """∫ d²q of a hole (mm) seen from a point ``distance`` before it on the axis: cos θ dΩ = h² d²s/(h² + s²)²."""
    nodes, weight = np.polynomial.legendre.leggauss(20)
    r, angle = np.sqrt(0.5 * (nodes + 1)) * radius, 2 * np.pi * np.arange(64) / 64
    s = centre[:, None, None] + r[:, None] * np.stack([np.cos(angle), np.sin(angle)])[:, None, :]
    value = distance**2 / (distance**2 + (s**2).sum(axis=0)) ** 2
    return np.pi * radius**2 * (0.5 * weight @ value.mean(axis=1))


def test_beams_that_do_not_arrive_are_errors():
    aside = surface("hole", "behind", 5.0, aperture={"radius_mm": 0.5, "centre_mm": [40.0, 0.0]})
    system = build([frame("end", "room", aside, detector(), start_mm=1.0)], {"room": 1.0, "behind": 1.0})
    path, sigmas = parse_path(system, "hole"), np.array([system.sigma0])
    with pytest.raises(EmptyBeamError, match="no ray"):
        spot(system, path, AXIS, system.sigma0)
    with pytest.raises(EmptyBeamError, match="no ray reaches"):
        to_point(system, path, AXIS)
    with pytest.raises(EmptyBeamError, match="no ray of direction"):
        rays_from_direction(system, path, AXIS, AXIS, sigmas)
    glass = build(
        [frame("g", "glass", surface("out", "back", 1.0), detector(), start_mm=2.0)], {"glass": 1.5, "back": 1.0}
    )
    with pytest.raises(EmptyBeamError, match="pupil's centre"):
        nominal_direction(glass, parse_path(glass, "out"), np.array([0.9, 0.0]))


def test_nominal_direction_points_at_the_detector_point():
    system = published("double_gauss")
    path = find_paths(system, max_order=0)[0]
    x0 = np.array([1e-3, -3e-3])
    theta = nominal_direction(system, path, x0)
    end = trace(compile_sequence(system, path, system.sigma0), np.zeros((1, 2)), theta)
    np.testing.assert_allclose(end.x[0], x0, atol=1e-10)


@pytest.mark.parametrize("share", [1.0, 0.7])
def test_sheet_follows_its_rays(share):
    """Polynomials over the pupil give back what was traced, whether all rays arrived or some."""
    system = published("double_gauss")
    path = find_paths(system, max_order=0)[0]
    rays = to_point(system, path, [1e-3, -3e-3])
    some = np.arange(rays.opl.shape[1]) < share * rays.opl.shape[1]
    columns = {name: getattr(rays, name)[:, some] for name in ("u", "opl", "amplitude", "direction", "pupil", "x")}
    part = replace(rays, clearance=rays.clearance[:, :, some], **columns)
    sheet = part.sheet(np.array([system.sigma0]))
    np.testing.assert_allclose(sheet.opl_at(part.pupil[0]), part.opl[0], atol=1e-8)
    np.testing.assert_allclose(sheet.y_at(part.pupil[0]), part.direction[0, :, 1], atol=1e-6)
    np.testing.assert_allclose(sheet.at(part.pupil[0])[:, 0], sheet.opl_at(part.pupil[0]), rtol=1e-14)
