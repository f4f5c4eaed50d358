"""Terms of an interferogram times factors: what they stand for is an interferogram of its own."""

import numpy as np
import pytest
from fringe_scenes import PITCH, ROWS, SIGMA0, SLOPE, coherency, pair, retro_family

from cgi_wave.fringes.coherency import Coherency, LeftOut, LeftOutPairs
from cgi_wave.fringes.nma import retrieve
from cgi_wave.fringes.psi import interferogram_terms, synthesise
from cgi_wave.fringes.terms import Factors

LIGHT = (np.array([SIGMA0]), np.ones(1))


def scene(power=None):
    """Two nominal beams and four ghosts of three families, with bounds and errors; powers times ``power`` (6,)."""
    rng = np.random.default_rng(5)
    t = np.array([0.24, 0.25, 2e-3, 1e-3, 3e-3, 5e-4]) * (1.0 if power is None else power)
    pairs = [pair(0, 1, 0.9, 1e-5, SLOPE)]
    for m, l in ((0, 2), (1, 3), (2, 3), (0, 4), (4, 5)):  # noqa: E741
        gamma = rng.uniform(0.2, 0.8) * np.exp(1j * rng.uniform(0, 6))
        pairs.append(pair(m, l, gamma, 2e-6, rng.choice([0.0, 1.0, 2.0]) * SLOPE, error=1e-5))
    unit = np.sqrt(t[0] * t[1])
    ends = ((2, 4, 1.0), (3, 5, 0.0))
    out = [LeftOut(one, two, np.sqrt(t[one] * t[two]) / unit * 0.1, "far", f) for one, two, f in ends]
    made = coherency(t, [0, 0, 1, 1, 2, 3], pairs, out)
    return Coherency(made.labels, made.family, made.order, t, made.pairs, made.left_out, 1e-3 * t)


def same(psi, other):
    for book in ("nominal", "paper", "coherent"):
        one, two = getattr(psi, book), getattr(other, book)
        np.testing.assert_allclose(one.irradiance, two.irradiance, rtol=1e-13)
        for bound in ("error", "left_out", "left_out_baseline", "left_out_bound"):
            assert getattr(one, bound) == pytest.approx(getattr(two, bound), rel=1e-9), bound


def test_terms_with_other_powers_are_the_interferogram_of_those_powers():
    power = np.array([0.9, 0.8, 0.5, 0.25, 1.7, 0.1])
    terms = interferogram_terms(scene(), *LIGHT, ROWS, PITCH)
    same(terms.psi(), synthesise(scene(), *LIGHT, ROWS, PITCH))
    same(terms.psi(Factors.of_powers(terms.coherency, power)), synthesise(scene(power), *LIGHT, ROWS, PITCH))


def test_a_part_and_what_it_takes_away_make_the_whole():
    """Values add up; so do bounds that are plain sums, whichever sign a factor has."""
    terms = interferogram_terms(scene(), *LIGHT, ROWS, PITCH)
    factors = Factors.of_powers(terms.coherency, np.array([1.0, 1.0, 0.0, 0.3, 1.0, 0.6]))
    whole, part, rest = terms.psi(), terms.psi(factors), terms.psi(factors.complement(terms.coherency))
    added = part.coherent.irradiance + rest.coherent.irradiance - whole.nominal.irradiance
    np.testing.assert_allclose(added, whole.coherent.irradiance, rtol=1e-13)
    for bound in ("contrast_error", "power_error", "left_out_bound"):
        nominal = getattr(whole.nominal, bound)
        total = getattr(part.coherent, bound) + getattr(rest.coherent, bound) - nominal
        assert total == pytest.approx(getattr(whole.coherent, bound), rel=1e-12)
    negative = Factors(-factors.beam, -factors.pair, -factors.left_out)
    assert terms.psi(negative).coherent.error == pytest.approx(part.coherent.error, rel=1e-12)


def test_a_mirror_that_dims_both_nominal_beams_alike_divides_out():
    terms = interferogram_terms(scene(), *LIGHT, ROWS, PITCH)
    dimmed = Factors.of_powers(terms.coherency, np.full(6, 0.7))
    taken = dimmed.complement(terms.coherency)
    np.testing.assert_allclose(taken.beam[2:], 0.0, atol=1e-15)
    np.testing.assert_allclose(taken.pair[1:], 0.0, atol=1e-15)
    np.testing.assert_allclose(taken.left_out, 0.0, atol=1e-15)
    one, two = retrieve(terms.psi()), retrieve(terms.psi(dimmed))
    assert two.coherent.nma_error.value == pytest.approx(one.coherent.nma_error.value, rel=1e-12)


def test_half_the_reflector_halves_the_retro_ghost():
    """Closed form: O/B = ρ/4 and nothing at the nominal frequency, for every ρ."""
    terms = interferogram_terms(retro_family(1.33e-3, 0.04), *LIGHT, ROWS)
    for share in (1.0, 0.5, 0.1):
        got = retrieve(terms.psi(Factors.of_powers(terms.coherency, np.array([1, 1, *[share] * 4])))).coherent
        assert got.offset_over_baseline.value == pytest.approx(share * 0.01, rel=1e-9)
        assert abs(got.parasitic_over_modulation.value) < 1e-12


def test_terms_without_left_out_pairs_have_no_such_error():
    made = scene()
    bare = Coherency(made.labels, made.family, made.order, made.transmission, made.pairs, LeftOutPairs.of(()))
    assert interferogram_terms(bare, *LIGHT, ROWS).psi().coherent.left_out == 0.0
