"""Is the map from pupil to direction cosines one to one? If not, the direction-space field does not exist."""

from __future__ import annotations

import numpy as np

from cgi_wave.errors import FoldedFieldError, MethodLimitError
from cgi_wave.wave.basis import Array
from cgi_wave.wave.fitting import OVERSAMPLING, mapping

COLLAPSE_LIMIT = 20.0  # least Fresnel number for which a direction-space field is a field of rays
_METHOD = "map to direction cosines"


def check_map(p: Array, q: Array, sigma: float, label: str = "beam", degree: int = 6) -> Array:
    """Jacobian det ∂q/∂p (N,) in 1/m² of a traced map from pupil points p (N, 2; m) to direction cosines q (N, 2).

    The direction-space field is a sum over rays, one per direction; that needs a determinant of one sign, and the
    Fresnel number σ·a²·√|det| (a: RMS radius of the pupil points times √2) of at least COLLAPSE_LIMIT everywhere:
    below it the beam is collimated at the detector and diffraction, not rays, sets its spread of directions.

    Raises FoldedFieldError naming the limit and the factor; MethodLimitError when a polynomial of this degree
    describes the map to worse than 1 % of its range.
    """
    if (degree + 1) * (degree + 2) / 2 * OVERSAMPLING > len(p):
        raise MethodLimitError(_METHOD, f"{label}: {len(p)} rays for a map of degree {degree}", 1.0, "trace more rays")
    det, misfit, radius = mapping(p, q, degree)
    fresnel = sigma * radius**2 * np.sqrt(np.abs(det))
    if fresnel.min() < COLLAPSE_LIMIT and np.all(det * det[0] > 0.0):
        raise FoldedFieldError(
            f"{label}: Fresnel number {fresnel.min():.3g} of the map to direction cosines is "
            f"{COLLAPSE_LIMIT / max(fresnel.min(), 1e-300):.3g} times below {COLLAPSE_LIMIT:g} (collimated at the "
            "detector); take γ over the pupil (wave.overpupil)"
        )
    if np.any(det * det[0] <= 0.0):
        share = min(np.mean(det > 0.0), np.mean(det <= 0.0))
        raise FoldedFieldError(
            f"{label}: det ∂q/∂p changes sign over the pupil ({share:.1%} of the rays lie beyond the fold); "
            "take γ over the pupil (wave.overpupil)"
        )
    if misfit > 0.01:
        raise MethodLimitError(
            _METHOD,
            f"{label}: the map is described to {misfit:.2g} of its range (limit 0.01)",
            misfit / 0.01,
            "trace more rays, or take γ over the pupil (wave.overpupil)",
        )
    return det
