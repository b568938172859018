"""A worked routing task: two arms take a cable from a table, hook it round a post, lay it in a channel, clip it down.

The task is a list of paths and edits. RRT-Connect carries the cable over the post, touching nothing, as `plan_cable`
does; mink follows straight ways of the hands where the cable is in contact; what the hands do to it
between (pressing it into a clip, letting some of it through a hand) are edits. What counts is one call at the end:
`check_trajectory` takes the whole list, from the table to the last clip, the robot's links among the bodies.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from plan_cable import TABLE, Arms, Search, begin, timed
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.robots.ik import DualArmIK
from cable_shape.robots.robot import Robot

#: x, y, z [m] of a hand and the angle [rad] by which the cable leaves it forwards, from straight to the other hand
Hand = tuple[float, float, float, float]

CABLE = cs.Cable(
    length=0.95,
    linear_density=0.08,
    bending_stiffness=0.008,
    twisting_stiffness=0.006,
    diameter=0.008,
    min_bend_radius=0.03,
    max_tension=40.0,
    tails={"end": 0.1},
)
POST = cs.Obstacle("post", cs.Capsule(0.02, 0.12), cs.Pose((0.62, 0.03, 0.06)))
#: the channel: its middle [m], how it is turned about z [rad], how wide between its walls, how long, how deep [m]
MIDDLE, TURN, WIDE, LONG, DEEP = np.array((0.514, -0.283)), -0.741, 0.022, 0.08, 0.012
WALL = 0.012  # m, thickness
HARDEST = 10.0  # N, with which anything may press on the cable
CLIPS = (
    cs.Clip(0.23, cs.Pose((0.545, 0.215, 0.010)), "ball", name="left_clip"),
    cs.Clip(0.84, cs.Pose((0.482, -0.318, 0.012)), "ball", name="right_clip"),
)
THROUGH = 0.96  # m, arc length that the right hand holds once it has let some of the cable through
SPEED = 0.1  # of the joints' velocity limits: what lies in contact is moved slowly
STEP = 0.01  # m, of the hands, between waypoints of a straight way


def wall(name: str, side: float) -> cs.Obstacle:
    """One of the channel's walls."""
    across = side * 0.5 * (WIDE + WALL) * np.array((np.cos(TURN), np.sin(TURN)))
    pose = cs.Pose((*(MIDDLE + across), 0.5 * DEEP), Rotation.from_rotvec((0.0, 0.0, TURN)).as_quat())
    return cs.Obstacle(name, cs.Box((WALL, LONG, DEEP)), pose)


BODIES = (TABLE, POST, wall("near_wall", -1.0), wall("far_wall", 1.0))
SCENE = cs.Scene(
    obstacles=BODIES,
    contact="solve",
    allow=[cs.Allow(body.name, max_force=HARDEST) for body in BODIES],
    warn_distance=0.01,
    error_distance=0.005,
)


class Task(NamedTuple):
    """What was planned, and what it took."""

    parts: list[Any]  # paths and edits
    check: cs.TrajectoryCheck  # of all of it
    edges: int  # that the search looked at
    seconds: float


def both(x: float, y: float, z: float, turn: float) -> tuple[Hand, Hand]:
    """Both hands alike, on both sides of the middle."""
    return (x, y, z, turn), (x, -y, z, turn)


#: the cable lies on the table in a bow; it is lifted; carried; let down behind the post; drawn round it
TAKE, LIFTED = both(0.30, 0.40, 0.05, 0.5), both(0.30, 0.38, 0.30, 0.4)
BEHIND, DOWN, HOOKED = both(0.72, 0.38, 0.30, 0.4), both(0.72, 0.38, 0.12, 0.4), both(0.46, 0.40, 0.10, 0.5)
LEFT = (0.45, 0.395, 0.04, 0.5)  # by the left clip
#: the right hand draws the cable taut, along the channel, and lays it in
TAUT = [LEFT, (0.47, -0.34, 0.08, 0.5)], [LEFT, (0.46, -0.37, 0.12, 0.5)], [LEFT, (0.418, -0.408, 0.12, 0.5)]
LAID = LEFT, (0.418, -0.408, 0.03, 0.5)


def ends(hands: Sequence[Hand]) -> tuple[cs.Pose, cs.Pose]:
    """The cable's end frames: d3 along -y, turned forwards at the start, back at the end."""
    level = Rotation.from_quat((0.5**0.5, 0.0, 0.0, 0.5**0.5))
    (*start, left), (*end, right) = hands
    return (
        cs.Pose(start, (Rotation.from_rotvec((0.0, 0.0, left)) * level).as_quat()),
        cs.Pose(end, (Rotation.from_rotvec((0.0, 0.0, -right)) * level).as_quat()),
    )


class Hands:
    """Joint positions for places of both hands, one near the other."""

    def __init__(self, robot: Robot) -> None:
        self._kinematics, self._robot = DualArmIK(robot), robot
        self._arms = np.array(["finger" not in name for name in robot.joint_names])

    def at(self, hands: Sequence[Hand], near: np.ndarray) -> np.ndarray:
        """At one place; the fingers stay as they are."""
        found = self._kinematics.solve(*ends(hands), near)
        if not found.converged:
            raise cs.RobotError(f"{hands} is out of reach: {found.position_error * 1e3:.3g} mm off. Move it nearer.")
        return np.where(self._arms, found.q, near)

    def straight(self, places: Sequence[Sequence[Hand]], q: np.ndarray) -> np.ndarray:
        """(k, n), through these places in straight lines, from joint positions at the first of them."""
        rows = [q]
        for before, after in itertools.pairwise(places):
            a, b = np.array(before), np.array(after)
            steps = int(np.ceil(np.abs(b - a)[:, :3].max() / STEP))
            for x in np.linspace(0.0, 1.0, steps + 1)[1:]:
                way: Any = (a + x * (b - a)).tolist()
                rows.append(self.at(way, rows[-1]))
        return np.array(rows)


def plan(robot: Robot, *, seed: int = 1, seconds: float = 60.0) -> Task | None:
    """The task, checked in one piece; None if no way over the post was found within `seconds`.

    Raises
    ------
    RobotError
        If a place is out of reach, or the arms would touch something.
    """
    began = perf_counter()
    begin(seed)
    hands = Hands(robot)
    taken = hands.at(TAKE, robot.home)
    take = hands.straight([TAKE, LIFTED], taken)
    free = SCENE.replace(contact="warn", allow=())
    search = Search(robot, CABLE, free, take[-1], hands.at(BEHIND, take[-1]))
    carry = search.run(seconds)
    if carry is None:
        return None
    hook = hands.straight([BEHIND, DOWN, HOOKED, TAUT[0]], carry[-1])
    lay = hands.straight([*TAUT, LAID], hook[-1])
    arms = Arms(robot, SCENE)
    for rows in (take, hook, lay):
        if not all(arms.stay_apart(a, b) for a, b in itertools.pairwise(rows)):
            raise cs.RobotError("the arms would touch something on a straight way. Move it away from there.")
    stay = lay[-1:]
    parts = [
        timed(robot, np.concatenate((take, carry[1:], hook[1:])), SPEED),
        cs.Insert(CLIPS[0]),
        timed(robot, lay, SPEED),
        cs.Regrip("end", THROUGH),
        timed(robot, stay, SPEED),
        cs.Insert(CLIPS[1]),
        timed(robot, stay, SPEED),
    ]
    check = cs.check_trajectory(CABLE, SCENE, robot, parts)
    return Task(parts, check, search.edges, perf_counter() - began)
