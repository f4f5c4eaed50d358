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
from cgi_wave.fringes.imaging import SPARE, Span
from cgi_wave.fringes.layer import Zone

Array = NDArray[np.float64]
Real = NDArray[np.floating]
#: Part of what interpolation between the nodes errs by, up to which kernels are made of fewer ones.
FEWER = 0.1


@dataclass(frozen=True)
class NominalImage:
    """maps (K, C, H, X) : images of the scene, one per term, on the zone's columns and on rows of the scene from the
    ``first`` on; along (K, R) : T_k on the zone's rows

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
    first: int = 0


@dataclass(frozen=True)
class NominalBlur:
    """What makes nominal images of any part of a scene. shapes (S, h, w), how (S,) : kernels and how each is applied;
    weights (S, K, X) : how terms are made of them; along (K, R)

    misfit (N, h, w) : what the kernels miss at the points between the nodes; lost : Σ|…| of all that was left out;
    outside, arms : of the PSF; error : of the convolutions, in units of the scene
    """

    shapes: Array
    how: tuple[blur.Blur, ...]
    weights: Array
    along: Array
    column: Array
    misfit: Array
    lost: float
    outside: float
    arms: float
    error: float
    precision: type
    tile: bool

    def image(self, maps: Real, rows: tuple[int, int] | None = None) -> NominalImage:
        """The image of a scene (C, H, W) on its rows from the first up to the second number (None, or if it repeats:
        all). Errors are those on this part."""
        height, width = maps.shape[1:]
        rows = (0, height) if rows is None or self.tile else (max(rows[0], 0), min(rows[1], height))
        low, high = int(np.floor(self.column.min())) - 2, int(np.ceil(self.column.max())) + 3
        columns = max(low, 0), min(high, width)
        out: Real = np.zeros((self.weights.shape[1], len(maps), rows[1] - rows[0], len(self.column)), self.precision)
        for shape, how, weight in zip(self.shapes, self.how, self.weights.astype(self.precision), strict=True):
            for c, one in enumerate(maps):
                part = blur.part(one[None], how, shape, self.tile, rows, columns, self.precision)
                seen = _columns(part[0], self.column - columns[0])
                for k, by_column in enumerate(weight):
                    out[k, c] += by_column * seen
        measured = max((self._largest(maps[:1], one, rows) for one in self.misfit), default=0.0)
        reach = float(maps[0].max()) - float(maps[0].min())
        return NominalImage(
            out, self.along, " and ".join(sorted({how.method for how in self.how})), len(self.shapes), self.error,
            measured + 0.5 * self.lost * reach, self.outside * reach, 0.5 * self.arms * reach, rows[0],
        )  # fmt: skip

    def over(self, maps: Real, zone: Zone, span: Span) -> NominalImage:
        """The image on the rows that a zone looks at on the scrolls of a span, and SPARE more."""
        first = int(np.floor(zone.row + span.low)) - SPARE
        return self.image(maps, (first, int(np.ceil(zone.row + span.high)) + zone.shape[0] + SPARE))

    def _largest(self, image: Real, kernel: Array, rows: tuple[int, int]) -> float:
        """Largest |value| of an image through a kernel."""
        if not kernel.any():
            return 0.0
        how, width = blur.choose(kernel, 0.0, image.size), image.shape[2]
        most = 0.0
        for start in range(*rows, rows[1] - rows[0] if self.tile else blur.STRIP):
            strip = start, rows[1] if self.tile else min(start + blur.STRIP, rows[1])
            seen = blur.part(image, how, kernel, self.tile, strip, (0, width), np.float64)
            most = max(most, float(seen.max()), -float(seen.min()))
        return most


def nominal_blur(
    psf: NominalPsf, zone: tuple[float, float, float, float], pixels: Zone, maps: Real, tolerance: float,
    precision: type = np.float64, tile: bool = False,
) -> NominalBlur:  # fmt: skip
    """How to convolve a scene with the nominal PSF.

    zone : x0, x1, y0, y1, m, that psf's nodes are for; pixels : of the frames, in it; maps (C, H, W) : the scene;
    tolerance : error allowed to convolutions, relative to the scene's largest value; tile : along track it repeats
    """
    terms = _terms(psf)
    misfit = np.array([check - kernel for check, kernel in zip(psf.check, _at(psf, psf.check_m), strict=True)])
    unseen = np.abs(misfit).sum(axis=(1, 2)).max(initial=0.0)
    rest = np.abs(terms).sum(axis=(2, 3)).max(axis=1)[::-1].cumsum()[::-1]
    count = max(int((rest > unseen).sum()), 1) if len(misfit) else len(terms)
    left = float(rest[count]) if count < len(rest) else 0.0
    to_x = chebyshev.interpolation_matrix(psf.x_m, pixels.x_m)
    shapes, mix, lost = _shapes(terms[:count], max(FEWER * unseen, 1e-12))
    weights = np.einsum("ib,kbr->rki", to_x, mix)
    size = [float(np.abs(weight).sum(axis=0).max()) or 1.0 for weight in weights]
    how = tuple(
        blur.choose(shape, tolerance / len(shapes) / one, maps[0].size, precision == np.float32)
        for shape, one in zip(shapes, size, strict=True)
    )
    v = (2.0 * pixels.y_m - zone[2] - zone[3]) / (zone[3] - zone[2])
    along = np.asarray(np.polynomial.chebyshev.chebvander(v, count - 1).T, np.float64)
    column = np.asarray(pixels.column + np.arange(len(pixels.x_m)), np.float64)
    scale = max(float(maps.max()), -float(maps.min())) or 1.0
    error = scale * sum(one.error * part for one, part in zip(how, size, strict=True))
    return NominalBlur(shapes, how, weights, along, column, misfit, left + lost, psf.outside, psf.arms, error,
                       precision, tile)  # fmt: skip


def nominal_image(
    psf: NominalPsf, zone: tuple[float, float, float, float], pixels: Zone, maps: Real, tolerance: float,
    precision: type = np.float64, tile: bool = False,
) -> NominalImage:  # fmt: skip
    """A whole scene through the nominal PSF: ``nominal_blur`` and its image."""
    return nominal_blur(psf, zone, pixels, maps, tolerance, precision, tile).image(maps)


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
