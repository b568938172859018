"""Distance of a point and of a segment to many spheres of one radius, through a tree of bounding boxes.

The centres are in the first three columns of the table of triangles, the tree is that of
:mod:`cable_shape.kernels.distance.triangles`. There are two surfaces. That of the spheres is exact: the distance of
the nearest centre less the radius. In its dents a cable would catch that lies on spheres close together, so contact
has another one (body[18] > 0), that of the soft least of all distances d_i to the centres,

    d = h - radius,   h = t log(2 pi t (h + t) / s^2) - t log(sum exp(-d_i / t)),   t = 0.49 s^2 / D,

with s how far centres are apart (body[19]) and D how far from them the centre of a cable is that touches (body[18]).
The weights of a square lattice, seen from D, are nearly a normal distribution of width 0.7 s, and what is left of the
lattice in their sum is about exp(-2 (0.7 pi)^2) = 6e-5. The first logarithm is that sum of a plane at the distance h:
of a plane, d is exact.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.triangles import SLACK, Indices, push_children, segment_to_box, to_box
from cable_shape.kernels.rod_algebra import Matrix

FLAT = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
WIDTH = 0.7  # of the spacing, of the weights
LIFTS = 8  # times that the lift is found again, each of which leaves t / (d + t) of what it is off
CUT = 14.0  # weights below exp(-CUT) are left out
NEAR = 4.0  # of D: further away the spheres are what they are
DULLEST = 1e-4  # [m] a sphere's distance from its centre is taken to be no smaller for its curvature


@kernel
def nearest_centre(points: Array, nodes: Array, root: int, x: float, y: float, z: float, stack: Indices) -> int:
    """The centre that is nearest to (x, y, z); of those as near the first."""
    best, found, limit = np.inf, -1, np.inf
    stack[0] = root
    depth = 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if to_box(nodes, node, x, y, z) > limit:
            continue
        first, number = int(nodes[node, 6]), int(nodes[node, 7])
        if number == 0:
            depth = push_children(nodes, node, x, y, z, stack, depth)
            continue
        for i in range(first, first + number):
            square = (x - points[i, 0]) ** 2 + (y - points[i, 1]) ** 2 + (z - points[i, 2]) ** 2
            if square < best or (square == best and i < found):
                best, found = square, i
                limit = (math.sqrt(best) + SLACK) ** 2
    return found


@kernel
def spheres_point(
    body: Array, points: Array, nodes: Array, x: float, y: float, z: float, curved: bool, stack: Indices
) -> tuple[float, float, float, float, Matrix]:
    """Signed distance of a point to spheres, its gradient's direction and, if `curved`, its Hessian (else 0)."""
    i = nearest_centre(points, nodes, int(body[13]), x, y, z, stack)
    ux, uy, uz = x - points[i, 0], y - points[i, 1], z - points[i, 2]
    least = math.sqrt(ux * ux + uy * uy + uz * uz)
    if least == 0.0:
        return -body[14], 0.0, 0.0, 1.0, FLAT
    ux, uy, uz = ux / least, uy / least, uz / least
    if body[18] == 0.0 or least > NEAR * body[18]:
        H = across(ux, uy, uz, 1.0 / max(least, DULLEST)) if curved else FLAT
        return least - body[14], ux, uy, uz, H
    return _soft(body, points, nodes, x, y, z, least, curved, stack)


@kernel
def _soft(
    body: Array, points: Array, nodes: Array, x: float, y: float, z: float, least: float, curved: bool, stack: Indices
) -> tuple[float, float, float, float, Matrix]:
    """The same of the soft least distance; least [m]: distance of the nearest centre."""
    t = WIDTH * WIDTH * body[19] * body[19] / body[18]
    reach = least + CUT * t
    total = gx = gy = gz = 0.0
    xx = yy = zz = xy = xz = yz = even = 0.0  # of the sums of w u u^T f, and of w / d
    ex = ey = ez = fx = fy = fz = 0.0  # the same of w u u^T / d
    stack[0] = int(body[13])
    depth = 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if to_box(nodes, node, x, y, z) > reach * reach:
            continue
        first, number = int(nodes[node, 6]), int(nodes[node, 7])
        if number == 0:
            stack[depth], stack[depth + 1] = first, first + 1
            depth += 2
            continue
        for i in range(first, first + number):
            ux, uy, uz = x - points[i, 0], y - points[i, 1], z - points[i, 2]
            d = math.sqrt(ux * ux + uy * uy + uz * uz)
            if d > reach:
                continue
            w, f = math.exp((least - d) / t), 1.0 / d
            ux, uy, uz = ux * f, uy * f, uz * f
            total += w
            gx, gy, gz = gx + w * ux, gy + w * uy, gz + w * uz
            if curved:
                xx, yy, zz = xx + w * ux * ux, yy + w * uy * uy, zz + w * uz * uz
                xy, xz, yz = xy + w * ux * uy, xz + w * ux * uz, yz + w * uy * uz
                w *= f
                even += w
                ex, ey, ez = ex + w * ux * ux, ey + w * uy * uy, ez + w * uz * uz
                fx, fy, fz = fx + w * uy * uz, fy + w * ux * uz, fz + w * ux * uy
    gx, gy, gz = gx / total, gy / total, gz / total
    size = math.sqrt(gx * gx + gy * gy + gz * gz)
    raw = least - t * math.log(total)
    d = raw
    for _ in range(LIFTS):
        d = raw + t * math.log(max(2.0 * math.pi * t * (max(d, 0.0) + t) / (body[19] * body[19]), 1.0))
    d -= body[14]
    if size == 0.0:  # in the middle of them
        return d, 0.0, 0.0, 1.0, FLAT
    nx, ny, nz = gx / size, gy / size, gz / size
    if not curved:
        return d, nx, ny, nz, FLAT
    c, s = 1.0 / t, 1.0 / total
    hxx = s * (even - ex - c * xx) + c * gx * gx
    hyy = s * (even - ey - c * yy) + c * gy * gy
    hzz = s * (even - ez - c * zz) + c * gz * gz
    hxy = -s * (fz + c * xy) + c * gx * gy
    hxz = -s * (fy + c * xz) + c * gx * gz
    hyz = -s * (fx + c * yz) + c * gy * gz
    return d, nx, ny, nz, _along(nx, ny, nz, hxx, hyy, hzz, hxy, hxz, hyz, 1.0 / size)


@kernel(forceinline=True)
def across(nx: float, ny: float, nz: float, f: float) -> Matrix:
    """f (I - n n^T)."""
    return (
        f * (1.0 - nx * nx), -f * nx * ny, -f * nx * nz,
        -f * nx * ny, f * (1.0 - ny * ny), -f * ny * nz,
        -f * nx * nz, -f * ny * nz, f * (1.0 - nz * nz),
    )  # fmt: skip


@kernel(forceinline=True)
def _along(
    nx: float, ny: float, nz: float, hxx: float, hyy: float, hzz: float, hxy: float, hxz: float, hyz: float, f: float
) -> Matrix:
    """f P H P with P = I - n n^T and H symmetric."""
    vx, vy, vz = hxx * nx + hxy * ny + hxz * nz, hxy * nx + hyy * ny + hyz * nz, hxz * nx + hyz * ny + hzz * nz
    q = vx * nx + vy * ny + vz * nz
    xx, yy, zz = hxx - 2.0 * vx * nx + q * nx * nx, hyy - 2.0 * vy * ny + q * ny * ny, hzz - 2.0 * vz * nz + q * nz * nz
    xy = hxy - vx * ny - vy * nx + q * nx * ny
    xz = hxz - vx * nz - vz * nx + q * nx * nz
    yz = hyz - vy * nz - vz * ny + q * ny * nz
    return (f * xx, f * xy, f * xz, f * xy, f * yy, f * yz, f * xz, f * yz, f * zz)


@kernel
def spheres_segment(
    points: Array, nodes: Array, root: int, px: float, py: float, pz: float, dx: float, dy: float, dz: float,
    reach: float, cull: bool, stack: Indices,
) -> tuple[float, float]:  # fmt: skip
    """The t in [0, 1] at which p + t d comes nearest to a centre, and that distance; infinite: none within `reach`."""
    best, best_t, limit = np.inf, 0.0, reach + SLACK
    long = dx * dx + dy * dy + dz * dz
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
            x, y, z = points[i, 0] - px, points[i, 1] - py, points[i, 2] - pz
            t = min(max((x * dx + y * dy + z * dz) / long, 0.0), 1.0) if long > 0.0 else 0.0
            square = (x - t * dx) ** 2 + (y - t * dy) ** 2 + (z - t * dz) ** 2
            if square < best:
                best, best_t = square, t
                limit = min(limit, math.sqrt(best) + SLACK)
    return best_t, math.sqrt(best)
