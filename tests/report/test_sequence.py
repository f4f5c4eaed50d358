"""Files of a scroll: named dimensions and units that xarray opens, and no file at all when it was interrupted."""

import numpy as np
import pytest
import xarray

from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.maps import nma_errors, retrieve_ground
from cgi_wave.fringes.scroll import motion
from cgi_wave.report.sequence import write_maps, written

ROWS, COLUMNS, PERIOD = 40, 5, 8.0
PHASE = np.broadcast_to(2.0 * np.pi * np.arange(ROWS)[:, None] / PERIOD, (ROWS, COLUMNS))
ZONE = Zone(np.arange(COLUMNS) * 15e-6, np.arange(ROWS) * 15e-6)


def frames(count, offset=0.0):
    for k in range(count):
        yield (1.0 + 0.01 * k + offset) * (1.0 + 0.4 * np.cos(PHASE))


def test_frames_pass_through_a_file(tmp_path):
    target, moves = tmp_path / "frames.nc", motion(6, 0.5)
    passed = [frame.copy() for frame in written(frames(6), target, ZONE, moves, {"version": "test"})]
    assert len(passed) == 6
    with xarray.open_dataset(target, engine="h5netcdf") as file:
        assert file.irradiance.dims == ("frame", "y", "x")
        np.testing.assert_allclose(file.irradiance, passed, rtol=1e-7)
        np.testing.assert_array_equal(file.scroll, moves.rows)
        np.testing.assert_array_equal(file.y, ZONE.y_m)
        assert file.y.units == "m" and file.irradiance.units == "1" and "test" in file.provenance


def test_an_interrupted_scroll_leaves_nothing(tmp_path):
    run = written(frames(6), tmp_path / "frames.nc", ZONE, motion(6), {})
    next(run)
    with pytest.raises(KeyboardInterrupt):
        run.throw(KeyboardInterrupt())
    early = written(frames(6), tmp_path / "early.nc", ZONE, motion(6), {})
    next(early)
    early.close()
    with pytest.raises(ValueError, match="5 frames came"):
        list(written(frames(5), tmp_path / "short.nc", ZONE, motion(6), {}))
    assert list(tmp_path.iterdir()) == []


def test_maps_open_with_names_and_units(tmp_path):
    clean = retrieve_ground(frames(50), PHASE, motion(50), dtype=np.float64)
    dirty = retrieve_ground(frames(50, 0.1), PHASE, motion(50), dtype=np.float64)
    errors = nma_errors(clean, dirty)
    write_maps(clean, tmp_path / "maps.nc", ZONE, {"seed": 1}, errors)
    with xarray.open_dataset(tmp_path / "maps.nc", engine="h5netcdf") as file:
        assert file.nma.dims == ("ground", "x") and file.phase.units == "rad"
        np.testing.assert_array_equal(file.ground, clean.ground)
        np.testing.assert_array_equal(file.nma, clean.nma)
        assert file.nma_bias.attrs["mean"] == errors.mean
