"""Tables of coatings: smooth between their points, silent beyond them, the same from TOML, CSV and NPZ."""

import copy

import msgspec
import numpy as np
import pytest

from cgi_wave.errors import InputError
from cgi_wave.optics.coatings import coating_table
from cgi_wave.optics.schema import CoatingSpec
from cgi_wave.optics.system import from_document, load_instrument

SMALL = """
name = "small"
[space]
front = "air"
[coating.face]
table = {table}
[entrance]
space = "front"
radius_mm = 1.0
back_off_mm = 5.0
[detector]
surface = "detector"
pixel_um = 10.0
columns = 10
rows = 10
[[frame]]
name = "all"
before = "front"
start_mm = 10.0
[[frame.surface]]
name = "detector"
after = ""
coating = "face"
nominal = "absorb"
aperture = {{ radius_mm = 5.0 }}
[band.B]
zone_rows = [0, 10]
wavelengths_nm = [500.0]
filter = {{ centre_nm = 500.0, fwhm_nm = 1.0 }}
spectrum = {{ kind = "solar" }}
target_opd_mm = 0.0
"""
GRID = {"wavelengths_nm": [450.0, 500.0, 550.0], "angles_deg": [0.0, 20.0, 40.0],
        "reflectance": [[0.1, 0.12, 0.2], [0.11, 0.13, 0.22], [0.15, 0.16, 0.3]]}  # fmt: skip


def table(**fields):
    return coating_table("c", msgspec.convert({"table": fields}, CoatingSpec), "file.toml")


def smooth(nm, theta):
    """An R over wavelength and angle that no polynomial equals."""
    return 0.3 + 0.2 * np.sin(nm / 40.0) * np.cos(3.0 * theta)


def error(count):
    nm, angle = np.linspace(450, 550, count), np.linspace(0, 50, count)
    one = table(wavelengths_nm=nm.tolist(), angles_deg=angle.tolist(),
                reflectance=smooth(nm[:, None], np.radians(angle)).tolist())  # fmt: skip
    theta = np.radians(np.linspace(1, 49, 200))
    film = one.film(1 / 497.3e-9)
    return np.abs(film.at(1 - np.cos(theta))[0] - smooth(497.3, theta)).max()


def test_interpolation_is_of_fourth_order():
    coarse, fine = error(13), error(25)
    assert fine < 1e-3
    assert 10 < coarse / fine < 40


def test_no_kink_at_a_point_of_the_table_and_none_at_normal_incidence():
    """Value, slope and curvature go on across a knot; in angle the slope at 0 vanishes."""
    one = table(**GRID | {"angles_deg": [0.0, 20.0, 40.0]}).film(1 / 510e-9)
    knot = one.knot[1]
    for order in range(3):
        left, right = (np.polyval(np.polyder(piece, order), at)
                       for piece, at in ((one.r[0], knot - one.knot[0]), (one.r[1], 0.0)))  # fmt: skip
        assert left == pytest.approx(right, rel=1e-10)
    step = 1e-4
    r = one.at(1 - np.cos([0.0, step]))[0]
    assert abs(r[1] - r[0]) < 10 * step**2


def test_points_of_the_table_are_met_and_the_rest_is_transmitted():
    one = table(**GRID, absorptance=0.02)
    u = 1 - np.cos(np.radians(GRID["angles_deg"]))
    for nm, row in zip(GRID["wavelengths_nm"], GRID["reflectance"], strict=True):
        r, t = one.film(1 / (nm * 1e-9)).at(u)
        assert r == pytest.approx(row, abs=1e-14)
        assert r + t == pytest.approx(0.98, abs=1e-14)
    assert not one.lossless and table(**GRID).lossless


def test_unpolarised_light_takes_the_mean_of_both_polarisations():
    s, p = np.array(GRID["reflectance"]), 0.5 * np.array(GRID["reflectance"])
    fields = {k: v for k, v in GRID.items() if k != "reflectance"}
    one = table(**fields, reflectance_s=s.tolist(), reflectance_p=p.tolist())
    sigma, u = 1 / 480e-9, np.array([0.01, 0.1])
    by_s, by_p, mean = (one.film(sigma, which).at(u)[0] for which in ("s", "p", ""))
    assert by_p == pytest.approx(0.5 * by_s)
    assert mean == pytest.approx(0.75 * by_s)


@pytest.mark.parametrize(
    "change, field",
    [
        ({"wavelengths_nm": [500.0, 450.0, 550.0]}, "wavelengths_nm"),
        ({"angles_deg": [0.0, 20.0, 95.0]}, "angles_deg"),
        ({"angles_deg": [0.0, 20.0]}, "reflectance"),
        ({"angles_deg": None}, "angles_deg"),
        ({"wavelengths_nm": None, "file": "x.csv"}, "file"),
        ({"reflectance": None}, "reflectance"),
        ({"reflectance": [[0.1, 0.2, 1.3]] * 3}, "reflectance"),
        ({"reflectance_s": [[0.1, 0.2, 0.3]] * 3, "reflectance_p": [[0.1, 0.2, 0.3]] * 3}, "reflectance"),
        ({"reflectance": None, "reflectance_s": [[0.1, 0.2, 0.3]] * 3}, "reflectance"),
        ({"transmittance": [[0.95, 0.95, 0.9]] * 3}, "transmittance"),
    ],
)
def test_what_is_no_table_is_refused_by_name(change, field):
    fields = {key: value for key, value in (copy.deepcopy(GRID) | change).items() if value is not None}
    with pytest.raises(InputError, match=rf"coating\.c\.table\.{field} "):
        table(**fields)


def test_a_spline_that_rings_is_refused():
    ringing = [0.0, 0.0, 0.9, 0.9, 0.0, 0.0]
    one = table(wavelengths_nm=[450.0, 550.0], angles_deg=[0, 10, 11, 20, 21, 30], reflectance=[ringing] * 2)
    with pytest.raises(InputError, match="leaves the range from 0 to 1"):
        one.film(1 / 500e-9)


def load(folder, text):
    (folder / "small.toml").write_text(SMALL.format(table=text), encoding="utf-8")
    return load_instrument(folder / "small.toml")


def test_toml_csv_and_npz_say_the_same(tmp_path):
    inline = ", ".join(f"{key} = {value}" for key, value in GRID.items())
    lines = [f"{w},{a},{r}" for w, row in zip(GRID["wavelengths_nm"], GRID["reflectance"], strict=True)
             for a, r in zip(GRID["angles_deg"], row, strict=True)]  # fmt: skip
    csv = tmp_path / "face.csv"
    csv.write_text("# measured\nwavelength_nm,angle_deg,reflectance\n" + "\n".join(lines[::-1]) + "\n")
    np.savez(tmp_path / "face.npz", **GRID)
    loaded = [load(tmp_path, text) for text in (f"{{ {inline} }}", '{ file = "face.csv" }', '{ file = "face.npz" }')]
    tables = [one.band("B").surfaces[0].tables[0] for one in loaded]
    for other in tables[1:]:
        assert np.array_equal(other.r, tables[0].r) and np.array_equal(other.u, tables[0].u)
    before = loaded[1].hash
    csv.write_text(csv.read_text().replace("0.22", "0.23"))
    assert load(tmp_path, '{ file = "face.csv" }').hash != before


@pytest.mark.parametrize(
    "name, content, word",
    [("gone.csv", None, "cannot be read"), ("face.txt", "", "neither"),
     ("face.csv", "wavelength_nm,angle\n1,2\n", "unknown"),
     ("face.csv", "wavelength_nm,angle_deg,reflectance\n450,0,0.1\n450,1,0.1\n500,0,0.1\n", "no whole grid"),
     ("face.csv", "wavelength_nm,angle_deg,reflectance\n450,0,x\n", "cannot be read"),
     ("face.npz", "no archive", "cannot be read")],
)  # fmt: skip
def test_files_that_are_no_tables_are_refused(tmp_path, name, content, word):
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=word):
        load(tmp_path, f'{{ file = "{name}" }}')


def test_a_file_beside_numbers_is_refused(tmp_path):
    with pytest.raises(InputError, match="stands beside angles_deg"):
        load(tmp_path, '{ file = "face.csv", angles_deg = [0.0, 1.0] }')


@pytest.mark.parametrize(
    "change, field",
    [
        ({"ar": {"reflectance": 0.1, "transmittance": 0.9, "reverse": "nothing"}}, r"coating\.ar\.reverse = 'nothing'"),
        ({"ar": {"bare": True, "table": GRID}}, r"coating\.ar\.bare"),
        ({"ar": {"scatter": {"tis": 0.7, "l": 0.01, "s": -1.5}}}, r"coating\.ar\.scatter"),
        ({"ar": {"scatter": {"tis": 0.1, "l": 0.0, "s": -1.5}}}, r"coating\.ar\.scatter"),
        ({"ar": {"table": GRID | {"wavelengths_nm": [400.0, 500.0, 800.0], "absorptance": 0.02}}},
         r"coating\.ar\.reverse = None.*is met from both sides"),
        ({"ar": {"table": GRID}}, r"coating\.ar\.table\.wavelengths_nm"),
    ],
)  # fmt: skip
def test_coatings_that_make_no_instrument_are_refused(change, field):
    raw = copy.deepcopy(load_instrument().raw)
    raw["coating"] |= copy.deepcopy(change)
    with pytest.raises(InputError, match=field):
        from_document(raw, "file.toml")
