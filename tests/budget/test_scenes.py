"""A band's scenes: the ground's scale against traced rays, the zone, refusals."""

from pathlib import Path

import numpy as np
import pytest

from cgi_wave.budget.scenes import NAMES, band_scene, canvas
from cgi_wave.budget.setting import band_spectrum
from cgi_wave.errors import InputError
from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.beams import nominal_direction


@pytest.mark.parametrize("band", ["NIR", "VIS"])
def test_declared_scale_is_that_of_the_traced_rays(instrument, paths, band):
    """Chief rays 2 mm to either side of the zone's centre: pixel/|Δθ| is the ground pixel over the altitude.

    The focal length is declared as a round number; the traced ones are within 0.25 % of it.
    """
    system = instrument.band(band)
    x0, x1, y0, y1 = system.zone()
    centre = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
    for axis in (np.array([2e-3, 0.0]), np.array([0.0, 2e-3])):
        there, back = (nominal_direction(system, paths[0], centre + s * axis) for s in (1, -1))
        focal = 4e-3 / np.linalg.norm(there - back)
        assert canvas(system).ground_pixel_m == pytest.approx(system.pixel / focal * 650e3, rel=0.004)


def test_uniform_scene_carries_the_band_spectrum_to_the_last_bit(nir):
    scene = band_scene(nir, "uniform", frames=3)
    spectrum, _ = band_spectrum(nir)
    assert np.array_equal(scene.spectrum(5, 7).radiance, spectrum.radiance)
    assert (scene.rows, scene.columns) == (452, 1024)


@pytest.mark.parametrize("name", NAMES)
def test_every_named_scene_lies_on_the_zone(nir, name):
    scene = band_scene(nir, name, frames=4, step=1.5, margin=2)
    x0, x1, y0, y1 = nir.zone()
    assert (scene.rows, scene.columns) == (450 + 5 + 4, 1024 + 4)
    half = scene.pixel_m / 2
    assert (scene.x_m[2] - half, scene.x_m[-3] + half) == pytest.approx((x0, x1), abs=1e-12)
    assert scene.y_m[2] - half == pytest.approx(y0, abs=1e-12)
    assert scene.y_m[-3] + half == pytest.approx(y1 + 5 * scene.pixel_m, abs=1e-12)


def test_file_smaller_than_the_swath_is_refused_or_tiled(nir, tmp_path):
    np.savez(tmp_path / "a.npz", albedo=np.full((450, 1000), 0.2), ground_pixel_m=75.0, orientation="+y+x")
    with pytest.raises(InputError, match="24 columns of pixels missing") as caught:
        band_scene(nir, tmp_path / "a.npz")
    assert caught.value.file == str(tmp_path / "a.npz")
    scene = band_scene(nir, tmp_path / "a.npz", tile="mirror")
    assert scene.columns == 1024
    assert scene.maps == pytest.approx(0.2 / 0.3)
    with pytest.raises(InputError, match="unknown"):
        band_scene(nir, "moon")


@pytest.mark.parametrize("field", ["altitude_km", "focal_mm"])
def test_scale_that_is_not_declared_is_asked_for(field, tmp_path):
    lines = Path(load_instrument().file).read_text(encoding="utf-8").splitlines()
    text = "\n".join(line for line in lines if not line.startswith(field))
    (tmp_path / "silent.toml").write_text(text, encoding="utf-8")
    system = load_instrument(tmp_path / "silent.toml").band("VIS")
    with pytest.raises(InputError) as caught:
        canvas(system)
    assert caught.value.field == f"entrance.{field}"
    assert canvas(system, ground_pixel_m=80.0).ground_pixel_m == 80.0
