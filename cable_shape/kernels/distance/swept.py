"""The distance to a strip of triangles on a grid, and the surface at one distance: what sweeping a space needs.

The grid's cubes are cut into six tetrahedra along their long diagonal, in which the surface is one or two triangles
(marching tetrahedra): it is closed, and the same whichever way it is cut.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.triangles import Indices, nearest_on_triangle

#: Corners of the six tetrahedra of a cube: bits 1, 2, 4 for x, y, z.
TETRAHEDRA = np.array(
    ((0, 1, 3, 7), (0, 1, 5, 7), (0, 2, 3, 7), (0, 2, 6, 7), (0, 4, 5, 7), (0, 4, 6, 7)), dtype=np.int64
)
#: An edge is its lower corner, times so much, and the bits that lead to the other one.
EDGES = 8


@kernel(nogil=True)
def stamp(
    field: Array, origin: Array, h: float, first: int, last: int, triangles: Array, extra: Array, reach: float
) -> None:
    """Lowers field (nx, ny, nz) at x from `first` to `last` - 1 to the least of distance - extra to the triangles.

    triangles (t, 9) [m], extra (t,) [m]; h [m] is the width of a cube; nothing above `reach` [m] is told.
    """
    for t in range(triangles.shape[0]):
        tri = triangles[t]
        far = reach + extra[t]
        low, high = np.empty(3, np.int64), np.empty(3, np.int64)
        for c in range(3):
            a, b = min(tri[c], tri[3 + c], tri[6 + c]), max(tri[c], tri[3 + c], tri[6 + c])
            low[c] = max(0, math.ceil((a - far - origin[c]) / h))
            high[c] = min(field.shape[c] - 1, math.floor((b + far - origin[c]) / h))
        for i in range(max(low[0], first), min(high[0], last - 1) + 1):
            x = origin[0] + i * h
            for j in range(low[1], high[1] + 1):
                y = origin[1] + j * h
                for k in range(low[2], high[2] + 1):
                    z = origin[2] + k * h
                    qx, qy, qz, _ = nearest_on_triangle(tri, x, y, z)
                    d = math.sqrt((qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2) - extra[t]
                    if d < field[i, j, k]:
                        field[i, j, k] = d


@kernel(nogil=True)
def surface(field: Array, level: float, faces: Indices, write: bool) -> int:
    """How many triangles the surface at `level` has.

    write: fills faces (f, 3) with the edges that their corners are on, counter-clockwise from outside.
    """
    count = 0
    ny, nz = field.shape[1], field.shape[2]
    corner, at, inside, outside = np.empty(8), np.empty(8, np.int64), np.empty(4, np.int64), np.empty(4, np.int64)
    for i in range(field.shape[0] - 1):
        for j in range(ny - 1):
            for k in range(nz - 1):
                low = high = field[i, j, k]
                for b in range(8):
                    corner[b] = field[i + (b & 1), j + (b >> 1 & 1), k + (b >> 2)]
                    low, high = min(low, corner[b]), max(high, corner[b])
                if low > level or high <= level:
                    continue
                for b in range(8):
                    at[b] = ((i + (b & 1)) * ny + j + (b >> 1 & 1)) * nz + k + (b >> 2)
                for t in range(6):
                    n = m = 0
                    for v in range(4):
                        b = TETRAHEDRA[t, v]
                        if corner[b] <= level:
                            inside[n] = b
                            n += 1
                        else:
                            outside[m] = b
                            m += 1
                    if n == 0 or m == 0:
                        continue
                    if n == 2:
                        if write:
                            a, b, c, d = inside[0], inside[1], outside[0], outside[1]
                            put(faces[count], at, (a, c), (a, d), (b, d), a, c)
                            put(faces[count + 1], at, (a, c), (b, d), (b, c), a, c)
                        count += 2
                        continue
                    if write:
                        if n == 1:
                            a = inside[0]
                            put(faces[count], at, (a, outside[0]), (a, outside[1]), (a, outside[2]), a, outside[0])
                        else:
                            a = outside[0]
                            put(faces[count], at, (inside[0], a), (inside[1], a), (inside[2], a), inside[0], a)
                    count += 1
    return count


@kernel
def middle(edge: tuple[int, int], axis: int) -> float:
    """Twice the coordinate of an edge's middle in its cube."""
    return float((edge[0] >> axis & 1) + (edge[1] >> axis & 1))


@kernel
def put(
    face: Indices, at: Indices, p: tuple[int, int], q: tuple[int, int], r: tuple[int, int], inside: int, outside: int
) -> None:  # fmt: skip
    """Fills a triangle with its three edges, turned so that it is counter-clockwise from `outside`."""
    u0, u1, u2 = middle(q, 0) - middle(p, 0), middle(q, 1) - middle(p, 1), middle(q, 2) - middle(p, 2)
    v0, v1, v2 = middle(r, 0) - middle(p, 0), middle(r, 1) - middle(p, 1), middle(r, 2) - middle(p, 2)
    n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    way = 0.0
    way += n0 * ((outside & 1) - (inside & 1))
    way += n1 * ((outside >> 1 & 1) - (inside >> 1 & 1))
    way += n2 * ((outside >> 2 & 1) - (inside >> 2 & 1))
    face[0] = key(at, p)
    face[1] = key(at, q if way > 0.0 else r)
    face[2] = key(at, r if way > 0.0 else q)


@kernel
def key(at: Indices, edge: tuple[int, int]) -> int:
    """An edge of a cube as one number, the same from every cube that has it."""
    a, b = min(edge[0], edge[1]), max(edge[0], edge[1])
    return at[a] * EDGES + (b ^ a)


@kernel(nogil=True)
def crossings(field: Array, level: float, keys: Indices, origin: Array, h: float, vertices: Array) -> None:
    """Fills vertices (v, 3) [m]: where the field, linear along these edges, has the level."""
    ny, nz = field.shape[1], field.shape[2]
    for v in range(keys.shape[0]):
        low, bits = keys[v] // EDGES, keys[v] % EDGES
        i, j, k = low // (ny * nz), low // nz % ny, low % nz
        a, b = field[i, j, k], field[i + (bits & 1), j + (bits >> 1 & 1), k + (bits >> 2)]
        t = (level - a) / (b - a)
        vertices[v, 0] = origin[0] + h * (i + t * (bits & 1))
        vertices[v, 1] = origin[1] + h * (j + t * (bits >> 1 & 1))
        vertices[v, 2] = origin[2] + h * (k + t * (bits >> 2))
