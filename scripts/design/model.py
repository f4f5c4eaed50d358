"""The variables of the reference design, their starting values, and the merit function. Values in mm and degrees."""

from __future__ import annotations

from collections.abc import Sequence as List
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.optics.schema import convert
from cgi_wave.optics.system import Instrument, OpticalSystem
from cgi_wave.rays.trace import Sequence, compile_sequence, trace
from design.measure import RELAY_SINE, disc, mirror_step, nominal_paths, relay_trace, spot
from design.recipes import RECIPES, Recipe

Array = NDArray[np.float64]
Values = dict[str, float | list[float]]
#: Focal length aimed at, m.
FOCAL_LENGTH = 130e-3
#: Distance of the filter's back from the detector, mm.
FILTER_TO_DETECTOR = 1.0
#: Values that differ from band to band, without the channel's prefix.
PER_BAND = ("plate1_front.thickness_mm", "plate1_back.thickness_mm", "plate2_back.thickness_mm", "plate2_back.tilt_deg",
            "mirror2.tilt_deg", "filter_front.thickness_mm", "focal.start_mm")  # fmt: skip
#: Semi-aperture at which lens 4 keeps an edge of at least EDGE, mm.
RIM_L4, EDGE = 27.0, 1.3
#: Residuals of a spot's rays are in µm; a place counts a fortieth of that, a chief ray's angle to the normal of the arm
#: mirror or of the detector 5 per degree, a missing mm of edge 200.
PLACE, TILT, HINGE = 1e6 / 40, 5.0 * 180 / np.pi, 200.0


def recipe_of(instrument: Instrument, band: str) -> Recipe:
    """The recipe of a band's channel."""
    return RECIPES[instrument.document.band[band].channel or ""]


def per_band(recipe: Recipe) -> tuple[str, ...]:
    """Values that differ from band to band; all others are the channel's."""
    return tuple(recipe.prefix + name for name in PER_BAND)


def values_of(recipe: Recipe, x: dict[str, float], band: str) -> Values:
    """Dotted instrument values for one band from named variables."""
    out: Values = {name: value for name, value in x.items() if "." in name}
    own: Values = {"plate2_back.thickness_mm": x[f"gap_{band}"]}
    for number, frame in (("1", "concave_out"), ("2", "convex"), ("3", "concave_back")):
        own[f"{frame}.shift_mm"] = [0.0, x[f"M{number}_y"], 0.0]
        own[f"{frame}.start_mm"] = x[f"M{number}_z"]
    own["focal.shift_mm"] = [0.0, x["image_y"], x["image_z"]]
    own["focal.rotate_deg"] = [180.0 + x["image_tilt"], 0.0, 0.0]
    own["filter_front.thickness_mm"] = x[f"filter_{band}"]
    own["focal.start_mm"] = -x[f"filter_{band}"] - FILTER_TO_DETECTOR
    out |= {recipe.prefix + name: value for name, value in own.items()}
    if "objective_y" in x:
        out[f"{recipe.frame}.shift_mm"] = [0.0, x["objective_y"], x["objective_z"]]
        out[f"{recipe.frame}.rotate_deg"] = [x["objective_tilt"], 0.0, 0.0]
    return out


def resolve(instrument: Instrument, values: Values, band: str) -> OpticalSystem:
    """The band's system with ``values`` over the file's and in place of the band's own ``set``."""
    raw = {**instrument.raw, "band": {band: {**instrument.raw["band"][band], "set": values}}}
    return Instrument(instrument.file, convert(raw, instrument.file), raw).band(band)


@dataclass
class Merit:
    """Residuals as a function of the free variables; the others keep their value in ``at``.

    bands: of the recipe's channel; weights: of the spots of objective, relay alone and whole chain. Arm 2 stands for
    both: the widening condition gives the arms one focus.
    """

    instrument: Instrument
    recipe: Recipe
    bands: List[str]
    free: List[str]
    at: dict[str, float]
    weights: tuple[float, float, float]

    def __post_init__(self) -> None:
        self.paths = {band: nominal_paths(self.instrument.band(band)) for band in self.bands}
        points, self.weight = disc()
        self.pupil = points * self.instrument.band(self.bands[0]).pupil_radius
        self.sines = points * RELAY_SINE

    def named(self, x: Array) -> dict[str, float]:
        """All variables, the free ones from x."""
        return {**self.at, **dict(zip(self.free, map(float, x), strict=True))}

    def fields(self, system: OpticalSystem) -> Array:
        """Direction cosines of the field points with x ≥ 0 (mirror symmetry in x), two more on x = 0 and a corner."""
        _, x1, y0, y1 = system.zone()
        middle, low, high = (y0 + y1) / 2 + 0.4 * (y1 - y0) * np.array([0.0, -1.0, 1.0])
        x = 0.8 * x1
        points = [(0.0, middle), (x, low), (x, high), (0.0, low), (0.0, high), (x1, y0)]
        return np.array(points) * self.recipe.signs / FOCAL_LENGTH

    def __call__(self, x: Array) -> Array:
        """Residuals; their squares add up to the merit."""
        named, out = self.named(x), []
        for band in self.bands:
            system = resolve(self.instrument, values_of(self.recipe, named, band), band)
            for nm in (system.spec.wavelengths_nm[0], system.spec.wavelengths_nm[-1]):
                sequence = compile_sequence(system, self.paths[band][1], 1e9 / nm)
                out += [self._beam(sequence, theta) for theta in self.fields(system)]
        lens = f"{self.recipe.prefix}L4"
        radii = np.array([named[f"{lens}_front.radius_mm"], -named[f"{lens}_back.radius_mm"]])
        edge = named[f"{lens}_front.thickness_mm"] - (radii - np.sqrt(radii**2 - RIM_L4**2)).sum()
        return np.concatenate([*out, [max(EDGE - edge, 0.0) * HINGE]])

    def _beam(self, sequence: Sequence, theta: Array) -> Array:
        step = mirror_step(sequence)
        chief = trace(sequence, np.zeros((1, 2)), theta, footprints=True)
        at_mirror = chief.foot[step][:, 0]
        spots = []
        out = []
        if self.weights[0] or self.weights[2]:
            whole = trace(sequence, self.pupil, theta, footprints=True)
            spots += [(self.weights[0], whole.foot[step].T), (self.weights[2], whole.x)]
            direction = trace(sequence.upto(step + 1), np.zeros((1, 2)), theta).direction[0]
            # The focal length is that of the mirror's image.
            out += [*direction * TILT, (abs(at_mirror[0]) - abs(theta[0]) * FOCAL_LENGTH) * PLACE]
        if self.weights[1]:
            out += list(chief.direction[0] * TILT)
            spots.append((self.weights[1], relay_trace(sequence, at_mirror, self.sines)))
        if self.weights[2]:
            # The image of a zone falls on that zone.
            out += list((chief.x[0] - theta * FOCAL_LENGTH * self.recipe.signs) * PLACE)
        root = np.sqrt(self.weight)[:, None] * 1e6
        return np.concatenate([out, *((spot(x, self.weight)[0] * root).ravel() * weight for weight, x in spots)])
