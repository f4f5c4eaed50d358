"""The nominal image: kernels given back, light kept, kernels that vary over the zone, and the errors it states."""

from dataclasses import replace

import numpy as np
import pytest
from scroll_cases import PITCH, fringes, gaussian, layer, scene, zone

from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.edge import edge_error, weight_beyond
from cgi_wave.fringes.field import NominalPsf
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.nominal_image import nominal_image
from cgi_wave.fringes.preparation import prepare

ROWS, COLUMNS, PAD = 24, 20, 9


def edges(z):
    half = 0.5 * PITCH
    return float(z.x_m[0]) - half, float(z.x_m[-1]) + half, float(z.y_m[0]) - half, float(z.y_m[-1]) + half


def kernel_at(z, x, y):
    """A lopsided kernel of sum 1 that is a polynomial of first degree in x and second in y."""
    u, v = x / z.x_m[-1], y / z.y_m[-1]
    wide, shifted = np.pad(gaussian(1.1, 3.0), 1), np.zeros((11, 11))
    wide = wide[1:-1, 1:-1] if wide.shape[0] == 11 + 2 else wide
    shifted[6, 3] = shifted[5, 5] = 0.5
    wide = np.pad(wide, (11 - wide.shape[0]) // 2) if wide.shape[0] < 11 else wide
    share = 0.4 + 0.2 * u + 0.1 * v + 0.05 * v * v
    return (1.0 - share) * wide + share * shifted


def psf_of(z, at=None, nodes=(3, 2), checks=((0.3, -0.4),)):
    at = kernel_at if at is None else at
    x0, x1, y0, y1 = edges(z)
    x, y = chebyshev.nodes(nodes[1], x0, x1), chebyshev.nodes(nodes[0], y0, y1)
    kernel = np.array([[at(z, a, b) for a in x] for b in y])
    places = np.array([[x1 * a, y1 * b] for a, b in checks])
    return NominalPsf(x, y, kernel, places, np.array([at(z, a, b) for a, b in places]), 0.002, 0.01)


def placed(rows=ROWS, columns=COLUMNS, pad=PAD):
    return zone(rows, columns, float(pad), float(pad))


def image_of(psf, z, maps, **options):
    return nominal_image(psf, edges(z), z, maps, 1e-12, **options)


def frame_of(image, z, maps, shift=0.0, pattern=None):
    pattern = np.ones(z.shape) if pattern is None else pattern
    beams = prepare([layer(pattern)], maps, z, precision="float64", nominal=image)
    return beams.frame(shift)


def test_a_point_gives_the_kernel_back():
    """Ground offset d before a pixel counts with kernel[d]: the picture of a point is the kernel turned over."""
    z = placed()
    psf = psf_of(z, lambda z, x, y: kernel_at(z, 0.0, 0.0))
    maps = np.zeros((1, ROWS + 2 * PAD, COLUMNS + 2 * PAD))
    maps[0, PAD + 12, PAD + 8] = 2.0
    found = frame_of(image_of(psf, z, maps), z, maps)
    np.testing.assert_allclose(found[7:18, 3:14], 2.0 * kernel_at(z, 0.0, 0.0)[::-1, ::-1], atol=1e-13)
    assert found.sum() == pytest.approx(2.0, rel=1e-12)  # dark all around: no light is lost


def test_every_pixel_has_the_kernel_of_its_place():
    """A kernel that varies over the zone, by its definition, while the ground scrolls; rows and columns as they are."""
    z = placed()
    maps = scene(ROWS + 2 * PAD + 6, COLUMNS + 2 * PAD, modes=2)
    pattern = scene(ROWS, COLUMNS, 7, modes=2)
    image = image_of(psf_of(z), z, maps)
    assert len(image.along) == 3 and image.between < 1e-12
    for shift in (0.0, 4.0):
        beams = prepare([layer(pattern)], maps, z, precision="float64", nominal=image, fractions=False)
        expected = np.zeros(z.shape)
        for j in range(ROWS):
            for i in range(COLUMNS):
                kernel = kernel_at(z, z.x_m[i], z.y_m[j])
                r, c = PAD + j + int(shift), PAD + i
                part = maps[:, r - 5 : r + 6, c - 5 : c + 6]
                expected[j, i] = (pattern[:, j, i] * (part * kernel).sum(axis=(1, 2))).sum()
        np.testing.assert_allclose(beams.frame(shift), expected, atol=1e-11)
        assert beams.plans[0].way == "sharp" and beams.error < 1e-9


def test_a_uniform_scene_is_unchanged():
    z = replace(placed(), phase=zone(ROWS, COLUMNS, period=12.0).phase)
    maps = np.full((1, ROWS + 2 * PAD, COLUMNS + 2 * PAD), 0.7)
    image = image_of(psf_of(z), z, maps)
    np.testing.assert_allclose(frame_of(image, z, maps, 0.0, fringes(z)), 0.7 * fringes(z), rtol=1e-13)
    assert image.between < 1e-15 and image.window == image.arms == 0.0


def test_a_strip_of_the_zone_and_single_precision():
    """The image lies on the zone's columns: a strip of it serves a strip of the zone."""
    z = placed()
    maps = scene(ROWS + 2 * PAD, COLUMNS + 2 * PAD)
    image = image_of(psf_of(z), z, maps)
    whole = frame_of(image, z, maps)
    strip = slice(4, 9)
    narrow = Zone(z.x_m[strip], z.y_m, z.row, z.column + 4)
    part = replace(image, maps=image.maps[..., strip])
    np.testing.assert_array_equal(frame_of(part, narrow, maps), whole[:, strip])
    short = nominal_image(psf_of(z), edges(z), z, maps, 1e-6, np.float32)
    assert short.maps.dtype == np.float32
    np.testing.assert_allclose(frame_of(short, z, maps), whole, atol=1e-6)


def test_what_interpolation_misses_is_measured_on_the_scene():
    """Kernels of third degree on two nodes: the error between is that at the points where the truth is known."""
    z = placed()

    def bent(z, x, y):
        v = y / z.y_m[-1]
        kernel = np.zeros((3, 3))
        kernel[1, 1], kernel[2, 1] = 0.8 - 0.2 * v**2, 0.2 + 0.2 * v**2
        return kernel

    maps = scene(ROWS + 2 * PAD, COLUMNS + 2 * PAD)
    psf = psf_of(z, bent, (2, 1), ((0.0, 0.0),))
    image = image_of(psf, z, maps)
    v = psf.y_m[0] / z.y_m[-1]
    step = np.abs(np.diff(np.pad(maps[0], 1, mode="edge"), axis=0)[1:, 1:-1]).max()
    assert image.between == pytest.approx(0.2 * v**2 * step, rel=1e-6)
    assert image.window == pytest.approx(0.002 * np.ptp(maps[0]))
    assert image.arms == pytest.approx(0.005 * np.ptp(maps[0]))
    middle = frame_of(image, z, maps)[ROWS // 2]  # half a row from the point: the kernel changes little
    truth = 0.8 * maps[0, PAD + ROWS // 2] + 0.2 * maps[0, PAD + ROWS // 2 + 1]
    assert np.abs(middle - truth[PAD:-PAD]).max() <= 1.02 * image.between


def test_terms_end_where_the_interpolation_knows_no_more():
    """A term along track below what the checks show is left out, and its bound is in the error."""
    z = placed()

    def slight(z, x, y):
        kernel = np.zeros((3, 3))
        kernel[1] = 0.3 + 1e-3 * y / z.y_m[-1], 0.5, 0.2 - 1e-3 * y / z.y_m[-1]
        return kernel

    maps = scene(ROWS + 2 * PAD, COLUMNS + 2 * PAD)
    psf = psf_of(z, slight, (2, 1), ((0.0, 0.0),))
    off = psf.check.copy()
    off[0, 1, 0] += 0.05
    off[0, 1, 1] -= 0.05
    known = image_of(psf, z, maps)
    vague = image_of(replace(psf, check=off), z, maps)
    assert len(known.along) == 2 and len(vague.along) == 1
    apart = np.abs(frame_of(known, z, maps) - frame_of(vague, z, maps)).max()
    assert 0.0 < apart < vague.between


def test_between_rows_the_image_is_read_by_four_and_the_error_says_so():
    z = zone(ROWS, COLUMNS, float(PAD), float(PAD))
    wave = np.sin(2 * np.pi * np.arange(ROWS + 2 * PAD + 2) / 14.0)
    maps = np.broadcast_to(wave[:, None], (len(wave), COLUMNS + 2 * PAD))[None].copy()
    psf = psf_of(z, lambda z, x, y: gaussian(0.6, 3.0))
    image = image_of(psf, z, maps)
    beams = prepare([layer(np.ones(z.shape))], maps, z, precision="float64", nominal=image)
    whole = prepare([layer(np.ones(z.shape))], maps, z, precision="float64", nominal=image, fractions=False)
    line = gaussian(0.6, 3.0).sum(axis=1)
    half = len(line) // 2
    blurred = (line * np.cos(2 * np.pi * np.arange(-half, half + 1) / 14.0)).sum()
    truth = blurred * np.sin(2 * np.pi * (PAD + np.arange(ROWS) + 0.5) / 14.0)
    error = np.abs(beams.frame(0.5)[:, 3] - truth).max()
    assert 1e-5 < error < beams.error
    assert whole.error < 1e-10


def test_weight_beyond_the_scene():
    """A kernel at the scene's corner: what sticks out, counted; nothing where the margin holds it."""
    z = zone(10, 8, 2.0, 3.0)
    kernel = np.arange(1.0, 50.0).reshape(7, 7)
    kernel /= kernel.sum()
    assert weight_beyond(np.eye(2, 3), kernel, z, (20, 20)) == pytest.approx(kernel[:1].sum())
    assert weight_beyond(np.eye(2, 3), kernel, z, (20, 12)) == pytest.approx(1.0 - kernel[1:, :5].sum())
    assert weight_beyond(np.eye(2, 3), kernel, z, (20, 20), reach=7.0) == pytest.approx(kernel[5:].sum())
    far = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 100 * PITCH]])
    assert weight_beyond(far, kernel, z, (20, 20)) == pytest.approx(1.0)


def test_edge_error_bounds_what_another_ground_beyond_does():
    """The same scene with other ground outside, within its range, changes a frame by no more."""
    z = zone(30, 26, 4.0, 4.0)
    big = scene(50, 46)
    maps = big[:, 6:44, 6:40]
    kernel = gaussian(3.0)
    ghost = layer(np.full(z.shape, 0.1), None, kernel)
    layers = [layer(np.ones(z.shape)), ghost]
    bound = edge_error(layers, None, maps, z)
    small = prepare(layers, maps, z, precision="float64").frame(0.0)
    full = prepare(layers, big, replace(z, row=10.0, column=10.0), precision="float64").frame(0.0)
    assert 0.1 * bound < np.abs(small - full).max() < bound
    assert edge_error(layers, None, big, replace(z, row=12.0, column=12.0)) > 0.0
    assert edge_error(layers[:1], None, maps, z) == 0.0
