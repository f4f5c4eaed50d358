"""Fringe fields in NetCDF files, so that a band is traced once; what is read equals what was written, to the bit."""

from __future__ import annotations

import os
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.fringes.field import FieldPair, FringeField, MutualKernel, NominalPsf, SceneView, Shadow

Array = NDArray[np.float64]
TITLE = "fringe field"
#: Of the layout below; a file of another one is refused.
LAYOUT = 2


def save_field(field: FringeField, path: str | Path, made: Mapping[str, str | float] | None = None) -> None:
    """Write a fringe field as NetCDF-4; whole or not at all.

    Complex contrasts are pairs of variables, ``gamma_re`` and ``gamma_im``; pairs differ in their number of
    wavenumbers, so that these stand one behind the other along ``sample``, as kernels do along ``element``. made: what
    it was made from (the instrument's hash, say), kept as attributes.

    Raises InputError if the file cannot be written.
    """
    import xarray

    path = Path(path)
    pairs, seen, dead = field.pairs, field.views, field.shadows
    node = ("y", "x")
    variables: dict[str, tuple[Any, ...]] = {
        "label": ("beam", np.array(field.labels, dtype=object)),
        "family": ("beam", field.family),
        "order": ("beam", field.order),
        "arms": (("beam", "arm"), field.arms, {"long_name": "passes of each arm"}),
        "transmission": (("beam", *node), field.transmission, {"units": "1"}),
        "transmission_error": ("beam", field.transmission_error, {"units": "1"}),
        "pair_m": ("pair", np.array([p.m for p in pairs])),
        "pair_l": ("pair", np.array([p.l for p in pairs])),
        "pair_error": ("pair", np.array([p.error for p in pairs]), {"units": "1"}),
        "pair_interpolation": ("pair", np.array([p.interpolation for p in pairs]), {"units": "1"}),
        "samples": ("pair", np.array([len(p.sigma) for p in pairs])),
        "sigma": ("sample", np.concatenate([p.sigma for p in pairs]), {"units": "m-1"}),
        "gamma_re": (("sample", *node), np.concatenate([p.gamma.real for p in pairs]), {"units": "1"}),
        "gamma_im": (("sample", *node), np.concatenate([p.gamma.imag for p in pairs]), {"units": "1"}),
        "opd": (("sample", *node), np.concatenate([p.opd_m for p in pairs]), {"units": "m"}),
    }
    if all(p.mutual is not None for p in pairs):
        kernels = [p.mutual for p in pairs if p.mutual is not None]
        joined = np.concatenate([k.apart.ravel() for k in kernels])
        variables |= {
            "mutual_size": (("pair", "row"), np.array([k.apart.shape for k in kernels])),
            "mutual_step": (
                "pair",
                np.array([k.step for k in kernels]),
                {"units": "1", "long_name": "pixels per cell"},
            ),
            "mutual_most": ("pair", np.array([k.most for k in kernels]), {"units": "1"}),
            "mutual_re": ("cell", joined.real, {"units": "1"}),
            "mutual_im": ("cell", joined.imag, {"units": "1"}),
        }
    if seen:
        variables |= {
            "view_family": ("view", np.array([v.family for v in seen])),
            "view_name": ("view", np.array([v.name for v in seen], dtype=object)),
            "view_affine": (("view", "row", "term"), np.array([v.affine for v in seen])),
            "view_misfit": ("view", np.array([v.misfit_m for v in seen]), {"units": "m"}),
            "view_size": (("view", "row"), np.array([v.shape for v in seen])),
            "kernel": ("element", _joined([v.kernel for v in seen]), {"units": "1"}),
        }
    if dead:
        variables |= {
            "shadow_arm": ("shadow", np.array([s.arm for s in dead])),
            "shadow_y": ("shadow", np.array([s.y_m for s in dead]), {"units": "m"}),
            "shadow_half_width": ("shadow", np.array([s.half_width_m for s in dead]), {"units": "m"}),
        }
    if field.psf is not None:
        kernel = {"units": "1", "long_name": "share of the light from a ground cell"}
        variables |= {
            "psf_x": ("psf_column", field.psf.x_m, {"units": "m"}),
            "psf_y": ("psf_row", field.psf.y_m, {"units": "m"}),
            "psf": (("psf_row", "psf_column", "cell_y", "cell_x"), field.psf.kernel, kernel),
            "psf_check_place": (("psf_check", "axis"), field.psf.check_m, {"units": "m"}),
            "psf_check_kernel": (("psf_check", "cell_y", "cell_x"), field.psf.check, kernel),
            "psf_limits": ("limit", np.array([field.psf.outside, field.psf.arms]),
                           {"units": "1", "long_name": "light outside the window; difference between the beams"}),
        }  # fmt: skip
    data = xarray.Dataset(
        variables,
        coords={"y": ("y", field.y_m, {"units": "m"}), "x": ("x", field.x_m, {"units": "m"})},
        attrs={
            **(made or {}), "title": TITLE, "layout": LAYOUT, "band": field.band, "zone_m": np.array(field.zone),
            "rows": np.array(field.rows), "columns": np.array(field.columns), "pixel_m": field.pixel_m,
            "sigma0_per_m": field.sigma0, "transmission_interpolation": field.transmission_interpolation,
            "left_out": field.left_out, "left_out_baseline": field.left_out_baseline,
        },
    )  # fmt: skip
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(4)}{path.suffix}")
    try:
        large = ("gamma_re", "gamma_im", "opd", "kernel", "psf", "psf_check_kernel")
        packed = {name: {"zlib": True, "complevel": 1, "shuffle": True} for name in large if name in variables}
        data.to_netcdf(temporary, engine="h5netcdf", encoding=packed)
        os.replace(temporary, path)
    except OSError as error:
        problem = f"cannot be written ({error.strerror or error})"
        raise InputError(str(path), "file", path.name, problem, "name a file in a folder that exists") from None
    finally:
        temporary.unlink(missing_ok=True)


def load_field(path: str | Path, expected: Mapping[str, str | float] | None = None) -> FringeField:
    """Read a fringe field. expected: attributes that the file must have, as ``made`` of ``save_field``.

    Raises InputError for a file that cannot be read, is no fringe field, or is one of something else.
    """
    import xarray

    path = Path(path)
    try:
        stamp = _stamp(path)
        with xarray.open_dataset(path, engine="h5netcdf", drop_variables=["kernel"]) as opened:
            data = opened.load()
    except (OSError, ValueError) as error:
        raise InputError(str(path), "file", path.name, f"cannot be read ({error})", "name a NetCDF file") from None
    for name, value in {"title": TITLE, "layout": LAYOUT, **(expected or {})}.items():
        have = data.attrs.get(name)
        have = have.item() if isinstance(have, np.generic) else have
        if have != value:
            raise InputError(str(path), name, have, f"is not {value!r}", "trace the field anew, into another file")
    get = {str(name): variable.to_numpy() for name, variable in data.variables.items()}
    attrs = data.attrs
    x0, x1, y0, y1 = attrs["zone_m"].tolist()
    return FringeField(
        band=str(attrs["band"]), x_m=get["x"], y_m=get["y"], zone=(x0, x1, y0, y1), rows=_two(attrs["rows"]),
        columns=_two(attrs["columns"]), pixel_m=float(attrs["pixel_m"]), labels=tuple(map(str, get["label"])),
        family=get["family"], order=get["order"], arms=get["arms"], transmission=get["transmission"],
        transmission_error=get["transmission_error"],
        transmission_interpolation=float(attrs["transmission_interpolation"]), pairs=_pairs(get),
        sigma0=float(attrs["sigma0_per_m"]),
        shadows=tuple(
            Shadow(int(arm), float(y), float(width))
            for arm, y, width in zip(*(get.get(f"shadow_{n}", ()) for n in ("arm", "y", "half_width")), strict=True)
        ),
        views=_views(get, path, stamp), left_out=float(attrs["left_out"]),
        left_out_baseline=float(attrs["left_out_baseline"]), psf=_psf(get),
    )  # fmt: skip


def _psf(get: Mapping[str, NDArray[Any]]) -> NominalPsf | None:
    if "psf" not in get:
        return None
    outside, arms = get["psf_limits"].tolist()
    return NominalPsf(get["psf_x"], get["psf_y"], get["psf"], get["psf_check_place"], get["psf_check_kernel"], outside,
                      arms)  # fmt: skip


def _two(values: Sequence[int]) -> tuple[int, int]:
    first, last = values
    return int(first), int(last)


def _pairs(get: Mapping[str, NDArray[Any]]) -> tuple[FieldPair, ...]:
    found, start = [], 0
    mutual = _mutual(get)
    for k, count in enumerate(get["samples"].tolist()):
        part = slice(start, start + count)
        gamma = get["gamma_re"][part] + 1j * get["gamma_im"][part]
        found.append(FieldPair(int(get["pair_m"][k]), int(get["pair_l"][k]), get["sigma"][part], gamma,
                               get["opd"][part], float(get["pair_error"][k]),
                               float(get["pair_interpolation"][k]), mutual.get(k)))  # fmt: skip
        start += count
    return tuple(found)


def _mutual(get: Mapping[str, NDArray[Any]]) -> dict[int, MutualKernel]:
    found, start = {}, 0
    for k, (height, width) in enumerate(get.get("mutual_size", np.empty((0, 2), np.int64)).tolist()):
        part = slice(start, start + height * width)
        start = part.stop
        apart = (get["mutual_re"][part] + 1j * get["mutual_im"][part]).reshape(height, width)
        found[k] = MutualKernel(apart, int(get["mutual_step"][k]), float(get["mutual_most"][k]))
    return found


def _views(get: Mapping[str, NDArray[Any]], path: Path, stamp: tuple[int, int]) -> tuple[SceneView, ...]:
    found, start = [], 0
    file = _Kernels(path, stamp)
    for k, (height, width) in enumerate(get.get("view_size", np.empty((0, 2), np.int64)).tolist()):
        stored = KernelOnFile(file, start, (height, width))
        start += height * width
        found.append(SceneView(int(get["view_family"][k]), str(get["view_name"][k]), get["view_affine"][k], stored,
                               float(get["view_misfit"][k])))  # fmt: skip
    return tuple(found)


class _Kernels:
    """All kernels of a field's file, opened when the first of them is wanted; closed when nobody wants them any more.

    stamp : of the file when the field was read
    """

    def __init__(self, path: Path, stamp: tuple[int, int]) -> None:
        self._path, self._stamp = path, stamp
        self._file: Any = None

    def part(self, start: int, stop: int) -> NDArray[np.floating]:
        """Numbers start … stop − 1. Raises InputError for a file that is gone, or is not the one the field is from."""
        import h5netcdf

        if self._file is None:
            try:
                if _stamp(self._path) != self._stamp:
                    raise InputError(str(self._path), "file", self._path.name, "has changed since the field was read",
                                     "read the field again")  # fmt: skip
                self._file = h5netcdf.File(self._path, "r")
            except OSError as error:
                raise InputError(str(self._path), "file", self._path.name, f"cannot be read any more ({error})",
                                 "keep it as long as its field is in use") from None  # fmt: skip
        return np.asarray(self._file.variables["kernel"][start:stop])


@dataclass(frozen=True)
class KernelOnFile:
    """A kernel of a field's file, behind ``start`` numbers of others."""

    file: _Kernels
    start: int
    shape: tuple[int, int]

    def read(self) -> NDArray[np.floating]:
        """(H, W). Raises InputError for a file that is gone, or is not the one the field is from."""
        height, width = self.shape
        values = self.file.part(self.start, self.start + height * width)
        single = values.astype(np.float32)  # half of the memory, where nothing is lost
        return (single if np.array_equal(single, values) else values).reshape(height, width)


def _stamp(path: Path) -> tuple[int, int]:
    """What changes with a file: time of its last change, ns, and size."""
    found = path.stat()
    return found.st_mtime_ns, found.st_size


def _joined(kernels: Sequence[NDArray[np.floating]]) -> NDArray[np.floating]:
    """All numbers one behind the other, single ones where nothing is lost by that."""
    single = [kernel.astype(np.float32) for kernel in kernels]
    lossless = all(np.array_equal(one, kernel) for one, kernel in zip(single, kernels, strict=True))
    return np.concatenate([kernel.ravel() for kernel in (single if lossless else kernels)])
