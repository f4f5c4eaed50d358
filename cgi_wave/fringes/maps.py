"""Retrieval: modulation M, baseline B and NMA = M/B of every ground point, frame by frame; maps of their errors.

The model is that of ``nma``, over a window of whole nominal fringes centred in the zone, with the nominal phase known
on every pixel instead of along one line:

    d(j) ≈ B + drift·u_j + c1 cos θ + s1 sin θ + c2 cos 2θ + s2 sin 2θ,    θ(j, x) = nominal phase, u in [−1, 1]

A frame adds each of its rows to the right-hand sides of the ground row it sees; a ground row that has passed the window
is solved and leaves. Only the ground rows that are open are kept: six numbers per pixel of the window, at any length of
the sequence. Where every ground row is seen by the same rows the normal matrices are the same too; jitter and other row
rates give some ground rows a row twice or not at all, and those get their own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.fringes.detector import Detector
from cgi_wave.fringes.nma import MIN_ROWS, MIN_SAMPLES_PER_FRINGE
from cgi_wave.fringes.scroll import Motion
from cgi_wave.kernels.frames import gather_rows

Array = NDArray[np.float64]
Real = NDArray[np.floating]
METHOD = "fringe fit on the ground"
TERMS = 6
#: Ground rows of which less than this share of the window was seen are left out; where all frames are one row apart,
#: all that have not seen the whole of it.
LEAST_SEEN = 0.75
BLOCK = 256  # ground rows that ``albedo_contrast`` takes at a time


@dataclass(frozen=True)
class Window:
    """Rows of the fit, those in dead zones left out. rows, u (J,); cosine, sine (J, X) of the nominal phase; fringes :
    whole ones at the centre"""

    rows: NDArray[np.int64]
    u: Array
    cosine: Real
    sine: Real
    fringes: int

    def terms(self, row: int) -> Array:
        """(6, X) the model's terms on one of the rows, by its number in the window."""
        c, s = self.cosine[row].astype(np.float64), self.sine[row].astype(np.float64)
        return np.stack([np.ones_like(c), np.full_like(c, self.u[row]), c, s, c * c - s * s, 2.0 * c * s])

    def model(self, times: NDArray[np.int64] | None = None) -> Array:
        """(X, 6, 6) normal matrices, each row counted ``times`` (J,)."""
        count = np.ones(len(self.rows)) if times is None else times.astype(np.float64)
        normal = np.zeros((self.cosine.shape[1], TERMS, TERMS))
        for j in np.flatnonzero(count):
            term = self.terms(int(j)).T
            normal += count[j] * term[:, :, None] * term[:, None, :]
        return normal

    def inverse(self, normal: Array | None = None) -> Array:
        """(X, 6, 6) inverse normal matrices (None: of all rows, once each); terms that rows cannot tell apart get 0."""
        full = self.model() if normal is None else normal
        return np.asarray(np.linalg.pinv(full, rcond=1e-12, hermitian=True))


@dataclass(frozen=True)
class Retrieved:
    """Maps over ground rows and columns, (G, X) each unless said otherwise.

    ground : (G,) ground rows (of the scene, in samples); baseline, modulation, nma
    phase : rad, against the nominal phase less its value at the zone's middle row
    seen : (G,) rows that the fit had; window : rows of a full one; fringes : in it
    nma_error : standard error of the NMA by the detector's noise; 0 without a detector
    """

    ground: NDArray[np.int64]
    baseline: Real
    modulation: Real
    nma: Real
    phase: Real
    seen: NDArray[np.int64]
    window: int
    fringes: int
    nma_error: Real


def window(phase: Array, dtype: type = np.float32, lit: NDArray[np.bool_] | None = None) -> Window:
    """The longest window of whole fringes centred in the zone; phase (R, X) rad, of the nominal OPD at σ0.

    lit (R,) : rows that no dead zone shades; the others take no part in the fit, wherever in the window they lie.
    Raises MethodLimitError for fewer than 4 samples per fringe anywhere, less than a fringe, or fewer than 7 rows.
    """
    rows = len(phase)
    steepest = max(float(np.abs(b - a).max()) for a, b in pairwise(phase)) / (2.0 * np.pi)
    if steepest > (1.0 + 1e-9) / MIN_SAMPLES_PER_FRINGE:
        raise MethodLimitError(
            METHOD, f"at least {MIN_SAMPLES_PER_FRINGE:.0f} samples per fringe, here {1.0 / steepest:.3g}",
            MIN_SAMPLES_PER_FRINGE * steepest, "reduce the OPD slope or the row pitch",
        )  # fmt: skip
    middle = phase[:, phase.shape[1] // 2]
    frequency = abs(float(middle[-1] - middle[0])) / (2.0 * np.pi * (rows - 1))
    fringes = int(np.floor(frequency * (rows + 1) * (1.0 + 1e-9)))  # one row short is whole enough, as in ``nma``
    if fringes < 1 or rows < MIN_ROWS:
        raise MethodLimitError(
            METHOD, f"at least one whole fringe over {MIN_ROWS} rows, here {frequency * rows:.3g} over {rows}",
            max(1.0 / max(frequency * rows, 1e-300), MIN_ROWS / rows), "take a longer zone or a steeper OPD slope",
        )  # fmt: skip
    half = 0.5 * fringes / frequency
    offset = np.arange(rows) - 0.5 * (rows - 1)
    within = (offset >= -half * (1.0 + 1e-9)) & (offset < half * (1.0 - 1e-9))
    inside = np.flatnonzero(within if lit is None else within & lit)
    if len(inside) < MIN_ROWS:
        raise MethodLimitError(
            METHOD, f"at least {MIN_ROWS} rows outside dead zones, here {len(inside)}",
            MIN_ROWS / max(len(inside), 1), "take a longer zone",
        )  # fmt: skip
    cosine: Real = np.empty((len(inside), phase.shape[1]), dtype)
    sine: Real = np.empty_like(cosine)
    for k, j in enumerate(inside):  # row by row: nothing of double length is left behind
        theta = phase[j] - phase[rows // 2]
        cosine[k], sine[k] = np.cos(theta), np.sin(theta)
    return Window(inside, np.asarray(offset[inside] / half), cosine, sine, fringes)


class GroundFit:
    """Takes frames in order, gives maps of the ground rows that are complete; see the module.

    frames : the sequence's motion, known beforehand; first : ground row under pixel row 0 at scroll 0
    dtype of the sums: float32 errs by some 1e-6 of B over a thousand rows, float64 takes twice the memory
    """

    def __init__(self, fit: Window, moves: Motion, first: int = 0, detector: Detector | None = None,
                 dtype: type = np.float32) -> None:  # fmt: skip
        self.fit, self.detector = fit, detector
        self._whole = moves.whole + first
        ends = self._whole[:, None] + fit.rows[[0, -1]][None, :]
        self._low, self._high = int(ends.min()), int(ends.max())
        # The last frame in which a ground row may still be seen closes it: jitter may bring rows back.
        behind = np.minimum.accumulate((self._whole + int(fit.rows[0]))[::-1])[::-1]
        self._open_from = np.append(behind[1:], self._high + 1)
        ahead = np.maximum.accumulate(self._whole + int(fit.rows[-1]))
        depth = int((ahead - np.append(self._low, self._open_from[:-1])).max()) + 1
        self._ring: Real = np.zeros((depth, TERMS, fit.cosine.shape[1]), dtype)
        self._next, self._frame = self._low, 0
        self._normal = fit.model()
        self._full = fit.inverse(self._normal)
        self._least = len(fit.rows) if moves.regular else max(int(LEAST_SEEN * len(fit.rows)), TERMS + 1)
        self._times = np.zeros((depth, len(fit.rows)), np.int16)

    @property
    def most(self) -> int:
        """Ground rows that may be completed."""
        return self._high - self._low + 1

    def add(self, frame: Real) -> Iterator[tuple[int, Real, Real, int]]:
        """Take the next frame; give the ground rows it completed: (row, terms (6, X), error of the NMA (X,), seen)."""
        k = self._frame
        if k >= len(self._whole):
            raise InputError(
                "retrieval", "frames", k + 1, "are more than the motion has", "give the motion of all frames"
            )
        depth = len(self._ring)
        slot = (self._whole[k] + self.fit.rows) % depth
        gather_rows(self._ring, slot, frame, self.fit.rows, self.fit.cosine, self.fit.sine,
                    self.fit.u.astype(self.fit.cosine.dtype))  # fmt: skip
        self._times[slot, np.arange(len(slot))] += 1
        self._frame += 1
        while self._next < self._open_from[k]:
            place = self._next % depth
            times = self._times[place]
            seen = int((times > 0).sum())
            if seen >= self._least:
                yield self._next, *self._solve(self._ring[place].astype(np.float64), times), seen
            self._ring[place] = 0.0
            self._times[place] = 0
            self._next += 1

    def _solve(self, right: Array, times: NDArray[np.int16]) -> tuple[Real, Real]:
        inverse: Array = self._full
        if not np.all(times == 1):  # few rows differ from the full window
            changed = self._normal + self.fit.model(times.astype(np.int64) - 1)
            inverse = self.fit.inverse(changed)
        term = np.einsum("xab,bx->ax", inverse, right)
        own = self._ring.dtype  # what is kept of a long sequence is no finer than the sums
        if self.detector is None:
            return term.astype(own), np.zeros(right.shape[1], own)
        return term.astype(own), self._spread(term, inverse).astype(own)

    def _spread(self, term: Array, inverse: Array) -> Array:
        """Standard error of M/B: the noise of the mean level on every row, through the normal matrix.

        Fringes move the shot noise between rows; over whole fringes that changes the error in second order only.
        """
        assert self.detector is not None
        base, modulation = term[0], np.hypot(term[2], term[3])
        tiny = np.finfo(float).tiny
        along = np.zeros_like(term)
        safe = np.where(base > 0.0, base, 1.0)
        along[2:4] = term[2:4] / np.maximum(modulation, tiny) / safe
        along[0] = -modulation / safe**2
        variance = np.einsum("ax,xab,bx->x", along, inverse, along) * self.detector.variance(base)
        return np.sqrt(np.maximum(variance, 0.0))


def retrieve_ground(
    frames: Iterable[Real], phase: Array, moves: Motion, first: int = 0, detector: Detector | None = None,
    dtype: type = np.float32, lit: NDArray[np.bool_] | None = None,
) -> Retrieved:  # fmt: skip
    """Maps of a whole sequence. frames : (R, X) each; phase (R, X) rad of the nominal OPD; first : see ``GroundFit``;
    lit (R,) : see ``window``.

    Raises MethodLimitError as ``window`` does, InputError when no ground point passes enough of the window.
    """
    fit = window(phase, dtype, lit)
    run = GroundFit(fit, moves, first, detector, dtype)
    maps = Maps(run.most, fit, detector is not None)
    for frame in frames:
        for row in run.add(frame):
            maps.add(*row)
    return maps.retrieved(len(moves.rows))


class Maps:
    """Gathers the ground rows that ``GroundFit.add`` gives, at most so many: memory is taken as they come. noise :
    their errors are not 0."""

    def __init__(self, rows: int, fit: Window, noise: bool = False) -> None:
        self._fit, self._count = fit, 0
        self._ground, self._seen = np.zeros(rows, np.int64), np.zeros(rows, np.int64)
        self._maps: Real = np.empty((4 if noise else 3, rows, fit.cosine.shape[1]), fit.cosine.dtype)

    def add(self, ground: int, term: Real, error: Real | float, seen: int) -> None:
        """Take a ground row: its terms (6, X), the error of its NMA (X,), and how many rows saw it."""
        k, maps = self._count, self._maps
        self._ground[k], self._seen[k] = ground, seen
        maps[0, k], maps[1, k] = term[0], np.hypot(term[2], term[3])
        maps[2, k] = np.arctan2(-term[3], term[2])
        if len(maps) > 3:
            maps[3, k] = error
        self._count += 1

    def __len__(self) -> int:
        return self._count

    def retrieved(self, frames: int) -> Retrieved:
        """The maps. frames : of the sequence. Raises InputError when no ground row is complete."""
        fit, some = self._fit, slice(0, self._count)
        if not self._count:
            raise InputError("retrieval", "frames", frames, f"no ground point passes all of {len(fit.rows)} rows",
                             f"take {len(fit.rows)} frames or more")  # fmt: skip
        baseline, modulation, phase = self._maps[:3, some]
        error = self._maps[3, some] if len(self._maps) > 3 else np.broadcast_to(baseline.dtype.type(0), baseline.shape)
        lit = np.abs(baseline) > np.finfo(float).tiny
        return Retrieved(
            ground=self._ground[some], baseline=baseline, modulation=modulation,
            nma=np.divide(modulation, baseline, out=np.zeros_like(baseline), where=lit), phase=phase,
            seen=self._seen[some], window=len(fit.rows), fringes=fit.fringes, nma_error=error,
        )  # fmt: skip


@dataclass(frozen=True)
class NmaErrors:
    """error : (G, X) 1 − NMA with ghosts/NMA without, positive when it falls; mean, spread (standard deviation), and
    low, high : percentiles 2.5 and 97.5; size_95 : percentile 95 of |error|; unlit : points without a nominal NMA, left
    out (0 in the map)."""

    error: Real
    mean: float
    spread: float
    low: float
    high: float
    size_95: float
    unlit: int


def nma_errors(nominal: Retrieved, with_ghosts: Retrieved, floor: float = 1e-3) -> NmaErrors:
    """The NMA error map and its statistics over the scene. ``floor``: NMA below which the ratio means nothing.

    Raises InputError for maps of different ground, MethodLimitError when no point has an NMA above the floor.
    """
    if nominal.nma.shape != with_ghosts.nma.shape or not np.array_equal(nominal.ground, with_ghosts.ground):
        raise InputError("nma_errors", "maps", with_ghosts.nma.shape, f"do not cover the ground of {nominal.nma.shape}",
                         "retrieve both from sequences of one motion")  # fmt: skip
    lit = (nominal.nma > floor) & (with_ghosts.baseline > 0.0)
    if not lit.any():
        best = float(nominal.nma.max())
        raise MethodLimitError(METHOD, f"no NMA above {floor:g}", floor / max(best, np.finfo(float).tiny),
                               "choose an OPD where the scene modulates")  # fmt: skip
    error = np.zeros_like(nominal.nma)
    error[lit] = 1.0 - with_ghosts.nma[lit] / nominal.nma[lit]
    values = error[lit]
    low, high = np.percentile(values, [2.5, 97.5])
    return NmaErrors(error, float(values.mean()), float(values.std()), float(low), float(high),
                     float(np.percentile(np.abs(values), 95.0)), int((~lit).sum()))  # fmt: skip


def albedo_contrast(baseline: Real, reach: int = 7) -> Real:
    """(G, X) (own − mean around)/(own + mean around): negative on dark ground near bright. reach : size of the box."""
    from scipy.ndimage import uniform_filter

    out = np.zeros_like(baseline)
    for first in range(0, len(baseline), BLOCK):  # all at once it would take five times as much memory as the maps
        low, high = max(first - reach, 0), first + BLOCK + reach
        own = np.asarray(baseline[low:high], dtype=np.float64)
        around = uniform_filter(own, reach, mode="nearest")
        total = own + around
        value = np.divide(own - around, total, out=np.zeros_like(total), where=total > 0.0)
        out[first : first + BLOCK] = value[first - low : first - low + BLOCK]
    return out


@dataclass(frozen=True)
class Relation:
    """centre : (N,) contrast; mean, spread, count : of the NMA error in each bin; slope : of error on contrast, least
    squares over all points; correlation"""

    centre: Array
    mean: Array
    spread: Array
    count: NDArray[np.int64]
    slope: float
    correlation: float


def bias_by_contrast(error: Real, contrast: Real, bins: int = 12) -> Relation:
    """The NMA error by local albedo contrast, in bins of as many points each. Bins of one value are joined."""
    flat, value = contrast.ravel(), error.ravel()
    edges = np.unique(np.quantile(flat, np.linspace(0.0, 1.0, bins + 1)))
    if len(edges) < 2:
        raise InputError(
            "bias_by_contrast", "contrast", float(flat[0]), "is the same everywhere", "take a scene with edges"
        )
    number = np.clip(np.searchsorted(edges, flat, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(number, minlength=len(edges) - 1)
    safe = np.maximum(count, 1)
    mean = np.bincount(number, value, len(edges) - 1) / safe
    spread = np.sqrt(np.maximum(np.bincount(number, value**2, len(edges) - 1) / safe - mean**2, 0.0))
    centre = np.bincount(number, flat, len(edges) - 1) / safe
    centred = flat - flat.mean()
    slope = float(centred @ value / (centred @ centred))
    scale = float(np.std(value) * np.std(flat))
    correlation = float(np.mean(centred * value) / scale) if scale > 0.0 else 0.0
    return Relation(centre, mean, spread, count, slope, correlation)
