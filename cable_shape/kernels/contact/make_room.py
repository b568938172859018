"""Knots of pairs run along their cables to where these are nearest, and a node that is in their way moves on.

A node of the mesh alone is pushed ahead. One at which a body presses is where the pair wants to be: a cable that lies
on a table under another one is pressed on from both sides in one place. What presses there goes to the knot, and the
node is free to move.
"""

from __future__ import annotations

from cable_shape.checks import Array
from cable_shape.kernels.contact.link import is_support, slopes
from cable_shape.kernels.contact.near import (
    ACTIVE,
    APART,
    BARE,
    CURVED,
    LINK,
    LINKED,
    MATE,
    NONE,
    NORMAL,
    PRESS,
    ROUND,
    RUB,
    SECOND,
    is_knot,
    let_go,
    sharpness,
)
from cable_shape.kernels.contact.run import NARROWEST, run_by
from cable_shape.kernels.contact.tables import Lying
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.rod_algebra import add, get9, put3, put9, take3

MOST_SLIDE = 2.0  # of the distance to be kept, that a pair runs at a time
# of its way that a knot has before it, and of the least that it may have: where there is less the next node moves
ROOM, ROOMY = 3.0, 1.5
MERGED = 0.25  # radii: a contact nearer to the knot of a pair that goes its way is one with it


@viewing
def slide_pairs(lying: Lying, q: Array, near: Array, on: Array) -> tuple[float, float]:
    """Moves the knots of pairs to where their cables are nearest; returns the longest way [m], and that which matters.

    It is the way that there was to go of those that press on each other, of others what they have gone. It does not
    matter of those that will not overlap there, either.
    """
    longest = matters = 0.0
    for i in range(lying.pairs.shape[0]):
        ra, rb, w11, w12, w22 = slopes(lying, q, near, i)
        limit, apart = MOST_SLIDE * lying.reach[i], near[lying.pairs[i, 0], APART]
        active = on[lying.pairs[i, 0], LINKED] == ACTIVE
        own = 0.0
        for side in range(2):
            k = lying.pairs[i, side]
            way = -(w11 * ra + w12 * rb) if side == 0 else -(w12 * ra + w22 * rb)
            apart += 0.5 * way * (ra if side == 0 else rb)
            way = min(max(way, -limit), limit)
            if active:
                own = max(own, abs(way), make_room(lying, q, near, on, k, way))
            own = max(own, abs(run_by(lying, q, near, k, way)))
        longest = max(longest, own)
        if active or apart < lying.reach[i]:
            matters = max(matters, own)
    return longest, matters


@viewing
def make_room(lying: Lying, q: Array, near: Array, on: Array, k: int, way: float) -> float:
    """Moves the node that is in the way of node k, if it is nothing but one of the mesh; returns how far [m].

    What a body that is flat along the cable presses on there goes to node k.
    """
    step = 1 if way > 0.0 else -1
    both, ahead = lying.h[k - 1] + lying.h[k], lying.h[k] if way > 0.0 else lying.h[k - 1]
    if ahead > max(ROOM * abs(way), ROOMY * NARROWEST * both):
        return 0.0
    stuck = ahead < ROOMY * NARROWEST * both
    j = k + step
    flat = sharpness(q, near, j) * lying.thick[j] < ROUND
    if (stuck or ahead < MERGED * lying.thick[k]) and flat and may_take(near, on, k, j):
        take_on(near, on, k, j)
    if is_knot(on, j) or is_support(lying, j):
        return 0.0
    return abs(run_by(lying, q, near, j, step * max(ROOM * abs(way), NARROWEST * both)))


@viewing
def may_take(near: Array, on: Array, k: int, j: int) -> bool:
    """Whether one body, and no cable, presses on node j, without friction, and on node k no other one."""
    alone = on[j, 0] != BARE and on[j, SECOND] == BARE and on[j, LINK] == BARE and near[j, MATE] == 0.0
    return bool(alone and on[k, SECOND] == BARE and (on[k, 0] == BARE or on[k, 0] == on[j, 0]))


@viewing
def take_on(near: Array, on: Array, k: int, j: int) -> None:
    """Has node k carry what a body presses on node j."""
    if on[k, 0] == BARE:
        on[k, 0] = on[k, 1] = on[j, 0]
        near[k, PRESS] = 0.0
        put3(near, k, RUB, NONE)
        put3(near, k, NORMAL, take3(near, j, NORMAL))
        put9(near, k, CURVED, get9(near, j, CURVED))
    near[k, PRESS] += near[j, PRESS]
    put3(near, k, RUB, add(take3(near, k, RUB), take3(near, j, RUB)))
    on[j, 0] = BARE
    near[j, PRESS] = 0.0
    let_go(near, j)
