"""Newton's method for the rod: damped by inertia and step length, finished by chord steps.

Far from an equilibrium the Hessian is shifted until it has the inertia of a minimum and the step is capped in radians.
Close to it the last factors serve for one more step or two, which costs a gradient only.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import get4, put3, qexp, qmul, qnormal
from cable_shape.kernels.rod_factor import backward, border, factor, forward
from cable_shape.kernels.rod_system import assemble, gradient
from cable_shape.kernels.rod_work import matrices, vectors

Array = Any

CONVERGED, STALLED, NOT_FINITE = 0, 1, 2
LARGEST_STEP = 0.6  # rad
CHORD_FROM = 3e-3  # rad, and of the moments: below this a full step is followed by chord steps
STEP_TOLERANCE = 1e-5  # rad, of a chord step, which the correction of the discretisation error then includes
FIRST_SHIFT, SHIFT_GROWTH, MOST_SHIFTS = 0.02, 6.0, 16  # the first as a fraction of stiffness / length^2
SADDLE = 1e-5  # rad, a shifted step below this is no progress
KICK = 0.1  # rad
MOST_KICKS = 3


@kernel
def advance(q: Array, lam: Array, d: Array, step: Array, fraction: float) -> None:
    """q exp(fraction d), lambda + fraction step."""
    for k in range(q.shape[0]):
        x, y, z = fraction * d[k, 0], fraction * d[k, 1], fraction * d[k, 2]
        turned = qnormal(qmul(get4(q, k), qexp((x, y, z))))
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = turned
    for i in range(step.shape[0] - 1):
        lam[i] += fraction * step[i]


@kernel
def change_of_moment(d: Array, h: Array, stiff: Array, first: Array, least: float) -> float:
    """Largest change of a moment by the step d, relative to the largest moment, or to `least` if that is larger."""
    moment = change = 0.0
    for e in range(h.shape[0]):
        a, b = first[e, 6] ** 2 + first[e, 7] ** 2 + first[e, 8] ** 2, 0.0
        for i in range(3):
            b += (stiff[i] * (d[e + 1, i] - d[e, i]) / h[e]) ** 2
        moment, change = max(moment, a), max(change, b)
    return math.sqrt(change) / max(math.sqrt(moment), least)


@kernel
def work_of(G: Array, d: Array, closure: Array, step: Array) -> float:
    """[J] twice what a step would still save."""
    work = 0.0
    for k in range(G.shape[0]):
        work += G[k, 0] * d[k, 0] + G[k, 1] * d[k, 1] + G[k, 2] * d[k, 2]
    for i in range(step.shape[0] - 1):
        work += closure[i] * step[i]
    return abs(work)


@kernel
def kick(
    s: Array, h: Array, mask: Array, P: Array, Y: Array, W: Array, gram: Array, CC: Array, G: Array, d: Array,
    step: Array,
) -> None:  # fmt: skip
    """Fills d with a turn of KICK rad along the softest shapes of the factored, shifted matrix: away from a saddle.

    Held rotations stay: where G is zero there, d is.
    """
    last = h.shape[0]
    closure = np.zeros(3)
    for k in range(last + 1):
        x = math.pi * s[k] / s[last]
        size = 0.5 * ((h[k - 1] if k > 0 else 0.0) + (h[k] if k < last else 0.0))
        a, b, c = size * math.sin(x), size * math.sin(2.0 * x), size * math.cos(x)
        put3(G, k, 0, (0.8 * a - 0.3 * b + 0.2 * c, 0.5 * a + 0.6 * b - 0.3 * c, 0.2 * a + 0.1 * b + 0.3 * c))
    for _ in range(4):
        for i in range(3):
            G[0, i] *= mask[0, i]
            G[last, i] *= mask[1, i]
        forward(G, P, Y, W, gram)
        border(gram, CC, closure, step)
        largest = backward(P, Y, W, step, d)
        for k in range(last + 1):
            size = 0.5 * ((h[k - 1] if k > 0 else 0.0) + (h[k] if k < last else 0.0))
            for i in range(3):
                d[k, i] *= KICK / largest
                G[k, i] = size * d[k, i]
    for i in range(step.shape[0]):
        step[i] = 0.0


@kernel
def newton(
    q: Array, lam: Array, s: Array, h: Array, load: Array, rest: Array, stiff: Array, moment: Array, mask: Array,
    span: Array, base_shift: float, guard: bool, most: int, work: Array, width: int, info: Array,
) -> int:  # fmt: skip
    """Solves for q and lambda from the values they have; returns CONVERGED, STALLED or NOT_FINITE.

    span (3,) [m]: position of the end relative to the start. base_shift: shift that is always there, for problems with
    a zero mode. guard: keep to minima; without it any equilibrium is accepted. most: iterations allowed. info: 0
    iterations, 1 last step [rad], 2 negative eigenvalues beyond those of the border (0: stable), 3 shift of the last
    iteration, 4 assemblies, 5 kicks off a saddle, 6 value of the functional, 14 how much of an
    error the last step with old factors left.
    """
    elements = h.shape[0]
    D, U, X, P, Y, W = matrices(work, elements, width)
    parts, first, G, d, gram, total, step = vectors(work, elements, width)
    nb = width - 1
    length = s[elements]
    softest = min(stiff[0], stiff[1], stiff[2]) / (length * length)
    shift = largest = 0.0
    closure, CC = total[:3], total[3:]
    iterations = 0
    while iterations < most:
        iterations += 1
        info[4] += 1.0
        assemble(q, lam, h, load, rest, stiff, moment, mask, D, U, X, parts, first, total)
        if nb > 0:
            for i in range(3):
                total[i] += span[i]
        # far away the last shift is the best bet; near an equilibrium only the unshifted inertia tells
        trial = shift / SHIFT_GROWTH if largest > CHORD_FROM and shift > FIRST_SHIFT * softest else 0.0
        untested = trial > 0.0
        for _ in range(MOST_SHIFTS):
            negative = factor(D, U, X, mask, trial + base_shift, h, P, Y, W, gram)
            negative += border(gram, CC, closure, step)
            if trial == 0.0 or negative == nb:
                info[2] = negative - nb
            if negative == nb or not guard:
                break
            trial = max(SHIFT_GROWTH * trial, FIRST_SHIFT * softest)
        if guard and negative != nb:
            return STALLED
        shift = trial
        largest = backward(P, Y, W, step, d)
        info[0], info[1], info[3] = iterations, largest, shift
        if not math.isfinite(largest):
            return NOT_FINITE
        if shift > 0.0 and largest < SADDLE and not untested:
            if info[5] >= MOST_KICKS:
                return STALLED
            info[5] += 1.0
            kick(s, h, mask, P, Y, W, gram, CC, G, d, step)
            largest = KICK
        advance(q, lam, d, step, min(1.0, LARGEST_STEP / largest) if largest > 0.0 else 1.0)
        since = before = max(largest, change_of_moment(d, h, stiff, first, softest * length))
        stale = 0.0
        while shift == 0.0 and before < CHORD_FROM and iterations < most:
            iterations += 1
            info[6] = gradient(q, lam, h, load, rest, stiff, moment, mask, G, first, total)
            if nb > 0:
                for i in range(3):
                    total[i] += span[i]
            forward(G, P, Y, W, gram)
            border(gram, CC, closure, step)
            largest = backward(P, Y, W, step, d)
            info[0], info[1] = iterations, largest
            if not math.isfinite(largest):
                return NOT_FINITE
            if largest < STEP_TOLERANCE:
                info[14] = max(stale, min(largest / before, since)) if before > 0.0 else stale
                return CONVERGED
            if largest > 0.5 * before:
                if work_of(G, d, closure, step) < STEP_TOLERANCE**2 * softest * length:  # along a neutral mode
                    info[14] = stale
                    return CONVERGED
                break
            stale = max(stale, min(largest / before, since))
            advance(q, lam, d, step, 1.0)
            before = largest
    return STALLED
