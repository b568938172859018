"""What friction between cables adds to Newton's system: forces, their derivative, and what of that is not symmetric.

With the limits given, C^T K C of `pair_friction` stands in the block of each link, beside what the push adds. Limits
follow the pushes, and t turns with the normal: that is solved for with the answers of the symmetric matrix, see
`solve_coupled`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.link import add_to, slopes
from cable_shape.kernels.contact.near import ACTIVE, APART, LINKED, NONE, PUSH, STEP, TOWARD, tangent_of
from cable_shape.kernels.contact.pair_friction import (
    DRAWN,
    FIRM,
    MORE,
    NEXT,
    PULLED,
    SLIPS,
    STICKS,
    WAY,
    decide,
    law,
    limit_pairs,
    nearest,
    radius,
    roughness,
)
from cable_shape.kernels.contact.tables import Lying, Net
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.graph import solve
from cable_shape.kernels.network.tables import L_BENT, TRIAL, model_of, plan_of, work_of
from cable_shape.kernels.rod_algebra import (
    Matrix,
    Vector,
    add,
    apply,
    cross,
    dot,
    get3,
    get4,
    get9,
    hat,
    madd,
    mscale,
    msub,
    mul,
    outer,
    put3,
    put9,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
    tmul,
)
from cable_shape.kernels.rod_element import IDENTITY

#: Up to so many pairs are solved for along with their pushes, where they slip; limits of more follow these.
COUPLED = 8
#: Least pivot: nearer to none, pairs lock, and limits follow the pushes, too.
LOCKED = 0.05


@viewing
def hold_pairs(
    net: Net, lying: Lying, q: Array, near: Array, on: Array, share: float, faint: float, length: float, part: float,
    factored: bool, step: float, decided: bool,
) -> tuple[int, float, float]:  # fmt: skip
    """Adds friction to what `link.tie_pairs` has told the model and to the pulls on both knots.

    step: the last one [rad]; decided: what sticks and what slips has been, with these shapes. Returns as
    `friction.pull_along` does.
    """
    rubs = lying.rubs[TRIAL]
    part, miss, largest = limit_pairs(lying, near, on, part)
    flips = 0
    for i in range(rubs.shape[0]):
        a = lying.pairs[i, 0]
        if on[a, LINKED] != ACTIVE:
            put3(rubs, i, PULLED, NONE)
            continue
        if not decided:
            flips += decide(lying, q, near, i, share, faint, length, step)
        off = subtract(take3(rubs, i, PULLED), take3(rubs, i, WAY))
        miss = max(miss, math.sqrt(dot(off, off)))
        t, K, _ = law(lying, q, near, i, share, faint, length)
        size = math.sqrt(dot(t, t))
        drawn = rubs[i, SLIPS] != 0.0 and rubs[i, STICKS] <= 0.0 and part > 1.0 and size > 0.0
        put3(rubs, i, DRAWN, scale(1.0 / size, t) if drawn else NONE)
        pull_both(net, lying, q, near, i, t)
        if not factored:
            add_rigid(net, lying, q, near, i, K)
    return flips, miss / largest if largest > 0.0 else 0.0, part


@viewing
def pull_both(net: Net, lying: Lying, q: Array, near: Array, i: int, t: Vector) -> None:
    """Adds to the gradient what pulls the first cable of pair i by t [N], and the second one by -t."""
    plan, work = plan_of(net.ints), work_of(net.ints, net.space)
    n, _ = nearest(lying, q, near, i)
    turn = cross(n, t)
    for side in range(2):
        knot, k = plan.links[i, side], lying.pairs[i, side]
        node = plan.first[net.span[knot] + 1] + net.span[knot]
        add_to(work.G, node, scale(radius(lying, i, side), tapply(rotation(get4(q, k)), turn)))
        add_to(work.pull, knot, t if side == 1 else scale(-1.0, t))


@viewing
def step_of_push(net: Net, lying: Lying, q: Array, near: Array, i: int) -> tuple[float, float]:
    """[N], of pair i; and by how much the push grows besides, as their normal turns towards what they pull.

    The system knows no turn of t, which is that of a push by delta n . t: the normal turns by that of the way from knot
    to knot after both have run to the nearest points.
    """
    work, plan, links = work_of(net.ints, net.space), plan_of(net.ints), model_of(net.ints, net.floats).links
    own, a, b = plan.links[i], lying.pairs[i, 0], lying.pairs[i, 1]
    push = float(work.gap[own[2], 0])
    t, (n, _) = take3(lying.rubs[TRIAL], i, PULLED), nearest(lying, q, near, i)
    if t == NONE or not near[a, PUSH] > 0.0:
        return push, 0.0
    turns = 0.0, 0.0
    for side in range(2):
        turn, way = take3(work.move, own[side], 0), take3(work.move, own[side], 3)
        o = 6 * side
        turns = (
            turns[0] + dot(take3(links, i, o), turn) + dot(take3(links, i, o + 3), way),
            turns[1] + dot(take3(links, i, 12 + o), turn) + dot(take3(links, i, 15 + o), way),
        )
    _, _, w11, w12, w22 = slopes(lying, q, near, i)
    way = subtract(take3(work.move, own[0], 3), take3(work.move, own[1], 3))
    way = subtract(way, scale(w11 * turns[0] + w12 * turns[1], tangent_of(q, a)))
    way = add(way, scale(w12 * turns[0] + w22 * turns[1], tangent_of(q, b)))
    way = subtract(way, scale(dot(way, n), n))
    return push, dot(way, t) / near[a, APART]


@viewing(forceinline=True)
def sum_of(both: tuple[float, float]) -> float:
    """Of two numbers."""
    return both[0] + both[1]


@kernel(late=types.float64)
def solve_coupled(net: Net, lying: Lying, q: Array, near: Array) -> float:
    """As `graph.solve`, with the limits of what slips as the step of the pushes tells them.

    The matrix is A + sum c e^T then, c what the gradient gains by a push of 1 N and e that push: not symmetric. With
    the answers of A to the right-hand side and to each c its own are known (Sherman, Morrison and Woodbury).
    """
    ints, floats, space, rubs = net.ints, net.floats, net.space, lying.rubs[TRIAL]
    largest = solve(ints, floats, space)
    some, m = np.zeros(rubs.shape[0], dtype=np.int64), 0
    for i in range(rubs.shape[0]):
        if take3(rubs, i, DRAWN) != NONE:
            some[m] = i
            m += 1
    if m == 0:
        return largest
    M = np.empty((m, m + 1))
    for x in range(m):
        M[x, m] = sum_of(step_of_push(net, lying, q, near, some[x]))
    for y in range(m):
        c = scale(roughness(lying, some[y]), take3(rubs, some[y], DRAWN))
        pull_both(net, lying, q, near, some[y], c)
        solve(ints, floats, space)
        for x in range(m):
            more = sum_of(step_of_push(net, lying, q, near, some[x]))
            M[x, y] = (1.0 if x == y else 0.0) + M[x, m] - more
        pull_both(net, lying, q, near, some[y], scale(-1.0, c))
    for x in range(m):
        if not M[x, x] > LOCKED:
            return solve(ints, floats, space)
        for z in range(x + 1, m):
            f = M[z, x] / M[x, x]
            for y in range(x, m + 1):
                M[z, y] -= f * M[x, y]
    for x in range(m - 1, -1, -1):
        for y in range(x + 1, m):
            M[x, m] -= M[x, y] * M[y, m]
        M[x, m] /= M[x, x]
        c = scale(M[x, m] * roughness(lying, some[x]), take3(rubs, some[x], DRAWN))
        pull_both(net, lying, q, near, some[x], c)
    return solve(ints, floats, space)


@viewing(forceinline=True)
def block_of(lying: Lying, q: Array, i: int, n: Vector, x: int) -> Matrix:
    """C's block of three columns, in the order of z."""
    if x % 2 == 1:
        return IDENTITY if x == 1 else mscale(-1.0, IDENTITY)
    return mscale(radius(lying, i, x // 2), mul(hat(n), rotation(get4(q, lying.pairs[i, x // 2]))))


@viewing
def add_rigid(net: Net, lying: Lying, q: Array, near: Array, i: int, K: Matrix) -> None:
    """Adds C^T K C to the second derivative of link i."""
    links = model_of(net.ints, net.floats).links
    n, _ = nearest(lying, q, near, i)
    at = L_BENT
    for x in range(4):
        left = tmul(block_of(lying, q, i, n, x), K)
        for y in range(x, 4):
            put9(links, i, at, madd(get9(links, i, at), mul(left, block_of(lying, q, i, n, y))))
            at += 9


@viewing
def lead_pairs(
    net: Net, lying: Lying, q: Array, near: Array, on: Array, share: float, faint: float, length: float
) -> None:
    """Tells what cables will pull each other by after the step, to first order."""
    plan, work, rubs = plan_of(net.ints), work_of(net.ints, net.space), lying.rubs[TRIAL]
    for i in range(rubs.shape[0]):
        a, b = lying.pairs[i, 0], lying.pairs[i, 1]
        rubs[i, MORE] = 0.0
        if on[a, LINKED] != ACTIVE:
            put3(rubs, i, NEXT, NONE)
            continue
        t, K, _ = law(lying, q, near, i, share, faint, length)
        n, _ = nearest(lying, q, near, i)
        way = subtract(take3(near, a, STEP), take3(near, b, STEP))
        for side in range(2):
            knot, k = plan.links[i, side], lying.pairs[i, side]
            node = plan.first[net.span[knot] + 1] + net.span[knot]
            turn = apply(rotation(get4(q, k)), get3(work.d, node))
            way = add(way, scale(radius(lying, i, side), cross(n, turn)))
        push, more = step_of_push(net, lying, q, near, i)
        rubs[i, MORE] = more
        t = add(t, scale(roughness(lying, i) * (push + more), take3(rubs, i, DRAWN)))
        put3(rubs, i, NEXT, subtract(subtract(t, apply(K, way)), scale(more, n)))


@viewing
def pull_on(lying: Lying, near: Array, fraction: float) -> None:
    """Takes a fraction of the step of the pulls, and of what the pushes grow by as they turn."""
    rubs = lying.rubs[TRIAL]
    for i in range(rubs.shape[0]):
        t = take3(rubs, i, PULLED)
        put3(rubs, i, PULLED, add(t, scale(fraction, subtract(take3(rubs, i, NEXT), t))))
        near[lying.pairs[i, 0], PUSH] += fraction * rubs[i, MORE]
        near[lying.pairs[i, 1], PUSH] += fraction * rubs[i, MORE]


@viewing
def goes_on_pairs(net: Net, lying: Lying, q: Array, near: Array, on: Array, which: int) -> None:
    """Adds to the model what friction of pairs adds at solution `which`, as if what slips goes on."""
    rubs = lying.rubs[which]
    for i in range(rubs.shape[0]):
        a = lying.pairs[i, 0]
        if on[a, LINKED] != ACTIVE or roughness(lying, i) == 0.0 or rubs[i, FIRM] == 0.0:
            continue
        n, t = take3(near, a, TOWARD), take3(rubs, i, PULLED)
        K, size = msub(IDENTITY, outer(n, n)), math.sqrt(dot(t, t))
        if rubs[i, SLIPS] != 0.0 and size > 0.0:
            K = msub(K, mscale(1.0 / (size * size), outer(t, t)))
        add_rigid(net, lying, q, near, i, mscale(rubs[i, FIRM], K))
