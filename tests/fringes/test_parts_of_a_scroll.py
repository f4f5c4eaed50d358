"""A scroll in parts: images made for each are those of the whole, errors are each part's own, nothing is kept."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from scroll_cases import fringes, gaussian, layer, scene, zone

from cgi_wave.errors import InputError
from cgi_wave.fringes.beams_on_scene import Beams
from cgi_wave.fringes.imaging import Span
from cgi_wave.fringes.preparation import choose, prepare
from cgi_wave.fringes.scroll import Motion, motion, parts, stream, streams

FLIP = [[-1.0, 0.0, 2e-5], [0.0, -1.0, 1e-5]]


def layers_of(z):
    """The nominal one; ghosts that are sharp, blurred a little, turned, and smooth."""
    even = 0.02 * np.ones(z.shape)
    return [
        layer(fringes(z)), layer(0.1 * fringes(z), FLIP, name="flipped"),
        layer(0.1 * np.random.default_rng(1).random(z.shape), [[1.02, 0.0, 0.0], [0.0, 0.97, 0.0]], gaussian(1.0)),
        layer(even, [[0.9999, 0.004, 0.0], [-0.004, 1.0001, 0.0]], name="turned"),
        layer(even, [[1.1, 0.0, 0.0], [0.0, -1.1, 0.0]], gaussian(14.0), "wide"),
    ]  # fmt: skip


@pytest.mark.parametrize("tolerance", [1e-4, 1e-9])
def test_frames_of_parts_are_those_of_the_whole(tolerance):
    """Also at the scene's ends, and at fractions of a row; smooth layers within what the plans say."""
    z = zone(64, 48, 10.0, 8.0, period=16.0)
    maps = scene(200, 70)
    layers = layers_of(z)
    together = prepare(layers, maps, z, tolerance=tolerance, precision="float64")
    choice = choose(layers, maps, z, tolerance=tolerance, precision="float64", span=Span(-10.0, 20.0))
    ways = {plan.way for plan in together.plans}
    assert ways == ({"sharp", "warped", "smooth"} if tolerance > 1e-6 else {"sharp", "warped"})
    for span in (Span(-10.0, 20.0), Span(20.5, 60.0), Span(60.0, 126.0)):
        beams = choice.beams(span)
        allowed = 1e-12 if "smooth" not in ways else beams.plans[4].error + together.plans[4].error
        for shift in (span.low, 0.3 * span.low + 0.7 * span.high, span.high):
            assert np.abs(beams.frame(shift) - together.frame(shift)).max() < allowed


def test_wide_blurs_go_by_cells_within_the_tolerance():
    """Against the same layers sample by sample; the plan says what was done."""
    z = zone(96, 96, 20.0, 20.0, period=16.0)
    maps = scene(200, 140)
    ghosts = [
        layer(2e-3 * np.ones(z.shape), [[1.0, 0.0, 1e-5 * k], [0.0, -1.0, 0.0]], gaussian(11.0 + 3 * k), f"wide {k}")
        for k in range(3)
    ]
    layers = [layer(fringes(z)), *ghosts]
    fast = prepare(layers, maps, z, tolerance=1e-4, precision="float64")
    assert any(plan.blur.startswith("cells") for plan in fast.plans)
    slow = prepare(layers, maps, z, tolerance=1e-10, precision="float64")
    assert not any(plan.blur.startswith("cells") for plan in slow.plans)
    apart = max(np.abs(fast.frame(s) - slow.frame(s)).max() for s in (0.0, 31.5, 80.0))
    assert apart <= fast.error <= 1e-4 * maps.max()


def test_errors_are_those_of_each_part():
    """Ground that is even at first and rough later: what reading between rows costs shows where it costs it."""
    z = zone(40, 30, 4.0, 4.0)
    maps = np.full((1, 200, 40), 0.5)
    maps[:, 110:] = scene(90, 40)
    ghost = layer(0.1 * np.ones(z.shape), [[1.0, 0.0, 0.0], [0.0, 1.03, 0.0]], gaussian(0.7))
    choice = choose([layer(np.ones(z.shape)), ghost], maps, z, tolerance=1e-3, span=Span(0.0, 40.0))
    calm, rough = choice.beams(Span(0.0, 40.0)), choice.beams(Span(80.0, 120.0))
    assert calm.error < 1e-6 < 1e-3 < rough.error


def test_a_frame_beyond_its_part_is_refused():
    z = zone(20, 16, 2.0, 2.0)
    beams = choose([layer(np.ones(z.shape))], scene(80, 20), z, span=Span(0.0, 10.0)).beams(Span(0.0, 10.0))
    beams.frame(10.0)
    with pytest.raises(InputError, match=r"shift = 10\.5.*0 to 10"):
        beams.frame(10.5)


def test_parts_hold_every_frame_once_and_no_more_rows_than_asked():
    moves = motion(500, 1.3, jitter=0.4, attitude=3.0, period=60.0, seed=2)
    found = list(parts(moves, 50.0))
    assert np.concatenate([np.arange(500)[frames] for frames, _ in found]).tolist() == list(range(500))
    for frames, span in found:
        rows = moves.rows[frames]
        assert span == Span(float(rows.min()), float(rows.max())) and span.high - span.low <= 50.0
    assert len(found) < 20
    assert len(list(parts(Motion(np.arange(9.0), 1.0), np.inf))) == 1


def test_streams_side_by_side_are_those_one_by_one_and_let_go_of_images():
    z = zone(30, 20, 3.0, 3.0, period=12.0)
    maps = scene(160, 26)
    both = [choose(some, maps, z, precision="float64") for some in (layers_of(z)[:2], layers_of(z)[:1])]
    moves = motion(120)
    alive: list[weakref.ref[Beams]] = []

    def made(span):
        gc.collect()
        assert not any(ref() is not None for ref in alive)
        beams = [choice.beams(span) for choice in both]
        alive.extend(map(weakref.ref, beams))
        return beams

    pairs = [tuple(one.copy() for one in pair) for pair in streams(made, moves, 25.0)]
    assert len(alive) == 2 * 5
    for number, choice in enumerate(both):
        for pair, frame in zip(pairs, stream(choice.beams(), moves), strict=True):
            np.testing.assert_allclose(pair[number], frame, atol=1e-13)


def test_a_kernel_that_does_not_add_up_to_one_is_refused():
    z = zone(20, 16)
    ghost = layer(np.ones(z.shape), FLIP, 1.1 * gaussian(2.0))
    with pytest.raises(InputError, match=r"layer ghost\.kernel = 1\.1.*add up to 1"):
        choose([layer(np.ones(z.shape)), replace(ghost)], scene(30, 20), z)


def test_ghosts_off_their_map_cost_what_the_ground_changes_by():
    """A ghost moved by as much as its misfit changes a frame by no more than the plan says (on ground beside the zone,
    where the scene's edge goes on, a wide blur changes by ten times as much)."""
    z = zone(40, 30, 10.0, 10.0)
    maps = scene(70, 60)
    for kernel in (gaussian(0.8), gaussian(9.0)):
        ghost = layer(0.1 * np.ones(z.shape), np.eye(2, 3), kernel)
        assert ghost.view is not None
        off = replace(ghost, view=replace(ghost.view, misfit_m=0.5 * z.pitch))
        moved = np.eye(2, 3)
        moved[:, 2] = 0.3 * z.pitch, -0.4 * z.pitch
        other = replace(ghost, view=replace(ghost.view, affine=moved))
        dark = layer(np.zeros(z.shape))
        said, there = (prepare([dark, one], maps, z, tolerance=1e-6, precision="float64") for one in (off, other))
        apart = np.abs(said.frame(0.0) - there.frame(0.0)).max()
        assert 0.05 * said.plans[1].places < apart < said.plans[1].places
        assert there.plans[1].places == 0.0
