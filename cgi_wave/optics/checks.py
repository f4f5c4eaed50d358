"""What the schema's types cannot say: references that lead nowhere, values that make no instrument."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from cgi_wave.errors import InputError
from cgi_wave.optics.schema import (
    DetectorSpec,
    FileSpec,
    InstrumentSpec,
    InterferometerSpec,
    OutOfBandSpec,
    SurfaceSpec,
)

if TYPE_CHECKING:
    from cgi_wave.optics.system import Surface

#: Two faces of one element may touch at the rim, but not cross by more than this (m).
CROSSING = 1e-6


def check_document(document: FileSpec, file: str) -> None:
    """Refuse an instrument whose parts do not refer to each other, or whose values are out of range (InputError)."""

    def refuse(field: str, value: object, problem: str, remedy: str) -> NoReturn:
        raise InputError(file, field, value, problem, remedy)

    seen = check_frames(document, file)
    for name, coating in document.coating.items():
        total = coating.reflectance + coating.transmittance
        if min(coating.reflectance, coating.transmittance) < 0 or total > 1 + 1e-12:
            refuse(f"coating.{name}", total, "is not 0 ≤ R, T and R + T ≤ 1", "mend reflectance or transmittance")
        if coating.reverse is not None and coating.reverse not in document.coating:
            refuse(f"coating.{name}.reverse", coating.reverse, "is an unknown coating",
                   f"choose from {', '.join(document.coating)}")  # fmt: skip
        if coating.table is not None and coating.bare:
            refuse(f"coating.{name}.bare", True, "stands beside a table", "remove one of them")
        lobe = coating.scatter
        if lobe and not (0.0 <= lobe.tis <= 0.5 and lobe.width > 0.0 and -8.0 <= lobe.slope <= 0.0):
            problem = "is no scattering lobe"
            refuse(f"coating.{name}.scatter", (lobe.tis, lobe.width, lobe.slope), problem,
                   "give tis from 0 to 0.5, l above 0, s from -8 to 0")  # fmt: skip
    if document.entrance.space not in document.space:
        refuse("entrance.space", document.entrance.space, "is an unknown space", "declare it in [space]")
    if document.entrance.radius_mm <= 0:
        refuse("entrance.radius_mm", document.entrance.radius_mm, "is not positive", "give the pupil's radius")
    _check_channels(document, seen, refuse)
    _check_bands(document, refuse)


def check_frames(document: FileSpec, file: str) -> set[str]:
    """Refuse frames and surfaces that refer to nothing or have no sense (InputError); the names of all surfaces."""

    def refuse(field: str, value: object, problem: str, remedy: str) -> NoReturn:
        raise InputError(file, field, value, problem, remedy)

    seen: set[str] = set()
    for frame in document.frame:
        where = f"frame.{frame.name}"
        if frame.attach and frame.attach not in seen:
            refuse(
                f"{where}.attach", frame.attach, "names no surface that stands earlier", "attach to an earlier surface"
            )
        if frame.before and frame.before not in document.space:
            refuse(
                f"{where}.before",
                frame.before,
                "is an unknown space",
                f"declare it in [space]: {', '.join(document.space)}",
            )
        if not frame.surface:
            refuse(f"{where}.surface", [], "is empty", "list at least one surface")
        for spec in frame.surface:
            if spec.name in seen:
                refuse(f"{where}.surface", spec.name, "is used twice", "give every surface its own name")
            seen.add(spec.name)
            _check_surface(document, spec, f"{where}.surface.{spec.name}", refuse)
    return seen


def _check_surface(document: FileSpec, spec: SurfaceSpec, where: str, refuse) -> None:  # type: ignore[no-untyped-def]
    if spec.after and spec.after not in document.space:
        refuse(
            f"{where}.after", spec.after, "is an unknown space", f"declare it in [space]: {', '.join(document.space)}"
        )
    if spec.coating not in document.coating:
        refuse(f"{where}.coating", spec.coating, "is an unknown coating", f"declare it: {', '.join(document.coating)}")
    if spec.shape != "plane" and not spec.radius_mm:
        refuse(f"{where}.radius_mm", spec.radius_mm, f"a {spec.shape} needs a radius other than 0", "give radius_mm")
    if spec.shape == "plane" and spec.radius_mm is not None:
        refuse(f"{where}.radius_mm", spec.radius_mm, "a plane has no radius", 'remove it, or write shape = "sphere"')
    if spec.thickness_mm < 0:
        refuse(f"{where}.thickness_mm", spec.thickness_mm, "is negative: surfaces out of order",
               "list the surfaces along z; light that turns back needs a frame of its own")  # fmt: skip
    ap = spec.aperture
    sizes = [ap.radius_mm] if ap.radius_mm is not None else list(ap.half_width_mm or [])
    if (ap.radius_mm is None) == (ap.half_width_mm is None) or min(sizes, default=0.0) <= 0:
        refuse(
            f"{where}.aperture",
            sizes,
            "is neither a circle nor a rectangle",
            "give radius_mm or half_width_mm, positive",
        )
    if spec.radius_mm and spec.shape != "plane":
        # Beyond this height the conic has no sag: a sphere cannot reach its aperture.
        x, y = (sizes * 2)[:2]
        corner = (0.0, 0.0) if ap.radius_mm else (x, y)
        outer = [abs(centre) + half for centre, half in zip(ap.centre_mm, corner, strict=True)]
        reach = max(math.hypot(*outer), math.hypot(*ap.centre_mm) + (ap.radius_mm or 0.0))
        if (1 + spec.conic) * (reach / spec.radius_mm) ** 2 >= 1:
            refuse(f"{where}.aperture", reach, f"reaches beyond the surface of radius {spec.radius_mm} mm", "reduce it")


def _check_channels(document: FileSpec, seen: set[str], refuse) -> None:  # type: ignore[no-untyped-def]
    """One detector at the top of the file, or channels with one each; every splitter belongs to an interferometer."""
    single = document.detector, document.interferometer
    if document.channel:
        for field, value in zip(("detector", "interferometer"), single, strict=True):
            if value is not None:
                refuse(field, "(table)", "stands beside [channel]", f"move it to [channel.NAME.{field}]")
    elif document.detector is None:
        refuse("detector", None, "is missing", "declare [detector], or [channel.NAME.detector] for each channel")
    parts: dict[str, tuple[DetectorSpec | None, InterferometerSpec | None]] = {"": single}
    if document.channel:
        parts = {f"channel.{name}.": (part.detector, part.interferometer) for name, part in document.channel.items()}
    splitters: set[str] = set()
    for where, (detector, interferometer) in parts.items():
        if detector is None:
            refuse(f"{where}detector", None, "is missing", "declare it; each channel has a detector of its own")
        elif detector.surface not in seen:
            refuse(f"{where}detector.surface", detector.surface, "is no surface", "name the recording surface")
        if interferometer is not None:
            splitters.add(interferometer.splitter)
            _check_interferometer(interferometer, f"{where}interferometer", seen, refuse)
    for name, channel in document.channel.items():
        if channel.out_of_band is not None:
            _check_out_of_band(channel.out_of_band, f"channel.{name}.out_of_band", seen, refuse)
    for spec in (spec for frame in document.frame for spec in frame.surface):
        if spec.nominal == "both" and spec.name not in splitters:
            lacking = [where for where, (_, inter) in parts.items() if inter is None]
            if lacking:
                refuse(f"{lacking[0]}interferometer", None, "is missing although a surface splits",
                       "declare splitter, arm1 and arm2")  # fmt: skip
            refuse(f"{spec.name}.nominal", spec.nominal, "splits, but is the splitter of no interferometer",
                   "name it as a splitter, or let it transmit or reflect")  # fmt: skip


def _check_out_of_band(spec: OutOfBandSpec, where: str, seen: set[str], refuse) -> None:  # type: ignore[no-untyped-def]
    if spec.filter not in seen:
        refuse(f"{where}.filter", spec.filter, "is no surface", "name the surface with the bandpass")
    for field in ("filter_transmittance", "detector_response"):
        value = getattr(spec, field)
        if not 0 <= value <= 1:
            refuse(f"{where}.{field}", value, "is not between 0 and 1", "give a share")
    if not 0 < spec.range_nm[0] < spec.range_nm[1]:
        refuse(f"{where}.range_nm", spec.range_nm, "is no range", "give two wavelengths, the shorter one first")


def _check_interferometer(inter: InterferometerSpec, where: str, seen: set[str], refuse) -> None:  # type: ignore[no-untyped-def]
    if inter.splitter not in seen:
        refuse(f"{where}.splitter", inter.splitter, "is no surface", "name the splitting surface")
    for name, arm in (("arm1", inter.arm1), ("arm2", inter.arm2)):
        if not arm.surfaces:
            refuse(f"{where}.{name}.surfaces", [], "an arm is missing", "list its surfaces, the mirror last")
        for surface in (*arm.surfaces, *arm.sloped):
            if surface not in seen:
                refuse(f"{where}.{name}", surface, "is no surface", "list surfaces of the file")


def _detector_of(document: FileSpec, band: str, refuse) -> DetectorSpec:  # type: ignore[no-untyped-def]
    """The detector that a band is recorded with; _check_channels has seen to it that there is one."""
    name, detectors = document.band[band].channel, {key: part.detector for key, part in document.channel.items()}
    choice = ", ".join(detectors)
    if not detectors:
        if name is not None:
            refuse(f"band.{band}.channel", name, "is an unknown channel: the file has none",
                   "remove it, or declare [channel.NAME]")  # fmt: skip
        found = document.detector
    elif name is None:
        refuse(f"band.{band}.channel", None, "is missing in a file with channels", f"choose from {choice}")
    elif name not in detectors:
        refuse(f"band.{band}.channel", name, "is an unknown channel", f"choose from {choice}")
    else:
        found = detectors[name]
    assert found is not None
    return found


def _check_bands(document: FileSpec, refuse) -> None:  # type: ignore[no-untyped-def]
    if not document.band:
        refuse("band", {}, "is empty", "declare at least one band")
    for name, band in document.band.items():
        detector = _detector_of(document, name, refuse)
        r0, r1 = band.zone_rows
        if not 0 <= r0 < r1 <= detector.rows:
            refuse(
                f"band.{name}.zone_rows",
                band.zone_rows,
                "is no zone of the detector",
                f"stay in 0 to {detector.rows}",
            )
        if not band.wavelengths_nm or min(band.wavelengths_nm) <= 0:
            refuse(
                f"band.{name}.wavelengths_nm", band.wavelengths_nm, "are not positive", "give vacuum wavelengths in nm"
            )
        if band.filter.fwhm_nm <= 0 or band.filter.centre_nm <= 0:
            refuse(f"band.{name}.filter", band.filter.fwhm_nm, "is no filter", "give positive centre_nm and fwhm_nm")
        low, high = min(band.wavelengths_nm), max(band.wavelengths_nm)
        if not low - 1e-9 <= band.filter.centre_nm <= high + 1e-9:
            problem = f"lies outside the band's spectrum {low} to {high} nm"
            remedy = "move the filter or extend wavelengths_nm"
            refuse(f"band.{name}.filter.centre_nm", band.filter.centre_nm, problem, remedy)


def check_geometry(document: InstrumentSpec, surfaces: tuple[Surface, ...], file: str) -> None:
    """Refuse neighbouring faces of one frame that cross inside the smaller of their apertures (InputError)."""
    by_name = {surface.name: surface for surface in surfaces}
    angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    for frame in document.frame:
        for first, second in zip(frame.surface[:-1], frame.surface[1:], strict=True):
            a, b = by_name[first.name], by_name[second.name]
            radius = min(a.aperture[1], b.aperture[1], a.aperture[2], b.aperture[2])
            x = np.concatenate([radius * np.cos(angle), [0.0]])
            y = np.concatenate([radius * np.sin(angle), [0.0]])
            point_a = a.origin + np.stack([x, y, a.sag(x, y)], axis=1) @ a.rotation
            local_b = (point_a - b.origin) @ b.rotation.T
            gap = b.sag(local_b[:, 0], local_b[:, 1]) - local_b[:, 2]
            if gap.min() < -CROSSING:
                raise InputError(file, f"frame.{frame.name}.surface.{first.name}.thickness_mm", first.thickness_mm,
                                 f"crosses {second.name} by {-gap.min() * 1e3:.3f} mm inside the aperture",
                                 "increase the thickness or reduce the apertures")  # fmt: skip
