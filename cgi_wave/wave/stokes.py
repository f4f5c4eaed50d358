"""Overlap integrals whose cost hardly grows with defocus: boundary integrals by Stokes' theorem and steepest descent.

The kernel (``cgi_wave.kernels.stokes``) says how. Here is what its error bound is made of, and when it is tried again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cgi_wave.errors import MethodLimitError
from cgi_wave.kernels import stokes
from cgi_wave.kernels.bounds import terms_used
from cgi_wave.kernels.circles import circle_region
from cgi_wave.kernels.descent import GAUSS
from cgi_wave.kernels.polynomials import affine
from cgi_wave.wave.basis import Array

BOUNDARY_METHOD = "boundary integral, steepest descent"
BOXES = 4000  # boxes into which a region is cut at most
NEAR = 5e-14  # relative error of the way from a stationary point to where steepest descent begins, by Gauss panels
ROUNDING = 2.0 * 2.0 * np.pi * 2.3e-16  # rad per cycle of phase: two roundings of the phase polynomial at its full size
FLOOR = 2e-15  # share of the integral of the amplitude below which rounding of the sums is not resolved
SHARE = 1.0 / 16.0  # part of the tolerance that one boundary panel may take; few come near it
_TRIES = 3
_ARCS = 128
NO_FACTOR = np.empty((0, 0))  # in place of a further factor that is not wanted
_ONE = np.ones((1, 1))


@dataclass(frozen=True)
class BoundaryIntegral:
    """∫ a b exp(i 2π f) d²x over a region, and the same with a further factor, in frame units; error bounds the first.

    nodes : boundary nodes; boxes : pieces into which the region was cut (1: none)
    """

    value: complex
    weighted: complex
    error: float
    nodes: int
    boxes: int


def boundary_integral(curves: Array, phase: Array, a: Array, b: Array, weight: Array, tol: float) -> BoundaryIntegral:
    """Integral over the region that ``curves`` (C, 2, D; powers of s in [-1, 1], region to their left) enclose.

    phase (n, n) in cycles, a, b, weight (m, m): powers of the frame's coordinates; tol: absolute, frame units.

    The bound holds the interpolation and quadrature error of every boundary panel (from the fall of its Chebyshev
    coefficients), the error of the steepest-descent rules, NEAR and rounding; it is what was reached, and may exceed
    ``tol`` when rounding asks for more.
    Raises MethodLimitError when the region would have to be cut into more than BOXES pieces.
    """
    a, b = (x[:n, :n] for x, n in ((a, terms_used(a[None])), (b, terms_used(b[None]))))
    arrays = [np.ascontiguousarray(x) for x in (curves, phase, a, b, weight)]
    return _refined(lambda share: stokes.integrate(*arrays, share, BOXES), tol)


def circular_pair(phase: Array, shift: tuple[float, float], obscuration: float, tol: float) -> BoundaryIntegral:
    """∫ exp(i 2π f) over the common part of two (annular) unit pupils; phase (5, 5): powers about the shifted one.

    Lengths are pupil radii; otherwise as ``boundary_integral``.
    """
    circles = [(0.0, 0.0, 1.0), (0.0, 0.0, obscuration), (*shift, 1.0), (*shift, obscuration)]
    kept = [c for c in circles[: 2 if shift == (0.0, 0.0) else 4] if c[2] > 0.0]
    signs = np.array([1.0 if c[2] == 1.0 else -1.0 for c in kept])
    panels = np.empty((_ARCS, 2, GAUSS))
    used = circle_region(np.array(kept), signs, panels)
    centred = affine(phase, -shift[0], -shift[1], 1.0, 0.0, 0.0, 1.0)
    return _refined(lambda share: stokes.integrate(panels[:used], centred, _ONE, _ONE, NO_FACTOR, share, BOXES), tol)


def _refined(run: Callable[[float], tuple[Any, int, bool]], tol: float) -> BoundaryIntegral:
    share = SHARE * tol
    for _ in range(_TRIES):
        result, boxes, ok = run(share)
        if not ok:
            raise MethodLimitError(
                BOUNDARY_METHOD,
                f"the region would have to be cut into more than {BOXES} boxes (or its boundary touches a cut)",
                boxes / BOXES,
                "ask for a larger tolerance, or use boundary-fitted Gauss panels",
            )
        if result[4] <= tol:
            break
        share *= 0.5 * tol / result[4]
    amplitude = result[5]
    error = result[4] + (NEAR + ROUNDING * result[6] + FLOOR) * amplitude
    return BoundaryIntegral(
        complex(result[0], result[1]), complex(result[2], result[3]), float(error), int(result[7]), int(boxes)
    )
