"""Integrals without oscillation over the region that curves enclose, for bounds; and what its boundary leaves open.

The area integral of a polynomial g is ∮ (x dy − y dx) ∫₀¹ t g(t x, t y) dt, whatever the region's shape and wherever
the origin lies: g goes on beyond the region. Sixteen nodes along t are exact up to degree 30; a curve gets eight.

Curves are powers of s in [-1, 1] with the region to their left (see ``kernels.outline``), polynomials (n, n) powers of
the frame's coordinates.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cgi_wave.kernels.outline import GAUSS, GW, GX
from cgi_wave.kernels.polynomials import JIT, along_ray, gradient, horner, slope_at

ALONG = 8  # nodes on a curve
_X, _W = np.polynomial.legendre.leggauss(ALONG)


@njit(**JIT)
def enclosed(curves, owner, clear, residual, a, b):
    """(∫ a b, ∫ a², ∫ b², area, edge, rim) of the region that curves (C, 2, D) enclose.

    rim: ∮ |a b| ds, by which a shift of the boundary changes the first at most; edge: the same times the distance by
    which the clearances' residual (K,) leaves each place of the boundary open, at most the frame's width. owner (C,):
    the clearance (K, n, n) of each curve, negative for none.
    """
    n = a.shape[0]
    la, lb = np.empty(n), np.empty(n)
    cross, aa, bb, area, edge, rim = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(curves.shape[0]):
        px, py = curves[k, 0], curves[k, 1]
        for g in range(ALONG):
            s, w = _X[g], _W[g]
            x, y, dx, dy = horner(px, s), horner(py, s), slope_at(px, s), slope_at(py, s)
            turn = (x * dy - y * dx) * w
            along_ray(a, x, y, la)
            along_ray(b, x, y, lb)
            for q in range(GAUSS):
                va, vb, share = horner(la, GX[q]), horner(lb, GX[q]), turn * GX[q] * GW[q]
                cross += va * vb * share
                aa += va * va * share
                bb += vb * vb * share
            area += 0.5 * turn
            here = abs(horner(la, 1.0) * horner(lb, 1.0)) * math.hypot(dx, dy) * w
            rim += here
            if owner[k] >= 0:
                _, gx, gy = gradient(clear[owner[k]], x, y)
                edge += here * min(residual[owner[k]] / max(math.hypot(gx, gy), 1e-300), 2.0)
    return cross, aa, bb, area, edge, rim
