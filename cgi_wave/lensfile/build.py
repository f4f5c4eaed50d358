"""The instrument file of a placed lens: frames, entrance pupil, apertures, band. Rays are the tracer's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cgi_wave.errors import EmptyBeamError
from cgi_wave.lensfile.listing import Array, Listing, Remark
from cgi_wave.lensfile.poses import Layout, Placed, layout
from cgi_wave.optics.system import MM, OpticalSystem, from_document
from cgi_wave.rays.paths import Path, find_paths, make_path
from cgi_wave.rays.trace import compile_sequence, trace, trace_with_derivatives

#: Apertures that had to be traced are this much larger than what the rays fill, mm and part of it.
ROOM = 0.02
#: Until its aperture is known a surface has this one, mm: too small to cross its neighbours.
TINY = 1e-6
#: Surfaces farther than this (mm) before the first one may shade it.
SHADOW = 1e-6
#: A solve is fulfilled within this, mm.
SOLVED = 1e-6
#: Half width (mm) of the image if no ray says more, and pixel of the stand-in detector, µm.
LEAST, PIXEL = 0.05, 10.0
#: Rays of a field that trace an aperture: the rim of the pupil and its centre.
RIM = np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)] + [[0.0, 0.0]])


@dataclass(frozen=True)
class Pupil:
    """Entrance pupil: centre (3,) mm in the world, radius mm; focal length mm of the lens behind it."""

    centre: Array
    radius: float
    focal_length: float


def build(
    listing: Listing, given: Mapping[str, str | float], keep_stop: bool
) -> tuple[dict[str, Any], Path, list[int]]:
    """The document of an instrument file, checked, its nominal path, and the file's numbers of the surfaces on it, the
    image last. Raises InputError."""
    full = layout(listing, given, keep=True)
    before = len(listing.remarks)
    system, path = _resolve(listing, full, None, {})
    if listing.solve and _solved(listing, full, system, path):
        return build(listing, given, keep_stop)
    pupil = _pupil(listing, full, system, path)
    openings = _openings(listing, full, system, path, pupil)
    mirrors = [surface.name for surface in full.surfaces if surface.act == "reflect"]
    chosen = full
    dummies = [s for s in full.surfaces if s.act == "transmit" and _idle(full, s)]
    if mirrors and dummies and not keep_stop:
        # Light that turns back may cross a stop's plane once more, which a list of surfaces does not tell.
        listing.remarks = listing.remarks[:before]
        spare = Listing(listing.file, rows=listing.rows, wavelengths=listing.wavelengths)
        chosen = layout(spare, given, keep=False)
        for surface in dummies:
            what = "stop: the entrance pupil limits the beam instead" if surface.row.stop else "aperture in the air"
            listing.remark(
                "substituted", surface.row.line, surface.name, f"no surface of its own with mirrors about: {what}"
            )
    system = from_document(_document(listing, chosen, pupil, openings), listing.file).band("design")
    path = make_path(system, chosen.steps)  # type: ignore[arg-type]
    _check_search(listing, system, path)
    first, *others = chosen.surfaces
    shadows = [s.name for s in others if s.origin[2] < first.origin[2] - SHADOW]
    if shadows:
        text = f"{', '.join(shadows)} before {first.name}: light starts behind, as in the file, and sees no shadow"
        listing.remark("beware", 0, "order", text)
    return _document(listing, chosen, pupil, openings), path, chosen.numbers


def _solved(listing: Listing, found: Layout, system: OpticalSystem, path: Path) -> bool:
    """Settle the solve for the paraxial image: whether the distance before the image had to be changed for it."""
    assert listing.solve is not None
    (line, defocus), listing.solve = listing.solve, None
    if not _has_axis(found):
        listing.remark("substituted", line, "PIM", "solve in a lens without an axis: the value in the file is kept")
        return False
    ray = trace_with_derivatives(compile_sequence(system, path, system.sigma0), np.zeros((1, 2)), np.zeros(2), "p")
    height, slope = ray.dx[0][0, 0], ray.dq[0][0, 0]
    # Light goes along -z after an odd number of mirrors, and distances along it are negative.
    way = (-1.0) ** sum(row.medium == "mirror" for row in listing.rows)
    wrong = -height / slope / MM + way * defocus if slope else np.inf
    if abs(wrong) < SOLVED:
        listing.remark("substituted", line, "PIM", "solve replaced by the value in the file, which fulfils it")
        return False
    if not np.isfinite(wrong):
        listing.refuse(line, "PIM", wrong, "has no focus to find", "give the distance before the image")
    before = listing.rows[-2]
    listing.rows[-2] = before.with_(thickness=before.thickness + way * wrong)
    text = f"solve: distance before the image set to {listing.rows[-2].thickness:.9g} mm"
    listing.remarks = [*listing.remarks, Remark("substituted", line, "PIM", text)]
    return True


def _has_axis(found: Layout) -> bool:
    """Whether all surfaces stand square on one line along z."""
    square = all(abs(abs(s.axes[2, 2]) - 1.0) < 1e-12 for s in found.surfaces)
    return square and all(np.abs(s.origin[:2]).max() < 1e-12 for s in found.surfaces)


def _check_search(listing: Listing, system: OpticalSystem, path: Path) -> None:
    """Say so if the search of paths, which knows where surfaces stand and not their order, does not find the lens."""
    try:
        found = {nominal.steps for nominal in find_paths(system, max_order=0, max_splits=0)}
    except EmptyBeamError:
        found = set()
    if path.steps not in found:
        text = "a search of paths does not find it: a surface stands in the light's way, or an aperture is too small"
        listing.remark("beware", 0, "nominal path", text)


def _idle(found: Layout, surface: Placed) -> bool:
    """A surface with the same glass on both sides."""
    return found.spaces.get(surface.before) == found.spaces.get(surface.after)


def _resolve(
    listing: Listing, found: Layout, pupil: Pupil | None, openings: Mapping[str, dict[str, Any]]
) -> tuple[OpticalSystem, Path]:
    document = _document(listing, found, pupil or Pupil(np.zeros(3), 1.0, 1.0), openings)
    system = from_document(document, listing.file).band("design")
    return system, make_path(system, found.steps)  # type: ignore[arg-type]


def _pupil(listing: Listing, found: Layout, system: OpticalSystem, path: Path) -> Pupil:
    """Entrance pupil: where rays of small fields through the stop's centre meet; its radius by the file's aperture."""
    names = [name for name, _ in path.steps]
    whole = compile_sequence(system, path, system.sigma0)
    point, across = np.zeros((1, 2)), np.zeros(2)
    z = 0.0
    scale = 1.0
    if found.stop and found.stop in names:
        sequence = whole.upto(names.index(found.stop) + 1)
        for _ in range(20):
            ray = trace_with_derivatives(sequence, point, across, "both")
            if not ray.traced.valid[0]:
                listing.refuse(
                    0, "stop", found.stop, "is not reached by a ray along the axis", "check tilts and glasses"
                )
            by_theta, by_p = ray.dx[0][:, :2], ray.dx[0][:, 2:]
            step = np.linalg.solve(by_p, ray.traced.x[0])
            point = point - step
            if np.abs(step).max() < 1e-13:
                break
        z = float((by_theta * by_p).sum() / (by_p * by_p).sum())
        scale = float(np.sqrt(np.abs(np.linalg.det(by_p))))
        if abs(z) > 1e6:
            listing.refuse(0, "stop", found.stop, "is telecentric in object space", "give a stop nearer to the lens")
    else:
        listing.remark("substituted", 0, "stop", "no stop: the entrance pupil stands at the first surface")
    ray = trace_with_derivatives(whole, point, across, "p")
    power = float(np.sqrt(abs(np.linalg.det(ray.dq[0]))))
    focal = 1.0 / power / MM if power > 0 else float("inf")
    kind, value = listing.aperture or ("", 0.0)
    stop = next((s for s in found.surfaces if s.name == found.stop), None)
    radius = {
        "diameter": value / 2,
        "f-number": focal / value / 2 if value else 0.0,
        "na": focal * value,
        "stop": stop.row.opening.radius / scale if stop and stop.row.opening and stop.row.opening.radius else 0.0,
    }.get(kind, 0.0)
    if not (np.isfinite(radius) and radius > 0):
        listing.refuse(
            0, "aperture", kind or "(none)", "gives no entrance pupil", "give EPD/ENPD, the pupil's diameter"
        )
    if kind != "diameter":
        text = f"entrance pupil of diameter {2 * radius:.9g} mm from {kind} {value:g}, focal length {focal:.9g} mm"
        listing.remark("substituted", 0, "aperture", text)
    return Pupil(np.array([*(point[0] / MM), z / MM]), radius, focal)


def _angles(listing: Listing, pupil: Pupil) -> list[Array]:
    """Direction cosines (2,) of the fields."""
    found = []
    for point in listing.fields or []:
        tangent = np.array(point.angle) / pupil.focal_length if listing.heights else np.tan(np.radians(point.angle))
        found.append(tangent / np.sqrt(1 + tangent @ tangent))
    return found or [np.zeros(2)]


def _openings(
    listing: Listing, found: Layout, system: OpticalSystem, path: Path, pupil: Pupil
) -> dict[str, dict[str, Any]]:
    """Aperture of each surface: the file's, or what the rays of the fields fill."""
    reach: dict[str, float] = {}
    box = np.full((2, 2), LEAST)
    sequence = compile_sequence(system, path, system.sigma0)
    lost = 0
    for field, direction in zip(listing.fields or [None], _angles(listing, pupil), strict=True):  # type: ignore[list-item]
        rim = RIM.copy()
        if field is not None:
            for axis, (low, high) in enumerate((field.pupil_x, field.pupil_y)):
                rim[:, axis] = (low + high) / 2 + rim[:, axis] * (high - low) / 2
        # From the pupil, where it is, back to the plane of the provisional one.
        slope = direction / np.sqrt(1 - direction @ direction)
        points = (pupil.centre[:2] + rim * pupil.radius - pupil.centre[2] * slope) * MM
        traced = trace(sequence, points, direction, footprints=True)
        lost += int((~traced.valid).sum())
        foot = np.abs(traced.foot[:, :, traced.valid]) / MM
        for name, (x, y) in zip(sequence.names, foot, strict=True):
            reach[name] = max(reach.get(name, 0.0), float(np.hypot(x, y).max(initial=0.0)))
        box = np.maximum(box, foot[-1].max(axis=1, initial=0.0)[:, None])
    if lost:
        listing.remark(
            "dropped", 0, "apertures", f"{lost} rays of the fields that meet no surface while apertures are traced"
        )
    openings: dict[str, dict[str, Any]] = {}
    for surface in found.surfaces:
        opening, row = surface.row.opening, surface.row
        if surface.act == "absorb":
            half = [float(f"{1.1 * value + LEAST:.4g}") for value in box[:, 0]]
            openings[surface.name] = {"half_width_mm": half}
            continue
        if opening is None:
            radius = float(f"{reach[surface.name] * (1 + ROOM) + LEAST:.4g}")
            openings[surface.name] = {"radius_mm": radius}
            text = f"{surface.name}: aperture of radius {radius:g} mm: what the fields fill, and {ROOM:.0%} more"
            listing.remark("substituted", row.line, "aperture", text)
            continue
        x, y = opening.centre
        centre = {} if (x, y) == (0.0, 0.0) else {"centre_mm": [-x if surface.flipped else x, y]}
        size = (
            {"radius_mm": opening.radius} if opening.radius is not None else {"half_width_mm": list(opening.half or ())}
        )
        openings[surface.name] = size | centre
        if not opening.exact:
            text = f"{surface.name}: aperture of radius {opening.radius:g} mm from the semi-diameter"
            listing.remark("substituted", row.line, "aperture", text)
    return openings


def _document(listing: Listing, found: Layout, pupil: Pupil, openings: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """The instrument file as plain data."""
    glasses: dict[str, str | float] = {}
    spaces: dict[str, str] = {}
    for space, page in found.spaces.items():
        name = "air" if page == "air" else str(page).rpartition("/")[2] if isinstance(page, str) else f"n{page:g}"
        while name in glasses and glasses[name] != page:
            name += "_"
        if page != "air":
            glasses[name] = page
        spaces[space] = name
    coating: dict[str, Any] = {"none": {}}
    coating["glass"] = {"bare": True}
    coating["mirror"] = {"reflectance": 1.0, "transmittance": 0.0, "reflect_phase_deg": 180.0}
    angles = np.abs(np.array(_angles(listing, pupil)))
    half = np.degrees(np.arcsin(angles.max(axis=0)))
    if _has_axis(found):
        half[:] = half.max()  # a lens with an axis is meant for fields all round it
    wavelengths = sorted(set(listing.wavelengths))
    width = openings.get("image", {"half_width_mm": [LEAST, LEAST]})["half_width_mm"]
    columns, rows = (max(2, int(np.ceil(2 * w * 1000 / PIXEL))) for w in width)
    # Light starts before the surface that the file names first; what else stands before it is told in a remark.
    nearest = float(found.surfaces[0].origin[2])
    deepest = max((o.get("radius_mm") or max(o["half_width_mm"]) for o in openings.values()), default=1.0)
    back = max(float(pupil.centre[2]) - min(nearest, 0.0), 0.0) + deepest + 10.0
    primary = listing.wavelengths[listing.primary]
    return {
        "name": listing.name,
        "notes": [str(remark) for remark in listing.remarks],
        "glass": glasses,
        "space": spaces,
        "coating": coating,
        "entrance": {
            "space": "front", "at_mm": [_tidy(v) for v in pupil.centre], "radius_mm": _tidy(pupil.radius),
            "back_off_mm": float(f"{back:.6g}"), "half_field_deg": [max(_tidy(v), 0.05) for v in half],
        },
        "detector": {"surface": "image", "pixel_um": PIXEL, "columns": columns, "rows": rows},
        "frame": _frames(found, openings),
        "band": {
            "design": {
                "zone_rows": [0, rows], "wavelengths_nm": wavelengths,
                "filter": {"centre_nm": primary, "fwhm_nm": 1.0}, "spectrum": {"kind": "solar"}, "target_opd_mm": 0.0,
            }
        },
    }  # fmt: skip


def _tidy(value: float) -> float:
    """Without the rounding errors of the way here."""
    return float(f"{value:.14g}") + 0.0


def _frames(found: Layout, openings: Mapping[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """Surfaces that follow each other along one axis share a frame; others begin a new one, in the world."""
    frames: list[dict[str, Any]] = []
    previous: Placed | None = None
    for surface in found.surfaces:
        entry = _entry(found, surface, openings)
        gap = None
        if previous is not None and np.array_equal(previous.axes, surface.axes) and previous.after == surface.before:
            along = surface.axes.T @ (surface.origin - previous.origin)
            gap = float(along[2]) if np.abs(along[:2]).max() < 1e-12 and along[2] >= 0 else None
        if gap is None:
            frames.append({
                "name": f"from_{surface.name}", "before": surface.before,
                "shift_mm": [_tidy(v) for v in surface.origin], "rotate_deg": _angles_of(surface.axes),
                "surface": [entry],
            })  # fmt: skip
        else:
            frames[-1]["surface"][-1]["thickness_mm"] = _tidy(gap)
            frames[-1]["surface"].append(entry)
        previous = surface
    return frames


def _entry(found: Layout, surface: Placed, openings: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    shape: dict[str, Any] = {}
    if surface.curvature:
        shape = {"shape": "conic" if surface.conic else "sphere", "radius_mm": _tidy(1.0 / surface.curvature)}
        shape |= {"conic": surface.conic} if surface.conic else {}
    act: dict[str, Any] = {} if surface.act == "transmit" else {"nominal": surface.act}
    coating = {"reflect": "mirror", "absorb": "none"}.get(surface.act, "none" if _idle(found, surface) else "glass")
    return {"name": surface.name} | shape | {
        "after": surface.after, "coating": coating, "aperture": openings.get(surface.name, {"radius_mm": TINY})
        if surface.act != "absorb" else openings.get(surface.name, {"half_width_mm": [LEAST, LEAST]}),
    } | act  # fmt: skip


def _angles_of(axes: Array) -> list[float]:
    """Angles (deg) about x, the new y, the new z that make ``axes`` (3, 3; columns)."""
    y = np.arctan2(axes[0, 2], np.hypot(axes[0, 0], axes[0, 1]))
    if np.hypot(axes[0, 0], axes[0, 1]) < 1e-12:
        return [_tidy(np.degrees(np.arctan2(axes[2, 1], axes[1, 1]))), _tidy(np.degrees(y)), 0.0]
    x, z = np.arctan2(-axes[1, 2], axes[2, 2]), np.arctan2(-axes[0, 1], axes[0, 0])
    return [_tidy(np.degrees(angle)) for angle in (x, y, z)]
