"""Newton's method for a row of a batch: with the factors of the shape beside first, then with its own, once."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.batch_lean import WIDTH
from cable_shape.kernels.rod_drive import STRAIGHT, TOO_FAR, TRIAL, finish, mesh_parts, prediction, slot
from cable_shape.kernels.rod_factor import backward, border, factor, forward
from cable_shape.kernels.rod_newton import (
    CONVERGED,
    LARGEST_STEP,
    STALLED,
    advance,
    change_of_moment,
    newton,
)
from cable_shape.kernels.rod_system import assemble, gradient
from cable_shape.kernels.rod_work import matrices, vectors

Array = Any
#: rad, and of the moments: a first step with own factors that is longer leaves them too far from the solution.
OWN_STEP = 0.03
#: What the last step leaves, of the tolerance over the length [rad].
LEFT_OVER = 0.02
MOST_ITERATIONS, MOST_CHORDS = 25, 6


@kernel
def near(
    q: Array, lam: Array, h: Array, load: Array, rest: Array, stiff: Array, moment: Array, mask: Array, span: Array,
    length: float, shift: float, beside: Array, work: Array, left: float, info: Array,
) -> int:  # fmt: skip
    """Solves for q and lambda from the values they have; returns CONVERGED, or else another method has to go on.

    beside: a work array with the factors of a shape nearby on the same mesh. left [rad]: what the last step, which is
    found but left to the correction of the discretisation error, may leave. info: as of `rod_newton.newton`.
    """
    elements = h.shape[0]
    D, U, X, P, Y, W = matrices(work, elements, WIDTH)
    parts, first, G, d, gram, total, step = vectors(work, elements, WIDTH)
    _, _, _, P0, Y0, W0 = matrices(beside, elements, WIDTH)
    _, _, _, _, gram0, total0, _ = vectors(beside, elements, WIDTH)
    softest = min(stiff[0], stiff[1], stiff[2]) / (length * length)
    gradient(q, lam, h, load, rest, stiff, moment, mask, G, first, total)
    for i in range(3):
        total[i] += span[i]
    forward(G, P0, Y0, W0, gram0)
    border(gram0, total0[3:], total[:3], step)
    largest = backward(P0, Y0, W0, step, d)
    if not largest < LARGEST_STEP:
        return STALLED
    advance(q, lam, d, step, 1.0)
    assemble(q, lam, h, load, rest, stiff, moment, mask, D, U, X, parts, first, total)
    for i in range(3):
        total[i] += span[i]
    negative = factor(D, U, X, mask, shift, h, P, Y, W, gram)
    negative += border(gram, total[3:], total[:3], step)
    largest = backward(P, Y, W, step, d)
    info[0], info[1], info[2], info[4] = 2.0, largest, negative - (WIDTH - 1), 1.0
    since = before = max(largest, change_of_moment(d, h, stiff, first, softest * length))
    if negative != WIDTH - 1 or not largest < LARGEST_STEP:
        return STALLED
    advance(q, lam, d, step, 1.0)
    if not before < OWN_STEP:
        return STALLED
    stale = 0.0
    for _ in range(MOST_CHORDS):
        info[0] += 1.0
        info[6] = gradient(q, lam, h, load, rest, stiff, moment, mask, G, first, total)
        for i in range(3):
            total[i] += span[i]
        forward(G, P, Y, W, gram)
        border(gram, total[3:], total[:3], step)
        largest = backward(P, Y, W, step, d)
        info[1] = largest
        if not largest < 0.5 * before:
            return STALLED
        stale = max(stale, min(largest / before, since))
        if largest * stale < left:
            info[14] = stale
            return CONVERGED
        advance(q, lam, d, step, 1.0)
        before = largest
    return STALLED


@kernel
def solve_beside(
    par: Array, mesh: Array, sol: Array, beside: Array, work: Array, out: Array, info: Array, elements: int,
    points: int, tolerance: float, far: float,
) -> int:  # fmt: skip
    """As `rod_drive.solve` with a guard, both ends clamped, from the frames and the force in the trial part of `sol`.

    beside: see `near`; tolerance [m]: of positions.
    """
    s, h, load, rest, _, _ = mesh_parts(mesh, elements)
    q, lam, ends = slot(sol, elements, TRIAL)
    stiff, moment, mask = par[0:6], par[6:9], par[9:15].reshape(2, 3)
    span = np.empty(3)
    chord = 0.0
    for i in range(3):
        span[i] = ends[7 + i] - ends[i]
        chord += span[i] ** 2
    if par[5] == 0.0 and chord >= (STRAIGHT * par[19]) ** 2:
        return TOO_FAR
    prediction(work, elements)[:, :] = q
    info[:] = 0.0
    left = LEFT_OVER * tolerance / par[19]
    code = near(q, lam, h, load, rest, stiff, moment, mask, span, par[19], par[18], beside, work, left, info)
    if code != CONVERGED:
        done = info[0]
        code = newton(
            q, lam, s, h, load, rest, stiff, moment, mask, span, par[18], True, MOST_ITERATIONS, work, WIDTH, info
        )
        info[0] += done
    if code != CONVERGED:
        return code
    return finish(par, mesh, sol, work, out, info, elements, WIDTH, points, far)
