"""Vectors, 3x3 matrices and quaternions as tuples, which the compiler keeps in registers.

A vector is (x, y, z), a matrix nine numbers row by row, a quaternion (x, y, z, w).
"""

from __future__ import annotations

import math
from typing import Any

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel

Vector = tuple[float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]
Quaternion = tuple[float, float, float, float]

#: Freedom of rounding for the compiler; NaN and infinity keep their meaning.
FAST = {"contract", "reassoc", "nsz", "arcp"}


def inlined(function: Any) -> Any:
    """A kernel that is always inlined into its caller."""
    return kernel(function, forceinline=True, fastmath=FAST)


@inlined
def add(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@inlined
def subtract(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inlined
def scale(f: float, a: Vector) -> Vector:
    """f a."""
    return (f * a[0], f * a[1], f * a[2])


@inlined
def times(a: Vector, b: Vector) -> Vector:
    """diag(a) b."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@inlined
def dot(a: Vector, b: Vector) -> float:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inlined
def hat(a: Vector) -> Matrix:
    """The matrix of a x."""
    return (0.0, -a[2], a[1], a[2], 0.0, -a[0], -a[1], a[0], 0.0)


@inlined
def diagonal(a: Vector) -> Matrix:
    """diag(a)."""
    return (a[0], 0.0, 0.0, 0.0, a[1], 0.0, 0.0, 0.0, a[2])


@inlined
def outer(a: Vector, b: Vector) -> Matrix:
    """a b^T."""
    return (
        a[0] * b[0], a[0] * b[1], a[0] * b[2],
        a[1] * b[0], a[1] * b[1], a[1] * b[2],
        a[2] * b[0], a[2] * b[1], a[2] * b[2],
    )  # fmt: skip


@inlined
def madd(A: Matrix, B: Matrix) -> Matrix:
    """A + B."""
    return (
        A[0] + B[0], A[1] + B[1], A[2] + B[2],
        A[3] + B[3], A[4] + B[4], A[5] + B[5],
        A[6] + B[6], A[7] + B[7], A[8] + B[8],
    )  # fmt: skip


@inlined
def msub(A: Matrix, B: Matrix) -> Matrix:
    """A - B."""
    return (
        A[0] - B[0], A[1] - B[1], A[2] - B[2],
        A[3] - B[3], A[4] - B[4], A[5] - B[5],
        A[6] - B[6], A[7] - B[7], A[8] - B[8],
    )  # fmt: skip


@inlined
def mshift(A: Matrix, f: float) -> Matrix:
    """A + f I."""
    return (A[0] + f, A[1], A[2], A[3], A[4] + f, A[5], A[6], A[7], A[8] + f)


@inlined
def mscale(f: float, A: Matrix) -> Matrix:
    """f A."""
    return (f * A[0], f * A[1], f * A[2], f * A[3], f * A[4], f * A[5], f * A[6], f * A[7], f * A[8])


@inlined
def transpose(A: Matrix) -> Matrix:
    """A^T."""
    return (A[0], A[3], A[6], A[1], A[4], A[7], A[2], A[5], A[8])


@inlined
def symmetric(A: Matrix) -> Matrix:
    """A + A^T."""
    a, b, c = A[1] + A[3], A[2] + A[6], A[5] + A[7]
    return (2.0 * A[0], a, b, a, 2.0 * A[4], c, b, c, 2.0 * A[8])


@inlined
def mul(A: Matrix, B: Matrix) -> Matrix:
    """A B."""
    return (
        A[0] * B[0] + A[1] * B[3] + A[2] * B[6],
        A[0] * B[1] + A[1] * B[4] + A[2] * B[7],
        A[0] * B[2] + A[1] * B[5] + A[2] * B[8],
        A[3] * B[0] + A[4] * B[3] + A[5] * B[6],
        A[3] * B[1] + A[4] * B[4] + A[5] * B[7],
        A[3] * B[2] + A[4] * B[5] + A[5] * B[8],
        A[6] * B[0] + A[7] * B[3] + A[8] * B[6],
        A[6] * B[1] + A[7] * B[4] + A[8] * B[7],
        A[6] * B[2] + A[7] * B[5] + A[8] * B[8],
    )


@inlined
def tmul(A: Matrix, B: Matrix) -> Matrix:
    """A^T B."""
    return mul(transpose(A), B)


@inlined
def hat_mul(a: Vector, M: Matrix) -> Matrix:
    """hat(a) M: a x each column."""
    return (
        a[1] * M[6] - a[2] * M[3], a[1] * M[7] - a[2] * M[4], a[1] * M[8] - a[2] * M[5],
        a[2] * M[0] - a[0] * M[6], a[2] * M[1] - a[0] * M[7], a[2] * M[2] - a[0] * M[8],
        a[0] * M[3] - a[1] * M[0], a[0] * M[4] - a[1] * M[1], a[0] * M[5] - a[1] * M[2],
    )  # fmt: skip


@inlined
def mul_hat(M: Matrix, a: Vector) -> Matrix:
    """M hat(a): each row x a."""
    return (
        M[1] * a[2] - M[2] * a[1], M[2] * a[0] - M[0] * a[2], M[0] * a[1] - M[1] * a[0],
        M[4] * a[2] - M[5] * a[1], M[5] * a[0] - M[3] * a[2], M[3] * a[1] - M[4] * a[0],
        M[7] * a[2] - M[8] * a[1], M[8] * a[0] - M[6] * a[2], M[6] * a[1] - M[7] * a[0],
    )  # fmt: skip


@inlined
def rows_times(a: Vector, M: Matrix) -> Matrix:
    """diag(a) M."""
    return (
        a[0] * M[0], a[0] * M[1], a[0] * M[2],
        a[1] * M[3], a[1] * M[4], a[1] * M[5],
        a[2] * M[6], a[2] * M[7], a[2] * M[8],
    )  # fmt: skip


@inlined
def columns_times(M: Matrix, a: Vector) -> Matrix:
    """M diag(a)."""
    return (
        M[0] * a[0], M[1] * a[1], M[2] * a[2],
        M[3] * a[0], M[4] * a[1], M[5] * a[2],
        M[6] * a[0], M[7] * a[1], M[8] * a[2],
    )  # fmt: skip


@inlined
def apply(A: Matrix, v: Vector) -> Vector:
    """A v."""
    return (
        A[0] * v[0] + A[1] * v[1] + A[2] * v[2],
        A[3] * v[0] + A[4] * v[1] + A[5] * v[2],
        A[6] * v[0] + A[7] * v[1] + A[8] * v[2],
    )


@inlined
def tapply(A: Matrix, v: Vector) -> Vector:
    """A^T v."""
    return (
        A[0] * v[0] + A[3] * v[1] + A[6] * v[2],
        A[1] * v[0] + A[4] * v[1] + A[7] * v[2],
        A[2] * v[0] + A[5] * v[1] + A[8] * v[2],
    )


@inlined
def inverse(A: Matrix) -> tuple[Matrix, float]:
    """A^-1 by cofactors, and the determinant; infinite or NaN where singular."""
    c0 = A[4] * A[8] - A[5] * A[7]
    c1 = A[5] * A[6] - A[3] * A[8]
    c2 = A[3] * A[7] - A[4] * A[6]
    det = A[0] * c0 + A[1] * c1 + A[2] * c2
    f = 1.0 / det
    return (
        f * c0, f * (A[2] * A[7] - A[1] * A[8]), f * (A[1] * A[5] - A[2] * A[4]),
        f * c1, f * (A[0] * A[8] - A[2] * A[6]), f * (A[2] * A[3] - A[0] * A[5]),
        f * c2, f * (A[1] * A[6] - A[0] * A[7]), f * (A[0] * A[4] - A[1] * A[3]),
    ), det  # fmt: skip


@inlined
def inverse_by_pivots(A: Matrix) -> tuple[Matrix, int]:
    """A^-1 by L U without exchanges, and, of a symmetric A, how many of its eigenvalues are negative.

    Where A is definite this is accurate however far its eigenvalues are apart; cofactors are not beyond 1e7.
    """
    a, b, c = A[0], A[1], A[2]
    f = 1.0 / a
    x, y = f * A[3], f * A[6]
    d, u = A[4] - x * b, A[5] - x * c
    g = 1.0 / d
    z = g * (A[7] - y * b)
    e = A[8] - y * c - z * u
    h = 1.0 / e
    negative = 0
    if a < 0.0:
        negative += 1
    if d < 0.0:
        negative += 1
    if e < 0.0:
        negative += 1
    w = x * z - y
    m, p, q = -u * g * h, -b * f * g, (b * u * g - c) * f * h
    return (
        f - x * p + q * w, p - q * z, q,
        -x * g + m * w, g - m * z, m,
        h * w, -h * z, h,
    ), negative  # fmt: skip


@inlined
def negative_eigenvalues(A: Matrix, det: float) -> int:
    """How many eigenvalues of the symmetric A are negative: Descartes' rule, exact as all roots are real."""
    trace = A[0] + A[4] + A[8]
    minors = A[0] * A[4] - A[1] * A[3] + A[0] * A[8] - A[2] * A[6] + A[4] * A[8] - A[5] * A[7]
    # det(x I + A) = x^3 + trace x^2 + minors x + det: one sign change for each negative eigenvalue of A
    count = 0
    last = 1.0
    if trace != 0.0:
        if trace * last < 0.0:
            count += 1
        last = trace
    if minors != 0.0:
        if minors * last < 0.0:
            count += 1
        last = minors
    if det * last < 0.0:
        count += 1
    return count


@inlined
def qmul(p: Quaternion, q: Quaternion) -> Quaternion:
    """Hamilton product p q."""
    return (
        p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] - p[0] * q[2] + p[1] * q[3] + p[2] * q[0],
        p[3] * q[2] + p[0] * q[1] - p[1] * q[0] + p[2] * q[3],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    )


@inlined
def qconj(q: Quaternion) -> Quaternion:
    """The inverse of a unit quaternion."""
    return (-q[0], -q[1], -q[2], q[3])


@inlined
def qnormal(q: Quaternion) -> Quaternion:
    """q scaled to unit length."""
    f = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (f * q[0], f * q[1], f * q[2], f * q[3])


@inlined
def qnear(q: Quaternion) -> Quaternion:
    """q, nearly of unit length, scaled to unit length: within 1e-8 of it without a root, to rounding."""
    x = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    f = 1.5 - 0.5 * x if abs(x - 1.0) < 1e-8 else 1.0 / math.sqrt(x)
    return (f * q[0], f * q[1], f * q[2], f * q[3])


@inlined
def rotation(q: Quaternion) -> Matrix:
    """The rotation matrix of a unit quaternion, columns d1, d2, d3."""
    x, y, z, w = q
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@inlined
def qexp(a: Vector) -> Quaternion:
    """The unit quaternion of the rotation vector a."""
    x = dot(a, a)
    if x < 1e-3:  # the series, exact to rounding, spares root and sine
        f = 0.5 - x / 48.0 * (1.0 - x / 80.0)
        return (f * a[0], f * a[1], f * a[2], 1.0 - x / 8.0 * (1.0 - x / 48.0 * (1.0 - x / 120.0)))
    angle = math.sqrt(x)
    f = math.sin(0.5 * angle) / angle
    return (f * a[0], f * a[1], f * a[2], math.cos(0.5 * angle))


@inlined
def qlog(q: Quaternion) -> Vector:
    """The rotation vector of a unit quaternion, of length 0 to 2 pi: q and -q are told apart."""
    sine = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    f = 2.0 / q[3] if sine < 1e-9 and q[3] > 0.0 else 2.0 * math.atan2(sine, q[3]) / max(sine, 1e-300)
    return (f * q[0], f * q[1], f * q[2])


@inlined
def get3(a: Array, i: int) -> Vector:
    """Row i of an (n, 3) array."""
    return (a[i, 0], a[i, 1], a[i, 2])


@inlined
def take3(a: Array, i: int, o: int) -> Vector:
    """Three numbers of row i from column o on."""
    return (a[i, o], a[i, o + 1], a[i, o + 2])


@inlined
def get4(a: Array, i: int) -> Quaternion:
    """Row i of an (n, 4) array."""
    return (a[i, 0], a[i, 1], a[i, 2], a[i, 3])


@inlined
def get9(a: Array, i: int, o: int) -> Matrix:
    """Nine numbers of row i from column o on."""
    return (
        a[i, o], a[i, o + 1], a[i, o + 2], a[i, o + 3], a[i, o + 4],
        a[i, o + 5], a[i, o + 6], a[i, o + 7], a[i, o + 8],
    )  # fmt: skip


@inlined
def put3(a: Array, i: int, o: int, v: Vector) -> None:
    """Writes three numbers into row i from column o on."""
    a[i, o], a[i, o + 1], a[i, o + 2] = v


@inlined
def put9(a: Array, i: int, o: int, A: Matrix) -> None:
    """Writes nine numbers into row i from column o on."""
    for c in range(9):
        a[i, o + c] = A[c]
