"""Along a trajectory from waypoint to waypoint, halving what is not sure: :class:`Walk`; one cable's :class:`Judge`."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from time import perf_counter
from typing import Generic, NamedTuple, Protocol, TypeVar, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.safety import advance
from cable_shape.planning.paths import Motion
from cable_shape.planning.trajectory_report import Reason, TrajectoryCheck, Violation
from cable_shape.pose import Pose
from cable_shape.prediction.predictor import Predictor
from cable_shape.robots.robot import Robot
from cable_shape.safety.clearance import DEEPEST_REST, ClearanceChecker
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import LOAD_MARGINS, Clearance, Margin, WarningKind
from cable_shape.safety.warnings import metres
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape, Status
from cable_shape.solve.answers import Solved
from cable_shape.solve.problem import swing_of

#: [m]: what may hide between two places is smaller than this, ...
RESOLUTION = 1e-4
#: ... for margins this, ...
MARGIN_RESOLUTION = 1e-3
#: ... and places nearer to each other than this fraction of a segment are one.
MOST_HALVINGS = 12
#: A deviation above this fraction of the length is a jump, where it does not shrink with the step.
JUMP = 0.02
#: Loads below this part of their limit do not reach it within a step that the cable's points are sure of.
_CALM = 0.3
#: This part of a load's change, and twice what the points deviate beside their way, it may rise above both ends.
_CROOKED = 0.25
#: The first violation is told to this fraction of a segment.
_PLACE = 1e-3
#: Joints are not beyond their limits by less than this [rad] or [m].
_ROUNDING = 1e-9

_CLEARANCE = WarningKind.CLEARANCE
#: Where each margin but those of bodies stands in a look, by the value of its kind.
_LOADS = {kind.value: i for i, kind in enumerate(LOAD_MARGINS)}


def accelerations_of(value: ArrayLike, waypoints: int, predictor: Predictor) -> Array:
    """(k, 3) or (k, m, 3), of the waypoints; what the predictor refuses of them is refused at once."""
    remedy = "Give three numbers in m/s^2 for each waypoint, or a table (m, 3), uniform in arc length."
    a = checks.numbers("acceleration", value, remedy)
    if a.ndim not in (2, 3) or len(a) != waypoints or a.shape[-1] != 3:
        bound = f"it must be ({waypoints}, 3) or ({waypoints}, m, 3), a row a waypoint"
        raise ArgumentError.of("acceleration", f"shape {a.shape}", bound, remedy)
    bad = np.flatnonzero(~(np.abs(a) <= checks.MOST).reshape(waypoints, -1).all(axis=1))
    if bad.size:
        bound = f"every entry must be finite, none above {checks.MOST:g}"
        raise ArgumentError.of(f"acceleration[{bad[0]}]", a[bad[0]].tolist(), bound, remedy)
    predictor.accelerate(a[0])
    if a.ndim == 3:
        swings = next((table for table in a if swing_of(table) is not None), None)
        if swings is None:
            return a[:, [0, -1]]  # also between waypoints, whatever is lost there to rounding
        predictor.accelerate(swings)
    return a


class Sample(Protocol):
    """One place that was solved for."""

    @property
    def place(self) -> float: ...

    @property
    def violation(self) -> Violation | None: ...


S = TypeVar("S", bound=Sample)


class Walk(ABC, Generic[S]):
    """One check of a trajectory; what is carried along it, a subclass knows."""

    part = "segment"  #: what a violation's `segment` is

    def __init__(self, motion: Motion, deadline: float, proceed: Callable[[TrajectoryCheck], bool] | None) -> None:
        self.motion, self.deadline, self.proceed = motion, deadline, proceed
        robot = motion.robot
        self._outside: NDArray[np.bool_] = np.zeros(motion.waypoints, np.bool_)
        if robot is not None:
            joints = motion.joints
            self._outside[:] = ((joints > robot.upper + _ROUNDING) | (joints < robot.lower - _ROUNDING)).any(axis=1)
        self.found = TrajectoryCheck(motion.waypoints)
        self.late = False

    @abstractmethod
    def sample(self, place: float) -> S:
        """Solves for a place, and judges it."""

    @abstractmethod
    def sure(self, a: S, b: S) -> bool:
        """Whether nothing can be wrong between two valid places."""

    @abstractmethod
    def jump(self, a: S, b: S) -> float:
        """[m], how far the cable is from one of two places to the other, which are as good as one; 0: not far."""

    @abstractmethod
    def tell(self, samples: list[S]) -> None:
        """Puts clearance and margins of the waypoints into what was found."""

    def run(self) -> None:
        """Waypoint by waypoint."""
        found = self.found
        samples: list[S] = []
        for i in range(self.motion.waypoints):
            if self._out_of_time():
                break
            now = self.sample(float(i))
            found.done[i] = True
            if not samples:
                found.first = now.violation
            elif samples[-1].violation is None:
                between = self._first(samples[-1], now, 0)
                found.segments[i - 1] = between is None and not self.late
                found.first = found.first or between
            samples.append(now)
        rest = self.motion.waypoints - len(samples)
        found.partial = self.late
        found.waypoints = (*(sample.violation for sample in samples), *(None,) * rest)
        found.robot_checked = self.motion.robot is not None
        self.tell(samples)

    def _out_of_time(self) -> bool:
        self.late = self.late or perf_counter() > self.deadline
        self.late = self.late or (self.proceed is not None and not self.proceed(self.found))
        return self.late

    def _first(self, a: S, b: S, halvings: int) -> Violation | None:
        """The first violation after the valid place a, up to b; None if there is none."""
        if b.violation is None:
            if self.sure(a, b):
                return None
            if halvings == MOST_HALVINGS:
                return self._jump(a, b)
        elif b.place - a.place <= _PLACE or halvings == MOST_HALVINGS:
            return b.violation
        if self._out_of_time():
            return b.violation
        middle = self.sample(0.5 * (a.place + b.place))
        return self._first(a, middle, halvings + 1) or (middle.violation or self._first(middle, b, halvings + 1))

    def _jump(self, a: S, b: S) -> Violation | None:
        """Two places as good as one: the cable has snapped between them, or nothing is wrong."""
        far = self.jump(a, b)
        if far == 0.0:
            return None
        return self.violation(Reason.SNAP, b.place, f"the cable snaps to another shape {metres(far)} away", value=far)

    def no_shape(self, place: float, status: Status, detail: str, segment: str = "") -> Violation | None:
        """A joint beyond its limits, or no shape that may be used; the gravest first."""
        beyond = self._beyond_limits(place)
        if beyond is not None:
            return beyond
        if status is Status.OK or status is Status.BUDGET:
            return None
        reason = {Status.SNAPPED: Reason.SNAP, Status.OVERSTRETCHED: Reason.OVERSTRETCHED}.get(status, Reason.STATUS)
        return self.violation(reason, place, f"{status.name}: {detail or status.remedy}", segment=segment)

    def _beyond_limits(self, place: float) -> Violation | None:
        """A joint beyond its limits: between two waypoints it is no further out than at them."""
        robot, i = self.motion.robot, min(math.ceil(place), self.motion.waypoints - 1)
        if robot is None or not (self._outside[i] or self._outside[max(i - 1, 0)]):
            return None
        q = self.motion.joint_positions(place)
        out = np.maximum(q - robot.upper, robot.lower - q)
        worst = int(out.argmax())
        if not out[worst] > _ROUNDING:
            return None
        limit = float(robot.upper[worst] if q[worst] > robot.upper[worst] else robot.lower[worst])
        name = robot.joint_names[worst]
        text = f"joint {name!r} at {q[worst]:.4g}, limit {limit:.4g}"
        return self.violation(Reason.JOINT_LIMIT, place, text, float(q[worst]), limit, name)

    def violation(
        self,
        reason: Reason,
        place: float,
        text: str,
        value: float = math.nan,
        limit: float = math.nan,
        other: str = "",
        arc_length: float = math.nan,
        segment: str = "",
    ) -> Violation:
        """What is wrong at a place, with its time."""
        times = self.motion.times
        time = math.nan if times is None else float(np.interp(place, np.arange(len(times)), times))
        of = f"{self.part} {segment!r}: " if segment else ""
        text = f"waypoint {place:.4g}: {of}{text}"
        return Violation(reason, place, time, text, value, limit, other, arc_length, segment)


class Look(NamedTuple):
    """What a judge has seen at one place."""

    shape: CableShape
    distances: Array  # (m,) [m], at most the horizon
    used: Array  # of the loads, by _LOADS
    margins: tuple[Margin, ...]


def jumped(a: Mapping[str, Look], b: Mapping[str, Look]) -> float:
    """[m], how far the cable is that has come furthest from one look at all of them to the next; 0: none has jumped."""
    ways = [0.0]
    for name, look in a.items():
        far = float(np.linalg.norm(b[name].shape.positions - look.shape.positions, axis=1).max())
        ways.append(0.0 if far < JUMP * look.shape.length else far)
    return max(ways)


@final
class Judge:
    """One cable, or one segment of a harness, among the bodies of scene and robot; gripped: a gripper holds it."""

    def __init__(
        self, cable: Cable, scene: Scene, robot: Robot | None, segment: str = "", gripped: bool = True
    ) -> None:
        self.segment = segment
        self.checker = ClearanceChecker(
            Scene(obstacles=() if scene.contact == "off" else scene.obstacles, error_distance=scene.error_distance),
            cable=cable,
            robot_links=() if robot is None or scene.contact == "off" else robot.link_geometry,
            gripping_links=robot.gripping_links if robot is not None and gripped else (),
        )
        self.watch = MarginWatch(cable, scene, self.checker.moving)
        #: (m,), row in the links of each body, -1: it stands still
        self._on_link = self.checker.tables[0][:, 11].astype(np.int64)
        resting = np.full(len(self._on_link), scene.contact == "solve") & (self._on_link < 0)
        self._limits: Array = np.where(resting, -DEEPEST_REST, scene.error_distance)

    def look(
        self,
        shape: CableShape,
        links: Mapping[str, Pose] | None,
        state: Solved | None = None,
        held: bool = False,
        clearance: Clearance | None = None,
    ) -> Look:
        """Distances and margins of a shape; held: grips hold both ends; clearance: if it is known, and of more."""
        if clearance is None:
            clearance = self.checker.check(shape, links)
        margins = self.watch.margins(shape, clearance, 0, state=state, held=held)
        used = [math.nan] * len(_LOADS)
        for margin in margins:
            if margin.kind is _CLEARANCE:
                break  # those of bodies come last
            used[_LOADS[margin.kind.value]] = margin.used
        table, known = clearance.table, len(self.checker.names)
        distances = np.empty(0) if table is None else np.minimum(table[:known, 0], self.checker.horizon)
        return Look(shape, distances, np.array(used), margins)

    def frames(self, links: Mapping[str, Pose] | None) -> Array:
        """(l, 7), of the links that carry bodies."""
        poses = [] if links is None else [links[name].array for name in self.checker.links]
        return np.array(poses).reshape(-1, 7)

    def nearest(self, look: Look) -> float:
        """[m], infinite beyond the horizon."""
        if not look.distances.size:
            return math.inf
        least = float(look.distances.min())
        return math.inf if least >= self.checker.horizon else least

    def wrong(self, look: Look, place: float, walk: Walk[S]) -> Violation | None:
        """A body that is too near, or a margin at its limit."""
        distances, margins = look.distances, look.margins
        near = distances - self._limits[: len(distances)]
        body = int(near.argmin()) if near.size else -1
        if body >= 0 and near[body] < 0.0:
            name = self.checker.names[body]
            at = next((m.arc_length for m in margins if m.other == name), math.nan)
            distance, limit = float(distances[body]), float(self._limits[body])
            text = f"{metres(distance)} from {name!r}, at least {metres(limit)} asked"
            return walk.violation(Reason.CLEARANCE, place, text, distance, limit, name, at, self.segment)
        for margin in margins:
            if margin.used >= 1.0 and margin.kind is not _CLEARANCE:
                reason = Reason[margin.kind.name]
                text = f"{reason.value} {margin.value:.4g}, limit {margin.limit:.4g}"
                return walk.violation(
                    reason, place, text, margin.value, margin.limit, "", margin.arc_length, self.segment
                )
        return None

    def sure(self, a: Look, b: Look, links: tuple[Array, Array], way: float, off: float, aside: float) -> bool:
        """Whether nothing can be wrong between two valid places, between which the cable's points move by `way` [m]
        and off it by `off`; aside [m]: by how much a link moves off the straight."""
        if not off <= JUMP * a.shape.length or not self._loads_sure(a, b, off / way if way > 0.0 else 0.0):
            return False
        if not a.distances.size:
            return True
        left = advance.least_left(
            a.shape.positions, b.shape.positions, a.distances, b.distances, self._limits, self._on_link, *links,
            way, off, aside, RESOLUTION,
        )  # fmt: skip
        return bool(left >= 0.0)

    def _loads_sure(self, a: Look, b: Look, off: float) -> bool:
        """Whether no load reaches its limit between; off: deviation from the chord / chord.

        A vector that changes in a straight line is nowhere longer than at both ends, so what counts is how far it
        changes and how crooked.
        """
        most = np.fmax(a.used, b.used)
        if not np.fmax.reduce(most, initial=0.0) > _CALM:
            return True
        force, bend, twist = advance.load_changes(a.shape.buffer, b.shape.buffer, a.shape.points)
        changes = np.array((0.0, force, bend, twist, max(force, bend), bend))
        step = np.fmax(np.abs(b.used - a.used), most * changes)
        near = (step > MARGIN_RESOLUTION) & (most + (_CROOKED + 2.0 * off) * step >= 1.0)
        return not bool(near.any())
