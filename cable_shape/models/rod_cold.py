"""From nothing to a shape of the rod: guesses, the likeliest first, and stiffer cables that are softened."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.models.rod_call import COLD_ITERATIONS, RodCall
from cable_shape.problem import NAMED_TOLERANCE

#: (kind, tilt of the handles) of the guesses of `rod_drive.guess`.
_HANGING, _NATURAL = (0, 0.0), (2, 0.0)
_FLAT, _CURVED, _MORE_CURVED, _STEEP = (1, 0.02), (1, 0.3), (1, 0.8), (1, 1.2)
#: Shapes nearer to each other than this fraction of the length are one.
_SAME = 0.02
#: So many times as stiff are cables from which next to limp ones are softened, and by this factor in one step.
_STIFFER, _SOFTENING = (8.0, 64.0, 512.0, 4096.0), 2.0


def guesses(rod: RodCall, ends: Array) -> tuple[tuple[int, float], ...]:
    """Which guesses, in which order: soft or taut cables hang, stiff ones curve."""
    state, length = rod.state, rod.problem.cable.length
    if state.width == 1:
        return (_NATURAL,)
    soft = state.bend < math.hypot(*state.mean_load.tolist()) * (0.3 * length) ** 3
    taut = math.dist(ends[7:10].tolist(), ends[:3].tolist()) > 0.97 * length
    if soft or taut:
        return (_HANGING, _CURVED, _MORE_CURVED, _FLAT, _STEEP)
    return (_CURVED, _HANGING, _MORE_CURVED, _FLAT, _STEEP)


def find_again(rod: RodCall, coarse: Array) -> bool:
    """From the guesses to the shape whose positions (n, 3) a coarse mesh gave, on a mesh of its own."""
    state, points = rod.state, rod.problem.points
    ends = state.target.copy()
    force, layer = state.hanging(ends)
    for kind, sag in guesses(rod, ends):
        state.first_mesh(layer, 2.0)
        state.start_from(ends, force, kind, sag)
        if rod.solve(0, COLD_ITERATIONS):
            apart = rod.buffer[points : 4 * points].reshape(points, 3) - coarse
            if float((apart * apart).sum(axis=1).max()) < (_SAME * rod.problem.cable.length) ** 2:
                return True
    return False


def soften(rod: RodCall, ends: Array) -> bool:
    """From the shape of a stiffer cable: what is next to limp bends so sharply that no guess is near enough."""
    state = rod.state
    if state.width == 1:
        return False
    stiffness, tolerance = state.par[:3].copy(), state.tolerance
    state.tolerance = min(tolerance, NAMED_TOLERANCE * rod.problem.cable.length)
    try:
        stiffer = next((f for f in _STIFFER if _as_stiff(rod, f * stiffness, ends)), 1.0)
        while stiffer > 1.0:
            stiffer = max(1.0, stiffer / _SOFTENING)
            state.par[:3] = stiffer * stiffness
            state.history = 1
            state.unsettle()
            if rod.out_of_time() or not rod.solve(1, COLD_ITERATIONS) or not rod.refine():
                return False
        return stiffer == 1.0 and state.history > 0
    finally:
        state.par[:3] = stiffness
        state.tolerance, state.history = tolerance, 0


def _as_stiff(rod: RodCall, stiffness: Array, ends: Array) -> bool:
    """Whether a cable of this stiffness (3,) has a stable shape that a guess leads to."""
    state = rod.state
    state.par[:3] = stiffness
    force, layer = state.hanging(ends)
    for kind, sag in (_HANGING, _CURVED):
        state.first_mesh(layer, 1.0)
        state.start_from(ends, force, kind, sag)
        if rod.solve(0, COLD_ITERATIONS) and rod.refine():
            return True
    return False
