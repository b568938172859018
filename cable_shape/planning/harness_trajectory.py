"""A whole motion of a harness: what :func:`cable_shape.check_trajectory` makes of one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import Harness, split_end
from cable_shape.checks import Array
from cable_shape.cycle.harness_stability import HarnessStability
from cable_shape.errors import ArgumentError
from cable_shape.kernels.safety import advance
from cable_shape.planning.paths import EndsPath, GripPath, JointPath, Motion
from cable_shape.planning.trajectory_report import TrajectoryCheck, Violation
from cable_shape.planning.trajectory_walk import Judge, Look, Walk, accelerations_of, bodies_of, jumped
from cable_shape.pose import FreeEnd, Grip
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.robots.on_links import check_links
from cable_shape.robots.robot import Robot
from cable_shape.scene.scene import Scene
from cable_shape.shape import Status

GRIPPERS = ("left", "right")
_REMEDY = "Write ends={'a.start': 'left', 'b.end': 'right'}."


def check_harness(
    harness: Harness,
    scene: Scene | None,
    robot: Robot | None,
    trajectory: Any,
    ends: Mapping[str, str | FreeEnd] | None,
    deadline: float,
    proceed: Callable[[TrajectoryCheck], bool] | None,
    *,
    gravity: ArrayLike,
    points: int,
    tolerance: float | None,
    distributed_load: Mapping[str, ArrayLike] | None,
    acceleration: Mapping[str, ArrayLike] | None = None,
) -> TrajectoryCheck:
    """What :func:`cable_shape.check_trajectory` says."""
    began = perf_counter()
    predictor = HarnessPredictor(
        harness, scene=scene, gravity=gravity, points=points, distributed_load=distributed_load,
        tolerance=1e-4 * harness.longest if tolerance is None else tolerance, **bodies_of(robot),
    )  # fmt: skip
    path, held, free = path_of(trajectory, ends)
    motion = Motion(path, robot)
    check_links(motion.robot, scene)
    grips, links = motion.at(0.0)
    predictor.problem.move({**dict(zip(held, grips, strict=True)), **free}, links)  # refuses what cannot be held
    walk = _Walk(predictor, scene or Scene(), motion, held, free, deadline, proceed)
    moves = checks.mapping("acceleration", acceleration, harness.segments, "Write {segment: (k, 3)}.")
    for name, table in moves.items():
        try:
            own = partial(accelerate_segment, predictor, name)
            walk.accelerations[name] = accelerations_of(table, motion.waypoints, own)
        except ArgumentError as error:
            raise ArgumentError(f"segment {name!r}: {error}") from None
    walk.run()
    walk.found.time = perf_counter() - began
    return walk.found


def path_of(
    trajectory: Any, ends: Mapping[str, str | FreeEnd] | None
) -> tuple[EndsPath | JointPath, tuple[str, ...], Mapping[str, FreeEnd]]:
    """The path of a harness, which ends are held along it, and the loads of free ones."""
    path = EndsPath(trajectory) if isinstance(trajectory, Mapping) else trajectory
    if isinstance(path, GripPath):
        bound = "the ends of a harness have names"
        raise ArgumentError.of("trajectory", path, bound, "Write EndsPath({'a.start': table, 'b.end': table}).")
    if isinstance(path, EndsPath):
        if ends is not None:
            raise ArgumentError.of("ends", dict(ends), "the trajectory says which are held", "Leave them out.")
        return path, path.held, path.free
    return path if isinstance(path, JointPath) else JointPath.from_message(path), *_held(ends)


def accelerate_segment(predictor: HarnessPredictor, name: str, acceleration: Array) -> None:
    """Refuses what a segment cannot be accelerated by."""
    predictor.problem.moving({name: acceleration})


def _held(ends: Mapping[str, str | FreeEnd] | None) -> tuple[tuple[str, ...], dict[str, FreeEnd]]:
    """The ends that left and right gripper hold, and the loads of free ones."""
    if ends is None:
        raise ArgumentError.of("ends", None, "a path of joints does not say what the grippers hold", _REMEDY)
    checks.instance("ends", ends, (Mapping,), _REMEDY)
    free = {end: held for end, held in ends.items() if isinstance(held, FreeEnd)}
    by = {held: end for end, held in ends.items() if isinstance(held, str)}
    if set(by) != set(GRIPPERS) or len(by) + len(free) != len(ends):
        raise ArgumentError.of("ends", dict(ends), "left and right gripper hold one end each", _REMEDY)
    return tuple(by[gripper] for gripper in GRIPPERS), free


class _Sample(NamedTuple):
    """One place that was solved for."""

    place: float
    looks: dict[str, Look]  # by segment
    ends: Array  # (g, 7), of the held ends, in the predictor's order, and of clips on links
    links: dict[str, Array]  # (l, 7), by segment
    sensitivity: dict[str, Array]  # (n, 3, 6 g), by segment
    violation: Violation | None


@final
class _Walk(Walk[_Sample]):
    """One check of a harness."""

    def __init__(
        self,
        predictor: HarnessPredictor,
        scene: Scene,
        motion: Motion,
        held: tuple[str, ...],
        free: Mapping[str, FreeEnd],
        deadline: float,
        proceed: Callable[[TrajectoryCheck], bool] | None,
    ) -> None:
        super().__init__(motion, deadline, proceed)
        self.predictor, self.held, self.free = predictor, held, free
        self.accelerations: dict[str, Array] = {}
        self.stability = HarnessStability(predictor, 0.0)
        segments = predictor.harness.segments
        gripped = {split_end(end)[0] for end in held}
        self.judges = {
            name: Judge(cable, scene, motion.robot, name, name in gripped) for name, cable in segments.items()
        }

    def tell(self, samples: list[_Sample]) -> None:
        """See the base."""
        found, rest = self.found, ((),) * (self.motion.waypoints - len(samples))
        for i, sample in enumerate(samples):
            found.clearance[i] = min(judge.nearest(sample.looks[name]) for name, judge in self.judges.items())
        found.margins_of = {name: (*(sample.looks[name].margins for sample in samples), *rest) for name in self.judges}
        found.margins = tuple(sum(of, ()) for of in zip(*found.margins_of.values(), strict=True))

    def jump(self, a: _Sample, b: _Sample) -> float:
        """See the base."""
        return jumped(a.looks, b.looks)

    def sample(self, place: float) -> _Sample:
        """The shape there and all that is told of it."""
        grips, links = self.motion.at(place)
        ends = {**dict(zip(self.held, grips, strict=True)), **self.free}
        moves = {name: self.motion.between(table, place) for name, table in self.accelerations.items()}
        shape = self.predictor.predict(ends, links=links, acceleration=moves or None)
        looks = {name: judge.look(shape.segments[name], links) for name, judge in self.judges.items()}
        self.stability.judge(shape, 0)
        if self.stability.margin is not None:
            looks[self.stability.segment] = looks[self.stability.segment].with_stability(self.stability.margin)
        self.found.solved += 1
        frames = [self.predictor.problem.ends[end] for end in self.predictor.grips]
        good = bool(shape.status) and shape.status is not Status.UNSTABLE
        problem = self.predictor.problem
        placed = [grip.cable_frame.array for grip in frames if isinstance(grip, Grip)]
        placed += list(problem.clip_frames[problem.moving_clips])
        wrong = self.no_shape(place, shape.status, shape.detail)
        for name, judge in self.judges.items():
            wrong = wrong or judge.wrong(looks[name], place, self)
        return _Sample(
            place,
            looks,
            np.array(placed),
            {name: judge.frames(links) for name, judge in self.judges.items()},
            self.predictor.sensitivity(by_clips=True) if good else {},
            wrong,
        )

    def sure(self, a: _Sample, b: _Sample) -> bool:
        """See the base."""
        turned, reach = self.motion.turned(a.place, b.place), self.motion.reach
        way = np.empty(6 * len(a.ends))
        for i, (start, end) in enumerate(zip(a.ends, b.ends, strict=True)):
            advance.twist(start, end, way[6 * i : 6 * i + 6])
        for name, judge in self.judges.items():
            one, other = a.looks[name], b.looks[name]
            far, off = motion_of(one, other, a.sensitivity[name], b.sensitivity[name], way, 0.125 * turned**2, reach)
            links = a.links[name], b.links[name]
            if not judge.sure(one, other, links, far, off, 0.25 * turned**2 * reach):
                return False
        return True


def motion_of(
    a: Look, b: Look, slopes_a: Array, slopes_b: Array, way: Array, bend: float, reach: float
) -> tuple[float, float]:
    """[m]: `advance.motion` for any number g of grips: slopes (n, 3, 6 g), way (6 g,), the twists of the ends."""
    chord = b.shape.positions - a.shape.positions
    beside = [np.linalg.norm(slopes @ way - chord, axis=1) for slopes in (slopes_a, slopes_b)]
    off = advance.SAFETY * advance.CUBIC * (beside[0] + beside[1])
    if bend > 0.0:
        square = (slopes_a**2 + slopes_b**2).sum(axis=1).reshape(len(chord), -1, 2, 3).sum(axis=(1, 3))
        off += bend * (reach * np.sqrt(square[:, 0]) + np.sqrt(square[:, 1]))
    far = math.sqrt(float((chord**2).sum(axis=1).max()))
    return far, float(off.max())
