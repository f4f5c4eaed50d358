"""γ of two beams over the entrance pupil of one of them, in a chart where its rays are one to one with its field.

For what a direction-space field cannot hold: a ghost whose directions crowd, fold or collapse. ``wave.pullback`` has
the integral, ``rays.charts`` the charts. Where no polynomial follows the product of the two fields, the pupil is cut.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import CgiWaveError, EmptyBeamError, FoldedFieldError, MethodLimitError
from cgi_wave.rays.clearances import bounding_rows, limiting
from cgi_wave.rays.disc import disc
from cgi_wave.rays.feeding import FILLED, OVER, bounding_disc
from cgi_wave.wave.basis import Array
from cgi_wave.wave.field import FINE_DEGREES, HIGH_DEGREES, PupilField, fit_field, power
from cgi_wave.wave.fold import COLLAPSE_LIMIT
from cgi_wave.wave.overlap import integral_over
from cgi_wave.wave.pullback import look_up, product_samples, shared
from cgi_wave.wave.samples import PupilSamples

#: Rays over the whole pupil, by which the chart is chosen, where these do not show its edge, and over a part of it.
SURVEY, MORE = 1000, 2000
#: Bends that are tried, in units of the other beam's cone over the ghost's extent on the detector.
BENDS = (0.25, 0.5, 1.0, 2.0, 4.0)
#: Parts into which a pupil is cut at most, and the shared rays without which one is not cut.
PARTS, FEWEST = 64, 40
#: Least share of the light that is taken to be shared when a misfit is weighed by it.
LEAST = 0.01
#: Share of shared rays from which those over the whole pupil are fitted, before others are traced around them.
REUSED = 0.3
#: A disc of rays that would shrink to no less than this stays as it is.
SETTLED = 0.9
#: Share of the misfit allowed that a fit is asked for: what counts in the end is the worst of the clearances that cut.
ENOUGH = 0.5
#: Misfit allowed where charts are only compared, and by how much what the kept one is off may exceed a difference.
COMPARED, SAFETY = 1e-6, 2.0
_METHOD = "field over the pupil"


class RaysOverPupil(Protocol):
    """What is asked of rays: see ``rays.charts.PupilRays``."""

    @property
    def p(self) -> Array: ...
    @property
    def x(self) -> Array: ...
    @property
    def q(self) -> Array: ...
    @property
    def power(self) -> Array: ...
    @property
    def clearance(self) -> Array: ...

    def chart(self, bend: float) -> tuple[Array, Array, Array]:
        """u, path length about it, det ∂u/∂p."""
        ...

    def phase(self, ray: int, bend: float) -> float:
        """Constant phase in a chart, by one ray."""
        ...


Trace = Callable[[Array], RaysOverPupil]
Other = Callable[[float], PupilField]


@dataclass(frozen=True)
class PupilContrast:
    """γ of a pair, the path difference in it.

    error: bound as that of ``wave.overlap``; charts: twice the most by which other charts differ, 0 in that of
    directions; bend of the chart, 1/m; parts of the pupil; note: why it is not the chart of directions.
    """

    value: complex
    error: float
    charts: float
    bend: float
    parts: int
    note: str


@dataclass(frozen=True)
class _Cut:
    """A straight edge of a part of the pupil: lit where side · (p[axis] − at) > 0."""

    axis: int
    at: float
    side: float

    def clearance(self, p: Array) -> Array:
        away: Array = self.side * (p[:, self.axis] - self.at)
        return away


def contrast_over_pupil(
    trace: Trace, radius: float, other: Other, sigma: float, label: str, tol: float, bend: float | None = None
) -> PupilContrast:
    """γ of a ghost with another beam at one wavenumber, 1/m.

    trace: rays of the ghost from points (N, 2) of a pupil of ``radius``, m, about the point that ``other``, the other
    field in the chart of a bend (1/m), stands about. tol: misfit of the product (rad of phase, amplitude and clearance
    together) above which the pupil is cut, and numerical error. bend: asked for; None: the least that serves. Bent
    charts represent the same waves, but for what is diffracted at edges: up to two others that serve are compared.

    Raises EmptyBeamError, FoldedFieldError (no chart serves), MethodLimitError.
    """
    ghost = _ghost(trace, radius, label, tol)
    if bend is not None:
        return _in_chart(ghost, other(bend), sigma, tol)
    charts, note = choose_charts(ghost.rays, other, sigma, label)
    found = _in_chart(ghost, other(charts[0]), sigma, tol)
    differ = 0.0
    if charts[0] != 0.0:
        differ = abs(found.value) if len(charts) == 1 else 0.0
        for compared in charts[1:]:
            there = _in_chart(ghost, other(compared), sigma, max(COMPARED, tol))
            differ = max(differ, SAFETY * abs(there.value - found.value) + there.error)
    return PupilContrast(found.value, found.error, differ, found.bend, found.parts, note)


@dataclass(frozen=True)
class _Ghost:
    """What is known of a ghost before any chart: rays over its whole pupil, and its amplitude there as a field, for its
    power."""

    label: str
    trace: Trace
    rays: RaysOverPupil
    own: PupilField


def _ghost(trace: Trace, radius: float, label: str, tol: float) -> _Ghost:
    # Here every ray counts, since the worst of them says which charts serve.
    rays = _settle(trace, np.zeros(2), radius * OVER, SURVEY, _passes, 1.0)
    try:
        return _Ghost(label, trace, rays, _own_field(rays, label, tol))
    except MethodLimitError:  # a sliver, whose edge lies between too few rays
        more = _settle(trace, np.zeros(2), radius * OVER, MORE, _passes)
        return _Ghost(label, trace, rays, _own_field(more, label, tol))


def _own_field(rays: RaysOverPupil, label: str, tol: float) -> PupilField:
    clearance = limiting(rays.clearance[:, None], rays.p)
    flat = np.zeros((1, len(rays.p)))
    return fit_field(PupilSamples(label, "pupil", rays.p[None], np.array([1.0]), flat, np.sqrt(rays.power)[None],
                                  clearance, rays.q[None], 0.0, (0.0, 0.0)), target=tol)  # fmt: skip


def choose_charts(rays: RaysOverPupil, other: Other, sigma: float, label: str) -> tuple[list[float], str]:
    """Charts in which the shared rays are one to one with their field, the least bend (1/m) first, and why it is not 0.

    That asks for det ∂u/∂p of one sign over them, and the Fresnel number σa²√|det| of ``wave.fold`` everywhere: 0
    alone if it serves, else up to three. Raises FoldedFieldError if none does.
    """
    lit = _passes(rays)
    if not lit.any():
        raise EmptyBeamError(f"{label}: no ray passes")
    p = rays.p[lit]
    area = 2.0 * ((p - p.mean(axis=0)) ** 2).sum(axis=1).mean()
    unit = float(other(0.0).support.scale.max()) / float(np.abs(rays.x[lit]).max())
    unit = 2.0 ** round(np.log2(unit))  # so that many ghosts ask for the same charts
    note, serve = "no ray is shared", []
    for size in (0.0, *BENDS):
        found = []
        for bend in (-size * unit, size * unit) if size else (0.0,):
            try:
                u, _, det = rays.chart(bend)
                here = shared(other(bend), u, rays.clearance)
            except CgiWaveError:  # the other beam has no field in this chart
                continue
            if not here.any():
                # As far as rays tell; the integral over the pupil says so exactly.
                if size == 0.0:
                    return [0.0], ""
                continue
            least = sigma * area * np.sqrt(np.abs(det[here]).min())
            folded = bool(det[here].min() * det[here].max() <= 0.0)
            if size == 0.0:
                note = "directions fold" if folded else f"Fresnel number {least:.3g} in directions"
            if not folded and least >= COLLAPSE_LIMIT:
                found.append((float(least), bend))
        if size == 0.0 and found:
            return [0.0], ""
        serve += [bend for _, bend in sorted(found, reverse=True)]
        if len(serve) >= 3:
            break
    if not serve:
        raise FoldedFieldError(f"{label}: in no chart between directions and detector are its rays one to one ({note})")
    return serve[:3], note


def _in_chart(ghost: _Ghost, near: PupilField, sigma: float, tol: float) -> PupilContrast:
    mine, there = power(ghost.own), power(near)
    norm = float(np.sqrt(mine[0][0] * there[0][near.sigma.size // 2]))
    total, error, cross, parts = 0.0j, 0.0, 0.0, 0
    # What is missed counts where light is shared.
    share = min(max(_shared(ghost.rays, near) / norm, LEAST), 1.0)
    for field in _parts(ghost, near, tol / share):
        value, off, size, _ = integral_over(field, tol * norm)
        total, error, cross, parts = total + value, error + off, cross + size, parts + 1
    # What the other field may be off by itself: phase, amplitude, and both powers in the normaliser.
    phase = min(2.0 * np.pi * sigma * near.opl_residual, 2.0) * cross / norm
    area = float(np.sqrt(np.pi * np.prod(near.support.scale)))
    amplitude = near.amplitude_residual * area * np.sqrt(mine[0][0]) / norm
    gamma = total / norm
    bound = error / norm + phase + amplitude + 0.5 * abs(gamma) * (mine[1] + there[1])
    return PupilContrast(complex(gamma), float(bound), 0.0, near.bend, parts, "")


def _shared(rays: RaysOverPupil, near: PupilField) -> float:
    """∫ |product| d²p, as far as rays tell."""
    u, _, det = rays.chart(near.bend)
    lit = _lit(rays, near, ())
    product = np.sqrt(rays.power[lit] * np.abs(det[lit])) * look_up(near, u[lit]).amplitude
    return float(product.sum()) * np.pi * _reach(rays.p) ** 2 / len(rays.p)


def _settle(
    trace: Trace,
    centre: Array,
    half: float,
    count: int,
    chosen: Callable[[RaysOverPupil], NDArray[np.bool_]],
    settled: float = SETTLED,
) -> RaysOverPupil:
    """Rays over a disc of the pupil, drawn in around the chosen ones until these fill it, or it hardly shrinks."""
    for _ in range(4):
        rays = trace(centre + half * disc(count))
        lit = chosen(rays)
        if not lit.any() or lit.mean() >= FILLED:
            break
        before, (centre, half) = half, bounding_disc(rays.p[lit], half, count)
        if half >= settled * before:  # light of a shape that fills no disc
            break
    return rays


def _parts(ghost: _Ghost, near: PupilField, tol: float) -> Iterator[PupilField]:
    """The product of both fields over the whole pupil, or over parts of it in which a polynomial follows it.

    More rays and higher degrees come first: a pupil that is cut needs them again for each part. A part is cut in two
    through the middle of its shared rays, so that light is on both sides and none is lost.
    """
    inside = _lit(ghost.rays, near, ())
    if not inside.any():
        return
    first = _Part(*bounding_disc(ghost.rays.p[inside], _reach(ghost.rays.p), len(ghost.rays.p)), ())
    known = ghost.rays if inside.mean() >= REUSED else None
    waiting = [first]
    made = 1
    while waiting:
        part = waiting.pop()
        last = made >= PARTS
        best: tuple[float, PupilField | None] = np.inf, None
        for count, degrees in ((SURVEY, FINE_DEGREES), (MORE, HIGH_DEGREES)):
            if known is not None:
                rays, known = known, None
            else:
                rays = _settle(ghost.trace, part.centre, part.half, count, partial(_lit, near=near, cuts=part.cuts))
            inside = _lit(rays, near, part.cuts)
            field, misfit, refused = _product(
                ghost, rays, inside, near, part.cuts, tol, degrees, np.inf if last else tol
            )
            if misfit < best[0]:
                best = misfit, field
            if misfit <= tol:
                break
        if best[1] is not None and (best[0] <= tol or last):
            yield best[1]
            continue
        at = rays.p[inside]
        if last or len(at) < FEWEST:
            raise MethodLimitError(_METHOD, f"{ghost.label}: {made} parts of the pupil, and still {refused}",
                                   made / PARTS, "ask for a larger tolerance")  # fmt: skip
        axis = int(np.argmax(np.ptp(at, axis=0)))
        for side in (-1.0, 1.0):
            cut = _Cut(axis, float(np.median(at[:, axis])), side)
            there = at[cut.clearance(at) > 0.0]
            waiting.append(_Part(*bounding_disc(there, _reach(rays.p), len(rays.p)), (*part.cuts, cut)))
        made += 1


@dataclass(frozen=True)
class _Part:
    """A part of the pupil: a disc that holds it, and the cuts that bound it."""

    centre: Array
    half: float
    cuts: tuple[_Cut, ...]


def _lit(rays: RaysOverPupil, near: PupilField, cuts: tuple[_Cut, ...]) -> NDArray[np.bool_]:
    """(N,) which rays are shared with the other field, and on the lit side of all cuts."""
    here = shared(near, rays.chart(near.bend)[0], rays.clearance)
    for cut in cuts:
        here &= cut.clearance(rays.p) > 0.0
    return here


def _passes(rays: RaysOverPupil) -> NDArray[np.bool_]:
    return np.all(rays.clearance > 0.0, axis=0)


def _reach(p: Array) -> float:
    """Radius of the disc that points (N, 2) fill."""
    return float(np.sqrt(((p - 0.5 * (p.min(axis=0) + p.max(axis=0))) ** 2).sum(axis=1)).max())


def _product(
    ghost: _Ghost,
    rays: RaysOverPupil,
    inside: NDArray[np.bool_],
    near: PupilField,
    cuts: tuple[_Cut, ...],
    tol: float,
    degrees: Sequence[int],
    limit: float,
) -> tuple[PupilField | None, float, str]:
    """The product as one field over a part of the pupil, and its misfit as a share; None and why none can be fitted.

    limit: misfit of the phase, rad, beyond which none is wanted.

    Raises FoldedFieldError if the shared rays, ``inside``, are on more than one sheet.
    """
    if not inside.any():
        return None, np.inf, "no shared ray"
    u, opl, det = rays.chart(near.bend)
    first = int(np.flatnonzero(inside)[0])
    # Rays on another sheet are no continuation of this one.
    same = det * det[first] > 0.0
    if (inside & ~same).any():
        raise FoldedFieldError(
            f"{ghost.label}: det ∂u/∂p changes sign over the shared pupil in the chart {near.bend:.3g} 1/m"
        )
    size = _reach(rays.p)
    edges = np.concatenate(
        [rays.clearance[bounding_rows(rays.clearance, rays.p)], *(cut.clearance(rays.p)[None] / size for cut in cuts)]
    )
    samples = product_samples(ghost.label, rays.p[same], u[same], opl[same], rays.power[same], det[same], rays.q[same],
                              edges[:, same], rays.phase(first, near.bend), near)  # fmt: skip
    try:
        field = fit_field(samples, target=ENOUGH * tol, degrees=degrees, limit=limit)
    except MethodLimitError as limit:
        return None, np.inf, str(limit)
    misfit = 2.0 * np.pi * float(field.sigma[0]) * field.opl_residual
    misfit += field.amplitude_residual / float(samples.amplitude.max())
    return field, misfit + float(field.support.residual.max(initial=0.0)), ""
