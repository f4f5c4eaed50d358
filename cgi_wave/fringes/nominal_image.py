"""The nominal image of a scene: what the point-spread function makes of it, pixel by pixel of the zone.

Kernels are polynomials between the points where they were traced. Across track a column keeps its place while the scene
scrolls, so that its own kernel goes into the image. Along track the ground passes all rows: the image is a sum

    image(x, y; s) = Σ_k T_k(y) (K_k(x) * map)(x, y + s),     T_k: Chebyshev polynomials over the zone's rows,

of as many terms as matter beside what the points between the nodes say of the interpolation. All kernels add up to 1,
those of the terms from the second on to 0: a uniform scene stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes import blur, chebyshev, smooth
from cgi_wave.fringes.field import NominalPsf
from cgi_wave.fringes.layer import Zone

Array = NDArray[np.float64]
Real = NDArray[np.floating]
#: Part of what interpolation between the nodes errs by, up to which kernels are made of fewer ones.
FEWER = 0.1


@dataclass(frozen=True)
class NominalImage:
    """maps (K, C, H, X) : images of the scene, one per term, on the zone's columns; along (K, R) : T_k on its rows

    blur : how kernels were applied; kernels : number of convolutions per map
    error : what convolutions add; between : measured on the scene at the points between the nodes, with the terms that
    were left out; window : light beyond the kernels; arms : difference between the nominal beams. All are bounds of
    |error of the image of maps[0]|, in its units
    """

    maps: Real
    along: Array
    blur: str
    kernels: int
    error: float
    between: float
    window: float
    arms: float


def nominal_image(
    psf: NominalPsf, zone: tuple[float, float, float, float], pixels: Zone, maps: Real, tolerance: float,
    precision: type = np.float64, tile: bool = False,
) -> NominalImage:  # fmt: skip
    """Convolve a scene with the nominal PSF.

    zone : x0, x1, y0, y1, m, that psf's nodes are for; pixels : of the frames, in it; maps (C, H, W) : the scene;
    tolerance : error allowed to convolutions, relative to the scene's largest value; tile : along track it repeats
    """
    terms = _terms(psf)
    misfit = np.array([check - kernel for check, kernel in zip(psf.check, _at(psf, psf.check_m), strict=True)])
    unseen = np.abs(misfit).sum(axis=(1, 2)).max(initial=0.0)
    rest = np.abs(terms).sum(axis=(2, 3)).max(axis=1)[::-1].cumsum()[::-1]
    count = max(int((rest > unseen).sum()), 1) if len(misfit) else len(terms)
    left = float(rest[count]) if count < len(rest) else 0.0
    kept = terms[:count]
    scale = float(np.abs(maps).max()) or 1.0
    to_x = chebyshev.interpolation_matrix(psf.x_m, pixels.x_m)
    column = np.asarray(pixels.column + np.arange(len(pixels.x_m)), np.float64)
    shapes, mix, lost = _shapes(kept, max(FEWER * unseen, 1e-12))
    weights = np.einsum("ib,kbr->rki", to_x, mix)
    out: Real = np.zeros((count, len(maps), maps.shape[1], len(column)), precision)
    error, names = 0.0, set()
    for shape, weight in zip(shapes, weights, strict=True):
        size = float(np.abs(weight).sum(axis=0).max()) or 1.0
        how = blur.choose(shape, tolerance / len(shapes) / size, maps[0].size, precision == np.float32)
        names.add(how.method)
        error += how.error * size
        for c, one in enumerate(maps):
            seen = _columns(blur.correlate(one[None].astype(precision), how, shape, tile)[0], column)
            for k in range(count):
                out[k, c] += (weight[k] * seen).astype(precision)
    v = (2.0 * pixels.y_m - zone[2] - zone[3]) / (zone[3] - zone[2])
    along = np.asarray(np.polynomial.chebyshev.chebvander(v, count - 1).T, np.float64)
    reach = float(np.ptp(maps[0]))
    measured = max((_largest(maps[0], one) for one in misfit), default=0.0)
    return NominalImage(
        out, along, " and ".join(sorted(names)), len(shapes), error * scale, measured + 0.5 * (left + lost) * reach,
        psf.outside * reach, 0.5 * psf.arms * reach,
    )  # fmt: skip


def _terms(psf: NominalPsf) -> Array:
    """(K, X, h, w) kernels of the terms T_k along track, K the number of nodes."""
    low, high = _ends(psf.y_m)
    v = (2.0 * psf.y_m - low - high) / (high - low) if len(psf.y_m) > 1 else np.zeros(1)
    return np.tensordot(np.linalg.inv(np.polynomial.chebyshev.chebvander(v, len(v) - 1)), psf.kernel, 1)


def _ends(nodes: Array) -> tuple[float, float]:
    """The range that Chebyshev nodes of the first kind serve."""
    n = len(nodes)
    if n == 1:
        return float(nodes[0]), float(nodes[0])
    half = 0.5 * (nodes[-1] - nodes[0]) / np.cos(0.5 * np.pi / n)
    middle = 0.5 * (nodes[0] + nodes[-1])
    return float(middle - half), float(middle + half)


def _at(psf: NominalPsf, places: Array) -> Array:
    """(N, h, w) kernels between the nodes."""
    to_y = chebyshev.interpolation_matrix(psf.y_m, places[:, 1])
    to_x = chebyshev.interpolation_matrix(psf.x_m, places[:, 0])
    return np.asarray(np.einsum("na,nb,abhw->nhw", to_y, to_x, psf.kernel))


def _shapes(terms: Array, tolerance: float) -> tuple[Array, Array, float]:
    """Few kernels (S, h, w), how terms and nodes are made of them (K, X, S), and Σ|what is left| at most.

    The first is the mean of the first term, of sum 1; the others, of sum 0, are singular vectors of what departs from
    it.
    """
    mean = terms[0].mean(axis=0)
    apart = terms.copy()
    apart[0] -= mean
    flat = apart.reshape(terms.shape[0] * terms.shape[1], -1)
    left, size, right = np.linalg.svd(flat, full_matrices=False)
    count, rest = 0, flat
    # terms add up in a pixel, nodes do not (but for what a polynomial between them overshoots)
    while (lost := float(_by_term(rest, terms.shape).sum(axis=0).max())) > tolerance and count < len(size):
        rest = rest - np.outer(left[:, count] * size[count], right[count])
        count += 1
    mix = np.zeros((*terms.shape[:2], 1 + count))
    mix[0, :, 0] = 1.0
    mix[..., 1:] = (left[:, :count] * size[:count]).reshape(*terms.shape[:2], count)
    return np.concatenate([mean[None], right[:count].reshape(count, *mean.shape)]), mix, lost


def _by_term(flat: Array, shape: tuple[int, ...]) -> Array:
    """(K, X) Σ|…| of each term's kernel at each node."""
    return np.abs(flat).sum(axis=1).reshape(shape[:2])


def _columns(seen: Real, column: Array) -> Real:
    """(H, X) of a blurred map: as it is at whole columns, else between four."""
    nearest = np.rint(column)
    if np.abs(column - nearest).max() < 1e-9:
        return seen[:, nearest.astype(np.int64)]
    return smooth.resampled(seen[None], column, 2, False, 4)[0]


def _largest(image: Real, kernel: Array) -> float:
    """Largest |value| of an image through a kernel."""
    if not kernel.any():
        return 0.0
    how = blur.choose(kernel, 0.0, image.size)
    return float(np.abs(blur.correlate(image[None].astype(np.float64), how, kernel, False)).max())
