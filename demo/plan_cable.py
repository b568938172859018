"""A worked planner: two arms carry a cable from one place to another, past a post, and touch nothing.

OMPL's RRT-Connect grows two trees in the joints of both arms. What decides is one call: every edge is a path of
joints, and `check_trajectory` says whether the cable stays clear, within its limits and on its branch along all of it,
with nothing hidden between its ends. The arms themselves are checked by MuJoCo, likewise to a bound. At the end the
whole path is checked once more in one piece, which is what counts.
"""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import mujoco
import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

import cable_shape as cs
from cable_shape.robots.ik import DualArmIK
from cable_shape.robots.mujoco_model import MujocoModel
from cable_shape.robots.robot import Robot

ROOT = Path(__file__).resolve().parents[1]
#: the cable's ends at both places: x and height of the grips, and the chord between them, along -y [m]
FROM, TO = (0.40, 0.35, 0.80), (0.70, 0.35, 0.80)
TABLE = cs.Obstacle("table", cs.Box((1.2, 1.8, 0.04)), cs.Pose((0.35, 0.0, -0.02)))
POST = cs.Obstacle("post", cs.Capsule(0.03, 0.27), cs.Pose((0.55, 0.0, 0.165)))
SCENE = cs.Scene(obstacles=[TABLE, POST], error_distance=0.01, warn_distance=0.03)
ARMS_APART = 0.01  # m, that the arms keep from each other, from themselves and from obstacles at the places looked at
AROUND = 0.6  # rad, by which the search may leave the joints' range between start and goal
REACH = 0.8  # rad, of one edge
SPEED = 0.3  # of the joints' velocity limits


class Plan(NamedTuple):
    """A path that was found, and what it took."""

    path: cs.JointPath  # with times
    check: cs.TrajectoryCheck  # of all of it, in one piece
    direct: cs.TrajectoryCheck  # of the straight way from start to goal, which would be shorter
    edges: int  # that the search looked at
    seconds: float


def cable() -> cs.Cable:
    """The demo's cable, with its limits."""
    return cs.Cable.from_yaml(ROOT / "config/cables/demo.yaml")


def ends(x: float, height: float, chord: float) -> tuple[cs.Pose, cs.Pose]:
    """The cable's end frames: the tangent d3 along -y, d1 forward."""
    level = (0.5**0.5, 0.0, 0.0, 0.5**0.5)
    return cs.Pose((x, 0.5 * chord, height), level), cs.Pose((x, -0.5 * chord, height), level)


class Arms:
    """Whether the arms keep apart from each other, themselves and the scene, along straight ways in the joints.

    No point of the arms moves further than its reach from the joints times what these turn, so that places near enough
    to each other leave nothing unseen: arms that are ARMS_APART at both do not touch between them.
    """

    def __init__(self, robot: Robot, scene: cs.Scene) -> None:
        spec = mujoco.MjSpec.from_string(robot.urdf)
        spec.compiler.fusestatic = False
        for body in scene.obstacles:
            add_body(spec, body)
        self._mujoco = MujocoModel(robot, spec.to_xml())
        model = self._mujoco.model
        model.geom_margin[:] = ARMS_APART
        self._data = mujoco.MjData(model)
        moving = model.geom_bodyid > 0  # all but the obstacles
        beyond = np.linalg.norm(model.geom_pos, axis=1) + model.geom_rbound  # its link's origin
        self._stride = 2.0 * ARMS_APART / (robot.reach + beyond[moving].max())
        #: of each gripper, whose fingers are near each other by design
        self._fingers = [{model.body(link).id for link in g.gripping_links} for g in robot.grippers.values()]

    def apart(self, q: np.ndarray) -> bool:
        """At one place."""
        model, data = self._mujoco.model, self._data
        data.qpos[:] = self._mujoco.qpos(q)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        near = data.contact.geom[: data.ncon][data.contact.dist[: data.ncon] < ARMS_APART]
        pairs = map(set, model.geom_bodyid[near].tolist())
        return all(any(pair <= fingers for fingers in self._fingers) for pair in pairs)

    def stay_apart(self, a: np.ndarray, b: np.ndarray) -> bool:
        """All the way."""
        steps = max(1, int(np.ceil(np.abs(b - a).sum() / self._stride)))
        return all(self.apart(a + x * (b - a)) for x in np.linspace(0.0, 1.0, steps + 1))


def add_body(spec: Any, body: cs.Obstacle) -> None:
    """An obstacle as a geom of MuJoCo's world."""
    x, y, z, w = body.pose.quaternion
    if isinstance(body.solid, cs.Box):
        kind, size = mujoco.mjtGeom.mjGEOM_BOX, 0.5 * body.solid.size
    elif isinstance(body.solid, cs.Capsule):
        kind, size = mujoco.mjtGeom.mjGEOM_CAPSULE, np.array((body.solid.radius, 0.5 * body.solid.length, 0.0))
    else:
        raise cs.ArgumentError.of(body.name, body.solid, "it must be a box or a capsule", "Add its kind here.")
    spec.worldbody.add_geom(name=body.name, type=kind, size=size, pos=body.pose.position, quat=(w, x, y, z))


class Edges(ob.MotionValidator):
    """OMPL's question about an edge of its trees, answered by the arms and by the cable."""

    def __init__(self, space: Any, search: Search) -> None:
        super().__init__(space)
        self._search = search

    def checkMotion(self, a: Any, b: Any) -> bool:
        """Whether the straight way from a to b is valid."""
        search = self._search
        return search.valid(np.array([search.joints(a), search.joints(b)]))


class Search:
    """RRT-Connect through the joints of both arms."""

    def __init__(self, robot: Robot, held: cs.Cable, scene: cs.Scene, start: np.ndarray, goal: np.ndarray) -> None:
        self.robot, self.cable, self.scene, self.start, self.goal = robot, held, scene, start, goal
        self.moving = np.flatnonzero(["finger" not in name for name in robot.joint_names])
        self.arms = Arms(robot, scene)
        self.edges = 0
        low, high = np.minimum(start, goal) - AROUND, np.maximum(start, goal) + AROUND
        bounds = ob.RealVectorBounds(len(self.moving))
        for i, joint in enumerate(self.moving):
            bounds.setLow(i, float(max(low[joint], robot.lower[joint])))
            bounds.setHigh(i, float(min(high[joint], robot.upper[joint])))
        self.space = ob.RealVectorStateSpace(len(self.moving))
        self.space.setBounds(bounds)

    def joints(self, state: Any) -> np.ndarray:
        """The robot's joint positions at a state of OMPL's."""
        q = self.start.copy()
        q[self.moving] = [state[i] for i in range(len(self.moving))]
        return q

    def state(self, q: np.ndarray) -> Any:
        """OMPL's state at joint positions of the robot's."""
        state = self.space.allocState()
        for i, joint in enumerate(self.moving):
            state[i] = float(q[joint])
        return state

    def check(self, rows: np.ndarray) -> cs.TrajectoryCheck:
        """What is to be said of the cable along these waypoints."""
        return cs.check_trajectory(self.cable, self.scene, self.robot, cs.JointPath(self.robot.joint_names, rows))

    def valid(self, rows: np.ndarray) -> bool:
        """Whether arms and cable are, along all of it; the cheap question first."""
        self.edges += len(rows) > 1
        start, end = (grip.cable_frame.position for grip in self.robot.grips(rows[-1]))
        if np.linalg.norm(end - start) >= self.cable.length:
            return False
        if not all(self.arms.stay_apart(a, b) for a, b in zip(rows, [*rows[1:], rows[-1]], strict=True)):
            return False
        return self.check(rows).valid

    def run(self, seconds: float) -> np.ndarray | None:
        """Waypoints (k, n) from start to goal, shortened; None if none were found in time."""
        setup = og.SimpleSetup(self.space)
        information = setup.getSpaceInformation()
        setup.setStateValidityChecker(lambda state: self.valid(self.joints(state)[None]))
        information.setMotionValidator(Edges(information, self))
        setup.setStartAndGoalStates(self.state(self.start), self.state(self.goal))
        planner = og.RRTConnect(information)
        planner.setRange(REACH)
        setup.setPlanner(planner)
        if not setup.solve(seconds) or not setup.haveExactSolutionPath():
            return None
        path = setup.getSolutionPath()
        simplifier = og.PathSimplifier(information)
        simplifier.reduceVertices(path)
        simplifier.partialShortcutPath(path)
        simplifier.reduceVertices(path)
        return np.array([self.joints(state) for state in path.getStates()])


def begin(seed: int) -> None:
    """Has OMPL say little, and search as it did with this seed before."""
    ou.setLogLevel(ou.LogLevel.LOG_WARN)
    ou.RNG.setSeed(seed)


def timed(robot: Robot, rows: np.ndarray, speed: float = SPEED) -> cs.JointPath:
    """The waypoints with times, at a part of the joints' velocity limits."""
    spans = np.abs(np.diff(rows, axis=0)) / (speed * robot.velocity_limits)
    times = np.concatenate(([0.0], np.cumsum(np.maximum(spans.max(axis=1), 0.01))))
    return cs.JointPath(robot.joint_names, rows, times)


def plan(robot: Robot, *, scene: cs.Scene = SCENE, seed: int = 1, seconds: float = 60.0) -> Plan | None:
    """A path from one place to the other that was checked in one piece; None if none was found within `seconds`.

    Raises
    ------
    RobotError
        If one of the places is out of reach.
    """
    began = perf_counter()
    begin(seed)
    kinematics = DualArmIK(robot)
    places = []
    for place in (FROM, TO):
        found = kinematics.solve(*ends(*place))
        if not found.converged:
            raise cs.RobotError(f"{place} is out of reach: {found.position_error * 1e3:.3g} mm off. Move it nearer.")
        q = robot.home.copy()
        arms = np.array(["finger" not in name for name in robot.joint_names])
        q[arms] = found.q[arms]
        places.append(q)
    search = Search(robot, cable(), scene, *places)
    direct = search.check(np.array(places))
    rows = search.run(seconds)
    if rows is None:
        return None
    path = timed(robot, rows)
    check = cs.check_trajectory(cable(), scene, robot, path)
    if not check.valid:
        return None
    return Plan(path, check, direct, search.edges, perf_counter() - began)
