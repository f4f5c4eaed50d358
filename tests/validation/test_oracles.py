"""The two slow oracles of the overlap contrast against closed forms, a third computation, and each other."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import fresnel, j1

from validation.oracles import polar, strips

ORACLES = pytest.mark.parametrize("oracle", [strips.contrast, polar.contrast], ids=["strips", "polar"])
GOAL = 1e-11


def lens(r, s, d):
    """Area that discs of radii r and s share when their centres are d apart."""
    if d >= r + s:
        return 0.0
    if d <= abs(r - s):
        return math.pi * min(r, s) ** 2
    half = math.sqrt((r + s - d) * (d + r - s) * (d - r + s) * (d + r + s)) / (2 * d)  # of the common chord
    along = (d * d + (r - s) * (r + s)) / (2 * d)
    at_r, at_s = math.atan2(half, along), math.atan2(half, d - along)
    return r * r * (at_r - 0.5 * math.sin(2 * at_r)) + s * s * (at_s - 0.5 * math.sin(2 * at_s))


@ORACLES
@pytest.mark.parametrize("e", [0.0, 0.37, 0.95])
@pytest.mark.parametrize("w020", [0.0, 0.05, -1.25, 10.5, 137.3])
def test_defocus_alone(oracle, w020, e):
    value, error, _ = oracle(w020=w020, obscuration=e)
    closed = np.exp(1j * math.pi * w020 * (1 + e * e)) * np.sinc(w020 * (1 - e * e))
    assert abs(value - closed) <= error <= GOAL * 10
    assert abs(value - closed) <= 1e-13


@ORACLES
@pytest.mark.parametrize("e", [0.0, 0.1, 1 / 3, 0.95, 0.999])
@pytest.mark.parametrize("shift", [0.0, 1e-13, 1e-6, 0.3, "1-e", "1+e", "2e", 1.99, 2 - 1e-9])
@pytest.mark.parametrize("angle", [0.0, math.pi / 2, -2.3])
def test_no_aberration_leaves_the_shared_area(oracle, e, shift, angle):
    s = {"1-e": 1 - e, "1+e": 1 + e, "2e": 2 * e}.get(shift, shift)
    value, error, _ = oracle(obscuration=e, shift_x=s * math.cos(angle), shift_y=s * math.sin(angle))
    area = lens(1, 1, s) - 2 * lens(1, e, s) + lens(e, e, s)
    # the closed form itself loses some 2e-15 where its terms cancel
    assert abs(value - area / (math.pi * (1 - e * e))) <= error + 2e-15 / (1 - e * e)
    assert error < 1e-12


@ORACLES
@pytest.mark.parametrize("shift", [(2.0, 0.0), (0.0, -2.0), (1.5, 1.5), (0.0, 3.0)])
def test_pupils_apart_share_nothing(oracle, shift):
    assert oracle(w020=3.0, shift_x=shift[0], shift_y=shift[1])[:2] == (0j, 0.0)


@ORACLES
@pytest.mark.parametrize("e", [0.0, 0.6])
@pytest.mark.parametrize("tilt", [0.3, -4.0, 55.5])
def test_tilt_alone_is_the_airy_amplitude(oracle, tilt, e):
    value, _, _ = oracle(w111=tilt, obscuration=e)
    v = 2 * math.pi * tilt
    closed = 2 * (j1(v) - (e * j1(e * v) if e else 0.0)) / (v * (1 - e * e))
    assert value == pytest.approx(closed, abs=1e-14)


@ORACLES
@pytest.mark.parametrize("s, e", [(0.4, 0.0), (1.3, 0.0), (0.4, 0.35), (1.0, 0.5), (1e-6, 0.5), (0.7, 0.3)])
def test_sheared_defocus_is_an_integral_over_the_radius(oracle, s, e):
    """At radius ρ from beam m's centre a known share of the circle lies inside beam l."""

    def inside(rho, r):
        return 2 * math.acos(min(1.0, max(-1.0, (rho * rho + (s - r) * (s + r)) / (2 * rho * s)))) if r else 0.0

    w020 = 2.3
    breaks = sorted({e, 1.0, *(r for r in (abs(1 - s), 1 + s, abs(e - s), e + s) if e < r < 1)})

    def part(wave):
        total = 0.0
        for a, b in itertools.pairwise(breaks):
            # ρ = a + (b − a) sin²t: the angle's square roots at the ends become smooth
            def f(t, a=a, b=b):
                rho = a + (b - a) * math.sin(t) ** 2
                jacobian = (b - a) * math.sin(2 * t)
                return rho * (inside(rho, 1.0) - inside(rho, e)) * wave(2 * math.pi * w020 * rho * rho) * jacobian

            total += quad(f, 0.0, math.pi / 2, epsabs=1e-13, epsrel=1e-13, limit=200)[0]
        return total / (math.pi * (1 - e * e))

    expected = complex(part(math.cos), part(math.sin))
    for angle in (0.0, 1.1, -math.pi / 2):
        value, error, _ = oracle(w020=w020, obscuration=e, shift_x=s * math.cos(angle), shift_y=s * math.sin(angle))
        assert abs(value - expected) <= error + 1e-12
        assert error < GOAL * 10


def by_fresnel(w020, w131, w222, w111, shift_x, shift_y):
    """A third way where W040 = 0 and no pupil is obscured: chords in closed form, lines of y by plain refinement."""

    def chord(y):
        half_m, half_l = math.sqrt(max(1 - y * y, 0.0)), math.sqrt(max(1 - (y + shift_y) ** 2, 0.0))
        a, b = max(-half_m, -shift_x - half_l), min(half_m, -shift_x + half_l)
        if a >= b:
            return 0j
        k = w020 + w131 * y
        scale = 2 * math.sqrt(abs(k))
        (s0, c0), (s1, c1) = fresnel(scale * a), fresnel(scale * b)
        across = complex(c1 - c0, math.copysign(1.0, k) * (s1 - s0)) / scale if k else complex(b - a)
        return across * np.exp(2j * math.pi * y * (y * (w020 + w222 + w131 * y) + w111))

    lo, hi = max(-1.0, -shift_y - 1), min(1.0, -shift_y + 1)
    d = math.hypot(shift_x, shift_y)
    across = math.sqrt(1 - d * d / 4) / d
    marks = [lo, hi, -shift_y / 2 + across * shift_x, -shift_y / 2 - across * shift_x]
    marks = sorted(y for y in [*marks, -1.0, 1.0, -shift_y - 1, -shift_y + 1] if lo <= y <= hi)
    total = 0j
    for a, b in itertools.pairwise(marks):
        for pick in (np.real, np.imag):

            def f(t, a=a, b=b, pick=pick):
                return float(pick(chord(a + (b - a) * math.sin(t) ** 2))) * (b - a) * math.sin(2 * t)

            value = quad(f, 0.0, math.pi / 2, epsabs=1e-13, epsrel=1e-13, limit=400)[0]
            total += value if pick is np.real else 1j * value
    return total / math.pi


@ORACLES
@pytest.mark.parametrize("seed", range(6))
def test_chords_by_fresnel_integrals(oracle, seed):
    rng = np.random.default_rng(seed)
    c = dict(zip(("w020", "w131", "w222", "w111"), rng.uniform(-4, 4, 4), strict=True))
    d, angle = rng.uniform(0.05, 1.8), rng.uniform(0, 2 * math.pi)
    shift = {"shift_x": d * math.cos(angle), "shift_y": d * math.sin(angle)}
    value, error, _ = oracle(**c, **shift)
    assert abs(value - by_fresnel(**c, **shift)) <= error + 1e-12


def awkward(rng):
    """A pair with circles that touch, nearly touch, nearly coincide or meet near their tops."""
    e = rng.choice([0.0, 0.1, 1 / 3, 0.95, rng.uniform(0, 0.95)])
    near = rng.choice([0.0, 1e-9, -1e-9, 1e-5])
    s = rng.choice([1e-6, 1e-3, 1 - e + near, 1 + e - abs(near), 2 * e + near, e + near, 1.99, 1 + near])
    angle = rng.choice([0.0, math.pi / 2, -math.pi / 2, math.pi, math.pi / 4, 1e-9, rng.uniform(0, 7)])
    w = 10 ** rng.uniform(-1, 1.5) * rng.choice([-1, 0, 1], p=[0.45, 0.1, 0.45])
    others = max(abs(w), 1) * rng.choice([0, 0.1, 1], 4) * rng.uniform(-1, 1, 4)
    return {
        "w020": w, "w040": others[0], "w131": others[1], "w222": others[2], "w111": others[3],
        "obscuration": e, "shift_x": s * math.cos(angle), "shift_y": s * math.sin(angle),
    }  # fmt: skip


def smooth(rng):
    d, angle, w = rng.uniform(0, 2), rng.uniform(0, 7), 10 ** rng.uniform(-1, 1.7)
    others = w * rng.uniform(-1, 1, 4)
    return {
        "w020": w, "w040": others[0], "w131": others[1], "w222": others[2], "w111": others[3],
        "obscuration": rng.uniform(0, 0.9), "shift_x": d * math.cos(angle), "shift_y": d * math.sin(angle),
    }  # fmt: skip


@pytest.mark.parametrize("draw", [awkward, smooth])
def test_the_two_agree(draw):
    rng = np.random.default_rng(11)
    for _ in range(150):
        case = draw(rng)
        (a, error_a, _), (b, error_b, _) = strips.contrast(**case), polar.contrast(**case)
        assert abs(a - b) <= min(error_a + error_b, GOAL), case
        assert max(error_a, error_b) < 1e-9, case
