"""Cables that press on each other, or on themselves: pairs of knots, one on each, between which there is a push.

Two cables touch where they come nearest, without friction: D, the least distance of the centrelines around the knots a
and b, is at least the `reach` R, and the push p along n = (y_a - y_b) / |y_a - y_b| is its multiplier. With arc lengths
s_a, s_b counted from the knots, r = (n . t_a, -n . t_b) are the slopes of the distance and S its second derivatives
there. Both are eliminated, but for one that leads to the mouth of a grip or a clip, where the knot stays, and for that
of the first cable where the two lie along each other and S is singular (`STAYS`): pushes on knots in a row then stand
for one on all of the line. In z = (theta_a, y_a, theta_b, y_b) the energy - p D has the second derivative

    -p (D_zz - B^T S^-1 B),   B = D_sz,

and its gradient lacks p B^T S^-1 r, by which knots that are not yet at the nearest points turn and move; after the step
they run there, s = -S^-1 r. The push is a vertex of the network's graph, with the row  n . (dy_a - dy_b) = R - D.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels.contact.near import (
    ACTIVE,
    APART,
    BARE,
    LINK,
    LINKED,
    PUSH,
    SPOT,
    STEP,
    TOWARD,
    WAITS,
    tangent_of,
    turning,
)
from cable_shape.kernels.contact.run import NARROWEST
from cable_shape.kernels.contact.tables import Lying, Net
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.tables import (
    L_ACTIVE,
    L_BENT,
    L_NORMAL,
    L_REST,
    model_of,
    plan_of,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    dot,
    get3,
    get4,
    put3,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
)

REACH, CREEP = 0.6, 0.05  # of the distance to be kept, that two cables come nearer in one step, at most and at least
SOON = 0.9  # of that distance: a pair nearer than this does not wait
LEAST = 1e-3  # of the square of the second derivatives without bending: where less is left of them, bending is left out
# of the distance to be kept, and of the least way to the next node: a knot nearer to a grip or a clip goes no further
MOUTH, STOPS = 0.25, 1.1
STAYS = 2  # column of `Lying.pairs`, 1: the first knot stays where it is along its cable


@viewing
def find_pairs(lying: Lying, on: Array) -> None:
    """Fills the first two columns of `pairs` with the nodes of the links."""
    for k in range(on.shape[0]):
        if on[k, LINK] != BARE:
            lying.pairs[on[k, LINK] // 2, on[k, LINK] % 2] = k


@viewing
def look_at_links(lying: Lying, near: Array) -> None:
    """Distances and directions of the pairs where their knots are now."""
    for i in range(lying.pairs.shape[0]):
        a, b = lying.pairs[i, 0], lying.pairs[i, 1]
        aim(near, a, b, subtract(take3(near, a, SPOT), take3(near, b, SPOT)))


@viewing
def aim(near: Array, a: int, b: int, d: Vector) -> None:
    """Tells a pair that its second knot is d from its first one."""
    size = math.sqrt(dot(d, d))
    if size > 0.0:
        put3(near, a, TOWARD, scale(1.0 / size, d))
        put3(near, b, TOWARD, scale(-1.0 / size, d))
    near[a, APART] = near[b, APART] = size


@viewing
def change_links(lying: Lying, near: Array, on: Array, least: float, deepest: float) -> int:
    """Ends pushes that pull by more than `least` [N] and begins those of pairs that overlap by more than `deepest` [m].

    A pair that has just been let go waits a step. Returns how many have changed.
    """
    count = 0
    for i in range(lying.pairs.shape[0]):
        a, b = lying.pairs[i, 0], lying.pairs[i, 1]
        state = on[a, LINKED]
        if state == ACTIVE and near[a, PUSH] < -least:
            state = WAITS
        elif state == WAITS and near[a, APART] > SOON * lying.reach[i]:
            state = BARE
        elif state != ACTIVE and near[a, APART] < lying.reach[i] - deepest:
            state = ACTIVE
        if (state == ACTIVE) != (on[a, LINKED] == ACTIVE):
            near[a, PUSH] = near[b, PUSH] = 0.0
            count += 1
        on[a, LINKED] = on[b, LINKED] = state
    return count


@viewing
def slopes(lying: Lying, q: Array, near: Array, i: int) -> tuple[float, float, float, float, float]:
    """Slopes r of the distance along both cables at pair i, and the inverse of its second derivatives: 11, 12, 22."""
    a, b = lying.pairs[i, 0], lying.pairs[i, 1]
    n, ta, tb = take3(near, a, TOWARD), tangent_of(q, a), tangent_of(q, b)
    ra, rb = dot(n, ta), -dot(n, tb)
    f = 1.0 / max(near[a, APART], 0.1 * lying.reach[i])
    g11, g22, g12 = f * (1.0 - ra * ra), f * (1.0 - rb * rb), -f * (dot(ta, tb) + ra * rb)
    h11 = g11 + dot(n, bend_of(lying, q, near, a))
    h22 = g22 - dot(n, bend_of(lying, q, near, b))
    det = h11 * h22 - g12 * g12
    if not (h11 > 0.0 and det > LEAST * f * f):
        h11, h22 = g11, g22
        det = max(h11 * h22 - g12 * g12, LEAST * f * f)
    stop_a = lying.pairs[i, STAYS] != 0 or stopped(lying, a, g12 * rb - h22 * ra, lying.reach[i])
    stop_b = stopped(lying, b, g12 * ra - h11 * rb, lying.reach[i])
    if stop_a or stop_b:
        return (
            0.0 if stop_a else ra, 0.0 if stop_b else rb, 0.0 if stop_a else 1.0 / max(h11, LEAST * f), 0.0,
            0.0 if stop_b else 1.0 / max(h22, LEAST * f),
        )  # fmt: skip
    return ra, rb, h22 / det, -g12 / det, h11 / det


@viewing
def stopped(lying: Lying, k: int, way: float, reach: float) -> bool:
    """Whether node k, which would go that way along its cable, has come to the mouth of what holds it there."""
    j = k + 1 if way > 0.0 else k - 1
    apart = lying.h[k] if way > 0.0 else lying.h[k - 1]
    return bool(is_support(lying, j) and apart <= max(MOUTH * reach, STOPS * NARROWEST * (lying.h[k - 1] + lying.h[k])))


@viewing
def is_support(lying: Lying, k: int) -> bool:
    """Whether a node is a support."""
    count = 0
    for held in lying.held:
        count += held == k
    return count > 0


@viewing
def bend_of(lying: Lying, q: Array, near: Array, k: int) -> Vector:
    """Second derivative of the centreline at node k [1/m]."""
    u = turning(q, lying.h, near, k, lying.flex)
    return apply(rotation(get4(q, k)), (u[1], -u[0], 0.0))


@viewing
def tie_pairs(net: Net, lying: Lying, q: Array, near: Array, on: Array, factored: bool) -> float:
    """Tells the model how pairs press on each other; returns the largest gap [m] of those that do.

    factored: the factors at hand serve, and the model they are of stays.
    """
    plan, model, work = plan_of(net.ints), model_of(net.ints, net.floats), work_of(net.ints, net.space)
    links = model.links
    largest = 0.0
    for i in range(plan.links.shape[0]):
        a, b = lying.pairs[i, 0], lying.pairs[i, 1]
        n = take3(near, a, TOWARD)
        active = on[a, LINKED] == ACTIVE
        if not factored:
            put3(links, i, L_NORMAL, n)
            links[i, L_ACTIVE] = 1.0 if active else 0.0
            for c in range(L_NORMAL):
                links[i, c] = 0.0
        if not active:
            continue
        largest = max(largest, abs(near[a, APART] - lying.reach[i]))
        p = max(near[a, PUSH], 0.0)
        if p == 0.0:
            continue
        ra, rb, w11, w12, w22 = slopes(lying, q, near, i)
        fill_rows(links, i, q, n, near[a, APART], a, b)
        if not factored:
            fill_bent(links, i, n, near[a, APART], p, w11, w12, w22)
        sa, sb = p * (w11 * ra + w12 * rb), p * (w12 * ra + w22 * rb)
        for side in range(2):
            knot, o = plan.links[i, side], 6 * side
            node = plan.first[net.span[knot] + 1] + net.span[knot]
            add_to(work.G, node, scaled(links, i, o, sa, sb))
            add_to(work.pull, knot, scaled(links, i, o + 3, sa, sb))
    return largest


@viewing
def scaled(links: Array, i: int, o: int, sa: float, sb: float) -> Vector:
    """sa and sb times both rows B of link i, from column o on."""
    return add(scale(sa, take3(links, i, o)), scale(sb, take3(links, i, 12 + o)))


@viewing
def add_to(a: Array, i: int, v: Vector) -> None:
    """Adds a vector to row i."""
    put3(a, i, 0, add(get3(a, i), v))


@viewing
def fill_rows(links: Array, i: int, q: Array, n: Vector, size: float, a: int, b: int) -> None:
    """Both rows of B: derivatives of the slopes in (theta_a, y_a, theta_b, y_b)."""
    ta, tb = tangent_of(q, a), tangent_of(q, b)
    Na, Nb = tapply(rotation(get4(q, a)), n), tapply(rotation(get4(q, b)), n)
    pa = scale(1.0 / size, subtract(ta, scale(dot(n, ta), n)))
    pb = scale(1.0 / size, subtract(tb, scale(dot(n, tb), n)))
    put3(links, i, 0, (-Na[1], Na[0], 0.0))
    put3(links, i, 3, pa)
    put3(links, i, 6, (0.0, 0.0, 0.0))
    put3(links, i, 9, scale(-1.0, pa))
    put3(links, i, 12, (0.0, 0.0, 0.0))
    put3(links, i, 15, scale(-1.0, pb))
    put3(links, i, 18, (Nb[1], -Nb[0], 0.0))
    put3(links, i, 21, pb)


@viewing
def fill_bent(links: Array, i: int, n: Vector, size: float, p: float, w11: float, w12: float, w22: float) -> None:
    """-p (D_zz - B^T S^-1 B) as ten blocks."""
    at = L_BENT
    for x in range(4):
        for y in range(x, 4):
            sign = 0.0 if x % 2 == 0 or y % 2 == 0 else (1.0 if x == y else -1.0)
            for r in range(3):
                for c in range(3):
                    a, b = links[i, 3 * x + r], links[i, 12 + 3 * x + r]
                    own = sign * ((1.0 if r == c else 0.0) - n[r] * n[c]) / size
                    u, v = links[i, 3 * y + c], links[i, 12 + 3 * y + c]
                    links[i, at + 3 * r + c] = -p * (own - w11 * a * u - w12 * (a * v + b * u) - w22 * b * v)
            at += 9


@viewing
def close_in(net: Net, lying: Lying, near: Array, share: float) -> None:
    """Gives pairs the steps that close their gaps, or none: share 1 or 0."""
    links = model_of(net.ints, net.floats).links
    for i in range(links.shape[0]):
        links[i, L_REST] = share * (lying.reach[i] - near[lying.pairs[i, 0], APART])


@viewing
def pushed_apart(net: Net, near: Array, on: Array, k: int, fraction: float) -> float:
    """[N], the push of another cable on node k with a fraction of the step."""
    push = plan_of(net.ints).links[on[k, LINK] // 2, 2]
    return float(near[k, PUSH] + fraction * work_of(net.ints, net.space).gap[push, 0])


@viewing
def active_pairs(lying: Lying, on: Array) -> int:
    """How many pairs press on each other."""
    count = 0
    for i in range(lying.pairs.shape[0]):
        count += on[lying.pairs[i, 0], LINKED] == ACTIVE
    return count


@viewing
def any_overlaps(lying: Lying, near: Array, on: Array, deepest: float) -> bool:
    """Whether a pair that does not press on each other overlaps by more than `deepest` [m]."""
    count = 0
    for i in range(lying.pairs.shape[0]):
        a = lying.pairs[i, 0]
        count += on[a, LINKED] != ACTIVE and near[a, APART] < lying.reach[i] - deepest
    return count > 0


@viewing
def allowed_apart(lying: Lying, near: Array) -> float:
    """The fraction of the last step that brings no pair nearer than its gap and REACH, nor turns it round."""
    fraction = 1.0
    for i in range(lying.pairs.shape[0]):
        a, b = lying.pairs[i, 0], lying.pairs[i, 1]
        reach, size = lying.reach[i], near[a, APART]
        way = subtract(take3(near, a, STEP), take3(near, b, STEP))
        nearer, far = -dot(way, take3(near, a, TOWARD)), math.sqrt(dot(way, way))
        limit = max(size - (1.0 - REACH) * reach, CREEP * reach)
        if nearer > limit:
            fraction = min(fraction, limit / nearer)
        limit = max(size - reach, 0.0) + reach
        if far > limit:
            fraction = min(fraction, limit / far)
    return fraction


@viewing
def go_apart(net: Net, lying: Lying, near: Array, on: Array, fraction: float) -> None:
    """Takes a fraction of the step of pushes and directions."""
    for i in range(lying.pairs.shape[0]):
        a, b = lying.pairs[i, 0], lying.pairs[i, 1]
        if on[a, LINKED] == ACTIVE:
            near[a, PUSH] = near[b, PUSH] = pushed_apart(net, near, on, a, fraction)
        way = scale(fraction, subtract(take3(near, a, STEP), take3(near, b, STEP)))
        aim(near, a, b, add(scale(near[a, APART], take3(near, a, TOWARD)), way))
