"""Fringe fields given by polynomials, and the slow oracle: every pixel, pair and spectral sample."""

from __future__ import annotations

import numpy as np

from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.field import FieldPair, FringeField, SceneView, Shadow

SIGMA0 = 1.0 / 0.764e-6
PIXEL = 15e-6
BAND = (SIGMA0 - 4e3, SIGMA0 + 4e3)


def zone_of(rows=(100, 124), columns=(40, 60)):
    """x0, x1, y0, y1, m, of rows and columns of a detector of 1024 × 1024 pixels."""
    return tuple((edge - 512) * PIXEL for edge in (*columns, *rows))


def field(pairs, transmission, family, arms, rows=(100, 124), columns=(40, 60), shadows=(), views=(), nodes=(5, 4)):
    """pairs: (m, l, gamma(σ, x, y), opd(σ, x, y)), transmission: t(x, y) per beam; x, y in units of half the zone."""
    zone = zone_of(rows, columns)
    y, x = chebyshev.nodes(nodes[0], *zone[2:]), chebyshev.nodes(nodes[1], *zone[:2])
    u = (x - 0.5 * (zone[0] + zone[1])) / (0.5 * (zone[1] - zone[0]))
    v = (y - 0.5 * (zone[2] + zone[3])) / (0.5 * (zone[3] - zone[2]))
    v, u = np.meshgrid(v, u, indexing="ij")
    sigma = chebyshev.nodes(8, *BAND)
    made = tuple(
        FieldPair(m, l, sigma, np.array([gamma(s, u, v) + 0j * u for s in sigma]),
                  np.array([opd(s, u, v) + 0.0 * u for s in sigma]), 0.0, 0.0)
        for m, l, gamma, opd in pairs  # noqa: E741
    )  # fmt: skip
    t = np.array([one(u, v) + 0.0 * u for one in transmission])
    family = np.array(family)
    return FringeField(
        "NIR", x, y, zone, rows, columns, PIXEL, tuple(f"beam {i}" for i in range(len(t))), family,
        (family > 0).astype(int), np.array(arms), t, np.zeros(len(t)), 0.0, made, SIGMA0, tuple(shadows),
        tuple(views), 0.0, 0.0,
    )  # fmt: skip


def michelson(opd=1.33e-3, **options):
    """Two nominal beams with a sloped, dispersive OPD, a ghost family of two with fringes of its own, and a weak ghost.

    The family's view of the scene is ``flipped`` and blurred; the weak ghost images the scene onto itself.
    """

    def nominal(s, u, v):
        return opd + 1.2e-6 * v + 0.02e-6 * u * v + 0.01e-6 * v * v + 2e-9 * (s - SIGMA0) / 100.0

    def half(s, u, v):  # not a whole multiple of the nominal fringes
        return 0.3 * opd + 0.7e-6 * v - 0.4e-6 * u

    pairs = [
        (0, 1, lambda s, u, v: 0.97 * np.exp(0.3j * u * v), nominal),
        (2, 3, lambda s, u, v: 0.8 * np.exp(2j + 1e-5j * (s - SIGMA0) * v), lambda s, u, v: 2.0 * nominal(s, u, v)),
        (4, 0, lambda s, u, v: 0.05 + 0.02j * u, half),
        (2, 1, lambda s, u, v: 0.1j - 0.03 * v, lambda s, u, v: -nominal(s, u, v) + 2e-7 * u),
    ]
    powers = [lambda u, v: 0.25 - 0.01 * u, lambda u, v: 0.24 + 0.01 * v, lambda u, v: 0.004 + 0.001 * v * u,
              lambda u, v: 0.005 + 0.0 * u, lambda u, v: 1e-4 + 1e-5 * u]  # fmt: skip
    kernel = np.outer(np.hanning(9), np.hanning(7))
    views = [
        SceneView(1, "flipped", np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), kernel / kernel.sum(), 0.0),
        SceneView(2, "onto itself", np.eye(2, 3), np.ones((1, 1)), 0.0),
    ]
    arms = [(1, 0), (0, 1), (2, 0), (1, 1), (1, 0)]
    return field(pairs, powers, [0, 0, 1, 1, 2], arms, views=views, **options)


def spectrum(samples=1500):
    """Wavenumbers, and two shapes behind one filter: a comb of lines, and its derivative by depth."""
    sigma = np.linspace(*BAND, samples)
    filter_ = np.exp(-(((sigma - SIGMA0) / 1.7e3) ** 4))
    depth = 0.5 * (1.0 + np.cos(2.0 * np.pi * (sigma - SIGMA0) * 1.33e-3))
    return sigma, np.array([filter_ * np.exp(-depth), -filter_ * depth * np.exp(-depth)])


def direct(zone: FringeField, sigma, weights, pixel=0, layer=None):
    """(C, R, K) pattern by the sum of every term in float64; pixel: Gauss points per axis within it, 0 for its centre.

    layer: only beams of these families, and pairs whose light they carry (see ``pattern``); None for all.
    """
    step = np.gradient(sigma)
    step[[0, -1]] = 0.5 * (sigma[1] - sigma[0])
    w = weights * step / (weights[0] @ step)
    node, share = np.polynomial.legendre.leggauss(max(pixel, 1))
    out = np.zeros((len(weights), zone.rows[1] - zone.rows[0], zone.columns[1] - zone.columns[0]))
    shade = np.ones((2, out.shape[1]))
    for shadow in zone.shadows:
        shade[shadow.arm - 1] *= shadow.passed(zone.y_pixels)
    for a, wa in zip(node, share, strict=True):
        for b, wb in zip(node, share, strict=True):
            to_y, to_x = zone.to(zone.y_pixels + 0.5 * PIXEL * a, zone.x_pixels + 0.5 * PIXEL * b)
            part = 0.25 * wa * wb
            t = to_y @ zone.transmission @ to_x
            for i, family in enumerate(zone.family):
                dim = (shade[0] ** zone.arms[i, 0] * shade[1] ** zone.arms[i, 1])[:, None]
                if layer is None or family in layer:
                    out += part * w.sum(axis=1)[:, None, None] * t[i] * dim
            for pair in zone.pairs:
                ends = {int(zone.family[pair.m]), int(zone.family[pair.l])}
                if layer is not None and min(ends) not in layer:
                    continue
                gamma, opd = (to_y @ values @ to_x for values in (pair.gamma, pair.opd_m))
                passes = zone.arms[[pair.m, pair.l]].max(axis=0)
                dim = (shade[0] ** passes[0] * shade[1] ** passes[1])[:, None]
                amplitude = part * 2.0 * (to_y @ zone.strength(pair) @ to_x) * dim
                at = chebyshev.interpolation_matrix(pair.sigma, sigma)
                for row, s, weight in zip(at, sigma, w.T, strict=True):
                    wave = np.exp(2j * np.pi * s * np.tensordot(row, opd, 1)) * np.tensordot(row, gamma, 1)
                    out += weight[:, None, None] * amplitude * wave.real
    return out


def dark_row(row, half_width=3.3 * PIXEL, arm=1):
    """A shadow about a row's edge."""
    return Shadow(arm, (row - 512) * PIXEL, half_width)
