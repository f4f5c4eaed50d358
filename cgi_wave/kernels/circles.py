"""Boundaries made of circles, as panels for ``kernels.stokes``."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def arc(cx, cy, radius, start, stop, count, out):
    """Fills out (count, 2, D) with a circle's arc from angle start to stop, rad, in even panels: its Taylor series."""
    d = out.shape[2]
    for k in range(count):
        half = 0.5 * (stop - start) / count
        middle = start + (2 * k + 1) * half
        c, s, term = math.cos(middle), math.sin(middle), radius
        for i in range(d):
            turn = i % 4
            out[k, 0, i] = term * (c if turn == 0 else -s if turn == 1 else -c if turn == 2 else s)
            out[k, 1, i] = term * (s if turn == 0 else c if turn == 1 else -s if turn == 2 else -c)
            term *= half / (i + 1)
        out[k, 0, 0] += cx
        out[k, 1, 0] += cy


@njit(cache=True, nogil=True)
def circle_region(circles, signs, out):
    """Boundary of the common inside of some circles (signs +1) without others (−1): panels in out, their number.

    circles (C, 3): centre x, y, radius. Each corner is computed once and used by both circles that meet there.
    """
    count, total = circles.shape[0], 0
    angles = np.empty(2 * count + 2)
    for i in range(count):
        xi, yi, ri = circles[i, 0], circles[i, 1], circles[i, 2]
        found = 0
        for j in range(count):
            if i == j:
                continue
            p, q = min(i, j), max(i, j)
            dx, dy = circles[q, 0] - circles[p, 0], circles[q, 1] - circles[p, 1]
            d, rp, rq = math.hypot(dx, dy), circles[p, 2], circles[q, 2]
            if d == 0.0:
                continue
            along = (d * d + (rp - rq) * (rp + rq)) / (2.0 * d)
            across = (rp - along) * (rp + along)
            # circles that touch to rounding: what lies between them is a sliver of area below 1e-18
            if across <= 1e-12 * rp * rp:
                continue
            across = math.sqrt(across)
            for side in (-1.0, 1.0):
                x = circles[p, 0] + (along * dx - side * across * dy) / d
                y = circles[p, 1] + (along * dy + side * across * dx) / d
                angles[found] = math.atan2(y - yi, x - xi)
                found += 1
        if found == 0:
            angles[0], angles[1], found = -math.pi, math.pi, 1
        else:
            angles[:found].sort()
            angles[found] = angles[0] + 2.0 * math.pi
        for k in range(found):
            a0, a1 = angles[k], angles[k + 1]
            if a1 - a0 < 1e-15:
                continue
            # judged where it is furthest from the other circles: circles that touch may do so at its middle
            inside, clearest = False, -1.0
            for fraction in (0.5, 0.3137, 0.7071):
                angle = a0 + (a1 - a0) * fraction
                mx, my, nearest, within = xi + ri * math.cos(angle), yi + ri * math.sin(angle), 1e300, True
                for j in range(count):
                    if j != i:
                        gap = (circles[j, 2] - math.hypot(mx - circles[j, 0], my - circles[j, 1])) * signs[j]
                        nearest, within = min(nearest, abs(gap)), within and gap > 0.0
                if nearest > clearest:
                    inside, clearest = within, nearest
            if inside:
                pieces = max(1, math.ceil((a1 - a0) / 1.06))
                if total + pieces > out.shape[0]:
                    return -1
                if signs[i] > 0.0:
                    arc(xi, yi, ri, a0, a1, pieces, out[total:])
                else:
                    arc(xi, yi, ri, a1, a0, pieces, out[total:])
                total += pieces
    return total
