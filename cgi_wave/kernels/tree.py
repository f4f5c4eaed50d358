"""Tracing many paths at once: what they have in common at their beginning is traced once, and dead rays are dropped.

A tree of paths is a list of operations in the order of a depth-first walk. Each works on a buffer of rays: it moves
them onto a surface, bends them there, or counts them as arrived. Where branches part, the first ones work on copies and
the last one on the rays themselves. An operation that leaves no ray skips all that grows from it.

The loops over rays are those of ``kernels.trace``. Numba's cache does not notice changes there: after one, set
``NUMBA_CACHE_DIR`` to an empty folder.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cgi_wave.kernels.trace import (
    BACKWARD,
    MISS,
    PAD,
    REFLECT,
    TIR,
    WRONG_SIDE,
    clear,
    fresnel,
    move_on,
    reflected_totally,
    start,
    turn,
)

#: Operations.
MEET, BEND, ARRIVE = 0, 1, 2
#: Columns of a buffer: x, y, z, direction cosines, path length, clearance, power. The last is used for bare faces only.
COLUMNS = 9
#: What becomes of rays: columns of ``lost`` are VIGNETTED and the kinds of trouble of ``kernels.trace``.
VIGNETTED, FATES = 0, 5
#: Sums of the rays that arrive: number, power, power times x, y, x², y², path length and its square.
SUMS = 8
#: Rays at a time. A few buffers of them fit into the second-level cache.
SLICE = 1024

_JIT = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(**_JIT)
def _alive(clearance):
    """How many rays have passed all apertures so far."""
    count = 0
    for i in range(clearance.shape[0]):
        count += int(clearance[i] > 0.0)
    return count


@njit(**_JIT)
def _drop(buffer, width, columns, place):
    """Close the gaps that dead rays leave in the first ``width`` columns of a buffer: how many rays are left."""
    left = 0
    for i in range(width):
        place[left] = i
        left += int(buffer[7, i] > 0.0)
    for column in range(columns):
        row = buffer[column]
        for i in range(left):
            row[i] = row[place[i]]
    return left


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "nsz"})  # sums may be taken in any order
def _add(x, y, opl, clearance, power, factor, uniform, sums):
    """Add the living rays of a slice to the sums of their path."""
    s0, sx, sy, sxx, syy, so, soo = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(x.shape[0]):
        alive = clearance[i] > 0.0
        w = (factor if uniform else factor * power[i]) if alive else 0.0
        # A dead ray's place may be anything, even NaN.
        px, py, way = (x[i], y[i], opl[i]) if alive else (0.0, 0.0, 0.0)
        s0 += w
        sx += w * px
        sy += w * py
        sxx += w * px * px
        syy += w * py * py
        so += w * way
        soo += w * way * way
    sums[0] += _alive(clearance)
    sums[1] += s0
    sums[2] += sx
    sums[3] += sy
    sums[4] += sxx
    sums[5] += syy
    sums[6] += so
    sums[7] += soo


@njit(**_JIT)
def trace_branches(kind, source, target, step, skip, rot, shift, curvature, conic, n1, n2, mode, side, bare, aperture,
                   buffers, factor, back_off, p, theta, sums, lost):  # fmt: skip
    """Trace a fan of rays along all paths of a tree, and add up what arrives on each.

    kind, source, target, step, skip (O,): operations: MEET, BEND or ARRIVE, the buffers they read and change, the step
    they take (the path for ARRIVE), and where to go on if no ray is left. rot … aperture: the steps, as in
    ``kernels.trace.trace_sequence``; ``bare`` is nowhere 1 unless Fresnel's factor is wanted. buffers: their number.
    factor (P,): power of the coatings along each path. p (N, 2), theta (N, 2) or (1, 2): the fan, from ``back_off``
    before the pupil. sums (P, SUMS), lost (O, FATES): added to.
    """
    columns = COLUMNS if np.any(bare == 1) else COLUMNS - 1
    room = np.empty((buffers, COLUMNS, SLICE + PAD))
    work = np.empty((3, SLICE + PAD))
    width, living = np.zeros(buffers, dtype=np.int64), np.zeros(buffers, dtype=np.int64)
    place = np.empty(SLICE + 1, dtype=np.int64)
    for first in range(0, p.shape[0], SLICE):
        w = min(SLICE, p.shape[0] - first)
        b = room[0]
        start(p, theta, first, back_off, n1[0], b[0, :w], b[1, :w], b[2, :w], b[3, :w], b[4, :w], b[5, :w], b[6, :w])
        b[7, :w] = np.inf
        b[8, :w] = 1.0
        width[0] = living[0] = w
        o = 0
        while o < kind.shape[0]:
            k, to = step[o], target[o]
            b = room[to]
            if source[o] != to:
                w = width[source[o]]
                for column in range(columns):
                    b[column, :w] = room[source[o], column, :w]
                width[to], living[to] = w, living[source[o]]
            w = width[to]
            x, y, z, l, m, n = b[0, :w], b[1, :w], b[2, :w], b[3, :w], b[4, :w], b[5, :w]  # noqa: E741
            clearance = b[7, :w]
            if kind[o] == ARRIVE:
                _add(x, y, b[6, :w], clearance, b[8, :w], factor[k], columns < COLUMNS, sums[k])
                o += 1
                continue
            bad, failed = 0, 0
            if kind[o] == MEET:
                way = work[0, :w]
                bad = move_on(x, y, z, l, m, n, way, b[6, :w], rot[k], shift[k], curvature[k], conic[k], n1[k], side[k])
                if bad > 0:
                    for i in range(w):
                        if clearance[i] > 0.0:
                            fate = MISS if not abs(way[i]) < np.inf else (
                                WRONG_SIDE if side[k] * n[i] < 0.0 else (BACKWARD if way[i] < 0.0 else 0))  # fmt: skip
                            if fate > 0:
                                lost[o, fate] += 1
                                failed += 1
                                clearance[i] = -1.0
                clear(x, y, clearance, aperture[k])
            else:
                reflect = mode[k] == REFLECT
                if reflect or n1[k] != n2[k]:
                    cos_in, cos_out = work[1, :w], work[2, :w]
                    bad = turn(x, y, z, l, m, n, cos_in, cos_out, curvature[k], conic[k], n1[k], n2[k], reflect)
                    if bare[k] == 1:
                        fresnel(b[8, :w], cos_in, cos_out, n1[k], n2[k], reflect)
                    bad = 0 if reflect else bad
                    if bad > 0:
                        for i in range(w):
                            if clearance[i] > 0.0 and reflected_totally(cos_in[i], n1[k], n2[k]):
                                lost[o, TIR] += 1
                                failed += 1
                                clearance[i] = -1.0
            if kind[o] == MEET or bad > 0:
                left = _alive(clearance)
                lost[o, VIGNETTED] += living[to] - failed - left
                living[to] = left
                if left == 0:
                    o = skip[o]
                    continue
                # A few dead rays cost less than closing their gaps; failed ones would be looked at again each time.
                if bad > 0 or 4 * left < 3 * w:
                    width[to] = _drop(b, w, columns, place)
            o += 1
