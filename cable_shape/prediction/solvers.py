"""The models as solvers that keep their warm start: :func:`solver_of`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from time import perf_counter
from typing import Any, Protocol, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import refuse
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.shape import CableShape
from cable_shape.solve import catenary, cosserat, gradient
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching import touching
from cable_shape.solve.touching.state import TouchState
from cable_shape.solve.touching.taut import TIGHT

#: Of the rod that gave a shape, in contact or not; None: there is none.
Memory = Network | TouchState | None

MODELS = ("catenary", "gradient4", "gradient6", "cosserat", "auto")


class Solver(Protocol):
    """One model with its warm start."""

    def solve(self, problem: Problem) -> CableShape:
        """The shape, from the last solution if there is one."""

    def reset(self) -> None:
        """Forgets the last solution."""

    def go_on_from(self, problem: Problem, shape: CableShape, frames: Array, links: Array) -> None:
        """Makes a shape that was found otherwise the last one in contact with bodies."""

    def begin(self, problem: Problem, shape: CableShape, memory: Memory = None, *, loose: bool = False) -> None:
        """Makes a shape that was found otherwise the last one, see `Predictor.begin`."""

    def rod_state(self) -> Network | TouchState | None:
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

    def go_on_from(self, problem: Problem, shape: CableShape, frames: Array, links: Array) -> None:
        return

    def begin(self, problem: Problem, shape: CableShape, memory: Memory = None, *, loose: bool = False) -> None:
        return

    def rod_state(self) -> None:
        return None


#: Times as many elements as usual where a shape in contact is told by another mesh: a coarse one is held elsewhere.
_FINER = 2.5


@final
class Rod:
    """The Cosserat rod, in clips, in contact or neither; its warm start is the last solution with its mesh."""

    __slots__ = ("_loose", "_spare", "_time_budget", "_touch", "leaps", "state")

    def __init__(self, time_budget: float = math.inf) -> None:
        self.state: Network | None = None
        self._spare: Network | None = None  # a memory to be used again
        self._time_budget = time_budget  # s
        self._touch: TouchState | None = None
        self.leaps = True  # in contact, see `touching.solve`
        self._loose = False  # what was let go slides to rest, whether it touches anything or not

    def solve(self, problem: Problem) -> CableShape:
        deadline = math.inf if self._time_budget == math.inf else perf_counter() + self._time_budget
        if not problem.bodies and not self._loose:
            self._touch = None
            return cosserat.solve(problem, self._free(problem), deadline=deadline)
        if self._touch is None:
            self._touch = TouchState(problem)
        rod = self.state if self._touch.touching else self._free(problem)
        shape, self.state = touching.solve(problem, self._touch, rod, deadline=deadline, leaps=self.leaps)
        self._loose = self._loose and not shape.status
        self._touch.hasty = False
        if shape.status and not self._touch.touching and self.state is not None and self.state.last is shape:
            self._resume(problem, shape)  # out of contact: the branch goes on
        return shape

    def put_aside(self) -> tuple[Any, ...]:
        """What it remembers, for `put_back`: `begin` makes it anew and leaves this as it is."""
        return self.state, self._touch, self._loose

    def put_back(self, aside: tuple[Any, ...]) -> None:
        """Makes what was put aside its memory again."""
        self.state, self._touch, self._loose = aside

    @property
    def touching(self) -> bool:
        """Whether the last shape is in contact with a body."""
        return self._touch is not None and self._touch.touching

    @property
    def rough(self) -> bool:
        """Whether the last shape is in contact, and surfaces or cable have friction."""
        return self._touch is not None and self._touch.touching and self._touch.has_friction

    @property
    def stuck(self) -> bool:
        """Whether bodies left no way to the last shape, which is none."""
        return self._touch is not None and self._touch.stuck

    @property
    def taut_from(self) -> float:
        """[N], the tension from which on a cable that nothing leads on among bodies may be too short."""
        return math.inf if self._touch is None else TIGHT * self._touch.usual_pull

    def _free(self, problem: Problem) -> Network:
        """The memory of the rod without contact, made where there is none."""
        if self.state is None:
            spare = self._spare
            self.state = spare if spare is not None and spare.forget(problem) else Network(problem)
            self._spare = None
        return self.state

    def begin(
        self, problem: Problem, shape: CableShape, memory: Memory = None, *, loose: bool = False, near: bool = False
    ) -> None:
        """Makes a shape the last one; near: one in contact that is told by another mesh, next to which the solver's is
        looked for, and nowhere else."""
        self._loose, self._touch = loose, None
        if loose or problem.bodies:
            self._touch = touch = TouchState(problem)
            frames = touch.aimed()
            touch.move_bodies(touch.bodies.link_rows(problem.links))
            if not (isinstance(memory, TouchState) and touch.take_over(memory, shape)):
                if loose:
                    touch.lie(shape, frames)
                else:
                    touch.resume(shape, frames, _FINER if near else 1.0)
            if near:
                touch.patience.fail()
                touch.hasty = True
            if touch.touching and not isinstance(memory, Network):
                self.state = None  # the rod without contact is made where it comes out of contact
                return
        self.state = memory.copied() if isinstance(memory, Network) else Network(problem, shape)
        self._resume(problem, shape)

    def _resume(self, problem: Problem, shape: CableShape) -> None:
        """Has the rod without contact go on from a shape, or from its own last solution if that is of this problem.

        Where it runs through eyelets the next solve looks for where it is in them first.
        """
        state = self.state
        assert state is not None
        if state.problem is not problem:
            state.take(problem)
        poses = state.aim(problem.start, problem.end)
        if state.history == 0:
            state.last = shape
            if state.rings:
                state.arcs[state.rings] = shape.supports[[ring - 1 for ring in state.rings], 0]
            else:
                state.resume(poses)

    def go_on_from(self, problem: Problem, shape: CableShape, frames: Array, links: Array) -> None:
        """Makes a shape that was found otherwise, ends in `frames` (2, 7), the last one in contact with bodies.

        links (m, 7): where the links were then that carry bodies or clips.
        """
        if not problem.bodies:
            return
        self._loose = False
        if self._touch is None:
            self._touch = TouchState(problem)
        supports = self._touch.aim(problem.start, problem.end)
        supports[0], supports[-1] = frames
        if problem.clips_move:
            supports[1:-1] = problem.clips_at(links)
        self._touch.move_bodies(links)
        self._touch.resume(shape, supports)

    def go_back_to(
        self, problem: Problem, shape: CableShape, ends: tuple[Grip, Grip | FreeEnd], links: Mapping[str, Pose] | None
    ) -> None:
        """Makes a shape from before the last one in contact again, between its own ends, which were held alike."""
        assert self._touch is not None
        start, end = ends
        frames = np.array([(one if isinstance(one, Grip) else start).cable_frame.array for one in (start, end)])
        self.go_on_from(problem, shape, frames, self._touch.bodies.link_rows(links))

    @property
    def lag(self) -> Array | None:
        """The load of damping under which the last shape was found, see `Problem.lag`."""
        return None if self.state is None else self.state.problem.lag

    def twin(self, problem: Problem, shape: CableShape | None) -> Rod:
        """Once more: it goes on from the last shape, that of `problem`, and this one stays as it is.

        Without the shape it knows nothing of what that touches.
        """
        other = Rod(self._time_budget)
        if self.state is not None:
            other.state = self.state.copied()
        if self._touch is not None and shape is not None:
            other.go_on_from(problem, shape, self._touch.ends_then, self._touch.bodies.links_then)
        return other

    def reset(self) -> None:
        self._spare, self.state, self._touch = self.state or self._spare, None, None
        self._loose = False

    def rod_state(self) -> Network | TouchState | None:
        touch = self._touch
        found = touch is not None and (touch.touching or (self.state is not None and self.state.history == 0))
        return touch if found else self.state


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
    if model not in ("cosserat", "auto"):
        refuse(cable, f"model {model!r}", "Choose model='cosserat', or leave them out.")
    if model == "catenary" or limp:
        return ClosedForm(catenary.solve, np.empty(0))
    if model == "gradient4":
        return ClosedForm(gradient.solve4, gradient.new_memory())
    if model == "gradient6":
        return ClosedForm(gradient.solve6, gradient.new_memory())
    budget = math.inf if time_budget is None else checks.number("time_budget", time_budget, above=0.0, unit="s")
    return Rod(budget)
