"""Attribution: beside a retrieval without the beams, a Shapley value by brute force, and closed forms."""

from itertools import permutations
from math import factorial
from types import SimpleNamespace

import numpy as np
import pytest
from chain_cases import account, family, retro_power

from cgi_wave.analysis import zone_rows
from cgi_wave.budget.attribution import attribute, faces, only
from cgi_wave.budget.cost_table import cost_table
from cgi_wave.budget.select import Untraced
from cgi_wave.fringes.coherency import Coherency, LeftOut, LeftOutPairs, Pair
from cgi_wave.fringes.nma import nma_error_exact, retrieve
from cgi_wave.fringes.psi import interferogram_terms, synthesise
from cgi_wave.rays.paths import Path

SIGMA = np.array([1.0 / 0.764e-6])
ROWS = (np.arange(450) - 224.5) * 15e-6
SLOPE = 1.0 / (SIGMA[0] * 0.675e-3)
HISTORIES = [(), (), ("a",), ("a",), ("b",), ("a", "b"), ("b", "c"), ("c", "c")]


def path(names):
    history = tuple((name, "reflect") for name in names)
    return Path((), len(history), len(history), (), history)


PATHS = tuple(map(path, HISTORIES))


def pair(m, l, rng):  # noqa: E741
    gamma = rng.uniform(0.2, 0.9) * np.exp(2j * np.pi * rng.random()) * np.ones(1)
    slope = SLOPE if m == 0 and l == 1 else rng.choice([0.0, 1.0, -1.0, 2.0]) * SLOPE
    return Pair(m, l, SIGMA, gamma, np.full(1, 1e-5), np.full(1, 3e-6), slope, "made up")


def scene():
    """Nominal beams and six ghosts on three faces, every pair computed but two."""
    rng = np.random.default_rng(3)
    t = np.array([0.25, 0.24, 8e-3, 7e-3, 5e-3, 4e-3, 3e-3, 2e-3])
    out = [LeftOut(2, 4, 2e-3, "weak", 1.0), LeftOut(5, 7, 1e-3, "weak", 0.0)]
    ends = [(m, l) for m in range(8) for l in range(m + 1, 8) if (m, l) not in ((2, 4), (5, 7))]  # noqa: E741
    pairs = tuple(pair(m, l, rng) for m, l in ends)  # noqa: E741
    group = np.array([0, 0, 1, 1, 2, 3, 4, 5])
    return Coherency(tuple("ABCDEFGH"), group, (group > 0) * 1, t, pairs, LeftOutPairs.of(out), 1e-4 * t)


def without(made, kept):
    """The payload of some beams only, as though the others had never been found."""
    number = {old: new for new, old in enumerate(kept)}
    pairs = [p for p in made.pairs if p.m in number and p.l in number]
    return Coherency(
        tuple(made.labels[k] for k in kept), made.family[kept], made.order[kept], made.transmission[kept],
        tuple(Pair(number[p.m], number[p.l], *list(vars(p).values())[2:]) for p in pairs),
    )  # fmt: skip


@pytest.fixture(scope="module")
def point():
    return SimpleNamespace(paths=PATHS, coherency=scene())


@pytest.fixture(scope="module")
def terms(point):
    return interferogram_terms(point.coherency, SIGMA, np.ones(1), ROWS, 15e-6)


@pytest.fixture(scope="module")
def costs(point, terms):
    return attribute(point, terms)


def nma_of(made):
    return retrieve(synthesise(made, SIGMA, np.ones(1), ROWS, 15e-6)).coherent.nma_error.value


@pytest.mark.parametrize("name", ["a", "b", "c"])
def test_removed_and_alone_are_retrievals_of_fewer_beams(costs, point, name):
    """Slow: the beams are taken out of the payload, and the interferogram is made again."""
    touches = [k for k, p in enumerate(PATHS) if name in faces(p)]
    others = [k for k in range(8) if k not in touches]
    cost = costs.surfaces[name]
    assert cost.removed.nma == pytest.approx(nma_of(point.coherency) - nma_of(without(point.coherency, others)), 1e-9)
    assert cost.alone.nma == pytest.approx(nma_of(without(point.coherency, [0, 1, *touches])), rel=1e-9)
    assert cost.ghosts == len(touches)
    t = point.coherency.transmission
    assert cost.power == pytest.approx(t[touches].sum() / t[:2].sum())


def test_shares_are_shapley_values(costs, terms, point):
    """By brute force: what a face adds when it joins, averaged over all orders in which the three can join.

    A ghost or a pair exists once all its faces have joined.
    """
    names = ["a", "b", "c"]

    def worth(joined):
        beams = np.array([faces(p) <= set(joined) for p in PATHS])
        got = retrieve(terms.psi(only(terms, beams))).coherent
        return np.array([got.offset_over_baseline.value, got.parasitic_over_modulation.value])

    for name in names:
        added = np.zeros(2)
        for order in permutations(names):
            before = order[: order.index(name)]
            added += (worth((*before, name)) - worth(before)) / factorial(len(names))
        share = costs.surfaces[name].share
        np.testing.assert_allclose([share.offset, share.modulation], added, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("rows", ["surfaces", "families"])
def test_shares_add_up_to_what_all_ghosts_do(costs, point, rows):
    for part in ("offset", "modulation", "nma"):
        total = sum(getattr(cost.share, part) for cost in getattr(costs, rows).values())
        assert total == pytest.approx(getattr(costs.total, part), rel=1e-10)
    t = point.coherency.transmission
    assert sum(c.power_share for c in getattr(costs, rows).values()) == pytest.approx(t[2:].sum() / t[:2].sum())


def test_removing_does_not_undo_adding_where_ghosts_interact(costs):
    """The two columns differ by more than rounding, or one of them would be enough."""
    for cost in costs.surfaces.values():
        assert abs(cost.removed.nma - cost.alone.nma) > 1e-5


def test_errors_grow_by_what_was_left_out_and_by_untraced_ghosts(costs, point, terms):
    """A pair left out counts where one of its ghosts is concerned; an untraced ghost by its power and its bound."""
    bare = Coherency(**{**vars(point.coherency), "left_out": LeftOutPairs.of(())})
    clean = attribute(SimpleNamespace(paths=PATHS, coherency=bare), interferogram_terms(bare, SIGMA, np.ones(1), ROWS))
    for name, least in (("a", 2e-3), ("b", 2e-3), ("c", 0.9e-3 * 0.08)):
        grown = costs.surfaces[name].removed.error - clean.surfaces[name].removed.error
        assert least * 0.8 < grown < 6e-3, name
    hidden = Untraced((path(("c",)),), np.array([3e-3]), np.array([4e-3]))
    more = attribute(point, terms, hidden)
    o, m = costs.total.offset, costs.total.modulation
    extra = 3e-3 * (1 + m) / (1 + o) ** 2 + 4e-3 / (1 + o)
    assert more.surfaces["c"].removed.error == pytest.approx(costs.surfaces["c"].removed.error + extra, rel=1e-9)
    assert more.surfaces["c"].untraced == 3e-3
    assert more.surfaces["a"].removed == costs.surfaces["a"].removed


def test_table_is_the_mean_over_fields_and_a_point_without_ghosts_counts_nothing(nir, costs):
    """Names of the made-up faces are those of surfaces here, so that their coatings are found."""
    names = dict(zip("abc", ("detector", "filter_front", "cube_in"), strict=True))
    renamed = SimpleNamespace(
        surfaces={names[k]: v for k, v in costs.surfaces.items()}, families=costs.families, total=costs.total
    )
    empty = SimpleNamespace(surfaces={}, families={}, total=costs.total)
    table = cost_table(nir, [renamed, empty])
    row = next(row for row in table["surfaces"] if row["name"] == "detector")
    assert row["coating"] == "detector"
    assert row["removed_nma"] == pytest.approx(costs.surfaces["a"].removed.nma / 2)
    assert row["removed_nma_spread"] == pytest.approx(abs(costs.surfaces["a"].removed.nma) / 2)
    assert row["removed_nma_error"] == costs.surfaces["a"].removed.error
    assert table["total"]["share_nma"] == pytest.approx(costs.total.nma / 2)


def test_detectors_retro_ghost_costs_what_the_closed_form_says(instrument, nir, setting, paths):
    """Powers say ρτ²/2; the four arm pairs interfere, and half of it is left: with it alone, and by removing it."""
    made = account(nir, setting, family(paths, "detector"))
    x0 = nir.field_points()[0]
    terms = interferogram_terms(made.point.coherency, np.array([nir.sigma0]), np.ones(1), zone_rows(nir, x0), nir.pixel)
    costs = attribute(made.point, terms)
    cost, power = costs.surfaces["detector"], retro_power(instrument)
    assert cost.power == pytest.approx(power / 2, rel=1e-4)
    assert cost.contrast_family == pytest.approx(1.0, abs=2e-3)
    for effect in (cost.share, cost.alone, cost.removed):
        assert effect.offset == pytest.approx(power / 4, rel=3e-3)
        assert effect.nma == pytest.approx(nma_error_exact(0.0, power / 4), rel=1e-2)
    assert list(costs.families) == ["detector:r"]
