"""The network that a cable is which lies on bodies: held nodes and contacts are its knots, spans lie between them.

A contact is a knot that turns freely and whose place is free along the surface; the step out of the surface is given,
by the gap. With the body's push p and the curvature H of its surface the place has the second derivative -p H.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import (
    BARE,
    CURVED,
    GAP,
    NONE,
    NORMAL,
    PRESS,
    SPOT,
    along_cable,
    tangent_of,
)
from cable_shape.kernels.contact.tables import Lying, Net
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.material import add_up, fill
from cable_shape.kernels.network.tables import (
    HEAD,
    LENGTH,
    N_BLOCKS,
    N_CABLES,
    N_ELEMENTS,
    N_KNOTS,
    N_PRESSED,
    N_RINGS,
    N_SPANS,
    N_STRIPPED,
    N_TARGETS,
    N_VERTICES,
    TRIAL,
    UNKNOWN,
    Floats,
    Plan,
    Whole,
    copy,
    copy_rows,
    model_of,
    model_size,
    plan_of,
    solution_of,
    solution_size,
    work_of,
    work_size,
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


@kernel
def room_for(bare: Whole, elements: int) -> tuple[int, int, int, int, int]:
    """Numbers of plan, model, one solution, work space and eyelets where every node of a mesh may be a knot."""
    head = bare[:HEAD].copy()
    n, m, k = elements, elements, elements + 1
    v = 3 * k
    head[N_ELEMENTS], head[N_SPANS], head[N_KNOTS], head[N_VERTICES], head[N_PRESSED] = n, m, k, v, k
    head[N_BLOCKS], head[N_TARGETS] = 2 * v, 3 * v
    e = head[N_RINGS]
    own = HEAD + n + 23 * m + 2 * k + 8 * v + 2 * head[N_STRIPPED] + 5 * head[N_CABLES] + 2 * e + 6
    run = e * (12 * n + 9 * m + 6 * k + 2 * e + 2) + 4 * n + 14 * m + 3 * k if e > 0 else 0
    return own, model_size(head), solution_size(head), work_size(head), run


@viewing
def same_knots(held: Whole, on: Array, where: Whole, knots: int) -> bool:
    """Whether these are the knots of the network as it is laid."""
    if knots == 0:
        return False
    i = 0
    for j in range(held.shape[0]):
        if i >= knots or where[i] != held[j]:
            return False
        i += 1
        if j + 1 < held.shape[0]:
            for k in range(held[j] + 1, held[j + 1]):
                if on[k, 0] != BARE:
                    if i >= knots or where[i] != k:
                        return False
                    i += 1
    return i == knots


@viewing
def find_knots(held: Whole, on: Array, where: Whole, base: Whole) -> int:
    """Fills where and base; returns the number of knots."""
    count = 0
    for j in range(held.shape[0]):
        where[count], base[count] = held[j], j
        count += 1
        if j + 1 < held.shape[0]:
            for k in range(held[j] + 1, held[j + 1]):
                if on[k, 0] != BARE:
                    where[count], base[count] = k, -1
                    count += 1
    return count


@inline
def unknowns(old: Plan, base: Whole, i: int, forces: int) -> tuple[int, int, int]:
    """Of knot i, 1 or 0: whether its place and its rotation are vertices, and the force of the span behind it.

    forces: how many spans have an unknown force. That of a span between held places is condensed.
    """
    pressed = base[i] < 0
    turn = pressed or old.vertices[max(base[i], 0), 0] >= 0
    force = i < forces and (pressed or base[i + 1] < 0)
    return int(pressed), int(turn), int(force)


@viewing
def join(plan: Plan) -> None:
    """Fills in which vertices have a block with which later ones, and where pairs of these are updated.

    The order is that along the cable: place, rotation, force of the span behind, with the two next of these.
    """
    at = goals = v = 0
    for i in range(plan.vertices.shape[0]):
        place, turn = plan.vertices[i, 1], plan.vertices[i, 0]
        force = after_place = after_turn = -1
        if i + 1 < plan.vertices.shape[0]:
            force, after_place, after_turn = plan.forces[i, 0], plan.vertices[i + 1, 1], plan.vertices[i + 1, 0]
        for own, first, second in ((place, turn, force), (turn, force, after_turn), (force, after_place, after_turn)):
            if own < 0:
                continue
            plan.pointer[v], plan.goal[v] = at, goals
            v += 1
            for beside in (first, second):
                if beside >= 0:
                    plan.neighbour[at] = beside
                    at += 1
            count = at - plan.pointer[own]
            goals += count * (count + 1) // 2
    plan.pointer[v], plan.goal[v] = at, goals
    t = 0
    for v in range(plan.pointer.shape[0] - 1):
        for a in range(plan.pointer[v], plan.pointer[v + 1]):
            for b in range(a, plan.pointer[v + 1]):
                x, y = plan.neighbour[a], plan.neighbour[b]
                plan.target[t] = -1 - x if x == y else block_of(plan, x, y)
                t += 1


@viewing
def block_of(plan: Plan, a: int, b: int) -> int:
    """Where the block of vertices a < b is; 0 if either is not there."""
    if a < 0 or b < 0:
        return 0
    for i in range(plan.pointer[a], plan.pointer[a + 1]):
        if plan.neighbour[i] == b:
            return i
    return 0


@viewing
def lay(
    bare: Whole, made: Floats, s: Array, where: Whole, base: Whole, knots: int, ints: Whole, floats: Floats
) -> None:
    """Fills plan and model but for the mesh's arc lengths, for these knots; vertices are numbered along the cable."""
    old = plan_of(bare)
    copy(ints[:HEAD], bare[:HEAD])
    spans, elements = knots - 1, where[knots - 1]
    ints[N_ELEMENTS], ints[N_SPANS], ints[N_KNOTS], ints[N_PRESSED] = elements, spans, knots, knots
    stripped = bare[N_STRIPPED]
    ints[UNKNOWN] = 3 * (spans - stripped)
    vertices = blocks = targets = 0
    for i in range(knots):  # sizes: see `join`
        place, turn, force = unknowns(old, base, i, spans - stripped)
        after_place, after_turn, _ = unknowns(old, base, i + 1, spans - stripped) if i < spans else (0, 0, 0)
        for own, beside in ((place, turn + force), (turn, force + after_turn), (force, after_place + after_turn)):
            vertices += own
            blocks += own * beside
            targets += own * (beside * (beside + 1) // 2)
    ints[N_VERTICES], ints[N_BLOCKS], ints[N_TARGETS] = vertices, blocks, targets
    plan = plan_of(ints)
    v = 0
    for i in range(knots):
        place, turn, force = unknowns(old, base, i, spans - stripped)
        plan.vertices[i, 1] = v if place == 1 else -1
        plan.vertices[i, 0] = v + place if turn == 1 else -1
        if i < spans:
            plan.forces[i, 0] = v + place + turn if force == 1 else -1
        v += place + turn + force
    join(plan)
    plan.first[0] = 0
    for j in range(spans):
        plan.first[j + 1] = where[j + 1]
        for e in range(where[j], where[j + 1]):
            plan.left[e] = e + j
        plan.ends[j, 0], plan.ends[j, 1] = j, j + 1
        known = 1 if stripped > 0 and j == spans - 1 else 0
        plan.known[j] = known
        for end in range(2):
            i = j + end
            plan.tied[j, end] = 1 if plan.vertices[i, 0] >= 0 else 0
            plan.turned[j, end] = 0
            plan.corners[j, 2 * end] = plan.vertices[i, 0]
            plan.corners[j, 2 * end + 1] = plan.vertices[i, 1] if known == 0 else -1
        ta, ya, tb, yb = plan.corners[j, 0], plan.corners[j, 1], plan.corners[j, 2], plan.corners[j, 3]
        plan.blocks[j, 1], plan.blocks[j, 5] = block_of(plan, ta, tb), block_of(plan, yb, tb)
        force = plan.forces[j, 0]
        plan.forces[j, 1], plan.forces[j, 2] = block_of(plan, ta, force), block_of(plan, ya, force)
        plan.forces[j, 3], plan.forces[j, 4] = block_of(plan, force, tb), block_of(plan, force, yb)
    if stripped > 0:
        plan.stripped[0, 0], plan.stripped[0, 1] = spans - 1, 1
    plan.cables[0], plan.cables[1] = 0, spans
    for c in range(2):
        plan.pieces[c], plan.points[c] = old.pieces[c], old.points[c]
    for i in range(knots):
        if base[i] < 0:
            continue
        for c in range(2):
            if old.roll[0, c] == base[i]:
                plan.roll[0, c] = i
        for c in range(ints[N_RINGS]):
            if old.rings[c, 0] == base[i]:
                plan.rings[c, 0], plan.rings[c, 1] = i, i - 1
    take_over(bare, made, s, where, base, ints, floats)


@viewing
def take_over(bare: Whole, made: Floats, s: Array, where: Whole, base: Whole, ints: Whole, floats: Floats) -> None:
    """Fills what of the model is not of the mesh."""
    old, model = model_of(bare, made), model_of(ints, floats)
    copy(model.par, old.par)
    copy_cable(bare, made, s, where, base, ints, floats)
    for i in range(model.force.shape[0]):
        held = base[i]
        for c in range(3):
            model.loose[i, c] = old.loose[held, c] if held >= 0 else 1.0
        put9(model.along, i, 0, IDENTITY)
        for c in range(9):
            model.bent[i, c] = 0.0
        for c in range(6):
            model.lean[i, c] = 0.0
        put3(model.given, i, 0, NONE)
    for j in range(model.free.shape[0]):
        for end in range(2):
            held = base[j + end]
            for c in range(3):
                model.free[j, end, c] = old.free[max(held - end, 0), end, c] if held >= 0 else 0.0
            for c in range(4):
                model.frame[j, end, c] = 1.0 if c == 3 else 0.0


@viewing
def copy_cable(bare: Whole, made: Floats, s: Array, where: Whole, base: Whole, ints: Whole, floats: Floats) -> None:
    """Copies what the cable is made of and loaded with."""
    old, model = model_of(bare, made), model_of(ints, floats)
    copy(model.breaks, old.breaks)
    copy(model.at, old.at)
    copy_rows(model.heavy, old.heavy, 3)
    copy_rows(model.piece, old.piece, old.piece.shape[1])
    copy_rows(model.act, old.act, 3)
    for i in range(model.force.shape[0]):
        held = base[i]
        for c in range(3):
            model.force[i, c] = old.force[held, c] if held >= 0 else 0.0
            model.moment[i, c] = old.moment[held, c] if held >= 0 else 0.0
        for p in range(model.at.shape[0]):  # a point load where a body presses is the knot's
            if held < 0 and abs(model.at[p] - s[where[i]]) < 1e-9 * model.par[LENGTH]:
                put3(model.force, i, 0, add(get3(model.force, i), get3(model.act, p)))


@viewing
def mesh(ints: Whole, floats: Floats, s: Array) -> None:
    """Puts the nodes there, and what the elements between them are made of."""
    plan, model = plan_of(ints), model_of(ints, floats)
    for j in range(plan.ends.shape[0]):
        for k in range(plan.first[j], plan.first[j + 1] + 1):
            model.s[k + j] = s[k]
    add_up(ints, floats)
    fill(ints, floats)


@viewing
def place_nodes(net: Net, s: Array) -> None:
    """The same, if they are elsewhere."""
    plan, model = plan_of(net.ints), model_of(net.ints, net.floats)
    moved = 0
    for j in range(plan.ends.shape[0]):
        for k in range(plan.first[j], plan.first[j + 1] + 1):
            moved += model.s[k + j] != s[k]
    if moved > 0:
        mesh(net.ints, net.floats, s)


@viewing
def put(
    ints: Whole, floats: Floats, sols: Floats, q: Array, near: Array, normal: int, ends: Array, grips: Array,
    where: Whole, base: Whole,
) -> None:  # fmt: skip
    """Fills the trial: rotations, forces, places. normal: column of `near` with the directions of the pushes."""
    plan, model, sol = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, TRIAL)
    force = NONE
    for j in range(plan.ends.shape[0] - 1, -1, -1):
        for k in range(plan.first[j], plan.first[j + 1] + 1):
            sol.q[k + j, 0], sol.q[k + j, 1], sol.q[k + j, 2], sol.q[k + j, 3] = get4(q, k)
        held, k = base[j + 1], where[j + 1]
        if held < 0:
            force = add(add(force, get3(model.weight, j + 1)), get3(model.force, j + 1))
            force = add(force, scale(near[k, PRESS], take3(near, k, normal)))
        elif plan.known[j] != 0:
            force = get3(model.force, j + 1)
        else:
            force = get3(ends, held - 1)
        put3(sol.lam, j, 0, force)
    for i in range(plan.vertices.shape[0]):
        held, k = base[i], where[i]
        if held >= 0:
            for c in range(7):
                sol.pose[i, c] = grips[held, c]
        else:
            put3(sol.pose, i, 0, take3(near, k, SPOT))
        if plan.vertices[i, 0] >= 0:
            sol.pose[i, 3], sol.pose[i, 4], sol.pose[i, 5], sol.pose[i, 6] = get4(q, k)


@viewing
def close(ints: Whole, sols: Floats, space: Floats, near: Array, where: Whole, base: Whole) -> None:
    """Puts contacts where the cable leads, and what it misses held places by into the closures."""
    plan, sol, work = plan_of(ints), solution_of(ints, sols, TRIAL), work_of(ints, space)
    for j in range(plan.ends.shape[0]):
        spot = take3(near, where[j + 1], SPOT)
        if base[j + 1] < 0:
            put3(sol.pose, j + 1, 0, spot)
            put3(work.sums, j, 0, NONE)
        else:
            put3(work.sums, j, 0, subtract(take3(sol.pose, j + 1, 0), spot))


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
def press_on(
    ints: Whole, floats: Floats, space: Floats, q: Array, h: Array, near: Array, on: Array, where: Whole, base: Whole,
    least: float, flex: float, drag: float, factored: bool,
) -> float:  # fmt: skip
    """Tells the model how contacts press, but for the steps that close gaps; returns the largest gap [m].

    factored: the factors at hand serve, and the model they are of stays.

    A contact that runs along the cable is nowhere nearer than at its node: the least distance has the second derivative
    y . H y - (b . y + a . theta)^2 / g'', b = H t and a . theta the turn of the tangent into the normal. Its running on
    from the node to the nearest point goes to the right-hand side. drag: of a cable that slides, see `press`.
    """
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    largest = 0.0
    for i in range(plan.vertices.shape[0]):
        if base[i] >= 0:
            continue
        k = where[i]
        n = take3(near, k, NORMAL)
        force = max(near[k, PRESS], 0.0)
        H = get9(near, k, CURVED)
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
            node = k + i - 1  # at the end of the span before
            put3(work.G, node, 0, add(get3(work.G, node), scale(miss, a)))
            put3(work.pull, i, 0, add(get3(work.pull, i), scale(miss, b)))
        largest = max(largest, abs(near[k, GAP]))
    return largest


@viewing
def step_out(ints: Whole, floats: Floats, near: Array, where: Whole, base: Whole, share: float) -> None:
    """Gives contacts the steps that close their gaps, or none: share 1 or 0."""
    model = model_of(ints, floats)
    for i in range(model.given.shape[0]):
        k = where[i]
        gap = near[k, GAP] if base[i] < 0 else 0.0
        put3(model.given, i, 0, scale(-share * gap, take3(near, k, NORMAL)))


@viewing
def laid(net: Net, lying: Lying, on: Array) -> bool:
    """Makes the network that of the contacts on (N+1, 2) and of the mesh as it is; False if its knots are the same."""
    if same_knots(lying.held, on, net.where, net.ints[N_KNOTS]) and net.ints[N_CABLES] > 0:
        return False
    knots = find_knots(lying.held, on, net.where, net.base)
    lay(net.bare, net.made, lying.s, net.where, net.base, knots, net.ints, net.floats)
    mesh(net.ints, net.floats, lying.s)
    return True


@viewing
def from_model(ints: Whole, floats: Floats, s: Array, h: Array) -> None:
    """Takes the arc lengths of the nodes back, after the cable has run through its eyelets."""
    plan, model = plan_of(ints), model_of(ints, floats)
    for j in range(plan.ends.shape[0]):
        for k in range(plan.first[j], plan.first[j + 1] + 1):
            s[k] = model.s[k + j]
    for e in range(h.shape[0]):
        h[e] = s[e + 1] - s[e]
