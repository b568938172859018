"""From ends to shape: :class:`Predictor` (a control loop) and :func:`predict` (a script)."""

from __future__ import annotations

import copy
import functools
import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, final, overload

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import NOT_GIVEN, FreeEnd, Grip, Pose, both_given, one_mapping
from cable_shape.prediction.reuse import Ends, Links, kept, unmoved
from cable_shape.prediction.sliding import Sliding
from cable_shape.prediction.solvers import MODELS, ClosedForm, Memory, Rod, Solver, solver_of
from cable_shape.scene.mesh_parts import divided
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.shape import CableShape
from cable_shape.solve import cosserat
from cable_shape.solve.answers import ENDS, Solved
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import GRAVITY, Problem, longest_delay
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.solve.touching.one_cable import OneCable
from cable_shape.solve.touching.pile import Member
from cable_shape.solve.touching.spot import Spot
from cable_shape.solve.touching.state import TouchState
from cable_shape.solve.touching.strands import Strands
from cable_shape.solve.turning import turning


@final
class Predictor:
    """Predicts one cable's shape again and again, each time starting from the last solution.

    Of a :class:`Harness` it makes a :class:`cable_shape.prediction.harness_predictor.HarnessPredictor`.

    Parameters
    ----------
    cable : Cable
    model : str
        "catenary", "gradient4", "gradient6", "cosserat", or "auto": the rod, and the catenary for a cable without
        bending stiffness. `shape.model` says which it was.
    gravity : (3,) array_like
        [m/s^2], world.
    points : int
        Number of points of the shape, uniform in arc length.
    tolerance : float, optional
        [m], largest position error allowed, of the model's discretisation. Default: 1e-5 of the length.
    scene : Scene, optional
        Its masses load the cable, its clips hold it; with ``contact="solve"`` its obstacles keep the cable out.
    robot_links, gripping_links
        As for :class:`cable_shape.Cycle`: with ``contact="solve"`` the robot's links keep the cable out, too, those
        that grip it not within 0.05 m of its ends.
    distributed_load : (2, 3) array_like, optional
        [N/m], world, at s = 0 and s = length, linear between, added to the weight.
    time_budget : float, optional
        [s] of one prediction by the Cosserat rod, looked at between its attempts. After it the best shape so far is
        given, graded BUDGET if it is within tolerance, else BUDGET_EXCEEDED. Default: none.
    friction : bool
        Whether bodies and eyelets hold the cable by their friction and its own, which depends on the way here: what
        this predictor has seen of it. False: as if they had none, and `shape.frictionless` says so.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    def __new__(cls, cable: Any, **keywords: Any) -> Any:
        """A :class:`HarnessPredictor` for a harness."""
        if not isinstance(cable, Harness):
            return super().__new__(cls)
        from cable_shape.prediction.harness_predictor import HarnessPredictor

        return HarnessPredictor(cable, **keywords)

    def __init__(
        self,
        cable: Cable | Harness,
        *,
        model: str = "auto",
        gravity: ArrayLike = GRAVITY,
        points: int = 150,
        tolerance: float | None = None,
        scene: Scene | None = None,
        distributed_load: ArrayLike | None = None,
        time_budget: float | None = None,
        robot_links: Iterable[Obstacle] = (),
        gripping_links: Iterable[str] = (),
        friction: bool = True,
    ) -> None:
        if not isinstance(cable, Cable):
            raise ArgumentError.of("cable", cable, "it must be a Cable or a Harness", "Write Cable(length=..., ...).")
        self.model = checks.one_of("model", model, MODELS)
        self._problem_of = functools.partial(
            Problem,
            gravity=gravity,
            points=points,
            tolerance=tolerance,
            distributed_load=distributed_load,
            robot_links=checks.entries("robot_links", robot_links, Obstacle),
            gripping_links=checks.entries("gripping_links", gripping_links, str, "Give a list of link names."),
            friction=friction,
        )
        problem = self._problem_of(cable, scene=scene)
        checks.optional_number("time_budget", time_budget, above=0.0, unit="s")
        self._solver = solver_of(self.model, cable, time_budget)
        self.problem = self._still = self._checked(problem)
        self._last: CableShape | None = None
        self._last_ends: Ends | None = None
        self._last_links: Mapping[str, Pose] | None = None
        self.time_budget = math.inf if time_budget is None else float(time_budget)
        self._others: tuple[Crossing, int] | None = None
        self._crossing = self._with_itself()
        self._sliding: Sliding | None = None
        if isinstance(self._solver, Rod) and friction and time_budget is None:
            options = {"gravity": gravity, "distributed_load": distributed_load}
            carried = {key: self._problem_of.keywords[key] for key in ("robot_links", "gripping_links")}
            self._sliding = Sliding(self._solver, options | carried)

    @property
    def cable(self) -> Cable:
        """The cable, as given."""
        return self.problem.cable

    @property
    def scene(self) -> Scene | None:
        """The scene; setting it keeps the warm start."""
        return self.problem.scene

    @scene.setter
    def scene(self, scene: Scene | None) -> None:
        self._still = self._checked(self._problem_of(self.cable, scene=scene))
        self._load(self._still)
        self._crossing = self._with_itself()

    def predict(
        self,
        start: Pose | Grip,
        end: Pose | Grip | FreeEnd | None = NOT_GIVEN,
        links: Mapping[str, Pose] | None = None,
        *,
        acceleration: ArrayLike | None = None,
    ) -> CableShape:
        """The shape between these ends; never raises for a physical reason: look at `status`.

        Parameters
        ----------
        start, end : Pose or Grip
            A bare Pose is clamped; `end` may be a FreeEnd, None is a free end without load.
        links : mapping of robot link to its Pose in the world, optional
            Where the clips are that are on links, and the bodies, if contact with them is solved for; without it these
            are left out.
        acceleration : (3,), (m, 3) or (m, 6) array_like, optional
            [m/s^2], world, of the cable, uniform in arc length, linear between the rows: the cable is in equilibrium
            under density * (gravity - acceleration), masses likewise. For this prediction only; `energy` leaves it out.
            Three rows or more, unless they are on a line, are for the Cosserat rod, in clips too, without
            ``contact="solve"``; each is a node of the rod. Six columns: the velocity [m/s] is beside it, and
            the cable's `drag` and `retardation_time` count (the latter for the rod, without ``contact="solve"``).

        Raises
        ------
        ArgumentError
            For wrong arguments, or if `links` lacks a link that carries such a body or a clip.
        """
        both_given("predict(start, end)", end)
        self.accelerate(acceleration)
        self.problem.move(start, end, links)
        return self.solve()

    @property
    def solo(self) -> Predictor:
        """What solves for the cable: this one, see :class:`cable_shape.prediction.turned.TurnedPredictor`."""
        return self

    @staticmethod
    def told(shape: CableShape) -> CableShape:
        """A shape as `solo` tells it from one as the cable was given, and the other way round: the same."""
        return shape

    def move(self, start: Pose | Grip, end: Pose | Grip | FreeEnd | None, links: Links) -> None:
        """Puts the ends and the links there."""
        self.problem.move(start, end, links)

    def alone(self) -> CableShape:
        """The shape between the problem's ends, whatever it or other cables touch."""
        problem = self.problem
        if self._last is not None and unmoved(self._last_ends, self._last_links, problem):
            return self._last.again()
        solver: Solver | Sliding = self._sliding if self._sliding and problem.bodies else self._solver
        shape = solver.solve(problem)
        self._last = shape
        self._last_ends = (problem.start, problem.end)
        self._last_links = kept(problem.links)
        return shape

    def go_on_from(self, shape: CableShape, frames: Array, links: Array) -> None:
        """Makes a shape between the ends `frames` (2, 7) the last solution, if there are bodies it may lie on.

        links (m, 7): where the links were then that carry bodies; m = 0: not known, or there are none.
        """
        if self.problem.bodies:
            self._solver.go_on_from(self.problem, shape, frames, links)
            self._last = None
            self._forget_where()

    def begin(
        self,
        shape: CableShape,
        ends: tuple[Pose | Grip, Pose | Grip | FreeEnd | None],
        links: Links,
        *,
        cable: Cable | None = None,
        scene: Scene | None = None,
        loose: bool = False,
        memory: Memory = None,
        spots: list[Spot] | None = None,
    ) -> None:
        """Makes a shape that was found otherwise the last one.

        It is that of `cable` between these ends in `scene`, both with as many parts as those of this predictor, or its
        own. loose: it is none, since something has let go of it, and slides to where it comes to rest. memory: of the
        rod that has found it, which is left as it is. spots: where it touches itself; None: not known. `head_for` says
        where to go on from there, `solve` goes.
        """
        self.head_for(cable, scene)
        self.problem.move(*ends, links)
        self._solver.begin(self.problem, shape, memory, loose=loose)
        self._forget_where()
        self._others = None
        if self._crossing is not None and self._crossing.is_of(self.problem):
            self._crossing.reset()
        else:
            self._crossing = self._with_itself()
        if self._crossing is not None and spots is not None:
            self._crossing.take_up([shape], spots)

    def head_for(self, cable: Cable | None = None, scene: Scene | None = None) -> None:
        """Makes the problem that of another cable in another scene, or its own; ends and links stay."""
        last = self.problem
        self._load(self._still if cable is None else self._checked(self._problem_of(cable, scene=scene)))
        self.problem.move(last.start, last.end, last.links)

    def solve(self) -> CableShape:
        """The shape of the problem as it is."""
        return self.alone() if self._crossing is None else self._crossing.solve()[0]

    def leap(self, *, allowed: bool) -> None:
        """Whether a cable in contact may come to an equilibrium to which no small steps lead; it may at first.

        Where it may not, such a shape is NOT_CONVERGED, which is told sooner.
        """
        if isinstance(self._solver, Rod):
            self._solver.leaps = allowed

    def look_again(self) -> None:
        """The next prediction is made anew, from the last one, wherever its ends are."""
        self._last = None
        if self.crossing is not None:
            self.crossing.look_again()

    @property
    def crossing(self) -> Crossing | None:
        """What keeps the cable out of itself, and out of others that are solved for along with it."""
        return self._crossing if self._others is None else self._others[0]

    @property
    def memory(self) -> Memory:
        """That of the rod which gave the last shape; None if none did, or it was along with what its cable touches."""
        state = self.rod_state
        if state is None and isinstance(self._solver.rod_state(), TouchState):
            state = self._solver.rod_state()  # which tells of what shape it is
        return None if isinstance(state, Member) else state

    def reset(self) -> None:
        """Forgets the last solution: the next one starts cold."""
        self._solver.reset()
        self._last = None
        self._forget_where()
        if self._crossing is not None:
            self._crossing.reset()

    def _forget_where(self) -> None:
        """The cable does not go on from where it was last."""
        if self._sliding is not None:
            self._sliding.forget()

    def join(self, crossing: Crossing, index: int) -> None:
        """Leaves what its cable touches, itself included, to `crossing`, in which it has the number `index`."""
        self._crossing = None
        self._others = crossing, index

    def end(self) -> None:
        """It is not used any more: what it holds is free at once, not when garbage is looked for."""
        self._crossing = self._others = None

    @property
    def is_rod(self) -> bool:
        """Whether the model is the Cosserat rod."""
        return not isinstance(self._solver, ClosedForm)

    @property
    def touching(self) -> bool:
        """Whether the last shape was solved for along with what its cable touches: itself, or another one."""
        if self._others is not None:
            return self._others[1] in self._others[0].touching
        return self._crossing is not None and bool(self._crossing.touching)

    @property
    def pairs_apart(self) -> int:
        """1 where bounds told that the cable has not touched itself, as the last shape was solved for; else 0."""
        return 0 if self._crossing is None else self._crossing.culled

    def sensitivity(self, by: Sequence[str] = ENDS, *, at: str = "cable") -> Array:
        """(points, 3, m): how the centreline moves with what holds the cable, d positions at fixed arc length / d (by).

        Of the last solved shape, exact; columns are in the order of `by`.

        Parameters
        ----------
        by : names, each once
            "start", "end", and "clip:NAME": six columns, vx vy vz [m/s] wx wy wz [rad/s] in world axes; rotation is
            about that cable end, or with ``at="gripper"`` about the gripper's own origin, and of a clip about the
            origin of its pose. "length", "linear_density", "twisting_stiffness", and "bending_stiffness" (the mean of
            the two, which keep their ratio): one column, per unit; with "length" points keep their share of it, clips
            and masses their arc length. "body:NAME": six columns, zero for a body that nothing touches. What holds
            other cables that it touches stands still. Columns of a free end, and of rotations that a grip or clip
            leaves free, are zero.

        Raises
        ------
        ArgumentError
            If the model is a closed form by choice or nothing was predicted yet, and for a name that does not exist.
        """
        checks.one_of("at", at, ("cable", "gripper"))
        if isinstance(by, str):
            by = (by,)
        elif by is not ENDS:
            by = checks.entries("by", by, str, "Write ('start', 'end'), for example.")
        return cosserat.sensitivity(self._solved("sensitivity"), by, at=at)

    def turning(self, arc_length: float, *, at: str = "cable", by_clips: bool = False) -> Array:
        """(3, 12): how the cable frame at an arc length [m] turns, in its own axes [rad], with the poses of both ends.

        Of the last solved shape, exact; columns, and `at`, as for `sensitivity`. by_clips: after them come six for each
        clip on a robot link, in order of arc length.

        Raises
        ------
        ArgumentError
            As `sensitivity` does; and in eyelets, and of cables that touch each other or themselves.
        """
        checks.one_of("at", at, ("cable", "gripper"))
        checks.number("arc_length", arc_length, at_least=0.0, at_most=self.cable.length, unit="m")
        return turning(self._solved("turning"), arc_length, at=at, by_clips=by_clips)

    def _solved(self, asked: str) -> Solved:
        """What the rod has solved last; refused where there is none."""
        if isinstance(self._solver, ClosedForm):
            raise ArgumentError.of(
                "model", self.model, f"{asked} needs the Cosserat rod", "Choose model='cosserat' or 'auto'."
            )
        state: Solved | None = self._together() or self._solver.rod_state()
        if state is None:
            raise ArgumentError(f"{asked}() needs a solution, and there is none yet. Call predict first.")
        return state

    def _together(self) -> Member | None:
        """What solved for the last shape along with what its cable touches; None if it touches no cable."""
        crossing, index = self._others or (self._crossing, 0)
        return None if crossing is None else crossing.state_of(index)

    @property
    def rod_state(self) -> Memory | Member:
        """The memory of the rod that gave the last shape, in contact or not; None if none did."""
        together = self._together()
        if together is not None or self._last is None or self._last.model != cosserat.MODEL:
            return together
        return self._solver.rod_state()

    def ahead(self) -> Callable[[Grip, Grip | FreeEnd], CableShape]:
        """What predicts from the last shape on, with links, and cables that it touches, where they are.

        This predictor stays as it is. Only of the rod.
        """
        crossing, index = self._others or (self._crossing, 0)
        if crossing is not None and index in crossing.touching:
            together = crossing.twin()
            problem: Problem = together.strands.part_with(index).problem
            return lambda start, end: (problem.move(start, end, problem.links), together.solve()[index])[1]
        other = self.twin()
        return lambda start, end: other.predict(start, end, other.problem.links)

    def beside(self, other: Predictor, ends: Ends, links: Links, acceleration: ArrayLike | None) -> CableShape:
        """What another predictor, of a cable almost alike, predicts among the cables that this one's touches now."""
        start, end = ends
        if not (self._others is not None and self.touching):
            return other.predict(start, end, links, acceleration=acceleration)
        other.accelerate(acceleration)
        other.problem.move(start, end, links)
        crossing, index = self._others
        return crossing.beside(index, other).solve()[index]

    def twin(self) -> Predictor:
        """Once more, of this cable alone: it goes on from the last shape, and this one stays as it is."""
        assert isinstance(self._solver, Rod)
        other: Predictor = object.__new__(Predictor)  # __new__ looks at what the cable is
        vars(other).update(vars(self))
        other.problem, other._crossing, other._others = copy.copy(self.problem), None, None
        other._sliding = None
        if self._still is self.problem:
            other._still = other.problem
        other._solver = self._solver.twin(other.problem, self._last)
        return other

    def onto(self, cable: Cable) -> Predictor:
        """Of a cable almost alike, alone: it goes on from the last shape, and this one stays as it is."""
        other = self.twin()
        other._still = other._checked(self._problem_of(cable, scene=self.scene))
        other._load(other._still)
        return other

    def _with_itself(self) -> Crossing | None:
        """What keeps the cable out of itself, where the scene asks for it and the model can."""
        if not self.problem.solves_crossing or self._others is not None or not self.is_rod:
            return None
        return Crossing(Strands([OneCable("cable", self)]), self.time_budget)

    def accelerate(self, acceleration: ArrayLike | None) -> None:
        """Makes the problem that of a cable which moves like this, or is at rest, until the next prediction."""
        if acceleration is None:
            if self.problem is not self._still:
                self._load(self._still)
            return
        problem = self._problem_of(self.cable, scene=self.scene, acceleration=acceleration)
        if _moves_alike(self.problem, problem):
            return
        self._load(self._checked(problem))

    def _load(self, problem: Problem) -> None:
        """Makes this the problem, whose loads may be others."""
        self.problem = problem
        self._last = None

    def _checked(self, problem: Problem) -> Problem:
        """The problem, if its model can solve it.

        Only the rod is held in clips, rests on bodies, or takes loads that are not linear along the cable; where it is
        kept out of bodies, of itself and of others, they are linear, too.
        """
        touches = bool(problem.bodies) or problem.solves_crossing
        if problem.swing is not None and (touches or not self.is_rod):
            if self.is_rod:
                reason, remedy = "contact='solve'", "write contact='warn'."
            else:
                reason = f"model {self.model!r} of this cable"
                remedy = "choose model='cosserat' and a bending stiffness above 0 N m^2."
            reason += " knows only accelerations that are linear along the cable"
            shape = f"shape {problem.swing.shape}"
            raise ArgumentError.of("acceleration", shape, reason, f"Give at most two rows, or {remedy}")
        if problem.velocity is not None and longest_delay(problem.cable) > 0.0 and (touches or not self.is_rod):
            reason = "contact='solve'" if self.is_rod else f"model {self.model!r} of this cable"
            raise ArgumentError.of(
                "acceleration",
                "with a velocity",
                f"{reason} knows no retardation time",
                "Leave out the last three columns, or predict by the rod with contact='warn'.",
            )
        if isinstance(self._solver, ClosedForm):
            if problem.bodies:
                raise ArgumentError.of(
                    "scene.contact",
                    "solve",
                    f"model {self.model!r} of this cable knows no contact",
                    "Write contact='warn', or choose model='cosserat' and a bending stiffness above 0 N m^2.",
                )
            if problem.clips:
                raise ArgumentError.of(
                    "scene.clips",
                    len(problem.clips),
                    f"model {self.model!r} of this cable knows no clips",
                    "Remove the clips, or choose model='cosserat' and a bending stiffness above 0 N m^2.",
                )
        divided(problem.bodies)
        return problem


def _moves_alike(one: Problem, other: Problem) -> bool:
    """Whether both cables move, with the same accelerations and velocities."""
    if one.acceleration is None or other.acceleration is None or (one.velocity is None) != (other.velocity is None):
        return False
    pairs = [(one.acceleration, other.acceleration), (one.velocity, other.velocity)]
    return all(a is None or b is None or np.array_equal(a, b) for a, b in pairs)


_MADE_FROM = inspect.signature(Predictor.__init__)
_MADE_FROM = _MADE_FROM.replace(parameters=list(_MADE_FROM.parameters.values())[1:])
Predictor.__signature__ = _MADE_FROM  # type: ignore[attr-defined]  # not that of __new__


@overload
def predict(cable: Cable, start: Pose | Grip, end: Pose | Grip | FreeEnd | None, **_: Any) -> CableShape: ...
@overload
def predict(cable: Harness, start: Mapping[str, Pose | Grip | FreeEnd | None], **_: Any) -> HarnessShape: ...
def predict(  # type: ignore[misc]
    cable: Cable | Harness,
    start: Any,
    end: Any = NOT_GIVEN,
    *,
    model: str = "auto",
    gravity: ArrayLike = GRAVITY,
    points: int = 150,
    tolerance: float | None = None,
    scene: Scene | None = None,
    distributed_load: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    links: Mapping[str, Pose] | None = None,
) -> Any:
    """The shape of a cable between two ends, solved once from nothing; of a harness, between ends by their names.

    The keywords are those of :class:`Predictor` and of :meth:`Predictor.predict`.

    Parameters
    ----------
    cable : Cable or Harness
    start, end
        Of a cable: Pose or Grip; `end` may be a FreeEnd or None. Of a harness `start` alone, the mapping of ends to
        Pose, Grip or FreeEnd; the shape is a :class:`HarnessShape`.

    Raises
    ------
    ArgumentError
        For wrong arguments.
    """
    predictor = Predictor(
        cable,
        model=model,
        gravity=gravity,
        points=points,
        tolerance=tolerance,
        scene=scene,
        distributed_load=distributed_load,
    )
    if isinstance(cable, Harness):
        one_mapping(start, () if end is NOT_GIVEN else (end,))
        of_harness: Any = predictor
        return of_harness.predict(start, links=links, acceleration=acceleration)
    both_given("predict(cable, start, end)", end)
    return predictor.predict(start, end, links, acceleration=acceleration)
