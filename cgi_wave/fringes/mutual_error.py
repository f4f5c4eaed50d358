"""What frames miss by giving a pair's light one image: measured on the scene, or bounded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes import blur
from cgi_wave.fringes.field import FieldPair, FringeField

Array = NDArray[np.float64]
Real = NDArray[np.floating]
#: Cells along a side of the part of the scene, about its most striking place, on which kernels are tried.
PART = 512
#: Bound of a pair's error, relative to the nominal baseline times the scene's range, below which it is not worth a try.
SMALL = 2e-5


def mutual_error(field: FringeField, image: Real) -> tuple[float, float]:
    """What the mutual kernels of all pairs may change of a frame, measured and only bounded, relative irradiance each.

    image (H, W) : the scene's reference map. A pair errs by 2√(t_m t_l)·|Σ_d apart[d] L(x + d)|, largest over the part
    of the scene that departs most from its mean, or by half the range of L times Σ|apart|. Amplitudes of all pairs add.
    """
    baseline = float(field.transmission[:2].sum(axis=0).mean())
    reach = float(np.ptp(image))
    cells: dict[int, Array] = {}
    measured = bounded = 0.0
    for pair in field.pairs:
        strength = 2.0 * float(field.strength(pair).max())
        if pair.mutual is None:
            if {pair.m, pair.l} != {0, 1}:  # what the nominal beams lack is in the error of their PSF
                bounded += strength * 0.5 * reach * (1.0 + float(np.abs(pair.gamma).max()))
            continue
        bound = strength * 0.5 * reach * pair.mutual.most
        known = float(np.abs(pair.mutual.apart).sum())
        if bound <= SMALL * baseline * reach or known == 0.0:
            bounded += bound
            continue
        step = pair.mutual.step
        if step not in cells:
            cells[step] = _part(image, step)
        measured += strength * _largest(pair, cells[step])
        bounded += strength * 0.5 * reach * max(pair.mutual.most - known, 0.0)
    return measured, bounded


def _part(image: Real, step: int) -> Array:
    """Means over cells of step × step, of the part about the place that departs most from the mean."""
    rows, columns = (max(n // step, 1) for n in image.shape)
    whole = np.asarray(image[: rows * step, : columns * step], np.float64)
    means = whole.reshape(rows, whole.shape[0] // rows, columns, whole.shape[1] // columns).mean(axis=(1, 3))
    row, column = np.unravel_index(int(np.abs(means - means.mean()).argmax()), means.shape)
    top, left = (
        max(0, min(int(at) - PART // 2, n - PART)) for at, n in ((row, means.shape[0]), (column, means.shape[1]))
    )
    return np.asarray(means[top : top + PART, left : left + PART])


def _largest(pair: FieldPair, image: Array) -> float:
    assert pair.mutual is not None
    total = np.zeros(image.shape)
    for part in (pair.mutual.apart.real, pair.mutual.apart.imag):
        if part.any():
            kernel = np.ascontiguousarray(part)
            how = blur.choose(kernel, 0.0, image.size)
            total += np.asarray(blur.correlate(image[None], how, kernel, False)[0]) ** 2
    return float(np.sqrt(total.max()))
