"""Cases for the study of the overlap contrast: random ones with declared weights, and those made to hurt.

Coefficients in waves at the edge of beam m's pupil, lengths in pupil radii, as in `cgi_wave.wave.hopkins.HopkinsPair`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np

#: Shares of random cases. Defocus: none, evenly spread to 5000 waves, else evenly in its logarithm from 0.05 to 5000.
NO_DEFOCUS, EVEN_DEFOCUS = 0.05, 0.04
#: Other aberrations, each coefficient on its own: none; within 10 % of W020; from 1 % to all of W020, evenly in the
#: logarithm; evenly up to all of W020. Half of the coefficients are left out in the last three.
OTHERS = {"none": 0.25, "tenth": 0.4, "logarithmic": 0.2, "full": 0.15}
#: Shear: none, tiny (1e-9 to 1e-2, evenly in the logarithm), past 2, else even from 0 to 2; a tenth along an axis.
CENTRED, TINY, APART = 0.12, 0.08, 0.01
#: Share with a central obscuration, even from 0 to 0.9.
OBSCURED = 0.6
#: |W020| + 2|W040| + 1.5|W131| + |W222| + |W111| is kept below this by shrinking all but W020: what oracles can pay.
STEEPEST = 8000.0


@dataclass(frozen=True)
class Case:
    """One pair of pupils, and what kind of case it is."""

    kind: str
    w020: float = 0.0
    w040: float = 0.0
    w131: float = 0.0
    w222: float = 0.0
    w111: float = 0.0
    obscuration: float = 0.0
    shift_x: float = 0.0
    shift_y: float = 0.0

    @property
    def coefficients(self) -> dict[str, float]:
        """What the oracles and HopkinsPair take."""
        return {name: value for name, value in asdict(self).items() if name != "kind"}


def _others(rng: np.random.Generator, w020: float) -> tuple[str, np.ndarray]:
    kind = str(rng.choice(list(OTHERS), p=list(OTHERS.values())))
    size = abs(w020) if w020 else 10.0 ** rng.uniform(math.log10(0.05), math.log10(300.0))
    sign, kept = rng.choice([-1.0, 1.0], 4), rng.uniform(size=4) < 0.5
    share = {
        "none": np.zeros(4),
        "tenth": 0.1 * rng.uniform(size=4),
        "logarithmic": 10.0 ** rng.uniform(-2.0, 0.0, 4),
        "full": rng.uniform(size=4),
    }[kind]
    values = size * share * sign * kept
    steep = float(np.abs(values) @ [2.0, 1.5, 1.0, 1.0])
    return kind, values * min(1.0, (STEEPEST - abs(w020)) / max(steep, 1e-300))


def _shift(rng: np.random.Generator) -> tuple[float, float]:
    chance, angle = rng.uniform(), rng.uniform(0.0, 2.0 * math.pi)
    if rng.uniform() < 0.1:
        angle = float(rng.choice([0.0, 0.5, 1.0, 1.5])) * math.pi
    if chance < CENTRED:
        length = 0.0
    elif chance < CENTRED + TINY:
        length = 10.0 ** rng.uniform(-9.0, -2.0)
    elif chance < CENTRED + TINY + APART:
        length = rng.uniform(2.0, 2.5)
    else:
        length = rng.uniform(0.0, 2.0)
    return length * math.cos(angle), length * math.sin(angle)


def random_cases(n: int, seed: int) -> list[Case]:
    """n cases; the first k of them do not depend on n."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(n):
        chance, sign = rng.uniform(), float(rng.choice([-1.0, 1.0]))
        if chance < NO_DEFOCUS:
            w020 = 0.0
        elif chance < NO_DEFOCUS + EVEN_DEFOCUS:
            w020 = sign * rng.uniform(0.0, 5000.0)
        else:
            w020 = sign * 10.0 ** rng.uniform(math.log10(0.05), math.log10(5000.0))
        kind, others = _others(rng, w020)
        obscuration = rng.uniform(0.0, 0.9) if rng.uniform() < OBSCURED else 0.0
        w040, w131, w222, w111 = map(float, others)
        found.append(Case(f"random, others {kind}", w020, w040, w131, w222, w111, obscuration, *_shift(rng)))
    return found


def typical_cases(n: int, w020: float, seed: int) -> list[Case]:
    """Sheared, obscured pupils with up to 10 % of each other aberration at exactly ±w020; timings are taken on them."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(n):
        w = float(rng.choice([-1.0, 1.0])) * w020
        w040, w131, w222, w111 = map(float, 0.1 * w020 * rng.uniform(-1.0, 1.0, 4))
        length, angle = rng.uniform(0.05, 1.5), rng.uniform(0.0, 2.0 * math.pi)
        shift = length * math.cos(angle), length * math.sin(angle)
        found.append(Case(f"typical {w020:g}", w, w040, w131, w222, w111, rng.uniform(0.05, 0.6), *shift))
    return found


def _fold(w: float, y0: float) -> dict[str, float]:
    """W along x = 0 has an inflection without slope at y0: a stationary point of rank 1 on the fold caustic."""
    w131 = -w / (3.0 * y0)
    return {"w020": w, "w131": w131, "w111": -(2.0 * w * y0 + 3.0 * w131 * y0 * y0)}


def _cusp(w: float, y0: float, w040: float) -> dict[str, float]:
    """W along x = 0 starts with the fourth power of y − y0: the second and third derivatives vanish as well."""
    w131 = -4.0 * w040 * y0
    bend = -(6.0 * w040 * y0 * y0 + 3.0 * w131 * y0)  # w020 + w222
    return {
        "w020": w, "w040": w040, "w131": w131, "w222": bend - w,
        "w111": -(2.0 * bend * y0 + 3.0 * w131 * y0 * y0 + 4.0 * w040 * y0**3),
    }  # fmt: skip


def _ring(w: float, radius: float) -> dict[str, float]:
    """dW/dρ = 0 on a whole circle of this radius."""
    return {"w020": w, "w040": -w / (2.0 * radius * radius)}


def caustic_cases(n: int, w: float, seed: int) -> list[Case]:
    """Degenerate stationary points well inside sheared, obscured pupils: folds, cusps, rings and umbilics in turn."""
    rng = np.random.default_rng(seed)
    found: list[Case] = []
    while len(found) < n:
        kind = ("fold", "cusp", "ring", "umbilic")[len(found) % 4]
        y0 = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.35, 0.7))
        made = {
            "fold": _fold(w, y0),
            "cusp": _cusp(w, y0, 0.2 * w),
            "ring": _ring(w, abs(y0)),
            "umbilic": {"w131": w, "w040": 0.1 * w * float(rng.uniform(-1.0, 1.0))},
        }[kind]
        length, angle, e = rng.uniform(0.05, 0.8), rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.05, 0.3)
        case = Case(f"caustic {kind}", **made, shift_x=length * math.cos(angle), shift_y=length * math.sin(angle))
        at = 0.0 if kind == "umbilic" else y0
        off = math.hypot(case.shift_x, at + case.shift_y)  # of the point from beam l's centre; a ring meets it anyway
        if kind == "umbilic":
            found.append(case)  # the point is the pupil's centre: an obscuration would cover it
        elif abs(at) > e + 0.05 and e + 0.05 < off < 0.95:
            found.append(replace(case, obscuration=e))
    return found


def _edges(w: float) -> Iterator[Case]:
    """The stationary point, at (0, y0), on an edge or so close that it matters."""
    e, s = 0.4, 0.3
    for name, y0, shift in [
        ("outer edge of m", 1.0, (0.0, -s)),
        ("outer edge of m, centred", 1.0, (0.0, 0.0)),
        ("outer edge of l", 1.0 - s, (0.0, s)),
        ("obscuration of m", -e, (0.25, 0.1)),
        ("obscuration of l", -s - e, (0.0, s)),
        ("both outer edges: a corner", 1.0, (math.sin(0.7), math.cos(0.7) - 1.0)),
        ("outer edge of m on the obscuration of l: a corner", 1.0, (e * math.sin(2.0), e * math.cos(2.0) - 1.0)),
        ("both obscurations: a corner", e, (e * math.sin(0.9), e * (math.cos(0.9) - 1.0))),
    ]:
        for off in (0.0, 1e-9, -1e-6, 1e-3, -0.03):
            tilt = -2.0 * w * (y0 + off)
            yield Case(f"stationary point, {name}, {off:g} off", w, w111=tilt, obscuration=e, shift_x=shift[0],
                       shift_y=shift[1])  # fmt: skip
    for length, name in ((1.0, "outer edge of l"), (e, "obscuration of l")):  # no tilt: the point is m's centre
        for obscuration in (0.0, e) if length == 1.0 else (e,):
            yield Case(f"stationary point of defocus, {name}", w, obscuration=obscuration, shift_x=length)
            yield Case(f"stationary point, {name}, others", w, 0.05 * w, 0.0, -0.07 * w, 0.0, obscuration, length)


def _circles(w: float) -> Iterator[Case]:
    """Circles that touch, nearly touch or nearly coincide; lenses that vanish."""
    others = {"w040": 0.06 * w, "w131": -0.04 * w, "w222": 0.08 * w}
    for e in (0.1, 1.0 / 3.0, 0.5, 0.9):
        for name, s in (("inside", 1.0 - e), ("outside", 1.0 + e), ("obscurations", 2.0 * e)):
            for near in (0.0, 1e-9, -1e-9):
                for angle in (0.0, 0.5 * math.pi, 2.0):
                    if s + near < 2.0:
                        x, y = (s + near) * math.cos(angle), (s + near) * math.sin(angle)
                        yield Case(f"tangent circles, {name}, {near:g} off", w, **others, obscuration=e, shift_x=x,
                                   shift_y=y)  # fmt: skip
    for s in (1e-12, 1e-9, 1e-6, 1e-4):
        for e in (0.0, 0.3, 0.9):
            yield Case(f"tiny shear {s:g}", w, obscuration=e, shift_x=s)
            yield Case(f"tiny shear {s:g}, others", w, **others, obscuration=e, shift_x=-0.6 * s, shift_y=0.8 * s)
    for s in (1.9, 1.99, 1.9999, 2.0 - 1e-6, 2.0 - 1e-9, 2.0, 2.5):
        for angle in (0.0, 0.5 * math.pi, 4.0):
            yield Case(f"small lens, shear {s:.10g}", w, **others, obscuration=0.3, shift_x=s * math.cos(angle),
                       shift_y=s * math.sin(angle))  # fmt: skip


def _caustics(w: float) -> Iterator[Case]:
    """Stationary points where the Hessian of W is singular, lines and rings of them."""
    for s, e in ((0.0, 0.0), (0.35, 0.0), (0.5, 0.25), (1.1, 0.2)):
        where = {"obscuration": e, "shift_x": 0.6 * s, "shift_y": 0.8 * s}
        for y0 in (0.3, -0.6):
            yield Case("fold", **_fold(w, y0), **where)
            yield Case("cusp", **_cusp(w, y0, 0.3 * w), **where)
        for y0 in (-1.0, 0.25):  # on edges
            yield Case("fold on an edge", **_fold(w, y0), **where)
        yield Case("cusp at the centre", w, w040=0.4 * w, w222=-w, **where)
        yield Case("rank 0: spherical alone", w040=w, **where)
        yield Case("rank 0: coma umbilic", w131=w, **where)
        yield Case("rank 0: coma and spherical", w040=0.3 * w, w131=w, **where)
        yield Case("coma umbilic unfolded", 0.01 * w, w131=w, w222=-0.015 * w, w111=0.002 * w, **where)
        yield Case("astigmatic line", w, w222=-w, **where)
        for near in (1e-6, 1e-3, 0.03):
            yield Case(f"astigmatic line, {near:g} off", w, w222=-w * (1.0 - near), **where)
        yield Case("saddle", w, w222=-2.0 * w, **where)
        yield Case("pure astigmatism", w222=w, **where)
        yield Case("pure tilt", w111=w, **where)
        for radius in (0.3, 0.7, 1.0, e if e else 0.9, 1.02):
            yield Case(f"ring of radius {radius:g}", **_ring(w, radius), **where)
            yield Case(f"ring of radius {radius:g}, nearly", **_ring(w, radius), w222=1e-3 * w, w131=1e-3 * w, **where)


def _small_values(w: float) -> Iterator[Case]:
    """|γ| near zero (a whole number of waves over the annulus) and at its largest nearby."""
    for e in (0.0, 0.45):
        for count in (round(w), round(w) + 0.5):
            for near in (0.0, 1e-9, 1e-4):
                yield Case(f"{count:g} waves over the annulus", (count + near) / (1.0 - e * e), obscuration=e)


def adversarial_cases(largest: float = 1001.0) -> list[Case]:
    """Every construction at 1.25, 10.5, 137.3 and 1000.25 waves, up to `largest`; and no aberration at all."""
    found = [
        Case("no aberration", obscuration=e, shift_x=0.6 * s, shift_y=-0.8 * s)
        for e in (0.0, 0.3, 0.95)
        for s in (0.0, 1e-6, 0.5, 1.0, 1.99)
    ]
    for w in (1.25, -10.5, 137.3, -1000.25):
        if abs(w) <= largest:
            for make in (_edges, _circles, _caustics, _small_values):
                found += make(w)
    return found
