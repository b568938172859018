"""A whole motion of several cables: what :func:`cable_shape.check_trajectory` makes of one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import SIDES, Harness, split_end
from cable_shape.checks import Array
from cable_shape.cycle.harness_cycle import beside_each_other
from cable_shape.cycle.harness_stability import HarnessStability
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.kernels.safety import advance
from cable_shape.planning.harness_trajectory import GRIPPERS, accelerate_segment, motion_of
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
from cable_shape.prediction.cables_predictor import CablesPredictor, named_parts, of_all
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.layout import cable_id
from cable_shape.prediction.predictor import Predictor
from cable_shape.prediction.together import by_strand, names_of
from cable_shape.robots.on_links import check_links
from cable_shape.robots.robot import Robot
from cable_shape.safety.near import CableNear
from cable_shape.safety.report import Clearance
from cable_shape.safety.warnings import metres
from cable_shape.scene.scene import Scene
from cable_shape.shape import Status

_WRITE = (
    "Write {name of the cable: (starts, ends)} of every cable, tables (k, 7); ends may be a FreeEnd or None. Of a "
    "harness {end: table}."
)
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
    named = named_parts(cables)
    longest = max(one.longest if isinstance(one, Harness) else one.length for one in named.values())
    allowed = 1e-4 * longest if tolerance is None else tolerance
    predictor = CablesPredictor(
        named, model="cosserat", scene=scene, tolerance=allowed, **bodies_of(robot), **options
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
    known = [end for name, cable in named.items() for end in _ends_of(name, cable)]
    for end in (*held, *still):
        if end not in known:
            raise UnknownKeyError.among("ends", end, known)
    for name, cable in named.items():
        if isinstance(cable, Harness):
            continue  # its predictor refuses what nothing holds
        if f"{name}.start" not in held and not isinstance(still.get(f"{name}.start"), (Pose, Grip)):
            raise ArgumentError.of("ends", sorted((*held, *still)), f"nothing holds the start of cable {name!r}", _HELD)
    motion = Motion(path, robot)
    for own in predictor.scenes.values():
        check_links(motion.robot, own)
    moves = checks.mapping("acceleration", acceleration, predictor.predictors, "Write {name of the cable: (k, 3)}.")
    moving = {name: _accelerations(name, table, motion, predictor.predictors[name]) for name, table in moves.items()}
    walk = _Walk(predictor, scene or Scene(), motion, held, still, moving, deadline, proceed)
    walk.run()
    return walk.found


def _ends_of(name: str, cable: Cable | Harness) -> list[str]:
    """What the ends of a cable, or of a harness, are called among others."""
    if isinstance(cable, Harness):
        return [f"{name}/{end}" for end in cable.open_ends]
    return [f"{name}.{side}" for side in SIDES]


def _accelerations(name: str, told: Any, motion: Motion, predictor: Predictor | HarnessPredictor) -> Any:
    """Of a cable at the waypoints, or of segments of a harness by their names."""
    try:
        if isinstance(predictor, Predictor):
            return accelerations_of(told, motion.waypoints, predictor.accelerate)
        tables = checks.mapping("segments", told, predictor.harness.segments, "Write {segment: (k, 3)}.")
        return {
            one: accelerations_of(table, motion.waypoints, partial(accelerate_segment, predictor, one))
            for one, table in tables.items()
        }
    except ArgumentError as error:
        raise ArgumentError(f"acceleration[{name!r}]: {error}") from None


def _path(tables: Mapping[str, Any], among: CablesPredictor) -> EndsPath:
    """The waypoints of all ends, by "cable.start" and "cable.end"."""
    told = {}
    for name, both in of_all("trajectory", tables, among.predictors, _WRITE).items():
        if isinstance(both, Mapping):
            told.update({f"{name}/{end}": table for end, table in both.items()})
            continue
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
    """One place that was solved for."""

    place: float
    looks: dict[str, Look]  # here and below by strand: cables, and segments of harnesses, "h/a"
    clearance: dict[str, Clearance]  # the other cables in it
    ends: Array  # (g, 7), of what holds them, cable by cable, and clips on links
    links: dict[str, Array]  # (l, 7)
    sensitivity: dict[str, Array]  # (n, 3, 6 g), by these
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
        moving: Mapping[str, Any],
        deadline: float,
        proceed: Callable[[TrajectoryCheck], bool] | None,
    ) -> None:
        super().__init__(motion, deadline, proceed)
        self.predictor, self.held, self.still, self.moving = predictor, held, still, moving
        gripped = {split_end(end)[0] for end in held}
        self.judges: dict[str, Judge] = {}
        self.stabilities: dict[str, HarnessStability] = {}
        cables: dict[str, Cable] = {}
        meeting: set[frozenset[str]] = set()
        for name, one in predictor.predictors.items():
            own = one.harness.segments.values() if isinstance(one, HarnessPredictor) else [one.cable]
            for strand, cable in zip(names_of(name, one), own, strict=True):
                cables[strand] = cable
                self.judges[strand] = Judge(cable, predictor.scenes[name], motion.robot, strand, strand in gripped)
            if isinstance(one, HarnessPredictor):
                self.stabilities[name] = HarnessStability(one, 0.0)
                meeting |= beside_each_other(name, one.harness)
        links = () if motion.robot is None or scene.contact == "off" else motion.robot.link_geometry
        self.near = None if scene.contact == "off" else CableNear(cables, scene, links, joined=meeting)
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
        given = {name: _given(name, one, ends) for name, one in self.predictor.predictors.items()}
        moves = {name: self._between(table, place) for name, table in self.moving.items()}
        whole = self.predictor.predict(given, links, acceleration=moves)
        shapes = {strand: one for name, shape in whole.items() for strand, one in by_strand(name, shape).items()}
        clearance = {name: judge.checker.check(shapes[name], links) for name, judge in self.judges.items()}
        if self.near is not None:
            clearance = self.near.added(shapes, clearance)
        looks = {}
        for name, judge in self.judges.items():
            single = name in whole
            free = not single or given[name][1] is None or isinstance(given[name][1], FreeEnd)
            state = self.predictor.state_of(name) if single else None
            looks[name] = judge.look(shapes[name], links, state, not free, clearance[name])
        for name, stability in self.stabilities.items():
            stability.judge(whole[name], 0)
            if stability.margin is not None:
                softest = cable_id(name, stability.segment)
                looks[softest] = looks[softest].with_stability(stability.margin)
        self.found.solved += 1
        good = all(shape.status and shape.status is not Status.UNSTABLE for shape in shapes.values())
        found = _Sample(
            place,
            looks,
            clearance,
            np.concatenate([_frames(one, given[name]) for name, one in self.predictor.predictors.items()]),
            {name: judge.frames(links) for name, judge in self.judges.items()},
            self.predictor.sensitivity(by_clips=True) if good else {},
            None,
        )
        return found._replace(violation=self._wrong(found))

    def _between(self, tables: Any, place: float) -> Any:
        """The accelerations of a cable there, or of segments."""
        if isinstance(tables, Mapping):
            return {one: self.motion.between(table, place) for one, table in tables.items()}
        return self.motion.between(tables, place)

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
        way = np.empty(6 * len(a.ends))
        for i, (one, other) in enumerate(zip(a.ends, b.ends, strict=True)):
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


def _given(name: str, predictor: Predictor | HarnessPredictor, ends: Mapping[str, End]) -> Any:
    """What holds a cable, or a harness, as its predictor takes it."""
    if isinstance(predictor, HarnessPredictor):
        return {end: ends[f"{name}/{end}"] for end in predictor.harness.open_ends if f"{name}/{end}" in ends}
    return ends[f"{name}.start"], ends.get(f"{name}.end")


def _frames(predictor: Predictor | HarnessPredictor, given: Any) -> Array:
    """(g, 7), where what holds it is, and clips on links; a cable's free end is told as its start."""
    if isinstance(predictor, HarnessPredictor):
        problem = predictor.problem
        held = [end.cable_frame.array for end in problem.ends.values() if isinstance(end, Grip)]
        return np.array([*held, *problem.clip_frames[problem.moving_clips]])
    start, end = given
    first = as_grip("start", start).cable_frame.array
    last = first if end is None or isinstance(end, FreeEnd) else as_grip("end", end).cable_frame.array
    return np.array((first, last, *predictor.problem.moving_clips[1]))
