"""The robot that holds the cable: joint positions -> grips and places of the links, through Pinocchio."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape import checks
from cable_shape.cable.cable_file import AS_GIVEN, Held
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, CableShapeError, InputError, RobotError
from cable_shape.files.yaml_files import load_yaml
from cable_shape.pose import GRIP_KINDS, IDENTITY, Grip, Pose
from cable_shape.robots.on_links import no_such
from cable_shape.robots.robot_files import (
    build,
    leader_of,
    load_pinocchio,
    longest_chain,
    mimics_of,
    obstacles_of,
    read_urdf,
)
from cable_shape.scene.scene import Obstacle

#: the two grippers: left holds the cable's start, right its end
SIDES = ("left", "right")
_MAX_REMEMBERED_NAME_LISTS = 16


@final
@dataclass(frozen=True, slots=True)
class Gripper:
    """How one gripper of the robot holds its end of the cable.

    frame: the tool frame, a link of the URDF.
    offset: the cable frame in the tool frame (d3 = tangent from start to end, at both ends).
    kind: "clamped", "swivel" or "pinned".
    gripping_links: links that touch the cable on purpose.
    """

    frame: str
    offset: Pose = IDENTITY
    kind: str = "clamped"
    gripping_links: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        checks.one_of("kind", self.kind, GRIP_KINDS)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str) -> Gripper:
        """From a mapping with the keys frame, offset (position, quaternion), kind and gripping_links."""
        checks.known_keys(where, values, ("frame", "offset", "kind", "gripping_links"))
        if "frame" not in values:
            raise ArgumentError(f"{where}: the key 'frame' is missing. Name the tool frame, a link of the URDF.")
        offset = values.get("offset", {})
        checks.known_keys(f"{where}: offset", offset, ("position", "quaternion"))
        links = values.get("gripping_links", ())
        if isinstance(links, str) or not isinstance(links, Sequence):
            raise ArgumentError.of(f"{where}: gripping_links", links, "it must be a list of links", "Write [a, b].")
        try:
            return cls(
                str(values["frame"]), Pose(**offset), values.get("kind", "clamped"), tuple(str(link) for link in links)
            )
        except ArgumentError as error:
            raise type(error)(f"{where}: {error}") from None


@final
class Robot:
    """A robot with two grippers: from any URDF, joint positions to grips, link places and link geometry.

    Not safe to share between threads: `update` moves it and the other methods read where it is.

    Parameters
    ----------
    urdf : path or str
        A file, or the XML itself. Meshes by ``package://`` are found through AMENT_PREFIX_PATH and above the URDF.
    grippers : mapping of "left" and "right" to Gripper
        Left holds the start of the cable, right its end.
    home : mapping of joint name to position, optional
        [rad] or [m]: where the robot stands at first, and joints that a joint state leaves out. Default 0, or the
        nearest position within the limits.

    Attributes
    ----------
    joint_names : tuple of str
        One a degree of freedom, in the order of all arrays of joint positions; joints that mimic another have none.
    single_joints : tuple of str
        All joints of one degree of freedom, those that mimic another included; `leading` (n,) says where those of
        `joint_names` stand among them.
    lower, upper, velocity_limits : (n,) arrays
        [rad] or [m], and per second; infinite where the URDF has no limit.
    link_geometry : tuple of Obstacle
        Collision geometry, each with its `link` and its pose in that link's frame.
    gripping_links : tuple of str

    Raises
    ------
    RobotError
        If the URDF is malformed or lacks a frame, link or joint that is named.
    DependencyError
        If Pinocchio is missing or is not the one that belongs here.
    """

    def __init__(
        self, urdf: str | Path, grippers: Mapping[str, Gripper], home: Mapping[str, float] | None = None
    ) -> None:
        checks.known_keys("grippers", grippers, SIDES)
        if len(grippers) != len(SIDES):
            raise ArgumentError.of("grippers", sorted(grippers), "left and right must both be given", "Add the other.")
        pin = load_pinocchio()
        self.urdf = read_urdf(urdf)  # self-contained text
        self.grippers = {side: grippers[side] for side in SIDES}
        self._model, geometry = build(pin, self.urdf)
        self._forward = (pin.forwardKinematics, pin.updateFramePlacements)
        self._seven = pin.SE3ToXYZQUAT
        self._configuration: Array = np.array(pin.neutral(self._model))
        self._read_joints(home or {})
        self.link_geometry: tuple[Obstacle, ...] = obstacles_of(pin, self._model, geometry)
        self._links: tuple[str, ...] = ()  # all of them, those with geometry first
        self._find_grippers(pin)
        self._permutations: dict[tuple[str, ...], tuple[NDArray[np.intp], NDArray[np.intp]]] = {}
        self.update(self.home)

    @classmethod
    def from_yaml(cls, path: str | Path) -> Robot:
        """From a YAML file with the keys urdf (relative to the file), grippers and home."""
        values = load_yaml(path)
        checks.known_keys(str(path), values, ("urdf", "grippers", "home"))
        for key in ("urdf", "grippers"):
            if key not in values:
                raise ArgumentError(f"{path}: the key {key!r} is missing. Add it.")
        checks.known_keys(f"{path}: grippers", values["grippers"], SIDES)
        grippers = {
            side: Gripper.from_mapping(given, f"{path}: grippers.{side}") for side, given in values["grippers"].items()
        }
        urdf = Path(path).expanduser().parent / str(values["urdf"])
        try:
            return cls(urdf, grippers, values.get("home"))
        except CableShapeError as error:
            raise type(error)(f"{path}: {error}") from None

    def holding(self, start: Held, end: Held) -> Robot:
        """The same robot at home, its grippers holding the cable as its file knows (:class:`cable_shape.CableFile`)."""
        if start == end == AS_GIVEN:
            return self
        held = zip(self.grippers.items(), (start, end), strict=True)
        grips = {side: known.grip(Grip(IDENTITY, old.kind, old.offset)) for (side, old), known in held}
        grippers = {
            side: replace(self.grippers[side], kind=grip.kind, offset=grip.offset) for side, grip in grips.items()
        }
        return Robot(self.urdf, grippers, dict(zip(self.joint_names, self.home.tolist(), strict=True)))

    def _read_joints(self, home: Mapping[str, float]) -> None:
        """Which joints move, their limits, those that mimic others, and the home position."""
        model = self._model
        mimics = mimics_of(self.urdf)
        axes = [j for j in range(1, model.njoints) if model.joints[j].nv == 1]
        self.single_joints = tuple(model.names[j] for j in axes)
        self._row = {name: row for row, name in enumerate(self.single_joints)}
        self.joint_names = tuple(model.names[j] for j in axes if model.names[j] not in mimics)
        column = {name: i for i, name in enumerate(self.joint_names)}
        # all single joints = spread @ q + shift: a joint that mimics follows its leader
        self._spread, self._shift = np.zeros((len(axes), len(column))), np.zeros(len(axes))
        for name, row in self._row.items():
            leader, multiplier, constant = leader_of(name, mimics)
            if leader not in column:
                raise RobotError(f"Joint {name!r} mimics {leader!r}, which is no joint that moves. Correct the URDF.")
            self._spread[row, column[leader]], self._shift[row] = multiplier, constant
        self.leading = np.array([self._row[name] for name in self.joint_names], dtype=np.intp)
        joints = [model.joints[j] for j in axes]
        single = np.array([joint.nq == 1 for joint in joints], dtype=bool)
        place = np.array([joint.idx_q for joint in joints], dtype=np.intp)
        self._single, self._place = single, place[single]
        # a continuous joint is stored as (cos, sin)
        self._continuous = np.flatnonzero(~single)
        self._circle = place[~single]
        self._set_limits(single, place, axes)
        self.home = np.clip(np.zeros(len(column)), self.lower, self.upper)
        for name, value in home.items():
            if name not in column:
                raise RobotError(f"home: {no_such('joint', name, column)}")
            self.home[column[name]] = checks.number(f"home.{name}", value)
        self.home.flags.writeable = False

    def _set_limits(self, single: NDArray[np.bool_], place: NDArray[np.intp], axes: list[int]) -> None:
        """Limits of the joints in `joint_names`."""
        model = self._model
        rows = self.leading
        low = np.where(single, np.array(model.lowerPositionLimit)[place], -math.inf)[rows]
        high = np.where(single, np.array(model.upperPositionLimit)[place], math.inf)[rows]
        speed = np.array([model.upperVelocityLimit[model.joints[j].idx_v] for j in axes])[rows]
        limited = low < high  # the parser fills in 0, 0 where the URDF has none
        self.lower, self.upper = np.where(limited, low, -math.inf), np.where(limited, high, math.inf)
        self.velocity_limits = np.where(speed > 0.0, speed, math.inf)

    def _find_grippers(self, pin: Any) -> None:
        """Frames of the tools, of the cable at them and of the links; the joints that the tools hang on."""
        model = self._model
        bodies = {f.name: i for i, f in enumerate(model.frames) if f.type == pin.FrameType.BODY}
        needed: set[str] = set()
        frames: list[Any] = [None] * (2 * len(SIDES))
        for i, (side, gripper) in enumerate(self.grippers.items()):
            for link in (gripper.frame, *gripper.gripping_links):
                if link not in bodies:
                    raise RobotError(f"{side} gripper: {no_such('link', link, bodies)}")
            tool = model.frames[bodies[gripper.frame]]
            for joint in list(model.supports[tool.parentJoint])[1:]:
                needed.add(self._leader_of(model.names[joint], side))
            placed = tool.placement * pin.XYZQUATToSE3(gripper.offset.array)
            added = pin.Frame(f"{gripper.frame}/cable", tool.parentJoint, placed, pin.FrameType.OP_FRAME)
            frames[i] = bodies[gripper.frame]
            frames[i + len(SIDES)] = model.addFrame(added, False)
        self.gripping_links = tuple(
            dict.fromkeys(link for gripper in self.grippers.values() for link in gripper.gripping_links)
        )
        self._needed = np.array([name in needed for name in self.joint_names], dtype=bool)
        self._grips = tuple(Grip(Pose(), gripper.kind, gripper.offset) for gripper in self.grippers.values())
        self._data = model.createData()
        placements = self._data.oMf  # entries are references: they follow every update
        self._gripper_placements = [placements[i] for i in frames]
        solid = [obstacle.link or "" for obstacle in self.link_geometry]
        self._links = tuple(dict.fromkeys((*solid, *bodies)))
        self._link_placements = [placements[bodies[link]] for link in self._links]

    def _leader_of(self, joint: str, side: str) -> str:
        """The name in `joint_names` that moves `joint`."""
        if joint not in self._row:
            raise RobotError(
                f"{side} gripper: it hangs on joint {joint!r}, which has more than one degree of freedom. "
                "A joint state cannot move it: use a fixed, revolute, continuous or prismatic joint."
            )
        leader = int(np.argmax(np.abs(self._spread[self._row[joint]])))
        return str(self.joint_names[leader])

    def positions(self, names: Sequence[str], values: ArrayLike) -> Array:
        """The joint positions (n,) [rad] or [m] in the order of `joint_names`, from a joint state.

        Names that the robot does not have are passed over, since `/joint_states` often carries several robots. Joints
        that no gripper hangs on (fingers) may be missing and stand at home.

        Raises
        ------
        InputError
            If a joint that a gripper hangs on is missing, a name occurs twice, a value is not finite, or there are not
            as many values as names.
        """
        key = tuple(names)
        remembered = self._permutations.get(key)
        order, missing = self._permutation(key) if remembered is None else remembered
        given: Array = np.asarray(values, dtype=np.float64)
        if given.shape != (len(key),):
            raise InputError(
                f"joint state: {given.size} positions for {len(key)} names. Publish one position for every name."
            )
        # the last entry stands for "not given"
        q: Array = np.concatenate((given, (0.0,)))[order]
        if missing.size:
            q[missing] = self.home[missing]
        if not np.isfinite(q).all():
            bad = int(np.flatnonzero(~np.isfinite(q))[0])
            raise InputError(
                f"joint state: position of {self.joint_names[bad]!r} is {q[bad]}, it must be finite. "
                "Check the driver that publishes it."
            )
        return q

    def _permutation(self, names: tuple[str, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Where every joint stands in `names`, len(names) if it does not, and which do not; remembered."""
        index = {name: i for i, name in enumerate(names)}
        if len(index) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise InputError(f"joint state: {', '.join(twice)} named more than once. Publish every joint once.")
        order = np.array([index.get(name, len(names)) for name in self.joint_names], dtype=np.intp)
        absent = np.flatnonzero(order == len(names))
        missing = [self.joint_names[i] for i in absent if self._needed[i]]
        if missing:
            raise InputError(
                f"joint state: {', '.join(missing)} missing; the grippers hang on them. Given: "
                f"{', '.join(names) or 'none'}. Publish both arms in one message (joint_state_publisher merges them)."
            )
        if len(self._permutations) >= _MAX_REMEMBERED_NAME_LISTS:
            self._permutations.clear()
        self._permutations[names] = (order, absent)
        return order, absent

    def update(self, q: ArrayLike) -> None:
        """Moves the robot to the joint positions `q` (n,) [rad] or [m], in the order of `joint_names`."""
        given: Array = np.asarray(q, dtype=np.float64)
        if given.shape != (len(self.joint_names),):
            bound = f"it must have shape ({len(self.joint_names)},)"
            raise ArgumentError.of("q", f"array of shape {given.shape}", bound, "See joint_names.")
        if not np.isfinite(given).all():
            raise ArgumentError.of("q", given.tolist(), "every entry must be finite", "Check where it comes from.")
        every = self.single_positions(given)
        configuration = self._configuration
        configuration[self._place] = every[self._single]
        if self._continuous.size:
            angle = every[self._continuous]
            configuration[self._circle], configuration[self._circle + 1] = np.cos(angle), np.sin(angle)
        forward, update_frames = self._forward
        forward(self._model, self._data, configuration)
        update_frames(self._model, self._data)

    def single_positions(self, q: Array) -> Array:
        """Positions (m,) of all `single_joints` for the joint positions `q` (n,); mimicking joints follow."""
        every: Array = self._spread @ q + self._shift
        return every

    @property
    def carrying(self) -> NDArray[np.bool_]:
        """(n,), which joints the grippers hang on: those of the arms, not of the fingers."""
        return self._needed

    @property
    def reach(self) -> float:
        """[m], no origin of a link is further from a joint that moves it: the longest chain, stretched out."""
        travel = {}
        for name, row in self._row.items():
            leader = int(np.argmax(np.abs(self._spread[row])))
            far = float(np.abs((self.lower[leader], self.upper[leader])).max())
            travel[name] = abs(float(self._spread[row, leader])) * far + abs(float(self._shift[row]))
        return longest_chain(self._model, travel)

    def gripper_poses(self) -> dict[str, Pose]:
        """The tool frames "left" and "right" in the world, at the last update."""
        return dict(zip(SIDES, self._poses(self._gripper_placements[: len(SIDES)]), strict=True))

    def grips(self, q: ArrayLike | None = None) -> tuple[Grip, Grip]:
        """The grips of the cable's start (left) and end (right), after an update to `q` if it is given."""
        if q is not None:
            self.update(q)
        left, right, left_cable, right_cable = self._poses(self._gripper_placements)
        start, end = self._grips
        return start.at(left, left_cable), end.at(right, right_cable)

    def link_poses(self) -> dict[str, Pose]:
        """The frames of all links in the world, at the last update; those with collision geometry come first."""
        return dict(zip(self._links, self._poses(self._link_placements), strict=True))

    def _poses(self, placements: list[Any]) -> list[Pose]:
        """Pinocchio's placements as poses."""
        rows: list[Array] = list(map(self._seven, placements))
        for row in rows:
            row.setflags(write=False)
        return list(map(Pose.trusted, rows))
