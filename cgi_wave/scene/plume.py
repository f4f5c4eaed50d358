"""A plume of gas that a steady wind carries away from a source, as an excess column."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc, erfcx

from cgi_wave.errors import InputError
from cgi_wave.scene.column import TOLERANCE, with_column
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.ground import Scene

Array = NDArray[np.float64]

#: Standard deviations, and e-folding lengths, beyond which a plume is zero (1e-14 of its peak).
_REACH, _LENGTHS = 8.0, 33.0


@dataclass(frozen=True)
class Plume:
    """Column of gas q·E(d)·N(y; w(d)) at d downwind and y across, both in m on the ground.

    N is a Gaussian of unit area and standard deviation w = √(width² + (spread·d)²), d > 0, and ``width`` upwind: the
    crosswind integral does not depend on the spread. E falls as exp(−d/length) from a source that is itself a Gaussian
    of ``width`` along the wind; ∫E dd = length. The mass is then q·length.

    at_m : source (X, Y) in ground metres from the scene's centre, along scene axes
    direction_deg : where the wind blows to, from +X towards +Y
    width_m, length_m > 0; spread ≥ 0, growth of the width per metre
    mass_kg, peak_kg_m2, peak_factor : exactly one of them, ≥ 0: the mass of the whole plume, the largest column in it,
        or that as a share of the background column
    """

    at_m: tuple[float, float] = (0.0, 0.0)
    direction_deg: float = 90.0
    width_m: float = 300.0
    length_m: float = 5000.0
    spread: float = 0.1
    mass_kg: float | None = None
    peak_kg_m2: float | None = None
    peak_factor: float | None = None

    def __post_init__(self) -> None:
        def refuse(field: str, value: object, problem: str, remedy: str) -> InputError:
            return InputError("plume", field, value, problem, remedy)

        for field in ("width_m", "length_m"):
            value = getattr(self, field)
            if not (np.isfinite(value) and value > 0):
                raise refuse(field, value, "not a positive length", "give metres on the ground")
        if not (np.isfinite(self.spread) and self.spread >= 0):
            raise refuse("spread", self.spread, "not a growth", "give 0 or more, such as 0.1")
        if not np.isfinite([*self.at_m, self.direction_deg]).all():
            raise refuse("at_m, direction_deg", (self.at_m, self.direction_deg), "not finite", "give finite numbers")
        amounts = ("mass_kg", "peak_kg_m2", "peak_factor")
        given = {name: getattr(self, name) for name in amounts if getattr(self, name) is not None}
        if len(given) != 1:
            raise refuse(", ".join(amounts), given, "not exactly one amount", "give one of the three")
        (name, amount), *_ = given.items()
        if not (np.isfinite(amount) and amount >= 0):
            raise refuse(name, amount, "not an amount", "give 0 or more")

    def line_density(self, background_kg_m2: float | None = None) -> float:
        """q in kg/m: gas per metre downwind, before it decays. ``peak_factor`` needs the background column."""
        if self.mass_kg is not None:
            return self.mass_kg / self.length_m
        peak = self.peak_kg_m2
        if peak is None:
            assert self.peak_factor is not None
            if background_kg_m2 is None or not background_kg_m2 > 0:
                raise InputError(
                    "plume", "background_kg_m2", background_kg_m2, "not the column that peak_factor is a share of",
                    "give the vertical background column in kg/m²",
                )  # fmt: skip
            peak = self.peak_factor * background_kg_m2
        # The peak lies on the axis, a few widths down: on a grid a thousandth of a width apart it is found to 1e-6.
        along = np.linspace(-1, min(8.0, 1 + 8 * self.length_m / self.width_m), 9001) * self.width_m
        return float(peak / self._shape(along, np.zeros_like(along)).max())

    def mass(self, background_kg_m2: float | None = None) -> float:
        """Mass of the whole plume, kg."""
        return self.line_density(background_kg_m2) * self.length_m

    def _shape(self, along: Array, across: Array) -> Array:
        """E(d)·N(y; w(d)), 1/m."""
        s, length = self.width_m, self.length_m
        z = (s / length - along / s) / np.sqrt(2)
        upwind = np.exp(-0.5 * (along / s) ** 2) * erfcx(np.maximum(z, 0))
        # Where this is used, z ≤ 0, the exponent is negative; elsewhere it must not overflow.
        decay = np.exp(np.minimum(0.5 * (s / length) ** 2 - along / length, 0)) * erfc(z)
        started = 0.5 * np.where(z > 0, upwind, decay)
        width = np.hypot(s, self.spread * np.maximum(along, 0))
        crosswind: Array = np.exp(-0.5 * (across / width) ** 2) / (np.sqrt(2 * np.pi) * width)
        return started * crosswind

    def column(self, rows: int, columns: int, ground_pixel_m: float, background_kg_m2: float | None = None) -> Array:
        """(rows, columns) excess column in kg/m², the mean over each pixel (Gauss–Legendre points in it)."""
        y = (np.arange(rows) - 0.5 * (rows - 1))[:, None] * ground_pixel_m - self.at_m[1]
        x = (np.arange(columns) - 0.5 * (columns - 1))[None, :] * ground_pixel_m - self.at_m[0]
        c, s = np.cos(np.radians(self.direction_deg)), np.sin(np.radians(self.direction_deg))
        along, across = c * x + s * y, c * y - s * x
        near = _REACH * self.width_m + ground_pixel_m
        wide = near + _REACH * self.spread * np.maximum(along, 0)
        inside = (along > -near) & (along < near + _LENGTHS * self.length_m) & (np.abs(across) < wide)
        along, across = along[inside], across[inside]
        # Three points integrate a pixel much smaller than the plume's deviation to 1e-8; narrower plumes need more.
        order = int(np.clip(np.ceil(2 + 3 * ground_pixel_m / self.width_m), 3, 40))
        nodes, weights = np.polynomial.legendre.leggauss(order)
        total = np.zeros_like(along)
        for u, wu in zip(0.5 * ground_pixel_m * nodes, 0.5 * weights, strict=True):
            for v, wv in zip(0.5 * ground_pixel_m * nodes, 0.5 * weights, strict=True):
                total += wu * wv * self._shape(along + c * u + s * v, across + c * v - s * u)
        result = np.zeros((rows, columns))
        result[inside] = self.line_density(background_kg_m2) * total
        return result


def with_plume(
    scene: Scene,
    plumes: Plume | Sequence[Plume],
    depth: Array,
    background_kg_m2: float,
    band_filter: Filter,
    tolerance: float = TOLERANCE,
) -> Scene:
    """The scene with plumes of an absorbing gas over it.

    depth : (S,) optical depth along the slant path of a column ``background_kg_m2`` (vertical, kg/m²) of the gas. With
        the whole atmosphere's depth the plume has the background's line shapes; with that of a layer near the ground,
        its own. For a gas that has no sources, such as oxygen, this is a way to make a test pattern, not physics.

    Plumes add up. Only the light's way through the column above the pixel counts: the slanted way down of sunlight
    through a neighbouring column is not told apart. Raises InputError; see ``with_column``.
    """
    plumes = [plumes] if isinstance(plumes, Plume) else list(plumes)
    if not (np.isfinite(background_kg_m2) and background_kg_m2 > 0):
        raise InputError("plume", "background_kg_m2", background_kg_m2, "not a column", "give kg/m² > 0")
    if not plumes:
        raise InputError("plume", "plumes", 0, "none given", "give one plume or several")
    column = np.zeros(scene.maps.shape[1:])
    notes = []
    for plume in plumes:
        own = plume.column(scene.rows, scene.columns, scene.ground_pixel_m, background_kg_m2)
        mass, here = plume.mass(background_kg_m2), own.sum() * scene.ground_pixel_m**2
        notes.append(f"plume of {mass:.4g} kg, {100 * here / mass if mass else 100:.1f} % of it in the scene")
        column += own
    return with_column(scene, column / background_kg_m2, depth, band_filter, tolerance, " and ".join(notes))
