"""Eq. 4 over the plane of defocus and nominal aberration, and the estimate on random pairs. Part of ``eq4``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import CgiWaveError
from cgi_wave.wave.eq4 import contrast_eq4, contrast_stationary
from cgi_wave.wave.hopkins import HopkinsPair
from validation.eq4_pairs import Aberrated, folds, slopes

Array = NDArray[np.float64]
KNOWN = 0.1  # error bound, in parts of |γ|, up to which a pair is compared
AGREES = 0.1
WITHIN = 0.7  # distance of the spots in units of their rim up to which the estimate is meant

# What explains that Eq. 4 is off. The first that fits is named.
UNKNOWN = "|γ| not known to a tenth"
GOOD = "within 10 %"
APART = "spots apart"
CUT = "spot cut by the detector"
FOCUS = "nominal spot below the diffraction width: too small"
ABERRATED = "nominal aberration taken for its size: too large"
BELOW = "oscillation or a steep stationary point: |γ| below the estimate"
ABOVE = "edge wave or caustic: |γ| above the estimate"
CAUSES = (GOOD, APART, CUT, FOCUS, ABERRATED, BELOW, ABOVE)


def cause(size: float, bound: float, eq4: float, estimate: float, apart: float, cut: bool = False) -> str:
    """What explains |γ|/Eq. 4 of one pair.

    log(|γ|/Eq. 4) = log(estimate/Eq. 4) + log(|γ|/estimate): the first term is the nominal spot in the place of the
    diffraction width, the second what the estimate leaves out. The larger one is named. ``apart``: distance of the
    spots in units of their rim, beyond 1 no stationary point is left. ``cut``: the ghost reaches the detector's edge.
    """
    if bound > KNOWN * size or size == 0.0:
        return UNKNOWN
    if eq4 > 0.0 and abs(size / eq4 - 1.0) <= AGREES:
        return GOOD
    left = abs(np.log(size / estimate))
    if eq4 == 0.0 or abs(np.log(estimate / eq4)) >= left:
        return FOCUS if eq4 < estimate else ABERRATED
    if apart >= 1.0 and size < estimate:
        return APART
    if cut:
        return CUT
    return BELOW if size < estimate else ABOVE


@dataclass(frozen=True)
class Compared:
    """One pair: |γ| with its bound, Eq. 4 (None for a ghost that is a point), the estimate from the difference of the
    wavefronts and that from the spots alone, Eq. 4 with both spots widened by w = λ/(2π NA) in squares, the distance
    of the spots in units of their rim, whether a caustic (a zero of W's Hessian determinant) crosses the shared pupil,
    and the cause."""

    size: float
    bound: float
    eq4: float | None
    estimate: float
    from_spots: float
    widened: float
    apart: float
    caustic: bool
    cause: str


def compare(pair: Aberrated) -> Compared | None:
    """All of it for one pair; None for pupils that hardly meet."""
    x, y = pair.common()
    if len(x) < 30:
        return None
    moved = slopes(pair.waves(), x, y)
    mean, covariance = moved.mean(axis=1), np.cov(moved, bias=True)
    values, axes = np.linalg.eigh(covariance)
    values = np.maximum(values, 0.0)
    along = axes.T @ mean
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = float(np.sqrt(np.where(np.abs(along) < 1e-12, 0.0, along**2 / (4.0 * values)).sum()))
    directions = np.sqrt(np.linalg.det(np.cov(np.array([x, y]), bias=True)))
    # The blur over a part of the pupil goes with that part's own spread of directions, a quarter for the whole disc.
    blur = np.sqrt(values * 0.25 / directions)
    share = float(pair.share())
    estimate = contrast_stationary(blur[0], blur[1], 1.0, 1.0, share)
    nominal, ghost = pair.sizes()
    both = np.hypot(nominal, ghost)
    from_spots = contrast_stationary(both[0], both[1], 1.0, 1.0)
    wide = [np.hypot(size, 1.0 / (2.0 * np.pi)) for size in (nominal, ghost)]
    widened = contrast_eq4(wide[0][0], wide[0][1], wide[1][0], wide[1][1])
    value, bound = pair.contrast()
    eq4, size = pair.eq4(), abs(value)
    why = UNKNOWN if eq4 is None else cause(size, bound, eq4, estimate, apart)
    return Compared(size, bound, eq4, estimate, from_spots, widened, apart, folds(pair.waves(), x, y), why)


def summary(ratio: Array) -> dict[str, float | int | None]:
    """Shares and quantiles of |γ| over an estimate of it."""
    if ratio.size == 0:
        return dict.fromkeys(
            ("count", "within_10_percent", "within_30_percent", "within_2", "off_by_3", "off_by_10", "ratio_5_percent",
             "median_ratio", "ratio_95_percent"))  # fmt: skip
    with np.errstate(divide="ignore"):
        off = np.abs(np.log(ratio))
    low, middle, high = np.quantile(ratio, [0.05, 0.5, 0.95])
    return {
        "count": int(ratio.size),
        "within_10_percent": float(np.mean(np.abs(ratio - 1.0) <= AGREES)),
        "within_30_percent": float(np.mean(np.abs(ratio - 1.0) <= 0.3)),
        "within_2": float(np.mean(off <= np.log(2.0))),
        "off_by_3": float(np.mean(off > np.log(3.0))),
        "off_by_10": float(np.mean(off > np.log(10.0))),
        "ratio_5_percent": float(low),
        "median_ratio": float(middle),
        "ratio_95_percent": float(high),
    }


def known(found: Sequence[Compared | None]) -> list[Compared]:
    """Those with an Eq. 4 and with |γ| known to a tenth."""
    return [c for c in found if c is not None and c.eq4 and c.size > 0.0 and c.bound <= KNOWN * c.size]


def ratios(found: Sequence[Compared], of: str = "eq4") -> Array:
    """|γ| over one of the estimates."""
    return np.array([c.size / getattr(c, of) for c in found])


@dataclass(frozen=True)
class Panel:
    """|γ|/Eq. 4 (Y, X) over defocus x (waves) and nominal aberration y (waves of W040 at its best focus).

    nan where the pair was not comparable.
    """

    name: str
    defocus: Array
    aberration: Array
    ratio: Array
    found: list[Compared | None]


#: Astigmatism as a part of the defocus; displacement of the pupil in radii; tilt in units of that which brings the
#: nominal spot to the rim of the ghost's.
ASTIGMATISM = (0.0, 0.1, 0.5, -2.0)
SHEAR = (0.0, 0.3, 0.9)
TILT = (0.5, 0.9, 1.2)


def nominal(w040: float) -> HopkinsPair:
    """Spherical aberration at the focus of least RMS, W020 = −4/3 W040."""
    return HopkinsPair(w020=-4.0 / 3.0 * w040, w040=w040)


def panel(astigmatism: float, shear: float, tilt: float, defocus: Array, aberration: Array) -> Panel:
    """One chart. The pupil is displaced, and the spot, along y; the ghost's focus is measured from the nominal one."""
    found: list[Compared | None] = []
    for n in aberration:
        for w in defocus:
            beam = nominal(float(n))
            # The ghost has the nominal beam's aberration and defocus of its own, as a ghost through the same lenses.
            ghost = HopkinsPair(beam.w020 + float(w), beam.w040, 0.0, astigmatism * float(w), 2.0 * tilt * float(w),
                                shift_y=shear)  # fmt: skip
            found.append(_tried(Aberrated(ghost, beam)))
    usable = {id(c) for c in known(found)}
    ratio = np.array([c.size / c.eq4 if c is not None and id(c) in usable and c.eq4 else np.nan for c in found])
    name = f"astigmatism {astigmatism:g}, shear {shear:g}, tilt {tilt:g}"
    return Panel(name, defocus, aberration, ratio.reshape(len(aberration), len(defocus)), found)


def _tried(pair: Aberrated) -> Compared | None:
    try:
        return compare(pair)
    except CgiWaveError:
        return None


def panels(points: int = 56, levels: int = 18) -> list[Panel]:
    """Every chart: astigmatism times shear, then tilt."""
    defocus = np.concatenate([[0.0], np.geomspace(0.053, 2000.3, points - 1)])
    aberration = np.geomspace(0.02, 10.0, levels)
    cases = [(a, s, 0.0) for a in ASTIGMATISM for s in SHEAR] + [(0.1, 0.0, t) for t in TILT]
    return [panel(*case, defocus, aberration) for case in cases]


def random_pair(rng: np.random.Generator, kind: str) -> Aberrated:
    """Two unrelated beams: defocus 0.03 to 2000 waves, aberrations up to a tenth of it, nominal 0.01 to 10 waves.

    kind: "plain" (astigmatism up to 0.3 of the defocus), "astigmatic" (up to 3), "sheared" (0 to 1.2 radii) or
    "tilted" (spots 0 to 1.5 rims apart).
    """
    w = float(10.0 ** rng.uniform(-1.5, 3.3) * rng.choice([-1.0, 1.0]))
    ratio = float(rng.uniform(-3.0, 3.0) if kind == "astigmatic" else rng.uniform(-0.3, 0.3))
    w040, w131 = (float(v) for v in w * rng.uniform(0.0, 0.1) * rng.normal(size=2))
    n = float(10.0 ** rng.uniform(-2.0, 1.0))
    beam = nominal(n) if rng.random() < 0.5 else HopkinsPair(w020=n * float(rng.normal()), w131=n)
    shear = float(rng.uniform(0.0, 1.2)) if kind == "sheared" else 0.0
    tilt = float(rng.uniform(0.0, 3.0)) * w if kind == "tilted" else 0.0
    angle = float(rng.uniform(0.0, 2.0 * np.pi))
    shift = {"shift_x": shear * np.cos(angle), "shift_y": shear * np.sin(angle)}
    return Aberrated(HopkinsPair(w, w040, w131, ratio * w, tilt, **shift), beam)


KINDS = ("plain", "astigmatic", "sheared", "tilted")


def trials(count: int, seed: int = 4) -> dict[str, list[Compared]]:
    """``count`` random pairs of each kind."""
    rng = np.random.default_rng(seed)
    return {kind: known([_tried(random_pair(rng, kind)) for _ in range(count)]) for kind in KINDS}


def trial_rows(found: dict[str, list[Compared]]) -> list[dict[str, Any]]:
    """A row per kind and estimate; ``range``: what the estimate is meant for."""
    rows = []
    for kind, pairs in found.items():
        near = [c for c in pairs if c.apart <= WITHIN]
        clear = [c for c in near if not c.caustic]
        sets = [("eq4", pairs, "all"), ("eq4", near, "spots together"), ("estimate", pairs, "all"),
                ("estimate", near, "spots together"), ("from_spots", near, "spots together"),
                ("estimate", clear, "and no caustic"), ("from_spots", clear, "and no caustic"),
                ("widened", near, "spots together")]  # fmt: skip
        rows += [{"pairs": kind, "of": of, "range": name, **summary(ratios(part, of))} for of, part, name in sets]
    return rows
