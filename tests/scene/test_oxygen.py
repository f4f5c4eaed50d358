"""The A band against published frequencies, positions, intensities and partition sums, and the sum rule."""

from __future__ import annotations

import numpy as np
import pytest

from cgi_wave.scene.lines import C2_M_K
from cgi_wave.scene.oxygen import lower_energy, oxygen_a_band, partition_function

LIGHT_SPEED = 299_792_458.0

# Positions in cm⁻¹ and intensities in cm/molecule at 296 K as published: Drouin et al., JQSRT 186, 118 (2017).
PUBLISHED = {
    ("PP", 1): (13118.04495, 3.083e-24),
    ("PQ", 9): (13093.65603, 7.329e-24),
    ("PP", 9): (13091.71056, 8.360e-24),
    ("PP", 17): (13059.46667, 3.343e-24),
    ("RR", 9): (13144.54087, 7.479e-24),
    ("RQ", 9): (13146.58063, 8.652e-24),
}


@pytest.mark.parametrize(
    ("lower", "upper", "ghz"),
    [((1, 1), (1, 2), 56.2648), ((1, 0), (1, 1), 118.7503), ((3, 3), (3, 4), 58.4466), ((3, 2), (3, 3), 62.4863)],
)
def test_fine_structure_matches_the_microwave_lines(lower, upper, ghz):
    """The 60 and 118 GHz lines (Liebe, Int. J. Infrared Millim. Waves 10, 631, 1989); F2 lies above F1 and F3."""
    measured = abs(lower_energy(*upper) - lower_energy(*lower)) * LIGHT_SPEED / 1e9
    assert measured == pytest.approx(ghz, abs=2e-4)


def test_partition_sum_matches_the_published_one():
    assert partition_function(296.0) == pytest.approx(215.73, rel=1e-4)  # HITRAN, ¹⁶O2


@pytest.mark.parametrize("line", PUBLISHED)
def test_position_and_intensity_match_the_published_line(line):
    lines = oxygen_a_band()
    found = np.flatnonzero((lines.branch == line[0]) & (lines.n_lower == line[1]))
    assert found.size == 1
    position, strength = PUBLISHED[line]
    assert lines.sigma[found[0]] / 100 == pytest.approx(position, abs=1e-3)
    assert lines.strength[found[0]] * 100 / strength == pytest.approx(1.0, abs=0.03)


def test_honl_london_factors_of_one_j_obey_the_sum_rule():
    """The two levels of one J″ share one Ω = 1 state: RQ and PQ add up to (2J + 1)/2, as do PP and RR."""
    lines = oxygen_a_band()
    bare = lines.strength / lines.sigma * np.exp(C2_M_K * lines.lower_energy / 296.0)
    for j in (2, 10, 20):
        mixed = bare[(lines.j_lower == j) & np.isin(lines.branch, ["RQ", "PQ"])]
        pure = bare[(lines.j_lower == j + 1) & np.isin(lines.branch, ["PP", "RR"])]
        assert mixed.size == pure.size == 2
        assert mixed.sum() / pure.sum() == pytest.approx((2 * j + 1) / (2 * j + 3), rel=1e-12)


def test_intensity_at_another_temperature_conserves_the_band():
    """The band intensity hardly depends on T (all population stays in X): 220 K against 296 K within 1 %."""
    lines = oxygen_a_band()
    assert lines.strength_at(220.0).sum() / lines.strength.sum() == pytest.approx(1.0, abs=0.01)
    assert lines.strength_at(296.0) / lines.strength == pytest.approx(1.0, abs=1e-12)


def test_a_level_that_nuclear_spin_forbids_is_refused():
    with pytest.raises(ValueError, match="N is odd"):
        lower_energy(2, 2)
