"""The models as solvers that keep their warm start: :func:`solver_of`."""

from __future__ import annotations

import math
from collections.abc import Callable
from time import perf_counter
from typing import Protocol, final

import numpy as np

from cable_shape import checks
from cable_shape.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.models import catenary, clipped, cosserat, gradient, touching
from cable_shape.models.rod_state import RodState
from cable_shape.models.span_state import SpanState
from cable_shape.models.touch_state import TouchState
from cable_shape.problem import Problem
from cable_shape.shape import CableShape

MODELS = ("catenary", "gradient4", "gradient6", "cosserat", "auto")


class Solver(Protocol):
    """One model with its warm start."""

    def solve(self, problem: Problem) -> CableShape:
        """The shape, from the last solution if there is one."""

    def reset(self) -> None:
        """Forgets the last solution."""

    def go_on_from(self, problem: Problem, shape: CableShape, frames: Array) -> None:
        """Makes a shape that was found otherwise the last one in contact with bodies."""

    def rod_state(self) -> RodState | SpanState | TouchState | None:
        """The Cosserat rod of the last shape; None: there is none."""


@final
class ClosedForm:
    """A model in closed form; what it remembers is one array, NaN when cold."""

    __slots__ = ("_memory", "_solve")

    def __init__(self, solve: Callable[[Problem, Array], CableShape], memory: Array) -> None:
        self._solve = solve
        self._memory = memory

    def solve(self, problem: Problem) -> CableShape:
        return self._solve(problem, self._memory)

    def reset(self) -> None:
        self._memory[:] = math.nan

    def go_on_from(self, problem: Problem, shape: CableShape, frames: Array) -> None:
        return

    def rod_state(self) -> None:
        return None


@final
class Rod:
    """The Cosserat rod, in clips, in contact or neither; its warm start is the last solution with its mesh."""

    __slots__ = ("_last", "_time_budget", "_touch", "state")

    def __init__(self, time_budget: float = math.inf) -> None:
        self.state: RodState | SpanState | None = None
        self._time_budget = time_budget  # s
        self._last: CableShape | None = None
        self._touch: TouchState | None = None

    def solve(self, problem: Problem) -> CableShape:
        deadline = math.inf if self._time_budget == math.inf else perf_counter() + self._time_budget
        if problem.clips and not isinstance(self.state, SpanState):
            self.state = SpanState(problem, self._last)
        if not problem.clips and not isinstance(self.state, RodState):
            self.state = RodState(problem)
        assert self.state is not None
        if problem.bodies:
            if self._touch is None:
                self._touch = TouchState(problem)
            shape = touching.solve(problem, self._touch, self.state, deadline=deadline)
        else:
            self._touch = None
            if isinstance(self.state, SpanState):
                return clipped.solve(problem, self.state, deadline=deadline)
            shape = cosserat.solve(problem, self.state, deadline=deadline)
        if not problem.clips:
            self._last = shape
        return shape

    def go_on_from(self, problem: Problem, shape: CableShape, frames: Array) -> None:
        """Makes a shape that was found otherwise, ends in `frames` (2, 7), the last one in contact with bodies."""
        if not problem.bodies:
            return
        if self._touch is None:
            self._touch = TouchState(problem)
        supports = self._touch.aim(problem.start, problem.end)
        supports[0], supports[-1] = frames
        self._touch.resume(shape, supports)

    def reset(self) -> None:
        self.state = self._last = self._touch = None

    def rod_state(self) -> RodState | SpanState | TouchState | None:
        return self._touch if self._touch is not None and self._touch.touching else self.state


def solver_of(model: str, cable: Cable, time_budget: float | None) -> Solver:
    """The solver of a model; "auto" is the rod, and the catenary for a cable without bending stiffness."""
    limp = cable.mean_bending_stiffness == 0.0
    if limp and model not in ("catenary", "auto"):
        raise ArgumentError.of(
            "bending_stiffness",
            0.0,
            f"model {model!r} needs it above 0 N m^2",
            "Give EI in N m^2, or choose model='catenary'.",
        )
    if model == "catenary" or limp:
        return ClosedForm(catenary.solve, np.empty(0))
    if model == "gradient4":
        return ClosedForm(gradient.solve4, gradient.new_memory())
    if model == "gradient6":
        return ClosedForm(gradient.solve6, gradient.new_memory())
    budget = math.inf if time_budget is None else checks.number("time_budget", time_budget, above=0.0, unit="s")
    return Rod(budget)
