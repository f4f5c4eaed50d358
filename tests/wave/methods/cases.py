"""Pairs whose overlap is known, or found by boundary-fitted quadrature of the pupil."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import j1, jv
from synthetic_beams import beam, disc, hole

from cgi_wave.wave.basis import evaluate
from cgi_wave.wave.field import PupilField, fit_field
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.overlap import overlap
from cgi_wave.wave.region import Support

#: Centred, sheared, aberrated, obscured; a tilt alone; W020 not only at half integers, where |γ| hides the edge error.
PAIRS = {
    "perfect": HopkinsPair(),
    "sheared": HopkinsPair(shift_x=0.3, shift_y=-0.1),
    "defocus 1.25": HopkinsPair(w020=1.25),
    "defocus 10.25": HopkinsPair(w020=10.25),
    "all at once": HopkinsPair(
        w020=10.25, w040=0.6, w131=1.0, w222=0.7, shift_x=0.3, shift_y=0.2, obscuration=0.3
    ),
    "tilt": HopkinsPair(w111=6.3, shift_y=1.2),
    "annulus": HopkinsPair(w020=4.1, obscuration=0.6),
}  # fmt: skip


def quadrature(m: PupilField, l: PupilField, sigma: float = 1.0) -> tuple[complex, float]:  # noqa: E741
    """γ and its bound by Gauss panels on the pupil."""
    found = overlap(m, l, np.array([sigma]), 1e-9)
    return complex(found.value[0] * np.exp(2j * np.pi * sigma * found.opd_m[0])), float(found.error_bound[0])


def defocus(w020: float) -> complex:
    """∫ exp(i 2πW r²) over the unit disc / π."""
    return complex(np.exp(1j * np.pi * w020) * np.sinc(w020))


def bessel(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """2 J1(v)/v, Airy's amplitude."""
    return np.where(v == 0.0, 1.0, 2.0 * j1(v) / np.where(v == 0.0, 1.0, v))


def lommel(v: NDArray[np.float64], waves: float) -> NDArray[np.complex128]:
    """∫ exp(i 2πW r²) J0(v r) 2r dr by the series in U1, U2 (|u/v| < 1) or V0, V1; Born and Wolf, 8.8.

    With u = −4πW their exp(−i u r²/2) is our exp(+i 2πW r²).
    """
    u = -4.0 * np.pi * waves
    out = np.empty(v.shape, complex)
    for i, x in np.ndenumerate(v):
        k = np.arange(60 + int(x / 2))  # the terms fall once their order exceeds v
        if abs(u) < x:
            u1 = np.sum((-1.0) ** k * (u / x) ** (2 * k + 1) * jv(2 * k + 1, x))
            u2 = np.sum((-1.0) ** k * (u / x) ** (2 * k + 2) * jv(2 * k + 2, x))
            c, s = u1 * np.cos(u / 2) + u2 * np.sin(u / 2), u1 * np.sin(u / 2) - u2 * np.cos(u / 2)
        else:
            v0 = np.sum((-1.0) ** k * (x / u) ** (2 * k) * jv(2 * k, x))
            v1 = np.sum((-1.0) ** k * (x / u) ** (2 * k + 1) * jv(2 * k + 1, x))
            turn = x**2 / (2 * u)
            c = np.sin(turn) + v0 * np.sin(u / 2) - v1 * np.cos(u / 2)
            s = np.cos(turn) - v0 * np.cos(u / 2) - v1 * np.sin(u / 2)
        out[i] = 2.0 / u * (c - 1j * s)
    return out


def cut_pair(sigma: float = 1.0e6) -> tuple[PupilField, PupilField]:
    """Two fitted fields: a disc cut by a vertical edge along the grid and by a slanted one, apodised; an annulus."""
    edges = [disc(1.0), lambda x, y: 0.55 - x, lambda x, y: 0.7 - 0.6 * x - 0.8 * y]
    one = beam(
        lambda x, y: 2.3 * (x**2 + y**2) + 0.8 * x**2 * y - 1.1 * x,
        edges,
        lambda x, y: 1.0 - 0.3 * x + 0.2 * y**2,
        phase=0.7,
    )
    two = beam(lambda x, y: 0.9 * y, [disc(0.95, 0.1, 0.05), hole(0.3, 0.1, 0.05)])
    return fit_field(one), fit_field(two)


def area(support: Support) -> tuple[float, float]:
    """Lowest and highest area that a fine grid allows a support: cells all inside, and cells not all outside."""
    n = 1500
    x = (np.arange(n) + 0.5) / n * 2.0 - 1.0
    least = evaluate(support.clearance, x, x).min(axis=0)
    least = np.minimum(least, 1.0 - x[:, None] ** 2 - x[None, :] ** 2)
    step = max(np.abs(np.diff(least, axis=a)).max() for a in (0, 1))
    cell = 4.0 / n**2 * float(np.prod(support.scale))
    return float((least > step).sum()) * cell, float((least > -step).sum()) * cell
