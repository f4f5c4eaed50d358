"""Every ghost of every band traced backwards, its étendue, and the light of a plate stack that adds up.

    uv run python -m validation.reversal [BAND…] [--instrument FILE] [--json]

* **Reversal.** An instrument is made whose entrance pupil is the detector and whose detector is the entrance pupil; the
  steps of each ghost are taken in reverse by the same public path and tracing functions. Rays must end where they
  began, with the same path length and power.
* **Étendue.** The map from pupil point and direction to detector point and direction conserves the symplectic form
  dx∧dq (index 1 at both ends) along each ghost.
* **Energy.** All branches between the faces of a stack of lossless plates, traced one by one: what comes out on both
  sides, and what branches hold that are not followed further, adds up to what went in.

The same for random small instruments. Prints the worst figure of each.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.select import select_ghosts
from cgi_wave.budget.setting import band_setting
from cgi_wave.errors import EmptyBeamError
from cgi_wave.optics.system import OpticalSystem, from_document, load_instrument
from cgi_wave.rays.beams import nominal_direction, rays_to_point
from cgi_wave.rays.paths import Path, find_paths, make_path
from cgi_wave.rays.trace import aim_and_trace, compile_sequence, trace, trace_with_derivatives
from cgi_wave.report.output import to_json

Array = NDArray[np.float64]
#: Name of the plane that stands for the entrance pupil in a reversed instrument.
PUPIL = "entrance_pupil_plane"
TURNED = np.diag([-1.0, 1.0, -1.0])
MM = 1e-3
#: Rays of each ghost.
RAYS = 40
#: The symplectic form in the order x, y, qx, qy.
FORM = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-1, 0, 0, 0], [0, -1, 0, 0]], dtype=float)


def angles(axes: Array) -> list[float]:
    """Angles (deg) about x, the new y, the new z that make ``axes`` (3, 3; columns)."""
    y = np.arctan2(axes[0, 2], np.hypot(axes[0, 0], axes[0, 1]))
    x, z = np.arctan2(-axes[1, 2], axes[2, 2]), np.arctan2(-axes[0, 1], axes[0, 0])
    return [float(np.degrees(angle)) for angle in (x, y, z)]


def reversed_system(system: OpticalSystem) -> OpticalSystem:
    """The instrument of one band with light sent in at the detector and recorded in the plane of the entrance pupil."""
    document = msgspec.to_builtins(system.document)
    band = document["band"][system.band] | {"set": {}, "zone_rows": [0, 10], "zone_columns": None}
    band.pop("channel", None)
    document.pop("channel", None)
    # Splitters of other channels split nothing here.
    own = system.document.interferometer
    for surface in (surface for frame in document["frame"] for surface in frame["surface"]):
        if surface["nominal"] == "both" and (own is None or surface["name"] != own.splitter):
            surface["nominal"] = "transmit"
    detector = system.surfaces[system.detector]
    axes, centre = system.pupil_frame()
    plane = {"name": PUPIL, "after": "", "nominal": "absorb", "aperture": {"half_width_mm": [1e4, 1e4]}}
    document |= {
        "band": {system.band: band},
        "entrance": document["entrance"] | {
            "space": system.spaces[detector.before], "at_mm": (detector.origin / MM).tolist(),
            "rotate_deg": angles(detector.rotation.T @ TURNED), "back_off_mm": 0.0,
        },
        "detector": {"surface": PUPIL, "pixel_um": 10.0, "columns": 10, "rows": 10},
        "frame": [*document["frame"], {
            "name": "reversed", "before": document["entrance"]["space"], "shift_mm": (centre / MM).tolist(),
            "rotate_deg": angles(axes.T @ TURNED), "surface": [plane],
        }],
    }  # fmt: skip
    return from_document(document, system.file).band(system.band)


def beam(system: OpticalSystem, path: Path, x0: Array) -> tuple[Array, Array]:
    """Pupil points and directions (N, 2) of rays of a ghost that reach a detector point inside all apertures."""
    theta = nominal_direction(system, find_nominal(system)[0], x0)
    sequence = compile_sequence(system, path, system.sigma0)
    rays = rays_to_point(system, path, x0, np.array([system.sigma0]), theta)
    lit = np.flatnonzero((rays.clearance[:, 0] > 0).all(axis=0))
    if not len(lit):
        raise EmptyBeamError(f"{path.label}: no ray passes")
    p = rays.pupil[0, lit[:: max(1, len(lit) // RAYS)]]
    aimed = aim_and_trace(sequence, p, x0, theta)
    ok = aimed.ok & aimed.traced.passes
    if not ok.any():
        raise EmptyBeamError(f"{path.label}: no ray passes")
    return p[ok], aimed.theta[ok]


@lru_cache(maxsize=8)
def find_nominal(system: OpticalSystem) -> tuple[Path, ...]:
    """Nominal paths, searched once per system."""
    return find_paths(system, max_order=0, max_splits=0)


def there_and_back(system: OpticalSystem, back: OpticalSystem, path: Path, p: Array, theta: Array) -> dict[str, float]:
    """Largest differences of rays sent along a path and back."""
    sequence = compile_sequence(system, path, system.sigma0)
    there = trace(sequence, p, theta)
    turned = make_path(back, path.steps[::-1])
    # In the turned frames x changes sign with z; the direction of travel changes too.
    mirror = np.array([-1.0, 1.0])
    here = trace(compile_sequence(back, turned, system.sigma0), there.x * mirror, -there.direction * mirror)
    ok = there.passes & here.valid
    return {
        "rays": float(ok.sum()),
        "lost": float((there.passes & ~here.valid).sum()),
        "position_m": float(np.abs(here.x * mirror - p)[ok].max()),
        "direction": float(np.abs(-here.direction * mirror - theta)[ok].max()),
        "opl_m": float(np.abs(here.opl - there.opl)[ok].max()),
        "power": float(np.abs(here.power / there.power - 1)[ok].max()),
        "etendue": _symplectic(sequence, p[ok], theta[ok]),
        "length_m": float(there.opl.max()),
    }


def _symplectic(sequence: Any, p: Array, theta: Array) -> float:
    """Largest part by which the map from (p, θ) to (x, q) misses the symplectic condition, of its largest entry²."""
    found = trace_with_derivatives(sequence, p, theta, "both")
    jacobian = np.concatenate([found.dx, found.dq], axis=1)
    jacobian = np.concatenate([jacobian[:, :, 2:], jacobian[:, :, :2]], axis=2)  # inputs p, then θ
    # Lengths in units in which both blocks are of like size: the condition itself has no unit.
    scale = np.sqrt(np.abs(jacobian[:, :2, 2:]).max() / max(np.abs(jacobian[:, 2:, :2]).max(), 1e-300))
    unit = np.diag([1 / np.sqrt(scale)] * 2 + [np.sqrt(scale)] * 2)
    jacobian = unit @ jacobian @ np.linalg.inv(unit)
    miss = jacobian.transpose(0, 2, 1) @ FORM @ jacobian - FORM
    return float((np.abs(miss).max(axis=(1, 2)) / (jacobian**2).max(axis=(1, 2))).max())


def band(name: str, file: str | None) -> dict[str, Any]:
    """All ghosts of a band that the analysis traces, each at the first field point that it reaches."""
    system = load_instrument(file).band(name)
    back = reversed_system(system)
    ghosts = select_ghosts(band_setting(system), find_paths(system))
    rows, unreached = [], []
    for path in ghosts:
        for x0 in system.field_points():
            try:
                p, theta = beam(system, path, x0)
            except EmptyBeamError:
                continue
            rows.append({"label": path.label, **there_and_back(system, back, path, p, theta)})
            break
        else:
            unreached.append(path.label)
    return {"band": name, "paths": len(ghosts), "compared": len(rows), "unreached": unreached, **_worst(rows)}


def _worst(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The largest of each figure and whose it is."""
    found: dict[str, Any] = {"lost": sum(row["lost"] for row in rows), "rays": sum(row["rays"] for row in rows)}
    for key in ("position_m", "direction", "opl_m", "power", "etendue"):
        worst = max(rows, key=lambda row: row[key])
        found[key] = worst[key]
        found[f"{key}_of"] = worst["label"]
    return found


def random_lens(seed: int) -> OpticalSystem:
    """Four tilted, decentred conic faces of random glasses with bare faces, then a detector."""
    r = np.random.default_rng(seed)
    spaces = {"front": "air", "g1": "n1", "gap": "air", "g2": "n2", "back": "air"}
    faces = []
    for k, after in enumerate(("g1", "gap", "g2", "back")):
        faces.append({
            "name": f"F{k}", "after": after, "shape": "conic", "conic": float(r.uniform(-1.5, 0.5)), "coating": "bare",
            "radius_mm": float(r.choice([-1, 1]) * r.uniform(60, 200)), "aperture": {"radius_mm": 8.0},
            "thickness_mm": float(r.uniform(4, 9)) if k < 3 else 60.0, "tilt_deg": r.uniform(-2, 2, 3).tolist(),
            "decentre_mm": r.uniform(-0.3, 0.3, 2).tolist(),
        })  # fmt: skip
    faces.append({"name": "image", "after": "", "nominal": "absorb", "aperture": {"half_width_mm": [500.0, 500.0]}})
    document = {
        "name": f"random {seed}", "glass": {"n1": float(r.uniform(1.45, 1.9)), "n2": float(r.uniform(1.45, 1.9))},
        "space": spaces, "coating": {"none": {}, "bare": {"bare": True}},
        "entrance": {"space": "front", "radius_mm": 2.0, "back_off_mm": 20.0},
        "detector": {"surface": "image", "pixel_um": 10.0, "columns": 100, "rows": 100},
        "frame": [{"name": "lens", "before": "front", "start_mm": 5.0, "surface": faces}],
        "band": {"B": {"zone_rows": [0, 100], "wavelengths_nm": [600.0], "filter": {"centre_nm": 600.0, "fwhm_nm": 1.0},
                       "spectrum": {"kind": "solar"}, "target_opd_mm": 0.0}},
    }  # fmt: skip
    return from_document(document).band("B")


def random_instruments(count: int) -> dict[str, Any]:
    """All ghosts of random lenses, there and back."""
    rows = []
    r = np.random.default_rng(11)
    for seed in range(count):
        system = random_lens(seed)
        back = reversed_system(system)
        for path in find_paths(system, min_power=1e-12):
            p = r.uniform(-1.4e-3, 1.4e-3, (RAYS, 2))
            theta = np.tile(r.uniform(-0.01, 0.01, 2), (RAYS, 1))
            passes = trace(compile_sequence(system, path, system.sigma0), p, theta).passes
            if passes.any():
                row = there_and_back(system, back, path, p[passes], theta[passes])
                rows.append({"label": f"lens {seed}: {path.label}", **row})
    return {"lenses": count, "paths": len(rows), **_worst(rows)}


def energy(order: int = 8) -> dict[str, Any]:
    """Branches of light between two plates of bare faces at oblique incidence, added up on both sides.

    Followed to ``order`` reflections; ``cut`` is what the first reflection beyond would carry on.
    """
    frames = [{
        "name": "plates", "before": "front", "start_mm": 5.0, "surface": [
            {"name": name, "after": after, "thickness_mm": 3.0, "coating": "bare", "aperture": {"radius_mm": 200.0}}
            for name, after in (("A", "g1"), ("B", "gap"), ("C", "g2"), ("D", "back"))
        ],
    }]  # fmt: skip
    wide = {"half_width_mm": [500.0, 500.0]}
    frames[0]["surface"].append({"name": "forward", "after": "", "nominal": "absorb", "aperture": wide})  # type: ignore[attr-defined]
    frames.append({"name": "behind", "before": "front", "shift_mm": [0.0, 0.0, -30.0], "rotate_deg": [180.0, 0.0, 0.0],
                   "surface": [{"name": "backward", "after": "", "nominal": "absorb", "aperture": wide}]})  # fmt: skip
    document = {
        "name": "plates", "glass": {"n1": 1.5, "n2": 1.8},
        "space": {"front": "air", "g1": "n1", "gap": "air", "g2": "n2", "back": "air"},
        "coating": {"none": {}, "bare": {"bare": True}},
        "entrance": {"space": "front", "radius_mm": 0.5, "back_off_mm": 0.0},
        "detector": {"surface": "forward", "pixel_um": 10.0, "columns": 100, "rows": 100}, "frame": frames,
        "band": {"B": {"zone_rows": [0, 100], "wavelengths_nm": [600.0], "filter": {"centre_nm": 600.0, "fwhm_nm": 1.0},
                       "spectrum": {"kind": "solar"}, "target_opd_mm": 0.0}},
    }  # fmt: skip
    names = ["A", "B", "C", "D"]
    system = from_document(document).band("B")
    other = from_document(document | {"detector": document["detector"] | {"surface": "backward"}}).band("B")  # type: ignore[operator]
    theta, p = np.array([0.3, 0.1]), np.zeros((1, 2))
    out, cut, count = 0.0, 0.0, 0
    # Face about to be met, direction, steps so far, reflections so far.
    stack: list[tuple[int, int, tuple[tuple[str, str], ...], int]] = [(0, 1, (), 0)]
    while stack:
        face, way, steps, bounced = stack.pop()
        if face in (-1, 4):
            ends = system if face == 4 else other
            traced = trace(compile_sequence(ends, make_path(ends, steps), ends.sigma0), p, theta)  # type: ignore[arg-type]
            out += float(traced.power[0])
            count += 1
            continue
        stack.append((face + way, way, (*steps, (names[face], "transmit")), bounced))
        back = (*steps, (names[face], "reflect"))
        if bounced < order:
            stack.append((face - way, -way, back, bounced + 1))
            continue
        ends, rest = (other, names[:face][::-1]) if way == 1 else (system, names[face + 1 :])
        whole = make_path(ends, (*back, *((name, "transmit") for name in rest)))  # type: ignore[arg-type]
        cut += float(trace(compile_sequence(ends, whole, ends.sigma0).upto(len(back)), p, theta).power[0])
    return {"branches": count, "order": order, "out": out, "cut": cut, "missing": 1 - out - cut}


def study(bands: Sequence[str] = (), file: str | None = None, lenses: int = 12) -> dict[str, Any]:
    """Everything as plain data."""
    instrument = load_instrument(file)
    return {
        "instrument": instrument.name,
        "bands": [band(name, file) for name in bands or instrument.bands],
        "random": random_instruments(lenses),
        "energy": energy(),
    }


def main() -> None:
    """Print the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bands", nargs="*", metavar="BAND")
    parser.add_argument("--instrument", metavar="FILE")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    arguments = parser.parse_args()
    result = study(arguments.bands, arguments.instrument)
    if arguments.json:
        print(to_json(result))
        return
    for part in [*result["bands"], result["random"] | {"band": f"{result['random']['lenses']} random lenses"}]:
        print(f"{part['band']}: {part['paths']} paths, {part['rays']:.0f} rays there and back, {part['lost']:.0f} lost")
        for key, unit in (("position_m", " m"), ("direction", ""), ("opl_m", " m"), ("power", ""), ("etendue", "")):
            print(f"  {key.removesuffix('_m'):10s} {part[key]:.1e}{unit}  ({part[key + '_of']})")
    light = result["energy"]
    print(f"energy: {light['branches']} branches of two plates, {light['cut']:.1e} not followed, "
          f"missing {light['missing']:.1e}")  # fmt: skip


if __name__ == "__main__":
    main()
