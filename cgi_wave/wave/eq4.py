"""The paper's shortcut for the contrast of two PSFs: a ratio of RMS spot sizes (Eq. 4)."""

from __future__ import annotations

import math

from cgi_wave.errors import InputError


def contrast_eq4(nominal_rms_x: float, nominal_rms_y: float, ghost_rms_x: float, ghost_rms_y: float) -> float:
    """Eq. 4: C = √(RMS_x RMS_y / (rms_x rms_y)), the smaller spot over the larger, in [0, 1].

    All four are RMS spot half-widths in m about the spots' own centroids, in one consistent definition.

    What it imitates is √(area of the small spot / area of the large one): the overlap of two incoherent, evenly lit,
    concentric spots of geometric optics. It knows nothing of phase, so it does not oscillate with defocus and falls as
    1/W020 with another factor than the coherent overlap; nothing of lateral separation; nothing of diffraction: a
    perfect nominal spot (RMS 0) would give 0 where the true overlap stays finite. It has no error bound.

    Raises InputError for a size that is not positive and finite.
    """
    sizes = {
        "nominal_rms_x": nominal_rms_x,
        "nominal_rms_y": nominal_rms_y,
        "ghost_rms_x": ghost_rms_x,
        "ghost_rms_y": ghost_rms_y,
    }
    for name, value in sizes.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError("spot sizes", name, value, "not a positive size", "give RMS sizes of real spots, in m")
    ratio = math.sqrt((nominal_rms_x * nominal_rms_y) / (ghost_rms_x * ghost_rms_y))
    return min(ratio, 1.0 / ratio)
