"""One point of a study as objects: the cable, its surroundings, and where both ends are at every instant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable_file import CableFile
from cable_shape.cable.case_parts import cable_of, end_of, grip_of, pose_of, scene_of
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.planning.paths import EndsPath, GripPath, JointPath, Motion
from cable_shape.planning.study_vary import Axis, varied
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.robots.robot import Robot
from cable_shape.scene.scene import Scene

OPTION_KEYS = ("model", "gravity", "points", "tolerance", "distributed_load")
MOTION_KEYS = ("start", "end", "ends", "joints", "times", "instants")
MOST_INSTANTS = 100_000
_NOWHERE = {"position": (0.0, 0.0, 0.0)}


@final
class Case(NamedTuple):
    """What is asked at one point: m instants.

    held: how each end is held; its pose is that of the cable's frame at the origin. frames: {end: (m, 7)} of the
    cable's frames at the ends that are held. links: where the robot's links are, an entry an instant; None: no robot.
    """

    cable: CableFile | Harness
    scene: Scene
    held: dict[str, Grip | FreeEnd]
    frames: dict[str, Array]
    links: Sequence[Mapping[str, Pose]] | None
    robot: Robot | None
    options: dict[str, Any]

    @property
    def instants(self) -> int:
        """How many there are."""
        return len(next(iter(self.frames.values())))


@final
class Cases:
    """The cases of one study. What no point changes is made once."""

    def __init__(self, values: Mapping[str, Any], axes: Sequence[Axis], folder: Path) -> None:
        self.values, self.axes, self.folder = values, tuple(axes), folder
        self.names = tuple(axis.name for axis in axes)
        self._kept: dict[str, Any] = {}
        self.robot = None if values.get("robot") is None else Robot.from_yaml(folder / str(values["robot"]))

    def told(self, row: Sequence[float]) -> dict[str, Any]:
        """The study's mapping with these values in what varies."""
        return varied(self.values, self.names, [axis.told(x) for axis, x in zip(self.axes, row, strict=True)])

    def at(self, row: Sequence[float]) -> Case:
        """The case with these numbers for what varies.

        Raises
        ------
        ArgumentError
            If there is none: a clip beyond the end of its cable, say.
        """
        values = self.told(row)
        cable = self._part("cable harness", values, self._cable)
        scene = self._part("scene", values, lambda v: scene_of(v.get("scene"), self.folder) or Scene())
        options = {key: values[key] for key in OPTION_KEYS if values.get(key) is not None}
        held, frames, links = self._part("motion start end ends cable.grips harness", values, self._motion)
        if self.robot is not None and self.robot.link_geometry and links is None:
            raise ArgumentError(
                "robot: the motion is none of joints. Write motion: {joints: {names: .., positions: ..}}."
            )
        return Case(cable, scene, held, frames, links, self.robot, options)

    def instants_at(self, row: Sequence[float]) -> int:
        """How many instants there are at a point, or would be if it had a case."""
        motion = self.told(row).get("motion") or {}
        if motion.get("instants") is not None:
            return checks.integer("motion.instants", motion["instants"], at_least=1, at_most=MOST_INSTANTS)
        return self.at(row).instants

    def _part(self, keys: str, values: Mapping[str, Any], make: Any) -> Any:
        """What is made of these keys, once if no point changes them."""
        if any(f"{name}.".startswith(f"{key}.") for name in self.names for key in keys.split()):
            return make(values)
        if keys not in self._kept:
            self._kept[keys] = make(values)
        return self._kept[keys]

    def _cable(self, values: Mapping[str, Any]) -> CableFile | Harness:
        if values.get("harness") is not None:
            given = values["harness"]
            return Harness.from_yaml(self.folder / given) if isinstance(given, str) else Harness.from_mapping(given)
        return cable_of(values["cable"], self.folder)

    def _motion(self, values: Mapping[str, Any]) -> Any:
        """How the ends are held, their frames, and links."""
        motion = checks.mapping("motion", values.get("motion"), MOTION_KEYS, f"Known keys: {', '.join(MOTION_KEYS)}.")
        joints = motion.get("joints")
        cable = self._part("cable harness", values, self._cable)
        if isinstance(cable, Harness):
            held = _ends_of(values, {} if motion.get("ends") is None else motion["ends"])
        else:
            moved = [side for side in ("start", "end") if motion.get(side) is not None or joints is not None]
            held = {side: _held(side, values, side in moved) for side in ("start", "end")}
            for side, known in (("start", cable.start), ("end", cable.end)):
                grip = held[side]
                if isinstance(grip, Grip):
                    told = values[side].get("kind") if isinstance(values.get(side), Mapping) else None
                    held[side] = known.told(told).grip(grip)
        if joints is not None:
            return self._of_joints(joints, motion, held)
        tables = {end: _table(end, motion, grip) for end, grip in held.items() if isinstance(grip, Grip)}
        rows = max(len(table) for table in tables.values())
        tables = {end: np.repeat(table, rows, axis=0) if len(table) == 1 else table for end, table in tables.items()}
        path = EndsPath(tables, motion.get("times"))
        places = _places(motion, path.times, rows)
        motion_of_ends = Motion(path, None)
        grips: Any = [motion_of_ends.at(place)[0] for place in places.tolist()]
        frames = {}
        for i, end in enumerate(tables):
            grip = held[end]
            assert isinstance(grip, Grip)
            frames[end] = np.array([grip.at(poses[i]).cable_frame.array for poses in grips])
        return _at_origin(held), frames, None

    def _of_joints(self, joints: Any, motion: Mapping[str, Any], held: dict[str, Grip | FreeEnd]) -> Any:
        """The same where a robot moves the ends."""
        if self.robot is None:
            raise ArgumentError("motion.joints: whose joints? Add the key robot with the path of a robot's YAML file.")
        if set(held) != {"start", "end"}:
            raise ArgumentError("motion.joints: a harness is moved by motion.ends. Write {'a.start': [poses]}.")
        checks.known_keys("motion.joints", joints, ("names", "positions"))
        path = JointPath(joints.get("names", ()), joints.get("positions", ()), motion.get("times"))
        moved = Motion(path, self.robot)
        both = [moved.at(place) for place in _places(motion, path.times, moved.waypoints).tolist()]
        frames = {}
        for i, side in enumerate(("start", "end")):
            grips = [at[0][i] for at in both]
            frames[side] = np.array([g.cable_frame.array if isinstance(g, Grip) else g.array for g in grips])
            if isinstance(grips[0], Grip):
                held[side] = grips[0]
        return _at_origin(held), frames, [at[1] for at in both]


def _held(side: str, values: Mapping[str, Any], moved: bool) -> Grip | FreeEnd:
    """How an end is held; where it moves its position is told by the motion."""
    told = values.get(side)
    if moved and (told is None or (isinstance(told, Mapping) and "position" not in told)):
        told = {**_NOWHERE, **(told or {})}
    if told is None and side == "start":
        raise ArgumentError("start is missing. Write start: {position: [x, y, z], quaternion: [x, y, z, w]}.")
    return grip_of(side, told) if side == "start" else end_of(side, told)


def _ends_of(values: Mapping[str, Any], moved: Mapping[str, Any]) -> dict[str, Grip | FreeEnd]:
    """How the ends of a harness are held."""
    given = values.get("ends") or {}
    if not isinstance(given, Mapping):
        raise ArgumentError.of("ends", given, "it must be a mapping", "Write {'a.start': {position: ..}, ..}.")
    out = {}
    for end in (*given, *(end for end in moved if end not in given)):
        told = given.get(end)
        if end in moved and (told is None or "position" not in told):
            told = {**_NOWHERE, **(told or {})}
        out[end] = end_of(end, told)
    return out


def _table(end: str, motion: Mapping[str, Any], grip: Grip) -> Array:
    """(k, 7): waypoints of an end's pose, one if it stays."""
    poses = (motion.get("ends") or {}).get(end) if "." in end else motion.get(end)
    if poses is None:
        return grip.pose.array[None].copy()
    if isinstance(poses, np.ndarray):
        return poses
    if not isinstance(poses, Iterable) or isinstance(poses, (str, Mapping)) or not len(list(poses)):
        raise ArgumentError.of(f"motion.{end}", poses, "it must be a list of poses", "Write [{position: ..}, ..].")
    return np.array([pose_of(f"motion.{end}[{i}]", pose).array for i, pose in enumerate(poses)])


def _places(motion: Mapping[str, Any], times: Array | None, waypoints: int) -> Array:
    """(m,), of the instants, between 0 and waypoints - 1; even in time where times are told."""
    count = motion.get("instants")
    if count is None:
        return np.arange(float(waypoints))
    count = checks.integer("motion.instants", count, at_least=1, at_most=MOST_INSTANTS)
    if times is None:
        return np.linspace(0.0, waypoints - 1.0, count)
    return np.asarray(np.interp(np.linspace(times[0], times[-1], count), times, np.arange(float(waypoints))))


def _at_origin(held: Mapping[str, Grip | FreeEnd]) -> dict[str, Grip | FreeEnd]:
    """The same, each grip's cable frame at the origin."""
    return {
        end: Grip(Pose(), grip.kind, curvature=grip.curvature) if isinstance(grip, Grip) else grip
        for end, grip in held.items()
    }


def motion_of(path: GripPath | EndsPath) -> dict[str, Any]:
    """The key `motion` that says what a path does."""
    times = {} if path.times is None else {"times": path.times.tolist()}
    if isinstance(path, GripPath):
        return {"start": path.starts, "end": path.ends, **times}
    return {"ends": dict(zip(path.held, path.tables, strict=True)), **times}
