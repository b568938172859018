"""The cable as the arms' joints move it: :class:`HeldCable`, the shape and its Jacobian at a mink configuration.

The centreline answers the grippers by the rod's sensitivity, the grippers answer the joints by MuJoCo's Jacobians:

    d r(s) / d q = d r(s) / d (twists of both grippers) . d (twists of both grippers) / d q,

twists in world axes about the grippers' own origins; clips on links of the robot count as grippers do. Both factors are
exact, so that their product is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, final

import mink
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, SteeringError
from cable_shape.pose import Grip, Pose, between
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.predictor import Predictor
from cable_shape.robots.mujoco_model import MujocoModel
from cable_shape.robots.on_links import check_links
from cable_shape.robots.robot import Robot
from cable_shape.shape import CableShape
from cable_shape.solve.answers import ENDS
from cable_shape.solve.harness_problem import End
from cable_shape.solve.harness_shape import HarnessShape

_NODES = 4  # of the cubic between points of the shape


class Held(NamedTuple):
    """What was found at one configuration."""

    q: Array  # (n,) [rad] or [m], in the order of robot.joint_names
    grips: tuple[Grip, Grip]
    links: Mapping[str, Pose]  # of the robot, in the world
    shape: CableShape | HarnessShape
    twists: Array  # (12 + 6 m, nv), v and w of the start's gripper, the end's, and clips on links; world axes
    jacobian: Array  # (points, 3, nv), of the shape's positions at fixed arc length; those of all segments of a harness

    def part(self, segment: str = "") -> tuple[CableShape, Array]:
        """The shape of the cable, or of a segment, and its Jacobian (points, 3, nv)."""
        if not isinstance(self.shape, HarnessShape):
            return self.shape, self.jacobian
        first = list(self.shape.segments).index(segment) * self.shape.points
        return self.shape.segments[segment], self.jacobian[first : first + self.shape.points]


@final
class HeldCable:
    """A cable, or a harness, between the grippers of a robot, for tasks and limits of mink.

    The MuJoCo model is made from the robot's own URDF, its joints are mapped by name, and it is compared with Pinocchio
    at random configurations before it is used. What is solved for at a configuration is kept until the next one, so
    that any number of tasks and limits on the same cable cost one prediction a step. Joints that mimic others follow
    them in all that is told here: columns of the Jacobians are those of the joints that lead.

    Parameters
    ----------
    predictor : Predictor
        Of model "cosserat" or "auto", of a cable or a harness. It is used from now on by this object; each prediction
        starts from the last.
    robot : Robot
        Left where it was looked at last.
    grips : (2,) sequence of str, optional
        Of a harness: the ends that the robot's grippers hold, in the grippers' order.
    ends : mapping of open end to Pose, Grip or FreeEnd, optional
        Of a harness: how its other ends are held; those not named are free.
    xml : str, optional
        A URDF or MJCF of one's own for the same robot, as for :class:`~cable_shape.robots.mujoco_model.MujocoModel`.

    Attributes
    ----------
    model : mujoco.MjModel, on which mink's configuration, tasks and limits are made

    Raises
    ------
    RobotError
        If MuJoCo and Pinocchio disagree on the robot.
    ArgumentError
        For ends that are none of the harness, or not as many as there are grippers.
    """

    def __init__(
        self,
        predictor: Predictor | HarnessPredictor,
        robot: Robot,
        *,
        xml: str | None = None,
        grips: Sequence[str] = (),
        ends: Mapping[str, End] | None = None,
    ) -> None:
        check_links(robot, predictor.scene)
        self.predictor, self.robot = predictor, robot
        self.grips, self._ends = tuple(grips), dict(ends or {})
        self._check_ends()
        self._mujoco = MujocoModel(robot, xml)
        self.model = self._mujoco.model
        joints = [self.model.joint(name).id for name in robot.single_joints]
        single: NDArray[np.intp] = np.array(self.model.jnt_dofadr[joints], dtype=np.intp)
        n = len(robot.joint_names)
        #: (n,) where the robot's joints stand among mink's velocities
        self.velocities: NDArray[np.intp] = single[robot.leading]
        rest = robot.single_positions(np.zeros(n))
        #: (nv, nv): velocities of all joints where those that lead are free and those that mimic follow
        self._follow = np.zeros((self.model.nv, self.model.nv))
        for column, leader in zip(np.eye(n), self.velocities, strict=True):
            self._follow[single, leader] = robot.single_positions(column) - rest
        self._data = mujoco.MjData(self.model)  # at what was looked at last, followers in their places
        self._tools = [self.model.body(gripper.frame).id for gripper in robot.grippers.values()]
        self._last: tuple[bytes, Any, Held] | None = None
        self._correction: Array | None = None
        self._corrected: Held | None = None

    def _check_ends(self) -> None:
        """Refuses ends of a cable, and of a harness what cannot be held by both grippers."""
        predictor = self.predictor
        if not isinstance(predictor, HarnessPredictor):
            if self.grips or self._ends:
                bound = "the grippers hold both ends of a cable"
                raise ArgumentError.of("grips", [*self.grips, *self._ends], bound, "Leave grips and ends out.")
            return
        if len(self.grips) != len(self.robot.grippers) or len(set(self.grips)) != len(self.grips):
            bound = f"the robot's {len(self.robot.grippers)} grippers hold as many ends"
            raise ArgumentError.of("grips", list(self.grips), bound, "Name them, the first gripper's first.")
        predictor.problem.move({**self._ends, **dict.fromkeys(self.grips, Pose())})

    @property
    def parts(self) -> dict[str, Cable]:
        """The cable, under "", or the segments of the harness."""
        predictor = self.predictor
        return dict(predictor.harness.segments) if isinstance(predictor, HarnessPredictor) else {"": predictor.cable}

    def configuration(self, q: ArrayLike | None = None) -> mink.Configuration:
        """mink's configuration at the joint positions `q` (n,) [rad] or [m]; default: the robot's home."""
        q = self.robot.home if q is None else checks.vector("q", q, len(self.robot.joint_names))
        return mink.Configuration(self.model, self._mujoco.qpos(q))

    def q(self, configuration: mink.Configuration) -> Array:
        """The robot's joint positions (n,) [rad] or [m], in the order of its `joint_names`."""
        return self._mujoco.q(configuration.q)

    @property
    def correction(self) -> Array | None:
        """(points, 3) [m], world: what was seen less what is predicted, which `at` adds to the positions of a cable.

        None, as at first: nothing was seen.
        """
        return self._correction

    @correction.setter
    def correction(self, apart: ArrayLike | None) -> None:
        if apart is not None:
            if isinstance(self.predictor, HarnessPredictor):
                raise ArgumentError("correction is not allowed for a harness: only cables have one. Set None.")
            apart = checks.numbers("correction", apart, "Give three numbers [m] for each point of the shape.")
            shape = (self.predictor.problem.points, 3)
            if apart.shape != shape or not np.isfinite(apart).all():
                bound = f"it must be finite, of shape {shape}"
                raise ArgumentError.of("correction", f"array of shape {apart.shape}", bound, "See shape.positions.")
        self._correction, self._corrected = apart, None

    def at(self, configuration: mink.Configuration) -> Held:
        """The shape there, corrected by what was seen, and how it answers the joints.

        Raises
        ------
        SteeringError
            As for `predicted`.
        """
        held = self.predicted(configuration)
        if self._correction is None:
            return held
        if self._corrected is None:
            assert isinstance(held.shape, CableShape)
            shape = held.shape.again()
            shape.buffer, shape.reused = held.shape.buffer.copy(), False
            shape.positions[:] += self._correction
            self._corrected = held._replace(shape=shape)
        return self._corrected

    def predicted(self, configuration: mink.Configuration) -> Held:
        """The shape there as it is predicted, whatever was seen.

        Raises
        ------
        SteeringError
            If there is no usable shape there: the chord is longer than the cable, for example.
        """
        key = configuration.q.tobytes()
        if self._last is not None and self._last[0] == key and self._last[1] is self.predictor.problem:
            return self._last[2]
        self._last = self._corrected = None
        q = self.q(configuration)
        self._data.qpos[:] = self._mujoco.qpos(q)
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_comPos(self.model, self._data)
        grips, links = self.robot.grips(q), self.robot.link_poses()
        shape = self._shape(grips, links)
        if not shape.status:
            raise SteeringError(
                f"the cable cannot be steered: {shape.status.name}, {shape.detail or shape.status.remedy} Keep the "
                "grips nearer (CableChordLimit) and the steps shorter (mink.VelocityLimit)."
            )
        twists = np.concatenate([*[self._twist(body) for body in self._tools], *self._clips(links)])
        held = Held(q, grips, links, shape, twists, self._answers() @ twists)
        self._last = key, self.predictor.problem, held
        return held

    def _shape(self, grips: tuple[Grip, Grip], links: Mapping[str, Pose]) -> CableShape | HarnessShape:
        """Between these grips."""
        if isinstance(self.predictor, HarnessPredictor):
            ends = {**self._ends, **dict(zip(self.grips, grips, strict=True))}
            return self.predictor.predict(ends, links=links)
        return self.predictor.predict(*grips, links)

    def _answers(self) -> Array:
        """(points, 3, 6 k), to the twists of both grippers and of the clips on links, in the order of the scene.

        Of a harness the points of all its segments.
        """
        predictor = self.predictor
        if not isinstance(predictor, HarnessPredictor):
            return predictor.sensitivity((*ENDS, *predictor.problem.moving_clips[0]), at="gripper")
        whole = np.concatenate(list(predictor.sensitivity(at="gripper", by_clips=True).values()))
        ends = [6 * predictor.grips.index(end) for end in self.grips]
        clips = range(6 * len(predictor.grips), whole.shape[2], 6)
        return np.asarray(whole[:, :, np.concatenate([first + np.arange(6) for first in (*ends, *clips)])])

    def _clips(self, links: Mapping[str, Pose]) -> list[Array]:
        """(6, nv) each, the twists of the clips on links, at their own origins; world axes."""
        scene = self.predictor.scene
        out = []
        for clip in () if scene is None else scene.clips:
            if clip.link is not None:
                twist = self._twist(self.model.body(clip.link).id)
                link = links[clip.link]
                x, y, z = (link * clip.pose).position - link.position
                twist[:3] += np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))) @ twist[3:]
                out.append(twist)
        return out

    def _twist(self, body: int) -> Array:
        """(6, nv), v and w of a body's frame in world axes, at its origin."""
        out = np.empty((6, self.model.nv))
        mujoco.mj_jacBody(self.model, self._data, out[:3], out[3:], body)
        return out @ self._follow

    def point_on(self, link: str, point: Array) -> Array:
        """(3, nv), velocity of the point [m], world, that the link carries, where `at` looked last."""
        out = np.empty((3, self.model.nv))
        mujoco.mj_jac(self.model, self._data, out, None, point, self.model.body(link).id)
        return out @ self._follow

    def weights(self, arc_length: float, *, slope: bool = False) -> Array:
        """(points,), of the points of a shape for the value at an arc length [m], or for the slope by it.

        By one polynomial through the nearest points, a cubic for the value, one of 4th degree for the slope.
        """
        points = self.predictor.problem.points
        spacing = next(iter(self.parts.values())).length / (points - 1)
        first, near = _near(arc_length / spacing, points, slope=slope)
        out = np.zeros(points)
        out[first : first + len(near)] = near / spacing if slope else near
        return out

    def point(self, held: Held, arc_length: float, segment: str = "") -> tuple[Array, Array]:
        """The centreline there (3,) [m], world, and its Jacobian (3, nv), by one cubic through the nearest points."""
        shape, jacobian = held.part(segment)
        first, weights = _near(arc_length / shape.arc_length[1], len(shape.arc_length))
        near = slice(first, first + len(weights))
        return weights @ shape.positions[near], np.tensordot(weights, jacobian[near], 1)

    def frame(self, configuration: mink.Configuration, arc_length: float) -> Array:
        """(4,) x, y, z, w: the cable frame at an arc length [m], as it is predicted, between the nearest two points."""
        shape = self.predicted(configuration).part()[0]
        x = arc_length / shape.arc_length[1]
        first = min(int(x), shape.points - 2)
        near = slice(first, first + 2)
        poses = np.concatenate((shape.positions[near], shape.quaternions[near]), axis=1)
        return between(poses[0], poses[1], x - first)[3:]

    def turning(self, configuration: mink.Configuration, arc_length: float) -> Array:
        """(3, nv), how that frame turns about its own axes. Only of a cable."""
        held = self.predicted(configuration)
        assert isinstance(self.predictor, Predictor)
        return np.asarray(self.predictor.turning(arc_length, at="gripper", by_clips=True) @ held.twists)


def _near(x: float, points: int, *, slope: bool = False) -> tuple[int, Array]:
    """Lagrange's weights for the value at `x`, or its slope, among `points` at 0, 1, 2, and the first that has one."""
    count = min(_NODES + slope, points)
    first = min(max(int(x + 0.5 * slope) - (count - 1) // 2, 0), points - count)
    x -= first
    powers = np.arange(count)
    asked = powers * x ** np.maximum(powers - 1, 0) if slope else x**powers
    return first, np.linalg.solve(np.vander(powers.astype(float), count, increasing=True).T, asked)
