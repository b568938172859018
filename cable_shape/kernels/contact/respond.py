"""How a shape in contact answers what moves or changes, as long as the same points stay in contact."""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.knots import slot_of
from cable_shape.kernels.contact.lay import copy_cable
from cable_shape.kernels.contact.near import (
    BARE,
    CURVED,
    NONE,
    NORMAL,
    PRESS,
    SECOND,
    SECOND_CURVED,
    SECOND_NORMAL,
    SECOND_PRESS,
    SPOT,
    THIRD,
    THIRD_NORMAL,
    tangent_of,
    way_out,
)
from cable_shape.kernels.contact.tables import Net
from cable_shape.kernels.network.compiled import part, viewing
from cable_shape.kernels.network.graph import lead, solve
from cable_shape.kernels.network.mesh import move_nodes
from cable_shape.kernels.network.respond import pull_change, spread, still
from cable_shape.kernels.network.tables import (
    N_KNOTS,
    N_SPANS,
    TRIAL,
    copy,
    model_of,
    model_size,
    plan_of,
    solution_of,
    still_knots,
    work_of,
)
from cable_shape.kernels.rod_algebra import add, apply, cross, dot, get3, get9, put3, scale, subtract, take3


@kernel
def neighbours(net: Net, s: Array, made: Array, before: Array, after: Array) -> Array:
    """As `network.mesh.neighbours`, of the cables whose models without contacts are made (c, size)."""
    out = np.empty((made.shape[0], model_size(net.ints)))
    for c in range(made.shape[0]):
        copy(out[c], net.floats)
        copy_cable(net, made[c], s, out[c])
        move_nodes(net.ints, net.floats, before, after[c], out[c])
    return out


@kernel
def follow_body(net: Net, q: Array, near: Array, on: Array, body: int, origin: Array, axis: int) -> None:
    """Makes the right-hand side what the motion of a body at unit speed changes: axis 0 to 2 along, 3 to 5 about x y z.

    Its points y move by v(y), so that the surface's normal at a contact turns by w x n - H v. The steps out of the
    surface are those of `Model.given`.
    """
    model, work = model_of(net.ints, net.floats), work_of(net.ints, net.space)
    still(net.ints, net.space)
    still_knots(model)
    unit = (1.0 if axis % 3 == 0 else 0.0, 1.0 if axis % 3 == 1 else 0.0, 1.0 if axis % 3 == 2 else 0.0)
    for i in range(net.bare[N_KNOTS], model.given.shape[0]):
        k = net.where[i]
        if on[k, SECOND] != BARE:
            follow_corner(net, near, on, i, k, body, origin, axis)
        if on[k, 0] != body or on[k, SECOND] != BARE:
            continue
        n = take3(near, k, NORMAL)
        way = unit
        turn = NONE
        if axis >= 3:
            way, turn = cross(unit, subtract(take3(near, k, SPOT), get3(origin, 0))), cross(unit, n)
        put3(model.given, i, 0, scale(dot(way, n), n))
        bend = subtract(turn, apply(get9(near, k, CURVED), way))
        a, b = take3(model.lean, i, 0), take3(model.lean, i, 3)
        c = math.sqrt(dot(a, a)) * dot(tangent_of(q, k), turn) - dot(b, way)  # by how much it runs on
        put3(work.pull, i, 0, add(scale(-near[k, PRESS], bend), scale(c, b)))
        put3(work.G, slot_of(net, i), 0, scale(c, a))


@viewing
def follow_corner(net: Net, near: Array, on: Array, i: int, k: int, body: int, origin: Array, axis: int) -> None:
    """The same of contact i, at node k between two bodies, or three."""
    model, work = model_of(net.ints, net.floats), work_of(net.ints, net.space)
    unit = (1.0 if axis % 3 == 0 else 0.0, 1.0 if axis % 3 == 1 else 0.0, 1.0 if axis % 3 == 2 else 0.0)
    way = unit if axis < 3 else cross(unit, subtract(take3(near, k, SPOT), get3(origin, 0)))
    n, m = take3(near, k, NORMAL), take3(near, k, SECOND_NORMAL)
    a = dot(way, n) if on[k, 0] == body else 0.0
    b = dot(way, m) if on[k, SECOND] == body else 0.0
    c = dot(way, take3(near, k, THIRD_NORMAL)) if on[k, THIRD] == body else 0.0
    put3(model.given, i, 0, way_out(near, on, k, a, b, c))
    pull = NONE  # of what three hold nothing is to be balanced: no way is free
    if on[k, 0] == body:
        turn = NONE if axis < 3 else cross(unit, n)
        pull = scale(-near[k, PRESS], subtract(turn, apply(get9(near, k, CURVED), way)))
    if on[k, SECOND] == body:
        turn = NONE if axis < 3 else cross(unit, m)
        bend = subtract(turn, apply(get9(near, k, SECOND_CURVED), way))
        pull = add(pull, scale(-near[k, SECOND_PRESS], bend))
    put3(work.pull, i, 0, pull)


@kernel
def body_columns(
    net: Net, q: Array, near: Array, on: Array, body: int, origin: Array, points: int, out: Array, df: Array
) -> None:
    """Fills out (points, 3, 6) with the change of the positions as a body moves: velocity, then angular velocity.

    World axes, rotation about origin (1, 3) [m]. df (e, 6): as `respond.sensitivities`. The matrix must be factored.
    """
    ints, floats, sols, space = net.ints, net.floats, net.sols, net.space
    jumps = np.zeros((ints[N_SPANS], 3))
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    for axis in range(6):
        follow_body(net, q, near, on, body, origin, axis)
        solve(ints, floats, space)
        lead(plan, work)
        for c in range(df.shape[0]):
            df[c, axis] = pull_change(plan, model, sol, work, c)
        spread(ints, floats, sols, space, points, out, axis, jumps, part(space, 0, (0,)), part(space, 0, (0, 6)))
    still_knots(model)
