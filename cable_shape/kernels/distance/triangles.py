"""Distance of a point and of a segment to a triangle mesh, through a tree of bounding boxes.

A row of the table of triangles (30,) holds the corners A, B, C (9) and seven outward normals (21), one for each
feature on which a closest point can lie: face, edges AB, BC, CA, corners A, B, C. The normals of edges and corners are
sums over the faces that meet there, at corners weighted by angle; with them the side of a point is right everywhere
(Baerentzen and Aanaes, "Signed distance computation using the angle weighted pseudonormal", 2005).

A row of the table of nodes (14,) holds the centre and the half edges of a box, then (first triangle, number) of a
leaf or (first child, 0) of a node whose children are neighbours, then the directions of the box's first two edges. A
box lies as its triangles do: patches of a fine mesh are flat, and boxes along the axes would be far thicker.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.distance import box_distance, least_between

Indices = NDArray[np.int64]

TRIANGLE_COLUMNS, NODE_COLUMNS = 30, 14
FACE, EDGE_AB, EDGE_BC, EDGE_CA, CORNER_A, CORNER_B, CORNER_C = 0, 1, 2, 3, 4, 5, 6
STACK_SIZE = 128  # far more than the levels of a tree split at medians, each of which leaves one node waiting

#: [m] Boxes are skipped only if they are further than the best by more than this, far above rounding, so that skipping
#: never changes which of two equally near features is found.
SLACK = 1e-9


@kernel
def nearest_on_triangle(tri: Array, x: float, y: float, z: float) -> tuple[float, float, float, int]:
    """The point of the triangle nearest to (x, y, z) and the feature it lies on: (qx, qy, qz, feature).

    By the regions of the triangle's corners and edges (Ericson, "Real-Time Collision Detection", section 5.1.5).
    """
    ax, ay, az, bx, by, bz, cx, cy, cz = tri[0], tri[1], tri[2], tri[3], tri[4], tri[5], tri[6], tri[7], tri[8]
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    px, py, pz = x - ax, y - ay, z - az
    d1, d2 = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az, CORNER_A
    px, py, pz = x - bx, y - by, z - bz
    d3, d4 = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    if d3 >= 0.0 and d4 <= d3:
        return bx, by, bz, CORNER_B
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return ax + t * ux, ay + t * uy, az + t * uz, EDGE_AB
    px, py, pz = x - cx, y - cy, z - cz
    d5, d6 = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    if d6 >= 0.0 and d5 <= d6:
        return cx, cy, cz, CORNER_C
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        return ax + t * vx, ay + t * vy, az + t * vz, EDGE_CA
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return bx + t * (cx - bx), by + t * (cy - by), bz + t * (cz - bz), EDGE_BC
    scale = 1.0 / (va + vb + vc)
    v, w = vb * scale, vc * scale
    return ax + v * ux + w * vx, ay + v * uy + w * vy, az + v * uz + w * vz, FACE


@kernel
def _between_segments(
    px: float,
    py: float,
    pz: float,
    dx: float,
    dy: float,
    dz: float,
    ox: float,
    oy: float,
    oz: float,
    ex: float,
    ey: float,
    ez: float,
) -> float:
    """The t in [0, 1] at which p + t d is nearest to the segment o + u e (Ericson, section 5.1.9)."""
    rx, ry, rz = px - ox, py - oy, pz - oz
    dd, ee = dx * dx + dy * dy + dz * dz, ex * ex + ey * ey + ez * ez
    de = dx * ex + dy * ey + dz * ez
    dr, er = dx * rx + dy * ry + dz * rz, ex * rx + ey * ry + ez * rz
    if dd == 0.0:
        return 0.0
    t = 0.0
    kx, ky, kz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
    determinant = kx * kx + ky * ky + kz * kz  # dd ee - de^2 without its cancellation
    if determinant > 0.0:
        t = min(max((de * er - dr * ee) / determinant, 0.0), 1.0)
    u = de * t + er
    if u < 0.0:
        return min(max(-dr / dd, 0.0), 1.0)
    if u > ee:
        return min(max((de - dr) / dd, 0.0), 1.0)
    return t


@kernel
def segment_triangle(
    tri: Array, px: float, py: float, pz: float, dx: float, dy: float, dz: float
) -> tuple[float, float]:
    """The t in [0, 1] and the squared distance at which p + t d comes nearest to the triangle: (t, square)."""
    best_t, best = 0.0, np.inf
    for candidate in range(6):
        if candidate < 2:
            t = float(candidate)
        elif candidate < 5:
            i, j = 3 * (candidate - 2), 3 * ((candidate - 1) % 3)
            ox, oy, oz = tri[i], tri[i + 1], tri[i + 2]
            t = _between_segments(px, py, pz, dx, dy, dz, ox, oy, oz, tri[j] - ox, tri[j + 1] - oy, tri[j + 2] - oz)
        else:
            slope = tri[9] * dx + tri[10] * dy + tri[11] * dz
            height = tri[9] * (px - tri[0]) + tri[10] * (py - tri[1]) + tri[11] * (pz - tri[2])
            if slope == 0.0 or height * (height + slope) > 0.0:
                continue
            t = min(max(-height / slope, 0.0), 1.0)
        x, y, z = px + t * dx, py + t * dy, pz + t * dz
        qx, qy, qz, _ = nearest_on_triangle(tri, x, y, z)
        square = (x - qx) ** 2 + (y - qy) ** 2 + (z - qz) ** 2
        if square < best:
            best_t, best = t, square
    return best_t, best


@kernel
def to_box(nodes: Array, node: int, x: float, y: float, z: float) -> float:
    """Squared distance of a point to the box of a node, 0 inside."""
    a, b, c = _in_box(nodes, node, x - nodes[node, 0], y - nodes[node, 1], z - nodes[node, 2])
    a = max(abs(a) - nodes[node, 3], 0.0)
    b = max(abs(b) - nodes[node, 4], 0.0)
    c = max(abs(c) - nodes[node, 5], 0.0)
    return a * a + b * b + c * c


@kernel(forceinline=True)
def _in_box(nodes: Array, node: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector along the edges of the box of a node."""
    ux, uy, uz, vx, vy, vz = (
        nodes[node, 8], nodes[node, 9], nodes[node, 10], nodes[node, 11], nodes[node, 12], nodes[node, 13],
    )  # fmt: skip
    return (
        ux * x + uy * y + uz * z,
        vx * x + vy * y + vz * z,
        (uy * vz - uz * vy) * x + (uz * vx - ux * vz) * y + (ux * vy - uy * vx) * z,
    )


@kernel
def push_children(nodes: Array, node: int, x: float, y: float, z: float, stack: Indices, depth: int) -> int:
    """Puts the children of a node on the stack, on top that which is likely nearer to (x, y, z); the new depth.

    They are the halves of their parent along its first edge.
    """
    first = int(nodes[node, 6])
    x, y, z = x - nodes[node, 0], y - nodes[node, 1], z - nodes[node, 2]
    upper = x * nodes[node, 8] + y * nodes[node, 9] + z * nodes[node, 10] > 0.0
    stack[depth], stack[depth + 1] = (first, first + 1) if upper else (first + 1, first)
    return depth + 2


@kernel
def mesh_point(
    triangles: Array,
    nodes: Array,
    root: int,
    closed: bool,
    x: float,
    y: float,
    z: float,
    reach: float,
    cull: bool,
    stack: Indices,
) -> tuple[float, float, float, float]:
    """Distance of a point to the mesh, negative inside a closed one, and its gradient: (d, nx, ny, nz).

    `reach` [m]: no triangle further away is looked for, and the distance is infinite if none is as near; infinite: all
    are. On the surface the gradient is the normal.
    """
    d, nx, ny, nz, _, _ = mesh_feature(triangles, nodes, root, closed, x, y, z, reach, cull, stack)
    return d, nx, ny, nz


@kernel
def mesh_feature(
    triangles: Array,
    nodes: Array,
    root: int,
    closed: bool,
    x: float,
    y: float,
    z: float,
    reach: float,
    cull: bool,
    stack: Indices,
) -> tuple[float, float, float, float, int, int]:
    """As `mesh_point`, and the triangle that is nearest and its feature: (d, nx, ny, nz, i, feature)."""
    best, found, kind = np.inf, -1, FACE
    limit = (reach + SLACK) ** 2
    qx, qy, qz = x, y, z
    stack[0] = root
    depth = 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if cull and to_box(nodes, node, x, y, z) > limit:
            continue
        first, number = int(nodes[node, 6]), int(nodes[node, 7])
        if number == 0:
            depth = push_children(nodes, node, x, y, z, stack, depth)
            continue
        for i in range(first, first + number):
            rx, ry, rz, feature = nearest_on_triangle(triangles[i], x, y, z)
            square = (x - rx) ** 2 + (y - ry) ** 2 + (z - rz) ** 2
            if square < best or (square == best and i < found):
                best, found, kind = square, i, feature
                qx, qy, qz = rx, ry, rz
                limit = min(limit, (math.sqrt(best) + SLACK) ** 2)
    if found < 0:
        return np.inf, 0.0, 0.0, 0.0, found, kind
    column = 9 + 3 * kind
    nx, ny, nz = triangles[found, column], triangles[found, column + 1], triangles[found, column + 2]
    d = math.sqrt(best)
    if d == 0.0:
        return d, nx, ny, nz, found, kind
    if closed and (x - qx) * nx + (y - qy) * ny + (z - qz) * nz < 0.0:
        d = -d
    return d, (x - qx) / d, (y - qy) / d, (z - qz) / d, found, kind


@kernel
def segment_to_box(nodes: Array, node: int, px: float, py: float, pz: float, dx: float, dy: float, dz: float) -> float:
    """A lower bound on the distance of p + t d, t in [0, 1], to the box of a node, from the tangents at its ends."""
    a, b, c = nodes[node, 3], nodes[node, 4], nodes[node, 5]
    x, y, z = _in_box(nodes, node, px - nodes[node, 0], py - nodes[node, 1], pz - nodes[node, 2])
    dx, dy, dz = _in_box(nodes, node, dx, dy, dz)
    d, nx, ny, nz = box_distance(a, b, c, x, y, z)
    e, mx, my, mz = box_distance(a, b, c, x + dx, y + dy, z + dz)
    return max(least_between(1.0, d, nx * dx + ny * dy + nz * dz, e, mx * dx + my * dy + mz * dz), 0.0)


@kernel
def mesh_segment(
    triangles: Array,
    nodes: Array,
    root: int,
    px: float,
    py: float,
    pz: float,
    dx: float,
    dy: float,
    dz: float,
    reach: float,
    cull: bool,
    stack: Indices,
) -> tuple[float, float, int]:
    """The t in [0, 1] at which p + t d comes nearest to the surface of the mesh, and that triangle: (t, distance, i).

    i is -1 if nothing is within `reach` [m].
    """
    best, best_t, found = np.inf, 0.0, -1
    limit = reach + SLACK
    stack[0] = root
    depth = 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if cull and segment_to_box(nodes, node, px, py, pz, dx, dy, dz) > limit:
            continue
        first, number = int(nodes[node, 6]), int(nodes[node, 7])
        if number == 0:
            depth = push_children(nodes, node, px, py, pz, stack, depth)
            continue
        for i in range(first, first + number):
            t, square = segment_triangle(triangles[i], px, py, pz, dx, dy, dz)
            if square < best or (square == best and i < found):
                best, best_t, found = square, t, i
                limit = min(limit, math.sqrt(best) + SLACK)
    return best_t, math.sqrt(best), found


@kernel
def mesh_points(
    triangles: Array, nodes: Array, root: int, closed: bool, points: Array, cull: bool, stack: Indices, out: Array
) -> None:
    """Fills out (n,) with the distances of points (n, 3) to the mesh, see `mesh_point`."""
    for k in range(points.shape[0]):
        out[k] = mesh_point(
            triangles, nodes, root, closed, points[k, 0], points[k, 1], points[k, 2], np.inf, cull, stack
        )[0]
