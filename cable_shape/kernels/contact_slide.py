"""Contacts that run along the cable: on a body that is sharp across it, the node goes where the cable comes nearest.

At the nearest point the tangent t is along the surface, t . n = 0; the distance along the cable has the second
derivative t . H t + n . r''. A node moves with its rotation, which changes by the Darboux vector, and stretches the
element before it at the cost of the one behind.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact_near import (
    BARE,
    CURVED,
    NORMAL,
    PRESS,
    SHARP,
    along_cable,
    parting,
    tangent_of,
    turning,
)
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    dot,
    get4,
    get9,
    put3,
    qexp,
    qmul,
    qnormal,
    scale,
    take3,
)
from cable_shape.kernels.rod_mesh import element_rest

STILL = 1e-13  # of the length: shorter ways are not gone
FARTHEST = 0.3  # of the shorter neighbouring element, at a time
DIP = 1e-5  # m, four times as far as the cable may dip into a body between two contacts that stay two
NARROWEST = 0.12  # of both neighbouring elements: how short one of them may become


@kernel
def along(ends: Array, length: float, a: float, b: float) -> Vector:
    """Integral from a to b of a load that is linear between `ends` (2, 3) [N/m]."""
    f, m = b - a, 0.5 * (a + b) / length
    return (
        f * (ends[0, 0] + (ends[1, 0] - ends[0, 0]) * m),
        f * (ends[0, 1] + (ends[1, 1] - ends[0, 1]) * m),
        f * (ends[0, 2] + (ends[1, 2] - ends[0, 2]) * m),
    )


@kernel
def slide(
    q: Array,
    start: Array,
    near: Array,
    on: Array,
    s: Array,
    h: Array,
    load: Array,
    rest: Array,
    ends: Array,
    table: Array,
    least: float,
    flex: float,
) -> float:
    """Moves the nodes of contacts that run to where the cable is nearest; returns the longest way gone [m].

    start (N+1, 4): other rotations of the nodes, which go along. flex [1/(N m^2)]: 1 / EI.
    """
    last = h.shape[0]
    longest = 0.0
    for k in range(1, last - 1):
        if on[k, 0] != BARE and on[k + 1, 0] == on[k, 0]:
            merge(q, near, on, h, k, least, flex)
    for k in range(1, last):
        if on[k, 0] == BARE:
            continue
        second = along_cable(q, h, near, on, k, least, flex)
        both = h[k - 1] + h[k]
        if second == 0.0:
            continue
        if load[k - 1, 6] != load[k, 0] or load[k - 1, 7] != load[k, 1] or load[k - 1, 8] != load[k, 2]:
            continue  # a mass sits there
        u = turning(q, h, near, k, flex)
        way = -dot(tangent_of(q, k), take3(near, k, NORMAL)) / second
        limit = FARTHEST * min(h[k - 1], h[k])
        way = min(max(way, -limit), limit)
        way = min(max(way, min(NARROWEST * both - h[k - 1], 0.0)), max(h[k] - NARROWEST * both, 0.0))
        if not abs(way) > STILL * s[last]:
            continue
        longest = max(longest, abs(way))
        n = add(take3(near, k, NORMAL), scale(way, apply(get9(near, k, CURVED), tangent_of(q, k))))
        put3(near, k, NORMAL, scale(1.0 / math.sqrt(dot(n, n)), n))
        turn = qexp(scale(way, u))
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = qnormal(qmul(get4(q, k), turn))
        start[k, 0], start[k, 1], start[k, 2], start[k, 3] = qmul(get4(start, k), turn)
        s[k] += way
        h[k - 1] = s[k] - s[k - 1]
        h[k] = s[k + 1] - s[k]
        length = s[last]
        middle, right = 0.5 * (s[k] + s[k + 1]), take3(load, k, 6)
        put3(load, k, 3, add(right, along(ends, length, middle, s[k + 1])))
        put3(load, k, 0, add(right, along(ends, length, s[k], s[k + 1])))
        put3(load, k - 1, 6, take3(load, k, 0))
        middle, right = 0.5 * (s[k - 1] + s[k]), take3(load, k, 0)
        put3(load, k - 1, 3, add(right, along(ends, length, middle, s[k])))
    if longest > 0.0 and table.shape[0] > 1:
        element_rest(s, table, rest)
    return longest


@kernel
def merge(q: Array, near: Array, on: Array, h: Array, k: int, least: float, flex: float) -> None:
    """Makes one of the contacts at nodes k and k + 1 if the cable dips into the body between them."""
    down, up = dot(tangent_of(q, k), take3(near, k, NORMAL)), dot(tangent_of(q, k + 1), take3(near, k + 1, NORMAL))
    if not down < 0.0 < up or min(-down, up) * h[k] <= DIP:
        return
    first, second = parting(q, h, near, k, flex), parting(q, h, near, k + 1, flex)
    alone = on[k - 1, 0] == BARE and on[k + 2, 0] == BARE
    sharp = first[1] * (h[k - 1] + h[k]) > SHARP and second[1] * (h[k] + h[k + 1]) > SHARP
    if first[0] >= least and second[0] >= least and (alone or sharp):
        stays, goes = (k, k + 1) if near[k, PRESS] >= near[k + 1, PRESS] else (k + 1, k)
        near[stays, PRESS] += near[goes, PRESS]
        near[goes, PRESS] = 0.0
        on[goes, 0] = BARE


@kernel
def crowded(near: Array, on: Array, q: Array, h: Array, k: int, flex: float) -> int:
    """Of a contact that runs, at node k: -1 or 1 if the element before or behind it has become too short, else 0."""
    if on[k, 0] == BARE:
        return 0
    both = h[k - 1] + h[k]
    if along_cable(q, h, near, on, k, 0.0, flex) == 0.0:
        return 0
    if h[k - 1] < 2.0 * NARROWEST * both:
        return -1
    return 1 if h[k] < 2.0 * NARROWEST * both else 0


@kernel
def any_crowded(near: Array, on: Array, q: Array, h: Array, flex: float) -> bool:
    """Whether any contact has come too close to a neighbouring node."""
    count = 0
    for k in range(1, h.shape[0]):
        if on[k, 0] != BARE:
            count += abs(crowded(near, on, q, h, k, flex))
    return count > 0
