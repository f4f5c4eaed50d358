"""Compiled loops of the frames: patterns times scene images, smooth ghost layers, and what is summed along the scroll.

A frame is out[j, x] = Σ_c pattern[c, j, x] · image[c, index[j], x] + Σ_h harmonic_h[j, x] · field_h(j, x). The first
sum holds sharp layers, read row by row, with one, two or four rows of the scene weighted for a fraction of a row. The
second holds all smooth layers together: their images and envelopes live on a coarse grid of nodes every ``pitch``
pixels, are multiplied and added there, and only the sum is brought to the pixels, by cubic Lagrange interpolation:
along y on the nodes, once per row of pixels, where harmonics meet their envelopes too, since fringes run along x and
change as slowly across track as these; then along x inside the loop over pixels, where all pixels of a cell share four
nodes. So a frame moves hardly more memory than pattern, image and result take.

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
def sampled(image, row, ahead, column, wrap):
    """(C, V, K) an image (C, H, W) at rows row (V,) + ahead (K,) and columns (K,), by four samples each way.

    Beyond the image its edge goes on; along rows it repeats if ``wrap``.
    """
    modes, height, width = image.shape
    out = np.empty((modes, row.shape[0], column.shape[0]), image.dtype)
    wx, wy = np.empty(4), np.empty(4)
    for k in range(column.shape[0]):
        x, t = _start(column[k], width, False)
        cubic(t, wx, 4)
        for v in range(row.shape[0]):
            y, t = _start(row[v] + ahead[k], height, wrap)
            cubic(t, wy, 4)
            for c in range(modes):
                total = 0.0
                for b in range(4):
                    r = (y + b) % height if wrap else y + b
                    total += wy[b] * (wx[0] * image[c, r, x] + wx[1] * image[c, r, x + 1] + wx[2] * image[c, r, x + 2]
                                      + wx[3] * image[c, r, x + 3])  # fmt: skip
                out[c, v, k] = total
    return out


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
def _start(place, size, wrap):
    """First of the four samples of a line that make up a place on it, and how far beyond the second it lies.

    The line repeats if ``wrap``; else its ends go on, and there four samples on one side serve (as ``smooth.taps``).
    """
    if not wrap:
        place = min(max(place, 0.0), size - 1.0)
    start = np.floor(place)
    if not wrap:
        start = min(max(start, 1.0), size - 3.0)
    return int(start) - 1, place - start


@njit(**_JIT)
def _lines(line, coarse, row, shift, size, wrap, i, w):
    """Images of all layers on row i of nodes, once per kind: line (E, M, K)."""
    for e in range(line.shape[0]):
        first, t = _start(row[e, i] + shift[e], size[e], wrap)
        cubic(t, w, 4)
        a, b, c, d = first, first + 1, first + 2, first + 3
        if wrap:
            a, b, c, d = a % size[e], b % size[e], c % size[e], d % size[e]
        wa, wb, wc, wd = w[0], w[1], w[2], w[3]
        for k in range(line.shape[2]):
            line[e, 0, k] = wa * coarse[e, a, k] + wb * coarse[e, b, k] + wc * coarse[e, c, k] + wd * coarse[e, d, k]
        for h in range(1, line.shape[1]):
            for k in range(line.shape[2]):
                line[e, h, k] = line[e, 0, k]


@njit(**_JIT)
def _add_products(total, a, b):
    """total[n] += Σ_e a[e, n] b[e, n]."""
    for e in range(a.shape[0]):
        for n in range(a.shape[1]):
            total[n] += a[e, n] * b[e, n]


@njit(**_JIT)
def _folded(plain, c1, s1, c2, s2, cosine, sine):
    """All kinds of a row of nodes added up, into the first: A + C1 cos θ + S1 sin θ + C2 cos 2θ + S2 sin 2θ."""
    for k in range(plain.shape[0]):
        c, s = cosine[k], sine[k]
        plain[k] += c * c1[k] + s * s1[k] + (c * c - s * s) * c2[k] + (c * s + c * s) * s2[k]


@njit(**_JIT)
def _mixed(out, ring, first, w, cosine, sine):
    """Nodes of one pixel row, in out[:K] of (M·K), from four rows of nodes: ring (4, M·K), place by number mod 4."""
    a, b, c, d = ring[first % 4], ring[(first + 1) % 4], ring[(first + 2) % 4], ring[(first + 3) % 4]
    _weighted(out, a, b, c, d, w[0], w[1], w[2], w[3])
    nodes = cosine.shape[0]
    if out.shape[0] > nodes:
        _folded(out[:nodes], out[nodes : 2 * nodes], out[2 * nodes : 3 * nodes], out[3 * nodes : 4 * nodes],
                out[4 * nodes :], cosine, sine)  # fmt: skip


def _lanes(fresh, name):
    """``LANES`` neighbouring pixels at once, from the nodes k … k + 3, written in the compiler's own vectors.

    The loop over the pixels of a cell is too short for the compiler to vectorise by itself. Sets out[x:] to
    pattern·image + Σ_d w[d, p:] node[k + d], or adds the sum.
    """

    def typed(context, out, pattern, image, w, node, x, p, k):
        def code(target, builder, signature, args):
            real = target.get_data_type(out.dtype)
            lanes, size = ir.VectorType(real, LANES), target.get_abi_sizeof(real)
            nothing, zeros = ir.Constant(lanes, ir.Undefined), ir.Constant(ir.VectorType(ir.IntType(32), LANES), None)
            data = [target.make_array(kind)(target, builder, value).data
                    for kind, value in zip(signature.args[:5], args[:5], strict=True)]  # fmt: skip
            _, pitch = cgutils.unpack_tuple(builder, target.make_array(w)(target, builder, args[3]).shape, 2)

            def place(n, at):
                return builder.bitcast(builder.gep(data[n], [at]), lanes.as_pointer())

            def load(n, at):
                return builder.load(place(n, at), align=size)

            def ahead(at, steps, d):
                return builder.add(at, builder.mul(steps, ir.Constant(steps.type, d)))

            def all_of(number):
                one = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
                return builder.shuffle_vector(one, nothing, zeros)

            def fused(a, b, c):
                return builder.fadd(builder.fmul(a, b, flags=("contract",)), c, flags=("contract",))

            if fresh:
                total = builder.fmul(load(1, args[5]), load(2, args[5]), flags=("contract",))
            else:
                total = load(0, args[5])
            for d in range(4):
                number = builder.load(builder.gep(data[4], [builder.add(args[7], ir.Constant(args[7].type, d))]))
                total = fused(load(3, ahead(args[6], pitch, d)), all_of(number), total)
            builder.store(total, place(0, args[5]), align=size)
            return target.get_dummy_value()

        return types.void(out, pattern, image, w, node, x, p, k), code

    typed.__name__ = typed.__qualname__ = name
    return intrinsic(typed)


_set_lanes, _add_lanes = _lanes(True, "_set_lanes"), _lanes(False, "_add_lanes")


@njit(**_JIT)
def _between(node, k, w, p):
    return w[0, p] * node[k] + w[1, p] * node[k + 1] + w[2, p] * node[k + 2] + w[3, p] * node[k + 3]


@njit(**_JIT)
def _set_row(out, pattern, image, w, node):
    """A row of pixels: pattern·image and, from its nodes (K,), all smooth layers."""
    pitch, whole = w.shape[1], out.shape[0] // w.shape[1]
    for k in range(whole):
        for p in range(0, pitch, LANES):
            _set_lanes(out, pattern, image, w, node, k * pitch + p, p, k)
    for x in range(whole * pitch, out.shape[0]):
        out[x] = pattern[x] * image[x] + _between(node, whole, w, x - whole * pitch)


@njit(**_JIT)
def _add_row(out, w, node):
    """The same of the smooth layers alone, added."""
    pitch, whole = w.shape[1], out.shape[0] // w.shape[1]
    for k in range(whole):
        for p in range(0, pitch, LANES):
            _add_lanes(out, out, out, w, node, k * pitch + p, p, k)
    for x in range(whole * pitch, out.shape[0]):
        out[x] += _between(node, whole, w, x - whole * pitch)


@njit(**_JIT)
def _node_row(total, i, fringed, plain, coarse, row, shift, size, wrap, many, one, w):
    """Row i of nodes (M·K): all smooth layers, those with fringes first; many (E, M, K), one (F, 1, K): work space."""
    total[:] = 0.0
    e = many.shape[0]
    if e > 0:
        _lines(many, coarse[:e], row[:e], shift[:e], size[:e], wrap, i, w)
        _add_products(total, fringed[i], many.reshape(e, many.shape[1] * many.shape[2]))
    if one.shape[0] > 0:
        _lines(one, coarse[e:], row[e:], shift[e:], size[e:], wrap, i, w)
        _add_products(total, plain[i], one.reshape(one.shape[0], one.shape[2]))


@njit(**_JIT)
def frame_rows(
    out, pattern, image, index, weight, turn, own, fringed, plain, coarse, row, shift, size, wrap, table, first, last,
):  # fmt: skip
    """Rows first…last − 1 of a frame, set: one sharp layer and all smooth layers. ``first`` starts a cell.

    The last axis of every array has to be contiguous.

    out (R, X); pattern, image, index, weight: see ``sharp_rows``
    turn (2, R, K): cos and sin of the nominal phase of each row of pixels, at the nodes
    fringed (N, E, 5 K), plain (N, F, K): envelopes of layers with and without fringes, of 1, and for the former of
    cos θ, sin θ, cos 2θ, sin 2θ, on N rows by K columns of nodes, the first one pitch before the zone
    own (R,): number of the row of nodes that serves this row of pixels alone, or −1
    coarse (E + F, V, K): the layers' images on coarse rows along track and on the nodes across it
    row (E + F, N): place of each row of nodes among the coarse rows at scroll 0; shift (E + F,): by how many of them
    the ground has moved; size (E + F,): their number, four at least; wrap: they repeat
    table (4, pitch): Lagrange weights of the pixels between the second and third of four nodes
    """
    pitch, nodes = table.shape[1], coarse.shape[2]
    kinds = 5 if fringed.shape[1] > 0 else 1
    ring, mixed = np.empty((4, kinds * nodes), out.dtype), np.empty(kinds * nodes, out.dtype)
    many, one = np.empty((fringed.shape[1], kinds, nodes), out.dtype), np.empty((plain.shape[1], 1, nodes), out.dtype)
    along, w = table.T.copy(), np.empty(4, out.dtype)
    fresh = pattern.shape[0] == 1 and index.shape[1] == 1
    done = first // pitch
    for j in range(first, last):
        cell = j // pitch
        for i in range(done, cell + 4):
            _node_row(ring[i % 4], i, fringed, plain, coarse, row, shift, size, wrap, many, one, w)
        done = cell + 4
        if own[j] < 0:
            _mixed(mixed, ring, cell, along[j - cell * pitch], turn[0, j], turn[1, j])
        else:  # all of it is in the first kind
            _node_row(mixed, own[j], fringed, plain, coarse, row, shift, size, wrap, many, one, w)
        if fresh:
            _set_row(out[j], pattern[0, j], image[0, index[j, 0]], table, mixed)
        else:
            _sharp_row(out[j], pattern, image, index, weight, j, False)
            _add_row(out[j], table, mixed)


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
