"""Compiled loops of the frames: patterns times scene images, smooth ghost layers, and what is summed along the scroll.

A frame is out[j, x] = Σ_c factor[c, j]·pattern[c, j, x]·image[c, place[c, j], x] + Σ_h harmonic_h[j, x]·field_h(j, x).
The first sum holds sharp layers, read row by row, with one, two or four rows of the scene weighted for a fraction of a
row. The second holds all smooth layers together: their images and envelopes live on a coarse grid of nodes every
``pitch`` pixels, are multiplied and added there, and only the sum is brought to the pixels, by cubic Lagrange
interpolation: along y on the nodes, once per row of pixels, where harmonics meet their envelopes too, since fringes run
along x and change as slowly across track as these; then along x inside the loop over pixels, where all pixels of a cell
share four nodes. So a frame moves hardly more memory than pattern, image and result take.

All arrays of one call share one floating type, so that nothing is converted on the way. Nodes stand in groups of LANES,
with all that is multiplied for a group one behind the other in memory.

Two threads share a frame: one takes pieces of it from the top, the other from the bottom, until none is left. No sum
depends on who computes it: the result is the same to the last bit.
"""

from __future__ import annotations

import numpy as np
from numba import carray, njit

from cgi_wave.kernels.lanes import LANES, count_up, counted, load, nothing, pointer, spread, store

#: A product may be fused with the sum it goes into; nothing else of IEEE arithmetic is given up.
_JIT = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
WHOLE = 1e-9  # of a row: a place this close to a row of the scene is on it
PIECE = 16  # rows that a thread takes at a time, at most
PATIENCE = 20_000  # looks at whether the other thread is done with its last piece, before the caller asks less often


@njit(**_JIT)
def _take(counter, turn, pieces, from_top):
    """Number of this thread's next piece, its ``turn``-th; −1 if all are given out."""
    if count_up(counter, 0) >= pieces:
        return -1
    return turn if from_top else pieces - 1 - turn


@njit(**_JIT)
def _wait(counter, pieces):
    """Until all pieces are done, for a while: the other thread may have been put to sleep."""
    for _ in range(PATIENCE):
        if counted(counter, 1) >= pieces:
            return


@njit(**_JIT)
def warped_rows(out, pattern, image, x, y, shift, wrap, order, counter, from_top):
    """Pieces of PIECE rows of out, added to: a layer whose image turns, so that every pixel is looked up by itself.

    image (C, H, W); x, y (R, X): columns and rows of the image at shift 0, in samples; ``order`` 2 or 4 taps each way.
    Beyond the image its edge goes on; along rows it repeats if ``wrap``. counter, from_top: see ``frame_rows``.
    """
    height, width, rows = image.shape[1], image.shape[2], out.shape[0]
    wx, wy = np.empty(4), np.empty(4)
    pieces, turn = -(-rows // PIECE), 0
    while True:
        piece = _take(counter, turn, pieces, from_top)
        if piece < 0:
            break
        turn += 1
        for j in range(piece * PIECE, min((piece + 1) * PIECE, rows)):
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
        count_up(counter, 1)
    _wait(counter, pieces)


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
def _row(number, size, wrap):
    """A row of an image that goes on beyond its ends, or repeats."""
    if 0 <= number < size:
        return number
    return number % size if wrap else min(max(number, 0), size - 1)


@njit(**_JIT)
def _taps(place, size, count, wrap, index, weight):
    """Rows of an image that make up a place on it, and their weights (as ``smooth.taps``): how many, 1 on a row."""
    nearest = np.rint(place)
    if abs(place - nearest) < WHOLE:
        index[0] = _row(int(nearest), size, wrap)
        return 1
    if not wrap:
        place = min(max(place, 0.0), size - 1.0)
    start = np.floor(place)
    if count == 4 and not wrap and size >= 4:
        start = min(max(start, 1.0), size - 3.0)
    cubic(place - start, weight, count)
    for n in range(count):
        index[n] = _row(int(start) + n - (count // 2 - 1), size, wrap)
    return count


@njit(**_JIT)
def _line(address, like):
    """The contiguous row, as long as ``like``, whose data begin at an address. Unlike ``like`` it is not counted:
    counting who holds an array takes longer than all else that is done once per row."""
    return carray(pointer(address), (like.shape[0],), like.dtype)


@njit(**_JIT)
def _blend(spare, address, stride, count, index, weight):
    """Two or four rows of an image, weighted, in ``spare``. Left to itself the compiler fears that they overlap."""
    columns = spare.shape[0]
    whole = columns - columns % LANES
    a, b = _line(address + stride * index[0], spare), _line(address + stride * index[1], spare)
    wa, wb = spread(weight, 0), spread(weight, 1)
    if count == 2:
        for x in range(0, whole, LANES):
            store(spare, x, wb * load(b, x) + wa * load(a, x))
        for x in range(whole, columns):
            spare[x] = weight[0] * a[x] + weight[1] * b[x]
        return
    c, d = _line(address + stride * index[2], spare), _line(address + stride * index[3], spare)
    wc, wd = spread(weight, 2), spread(weight, 3)
    for x in range(0, whole, LANES):
        total = wb * load(b, x) + wa * load(a, x)
        total = wc * load(c, x) + total
        store(spare, x, wd * load(d, x) + total)
    for x in range(whole, columns):
        spare[x] = weight[0] * a[x] + weight[1] * b[x] + weight[2] * c[x] + weight[3] * d[x]


@njit(**_JIT)
def _product(out, pattern, image, add, factor):
    """Pattern times image, set; or added, times factor[0]."""
    columns = out.shape[0]
    whole = columns - columns % LANES
    if add:
        f = spread(factor, 0)
        for x in range(0, whole, LANES):
            store(out, x, f * load(pattern, x) * load(image, x) + load(out, x))
        for x in range(whole, columns):
            out[x] += factor[0] * pattern[x] * image[x]
    else:
        for x in range(0, whole, LANES):
            store(out, x, load(pattern, x) * load(image, x))
        for x in range(whole, columns):
            out[x] = pattern[x] * image[x]


@njit(**_JIT)
def _pixels(out, pattern, image, table, node):
    """A row of pixels: pattern·image and, from its nodes, all smooth layers. table (4, pitch).

    The same pixels of all cells come one after the other: their weights stay in registers, and of four nodes three.
    """
    pitch, columns = table.shape[1], out.shape[0]
    whole, p = columns // pitch, 0
    while p + 2 * LANES <= pitch:
        q = p + LANES
        wa, wb, wc, wd = load(table, p), load(table, pitch + p), load(table, 2 * pitch + p), load(table, 3 * pitch + p)
        va, vb, vc, vd = load(table, q), load(table, pitch + q), load(table, 2 * pitch + q), load(table, 3 * pitch + q)
        a, b, c = spread(node, 0), spread(node, 1), spread(node, 2)
        x = p
        for k in range(whole):
            d = spread(node, k + 3)
            total = wa * a + load(pattern, x) * load(image, x)
            more = va * a + load(pattern, x + LANES) * load(image, x + LANES)
            total = wb * b + total
            more = vb * b + more
            total = wc * c + total
            more = vc * c + more
            store(out, x, wd * d + total)
            store(out, x + LANES, vd * d + more)
            a, b, c = b, c, d
            x += pitch
        p += 2 * LANES
    if p < pitch:
        wa, wb, wc, wd = load(table, p), load(table, pitch + p), load(table, 2 * pitch + p), load(table, 3 * pitch + p)
        a, b, c = spread(node, 0), spread(node, 1), spread(node, 2)
        x = p
        for k in range(whole):
            d = spread(node, k + 3)
            total = wa * a + load(pattern, x) * load(image, x)
            total = wb * b + total
            total = wc * c + total
            store(out, x, wd * d + total)
            a, b, c = b, c, d
            x += pitch
    for x in range(whole * pitch, out.shape[0]):
        p = x - whole * pitch
        total = pattern[x] * image[x]
        for d in range(4):
            total += table[d, p] * node[whole + d]
        out[x] = total


@njit(**_JIT)
def _places(i, row, shift, size, wrap, first, weight):
    """First of the four coarse rows, and weights, of every smooth layer on row i of nodes."""
    for e in range(first.shape[0]):
        place = row[e, i] + shift[e]
        if wrap:
            place -= np.floor(place / size[e]) * size[e]
            if place >= size[e]:  # rounded up to it
                place = 0.0
            start = np.floor(place)
            first[e] = int(start)  # the rows begin one before the first
            cubic(place - start, weight[e], 4)
        else:
            first[e], t = _start(place, size[e], False)
            cubic(t, weight[e], 4)


@njit(**_JIT)
def _image(coarse, at, weight, e):
    """Four coarse rows of a layer, one behind the other, weighted."""
    total = spread(weight, 4 * e) * load(coarse, at)
    total = spread(weight, 4 * e + 1) * load(coarse, at + LANES) + total
    total = spread(weight, 4 * e + 2) * load(coarse, at + 2 * LANES) + total
    return spread(weight, 4 * e + 3) * load(coarse, at + 3 * LANES) + total


@njit(**_JIT)
def _node_row(total, i, fringed, plain, coarse, first, weight):
    """Row i of nodes (G·M·LANES): all smooth layers, those with fringes first."""
    groups, layers, height = coarse.shape[0], coarse.shape[1], coarse.shape[2]
    many, few = fringed.shape[2], plain.shape[2]
    for g in range(groups):
        base = g * layers * height
        t = nothing(total)
        at = (i * groups + g) * few * LANES
        if many > 0:
            c1, s1, c2, s2 = nothing(total), nothing(total), nothing(total), nothing(total)
            f = (i * groups + g) * many * 5 * LANES
            for e in range(many):
                image = _image(coarse, (base + e * height + first[e]) * LANES, weight, e)
                t = image * load(fringed, f) + t
                c1 = image * load(fringed, f + LANES) + c1
                s1 = image * load(fringed, f + 2 * LANES) + s1
                c2 = image * load(fringed, f + 3 * LANES) + c2
                s2 = image * load(fringed, f + 4 * LANES) + s2
                f += 5 * LANES
            f = g * 5 * LANES
            store(total, f + LANES, c1)
            store(total, f + 2 * LANES, s1)
            store(total, f + 3 * LANES, c2)
            store(total, f + 4 * LANES, s2)
        for e in range(many, layers):
            t = _image(coarse, (base + e * height + first[e]) * LANES, weight, e) * load(plain, at) + t
            at += LANES
        store(total, g * (5 if many > 0 else 1) * LANES, t)


@njit(**_JIT)
def _own_row(node, i, own, coarse, first, weight):
    """Nodes (G·LANES) of a row of pixels that has its own: ``own`` (D, G, E + F, LANES), without fringes."""
    groups, layers, height = coarse.shape[0], coarse.shape[1], coarse.shape[2]
    at = i * groups * layers * LANES
    for g in range(groups):
        t = nothing(node)
        for e in range(layers):
            place = ((g * layers + e) * height + first[e]) * LANES
            t = _image(coarse, place, weight, e) * load(own, at) + t
            at += LANES
        store(node, g * LANES, t)


@njit(**_JIT)
def _between(ring, first, at, wa, wb, wc, wd):
    """Lanes number ``at`` of four rows of nodes, weighted: ring (4, …), place by number mod 4."""
    size = ring.shape[1]
    total = wa * load(ring, (first % 4) * size + at)
    total = wb * load(ring, ((first + 1) % 4) * size + at) + total
    total = wc * load(ring, ((first + 2) % 4) * size + at) + total
    return wd * load(ring, ((first + 3) % 4) * size + at) + total


@njit(**_JIT)
def _mixed(node, ring, first, along, row, turn, j):
    """Nodes of pixel row j: A + C1 cos θ + S1 sin θ + C2 cos 2θ + S2 sin 2θ, each from four rows of nodes.

    along (pitch, 4): their weights, its row ``row``; turn (2, R, K).
    """
    size = node.shape[0]
    at = 4 * row
    wa, wb, wc, wd = spread(along, at), spread(along, at + 1), spread(along, at + 2), spread(along, at + 3)
    cosine, sine = j * size, (turn.shape[1] + j) * size
    if ring.shape[1] == size:
        for k in range(0, size, LANES):
            store(node, k, _between(ring, first, k, wa, wb, wc, wd))
        return
    for k in range(0, size, LANES):
        c, s = load(turn, cosine + k), load(turn, sine + k)
        total = _between(ring, first, 5 * k, wa, wb, wc, wd)
        total = c * _between(ring, first, 5 * k + LANES, wa, wb, wc, wd) + total
        total = s * _between(ring, first, 5 * k + 2 * LANES, wa, wb, wc, wd) + total
        total = (c * c - s * s) * _between(ring, first, 5 * k + 3 * LANES, wa, wb, wc, wd) + total
        total = (c * s + c * s) * _between(ring, first, 5 * k + 4 * LANES, wa, wb, wc, wd) + total
        store(node, k, total)


@njit(**_JIT)
def frame_rows(
    out, terms, place, factor, shift, wrap, turn, which, fringed, plain, own, coarse, row, step, size, table, counter,
    from_top,
):  # fmt: skip
    """Pieces of a frame, set: sharp layers and all smooth layers. Returns the number of pieces.

    out (R, X), contiguous
    terms (S, 5): of each sharp layer and spectral mode where the data of its pattern (R, X), contiguous, and of its
    image (H, X) begin, bytes from row to row of the image, H, and taps (2 or 4)
    factor (S, R): of each row of a term, from the second term on; that of the first is 1
    place (S, R): rows of the image at scroll 0; shift: rows by which the ground has moved; wrap: images repeat
    K nodes make G = K / LANES groups; K is filled up with zeros. No nodes: no smooth layers
    turn (2, R, K): cos and sin of the nominal phase of each row of pixels, at the nodes
    fringed (N, G, E, 5, LANES), plain (N, G, F, LANES): envelopes of layers with and without fringes, of 1, and for the
    former of cos θ, sin θ, cos 2θ, sin 2θ, on N rows of nodes, the first one pitch before the zone
    which (R,): number of the row of ``own`` (D, G, E + F, LANES) that serves this row of pixels alone, or −1
    coarse (G, E + F, V, LANES): the layers' images on coarse rows along track and on the nodes across it; if they wrap
    one row of the end stands before each and two rows of the beginning behind
    row (E + F, N + D): place of each row of nodes among the coarse rows at scroll 0; step (E + F,): rows of the scene
    per coarse row; size (E + F,): their number, four at least
    table (4, pitch): Lagrange weights of the pixels between the second and third of four nodes
    counter (2,): pieces given out and done, 0 at first, shared by the threads; from_top: which end this one begins at
    """
    rows, pitch = out.shape[0], table.shape[1]
    groups, layers, lines = coarse.shape[0], coarse.shape[1], fringed.shape[0]
    nodes = groups * LANES
    ring = np.empty((4, (5 if fringed.shape[2] > 0 else 1) * nodes), out.dtype)
    node, spare, along, w = np.empty(nodes, out.dtype), np.empty_like(out[0]), table.T.copy(), np.empty(4, out.dtype)
    first, weight, index = np.empty(layers, np.int64), np.empty((layers, 4), out.dtype), np.empty(4, np.int64)
    f = np.empty(1, out.dtype)
    begin, blended, line = out.ctypes.data, spare.ctypes.data, spare.shape[0] * spare.itemsize
    moved = shift / step
    unit = min(pitch, PIECE)
    pieces, turns = -(-rows // unit), 0
    held = -8  # rows held … held + 3 of nodes are in the ring
    while True:
        piece = _take(counter, turns, pieces, from_top)
        if piece < 0:
            break
        turns += 1
        cell = piece * unit // pitch
        for i in range(cell, cell + 4 if nodes else cell):
            if not held <= i < held + 4:
                _places(i, row, moved, size, wrap, first, weight)
                _node_row(ring[i % 4], i, fringed, plain, coarse, first, weight)
        held = cell
        # Layer by layer: rows of many images begin at like addresses, and would drive each other out of the cache.
        for s in range(terms.shape[0]):
            for j in range(piece * unit, min((piece + 1) * unit, rows)):
                count = _taps(place[s, j] + shift, terms[s, 3], terms[s, 4], wrap, index, w)
                at = terms[s, 1] + terms[s, 2] * index[0]  # where the scene's row begins
                if count > 1:
                    _blend(spare, terms[s, 1], terms[s, 2], count, index, w)
                    at = blended
                pattern, image = _line(terms[s, 0] + j * line, spare), _line(at, spare)
                if s > 0 or nodes == 0:
                    f[0] = factor[s, j]
                    _product(_line(begin + j * line, spare), pattern, image, s > 0, f)
                    continue
                if which[j] >= 0:
                    _places(lines + which[j], row, moved, size, wrap, first, weight)
                    _own_row(node, which[j], own, coarse, first, weight)
                else:
                    _mixed(node, ring, cell, along, j - cell * pitch, turn, j)
                _pixels(_line(begin + j * line, spare), pattern, image, table, node)
        count_up(counter, 1)
    _wait(counter, pieces)
    return pieces


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
