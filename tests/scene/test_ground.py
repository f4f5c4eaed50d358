"""Scenes: closed forms, what is conserved, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from ground_cases import NIR, canvas, flat

from cgi_wave.errors import InputError
from cgi_wave.scene.builders import edge, from_albedo, point, quadrants, uniform
from cgi_wave.scene.ground import (
    Canvas,
    Scene,
    ground_sample,
    on_zone,
    require_filter,
    require_positive,
    require_size,
    tiled,
)
from cgi_wave.scene.landsat import landsat_crop, landsat_reflectance
from cgi_wave.scene.radiance import toa_radiance
from cgi_wave.scene.spectrum import Spectrum


def test_uniform_scene_has_the_radiance_of_the_interferogram():
    """To the last bit: mode 0 is the reference spectrum and its map is 1."""
    spectrum = toa_radiance("o2a", NIR, 2e-3, albedo=0.3)
    scene = uniform(canvas(spectrum), 3, 4)
    assert scene.rank_residual == 0
    for row, column in ((0, 0), (2, 3)):
        assert np.array_equal(scene.spectrum(row, column).radiance, spectrum.radiance)
    darker = uniform(canvas(spectrum), 3, 4, albedo=0.1).spectrum(1, 1).radiance
    assert darker == pytest.approx(toa_radiance("o2a", NIR, 2e-3, albedo=0.1).radiance, rel=1e-6)


def test_quadrants_stand_two_to_one_and_alternate():
    scene = quadrants(canvas(), 6, 8)
    values = scene.maps[0]
    assert values[0, 0] == values[5, 7] == 0.5
    assert values[0, 7] == values[5, 0] == 1.0
    assert values[:3, :4].max() == values[3:, 4:].max() == 0.5
    odd = quadrants(canvas(), 3, 3).maps[0]  # the middle pixel lies half in each
    assert odd[1, 1] == odd[0, 1] == odd[1, 0] == 0.75
    assert quadrants(canvas(), 4, 4, contrast=5).maps[0].mean() == pytest.approx(0.6)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 17.0, 45.0, 90.0, 163.0, 180.0, 250.0])
def test_edge_pixels_hold_the_share_of_their_area(angle):
    """Against a fine raster, and the whole scene against the half-plane through a centred square."""
    scene = edge(canvas(), 8, 8, contrast=np.inf, offset_m=31.0, angle_deg=angle)
    fine = (np.arange(8 * 200) + 0.5) / 200 - 4
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    bright = c * fine[None, :] + s * fine[:, None] > 31.0 / 75.0
    raster = bright.reshape(8, 200, 8, 200).mean(axis=(1, 3))
    assert np.abs(scene.maps[0] - raster).max() < 6e-3
    centred = edge(canvas(), 8, 8, contrast=np.inf, angle_deg=angle)
    assert centred.maps[0].sum() == pytest.approx(32, rel=1e-6)


def test_moving_an_edge_by_a_pixel_moves_the_scene_by_a_pixel():
    here, there = (edge(canvas(), 9, 9, offset_m=x, angle_deg=90, contrast=3).maps[0] for x in (20.0, 95.0))
    assert there[1:] == pytest.approx(here[:-1], abs=1e-6)


@pytest.mark.parametrize("at", [(3, 4), (3.25, 4.5), (0, 0)])
def test_light_of_a_point_does_not_depend_on_where_it_lies(at):
    scene = point(canvas(), 7, 9, at, background=0.03)
    light = scene.maps[0].astype(float) - 0.1
    assert light.sum() == pytest.approx(0.9, rel=1e-5)
    row, column = np.arange(7), np.arange(9)
    assert (light.sum(axis=1) @ row, light.sum(axis=0) @ column) == pytest.approx((0.9 * at[0], 0.9 * at[1]), abs=1e-5)


def test_ground_sample_is_that_of_similar_triangles():
    assert ground_sample(15e-6, 650e3, 0.130) == pytest.approx(75.0)


def test_mirroring_is_continuous_and_repeating_is_periodic():
    scene = from_albedo(canvas(), np.arange(12.0).reshape(3, 4), "ramp")
    mirrored = tiled(scene, 9, 4).maps[0]
    assert np.array_equal(mirrored[3:6], scene.maps[0, ::-1])
    assert np.array_equal(mirrored[6:9], scene.maps[0])
    repeated = tiled(scene, 6, 8, "repeat", start=(1, 2)).maps[0]
    assert np.array_equal(repeated[:, :4], repeated[:, 4:])
    assert np.array_equal(repeated[0], np.roll(scene.maps[0, 1], -2).tolist() * 2)
    cut = tiled(scene, 2, 2, None, start=(1, 2))
    assert cut.origin_m == (2 * 15e-6, 15e-6)
    assert np.array_equal(cut.maps[0], scene.maps[0, 1:, 2:])


def test_scene_lies_on_the_zone_it_was_placed_on():
    zone = (-30e-6, 30e-6, 15e-6, 60e-6)  # 4 columns, 3 rows
    scene = on_zone(uniform(canvas(), 8, 6), zone, frames=4, step=1.5)  # one column beyond on either side
    assert scene.y_m[0] == pytest.approx(22.5e-6)
    assert scene.x_m[1] == pytest.approx(-22.5e-6)
    assert scene.x_m == pytest.approx(-scene.x_m[::-1])
    assert on_zone(scene, zone, frames=2, margin=1).y_m[1] == pytest.approx(22.5e-6)
    with pytest.raises(InputError, match="1 rows of pixels missing") as caught:
        on_zone(scene, zone, frames=7, step=1.0)
    assert (caught.value.field, caught.value.value) == ("rows", 8)
    with pytest.raises(InputError, match="no whole number"):
        on_zone(uniform(canvas(pixel_m=16e-6), 8, 6), zone)


def test_scene_smaller_than_the_swath_says_what_is_missing_and_offers_tiling():
    scene = uniform(canvas(), 256, 272)
    with pytest.raises(InputError, match="752 columns of pixels missing") as caught:
        require_size(scene, 450, 1024)
    assert "tile='mirror'" in caught.value.remedy
    with pytest.raises(InputError, match="194 rows of pixels missing"):
        tiled(scene, 450, 272, None)


def test_embedded_image_is_a_reflectance_and_fills_any_swath():
    red, pixel = landsat_reflectance("B4")
    assert red.shape == (256, 272)
    assert pixel == 75.0
    assert 0 < red.min() < red.max() < 0.5
    scene = landsat_crop(canvas(), 300, 1024)
    assert scene.maps.shape == (1, 300, 1024)
    assert scene.maps[0, :256, :272] * 0.3 == pytest.approx(red, rel=1e-6)
    assert np.array_equal(scene.maps[0, 256:300, :], scene.maps[0, 255:211:-1, :])
    assert "B4" in scene.source
    assert landsat_crop(canvas(), mean_albedo=0.3).maps.mean() == pytest.approx(1, rel=1e-5)
    coarse = landsat_crop(canvas(ground_pixel_m=150.0), 128, 136, tile=None)
    assert coarse.maps.mean(dtype=float) == pytest.approx(scene.maps[0, :256, :272].mean(dtype=float), rel=1e-6)
    with pytest.raises(InputError, match="rows of pixels missing"):
        landsat_crop(canvas(), 257, 272, tile=None)


def test_nearest_landsat_band_stands_for_the_ground():
    low, high = 1 / 452e-9, 1 / 448e-9
    blue = Spectrum(np.linspace(low, high, 5), np.ones(5), "blue")
    assert "B2" in landsat_crop(canvas(blue)).source
    with pytest.raises(InputError) as caught:
        landsat_crop(canvas(), band="B9")
    assert caught.value.field == "band"


SIGMA = np.linspace(1.3e6, 1.31e6, 5)


def made(maps=None, shapes=None, sigma=SIGMA, pixel=1.0):
    maps = np.ones((2, 3, 4), np.float32) if maps is None else maps
    return Scene(maps, sigma, np.ones((2, 5)) if shapes is None else shapes, pixel, 1.0, "made")


def broken(value, place=(0, 1, 2)):
    maps = np.ones((2, 3, 4), np.float32)
    maps[place] = value
    return maps


@pytest.mark.parametrize(
    ("changes", "field", "problem"),
    [
        ({"maps": np.ones((3, 4), np.float32)}, "maps", "not float32"),
        ({"maps": np.ones((2, 3, 4))}, "maps", "not float32"),
        ({"shapes": np.ones((3, 5))}, "shapes", "not"),
        ({"shapes": np.ones((2, 4))}, "shapes", "not"),
        ({"sigma": SIGMA[::-1]}, "sigma", "ascending"),
        ({"sigma": SIGMA**2}, "sigma", "uniform"),
        ({"pixel": 0.0}, "pixel_m", "positive"),
        ({"maps": broken(np.nan)}, "maps", "1 of 24 values not finite, the first at mode 0, row 1, column 2"),
        (
            {"maps": broken(-1, (0, slice(1, 3), 3))},
            r"maps\[0\]",
            "2 of 12 values negative, the first at row 1, column 3",
        ),
        ({"shapes": np.full((2, 5), np.inf)}, "shapes", "not finite"),
        ({"shapes": np.full((2, 5), -1.0)}, r"shapes\[0\]", "negative"),
    ],
)
def test_what_is_no_scene_is_refused_with_the_place(changes, field, problem):
    with pytest.raises(InputError, match=f"{field} = .*{problem}"):
        made(**changes)


def test_a_later_mode_may_be_negative_but_not_the_radiance():
    require_positive(made(maps=broken(-0.5, (1, 2, 3))))
    with pytest.raises(InputError, match=r"negative radiance at row 2, column 3, 769\.231 nm"):
        require_positive(made(maps=broken(-1.5, (1, 2, 3))))
    maps = broken(-1.0, (1, 0, 1))
    maps[0, 0, 1] = 0  # dark in the reference mode: still a pixel
    with pytest.raises(InputError, match="row 0, column 1"):
        require_positive(made(maps=maps))


def test_spectrum_that_leaves_the_filter_uncovered_is_refused():
    require_filter(uniform(canvas(flat()), 1, 1), NIR)
    half = flat()
    with pytest.raises(InputError, match=r"does not cover the 764/2\.6 nm filter"):
        require_filter(uniform(canvas(Spectrum(half.sigma[:6], half.radiance[:6], "half")), 1, 1), NIR)


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (lambda: uniform(canvas(), 0, 3), "rows, columns"),
        (lambda: uniform(canvas(), 2, 3, albedo=1.2), "albedo"),
        (lambda: edge(canvas(), 2, 3, contrast=0.5), "contrast"),
        (lambda: point(canvas(), 2, 3, (0, 3)), "at"),
        (lambda: point(canvas(), 2, 3, background=-0.1), "background"),
        (lambda: from_albedo(canvas(), np.array([[0.1, -0.1]]), "map"), "albedo"),
        (lambda: from_albedo(canvas(), np.array([[0.1, np.nan]]), "map"), "albedo"),
        (lambda: from_albedo(canvas(), np.ones((1, 2, 3)), "map"), "albedo"),
        (lambda: tiled(uniform(canvas(), 2, 3), 4, 4, "stretch"), "tile"),
        (lambda: tiled(uniform(canvas(), 2, 3), 0, 4), "rows, columns, start"),
        (lambda: landsat_crop(canvas(), mean_albedo=0.0), "mean_albedo"),
        (lambda: landsat_crop(canvas(), sun_elevation_deg=0.0), "sun_elevation_deg"),
        (lambda: Canvas(flat(), 0.0, 1.0, 1.0), "albedo"),
        (lambda: Canvas(flat(), 0.3, 1.0, np.nan), "ground_pixel_m"),
        (lambda: ground_sample(1.0, 0.0, 1.0), "altitude_m"),
    ],
)
def test_scene_that_cannot_be_is_refused_by_field(build, field):
    with pytest.raises(InputError) as caught:
        build()
    assert caught.value.field == field
