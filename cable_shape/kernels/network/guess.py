"""Where Newton's method starts from nothing: every span hangs, or is a Bezier curve of the right length.

A knot that leaves the tangent free gets that of its neighbours' chord, or, where spans hang, the mean of those of the
two spans hanging alone. Rotations follow the tangents without twist but for what ends that hold the roll ask for.
"""

from __future__ import annotations

import numpy as np
from numba import types

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.predict import put_rotation, rotation_of
from cable_shape.kernels.network.tables import (
    TRIAL,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    model_of,
    plan_of,
    solution_of,
)
from cable_shape.kernels.rod_algebra import (
    Quaternion,
    Vector,
    add,
    dot,
    get3,
    get4,
    put3,
    qmul,
    scale,
    subtract,
)
from cable_shape.kernels.rod_guess import (
    bezier_tangents,
    carry_frames,
    hanging_force,
    hanging_tangents,
    natural_frames,
    norm,
    perpendicular,
    tangent,
)

HANGING, CURVED, WAVY = 0, 1, 2
WEAK = 1e-3  # of a span's own load, at a tip that carries none: it has a direction nevertheless


@inline
def end_frame(plan: Plan, model: Model, sol: Solution, j: int, end: int) -> Quaternion:
    """The frame of an end of span j, by the rotation of its knot."""
    q = rotation_of(sol.pose, plan.ends[j, end])
    if plan.turned[j, end] == 0:
        return q
    f = model.frame
    return qmul(q, (f[j, end, 0], f[j, end, 1], f[j, end, 2], f[j, end, 3]))


@inline
def given_tangent(plan: Plan, model: Model, placed: Whole, j: int, end: int) -> bool:
    """Whether the tangent at an end is that of its knot: held, in a hinge, or at a knot whose rotation was guessed."""
    knot = plan.ends[j, end]
    if plan.tied[j, end] == 0:
        return bool(model.free[j, end, 0] == 0.0)
    return bool(model.loose[knot, 0] == 0.0 or placed[knot] != 0)


@inline
def given_roll(plan: Plan, model: Model, placed: Whole, j: int, end: int) -> bool:
    """Whether the roll at an end is that of its knot."""
    knot = plan.ends[j, end]
    if plan.tied[j, end] == 0:
        return bool(model.free[j, end, 2] == 0.0)
    return bool(model.loose[knot, 2] == 0.0 or placed[knot] != 0)


@inline
def length_of(plan: Plan, model: Model, j: int) -> float:
    """[m], of span j."""
    return float(model.s[plan.first[j + 1] + j] - model.s[plan.first[j] + j])


@inline
def bend_of(plan: Plan, model: Model, j: int) -> float:
    """[N m^2], the mean bending stiffness where span j begins."""
    return float(0.5 * (model.section[plan.first[j], 0] + model.section[plan.first[j], 1]))


@inline
def mean_load(plan: Plan, model: Model, j: int) -> Vector:
    """[N/m], of span j."""
    return scale(1.0 / length_of(plan, model, j), get3(model.weight, j))


@inline
def from_start(s: Floats, local: Floats) -> None:
    """Fills the head of `local` with arc lengths from the first on."""
    for k in range(s.shape[0]):
        local[k] = s[k] - s[0]


@viewing(forceinline=True)
def directions(plan: Plan, model: Model, sol: Solution, placed: Whole, kind: int, T: Floats, small: Floats) -> None:
    """Fills T (m, 2, 3), the tangents at both ends of each span."""
    force, free, load, span = small[0:3], small[3:5], small[5:8], small[8:11]
    free[:] = 0.0
    up = (0.0, 0.0, 1.0)
    for j in range(T.shape[0]):
        first = last = tangent(end_frame(plan, model, sol, j, 0))
        if plan.known[j] == 0:
            chord = subtract(get3(sol.pose, plan.ends[j, 1]), get3(sol.pose, plan.ends[j, 0]))
            first = last = chord
            if kind == HANGING:
                length = length_of(plan, model, j)
                for i in range(3):
                    span[i], load[i] = chord[i], model.weight[j, i] / length
                hanging_force(
                    span, load, length, model.section[plan.first[j], 5], bend_of(plan, model, j), up, up, free, force
                )
                last = (force[0], force[1], force[2])
                first = add(last, get3(model.weight, j))
                first = scale(1.0 / max(norm(first), 1e-300), first)
                last = scale(1.0 / max(norm(last), 1e-300), last)
        for end in range(2):
            t = first if end == 0 else last
            for i in range(3):
                T[j, end, i] = t[i]
    for j in range(T.shape[0]):
        # where a cable runs on through a knot both spans have one tangent
        if j > 0 and plan.ends[j, 0] == plan.ends[j - 1, 1] and plan.tied[j, 0] != 0 and plan.tied[j - 1, 1] != 0:
            before = (T[j - 1, 1, 0], T[j - 1, 1, 1], T[j - 1, 1, 2])
            after = (T[j, 0, 0], T[j, 0, 1], T[j, 0, 2])
            t = before if plan.known[j] != 0 else add(before, after)
            for i in range(3):
                T[j, 0, i] = T[j - 1, 1, i] = t[i]
    for j in range(T.shape[0]):
        for end in range(2):
            t = (T[j, end, 0], T[j, end, 1], T[j, end, 2])
            if given_tangent(plan, model, placed, j, end):
                t = tangent(end_frame(plan, model, sol, j, end))
            size = norm(t)
            t = scale(1.0 / size, t) if size > 1e-12 else perpendicular((0.0, 0.0, 1.0))
            for i in range(3):
                T[j, end, i] = t[i]


@kernel
def guess(ints: Whole, floats: Floats, sols: Floats, placed: Whole, kind: int, sag: float, wound: bool) -> None:
    """Fills the trial's rotations and forces for the knots as they are there.

    kind: HANGING; CURVED: Bezier curves, tilted by `sag` to the side of the load; WAVY: to either side in turn.
    placed (k,): 1 where the rotation of a knot that turns is a guess to be met, too. wound: the signs of quaternions
    are those of a winding.
    """
    T, t = np.empty((ints[1], 2, 3)), np.empty((ints[0] + ints[1], 3))
    lay(ints, floats, sols, placed, kind, sag, wound, T, t, np.empty(ints[0] + ints[1]), np.empty(17))


@viewing
def lay(
    ints: Whole, floats: Floats, sols: Floats, placed: Whole, kind: int, sag: float, wound: bool, T: Floats, t: Floats,
    local: Floats, small: Floats,
) -> None:  # fmt: skip
    """`guess` with room for the tangents T (m, 2, 3) at the ends of spans and t (n, 3) at the nodes, and 17 numbers."""
    plan, model, sol = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, TRIAL)
    spans = sol.lam.shape[0]
    directions(plan, model, sol, placed, kind, T, small)
    force, held, load, span = small[0:3], small[3:5], small[5:8], small[8:11]
    for j in range(spans):
        a, b = plan.first[j] + j, plan.first[j + 1] + j
        length, bend = length_of(plan, model, j), bend_of(plan, model, j)
        from_start(model.s[a : b + 1], local)
        t0, t1 = (T[j, 0, 0], T[j, 0, 1], T[j, 0, 2]), (T[j, 1, 0], T[j, 1, 1], T[j, 1, 2])
        f = mean_load(plan, model, j)
        for end in range(2):  # at an end that turns for itself the cable leaves as it likes
            held[end] = 0.0 if plan.tied[j, end] == 0 and model.free[j, end, 0] != 0.0 else 1.0
        for i in range(3):
            load[i] = f[i]
        if plan.known[j] != 0:
            hang_free(plan, model, sol, j, t0, t1, f, load, held, force, local[: b - a + 1], t[a : b + 1])
            continue
        c = subtract(get3(sol.pose, plan.ends[j, 1]), get3(sol.pose, plan.ends[j, 0]))
        for i in range(3):
            span[i] = c[i]
        if kind == HANGING:
            hanging_force(span, load, length, model.section[plan.first[j], 5], bend, t0, t1, held, force)
            hanging_tangents(local[: b - a + 1], load, force, bend, t0, t1, held, t[a : b + 1])
            for i in range(3):
                sol.lam[j, i] = force[i]
        else:
            chord = norm(c)
            along = scale(1.0 / chord, c) if chord > 0.0 else perpendicular(t0)
            down = subtract(f, scale(dot(f, along), along))
            size = norm(down)
            down = scale(1.0 / size, down) if size > 0.0 else perpendicular(along)
            t0 = t0 if held[0] != 0.0 else along
            t1 = t1 if held[1] != 0.0 else along
            side = -sag if kind == WAVY and j % 2 == 1 else sag
            bezier_tangents(local[: b - a + 1], span, t0, t1, scale(side, down), t[a : b + 1])
            pull = scale(bend / length**2, along)  # where there is no force at all the Hessian has 1 / |n| in it
            put3(sol.lam, j, 0, add(scale(-0.5, get3(model.weight, j)), pull))
        for end in range(2):
            if held[end] != 0.0:
                put3(t, b if end == 1 else a, 0, (T[j, end, 0], T[j, end, 1], T[j, end, 2]))
    rotations(plan, model, sol, placed, kind, wound, t, local, small[11:17].reshape(2, 3))


@viewing(late=types.none)
def hang_free(
    plan: Plan, model: Model, sol: Solution, j: int, t0: Vector, t1: Vector, f: Vector, load: Floats, held: Floats,
    force: Floats, local: Floats, t: Floats,
) -> None:  # fmt: skip
    """Tangents of a span whose force is known."""
    tip = get3(sol.lam, j)
    length = length_of(plan, model, j)
    if norm(tip) < WEAK * norm(f) * length:
        tip = scale(WEAK * length, f)
    if norm(tip) > 0.0:
        for i in range(3):
            force[i] = tip[i]
        hanging_tangents(local, load, force, bend_of(plan, model, j), t0, t1, held, t)
    else:
        for k in range(t.shape[0]):
            put3(t, k, 0, t0)


@viewing(forceinline=True)
def rotations(
    plan: Plan,
    model: Model,
    sol: Solution,
    placed: Whole,
    kind: int,
    wound: bool,
    t: Floats,
    local: Floats,
    ends: Floats,
) -> None:
    """Rotations along the tangents t (n, 3), from one end that holds the roll to the next; knots take theirs."""
    q = sol.q
    begin = 0
    for j in range(plan.known.shape[0]):
        on = j + 1 < plan.known.shape[0] and plan.ends[j + 1, 0] == plan.ends[j, 1] and plan.tied[j, 1] != 0
        if on and plan.tied[j + 1, 0] != 0 and not given_roll(plan, model, placed, j, 1):
            continue
        a, b = plan.first[begin] + begin, plan.first[j + 1] + j
        p, r = end_frame(plan, model, sol, begin, 0), end_frame(plan, model, sol, j, 1)
        if (
            p[0] * r[0] + p[1] * r[1] + p[2] * r[2] + p[3] * r[3] < 0.0
            and plan.turned[begin, 0] + plan.turned[j, 1] > 0
        ):
            r = (-r[0], -r[1], -r[2], -r[3])
        q[a, 0], q[a, 1], q[a, 2], q[a, 3] = p
        q[b, 0], q[b, 1], q[b, 2], q[b, 3] = r
        for end in range(2):
            k = begin if end == 0 else j
            bent = 0.0 if given_tangent(plan, model, placed, k, end) else 1.0
            ends[end, 0] = ends[end, 1] = bent
            ends[end, 2] = 0.0 if given_roll(plan, model, placed, k, end) else 1.0
        from_start(model.s[a : b + 1], local)
        carry_frames(local[: b - a + 1], t[a : b + 1], ends, q[a : b + 1])
        if plan.known[j] != 0 and kind != HANGING and plan.tied[j, 1] == 0:
            a = plan.first[j] + j
            natural_frames(model.h[plan.first[j] : plan.first[j + 1]], model.rest[plan.first[j] :], q[a : b + 1])
        begin = j + 1
    for j in range(plan.known.shape[0]):
        for end in range(2):
            knot = plan.ends[j, end]
            if (
                plan.tied[j, end] != 0
                and plan.vertices[knot, 0] >= 0
                and placed[knot] == 0
                and plan.turned[j, end] == 0
            ):
                put_rotation(sol.pose, knot, get4(q, plan.first[j + end] + j))
