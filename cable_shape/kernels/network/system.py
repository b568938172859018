"""Newton's system of the spans of a network: gradient, block tridiagonal Hessian, coupling to each span's force.

In a span the internal force is n(s) = loads between s and its end + lambda_j. Stationary is

    sum of elements + sum_j [lambda_j . (y_b - y_a) - w_j . y_a] - sum_k F_k . y_k

with the places y of the knots a and b of span j, its whole load w_j, and dead forces F. Lists of what is filled stand
in :class:`cable_shape.kernels.network.tables.Work`. The formulas of :mod:`cable_shape.kernels.rod_element` are taken
for eight elements at a time, whatever span they are of.
"""

from __future__ import annotations

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.tables import (
    ELASTIC,
    SWINGS,
    TRIAL,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    Work,
    model_of,
    plan_of,
    solution_of,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    add,
    dot,
    get3,
    get4,
    hat,
    put3,
    rotation,
    subtract,
    tapply,
)
from cable_shape.kernels.rod_lanes import (
    B1,
    B2,
    CC,
    G1,
    G2,
    GL,
    H11,
    H12,
    H22,
    LANES,
    VALUE,
    gather,
    gather_firmer,
    gradients,
    hessians,
    lane3,
    swung_gradients,
    swung_hessians,
)

NONE = (0.0, 0.0, 0.0)


@viewing(forceinline=True)
def fold(plan: Plan, model: Model, lam: Floats, full: Floats) -> None:
    """full = load + the force of the span."""
    for j in range(lam.shape[0]):
        for e in range(plan.first[j], plan.first[j + 1]):
            for c in range(3):
                full[e, c] = model.load[e, c] + lam[j, c]
                full[e, 3 + c] = model.load[e, 3 + c] + lam[j, c]
                full[e, 6 + c] = model.load[e, 6 + c] + lam[j, c]


@viewing
def assemble(ints: Whole, floats: Floats, sols: Floats, space: Floats) -> None:
    """Fills D, U, parts, first, G and sums, and the closures and pulls of `balance`."""
    plan, model, sol, work = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, TRIAL), work_of(ints, space)
    fold(plan, model, sol.lam, work.full)
    D, U, parts, G, first, sums = work.D, work.U, work.parts, work.G, work.first, work.sums
    elements = model.h.shape[0]
    elastic, swings = model.par[ELASTIC] != 0.0, model.par[SWINGS] != 0.0
    sums[:, :12] = 0.0
    j = 0
    lanes = work.lanes
    for begin in range(0, elements, LANES):
        count = gather(begin, plan.left, sol.q, model.h, work.full, model.rest, model.section, lanes)
        if swings:
            gather_firmer(begin, model.firmer, lanes)
            swung_hessians(lanes, elastic)
        else:
            hessians(lanes, elastic, None)
        for k in range(count):
            e = begin + k
            if e == plan.first[j + 1]:
                j += 1
            node = e + j
            opens = e == plan.first[j]
            for c in range(9):
                i = c * LANES + k
                h11 = lanes[H11 * LANES + i]
                if opens:
                    D[node, c] = sums[j, 12 + c] = h11
                else:
                    D[node, c] += h11
                D[node + 1, c] = parts[e, c] = lanes[H22 * LANES + i]
                U[e, c] = lanes[H12 * LANES + i]
                parts[e, 9 + c] = lanes[B1 * LANES + i]
                parts[e, 18 + c] = lanes[B2 * LANES + i]
                parts[e, 27 + c] = lanes[CC * LANES + i]
                sums[j, 3 + c] += lanes[CC * LANES + i]
            g1, g2, gl = lane3(lanes, G1, k), lane3(lanes, G2, k), lane3(lanes, GL, k)
            put3(G, node, 0, g1 if opens else add(get3(G, node), g1))
            put3(G, node + 1, 0, g2)
            put3(first, e, 0, gl)
            put3(first, e, 3, g1)
            put3(first, e, 6, g2)
            for i in range(3):
                sums[j, i] += gl[i]
    end_moments(plan, model, sol.q, D, G, True)
    release(plan, model, G)
    hold(plan, model, D)
    balance(plan, model, sol, sums, work.pull)


@viewing
def gradient(ints: Whole, floats: Floats, sols: Floats, space: Floats) -> float:
    """Fills G, first, the closures and the pulls; returns the value of the elements' functional."""
    plan, model, sol, work = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, TRIAL), work_of(ints, space)
    fold(plan, model, sol.lam, work.full)
    G, first, sums = work.G, work.first, work.sums
    elements, swings = model.h.shape[0], model.par[SWINGS] != 0.0
    value = 0.0
    left = NONE
    sums[:, :3] = 0.0
    j = 0
    lanes = work.lanes
    for begin in range(0, elements, LANES):
        count = gather(begin, plan.left, sol.q, model.h, work.full, model.rest, model.section, lanes)
        if swings:
            gather_firmer(begin, model.firmer, lanes)
            swung_gradients(lanes)
        else:
            gradients(lanes, None)
        for k in range(count):
            e = begin + k
            if e == plan.first[j + 1]:
                put3(G, e + j, 0, left)
                left = NONE
                j += 1
            g1, g2, gl = lane3(lanes, G1, k), lane3(lanes, G2, k), lane3(lanes, GL, k)
            value += lanes[VALUE * LANES + k]
            put3(G, e + j, 0, add(left, g1))
            put3(first, e, 0, gl)
            put3(first, e, 3, g1)
            put3(first, e, 6, g2)
            left = g2
            for i in range(3):
                sums[j, i] += gl[i]
    put3(G, elements + j, 0, left)
    end_moments(plan, model, sol.q, work.D, G, False)
    release(plan, model, G)
    balance(plan, model, sol, sums, work.pull)
    return value


@inline
def end_moments(plan: Plan, model: Model, q: Floats, D: Floats, G: Floats, matrix: bool) -> None:
    """Dead moments on the ends of spans: minus R^T moment in the gradient, and its derivative if asked.

    It makes the block of that end unsymmetric: minus hat(M), of which the elements' gradient g, M at rest, takes half
    back: their Hessians are symmetric, where the derivative of a gradient that is not zero has hat(g) / 2 besides.
    """
    for j in range(plan.ends.shape[0]):
        for end in range(2):
            knot = plan.ends[j, end]
            m = get3(model.moment, knot)
            if plan.tied[j, end] == 0 and (m[0] != 0.0 or m[1] != 0.0 or m[2] != 0.0):
                node = plan.first[j + end] + j
                M = tapply(rotation(get4(q, node)), m)
                put3(G, node, 0, subtract(get3(G, node), M))
                if matrix:
                    spin = hat(M)
                    for c in range(9):
                        D[node, c] -= 0.5 * spin[c]


@inline
def release(plan: Plan, model: Model, G: Floats) -> None:
    """Takes the rotations that are held out of a right-hand side G (n, 3)."""
    for j in range(plan.ends.shape[0]):
        for end in range(2):
            if plan.tied[j, end] == 0:
                node = plan.first[j + end] + j
                for i in range(3):
                    G[node, i] *= model.free[j, end, i]


@inline
def hold(plan: Plan, model: Model, D: Floats) -> None:
    """Replaces rows and columns of held rotations by those of the identity."""
    for j in range(plan.ends.shape[0]):
        for end in range(2):
            if plan.tied[j, end] == 0:
                node = plan.first[j + end] + j
                for i in range(3):
                    if model.free[j, end, i] == 0.0:
                        for c in range(3):
                            D[node, 3 * i + c] = 0.0
                            D[node, 3 * c + i] = 0.0
                        D[node, 4 * i] = 1.0


@inline
def balance(plan: Plan, model: Model, sol: Solution, sums: Floats, pull: Floats) -> None:
    """Adds the knots' distances to the closures, and fills the gradient in the knots' places."""
    for k in range(pull.shape[0]):
        put3(pull, k, 0, (-model.force[k, 0], -model.force[k, 1], -model.force[k, 2]))
    for j in range(sol.lam.shape[0]):
        a, b = plan.ends[j, 0], plan.ends[j, 1]
        for i in range(3):
            sums[j, i] += sol.pose[b, i] - sol.pose[a, i]
            pull[a, i] -= sol.lam[j, i] + model.weight[j, i]
            pull[b, i] += sol.lam[j, i]


@inline
def energy_left(work: Work) -> float:
    """[J] twice what a step would still save."""
    total = 0.0
    for k in range(work.G.shape[0]):
        total += dot(get3(work.G, k), get3(work.d, k))
    for j in range(work.sums.shape[0]):
        for i in range(3):
            total += work.sums[j, i] * work.spans[j, FORCE + i]
    for k in range(work.pull.shape[0]):
        for i in range(3):
            total += work.pull[k, i] * work.move[k, 3 + i]
    return abs(total)


#: Where a span's step of its force stands among its condensed numbers, see `condense`.
FORCE = 54
