"""From nothing to the shape of a limp cable among bodies: a stiffer one is laid there and softened."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable

from cable_shape.cable.pieces import changed
from cable_shape.checks import Array
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching.step import Steps

LIMP = 5e-4  #: EI / (w L^3): softer cables come from stiffer ones first
STIFF = 2e-3  #: the same, of these
_SOFTENING, _LEAST_SOFTENING = 3.0, 1.05  #: by which factor in one step, at first and at least
_EAGER = 1.5  #: power of the factor after a step that succeeds, and its inverse, twice, after one that fails
_ITERATIONS = 60  #: many, for contacts begin and end one at a time


def soften(steps: Steps, frames: Array, lay: Callable[[Problem], bool]) -> bool:
    """From the equilibrium of a stiffer cable at `frames`, which `lay` finds for its problem, to that of the cable."""
    state = steps.state
    factor, softening = STIFF / state.limpness, _SOFTENING

    try:
        state.stiffen(factor)
        found = lay(_as_stiff(steps.problem, factor))
        while found and factor > 1.0 and not steps.out_of_time():
            to = max(factor / softening, 1.0)
            state.stiffen(to)
            if steps.go(frames, 1, _ITERATIONS, math.inf, jump=True):
                factor, softening = to, min(softening**_EAGER, _SOFTENING**2)
            else:
                softening **= _EAGER**-2
                found = softening > _LEAST_SOFTENING
        return found and factor == 1.0
    finally:
        state.stiffen(1.0)


def _as_stiff(problem: Problem, factor: float) -> Problem:
    """The problem of a cable so many times as stiff."""
    stiffer = copy.copy(problem)
    cable = problem.cable
    stiffer.cable = changed(
        cable,
        bending_stiffness=tuple(factor * k for k in cable.bending_stiffness),
        twisting_stiffness=factor * cable.twisting_stiffness,
    )
    stiffer.cache, stiffer.made = {}, {}
    return stiffer
