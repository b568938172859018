"""The node's parameters: one table of descriptors, and :class:`Settings`, their valid values. See docs/node.md."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, final

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter

from cable_shape import checks
from cable_shape.cable.cable_file import AS_GIVEN, Held
from cable_shape.calibration import harness_parameters
from cable_shape.calibration.parameters import KNOWN
from cable_shape.cycle.dynamic import MOTIONS, QUASISTATIC
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.files.files import config_folders, find_file, safe_output
from cable_shape.messages.capsules import MAX_CAPSULES
from cable_shape.pose import GRIP_KINDS, IDENTITY, Grip, Pose
from cable_shape.prediction.solvers import MODELS
from cable_shape.solve.problem import MAX_POINTS, MIN_POINTS

__all__ = ["BY_NAME", "SPECS", "Settings", "Spec", "config_folders", "find_file", "unknown_overrides", "widened"]

INPUTS = ("poses", "joints", "tf")
VIEW_OFF, VIEW_WINDOW = "off", "window"
AUTO = "auto"  # of the kind of a grip
#: Kinds of what may be fitted to a harness.
KNOWN_OF_HARNESSES = (*harness_parameters.KNOWN, harness_parameters.FRAMES)
ENDINGS = {"view": ".rrd", "calibration_file": ".yaml"}  # of what parameters name for writing

#: Overrides that rclpy itself understands, besides the parameters that it declares.
RCLPY_PREFIXES = ("qos_overrides.", "start_type_description_service")


@final
@dataclass(frozen=True, slots=True)
class Spec:
    """One parameter. `live`: may change while the node is configured; others need a cleanup first."""

    name: str
    default: Any
    description: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    options: tuple[str, ...] = ()
    live: bool = False
    read_only: bool = False

    @property
    def field(self) -> str:
        """Name of the value in :class:`Settings`."""
        return self.name.replace(".", "_")

    def descriptor(self) -> ParameterDescriptor:
        """What `ros2 param describe` shows."""
        when = "Read-only." if self.read_only else "" if self.live else "Fixed while the node is configured."
        options = f"One of: {', '.join(self.options)}." if self.options else ""
        descriptor = ParameterDescriptor(
            name=self.name,
            type=Parameter.Type.from_parameter_value(self.default).value,
            description=f"{self.description}{f' [{self.unit}]' if self.unit else ''}",
            additional_constraints=" ".join(part for part in (options, when) if part),
            read_only=self.read_only,
        )
        if self.low is not None and self.high is not None:
            if isinstance(self.default, int):
                descriptor.integer_range = [IntegerRange(from_value=int(self.low), to_value=int(self.high), step=1)]
            else:
                descriptor.floating_point_range = [FloatingPointRange(from_value=self.low, to_value=self.high)]
        return descriptor

    def check(self, value: Any) -> Any:
        """`value` if it is allowed; numbers as float, arrays as tuples.

        Raises
        ------
        ArgumentError
        """
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise ArgumentError.of(self.name, value, "it must be true or false", "")
            return value
        if isinstance(self.default, str):
            if not isinstance(value, str):
                raise ArgumentError.of(self.name, value, "it must be text", "Quote it.")
            return checks.one_of(self.name, value, self.options) if self.options else value
        if isinstance(self.default, list):
            return tuple(checks.vector(self.name, value, len(self.default), self.unit).tolist())
        if isinstance(self.default, int):
            return checks.integer(self.name, value, at_least=int(self.low or 0), at_most=int(self.high or 0))
        number = checks.number(self.name, value, unit=self.unit)
        if self.low is not None and self.high is not None and not self.low <= number <= self.high:
            bound = f"it must be between {self.low:g} and {self.high:g} {self.unit}".rstrip()
            raise ArgumentError.of(self.name, number, bound, f"Choose {self.name} within these bounds.")
        return number


NO_OFFSET = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
_OFFSET = "Cable frame in the tool frame: x y z [m], qx qy qz qw. Not for joints: robot_file says it."
_KIND = "How this gripper holds the cable; auto: as cable_file says, else clamped. With input joints: auto."

SPECS = (
    Spec("cable_file", "", "YAML file of the cable, or of several; relative to the working directory or to config/."),
    Spec(
        "harness_file",
        "",
        "YAML files of harnesses, with commas, with or without cable_file; topics have their names.",
    ),
    Spec("held_ends", "", "Ends of the harness that grippers hold, with commas; empty: as harness_file says, or all."),
    Spec("scene_file", "", "YAML file of obstacles, clips, masses and sockets; empty: nothing around the cable."),
    Spec("robot_file", "", "YAML file of the robot, for input joints; with poses its links follow joint_states."),
    Spec("model", "auto", "Model of the cable.", options=MODELS),
    Spec("gravity", [0.0, 0.0, -9.81], "Gravity in the frame of the input.", "m/s^2"),
    Spec("points", 150, "Points of a shape, uniform in arc length.", low=MIN_POINTS, high=MAX_POINTS),
    Spec("tolerance", 0.0, "Largest position error allowed; 0: 1e-5 of the length.", "m", 0.0, 1.0),
    Spec("time_budget", 0.0, "Of one prediction, after which the best shape so far is given; 0: none.", "s", 0.0, 60.0),
    Spec("snap_horizon", 1.0, "A snap nearer than this is predicted; 0: never.", "s", 0.0, 60.0),
    Spec("quasistatic_limit", 0.25, "Inertial load / weight beyond which it is warned; 0: never.", "1", 0.0, 10.0),
    Spec("motion", QUASISTATIC, "The cable at rest in every instant, or as it swings.", options=MOTIONS),
    Spec(
        "look_ahead", 0.0, "With dynamic: where it swings in this time if the grips stop now; 0: not.", "s", 0.0, 10.0
    ),
    Spec("uncertainty_file", "", "YAML file of how well cable and grips are known: a tube; empty: none."),
    Spec(
        "input",
        "poses",
        "Where the grips come from: two PoseStamped topics, JointState, or /tf.",
        options=INPUTS,
    ),
    Spec("left_gripper.frame", "", "Frame of the left gripper, for input tf; of several cables: NAME/ and this."),
    Spec("right_gripper.frame", "", "Frame of the right gripper, for input tf."),
    Spec("frame_id", "", "Frame of all input; empty: that of the first message, or 'world' for joints and tf."),
    Spec("view", VIEW_OFF, "Viewer: off, window, or the path of an .rrd file to write, below output_folder."),
    Spec("planner", False, "Serve planners in a process of its own: cable/predict_shapes, cable/check_trajectory."),
    Spec("planner_rows", 10_000, "Grasps or waypoints in one request at most.", low=1, high=100_000),
    Spec("planner_threads", 0, "Threads that solve grasps; 0: one less than there are cores.", low=0, high=256),
    Spec("planner_time_limit", 10.0, "Of one request, after which what is done is answered.", "s", 0.001, 3600.0),
    Spec("planner_profiles", "", "XML profiles of Fast DDS for that process: fastdds_planner.xml; empty: none."),
    Spec("moveit_rate", 0.0, "The cable goes to MoveIt's planning scene at most so often; 0: never.", "Hz", 0.0, 5.0),
    Spec("moveit_capsules", 8, "Capsules that it is made of there.", low=1, high=MAX_CAPSULES),
    Spec("moveit_padding", 0.01, "Capsules are wider by this; a cable within is not sent anew.", "m", 0.0, 1.0),
    Spec("points_seen", False, "Correct cable/shape by what is seen of the cable, on cable/points_seen."),
    Spec("calibration", False, "Serve the action cable/calibrate in a process of its own."),
    Spec("calibration_points", "", "Topic of points seen on the cable, to calibrate by all the time; empty: none."),
    Spec("calibration_fit", "bending_stiffness", "What to fit, with commas, see docs/calibration.md."),
    Spec("calibration_window", 50, "Observations that are kept and fitted.", low=1, high=1000),
    Spec("calibration_period", 5.0, "From one fit to the next.", "s", 0.1, 3600.0),
    Spec("calibration_file", "", "YAML file that fits that converge are written to, below output_folder."),
    Spec("workers_make_way", True, "Planner and calibrator run only where no other thread wants the core."),
    Spec("output_folder", "", "Files are written only below it; empty: none is written.", read_only=True),
    Spec("lock", False, "Once active: no parameter changes, configure, cleanup by peers.", read_only=True),
    Spec("allow_edits", False, "Locked, take edits of peers all the same; not locked, they are taken.", read_only=True),
    Spec("autostart", True, "Configure and activate at start.", read_only=True),
    Spec("rate", 0.0, "Cycles a second, each with the newest input; 0: one for every input.", "Hz", 0.0, 10000.0),
    Spec("max_skew", 0.02, "Poses further apart in time are not paired.", "s", 0.0, 10.0, live=True),
    Spec("stale_after", 0.5, "Input older than this is reported as stale.", "s", 0.01, 3600.0, live=True),
    Spec("diagnostics_period", 1.0, "Time between diagnostics that hold no news.", "s", 0.1, 60.0, live=True),
    Spec("grip_kind_left", AUTO, _KIND, options=(*GRIP_KINDS, AUTO), live=True),
    Spec("grip_kind_right", AUTO, _KIND, options=(*GRIP_KINDS, AUTO), live=True),
    Spec("left_gripper.offset", NO_OFFSET, _OFFSET, live=True),
    Spec("right_gripper.offset", NO_OFFSET, _OFFSET, live=True),
)
BY_NAME = {spec.name: spec for spec in SPECS}


@final
@dataclass(frozen=True, slots=True)
class Settings:
    """The value of every parameter, each valid by itself; :meth:`complete` checks them together."""

    cable_file: str
    harness_file: str
    held_ends: str
    scene_file: str
    robot_file: str
    model: str
    gravity: tuple[float, float, float]  # m/s^2
    points: int
    tolerance: float  # m
    time_budget: float  # s
    snap_horizon: float  # s
    quasistatic_limit: float
    motion: str
    look_ahead: float  # s
    uncertainty_file: str
    input: str
    left_gripper_frame: str
    right_gripper_frame: str
    frame_id: str
    view: str
    planner: bool
    planner_rows: int
    planner_threads: int
    planner_time_limit: float  # s
    planner_profiles: str
    moveit_rate: float  # Hz
    moveit_capsules: int
    moveit_padding: float  # m
    points_seen: bool
    calibration: bool
    calibration_points: str
    calibration_fit: str
    calibration_window: int
    calibration_period: float  # s
    calibration_file: str
    workers_make_way: bool
    output_folder: str
    lock: bool
    allow_edits: bool
    autostart: bool
    rate: float  # Hz
    max_skew: float  # s
    stale_after: float  # s
    diagnostics_period: float  # s
    grip_kind_left: str
    grip_kind_right: str
    left_gripper_offset: tuple[float, ...]
    right_gripper_offset: tuple[float, ...]

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Settings:
        """From parameter values by parameter name, all of them.

        Raises
        ------
        ArgumentError
        """
        settings = cls(**{spec.field: spec.check(values[spec.name]) for spec in SPECS})
        settings.grips()
        settings.check_sides()
        return settings

    def check_sides(self) -> None:
        """What is said of the left and the right gripper is of cables.

        Raises
        ------
        ArgumentError
        """
        for side in ("left", "right") if self.harness_file and not self.cable_file else ():
            for name in (f"grip_kind_{side}", f"{side}_gripper.offset", f"{side}_gripper.frame"):
                spec = BY_NAME[name]
                value = getattr(self, spec.field)
                if value != spec.check(spec.default):
                    remedy = "Leave it out; the key `ends` of harness_file has kinds and offsets."
                    raise ArgumentError.of(name, value, "a harness has no left and right", remedy)

    def grips(self, held: tuple[Held, Held] = (AS_GIVEN, AS_GIVEN)) -> tuple[Grip, Grip]:
        """The start and end grip at the origin, with kind and offset; `held`: what the cable's file knows of them."""
        made = []
        for side, kind, known in zip(("left", "right"), self.kinds, held, strict=True):
            name = f"{side}_gripper.offset"
            row = getattr(self, BY_NAME[name].field)
            try:
                offset = IDENTITY if list(row) == NO_OFFSET else Pose(row[:3], row[3:])
                made.append(known.told(kind).grip(Grip(IDENTITY, offset=offset)))
            except ArgumentError as error:
                raise ArgumentError(f"{name}: {error}") from None
        return made[0], made[1]

    @property
    def kinds(self) -> tuple[str | None, str | None]:
        """How left and right gripper hold the cable; None: that is left to the cable's file."""
        left, right = (None if kind == AUTO else kind for kind in (self.grip_kind_left, self.grip_kind_right))
        return left, right

    def complete(self) -> None:
        """What the parameters must be together, before the node can be configured.

        Raises
        ------
        ArgumentError
        """
        self._check_what()
        if self.input == "joints" and not self.robot_file:
            raise ArgumentError.of(
                "robot_file", "", "input = 'joints' needs a robot", "For example config/robots/dual_arm.yaml."
            )
        for name in self.fitted:
            if name not in KNOWN and not (self.harness_file and name.partition(":")[0] in KNOWN_OF_HARNESSES):
                known = (*(KNOWN if self.cable_file else ()), *(KNOWN_OF_HARNESSES if self.harness_file else ()))
                raise UnknownKeyError.among("calibration_fit", name, known)
        if self.input == "tf" and self.cable_file:
            self._check_frames()
        if self.calibration_points and self.input != "poses":
            bound = f"points are compared with poses of the grips, input is {self.input!r}"
            raise ArgumentError.of("calibration_points", self.calibration_points, bound, "Use the action, or poses.")
        if self.calibration_file and not self.calibration_points:
            bound = "it is written by what calibration_points brings"
            raise ArgumentError.of("calibration_file", self.calibration_file, bound, "Name that topic, or no file.")
        for name in ("view", "calibration_file"):
            self.output(name)

    def _check_what(self) -> None:
        """A file of cables, or of harnesses, of which less is known."""
        if not self.cable_file and not self.harness_file:
            raise ArgumentError.of(
                "cable_file", "", "it must be the path of a cable's YAML file, or harness_file that of a harness",
                "For example config/cables/demo.yaml.",
            )  # fmt: skip
        if self.held_ends and not self.harness_file:
            raise ArgumentError.of("held_ends", self.held_ends, "they are ends of a harness", "Name its harness_file.")
        if self.held_ends and len(self.harness_files) > 1:
            bound = f"they are ends of one harness; there are {len(self.harness_files)}"
            raise ArgumentError.of("held_ends", self.held_ends, bound, "Write the key `ends` of each harness's file.")

    def _check_frames(self) -> None:
        """Two frames, for input tf."""
        for side in ("left", "right"):
            if not getattr(self, f"{side}_gripper_frame"):
                bound = "input = 'tf' needs the gripper's frame"
                raise ArgumentError.of(f"{side}_gripper.frame", "", bound, f"For example {side}_tool0.")
        if self.left_gripper_frame.lstrip("/") == self.right_gripper_frame.lstrip("/"):
            bound = "it must be another one than left_gripper.frame"
            raise ArgumentError.of("right_gripper.frame", self.right_gripper_frame, bound, "Name one of each gripper.")

    def output(self, name: str) -> Path | None:
        """Where the file goes that the parameter `name` names; None if it names none.

        Raises
        ------
        ArgumentError
            If it lies outside `output_folder`, or would be written over something else.
        """
        path: str = getattr(self, name)
        if path in ("", VIEW_OFF, VIEW_WINDOW):
            return None
        if not self.output_folder:
            bound = "files are written only below output_folder, which is empty"
            raise ArgumentError.of(name, path, bound, "Start the node with -p output_folder:=FOLDER.")
        try:
            return safe_output(self.output_folder, path, (ENDINGS[name],))
        except ArgumentError as error:
            raise ArgumentError(f"{name}: {error}") from None

    @property
    def fitted(self) -> tuple[str, ...]:
        """What is to be calibrated."""
        return _words(self.calibration_fit)

    @property
    def harness_files(self) -> tuple[str, ...]:
        """Their paths."""
        return _words(self.harness_file)

    @property
    def held(self) -> tuple[str, ...]:
        """Ends of the harness that grippers hold; empty: that is left to its file."""
        return _words(self.held_ends)

    def echo(self) -> str:
        """All values on one line, for the log."""
        return ", ".join(f"{f.name} = {getattr(self, f.name)!r}" for f in fields(self))


def _words(text: str) -> tuple[str, ...]:
    """What commas separate."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def unknown_overrides(given: Iterable[str], declared: Iterable[str]) -> list[str]:
    """A message for each override that no parameter of the node takes; rclpy would ignore it in silence."""
    known = set(declared)
    return [
        str(UnknownKeyError.among("parameters", name, BY_NAME))
        for name in sorted(given)
        if name not in known and not name.startswith(RCLPY_PREFIXES)
    ]


def widened(parameters: Sequence[Parameter]) -> list[Parameter]:
    """Parameters as they were meant: `rate:=100` is 100.0, and YAML reads `view:=off` as false."""
    out = []
    for parameter in parameters:
        spec = BY_NAME.get(parameter.name)
        default = None if spec is None else spec.default
        if isinstance(default, float) and parameter.type_ == Parameter.Type.INTEGER:
            parameter = Parameter(parameter.name, Parameter.Type.DOUBLE, float(parameter.value))
        elif isinstance(default, list) and parameter.type_ == Parameter.Type.INTEGER_ARRAY:
            parameter = Parameter(parameter.name, Parameter.Type.DOUBLE_ARRAY, [float(v) for v in parameter.value])
        elif default == VIEW_OFF and parameter.value is False:
            parameter = Parameter(parameter.name, Parameter.Type.STRING, VIEW_OFF)
        out.append(parameter)
    return out
