"""Scene files: round trip, units, pixels, orientation, what is refused."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import xarray
from ground_cases import NIR, canvas, flat

from cgi_wave.errors import InputError, MissingPackageError
from cgi_wave.scene.builders import edge, uniform
from cgi_wave.scene.column import with_column
from cgi_wave.scene.ground import on_zone
from cgi_wave.scene.ground_file import load_scene, save_scene

STATED = {"file_pixel_m": 75.0, "orientation": "+y+x"}


@pytest.fixture
def gassy():
    """Two modes, placed on a zone."""
    ground = edge(canvas(flat()), 6, 8, angle_deg=20)
    scene = with_column(ground, np.linspace(0, 0.5, 48).reshape(6, 8), np.full(11, 0.7), NIR)
    return on_zone(scene, (-45e-6, 45e-6, 30e-6, 90e-6))


def test_scene_comes_back_from_its_file(tmp_path, gassy):
    save_scene(gassy, tmp_path / "scene.nc")
    back = load_scene(tmp_path / "scene.nc", canvas(flat()), NIR)
    for name in ("maps", "sigma", "shapes"):
        assert np.array_equal(getattr(back, name), getattr(gassy, name))
    assert back.origin_m == pytest.approx(gassy.origin_m, abs=1e-15)
    assert (back.pixel_m, back.ground_pixel_m, back.rank_residual) == (15e-6, 75.0, gassy.rank_residual)
    assert gassy.source in back.source
    assert [path.name for path in tmp_path.iterdir()] == ["scene.nc"]


def test_saved_scene_opens_with_names_coordinates_and_units(tmp_path, gassy):
    save_scene(gassy, tmp_path / "scene.nc")
    with xarray.open_dataset(tmp_path / "scene.nc", engine="h5netcdf") as data:
        assert data["maps"].dims == ("mode", "y", "x")
        assert data["shapes"].dims == ("mode", "wavenumber")
        assert data["maps"].dtype == np.float32
        assert {name: data[name].attrs["units"] for name in data.variables} == {
            "maps": "1", "mode": "1", "shapes": "W m-2 sr-1 (m-1)-1", "wavenumber": "m-1", "x": "m", "y": "m",
        }  # fmt: skip
        pixel = data["maps"].isel(y=2, x=3)
        assert (pixel * data["shapes"]).sum("mode").values == pytest.approx(gassy.spectrum(2, 3).radiance)
        assert data["y"].values == pytest.approx(gassy.y_m)


def test_saved_scene_keeps_its_place_when_resampled(tmp_path, gassy):
    """Twice the ground pixel: the outer corner stays on its ground point."""
    save_scene(gassy, tmp_path / "scene.nc")
    back = load_scene(tmp_path / "scene.nc", canvas(flat(), ground_pixel_m=150.0))
    assert back.maps == pytest.approx(gassy.maps.reshape(2, 3, 2, 4, 2).mean(axis=(2, 4)), rel=1e-6)
    corner = np.array(gassy.origin_m) - 7.5e-6
    assert (np.array(back.origin_m) - 7.5e-6) * 150.0 == pytest.approx(corner * 75.0)


ALBEDO = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])


def write_tiff(path, values, **keys):
    tifffile = pytest.importorskip("tifffile")
    geo = (1, 1, 0, len(keys), *[number for key, value in keys.items() for number in (int(key[1:]), 0, 1, value)])
    tags = [(33550, "d", 3, (75.0, 75.0, 0.0), True), (34735, "H", len(geo), geo, True)]
    tifffile.imwrite(path, values, extratags=tags, photometric="minisblack")


def write(path, values=ALBEDO):
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".npz":
        np.savez(path, albedo=values)
    elif path.suffix == ".tif":
        write_tiff(path, values, k1024=1, k3076=9001)
    else:
        attrs = {"units": "1"}
        xarray.Dataset({"albedo": (("y", "x"), values, attrs)}).to_netcdf(path, engine="h5netcdf")
    return path


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".nc", ".tif"])
def test_one_map_from_every_kind_of_file(tmp_path, suffix):
    pixel = None if suffix == ".tif" else 75.0
    scene = load_scene(write(tmp_path / f"a{suffix}"), canvas(), file_pixel_m=pixel, orientation="-y+x")
    assert scene.maps[0] * 0.3 == pytest.approx(ALBEDO[::-1], rel=1e-6)
    assert np.array_equal(scene.shapes[0], canvas().spectrum.radiance)
    assert str(tmp_path) in scene.source


def test_numbers_and_per_cent_become_reflectances(tmp_path):
    numbers = write(tmp_path / "a.npy", np.array([[1000, 2000]], np.uint16))
    with pytest.raises(InputError, match="integers, not reflectances"):
        load_scene(numbers, canvas(), **STATED)
    scene = load_scene(numbers, canvas(), scale=1e-4, offset=-0.05, **STATED)
    assert scene.maps[0] * 0.3 == pytest.approx(np.array([[0.05, 0.15]]))
    data = xarray.Dataset(
        {"albedo": (("y", "x"), 100 * ALBEDO, {"units": "%"})}, attrs={"ground_pixel_m": 75.0, "orientation": "+y+x"}
    )
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    assert load_scene(tmp_path / "a.nc", canvas()).maps[0] * 0.3 == pytest.approx(ALBEDO)
    with pytest.raises(InputError, match="states units already"):
        load_scene(tmp_path / "a.nc", canvas(), scale=0.01)


def test_pixel_of_the_file_is_resampled_with_its_axes(tmp_path):
    """Pixels of 150 m along the first axis, which runs across track, and 75 m along the second."""
    scene = load_scene(write(tmp_path / "a.npy"), canvas(), file_pixel_m=(150.0, 75.0), orientation="+x+y")
    assert scene.maps[0] * 0.3 == pytest.approx(np.repeat(ALBEDO, 2, axis=0).T, rel=1e-6)
    assert "resampled" in scene.source


def test_shapes_per_wavelength_are_radiances_per_wavenumber(tmp_path):
    low, high = NIR.support()
    wavelength = np.linspace(1e9 / high, 1e9 / low, 400)
    units = "W m-2 sr-1 nm-1"
    data = xarray.Dataset(
        {
            "maps": (("mode", "y", "x"), np.ones((1, 2, 2))),
            "shapes": (("mode", "wavelength"), np.ones((1, 400)), {"units": units}),
        },
        coords={"wavelength": ("wavelength", wavelength, {"units": "nm"})},
    )
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    scene = load_scene(tmp_path / "a.nc", canvas(), NIR, max_opd_m=1e-3, **STATED)
    assert np.ptp(np.diff(scene.sigma)) < 1e-6 * (scene.sigma[1] - scene.sigma[0])
    assert scene.spectrum(1, 1).radiance == pytest.approx(1e9 / scene.sigma**2, rel=1e-5)
    with pytest.raises(InputError, match="carries OPDs"):
        load_scene(tmp_path / "a.nc", canvas(), NIR, max_opd_m=0.1, **STATED)


def modes(path, **changes):
    spectrum = flat()
    arrays = {
        "maps": np.ones((2, 2, 2)), "sigma": spectrum.sigma, "shapes": np.ones((2, 11)),
        "ground_pixel_m": 75.0, "orientation": "+y+x", **changes,
    }  # fmt: skip
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


@pytest.mark.parametrize(
    ("changes", "field", "problem"),
    [
        ({"maps": np.ones((3, 2, 2))}, "shapes", "not"),
        ({"shapes": np.ones((2, 10))}, "shapes", "not"),
        ({"maps": np.ones((2, 2))}, "maps", "not a map"),
        (
            {"maps": np.full((2, 2, 2), np.nan)},
            "maps",
            "8 of 8 values not finite, the first at mode 0, row 0, column 0",
        ),
        ({"maps": -np.ones((2, 2, 2))}, "maps", "4 of 4 values negative"),
        ({"maps": np.array([1.0, -2.0])[:, None, None] * np.ones((2, 2, 2))}, "maps · shapes", "negative radiance"),
        ({"sigma": flat().sigma / 2}, "wavelength range", "does not cover"),
        ({"sigma": flat().sigma[[0, *range(10)]]}, "sigma", "strictly monotone"),
        ({"sigma": None}, "variables", "do not make a scene"),
        ({"orientation": None}, "orientation", "not stated"),
        ({"orientation": "up"}, "orientation", "unknown"),
        ({"ground_pixel_m": None}, "ground_pixel_m", "not stated"),
        ({"ground_pixel_m": -75.0}, "ground_pixel_m", "not one or two lengths"),
    ],
)
def test_broken_modes_are_refused_by_field(tmp_path, changes, field, problem):
    path = modes(tmp_path / "a.npz", **changes)
    with pytest.raises(InputError, match=problem) as caught:
        load_scene(path, canvas(), NIR)
    assert caught.value.field == field
    assert str(path) in caught.value.file


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        (np.array([[0.1, np.nan]]), "1 of 2 values not finite, the first at mode 0, row 0, column 1"),
        (np.array([[0.1, 0.2], [-0.3, 0.2]]), "1 of 4 values negative, the first at mode 0, row 1, column 0"),
        (np.array([[30.0, 20.0]]), "no reflectance"),
        (np.ones((2, 3, 4)), "several bands"),
        (np.ones(3), "not a map"),
    ],
)
def test_broken_map_is_refused_with_the_place(tmp_path, values, problem):
    with pytest.raises(InputError, match=problem):
        load_scene(write(tmp_path / "a.npy", values), canvas(), **STATED)


def test_statements_that_contradict_are_refused(tmp_path):
    path = modes(tmp_path / "a.npz")
    with pytest.raises(InputError, match="contradicts"):
        load_scene(path, canvas(), file_pixel_m=30.0)
    with pytest.raises(InputError, match="contradicts"):
        load_scene(path, canvas(), orientation="-y+x")
    load_scene(path, canvas(), **STATED)


def test_geotiff_in_degrees_has_no_pixel_and_missing_values_are_found(tmp_path):
    write_tiff(tmp_path / "degrees.tif", ALBEDO.astype(np.float32), k1024=2)
    with pytest.raises(InputError, match="not stated"):
        load_scene(tmp_path / "degrees.tif", canvas(), orientation="+y+x")
    tifffile = pytest.importorskip("tifffile")
    values = np.where(ALBEDO > 0.55, -9999, ALBEDO).astype(np.float32)
    tifffile.imwrite(tmp_path / "holes.tif", values, extratags=[(42113, "s", 0, "-9999", True)])
    with pytest.raises(InputError, match="1 of 6 values not finite, the first at mode 0, row 1, column 2"):
        load_scene(tmp_path / "holes.tif", canvas(), **STATED)


def test_geotiff_without_its_reader_names_the_extra(tmp_path, monkeypatch):
    (tmp_path / "a.tif").write_text("any")
    monkeypatch.setitem(sys.modules, "tifffile", None)
    with pytest.raises(MissingPackageError, match="geotiff"):
        load_scene(tmp_path / "a.tif", canvas(), **STATED)


def test_what_is_no_scene_file_is_refused(tmp_path):
    for name, content in (("a.nc", "text"), ("a.npy", "text"), ("a.tif", "text"), ("a.png", "text")):
        (tmp_path / name).write_text(content)
        with pytest.raises(InputError) as caught:
            load_scene(tmp_path / name, canvas(), **STATED)
        assert caught.value.field == "file"
    with pytest.raises(InputError, match="does not exist"):
        load_scene(tmp_path / "absent.npy", canvas(), **STATED)
    xarray.Dataset({"albedo": (("y", "x"), ALBEDO)}).to_netcdf(tmp_path / "b.nc", engine="h5netcdf")
    with pytest.raises(InputError, match="not those of a reflectance"):
        load_scene(tmp_path / "b.nc", canvas(), **STATED)
    with pytest.raises(InputError, match="cannot be written"):
        save_scene(uniform(canvas(flat()), 1, 1), tmp_path / "absent" / "a.nc")
