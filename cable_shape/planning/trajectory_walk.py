"""Along a trajectory from waypoint to waypoint, halving what is not sure: :class:`Walk`; one cable's :class:`Judge`."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from time import perf_counter
from typing import Any, Generic, NamedTuple, Protocol, TypeVar, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.cycle.turned_watch import TurnedWatch
from cable_shape.errors import ArgumentError
from cable_shape.kernels.safety import advance
from cable_shape.planning.paths import Motion
from cable_shape.planning.trajectory_report import Reason, TrajectoryCheck, Violation
from cable_shape.pose import Pose
from cable_shape.prediction.edits import Edit
from cable_shape.robots.robot import Robot
from cable_shape.safety.allowed import Allowed
from cable_shape.safety.clearance import DEEPEST_REST, ClearanceChecker
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import LOAD_MARGINS, Clearance, Margin, WarningKind
from cable_shape.safety.warnings import metres
from cable_shape.scene.scene import Allow, Scene
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

#: Of the length: by no more than this may a body that may be touched turn the cable from its way, unseen.
_INTRUSION = 1e-3

_CLEARANCE, _FORCE = WarningKind.CLEARANCE, WarningKind.CONTACT_FORCE
#: Where each margin but those of bodies stands in a look, by the value of its kind.
_LOADS = {kind.value: i for i, kind in enumerate(LOAD_MARGINS)}


def accelerations_of(value: ArrayLike, waypoints: int, accelerate: Callable[[Array], object]) -> Array:
    """(k, 3) or (k, m, 3), of the waypoints; what `accelerate`, a predictor's, refuses of them is refused at once."""
    remedy = "Give three numbers in m/s^2 for each waypoint, or a table (m, 3), uniform in arc length."
    a = checks.numbers("acceleration", value, remedy)
    if a.ndim not in (2, 3) or len(a) != waypoints or a.shape[-1] != 3:
        bound = f"it must be ({waypoints}, 3) or ({waypoints}, m, 3), a row a waypoint"
        raise ArgumentError.of("acceleration", f"shape {a.shape}", bound, remedy)
    bad = np.flatnonzero(~(np.abs(a) <= checks.MOST).reshape(waypoints, -1).all(axis=1))
    if bad.size:
        bound = f"every entry must be finite, none above {checks.MOST:g}"
        raise ArgumentError.of(f"acceleration[{bad[0]}]", a[bad[0]].tolist(), bound, remedy)
    accelerate(a[0])
    if a.ndim == 3:
        swings = next((table for table in a if swing_of(table) is not None), None)
        if swings is None:
            return a[:, [0, -1]]  # also between waypoints, whatever is lost there to rounding
        accelerate(swings)
    return a


def bodies_of(robot: Robot | None) -> dict[str, Any]:
    """A predictor's keywords of the robot's links, which hold the cable out where contact is solved for."""
    return {} if robot is None else {"robot_links": robot.link_geometry, "gripping_links": robot.gripping_links}


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

    def __init__(
        self,
        motion: Motion,
        deadline: float,
        proceed: Callable[[TrajectoryCheck], bool] | None,
        edits: Mapping[int, tuple[Edit, ...]] | None = None,
    ) -> None:
        self.motion, self.deadline, self.proceed, self.edits = motion, deadline, proceed, edits or {}
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
            if self._out_of_time() or self._refused(i, samples):
                break
            now = self.sample(float(i))
            found.done[i] = True
            if not samples:
                found.first = now.violation
            elif i in self.edits:
                found.segments[i - 1] = samples[-1].violation is None and now.violation is None
                found.first = found.first or now.violation
            elif samples[-1].violation is None:
                between, now = self._first(samples[-1], now, 0)
                found.segments[i - 1] = between is None and not self.late
                found.first = found.first or between
            samples.append(now)
        rest = self.motion.waypoints - len(samples)
        if not rest and not self.late:
            self._refused(len(samples), samples)
        found.partial = self.late
        found.waypoints = (*(sample.violation for sample in samples), *(None,) * rest)
        found.robot_checked = self.motion.robot is not None
        self.tell(samples)

    def _refused(self, waypoint: int, samples: list[S]) -> bool:
        """Makes the edits that come before a waypoint; True if one cannot be, which is told then."""
        if not self.edits.get(waypoint):
            return False
        why = self.edit(self.edits[waypoint], samples[-1])
        if why:
            self.found.first = self.found.first or self.violation(Reason.EDIT, waypoint - 1.0, why)
        return bool(why)

    def edit(self, edits: tuple[Edit, ...], last: S) -> str:
        """Makes edits where the cable is at the last waypoint; says why if one cannot be."""
        raise NotImplementedError

    def _out_of_time(self) -> bool:
        self.late = self.late or perf_counter() > self.deadline
        self.late = self.late or (self.proceed is not None and not self.proceed(self.found))
        return self.late

    def _first(self, a: S, b: S, halvings: int) -> tuple[Violation | None, S]:
        """The first violation after the valid place a, up to b, None if there is none; and b, solved for again if the
        cable had to be led there in smaller steps.
        """
        if b.violation is None:
            if self.sure(a, b):
                return None, b
            if halvings == MOST_HALVINGS:
                return self._jump(a, b), b
        elif b.place - a.place <= _PLACE or halvings == MOST_HALVINGS:
            return b.violation, b
        if self._out_of_time():
            return b.violation, b
        astray = self.astray(a, b)
        if astray:
            self.go_back(a)
        found, middle = self._first(a, self.sample(0.5 * (a.place + b.place)), halvings + 1)
        if found is not None or self.late:
            return found or b.violation, b
        if astray:
            self.go_back(middle)
            b = self.sample(b.place)
        return self._first(middle, b, halvings + 1)

    def astray(self, a: S, b: S) -> bool:
        """Whether the step from a to b may have led to another branch; then smaller ones `go_back` to a first."""
        return False

    def go_back(self, a: S) -> None:
        """The next place is solved for from this one."""
        raise NotImplementedError

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
    distances: Array  # (m,) [m], of what is judged: at most the horizon, infinite where contact is meant
    bare: Array  # (m,) [m], of all of the cable, at most the horizon
    touched: NDArray[np.bool_]  # (m,)
    used: Array  # of the loads, by _LOADS, then of the forces of contact that is meant
    margins: tuple[Margin, ...]

    def with_stability(self, margin: Margin) -> Look:
        """The same with the margin of a whole of which this is the part that turns most."""
        used = self.used.copy()
        used[_LOADS[margin.kind.value]] = margin.used
        return self._replace(used=used, margins=(*self.margins, margin))


def jumped(a: Mapping[str, Look], b: Mapping[str, Look]) -> float:
    """[m], how far the cable is that has come furthest from one look at all of them to the next; 0: none has jumped."""
    ways = [0.0]
    for name, look in a.items():
        far = float(np.linalg.norm(b[name].shape.positions - look.shape.positions, axis=1).max())
        ways.append(0.0 if far < JUMP * look.shape.length else far)
    return max(ways)


def _reached(margin: Margin) -> bool:
    """Whether a load, or the force of a body, is at its limit."""
    return margin.used >= 1.0 and margin.kind is not _CLEARANCE


@final
class Judge:
    """One cable, or one segment of a harness, among the bodies of scene and robot; gripped: a gripper holds it.

    turned: it is solved for as told from its end.

    Where contact is solved for it is meant with what the scene's `allow` names, or with all obstacles if it names none.
    """

    def __init__(
        self,
        cable: Cable,
        scene: Scene,
        robot: Robot | None,
        segment: str = "",
        gripped: bool = True,
        *,
        turned: bool = False,
    ) -> None:
        self.segment = segment
        checked = scene.contact != "off"
        robot_links = robot.link_geometry if robot is not None and checked else ()
        gripping = robot.gripping_links if robot is not None and gripped else ()
        self.checker = ClearanceChecker(
            Scene(obstacles=scene.obstacles if checked else (), error_distance=scene.error_distance),
            cable=cable,
            robot_links=robot_links,
            gripping_links=gripping,
        )
        self.watch = (TurnedWatch if turned else MarginWatch)(cable, scene, self.checker.moving)
        self._solves = scene.contact == "solve"
        if self._solves and not scene.allow:
            scene = scene.replace(allow=[Allow(body.name) for body in scene.obstacles])
        self._allowed = Allowed(scene, cable, robot_links, gripping)
        self._forces = list(dict.fromkeys(allow.body for allow in scene.allow if allow.max_force is not None))
        #: (m,), row in the links of each body, -1: it stands still
        self._on_link = self.checker.tables[0][:, 11].astype(np.int64)
        self._limits: Array = np.full(len(self._on_link), scene.error_distance)
        meant = {allow.body for allow in scene.allow}
        self._meant = np.array([name in meant for name in self.checker.names], dtype=np.bool_)
        self._intrusion = RESOLUTION if self._forces else _INTRUSION * cable.length

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
        judged, forces = self._allowed.judged(shape, clearance, links)
        margins = self.watch.margins(shape, judged, 0, state=state, held=held) + forces
        used = [math.nan] * len(_LOADS) + [0.0] * len(self._forces)
        for margin in margins:
            if margin.kind is _FORCE:
                used[len(_LOADS) + self._forces.index(margin.other)] = margin.used
            elif margin.kind is not _CLEARANCE:
                used[_LOADS[margin.kind.value]] = margin.used
        table, names = clearance.table, self.checker.names
        if table is None or judged.table is None:
            none: NDArray[np.bool_] = np.zeros(0, np.bool_)
            return Look(shape, np.empty(0), np.empty(0), none, np.array(used), margins)
        bare, horizon = table[: len(names), 0], self.checker.horizon
        distances = np.where(self._meant & (bare < horizon), judged.table[: len(names), 0], np.minimum(bare, horizon))
        bodies = {shape.bodies[int(row)] for row in set(shape.touches[:, 1].tolist())}
        touched = np.array([name in bodies for name in names], dtype=np.bool_)
        return Look(shape, distances, np.minimum(bare, horizon), touched, np.array(used), margins)

    def frames(self, links: Mapping[str, Pose] | None) -> Array:
        """(l, 7), of the links that carry bodies."""
        poses = [] if links is None else [links[name].array for name in self.checker.links]
        return np.array(poses).reshape(-1, 7)

    def nearest(self, look: Look) -> float:
        """[m], infinite beyond the horizon."""
        if not look.bare.size:
            return math.inf
        least = float(look.bare.min())
        return math.inf if least >= self.checker.horizon else least

    def wrong(self, look: Look, place: float, walk: Walk[S]) -> Violation | None:
        """A body that is too near, or a margin at its limit: that first where it is of contact that is meant."""
        distances, margins = look.distances, look.margins
        near = distances - self._limits[: len(distances)]
        body = int(near.argmin()) if near.size else -1
        found = [self._too_much(margin, place, walk) for margin in margins if _reached(margin)][:1]
        if body >= 0 and near[body] < 0.0 and not (found and self._meant[body]):
            name = self.checker.names[body]
            at = next((m.arc_length for m in margins if m.other == name), math.nan)
            distance, limit = float(distances[body]), float(self._limits[body])
            text = f"{metres(distance)} from {name!r}, at least {metres(limit)} asked"
            return walk.violation(Reason.CLEARANCE, place, text, distance, limit, name, at, self.segment)
        return found[0] if found else None

    def _too_much(self, margin: Margin, place: float, walk: Walk[S]) -> Violation:
        """What a load, or the force of a body, is beyond."""
        reason = Reason[margin.kind.name]
        by = f" by {margin.other!r}" if margin.other else ""
        text = f"{reason.value}{by} {margin.value:.4g}, limit {margin.limit:.4g}"
        value, limit, other, at = margin.value, margin.limit, margin.other, margin.arc_length
        return walk.violation(reason, place, text, value, limit, other, at, self.segment)

    def sure(self, a: Look, b: Look, links: tuple[Array, Array], way: float, off: float, aside: float) -> bool:
        """Whether nothing can be wrong between two valid places, between which the cable's points move by `way` [m]
        and off it by `off`; aside [m]: by how much a link moves off the straight."""
        if not off <= JUMP * a.shape.length or not self._loads_sure(a, b, off / way if way > 0.0 else 0.0):
            return False
        if not a.distances.size:
            return True
        asked = [(a.distances, b.distances, self._limits, RESOLUTION)]
        if self._meant.any():
            asked.append((a.bare, b.bare, self._least(a, b), 2.0 * self._intrusion))
        line = a.shape.positions, b.shape.positions
        return all(
            advance.least_left(*line, one, other, limits, self._on_link, *links, way, off, aside, small) >= 0.0
            for one, other, limits, small in asked
        )

    def _least(self, a: Look, b: Look) -> Array:
        """(m,) [m], how near a body that may be touched may come between two places: contact changes the loads, so that
        where it may come or go the places have to be near each other.
        """
        if not self._solves:
            return np.where(self._meant, -DEEPEST_REST, -math.inf)
        return np.where(self._meant & ~(a.touched & b.touched), -self._intrusion, -math.inf)

    def _loads_sure(self, a: Look, b: Look, off: float) -> bool:
        """Whether no load reaches its limit between; off: deviation from the chord / chord.

        A vector that changes in a straight line is nowhere longer than at both ends, so what counts is how far it
        changes and how crooked.
        """
        most = np.fmax(a.used, b.used)
        if not np.fmax.reduce(most, initial=0.0) > _CALM:
            return True
        force, bend, twist = advance.load_changes(a.shape.buffer, b.shape.buffer, a.shape.points)
        changes = np.array((0.0, force, bend, twist, max(force, bend), bend, *[force] * len(self._forces)))
        step = np.fmax(np.abs(b.used - a.used), most * changes)
        near = (step > MARGIN_RESOLUTION) & (most + (_CROOKED + 2.0 * off) * step >= 1.0)
        return not bool(near.any())
