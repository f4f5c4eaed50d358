"""A scene seen through the blur of a beam: a kernel's value is the weight of the ground at that offset.

Done by nothing, boxes, two passes, the kernel itself or a Fourier transform: whichever is cheapest among those whose
error bound keeps the tolerance. Every bound is on the largest error for a map between 0 and 1:

* nothing: the part of the kernel outside its centre;
* box: a kernel constant on a rectangle, by running sums in float64: the sum of |what is left|, and rounding;
* separable: the best product of a column and a row (from the singular values): the sum of |what is left|. A uniform map
  keeps its value, since the product is scaled to the sum 1;
* direct: rounding;
* Fourier: rounding, as eps·log2(size) times the root of the kernel's and the map's energy.

Across track the map's edge goes on outside; along track too, or the map repeats.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Method = Literal["nothing", "box", "separable", "direct", "fourier"]
#: Nanoseconds per map sample, measured on one core; only their ratios matter: the box per pass, a tap of a one-way
#: convolution, a tap of a two-way one, a Fourier transform and back per sample and power of two.
COST_BOX, COST_LINE, COST_TAP, COST_FOURIER = 8.0, 1.2, 1.6, 8.0
#: Taps of a kernel up to which it is applied directly: SciPy's tables take the square of their number.
MOST_TAPS = 1500
#: Rows of a map that ``part`` takes at a time, or as many as a kernel reaches four times over.
STRIP = 256
THREADS = 2


@dataclass(frozen=True)
class Blur:
    """How a kernel is applied. error: bound for a map of unit range; cost: ns per sample; parts: its factors; single:
    a Fourier transform works in float32."""

    method: Method
    error: float
    cost: float
    parts: tuple[Array, ...] = ()
    single: bool = False


def choose(kernel: Array | None, tolerance: float, samples: int, single: bool = False) -> Blur:
    """The cheapest way to convolve a map of ``samples`` values within [0, 1] to within ``tolerance``.

    ``single``: the Fourier transform may work in float32 (its bound then says so). In float64 it is always allowed, and
    small kernels directly: their bounds are rounding.
    """
    if kernel is None:
        return Blur("nothing", 0.0, 0.0)
    options = [_nothing(kernel), _box(kernel), _separable(kernel)]
    options += [_fourier(kernel, samples, True)] if single else []
    exact = [_fourier(kernel, samples, False)] + ([_direct(kernel)] if kernel.size <= MOST_TAPS else [])
    allowed = [option for option in options if option is not None and option.error <= tolerance]
    return min([*allowed, *exact], key=lambda option: option.cost)


def correlate(maps: NDArray[np.floating], blur: Blur, kernel: Array | None, wrap: bool) -> NDArray[np.floating]:
    """out[p] = Σ_d kernel[d] map[p + d] for (…, H, W) maps, d from the kernel's middle; dtype is kept.

    Along track (H) the map repeats if ``wrap``, else its edge goes on, as it does across track.
    """
    if blur.method == "nothing" or kernel is None:
        return maps
    out = np.empty_like(maps)
    for index in np.ndindex(maps.shape[:-2]):
        out[index] = _one(maps[index], blur, kernel, "wrap" if wrap else "nearest")
    return out


def part(
    maps: NDArray[np.floating],
    blur: Blur,
    kernel: Array,
    wrap: bool,
    rows: tuple[int, int],
    columns: tuple[int, int],
    dtype: type | None = None,
) -> NDArray[np.floating]:
    """Rows and columns from the first up to the second number of what ``correlate`` gives for maps that go on for ever.

    Beyond a map its edge goes on; if it repeats along track (``wrap``), rows are its own, all of them. Costs what a map
    of this size costs, and as much again as the kernel reaches. dtype : of the result, if not that of the maps.
    """
    height, width = maps.shape[-2:]
    tall, wide = kernel.shape[0] // 2, kernel.shape[1] // 2
    across = np.clip(np.arange(columns[0] - wide, columns[1] + wide), 0, width - 1)
    out = np.empty((*maps.shape[:-2], rows[1] - rows[0], columns[1] - columns[0]), dtype or maps.dtype)
    # Strip by strip: what a transform of all takes in memory is several times the result.
    strip = height if wrap else max(STRIP, 4 * tall)
    for start in range(*rows, strip):
        stop = min(start + strip, rows[1])
        along = np.arange(height) if wrap else np.clip(np.arange(start - tall, stop + tall), 0, height - 1)
        patch = np.ascontiguousarray(maps[..., along[:, None], across[None, :]], dtype=dtype)
        top = 0 if wrap else tall
        inside = (slice(top, len(along) - top), slice(wide, len(across) - wide))
        for index in np.ndindex(maps.shape[:-2]):
            if blur.method == "fourier":
                precise = patch[index] if blur.single else patch[index].astype(np.float64)
                done = _circular(precise, kernel, wrap)
            else:
                done = correlate(patch[index][None], blur, kernel, wrap)[0]
            out[index][start - rows[0] : stop - rows[0]] = done[inside]
    return out


def _one(image: NDArray[np.floating], blur: Blur, kernel: Array, mode: str) -> NDArray[np.floating]:
    from scipy import ndimage

    if blur.method == "fourier":
        return _by_fourier(image if blur.single else image.astype(np.float64), kernel, mode)
    precise = image.astype(np.float64)
    if blur.method == "direct":  # ndimage pads one mode per call; the sides are padded here to have two of them
        rows, columns = kernel.shape[0] // 2, kernel.shape[1] // 2
        padded = _padded(precise, rows, columns, mode)
        full = ndimage.correlate(padded, kernel, mode="constant")
        return full[rows : rows + image.shape[0], columns : columns + image.shape[1]]
    for axis, part in enumerate(blur.parts):
        how = mode if axis == 0 else "nearest"
        if blur.method == "box":
            size, shift = int(part[0]), int(part[1])
            precise = _running_mean(precise, size, shift, axis, how)
        else:
            precise = ndimage.correlate1d(precise, part, axis=axis, mode=how)
    return precise


def _running_mean(image: Array, size: int, shift: int, axis: int, mode: str) -> Array:
    """Mean over the ``size`` samples from index − shift on."""
    pad = [(0, 0), (0, 0)]
    pad[axis] = (shift, max(size - 1 - shift, 0)) if shift >= 0 else (0, size - 1 - shift)
    long = np.pad(image, pad, mode="wrap" if mode == "wrap" else "edge")
    if shift < 0:
        long = np.take(long, range(-shift, long.shape[axis]), axis=axis)
    sums = np.concatenate([np.zeros_like(np.take(long, [0], axis=axis)), np.cumsum(long, axis=axis)], axis=axis)
    count = image.shape[axis]
    upper, lower = range(size, size + count), range(count)
    return (np.take(sums, upper, axis=axis) - np.take(sums, lower, axis=axis)) / size


def _padded(image: NDArray[np.floating], rows: int, columns: int, mode: str) -> NDArray[np.floating]:
    along = "wrap" if mode == "wrap" else "edge"
    tall = np.pad(image, ((rows, rows), (0, 0)), mode=along)  # type: ignore[call-overload]
    return np.pad(tall, ((0, 0), (columns, columns)), mode="edge")


def _by_fourier(image: NDArray[np.floating], kernel: Array, mode: str) -> NDArray[np.floating]:
    """Circular convolution of the padded map: along track without padding where it repeats anyway."""
    rows, columns = kernel.shape[0] // 2, kernel.shape[1] // 2
    circular = mode == "wrap"
    tall = image if circular else _padded(image, rows, 0, mode)
    wide = np.pad(tall, ((0, 0), (columns, columns)), mode="edge")
    full = _circular(wide, kernel, circular)
    top = 0 if circular else rows
    return full[top : top + image.shape[0], columns : columns + image.shape[1]]


def _circular(image: NDArray[np.floating], kernel: Array, wrap: bool) -> NDArray[np.floating]:
    """Convolution by Fourier transforms; the image repeats along rows if ``wrap``. Else what lies nearer to an edge
    than the kernel reaches means nothing."""
    from scipy import fft

    rows, columns = kernel.shape[0] // 2, kernel.shape[1] // 2
    height = image.shape[0] if wrap else fft.next_fast_len(image.shape[0], real=True)
    shape = (height, fft.next_fast_len(image.shape[1], real=True))
    spread = np.zeros(shape, dtype=image.dtype)
    at_row = (rows - np.arange(kernel.shape[0])) % shape[0]
    at_column = (columns - np.arange(kernel.shape[1])) % shape[1]
    # a kernel taller than a repeating map folds onto itself
    np.add.at(spread, (at_row[:, None], at_column[None, :]), kernel.astype(image.dtype))
    spectrum = fft.rfft2(image, shape, workers=THREADS)
    spectrum *= fft.rfft2(spread, workers=THREADS)
    del spread
    return np.asarray(fft.irfft2(spectrum, shape, workers=THREADS)[: image.shape[0], : image.shape[1]])


def _nothing(kernel: Array) -> Blur:
    centre = kernel[kernel.shape[0] // 2, kernel.shape[1] // 2]
    return Blur("nothing", float(np.abs(kernel).sum() - abs(centre) + abs(1.0 - centre - (kernel.sum() - centre))), 0.0)


def _box(kernel: Array) -> Blur | None:
    filled = kernel != 0.0
    rows, columns = np.flatnonzero(filled.any(axis=1)), np.flatnonzero(filled.any(axis=0))
    inside = kernel[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    left = float(np.abs(inside - inside.mean()).sum())
    # the window starts at the first filled offset
    parts = tuple(
        np.array([len(span), size // 2 - span[0]], dtype=np.float64)
        for span, size in ((rows, kernel.shape[0]), (columns, kernel.shape[1]))
    )
    return Blur("box", left + 1e-12, 2.0 * COST_BOX, parts)


def _separable(kernel: Array) -> Blur:
    # A product of two lines of sum 1 has them as its sums; what is left of other kernels is measured, not assumed.
    column, row = kernel.sum(axis=1), kernel.sum(axis=0)
    left = float(np.abs(kernel - np.outer(column, row)).sum())
    return Blur("separable", left + 1e-14 * sum(kernel.shape), COST_LINE * sum(kernel.shape), (column, row))


def _direct(kernel: Array) -> Blur:
    return Blur("direct", 2e-16 * kernel.size, COST_TAP * kernel.size)


def _fourier(kernel: Array, samples: int, single: bool) -> Blur:
    eps = 6e-8 if single else 1.2e-16
    energy = float(np.sqrt((kernel**2).sum() * samples))
    bits = np.log2(max(samples, 2) * 4.0)
    cost = COST_FOURIER * bits / 4.0 * (2.0 if single else 3.0)
    return Blur("fourier", float(eps * bits * max(energy, 1.0)), cost, single=single)
