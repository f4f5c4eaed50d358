"""Where methods fail: error over defocus, aberration, shear, obscuration and sampling, with the law of each border.

    uv run python -m validation.failures [--json] [--out DIR] [--cases N]

The maps take the methods without their guards, at samplings that a user might choose, and ask where the complex error
of γ (or of the PSF) exceeds 1e-3 of its modulus (of its peak). Truth is sinc's closed form for pure defocus, else the
boundary-fitted quadrature at 1e-9. ``agreement`` of a map is the share of its points that its law puts on the right
side. Then the guarded methods are tried on random pairs: ``violations`` counts errors beyond the bound that came with
the result, and ``broken_promises`` bounds beyond the one promised beforehand.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests" / "wave"), str(HERE.parent / "tests" / "wave" / "methods")]

import numpy as np  # noqa: E402
from cases import defocus, quadrature  # noqa: E402

from cgi_wave.errors import CgiWaveError  # noqa: E402
from cgi_wave.report.output import to_json  # noqa: E402
from cgi_wave.wave.hopkins import HopkinsPair  # noqa: E402
from cgi_wave.wave.methods.fft import PrunedFft, WindowFft  # noqa: E402
from cgi_wave.wave.methods.geometric import geometric_overlap  # noqa: E402
from cgi_wave.wave.methods.incoherent import incoherent_overlap  # noqa: E402
from cgi_wave.wave.methods.matrix import ChirpZ, MatrixFourier  # noqa: E402
from cgi_wave.wave.methods.nufft import Nufft  # noqa: E402
from cgi_wave.wave.methods.propagation import Fresnel  # noqa: E402
from validation.failures_maps import EXPECTED, Map, all_maps  # noqa: E402
from validation.study_page import finite, save_figure, table, write_page  # noqa: E402


def imitations() -> list[dict[str, float]]:
    """Overlaps without phase in the place of |γ|: by what factor they are too large, and what their laws say."""
    rows = []
    for w in (0.3, 1.25, 4.3, 10.25, 30.25, 100.25):
        m, l = HopkinsPair(w020=w).pupil_fields()  # noqa: E741
        size = abs(defocus(w))
        spots = geometric_overlap(m, HopkinsPair(w020=0.5).pupil_fields()[0], 1.0)
        loose = incoherent_overlap(m, l, 1.0, 1e-2)
        rows.append(
            {
                "W020 / waves": w,
                "|γ|": size,
                "incoherent / |γ|": loose.value / size,
                "0.57/√W over |sinc W|": 0.57 / np.sqrt(w) / size,
                "spots, nominal of half a wave / |γ|": spots.value / size,
            }
        )
    return rows


def trials(cases: int, seed: int = 4) -> list[dict[str, Any]]:
    """Guarded methods on random pairs: errors beyond bounds, bounds beyond promises, refusals."""
    rng = np.random.default_rng(seed)
    methods = [WindowFft(), Fresnel(), PrunedFft(), ChirpZ(), MatrixFourier(), Nufft()]
    rows: dict[str, dict[str, Any]] = {
        m.name: {"method": m.name, "computed": 0, "violations": 0, "broken_promises": 0, "refused": 0, "ratios": []}
        for m in methods
    }
    for _ in range(cases):
        pair = _random_pair(rng)
        m, l = pair.pupil_fields()  # noqa: E741
        try:
            exact, own = quadrature(m, l)
        except CgiWaveError:
            continue
        for method in methods:
            row, tol = rows[method.name], float(10.0 ** rng.uniform(-2.7, -1.0))
            if method.cost(m, l, 1.0, tol) > 3e8:
                row["refused"] += 1
                continue
            found = method.evaluate(m, l, 1.0, tol)
            error = abs(found.value - exact)
            row["computed"] += 1
            row["violations"] += error > found.error_bound + own
            row["broken_promises"] += found.error_bound > method.error_bound(m, l, 1.0, tol) * (1.0 + 1e-9)
            row["ratios"].append(found.error_bound / max(error, 1e-15))
    for row in rows.values():
        ratios = row.pop("ratios")
        row["bound / error, median"] = float(np.median(ratios)) if ratios else None
    return list(rows.values())


def _random_pair(rng: np.random.Generator) -> HopkinsPair:
    w = float(10.0 ** rng.uniform(-1.0, 1.5) * rng.choice([-1.0, 1.0]))
    others = w * rng.uniform(0.0, 0.1) * rng.normal(size=3)
    shear = float(rng.choice([0.0, 10.0 ** rng.uniform(-4.0, 0.25)]))
    angle = rng.uniform(0.0, 2.0 * np.pi)
    w040, w131, w222 = map(float, others)
    return HopkinsPair(
        w, w040, w131, w222, w111=float(3.0 * rng.normal() * rng.integers(2)),
        obscuration=float(rng.choice([0.0, rng.uniform(0.05, 0.9)])), shift_x=shear * float(np.cos(angle)),
        shift_y=shear * float(np.sin(angle)),
    )  # fmt: skip


def study(out: Path | None = None, cases: int = 60) -> dict[str, Any]:
    """All figures of the study; writes ``out/failures.md`` and its plots where ``out`` is given."""
    maps = all_maps()
    guarded, loose = trials(cases), imitations()
    found: dict[str, Any] = {
        "expected": EXPECTED,
        "violations": int(sum(row["violations"] for row in guarded)),
        "broken_promises": int(sum(row["broken_promises"] for row in guarded)),
        "computed": int(sum(row["computed"] for row in guarded)),
        "agreement": {m.name: m.agreement for m in maps},
        "guarded": guarded,
        "imitations": loose,
        "maps": [_plain(m) for m in maps],
    }
    if out is not None:
        _page(out, maps, found)
    return found


def _plain(m: Map) -> dict[str, Any]:
    return {
        "name": m.name,
        "method": m.method,
        m.x_name: list(m.x),
        m.y_name: list(m.y),
        "relative_error": [[None if np.isnan(v) else float(v) for v in row] for row in m.error],
        "laws": {name: [float(v) if np.isfinite(v) else None for v in border] for name, border in m.laws.items()},
        "agreement": m.agreement,
    }


def _page(out: Path, maps: Sequence[Map], found: dict[str, Any]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    parts = [
        "# Where methods fail\n",
        f"Relative error above {EXPECTED:g} is failure. Guarded, on random pairs: {found['violations']} errors beyond "
        f"their bound and {found['broken_promises']} bounds beyond their promise in {found['computed']} results.\n",
        table(found["guarded"]),
        "## Overlaps without phase in the place of |γ|\n",
        table(found["imitations"]),
    ]
    for number, m in enumerate(maps):
        figure, ax = plt.subplots(figsize=(6, 4.2))
        x = np.arange(len(m.x))
        shown = np.log10(np.clip(m.error, 1e-8, 10.0))
        mesh = ax.pcolormesh(x, m.y, shown, cmap="RdYlGn_r", vmin=-6.0, vmax=0.0, shading="nearest")
        figure.colorbar(mesh, label="log₁₀ relative error")
        failing = np.where(np.isnan(m.error), 0.0, m.error > EXPECTED)
        ax.contour(x, m.y, failing, levels=[0.5], colors="k", linewidths=1.5)
        for law, style in zip(m.laws, ("b-", "b--", "b:"), strict=False):
            ax.plot(x, m.laws[law], style, label=law)
        ax.set(yscale="log", ylim=(min(m.y), max(m.y)), xlabel=m.x_name, ylabel=m.y_name, title=f"{m.name}: {m.method}")
        ax.set_xticks(x, [f"{v:g}" for v in m.x], fontsize=7)
        ax.legend(fontsize=7)
        parts += [f"## {m.name}\n", f"The law puts {m.agreement:.0%} of the points on the right side.\n",
                  save_figure(figure, out, f"failures-{number + 1}")]  # fmt: skip
    write_page(out, "failures", parts)


def main() -> None:
    """Print the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.add_argument("--out", type=Path, help="folder for the page and its plots")
    parser.add_argument("--cases", type=int, default=60, help="random pairs for the guarded methods")
    options = parser.parse_args()
    found = study(options.out, options.cases)
    if options.json:
        print(to_json(finite(found)))
        return
    print(table(found["guarded"]))
    print(table(found["imitations"]))
    print(table([{"map": name, "agreement": value} for name, value in found["agreement"].items()]))
    print(f"violations: {found['violations']} of {found['computed']}, broken promises: {found['broken_promises']}")


if __name__ == "__main__":
    main()
