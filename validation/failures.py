"""Where methods fail: error over defocus, aberration, shear, obscuration and sampling, with the law of each border.

    uv run python validation/failures.py [--json] [--out DIR] [--cases N]

The maps take the methods without their guards, at samplings that a user might choose, and ask where the complex error
of γ (or of the PSF) exceeds 1e-3 of its modulus (of its peak). Truth is sinc's closed form for pure defocus, else the
boundary-fitted quadrature at 1e-9. ``agreement`` of a map is the share of its points that its law puts on the right
side. Then the guarded methods are tried on random pairs: ``violations`` counts errors beyond the bound that came with
the result, and ``broken_promises`` bounds beyond the one promised beforehand.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "tests" / "wave"), str(HERE.parent / "tests" / "wave" / "methods")]

import numpy as np  # noqa: E402
from cases import defocus, lommel, quadrature  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from study_page import save_figure, table, write_page  # noqa: E402

from cgi_wave.errors import CgiWaveError, MethodLimitError  # noqa: E402
from cgi_wave.wave.hopkins import HopkinsPair  # noqa: E402
from cgi_wave.wave.methods.fft import PrunedFft, WindowFft, overlap_on_window  # noqa: E402
from cgi_wave.wave.methods.geometric import geometric_overlap  # noqa: E402
from cgi_wave.wave.methods.grid import covering, shares, steepest_step  # noqa: E402
from cgi_wave.wave.methods.incoherent import incoherent_overlap  # noqa: E402
from cgi_wave.wave.methods.matrix import ChirpZ, MatrixFourier  # noqa: E402
from cgi_wave.wave.methods.nufft import Nufft  # noqa: E402
from cgi_wave.wave.methods.onpatch import overlap_on_patch  # noqa: E402
from cgi_wave.wave.methods.patch import SAMPLING, Patch, nyquist  # noqa: E402
from cgi_wave.wave.methods.propagation import Fresnel, choose_plane, to_detector  # noqa: E402
from cgi_wave.wave.methods.shape import beam_at, edge_of, find_pair  # noqa: E402

Array = NDArray[np.float64]
EXPECTED = 1e-3
SAMPLES = (32, 48, 64, 96, 128, 192, 256, 384, 512, 768)
DEFOCUS = (0.3, 0.8, 1.25, 2.3, 4.3, 7.3, 10.25, 17.3, 30.3, 55.3, 100.3, 180.3)


@dataclass(frozen=True)
class Map:
    """Relative error (Y, X) over x and y, nan where a point was not computed; laws: name -> smallest good y at x.

    The first law is the one that ``agreement`` is taken of.
    """

    name: str
    method: str
    x_name: str
    x: Sequence[float]
    y_name: str
    y: Sequence[float]
    error: Array
    laws: dict[str, Array]

    @property
    def agreement(self) -> float:
        """Share of the points that the first law puts on the right side of EXPECTED."""
        border = next(iter(self.laws.values()))
        good = np.asarray(self.y)[:, None] >= border[None, :]
        known = np.isfinite(self.error)
        return float(np.mean((self.error <= EXPECTED)[known] == good[known]))


def _fill(y: Sequence[float], x: Sequence[float], f: Callable[[float, float], float]) -> Array:
    return np.array([[f(a, b) for b in x] for a in y])


def _window(pair: HopkinsPair, n: int, exact: complex) -> float:
    """|error of γ| / |γ| of the whole-window FFT with n cells across the pupils' box."""
    found = find_pair(*pair.pupil_fields(), 1.0)
    if found is None or abs(exact) < 1e-12:
        return float("nan")
    lo, hi = found.box
    pitch = (hi - lo) / n
    value = overlap_on_window(found, (float(pitch[0]), float(pitch[1])), n + 2)
    return float(abs(value - exact) / abs(exact))


def edge_term(pair: HopkinsPair, x: tuple[float, float] = (0.0, 0.0), alone: bool = False) -> tuple[complex, complex]:
    """∮ n_a ∂φ/∂u_a exp(iφ) dl for a = x, y around what both pupils share (``alone``: around pupil m).

    φ = 2π(W + x·u). A gray edge leaves 1/24 of the sum of both, each times its pitch squared, of the integral.
    """
    count = 20_000
    angle = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    own = (pair.shift_x, pair.shift_y)
    circles = [(own, 1.0, 1.0), (own, pair.obscuration, -1.0)]
    if not alone and own != (0.0, 0.0):  # the same circle twice is one edge
        circles += [((0.0, 0.0), 1.0, 1.0), ((0.0, 0.0), pair.obscuration, -1.0)]
    total = np.zeros(2, complex)
    for centre, radius, outward in circles:
        if radius == 0.0:
            continue
        u = np.array(centre)[:, None] + radius * np.array([np.cos(angle), np.sin(angle)])
        lit = np.ones(count, bool)
        for other, bound, side in circles:
            if (other, bound) != (centre, radius):
                lit &= side * (bound - np.hypot(u[0] - other[0], u[1] - other[1])) > -1e-12
        wave = pair.wavefront(*u) + x[0] * u[0] + x[1] * u[1]
        step = 1e-5
        for a in (0, 1):
            d = step * np.eye(2)[a][:, None]
            slope = (pair.wavefront(*(u + d)) - pair.wavefront(*(u - d))) / (2.0 * step) + x[a]
            normal = outward * (np.cos(angle), np.sin(angle))[a]
            total[a] += np.sum(np.where(lit, normal * slope * np.exp(2j * np.pi * wave), 0.0)) * radius / count
    full = (2.0 * np.pi) ** 2 * total
    return complex(full[0]), complex(full[1])


def _edge_samples(pair: HopkinsPair, exact: complex) -> float:
    """N across the pupils' box at which the gray edge leaves EXPECTED of |γ|, to leading order."""
    found = find_pair(*pair.pupil_fields(), 1.0)
    assert found is not None
    lo, hi = found.box
    terms = edge_term(pair)
    loss = abs(terms[0] * (hi - lo)[0] ** 2 + terms[1] * (hi - lo)[1] ** 2) / 24.0 / found.norm
    return float(np.sqrt(loss / (EXPECTED * abs(exact))))


def _replica_samples(pair: HopkinsPair) -> float:
    """N at which a cell holds a turn of the steepest phase along an axis."""
    found = find_pair(*pair.pupil_fields(), 1.0)
    assert found is not None
    lo, hi = found.box
    turns = steepest_step(found.m, found.l, found.common, (1.0, 1.0)) / (2.0 * np.pi)
    return float(np.max(turns * (hi - lo)))


def _window_map(name: str, x_name: str, values: Sequence[float], pairs: Sequence[HopkinsPair]) -> Map:
    exact = [quadrature(*p.pupil_fields())[0] for p in pairs]
    error = np.array([[_window(p, n, e) for p, e in zip(pairs, exact, strict=True)] for n in SAMPLES])
    replica = np.array([_replica_samples(p) for p in pairs])
    edge = np.array([_edge_samples(p, e) for p, e in zip(pairs, exact, strict=True)])
    laws = {"edge: |∮ ∂φ/∂n exp(iφ) dl| p²/24": np.maximum(edge, replica), "replica: one turn a cell": replica}
    return Map(name, WindowFft.name, x_name, values, "N", SAMPLES, error, laws)


def window_maps() -> list[Map]:
    """Samples across both pupils against defocus (where the laws are 4πW/3N² and N = 4W) and the other conditions."""
    found = [_window_map("overlap against defocus", "W020 / waves", DEFOCUS, [HopkinsPair(w020=w) for w in DEFOCUS])]
    values = (0.3, 0.8, 1.7, 3.3, 6.3, 12.3, 25.3, 50.3)
    for name in ("w040", "w131", "w222"):
        pairs = [HopkinsPair(**{name: v}) for v in values]
        found.append(_window_map(f"overlap against {name}", f"{name} / waves", values, pairs))
    shear = (0.0, 0.02, 0.1, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8)
    pairs = [HopkinsPair(w020=2.3, shift_x=0.8 * v, shift_y=0.6 * v) for v in shear]
    found.append(_window_map("overlap against shear at 2.3 waves", "shear / radii", shear, pairs))
    hole = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9)
    pairs = [HopkinsPair(w020=2.3, obscuration=v) for v in hole]
    found.append(_window_map("overlap against obscuration at 2.3 waves", "ε", hole, pairs))
    return found


def patch_size() -> Map:
    """Points across a patch against defocus: what lies outside is 4/(π² n) |…| of the power, beyond the spot."""
    sides = (16, 32, 64, 128, 256, 512, 1024, 2048)
    waves = (0.0, 0.3, 1.25, 4.3, 10.25, 30.3)

    def wrong(n: float, w: float) -> float:
        pair = find_pair(*HopkinsPair(w020=w).pupil_fields(), 1.0)
        assert pair is not None
        pitch = tuple(SAMPLING * p for p in nyquist(pair))
        side = int(n)
        patch = Patch((-side // 2, -side // 2), (side, side), (pitch[0], pitch[1]))
        across = max(96.0, 4.5 * w + 2.0 * side, 24.0 * np.sqrt(w))
        method = PrunedFft()
        value, _, _ = overlap_on_patch(method, pair, method.pitch_for(pair, patch, np.full(2, 2.0 / across)), patch)
        return float(abs(value - defocus(w)) / abs(defocus(w)))

    error = _fill(sides, waves, wrong)
    w = np.array(waves)
    # 4/(π² n) of the light for a circle of that diameter; a square holds ln(1+√2)·4/π = 1.12 times more
    laws = {"light outside: 0.36/n = 1e-3 |γ|": 0.36 / (EXPECTED * np.abs(np.sinc(w)))}
    every = "pruned FFT, matrix, chirp-z, NUFFT"
    return Map("overlap on a patch", every, "W020 / waves", waves, "points a side", sides, error, laws)


def psf_defocus() -> Map:
    """PSF at the edge of a picture of half the window: the spot's replica arrives at N = 16W/3.

    A picture of half the window that holds the whole spot has N = 8W.
    """
    waves, samples = (1.25, 3.3, 7.3, 14.3, 25.3, 40.3, 60.3), (32, 48, 64, 96, 128, 192, 256, 384, 512)
    side, pixel = 8, 0.5  # points at Nyquist's distance: a window has as many as there are cells

    def places(count: int) -> Patch:
        return Patch((count // 4 - side, -side // 2), (side, side), (pixel, pixel))

    def size(w: float) -> float:
        return float(np.pi / max(1.0, 2.0 * w))  # of the order of |h| inside the spot

    def wrong(n: float, w: float) -> float:
        field = HopkinsPair(w020=w).pupil_fields()[0]
        beam, edge = beam_at(field, 1.0), edge_of(field)
        patch, cell = places(int(n)), 2.0 / n
        grid = covering(edge.u.min(axis=0), edge.u.max(axis=0), (cell, cell))
        h = PrunedFft().amplitude(beam, grid, shares([beam.support], grid), patch).field * beam.constant
        v = 2.0 * np.pi * np.hypot(patch.axis(0)[:, None], patch.axis(1)[None, :])
        return float(np.abs(h - np.pi * lommel(v, w)).max() / size(w))

    def law(n: float, w: float) -> float:
        patch, pair = places(int(n)), HopkinsPair(w020=w)
        points = [(x, y) for x in patch.axis(0)[::3] for y in patch.axis(1)[::3]]
        return max(abs(sum(edge_term(pair, p, True))) for p in points) * (2.0 / n) ** 2 / 24.0 / size(w)

    error = _fill(samples, waves, wrong)
    w = np.array(waves)
    expected = _fill(samples, waves, law)
    edge = np.array([next((n for n, e in zip(samples, column, strict=True) if e <= EXPECTED), np.inf)
                     for column in expected.T])  # fmt: skip
    laws = {"edge: |∮ ∂φ/∂n exp(iφ) dl| p²/24": np.maximum(edge, 16.0 / 3.0 * w), "replica: N = 16W/3": 16.0 / 3.0 * w,
            "all of the spot in half the window: N = 8W": 8.0 * w}  # fmt: skip
    return Map("PSF of half the window", PrunedFft.name, "W020 / waves", waves, "N", samples, error, laws)


def fresnel_psf() -> Map:
    """PSF by propagation against the Fresnel number N_F = a²σz: what a sharp edge adds beyond the band folds back.

    The law is a fit, not derived: 0.7/N_F² of the peak without aberration.
    """
    waves, samples = (0.3, 1.25, 3.7, 7.3), (32, 64, 128, 256, 512, 1024)

    def wrong(n: float, w: float) -> float:
        field = HopkinsPair(w020=w).pupil_fields()[0]
        beam, edge = beam_at(field, 1.0), edge_of(field)
        try:
            plane = choose_plane((beam,), (edge,), 2.0 / n)
        except MethodLimitError:
            return float("nan")
        h = to_detector(beam, edge, plane, 16)
        x = h.x
        exact = np.pi * lommel(2.0 * np.pi * np.hypot(x[:, None], x[None, :]), w)
        return float(np.abs(h.field * beam.constant - exact).max() / np.abs(exact).max())

    error = _fill(samples, waves, wrong)
    w = np.array(waves)
    peak = np.minimum(1.0, 1.0 / (2.0 * w))
    number = np.sqrt(0.7 / (EXPECTED * peak))
    laws = {"fit: 0.7/N_F² of the peak": 2.0 * (number + 2.0 * w) / 0.3}  # z of the plane: cell·(z + 2W) = 0.3
    return Map("PSF by propagation", Fresnel.name, "W020 / waves", waves, "N", samples, error, laws)


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
    return HopkinsPair(
        w, *map(float, others), w111=float(3.0 * rng.normal() * rng.integers(2)),
        obscuration=float(rng.choice([0.0, rng.uniform(0.05, 0.9)])), shift_x=shear * float(np.cos(angle)),
        shift_y=shear * float(np.sin(angle)),
    )  # fmt: skip


def study(out: Path | None = None, cases: int = 60) -> dict[str, Any]:
    """All figures of the study; writes ``out/failures.md`` and its plots where ``out`` is given."""
    maps = [*window_maps(), patch_size(), psf_defocus(), fresnel_psf()]
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
        "laws": {name: [float(v) for v in border] for name, border in m.laws.items()},
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
        print(json.dumps(found, indent=1))
        return
    print(table(found["guarded"]))
    print(table(found["imitations"]))
    print(table([{"map": name, "agreement": value} for name, value in found["agreement"].items()]))
    print(f"violations: {found['violations']} of {found['computed']}, broken promises: {found['broken_promises']}")


if __name__ == "__main__":
    main()
