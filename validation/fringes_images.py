"""Time of a frame over a scene against its error, as the scene's rank, the ghosts and the kernels of their blurs vary.

uv run python -m validation.fringes_images --field FILE.nc [--json]

The scene is the embedded one under a plume, a test pattern that takes a few spectral modes. The truth is summed at
random pixels layer by layer in float64: each image is blurred with its whole kernel, over the whole scene, and read by
cubics where the layer looks, or between two cells of ground if nothing blurs it; there is no grid of nodes, and the
nominal image is made to a hundredth of the tolerance.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cgi_wave.budget.scenes import band_scene
from cgi_wave.budget.setting import filter_of
from cgi_wave.fringes import blur, smooth
from cgi_wave.fringes.beams_on_scene import Beams
from cgi_wave.fringes.field import FringeField
from cgi_wave.fringes.field_file import load_field
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.nominal_image import NominalImage, nominal_image
from cgi_wave.fringes.pattern import Layer, fringe_patterns
from cgi_wave.fringes.preparation import prepare
from cgi_wave.optics.system import load_instrument
from cgi_wave.ready import IMAGES, nominal_phase, zone_on
from cgi_wave.scene.atmosphere import column_mass, optical_depth, standard_atmosphere
from cgi_wave.scene.oxygen import oxygen_a_band
from cgi_wave.scene.plume import Plume, with_plume

Array = np.ndarray
PIXELS, MARGIN, SCROLLS, REPEATS = 4000, 64, 4, 30
TOLERANCES = (1e-3, 1e-5)  # beside the default
RANK = 1e-5  # what the low-rank form of the plume may leave, of the radiance
GHOSTS = (0, 5, 20)
PLUME = Plume(direction_deg=80.0, width_m=1500.0, length_m=20000.0, peak_factor=0.1)


@dataclass(frozen=True)
class Case:
    """A zone over a scene. maps (C, H, W); layers: patterns in float32, the nominal one first."""

    field: FringeField
    zone: Zone
    maps: Array
    layers: tuple[Layer, ...]

    def image(self, tolerance: float, modes: int, dtype: type) -> NominalImage | None:
        """The nominal one."""
        psf = self.field.psf
        return None if psf is None else nominal_image(
            psf, self.field.zone, self.zone, self.maps[:modes], tolerance, dtype
        )  # fmt: skip

    def beams(self, layers: Sequence[Layer], modes: int, tolerance: float = IMAGES) -> Beams:
        """Frames of some layers and modes."""
        some = [replace(layer, pattern=layer.pattern[:modes]) for layer in layers]
        image = self.image(tolerance, modes, np.float32)
        return prepare(some, self.maps[:modes], self.zone, tolerance=tolerance, nominal=image, fractions=False)


def case_of(field: FringeField) -> Case:
    """The field over the embedded scene with the plume."""
    loaded = load_instrument()
    system = loaded.band(field.band)
    ground = band_scene(system, "landsat", 2, float(SCROLLS), MARGIN, zone=field.zone)
    air, lines = standard_atmosphere(8), oxygen_a_band()
    depth = system.spec.spectrum.air_mass * optical_depth(lines, ground.sigma, air)
    seen_through = filter_of(system)
    scene = with_plume(ground, PLUME, depth, column_mass(lines, air), seen_through, RANK)
    weights = seen_through.transmission(scene.sigma) * scene.shapes
    layers = fringe_patterns(field, scene.sigma, weights, dtype=np.float32)
    return Case(field, zone_on(field, scene, nominal_phase(field)), scene.maps, layers)


def truth(case: Case, j: Array, i: Array) -> Array:
    """(N,) irradiance at rows j and columns i at scroll 0."""
    zone, maps = case.zone, case.maps.astype(np.float64)
    out = np.zeros(len(j))
    for number, layer in enumerate(case.layers):
        pattern = layer.pattern[:, j, i].astype(np.float64)
        image = case.image(0.01 * IMAGES, len(maps), np.float64) if number == 0 else None
        if image is not None:
            row = round(zone.row) + j
            for term, along in zip(image.maps, image.along, strict=True):
                out += along[j] * (pattern * term[:, row, i]).sum(axis=0)
            continue
        affine = np.eye(2, 3) if layer.view is None else layer.view.affine
        place = affine @ np.array([zone.x_m[i], zone.y_m[j], np.ones(len(j))])
        column = zone.column + (place[0] - zone.x_m[0]) / zone.pitch
        row = zone.row + (place[1] - zone.y_m[0]) / zone.pitch
        seen: Array = maps
        taps = 2  # ground made of uniform cells
        if layer.view is not None and layer.view.blurs:
            kernel = layer.view.kernel.astype(np.float64)
            first, last = (np.array([int(pick(row)), int(pick(column))]) for pick in (np.min, np.max))
            first, last = first - 4, last + 5
            how = blur.choose(kernel, 1e-12, maps[0].size)
            seen = blur.part(maps, how, kernel, False, (first[0], last[0]), (first[1], last[1]))
            row, column, taps = row - first[0], column - first[1], 4
        at_y, weight_y = smooth.taps(row, seen.shape[1], False, taps)
        at_x, weight_x = smooth.taps(column, seen.shape[2], False, taps)
        read = np.zeros_like(pattern)
        for a in range(taps):
            for b in range(taps):
                read += weight_y[:, a] * weight_x[:, b] * seen[:, at_y[:, a], at_x[:, b]]
        out += (pattern * read).sum(axis=0)
    return out


def study(field: FringeField, seed: int = 1) -> dict[str, Any]:
    """The chart's points: what, seconds per frame (two threads), largest error over the frame's mean."""
    case = case_of(field)
    rng = np.random.default_rng(seed)
    rows, columns = case.zone.shape
    j, i = rng.integers(0, rows, PIXELS), rng.integers(0, columns, PIXELS)
    print(f"truth of {len(case.layers)} layers, {len(case.maps)} modes", file=sys.stderr, flush=True)
    right = truth(case, j, i)
    modes = len(case.maps)
    strength = [float(np.abs(layer.pattern[0]).max()) for layer in case.layers[1:]]
    order = [1 + int(k) for k in np.argsort(strength)[::-1]]
    chart = []

    def point(series: str, what: str, layers: Sequence[Layer], count: int, tolerance: float = IMAGES) -> None:
        beams = case.beams(layers, count, tolerance)
        out = np.empty(beams.zone.shape, np.float32)
        best = np.inf
        with ThreadPoolExecutor(1) as pool:
            for repeat in range(REPEATS):
                started = time.perf_counter()
                beams.frame(float(repeat % SCROLLS), out, pool)
                best = min(best, time.perf_counter() - started)
        off = np.abs(beams.frame(0.0)[j, i] - right)
        chart.append({"series": series, "what": what, "layers": len(layers), "modes": count, "tolerance": tolerance,
                      "seconds": best, "error": float(off.max() / right.mean()),
                      "error_rms": float(np.sqrt((off**2).mean()) / right.mean())})  # fmt: skip
        print(f"{series} {what}: {best:.2g} s", file=sys.stderr, flush=True)

    point("default", "default", case.layers, modes)
    for tolerance in TOLERANCES:
        point("kernels", f"{tolerance:.0e}".replace("e-0", "e-"), case.layers, modes, tolerance)
    for count in range(1, modes):
        point("rank", str(count), case.layers, count)
    for count in GHOSTS:
        if count < len(case.layers) - 1:
            point("ghosts", str(count), [case.layers[0], *(case.layers[k] for k in sorted(order[:count]))], modes)
    sharp = [layer if layer.view is None else replace(layer, view=replace(layer.view, stored=np.ones((1, 1))))
             for layer in case.layers]  # fmt: skip
    point("kernels", "none", sharp, modes)
    return {
        "scene_chart": chart,
        "scene_modes": modes,
        "scene_layers": len(case.layers),
        "scene_shape": [rows, columns],
    }


def main() -> None:
    """Print the points, or one JSON document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--field", required=True, help="file of a fringe field")
    options = parser.parse_args()
    found = study(load_field(options.field))
    if options.json:
        print(json.dumps(found))
        return
    for point in found["scene_chart"]:
        print(point)


if __name__ == "__main__":
    main()
