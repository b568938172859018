"""The graph of what is unknown of the knots: assembled from condensed spans, factored by sparse block LDL^T.

A vertex is the rotation or the place of a knot, three rows. At a stable equilibrium all pivots are positive in any
order, so that the order (least degree first, see :mod:`cable_shape.solve.plan`) is made for sparsity alone; on a tree
nothing fills in beyond the spans' own blocks. Vertices are numbered in the order of elimination.
"""

from __future__ import annotations

from numba import types

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.condense import (
    BA,
    BB,
    CLOSURE,
    GA,
    GB,
    KAA,
    KBA,
    KBB,
    PRESS,
    SI,
    ZERO,
    condense,
    expand,
    expand_force,
    joined,
    reduce,
)
from cable_shape.kernels.network.system import FORCE, NONE
from cable_shape.kernels.network.tables import (
    L_ACTIVE,
    L_BENT,
    L_NORMAL,
    L_REST,
    LENGTH,
    Floats,
    Model,
    Plan,
    Whole,
    Work,
    model_of,
    plan_of,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    FAST,
    Matrix,
    Vector,
    add,
    apply,
    dot,
    get3,
    get9,
    inverse_by_pivots,
    madd,
    mscale,
    mshift,
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
    transpose,
)
from cable_shape.kernels.rod_element import IDENTITY


@inline
def to_knot(plan: Plan, model: Model, j: int, end: int) -> Matrix:
    """T with theta_end = T^T theta_knot: the end's frame in the knot's, without rotations that are held."""
    knot = plan.ends[j, end]
    a, b, c = model.loose[knot, 0], model.loose[knot, 1], model.loose[knot, 2]
    if plan.turned[j, end] == 0:
        return (a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c)
    x, y, z, w = model.frame[j, end, 0], model.frame[j, end, 1], model.frame[j, end, 2], model.frame[j, end, 3]
    R = rotation((x, y, z, w))
    return (a * R[0], a * R[1], a * R[2], b * R[3], b * R[4], b * R[5], c * R[6], c * R[7], c * R[8])


@inline
def add9(a: Floats, i: int, A: Matrix) -> None:
    """Adds a matrix to row i."""
    for c in range(9):
        a[i, c] += A[c]


@inline
def add_block(block: Floats, place: int, A: Matrix) -> None:
    """Adds a block, or its transpose where `place` is negative."""
    if place >= 0:
        add9(block, place, A)
    else:
        add9(block, -1 - place, transpose(A))


@inline
def any_moves(plan: Plan) -> bool:
    """Whether a knot's place is unknown."""
    moves = False
    for k in range(plan.vertices.shape[0]):
        moves = moves or plan.vertices[k, 1] >= 0
    return moves


@viewing(fastmath=FAST, forceinline=True)
def scatter(plan: Plan, model: Model, work: Work, j: int) -> None:
    """Adds the condensed span j to the graph."""
    if joined(plan, j):
        scatter_force(plan, model, work, j)
        return
    spans, size, block = work.spans, work.size, work.block
    ta, ya, tb, yb = plan.corners[j, 0], plan.corners[j, 1], plan.corners[j, 2], plan.corners[j, 3]
    S = get9(spans, j, SI) if plan.known[j] == 0 else ZERO
    Ta, Tb, A, B = ZERO, ZERO, ZERO, ZERO
    if ta >= 0:
        Ta = to_knot(plan, model, j, 0)
        Ba = get9(spans, j, BA)
        own = msub(get9(spans, j, KAA), mul(Ba, mul(S, transpose(Ba))))
        add9(size, ta, mul(Ta, mul(own, transpose(Ta))))
        A = mul(Ta, mul(Ba, S))
    if tb >= 0:
        Tb = to_knot(plan, model, j, 1)
        Bb = get9(spans, j, BB)
        own = msub(get9(spans, j, KBB), mul(Bb, mul(S, transpose(Bb))))
        add9(size, tb, mul(Tb, mul(own, transpose(Tb))))
        B = mul(Tb, mul(Bb, S))
    if ta >= 0 and tb >= 0:
        between = msub(get9(spans, j, KBA), mul(get9(spans, j, BB), mul(S, transpose(get9(spans, j, BA)))))
        add_block(block, plan.blocks[j, 1], transpose(mul(Tb, mul(between, transpose(Ta)))))
    if ya >= 0:
        add9(size, ya, mscale(-1.0, S))
        if ta >= 0:
            add_block(block, plan.blocks[j, 0], A)
        if tb >= 0:
            add_block(block, plan.blocks[j, 3], transpose(B))
    if yb >= 0:
        add9(size, yb, mscale(-1.0, S))
        if ta >= 0:
            add_block(block, plan.blocks[j, 2], mscale(-1.0, A))
        if tb >= 0:
            add_block(block, plan.blocks[j, 5], mscale(-1.0, B))
        if ya >= 0:
            add_block(block, plan.blocks[j, 4], S)
    if plan.known[j] != 0 and plan.forces.shape[0] > 0 and plan.vertices[plan.ends[j, 1], 1] >= 0:
        press(plan, model, work, j)


@inline
def scatter_force(plan: Plan, model: Model, work: Work, j: int) -> None:
    """The same beside a knot that is pressed on: the force stays, a vertex before the place where the span ends.

    Condensed, short spans would be springs of 1e8 N/m on both sides of such a place, whose difference is lost in
    rounding where the cable is limp; one after the other, their compliances add up.
    """
    spans, size, block = work.spans, work.size, work.block
    ta, ya, tb, yb = plan.corners[j, 0], plan.corners[j, 1], plan.corners[j, 2], plan.corners[j, 3]
    v = plan.forces[j, 0]
    add9(size, v, get9(spans, j, SI))
    Ta, Tb = ZERO, ZERO
    if ta >= 0:
        Ta = to_knot(plan, model, j, 0)
        add9(size, ta, mul(Ta, mul(get9(spans, j, KAA), transpose(Ta))))
        add_block(block, plan.forces[j, 1], mul(Ta, get9(spans, j, BA)))
    if tb >= 0:
        Tb = to_knot(plan, model, j, 1)
        add9(size, tb, mul(Tb, mul(get9(spans, j, KBB), transpose(Tb))))
        add_block(block, plan.forces[j, 3], transpose(mul(Tb, get9(spans, j, BB))))
    if ta >= 0 and tb >= 0:
        add_block(block, plan.blocks[j, 1], transpose(mul(Tb, mul(get9(spans, j, KBA), transpose(Ta)))))
    if ya >= 0:
        add_block(block, plan.forces[j, 2], mscale(-1.0, transpose(get9(model.along, plan.ends[j, 0], 0))))
    if yb >= 0:
        add_block(block, plan.forces[j, 4], get9(model.along, plan.ends[j, 1], 0))
        press(plan, model, work, j)


@inline
def press(plan: Plan, model: Model, work: Work, j: int) -> None:
    """Adds to the graph what presses on the knot where span j ends; its rotation comes after its place."""
    knot = plan.ends[j, 1]
    turn, v = plan.vertices[knot, 0], plan.vertices[knot, 1]
    Z = get9(model.along, knot, 0)
    own = tmul(Z, mul(get9(model.bent, knot, 0), Z))
    add9(work.size, v, msub(madd(own, IDENTITY), tmul(Z, Z)))
    a, b = take3(model.lean, knot, 0), tapply(Z, take3(model.lean, knot, 3))
    if a != NONE or b != NONE:
        add9(work.size, turn, outer(a, a))
        add9(work.size, v, outer(b, b))
        add_block(work.block, plan.blocks[j, 5], outer(b, a))


@viewing(fastmath=FAST)
def factor(ints: Whole, floats: Floats, space: Floats, shift: float) -> int:
    """Factors the whole matrix, `shift` times the lengths between nodes added; returns the number of negative
    eigenvalues."""
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    negative = 0
    vertices = plan.pointer.shape[0] - 1
    if vertices > 0:
        work.size[:, :] = 0.0
        work.block[:, :] = 0.0
    for j in range(plan.ends.shape[0]):
        negative += condense(plan, model, work, j, shift)
        if vertices > 0:
            scatter(plan, model, work, j)
    if vertices == 0:
        return negative
    hold_knots(plan, model, work, shift)
    tie(plan, model, work)
    return negative + eliminate(plan, work.size, work.block, work.diagonal)


@viewing(fastmath=FAST, forceinline=True)
def hold_knots(plan: Plan, model: Model, work: Work, shift: float) -> None:
    """Adds to the graph what is the knots' own: rotations that are held, and the shift."""
    for k in range(plan.vertices.shape[0]):
        v = plan.vertices[k, 0]
        if v >= 0:
            for i in range(3):
                if model.loose[k, i] == 0.0:
                    work.size[v, 4 * i] += 1.0
        v = plan.vertices[k, 1]
        if v >= 0:
            f = shift / model.par[LENGTH]
            if model.along.shape[0] > 0:
                Z = get9(model.along, k, 0)
                add9(work.size, v, mscale(f, tmul(Z, Z)))
            else:
                put9(work.size, v, 0, mshift(get9(work.size, v, 0), f))


@inline
def bent_of(model: Model, link: int, i: int) -> Matrix:
    """Block i of ten of the second derivative of a link, in the order of its upper triangle."""
    return get9(model.links, link, L_BENT + 9 * i)


@viewing(late=types.none)
def tie(plan: Plan, model: Model, work: Work) -> None:
    """Adds to the graph what knots that press on each other add: see :mod:`cable_shape.kernels.contact.link`."""
    size, block = work.size, work.block
    for i in range(plan.links.shape[0]):
        own = plan.links[i]
        a, b, push = own[0], own[1], own[2]
        Za, Zb = get9(model.along, a, 0), get9(model.along, b, 0)
        add9(size, plan.vertices[a, 0], bent_of(model, i, 0))
        add9(size, plan.vertices[a, 1], tmul(Za, mul(bent_of(model, i, 4), Za)))
        add9(size, plan.vertices[b, 0], bent_of(model, i, 7))
        add9(size, plan.vertices[b, 1], tmul(Zb, mul(bent_of(model, i, 9), Zb)))
        add_block(block, own[3], mul(bent_of(model, i, 1), Za))
        add_block(block, own[4], bent_of(model, i, 2))
        add_block(block, own[5], mul(bent_of(model, i, 3), Zb))
        add_block(block, own[6], tmul(Za, bent_of(model, i, 5)))
        add_block(block, own[7], tmul(Za, mul(bent_of(model, i, 6), Zb)))
        add_block(block, own[8], mul(bent_of(model, i, 8), Zb))
        add9(size, push, IDENTITY)
        if model.links[i, L_ACTIVE] != 0.0:
            size[push, 0] -= 1.0
            n = take3(model.links, i, L_NORMAL)
            add_block(block, own[9], column(scale(-1.0, tapply(Za, n))))
            add_block(block, own[10], column(tapply(Zb, n)))


@inline
def column(v: Vector) -> Matrix:
    """The matrix with v as its first column, and zeros."""
    return (v[0], 0.0, 0.0, v[1], 0.0, 0.0, v[2], 0.0, 0.0)


@viewing(late=types.none)
def pull_links(plan: Plan, model: Model, gap: Floats) -> None:
    """Adds to the right-hand side of the graph what links leave, and what they answer to the steps that are given."""
    for i in range(plan.links.shape[0]):
        a, b, push = plan.links[i, 0], plan.links[i, 1], plan.links[i, 2]
        ga, gb, n = get3(model.given, a), get3(model.given, b), take3(model.links, i, L_NORMAL)
        put3(gap, push, 0, NONE)
        if model.links[i, L_ACTIVE] != 0.0:
            gap[push, 0] = model.links[i, L_REST] - dot(n, ga) + dot(n, gb)
        ta, ya, tb, yb = plan.vertices[a, 0], plan.vertices[a, 1], plan.vertices[b, 0], plan.vertices[b, 1]
        add3(gap, ta, add(apply(bent_of(model, i, 1), ga), apply(bent_of(model, i, 3), gb)))
        add3(gap, ya, add(apply(bent_of(model, i, 4), ga), apply(bent_of(model, i, 6), gb)))
        add3(gap, tb, add(tapply(bent_of(model, i, 5), ga), apply(bent_of(model, i, 8), gb)))
        add3(gap, yb, add(tapply(bent_of(model, i, 6), ga), apply(bent_of(model, i, 9), gb)))


@inline
def add3(a: Floats, i: int, v: Vector) -> None:
    """Adds a vector to row i."""
    put3(a, i, 0, add(get3(a, i), v))


@viewing(fastmath=FAST, forceinline=True)
def eliminate(plan: Plan, size: Floats, block: Floats, diagonal: Floats) -> int:
    """Block LDL^T of the graph: inverse pivots into `diagonal`; returns how many eigenvalues are negative.

    `block` is left with the blocks of every vertex with its later neighbours as they are when it is eliminated.
    """
    negative = 0
    for v in range(diagonal.shape[0]):
        pivot = get9(size, v, 0)
        inv, below = inverse_by_pivots(pivot)
        negative += below
        put9(diagonal, v, 0, inv)
        t = plan.goal[v]
        for a in range(plan.pointer[v], plan.pointer[v + 1]):
            left = tmul(get9(block, a, 0), inv)
            for b in range(a, plan.pointer[v + 1]):
                update = mscale(-1.0, mul(left, get9(block, b, 0)))
                goal = plan.target[t]
                t += 1
                if goal < 0:
                    add9(size, -1 - goal, update)
                else:
                    add9(block, goal, update)
    return negative


@viewing(fastmath=FAST)
def solve(ints: Whole, floats: Floats, space: Floats) -> float:
    """Minus the inverse times the right-hand side G, sums[:, :3], pull, with the factors at hand.

    Fills d, the steps of the forces and of the knots; returns the largest step: of a rotation, or twice that of a place
    / length.
    """
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    vertices = plan.pointer.shape[0] - 1
    for j in range(plan.ends.shape[0]):
        reduce(plan, model, work, j)
    if vertices == 0:
        work.move[:, :] = 0.0
    else:
        collect(plan, model, work)
        substitute(plan, work)
    farthest = spread(plan, model, work)
    largest = 0.0
    for j in range(plan.ends.shape[0]):
        ta, ya, tb, yb = steps_of_ends(plan, model, work, j, vertices > 0)
        size = expand(plan, work, j, ta, ya, tb, yb)
        if not size <= largest:
            largest = size
    return max(largest**0.5, 2.0 * farthest**0.5 / model.par[LENGTH])


@viewing(fastmath=FAST)
def solve_forces(ints: Whole, floats: Floats, space: Floats) -> None:
    """The steps of the forces and of the knots that `solve` finds where of the right-hand side only `pull` is not 0."""
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    for j in range(plan.ends.shape[0]):
        for at in (CLOSURE, PRESS, GA, GB):
            put3(work.spans, j, at, NONE)
    collect(plan, model, work)
    substitute(plan, work)
    spread(plan, model, work)
    for j in range(plan.ends.shape[0]):
        ta, ya, tb, yb = steps_of_ends(plan, model, work, j, True)
        expand_force(plan, work, j, ta, ya, tb, yb)


@viewing(fastmath=FAST, forceinline=True)
def substitute(plan: Plan, work: Work) -> None:
    """Minus the inverse of the graph's matrix times `gap`, into `gap`."""
    gap, vertices = work.gap, plan.pointer.shape[0] - 1
    for v in range(vertices):
        eased = apply(get9(work.diagonal, v, 0), get3(gap, v))
        for a in range(plan.pointer[v], plan.pointer[v + 1]):
            n = plan.neighbour[a]
            put3(gap, n, 0, subtract(get3(gap, n), tapply(get9(work.block, a, 0), eased)))
    for v in range(vertices - 1, -1, -1):
        x = get3(gap, v)
        for a in range(plan.pointer[v], plan.pointer[v + 1]):
            x = add(x, apply(get9(work.block, a, 0), get3(gap, plan.neighbour[a])))
        put3(gap, v, 0, scale(-1.0, apply(get9(work.diagonal, v, 0), x)))


@viewing(fastmath=FAST, forceinline=True)
def spread(plan: Plan, model: Model, work: Work) -> float:
    """Fills `move`, the steps of the knots; returns the square of the longest of a place."""
    farthest = 0.0
    for k in range(plan.vertices.shape[0]):
        turn, way = plan.vertices[k, 0], plan.vertices[k, 1]
        put3(work.move, k, 0, get3(work.gap, turn) if turn >= 0 else NONE)
        y = get3(work.gap, way) if way >= 0 else NONE
        if model.given.shape[0] > 0:
            y = add(apply(get9(model.along, k, 0), y), get3(model.given, k))
        put3(work.move, k, 3, y)
        farthest = max(farthest, y[0] * y[0] + y[1] * y[1] + y[2] * y[2])
    return farthest


@inline
def steps_of_ends(
    plan: Plan, model: Model, work: Work, j: int, any_vertex: bool
) -> tuple[Vector, Vector, Vector, Vector]:
    """Steps of rotation (own frame) and place at the start and at the end of span j, as its knots move."""
    ta = ya = tb = yb = NONE
    if any_vertex:
        a, b = plan.ends[j, 0], plan.ends[j, 1]
        ya, yb = take3(work.move, a, 3), take3(work.move, b, 3)
        if plan.tied[j, 0] != 0:
            ta = tapply(to_knot(plan, model, j, 0), get3(work.move, a))
        if plan.tied[j, 1] != 0:
            tb = tapply(to_knot(plan, model, j, 1), get3(work.move, b))
    return ta, ya, tb, yb


@inline
def collect(plan: Plan, model: Model, work: Work) -> None:
    """The right-hand side of the graph: what spans and knots pull at each vertex."""
    spans, gap = work.spans, work.gap
    for k in range(plan.vertices.shape[0]):
        if plan.vertices[k, 0] >= 0:
            put3(gap, plan.vertices[k, 0], 0, NONE)
        if plan.vertices[k, 1] >= 0:
            put3(gap, plan.vertices[k, 1], 0, get3(work.pull, k))
    for j in range(plan.ends.shape[0]):
        press = take3(spans, j, PRESS)
        ta, ya, tb, yb = plan.corners[j, 0], plan.corners[j, 1], plan.corners[j, 2], plan.corners[j, 3]
        if joined(plan, j):
            put3(gap, plan.forces[j, 0], 0, press)
            ya = yb = -1
        if ta >= 0:
            put3(gap, ta, 0, add(get3(gap, ta), apply(to_knot(plan, model, j, 0), take3(spans, j, GA))))
        if tb >= 0:
            put3(gap, tb, 0, add(get3(gap, tb), apply(to_knot(plan, model, j, 1), take3(spans, j, GB))))
        if ya >= 0:
            put3(gap, ya, 0, add(get3(gap, ya), press))
        if yb >= 0:
            put3(gap, yb, 0, subtract(get3(gap, yb), press))
    pull_links(plan, model, gap)
    for k in range(model.along.shape[0]):
        turn, way = plan.vertices[k, 0], plan.vertices[k, 1]
        if way < 0:
            continue
        given, b = get3(model.given, k), take3(model.lean, k, 3)
        f = dot(b, given)
        pull = add(get3(gap, way), add(apply(get9(model.bent, k, 0), given), scale(f, b)))
        put3(gap, way, 0, tapply(get9(model.along, k, 0), pull))
        if turn >= 0:
            put3(gap, turn, 0, add(get3(gap, turn), scale(f, take3(model.lean, k, 0))))


@inline
def step_of_force(work: Work, j: int) -> Vector:
    """Change of the force of span j by the last `solve`."""
    return take3(work.spans, j, FORCE)


@viewing
def lead(plan: Plan, work: Work) -> None:
    """Fills `Work.move` with how knots move that nothing holds: as the spans lead from those held.

    Where only a cable's last point is moved by it nobody asks. `Work.slack`: what else changes of the elements' steps.
    """
    for i in range(plan.stripped.shape[0] - 1, -1, -1):
        j, end = plan.stripped[i, 0], plan.stripped[i, 1]
        leaf, other = plan.ends[j, end], plan.ends[j, 1 - end]
        asked = end == 0
        for k in range(i):
            asked = asked or plan.ends[plan.stripped[k, 0], 1 - plan.stripped[k, 1]] == leaf
        if not asked:
            continue
        way = take3(work.move, other, 3)
        dl = step_of_force(work, j)
        for e in range(plan.first[j], plan.first[j + 1]):
            da, db = get3(work.d, e + j), get3(work.d, e + j + 1)
            change = add(
                add(tapply(get9(work.parts, e, 9), da), tapply(get9(work.parts, e, 18), db)),
                add(apply(get9(work.parts, e, 27), dl), get3(work.slack, e)),
            )
            way = add(way, change) if end == 0 else subtract(way, change)
        put3(work.move, leaf, 3, way)
