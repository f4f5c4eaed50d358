"""Smooth pupil fields from traced samples: polynomials of path length, amplitude and clearances, with residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError, FoldedFieldError, InputError, MethodLimitError
from cgi_wave.kernels.bounds import terms_used
from cgi_wave.kernels.power import products
from cgi_wave.kernels.samples import gathered, least_and_range, not_finite, prepared
from cgi_wave.wave.basis import Array, at_points, expand, lagrange
from cgi_wave.wave.fitting import OVERSAMPLING, Climb, polynomials
from cgi_wave.wave.region import SAFETY, Region, Support, segments
from cgi_wave.wave.samples import PupilSamples, Space
from cgi_wave.wave.support import MARGIN, cutting, fenced, unshadowed

DEGREES = (4, 6, 8, 10, 12, 14, 16)
FINE_DEGREES = (*DEGREES, 18, 20)  # where samples are many and a misfit of 1e-7 rad is asked for
HIGH_DEGREES = (*FINE_DEGREES, 22, 24, 26, 28, 30)  # where they are a thousand and more
TARGET = 1e-6  # misfit (rad of phase, relative amplitude, clearance) below which no higher degree is tried
NEARLY = 1.5  # a clearance of lower degree serves if its residual is at most this times the best
FEWEST = 12  # supported samples without which no field is fitted
SPARSE = 0.4  # sample spacing at most, in units of the ellipse that bounds the lit samples
POWER_SHARE = 0.3  # numerical error asked of the power, as a share of the misfit that is asked for
_METHOD = "polynomial pupil field"


@dataclass(frozen=True)
class PupilField:
    """One beam's complex field A(u) exp(i 2πσ·opl(u) + i·phase) on its support.

    Polynomials are Chebyshev products, coef[..., i, j] T_i(x) T_j(y), i + j < n, on the scaled coordinates
    (x, y) = (u - support.centre) / support.scale.

    sigma : (S,) 1/m; between (and slightly beyond) them every quantity is the Lagrange polynomial in sigma
    opl : (S, n, n) m; amplitude : (S, n, n); direction : (2, n, n) detector direction cosines at the middle sigma
    power_gram : (S, S) integrals of A_s A_r d²u, so that power(sigma) = L G Lᵀ with the Lagrange weights L; empty for
    a product of two beams, which has no power
    power_error : relative error bound of the power
    bend : of the chart, 1/m; see ``PupilSamples``
    opl_residual : m; amplitude_residual : unit of the amplitude. Largest leave-one-out misfit on the support
    """

    label: str
    space: Space
    sigma: Array
    support: Support
    opl: Array
    amplitude: Array
    direction: Array
    phase: float
    reference_point: tuple[float, float]
    power_gram: Array
    power_error: float
    opl_residual: float
    amplitude_residual: float
    degree: int
    bend: float = 0.0

    def weights(self, sigma: Array) -> Array:
        """(T, S) Lagrange weights at ``sigma`` (T,), 1/m.

        Raises MethodLimitError outside the range for which ``self.sigma`` are the Chebyshev nodes.
        """
        nodes = self.sigma
        middle, half = 0.5 * (nodes[0] + nodes[-1]), 0.5 * (nodes[-1] - nodes[0])
        reach = half / np.cos(0.5 * np.pi / nodes.size) * 1.001 if nodes.size > 1 else middle * 1e-9
        excess = float(np.max(np.abs(sigma - middle)) / reach)
        if excess > 1.0:
            raise MethodLimitError(
                _METHOD,
                f"{self.label} is traced for {nodes[0]:.8g} to {nodes[-1]:.8g} 1/m",
                excess,
                "trace the beam at Chebyshev wavenumbers of the range that is asked for",
            )
        return lagrange(nodes, sigma)

    def power_at(self, sigma: Array) -> Array:
        """(T,) power at ``sigma`` (T,), 1/m."""
        weights = self.weights(sigma)
        return np.einsum("ts,sr,tr->t", weights, self.power_gram, weights)


def power(field: PupilField) -> tuple[Array, float]:
    """Power, ∫A² d²u, at the field's own wavenumbers (S,), and its relative error bound.

    Raises InputError for a field that was fitted without.
    """
    if not field.power_gram.size:
        raise InputError(field.label, "power_gram", "nothing", "was not asked for", "fit the field with powered=True")
    return np.diag(field.power_gram).copy(), field.power_error


def _check(samples: PupilSamples) -> None:
    """Shapes and finiteness, with a named error for each."""
    source = f"samples of {samples.label}"
    for name in ("sigma", "u", "opl", "amplitude", "clearance", "direction"):
        bad = not_finite(getattr(samples, name))
        if bad:
            raise InputError(source, name, f"{bad} values", "not finite", "leave rays that failed out of the samples")
    s, n = samples.opl.shape
    expected = {"u": (s, n, 2), "sigma": (s,), "amplitude": (s, n), "direction": (s, n, 2)}
    for name, shape in expected.items():
        got = getattr(samples, name).shape
        if got != shape:
            raise InputError(source, name, got, f"shape is not {shape}", "give one value per wavenumber and ray")
    if samples.clearance.ndim != 3 or samples.clearance.shape[0] < 1 or samples.clearance.shape[1:] != (s, n):
        raise InputError(source, "clearance", samples.clearance.shape, f"shape is not (K, {s}, {n})", "K >= 1")
    if np.any(np.diff(samples.sigma) <= 0):
        raise InputError(source, "sigma", samples.sigma.tolist(), "not ascending", "sort the wavenumbers")


class _Fits:
    """All polynomials of a field, for growing degrees: path and amplitude per sigma, clearances, directions at one.

    terms (D,): of the degrees that were tried; opl, amplitude (D,): their largest leave-one-out misfits on the support;
    edge (D, K): those of the clearances near their zeros, and over (D, K) everywhere; score (D,): what is compared with
    the target; mean (S,): path length that is left out of the fits.
    """

    def __init__(
        self,
        samples: PupilSamples,
        x: Array,
        inside: NDArray[np.bool_],
        lit: NDArray[np.bool_],
        degrees: Sequence[int],
        target: float,
        limit: float,
    ) -> None:
        """x (S, N, 2) scaled points; inside, lit (S, N); stops at the first degree that does, or at one that says that
        none will."""
        s = samples
        count, self._middle, self._clearances = s.sigma.size, s.sigma.size // 2, len(s.clearance)
        phase = 2.0 * np.pi * float(s.sigma[-1])
        weight = np.array([phase, 1.0 / max(float(np.sqrt(np.mean(s.amplitude[lit] ** 2))), 1e-300)])
        terms, at = np.array(degrees) + 1, s.direction[self._middle]
        # In pupil space all wavenumbers share their points, and so one basis.
        self._shared = count == 1 or all(np.array_equal(x[0], other) for other in x[1:])
        if self._shared:
            take = inside.any(axis=0)
            values, chosen, near, edge, self.mean = gathered(
                s.opl, s.amplitude, s.clearance, at, lit, take, True, FEWEST
            )
            self._groups = [Climb(x[0][take], values, chosen, near, edge, terms, weight, target, limit)]
            worst = self._groups[0].worst
            self.opl, self.amplitude = worst[:, :count, 0].max(axis=1), worst[:, count : 2 * count, 0].max(axis=1)
        else:
            each = [
                gathered(s.opl[[k]], s.amplitude[[k]], s.clearance[:, [k]], at, lit[[k]], inside[k], k == self._middle,
                         FEWEST) for k in range(count)
            ]  # fmt: skip
            # All degrees, since what suffices is known when all wavenumbers are.
            self._groups = [
                Climb(x[k][inside[k]], values, chosen, near, edge, terms, weight)
                for k, (values, chosen, near, edge, _) in enumerate(each)
            ]
            self.mean = np.concatenate([mean for *_, mean in each])
            self.opl, self.amplitude = np.array([group.worst[:, :2, 0] for group in self._groups]).max(axis=0).T
        rest = self._groups[0 if self._shared else self._middle]
        first = 2 * (count if self._shared else 1)
        self._rest, self._first = rest, first
        self.terms = terms[: len(rest.worst)]
        self.edge, self.over = np.moveaxis(rest.worst[:, first : first + self._clearances], 2, 0)
        if not self._shared:
            self._follow([(x[k][inside[k]], *made[2:4]) for k, made in enumerate(each) if k != self._middle])
        self.score = weight[0] * self.opl + weight[1] * self.amplitude + self.edge.min(axis=1)

    def _follow(self, others: list[tuple[Array, Array, NDArray[np.bool_]]]) -> None:
        """One clearance polynomial serves all wavenumbers: its change with sigma is an error of it."""
        for t, n in enumerate(self.terms):
            coef = self.clearances(np.full(self._clearances, n), n)
            for points, clearance, edge in others:
                off = np.abs(clearance[0] - polynomials(coef, points)[:, 0])
                self.edge[t] = np.maximum(self.edge[t], np.where(edge[0], off, 0.0).max(axis=1))

    def paths(self, n: int) -> tuple[Array, Array]:
        """Path length (S, n, n), without its mean over the samples, and amplitude (S, n, n)."""
        half = self._first // 2
        both = np.array([group.coefficients(0, self._first, n) for group in self._groups])
        return both[:, :half].reshape(-1, n, n), both[:, half:].reshape(-1, n, n)

    def clearances(self, terms: NDArray[np.int64], n: int) -> Array:
        """(K, n, n) clearances at the middle sigma, each below a total degree of its own, terms (K,)."""
        return self._rest.coefficients(self._first, self._first + self._clearances, n, terms)

    def directions(self, n: int) -> Array:
        """(2, n, n) direction cosines at the middle sigma."""
        return self._rest.coefficients(self._first + self._clearances, None, n)


def _degrees(samples: PupilSamples, inside: NDArray[np.bool_], tried: Sequence[int]) -> list[int]:
    """The degrees to be tried: those with samples enough. Raises MethodLimitError if there is none."""
    fewest = int(inside.sum(axis=1).min())
    allowed = [d for d in tried if (d + 1) * (d + 2) // 2 * OVERSAMPLING <= fewest]
    if not allowed:
        terms = (tried[0] + 1) * (tried[0] + 2) // 2
        raise MethodLimitError(
            _METHOD,
            f"{samples.label}: {fewest} samples for the {terms} terms of degree {tried[0]}",
            terms * OVERSAMPLING / fewest,
            "trace more rays",
        )
    return allowed


def _simplest(fits: _Fits, best: int, target: float) -> tuple[NDArray[np.int64], Array]:
    """Terms per axis (K,) that serve each clearance, and its misfit (K,): the fewest that reach ``target`` or nearly
    the best. Footprints on apertures are nearly affine in the pupil, and every degree costs the boundary search a pass.
    """
    enough = np.maximum(target, NEARLY * fits.edge[best])
    serves = fits.edge[: best + 1] <= enough
    serves[best] = True
    chosen = serves.argmax(axis=0)
    return fits.terms[chosen], fits.edge[chosen, np.arange(len(chosen))]


def fit_field(
    samples: PupilSamples,
    degree: int | None = None,
    target: float = TARGET,
    degrees: Sequence[int] = DEGREES,
    limit: float = np.inf,
    powered: bool = True,
) -> PupilField:
    """Fit one beam's samples: path length (per sigma), amplitude, clearances, directions.

    The fit covers the ellipse that bounds the lit samples (all clearances > 0) with a margin; unlit samples inside it
    and next to a lit one take part. ``degree`` None takes the first of ``degrees`` whose leave-one-out misfit (rad of
    phase, relative amplitude and clearance together) is below ``target``, or the best.
    Clearances that cannot reach zero on the support are dropped. powered: whether the power is wanted.

    Raises InputError (a value that is not finite, a wrong shape), EmptyBeamError (no lit sample), MethodLimitError
    (too few samples; a support that reaches the edge of what was sampled; phases missed by more than ``limit``, rad,
    which saves what follows), FoldedFieldError (samples on a line).
    """
    _check(samples)
    middle = samples.sigma.size // 2
    lit, counts, centre, half, scale, spacing, x, inside = prepared(samples.u, samples.clearance, MARGIN, SPARSE)
    if counts.min() == 0:
        raise EmptyBeamError(f"{samples.label}: no sample has all clearances positive")
    if counts.min() < FEWEST:
        raise MethodLimitError(
            _METHOD, f"{samples.label}: {counts.min()} lit samples", FEWEST / counts.min(), "trace more rays"
        )
    if not half.min() > 0.0:
        raise FoldedFieldError(f"{samples.label}: the samples lie on a line; use the position-space field")
    tried = _degrees(samples, inside, degrees if degree is None else (degree,))
    fits = _Fits(samples, x, inside, lit, tried, target, limit)
    best = int(fits.score.argmin())
    missed = 2.0 * np.pi * float(samples.sigma[-1]) * float(fits.opl[best])
    if missed > limit:
        raise MethodLimitError(
            _METHOD,
            f"{samples.label}: phases are missed by {missed:.2g} rad (limit {limit:.2g})",
            missed / limit,
            "trace more rays, or take a part of the pupil",
        )
    n = int(fits.terms[best])
    terms, residual = _simplest(fits, best, target)
    clearance, points = fits.clearances(terms, n), x[middle][lit[middle]]
    cut = cutting(least_and_range(samples.clearance, lit), fits.over[best], clearance, points, spacing)
    support = unshadowed(Support(centre, scale, clearance[cut], residual[cut]))
    support = fenced(support, points, spacing, samples.label)
    opl, amplitude = fits.paths(n)
    opl[:, 0, 0] += fits.mean
    off = float(fits.amplitude[best])
    gram, error = np.empty((0, 0)), np.inf
    if powered:
        region = _region(support, samples.u[middle][lit[middle]], spacing)
        gram, error = _power(region, support, amplitude, off, samples.label, POWER_SHARE * target)
    return PupilField(
        samples.label,
        samples.space,
        samples.sigma,
        support,
        opl,
        amplitude,
        fits.directions(n),
        samples.phase,
        samples.reference_point,
        gram,
        error,
        float(fits.opl[best]),
        off,
        n - 1,
        samples.bend,
    )


def _region(support: Support, u: Array, spacing: float) -> Region:
    """The support as a region in a frame about its lit samples u (N, 2), which show where it is."""
    pivot = u.mean(axis=0)
    frame = np.abs(u - pivot).max(axis=0) + 1.5 * spacing * support.scale
    n = terms_used(support.clearance)
    clearance = expand(support.clearance[:, :n, :n], support.centre, support.scale, pivot, frame, n)
    ellipse = np.array([[*((support.centre - pivot) / frame), *(support.scale / frame)]])
    terms = support.clearance.shape[-1]
    return Region(pivot, frame, clearance, support.residual, ellipse, (u - pivot) / frame, terms)


def _power(
    region: Region, support: Support, amplitude: Array, residual: float, label: str, tol: float
) -> tuple[Array, float]:
    """Gram matrix (S, S) of the amplitudes over the support and the relative error bound of the power."""
    n = region.terms
    a = expand(amplitude, support.centre, support.scale, region.pivot, region.frame, n)
    spans, cornered = segments(region)
    # Integrals in the frame, whose unit of area is this one of u.
    area = float(np.prod(region.frame))
    rough = max(float((at_points(amplitude, np.zeros((1, 2))) ** 2).mean()), 1e-300)
    sums, inside, edge, tail, between = products(
        region.clearance, region.ellipses, region.residual, spans, cornered, a, *_radial_nodes(n), tol * rough
    )
    gram = sums * area
    least = float(np.diag(gram).min())
    if least <= 0.0:
        raise EmptyBeamError(f"{label}: the fitted support is empty")
    # |x|, |y| <= 1 in the frame: the sum of the coefficients bounds a polynomial there
    edge += between * float(np.abs(a[len(a) // 2]).sum()) ** 2
    numerical = (SAFETY * tail + edge) * area
    return gram, (numerical + 2.0 * residual * np.sqrt(inside * area * np.diag(gram).max())) / least


@lru_cache(maxsize=32)
def _radial_nodes(n: int) -> tuple[Array, Array]:
    """Gauss nodes and weights on (0, 1) that are exact for squares of n powers times the distance."""
    x, w = np.polynomial.legendre.leggauss(n)
    return 0.5 * (x + 1.0), 0.5 * w
