"""What presses on cables that swing, as contacts are told: see `check.touches`."""

from __future__ import annotations

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.meeting import place_at
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.momentum import Momentum, momentum_of
from cable_shape.kernels.network.motion import N_PROPS, Motion, motion_of
from cable_shape.kernels.network.props import (
    DRY,
    ELEMENT,
    GRIP,
    HOLDER,
    NORMAL,
    OTHER,
    PAIRED,
    PARTNER,
    PUSH,
    SHARE,
    STUCK,
)
from cable_shape.kernels.network.tables import Floats, Model, Plan, Whole, model_of, plan_of
from cable_shape.kernels.network.walls import BODY, OUT, PUSHED, ROUGH, RUB, WALL
from cable_shape.kernels.rod_algebra import Vector, add, dot, get3, put3, scale, subtract, take3

OTHERS = 1e6  #: in place of a body, on


@kernel
def touches(
    ints: Whole, floats: Floats, moving: Floats, remembered: Floats, thick: Array, cable: int, out: Array
) -> int:  # fmt: skip
    """Fills out (k, TOUCH) with what presses on nodes and elements of a cable, see `check.touches`; how many.

    In place of a body cable c is told as OTHERS + c.
    """
    plan, model, motion = plan_of(ints), model_of(ints, floats), motion_of(ints, moving)
    memory = momentum_of(ints, remembered)
    first, last = plan.first[plan.cables[cable]], plan.first[plan.cables[cable + 1]]
    count = 0
    for node in range(first + plan.cables[cable], last + plan.cables[cable + 1]):
        for k in range(int(motion.walls[node, 0])):
            i = 1 + WALL * k
            push, n, t = (
                motion.walls[node, i + PUSHED],
                take3(motion.walls, node, i + OUT),
                take3(motion.walls, node, i + RUB),
            )
            if push > 0.0 and count < out.shape[0]:
                x = subtract(get3(motion.place, node), scale(thick[node], n))
                slips = dot(t, t) >= 0.999 * (motion.walls[node, i + ROUGH] * push) ** 2 and dot(t, t) > 0.0
                put_touch(out, count, model.s[node], motion.walls[node, i + BODY], x, n, push, t, slips)
                count += 1
    for i in range(int(motion.par[N_PROPS])):
        push, n, t = motion.props[i, PUSH], take3(motion.props, i, NORMAL), take3(motion.props, i, DRY)
        e = int(motion.props[i, 0])
        if motion.props[i, HOLDER] == PAIRED:
            count = touches_each_other(plan, model, motion, memory, thick, i, first, last, out, count)
        elif push > 0.0 and first <= e < last and count < out.shape[0]:
            node = plan.left[e]
            x = subtract(take3(motion.props, i, STUCK), scale(thick[node], n))
            slips = dot(t, t) >= 0.999 * (motion.props[i, GRIP] * push) ** 2 and dot(t, t) > 0.0
            s = model.s[node] + motion.props[i, SHARE] * model.h[e]
            put_touch(out, count, s, motion.props[i, HOLDER], x, n, push, t, slips)
            count += 1
    return count


@viewing
def touches_each_other(
    plan: Plan, model: Model, motion: Motion, memory: Momentum, thick: Floats, i: int, first: int, last: int,
    out: Floats, count: int,
) -> int:  # fmt: skip
    """Adds what pair i does to a cable, of elements first to last - 1, once more where that is both."""
    props = motion.props
    push, n, t = props[i, PUSH], take3(props, i, NORMAL), take3(props, i, DRY)
    slips = dot(t, t) >= 0.999 * (props[i, GRIP] * push) ** 2 and dot(t, t) > 0.0
    for side in range(2):
        e, f = int(props[i, PARTNER if side else ELEMENT]), int(props[i, ELEMENT if side else PARTNER])
        if not (push > 0.0 and first <= e < last and count < out.shape[0]):
            continue
        other = 0
        for c in range(plan.cables.shape[0] - 1):
            other = c if plan.first[plan.cables[c]] <= f < plan.first[plan.cables[c + 1]] else other
        node, sign = plan.left[e], -1.0 if side else 1.0
        x, y = props[i, OTHER if side else SHARE], props[i, SHARE if side else OTHER]
        at = place_at(plan, model, memory.place, memory.tangent, f, y)
        outward = scale(sign, n)
        put_touch(
            out, count, model.s[node] + x * model.h[e], OTHERS + other, add(at, scale(thick[plan.left[f]], outward)),
            outward, push, scale(sign, t), slips,
        )  # fmt: skip
        count += 1
    return count


@viewing
def put_touch(
    out: Floats, k: int, s: float, body: float, x: Vector, n: Vector, push: float, t: Vector, slips: bool
) -> None:
    """Row k of contacts."""
    out[k, 0], out[k, 1], out[k, 8], out[k, 12] = s, body, push, 1.0 if slips else 0.0
    put3(out, k, 2, x)
    put3(out, k, 5, n)
    put3(out, k, 9, t)
