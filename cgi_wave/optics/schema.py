"""The instrument file: what may stand in it, and what is refused.

Lengths end in ``_mm``, ``_um`` or ``_nm`` and angles in ``_deg``; everything becomes SI when a band is resolved.
A frame is a local axis system; its surfaces follow each other along its z with ``thickness_mm`` between vertices.
Rotations are intrinsic, about x, then the new y, then the new z; positive is right-handed.

A file describes one detector with its interferometer, or several channels that share a part of the surfaces. A band
belongs to one channel; resolved for that band (``system.Instrument.band``) the document is that of a file with this
channel alone.
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from cgi_wave.errors import InputError
from cgi_wave.optics.coatings import read_tables

Nominal = Literal["transmit", "reflect", "both", "absorb"]
#: What a ``set`` table may write into a field of a surface or a frame.
Setting = float | str | list[float]


class _Strict(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """Unknown fields are typing errors, and are refused."""


class Aperture(_Strict):
    """A circle (``radius_mm``) or a rectangle (``half_width_mm``), centred at ``centre_mm`` in the surface's frame."""

    radius_mm: float | None = None
    half_width_mm: tuple[float, float] | None = None
    centre_mm: tuple[float, float] = (0.0, 0.0)


class SurfaceSpec(_Strict):
    """One optical surface.

    ``after`` names the space behind it (local +z), "" if nothing is there; ``nominal`` is what light is meant to do.
    ``thickness_mm`` is the distance to the next vertex of the frame.
    """

    name: str
    after: str
    aperture: Aperture
    shape: Literal["plane", "sphere", "conic"] = "plane"
    radius_mm: float | None = None
    conic: float = 0.0
    thickness_mm: float = 0.0
    coating: str = "none"
    nominal: Nominal = "transmit"
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    decentre_mm: tuple[float, float] = (0.0, 0.0)


class FrameSpec(_Strict):
    """Surfaces along one axis. The frame starts from the frame of surface ``attach`` at that surface's vertex."""

    name: str
    before: str
    surface: list[SurfaceSpec]
    attach: str = ""
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotate_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    start_mm: float = 0.0


class ScatterSpec(_Strict):
    """Harvey's lobe about the specular direction: the share ``tis`` of what is reflected or transmitted at normal
    incidence goes as (1 + (|β − β0|/l)²)^(s/2), β in direction cosines."""

    tis: float
    width: float = msgspec.field(name="l")
    slope: float = msgspec.field(name="s")


class TableSpec(_Strict):
    """R and T over wavelength (rows) and angle of incidence (columns), here or in a CSV or NPZ ``file`` beside it.

    Without T, T = 1 − R − ``absorptance``. ``_s`` and ``_p``: for each polarisation, in place of the plain ones.
    """

    file: str | None = None
    wavelengths_nm: list[float] | None = None
    angles_deg: list[float] | None = None
    reflectance: list[list[float]] | None = None
    transmittance: list[list[float]] | None = None
    reflectance_s: list[list[float]] | None = None
    reflectance_p: list[list[float]] | None = None
    transmittance_s: list[list[float]] | None = None
    transmittance_p: list[list[float]] | None = None
    absorptance: float = 0.0


class CoatingSpec(_Strict):
    """Power reflectance and transmittance, and the phases that the amplitudes take.

    ``bare``: Fresnel; ``table``: in place of the numbers; ``reverse``: the coating that light from behind (local +z)
    meets, this one if not given; ``scatter``: what part of it is scattered.
    """

    reflectance: float = 0.0
    transmittance: float = 1.0
    reflect_phase_deg: float = 0.0
    transmit_phase_deg: float = 0.0
    bare: bool = False
    table: TableSpec | None = None
    reverse: str | None = None
    scatter: ScatterSpec | None = None


class EntranceSpec(_Strict):
    """Entrance pupil: a disc in world axes, light along its +z; rays start ``back_off_mm`` before it, in ``space``.

    ``altitude_km`` above the ground and ``focal_mm``, the image scale at the detector, say how large a pixel is there:
    only scenes ask for them.
    """

    space: str
    radius_mm: float
    back_off_mm: float
    at_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotate_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    half_field_deg: tuple[float, float] = (1.0, 1.0)
    altitude_km: float | None = None
    focal_mm: float | None = None


class DetectorSpec(_Strict):
    """The surface that records, its pixels, and which detector axis is the OPD axis (y)."""

    surface: str
    pixel_um: float
    columns: int
    rows: int


class ArmSpec(_Strict):
    """One arm of the interferometer: its surfaces from the splitter outwards, the mirror last."""

    surfaces: list[str]
    sloped: list[str] = []


class InterferometerSpec(_Strict):
    """Splitter and the two arms; ``sloped`` surfaces are the ones whose crossings the paper counts."""

    splitter: str
    arm1: ArmSpec
    arm2: ArmSpec


class FilterSpec(_Strict):
    """In-cone passband as a function of wavelength; its peak transmittance stands in the coating, not here."""

    centre_nm: float
    fwhm_nm: float
    shape: Literal["gaussian", "flat-top"] = "gaussian"


class SpectrumSpec(_Strict):
    """Scene radiance: ``solar`` (continuum), a gas before it (line by line), or a user's ``file``."""

    kind: Literal["solar", "o2a", "co2", "ch4", "file"]
    albedo: float = 0.3
    air_mass: float = 2.0
    file: str | None = None


class BandSpec(_Strict):
    """One band: its zone on the detector, wavelengths, filter, spectrum, and the values it sets in the instrument."""

    zone_rows: tuple[int, int]
    wavelengths_nm: list[float]
    filter: FilterSpec
    spectrum: SpectrumSpec
    target_opd_mm: float
    zone_columns: tuple[int, int] | None = None
    field_fraction: float = 0.8
    channel: str | None = None
    set: dict[str, Setting] = {}


class OutOfBandSpec(_Strict):
    """What a channel lets through of light that is none of its own; declared, not computed.

    ``filter_transmittance`` takes the place of that of the surface ``filter`` (a bandpass) over ``range_nm``;
    ``detector_response`` is per watt, relative to the response in the band.
    """

    filter: str
    filter_transmittance: float
    detector_response: float
    range_nm: tuple[float, float]


class ChannelSpec(_Strict):
    """One of several channels: its detector and interferometer, and the values set for every one of its bands."""

    detector: DetectorSpec | None = None
    interferometer: InterferometerSpec | None = None
    out_of_band: OutOfBandSpec | None = None
    set: dict[str, Setting] = {}


class FileSpec(_Strict):
    """A whole instrument file: either ``detector`` (and ``interferometer``) or ``channel`` stands in it."""

    name: str
    entrance: EntranceSpec
    frame: list[FrameSpec]
    band: dict[str, BandSpec]
    space: dict[str, str]
    coating: dict[str, CoatingSpec]
    detector: DetectorSpec | None = None
    interferometer: InterferometerSpec | None = None
    channel: dict[str, ChannelSpec] = {}
    glass: dict[str, str | float] = {}
    notes: list[str] = []


class InstrumentSpec(FileSpec):
    """An instrument file resolved for one band: ``detector`` and ``interferometer`` are those of its channel."""

    detector: DetectorSpec


_Spec = TypeVar("_Spec", bound=FileSpec)


def read_document(path: str | Path) -> dict[str, Any]:
    """Parse a TOML file into plain data. Raises InputError if it is unreadable, not TOML, or holds NaN or infinity."""
    name = str(path)
    try:
        document = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            name, "file", name, f"cannot be read ({error.strerror})", "name an existing TOML file"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(name, "file", name, f"is not TOML ({error})", "mend the line that is named") from error
    read_tables(document, Path(path))
    _refuse_non_finite(name, "", document)
    return document


def convert(document: dict[str, Any], file: str) -> FileSpec:
    """Plain data to a ``FileSpec`` of the right types; InputError names the field that does not fit."""
    return _convert(document, FileSpec, file)


def convert_resolved(document: dict[str, Any], file: str) -> InstrumentSpec:
    """Plain data with one detector to an ``InstrumentSpec``; InputError names the field that does not fit."""
    return _convert(document, InstrumentSpec, file)


def _convert(document: dict[str, Any], kind: type[_Spec], file: str) -> _Spec:
    try:
        return msgspec.convert(document, kind)
    except msgspec.ValidationError as error:
        text = str(error)
        problem, _, where = text.partition(" - at `$")
        field = where.rstrip("`").lstrip(".") or problem.partition("`")[2].partition("`")[0] or "(top level)"
        raise InputError(
            file, field, _value_at(document, field), problem, "see docs/instrument.md for the fields"
        ) from error


def _value_at(document: Any, field: str) -> object:
    """The value that stands at a dotted field, as far as it exists."""
    here = document
    for part in field.replace("[", ".").replace("]", "").split("."):
        if isinstance(here, dict) and part in here:
            here = here[part]
        elif isinstance(here, list) and part.isdigit() and int(part) < len(here):
            here = here[int(part)]
        else:
            return None
    return here if not isinstance(here, dict | list) else "(table)"


def _refuse_non_finite(file: str, field: str, value: object) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(file, field, value, "is not a finite number", "write a finite number")
    if isinstance(value, dict):
        for key, item in value.items():
            _refuse_non_finite(file, f"{field}.{key}".lstrip("."), item)
    if isinstance(value, list):
        for number, item in enumerate(value):
            _refuse_non_finite(file, f"{field}[{number}]", item)
