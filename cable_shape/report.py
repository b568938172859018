"""What one cycle found: :class:`CycleReport` and its parts. No ROS, no file, no viewer."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import final

from cable_shape.checks import Array
from cable_shape.pose import Grip, Pose
from cable_shape.shape import CableShape


@final
class WarningKind(enum.Enum):
    """What a warning is about; the values are those of ``cable_shape_msgs/CableWarning.kind``."""

    CLEARANCE = 0
    OVERSTRETCHED = 1
    TENSION = 2
    BEND_RADIUS = 3
    TWIST_RATE = 4
    STATUS = 5


@final
class Severity(enum.Enum):
    """The values are those of ``cable_shape_msgs/CableWarning.severity``."""

    WARN = 1
    ERROR = 2


@final
@dataclass(frozen=True, slots=True)
class BodyDistance:
    """How far the cable's surface is from one other body.

    distance [m] is negative on overlap. Witness points [m], world, lie on the two surfaces.
    """

    body: str
    distance: float
    arc_length: float  # m, of the closest point of the cable
    point_on_cable: Array  # (3,)
    point_on_body: Array  # (3,)


@final
@dataclass(frozen=True, slots=True)
class Clearance:
    """Distances of one cable to the bodies around it.

    `bodies` holds, in the order of the scene, every body nearer than the horizon of the search; for all others only
    `beyond`, a lower bound, is known. `closest` is the nearest of `bodies`, None if all are beyond.
    """

    bodies: tuple[BodyDistance, ...] = ()
    beyond: float = float("inf")  # m, every body that is not listed is at least this far
    robot_checked: bool = False  # False: robot links were not given
    pairs_culled: int = 0  # pairs of a cable capsule and a body that bounds ruled out
    pairs_exact: int = 0  # pairs solved exactly

    @property
    def closest(self) -> BodyDistance | None:
        """The nearest listed body."""
        return min(self.bodies, key=lambda b: b.distance, default=None)


@final
@dataclass(frozen=True, slots=True)
class CableWarning:
    """One warning; the fields are those of ``cable_shape_msgs/CableWarning``, where their units are said."""

    cable_id: str
    kind: WarningKind
    severity: Severity
    text: str
    value: float
    limit: float
    margin: float
    arc_length: float
    point_on_cable: Array
    point_on_other: Array
    other: str = ""


@final
@dataclass(frozen=True, slots=True)
class CycleReport:
    """Everything that one :meth:`cable_shape.Cycle.step` found.

    stamp : int [ns], as given to the step: the older of the two gripper stamps.
    times : phase -> [s]: "predict", "clearance", "warnings", "total".
    skipped : what was not done -> count: "reused" shapes, "pairs_culled" by bounds.
    """

    stamp: int
    grips: Mapping[str, tuple[Pose | Grip, Pose | Grip | None]]
    links: Mapping[str, Pose] | None
    shapes: Mapping[str, CableShape]
    clearance: Mapping[str, Clearance]
    warnings: tuple[CableWarning, ...]
    times: Mapping[str, float] = field(default_factory=dict)
    skipped: Mapping[str, int] = field(default_factory=dict)

    @property
    def robot_checked(self) -> bool:
        """Whether clearance to the robot's links was checked for every cable."""
        return bool(self.clearance) and all(c.robot_checked for c in self.clearance.values())
