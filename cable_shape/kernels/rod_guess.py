"""Where Newton's method starts: a hanging or taut cable with bent ends, or a Bezier curve of the right length.

Both give tangents along the cable; frames are carried along without twist, and the roll that is then missing at the
end is spread evenly.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    Quaternion,
    Vector,
    add,
    cross,
    dot,
    get3,
    get4,
    inlined,
    put3,
    qconj,
    qexp,
    qmul,
    qnormal,
    scale,
    subtract,
)

SAMPLES = 64


@inlined
def tangent(q: Quaternion) -> Vector:
    """d3 of a frame."""
    x, y, z, w = q
    return (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))


@inlined
def norm(a: Vector) -> float:
    """|a|."""
    return math.sqrt(dot(a, a))


@inlined
def perpendicular(a: Vector) -> Vector:
    """Some unit vector at right angles to the unit vector a."""
    if abs(a[0]) < 0.6:
        b = cross(a, (1.0, 0.0, 0.0))
    else:
        b = cross(a, (0.0, 1.0, 0.0))
    return scale(1.0 / norm(b), b)


@inlined
def angle_axis(a: Vector, b: Vector) -> tuple[float, Vector]:
    """Angle and unit axis of the smallest turn from unit vector a to b."""
    c = cross(a, b)
    sine = norm(c)
    angle = math.atan2(sine, dot(a, b))
    if sine < 1e-9:
        return angle, perpendicular(a)
    return angle, scale(1.0 / sine, c)


@inlined
def turned(v: Vector, axis: Vector, angle: float) -> Vector:
    """v turned about a unit axis (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    return add(add(scale(c, v), scale(s, cross(axis, v))), scale((1.0 - c) * dot(axis, v), axis))


@kernel
def hanging_force(
    span: Array, load: Array, length: float, stretch: float, bend: float, t0: Vector, t1: Vector, held: Array,
    force: Array,
) -> float:  # fmt: skip
    """Internal force at the end of a hanging cable with bent ends into force (3,); returns its boundary layer [m].

    The catenary of horizontal force H is shorter than the cable by what its two bent ends take up: turning by theta
    takes 2 l (1 - cos(theta/2)), l = sqrt(EI / tension). H follows from the length. stretch: 1/EA; bend: EI;
    held (2,): 1 where the tangent is held; load (3,): mean load [N/m].
    """
    c = (span[0], span[1], span[2])
    f = (load[0], load[1], load[2])
    w = norm(f)
    down = scale(1.0 / w, f) if w > 0.0 else (0.0, 0.0, -1.0)
    drop = dot(c, down)
    across = subtract(c, scale(drop, down))
    d = norm(across)
    if d > 1e-9 * length:
        flat = scale(1.0 / d, across)
    else:
        # a hairpin opens along the grips' tangents
        flat = subtract(t0, scale(dot(t0, down), down))
        size = norm(flat)
        flat = scale(1.0 / size, flat) if size > 1e-6 else perpendicular(down)
    d = max(d, 1e-3 * length)
    stiff, heavy = bend / length**2, w * length
    low, high = math.log(1e-6 * stiff + 1e-4 * heavy), math.log(1e9 * stiff + 1e6 * heavy)
    n0 = n1 = 0.0
    first, last = down, down
    for _ in range(60):
        H = math.exp(0.5 * (low + high))
        if w * d > 1e-9 * H:
            x = min(0.5 * w * d / H, 300.0)
            reach = 2.0 * H / w * math.sinh(x)
            arc = math.sqrt(drop * drop + reach * reach)
            A = math.asinh(drop / reach)
            first = add(scale(H, flat), scale(H * math.sinh(A + x), down))
            last = add(scale(H, flat), scale(H * math.sinh(A - x), down))
        else:
            arc = math.sqrt(drop * drop + d * d)
            first = scale(H / d, add(scale(d, flat), scale(drop, down)))
            last = first
        n0, n1 = norm(first), norm(last)
        a0, _ = angle_axis(scale(1.0 / n0, first), t0)
        a1, _ = angle_axis(scale(1.0 / n1, last), t1)
        short = 2.0 * math.sqrt(bend / n0) * (1.0 - math.cos(0.5 * a0)) * held[0]
        short += 2.0 * math.sqrt(bend / n1) * (1.0 - math.cos(0.5 * a1)) * held[1]
        if arc + short > length * (1.0 + stretch * H):
            low = math.log(H)
        else:
            high = math.log(H)
        if high - low < 1e-3:
            break
    force[0], force[1], force[2] = last
    return math.sqrt(bend / max(n0, n1))


@kernel
def hanging_tangents(
    s: Array, load: Array, force: Array, bend: float, t0: Vector, t1: Vector, held: Array, t: Array
) -> None:  # fmt: skip
    """Tangents t (N+1, 3) of that cable: along its force, and at the ends the exact bent end of a taut rod."""
    nodes = s.shape[0]
    length = s[nodes - 1]
    f = (load[0], load[1], load[2])
    last = (force[0], force[1], force[2])
    first = add(last, scale(length, f))
    n0, n1 = norm(first), norm(last)
    a0, axis0 = angle_axis(scale(1.0 / n0, first), t0)
    a1, axis1 = angle_axis(scale(1.0 / n1, last), t1)
    l0, l1 = math.sqrt(bend / n0), math.sqrt(bend / n1)
    b0, b1 = math.tan(0.25 * a0) * held[0], math.tan(0.25 * a1) * held[1]
    for k in range(nodes):
        n = add(last, scale(length - s[k], f))
        v = scale(1.0 / max(norm(n), 1e-300), n)
        v = turned(v, axis0, 4.0 * math.atan(b0 * math.exp(-s[k] / l0)))
        v = turned(v, axis1, 4.0 * math.atan(b1 * math.exp(-(length - s[k]) / l1)))
        put3(t, k, 0, v)


@inlined
def bezier(p1: Vector, p2: Vector, p3: Vector, x: float) -> Vector:
    """Cubic Bezier curve that starts at the origin."""
    y = 1.0 - x
    return add(add(scale(3.0 * x * y * y, p1), scale(3.0 * x * x * y, p2)), scale(x * x * x, p3))


@kernel(late=types.none)
def bezier_tangents(s: Array, span: Array, t0: Vector, t1: Vector, sag: Vector, t: Array) -> None:
    """Tangents t (N+1, 3) of the Bezier curve whose handles have the length that makes it as long as the cable.

    Handles point along the end tangents, tilted towards `sag` (its size is the tilt).
    """
    nodes = s.shape[0]
    length = s[nodes - 1]
    c = (span[0], span[1], span[2])
    h0, h1 = add(t0, sag), subtract(t1, sag)
    low, high = 0.0, 4.0 * length
    arc = np.empty(SAMPLES + 1)
    for _ in range(24):
        a = 0.5 * (low + high)
        p1, p2 = scale(a, h0), subtract(c, scale(a, h1))
        last = (0.0, 0.0, 0.0)
        arc[0] = 0.0
        for i in range(1, SAMPLES + 1):
            p = bezier(p1, p2, c, i / SAMPLES)
            arc[i] = arc[i - 1] + norm(subtract(p, last))
            last = p
        if arc[SAMPLES] > length:
            high = a
        else:
            low = a
        if abs(arc[SAMPLES] - length) < 1e-3 * length:
            break
    p1, p2 = scale(a, h0), subtract(c, scale(a, h1))
    i = 1
    for k in range(nodes):
        target = s[k] / length * arc[SAMPLES]
        while i < SAMPLES and arc[i] < target:
            i += 1
        x = (i - 1 + (target - arc[i - 1]) / max(arc[i] - arc[i - 1], 1e-300)) / SAMPLES
        y = 1.0 - x
        v = add(
            add(scale(y * y, p1), scale(2.0 * x * y, subtract(p2, p1))),
            scale(x * x, subtract(c, p2)),
        )
        size = norm(v)
        if size > 1e-12 * length:
            put3(t, k, 0, scale(1.0 / size, v))
        else:
            put3(t, k, 0, get3(t, k - 1) if k > 0 else t0)


@kernel
def carry_frames(s: Array, t: Array, mask: Array, q: Array) -> None:
    """Node quaternions q (N+1, 4) along the tangents t; its first and last rows are given and kept where held.

    mask (2, 3): rotations held at the ends (0 held, 1 free). The sign of the last row decides the winding.
    """
    last = s.shape[0] - 1
    begin, end = get4(q, 0), get4(q, last)
    p = begin
    v = tangent(p)
    for k in range(last + 1):
        if k == 0 and mask[0, 0] == 0.0:
            continue
        to = get3(t, k) if k < last or mask[1, 0] != 0.0 else tangent(end)
        angle, axis = angle_axis(v, to)
        p = qnormal(qmul(qexp(scale(angle, axis)), p))
        v = to
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = p
    if mask[1, 2] != 0.0:
        return
    # what is missing at the end is a roll about d3; the sign of `end` tells a whole turn
    miss = qmul(qconj(p), end)
    roll = 2.0 * math.atan2(miss[2], miss[3])
    for k in range(last + 1):
        share = s[k] / s[last] if mask[0, 2] == 0.0 else 1.0
        p = qmul(get4(q, k), qexp((0.0, 0.0, roll * share)))
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = p
    if mask[1, 0] == 0.0:
        q[last, 0], q[last, 1], q[last, 2], q[last, 3] = end


@kernel
def natural_frames(h: Array, rest: Array, q: Array) -> None:
    """Node quaternions of the unloaded cable, from the first row on."""
    for e in range(h.shape[0]):
        p = qmul(get4(q, e), qexp((h[e] * rest[e, 0], h[e] * rest[e, 1], h[e] * rest[e, 2])))
        q[e + 1, 0], q[e + 1, 1], q[e + 1, 2], q[e + 1, 3] = qnormal(p)
