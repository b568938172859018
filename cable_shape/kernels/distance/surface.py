"""A body's surface near a point: signed distance, outward normal and the second derivative of the distance.

A point y touches the body with a cable of radius a where g(y) = distance - a = 0. Newton's method for contact needs
g, its gradient n and its Hessian H (the curvature of the surface through y). H n = 0, and H is known in closed form for
every feature on which the closest point can lie: on a face 0, on a straight edge of direction e
(I - n n^T - e e^T) / d, at a corner (I - n n^T) / d, on the side of a cylinder e_phi e_phi^T / rho.

Bodies are rows of the table of :mod:`cable_shape.kernels.distance.bounds`; frames (m, 4, 3) are their axes (rows) and
origins.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.bounds import into_body, place_body
from cable_shape.kernels.distance.distance import (
    BOX,
    CAPSULE,
    CYLINDER,
    HALF_SPACE,
    MESH,
    SPHERE,
    SPHERES,
    signed_distance,
)
from cable_shape.kernels.distance.spheres import FLAT, across, spheres_point
from cable_shape.kernels.distance.triangles import CORNER_A, FACE, mesh_feature, mesh_point
from cable_shape.kernels.rod_algebra import Matrix, Vector, mscale, mul, tmul

SHARPEST = 1e-4  # [m] radius below which an edge or a corner is not taken to be curved more


@kernel
def place_bodies(bodies: Array, links: Array, frames: Array) -> None:
    """Fills frames (m, 4, 3). links (k, 7): poses of the robot's links; bodies on a link beyond k are not placed."""
    for m in range(bodies.shape[0]):
        if int(bodies[m, 11]) < links.shape[0]:
            place_body(bodies[m, 4:11], links, int(bodies[m, 11]), frames[m])


@kernel(forceinline=True)
def less(H: Matrix, x: float, y: float, z: float, f: float) -> Matrix:
    """H - f e e^T for a unit vector e = (x, y, z)."""
    return (
        H[0] - f * x * x, H[1] - f * x * y, H[2] - f * x * z,
        H[3] - f * x * y, H[4] - f * y * y, H[5] - f * y * z,
        H[6] - f * x * z, H[7] - f * y * z, H[8] - f * z * z,
    )  # fmt: skip


@kernel(forceinline=True)
def over(distance: float) -> float:
    """1 / distance, signed and bounded."""
    return 1.0 / math.copysign(max(abs(distance), SHARPEST), distance)


@kernel
def hessian(
    kind: int, a: float, b: float, c: float, x: float, y: float, z: float, d: float, nx: float, ny: float, nz: float
) -> Matrix:
    """Second derivative of the signed distance d with gradient n to a convex, bounded solid, in the solid's frame."""
    if kind == SPHERE:
        return across(nx, ny, nz, over(d + a))
    if kind == CAPSULE:
        f = over(d + a)
        H = across(nx, ny, nz, f)
        return less(H, 0.0, 0.0, 1.0, f) if abs(z) <= b else H
    if kind == CYLINDER:
        rho = math.sqrt(x * x + y * y)
        if nx == 0.0 and ny == 0.0:
            return FLAT
        round_about = over(rho)
        ex, ey = (x / rho, y / rho) if rho > 0.0 else (1.0, 0.0)
        across_axis = nx * ex + ny * ey
        H = less(FLAT, -ey, ex, 0.0, -across_axis * round_about)
        if nz != 0.0:  # the rim: round in the plane of the axis, too
            H = less(H, -nz * ex, -nz * ey, across_axis, -over(d))
        return H
    beyond = 0
    if abs(x) > a:
        beyond += 1
    if abs(y) > b:
        beyond += 1
    if abs(z) > c:
        beyond += 1
    if beyond < 2:
        return FLAT
    f = over(d)
    H = across(nx, ny, nz, f)
    if beyond == 2:
        if abs(x) <= a:
            return less(H, 1.0, 0.0, 0.0, f)
        if abs(y) <= b:
            return less(H, 0.0, 1.0, 0.0, f)
        return less(H, 0.0, 0.0, 1.0, f)
    return H


@kernel
def inside_box(body: Array, x: float, y: float, z: float, mx: float, my: float, mz: float) -> tuple[float, Vector]:
    """Depth (negative) and normal at a point inside a box, below the face from which the cable came, of normal m."""
    ax, ay, az = abs(mx), abs(my), abs(mz)
    if ax >= ay and ax >= az:
        sign = math.copysign(1.0, mx)
        return sign * x - body[1], (sign, 0.0, 0.0)
    if ay >= az:
        sign = math.copysign(1.0, my)
        return sign * y - body[2], (0.0, sign, 0.0)
    sign = math.copysign(1.0, mz)
    return sign * z - body[3], (0.0, 0.0, sign)


@kernel
def mesh_surface(
    body: Array, triangles: Array, nodes: Array, x: float, y: float, z: float, stack: Array
) -> tuple[float, float, float, float, Matrix]:
    """Signed distance (open meshes: unsigned), normal and Hessian of a triangle mesh, in its own frame."""
    root, closed = int(body[13]), body[14] != 0.0
    d, nx, ny, nz, i, feature = mesh_feature(triangles, nodes, root, closed, x, y, z, np.inf, True, stack)
    tri = triangles[i]
    if feature == FACE:
        return d, nx, ny, nz, FLAT
    f = over(d)
    H = across(nx, ny, nz, f)
    if feature >= CORNER_A:
        return d, nx, ny, nz, H
    j, k = 3 * (feature - 1), 3 * (feature % 3)
    ex, ey, ez = tri[k] - tri[j], tri[k + 1] - tri[j + 1], tri[k + 2] - tri[j + 2]
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    return d, nx, ny, nz, less(H, ex / size, ey / size, ez / size, f)


@kernel
def touch(
    body: Array, frame: Array, triangles: Array, nodes: Array, at: Vector, side: Vector, curved: bool, stack: Array
) -> tuple[float, Vector, Matrix]:
    """Signed distance [m] of a point of the world, its gradient and, if `curved`, its Hessian [1/m] (else 0), world.

    side: the normal that this point of the cable had last, (0, 0, 0) if none. It decides where the nearest surface
    does not: on which side of an open mesh, and below which face of a box.
    """
    kind = int(body[0])
    x, y, z = into_body(frame, at[0], at[1], at[2])
    H = FLAT
    if kind == HALF_SPACE:
        return z, (frame[2, 0], frame[2, 1], frame[2, 2]), H
    remembered = side[0] != 0.0 or side[1] != 0.0 or side[2] != 0.0
    if kind == SPHERES:
        d, nx, ny, nz, H = spheres_point(body, triangles, nodes, x, y, z, curved, stack)
    elif kind == MESH:
        if curved:
            d, nx, ny, nz, H = mesh_surface(body, triangles, nodes, x, y, z, stack)
        else:
            d, nx, ny, nz = mesh_point(
                triangles, nodes, int(body[13]), body[14] != 0.0, x, y, z, np.inf, True, stack
            )  # fmt: skip
    else:
        d, nx, ny, nz = signed_distance(kind, body[1], body[2], body[3], x, y, z)
        if kind == BOX and d < 0.0 and remembered:
            mx = frame[0, 0] * side[0] + frame[0, 1] * side[1] + frame[0, 2] * side[2]
            my = frame[1, 0] * side[0] + frame[1, 1] * side[1] + frame[1, 2] * side[2]
            mz = frame[2, 0] * side[0] + frame[2, 1] * side[1] + frame[2, 2] * side[2]
            d, n = inside_box(body, x, y, z, mx, my, mz)
            nx, ny, nz = n
        if curved:
            H = hessian(kind, body[1], body[2], body[3], x, y, z, d, nx, ny, nz)
    n = from_body(frame, nx, ny, nz)
    if curved:
        H = turned(frame, H)
    if kind == MESH and body[14] == 0.0 and remembered and n[0] * side[0] + n[1] * side[1] + n[2] * side[2] < 0.0:
        return -d, (-n[0], -n[1], -n[2]), mscale(-1.0, H)
    return d, n, H


@kernel(forceinline=True)
def outward(body: Array, frame: Array, at: Vector) -> tuple[float, Vector]:
    """Signed distance [m] of a point of the world, and its gradient, world; not to meshes and spheres."""
    x, y, z = into_body(frame, at[0], at[1], at[2])
    d, nx, ny, nz = signed_distance(int(body[0]), body[1], body[2], body[3], x, y, z)
    return d, from_body(frame, nx, ny, nz)


@kernel(forceinline=True)
def from_body(frame: Array, x: float, y: float, z: float) -> Vector:
    """A direction in the body's frame in the world's."""
    return (
        frame[0, 0] * x + frame[1, 0] * y + frame[2, 0] * z,
        frame[0, 1] * x + frame[1, 1] * y + frame[2, 1] * z,
        frame[0, 2] * x + frame[1, 2] * y + frame[2, 2] * z,
    )


@kernel(forceinline=True)
def at_least(body: Array, frame: Array, at: Vector) -> float:
    """A bound [m] from below on the signed distance of a point of the world: that to the box around the body.

    It costs little; of spheres it is none, for they have a soft surface beyond their own.
    """
    kind = int(body[0])
    x, y, z = into_body(frame, at[0], at[1], at[2])
    if kind == HALF_SPACE:
        return z
    if kind == SPHERES:
        return -math.inf
    if kind == MESH:
        x, y, z = x - body[15], y - body[16], z - body[17]
    x, y, z = abs(x), abs(y), abs(z)
    if kind in (BOX, MESH):
        return max(x - body[1], y - body[2], z - body[3])
    end = body[2] if kind == CYLINDER else body[1] + body[2]
    return max(x - body[1], y - body[1], z - end)


@kernel
def turned(frame: Array, H: Matrix) -> Matrix:
    """F^T H F for the F whose rows are those of `frame`: from the body's frame to the world."""
    if H[0] == 0.0 and H[4] == 0.0 and H[8] == 0.0:
        return FLAT
    F = (
        frame[0, 0], frame[0, 1], frame[0, 2], frame[1, 0], frame[1, 1], frame[1, 2],
        frame[2, 0], frame[2, 1], frame[2, 2],
    )  # fmt: skip
    return tmul(F, mul(H, F))


@kernel
def reach_of(body: Array) -> float:
    """Half the least thickness of a body [m]: how far a point inside is from where it would leave on the other side."""
    kind = int(body[0])
    if kind == HALF_SPACE:
        return math.inf
    if kind in (SPHERE, CAPSULE):
        return body[1]
    if kind == SPHERES:
        return body[14]
    if kind == CYLINDER:
        return min(body[1], body[2])
    if kind == MESH:
        return min(body[14], body[1], body[2], body[3])
    return min(body[1], body[2], body[3])
