"""All overlaps of a set of beams at once: a Hermitian, positive semi-definite matrix, so that no light is negative."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import MethodLimitError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.overlap import mutual_power_bound, overlap

_METHOD = "coherency matrix"


@dataclass(frozen=True)
class Gram:
    """γ(m, l) of B beams at one wavenumber, path differences included: γ(m, l) = ∫ A_m A_l* d²u / √(P_m P_l).

    value : (B, B) complex, Hermitian, unit diagonal, no eigenvalue below 0
    error : (B, B) bound of |value − γ|; moved : what the step to a positive matrix changed (part of ``error``)
    left_out : pairs (m, l) that no method resolved; their value is 0 and their error the bound of the shared power
    """

    value: NDArray[np.complex128]
    error: Array
    moved: float
    left_out: tuple[tuple[int, int], ...]

    def irradiance(self, transmission: Array) -> float:
        """Σ_ml √(t_m t_l) γ(m, l): light of all beams at one detector point, at least 0; transmission (B,)."""
        amplitude = np.sqrt(transmission)
        return float((amplitude @ self.value @ amplitude).real)


def gram(fields: Sequence[PupilField], sigma: float, tol: float = 1e-6) -> Gram:
    """Overlaps of every pair of ``fields`` at ``sigma``, 1/m. All in one space about one reference point.

    Each pair is computed with its own bound; errors may push an eigenvalue below 0 by no more than the norm of all
    bounds. Negative ones are set to 0 and the diagonal to 1 again. Raises InputError for fields that do not go
    together, MethodLimitError when an eigenvalue is more negative than the bounds allow (then a bound is wrong).
    """
    count = len(fields)
    value, error = np.eye(count, dtype=np.complex128), np.zeros((count, count))
    left_out: list[tuple[int, int]] = []
    for m in range(count):
        for l in range(m):  # noqa: E741
            try:
                found = overlap(fields[m], fields[l], np.array([sigma]), tol)
            except MethodLimitError:
                left_out.append((m, l))
                error[m, l] = error[l, m] = mutual_power_bound(fields[m], fields[l])
                continue
            value[m, l] = found.value[0] * np.exp(2j * np.pi * sigma * found.opd_m[0])
            value[l, m] = np.conj(value[m, l])
            error[m, l] = error[l, m] = min(float(found.error_bound[0]), 2.0)
    levels, vectors = np.linalg.eigh(value)
    allowed = float(np.linalg.norm(error)) + 1e-13 * count
    if levels[0] < -allowed:
        raise MethodLimitError(
            _METHOD, f"an eigenvalue of {levels[0]:.3g} where the bounds allow {-allowed:.3g}",
            float(-levels[0] / allowed), "report it: an error bound does not hold",
        )  # fmt: skip
    positive = (vectors * np.maximum(levels, 0.0)) @ vectors.conj().T
    size = np.sqrt(np.diag(positive).real)
    positive = positive / np.outer(size, size)
    moved = float(np.abs(positive - value).max())
    return Gram(positive, error + moved * (1.0 - np.eye(count)), moved, tuple(left_out))


def polychromatic(
    fields: tuple[PupilField, PupilField], sigma: Array, weight: Array, tol: float = 1e-5
) -> tuple[complex, float]:
    """Contrast of two beams in light of a band: ∫ w(σ) γ(σ) exp(i 2πσ·opd) dσ / ∫ w dσ, and its error bound.

    sigma (T,): evenly spaced wavenumbers, 1/m, within those of the fields; weight (T,): filter times radiance there,
    not negative. Contrasts are computed at as many wavenumbers as they ask for and interpolated; the fringes turn with
    σ through the whole path difference, so that the step has to be at most 1/(4·opd).

    Raises MethodLimitError for a coarser step, naming the factor, and what ``overlap_spectrum`` raises.
    """
    from cgi_wave.wave.basis import lagrange
    from cgi_wave.wave.overlap import overlap_spectrum

    nodes, found = overlap_spectrum(*fields, float(sigma[0]), float(sigma[-1]), tol)
    factor = 4.0 * float(np.abs(found.opd_m).max()) * float(np.max(np.diff(sigma)))
    if factor > 1.0:
        raise MethodLimitError(
            "polychromatic contrast", f"the spectrum is sampled every {np.max(np.diff(sigma)):.4g} 1/m for a path "
            f"difference of {np.abs(found.opd_m).max():.4g} m", factor, "sample it more finely, or bound the pair",
        )  # fmt: skip
    share = weight / weight.sum()
    between = _barycentric(nodes, sigma) if nodes.size > 12 else lagrange(nodes, sigma)
    gamma = (between @ found.value) * np.exp(2j * np.pi * sigma * (between @ found.opd_m))
    return complex((share * gamma).sum()), float(found.error_bound.max())


def _barycentric(nodes: Array, sigma: Array) -> Array:
    """(T, n) values at ``sigma`` of the Lagrange polynomials through first-kind Chebyshev ``nodes`` (stable form)."""
    k = np.arange(nodes.size)
    weight = (-1.0) ** k * np.sin((2 * k + 1) * np.pi / (2 * nodes.size))
    gap = sigma[:, None] - nodes
    hit = gap == 0.0
    terms = weight / np.where(hit, 1.0, gap)
    terms[hit.any(axis=1)] = hit[hit.any(axis=1)]
    return np.asarray(terms / terms.sum(axis=1, keepdims=True))
