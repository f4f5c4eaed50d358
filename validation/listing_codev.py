"""Single-ray listings of CODE V: reading one, and tracing its rays.

The figures of two listings stand in ``tests/data/codev_*.json``, with their source. A listing prints, for each field,
the chief ray, rays at the rim of the entrance pupil surface by surface, and between them where rays of 0.8, 0.6 and 0.4
of the pupil end beside the chief ray.
"""

from __future__ import annotations

import copy
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.lensfile.load import Imported, import_lens
from cgi_wave.optics.system import OpticalSystem, from_document, rotation
from cgi_wave.rays.paths import Path, make_path
from cgi_wave.rays.trace import compile_sequence, trace, trace_with_derivatives

Array = NDArray[np.float64]
MM = 1e-3
_NUMBER = re.compile(r"-?\d+\.\d+(?:E[+-]\d+)?")
#: Units in the last place of a row: X Y Z, TAN X TAN Y, RAY LENGTH, angles of incidence and refraction (deg).
ULP = np.array([1e-6] * 6 + [1e-2] * 2)
COLUMNS = ("x", "y", "z", "tan_x", "tan_y", "length", "incidence", "refraction")


def extract(text: str, radius: float) -> list[dict[str, Any]]:
    """Fields of a listing. radius: of the entrance pupil, mm.

    Each: ``tangent`` (2,), ``image`` (2,) of the chief ray, ``rays``: pupil (2,) in units of the radius with rows of
    ``COLUMNS``; ``fan``: pupil, DELTA X, DELTA Y, OPD.
    """
    fields: list[dict[str, Any]] = []
    ray: dict[str, Any] = {}
    chief = np.zeros(2)
    lines = text[text.index("ANA> go") :].splitlines()
    fan: list[list[list[float]]] = []
    for line in lines[1:]:
        values = [float(v) for v in _NUMBER.findall(line)]
        if line.startswith(" OBJ"):
            ray = {"tangent": values[3:], "rows": []}
            fan.append([])
        elif ray and re.match(r"\s+\d+ ", line) and len(values) == 8:
            ray["rows"].append(values)
            if len(ray["rows"]) == 1:
                if not fields or fields[-1]["tangent"] != ray["tangent"]:
                    fields.append({"tangent": ray["tangent"], "image": [0.0, 0.0], "rays": [], "fan": []})
                    chief = np.zeros(2) if ray["tangent"] == [0.0, 0.0] and values[0] == radius else _flat(ray)
                    fan = [[]]
                pupil = (_flat(ray) - chief) / radius
                fields[-1]["rays"].append({"pupil": [round(v, 5) + 0.0 for v in pupil], "rows": ray["rows"]})
        elif ray and len(values) == 5 and fields:
            if values[:2] == [0.0, 0.0]:
                fields[-1]["image"] = values[2:4]
            else:
                fields[-1]["fan"].append(values)
        if line.startswith("CODE V>") or "ANA> go" in line:
            break
    for field in fields:
        field["fan"] = list(_numbered(field))
    return fields


def _flat(ray: dict[str, Any]) -> Array:
    """Where a ray meets the plane through the first vertex (it has been carried to the surface)."""
    x, y, z, *_ = ray["rows"][0]
    return np.array([x, y]) - z * np.array(ray["tangent"])


def _numbered(field: dict[str, Any]) -> Iterator[list[float]]:
    """Lines of a fan with pupil coordinates: they follow the rim rays, outermost first, then inwards out."""
    rims = [np.array(ray["pupil"]) for ray in field["rays"] if np.any(ray["pupil"])]
    steps = {"in": [1.0, 0.8, 0.6, 0.4], "out": [0.4, 0.6, 0.8, 1.0]}
    lines = iter(field["fan"])
    for number, rim in enumerate(rims):
        opposed = number and np.dot(rim, rims[number - 1]) < 0
        for part in steps["out" if opposed else "in"]:
            line = next(lines, None)
            if line is None:
                return
            yield [*(part * rim).tolist(), *line[2:]]


@dataclass
class Lens:
    """An imported lens with the stop kept, and the coefficient of r⁴ (1/mm³) of one mirror that import leaves out."""

    imported: Imported
    system: OpticalSystem
    path: Path
    bent: tuple[str, float, float, float] | None = None


def load(file: File, asphere: tuple[str, float] | None = None) -> Lens:
    """Import a lens; asphere: surface and r⁴ coefficient (1/mm³), which the file must leave out."""
    imported = import_lens(file, keep_stop=True)
    system = imported.instrument.band("design")
    bent = None
    if asphere:
        surface = system.surfaces[system.number[asphere[0]]]
        bent = (asphere[0], surface.curvature * MM, surface.conic, asphere[1])
    return Lens(imported, system, make_path(system, imported.path.steps), bent)


def load_text(text: str, asphere: tuple[str, float] | None = None) -> Lens:
    """``load`` from the text of a CODE V file."""
    with tempfile.TemporaryDirectory() as folder:
        file = File(folder) / "lens.seq"
        file.write_text(text, encoding="utf-8")
        return load(file, asphere)


def facet(lens: Lens, x: float, y: float) -> OpticalSystem:
    """The lens with its asphere replaced by the tangent plane at (x, y) mm."""
    assert lens.bent is not None
    name, c, k, a = lens.bent
    r2 = x * x + y * y
    root = np.sqrt(1 - (1 + k) * c * c * r2)
    sag, slope = c * r2 / (1 + root) + a * r2 * r2, c / root + 4 * a * r2
    document = copy.deepcopy(lens.imported.document)
    frame = next(f for f in document["frame"] if f["surface"][0]["name"] == name)
    axes = rotation(tuple(frame["rotate_deg"]))
    normal = np.array([-slope * x, -slope * y, 1.0])
    normal /= np.linalg.norm(normal)
    turn = axes @ _facing(normal)
    frame["shift_mm"] = (np.array(frame["shift_mm"]) + axes @ np.array([x, y, sag])).tolist()
    frame["rotate_deg"] = _angles(turn)
    plane = {key: value for key, value in frame["surface"][0].items() if key not in ("shape", "radius_mm", "conic")}
    frame["surface"] = [plane | {"aperture": {"radius_mm": 1e-6}}]
    return from_document(document).band("design")


def _facing(normal: Array) -> Array:
    """A rotation whose third column is ``normal``."""
    x = np.cross([0.0, 1.0, 0.0], normal)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])


def _angles(axes: Array) -> list[float]:
    y = np.arcsin(axes[0, 2])
    return np.degrees([np.arctan2(-axes[1, 2], axes[2, 2]), y, np.arctan2(-axes[0, 1], axes[0, 0])]).tolist()


def follow(lens: Lens, point: Array, tangent: Array) -> dict[str, Any]:
    """One ray from (x, y) mm in the plane z = 0: rows of ``COLUMNS`` in the file's own axes, and its end.

    ``image`` (2,) mm, ``direction`` (3,) and ``opl`` mm from the plane wave's front through the origin.
    """
    direction = np.append(tangent, 1.0) / np.sqrt(1 + tangent @ tangent)
    if lens.bent is None:
        return _rows(lens, lens.system, point, direction)
    name = lens.bent[0]
    number = [step for step, _ in lens.path.steps].index(name)
    vertex = lens.system.surfaces[lens.system.number[name]]
    here, x, y = lens.system, 0.0, 0.0
    for _ in range(12):  # Newton: where the ray meets the tangent plane, the next one is laid
        sequence = compile_sequence(here, make_path(here, lens.path.steps), here.sigma0).upto(number + 1)
        foot = trace(sequence, *_launch(here, point, direction)).x[0]
        surface = here.surfaces[here.number[name]]
        local = np.array([*foot, surface.sag(foot[:1], foot[1:])[0]])
        was = x, y
        x, y, _ = vertex.rotation @ (surface.origin + local @ surface.rotation - vertex.origin) / MM
        here = facet(lens, x, y)
        if max(abs(was[0] - x), abs(was[1] - y)) < 1e-12:
            break
    return _rows(lens, here, point, direction)


def _launch(system: OpticalSystem, point: Array, direction: Array) -> tuple[Array, Array]:
    """Pupil point and direction of a ray through ``point`` mm of the plane z = 0."""
    axes, centre = system.pupil_frame()
    assert np.allclose(axes, np.eye(3))
    p = point * MM - centre[:2] + centre[2] * direction[:2] / direction[2]
    return p[None], direction[:2]


def _rows(lens: Lens, system: OpticalSystem, point: Array, direction: Array) -> dict[str, Any]:
    """A ray through ``system``, shown in the axes of the lens."""
    path = make_path(system, lens.path.steps)
    whole = compile_sequence(system, path, system.sigma0)
    p, theta = _launch(system, point, direction)
    traced = trace(whole, p, theta, footprints=True)
    assert traced.valid[0], "a listed ray does not get through"
    rows, before = [], direction
    previous = np.append(point, 0.0) * MM
    flipped = False  # the file's axes stay as they are when light turns round, those of the instrument follow it
    for k, (name, act) in enumerate(path.steps):
        surface, shown_in = system.surfaces[system.number[name]], lens.system.surfaces[lens.system.number[name]]
        foot = traced.foot[k, :, 0]
        local = np.array([*foot, surface.sag(foot[:1], foot[1:])[0]])
        world = surface.origin + local @ surface.rotation
        slope = np.array([local[0], local[1], (1 + surface.conic) * local[2]])
        normal = np.array([0.0, 0.0, 1.0]) - surface.curvature * slope
        normal = normal @ surface.rotation / np.linalg.norm(normal)
        q = trace(whole.upto(k + 1), p, theta).direction[0]
        n = np.sqrt(1 - q @ q)
        after = np.append(q, -n if act == "reflect" else n) @ surface.rotation
        sign = np.array([-1.0, 1.0, -1.0]) if flipped else np.ones(3)
        seen, shown = sign * (shown_in.rotation @ (world - shown_in.origin)), sign * (shown_in.rotation @ after)
        angles = np.degrees(np.arccos(np.clip(np.abs([before @ normal, after @ normal]), 0, 1)))
        length = np.linalg.norm(world - previous) / MM
        rows.append([*(seen / MM), shown[0] / shown[2], shown[1] / shown[2], length, *angles])
        previous, before = world, after
        flipped = flipped != (act == "reflect")
    image = system.surfaces[system.detector]
    end = traced.x[0] / MM
    q = image.rotation @ before
    opl = traced.opl[0] / MM + (p[0] / MM) @ theta
    return {"rows": np.array(rows), "image": end * np.array([-1.0 if flipped else 1.0, 1.0]), "end": end,
            "direction": q, "opl": opl}  # fmt: skip


def chief(lens: Lens, tangent: Array) -> Array:
    """Point (2,) mm of the plane z = 0 from which a ray of this direction goes through the stop's centre."""
    names = [name for name, _ in lens.path.steps]
    sequence = compile_sequence(lens.system, lens.path, lens.system.sigma0).upto(names.index(_stop(lens)) + 1)
    direction = np.append(tangent, 1.0) / np.sqrt(1 + tangent @ tangent)
    point = np.zeros(2)
    for _ in range(30):
        p, theta = _launch(lens.system, point, direction)
        ray = trace_with_derivatives(sequence, p, theta, "p")
        step = np.linalg.solve(ray.dx[0], ray.traced.x[0]) / MM
        point = point - step
        if np.abs(step).max() < 1e-12:
            break
    return point


def _stop(lens: Lens) -> str:
    """The plane with the same medium on both sides."""
    for name, _ in lens.path.steps:
        surface = lens.system.surfaces[lens.system.number[name]]
        if surface.nominal == "transmit" and lens.system.glasses[surface.before] == lens.system.glasses[surface.after]:
            return name
    raise ValueError("no stop")


def opd(lens: Lens, field: dict[str, Any], radius: float, tangent: Array) -> Array:
    """Wave aberration of the rays of a fan, in waves, by CODE V's sign: chief less ray (F,).

    About the end of the chief ray, on a sphere through the exit pupil, which is where chief rays of neighbouring fields
    cross. Which sphere a listing takes it does not print.
    """
    start = chief(lens, tangent)
    middle = follow(lens, start, tangent)
    along = across = 0.0
    for step in np.eye(2) * 1e-4:
        a, b = (follow(lens, chief(lens, tangent + s * step), tangent + s * step) for s in (1, -1))
        ends = a["end"] - b["end"]
        slopes = a["direction"][:2] / a["direction"][2] - b["direction"][:2] / b["direction"][2]
        along, across = along + ends @ slopes, across + slopes @ slopes
    sphere = along / across / middle["direction"][2]
    found = []
    for x, y, *_ in field["fan"]:
        ray = follow(lens, start + np.array([x, y]) * radius, tangent)
        end, d = np.append(ray["end"] - middle["end"], 0.0), ray["direction"]
        back = end @ d + np.sign(sphere) * np.sqrt(sphere**2 - end @ end + (end @ d) ** 2)
        found.append(((middle["opl"] - sphere) - (ray["opl"] - back)) * MM * lens.system.sigma0)
    return np.array(found)


def tangent_of(field: dict[str, Any]) -> Array:
    """Tangents of a field: its angles are round numbers of degrees, their printed tangents have six digits."""
    exact: Array = np.tan(np.radians(np.round(np.degrees(np.arctan(field["tangent"])), 3)))
    return exact
