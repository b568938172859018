"""How a span condenses what is inside it: block LDL^T from its first node to its last, then its force.

Inner rotations go by block pivots, with columns for the rotation theta_a of the first node where that is the knot's,
and for the force lambda. What is left of a span is

    1/2 theta^T K theta + theta^T g - 1/2 z^T S^-1 z,   z = Ba^T theta_a + Bb^T theta_b + y_b - y_a + c,

with K = (Kaa, Kab; Kba, Kbb), the stiffness matrix of a finite beam. A row of `Work.spans` holds

    Kaa 9, Kba 9, Kbb 9, Ba 9, Bb 9, S^-1 9, step of lambda 3, c 3, ga 3, gb 3, S^-1 c 3

(where the force is left to the graph, see `joined`, S and c in the place of S^-1 and S^-1 c)
and a row of `Work.W` the nine numbers of theta_a's column, nine of lambda's and three of the right-hand side's.

This is the one elimination of a span at rest; who joins spans (see `graph`) sees only these rows. A span whose elements
carry forces of their own and whose nodes move against a resistance condenses to the same rows and a few more, for it
holds the places of its ends apart; see `chain`.
"""

from __future__ import annotations

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.system import FORCE, NONE
from cable_shape.kernels.network.tables import Model, Plan, Work
from cable_shape.kernels.rod_algebra import (
    FAST,
    Matrix,
    Vector,
    add,
    apply,
    dot,
    get3,
    get9,
    inverse,
    madd,
    mshift,
    msub,
    mul,
    negative_eigenvalues,
    put3,
    put9,
    scale,
    subtract,
    take3,
    tapply,
    tmul,
)

ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
KAA, KBA, KBB, BA, BB, SI = 0, 9, 18, 27, 36, 45
CLOSURE, GA, GB, PRESS = 57, 60, 63, 66
THETA, LAMBDA, RIGHT = 0, 9, 18  # columns of W


@inline
def rows(a: float, b: float, c: float, A: Matrix) -> Matrix:
    """diag(a, b, c) A."""
    return (a * A[0], a * A[1], a * A[2], b * A[3], b * A[4], b * A[5], c * A[6], c * A[7], c * A[8])


@inline
def columns(a: float, b: float, c: float, A: Matrix) -> Matrix:
    """A diag(a, b, c)."""
    return (a * A[0], b * A[1], c * A[2], a * A[3], b * A[4], c * A[5], a * A[6], b * A[7], c * A[8])


@inline
def masked_shift(A: Matrix, f: float, a: float, b: float, c: float) -> Matrix:
    """A + f diag(a, b, c)."""
    return (A[0] + f * a, A[1], A[2], A[3], A[4] + f * b, A[5], A[6], A[7], A[8] + f * c)


@viewing(fastmath=FAST, forceinline=True)
def condense(plan: Plan, model: Model, work: Work, j: int, shift: float) -> int:
    """Condenses span j, `shift` times the lengths between nodes added; returns how many eigenvalues are negative."""
    if plan.tied[j, 0] == 0:
        return condense_from_end(plan, model, work, j, shift)
    return condense_between(plan, model, work, j, shift)


@inline
def finish(plan: Plan, model: Model, work: Work, j: int, pivot: Matrix, wl: Matrix, gram: Matrix) -> int:
    """The last node and the force of span j, without a column of its first rotation."""
    P, spans = work.P, work.spans
    node = plan.first[j + 1] + j
    negative = 0
    if plan.tied[j, 1] == 0:
        inv, det = inverse(pivot)
        negative += negative_eigenvalues(pivot, det)
        put9(P, node, 0, inv)
        gram = madd(gram, tmul(wl, mul(inv, wl)))
    else:
        put9(spans, j, KBB, pivot)
        put9(spans, j, BB, wl)
    put9(work.W, node, LAMBDA, wl)
    if plan.known[j] == 0:
        S = msub(get9(work.sums, j, 3), gram)
        if joined(plan, j):
            put9(spans, j, SI, S)
        else:
            inv, det = inverse(S)
            negative += negative_eigenvalues(S, det)
            put9(spans, j, SI, inv)
    return negative


@inline
def joined(plan: Plan, j: int) -> bool:
    """Whether the force of span j is a vertex of the graph."""
    return bool(plan.forces.shape[0] > 0 and plan.forces[j, 0] >= 0)


@viewing(fastmath=FAST, forceinline=True)
def condense_from_end(plan: Plan, model: Model, work: Work, j: int, shift: float) -> int:
    """Span j whose first rotation is its own: held, free, or in part."""
    D, U, parts, P, Y, W, h, free = work.D, work.U, work.parts, work.P, work.Y, work.W, model.h, model.free
    first, last = plan.first[j], plan.first[j + 1] - 1
    negative = 0
    a, b, c = free[j, 0, 0], free[j, 0, 1], free[j, 0, 2]
    x, y, z = 1.0, 1.0, 1.0
    if plan.tied[j, 1] == 0:
        x, y, z = free[j, 1, 0], free[j, 1, 1], free[j, 1, 2]
    pivot = masked_shift(get9(D, first + j, 0), 0.5 * shift * h[first], a, b, c)
    wl = rows(a, b, c, get9(parts, first, 9))
    gram = ZERO
    for e in range(first, last + 1):
        node = e + j
        inv, det = inverse(pivot)
        negative += negative_eigenvalues(pivot, det)
        put9(P, node, 0, inv)
        off = get9(U, e, 0)
        if e == first:
            off = rows(a, b, c, off)
        across = get9(parts, e, 18)
        if e == last:
            off = columns(x, y, z, off)
            across = rows(x, y, z, across)
        else:
            across = madd(across, get9(parts, e + 1, 9))
        step = mul(inv, off)
        put9(Y, e, 0, step)
        pivot = msub(get9(D, node + 1, 0), tmul(step, off))
        if shift != 0.0:
            if e < last:
                pivot = mshift(pivot, 0.5 * shift * (h[e] + h[e + 1]))
            else:
                pivot = masked_shift(pivot, 0.5 * shift * h[e], x, y, z)
        put9(W, node, LAMBDA, wl)
        gram = madd(gram, tmul(wl, mul(inv, wl)))
        wl = msub(across, tmul(step, wl))
    return negative + finish(plan, model, work, j, pivot, wl, gram)


@viewing(fastmath=FAST, forceinline=True)
def condense_between(plan: Plan, model: Model, work: Work, j: int, shift: float) -> int:
    """Span j whose first rotation is that of its knot."""
    D, U, parts, P, Y, W, h, spans = work.D, work.U, work.parts, work.P, work.Y, work.W, model.h, work.spans
    first, last = plan.first[j], plan.first[j + 1] - 1
    negative = 0
    x, y, z = 1.0, 1.0, 1.0
    if plan.tied[j, 1] == 0:
        x, y, z = model.free[j, 1, 0], model.free[j, 1, 1], model.free[j, 1, 2]
    Kaa = mshift(get9(D, first + j, 0), 0.5 * shift * h[first])
    Ba = get9(parts, first, 9)
    off = get9(U, first, 0)
    across = get9(parts, first, 18)
    if first == last:
        off, across = columns(x, y, z, off), rows(x, y, z, across)
        pivot = masked_shift(get9(D, first + j + 1, 0), 0.5 * shift * h[first], x, y, z)
    else:
        across = madd(across, get9(parts, first + 1, 9))
        pivot = mshift(get9(D, first + j + 1, 0), 0.5 * shift * (h[first] + h[first + 1]))
    wt = (off[0], off[3], off[6], off[1], off[4], off[7], off[2], off[5], off[8])
    wl = across
    gram = ZERO
    for e in range(first + 1, last + 1):
        node = e + j
        inv, det = inverse(pivot)
        negative += negative_eigenvalues(pivot, det)
        put9(P, node, 0, inv)
        off = get9(U, e, 0)
        across = get9(parts, e, 18)
        if e == last:
            off = columns(x, y, z, off)
            across = rows(x, y, z, across)
        else:
            across = madd(across, get9(parts, e + 1, 9))
        step = mul(inv, off)
        put9(Y, e, 0, step)
        pivot = msub(get9(D, node + 1, 0), tmul(step, off))
        if shift != 0.0:
            if e < last:
                pivot = mshift(pivot, 0.5 * shift * (h[e] + h[e + 1]))
            else:
                pivot = masked_shift(pivot, 0.5 * shift * h[e], x, y, z)
        put9(W, node, THETA, wt)
        put9(W, node, LAMBDA, wl)
        eased, pulled = mul(inv, wt), mul(inv, wl)
        Kaa = msub(Kaa, tmul(wt, eased))
        Ba = msub(Ba, tmul(wt, pulled))
        gram = madd(gram, tmul(wl, pulled))
        wl = msub(across, tmul(step, wl))
        wt = tmul(step, wt)
        wt = (-wt[0], -wt[1], -wt[2], -wt[3], -wt[4], -wt[5], -wt[6], -wt[7], -wt[8])
    node = last + 1 + j
    put9(W, node, THETA, wt)
    if plan.tied[j, 1] == 0:
        inv, _ = inverse(pivot)
        Kaa = msub(Kaa, tmul(wt, mul(inv, wt)))
        Ba = msub(Ba, tmul(wt, mul(inv, wl)))
    else:
        put9(spans, j, KBA, wt)
    put9(spans, j, KAA, Kaa)
    put9(spans, j, BA, Ba)
    return negative + finish(plan, model, work, j, pivot, wl, gram)


@viewing(fastmath=FAST, forceinline=True)
def reduce(plan: Plan, model: Model, work: Work, j: int) -> None:
    """Eliminates the right-hand side of span j, G and the first three of sums, with the factors at hand."""
    P, Y, W, G, spans = work.P, work.Y, work.W, work.G, work.spans
    first, last = plan.first[j], plan.first[j + 1]
    unknown, tied = plan.known[j] == 0, plan.tied[j, 0] != 0
    c = get3(work.sums, j)
    ga = gb = NONE
    x = get3(G, first + j)
    begin = first
    if tied:
        ga = x
        x = get3(G, first + j + 1)
        begin = first + 1
    for e in range(begin, last + 1):
        node = e + j
        put3(W, node, RIGHT, x)
        if e == last and plan.tied[j, 1] != 0:
            gb = x
            break
        y = apply(get9(P, node, 0), x)
        if tied:
            ga = subtract(ga, tapply(get9(W, node, THETA), y))
        if unknown:
            c = subtract(c, tapply(get9(W, node, LAMBDA), y))
        if e < last:
            x = subtract(get3(G, node + 1), tapply(get9(Y, e, 0), x))
    put3(spans, j, CLOSURE, c)
    if model.given.shape[0] > 0:
        c = add(c, subtract(get3(model.given, plan.ends[j, 1]), get3(model.given, plan.ends[j, 0])))
    press = NONE
    if joined(plan, j):
        put3(spans, j, PRESS, c)
    else:
        press = apply(get9(spans, j, SI), c) if unknown else NONE
        put3(spans, j, PRESS, press)
    if tied:
        put3(spans, j, GA, subtract(ga, apply(get9(spans, j, BA), press)))
    if plan.tied[j, 1] != 0:
        put3(spans, j, GB, subtract(gb, apply(get9(spans, j, BB), press)))


@inline
def expand_force(plan: Plan, work: Work, j: int, ta: Vector, ya: Vector, tb: Vector, yb: Vector) -> Vector:
    """Fills the step of the force of span j, and returns it; see `expand`."""
    spans = work.spans
    force = NONE
    if joined(plan, j):
        force = get3(work.gap, plan.forces[j, 0])
    elif plan.known[j] == 0:
        z = add(take3(spans, j, CLOSURE), subtract(yb, ya))
        if plan.tied[j, 0] != 0:
            z = add(z, tapply(get9(spans, j, BA), ta))
        if plan.tied[j, 1] != 0:
            z = add(z, tapply(get9(spans, j, BB), tb))
        force = scale(-1.0, apply(get9(spans, j, SI), z))
    put3(spans, j, FORCE, force)
    return force


@viewing(fastmath=FAST, forceinline=True)
def expand(plan: Plan, work: Work, j: int, ta: Vector, ya: Vector, tb: Vector, yb: Vector) -> float:
    """Fills d and the step of the force of span j from the steps of its ends' rotations (own frames) and places.

    Returns the square of the largest norm of a node's rotation.
    """
    P, Y, W, d = work.P, work.Y, work.W, work.d
    first, last = plan.first[j], plan.first[j + 1]
    tied = plan.tied[j, 0] != 0
    force = expand_force(plan, work, j, ta, ya, tb, yb)
    begin = first + 1 if tied else first
    x = tb
    end = last
    if plan.tied[j, 1] != 0:
        put3(d, last + j, 0, tb)
        end = last - 1
    largest = dot(x, x) if plan.tied[j, 1] != 0 else 0.0
    for e in range(end, begin - 1, -1):
        node = e + j
        z = add(take3(W, node, RIGHT), apply(get9(W, node, LAMBDA), force))
        if tied:
            z = add(z, apply(get9(W, node, THETA), ta))
        y = apply(get9(P, node, 0), z)
        if e < last:
            y = add(y, apply(get9(Y, e, 0), x))
        x = scale(-1.0, y)
        put3(d, node, 0, x)
        size = dot(x, x)
        if not size <= largest:  # NaN is the largest of all
            largest = size
    if tied:
        put3(d, first + j, 0, ta)
        size = dot(ta, ta)
        if not size <= largest:
            largest = size
    return largest
