"""Lots of the Monte-Carlo walk: streams of random numbers, and scattering against Harvey's closed forms."""

import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.stats import kstest

from cgi_wave.kernels.walk import _seed, _uniform, lobe, lobe_reach, scattered

NORMAL = np.array([0.0, 0.6, 0.8])


def stream(seed, number, count):
    random, out = np.zeros(2, np.uint64), np.empty(count)
    _seed(random, seed, number)
    for k in range(count):
        out[k] = _uniform(random)
    return out


def scatter_many(sine, width, slope, count=20_000):
    """Offsets from the specular direction (N, 2), in direction cosines along and across the plane of incidence, NaN
    where nothing is scattered, and shares (N,), at an incidence of the given sine."""
    along = np.array([0.0, 0.8, -0.6])
    across = np.cross(NORMAL, along)
    ray = sine * along + np.sqrt(1 - sine**2) * NORMAL
    random, out = np.zeros(2, np.uint64), np.empty(3)
    _seed(random, 3, 7)
    offset, share = np.full((count, 2), np.nan), np.empty(count)
    for k in range(count):
        share[k] = scattered(random, ray, NORMAL, 0.1, width, slope, out)
        if share[k] > 0:
            assert out @ out == pytest.approx(1.0, abs=1e-14) and out @ NORMAL > 0
            offset[k] = (out - ray) @ along, (out - ray) @ across
    return offset, share


def test_streams_are_even_and_unlike_each_other():
    one, other, reseeded = stream(1, 0, 20_000), stream(1, 1, 20_000), stream(2, 0, 20_000)
    for numbers in (one, other, reseeded):
        assert kstest(numbers, "uniform").pvalue > 1e-3
        assert abs(np.corrcoef(numbers[1:], numbers[:-1])[0, 1]) < 4 / np.sqrt(20_000)
    for pair in ((one, other), (one, reseeded)):
        assert abs(np.corrcoef(*pair)[0, 1]) < 4 / np.sqrt(20_000)
    firsts = np.array([stream(5, number, 1)[0] for number in range(5000)])
    assert kstest(firsts, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("slope", [-1.5, -2.0, -2.7, 0.0])
def test_lobe_is_harveys_integral_and_has_an_inverse(slope):
    width = 0.01

    def harvey(b):
        return b * (1 + (b / width) ** 2) ** (slope / 2)

    for reach in (1e-3, 0.1, 1.7):
        value = quad(harvey, 0, min(reach, 0.05))[0] + (quad(harvey, 0.05, reach)[0] if reach > 0.05 else 0.0)
        assert lobe(reach, width, slope) * width**2 / 2 == pytest.approx(value, rel=1e-9)
        assert lobe_reach(lobe(reach, width, slope), width, slope) == pytest.approx(reach, rel=1e-12)


def test_total_scatter_is_the_published_closed_form():
    """TIS = 2π b0/(S + 2) L^−S [(1 + L²)^((S+2)/2) − L^(S+2)]; 50 Å at 0.5 µm: TIS 0.015791 and b0 = 1.3962."""
    width, slope, b0 = 0.01, -1.5, 1.3962
    tis = 2 * np.pi * b0 / (slope + 2) * width**-slope * ((1 + width**2) ** (slope / 2 + 1) - width ** (slope + 2))
    assert np.pi * b0 * width**2 * lobe(1.0, width, slope) == pytest.approx(tis, rel=1e-12)
    assert tis == pytest.approx((4 * np.pi * 5e-9 / 0.5e-6) ** 2, rel=1e-4)


@pytest.mark.parametrize("slope", [-1.5, -2.0])
def test_sampled_angles_follow_the_closed_form(slope):
    """At normal incidence the share inside a circle is lobe(b)/lobe(1), even over azimuth."""
    width = 0.05
    offset, share = scatter_many(0.0, width, slope)
    assert np.all(share == 0.1)
    reach = np.hypot(*offset.T)
    assert kstest(reach, lambda b: lobe_many(b, width, slope) / lobe(1.0, width, slope)).pvalue > 1e-3
    assert kstest(np.arctan2(*offset.T), "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-3


def lobe_many(reach, width, slope):
    return np.array([lobe(b, width, slope) for b in reach])


def test_oblique_light_scatters_what_the_lobe_holds_inside_the_unit_circle():
    """Expected share at 60°: ∫ of the lobe over |β| < 1; its mean offset leans back towards the normal."""
    width, slope, sine = 0.2, -1.5, np.sin(np.pi / 3)
    offset, share = scatter_many(sine, width, slope)

    def harvey(v, u):
        return (1 + ((u - sine) ** 2 + v**2) / width**2) ** (slope / 2)

    def moment(f):
        return 2 * dblquad(f, -1, 1, 0, lambda u: np.sqrt(1 - u * u), epsabs=1e-6)[0]

    inside = moment(harvey)
    normal = np.pi * width**2 * lobe(1.0, width, slope)
    assert 0.02 < 1 - inside / normal < 0.9
    error = share.std() / np.sqrt(len(share))
    assert share.mean() == pytest.approx(0.1 * inside / normal, abs=4 * error)
    lit = share > 0
    lean = moment(lambda v, u: (u - sine) * harvey(v, u)) / inside
    assert lean < -0.02
    assert offset[lit, 0].mean() == pytest.approx(lean, abs=4 * offset[lit, 0].std() / np.sqrt(lit.sum()))
    assert abs(offset[lit, 1].mean()) < 4 * offset[lit, 1].std() / np.sqrt(lit.sum())
