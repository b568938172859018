"""Grips -> joint positions of both arms, for planning, tests and demos: :class:`DualArmIK` through mink."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.pose import Grip, Pose, as_grip
from cable_shape.robots.mujoco_model import MujocoModel
from cable_shape.robots.robot import Robot

_SEED = 5
#: weight of the pull towards the posture against that of the grips: 1e-8 of the quadratic cost
_POSTURE_COST = 1e-4
#: Levenberg-Marquardt damping of the grips' tasks, in proportion to their error: steps stay sane near singularities
_DAMPING = 1e-2


class IkResult(NamedTuple):
    """Joint positions and how near they bring the grips."""

    q: Array  # (n,) [rad] or [m], in the order of robot.joint_names; within the limits
    converged: bool
    position_error: float  # m, the larger of both grips
    rotation_error: float  # rad, the larger of both grips
    iterations: int  # of all attempts together


@final
class DualArmIK:
    """Finds joint positions that put both grips where they are asked.

    Differential inverse kinematics: a quadratic programme a step, both grips as tasks of equal weight (1 m weighs as
    much as 1 rad), a faint pull towards the posture and the joint limits as bounds. What comes out is judged by
    Pinocchio, and leaves `robot` where it was judged last.

    Parameters
    ----------
    robot : Robot
    position_tolerance, rotation_tolerance : float
        [m], [rad]: converged when both grips are nearer.
    max_iterations : int
        Of one attempt.
    attempts : int
        Further attempts begin at seeded random postures; 1 stays with the posture given, as a path needs.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        position_tolerance: float = 1e-5,
        rotation_tolerance: float = 1e-5,
        max_iterations: int = 100,
        attempts: int = 1,
    ) -> None:
        import mink

        self.robot = robot
        self.position_tolerance = checks.number("position_tolerance", position_tolerance, above=0.0, unit="m")
        self.rotation_tolerance = checks.number("rotation_tolerance", rotation_tolerance, above=0.0, unit="rad")
        self.max_iterations = checks.integer("max_iterations", max_iterations, at_least=1)
        self.attempts = checks.integer("attempts", attempts, at_least=1)
        self._mink = mink
        self._mujoco = MujocoModel(robot)
        model = self._mujoco.model
        self._configuration = mink.Configuration(model)
        self._tools = [
            mink.FrameTask(gripper.frame, "body", position_cost=1.0, orientation_cost=1.0, lm_damping=_DAMPING)
            for gripper in robot.grippers.values()
        ]
        self._posture = mink.PostureTask(model, cost=_POSTURE_COST)
        self._limits = [mink.ConfigurationLimit(model)]

    def solve(self, start: Pose | Grip, end: Pose | Grip, q0: ArrayLike | None = None) -> IkResult:
        """Joint positions that bring the cable's ends to `start` and `end`.

        Parameters
        ----------
        start, end : Pose or Grip
            The cable frame at each end, in the world (of a Grip: its `cable_frame`).
        q0 : (n,) array_like, optional
            Posture to begin at and to stay near; default: the robot's home.
        """
        q0 = self.robot.home if q0 is None else checks.vector("q0", q0, len(self.robot.joint_names))
        grippers = self.robot.grippers.values()
        targets = [
            as_grip(name, end).cable_frame * gripper.offset.inverse()
            for name, end, gripper in zip(("start", "end"), (start, end), grippers, strict=True)
        ]
        for task, target in zip(self._tools, targets, strict=True):
            task.set_target(self._transform(target))
        random = np.random.default_rng(_SEED)
        low, high = np.maximum(self.robot.lower, -np.pi), np.minimum(self.robot.upper, np.pi)
        best = self._attempt(q0, targets)
        iterations = best.iterations
        for _ in range(self.attempts - 1):
            if best.converged:
                break
            another = self._attempt(random.uniform(low, high), targets)
            iterations += another.iterations
            best = min(best, another, key=lambda r: r.position_error + r.rotation_error)
        return best._replace(iterations=iterations)

    def _attempt(self, q0: Array, targets: Sequence[Pose]) -> IkResult:
        """Gauss-Newton steps from `q0` until both tool frames are at `targets`."""
        configuration = self._configuration
        configuration.update(self._mujoco.qpos(np.clip(q0, self.robot.lower, self.robot.upper)))
        self._posture.set_target_from_configuration(configuration)
        tasks = [*self._tools, self._posture]
        iteration = 0
        while True:
            q = np.clip(self._mujoco.q(configuration.q), self.robot.lower, self.robot.upper)
            result = self._judged(q, targets, iteration)
            if result.converged or iteration == self.max_iterations:
                return result
            try:
                velocity = self._mink.solve_ik(configuration, tasks, 1.0, solver="daqp", limits=self._limits)
            except self._mink.NoSolutionFound:
                return result
            configuration.integrate_inplace(velocity, 1.0)
            iteration += 1

    def _judged(self, q: Array, targets: Sequence[Pose], iterations: int) -> IkResult:
        """How near `q` brings the tool frames, by Pinocchio: apart from the solver."""
        self.robot.update(q)
        tools = self.robot.gripper_poses().values()
        errors = [target.distance(tool) for target, tool in zip(targets, tools, strict=True)]
        position, rotation = max(e[0] for e in errors), max(e[1] for e in errors)
        converged = position <= self.position_tolerance and rotation <= self.rotation_tolerance
        return IkResult(q, converged, position, rotation, iterations)

    def _transform(self, pose: Pose) -> Any:
        """A pose as mink's SE3, whose quaternion is w, x, y, z."""
        x, y, z, w = pose.quaternion
        return self._mink.SE3(np.array((w, x, y, z, *pose.position)))
