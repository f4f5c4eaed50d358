"""Every ghost of a band beside the nominal beam of arm 1: |γ|, Eq. 4, the overlaps without phase. Part of ``eq4``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cgi_wave.analysis import band_setting
from cgi_wave.budget.contrast import contrast_of
from cgi_wave.budget.pointfields import direction_field, nominal_fields
from cgi_wave.budget.select import select_ghosts
from cgi_wave.errors import CgiWaveError, EmptyBeamError
from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.rays.beams import Spot, nominal_direction, spot
from cgi_wave.rays.paths import Path, find_paths
from cgi_wave.wave.basis import at_points
from cgi_wave.wave.eq4 import contrast_eq4, contrast_stationary
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.methods.geometric import geometric_overlap
from cgi_wave.wave.methods.incoherent import Incoherent, incoherent_overlap
from cgi_wave.wave.methods.shape import Beam, beam_at, find_edge
from cgi_wave.wave.overlap import overlap
from validation.eq4_plane import cause

Array = NDArray[np.float64]
Row = dict[str, Any]
TOLERANCE = 1e-6  # of the overlap that says which part of the light is shared
LOOSE = 1e-2  # error asked of the incoherent overlap
PRICE = 5e-9  # s a step of it, at the slow end of what this family of machines shows; sets what is affordable only
RAYS = 100_000  # of a geometric spot
FEW_RAYS = 40  # of a ghost on the nominal spot, below which the overlap of the spots is left out


@dataclass(frozen=True)
class Difference:
    """Where the rays of two beams that share a direction land, one against the other.

    covariance (2, 2), m², and mean (2,), m, of the difference of their landing points over the shared directions;
    directions: √det of the covariance of those directions; area: of the directions
    """

    covariance: Array
    mean: Array
    directions: float
    area: float

    @property
    def blur(self) -> float:
        """√(δ_1 δ_2), m: the geometric mean of the principal RMS differences."""
        return float(max(np.linalg.det(self.covariance), 0.0) ** 0.25)

    @property
    def apart(self) -> float:
        """Distance of the mean from zero in units of twice the RMS difference along it: 1 at the rim of an even spot.

        inf for a displaced point.
        """
        values, axes = np.linalg.eigh(self.covariance)
        along = axes.T @ self.mean
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = np.where(along == 0.0, 0.0, along**2 / np.maximum(4.0 * values, 0.0))
        return float(np.sqrt(parts.sum()))


def difference(m: PupilField, l: PupilField, sigma: float) -> Difference | None:  # noqa: E741
    """The difference of two fields at sigma, 1/m; None for supports that do not meet."""
    edge = find_edge([m.support, l.support])
    if edge is None:
        return None
    u = _spread(edge.u)
    beams: Sequence[Beam] = (beam_at(m, sigma), beam_at(l, sigma))
    lit = np.ones(len(u), bool)
    for beam in beams:
        at = beam.scaled(u)
        lit &= (at**2).sum(axis=1) <= 1.0
        lit[lit] &= _clear(beam, u[lit])
    u = u[lit]
    if len(u) < 12:
        return None
    weight = beams[0].amplitude_at(u) * beams[1].amplitude_at(u)
    weight = weight / weight.sum()
    moved = beams[1].slope_at(u) - beams[0].slope_at(u)
    mean = weight @ moved
    covariance = (moved - mean).T @ ((moved - mean) * weight[:, None])
    centred = u - weight @ u
    return Difference(
        covariance, mean, float(np.sqrt(np.linalg.det(centred.T @ (centred * weight[:, None])))), edge.area
    )


def _clear(beam: Beam, u: Array) -> NDArray[np.bool_]:
    return np.asarray((at_points(beam.support.clearance, beam.scaled(u)) > 0.0).all(axis=0))


def _spread(edge: Array, count: int = 64) -> Array:
    """Even points over the box of an edge."""
    lo, hi = edge.min(axis=0), edge.max(axis=0)
    t = (np.arange(count) + 0.5) / count
    return np.column_stack([a.ravel() for a in np.meshgrid(*(lo[i] + (hi[i] - lo[i]) * t for i in (0, 1)))])


@dataclass(frozen=True)
class Band:
    """Ghost paths of a band at its zone's centre, and the nominal beam of arm 1 from the same source direction."""

    system: OpticalSystem
    paths: tuple[Path, ...]
    theta: Array
    x0: Array
    near: Spot
    nominals: Callable[[float], PupilField]

    @property
    def nominal(self) -> PupilField:
        """Its field over direction cosines."""
        return self.nominals(0.0)


def band(name: str) -> Band:
    """The ghosts that ``cgi-wave run`` traces, and the nominal beam."""
    system = load_instrument().band(name)
    paths = select_ghosts(band_setting(system), find_paths(system))
    x0 = system.field_points()[0]
    theta = nominal_direction(system, paths[0], x0)
    near = spot(system, paths[0], theta, system.sigma0)
    return Band(system, paths, theta, x0, near, nominal_fields(system, paths[0], theta, x0))


def ghost_rows(here: Band, seconds: float = 3.0, progress: Callable[[str], None] = lambda _: None) -> list[Row]:
    """A row per ghost that arrives; ``seconds``: what the incoherent overlap of one may take, 0 for none of them."""
    rows = []
    with threadpool_limits(1):
        for number, path in enumerate(here.paths[2:]):
            if number % 50 == 0:
                progress(f"{here.system.band}: ghost {number} of {len(here.paths) - 2}")
            try:
                there = spot(here.system, path, here.theta, here.system.sigma0)
            except EmptyBeamError:
                continue
            rows.append(_row(here, path, there, seconds))
    return rows


def _row(here: Band, path: Path, there: Spot, seconds: float) -> Row:
    sigma, near = here.system.sigma0, here.near
    eq4 = contrast_eq4(near.rms[0], near.rms[1], there.rms[0], there.rms[1])
    row: Row = {"band": here.system.band, "path": path.label, "eq4": eq4, "gamma": None, "bound": None}
    row |= dict.fromkeys(("estimate", "from_spots", "incoherent", "incoherent_error", "spots", "spots_error", "apart"))
    row |= {"waves": None, "shared": None, "cut": None, "cause": None, "note": ""}
    try:
        gamma = contrast_of(here.system, path, here.theta, here.x0, here.nominals)
    except CgiWaveError as error:
        return row | {"note": f"no |γ|: {error}"}
    size, bound = abs(gamma.value), gamma.error
    row |= {"gamma": float(size), "bound": bound}
    try:
        field = direction_field(here.system, path, here.theta, here.x0)
        found = overlap(field, here.nominal, np.array([sigma]), TOLERANCE)
    except CgiWaveError:  # nothing to compare over directions
        return row | {"note": gamma.method}
    row["shared"] = found.shared
    between = difference(field, here.nominal, sigma)
    if between is None or not found.shared:
        return row | {"cause": "no shared directions"}
    # √det of the spread of directions is a quarter of the squared sine of a full cone; ``shared``/area is the share
    # of the cone's power in a direction of it.
    aperture = between.area / found.shared / (2.0 * np.pi * np.sqrt(between.directions))
    own = difference(here.nominal, here.nominal, sigma)
    assert own is not None
    cone = float(np.sqrt(own.area / np.pi))
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(between.covariance), 0.0))
    row["estimate"] = contrast_stationary(values[0], values[1], 1.0 / sigma, aperture, min(found.shared, 1.0))
    both = np.hypot(near.rms, there.rms)
    row["from_spots"] = contrast_stationary(both[0], both[1], 1.0 / sigma, cone)
    row |= {"apart": between.apart, "waves": between.blur * cone * sigma}
    row["cut"] = at_edge(here.system, there)
    row["cause"] = cause(size, bound, eq4, row["estimate"], between.apart, row["cut"])
    row |= _loose(field, here.nominal, sigma, seconds)
    bins = int(np.clip(np.sqrt(RAYS * eq4**2 / 10.0), 2, 96))
    if RAYS * eq4**2 >= FEW_RAYS:
        spots = geometric_overlap(field, here.nominal, sigma, RAYS, bins)
        row |= {"spots": spots.value, "spots_error": spots.error}
    return row


def _loose(field: PupilField, nominal: PupilField, sigma: float, seconds: float) -> Row:
    """The incoherent overlap, or why it was left out."""
    steps = Incoherent().cost(field, nominal, sigma, LOOSE)
    if not steps * PRICE <= seconds:
        what = "refused: too many samples" if np.isinf(steps) else f"about {steps * PRICE:.0f} s"
        return {"note": f"no incoherent overlap: {what}"}
    try:
        found = incoherent_overlap(field, nominal, sigma, LOOSE)
    except CgiWaveError as error:
        return {"note": f"no incoherent overlap: {error}"}
    return {"incoherent": found.value, "incoherent_error": found.error}


def at_edge(system: OpticalSystem, there: Spot) -> bool:
    """Whether a spot reaches the edge of the detector: the rest of it is cut, and its RMS with it."""
    half = 0.5 * system.pixel * np.array([system.document.detector.columns, system.document.detector.rows])
    lo, hi = there.x.min(axis=0), there.x.max(axis=0)
    margin = 0.03 * (hi - lo)
    return bool(np.any(hi + margin > half) or np.any(lo - margin < -half))
