"""What is lost by taking light as unpolarised: the splitter's R_s and R_p, carried through the coherency of all beams.

Light keeps its polarisation along s or p of the splitter, whose plane of incidence all passes share: state by state
the chain is exact, and s and p add as powers. The folds of an interferometer lie in that plane or across it; the few
degrees by which skew rays miss it are left out, and so is a difference of phase between s and p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.fringes.coherency import Coherency
from cgi_wave.fringes.nma import Retrieval, retrieve
from cgi_wave.fringes.psi import synthesise
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.paths import Path
from cgi_wave.rays.polarisation import incidences, polarised_range
from cgi_wave.rays.trace import compile_sequence

Array = NDArray[np.float64]

#: R_s − R_p of a splitter that does not declare them: a cube sold as non-polarising keeps to about ±5 %.
SPREAD = 0.1


@dataclass(frozen=True)
class PolarisationBound:
    """Largest changes over all states of linear polarisation up to a degree, against the chain that neglects it.

    r_s, r_p, t_s, t_p: of the splitter; declared: by its coating, or the stated spread; degree: of polarisation.
    nominal_power, nominal_modulation, ghost_power (of all ghosts together, over the nominal): relative changes; offset,
    parasitic, nma_error: changes of O/B, M*/M and of the NMA error; nma: relative change of the retrieved NMA itself.
    faces: relative change of the nominal power by bare faces and tables that part s and p, the splitter apart.
    worst: the splitter's share of s in the state that moves the NMA error most.
    """

    r_s: float
    r_p: float
    t_s: float
    t_p: float
    declared: bool
    degree: float
    nominal_power: float
    nominal_modulation: float
    ghost_power: float
    offset: float
    parasitic: float
    nma_error: float
    nma: float
    faces: float
    worst: float

    def document(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


@dataclass(frozen=True)
class SplitterPowers:
    """R and T of a splitter as traced (mean) and for s and p; declared: from its coating and not assumed."""

    mean: tuple[float, float]
    s: tuple[float, float]
    p: tuple[float, float]
    declared: bool


def splitter_powers(system: OpticalSystem, cosine: float, spread: float = SPREAD) -> SplitterPowers | None:
    """The splitter's powers at an incidence, or None for an instrument that has none.

    From a table that parts s and p; else R ± spread/2 with the same absorption for both. Raises InputError for a spread
    that takes R out of what the splitter has to share.
    """
    inter = system.document.interferometer
    if inter is None:
        return None
    coating, table = system.surfaces[system.number[inter.splitter]].face(0)
    if table is not None and table.s is not None:
        u = np.array([1.0 - cosine])
        both = [tuple(float(x[0]) for x in table.film(system.sigma0, which).at(u)) for which in ("", "s", "p")]
        mean, s, p = ((pair[0], pair[1]) for pair in both)
        return SplitterPowers(mean, s, p, True)
    if table is not None:
        r, t = (float(x[0]) for x in table.film(system.sigma0).at(np.array([1.0 - cosine])))
    else:
        r, t = coating.reflectance, coating.transmittance
    if not abs(spread) / 2 <= min(r, t):
        raise InputError("polarisation", "spread", spread, f"is more than R = {r:g}, T = {t:g} allow", "give less")
    half = 0.5 * spread
    return SplitterPowers((r, t), (r + half, t - half), (r - half, t + half), False)


def polarised(
    coherency: Coherency, paths: Sequence[Path], splitter: str, powers: SplitterPowers, s: float
) -> Coherency:
    """The coherency for a share ``s`` of the light polarised along s, 1 − s along p; paths: of its beams, in order.

    A beam that meets the splitter with a reflections and b transmissions has the power Σ_k w_k R_k^a T_k^b in place of
    R^a T^b; a pair keeps what coherence it had, weighted with √(f_m f_l) of each polarisation.
    """
    steps = [[act for name, act in path.steps if name == splitter] for path in paths]
    passes = np.array([[acts.count("reflect"), acts.count("transmit")] for acts in steps]).T
    weight = np.array([s, 1.0 - s])
    mean = powers.mean[0] ** passes[0] * powers.mean[1] ** passes[1]
    # Amplitude of each polarisation over that of the mean, (2, B).
    amplitude = np.sqrt(np.array([r ** passes[0] * t ** passes[1] for r, t in (powers.s, powers.p)]) / mean)
    gain = weight @ amplitude**2
    pairs = tuple(
        replace(pair, gamma=pair.gamma * float(weight @ (amplitude[:, pair.m] * amplitude[:, pair.l]))
                / float(np.sqrt(gain[pair.m] * gain[pair.l])))
        for pair in coherency.pairs
    )  # fmt: skip
    error = coherency.transmission_error
    return replace(coherency, transmission=coherency.transmission * gain, pairs=pairs,
                   transmission_error=error * gain if len(error) else error)  # fmt: skip


def polarisation_bound(
    system: OpticalSystem,
    coherency: Coherency,
    paths: Sequence[Path],
    sigma: Array,
    weight: Array,
    y_m: Array,
    theta: Array,
    degree: float = 1.0,
    spread: float = SPREAD,
) -> PolarisationBound | None:
    """Changes of one field point's M, B and NMA from the splitter's polarisation; None without an interferometer.

    coherency, paths: of ``budget.fieldpoint.FieldPoint``; sigma, weight, y_m: as for ``synthesise``; theta (2,): the
    field point's source direction; degree: of linear polarisation of the scene, 0 to 1. All figures are ratios of sums
    that are linear in the share of s, so that the extremes lie at its ends; unpolarised light is looked at as well.

    Raises InputError for a degree or a spread out of range, MethodLimitError as ``retrieve``.
    """
    if not 0.0 <= degree <= 1.0:
        raise InputError("polarisation", "degree", degree, "is no degree of polarisation", "give 0 to 1")
    inter = system.document.interferometer
    if inter is None:
        return None
    names = [name for name, _ in paths[0].steps]
    at_centre = incidences(compile_sequence(system, paths[0], system.sigma0), np.zeros((1, 2)), theta[None])
    powers = splitter_powers(system, float(at_centre[names.index(inter.splitter), 0]), spread)
    assert powers is not None  # there is an interferometer

    def outcome(beams: Coherency) -> tuple[Retrieval, float, float]:
        nominal = float(beams.transmission[:2].sum())
        return retrieve(synthesise(beams, sigma, weight, y_m)), nominal, float(beams.transmission[2:].sum()) / nominal

    plain, power0, ghosts0 = outcome(coherency)
    found = {key: 0.0 for key in ("power", "modulation", "ghosts", "offset", "parasitic", "error", "nma")}
    worst = 0.5
    for s in (0.5, 0.5 * (1.0 + degree), 0.5 * (1.0 - degree)):
        here, power, ghosts = outcome(polarised(coherency, paths, inter.splitter, powers, s))
        a, b = here.coherent, plain.coherent
        change = {
            "power": power / power0 - 1.0,
            "modulation": here.nominal.modulation.value / plain.nominal.modulation.value - 1.0,
            "ghosts": ghosts / ghosts0 - 1.0 if ghosts0 else 0.0,
            "offset": a.offset_over_baseline.value - b.offset_over_baseline.value,
            "parasitic": a.parasitic_over_modulation.value - b.parasitic_over_modulation.value,
            "error": a.nma_error.value - b.nma_error.value,
            "nma": a.nma / b.nma - 1.0,
        }
        worst = s if abs(change["error"]) > found["error"] else worst
        found = {key: max(found[key], abs(value)) for key, value in change.items()}
    low, high = polarised_range(system, paths[0], np.zeros((1, 2)), theta[None], system.sigma0, inter.splitter)
    faces = degree * max(float(high[0]) - 1.0, 1.0 - float(low[0]))
    return PolarisationBound(
        powers.s[0], powers.p[0], powers.s[1], powers.p[1], powers.declared, degree, found["power"],
        found["modulation"], found["ghosts"], found["offset"], found["parasitic"], found["error"], found["nma"], faces,
        worst,
    )  # fmt: skip


def polarisation_text(bound: PolarisationBound) -> str:
    """One line for a person."""
    origin = "declared" if bound.declared else "assumed"
    return (
        f"polarisation is neglected. With R_s {bound.r_s:.3f} and R_p {bound.r_p:.3f} at the splitter ({origin}), "
        f"linear polarisation up to degree {bound.degree:g} moves O/B by at most {bound.offset:.1e}, M*/M by "
        f"{bound.parasitic:.1e}, the NMA error by {bound.nma_error:.1e}, and the nominal modulation by "
        f"{bound.nominal_modulation:.1e} of itself"
    )
