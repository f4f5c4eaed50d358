"""An instrument resolved for one band: surfaces with world poses, spaces with glasses, field points. SI units."""

from __future__ import annotations

import copy
import hashlib
import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.optics import glass
from cgi_wave.optics.checks import check_document, check_frames, check_geometry
from cgi_wave.optics.coatings import CoatingTable, coating_table
from cgi_wave.optics.schema import (
    BandSpec,
    CoatingSpec,
    FileSpec,
    FrameSpec,
    InstrumentSpec,
    Nominal,
    Setting,
    SurfaceSpec,
    convert,
    convert_resolved,
    read_document,
)

REFERENCE = Path(__file__).parent.parent / "data" / "reference.toml"
MM, UM, NM = 1e-3, 1e-6, 1e-9


@dataclass(frozen=True)
class Surface:
    """One surface in the world.

    rotation (3, 3): rows are the local axes in world axes; origin (3,): vertex, m; curvature 1/m;
    aperture (5,): kind (1 circle, 2 rectangle), half width x, y, centre x, y in m; before, after: indices of the spaces
    on the local −z and +z side, −1 for nothing; reverse, tables: see ``face``.
    """

    name: str
    nominal: Nominal
    curvature: float
    conic: float
    rotation: NDArray[np.float64]
    origin: NDArray[np.float64]
    aperture: NDArray[np.float64]
    coating: CoatingSpec
    before: int
    after: int
    reverse: CoatingSpec
    tables: tuple[CoatingTable | None, CoatingTable | None]

    def face(self, side: int) -> tuple[CoatingSpec, CoatingTable | None]:
        """The coating that light meets from the local −z side (0) or from +z (1), and its table if it has one."""
        return (self.reverse if side else self.coating), self.tables[side]

    def sag(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height z of the surface over local (x, y), m."""
        r2 = x * x + y * y
        root = np.sqrt(np.maximum(1.0 - (1.0 + self.conic) * self.curvature**2 * r2, 0.0))
        return self.curvature * r2 / (1.0 + root)


@dataclass(frozen=True, eq=False)
class OpticalSystem:
    """What the tracer needs to know of one band of one instrument. Compared by identity, so that it can be a key."""

    instrument: str
    band: str
    file: str
    surfaces: tuple[Surface, ...]
    spaces: tuple[str, ...]
    glasses: tuple[str | float, ...]
    spec: BandSpec
    document: InstrumentSpec

    @cached_property
    def number(self) -> dict[str, int]:
        """Surface name → index."""
        return {surface.name: i for i, surface in enumerate(self.surfaces)}

    @property
    def detector(self) -> int:
        """Index of the recording surface."""
        return self.number[self.document.detector.surface]

    @property
    def pixel(self) -> float:
        """Pixel pitch, m."""
        return self.document.detector.pixel_um * UM

    @property
    def sigma0(self) -> float:
        """Wavenumber at the filter's centre, 1/m."""
        return 1.0 / (self.spec.filter.centre_nm * NM)

    @property
    def pupil_radius(self) -> float:
        """Radius of the entrance pupil, m."""
        return self.document.entrance.radius_mm * MM

    @lru_cache(maxsize=64)  # noqa: B019  (a handful of systems live as long as the process)
    def index(self, sigma: float) -> NDArray[np.float64]:
        """Refractive index of each space at wavenumber sigma (1/m)."""
        return glass.indices(list(self.glasses), sigma, self.file)

    def zone(self) -> tuple[float, float, float, float]:
        """The band's zone on the detector: x_min, x_max, y_min, y_max in m (pixel edges)."""
        det = self.document.detector
        c0, c1 = self.spec.zone_columns or (0, det.columns)
        r0, r1 = self.spec.zone_rows
        return tuple(  # type: ignore[return-value]
            (edge - 0.5 * size) * self.pixel
            for edge, size in ((c0, det.columns), (c1, det.columns), (r0, det.rows), (r1, det.rows))
        )

    def field_points(self) -> NDArray[np.float64]:
        """Five detector points: the zone's centre and (±f, ±f) of its half sizes; (5, 2) in m."""
        x0, x1, y0, y1 = self.zone()
        f = self.spec.field_fraction
        offsets = np.array([(0, 0), (-f, -f), (f, -f), (-f, f), (f, f)], dtype=float)
        return np.array([(x0 + x1) / 2, (y0 + y1) / 2]) + offsets * np.array([(x1 - x0) / 2, (y1 - y0) / 2])

    def pupil_frame(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Entrance pupil: rotation (rows are its axes in the world) and centre (m)."""
        entrance = self.document.entrance
        return rotation(entrance.rotate_deg).T, np.array(entrance.at_mm) * MM


def rotation(angles_deg: tuple[float, float, float]) -> NDArray[np.float64]:
    """Rotation matrix Rx·Ry·Rz (columns are the new axes in the old ones) of intrinsic angles in degrees."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians(angles_deg)), np.sin(np.radians(angles_deg))
    rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return rx @ ry @ rz


@dataclass(frozen=True)
class Instrument:
    """A checked instrument file. ``band(name)`` resolves it."""

    file: str
    document: FileSpec
    raw: dict[str, Any]

    @property
    def name(self) -> str:
        """The instrument's own name."""
        return self.document.name

    @property
    def bands(self) -> tuple[str, ...]:
        """Band names in file order."""
        return tuple(self.document.band)

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the file's content (not of its spelling): first 16 hexadecimal digits."""
        return hashlib.sha256(json.dumps(self.raw, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def channels(self) -> dict[str, tuple[str, ...]]:
        """Bands of each channel, in file order; ``{"": bands}`` for a file without channels."""
        names = tuple(self.document.channel) or ("",)
        return {name: tuple(b for b, spec in self.document.band.items() if (spec.channel or "") == name)
                for name in names}  # fmt: skip

    def with_values(self, values: dict[str, Setting], band: str | None = None) -> Instrument:
        """A new instrument with dotted fields replaced ("surface.field", "frame.field"), in one band or everywhere."""
        raw = copy.deepcopy(self.raw)
        if band is None:
            _apply(raw, values, self.file)
        else:
            raw["band"][band].setdefault("set", {}).update(values)
        return from_document(raw, self.file)

    def band(self, name: str) -> OpticalSystem:
        """Resolve one band. Raises InputError for an unknown band or values that make no instrument."""
        if name not in self.document.band:
            raise InputError(self.file, "band", name, "is not in the file", f"choose from {', '.join(self.bands)}")
        return self._resolve(name, self._values(name))

    def other_light(self, name: str, source: str) -> OpticalSystem:
        """Band ``name``'s optics and detector in the light of band ``source`` of another channel.

        Wavelengths and filter are those of ``source``, and so are the coatings that its channel sets: what a dichroic
        is to that light. Raises InputError as ``band`` does.
        """
        self.band(source)
        own, other = self.document.band[name], self.document.band[source]
        raw = copy.deepcopy(self.raw)
        raw["band"][name] |= {key: raw["band"][source][key] for key in ("filter", "wavelengths_nm")}
        instrument = Instrument(self.file, convert(raw, self.file), raw)
        coatings: list[tuple[str, dict[str, Setting]]] = []
        if other.channel is not None and other.channel != own.channel:
            values = self.document.channel[other.channel].set
            coatings = [(f"channel.{other.channel}.set", {k: v for k, v in values.items() if k.endswith(".coating")})]
        return instrument._resolve(name, self._values(name) + coatings)

    def _values(self, name: str) -> list[tuple[str, dict[str, Setting]]]:
        """What a band sets, and where: its channel's values first."""
        spec = self.document.band[name]
        shared = (
            [] if spec.channel is None else [(f"channel.{spec.channel}.set", self.document.channel[spec.channel].set)]
        )
        return [*shared, (f"band.{name}.set", spec.set)]

    def _resolve(self, name: str, values: list[tuple[str, dict[str, Setting]]]) -> OpticalSystem:
        raw = copy.deepcopy(self.raw)
        channel = self.document.band[name].channel
        if channel is not None:
            raw |= {part: v for part, v in raw["channel"][channel].items() if part in ("detector", "interferometer")}
        for where, settings in values:
            _apply(raw, settings, self.file, where)
        document = convert_resolved(raw, self.file)
        check_frames(document, self.file)  # again: ``set`` may have written anything into them
        names = list(document.space)
        surfaces = tuple(_place(document, names, self.file))
        _check_tables(surfaces, self.document.band[name], self.file)
        check_geometry(document, surfaces, self.file)
        pages = tuple(_glass_page(document, space, self.file) for space in names)
        return OpticalSystem(self.name, name, self.file, surfaces, tuple(names), pages, document.band[name], document)


def load_instrument(path: str | Path | None = None) -> Instrument:
    """Read and check an instrument file (the reference instrument if ``path`` is None). Raises InputError."""
    file = Path(path) if path is not None else REFERENCE
    return from_document(read_document(file), str(file))


def from_document(raw: dict[str, Any], file: str = "(document)") -> Instrument:
    """Check plain data (as parsed from TOML) and make an instrument of it. Raises InputError."""
    document = convert(raw, file)
    check_document(document, file)
    instrument = Instrument(file, document, raw)
    for band in instrument.bands:
        system = instrument.band(band)
        for nm in system.spec.wavelengths_nm:
            system.index(1.0 / (nm * NM))
    return instrument


def _glass_page(document: InstrumentSpec, space: str, file: str) -> str | float:
    name = document.space[space]
    if name == "air":
        return 1.0
    if name not in document.glass:
        raise InputError(
            file,
            f"space.{space}",
            name,
            "is an unknown glass",
            f"declare it in [glass]; there are: {', '.join(document.glass)}",
        )
    return document.glass[name]


def _apply(raw: dict[str, Any], values: dict[str, Setting], file: str, where: str = "set") -> None:
    """Write dotted values into plain data, in place."""
    targets: dict[str, dict[str, Any]] = {}
    for frame in raw["frame"]:
        targets[frame["name"]] = frame
        for surface in frame["surface"]:
            targets[surface["name"]] = surface
    for dotted, value in values.items():
        name, _, field = dotted.partition(".")
        known = {*SurfaceSpec.__struct_fields__, *FrameSpec.__struct_fields__} - {"name", "surface"}
        if name not in targets or field not in known:
            raise InputError(
                file, f"{where}.{dotted}", value, "names no surface or frame, or no field of one", "write surface.field"
            )
        targets[name][field] = list(value) if isinstance(value, list | tuple) else value


def _check_tables(surfaces: tuple[Surface, ...], band: BandSpec, file: str) -> None:
    """Refuse tables that do not hold the band, or that leave open what light from behind meets (InputError)."""
    for surface in surfaces:
        for table in {id(one): one for one in surface.tables if one is not None}.values():
            for nm in (min(band.wavelengths_nm), max(band.wavelengths_nm)):
                table.covers(1.0 / (nm * NM))
        front = surface.tables[0]
        if min(surface.before, surface.after) >= 0 and front and surface.coating.reverse is None:
            if not front.lossless:
                raise InputError(file, f"coating.{front.name}.reverse", None,
                                 f"is missing: the coating absorbs, and {surface.name} is met from both sides",
                                 "name the coating that light from behind meets, itself if it is alike")  # fmt: skip


def _place(document: InstrumentSpec, spaces: list[str], file: str) -> list[Surface]:
    """Give every surface its pose in the world; frames attach to surfaces that stand earlier in the file."""
    tables = {name: coating_table(name, coating, file) for name, coating in document.coating.items()}
    frames: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
    placed: list[Surface] = []
    number = {space: i for i, space in enumerate(spaces)} | {"": -1}
    for frame in document.frame:
        axes, origin = frames[frame.attach] if frame.attach else (np.eye(3), np.zeros(3))
        origin = origin + axes @ (np.array(frame.shift_mm) * MM)
        axes = axes @ rotation(frame.rotate_deg)
        z, before = frame.start_mm * MM, frame.before
        for spec in frame.surface:
            vertex = origin + axes @ np.array([spec.decentre_mm[0] * MM, spec.decentre_mm[1] * MM, z])
            local = axes @ rotation(spec.tilt_deg)
            curvature = 1.0 / (spec.radius_mm * MM) if spec.radius_mm else 0.0
            conic = spec.conic if spec.shape == "conic" else 0.0
            coating = document.coating[spec.coating]
            behind = coating.reverse or spec.coating
            placed.append(
                Surface(spec.name, spec.nominal, curvature, conic, local.T.copy(), vertex,
                        _aperture(spec), coating, number[before], number[spec.after],
                        document.coating[behind], (tables[spec.coating], tables[behind]))
            )  # fmt: skip
            frames[spec.name] = (axes, origin + axes @ np.array([0.0, 0.0, z]))
            z, before = z + spec.thickness_mm * MM, spec.after
    return placed


def _aperture(spec: SurfaceSpec) -> NDArray[np.float64]:
    ap = spec.aperture
    cx, cy = ap.centre_mm[0] * MM, ap.centre_mm[1] * MM
    if ap.radius_mm is not None:
        return np.array([1.0, ap.radius_mm * MM, ap.radius_mm * MM, cx, cy])
    assert ap.half_width_mm is not None  # check_document refuses an aperture with neither
    return np.array([2.0, ap.half_width_mm[0] * MM, ap.half_width_mm[1] * MM, cx, cy])


def describe(instrument: Instrument) -> dict[str, Any]:
    """The instrument's document as plain data (for provenance and for writing it back)."""
    plain: dict[str, Any] = msgspec.to_builtins(instrument.document)
    return plain
