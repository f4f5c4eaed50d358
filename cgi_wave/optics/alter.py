"""The same instrument with other coatings on some surfaces, or with some surfaces turned or shifted as one body.

A changed system is a new object: what was found, traced or cached for the old one does not mix with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cgi_wave.errors import InputError
from cgi_wave.optics.schema import CoatingSpec
from cgi_wave.optics.system import OpticalSystem, Surface, rotation

#: Fields of a coating that say all of it, if it has nothing else: power and phase are then the same for every ray.
PLAIN = ("reflectance", "transmittance", "reflect_phase_deg", "transmit_phase_deg")


def recoated(system: OpticalSystem, coatings: Mapping[str, CoatingSpec]) -> OpticalSystem:
    """The system with these coatings on these surfaces, by name."""
    surfaces = (replace(s, coating=coatings[s.name]) if s.name in coatings else s for s in system.surfaces)
    return replace(system, surfaces=tuple(surfaces))


def moved(
    system: OpticalSystem, names: Sequence[str], tilt_deg: tuple[float, float] = (0.0, 0.0), shift_mm: float = 0.0
) -> OpticalSystem:
    """The system with some surfaces moved as one rigid body; everything else stays where it is.

    The body turns about the mean of its vertices, by tilt_deg about x and then the new y of the first surface's own
    axes, and is shifted by shift_mm along the z that these had before.
    """
    first = system.surfaces[system.number[names[0]]]
    axes = first.rotation.T  # columns are the local axes in the world
    turn = axes @ rotation((*tilt_deg, 0.0)) @ axes.T
    pivot = np.mean([system.surfaces[system.number[name]].origin for name in names], axis=0)
    shift = axes[:, 2] * shift_mm * 1e-3

    def place(surface: Surface) -> Surface:
        if surface.name not in names:
            return surface
        origin = pivot + turn @ (surface.origin - pivot) + shift
        return replace(surface, rotation=surface.rotation @ turn.T, origin=origin)

    return replace(system, surfaces=tuple(place(surface) for surface in system.surfaces))


def members(system: OpticalSystem, name: str) -> tuple[str, ...]:
    """Surfaces that a name stands for: a surface; else the body that fills a space, by all its faces; else a frame.

    Raises InputError for a name that is none of these.
    """
    if name in system.number:
        return (name,)
    if name in system.spaces:
        number = system.spaces.index(name)
        return tuple(s.name for s in system.surfaces if number in (s.before, s.after))
    frame = next((frame for frame in system.document.frame if frame.name == name), None)
    if frame is None:
        raise InputError(
            system.file, name, name, "is no surface, space or frame", f"name one of {', '.join(system.number)}"
        )
    return tuple(spec.name for spec in frame.surface)


def plane_bodies(system: OpticalSystem) -> dict[str, tuple[str, ...]]:
    """What could be tilted without moving a curved face: solid bodies with plane faces only, and single plane faces
    that bound none (mirrors, a detector). Cemented bodies, which share a face, are one. By name, of the first space or
    of the surface; surfaces that cannot act on light (no reflectance and full transmittance) are left out.
    """
    bodies: list[tuple[str, set[str]]] = []
    for number, name in enumerate(system.spaces):
        if system.glasses[number] == 1.0:
            continue
        touching = {s.name for s in system.surfaces if number in (s.before, s.after)}
        shared = [body for body in bodies if body[1] & touching]
        bodies = [body for body in bodies if body not in shared]
        bodies.append(((shared[0][0] if shared else name), touching.union(*(body[1] for body in shared))))
    solid = {name for _, touching in bodies for name in touching}
    lone = [(s.name, {s.name}) for s in system.surfaces if s.name not in solid and _acts(s)]
    plane = {s.name for s in system.surfaces if s.curvature == 0.0}
    order = [s.name for s in system.surfaces]
    return {name: tuple(s for s in order if s in touching) for name, touching in bodies + lone if touching <= plane}


def is_constant(coating: CoatingSpec) -> bool:
    """Whether a coating has one reflectance and one transmittance for all rays: neither Fresnel's nor a table.

    A field that this module does not know, and that was given a value, counts as something that varies.
    """
    blank = type(coating)()
    return all(
        getattr(coating, name) == getattr(blank, name) for name in coating.__struct_fields__ if name not in PLAIN
    )


def _acts(surface: Surface) -> bool:
    coating = surface.coating
    return not is_constant(coating) or coating.reflectance > 0.0 or coating.transmittance < 1.0
