"""The paper's shortcut for the contrast of two PSFs: a ratio of RMS spot sizes (Eq. 4)."""

from __future__ import annotations

import math

from cgi_wave.errors import InputError


def contrast_eq4(nominal_rms_x: float, nominal_rms_y: float, ghost_rms_x: float, ghost_rms_y: float) -> float:
    """Eq. 4: C = √(RMS_x RMS_y / (rms_x rms_y)), nominal spot over ghost spot.

    All four are RMS spot half-widths in m about the spots' own centroids, in one consistent definition.

    What it imitates is √(area of the nominal spot / area of the ghost): the overlap of two evenly lit, concentric
    spots of geometric optics. It knows nothing of phase, so it does not oscillate with defocus; nothing of lateral
    separation; nothing of diffraction: a perfect nominal spot (RMS 0) gives 0 where the true overlap stays finite.
    A ghost smaller than the nominal spot gives more than 1, which no contrast can be; the number is returned as the
    equation has it. It has no error bound.

    Raises InputError for a nominal size that is negative, a ghost size that is not positive, or one not finite.
    """
    sizes = {
        "nominal_rms_x": nominal_rms_x,
        "nominal_rms_y": nominal_rms_y,
        "ghost_rms_x": ghost_rms_x,
        "ghost_rms_y": ghost_rms_y,
    }
    for name, value in sizes.items():
        if not math.isfinite(value) or value < 0.0 or (value == 0.0 and name.startswith("ghost")):
            raise InputError("spot sizes", name, value, "not the size of a spot", "give RMS sizes of real spots, in m")
    return math.sqrt((nominal_rms_x * nominal_rms_y) / (ghost_rms_x * ghost_rms_y))
