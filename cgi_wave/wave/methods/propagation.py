"""Propagation between planes by a transfer function, and the overlap by it: from a pupil plane to the detector.

A field that converges on the detector with directions q has, a distance z before it, its pupil at p = −z q with phase
2πσ(opl(q) − p²/2z). Fresnel's integral from there to the detector gives h(x) exp(iπσx²/z): the same h, with a phase
that both beams of a pair have. In a plane the pupil is sharp; what its edges scatter has to stay in the window.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.methods.grid import Grid, covering, edge_error, sampled, shares
from cgi_wave.wave.methods.patch import Amplitude, Patch
from cgi_wave.wave.methods.planned import Plan, Planned
from cgi_wave.wave.methods.plans import fast_length, transform_rows
from cgi_wave.wave.methods.shape import Beam, Edge, Pair

NAME = "Fresnel propagation"
CAP = 4096  # samples along one side
Complex = NDArray[np.complex128]
Kernel = Literal["Fresnel", "angular spectrum"]
#: Pitch over the coarsest that holds the converging phase. A sum over the window wants it wide. For h itself the
#: spectrum needs room for what sharp edges add to it, or that folds back and stays at percents of the peak.
FOR_SUMS, FOR_PSF = 0.95, 0.6


def transfer_limit(size: int, pitch: float, sigma: float, distance: float, steepest: float) -> float:
    """By how much a transfer function over ``distance`` (m) is undersampled: allowed up to 1.

    Light of direction cosine ``steepest`` moves by distance·steepest, half of the window size·pitch at most; steeper
    light comes back on the other side. The directions that the pitch itself holds reach 1/(2σ·pitch).
    """
    direction = min(steepest, 0.5 / (sigma * pitch))
    slant = direction / math.sqrt(max(1.0 - direction**2, 1e-300))
    return abs(distance) * slant / (0.5 * size * pitch)


def propagate(
    field: Complex,
    pitch: float,
    sigma: float,
    distance: float,
    kernel: Kernel = "Fresnel",
    steepest: float | None = None,
) -> Complex:
    """A field (N, N) on points ``pitch`` (m) apart, ``distance`` (m) further on; the phase 2πσ·distance is left out.

    The window is periodic and the sum of |field|² is kept. ``steepest`` is the largest direction cosine of the light
    in it (all that the pitch holds by default).

    Raises MethodLimitError when light of that direction leaves the window: by what factor to widen it. InputError for
    a field that is not square, or a pitch or wavenumber that is not positive.
    """
    if field.ndim != 2 or field.shape[0] != field.shape[1]:
        raise InputError("propagate", "field", field.shape, "not square", "give (N, N)")
    if not (pitch > 0.0 and sigma > 0.0 and math.isfinite(distance)):
        raise InputError("propagate", "pitch, sigma, distance", (pitch, sigma, distance), "not lengths", "give m, 1/m")
    size = len(field)
    excess = transfer_limit(size, pitch, sigma, distance, 1.0 if steepest is None else steepest)
    if excess > 1.0:
        raise MethodLimitError(
            NAME,
            f"light leaves the window of {size * pitch:.3g} m over {distance:.3g} m",
            excess,
            f"take a window {excess:.3g} times wider, or state the steepest light in it",
        )
    f = np.fft.fftfreq(size, pitch)
    if kernel == "Fresnel":
        turns = 0.5 * distance / sigma * f**2
        one = np.exp(-2j * np.pi * (turns - np.rint(turns)))
        return _filtered(_filtered(field, one), one)
    root = np.sqrt(np.maximum(sigma**2 - f[:, None] ** 2 - f[None, :] ** 2, 0.0))
    turns = distance * (root - sigma)
    transfer = np.exp(2j * np.pi * (turns - np.rint(turns))) * (root > 0.0)
    spectrum = _forward(_forward(field)) * transfer
    back = transform_rows(transform_rows(spectrum, 0, size, 0, size), 0, size, 0, size)
    return back / size**2


def _forward(rows: Complex) -> Complex:
    """Transposed Σ_j rows[r, j] exp(−i 2π jk/N)."""
    n = rows.shape[1]
    return np.conj(transform_rows(np.conj(rows), 0, n, 0, n))


def _filtered(rows: Complex, transfer: Complex) -> Complex:
    """Rows filtered along their length by ``transfer`` (N,), and transposed."""
    n = rows.shape[1]
    spectrum = np.ascontiguousarray((_forward(rows) * transfer[:, None]).T)
    return transform_rows(spectrum, 0, n, 0, n) / n


@dataclass(frozen=True)
class Plane:
    """A pupil plane ``distance`` m before the detector: size × size points ``pitch`` m apart in both planes."""

    distance: float
    pitch: float
    size: int

    def cells(self, lo: Array, hi: Array) -> Grid:
        """The cells of the pupil coordinate that these points are."""
        p = self.pitch / self.distance
        grid = covering(lo, hi, (p, p))
        return Grid(grid.pitch, grid.first, (min(grid.count[0], self.size), min(grid.count[1], self.size)))


def choose_plane(beams: tuple[Beam, ...], edges: tuple[Edge, ...], cell: float, fill: float = FOR_PSF) -> Plane:
    """The plane in which points make cells of ``cell`` (unit of u): the pitch holds the converging phase.

    Its phase advances by σ(q + slope/z) turns per metre at most. The window holds the pupils and their rays.
    """
    sigma = beams[0].sigma
    u = np.concatenate([e.u for e in edges])
    cone = float(np.abs(u).max())
    lands = max(
        float(np.abs(b.slope_at(np.concatenate([e.u, e.inside]))).max()) for b, e in zip(beams, edges, strict=True)
    )
    # pitch = cell·z and σ·pitch·(cone + lands/z) <= 1/2 mean σ·cell·(cone·z + lands) <= 1/2; the farthest plane is best
    distance = (0.5 * fill / (sigma * cell) - lands) / cone
    if distance <= 0.0:
        factor = 2.0 * sigma * cell * lands / fill
        raise MethodLimitError(
            NAME,
            f"cells of {cell:.3g} undersample wavefronts that land {lands:.3g} m off",
            factor,
            f"resample {factor:.3g} times finer",
        )
    pitch = cell * distance
    span = 2.0 * max(cone * distance, lands) + 4.0 * pitch
    return Plane(distance, pitch, fast_length(math.ceil(span / pitch)))


def pupil_plane(beam: Beam, grid: Grid, share: Array, plane: Plane) -> Complex:
    """(size, size) field in the pupil plane, in FFT order (index 0 is the axis), without the beam's constant."""
    samples = sampled(beam, grid, share)
    turns = [0.5 * beam.sigma * plane.distance * grid.axis(a) ** 2 for a in (0, 1)]
    samples *= np.exp(-2j * np.pi * turns[0])[:, None] * np.exp(-2j * np.pi * turns[1])[None, :]
    # p = −z q: the plane's points run against the cells.
    rows, columns = (np.mod(-(np.arange(grid.count[a]) + grid.first[a]), plane.size) for a in (0, 1))
    out = np.zeros((plane.size, plane.size), np.complex128)
    out[np.ix_(rows, columns)] = samples * (1j / plane.distance)
    return out


def to_detector(beam: Beam, edge: Edge, plane: Plane, patch_points: int) -> Amplitude:
    """h about the reference point on ``patch_points`` a side, plane.pitch apart, without the beam's constant.

    No guard on the sampling: ``choose_plane`` gives it.
    """
    grid = plane.cells(edge.u.min(axis=0), edge.u.max(axis=0))
    field = pupil_plane(beam, grid, shares([beam.support], grid), plane)
    cone = float(np.abs(edge.u).max())
    field = propagate(field, plane.pitch, beam.sigma, plane.distance, steepest=min(cone, 0.5))
    index = np.arange(patch_points) - patch_points // 2
    patch = Patch((int(index[0]), int(index[0])), (patch_points, patch_points), (plane.pitch, plane.pitch))
    h = field[np.ix_(np.mod(index, plane.size), np.mod(index, plane.size))]
    turns = 0.5 * beam.sigma * patch.axis(0) ** 2 / plane.distance
    back = np.exp(-2j * np.pi * turns)
    h = h * back[:, None] * back[None, :]
    return Amplitude(patch.axis(0), patch.axis(1), h, beam.sigma, NAME, field.size, math.nan)


class Fresnel(Planned):
    """Overlap on the detector after propagation of both pupil fields from a plane before it.

    The transfer function keeps the sum over the window, light that comes back on the other side included, so that the
    error is that of the gray edge in the pupil plane; as for the whole-window FFT the common edge is put on m alone.
    Fresnel numbers N_F = a²σz take N = 4 N_F samples across a pupil of half-angle a.
    """

    name = NAME

    def __init__(self, cap: int = CAP) -> None:
        self.cap = cap

    def plan(self, pair: Pair, tol: float) -> Plan:
        """The coarsest cells whose bound by the edge law is at most ``tol``. Raises MethodLimitError."""
        lo, hi = pair.box
        fixed = pair.misfit + pair.rounding
        cell = float((hi - lo).max()) / 24.0
        while True:
            try:
                plane = choose_plane((pair.m, pair.l), pair.own, cell, FOR_SUMS)
                bound = edge_error(pair.m, pair.l, pair.common, (cell, cell)) / pair.norm + fixed
            except MethodLimitError as limit:
                cell /= 1.2 * limit.factor
                if float((hi - lo).max()) / cell > self.cap:
                    raise
                continue
            if plane.size > self.cap or fixed >= tol:
                factor = plane.size / self.cap if plane.size > self.cap else fixed / tol
                raise MethodLimitError(
                    self.name,
                    f"{plane.size} samples a side (limit {self.cap}) bound the error by {bound:.2g}",
                    max(factor, 1.0 + 1e-9),
                    "ask for a larger tolerance, or use boundary-fitted quadrature",
                )
            if bound <= tol:
                return Plan(bound, 8.0 * plane.size**2 * math.log2(plane.size), (plane, cell))
            cell /= min(2.0, max(1.05, math.sqrt((bound - fixed) / (tol - fixed))))

    def carry_out(self, pair: Pair, plan: Plan) -> tuple[complex, float, int]:
        """The sum over the detector's window."""
        plane: Plane = plan.sampling[0]
        grid = plane.cells(*pair.box)
        share = shares([pair.m.support, pair.l.support], grid)
        cone = max(float(np.abs(e.u).max()) for e in pair.own)
        h = [
            propagate(
                pupil_plane(b, grid, weight, plane), plane.pitch, b.sigma, plane.distance, steepest=min(cone, 0.5)
            )
            for b, weight in ((pair.m, share), (pair.l, (share > 0.0).astype(float)))
        ]
        value = complex(np.vdot(h[1], h[0])) * plane.pitch**2 / pair.norm * pair.constant
        return value, plan.bound, plane.size**2
