"""NetCDF files of a scroll: frames written one by one, and maps over the ground. Whole files or none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.maps import NmaErrors, Retrieved
from cgi_wave.fringes.scroll import Motion
from cgi_wave.report.output import to_json, whole_file

Real = NDArray[np.floating]


def written(
    frames: Iterable[Real], target: str | Path, zone: Zone, moves: Motion, provenance: Mapping[str, Any]
) -> Iterator[Real]:
    """Write frames to a NetCDF file as they pass, and hand them on; ``target`` appears when the last one has passed.

    Variable ``irradiance`` (frame, y, x), float32, relative; coordinates x and y in m, ``scroll`` (frame) in rows. A
    frame is one chunk: nothing of the sequence is held. Whoever stops taking frames before the end leaves no file.

    Raises InputError when the file cannot be written.
    """
    import h5netcdf

    with whole_file(target) as temporary, h5netcdf.File(temporary, "w") as file:
        file.attrs.update({"title": "push-broom frames", "provenance": to_json(provenance)})
        _axes(file, {"frame": None, "y": zone.y_m, "x": zone.x_m}, {"frame": len(moves.rows)})
        _variable(file, "scroll", ("frame",), moves.rows, "row", "ground moved along -y since scroll 0")
        cube = file.create_variable("irradiance", ("frame", "y", "x"), "f4", chunks=(1, *zone.shape))
        cube.attrs.update({"units": "1", "long_name": "irradiance relative to a lossless instrument's input"})
        count = 0
        for count, frame in enumerate(frames, 1):
            cube[count - 1] = frame
            yield frame
        if count != len(moves.rows):
            raise ValueError(f"{count} frames came where the motion has {len(moves.rows)}")


def write_maps(
    maps: Retrieved, target: str | Path, zone: Zone, provenance: Mapping[str, Any], errors: NmaErrors | None = None
) -> None:
    """M, B, NMA, phase and standard error per ground point, (ground, x), and the NMA error map if given."""
    import h5netcdf

    with whole_file(target) as temporary, h5netcdf.File(temporary, "w") as file:
        file.attrs.update({"title": "retrieval on the ground", "provenance": to_json(provenance),
                           "window_rows": maps.window, "window_fringes": maps.fringes})  # fmt: skip
        _axes(file, {"ground": maps.ground.astype(np.float64), "x": zone.x_m}, {})
        _variable(file, "seen", ("ground",), maps.seen, "1", "rows of the window that saw the ground row")
        grid = ("ground", "x")
        for name, values, unit, words in (
            ("baseline", maps.baseline, "1", "baseline B, relative irradiance"),
            ("modulation", maps.modulation, "1", "modulation M, relative irradiance"),
            ("nma", maps.nma, "1", "normalised modulation amplitude M/B"),
            ("phase", maps.phase, "rad", "phase of the fringes against the nominal phase"),
            ("nma_standard_error", maps.nma_error, "1", "standard error of the NMA by detector noise"),
        ):
            _variable(file, name, grid, values, unit, words)
        if errors is not None:
            _variable(file, "nma_bias", grid, errors.error, "1", "1 - NMA with ghosts / NMA without")
            variable = file.variables["nma_bias"]
            variable.attrs.update({"mean": errors.mean, "spread": errors.spread, "percentile_2_5": errors.low,
                                   "percentile_97_5": errors.high,
                                   "percentile_95_of_size": errors.size_95})  # fmt: skip


def _axes(file: Any, axes: Mapping[str, NDArray[np.float64] | None], sizes: Mapping[str, int]) -> None:
    """Dimensions, each with its coordinate: metres on the detector, or numbers of rows and frames."""
    for name, values in axes.items():
        file.dimensions[name] = sizes[name] if values is None else len(values)
        counted = np.arange(sizes[name], dtype=np.float64) if values is None else values
        unit = "m" if name in ("x", "y") else "1"
        words = {
            "x": "across track on the detector",
            "y": "along track on the detector",
            "frame": "number of the frame",
            "ground": "row of the scene",
        }[name]
        _variable(file, name, (name,), counted, unit, words)


def _variable(file: Any, name: str, dimensions: tuple[str, ...], values: NDArray[Any], unit: str, words: str) -> None:
    variable = file.create_variable(name, dimensions, values.dtype, data=values)
    variable.attrs.update({"units": unit, "long_name": words})
