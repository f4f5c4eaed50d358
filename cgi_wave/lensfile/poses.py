"""From the rows of a lens file, each in the axes of the one before, to surfaces with poses and spaces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cgi_wave.lensfile.glasses import resolve
from cgi_wave.lensfile.listing import Array, Listing, Move, Row

#: Two surfaces whose vertices are nearer than this (mm) and whose normals agree to ``SAME_ANGLE`` rad are one.
SAME_PLACE, SAME_ANGLE = 1e-7, 1e-9
#: Objects farther than this (mm) count as infinitely far.
FAR = 1e8
TURNED = np.diag([-1.0, 1.0, -1.0])


@dataclass
class Placed:
    """A surface of the instrument: its name, row, pose (columns of ``axes`` and ``origin`` mm in the world) with z
    along the light that meets it first, curvature and conic there, spaces before and behind it ("" for nothing).

    flipped: the file's own axes are turned by half a turn about y.
    """

    name: str
    row: Row
    axes: Array
    origin: Array
    curvature: float
    before: str
    after: str
    flipped: bool
    act: str

    @property
    def conic(self) -> float:
        """Conic constant; none for a plane."""
        return self.row.conic if self.curvature else 0.0


@dataclass
class Layout:
    """Surfaces, the steps of the nominal path (name, act) with the file's number of each, space → glass (page, number
    or "air"), name of the stop."""

    surfaces: list[Placed]
    steps: list[tuple[str, str]]
    numbers: list[int]
    spaces: dict[str, str | float]
    stop: str


def layout(listing: Listing, given: Mapping[str, str | float], keep: bool) -> Layout:
    """Place the surfaces of a listing.

    given: glass pages by name; keep: keep planes without glass on either side (stop, baffles) as surfaces of their own.
    Raises InputError for what has no counterpart.
    """
    _check(listing)
    axes, origin = np.eye(3), np.zeros(3)
    frames: dict[int, tuple[Array, Array]] = {}
    placed: list[Placed] = []
    steps: list[tuple[str, str]] = []
    numbers: list[int] = []
    spaces: dict[str, str | float] = {"front": "air"}
    here, forward, stop = "front", 1, ""
    last = len(listing.rows) - 1
    for row in listing.rows[1:]:
        if row.origin is not None:
            if row.origin not in frames:
                listing.refuse(row.line, "RET/GLB", row.origin, "names no earlier surface", "refer to one before it")
            axes, origin = frames[row.origin]
        axes, origin = _move(axes, origin, row.before)
        own_axes, own_origin = _move(axes, origin, row.own)
        frames[row.number] = (own_axes, own_origin)
        glass = _glass(listing, row, given)
        bends = glass == "mirror" or glass != spaces[here] or row.number == last
        stands = not row.breaks and (bends or row.stop or (row.opening is not None and row.opening.exact))
        if stands and (bends or keep):
            surface = _surface(row, own_axes, own_origin, forward, here)
            old = next((other for other in placed if _same(other, surface)), None)
            if row.number == last:
                surface.act, surface.after, surface.name = "absorb", "", "image"
                placed.append(surface)
            elif old is None:
                here = _meet(surface, glass, here, spaces)
                placed.append(surface)
                steps.append((surface.name, surface.act))
            else:
                here = _again(listing, old, row, glass, here, spaces)
                steps.append((old.name, old.act))
            numbers.append(row.number)
            if row.stop:
                stop = (old or surface).name
        elif stands and row.stop:
            stop = ""
        forward = -forward if glass == "mirror" else forward
        axes, origin = _move(axes, origin, row.after)
        if row.number != last:
            origin = origin + axes @ np.array([0.0, 0.0, row.thickness])
    return Layout(placed, steps, numbers, spaces, stop)


def _check(listing: Listing) -> None:
    first = listing.rows[0]
    if abs(first.thickness) < FAR:
        listing.refuse(first.line, "object distance", first.thickness, "is finite: beams here come from infinity",
                       f"give an object farther than {FAR:g} mm")  # fmt: skip
    if np.isfinite(first.thickness):
        text = f"object at {first.thickness:g} mm taken as infinitely far"
        listing.remark("substituted", first.line, "object distance", text)
    if sum(row.stop for row in listing.rows) > 1:
        listing.refuse(0, "stop", "several", "are stops", "mark one surface as the stop")


def _move(axes: Array, origin: Array, move: Move | None) -> tuple[Array, Array]:
    if move is None:
        return axes, origin
    turn, shift = move.matrices()
    return axes @ turn, origin + axes @ shift


def _glass(listing: Listing, row: Row, given: Mapping[str, str | float]) -> str | float:
    """What follows a row: "air", "mirror", a page or an index; a break or the image keeps what was there."""
    if row.medium is None:
        return "air"
    return "mirror" if row.medium == "mirror" else resolve(row.medium, listing, row.line, given)


def _surface(row: Row, axes: Array, origin: Array, forward: int, here: str) -> Placed:
    flipped = forward < 0
    curvature = -row.curvature if flipped else row.curvature
    return Placed(f"S{row.number}", row, axes @ TURNED if flipped else axes, origin, curvature, here, "", flipped,
                  "transmit")  # fmt: skip


def _same(a: Placed, b: Placed) -> bool:
    """The same piece of surface, met from either side."""
    facing = float(a.axes[:, 2] @ b.axes[:, 2])
    bent = abs(a.curvature - np.sign(facing) * b.curvature) <= 1e-12 and a.conic == b.conic
    near = np.linalg.norm(a.origin - b.origin) < SAME_PLACE
    # 1 − |cos| is the square of the angle, half: take the sine.
    return bool(near and bent and np.linalg.norm(np.cross(a.axes[:, 2], b.axes[:, 2])) < SAME_ANGLE)


def _meet(surface: Placed, glass: str | float, here: str, spaces: dict[str, str | float]) -> str:
    """Give a new surface what lies behind it; the space in which light goes on."""
    if glass == "mirror":
        surface.act = "reflect"
        return here
    name = f"{'gap' if glass == 'air' else 'glass'}{surface.row.number}"
    spaces[name] = glass
    surface.after = name
    return name


def _again(
    listing: Listing, old: Placed, row: Row, glass: str | float, here: str, spaces: dict[str, str | float]
) -> str:
    """A surface that light meets again: the space in which it goes on. Raises InputError if the media do not fit."""
    act = "reflect" if glass == "mirror" else "transmit"
    other = old.after if here == old.before else old.before
    if act != old.act or here not in (old.before, old.after) or (act == "transmit" and spaces.get(other) != glass):
        listing.refuse(row.line, "surface", row.number, f"coincides with {old.name} and does something else there",
                       "move one of them by a micrometre, or make them one")  # fmt: skip
    text = f"surface {row.number} is {old.name} again: one surface, met twice"
    listing.remark("substituted", row.line, "surface", text)
    return here if act == "reflect" else other
