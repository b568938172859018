"""What the solver of a network knows of motion, as named arrays: :class:`Motion`; and how nodes answer to forces.

A node between two elements is held to a place a by a spring that time makes: with y'' = A (y - y^) and y' = C (y - y^)
at the end of a step, a mass m and a drag c at the node, `hold` is m A + c C, and

    y = a + (lam_right - lam_left) / hold.

Without mass C is 1 / dt and a is where the node was. What else acts on a node, the planes of bodies that it may touch
(`walls`), changes its place and the derivative of it, `give`, and nothing else.

At the end of a span the mass may sit beside the node, at y + lever d3: it turns with it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.tables import Floats, Model, Plan, Solution, Whole, Work
from cable_shape.kernels.network.walls import (
    AT,
    KEPT,
    OUT,
    PULLED,
    PUSHED,
    RUB,
    STICKS,
    STIFF,
    WALL,
    WALLS,
    as_before,
    frozen,
    touched,
)
from cable_shape.kernels.rod_algebra import (
    Matrix,
    Vector,
    add,
    apply,
    dot,
    get3,
    get4,
    get9,
    inverse,
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
    symmetric,
    take3,
    tapply,
    tmul,
    transpose,
)
from cable_shape.kernels.rod_element import E3, IDENTITY

#: Numbers of a node in `Motion.chain` and of a span in `Motion.ends`, see `chain`.
CHAIN, ENDS = 87, 69
B2 = 18  # column of `Work.parts`
#: Columns of `Motion.rough`: firmness [N/m], 0: nothing rubs; how much it may pull [N]; place to which it pulls 3 [m];
#: direction 3, along which (EDGE not 0) or across which it does.
FIRM, LIMIT, CENTRE, AXIS, EDGE, ROUGH = 0, 1, 2, 5, 8, 9
#: Points inside elements that bodies and eyelets may hold, and pairs of such that may touch each other, see `props`:
#: how many, columns of each, and directions of all.
PROPS, PAIRS, PROP = 12, 36, 40
ROWS = 3 * (PROPS + PAIRS)
SCRATCH = ROWS * (2 * ROWS + 5)  #: numbers at the end that are but room
#: What `Motion.par` holds: how many points of elements there are, pairs with them, how many nodes have planes, how deep
#: [m] the cable is in bodies between its nodes, how planes hold nodes, and what share of impulses was passed on, see
#: `impulse`.
N_PROPS, N_WALLED, DEPTH, LAW, SPENT = 0, 1, 2, 3, 4
#: How planes hold nodes: as they do, as they would at their seats (`seat`), by laws that do not change (`frozen`), or
#: as they did before (`as_before`).
AS_IT_IS, SEATED, FROZEN, BEGUN = 0.0, 1.0, 2.0, 3.0


class Motion(NamedTuple):
    """What motion adds to a network of N elements, m spans and n = N + m nodes."""

    lam: Floats  # (N, 3) internal force of each element without the loads beyond it [N]
    kept: Floats  # (N, 3) the same at the end of the last step
    slack: Floats  # (N, 3) by how much the nodes' places miss each element's step [m]
    step: Floats  # (N, 3) step of lam
    place: Floats  # (n, 3) places of the nodes [m]
    origin: Floats  # (n, 3) to which they are held
    seat: Floats  # (n, 3) [m], places that an iteration of Newton's method begins from
    drag: Floats  # (n,) [N s/m], of the cable around the node
    hold: Floats  # (n,) [N/m]
    give: Floats  # (n, 9) derivative of a place in the force on the node [m/N]; 0 at the ends of spans
    chain: Floats  # (n, CHAIN) factors
    load: Floats  # (N, 9) `Model.load` without drag
    weight: Floats  # (m, 3) `Model.weight` without drag
    ends: Floats  # (m, ENDS) condensed spans: what concerns the places of their ends
    lever: Floats  # (n,) [m], along d3 from a node to its mass; 0 but at the ends of spans
    aim: Floats  # (n, 3) [m], to which masses beside their nodes are held
    loose: Floats  # (n,) 1: nothing but its mass holds the end of the cable, whose place is one of those inside
    tilt: Floats  # (m, 18) derivative of the force at the start and the end of a span in the rotation there [N]
    walls: Floats  # (n, 1 + WALLS WALL) how many planes a node has, and those, see `walls`
    rough: Floats  # (n, ROUGH) what holds a node along the planes against drag, see `rubbing`
    push: Floats  # (n, 3) [N], what acts on a node beside its elements, its mass and its planes
    tug: Floats  # (m, 6) [N], gradient in the places of the ends of spans, but for what knots and elements pull
    par: Floats  # (5,) see `N_PROPS`
    props: Floats  # (PROPS + PAIRS, PROP) those, see `props`
    was: Floats  # (1 + WALLS WALL,) room for the planes that a node has had
    aside: Floats  # room for `props`, see `aside_size`
    press: Floats  # (m, 24) what the planes of knots that move do to the start and the end of a span, see `put_knot`


@viewing(forceinline=True)
def motion_of(ints: Whole, moving: Floats) -> Motion:
    """The parts of what motion adds."""
    n, m = ints[0], ints[1]
    k = n + m
    o1 = 3 * n
    o2 = 6 * n
    o3 = 9 * n
    o4 = 12 * n
    o5 = o4 + 3 * k
    o6 = o5 + 3 * k
    o7 = o6 + 3 * k
    o8 = o7 + k
    o9 = o8 + k
    o10 = o9 + 9 * k
    o11 = o10 + CHAIN * k
    o12 = o11 + 9 * n
    o13 = o12 + 3 * m
    o14 = o13 + ENDS * m
    o15 = o14 + k
    o16 = o15 + 3 * k
    o17 = o16 + k
    o18 = o17 + 18 * m
    o19 = o18 + (1 + WALLS * WALL) * k
    o20 = o19 + ROUGH * k
    o21 = o20 + 3 * k
    o22 = o21 + 6 * m
    o23 = o22 + 5
    o24 = o23 + (PROPS + PAIRS) * PROP
    o25 = o24 + 1 + WALLS * WALL
    o26 = o25 + 24 * m
    return Motion(
        part(moving, 0, (n, 3)),
        part(moving, o1, (n, 3)),
        part(moving, o2, (n, 3)),
        part(moving, o3, (n, 3)),
        part(moving, o4, (k, 3)),
        part(moving, o5, (k, 3)),
        part(moving, o6, (k, 3)),
        part(moving, o7, (k,)),
        part(moving, o8, (k,)),
        part(moving, o9, (k, 9)),
        part(moving, o10, (k, CHAIN)),
        part(moving, o11, (n, 9)),
        part(moving, o12, (m, 3)),
        part(moving, o13, (m, ENDS)),
        part(moving, o14, (k,)),
        part(moving, o15, (k, 3)),
        part(moving, o16, (k,)),
        part(moving, o17, (m, 18)),
        part(moving, o18, (k, 1 + WALLS * WALL)),
        part(moving, o19, (k, ROUGH)),
        part(moving, o20, (k, 3)),
        part(moving, o21, (m, 6)),
        part(moving, o22, (5,)),
        part(moving, o23, (PROPS + PAIRS, PROP)),
        part(moving, o24, (1 + WALLS * WALL,)),
        part(moving, o26, (aside_size(ints),)),
        part(moving, o25, (m, 24)),
    )  # fmt: skip


@viewing
def motion_size(ints: Whole) -> int:
    """Numbers of what motion adds to a network with this head."""
    nodes = ints[0] + ints[1]
    size = 21 * ints[0] + (29 + WALLS * WALL + ROUGH + CHAIN) * nodes + (51 + ENDS) * ints[1]
    return size + 6 + (PROPS + PAIRS) * PROP + WALLS * WALL + aside_size(ints)


@viewing(forceinline=True)
def aside_size(ints: Whole) -> int:
    """Numbers of `Motion.aside`."""
    return 3 * ints[0] + 6 * (ints[0] + ints[1]) + 6 * ints[1] + 3 * ints[2] + SCRATCH


@inline
def pull_of(motion: Motion, e: int) -> Vector:
    """[N], the force of the elements e - 1 and e on the node between them."""
    return subtract(get3(motion.lam, e), get3(motion.lam, e - 1))


@viewing(forceinline=True)
def put_places(plan: Plan, model: Model, sol: Solution, motion: Motion) -> None:
    """Fills place and give: nodes where the forces of their elements hold them, ends of spans where their knots are.

    So does `press`, and knots that move go where planes leave them, if a node that stands for one has some.
    """
    for j in range(plan.ends.shape[0]):
        for end in range(2):
            node = plan.first[j + end] + j
            for c in range(12):
                motion.press[j, 12 * end + c] = 0.0
            if motion.walls[node, 0] > 0.0 and motion.loose[node] == 0.0:
                put_knot(plan, model, sol, motion, j, end)
    for j in range(plan.ends.shape[0]):
        first, last = plan.first[j], plan.first[j + 1]
        put3(motion.place, first + j, 0, take3(sol.pose, plan.ends[j, 0], 0))
        put3(motion.place, last + j, 0, take3(sol.pose, plan.ends[j, 1], 0))
        for e in range(first, last + 1):
            node = e + j
            inner = first < e < last
            soft = 1.0 / motion.hold[node] if inner or motion.loose[node] != 0.0 else 0.0
            for c in range(9):
                motion.give[node, c] = soft if c % 4 == 0 else 0.0
            if soft == 0.0:
                continue
            a, pull = get3(motion.origin, node), get3(motion.push, node)
            if inner:
                pull = add(pull, pull_of(motion, e))
            else:
                a = beside_aim(motion, sol, node)
                pull = add(pull, subtract(get3(model.force, plan.ends[j, 1]), get3(motion.lam, last - 1)))
            if motion.par[LAW] == SEATED and motion.walls[node, 0] > 0.0:
                seat(motion, node, pull)
            elif motion.walls[node, 0] > 0.0:
                kept_out(motion, node, a, motion.hold[node], pull)
            else:
                put3(motion.place, node, 0, add(a, scale(soft, pull)))
            if not inner:
                put3(sol.pose, plan.ends[j, 1], 0, get3(motion.place, node))


@viewing
def put_knot(plan: Plan, model: Model, sol: Solution, motion: Motion, j: int, end: int) -> None:
    """Puts the knot of an end of span j where all that pulls it, and the planes of that node, hold it; fills `press`.

    Its place stays an unknown of the network, but is at every iteration that where its forces balance, as those of
    nodes are: Newton's method on the place itself would go to and fro between planes that push, and rub, and do not.
    """
    knot, own = plan.ends[j, end], plan.first[j + end] + j
    hold, a, pull = 0.0, (0.0, 0.0, 0.0), get3(model.force, knot)
    for i in range(plan.ends.shape[0]):
        for side in range(2):
            if plan.ends[i, side] != knot:
                continue
            node = plan.first[i + side] + i
            hold += motion.hold[node]
            a = add(a, scale(motion.hold[node], beside_aim(motion, sol, node)))
            pull = add(pull, get3(motion.push, node))
            if side == 0:
                pull = add(pull, add(get3(motion.lam, plan.first[i]), get3(motion.weight, i)))
            else:
                pull = subtract(pull, get3(motion.lam, plan.first[i + 1] - 1))
    kept_out(motion, own, scale(1.0 / hold, a), hold, pull)
    put3(sol.pose, knot, 0, get3(motion.place, own))
    firm, _ = inverse(get9(motion.give, own, 0))
    put9(motion.press, j, 12 * end + 3, mshift(firm, -hold))
    force = (0.0, 0.0, 0.0)
    for k in range(int(motion.walls[own, 0])):
        at = 1 + WALL * k
        n, t = take3(motion.walls, own, at + OUT), take3(motion.walls, own, at + RUB)
        force = add(force, add(scale(motion.walls[own, at + PUSHED], n), t))
    put3(motion.press, j, 12 * end, force)


@inline
def kept_out(motion: Motion, node: int, a: Vector, hold: float, pull: Vector) -> None:
    """Puts a node that planes hold, which `hold` [N/m] draws to a, and a force pulls."""
    if motion.par[LAW] == FROZEN:
        frozen(motion.walls, node, a, hold, pull, motion.place, motion.give)
    elif motion.par[LAW] == BEGUN:
        as_before(motion.walls, node, a, hold, pull, motion.place, motion.give)
    else:
        touched(motion.walls, node, a, hold, pull, motion.place, motion.give)


@viewing
def seat(motion: Motion, node: int, pull: Vector) -> None:
    """The same of a node that planes hold as they would at its seat, which `settle.newton` takes along.

    Where planes would let a node go or catch it on the way there is seen at the next seat. Were its place that where
    forces balance, it would fly off as soon as a plane lets it go, for drag hardly holds it.
    """
    x = get3(motion.seat, node)
    force, K = forces(motion, node, pull, x)
    D = held_by(motion.hold[node], K)
    put3(motion.place, node, 0, add(x, apply(D, force)))
    put9(motion.give, node, 0, D)


@viewing
def move_seats(plan: Plan, motion: Motion, shove: Floats, fraction: float) -> float:
    """Takes seats along, by `fraction` of the step at hand; returns how far [m] one of a node with planes goes.

    shove (n, 3) [N]: what of the step is of points inside elements, if there are some.
    """
    farthest = 0.0
    for j in range(plan.ends.shape[0]):
        for e in range(plan.first[j] + 1, plan.first[j + 1]):
            if motion.walls[e + j, 0] > 0.0:
                way = way_of_seat(motion, shove, e, e + j)
                farthest = max(farthest, dot(way, way))
                put3(motion.seat, e + j, 0, add(get3(motion.seat, e + j), scale(fraction, way)))
    return math.sqrt(farthest)


@viewing
def stick(motion: Motion) -> None:
    """Has planes that push a node at its seat go on to, should they pull, so that sets of them come to an end."""
    for node in range(motion.walls.shape[0]):
        for k in range(int(motion.walls[node, 0])):
            i = 1 + WALL * k
            if motion.walls[node, i + PUSHED] > 0.0:
                motion.walls[node, i + STICKS] = 1.0


@viewing
def let_go(motion: Motion) -> bool:
    """Has planes that pull no longer do so; whether there are some."""
    found = False
    for node in range(motion.walls.shape[0]):
        for k in range(int(motion.walls[node, 0])):
            i = 1 + WALL * k
            if motion.walls[node, i + STICKS] > 0.0 and motion.walls[node, i + PULLED] < 0.0:
                motion.walls[node, i + STICKS] = 0.0
                found = True
    return found


@inline
def way_of_seat(motion: Motion, shove: Floats, e: int, node: int) -> Vector:
    """[m], the way of a node, left of element e, in the step at hand."""
    change = subtract(get3(motion.step, e), get3(motion.step, e - 1))
    if motion.par[N_PROPS] > 0.0:
        change = add(change, get3(shove, node))
    to = add(get3(motion.place, node), apply(get9(motion.give, node, 0), change))
    return subtract(to, get3(motion.seat, node))


@viewing
def forces(motion: Motion, node: int, pull: Vector, x: Vector) -> tuple[Vector, Matrix]:
    """What pulls a node at x [N], and minus its derivative in x but for `hold` [N/m]; fills in the planes' pushes."""
    walls = motion.walls
    t, K = rubbing(motion, node, x)
    force = add(add(pull, t), scale(-motion.hold[node], subtract(x, get3(motion.origin, node))))
    for k in range(int(walls[node, 0])):
        i = 1 + WALL * k
        n, stiff = take3(walls, node, i + OUT), walls[node, i + STIFF]
        push = walls[node, i + KEPT] + stiff * (walls[node, i + AT] - dot(n, x))
        walls[node, i + PUSHED], walls[node, i + PULLED] = max(push, 0.0), push
        if push > 0.0 or walls[node, i + STICKS] > 0.0:
            force, K = add(force, scale(push, n)), madd(K, outer(scale(stiff, n), n))
    return force, K


@viewing
def rubbing(motion: Motion, node: int, x: Vector) -> tuple[Vector, Matrix]:
    """What a node at x is pulled by along the planes [N], and minus its derivative in x [N/m].

    That is firm times its way from the centre, and no more than the limit: the gradient of a convex function.
    """
    rough = motion.rough
    firm, limit, e = rough[node, FIRM], rough[node, LIMIT], take3(rough, node, AXIS)
    P = outer(e, e) if rough[node, EDGE] != 0.0 else msub(IDENTITY, outer(e, e))
    pull = scale(-firm, apply(P, subtract(x, take3(rough, node, CENTRE))))
    size = math.sqrt(dot(pull, pull))
    if size <= limit:
        return pull, mscale(firm, P)
    along = scale(1.0 / size, pull)
    return scale(limit, along), mscale(firm * limit / size, msub(P, outer(along, along)))


@inline
def held_by(hold: float, K: Matrix) -> Matrix:
    """(hold + K)^-1, for a symmetric K that is not negative."""
    a, b, c = K[0] + hold, K[4] + hold, K[8] + hold
    d, e, f = K[1], K[2], K[5]
    A, B, C = b * c - f * f, e * f - d * c, d * f - e * b
    E, F, G = a * c - e * e, d * e - a * f, a * b - d * d
    return mscale(1.0 / (a * A + d * B + e * C), (A, B, C, B, E, F, C, F, G))


@inline
def beside_aim(motion: Motion, sol: Solution, node: int) -> Vector:
    """[m], where a node is whose mass is at `aim`."""
    if motion.lever[node] == 0.0:
        return get3(motion.origin, node)
    R = rotation(get4(sol.q, node))
    return subtract(get3(motion.aim, node), scale(motion.lever[node], (R[2], R[5], R[8])))


@inline
def mass_place(motion: Motion, sol: Solution, node: int) -> Vector:
    """[m], where the mass of a node is."""
    R = rotation(get4(sol.q, node))
    return add(get3(motion.place, node), scale(motion.lever[node], (R[2], R[5], R[8])))


@inline
def lever_torque(motion: Motion, sol: Solution, node: int) -> Vector:
    """[N m], gradient in the node's rotation of what holds a mass beside it."""
    N = beside(motion, sol, node)
    return (-N[1], N[0], 0.0)


@inline
def beside(motion: Motion, sol: Solution, node: int) -> Vector:
    """[N m], lever times the force on the mass, in the node's frame."""
    force = subtract(mass_place(motion, sol, node), get3(motion.aim, node))
    return scale(motion.lever[node] * motion.hold[node], tapply(rotation(get4(sol.q, node)), force))


@inline
def rotated(R: Matrix) -> Matrix:
    """B with d(d3) = B theta of a node with rotation R."""
    return (-R[1], R[0], 0.0, -R[4], R[3], 0.0, -R[7], R[6], 0.0)


@inline
def bent_by(N: Vector) -> Matrix:
    """Second derivative in the node's rotation of N . d3, N in its frame."""
    return mshift(mscale(0.5, symmetric(outer(N, E3))), -N[2])


@inline
def pull_turn(plan: Plan, model: Model, work: Work, j: int, end: int, T: Vector) -> None:
    """Adds to the gradient in the rotation at an end of span j, but for what is held there."""
    node = plan.first[j + end] + j
    for i in range(3):
        work.G[node, i] += T[i] * (model.free[j, end, i] if plan.tied[j, end] == 0 else 1.0)


@inline
def firm_turn(plan: Plan, model: Model, work: Work, j: int, end: int, H: Matrix) -> None:
    """Adds to the matrix of the rotation at an end of span j, but for what is held there."""
    node = plan.first[j + end] + j
    for i in range(3):
        own = model.free[j, end, i] if plan.tied[j, end] == 0 else 1.0
        for c in range(3):
            both = own * (model.free[j, end, c] if plan.tied[j, end] == 0 else 1.0)
            work.D[node, 3 * i + c] += both * H[3 * i + c]


@viewing(forceinline=True)
def tilt_ends(plan: Plan, model: Model, sol: Solution, work: Work, motion: Motion, matrix: bool) -> None:
    """Adds to the gradient what masses beside the ends of spans do, and to the matrix if asked; fills `origin`, `tug`
    and, with the matrix, `tilt` there."""
    for j in range(plan.ends.shape[0]):
        for end in range(2):
            node = plan.first[j + end] + j
            lever, hold = motion.lever[node], motion.hold[node]
            if lever != 0.0:
                put3(motion.origin, node, 0, beside_aim(motion, sol, node))
                N = beside(motion, sol, node)
                pull_turn(plan, model, work, j, end, (-N[1], N[0], 0.0))
            if lever != 0.0 and matrix:
                R = rotation(get4(sol.q, node))
                B, N = rotated(R), beside(motion, sol, node)
                answer = mscale(hold, get9(motion.give, node, 0))  # of the place to that to which it is held
                stiff = mscale(-lever * lever * hold, mshift(answer, -1.0))
                firm_turn(plan, model, work, j, end, madd(bent_by(N), tmul(B, mul(stiff, B))))
                if motion.loose[node] != 0.0:  # the place turns with the node: a step of the last element
                    e = plan.first[j + 1] - 1
                    tilt = mscale(-lever, mul(answer, B))
                    put9(work.parts, e, B2, madd(get9(work.parts, e, B2), transpose(tilt)))
                else:
                    put9(motion.tilt, j, 9 * end, mscale(hold * lever, B))
                    if plan.tied[j, end] == 0:
                        for c in range(9):
                            motion.tilt[j, 9 * end + c] *= model.free[j, end, c % 3]
            held = scale(hold, subtract(get3(motion.place, node), get3(motion.origin, node)))
            held = subtract(held, get3(motion.push, node))
            if motion.loose[node] == 0.0:
                held = subtract(held, take3(motion.press, j, 12 * end))
            put3(motion.tug, j, 3 * end, held)


@inline
def firm_at(motion: Motion, j: int, end: int, node: int) -> Matrix:
    """[N/m], how firmly what acts on an end of span j, which is this node, holds its place: its mass, and planes."""
    if motion.loose[node] != 0.0:
        return mscale(motion.hold[node], IDENTITY)
    return mshift(get9(motion.press, j, 12 * end + 3), motion.hold[node])
