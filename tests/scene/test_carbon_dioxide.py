"""The CO2 bands against published lines and partition sums, their closed forms, and the coherent rises."""

from __future__ import annotations

import numpy as np
import pytest

from cgi_wave.scene.carbon_dioxide import BANDS, carbon_dioxide, partition_function
from cgi_wave.scene.coherence import coherent_rise
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.lines import C2_M_K
from cgi_wave.scene.radiance import toa_radiance

# Positions in cm⁻¹, intensities in cm per molecule of natural CO2 at 296 K and air half-widths in cm⁻¹/atm, as HITRAN
# lists them.
PUBLISHED = {
    ("30012 P", 16): (6334.464734, 1.62e-23, 0.0758),
    ("30012 R", 16): (6359.967248, 1.76e-23, 0.0741),
    ("30012 P", 40): (6310.883379, 2.86e-24, 0.0687),
    ("30012 R", 40): (6373.437606, 3.08e-24, 0.0683),
}


def line(branch, j):
    lines = carbon_dioxide()
    (found,) = np.flatnonzero((lines.branch == branch) & (lines.j_lower == j))
    return lines.sigma[found], lines.strength[found], lines.half_width[found]


@pytest.mark.parametrize("key", PUBLISHED)
def test_lines_match_the_published_ones(key):
    position, strength, width = PUBLISHED[key]
    sigma, own, half_width = line(*key)
    assert sigma / 100 == pytest.approx(position, abs=1e-3)
    assert own * 100 == pytest.approx(strength, rel=0.02)
    assert half_width / 100 * 101325 == pytest.approx(width, rel=0.03)


def test_partition_sum_matches_the_published_one():
    assert partition_function(296.0) == pytest.approx(286.09, rel=1e-3)  # HITRAN, ¹²C¹⁶O2


@pytest.mark.parametrize("band", BANDS)
def test_combination_differences_are_those_of_the_ground_state(band):
    """R(J) and P(J + 2) share their upper level: their difference is B″(4J + 6) − 8D″(J + 3/2)³ and what is small."""
    b, d = 0.39021894e2, 1.3337e-5
    for j in (0, 10, 30):
        apart = line(f"{band} R", j)[0] - line(f"{band} P", j + 2)[0]
        x, y = j * (j + 1), (j + 2) * (j + 3)
        assert apart == pytest.approx(b * (y - x) - d * (y**2 - x**2), abs=1e-6)


def test_only_even_levels_exist():
    assert np.all(carbon_dioxide().j_lower % 2 == 0)


@pytest.mark.parametrize("band", ["30013", "20013", "20012"])
def test_intensities_without_herman_wallis_factor_obey_the_sum_rule(band):
    """P and R of one level share 2J + 1, and the band's lines add up to its intensity."""
    lines = carbon_dioxide()
    own = np.char.startswith(lines.branch, band)
    bare = lines.strength / lines.sigma * np.exp(C2_M_K * lines.lower_energy / 296.0)
    sums = np.array([bare[own & (lines.j_lower == j)].sum() / (2 * j + 1) for j in (2, 20, 40)])
    assert sums == pytest.approx(sums[0], rel=1e-12)
    assert lines.strength[own].sum() == pytest.approx(BANDS[band].strength, rel=1e-12)


@pytest.mark.parametrize(
    ("centre", "width", "opd", "nma"), [(1572.6, 4.9, 7.54e-3, 0.056), (1579.0, 6.0, 5.53e-3, 0.056)]
)
def test_coherent_rises_of_30012(centre, width, opd, nma):
    """Against the rises that HITRAN's lines give with 5 layers, every isotopologue and hot band among them."""
    band = Filter(centre * 1e-9, width * 1e-9, "flat-top")
    rise = coherent_rise(toa_radiance("co2", band, 9e-3), band, 9e-3)
    assert rise.opd_m == pytest.approx(opd, abs=0.06e-3)
    assert rise.nma == pytest.approx(nma, rel=0.06)


@pytest.mark.parametrize(
    ("centre", "width", "low", "high"), [(2067.0, 8.0, 5.2e-3, 5.9e-3), (2055.0, 8.0, 7.1e-3, 8.3e-3)]
)
def test_coherent_rises_of_20013_are_where_the_constants_say(centre, width, low, high):
    """P lines stand 1.7 to 1.9, R lines 1.25 to 1.4 cm⁻¹ apart."""
    band = Filter(centre * 1e-9, width * 1e-9, "flat-top")
    assert low < coherent_rise(toa_radiance("co2", band, 9e-3), band, 9e-3).opd_m < high
