"""What a check of a whole motion found: :class:`TrajectoryCheck` and its :class:`Violation`."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.safety.report import Margin


@final
class Reason(enum.Enum):
    """Why a place of a trajectory is not valid."""

    CLEARANCE = "clearance"
    OVERSTRETCHED = "overstretched"
    TENSION = "tension"
    BEND_RADIUS = "bend_radius"
    TWIST_RATE = "twist_rate"
    STRESS = "stress"
    STABILITY = "stability"
    CONTACT_FORCE = "contact_force"
    SNAP = "snap"
    STATUS = "status"
    EDIT = "edit"
    JOINT_LIMIT = "joint_limit"


@final
@dataclass(frozen=True, slots=True)
class Violation:
    """What is wrong at one place of a trajectory.

    place : float, counted in waypoints: 3.25 is a quarter of the way from waypoint 3 to 4.
    time : float [s], NaN where the trajectory has no times.
    value, limit : in the unit of the margin (m, N, rad/m, Pa), or rad or m of a joint; NaN where there is none.
    other : body or joint. arc_length : [m] of the worst point. segment : of a harness, or the one of
    several cables; empty: it is of neither.
    """

    reason: Reason
    place: float
    time: float
    text: str
    value: float = math.nan
    limit: float = math.nan
    other: str = ""
    arc_length: float = math.nan
    segment: str = ""


class Stop(NamedTuple):
    """How the cable comes to rest where the grips stop.

    place : of the waypoint. time : [s], when the grips arrive.
    settling : [s] from then on until no point is further than 2e-3 of the length from where it hangs at last; infinite:
        not within 10 s.
    swing : [m], how far from there a point is at most.
    """

    place: float
    time: float
    settling: float
    swing: float


@final
class TrajectoryCheck:
    """What :func:`check_trajectory` found.

    Attributes
    ----------
    valid : bool
        No violation at any waypoint or between two; of a partial answer False.
    partial : bool
        The time limit came first.
    done : (k,) bool, waypoints that were looked at
    waypoints : tuple of (Violation or None), at each waypoint
    segments : (k - 1,) bool
        Whether both waypoints and all between them is valid.
    first : Violation or None
    clearance : (k,) [m]
        To the nearest body, infinite beyond the horizon; NaN where not told.
    margins : tuple of the margins at each waypoint, see :mod:`cable_shape.safety.margins`; of a harness those of all
        segments, of several cables of all
    margins_of : mapping of segment to the same, of a harness, or of cable name of several cables
    solved : int, shapes solved for
    robot_checked : bool
        Whether clearance to the robot's links was checked: of paths of joints only.
    stops : tuple of Stop, of a check with the cable's motion: every waypoint at which the grips come to stand
    time : float [s], spent
    """

    def __init__(self, waypoints: int) -> None:
        self.done: NDArray[np.bool_] = np.zeros(waypoints, np.bool_)
        self.segments: NDArray[np.bool_] = np.zeros(max(waypoints - 1, 0), np.bool_)
        self.clearance: Array = np.full(waypoints, math.nan)
        self.waypoints: tuple[Violation | None, ...] = ()
        self.margins: tuple[tuple[Margin, ...], ...] = ()
        self.margins_of: dict[str, tuple[tuple[Margin, ...], ...]] = {}
        self.first: Violation | None = None
        self.solved = 0
        self.stops: tuple[Stop, ...] = ()
        self.partial = self.robot_checked = False
        self.time = 0.0

    @property
    def valid(self) -> bool:
        """See the class."""
        return not self.partial and self.first is None

    def __repr__(self) -> str:
        told = "valid" if self.valid else "partial" if self.first is None else f"not valid: {self.first.text}"
        return f"TrajectoryCheck({len(self.done)} waypoints, {self.solved} shapes, {told})"
