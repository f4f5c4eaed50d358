"""The PSF: against closed forms and a commercial program's listings, and its speed beside other programs'.

    uv run python -m validation.psf [--json] [--out DIR] [--listings FOLDER]

Closed forms: Airy's amplitude, the annulus, and the defocused disc by Lommel's series. Listings: Zemax's Huygens PSFs
in the tests of batoid, which are not part of this package: give the folder. Speed: the complex PSF of a circular pupil
of 512² samples on 256² points, one thread, everything in one run; ours starts from the field each time, the peers
from a prepared pupil. All the peers are given our gray mask, which is finer than their own.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests" / "wave"), str(HERE.parent / "tests" / "wave" / "methods")]

import numpy as np  # noqa: E402
from cases import bessel, lommel  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from cgi_wave.errors import CgiWaveError  # noqa: E402
from cgi_wave.report.output import to_json  # noqa: E402
from cgi_wave.wave.field import PupilField  # noqa: E402
from cgi_wave.wave.hopkins import HopkinsPair  # noqa: E402
from cgi_wave.wave.methods import nufft  # noqa: E402
from cgi_wave.wave.methods.fft import PrunedFft, edge_noise, transform  # noqa: E402
from cgi_wave.wave.methods.grid import Grid, covering, sampled, shares  # noqa: E402
from cgi_wave.wave.methods.matrix import ChirpZ, MatrixFourier  # noqa: E402
from cgi_wave.wave.methods.patch import Patch  # noqa: E402
from cgi_wave.wave.methods.propagation import choose_plane, to_detector  # noqa: E402
from cgi_wave.wave.methods.shape import beam_at, edge_of  # noqa: E402
from validation.psf_peers import CENTRED, PAD, POINTS, N, available  # noqa: E402
from validation.study_page import finite, save_figure, table, write_page  # noqa: E402

Array = NDArray[np.float64]
Row = dict[str, Any]
DEFOCUS = (1.25, 10.25, 60.3)
SAMPLES = (64, 128, 256, 512, 1024)
GOAL = 1e-6  # of the peak, against Airy: what ours has to reach in the race
REPEATS = 25


def exact(pair: HopkinsPair, patch: Patch) -> NDArray[np.complex128]:
    """The closed form of a disc or annulus without aberration, or of a defocused disc."""
    v = 2.0 * np.pi * np.hypot(patch.axis(0)[:, None], patch.axis(1)[None, :])
    if pair.w020:
        return np.pi * lommel(v, pair.w020)
    hole = pair.obscuration
    return np.pi * (bessel(v) - hole**2 * bessel(hole * v)).astype(complex)


def closed_forms() -> list[Row]:
    """Largest error over the peak of the unaberrated PSF, and its bound, of each method and each number of samples."""
    rows = []
    cases = {"Airy": HopkinsPair(), "annulus 0.4": HopkinsPair(obscuration=0.4)}
    cases |= {f"defocus {w:g}": HopkinsPair(w020=w) for w in DEFOCUS}
    for name, pair in cases.items():
        field = pair.pupil_fields()[0]
        side, pitch = 40, 0.43
        # About the axis, or across the edge of the spot, where the picture is richest.
        first = round(2.0 * pair.w020 / pitch) - side // 2
        patch = Patch((first, -side // 2), (side, side), (pitch, pitch))
        want, peak = exact(pair, patch), field.power_at(np.array([1.0]))[0]
        for eps in (1e-6, 1e-12):
            found = nufft.amplitude(field, patch, 1.0, eps)
            rows.append(_row(name, f"NUFFT, eps {eps:g}", found.nodes, found.field, want, found.error, peak))
        rows += [r for n in SAMPLES for r in _sampled(name, field, patch, want, peak, n)]
        rows += [r for n in SAMPLES for r in _fresnel(name, pair, field, peak, n)]
    return rows


def _row(case: str, method: str, nodes: int, h: Any, want: Any, bound: float, peak: float) -> Row:
    error = float(np.abs(h - want).max()) / peak
    return {"case": case, "method": method, "nodes": nodes, "error": error, "bound": float(bound) / peak}


def _sampled(case: str, field: PupilField, patch: Patch, want: Any, peak: float, n: int) -> list[Row]:
    beam, edge = beam_at(field, 1.0), edge_of(field)
    size = round(n / (2.0 * patch.pitch[0]))
    if size < patch.count[0]:
        return []
    pitch = (1.0 / (size * patch.pitch[0]),) * 2
    grid = covering(edge.u.min(axis=0), edge.u.max(axis=0), pitch)
    bound = edge_noise(beam, edge, grid, patch)
    share = shares([beam.support], grid)
    rows = []
    for mask, edge_kind in ((share, "gray"), ((share >= 0.5).astype(float), "binary")):
        for method in (PrunedFft(), MatrixFourier(), ChirpZ()) if edge_kind == "gray" else (PrunedFft(),):
            h = method.amplitude(beam, grid, mask, patch).field * beam.constant
            promised = bound if edge_kind == "gray" else np.inf
            rows.append(_row(case, f"{method.name}, {edge_kind}", n * n, h, want, promised, peak))
    return rows


def _fresnel(case: str, pair: HopkinsPair, field: PupilField, peak: float, n: int) -> list[Row]:
    beam, edge = beam_at(field, 1.0), edge_of(field)
    try:
        plane = choose_plane((beam,), (edge,), 2.0 / n)
        h = to_detector(beam, edge, plane, 24)
    except CgiWaveError:
        return []
    patch = Patch((-12, -12), (24, 24), (plane.pitch, plane.pitch))
    return [_row(case, "Fresnel propagation", n * n, h.field * beam.constant, exact(pair, patch), np.inf, peak)]


def fastest(call: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Least seconds of a call."""
    call()
    best = np.inf
    for _ in range(repeats):
        started = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - started)
    return best


def race() -> list[Row]:
    """Seconds and error over the peak, against Airy, of ours and of each peer; interleaved in one process."""
    field = HopkinsPair().pupil_fields()[1]
    beam = beam_at(field, 1.0)
    pitch = N / (2.0 * PAD)
    patch = Patch((-POINTS // 2, -POINTS // 2), (POINTS, POINTS), (pitch, pitch))
    cell = 2.0 / N
    grid = covering(np.full(2, -1.0), np.full(2, 1.0), (cell, cell))
    share = shares([beam.support], grid)
    samples = sampled(beam, grid, share)
    pupil = _between(beam)
    entries: list[tuple[str, Callable[[], Any], Array, str, str]] = []
    for eps in (1e-5, 1e-6, 1e-9, 1e-12):

        def ours(eps: float = eps) -> Any:
            return nufft.amplitude(field, patch, 1.0, eps).field

        entries.append((f"NUFFT of Gauss rings, eps {eps:g}", ours, CENTRED, "ours", ""))  # fmt: skip
    entries.append(
        ("pruned FFT in blocks, transform alone", lambda: transform(samples, 1.0, grid, patch, (PAD, PAD)), CENTRED,
         "ours", "")
    )  # fmt: skip
    for name, call, points, reason in available(pupil):
        entries.append((name, call or (lambda: None), points, "peer", reason))
    rows: list[dict[str, Any]] = []
    for name, call, points, side, reason in entries:
        if reason:
            rows.append({"what": name, "side": side, "seconds": None, "error": None, "note": reason})
            continue
        v = 2.0 * np.pi * np.hypot(points[:, None], points[None, :])
        # Moduli: the peers put their own phases on the amplitude.
        h = np.abs(call())
        error = float(np.abs(h / h.max() * np.abs(bessel(v)).max() - np.abs(bessel(v))).max())
        rows.append({"what": name, "side": side, "seconds": np.inf, "error": error, "note": ""})
    for _ in range(3):  # rounds, so that a busy moment does not hit one of them alone
        for row, entry in zip(rows, entries, strict=True):
            if row["error"] is not None:
                row["seconds"] = min(row["seconds"], fastest(entry[1], REPEATS // 3))
    return rows


def _between(beam: Any) -> Array:
    """Share of N × N cells that cover the disc exactly: the pupil that the peers are given."""
    # Cells whose corners, not centres, lie on the axis: the disc is moved by half a cell.
    cell = 2.0 / N
    moved = replace(beam.support, centre=beam.support.centre - 0.5 * cell)
    return shares([moved], Grid((cell, cell), (-N // 2, -N // 2), (N, N)))


def study(out: Path | None = None, listings: Path | None = None) -> dict[str, Any]:
    """All figures of the study; writes ``out/psf.md`` and its plots where ``out`` is given."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        forms, speed = closed_forms(), race()
    good = [r["seconds"] for r in speed if r["side"] == "ours" and r["error"] is not None and r["error"] <= GOAL]
    peers = {r["what"]: r["seconds"] for r in speed if r["side"] == "peer" and r["seconds"] is not None}
    best = min(peers, key=lambda name: peers[name])
    violations = sum(r["error"] > r["bound"] for r in forms)
    found: dict[str, Any] = {
        "psf_speedup_vs_best_peer": peers[best] / min(good),
        "psf_best_peer": best,
        "psf_ours_ms": 1e3 * min(good),
        "psf_best_peer_ms": 1e3 * peers[best],
        "psf_goal": GOAL,
        "bound_violations": int(violations),
        "comparisons": len(forms),
        "closed_forms": forms,
        "speed": speed,
        "listings": [],
        "listings_note": "no folder given: clone batoid and name its tests/testdata",
    }
    if listings is not None:
        from validation.psf_listings import compare

        found["listings"] = compare(listings)
        found["listings_note"] = "" if any(r["rms"] is not None for r in found["listings"]) else "none in the folder"
    if out is not None:
        _page(out, found)
    return found


def _page(out: Path, found: dict[str, Any]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    cases = list(dict.fromkeys(r["case"] for r in found["closed_forms"]))
    figure, axes = plt.subplots(1, len(cases), figsize=(4.2 * len(cases), 4), sharey=True)
    for ax, case in zip(axes, cases, strict=True):
        rows = [r for r in found["closed_forms"] if r["case"] == case]
        for method in dict.fromkeys(r["method"] for r in rows):
            part = [r for r in rows if r["method"] == method]
            ax.loglog([r["nodes"] for r in part], [r["error"] for r in part], "o-", ms=3, label=method)
        ax.set(title=case, xlabel="samples or nodes")
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("largest error / peak without aberration")
    axes[-1].legend(fontsize=6)
    errors = save_figure(figure, out, "psf-errors")
    figure, ax = plt.subplots(figsize=(7, 4.5))
    for row in found["speed"]:
        if row["seconds"] is None:
            continue
        mark = "o" if row["side"] == "ours" else "s"
        ax.loglog(row["seconds"] * 1e3, max(row["error"], 1e-16), mark, color="C0" if row["side"] == "ours" else "C1")
        ax.annotate(row["what"], (row["seconds"] * 1e3, max(row["error"], 1e-16)), fontsize=6)
    ax.set(xlabel="ms, one thread", ylabel="largest error / peak against Airy", title="512² pupil to 256² points")
    ax.grid(alpha=0.3)
    speed = save_figure(figure, out, "psf-speed")
    listed = table(found["listings"]) if found["listings"] else found["listings_note"] + "\n"
    write_page(
        out,
        "psf",
        [
            "# The PSF\n",
            f"{found['comparisons']} comparisons with closed forms, {found['bound_violations']} beyond their bound.\n",
            errors,
            table(found["closed_forms"]),
            "## Speed\n",
            f"Ours at an error of at most {GOAL:g}: {found['psf_ours_ms']:.2f} ms, the field as input each time. The "
            f"fastest peer, {found['psf_best_peer']}: {found['psf_best_peer_ms']:.2f} ms, its pupil prepared. "
            f"Ratio {found['psf_speedup_vs_best_peer']:.2f}. The sampled edge sets the error of every grid.\n",
            speed,
            table(found["speed"]),
            "## Listings\n",
            listed,
        ],
    )


def main() -> None:
    """Print the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.add_argument("--out", type=Path, help="folder for the page and its plots")
    parser.add_argument("--listings", type=Path, help="folder with Zemax's listings")
    options = parser.parse_args()
    found = study(options.out, options.listings)
    if options.json:
        print(to_json(finite(found)))
        return
    print(table(found["closed_forms"]))
    print(table(found["speed"]))
    print(table(found["listings"]) if found["listings"] else found["listings_note"])
    for name in ("bound_violations", "psf_ours_ms", "psf_best_peer", "psf_best_peer_ms", "psf_speedup_vs_best_peer"):
        print(f"{name}: {found[name]}")


if __name__ == "__main__":
    main()
