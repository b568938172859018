"""The same formulas for LANES elements of the rod at a time: the compiler makes vector instructions of them.

`lanes` (ROWS x LANES numbers, flat) holds one number of each element in a row. Rows are a constant distance apart, so
that the compiler knows that they do not overlap.
"""

from __future__ import annotations

import numpy as np
from numba import types

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import FAST, Matrix, Quaternion, Vector, dot, get4, inlined
from cable_shape.kernels.rod_element import angle_series, gradient_of, hessian_of, relative

#: Elements side by side: what the widest registers hold.
LANES = 8
# Rows of what is given: length, quaternions, forces, rest curvature, section (stiffness, compliance, slope of the
# stiffness); relative rotation and its series.
H, LEFT, RIGHT, FORCE_LEFT, FORCE_MIDDLE, FORCE_RIGHT, REST, SLOPE = 0, 1, 5, 9, 12, 15, 18, 21
STIFF, COMPLIANCE, TAPER = 24, 27, 30
GIVEN = 33
V, W, SERIES = 33, 36, 37
# What comes: gradient in delta_1, delta_2, lambda, and the value, or in its place the blocks of the Hessian.
G1, G2, GL, VALUE, H11, H12, H22, B1, B2, CC = 40, 43, 46, 49, 49, 58, 67, 76, 85, 94
# And of what swings, what makes it firmer against a bow.
FIRMER = 103
ROWS = 105
#: Numbers that tell an element's section: stiffness 3, compliance 3, slope of the stiffness 3.
SECTION = 9


@inlined
def lane2(lanes: Array, row: int, k: int) -> tuple[float, float]:
    """Two numbers of element k."""
    i = row * LANES + k
    return lanes[i], lanes[i + LANES]


@inlined
def lane3(lanes: Array, row: int, k: int) -> Vector:
    """A vector of element k."""
    i = row * LANES + k
    return lanes[i], lanes[i + LANES], lanes[i + 2 * LANES]


@inlined
def lane4(lanes: Array, row: int, k: int) -> Quaternion:
    """A quaternion of element k."""
    i = row * LANES + k
    return lanes[i], lanes[i + LANES], lanes[i + 2 * LANES], lanes[i + 3 * LANES]


@inlined
def put_lane3(lanes: Array, row: int, k: int, v: Vector) -> None:
    """Writes a vector of element k."""
    i = row * LANES + k
    lanes[i], lanes[i + LANES], lanes[i + 2 * LANES] = v


@inlined
def put_lane4(lanes: Array, row: int, k: int, q: Quaternion) -> None:
    """Writes a quaternion of element k."""
    i = row * LANES + k
    lanes[i], lanes[i + LANES], lanes[i + 2 * LANES], lanes[i + 3 * LANES] = q


@inlined
def put_lane9(lanes: Array, row: int, k: int, A: Matrix) -> None:
    """Writes a matrix of element k."""
    put_lane3(lanes, row, k, (A[0], A[1], A[2]))
    put_lane3(lanes, row + 3, k, (A[3], A[4], A[5]))
    put_lane3(lanes, row + 6, k, (A[6], A[7], A[8]))


@inlined
def gather(
    begin: int, left: Array, q: Array, h: Array, full: Array, rest: Array, section: Array, lanes: Array
) -> int:  # fmt: skip
    """Fills length to section of the elements from `begin` on; returns how many there are, at most LANES.

    left (N,): the node at the left of each element, whose right one is the next; full (N, 9): internal force. Lanes
    beyond the last element repeat it.
    """
    elements = h.shape[0]
    for k in range(LANES):
        e = min(begin + k, elements - 1)
        node = left[e]
        lanes[H * LANES + k] = h[e]
        put_lane4(lanes, LEFT, k, get4(q, node))
        put_lane4(lanes, RIGHT, k, get4(q, node + 1))
        for i in range(9):
            lanes[(FORCE_LEFT + i) * LANES + k] = full[e, i]
        for i in range(6):
            lanes[(REST + i) * LANES + k] = rest[e, i]
        for i in range(SECTION):
            lanes[(STIFF + i) * LANES + k] = section[e, i]
    return min(LANES, elements - begin)


@inlined
def gather_firmer(begin: int, firmer: Array, lanes: Array) -> None:
    """Fills what swings has besides: firmer (N, 2)."""
    for k in range(LANES):
        e = min(begin + k, firmer.shape[0] - 1)
        lanes[FIRMER * LANES + k] = firmer[e, 0]
        lanes[(FIRMER + 1) * LANES + k] = firmer[e, 1]


@inlined
def opens(left: Array, e: int) -> bool:
    """Whether element e is the first of a span: its left node is not the right one of the element before."""
    return e == 0 or left[e] != left[e - 1] + 1


@kernel
def sections(stiff: Array, elements: int) -> Array:
    """(N, 9): the same for each element."""
    out = np.zeros((elements, SECTION))
    out[:, :6] = stiff
    return out


@inlined
def gather_turns(lanes: Array) -> None:
    """Fills relative rotations and their series."""
    for k in range(LANES):
        v, w = relative(lane4(lanes, LEFT, k), lane4(lanes, RIGHT, k))
        put_lane3(lanes, V, k, v)
        lanes[W * LANES + k] = w
        put_lane3(lanes, SERIES, k, angle_series(dot(v, v), w))


@kernel(fastmath=FAST)
def hessians(lanes: Array, elastic: bool, swings: bool | None) -> None:
    """`rod_element.element_hessian` of all lanes; elastic: a compliance may be above 0."""
    gather_turns(lanes)
    for k in range(LANES):
        g1, g2, gl, h11, h12, h22, b1, b2, cc = hessian_of(
            lane3(lanes, V, k), lanes[W * LANES + k], lane3(lanes, SERIES, k), elastic, lanes[H * LANES + k],
            lane4(lanes, LEFT, k), lane4(lanes, RIGHT, k), lane3(lanes, FORCE_LEFT, k), lane3(lanes, FORCE_MIDDLE, k),
            lane3(lanes, FORCE_RIGHT, k), lane3(lanes, REST, k), lane3(lanes, SLOPE, k), lane3(lanes, STIFF, k),
            lane3(lanes, COMPLIANCE, k), lane3(lanes, TAPER, k), lane2(lanes, FIRMER, k), swings,
        )  # fmt: skip
        put_lane3(lanes, G1, k, g1)
        put_lane3(lanes, G2, k, g2)
        put_lane3(lanes, GL, k, gl)
        put_lane9(lanes, H11, k, h11)
        put_lane9(lanes, H12, k, h12)
        put_lane9(lanes, H22, k, h22)
        put_lane9(lanes, B1, k, b1)
        put_lane9(lanes, B2, k, b2)
        put_lane9(lanes, CC, k, cc)


@kernel(late=types.none)
def swung_hessians(lanes: Array, elastic: bool) -> None:
    """Those of what swings."""
    hessians(lanes, elastic, True)


@kernel(fastmath=FAST)
def gradients(lanes: Array, swings: bool | None) -> None:
    """`rod_element.element_gradient` of all lanes."""
    gather_turns(lanes)
    for k in range(LANES):
        value, g1, g2, gl = gradient_of(
            lane3(lanes, V, k), lanes[W * LANES + k], lane3(lanes, SERIES, k), lanes[H * LANES + k],
            lane4(lanes, LEFT, k), lane4(lanes, RIGHT, k), lane3(lanes, FORCE_LEFT, k), lane3(lanes, FORCE_MIDDLE, k),
            lane3(lanes, FORCE_RIGHT, k), lane3(lanes, REST, k), lane3(lanes, SLOPE, k), lane3(lanes, STIFF, k),
            lane3(lanes, COMPLIANCE, k), lane3(lanes, TAPER, k), lane2(lanes, FIRMER, k), swings,
        )  # fmt: skip
        lanes[VALUE * LANES + k] = value
        put_lane3(lanes, G1, k, g1)
        put_lane3(lanes, G2, k, g2)
        put_lane3(lanes, GL, k, gl)


@kernel(late=types.none)
def swung_gradients(lanes: Array) -> None:
    """Those of what swings."""
    gradients(lanes, True)
