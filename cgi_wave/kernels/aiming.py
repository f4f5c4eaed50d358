"""Aiming rays at a point, and counting a wavefront's focal points: loops over traces with tangents.

The loops below are those of ``kernels.trace``. Numba's cache does not notice changes there: after one, set
``NUMBA_CACHE_DIR`` to an empty folder.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cgi_wave.kernels.trace import (
    BACKWARD,
    KINDS,
    REFLECT,
    SIX,
    WIDE,
    bend_there,
    carry_on,
    launch,
    to_surface,
    trace_sequence,
)

_JIT = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(**_JIT)
def aim_rays(rot, shift, curvature, conic, n1, n2, mode, side, weight, bare, aperture, film, back_off, p, target,
             theta, tolerance, longest, rounds, rays, tangent, opl, power, status, clearance, foot):  # fmt: skip
    """Newton's method for the directions with which rays from p (N, 2) end on ``target`` (2,; m).

    Sequence as in ``trace_sequence``. theta (N, 2): first guess, changed in place; tolerance, m, of where a ray ends;
    longest: step of theta beyond which a ghost far out of focus might leave the field; rounds: traces at most.
    rays (6, N), tangent (2, 6, N; by theta), opl, power, status, clearance (N,), foot (K, 2, N; or K = 0 for none):
    receive what the last trace of each ray left. Returns (N,) whether a ray arrived.
    """
    count = p.shape[0]
    arrived = np.zeros(count, dtype=np.bool_)
    todo = np.arange(count)
    left = count
    for _ in range(rounds):
        if left == 0:
            break
        p_now, theta_now = np.empty((left, 2)), np.empty((left, 2))
        for j in range(left):
            p_now[j], theta_now[j] = p[todo[j]], theta[todo[j]]
        rays_now, tangent_now = np.empty((6, left)), np.empty((2, 6, left))
        opl_now, power_now, clear_now = np.empty(left), np.ones(left), np.full(left, np.inf)
        status_now = np.zeros(left, dtype=np.int64)
        foot_now = np.empty((foot.shape[0], 2, left))
        launch(p_now, theta_now, back_off, n1[0], 0, rays_now, tangent_now, opl_now)
        trace_sequence(rot, shift, curvature, conic, n1, n2, mode, side, weight, bare, aperture, film, rays_now,
                       tangent_now, opl_now, power_now, status_now, clear_now, foot_now)  # fmt: skip
        still = 0
        for j in range(left):
            i = todo[j]
            rays[:, i] = rays_now[:, j]
            tangent[:, :, i] = tangent_now[:, :, j]
            opl[i], power[i], status[i], clearance[i] = opl_now[j], power_now[j], status_now[j], clear_now[j]
            miss_x, miss_y = target[0] - rays_now[0, j], target[1] - rays_now[1, j]
            valid = (status[i] == 0 or status[i] % KINDS >= BACKWARD) and np.isfinite(opl[i])
            # A ray that has no end, or one a metre away, says nothing of where to aim.
            if not (valid and miss_x * miss_x + miss_y * miss_y < 1.0):
                continue
            if max(abs(miss_x), abs(miss_y)) < tolerance:
                arrived[i] = True
                foot[:, :, i] = foot_now[:, :, j]
                continue
            a, b = tangent_now[0, 0, j], tangent_now[1, 0, j]
            c, d = tangent_now[0, 1, j], tangent_now[1, 1, j]
            det = a * d - b * c
            if not abs(det) > 1e-14:  # x does not answer to theta
                continue
            step_x, step_y = (d * miss_x - b * miss_y) / det, (a * miss_y - c * miss_x) / det
            size = np.sqrt(step_x * step_x + step_y * step_y)
            shorten = min(1.0, longest / size) if size > 0.0 else 1.0
            theta[i, 0] += shorten * step_x
            theta[i, 1] += shorten * step_y
            if theta[i, 0] ** 2 + theta[i, 1] ** 2 > 0.25:  # beyond 30 degrees no light enters
                continue
            todo[still] = i
            still += 1
        left = still
    return arrived


@njit(**_JIT)
def _zeros(base, rate, length):
    """How often det(base + s·rate), base and rate (2, 2), vanishes for 0 < s < length.

    It is a s² + b s + c, and its roots are real but for rounding, since a wavefront's curvature is symmetric.
    """
    a = rate[0, 0] * rate[1, 1] - rate[0, 1] * rate[1, 0]
    c = base[0, 0] * base[1, 1] - base[0, 1] * base[1, 0]
    b = base[0, 0] * rate[1, 1] + rate[0, 0] * base[1, 1] - base[0, 1] * rate[1, 0] - rate[0, 1] * base[1, 0]
    root = np.sqrt(max(b * b - 4.0 * a * c, 0.0))
    # 1/s is finite where the wavefront is plane: roots of c u² + b u + a beyond 1/length.
    return int((root - b) / (2.0 * c) > 1.0 / length) + int((-root - b) / (2.0 * c) > 1.0 / length)


@njit(**_JIT)
def count_caustics(rot, shift, curvature, conic, n1, n2, mode, first, rays, tangent):
    """How many of its wavefront's focal points one ray passes, from surface ``first`` of its sequence to the last.

    Sequence as in ``trace_sequence``; rays (6, 1), tangent (2, 6, 1): the ray and the two neighbours that span the
    wavefront; the ray is changed in place.
    """
    x, y, z, l, m, n = rays[0], rays[1], rays[2], rays[3], rays[4], rays[5]  # noqa: E741
    way, opl, status, cos_in, cos_out = np.empty(1), np.zeros(1), np.zeros(1, dtype=np.int64), np.empty(1), np.empty(1)
    base, rate, across, carried = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 3)), np.empty(2 * SIX)
    for t in range(2):
        for row in range(6):
            carried[t * SIX + row * WIDE] = tangent[t, row, 0]
    found = 0
    for k in range(curvature.shape[0]):
        # Two axes across the ray; neighbours are seen in planes across it.
        across[0] = 0.0
        if abs(l[0]) < 0.9:
            size = np.sqrt(m[0] * m[0] + n[0] * n[0])
            across[0, 1], across[0, 2] = n[0] / size, -m[0] / size
        else:
            size = np.sqrt(l[0] * l[0] + n[0] * n[0])
            across[0, 0], across[0, 2] = -n[0] / size, l[0] / size
        across[1, 0] = m[0] * across[0, 2] - n[0] * across[0, 1]
        across[1, 1] = n[0] * across[0, 0] - l[0] * across[0, 2]
        across[1, 2] = l[0] * across[0, 1] - m[0] * across[0, 0]
        for t in range(2):
            for axis in range(2):
                base[t, axis] = rate[t, axis] = 0.0
                for row in range(3):
                    base[t, axis] += carried[t * SIX + row * WIDE] * across[axis, row]
                    rate[t, axis] += carried[t * SIX + (3 + row) * WIDE] * across[axis, row]
        to_surface(x, y, z, l, m, n, way, opl, status, rot[k], shift[k], curvature[k], conic[k], n1[k], 0.0, KINDS)
        if k > first:
            # A virtual ray runs backwards.
            found += _zeros(base, rate if way[0] > 0.0 else -rate, abs(way[0]))
        reflect = mode[k] == REFLECT
        carry_on(x, y, z, l, m, n, way, carried, rot[k], curvature[k], conic[k], n1[k], n2[k], reflect)
        bend_there(x, y, z, l, m, n, cos_in, cos_out, status, curvature[k], conic[k], n1[k], n2[k], reflect, KINDS)
    return found
