"""What a sequential lens file says, in millimetres and degrees, before it becomes an instrument."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.optics.system import rotation

Array = NDArray[np.float64]
What = Literal["substituted", "dropped", "ignored", "beware"]

#: Millimetres per unit of length.
UNITS = {"mm": 1.0, "cm": 10.0, "in": 25.4, "m": 1000.0}


@dataclass(frozen=True)
class Remark:
    """One difference between the file and the instrument made of it.

    what: "substituted" (something else stands there), "dropped" (it had a meaning that is not carried over), "ignored"
    (it has no optical meaning), "beware" (it is carried over, and yet something will not be as expected); line of the
    file, 0 for something that is not in it; keyword, and the sentence.
    """

    what: What
    line: int
    keyword: str
    text: str

    def __str__(self) -> str:
        place = f"line {self.line}, {self.keyword}" if self.line else self.keyword
        return f"{self.what}: {place}: {self.text}"


@dataclass(frozen=True)
class Move:
    """A change of axes: shift (3,) mm and right-handed angles (3,) deg about x, the new y, the new z.

    turn_first: rotate about z, y, x in that order and then shift, both in reverse of the usual order.
    """

    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_first: bool = False

    def matrices(self) -> tuple[Array, Array]:
        """Rotation (3, 3; columns are the new axes in the old ones) and shift (3,) of the origin in the old ones."""
        shift = np.array(self.shift)
        if not self.turn_first:
            return rotation(self.angles), shift
        ax, ay, az = self.angles
        turned = rotation((0.0, 0.0, az)) @ rotation((0.0, ay, 0.0)) @ rotation((ax, 0.0, 0.0))
        return turned, turned @ shift

    def inverse(self) -> Move:
        """The move that undoes this one."""
        sx, sy, sz = self.shift
        ax, ay, az = self.angles
        return Move((-sx, -sy, -sz), (-ax, -ay, -az), not self.turn_first)


@dataclass(frozen=True)
class Glass:
    """A glass by name, or a model glass by index at 587.56 nm and Abbe number; catalogues the file allows."""

    name: str
    index: float | None = None
    abbe: float | None = None
    catalogues: tuple[str, ...] = ()


@dataclass(frozen=True)
class Opening:
    """A clear aperture: radius mm, or half widths (x, y) mm; its centre (x, y) mm in the surface's frame."""

    radius: float | None = None
    half: tuple[float, float] | None = None
    centre: tuple[float, float] = (0.0, 0.0)
    exact: bool = True


@dataclass(frozen=True)
class Row:
    """One surface of the file.

    medium: what follows, None for air, or "mirror". before: change of axes before it, kept; own: for it alone; after:
    behind it. origin: number of the surface in whose axes it is placed instead. breaks: axes only, no surface.
    """

    number: int
    line: int
    curvature: float = 0.0
    conic: float = 0.0
    thickness: float = 0.0
    medium: Glass | Literal["mirror"] | None = None
    stop: bool = False
    opening: Opening | None = None
    before: Move | None = None
    own: Move | None = None
    after: Move | None = None
    origin: int | None = None
    breaks: bool = False

    def with_(self, **values: object) -> Row:
        """The row with other values."""
        return replace(self, **values)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Field:
    """A field point: angles (x, y) in degrees, and vignetting: the pupil that gets through, low and high edge in units
    of its radius, along x and y."""

    angle: tuple[float, float]
    pupil_x: tuple[float, float] = (-1.0, 1.0)
    pupil_y: tuple[float, float] = (-1.0, 1.0)


@dataclass
class Listing:
    """A lens file in short. Rows run from the object to the image.

    aperture: kind ("diameter", "f-number", "na", "stop") and its value (mm or a number). fields: angles in degrees, or
    paraxial image heights in mm if ``heights``. wavelengths in nm, ``primary`` the number of the reference one. solve:
    the image stands by a solve (line) at the paraxial focus, and this much (mm) behind it.
    """

    file: str
    name: str = ""
    rows: list[Row] = field(default_factory=list)
    aperture: tuple[str, float] | None = None
    fields: list[Field] = field(default_factory=list)
    heights: bool = False
    wavelengths: list[float] = field(default_factory=list)
    primary: int = 0
    solve: tuple[int, float] | None = None
    remarks: list[Remark] = field(default_factory=list)

    def remark(self, what: What, line: int, keyword: str, text: str) -> None:
        """Note a difference."""
        self.remarks.append(Remark(what, line, keyword, text))

    def refuse(self, line: int, keyword: str, value: object, problem: str, remedy: str) -> NoReturn:
        """Raise InputError for a line of the file."""
        refuse(self.file, line, keyword, value, problem, remedy)


def refuse(file: str, line: int, keyword: str, value: object, problem: str, remedy: str) -> NoReturn:
    """Raise InputError that names line, keyword and value."""
    raise InputError(file, f"line {line}: {keyword}" if line else keyword, value, problem, remedy)


def number(file: str, line: int, keyword: str, text: str) -> float:
    """A number of the file. Raises InputError if it is none, or not finite (infinity is written out in lens files)."""
    try:
        value = float(text.replace("D", "E").replace("d", "e"))
    except ValueError:
        refuse(file, line, keyword, text, "is not a number", "write a number there")
    if not np.isfinite(value):
        refuse(file, line, keyword, text, "is not a finite number", "write a finite number there")
    return value
