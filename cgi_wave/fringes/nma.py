"""Modulation M, baseline B and NMA = M/B of an interferogram, and what ghosts do to them (Eq. 1 of the paper).

Least squares over a window of whole nominal fringes, centred in the zone, with the wavenumber σ0 of the band held:

    I(y) ≈ B + drift·u + c1 cos θ + s1 sin θ + c2 cos 2θ + s2 sin 2θ,   θ = 2πσ0·slope·(y − y_c),  u in [−1, 1]

M = |c1 − i s1|. The fit is linear, so the parasitic part (with ghosts minus nominal) is fitted on its own: O is its DC
term, M* its term at the nominal frequency **projected on the nominal phase** (negative if it opposes the nominal
fringes), and a ghost of the same frequency belongs to M* whatever its OPD.

Sign of the NMA error, as the paper prints it: nma_error = 1 − (1 + M*/M)/(1 + O/B), positive when the NMA falls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import MethodLimitError
from cgi_wave.fringes.psi import Interferogram, Psi

Array = NDArray[np.float64]
METHOD = "fringe fit"
MIN_SAMPLES_PER_FRINGE = 4.0
MIN_ROWS = 7  # six terms and one degree of freedom for the residual
NMA_FLOOR = 1e-3  # below it, M*/M means nothing; the weakest useful coherent rise is about twenty times higher
MAX_DETUNING = 0.1  # fringes over the window: beyond, M falls by more than (0.1π)²/6 = 1.6 %


@dataclass(frozen=True)
class Estimate:
    """A value with its error: the bound from the PSI's own error plus one standard error of the fit residual."""

    value: float
    error: float


@dataclass(frozen=True)
class FringeFit:
    """The nominal fringes.

    baseline, modulation : relative irradiance; nma : their ratio; phase : rad, of cos(θ + phase) at the zone's centre
    second : amplitude at twice the frequency; drift : linear term, from the window's centre to its edge
    fringes : whole fringes in the window; rows : rows in it
    detuning : fringes by which the interferogram runs ahead of σ0 over the window
    residual_rms : of the fit
    """

    baseline: Estimate
    modulation: Estimate
    nma: Estimate
    phase: float
    second: float
    drift: float
    fringes: int
    rows: int
    detuning: float
    residual_rms: float


@dataclass(frozen=True)
class Parasitic:
    """What the ghosts add in one book-keeping, relative to the nominal B and M.

    offset_over_baseline : O/B; parasitic_over_modulation : M*/M (projected on the nominal phase)
    quadrature_over_modulation : the same, 90° away: it moves the phase, and M only in second order
    second_over_modulation : amplitude at twice the frequency over M
    nma_error : 1 − (1 + M*/M)/(1 + O/B); nma_error_linear : Eq. 1, O/B − M*/M
    modulation, baseline, nma : M + M*, B + O and their ratio, relative irradiance
    """

    bookkeeping: str
    offset_over_baseline: Estimate
    parasitic_over_modulation: Estimate
    quadrature_over_modulation: float
    second_over_modulation: float
    nma_error: Estimate
    nma_error_linear: Estimate
    modulation: float
    baseline: float
    nma: float


@dataclass(frozen=True)
class Retrieval:
    """M, B and NMA of one field point, and the two accounts of its ghosts."""

    nominal: FringeFit
    paper: Parasitic
    coherent: Parasitic


def retrieve(psi: Psi, nma_floor: float = NMA_FLOOR) -> Retrieval:
    """Fit the nominal PSI and the parasitic part of both book-keepings.

    Raises MethodLimitError for fewer than 4 samples per fringe, less than one whole fringe (or fewer than 7 rows), a
    nominal NMA below ``nma_floor`` or not above its error, and fringes that run off σ0 by more than 0.1 in the window.
    """
    window, theta, u, fringes = _window(psi)
    model = np.stack(
        [np.ones_like(u), u, np.cos(theta), np.sin(theta), np.cos(2.0 * theta), np.sin(2.0 * theta)], axis=1
    )
    inverse = np.linalg.pinv(model, rcond=1e-9)  # at exactly 4 samples per fringe, sin 2θ may vanish on every row
    nominal = _fit_nominal(psi.nominal, model, inverse, window, theta, u, fringes)
    if not nominal.nma.value > max(nma_floor, nominal.nma.error):
        needed = max(nma_floor, nominal.nma.error)
        raise MethodLimitError(
            METHOD,
            f"nominal NMA {nominal.nma.value:.3g} ± {nominal.nma.error:.2g} must exceed {needed:.3g} for M*/M to mean "
            "anything",
            needed / max(nominal.nma.value, np.finfo(float).tiny),
            "choose an OPD where the scene modulates: a coherent rise, or a shorter OPD for a continuum",
        )
    if abs(nominal.detuning) > MAX_DETUNING:
        raise MethodLimitError(
            METHOD,
            f"fringes run off σ0 = {psi.sigma0:.6g} 1/m by {nominal.detuning:+.3f} in the window, limit {MAX_DETUNING}",
            abs(nominal.detuning) / MAX_DETUNING,
            "centre the filter on the structure that makes the coherent rise, or use fewer fringes",
        )
    parts = {
        book.bookkeeping: _fit_parasitic(psi.nominal, book, nominal, model, inverse, window)
        for book in (psi.paper, psi.coherent)
    }
    return Retrieval(nominal=nominal, paper=parts["paper"], coherent=parts["coherent"])


def nma_error_exact(parasitic_over_modulation: float, offset_over_baseline: float) -> float:
    """1 − (1 + M*/M)/(1 + O/B): positive when the NMA falls."""
    return 1.0 - (1.0 + parasitic_over_modulation) / (1.0 + offset_over_baseline)


def nma_error_linear(parasitic_over_modulation: float, offset_over_baseline: float) -> float:
    """O/B − M*/M, Eq. 1 in the sign of :func:`nma_error_exact`; second order in both is lost."""
    return offset_over_baseline - parasitic_over_modulation


def _window(psi: Psi) -> tuple[NDArray[np.bool_], Array, Array, int]:
    """Rows of the window, θ on them, u in [−1, 1], and the number of whole fringes."""
    frequency = psi.sigma0 * abs(psi.slope)
    pitch = float(np.diff(psi.y_m).max()) if len(psi.y_m) > 1 else 0.0
    if frequency * pitch > (1.0 + 1e-9) / MIN_SAMPLES_PER_FRINGE:
        samples = 1.0 / (frequency * pitch)
        raise MethodLimitError(
            METHOD,
            f"at least {MIN_SAMPLES_PER_FRINGE:.0f} samples per fringe, here {samples:.3g}",
            MIN_SAMPLES_PER_FRINGE / samples,
            "reduce the OPD slope or the row pitch",
        )
    extent = float(psi.y_m[-1] - psi.y_m[0]) + pitch
    # one row short is whole enough: a zone laid out for ten fringes at the filter's centre, seen at the centroid of w
    fringes = int(np.floor(frequency * (extent + pitch) * (1.0 + 1e-9)))
    if fringes < 1 or len(psi.y_m) < MIN_ROWS:
        raise MethodLimitError(
            METHOD,
            f"at least one whole fringe over {MIN_ROWS} rows, here {frequency * extent:.3g} fringes over "
            f"{len(psi.y_m)} rows",
            max(1.0 / max(frequency * extent, np.finfo(float).tiny), MIN_ROWS / len(psi.y_m)),
            "take a longer zone or a steeper OPD slope",
        )
    offset = psi.y_m - 0.5 * (psi.y_m[0] + psi.y_m[-1])
    half = 0.5 * fringes / frequency
    window = (offset >= -half * (1.0 + 1e-9)) & (offset < half * (1.0 - 1e-9))
    if int(window.sum()) < MIN_ROWS:
        raise MethodLimitError(
            METHOD, f"at least {MIN_ROWS} rows in the window of whole fringes, here {int(window.sum())}",
            MIN_ROWS / max(int(window.sum()), 1), "take a longer zone",
        )  # fmt: skip
    return window, 2.0 * np.pi * psi.sigma0 * psi.slope * offset[window], offset[window] / half, fringes


def _fit_nominal(
    book: Interferogram,
    model: Array,
    inverse: Array,
    window: NDArray[np.bool_],
    theta: Array,
    u: Array,
    fringes: int,
) -> FringeFit:
    data = book.irradiance[window]
    term = inverse @ data
    residual = data - model @ term
    rms, scatter = _scatter(residual)
    modulation = float(np.hypot(term[2], term[3]))
    phase = float(np.arctan2(-term[3], term[2]))
    along = _along(inverse, phase)
    b = Estimate(float(term[0]), _error(inverse[0], book.error, scatter))
    m = Estimate(modulation, _error(along, book.error, scatter))
    # a phase that drifts by β·u over the half window leaves −β·u·M sin(θ + phase) in the residual, less what the other
    # terms absorb of it; the projection therefore uses the same part of that shape
    shape = -u * np.sin(theta + phase)
    shape = shape - model @ (inverse @ shape)
    beta = float(shape @ residual / (shape @ shape)) / modulation if modulation > 0.0 else 0.0
    return FringeFit(
        baseline=b, modulation=m,
        nma=Estimate(m.value / b.value, (m.error + m.value / b.value * b.error) / b.value),
        phase=phase, second=float(np.hypot(term[4], term[5])), drift=float(term[1]),
        fringes=fringes, rows=len(data), detuning=beta / np.pi, residual_rms=rms,
    )  # fmt: skip


def _fit_parasitic(
    reference: Interferogram,
    book: Interferogram,
    nominal: FringeFit,
    model: Array,
    inverse: Array,
    window: NDArray[np.bool_],
) -> Parasitic:
    """Fit of (book − reference): its error is that of the ghosts' pairs alone, as both hold the same nominal pair."""
    data = (book.irradiance - reference.irradiance)[window]
    error = book.error - reference.error
    term = inverse @ data
    _, scatter = _scatter(data - model @ term)
    along, across = _along(inverse, nominal.phase), _along(inverse, nominal.phase + 0.5 * np.pi)
    big_b, big_m = nominal.baseline, nominal.modulation
    offset, projected = float(term[0]), float(along @ data)
    o = offset / big_b.value
    m = projected / big_m.value
    # pairs left out are bounded relative to M; on the baseline the same amount of light weighs M/B times less
    o_error = (_error(inverse[0], error, scatter) + abs(o) * big_b.error) / big_b.value
    o_error += book.left_out_baseline * big_m.value / big_b.value
    m_error = (_error(along, error, scatter) + abs(m) * big_m.error) / big_m.value + book.left_out
    exact_error = m_error / (1.0 + o) + (1.0 + m) / (1.0 + o) ** 2 * o_error
    return Parasitic(
        bookkeeping=book.bookkeeping,
        offset_over_baseline=Estimate(o, o_error),
        parasitic_over_modulation=Estimate(m, m_error),
        quadrature_over_modulation=float(across @ data) / big_m.value,
        second_over_modulation=float(np.hypot(term[4], term[5])) / big_m.value,
        nma_error=Estimate(nma_error_exact(m, o), exact_error),
        nma_error_linear=Estimate(nma_error_linear(m, o), m_error + o_error),
        modulation=big_m.value + projected,
        baseline=big_b.value + offset,
        nma=(big_m.value + projected) / (big_b.value + offset),
    )


def _along(inverse: Array, phase: float) -> Array:
    """Row that reads the amplitude of cos(θ + phase) = cos θ cos phase − sin θ sin phase off the data."""
    return np.asarray(inverse[2] * np.cos(phase) - inverse[3] * np.sin(phase))


def _scatter(residual: Array) -> tuple[float, float]:
    """RMS of a fit residual, and the standard deviation it stands for at six fitted terms."""
    square = float(residual @ residual)
    return float(np.sqrt(square / len(residual))), float(np.sqrt(square / (len(residual) - 6)))


def _error(row: Array, bound: float, scatter: float) -> float:
    """Bound of the PSI carried through the reading row, plus the standard error of the residual."""
    return float(bound * np.abs(row).sum() + scatter * np.sqrt(row @ row))
