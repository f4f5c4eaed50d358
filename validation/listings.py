"""Published ray listings and other tracers beside ours: CODE V, Zemax, optiland, rayoptics.

    uv run --group validation python -m validation.listings [--json] [--lenses DIR]
    uv run --group validation python -m validation.listings --extract FILE.lis --radius MM

* CODE V's single-ray listings of a double Gauss and of a tilted three-mirror telescope, every ray, every figure. The
  lenses are imported from their prescriptions, so that the import is checked with the tracer.
* Zemax's ghost-focus listing of its Cooke triplet.
* If installed (``uv run --group validation --with optiland --with rayoptics …``): every two-reflection ghost of a
  Cooke triplet and of a double Gauss beside optiland's sequences, and imported lens files beside optiland and
  rayoptics. With ``--lenses DIR`` every lens file of that folder, too, such as those in rayoptics' own tests; what the
  import refuses is listed with the reason.

``--extract`` reads the rays out of a CODE V listing and prints them as the tests store them.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path as File
from typing import Any

import numpy as np
from scipy.optimize import linprog

from cgi_wave.errors import InputError
from cgi_wave.lensfile.load import import_lens
from cgi_wave.report.output import to_json
from validation import listing_codev, listing_cooke, listing_peers
from validation.listing_codev import COLUMNS, ULP, Array, Lens

DATA = File(__file__).parents[1] / "tests" / "data"
#: Stored listing: surface and r⁴ coefficient that the import leaves out.
LISTINGS: dict[str, tuple[str, float] | None] = {
    "codev_double_gauss": None,
    "codev_three_mirror": ("S5", 0.368950e-10),
}
#: Lens files of our own for round trips: peers that can read them.
FILES = {
    "codev_double_gauss.seq": ("rayoptics",),
    "import_folded.seq": ("rayoptics",),
    "import_tilted.zmx": ("rayoptics",),
}
#: Half a unit of the last printed digit, and what a printed half may be rounded to.
HALF = 0.5 + 1e-6
#: A prescription's values, by how they stand in a file, and half of their last printed digit.
LAST = {"YDE": 5e-7, "ADE": 5e-7, "K": 5e-7}
LAST_RADIUS, LAST_THICKNESS, LAST_R4 = 5e-6, 5e-7, 5e-17


def residuals(lens: Lens, fields: list[dict[str, Any]], radius: float) -> tuple[Array, Array]:
    """Ours less the listing's, in units of the last digit: rows (M, 8), image points of chief rays and fans (F, 2)."""
    rows, ends = [], []
    for field in fields:
        tangent = listing_codev.tangent_of(field)
        centre = listing_codev.chief(lens, tangent)
        chief = listing_codev.follow(lens, centre, tangent)
        ends.append((chief["image"] - field["image"]) / 1e-6)
        for ray in field["rays"]:
            start = centre + np.array(ray["pupil"]) * radius
            own = listing_codev.follow(lens, start, tangent)["rows"]
            printed = np.array(ray["rows"])
            if len(printed) > len(own):  # a plane before the lens, which import leaves out
                first = np.zeros(8)
                first[:2] = (start - printed[0, :2]) / 1e-6
                rows.append(first[None])
                printed = printed[1:]
            rows.append((own - printed) / ULP)
        for x, y, dx, dy, _ in field["fan"]:
            end = listing_codev.follow(lens, centre + np.array([x, y]) * radius, tangent)["image"]
            ends.append((end - chief["image"] - [dx, dy]) / 1e-6)
    return np.concatenate(rows), np.array(ends)


def codev(name: str) -> dict[str, Any]:
    """A stored listing beside our rays."""
    document = json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))
    fields, radius = document["fields"], document["pupil_radius_mm"]
    lens = listing_codev.load(DATA / f"{name}.seq", LISTINGS[name])
    rows, ends = residuals(lens, fields, radius)
    figures = np.concatenate([rows.ravel(), ends.ravel()])
    waves = []
    for field in fields:
        own = listing_codev.opd(lens, field, radius, listing_codev.tangent_of(field))
        waves.append(own - np.array([line[4] for line in field["fan"]]))
    apart = np.abs(np.concatenate(waves)) / 1e-3
    found: dict[str, Any] = {
        "listing": name, "source": document["source"], "fields": len(fields),
        "rays": sum(len(field["rays"]) + len(field["fan"]) for field in fields), "figures": len(figures),
        "agree": int((np.abs(figures) <= HALF).sum()),
        "worst_units": {key: float(np.abs(rows[:, k]).max()) for k, key in enumerate(COLUMNS)}
        | {"image": float(np.abs(ends).max())},
        "opd_figures": len(apart), "opd_agree": int((apart <= 1.0).sum()), "opd_worst_waves": float(apart.max() * 1e-3),
    }  # fmt: skip
    if LISTINGS[name]:
        found |= rounded(name, fields, radius, figures)
    return found


def rounded(name: str, fields: list[dict[str, Any]], radius: float, figures: Array) -> dict[str, Any]:
    """Whether a prescription that rounds to the printed one has every ray agree with every printed digit.

    The listing's program knew its lens to more digits than it printed. How the figures follow each printed value is
    found by small differences; a linear programme then looks for values within half of their last digit.
    """
    text = (DATA / f"{name}.seq").read_text(encoding="utf-8")
    values = _values(text)
    columns = []
    asphere = LISTINGS[name]
    assert asphere is not None
    for place, value, half in values:
        moved = text[: place[0]] + repr(value + 20 * half) + text[place[1] :]
        columns.append((_figures(moved, fields, radius, asphere) - figures) / 20)
    more = (asphere[0], asphere[1] + 20 * LAST_R4)
    columns.append((_figures(text, fields, radius, more) - figures) / 20)
    by = np.column_stack(columns)
    # Least t with |figures + by·s| ≤ t and |s| ≤ 1 for every value's half digit.
    count = by.shape[1]
    limit = np.block([[by, -np.ones((len(figures), 1))], [-by, -np.ones((len(figures), 1))]])
    found = linprog(
        np.append(np.zeros(count), 1.0), A_ub=limit, b_ub=np.concatenate([-figures, figures]),
        bounds=[(-1.0, 1.0)] * count + [(0.0, None)],
    )  # fmt: skip
    return {"values_of_the_prescription": count, "least_worst_units": float(found.fun)}


def _figures(text: str, fields: list[dict[str, Any]], radius: float, asphere: tuple[str, float]) -> Array:
    lens = listing_codev.load_text(text, asphere)
    rows, ends = residuals(lens, fields, radius)
    return np.concatenate([rows.ravel(), ends.ravel()])


def _values(text: str) -> list[tuple[tuple[int, int], float, float]]:
    """Place, value and half of the last digit of every number of a prescription that was rounded."""
    import re

    found = []
    for match in re.finditer(r"\b(YDE|ADE|K) (-?\d+\.\d+)", text):
        found.append((match.span(2), float(match[2]), LAST[match[1]]))
    for match in re.finditer(r"^(?:S|SI) (-?\d+\.\d+) (-?\d+\.\d+)", text, re.MULTILINE):
        if float(match[1]):
            found.append((match.span(1), float(match[1]), LAST_RADIUS))
        if float(match[2]) and not float(match[2]).is_integer():
            found.append((match.span(2), float(match[2]), LAST_THICKNESS))
    return found


def peers(folder: File | None) -> dict[str, Any]:
    """What the installed peers say."""
    versions = {name: listing_peers.installed(name) for name in ("optiland", "rayoptics")}
    found: dict[str, Any] = {"versions": versions, "ghosts": [], "round_trips": [], "refused": [], "peer_failed": []}
    if versions["optiland"]:
        found["ghosts"] = [listing_peers.ghosts(name, 2000) for name in listing_peers.BUNDLES]
    files: list[tuple[File, tuple[str, ...]]] = [(DATA / name, names) for name, names in FILES.items()]
    if folder:
        some = sorted(f for f in folder.iterdir() if f.suffix.lower() in (".seq", ".zmx"))
        files += [(f, ("rayoptics", "optiland") if f.suffix.lower() == ".zmx" else ("rayoptics",)) for f in some]
    for file, names in files:
        try:
            imported = import_lens(file, primary_only=True)
        except InputError as refusal:
            found["refused"].append({"file": file.name, "field": refusal.field, "problem": refusal.problem})
            continue
        for peer in names:
            if not versions[peer]:
                continue
            try:
                found["round_trips"].append(listing_peers.round_trip(imported, peer))
            except Exception as failure:  # a peer may stumble over anything
                found["peer_failed"].append({"file": file.name, "peer": peer, "failure": repr(failure)[:200]})
    return found


def study(folder: File | None = None) -> dict[str, Any]:
    """Everything as plain data."""
    return {"codev": [codev(name) for name in LISTINGS], "zemax": listing_cooke.study(), "peers": peers(folder)}


def main() -> None:
    """Print the study, or the rays of a listing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.add_argument("--lenses", type=File, metavar="DIR", help="lens files to take round, too")
    parser.add_argument("--extract", type=File, metavar="FILE.lis", help="print the rays of a CODE V listing")
    parser.add_argument("--radius", type=float, metavar="MM", help="radius of the entrance pupil, for --extract")
    arguments = parser.parse_args()
    if arguments.extract:
        fields = listing_codev.extract(arguments.extract.read_text(encoding="latin-1"), arguments.radius)
        source = f"CODE V listing {arguments.extract.name}; figures only, by validation/listings.py --extract"
        document = {"source": source, "columns": list(COLUMNS), "pupil_radius_mm": arguments.radius, "fields": fields}
        print(to_json(document))
        return
    result = study(arguments.lenses)
    if arguments.json:
        print(to_json(result))
        return
    print("\n".join(lines(result)))


def lines(result: dict[str, Any]) -> list[str]:
    """The study in words."""
    out = []
    for part in result["codev"]:
        out.append(f"{part['listing']}: {part['rays']} rays in {part['fields']} fields, {part['agree']} of "
                   f"{part['figures']} figures to the last printed digit")  # fmt: skip
        out.append("  worst, units of it: " + ", ".join(f"{k} {v:.2f}" for k, v in part["worst_units"].items()))
        out.append(f"  OPD: {part['opd_agree']} of {part['opd_figures']} within 0.001 waves, "
                   f"worst {part['opd_worst_waves']:.4f}")  # fmt: skip
        if "least_worst_units" in part:
            out.append(f"  with the {part['values_of_the_prescription']} rounded values of the prescription free "
                       f"within half a digit: {part['least_worst_units']:.3f}")  # fmt: skip
    zemax = result["zemax"]
    shift = ", ".join(f"{glass} {value:+.1e}" for glass, value in zemax["index_shift"].items())
    out.append(f"Zemax, Cooke ghost 2-1: {zemax['figures']} figures, worst {zemax['worst_units']:.2f} units of the "
               f"last digit, {zemax['f_numbers_apart_worst_units']:.2f} without F-numbers, "
               f"{zemax['worst_units_fitted']:.2f} with indices changed by {shift}")  # fmt: skip
    others = result["peers"]
    out.append(
        "peers: " + ", ".join(f"{name} {version or 'not installed'}" for name, version in others["versions"].items())
    )
    for part in others["ghosts"]:
        out.append(f"  optiland, {part['lens']}: {part['ghosts']} ghosts, {part['alive']} alive, survivors differ "
                   f"{part['survivors_differ']}, x {part['worst_x_m']:.1e} m, power {part['worst_power']:.1e}, path "
                   f"{part['worst_opl_m']:.1e} m")  # fmt: skip
    for part in others["round_trips"]:
        out.append(f"  {part['peer']:9s} {part['file']:32s} {part['rays']} rays, {part['surfaces']} surfaces, largest "
                   f"{part['largest_mm']:.1e} mm, relative {part['relative']:.1e}{part['left_out']}")  # fmt: skip
    out += [f"  refused   {part['file']:32s} {part['field']}: {part['problem']}" for part in others["refused"]]
    out += [
        f"  {part['peer']:9s} {part['file']:32s} failed itself: {part['failure']}" for part in others["peer_failed"]
    ]
    return out


if __name__ == "__main__":
    main()
