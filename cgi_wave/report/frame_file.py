"""Frames, sequences of frames and maps of the ground as NetCDF files that xarray opens."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.report.output import to_json

if TYPE_CHECKING:
    from cgi_wave.frames import Frame
    from cgi_wave.mosaic import DetectorFrame
    from cgi_wave.scrolling import Scrolled

RELATIVE = "irradiance relative to the input under the reference spectrum"


def check_netcdf(name: str, field: str) -> None:
    """Raise InputError unless the file's name ends in .nc."""
    if Path(name).suffix.lower() != ".nc":
        raise InputError("command line", field, name, "is not a format for frames and maps", "end its name in .nc")


def frame_figures(found: Frame) -> dict[str, Any]:
    """What is said of a frame in JSON and in the attributes of its file."""
    return {
        "band": found.band,
        "rows": list(found.rows),
        "columns": list(found.columns),
        "mean": found.mean,
        "rms_contrast": found.rms_contrast,
        "fringe_contrast": found.fringe_contrast,
        "opd_range_m": [float(found.opd_m.min()), float(found.opd_m.max())],
        "error": found.error,
        "errors": found.errors,
        "dead_rows": [list(span) for span in found.dead_rows],
        "shadows": [{"arm": s.arm, "y_m": s.y_m, "half_width_m": s.half_width_m} for s in found.shadows],
        "layers": len(found.layers),
        "plans": _plans(found.plans),
        "scene": found.scene,
        "shift_rows": found.shift,
        "seconds": found.seconds,
    }


#: What a frame of several bands lacks.
ABSENT = "light of one band that arrives on another one's rows"


def detector_figures(found: DetectorFrame) -> dict[str, Any]:
    """What is said of a whole detector's frame in JSON and in the attributes of its file."""
    return {
        "detector": found.detector,
        "bands": {part.band: frame_figures(part) for part in found.parts},
        "rows_of_no_band": [list(span) for span in found.empty_rows],
        "error": found.error,
        "absent": ABSENT,
        "scene": found.scene,
        "shift_rows": found.shift,
    }


def scroll_figures(found: Scrolled) -> dict[str, Any]:
    """What is said of a scroll in JSON and in the attributes of its file."""
    errors, relation, tdi = found.errors, found.relation, found.tdi
    return {
        "band": found.band,
        "frames": found.frames,
        "ground_rows": len(found.nominal.ground),
        "columns": len(found.x_m),
        "window_rows": found.nominal.window,
        "fringes": found.nominal.fringes,
        "rows_per_fringe": found.rows_per_fringe,
        "nma_nominal_mean": float(found.nominal.nma.mean()),
        "nma_recorded_mean": float(found.recorded.nma.mean()),
        "nma_error": {
            "mean": errors.mean, "spread": errors.spread, "low": errors.low, "high": errors.high,
            "size_95": errors.size_95, "unlit": errors.unlit,
        },
        "nma_noise": float(found.recorded.nma_error.mean()),
        "relation": None if relation is None else {
            "contrast": relation.centre, "nma_error_mean": relation.mean, "nma_error_spread": relation.spread,
            "points": relation.count, "slope": relation.slope, "correlation": relation.correlation,
        },
        "tdi": None if tdi is None else {
            "rows": tdi.rows, "contrast": tdi.contrast, "smear_rows": tdi.smear_rows, "warning": tdi.warning,
        },
        "saturated": found.saturated,
        "error": found.error,
        "errors": found.errors_by_part,
        "plans": _plans(found.plans),
        "scene": found.scene,
        "seconds": found.seconds,
    }  # fmt: skip


def write_frame(path: Path, found: Frame, provenance: Mapping[str, Any]) -> None:
    """Variables frame, nominal, opd, phase over (row, column); x_m, y_m beside the pixel numbers."""
    import xarray

    pixel = ("row", "column")
    phase = (2.0 * np.pi * found.sigma0 * found.opd_m) % (2.0 * np.pi)
    data = xarray.Dataset(
        {
            "frame": (pixel, found.frame, {"units": "1", "long_name": RELATIVE}),
            "nominal": (pixel, found.nominal, {"units": "1", "long_name": f"{RELATIVE}, without ghosts"}),
            "opd": (pixel, found.opd_m, {"units": "m", "long_name": "path difference of the nominal beams"}),
            "phase": (pixel, phase, {"units": "rad", "long_name": "2 pi sigma0 opd, modulo 2 pi"}),
        },
        coords=_coordinates(np.arange(*found.rows), np.arange(*found.columns), found.y_m, found.x_m),
        attrs={
            "title": f"frame of band {found.band}", "sigma0_per_m": found.sigma0, "error_bound": found.error,
            "scene": found.scene, "figures": to_json(frame_figures(found)), "provenance": to_json(provenance),
        },
    )  # fmt: skip
    _write(data, path, ("opd", "phase"))


def write_detector(path: Path, found: DetectorFrame, provenance: Mapping[str, Any]) -> None:
    """Variables frame, nominal, opd over (row, column) of the whole detector, and the band of every row."""
    import xarray

    pixel = ("row", "column")
    own = "irradiance relative to the input of the row's band under its reference spectrum"
    dark = "0 on pixels of no band"
    data = xarray.Dataset(
        {
            "frame": (pixel, found.frame, {"units": "1", "long_name": own, "comment": dark}),
            "nominal": (pixel, found.nominal, {"units": "1", "long_name": f"{own}, without ghosts", "comment": dark}),
            "opd": (pixel, found.opd_m,
                    {"units": "m", "long_name": "path difference of the nominal beams", "comment": dark}),
            "band": ("row", found.band.astype(object), {"long_name": "band whose glass and filter fill the row"}),
        },
        coords=_coordinates(np.arange(len(found.y_m)), np.arange(len(found.x_m)), found.y_m, found.x_m),
        attrs={
            "title": f"frame of {found.detector}", "error_bound": found.error, "scene": found.scene, "absent": ABSENT,
            "figures": to_json(detector_figures(found)), "provenance": to_json(provenance),
        },
    )  # fmt: skip
    _write(data, path, ("frame", "nominal", "opd"))


def write_maps(path: Path, found: Scrolled, provenance: Mapping[str, Any]) -> None:
    """Maps over (row, column), rows those of the scene: M, B, NMA with and without ghosts, errors, contrast."""
    import xarray

    pixel = ("row", "column")
    variables: dict[str, tuple[Any, ...]] = {}
    for name, maps in (("nominal", found.nominal), ("recorded", found.recorded)):
        text = "without ghosts and noise" if name == "nominal" else "as recorded"
        variables |= {
            f"{name}_modulation": (pixel, maps.modulation, {"units": "1", "long_name": f"M, {text}"}),
            f"{name}_baseline": (pixel, maps.baseline, {"units": "1", "long_name": f"B, {text}"}),
            f"{name}_nma": (pixel, maps.nma, {"units": "1", "long_name": f"M/B, {text}"}),
        }
    variables |= {
        "nma_error": (
            pixel,
            found.errors.error,
            {"units": "1", "long_name": "1 - recorded/nominal NMA; 0 where unlit"},
        ),
        "nma_noise": (pixel, found.recorded.nma_error, {"units": "1", "long_name": "standard error by detector noise"}),
        "albedo_contrast": (pixel, found.contrast, {"units": "1", "long_name": "(own - around)/(own + around)"}),
        "seen": ("row", found.recorded.seen, {"units": "1", "long_name": "rows that the fit had"}),
        "ground_moved": ("frame", found.moves.rows, {"units": "1", "long_name": "rows moved along -y in each frame"}),
    }
    if found.relation is not None:
        variables |= {
            "relation_contrast": ("bin", found.relation.centre, {"units": "1"}),
            "relation_nma_error": ("bin", found.relation.mean, {"units": "1"}),
            "relation_spread": ("bin", found.relation.spread, {"units": "1"}),
        }
    data = xarray.Dataset(
        variables,
        coords={
            **_coordinates(found.nominal.ground, np.arange(len(found.x_m)), found.y_m, found.x_m),
            "frame": ("frame", np.arange(found.frames), {"units": "1"}),
        },
        attrs={
            "title": f"retrieval over a scroll of band {found.band}", "ground_step_m": found.ground_step_m,
            "error_bound": found.error, "scene": found.scene, "figures": to_json(scroll_figures(found)),
            "provenance": to_json(provenance),
        },
    )  # fmt: skip
    _write(data, path, tuple(name for name, value in variables.items() if value[0] == pixel))


@contextmanager
def frames_file(path: Path, provenance: Mapping[str, Any]) -> Iterator[Callable[..., None]]:
    """Give a function that takes number and frame and writes it; the file grows, the memory does not.

    The file has frame (frame, row, column), float32. Coordinates are added by the function's keywords ``x_m``, ``y_m``,
    after the last frame.
    """
    import h5netcdf

    with h5netcdf.File(path, "w") as file:
        file.attrs.update({"title": "frames of a scroll", "provenance": to_json(provenance)})

        def write(number: int, frame: NDArray[np.floating] | None = None, **places: NDArray[np.float64]) -> None:
            if frame is not None:
                if number == 0:
                    file.dimensions.update({"frame": None, "row": frame.shape[0], "column": frame.shape[1]})
                    made = file.create_variable("frames", ("frame", "row", "column"), np.float32,
                                                chunks=(1, *frame.shape))  # fmt: skip
                    made.attrs.update({"units": "1", "long_name": RELATIVE})
                file.resize_dimension("frame", number + 1)
                file.variables["frames"][number] = frame
            for name, values in places.items():
                place = file.create_variable(name, ("row" if name == "y_m" else "column",), np.float64)
                place[...] = values
                place.attrs["units"] = "m"

        yield write


def _coordinates(
    rows: NDArray[Any], columns: NDArray[Any], y_m: NDArray[np.float64], x_m: NDArray[np.float64]
) -> dict[str, Any]:
    return {
        "row": ("row", rows, {"units": "1"}),
        "column": ("column", columns, {"units": "1"}),
        "y_m": ("row", y_m, {"units": "m", "long_name": "along track, the axis of the path difference"}),
        "x_m": ("column", x_m, {"units": "m", "long_name": "across track"}),
    }


def _plans(plans: Any) -> list[dict[str, Any]]:
    return [{"name": p.name, "way": p.way, "blur": p.blur, "pitch": p.pitch, "error": p.error, "places": p.places}
            for p in plans]  # fmt: skip


def _write(data: Any, path: Path, packed: tuple[str, ...]) -> None:
    data.to_netcdf(path, engine="h5netcdf", encoding={name: {"zlib": True, "complevel": 1} for name in packed})
