"""Smooth pupil fields from traced samples: polynomials of path length, amplitude and clearances, with residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import EmptyBeamError, InputError, MethodLimitError
from cgi_wave.kernels.fit import near_points
from cgi_wave.kernels.power import products
from cgi_wave.wave.basis import Array, at_points, expand, lagrange
from cgi_wave.wave.fitting import OVERSAMPLING, Nested, polynomials
from cgi_wave.wave.region import SAFETY, Region, Support, segments, trimmed
from cgi_wave.wave.samples import PupilSamples, Space
from cgi_wave.wave.support import cutting, domain, fenced, unshadowed

DEGREES = (4, 6, 8, 10, 12, 14, 16)
FINE_DEGREES = (*DEGREES, 18, 20)  # where samples are many and a misfit of 1e-7 rad is asked for
HIGH_DEGREES = (*FINE_DEGREES, 22, 24, 26, 28, 30)  # where they are a thousand and more
DOUBT = 30.0  # by how much a misfit that falls as before may miss the limit in the end, and yet be waited for
TARGET = 1e-6  # misfit (rad of phase, relative amplitude, clearance) below which no higher degree is tried
NEARLY = 1.5  # a clearance of lower degree serves if its residual is at most this times the best
FEWEST = 12  # supported samples without which no field is fitted
POWER_SHARE = 0.3  # numerical error asked of the power, as a share of the misfit that is asked for
_METHOD = "polynomial pupil field"


@dataclass(frozen=True)
class PupilField:
    """One beam's complex field A(u) exp(i 2πσ·opl(u) + i·phase) on its support.

    Polynomials are Chebyshev products, coef[..., i, j] T_i(x) T_j(y), i + j < n, on the scaled coordinates
    (x, y) = (u - support.centre) / support.scale.

    sigma : (S,) 1/m; between (and slightly beyond) them every quantity is the Lagrange polynomial in sigma
    opl : (S, n, n) m; amplitude : (S, n, n); direction : (2, n, n) detector direction cosines at the middle sigma
    power_gram : (S, S) integrals of A_s A_r d²u, so that power(sigma) = L G Lᵀ with the Lagrange weights L
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
    """Power, ∫A² d²u, at the field's own wavenumbers (S,), and its relative error bound."""
    return np.diag(field.power_gram).copy(), field.power_error


def _check(samples: PupilSamples) -> None:
    """Shapes and finiteness, with a named error for each."""
    source = f"samples of {samples.label}"
    for name in ("sigma", "u", "opl", "amplitude", "clearance", "direction"):
        bad = np.count_nonzero(~np.isfinite(getattr(samples, name)))
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


def _near(x: Array, lit: NDArray[np.bool_], spacing: float) -> NDArray[np.bool_]:
    """(S, N) samples that take part in the fit: in the domain, lit or within one spacing of a lit one.

    They hold the boundary; those further out would only ask the polynomial for what it need not do.
    """
    return np.array([near_points(here, chosen, spacing) for here, chosen in zip(x, lit, strict=True)])


@dataclass(frozen=True)
class _Trial:
    """What the fits of one degree (n terms per axis) leave over.

    opl, amplitude : largest leave-one-out misfit on the support; clearance_misfit (K,) that of the clearances near
    their zeros, and clearance_worst (K,) everywhere; score : what is compared with the target
    """

    n: int
    opl: float
    amplitude: float
    clearance_misfit: Array
    clearance_worst: Array
    score: float


class _Fits:
    """All polynomials of a field, for growing degrees: path and amplitude per sigma, clearances, directions at one."""

    def __init__(
        self, samples: PupilSamples, x: Array, inside: NDArray[np.bool_], lit: NDArray[np.bool_], most: int
    ) -> None:
        """x (S, N, 2) scaled points; inside, lit (S, N); ``most`` terms per axis at most."""
        self._samples, self._x, self._inside = samples, x, inside
        self._middle, self._clearances = samples.sigma.size // 2, samples.clearance.shape[0]
        count, middle = samples.sigma.size, self._middle
        self._lit = [lit[s][inside[s]] for s in range(count)]
        paths = [np.array([samples.opl[s] - samples.opl[s].mean(), samples.amplitude[s]]) for s in range(count)]
        rest = np.concatenate([samples.clearance[:, middle], samples.direction[middle].T])
        # In pupil space all wavenumbers share their points, and so one basis.
        self._shared = all(np.array_equal(x[s], x[0]) and np.array_equal(inside[s], inside[0]) for s in range(1, count))
        if self._shared:
            self._groups = [Nested(x[0][inside[0]], np.concatenate([*paths, rest])[:, inside[0]], most)]
        else:
            self._groups = [
                Nested(x[s][inside[s]], (np.concatenate([paths[s], rest]) if s == middle else paths[s])[:, inside[s]],
                       most) for s in range(count)
            ]  # fmt: skip
        values = [samples.clearance[:, s][:, inside[s]] for s in range(count)]
        self._values, self._edge = values, [_near_zero(v, on) for v, on in zip(values, self._lit, strict=True)]
        # Misfits count where light is, and for clearances near their zeros.
        self._chosen = [np.zeros(group.residual.shape, np.bool_) for group in self._groups]
        for s in range(count):
            at, row = self._at(s)
            self._chosen[at][row : row + 2] = self._lit[s]
        at, row = self._rest()
        self._chosen[at][row : row + self._clearances] = self._edge[middle]
        self._rms = max(float(np.sqrt(np.mean(samples.amplitude[lit] ** 2))), 1e-300)

    def _at(self, s: int) -> tuple[int, int]:
        """The number of the fit that holds path and amplitude of wavenumber s, and the row at which they stand."""
        return (0, 2 * s) if self._shared else (s, 0)

    def _rest(self) -> tuple[int, int]:
        """The number of the fit that holds clearances and directions, and the row of the first of them."""
        at, row = self._at(self._middle)
        return at, (2 * self._samples.sigma.size if self._shared else row + 2)

    def grow(self, n: int) -> _Trial:
        """Go on to n terms per axis."""
        for group in self._groups:
            group.grow(n)
        worst = [group.largest(chosen) for group, chosen in zip(self._groups, self._chosen, strict=True)]
        opl = amplitude = 0.0
        for s in range(len(self._lit)):
            at, first = self._at(s)
            opl, amplitude = max(opl, float(worst[at][first, 0])), max(amplitude, float(worst[at][first + 1, 0]))
        at, row = self._rest()
        clearance = worst[at][row : row + self._clearances]
        edge = self._clearance_misfit(clearance[:, 0], self._groups[at], row, n)
        score = 2.0 * np.pi * float(self._samples.sigma[-1]) * opl + amplitude / self._rms + float(edge.min())
        return _Trial(n, opl, amplitude, edge, clearance[:, 1], score)

    def _clearance_misfit(self, own: Array, here: Nested, row: int, n: int) -> Array:
        """(K,) largest misfit of each clearance near its zero; ``own`` (K,): leave-one-out, at the middle sigma.

        One clearance polynomial serves all wavenumbers: its change with sigma is an error of it.
        """
        last = row + self._clearances
        worst = own
        for s, value in enumerate(self._values):
            if s == self._middle:
                continue
            if self._shared:
                off = value - self._values[self._middle] + here.residual[row:last]
            else:
                points = self._x[s][self._inside[s]]
                off = value - polynomials(here.coefficients(slice(row, last), n), points)[:, 0]
            worst = np.maximum(worst, np.where(self._edge[s], np.abs(off), 0.0).max(axis=1))
        return worst

    def paths(self, n: int) -> tuple[Array, Array]:
        """Path length (S, n, n), without its mean over the samples, and amplitude (S, n, n)."""
        places = [self._at(s) for s in range(self._samples.sigma.size)]
        both = np.array([self._groups[at].coefficients(slice(row, row + 2), n) for at, row in places])
        return both[:, 0], both[:, 1]

    def clearances(self, n: int) -> Array:
        """(K, n, n) clearances at the middle sigma."""
        return self._of_rest(0, self._clearances, n)

    def clearance(self, k: int, n: int) -> Array:
        """(n, n) one clearance at the middle sigma."""
        return self._of_rest(k, k + 1, n)[0]

    def directions(self, n: int) -> Array:
        """(2, n, n) direction cosines at the middle sigma."""
        return self._of_rest(self._clearances, self._clearances + 2, n)

    def _of_rest(self, first: int, last: int, n: int) -> Array:
        at, row = self._rest()
        return self._groups[at].coefficients(slice(row + first, row + last), n)


def _near_zero(value: Array, lit: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(K, N) where clearances (K, N) are within a quarter of their range from zero; elsewhere a misfit moves nothing.

    Everywhere, if that is nearly nowhere.
    """
    near: NDArray[np.bool_] = np.abs(value) <= 0.25 * np.abs(value[:, lit]).max(axis=1, keepdims=True)
    near[near.sum(axis=1) < FEWEST] = True
    return near


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


def _choose(fits: _Fits, degrees: list[int], target: float, limit: float) -> tuple[_Trial, Array, Array]:
    """The first degree whose misfit is below ``target``, or the one with the least.

    None higher is tried once it is plain that the last would stay above ``limit``, as the misfit has fallen so far.

    With it the clearances (K, n, n) and their residuals (K,), each of the lowest degree that reaches ``target`` or
    nearly the best: footprints on apertures are nearly affine in the pupil, and every degree costs the boundary search
    a pass.
    """
    trials = [fits.grow(degrees[0] + 1)]
    best = trials[0]
    for d in degrees[1:]:
        if best.score < target or _hopeless(trials, degrees, limit):
            break
        trials.append(fits.grow(d + 1))
        best = trials[-1] if trials[-1].score < best.score else best
    coef, residual = fits.clearances(best.n), best.clearance_misfit.copy()
    for k in range(len(coef)):
        enough = max(target, NEARLY * float(best.clearance_misfit[k]))
        simple = next((t for t in trials if t.n < best.n and t.clearance_misfit[k] <= enough), None)
        if simple is not None:
            coef[k] = 0.0
            coef[k, : simple.n, : simple.n] = fits.clearance(k, simple.n)
            residual[k] = simple.clearance_misfit[k]
    return best, coef, residual


def _hopeless(trials: list[_Trial], degrees: list[int], limit: float) -> bool:
    """Whether the misfit, should it go on falling as it did last, stays far above ``limit`` at the last degree."""
    if len(trials) < 3 or limit == np.inf:
        return False
    fall = np.log(trials[-1].score / trials[-2].score) / (trials[-1].n - trials[-2].n)
    left = degrees[-1] + 1 - trials[-1].n
    return bool(np.log(trials[-1].score) + min(fall, 0.0) * left > np.log(DOUBT * limit))


def fit_field(
    samples: PupilSamples,
    degree: int | None = None,
    target: float = TARGET,
    degrees: Sequence[int] = DEGREES,
    limit: float = np.inf,
) -> PupilField:
    """Fit one beam's samples: path length (per sigma), amplitude, clearances, directions.

    The fit covers the ellipse that bounds the lit samples (all clearances > 0) with a margin; unlit samples inside it
    and next to a lit one take part. ``degree`` None takes the first of ``degrees`` whose leave-one-out misfit (rad of
    phase, relative amplitude and clearance together) is below ``target``, or the best.
    Clearances that cannot reach zero on the support are dropped.

    Raises InputError (a value that is not finite, a wrong shape), EmptyBeamError (no lit sample), MethodLimitError
    (too few samples; a support that reaches the edge of what was sampled; phases missed by more than ``limit``, rad,
    which saves what follows), FoldedFieldError (samples on a line).
    """
    _check(samples)
    lit = np.all(samples.clearance > 0.0, axis=0)
    counts = lit.sum(axis=1)
    if counts.min() == 0:
        raise EmptyBeamError(f"{samples.label}: no sample has all clearances positive")
    if counts.min() < FEWEST:
        raise MethodLimitError(
            _METHOD, f"{samples.label}: {counts.min()} lit samples", FEWEST / counts.min(), "trace more rays"
        )
    centre, scale, spacing = domain(samples, lit)
    x = (samples.u - centre) / scale
    inside = _near(x, lit, spacing)
    tried = _degrees(samples, inside, degrees if degree is None else (degree,))
    fits = _Fits(samples, x, inside, lit, tried[-1] + 1)
    trial, simple, residual = _choose(fits, tried, target, limit)
    missed = 2.0 * np.pi * float(samples.sigma[-1]) * trial.opl
    if missed > limit:
        raise MethodLimitError(
            _METHOD,
            f"{samples.label}: phases are missed by {missed:.2g} rad (limit {limit:.2g})",
            missed / limit,
            "trace more rays, or take a part of the pupil",
        )
    middle = samples.sigma.size // 2
    cut = cutting(
        samples.clearance[:, lit], trial.clearance_worst, fits.clearances(trial.n), x[middle][lit[middle]], spacing
    )
    support = unshadowed(Support(centre, scale, simple[cut], residual[cut]))
    support = fenced(support, x[middle][lit[middle]], spacing, samples.label)
    opl, amplitude = fits.paths(trial.n)
    opl[:, 0, 0] += samples.opl.mean(axis=1)
    region = _region(support, samples.u[middle][lit[middle]], spacing)
    gram, error = _power(region, support, amplitude, trial.amplitude, samples.label, POWER_SHARE * target)
    return PupilField(
        samples.label,
        samples.space,
        samples.sigma,
        support,
        opl,
        amplitude,
        fits.directions(trial.n),
        samples.phase,
        samples.reference_point,
        gram,
        error,
        trial.opl,
        trial.amplitude,
        trial.n - 1,
        samples.bend,
    )


def _region(support: Support, u: Array, spacing: float) -> Region:
    """The support as a region in a frame about its lit samples u (N, 2), which show where it is."""
    pivot = u.mean(axis=0)
    frame = np.abs(u - pivot).max(axis=0) + 1.5 * spacing * support.scale
    n = support.clearance.shape[-1]
    clearance = expand(support.clearance, support.centre, support.scale, pivot, frame, n)
    ellipse = np.array([[*((support.centre - pivot) / frame), *(support.scale / frame)]])
    return Region(pivot, frame, trimmed(clearance), support.residual, ellipse, (u - pivot) / frame, n)


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
