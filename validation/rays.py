"""The tracer beside batoid: the same rays through two published lenses and all ghosts of one, and what both cost.

    uv run --group validation python -m validation.rays [--json] [--write]

Both get the same surfaces, indices and rays, along the nominal path and along ghosts, also with every surface tilted
and decentred. Prints, lens by lens and path by path, the largest difference of positions on the detector, of directions
and of path lengths; then rays times surfaces per second of both, taking turns, on one thread each; all two-reflection
ghosts of the double Gauss by a tree of paths beside batoid's ``traceSplit``; two threads beside one; and the memory
that ten million rays through the reference instrument take. Ratios move on a busy machine: the load average is printed,
and the processor time that two threads take over that of one, which does not depend on it.
``--write`` stores rays and batoid's answers in tests/data, where the tests find them.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path as File
from typing import Any

# Before batoid is imported: one thread is what is compared.
os.environ["OMP_NUM_THREADS"] = "1"

import batoid
import numpy as np
from numpy.typing import NDArray

from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.rays.paths import parse_path
from cgi_wave.rays.trace import Sequence, Traced, compile_sequence, trace
from cgi_wave.report.output import to_json
from validation import rays_ghosts, rays_memory

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


def lens(name: str, tilted: bool = False) -> OpticalSystem:
    """A lens of tests/data; tilted: every surface turned by up to 0.2° about each axis and decentred by 50 µm."""
    instrument = load_instrument(DATA / f"{name}.toml")
    if tilted:
        rng, values = np.random.default_rng(3), {}
        for surface in instrument.document.frame[0].surface:
            values[f"{surface.name}.tilt_deg"] = rng.uniform(-0.2, 0.2, 3).tolist()
            values[f"{surface.name}.decentre_mm"] = rng.uniform(-0.05, 0.05, 2).tolist()
        instrument = instrument.with_values(values)
    return instrument.band(instrument.bands[0])


def batoid_tracer(system: OpticalSystem, text: str) -> tuple[Callable[[Array, Array], Any], Callable[[Any], Any]]:
    """Two functions: batoid's rays for pupil points (N, 2; m) and direction cosines (2,), and their way along a path.

    The second changes the rays in place and returns them in the detector's frame. Surfaces, poses and media are made
    beforehand, so that the time of a call is that of tracing.
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

    def launch(p: Array, theta: Array) -> Any:
        d = np.array([*theta, np.sqrt(1.0 - theta @ theta)])
        start = (np.column_stack([p, np.zeros(len(p))]) - back * d) @ axes + centre
        velocity = np.tile(d @ axes / first, (len(p), 1))
        return batoid.RayVector(*start.T.copy(), *velocity.T.copy(), t=-back * first, wavelength=1.0 / system.sigma0)

    def run(rays: Any) -> Any:
        for shape, act, media, pose in steps:
            getattr(shape, act)(rays, *media, coordSys=pose)
        return rays

    return launch, run


def as_traced(rays: Any) -> tuple[Array, Array, Array]:
    """Points (N, 2) m, direction cosines (N, 2) and path lengths (N,) m of batoid's rays."""
    velocity = np.column_stack([rays.vx, rays.vy, rays.vz])
    direction = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    return np.column_stack([rays.x, rays.y]), direction[:, :2], np.asarray(rays.t)


def compare(name: str, count: int, tilted: bool = False) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Per path and field of one lens: the largest differences, and the rays with batoid's answers."""
    system = lens(name, tilted)
    figures, cases = [], []
    for text, radius in LENSES[name]:
        sequence = compile_sequence(system, parse_path(system, text), system.sigma0)
        launch, run = batoid_tracer(system, text)
        for field in FIELDS:
            p, theta = pupil_points(radius, count), np.array(field)
            own: Traced = trace(sequence, p, theta)
            x, direction, opl = as_traced(run(launch(p, theta)))
            ok = own.status == 0
            figures.append({
                "lens": f"{name}{', tilted' if tilted else ''}", "path": text, "theta": list(field),
                "rays": int(ok.sum()), "lost": int((~ok).sum()),
                "x_m": float(np.abs(own.x - x)[ok].max()),
                "direction": float(np.abs(own.direction - direction)[ok].max()),
                "opl_m": float(np.abs(own.opl - opl)[ok].max()),
            })  # fmt: skip
            few = np.flatnonzero(ok)[:12]
            cases.append({"path": text, "theta": list(field), "p_m": p[few].tolist(), "x_m": x[few].tolist(),
                          "direction": direction[few].tolist(), "opl_m": opl[few].tolist()})  # fmt: skip
    return figures, cases


#: What is timed, and what is made for it outside the clock.
Timed = tuple[Callable[[], Any], Callable[[Any], object]]


def nothing() -> None:
    """Preparation for what needs none."""


def run_times(timed: tuple[Timed, ...], repeats: int = 9, seconds: float = 0.0) -> list[list[float]]:
    """Times of several runs of each function, s, at least ``repeats`` of them and ``seconds`` in all.

    They take turns, so that a busy machine slows all of them.
    """
    times: list[list[float]] = [[] for _ in timed]
    begun = time.perf_counter()
    while len(times[0]) < repeats or time.perf_counter() - begun < seconds:
        for k, (prepare, function) in enumerate(timed):
            made = prepare()
            start = time.perf_counter()
            function(made)
            times[k].append(time.perf_counter() - start)
    return times


def best_times(timed: tuple[Timed, ...], repeats: int = 9) -> list[float]:
    """Shortest of several runs of each function, s, taking turns."""
    return [min(times) for times in run_times(timed, repeats)]


def speed(name: str, tilted: bool, count: int) -> dict[str, Any]:
    """Rays times surfaces per second of both in one run, one thread each, and of ours on two.

    Ours launches the rays and allocates the results within the clock; batoid's rays are made before it starts.
    """
    system = lens(name, tilted)
    text, radius = LENSES[name][0]
    sequence: Sequence = compile_sequence(system, parse_path(system, text), system.sigma0)
    (launch, run), p, theta = batoid_tracer(system, text), pupil_points(radius, count), np.array([0.0, 0.03])
    trace(sequence, p[:10], theta)  # compiled before the clock starts
    work = count * len(sequence.names)

    def processor_time(threads: int) -> float:
        best = float("inf")
        for _ in range(5):
            start = time.process_time()
            trace(sequence, p, theta, threads=threads)
            best = min(best, time.process_time() - start)
        return best

    one: Timed = (nothing, lambda _: trace(sequence, p, theta))
    own, other = (work / t for t in best_times((one, (lambda: launch(p, theta), run))))
    # By themselves and often: two threads need a moment in which no other program is on either processor.
    two: Timed = (nothing, lambda _: trace(sequence, p, theta, threads=2))
    on_one, on_two = run_times((one, two), repeats=40, seconds=6.0)
    return {"lens": name, "tilted": tilted, "rays": count, "surfaces": len(sequence.names), "ray_surfaces_per_s": own,
            "batoid_ray_surfaces_per_s": other, "ratio": own / other, "two_threads": min(on_one) / min(on_two),
            "two_threads_median": float(np.median(on_one) / np.median(on_two)), "two_threads_runs": len(on_two),
            "two_threads_processor_time": processor_time(2) / processor_time(1)}  # fmt: skip


def ghosts(count: int = 100_000) -> dict[str, Any]:
    """All two-reflection ghosts of the double Gauss: what differs, and what both took."""
    figures, _ = rays_ghosts.compare(count)
    own, launch, split = rays_ghosts.functions(count)
    times = best_times(((nothing, lambda _: own()), (launch, split)), repeats=3)
    return figures | {"seconds": times[0], "batoid_seconds": times[1], "ratio": times[1] / times[0]}


def study(count: int = 2000) -> tuple[dict[str, Any], dict[str, list[dict[str, Any]]]]:
    """Everything as plain data, and the rays to store per lens."""
    figures, stored = [], {}
    load = [os.getloadavg()[0]]
    for name in LENSES:
        some, stored[name] = compare(name, count)
        figures += some + compare(name, count, tilted=True)[0]
    worst = {key: max(figure[key] for figure in figures) for key in ("x_m", "direction", "opl_m")}
    speeds = [speed(name, tilted, 100_000) for name in LENSES for tilted in (False, True)]
    speeds.append(speed("double_gauss", True, 1_000_000))
    wanted = [line for line in speeds if line["lens"] == "double_gauss" and line["tilted"]]
    split, memory = ghosts(), rays_memory.measure()
    load.append(os.getloadavg()[0])
    return {
        "peer": f"batoid {batoid.__version__}",
        "worst": worst,
        "speedup_trace": min(line["ratio"] for line in wanted),
        # The smaller of both fans'; of meaning where two processors are idle only.
        "thread_scaling": min(line["two_threads"] for line in wanted),
        "thread_scaling_by_rays": {str(line["rays"]): line["two_threads"] for line in wanted},
        "speedup_ghosts": split["ratio"],
        "memory_bytes_1e7_rays": memory["bytes"],
        "load_average": load,
        "processors": os.cpu_count(),
        "cases": figures,
        "speed": speeds,
        "ghosts": split,
        "memory": memory,
    }, stored


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
        rays_ghosts.store(DATA / "batoid_ghosts.json")
    if arguments.json:
        print(to_json(result))
        return
    print(f"beside {result['peer']}: largest differences")
    for case in result["cases"]:
        what = f"  {case['lens']:14s} {case['path']:52s} {case['theta']!s:16s} {case['rays']} rays, {case['lost']} lost"
        print(f"{what}  x {case['x_m']:.1e} m  direction {case['direction']:.1e}  path {case['opl_m']:.1e} m")
    load = " to ".join(f"{value:.1f}" for value in result["load_average"])
    print(f"speed, load average {load} on {result['processors']} processors")
    for line in result["speed"]:
        print(f"  {line['lens']:14s} {'tilted' if line['tilted'] else '      '} {line['rays']:7d} rays: "
              f"{line['ray_surfaces_per_s'] / 1e6:.0f} M ray surfaces/s, batoid "
              f"{line['batoid_ray_surfaces_per_s'] / 1e6:.0f} M, ratio {line['ratio']:.1f}, "
              f"two threads {line['two_threads']:.2f} times one, in "
              f"medians of {line['two_threads_runs']} runs {line['two_threads_median']:.2f} "
              f"({line['two_threads_processor_time']:.2f} of its processor time)")  # fmt: skip
    g, m = result["ghosts"], result["memory"]
    print(f"{g['paths']} paths of the double Gauss, {g['rays']} rays: {g['seconds']:.3f} s, batoid "
          f"{g['batoid_seconds']:.2f} s, ratio {g['ratio']:.1f}")  # fmt: skip
    print(f"  {g['in_both']} alive in both ({g['alive']}, batoid {g['alive_batoid']}), survivors differ on "
          f"{g['survivors_differ']}; largest differences: power {g['power_relative']:.1e}, centroid "
          f"{g['centroid_m']:.1e} m, path {g['length_m']:.1e} m")  # fmt: skip
    print(f"{m['rays']} rays on {len(m['paths'])} paths of band {m['band']} ({m['surfaces_met']} surfaces): "
          f"{m['seconds']:.1f} s, {m['bytes'] / 2**20:.0f} MiB ({m['bytes_before'] / 2**20:.0f} before)")  # fmt: skip


if __name__ == "__main__":
    main()
