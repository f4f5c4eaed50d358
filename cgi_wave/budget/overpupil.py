"""γ of a ghost with the nominal beam over the ghost's own pupil, in the chart where its rays are one to one.

What a direction-space field of the ghost cannot hold: directions that crowd, fold or collapse.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import CgiWaveError, FoldedFieldError, MethodLimitError
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.charts import PupilRays, rays_from_points
from cgi_wave.rays.clearances import limiting
from cgi_wave.rays.disc import disc
from cgi_wave.rays.feeding import FILLED, OVER, bounding_disc
from cgi_wave.rays.paths import Path
from cgi_wave.wave.field import PupilField, fit_field, power
from cgi_wave.wave.fold import COLLAPSE_LIMIT
from cgi_wave.wave.overlap import integral_over
from cgi_wave.wave.pullback import product_samples, shared
from cgi_wave.wave.samples import PupilSamples

Array = NDArray[np.float64]

#: Rays over the whole pupil, by which the chart is chosen, and over a part of it.
SURVEY, PART = 1600, 500
#: Bends that are tried, in units of the nominal cone over the ghost's extent on the detector.
BENDS = (0.25, 0.5, 1.0, 2.0, 4.0)
#: Parts into which a pupil is cut at most, and the shared rays without which one is not cut.
PARTS, FEWEST = 64, 40


@dataclass(frozen=True)
class PupilContrast:
    """γ of one ghost with the nominal beam, its bound, the bend of the chart (1/m) and the number of parts; ``note``
    says why the chart is not that of directions."""

    value: complex
    error: float
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


Nominal = Callable[[float], PupilField]


def contrast_over_pupil(
    system: OpticalSystem, path: Path, theta: Array, x0: Array, nominal: Nominal, tol: float, bend: float | None = None
) -> PupilContrast:
    """γ of ``path`` with the nominal beam for source direction ``theta``, about x0 (m), at the filter's centre.

    nominal: the nominal field in the chart of a bend, 1/m. tol: misfit of the product (rad of phase, amplitude and
    clearance together) above which the pupil is cut, and numerical error. bend: asked for; None: the least that serves.

    Raises EmptyBeamError, FoldedFieldError (no chart serves), MethodLimitError.
    """
    radius, sigma0 = system.pupil_radius, system.sigma0

    def trace(points: Array) -> PupilRays:
        return rays_from_points(system, path, theta, x0, sigma0, points)

    rays = _settle(trace, np.zeros(2), radius * OVER, SURVEY, (), lambda r: (r.clearance > 0.0).all(axis=0))
    own = power(_own_field(rays, path.label, tol))
    chart, note = choose_chart(rays, nominal, sigma0, path.label) if bend is None else (bend, "")
    near = nominal(chart)
    there = power(near)
    norm = float(np.sqrt(own[0][0] * there[0][near.sigma.size // 2]))
    total, error, cross, parts = 0.0j, 0.0, 0.0, 0
    area = float(np.sqrt(np.pi * np.prod(near.support.scale)))
    for field in _parts(trace, rays, near, chart, path.label, tol):
        value, off, size, _ = integral_over(field, tol * norm)
        total, error, cross, parts = total + value, error + off, cross + size, parts + 1
    # What the nominal field may be off by itself: phase, amplitude, and both powers in the normaliser.
    phase = min(2.0 * np.pi * sigma0 * near.opl_residual, 2.0) * cross / norm
    amplitude = near.amplitude_residual * area * np.sqrt(own[0][0]) / norm
    gamma = total / norm
    bound = error / norm + phase + amplitude + 0.5 * abs(gamma) * (own[1] + there[1])
    return PupilContrast(complex(gamma), float(bound), chart, parts, note)


def choose_chart(rays: PupilRays, nominal: Nominal, sigma: float, label: str) -> tuple[float, str]:
    """The chart of least bend, 1/m, in which the shared rays are one to one with their field, and why it is not 0.

    That asks for det ∂u/∂p of one sign over them, and the Fresnel number σa²√|det| of ``wave.fold`` everywhere. Raises
    FoldedFieldError if none does.
    """
    lit = (rays.clearance > 0.0).all(axis=0)
    p = rays.p[lit]
    area = 2.0 * ((p - p.mean(axis=0)) ** 2).sum(axis=1).mean()
    extent = float(np.abs(rays.x[lit]).max())
    unit = float(nominal(0.0).support.scale.max()) / extent
    note = ""
    for size in (0.0, *BENDS):
        best = (0.0, 0.0)
        for bend in (-size * unit, size * unit) if size else (0.0,):
            try:
                u, _, det = rays.chart(bend)
                here = shared(nominal(bend), u, rays.clearance)
            except CgiWaveError:
                continue
            if not here.any():
                continue
            least = sigma * area * np.sqrt(np.abs(det[here]).min())
            if size == 0.0:
                folded = bool(det[here].min() * det[here].max() <= 0.0)
                note = "directions fold" if folded else f"Fresnel number {least:.3g} in directions"
            if det[here].min() * det[here].max() > 0.0 and least > best[0]:
                best = (float(least), bend)
        if best[0] >= COLLAPSE_LIMIT:
            return best[1], "" if size == 0.0 else note
    raise FoldedFieldError(f"{label}: in no chart between directions and detector are its rays one to one ({note})")


def _settle(
    trace: Callable[[Array], PupilRays],
    centre: Array,
    half: float,
    count: int,
    cuts: tuple[_Cut, ...],
    chosen: Callable[[PupilRays], NDArray[np.bool_]],
) -> PupilRays:
    """Rays over a disc of the pupil, drawn in around the chosen ones until these fill it."""
    for _ in range(4):
        rays = trace(centre + half * disc(count))
        lit = chosen(rays)
        for cut in cuts:
            lit = lit & (cut.clearance(rays.p) > 0.0)
        if not lit.any() or lit.mean() >= FILLED:
            break
        centre, half = bounding_disc(rays.p[lit], half, count)
    return rays


def _own_field(rays: PupilRays, label: str, tol: float) -> PupilField:
    """The ghost's amplitude over its own pupil, for its power."""
    clearance = limiting(rays.clearance[:, None], rays.p)
    flat = np.zeros((1, len(rays.p)))
    return fit_field(PupilSamples(label, "pupil", rays.p[None], np.array([1.0]), flat, np.sqrt(rays.power)[None],
                                  clearance, rays.q[None], 0.0, (0.0, 0.0)), target=tol)  # fmt: skip


def _parts(
    trace: Callable[[Array], PupilRays], rays: PupilRays, near: PupilField, bend: float, label: str, tol: float
) -> Iterator[PupilField]:
    """The product of ghost and nominal field over parts of the pupil in which a polynomial follows it.

    A part is cut in two through the middle of its shared rays, so that light is on both sides and none is lost.
    """

    def lit(r: PupilRays) -> NDArray[np.bool_]:
        return shared(near, r.chart(bend)[0], r.clearance)

    at = rays.p[lit(rays)]
    if not len(at):
        return
    centre = 0.5 * (rays.p.min(axis=0) + rays.p.max(axis=0))
    half = float(np.sqrt(((rays.p - centre) ** 2).sum(axis=1)).max())
    waiting: list[tuple[Array, float, tuple[_Cut, ...]]] = [(*bounding_disc(at, half, len(rays.p)), ())]
    made = 1
    while waiting:
        centre, half, cuts = waiting.pop()
        part = _settle(trace, centre, half, PART, cuts, lit)
        field, misfit = _product(part, near, bend, cuts, label, tol)
        inside = lit(part)
        for cut in cuts:
            inside &= cut.clearance(part.p) > 0.0
        at = part.p[inside]
        if field is not None and (misfit <= tol or made >= PARTS or len(at) < FEWEST):
            yield field
            continue
        if made >= PARTS or len(at) < FEWEST:
            raise MethodLimitError("field over the pupil", f"{label}: {made} parts do not follow it", 1.0,
                                   "ask for a larger tolerance")  # fmt: skip
        axis = int(np.argmax(np.ptp(at, axis=0)))
        middle = float(np.median(at[:, axis]))
        half = float(np.sqrt(((part.p - part.p.mean(axis=0)) ** 2).sum(axis=1)).max())
        for side in (-1.0, 1.0):
            cut = _Cut(axis, middle, side)
            there = at[cut.clearance(at) > 0.0]
            waiting.append((*bounding_disc(there, half, PART), (*cuts, cut)))
        made += 1


def _product(
    rays: PupilRays, near: PupilField, bend: float, cuts: tuple[_Cut, ...], label: str, tol: float
) -> tuple[PupilField | None, float]:
    """The product as one field over a part of the pupil, and its misfit as a share; None where none can be fitted."""
    u, opl, det = rays.chart(bend)
    inside = shared(near, u, rays.clearance)
    for cut in cuts:
        inside &= cut.clearance(rays.p) > 0.0
    if not inside.any():
        return None, np.inf
    sign = np.sign(det[np.flatnonzero(inside)[0]])
    # Rays on another sheet are no continuation of this one.
    same = det * sign > 0.0
    if (inside & ~same).any():
        raise FoldedFieldError(f"{label}: det ∂u/∂p changes sign over the shared pupil in the chart of bend {bend:.3g}")
    phase = rays.phase(int(np.flatnonzero(inside)[0]), bend)
    half = float(np.ptp(rays.p, axis=0).max())
    clearance = limiting(rays.clearance[:, None], rays.p)[:, 0]
    edges = np.concatenate([clearance, *(cut.clearance(rays.p)[None] / half for cut in cuts)])
    samples = product_samples(label, rays.p[same], u[same], opl[same], rays.power[same], det[same], rays.q[same],
                              edges[:, same], phase, near)  # fmt: skip
    try:
        field = fit_field(samples, target=tol)
    except MethodLimitError:
        return None, np.inf
    largest = float(samples.amplitude.max())
    misfit = 2.0 * np.pi * float(field.sigma[0]) * field.opl_residual + field.amplitude_residual / largest
    return field, misfit + float(field.support.residual.max(initial=0.0))
