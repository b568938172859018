"""Dry friction of nodes that are pressed on bodies: Coulomb's law with memory, in increments.

What the body pulls a node by along its surface, t, was t' in the last solution; since then the cable's point there has
gone d along the surface, as the body sees it. Between asperities that give a little, by FIRMNESS of the length at the
limit,

    t = t' - k d  if that is no longer than mu p: it sticks; else as long as that: it slips.

So points that stick keep what they carry from step to step, whatever their number: nothing is left undetermined in a
cable that does not stretch. In an iteration mu p is a given limit: the law is then the gradient of a convex function of
the node's place, and its derivative

    k (1 - n n^T), and of one that slips mu p / |t' - k d| times as much across the direction in which it does,

goes to the network's matrix with the curvature of the surface. The limits follow the pushes from iteration to iteration
by the step that Aitken's relaxation tells (see `limits`): where a taut cable is held in several places, limits that
are simply those of the last pushes swing up. A node that has not touched the body before carries nothing along it.

A contact that runs along the cable takes d along: what was at the node is then s' - s behind it.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import (
    ARC,
    BARE,
    FIRM,
    HELD,
    LIMIT,
    MATE,
    NONE,
    NORMAL,
    OFF,
    PRESS,
    RUB,
    SECOND,
    SECOND_NORMAL,
    SECOND_PRESS,
    SLIPS,
    SPOT,
    THIRD,
    THIRD_PRESS,
    WAS,
    leant,
    pressed,
    tangent_of,
)
from cable_shape.kernels.contact.tables import Bodies, Lying, Net
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.tables import N_KNOTS, TRIAL, model_of, work_of
from cable_shape.kernels.rod_algebra import (
    Matrix,
    Vector,
    add,
    cross,
    dot,
    get3,
    get9,
    madd,
    mscale,
    msub,
    outer,
    put3,
    put9,
    scale,
    subtract,
    take3,
)
from cable_shape.kernels.rod_element import IDENTITY

#: Of the length: how far what carries its limit has given way.
FIRMNESS = 1e-4
#: Of weight + EI / L^2: contacts pressed by less are as firm as if it were so much.
FAINT = 1e-3
#: Least part of the way to the limits of the last pushes that an iteration goes.
LEAST = 0.1
NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@viewing
def any_rough(lying: Lying, bodies: Bodies) -> bool:
    """Whether there is friction at all."""
    largest = 0.0
    for b in range(bodies.rough.shape[0]):
        largest = max(largest, bodies.rough[b])
    for k in range(lying.rough.shape[0]):
        largest = max(largest, lying.rough[k])
    return largest > 0.0


@viewing(forceinline=True)
def limit_of(rough: Array, of_bodies: Array, near: Array, on: Array, k: int) -> float:
    """[N], mu p of node k; of two bodies the sum. Of body and cable the larger mu counts.

    rough (n,), of_bodies (m,): see `Lying.rough` and `Bodies.rough`.
    """
    limit = max(rough[k], of_bodies[on[k, 0]]) * max(near[k, PRESS], 0.0)
    if on[k, SECOND] != BARE:
        limit += max(rough[k], of_bodies[on[k, SECOND]]) * max(near[k, SECOND_PRESS], 0.0)
    if on[k, THIRD] != BARE:
        limit += max(rough[k], of_bodies[on[k, THIRD]]) * max(near[k, THIRD_PRESS], 0.0)
    return limit


@viewing(forceinline=True)
def free_ways(near: Array, on: Array, k: int) -> Matrix:
    """The projection onto the ways that node k has: along the surface, or the edge between two bodies, or none."""
    n = take3(near, k, NORMAL)
    if on[k, SECOND] == BARE:
        return msub(IDENTITY, outer(n, n))
    e = cross(n, take3(near, k, SECOND_NORMAL))
    size = dot(e, e) if on[k, THIRD] == BARE else 0.0
    return mscale(1.0 / size, outer(e, e)) if size > 0.0 else NOTHING


@viewing(forceinline=True)
def onto(P: Matrix, v: Vector) -> Vector:
    """P v."""
    return (
        P[0] * v[0] + P[1] * v[1] + P[2] * v[2],
        P[3] * v[0] + P[4] * v[1] + P[5] * v[2],
        P[6] * v[0] + P[7] * v[1] + P[8] * v[2],
    )


@viewing(forceinline=True)
def rub(
    lying: Lying, bodies: Bodies, q: Array, near: Array, on: Array, k: int, share: float, faint: float, length: float
) -> tuple[Vector, Matrix, bool]:  # fmt: skip
    """What the body pulls node k by [N], minus its derivative in the node's place [N/m], and whether it slips.

    share: of how firm it is.
    """
    if near[k, MATE] != 1.0 + on[k, 0]:
        return NONE, NOTHING, True
    limit = near[k, LIMIT]
    if limit <= 0.0:
        return NONE, NOTHING, True
    P = free_ways(near, on, k)
    frame = bodies.frames[on[k, 0]]
    was, kept = get3(frame, 3), NONE
    for i in range(3):
        was = add(was, scale(near[k, WAS + i], get3(frame, i)))
        kept = add(kept, scale(near[k, HELD + i], get3(frame, i)))
    way = subtract(take3(near, k, SPOT), was)
    way = subtract(way, scale(lying.s[k] - near[k, ARC], tangent_of(q, k)))
    size, kept = math.sqrt(dot(kept, kept)), onto(P, kept)
    turned = math.sqrt(dot(kept, kept))
    if turned > 0.0:  # as the surface's normal turns, so does what it carries
        kept = scale(size / turned, kept)
    firm = share * max(near[k, FIRM], max(limit, faint) / (FIRMNESS * length))
    pull = subtract(kept, scale(firm, onto(P, way)))
    size = math.sqrt(dot(pull, pull))
    if size <= limit:
        return pull, mscale(firm, P), False
    f = limit / size
    along = scale(1.0 / size, pull)
    return scale(f, pull), mscale(f * firm, msub(P, outer(along, along))), True


@viewing
def forget_limits(near: Array) -> None:
    """The next `limits` are mu p."""
    for k in range(near.shape[0]):
        near[k, LIMIT] = -1.0


@viewing
def limits(
    rough: Array, of_bodies: Array, near: Array, on: Array, part: float
) -> tuple[float, float, float]:  # fmt: skip
    """Takes the limits of all contacts a part of the way on to mu p; new ones there.

    rough, of_bodies: see `limit_of`; part: of the last time. Returns that of this time, the largest way that was left
    and the largest mu p [N]. The road takes the same step (solve/touching/held_along.py).

    Reference: B. M. Irons and R. C. Tuck, A version of the Aitken accelerator for computer iteration, IJNME 1, 1969.
    """
    told, bent = 0.0, 0.0
    for turn in range(2):
        left, largest = 0.0, 0.0
        for k in range(near.shape[0]):
            if on[k, 0] == BARE or near[k, MATE] != 1.0 + on[k, 0]:
                near[k, LIMIT] = -1.0
                continue
            limit = limit_of(rough, of_bodies, near, on, k)
            if near[k, LIMIT] < 0.0:
                near[k, LIMIT], near[k, OFF] = limit, 0.0
            off, before = limit - near[k, LIMIT], near[k, OFF]
            if turn == 0:
                told += before * (off - before)
                bent += (off - before) ** 2 if before != 0.0 else 0.0
            else:
                near[k, LIMIT] += part * off
                near[k, OFF] = off
                left, largest = max(left, abs(off)), max(largest, limit)
        if turn == 0 and bent > 0.0:
            part = min(max(-part * told / bent, LEAST), 1.0)
    return part, left, largest


@viewing
def rubbed(near: Array, on: Array, k: int) -> Matrix:
    """The same derivative at the solution that `remember` was told of, as if what slips goes on."""
    if near[k, FIRM] == 0.0:
        return NOTHING
    P, t = free_ways(near, on, k), take3(near, k, RUB)
    size = dot(t, t)
    if near[k, SLIPS] != 0.0 and size > 0.0:
        P = msub(P, mscale(1.0 / size, outer(t, t)))
    return mscale(near[k, FIRM], P)


@viewing
def pull_along(
    net: Net, lying: Lying, bodies: Bodies, q: Array, near: Array, on: Array, share: float, faint: float,
    length: float, part: float, factored: bool,
) -> tuple[int, float, float]:  # fmt: skip
    """Adds friction to what `knots.press_on` has told the model and to the pulls on the contacts.

    Returns how many begin or end to slip, by which part of the largest limit forces miss the law at most, and the
    `part` of `limits`.
    """
    model, work = model_of(net.ints, net.floats), work_of(net.ints, net.space)
    part, left, _ = limits(lying.rough, bodies.rough, near, on, part)
    flips, miss, largest = 0, left * left, 0.0
    for i in range(net.bare[N_KNOTS], net.ints[N_KNOTS]):
        k = net.where[i]
        if on[k, 0] == BARE:
            continue
        t, K, slips = rub(lying, bodies, q, near, on, k, share, faint, length)
        if near[k, MATE] == 0.0:
            continue
        flips += (near[k, SLIPS] != 0.0) != slips
        near[k, SLIPS] = 1.0 if slips else 0.0
        off = subtract(get3(work.pull, i), t)
        miss, largest = max(miss, dot(off, off)), max(largest, limit_of(lying.rough, bodies.rough, near, on, k))
        put3(work.pull, i, 0, off)
        if not factored:
            put9(model.bent, i, 0, madd(get9(model.bent, i, 0), K))
    return flips, math.sqrt(miss) / largest if largest > 0.0 else 0.0, part


@viewing
def goes_on(net: Net, near: Array, on: Array) -> None:
    """Adds to the model what friction adds at the solution now."""
    model = model_of(net.ints, net.floats)
    for i in range(net.bare[N_KNOTS], net.ints[N_KNOTS]):
        k = net.where[i]
        if on[k, 0] != BARE and near[k, MATE] != 0.0:
            put9(model.bent, i, 0, madd(get9(model.bent, i, 0), rubbed(near, on, k)))


@viewing
def go_along(near: Array, on: Array, k: int, jump: Vector, fraction: float) -> None:
    """Takes a fraction of the step of what the body pulls node k by, whose whole force is `jump` [N] after it.

    That is along the surface where the step leads, see `near.lean`.
    """
    force = pressed(near, k, NORMAL)
    force = add(force, scale(fraction, subtract(jump, force)))
    if on[k, SECOND] == BARE:
        n = leant(near, k, fraction)
        put3(near, k, RUB, subtract(force, scale(dot(force, n), n)))
    else:
        put3(near, k, RUB, onto(free_ways(near, on, k), force))


@kernel
def remember(lying: Lying, bodies: Bodies, faint: float, length: float) -> None:
    """Makes the trial what the next steps count from: where the cable's points are on their bodies, and what they
    carry. faint [N]: what contacts are pressed by at least, for how firm they are."""
    near, on = lying.near[TRIAL], lying.on[TRIAL]
    for k in range(near.shape[0]):
        near[k, MATE] = near[k, FIRM] = 0.0
        b = on[k, 0]
        if b == BARE:
            continue
        limit = limit_of(lying.rough, bodies.rough, near, on, k)
        mu = max(lying.rough[k], bodies.rough[b])
        near[k, MATE] = 1.0 + b
        near[k, FIRM] = max(limit, mu * faint) / (FIRMNESS * length)
        near[k, ARC] = lying.s[k]
        off, t = subtract(take3(near, k, SPOT), get3(bodies.frames[b], 3)), take3(near, k, RUB)
        for i in range(3):
            near[k, WAS + i] = dot(off, get3(bodies.frames[b], i))
            near[k, HELD + i] = dot(t, get3(bodies.frames[b], i))
