"""Local defects of the planar rod, and the correction that they call for: see :mod:`cable_shape.kernels.rod_defect`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_between import spin
from cable_shape.kernels.planar_element import (
    Pair,
    element_gradient,
    element_hessian,
    half_turn,
    product,
    relative,
    unit,
)
from cable_shape.kernels.planar_lanes import gather, lane2
from cable_shape.kernels.planar_rule import (
    M_LEFT,
    MISSED_PLACE,
    MISSED_TURN,
    PLACE,
    ROWS,
    TURN,
    gather_moments,
    is_long,
    land,
)
from cable_shape.kernels.planar_system import (
    B1,
    B2,
    CC,
    CHANGE,
    G1,
    G2,
    GL,
    H12,
    H22,
    MISSED,
    G,
    forces,
    respond,
)
from cable_shape.kernels.rod_algebra import FAST, inlined
from cable_shape.kernels.rod_defect import COARSE
from cable_shape.kernels.rod_lanes import LANES

Array = Any


@inlined
def as_gradient(e: int, turn: float, dM: float, dr: Pair, parts: Array) -> tuple[float, float, Pair]:
    """A defect of the landing as one of element e's gradient in theta_1, theta_2, lambda."""
    return (
        -parts[e, H12] * turn,
        dM - parts[e, H22] * turn,
        (-dr[0] - parts[e, B2] * turn, -dr[1] - parts[e, B2 + 1] * turn),
    )


@inlined
def between(x: float, a: Pair, b: Pair, c: Pair) -> Pair:
    """The parabola through a, b, c at 0, 1/2, 1."""
    f, g, k = (2.0 * x - 1.0) * (x - 1.0), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)
    return f * a[0] + g * b[0] + k * c[0], f * a[1] + g * b[1] + k * c[1]


@inlined
def halves(
    h: float, z1: Pair, z2: Pair, nL: Pair, nM: Pair, nR: Pair, k0: float, k1: float, K: float, C: Pair
) -> tuple[float, float, Pair]:  # fmt: skip
    """Gradient of two half elements in theta_1, theta_2, lambda, the rotation between them being in balance."""
    near, _ = relative(z1, z2)
    z = unit((z1[0] + near[0], z1[1] + near[1]))
    na, nb = between(0.25, nL, nM, nR), between(0.75, nL, nM, nR)
    ka, kb = k0 - 0.25 * h * k1, k0 + 0.25 * h * k1
    for _ in range(2):
        _, a2, _, _, _, A22, _, _, _ = element_hessian(0.5 * h, z1, z, nL, na, nM, ka, k1, K, C)
        b1, _, _, B11, _, _, _, _, _ = element_hessian(0.5 * h, z, z2, nM, nb, nR, kb, k1, K, C)
        z = unit(product(z, half_turn(-(a2 + b1) / (A22 + B11))))
    _, a1, _, al = element_gradient(0.5 * h, z1, z, nL, na, nM, ka, k1, K, C)
    _, _, b2, bl = element_gradient(0.5 * h, z, z2, nM, nb, nR, kb, k1, K, C)
    return a1, b2, (al[0] + bl[0], al[1] + bl[1])


@kernel(fastmath=FAST)
def defects(
    z: Array, lam: Pair, h: Array, load: Array, rest: Array, K: float, soft: float, C: Pair, rows: Array,
    parts: Array, side: Array, sums: Array,
) -> float:  # fmt: skip
    """Adds the defects of the gradient in the angles and in lambda to G of rows and to the closure in sums.

    `side` takes each element's of lambda and the moments, with the defect, at its right and at the first one's left.
    What the rule itself misses goes into G1 and MISSED of parts, in theta and lambda; what it misses at the last node
    is returned. soft: the smaller bending stiffness.
    """
    elements = h.shape[0]
    flex = 1.0 / K
    left = missing = s0 = s1 = 0.0
    lanes = np.empty(ROWS * LANES)
    for begin in range(0, elements, LANES):
        count = gather(begin, z, lam, h, load, rest, lanes)
        gather_moments(begin, lam, h, load, rest, parts, soft, lanes)
        land(lanes, flex, C)
        for k in range(count):
            e = begin + k
            gl, g1, g2 = (parts[e, GL], parts[e, GL + 1]), parts[e, G1], parts[e, G2]
            if is_long(h, load, lam, e, soft):
                nL, nM, nR = forces(load, e, lam)
                z1, z2 = (z[e, 0], z[e, 1]), (z[e + 1, 0], z[e + 1, 1])
                a1, a2, al = halves(h[e], z1, z2, nL, nM, nR, rest[e, 0], rest[e, 1], K, C)
                f = 16.0 / 15.0
                d1, d2, dl = f * (a1 - g1), f * (a2 - g2), (f * (al[0] - gl[0]), f * (al[1] - gl[1]))
                e1, e2, el = COARSE * d1, COARSE * d2, (COARSE * dl[0], COARSE * dl[1])
            else:
                turn, dM = lane2(lanes, TURN, k)
                d1, d2, dl = as_gradient(e, turn, dM, lane2(lanes, PLACE, k), parts)
                d1 -= lanes[M_LEFT * LANES + k] + g1  # what is missing to balance at the left node
                turn, dM = lane2(lanes, MISSED_TURN, k)
                e1, e2, el = as_gradient(e, turn, dM, lane2(lanes, MISSED_PLACE, k), parts)
            rows[e, G] += left + d1
            side[e, 0], side[e, 1] = dl
            if e == 0:
                side[0, 2] = -g1 - d1
            side[e, 3] = g2 + d2
            parts[e, G1] = missing + e1
            parts[e, MISSED], parts[e, MISSED + 1] = el
            left, missing = d2, e2
            s0, s1 = s0 + dl[0], s1 + dl[1]
    rows[elements, G] += left
    sums[9], sums[10] = sums[9] + s0, sums[10] + s1
    return missing


@inlined
def step_change(parts: Array, e: int, d1: float, d2: float, l0: float, l1: float) -> Pair:
    """Minus the change of element e's step in position, under rotations of its nodes and a change of lambda."""
    return (
        parts[e, B1] * d1 + parts[e, B2] * d2 + parts[e, CC] * l0 + parts[e, CC + 1] * l1,
        parts[e, B1 + 1] * d1 + parts[e, B2 + 1] * d2 + parts[e, CC + 1] * l0 + parts[e, CC + 2] * l1,
    )


@kernel(fastmath=FAST)
def correct(
    z: Array, lam: Pair, h: Array, load: Array, rest: Array, K: float, soft: float, C: Pair, stiffest: float,
    held: bool, rows: Array, parts: Array, side: Array, sums: Array, errors: Array, better: Array,
) -> tuple[Pair, float, float]:  # fmt: skip
    """The solution at hand without its discretisation error, to first order in it; see `rod_defect.correct`.

    better (N+1, 2) takes z, `side` the moments, GL of parts minus the steps in position; returns lambda, the largest
    error in position [m] that is taken off, and the largest that is left; infinite if they cannot be judged.
    """
    elements = h.shape[0]
    last = elements - 1 if held else elements
    missing = defects(z, lam, h, load, rest, K, soft, C, rows, parts, side, sums)
    l0, l1 = respond(last, held, rows, parts, sums)
    lam = (lam[0] + l0, lam[1] + l1)
    largest = r0 = r1 = c0 = c1 = 0.0
    side[0, 2] -= parts[0, H12] * rows[1, CHANGE] + parts[0, B1] * l0 + parts[0, B1 + 1] * l1
    for e in range(elements):
        d1, d2 = rows[e, CHANGE], rows[e + 1, CHANGE]
        p, q = step_change(parts, e, d1, d2, l0, l1)
        p, q = p + side[e, 0], q + side[e, 1]
        parts[e, GL] += p
        parts[e, GL + 1] += q
        r0, r1 = r0 + p, r1 + q
        largest = max(largest, r0 * r0 + r1 * r1)
        M = side[e, 3] + parts[e, H12] * d1 + parts[e, H22] * d2 + parts[e, B2] * l0 + parts[e, B2 + 1] * l1
        side[e, 3] = M
        if e < elements - 1:
            side[e + 1, 2] = M
        rows[e, G] = parts[e, G1]
        c0, c1 = c0 + parts[e, MISSED], c1 + parts[e, MISSED + 1]
    rows[elements, G] = missing
    sums[9], sums[10] = c0, c1
    for k in range(elements + 1):
        x = (z[k, 0], z[k, 1])
        turn = spin(x, rows[k, CHANGE])
        better[k, 0], better[k, 1] = unit((x[0] + turn[0], x[1] + turn[1]))
    l0, l1 = respond(last, held, rows, parts, sums)
    left = r0 = r1 = 0.0
    for e in range(elements):
        p, q = step_change(parts, e, rows[e, CHANGE], rows[e + 1, CHANGE], l0, l1)
        a, b = parts[e, MISSED], parts[e, MISSED + 1]
        errors[e] = math.sqrt(a * a + b * b) + h[e] * h[e] * abs(parts[e, G1]) / stiffest
        r0, r1 = r0 + p + a, r1 + q + b
        left = max(left, r0 * r0 + r1 * r1)
    if not math.isfinite(largest) or not math.isfinite(left):
        return lam, math.inf, math.inf
    return lam, math.sqrt(largest), math.sqrt(left)
