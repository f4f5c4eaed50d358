"""The commands ``frame`` and ``scroll`` on a made-up fringe field, read from a file: nothing is traced."""

import importlib.util
import json
import re
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray

import cgi_wave
from cgi_wave import mosaic
from cgi_wave.budget import scenes
from cgi_wave.budget.setting import band_spectrum
from cgi_wave.cli.main import status
from cgi_wave.fringes.field_file import load_field, save_field
from cgi_wave.fringes.imaging import Span
from cgi_wave.optics.system import load_instrument


def _synthetic():
    path = Path(__file__).parents[1] / "fringes" / "synthetic_fields.py"
    spec = importlib.util.spec_from_file_location("wide_synthetic_fields", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.BAND = (module.SIGMA0 - 1.4e4, module.SIGMA0 + 1.4e4)  # the support of the band's filter
    return module


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the field of 32 × 40 pixels, three fringes, one shaded edge."""
    made = _synthetic()
    path = tmp_path_factory.mktemp("field")
    field = made.michelson(rows=(100, 132), columns=(40, 80), shadows=(made.dark_row(100),))
    save_field(field, path / "field.nc", {"instrument_hash": load_instrument(None).hash, "tolerance": 1e-3})
    return path


@cache
def _light():
    """The band's light, sampled for the millimetres of this field instead of the metres of a real one: quick."""
    return band_spectrum(load_instrument(None).band("NIR"), 0.004)


@pytest.fixture
def call(capsys, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(scenes, "band_spectrum", lambda system: _light())

    def run(command, *words):
        code = status([command, "NIR", "--field", str(folder / "field.nc"), *words])
        streams = capsys.readouterr()
        return code, streams.out, streams.err

    run.field = load_field(folder / "field.nc")
    return run


def test_frame_is_a_file_that_xarray_opens_and_figures(call, tmp_path):
    code, out, err = call("frame", "--scene", "quadrants", "--out", "frame.nc", "--pictures", "pictures", "--json")
    assert code == 0, err
    figures = json.loads(out)
    with xarray.open_dataset(tmp_path / "frame.nc", engine="h5netcdf") as data:
        assert data.frame.dims == ("row", "column") and data.frame.shape == (32, 40)
        assert {data[name].attrs["units"] for name in ("x_m", "y_m", "opd")} == {"m"}
        assert list(data.row.values[[0, -1]]) == [100, 131]
        np.testing.assert_allclose(np.diff(data.y_m), 15e-6)
        assert float(data.frame.mean()) == pytest.approx(figures["mean"], rel=1e-12)
        assert float(data.opd.mean()) == pytest.approx(1.33e-3, rel=1e-3)
        assert json.loads(data.attrs["provenance"])["options"]["scene"] == "quadrants"
        assert json.loads(data.attrs["figures"])["errors"] == figures["errors"]
        assert data.attrs["error_bound"] == figures["error"] == pytest.approx(sum(figures["errors"].values()))
        ghosts = float(np.abs(data.frame - data.nominal).max())
    assert ghosts > 1e-3
    assert figures["layers"] == 2 and figures["dead_rows"] == [[100, 103]]  # the row 103.5 is 3.5 pixels from the edge
    assert [file.name for file in (tmp_path / "pictures").iterdir()] == ["NIR-frame.png"]
    assert "scene" in err and "reading the fringe field" in err


def test_without_ghosts_the_frame_is_the_nominal_one(call, tmp_path):
    assert call("frame", "--scene", "uniform", "--out", "all.nc")[0] == 0
    assert call("frame", "--scene", "uniform", "--out", "bare.nc", "--no-ghosts")[0] == 0
    with (
        xarray.open_dataset(tmp_path / "all.nc", engine="h5netcdf") as both,
        xarray.open_dataset(tmp_path / "bare.nc", engine="h5netcdf") as bare,
    ):
        np.testing.assert_array_equal(bare.frame, bare.nominal)
        np.testing.assert_array_equal(bare.frame, both.nominal)
        assert float(np.abs(both.frame - bare.frame).max()) > 1e-3


def test_a_shifted_scene_is_the_next_frame_of_the_scroll(call, tmp_path):
    """Frame k of the sequence, with a step of one row, is the frame with the scene moved by k rows."""
    words = ["--scene", "quadrants", "--frames", "40"]
    code, out, err = call("scroll", *words, "--frames-out", "frames.nc", "--out", "maps.nc", "--json")
    assert code == 0, err
    figures = json.loads(out)
    ground = cgi_wave.band_scene(load_instrument(None).band("NIR"), "quadrants", 40, zone=call.field.zone)
    one = cgi_wave.frame("NIR", ground, shift=7.0, field=call.field)
    with xarray.open_dataset(tmp_path / "frames.nc", engine="h5netcdf") as data:
        assert data.frames.dims == ("frame", "row", "column") and data.frames.shape == (40, 32, 40)
        np.testing.assert_allclose(data.frames[7], one.frame, atol=3e-6)
        assert float(np.abs(data.frames[8] - one.frame).max()) > 1e-2
    with xarray.open_dataset(tmp_path / "maps.nc", engine="h5netcdf") as data:
        assert data.nma_error.dims == ("row", "column")
        assert data.nma_error.shape == (figures["ground_rows"], 40)
        assert float(data.nma_error.mean()) == pytest.approx(figures["nma_error"]["mean"], rel=1e-12)
        np.testing.assert_allclose(data.recorded_nma, data.recorded_modulation / data.recorded_baseline)
        assert data.recorded_nma.attrs["units"] == "1"


def test_a_uniform_scene_has_one_row_over_and_over_and_noise_comes_by_seed(call):
    words = ["--scene", "uniform", "--frames", "40"]
    quiet = cgi_wave.scroll("NIR", "uniform", 40, field=call.field)
    assert quiet.relation is None
    np.testing.assert_allclose(quiet.errors.error, quiet.errors.error[:1] + 0 * quiet.errors.error, atol=1e-5)
    same = [call("scroll", *words, "--noise", "1e5", "--seed", seed, "--json") for seed in ("1", "1", "2")]
    means = [json.loads(out)["nma_error"]["mean"] for _, out, _ in same]
    assert means[0] == means[1] != means[2]
    assert means[0] == pytest.approx(quiet.errors.mean, abs=1e-2)


def test_tdi_keeps_what_it_says_of_the_nma(call):
    """Means over two rows: NMA times |sin(2π/P)/(2 sin(π/P))|, apart from the ground's part, none here."""
    field = replace(call.field, shadows=())
    one, two = (cgi_wave.scroll("NIR", "uniform", 40, tdi=rows, field=field) for rows in (1, 2))
    assert two.tdi.rows == 2 and two.tdi.contrast < 0.97
    ratio = two.nominal.nma.mean() / one.nominal.nma.mean()
    assert ratio == pytest.approx(two.tdi.contrast, abs=5e-3)


def test_scroll_writes_its_pictures_and_a_movie(call, tmp_path):
    code, _, err = call("scroll", "--scene", "quadrants", "--frames", "40", "--pictures", "p", "--movie", "m.gif")
    assert code == 0, err
    names = {file.name for file in (tmp_path / "p").iterdir()}
    assert names == {f"NIR-{name}.png" for name in ("point", "point-spectrum", "nma-error", "waterfall")}
    assert (tmp_path / "m.gif").read_bytes().startswith(b"GIF89a")


def test_an_mp4_goes_through_ffmpeg_and_is_refused_by_name_without_it(call, tmp_path, monkeypatch):
    """In the place of ffmpeg a program that keeps the raw pictures: all of one size, as many as there are stills."""
    words = ["scroll", "--scene", "quadrants", "--frames", "40", "--movie", "m.mp4"]
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    code, out, err = call(*words)
    assert (code, out) == (2, "") and all(word in err for word in ("--movie", "m.mp4", "install ffmpeg", ".gif"))
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "ffmpeg"
    keep = "import sys; open(sys.argv[-1], 'wb').write(' '.join(sys.argv).encode() + b'|' + sys.stdin.buffer.read())"
    program.write_text(f"#!{sys.executable}\n{keep}\n")
    program.chmod(0o755)
    code, _, err = call(*words)
    assert code == 0, err
    said, _, pictures = (tmp_path / "m.mp4").read_bytes().partition(b"|")
    width, height = map(int, re.search(rb"-s (\d+)x(\d+)", said).groups())
    assert width % 2 == height % 2 == 0  # what H.264 can code
    assert len(pictures) == 24 * width * height * 4


def test_bits_and_full_well_limit_what_is_recorded(call, tmp_path):
    """Counts are whole steps of the full well; light beyond it is cut off, and pixels counted."""
    words = ["--scene", "uniform", "--frames", "40", "--noise", "1e5", "--shot", "none", "--full-well", "4e4", "--json"]
    code, out, err = call("scroll", *words, "--bits", "6", "--frames-out", "frames.nc")
    assert code == 0, err
    with xarray.open_dataset(tmp_path / "frames.nc", engine="h5netcdf") as data:
        counts = data.frames.to_numpy().astype(float) * 1e5 / (4e4 / 63)
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-4)
    assert counts.max() == pytest.approx(63.0, rel=1e-6)
    figures = json.loads(out)
    assert 0 < figures["saturated"] <= int((np.rint(counts) == 63).sum())  # the last step begins half of it earlier
    assert json.loads(call("scroll", *words, "--bits", "16")[1])["saturated"] == figures["saturated"]


def test_parts_of_a_point_are_those_of_its_frames(call, tmp_path):
    """Nominal and parasitic part, pixel by pixel, as the frames have them; families add up to what ghosts add."""
    found = cgi_wave.scroll("NIR", "quadrants", 40, field=call.field)
    ground = int(found.nominal.ground[2])
    parts = cgi_wave.point_parts(found.ready, found.moves, ground, 11)
    for j, nominal, ghosts in zip(parts.rows, parts.nominal, parts.parasitic, strict=True):
        shift = float(ground - round(found.ready.zone.row) - j)
        images = found.ready.at(Span(shift, shift))
        bare = images.nominal_beams.frame(shift)[j, 11]
        assert nominal == pytest.approx(bare, abs=1e-6)
        assert ghosts == pytest.approx(images.beams.frame(shift)[j, 11] - bare, abs=3e-6)
    assert set(parts.parts) == {"flipped", "onto itself"}
    np.testing.assert_allclose(sum(parts.parts.values()) + parts.rest, parts.parasitic, atol=1e-12)
    assert np.abs(parts.rest).max() < 2e-6  # no pair joins the two families
    # The family's own pair runs at twice the nominal fringes: 2·1.2e-6 m per half zone.
    nominal = 1.2e-6 / 0.764e-6 / (16 * 15e-6)
    assert any(at == pytest.approx(2.0 * nominal, rel=0.05) for _, at, _ in parts.lines)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["frame", "--out", "frame.tif"], ["--out", ".nc"]),
        (["frame", "--shift", "-1"], ["shift", "-1.0"]),
        (["frame", "--scene", "moon"], ["name", "moon", "landsat"]),
        (["frame", "--tolerance", "0"], ["--tolerance"]),
        (["frame", "--scene", "small.npy"], ["rows", "missing"]),
        (["scroll", "--scene", "small.npy"], ["missing"]),
        (["frame", "--tolerance", "0.01"], ["field.nc", "tolerance", "0.001"]),
        (["scroll", "--frames", "0"], ["frames", "0"]),
        (["scroll", "--frames", "5"], ["frames", "5", "no ground point"]),
        (["scroll", "--step", "-1"], ["step", "-1.0"]),
        (["scroll", "--attitude", "3"], ["--attitude", "0.3,120"]),
        (["scroll", "--read", "3"], ["--read", "--noise"]),
        (["scroll", "--movie", "movie.avi"], ["--movie", "movie.avi", ".gif", ".mp4"]),
        (["scroll", "--bits", "12"], ["--bits", "12", "--noise"]),
        (["scroll", "--full-well", "1e5"], ["--full-well", "--noise"]),
        (["scroll", "--noise", "1e5", "--bits", "12"], ["bits", "12", "full well"]),
        (["scroll", "--noise", "1e5", "--full-well", "-3"], ["full_well", "-3.0"]),
        (["scroll", "--frames-out", "frames.npy"], ["--frames-out", ".nc"]),
    ],
)
def test_what_cannot_be_done_is_refused_by_name_and_leaves_nothing(call, tmp_path, words, said):
    if "small.npy" in words:
        np.savez(tmp_path / "small.npz", albedo=np.ones((9, 40)), ground_pixel_m=75.0, orientation="+y+x")
        words = ["small.npz" if word == "small.npy" else word for word in words]
    before = set(tmp_path.iterdir())
    code, out, err = call(words[0], *words[1:], *([] if "--out" in words else ["--out", "x.nc"]))
    assert (code, out) == (2, ""), err
    assert all(word in err for word in said), err
    assert set(tmp_path.iterdir()) == before


@pytest.fixture
def fields(tmp_path, monkeypatch):
    """A folder with made-up fields of both bands of one detector, rows apart from each other, and their light."""
    made = _synthetic()
    loaded = load_instrument(None)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fields").mkdir()
    lights = {}
    for band, rows in (("NIR", (100, 132)), ("VIS", (132, 156))):
        system = loaded.band(band)
        made.SIGMA0 = system.sigma0
        made.BAND = tuple(1.0 / (system.spec.filter.centre_nm * 1e-9 * s) for s in (1.02, 0.98))
        field = replace(made.michelson(opd=2e-5, rows=rows, columns=(40, 80)), band=band)
        save_field(field, tmp_path / "fields" / f"{band}.nc", {"instrument_hash": loaded.hash, "tolerance": 1e-3})
        lights[band] = band_spectrum(system, 0.004)
    monkeypatch.setattr(scenes, "band_spectrum", lambda system: lights[system.band])
    zones = {"NIR": (100, 132), "VIS": (132, 156)}
    monkeypatch.setattr(mosaic, "zone_rows_lit", lambda _, system: (zones[system.band], (None, None)))
    return tmp_path / "fields"


@pytest.mark.parametrize("name", ["VIS,NIR", "detector"])
def test_a_whole_detector_is_its_zones_side_by_side(fields, capsys, tmp_path, name):
    """Every band's rows are its own frame over the scene's part there; rows of no band are dark and named as such."""
    words = ["--scene", "quadrants", "--field", str(fields), "--out", "all.nc", "--pictures", "p", "--json"]
    assert status(["frame", name, *words]) == 0
    figures = json.loads(capsys.readouterr().out)
    with xarray.open_dataset(tmp_path / "all.nc", engine="h5netcdf") as data:
        assert data.frame.shape == (1024, 1024)
        band = data.band.to_numpy()
        assert list(band[[99, 100, 131, 132, 155, 156]]) == ["", "NIR", "NIR", "VIS", "VIS", ""]
        assert float(np.abs(data.frame[band == ""]).max()) == 0.0
        np.testing.assert_allclose(data.y_m[[0, 1023]], [-511.5 * 15e-6, 511.5 * 15e-6])
        whole, bare = data.frame.to_numpy(), data.nominal.to_numpy()
        assert "another" in data.attrs["absent"]
    assert figures["rows_of_no_band"] == [[0, 100], [156, 1024]]
    assert figures["error"] == max(part["error"] for part in figures["bands"].values())
    for band, rows in (("NIR", slice(100, 132)), ("VIS", slice(132, 156))):
        # the scene has the detector's columns and the rows of both zones; a zone's part of it is cut out here
        across = (-512 * 15e-6, 512 * 15e-6, (100 - 512) * 15e-6, (156 - 512) * 15e-6)
        ground = cgi_wave.band_scene(load_instrument(None).band(band), "quadrants", zone=across)
        part = replace(ground, maps=ground.maps[:, rows.start - 100 : rows.stop - 100, 40:80])
        assert (np.ptp(part.maps) > 0.0) == (band == "NIR")  # the bright quadrants begin within its rows
        own = cgi_wave.frame(band, part, field=load_field(fields / f"{band}.nc"))
        np.testing.assert_allclose(bare[rows, 40:80], own.nominal, atol=1e-12)
        assert 1e-3 < np.abs(whole[rows, 40:80] - bare[rows, 40:80]).max() < 0.1
    assert [file.name for file in (tmp_path / "p").iterdir()] == ["detector-frame.png"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["VIS,SWIR2"], ["BAND", "detector", "swir_detector"]),
        (["VIS,UV"], ["BAND", "UV", "VISNIR", "swir_detector"]),
        (["VIS,NIR", "--field", "one.nc"], ["--field", "one.nc", "folder"]),
        (["VIS,NIR", "--scene", "moon"], ["moon", "landsat"]),
        (["VIS,NIR", "--shift", "-2"], ["shift", "-2.0"]),
    ],
)
def test_what_no_detector_has_is_refused(capsys, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    assert status(["frame", *words, "--out", "x.nc"]) == 2
    err = capsys.readouterr().err
    assert all(word in err for word in said), err
    assert list(tmp_path.iterdir()) == []


def test_unknown_bands_are_refused(capsys):
    for command in ("frame", "scroll"):
        assert status([command, "UV"]) == 2
        err = capsys.readouterr().err
        assert all(word in err for word in ("BAND", "UV", "NIR"))


def test_tdi_beyond_a_quarter_of_a_fringe_is_outside_the_method(call, tmp_path):
    code, out, err = call("scroll", "--scene", "uniform", "--frames", "40", "--tdi", "5", "--out", "maps.nc")
    assert (code, out) == (1, "") and "a quarter" in err
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_leaves_no_file(call, tmp_path, monkeypatch):
    from cgi_wave.report import frame_file

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(frame_file, "write_maps", interrupted)
    words = [
        "--scene",
        "uniform",
        "--frames",
        "40",
        "--out",
        "maps.nc",
        "--frames-out",
        "frames.nc",
        "--movie",
        "m.gif",
    ]
    assert call("scroll", *words)[0] == 130
    assert list(tmp_path.iterdir()) == []
