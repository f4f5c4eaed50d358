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

Array = NDArray[np.float64]
Values = dict[str, float | list[float]]
#: Focal length aimed at, m.
FOCAL_LENGTH = 130e-3
#: Distance of the filter's back from the detector, mm.
FILTER_TO_DETECTOR = 1.0
#: Height of the relay's axis over the cube's, mm: half-beam (24 mm), convex mirror (17.6 mm) and 2 mm to pass it.
AXIS_Y = -44.0
#: Semi-aperture at which lens 4 keeps an edge of at least EDGE, mm.
RIM_L4, EDGE = 27.0, 1.3
#: Residuals of a spot's rays are in µm; a place counts a fortieth of that, a chief ray's angle to the normal of the arm
#: mirror or of the detector 5 per degree, a missing mm of edge 200.
PLACE, TILT, HINGE = 1e6 / 40, 5.0 * 180 / np.pi, 200.0

#: Lenses 1 to 3 and the dichroic are shared with the SWIR channel and stay as they are in the file.
LENSES = {
    "L4_front.radius_mm": 54.727,
    "L4_back.radius_mm": -109.930,
    "L4_back.thickness_mm": 31.611,
    "L5_front.radius_mm": -40.189,
    "L5_back.radius_mm": -82.635,
    "L5_back.thickness_mm": 21.271,
}
#: An Offner: concave mirrors concentric about the place where the arm mirrors seem to be, seen through plate and cube
#: (24.57 mm inside the exit face); the convex mirror 0.53 mm weaker than half of them and its centre moved by 1.57 mm
#: towards it. z from the cube's exit face, y from the cube's axis.
RELAY = {
    "M2.radius_mm": -131.53,
    "M2_z": 108.53,
    "M2_y": AXIS_Y,
    "M3_z": 237.43,
    "M3_y": AXIS_Y,
    "image_z": -28.4,
    "image_tilt": 0.0,
    "filter_NIR": 2.5,
}
#: Held: thicknesses that only grow, the concave mirrors' common radius and the place of the first (sliding the relay
#: along changes little), the place of the image, the two mirror offsets (0.28 mm apart) and one filter, since a
#: filter's thickness and the detector's place move the focus alike.
FIXED = {
    "L4_front.thickness_mm": 13.0,
    "L5_front.thickness_mm": 12.0,
    "M1.radius_mm": -262.0,
    "M3.radius_mm": -262.0,
    "M1_z": 237.43,
    "M1_y": AXIS_Y,
    "image_y": 2 * AXIS_Y,
    "visnir.start_mm": 27.0,
    "gap_NIR": 1.53,
    "gap_VIS": 1.25,
    "filter_VIS": 1.0,
}
#: Decentres stay small against the room beside the convex mirror.
BOUNDS = {"M2_y": (AXIS_Y - 0.5, AXIS_Y + 0.5), "M3_y": (AXIS_Y - 0.5, AXIS_Y + 0.5)}


def values_of(x: dict[str, float], band: str) -> Values:
    """Dotted instrument values for one band from named variables."""
    out: Values = {name: value for name, value in x.items() if "." in name}
    out["plate2_back.thickness_mm"] = x[f"gap_{band}"]
    for number, frame in (("1", "concave_out"), ("2", "convex"), ("3", "concave_back")):
        out[f"{frame}.shift_mm"] = [0.0, x[f"M{number}_y"], 0.0]
        out[f"{frame}.start_mm"] = x[f"M{number}_z"]
    out["focal.shift_mm"] = [0.0, x["image_y"], x["image_z"]]
    out["focal.rotate_deg"] = [180.0 + x["image_tilt"], 0.0, 0.0]
    out["filter_front.thickness_mm"] = x[f"filter_{band}"]
    out["focal.start_mm"] = -x[f"filter_{band}"] - FILTER_TO_DETECTOR
    return out


def resolve(instrument: Instrument, values: Values, band: str) -> OpticalSystem:
    """The band's system with ``values`` over the file's and in place of the band's own ``set``."""
    raw = {**instrument.raw, "band": {band: {**instrument.raw["band"][band], "set": values}}}
    return Instrument(instrument.file, convert(raw, instrument.file), raw).band(band)


@dataclass
class Merit:
    """Residuals as a function of the free variables; the others keep their value in ``at``.

    weights: of the spots of objective, relay alone and whole chain. Arm 2 stands for both: the widening condition
    gives the arms one focus.
    """

    instrument: Instrument
    free: List[str]
    at: dict[str, float]
    weights: tuple[float, float, float]

    def __post_init__(self) -> None:
        self.paths = {band: nominal_paths(self.instrument.band(band)) for band in self.instrument.bands}
        points, self.weight = disc()
        self.pupil = points * self.instrument.band(self.instrument.bands[0]).pupil_radius
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
        return np.array(points) * [-1, 1] / FOCAL_LENGTH

    def __call__(self, x: Array) -> Array:
        """Residuals; their squares add up to the merit."""
        named, out = self.named(x), []
        for band in self.instrument.bands:
            system = resolve(self.instrument, values_of(named, band), band)
            for nm in (system.spec.wavelengths_nm[0], system.spec.wavelengths_nm[-1]):
                sequence = compile_sequence(system, self.paths[band][1], 1e9 / nm)
                out += [self._beam(sequence, theta) for theta in self.fields(system)]
        radii = np.array([named["L4_front.radius_mm"], -named["L4_back.radius_mm"]])
        edge = named["L4_front.thickness_mm"] - (radii - np.sqrt(radii**2 - RIM_L4**2)).sum()
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
            out += list((chief.x[0] - theta * [-FOCAL_LENGTH, FOCAL_LENGTH]) * PLACE)
        root = np.sqrt(self.weight)[:, None] * 1e6
        return np.concatenate([out, *((spot(x, self.weight)[0] * root).ravel() * weight for weight, x in spots)])
