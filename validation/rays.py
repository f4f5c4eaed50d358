"""The tracer beside batoid: the same rays through two published lenses, and what both cost.

    uv run --group validation python validation/rays.py [--json] [--write]

Both get the same surfaces, indices and rays, along the nominal path and along ghosts. Prints, lens by lens and path by
path, the largest difference of positions on the detector, of directions and of path lengths, then rays times surfaces
per second of both on one thread (batoid's default while OMP_NUM_THREADS is not set). ``--write`` stores rays and
batoid's answers in tests/data, where the tests find them.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path as File
from typing import Any

import batoid
import numpy as np
from numpy.typing import NDArray

from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.rays.paths import parse_path
from cgi_wave.rays.trace import Sequence, Traced, compile_sequence, trace

Array = NDArray[np.float64]
DATA = File(__file__).parents[1] / "tests" / "data"

#: Per lens: paths, each with the radius of the pupil (m) over which its rays get through.
LENSES = {
    "cooke_triplet": [
        ("S1 S2 S3 S4 S5 S6", 5e-3),
        ("S1 S2:r S1:r S2 S3 S4 S5 S6", 1.5e-3),
        ("S1 S2 S3 S4:r S3 S2:r S3 S4 S5 S6", 1e-3),
    ],
    "double_gauss": [
        ("S1 S2 S3 S4 S5 stop S7 S8 S9 S10 S11", 10e-3),
        ("S1 S2 S3 S4 S5 stop S7 S8 S9 S10 S11:r S10:r S11", 4e-3),
    ],
}
FIELDS = ((0.0, 0.0), (0.01, -0.03), (0.0, 0.1))


def pupil_points(radius: float, count: int) -> Array:
    """Random points (count, 2) in a disc of ``radius`` m; the same ones every time."""
    r, angle = np.random.default_rng(7).random((2, count))
    return radius * np.sqrt(r)[:, None] * np.stack([np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)], axis=1)


def batoid_tracer(system: OpticalSystem, text: str) -> Callable[[Array, Array], Any]:
    """A function of pupil points (N, 2; m) and direction cosines (2,) that traces them with batoid along a path.

    Returns batoid's rays in the detector's frame. Surfaces, poses and media are made beforehand, so that the time of a
    call is that of tracing.
    """
    index = system.index(system.sigma0)
    axes, centre = system.pupil_frame()
    back = system.document.entrance.back_off_mm * 1e-3
    space = system.spaces.index(system.document.entrance.space)
    first = float(index[space])
    steps = []
    for name, act in [*parse_path(system, text).steps, (system.document.detector.surface, "absorb")]:
        surface = system.surfaces[system.number[name]]
        shape = batoid.Sphere(1.0 / surface.curvature) if surface.curvature else batoid.Plane()
        pose = batoid.CoordSys(surface.origin, surface.rotation.T.copy())
        other = surface.after if space == surface.before else surface.before
        media = (batoid.ConstMedium(index[space]), batoid.ConstMedium(index[other])) if act == "transmit" else ()
        steps.append((shape, {"transmit": "refract", "reflect": "reflect", "absorb": "intersect"}[act], media, pose))
        space = other if act == "transmit" else space

    def run(p: Array, theta: Array) -> Any:
        d = np.array([*theta, np.sqrt(1.0 - theta @ theta)])
        start = (np.column_stack([p, np.zeros(len(p))]) - back * d) @ axes + centre
        velocity = np.tile(d @ axes / first, (len(p), 1))
        rays = batoid.RayVector(*start.T.copy(), *velocity.T.copy(), t=-back * first, wavelength=1.0 / system.sigma0)
        for shape, act, media, pose in steps:
            getattr(shape, act)(rays, *media, coordSys=pose)
        return rays

    return run


def as_traced(rays: Any) -> tuple[Array, Array, Array]:
    """Points (N, 2) m, direction cosines (N, 2) and path lengths (N,) m of batoid's rays."""
    velocity = np.column_stack([rays.vx, rays.vy, rays.vz])
    direction = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    return np.column_stack([rays.x, rays.y]), direction[:, :2], np.asarray(rays.t)


def compare(name: str, count: int) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Per path and field of one lens: the largest differences, and the rays with batoid's answers."""
    instrument = load_instrument(DATA / f"{name}.toml")
    system = instrument.band(instrument.bands[0])
    figures, cases = [], []
    for text, radius in LENSES[name]:
        sequence, peer = compile_sequence(system, parse_path(system, text), system.sigma0), batoid_tracer(system, text)
        for field in FIELDS:
            p, theta = pupil_points(radius, count), np.array(field)
            own: Traced = trace(sequence, p, theta)
            x, direction, opl = as_traced(peer(p, theta))
            ok = own.status % 4 == 0
            figures.append({
                "lens": name, "path": text, "theta": list(field), "rays": int(ok.sum()), "lost": int((~ok).sum()),
                "x_m": float(np.abs(own.x - x)[ok].max()),
                "direction": float(np.abs(own.direction - direction)[ok].max()),
                "opl_m": float(np.abs(own.opl - opl)[ok].max()),
            })  # fmt: skip
            few = np.flatnonzero(ok)[:12]
            cases.append({"path": text, "theta": list(field), "p_m": p[few].tolist(), "x_m": x[few].tolist(),
                          "direction": direction[few].tolist(), "opl_m": opl[few].tolist()})  # fmt: skip
    return figures, cases


def best_times(functions: tuple[Callable[[], object], ...], repeats: int = 9) -> list[float]:
    """Shortest of several runs of each function, s; they take turns, so that a busy machine slows all of them."""
    best = [float("inf")] * len(functions)
    for _ in range(repeats):
        for k, function in enumerate(functions):
            start = time.perf_counter()
            function()
            best[k] = min(best[k], time.perf_counter() - start)
    return best


def speed(name: str, count: int = 100_000) -> dict[str, Any]:
    """Rays times surfaces per second of both, one thread each, in one run."""
    instrument = load_instrument(DATA / f"{name}.toml")
    system = instrument.band(instrument.bands[0])
    text, radius = LENSES[name][0]
    sequence: Sequence = compile_sequence(system, parse_path(system, text), system.sigma0)
    peer, p, theta = batoid_tracer(system, text), pupil_points(radius, count), np.array([0.0, 0.03])
    trace(sequence, p[:10], theta)  # compiled before the clock starts
    work = count * len(sequence.names)
    own, other = (work / t for t in best_times((lambda: trace(sequence, p, theta), lambda: peer(p, theta))))
    return {"lens": name, "rays": count, "surfaces": len(sequence.names), "ray_surfaces_per_s": own,
            "batoid_ray_surfaces_per_s": other, "ratio": own / other}  # fmt: skip


def study(count: int = 2000) -> tuple[dict[str, Any], dict[str, list[dict[str, Any]]]]:
    """Everything as plain data, and the rays to store per lens."""
    figures, stored = [], {}
    for name in LENSES:
        some, stored[name] = compare(name, count)
        figures += some
    worst = {key: max(figure[key] for figure in figures) for key in ("x_m", "direction", "opl_m")}
    result = {
        "peer": f"batoid {batoid.__version__}",
        "worst": worst,
        "cases": figures,
        "speed": [speed(name) for name in LENSES],
    }
    return result, stored


def main() -> None:
    """Print the study; store the rays if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.add_argument("--write", action="store_true", help="store rays and batoid's answers in tests/data")
    arguments = parser.parse_args()
    result, stored = study()
    if arguments.write:
        for name, cases in stored.items():
            document = {"source": f"batoid {batoid.__version__}, by validation/rays.py --write", "cases": cases}
            (DATA / f"batoid_{name}.json").write_text(json.dumps(document) + "\n", encoding="utf-8")
    if arguments.json:
        print(json.dumps(result, indent=2))
        return
    print(f"beside {result['peer']}: largest differences")
    for case in result["cases"]:
        what = f"  {case['lens']:14s} {case['path']:52s} {case['theta']!s:16s} {case['rays']} rays, {case['lost']} lost"
        print(f"{what}  x {case['x_m']:.1e} m  direction {case['direction']:.1e}  path {case['opl_m']:.1e} m")
    for line in result["speed"]:
        print(f"  {line['lens']:14s} {line['rays']} rays: {line['ray_surfaces_per_s'] / 1e6:.0f} M ray surfaces/s, "
              f"batoid {line['batoid_ray_surfaces_per_s'] / 1e6:.0f} M, ratio {line['ratio']:.1f}")  # fmt: skip


if __name__ == "__main__":
    main()
