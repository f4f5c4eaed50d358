"""How ghosts see the scene: which source directions feed a detector point, as places of the nominal image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from cgi_wave.fringes.field import SceneView
from cgi_wave.rays.beams import Rays
from cgi_wave.rays.disc import disc, fitted, monomials, on_disc

Array = NDArray[np.float64]
#: Points of the pupil that make a kernel, and the degree of the polynomials that carry rays to them.
DENSE, DEGREE = 20_000, 6
#: Width, in distances of rays, over which each ray of a wide blur is spread.
FILL = 4.0
#: Radius of a blur, in pixels, below which it is none; widest kernel, pixels.
SHARP, WIDEST = 0.3, 4097


@dataclass(frozen=True)
class Spread:
    """Light of one family on one detector point over source directions (cosines).

    mean (2,), covariance (2, 2); theta (N, 2) and weight (N,): single rays, or no rows
    """

    mean: Array
    covariance: Array
    theta: Array
    weight: Array


def spread_of(members: Sequence[tuple[Rays, float]], dense: bool) -> Spread:
    """Of rays of the paths of one family, each with its power; dense: with DENSE rays of each path."""
    theta, weight = [], []
    for rays, power in members:
        directions, share = _dense(rays) if dense else _even(rays)
        if share.sum() > 0.0:
            theta.append(directions)
            weight.append(power * share / share.sum())
    if not theta:
        return Spread(np.zeros(2), np.zeros((2, 2)), np.empty((0, 2)), np.empty(0))
    every, share = np.concatenate(theta), np.concatenate(weight)
    share = share / share.sum()
    mean = share @ every
    apart = every - mean
    keep = slice(None) if dense else slice(0)
    return Spread(mean, (apart * share[:, None]).T @ apart, every[keep], share[keep])


def _even(rays: Rays) -> tuple[Array, Array]:
    lit = rays.even & (rays.clearance[:, 0] > 0).all(axis=0)
    return rays.theta[0][lit], rays.amplitude[0, lit] ** 2


def _dense(rays: Rays) -> tuple[Array, Array]:
    """Rays between the traced ones, by polynomials over the pupil."""
    x, _, _ = on_disc(rays.pupil[0])
    values = np.column_stack([rays.theta[0], rays.amplitude[0], rays.clearance[:, 0].T])
    points = disc(DENSE)[: DENSE - int(3.0 * np.sqrt(DENSE))]
    made = monomials(points, DEGREE) @ fitted(x, values, DEGREE)
    lit = (made[:, 3:] > 0.0).all(axis=1)
    return made[lit, :2], np.maximum(made[lit, 2], 0.0) ** 2


def views(
    nodes: Sequence[tuple[Array, Array, Mapping[int, Spread]]], centre: Mapping[int, Spread], names: Mapping[int, str],
    pixel: float,
) -> tuple[SceneView, ...]:  # fmt: skip
    """Views of all families but the nominal one (0), from field points (x0, nominal direction, spreads by family).

    Directions become places by a polynomial through the nominal directions of all points. The kernel is that of the
    zone's centre.
    """
    to_place = _Image(np.array([theta for _, theta, _ in nodes]), np.array([x0 for x0, _, _ in nodes]))
    found = []
    for family, name in names.items():
        have = [(x0, spreads[family]) for x0, _, spreads in nodes if family in spreads and spreads[family].mean.any()]
        if not have:
            continue
        x0 = np.array([place for place, _ in have])
        seen = to_place(np.array([spread.mean for _, spread in have]))
        affine = np.eye(2, 3)
        if len(have) >= 3:
            design = np.column_stack([x0, np.ones(len(have))])
            affine = np.linalg.lstsq(design, seen, rcond=None)[0].T
        else:
            affine[:, 2] = (seen - x0).mean(axis=0)
        misfit = float(np.abs(np.column_stack([x0, np.ones(len(have))]) @ affine.T - seen).max())
        spread = centre.get(family)
        kernel = np.ones((1, 1))
        if spread is not None and len(spread.theta):
            kernel = _kernel(to_place(spread.theta), spread.weight, pixel)
        found.append(SceneView(family, name, affine, kernel, misfit))
    return tuple(found)


class _Image:
    """Nominal image place (m) of source directions (N, 2): a polynomial of second degree, of first for few points."""

    def __init__(self, theta: Array, place: Array) -> None:
        self.centre, self.scale = theta.mean(axis=0), np.abs(theta - theta.mean(axis=0)).max()
        self.degree = 2 if len(theta) >= 9 else 1
        self.coefficient = np.linalg.lstsq(self._terms(theta), place, rcond=None)[0]

    def _terms(self, theta: Array) -> Array:
        return monomials((theta - self.centre) / self.scale, self.degree)

    def __call__(self, theta: Array) -> Array:
        return np.asarray(self._terms(theta) @ self.coefficient)


def _kernel(place: Array, weight: Array, pixel: float) -> Array:
    """(H, W) share of the light per pixel about the mean place, [Y, X]; 1 × 1 if within SHARP pixels, rms.

    Each ray stands for a square as wide as FILL times the distance to its neighbours (from the area of a uniform disc
    of this covariance), or for its pixel if that is wider: else a wide blur would be a handful of spikes.
    """
    apart = (place - weight @ place) / pixel
    covariance = (apart * weight[:, None]).T @ apart
    if np.sqrt(np.trace(covariance)) < SHARP:
        return np.ones((1, 1))
    area = 4.0 * np.pi * np.sqrt(max(float(np.linalg.det(covariance)), 0.0))
    reach = round(0.5 * FILL * np.sqrt(area / len(weight)))
    half = np.minimum(np.ceil(np.abs(apart).max(axis=0)).astype(int) + 1 + reach, WIDEST // 2)
    edges = [np.arange(-h, h + 2) - 0.5 for h in half]
    found, _, _ = np.histogram2d(apart[:, 1], apart[:, 0], bins=(edges[1], edges[0]), weights=weight)
    if reach:
        # Twice a box: a triangle, under which an even lattice of rays is even.
        for _ in range(2):
            found = uniform_filter(found, reach + 1 - reach % 2, mode="constant")
    # Single precision is more than so many rays are worth, and a file holds twice as many kernels.
    return np.asarray((found / found.sum()).astype(np.float32), np.float64)
