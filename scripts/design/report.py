"""What the stored instrument achieves, printed; and the comparison of a fresh design with the stored numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cgi_wave.optics.system import Instrument, OpticalSystem
from cgi_wave.rays.trace import compile_sequence
from design.measure import RELAY_SINE, field_angles, measure_spots, nominal_paths, obstruction_margins
from design.model import Values
from design.pipeline import LENS_NAMES, full_field, margins, opd_and_fringes, prefixed, rim_rays

Array = NDArray[np.float64]
#: A rerun must give the stored values to this, mm or degrees. (Starts moved by 2e-4 of themselves end within 1e-4.)
TOLERANCE = 1e-3
#: Surfaces of different mounts that come close to each other.
NEIGHBOURS = tuple(
    pair.split()
    for pair in (
        "L1_back L2_front",
        "L2_back L3_front",
        "L3_back dichroic_front",
        "L3_back dichroic_back",
        "L4_front dichroic_front",
        "L4_front L3_back",
        "L4_back L5_front",
        "L5_back cube_in",
        "plate1_back mirror1",
        "plate2_back mirror2",
        "M1 M3",
        "M2 relay_mask",
        "filter_front cube_exit",
    )
)


def grid(count: int = 41) -> Array:
    """Square grid over the unit disc, (N, 2): rays of equal weight."""
    u = np.linspace(-1, 1, count)
    x, y = np.meshgrid(u, u)
    # The rim itself stays out: the stop has the pupil's size, and rounding would decide there.
    inside = x**2 + y**2 < 0.999
    return np.stack([x[inside], y[inside]], axis=1)


def print_report(instrument: Instrument) -> None:
    """Spots, telecentricity, margins, foci, OPD and fringes of every band."""
    print("radial RMS spot / um about the centroid; chief ray at the arm mirror / deg; share of rays that pass")
    print("band         x/mm    y/mm     nm arm objective  relay  chain   chief  passing")
    for band in instrument.bands:
        worst = _print_spots(instrument.band(band))
        print(f"{band} worst: " + "objective {:.2f} um, relay {:.2f} um, chain {:.2f} um, chief ray {:.3f} deg"
              .format(*worst))  # fmt: skip
    for band in instrument.bands:
        system = instrument.band(band)
        opd, fringes = opd_and_fringes(system)
        mirror = prefixed(system, "plate2_back")
        gap = next(s.thickness_mm for f in system.document.frame for s in f.surface if s.name == mirror)
        rows = system.spec.zone_rows[1] - system.spec.zone_rows[0]
        print(
            f"{band}: mirror {gap:.4f} mm behind plate 2; group OPD {opd * 1e3:.6f} mm "
            f"(target {system.spec.target_opd_mm}), {abs(fringes):.3f} fringes over {rows} rows"
        )
        print(f"{band}: clear beyond the full field's rays / mm: {_listed(margins(system), 3.0)}")
        print(f"{band}: passed by / mm: {_listed(obstructions(system), 10.0)}")
    for bands in instrument.channels.values():
        system = instrument.band(bands[0])
        pairs = [tuple(prefixed(system, name) for name in pair) for pair in NEIGHBOURS]
        print("apart / mm: " + ", ".join(f"{a} {b} {apart(system, a, b):.1f}" for a, b in pairs))
        print("edges / mm: " + ", ".join(f"{k} {v:.2f}" for k, v in edges(system).items()))


def _listed(values: dict[str, float], below: float) -> str:
    return ", ".join(f"{name} {value:.2f}" for name, value in values.items() if value < below)


def _print_spots(system: OpticalSystem) -> Array:
    pupil, sines = grid() * system.pupil_radius, grid() * RELAY_SINE
    weight = np.full(len(pupil), 1 / len(pupil))
    worst = np.zeros(4)
    for arm, path in enumerate(nominal_paths(system), 1):
        theta = field_angles(compile_sequence(system, path, system.sigma0), system.field_points())
        for at, angles in zip(system.field_points() * 1e3, theta, strict=True):
            for nm in system.spec.wavelengths_nm:
                s = measure_spots(compile_sequence(system, path, 1e9 / nm), pupil, weight, sines, angles)
                row = np.array([s.objective * 1e6, s.relay * 1e6, s.chain * 1e6, np.degrees(s.telecentric)])
                worst = np.maximum(worst, row)
                where = f"{system.band:9}{at[0]:8.3f}{at[1]:8.3f}{nm:7.1f} {arm:3}"
                print(where + "{:10.2f}{:7.2f}{:7.2f}{:8.3f}".format(*row) + f"{s.passing:9.4f}")
    return worst


def obstructions(system: OpticalSystem) -> dict[str, float]:
    """Distance (mm) at which the full field's rays pass surfaces that they are not meant to meet, both arms."""
    found: dict[str, float] = {}
    for path in nominal_paths(system):
        sequence = compile_sequence(system, path, system.sigma0)
        for theta in field_angles(sequence, full_field(system)):
            for name, away in obstruction_margins(system, sequence, rim_rays(system), theta).items():
                found[name] = min(away * 1e3, found.get(name, np.inf))
    return found


def edges(system: OpticalSystem) -> dict[str, float]:
    """Edge thickness (mm) of each lens at the larger aperture of its two faces."""
    found = {}
    for lens in (prefixed(system, name) for name in LENS_NAMES):
        front, back = (system.surfaces[system.number[f"{lens}_{face}"]] for face in ("front", "back"))
        radius = np.array(max(front.aperture[1], back.aperture[1]))
        apart = np.linalg.norm(back.origin - front.origin)
        found[lens] = float(apart + back.sag(radius, 0 * radius) - front.sag(radius, 0 * radius)) * 1e3
    return found


def apart(system: OpticalSystem, one: str, other: str, count: int = 81) -> float:
    """Smallest distance (mm) between two surfaces inside their apertures."""
    clouds = []
    for name in (one, other):
        surface = system.surfaces[system.number[name]]
        _, hx, hy, cx, cy = surface.aperture
        x, y = (a.ravel() for a in np.meshgrid(np.linspace(-hx, hx, count), np.linspace(-hy, hy, count)))
        inside = np.ones_like(x, dtype=bool) if surface.aperture[0] == 2.0 else np.hypot(x, y) <= hx
        x, y = x[inside] + cx, y[inside] + cy
        clouds.append(np.stack([x, y, surface.sag(x, y)], axis=1) @ surface.rotation + surface.origin)
    return float(KDTree(clouds[0]).query(clouds[1])[0].min()) * 1e3


def compare(stored: Instrument, designed: dict[str, Values]) -> int:
    """Print every designed value that differs from the stored one by more than TOLERANCE; 1 if there is one."""
    raw = {item["name"]: item for frame in stored.raw["frame"] for item in (frame, *frame["surface"])}
    worst = 0.0
    for band, values in designed.items():
        for dotted, value in values.items():
            name, _, key = dotted.partition(".")
            here = stored.raw["band"][band]["set"].get(dotted) if band else raw[name].get(key)
            apart = np.inf if here is None else float(np.abs(np.subtract(here, value)).max())
            worst = max(worst, apart)
            if apart > TOLERANCE:
                print(f"{band or 'instrument'}: {dotted} is stored as {here}, designed as {value}")
    print(f"largest difference {worst:.2g} (mm or degrees), tolerance {TOLERANCE:g}")
    return int(worst > TOLERANCE)
