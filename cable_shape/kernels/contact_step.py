"""A step of Newton's method for a rod in contact: right-hand sides, and where the step takes the nodes."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact_near import GAP, NORMAL, PRESS, SPOT, STEP, along_cable, tangent_of
from cable_shape.kernels.rod_algebra import (
    add,
    apply,
    dot,
    get3,
    get4,
    get9,
    put3,
    qconj,
    qmul,
    scale,
    subtract,
    take3,
    tapply,
)
from cable_shape.kernels.span_factor import FORCE
from cable_shape.kernels.span_slide import carried
from cable_shape.kernels.span_system import release


@kernel
def gaps(
    near: Array, where: Array, base: Array, spans: int, places: Array, sums: Array, pull: Array, given: Array
) -> float:
    """Right-hand sides of the supports: closures, forces along the surfaces, gaps. Returns the largest gap [m]."""
    largest = 0.0
    for j in range(spans):
        k = where[j + 1]
        i = base[j + 1]
        put3(pull, j + 1, 0, (0.0, 0.0, 0.0))
        put3(given, j + 1, 0, (0.0, 0.0, 0.0))
        if i >= 0:
            put3(sums, j, 0, subtract(get3(places, i), take3(near, k, SPOT)))
        else:
            put3(sums, j, 0, (0.0, 0.0, 0.0))
            put3(given, j + 1, 0, scale(-near[k, GAP], take3(near, k, NORMAL)))
            largest = max(largest, abs(near[k, GAP]))
    return largest


@kernel
def moves(
    parts: Array, d: Array, joints: Array, where: Array, base: Array, spans: int, slope: Array, way: Array, near: Array
) -> None:  # fmt: skip
    """Change of the nodes' places under the step, and the steps `way` of eyelets, to first order."""
    elements = parts.shape[0]
    r = (0.0, 0.0, 0.0)
    put3(near, where[0], STEP, r)
    for j in range(spans):
        if base[j] >= 0:
            r = (0.0, 0.0, 0.0)
        dl = take3(joints, j, FORCE)
        for e in range(where[j], where[j + 1]):
            t = add(
                add(tapply(get9(parts, e, 9), get3(d, e)), tapply(get9(parts, e, 18), get3(d, e + 1))),
                apply(get9(parts, e, 27), dl),
            )
            r = subtract(r, t)
            put3(near, e + 1, STEP, r)
    if way.shape[0] == 0:
        return
    for j in range(spans):
        if base[j] >= 0:
            r = (0.0, 0.0, 0.0)
        for e in range(where[j], where[j + 1]):
            r = subtract(r, carried(slope, way, e, 0, elements))
            put3(near, e + 1, STEP, add(take3(near, e + 1, STEP), r))


@kernel
def run_on(
    q: Array,
    h: Array,
    near: Array,
    on: Array,
    k: int,
    least: float,
    flex: float,
    place: Array,
    j: int,
    G: Array,
    pull: Array,
) -> None:
    """Adds to the right-hand sides what a contact that runs gains by running on from node k to the nearest point."""
    second = along_cable(q, h, near, on, k, least, flex)
    if second == 0.0 or near[k, PRESS] <= 0.0:
        return
    f = math.sqrt(near[k, PRESS] / second) * dot(tangent_of(q, k), take3(near, k, NORMAL))
    put3(G, k, 0, add(get3(G, k), scale(f, take3(place, j, 25))))
    put3(pull, j, 0, add(get3(pull, j), scale(f, take3(place, j, 28))))


@kernel
def hold_back(q: Array, start: Array, h: Array, drag: float, where: Array, mask: Array, G: Array) -> None:
    """Adds to the gradient what drags the rotations back to `start`: drag [N] times angle and length."""
    last = h.shape[0]
    for k in range(last + 1):
        size = 0.5 * ((h[k - 1] if k > 0 else 0.0) + (h[k] if k < last else 0.0))
        turn = qmul(qconj(get4(start, k)), get4(q, k))
        f = math.copysign(2.0 * drag * size, turn[3])
        put3(G, k, 0, add(get3(G, k), (f * turn[0], f * turn[1], f * turn[2])))
    release(G, where, mask)


@kernel
def eyelets_at(base: Array, spans: int, rings: Array, at: Array) -> None:
    """at (k,): which supports the held supports `rings` are."""
    for j in range(spans + 1):
        for c in range(rings.shape[0]):
            if base[j] == rings[c]:
                at[c] = j
