"""Rays walked through an instrument without a sequence: each goes where geometry and lots send it, and none is lost.

A ray in a space meets the nearest surface that bounds this space, inside its aperture, as in ``kernels.search``; there
its weight is divided among reflection, transmission, scattering and absorption. Weights are whole numbers of units, so
that whatever a ray began with is found again, to the last unit, in the sums of ``walk_rays``. Random numbers belong to
the number of a ray: what becomes of it does not depend on which thread takes it, nor on the rays beside it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Weight of a ray at its start. ``SLICE`` rays add up to less than 2^63.
UNIT = 1 << 50
SLICE = 4096
TRANSMIT, REFLECT, SCATTER = 0, 1, 2
#: Source directions: one, even over a rectangle or over a disc of direction cosines.
DIRECTION, RECTANGLE, DISC = 0, 1, 2
#: Tallies before those of the surfaces, groups of tallies per surface, and arrivals by order: 0, 1, 2, more, scattered.
SINGLE, GROUPS, ORDERS = 2, 4, 5

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_M1, _M2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S27, _S30, _S31, _S11, _ONE = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11), np.uint64(1)

# No fastmath: the walk relies on inf.
_JIT = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(**_JIT)
def _mix(z):
    """A bijection of 64 bits in which every output bit hangs on every input bit (SplitMix64's finisher)."""
    z = (z ^ (z >> _S30)) * _M1
    z = (z ^ (z >> _S27)) * _M2
    return z ^ (z >> _S31)


@njit(**_JIT)
def _seed(random, seed, number):
    """Start the stream of one ray: its state and its odd stride (as in SplittableRandom, Steele et al. 2014)."""
    own = _mix(np.uint64(seed) + _GOLDEN * (np.uint64(number) + _ONE))
    random[0] = _mix(own)
    random[1] = _mix(own + _GOLDEN) | _ONE


@njit(**_JIT)
def _uniform(random):
    """The next number of a stream, in [0, 1)."""
    random[0] += random[1]
    return np.float64(_mix(random[0]) >> _S11) * 1.1102230246251565e-16


@njit(**_JIT)
def lobe(reach, width, slope):
    """∫ b (1 + (b/L)²)^(S/2) db from 0 to ``reach``, over L²/2: Harvey's lobe inside a circle of direction cosines."""
    power = 0.5 * (slope + 2.0)
    wide = np.log1p((reach / width) ** 2)
    return wide if power == 0.0 else np.expm1(power * wide) / power


@njit(**_JIT)
def lobe_reach(inside, width, slope):
    """Inverse of ``lobe``."""
    power = 0.5 * (slope + 2.0)
    wide = inside if power == 0.0 else np.log1p(power * inside) / power
    return width * np.sqrt(np.expm1(wide))


@njit(**_JIT)
def scattered(random, ray, normal, tis, width, slope, out):
    """Scatter about a specular direction: the share that is scattered, with one direction of it, or 0.

    ray (3,): specular direction; normal (3,): unit normal of the surface; out (3,) receives the direction. tis: share
    at normal incidence. The lobe is the same in direction cosines at every incidence (Harvey); what of it lies outside
    the unit circle does not exist and stays specular: the expected share is the lobe's integral inside.
    """
    along = ray[0] * normal[0] + ray[1] * normal[1] + ray[2] * normal[2]
    side = 1.0 if along > 0.0 else -1.0
    bx, by, bz = ray[0] - along * normal[0], ray[1] - along * normal[1], ray[2] - along * normal[2]
    whole = lobe(1.0 + np.sqrt(max(1.0 - along * along, 0.0)), width, slope)
    reach = lobe_reach(_uniform(random) * whole, width, slope)
    angle = 2.0 * np.pi * _uniform(random)
    # Two axes in the surface: the world axis that lies flattest in it gives the first.
    ax, ay, az = 0.0, 0.0, 0.0
    if abs(normal[0]) <= abs(normal[1]) and abs(normal[0]) <= abs(normal[2]):
        ax = 1.0
    elif abs(normal[1]) <= abs(normal[2]):
        ay = 1.0
    else:
        az = 1.0
    dot = ax * normal[0] + ay * normal[1] + az * normal[2]
    ax, ay, az = ax - dot * normal[0], ay - dot * normal[1], az - dot * normal[2]
    size = 1.0 / np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax * size, ay * size, az * size
    cx, cy, cz = normal[1] * az - normal[2] * ay, normal[2] * ax - normal[0] * az, normal[0] * ay - normal[1] * ax
    u, v = reach * np.cos(angle), reach * np.sin(angle)
    bx, by, bz = bx + u * ax + v * cx, by + u * ay + v * cy, bz + u * az + v * cz
    rest = 1.0 - (bx * bx + by * by + bz * bz)
    if rest <= 0.0:
        return 0.0
    rise = side * np.sqrt(rest)
    out[0], out[1], out[2] = bx + rise * normal[0], by + rise * normal[1], bz + rise * normal[2]
    return tis * whole / lobe(1.0, width, slope)


@njit(**_JIT)
def _meet(at, ray, left, first, last, members, rot, org, curvature, conic, aperture):
    """The surface that a ray meets (−1: none), how far away, and the one whose rim it passes closest by if none."""
    best, hit, least, rim = np.inf, -1, np.inf, -1
    for j in range(first, last):
        s = members[j]
        if s == left:
            continue
        r, o = rot[s], org[s]
        x, y, z = at[0] - o[0], at[1] - o[1], at[2] - o[2]
        lx = r[0, 0] * x + r[0, 1] * y + r[0, 2] * z
        ly = r[1, 0] * x + r[1, 1] * y + r[1, 2] * z
        lz = r[2, 0] * x + r[2, 1] * y + r[2, 2] * z
        l = r[0, 0] * ray[0] + r[0, 1] * ray[1] + r[0, 2] * ray[2]  # noqa: E741
        m = r[1, 0] * ray[0] + r[1, 1] * ray[1] + r[1, 2] * ray[2]
        n = r[2, 0] * ray[0] + r[2, 1] * ray[1] + r[2, 2] * ray[2]
        if abs(n) < 1e-9:
            continue
        c = curvature[s]
        t0 = -lz / n
        x0, y0 = lx + t0 * l, ly + t0 * m
        c0 = c * (x0 * x0 + y0 * y0)
        b0 = n - c * (x0 * l + y0 * m)
        disc = b0 * b0 - c * (1.0 + conic[s] * n * n) * c0
        if not disc >= 0.0:
            continue
        root = np.sqrt(disc)
        t1 = c0 / (b0 + (root if n > 0.0 else -root))
        t = t0 + t1
        if not t > 0.0:
            continue
        ap = aperture[s]
        hx, hy = (x0 + t1 * l - ap[3]) / ap[1], (y0 + t1 * m - ap[4]) / ap[2]
        out = np.sqrt(hx * hx + hy * hy) if ap[0] == 1.0 else max(abs(hx), abs(hy))
        if out <= 1.0:
            if t < best:
                best, hit = t, s
        elif out < least:
            least, rim = out, s
    return hit, best, rim


@njit(**_JIT)
def _film(knot, piece, first, last, u):
    """A coating's table, piecewise cubic, at u = 1 − cos θ (knots first to last, u among them)."""
    low, high = first, last - 1
    while high - low > 1:
        middle = (low + high) // 2
        if knot[middle] <= u:
            low = middle
        else:
            high = middle
    step, p = u - knot[low], piece[low]
    return max(((p[0] * step + p[1]) * step + p[2]) * step + p[3], 0.0)


@njit(**_JIT)
def _put(where, weight, now, touched, known):
    """Add what one ray leaves in one place; how many places it has touched."""
    if now[where] == 0:
        touched[known] = where
        known += 1
    now[where] += weight
    return known


@njit(**_JIT)
def _close(now, touched, known, total, square, count):
    """Add what one ray has left everywhere to the sums, and forget it."""
    for k in range(known):
        where = touched[k]
        share = now[where] / UNIT
        total[where] += now[where]
        square[where] += share * share
        count[where] += 1
        now[where] = 0


@njit(**_JIT)
def _arrive(key, weight, trail, depth, order, slot, row, ptotal, psquare, pcount, ptrail, plength, porder, found):
    """Enter an arrival under its path's key; how many paths are known. A full table drops the path, not the light."""
    mask = slot.shape[0] - 1
    at = np.int64(key & np.uint64(mask))
    while row[at] >= 0 and slot[at] != key:
        at = (at + 1) & mask
    if row[at] < 0:
        if found == ptotal.shape[0]:
            return found
        slot[at], row[at] = key, found
        ptrail[found, :depth] = trail[:depth]
        plength[found], porder[found] = depth, order
        found += 1
    k = row[at]
    share = weight / UNIT
    ptotal[k] += weight
    psquare[k] += share * share
    pcount[k] += 1
    return found


@njit(**_JIT)
def _launch(random, source, pupil_radius, back_off, axes, centre, at, ray):
    """Draw one ray of a source: even over the pupil, from ``back_off`` before it, in the world."""
    radius, angle = pupil_radius * np.sqrt(_uniform(random)), 2.0 * np.pi * _uniform(random)
    px, py = radius * np.cos(angle), radius * np.sin(angle)
    l, m = source[1], source[2]  # noqa: E741
    if source[0] == RECTANGLE:
        l, m = l * (2.0 * _uniform(random) - 1.0), m * (2.0 * _uniform(random) - 1.0)  # noqa: E741
    elif source[0] == DISC:
        size, turn = source[1] * np.sqrt(_uniform(random)), 2.0 * np.pi * _uniform(random)
        l, m = size * np.cos(turn), size * np.sin(turn)  # noqa: E741
    n = np.sqrt(max(1.0 - l * l - m * m, 0.0))
    for k in range(3):
        ray[k] = l * axes[0, k] + m * axes[1, k] + n * axes[2, k]
        at[k] = centre[k] + px * axes[0, k] + py * axes[1, k] - back_off * ray[k]


@njit(**_JIT)
def walk_rays(first, number, seed, source, pupil_radius, back_off, axes, centre, space0, rot, org, curvature, conic,
              aperture, side_space, start, members, index, power_t, power_r, bare, film, film_start, knot, piece_r,
              piece_t, scatter, parasitic, detector, split, max_depth, grid, cells, max_paths):  # fmt: skip
    """Walk rays ``first`` to ``first + number`` (at most SLICE of them) of one source until nothing is left of them.

    source (3,): DIRECTION with the two direction cosines, RECTANGLE with two half widths, DISC with a radius; the rays
    cross the pupil (radius, m; axes (3, 3): rows in the world; centre (3,), m) and start ``back_off`` m before it.
    Surfaces and spaces as in ``search_paths``. power_t, power_r, bare (S, 2): coating met from before and from behind;
    film (S, 2): number of its table, or −1. Tables are piecewise cubics in 1 − cos θ, θ in the thinner medium: knots
    film_start[f] to film_start[f + 1], piece_r, piece_t (·, 4). scatter (S, 3): share at normal incidence, width,
    slope. parasitic (S,): 1 where a reflection counts for the order.

    split: weight, in units, from which on a branch is followed for itself; above UNIT every event is one lot. Weights
    are conserved at each event: branches below ``split`` are drawn, with the weight that makes up for being drawn taken
    from the largest, or with the whole weight if all are small.

    grid (4,): least x and y of the map (m) and cells per m along both; cells (2,): their numbers along y and x.

    Returns (total (B,) int64 units, square (B,) Σ(share per ray)², count (B,) of rays that left something there;
    map: total, square and count (2·cells,): all light, stray light; paths: key, total, square, count, trail,
    length, order; number of events, number of total reflections at coated faces). Tallies B: detector, pruned by depth;
    then per surface absorbed, passed outside a rim, met from behind, beyond the coating's table; per space: left the
    system; then arrivals by order (not part of the sum).
    """
    surfaces, spaces = rot.shape[0], start.shape[0] - 1
    arrivals = SINGLE + GROUPS * surfaces + spaces
    tallies = arrivals + ORDERS
    total, square, count = np.zeros(tallies, np.int64), np.zeros(tallies), np.zeros(tallies, np.int64)
    now, touched = np.zeros(tallies, np.int64), np.empty(tallies, np.int64)
    area = cells[0] * cells[1]
    mtotal, msquare, mcount = np.zeros(2 * area, np.int64), np.zeros(2 * area), np.zeros(2 * area, np.int64)
    mnow, mtouched = np.zeros(2 * area, np.int64), np.empty(2 * area, np.int64)
    slots = 4
    while slots < 2 * max_paths:
        slots *= 2
    slot, row = np.zeros(slots, np.uint64), np.full(slots, -1, np.int64)
    ptotal, psquare, pcount = np.zeros(max_paths, np.int64), np.zeros(max_paths), np.zeros(max_paths, np.int64)
    ptrail = np.empty((max_paths, max_depth), np.int16)
    plength, porder = np.zeros(max_paths, np.int64), np.zeros(max_paths, np.int64)
    found, events, total_reflections = 0, 0, 0
    random = np.zeros(2, np.uint64)
    # One event leaves at most four branches, one of which is taken up at once.
    room = 4 * max_depth + 8
    state = np.empty((room, 6))
    # depth, space, surface left, order, has been scattered, code of the last event
    whole = np.empty((room, 6), np.int64)
    weights, keys = np.empty(room, np.int64), np.empty(room, np.uint64)
    trail = np.empty(max_depth, np.int16)
    at, ray, normal = np.empty(3), np.empty(3), np.empty(3)
    # Branches of an event: weight and direction of transmission, reflection and both scattered.
    part, way = np.zeros(4, np.int64), np.empty((4, 3))
    for i in range(number):
        _seed(random, seed, first + i)
        _launch(random, source, pupil_radius, back_off, axes, centre, at, ray)
        known, mknown, top = 0, 0, 1
        state[0, :3], state[0, 3:] = at, ray
        whole[0, 0], whole[0, 1], whole[0, 2], whole[0, 3], whole[0, 4], whole[0, 5] = 0, space0, -1, 0, 0, 0
        weights[0], keys[0] = UNIT, np.uint64(0)
        while top > 0:
            top -= 1
            at[:], ray[:] = state[top, :3], state[top, 3:]
            depth, space, left = whole[top, 0], whole[top, 1], whole[top, 2]
            order, dull, weight, key = whole[top, 3], whole[top, 4], weights[top], keys[top]
            if depth > 0:
                trail[depth - 1] = whole[top, 5]
            s, t, rim = _meet(at, ray, left, start[space], start[space + 1], members, rot, org, curvature, conic,
                              aperture)  # fmt: skip
            if s < 0:
                place = SINGLE + GROUPS * surfaces + space if rim < 0 else SINGLE + surfaces + rim
                known = _put(place, weight, now, touched, known)
                continue
            events += 1
            for k in range(3):
                at[k] += t * ray[k]
            r, o, c = rot[s], org[s], curvature[s]
            qx, qy, qz = at[0] - o[0], at[1] - o[1], at[2] - o[2]
            lx = r[0, 0] * qx + r[0, 1] * qy + r[0, 2] * qz
            ly = r[1, 0] * qx + r[1, 1] * qy + r[1, 2] * qz
            lz = r[2, 0] * qx + r[2, 1] * qy + r[2, 2] * qz
            ax, ay, az = -c * lx, -c * ly, 1.0 - c * (1.0 + conic[s]) * lz
            size = 1.0 / np.sqrt(ax * ax + ay * ay + az * az)
            for k in range(3):
                normal[k] = (r[0, k] * ax + r[1, k] * ay + r[2, k] * az) * size
            cosi = ray[0] * normal[0] + ray[1] * normal[1] + ray[2] * normal[2]
            side = 0 if cosi > 0.0 else 1
            if side_space[s, side] != space:
                known = _put(SINGLE + 2 * surfaces + s, weight, now, touched, known)
                continue
            if depth == max_depth:
                known = _put(1, weight, now, touched, known)
                continue
            if s == detector:
                known = _put(arrivals + (4 if dull == 1 else min(order, 3)), weight, now, touched, known)
                found = _arrive(key, weight, trail, depth, order, slot, row, ptotal, psquare, pcount, ptrail, plength,
                                porder, found)  # fmt: skip
                gx, gy = np.floor((lx - grid[0]) * grid[2]), np.floor((ly - grid[1]) * grid[3])
                if 0 <= gx < cells[1] and 0 <= gy < cells[0]:
                    cell = np.int64(gy) * cells[1] + np.int64(gx)
                    mknown = _put(cell, weight, mnow, mtouched, mknown)
                    if dull == 1 or order > 0:
                        mknown = _put(area + cell, weight, mnow, mtouched, mknown)
            # What the coating does at this incidence.
            target = side_space[s, 1 - side]
            n1 = index[space]
            n2 = index[target] if target >= 0 else n1
            ratio = n1 / n2
            disc = 1.0 - ratio * ratio * (1.0 - cosi * cosi)
            cost = np.sqrt(max(disc, 0.0))
            cosa = abs(cosi)
            pr, pt = power_r[s, side], power_t[s, side]
            f = film[s, side]
            if bare[s, side] == 1 and target >= 0:
                a, b, d, e = n1 * cosa, n2 * cost, n1 * cost, n2 * cosa
                rs, rp = (a - b) / (a + b), (e - d) / (e + d)
                pr = 0.5 * (rs * rs + rp * rp)
                pt = 1.0 - pr
            elif f >= 0:
                u = 1.0 - (cosa if n1 <= n2 else cost)
                # Angles at the ends of the table may come out a rounding beyond them.
                if u > knot[film_start[f + 1] - 1] + 1e-12 or u < knot[film_start[f]] - 1e-12:
                    known = _put(SINGLE + 3 * surfaces + s, weight, now, touched, known)
                    continue
                pr = _film(knot, piece_r, film_start[f], film_start[f + 1], u)
                pt = _film(knot, piece_t, film_start[f], film_start[f + 1], u)
            if target < 0:
                pt = 0.0
            elif disc < 0.0 and pt > 0.0:
                # Nothing is refracted: what a coated face would let through comes back.
                pr, pt = pr + pt, 0.0
                total_reflections += 1
            g = cost if cosi > 0.0 else -cost
            g -= ratio * cosi
            for k in range(3):
                way[TRANSMIT, k] = ratio * ray[k] + g * normal[k]
                way[REFLECT, k] = ray[k] - 2.0 * cosi * normal[k]
            part[:] = 0
            if split > UNIT or weight < 2 * split:
                lot = _uniform(random)
                if lot < pr + pt:
                    act = REFLECT if lot < pr else TRANSMIT
                    if scatter[s, 0] > 0.0:
                        tis = scattered(random, way[act], normal, scatter[s, 0], scatter[s, 1], scatter[s, 2],
                                        way[SCATTER + act])  # fmt: skip
                        if _uniform(random) < tis:
                            act += SCATTER
                    part[act] = weight
                else:
                    known = _put(0 if s == detector else SINGLE + s, weight, now, touched, known)
            else:
                part[REFLECT] = min(np.int64(np.rint(weight * pr)), weight)
                part[TRANSMIT] = min(np.int64(np.rint(weight * pt)), weight - part[REFLECT])
                lost = weight - part[REFLECT] - part[TRANSMIT]
                # R + T = 1 in the file may be one unit less here.
                if lost <= 2 and pr + pt > 1.0 - 1e-12:
                    part[TRANSMIT if part[TRANSMIT] > part[REFLECT] else REFLECT] += lost
                    lost = 0
                if lost > 0:
                    known = _put(0 if s == detector else SINGLE + s, lost, now, touched, known)
                if scatter[s, 0] > 0.0:
                    for act in range(2):
                        if part[act] > 0:
                            tis = scattered(random, way[act], normal, scatter[s, 0], scatter[s, 1], scatter[s, 2],
                                            way[SCATTER + act])  # fmt: skip
                            part[SCATTER + act] = min(np.int64(np.rint(part[act] * tis)), part[act])
                            part[act] -= part[SCATTER + act]
                big, pool = 0, 0
                for k in range(4):
                    big = k if part[k] > part[big] else big
                    pool += part[k] if part[k] < split else 0
                if pool > 0:
                    alone = part[big] < split or pool >= split
                    lot = _uniform(random) * (pool if alone else split)
                    seen, kept = 0, -1
                    for k in range(4):
                        if 0 < part[k] < split:
                            seen += part[k]
                            kept = k if kept < 0 and lot < seen else kept
                            part[k] = 0
                    if kept >= 0:
                        part[kept] = pool if alone else split
                        pool -= part[kept]
                    part[big] += pool
            for act in range(4):
                if part[act] == 0:
                    continue
                mirrored = act % 2 == REFLECT
                state[top, :3], state[top, 3:] = at, way[act]
                whole[top, 0], whole[top, 1], whole[top, 2] = depth + 1, space if mirrored else target, s
                whole[top, 3] = order + (parasitic[s] if mirrored else 0)
                whole[top, 4] = 1 if act >= SCATTER else dull
                whole[top, 5] = 4 * s + act
                weights[top] = part[act]
                keys[top] = _mix(key + _GOLDEN * np.uint64(4 * s + act + 1))
                top += 1
        _close(now, touched, known, total, square, count)
        _close(mnow, mtouched, mknown, mtotal, msquare, mcount)
    some = slice(0, found)
    keys_found = np.zeros(found, np.uint64)
    for k in range(slots):
        if row[k] >= 0:
            keys_found[row[k]] = slot[k]
    return (total, square, count, mtotal, msquare, mcount, keys_found, ptotal[some], psquare[some], pcount[some],
            ptrail[some].copy(), plength[some], porder[some], events, total_reflections)  # fmt: skip
