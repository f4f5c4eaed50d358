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


def contrast_stationary(blur_1: float, blur_2: float, wavelength: float, aperture: float, shared: float = 1.0) -> float:
    """Estimate of |γ| in closed form, Eq. 4 with the wavelength in the place of the nominal spot.

    C = (shared⁻⁴ + (w / √(blur_1 blur_2))⁻⁴)^(−1/4),   w = wavelength / (2π aperture).

    blur_1, blur_2 : m, principal RMS of the **difference** of the landing points of the two beams' rays that share a
    direction. From spots alone, √(RMS_x² + rms_x²) and the same in y stand in for it: ghost and nominal aberrations
    are then taken as unrelated, the axes as principal, the directions as all shared.
    wavelength : m; aperture : sine of the half angle of the nominal cone
    shared : √(∫A_m² ∫A_l²) over the shared directions / √(P_m P_l), in (0, 1]

    Source: stationary phase. Where W = W_m − W_l has its stationary point inside an even disc, |γ| tends to
    1/(2π√|ab|) for principal second derivatives 2a, 2b at unit radius, and the rays' RMS difference is a, b times
    wavelength/aperture. The nominal beam's own aberrations enter through W only. The fourth powers join this law to
    what the pupils share; they are a choice, not derived.

    It knows no oscillation: for defocus alone |γ| runs between 0 and twice the estimate, whose edge wave is as strong
    as its centre. It holds for clear pupils, without a caustic inside, and for spots that lie on each other: with the
    centroids further apart than twice the blur along their distance no stationary point is left, and |γ| falls far
    below it. Near focus it is at most ``shared``. It has no error bound; how often it is off is measured by the study
    ``eq4`` (docs/contrast.md).

    Raises InputError for a blur that is negative, other sizes not positive, a share outside (0, 1], one not finite.
    """
    given = {"blur_1": blur_1, "blur_2": blur_2, "wavelength": wavelength, "aperture": aperture, "shared": shared}
    for name, value in given.items():
        size_zero = value == 0.0 and not name.startswith("blur")
        if not math.isfinite(value) or value < 0.0 or size_zero or (name == "shared" and value > 1.0):
            raise InputError("contrast_stationary", name, value, "out of range", "give sizes in m, a share up to 1")
    # √(blur_1) √(blur_2): their product may underflow.
    ratio = math.sqrt(blur_1) * math.sqrt(blur_2) * 2.0 * math.pi * aperture / wavelength
    return math.pow(shared**-4 + ratio**4, -0.25)
