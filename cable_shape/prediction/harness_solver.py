"""The solver of a harness that keeps its warm start: :class:`HarnessSolver`."""

from __future__ import annotations

import math
from time import perf_counter
from typing import cast, final

from cable_shape.solve import harness_search
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.touching import harness_solve
from cable_shape.solve.touching.harness_state import HarnessTouchState


@final
class HarnessSolver:
    """As :class:`.solvers.Rod`, of a harness."""

    __slots__ = ("_loose", "_time_budget", "_touch", "leaps", "state")

    def __init__(self, time_budget: float = math.inf) -> None:
        self.state: HarnessNetwork | None = None  # without contact
        self._time_budget = time_budget  # s
        self._touch: HarnessTouchState | None = None
        self.leaps = True  # in contact, see `touching.solve`
        self._loose = False  # what was let go slides to rest, whether it touches anything or not

    @property
    def touching(self) -> bool:
        """Whether the last shape is in contact with a body."""
        return self._touch is not None and self._touch.touching

    def solve(self, problem: HarnessProblem) -> HarnessShape:
        """The shape, from the last solution if there is one."""
        deadline = math.inf if self._time_budget == math.inf else perf_counter() + self._time_budget
        if not problem.bodies and not self._loose:
            self._touch = None
            shape, self.state = harness_search.solve(problem, self.state, deadline=deadline)
            return shape
        if self._touch is None:
            self._touch = HarnessTouchState(problem)  # type: ignore[arg-type]
        shape, self.state = harness_solve.solve(problem, self._touch, self.state, deadline=deadline, leaps=self.leaps)
        self._loose = self._loose and not shape.status
        return shape

    def begin(self, problem: HarnessProblem, shape: HarnessShape, *, loose: bool = False) -> None:
        """Makes a shape that was found otherwise the last one, see `Predictor.begin`."""
        self._loose = loose
        touch = HarnessTouchState(problem)  # type: ignore[arg-type]
        frames = touch.aimed()
        touch.move_bodies(touch.bodies.link_rows(problem.links))
        self.state = HarnessNetwork(problem)
        self.state.aim()
        self.state.resume_from(touch.whole(shape), touch.gaps, touch.knots_at(shape, frames))
        self._touch = touch if loose or problem.bodies else None
        if loose:
            touch.lie(shape, frames)  # type: ignore[arg-type]
        elif problem.bodies:
            touch.resume(shape, frames)  # type: ignore[arg-type]

    def twin(self, problem: HarnessProblem, shape: HarnessShape | None) -> HarnessSolver:
        """Once more: it goes on from the last shape, that of `problem`, and this one stays as it is.

        Without the shape it knows nothing of what that touches.
        """
        other = HarnessSolver(self._time_budget)
        other.leaps, other._loose = self.leaps, self._loose
        if self.state is not None:
            other.state = cast("HarnessNetwork", self.state.copied())
        if self._touch is not None and shape is not None:
            other._touch = self._touch.twin(problem, shape)
        return other

    def lift(self) -> None:
        """Forgets what the last shape touches."""
        self._touch = None

    def reset(self) -> None:
        """Forgets the last solution: the next one starts cold."""
        self.state = self._touch = None
        self._loose = False

    def rod_state(self) -> HarnessNetwork | HarnessTouchState | None:
        """The memory of the last shape, in contact or not; None: there is none."""
        return self._touch if self.touching else self.state
