"""A scene: radiance of the ground over a pixel grid, as a few maps times as many spectral shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.scene.filters import Filter, require_coverage
from cgi_wave.scene.spectrum import Spectrum

Array = NDArray[np.float64]
Tile = Literal["mirror", "repeat"]

#: Pixels at which ``require_positive`` looks, besides those where the ratio of two maps is extreme.
_LOOKED_AT = 500
#: Negative radiance up to this share of a pixel's own largest reference radiance is rounding of a low-rank form.
_NEGATIVE = 1e-3


@dataclass(frozen=True)
class Canvas:
    """What all scenes of one band share.

    spectrum : reference radiance, that of ground of reflectance ``albedo``
    albedo : 0 < albedo ≤ 1
    pixel_m : pitch of the scene's grid where the nominal beam images it on the detector, m: the detector's pixel
    ground_pixel_m : the same step on the ground, m (``ground_sample``)
    """

    spectrum: Spectrum
    albedo: float
    pixel_m: float
    ground_pixel_m: float

    def __post_init__(self) -> None:
        if not 0 < self.albedo <= 1:
            raise InputError("canvas", "albedo", self.albedo, "outside (0, 1]", "give the reference reflectance")
        for field in ("pixel_m", "ground_pixel_m"):
            _require_length("canvas", field, getattr(self, field))


@dataclass(frozen=True, eq=False)
class Scene:
    """L(X, Y, σ) = Σ_c maps[c](X, Y)·shapes[c](σ).

    Scene coordinates are those of the detector: (X, Y) is where the nominal beam images the ground point while the
    scroll offset is zero, m. Y is along track: while the ground scrolls along −y, rows of larger index follow.

    maps : (C, H, W) float32, first axis modes, then Y, then X. maps[0] ≥ 0, in units of the reference spectrum; the
        others may have any sign. Each value is the mean over its pixel.
    sigma : (S,) vacuum wavenumbers, 1/m, uniform, ascending
    shapes : (C, S) W m⁻² sr⁻¹ per (1/m); shapes[0] is the reference spectrum, ≥ 0
    pixel_m : pitch of the maps in scene coordinates, m
    ground_pixel_m : the same on the ground, m
    source : where the scene comes from, what is assumed
    rank_residual : largest ∫filter·|L − Σ_c| dσ / ∫filter·shapes[0] dσ that the low-rank form leaves, per unit of
        maps[0]; 0 where it is exact
    origin_m : scene coordinates (X, Y) of the centre of maps[:, 0, 0]

    Raises InputError for arrays that do not fit together, values that are not finite, and a negative reference mode.
    """

    maps: NDArray[np.float32]
    sigma: Array
    shapes: Array
    pixel_m: float
    ground_pixel_m: float
    source: str
    rank_residual: float = 0.0
    origin_m: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        where = self.name
        if self.maps.ndim != 3 or self.maps.dtype != np.float32 or 0 in self.maps.shape:
            what = f"{self.maps.dtype} {self.maps.shape}"
            raise InputError(
                where, "maps", what, "not float32 (modes, rows, columns)", "give one map per spectral shape"
            )
        if self.sigma.ndim != 1 or self.shapes.shape != (len(self.maps), self.sigma.size):
            raise InputError(
                where,
                "shapes",
                self.shapes.shape,
                f"not (modes, wavenumbers) = {(len(self.maps), self.sigma.size)}",
                "give one spectral shape per map, on the wavenumbers of sigma",
            )
        spacing = np.diff(self.sigma)
        if self.sigma.size < 2 or spacing.min() <= 0 or np.ptp(spacing) > 1e-6 * spacing.mean():
            raise InputError(
                where, "sigma", self.sigma.size, "not a uniform ascending grid", "resample the shapes to uniform steps"
            )
        for field in ("pixel_m", "ground_pixel_m"):
            _require_length(where, field, getattr(self, field))
        refuse_bad(where, "maps", self.maps, ("mode", "row", "column"))
        refuse_bad(where, "shapes", self.shapes, ("mode", "sample"))
        refuse_bad(where, "maps[0]", self.maps[0], ("row", "column"), negative=True)
        refuse_bad(where, "shapes[0]", self.shapes[0], ("sample",), negative=True)

    @property
    def name(self) -> str:
        """What refusals call it: the first clause of ``source``, a file's path or what was built."""
        return self.source.partition("; ")[0]

    @property
    def rows(self) -> int:
        """Number of pixels along track (Y)."""
        return self.maps.shape[1]

    @property
    def columns(self) -> int:
        """Number of pixels across track (X)."""
        return self.maps.shape[2]

    @property
    def x_m(self) -> Array:
        """(W,) scene coordinate X of the columns' centres, m."""
        return self.origin_m[0] + self.pixel_m * np.arange(self.columns, dtype=np.float64)

    @property
    def y_m(self) -> Array:
        """(H,) scene coordinate Y of the rows' centres, m."""
        return self.origin_m[1] + self.pixel_m * np.arange(self.rows, dtype=np.float64)

    def spectrum(self, row: int, column: int) -> Spectrum:
        """Radiance of one pixel."""
        radiance = self.maps[:, row, column].astype(np.float64) @ self.shapes
        return Spectrum(self.sigma, radiance, f"{self.source}, row {row}, column {column}")


def ground_sample(pixel_m: float, altitude_m: float, focal_m: float) -> float:
    """Step on the ground, m, of one pixel at nadir: pixel·altitude/focal length. Raises InputError unless all > 0."""
    for field, value in (("pixel_m", pixel_m), ("altitude_m", altitude_m), ("focal_m", focal_m)):
        _require_length("ground sample", field, value)
    return pixel_m * altitude_m / focal_m


def tiled(
    scene: Scene, rows: int, columns: int, tile: Tile | None = "mirror", start: tuple[int, int] = (0, 0)
) -> Scene:
    """The scene cut, or continued, to ``rows`` × ``columns``, from element ``start`` on.

    ``"mirror"`` reflects it at its edges, so that no step arises there; ``"repeat"`` starts again. None only cuts.
    Raises InputError where the scene is too small and ``tile`` is None, and for an unknown ``tile``.
    """
    if tile is None:
        require_size(scene, start[0] + rows, start[1] + columns)
    elif tile not in ("mirror", "repeat"):
        raise InputError(scene.name, "tile", tile, "unknown", "use 'mirror' or 'repeat', or None to cut only")
    if rows < 1 or columns < 1 or min(start) < 0:
        raise InputError(
            scene.name, "rows, columns, start", (rows, columns, start), "no size", "give 1 or more, from 0"
        )
    pick = []
    for first, count, have in ((start[0], rows, scene.rows), (start[1], columns, scene.columns)):
        index = np.arange(first, first + count)
        if tile == "mirror":
            index %= 2 * have
            index = np.minimum(index, 2 * have - 1 - index)
        pick.append(index % have)
    grown = scene.rows < start[0] + rows or scene.columns < start[1] + columns
    note = f"; {tile}ed from {scene.rows} × {scene.columns} pixels" if grown else ""
    origin = tuple(o + s * scene.pixel_m for o, s in zip(scene.origin_m, start[::-1], strict=True))
    maps = scene.maps[:, pick[0][:, None], pick[1][None, :]]
    return replace(scene, maps=maps, source=scene.source + note, origin_m=(origin[0], origin[1]))


def require_size(scene: Scene, rows: int, columns: int) -> None:
    """Raise InputError, with the number of missing pixels, unless the scene has ``rows`` × ``columns`` pixels."""
    for field, have, need in (("columns", scene.columns, columns), ("rows", scene.rows, rows)):
        if have < need:
            raise InputError(
                scene.name,
                field,
                have,
                f"the swath needs {need}: {need - have} {field} of pixels missing",
                f"give a larger scene, or continue it: tiled(scene, {rows}, {columns}, tile='mirror')",
            )


def on_zone(
    scene: Scene, zone: tuple[float, float, float, float], frames: int = 1, step: float = 1.0, margin: int = 0
) -> Scene:
    """The scene placed on a detector zone: row ``margin`` on the zone's first, its columns centred on the zone's.

    zone : x_min, x_max, y_min, y_max of the pixels' outer edges, m; frames : number of frames, each ``step`` rows (≥ 0)
    after the one before; margin : rows wanted before and after, columns to either side. Rows and columns beyond stay:
    ghosts may bring them in.

    Raises InputError unless the grid has the zone's pitch (1e-6), and covers its columns and, with the scroll, rows.
    """
    x0, x1, y0, y1 = zone
    columns, rows = (x1 - x0) / scene.pixel_m, (y1 - y0) / scene.pixel_m
    for field, count in (("columns", columns), ("rows", rows)):
        if abs(count - round(count)) > 1e-6 * count:
            raise InputError(
                scene.name,
                "pixel_m",
                scene.pixel_m,
                f"the zone has {count:g} {field}, no whole number",
                "resample it",
            )
    # A row more where the last frame stops between two.
    scrolled = int(np.ceil((frames - 1) * step - 1e-9))
    require_size(scene, round(rows) + scrolled + 2 * margin, round(columns) + 2 * margin)
    left = (scene.columns - round(columns)) // 2
    return replace(scene, origin_m=(x0 + (0.5 - left) * scene.pixel_m, y0 + (0.5 - margin) * scene.pixel_m))


def require_filter(scene: Scene, band_filter: Filter) -> None:
    """Raise InputError, naming the missing wavelengths, unless the scene's spectrum covers the filter's support."""
    require_coverage(Spectrum(scene.sigma, scene.shapes[0], scene.name), band_filter)


def require_positive(scene: Scene) -> None:
    """Raise InputError if the modes add up to negative radiance: at which row and column, which wavelength.

    Looked at are all samples of the pixels where maps[c]/maps[0] is extreme (with two modes these decide) and of
    another 500. Dips up to 1e-3 of the pixel's largest reference radiance are taken for rounding of a low-rank form.
    """
    flat = scene.maps.reshape(len(scene.maps), -1).astype(np.float64)
    chosen = np.linspace(0, flat.shape[1] - 1, min(_LOOKED_AT, flat.shape[1])).astype(np.int64)
    lit = flat[0] > 0
    for mode in flat[1:]:
        ratio = np.divide(mode, flat[0], out=np.copysign(np.inf, mode), where=lit)
        ratio[~lit & (mode == 0)] = 0.0
        chosen = np.append(chosen, [ratio.argmin(), ratio.argmax()])
    for pixel in np.unique(chosen):
        radiance = flat[:, pixel] @ scene.shapes
        sample = int(radiance.argmin())
        if radiance[sample] < -_NEGATIVE * flat[0, pixel] * scene.shapes[0].max():
            row, column = divmod(int(pixel), scene.columns)
            raise InputError(
                scene.name,
                "maps · shapes",
                float(radiance[sample]),
                f"negative radiance at row {row}, column {column}, {1e9 / scene.sigma[sample]:.3f} nm",
                "give maps and shapes that add up to radiances ≥ 0",
            )


def refuse_bad(
    where: str, field: str, values: NDArray[np.floating], axes: tuple[str, ...], negative: bool = False
) -> None:
    """Raise InputError for values that are not finite (or, if ``negative``, below zero): how many, where the first."""
    bad = ~np.isfinite(values) if not negative else values < 0
    if not bad.any():
        return
    first = np.unravel_index(int(bad.argmax()), bad.shape)
    place = ", ".join(f"{axis} {index}" for axis, index in zip(axes, first, strict=True))
    raise InputError(
        where,
        field,
        float(values[first]),
        f"{int(bad.sum())} of {bad.size} values {'negative' if negative else 'not finite'}, the first at {place}",
        "fill or cut them out" if not negative else "give values ≥ 0",
    )


def _require_length(where: str, field: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise InputError(where, field, value, "not a positive length", "give metres")
