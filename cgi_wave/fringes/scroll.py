"""Push-broom: the scene scrolls along y, frames come one after the other, and regroup into one PSI per ground point.

In frame k the ground has moved by s_k rows along −y: pixel row j sees ground row g = row + j + s_k, where ``row`` is
that of pixel row 0 at s = 0. With one row per frame, ground row g is on detector row j in frame k = g − row − j: rows
of larger index see it first. For a fraction of a row the pixel is counted to the nearest ground row; its OPD is the
pixel's own, so that no fringe is smeared, only the ground is met half a pixel off at most.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.fringes.beams_on_scene import Beams
from cgi_wave.fringes.imaging import Span

Array = NDArray[np.float64]
Real = NDArray[np.floating]
THREADS = 2


@dataclass(frozen=True)
class Motion:
    """rows (K,): s_k, by how many rows the ground has moved along −y in frame k; step: rows per frame asked for."""

    rows: Array
    step: float

    @property
    def whole(self) -> NDArray[np.int64]:
        """(K,) s_k to the nearest row: by it frames are regrouped."""
        return np.floor(self.rows + 0.5).astype(np.int64)

    @property
    def regular(self) -> bool:
        """Whether every frame is one row on."""
        return bool(np.all(np.diff(self.whole) == 1))


def motion(
    frames: int,
    step: float = 1.0,
    jitter: float = 0.0,
    attitude: float = 0.0,
    period: float = 100.0,
    seed: int = 0,
    start: float = 0.0,
) -> Motion:
    """s_k = start + k·step + jitter·n_k + attitude·sin(2πk/period), n_k normal deviates of ``seed``, all in rows.

    step : rows per frame; jitter : its standard deviation, rows; attitude : amplitude of a pitch oscillation, rows;
    period : of it, frames. n_k depends on seed and k alone.

    Raises InputError for a step that is not positive, a negative jitter or a period that is not positive.
    """
    for name, value, good in (
        ("step", step, step > 0.0), ("jitter", jitter, jitter >= 0.0), ("period", period, period > 0.0),
        ("frames", frames, frames > 0),
    ):  # fmt: skip
        if not (good and np.isfinite(value)):
            raise InputError("scroll", name, value, "is out of range", "give rows per frame, rows, frames, above zero")
    k = np.arange(frames)
    rows = start + step * k + attitude * np.sin(2.0 * np.pi * k / period)
    if jitter:
        rows = rows + jitter * np.random.Generator(np.random.Philox(key=seed)).standard_normal(frames)
    return Motion(rows, step)


def stream(beams: Beams, moves: Motion, threads: int = THREADS) -> Iterator[Real]:
    """Frames (R, X) of a scroll, one at a time, in one array that the next frame overwrites: copy what is to stay.

    threads : 1, or more for a second one beside the caller; the result is the same.

    Raises InputError, before the first frame, for a scene too short.
    """
    for (frame,) in streams(lambda _: (beams,), moves, np.inf, threads):
        yield frame


def streams(
    beams_of: Callable[[Span], Sequence[Beams]], moves: Motion, length: float, threads: int = THREADS
) -> Iterator[tuple[Real, ...]]:  # fmt: skip
    """Frames of several beams, side by side, as ``stream`` gives those of one; images are made as the scroll goes on.

    beams_of : makes them for a part of the scroll, of ``length`` rows at most; those of the part before are let go
    first. Raises what that raises, and InputError for a scene too short.
    """
    out: list[Real] = []
    with ThreadPoolExecutor(1) as pool:
        for frames, span in parts(moves, length):
            give_back()
            made = _made(beams_of, span)
            out = out or [np.empty(beams.zone.shape, beams.dtype) for beams in made]
            give_back()
            for shift in moves.rows[frames].tolist():
                yield tuple(
                    beams.frame(shift, one, pool if threads > 1 else None) for beams, one in zip(made, out, strict=True)
                )
            pool.submit(int).result()  # the other thread has nothing of the last frame left
            made.clear()  # a name for one of them would keep it


def _made(beams_of: Callable[[Span], Sequence[Beams]], span: Span) -> list[Beams]:
    """Beams for a part of a scroll. Raises InputError for a scene too short."""
    made = list(beams_of(span))
    for beams in made:
        for shift in (span.low, span.high):
            beams.ready(shift)
    return made


def parts(moves: Motion, length: float) -> Iterator[tuple[slice, Span]]:
    """A scroll in parts of consecutive frames, within ``length`` rows of each other: which frames, and their span."""
    first, low, high = 0, moves.rows[0], moves.rows[0]
    for k, at in enumerate(moves.rows):
        if max(high, at) - min(low, at) > length:
            yield slice(first, k), Span(float(low), float(high))
            first, low, high = k, at, at
        low, high = min(low, at), max(high, at)
    yield slice(first, len(moves.rows)), Span(float(low), float(high))


def give_back() -> None:
    """Freed memory goes back to the system. The GNU C library would keep what large arrays leave between small ones."""
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def regrouped(frames: NDArray[np.generic]) -> NDArray[np.generic]:
    """(G, R, X) one PSI per ground row, a view of frames (K, R, X) scrolled by one row each; G = K − R + 1.

    cube[g, j] = frames[R − 1 + g − j, j]: ground row R − 1 + g, counted from that of pixel row 0 in frame 0; ground
    rows that some pixel row has not seen are left out. No copy is made, and the view cannot be written to.

    Raises InputError for fewer frames than rows.
    """
    count, rows, columns = frames.shape
    if count < rows:
        raise InputError("scroll", "frames", count, f"no ground point has passed all {rows} rows",
                         f"take {rows} frames or more")  # fmt: skip
    along, down, across = frames.strides
    return np.lib.stride_tricks.as_strided(
        frames[rows - 1 :], (count - rows + 1, rows, columns), (along, down - along, across), writeable=False
    )
