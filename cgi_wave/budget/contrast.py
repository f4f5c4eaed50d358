"""γ of a ghost with a nominal beam, to a tolerance: by its field over direction cosines, or over its own pupil.

The numerator is the overlap in the whole plane of the detector, where the nominal beam ends long before the detector
does; the denominator holds the power of each that lands on the detector.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.pointfields import CONTRAST_TOLERANCE, FINE_RAYS, SHARE, GhostField, fine_field, fine_rays
from cgi_wave.errors import CgiWaveError, MethodLimitError
from cgi_wave.optics.system import OpticalSystem
from cgi_wave.rays.charts import rays_from_points
from cgi_wave.rays.paths import Path
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.overlap import overlap
from cgi_wave.wave.overpupil import contrast_of_fields
from cgi_wave.wave.pupilfields import PupilFields, fields_over_pupil

Array = NDArray[np.float64]
Nominal = Callable[[float], PupilField]

#: How many more rays are tried where a bound exceeds the tolerance, and up to which excess.
FINER_RAYS, NEARLY = 800, 10.0
#: Misfit of a field's phases, rad over the tolerance, beyond which its contrast is computed only if the ghost's pupil
#: is of no help.
HOPELESS = 100.0


@dataclass(frozen=True)
class Contrast:
    """γ of a ghost with a nominal beam, the path difference in it; its bound; and how it was found."""

    value: complex
    error: float
    method: str


@dataclass(frozen=True)
class OverDirections:
    """What a ghost's field over direction cosines gave: γ, or ``why`` there is none; ``rough``: the field, where it
    misses phases by so much that its γ says little."""

    contrast: Contrast | None
    rough: GhostField | None
    why: str

    def within(self, tolerance: float) -> bool:
        """Whether γ is known to ``tolerance``."""
        return self.contrast is not None and self.contrast.error <= tolerance

    def nearly(self, tolerance: float) -> bool:
        """Whether it is not, but might be with more rays."""
        return self.contrast is not None and tolerance < self.contrast.error <= NEARLY * tolerance


def contrast_of(
    system: OpticalSystem,
    path: Path,
    theta: Array,
    x0: Array,
    nominal: Nominal,
    tolerance: float = CONTRAST_TOLERANCE,
) -> Contrast:
    """γ of ``path`` for source direction ``theta``, to ``tolerance`` where that can be had.

    nominal: the nominal beam's field in the chart of a bend, 1/m. By the ghost's field over direction cosines; where
    there is none, or one that leaves more than ``tolerance`` open, over the ghost's own pupil, and the better of the
    two is kept. In a bent chart the error holds by how much others differ.

    Raises EmptyBeamError, FoldedFieldError, MethodLimitError: what either way refused.
    """

    def field(count: int) -> GhostField:
        return fine_field(system, path, theta, x0, fine_rays(system, path, theta, x0, count), tolerance)

    found = over_directions(partial(field, FINE_RAYS), nominal, tolerance)
    if found.nearly(tolerance):
        found = better(found, over_directions(partial(field, FINER_RAYS), nominal, tolerance))
    if found.contrast is not None and found.within(tolerance):
        return found.contrast
    return over_either(
        found, lambda: pupil_fields(system, path, theta, x0, nominal, tolerance), nominal, system.sigma0, tolerance
    )


def over_directions(
    field: Callable[[], GhostField], nominal: Nominal, tolerance: float = CONTRAST_TOLERANCE
) -> OverDirections:
    """γ by a ghost's field over direction cosines, unless that is refused or of little use; see ``contrast_of``."""
    try:
        ghost = field()
        missed = 2.0 * np.pi * float(ghost.field.sigma[0]) * ghost.field.opl_residual
        if missed > HOPELESS * tolerance:
            return OverDirections(None, ghost, f"phases missed by {missed:.1e} rad over directions")
        here = direction_contrast(ghost, nominal(0.0), SHARE * tolerance)
    except CgiWaveError as limit:
        return OverDirections(None, None, str(limit))
    return OverDirections(here, None, f"bound {here.error:.1e} over directions")


def better(first: OverDirections, more: OverDirections) -> OverDirections:
    """What more rays gave, unless the first ones gave a better bound."""
    if more.contrast is None or (first.contrast is not None and first.contrast.error <= more.contrast.error):
        return OverDirections(first.contrast, more.rough, more.why)
    return more


def pupil_fields(
    system: OpticalSystem, path: Path, theta: Array, x0: Array, nominal: Nominal, tolerance: float = CONTRAST_TOLERANCE
) -> PupilFields:
    """Fields over the ghost's own pupil. Raises EmptyBeamError, FoldedFieldError, MethodLimitError."""
    trace = partial(rays_from_points, system, path, theta, x0, system.sigma0)
    return fields_over_pupil(trace, system.pupil_radius, nominal, system.sigma0, path.label, SHARE * tolerance)


def over_either(
    found: OverDirections, fields: Callable[[], PupilFields], nominal: Nominal, sigma: float, tolerance: float
) -> Contrast:
    """The better of what directions gave and γ over the ghost's pupil. Raises what both refuse."""
    here, why, share = found.contrast, found.why, SHARE * tolerance
    over = refused = None
    try:
        over = contrast_of_fields(fields(), sigma, share)
    except CgiWaveError as limit:
        refused = limit
    if here is None and found.rough is not None and (over is None or over.error + over.charts > tolerance):
        try:
            here = direction_contrast(found.rough, nominal(0.0), share)
        except CgiWaveError as limit:
            why = str(limit)
    if over is None:
        if here is None:
            raise refused or MethodLimitError("contrast", why, 1.0, "trace more rays")
        return here
    error = over.error + over.charts
    if here is not None and here.error <= error:
        return here
    parts = f"{over.parts} part{'s' if over.parts > 1 else ''}"
    how = f"over the ghost's pupil in {parts} ({why})"
    if over.bend:
        how = (
            f"over the ghost's pupil in {parts}, lens of {over.bend:.3g} 1/m on the detector ({over.note}; numerical "
            f"bound {over.error:.1e}, charts differ by {over.charts:.1e})"
        )
    return Contrast(over.value, error, how)


def direction_contrast(ghost: GhostField, nominal: PupilField, tol: float) -> Contrast:
    """γ of two fields over direction cosines at their σ; tol: numerical error allowed. Raises MethodLimitError."""
    sigma = nominal.sigma[[nominal.sigma.size // 2]]
    # The field's own power is that in the whole plane.
    caught = float(np.sqrt(ghost.caught))
    pair = overlap(ghost.field, nominal, sigma, tol * caught)
    turned = complex(pair.value[0] * np.exp(2j * np.pi * sigma[0] * pair.opd_m[0])) / caught
    return Contrast(turned, float(pair.error_bound[0]) / caught + 0.5 * abs(turned) * ghost.off, pair.method)
