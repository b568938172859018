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
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.cycle.cable_cycle import CableCycles
from cable_shape.cycle.editing import Editing
from cable_shape.errors import ArgumentError
from cable_shape.kernels.safety import advance
from cable_shape.planning.cables_trajectory import check_cables
from cable_shape.planning.harness_trajectory import check_harness
from cable_shape.planning.paths import EndsPath, Motion, Path, Routing
from cable_shape.planning.swing_trajectory import check_swing
from cable_shape.planning.trajectory_report import Reason, TrajectoryCheck, Violation
from cable_shape.planning.trajectory_walk import JUMP, Judge, Look, Walk, accelerations_of, bodies_of
from cable_shape.pose import Grip, Pose
from cable_shape.prediction.edits import Edit
from cable_shape.prediction.layout import Layout
from cable_shape.prediction.turned import TurnedPredictor
from cable_shape.robots.on_links import check_links
from cable_shape.robots.robot import Robot
from cable_shape.scene.scene import Clip, Scene
from cable_shape.shape import Status
from cable_shape.solve.answers import ENDS
from cable_shape.solve.problem import GRAVITY

_NAME = "cable"
#: A step in contact deviates from the straight by no more than this part of it, ...
_CROOKED = 0.25
#: ... if it is longer than this part of the length.
_SHORT = 2e-3


def check_trajectory(
    cable: Cable | Harness | Mapping[str, Cable | Harness],
    scene: Scene | None,
    robot: Robot | None,
    trajectory: Path | EndsPath | Mapping[str, Any] | Sequence[Any] | object,
    *,
    gravity: ArrayLike = GRAVITY,
    points: int = 150,
    tolerance: float | None = None,
    distributed_load: Any = None,
    acceleration: Any = None,
    time_limit: float | None = None,
    proceed: Callable[[TrajectoryCheck], bool] | None = None,
    ends: Mapping[str, Any] | None = None,
    clips: Mapping[str, Sequence[Clip]] | None = None,
    motion: bool = False,
) -> TrajectoryCheck:
    """Whether cables, or a harness, and loads stay within their limits along a trajectory, waypoints and all between.

    A place is not valid where a body is nearer than the scene's `error_distance`, a margin is at its limit, the cable
    is unstable, snaps or has no shape, or a joint is beyond its limit. With ``contact="solve"`` obstacles and the
    robot's links hold the cable out; what it may touch, and how hard, says the scene's `allow`, or, if it names
    nothing, it may touch all obstacles, and no link.

    Parameters
    ----------
    cable : Cable, Harness or mapping of name to Cable or Harness
        With ``contact="solve"`` several are kept out of each other and of themselves; else they are not to come nearer
        to each other than the scene's `error_distance`.
    robot : Robot, optional
        Needed for paths of joints. Its links are bodies around the cable.
    trajectory : JointPath, GripPath or trajectory_msgs/JointTrajectory, or a list of these with edits between them
        Edits (:class:`cable_shape.Insert` and the others) are made where the path before them ends; the next one begins
        at its own first waypoint, after `Regrip` where the gripper holds the cable then. Waypoints are counted through
        all paths; one that cannot be made is the violation of the waypoint before it, and ends the check. Of one cable.
        Of a harness an EndsPath, or the mapping that makes one, in place of a GripPath. Of several cables a mapping of
        name to (starts, ends), tables (k, 7), ends may be a FreeEnd or None, of a harness to a mapping of ends; or an
        EndsPath by "name.start" and "name.end", of a harness "name/a.start".
    tolerance : float, optional
        [m], of the shapes. Default: 1e-4 of the length.
    distributed_load : (2, 3) array_like, optional
        [N/m], world, at s = 0 and s = length, linear between, added to the weight. Of a harness one by segment, of
        several cables one for all, or each its own.
    acceleration : (k, 3) or (k, m, 3) array_like, optional
        [m/s^2], world, of the cable at each of the k waypoints, linear between them; with m rows uniform in arc length
        and linear between them, see :meth:`cable_shape.Predictor.predict`. With two, those of start and end. Default:
        the cable is at rest everywhere, whatever the path's times. Of several cables, and of a harness's segments, a
        mapping by their names.
    time_limit : float, optional
        [s]; after it what is done is returned, marked partial.
    proceed : callable, optional
        Asked before every shape, with `done` and `first` of what is found so far; False ends the check, marked partial.
    ends : mapping of end to "left", "right", FreeEnd, Pose or Grip, optional
        Of a harness or of several cables on a path of joints: what the robot's grippers hold. Of these other ends may
        stand still in a Pose or a Grip.
    clips : mapping of cable name to sequence of Clip, optional
        Of several cables: what holds that one, in place of the scene's `clips`, which hold every cable.
    motion : bool
        As the cable swings (:class:`cable_shape.Motion`) when the trajectory is run at its times, from rest, judged
        every 10 ms and until it has settled after the end; `stops` tells how it comes to rest. Of one cable, or a
        harness, without accelerations.

    Raises
    ------
    ArgumentError
        For unknown joints, times that do not rise, no waypoint or more than 100000, a cable without bending stiffness,
        an acceleration that is not of the path's waypoints, or that is not linear along the cable in contact.
    """
    began = perf_counter()
    checks.instance("cable", cable, (Cable, Harness, Mapping), "Write Cable(length=..., ...).")
    if robot is not None:
        checks.instance("robot", robot, (Robot,), "Write Robot.from_yaml(path).")
    _callable("proceed", proceed)
    if isinstance(trajectory, (list, tuple)) and (motion or not isinstance(cable, Cable)):
        bound = "edits between paths are followed of one cable that does not swing"
        raise ArgumentError.of("trajectory", f"a list of {len(trajectory)}", bound, "Give one path, and check each.")
    deadline = math.inf
    if time_limit is not None:
        deadline = began + checks.number("time_limit", time_limit, above=0.0, unit="s")
    if motion:
        _refuse_of_motion(cable, acceleration=acceleration, clips=clips)
        assert isinstance(cable, (Cable, Harness))
        swung = check_swing(
            cable, scene, robot, trajectory, ends, deadline, proceed, gravity=gravity, points=points,
            distributed_load=distributed_load,
        )  # fmt: skip
        swung.time = perf_counter() - began
        return swung
    if isinstance(cable, Mapping):
        several = check_cables(
            cable, scene, robot, trajectory, ends, deadline, proceed, gravity=gravity, points=points, clips=clips,
            tolerance=tolerance, distributed_load=distributed_load, acceleration=acceleration,
        )  # fmt: skip
        several.time = perf_counter() - began
        return several
    if clips is not None:
        raise ArgumentError.of("clips", clips, "it is of several cables", "Write scene=Scene(clips=[...]).")
    if isinstance(cable, Harness):
        return check_harness(
            cable, scene, robot, trajectory, ends, deadline, proceed, gravity=gravity, points=points,
            tolerance=tolerance, distributed_load=distributed_load, acceleration=acceleration,
        )  # fmt: skip
    if ends is not None:
        raise ArgumentError.of("ends", ends, "a cable has a start and an end", "Leave them out, or give a Harness.")
    if scene is not None:
        checks.instance("scene", scene, (Scene,), "Write Scene(obstacles=[...]), or Scene.from_yaml(path).")
    routing = Routing.of(trajectory if isinstance(trajectory, (list, tuple)) else (trajectory,))
    found = check_laid(
        Layout.of(scene or Scene(), {_NAME: cable}, {}), _NAME, robot, routing, deadline, proceed, gravity=gravity,
        points=points, tolerance=tolerance, distributed_load=distributed_load, acceleration=acceleration,
    )  # fmt: skip
    found.time = perf_counter() - began
    return found


def check_laid(
    layout: Layout,
    name: str,
    robot: Robot | None,
    routing: Routing,
    deadline: float = math.inf,
    proceed: Callable[[TrajectoryCheck], bool] | None = None,
    *,
    gravity: ArrayLike,
    points: int,
    tolerance: float | None,
    distributed_load: Any = None,
    acceleration: Any = None,
) -> TrajectoryCheck:
    """What :func:`check_trajectory` says, of a cable as edits have left it; one that hangs free has only one grip.

    deadline: on the clock of :func:`time.perf_counter` [s].
    """
    began = perf_counter()
    layout = Layout(layout.scene, {_NAME: layout.cables[name]})
    way = Motion(routing.path, robot)
    check_links(way.robot, layout.scene_of(_NAME))
    allowed = 1e-4 * layout.cables[_NAME].cable.length if tolerance is None else tolerance
    options = {"gravity": gravity, "points": points, "robot_links": (), "gripping_links": (), **bodies_of(robot)}
    maker = CableCycles("cosserat", allowed, options, {_NAME: distributed_load}, {}, {}, 0.0, None, 1)
    check = _Check(layout, maker, way, deadline, proceed, routing.edits)
    if acceleration is not None:
        check.accelerations = accelerations_of(acceleration, way.waypoints, check.cycle.predictor.accelerate)
    check.run()
    check.found.time = perf_counter() - began
    return check.found


def _refuse_of_motion(cable: object, **given: object) -> None:
    """Refuses what is not for a cable that swings."""
    remedy = "Leave it out, or motion=True."
    if not isinstance(cable, (Cable, Harness)):
        raise ArgumentError.of("motion", True, "only one cable, or a harness, is followed as it swings", remedy)
    for name, value in given.items():
        if value is not None:
            raise ArgumentError.of(name, value, "it is not known of a cable that swings", remedy)


def _callable(name: str, value: object) -> None:
    if value is not None and not callable(value):
        raise ArgumentError.of(name, value, "it must be a function", "Leave it out, or give one.")


class _Sample(NamedTuple):
    """One place that was solved for."""

    place: float
    look: Look
    ends: Array  # (k, 7), of the cable, and of its clips on links
    links: Array  # (l, 7)
    sensitivity: Array  # (n, 3, 6 k)
    violation: Violation | None
    spots: Any  # where the cable touches itself


@final
class _Check(Walk[_Sample]):
    """One call of :func:`check_trajectory` with a cable."""

    def __init__(
        self,
        layout: Layout,
        maker: CableCycles,
        motion: Motion,
        deadline: float,
        proceed: Callable[[TrajectoryCheck], bool] | None,
        edits: Mapping[int, tuple[Edit, ...]],
    ) -> None:
        super().__init__(motion, deadline, proceed, edits)
        self.maker, self.layout = maker, layout
        laid, load = layout.cables[_NAME], maker.distributed_load[_NAME]
        self.cycle = maker.make(_NAME, laid.cable, layout.scene_of(_NAME), load, turned=laid.opened == "start")
        self.accelerations: Array | None = None
        self.judge = self._judged()

    def tell(self, samples: list[_Sample]) -> None:
        """See the base."""
        for i, sample in enumerate(samples):
            self.found.clearance[i] = self.judge.nearest(sample.look)
        rest = self.motion.waypoints - len(samples)
        self.found.margins = (*(sample.look.margins for sample in samples), *((),) * rest)

    def jump(self, a: _Sample, b: _Sample) -> float:
        """See the base."""
        far = float(np.linalg.norm(b.look.shape.positions - a.look.shape.positions, axis=1).max())
        return 0.0 if far < JUMP * a.look.shape.length else far

    def sample(self, place: float) -> _Sample:
        """The shape there and all that is told of it."""
        (start, end), links = self._at(place)
        moving = None if self.accelerations is None else self.motion.between(self.accelerations, place)
        predictor = self.cycle.predictor
        shape = self.cycle.predict((start, end), links, acceleration=moving)
        look = self.judge.look(shape, links, predictor.rod_state, held=start is not None and end is not None)
        self.found.solved += 1
        frames = [(grip.cable_frame if isinstance(grip, Grip) else grip).array for grip in (start or end, end or start)]
        names, placed = predictor.problem.moving_clips
        good = bool(shape.status) and shape.status is not Status.UNSTABLE
        slopes = np.empty(0)
        if good:
            slopes = predictor.sensitivity((*ENDS, *names) if names else ENDS)
        wrong = self.no_shape(place, shape.status, shape.detail) or self.judge.wrong(look, place, self)
        crossing = predictor.crossing
        spots = None if crossing is None or crossing.last is None else crossing.last[1]
        return _Sample(place, look, np.array([*frames, *placed]), self.judge.frames(links), slopes, wrong, spots)

    def astray(self, a: _Sample, b: _Sample) -> bool:
        """See the base."""
        if b.violation is not None:
            return b.violation.reason in (Reason.SNAP, Reason.STATUS)
        return not self._followed(a, b, *self._moved(a, b))

    def go_back(self, a: _Sample) -> None:
        """See the base."""
        ends, links = self._at(a.place)
        self.cycle.predictor.begin(a.look.shape, ends, links, spots=a.spots)
        self.cycle.predictor.look_again()

    def _at(self, place: float) -> tuple[Any, Mapping[str, Pose] | None]:
        """What holds the ends there, and the links."""
        (start, end), links = self.motion.at(place)
        opened = self.layout.cables[_NAME].opened
        return (None if opened == "start" else start, None if opened == "end" else end), links

    def edit(self, edits: tuple[Edit, ...], last: _Sample) -> str:
        """See the base."""
        if last.look.shape.status:
            self.go_back(last)
            self.sample(last.place)
        editing = Editing(self.layout, {_NAME: self.cycle}, self.maker, None, None)
        try:
            for edit in edits:
                editing.take(edit, None)
        except ArgumentError as error:
            return str(error)
        self.layout, self.cycle = editing.layout, editing.singles[_NAME]
        self.judge = self._judged()
        return ""

    def _judged(self) -> Judge:
        """Of the cable as it is held now."""
        turned = isinstance(self.cycle.predictor, TurnedPredictor)
        return Judge(self.cycle.predictor.cable, self.cycle.scene, self.motion.robot, turned=turned)

    def sure(self, a: _Sample, b: _Sample) -> bool:
        """See the base."""
        turned, reach = self.motion.turned(a.place, b.place), self.motion.reach
        aside = 0.25 * turned * turned * reach
        way, off = self._moved(a, b)
        return self._followed(a, b, way, off) and self.judge.sure(
            a.look, b.look, (a.links, b.links), way, off, aside
        )  # fmt: skip

    def _followed(self, a: _Sample, b: _Sample, way: float, off: float) -> bool:
        """Whether the cable has moved as its sensitivities say, by `way` [m] and off it by `off`: on one branch.

        In contact, branches begin near each other: there a step that is not short is to be straight.
        """
        length = a.look.shape.length
        if off > JUMP * length:
            return False
        free = not a.look.shape.touches.size and not b.look.shape.touches.size
        return free or way <= _SHORT * length or off <= _CROOKED * way

    def _moved(self, a: _Sample, b: _Sample) -> tuple[float, float]:
        """[m], how far the cable's points move from a to b, and off the straight."""
        turned = self.motion.turned(a.place, b.place)
        way, off = advance.motion(
            a.look.shape.positions, b.look.shape.positions, a.sensitivity, b.sensitivity, a.ends, b.ends,
            0.125 * turned * turned, self.motion.reach,
        )  # fmt: skip
        return way, off
