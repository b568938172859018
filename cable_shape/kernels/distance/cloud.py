"""Which points of a cloud lie on a line, and where: what a fit to them needs, summed over each piece of the line."""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel

#: Columns of the sums over a piece: weight, weight * place in it, weight * miss (3).
WEIGHT, PLACE, MISS = 0, 1, 2
SUMS = 5
#: Pieces count whose square of the distance is larger than the least by no more than so many variances.
_FAR = 20.0
#: Logarithm of how much likelier a point that is told to be of something else is that.
_SURE = 30.0
#: Columns of what is worked out once of a piece: the way along it (3) [m], 1 / its square, its length / sqrt(2
#: variances), -1 / (2 variances), the density about its middle [1/m^3].
_WAY, _INVERSE, _SCALE, _FALL, _DENSITY, _PIECE = 0, 3, 4, 5, 6, 7
#: Pieces in a block that is passed over at once where it is far away.
_BLOCK = 8


@kernel
def put_ball(line: Array, first: int, last: int, balls: Array, row: int) -> None:
    """Fills a row: middle and radius [m] of a ball about the pieces from `first` to before `last`."""
    x = y = z = 0.0
    for i in range(first, last + 1):
        x, y, z = x + line[i, 0], y + line[i, 1], z + line[i, 2]
    count = last + 1 - first
    x, y, z = x / count, y / count, z / count
    most = 0.0
    for i in range(first, last + 1):
        most = max(most, (line[i, 0] - x) ** 2 + (line[i, 1] - y) ** 2 + (line[i, 2] - z) ** 2)
    balls[row, 0], balls[row, 1], balls[row, 2], balls[row, 3] = x, y, z, math.sqrt(most)


@kernel
def put_piece(line: Array, spread: Array, length: float, i: int, out: Array) -> None:
    """Fills row i of the pieces."""
    square = 0.0
    for c in range(3):
        way = line[i + 1, c] - line[i, c]
        out[i, _WAY + c] = way
        square += way * way
    out[i, _INVERSE] = 1.0 / square
    out[i, _SCALE] = math.sqrt(square / (2.0 * spread[i]))
    out[i, _FALL] = -0.5 / spread[i]
    out[i, _DENSITY] = 1.0 / (2.0 * math.pi * spread[i] * length)


@kernel
def assign(
    line: Array, spread: Array, points: Array, length: float, outside: float, pulled: tuple[bool, bool], sums: Array,
    told: Array,
) -> float:  # fmt: skip
    """Fills sums (n + 1, SUMS) and told (m,), and returns the logarithm of the likelihood of the points (m, 3) [m].

    A point is of the line (n, 3) [m] with the density of a normal distribution about it, evenly along its length [m],
    of variance spread (n - 1,) [m^2] in each direction; or of something else, with the density outside [1/m^3] in terms
    of that. Pieces whose spread is 0 are none: lines may follow each other. A point is spread over pieces by how likely
    it is of each. Misses are across the line: a point beyond an end is of no piece, unless that end is `pulled`: then
    it is of the rows n - 1 (start) and n (end), and its miss is the whole way. told: how likely it is of the line.
    """
    pieces = line.shape[0] - 1
    squares, places = np.empty(pieces), np.empty(pieces)
    share, which = np.empty(pieces + 2), np.empty(pieces + 2, np.int64)
    blocks = (pieces + _BLOCK - 1) // _BLOCK
    balls, near, made = np.empty((blocks, 4)), np.empty(blocks), np.zeros((pieces, _PIECE))
    wide = densest = 0.0
    for b in range(blocks):
        put_ball(line, b * _BLOCK, min(pieces, (b + 1) * _BLOCK), balls, b)
    for i in range(pieces):
        if spread[i] > 0.0:
            put_piece(line, spread, length, i, made)
            wide, densest = max(wide, spread[i]), max(densest, made[i, _DENSITY])
    alone = 0.0  # m^2: points further away are of something else
    if densest > 0.0:
        alone = 2.0 * wide * max(0.0, _SURE + math.log((pieces + 2) * densest / outside))
    sums[:, :] = 0.0
    whole = 0.0
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        first, closest = 0, math.inf
        for b in range(blocks):
            u, v, w = x - balls[b, 0], y - balls[b, 1], z - balls[b, 2]
            near[b] = math.sqrt(u * u + v * v + w * w) - balls[b, 3]
            if near[b] < closest:
                first, closest = b, near[b]
        if closest > 0.0 and closest * closest > alone:
            told[k] = 0.0
            whole += math.log(outside)
            continue
        least, nearest = math.inf, 0
        for o in range(blocks):
            b = (first + o) % blocks
            begin, stop = b * _BLOCK, min(pieces, (b + 1) * _BLOCK)
            if near[b] > 0.0 and near[b] ** 2 > least + _FAR * wide:
                squares[begin:stop] = math.inf
                continue
            for i in range(begin, stop):
                squares[i], places[i] = math.inf, 0.5
                if spread[i] <= 0.0:
                    continue
                a, d, c = made[i, _WAY], made[i, _WAY + 1], made[i, _WAY + 2]
                u, v, w = x - line[i, 0], y - line[i, 1], z - line[i, 2]
                t = (a * u + d * v + c * w) * made[i, _INVERSE]
                places[i] = t
                t = min(1.0, max(0.0, t))
                u, v, w = u - t * a, v - t * d, w - t * c
                squares[i] = u * u + v * v + w * w
                if squares[i] < least:
                    least, nearest = squares[i], i
        bound = least + _FAR * spread[nearest]
        total, count = 0.0, 0
        for b in range(blocks):
            if near[b] > 0.0 and near[b] ** 2 > bound:
                continue
            for i in range(b * _BLOCK, min(pieces, (b + 1) * _BLOCK)):
                if squares[i] < bound:
                    across, t, scale = squares[i], places[i], made[i, _SCALE]
                    if t < 0.0 or t > 1.0:
                        u = x - line[i, 0] - t * made[i, _WAY]
                        v = y - line[i, 1] - t * made[i, _WAY + 1]
                        w = z - line[i, 2] - t * made[i, _WAY + 2]
                        across = u * u + v * v + w * w
                    cover = 0.5 * (math.erf((1.0 - t) * scale) + math.erf(t * scale))
                    some = cover * math.exp(across * made[i, _FALL]) * made[i, _DENSITY]
                    if some > 0.0:
                        which[count], share[count] = i, some
                        count += 1
                        total += some
        for end in range(2):
            i = 0 if end == 0 else pieces - 1
            beyond = places[i] < 0.0 if end == 0 else places[i] > 1.0
            if pulled[end] and squares[i] < bound and beyond:
                some = 0.5 * math.exp(squares[i] * made[i, _FALL]) * made[i, _DENSITY]
                which[count], share[count] = pieces + end, some
                count += 1
                total += some
        told[k] = total / (total + outside)
        whole += math.log(total + outside)
        for o in range(count):
            g = share[o] / (total + outside)
            i = which[o]
            j = i if i < pieces else (0 if i == pieces else pieces - 1)
            t = places[j] if i < pieces else min(1.0, max(0.0, places[j]))
            u = x - line[j, 0] - t * made[j, _WAY]
            v = y - line[j, 1] - t * made[j, _WAY + 1]
            w = z - line[j, 2] - t * made[j, _WAY + 2]
            sums[i, WEIGHT] += g
            sums[i, PLACE] += g * min(1.0, max(0.0, t))
            sums[i, MISS] += g * u
            sums[i, MISS + 1] += g * v
            sums[i, MISS + 2] += g * w
    return whole
