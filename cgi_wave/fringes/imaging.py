"""How a layer sees the scene: which part of it, blurred how, and read at which places, for a part of a scroll.

Images are made for the scrolls of a ``Span`` only: a long scroll is made of many (``scroll.spans``), and holds the
images of one. They are made of the whole scene, so that none of them knows where one span ends.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes import blur, smooth
from cgi_wave.fringes.beams_on_scene import WHOLE
from cgi_wave.fringes.cells import Cells, Coarse, cells
from cgi_wave.fringes.layer import Zone

Array = NDArray[np.float64]
Real = NDArray[np.floating]
AROUND = 32  # pixels around the zone where the nodes of a smooth layer may stand
SPARE = 4  # samples more on each side of what is looked at: cubics take two, rounding one


@dataclass(frozen=True)
class Span:
    """Scrolls from ``low`` to ``high``, rows."""

    low: float
    high: float


def whole(height: int, zone: Zone) -> Span:
    """All scrolls at which the nominal beam sees nothing but the scene."""
    return Span(-zone.row, max(height - zone.shape[0] - zone.row, -zone.row))


class Ground:
    """A scene (C, H, W) as layers look at it: its samples, its cells, and where it ends. tile: along track it repeats.

    largest (C,): |value| of each map; scale: of all
    """

    def __init__(self, maps: Real, tile: bool) -> None:
        self.maps, self.tile = maps, tile
        self.largest = np.array([max(float(one.max()), -float(one.min())) for one in maps])
        self.scale = float(self.largest.max()) or 1.0
        self._cells: dict[int, Cells] = {}

    @property
    def height(self) -> int:
        """Rows."""
        return self.maps.shape[1]

    @property
    def samples(self) -> int:
        """Per map."""
        return self.maps.shape[1] * self.maps.shape[2]

    def cells(self, step: int) -> Cells:
        """Means over cells, made once."""
        if step not in self._cells:
            self._cells[step] = cells(self.maps, step)
        return self._cells[step]

    def keep(self, steps: Collection[int]) -> None:
        """Let go of cells of other sizes, and of what only bounds of errors need."""
        self._cells = {
            step: replace(one, unrest=one.unrest[:, :0].copy()) for step, one in self._cells.items() if step in steps
        }


@dataclass(frozen=True)
class Seen:
    """A part of the scene as a layer sees it. image (C, h, w); row, column : of the scene, of its first sample; step :
    samples of the scene from one of its own to the next"""

    image: Real
    row: float
    column: float
    step: int

    def places(self, affine: Array, zone: Zone, rows: Array | None = None, columns: Array | None = None) -> tuple[
        Array, Array]:  # fmt: skip
        """Column and row in ``image`` under detector pixels (default: the zone's), at scroll 0."""
        column, row = places(affine, zone, rows, columns)
        return (column - self.column) / self.step, (row - self.row) / self.step

    def reading(self, count: int) -> Array:
        """(C,) error of reading between samples by ``count`` of them: 0 for cells one pixel large (two); else 1/24 of
        the largest fourth differences."""
        if count == 2:
            return np.zeros(len(self.image))
        return sum((np.abs(np.diff(self.image, n=4, axis=axis)).max(axis=(1, 2)) for axis in (1, 2)),
                   np.zeros(len(self.image))) / 24.0  # fmt: skip

    def steepest(self) -> Array:
        """(C,) largest change of the image per sample of the scene, from neighbours along and across track."""
        along, across = (np.abs(np.diff(self.image, axis=axis)).max(axis=(1, 2)) for axis in (1, 2))
        return np.asarray(np.hypot(along, across) / self.step)


def places(affine: Array, zone: Zone, rows: Array | None = None, columns: Array | None = None) -> tuple[Array, Array]:
    """Column and row of the scene, in samples, under detector pixels (default: the zone's), at scroll 0."""
    x = zone.x_m if columns is None else zone.x_m[0] + columns * zone.pitch
    y = zone.y_m if rows is None else zone.y_m[0] + rows * zone.pitch
    big_x = affine[0, 0] * x[None, :] + affine[0, 1] * y[:, None] + affine[0, 2]
    big_y = affine[1, 0] * x[None, :] + affine[1, 1] * y[:, None] + affine[1, 2]
    return zone.column + (big_x - zone.x_m[0]) / zone.pitch, zone.row + (big_y - zone.y_m[0]) / zone.pitch


def looked_at(affine: Array, zone: Zone, span: Span) -> tuple[tuple[int, int], tuple[int, int]]:
    """First and last + 1 row and column of the scene that a layer may look at, AROUND pixels beside the zone, too."""
    ends = [np.array([-AROUND, n - 1 + AROUND], np.float64) for n in zone.shape]
    column, row = places(affine, zone, *ends)
    rows = int(np.floor(row.min() + span.low)) - SPARE, int(np.ceil(row.max() + span.high)) + SPARE + 1
    return rows, (int(np.floor(column.min())) - SPARE, int(np.ceil(column.max())) + SPARE + 1)


def seen(ground: Ground, how: blur.Blur, kernel: Real | None, affine: Array, zone: Zone, span: Span) -> Seen:
    """The scene through a kernel; as it is (all its columns, and whole if it repeats) where nothing is done."""
    rows, columns = looked_at(affine, zone, span)
    if kernel is None or how.method == "nothing":
        if ground.tile:
            return Seen(ground.maps, 0.0, 0.0, 1)
        first = min(max(rows[0], 0), max(ground.height - 2 * SPARE, 0))
        return Seen(ground.maps[:, first : max(rows[1], first + 2 * SPARE)], float(first), 0.0, 1)
    if ground.tile:
        rows = 0, ground.height
    image = blur.part(ground.maps, how, kernel.astype(np.float64), ground.tile, rows, columns)
    return Seen(image, float(rows[0]), float(columns[0]), 1)


def seen_by_cells(ground: Ground, kernel: Coarse, affine: Array, zone: Zone, span: Span, dtype: type) -> Seen:
    """The scene through a kernel by cells."""
    rows, columns = looked_at(affine, zone, span)
    step = kernel.step
    (i, last), (j, right) = ((low // step - SPARE, high // step + SPARE + 1) for low, high in (rows, columns))
    image = kernel.image(ground.cells(step), (i, last), (j, right))
    return Seen(image.astype(dtype), float(i * step + step // 2), float(j * step + step // 2), step)


def turning(affine: Array, zone: Zone, image: Real) -> float:
    """What neglecting that a map turns rows may cost: largest step between neighbours times the pixels it moves by."""
    across = abs(affine[1, 0]) * np.ptp(zone.x_m) / zone.pitch / 2.0
    along = abs(affine[0, 1]) * np.ptp(zone.y_m) / zone.pitch / 2.0
    if across + along <= WHOLE:
        return 0.0
    step_y, step_x = (float(np.abs(np.diff(image, axis=axis)).max()) for axis in (1, 2))
    return float(across * step_y + along * step_x)


def on_columns(image: Real, column: Array, count: int) -> Real:
    """(C, H, X) an image at the zone's columns: a view for whole ones in order, else a copy."""
    nearest = np.rint(column)
    if np.abs(column - nearest).max() < WHOLE and nearest.min() >= 0 and nearest.max() < image.shape[2]:
        index = nearest.astype(np.int64)
        if np.all(np.diff(index) == 1):
            return image[:, :, index[0] : index[-1] + 1]
        return np.ascontiguousarray(image[:, :, index])
    return smooth.resampled(image, column, 2, False, count)
