"""Figures of streaming: share of the memory bandwidth, memory per pixel at any length, time of a long scroll.

uv run python -m validation.fringes_stream [--json] [--field FILE.nc]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fields import fringe_field
from cgi_wave.fringes.beams_on_scene import Beams
from cgi_wave.fringes.field import FringeField, SceneView
from cgi_wave.fringes.field_file import load_field, save_field
from cgi_wave.fringes.imaging import Span
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.maps import GroundFit, Window, window
from cgi_wave.fringes.pattern import Layer
from cgi_wave.fringes.preparation import prepare
from cgi_wave.fringes.scroll import give_back, motion, stream
from cgi_wave.optics.system import load_instrument
from cgi_wave.ready import Stopwatch, ready_for
from cgi_wave.scrolling import scroll

SIZE, PITCH, GHOSTS = 1024, 15e-6, 20
FRAMES = (200, 2000)
REAL_SEQUENCES = (700, 2000)
#: Frames' sizes in an array that no cache holds.
BEYOND_CACHE = 16
ALONE = 20  # frames in a row, and multiplications handed over together
REAL_FRAMES = 600  # of the real scene, after which they are gone through again
NO_ERRORS = dict.fromkeys([field.name for field in fields(Layer)][3:], 0.0)


def synthetic(size: int = SIZE, ghosts: int = GHOSTS, tolerance: float = 1e-5) -> tuple[Beams, Window]:
    """A frame of ten fringes with blurred ghost families, over a rough scene of its own height that repeats; and the
    window of the fit to it.

    Patterns are synthetic on purpose: the time of a frame depends on how many layers there are and how smooth, not on
    where they come from.
    """
    y = np.asarray((np.arange(size) - 0.5 * (size - 1)) * PITCH)
    phase = 2.0 * np.pi * 10.0 * (y[:, None] + 0.01 * y[None, :]) / (size * PITCH)
    zone = Zone(y, y, phase=phase)

    def layer(name: str, pattern: np.ndarray, view: SceneView | None) -> Layer:
        return Layer(name, pattern[None].astype(np.float32), view, **NO_ERRORS)

    layers = [layer("nominal", 0.5 + 0.2 * np.cos(phase), None)]
    u = y / np.ptp(y)
    for n in range(ghosts):
        power = 5e-3 / (n + 1)
        pattern = power * (1.0 + 0.2 * u[:, None] + 0.3 * np.cos(phase * (1 + 0.002 * n)) + 0.1 * np.sin(2.0 * phase))
        sigma = (30.0 + 3.0 * n) * size / SIZE
        line = np.exp(-0.5 * (np.arange(-int(4 * sigma), int(4 * sigma) + 1) / sigma) ** 2)
        kernel = np.outer(line, line) / line.sum() ** 2
        sign = -1.0 if n % 2 else 1.0
        affine = np.array([[sign * (1.0 + 0.01 * n), 0.0, 1e-5], [0.0, sign * (1.0 - 0.02 * n), 2e-5]])
        layers.append(layer(f"ghost {n}", pattern, SceneView(n + 1, f"ghost {n}", affine, kernel, 0.0)))
    scene = 0.2 + 0.8 * np.random.default_rng(0).random((1, size, size), dtype=np.float32)
    return prepare(layers, scene, zone, tolerance=tolerance, tile=True), window(phase)


def stream_fraction(field: FringeField | None = None, repeats: int = 150, batch: int = 4) -> dict[str, Any]:
    """Frames against out = a·b over arrays of a frame's size, two threads each, in turns; the best of each counts.

    In turns each begins with arrays that the others have driven out of the cache, and each multiplication is handed to
    the second thread by itself, as each frame is. The harder measure is ``steady``: ALONE frames of one scroll in a
    row, against as many multiplications that are handed over together, all in a cache that nothing else uses.

    Both are counted as two arrays read and one written. Arrays of a frame's size lie in the processor's cache, as those
    of a frame do in part; beside them stands the same over arrays BEYOND_CACHE times as large, per frame's size. With
    synthetic ghosts, and over the embedded scene with those of a real field, if given. Batches are short, so that the
    best of them had the machine for itself.
    """
    found: dict[str, Any] = {"load_average": os.getloadavg()[0]}
    made = {
        "no_ghosts": (synthetic(ghosts=0)[0], 1.0),
        "ghosts": (synthetic()[0], 1.0),
        "ghosts_fraction_of_a_row": (synthetic()[0], 1.25),
    }
    smooth = made["ghosts"][0].smooth
    assert smooth is not None
    found |= {"smooth_layers": len(smooth.row), "pitch": smooth.grid.pitch, "error": made["ghosts"][0].error}
    found |= _turns(made, repeats, batch)
    for name, share in (("ghosts", ""), ("no_ghosts", "_no_ghosts"), ("ghosts_fraction_of_a_row", "_part_rows")):
        found[f"stream_fraction{share}"] = found["multiply_ms"] / found[f"{name}_ms"]
        found[f"stream_fraction_steady{share}"] = found["multiply_steady_ms"] / found[f"{name}_steady_ms"]
        found[f"stream_fraction_of_memory{share}"] = found["multiply_in_memory_ms"] / found[f"{name}_ms"]
    if field is not None:
        beams = _real(field)
        ways = Counter(f"{plan.way} {plan.pitch}" for plan in beams.plans)
        times = _turns({"real": (beams, 1.0)}, repeats, batch)
        found |= {"real_layers": dict(ways), "real_shape": beams.zone.shape, "real_error": beams.error}
        found |= {"real_ms": times["real_ms"], "stream_fraction_real": times["multiply_ms"] / times["real_ms"]}
        found["stream_fraction_steady_real"] = times["multiply_steady_ms"] / times["real_steady_ms"]
    return found


def _real(field: FringeField) -> Beams:
    """The layers of a real field over the embedded scene, for as many frames as are timed."""
    loaded = load_instrument()
    span = Span(0.0, float(REAL_FRAMES))
    return ready_for(loaded, field, "landsat", span, True, "float32", lambda _: None, Stopwatch()).at(span, False).beams


def _turns(made: dict[str, tuple[Beams, float]], repeats: int, batch: int) -> dict[str, float]:
    """Milliseconds per frame of each, beams and rows per frame, and per multiplication, taking turns."""
    shape = next(iter(made.values()))[0].zone.shape
    a, b, out = (np.random.default_rng(n).random(shape, dtype=np.float32) for n in range(3))
    half = shape[0] // 2
    spans = (slice(0, half), slice(half, None))
    with ThreadPoolExecutor(2) as pool:

        def multiply(arrays: Sequence[NDArray[np.float32]]) -> None:
            first, last = ([array[rows] for array in arrays] for rows in spans)
            other = pool.submit(lambda: np.multiply(*last))
            np.multiply(*first)
            other.result()

        def many() -> None:
            first, last = ([array[rows] for array in (a, b, out)] for rows in spans)
            other = pool.submit(lambda: [np.multiply(*last) for _ in range(ALONE)])
            for _ in range(ALONE):
                np.multiply(*first)
            other.result()

        runs: dict[str, Callable[[int], object]] = {"multiply": lambda _: multiply((a, b, out))}
        for name, (beams, step) in made.items():
            runs[name] = lambda k, beams=beams, step=step: beams.frame(step * (k % REAL_FRAMES), out, pool)
        best = dict.fromkeys(runs, np.inf)
        for run in runs.values():
            run(0)
        for turn in range(repeats):
            for name, run in runs.items():
                started = time.perf_counter()
                for k in range(turn * batch, (turn + 1) * batch):
                    run(k)
                best[name] = min(best[name], (time.perf_counter() - started) / batch)
        for name in (*made, "multiply"):
            best[f"{name}_steady"] = np.inf
            for turn in range(repeats // 3):
                started = time.perf_counter()
                if name == "multiply":
                    many()
                else:
                    for k in range(turn * ALONE, (turn + 1) * ALONE):
                        runs[name](k)
                best[f"{name}_steady"] = min(best[f"{name}_steady"], (time.perf_counter() - started) / ALONE)
        large = [np.tile(array, (BEYOND_CACHE, 1)) for array in (a, b, out)]
        spans = (slice(0, half * BEYOND_CACHE), slice(half * BEYOND_CACHE, None))
        best["multiply_in_memory"] = np.inf
        for _ in range(20):
            started = time.perf_counter()
            multiply(large)
            best["multiply_in_memory"] = min(best["multiply_in_memory"], (time.perf_counter() - started) / BEYOND_CACHE)
    found = {f"{name}_ms": 1e3 * seconds for name, seconds in best.items()}
    return found | {f"{name}_gb_s": 3 * a.nbytes / seconds / 1e9 for name, seconds in best.items()}


def memory_and_time() -> dict[str, Any]:
    """Peak memory while frames stream, above the interpreter with everything imported and compiled, per pixel.

    In processes of their own. What preparing took, with all patterns of the ghosts at hand, is told beside it.
    """
    rows = []
    for frames in FRAMES:
        words = [sys.executable, "-m", "validation.fringes_stream", "--worker", str(frames)]
        rows.append(json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout))
    return {
        "memory_bytes_per_pixel": max(row["bytes_per_pixel"] for row in rows),
        "memory_growth_bytes_per_pixel": rows[-1]["bytes_per_pixel"] - rows[0]["bytes_per_pixel"],
        "setup_bytes_per_pixel": max(row["setup_bytes_per_pixel"] for row in rows),
        "seconds_2000_frames": rows[-1]["seconds"],
        "sequences": rows,
    }


def real_memory(field: FringeField) -> dict[str, Any]:
    """The same of the whole command ``scroll``, with all that it keeps: field, scene, images, two sequences, maps.

    Per pixel of the zone. Its sequences are as long as REAL_SEQUENCES; the embedded scene and the maps grow with them.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "field.nc"
        save_field(field, file)
        rows = []
        for frames in REAL_SEQUENCES:
            words = [sys.executable, "-m", "validation.fringes_stream", "--worker", str(frames), "--field", str(file)]
            rows.append(json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout))
    short, long = rows
    return {
        "memory_bytes_per_pixel_real": short["bytes_per_pixel"],
        "memory_bytes_per_pixel_and_frame_real": (long["bytes_per_pixel"] - short["bytes_per_pixel"])
        / (long["frames"] - short["frames"]),
        "setup_bytes_per_pixel_real": short["setup_bytes_per_pixel"],
        "sequences_real": rows,
    }  # fmt: skip


def real_worker(frames: int, field: FringeField, base: int) -> dict[str, float]:
    """One real scroll: as ``worker``, by zone pixel; base: KiB that the process held before it read the field."""
    setup, started = 0, 0.0

    def sink(k: int, _: object) -> None:
        nonlocal setup, started
        if k == 0:
            setup, started = _resident("VmHWM"), time.perf_counter()
            Path("/proc/self/clear_refs").write_text("5")

    begun = time.perf_counter()
    done = scroll(field.band, "landsat", frames, field=field, sink=sink)
    pixels = len(field.y_pixels) * len(field.x_pixels)
    return {
        "frames": frames, "ground_rows": len(done.y_m), "seconds": time.perf_counter() - started,
        "prepare_seconds": started - begun, "setup_bytes_per_pixel": 1024.0 * (setup - base) / pixels,
        "bytes_per_pixel": 1024.0 * (_resident("VmHWM") - base) / pixels,
    }  # fmt: skip


def worker(frames: int) -> dict[str, float]:
    """Scroll, regroup and fit one sequence: seconds, and peak bytes per pixel above what the process held before."""
    _scroll(*synthetic(128, 2, 1e-3), 140)  # imports and compiles
    base = _resident("VmRSS")
    started = time.perf_counter()
    beams, fit = synthetic()
    prepared = time.perf_counter() - started
    setup = _resident("VmHWM")
    give_back()  # as ``stream`` does before its first frame
    Path("/proc/self/clear_refs").write_text("5")  # the peak counts anew: preparing is told apart from streaming
    started = time.perf_counter()
    ground = _scroll(beams, fit, frames)
    seconds = time.perf_counter() - started
    peak = _resident("VmHWM")
    return {
        "frames": frames, "ground_rows": ground, "seconds": seconds, "prepare_seconds": prepared,
        "setup_bytes_per_pixel": 1024.0 * (setup - base) / SIZE**2,
        "bytes_per_pixel": 1024.0 * (peak - base) / SIZE**2,
    }  # fmt: skip


def _resident(name: str) -> int:
    """VmRSS or VmHWM (its peak) of this process, KiB; Linux only."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name))


def _scroll(beams: Beams, fit: Window, frames: int) -> int:
    moves = motion(frames)
    run = GroundFit(fit, moves)
    return sum(1 for frame in stream(beams, moves) for _ in run.add(frame))


def study(field: FringeField | None = None) -> dict[str, Any]:
    """All figures; with those of a real field, if one is given."""
    return {**stream_fraction(field), **memory_and_time(), **({} if field is None else real_memory(field))}


def main() -> None:
    """Print the figures, or one JSON document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--field", help="file of the NIR fringe field; traced if not given")
    parser.add_argument("--worker", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker is not None and options.field is not None:
        _scroll(*synthetic(128, 2, 1e-3), 140)  # imports and compiles
        load_instrument()
        import xarray  # noqa: F401  (reading the field imports it)

        base = _resident("VmRSS")
        found: dict[str, Any] = real_worker(options.worker, load_field(options.field), base)
    elif options.worker is not None:
        found = worker(options.worker)
    elif options.field is not None:
        found = study(load_field(options.field, {}))
    else:
        found = study(fringe_field("NIR").field)
    if options.json or options.worker is not None:
        print(json.dumps(found, indent=1))
        return
    for name, value in found.items():
        print(f"{name:32} {value}")


if __name__ == "__main__":
    main()
