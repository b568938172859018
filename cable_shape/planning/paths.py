"""Motions of the grips through waypoints: :class:`JointPath`, :class:`GripPath`, :class:`EndsPath`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.pose import FreeEnd, Grip, Pose, between
from cable_shape.prediction.edits import EDITS, Edit
from cable_shape.robots.robot import Robot

MOST_WAYPOINTS = 100_000


@final
class JointPath:
    """Waypoints of a robot's joints, linear in the joints between them.

    Parameters
    ----------
    joint_names : sequence of str
    positions : (k, j) array_like
        [rad] or [m], a row a waypoint in the order of the names.
    times : (k,) array_like, optional
        [s], rising.
    """

    def __init__(self, joint_names: Sequence[str], positions: ArrayLike, times: ArrayLike | None = None) -> None:
        self.joint_names = checks.entries("joint_names", joint_names, str, "Give a list of names.")
        self.positions = _waypoints("positions", positions, len(self.joint_names))
        self.times = _times(times, len(self.positions))

    @classmethod
    def from_message(cls, message: Any) -> JointPath:
        """From a ``trajectory_msgs/JointTrajectory``, or what has its fields."""
        missing = [name for name in ("joint_names", "points") if not hasattr(message, name)]
        if missing:
            bound = "it must be a JointPath, a GripPath or a trajectory_msgs/JointTrajectory"
            raise ArgumentError.of("trajectory", message, bound, "Write GripPath(starts, ends).")
        points = message.points
        spans = [point.time_from_start for point in points]
        times = [span.sec + 1e-9 * span.nanosec for span in spans]
        lengths = {len(point.positions) for point in points}
        if lengths - {len(message.joint_names)}:
            raise ArgumentError(
                f"trajectory.points have {sorted(lengths)} positions for {len(message.joint_names)} joint_names. "
                "Give every point one position for every joint."
            )
        rows = np.array([list(point.positions) for point in points]).reshape(len(points), len(message.joint_names))
        return cls(message.joint_names, rows, times if any(times) else None)


@final
class GripPath:
    """Waypoints of the cable's two clamped ends: between them positions are linear, frames turn the shortest way.

    Parameters
    ----------
    starts, ends : (k, 7) array_like
        Position [m] and quaternion x y z w of the cable frame at each end, in the world.
    times : (k,) array_like, optional
        [s], rising.
    """

    def __init__(self, starts: ArrayLike, ends: ArrayLike, times: ArrayLike | None = None) -> None:
        self.tables = _poses({"starts": starts, "ends": ends})
        self.starts, self.ends = self.tables
        self.times = _times(times, len(self.starts))


@final
class EndsPath:
    """Waypoints of the clamped ends of a harness: between them positions are linear, frames turn the shortest way.

    Parameters
    ----------
    ends : mapping of end to (k, 7) array_like, or to FreeEnd or None
        Position [m] and quaternion x y z w of the cable frame at each held end, in the world; ends that are not named
        are free.
    times : (k,) array_like, optional
        [s], rising.
    """

    def __init__(self, ends: Mapping[str, ArrayLike | FreeEnd | None], times: ArrayLike | None = None) -> None:
        remedy = "Write {'a.start': table of (k, 7), ...}."
        checks.instance("ends", ends, (Mapping,), remedy)
        self.free = {end: held for end, held in ends.items() if isinstance(held, FreeEnd)}
        given: Any = {end: held for end, held in ends.items() if held is not None and end not in self.free}
        if not given:
            raise ArgumentError.of("ends", list(ends), "no end is held", remedy)
        self.tables, self.held = _poses(given), tuple(given)
        self.times = _times(times, len(self.tables[0]))


Path = JointPath | GripPath


@final
class Routing(NamedTuple):
    """Paths one after the other, as one, and what is changed before its waypoints: an edit has no place of its own.

    edits: by the waypoint that comes next; the number of waypoints for those after the last one.
    """

    path: Path
    edits: Mapping[int, tuple[Edit, ...]]

    @classmethod
    def of(cls, parts: Sequence[Any]) -> Routing:
        """Of paths of one kind, with edits between and after them."""
        remedy = "Write [path, Insert(clip), path, ...], the first one a path."
        paths: list[Path] = []
        edits: dict[int, tuple[Edit, ...]] = {}
        done = 0
        for i, part in enumerate(parts):
            if isinstance(part, EDITS):
                if not paths:
                    raise ArgumentError.of(f"trajectory[{i}]", part, "there is no shape yet to be edited", remedy)
                edits[done] = (*edits.get(done, ()), part)
                continue
            path = part if isinstance(part, (JointPath, GripPath)) else JointPath.from_message(part)
            if paths and type(path) is not type(paths[0]):
                bound = f"the first path is a {type(paths[0]).__name__}"
                raise ArgumentError.of(f"trajectory[{i}]", part, bound, "Give paths of one kind.")
            edits.setdefault(done, ())
            paths.append(path)
            done += len(path.starts if isinstance(path, GripPath) else path.positions)
        if not paths:
            raise ArgumentError.of("trajectory", list(parts), "it holds no path", remedy)
        edits.pop(0)
        return cls(_joined(paths, remedy), edits)


def _joined(paths: Sequence[Path], remedy: str) -> Path:
    """One path through the waypoints of all; the times of each go on from the end of the one before."""
    times = None
    given = [path.times for path in paths]
    if all(one is not None for one in given):
        told: list[Array] = []
        for one in given:
            assert one is not None
            told.append(one if not told else one - one[0] + told[-1][-1])
        times = np.concatenate(told)
    first = paths[0]
    whole: Path
    if isinstance(first, JointPath):
        rows = []
        for path in paths:
            assert isinstance(path, JointPath)
            if sorted(path.joint_names) != sorted(first.joint_names):
                bound = f"the first path has {list(first.joint_names)}"
                raise ArgumentError.of("joint_names", list(path.joint_names), bound, remedy)
            rows.append(path.positions[:, [path.joint_names.index(name) for name in first.joint_names]])
        whole = JointPath(first.joint_names, np.concatenate(rows))
    else:
        grips = [path.tables for path in paths if isinstance(path, GripPath)]
        whole = GripPath(*(np.concatenate(tables) for tables in zip(*grips, strict=True)))
    whole.times = times
    return whole


@final
class Motion:
    """A path with the robot that follows it: where the grips and links are at any place between the waypoints.

    A place is a number from 0 to k - 1, whole at the waypoints.
    """

    def __init__(self, path: Path | EndsPath, robot: Robot | None) -> None:
        self.times = path.times
        self.robot: Robot | None = None
        self.reach = 0.0  # m, no tool of the robot is further from a joint that moves it
        self._tables: tuple[Array, ...] | None = None
        if isinstance(path, (GripPath, EndsPath)):
            self._tables, self.waypoints = path.tables, len(path.tables[0])
            self.joints: Array = np.empty((self.waypoints, 0))
            return
        if robot is None:
            raise ArgumentError("robot = None is not allowed: the trajectory is one of joints. Give the Robot.")
        for name in path.joint_names:
            if name not in robot.single_joints:
                raise UnknownKeyError.among("trajectory.joint_names", name, robot.single_joints)
        self.robot, self.waypoints, self.reach = robot, len(path.positions), robot.reach
        self.joints = np.array([robot.positions(path.joint_names, row) for row in path.positions])
        self._turns = np.abs(np.diff(self.joints, axis=0)).sum(axis=1).tolist()  # [rad, m], of all joints, a segment

    def at(self, place: float) -> tuple[tuple[Pose | Grip, ...], Mapping[str, Pose] | None]:
        """The grips, of a cable start and end, and links; None: they are not known."""
        if self._tables is not None:
            i, j, x = self._segment(place)
            return tuple(Pose.trusted(between(poses[i], poses[j], x)) for poses in self._tables), None
        assert self.robot is not None
        grips = self.robot.grips(self.joint_positions(place))
        return grips, self.robot.link_poses()

    def joint_positions(self, place: float) -> Array:
        """(n,) [rad] or [m], in the order of the robot's `joint_names`."""
        return self.between(self.joints, place)

    def between(self, rows: Array, place: float) -> Array:
        """Of an array with a row (...) a waypoint the row there, linear between waypoints."""
        i, j, x = self._segment(place)
        return np.asarray(rows[i] if x == 0.0 else (1.0 - x) * rows[i] + x * rows[j])

    def _segment(self, place: float) -> tuple[int, int, float]:
        """The waypoints before and after a place, and how far it is from one to the other, 0 to 1."""
        i = max(min(int(place), self.waypoints - 2), 0)
        return i, min(i + 1, self.waypoints - 1), place - i

    def turned(self, a: float, b: float) -> float:
        """[rad, m], sum of what the joints move between two places of one segment."""
        if self.robot is None or self.waypoints < 2:
            return 0.0
        turns: float = self._turns[self._segment(a)[0]]
        return (b - a) * turns


def _waypoints(name: str, value: ArrayLike, width: int) -> Array:
    """A finite table (k, width) as a new array."""
    table = checks.numbers(name, value, "Give a row a waypoint.")
    if table.ndim != 2 or table.shape[1] != width:
        bound = f"it must have shape (k, {width})"
        raise ArgumentError.of(name, f"array of shape {table.shape}", bound, "Give a row a waypoint.")
    if not 0 < len(table) <= MOST_WAYPOINTS:
        bound = f"1 to {MOST_WAYPOINTS} are allowed"
        raise ArgumentError.of(name, f"{len(table)} waypoints", bound, "Split the trajectory, or give a waypoint.")
    bad = np.flatnonzero(~(np.abs(table) <= checks.MOST).all(axis=1))
    if bad.size:
        row = int(bad[0])
        bound = f"it must be finite, at most {checks.MOST:g}"
        raise ArgumentError.of(f"{name}[{row}]", table[row].tolist(), bound, "Correct the waypoint.")
    return table


def _poses(given: Mapping[str, ArrayLike]) -> tuple[Array, ...]:
    """Tables (k, 7) of as many waypoints each, their quaternions normalised, the shortest way from one to the next."""
    tables = {name: _waypoints(name, value, 7) for name, value in given.items()}
    first = next(iter(tables))
    for name, poses in tables.items():
        if len(poses) != len(tables[first]):
            bound = f"{first} has {len(tables[first])}"
            raise ArgumentError.of(name, f"{len(poses)} waypoints", bound, "Give as many of both.")
        for i, row in enumerate(poses):
            row[3:] = checks.quaternion(f"{name}[{i}]", row[3:])
            if i > 0 and float(row[3:] @ poses[i - 1, 3:]) < 0.0:
                row[3:] *= -1.0
    return tuple(tables.values())


def _times(value: ArrayLike | None, count: int) -> Array | None:
    """Rising times (k,) [s]."""
    if value is None:
        return None
    times = checks.vector("times", value, count, "s")
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if back.size:
        i = int(back[0]) + 1
        raise ArgumentError.of(
            f"times[{i}]", float(times[i]), f"it must be later than the one before, {times[i - 1]:g} s", "Sort them."
        )
    return times
