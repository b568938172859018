"""Changes of the set of contacts: which end, which begin, which a clip forestalls."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import (
    BARE,
    CLOSED,
    CURVED,
    ENDED,
    GAP,
    NORMAL,
    PRESS,
    SECOND,
    SECOND_CURVED,
    SECOND_GAP,
    SECOND_NORMAL,
    SECOND_PRESS,
    STEP,
    THIRD,
    THIRD_NORMAL,
    THIRD_PRESS,
    let_go,
)
from cable_shape.kernels.rod_algebra import cross, dot, get9, put3, put9, take3


@kernel
def drop(near: Array, on: Array, s: Array, least: float, one: bool) -> int:
    """Ends contacts that pull by more than `least` [N], all or the worst; returns how many.

    What they pulled by goes to the contacts beside them, see `hand_on`.
    """
    count = 0
    for k in range(near.shape[0]):
        if on[k, SECOND] == BARE:
            continue
        worst = min(near[k, PRESS], near[k, SECOND_PRESS], near[k, THIRD_PRESS])
        if worst < -least:
            if near[k, PRESS] == worst:
                on[k, 0] = on[k, 1] = on[k, SECOND]
                near[k, PRESS], near[k, GAP] = near[k, SECOND_PRESS], near[k, SECOND_GAP]
                put3(near, k, NORMAL, take3(near, k, SECOND_NORMAL))
                put9(near, k, CURVED, get9(near, k, SECOND_CURVED))
            if on[k, THIRD] == BARE or near[k, THIRD_PRESS] > worst:  # what is told of a third body is the second's
                on[k, SECOND], near[k, SECOND_PRESS] = on[k, THIRD], near[k, THIRD_PRESS]
                put3(near, k, SECOND_NORMAL, take3(near, k, THIRD_NORMAL))
            on[k, THIRD], near[k, THIRD_PRESS] = BARE, 0.0
            count += 1
    if count > 0 and one:
        return count
    worst, at = -least, -1
    for k in range(near.shape[0]):
        if on[k, 0] != BARE and near[k, PRESS] < worst:
            if one:
                worst, at = near[k, PRESS], k
            else:
                on[k, 0] = BARE
                near[k, ENDED] = 1.0
                let_go(near, k)
                count += 1
    if at >= 0:
        on[at, 0] = BARE
        near[at, ENDED] = 1.0
        let_go(near, at)
        count += 1
    if count > 0:
        hand_on(near, on, s)
    return count


@kernel
def hand_on(near: Array, on: Array, s: Array) -> None:
    """Gives forces at nodes that touch nothing to the contacts before and behind, by the law of the lever.

    The force that the cable carries on either side, and with it the legs' shape, stays as it is; but none of them pulls
    thereby.
    """
    before = -1
    for k in range(near.shape[0]):
        if k > 0 and s[k] < s[k - 1]:  # another cable
            before = -1
        force = near[k, PRESS]
        if on[k, 0] != BARE:
            before = k
        elif force != 0.0:
            behind = k + 1
            while behind < near.shape[0] and on[behind, 0] == BARE and s[behind] > s[behind - 1]:
                behind += 1
            near[k, PRESS] = 0.0
            if behind < near.shape[0] and on[behind, 0] != BARE and s[behind] > s[k]:
                share = (s[k] - s[before]) / (s[behind] - s[before]) if before >= 0 else 1.0
                near[behind, PRESS] = max(near[behind, PRESS] + share * force, 0.0)
                force -= share * force
            if before >= 0:
                near[before, PRESS] = max(near[before, PRESS] + force, 0.0)


@kernel
def misplaced(near: Array, on: Array) -> float:
    """How far contacts are off their bodies at most [m]: by as much the places of other nodes may be wrong, too.

    Where rotations and forces are not yet in balance, errors add up along the cable.
    """
    largest = 0.0
    for k in range(near.shape[0]):
        if on[k, 0] != BARE and on[k, 0] == on[k, 1]:
            largest = max(largest, abs(near[k, GAP]))
    return largest


@kernel
def meet(near: Array, on: Array, deepest: float) -> int:
    """Makes corners of the contacts that are deeper in another body than `deepest` [m]; returns how many.

    What there is of the first body has to be looked for again. A third body holds a node only if it does not press in
    the plane of both others: else one of these lets go.
    """
    count = 0
    for k in range(1, near.shape[0] - 1):
        if on[k, 0] == BARE or on[k, 1] == BARE or on[k, 1] == on[k, 0]:
            continue
        if on[k, SECOND] != BARE and on[k, THIRD] == BARE and near[k, GAP] < -deepest:
            first, o = take3(near, k, STEP), take3(near, k, NORMAL)  # see `look`
            if abs(dot(o, cross(first, take3(near, k, SECOND_NORMAL)))) > CLOSED:
                on[k, THIRD], on[k, 1] = on[k, 1], on[k, 0]
                put3(near, k, THIRD_NORMAL, o)
                near[k, THIRD_PRESS] = 0.0
                count += 1
        elif on[k, SECOND] == BARE:
            if near[k, GAP] < -deepest:
                on[k, SECOND] = on[k, 1]
                put3(near, k, SECOND_NORMAL, take3(near, k, NORMAL))
                near[k, SECOND_PRESS] = 0.0
                count += 1
            on[k, 1] = on[k, 0]
    return count


@kernel
def grow(near: Array, on: Array, deepest: float, off: float, one: bool) -> int:
    """Makes contacts of the nodes deeper in a body than `deepest` [m], all or the deepest; returns how many.

    off [m]: how wrong places may be. A node less deep than this is added only between two contacts. One where a contact
    has just ended is still where it was, and waits for the step. The first and the last node are held, or a free end,
    and are none.
    """
    count = 0
    worst, at = -deepest, -1
    for k in range(1, near.shape[0] - 1):
        if near[k, ENDED] != 0.0:
            near[k, ENDED] = 0.0
            continue
        if on[k, 1] == BARE or on[k, 0] == on[k, 1]:
            continue
        between = on[k - 1, 0] == on[k, 1] and on[k + 1, 0] == on[k, 1]
        if near[k, GAP] < worst and (between or near[k, GAP] < -off):
            if one:
                worst, at = near[k, GAP], k
            else:
                on[k, 0] = on[k, 1]
                near[k, PRESS] = 0.0
                let_go(near, k)
                count += 1
    if at >= 0:
        on[at, 0] = on[at, 1]
        near[at, PRESS] = 0.0
        let_go(near, at)
        count = 1
    return count


@kernel
def spare_clips(near: Array, on: Array, held: Array) -> None:
    """Takes the held supports out of what `look` has found: what holds a node says where it is."""
    for i in range(held.shape[0]):
        on[held[i], :] = BARE
        near[held[i], PRESS] = 0.0
        let_go(near, held[i])
        near[held[i], GAP] = math.inf
