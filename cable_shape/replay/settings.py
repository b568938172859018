"""What a replay computes with: :class:`Settings`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, final

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.cable_file import AS_GIVEN, Held
from cable_shape.cycle.dynamic import DYNAMIC, MOTIONS, QUASISTATIC
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import ArgumentError
from cable_shape.prediction.predictor import Predictor
from cable_shape.scene.scene import Scene
from cable_shape.solve.problem import GRAVITY
from cable_shape.uncertainty.uncertainty import Uncertainty

if TYPE_CHECKING:
    from cable_shape.robots.robot import Robot

INPUTS = ("auto", "poses", "joints", "tf")
#: [m/s^2], an acceleration that is not linear along the cable, as that of markers is not.
_UNEVEN = ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))


@final
@dataclass(frozen=True, slots=True)
class Settings:
    """What a replay computes with: a cable, or a harness with the ends that are held.

    held_ends : of the harness; empty: as its file says.
    end_topics : of poses, by held end, where they are not /NAME/SEGMENT_start/pose or /NAME/SEGMENT_end/pose.
    input : "poses", "joints", "tf", or "auto": transforms if frames of the grippers are given, joint states if a robot
        is given and they were recorded, else poses.
    left_frame, right_frame : of the grippers on tf_topic and tf_topic + "_static", in frame_id.
    edits_topic : of what was edited between the cycles, which the replay repeats where it was recorded.
    max_skew : [s], gripper poses further apart are not paired; markers and transforms likewise.
    start, end : how the grippers hold the cable, where that is not left to the robot's file or to the defaults of Grip.
    uncertainty : makes a tube about every shape; clearance and warnings are those of the tube then.
    inertia : whether the markers' accelerations load it; else it is predicted as if it were at rest. Where markers are
        on a harness is in the key `markers` of its file.
    motion : "quasistatic", or "dynamic": as the cable swings, see :class:`cable_shape.Cycle`.
    rrd, picture : whether to write replay.rrd and report.png.
    """

    cable: Cable | None = None
    scene: Scene | None = None
    robot: Robot | None = None
    uncertainty: Uncertainty | None = None
    model: str = "auto"
    gravity: tuple[float, float, float] = GRAVITY
    points: int = 150
    tolerance: float | None = None
    start: Held = AS_GIVEN
    end: Held = AS_GIVEN
    max_skew: float = 0.02
    input: str = "auto"
    left_topic: str = "/left_gripper/pose"
    right_topic: str = "/right_gripper/pose"
    joints_topic: str = "/joint_states"
    tf_topic: str = "/tf"
    left_frame: str = ""
    right_frame: str = ""
    frame_id: str = "world"
    markers_topic: str = "/cable/markers"
    edits_topic: str = "/cable/edits"
    inertia: bool = False
    motion: str = QUASISTATIC
    harness: HarnessFile | None = None
    held_ends: tuple[str, ...] = ()
    end_topics: Mapping[str, str] = field(default_factory=dict, hash=False)
    rrd: bool = True
    picture: bool = True

    def __post_init__(self) -> None:
        checks.number("max_skew", self.max_skew, above=0.0, unit="s")
        checks.one_of("input", self.input, INPUTS)
        checks.one_of("motion", self.motion, MOTIONS)
        if self.inertia and self.motion == DYNAMIC:
            bound = "motion='dynamic' knows its inertia itself"
            raise ArgumentError.of("inertia", True, bound, "Leave it out, or write motion='quasistatic'.")
        frames = bool(self.left_frame), bool(self.right_frame)
        if (self.input == "tf" and not all(frames)) or frames[0] != frames[1]:
            raise ArgumentError(
                f"left_frame = {self.left_frame!r}, right_frame = {self.right_frame!r} are not allowed: transforms "
                "need the frames of both grippers. Give --left-frame and --right-frame."
            )
        if (self.cable is None) == (self.harness is None):
            raise ArgumentError("A replay has a cable or a harness. Give one of them.")
        if self.harness is not None:
            if self.inertia and not self.harness.markers:
                bound = "the harness's file does not say where its markers are"
                raise ArgumentError.of("inertia", True, bound, "Write markers: {trunk: [0.1, 0.2]}, or leave it out.")
        elif self.cable is not None and self.inertia:
            try:
                Predictor(self.cable, model=self.model, scene=self.scene).accelerate(_UNEVEN)
            except ArgumentError as error:
                raise ArgumentError(f"inertia: {error} Or leave inertia out.") from None
