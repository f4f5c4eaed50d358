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

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
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
WHOLE = kernels.WHOLE  # of a pixel: an offset this close to a whole number is one


@dataclass(frozen=True)
class Sharp:
    """pattern (C, R, X); image (C, H, X), columns resampled; row (R,): rows of the image at scroll 0; taps 2 or 4.

    margin : rows of the image before the scene's first; strict : to look beyond the scene is an error
    along (R,) : factor of each row of the pattern, None: 1, as it must be for the first of all

    Raises InputError for arrays whose lines are not contiguous, or whose numbers of modes, columns or rows differ.
    """

    name: str
    pattern: Real
    image: Real
    row: Array
    taps: int
    margin: int
    strict: bool
    along: Array | None = None

    def __post_init__(self) -> None:
        modes, rows, columns = self.pattern.shape
        fits = self.image.shape[::2] == (modes, columns) and len(self.row) == rows
        lines = self.pattern.flags.c_contiguous and self.image.strides[2] == self.image.itemsize
        if not (fits and lines and self.pattern.dtype == self.image.dtype):
            shapes = f"{self.pattern.shape}, {self.image.shape}"
            raise InputError("frames", f"layer {self.name}", shapes, "pattern and image do not fit each other",
                             "give (C, R, X) and (C, H, X) of one type, lines contiguous")  # fmt: skip

    @cached_property
    def reach(self) -> Array:
        """Lowest and highest row at scroll 0."""
        return np.array([self.row.min(), self.row.max()])


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
    """All smooth layers on one grid, those with fringes first, as ``kernels.frames.frame_rows`` wants them. row
    (E, N + D): coarse rows at scroll 0; step: rows of the scene per coarse row; size: coarse rows of each layer, both
    (E,)."""

    grid: smooth.Grid
    turn: Real
    which: Index
    fringed: Real
    plain: Real
    own: Real
    coarse: Real
    row: Array
    step: Array
    size: Index


@dataclass(frozen=True)
class LayerPlan:
    """What was chosen for a layer. way; blur: method of the convolution; pitch: of its nodes, pixels (1: every pixel);
    error: bound or measure of what the choice adds, relative irradiance at the scene's largest value; places: what a
    ghost changes that stands off its affine map as far as a traced point does at most, on the steepest ground."""

    name: str
    way: Literal["sharp", "smooth", "warped"]
    blur: str
    pitch: int
    error: float
    places: float = 0.0


@dataclass(frozen=True)
class Beams:
    """Everything a frame needs but the scroll. ``error``: sum over the layers' plans. height: rows of the scene; span:
    least and largest scroll, rows, that images are made for, None: any. The zone has lost its phase: what is needed of
    it is in the smooth layers."""

    zone: Zone
    dtype: type
    wrap: bool
    height: int
    sharp: tuple[Sharp, ...]
    warped: tuple[Warped, ...]
    smooth: Smooth | None
    plans: tuple[LayerPlan, ...]
    error: float
    span: tuple[float, float] | None = None

    def frame(self, shift: float, out: Real | None = None, pool: ThreadPoolExecutor | None = None) -> Real:
        """(R, X) the frame when the ground has moved by ``shift`` rows; into ``out`` if given.

        ``pool``: one thread of it helps the caller; the result is the same to the last bit. What goes wrong in that
        thread is raised here, and neither waits for pieces that the other will never finish.

        Raises InputError when the nominal beam looks beyond a scene that does not repeat, or ``out`` does not fit.
        """
        rows, columns = self.zone.shape
        out = np.empty((rows, columns), self.dtype) if out is None else out
        if out.shape != (rows, columns) or out.dtype != self.dtype or not out.flags.c_contiguous:
            raise InputError("frames", "out", f"{out.dtype} {out.shape}", "does not fit the frame",
                             f"give a contiguous {np.dtype(self.dtype)} array of {(rows, columns)}")  # fmt: skip
        self.ready(shift)
        counters = np.zeros((1 + len(self.warped), 2), np.int64)
        failed: list[BaseException] = []

        def pieces_of(from_top: bool) -> None:
            pieces = kernels.frame_rows(out, self._terms, self._places, self._factors, shift, self.wrap, *self._smooth,
                                        counters[0], from_top)  # fmt: skip
            _done(counters[0], pieces, failed)
            for turned, counter in zip(self.warped, counters[1:], strict=True):
                kernels.warped_rows(out, turned.pattern, turned.image, turned.x, turned.y, shift, self.wrap,
                                    turned.taps, counter, from_top)  # fmt: skip
                _done(counter, -(-rows // kernels.PIECE), failed)

        def work(from_top: bool) -> None:
            try:
                pieces_of(from_top)
            except BaseException as error:
                failed.append(error)
                raise

        # The caller is one of the two, and does not wait for the other to wake up: that takes a tenth of a frame.
        if pool is not None:
            pool.submit(work, False)
        work(True)
        if failed:
            raise failed[0]
        return out

    def ready(self, shift: float) -> None:
        """Raise InputError if the nominal beam looks beyond the scene at this scroll, or images do not reach there."""
        for term in self.sharp if not self.wrap else ():
            if term.strict:
                self._inside(term.reach + (shift - term.margin))
        if self.span is not None and not self.span[0] - WHOLE <= shift <= self.span[1] + WHOLE:
            raise InputError("frames", "shift", shift, f"lies outside the scrolls {self.span[0]:g} to {self.span[1]:g} "
                             "that images are made for", "prepare the layers for this part of the scroll")  # fmt: skip

    @cached_property
    def _terms(self) -> Index:
        """(S, 5) see ``kernels.frames.frame_rows``; the addresses are of arrays that ``sharp`` keeps."""
        return np.array([
            (pattern.ctypes.data, image.ctypes.data, image.strides[0], len(image), term.taps)
            for term in self.sharp for pattern, image in zip(term.pattern, term.image, strict=True)
        ])  # fmt: skip

    @cached_property
    def _places(self) -> Array:
        return np.repeat([term.row for term in self.sharp], [len(term.pattern) for term in self.sharp], axis=0)

    @cached_property
    def _factors(self) -> Array:
        ones = np.ones(self.zone.shape[0])
        return np.repeat([ones if term.along is None else term.along for term in self.sharp],
                         [len(term.pattern) for term in self.sharp], axis=0)  # fmt: skip

    @cached_property
    def _smooth(self) -> tuple[NDArray[np.generic], ...]:
        """What ``kernels.frames.frame_rows`` takes of the smooth layers; without nodes if there are none."""
        s = self.smooth or no_layers(self.zone.shape, self.dtype)
        return s.turn, s.which, s.fringed, s.plain, s.own, s.coarse, s.row, s.step, s.size, s.grid.table

    def _inside(self, place: Array) -> None:
        before, after = -float(place.min()), float(place.max()) - (self.height - 1)
        missing = int(np.ceil(max(before, 0.0) - WHOLE) + np.ceil(max(after, 0.0) - WHOLE))
        if missing > 0:
            raise InputError("frames", "scene", f"{self.height} rows", f"the scroll needs {missing} rows more",
                             "give a longer scene, fewer frames, or let it repeat along track (tile)")  # fmt: skip


def no_layers(shape: tuple[int, int], dtype: type) -> Smooth:
    """A grid without nodes."""
    n, where = kernels.LANES, smooth.grid(shape, kernels.PIECE, dtype)

    def none(*size: int) -> Real:
        return np.zeros(size, dtype)

    return Smooth(
        where, none(2, 0, 0), np.full(shape[0], -1), none(0, 0, 0, 5, n), none(0, 0, 0, n), none(0, 0, 0, n),
        none(0, 0, 0, n), np.zeros((0, 0)), np.zeros(0), np.zeros(0, np.int64),
    )  # fmt: skip


def _done(counter: Index, pieces: int, failed: Sequence[BaseException]) -> None:
    """Wait until all pieces are done; both threads have stopped taking new ones. Raises what stopped the other one."""
    while counter[1] < pieces:
        if failed:
            raise failed[0]
        time.sleep(2e-5)
