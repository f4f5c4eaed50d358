"""Per channel of the reference instrument: what is optimised, from which starting values, within which bounds.

Values in mm and degrees. Surfaces and frames of a channel carry its prefix in the instrument file.
"""

from __future__ import annotations

from dataclasses import dataclass

#: Heights of the relays' axes over their cubes', mm: half-beam (24 mm), convex mirror (17.6 mm) and 2 mm to pass it.
#: The SWIR beams lean a little more.
AXIS, SWIR_AXIS = -44.0, -45.4


@dataclass(frozen=True)
class Recipe:
    """One channel.

    prefix: of its frames and surfaces; frame: of its lenses 4 and 5; signs: of detector x and y over the incoming
    direction cosines; lenses, relay: free variables of objective and relay and their starting values; fixed: variables
    that keep theirs; bounds: of some; axis: height of the relay's axis over the cube's; concave: half widths of its
    concave mirrors in x and y.
    """

    prefix: str
    frame: str
    signs: tuple[float, float]
    lenses: dict[str, float]
    relay: dict[str, float]
    fixed: dict[str, float]
    bounds: dict[str, tuple[float, float]]
    axis: float
    concave: tuple[float, float]


def _decentres(axis: float) -> dict[str, tuple[float, float]]:
    """Decentres stay small against the room beside the convex mirror."""
    return dict.fromkeys(("M2_y", "M3_y"), (axis - 0.5, axis + 0.5))


#: Lenses 1 to 3 and the dichroic are shared and stay as they are in the file. Held besides: thicknesses that only grow,
#: the concave mirrors' common radius and the place of the first (sliding the relay along changes little), the place of
#: the image, the two mirror offsets (0.28 mm apart) and one filter, since a filter's thickness and the detector's place
#: move the focus alike.
#: The relay is an Offner: concave mirrors concentric about the place where the arm mirrors seem to be, seen through
#: plate and cube (24.57 mm inside the exit face); the convex mirror 0.53 mm weaker than half of them and its centre
#: moved by 1.57 mm towards it. z from the cube's exit face, y from the cube's axis.
VISNIR = Recipe(
    prefix="",
    frame="visnir",
    signs=(-1.0, 1.0),
    lenses={
        "L4_front.radius_mm": 54.727,
        "L4_back.radius_mm": -109.930,
        "L4_back.thickness_mm": 31.611,
        "L5_front.radius_mm": -40.189,
        "L5_back.radius_mm": -82.635,
        "L5_back.thickness_mm": 21.271,
    },
    relay={
        "M2.radius_mm": -131.53,
        "M2_z": 108.53,
        "M2_y": AXIS,
        "M3_z": 237.43,
        "M3_y": AXIS,
        "image_z": -28.4,
        "image_tilt": 0.0,
        "filter_NIR": 2.5,
    },
    fixed={
        "L4_front.thickness_mm": 13.0,
        "L5_front.thickness_mm": 12.0,
        "M1.radius_mm": -262.0,
        "M3.radius_mm": -262.0,
        "M1_z": 237.43,
        "M1_y": AXIS,
        "image_y": 2 * AXIS,
        "visnir.start_mm": 27.0,
        "gap_NIR": 1.53,
        "gap_VIS": 1.25,
        "filter_VIS": 1.0,
    },
    bounds=_decentres(AXIS),
    axis=AXIS,
    concave=(44.0, 43.0),
)

#: The dichroic is a tilted plate in SWIR light: it displaces the axis by 1.6 mm and adds astigmatism, which a decentre
#: and a tilt of lenses 4 and 5, with all that follows, takes up. A mirror's distance from its plate leaves room for the
#: 4.9 mm by which arm 1's plate is thicker in the CO2 band. Its distance is a band's focus: one of them is held, since
#: the distance of lens 5 moves all foci. The relay starts from that of VIS/NIR, 3.6 mm closer: so much deeper inside
#: the cube the arm mirrors seem to stand.
SWIR = Recipe(
    prefix="swir_",
    frame="swir",
    signs=(-1.0, -1.0),
    lenses={
        "swir_L4_front.radius_mm": 76.992,
        "swir_L4_back.radius_mm": -110.153,
        "swir_L4_back.thickness_mm": 17.026,
        "swir_L5_front.radius_mm": -59.586,
        "swir_L5_back.radius_mm": 2984.1,
        "swir_L5_back.thickness_mm": 33.3,
        "objective_y": -1.591,
        "objective_tilt": 0.0,
        "gap_SWIR1-CH4": 5.0,
    },
    relay={
        "swir_M2.radius_mm": -132.54,
        "M2_z": 106.0,
        "M2_y": SWIR_AXIS + 0.4,
        "M3_z": 233.4,
        "M3_y": SWIR_AXIS + 0.4,
        "image_z": -33.1,
        "image_tilt": 0.0,
        "filter_SWIR1-CH4": 2.0,
        "filter_SWIR2": 2.0,
    },
    fixed={
        "swir_L4_front.thickness_mm": 12.0,
        "swir_L5_front.thickness_mm": 10.0,
        "swir_M1.radius_mm": -262.0,
        "swir_M3.radius_mm": -262.0,
        "M1_z": 233.85,
        "M1_y": SWIR_AXIS,
        "image_y": 2 * SWIR_AXIS,
        "swir.start_mm": 36.777,
        "objective_z": 26.625,
        "gap_SWIR1-CO2": 5.0,
        "gap_SWIR2": 5.5,
        "filter_SWIR1-CO2": 2.0,
    },
    bounds=_decentres(SWIR_AXIS),
    axis=SWIR_AXIS,
    concave=(44.0, 44.7),
)

#: By the channel's name in the instrument file.
RECIPES = {"VISNIR": VISNIR, "SWIR": SWIR}
