"""Closest points of a cable that is thicker in places, as its tube is, to bodies that a plain cable comes near to.

Tables are those of :mod:`cable_shape.kernels.distance.bounds`. A piece counts as thick as its thicker end.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.bounds import into_body, least_on_piece, on_mesh, on_solid, place_body, tree_point
from cable_shape.kernels.distance.distance import MESH, signed_distance
from cable_shape.kernels.distance.triangles import STACK_SIZE


@kernel
def closest_points(
    positions: Array, arc_length: Array, radius: float, swell: Array, exclusion: float, bodies: Array, links: Array,
    triangles: Array, nodes: Array, result: Array,
) -> None:  # fmt: skip
    """Replaces the rows of `result` (m, 8) whose distance is finite by those of the swollen cable.

    swell (n,) [m]: by how much it is thicker at each point than `radius`; the rest as for the plain cable.
    """
    pieces = positions.shape[0] - 1
    frame = np.empty((4, 3))
    stack = np.empty(STACK_SIZE, np.int64)
    local = np.empty((2, 7))  # the two ends of a piece in the body's frame, signed distance, gradient
    for m in range(bodies.shape[0]):
        if result[m, 0] == math.inf:
            continue
        body = bodies[m]
        mesh = body[0] >= MESH
        place_body(body[4:11], links, int(body[11]), frame)
        low, high = -math.inf, math.inf
        if body[12] != 0.0:
            low, high = arc_length[0] + exclusion, arc_length[pieces] - exclusion
        best, best_piece, best_t, best_d = math.inf, -1, 0.0, 0.0
        bx, by, bz = 0.0, 0.0, 0.0
        for i in range(pieces + 1):
            p, q = local[(i + 1) % 2], local[i % 2]
            q[0], q[1], q[2] = into_body(frame, positions[i, 0], positions[i, 1], positions[i, 2])
            if mesh:
                q[3], q[4], q[5], q[6] = tree_point(body, triangles, nodes, q[0], q[1], q[2], math.inf, True, stack)
            else:
                q[3], q[4], q[5], q[6] = signed_distance(int(body[0]), body[1], body[2], body[3], q[0], q[1], q[2])
            if i == 0 or arc_length[i - 1] >= high or arc_length[i] <= low:
                continue
            thick = max(swell[i - 1], swell[i])
            if least_on_piece(body, p, q) - thick > best:
                continue
            long = arc_length[i] - arc_length[i - 1]
            t0 = max((low - arc_length[i - 1]) / long, 0.0)
            t1 = min((high - arc_length[i - 1]) / long, 1.0)
            if mesh:
                t, d, nx, ny, nz = on_mesh(body, triangles, nodes, p, q, t0, t1, math.inf, True, stack)
            else:
                t, d, nx, ny, nz = on_solid(body, p, q, t0, t1)
            if d - thick < best:
                best, best_piece, best_t, best_d = d - thick, i - 1, t, d
                bx, by, bz = nx, ny, nz
        if best_piece < 0:
            result[m, 0] = math.inf
            continue
        i = best_piece
        result[m, 0] = best - radius
        result[m, 1] = arc_length[i] + best_t * (arc_length[i + 1] - arc_length[i])
        for a in range(3):
            out = frame[0, a] * bx + frame[1, a] * by + frame[2, a] * bz
            centre = positions[i, a] + best_t * (positions[i + 1, a] - positions[i, a])
            result[m, 2 + a] = centre - (radius + best_d - best) * out
            result[m, 5 + a] = centre - best_d * out
