"""Block LDL^T of a rod in spans, three border columns at a time whatever the number of supports, and its inertia.

Along span j the node rotations are eliminated with the columns W of its force lambda_j:

    P_k = D_k - Y_{k-1}^T O_{k-1},  Y_k = P_k^-1 O_k,  W_k = B_k - Y_{k-1}^T W_{k-1},
    S_j = CC_j - sum W_k^T P_k^-1 W_k.

At the node of its far support lambda_j is eliminated, then the support's place y, if that is unknown: a condensed 6x6
stiffness of (rotation, place) is left, in 3x3 blocks

    rotation: P - W S^-1 W^T     between: C = a b^T - W S^-1     place: A - S^-1,

A the second derivative of what acts on the place. Free to move along the columns of Z only, the place has the
compliance M = Z (Z^T (A - S^-1) Z)^-1 Z^T; 0 where it is held, and then nothing but the rotation is carried over. The
next span starts with the pivot P - W S^-1 W^T - C M C^T, the columns B + C M and the compliance M in its S.

By Sylvester's law an equilibrium is a strict minimum iff the negative eigenvalues of all P, S and Z^T (A - S^-1) Z
together are as many as the forces' components: three a span. The last span of a free end has no unknown force.

place (m+1, 25): number of free directions k (0: held) | A 9 | f 3, the derivative at y = 0 | Z^T 9: orthonormal rows,
the first k free | c 3: rows i >= k of Z^T y must be c_i | a 3, b 3: a b^T couples the rotation there to the place.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    FAST,
    Matrix,
    add,
    apply,
    get3,
    get9,
    inlined,
    inverse,
    madd,
    mshift,
    msub,
    mul,
    negative_eigenvalues,
    outer,
    put3,
    put9,
    scale,
    subtract,
    take3,
    tapply,
    tmul,
    transpose,
)

ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NONE = (0.0, 0.0, 0.0)
PLACE = 31  # numbers that say what acts on a support's place
# columns of `joints`: S^-1, W at the far support, M, C, A - S^-1, then of one right-hand side
SI, WE, MC, CB, AY, CLOSING, PULL, MOVED, FORCE, SHIFTED = 0, 9, 18, 27, 36, 45, 48, 51, 54, 57


@inlined
def rows(mask: Array, j: int, A: Matrix) -> Matrix:
    """A without the rows of rotations held at support j."""
    a, b, c = mask[j, 0], mask[j, 1], mask[j, 2]
    return (a * A[0], a * A[1], a * A[2], b * A[3], b * A[4], b * A[5], c * A[6], c * A[7], c * A[8])


@inlined
def columns(mask: Array, j: int, A: Matrix) -> Matrix:
    """A without the columns of rotations held at support j."""
    a, b, c = mask[j, 0], mask[j, 1], mask[j, 2]
    return (a * A[0], b * A[1], c * A[2], a * A[3], b * A[4], c * A[5], a * A[6], b * A[7], c * A[8])


@kernel(fastmath=FAST)
def place_compliance(place: Array, j: int, stiff: Matrix) -> tuple[Matrix, int]:
    """M = Z (Z^T stiff Z)^-1 Z^T of support j, and the number of negative eigenvalues of Z^T stiff Z."""
    free = int(place[j, 0])
    if free == 0:
        return ZERO, 0
    Zt = get9(place, j, 13)
    inner = mul(Zt, mul(stiff, transpose(Zt)))
    if free < 3:
        a, b, _, d, e, _, _, _, _ = inner
        if free == 1:
            b = d = e = 0.0
        inner = (a, b, 0.0, d, e if free == 2 else 1.0, 0.0, 0.0, 0.0, 1.0)
    inv, det = inverse(inner)
    negative = negative_eigenvalues(inner, det)
    if free < 3:
        a, b, _, d, e, _, _, _, _ = inv
        inv = (a, b, 0.0, d, e if free == 2 else 0.0, 0.0, 0.0, 0.0, 0.0)
    return tmul(Zt, mul(inv, Zt)), negative


@inlined
def shifted(pivot: Matrix, shift: float, h: Array, k: int, mask: Array, support: int) -> Matrix:
    """The pivot of node k plus shift times the length around it; support: -1 inside a span."""
    size = 0.5 * shift * ((h[k - 1] if k > 0 else 0.0) + (h[k] if k < h.shape[0] else 0.0))
    if support < 0:
        return mshift(pivot, size)
    return madd(
        pivot, (size * mask[support, 0], 0.0, 0.0, 0.0, size * mask[support, 1], 0.0, 0.0, 0.0, size * mask[support, 2])
    )


@kernel(fastmath=FAST)
def factor(
    D: Array, U: Array, parts: Array, sums: Array, where: Array, mask: Array, place: Array, forces: int, shift: float,
    h: Array, P: Array, Y: Array, W: Array, joints: Array,
) -> int:  # fmt: skip
    """Factors the matrix, shift times the lengths between nodes added; returns the number of negative eigenvalues.

    P (N+1, 9) takes the inverse pivots, Y (N, 9) and the first nine columns of W (N+1, 12) are as above, joints
    (m, JOINT) takes what is kept for each span. forces: how many spans have an unknown force, from the first on.
    """
    spans = sums.shape[0]
    length = 0.0
    for e in range(h.shape[0]):
        length += h[e]
    negative = 0
    pivot = shifted(get9(D, 0, 0), shift, h, 0, mask, 0)
    w = rows(mask, 0, get9(parts, 0, 9))
    gram = ZERO
    for j in range(spans):
        a, b = where[j], where[j + 1]
        unknown = j < forces
        for k in range(a, b):
            inv, det = inverse(pivot)
            negative += negative_eigenvalues(pivot, det)
            put9(P, k, 0, inv)
            off = get9(U, k, 0)
            if k == a:
                off = rows(mask, j, off)
            if k + 1 == b:
                off = columns(mask, j + 1, off)
            y = mul(inv, off)
            put9(Y, k, 0, y)
            pivot = shifted(msub(get9(D, k + 1, 0), tmul(y, off)), shift, h, k + 1, mask, j + 1 if k + 1 == b else -1)
            if unknown:
                put9(W, k, 0, w)
                gram = madd(gram, tmul(w, mul(inv, w)))
                across = get9(parts, k, 18)
                if k + 1 < b:
                    across = madd(across, get9(parts, k + 1, 9))
                else:
                    across = rows(mask, j + 1, across)
                w = msub(across, tmul(y, w))
        M = ZERO
        C = ZERO
        if unknown:
            S = msub(get9(sums, j, 3), gram)
            inv, det = inverse(S)
            negative += negative_eigenvalues(S, det)
            wS = mul(w, inv)
            pivot = msub(pivot, mul(wS, transpose(w)))
            put9(joints, j, SI, inv)
            put9(joints, j, WE, w)
            if j + 1 < spans and place[j + 1, 0] > 0.0:
                stiff = mshift(msub(get9(place, j + 1, 1), inv), shift / length)
                M, below = place_compliance(place, j + 1, stiff)
                negative += below
                C = msub(outer(take3(place, j + 1, 25), take3(place, j + 1, 28)), wS)
                pivot = msub(pivot, mul(C, mul(M, transpose(C))))
                put9(joints, j, CB, C)
                put9(joints, j, AY, stiff)
        put9(joints, j, MC, M)
        gram = M
        if j + 1 < spans:
            w = madd(rows(mask, j + 1, get9(parts, b, 9)), mul(C, M))
    inv, det = inverse(pivot)
    negative += negative_eigenvalues(pivot, det)
    put9(P, h.shape[0], 0, inv)
    return negative


@kernel(fastmath=FAST)
def forward(
    G: Array, closure: Array, pull: Array, given: Array, where: Array, place: Array, forces: int, P: Array, Y: Array,
    W: Array, joints: Array,
) -> None:  # fmt: skip
    """Eliminates a right-hand side with the factors at hand, into the last columns of W and of joints.

    G (N+1, 3): gradient in the rotations, held ones 0. closure (m, >= 3): gradient in the spans' forces. pull
    (m+1, 3): gradient in the supports' places. given (m+1, 3): how far a place that is free in some directions only
    moves in the others.
    """
    spans = joints.shape[0]
    x = get3(G, 0)
    gram = NONE
    for j in range(spans):
        unknown = j < forces
        for k in range(where[j], where[j + 1]):
            put3(W, k, 9, x)
            if unknown:
                gram = add(gram, tapply(get9(W, k, 0), apply(get9(P, k, 0), x)))
            x = subtract(get3(G, k + 1), tapply(get9(Y, k, 0), x))
        if unknown:
            r = subtract(get3(closure, j), gram)
            v = apply(get9(joints, j, SI), r)
            x = subtract(x, apply(get9(joints, j, WE), v))
            put3(joints, j, CLOSING, r)
            gram = NONE
            if j + 1 < spans and place[j + 1, 0] > 0.0:
                move = get3(given, j + 1)
                g = add(subtract(get3(pull, j + 1), v), apply(get9(joints, j, AY), move))
                eased = subtract(move, apply(get9(joints, j, MC), g))
                x = add(x, apply(get9(joints, j, CB), eased))
                put3(joints, j, PULL, g)
                put3(joints, j, MOVED, move)
                gram = eased
    put3(W, where[spans], 9, x)


@kernel(fastmath=FAST)
def backward(
    where: Array, place: Array, forces: int, P: Array, Y: Array, W: Array, joints: Array, d: Array
) -> float:  # fmt: skip
    """Solves for minus the inverse times the right-hand side; returns the largest norm of a node's rotation.

    d (N+1, 3): rotations; joints[:, FORCE:SHIFTED] and joints[:, SHIFTED:]: the forces of the spans and the places of
    their far supports.
    """
    spans = joints.shape[0]
    last = where[spans]
    x = scale(-1.0, apply(get9(P, last, 0), take3(W, last, 9)))
    put3(d, last, 0, x)
    largest = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    beyond = NONE
    for j in range(spans - 1, -1, -1):
        unknown = j < forces
        own = NONE
        move = NONE
        if unknown:
            if j + 1 < spans and place[j + 1, 0] > 0.0:
                g = add(take3(joints, j, PULL), tapply(get9(joints, j, CB), x))
                move = subtract(take3(joints, j, MOVED), apply(get9(joints, j, MC), subtract(g, beyond)))
            r = add(add(take3(joints, j, CLOSING), tapply(get9(joints, j, WE), x)), move)
            own = scale(-1.0, apply(get9(joints, j, SI), r))
        put3(joints, j, FORCE, own)
        put3(joints, j, SHIFTED, move)
        for k in range(where[j + 1] - 1, where[j] - 1, -1):
            z = take3(W, k, 9)
            if unknown:
                z = add(z, apply(get9(W, k, 0), own))
            x = scale(-1.0, add(apply(get9(P, k, 0), z), apply(get9(Y, k, 0), x)))
            put3(d, k, 0, x)
            size = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
            if not size <= largest:  # NaN is the largest of all
                largest = size
        beyond = own
    return math.sqrt(largest)
