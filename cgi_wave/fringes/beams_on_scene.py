"""Beams act on the scene: each layer's image of it, and how frames are computed from patterns and images.

A layer sees the scene through its own affine map and blur: image(x, y; s) = Σ_d kernel[d]·map(A(x, y, 1) + d + s e_Y),
s the rows by which the ground has moved along −y. Three ways, the first that keeps the tolerance:

* **smooth**: a blurred image, on a coarse grid, with a pattern that is envelopes times harmonics (``smooth``);
* **sharp**: maps that keep rows as rows (shift, magnification, flip). Columns are resampled once; per frame a row of
  the image is read as it is (whole offsets: exact), or from two or four rows;
* **warped**: maps that turn rows. Every pixel looks its place up; slow, and only for want of another way.

Fractions of a sample: ``area`` weighs two samples, which is exact for ground made of uniform cells one pixel large and
pixels that integrate (a shifted box); ``cubic`` weighs four (Lagrange), for band-limited scenes, with an error of at
most 1/24 of the fourth difference (3/128 away from the scene's ends). Blurred maps are read by ``cubic``.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.fringes import smooth
from cgi_wave.fringes.layer import Zone
from cgi_wave.kernels import frames as kernels

Array = NDArray[np.float64]
Real = NDArray[np.floating]
Index = NDArray[np.int64]
WHOLE = 1e-9  # of a pixel: an offset this close to a whole number is one


@dataclass(frozen=True)
class Sharp:
    """pattern (C, R, X); image (C, H, X), columns resampled; row (R,): rows of the image at scroll 0; taps 2 or 4.

    margin : rows of the image before the scene's first; strict : to look beyond the scene is an error
    """

    name: str
    pattern: Real
    image: Real
    row: Array
    taps: int
    margin: int
    strict: bool


@dataclass(frozen=True)
class Warped:
    """pattern (C, R, X); image (C, H, W); x, y (R, X): places in it at scroll 0, in samples."""

    name: str
    pattern: Real
    image: Real
    x: Array
    y: Array
    taps: int


@dataclass(frozen=True)
class Smooth:
    """All smooth layers on one grid, those with fringes first: see ``kernels.frames.frame_rows``. row (E, N): coarse
    rows at scroll 0; step: rows of the scene per coarse row; size: coarse rows of each layer, both (E,)."""

    grid: smooth.Grid
    turn: Real
    own: Index
    fringed: Real
    plain: Real
    coarse: Real
    row: Array
    step: Array
    size: Index


@dataclass(frozen=True)
class LayerPlan:
    """What was chosen for a layer. way; blur: method of the convolution; pitch: of its nodes, pixels (1: every pixel);
    error: bound or measure of what the choice adds, relative irradiance at the scene's largest value."""

    name: str
    way: Literal["sharp", "smooth", "warped"]
    blur: str
    pitch: int
    error: float


@dataclass(frozen=True)
class Beams:
    """Everything a frame needs but the scroll. ``error``: sum over the layers' plans. height: rows of the scene. The
    zone has lost its phase: what is needed of it is in the smooth layers."""

    zone: Zone
    dtype: type
    wrap: bool
    height: int
    sharp: tuple[Sharp, ...]
    warped: tuple[Warped, ...]
    smooth: Smooth | None
    plans: tuple[LayerPlan, ...]
    error: float

    def frame(self, shift: float, out: Real | None = None, pool: ThreadPoolExecutor | None = None) -> Real:
        """(R, X) the frame when the ground has moved by ``shift`` rows; into ``out`` if given.

        ``pool``: two threads share the rows; the result is the same to the last bit.

        Raises InputError when the nominal beam looks beyond a scene that does not repeat, or ``out`` does not fit.
        """
        rows, columns = self.zone.shape
        out = np.empty((rows, columns), self.dtype) if out is None else out
        if out.shape != (rows, columns) or out.dtype != self.dtype or not out.flags.c_contiguous:
            raise InputError("frames", "out", f"{out.dtype} {out.shape}", "does not fit the frame",
                             f"give a contiguous {np.dtype(self.dtype)} array of {(rows, columns)}")  # fmt: skip
        ready = [self._rows_of(term, shift) for term in self.sharp]
        unit = 4 if self.smooth is None else self.smooth.grid.pitch
        half = -(-rows // (2 * unit)) * unit
        spans = [(0, rows)] if pool is None or half >= rows else [(0, half), (half, rows)]

        def work(part: int) -> None:
            first, last = spans[part]
            for number, (term, (index, weight)) in enumerate(zip(self.sharp, ready, strict=True)):
                if number == 0 and self.smooth is not None:
                    self._fused(self.smooth, shift, out, term, index, weight, first, last)
                else:
                    kernels.sharp_rows(out, term.pattern, term.image, index, weight, first, last, number > 0)
            for turned in self.warped:
                kernels.warped_rows(out, turned.pattern, turned.image, turned.x, turned.y, shift, self.wrap,
                                    turned.taps, first, last)  # fmt: skip

        # The caller is one of the two: waking a thread takes as long as a tenth of a frame.
        other = pool.submit(work, 1) if pool is not None and len(spans) > 1 else None
        work(0)
        if other is not None:
            other.result()
        return out

    def ready(self, shift: float) -> None:
        """Raise InputError if the nominal beam looks beyond the scene at this scroll."""
        for term in self.sharp:
            self._rows_of(term, shift)

    def _fused(
        self, s: Smooth, shift: float, out: Real, term: Sharp, index: Index, weight: Real, first: int, last: int
    ) -> None:
        kernels.frame_rows(
            out, term.pattern, term.image, index, weight, s.turn, s.own, s.fringed, s.plain, s.coarse,
            s.row, shift / s.step, s.size, self.wrap, s.grid.table, first, last,
        )  # fmt: skip

    def _rows_of(self, term: Sharp, shift: float) -> tuple[Index, Real]:
        """(R, T) rows of the image and their weights in a frame."""
        place = term.row + shift
        nearest, size = np.rint(place), term.image.shape[1]
        whole = bool(np.abs(place - nearest).max() < WHOLE)
        if term.strict and not self.wrap:
            self._inside(place - term.margin)
        if whole:
            index = nearest.astype(np.int64)
            index = index % size if self.wrap else np.clip(index, 0, size - 1)
            return index[:, None], np.ones((len(place), 1), self.dtype)
        index, weight = smooth.taps(place, size, self.wrap, term.taps)
        return index, weight.astype(self.dtype)

    def _inside(self, place: Array) -> None:
        before, after = -float(place.min()), float(place.max()) - (self.height - 1)
        missing = int(np.ceil(max(before, 0.0) - WHOLE) + np.ceil(max(after, 0.0) - WHOLE))
        if missing > 0:
            raise InputError("frames", "scene", f"{self.height} rows", f"the scroll needs {missing} rows more",
                             "give a longer scene, fewer frames, or let it repeat along track (tile)")  # fmt: skip
