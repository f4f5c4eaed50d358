"""What becomes of a traced fan of rays: which of them count, where the light is, charts, and the apertures near it.

A beam has a few hundred rays, and there are thousands of beams: each loop does in one go what would be a dozen calls on
small arrays. Rays are columns where they come from ``kernels.trace`` and rows where they go.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cgi_wave.kernels.trace import BACKWARD, KINDS

_JIT = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(**_JIT)
def lit_disc(status, clearance, p, radius):
    """Rays that pass (status 0, clearance above 0) from within a pupil of ``radius``: how many, and a disc that holds
    their pupil points p (N, 2): its centre and radius (0 where none passes)."""
    x_low, x_high, y_low, y_high = np.inf, -np.inf, np.inf, -np.inf
    lit = np.empty(p.shape[0], dtype=np.bool_)
    count = 0
    for i in range(p.shape[0]):
        x, y = p[i, 0], p[i, 1]
        lit[i] = status[i] == 0 and clearance[i] > 0.0 and x * x + y * y < radius * radius
        if lit[i]:
            count += 1
            x_low, x_high = min(x_low, x), max(x_high, x)
            y_low, y_high = min(y_low, y), max(y_high, y)
    if count == 0:
        return 0, 0.0, 0.0, 0.0
    x_mid, y_mid, reach = 0.5 * (x_low + x_high), 0.5 * (y_low + y_high), 0.0
    for i in range(p.shape[0]):
        if lit[i]:
            reach = max(reach, (p[i, 0] - x_mid) ** 2 + (p[i, 1] - y_mid) ** 2)
    return count, x_mid, y_mid, np.sqrt(reach)


@njit(**_JIT)
def valid_rays(status, opl, p, keep):
    """Mark in ``keep`` (N,) the rays that have an intersection everywhere (as ``rays.trace.Traced.valid``): how many,
    and which of them stands nearest to their middle."""
    count, x, y = 0, 0.0, 0.0
    for i in range(p.shape[0]):
        keep[i] = (status[i] == 0 or status[i] % KINDS >= BACKWARD) and np.isfinite(opl[i])
        if keep[i]:
            count += 1
            x += p[i, 0]
            y += p[i, 1]
    x /= max(count, 1)
    y /= max(count, 1)
    nearest, least = 0, np.inf
    for i in range(p.shape[0]):
        if keep[i]:
            away = (p[i, 0] - x) ** 2 + (p[i, 1] - y) ** 2
            if away < least:
                nearest, least = i, away
    return count, nearest


@njit(**_JIT)
def chart_rays(keep, p, theta, x0, bend, x, direction, opl, power, dx, dq, u, path, amplitude, q, end):
    """The rays marked in ``keep`` (N,) in the chart of ``bend``, 1/m, about x0 (2,): see ``rays.charts``.

    p, x, direction (N, 2), opl, power (N,), dx, dq (N, 2, 2): as traced from direction theta (2,), by p. Receive, M
    rays each: u (M, 2), path (M,) about it, amplitude (M,): √(power / |det ∂u/∂p|), q (M, 2) direction cosines, end
    (M, 2) on the detector.
    """
    j = 0
    for i in range(p.shape[0]):
        if not keep[i]:
            continue
        qx, qy = direction[i, 0], direction[i, 1]
        ax, ay = x[i, 0] - x0[0], x[i, 1] - x0[1]
        # The incoming plane wave reaches pupil point p with the phase of p·θ.
        path[j] = opl[i] + (p[i, 0] * theta[0] + p[i, 1] * theta[1]) - (qx * ax + qy * ay)
        path[j] += 0.5 * bend * (ax * ax + ay * ay)
        a, b = dq[i, 0, 0] - bend * dx[i, 0, 0], dq[i, 0, 1] - bend * dx[i, 0, 1]
        c, d = dq[i, 1, 0] - bend * dx[i, 1, 0], dq[i, 1, 1] - bend * dx[i, 1, 1]
        size = abs(a * d - b * c)
        amplitude[j] = np.sqrt(power[i] / (1e-300 if size < 1e-300 else size))
        u[j, 0], u[j, 1] = qx - bend * ax, qy - bend * ay
        q[j, 0], q[j, 1] = qx, qy
        end[j, 0], end[j, 1] = x[i, 0], x[i, 1]
        j += 1


@njit(**_JIT)
def rows_of(aperture):
    """How many clearances the apertures (K, APERTURE_COLUMNS) have: one per circle, four per rectangle."""
    rows = 0
    for k in range(aperture.shape[0]):
        rows += 1 if aperture[k, 0] == 1.0 else 4 if aperture[k, 0] == 2.0 else 0
    return rows


@njit(**_JIT)
def mark_near(aperture, foot, keep, limit, near):
    """Mark in ``near`` (R,) the clearances that fall below ``limit`` on a ray of ``keep`` (N,), at footprints
    (K, 2, N); rows as in ``rows_of``, smooth in x and y, 1 at an aperture's centre and 0 at its edge."""
    row = 0
    for k in range(aperture.shape[0]):
        ap, x, y = aperture[k], foot[k, 0], foot[k, 1]
        # Numbers of rays, not the least clearance: a minimum waits for the one before.
        low_x, high_x, low_y, high_y = 0, 0, 0, 0
        if ap[0] == 1.0:
            inv = 1.0 / (ap[1] * ap[1])
            for i in range(x.shape[0]):
                dx, dy = x[i] - ap[3], y[i] - ap[4]
                low_x += int(keep[i] & (1.0 - (dx * dx + dy * dy) * inv < limit))
            near[row] |= low_x > 0
            row += 1
        elif ap[0] == 2.0:
            by_x, by_y = 1.0 / ap[1], 1.0 / ap[2]
            for i in range(x.shape[0]):
                dx, dy = (x[i] - ap[3]) * by_x, (y[i] - ap[4]) * by_y
                low_x += int(keep[i] & (1.0 - dx < limit))
                high_x += int(keep[i] & (1.0 + dx < limit))
                low_y += int(keep[i] & (1.0 - dy < limit))
                high_y += int(keep[i] & (1.0 + dy < limit))
            near[row] |= low_x > 0
            near[row + 1] |= high_x > 0
            near[row + 2] |= low_y > 0
            near[row + 3] |= high_y > 0
            row += 4


@njit(**_JIT)
def _round_row(x, y, ap, keep, whole, row):
    """Clearances (M,) from a circle, of the rays marked in ``keep`` (N,), or of the ``whole`` slice."""
    inv, j = 1.0 / (ap[1] * ap[1]), 0
    if whole:
        for i in range(x.shape[0]):
            dx, dy = x[i] - ap[3], y[i] - ap[4]
            row[i] = 1.0 - (dx * dx + dy * dy) * inv
        return
    for i in range(x.shape[0]):
        if keep[i]:
            dx, dy = x[i] - ap[3], y[i] - ap[4]
            row[j] = 1.0 - (dx * dx + dy * dy) * inv
            j += 1


@njit(**_JIT)
def _straight_row(x, middle, inv, keep, whole, row):
    """Clearances (M,) from one side of a rectangle, ``1/inv`` from its middle; as ``_round_row``."""
    j = 0
    if whole:
        for i in range(x.shape[0]):
            row[i] = 1.0 - (x[i] - middle) * inv
        return
    for i in range(x.shape[0]):
        if keep[i]:
            row[j] = 1.0 - (x[i] - middle) * inv
            j += 1


@njit(**_JIT)
def clearance_rows(aperture, foot, keep, p, radius, near, out):
    """Clearances (1 + R', M) into ``out``: the pupil's, of ``radius``, at p (N, 2), then those of ``rows_of`` marked in
    ``near``, at footprints (K, 2, N); rays of ``keep`` (N,)."""
    j, whole = 0, out.shape[1] == p.shape[0]
    for i in range(p.shape[0]):
        if keep[i]:
            out[0, j] = 1.0 - (p[i, 0] * p[i, 0] + p[i, 1] * p[i, 1]) / (radius * radius)
            j += 1
    row, place = 0, 1
    for k in range(aperture.shape[0]):
        ap = aperture[k]
        if ap[0] == 1.0:
            if near[row]:
                _round_row(foot[k, 0], foot[k, 1], ap, keep, whole, out[place])
                place += 1
            row += 1
        elif ap[0] == 2.0:
            for side in range(4):
                if near[row]:
                    axis, sign = side // 2, 1.0 - 2.0 * (side % 2)
                    _straight_row(foot[k, axis], ap[3 + axis], sign / ap[1 + axis], keep, whole, out[place])
                    place += 1
                row += 1
