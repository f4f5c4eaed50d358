"""Light of other channels on a channel's detector: how it gets there, and what the declared rejection leaves of it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from cgi_wave.budget.setting import band_spectrum
from cgi_wave.errors import EmptyBeamError
from cgi_wave.optics.schema import OutOfBandSpec
from cgi_wave.optics.system import NM, Instrument, OpticalSystem
from cgi_wave.rays.beams import nominal_direction, rays_to_point
from cgi_wave.rays.paths import Path, find_paths
from cgi_wave.scene.radiance import solar_irradiance

#: Paths below this share of the strongest are not traced; all of them together are bounded in the error.
WEAK = 2e-3
#: OPD up to which the band's own radiance is sampled, m: it is only integrated.
RADIANCE_OPD = 2e-3
#: Wavelengths over a part of the range, for the integral of a smooth continuum.
SAMPLES = 200


def other_light(instrument: Instrument, band: str) -> dict[str, Any] | None:
    """What reaches the detector in a band's zone (its centre) of the light of the other channels; None if not declared.

    The channel's ``out_of_band`` range is shared out among the bands of the other channels, each standing for the part
    that lies nearest to its own wavelength. Paths with up to one parasitic reflection are searched and traced at that
    band's wavelength, with the coatings that its channel sets (what a dichroic is to that light). Powers are relative
    to the band's own nominal light, filter and radiance in them; the other light is the solar continuum on the same
    ground, without a gas in its way: an upper bound.

    Returns ``assumptions`` and ``rows``, one per source band and family of paths: ``source``, ``range_m`` (2),
    ``reflections`` (of the family), ``order``, ``paths`` (how many), ``unrejected`` (as though filter and detector took
    it like their own), ``power``, ``error`` (of power, from tracing; the assumptions are not in it); ``power``,
    ``error`` and ``unrejected``, their sums.

    Raises InputError, EmptyBeamError.
    """
    spec = instrument.document.band[band]
    declared = None if spec.channel is None else instrument.document.channel[spec.channel].out_of_band
    sources = [name for name, other in instrument.document.band.items() if other.channel != spec.channel]
    if declared is None or not sources:
        return None
    system = instrument.band(band)
    own = _own_light(system)
    rows = []
    for source, low, high in _shares(instrument, sources, declared):
        rows += _rows(instrument.other_light(band, source), source, low, high, declared, own)
    return {
        "assumptions": {"filter_transmittance": declared.filter_transmittance,
                        "detector_response": declared.detector_response,
                        "range_m": [value * NM for value in declared.range_nm]},
        "rows": rows,
        "unrejected": sum(row["unrejected"] for row in rows),
        "power": sum(row["power"] for row in rows),
        "error": float(np.hypot.reduce([row["error"] for row in rows])),
    }  # fmt: skip


def _own_light(system: OpticalSystem) -> float:
    """Nominal light of both arms at the zone's centre: solid angle times coatings times filtered radiance."""
    radiance, band_filter = band_spectrum(system, RADIANCE_OPD)
    through = radiance.radiance * band_filter.transmission(radiance.sigma)
    step = float(radiance.sigma[1] - radiance.sigma[0])
    angle = sum(power for _, power, _ in _powers(system, find_paths(system, 0, 0)))
    return angle * float(through.sum()) * step


def _powers(system: OpticalSystem, paths: Sequence[Path]) -> list[tuple[Path, float, float]]:
    """Paths that reach the centre of the zone, with their J (solid angle times coatings) there and its error."""
    x0, found = system.field_points()[0], []
    theta = nominal_direction(system, paths[0], x0)
    for path in paths:
        try:
            found.append((path, *rays_to_point(system, path, x0, np.array([system.sigma0]), theta).power()))
        except EmptyBeamError:
            continue
    return found


def _shares(
    instrument: Instrument, sources: Sequence[str], declared: OutOfBandSpec
) -> list[tuple[str, float, float]]:  # fmt: skip
    """(band, from, to): the declared range (m), cut half way between the bands' wavelengths."""
    centre = sorted((instrument.document.band[name].filter.centre_nm * NM, name) for name in sources)
    low, high = (value * NM for value in declared.range_nm)
    cuts = [low, *(np.clip((a[0] + b[0]) / 2, low, high) for a, b in pairwise(centre)), high]
    return [(name, float(a), float(b)) for (_, name), a, b in zip(centre, cuts[:-1], cuts[1:], strict=True) if b > a]


def _rows(
    system: OpticalSystem, source: str, low: float, high: float, declared: OutOfBandSpec, own: float
) -> list[dict[str, Any]]:
    """The families of one source band, strongest first."""
    sigma = np.linspace(1 / high, 1 / low, SAMPLES)
    scene = system.spec.spectrum
    light = _continuum(sigma, scene.albedo, scene.air_mass)
    bandpass = system.surfaces[system.number[declared.filter]].coating.transmittance
    rejection = declared.filter_transmittance * declared.detector_response / bandpass
    paths = find_paths(system, 1)
    strongest = max(path.estimate for path in paths)
    some = [path for path in paths if path.estimate >= WEAK * strongest]
    dropped = sum(path.estimate for path in paths) - sum(path.estimate for path in some)
    families: dict[Any, list[tuple[Path, float, float]]] = {}
    traced = _powers(system, some)
    for item in traced:
        families.setdefault(item[0].history, []).append(item)
    unit = light / own
    per_estimate = sum(power for path, power, _ in traced if path.order == 0)
    rows: list[dict[str, Any]] = []
    for history, members in families.items():
        power = sum(item[1] for item in members)
        error = float(np.hypot.reduce([item[2] for item in members]))
        # What was not traced goes to the error of the first family, the one with most light.
        error += dropped * per_estimate if not rows else 0.0
        rows.append({
            "source": source, "range_m": [low, high],
            "reflections": " ".join(f"{name}:{act[0]}" for name, act in history) or "nominal path",
            "order": members[0][0].order, "paths": len(members),
            "unrejected": power * unit, "power": power * unit * rejection, "error": error * unit * rejection,
        })  # fmt: skip
    return sorted(rows, key=lambda row: -float(row["power"]))


def _continuum(sigma: np.ndarray, albedo: float, air_mass: float) -> float:
    """Radiance of the reflected continuum over ascending wavenumbers (1/m), W m⁻² sr⁻¹, by the trapezoid rule."""
    radiance = albedo / np.pi / (air_mass - 1) * solar_irradiance(sigma)
    return float(np.trapezoid(radiance, sigma))
