"""How a moving span condenses what is inside it: block LDL^T with the force of every element as an unknown of its own.

Element e carries the force lam_e beyond the loads, and a node i stands at y_i = a_i + D_i (lam_i - lam_(i-1)), see
`motion`. Stationary is

    sum over elements of E_e(q_e, q_(e+1), lam_e) + lam_e . (y_(e+1) - y_e)
    + sum over nodes of 1/2 (y_i - a_i) . D_i^-1 (y_i - a_i) - w . y_first.

The inner places are gone by their own pivots. What is left goes in the order lam_0, theta_0, lam_1, theta_1, ...: each
force before the rotation to its left. Pivots of forces, CC - D_i - D_(i+1), are negative definite, also where nothing
stretches, and those of rotations positive at a minimum (a quasi-definite matrix needs no pivoting): three negative
eigenvalues a force tell a minimum. Where drag vanishes D grows, all forces of a span become one, and what is left is
the span at rest, see `condense`.

Columns are kept for what is not the span's own: theta_a and y_a, of its first knot. Its last rotation and y_b are the
last of the chain. What concerns rotations alone goes to the same rows of `Work.spans` as that of a span at rest, with
S^-1 = 0; what concerns the places of the ends to `Motion.ends`:

    ya ya 9, yb yb 9, yb ya 9, theta_a ya 9, theta_a yb 9, theta_b ya 9, theta_b yb 9, right-hand side ya 3, yb 3
"""

from __future__ import annotations

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.condense import (
    BA,
    BB,
    GA,
    GB,
    KAA,
    KBA,
    KBB,
    PRESS,
    SI,
    ZERO,
    masked_shift,
)
from cable_shape.kernels.network.motion import Motion, firm_at
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
    mscale,
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
    transpose,
)
from cable_shape.kernels.rod_element import IDENTITY

B1, B2, CC = 9, 18, 27  # columns of `Work.parts`
YAYA, YBYB, YBYA, TAYA, TAYB, TBYA, TBYB, GYA, GYB = 0, 9, 18, 27, 36, 45, 54, 63, 66  # of `Motion.ends`
# Columns of `Motion.chain`, of the force right of a node and of the node's rotation: inverse pivots P and Q; the block
# between the two; those from the rotation to the next force and rotation; those of both with theta_a and y_a; their
# right-hand sides.
P, A, Q, U, V, LA, LY, TA, TY, XL, XT = 0, 9, 18, 27, 36, 45, 54, 63, 72, 81, 84


@inline
def less(M: Matrix, left: Matrix, inv: Matrix, right: Matrix) -> Matrix:
    """M - left^T inv right."""
    return msub(M, tmul(left, mul(inv, right)))


@inline
def negatives(M: Matrix, det: float) -> int:
    """`negative_eigenvalues`."""
    return int(negative_eigenvalues(M, det))


@inline
def coupling(motion: Motion, node: int, ends: bool) -> Matrix:
    """The block between the forces on both sides of a node, or between the last force and the place of the end."""
    return IDENTITY if ends else get9(motion.give, node, 0)


@viewing(fastmath=FAST, forceinline=True)
def condense(plan: Plan, model: Model, work: Work, motion: Motion, j: int, shift: float) -> int:
    """Condenses span j, `shift` times the lengths between nodes added; returns how many eigenvalues are negative."""
    parts, chain, give, h, free = work.parts, motion.chain, motion.give, model.h, model.free
    first, last = plan.first[j], plan.first[j + 1] - 1
    own = plan.tied[j, 0] == 0
    border = not own or plan.corners[j, 1] >= 0
    node = first + j
    pl = msub(get9(parts, first, CC), madd(get9(give, node, 0), get9(give, node + 1, 0)))
    pt = get9(work.D, node, 0)
    a = transpose(get9(parts, first, B1))
    la, ly, ta, ty = ZERO, mscale(-1.0, IDENTITY), ZERO, ZERO
    kaa, kya, kyy = ZERO, get9(motion.tilt, j, 0), firm_at(motion, j, 0, node)
    if own:
        ty, kya = transpose(kya), ZERO
        pt = masked_shift(pt, 0.5 * shift * h[first], free[j, 0, 0], free[j, 0, 1], free[j, 0, 2])
    else:
        kaa, la = mshift(pt, 0.5 * shift * h[first]), a
    negative = 0
    for e in range(first, last + 1):
        node = e + j
        ends = e == last
        inner = own or e > first
        c, f, v = coupling(motion, node + 1, ends), transpose(get9(parts, e, B2)), get9(work.U, e, 0)
        nt = get9(work.D, node + 1, 0)
        if ends:
            nl, na = firm_at(motion, j, 1, node + 1), get9(motion.tilt, j, 9)
            x, y, z = 1.0, 1.0, 1.0
            if plan.tied[j, 1] == 0:
                x, y, z = free[j, 1, 0], free[j, 1, 1], free[j, 1, 2]
            nt = masked_shift(nt, 0.5 * shift * h[e], x, y, z)
        else:
            nl = msub(get9(parts, e + 1, CC), madd(get9(give, node + 1, 0), get9(give, node + 2, 0)))
            na = transpose(get9(parts, e + 1, B1))
            nt = mshift(nt, 0.5 * shift * (h[e] + h[e + 1]))
        nla, nly, nta, nty = ZERO, ZERO, ZERO, ZERO
        p, det = inverse(pl)
        negative += negatives(pl, det)
        nl, na, nt = less(nl, c, p, c), less(na, c, p, f), less(nt, f, p, f)
        if border:
            kaa, kya, kyy = less(kaa, la, p, la), less(kya, ly, p, la), less(kyy, ly, p, ly)
            nla, nly, nta, nty = less(nla, c, p, la), less(nly, c, p, ly), less(nta, f, p, la), less(nty, f, p, ly)
            if not inner:
                nta = madd(nta, transpose(v))
            put9(chain, node, LA, la)
            put9(chain, node, LY, ly)
        put9(chain, node, P, p)
        if inner:
            pt, u, v = less(pt, a, p, a), less(ZERO, a, p, c), less(v, a, p, f)
            q, det = inverse(pt)
            negative += negatives(pt, det)
            nl, na, nt = less(nl, u, q, u), less(na, u, q, v), less(nt, v, q, v)
            if border:
                ta, ty = less(ta, a, p, la), less(ty, a, p, ly)
                kaa, kya, kyy = less(kaa, ta, q, ta), less(kya, ty, q, ta), less(kyy, ty, q, ty)
                nla, nly = less(nla, u, q, ta), less(nly, u, q, ty)
                nta, nty = less(nta, v, q, ta), less(nty, v, q, ty)
                put9(chain, node, TA, ta)
                put9(chain, node, TY, ty)
            put9(chain, node, A, a)
            put9(chain, node, Q, q)
            put9(chain, node, U, u)
            put9(chain, node, V, v)
        pl, a, pt, la, ly, ta, ty = nl, na, nt, nla, nly, nta, nty
    spans, rows = work.spans, motion.ends
    a = transpose(a)
    if plan.tied[j, 1] == 0:
        q, det = inverse(pt)
        negative += negatives(pt, det)
        put9(chain, node + 1, Q, q)
        put9(chain, node + 1, A, a)
        put9(chain, node + 1, TA, ta)
        put9(chain, node + 1, TY, ty)
        kaa, kya, kyy = less(kaa, ta, q, ta), less(kya, ty, q, ta), less(kyy, ty, q, ty)
        pl, la, ly = less(pl, a, q, a), less(la, a, q, ta), less(ly, a, q, ty)
    else:
        put9(spans, j, KBB, pt)
        put9(spans, j, KBA, ta)
        put9(rows, j, TBYA, ty)
        put9(rows, j, TBYB, a)
    put9(spans, j, KAA, kaa)
    put9(spans, j, BA, ZERO)
    put9(spans, j, BB, ZERO)
    put9(spans, j, SI, ZERO)
    put9(rows, j, YAYA, kyy)
    put9(rows, j, TAYA, transpose(kya))
    put9(rows, j, YBYB, pl)
    put9(rows, j, YBYA, ly)
    put9(rows, j, TAYB, transpose(la))
    return negative


@viewing(fastmath=FAST, forceinline=True)
def reduce(plan: Plan, work: Work, motion: Motion, j: int) -> None:
    """Eliminates the right-hand side of span j, G and slack, with the factors at hand."""
    G, chain, spans, rows = work.G, motion.chain, work.spans, motion.ends
    first, last = plan.first[j], plan.first[j + 1] - 1
    own = plan.tied[j, 0] == 0
    border = not own or plan.corners[j, 1] >= 0
    node = first + j
    xl, xt = get3(motion.slack, first), get3(G, node)
    ga, gb = NONE if own else xt, NONE
    gy = take3(motion.tug, j, 0)
    for e in range(first, last + 1):
        node = e + j
        ends = e == last
        nl = take3(motion.tug, j, 3) if ends else get3(motion.slack, e + 1)
        put3(chain, node, XL, xl)
        y = apply(get9(chain, node, P), xl)
        nl = subtract(nl, apply(coupling(motion, node + 1, ends), y))
        nt = subtract(get3(G, node + 1), apply(get9(work.parts, e, B2), y))
        if border:
            ga, gy = (
                subtract(ga, tapply(get9(chain, node, LA), y)),
                subtract(gy, tapply(get9(chain, node, LY), y)),
            )
        if own or e > first:
            xt = subtract(xt, tapply(get9(chain, node, A), y))
            put3(chain, node, XT, xt)
            y = apply(get9(chain, node, Q), xt)
            nl, nt = (
                subtract(nl, tapply(get9(chain, node, U), y)),
                subtract(nt, tapply(get9(chain, node, V), y)),
            )
            if border:
                ga, gy = (
                    subtract(ga, tapply(get9(chain, node, TA), y)),
                    subtract(gy, tapply(get9(chain, node, TY), y)),
                )
        xl, xt = nl, nt
    node = last + 1 + j
    if plan.tied[j, 1] == 0:
        put3(chain, node, XT, xt)
        y = apply(get9(chain, node, Q), xt)
        xl = subtract(xl, tapply(get9(chain, node, A), y))
        if border:
            ga, gy = (
                subtract(ga, tapply(get9(chain, node, TA), y)),
                subtract(gy, tapply(get9(chain, node, TY), y)),
            )
    else:
        gb = xt
    put3(spans, j, GA, ga)
    put3(spans, j, GB, gb)
    put3(spans, j, PRESS, NONE)
    put3(rows, j, GYA, gy)
    put3(rows, j, GYB, xl)


@viewing(fastmath=FAST, forceinline=True)
def expand(plan: Plan, work: Work, motion: Motion, j: int, ta: Vector, ya: Vector, tb: Vector, yb: Vector) -> float:
    """Fills d and the steps of the forces of span j from the steps of its ends' rotations (own frames) and places.

    Returns the square of the largest norm of a node's rotation.
    """
    chain, d = motion.chain, work.d
    first, last = plan.first[j], plan.first[j + 1] - 1
    own = plan.tied[j, 0] == 0
    border = not own or plan.corners[j, 1] >= 0
    node = last + 1 + j
    dl, dt = yb, tb
    if plan.tied[j, 1] == 0:
        z = add(take3(chain, node, XT), apply(get9(chain, node, A), yb))
        if border:
            z = add(z, add(apply(get9(chain, node, TA), ta), apply(get9(chain, node, TY), ya)))
        dt = scale(-1.0, apply(get9(chain, node, Q), z))
    put3(d, node, 0, dt)
    largest = dot(dt, dt)
    for e in range(last, first - 1, -1):
        node = e + j
        z = add(take3(chain, node, XL), apply(coupling(motion, node + 1, e == last), dl))
        z = add(z, tapply(get9(work.parts, e, B2), dt))
        if own or e > first:
            x = add(take3(chain, node, XT), apply(get9(chain, node, U), dl))
            x = add(x, apply(get9(chain, node, V), dt))
            if border:
                x = add(x, add(apply(get9(chain, node, TA), ta), apply(get9(chain, node, TY), ya)))
            dt = scale(-1.0, apply(get9(chain, node, Q), x))
            z = add(z, apply(get9(chain, node, A), dt))
        else:
            dt = ta
        if border:
            z = add(z, add(apply(get9(chain, node, LA), ta), apply(get9(chain, node, LY), ya)))
        dl = scale(-1.0, apply(get9(chain, node, P), z))
        put3(motion.step, e, 0, dl)
        put3(d, node, 0, dt)
        size = dot(dt, dt)
        if not size <= largest:  # NaN is the largest of all
            largest = size
    put3(work.spans, j, FORCE, get3(motion.step, last))
    return largest
