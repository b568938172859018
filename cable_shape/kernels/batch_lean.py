"""From one solved shape to the ends of another grasp, to first order: what the rows of a batch start from."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    Quaternion,
    Vector,
    add,
    apply,
    get3,
    get4,
    get9,
    inlined,
    put3,
    qconj,
    qexp,
    qlog,
    qmul,
    qnormal,
    tapply,
)
from cable_shape.kernels.rod_drive import NOW, TRIAL, slot
from cable_shape.kernels.rod_factor import backward, border, forward
from cable_shape.kernels.rod_work import matrices, vectors

Array = Any
WIDTH = 4  # of the border: both ends are held


@kernel
def aim(start: Array, end: Array, near: Array, ends: Array) -> bool:
    """Fills ends (15,) with both poses (7,), canonically wound, quaternion signs next to those of `near` (15,).

    False: the end is turned against the start by so much more or less that it is another winding there.
    """
    ends[:7], ends[7:14], ends[14] = start, end, 0.0
    relative = own = other = 0.0
    for i in range(3, 7):
        relative += ends[i] * ends[7 + i]
        own += ends[i] * near[i]
    a = 1.0 if own >= 0.0 else -1.0
    b = a if relative >= 0.0 else -a
    for i in range(3, 7):
        ends[i] *= a
        ends[7 + i] *= b
        other += ends[7 + i] * near[7 + i]
    return other > 0.0


@inlined
def shortest(p: Quaternion, q: Quaternion) -> Vector:
    """The rotation vector that turns the frame p into q, in the frame p, of at most half a turn."""
    turn = qmul(qconj(p), q)
    return qlog(turn) if turn[3] >= 0.0 else qlog((-turn[0], -turn[1], -turn[2], -turn[3]))


@kernel
def lean(sol: Array, work: Array, elements: int, ends: Array, trial: Array) -> None:
    """Fills the trial of `trial`: the solution now of `sol`, both ends clamped, leaning to first order to `ends`.

    work: with fresh factors of that solution.
    """
    q0, lam0, old = slot(sol, elements, NOW)
    q, lam, new = slot(trial, elements, TRIAL)
    new[:] = ends
    _, U, _, P, Y, W = matrices(work, elements, WIDTH)
    parts, _, G, d, gram, total, step = vectors(work, elements, WIDTH)
    first = shortest(get4(q0, 0), (ends[3], ends[4], ends[5], ends[6]))
    last = shortest(get4(q0, elements), (ends[10], ends[11], ends[12], ends[13]))
    G[:, :] = 0.0
    put3(G, 1, 0, tapply(get9(U, 0, 0), first))
    put3(G, elements - 1, 0, add(get3(G, elements - 1), apply(get9(U, elements - 1, 0), last)))
    closure = np.empty(3)
    a, b = tapply(get9(parts, 0, 9), first), tapply(get9(parts, elements - 1, 18), last)
    closure[0], closure[1], closure[2] = add(a, b)
    for i in range(3):
        closure[i] += (ends[7 + i] - ends[i]) - (old[7 + i] - old[i])
    forward(G, P, Y, W, gram)
    border(gram, total[3:], closure, step)
    backward(P, Y, W, step, d)
    put3(d, 0, 0, first)
    put3(d, elements, 0, last)
    for k in range(elements + 1):
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = qnormal(qmul(get4(q0, k), qexp(get3(d, k))))
    for i in range(3):
        lam[i] = lam0[i] + step[i]
    q[0, 0], q[0, 1], q[0, 2], q[0, 3] = ends[3], ends[4], ends[5], ends[6]
    for i in range(4):
        q[elements, i] = ends[10 + i]
