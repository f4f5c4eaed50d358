"""The interferogram along the OPD axis of one field point (a partially scanned interferogram, PSI): Eq. 2 of the paper.

    I(y) = Σ_m t_m + ∫ w(σ) Σ_pairs 2√(t_m t_l) Re[γ_ml(σ) exp(i 2πσ (OPD_ml(σ) + slope_ml·y))] dσ,   ∫ w dσ = 1

with w = filter × radiance normalised by the trapezoidal rule on the given grid, so that I is the irradiance relative to
what a lossless, ghost-free instrument would deliver to the detector from both ports together. t, γ and the OPD slope
are those of the field point and are held along the zone. Three book-keepings come out of the same terms:

* ``nominal``: beams 0 and 1 and their pair;
* ``paper``: all powers added without interference (Eq. 3), plus the ghost–nominal pairs (Eq. 2);
* ``coherent``: every pair of the payload, ghost–ghost pairs included, whose part without fringes is then baseline.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from cgi_wave.errors import InputError
from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.coherency import Coherency, Pair
from cgi_wave.fringes.spectral import check_step, trapezoid, within
from cgi_wave.fringes.terms import METHOD, Interferogram, Psi, Terms, belongs, standard_error

__all__ = ["Interferogram", "Psi", "belongs", "interferogram_terms", "standard_error", "synthesise"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def synthesise(coherency: Coherency, sigma: Array, weight: Array, y_m: Array, row_height_m: float = 0.0) -> Psi:
    """The PSI of one field point in the three book-keepings; arguments and errors as in ``interferogram_terms``."""
    return interferogram_terms(coherency, sigma, weight, y_m, row_height_m).psi()


def interferogram_terms(
    coherency: Coherency, sigma: Array, weight: Array, y_m: Array, row_height_m: float = 0.0
) -> Terms:
    """Every term of the PSI of one field point.

    sigma (S,) 1/m ascending; weight (S,) ≥ 0, filter × radiance in any unit; y_m (R,) m ascending.
    The row integral is exact: every spectral term carries its own sinc(σ·slope·row_height_m).
    A pair given at a single σ is taken as achromatic.

    Raises InputError for shapes, signs and a missing or doubled pair; MethodLimitError if the spectral step exceeds
    1/(4·largest group OPD), or if the pairs' spectral range misses more than 1e-4 of the weight.
    """
    _check(coherency, sigma, weight, y_m, row_height_m)
    sigma, measures = _measures(sigma, weight)
    sigma0 = float(sigma @ measures[0])
    inside, lost = within([pair.sigma for pair in coherency.pairs], sigma, measures[:1], METHOD)
    sigma, measures = sigma[inside], measures[:, inside]
    reach = _reach(coherency.pairs, y_m)
    check_step(sigma, reach, METHOD)

    count = 1
    if len(sigma) > 1:
        degree = max(len(pair.sigma) for pair in coherency.pairs)
        count = chebyshev.degree_for(np.pi * float(np.ptp(sigma)) * reach, degree)
        node, reduced = chebyshev.compress(sigma, measures, count, sigma[0], sigma[-1])
    else:
        node, reduced = sigma, measures
    amplitude = _amplitudes(coherency)
    term = _terms(coherency.pairs, node, row_height_m)
    slope = np.array([pair.slope for pair in coherency.pairs])
    y_node, y_error = _row_nodes(node - sigma0, slope, y_m)
    reduction = np.zeros(len(slope))
    envelope = np.empty((2, len(y_node), len(slope)), dtype=np.complex128)
    for k, y in enumerate(y_node):
        turned = term * np.exp(2j * np.pi * np.outer(slope * y, node - sigma0))
        envelope[:, k] = reduced @ turned.T
        if count > 1 and k in (0, len(y_node) - 1):
            reduction = np.maximum(reduction, chebyshev.tail(turned))
    rows = chebyshev.interpolation_matrix(y_node, y_m) @ envelope[0]
    part = amplitude * np.real(rows * np.exp(2j * np.pi * sigma0 * np.outer(y_m, slope)))  # (R, P)

    bounds = {
        "contrast": amplitude * np.array([pair.error.max() for pair in coherency.pairs]),
        "sampling": amplitude * np.abs(envelope[1]).max(axis=0),
        "numerical": amplitude
        * (y_error + 2.0 * lost + 4.0 * reduction + 2.0 * np.pi * sigma0 * reach * np.finfo(float).eps * 4.0),
    }
    nominal = coherency.pairs[coherency.nominal_pair]
    to_centre = chebyshev.interpolation_matrix(nominal.sigma, np.array([sigma0]))
    opd = float((to_centre @ nominal.opd_m)[0]) if len(nominal.sigma) > 1 else float(nominal.opd_m[0])
    return Terms(
        coherency=coherency, y_m=y_m, opd_m=opd + nominal.slope * y_m, sigma0=sigma0, slope=nominal.slope,
        row_height_m=row_height_m, part=part, bounds=bounds, spectral_nodes=count, row_nodes=len(y_node),
    )  # fmt: skip


def _amplitudes(coherency: Coherency) -> Array:
    """(P,) 2√(t_m t_l)."""
    t = coherency.transmission
    return np.array([2.0 * np.sqrt(t[pair.m] * t[pair.l]) for pair in coherency.pairs])


def _measures(sigma: Array, weight: Array) -> tuple[Array, Array]:
    """(2, S): trapezoidal weights with sum 1, and their difference from those of every second sample.

    Samples at both ends that hold less than 1e-13 of the weight between them are cut: they only widen the band.
    """
    fine = trapezoid(sigma) * weight
    fine = fine / fine.sum()
    inside = np.flatnonzero((np.cumsum(fine) > 5e-14) & (np.cumsum(fine[::-1])[::-1] > 5e-14))
    cut = slice(inside[0], inside[-1] + 1)
    sigma, weight = sigma[cut], weight[cut]
    fine = trapezoid(sigma) * weight
    fine = fine / fine.sum()
    half = np.zeros_like(fine)
    second = np.unique(np.append(np.arange(0, len(sigma), 2), len(sigma) - 1))
    half[second] = trapezoid(sigma[second]) * weight[second]
    if half.sum() > 0.0:
        half /= half.sum()
    return sigma, np.array([fine, fine - half])


def _reach(pairs: tuple[Pair, ...], y_m: Array) -> float:
    """Largest group OPD |d(σ·OPD)/dσ| of any pair on any row, in m; it sets the degree and the step."""
    span = float(np.abs(y_m).max())
    return max(
        float(np.abs(chebyshev.derivative_matrix(p.sigma) @ (p.sigma * p.opd_m)).max() if len(p.sigma) > 1
              else abs(p.opd_m[0])) + abs(p.slope) * span
        for p in pairs
    )  # fmt: skip


def _terms(pairs: tuple[Pair, ...], node: Array, row_height_m: float) -> Complex:
    """(P, N) γ(σ) exp(i2πσ·OPD(σ)) sinc(σ·slope·height) at the spectral nodes."""
    matrices: dict[bytes, Array] = {}
    term = np.empty((len(pairs), len(node)), dtype=np.complex128)
    for row, pair in enumerate(pairs):
        key = pair.sigma.tobytes()
        if key not in matrices:
            matrices[key] = chebyshev.interpolation_matrix(pair.sigma, node)
        opd, gamma = matrices[key] @ pair.opd_m, matrices[key] @ pair.gamma
        term[row] = gamma * np.exp(2j * np.pi * node * opd) * np.sinc(node * pair.slope * row_height_m)
    return term


def _row_nodes(detuning: Array, slope: Array, y_m: Array) -> tuple[Array, float]:
    """Nodes along y for the envelopes left when the carrier σ0 is taken out, and the bound of interpolating them.

    Each envelope is a sum of exp(i c u), |u| ≤ 1, c ≤ 2π|σ − σ0|·|slope|·half the zone; Chebyshev interpolation errs by
    at most 4 Σ_{n≥K} |J_n(c)| ≤ 8 (c/2)^K/K! per unit of spectral weight.
    """
    half = 0.5 * float(y_m[-1] - y_m[0])
    bandwidth = 2.0 * np.pi * float(np.abs(detuning).max()) * float(np.abs(slope).max()) * half
    if bandwidth == 0.0:
        return chebyshev.nodes(1, y_m[0], y_m[-1]), 0.0
    count = np.arange(1 + int(bandwidth), 40 + int(3.0 * bandwidth))  # from where the bound's series falls
    bound = 8.0 * np.exp(count * np.log(0.5 * bandwidth) - gammaln(count + 1.0))
    first = int(np.flatnonzero(bound < 1e-13)[0])
    if len(y_m) <= count[first]:
        return y_m, 0.0
    return chebyshev.nodes(int(count[first]), y_m[0], y_m[-1]), float(bound[first])


def _check(coherency: Coherency, sigma: Array, weight: Array, y_m: Array, row_height_m: float) -> None:
    def refuse(field: str, value: object, problem: str, remedy: str) -> None:
        raise InputError("synthesise", field, value, problem, remedy)

    if sigma.ndim != 1 or sigma.shape != weight.shape or len(sigma) == 0:
        refuse("sigma, weight", (sigma.shape, weight.shape), "must be one-dimensional, of one length, not empty",
               "give the weight on the grid of sigma")  # fmt: skip
    if not (np.all(np.isfinite(sigma)) and sigma[0] > 0.0 and np.all(np.diff(sigma) > 0.0)):
        refuse("sigma", float(sigma[0]), "must be finite, positive and ascending", "sort the spectrum by wavenumber")
    if not (np.all(np.isfinite(weight)) and np.all(weight >= 0.0) and weight.sum() > 0.0):
        refuse("weight", float(weight.min()), "must be finite, not negative, and not zero everywhere",
               "check that the filter lies inside the spectrum")  # fmt: skip
    if y_m.ndim != 1 or len(y_m) == 0 or not (np.all(np.isfinite(y_m)) and np.all(np.diff(y_m) > 0.0)):
        refuse("y_m", y_m.shape, "must be finite and ascending", "give the row centres in order")
    if not 0.0 <= row_height_m < np.inf:
        refuse("row_height_m", row_height_m, "must be zero or positive", "give the pixel pitch, or 0 for points")
    own = np.array([(pair.m, pair.l) for pair in coherency.pairs], dtype=np.int64).reshape(-1, 2)
    ends = np.sort(np.concatenate([own, np.stack([coherency.left_out.m, coherency.left_out.l], axis=1)]), axis=1)
    beams = len(coherency.labels)
    keys, times = np.unique(ends[:, 0] * beams + ends[:, 1], return_counts=True)
    doubled = keys[(times > 1) | (keys // beams == keys % beams)]
    if len(doubled):
        pair_twice = divmod(int(doubled[0]), beams)
        refuse("coherency.pairs", pair_twice, "pair of a beam with itself, or given twice", "give every pair once")
    if not (ends[: len(own)] == (0, 1)).all(axis=1).any():
        refuse("coherency.pairs", len(coherency.pairs), "the nominal pair (0, 1) is missing", "compute it")
    for pair in coherency.pairs:
        if not (np.all(np.isfinite(pair.gamma)) and np.all(np.isfinite(pair.opd_m)) and np.all(pair.error >= 0.0)):
            refuse("coherency.pairs", (pair.m, pair.l), "γ, OPD or error is not finite", "leave the pair out, bounded")
