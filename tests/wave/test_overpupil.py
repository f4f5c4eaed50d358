"""γ over a pupil and in charts, on a beam made by hand whose directions fold, against sums in position space."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
from synthetic_beams import cloud

from cgi_wave.errors import FoldedFieldError, InputError
from cgi_wave.wave import pupilfields
from cgi_wave.wave.field import fit_field
from cgi_wave.wave.overlap import overlap
from cgi_wave.wave.overpupil import contrast_over_pupil
from cgi_wave.wave.samples import PupilSamples

SIGMA = 1.0e6
X, Q, FAR = 1e-3, 0.1, 1e-5  # half-side of the ghost on the detector, m; of the other's cone; its defocus, m
LEVEL, BEND, TURN = -0.03, 0.06, 0.4  # directions along x: LEVEL + BEND (x/X - TURN)², which fold at TURN
STEEP = 0.05  # directions along y: STEEP y/X
LABEL = "by hand"


def taper(t):
    """An amplitude that ends without an edge to diffract."""
    return (1.0 - t**2) ** 2


@dataclass(frozen=True)
class ByHand:
    """Rays of a field a(x) exp(i 2πσ S(x)) on the detector, ∇S = q; the pupil is the square |x|, |y| < X itself."""

    p: np.ndarray
    level: float = LEVEL
    curl: float = BEND

    @property
    def x(self):
        return self.p

    @property
    def q(self):
        return np.column_stack([self.level + self.curl * (self.p[:, 0] / X - TURN) ** 2, STEEP * self.p[:, 1] / X])

    @property
    def power(self):
        return np.prod(taper(self.p / X), axis=1) ** 2

    @property
    def clearance(self):
        return 1.0 - (self.p.T / X) ** 2

    @property
    def catch(self):
        return np.empty((0, len(self.p)))

    def path(self):
        s, t = self.p.T / X
        return X * (self.level * s + self.curl / 3.0 * ((s - TURN) ** 3 + TURN**3) + 0.5 * STEEP * t**2)

    def curvature(self, bend):
        return np.array(
            [2.0 * self.curl * (self.p[:, 0] / X - TURN) / X - bend, np.full(len(self.p), STEEP / X - bend)]
        )

    def chart(self, bend):
        opl = self.path() - (self.q * self.x).sum(axis=1) + 0.5 * bend * (self.x**2).sum(axis=1)
        return self.q - bend * self.x, opl, np.prod(self.curvature(bend), axis=0)

    def phase(self, ray, bend):
        return 0.25 * np.pi * float(np.sign(self.curvature(bend)[:, ray]).sum())


@dataclass(frozen=True)
class Straight(ByHand):
    """The same with one sheet: directions along x that grow evenly."""

    @property
    def q(self):
        return self.p / X * np.array([self.curl, STEEP]) + np.array([self.level, 0.0])

    def path(self):
        s, t = self.p.T / X
        return X * (self.level * s + 0.5 * self.curl * s**2 + 0.5 * STEEP * t**2)

    def curvature(self, bend):
        return np.array([np.full(len(self.p), slope / X - bend) for slope in (self.curl, STEEP)])


@dataclass(frozen=True)
class Wavy(Straight):
    """That with an amplitude for which a polynomial of degree 8 is too little."""

    @property
    def power(self):
        return super().power * np.exp(np.sin((self.p[:, 0] + 0.5 * self.p[:, 1]) / X))


def focused(bend, sigma=SIGMA):
    """A square cone to a focus FAR before the detector, in a chart."""
    q = cloud(1.5 * Q, 900)
    shrink = 1.0 - bend * FAR
    u = q * shrink
    amplitude = taper(q[:, 0] / Q) * taper(q[:, 1] / Q) / shrink
    opl = -0.5 * FAR * shrink * (q**2).sum(axis=1)
    clearance = (1.0 - (q / Q).T ** 2)[:, None]
    return fit_field(
        PupilSamples(
            "focus", "direction", u[None], np.array([sigma]), opl[None], amplitude[None], clearance, q[None], 0.0,
            (0.0, 0.0), bend,
        ),
        target=1e-9,
    )  # fmt: skip


def huygens(sigma, rays=ByHand):
    """γ by the double sum over detector and directions, axis by axis, with nothing stationary about it."""
    t, weights = np.polynomial.legendre.leggauss(2000)
    zero, value = np.zeros(len(t)), 1.0 + 0.0j
    for axis in (0, 1):
        path = rays(np.roll(np.column_stack([t * X, zero]), axis, axis=1)).path()
        ghost = taper(t) * np.exp(2j * np.pi * sigma * path) * weights * X
        beam = taper(t) * np.exp(-1j * np.pi * sigma * FAR * (t * Q) ** 2) * weights * Q
        value *= np.sqrt(sigma) * ghost @ np.exp(-2j * np.pi * sigma * X * Q * np.outer(t, t)) @ beam.conj()
        value /= weights @ taper(t) ** 2 * np.sqrt(X * Q)
    return complex(value)


def found(sigma, bend=None, rays=ByHand):
    return contrast_over_pupil(rays, np.sqrt(2.0) * X, partial(focused, sigma=sigma), sigma, LABEL, 1e-7, bend)


def test_folded_directions_against_a_sum_in_position_space():
    """Two sheets of directions meet within the other's cone. The chart is bent, and what is left falls as 1/σ."""
    off = []
    for sigma in (SIGMA, 4.0 * SIGMA):
        here, exact = found(sigma), huygens(sigma)
        assert here.bend != 0.0 and "fold" in here.note
        assert 0.0 < here.charts < 0.1 * abs(exact)
        assert here.error < 1e-6
        off.append(abs(here.value - exact) / abs(exact))
        assert off[-1] * abs(exact) < here.error + here.charts
    assert off[1] < 0.02
    assert off[1] / off[0] == pytest.approx(0.25, abs=0.06)


def test_directions_that_fold_are_refused_in_the_chart_of_directions():
    with pytest.raises(FoldedFieldError, match="changes sign"):
        found(SIGMA, bend=0.0)


def test_a_collimated_beam_has_a_contrast():
    """Directions that hardly change over the beam: no field of directions, and the sum in position space holds."""
    rays = partial(Straight, level=0.02, curl=1e-3)
    here, exact = found(SIGMA, rays=rays), huygens(SIGMA, rays)
    assert here.bend != 0.0 and "Fresnel number" in here.note
    assert abs(here.value - exact) < here.error + here.charts < 0.1 * abs(exact)


def test_no_shared_direction_is_an_answer():
    apart = found(SIGMA, rays=partial(ByHand, level=0.2))
    assert (apart.bend, apart.value, apart.parts) == (0.0, 0.0, 0)


def test_over_the_pupil_and_over_directions_alike():
    """One sheet of directions: the same integral with other coordinates, within both bounds. Other charts
    come near."""
    here = found(SIGMA, rays=Straight)
    assert here.bend == 0.0 and here.charts == 0.0
    rays = Straight(cloud(1.7 * X, 900))
    u, opl, det = rays.chart(0.0)
    ghost = fit_field(
        PupilSamples(
            "ghost", "direction", u[None], np.array([SIGMA]), opl[None], np.sqrt(rays.power / np.abs(det))[None],
            rays.clearance[:, None], u[None], rays.phase(0, 0.0), (0.0, 0.0),
        ),
        target=1e-8,
    )  # fmt: skip
    pair = overlap(ghost, focused(0.0), np.array([SIGMA]), 1e-7)
    value = pair.value[0] * np.exp(2j * np.pi * SIGMA * pair.opd_m[0])
    assert abs(value - here.value) < pair.error_bound[0] + here.error < 1e-5
    for bend in (-100.0, 300.0):
        assert here.error < abs(found(SIGMA, bend, Straight).value - here.value) < 0.04 * abs(here.value)


def test_parts_of_a_pupil_add_up_to_the_whole(monkeypatch):
    """Degrees too low for the whole: the pupil is cut, and the sum is within both bounds."""
    whole = found(SIGMA, rays=Wavy)
    for name in ("FINE_DEGREES", "HIGH_DEGREES"):
        monkeypatch.setattr(pupilfields, name, (4, 6, 8))
    parts = found(SIGMA, rays=Wavy)
    assert whole.parts == 1 < parts.parts
    assert abs(parts.value - whole.value) < parts.error + whole.error < 1e-5


def test_more_rays_and_higher_degrees_come_before_a_cut(monkeypatch):
    """What the first rays' polynomials do not follow, those of more rays do, however many these are."""
    whole = found(SIGMA, rays=Wavy)
    monkeypatch.setattr(pupilfields, "MORE", 3000)
    again = found(SIGMA, rays=Wavy)
    assert whole.parts == again.parts == 1
    assert 0.0 < abs(again.value - whole.value) < again.error + whole.error < 1e-6


def test_fields_of_two_charts_do_not_pair():
    with pytest.raises(InputError, match="charts"):
        overlap(focused(0.0), focused(100.0), np.array([SIGMA]))
