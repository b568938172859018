"""Which planes the loads and the section of a cable allow; see :mod:`cable_shape.kernels.planar_drive`."""

from __future__ import annotations

import math
from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import Vector, dot, get3, scale, subtract

Array = Any
#: rad, and of the length: what is further from a plane is not in it.
FLAT = 1e-10
#: Numbers in `plane`: 0 whether there may be a plane, 1 to 3 and 4 to 6 unit vectors that span the loads, world, 7 to 9
#: the direction of the rest curvature, cable frame; zero where there is none.
PLANE = 10


@kernel
def beyond(vectors: Array, largest: Vector, a: Vector, b: Vector) -> Vector:
    """`largest`, or the vector (k, 3) that has most beyond the unit vectors a and b, as far as it is beyond them."""
    for k in range(vectors.shape[0]):
        v = get3(vectors, k)
        v = subtract(v, scale(dot(a, v), a))
        v = subtract(v, scale(dot(b, v), b))
        if dot(v, v) > dot(largest, largest):
            largest = v
    return largest


@kernel
def allow_plane(load: Array, points: Array, tip: Array, rest: Array, plane: Array) -> None:
    """Fills plane (PLANE,) for loads (2, 3), (k, 3) and (1, 3), world, and rest curvature (n, 3), cable frame."""
    plane[:] = 0.0
    none = (0.0, 0.0, 0.0)
    a = b = none
    whole = 0.0
    for count in range(3):
        v = beyond(tip, beyond(points, beyond(load, none, a, b), a, b), a, b)
        size = math.sqrt(dot(v, v))
        if count == 0:
            whole = size
        if size <= FLAT * whole:
            break
        if count == 2:
            return
        v = scale(1.0 / size, v)
        a, b = (v, none) if count == 0 else (a, v)
    c = beyond(rest, none, none, none)
    size = math.sqrt(dot(c, c))
    if size > 0.0:
        c = scale(1.0 / size, c)
        off = beyond(rest, none, c, none)
        if math.sqrt(dot(off, off)) > FLAT * size or abs(c[2]) > FLAT:
            return
    plane[0] = 1.0
    for i in range(3):
        plane[1 + i], plane[4 + i], plane[7 + i] = a[i], b[i], c[i]
