"""The study `fringes`: frames of a real zone beside the sum of every term, and what frames cost; streaming.

    uv run python -m validation.fringes [--json] [--band NIR] [--pixels N] [--no-stream] [--field FILE.nc] [--out DIR]

Traces the band's fringe field, or reads it from a file (written there if it does not exist), stretches it over
1024 × 1024 pixels, and makes the frame of a uniform scene with all ghosts. The direct sum (float64, compiled, two
threads, every pair and spectral sample) is taken at random pixels: the error is measured there, and its time for the
whole frame is extrapolated from them. The chart shows time against error as the spectral sampling and the number of
pairs vary, and beside it that of a frame over a scene (``fringes_images``), with the defaults marked.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit, prange

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.analysis import zone_rows
from cgi_wave.budget.fieldpoint import field_point
from cgi_wave.budget.select import select_ghosts
from cgi_wave.budget.setting import band_setting
from cgi_wave.fields import BandField
from cgi_wave.frames import field_of
from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.field import FringeField, at_sigma, frozen
from cgi_wave.fringes.nma import retrieve
from cgi_wave.fringes.pattern import fringe_patterns
from cgi_wave.fringes.psi import synthesise
from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.paths import find_paths
from validation.fringes_plots import draw

SIZE = 1024
OUT = Path("out/validation/fringes")
Array = np.ndarray


def stretched(zone: FringeField, size: int = SIZE) -> FringeField:
    """The field over size × size pixels of its own pitch: the same polynomials over a larger or smaller zone.

    Fringes keep their number; shadows their place among the rows, and their width in pixels.
    """
    x0, x1, y0, y1 = zone.zone
    half = 0.5 * size * zone.pixel_m

    def place(value: Any, low: float, high: float) -> Any:
        return half * (2.0 * (value - low) / (high - low) - 1.0)

    return replace(
        zone, x_m=place(zone.x_m, x0, x1), y_m=place(zone.y_m, y0, y1), zone=(-half, half, -half, half),
        rows=(0, size), columns=(0, size),
        shadows=tuple(replace(s, y_m=float(place(s.y_m, y0, y1))) for s in zone.shadows),
    )  # fmt: skip


@njit(parallel=True, nogil=True)
def _direct(sigma, weight, to_sigma, gamma, opd, strength, out):  # type: ignore[no-untyped-def]
    """out (N,) += Σ_σ Σ_pairs 2 strength Re[γ exp(i2πσ OPD)] w, for N pixels.

    to_sigma (S, K) from a pair's nodes to the samples; gamma (P, K, N), opd (P, K, N), strength (P, N).
    """
    for n in prange(out.shape[0]):
        for p in range(gamma.shape[0]):
            total = 0.0
            for s in range(sigma.shape[0]):
                value, path = 0.0j, 0.0
                for k in range(to_sigma.shape[1]):
                    value += to_sigma[s, k] * gamma[p, k, n]
                    path += to_sigma[s, k] * opd[p, k, n]
                phase = 2.0 * np.pi * sigma[s] * path
                total += weight[s] * (value.real * np.cos(phase) - value.imag * np.sin(phase))
            out[n] += 2.0 * strength[p, n] * total


def direct(zone: FringeField, sigma: Array, weight: Array, rows: Array, columns: Array) -> tuple[Array, float]:
    """Irradiance at pixel centres (N,), and the seconds of the sum alone. No shadows: the pixels must be in none."""
    # Not the package's trapezoid: what is judged must not make the judgement.
    step = np.gradient(sigma)
    step[[0, -1]] = 0.5 * (sigma[1] - sigma[0]), 0.5 * (sigma[-1] - sigma[-2])
    w = weight * step / (weight @ step)
    to_y = chebyshev.interpolation_matrix(zone.y_m, zone.y_pixels[rows])
    to_x = chebyshev.interpolation_matrix(zone.x_m, zone.x_pixels[columns])

    def at(values: Array) -> Array:
        return np.einsum("ny,...yx,nx->...n", to_y, values, to_x)

    groups: dict[bytes, list[Any]] = {}
    for pair in zone.pairs:
        groups.setdefault(pair.sigma.tobytes(), []).append(pair)
    out = at(zone.transmission).sum(axis=0)
    seconds = 0.0
    for pairs in groups.values():
        arguments = (
            sigma, w, chebyshev.interpolation_matrix(pairs[0].sigma, sigma), at(np.array([p.gamma for p in pairs])),
            at(np.array([p.opd_m for p in pairs])), at(np.array([zone.strength(p) for p in pairs])),
        )  # fmt: skip
        started = time.perf_counter()
        _direct(*arguments, out)
        seconds += time.perf_counter() - started
    return out, seconds


def clock(call: Callable[[], Any], repeats: int = 6) -> tuple[Any, float]:
    """Result and shortest time of some calls, after one that compiles."""
    result, best = call(), np.inf
    for _ in range(repeats):
        started = time.perf_counter()
        result = call()
        best = min(best, time.perf_counter() - started)
    return result, best


def speed(band: BandField, pixels: int, seed: int = 1) -> dict[str, Any]:
    """The frame beside the direct sum: time, error, and both for coarser spectra and fewer pairs."""
    zone = stretched(band.field)
    sigma, weight = band.setting.spectrum.sigma, band.setting.weight
    ends = [pair.sigma for pair in zone.pairs]
    inside = (sigma >= max(e[0] for e in ends)) & (sigma <= min(e[-1] for e in ends)) & (weight > 0.0)
    sigma, weight = sigma[inside], weight[inside]
    rng = np.random.default_rng(seed)
    clear = np.flatnonzero(
        np.all([np.ones(len(zone.y_pixels), bool), *(s.passed(zone.y_pixels) >= 1.0 for s in zone.shadows)], axis=0)
    )
    rows, columns = rng.choice(clear, pixels), rng.integers(0, SIZE, pixels)
    direct(zone, sigma[:50], weight[:50], rows, columns)  # compiled before the clock starts
    truth, spent = direct(zone, sigma, weight, rows, columns)
    share = zone.transmission[:2].sum(axis=0).mean()

    def one(field: FringeField, step: int = 1) -> tuple[float, float]:
        layers, seconds = clock(
            lambda: fringe_patterns(field, sigma[::step], weight[None, ::step], pixel=False, apart=False)
        )
        return seconds, float(np.abs(layers[0].pattern[0, rows, columns] - truth).max() / share)

    seconds, error = one(zone)
    (averaged,), with_pixels = clock(lambda: fringe_patterns(zone, sigma, weight[None], apart=False))
    _, apart = clock(lambda: fringe_patterns(zone, sigma, weight[None]), repeats=1)
    whole = spent / pixels * SIZE**2
    size = [float((zone.strength(p) * np.abs(p.gamma).max(axis=0)).max()) for p in zone.pairs]
    order = np.argsort(size)[::-1]
    nominal = zone.pairs.index(zone.nominal)
    everything = len(zone.pairs), len(sigma)
    chart = [_point("default", "default", *everything, seconds, error)]
    for step in (2, 4):
        chart.append(_point("samples", f"1/{step}", len(zone.pairs), len(sigma[::step]), *one(zone, step)))
    for count in (1, 3, 9, 20):
        kept = sorted({nominal, *order[:count].tolist()})
        fewer = replace(zone, pairs=tuple(zone.pairs[k] for k in kept))
        chart.append(_point("pairs", str(len(kept)), len(kept), len(sigma), *one(fewer)))
    return {
        "speedup_vs_direct": whole / seconds,
        "frame_seconds": seconds,
        "frame_seconds_with_pixel_means": with_pixels,
        "frame_seconds_layers_apart": apart,
        "direct_seconds_extrapolated": whole,
        "direct_pixels_measured": pixels,
        "direct_ns_per_pixel_pair_sample": 1e9 * spent / pixels / len(zone.pairs) / len(sigma),
        "error_relative_to_baseline": error,
        "pairs": len(zone.pairs),
        "samples": len(sigma),
        "error_bar": {
            name: getattr(averaged, name) / share
            for name in ("error", "contrast", "power", "interpolation", "left_out", "numerical")
        },
        "chart": chart,
    }


def _point(series: str, what: str, pairs: int, samples: int, seconds: float, error: float) -> dict[str, Any]:
    return {"series": series, "what": what, "pairs": pairs, "samples": samples, "seconds": seconds, "error": error}


def nominal_only(zone: FringeField) -> FringeField:
    """The field without its ghosts."""
    none = np.zeros_like(zone.transmission)
    none[:2] = zone.transmission[:2]
    return replace(zone, transmission=none, pairs=(zone.nominal,), transmission_interpolation=0.0)


def nma_error(zone: FringeField, rows: tuple[int, int], sigma: Array, weight: Array) -> Array:
    """NMA error due to ghosts per column (K,), by least squares over whole fringes of the rows, under uniform light."""
    first, last = rows[0] - zone.rows[0], rows[1] - zone.rows[0]
    to_y, to_x = zone.to(zone.y_pixels[first:last], zone.x_pixels)
    phase = 2.0 * np.pi * zone.sigma0 * (to_y @ at_sigma(zone.nominal, zone.sigma0)[1] @ to_x)
    with_ghosts, without = (
        fringe_patterns(z, sigma, weight[None], apart=False)[0].pattern[0, first:last]
        for z in (zone, nominal_only(zone))
    )
    found = []
    for theta, a, b in zip(phase.T, with_ghosts.T, without.T, strict=True):
        turns = np.abs(theta - theta[0]) / (2.0 * np.pi)
        keep = turns <= np.floor(turns[-1])
        u = np.linspace(-1.0, 1.0, int(keep.sum()))
        t = theta[keep]
        model = np.stack([np.ones_like(u), u, np.cos(t), np.sin(t), np.cos(2 * t), np.sin(2 * t)], axis=1)
        fit = np.linalg.lstsq(model, np.stack([a[keep], b[keep]], axis=1), rcond=None)[0]
        nominal = complex(fit[2, 1], -fit[3, 1])
        parasitic = complex(fit[2, 0], -fit[3, 0]) - nominal
        modulation = (parasitic * nominal.conjugate()).real / abs(nominal) ** 2
        found.append(1.0 - (1.0 + modulation) / (fit[0, 0] / fit[0, 1]))
    return np.array(found)


def field_effect(band: BandField) -> dict[str, float]:
    """NMA error of the band's zone: powers and contrasts held at its centre, by one dimension and by the frame; and as
    they are over the field. The difference of the last two is the field's own."""
    zone, setting = band.field, band.setting
    system = setting.system
    sigma, weight = setting.spectrum.sigma, setting.weight
    paths = select_ghosts(setting, find_paths(system))
    centre = system.field_points()[0]
    coherency = field_point(setting, paths, centre, DEFAULT_TOLERANCE).coherency
    psi = synthesise(coherency, sigma, weight, zone_rows(system, centre), system.pixel)
    held = frozen(coherency, zone.sigma0, zone.zone, zone.rows, (0, 1), zone.pixel_m, float(centre[1]))
    rows = system.spec.zone_rows
    free = nma_error(zone, rows, sigma, weight)
    return {
        "nma_error_one_dimension": retrieve(psi).coherent.nma_error.value,
        "nma_error_frame_frozen": float(nma_error(held, rows, sigma, weight)[0]),
        "nma_error_frame_mean": float(free.mean()),
        "nma_error_frame_spread": float(free.std()),
    }


def study(
    band: str = "NIR", pixels: int = 60, stream: bool = True, out: Path = OUT, file: Path | None = None
) -> dict[str, Any]:
    """All figures; writes out/frames.png. file: of the fringe field, as ``frames.field_of`` takes it."""
    loaded = load_instrument()
    traced = field_of(loaded, band, None, DEFAULT_TOLERANCE, file, progress=_tell)
    field = BandField(traced, band_setting(loaded.band(band)))
    found: dict[str, Any] = {"band": band, **field_effect(field), **speed(field, pixels)}
    if stream:
        from validation import fringes_images, fringes_stream

        found |= fringes_images.study(field.field)
        found |= fringes_stream.study(field.field)
    found["picture"] = str(draw(found, out / "frames.png"))
    return found


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main() -> None:
    """Print the figures, or one JSON document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--band", default="NIR")
    parser.add_argument("--pixels", type=int, default=60, help="for the direct sum (default %(default)s)")
    parser.add_argument("--no-stream", dest="stream", action="store_false")
    parser.add_argument("--field", type=Path, help="file of the band's fringe field")
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    found = study(options.band, options.pixels, options.stream, options.out, options.field)
    if options.json:
        print(json.dumps(found))
        return
    for name, value in found.items():
        print(f"{name:34} {value}")


if __name__ == "__main__":
    main()
