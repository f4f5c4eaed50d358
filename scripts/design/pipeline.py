"""From starting values to the instrument file's numbers: optimise, set the interferometer, cut the apertures."""

from __future__ import annotations

import sys
from collections.abc import Sequence as List

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, root

from cgi_wave.optics.system import Instrument, OpticalSystem
from cgi_wave.rays.trace import compile_sequence
from design.measure import aperture_margins, field_angles, group_opd, nominal_paths, phase_opd
from design.model import Merit, Values, recipe_of, resolve, values_of
from design.recipes import RECIPES, Recipe

Array = NDArray[np.float64]
#: Fringes along y that the slope is to give over a band's zone.
FRINGES = 10.0
#: Clear aperture beyond the outermost ray of the full detector field, mm.
RIM = 0.5
LENS_NAMES = ("L1", "L2", "L3", "L4", "L5")
#: Surfaces whose apertures follow the beam, without a channel's prefix.
CUT = (*(f"{lens}_{face}" for lens in LENS_NAMES for face in ("front", "back")), "M2")
#: What serves all channels.
SHARED = ("L1", "L2", "L3", "dichroic")


def prefixed(system: OpticalSystem, name: str) -> str:
    """The name of a lens or surface in the band's channel."""
    return name if name.partition("_")[0] in SHARED else RECIPES[system.spec.channel or ""].prefix + name


def optimise(instrument: Instrument, channel: str) -> dict[str, float]:
    """Lenses on the arm mirrors, relay on its own, then everything at the detector; mm and degrees, rounded."""
    recipe, bands = RECIPES[channel], instrument.channels[channel]
    at = {**recipe.lenses, **recipe.relay, **recipe.fixed}
    focus = [name for name in recipe.relay if name.endswith(("M2.radius_mm", "M2_z", "image_z")) or "filter" in name]
    stages: list[tuple[str, List[str], tuple[float, float, float]]] = [
        ("objective", list(recipe.lenses), (1.0, 0.0, 0.0)),
        ("relay's focus", focus, (0.0, 1.0, 0.0)),
        ("relay", list(recipe.relay), (0.0, 1.0, 0.0)),
        ("whole chain", [*recipe.lenses, *recipe.relay], (0.5, 0.5, 1.0)),
    ]
    for title, free, weights in stages:
        merit = Merit(instrument, recipe, bands, free, at, weights)
        bounds = np.array([recipe.bounds.get(name, (-np.inf, np.inf)) for name in free]).T
        start = [at[name] for name in free]
        found = least_squares(merit, start, bounds=bounds, x_scale="jac", ftol=1e-9, xtol=1e-9, max_nfev=150)
        print(f"{channel}, {title}: cost {found.cost:.2f} um^2 after {found.nfev} steps", file=sys.stderr)
        at = merit.named(found.x)
    return {name: round(value, 4) for name, value in at.items()}


def set_interferometer(instrument: Instrument, named: dict[str, float], band: str) -> Values:
    """Plate step for the target group OPD, widening condition, and slope for the fringes; the band's values.

    Arm 1's plate is thicker by a step, and its gap shorter by step/n at the band's centre: both arms keep one focus
    and the OPD does not depend on the angle. The slope is turned about the axis, not about the zone's centre, so that
    it moves the OPD there too: both are solved together.
    """
    recipe = recipe_of(instrument, band)
    pre, values = recipe.prefix, values_of(recipe, named, band)
    target = instrument.document.band[band].target_opd_mm
    plate2 = next(
        s.thickness_mm for f in instrument.document.frame for s in f.surface if s.name == f"{pre}plate2_front"
    )
    base = resolve(instrument, values, band)
    n = base.index(base.sigma0)[base.spaces.index(f"{pre}arm1_plate")]

    def apply(x: Array) -> Values:
        step, tilt = float(x[0]), float(x[1]) / 100
        values[f"{pre}plate1_front.thickness_mm"] = round(plate2 + step, 6)
        values[f"{pre}plate1_back.thickness_mm"] = round(named[f"gap_{band}"] - step / float(n), 6)
        slope: list[float] = [round(tilt, 6), 0.0, 0.0]
        values[f"{pre}plate2_back.tilt_deg"] = values[f"{pre}mirror2.tilt_deg"] = slope
        return values

    def miss(x: Array) -> Array:
        opd, fringes = opd_and_fringes(resolve(instrument, apply(x), band))
        return np.array([opd * 1e3 - target, (abs(fringes) - FRINGES) / 100])

    # Steps of 1e-3 (mm, 0.01 degrees): above the rounding of the file.
    found = root(miss, [target / 1.56, 2.0], options={"eps": 1e-6, "xtol": 1e-7})
    left = miss(found.x)
    if np.any(np.abs(left) > [1e-4, 1e-3]):
        raise RuntimeError(f"{band}: OPD and fringes do not settle, {left} left")
    return apply(found.x)


def opd_and_fringes(system: OpticalSystem) -> tuple[float, float]:
    """Group OPD (m, arm 1 minus arm 2) at the zone's centre, and fringes over the zone's height at x = 0."""
    paths = nominal_paths(system)
    _, _, y0, y1 = system.zone()
    centre = group_opd(system, paths, np.array([[0.0, (y0 + y1) / 2]]))[0]
    ends = phase_opd(system, paths, system.sigma0, np.array([[0.0, y0], [0.0, y1]]))
    return float(centre), float((ends[1] - ends[0]) * system.sigma0)


def full_field(system: OpticalSystem) -> Array:
    """Corners, edges and centre of the whole detector, (9, 2) m."""
    det = system.document.detector
    x, y = 0.5 * det.columns * system.pixel, 0.5 * det.rows * system.pixel
    return np.array([(i * x, j * y) for j in (-1, 0, 1) for i in (-1, 0, 1)])


def rim_rays(system: OpticalSystem, count: int = 64) -> Array:
    """Rays on the rim of the pupil, (count, 2) m."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * system.pupil_radius


def margins(system: OpticalSystem) -> dict[str, float]:
    """Smallest clear aperture beyond the rays (mm) per surface, both arms, over the full detector field."""
    found: dict[str, float] = {}
    for path in nominal_paths(system):
        sequence = compile_sequence(system, path, system.sigma0)
        for theta in field_angles(sequence, full_field(system)):
            for name, margin in aperture_margins(system, sequence, rim_rays(system), theta).items():
                found[name] = min(margin * 1e3, found.get(name, np.inf))
    return found


def sizes_of(instrument: Instrument) -> dict[str, float]:
    """Stored semi-apertures (mm) of the surfaces whose apertures follow the beam."""
    named = {spec.name: spec.aperture.radius_mm for frame in instrument.document.frame for spec in frame.surface}
    wanted = {recipe.prefix + name for recipe in RECIPES.values() for name in CUT} | set(CUT)
    return {name: size for name, size in named.items() if name in wanted and size is not None}


def cut_apertures(systems: List[OpticalSystem]) -> dict[str, float]:
    """Semi-apertures (mm, by surface) that clear every ray of the full field by RIM, rounded up to 0.1 mm."""
    needed: dict[str, float] = {}
    for system in systems:
        free = margins(system)
        shared = RECIPES[system.spec.channel or ""].prefix != ""
        for name in (prefixed(system, name) for name in CUT):
            if shared and name in CUT:
                continue  # lenses 1 to 3 are cut for the channel that they were designed for; the other has to pass
            beam = system.surfaces[system.number[name]].aperture[1] * 1e3 - free[name]
            needed[name] = max(needed.get(name, 0.0), beam)
    sizes = {name: float(np.ceil(10 * (beam + RIM) - 1e-6) / 10) for name, beam in needed.items()}
    # The faces of lenses 1, 4 and 5 need much the same: they get one semi-aperture.
    for lens in ("L1", *(recipe.prefix + lens for recipe in RECIPES.values() for lens in ("L4", "L5"))):
        both = [f"{lens}_front", f"{lens}_back"]
        sizes |= dict.fromkeys(both, max(sizes[name] for name in both))
    return sizes


def aperture_values(sizes: dict[str, float], shared: Values) -> dict[str, object]:
    """Aperture fields of the lenses and of each relay's M2, and the relays' masks around them."""
    out: dict[str, object] = {f"{name}.aperture": {"radius_mm": size} for name, size in sizes.items()}
    for recipe in RECIPES.values():
        out |= _relay_apertures(recipe, sizes[f"{recipe.prefix}M2"], shared)
    return out


def _relay_apertures(recipe: Recipe, rim: float, shared: Values) -> dict[str, object]:
    """The mask lies half a millimetre behind the rim of M2, which curves away from M1, and reaches 0.4 mm beyond it."""
    pre = recipe.prefix
    radius = -float(shared[f"{pre}M2.radius_mm"])  # type: ignore[arg-type]
    behind = radius - np.sqrt(radius**2 - rim**2) + 0.5
    out: dict[str, object] = {
        f"{pre}mask_around_M2.start_mm": -round(float(behind), 3),
        f"{pre}relay_mask.aperture": {"half_width_mm": [45.0, round(rim + 0.4, 3)]},
        f"{pre}septum.shift_mm": [0.0, recipe.axis, 40.0],
    }
    # The beams on the concave mirrors are centred on the arm mirrors' image and on the detector.
    for name, frame, beam in (("M1", "concave_out", 0.0), ("M3", "concave_back", 2 * recipe.axis)):
        centre = round(beam - shared[f"{pre}{frame}.shift_mm"][1], 3)  # type: ignore[index]
        out[f"{pre}{name}.aperture"] = {"half_width_mm": list(recipe.concave), "centre_mm": [0.0, centre]}
    return out
