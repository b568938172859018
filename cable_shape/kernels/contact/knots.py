"""The network that cables are which lie on bodies: their contacts are knots of it, beside those that it has without.

A contact is a knot that turns freely and whose place is free along the surface; the step out of the surface is given,
by the gap. With the body's push p and the curvature H of its surface the place has the second derivative -p H. Which
network that is: :mod:`cable_shape.kernels.contact.lay`.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels.contact.link import close_in
from cable_shape.kernels.contact.near import (
    ACTIVE,
    BARE,
    CURVED,
    FLATTEST,
    GAP,
    LINKED,
    NONE,
    NORMAL,
    PRESS,
    PUSH,
    SECOND,
    SECOND_CURVED,
    SECOND_GAP,
    SECOND_NORMAL,
    SECOND_PRESS,
    SPOT,
    THIRD,
    THIRD_GAP,
    TOWARD,
    along_cable,
    pressed,
    tangent_of,
    way_out,
)
from cable_shape.kernels.contact.pair_friction import PULLED, pulled
from cable_shape.kernels.contact.tables import Lying, Net
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.drive import strip
from cable_shape.kernels.network.material import add_up, fill
from cable_shape.kernels.network.tables import (
    GRIP,
    LENGTH,
    N_KNOTS,
    TRIAL,
    Model,
    copy,
    model_of,
    plan_of,
    solution_of,
    work_of,
)
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
    madd,
    mscale,
    put3,
    put9,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
)
from cable_shape.kernels.rod_element import IDENTITY

NOWHERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@viewing
def mesh(net: Net, s: Array) -> None:
    """Puts the nodes there, and what the elements between them are made of."""
    plan, model = plan_of(net.ints), model_of(net.ints, net.floats)
    for x in range(plan.ends.shape[0]):
        for e in range(plan.first[x], plan.first[x + 1] + 1):
            model.s[e + x] = s[e + net.cable[x]]
    add_up(net.ints, net.floats)
    fill(net.ints, net.floats)


@viewing
def place_nodes(net: Net, s: Array) -> None:
    """The same, if they are elsewhere."""
    plan, model = plan_of(net.ints), model_of(net.ints, net.floats)
    moved = 0
    for x in range(plan.ends.shape[0]):
        for e in range(plan.first[x], plan.first[x + 1] + 1):
            moved += model.s[e + x] != s[e + net.cable[x]]
    if moved > 0:
        mesh(net, s)


@viewing
def put(net: Net, lying: Lying, which: int, near: Array, normal: int) -> None:
    """Fills the network's trial with solution `which`: rotations, forces, places.

    near (n, 22) is that of `which`, or has other normals of its contacts; normal: its column with their directions.
    """
    ints, floats, sols = net.ints, net.floats, net.sols
    plan, model, sol = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, TRIAL)
    q, on, ends, grips = lying.q[which], lying.on[which], lying.ends[which], lying.grips[which]
    known, supports = net.bare[N_KNOTS], lying.held.shape[0]
    for c in range(sol.grip.shape[0]):
        copy(sol.grip[c], lying.slid[which, supports + c * GRIP :])
    strip(ints, floats, sols)
    for x in range(plan.ends.shape[0] - 1, -1, -1):
        c = net.cable[x]
        for e in range(plan.first[x], plan.first[x + 1] + 1):
            sol.q[e + x, 0], sol.q[e + x, 1], sol.q[e + x, 2], sol.q[e + x, 3] = get4(q, e + c)
        if plan.known[x] != 0:
            continue
        knot = plan.ends[x, 1]
        if knot < known:
            force = get3(ends, net.stretch[x])
        else:
            k = net.where[knot]
            force = add(add(get3(sol.lam, x + 1), get3(model.weight, x + 1)), get3(model.force, knot))
            force = add(force, pressed(near, k, normal))
            force = add(force, scale(near[k, PUSH], take3(near, k, TOWARD)))
            if on[k, LINKED] == ACTIVE:
                force = add(force, pulled(lying.rubs[which], on, k, PULLED))
        put3(sol.lam, x, 0, force)
    for i in range(plan.vertices.shape[0]):
        k = net.where[i]
        if i < known:
            for c in range(7):
                sol.pose[i, c] = grips[i, c]
        else:
            put3(sol.pose, i, 0, take3(near, k, SPOT))
        if plan.vertices[i, 0] >= 0 and k >= 0:
            sol.pose[i, 3], sol.pose[i, 4], sol.pose[i, 5], sol.pose[i, 6] = get4(q, k)


@viewing
def walk(net: Net, near: Array) -> None:
    """Places of the nodes, from the knots that are no contacts on, and of knots that nothing holds."""
    plan, sol = plan_of(net.ints), solution_of(net.ints, net.sols, TRIAL)
    first = work_of(net.ints, net.space).first
    for way in net.tour:
        j = abs(way) - 1
        a, b = net.piece[j], net.piece[j + 1]
        c = net.cable[a]
        if way > 0:
            r = take3(sol.pose, plan.ends[a, 0], 0)
            if a == plan.cables[c]:
                put3(near, plan.first[a] + c, SPOT, r)
            for e in range(plan.first[a], plan.first[b]):
                r = subtract(r, take3(first, e, 0))
                put3(near, e + c + 1, SPOT, r)
            if plan.known[b - 1] != 0:
                put3(sol.pose, plan.ends[b - 1, 1], 0, r)
        else:
            r = take3(sol.pose, plan.ends[b - 1, 1], 0)
            put3(near, plan.first[b] + c, SPOT, r)
            for e in range(plan.first[b] - 1, plan.first[a] - 1, -1):
                r = add(r, take3(first, e, 0))
                put3(near, e + c, SPOT, r)
            put3(sol.pose, plan.ends[a, 0], 0, r)


@viewing
def close(net: Net, near: Array) -> None:
    """Puts contacts where the cable leads, and what it misses other places by into the closures."""
    plan, sol, work = plan_of(net.ints), solution_of(net.ints, net.sols, TRIAL), work_of(net.ints, net.space)
    for x in range(plan.ends.shape[0]):
        knot = plan.ends[x, 1]
        spot = take3(near, plan.first[x + 1] + net.cable[x], SPOT)
        if knot >= net.bare[N_KNOTS]:
            put3(sol.pose, knot, 0, spot)
            put3(work.sums, x, 0, NONE)
        else:
            put3(work.sums, x, 0, subtract(take3(sol.pose, knot, 0), spot))


@viewing
def on_surface(t: Vector, n: Vector) -> Matrix:
    """Two directions at right angles to n as columns, the first next to t, and zeros.

    Along the cable spans are by far the stiffest: what is not mixed with it keeps all its digits.
    """
    a = cross(n, t)
    size = math.sqrt(dot(a, a))
    if size < 1e-3:  # a cable that stands on the surface
        a = cross(n, (0.0, 1.0, 0.0) if abs(n[0]) > 0.6 else (1.0, 0.0, 0.0))
        size = math.sqrt(dot(a, a))
    b = scale(1.0 / size, a)
    a = cross(b, n)
    return (a[0], b[0], 0.0, a[1], b[1], 0.0, a[2], b[2], 0.0)


@viewing
def slot_of(net: Net, i: int) -> int:
    """The network's node where the span before contact i ends."""
    return plan_of(net.ints).first[net.span[i] + 1] + net.span[i]


@viewing
def press_on(net: Net, q: Array, h: Array, near: Array, on: Array, least: float, flex: Array, drag: float,
             factored: bool) -> float:  # fmt: skip
    """Tells the model how contacts press without friction, but for the steps that close gaps; returns the largest gap
    [m].

    factored: the factors at hand serve, and the model they are of stays.

    A contact that runs along the cable is nowhere nearer than at its node: the least distance has the second derivative
    y . H y - (b . y + a . theta)^2 / g'', b = H t and a . theta the turn of the tangent into the normal. Its running on
    from the node to the nearest point goes to the right-hand side. drag: of a cable that slides, see `press`.
    """
    plan, model, work = plan_of(net.ints), model_of(net.ints, net.floats), work_of(net.ints, net.space)
    largest = 0.0
    for i in range(net.bare[N_KNOTS], plan.vertices.shape[0]):
        k = net.where[i]
        if on[k, LINKED] == ACTIVE:
            push = scale(near[k, PUSH], take3(near, k, TOWARD))
            put3(work.pull, i, 0, subtract(get3(work.pull, i), push))
        if on[k, 0] == BARE:
            if not factored:
                stand_free(model, i, drag)
            continue
        n = take3(near, k, NORMAL)
        force = max(near[k, PRESS], 0.0)
        H = get9(near, k, CURVED)
        if on[k, SECOND] != BARE:
            largest = max(largest, press_into_corner(net, near, on, i, k, drag, factored))
            continue
        pull = get3(work.pull, i)  # no force out of the surface is unbalanced, whatever plane the factors are of
        put3(work.pull, i, 0, subtract(pull, scale(dot(pull, n), n)))
        if not factored:
            put9(model.along, i, 0, on_surface(tangent_of(q, k), n))
            put9(model.bent, i, 0, mscale(-force, H))
            for c in range(3):
                model.bent[i, 4 * c] -= drag / model.par[LENGTH]
            for c in range(6):
                model.lean[i, c] = 0.0
        second = along_cable(q, h, near, on, k, least, flex)
        if second > 0.0 and near[k, PRESS] > 0.0:
            f = math.sqrt(force / second)
            N = tapply(rotation(get4(q, k)), n)
            t = tangent_of(q, k)
            a, b = (-f * N[1], f * N[0], 0.0), scale(f, apply(H, t))
            if not factored:
                put3(model.lean, i, 0, a)
                put3(model.lean, i, 3, b)
            miss = f * dot(t, n)
            node = slot_of(net, i)
            put3(work.G, node, 0, add(get3(work.G, node), scale(miss, a)))
            put3(work.pull, i, 0, add(get3(work.pull, i), scale(miss, b)))
        largest = max(largest, abs(near[k, GAP]))
    return largest


@viewing
def press_into_corner(net: Net, near: Array, on: Array, i: int, k: int, drag: float, factored: bool) -> float:
    """The same of contact i, at node k between two bodies: its place is free along the edge where they meet.

    Between three it is where they meet, and no way is free.
    """
    model, work = model_of(net.ints, net.floats), work_of(net.ints, net.space)
    if on[k, THIRD] != BARE:
        put3(work.pull, i, 0, NONE)
        if not factored:
            put9(model.along, i, 0, NOWHERE)
            put9(model.bent, i, 0, NOWHERE)
            for c in range(6):
                model.lean[i, c] = 0.0
        return max(abs(near[k, GAP]), abs(near[k, SECOND_GAP]), abs(near[k, THIRD_GAP]))
    e = cross(take3(near, k, NORMAL), take3(near, k, SECOND_NORMAL))
    e = scale(1.0 / math.sqrt(max(dot(e, e), FLATTEST)), e)
    pull = get3(work.pull, i)
    put3(work.pull, i, 0, scale(dot(pull, e), e))
    if not factored:
        put9(model.along, i, 0, (e[0], 0.0, 0.0, e[1], 0.0, 0.0, e[2], 0.0, 0.0))
        put9(model.bent, i, 0, mscale(-max(near[k, PRESS], 0.0), get9(near, k, CURVED)))
        second = mscale(-max(near[k, SECOND_PRESS], 0.0), get9(near, k, SECOND_CURVED))
        put9(model.bent, i, 0, madd(get9(model.bent, i, 0), second))
        for c in range(3):
            model.bent[i, 4 * c] -= drag / model.par[LENGTH]
        for c in range(6):
            model.lean[i, c] = 0.0
    return max(abs(near[k, GAP]), abs(near[k, SECOND_GAP]))


@viewing
def stand_free(model: Model, i: int, drag: float) -> None:
    """Tells the model that no body presses on contact i."""
    put9(model.along, i, 0, IDENTITY)
    for c in range(9):
        model.bent[i, c] = -drag / model.par[LENGTH] if c % 4 == 0 else 0.0
    for c in range(6):
        model.lean[i, c] = 0.0


@viewing
def step_out(net: Net, lying: Lying, near: Array, on: Array, share: float) -> None:
    """Gives contacts, and pairs of them, the steps that close their gaps, or none: share 1 or 0."""
    close_in(net, lying, near, share)
    given = model_of(net.ints, net.floats).given
    for i in range(net.bare[N_KNOTS], given.shape[0]):
        k = net.where[i]
        if on[k, 0] == BARE:
            put3(given, i, 0, NONE)
            continue
        a, b, c = near[k, GAP], near[k, SECOND_GAP], near[k, THIRD_GAP]
        put3(given, i, 0, scale(-share, way_out(near, on, k, a, b, c)))


@viewing
def from_model(net: Net, s: Array, h: Array) -> None:
    """Takes the arc lengths of the nodes back, after the cable has run through its eyelets."""
    plan, model = plan_of(net.ints), model_of(net.ints, net.floats)
    for x in range(plan.ends.shape[0]):
        c = net.cable[x]
        for e in range(plan.first[x], plan.first[x + 1] + 1):
            s[e + c] = model.s[e + x]
        for e in range(plan.first[x], plan.first[x + 1]):
            h[e + c] = s[e + c + 1] - s[e + c]
