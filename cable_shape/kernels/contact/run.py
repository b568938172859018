"""Contacts that run along the cable: on a body that is sharp across it, the node goes where the cable comes nearest.

At the nearest point the tangent t is along the surface, t . n = 0; the distance along the cable has the second
derivative t . H t + n . r''. A node moves with its rotation, which changes by the Darboux vector, and stretches the
element before it at the cost of the one behind.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import (
    BARE,
    CURVED,
    LINK,
    MATE,
    NONE,
    NORMAL,
    PRESS,
    RUB,
    SHARP,
    TILT,
    along_cable,
    is_knot,
    let_go,
    parting,
    tangent_of,
    turning,
)
from cable_shape.kernels.contact.tables import Lying
from cable_shape.kernels.rod_algebra import (
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

STILL = 1e-13  # of the length: shorter ways are not gone
FARTHEST = 0.3  # of the shorter neighbouring element, at a time
DIP = 1e-5  # m, four times as far as the cable may dip into a body between two contacts that stay two
NARROWEST = 0.12  # of both neighbouring elements: how short one of them may become


@kernel
def slide(
    lying: Lying, q: Array, near: Array, on: Array, masses: Array, least: float, merging: bool, square: bool
) -> float:
    """Moves the nodes of contacts that run to where the cable is nearest; returns the longest way gone [m].

    What `Lying.start` has for the nodes goes along. masses (p,) [m]: where nodes stay. merging: see `merge`. square:
    whether the pushes of those that have no room to go on to where they are near turn as far, near rest: what runs
    presses the cable square, see `knots.press_on`.
    """
    s, h, flex = lying.s, lying.h, lying.flex
    last = h.shape[0]
    longest = 0.0
    for k in range(1, last - 1):
        if merging and on[k, 0] != BARE and on[k + 1, 0] == on[k, 0]:
            merge(q, near, on, h, k, least, flex)
    for k in range(1, last):
        if on[k, 0] == BARE:
            continue
        put3(near, k, TILT, NONE)
        second = along_cable(q, h, near, on, k, least, flex)
        if second == 0.0:
            continue
        way = -dot(tangent_of(q, k), take3(near, k, NORMAL)) / second
        limit = FARTHEST * min(h[k - 1], h[k])
        gone = 0.0 if is_any(masses, s[k], 1e-9 * s[last]) else run_by(lying, q, near, k, way)
        longest = max(longest, abs(gone))
        if square and near[k, MATE] == 0.0 and abs(way) <= limit:  # what friction holds has it in what it rubs by
            put3(near, k, TILT, scale(way - gone, apply(get9(near, k, CURVED), tangent_of(q, k))))
    return longest


@kernel
def unturned(lying: Lying, q: Array, near: Array, on: Array, least: float) -> float:
    """Largest force along the cable [N] by which a contact that runs would press it once its push has turned.

    The steps of forces have it in them, whether `near.TILT` does or not. least: as for `slide`.
    """
    largest = 0.0
    for k in range(1, lying.h.shape[0]):
        if on[k, 0] != BARE and near[k, MATE] == 0.0:
            second = along_cable(q, lying.h, near, on, k, least, lying.flex)
            if second > 0.0:
                t = tangent_of(q, k)
                turned = apply(get9(near, k, CURVED), t)
                size = math.sqrt(dot(turned, turned)) / second
                largest = max(largest, near[k, PRESS] * abs(dot(t, take3(near, k, NORMAL))) * size)
    return largest


@kernel
def run_by(lying: Lying, q: Array, near: Array, k: int, way: float) -> float:
    """Moves node k along its cable by a way [m], or as much of it as there is room for; returns how far."""
    s, h, start = lying.s, lying.h, lying.start
    both, limit = h[k - 1] + h[k], FARTHEST * min(h[k - 1], h[k])
    way = min(max(way, -limit), limit)
    way = min(max(way, min(NARROWEST * both - h[k - 1], 0.0)), max(h[k] - NARROWEST * both, 0.0))
    if not abs(way) > STILL * s[s.shape[0] - 1]:
        return 0.0
    turn = qexp(scale(way, turning(q, h, near, k, lying.flex)))
    n = add(take3(near, k, NORMAL), scale(way, apply(get9(near, k, CURVED), tangent_of(q, k))))
    size = math.sqrt(dot(n, n))
    if size > 0.0:
        put3(near, k, NORMAL, scale(1.0 / size, n))
    q[k, 0], q[k, 1], q[k, 2], q[k, 3] = qnormal(qmul(get4(q, k), turn))
    start[k, 0], start[k, 1], start[k, 2], start[k, 3] = qmul(get4(start, k), turn)
    s[k] += way
    h[k - 1] = s[k] - s[k - 1]
    h[k] = s[k + 1] - s[k]
    return way


@kernel
def is_any(values: Array, x: float, within: float) -> bool:
    """Whether one of the values is next to x."""
    count = 0
    for value in values:
        count += abs(value - x) < within
    return count > 0


@kernel
def merge(q: Array, near: Array, on: Array, h: Array, k: int, least: float, flex: Array) -> None:
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
        put3(near, stays, RUB, add(take3(near, stays, RUB), take3(near, goes, RUB)))
        let_go(near, goes)
        on[goes, 0] = BARE


@kernel
def crowded(near: Array, on: Array, q: Array, h: Array, k: int, flex: Array) -> int:
    """Of a contact that runs, at node k: -1 or 1 if the element before or behind it has become too short, else 0."""
    if not is_knot(on, k):
        return 0
    both = h[k - 1] + h[k]
    if on[k, LINK] == BARE and along_cable(q, h, near, on, k, 0.0, flex) == 0.0:
        return 0
    if h[k - 1] < 2.0 * NARROWEST * both:
        return -1
    return 1 if h[k] < 2.0 * NARROWEST * both else 0


@kernel
def any_crowded(near: Array, on: Array, q: Array, h: Array, flex: Array) -> bool:
    """Whether any contact has come too close to a neighbouring node."""
    count = 0
    for k in range(1, h.shape[0]):
        if is_knot(on, k):
            count += abs(crowded(near, on, q, h, k, flex))
    return count > 0
