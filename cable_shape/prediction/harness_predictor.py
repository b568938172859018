"""From ends to the shape of a harness: :class:`HarnessPredictor`."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose, one_mapping
from cable_shape.prediction.harness_columns import columns_by
from cable_shape.prediction.harness_solver import HarnessSolver
from cable_shape.prediction.reuse import kept, links_same, same_ends
from cable_shape.scene.mesh_parts import divided
from cable_shape.scene.scene import Scene
from cable_shape.scene.scene_parts import Obstacle
from cable_shape.shape import CableShape
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import End, HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import GRAVITY
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.one_harness import OneHarness
from cable_shape.solve.touching.spot import Spot
from cable_shape.solve.touching.strands import Strands

MODELS = ("cosserat", "auto")


@final
class HarnessPredictor:
    """Predicts one harness's shape again and again, each time starting from the last solution.

    What ``Predictor(harness)`` makes. Parameters are those of :class:`cable_shape.Predictor` but for these:

    harness : Harness
    model : str
        "cosserat" or "auto", which is the same.
    points : int
        Of each segment.
    tolerance : float, optional
        [m]; default 1e-5 of the longest segment.
    scene : Scene, optional
        Clips, eyelets among them, and masses name their `segment`. With ``contact="solve"`` segments are kept out of
        bodies and, but for harnesses in eyelets, of each other and of themselves.
    distributed_load : mapping of segment to (2, 3) array_like, optional
        [N/m], world, added to the weight.
    name : str, optional
        Contacts name segments "name/a"; default: "a".

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    def __init__(
        self,
        harness: Harness,
        *,
        model: str = "auto",
        gravity: ArrayLike = GRAVITY,
        points: int = 150,
        tolerance: float | None = None,
        scene: Scene | None = None,
        distributed_load: Mapping[str, ArrayLike] | None = None,
        time_budget: float | None = None,
        robot_links: Iterable[Obstacle] = (),
        gripping_links: Iterable[str] = (),
        friction: bool = True,
        name: str = "",
    ) -> None:
        self._name = name
        self.model = checks.one_of("model", model, MODELS)
        checks.optional_number("time_budget", time_budget, above=0.0, unit="s")
        self._keywords: dict[str, Any] = {
            "gravity": gravity, "points": points, "tolerance": tolerance, "distributed_load": distributed_load,
            "robot_links": checks.entries("robot_links", robot_links, Obstacle),
            "gripping_links": checks.entries("gripping_links", gripping_links, str, "Give a list of link names."),
            "friction": friction,
        }  # fmt: skip
        self.problem = self._still = _checked(HarnessProblem(harness, scene=scene, **self._keywords))
        self.time_budget = math.inf if time_budget is None else float(time_budget)  # s, of one solve
        self._solver = HarnessSolver(self.time_budget)
        self._others: tuple[Crossing, int] | None = None  # what keeps it out of others, and its first number there
        self._crossing = self._with_itself()
        self._last_links: Mapping[str, Pose] | None = None
        self._last: HarnessShape | None = None
        self._found: tuple[HarnessShape, dict[str, Grip | FreeEnd], Mapping[str, Pose] | None] | None = (
            None  # by itself
        )
        self._last_ends: dict[str, Grip | FreeEnd] = {}

    @property
    def harness(self) -> Harness:
        """The harness, as given."""
        return self.problem.harness

    @property
    def scene(self) -> Scene | None:
        """The scene; setting it keeps the warm start where its clips hold the same points."""
        return self.problem.scene

    @scene.setter
    def scene(self, scene: Scene | None) -> None:
        before = self.problem
        self._still = _checked(HarnessProblem(before.harness, scene=scene, **self._keywords))
        self._still.ends = before.ends
        self._load(self._still)
        self._crossing = self._with_itself()

    @property
    def crossing(self) -> Crossing | None:
        """What keeps segments out of each other and of themselves, and of others; None: nothing does."""
        return self._crossing if self._others is None else self._others[0]

    def join(self, crossing: Crossing, index: int) -> None:
        """Leaves what segments touch to `crossing`, in which the first one has the number `index`."""
        self._crossing = None
        self._others = crossing, index

    @property
    def touching(self) -> bool:
        """Whether the last shape is in contact with a body, with others, or segments of it with each other."""
        return self._solver.touching or self._pile is not None

    @property
    def _pile(self) -> HarnessTouchState | None:
        """What solved for the last shape if segments touch each other, themselves or others in it."""
        crossing, first = self._others or (self._crossing, 0)
        return crossing.state if crossing is not None and first in crossing.touching else None

    @property
    def _part(self) -> OneHarness:
        """The segments as what keeps them out of each other knows them."""
        crossing, first = self._others or (self._crossing, 0)
        assert crossing is not None
        part = crossing.strands.part_with(first)
        assert isinstance(part, OneHarness)
        return part

    @property
    def solo(self) -> HarnessPredictor:
        """What solves for the harness: this one, see :attr:`cable_shape.Predictor.solo`."""
        return self

    @property
    def called(self) -> dict[str, str]:
        """What `rod_memory` calls the segments, by name."""
        if self._others is None or self._pile is None:
            return {name: name for name in self.harness.segments}
        crossing, first = self._others
        return {name: crossing.strands.key(i) for i, name in enumerate(self.harness.segments, first)}

    def _with_itself(self) -> Crossing | None:
        """What keeps segments out of each other and of themselves, where the scene asks for it."""
        return (
            Crossing(Strands([OneHarness(self, self._name)]), self.time_budget)
            if self.problem.solves_crossing
            else None
        )

    @property
    def state(self) -> HarnessNetwork | None:
        """The solver's memory of the last shape; None before there is one, and of one in contact or just out of it."""
        state = self._solver.state
        return state if state is not None and state.factored and not self.touching else None

    @property
    def rod_state(self) -> HarnessNetwork | HarnessTouchState | None:
        """The solver's memory of the last shape, in contact or not; None before there is one, and just out of it."""
        return self._pile or (self._solver.rod_state() if self.touching else self.state)

    @property
    def rod_memory(self) -> HarnessNetwork | HarnessTouchState | None:
        """The same, also of a shape just out of contact: whoever asks refreshes it."""
        return self._pile or self._solver.rod_state()

    def ahead(self) -> Callable[[Mapping[str, End]], HarnessShape]:
        """What predicts from the last shape on, with links, and cables that it touches, where they are.

        This predictor stays as it is.
        """
        if self._others is not None and self._pile is not None:
            crossing, first = self._others
            return partial(_ahead, crossing.twin(), first)
        other = self._copied()
        return lambda ends: other.predict(ends, links=other.problem.links)

    def predict_beside(
        self,
        other: HarnessPredictor,
        ends: Mapping[str, End],
        links: Mapping[str, Pose] | None,
        acceleration: Mapping[str, ArrayLike] | None,
    ) -> HarnessShape:
        """What another one, of a harness almost alike, predicts among the cables that this one's touches now."""
        if self._others is None or self._pile is None:
            return other.predict(ends, links=links, acceleration=acceleration)
        other.move(ends, links, acceleration)
        crossing, first = self._others
        return _solved(crossing.beside(first, other), first)

    def twin(self) -> HarnessPredictor:
        """Once more, of this harness alone: it goes on from the last shape, and this one stays as it is."""
        other = self._copied()
        other._crossing = other._others = None
        return other

    def beside(self, harness: Harness) -> HarnessPredictor:
        """One that goes on from the last shape with a harness that differs little; this predictor stays as it is."""
        other = self._copied()
        other.head_for(harness, self.scene)
        other._still = other.problem
        return other

    def _copied(self) -> HarnessPredictor:
        """One with the same last shape, and a memory of its own."""
        other: HarnessPredictor = copy.copy(self)
        problem = other.problem = other._still = copy.copy(self.problem)
        problem.ends, problem._given = dict(problem.ends), None  # it moves them where they are
        other._solver = self._solver.twin(problem, self._last)
        if other._solver.state is not None:
            other._solver.state.problem = problem
        if self._crossing is not None:
            other._crossing = self._crossing.among(Strands([self._part.of(other)]))
        return other

    @property
    def grips(self) -> tuple[str, ...]:
        """Names of the ends held at the last prediction, in the order of the segments: those of `sensitivity`."""
        return self.problem.grips

    def predict(
        self,
        ends: Mapping[str, End],
        *more: object,
        links: Mapping[str, Pose] | None = None,
        acceleration: Mapping[str, ArrayLike] | None = None,
    ) -> HarnessShape:
        """The shape between these ends; never raises for a physical reason: look at `status`.

        Parameters
        ----------
        ends : mapping of open end to Pose, Grip or FreeEnd
            "a.start" or "a.end"; a bare Pose is clamped, ends not named are free.
        *more
            None: the ends of a harness are one mapping.
        links : mapping of robot link to its Pose in the world, optional
            Where the clips are that are on links, and the bodies, if contact is solved for; without it these are left
            out.
        acceleration : mapping of segment to (3,) or (m, 3) array_like, optional
            [m/s^2], world, of the segment, uniform in arc length, linear between the rows; segments not named are at
            rest. For this prediction only; `energy` leaves it out.

        Raises
        ------
        ArgumentError
            For an end that does not exist or is in a junction, a part of the harness that nothing holds, other wrong
            arguments.
        """
        one_mapping(ends, more)
        self.move(ends, links, acceleration)
        problem, last = self.problem, self._last
        if last is not None and links_same(self._last_links, problem) and same_ends(self._last_ends, problem.ends):
            return last.again()
        return self.solve()

    def move(
        self,
        ends: Mapping[str, End],
        links: Mapping[str, Pose] | None,
        acceleration: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """Puts the ends and the links there, and tells how segments move."""
        if acceleration is not None:
            problem = self._still.moving(acceleration)
            problem.ends, problem._given = self.problem.ends, self.problem._given
            self._load(problem)
        elif self.problem is not self._still:
            self._still.ends, self._still._given = self.problem.ends, self.problem._given
            self._load(self._still)
        self.problem.move(ends, links)

    def solve(self) -> HarnessShape:
        """The shape of the problem as it is."""
        if self._crossing is not None:
            return self.told(self._crossing.solve())
        shape = self.alone()
        assert self._found is not None
        self._last, (_, self._last_ends, self._last_links) = shape, self._found
        return shape

    def told(self, shapes: Sequence[CableShape]) -> HarnessShape:
        """The shape of which these, found between the problem's ends, are the segments."""
        return self._kept(self._part.as_one(shapes))

    def _kept(self, shape: HarnessShape) -> HarnessShape:
        """Takes a shape for the last one."""
        problem = self.problem
        self._last, self._last_ends, self._last_links = shape, dict(problem.ends), kept(problem.links)
        return shape

    def segments_of(self, shape: HarnessShape) -> list[CableShape]:
        """The segments' shapes of one from which `crossing` is to go on."""
        return self._part.take(shape)

    def alone(self) -> HarnessShape:
        """The shape of the problem as it is, whatever segments touch of each other and of others."""
        problem = self.problem
        if self._crossing is None and self._found is not None:
            shape, ends, links = self._found
            if links_same(links, problem) and same_ends(ends, problem.ends):
                return shape.again()
        shape = self._solver.solve(problem)
        self._found = shape, dict(problem.ends), kept(problem.links)
        return shape

    def go_on_from(self, shape: HarnessShape) -> None:
        """Makes a shape between the problem's ends the last one, if there are bodies it may lie on."""
        if self.problem.bodies:
            self._solver.begin(self.problem, shape)
            self._found = None

    def begin(
        self,
        shape: HarnessShape,
        ends: Mapping[str, End],
        links: Mapping[str, Pose] | None,
        *,
        harness: Harness | None = None,
        scene: Scene | None = None,
        loose: bool = False,
        spots: list[Spot] | None = None,
    ) -> None:
        """Makes a shape that was found otherwise the last one, see :meth:`cable_shape.Predictor.begin`."""
        self.head_for(harness, scene)
        self._solver.begin(self.problem.move(ends, links), shape, loose=loose)
        self._others = None
        self._crossing = self._with_itself()
        if self._crossing is not None:
            self._crossing.take_up(self.segments_of(shape), spots or [])

    def head_for(self, harness: Harness | None = None, scene: Scene | None = None) -> None:
        """Makes the problem that of another harness in another scene, or its own; ends and links stay."""
        last = self.problem
        if harness is None:
            problem = self._still
        else:
            problem = _checked(HarnessProblem(harness, scene=scene, **self._keywords))
        problem.ends, problem._given = last.ends, None
        problem.place(last.links)
        self.problem = problem
        self._last = self._found = None
        if self._crossing is not None and problem.harness is not last.harness:
            self._crossing = self._crossing.among(Strands([self._part.of(self)]))

    def leap(self, *, allowed: bool) -> None:
        """See :meth:`cable_shape.Predictor.leap`."""
        self._solver.leaps = allowed

    def look_again(self) -> None:
        """The next prediction is made anew, from the last one, wherever its ends are."""
        self._last = self._found = None
        if self.crossing is not None:
            self.crossing.look_again()

    def reset(self) -> None:
        """Forgets the last solution: the next one starts cold."""
        self._solver.reset()
        self._last = self._found = None
        if self._crossing is not None:
            self._crossing.reset()

    def sensitivity(
        self, by: Sequence[str] | None = None, *, at: str = "cable", by_clips: bool = False
    ) -> dict[str, Array]:
        """{segment: (points, 3, m)}: how the centrelines move with what holds the harness, and with its numbers.

        Of the last solved shape, exact: d positions at fixed arc length / d (by), columns in the order of `by`.

        Parameters
        ----------
        by : names, each once
            An open end, "a.start", "clip:NAME" and "body:NAME": six columns, vx vy vz [m/s] wx wy wz [rad/s] in world
            axes, rotation about that end, or with ``at="gripper"`` about the gripper's own origin, of a clip or a body
            about the origin of its pose; zero for free ends, and for bodies that nothing touches. "length:a",
            "linear_density:a", "bending_stiffness:a" and "twisting_stiffness:a" of segment a: one column, per unit, as
            of :meth:`cable_shape.Predictor.sensitivity`. Default: the held ends, in the order of `grips`.
        by_clips
            After the held ends come six columns for each clip on a link, in the order of the scene; not with `by`.

        Raises
        ------
        ArgumentError
            If nothing was predicted yet, and for a name that does not exist.
        """
        checks.one_of("at", at, ("cable", "gripper"))
        state = self.rod_memory
        if state is None or state.history == 0:
            raise ArgumentError("sensitivity() needs a solution, and there is none yet. Call predict first.")
        problem = self.problem
        if by is None:
            moving = problem.moving_clips if by_clips else ()
            names = [*self.grips, *(f"clip:{problem.clip_names[i]}" for i in moving)]
        elif by_clips:
            raise ArgumentError.of("by_clips", by_clips, "by names all columns", "Name clips: by=('clip:NAME',).")
        else:
            names = list(
                checks.entries("by", (by,) if isinstance(by, str) else by, str, "Write ('a.start', 'length:b').")
            )
        points = problem.points
        out = np.zeros((self._rows, 3, 0))
        if by is not None or names:
            out = columns_by(problem, state, names, at, self.called)
        return {name: out[i * points : (i + 1) * points] for i, name in enumerate(self.harness.segments)}

    @property
    def _rows(self) -> int:
        """Of all segments' shapes together."""
        return len(self.harness.segments) * self.problem.points

    def _load(self, problem: HarnessProblem) -> None:
        """Makes this the problem, whose loads may be others."""
        self.problem = problem
        self._last = self._found = None
        if not problem.bodies:
            self._solver.lift()


def _ahead(together: Crossing, first: int, ends: Mapping[str, End]) -> HarnessShape:
    """The shape between these ends of the harness whose first segment has this number among others."""
    problem = together.strands.part_with(first).problem
    problem.move(ends, problem.links)
    return _solved(together, first)


def _solved(together: Crossing, first: int) -> HarnessShape:
    """The shape of that harness, as it is held."""
    part = together.strands.part_with(first)
    assert isinstance(part, OneHarness)
    return part.as_one(together.solve()[first : first + len(part.cables)])


def _checked(problem: HarnessProblem) -> HarnessProblem:
    """The problem, if its contacts can be solved for."""
    if problem.bodies:
        divided(problem.bodies)
    return problem
