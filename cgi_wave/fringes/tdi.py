"""Time delay and integration along the OPD axis: rows that see the same ground in following frames are added up.

Each row has another OPD, so that a sum of N rows, P rows per fringe, keeps |sin(πN/P)/(N sin(π/P))| of the fringes'
contrast and is one sample at the mean OPD. Rows of repeated zones with the same OPD add up without loss.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.fringes.scroll import Motion

Real = NDArray[np.floating]
METHOD = "TDI"
SMEAR_LIMIT = 0.5  # rows


@dataclass(frozen=True)
class Tdi:
    """rows : added along the scroll; repeats, spacing : zones of equal OPD and the rows between their starts
    rows_per_fringe : P; contrast : what is kept of the fringes; gain : number of rows added, N·repeats
    smear_rows : largest distance between the ground that the added rows see; warning : set beyond half a row
    first, offsets : rows (G,) and (N·repeats,): output row i is the sum over rows first[i] + offsets
    mean_row : (G,) place of the mean OPD, in rows
    """

    rows: int
    repeats: int
    spacing: int
    rows_per_fringe: float
    contrast: float
    gain: int
    smear_rows: float
    warning: str | None
    first: NDArray[np.int64]
    offsets: NDArray[np.int64]
    mean_row: NDArray[np.float64]


def tdi_contrast(rows: int, rows_per_fringe: float) -> float:
    """|sin(πN/P)/(N sin(π/P))|."""
    angle = np.pi / rows_per_fringe
    return float(abs(np.sin(rows * angle) / (rows * np.sin(angle))))


def plan_tdi(height: int, rows: int, rows_per_fringe: float, moves: Motion, repeats: int = 1, spacing: int = 0) -> Tdi:
    """What a TDI of ``rows`` rows does on a zone of ``height`` rows that holds ``repeats`` equal zones.

    A smear beyond half a row is said on standard error and in ``warning``: the charge is carried on by one row per
    frame, whatever the ground does.

    Raises MethodLimitError for rows > P/4; InputError for numbers that do not fit the zone.
    """
    if rows < 1 or repeats < 1 or (repeats > 1 and spacing < rows):
        raise InputError("tdi", "rows, repeats, spacing", (rows, repeats, spacing), "do not make sense together",
                         "one row or more, and zones that do not overlap")  # fmt: skip
    if rows > 1 and rows > rows_per_fringe / 4.0:
        raise MethodLimitError(
            METHOD, f"{rows} rows of {rows_per_fringe:.4g} per fringe, a quarter ({rows_per_fringe / 4.0:.4g}) at most",
            4.0 * rows / rows_per_fringe, "add fewer rows, or lower the OPD slope",
        )  # fmt: skip
    own = spacing if repeats > 1 else height
    if own * (repeats - 1) + rows > height:
        raise InputError("tdi", "spacing", spacing, f"{repeats} zones do not fit into {height} rows", "check the zones")
    zone = min(own, height - own * (repeats - 1))
    first = np.arange(zone // rows) * rows
    offsets = (np.arange(repeats)[:, None] * own + np.arange(rows)[None, :]).ravel() if repeats > 1 else np.arange(rows)
    smear = _smear(moves, int(offsets[-1]))
    warning = None
    if smear > SMEAR_LIMIT:
        warning = (f"TDI over {int(offsets[-1]) + 1} rows smears the ground by {smear:.3g} rows (limit {SMEAR_LIMIT}): "
                   f"the row rate is out of step at {moves.step:.6g} rows per frame")  # fmt: skip
        print(f"cgi-wave: {warning}", file=sys.stderr)
    kept = tdi_contrast(rows, rows_per_fringe)
    return Tdi(rows, repeats, spacing, rows_per_fringe, kept, rows * repeats, smear, warning, first, offsets,
               np.asarray(first + 0.5 * (rows - 1)))  # fmt: skip


class Charge:
    """Adds rows of following frames, each of the same ground."""

    def __init__(self, plan: Tdi) -> None:
        self._plan, self._depth, self._frame = plan, int(plan.offsets[-1]) + 1, 0
        self._held: Real | None = None

    def add(self, frame: Real) -> Real | None:
        """Take a frame; give the means (G, X) over the added rows, from frame ``plan.offsets[-1]`` on.

        Row i of the n-th one belongs to the ground on pixel row first[i] in frame offsets[-1] + n.
        """
        plan, k, depth = self._plan, self._frame, self._depth
        if self._held is None:
            self._held = np.zeros((depth, len(plan.first), frame.shape[1]), frame.dtype)
        for offset in plan.offsets[::-1]:
            self._held[(k + offset) % depth] += frame[plan.first + offset]
        full = self._held[k % depth] / frame.dtype.type(plan.gain)
        self._held[k % depth] = 0.0
        self._frame += 1
        return full if k >= depth - 1 else None


def _smear(moves: Motion, reach: int) -> float:
    """Spread of s_k − k over any reach + 1 following frames."""
    off = moves.rows - np.arange(len(moves.rows))
    if reach == 0:
        return 0.0
    window = np.lib.stride_tricks.sliding_window_view(off, min(reach + 1, len(off)))
    return float((window.max(axis=1) - window.min(axis=1)).max())
