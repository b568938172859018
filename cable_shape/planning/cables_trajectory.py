"""A whole motion of several cables: what :func:`cable_shape.check_trajectory` makes of one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.harness import SIDES, split_end
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.kernels.safety import advance
from cable_shape.planning.harness_trajectory import GRIPPERS, motion_of
from cable_shape.planning.paths import EndsPath, GripPath, JointPath, Motion
from cable_shape.planning.trajectory_report import Reason, TrajectoryCheck, Violation
from cable_shape.planning.trajectory_walk import (
    RESOLUTION,
    Judge,
    Look,
    Walk,
    accelerations_of,
    bodies_of,
    jumped,
)
from cable_shape.pose import FreeEnd, Grip, Pose, as_grip
from cable_shape.prediction.cables_predictor import CablesPredictor, named_cables, of_all
from cable_shape.robots.on_links import check_links
from cable_shape.robots.robot import Robot
from cable_shape.safety.near import CableNear
from cable_shape.safety.report import Clearance
from cable_shape.safety.warnings import metres
from cable_shape.scene.scene import Scene
from cable_shape.shape import Status

_WRITE = "Write {name of the cable: (starts, ends)} of every cable, tables (k, 7); ends may be a FreeEnd or None."
_HELD = "Write ends={'a.start': 'left', 'a.end': 'right', 'b.start': Pose(...), 'b.end': FreeEnd()}."

End = Pose | Grip | FreeEnd


def check_cables(
    cables: Mapping[str, Any],
    scene: Scene | None,
    robot: Robot | None,
    trajectory: Any,
    ends: Mapping[str, Any] | None,
    deadline: float,
    proceed: Callable[[TrajectoryCheck], bool] | None,
    *,
    tolerance: float | None,
    acceleration: Mapping[str, Any] | None,
    **options: Any,
) -> TrajectoryCheck:
    """What :func:`cable_shape.check_trajectory` says; options: keywords of a CablesPredictor."""
    longest = max(cable.length for cable in named_cables(cables).values())
    allowed = 1e-4 * longest if tolerance is None else tolerance
    predictor = CablesPredictor(
        cables, model="cosserat", scene=scene, tolerance=allowed, **bodies_of(robot), **options
    )  # fmt: skip
    if isinstance(trajectory, GripPath):
        raise ArgumentError.of("trajectory", trajectory, "there are several cables", _WRITE)
    path = _path(trajectory, predictor) if isinstance(trajectory, Mapping) else trajectory
    still: dict[str, End] = {}
    if isinstance(path, EndsPath):
        if ends is not None:
            raise ArgumentError.of("ends", dict(ends), "the trajectory says which are held", "Leave them out.")
        held, still = path.held, dict(path.free)
    else:
        path = path if isinstance(path, JointPath) else JointPath.from_message(path)
        held, still = _held(ends)
    for end in (*held, *still):
        if end not in {f"{name}.{side}" for name in predictor.predictors for side in SIDES}:
            raise UnknownKeyError.among(
                "ends", end, [f"{name}.{side}" for name in predictor.predictors for side in SIDES]
            )
    for name in predictor.predictors:
        if f"{name}.start" not in held and not isinstance(still.get(f"{name}.start"), (Pose, Grip)):
            raise ArgumentError.of("ends", sorted((*held, *still)), f"nothing holds the start of cable {name!r}", _HELD)
    motion = Motion(path, robot)
    for own in predictor.scenes.values():
        check_links(motion.robot, own)
    moves = checks.mapping("acceleration", acceleration, predictor.predictors, "Write {name of the cable: (k, 3)}.")
    moving = {}
    for name, table in moves.items():
        try:
            moving[name] = accelerations_of(table, motion.waypoints, predictor.predictors[name].accelerate)
        except ArgumentError as error:
            raise ArgumentError(f"acceleration[{name!r}]: {error}") from None
    walk = _Walk(predictor, scene or Scene(), motion, held, still, moving, deadline, proceed)
    walk.run()
    return walk.found


def _path(tables: Mapping[str, Any], among: CablesPredictor) -> EndsPath:
    """The waypoints of all ends, by "cable.start" and "cable.end"."""
    told = {}
    for name, both in of_all("trajectory", tables, among.predictors, _WRITE).items():
        if not isinstance(both, (tuple, list)) or len(both) != 2:
            raise ArgumentError.of(f"trajectory[{name!r}]", both, "it must be (starts, ends)", _WRITE)
        told.update({f"{name}.{side}": table for side, table in zip(SIDES, both, strict=True)})
    return EndsPath(told)


def _held(ends: Mapping[str, Any] | None) -> tuple[tuple[str, ...], dict[str, End]]:
    """The ends that left and right gripper hold, and what holds or loads the others."""
    if ends is None:
        raise ArgumentError.of("ends", None, "a path of joints does not say what the grippers hold", _HELD)
    checks.instance("ends", ends, (Mapping,), _HELD)
    still = {end: held for end, held in ends.items() if isinstance(held, (Pose, Grip, FreeEnd))}
    by = {held: end for end, held in ends.items() if isinstance(held, str)}
    if set(by) != set(GRIPPERS) or len(by) + len(still) != len(ends):
        bound = "left and right gripper hold one end each, and poses or nothing the others"
        raise ArgumentError.of("ends", dict(ends), bound, _HELD)
    return tuple(by[gripper] for gripper in GRIPPERS), still


class _Sample(NamedTuple):
    """One place that was solved for; all but the place and what is wrong there by cable."""

    place: float
    looks: dict[str, Look]
    clearance: dict[str, Clearance]  # the other cables in it
    ends: dict[str, Array]  # (g, 7), of both ends, and of clips on links
    links: dict[str, Array]  # (l, 7)
    sensitivity: dict[str, Array]  # (n, 3, 6 g), by these of all cables
    violation: Violation | None


@final
class _Walk(Walk[_Sample]):
    """One check of several cables. Those that are kept out of each other may touch, others not come too near."""

    part = "cable"

    def __init__(
        self,
        predictor: CablesPredictor,
        scene: Scene,
        motion: Motion,
        held: tuple[str, ...],
        still: Mapping[str, End],
        moving: Mapping[str, Array],
        deadline: float,
        proceed: Callable[[TrajectoryCheck], bool] | None,
    ) -> None:
        super().__init__(motion, deadline, proceed)
        self.predictor, self.held, self.still, self.moving = predictor, held, still, moving
        cables = {name: one.cable for name, one in predictor.predictors.items()}
        gripped = {split_end(end)[0] for end in held}
        self.judges = {
            name: Judge(cable, predictor.scenes[name], motion.robot, name, name in gripped)
            for name, cable in cables.items()
        }
        links = () if motion.robot is None or scene.contact == "off" else motion.robot.link_geometry
        self.near = None if scene.contact == "off" else CableNear(cables, scene, links)
        self.limit = -math.inf if predictor.solves_crossing else scene.error_distance

    def tell(self, samples: list[_Sample]) -> None:
        """See the base."""
        found, rest = self.found, ((),) * (self.motion.waypoints - len(samples))
        for i, sample in enumerate(samples):
            own = [judge.nearest(sample.looks[name]) for name, judge in self.judges.items()]
            found.clearance[i] = min(*own, *self._apart(sample).values(), math.inf)
        found.margins_of = {name: (*(sample.looks[name].margins for sample in samples), *rest) for name in self.judges}
        found.margins = tuple(sum(of, ()) for of in zip(*found.margins_of.values(), strict=True))

    def _apart(self, sample: _Sample) -> dict[tuple[str, str], float]:
        """[m], how far pairs of cables are from each other, where they are near."""
        out = {}
        for name, clearance in sample.clearance.items():
            for body in clearance.bodies:
                if body.body in self.judges and body.body > name:
                    out[name, body.body] = body.distance
        return out

    def jump(self, a: _Sample, b: _Sample) -> float:
        """See the base."""
        return jumped(a.looks, b.looks)

    def sample(self, place: float) -> _Sample:
        """The shapes there and all that is told of them."""
        grips, links = self.motion.at(place)
        ends = {**self.still, **dict(zip(self.held, grips, strict=True))}
        both: dict[str, Any] = {name: (ends[f"{name}.start"], ends.get(f"{name}.end")) for name in self.judges}
        moves = {name: self.motion.between(table, place) for name, table in self.moving.items()}
        shapes = self.predictor.predict(both, links, acceleration=moves)
        clearance = {name: judge.checker.check(shapes[name], links) for name, judge in self.judges.items()}
        if self.near is not None:
            clearance = self.near.added(shapes, clearance)
        looks = {}
        for name, judge in self.judges.items():
            free = both[name][1] is None or isinstance(both[name][1], FreeEnd)
            state = self.predictor.state_of(name)
            looks[name] = judge.look(shapes[name], links, state, not free, clearance[name])
        self.found.solved += 1
        good = all(shape.status and shape.status is not Status.UNSTABLE for shape in shapes.values())
        found = _Sample(
            place,
            looks,
            clearance,
            {name: self._held(name, both[name]) for name in self.judges},
            {name: judge.frames(links) for name, judge in self.judges.items()},
            self.predictor.sensitivity(by_clips=True) if good else {},
            None,
        )
        return found._replace(violation=self._wrong(found))

    def _held(self, name: str, ends: tuple[Pose | Grip, End | None]) -> Array:
        """(g, 7), where a cable's ends are, and its clips on links."""
        return np.concatenate((_frames(*ends), self.predictor.predictors[name].problem.moving_clips[1]))

    def _wrong(self, sample: _Sample) -> Violation | None:
        """What is wrong at a place; the gravest first."""
        for name, look in sample.looks.items():
            wrong = self.no_shape(sample.place, look.shape.status, look.shape.detail, name)
            if wrong is not None:
                return wrong
        for name, judge in self.judges.items():
            wrong = judge.wrong(sample.looks[name], sample.place, self)
            if wrong is not None:
                return wrong
        for (name, other), distance in self._apart(sample).items():
            if distance < self.limit:
                text = f"{metres(distance)} from {other!r}, at least {metres(self.limit)} asked"
                arc = next(body.arc_length for body in sample.clearance[name].bodies if body.body == other)
                told = distance, self.limit, other, arc, name
                return self.violation(Reason.CLEARANCE, sample.place, text, *told)
        return None

    def sure(self, a: _Sample, b: _Sample) -> bool:
        """See the base."""
        turned, reach = self.motion.turned(a.place, b.place), self.motion.reach
        first, last = (np.concatenate(list(sample.ends.values())) for sample in (a, b))
        way = np.empty(6 * len(first))
        for i, (one, other) in enumerate(zip(first, last, strict=True)):
            advance.twist(one, other, way[6 * i : 6 * i + 6])
        moved = {}
        for name, judge in self.judges.items():
            looks = a.looks[name], b.looks[name]
            slopes = a.sensitivity[name], b.sensitivity[name]
            moved[name] = far, off = motion_of(*looks, *slopes, way, 0.125 * turned**2, reach)
            links = a.links[name], b.links[name]
            if not judge.sure(*looks, links, far, off, 0.25 * turned**2 * reach):
                return False
        return self._apart_between(a, b, moved)

    def _apart_between(self, a: _Sample, b: _Sample, moved: Mapping[str, tuple[float, float]]) -> bool:
        """Whether no two cables come too near between two places, each moving so far [m] and off it."""
        if self.near is None or self.limit == -math.inf:
            return True
        before, after, horizon = self._apart(a), self._apart(b), self.near.horizon
        names = list(self.judges)
        for i, name in enumerate(names):
            for other in names[i + 1 :]:
                pair = min(name, other), max(name, other)
                way, off = (moved[name][k] + moved[other][k] for k in (0, 1))
                left = 0.5 * (before.get(pair, horizon) + after.get(pair, horizon) - way) - off - self.limit
                if left < 0.0 and way + 2.0 * off > RESOLUTION:
                    return False
        return True


def _frames(start: Pose | Grip, end: End | None) -> Array:
    """(2, 7), of the cable at both ends; a free one is told as the start."""
    first = as_grip("start", start).cable_frame.array
    return np.array(
        (first, first if end is None or isinstance(end, FreeEnd) else as_grip("end", end).cable_frame.array)
    )
