"""The robot brings the cable to a shape: :class:`Servo`, one quadratic programme a step, through mink."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, final

import mink
import numpy as np
import qpsolvers
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, SteeringError
from cable_shape.prediction.predictor import Predictor
from cable_shape.robots.held_cable import Held, HeldCable
from cable_shape.robots.servo_seen import Seen
from cable_shape.robots.servo_targets import KeepClear, Target, as_targets
from cable_shape.robots.servo_tasks import ServoTask, task_of
from cable_shape.robots.steering import CableChordLimit, CableClearanceLimit, CableLoadLimit
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import Clearance
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape, Status

#: of the quadratic cost, (3 mm)^2 a rad^2: joints that move the cable less are hardly used
_DAMPING = 1e-5
#: A step that turns out so much longer or shorter than to first order, in its own part and [m], is halved, ...
_UNLIKE, _UNLIKE_AT_LEAST = 0.5, 1e-4
_OVER = 1.001  # of a load's limit: steps are to first order
_HALVINGS = 5  # ... at most so often, and then not made
#: Stalled: the errors, weighted, have fallen by less than this part for so long [s].
_PROGRESS, _PATIENCE = 0.02, 1.0
_LONGEST_STEP = 1.0  # s
_LIMIT: Any = mink.Limit
_BINDS = 1e-9  # of a multiplier, against the largest


@final
class Servo:
    """Finds, every control cycle, joint velocities that bring the cable nearer to its targets.

    Each step makes the squares of all targets' errors least, to first order, by the exact sensitivity of the predicted
    shape times the grippers' Jacobians, within the joints' positions and velocities. Open loop the cable is where it
    is predicted. Closed loop, with shapes that are seen, it is where the prediction and what was seen beside it put it
    (:mod:`cable_shape.robots.servo_seen`), so that a cable that is stiffer, longer or gripped elsewhere than the model
    says comes to its target all the same.

    Parameters
    ----------
    held : HeldCable
        Of one cable; it is used from now on by this object.
    targets : target or sequence of targets
        :class:`PointsTarget`, :class:`CentrelineTarget`, :class:`TangentTarget`, :class:`MouthTarget`, and beside them
        :class:`KeepClear`.
    limits : sequence of mink.Limit
        Beside those that always hold: positions and velocities of the joints as the URDF has them, that the cable is
        not pulled taut, and the limits that it has itself.
    rate : float
        [1/s]: errors fall like exp(-rate t), where limits let them.
    speed : float
        [m/s], no point of the cable moves faster.
    delay : float
        [s], how old a shape is when `step` is given it. A delay of which nothing is known, of 0.1 s, say, makes the way
        longer and does no more.
    settling : float
        [s], over which what is seen is averaged: half a period of the cable's swing, or more. With less its swing comes
        back through the arms, and may grow.
    q : (n,) array_like, optional
        [rad] or [m], where the joints are at first; default: the robot's home.

    Attributes
    ----------
    errors : tuple of float
        What is left of each target but KeepClear, in their order: [m], or [rad] of a tangent.
    reached : bool
        Whether each is within its tolerance; closed loop, for as long as it takes to see it: `delay` and twice
        `settling`.
    stalled : bool
        Not reached, and for a second no nearer: this is the nearest that was found.
    binds : tuple of str
        In words, what holds the cable from its targets in this step: joints at their limits, bodies kept clear of, a
        cable that would be taut, bent too much or snap.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    def __init__(
        self,
        held: HeldCable,
        targets: Target | Sequence[Target],
        limits: Sequence[mink.Limit] = (),
        *,
        rate: float = 3.0,
        speed: float = 0.25,
        delay: float = 0.0,
        settling: float = 0.5,
        q: ArrayLike | None = None,
    ) -> None:
        checks.instance("held", held, (HeldCable,), "Write HeldCable(Predictor(cable), robot).")
        if not isinstance(held.predictor, Predictor):
            raise ArgumentError("held of a harness is not allowed: a servo moves one cable. Steer a harness by mink.")
        self.held, self._predictor = held, held.predictor
        self.rate = checks.number("rate", rate, above=0.0, unit="1/s")
        self.speed = checks.number("speed", speed, above=0.0, unit="m/s")
        delay = checks.number("delay", delay, at_least=0.0, unit="s")
        settling = checks.number("settling", settling, above=0.0, unit="s")
        self._seen = Seen(self._predictor.problem.points, delay, settling)
        self._watch = MarginWatch(self._predictor.cable, Scene())
        self._limits = [*_always(held), *checks.entries("limits", limits, _LIMIT)]
        self._time = 0.0
        self.targets = targets
        self.q = held.robot.home if q is None else q
        held.correction = None

    @property
    def targets(self) -> tuple[Target, ...]:
        """What is to be reached; it may be set to others on the way."""
        return self._targets

    @targets.setter
    def targets(self, targets: Target | Sequence[Target]) -> None:
        self._targets = as_targets(targets)
        self._tasks: list[ServoTask] = []
        self._clear: list[mink.Limit] = []
        for target in self._targets:
            if isinstance(target, KeepClear):
                self._clear.append(CableClearanceLimit(self.held, target.scene, minimum=target.minimum))
            else:
                self._tasks.append(task_of(self.held, target))
        self.errors, self.reached = (math.nan,) * len(self._tasks), False
        self.stalled, self.binds = False, tuple[str, ...]()
        self._best, self._since, self._there = math.inf, self._time, 0.0

    @property
    def q(self) -> Array:
        """(n,) [rad] or [m], in the order of `robot.joint_names`: where the joints are now.

        A step moves them on as if the robot followed; set what was measured where it does not.
        """
        return self.held.q(self._configuration)

    @q.setter
    def q(self, q: ArrayLike) -> None:
        robot = self.held.robot
        given = checks.vector("q", q, len(robot.joint_names), "rad or m")
        self._configuration = self.held.configuration(np.clip(given, robot.lower, robot.upper))

    def step(self, shape: CableShape | None, dt: float) -> Array:
        """Joint velocities (n,) [rad/s] or [m/s] for the next `dt` [s], in the order of `robot.joint_names`.

        Parameters
        ----------
        shape : CableShape or None
            As it is seen, by a tracker, say: closed loop. None, the predicted one, or one that is not usable: the cable
            is where the prediction has it, corrected by what was seen before.
        dt : float
            [s], above 0 and at most 1.

        Raises
        ------
        ArgumentError
            For wrong arguments. Never for a physical reason: without a shape the velocities are zero.
        """
        if shape is not None:
            checks.instance("shape", shape, (CableShape,), "Give what a Tracker or a Predictor gives, or None.")
        dt = checks.number("dt", dt, above=0.0, at_most=_LONGEST_STEP, unit="s")
        still = np.zeros(len(self.held.robot.joint_names))
        try:
            now = self.held.predicted(self._configuration)
        except SteeringError as error:
            self.binds, self.reached, self._there = (str(error),), False, 0.0
            return self._told(still, math.inf, dt)
        assert isinstance(now.shape, CableShape)
        self._seen.predict(self._time, now.shape.positions)
        if shape is not None and shape.usable and shape is not now.shape:
            if not np.isfinite(shape.positions).all():
                raise ArgumentError.of("shape.positions", "not finite", "every entry must be finite", "Look at status.")
            self._seen.take(self._time, shape, dt)
        self.held.correction = self._seen.correction
        for task in self._tasks:
            task.begin(self._configuration)
            task.gain = -math.expm1(-self.rate * dt)
        moved, binds = self._solve(dt)
        moved, refused = self._bounded(now, moved, dt)
        self.binds = (*refused, *binds)
        self.errors = tuple(task.off(self._configuration) for task in self._tasks)
        there = all(task.reached(self._configuration) for task in self._tasks)
        self._there = self._there + dt if there else 0.0
        self.reached = there and self._there >= self._seen.lag
        cost = math.sqrt(sum(task.left(self._configuration) ** 2 for task in self._tasks))
        return self._told(moved[self.held.velocities], cost, dt)

    def predicted(self) -> CableShape | None:
        """The shape between the grips as they are now, corrected by what was seen; None if there is none."""
        try:
            shape = self.held.at(self._configuration).shape
        except SteeringError:
            return None
        assert isinstance(shape, CableShape)
        return shape

    def reset(self) -> None:
        """Forgets what was seen: the cable is another one, or was gripped anew."""
        self._seen.reset()
        self.held.correction = None

    def _told(self, moved: Array, cost: float, dt: float) -> Array:
        """Goes on by a motion of the joints (n,), and says whether it comes nearer; the velocities."""
        robot = self.held.robot
        q = self.q
        further = np.clip(q + moved, robot.lower, robot.upper)
        self.q = further
        self._time += dt
        if cost < (1.0 - _PROGRESS) * self._best:
            self._best, self._since = cost, self._time
        self.stalled = not self._there and self._time - self._since >= _PATIENCE
        return np.asarray((further - q) / dt)

    def _solve(self, dt: float) -> tuple[Array, tuple[str, ...]]:
        """The best motion (nv,) to first order, and what binds it, in words."""
        objective = mink.build_ik(self._configuration, self._tasks, dt, damping=_DAMPING, limits=[])
        rows, bounds, names = [], [], []
        for limit in (*self._limits, *self._clear):
            constraint = limit.compute_qp_inequalities(self._configuration, dt)
            if constraint.G is not None and constraint.h is not None:
                rows.append(constraint.G)
                bounds.append(constraint.h)
                names += self._words(limit, len(constraint.h))
        G, h = np.concatenate(rows), np.concatenate(bounds)
        found = qpsolvers.solve_problem(qpsolvers.Problem(objective.P, objective.q, G, h), solver="daqp")
        if not found.found:  # something is nearer than it may be: no nearer, then
            h = np.maximum(h, 0.0)
            found = qpsolvers.solve_problem(qpsolvers.Problem(objective.P, objective.q, G, h), solver="daqp")
        if not found.found or found.x is None or found.z is None:
            return np.zeros(len(objective.q)), ("the limits contradict each other",)
        least = _BINDS * max(1.0, float(np.abs(found.z).max()))
        binding = dict.fromkeys(names[row] for row in np.flatnonzero(found.z > least) if names[row])
        return np.asarray(found.x), tuple(binding)

    def _words(self, limit: mink.Limit, count: int) -> list[str]:
        """What each row of a limit is about; empty for velocities."""
        if isinstance(limit, mink.ConfigurationLimit):
            model = self.held.model
            joints = [model.joint(int(model.dof_jntid[dof])) for dof in limit.indices]
            return [
                f"{joint.name} is at its {side} limit, {joint.range[place]:.4g}"
                for side, place in (("upper", 1), ("lower", 0))
                for joint in joints
            ]
        if isinstance(limit, CableClearanceLimit):
            bodies = limit.distances(self._configuration)[0]
            return [f"{body.body} is to be kept {limit.minimum:g} m clear of" for body in bodies]
        if isinstance(limit, CableLoadLimit):
            return [words for _, _, words in limit.near_limit(self._configuration)]
        if isinstance(limit, CableChordLimit):
            return [f"the cable would be taut: its ends are {limit.most:g} of its length apart"]
        return ["" if isinstance(limit, mink.VelocityLimit) else type(limit).__name__] * count

    def _bounded(self, now: Held, moved: Array, dt: float) -> tuple[Array, tuple[str, ...]]:
        """As much of a motion (nv,) as leads to a shape near the one expected, and what it was that did not."""
        assert isinstance(now.shape, CableShape)
        answer = now.jacobian @ moved
        fastest = float(np.linalg.norm(answer, axis=1).max())
        part = min(1.0, self.speed * dt / fastest) if fastest > 0.0 else 1.0
        refused = ""
        for _ in range(_HALVINGS + 1):
            refused = self._refused(now, part * moved, part * answer)
            if not refused:
                return part * moved, ()
            part *= 0.5
        return np.zeros_like(moved), (refused,)

    def _refused(self, now: Held, moved: Array, answer: Array) -> str:
        """What is wrong with the shape after a motion, in words; empty if nothing is."""
        assert isinstance(now.shape, CableShape)
        grips = self.held.robot.grips(now.q + moved[self.held.velocities])
        shape = self._predictor.ahead()(*grips)
        if shape.status in (Status.SNAPPED, Status.UNSTABLE):
            return "the cable would snap: it would jump to another stable shape"
        if not shape.usable:
            return f"the cable would be {shape.status.name}: {shape.detail or shape.status.remedy}"
        expected = now.shape.positions + answer
        unlike = float(np.linalg.norm(shape.positions - expected, axis=1).max())
        if unlike > _UNLIKE_AT_LEAST + _UNLIKE * float(np.linalg.norm(answer, axis=1).max()):
            return "the cable would move on by itself: it is about to snap"
        before = {margin.kind: margin.used for margin in self._watch.margins(now.shape, Clearance(), 0, held=True)}
        for margin in self._watch.margins(shape, Clearance(), 0, held=True):
            if margin.used > max(_OVER, before.get(margin.kind, 0.0)):
                where = f"{margin.kind.name} at {margin.arc_length:.3g} m"
                return f"{where} would be beyond its limit, {margin.limit:.3g}"
        return ""


def _always(held: HeldCable) -> list[mink.Limit]:
    """Limits of the joints, of the chord and of loads."""
    robot = held.robot
    speeds = np.where(robot.carrying, robot.velocity_limits, 0.0)
    named = {name: float(v) for name, v in zip(robot.joint_names, speeds, strict=True) if math.isfinite(v)}
    joints = [mink.ConfigurationLimit(held.model), mink.VelocityLimit(held.model, named)]
    return [*joints, CableChordLimit(held), CableLoadLimit(held)]
