"""The study `images`: what point-spread functions do to frames of a band, and what frames leave out of them.

uv run python -m validation.images [--json] [--band NIR] [--field FILE.nc]

For each scene the nominal image beside the scene, the parts of its error, and the mutual kernels of all pairs. All
irradiances are relative to the nominal baseline times the scene's mean. Tracing takes minutes; --field keeps it.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import numpy as np

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.budget.scenes import band_scene
from cgi_wave.frames import field_of
from cgi_wave.fringes.field import FringeField
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.mutual_error import mutual_error
from cgi_wave.fringes.nominal_image import nominal_image
from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.ready import IMAGES, WIDEST_MARGIN
from cgi_wave.report.output import to_json

SCENES = ("landsat", "quadrants", "uniform")
#: Pairs of beams listed one by one.
LISTED = 6


def over_scene(system: OpticalSystem, field: FringeField, name: str) -> dict[str, Any]:
    """The image of one scene, and the errors of images, relative to the scene's mean."""
    if field.psf is None:
        raise ValueError("a fringe field without point-spread functions has nothing to show")
    maps = band_scene(system, name, 2, 0.0, WIDEST_MARGIN, zone=field.zone).maps
    pixels = Zone(field.x_pixels, field.y_pixels, float(WIDEST_MARGIN), float(WIDEST_MARGIN))
    found = nominal_image(field.psf, field.zone, pixels, maps, IMAGES)
    rows, columns = pixels.shape
    inside = maps[0, WIDEST_MARGIN : WIDEST_MARGIN + rows, WIDEST_MARGIN : WIDEST_MARGIN + columns]
    image = np.einsum("krx,kr->rx", found.maps[:, 0, WIDEST_MARGIN : WIDEST_MARGIN + rows], found.along)
    mean = float(maps[0].mean())
    baseline = float(field.transmission[:2].sum(axis=0).mean())
    measured, bounded = (value / baseline / mean for value in mutual_error(field, maps[0]))
    return {
        "scene": name, "terms": len(found.along), "kernels": found.kernels,
        "blurred_rms": float(np.sqrt(np.mean((image - inside) ** 2))) / mean,
        "blurred_most": float(np.abs(image - inside).max()) / mean, "convolutions": found.error / mean,
        "psf_between": found.between / mean, "psf_window": found.window / mean, "psf_arms": found.arms / mean,
        "mutual": measured, "mutual_bound": bounded,
    }  # fmt: skip


def pairs_of(field: FringeField) -> list[dict[str, Any]]:
    """Pairs with a ghost: twice their strength over the baseline, |γ|, Σ|apart|; those that may err most first."""
    baseline = float(field.transmission[:2].sum(axis=0).mean())
    found = [
        {
            "pair": f"{field.labels[p.m]} | {field.labels[p.l]}",
            "strength": 2.0 * float(field.strength(p).max()) / baseline,
            "contrast": float(np.abs(p.gamma).max()),
            "apart": 1.0 + float(np.abs(p.gamma).max()) if p.mutual is None else p.mutual.most,
        }
        for p in field.pairs
        if {p.m, p.l} != {0, 1}
    ]
    return sorted(found, key=lambda row: -row["strength"] * row["apart"])


def study(band: str = "NIR", file: str | None = None) -> dict[str, Any]:
    """Plain data of a band: kernels, scenes, pairs."""
    loaded = load_instrument()
    field = field_of(loaded, band, None, DEFAULT_TOLERANCE, file, progress=lambda text: print(text, file=sys.stderr))
    if field.psf is None:
        raise ValueError("a fringe field without point-spread functions has nothing to show")
    pairs = pairs_of(field)
    return {
        "band": band, "outside": field.psf.outside, "arms": field.psf.arms,
        "centre_weight": [float(field.psf.kernel.max(axis=(2, 3)).min()), float(field.psf.kernel.max())],
        "scenes": [over_scene(loaded.band(band), field, name) for name in SCENES],
        "pairs": len(pairs), "pairs_with_nominal_apart": max(
            (row["apart"] for row in pairs if "nominal" in row["pair"]), default=0.0),
        "strongest": pairs[:LISTED],
    }  # fmt: skip


def main() -> None:
    """Print the tables, or one JSON document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--band", default="NIR")
    parser.add_argument("--field", metavar="FILE.nc")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = study(options.band, options.field)
    if options.json:
        print(to_json(found))
        return
    low, high = found["centre_weight"]
    print(f"{found['band']}: a pixel's own ground has {low:.3f} to {high:.3f} of the weight")
    print(f"{found['outside']:.5f} of the light lies beyond the kernels; the arms' differ by {found['arms']:.5f}")
    print("scene      " + " ".join(f"{name:>13}" for name in list(found["scenes"][0])[1:]))
    for row in found["scenes"]:
        print(f"{row['scene']:<10} " + " ".join(f"{value:>13.4g}" for value in list(row.values())[1:]))
    print(f"{found['pairs']} pairs with a ghost; those with a nominal beam: sum of |apart| up to "
          f"{found['pairs_with_nominal_apart']:.4f}")  # fmt: skip
    for row in found["strongest"]:
        print(f"{row['strength']:.3e}  contrast {row['contrast']:.3f}  apart {row['apart']:.3f}  {row['pair']}")


if __name__ == "__main__":
    main()
