"""Maps of true error over conditions and sampling, each with the law of its border. Part of ``failures``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests" / "wave"), str(HERE.parent / "tests" / "wave" / "methods")]

import numpy as np  # noqa: E402
from cases import defocus, lommel, quadrature  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from cgi_wave.errors import MethodLimitError  # noqa: E402
from cgi_wave.wave.hopkins import HopkinsPair  # noqa: E402
from cgi_wave.wave.methods.fft import PrunedFft, WindowFft, overlap_on_window  # noqa: E402
from cgi_wave.wave.methods.grid import covering, shares, steepest_step  # noqa: E402
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


def all_maps() -> list[Map]:
    """Every map; a minute or two."""
    return [*window_maps(), patch_size(), psf_defocus(), fresnel_psf()]
