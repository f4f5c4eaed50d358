"""What could be done against ghosts: better coatings, tilted or shifted elements, other values in the file.

With constant coatings, another reflectance changes powers and nothing else: each path's by R′/R for every reflection
and T′/T for every transmission on the coating, the nominal beams' too. Then the terms of the interferogram are scaled
and the retrieval is done again, which is exact. Anything else is traced again from the beginning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.attribution import faces
from cgi_wave.errors import InputError
from cgi_wave.optics.alter import is_constant, members, moved, recoated
from cgi_wave.optics.schema import CoatingSpec
from cgi_wave.optics.system import Instrument, OpticalSystem, Surface
from cgi_wave.rays.paths import Path

Array = NDArray[np.float64]
Kind = Literal["coating", "surface", "tilt", "shift", "values"]

#: Degrees about x that an element is tilted by if nothing else is said.
TILTS_DEG = (0.1, 0.5, 1.0)


@dataclass(frozen=True)
class Remedy:
    """One change of a band.

    name, change: in words; surfaces: what is coated anew or moved; coatings: by surface; tilt_deg, shift_mm: see
    ``optics.alter.moved``; values: of the instrument file, "surface.field".
    """

    kind: Kind
    name: str
    change: str
    surfaces: tuple[str, ...]
    coatings: Mapping[str, CoatingSpec] | None = None
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    shift_mm: float = 0.0
    values: Mapping[str, float | list[float]] | None = None

    def apply(self, system: OpticalSystem, instrument: Instrument) -> OpticalSystem:
        """The changed band; instrument: the one that ``system`` was resolved from. Raises InputError."""
        if self.coatings is not None:
            return recoated(system, self.coatings)
        if self.values is not None:
            return instrument.with_values(dict(self.values), system.band).band(system.band)
        return moved(system, self.surfaces, self.tilt_deg, self.shift_mm)


@dataclass(frozen=True)
class Target:
    """What parasitic coefficients are brought to: ``value`` if it is given (where it is less), else times ``factor``.

    Raises InputError for a factor outside 0…1 or a value that is no reflectance.
    """

    factor: float = 0.5
    value: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.factor < 1.0:
            raise InputError("rank", "coating factor", self.factor, "improves nothing", "give 0 or more and below 1")
        if self.value is not None and not 0.0 <= self.value < 1.0:
            raise InputError("rank", "coating value", self.value, "is no reflectance", "give 0 or more and below 1")

    def of(self, now: float) -> float:
        """The coefficient aimed at, from the present one."""
        return self.factor * now if self.value is None else min(self.value, now)


def parasitic(system: OpticalSystem, surface: Surface) -> float | None:
    """The coefficient of a surface that makes ghosts: R where light is to pass or end, T where it is to be reflected.

    None where both are meant (a splitter). Of a bare face: at normal incidence. Raises InputError for a coating that
    gives no number.
    """
    coating = surface.coating
    if surface.nominal == "both":
        return None
    if is_constant(coating):
        return coating.transmittance if surface.nominal == "reflect" else coating.reflectance
    if coating.bare:
        index = system.index(system.sigma0)
        n1, n2 = index[surface.before], index[surface.after]
        return float(((n1 - n2) / (n1 + n2)) ** 2) if min(surface.before, surface.after) >= 0 else None
    return None


def better(system: OpticalSystem, surface: Surface, target: Target) -> CoatingSpec | None:
    """A constant coating with less of what makes ghosts; None if there is nothing to improve.

    What is no longer reflected is transmitted, and the other way round; at a face that absorbs, it is absorbed. A bare
    face gets a coating of its phase at the denser side.
    """
    now = parasitic(system, surface)
    if now is None or now <= 0.0 or target.of(now) >= now:
        return None
    coating, aimed = surface.coating, target.of(now)
    if coating.bare:
        return CoatingSpec(reflectance=aimed, transmittance=1.0 - aimed)
    if surface.nominal == "reflect":
        return _constant(coating, coating.reflectance + now - aimed, aimed)
    passed = coating.transmittance + (now - aimed if surface.nominal == "transmit" else 0.0)
    return _constant(coating, aimed, passed)


def _constant(coating: CoatingSpec, reflectance: float, transmittance: float) -> CoatingSpec:
    """A constant coating with the phases of another."""
    return CoatingSpec(
        reflectance=reflectance,
        transmittance=transmittance,
        reflect_phase_deg=coating.reflect_phase_deg,
        transmit_phase_deg=coating.transmit_phase_deg,
    )


def coating_remedies(system: OpticalSystem, paths: Sequence[Path], target: Target) -> tuple[Remedy, ...]:
    """Every coating of the file improved on all surfaces that have it, and every surface alone, if ghosts touch them.

    A coating that some surface needs as it is (a splitter's) is improved on the others.
    """
    touched = {name for path in paths for name in faces(path)}
    groups: dict[str, dict[str, CoatingSpec]] = {}
    alone: list[Remedy] = []
    named = {spec.name: spec.coating for frame in system.document.frame for spec in frame.surface}
    for surface in system.surfaces:
        new = better(system, surface, target) if surface.name in touched else None
        if new is None:
            continue
        groups.setdefault(named[surface.name], {})[surface.name] = new
        alone.append(_recoat("surface", surface.name, system, {surface.name: new}))
    # A coating on one surface only is that surface's remedy already.
    whole = [_recoat("coating", name, system, group) for name, group in groups.items() if len(group) > 1]
    return (*whole, *alone)


def _recoat(kind: Kind, name: str, system: OpticalSystem, coatings: Mapping[str, CoatingSpec]) -> Remedy:
    steps = []
    for surface, new in coatings.items():
        old = system.surfaces[system.number[surface]]
        letter = "T" if old.nominal == "reflect" else "R"
        now, then = parasitic(system, old), new.transmittance if letter == "T" else new.reflectance
        steps.append(f"{letter} {now:.3g} to {then:.3g}")
    return Remedy(kind, name, ", ".join(dict.fromkeys(steps)), tuple(coatings), coatings)


def tilt(system: OpticalSystem, name: str, about_x: float, about_y: float = 0.0) -> Remedy:
    """A surface, a body or a frame (``optics.alter.members``) tilted, in degrees. Raises InputError."""
    words = f"{about_x:g}° about x" if about_y == 0.0 else f"{about_x:g}°, {about_y:g}° about x, y"
    return Remedy("tilt", name, words, members(system, name), tilt_deg=(about_x, about_y))


def shift(system: OpticalSystem, name: str, millimetres: float) -> Remedy:
    """A surface, a body or a frame shifted along its own z. Raises InputError."""
    return Remedy("shift", name, f"{millimetres:+g} mm along z", members(system, name), shift_mm=millimetres)


def values(system: OpticalSystem, changed: Mapping[str, float | list[float]]) -> Remedy:
    """Other values of the instrument file, for this band. Raises InputError for a name that is not in it."""
    names = tuple(dict.fromkeys(s for field in changed for s in members(system, field.partition(".")[0])))
    text = ", ".join(f"{field} = {value}" for field, value in changed.items())
    return Remedy("values", "values", text, names, values=changed)


def scales_exactly(system: OpticalSystem, remedy: Remedy) -> bool:
    """Whether a remedy changes powers only, so that stored terms can be scaled: constant coatings of equal phase.

    A coefficient that was zero hides the paths on which it would act: those were never found.
    """
    if remedy.coatings is None:
        return False
    for name, new in remedy.coatings.items():
        old = system.surfaces[system.number[name]].coating
        if not (is_constant(old) and is_constant(new)):
            return False
        if (old.reflect_phase_deg, old.transmit_phase_deg) != (new.reflect_phase_deg, new.transmit_phase_deg):
            return False
        if (old.reflectance == 0.0 < new.reflectance) or (old.transmittance == 0.0 < new.transmittance):
            return False
    return True


def power_factors(system: OpticalSystem, paths: Sequence[Path], coatings: Mapping[str, CoatingSpec]) -> Array:
    """(B,) by what other constant coatings multiply the power of each path."""
    ratio = {}
    for name, new in coatings.items():
        old = system.surfaces[system.number[name]].coating
        for act, before, after in (
            ("reflect", old.reflectance, new.reflectance),
            ("transmit", old.transmittance, new.transmittance),
        ):
            if before > 0.0:
                ratio[name, act] = after / before
    return np.array([np.prod([ratio.get(step, 1.0) for step in path.steps]) for path in paths])


def between(old: CoatingSpec, new: CoatingSpec, share: float) -> CoatingSpec:
    """A constant coating on the straight way from one to another."""
    return _constant(
        old,
        old.reflectance + share * (new.reflectance - old.reflectance),
        old.transmittance + share * (new.transmittance - old.transmittance),
    )


def meets_otherwise(path: Path, nominal: Sequence[Path], surfaces: Sequence[str]) -> bool:
    """Whether a path meets some surfaces in another way, or more often, than every nominal path does."""

    def own(one: Path) -> list[tuple[str, str]]:
        return sorted(step for step in one.steps if step[0] in surfaces)

    return all(own(path) != own(other) for other in nominal)


def unimproved(system: OpticalSystem, paths: Sequence[Path], remedies: Sequence[Remedy]) -> dict[str, str]:
    """Surfaces that ghosts touch and that have no coating remedy, with the reason."""
    done = {name for remedy in remedies for name in remedy.surfaces}
    touched = {name for path in paths for name in faces(path)} - done
    reasons = {}
    for surface in system.surfaces:
        if surface.name in touched:
            now = parasitic(system, surface)
            reasons[surface.name] = (
                "its coating has no one coefficient" if now is None else f"{now:.3g} is at or below what is aimed at"
            )
    return reasons
