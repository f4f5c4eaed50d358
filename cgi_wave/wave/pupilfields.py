"""Fields over the entrance pupil of one of two beams: their product in a chart where its rays are one to one with it.

``wave.pullback`` has the integral, ``rays.charts`` the charts, ``wave.overpupil`` the contrast. Where no polynomial
follows the product of the two fields, the pupil is cut.
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
from cgi_wave.wave.pullback import Meeting, meeting, product_samples
from cgi_wave.wave.samples import PupilSamples

#: Rays over the whole pupil, by which the chart is chosen, where these do not show its edge, and over a part of it.
SURVEY, MORE = 1000, 2000
#: Rays over the part of the pupil that lights the detector, where those over the whole are too few.
FEW = 400
#: Bends that are tried, in units of the other beam's cone over the ghost's extent on the detector.
BENDS = (0.25, 0.5, 1.0, 2.0, 4.0)
#: Charts of which the first that serves is kept, and the others are compared with it.
CHARTS = 3
#: Parts into which a pupil is cut at most, and the shared rays without which one is not cut.
PARTS, FEWEST = 64, 40
#: Least share of the light that is taken to be shared when a misfit is weighed by it.
LEAST = 0.01
#: Share of wanted rays from which those over the whole pupil are fitted, before others are traced around them.
REUSED = 0.3
#: A disc of rays that would shrink to no less than this stays as it is.
SETTLED = 0.9
#: Share of the misfit allowed that a fit is asked for: what counts in the end is the worst of the clearances that cut.
ENOUGH = 0.5
#: Degrees for a power: an amplitude without a phase asks for little, the clearances that bound it for more.
POWER_DEGREES = tuple(degree for degree in FINE_DEGREES if degree >= 10)
#: Misfit allowed where charts are only compared.
COMPARED = 1e-6
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
    @property
    def catch(self) -> Array: ...

    def chart(self, bend: float) -> tuple[Array, Array, Array]:
        """u, path length about it, det ∂u/∂p."""
        ...

    def phase(self, ray: int, bend: float) -> float:
        """Constant phase in a chart, by one ray."""
        ...


Trace = Callable[[Array], RaysOverPupil]
Other = Callable[[float], PupilField]


@dataclass(frozen=True)
class Product:
    """The product of two beams' fields over the pupil of one, in the chart of the other, ``near``: in parts."""

    near: PupilField
    parts: tuple[PupilField, ...]


@dataclass(frozen=True)
class PupilFields:
    """What γ is computed from.

    own: the ghost's amplitude over its pupil where it lights the detector, for its power; light: power of all that
    passes the apertures, as far as rays tell; products: the one that is kept first, and others to compare it with;
    note: why its chart is not that of directions.
    """

    own: PupilField
    light: float
    products: tuple[Product, ...]
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


class _Survey:
    """Rays over a pupil, and what is seen of them in the charts of another field, each looked at once."""

    def __init__(self, rays: RaysOverPupil) -> None:
        self.rays = rays
        self.passes = _passes(rays)
        self._seen: dict[float, Meeting] = {}

    def met(self, near: PupilField) -> Meeting:
        """The rays in the chart of ``near``."""
        if near.bend not in self._seen:
            self._seen[near.bend] = meeting(self.rays.chart(near.bend), self.passes, near)
        return self._seen[near.bend]


@dataclass(frozen=True)
class _Ghost:
    """What is known of a ghost before any chart: rays over its whole pupil, and its power on the detector."""

    label: str
    trace: Trace
    survey: _Survey
    power: float


def fields_over_pupil(
    trace: Trace, radius: float, other: Other, sigma: float, label: str, tol: float, bend: float | None = None
) -> PupilFields:
    """Fields of a ghost with another beam at one wavenumber, 1/m: see ``wave.overpupil.contrast_over_pupil``.

    Raises EmptyBeamError (no ray passes, or none of these lands on the detector), FoldedFieldError (no chart serves),
    MethodLimitError.
    """
    # Here every ray counts, since the worst of them says which charts serve.
    survey = _Survey(_settle(trace, np.zeros(2), radius * OVER, SURVEY, _passes, 1.0))
    caught = _caught(survey.rays)
    own = own_field(trace, _power_rays(survey.rays), caught, label, tol)
    ghost = _Ghost(label, trace, survey, float(power(own)[0][0]))
    light = ghost.power * float(survey.rays.power[survey.passes].sum() / survey.rays.power[caught].sum())
    if bend is not None:
        return PupilFields(own, light, (_product_in(ghost, other(bend), sigma, tol),), "")
    charts, note = choose_charts(survey, other, sigma, label)
    products: list[Product] = []
    refused: CgiWaveError | None = None
    for chart in charts:
        try:
            products.append(_product_in(ghost, other(chart), sigma, tol if not products else max(COMPARED, tol)))
        except (FoldedFieldError, MethodLimitError) as limit:  # more rays find what those of the survey missed
            refused = limit
        if chart == 0.0 or len(products) == CHARTS:
            break
    if not products and refused is not None:
        raise refused
    return PupilFields(own, light, tuple(products), note)


@dataclass(frozen=True)
class PowerRays:
    """What a power is fitted to: pupil points p (N, 2) m, power (N,), the clearances (K, N) that bound it, the
    detector's edge among them, directions q (N, 2)."""

    p: Array
    power: Array
    clearance: Array
    q: Array


def own_field(trace: Trace, known: PowerRays, caught: NDArray[np.bool_], label: str, tol: float) -> PupilField:
    """The field √power over the pupil of what lands on the detector, without a phase: for its power.

    known: rays over the whole pupil, and which of them are ``caught`` (N,); others are traced where these are few.
    Raises EmptyBeamError, MethodLimitError.
    """
    if not caught.any():
        raise EmptyBeamError(f"{label}: no ray that passes all apertures lands on the detector")
    around = bounding_disc(known.p[caught], _reach(known.p), len(known.p))
    try:
        enough = caught.mean() >= REUSED
        return _own(known if enough else _power_rays(_settle(trace, *around, FEW, _caught)), label, tol)
    except MethodLimitError:  # a sliver, whose edge lies between too few rays
        return _own(_power_rays(_settle(trace, *around, MORE, _caught)), label, tol)


def _power_rays(rays: RaysOverPupil) -> PowerRays:
    clearance = limiting(np.concatenate([rays.clearance, rays.catch])[:, None], rays.p)[:, 0]
    return PowerRays(rays.p, rays.power, clearance, rays.q)


def _own(rays: PowerRays, label: str, tol: float) -> PupilField:
    flat = np.zeros((1, len(rays.p)))
    samples = PupilSamples(label, "pupil", rays.p[None], np.array([1.0]), flat, np.sqrt(rays.power)[None],
                           rays.clearance[:, None], rays.q[None], 0.0, (0.0, 0.0))  # fmt: skip
    return fit_field(samples, target=tol, degrees=POWER_DEGREES)


def choose_charts(survey: _Survey, other: Other, sigma: float, label: str) -> tuple[list[float], str]:
    """Charts in which the shared rays are one to one with their field, the least bend (1/m) first, and why it is not 0.

    That asks for det ∂u/∂p of one sign over them, and the Fresnel number σa²√|det| of ``wave.fold`` everywhere: 0
    alone if it serves, else CHARTS or more if so many do. Raises FoldedFieldError if none does.
    """
    rays, lit = survey.rays, survey.passes
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
                met = survey.met(other(bend))
            except CgiWaveError:  # the other beam has no field in this chart
                continue
            if not met.lit.any():
                # As far as rays tell; the integral over the pupil says so exactly.
                if size == 0.0:
                    return [0.0], ""
                continue
            det = met.det[met.lit]
            least = sigma * area * np.sqrt(np.abs(det).min())
            folded = bool(det.min() * det.max() <= 0.0)
            if size == 0.0:
                note = "directions fold" if folded else f"Fresnel number {least:.3g} in directions"
            if not folded and least >= COLLAPSE_LIMIT:
                found.append((float(least), bend))
        if size == 0.0 and found:
            return [0.0], ""
        serve += [bend for _, bend in sorted(found, reverse=True)]
        if len(serve) >= CHARTS:
            break
    if not serve:
        raise FoldedFieldError(f"{label}: in no chart between directions and detector are its rays one to one ({note})")
    return serve, note


def _product_in(ghost: _Ghost, near: PupilField, sigma: float, tol: float) -> Product:
    norm = np.sqrt(ghost.power * power(near)[0][near.sigma.size // 2])
    # What is missed counts where light is shared.
    share = min(max(_shared(ghost.survey, near) / float(norm), LEAST), 1.0)
    return Product(near, tuple(_parts(ghost, near, tol / share)))


def _shared(survey: _Survey, near: PupilField) -> float:
    """∫ |product| d²p, as far as rays tell."""
    met, rays = survey.met(near), survey.rays
    both = met.lit[met.found.within]
    product = np.sqrt(rays.power[met.lit] * np.abs(met.det[met.lit])) * met.found.amplitude[both]
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
    inside = ghost.survey.met(near).lit
    if not inside.any():
        return
    waiting = [_Part(*_around(ghost.survey.rays, inside), ())]
    known = ghost.survey if inside.mean() >= REUSED else None
    made = 1
    while waiting:
        part = waiting.pop()
        last = made >= PARTS
        best: tuple[float, PupilField | None] = np.inf, None
        for count, degrees in ((SURVEY, FINE_DEGREES), (MORE, HIGH_DEGREES)):
            if known is not None:
                seen, known = known, None
            else:
                chosen = partial(_lit, near=near, cuts=part.cuts)
                seen = _Survey(_settle(ghost.trace, part.centre, part.half, count, chosen))
            inside = _within(seen.rays, seen.met(near).lit, part.cuts)
            field, misfit, refused = _fitted(
                ghost.label, seen, inside, near, part.cuts, tol, degrees, np.inf if last else tol
            )
            if misfit < best[0]:
                best = misfit, field
            if misfit <= tol:
                break
        if best[1] is not None and (best[0] <= tol or last):
            yield best[1]
            continue
        at = seen.rays.p[inside]
        if last or len(at) < FEWEST:
            raise MethodLimitError(_METHOD, f"{ghost.label}: {made} parts of the pupil, and still {refused}",
                                   made / PARTS, "ask for a larger tolerance")  # fmt: skip
        axis = int(np.argmax(np.ptp(at, axis=0)))
        for side in (-1.0, 1.0):
            cut = _Cut(axis, float(np.median(at[:, axis])), side)
            here = _within(seen.rays, inside, (cut,))
            waiting.append(_Part(*_around(seen.rays, here), (*part.cuts, cut)))
        made += 1


@dataclass(frozen=True)
class _Part:
    """A part of the pupil: a disc that holds it, and the cuts that bound it."""

    centre: Array
    half: float
    cuts: tuple[_Cut, ...]


def _lit(rays: RaysOverPupil, near: PupilField, cuts: tuple[_Cut, ...]) -> NDArray[np.bool_]:
    """(N,) which rays are shared with the other field, and on the lit side of all cuts."""
    return _within(rays, _Survey(rays).met(near).lit, cuts)


def _within(rays: RaysOverPupil, lit: NDArray[np.bool_], cuts: tuple[_Cut, ...]) -> NDArray[np.bool_]:
    for cut in cuts:
        lit = lit & (cut.clearance(rays.p) > 0.0)
    return lit


def _passes(rays: RaysOverPupil) -> NDArray[np.bool_]:
    return np.all(rays.clearance > 0.0, axis=0)


def _caught(rays: RaysOverPupil) -> NDArray[np.bool_]:
    """(N,) which rays pass all apertures and land on the detector."""
    return _passes(rays) & np.all(rays.catch > 0.0, axis=0)


def _around(rays: RaysOverPupil, chosen: NDArray[np.bool_]) -> tuple[Array, float]:
    """Disc around some of the rays, centre and radius."""
    return bounding_disc(rays.p[chosen], _reach(rays.p), len(rays.p))


def _reach(p: Array) -> float:
    """Radius of the disc that points (N, 2) fill."""
    return float(np.sqrt(((p - 0.5 * (p.min(axis=0) + p.max(axis=0))) ** 2).sum(axis=1)).max())


def _fitted(
    label: str,
    seen: _Survey,
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
    rays, met = seen.rays, seen.met(near)
    first = int(inside.argmax())
    # Rays on another sheet are no continuation of this one.
    same = met.det * met.det[first] > 0.0
    if (inside & ~same).any():
        raise FoldedFieldError(
            f"{label}: det ∂u/∂p changes sign over the shared pupil in the chart {near.bend:.3g} 1/m"
        )
    size = _reach(rays.p)
    edges = np.concatenate(
        [rays.clearance[bounding_rows(rays.clearance, rays.p)], *(cut.clearance(rays.p)[None] / size for cut in cuts)]
    )
    samples = product_samples(label, rays.p, met, same, rays.power, rays.q, edges, rays.phase(first, near.bend), near)
    try:
        field = fit_field(samples, target=ENOUGH * tol, degrees=degrees, limit=limit, powered=False)
    except MethodLimitError as limit:
        return None, np.inf, str(limit)
    misfit = 2.0 * np.pi * float(field.sigma[0]) * field.opl_residual
    misfit += field.amplitude_residual / float(samples.amplitude.max())
    return field, misfit + float(field.support.residual.max(initial=0.0)), ""
