"""Closest points of a cable to many bodies, ruling out by bounds what cannot be the closest.

The cable is a row of capsules around the pieces of its centreline. A signed distance changes by at most the way gone,
which gives all bounds: for a sphere around the whole cable, for spheres around chunks of it, and for one piece of
length h between points at distances d_i and d_j, nowhere nearer than (d_i + d_j - h) / 2. The distance to a convex
body is convex along a piece besides, so that the tangents at its two ends bound it more closely.

A row of the table of bodies (20,): kind | sizes a, b, c | pose: position, quaternion x y z w, in the world or in the
link | row of the link, -1 for the world | 1 if left out near the grips | mesh: first node, 0 if open, 1 if closed or
half its least thickness [m] | mesh: centre of its box, of which the sizes are the half edges | two of spheres.
Of spheres, see `spheres`: first node, radius [m] | centre of their box | D [m], 0: exact | how far they are apart [m].
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.distance import (
    HALF_SPACE,
    MESH,
    SPHERES,
    box_distance,
    least_between,
    nearest_on_segment,
    signed_distance,
)
from cable_shape.kernels.distance.spheres import spheres_point, spheres_segment
from cable_shape.kernels.distance.triangles import (
    SLACK,
    STACK_SIZE,
    Indices,
    mesh_point,
    mesh_segment,
    nearest_on_triangle,
)

BODY_COLUMNS = 20
RESULT_COLUMNS = 8  # distance (infinite: beyond the horizon), arc length, point on cable (3), point on body (3)
CHUNK = 8  # pieces of the cable in one bounding sphere

OK, NOT_FINITE = 0, 1


@kernel
def closest_points(
    positions: Array,
    arc_length: Array,
    radius: float,
    horizon: float,
    exclusion: float,
    cull: bool,
    bodies: Array,
    links: Array,
    triangles: Array,
    nodes: Array,
    result: Array,
    counts: Indices,
) -> int:
    """Fills `result` (bodies, 8) and `counts` (pairs culled, pairs solved); returns OK, or NOT_FINITE for NaN input.

    positions (n, 3) [m] and arc_length (n,) [m] of the centreline; `links` (k, 7) poses of the links, with k = 0
    bodies on links are left out; `exclusion` [m] is the arc length at either end where bodies so marked are left out;
    `cull` False solves every pair.
    """
    pieces = positions.shape[0] - 1
    chunks = (pieces + CHUNK - 1) // CHUNK
    spheres = np.empty((chunks + 1, 4))
    for k in range(chunks):
        _sphere(positions[k * CHUNK : min((k + 1) * CHUNK, pieces) + 1], spheres[k])
    _sphere(positions, spheres[chunks])
    counts[:] = 0
    if not math.isfinite(spheres[chunks, 3]):
        return NOT_FINITE
    frame = np.empty((4, 3))  # axes of the body in the world as rows, then its origin
    bounds = np.empty(chunks)
    stack = np.empty(STACK_SIZE, np.int64)
    local = np.empty((CHUNK + 1, 7))  # points in the body's frame, signed distance, gradient
    for m in range(bodies.shape[0]):
        body = bodies[m]
        result[m, 0] = np.inf
        link = int(body[11])
        if link >= links.shape[0]:
            continue
        place_body(body[4:11], links, link, frame)
        low, high = -np.inf, np.inf
        if body[12] != 0.0:
            low, high = arc_length[0] + exclusion, arc_length[pieces] - exclusion
        if body[0] == HALF_SPACE:
            _closest_to_plane(positions, arc_length, low, high, radius, horizon + radius, frame, result[m], counts)
            continue
        _closest_to_body(
            positions, arc_length, low, high, radius, horizon + radius, cull, body, frame, triangles, nodes,
            spheres, bounds, local, stack, result[m], counts,
        )  # fmt: skip
    return OK


@kernel
def _closest_to_plane(
    positions: Array,
    arc_length: Array,
    low: float,
    high: float,
    radius: float,
    reach: float,
    frame: Array,
    result: Array,
    counts: Indices,
) -> None:
    """As `_closest_to_body`, for a half-space: the height above it is linear along a piece, and least at an end."""
    x, y, z = frame[2, 0], frame[2, 1], frame[2, 2]
    origin = frame[3, 0] * x + frame[3, 1] * y + frame[3, 2] * z
    best, best_piece, best_t = reach, -1, 0.0
    for i in range(positions.shape[0] - 1):
        if arc_length[i] >= high or arc_length[i + 1] <= low:
            continue
        counts[1] += 1
        p = positions[i, 0] * x + positions[i, 1] * y + positions[i, 2] * z - origin
        q = positions[i + 1, 0] * x + positions[i + 1, 1] * y + positions[i + 1, 2] * z - origin
        if min(p, q) >= best:
            continue
        step_length = arc_length[i + 1] - arc_length[i]
        t0 = max((low - arc_length[i]) / step_length, 0.0)
        t1 = min((high - arc_length[i]) / step_length, 1.0)
        t = t0 if p <= q else t1
        if p + t * (q - p) < best:
            best, best_piece, best_t = p + t * (q - p), i, t
    if best_piece < 0:
        return
    i = best_piece
    result[0] = best - radius
    result[1] = arc_length[i] + best_t * (arc_length[i + 1] - arc_length[i])
    for a in range(3):
        centre = positions[i, a] + best_t * (positions[i + 1, a] - positions[i, a])
        result[2 + a] = centre - radius * frame[2, a]
        result[5 + a] = centre - best * frame[2, a]


@kernel
def _closest_to_body(
    positions: Array,
    arc_length: Array,
    low: float,
    high: float,
    radius: float,
    reach: float,
    cull: bool,
    body: Array,
    frame: Array,
    triangles: Array,
    nodes: Array,
    spheres: Array,
    bounds: Array,
    local: Array,
    stack: Indices,
    result: Array,
    counts: Indices,
) -> None:
    """The closest point of the cable between the arc lengths low and high; `reach` [m] bounds the centreline's."""
    pieces = positions.shape[0] - 1
    chunks = spheres.shape[0] - 1
    kind = int(body[0])
    mesh = kind >= MESH
    total = pieces
    if low > arc_length[0] or high < arc_length[pieces]:
        total = 0
        for i in range(pieces):
            if arc_length[i] < high and arc_length[i + 1] > low:
                total += 1
    solved = 0
    best, best_piece, best_t = reach, -1, 0.0
    bx, by, bz = 0.0, 0.0, 0.0  # outward normal there
    known = reach  # the cable comes at least this near
    nearest = 0
    if cull:
        if _bound(body, frame, spheres[chunks]) > reach + SLACK:
            counts[0] += total
            return
        for k in range(chunks):
            bounds[k] = _bound(body, frame, spheres[k])
            if bounds[k] < bounds[nearest]:
                nearest = k
    for step in range(chunks):
        k = nearest if step == 0 else (step - 1 if step <= nearest else step)  # the most promising first
        first, last = k * CHUNK, min((k + 1) * CHUNK, pieces)
        if cull and (bounds[k] > known + SLACK or arc_length[first] >= high or arc_length[last] <= low):
            continue
        if cull and mesh:
            x, y, z = into_body(frame, spheres[k, 0], spheres[k, 1], spheres[k, 2])
            away, _, _, _ = box_distance(body[1], body[2], body[3], x - body[15], y - body[16], z - body[17])
            enough = known + spheres[k, 3] if away > 0.0 else np.inf  # inside its box it may be deep in a mesh
            d, _, _, _ = tree_point(body, triangles, nodes, x, y, z, enough, cull, stack)
            if d - spheres[k, 3] > known + SLACK:
                continue
        # distances of the chunk's points, in the body's frame
        for i in range(first, last + 1):
            p = local[i - first]
            p[0], p[1], p[2] = into_body(frame, positions[i, 0], positions[i, 1], positions[i, 2])
            if not mesh:
                p[3], p[4], p[5], p[6] = signed_distance(kind, body[1], body[2], body[3], p[0], p[1], p[2])
        if mesh:
            within = np.inf
            for i in range(last - first + 1):
                p = local[i]
                p[3], p[4], p[5], p[6] = tree_point(body, triangles, nodes, p[0], p[1], p[2], within, cull, stack)
                within = abs(p[3]) + _length(p, local[i + 1]) if i < last - first else within
        for i in range(first, last + 1):
            if low <= arc_length[i] <= high:
                known = min(known, local[i - first, 3])
        for i in range(first, last):
            if arc_length[i] >= high or arc_length[i + 1] <= low:
                continue
            p, q = local[i - first], local[i + 1 - first]
            step_length = arc_length[i + 1] - arc_length[i]
            t0 = max((low - arc_length[i]) / step_length, 0.0)
            t1 = min((high - arc_length[i]) / step_length, 1.0)
            if cull and least_on_piece(body, p, q) > known + SLACK:
                continue
            solved += 1
            if mesh:
                t, d, nx, ny, nz = on_mesh(body, triangles, nodes, p, q, t0, t1, known, cull, stack)
            else:
                t, d, nx, ny, nz = on_solid(body, p, q, t0, t1)
            if d < best or (d == best and (best_piece < 0 or i < best_piece)):
                best, best_piece, best_t = d, i, t
                bx, by, bz = nx, ny, nz
                known = min(known, best)
    counts[0] += total - solved
    counts[1] += solved
    if best_piece < 0:
        return
    i = best_piece
    result[0] = best - radius
    result[1] = arc_length[i] + best_t * (arc_length[i + 1] - arc_length[i])
    for a in range(3):
        out = frame[0, a] * bx + frame[1, a] * by + frame[2, a] * bz
        centre = positions[i, a] + best_t * (positions[i + 1, a] - positions[i, a])
        result[2 + a] = centre - radius * out
        result[5 + a] = centre - best * out


@kernel
def on_solid(body: Array, p: Array, q: Array, t0: float, t1: float) -> tuple[float, float, float, float, float]:
    """The least signed distance to a convex solid between t0 and t1 from p to q: (t, distance, outward normal)."""
    kind = int(body[0])
    dx, dy, dz = (t1 - t0) * (q[0] - p[0]), (t1 - t0) * (q[1] - p[1]), (t1 - t0) * (q[2] - p[2])
    x, y, z = p[0] + t0 * (q[0] - p[0]), p[1] + t0 * (q[1] - p[1]), p[2] + t0 * (q[2] - p[2])
    t = nearest_on_segment(kind, body[1], body[2], body[3], x, y, z, dx, dy, dz)
    d, nx, ny, nz = signed_distance(kind, body[1], body[2], body[3], x + t * dx, y + t * dy, z + t * dz)
    return t0 + t * (t1 - t0), d, nx, ny, nz


@kernel
def tree_point(
    body: Array, triangles: Array, nodes: Array, x: float, y: float, z: float, reach: float, cull: bool, stack: Indices
) -> tuple[float, float, float, float]:
    """As `mesh_point`, for a mesh or spheres; reach [m] bounds the distance to a mesh, infinite beyond."""
    if body[0] == SPHERES:
        d, nx, ny, nz, _ = spheres_point(body, triangles, nodes, x, y, z, False, stack)
        return d, nx, ny, nz
    return mesh_point(triangles, nodes, int(body[13]), body[14] != 0.0, x, y, z, reach, cull, stack)


@kernel
def on_mesh(
    body: Array,
    triangles: Array,
    nodes: Array,
    p: Array,
    q: Array,
    t0: float,
    t1: float,
    reach: float,
    cull: bool,
    stack: Indices,
) -> tuple[float, float, float, float, float]:
    """As `on_solid`, for a mesh or spheres; inside a closed one at the ends only.

    An infinite distance: beyond `reach` [m].
    """
    root = int(body[13])
    dx, dy, dz = (t1 - t0) * (q[0] - p[0]), (t1 - t0) * (q[1] - p[1]), (t1 - t0) * (q[2] - p[2])
    x, y, z = p[0] + t0 * (q[0] - p[0]), p[1] + t0 * (q[1] - p[1]), p[2] + t0 * (q[2] - p[2])
    d, nx, ny, nz = p[3], p[4], p[5], p[6]
    if t0 > 0.0:
        d, nx, ny, nz = tree_point(body, triangles, nodes, x, y, z, np.inf, cull, stack)
    e, ex, ey, ez = q[3], q[4], q[5], q[6]
    if t1 < 1.0:
        e, ex, ey, ez = tree_point(body, triangles, nodes, x + dx, y + dy, z + dz, np.inf, cull, stack)
    if body[0] == SPHERES:
        t, _ = spheres_segment(triangles, nodes, root, x, y, z, dx, dy, dz, np.inf, cull, stack)
        f, fx, fy, fz = tree_point(body, triangles, nodes, x + t * dx, y + t * dy, z + t * dz, np.inf, cull, stack)
        if f <= d and f <= e:
            return t0 + t * (t1 - t0), f, fx, fy, fz
        return (t0, d, nx, ny, nz) if d <= e else (t1, e, ex, ey, ez)
    if d < 0.0 or e < 0.0:
        if d <= e:
            return t0, d, nx, ny, nz
        return t1, e, ex, ey, ez
    t, d, i = mesh_segment(triangles, nodes, root, x, y, z, dx, dy, dz, min(d, e, reach), cull, stack)
    if i < 0:
        return t1, np.inf, nx, ny, nz
    s = t0 + t * (t1 - t0)
    x, y, z = x + t * dx, y + t * dy, z + t * dz
    qx, qy, qz, _ = nearest_on_triangle(triangles[i], x, y, z)
    if d <= SLACK:  # through the surface: only the triangle says where out is
        return s, 0.0, triangles[i, 9], triangles[i, 10], triangles[i, 11]
    return s, d, (x - qx) / d, (y - qy) / d, (z - qz) / d


@kernel(forceinline=True)
def least_on_piece(body: Array, p: Array, q: Array) -> float:
    """A lower bound on the signed distance between two points, from the distances and gradients there."""
    if body[0] >= MESH:
        return 0.5 * (p[3] + q[3] - _length(p, q))
    dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    p_slope, q_slope = p[4] * dx + p[5] * dy + p[6] * dz, q[4] * dx + q[5] * dy + q[6] * dz
    return least_between(1.0, p[3], p_slope, q[3], q_slope)


@kernel(forceinline=True)
def _bound(body: Array, frame: Array, sphere: Array) -> float:
    """A lower bound on the signed distance anywhere in a sphere (centre, radius); a mesh is inside its box."""
    x, y, z = into_body(frame, sphere[0], sphere[1], sphere[2])
    if body[0] >= MESH:
        d, _, _, _ = box_distance(body[1], body[2], body[3], x - body[15], y - body[16], z - body[17])
    else:
        d, _, _, _ = signed_distance(int(body[0]), body[1], body[2], body[3], x, y, z)
    return d - sphere[3]


@kernel(forceinline=True)
def _sphere(points: Array, sphere: Array) -> None:
    """A sphere (centre, radius) around `points`: about the middle of their box; its radius is NaN if they are."""
    for a in range(3):
        low = high = points[0, a]
        for i in range(1, points.shape[0]):
            low, high = min(low, points[i, a]), max(high, points[i, a])
        sphere[a] = 0.5 * (low + high)
    square, spoilt = 0.0, 0.0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0] - sphere[0], points[i, 1] - sphere[1], points[i, 2] - sphere[2]
        away = x * x + y * y + z * z
        square = max(square, away)
        spoilt += 0.0 * away  # NaN once a coordinate is NaN or infinite
    sphere[3] = math.sqrt(square) + spoilt


@kernel
def place_body(pose: Array, links: Array, link: int, frame: Array) -> None:
    """Fills `frame` with the axes (rows) and the origin of a body whose pose is given in the world or in a link."""
    _axes(pose[3], pose[4], pose[5], pose[6], frame)
    frame[3, 0], frame[3, 1], frame[3, 2] = pose[0], pose[1], pose[2]
    if link < 0:
        return
    outer = np.empty((4, 3))
    at = links[link]
    _axes(at[3], at[4], at[5], at[6], outer)
    for row in range(4):
        x, y, z = frame[row, 0], frame[row, 1], frame[row, 2]
        for a in range(3):
            frame[row, a] = x * outer[0, a] + y * outer[1, a] + z * outer[2, a]
    for a in range(3):
        frame[3, a] += at[a]


@kernel(forceinline=True)
def _axes(x: float, y: float, z: float, w: float, frame: Array) -> None:
    """The turned axes of a unit quaternion as rows."""
    frame[0, 0], frame[0, 1], frame[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    frame[1, 0], frame[1, 1], frame[1, 2] = 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)
    frame[2, 0], frame[2, 1], frame[2, 2] = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


@kernel(forceinline=True)
def into_body(frame: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point of the world in the body's frame."""
    x, y, z = x - frame[3, 0], y - frame[3, 1], z - frame[3, 2]
    return (
        frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z,
        frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z,
        frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z,
    )


@kernel(forceinline=True)
def _length(p: Array, q: Array) -> float:
    x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    return math.sqrt(x * x + y * y + z * z)
