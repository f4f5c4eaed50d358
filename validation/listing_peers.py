"""Other tracers beside ours: optiland's sequences along ghosts, optiland and rayoptics on imported lens files.

Neither peer is among the project's dependencies (one brings a visualisation toolkit, the other a GUI); run with
``uv run --group validation --with optiland --with rayoptics``. What is not installed is skipped, and said so.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import io
import tempfile
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.lensfile.load import Imported
from cgi_wave.lensfile.zmx import read as read_zmx
from cgi_wave.lensfile.zmx import read_text
from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.rays.paths import Path, find_paths, make_path
from cgi_wave.rays.trace import compile_sequence, trace

Array = NDArray[np.float64]
DATA = File(__file__).parents[1] / "tests" / "data"
MM = 1e-3
#: Pupil radius (m) and direction cosines of the bundle that is followed along each ghost.
BUNDLES = {"double_gauss": (8e-3, (0.01, -0.03)), "cooke_triplet": (4e-3, (0.01, -0.02))}


def installed(name: str) -> str | None:
    """Version of a peer, None if it is not installed."""
    try:
        importlib.import_module(name)
        return importlib.metadata.version(name)
    except ImportError:
        return None


def optiland_model(system: OpticalSystem) -> Any:
    """An optiland model of a lens whose surfaces stand along z, in millimetres."""
    from optiland.coatings import SimpleCoating
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic
    from optiland.physical_apertures import RadialAperture, RectangularAperture

    index = system.index(system.sigma0)
    optic = Optic()
    optic.surfaces.add(index=0, thickness=np.inf)
    for k, surface in enumerate(system.surfaces):
        last = k == len(system.surfaces) - 1
        gap = 0.0 if last else float(system.surfaces[k + 1].origin[2] - surface.origin[2]) / MM
        wide, high = surface.aperture[1] / MM, surface.aperture[2] / MM
        if surface.aperture[0] == 1:
            aperture: Any = RadialAperture(r_max=wide)
        else:
            aperture = RectangularAperture(-wide, wide, -high, high)
        coating = SimpleCoating(surface.coating.transmittance, surface.coating.reflectance)
        optic.surfaces.add(
            index=k + 1, radius=1.0 / surface.curvature / MM if surface.curvature else np.inf, conic=surface.conic,
            thickness=gap, is_stop=k == 0, aperture=aperture, coating=None if last else coating,
            material=IdealMaterial(float(index[surface.after]) if surface.after >= 0 else 1.0),
        )  # fmt: skip
    optic.set_aperture("EPD", 2 * system.pupil_radius / MM)
    optic.set_field_type("angle")
    optic.add_field(y=0)
    optic.add_wavelength(1e6 / system.sigma0, is_primary=True)
    return optic


def optiland_rays(system: OpticalSystem, p: Array, theta: Array) -> Any:
    """Our rays of pupil points (N, 2) m and directions (2,), as optiland launches them, some way before the lens."""
    from optiland.rays import RealRays

    count = len(p)
    axes, centre = system.pupil_frame()
    d = np.array([*theta, np.sqrt(1 - theta @ theta)])
    back = system.document.entrance.back_off_mm * MM
    start = (np.column_stack([p, np.zeros(count)]) - back * d) @ axes + centre
    d = d @ axes
    ones = np.ones(count)
    return RealRays(*(start.T / MM), *(value * ones for value in d), ones, 1e6 / system.sigma0 * ones)


def ghosts(name: str, count: int) -> dict[str, Any]:
    """All two-reflection ghosts of a stored lens, path by path, beside optiland sequences written for each."""
    instrument = load_instrument(DATA / f"{name}.toml")
    system = instrument.band(instrument.bands[0])
    optic = optiland_model(system)
    radius, field = BUNDLES[name]
    theta = np.array(field)
    r, angle = np.random.default_rng(3).random((2, count))
    p = radius * np.sqrt(r)[:, None] * np.column_stack([np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)])
    rows = []
    for path in _pairs(system):
        sequence = compile_sequence(system, path, system.sigma0)
        own = trace(sequence, p, theta)
        steps = [0] + [
            (system.number[step] + 1, "reflect") if act == "reflect" else system.number[step] + 1
            for step, act in path.steps
        ]
        traced = optic.add_sequence(str(path), [*steps, len(system.surfaces)])
        rays = optiland_rays(system, p, theta)
        with np.errstate(all="ignore"):
            traced.surfaces.trace(rays)
        x = np.column_stack([rays.x, rays.y]) * MM
        alive = np.isfinite(x).all(axis=1) & (np.asarray(rays.i) > 0)
        # A virtual ray (the surface lies behind it) is a line for optiland and no light for us.
        both = alive & own.passes
        row: dict[str, Any] = {
            "path": str(path), "ours": int(own.passes.sum()), "optiland": int(alive.sum()),
            "only_optiland": int((alive & ~own.passes).sum()), "only_ours": int((own.passes & ~alive).sum()),
            "virtual": int((alive & (own.status > 0)).sum()),
        }  # fmt: skip
        if both.any():
            back = system.document.entrance.back_off_mm * MM
            row["x_m"] = float(np.abs(x - own.x)[both].max())
            row["power"] = float(np.abs(np.asarray(rays.i) / own.power - 1)[both].max())
            row["opl_m"] = float(np.abs(np.asarray(rays.opd) * MM - back - own.opl)[both].max())
        rows.append(row)
    lit = [row for row in rows if "x_m" in row]
    return {
        "lens": name, "ghosts": len(rows), "alive": len(lit), "rays_each": count, "rows": rows,
        "survivors_differ": sum(row["only_ours"] + row["only_optiland"] for row in rows),
        "virtual": sum(row["virtual"] for row in rows),
        **{f"worst_{key}": max(row[key] for row in lit) for key in ("x_m", "power", "opl_m")},
    }  # fmt: skip


def _pairs(system: OpticalSystem) -> list[Path]:
    """Every ghost off two glass faces, written out: forward to one, back to an earlier one, forward again."""
    names = [s.name for s in system.surfaces[:-1]]
    glass = [s.name for s in system.surfaces[:-1] if s.coating.reflectance > 0]
    found = []
    for second in glass:
        for first in glass[: glass.index(second)]:
            i, j = names.index(first), names.index(second)
            forward = [(name, "transmit") for name in names]
            back = [(name, "transmit") for name in names[i + 1 : j][::-1]]
            steps = [*forward[:j], (second, "reflect"), *back, (first, "reflect"), *forward[i + 1 :]]
            found.append(make_path(system, steps))  # type: ignore[arg-type]
    return found


def count_found(name: str) -> tuple[int, int]:
    """Two-reflection ghosts that the search finds in a stored lens, and how many pairs of faces there are."""
    instrument = load_instrument(DATA / f"{name}.toml")
    system = instrument.band(instrument.bands[0])
    return sum(path.order == 2 for path in find_paths(system)), len(_pairs(system))


def rays_of(imported: Imported, count: int) -> tuple[Array, Array]:
    """Points (N, 2; mm) in the plane z = 0 of the world, and directions (N, 3), over pupil and field of a lens."""
    entrance = imported.document["entrance"]
    random = np.random.default_rng(5)
    r, angle = random.random((2, count))
    x, y, z = entrance["at_mm"]
    pupil = 0.9 * entrance["radius_mm"] * np.sqrt(r) * np.array([np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)])
    half = np.sin(np.radians(np.array(entrance["half_field_deg"])))
    q = half * (2 * random.random((count, 2)) - 1)
    d = np.column_stack([q, np.sqrt(1 - (q**2).sum(axis=1))])
    return np.array([x, y]) + pupil.T - z * d[:, :2] / d[:, 2:], d


def our_points(imported: Imported, points: Array, directions: Array, nm: float) -> tuple[Array, NDArray[np.bool_]]:
    """Points (K, N, 3; mm) in the world where rays meet the surfaces of the nominal path, and which get through."""
    system = imported.instrument.band("design")
    sequence = compile_sequence(system, make_path(system, imported.path.steps), 1e9 / nm)
    centre = system.pupil_frame()[1]
    p = points * MM - centre[:2] + centre[2] * directions[:, :2] / directions[:, 2:]
    traced = trace(sequence, p, directions[:, :2], footprints=True)
    found = []
    for name, foot in zip(sequence.names, traced.foot, strict=True):
        surface = system.surfaces[system.number[name]]
        local = np.column_stack([*foot, surface.sag(*foot)])
        found.append((local @ surface.rotation + surface.origin) / MM)
    return np.array(found), traced.valid


def rayoptics_points(imported: Imported, points: Array, directions: Array, nm: float) -> Array:
    """The same by rayoptics, which reads the file itself; points in the axes of surface 1 before its own tilt."""
    with redirect_stdout(io.StringIO()):
        from rayoptics.elem.transform import compute_global_coords
        from rayoptics.environment import open_model
        from rayoptics.raytr.raytrace import trace_raw

        with tempfile.TemporaryDirectory() as folder:
            model = open_model(_for_rayoptics(imported.file, folder))
    sequence = model["seq_model"]
    # An object 1e10 mm away costs digits: rays start 10 mm before the lens.
    sequence.gaps[0].thi = 10.0
    model["osp"]["wvls"].wavelengths[:] = [nm] * len(model["osp"]["wvls"].wavelengths)
    model.update_model()
    places = compute_global_coords(sequence, glo=0)
    found = np.full((len(imported.numbers), len(points), 3), np.nan)
    for k, (point, direction) in enumerate(zip(points, directions, strict=True)):
        start = np.append(point - 10.0 * direction[:2] / direction[2], 0.0)
        path = sequence.path(wl=nm)
        ray = trace_raw(path, start, direction, nm, intersect_obj=False)[0]
        for row, number in enumerate(imported.numbers):
            turn, shift = places[number]
            found[row, k] = turn @ ray[number][0] + shift - np.array([0.0, 0.0, 10.0])
    return found


def _for_rayoptics(file: str, folder: str) -> str:
    """A Zemax file with coordinate breaks as rayoptics has to read them.

    It takes tilts about x and y as CODE V's, left-handed, and the second order of a break as CODE V's reversal, which
    undoes what its numbers say. Fields, of which it does not know every kind, are of no consequence here.
    """
    if not file.lower().endswith(".zmx"):
        return file
    lines = read_text(File(file)).splitlines()
    blocks: list[list[str]] = [[]]
    for line in lines:
        if line.startswith("SURF"):
            blocks.append([])
        blocks[-1].append("FTYP 0 0 1 1 0 0 0" if line.startswith("FTYP") else line)
    for block in blocks:
        if "COORDBRK" not in " ".join(block):
            continue
        second = any(
            words[:2] == ["PARM", "6"] and float(words[2]) for words in map(str.split, block) if len(words) > 2
        )
        turned = ("1", "2", "5") if second else ("3", "4")
        for k, words in enumerate(map(str.split, block)):
            if words[:1] == ["PARM"] and words[1] in turned:
                block[k] = f"  PARM {words[1]} {-float(words[2])}"
    copy = File(folder) / File(file).name
    copy.write_text("\n".join(line for block in blocks for line in block) + "\n", encoding="utf-8")
    return str(copy)


def optiland_points(imported: Imported, points: Array, directions: Array, nm: float) -> Array:
    """The same by optiland, which reads Zemax files."""
    from optiland.fileio import load_zemax_file
    from optiland.rays import RealRays

    optic = load_zemax_file(imported.file)
    count = len(points)
    start = np.column_stack([points, np.zeros(count)]) - 10.0 * directions
    rays = RealRays(*start.T, *directions.T, np.ones(count), np.full(count, nm * 1e-3))
    optic.surfaces.trace(rays, skip=1)
    order = _zemax_surfaces(imported)
    found = [np.column_stack([s.x, s.y, s.z]) for s in optic.surfaces.surfaces]
    return np.array([found[order.index(number)] for number in imported.numbers])


def _zemax_surfaces(imported: Imported) -> list[int]:
    """Numbers of the file's surfaces that are no coordinate breaks."""
    return [row.number for row in read_zmx(File(imported.file)).rows if not row.breaks]


PEERS: dict[str, Callable[[Imported, Array, Array, float], Array]] = {
    "rayoptics": rayoptics_points,
    "optiland": optiland_points,
}


def round_trip(imported: Imported, peer: str, count: int = 60) -> dict[str, Any]:
    """Where rays meet every surface, beside a peer that reads the same file: largest difference, absolute (mm) and
    relative to the lens's own size."""
    points, directions = rays_of(imported, count)
    nm = imported.document["band"]["design"]["filter"]["centre_nm"]
    own, valid = our_points(imported, points, directions, nm)
    with np.errstate(all="ignore"):
        other = PEERS[peer](imported, points, directions, nm)
    # rayoptics leaves CODE V's defocus out, which moves the image.
    left_out = ""
    if peer == "rayoptics" and any(remark.keyword == "SI" for remark in imported.remarks):
        own, other, left_out = own[:-1], other[:-1], ", image left out: the peer does not read its defocus"
    size = float(np.ptp(own[:, valid].reshape(-1, 3), axis=0).max())
    apart = np.abs(own - other)[:, valid].max(axis=(1, 2))
    return {"file": File(imported.file).name, "peer": peer, "rays": int(valid.sum()), "surfaces": len(own),
            "largest_mm": float(apart.max()), "relative": float(apart.max() / size),
            "left_out": left_out,
            "by_surface_mm": dict(zip(imported.numbers, apart.tolist(), strict=False))}  # fmt: skip
