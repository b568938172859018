"""What a replay computes with, and what it found: :class:`Settings`, :class:`Outcome`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

from cable_shape import checks
from cable_shape.cable import Cable
from cable_shape.cable_file import AS_GIVEN, Held
from cable_shape.errors import ArgumentError
from cable_shape.problem import GRAVITY
from cable_shape.replay.inertia import Inertia
from cable_shape.replay.inputs import Refusals
from cable_shape.replay.markers import MarkerComparison
from cable_shape.replay.tally import Tally
from cable_shape.scene import Scene
from cable_shape.uncertainty import Uncertainty

if TYPE_CHECKING:
    from cable_shape.robot import Robot

INPUTS = ("auto", "poses", "joints")


@final
@dataclass(frozen=True, slots=True)
class Settings:
    """What a replay computes with.

    input : "poses", "joints", or "auto": joint states if a robot is given and they were recorded, else poses.
    max_skew : [s], gripper poses further apart are not paired; markers likewise.
    start, end : how the grippers hold the cable, where that is not left to the robot's file or to the defaults of Grip.
    uncertainty : makes a tube about every shape; clearance and warnings are those of the tube then.
    inertia : whether the markers' accelerations load the cable; else it is predicted as if it were at rest.
    rrd, picture : whether to write replay.rrd and report.png.
    """

    cable: Cable
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
    markers_topic: str = "/cable/markers"
    inertia: bool = False
    rrd: bool = True
    picture: bool = True

    def __post_init__(self) -> None:
        checks.number("max_skew", self.max_skew, above=0.0, unit="s")
        checks.one_of("input", self.input, INPUTS)
        if self.inertia:
            self._moves()

    def _moves(self) -> None:
        """What a cable that is accelerated differently all along must be.

        Raises
        ------
        ArgumentError
        """
        if self.model not in ("auto", "cosserat") or self.cable.mean_bending_stiffness == 0.0:
            bound = "only the Cosserat rod knows accelerations that vary along the cable"
            remedy = "Choose model 'auto' and a bending stiffness above 0 N m^2, or leave inertia out."
            raise ArgumentError.of("inertia", self.model, bound, remedy)
        if self.scene is not None and (self.scene.clips or self.scene.contact == "solve"):
            bound = "it is not known of cables in clips, or that rest on bodies"
            raise ArgumentError.of("inertia", "with such a scene", bound, "Leave inertia out, or remove them.")


@final
@dataclass(frozen=True, slots=True)
class Outcome:
    """What a replay found.

    `problems` says what of the recording could not be read; it is empty if all was.
    """

    settings: Settings
    bag: Path
    source: str  # "poses" or "joints"
    frame_id: str
    topics: dict[str, tuple[int, int | None]]  # topic -> messages read, messages that should be there
    tally: Tally
    refusals: Refusals
    unpaired: int
    markers: MarkerComparison
    inertia: Inertia | None
    problems: tuple[str, ...]
    notes: tuple[str, ...]
