"""A whole motion at once: :func:`check_trajectory`, so that no violation hides between two waypoints.

Between two solved places of a path the cable's points move nearly as their positions and the sensitivities there say:
along the chord D from one to the other, and a little beside it. The cubic through both positions with the velocities
v_a and v_b at which the rod answers the grips' motion leaves the chord by at most 4/27 (\\|v_a - D\\| + \\|v_b - D\\|).
So much, with a factor for what is no cubic, and what the joints' motion leaves the straight by, is E. A signed distance
changes by no more than its points move, so that between two places it is nowhere below

    (d_a + d_b - max \\|D\\|) / 2 - E,

D being taken in the frame of a link where the body is on one. Where that is below the limit, or a load might reach its
own, or the cable does not move as its sensitivities say, the place half way is solved for, too: conservative
advancement, until what might hide is below the resolution. Where an acceleration changes along the way, too, the points
move by w more, nearly evenly: the cubic is off by 4/27 \\|v_a - v_b\\| then, and E, which has w in D only, no smaller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from time import perf_counter
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape import checks
from cable_shape.cable import Cable
from cable_shape.checks import Array
from cable_shape.clearance import DEEPEST_REST, ClearanceChecker
from cable_shape.errors import ArgumentError
from cable_shape.kernels import advance
from cable_shape.kernels.rod_algebra import qexp, qmul
from cable_shape.margins import MarginWatch
from cable_shape.paths import GripPath, JointPath, Motion, Path
from cable_shape.pose import Grip, Pose, as_grip
from cable_shape.predictor import Predictor
from cable_shape.problem import GRAVITY, swing_of
from cable_shape.report import LOAD_MARGINS, Margin, WarningKind
from cable_shape.robot import Robot
from cable_shape.scene import Scene
from cable_shape.shape import CableShape, Status
from cable_shape.trajectory_report import Reason, TrajectoryCheck, Violation
from cable_shape.warn import metres

#: [m]: what may hide between two places is smaller than this, ...
RESOLUTION = 1e-4
#: ... for margins this, ...
MARGIN_RESOLUTION = 1e-3
#: ... and places nearer to each other than this fraction of a segment are one.
MOST_HALVINGS = 12
#: A deviation above this fraction of the length is a jump, where it does not shrink with the step.
_JUMP = 0.02
#: Loads below this part of their limit do not reach it within a step that the cable's points are sure of.
_CALM = 0.3
#: This part of a load's change, and twice what the points deviate beside their way, it may rise above both ends.
_CROOKED = 0.25
#: The first violation is told to this fraction of a segment.
_PLACE = 1e-3
#: Of the length, and [rad]: by which ends are moved for differences.
_STEP = 1e-3
#: Joints are not beyond their limits by less than this [rad] or [m].
_ROUNDING = 1e-9


def check_trajectory(
    cable: Cable,
    scene: Scene | None,
    robot: Robot | None,
    trajectory: Path | object,
    *,
    gravity: ArrayLike = GRAVITY,
    points: int = 150,
    tolerance: float | None = None,
    distributed_load: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    time_limit: float | None = None,
    proceed: Callable[[TrajectoryCheck], bool] | None = None,
) -> TrajectoryCheck:
    """Whether the cable and its loads stay within their limits along a trajectory, waypoints and all between.

    A place is not valid where a body is nearer than the scene's `error_distance`, a margin is at its limit, the cable
    is unstable, snaps or has no shape, or a joint is beyond its limit.

    Parameters
    ----------
    robot : Robot, optional
        Needed for paths of joints. Its links are bodies around the cable.
    trajectory : JointPath, GripPath or trajectory_msgs/JointTrajectory
    tolerance : float, optional
        [m], of the shapes. Default: 1e-4 of the length.
    distributed_load : (2, 3) array_like, optional
        [N/m], world, at s = 0 and s = length, linear between, added to the weight.
    acceleration : (k, 3) or (k, m, 3) array_like, optional
        [m/s^2], world, of the cable at each of the k waypoints, linear between them; with m rows uniform in arc length
        and linear between them, see :meth:`cable_shape.Predictor.predict`. With two, those of start and end. Default:
        the cable is at rest everywhere, whatever the path's times.
    time_limit : float, optional
        [s]; after it what is done is returned, marked partial.
    proceed : callable, optional
        Asked before every shape, with `done` and `first` of what is found so far; False ends the check, marked partial.

    Raises
    ------
    ArgumentError
        For unknown joints, times that do not rise, no waypoint or more than 100000, a cable without bending stiffness,
        an acceleration that is not of the path's waypoints, or that is not linear along the cable in contact.
    """
    began = perf_counter()
    if not isinstance(cable, Cable):
        raise ArgumentError.of("cable", cable, "it must be a Cable", "Write Cable(length=..., ...).")
    if robot is not None:
        checks.instance("robot", robot, (Robot,), "Write Robot.from_yaml(path).")
    _callable("proceed", proceed)
    path = trajectory if isinstance(trajectory, (JointPath, GripPath)) else JointPath.from_message(trajectory)
    deadline = math.inf
    if time_limit is not None:
        deadline = began + checks.number("time_limit", time_limit, above=0.0, unit="s")
    predictor = Predictor(
        cable,
        model="cosserat",
        gravity=gravity,
        points=points,
        tolerance=1e-4 * cable.length if tolerance is None else tolerance,
        scene=scene,
        distributed_load=distributed_load,
    )
    motion = Motion(path, robot)
    moving = None if acceleration is None else _accelerations(acceleration, motion.waypoints, predictor)
    check = _Check(predictor, scene or Scene(), motion, moving, deadline, proceed)
    check.run()
    check.found.time = perf_counter() - began
    return check.found


def beside(start: Pose | Grip, end: Pose | Grip, far: float) -> Iterator[tuple[Grip, Grip]]:
    """The ends with each moved in turn by `far` [m] along x, y, z, and by _STEP [rad] about them."""
    grips = as_grip("start", start), as_grip("end", end)
    for side, grip in enumerate(grips):
        frame = grip.cable_frame
        for column in range(6):
            step = np.zeros(6)
            step[column] = far if column < 3 else _STEP
            turned = qmul(qexp(tuple(step[3:])), tuple(frame.quaternion))
            moved = Grip(Pose(frame.position + step[:3], turned), grip.kind, curvature=grip.curvature)
            yield (moved, grips[1]) if side == 0 else (grips[0], moved)


def _callable(name: str, value: object) -> None:
    if value is not None and not callable(value):
        raise ArgumentError.of(name, value, "it must be a function", "Leave it out, or give one.")


def _accelerations(value: ArrayLike, waypoints: int, predictor: Predictor) -> Array:
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


class _Sample(NamedTuple):
    """One place that was solved for."""

    place: float
    shape: CableShape
    ends: Array  # (2, 7), of the cable
    links: Array  # (l, 7)
    sensitivity: Array  # (n, 3, 12)
    distances: Array  # (m,) [m], at most the horizon
    used: Array  # of the loads, by _LOADS
    violation: Violation | None
    margins: tuple[Margin, ...]


_CLEARANCE = WarningKind.CLEARANCE
#: Where each margin but those of bodies stands in a sample, by the value of its kind.
_LOADS = {kind.value: i for i, kind in enumerate(LOAD_MARGINS)}


@final
class _Check:
    """One call of :func:`check_trajectory`."""

    def __init__(
        self,
        predictor: Predictor,
        scene: Scene,
        motion: Motion,
        accelerations: Array | None,
        deadline: float,
        proceed: Callable[[TrajectoryCheck], bool] | None,
    ) -> None:
        cable = predictor.cable
        self.predictor, self.scene, self.motion = predictor, scene, motion
        self.accelerations = accelerations
        self.deadline, self.proceed = deadline, proceed
        robot = motion.robot
        self.checker = ClearanceChecker(
            Scene(obstacles=() if scene.contact == "off" else scene.obstacles, error_distance=scene.error_distance),
            radius=0.5 * cable.diameter,
            robot_links=() if robot is None or scene.contact == "off" else robot.link_geometry,
            gripping_links=() if robot is None else robot.gripping_links,
        )
        self.watch = MarginWatch(cable, scene, self.checker.moving)
        #: (m,), row in a sample's links of each body, -1: it stands still
        self.on_link = self.checker.tables[0][:, 11].astype(np.int64)
        resting = np.full(len(self.on_link), scene.contact == "solve") & (self.on_link < 0)
        self.limits: Array = np.where(resting, -DEEPEST_REST, scene.error_distance)
        self.outside: NDArray[np.bool_] = np.zeros(motion.waypoints, np.bool_)
        if robot is not None:
            joints = motion.joints
            self.outside[:] = ((joints > robot.upper + _ROUNDING) | (joints < robot.lower - _ROUNDING)).any(axis=1)
        self.found = TrajectoryCheck(motion.waypoints)
        self.late = False

    def run(self) -> None:
        """Waypoint by waypoint."""
        found, waypoints, margins = self.found, [], []
        before: _Sample | None = None
        for i in range(self.motion.waypoints):
            if self._out_of_time():
                break
            now = self._sample(float(i))
            waypoints.append(now.violation)
            margins.append(now.margins)
            found.done[i] = True
            found.clearance[i] = self._clearance(now)
            if before is None:
                found.first = now.violation
            elif before.violation is None:
                between = self._first(before, now, 0)
                found.segments[i - 1] = between is None and not self.late
                found.first = found.first or between
            before = now
        rest = self.motion.waypoints - len(waypoints)
        found.partial = self.late
        found.waypoints = (*waypoints, *(None,) * rest)
        found.margins = (*margins, *((),) * rest)
        found.robot_checked = self.motion.robot is not None

    def _out_of_time(self) -> bool:
        self.late = self.late or perf_counter() > self.deadline
        self.late = self.late or (self.proceed is not None and not self.proceed(self.found))
        return self.late

    def _clearance(self, sample: _Sample) -> float:
        """[m], infinite beyond the horizon."""
        if not sample.distances.size:
            return math.inf
        least = float(sample.distances.min())
        return math.inf if least >= self.checker.horizon else least

    def _first(self, a: _Sample, b: _Sample, halvings: int) -> Violation | None:
        """The first violation after the valid place a, up to b; None if there is none."""
        if b.violation is None:
            if self._sure(a, b):
                return None
            if halvings == MOST_HALVINGS:
                return self._jump(a, b)
        elif b.place - a.place <= _PLACE or halvings == MOST_HALVINGS:
            return b.violation
        if self._out_of_time():
            return b.violation
        middle = self._sample(0.5 * (a.place + b.place))
        return self._first(a, middle, halvings + 1) or (middle.violation or self._first(middle, b, halvings + 1))

    def _jump(self, a: _Sample, b: _Sample) -> Violation | None:
        """Two places as good as one: the cable has snapped between them, or nothing is wrong."""
        far = float(np.linalg.norm(b.shape.positions - a.shape.positions, axis=1).max())
        if far < _JUMP * a.shape.length:
            return None
        return self._violation(Reason.SNAP, b.place, f"the cable snaps to another shape {metres(far)} away", value=far)

    # -- one place

    def _sample(self, place: float) -> _Sample:
        """The shape there and all that is told of it."""
        start, end, links = self.motion.at(place)
        moving = None if self.accelerations is None else self.motion.between(self.accelerations, place)
        shape = self.predictor.predict(start, end, acceleration=moving)
        clearance = self.checker.check(shape, links)
        margins = self.watch.margins(shape, clearance, 0, state=self.predictor.rod_state, held=True)
        used = [math.nan] * len(_LOADS)
        for margin in margins:
            if margin.kind is _CLEARANCE:
                break  # those of bodies come last
            used[_LOADS[margin.kind.value]] = margin.used
        table = clearance.table
        distances = np.empty(0) if table is None else np.minimum(table[:, 0], self.checker.horizon)
        self.found.solved += 1
        frames = [(grip.cable_frame if isinstance(grip, Grip) else grip).array for grip in (start, end)]
        poses = [] if links is None else [links[name].array for name in self.checker.links]
        good = bool(shape.status) and shape.status is not Status.UNSTABLE
        slopes = np.empty(0)
        if good:
            slopes = (
                self._differences(shape, start, end, links, moving)
                if self.predictor.touching
                else (self.predictor.sensitivity())
            )
        return _Sample(
            place,
            shape,
            np.array(frames),
            np.array(poses).reshape(-1, 7),
            slopes,
            distances,
            np.array(used),
            self._judge(place, shape, distances, margins),
            margins,
        )

    def _differences(
        self,
        shape: CableShape,
        start: Pose | Grip,
        end: Pose | Grip,
        links: Mapping[str, Pose] | None,
        moving: Array | None,
    ) -> Array:
        """(n, 3, 12), the sensitivity of a cable that touches itself, by differences; NaN where one has no shape."""
        out = np.full((shape.points, 3, 12), math.nan)
        for column, ends in enumerate(beside(start, end, _STEP * shape.length)):
            other = self.predictor.predict(*ends, links, acceleration=moving)
            if other.usable:
                step = _STEP * shape.length if column % 6 < 3 else _STEP
                out[:, :, column] = (other.positions - shape.positions) / step
        self.predictor.predict(start, end, links, acceleration=moving)
        return out

    def _judge(
        self, place: float, shape: CableShape, distances: Array, margins: tuple[Margin, ...]
    ) -> Violation | None:
        """What is wrong there; the gravest first."""
        beyond = self._beyond_limits(place)
        if beyond is not None:
            return beyond
        status = shape.status
        if status is not Status.OK and status is not Status.BUDGET:
            reason = {Status.SNAPPED: Reason.SNAP, Status.OVERSTRETCHED: Reason.OVERSTRETCHED}.get(
                status, Reason.STATUS
            )
            return self._violation(reason, place, f"{status.name}: {shape.detail or status.remedy}")
        near = distances - self.limits[: len(distances)]
        body = int(near.argmin()) if near.size else -1
        if body >= 0 and near[body] < 0.0:
            name = self.checker.names[body]
            at = next((m.arc_length for m in margins if m.other == name), math.nan)
            text = f"{metres(float(distances[body]))} from {name!r}, at least {metres(float(self.limits[body]))} asked"
            return self._violation(
                Reason.CLEARANCE, place, text, float(distances[body]), float(self.limits[body]), name, at
            )
        for margin in margins:
            if margin.used >= 1.0 and margin.kind is not _CLEARANCE:
                reason = Reason[margin.kind.name]
                text = f"{reason.value} {margin.value:.4g}, limit {margin.limit:.4g}"
                return self._violation(reason, place, text, margin.value, margin.limit, "", margin.arc_length)
        return None

    def _beyond_limits(self, place: float) -> Violation | None:
        """A joint beyond its limits: between two waypoints it is no further out than at them."""
        robot, i = self.motion.robot, min(math.ceil(place), self.motion.waypoints - 1)
        if robot is None or not (self.outside[i] or self.outside[max(i - 1, 0)]):
            return None
        q = self.motion.joint_positions(place)
        out = np.maximum(q - robot.upper, robot.lower - q)
        worst = int(out.argmax())
        if not out[worst] > _ROUNDING:
            return None
        limit = float(robot.upper[worst] if q[worst] > robot.upper[worst] else robot.lower[worst])
        name = robot.joint_names[worst]
        text = f"joint {name!r} at {q[worst]:.4g}, limit {limit:.4g}"
        return self._violation(Reason.JOINT_LIMIT, place, text, float(q[worst]), limit, name)

    def _violation(
        self,
        reason: Reason,
        place: float,
        text: str,
        value: float = math.nan,
        limit: float = math.nan,
        other: str = "",
        arc_length: float = math.nan,
    ) -> Violation:
        times = self.motion.times
        time = math.nan if times is None else float(np.interp(place, np.arange(len(times)), times))
        return Violation(reason, place, time, f"waypoint {place:.4g}: {text}", value, limit, other, arc_length)

    # -- between two places

    def _sure(self, a: _Sample, b: _Sample) -> bool:
        """Whether nothing can be wrong between two valid places."""
        turned = self.motion.turned(a.place, b.place)
        way, off = advance.motion(
            a.shape.positions, b.shape.positions, a.sensitivity, b.sensitivity, a.ends, b.ends,
            0.125 * turned * turned, self.motion.reach,
        )  # fmt: skip
        if not off <= _JUMP * a.shape.length or not self._loads_sure(a, b, off / way if way > 0.0 else 0.0):
            return False
        if not a.distances.size:
            return True
        left = advance.least_left(
            a.shape.positions, b.shape.positions, a.distances, b.distances, self.limits, self.on_link, a.links,
            b.links, way, off, 0.25 * turned * turned * self.motion.reach, RESOLUTION,
        )  # fmt: skip
        return bool(left >= 0.0)

    def _loads_sure(self, a: _Sample, b: _Sample, off: float) -> bool:
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
