"""Ray tracing loops along a fixed sequence of surfaces: rays, what their neighbours do to first order, and aiming.

Rays are columns of plain arrays. Each surface has a local frame with its vertex at the origin and z along its axis; a
sequence carries the rays from one local frame to the next with one rotation and one shift, so that no world
coordinates are needed on the way. Everything that one loop calls stands in this module, since Numba's cache does not
notice changes in other files.

A tangent is the derivative of a ray (position and direction) by a parameter of its launch. It obeys the ray's own
equations, differentiated: exact, no step to choose, and no neighbour that could fail where the ray itself passes.

Status codes: 0 = traced; 4·(step + 1) + kind at the first trouble, with kind MISS (no intersection), TIR (total
internal reflection) or BACKWARD (the surface lies behind the ray: the ray is virtual).
"""

from __future__ import annotations

import numpy as np
from numba import njit

MISS, TIR, BACKWARD = 1, 2, 3
REFRACT, REFLECT = 0, 1
#: Slice length: a slice of eight float64 columns (32 kB) stays in the first-level cache; with two tangents of six
#: columns each it is the shorter one that does.
SLICE, TANGENT_SLICE = 512, 128
#: Widest aperture description: kind (0 none, 1 circle, 2 rectangle), half width x, half width y, centre x, centre y.
APERTURE_COLUMNS = 5

# No fastmath: the gain is below a fifth, and failed rays are told by what is not finite.
_JIT = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(**_JIT)
def _to_surface(x, y, z, l, m, n, way, opl, status, rot, shift, curvature, conic, index, code):  # noqa: E741
    """Move a slice into the next local frame and onto its surface (in place); ``way`` is how far each ray went."""
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
        way[i] = t
        opl[i] += index * t
        # Not "disc < 0": a ray along the vertex plane makes NaN of it.
        trouble = code + MISS if not disc >= 0.0 else (code + BACKWARD if t < 0.0 else 0)
        status[i] = trouble if status[i] == 0 else status[i]


@njit(**_JIT)
def _tangent_to_surface(x, y, z, l, m, n, way, dx, dy, dz, dl, dm, dn, rot, curvature, conic):  # noqa: E741
    """Carry a slice's tangents along with ``_to_surface``, after it: the rays stand on the surface, not yet bent."""
    r00, r01, r02 = rot[0, 0], rot[0, 1], rot[0, 2]
    r10, r11, r12 = rot[1, 0], rot[1, 1], rot[1, 2]
    r20, r21, r22 = rot[2, 0], rot[2, 1], rot[2, 2]
    k1 = 1.0 + conic
    for i in range(x.shape[0]):
        el = r00 * dl[i] + r01 * dm[i] + r02 * dn[i]
        em = r10 * dl[i] + r11 * dm[i] + r12 * dn[i]
        en = r20 * dl[i] + r21 * dm[i] + r22 * dn[i]
        ex = r00 * dx[i] + r01 * dy[i] + r02 * dz[i] + way[i] * el
        ey = r10 * dx[i] + r11 * dy[i] + r12 * dz[i] + way[i] * em
        ez = r20 * dx[i] + r21 * dy[i] + r22 * dz[i] + way[i] * en
        # How much further the neighbour goes until it, too, is on the surface: its offset has no part along the normal.
        nx, ny, nz = -curvature * x[i], -curvature * y[i], 1.0 - curvature * k1 * z[i]
        more = -(nx * ex + ny * ey + nz * ez) / (nx * l[i] + ny * m[i] + nz * n[i])
        dx[i] = ex + more * l[i]
        dy[i] = ey + more * m[i]
        dz[i] = ez + more * n[i]
        dl[i] = el
        dm[i] = em
        dn[i] = en


@njit(**_JIT)
def _tangent_bend(x, y, z, l, m, n, dx, dy, dz, dl, dm, dn, curvature, conic, n1, n2, reflect):  # noqa: E741
    """Bend a slice's tangents, before ``_bend`` bends the rays: derivative of k·d + g·N with the unit normal N."""
    k1 = 1.0 + conic
    ratio = n1 / n2
    keep = 1.0 if reflect else ratio
    for i in range(x.shape[0]):
        nx, ny, nz = -curvature * x[i], -curvature * y[i], 1.0 - curvature * k1 * z[i]
        norm = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
        nx *= norm
        ny *= norm
        nz *= norm
        ux, uy, uz = -curvature * dx[i] * norm, -curvature * dy[i] * norm, -curvature * k1 * dz[i] * norm
        along = nx * ux + ny * uy + nz * uz
        ux -= along * nx
        uy -= along * ny
        uz -= along * nz
        cosi = l[i] * nx + m[i] * ny + n[i] * nz
        turn = dl[i] * nx + dm[i] * ny + dn[i] * nz + l[i] * ux + m[i] * uy + n[i] * uz
        cost = np.sqrt(max(1.0 - ratio * ratio * (1.0 - cosi * cosi), 0.0))
        cost = cost if cosi > 0.0 else -cost
        g = -2.0 * cosi if reflect else cost - ratio * cosi
        dg = -2.0 * turn if reflect else ratio * turn * (ratio * cosi / cost - 1.0)
        dl[i] = keep * dl[i] + dg * nx + g * ux
        dm[i] = keep * dm[i] + dg * ny + g * uy
        dn[i] = keep * dn[i] + dg * nz + g * uz


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
def clearance_rows(aperture, foot):
    """Signed clearances (R, N) at footprints (K, 2, N), smooth in x and y: one per circle, four per rectangle."""
    rows = 0
    for k in range(aperture.shape[0]):
        rows += 1 if aperture[k, 0] == 1.0 else 4
    out = np.empty((rows, foot.shape[2]))
    row = 0
    for k in range(aperture.shape[0]):
        ap, x, y = aperture[k], foot[k, 0], foot[k, 1]
        if ap[0] == 1.0:
            inv = 1.0 / (ap[1] * ap[1])
            for i in range(x.shape[0]):
                dx, dy = x[i] - ap[3], y[i] - ap[4]
                out[row, i] = 1.0 - (dx * dx + dy * dy) * inv
            row += 1
        else:
            for i in range(x.shape[0]):
                dx, dy = (x[i] - ap[3]) / ap[1], (y[i] - ap[4]) / ap[2]
                out[row, i], out[row + 1, i] = 1.0 - dx, 1.0 + dx
                out[row + 2, i], out[row + 3, i] = 1.0 - dy, 1.0 + dy
            row += 4
    return out


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
def trace_sequence(rot, shift, curvature, conic, n1, n2, mode, weight, bare, aperture, rays, tangent, opl, power,
                   status, clearance, foot):  # fmt: skip
    """Trace rays through K surfaces in order, in place.

    rot (K, 3, 3), shift (K, 3): from the frame before to the local frame, v' = rot·(v − shift); metres.
    curvature (K,) 1/m, conic (K,), n1, n2 (K,) indices before and after, mode (K,) REFRACT or REFLECT,
    weight (K,) power factor of the coating, bare (K,) 1 where Fresnel's unpolarised factor holds,
    aperture (K, APERTURE_COLUMNS).
    rays (6, N): x, y, z in m and direction cosines; on return in the frame of the last surface.
    tangent (T, 6, N): T derivatives of the rays by whatever they were launched with; T = 0 for none.
    opl (N,) m, power (N,), status (N,) int64, clearance (N,): running values, updated.
    foot (K, 2, N) receives the local x, y at every surface, or has K = 0 and receives nothing.
    """
    count = rays.shape[1]
    step = SLICE if tangent.shape[0] == 0 else TANGENT_SLICE
    cos_in = np.empty(step)
    cos_out = np.empty(step)
    way = np.empty(step)
    for first in range(0, count, step):
        last = min(first + step, count)
        width = last - first
        x, y, z = rays[0, first:last], rays[1, first:last], rays[2, first:last]
        l, m, n = rays[3, first:last], rays[4, first:last], rays[5, first:last]  # noqa: E741
        for k in range(curvature.shape[0]):
            code = 4 * (k + 1)
            reflect = mode[k] == REFLECT
            bends = reflect or n1[k] != n2[k]
            _to_surface(x, y, z, l, m, n, way[:width], opl[first:last], status[first:last], rot[k], shift[k],
                        curvature[k], conic[k], n1[k], code)  # fmt: skip
            for t in range(tangent.shape[0]):
                dx, dy, dz = tangent[t, 0, first:last], tangent[t, 1, first:last], tangent[t, 2, first:last]
                dl, dm, dn = tangent[t, 3, first:last], tangent[t, 4, first:last], tangent[t, 5, first:last]
                _tangent_to_surface(x, y, z, l, m, n, way, dx, dy, dz, dl, dm, dn, rot[k], curvature[k], conic[k])
                if bends:
                    _tangent_bend(x, y, z, l, m, n, dx, dy, dz, dl, dm, dn, curvature[k], conic[k], n1[k], n2[k],
                                  reflect)  # fmt: skip
            _clear(x, y, clearance[first:last], aperture[k])
            if foot.shape[0] > 0:
                foot[k, 0, first:last] = x
                foot[k, 1, first:last] = y
            if bends:
                _bend(x, y, z, l, m, n, cos_in[:width], cos_out[:width], status[first:last], curvature[k], conic[k],
                      n1[k], n2[k], reflect, code)  # fmt: skip
            if bare[k] == 1:
                _fresnel(power[first:last], cos_in[:width], cos_out[:width], n1[k], n2[k], reflect)
            else:
                for i in range(first, last):
                    power[i] *= weight[k]


@njit(**_JIT)
def launch(p, theta, back_off, index, first, rays, tangent, opl):
    """Start rays at pupil points p (N, 2), m, with direction cosines theta (N, 2), from ``back_off`` before the pupil.

    Fills rays (6, N), opl (N,), so that path length counts from the pupil plane, and tangent (T, 6, N): derivatives by
    theta_x, theta_y, p_x, p_y, T of them from number ``first`` on.
    """
    for i in range(p.shape[0]):
        l, m = theta[i, 0], theta[i, 1]  # noqa: E741
        n = np.sqrt(1.0 - l * l - m * m)
        rays[0, i], rays[1, i], rays[2, i] = p[i, 0] - back_off * l, p[i, 1] - back_off * m, -back_off * n
        rays[3, i], rays[4, i], rays[5, i] = l, m, n
        opl[i] = -back_off * index
    for t in range(tangent.shape[0]):
        for i in range(p.shape[0]):
            for row in range(6):
                tangent[t, row, i] = 0.0
            axis = (first + t) % 2
            if first + t < 2:
                turn = -theta[i, axis] / rays[5, i]
                tangent[t, 3 + axis, i], tangent[t, 5, i] = 1.0, turn
                tangent[t, axis, i], tangent[t, 2, i] = -back_off, -back_off * turn
            else:
                tangent[t, axis, i] = 1.0


@njit(**_JIT)
def aim_rays(rot, shift, curvature, conic, n1, n2, mode, weight, bare, aperture, back_off, p, target, theta, tolerance,
             longest, rounds, rays, tangent, opl, power, status, clearance, foot):  # fmt: skip
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
        trace_sequence(rot, shift, curvature, conic, n1, n2, mode, weight, bare, aperture, rays_now, tangent_now,
                       opl_now, power_now, status_now, clear_now, foot_now)  # fmt: skip
        still = 0
        for j in range(left):
            i = todo[j]
            rays[:, i] = rays_now[:, j]
            tangent[:, :, i] = tangent_now[:, :, j]
            opl[i], power[i], status[i], clearance[i] = opl_now[j], power_now[j], status_now[j], clear_now[j]
            miss_x, miss_y = target[0] - rays_now[0, j], target[1] - rays_now[1, j]
            valid = (status[i] == 0 or status[i] % 4 == BACKWARD) and np.isfinite(opl[i])
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
    wavefront, changed in place.
    """
    x, y, z, l, m, n = rays[0], rays[1], rays[2], rays[3], rays[4], rays[5]  # noqa: E741
    way, opl, status, cos_in, cos_out = np.empty(1), np.zeros(1), np.zeros(1, dtype=np.int64), np.empty(1), np.empty(1)
    base, rate = np.empty((2, 2)), np.empty((2, 2))
    found = 0
    for k in range(curvature.shape[0]):
        # Two axes across the ray; neighbours are seen in planes across it.
        across = np.zeros((2, 3))
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
                    base[t, axis] += tangent[t, row, 0] * across[axis, row]
                    rate[t, axis] += tangent[t, 3 + row, 0] * across[axis, row]
        _to_surface(x, y, z, l, m, n, way, opl, status, rot[k], shift[k], curvature[k], conic[k], n1[k], 4)
        if k > first:
            # A virtual ray runs backwards.
            found += _zeros(base, rate if way[0] > 0.0 else -rate, abs(way[0]))
        reflect = mode[k] == REFLECT
        for t in range(2):
            dx, dy, dz = tangent[t, 0], tangent[t, 1], tangent[t, 2]
            dl, dm, dn = tangent[t, 3], tangent[t, 4], tangent[t, 5]
            _tangent_to_surface(x, y, z, l, m, n, way, dx, dy, dz, dl, dm, dn, rot[k], curvature[k], conic[k])
            _tangent_bend(x, y, z, l, m, n, dx, dy, dz, dl, dm, dn, curvature[k], conic[k], n1[k], n2[k], reflect)
        _bend(x, y, z, l, m, n, cos_in, cos_out, status, curvature[k], conic[k], n1[k], n2[k], reflect, 4)
    return found
