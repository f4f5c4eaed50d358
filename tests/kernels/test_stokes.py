"""Boundary integrals by steepest descent: closed forms, geometry, and the same integrals by area quadrature."""

import math

import numpy as np
import pytest
from scipy.special import erfc, j1

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.kernels import stokes
from cgi_wave.kernels.circles import circle_region
from cgi_wave.kernels.descent import GAUSS, descent
from cgi_wave.kernels.polynomials import affine, bernstein, bernstein_matrix
from cgi_wave.wave.hopkins import HopkinsPair, contrast
from cgi_wave.wave.overlap import overlap
from cgi_wave.wave.stokes import BOUNDARY_METHOD, boundary_integral

NONE, ONE = np.empty((0, 0)), np.ones((1, 1))


def circles(*rings):
    """Panels of the region inside the discs and outside the holes: (x, y, radius, sign)."""
    panels = np.empty((128, 2, GAUSS))
    used = circle_region(np.array([r[:3] for r in rings], float), np.array([r[3] for r in rings], float), panels)
    return panels[:used]


def by_area(pair, tol=1e-10):
    """γ by Gauss panels over the area: code and idea that boundary integrals do not share."""
    found = overlap(*pair.pupil_fields(), np.array([1.0]), tol, "panels")
    return found.value[0] * np.exp(2j * np.pi * found.opd_m[0]), found.error_bound[0]


def agrees(pair, tol=1e-9):
    found, (exact, error) = contrast(pair, tol), by_area(pair)
    assert abs(found.value - exact) <= found.error_bound + error
    assert found.error_bound <= tol
    assert error <= 1e-9


@pytest.mark.parametrize("w020", [0.0, 0.3, 1.25, 4.0, 10.25, -137.3, 1000.25, 5000.25])
@pytest.mark.parametrize("obscuration", [0.0, 0.4])
def test_defocus_is_a_complex_sinc(w020, obscuration):
    # s = rho²: gamma = integral of exp(i 2π W s) over s in (e², 1), over its length
    inner, ends = obscuration**2, np.exp(2j * np.pi * w020)
    exact = (ends - np.exp(2j * np.pi * w020 * inner)) / (2j * np.pi * w020 * (1 - inner)) if w020 else 1.0
    found = contrast(HopkinsPair(w020=w020, obscuration=obscuration), 1e-10)
    assert abs(found.value - exact) <= found.error_bound <= 1e-10


@pytest.mark.parametrize("w111", [0.2, 1.7, 8.3, 77.7, 1234.5])
def test_tilt_is_the_airy_amplitude(w111):
    found = contrast(HopkinsPair(w111=w111), 1e-10)
    z = 2 * np.pi * w111
    assert abs(found.value - 2 * j1(z) / z) <= found.error_bound <= 1e-10


def lens(r, s, d):
    """Area common to discs of radii r and s whose centres are d apart."""
    if d >= r + s:
        return 0.0
    if d <= abs(r - s):
        return math.pi * min(r, s) ** 2
    a = math.acos((d * d + (r - s) * (r + s)) / (2 * d * r))
    b = math.acos((d * d + (s - r) * (s + r)) / (2 * d * s))
    return r * r * (a - math.sin(2 * a) / 2) + s * s * (b - math.sin(2 * b) / 2)


@pytest.mark.parametrize("shift", [0.0, 1e-6, 0.2, 0.61, 1.0, 1.4, 1.6, 1.99, 2.0])
@pytest.mark.parametrize("e", [0.0, 0.3, 0.6])
def test_no_aberration_gives_the_common_area(shift, e):
    # discs minus holes by inclusion and exclusion; the holes overlap as a lens of their own
    area = lens(1, 1, shift) - 2 * lens(1, e, shift) + lens(e, e, shift) if e else lens(1, 1, shift)
    found = contrast(HopkinsPair(obscuration=e, shift_x=0.6 * shift, shift_y=0.8 * shift), 1e-10)
    assert found.value.real == pytest.approx(area / (math.pi * (1 - e * e)), abs=1e-12)
    assert abs(found.value.imag) < 1e-13


def random_pairs(count, seed, others):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        w = 10 ** rng.uniform(-0.5, 1.7) * rng.choice([-1, 1])
        rest = others * abs(w) * rng.uniform(-1, 1, 4)
        e, shear, angle = rng.choice([0.0, rng.uniform(0.05, 0.8)]), rng.uniform(0, 1.5), rng.uniform(0, 2 * np.pi)
        yield HopkinsPair(w, *rest, e, shear * np.cos(angle), shear * np.sin(angle))


@pytest.mark.parametrize("others", [0.1, 1.0])
def test_random_pairs_as_by_area(others):
    for pair in random_pairs(25, 5, others):
        agrees(pair)


W = 40.0
HARD = {
    "saddle": HopkinsPair(w020=W, w222=-2 * W, shift_x=0.3),
    "line of stationary points": HopkinsPair(w020=W, w222=-W, shift_y=0.2, obscuration=0.3),
    "nearly a line": HopkinsPair(w020=W, w222=-W * (1 + 1e-4), shift_x=0.1),
    "ring of stationary points": HopkinsPair(w020=-W, w040=0.8 * W),
    "ring, sheared": HopkinsPair(w020=-W, w040=0.8 * W, shift_x=0.37, obscuration=0.2),
    "ring at the edge": HopkinsPair(w020=-2 * W, w040=W, shift_x=0.05),
    "flat centre": HopkinsPair(w040=W, shift_x=0.2, shift_y=0.1),
    "umbilic": HopkinsPair(w131=W, shift_x=-0.2, shift_y=0.3),
    "fold": HopkinsPair(w020=W / 3, w131=-W / 3, w111=W / 9 * 0.7),
    "stationary point on the edge": HopkinsPair(w020=W, shift_x=1.0),
    "stationary point on the obscuration": HopkinsPair(w020=W, shift_x=0.4, obscuration=0.4),
    "stationary point near the edge": HopkinsPair(w020=W, shift_x=0.6, shift_y=0.8001),
    "small lens": HopkinsPair(w020=W, w131=5.0, shift_x=1.99),
    "tiny shear": HopkinsPair(w020=W, shift_y=1e-3, obscuration=0.5),
    "circles that touch": HopkinsPair(w020=W, shift_x=0.7, obscuration=0.3),
    "holes that touch": HopkinsPair(w020=W, shift_x=0.6, obscuration=0.3),
    "circles that nearly touch": HopkinsPair(w020=W, shift_x=0.7 + 1e-9, obscuration=0.3),
}


@pytest.mark.parametrize("name", HARD)
def test_where_methods_like_to_fail(name):
    agrees(HARD[name], 1e-8)


def test_steepest_descent_is_the_complementary_error_function():
    # -∫_x^∞ exp(i 2π W t²) dt = -√π/(2a) erfc(a x), a = √(-2πi W)
    w, ws = 9.0, np.zeros((21, 64))
    line, one = np.array([0.0, 0.0, w, 0.0]), np.array([1.0, 0.0])
    a = np.sqrt(-2j * np.pi * w)
    for x in (0.7, 0.9, 1.3, -0.8):
        value, _, ok = descent(line, one, one, np.empty(0), x, ws)
        side = 1.0 if x > 0 else -1.0
        exact = -side * np.sqrt(np.pi) / (2 * a) * erfc(a * abs(x)) * np.exp(-2j * np.pi * w * x * x)
        assert ok
        assert abs(value - exact) <= 1e-12 * abs(exact)


def test_too_near_a_saddle_steepest_descent_says_so():
    line, one = np.array([0.0, 0.0, 9.0, 0.0]), np.array([1.0, 0.0])
    assert not descent(line, one, one, np.empty(0), 0.2, np.zeros((21, 64)))[2]


def test_amplitudes_and_a_further_factor():
    # rectangle [-1, 1] x [-0.5, 0.5]: everything factorises into one-dimensional integrals
    def edge(x0, y0, x1, y1):
        out = np.zeros((2, GAUSS))
        out[:, 0], out[:, 1] = (0.5 * (x0 + x1), 0.5 * (y0 + y1)), (0.5 * (x1 - x0), 0.5 * (y1 - y0))
        return out

    corners = [(-1, -0.5), (1, -0.5), (1, 0.5), (-1, 0.5)]
    curves = np.array([edge(*corners[i], *corners[(i + 1) % 4]) for i in range(4)])
    phase, a, b, factor = np.zeros((4, 4)), np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2))
    phase[2, 0], phase[0, 2], phase[1, 0], phase[3, 0] = 30.0, 17.0, 4.0, 2.0
    a[0, 0], a[1, 0], b[0, 0], b[0, 1], factor[1, 0], factor[0, 1] = 1.0, 0.3, 1.0, -0.5, 1.0, 2.0
    found = boundary_integral(curves, phase, a, b, factor, 1e-9)
    t, w = np.polynomial.legendre.leggauss(600)
    fx = np.exp(2j * np.pi * (30 * t**2 + 4 * t + 2 * t**3)) * (1 + 0.3 * t) * w
    y = 0.5 * t
    fy = np.exp(2j * np.pi * 17 * y**2) * (1 - 0.5 * y) * 0.5 * w
    assert abs(found.value - fx.sum() * fy.sum()) <= found.error
    further = (fx * t).sum() * fy.sum() + 2 * fx.sum() * (fy * y).sum()
    assert found.weighted == pytest.approx(further, abs=1e-8)


@pytest.mark.parametrize("waves", [3.0, 12.0, 300.0])
def test_a_phase_of_higher_degree_takes_the_general_loops_to_the_same_value(waves):
    # phases of degree four have loops of their own; zeros beyond turn to those for all degrees
    pair = HopkinsPair(waves, 0.1 * waves, -0.07 * waves, 0.05 * waves, shift_x=0.3, shift_y=-0.2, obscuration=0.3)
    curves = circles((0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 0.3, -1.0), (0.3, -0.2, 1.0, 1.0), (0.3, -0.2, 0.3, -1.0))
    centred = affine(pair.powers(), -0.3, 0.2, 1.0, 0.0, 0.0, 1.0)
    longer = np.zeros((7, 7))
    longer[: len(centred), : len(centred)] = centred
    few, many = (boundary_integral(curves, phase, ONE, ONE, NONE, 1e-10) for phase in (centred, longer))
    assert abs(few.value - many.value) <= min(few.error, many.error)


def test_cutting_a_region_keeps_its_area():
    region = circles((0, 0, 1, 1), (0.3, 0.1, 1, 1), (0, 0, 0.3, -1))

    def area(panels):
        # ∮ x dy, a Gauss rule per panel is exact for these series to rounding
        s, w = np.polynomial.legendre.leggauss(30)
        x = np.polynomial.polynomial.polyval(s, panels[:, 0].T)
        dy = np.polynomial.polynomial.polyval(s, np.polynomial.polynomial.polyder(panels[:, 1].T))
        return float((x * dy * w).sum())

    for axis in (0, 1):
        low, high, ok = stokes._split(region, axis, 0.1234)
        assert ok
        assert area(low) + area(high) == pytest.approx(area(region), abs=1e-13)
        assert 0.1 < area(low) < area(region) - 0.1


def test_affine_substitution_and_bernstein_bounds():
    rng = np.random.default_rng(2)
    n = 7
    coef = np.where(np.add.outer(np.arange(n), np.arange(n)) < n, rng.normal(size=(n, n)), 0.0)
    moved = affine(coef, 0.2, -0.4, 0.7, -0.3, 0.5, 0.6)
    u, v = rng.uniform(-1, 1, (2, 40))
    x, y = 0.2 + 0.7 * u - 0.3 * v, -0.4 + 0.5 * u + 0.6 * v
    value = np.polynomial.polynomial.polyval2d(x, y, coef)
    assert np.polynomial.polynomial.polyval2d(u, v, moved) == pytest.approx(value, abs=1e-12)
    low, high = bernstein(moved, 1.0, 1.0, bernstein_matrix(n))
    assert low <= value.min()
    assert high >= value.max()
    assert high - low < 6 * np.ptp(value)


def test_pupils_apart_give_exactly_zero():
    found = contrast(HopkinsPair(w020=3.0, shift_x=1.2, shift_y=1.7))
    assert found.value == 0
    assert found.error_bound == 0


def test_contrast_falls_back_on_no_silent_promise():
    with pytest.raises(InputError, match="tol"):
        contrast(HopkinsPair(w020=1.0), 1e-16)
    with pytest.raises(MethodLimitError, match="error bound"):
        contrast(HopkinsPair(w020=0.7, w131=0.5, shift_x=0.3), 1e-14)


def test_exchange_of_the_beams_is_the_complex_conjugate_of_the_mirrored_pair():
    # substituting x -> -x + shift: γ(m, l) with W even about beam m equals its own mirror image
    pair = HopkinsPair(w020=50.3, w040=3.0, obscuration=0.25, shift_x=0.4, shift_y=0.1)
    mirror = HopkinsPair(w020=50.3, w040=3.0, obscuration=0.25, shift_x=-0.4, shift_y=-0.1)
    negative = HopkinsPair(w020=-50.3, w040=-3.0, obscuration=0.25, shift_x=0.4, shift_y=0.1)
    a, b, c = (contrast(p, 1e-10) for p in (pair, mirror, negative))
    assert abs(a.value - b.value) <= a.error_bound + b.error_bound
    assert abs(a.value - np.conj(c.value)) <= a.error_bound + c.error_bound


def test_method_name():
    assert contrast(HopkinsPair(w020=20.0)).method == BOUNDARY_METHOD
