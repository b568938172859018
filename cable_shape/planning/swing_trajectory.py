"""A timed trajectory with the cable as it swings, `check_trajectory(..., motion=True)`, and how it settles at stops."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness, split_end
from cable_shape.errors import ArgumentError
from cable_shape.motion.harness_motion import HarnessMotion
from cable_shape.motion.motion import Motion
from cable_shape.planning.harness_trajectory import path_of
from cable_shape.planning.paths import EndsPath, GripPath, JointPath, Path
from cable_shape.planning.paths import Motion as PathMotion
from cable_shape.planning.trajectory_report import Stop, TrajectoryCheck, Violation
from cable_shape.planning.trajectory_walk import Judge, Look, Walk, bodies_of
from cable_shape.pose import FreeEnd, Grip
from cable_shape.robots.on_links import check_links
from cable_shape.robots.robot import Robot
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape
from cable_shape.solve.harness_shape import HarnessShape

#: [s], the longest step in time; how long a cable is followed after a stop.
STEP, AFTER = 0.0101, 10.0
#: [s], of a trajectory at most.
LONGEST = 3600.0
#: Of the length: as near to where it hangs at last a cable is settled.
SETTLED = 2e-3
#: m, of a pose: what moves less between two waypoints stands still.
_STILL = 1e-9


class _Place(NamedTuple):
    """The cable, or harness, when the grips are at a place."""

    place: float
    violation: Violation | None
    looks: dict[str, Look]  # by segment, of a cable by ""; empty: there is no shape


def check_swing(
    cable: Cable | Harness,
    scene: Scene | None,
    robot: Robot | None,
    trajectory: Any,
    ends: Mapping[str, Any] | None,
    deadline: float,
    proceed: Callable[[TrajectoryCheck], bool] | None,
    **options: Any,
) -> TrajectoryCheck:
    """See :func:`cable_shape.check_trajectory` with `motion`; options: keywords of `Motion`.

    Raises
    ------
    ArgumentError
        For a path without times, and for what does not swing.
    """
    free: Mapping[str, FreeEnd] = {}
    held: tuple[str, ...] = ()
    path: Path | EndsPath
    if isinstance(cable, Harness):
        path, held, free = path_of(trajectory, ends)
    elif ends is not None:
        raise ArgumentError.of("ends", ends, "a cable has a start and an end", "Leave them out, or give a Harness.")
    else:
        path = trajectory if isinstance(trajectory, (JointPath, GripPath)) else JointPath.from_message(trajectory)
    if path.times is None:
        raise ArgumentError.of("times", None, "a cable swings in time", "Write GripPath(starts, ends, times).")
    whole = float(path.times[-1] - path.times[0])
    if whole > LONGEST:
        bound = f"with motion=True they may take {LONGEST:g} s at most"
        raise ArgumentError.of("times", whole, bound, "Give seconds, or check parts of it.")
    own = scene or Scene()
    swung: Motion | HarnessMotion
    if isinstance(cable, Harness):
        swung = HarnessMotion(cable, scene, **options, **bodies_of(robot))
        gripped = {split_end(end)[0] for end in held}
        judges = {name: Judge(one, own, robot, name, name in gripped) for name, one in cable.segments.items()}
        check_links(robot, scene)
    else:
        swung, judges = Motion(cable, scene, **options, **bodies_of(robot)), {"": Judge(cable, own, robot)}
    swing = _Swing(swung, judges, PathMotion(path, robot), held, free)
    swing.deadline, swing.proceed = deadline, proceed
    swing.run()
    return swing.found


@final
class _Swing(Walk[_Place]):
    """One run of a trajectory, from rest at its first waypoint to rest after the last one."""

    def __init__(
        self,
        swung: Motion | HarnessMotion,
        judges: Mapping[str, Judge],
        path: PathMotion,
        held: tuple[str, ...],
        free: Mapping[str, FreeEnd],
    ) -> None:
        super().__init__(path, math.inf, None)
        self.swung, self.judges, self.held, self.free = swung, judges, held, free

    def run(self) -> None:
        """Step by step; see the base for what is told."""
        found, motion, times = self.found, self.motion, self.motion.times
        assert times is not None
        looks = [self._begin()]
        stops: list[Stop] = []
        for i in range(motion.waypoints):
            if i > 0:
                if not looks[-1].looks or self._out_of_time():
                    break
                there, between = self._go(i, float(times[i] - times[i - 1]))
                looks.append(there)
                found.segments[i - 1] = between is None and looks[-2].violation is None
                found.first = found.first or between
            found.done[i] = True
            found.first = found.first or looks[-1].violation
            if looks[-1].looks and i > 0 and self._stands(i):
                stops.append(self._stop(i))
        found.partial, found.stops = self.late, tuple(stops)
        found.waypoints = (*(one.violation for one in looks), *(None,) * (motion.waypoints - len(looks)))
        found.robot_checked = motion.robot is not None
        self.tell(looks)

    def tell(self, samples: list[_Place]) -> None:
        """See the base."""
        found, rest = self.found, ((),) * (self.motion.waypoints - len(samples))
        for i, one in enumerate(samples):
            near = [self.judges[name].nearest(look) for name, look in one.looks.items()]
            found.clearance[i] = min(near, default=math.nan)
        of = {name: (*(one.looks[name].margins if one.looks else () for one in samples), *rest) for name in self.judges}
        found.margins = tuple(sum(told, ()) for told in zip(*of.values(), strict=True))
        found.margins_of = {} if "" in of else of

    def sample(self, place: float) -> _Place:
        """See the base: there is no shape of a place alone."""
        raise NotImplementedError

    def sure(self, a: _Place, b: _Place) -> bool:
        """See the base."""
        raise NotImplementedError

    def jump(self, a: _Place, b: _Place) -> float:
        """See the base."""
        return 0.0

    def _begin(self) -> _Place:
        """At rest at the first waypoint."""
        grips, links = self.motion.at(0.0)
        if isinstance(self.swung, Motion):
            start, end = grips
            return self._judged(self.swung.begin(start, end, links=links), 0.0)
        return self._judged(self.swung.begin(self._named(grips), links=links), 0.0)

    def _named(self, grips: Sequence[Any]) -> dict[str, Any]:
        """The ends of a harness."""
        return {**dict(zip(self.held, grips, strict=True)), **self.free}

    def _judged(self, shape: CableShape | HarnessShape, place: float) -> _Place:
        """A shape with the grips at this place."""
        self.found.solved += 1
        _, links = self.motion.at(place)
        looks = {}
        if shape.status:
            looks = {name: self.judges[name].look(one, links, held=True) for name, one in _parts(shape).items()}
        wrong = self.no_shape(place, shape.status, shape.detail)
        for name, look in looks.items():
            wrong = wrong or self.judges[name].wrong(look, place, self)
        return _Place(place, wrong, looks)

    def _go(self, i: int, seconds: float) -> tuple[_Place, Violation | None]:
        """To waypoint i from the one before; and the first that is wrong on the way, that waypoint included."""
        first = None
        steps = max(1, math.ceil(seconds / STEP))
        for k in range(1, steps + 1):
            place = i - 1 + k / steps if k < steps else float(i)
            grips, links = self.motion.at(place)
            shape: CableShape | HarnessShape
            if isinstance(self.swung, Motion):
                start, end = grips
                shape = self.swung.step(start, end, seconds / steps, links)
            else:
                shape = self.swung.step(self._named(grips), seconds / steps, links)
            there = self._judged(shape, place)
            first = first or there.violation
            if not there.looks:
                break
        return there, first

    def _stands(self, i: int) -> bool:
        """Whether the grips stand still from waypoint i on, and moved to it."""
        if i + 1 < self.motion.waypoints and self._way(i, i + 1) > _STILL:
            return False
        return self._way(i - 1, i) > _STILL

    def _way(self, a: int, b: int) -> float:
        """By how much poses of the grips differ between two waypoints."""
        frames = [
            [(grip.cable_frame if isinstance(grip, Grip) else grip).array for grip in self.motion.at(float(i))[0]]
            for i in (a, b)
        ]
        return float(np.abs(np.array(frames[0]) - np.array(frames[1])).max())

    def _stop(self, i: int) -> Stop:
        """How the cable comes to rest if the grips stay at waypoint i, where it is judged, too, if that is the last."""
        assert self.motion.times is not None
        steps = round(AFTER / 0.01)
        shapes = [self.swung.last, *self.swung.ahead(steps, 0.01)]
        places = np.array([np.concatenate([one.positions for one in _parts(shape).values()]) for shape in shapes])
        rest, still = places[-1], SETTLED * max(one.length for one in _parts(shapes[0]).values())
        off = np.linalg.norm(places - rest, axis=2).max(axis=1)
        velocity = shapes[-1].velocity
        moving = velocity is None or float(np.abs(velocity).max()) > still  # in a second it is elsewhere
        late = np.flatnonzero(off > still)
        settling = math.inf if moving or len(shapes) <= steps else 0.01 * (int(late[-1]) + 1 if late.size else 0)
        if i == self.motion.waypoints - 1:
            until = len(shapes) if settling == math.inf else 1 + round(settling / 0.01)
            for shape in shapes[1:until]:
                self.found.first = self.found.first or self._judged(shape, float(i)).violation
        return Stop(float(i), float(self.motion.times[i]), settling, float(off.max()))


def _parts(shape: CableShape | HarnessShape) -> Mapping[str, CableShape]:
    """The segments of a harness by their names, a cable by ""."""
    return shape.segments if isinstance(shape, HarnessShape) else {"": shape}
