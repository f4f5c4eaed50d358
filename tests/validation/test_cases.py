"""The cases of the study are what their names say."""

import math

import numpy as np
import pytest

from validation import cases


def slopes(case, x, y, step=1e-4):
    """Gradient and Hessian of W in units of its largest coefficient, by differences that are exact for quartics."""

    def w(x, y):
        rr = x * x + y * y
        c = case
        return rr * (c.w020 + c.w040 * rr + c.w131 * y) + y * (c.w222 * y + c.w111)

    scale = max(abs(v) for v in (case.w020, case.w040, case.w131, case.w222, case.w111))
    h = step**0.5
    gx = (8 * (w(x + h, y) - w(x - h, y)) - (w(x + 2 * h, y) - w(x - 2 * h, y))) / (12 * h)
    gy = (8 * (w(x, y + h) - w(x, y - h)) - (w(x, y + 2 * h) - w(x, y - 2 * h))) / (12 * h)
    hyy = (16 * (w(x, y + h) + w(x, y - h)) - (w(x, y + 2 * h) + w(x, y - 2 * h)) - 30 * w(x, y)) / (12 * h * h)
    return math.hypot(gx, gy) / scale, hyy / scale


def test_random_cases_do_not_depend_on_their_number():
    assert cases.random_cases(300, 4)[:20] == cases.random_cases(20, 4)
    assert cases.random_cases(20, 4) != cases.random_cases(20, 5)


def test_random_cases_cover_what_they_declare():
    found = cases.random_cases(4000, 1)
    w = np.array([c.w020 for c in found])
    shear = np.array([math.hypot(c.shift_x, c.shift_y) for c in found])
    steep = [abs(c.w020) + 2 * abs(c.w040) + 1.5 * abs(c.w131) + abs(c.w222) + abs(c.w111) for c in found]
    assert np.mean(w == 0) == pytest.approx(cases.NO_DEFOCUS, abs=0.015)
    assert np.abs(w).max() > 4000 and (w > 0).any() and (w < 0).any()
    assert max(steep) <= cases.STEEPEST * (1 + 1e-12)
    assert np.mean(shear == 0) == pytest.approx(cases.CENTRED, abs=0.02)
    assert (shear >= 2).any() and ((shear > 0) & (shear < 1e-6)).any()
    assert np.mean([c.obscuration > 0 for c in found]) == pytest.approx(cases.OBSCURED, abs=0.03)


def test_adversarial_stationary_points_are_where_they_should_be():
    found = {c.kind: c for c in cases.adversarial_cases(11.0) if c.w020 in (1.25, 0.0)}
    for kind, at in [
        ("stationary point, outer edge of m, 0 off", (0.0, 1.0)),
        ("stationary point, outer edge of l, 0 off", (0.0, 0.7)),
        ("stationary point, both obscurations: a corner, 0 off", (0.0, 0.4)),
        ("stationary point, outer edge of m on the obscuration of l: a corner, 0 off", (0.0, 1.0)),
    ]:
        c = found[kind]
        assert slopes(c, *at)[0] < 1e-9
        of_m, of_l = math.hypot(*at), math.hypot(at[0] + c.shift_x, at[1] + c.shift_y)
        edges = [abs(of_m - 1.0), abs(of_m - c.obscuration), abs(of_l - 1.0), abs(of_l - c.obscuration)]
        assert sum(edge < 1e-12 for edge in edges) == (2 if "corner" in kind else 1)


@pytest.mark.parametrize("made", [cases._fold(3.0, 0.4), cases._cusp(-2.0, -0.5, 0.6)])
def test_folds_and_cusps_are_degenerate(made):
    y0 = 0.4 if "w040" not in made else -0.5
    gradient, bend = slopes(cases.Case("", **made), 0.0, y0)
    assert gradient < 1e-9 and abs(bend) < 1e-9


def test_rings_are_stationary():
    case = cases.Case("", **cases._ring(5.0, 0.7))
    for angle in (0.0, 1.0, 4.0):
        assert slopes(case, 0.7 * math.cos(angle), 0.7 * math.sin(angle))[0] < 1e-9


def test_caustics_for_timing_hold_their_point_inside():
    for case in cases.caustic_cases(40, 1000.0, 2):
        assert math.hypot(case.shift_x, case.shift_y) < 1.0
        if case.kind == "caustic ring":
            continue
        at = 0.0
        if case.kind == "caustic fold":
            at = -case.w020 / (3.0 * case.w131)
        elif case.kind == "caustic cusp":
            at = -case.w131 / (4.0 * case.w040)
        gradient, bend = slopes(case, 0.0, at)
        assert gradient < 1e-8 and abs(bend) < 1e-8
        assert case.obscuration <= abs(at) < 1.0
        assert case.obscuration < math.hypot(case.shift_x, at + case.shift_y) < 1.0
