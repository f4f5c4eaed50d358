"""Smooth pupil fields from traced samples: polynomials of path length, amplitude and clearances, with residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cgi_wave.errors import EmptyBeamError, FoldedFieldError, InputError, MethodLimitError
from cgi_wave.wave.basis import Array, at_points, expand, lagrange
from cgi_wave.wave.fitting import OVERSAMPLING, Basis, Fit
from cgi_wave.wave.region import SAFETY, Region, Support, find_region, integrate
from cgi_wave.wave.samples import PupilSamples, Space

DEGREES = (4, 6, 8, 10, 12, 14, 16)
TARGET = 1e-6  # misfit (rad of phase, relative amplitude, clearance) below which no higher degree is tried
NEARLY = 1.5  # a clearance of lower degree serves if its residual is at most this times the best
FEWEST = 12  # supported samples without which no field is fitted
POWER_SHARE = 1e-3  # numerical error asked of the power, as a share of the misfit that is asked for
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


def _domain(samples: PupilSamples, lit: NDArray[np.bool_]) -> tuple[Array, Array, float]:
    """Centre and semi-axes of the ellipse that bounds the lit samples with a margin; sample spacing in its unit.

    The margin of 1.5 spacings is where the true boundary must lie, beyond the last lit sample.
    """
    points = samples.u[lit]
    lo, hi = points.min(axis=0), points.max(axis=0)
    centre, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
    if np.any(half <= 0.0):
        raise FoldedFieldError(f"{samples.label}: the samples lie on a line; use the position-space field")
    reach = float(np.sqrt((((points - centre) / half) ** 2).sum(axis=1).max()))
    spacing = min(float(np.sqrt(np.pi / lit.sum(axis=1).min())), 0.4)
    return centre, half * reach * (1.0 + 1.5 * spacing), spacing


def _near(x: Array, lit: NDArray[np.bool_], spacing: float) -> NDArray[np.bool_]:
    """(S, N) samples that take part in the fit: in the domain, lit or within one spacing of a lit one.

    They hold the boundary; those further out would only ask the polynomial for what it need not do.
    """
    near = np.zeros(lit.shape, bool)
    for s, here in enumerate(x):
        gap, _ = KDTree(here[lit[s]]).query(here)
        near[s] = (gap <= spacing) & ((here**2).sum(axis=1) <= 1.0)
    return near


def _cutting(clearance: Array, fit: Fit, x: Array, lit: NDArray[np.bool_], spacing: float) -> NDArray[np.bool_]:
    """(K,) which clearances can reach zero within two sample spacings of the lit samples (x at the middle sigma)."""
    step = 1e-4
    cut = np.zeros(clearance.shape[0], bool)
    for k, coef in enumerate(fit.coef):
        slopes = [(at_points(coef, x + d) - at_points(coef, x - d)) / (2 * step) for d in step * np.eye(2)]
        steepest = float(np.hypot(*slopes).max())
        cut[k] = clearance[k][lit].min() < 2.0 * spacing * steepest + float(np.abs(fit.misfit[k]).max())
    return cut


def _simplest(trials: list[_Trial], best: _Trial, target: float) -> tuple[Array, Array]:
    """Clearances (K, n, n) and residuals (K,), each of the lowest degree that reaches ``target`` or nearly the best.

    Footprints on apertures are nearly affine in the pupil, and every degree costs the boundary search a pass.
    """
    count = best.clearance_misfit.size
    coef, residual = best.shape.coef[:count].copy(), best.clearance_misfit.copy()
    for k in range(count):
        for trial in trials:
            if trial.n < best.n and trial.clearance_misfit[k] <= max(target, NEARLY * best.clearance_misfit[k]):
                coef[k] = 0.0
                coef[k, : trial.n, : trial.n] = trial.shape.coef[k]
                residual[k] = trial.clearance_misfit[k]
                break
    return coef, residual


def _bounded(support: Support, label: str) -> None:
    """Refuse a support that reaches the edge of the sampled domain: its boundary is not known."""
    angle = np.linspace(0.0, 2.0 * np.pi, 256, endpoint=False)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    open_rim = at_points(support.clearance, rim).min(axis=0, initial=np.inf) > 0.0
    if np.any(open_rim):
        raise MethodLimitError(
            _METHOD,
            f"{label}: the clearances leave {np.mean(open_rim):.0%} of the edge of the sampled domain open",
            1.0 + float(np.mean(open_rim)),
            "sample beyond the aperture, or give the clearance of the aperture that the rays were launched into",
        )


@dataclass(frozen=True)
class _Trial:
    """The fits of one degree: path length and amplitude per wavenumber, clearances and direction at the middle."""

    opl: list[Fit]
    shape: Fit
    clearance_misfit: Array
    score: float
    n: int


def _try_degree(
    samples: PupilSamples, x: Array, inside: NDArray[np.bool_], lit: NDArray[np.bool_], bases: list[Basis], n: int
) -> _Trial:
    """Fit everything with n terms per axis; x (S, N, 2) scaled, inside/lit (S, N), one basis per wavenumber."""
    s_count, middle = samples.sigma.size, samples.sigma.size // 2
    fits = []
    for s in range(s_count):
        values = np.array([samples.opl[s] - samples.opl[s].mean(), samples.amplitude[s]])[:, inside[s]]
        fits.append(bases[s].fit(values, n))
    shape = bases[middle].fit(
        np.concatenate([samples.clearance[:, middle], samples.direction[middle].T])[:, inside[middle]], n
    )
    clearance_misfit = _clearance_misfit(samples, x, inside, lit, shape)
    opl, amplitude = _worst(fits, inside, lit)
    rms = float(np.sqrt(np.mean(samples.amplitude[lit] ** 2)))
    score = 2.0 * np.pi * samples.sigma[-1] * opl + amplitude / max(rms, 1e-300) + float(clearance_misfit.min())
    return _Trial(fits, shape, clearance_misfit, score, n)


def _clearance_misfit(
    samples: PupilSamples, x: Array, inside: NDArray[np.bool_], lit: NDArray[np.bool_], shape: Fit
) -> Array:
    """(K,) largest misfit of each clearance near its zero (within a quarter of its range; elsewhere it moves nothing).

    One clearance polynomial serves all wavenumbers: its change with sigma is an error of it.
    """
    middle, count = samples.sigma.size // 2, samples.clearance.shape[0]
    worst = np.zeros(count)
    for s in range(samples.sigma.size):
        at = inside[s]
        value = samples.clearance[:, s, at]
        off = shape.misfit[:count] if s == middle else value - at_points(shape.coef[:count], x[s][at])
        for k in range(count):
            near = np.abs(value[k]) <= 0.25 * np.abs(value[k][lit[s][at]]).max()
            worst[k] = max(worst[k], np.abs(off[k][near if near.sum() >= FEWEST else slice(None)]).max())
    return worst


def _worst(fits: list[Fit], inside: NDArray[np.bool_], lit: NDArray[np.bool_]) -> tuple[float, float]:
    """Largest leave-one-out misfit of path length and amplitude over the lit samples of all wavenumbers."""
    worst = np.max([np.abs(f.misfit[:, lit[s][inside[s]]]).max(axis=1) for s, f in enumerate(fits)], axis=0)
    return float(worst[0]), float(worst[1])


def _choose(
    samples: PupilSamples,
    x: Array,
    inside: NDArray[np.bool_],
    lit: NDArray[np.bool_],
    degree: int | None,
    target: float,
) -> tuple[_Trial, tuple[Array, Array]]:
    """The first degree whose misfit is below ``target``, or the one with the least; only ``degree`` when given.

    With it, the clearances and their residuals from ``_simplest``.
    """
    fewest = int(inside.sum(axis=1).min())
    tried = DEGREES if degree is None else (degree,)
    allowed = [d for d in tried if (d + 1) * (d + 2) // 2 * OVERSAMPLING <= fewest]
    if not allowed:
        terms = (tried[0] + 1) * (tried[0] + 2) // 2
        raise MethodLimitError(
            _METHOD,
            f"{samples.label}: {fewest} samples for the {terms} terms of degree {tried[0]}",
            terms * OVERSAMPLING / fewest,
            "trace more rays",
        )
    bases: list[Basis] = []
    for s in range(samples.sigma.size):
        # In pupil space all wavenumbers share their points, and so their basis.
        same = s > 0 and np.array_equal(x[s], x[0]) and np.array_equal(inside[s], inside[0])
        bases.append(bases[0] if same else Basis.at(x[s][inside[s]], allowed[-1] + 1))
    trials = [_try_degree(samples, x, inside, lit, bases, allowed[0] + 1)]
    best = trials[0]
    for d in allowed[1:]:
        if best.score < target:
            break
        trials.append(_try_degree(samples, x, inside, lit, bases, d + 1))
        best = trials[-1] if trials[-1].score < best.score else best
    return best, _simplest(trials, best, target)


def fit_field(samples: PupilSamples, degree: int | None = None, target: float = TARGET) -> PupilField:
    """Fit one beam's samples: path length (per sigma), amplitude, clearances, directions.

    The fit covers the ellipse that bounds the lit samples (all clearances > 0) with a margin; unlit samples inside it
    and next to a lit one take part. ``degree`` None takes the first of DEGREES whose leave-one-out misfit (rad of
    phase, relative amplitude and clearance together) is below ``target``, or the best.
    Clearances that cannot reach zero on the support are dropped.

    Raises InputError (a value that is not finite, a wrong shape), EmptyBeamError (no lit sample), MethodLimitError
    (too few samples; a support that reaches the edge of what was sampled), FoldedFieldError (samples on a line).
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
    centre, scale, spacing = _domain(samples, lit)
    x = (samples.u - centre) / scale
    inside = _near(x, lit, spacing)
    trial, (simple, residual) = _choose(samples, x, inside, lit, degree, target)
    middle, clearances = samples.sigma.size // 2, samples.clearance.shape[0]
    shape = Fit(trial.shape.coef[:clearances], trial.shape.misfit[:clearances])
    cut = _cutting(samples.clearance, shape, x[middle][lit[middle]], lit, spacing)
    support = Support(centre, scale, simple[cut], residual[cut])
    _bounded(support, samples.label)
    opl = np.array([f.coef[0] for f in trial.opl])
    opl[:, 0, 0] += samples.opl.mean(axis=1)
    amplitude = np.array([f.coef[1] for f in trial.opl])
    opl_residual, amplitude_residual = _worst(trial.opl, inside, lit)
    gram, error = _power(support, amplitude, amplitude_residual, samples.label, POWER_SHARE * target)
    return PupilField(
        samples.label,
        samples.space,
        samples.sigma,
        support,
        opl,
        amplitude,
        trial.shape.coef[clearances:],
        samples.phase,
        samples.reference_point,
        gram,
        error,
        opl_residual,
        amplitude_residual,
        trial.n - 1,
    )


def _power(support: Support, amplitude: Array, residual: float, label: str, tol: float) -> tuple[Array, float]:
    """Gram matrix (S, S) of the amplitudes over the support and the relative error bound of the power."""
    region: Region | None = find_region([support])
    if region is None:
        raise EmptyBeamError(f"{label}: the fitted support is empty")
    n = region.clearance.shape[-1]
    a = expand(amplitude, support.centre, support.scale, region.pivot, region.frame, n)
    s = len(a)
    left, right = np.divmod(np.arange(s * s), s)
    phase = np.zeros((s * s, n, n))
    rough = float(np.mean(at_points(amplitude[0], np.zeros((1, 2))) ** 2) * np.prod(region.frame))
    weight = np.zeros((n, n))
    norm = np.full(s * s, max(rough, 1e-300))
    total = integrate(region, phase, a[left], a[right], weight, norm, tol)
    gram = 0.5 * (total.cross.reshape(s, s) + total.cross.reshape(s, s).T)
    least = float(np.diag(gram).min())
    numerical = SAFETY * float(total.change_power.max()) + total.edge
    return gram, (numerical + 2.0 * residual * np.sqrt(total.area * np.diag(gram).max())) / least
