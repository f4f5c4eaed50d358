"""Compiled loops of the frames: patterns times scene images, smooth ghost layers, and what is summed along the scroll.

A frame is out[j, x] = Σ_c pattern[c, j, x] · image[c, index[j], x] + Σ_h harmonic_h[j, x] · field_h(j, x). The first
sum holds sharp layers, read row by row, with one, two or four rows of the scene weighted for a fraction of a row. The
second holds all smooth layers together: their images and envelopes live on a coarse grid of nodes every ``pitch``
pixels, are multiplied and added there, and only the sum is brought to the pixels, by cubic Lagrange interpolation:
along x once per coarse row, along y inside the loop over pixels.

All arrays of one call share one floating type, so that nothing is converted on the way. Loops over pixels are functions
of their own on contiguous rows: that is what lets the compiler vectorise them. No sum is reordered, and every row is
computed in one piece, so that results do not depend on how rows are given out to threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: A product may be fused with the sum it goes into; nothing else of IEEE arithmetic is given up.
_JIT = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
BLOCK = 208  # columns in one piece of the harmonic sum: 20 coarse rows stay in the first cache; odd in cache lines


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
def _weighted(total, a, b, c, d, w):
    wa, wb, wc, wd = w[0], w[1], w[2], w[3]
    for n in range(total.shape[0]):
        total[n] = wa * a[n] + wb * b[n] + wc * c[n] + wd * d[n]


@njit(**_JIT)
def _times(total, a, b):
    for n in range(total.shape[0]):
        total[n] += a[n] * b[n]


@njit(**_JIT)
def _spread(out, node, weight, base, shift):
    """One coarse row brought to the pixels: out (X,), node (N,), weight (3, 4, pitch), base and shift (cells,)."""
    pitch, size = weight.shape[2], out.shape[0]
    full = size // pitch
    for p in range(pitch):
        inner = weight[1, :, p]
        w0, w1, w2, w3 = inner[0], inner[1], inner[2], inner[3]
        for k in range(1, full):  # cells whose four nodes stand one before and two after; the others are done below
            out[k * pitch + p] = w0 * node[k - 1] + w1 * node[k] + w2 * node[k + 1] + w3 * node[k + 2]
    for k in range(base.shape[0]):
        if shift[k] != 1 or k >= full:
            b, w = base[k], weight[shift[k]]
            for p in range(min(pitch, size - k * pitch)):
                out[k * pitch + p] = (w[0, p] * node[b] + w[1, p] * node[b + 1] + w[2, p] * node[b + 2]
                                      + w[3, p] * node[b + 3])  # fmt: skip


@njit(**_JIT)
def _mix(a, b, c, d, wa, wb, wc, wd):
    return wa * a + wb * b + wc * c + wd * d


@njit(**_JIT)
def _turn(c, s, plain, c1, s1, c2, s2):
    return plain + c * c1 + s * s1 + (c * c - s * s) * c2 + (c * s + c * s) * s2


@njit(**_JIT)
def _tile1(tile, f, w):
    """Four rows of one block from four coarse rows; f in one piece, at distances known when this is compiled."""
    w00, w01, w02, w03 = w[0, 0], w[0, 1], w[0, 2], w[0, 3]
    w10, w11, w12, w13 = w[1, 0], w[1, 1], w[1, 2], w[1, 3]
    w20, w21, w22, w23 = w[2, 0], w[2, 1], w[2, 2], w[2, 3]
    w30, w31, w32, w33 = w[3, 0], w[3, 1], w[3, 2], w[3, 3]
    for x in range(BLOCK):
        a, b, c, d = f[x], f[BLOCK + x], f[2 * BLOCK + x], f[3 * BLOCK + x]
        tile[x] = _mix(a, b, c, d, w00, w01, w02, w03)
        tile[BLOCK + x] = _mix(a, b, c, d, w10, w11, w12, w13)
        tile[2 * BLOCK + x] = _mix(a, b, c, d, w20, w21, w22, w23)
        tile[3 * BLOCK + x] = _mix(a, b, c, d, w30, w31, w32, w33)


@njit(**_JIT)
def _tile5(tile, turn, f, w):
    """The same with harmonics: turn holds cos θ of the four rows, then sin θ. Loads of f serve four rows each."""
    w00, w01, w02, w03 = w[0, 0], w[0, 1], w[0, 2], w[0, 3]
    w10, w11, w12, w13 = w[1, 0], w[1, 1], w[1, 2], w[1, 3]
    w20, w21, w22, w23 = w[2, 0], w[2, 1], w[2, 2], w[2, 3]
    w30, w31, w32, w33 = w[3, 0], w[3, 1], w[3, 2], w[3, 3]
    for x in range(BLOCK):
        a0, b0, c0, d0 = f[x], f[5 * BLOCK + x], f[10 * BLOCK + x], f[15 * BLOCK + x]
        a1, b1, c1, d1 = f[BLOCK + x], f[6 * BLOCK + x], f[11 * BLOCK + x], f[16 * BLOCK + x]
        a2, b2, c2, d2 = f[2 * BLOCK + x], f[7 * BLOCK + x], f[12 * BLOCK + x], f[17 * BLOCK + x]
        a3, b3, c3, d3 = f[3 * BLOCK + x], f[8 * BLOCK + x], f[13 * BLOCK + x], f[18 * BLOCK + x]
        a4, b4, c4, d4 = f[4 * BLOCK + x], f[9 * BLOCK + x], f[14 * BLOCK + x], f[19 * BLOCK + x]
        tile[x] = _turn(
            turn[x], turn[4 * BLOCK + x],
            _mix(a0, b0, c0, d0, w00, w01, w02, w03), _mix(a1, b1, c1, d1, w00, w01, w02, w03),
            _mix(a2, b2, c2, d2, w00, w01, w02, w03), _mix(a3, b3, c3, d3, w00, w01, w02, w03),
            _mix(a4, b4, c4, d4, w00, w01, w02, w03),
        )  # fmt: skip
        tile[BLOCK + x] = _turn(
            turn[BLOCK + x], turn[5 * BLOCK + x],
            _mix(a0, b0, c0, d0, w10, w11, w12, w13), _mix(a1, b1, c1, d1, w10, w11, w12, w13),
            _mix(a2, b2, c2, d2, w10, w11, w12, w13), _mix(a3, b3, c3, d3, w10, w11, w12, w13),
            _mix(a4, b4, c4, d4, w10, w11, w12, w13),
        )  # fmt: skip
        tile[2 * BLOCK + x] = _turn(
            turn[2 * BLOCK + x], turn[6 * BLOCK + x],
            _mix(a0, b0, c0, d0, w20, w21, w22, w23), _mix(a1, b1, c1, d1, w20, w21, w22, w23),
            _mix(a2, b2, c2, d2, w20, w21, w22, w23), _mix(a3, b3, c3, d3, w20, w21, w22, w23),
            _mix(a4, b4, c4, d4, w20, w21, w22, w23),
        )  # fmt: skip
        tile[3 * BLOCK + x] = _turn(
            turn[3 * BLOCK + x], turn[7 * BLOCK + x],
            _mix(a0, b0, c0, d0, w30, w31, w32, w33), _mix(a1, b1, c1, d1, w30, w31, w32, w33),
            _mix(a2, b2, c2, d2, w30, w31, w32, w33), _mix(a3, b3, c3, d3, w30, w31, w32, w33),
            _mix(a4, b4, c4, d4, w30, w31, w32, w33),
        )  # fmt: skip


@njit(**_JIT)
def _add(out, part):
    for x in range(out.shape[0]):
        out[x] += part[x]


@njit(**_JIT)
def carrier_tiles(cosine, sine, pitch, tiles):
    """cos θ and sin θ (R, X) in the order ``frame_rows`` reads them: tiles (cells, blocks, pitch/4, 8·BLOCK)."""
    rows, columns = cosine.shape
    for cell in range(tiles.shape[0]):
        for block in range(tiles.shape[1]):
            for part in range(tiles.shape[2]):
                for r in range(4):
                    j = min(cell * pitch + 4 * part + r, rows - 1)
                    for x in range(BLOCK):
                        i = min(block * BLOCK + x, columns - 1)
                        tiles[cell, block, part, r * BLOCK + x] = cosine[j, i]
                        tiles[cell, block, part, (4 + r) * BLOCK + x] = sine[j, i]


@njit(**_JIT)
def _node_row(field, envelope, coarse, row, row_weight, table, base, shift, i, line, node, pixels):
    """Row i of nodes into its place in ``field``: all smooth layers times their images, added up, spread along x."""
    kinds = envelope.shape[1]
    node[:, :] = 0.0
    for e in range(envelope.shape[0]):
        at = row[e, i]
        _weighted(line, coarse[e, at[0]], coarse[e, at[1]], coarse[e, at[2]], coarse[e, at[3]], row_weight[e, i])
        for h in range(kinds):
            _times(node[h], envelope[e, h, i], line)
    for h in range(kinds):
        _spread(pixels, node[h], table, base, shift)
        to = ((i % 4) * kinds + h) * BLOCK
        for block in range(field.shape[0]):
            x = block * BLOCK
            size = min(BLOCK, pixels.shape[0] - x)
            field[block, to : to + size] = pixels[x : x + size]


@njit(**_JIT)
def _cell(out, tiles, field, turned, tile):
    """A cell's rows of out (≤ pitch, X), added to: tiles (blocks, pitch/4, 8·BLOCK), turned (pitch, 4)."""
    kinds, columns = field.shape[1] // (4 * BLOCK), out.shape[1]
    for block in range(field.shape[0]):
        x, end = block * BLOCK, min((block + 1) * BLOCK, columns)
        for part in range(turned.shape[0] // 4):
            if kinds == 1:
                _tile1(tile, field[block], turned[4 * part :])
            else:
                _tile5(tile, tiles[block, part], field[block], turned[4 * part :])
            for r in range(min(4, out.shape[0] - 4 * part)):
                _add(out[4 * part + r, x:end], tile[r * BLOCK :])


@njit(**_JIT)
def frame_rows(
    out, pattern, image, index, weight, tiles, envelope, coarse, row, row_weight, table, base_x, shift_x, base_y,
    shift_y, field, first, last,
):  # fmt: skip
    """Rows first…last − 1 of a frame, set: one sharp layer and all smooth layers. ``first`` starts a cell.

    out (R, X); pattern, image, index, weight: see ``sharp_rows``; tiles: of the nominal phase, see ``carrier_tiles``
    envelope (E, M, N, K): of 1, and with M = 5 of cos θ, sin θ, cos 2θ, sin 2θ, on N rows by K columns of nodes
    coarse (E, V, K): the layers' images on coarse rows along track and on the nodes across it
    row, row_weight (E, N, 4): which coarse rows make up each row of nodes in this frame
    table (3, 4, pitch): Lagrange weights at the pixels after the first, second, third of four nodes
    base, shift (cells,): first of the four nodes of each cell of pixels, and in which of their three gaps it lies
    field (blocks, 4·M·BLOCK): work space of this call alone: the four rows of nodes in use, row i in place i mod 4, so
    that they stay in the second-level cache
    """
    pitch, kinds, columns = table.shape[2], envelope.shape[1], out.shape[1]
    line, node = np.empty(envelope.shape[3], out.dtype), np.empty((kinds, envelope.shape[3]), out.dtype)
    pixels, tile = np.empty(columns, out.dtype), np.empty(4 * BLOCK, out.dtype)
    turned = np.empty((pitch, 4), out.dtype)
    done = base_y[first // pitch]
    for cell in range(first // pitch, (last - 1) // pitch + 1):
        low, high = cell * pitch, min(last, (cell + 1) * pitch)
        b = base_y[cell]
        for i in range(done, b + 4):
            _node_row(field, envelope, coarse, row, row_weight, table, base_x, shift_x, i, line, node, pixels)
        done = b + 4
        for t in range(4):
            for p in range(pitch):
                turned[p, (b + t) % 4] = table[shift_y[cell], t, p]
        for j in range(low, high):
            _sharp_row(out[j], pattern, image, index, weight, j, False)
        _cell(out[low:high], tiles[cell], field, turned, tile)


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
