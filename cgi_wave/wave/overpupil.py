"""γ of two beams over the entrance pupil of one of them, in a chart where its rays are one to one with its field.

For what a direction-space field cannot hold: a ghost whose directions crowd, fold or collapse. ``wave.pupilfields``
makes the fields.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cgi_wave.wave.field import power
from cgi_wave.wave.overlap import integral_over
from cgi_wave.wave.pupilfields import COMPARED, Other, Product, PupilFields, Trace, fields_over_pupil

#: By how much what the kept chart is off may exceed a difference to another one.
SAFETY = 2.0


@dataclass(frozen=True)
class PupilContrast:
    """γ of a pair, the path difference in it.

    error: bound as that of ``wave.overlap``; charts: twice the most by which other charts differ, 0 in that of
    directions; bend of the chart, 1/m; parts of the pupil; note: why it is not the chart of directions.
    """

    value: complex
    error: float
    charts: float
    bend: float
    parts: int
    note: str


def contrast_over_pupil(
    trace: Trace, radius: float, other: Other, sigma: float, label: str, tol: float, bend: float | None = None
) -> PupilContrast:
    """γ of a ghost with another beam at one wavenumber, 1/m.

    trace: rays of the ghost from points (N, 2) of a pupil of ``radius``, m, about the point that ``other``, the other
    field in the chart of a bend (1/m), stands about. tol: misfit of the product (rad of phase, amplitude and clearance
    together) above which the pupil is cut, and numerical error. bend: asked for; None: the least that serves. Bent
    charts represent the same waves, but for what is diffracted at edges: up to two others that serve are compared.

    Raises EmptyBeamError, FoldedFieldError (no chart serves), MethodLimitError.
    """
    return contrast_of_fields(fields_over_pupil(trace, radius, other, sigma, label, tol, bend), sigma, tol)


def contrast_of_fields(fields: PupilFields, sigma: float, tol: float) -> PupilContrast:
    """γ from fields over the pupil; sigma, 1/m; tol: numerical error. Raises MethodLimitError."""
    kept, *others = fields.products
    value, error = _integral(fields, kept, sigma, tol)
    differ = 0.0
    if fields.note and kept.near.bend != 0.0:
        differ = 0.0 if others else abs(value)
        for compared in others:
            there, off = _integral(fields, compared, sigma, max(COMPARED, tol))
            differ = max(differ, SAFETY * abs(there - value) + off)
    return PupilContrast(value, error, differ, kept.near.bend, len(kept.parts), fields.note)


def _integral(fields: PupilFields, product: Product, sigma: float, tol: float) -> tuple[complex, float]:
    """γ in one chart and its bound."""
    near = product.near
    mine, there = power(fields.own), power(near)
    norm = float(np.sqrt(mine[0][0] * there[0][near.sigma.size // 2]))
    total, error, cross = 0.0j, 0.0, 0.0
    for field in product.parts:
        value, off, size, _ = integral_over(field, tol * norm)
        total, error, cross = total + value, error + off, cross + size
    # What the other field may be off by itself: phase, amplitude, and both powers in the normaliser.
    phase = min(2.0 * np.pi * sigma * near.opl_residual, 2.0) * cross / norm
    area = float(np.sqrt(np.pi * np.prod(near.support.scale)))
    amplitude = near.amplitude_residual * area * np.sqrt(fields.light) / norm
    gamma = total / norm
    return complex(gamma), float(error / norm + phase + amplitude + 0.5 * abs(gamma) * (mine[1] + there[1]))
