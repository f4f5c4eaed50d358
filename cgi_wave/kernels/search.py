"""The search for every path that light can take: depth first, by probe rays that share the prefixes of their paths.

A branch is given up as soon as nothing of it can reach the detector: how much could, at best, from each surface with so
many reflections and splits left, is computed beforehand from the spaces alone.

Status words of a step are those of ``kernels.trace``; nothing is shared but them, so that the two call trees stay apart
(Numba's cache does not notice changes in other files). Rays that leave a branch are dropped from its arrays: deep
branches are thin, and their loops short.
"""

from __future__ import annotations

import numpy as np
from numba import njit

REFRACT, REFLECT = 0, 1
#: Rows of a ray: position, direction cosines (world), optical path length.
ROWS = 7
#: Why branches end, counted by the search: the order, the splits or the coating power run out; the detector cannot be
#: reached any more; it can, but not with power enough; no probe survives the interaction; no probe meets anything.
ORDER, SPLITS, POWER, UNREACHABLE, BOUND, LOST, LEFT, ENDS = 0, 1, 2, 3, 4, 5, 6, 7
#: Room for rounding in the comparison of a bound with the least power.
_SLACK = 1.0 + 1e-12

# No fastmath: the search relies on inf.
_JIT = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(**_JIT)
def _nearest(px, py, pz, dl, dm, dn, dist, hit, rot, org, curvature, conic, kind, half_x, half_y, mid_x, mid_y, s):
    """Take surface ``s`` for the rays that meet it, inside its aperture, before what they have met so far.

    No branch depends on a ray, so that the loop runs on several at a time.
    """
    r00, r01, r02 = rot[0, 0], rot[0, 1], rot[0, 2]
    r10, r11, r12 = rot[1, 0], rot[1, 1], rot[1, 2]
    r20, r21, r22 = rot[2, 0], rot[2, 1], rot[2, 2]
    ox, oy, oz = org[0], org[1], org[2]
    inv_x, inv_y = (1.0 / half_x, 1.0 / half_y) if kind > 0.0 else (0.0, 0.0)
    for i in range(px.shape[0]):
        x, y, z = px[i] - ox, py[i] - oy, pz[i] - oz
        lx = r00 * x + r01 * y + r02 * z
        ly = r10 * x + r11 * y + r12 * z
        lz = r20 * x + r21 * y + r22 * z
        l = r00 * dl[i] + r01 * dm[i] + r02 * dn[i]  # noqa: E741
        m = r10 * dl[i] + r11 * dm[i] + r12 * dn[i]
        n = r20 * dl[i] + r21 * dm[i] + r22 * dn[i]
        t0 = -lz / n
        x0, y0 = lx + t0 * l, ly + t0 * m
        c0 = curvature * (x0 * x0 + y0 * y0)
        b0 = n - curvature * (x0 * l + y0 * m)
        disc = b0 * b0 - curvature * (1.0 + conic * n * n) * c0
        root = np.sqrt(max(disc, 0.0))
        t1 = c0 / (b0 + (root if n > 0.0 else -root))
        t = t0 + t1
        hx, hy = (x0 + t1 * l - mid_x) * inv_x, (y0 + t1 * m - mid_y) * inv_y
        out = hx * hx + hy * hy if kind == 1.0 else max(abs(hx), abs(hy))
        # Not "t <= 0": a ray along the vertex plane makes NaN of it.
        met = (abs(n) >= 1e-9) & (disc >= 0.0) & (t > 0.0) & (out <= 1.0) & (t < dist[i])
        dist[i] = t if met else dist[i]
        hit[i] = s if met else hit[i]


@njit(**_JIT)
def _bend(x, y, z, l, m, n, opl, dist, ratio, index, lost, rot, org, curvature, conic, reflect):  # noqa: E741
    """Carry rays to ``dist`` and refract (``ratio`` of the indices) or reflect them there, in place.

    index: of the space they cross; lost: set to 1 at total internal reflection, else to 0.
    """
    r00, r01, r02 = rot[0, 0], rot[0, 1], rot[0, 2]
    r10, r11, r12 = rot[1, 0], rot[1, 1], rot[1, 2]
    r20, r21, r22 = rot[2, 0], rot[2, 1], rot[2, 2]
    ox, oy, oz = org[0], org[1], org[2]
    k1 = 1.0 + conic
    for i in range(x.shape[0]):
        t = dist[i]
        px, py, pz = x[i] + t * l[i], y[i] + t * m[i], z[i] + t * n[i]
        qx, qy, qz = px - ox, py - oy, pz - oz
        ax = -curvature * (r00 * qx + r01 * qy + r02 * qz)
        ay = -curvature * (r10 * qx + r11 * qy + r12 * qz)
        az = 1.0 - curvature * k1 * (r20 * qx + r21 * qy + r22 * qz)
        nx = r00 * ax + r10 * ay + r20 * az
        ny = r01 * ax + r11 * ay + r21 * az
        nz = r02 * ax + r12 * ay + r22 * az
        norm = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx * norm, ny * norm, nz * norm
        cosi = l[i] * nx + m[i] * ny + n[i] * nz
        disc = 1.0 - ratio[i] * ratio[i] * (1.0 - cosi * cosi)
        cost = np.sqrt(max(disc, 0.0))
        cost = cost if cosi > 0.0 else -cost
        g = -2.0 * cosi if reflect else cost - ratio[i] * cosi
        x[i], y[i], z[i] = px, py, pz
        l[i], m[i], n[i] = ratio[i] * l[i] + g * nx, ratio[i] * m[i] + g * ny, ratio[i] * n[i] + g * nz
        opl[i] += index[i] * t
        lost[i] = 0 if reflect or disc >= 0.0 else 1


@njit(**_JIT)
def reach_table(side_space, start, members, power_t, power_r, splits_t, splits_r, parasitic_t, parasitic_r, detector,
                max_order, max_splits):  # fmt: skip
    """Largest coating power with which light that leaves a surface can reach the detector, geometry disregarded.

    Arguments as in ``search_paths``. Returns (S, 2, max_order + 1, max_splits + 1): for light that leaves the surface
    into the space on its local −z side (0) or +z side (1), with so many parasitic reflections and splits left; 0 if it
    cannot. The largest product over all walks through the spaces in which no surface follows itself.
    """
    count = side_space.shape[0]
    best = np.zeros((count, 2, max_order + 1, max_splits + 1))
    better = True
    while better:
        better = False
        for s in range(count):
            for side in range(2):
                space = side_space[s, side]
                if space < 0:
                    continue
                for j in range(start[space], start[space + 1]):
                    b = members[j]
                    if b == s:
                        continue
                    near = 0 if side_space[b, 0] == space else 1
                    for act in range(2):
                        to = 1 - near if act == REFRACT else near
                        factor = power_t[b] if act == REFRACT else power_r[b]
                        less = parasitic_t[b] if act == REFRACT else parasitic_r[b]
                        fewer = splits_t[b] if act == REFRACT else splits_r[b]
                        for o in range(max_order + 1):
                            for k in range(max_splits + 1):
                                value = 1.0 if b == detector else 0.0
                                if side_space[b, to] >= 0 and o >= less and k >= fewer:
                                    value = max(value, factor * best[b, to, o - less, k - fewer])
                                if value > best[s, side, o, k]:
                                    best[s, side, o, k] = value
                                    better = True
    return best


@njit(**_JIT)
def _branch(rays, number, dist, hit, out, out_number, real, place, lost, s, act, space, target, index, rot, org,
            curvature, conic):  # fmt: skip
    """Carry on, by ``act``, the rays (ROWS, N) that met surface ``s`` from ``space``: how many live on, in ``target``.

    out, out_number receive them; real (3, N), place, lost (N,): room to work in.
    """
    width = 0
    for i in range(hit.shape[0]):
        place[width] = i
        width += int(hit[i] == s)
    for row in range(ROWS):
        values, copy = rays[row], out[row]
        for i in range(width):
            copy[i] = values[place[i]]
    ratio = index[space] / index[target] if act == REFRACT else 1.0
    for i in range(width):
        out_number[i] = number[place[i]]
        real[0, i] = dist[place[i]]
        real[1, i] = ratio
        real[2, i] = index[space]
    _bend(out[0, :width], out[1, :width], out[2, :width], out[3, :width], out[4, :width], out[5, :width],
          out[6, :width], real[0], real[1], real[2], lost, rot, org, curvature, conic, act == REFLECT)  # fmt: skip
    living = 0
    for i in range(width):
        if lost[i] == 0:
            if living < i:
                for row in range(ROWS):
                    out[row, living] = out[row, i]
                out_number[living] = out_number[i]
            living += 1
    return living


@njit(**_JIT)
def search_paths(rays0, space0, rot, org, curvature, conic, aperture, side_space, start, members, index, power_t,
                 power_r, splits_t, splits_r, parasitic_t, parasitic_r, detector, reach, max_order, max_splits,
                 min_power, max_depth, max_paths):  # fmt: skip
    """Depth-first search of every path on which at least one probe ray reaches the detector.

    rays0 (6, N) world rays in space ``space0``; surfaces as in ``trace_sequence`` but with world frames (rot rows are
    the local axes in the world, org the vertices). side_space (S, 2): the space before (local −z) and after each
    surface. start, members: surfaces that bound each space (compressed rows). index: refractive index per space.
    power_t, power_r: coating power; splits_*: 1 where that interaction counts as a split beyond the nominal ones;
    parasitic_*: 1 where it counts as a parasitic reflection. reach: ``reach_table``. A branch ends where order, splits,
    power or depth run out, where nothing of it can reach the detector with ``min_power``, or where no probe is left.
    The prefix of a branch is traced once and shared by all that grow from it.

    Returns (paths (P, max_depth) int64: 2·surface + interaction, lengths, probe counts, first probe that arrives, its
    optical path length from where it started, m, coating power, orders, visits, ends (ENDS,), wrong, overflow): wrong
    counts probes that met a surface from the side of another space, and went no further; overflow is 1 if more than
    max_paths exist or a path was cut at max_depth.
    """
    count = rays0.shape[1]
    rays = np.empty((max_depth + 1, ROWS, count))
    number = np.empty((max_depth + 1, count), dtype=np.int64)  # which probe each column is
    alive = np.zeros(max_depth + 1, dtype=np.int64)
    hit = np.empty((max_depth + 1, count), dtype=np.int64)
    dist = np.empty((max_depth + 1, count))
    real, place, lost = np.empty((3, count)), np.empty(count + 1, dtype=np.int64), np.empty(count, dtype=np.int64)
    seen, first = np.empty(rot.shape[0], dtype=np.int64), np.empty(rot.shape[0], dtype=np.int64)
    ends = np.zeros(ENDS, dtype=np.int64)
    trail = np.empty(max_depth + 1, dtype=np.int64)
    # At every depth of the branch there wait at most two interactions with each surface of one space.
    room = 2 * np.max(start[1:] - start[:-1]) * max_depth
    stack = np.empty((room, 7), dtype=np.int64)  # depth, surface, interaction, order, splits, space, next space
    stack_power = np.empty(room)
    paths = np.empty((max_paths, max_depth), dtype=np.int64)
    lengths = np.zeros(max_paths, dtype=np.int64)
    counts = np.zeros(max_paths, dtype=np.int64)
    powers = np.zeros(max_paths)
    orders = np.zeros(max_paths, dtype=np.int64)
    probes = np.zeros(max_paths, dtype=np.int64)
    opl = np.zeros(max_paths)
    found, top, overflow, visits, wrong = 0, 0, 0, 0, 0
    rays[0, :6] = rays0
    rays[0, 6] = 0.0
    number[0] = np.arange(count)
    alive[0] = count
    depth, space, left, order, split, power = 0, space0, -1, 0, 0, 1.0
    while True:
        # Arrived at `depth` in `space`: look ahead, then push one entry per surface and interaction.
        width = alive[depth]
        r, near, which = rays[depth], dist[depth, :width], hit[depth, :width]
        near[:] = np.inf
        which[:] = -1
        for j in range(start[space], start[space + 1]):
            s = members[j]
            if s != left:
                ap = aperture[s]
                _nearest(r[0, :width], r[1, :width], r[2, :width], r[3, :width], r[4, :width], r[5, :width], near,
                         which, rot[s], org[s], curvature[s], conic[s], ap[0], ap[1], ap[2], ap[3], ap[4],
                         s)  # fmt: skip
            seen[s] = 0
        met = 0
        for i in range(width - 1, -1, -1):
            s = which[i]
            if s < 0:
                continue
            if side_space[s, 0] != side_space[s, 1]:
                along = r[3, i] * rot[s, 2, 0] + r[4, i] * rot[s, 2, 1] + r[5, i] * rot[s, 2, 2]
                if (along > 0.0) != (side_space[s, 0] == space):
                    which[i] = -1
                    wrong += 1
                    continue
            seen[s] += 1
            first[s] = i
            met += 1
        ends[LEFT] += int(met == 0)
        for j in range(start[space], start[space + 1]):
            s = members[j]
            if seen[s] == 0:
                continue
            if s == detector:
                if found == max_paths:
                    overflow = 1
                else:
                    paths[found, :depth] = trail[:depth]
                    lengths[found], counts[found], powers[found] = depth, seen[s], power
                    orders[found], probes[found] = order, number[depth, first[s]]
                    opl[found] = r[6, first[s]] + index[space] * near[first[s]]
                    found += 1
            if depth + 1 > max_depth - 1:
                overflow = 1
                continue
            side = 0 if side_space[s, 0] == space else 1
            for act in range(2):
                factor = power * (power_t[s] if act == REFRACT else power_r[s])
                order2 = order + (parasitic_t[s] if act == REFRACT else parasitic_r[s])
                split2 = split + (splits_t[s] if act == REFRACT else splits_r[s])
                to = 1 - side if act == REFRACT else side
                if order2 > max_order:
                    ends[ORDER] += 1
                elif split2 > max_splits:
                    ends[SPLITS] += 1
                elif factor < min_power:
                    ends[POWER] += 1
                elif side_space[s, to] < 0:
                    ends[UNREACHABLE] += 1
                else:
                    best = reach[s, to, max_order - order2, max_splits - split2]
                    if best == 0.0:
                        ends[UNREACHABLE] += 1
                    elif factor * best * _SLACK < min_power:
                        ends[BOUND] += 1
                    else:
                        stack[top, 0], stack[top, 1], stack[top, 2] = depth, s, act
                        stack[top, 3], stack[top, 4] = order2, split2
                        stack[top, 5], stack[top, 6] = space, side_space[s, to]
                        stack_power[top] = factor
                        top += 1
        # Take the youngest entry whose rays survive the interaction.
        moved = 0
        while top > 0 and moved == 0:
            top -= 1
            parent, s, act = stack[top, 0], stack[top, 1], stack[top, 2]
            order, split, power = stack[top, 3], stack[top, 4], stack_power[top]
            depth, before, space = parent + 1, stack[top, 5], stack[top, 6]
            visits += 1
            moved = _branch(rays[parent], number[parent], dist[parent], hit[parent, : alive[parent]], rays[depth],
                            number[depth], real, place, lost, s, act, before, space, index, rot[s], org[s],
                            curvature[s], conic[s])  # fmt: skip
            ends[LOST] += int(moved == 0)
            alive[depth] = moved
            trail[parent] = 2 * s + act
            left = s
        if moved == 0:
            break
    some = slice(0, found)
    return (paths[some], lengths[some], counts[some], probes[some], opl[some], powers[some], orders[some], visits,
            ends, wrong, overflow)  # fmt: skip
