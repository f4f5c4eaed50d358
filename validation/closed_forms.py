"""The chain beside closed forms, on traced rays: the tests' cases, with more distances, all field points, both bands.

    uv run python -m validation.closed_forms [--json]

Prints our value, the closed form, their difference, and what the difference may be: the error bound of a contrast, or
what the blur of the traced spots allows (see docs/validation.md).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path as File
from typing import Any

import numpy as np

TESTS = File(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS / "budget"), str(TESTS / "rays")]

import chain_cases as cases  # noqa: E402

from cgi_wave.budget.pointfields import direction_field  # noqa: E402
from cgi_wave.budget.setting import band_setting  # noqa: E402
from cgi_wave.errors import CgiWaveError  # noqa: E402
from cgi_wave.fringes.nma import nma_error_exact  # noqa: E402
from cgi_wave.optics.system import load_instrument  # noqa: E402
from cgi_wave.rays.beams import nominal_direction, spot  # noqa: E402
from cgi_wave.rays.paths import find_paths, parse_path  # noqa: E402
from cgi_wave.report.output import to_json  # noqa: E402
from cgi_wave.wave.field import power  # noqa: E402

Row = dict[str, Any]
AXIS = np.zeros(2)
GAPS = (0.2, 0.5, 1.0, 2.0, 4.0)
#: What J may differ from the mean over displacements on the detector: fringes lie at two sloped faces, not in a plane.
FRINGES = 2.5e-3


def row(case: str, quantity: str, ours: float, closed: float, allowed: float) -> Row:
    """One line of the table; allowed: absolute."""
    return {"case": case, "quantity": quantity, "ours": float(ours), "closed_form": float(closed),
            "difference": float(ours - closed), "allowed": float(allowed)}  # fmt: skip


def retro_ghosts(instrument: Any, name: str) -> Iterator[Row]:
    """The detector's retro-ghost at five field points, with the right and with the wrong phase of the splitter."""
    system = instrument.band(name)
    setting, paths = band_setting(system), find_paths(system, max_order=1)
    wrong = cases.with_splitter_phase(instrument, 0.0, name)
    family = cases.family(paths, cases.own(system, "detector"))
    ghost = next(path for path in family if path.label.endswith("arms 1-2"))
    rt2 = cases.retro_power(instrument)
    for number, x0 in enumerate(system.field_points()):
        got = cases.account(system, setting, family, x0)
        other = cases.account(wrong, setting, family, x0).retrieval.coherent
        off = cases.displacement(system, ghost, paths[0], x0)
        nominal = np.sqrt(2 * (1 - abs(got.gamma("nominal arms 1", "nominal arms 2"))))
        phase = 2 * np.pi * off.std() / got.fringe_period + nominal
        loss = 0.5 * phase**2 + 2e-4
        case, right = f"{name} detector, field {number + 1}", got.retrieval.coherent
        yield row(case, "O/B", right.offset_over_baseline.value, rt2 / 4, loss * rt2 / 4)
        yield row(case, "M*/M", right.parasitic_over_modulation.value, 0.0, loss * rt2 / 2)
        yield row(case, "2nd/M", right.second_over_modulation, rt2 / 4, 4 * loss * rt2 / 4)
        yield row(case, "NMA error", right.nma_error.value, nma_error_exact(0, rt2 / 4), 3 * loss * rt2 / 4)
        yield row(f"{case}, wrong phase", "O/B", other.offset_over_baseline.value, 0.75 * rt2, loss * rt2)
        yield row(f"{case}, wrong phase", "M*/M", other.parasitic_over_modulation.value, rt2, loss * rt2)


def filter_faces(instrument: Any, name: str) -> Iterator[Row]:
    """The filter face's retro-ghost at several distances from the detector, at the zone's centre."""
    system = instrument.band(name)
    setting, paths = band_setting(system), find_paths(system, max_order=1)
    front, detector = cases.own(system, "filter_front"), cases.own(system, "detector")
    ghost = next(path for path in paths if path.label == f"{detector}:r arms 1-2")
    off = cases.displacement(system, ghost, paths[0], system.field_points()[0])
    half = cases.face_power(instrument) / 2
    for gap in GAPS:
        moved = cases.filter_at(instrument, name, gap)
        got = cases.account(moved, setting, cases.family(paths, front))
        want = cases.filter_face(instrument, moved, paths[0], got.fringe_period)
        nominal = np.sqrt(2 * (1 - abs(got.gamma("nominal arms 1", "nominal arms 2"))))
        slack = 0.37 * 2 * (2 * np.pi * off.std() / got.fringe_period + nominal)
        case, coherent = f"{name} filter, d = {want.distance * 1e3:.3f} mm", got.retrieval.coherent
        j = -got.gamma(f"{front}:r arms 1-2", f"{front}:r arms 2-1").real
        face = next(path for path in paths if path.label == f"{front}:r arms 1-2")
        blur = cases.displacement(moved, face, paths[0], moved.field_points()[0])
        rays = abs(np.exp(2j * np.pi * blur / got.fringe_period).mean())
        yield row(case, "J", j, want.j, slack)
        yield row(case, "|J|, traced blur", abs(j), rays, FRINGES)
        yield row(case, "O/B", coherent.offset_over_baseline.value, want.offset, half * (slack / 2 + 1e-3))
        yield row(case, "M*/M", coherent.parasitic_over_modulation.value, want.parasitic, half * (slack + 1e-3))


def contrasts() -> Iterator[Row]:
    """The plate's ghost and pure defocus behind a parabola; γ beside J."""
    for plate in (0.0125, 0.02, 0.05, 0.1, 0.3, 1.0, 3.0):
        system = cases.parabola(plate)
        paths = [parse_path(system, text) for text in (cases.PLATE_GHOST, cases.NOMINAL)]
        value, bound = cases.contrast(*(direction_field(system, path, AXIS, AXIS) for path in paths), system.sigma0)
        want = cases.radial(system, cases.plate_path(plate))
        yield from complex_rows(f"plate {plate} mm", value, want, bound)
        if plate <= 0.1:
            j, _ = cases.contrast(*(cases.pupil_field(system, path, AXIS, AXIS) for path in paths), system.sigma0)
            yield row(f"plate {plate} mm", "|J| beside |γ|", abs(j), abs(value), 6e-3)
    sharp = cases.parabola(0.05)
    reference = direction_field(sharp, parse_path(sharp, cases.NOMINAL), AXIS, AXIS)
    for defocus in (0.02, 0.1, 0.33, 0.5, 1.0):
        system = cases.parabola(0.05, defocus_mm=defocus)
        blurred = direction_field(system, parse_path(system, cases.NOMINAL), AXIS, AXIS)
        value, bound = cases.contrast(blurred, reference, sharp.sigma0)
        distance = defocus * 1e-3
        want = cases.radial(sharp, lambda angle, distance=distance: distance * np.cos(angle))
        yield from complex_rows(f"defocus {defocus} mm", value, want, bound)


def complex_rows(case: str, value: complex, want: complex, bound: float) -> Iterator[Row]:
    """Modulus, and the size of the complex difference."""
    yield row(case, "|γ|", abs(value), abs(want), bound)
    yield row(case, "|γ − closed form|", abs(value - want), 0.0, bound)


def energy(instrument: Any, name: str) -> Iterator[Row]:
    """Power of the field over directions beside that of the spot, and over the pupil beside random landings."""
    system = instrument.band(name)
    paths = find_paths(system, min_power=1e-7)
    x0 = system.field_points()[0]
    theta, area = nominal_direction(system, paths[0], x0), np.pi * system.pupil_radius**2
    first, second = ([path for path in paths if path.order == order] for order in (1, 2))
    for path in [*paths[:2], *first[:40:4], *second[:160:16]]:
        try:
            here, relative = power(direction_field(system, path, theta, x0))
        except CgiWaveError:
            continue
        rays = spot(system, path, theta, system.sigma0, 4000)
        edge = 0.0 if len(rays.x) > 3800 else 0.9 * np.sqrt(2 * np.sqrt(np.pi * len(rays.x))) / len(rays.x)
        case = f"{name} {path.label}"
        yield row(case, "∫|Â|² / spot's power − 1", here[0] / area / rays.power - 1, 0.0, relative + edge)
    for path in [paths[0], *first[:20:4], *second[:60:12]]:
        try:
            field = cases.pupil_field(system, path, x0, theta)
        except CgiWaveError:
            continue
        landed, spread = cases.landing_power(system, path, x0, 4e-4, 400_000)
        if spread < 0.05:
            case = f"{name} {path.label}"
            yield row(case, "J_mm / random landings − 1", power(field)[0][0] / landed - 1, 0.0, 4 * spread)


def study() -> list[Row]:
    """Every row."""
    instrument = load_instrument()
    rows = list(contrasts())
    for name in instrument.bands:
        rows += [*retro_ghosts(instrument, name), *filter_faces(instrument, name), *energy(instrument, name)]
    return rows


def main() -> None:
    """Print the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    arguments = parser.parse_args()
    rows = study()
    outside = [line for line in rows if abs(line["difference"]) > line["allowed"]]
    if arguments.json:
        print(to_json({"rows": rows, "outside": len(outside)}))
        return
    print(f"{'':44s} {'':26s} {'ours':>12s} {'closed form':>12s} {'difference':>11s} {'allowed':>9s}")
    for line in rows:
        mark = " <" if line in outside else ""
        print(f"{line['case']:44s} {line['quantity']:26s} {line['ours']:12.6g} {line['closed_form']:12.6g} "
              f"{line['difference']:+11.1e} {line['allowed']:9.1e}{mark}")  # fmt: skip
    print(f"{len(rows)} comparisons, {len(outside)} outside what is allowed")


if __name__ == "__main__":
    main()
