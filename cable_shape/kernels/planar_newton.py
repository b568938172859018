"""Newton's method for the rod in a plane: the iteration of :mod:`cable_shape.kernels.rod_newton`, step for step.

Saddles are left to the spatial solver.
"""

from __future__ import annotations

import math
from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_element import Pair, half_turn, product, unit
from cable_shape.kernels.planar_system import CHANGE, G2, G, assemble, backward, border, factor, forward, gradient
from cable_shape.kernels.rod_algebra import FAST
from cable_shape.kernels.rod_newton import (
    CHORD_FROM,
    CONVERGED,
    FIRST_SHIFT,
    LARGEST_STEP,
    MOST_SHIFTS,
    NOT_FINITE,
    SADDLE,
    SHIFT_GROWTH,
    STALLED,
    STEP_TOLERANCE,
)

Array = Any


@kernel(fastmath=FAST)
def advance(z: Array, rows: Array, last: int, fraction: float) -> None:
    """Turns the frames by a fraction of the change."""
    for k in range(1, last + 1):
        z[k, 0], z[k, 1] = unit(product((z[k, 0], z[k, 1]), half_turn(fraction * rows[k, CHANGE])))


@kernel(fastmath=FAST)
def change_of_moment(rows: Array, h: Array, K: float, parts: Array, least: float) -> float:
    """Largest change of a moment, relative to the largest moment, or to `least` if that is larger."""
    moment = change = 0.0
    for e in range(h.shape[0]):
        moment = max(moment, abs(parts[e, G2]))
        change = max(change, abs(K * (rows[e + 1, CHANGE] - rows[e, CHANGE]) / h[e]))
    return change / max(moment, least)


@kernel
def newton(
    z: Array, lam: Pair, s: Array, h: Array, load: Array, rest: Array, K: float, C: Pair, softest: float, span: Pair,
    held: bool, base_shift: float, most: int, rows: Array, parts: Array, sums: Array, info: Array,
) -> tuple[int, Pair]:  # fmt: skip
    """Solves for z and lambda from the values they have; returns CONVERGED, STALLED or NOT_FINITE, and lambda.

    span [m]: position of the end relative to the start, in the plane. softest [N]: the smallest stiffness / length^2.
    info: as in `rod_newton.newton`, of the inertia in the plane alone.
    """
    elements = h.shape[0]
    nb = 2 if held else 0
    last = elements - 1 if held else elements
    length = s[elements]
    shift = largest = 0.0
    step = (0.0, 0.0)
    iterations = negative = 0
    while iterations < most:
        iterations += 1
        info[4] += 1.0
        assemble(z, lam, h, load, rest, K, C, rows, parts, sums)
        sums[9] += span[0]
        sums[10] += span[1]
        trial = shift / SHIFT_GROWTH if largest > CHORD_FROM and shift > FIRST_SHIFT * softest else 0.0
        untested = trial > 0.0
        for _ in range(MOST_SHIFTS):
            negative = factor(h, trial + base_shift, last, rows, parts, sums)
            step, more = border(held, sums)
            negative += more
            if trial == 0.0 or negative == nb:
                info[2] = negative - nb
            if negative == nb:
                break
            trial = max(SHIFT_GROWTH * trial, FIRST_SHIFT * softest)
        if negative != nb:
            return STALLED, lam
        shift = trial
        largest = backward(last, step, rows, parts)
        info[0], info[1], info[3] = iterations, largest, shift
        if not math.isfinite(largest):
            return NOT_FINITE, lam
        if shift > 0.0 and largest < SADDLE and not untested:
            return STALLED, lam
        fraction = min(1.0, LARGEST_STEP / largest) if largest > 0.0 else 1.0
        advance(z, rows, last, fraction)
        lam = (lam[0] + fraction * step[0], lam[1] + fraction * step[1])
        since = before = max(largest, change_of_moment(rows, h, K, parts, softest * length))
        stale = 0.0
        while shift == 0.0 and before < CHORD_FROM and iterations < most:
            iterations += 1
            info[6] = gradient(z, lam, h, load, rest, K, C, rows, parts, sums)
            sums[9] += span[0]
            sums[10] += span[1]
            forward(last, rows, parts, sums)
            step, _ = border(held, sums)
            largest = backward(last, step, rows, parts)
            info[0], info[1] = iterations, largest
            if not math.isfinite(largest):
                return NOT_FINITE, lam
            if largest < STEP_TOLERANCE:
                info[14] = max(stale, min(largest / before, since)) if before > 0.0 else stale
                return CONVERGED, lam
            if largest > 0.5 * before:
                work = sums[9] * step[0] + sums[10] * step[1] if held else 0.0
                for k in range(1, last + 1):
                    work += rows[k, G] * rows[k, CHANGE]
                if abs(work) < STEP_TOLERANCE**2 * softest * length:  # along a neutral mode
                    info[14] = stale
                    return CONVERGED, lam
                break
            stale = max(stale, min(largest / before, since))
            advance(z, rows, last, 1.0)
            lam = (lam[0] + step[0], lam[1] + step[1])
            before = largest
    return STALLED, lam
