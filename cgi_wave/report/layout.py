"""The layout of an instrument for ``plots.plot_layout``: surfaces and nominal rays, seen from one or two sides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.optics.system import OpticalSystem, Surface
from cgi_wave.rays.beams import nominal_direction
from cgi_wave.rays.paths import Path, find_paths
from cgi_wave.rays.trace import compile_sequence, history, trace

Array = NDArray[np.float64]

FAN = 7
"""Rays of a fan across the pupil, of which two are drawn, crossed."""

FIELDS = (0, 1, 4)
"""Field points drawn: the zone's centre and two opposite corners."""

NEAR = 0.03
"""Two names closer than this part of the drawing would be unreadable; an instrument thinner than it is flat."""


def layout(system: OpticalSystem) -> list[dict[str, Any]]:
    """Views for ``plots.plot_layout``: profiles of all surfaces, and fans of nominal rays of both arms.

    The first view is along the world axis in which the vertices spread least; a second, along the next, follows unless
    the instrument is flat. Rays that an aperture stops are not drawn. Surfaces of one element share a name; an element
    closer than ``NEAR`` to those already named is drawn without it. Raises EmptyBeamError if no nominal path reaches
    the detector.
    """
    spread = np.ptp([surface.origin for surface in system.surfaces], axis=0)
    first, second, third = (int(axis) for axis in np.argsort(-spread, kind="stable"))
    paths = find_paths(system, max_order=0, max_splits=0)
    fans = [_fan(system, paths, system.field_points()[index]) for index in FIELDS]
    views = [_view(system, fans, (first, second), third)]
    if spread[third] > NEAR * spread[first]:
        views.append(_view(system, fans, (first, third), second))
    return views


def _view(system: OpticalSystem, fans: list[list[Array]], plane: tuple[int, int], across: int) -> dict[str, Any]:
    """One view along the world axis ``across``; fans: of each field point, from ``_fan``."""
    profiles = [_profile(surface, across)[:, plane] for surface in system.surfaces]
    near = NEAR * float(np.ptp(np.concatenate(profiles), axis=0).max())
    surfaces: list[dict[str, Any]] = [{"name": "", "points_m": points} for points in profiles]
    _put_names(surfaces, elements([surface.name for surface in system.surfaces]), near)
    return {
        "title": f"{system.band}, seen along {'xyz'[across]}",
        "axes": tuple("xyz"[axis] for axis in plane),
        "surfaces": surfaces,
        "rays": [{"points_m": points[:, plane], "group": group} for group, fan in enumerate(fans) for points in fan],
    }


def elements(names: list[str]) -> list[str]:
    """What each surface belongs to: its name up to the last "_" if another surface has the same beginning."""
    beginnings = [name.rpartition("_")[0] for name in names]
    return [part if part and beginnings.count(part) > 1 else name for name, part in zip(names, beginnings, strict=True)]


def _put_names(surfaces: list[dict[str, Any]], names: list[str], near: float) -> None:
    """Name each element once, at that end of one of its profiles which is furthest from the names there are."""
    named: list[Array] = []
    for name in dict.fromkeys(names):
        own = [surface for surface, other in zip(surfaces, names, strict=True) if other == name]
        ends = [(surface, surface["points_m"][end]) for surface in own for end in (-1, 0)]
        room = [min((float(np.hypot(*(at - other))) for other in named), default=np.inf) for _, at in ends]
        best = int(np.argmax(room))
        if room[best] > near:
            surface, at = ends[best]
            outward = at - surface["points_m"].mean(axis=0)
            surface |= {"name": name, "name_at_m": at, "outward": outward / max(float(np.hypot(*outward)), 1e-12)}
            named.append(at)


def _profile(surface: Surface, across: int, count: int = 31) -> Array:
    """Cut through the middle of the surface's aperture: (count, 3) world points, m."""
    # Of the two local axes the drawing shows the one that leans less on the line of sight.
    shown = int(np.argmin(np.abs(surface.rotation[:2, across])))
    half, centre = surface.aperture[1:3], surface.aperture[3:5]
    local = np.tile(centre, (count, 1))
    local[:, shown] += np.linspace(-half[shown], half[shown], count)
    points = np.column_stack([local, surface.sag(local[:, 0], local[:, 1])])
    return points @ surface.rotation + surface.origin


def _fan(system: OpticalSystem, paths: Sequence[Path], x0: Array) -> list[Array]:
    """Rays to the detector point x0 (2,) through a cross of pupil points, on each nominal path: (K, 3) world points.

    Of the cross's two lines one lies in the plane of a view as long as no mirror turns the light out of it, and the
    other one behind such a mirror: the cone is seen everywhere.
    """
    axes, origin = system.pupil_frame()
    height = np.linspace(-0.98, 0.98, FAN) * system.pupil_radius
    line = np.concatenate([np.outer(height, axis) for axis in np.eye(2)])
    rays = []
    for path in paths:
        theta = nominal_direction(system, path, x0)
        sequence = compile_sequence(system, path, system.sigma0)
        passes = trace(sequence, line, theta).passes
        if passes.any():
            points = history(sequence, line[passes], theta)
            rays += [points[:, ray] @ axes + origin for ray in range(points.shape[1])]
    return rays
