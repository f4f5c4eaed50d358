"""Maps turned into scene axes and resampled to the instrument's pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError

Array = NDArray[np.float64]

#: What the two axes of a map may run along, first axis first.
ORIENTATIONS = ("+y+x", "+y-x", "-y+x", "-y-x", "+x+y", "+x-y", "-x+y", "-x-y")


def oriented(values: Array, orientation: str, where: str = "map") -> Array:
    """A map (…, A, B) with rows along +Y, columns along +X; a view.

    orientation : what its last two axes run along: ``"-y+x"`` says that the first row is the one seen last and columns
    follow X. Raises InputError for any other word than ``ORIENTATIONS``.
    """
    if orientation not in ORIENTATIONS:
        raise InputError(where, "orientation", orientation, "unknown", f"use one of {', '.join(ORIENTATIONS)}")
    if orientation[1] == "x":
        values = np.swapaxes(values, -1, -2)
        orientation = orientation[2:] + orientation[:2]
    return values[..., :: 1 if orientation[0] == "+" else -1, :: 1 if orientation[2] == "+" else -1]


def box_resample(values: Array, pixel_m: tuple[float, float], to_m: float, where: str = "map") -> Array:
    """Mean of a map (…, H, W) over squares of another size, each source pixel weighed by the area it shares.

    pixel_m : source pixel along the last two axes, to_m : new pixel, m. The grids share their first corner; a last new
    pixel that the source covers in part only is left out. Over what is covered ∫ values dA is conserved, whether the
    new pixels are larger or smaller. Raises InputError if not even one new pixel fits.
    """
    out = np.asarray(values, dtype=np.float64)
    for axis, step in zip((-2, -1), pixel_m, strict=True):
        have = out.shape[axis]
        count = int(have * step / to_m * (1 + 1e-12) + 1e-9)
        if count < 1:
            raise InputError(
                where, "size", f"{have * step:g} m", f"smaller than one pixel of {to_m:g} m", "give a larger map"
            )
        if abs(step - to_m) <= 1e-9 * to_m:
            continue
        edges = np.minimum(np.arange(count + 1) * (to_m / step), have)
        whole = np.minimum(edges.astype(np.int64), have - 1)
        part = (edges - whole).reshape(-1, *[1] * (-1 - axis))
        # ∫ from the first corner to each new edge: whole pixels before it, and part of the one it stands in.
        before = np.cumsum(out, axis=axis)
        here = np.take(out, whole, axis=axis)
        integral = np.take(before, whole, axis=axis) - here + part * here
        out = np.diff(integral, axis=axis) * (step / to_m)
    return out
