"""Ray tracing loops: a fixed sequence of surfaces (surface-major), and the search for every sequence that exists.

Rays are columns of plain arrays. Each surface has a local frame with its vertex at the origin and z along its axis; a
sequence carries the rays from one local frame to the next with one rotation and one shift, so that no world
coordinates are needed on the way. Everything that one loop calls stands in this module, since Numba's cache does not
notice changes in other files.

Status codes: 0 = traced; 4·(step + 1) + kind at the first trouble, with kind MISS (no intersection), TIR (total
internal reflection) or BACKWARD (the surface lies behind the ray: the ray is virtual).
"""

from __future__ import annotations

import numpy as np
from numba import njit

MISS, TIR, BACKWARD = 1, 2, 3
REFRACT, REFLECT = 0, 1
#: Slice length: a slice of eight float64 columns (32 kB) stays in the first-level cache.
SLICE = 512
#: Widest aperture description: kind (0 none, 1 circle, 2 rectangle), half width x, half width y, centre x, centre y.
APERTURE_COLUMNS = 5

# No fastmath: the search relies on inf, and the gain on the sequence loop is below a fifth.
_JIT = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(**_JIT)
def _to_surface(x, y, z, l, m, n, opl, status, rot, shift, curvature, conic, index, code):  # noqa: E741
    """Move a slice into the next local frame and onto its surface (in place)."""
    r00, r01, r02 = rot[0, 0], rot[0, 1], rot[0, 2]
    r10, r11, r12 = rot[1, 0], rot[1, 1], rot[1, 2]
    r20, r21, r22 = rot[2, 0], rot[2, 1], rot[2, 2]
    sx, sy, sz = shift[0], shift[1], shift[2]
    for i in range(x.shape[0]):
        dx, dy, dz = x[i] - sx, y[i] - sy, z[i] - sz
        px = r00 * dx + r01 * dy + r02 * dz
        py = r10 * dx + r11 * dy + r12 * dz
        pz = r20 * dx + r21 * dy + r22 * dz
        dl = r00 * l[i] + r01 * m[i] + r02 * n[i]
        dm = r10 * l[i] + r11 * m[i] + r12 * n[i]
        dn = r20 * l[i] + r21 * m[i] + r22 * n[i]
        # To the vertex plane first: the root near the vertex is then the small one, found without cancellation.
        t0 = -pz / dn
        x0 = px + t0 * dl
        y0 = py + t0 * dm
        c0 = curvature * (x0 * x0 + y0 * y0)
        b0 = dn - curvature * (x0 * dl + y0 * dm)
        a0 = curvature * (1.0 + conic * dn * dn)
        disc = b0 * b0 - a0 * c0
        root = np.sqrt(max(disc, 0.0))
        t1 = c0 / (b0 + (root if dn > 0.0 else -root))
        t = t0 + t1
        x[i] = x0 + t1 * dl
        y[i] = y0 + t1 * dm
        z[i] = t1 * dn
        l[i] = dl
        m[i] = dm
        n[i] = dn
        opl[i] += index * t
        # Not "disc < 0": a ray along the vertex plane makes NaN of it.
        trouble = code + MISS if not disc >= 0.0 else (code + BACKWARD if t < 0.0 else 0)
        status[i] = trouble if status[i] == 0 else status[i]


@njit(**_JIT)
def _bend(x, y, z, l, m, n, cos_in, cos_out, status, curvature, conic, n1, n2, reflect, code):  # noqa: E741
    """Refract or reflect a slice at the surface point it stands on (in place).

    Leaves the cosines of incidence and refraction: Fresnel's reflectance needs the second one, too.
    """
    k1 = 1.0 + conic
    ratio = n1 / n2
    keep = 1.0 if reflect else ratio
    for i in range(x.shape[0]):
        nx = -curvature * x[i]
        ny = -curvature * y[i]
        nz = 1.0 - curvature * k1 * z[i]
        norm = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
        nx *= norm
        ny *= norm
        nz *= norm
        cosi = l[i] * nx + m[i] * ny + n[i] * nz
        disc = 1.0 - ratio * ratio * (1.0 - cosi * cosi)
        cost = np.sqrt(max(disc, 0.0))
        cost = cost if cosi > 0.0 else -cost
        g = -2.0 * cosi if reflect else cost - ratio * cosi
        l[i] = keep * l[i] + g * nx
        m[i] = keep * m[i] + g * ny
        n[i] = keep * n[i] + g * nz
        cos_in[i] = abs(cosi)
        cos_out[i] = abs(cost)
        trouble = code + TIR if disc < 0.0 and not reflect else 0
        status[i] = trouble if status[i] == 0 else status[i]


@njit(**_JIT)
def _clear(x, y, clearance, ap):
    """Lower the running clearance of a slice by one aperture (1 at its centre, 0 at its edge)."""
    if ap[0] == 1.0:
        inv = 1.0 / (ap[1] * ap[1])
        for i in range(x.shape[0]):
            dx, dy = x[i] - ap[3], y[i] - ap[4]
            clearance[i] = min(clearance[i], 1.0 - (dx * dx + dy * dy) * inv)
    elif ap[0] == 2.0:
        for i in range(x.shape[0]):
            cx = 1.0 - abs(x[i] - ap[3]) / ap[1]
            cy = 1.0 - abs(y[i] - ap[4]) / ap[2]
            clearance[i] = min(clearance[i], min(cx, cy))


@njit(**_JIT)
def _fresnel(power, cos_in, cos_out, n1, n2, reflect):
    """Multiply a slice's power by the unpolarised Fresnel reflectance or transmittance of a bare face.

    At total internal reflection cos_out is 0, and the reflectance 1.
    """
    for i in range(power.shape[0]):
        a, b = n1 * cos_in[i], n2 * cos_out[i]
        c, d = n1 * cos_out[i], n2 * cos_in[i]
        rs = (a - b) / (a + b)
        rp = (d - c) / (d + c)
        r = 0.5 * (rs * rs + rp * rp)
        power[i] *= r if reflect else 1.0 - r


@njit(**_JIT)
def trace_sequence(rot, shift, curvature, conic, n1, n2, mode, weight, bare, aperture, rays, opl, power, status,
                   clearance, foot):  # fmt: skip
    """Trace rays through K surfaces in order, in place.

    rot (K, 3, 3), shift (K, 3): from the frame before to the local frame, v' = rot·(v − shift); metres.
    curvature (K,) 1/m, conic (K,), n1, n2 (K,) indices before and after, mode (K,) REFRACT or REFLECT,
    weight (K,) power factor of the coating, bare (K,) 1 where Fresnel's unpolarised factor holds,
    aperture (K, APERTURE_COLUMNS).
    rays (6, N): x, y, z in m and direction cosines; on return in the frame of the last surface.
    opl (N,) m, power (N,), status (N,) int64, clearance (N,): running values, updated.
    foot (K, 2, N) receives the local x, y at every surface, or has K = 0 and receives nothing.
    """
    count = rays.shape[1]
    cos_in = np.empty(SLICE)
    cos_out = np.empty(SLICE)
    for first in range(0, count, SLICE):
        last = min(first + SLICE, count)
        width = last - first
        x, y, z = rays[0, first:last], rays[1, first:last], rays[2, first:last]
        l, m, n = rays[3, first:last], rays[4, first:last], rays[5, first:last]  # noqa: E741
        for k in range(curvature.shape[0]):
            code = 4 * (k + 1)
            reflect = mode[k] == REFLECT
            _to_surface(x, y, z, l, m, n, opl[first:last], status[first:last], rot[k], shift[k], curvature[k],
                        conic[k], n1[k], code)  # fmt: skip
            _clear(x, y, clearance[first:last], aperture[k])
            if foot.shape[0] > 0:
                foot[k, 0, first:last] = x
                foot[k, 1, first:last] = y
            if reflect or n1[k] != n2[k]:
                _bend(x, y, z, l, m, n, cos_in[:width], cos_out[:width], status[first:last], curvature[k], conic[k],
                      n1[k], n2[k], reflect, code)  # fmt: skip
            if bare[k] == 1:
                _fresnel(power[first:last], cos_in[:width], cos_out[:width], n1[k], n2[k], reflect)
            else:
                for i in range(first, last):
                    power[i] *= weight[k]


@njit(**_JIT)
def _hit(px, py, pz, dl, dm, dn, rot, org, curvature, conic, ap):
    """Distance along one world ray to one surface inside its aperture; inf if there is none ahead."""
    x, y, z = px - org[0], py - org[1], pz - org[2]
    lx = rot[0, 0] * x + rot[0, 1] * y + rot[0, 2] * z
    ly = rot[1, 0] * x + rot[1, 1] * y + rot[1, 2] * z
    lz = rot[2, 0] * x + rot[2, 1] * y + rot[2, 2] * z
    l = rot[0, 0] * dl + rot[0, 1] * dm + rot[0, 2] * dn  # noqa: E741
    m = rot[1, 0] * dl + rot[1, 1] * dm + rot[1, 2] * dn
    n = rot[2, 0] * dl + rot[2, 1] * dm + rot[2, 2] * dn
    if abs(n) < 1e-9:
        return np.inf
    t0 = -lz / n
    x0, y0 = lx + t0 * l, ly + t0 * m
    c0 = curvature * (x0 * x0 + y0 * y0)
    b0 = n - curvature * (x0 * l + y0 * m)
    disc = b0 * b0 - curvature * (1.0 + conic * n * n) * c0
    if disc < 0.0:
        return np.inf
    root = np.sqrt(disc)
    t1 = c0 / (b0 + (root if n > 0.0 else -root))
    t = t0 + t1
    if t <= 0.0:
        return np.inf
    hx, hy = x0 + t1 * l - ap[3], y0 + t1 * m - ap[4]
    if ap[0] == 1.0 and hx * hx + hy * hy > ap[1] * ap[1]:
        return np.inf
    if ap[0] == 2.0 and (abs(hx) > ap[1] or abs(hy) > ap[2]):
        return np.inf
    return t


@njit(**_JIT)
def _interact(rays, i, out, t, rot, org, curvature, conic, ratio, reflect):
    """Carry ray i to distance t and bend it there; False at total internal reflection."""
    px, py, pz = rays[0, i] + t * rays[3, i], rays[1, i] + t * rays[4, i], rays[2, i] + t * rays[5, i]
    x, y, z = px - org[0], py - org[1], pz - org[2]
    lx = rot[0, 0] * x + rot[0, 1] * y + rot[0, 2] * z
    ly = rot[1, 0] * x + rot[1, 1] * y + rot[1, 2] * z
    lz = rot[2, 0] * x + rot[2, 1] * y + rot[2, 2] * z
    ax, ay, az = -curvature * lx, -curvature * ly, 1.0 - curvature * (1.0 + conic) * lz
    nx = rot[0, 0] * ax + rot[1, 0] * ay + rot[2, 0] * az
    ny = rot[0, 1] * ax + rot[1, 1] * ay + rot[2, 1] * az
    nz = rot[0, 2] * ax + rot[1, 2] * ay + rot[2, 2] * az
    norm = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx * norm, ny * norm, nz * norm
    cosi = rays[3, i] * nx + rays[4, i] * ny + rays[5, i] * nz
    g = -2.0 * cosi
    if not reflect:
        disc = 1.0 - ratio * ratio * (1.0 - cosi * cosi)
        if disc < 0.0:
            return False
        g = (np.sqrt(disc) if cosi > 0.0 else -np.sqrt(disc)) - ratio * cosi
    out[0, i], out[1, i], out[2, i] = px, py, pz
    out[3, i] = ratio * rays[3, i] + g * nx
    out[4, i] = ratio * rays[4, i] + g * ny
    out[5, i] = ratio * rays[5, i] + g * nz
    return True


@njit(**_JIT)
def _next_surfaces(rays, alive, hit, dist, space, left, start, members, rot, org, curvature, conic, aperture):
    """For every living ray, the nearest surface that bounds its space (−1: the ray leaves the system)."""
    for i in range(rays.shape[1]):
        hit[i] = -1
        dist[i] = np.inf
        if not alive[i]:
            continue
        for j in range(start[space], start[space + 1]):
            s = members[j]
            if s == left:
                continue
            t = _hit(rays[0, i], rays[1, i], rays[2, i], rays[3, i], rays[4, i], rays[5, i], rot[s], org[s],
                     curvature[s], conic[s], aperture[s])  # fmt: skip
            if t < dist[i]:
                dist[i], hit[i] = t, s


@njit(**_JIT)
def search_paths(rays0, space0, rot, org, curvature, conic, aperture, side_space, start, members, index, power_t,
                 power_r, splits_t, splits_r, parasitic_t, parasitic_r, detector, max_order, max_splits, min_power,
                 max_depth, max_paths):  # fmt: skip
    """Depth-first search of every path on which at least one probe ray reaches the detector.

    rays0 (6, N) world rays in space ``space0``; surfaces as in ``trace_sequence`` but with world frames (rot rows are
    the local axes in the world, org the vertices). side_space (S, 2): the space before (local −z) and after each
    surface. start, members: surfaces that bound each space (compressed rows). index: refractive index per space.
    power_t, power_r: coating power; splits_*: 1 where that interaction counts as a split beyond the nominal ones;
    parasitic_*: 1 where it counts as a parasitic reflection. A branch ends where order, splits, power or depth run
    out, or where no probe is left. The prefix of a branch is traced once and shared by all that grow from it.

    Returns (paths (P, max_depth) int64: 2·surface + interaction, lengths, probe counts, first probe that arrives,
    coating power, orders, visits, overflow): overflow is 1 if more than max_paths exist or a path was cut at max_depth.
    """
    count = rays0.shape[1]
    rays = np.empty((max_depth + 1, 6, count))
    alive = np.zeros((max_depth + 1, count), dtype=np.bool_)
    hit = np.empty((max_depth + 1, count), dtype=np.int64)
    dist = np.empty((max_depth + 1, count))
    trail = np.empty(max_depth + 1, dtype=np.int64)
    # At every depth of the branch there wait at most two interactions with each surface of one space.
    room = 2 * np.max(start[1:] - start[:-1]) * max_depth
    stack = np.empty((room, 5), dtype=np.int64)  # depth, surface, interaction, order, splits
    stack_power = np.empty(room)
    paths = np.empty((max_paths, max_depth), dtype=np.int64)
    lengths = np.zeros(max_paths, dtype=np.int64)
    counts = np.zeros(max_paths, dtype=np.int64)
    powers = np.zeros(max_paths)
    orders = np.zeros(max_paths, dtype=np.int64)
    probes = np.zeros(max_paths, dtype=np.int64)
    found, top, overflow, visits = 0, 0, 0, 0
    rays[0] = rays0
    alive[0, :] = True
    depth, space, left, order, split, power = 0, space0, -1, 0, 0, 1.0
    while True:
        # Arrived at `depth` in `space`: look ahead, then push one entry per surface and interaction.
        _next_surfaces(rays[depth], alive[depth], hit[depth], dist[depth], space, left, start, members, rot, org,
                       curvature, conic, aperture)  # fmt: skip
        for j in range(start[space], start[space + 1]):
            s = members[j]
            seen, first = 0, -1
            for i in range(count):
                if hit[depth, i] == s:
                    seen += 1
                    first = i if first < 0 else first
            if seen == 0:
                continue
            if s == detector:
                if found == max_paths:
                    overflow = 1
                else:
                    paths[found, :depth] = trail[:depth]
                    lengths[found], counts[found], powers[found] = depth, seen, power
                    orders[found], probes[found] = order, first
                    found += 1
            if depth + 1 > max_depth - 1:
                overflow = 1
                continue
            for act in range(2):
                factor = power_t[s] if act == REFRACT else power_r[s]
                order2 = order + (parasitic_t[s] if act == REFRACT else parasitic_r[s])
                split2 = split + (splits_t[s] if act == REFRACT else splits_r[s])
                if factor * power < min_power or order2 > max_order or split2 > max_splits:
                    continue
                stack[top, 0], stack[top, 1], stack[top, 2] = depth, s, act
                stack[top, 3], stack[top, 4] = order2, split2
                stack_power[top] = factor * power
                top += 1
        # Take the youngest entry whose rays survive the interaction.
        moved = False
        while top > 0 and not moved:
            top -= 1
            parent, s, act = stack[top, 0], stack[top, 1], stack[top, 2]
            order, split, power = stack[top, 3], stack[top, 4], stack_power[top]
            depth = parent + 1
            visits += 1
            for i in range(count):
                alive[depth, i] = False
                if hit[parent, i] != s:
                    continue
                # Which side was hit decides the spaces on both sides of the interaction.
                along = (rays[parent, 3, i] * rot[s, 2, 0] + rays[parent, 4, i] * rot[s, 2, 1]
                         + rays[parent, 5, i] * rot[s, 2, 2])  # fmt: skip
                before = side_space[s, 0] if along > 0.0 else side_space[s, 1]
                after = side_space[s, 1] if along > 0.0 else side_space[s, 0]
                target = after if act == REFRACT else before
                if target < 0 or before < 0:
                    continue
                ratio = index[before] / index[target] if act == REFRACT else 1.0
                if _interact(rays[parent], i, rays[depth], dist[parent, i], rot[s], org[s], curvature[s], conic[s],
                             ratio, act == REFLECT):  # fmt: skip
                    alive[depth, i] = True
                    space = target
                    moved = True
            trail[parent] = 2 * s + act
            left = s
        if not moved:
            break
    some = slice(0, found)
    return paths[some], lengths[some], counts[some], probes[some], powers[some], orders[some], visits, overflow
