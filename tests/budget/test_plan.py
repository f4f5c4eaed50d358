"""The plan of pairs: its bounds hold, what it leaves out is summed plainly, and nothing is lost between the lists."""

import numpy as np
import pytest

from cgi_wave.budget.plan import baseline_bound, modulation_bound, plan_pairs
from cgi_wave.errors import InputError
from cgi_wave.fringes.coherency import Coherency, LeftOutPairs, Pair
from cgi_wave.fringes.nma import retrieve
from cgi_wave.fringes.psi import synthesise
from cgi_wave.scene.coherence import coherence_envelope
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.spectrum import Spectrum

SIGMA0 = 1.0 / 0.764e-6
ROWS = (np.arange(450) - 224.5) * 15e-6
SLOPE = 1.0 / (SIGMA0 * 0.675e-3)
SIGMA = SIGMA0 + np.linspace(-15e3, 15e3, 4001)
FILTER = Filter(0.764e-6, 2.6e-9)
WEIGHT = FILTER.transmission(SIGMA)


def scene(seed=7, ghosts=9):
    """Random beams: powers, families, OPDs and slopes."""
    rng = np.random.default_rng(seed)
    beams = 2 + ghosts
    t = np.concatenate([[0.25, 0.24], 10 ** rng.uniform(-8, -3, ghosts)])
    family = np.concatenate([[0, 0], 1 + np.arange(ghosts) // 3])
    length = np.concatenate([[1e-4, 0.0], rng.uniform(-6e-4, 6e-4, ghosts)])
    turns = np.concatenate([[1, 0], rng.integers(0, 3, ghosts)])
    gamma = rng.uniform(0.0, 0.9, (beams, beams))
    gamma[0, 1] = 1.0
    return t, family, length[:, None] - length[None, :], (turns[:, None] - turns[None, :]) * SLOPE, gamma


def planned(tolerance, cross_family=True):
    t, family, opd, slope, gamma = scene()
    reach = np.abs(slope) * ROWS.max()
    labels = tuple(f"beam {i}" for i in range(len(t)))
    envelope = coherence_envelope(Spectrum(SIGMA, np.ones_like(SIGMA), "flat"), FILTER)
    nma = float(np.exp(-((np.pi * 4.45e3 * 1.1e-4) ** 2) / (4 * np.log(2))))
    return plan_pairs(labels, t, family, opd - reach, opd + reach, gamma, envelope, nma, tolerance,
                      cross_family)  # fmt: skip


def coherency(pairs, left_out=None):
    t, family, opd, slope, gamma = scene()
    at, zero = np.array([SIGMA0]), np.zeros(1)
    return Coherency(
        tuple(map(str, range(len(t)))), family, (family > 0).astype(int), t,
        tuple(Pair(m, l, at, gamma[m, l] + 0j * at, zero, opd[m, l] + zero, slope[m, l], "") for m, l in pairs),  # noqa: E741
        left_out or LeftOutPairs.of(()),
    )  # fmt: skip


def test_bounds_are_the_formulae():
    assert modulation_bound(0.25, 0.25, 1.0, 1.0, 0.25, 0.25, 1.0) == pytest.approx(1.0)
    # a path of power 6e-6 carries half a per cent of amplitude
    assert modulation_bound(0.5, 6e-6, 1.0, 1.0, 0.5, 0.5, 1.0) == pytest.approx(np.sqrt(1.2e-5))
    assert modulation_bound(0.5, 6e-6, 0.1, 0.2, 0.5, 0.5, 0.4) == pytest.approx(np.sqrt(1.2e-5) * 0.05)
    assert baseline_bound(0.25, 0.25, 1.0, 1.0, 0.25, 0.25) == pytest.approx(1.0)


@pytest.mark.parametrize("tolerance", [1e-5, 1e-3, 1e-2])
def test_every_pair_is_kept_or_left_out_with_its_bound(tolerance):
    plan = planned(tolerance)
    pairs = [(p.m, p.l) for p in (*plan.kept, *plan.skipped)]
    assert len(set(pairs)) == len(pairs) == 11 * 10 // 2
    assert {(p.m, p.l) for p in plan.skipped} == {(out.m, out.l) for out in plan.left_out}
    assert all(p.modulation > tolerance for p in plan.kept if p.kind != "nominal")
    assert all(p.modulation <= tolerance for p in plan.skipped)
    assert plan.left_out_modulation == pytest.approx(sum(out.bound for out in plan.left_out))
    assert plan.left_out_modulation > np.sqrt(sum(out.bound**2 for out in plan.left_out))
    assert plan.largest_opd == pytest.approx(max(abs(o) for p in plan.kept for o in (p.opd_lo, p.opd_hi)))


@pytest.mark.parametrize("tolerance", [1e-3, 1e-2])
def test_what_was_left_out_stays_below_its_bound(tolerance):
    """The full computation against the planned one: M* and O differ by less than the sum of the bounds.

    The error bars hold the standard error of the pairs left out (squares over families), which is no bound: phases
    that happen to agree may exceed it, here by less than twice.
    """
    plan = planned(tolerance)
    everything = [(p.m, p.l) for p in (*plan.kept, *plan.skipped)]
    full = retrieve(synthesise(coherency(everything), SIGMA, WEIGHT, ROWS)).coherent
    short = retrieve(
        synthesise(coherency([(p.m, p.l) for p in plan.kept], plan.left_out), SIGMA, WEIGHT, ROWS)
    ).coherent
    shift = abs(full.parasitic_over_modulation.value - short.parasitic_over_modulation.value)
    assert 0.0 < shift <= plan.left_out_modulation
    assert shift <= 2.0 * short.parasitic_over_modulation.error
    offset = abs(full.offset_over_baseline.value - short.offset_over_baseline.value)
    assert 0.0 < offset <= plan.left_out_baseline
    assert offset <= 2.0 * short.offset_over_baseline.error
    assert abs(full.nma_error.value - short.nma_error.value) <= 2.0 * short.nma_error.error


def test_cross_family_pairs_can_be_switched_off_but_not_hidden():
    whole, short = planned(1e-6), planned(1e-6, cross_family=False)
    crossing = [p for p in whole.kept if p.kind == "cross-family"]
    assert crossing
    assert not [p for p in short.kept if p.kind == "cross-family"]
    assert short.left_out_modulation == pytest.approx(whole.left_out_modulation + sum(p.modulation for p in crossing))
    assert sum("switched off" in out.reason for out in short.left_out) == len(crossing)


def test_table_prints_the_kept_pairs_and_the_bound_of_the_rest():
    plan = planned(1e-3)
    text = plan.table(rows=3)
    assert "beam 0 × beam 1" in text
    assert f"{plan.left_out_modulation:.2e} of M" in text
    assert f"and {len(plan.kept) - 3} more kept" in text
    assert len(plan.table().splitlines()) >= len(plan.kept) + 2


@pytest.mark.parametrize("broken", ["gamma", "opd", "tolerance", "nominal", "shape"])
def test_refuses_what_is_no_bound(broken):
    t, family, opd, _, gamma = scene()
    lo, tolerance = opd - 1e-6, 1e-4
    if broken == "gamma":
        gamma[2, 3] = 1.2
    if broken == "opd":
        lo = opd + 2e-6
    if broken == "tolerance":
        tolerance = 0.0
    if broken == "nominal":
        t[1] = 0.0
    if broken == "shape":
        family = family[:-1]
    with pytest.raises(InputError):
        plan_pairs(tuple("abcdefghijk"), t, family, lo, opd + 1e-6, gamma, lambda a, b: np.ones_like(a), 0.3, tolerance)
