"""A scroll of a band over a scene: frames one after the other, and maps of M, B and NMA with and without ghosts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.frames import field_of
from cgi_wave.fringes.beams_on_scene import Beams, LayerPlan
from cgi_wave.fringes.detector import Detector
from cgi_wave.fringes.field import FringeField
from cgi_wave.fringes.imaging import Span
from cgi_wave.fringes.maps import (
    GroundFit,
    Maps,
    NmaErrors,
    Relation,
    Retrieved,
    Window,
    albedo_contrast,
    bias_by_contrast,
    nma_errors,
    window,
)
from cgi_wave.fringes.scroll import Motion, motion, streams
from cgi_wave.fringes.steady import SteadyFit
from cgi_wave.fringes.tdi import Charge, Tdi, plan_tdi
from cgi_wave.optics.system import load_instrument
from cgi_wave.ready import STRETCH, Images, Progress, Ready, Stopwatch, lit_rows, ready_for
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
    contrast: Real
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
    span = Span(float(moves.rows.min()), float(moves.rows.max()))
    ready = ready_for(loaded, traced, scene, span, True, "float32", progress, watch, fractions)
    phase = ready.phase
    middle = phase[:, phase.shape[1] // 2]
    per_fringe = 2.0 * np.pi * (len(middle) - 1) / abs(float(middle[-1] - middle[0]))
    plan = plan_tdi(len(middle), tdi, per_fringe, moves) if tdi != 1 else None
    fit, fit_moves = _fit_of(phase, traced, plan, moves)
    del phase
    run = GroundFit(fit, fit_moves, round(ready.zone.row), detector)
    film = _Film(total, ready.zone.shape)
    steady = _steady_fit(ready, fit, moves) if plan is None else None
    images = _Images(ready, steady is None)
    bare = GroundFit(fit, fit_moves, round(ready.zone.row)) if steady is None else None
    adders = _Added(plan), _Added(plan)
    recorded, nominal = Maps(run.most, fit, detector is not None), Maps(run.most, fit)
    for k, frames_of in enumerate(streams(images.beams, moves, STRETCH)):
        taken = frames_of[0] if detector is None else film.recorded(*detector.record(frames_of[0], k, seed))
        if sink is not None:
            sink(k, taken)
        film.watch(k, taken)
        for row in adders[0].rows(run, taken):
            recorded.add(*row)
            if steady is not None:
                nominal.add(row[0], steady.terms(images.row(row[0])), 0.0, row[3])
        for row in adders[1].rows(bare, frames_of[1]) if bare is not None else ():
            nominal.add(*row)
        if (k + 1) % 100 == 0:
            progress(f"{band}: frame {k + 1} of {total}, {len(recorded)} rows of ground")
    maps = nominal.retrieved(total), recorded.retrieved(total)
    watch.lap("frames")
    found = nma_errors(*maps)
    contrast = albedo_contrast(maps[0].baseline)
    flat = float(np.ptp(ready.scene.maps[0])) == 0.0
    y = ready.scene.origin_m[1] + maps[0].ground * ready.scene.pixel_m
    watch.lap("retrieval")
    relation = None if flat else bias_by_contrast(found.error, contrast)
    return Scrolled(
        band, ready.zone.x_m, np.asarray(y), ready.scene.ground_pixel_m, maps[0], maps[1], found, contrast, relation,
        moves, total, per_fringe, plan, film.saturated, *film.developed(), sum(images.errors.values()), images.errors,
        images.plans, ready.scene.source, loaded.name, loaded.hash, ready, watch.seconds,
    )  # fmt: skip


class _Images:
    """Images of the part of the scroll that frames are made of, and the largest errors of all parts."""

    def __init__(self, ready: Ready, nominal: bool) -> None:
        self.errors: dict[str, float] = {}
        self.plans: tuple[LayerPlan, ...] = ()
        self._ready, self._nominal = ready, nominal
        self._held: Images | None = None

    def beams(self, span: Span) -> tuple[Beams, ...]:
        """With ghosts, and without where frames without are wanted; the images before are let go first."""
        self._held = None
        held = self._held = self._ready.at(span, self._nominal)
        self.errors = {name: max(value, self.errors.get(name, 0.0)) for name, value in held.errors.items()}
        old = self.plans or held.beams.plans
        self.plans = tuple(max(pair, key=lambda plan: plan.error) for pair in zip(old, held.beams.plans, strict=True))
        return (held.beams,) if held.nominal_beams is None else (held.beams, held.nominal_beams)

    def row(self, ground: int) -> Real:
        """(K, C, X) the nominal image of a ground row."""
        assert self._held is not None
        image, zone = self._held.image, self._ready.zone
        if image is not None:
            return image.maps[:, :, ground - image.first]
        first = round(zone.column)
        return self._ready.scene.maps[None, :, ground, first : first + zone.shape[1]]


def _steady_fit(ready: Ready, fit: Window, moves: Motion) -> SteadyFit | None:
    """The retrieval of nominal maps without frames; None where rows are not seen once each, and in whole."""
    places = [ready.zone.row] if ready.blur is not None else [ready.zone.row, ready.zone.column]
    if not moves.regular or np.any(moves.rows % 1.0) or np.any(np.array(places) % 1.0):
        return None
    (layer,) = ready.nominal_layers
    along = np.ones((1, ready.zone.shape[0])) if ready.blur is None else ready.blur.along
    return SteadyFit(fit, layer.pattern, along)


def _fit_of(phase: Array, field: FringeField, plan: Tdi | None, moves: Motion) -> tuple[Window, Motion]:
    """The window of the fit and the motion of what it is fed with: frames, or means over TDI rows.

    A mean stands on the first of its rows, in frames as long as the others, with the phase of the mean OPD. Rows in
    dead zones, and means that one of them is in, take no part.
    """
    lit = lit_rows(field)
    if plan is None:
        return window(phase, lit=lit), moves
    low = np.floor(plan.mean_row).astype(int)
    high = np.minimum(low + 1, len(phase) - 1)
    part = (plan.mean_row - low)[:, None]
    bright = lit[plan.first[:, None] + plan.offsets[None, :]].all(axis=1)
    fit = window((1.0 - part) * phase[low] + part * phase[high], lit=bright)
    return replace(fit, rows=plan.first[fit.rows]), Motion(moves.rows[int(plan.offsets[-1]) :], moves.step)


class _Added:
    """Frames as they are, or means over TDI rows, each on the row that ``_fit_of`` says."""

    def __init__(self, plan: Tdi | None) -> None:
        self._plan = plan
        self._charge = None if plan is None else Charge(plan)
        self._full: Real | None = None

    def rows(self, run: GroundFit, frame: Real) -> Iterator[tuple[int, Real, Real, int]]:
        """Take a frame; give the ground rows that the fit has completed with it."""
        if self._plan is None or self._charge is None:
            return run.add(frame)
        mean = self._charge.add(frame)
        if mean is None:
            return iter(())
        if self._full is None:
            self._full = np.zeros((int(self._plan.first[-1] + self._plan.offsets[-1]) + 1, mean.shape[1]), mean.dtype)
        self._full[self._plan.first] = mean
        return run.add(self._full)


class _Film:
    """Keeps some frames, made coarser, and counts saturated pixels."""

    def __init__(self, frames: int, shape: tuple[int, int]) -> None:
        self.wanted = np.unique(np.linspace(0, frames - 1, min(STILLS, frames)).astype(np.int64))
        self.step = max(1, -(-max(shape) // STILL_SIZE))
        self.saturated = 0
        self._stills: list[Real] = []

    def recorded(self, frame: Real, saturated: int) -> Real:
        """A frame as the detector gives it, its saturated pixels counted."""
        self.saturated += saturated
        return frame

    def watch(self, k: int, frame: Real) -> None:
        """Look at a frame."""
        if len(self._stills) < len(self.wanted) and k == self.wanted[len(self._stills)]:
            s = self.step
            rows, columns = (size // s for size in frame.shape)
            self._stills.append(frame[: rows * s, : columns * s].reshape(rows, s, columns, s).mean(axis=(1, 3)))

    def developed(self) -> tuple[Real, NDArray[np.int64], int]:
        """The kept frames, their numbers, and the pixels along the side of one of theirs."""
        return np.array(self._stills), self.wanted, self.step
