"""Signed distance of a point and of a segment to convex solids, in the solid's own frame.

The signed distance to a convex solid is a convex function of the place, so along a segment it has one minimum: in
closed form for spheres, capsules and half-spaces; for boxes and cylinders it is closed in on between tangents.
Inside the solid it is minus the distance to the surface.

Sizes (a, b, c) of a kind: box: half edges; sphere: radius, 0, 0; cylinder and capsule: radius, half length, 0;
half-space (z <= 0 solid): unused.
"""

from __future__ import annotations

import math

from cable_shape.kernels._jit import kernel

BOX, SPHERE, CYLINDER, CAPSULE, HALF_SPACE, MESH, SPHERES = 0, 1, 2, 3, 4, 5, 6  # from MESH on those with a tree

#: [m] The search ends when the least distance is known to within this, after some 5 steps; every third step halves
#: the bracket, so that 150 steps reach the rounding of float64 in the worst case.
TOLERANCE = 1e-14
MAX_STEPS = 150


@kernel(forceinline=True)
def signed_distance(
    kind: int, a: float, b: float, c: float, x: float, y: float, z: float
) -> tuple[float, float, float, float]:
    """Signed distance [m] of the point (x, y, z) and its gradient, the outward unit normal: (d, nx, ny, nz)."""
    if kind == BOX:
        return box_distance(a, b, c, x, y, z)
    if kind == CYLINDER:
        return cylinder_distance(a, b, x, y, z)
    if kind == HALF_SPACE:
        return z, 0.0, 0.0, 1.0
    rest = z - min(max(z, -b), b)  # 0 beside the straight part
    length = math.sqrt(x * x + y * y + rest * rest)
    if length == 0.0:
        return -a, 1.0, 0.0, 0.0
    return length - a, x / length, y / length, rest / length


@kernel(forceinline=True)
def box_distance(a: float, b: float, c: float, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """As `signed_distance`, for a box of half edges a, b, c."""
    sx, sy, sz = math.copysign(1.0, x), math.copysign(1.0, y), math.copysign(1.0, z)
    qx, qy, qz = abs(x) - a, abs(y) - b, abs(z) - c
    if qx <= 0.0 and qy <= 0.0 and qz <= 0.0:
        if qx >= qy and qx >= qz:
            return qx, sx, 0.0, 0.0
        if qy >= qz:
            return qy, 0.0, sy, 0.0
        return qz, 0.0, 0.0, sz
    qx, qy, qz = max(qx, 0.0), max(qy, 0.0), max(qz, 0.0)
    d = math.sqrt(qx * qx + qy * qy + qz * qz)
    return d, sx * qx / d, sy * qy / d, sz * qz / d


@kernel(forceinline=True)
def cylinder_distance(radius: float, half: float, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """As `signed_distance`, for a cylinder with flat ends."""
    rho = math.sqrt(x * x + y * y)
    ex, ey = 1.0, 0.0
    if rho > 0.0:
        ex, ey = x / rho, y / rho
    sz = math.copysign(1.0, z)
    qr, qz = rho - radius, abs(z) - half
    if qr > 0.0 and qz > 0.0:
        d = math.sqrt(qr * qr + qz * qz)
        return d, ex * qr / d, ey * qr / d, sz * qz / d
    if qr > qz:
        return qr, ex, ey, 0.0
    return qz, 0.0, 0.0, sz


@kernel
def nearest_on_segment(
    kind: int, a: float, b: float, c: float, px: float, py: float, pz: float, dx: float, dy: float, dz: float
) -> float:
    """The t in [0, 1] at which p + t d has the least signed distance to the solid."""
    if kind == HALF_SPACE:
        return 0.0 if dz >= 0.0 else 1.0
    if kind in (SPHERE, CAPSULE):
        return _nearest_to_axis(b, px, py, pz, dx, dy, dz)
    low, high = 0.0, 1.0
    f_low, nx, ny, nz = signed_distance(kind, a, b, c, px, py, pz)
    s_low = nx * dx + ny * dy + nz * dz
    if s_low >= 0.0:
        return 0.0
    f_high, nx, ny, nz = signed_distance(kind, a, b, c, px + dx, py + dy, pz + dz)
    s_high = nx * dx + ny * dy + nz * dz
    if s_high <= 0.0:
        return 1.0
    for i in range(MAX_STEPS):
        if min(f_low, f_high) - least_between(high - low, f_low, s_low, f_high, s_high) <= TOLERANCE:
            break
        if i % 3 == 0:  # where the slope would vanish if it were linear: quick where the distance is smooth
            t = low - s_low * (high - low) / (s_high - s_low)
        elif i % 3 == 1:  # where the tangents meet: exact at a crease
            t = low + (f_high - f_low - s_high * (high - low)) / (s_low - s_high)
        else:
            t = 0.5 * (low + high)
        t = min(max(t, low), high)
        f, nx, ny, nz = signed_distance(kind, a, b, c, px + t * dx, py + t * dy, pz + t * dz)
        slope = nx * dx + ny * dy + nz * dz
        if slope < 0.0:
            low, f_low, s_low = t, f, slope
        else:
            high, f_high, s_high = t, f, slope
    return low if f_low <= f_high else high


@kernel(forceinline=True)
def least_between(length: float, f_low: float, s_low: float, f_high: float, s_high: float) -> float:
    """A lower bound on a convex function between two points `length` apart, from its values and slopes there."""
    if s_low >= 0.0:
        return f_low
    if s_high <= 0.0:
        return f_high
    return f_low + s_low * (f_high - f_low - s_high * length) / (s_low - s_high)


@kernel
def _nearest_to_axis(half: float, px: float, py: float, pz: float, dx: float, dy: float, dz: float) -> float:
    """The t in [0, 1] at which p + t d is nearest to the straight piece |z| <= half of the z axis.

    The squared distance is convex and piecewise quadratic with joints at z = +-half; the piece beside the axis is
    tried first, in coordinates across the axis, so that nearly parallel directions lose no digits.
    """
    across = dx * dx + dy * dy
    square = across + dz * dz
    if square == 0.0:
        return 0.0
    if across > 0.0:
        t = -(px * dx + py * dy) / across
        end = pz + t * dz
        if abs(end) <= half:
            return min(max(t, 0.0), 1.0)
        end = math.copysign(half, end)
    else:  # parallel: the whole overlap is nearest, take its first point
        end = min(max(pz, -half), half)
    t = -(px * dx + py * dy + (pz - end) * dz) / square
    return min(max(t, 0.0), 1.0)
