"""Block LDL^T of the rod's Newton matrix with its border, and what the pivots tell: the inertia.

The matrix is [[H, B], [B^T, CC]]; H is block tridiagonal with 3x3 blocks. Without pivoting,

    P_k = D_k - Y_{k-1}^T O_{k-1},  Y_k = P_k^-1 O_k,  W_k = B_k - Y_{k-1}^T W_{k-1},  S = CC - sum W_k^T P_k^-1 W_k.

An equilibrium is a strict minimum under the closure condition iff the whole matrix has as many negative eigenvalues as
the border has columns: negative(P) + negative(S) = nb.
"""

from __future__ import annotations

import math
from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    FAST,
    Matrix,
    apply,
    get9,
    inlined,
    inverse,
    madd,
    mscale,
    mul,
    negative_eigenvalues,
    put9,
    tmul,
)

Array = Any


@kernel(fastmath=FAST)
def factor(
    D: Array, U: Array, X: Array, mask: Array, shift: float, h: Array, P: Array, Y: Array, W: Array, gram: Array
) -> int:  # fmt: skip
    """Factors H + shift diag(mean element length); returns the number of its negative eigenvalues.

    P (N+1, 9) takes the inverse pivots, Y (N, 9) is as above, W the forward elimination of X, and gram (width, width)
    the sum of W_k^T P_k^-1 W_k. mask (2, 3) as in the assembly.
    """
    last = h.shape[0]
    width = X.shape[1] // 3
    gram[:, :] = 0.0
    negative = 0
    pivot = get9(D, 0, 0)
    for c in range(3 * width):
        W[0, c] = X[0, c]
    for k in range(last + 1):
        if shift != 0.0:
            size = 0.5 * shift * ((h[k - 1] if k > 0 else 0.0) + (h[k] if k < last else 0.0))
            d0 = d1 = d2 = size
            if k == 0 or k == last:  # held rotations are not shifted
                end = 0 if k == 0 else 1
                d0, d1, d2 = size * mask[end, 0], size * mask[end, 1], size * mask[end, 2]
            pivot = madd(pivot, (d0, 0.0, 0.0, 0.0, d1, 0.0, 0.0, 0.0, d2))
        inv, det = inverse(pivot)
        negative += negative_eigenvalues(pivot, det)
        put9(P, k, 0, inv)
        for j in range(width):
            x0, x1, x2 = W[k, j], W[k, width + j], W[k, 2 * width + j]
            y0 = inv[0] * x0 + inv[1] * x1 + inv[2] * x2
            y1 = inv[3] * x0 + inv[4] * x1 + inv[5] * x2
            y2 = inv[6] * x0 + inv[7] * x1 + inv[8] * x2
            for i in range(width):
                gram[i, j] += W[k, i] * y0 + W[k, width + i] * y1 + W[k, 2 * width + i] * y2
        if k == last:
            break
        off = get9(U, k, 0)
        if k == 0 or k + 1 == last:
            off = held(off, mask, k == 0, k + 1 == last)
        y = mul(inv, off)
        put9(Y, k, 0, y)
        for c in range(width):
            x0, x1, x2 = W[k, c], W[k, width + c], W[k, 2 * width + c]
            W[k + 1, c] = X[k + 1, c] - (y[0] * x0 + y[3] * x1 + y[6] * x2)
            W[k + 1, width + c] = X[k + 1, width + c] - (y[1] * x0 + y[4] * x1 + y[7] * x2)
            W[k + 1, 2 * width + c] = X[k + 1, 2 * width + c] - (y[2] * x0 + y[5] * x1 + y[8] * x2)
        pivot = madd(get9(D, k + 1, 0), mscale(-1.0, tmul(y, off)))
    return negative


@inlined
def held(A: Matrix, mask: Array, at_start: bool, at_end: bool) -> Matrix:
    """A block right of the diagonal without the rows held at the start and the columns held at the end."""
    a0, a1, a2 = (mask[0, 0], mask[0, 1], mask[0, 2]) if at_start else (1.0, 1.0, 1.0)
    b0, b1, b2 = (mask[1, 0], mask[1, 1], mask[1, 2]) if at_end else (1.0, 1.0, 1.0)
    return (
        a0 * A[0] * b0, a0 * A[1] * b1, a0 * A[2] * b2,
        a1 * A[3] * b0, a1 * A[4] * b1, a1 * A[5] * b2,
        a2 * A[6] * b0, a2 * A[7] * b1, a2 * A[8] * b2,
    )  # fmt: skip


@kernel(fastmath=FAST)
def forward(G: Array, P: Array, Y: Array, W: Array, gram: Array) -> None:
    """Eliminates another right-hand side G (N+1, 3) with the factors at hand: last column of W and of gram."""
    last = Y.shape[0]
    width = W.shape[1] // 3
    for b in range(width):
        gram[b, width - 1] = 0.0
    x0 = x1 = x2 = 0.0
    for k in range(last + 1):
        z0, z1, z2 = G[k, 0], G[k, 1], G[k, 2]
        if k > 0:
            j = k - 1
            z0 -= Y[j, 0] * x0 + Y[j, 3] * x1 + Y[j, 6] * x2
            z1 -= Y[j, 1] * x0 + Y[j, 4] * x1 + Y[j, 7] * x2
            z2 -= Y[j, 2] * x0 + Y[j, 5] * x1 + Y[j, 8] * x2
        x0, x1, x2 = z0, z1, z2
        W[k, width - 1], W[k, 2 * width - 1], W[k, 3 * width - 1] = x0, x1, x2
        y0 = P[k, 0] * x0 + P[k, 1] * x1 + P[k, 2] * x2
        y1 = P[k, 3] * x0 + P[k, 4] * x1 + P[k, 5] * x2
        y2 = P[k, 6] * x0 + P[k, 7] * x1 + P[k, 8] * x2
        for b in range(width):
            gram[b, width - 1] += W[k, b] * y0 + W[k, width + b] * y1 + W[k, 2 * width + b] * y2


@kernel
def border(gram: Array, CC: Array, closure: Array, step: Array) -> int:
    """Solves S dlambda = -closure + B^T H^-1 G into step (nb,); returns the number of negative eigenvalues of S.

    CC (9,): second derivative in lambda; closure (3,): derivative in lambda, the gap at the end. nb is 0 or 3.
    """
    if gram.shape[0] == 1:
        return 0
    S = (
        CC[0] - gram[0, 0], CC[1] - gram[0, 1], CC[2] - gram[0, 2],
        CC[3] - gram[0, 1], CC[4] - gram[1, 1], CC[5] - gram[1, 2],
        CC[6] - gram[0, 2], CC[7] - gram[1, 2], CC[8] - gram[2, 2],
    )  # fmt: skip
    inv, det = inverse(S)
    b = (gram[0, 3] - closure[0], gram[1, 3] - closure[1], gram[2, 3] - closure[2])
    step[0], step[1], step[2] = apply(inv, b)
    return negative_eigenvalues(S, det)


@kernel(fastmath=FAST)
def backward(P: Array, Y: Array, W: Array, step: Array, d: Array) -> float:
    """d (N+1, 3) = -H^-1 (G + B step) by back substitution; returns its largest norm."""
    last = Y.shape[0]
    width = W.shape[1] // 3
    d0 = d1 = d2 = largest = 0.0
    for k in range(last, -1, -1):
        z0, z1, z2 = W[k, width - 1], W[k, 2 * width - 1], W[k, 3 * width - 1]
        for b in range(width - 1):
            z0 += W[k, b] * step[b]
            z1 += W[k, width + b] * step[b]
            z2 += W[k, 2 * width + b] * step[b]
        x0 = P[k, 0] * z0 + P[k, 1] * z1 + P[k, 2] * z2
        x1 = P[k, 3] * z0 + P[k, 4] * z1 + P[k, 5] * z2
        x2 = P[k, 6] * z0 + P[k, 7] * z1 + P[k, 8] * z2
        if k < last:
            x0 += Y[k, 0] * d0 + Y[k, 1] * d1 + Y[k, 2] * d2
            x1 += Y[k, 3] * d0 + Y[k, 4] * d1 + Y[k, 5] * d2
            x2 += Y[k, 6] * d0 + Y[k, 7] * d1 + Y[k, 8] * d2
        d0, d1, d2 = -x0, -x1, -x2
        d[k, 0], d[k, 1], d[k, 2] = d0, d1, d2
        size = d0 * d0 + d1 * d1 + d2 * d2
        if not size <= largest:  # NaN is the largest of all
            largest = size
    return math.sqrt(largest)
