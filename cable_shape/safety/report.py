"""What one cycle found: :class:`CycleReport` and its parts. No ROS, no file, no viewer."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, final

from cable_shape.checks import Array
from cable_shape.pose import Ends, Pose
from cable_shape.scene.plug import PlugError
from cable_shape.shape import CableShape
from cable_shape.uncertainty.uncertainty import Tube


@final
class WarningKind(enum.Enum):
    """What a warning or a margin is about; the values are those of ``cable_shape_msgs/CableWarning.kind``."""

    CLEARANCE = 0
    OVERSTRETCHED = 1
    TENSION = 2
    BEND_RADIUS = 3
    TWIST_RATE = 4
    STATUS = 5
    STRESS = 6
    STABILITY = 7
    SNAP = 8
    QUASISTATIC = 9
    CAUGHT = 10
    CONTACT_FORCE = 11


#: The kinds of margin that a shape has by itself, in the order of the kernels' rows; those of bodies come after them.
LOAD_MARGINS = (
    WarningKind.OVERSTRETCHED,
    WarningKind.TENSION,
    WarningKind.BEND_RADIUS,
    WarningKind.TWIST_RATE,
    WarningKind.STRESS,
    WarningKind.STABILITY,
)


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

    `bodies` holds every body nearer than the horizon of the search: in the order of the scene, then the other cables,
    then the cable "itself". For all others only `beyond`, a lower bound, is known, which leaves the cable itself out.
    `closest` is the nearest of `bodies`, None if all are beyond.
    """

    bodies: tuple[BodyDistance, ...] = ()
    beyond: float = float("inf")  # m, every body that is not listed is at least this far
    robot_checked: bool = False  # False: robot links were not given
    pairs_culled: int = 0  # pairs of a cable capsule and a body, or another capsule, that bounds ruled out
    pairs_exact: int = 0  # pairs solved exactly
    confidence: float = 0.0  # above 0: distances are those of the tube that holds the cable with it
    holds: bool = True  # False: that tube may be too narrow, see `Tube.holds`
    #: (m, 8), a row for each body checked: distance (infinite: beyond), arc length, the two witness points
    table: Array | None = field(default=None, repr=False, compare=False)

    @property
    def closest(self) -> BodyDistance | None:
        """The nearest listed body."""
        return min(self.bodies, key=lambda b: b.distance, default=None)


class Ahead(NamedTuple):
    """Where a cable swings if its grips stop now: nearest to another body after `time` [s], or where it is last."""

    time: float
    shape: CableShape
    body: BodyDistance | None


class Margin(NamedTuple):
    """How far one kind of trouble is; the fields are those of ``cable_shape_msgs/CableMargin``, with their units.

    `used` is 1 at the limit and grows as trouble nears, see :mod:`cable_shape.safety.margins`. `arc_length` [m] is that
    of the worst point: negative on a tail before the start grip, beyond the length on one after the end grip.
    `time_to_limit` [s] is 0 at the limit and beyond, infinite when not approaching it, NaN when not known.
    """

    kind: WarningKind
    used: float
    limit: float
    value: float
    arc_length: float
    other: str = ""
    time_to_limit: float = math.nan


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
    time_to_limit: float = math.nan


@final
@dataclass(frozen=True, slots=True)
class CycleReport:
    """Everything that one :meth:`cable_shape.Cycle.step` found.

    shapes : by cable; of a harness "h" a HarnessShape, of whose segments the rest tells under "h/a".
    stamp : int [ns], as given to the step: the older of the two gripper stamps.
    times : phase -> [s]: "predict", "clearance", "margins", "warnings", "total".
    skipped : what was not done -> count: "reused" shapes, "pairs_culled" by bounds, "snap_checks" that were not needed,
        "crossings", pairs of cables (each with itself included) that bounds told not to have touched where contact is
        solved for.
    margins : how far trouble is, by cable; empty for a shape that did not converge.
    tails : shapes of the tails by cable and side ("start", "end"); arc length counts from the grip outwards. They are
        part of the clearance, their arc lengths negative or beyond the length of the cable.
    after_snap : by cable, the shape after a snap that is about to come.
    plugs : by cable, how far its plug is from being in the socket.
    ahead : by cable, where it swings if its grips stop now, with motion="dynamic" and a `look_ahead`.
    tubes : by cable, how well its shape is known, where that is asked for; clearance is that of the tube then.
    tail_tubes : the same of the tails, by cable and side.
    """

    stamp: int
    grips: Mapping[str, Ends]
    links: Mapping[str, Pose] | None
    shapes: Mapping[str, CableShape]
    clearance: Mapping[str, Clearance]
    warnings: tuple[CableWarning, ...]
    times: Mapping[str, float] = field(default_factory=dict)
    skipped: Mapping[str, int] = field(default_factory=dict)
    margins: Mapping[str, tuple[Margin, ...]] = field(default_factory=dict)
    tails: Mapping[tuple[str, str], CableShape] = field(default_factory=dict)
    after_snap: Mapping[str, CableShape] = field(default_factory=dict)
    plugs: Mapping[str, PlugError] = field(default_factory=dict)
    ahead: Mapping[str, Ahead] = field(default_factory=dict)
    tubes: Mapping[str, Tube] = field(default_factory=dict)
    tail_tubes: Mapping[tuple[str, str], Tube] = field(default_factory=dict)

    @property
    def robot_checked(self) -> bool:
        """Whether clearance to the robot's links was checked for every cable."""
        return bool(self.clearance) and all(c.robot_checked for c in self.clearance.values())
