"""Smooth layers on their grid: the compiled loops against the plain sum at every pixel, dark rows, maps that turn."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scroll_cases import fringes, gaussian, layer, scene, zone

from cgi_wave.errors import InputError
from cgi_wave.fringes import smooth
from cgi_wave.fringes.beams_on_scene import Beams, Sharp
from cgi_wave.fringes.preparation import prepare
from cgi_wave.fringes.ways import Placed, gathered, turn_of


def candidate(rng, where, kinds, dark, size, modes):
    """A layer of random nodes: nothing is smooth, so that every weight counts."""
    rows = len(where.nodes[0]) + dark
    envelope = rng.standard_normal((modes, kinds, rows, len(where.nodes[1])))
    if kinds > 1:
        envelope[:, 1:, len(where.nodes[0]) :] = 0.0
    coarse = rng.standard_normal((modes, size, len(where.nodes[1])))
    place = rng.uniform(-1.0, size, rows)
    return Placed(envelope, coarse, place, rng.uniform(5.0, 9.0), 0.0)


def cubic_line(values, place, wrap):
    """(…,) values (V, …) at a place by Lagrange's cubic, written out."""
    size = len(values)
    place = place if wrap else min(max(place, 0.0), size - 1.0)
    start = int(np.floor(place))
    start = start if wrap else min(max(start, 1), size - 3)
    total = 0.0
    for a in range(-1, 3):
        weight = np.prod([(place - start - b) / (a - b) for b in range(-1, 3) if b != a])
        total = total + weight * values[(start + a) % size if wrap else start + a]
    return total


def plain_sum(parts, z, where, shift, wrap):
    """(R, X) all smooth layers, term by term."""
    along, _ = where.nodes
    out = np.zeros(z.shape)
    theta = np.zeros(z.shape) if z.phase is None else z.phase
    theta = smooth.at_nodes(theta, where)
    turn = [np.ones_like(theta), np.cos(theta), np.sin(theta), np.cos(2 * theta), np.sin(2 * theta)]
    for part in parts:
        for c, image in enumerate(part.coarse):
            node = np.array([cubic_line(image, place + shift / part.step, wrap) for place in part.row])
            for h, envelope in enumerate(part.envelope[c]):
                field = envelope * node
                for j in range(z.shape[0]):
                    if j in z.dark:
                        line = field[len(along) + z.dark.index(j)]
                    else:
                        line = cubic_line(field[: len(along)], j / where.pitch + 1.0, False)
                    for x in range(z.shape[1]):
                        out[j, x] += cubic_line(turn[h][j] * line, x / where.pitch + 1.0, False)
    return out


@pytest.mark.parametrize("pitch", [8, 16, 32])
@pytest.mark.parametrize(("wrap", "period", "modes"), [(False, 40.0, 1), (True, 40.0, 2), (False, None, 1)])
def test_every_pixel_is_the_plain_sum(pitch, wrap, period, modes):
    """Random nodes, patterns and images, columns that do not fill the last cell, whole and part rows, dark rows."""
    rng = np.random.default_rng(pitch + 7 * modes)
    z = zone(43, 37, 2.0, 0.0, period=period, tilt=0.0)
    z = replace(z, dark=(0, 1, 29))
    where = smooth.grid(z.shape, pitch, np.float64)
    kinds = (1, 1) if period is None else (1, 5, 5)
    parts = [candidate(rng, where, n, 3, 7 + n, modes) for n in kinds]
    pattern, image = rng.random((modes, *z.shape)), rng.random((modes, 80, 37))
    nominal = Sharp("nominal", pattern, image, 2.0 + np.arange(43.0), 2, 0, True)
    beams = Beams(
        z,
        np.float64,
        wrap,
        80,
        (nominal,),
        (),
        gathered(parts, z, where, turn_of(z, where, np.float64), wrap, np.float64),
        (),
        0.0,
    )
    for shift in (5.0, 11.3):
        part = shift - np.floor(shift)
        low = 2 + int(shift) + np.arange(43)
        bright = (1.0 - part) * image[:, low] + part * image[:, low + 1]
        expected = (pattern * bright).sum(axis=0) + plain_sum(parts, z, where, shift, wrap)
        np.testing.assert_allclose(beams.frame(shift), expected, atol=2e-12)
        alone = beams.frame(shift)
        with ThreadPoolExecutor(1) as pool:  # often: where the two threads meet is chance
            for _ in range(30):
                np.testing.assert_array_equal(beams.frame(shift, None, pool), alone)


def test_fringes_across_the_grid_are_not_taken_for_smooth():
    """Fringes that cross a cell are none that nodes carry: measured, and refused."""
    for tilt, way in ((0.02, "smooth"), (6.0, "sharp")):
        z = zone(150, 130, 30.0, 20.0, period=45.0, tilt=tilt)
        ghost = layer(1e-2 * fringes(z), None, gaussian(24.0, 5.0))
        assert prepare([layer(fringes(z)), ghost], scene(320, 170), z, tolerance=1e-4).plans[1].way == way


def test_edges_are_left_by_the_cubic():
    """Rows that are cubics are met exactly, beyond the zone too."""
    where = smooth.grid((20, 37), 8, np.float64)
    cubic = np.polynomial.Polynomial([0.3, -0.2, 0.01, 3e-4])
    found = smooth.at_nodes(cubic(np.arange(37.0))[None], where)
    np.testing.assert_allclose(found[0], cubic(where.nodes[1]), rtol=1e-10)


def shaded(z, pattern):
    factor = np.ones(z.shape[0])
    factor[list(z.dark)] = [0.5, 0.8, 0.9, 0.7]
    return pattern * factor[:, None]


@pytest.mark.parametrize("tile", [False, True])
def test_dark_rows_and_maps_that_turn_keep_the_tolerance(tile):
    z = replace(zone(150, 130, 30.0, 20.0, period=45.0, tilt=0.02), dark=(0, 1, 148, 149))
    affine = [[0.9, 0.004, 1e-5], [-0.05, 1.1, 2e-5]]
    made = [layer(shaded(z, 1e-2 * fringes(z)), affine, gaussian(24.0, 5.0), "turned"),
            layer(shaded(z, 1e-2 * np.ones(z.shape)), None, gaussian(30.0, 5.0), "plain")]  # fmt: skip
    image = scene(320, 170)
    kept = prepare([layer(fringes(z)), *made], image, z, tolerance=1e-4, tile=tile, precision="float64")
    assert [plan.way for plan in kept.plans] == ["sharp", "smooth", "smooth"]
    assert kept.smooth is not None and kept.smooth.fringed.shape[2] == kept.smooth.plain.shape[2] == 1
    full = prepare([layer(fringes(z)), *made], image, z, tolerance=1e-12, tile=tile, precision="float64")
    assert {plan.way for plan in full.plans} == {"sharp", "warped"}
    for shift in (0.0, 11.3, 87.0):
        error = np.abs(kept.frame(shift) - full.frame(shift)).max()
        assert 1e-12 < error <= kept.error + full.error


def test_one_budget_for_all_layers():
    """A layer may take what others leave, more than an equal share, and no more than all have together."""
    z = zone(150, 130, 30.0, 20.0, period=45.0)
    made = [layer(power * fringes(z), None, gaussian(14.0, 5.0), f"{power:g}") for power in (1e-2, 1e-5, 1e-6, 1e-7)]
    image, shares = scene(320, 170), []
    for tolerance in 1e-3 * 0.7 ** np.arange(30):
        beams = prepare([layer(fringes(z)), *made], image, z, tolerance=tolerance, precision="float64")
        smooth_ones = [plan.error for plan in beams.plans if plan.way == "smooth"]
        assert sum(smooth_ones) <= tolerance
        if beams.plans[1].way != "smooth":
            break
        shares.append(beams.plans[1].error / tolerance)
    assert beams.plans[1].way == "sharp" and len(smooth_ones) >= 2
    assert max(shares) > 0.5 / 5


def test_a_result_that_does_not_fit_is_refused():
    z = zone(12, 10, 4.0, 3.0)
    beams = prepare([layer(np.ones(z.shape))], scene(30, 18), z)
    for out in (np.empty((12, 10)), np.empty((10, 12), np.float32), np.empty((10, 12), np.float32).T):
        with pytest.raises(InputError, match="does not fit the frame"):
            beams.frame(0.0, out)
