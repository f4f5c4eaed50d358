"""The overlap against closed forms, as complex numbers, with the error bound tested each time."""

import itertools
from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j1
from synthetic_beams import SIGMA, beam, disc, hole

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.wave import hopkins
from cgi_wave.wave.field import fit_field
from cgi_wave.wave.overlap import Overlap, mutual_power_bound, overlap, overlap_spectrum

ONE = np.array([SIGMA])
FLAT = fit_field(beam())


def contrast(result: Overlap, sigma=ONE):
    return result.value * np.exp(2j * np.pi * sigma * result.opd_m)


def agree(result: Overlap, exact, within: float, sigma=ONE):
    """The error is within the bound, and both are small."""
    error = np.abs(contrast(result, sigma) - exact).max()
    assert error <= result.error_bound.min()
    assert result.error_bound.max() <= within


@pytest.mark.parametrize("w020", [0.0, 1.25, 10.25, 137.3, 1000.25])
def test_defocus_of_a_circular_pupil_is_a_complex_sinc(w020):
    # gamma = integral over s in (0, 1) of exp(i 2 pi W020 s), s = rho²
    exact = (np.exp(2j * np.pi * w020) - 1.0) / (2j * np.pi * w020) if w020 else 1.0
    agree(overlap(fit_field(beam(lambda x, y: w020 * (x**2 + y**2))), FLAT, ONE), exact, 1e-6)


@pytest.mark.parametrize("obscuration", [0.2, 0.5, 0.9])
def test_defocus_of_an_annulus(obscuration):
    stops, w = [disc(), hole(obscuration)], 10.3
    inner = obscuration**2
    exact = (np.exp(2j * np.pi * w) - np.exp(2j * np.pi * w * inner)) / (2j * np.pi * w * (1.0 - inner))
    moved = fit_field(beam(lambda x, y: w * (x**2 + y**2), stops))
    agree(overlap(moved, fit_field(beam(clearances=stops)), ONE), exact, 1e-6)


def lens(r, s, d):
    """Area common to discs of radii r and s whose centres are d apart."""
    if d >= r + s:
        return 0.0
    if d <= abs(r - s):
        return np.pi * min(r, s) ** 2
    a, b = np.arccos((d * d + r * r - s * s) / (2 * d * r)), np.arccos((d * d + s * s - r * r) / (2 * d * s))
    return r * r * (a - np.sin(2 * a) / 2) + s * s * (b - np.sin(2 * b) / 2)


@pytest.mark.parametrize("shift", [0.01, 0.5, 1.0, 1.9, 1.9999])
def test_sheared_circles_give_the_mtf_of_a_circular_pupil(shift):
    moved = fit_field(beam(centre=(0.6 * shift, 0.8 * shift)))
    agree(overlap(moved, FLAT, ONE), lens(1, 1, shift) / np.pi, 1e-9)


@pytest.mark.parametrize("obscuration", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("shift", [0.05, 0.7, 1.1, 1.6])
def test_sheared_annuli_with_two_holes_corners_and_pieces(obscuration, shift):
    still = fit_field(beam(clearances=[disc(), hole(obscuration)]))
    stops = [disc(1.0, shift), hole(obscuration, shift)]
    moved = fit_field(beam(clearances=stops, centre=(shift, 0.0)))
    area = lens(1, 1, shift) - 2 * lens(1, obscuration, shift) + lens(obscuration, obscuration, shift)
    agree(overlap(moved, still, ONE), area / (np.pi * (1 - obscuration**2)), 1e-6)


@pytest.mark.parametrize("obscuration", [0.2, 0.8])
def test_integrals_along_the_boundary_are_those_over_the_area(obscuration):
    # what bounds are made of, with amplitudes that grow to ten times their size in the holes, where nobody asks
    def peaked(x, y):
        return 1.0 + 9.0 * np.exp(-8.0 * (x**2 + y**2))

    still = fit_field(beam(amplitude=peaked, clearances=[disc(), hole(obscuration)]))
    moved = fit_field(beam(clearances=[disc(1.0, 0.6), hole(obscuration, 0.6)], centre=(0.6, 0.0)))
    by_panels, by_boundary = (overlap(moved, still, ONE, 1e-9, way) for way in ("panels", "boundary"))
    assert by_boundary.shared == pytest.approx(by_panels.shared, rel=1e-6)
    assert by_boundary.value[0] == pytest.approx(by_panels.value[0], abs=1e-9)


def test_one_aperture_known_from_two_clouds_of_rays():
    # two fits of the same edge differ by their misfit and cross many times: no corners worth the name
    def edge(x, y):
        return 1 - np.sqrt((x**2 + y**2 + 0.3) / 1.3) + 1e-3 * np.sin(3 * x) * np.cos(2 * y)

    one, other = (fit_field(beam(clearances=[edge], count=count)) for count in (500, 700))
    result = overlap(one, other, ONE)
    assert abs(result.value[0] - 1.0) <= result.error_bound[0] < 1e-3
    assert result.nodes < 50_000


def test_disjoint_supports_are_an_answer():
    result = overlap(fit_field(beam(centre=(1.5, 1.5))), FLAT, ONE)
    assert result.value[0] == 0.0 and result.error_bound[0] == 0.0 and result.shared == 0.0
    assert mutual_power_bound(fit_field(beam(centre=(1.5, 1.5))), FLAT) == 0.0


@pytest.mark.parametrize("z", [1.0, 3.8317, 30.0, 300.0])
def test_tilt_gives_the_airy_amplitude(z):
    tilted = fit_field(beam(lambda x, y: z / (2 * np.pi) * (0.6 * x - 0.8 * y)))
    agree(overlap(tilted, FLAT, ONE), 2 * j1(z) / z, 1e-6)


def test_plane_parallel_plate_ghost_against_a_one_dimensional_integral():
    # OPL = 2 n t cos(theta'), n sin(theta') = |q|: an F/4 cone, 0.3 mm of glass, 0.764 um
    index, thickness, edge, sigma = 1.5, 0.3e-3, 0.125, 1 / 0.764e-6

    def path(x, y, _sigma):
        return 2 * thickness * np.sqrt(index**2 - x**2 - y**2)

    def cone(x, y):
        return 1.0 - (x**2 + y**2) / edge**2

    common = {"clearances": [cone], "reach": 1.2 * edge, "sigma": np.array([sigma])}
    ghost, nominal = fit_field(beam(path=path, **common)), fit_field(beam(**common))

    def part(f):
        return quad(lambda s: f(2 * np.pi * sigma * path(edge * np.sqrt(s), 0.0, sigma)), 0, 1, epsabs=1e-12)[0]

    agree(overlap(ghost, nominal, np.array([sigma])), part(np.cos) + 1j * part(np.sin), 1e-5, np.array([sigma]))


@lru_cache
def gauss(count):
    return np.polynomial.legendre.leggauss(count)


def oracle(waves, amplitude, half_chord, left, right, count):
    """Cartesian Gauss quadrature between known chords: shares nothing with what it checks."""
    node, weight = gauss(count)
    angle = 0.5 * np.pi * (node + 1)  # x = mid - half cos(angle): the chord's square roots become smooth
    x = 0.5 * (left + right) - 0.5 * (right - left) * np.cos(angle)
    wx = 0.5 * np.pi * weight * 0.5 * (right - left) * np.sin(angle)
    low, high = half_chord(x)
    y = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * node
    w = wx[:, None] * 0.5 * (high - low)[:, None] * weight
    return np.sum(w * amplitude(x[:, None], y) * np.exp(2j * np.pi * waves(x[:, None], y)))


def test_defocus_with_astigmatism_and_coma_against_cartesian_quadrature():
    def waves(x, y):
        return 6.3 * (x**2 + y**2) + 3.1 * y**2 - 2.2 * y * (x**2 + y**2)

    def circle(x):
        half = np.sqrt(1 - x**2)
        return -half, half

    exact = oracle(waves, lambda x, y: 1.0 + 0 * y, circle, -1.0, 1.0, 240) / np.pi
    agree(overlap(fit_field(beam(waves)), FLAT, ONE), exact, 1e-6)


def test_rectangular_cuts_factorise():
    sides = [lambda x, y: 0.9 - x, lambda x, y: 0.8 + x, lambda x, y: 0.5 - y, lambda x, y: 0.6 + y]
    still, moved = (fit_field(beam(w, sides)) for w in (0.0, lambda x, y: 4 * x**2 - 3 * y))
    node, weight = np.polynomial.legendre.leggauss(100)
    along_x = weight @ np.exp(2j * np.pi * 4 * (0.05 + 0.85 * node) ** 2) / 2
    along_y = weight @ np.exp(-2j * np.pi * 3 * (-0.05 + 0.55 * node)) / 2
    agree(overlap(moved, still, ONE), along_x * along_y, 1e-6)


def random_case(seed):
    """Two circles of random radii, shear, aberration and amplitude slope; their fields and the exact overlap."""
    rng = np.random.default_rng(seed)
    r, d = rng.uniform(0.6, 1.4), rng.uniform(0.0, 1.0)
    c = rng.normal(size=7) * rng.choice([0.3, 2.0, 5.0])
    tilt = rng.uniform(-0.3, 0.3, 2)

    def waves(x, y):
        rr = x**2 + y**2
        return c[0] * x + c[1] * y + c[2] * rr + c[3] * x * y + c[4] * y * rr + c[5] * x**2 + 0.3 * c[6] * rr**2

    def amplitude(x, y):
        return 1.0 + tilt[0] * x + tilt[1] * y

    m = fit_field(beam(waves, [disc(r, d)], amplitude, centre=(d, 0.0), reach=1.2 * r))

    def chord(x):
        half = np.sqrt(np.maximum(0.0, np.minimum(1 - x**2, r**2 - (x - d) ** 2)))
        return -half, half

    left, right = max(-1.0, d - r), min(1.0, d + r)
    cross = 0.5 * (d * d + 1 - r * r) / d  # where the two circles meet, if they do
    cuts = [left, cross, right] if left < cross < right else [left, right]
    parts = [oracle(waves, amplitude, chord, a, b, 240) for a, b in itertools.pairwise(cuts)]
    power = np.pi * r * r * ((1 + tilt[0] * d) ** 2 + (tilt @ tilt) * r * r / 4)
    return m, sum(parts) / np.sqrt(np.pi * power)


def test_error_bound_holds_and_is_not_loose_over_random_cases():
    tightness = []
    for seed in range(100):
        m, exact = random_case(seed)
        result = overlap(m, FLAT, ONE, tol=1e-6)
        error = abs(contrast(result)[0] - exact)
        assert error <= result.error_bound[0] + 1e-12  # the oracle's own rounding
        tightness.append(result.error_bound[0])
        assert abs(result.value[0]) <= result.shared + result.error_bound[0] <= 1.0 + 1e-6
    assert max(tightness) < 2e-6  # no bound beyond what was asked for


def test_bound_covers_a_field_that_no_polynomial_fits():
    # a cusp in the path: the misfit, not the quadrature, limits the result, and the bound has to say so
    def cone(x, y):
        return 2.0 * np.sqrt(x**2 + y**2 + 1e-3)

    result = overlap(fit_field(beam(cone)), FLAT, ONE)
    exact = quad(lambda s: np.cos(4 * np.pi * np.sqrt(s + 1e-3)), 0, 1, limit=400)[0]
    exact += 1j * quad(lambda s: np.sin(4 * np.pi * np.sqrt(s + 1e-3)), 0, 1, limit=400)[0]
    error = abs(contrast(result)[0] - exact)
    assert 1e-6 < error <= result.error_bound[0]


def test_hermitian_and_bounded_by_shared_power():
    m, _ = random_case(7)
    one, other = overlap(m, FLAT, ONE), overlap(FLAT, m, ONE)
    np.testing.assert_allclose(one.value, other.value.conj(), atol=1e-12)
    np.testing.assert_allclose(one.opd_m, -other.opd_m, atol=1e-18)
    assert abs(one.value[0]) <= mutual_power_bound(m, FLAT)
    assert mutual_power_bound(m, FLAT) == pytest.approx(one.shared, rel=0.02)


def test_constant_phase_of_the_paths_is_in_the_value():
    turned = overlap(fit_field(beam(phase=0.7)), fit_field(beam(phase=0.2)), ONE)
    np.testing.assert_allclose(turned.value, np.exp(0.5j), atol=1e-12)


def test_slope_is_the_difference_of_the_directions():
    # opl_m - opl_l with d(opl)/dy = direction: uniform slopes 3e-3 and 1e-3
    m = fit_field(beam(0.4, direction=lambda x, y: 3e-3 + 0 * x, space="pupil"))
    l = fit_field(beam(0.0, direction=lambda x, y: 1e-3 + 0 * x, space="pupil"))  # noqa: E741
    result = overlap(m, l, ONE)
    assert result.slope_weighted and result.slope == pytest.approx(2e-3, rel=1e-12)
    # an extinguished pair falls back on the plain mean
    dark = fit_field(beam(lambda x, y: x**2 + y**2, direction=lambda x, y: 3e-3 + 0 * x, space="pupil"))
    result = overlap(dark, l, ONE)
    assert not result.slope_weighted and result.slope == pytest.approx(2e-3, rel=1e-12)


def test_spectrum_is_resolved_where_the_pair_spans_many_cycles():
    # 137.3 waves of defocus over a 5 % band: about 7 cycles of path difference between the band's ends
    nodes_at = np.array([0.975, 1.0, 1.025]) * SIGMA
    low, high = nodes_at[0], nodes_at[-1]

    def path(x, y, _sigma):
        return 137.3e-6 * (x**2 + y**2)

    m, l = fit_field(beam(path=path, sigma=nodes_at)), fit_field(beam(sigma=nodes_at))  # noqa: E741
    sigma, result = overlap_spectrum(m, l, low, high, 1e-5)
    k = 2j * np.pi * sigma * 137.3e-6
    agree(result, (np.exp(k) - 1) / k, 1e-4, sigma)
    # between the nodes: the polynomial through them, against the closed form
    test = np.linspace(low, high, 37)
    value = np.polynomial.chebyshev.Chebyshev(
        np.polynomial.chebyshev.chebfit((sigma - sigma.mean()) / (0.5 * (high - low)), result.value, sigma.size - 1),
        domain=[-1, 1],
    )((test - 0.5 * (low + high)) / (0.5 * (high - low)))
    pivot = np.polynomial.polynomial.polyval(test, np.polynomial.polynomial.polyfit(sigma, result.opd_m, 2))
    k = 2j * np.pi * test * 137.3e-6
    assert np.abs(value * np.exp(2j * np.pi * test * pivot) - (np.exp(k) - 1) / k).max() <= result.error_bound.max()


def test_dispersion_is_interpolated_between_the_traced_wavenumbers():
    nodes = np.array([0.9, 1.0, 1.1]) * SIGMA

    def path(x, y, sigma):
        return 3e-6 * (sigma / SIGMA) ** 2 * (x**2 + y**2)

    m, l = fit_field(beam(path=path, sigma=nodes)), fit_field(beam(sigma=nodes))  # noqa: E741
    sigma = np.array([0.93, 1.07]) * SIGMA
    k = 2j * np.pi * 3.0 * (sigma / SIGMA) ** 3
    agree(overlap(m, l, sigma), (np.exp(k) - 1) / k, 1e-6, sigma)


def test_beyond_the_node_cap_the_boundary_still_answers():
    # exp(i 2π a (x + y²)) over the disc: along x in closed form, along y by a fine rule
    a = 4000.0
    found = overlap(fit_field(beam(lambda x, y: a * (x + y**2))), FLAT, ONE)
    s, w = np.polynomial.legendre.leggauss(16)
    edges = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 8001)
    t = 0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * s
    chord, height = np.cos(t), np.sin(t)
    inner = np.exp(2j * np.pi * a * height**2) * np.sin(2 * np.pi * a * chord) / (np.pi * a)
    agree(found, (inner * chord * w * 0.5 * np.diff(edges)[:, None]).sum() / np.pi, 1e-6)


def test_both_methods_agree_on_amplitude_slope_and_cut_pupils():
    stops = [disc(), hole(0.3, 0.1), lambda x, y: 0.6 - x + 0.2 * y]
    m = fit_field(beam(lambda x, y: 31.3 * (x**2 + y**2) + 3 * x * y * y, stops, lambda x, y: 1 + 0.2 * x - 0.1 * y))
    l = fit_field(beam(direction=lambda x, y: 0.3 * x + y))  # noqa: E741
    one, other = overlap(m, l, ONE, 1e-8, "panels"), overlap(m, l, ONE, 1e-8, "boundary")
    assert abs(one.value - other.value) <= one.error_bound + other.error_bound
    assert other.error_bound < 2e-6
    assert other.slope == pytest.approx(one.slope, rel=1e-6)
    assert other.shared == pytest.approx(one.shared, rel=1e-6)


@pytest.mark.parametrize("gap", [1e-10, 1e-9, 1e-8, 1e-6, 1e-4])
@pytest.mark.parametrize("side", ["inside", "outside"])
def test_slivers_between_circles_that_nearly_touch_are_found_or_bounded(gap, side):
    """Panels against boundary integrals over exact circles: the obscuration of one pupil about the rim of the other.

    The circles cross by ``gap``, twice within an angle of its square root, where no ray of an even scan may fall; or
    miss each other by as much.
    """
    e = 0.3
    for sign in (1.0, -1.0):
        shift = (1.0 - e if side == "inside" else 1.0 + e) + sign * gap
        pair = hopkins.HopkinsPair(
            1.25, 0.075, -0.05, 0.1, obscuration=e, shift_x=shift * np.cos(0.3), shift_y=shift * np.sin(0.3)
        )
        exact = hopkins.contrast(pair, tol=1e-12)
        found = overlap(*pair.pupil_fields(), np.array([1.0]), 1e-8, "panels")
        value = found.value[0] * np.exp(2j * np.pi * found.opd_m[0])
        assert abs(value - exact.value) <= found.error_bound[0] + exact.error_bound
        assert found.error_bound[0] < 1e-11


def test_refusals_name_limit_and_factor():
    steep = fit_field(beam(lambda x, y: 4000.0 * (x + y**2)))
    with pytest.raises(MethodLimitError, match="waves") as info:
        overlap(steep, FLAT, ONE, method="panels")
    assert info.value.factor > 1.0
    with pytest.raises(InputError, match="method"):
        overlap(FLAT, FLAT, ONE, method="guess")
    with pytest.raises(MethodLimitError, match="traced for"):
        overlap(FLAT, FLAT, 1.2 * ONE)
    with pytest.raises(InputError, match="reference_point"):
        overlap(FLAT, fit_field(beam(space="pupil")), ONE)
