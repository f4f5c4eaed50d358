"""Scenes in closed form: uniform, an edge, a point, quadrants; and one from an albedo map.

Every value is the mean over its pixel, exact: what a scene holds does not depend on how its features lie on the grid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.scene.ground import Canvas, Scene, refuse_bad

Array = NDArray[np.float64]


def from_albedo(canvas: Canvas, albedo: Array, source: str) -> Scene:
    """A scene of one spectral mode: the canvas's spectrum times albedo/canvas.albedo.

    albedo : (H, W) reflectance ≥ 0, rows along +Y, columns along +X. Values above 1 are let pass (snow under a low sun
    has them). Raises InputError, with the place, for values that are not finite or negative.
    """
    if albedo.ndim != 2:
        raise InputError(source, "albedo", albedo.shape, "not (rows, columns)", "give one map")
    refuse_bad(source, "albedo", albedo, ("row", "column"))
    refuse_bad(source, "albedo", albedo, ("row", "column"), negative=True)
    return _scene(canvas, albedo / canvas.albedo, source)


def uniform(canvas: Canvas, rows: int, columns: int, albedo: float | None = None) -> Scene:
    """The same everywhere; by default the canvas's own albedo, and then the map is 1 and the radiance its spectrum."""
    level = _level(canvas, albedo)
    return _scene(canvas, np.full(_size(rows, columns), level), f"uniform, albedo {level * canvas.albedo:g}")


def edge(
    canvas: Canvas,
    rows: int,
    columns: int,
    contrast: float = 2.0,
    offset_m: float = 0.0,
    angle_deg: float = 0.0,
    albedo: float | None = None,
) -> Scene:
    """Two half-planes with a straight edge; pixels that it crosses hold the share of their area.

    contrast : bright over dark, ≥ 1 (inf: dark is black); albedo : of the bright side, the canvas's by default
    angle_deg : direction from dark to bright, from +X towards +Y: at 0 the edge runs along track
    offset_m : ground distance of the edge from the scene's centre in that direction
    """
    level, dark = _level(canvas, albedo), _dark(contrast)
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    y, x = _centred(rows, columns)
    distance = c * x + s * y - offset_m / canvas.ground_pixel_m  # of the pixel's centre, in pixels, > 0 is bright
    share = _covered(distance, abs(float(c)), abs(float(s)))
    source = f"edge at {offset_m:g} m from the centre, {angle_deg:g}°, contrast {contrast:g}, bright albedo"
    return _scene(canvas, level * (dark + (1 - dark) * share), f"{source} {level * canvas.albedo:g}")


def quadrants(
    canvas: Canvas,
    rows: int,
    columns: int,
    contrast: float = 2.0,
    bright: tuple[tuple[bool, bool], tuple[bool, bool]] = ((False, True), (True, False)),
    albedo: float | None = None,
) -> Scene:
    """Four quadrants that meet at the scene's centre, bright : dark = ``contrast``, 2 : 1 by default.

    bright : which are, [[(−Y, −X), (−Y, +X)], [(+Y, −X), (+Y, +X)]]; by default they alternate, as on a chessboard.
    The requirement says 2 : 1 and does not say which ones: that is an assumption here.
    """
    level, dark = _level(canvas, albedo), _dark(contrast)
    y, x = _centred(rows, columns)
    upper = np.stack([np.clip(0.5 - y, 0, 1), np.clip(0.5 + y, 0, 1)])[:, :, 0]
    right = np.stack([np.clip(0.5 - x, 0, 1), np.clip(0.5 + x, 0, 1)])[:, 0, :]
    share = np.einsum("ir,jc,ij->rc", upper, right, np.array(bright, dtype=np.float64))
    source = f"quadrants, contrast {contrast:g}, bright albedo {level * canvas.albedo:g}"
    return _scene(canvas, level * (dark + (1 - dark) * share), source)


def point(
    canvas: Canvas,
    rows: int,
    columns: int,
    at: tuple[float, float] | None = None,
    albedo: float | None = None,
    background: float = 0.0,
) -> Scene:
    """One bright pixel's worth of light.

    at : row and column (Y, X) of its centre in pixels, 0 at the first pixel's centre, the middle pixel by default; in
    between, the light of one square pixel is shared by area among up to four. albedo : of that square, the canvas's by
    default; background : albedo around it. Raises InputError if the square leaves the scene.
    """
    level, around = _level(canvas, albedo), background / canvas.albedo
    size = _size(rows, columns)
    y, x = at or (rows // 2, columns // 2)
    if not (0 <= y <= rows - 1 and 0 <= x <= columns - 1):
        raise InputError("point", "at", at, f"outside {rows} × {columns} pixels", "give row and column inside")
    if not (np.isfinite(background) and background >= 0):
        raise InputError("point", "background", background, "not an albedo", "give 0 or more")
    down = np.clip(1 - np.abs(np.arange(rows) - y), 0, None)
    across = np.clip(1 - np.abs(np.arange(columns) - x), 0, None)
    maps = np.full(size, around) + (level - around) * down[:, None] * across[None, :]
    source = f"point at row {y:g}, column {x:g}, albedo {level * canvas.albedo:g} on {background:g}"
    return _scene(canvas, maps, source)


def _scene(canvas: Canvas, relative: Array, source: str) -> Scene:
    return Scene(
        maps=relative[None].astype(np.float32),
        sigma=canvas.spectrum.sigma,
        shapes=canvas.spectrum.radiance[None],
        pixel_m=canvas.pixel_m,
        ground_pixel_m=canvas.ground_pixel_m,
        source=f"{source}; {canvas.spectrum.source}",
    )


def _level(canvas: Canvas, albedo: float | None) -> float:
    if albedo is None:
        return 1.0
    if not 0 <= albedo <= 1:
        raise InputError("scene", "albedo", albedo, "outside 0…1", "give a reflectance")
    return albedo / canvas.albedo


def _dark(contrast: float) -> float:
    if not contrast >= 1:
        raise InputError("scene", "contrast", contrast, "below 1", "give bright over dark, 1 or more")
    return 1 / contrast


def _size(rows: int, columns: int) -> tuple[int, int]:
    if rows < 1 or columns < 1:
        raise InputError("scene", "rows, columns", (rows, columns), "no pixel", "give 1 or more of each")
    return rows, columns


def _centred(rows: int, columns: int) -> tuple[Array, Array]:
    """Pixel centres measured from the middle of the scene, in pixels: (H, 1) and (1, W)."""
    _size(rows, columns)
    return (np.arange(rows, dtype=np.float64) - 0.5 * (rows - 1))[:, None], (
        np.arange(columns, dtype=np.float64) - 0.5 * (columns - 1)
    )[None, :]


def _covered(distance: Array, a: float, b: float) -> Array:
    """Share of unit squares that lies beyond a line, whose normal has components of size a, b (a² + b² = 1).

    distance : of the square's centre from the line, > 0 beyond. The square's projection on the normal is a box of width
    a convolved with one of width b; the share is the second integral of that, differenced.
    """
    long, short = max(a, b), min(a, b)
    if short < 1e-8:  # a step through the squares' sides
        return np.clip(0.5 + distance / long, 0, 1)

    def half_square(t: Array) -> Array:
        return 0.5 * np.maximum(t, 0) ** 2

    t, u, v = np.clip(distance, -1, 1), 0.5 * (long + short), 0.5 * (long - short)
    total = half_square(t + u) - half_square(t + v) - half_square(t - v) + half_square(t - u)
    return np.clip(total / (long * short), 0, 1)
