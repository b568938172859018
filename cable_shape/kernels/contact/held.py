"""What bodies do to a network beside one that touches them, by the laws that hold there: see `swung_tangent`."""

from __future__ import annotations

import math
from typing import NamedTuple

from cable_shape.checks import Array
from cable_shape.kernels.contact.check import carried
from cable_shape.kernels.contact.near import NONE
from cable_shape.kernels.contact.points import before_at, curve, found_again, heavy_at, on_curve, slope
from cable_shape.kernels.contact.swung_look import ASPERITY, FIRM, held_by
from cable_shape.kernels.contact.tables import Bodies, Skin
from cable_shape.kernels.distance.surface import touch
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.momentum import RADIUS, Momentum, Scheme, momentum_of, scheme_of
from cable_shape.kernels.network.motion import FROZEN, LAW, N_PROPS, PROP, ROWS, Motion, motion_of
from cable_shape.kernels.network.props import (
    DRY,
    ELEMENT,
    GAVE,
    GRIP,
    HOLDER,
    LEVEL,
    NORMAL,
    PUSH,
    SHARE,
    SOFT,
    STUCK,
    aside_of,
    direction,
    eliminate,
    load,
    moved,
    now_at,
    sticks,
    weigh,
)
from cable_shape.kernels.network.swing_tangent import Beside
from cable_shape.kernels.network.system import release
from cable_shape.kernels.network.tables import (
    TRIAL,
    Floats,
    Model,
    Plan,
    Whole,
    model_of,
    plan_of,
    solution_of,
    work_of,
)
from cable_shape.kernels.network.walls import AT, BODY, KEPT, OUT, PUSHED, REF, ROUGH, RUB, STIFF, WALL, WALLS, along
from cable_shape.kernels.network.walls import FIRM as ASPERE
from cable_shape.kernels.rod_algebra import Vector, add, dot, get3, put3, scale, subtract, take3

#: Where a motion begins at rest its planes give way less than elements do: that many times less than they did.
CLOSER = 1e6
#: And springs hold its nodes that much more firmly than where nothing touches: how forces go with their places is much.
FIRMER = 1e3


class Felt(NamedTuple):
    """Derivatives by p numbers of what bodies have to do with, of n nodes."""

    rub: Array  # (p, n WALLS, 3) [N], friction on the planes of nodes, and
    dry: Array  # (p, PROPS, 3) on points of elements, after the last part of a step
    jump: Array  # (p, n, 3) as `Momentum.jump`
    push: Array  # (p, PROPS, 3) [N], forces on points: along the rows of each, see `props.direction`


@viewing
def lay_again(
    ints: Whole, moving: Floats, old: Floats, dt: float, to: Beside, bodies: Bodies, skin: Skin, rub: Floats,
    dry: Floats, push: Floats, by: float,
) -> None:  # fmt: skip
    """Lays planes in a network beside, where `swung_look.look` would in a part dt [s] of a step: as they press now.

    old: what was pressed before the part. rub, dry, push: derivatives, see `Felt`, `by` times which it is away.
    """
    plan, own, motion, was = plan_of(ints), model_of(ints, to.floats), motion_of(ints, moving), motion_of(ints, old)
    there, then = motion_of(ints, to.moving), momentum_of(ints, to.remembered)
    t = scheme_of(then.par[RADIUS], dt)
    take_over(motion, there)
    for node in range(motion.walls.shape[0]):
        count = int(motion.walls[node, 0])
        if count == 0:
            continue
        mass, drag = heavy_at(plan, there, then, skin.knot[node], node)
        hold = held_by(t, mass, drag)
        for k in range(count):
            i = 1 + WALL * k
            b, push_on = int(motion.walls[node, i + BODY]), motion.walls[node, i + PUSHED]
            for c in range(WALL):
                there.walls[node, i + c] = motion.walls[node, i + c] if push_on > 0.0 or c == BODY else 0.0
            if not push_on > 0.0:
                continue
            p = carried(get3(then.place, node), bodies.then[b], bodies.frames[b])
            n = plane(there, bodies, b, node, i, p, skin.thick[node])
            there.walls[node, i + STIFF], firm = FIRM * hold, ASPERITY * hold
            rough, f = motion.walls[node, i + ROUGH], take3(motion.walls, node, i + RUB)
            there.walls[node, i + ASPERE] = firm if rough > 0.0 else 0.0
            there.walls[node, i + ROUGH] = (
                math.inf if rough > 0.0 and dot(f, f) < 0.999 * (rough * push_on) ** 2 else rough
            )
            rubbed = NONE
            for c in range(int(was.walls[node, 0])):
                o = 1 + WALL * c
                if int(was.walls[node, o + BODY]) == b and was.walls[node, o + PUSHED] > 0.0:
                    rubbed = add(take3(was.walls, node, o + RUB), scale(by, get3(rub, WALLS * node + c)))
            put3(there.walls, node, i + REF, add(p, scale(1.0 / firm, along(n, rubbed))))
    for i in range(int(motion.par[N_PROPS])):
        if motion.props[i, HOLDER] < 0.0:
            ring_again(plan, own, there, then, skin.rings, i)
        elif motion.props[i, PUSH] > 0.0:
            point_again(plan, own, there, then, bodies, skin, i)
            if motion.props[i, SHARE] == 1.0:
                soften_tip(plan, there, then, was, skin, dry, by, t, i)
        press_again(motion, there, push, by, i)


@inline
def take_over(motion: Motion, there: Motion) -> None:
    """Has a network beside its places, planes and points from the other, by laws that do not change."""
    for c in range(motion.par.shape[0]):
        there.par[c] = motion.par[c]
    there.par[LAW] = FROZEN
    for node in range(motion.walls.shape[0]):
        there.walls[node, 0] = motion.walls[node, 0]
        put3(there.place, node, 0, get3(motion.place, node))
    for i in range(int(motion.par[N_PROPS])):
        for c in range(PROP):
            there.props[i, c] = motion.props[i, c]


@inline
def plane(motion: Motion, bodies: Bodies, b: int, node: int, i: int, p: Vector, thick: float) -> Vector:
    """Lays the plane at column i of a node that is at p; returns its normal."""
    d, n, _ = touch(bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree, p, NONE, False, bodies.stack)
    put3(motion.walls, node, i + OUT, n)
    motion.walls[node, i + AT] = dot(n, p) - (d - thick)
    return n


@viewing
def point_again(
    plan: Plan, model: Model, motion: Motion, memory: Momentum, bodies: Bodies, skin: Skin, i: int
) -> None:  # fmt: skip
    """Lays the plane of point i, where in its element the body is nearest then."""
    props, e, b = motion.props, int(motion.props[i, ELEMENT]), int(motion.props[i, HOLDER])
    node, h, then, now = plan.left[e], model.h[e], bodies.then[b], bodies.frames[b]
    p, q = carried(get3(memory.place, node), then, now), carried(get3(memory.place, node + 1), then, now)
    tp = subtract(carried(add(get3(memory.place, node), get3(memory.tangent, node)), then, now), p)
    tq = subtract(carried(add(get3(memory.place, node + 1), get3(memory.tangent, node + 1)), then, now), q)
    if props[i, SHARE] < 1.0:
        props[i, SHARE] = found_again(bodies, b, h, props[i, SHARE], p, q, tp, tq)
    weigh(props, i, h)
    at = on_curve(h, props[i, SHARE], p, q, tp, tq)
    d, n, _ = touch(bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree, at, NONE, False, bodies.stack)
    put3(props, i, NORMAL, n)
    props[i, LEVEL] = dot(n, at) - (d - skin.thick[node])
    put3(props, i, STUCK, at)


@viewing
def soften_tip(
    plan: Plan, motion: Motion, memory: Momentum, was: Motion, skin: Skin, dry: Floats, by: float, t: Scheme, i: int
) -> None:  # fmt: skip
    """Has the asperities under a loose end give as those of nodes do."""
    props, node = motion.props, plan.left[int(motion.props[i, ELEMENT])] + 1
    k = before_at(was.props, int(was.par[N_PROPS]), int(props[i, ELEMENT]), int(props[i, HOLDER]), True)
    rubbed = add(take3(was.props, k, DRY), scale(by, get3(dry, k))) if k >= 0 else NONE
    mass, drag = heavy_at(plan, motion, memory, skin.knot[node], node)
    props[i, SOFT] = 1.0 / (ASPERITY * held_by(t, mass, drag))
    put3(props, i, GAVE, scale(props[i, SOFT], along(take3(props, i, NORMAL), rubbed)))


@viewing
def ring_again(plan: Plan, model: Model, motion: Motion, memory: Momentum, rings: Floats, i: int) -> None:
    """Finds the point of the cable that is in the eyelet of point i again, in the same element."""
    props, e = motion.props, int(motion.props[i, ELEMENT])
    node, at, share = plan.left[e], take3(rings, -1 - int(props[i, HOLDER]), 0), props[i, SHARE]
    for _ in range(4 if 0.0 < share < 1.0 else 0):
        t = slope(memory, model, node, e, share)
        share -= dot(subtract(curve(memory, model, node, e, share), at), t) / dot(t, t)
    props[i, SHARE] = share
    weigh(props, i, model.h[e])
    t = slope(memory, model, node, e, share)
    put3(props, i, NORMAL, scale(1.0 / math.sqrt(dot(t, t)), t))
    put3(props, i, STUCK, at)


@inline
def press_again(motion: Motion, there: Motion, push: Floats, by: float, i: int) -> None:
    """Has point i pressed as in the other network, and `by` times more."""
    F = add(scale(motion.props[i, PUSH], take3(motion.props, i, NORMAL)), take3(motion.props, i, DRY))
    for c in range(3):
        F = add(F, scale(by * push[i, c], direction(motion.props, 3 * i + c)))
    n, grip = take3(there.props, i, NORMAL), motion.props[i, GRIP]
    there.props[i, PUSH] = dot(n, F) if grip >= 0.0 else 0.0
    put3(there.props, i, DRY, along(n, F) if grip != 0.0 else NONE)


@viewing
def close(motion: Motion, memory: Momentum) -> None:
    """Has planes hold what they press at rest where it is, hardly giving way."""
    for node in range(motion.walls.shape[0]):
        for k in range(int(motion.walls[node, 0])):
            i = 1 + WALL * k
            if not motion.walls[node, i + PUSHED] > 0.0:
                continue
            motion.walls[node, i + KEPT] = motion.walls[node, i + PUSHED]
            motion.walls[node, i + AT] = dot(take3(motion.walls, node, i + OUT), get3(memory.place, node))
            motion.walls[node, i + STIFF] *= CLOSER


@viewing
def lay_at_rest(
    ints: Whole, moving: Floats, to: Beside, bodies: Bodies, skin: Skin, push: Floats, by: float
) -> None:  # fmt: skip
    """The same of a network at rest, after `close`, with nothing that rubs."""
    plan, own, motion = plan_of(ints), model_of(ints, to.floats), motion_of(ints, moving)
    there, then = motion_of(ints, to.moving), momentum_of(ints, to.remembered)
    take_over(motion, there)
    for node in range(motion.walls.shape[0]):
        there.hold[node] *= FIRMER
        for k in range(int(motion.walls[node, 0])):
            i = 1 + WALL * k
            pushes = motion.walls[node, i + PUSHED] > 0.0
            for c in range(WALL):
                there.walls[node, i + c] = motion.walls[node, i + c] if pushes or c == BODY else 0.0
            if pushes:
                b, p = int(motion.walls[node, i + BODY]), get3(motion.place, node)
                level = plane(there, bodies, b, node, i, p, skin.thick[node])
                off = dot(level, p) - there.walls[node, i + AT]  # by which it is off the surface, and stays
                plane(there, bodies, b, node, i, get3(then.place, node), skin.thick[node])
                there.walls[node, i + AT] += off
    for i in range(int(motion.par[N_PROPS])):
        ring_again(plan, own, there, then, skin.rings, i)
        press_again(motion, there, push, by, i)


@inline
def law_of(plan: Plan, motion: Motion, props: Floats, i: int, r: Vector, stuck: bool) -> Vector:
    """What point i at r misses of its law: along its normal, and across it [m], or [N] where it slips."""
    n, t = take3(props, i, NORMAL), take3(props, i, DRY)
    g = along(n, subtract(r, take3(props, i, STUCK)))
    if props[i, HOLDER] < 0.0:
        return add(scale(props[i, PUSH], n), g)
    g = subtract(add(g, scale(props[i, SOFT], t)), take3(props, i, GAVE))
    out = scale(dot(n, r) - props[i, LEVEL], n)
    size = math.sqrt(dot(g, g))
    if stuck:
        return add(out, g)
    return add(out, add(t, scale(props[i, GRIP] * props[i, PUSH] / size, g) if size > 0.0 else NONE))


@viewing
def misses(ints: Whole, sols: Floats, moving: Floats, there: Floats, rows: Floats, by: float) -> None:
    """Adds `by` times what points of a network beside, at the trial of `sols`, miss of their laws to column ROWS."""
    plan, motion, other = plan_of(ints), motion_of(ints, moving), motion_of(ints, there)
    sol = solution_of(ints, sols, TRIAL)
    for i in range(int(motion.par[N_PROPS])):
        miss = law_of(plan, other, other.props, i, now_at(plan, other, sol, i), sticks(motion.props, i))
        for row in range(3 * i, 3 * i + 3):
            rows[row, ROWS] += by * dot(direction(motion.props, row), miss)


@inline
def acts(motion: Motion, row: int) -> bool:
    """Whether the force along this row may change."""
    i = row // 3
    if motion.props[i, HOLDER] < 0.0:
        return row % 3 > 0
    pressed = motion.props[i, PUSH] > 0.0
    return pressed and (row % 3 == 0 or motion.props[i, GRIP] > 0.0)


@viewing
def yield_points(ints: Whole, sols: Floats, space: Floats, moving: Floats, rows: Floats, change: Floats) -> None:
    """Fills `change` (ROWS,) [N]: of forces on points, after which all meet their laws, see `misses`.

    With the network's answers to each, and what it does without them, at hand.
    """
    plan, work, motion, sol = (
        plan_of(ints),
        work_of(ints, space),
        motion_of(ints, moving),
        solution_of(ints, sols, TRIAL),
    )
    shove, answers = aside_of(ints, motion)
    count = 3 * int(motion.par[N_PROPS])
    shove[:, :] = 0.0
    for row in range(count):
        change[row] = moved(plan, sol, work, motion, shove, row) if acts(motion, row) else 0.0
    for row in range(count):
        i, k = row // 3, 3 * (row // 3)
        for c in range(count + 1):
            rows[row, c if c < count else ROWS + 1] = 0.0
        if not (acts(motion, row) and answers[row, row] > 0.0):
            rows[row, row] = 1.0
            continue
        if row % 3 == 0 or motion.props[i, HOLDER] < 0.0 or sticks(motion.props, i):
            add_way(motion, answers, change, rows, row, row, 1.0, count)
            rows[row, row] += motion.props[i, SOFT] if row % 3 > 0 else 0.0
        else:  # it slips: t + mu p g / |g|
            n, g = take3(motion.props, i, NORMAL), subtract(now_at(plan, motion, sol, i), take3(motion.props, i, STUCK))
            g = along(
                n,
                add(
                    g, subtract(scale(motion.props[i, SOFT], take3(motion.props, i, DRY)), take3(motion.props, i, GAVE))
                ),
            )
            size, limit = math.sqrt(dot(g, g)), motion.props[i, GRIP] * motion.props[i, PUSH]
            own = dot(direction(motion.props, row), g) / size
            rows[row, row] += 1.0
            rows[row, k] += motion.props[i, GRIP] * own
            for other in range(k + 1, k + 3):
                way = (1.0 if other == row else 0.0) - own * dot(direction(motion.props, other), g) / size
                add_way(motion, answers, change, rows, row, other, limit / size * way, count)
                rows[row, other] += limit / size * way * motion.props[i, SOFT]
        rows[row, ROWS + 1] -= rows[row, ROWS]
    eliminate(rows, change, count, ROWS + 1)


@inline
def add_way(
    motion: Motion, answers: Floats, gone: Floats, rows: Floats, row: int, of: int, by: float, count: int
) -> None:  # fmt: skip
    """Adds to an equation `by` times how a point goes along the row `of`."""
    for other in range(count):
        if acts(motion, other):
            rows[row, other] += by * answers[of, other]
    rows[row, ROWS + 1] -= by * gone[of]


@viewing
def steady(ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, change: Floats) -> None:
    """Adds these changes of forces on points to the right-hand side."""
    plan, model, work, motion = plan_of(ints), model_of(ints, floats), work_of(ints, space), motion_of(ints, moving)
    sol = solution_of(ints, sols, TRIAL)
    shove, _ = aside_of(ints, motion)
    for row in range(3 * int(motion.par[N_PROPS])):
        if change[row] != 0.0:
            load(plan, model, sol, work, motion, shove, row, change[row])
    release(plan, model, work.G)


@viewing
def feel(ints: Whole, moving: Floats, remembered: Floats, rub: Floats, dry: Floats, jump: Floats, by: float) -> None:
    """Adds `by` times what bodies have to do with."""
    motion, memory = motion_of(ints, moving), momentum_of(ints, remembered)
    for node in range(motion.walls.shape[0]):
        put3(jump, node, 0, add(get3(jump, node), scale(by, get3(memory.jump, node))))
        for k in range(int(motion.walls[node, 0])):
            row, t = WALLS * node + k, take3(motion.walls, node, 1 + WALL * k + RUB)
            put3(rub, row, 0, add(get3(rub, row), scale(by, t)))
    for i in range(int(motion.par[N_PROPS])):
        put3(dry, i, 0, add(get3(dry, i), scale(by, take3(motion.props, i, DRY))))


@inline
def state_of(motion: Motion, node: int, b: int) -> int:
    """What body b does to a node: 0 nothing, 1 it presses it, 2 and it slips."""
    found = 0
    for k in range(int(motion.walls[node, 0])):
        i = 1 + WALL * k
        if int(motion.walls[node, i + BODY]) == b and motion.walls[node, i + PUSHED] > 0.0:
            t, limit = (
                take3(motion.walls, node, i + RUB),
                motion.walls[node, i + ROUGH] * motion.walls[node, i + PUSHED],
            )
            found = 2 if dot(t, t) >= 0.999 * limit * limit and dot(t, t) > 0.0 else 1
    return found


@inline
def point_state_of(motion: Motion, like: Motion, i: int) -> int:
    """The same of point i of another state, in this one; what eyelets do does not change."""
    b, found = int(like.props[i, HOLDER]), 0
    tip = like.props[i, SHARE] == 1.0
    k = before_at(motion.props, int(motion.par[N_PROPS]), int(like.props[i, ELEMENT]), b, tip)
    if b >= 0 and k >= 0 and motion.props[k, PUSH] > 0.0:
        t = take3(motion.props, k, DRY)
        found = 1 if sticks(motion.props, k) or not dot(t, t) > 0.0 else 2
    return found


@viewing
def changes(ints: Whole, old: Floats, new: Floats) -> bool:
    """Whether something else is pressed than before a part of a step, or sticks or slips as it did not."""
    before, motion, found = motion_of(ints, old), motion_of(ints, new), False
    for node in range(motion.walls.shape[0]):
        for one, other in ((before, motion), (motion, before)):
            for k in range(int(one.walls[node, 0])):
                b = int(one.walls[node, 1 + WALL * k + BODY])
                found = found or state_of(one, node, b) != state_of(other, node, b)
    for one, other in ((before, motion), (motion, before)):
        for i in range(int(one.par[N_PROPS])):
            found = found or point_state_of(one, one, i) != point_state_of(other, one, i)
    return found
