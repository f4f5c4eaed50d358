"""A scroll of a band over a scene: frames one after the other, and maps of M, B and NMA with and without ghosts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.frames import Progress, Ready, Stopwatch, errors_of, field_of, lit_rows, ready_for
from cgi_wave.fringes.beams_on_scene import LayerPlan
from cgi_wave.fringes.detector import Detector
from cgi_wave.fringes.field import FringeField
from cgi_wave.fringes.maps import (
    GroundFit,
    NmaErrors,
    Relation,
    Retrieved,
    Window,
    albedo_contrast,
    bias_by_contrast,
    collected,
    nma_errors,
    window,
)
from cgi_wave.fringes.scroll import Motion, motion, stream
from cgi_wave.fringes.tdi import Tdi, accumulate, plan_tdi
from cgi_wave.optics.system import load_instrument
from cgi_wave.scene.ground import Scene

Array = NDArray[np.float64]
Real = NDArray[np.floating]
#: Frames kept for the waterfall at most, and their longest side, pixels.
STILLS, STILL_SIZE = 24, 256


@dataclass(frozen=True)
class Scrolled:
    """Maps of a scroll. nominal : without ghosts and noise; recorded : with both; (G, X) each, see ``Retrieved``.

    y_m (G,) : scene coordinate of the ground rows; x_m (X,); errors : of the NMA, map and statistics
    contrast (G, X) : local contrast of albedo; relation : of the NMA error to it, None for a scene without contrast
    ground_step_m : step of the maps on the ground; frames : of the sequence; moves : of the ground
    rows_per_fringe : at the zone's centre; tdi : what adding rows does, None for single rows; saturated : pixels
    stills (N, r, c), still_frames (N,) : some frames, made coarser by ``still_step``
    error : bound of what is wrong anywhere in a frame, relative irradiance, the sum of errors_by_part
    """

    band: str
    x_m: Array
    y_m: Array
    ground_step_m: float
    nominal: Retrieved
    recorded: Retrieved
    errors: NmaErrors
    contrast: Array
    relation: Relation | None
    moves: Motion
    frames: int
    rows_per_fringe: float
    tdi: Tdi | None
    saturated: int
    stills: Real
    still_frames: NDArray[np.int64]
    still_step: int
    error: float
    errors_by_part: dict[str, float]
    plans: tuple[LayerPlan, ...]
    scene: str
    instrument_name: str
    instrument_hash: str
    ready: Ready
    seconds: dict[str, float]


def scroll(
    band: str,
    scene: str | Path | Scene = "landsat",
    frames: int | None = None,
    step: float = 1.0,
    jitter: float = 0.0,
    attitude: float = 0.0,
    period: float = 100.0,
    tdi: int = 1,
    detector: Detector | None = None,
    seed: int = 0,
    instrument: str | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    field: FringeField | str | Path | None = None,
    sink: Callable[[int, Real], None] | None = None,
    progress: Progress = lambda _: None,
) -> Scrolled:
    """Scroll a scene past the band's zone, and retrieve M, B and NMA of every ground point that passes the window.

    frames : twice the zone's rows by default; step, jitter, attitude (rows), period (frames) : see ``fringes.scroll``;
    tdi : rows added along the scroll, a quarter of a fringe at most; detector : noise of the recorded frames, by seed;
    sink : called with number and (R, X) frame as recorded, before TDI; copy what is to stay. Else as ``frames.frame``.

    Raises InputError, EmptyBeamError, MethodLimitError.
    """
    watch = Stopwatch()
    loaded = load_instrument(instrument)
    rows = loaded.band(band).spec.zone_rows
    total = 2 * (rows[1] - rows[0]) if frames is None else frames
    moves = motion(total, step, jitter, attitude, period, seed)
    traced = field_of(loaded, band, instrument, tolerance, field, scene, float(np.ptp(moves.rows)), progress)
    watch.lap("field")
    if frames is None and total != 2 * len(traced.y_pixels):
        total = 2 * len(traced.y_pixels)
        moves = motion(total, step, jitter, attitude, period, seed)
    low = float(moves.rows.min())
    if low < 0.0:  # the scene begins where the first row looks
        moves = Motion(moves.rows + np.ceil(-low), moves.step)
    fractions = bool(np.any(moves.rows != np.rint(moves.rows)))
    ready = ready_for(loaded, traced, scene, float(moves.rows.max()), True, "float32", progress, watch, fractions)
    middle = ready.phase[:, ready.phase.shape[1] // 2]
    per_fringe = 2.0 * np.pi * (len(middle) - 1) / abs(float(middle[-1] - middle[0]))
    plan = plan_tdi(len(middle), tdi, per_fringe, moves) if tdi != 1 else None
    fit, fit_moves = _fit_of(ready, plan, moves)
    first = round(ready.zone.row)
    runs = [GroundFit(fit, fit_moves, first, noise) for noise in (None, detector)]
    film = _Film(total, ready.zone.shape)
    taken = film.watched(_recorded(stream(ready.beams, moves), detector, seed, film), sink)
    pairs = zip(_added(stream(ready.nominal_beams, moves), plan), _added(taken, plan), strict=True)
    done: tuple[list[tuple[int, Real, Real, int]], ...] = ([], [])
    for k, both in enumerate(pairs):
        for run, one, rows_done in zip(runs, both, done, strict=True):
            rows_done.extend(run.add(one))
        if (k + 1) % 100 == 0:
            progress(f"{band}: frame {k + 1} of {total}, {len(done[0])} rows of ground")
    nominal, recorded = (collected(part, fit, total) for part in done)
    watch.lap("frames")
    found = nma_errors(nominal, recorded)
    contrast = albedo_contrast(nominal.baseline)
    flat = float(np.ptp(ready.scene.maps[0])) == 0.0
    errors = errors_of(ready)
    y = ready.scene.origin_m[1] + nominal.ground * ready.scene.pixel_m
    watch.lap("retrieval")
    return Scrolled(
        band, ready.zone.x_m, np.asarray(y), ready.scene.ground_pixel_m, nominal, recorded, found, contrast,
        None if flat else bias_by_contrast(found.error, contrast), moves, total, per_fringe, plan, film.saturated,
        *film.developed(), sum(errors.values()), errors, ready.beams.plans, ready.scene.source, loaded.name,
        loaded.hash, ready, watch.seconds,
    )  # fmt: skip


def _fit_of(ready: Ready, plan: Tdi | None, moves: Motion) -> tuple[Window, Motion]:
    """The window of the fit and the motion of what it is fed with: frames, or means over TDI rows.

    A mean stands on the first of its rows, in frames as long as the others, with the phase of the mean OPD. Rows in
    dead zones, and means that one of them is in, take no part.
    """
    lit = lit_rows(ready.field)
    if plan is None:
        return window(ready.phase, lit=lit), moves
    low = np.floor(plan.mean_row).astype(int)
    high = np.minimum(low + 1, len(ready.phase) - 1)
    part = (plan.mean_row - low)[:, None]
    bright = lit[plan.first[:, None] + plan.offsets[None, :]].all(axis=1)
    fit = window((1.0 - part) * ready.phase[low] + part * ready.phase[high], lit=bright)
    return replace(fit, rows=plan.first[fit.rows]), Motion(moves.rows[int(plan.offsets[-1]) :], moves.step)


def _added(frames: Iterable[Real], plan: Tdi | None) -> Iterator[Real]:
    """Frames as they are, or means over TDI rows, each on the row that ``_fit_of`` says."""
    if plan is None:
        yield from frames
        return
    full: Real | None = None
    rows = int(plan.first[-1] + plan.offsets[-1]) + 1
    for mean in accumulate(frames, plan):
        if full is None:
            full = np.zeros((rows, mean.shape[1]), mean.dtype)
        full[plan.first] = mean
        yield full


class _Film:
    """Keeps some frames, made coarser, and counts saturated pixels."""

    def __init__(self, frames: int, shape: tuple[int, int]) -> None:
        self.wanted = np.unique(np.linspace(0, frames - 1, min(STILLS, frames)).astype(np.int64))
        self.step = max(1, -(-max(shape) // STILL_SIZE))
        self.saturated = 0
        self._stills: list[Real] = []

    def watched(self, frames: Iterable[Real], sink: Callable[[int, Real], None] | None) -> Iterator[Real]:
        for k, one in enumerate(frames):
            if sink is not None:
                sink(k, one)
            if len(self._stills) < len(self.wanted) and k == self.wanted[len(self._stills)]:
                s = self.step
                rows, columns = (size // s for size in one.shape)
                self._stills.append(one[: rows * s, : columns * s].reshape(rows, s, columns, s).mean(axis=(1, 3)))
            yield one

    def developed(self) -> tuple[Real, NDArray[np.int64], int]:
        return np.array(self._stills), self.wanted, self.step


def _recorded(frames: Iterable[Real], detector: Detector | None, seed: int, film: _Film) -> Iterator[Real]:
    if detector is None:
        yield from frames
        return
    for k, one in enumerate(frames):
        noisy, saturated = detector.record(one, k, seed)
        film.saturated += saturated
        yield noisy
