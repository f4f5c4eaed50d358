"""Ray tracing loops along a fixed sequence of surfaces: rays, and what their neighbours do to first order.

Rays are columns of plain arrays. Each surface has a local frame with its vertex at the origin and z along its axis; a
sequence carries the rays from one local frame to the next with one rotation and one shift, so that no world
coordinates are needed on the way. Everything that one loop calls stands in this module, since Numba's cache does not
notice changes in other files.

A tangent is the derivative of a ray (position and direction) by a parameter of its launch. It obeys the ray's own
equations, differentiated: exact, no step to choose, and no neighbour that could fail where the ray itself passes.

Status codes: 0 = traced; KINDS·(step + 1) + kind at the first trouble, with kind MISS (no intersection), TIR (total
internal reflection), BEYOND (the coating's table does not hold the angle), WRONG_SIDE (the surface is met from the
space that the step does not come from) or BACKWARD (the surface lies behind the ray: the ray is virtual).
"""

from __future__ import annotations

import numpy as np
from numba import njit

KINDS = 8
BEYOND, MISS, TIR, BACKWARD, WRONG_SIDE = 0, 1, 2, 3, 4
#: Values of ``bare``: the coating's factor is a number, Fresnel's, or that of film ``bare`` − FILM.
NUMBER, BARE, FILM = 0, 1, 2
REFRACT, REFLECT = 0, 1
PLANE, SPHERE, CONIC = 0, 1, 2
#: Slice length: a slice of eight float64 columns (32 kB) stays in the first-level cache. With two tangents it does not,
#: and yet shorter ones are slower: a loop takes as long to begin as for some hundred rays.
SLICE = 512
#: Columns of a slice begin this much further apart than its length: at whole multiples of 4096 bytes a store into one
#: looks to the processor like a store into the next, and holds up its loads.
PAD = 24
#: A slice's tangents are columns of one array, so that loops over them need not ask whether they overlap: from one
#: column to the next, and from one tangent to the next.
WIDE = SLICE + PAD
SIX = 6 * WIDE
#: Widest aperture description: kind (0 none, 1 circle, 2 rectangle), half width x, half width y, centre x, centre y.
APERTURE_COLUMNS = 5

# No fastmath: the gain is below a fifth, and failed rays are told by what is not finite.
_JIT = {"cache": True, "nogil": True, "error_model": "numpy"}


def _named(function, name: str):
    """Compile under a name of its own: cached code of two processes, linked by names, would call a namesake's."""
    function.__name__ = function.__qualname__ = name
    return njit(**_JIT)(function)


def _meeting(name: str, turned: bool, shape: int):
    """Compile the move of a slice into the next local frame and onto its surface, for frames of one kind.

    turned: whether the frame is rotated against the last one; shape: PLANE, SPHERE or CONIC. What a frame does not need
    is left out of the loop, of which divisions and square roots are the greater part.
    """

    def meet(x, y, z, l, m, n, way, opl, rot, shift, curvature, conic, index, side):  # noqa: E741
        r00, r01, r02 = rot[0, 0], rot[0, 1], rot[0, 2]
        r10, r11, r12 = rot[1, 0], rot[1, 1], rot[1, 2]
        r20, r21, r22 = rot[2, 0], rot[2, 1], rot[2, 2]
        sx, sy, sz = shift[0], shift[1], shift[2]
        bad = 0
        for i in range(x.shape[0]):
            px, py, pz = x[i] - sx, y[i] - sy, z[i] - sz
            dl, dm, dn = l[i], m[i], n[i]
            if turned:
                dx, dy, dz, el, em, en = px, py, pz, dl, dm, dn
                px = r00 * dx + r01 * dy + r02 * dz
                py = r10 * dx + r11 * dy + r12 * dz
                pz = r20 * dx + r21 * dy + r22 * dz
                dl = r00 * el + r01 * em + r02 * en
                dm = r10 * el + r11 * em + r12 * en
                dn = r20 * el + r21 * em + r22 * en
                l[i] = dl
                m[i] = dm
                n[i] = dn
            # To the vertex plane first: the root near the vertex is then the small one, found without cancellation.
            t = -pz / dn
            x0 = px + t * dl
            y0 = py + t * dm
            z0 = 0.0
            missed = not abs(t) < np.inf  # a ray along the vertex plane
            if shape != PLANE:
                c0 = curvature * (x0 * x0 + y0 * y0)
                b0 = dn - curvature * (x0 * dl + y0 * dm)
                a0 = curvature if shape == SPHERE else curvature * (1.0 + conic * dn * dn)
                disc = b0 * b0 - a0 * c0
                root = np.sqrt(max(disc, 0.0))
                t1 = c0 / (b0 + (root if dn > 0.0 else -root))
                x0 += t1 * dl
                y0 += t1 * dm
                z0 = t1 * dn
                t += t1
                # Not "disc < 0": a ray along the vertex plane makes NaN of it.
                missed = not disc >= 0.0
            x[i] = x0
            y[i] = y0
            z[i] = z0
            way[i] = np.nan if missed else t
            opl[i] += index * t
            bad += int(missed | (t < 0.0) | (side * dn < 0.0))
        return bad

    return _named(meet, name)


_meet_plane, _meet_plane_turned = _meeting("meet_plane", False, PLANE), _meeting("meet_plane_turned", True, PLANE)
_meet_conic, _meet_conic_turned = _meeting("meet_conic", False, CONIC), _meeting("meet_conic_turned", True, CONIC)
_meet_sphere = _meeting("meet_sphere", False, SPHERE)
_meet_sphere_turned = _meeting("meet_sphere_turned", True, SPHERE)


@njit(**_JIT)
def move_on(x, y, z, l, m, n, way, opl, rot, shift, curvature, conic, index, side):  # noqa: E741
    """Move a slice into the next local frame and onto its surface (in place): number of rays in trouble there.

    ``way`` is how far each ray went: not finite for those that miss, negative for virtual ones.
    """
    turned = rot[0, 0] != 1.0 or rot[1, 1] != 1.0 or rot[2, 2] != 1.0
    rest = way, opl, rot, shift, curvature, conic, index, side
    if curvature == 0.0:
        if turned:
            bad = _meet_plane_turned(x, y, z, l, m, n, *rest)
        else:
            bad = _meet_plane(x, y, z, l, m, n, *rest)
    elif conic == 0.0:
        if turned:
            bad = _meet_sphere_turned(x, y, z, l, m, n, *rest)
        else:
            bad = _meet_sphere(x, y, z, l, m, n, *rest)
    elif turned:
        bad = _meet_conic_turned(x, y, z, l, m, n, *rest)
    else:
        bad = _meet_conic(x, y, z, l, m, n, *rest)
    return bad


@njit(**_JIT)
def to_surface(x, y, z, l, m, n, way, opl, status, rot, shift, curvature, conic, index, side, code):  # noqa: E741
    """``move_on``, and the status of those in trouble."""
    bad = move_on(x, y, z, l, m, n, way, opl, rot, shift, curvature, conic, index, side)
    if bad > 0:  # seldom, and kept out of the loops above for that
        for i in range(x.shape[0]):
            if status[i] == 0:
                if not abs(way[i]) < np.inf:
                    status[i] = code + MISS
                elif side * n[i] < 0.0:
                    status[i] = code + WRONG_SIDE
                elif way[i] < 0.0:
                    status[i] = code + BACKWARD


@njit(inline="always", **_JIT)
def _carried(d, at, i, ray, rot, normal, law, curvature, k1, turned, shape, bends):
    """Carry one tangent of ray ``i``, which begins at ``at``: see ``_carrying``, of whose loop this is a part."""
    l, m, n, way = ray  # noqa: E741
    nx, ny, nz, norm = normal
    inverse, keep, g, steep = law
    ex, ey, ez = d[at + i], d[at + WIDE + i], d[at + 2 * WIDE + i]
    el, em, en = d[at + 3 * WIDE + i], d[at + 4 * WIDE + i], d[at + 5 * WIDE + i]
    if turned:
        (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rot
        dx, dy, dz, dl, dm, dn = ex, ey, ez, el, em, en
        ex = r00 * dx + r01 * dy + r02 * dz
        ey = r10 * dx + r11 * dy + r12 * dz
        ez = r20 * dx + r21 * dy + r22 * dz
        el = r00 * dl + r01 * dm + r02 * dn
        em = r10 * dl + r11 * dm + r12 * dn
        en = r20 * dl + r21 * dm + r22 * dn
    ex += way * el
    ey += way * em
    ez += way * en
    # How much further the neighbour goes until it, too, is on the surface: its offset has no part along the normal.
    if shape == PLANE:
        more = -ez * inverse
        ez = 0.0
    else:
        more = -(nx * ex + ny * ey + nz * ez) * inverse
        ez += more * n
    ex += more * l
    ey += more * m
    if bends:
        if shape == PLANE:
            el, em, en = keep * el, keep * em, (keep + steep) * en
        else:
            ux, uy, uz = -curvature * norm * ex, -curvature * norm * ey, -k1 * norm * ez
            if shape == CONIC:
                along = nx * ux + ny * uy + nz * uz
                ux -= along * nx
                uy -= along * ny
                uz -= along * nz
            dg = steep * (el * nx + em * ny + en * nz + l * ux + m * uy + n * uz)
            el = keep * el + dg * nx + g * ux
            em = keep * em + dg * ny + g * uy
            en = keep * en + dg * nz + g * uz
    d[at + i], d[at + WIDE + i], d[at + 2 * WIDE + i] = ex, ey, ez
    d[at + 3 * WIDE + i], d[at + 4 * WIDE + i], d[at + 5 * WIDE + i] = el, em, en


def _carrying(name: str, turned: bool, shape: int, bends: bool = True):
    """Compile what a surface does to a slice's tangents, for frames of one kind: onto it, and bent by it.

    Two tangents at once: normals, cosines, roots and divisions are the ray's.
    """

    def carry(x, y, z, l, m, n, way, d, rot, curvature, conic, n1, n2, reflect):  # noqa: E741
        frame = (
            (rot[0, 0], rot[0, 1], rot[0, 2]),
            (rot[1, 0], rot[1, 1], rot[1, 2]),
            (rot[2, 0], rot[2, 1], rot[2, 2]),
        )
        k1 = curvature * (1.0 + conic)
        ratio = n1 / n2
        keep = 1.0 if reflect else ratio
        # That there is no more than WIDE tells the compiler that no index below is negative.
        for i in range(min(x.shape[0], WIDE)):
            nx, ny, nz, norm = 0.0, 0.0, 1.0, 1.0
            cosi = n[i]
            if shape != PLANE:
                nx, ny, nz = -curvature * x[i], -curvature * y[i], 1.0 - k1 * z[i]
                if shape == CONIC:  # on a sphere this is a unit vector
                    norm = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
                    nx *= norm
                    ny *= norm
                    nz *= norm
                cosi = l[i] * nx + m[i] * ny + n[i] * nz
            cost = np.sqrt(max(1.0 - ratio * ratio * (1.0 - cosi * cosi), 0.0))
            cost = cost if cosi > 0.0 else -cost
            # A ray becomes keep·d + g·N, with the unit normal N; g changes with the cosine of incidence alone.
            g = -2.0 * cosi if reflect else cost - ratio * cosi
            steep = -2.0 if reflect else ratio * (ratio * cosi / cost - 1.0)
            ray, normal, law = (l[i], m[i], n[i], way[i]), (nx, ny, nz, norm), (1.0 / cosi, keep, g, steep)
            _carried(d, 0, i, ray, frame, normal, law, curvature, k1, turned, shape, bends)
            _carried(d, SIX, i, ray, frame, normal, law, curvature, k1, turned, shape, bends)

    return _named(carry, name)


_carry_plane, _carry_plane_turned = _carrying("carry_plane", False, PLANE), _carrying("carry_plane_turned", True, PLANE)
_carry_conic, _carry_sphere = _carrying("carry_conic", True, CONIC), _carrying("carry_sphere", False, SPHERE)
_carry_sphere_turned = _carrying("carry_sphere_turned", True, SPHERE)
_carry_straight = _carrying("carry_straight", True, CONIC, False)


@njit(**_JIT)
def carry_on(x, y, z, l, m, n, way, tangents, rot, curvature, conic, n1, n2, reflect):  # noqa: E741
    """Carry a slice's tangents along, after ``to_surface`` and before ``bend_there``."""
    turned = rot[0, 0] != 1.0 or rot[1, 1] != 1.0 or rot[2, 2] != 1.0
    for pair in range(0, tangents.shape[0], 2 * SIX):
        d = tangents[pair : pair + 2 * SIX]
        if not reflect and n1 == n2:
            _carry_straight(x, y, z, l, m, n, way, d, rot, curvature, conic, n1, n2, reflect)
        elif curvature == 0.0:
            if turned:
                _carry_plane_turned(x, y, z, l, m, n, way, d, rot, curvature, conic, n1, n2, reflect)
            else:
                _carry_plane(x, y, z, l, m, n, way, d, rot, curvature, conic, n1, n2, reflect)
        elif conic == 0.0:
            if turned:
                _carry_sphere_turned(x, y, z, l, m, n, way, d, rot, curvature, conic, n1, n2, reflect)
            else:
                _carry_sphere(x, y, z, l, m, n, way, d, rot, curvature, conic, n1, n2, reflect)
        else:
            _carry_conic(x, y, z, l, m, n, way, d, rot, curvature, conic, n1, n2, reflect)


def _bending(name: str, shape: int):
    """Compile refraction and reflection of a slice at surfaces of one shape."""

    def bend(x, y, z, l, m, n, cos_in, cos_out, curvature, conic, n1, n2, reflect):  # noqa: E741
        k1 = curvature * (1.0 + conic)
        ratio = n1 / n2
        keep = 1.0 if reflect else ratio
        bad = 0
        for i in range(x.shape[0]):
            nx, ny, nz = 0.0, 0.0, 1.0
            cosi = n[i]
            if shape != PLANE:
                nx, ny, nz = -curvature * x[i], -curvature * y[i], 1.0 - k1 * z[i]
                if shape == CONIC:  # on a sphere this is a unit vector
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
            bad += int(disc < 0.0)
        return bad

    return _named(bend, name)


_bend_plane, _bend_sphere = _bending("bend_plane", PLANE), _bending("bend_sphere", SPHERE)
_bend_conic = _bending("bend_conic", CONIC)


@njit(**_JIT)
def turn(x, y, z, l, m, n, cos_in, cos_out, curvature, conic, n1, n2, reflect):  # noqa: E741
    """Refract or reflect a slice at the surface point it stands on (in place): how many lie beyond the critical angle.

    Leaves the cosines of incidence and refraction: Fresnel's reflectance needs the second one, too.
    """
    rest = cos_in, cos_out, curvature, conic, n1, n2, reflect
    if curvature == 0.0:
        bad = _bend_plane(x, y, z, l, m, n, *rest)
    elif conic == 0.0:
        bad = _bend_sphere(x, y, z, l, m, n, *rest)
    else:
        bad = _bend_conic(x, y, z, l, m, n, *rest)
    return bad


@njit(**_JIT)
def reflected_totally(cos_in, n1, n2):
    """Whether nothing is refracted at this cosine of incidence."""
    ratio = n1 / n2
    return 1.0 - ratio * ratio * (1.0 - cos_in * cos_in) < 0.0


@njit(**_JIT)
def bend_there(x, y, z, l, m, n, cos_in, cos_out, status, curvature, conic, n1, n2, reflect, code):  # noqa: E741
    """``turn``, and the status of those that cannot be refracted."""
    bad = turn(x, y, z, l, m, n, cos_in, cos_out, curvature, conic, n1, n2, reflect)
    if bad > 0 and not reflect:
        for i in range(x.shape[0]):
            if status[i] == 0 and reflected_totally(cos_in[i], n1, n2):
                status[i] = code + TIR


@njit(**_JIT)
def clear(x, y, clearance, ap):
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
def fresnel(power, cos_in, cos_out, n1, n2, reflect):
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
def table(power, cos_in, cos_out, film, n1, n2):
    """Multiply a slice's power by a coating's table (M, 5): knots of 1 − cos θ in the thinner medium, and cubics.

    How many rays meet the coating at an angle that the table does not hold; their power is NaN.
    """
    last = film.shape[0] - 1
    # Angles at the ends of the table may come out a rounding beyond them.
    low, high = film[0, 0] - 1e-12, film[last, 0] + 1e-12
    k, beyond = 0, 0
    for i in range(power.shape[0]):
        u = 1.0 - (cos_in[i] if n1 <= n2 else cos_out[i])
        # Not "u < low or u > high": a ray without an end makes NaN of it.
        if not low <= u <= high:
            power[i] = np.nan
            beyond += 1
            continue
        while k < last - 1 and u >= film[k + 1, 0]:
            k += 1
        while k > 0 and u < film[k, 0]:
            k -= 1
        step = u - film[k, 0]
        power[i] *= max(((film[k, 1] * step + film[k, 2]) * step + film[k, 3]) * step + film[k, 4], 0.0)
    return beyond


@njit(**_JIT)
def _along(rot, shift, curvature, conic, n1, n2, mode, side, weight, bare, aperture, film, x, y, z, l, m, n,  # noqa: E741
           tangents, begin, opl, power, status, clearance, foot, way, cos_in, cos_out):  # fmt: skip
    """Carry one slice through all surfaces, in place: arguments as in ``trace_sequence``, of the slice's length.

    tangents (T·SIX,): the slice's, column after column. foot (K, 2, N): whole, this slice from ``begin`` on, since
    loops over parts of a slice of its own would not know that numbers follow each other, and not vectorise. way,
    cos_in, cos_out: room to work in.
    """
    factor, s = 1.0, slice(begin, begin + x.shape[0])
    for k in range(curvature.shape[0]):
        code = KINDS * (k + 1)
        reflect = mode[k] == REFLECT
        bends = reflect or n1[k] != n2[k]
        to_surface(x, y, z, l, m, n, way, opl, status, rot[k], shift[k], curvature[k], conic[k], n1[k], side[k], code)
        if tangents.shape[0] > 0:
            carry_on(x, y, z, l, m, n, way, tangents, rot[k], curvature[k], conic[k], n1[k], n2[k], reflect)
        clear(x, y, clearance, aperture[k])
        if foot.shape[0] > 0:
            foot[k, 0, s] = x
            foot[k, 1, s] = y
        if bends or bare[k] >= FILM:
            bend_there(x, y, z, l, m, n, cos_in, cos_out, status, curvature[k], conic[k], n1[k], n2[k], reflect, code)
        if bare[k] >= FILM:
            if table(power, cos_in, cos_out, film[bare[k] - FILM], n1[k], n2[k]) > 0:
                for i in range(power.shape[0]):
                    if not power[i] >= 0.0:
                        power[i] = 0.0
                        status[i] = code + BEYOND if status[i] == 0 else status[i]
        elif bare[k] == BARE:
            if bends:  # between like media a bare face is none
                fresnel(power, cos_in, cos_out, n1[k], n2[k], reflect)
        else:
            factor *= weight[k]
    for i in range(power.shape[0]):
        power[i] *= factor


@njit(**_JIT)
def trace_sequence(rot, shift, curvature, conic, n1, n2, mode, side, weight, bare, aperture, film, rays, tangent, opl,
                   power, status, clearance, foot):  # fmt: skip
    """Trace rays through K surfaces in order, in place.

    rot (K, 3, 3), shift (K, 3): from the frame before to the local frame, v' = rot·(v − shift); metres.
    curvature (K,) 1/m, conic (K,), n1, n2 (K,) indices before and after, mode (K,) REFRACT or REFLECT,
    side (K,) 1.0 where light has to come along the local +z, −1.0 where against it, 0.0 where either will do,
    weight (K,) power factor of the coating, bare (K,) BARE where Fresnel's unpolarised factor holds, FILM and
    more where that of a table does; aperture (K, APERTURE_COLUMNS); film (F, M, 5): tables, see ``table``.
    rays (6, N): x, y, z in m and direction cosines; on return in the frame of the last surface.
    tangent (T, 6, N): T derivatives, an even number, of the rays by whatever they were launched with; T = 0 for none.
    opl (N,) m, power (N,), status (N,) int64, clearance (N,): running values, updated.
    foot (K, 2, N) receives the local x, y at every surface, or has K = 0 and receives nothing.
    """
    count, tangents = rays.shape[1], tangent.shape[0]
    room, carried = np.empty((3, SLICE + PAD)), np.empty(tangents * SIX)
    for first in range(0, count, SLICE):
        width = min(SLICE, count - first)
        s, w = slice(first, first + width), slice(0, width)
        for t in range(tangents):
            for row in range(6):
                carried[t * SIX + row * WIDE : t * SIX + row * WIDE + width] = tangent[t, row, s]
        _along(rot, shift, curvature, conic, n1, n2, mode, side, weight, bare, aperture, film, rays[0, s],
               rays[1, s], rays[2, s], rays[3, s], rays[4, s], rays[5, s], carried, first, opl[s], power[s],
               status[s], clearance[s], foot, room[0, w], room[1, w], room[2, w])  # fmt: skip
        for t in range(tangents):
            for row in range(6):
                tangent[t, row, s] = carried[t * SIX + row * WIDE : t * SIX + row * WIDE + width]


@njit(**_JIT)
def start(p, theta, first, back_off, index, x, y, z, l, m, n, opl):  # noqa: E741
    """Start a slice of a fan from its ray ``first`` on: as ``launch``, with theta (N, 2) or (1, 2)."""
    one = theta.shape[0] == 1
    for i in range(x.shape[0]):
        j = 0 if one else first + i
        dl, dm = theta[j, 0], theta[j, 1]
        dn = np.sqrt(1.0 - dl * dl - dm * dm)
        x[i], y[i], z[i] = p[first + i, 0] - back_off * dl, p[first + i, 1] - back_off * dm, -back_off * dn
        l[i], m[i], n[i] = dl, dm, dn
        opl[i] = -back_off * index


@njit(**_JIT)
def trace_fan(rot, shift, curvature, conic, n1, n2, mode, side, weight, bare, aperture, film, back_off, p, theta, begin,
              end, ends, status):  # fmt: skip
    """Launch rays ``begin`` to ``end`` of a fan as ``launch`` does, trace them as ``trace_sequence`` does, and keep
    where they end.

    p (N, 2); theta (N, 2), or (1, 2) for one direction. Receive ends (7, N): x, y, direction cosines along x and y,
    path length, power, clearance; status (N,). A slice is launched, traced and written while it is in the nearest
    cache: large arrays are written once, and not read.
    """
    room = np.empty((12, SLICE + PAD))
    tangents, foot = np.empty(0), np.empty((0, 2, SLICE))
    for first in range(begin, end, SLICE):
        width = min(SLICE, end - first)
        w, s = slice(0, width), slice(first, first + width)
        x, y, z, l, m, n = room[0, w], room[1, w], room[2, w], room[3, w], room[4, w], room[5, w]  # noqa: E741
        opl, power, clearance, state = room[6, w], room[7, w], room[8, w], status[s]
        start(p, theta, first, back_off, n1[0], x, y, z, l, m, n, opl)
        power[:], clearance[:], state[:] = 1.0, np.inf, 0
        _along(rot, shift, curvature, conic, n1, n2, mode, side, weight, bare, aperture, film, x, y, z, l, m, n,
               tangents, 0, opl, power, state, clearance, foot, room[9, w], room[10, w], room[11, w])  # fmt: skip
        ends[0, s], ends[1, s], ends[2, s], ends[3, s] = x, y, l, m
        ends[4, s], ends[5, s], ends[6, s] = opl, power, clearance


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
