"""What users of other libraries would do for the overlap of two pupils: sum over pupil samples, on each one's own grid.

By Parseval this is the overlap of their PSFs, without the transform and with no window to choose: the kindest reading.
Each entry is a function of the pair and of N, the samples across beam m's pupil. Libraries are imported when first
used; those that are not installed are left out. Each takes its aperture and coordinates from the library named.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from cgi_wave.wave.hopkins import HopkinsPair

Peer = Callable[[HopkinsPair, int], complex]


def _contrast(m: np.ndarray, l: np.ndarray, waves: np.ndarray) -> complex:  # noqa: E741
    """Both beams have the same pupil, so that one power normalises both."""
    return complex(np.sum(m * l * np.exp(2j * np.pi * waves)) / np.sum(m * m))


def prysm(pair: HopkinsPair, n: int) -> complex:
    """Binary masks, Hopkins polynomials."""
    from prysm.coordinates import cart_to_polar, make_xy_grid
    from prysm.geometry import circle
    from prysm.polynomials import hopkins

    x, y = make_xy_grid(n, diameter=2.0)
    r, t = cart_to_polar(y, x)  # its angle is measured from the meridional axis, our y
    m = circle(1.0, r) & ~circle(pair.obscuration, r)
    r_l, _ = cart_to_polar(x + pair.shift_x, y + pair.shift_y)
    l = circle(1.0, r_l) & ~circle(pair.obscuration, r_l)  # noqa: E741
    terms = {(0, 2): pair.w020, (0, 4): pair.w040, (1, 3): pair.w131, (2, 2): pair.w222, (1, 1): pair.w111}
    waves = np.zeros_like(r)
    for (a, b), value in terms.items():
        if value:
            # hopkins(a, b, c) is cos(a t) r**b H**c; cos² t = (1 + cos 2t)/2
            if a == 2:
                waves += 0.5 * value * (hopkins(0, 2, 0, r, t, 1.0) + hopkins(2, 2, 0, r, t, 1.0))
            else:
                waves += value * hopkins(a, b, 0, r, t, 1.0)
    return _contrast(m.astype(float), l.astype(float), waves)


def poppy(pair: HopkinsPair, n: int) -> complex:
    """Circular apertures with grey pixels at their edges."""
    import astropy.units as u
    import poppy as library

    wave = library.Wavefront(npix=n, diam=2.0 * u.m, wavelength=1.0 * u.m)
    y, x = wave.coordinates()

    def aperture(dx: float, dy: float) -> np.ndarray:
        disc = library.CircularAperture(radius=1.0 * u.m, shift_x=dx, shift_y=dy)
        found = disc.get_transmission(wave)
        if pair.obscuration:
            hole = library.CircularAperture(radius=pair.obscuration * u.m, shift_x=dx, shift_y=dy)
            found = found * (1.0 - hole.get_transmission(wave))
        return np.asarray(found)

    waves = pair.wavefront(x + pair.shift_x, y + pair.shift_y)
    return _contrast(aperture(0.0, 0.0), aperture(-pair.shift_x, -pair.shift_y), waves)


def hcipy(pair: HopkinsPair, n: int) -> complex:
    """Obstructed circular apertures, supersampled four times."""
    import hcipy as library

    grid = library.make_pupil_grid(n, 2.0)
    aperture = library.make_obstructed_circular_aperture(2.0, pair.obscuration)
    m = library.evaluate_supersampled(aperture, grid, 4)
    l = library.evaluate_supersampled(aperture, grid.shifted([pair.shift_x, pair.shift_y]), 4)  # noqa: E741
    return _contrast(m, l, pair.wavefront(grid.x + pair.shift_x, grid.y + pair.shift_y))


def finufft(pair: HopkinsPair, n: int) -> complex:
    """The middle of the mutual PSF by type 1, from n × n polar nodes fitted to beam m's pupil but not to beam l's."""
    import finufft as library

    e = pair.obscuration
    nodes, weights = _gauss(n)
    rho, theta = e + (1.0 - e) * nodes, 2.0 * math.pi * np.arange(n) / n
    x, y = np.outer(rho, np.cos(theta)).ravel(), np.outer(rho, np.sin(theta)).ravel()
    w = np.repeat(rho * weights * (1.0 - e) * 2.0 * math.pi / n, n)
    off = np.hypot(x + pair.shift_x, y + pair.shift_y)
    lit = (off <= 1.0) & (off >= e)
    x, y = x[lit], y[lit]
    field = w[lit] * np.exp(2j * np.pi * pair.wavefront(x + pair.shift_x, y + pair.shift_y))
    return complex(library.nufft2d1(x, y, field, (1, 1), eps=1e-12, nthreads=1)[0, 0] / pair.power)


def _gauss(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Composite 16-point Gauss nodes and weights on (0, 1), n of them."""
    x, w = np.polynomial.legendre.leggauss(16)
    panels = max(1, n // 16)
    start = np.arange(panels)[:, None]
    return ((start + 0.5 * (x + 1.0)) / panels).ravel(), np.tile(0.5 * w / panels, panels)


def available() -> dict[str, Peer]:
    """The peers whose library can be imported."""
    found: dict[str, Peer] = {}
    for name, peer in (("prysm", prysm), ("poppy", poppy), ("hcipy", hcipy), ("finufft", finufft)):
        if find_spec(name) is None:
            continue
        try:
            peer(HopkinsPair(w020=0.1), 16)
        except Exception as error:  # a broken installation of somebody else's library is no reason to stop
            print(f"{name} is installed but does not work: {error!r}")
            continue
        found[name] = peer
    return found
