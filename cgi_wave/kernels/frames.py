"""Compiled loops of the frames: patterns times scene images, smooth ghost layers, and what is summed along the scroll.

A frame is out[j, x] = Σ_c pattern[c, j, x] · image[c, index[j], x] + Σ_h harmonic_h[j, x] · field_h(j, x). The first
sum holds sharp layers, read row by row, with one, two or four rows of the scene weighted for a fraction of a row. The
second holds all smooth layers together: their images and envelopes live on a coarse grid of nodes every ``pitch``
pixels, are multiplied and added there, and only the sum is brought to the pixels, by cubic Lagrange interpolation:
along y on the nodes, once per row of pixels, then along x inside the loop over pixels, where all pixels of a cell share
four numbers per harmonic. The carriers cos θ, sin θ are held for one row per cell: to the other rows the envelopes are
turned, on the nodes. So a frame moves hardly more memory than pattern, image and result take.

All arrays of one call share one floating type, so that nothing is converted on the way. Loops over pixels are functions
of their own on contiguous rows: that is what lets the compiler vectorise them. No sum is reordered, and every row is
computed in one piece, so that results do not depend on how rows are given out to threads.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

#: A product may be fused with the sum it goes into; nothing else of IEEE arithmetic is given up.
_JIT = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
LANES = 8  # pixels that are computed together: every pitch of the grid is a multiple


@njit(**_JIT)
def _one(out, pattern, a, add):
    if add:
        for x in range(out.shape[0]):
            out[x] += pattern[x] * a[x]
    else:
        for x in range(out.shape[0]):
            out[x] = pattern[x] * a[x]


@njit(**_JIT)
def _two(out, pattern, a, b, wa, wb, add):
    if add:
        for x in range(out.shape[0]):
            out[x] += pattern[x] * (wa * a[x] + wb * b[x])
    else:
        for x in range(out.shape[0]):
            out[x] = pattern[x] * (wa * a[x] + wb * b[x])


@njit(**_JIT)
def _four(out, pattern, a, b, c, d, w, add):
    wa, wb, wc, wd = w[0], w[1], w[2], w[3]
    if add:
        for x in range(out.shape[0]):
            out[x] += pattern[x] * (wa * a[x] + wb * b[x] + wc * c[x] + wd * d[x])
    else:
        for x in range(out.shape[0]):
            out[x] = pattern[x] * (wa * a[x] + wb * b[x] + wc * c[x] + wd * d[x])


@njit(**_JIT)
def _sharp_row(out, pattern, image, index, weight, j, add):
    """Row j: Σ_c pattern[c, j] · Σ_t weight[j, t] image[c, index[j, t]]."""
    for c in range(pattern.shape[0]):
        more = add or c > 0
        if index.shape[1] == 1:
            _one(out, pattern[c, j], image[c, index[j, 0]], more)
        elif index.shape[1] == 2:
            _two(out, pattern[c, j], image[c, index[j, 0]], image[c, index[j, 1]], weight[j, 0], weight[j, 1], more)
        else:
            _four(out, pattern[c, j], image[c, index[j, 0]], image[c, index[j, 1]], image[c, index[j, 2]],
                  image[c, index[j, 3]], weight[j], more)  # fmt: skip


@njit(**_JIT)
def sharp_rows(out, pattern, image, index, weight, first, last, add):
    """Rows first…last − 1 of out (R, X), set or added to: a layer that is read row by row.

    pattern (C, R, X); image (C, H, X); index, weight (R, T), T = 1, 2 or 4: rows of the image and their weights.
    """
    for j in range(first, last):
        _sharp_row(out[j], pattern, image, index, weight, j, add)


@njit(**_JIT)
def warped_rows(out, pattern, image, x, y, shift, wrap, order, first, last):
    """Rows first…last − 1 of out, added to: a layer whose image turns, so that every pixel is looked up by itself.

    image (C, H, W); x, y (R, X): columns and rows of the image at shift 0, in samples; ``order`` 2 or 4 taps each way.
    Beyond the image its edge goes on; along rows it repeats if ``wrap``.
    """
    height, width = image.shape[1], image.shape[2]
    wx, wy = np.empty(4), np.empty(4)
    for j in range(first, last):
        for i in range(out.shape[1]):
            u, v = x[j, i], y[j, i] + shift
            column, row = int(np.floor(u)), int(np.floor(v))
            cubic(u - column, wx, order)
            cubic(v - row, wy, order)
            column -= order // 2 - 1
            row -= order // 2 - 1
            for c in range(image.shape[0]):
                total = 0.0
                for b in range(order):
                    r = row + b
                    r = r % height if wrap else min(max(r, 0), height - 1)
                    along = 0.0
                    for a in range(order):
                        along += wx[a] * image[c, r, min(max(column + a, 0), width - 1)]
                    total += wy[b] * along
                out[j, i] += pattern[c, j, i] * total


@njit(**_JIT)
def cubic(t, weight, order):
    """Weights of 2 or 4 samples (Lagrange) at the fraction t beyond the second of four, the first of two."""
    if order == 2:
        weight[0], weight[1] = 1.0 - t, t
    else:
        weight[0] = -t * (t - 1.0) * (t - 2.0) / 6.0
        weight[1] = (t * t - 1.0) * (t - 2.0) / 2.0
        weight[2] = -t * (t + 1.0) * (t - 2.0) / 2.0
        weight[3] = t * (t * t - 1.0) / 6.0


@njit(**_JIT)
def _weighted(total, a, b, c, d, wa, wb, wc, wd):
    for n in range(total.shape[0]):
        total[n] = wa * a[n] + wb * b[n] + wc * c[n] + wd * d[n]


@njit(**_JIT)
def _times(total, a, b):
    for n in range(total.shape[0]):
        total[n] += a[n] * b[n]


@njit(**_JIT)
def _node_row(node, envelope, coarse, row, row_weight, i, line):
    """Row i of nodes (M, K): all smooth layers' envelopes times their images, added up."""
    node[:, :] = 0.0
    for e in range(envelope.shape[0]):
        at, w = row[e, i], row_weight[e, i]
        a, b, c, d = coarse[e, at[0]], coarse[e, at[1]], coarse[e, at[2]], coarse[e, at[3]]
        _weighted(line, a, b, c, d, w[0], w[1], w[2], w[3])
        for h in range(envelope.shape[1]):
            _times(node[h], envelope[e, h, i], line)


@njit(**_JIT)
def _rotated(plain, c1, s1, c2, s2, turn_c, turn_s):
    """Envelopes of a pixel row whose phase is δ ahead of the carrier's, turned onto the carrier and folded:

    A + C1 cos θ + S1 sin θ + C2 cos 2θ + S2 sin 2θ = (A − C2) + S1 s + c·(C1 + 2 C2 c + 2 S2 s), as cos 2θ = 2c² − 1.
    """
    for k in range(plain.shape[0]):
        c, s = turn_c[k], turn_s[k]
        a, b = c1[k], s1[k]
        c1[k], s1[k] = c * a + s * b, c * b - s * a
        c, s = c * c - s * s, c * s + c * s
        a, b = c2[k], s2[k]
        a, b = c * a + s * b, c * b - s * a
        plain[k] -= a
        c2[k], s2[k] = a + a, b + b


@njit(**_JIT)
def _cubics(a0, a1, a2, a3, n0, n1, n2, n3, half, sixth):
    """Coefficients of the cubic through four nodes at −1, 0, 1, 2, for every cell."""
    for k in range(a0.shape[0]):
        p, q, r, s = n0[k], n1[k], n2[k], n3[k]
        middle = r - q
        even = half * (p + r) - q
        odd = sixth * (s - p) - half * middle
        a0[k], a1[k], a2[k], a3[k] = q, middle - even - odd, even, odd


@njit(**_JIT)
def _coefficients(coef, ring, first, w, turn_c, turn_s, mixed, const):
    """One pixel row's cubics along x, coef (4 M, cells), from four rows of nodes: ring (4, M·K), place by number."""
    a, b, c, d = ring[first % 4], ring[(first + 1) % 4], ring[(first + 2) % 4], ring[(first + 3) % 4]
    cells, kinds = coef.shape[1], coef.shape[0] // 4
    _weighted(mixed.reshape(-1), a, b, c, d, w[0], w[1], w[2], w[3])
    if kinds == 5:
        _rotated(mixed[0], mixed[1], mixed[2], mixed[3], mixed[4], turn_c, turn_s)
    for h in range(kinds):
        m, at = mixed[h], 4 * h
        _cubics(coef[at], coef[at + 1], coef[at + 2], coef[at + 3], m[:cells], m[1:], m[2:], m[3:], const[0], const[1])


def _lanes(kinds, fresh, name):
    """``LANES`` neighbouring pixels at once, written in the compiler's own vectors.

    The loop over the pixels of a cell is too short for the compiler to vectorise by itself; its coefficients, a tuple
    of 4·kinds numbers, stay in registers. Sets out[x:] to pattern·image + value, or adds the value.
    """

    def typed(context, out, pattern, image, cosine, sine, t, x, p, coef):
        def code(target, builder, signature, args):
            real = target.get_data_type(out.dtype)
            lanes, size = ir.VectorType(real, LANES), target.get_abi_sizeof(real)
            nothing, zeros = ir.Constant(lanes, ir.Undefined), ir.Constant(ir.VectorType(ir.IntType(32), LANES), None)
            data = [target.make_array(kind)(target, builder, value).data
                    for kind, value in zip(signature.args[:6], args[:6], strict=True)]  # fmt: skip

            def place(n, at):
                return builder.bitcast(builder.gep(data[n], [at]), lanes.as_pointer())

            def load(n, at):
                return builder.load(place(n, at), align=size)

            def all_of(number):
                one = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
                return builder.shuffle_vector(one, nothing, zeros)

            def fused(a, b, c):
                return builder.fadd(builder.fmul(a, b, flags=("contract",)), c, flags=("contract",))

            along = load(5, args[7])
            number = cgutils.unpack_tuple(builder, args[8], 4 * kinds)

            def value(h):
                total = all_of(number[4 * h + 3])
                for d in (2, 1, 0):
                    total = fused(total, along, all_of(number[4 * h + d]))
                return total

            total = value(0)
            if kinds == 5:
                c, s = load(3, args[6]), load(4, args[6])
                turned = fused(s, value(4), fused(c, value(3), value(1)))
                total = fused(s, value(2), fused(c, turned, total))
            if fresh:
                total = fused(load(1, args[6]), load(2, args[6]), total)
            else:
                total = builder.fadd(load(0, args[6]), total)
            builder.store(total, place(0, args[6]), align=size)
            return target.get_dummy_value()

        return types.void(out, pattern, image, cosine, sine, t, x, p, coef), code

    typed.__name__ = typed.__qualname__ = name
    return intrinsic(typed)


_set1, _add1 = _lanes(1, True, "_set1"), _lanes(1, False, "_add1")
_set5, _add5 = _lanes(5, True, "_set5"), _lanes(5, False, "_add5")


@njit(**_JIT)
def _cubic_at(a, h, u):
    return ((a[4 * h + 3] * u + a[4 * h + 2]) * u + a[4 * h + 1]) * u + a[4 * h]


@njit(**_JIT)
def _cells1(out, pattern, image, cosine, sine, t, coef, fresh):
    """A row without harmonics: see ``_cells5``."""
    pitch = t.shape[0]
    for k in range(coef.shape[1]):
        a = (coef[0, k], coef[1, k], coef[2, k], coef[3, k])
        start = k * pitch
        if start + pitch <= out.shape[0]:
            for p in range(0, pitch, LANES):
                if fresh:
                    _set1(out, pattern, image, cosine, sine, t, start + p, p, a)
                else:
                    _add1(out, pattern, image, cosine, sine, t, start + p, p, a)
        else:
            for x in range(start, out.shape[0]):
                before = pattern[x] * image[x] if fresh else out[x]
                out[x] = before + _cubic_at(a, 0, t[x - start])


@njit(**_JIT)
def _cells5(out, pattern, image, cosine, sine, t, coef, fresh):
    """A row of pixels from its cubics: set to pattern·image + smooth layers if fresh, else these are added."""
    pitch = t.shape[0]
    for k in range(coef.shape[1]):
        a = (
            coef[0, k], coef[1, k], coef[2, k], coef[3, k], coef[4, k], coef[5, k], coef[6, k], coef[7, k], coef[8, k],
            coef[9, k], coef[10, k], coef[11, k], coef[12, k], coef[13, k], coef[14, k], coef[15, k], coef[16, k],
            coef[17, k], coef[18, k], coef[19, k],
        )  # fmt: skip
        start = k * pitch
        if start + pitch <= out.shape[0]:
            for p in range(0, pitch, LANES):
                if fresh:
                    _set5(out, pattern, image, cosine, sine, t, start + p, p, a)
                else:
                    _add5(out, pattern, image, cosine, sine, t, start + p, p, a)
        else:
            for x in range(start, out.shape[0]):
                u, c, s = t[x - start], cosine[x], sine[x]
                turned = _cubic_at(a, 1, u) + c * _cubic_at(a, 3, u) + s * _cubic_at(a, 4, u)
                before = pattern[x] * image[x] if fresh else out[x]
                out[x] = before + (_cubic_at(a, 0, u) + s * _cubic_at(a, 2, u) + c * turned)


@njit(**_JIT)
def frame_rows(
    out, pattern, image, index, weight, carrier, turn, envelope, coarse, row, row_weight, table, t, const, first, last
):
    """Rows first…last − 1 of a frame, set: one sharp layer and all smooth layers. ``first`` starts a cell.

    The last axis of every array has to be contiguous.

    out (R, X); pattern, image, index, weight: see ``sharp_rows``
    carrier (2, cells, X): cos and sin of the nominal phase on the first row of each cell; turn (2, R, K): of what each
    row is ahead of it, at the nodes
    envelope (E, M, N, K): of 1, and with M = 5 of cos θ, sin θ, cos 2θ, sin 2θ, on N rows by K columns of nodes, the
    first one pitch before the zone
    coarse (E, V, K): the layers' images on coarse rows along track and on the nodes across it
    row, row_weight (E, N, 4): which coarse rows make up each row of nodes in this frame
    table (pitch, 4), t (pitch,): Lagrange weights, and places, of the pixels between the second and third of four nodes
    const: 1/2 and 1/6 in the arrays' type
    """
    pitch, kinds, nodes = t.shape[0], envelope.shape[1], envelope.shape[3]
    ring, mixed = np.empty((4, kinds, nodes), out.dtype), np.empty((kinds, nodes), out.dtype)
    line, coef = np.empty(nodes, out.dtype), np.empty((4 * kinds, nodes - 3), out.dtype)
    flat = ring.reshape(4, -1)
    fresh = pattern.shape[0] == 1 and index.shape[1] == 1
    done = first // pitch
    for j in range(first, last):
        cell = j // pitch
        for i in range(done, cell + 4):
            _node_row(ring[i % 4], envelope, coarse, row, row_weight, i, line)
        done = cell + 4
        _coefficients(coef, flat, cell, table[j - cell * pitch], turn[0, j], turn[1, j], mixed, const)
        if not fresh:
            _sharp_row(out[j], pattern, image, index, weight, j, False)
        one, c, s = image[0, index[j, 0]], carrier[0, cell], carrier[1, cell]
        if kinds == 1:
            _cells1(out[j], pattern[0, j], one, c, s, t, coef, fresh)
        else:
            _cells5(out[j], pattern[0, j], one, c, s, t, coef, fresh)


@njit(**_JIT)
def _gather_row(total, frame, c, s, u):
    """One row's share in the six right-hand sides of the fit: total (6, X)."""
    for x in range(frame.shape[0]):
        d = frame[x]
        dc, ds = d * c[x], d * s[x]
        total[0, x] += d
        total[1, x] += d * u
        total[2, x] += dc
        total[3, x] += ds
        total[4, x] += dc * c[x] - ds * s[x]
        total[5, x] += dc * s[x] + dc * s[x]


@njit(**_JIT)
def gather_rows(ring, slot, frame, row, cosine, sine, u):
    """Right-hand sides of the fringe fit: rows of a frame into the ground rows they see.

    ring (N, 6, X) of open ground rows; slot (J,): which of them each row goes to; row (J,): rows of the frame;
    cosine, sine (J, X), u (J,): the model on them.
    """
    for k in range(row.shape[0]):
        _gather_row(ring[slot[k]], frame[row[k]], cosine[k], sine[k], u[k])
