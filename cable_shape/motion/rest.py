"""A cable as it comes to rest: where no equilibrium is found near the last one, it goes there as one that moves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.motion.motion import Motion
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.shape import CableShape
from cable_shape.solve import cosserat
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import MODEL
from cable_shape.solve.touching.road import DEEP
from cable_shape.solve.touching.search import clear_by
from cable_shape.solve.touching.state import TouchState
from cable_shape.solve.touching.step import Steps

#: N s/m^2 and s: what damps the way to rest, so that it is over soon and does not swing.
DRAG, RETARDATION = 0.3, 0.2
#: Elements of the whole cable, and the longest step [s], of each attempt: on one mesh contacts may come and go for ever
#: in steps of one size, on another one, or in others, they do not.
_ATTEMPTS = ((120, 0.1), (160, 0.3), (200, 0.3), (240, 0.3))
_STEP, _LONGER = 0.02, 1.15  # [s], the first step, and how much longer each next one is
_PACE = 0.1  #: [s] from place to place of a way that ends have gone: quicker than that the cable would trail behind
_SHORTER, _SHORTEST = 0.3, 0.005  # one that could not be taken is so much shorter next; [s], not from this on
_LET_DOWN_IN = _ATTEMPTS[:2]  #: of what is let down, on a long way
#: Steps at the end of a way, and iterations of all of them.
_MOST, _MOST_ITERATIONS = 160, 60_000
#: Iterations in one place, for more are taken where contacts flutter: of what goes on from a shape, and of what is let
#: down. And how far it is to another place, of the length: what comes there is on its way, and buckles slowly, say.
_PATIENT, _MORE_PATIENT, _ELSEWHERE = 4000, 9000, 0.01
#: At rest drag and inertia take less than this part of the largest force, and retardation of the largest curvature.
_STILL, _UNBENT = 5e-6, 1e-3
_RESTLESS = 1e-2  #: the same of what is only near rest
_LET_DOWN = 0.01  #: of the length: how far a cable that is let down comes in a step
Ends = tuple[Grip, Grip | FreeEnd]
Where = tuple[Ends, Mapping[str, Pose] | None]


def led_to_rest(
    cable: Cable, last: CableShape, then: Where, way: list[Where], scene: Scene | None, options: Mapping[str, Any]
) -> Iterator[Rest]:
    """What a cable that lay like `last` comes to when its ends and links, which were `then`, have gone a `way`.

    It moves as cables do, through no body; how long that takes, and how far it swings, is of no matter here: it is
    damped by so much that it creeps. Once for each mesh on which it comes near rest, ever finer.

    Parameters
    ----------
    cable : Cable
    last : CableShape
        At rest, of that cable.
    then : ((start, end), links)
        The ends, and the robot links by name.
    way : list of the same
        Where they were since, at last where they are; the ends are held alike. On another way, a straight one, say, a
        cable may come to rest elsewhere.
    scene : Scene, optional
    options : mapping
        Of :class:`Motion`: gravity, loads, bodies on links.
    """
    last = last.again()
    last.error_estimate = 0.0  # how well it is known is of no matter where it is at rest
    return _led(cable, scene, options, last, then, way, _PACE, _ATTEMPTS, _PATIENT)


def let_down(problem: Problem, scene: Scene | None, options: Mapping[str, Any]) -> Iterator[Rest]:
    """What the problem's cable comes to when it hangs above all bodies, and is let down to where its ends are.

    As `led_to_rest` has it, but without friction, of which no way tells anything here; none of a cable in clips, which
    stay where they are, and without gravity.
    """
    size = float(np.linalg.norm(problem.gravity))
    if size == 0.0 or problem.clips:
        return iter(())
    ends, links = (problem.start, problem.end), problem.links
    down = problem.gravity / size
    free = cosserat.solve(problem)
    state = TouchState(problem)
    state.aimed()
    steps = Steps(problem, state, math.inf)
    state.move_bodies(steps.links)
    far = clear_by(steps, free, down) if free.usable else math.inf
    if far == math.inf:
        return iter(())
    count = math.ceil(far / (_LET_DOWN * problem.cable.length))
    way = [(_shifted(ends, -far * (1.0 - k / count) * down), links) for k in range(count + 1)]
    free = CableShape(free.buffer.copy(), free.points, length=free.length, model=MODEL, status=free.status)
    free.positions[:] -= far * down
    options = {**options, "robot_links": _smooth(options.get("robot_links", ()))}
    scene = None if scene is None else scene.replace(obstacles=_smooth(scene.obstacles))
    smooth = problem.cable.replace(friction=0.0)
    return _led(smooth, scene, options, free, way[0], way[1:], _STEP, _LET_DOWN_IN, _MORE_PATIENT)


def _smooth(bodies: Iterable[Obstacle]) -> list[Obstacle]:
    """The bodies without friction."""
    return [replace(body, friction=0.0) for body in bodies]


def _shifted(ends: Ends, by: Array) -> Ends:
    """The ends, those that are held elsewhere by so much [m]."""
    start, end = ends
    return _lifted(start, by), _lifted(end, by) if isinstance(end, Grip) else end


def _lifted(grip: Grip, by: Array) -> Grip:
    return grip.at(Pose(grip.pose.position + by, grip.pose.quaternion))


def _led(
    cable: Cable,
    scene: Scene | None,
    options: Mapping[str, Any],
    last: CableShape,
    then: Where,
    way: list[Where],
    pace: float,
    attempts: Sequence[tuple[int, float]],
    patience: int,
) -> Iterator[Rest]:
    """What it comes to on a way, in steps of a pace [s], from there; once for each mesh on which it gets to its end."""
    damped = cable.replace(drag=DRAG, retardation_time=RETARDATION)
    for elements, longest in attempts:
        try:
            motion = Motion(damped, scene, points=last.points, elements=elements, **options)
            motion.take_up(last, *then[0], then[1])
            found = _at_rest(motion, Watch(motion.problem), way, pace, longest, patience)
        except ArgumentError:  # a cable that does not swing
            return
        if found is not None:
            yield found


class Rest(NamedTuple):
    """What a motion has come to, and whether it is at rest there, or goes to and fro for ever."""

    shape: CableShape
    still: bool


class Watch:
    """Whether a motion comes past a body: one that is drawn beyond its length may, by tons."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self._state = problem, TouchState(problem)
        self._state.aimed()
        self._move()

    def _move(self) -> Steps:
        """Puts the bodies where the problem has them."""
        steps = Steps(self._problem, self._state, math.inf)
        self._state.move_bodies(steps.links)
        return steps

    def passed(self, before: CableShape, after: CableShape) -> bool:
        """Whether the way from one step to the next leads through a body, or ends deep in one."""
        then = self._state.bodies.frames.copy()
        steps = self._move()
        deep = steps.depth(after.buffer) < -DEEP * self._state.radius
        return deep or steps.goes_through(before.positions, then, after.buffer)


def _at_rest(motion: Motion, watch: Watch, way: list[Where], pace: float, longest: float, patience: int) -> Rest | None:
    """What a motion comes to at the end of a way, there in steps up to so long [s]; None: it gets past a body, or
    nowhere."""
    if not all(_gets_to(motion, watch, place, pace) for place in way[:-1]):
        return None
    (ends, links), shape, dt, unrest = way[-1], motion.last, _STEP, math.inf
    place, iterations, gone = shape.positions, 0, 0  # iterations at this place, and on the way there
    for _ in range(1 + _MOST):
        before = shape
        shape = motion.step(*ends, dt, links)
        if not shape.usable and dt > _SHORTEST:
            shape, dt = before, _SHORTER * dt  # the state is kept
            longest = dt
            continue
        if not shape.usable or watch.passed(before, shape):
            return None
        iterations += shape.iterations
        if _sizes(shape.positions - place).max() > _ELSEWHERE * shape.length:
            place, iterations, gone = shape.positions, 0, gone + iterations
        bent = RETARDATION * _sizes(shape.curvature - before.curvature).max() / dt / _sizes(shape.curvature).max()
        unrest = motion.unrest / _sizes(shape.force).max()
        if (unrest < _STILL and bent < _UNBENT) or iterations > min(patience, _MOST_ITERATIONS - gone):
            break
        dt = min(_LONGER * dt, longest)
    if not unrest < _RESTLESS:
        return None
    shape.velocity, shape.model = None, MODEL
    shape.kinetic_energy, shape.work, shape.dissipated = 0.0, 0.0, 0.0
    return Rest(shape, unrest < _STILL and bent < _UNBENT)


def _gets_to(motion: Motion, watch: Watch, place: Where, pace: float) -> bool:
    """Whether a motion gets to a place in that time [s], or in less where it cannot be taken, and past no body."""
    before, (ends, links) = motion.last, place
    shape = motion.step(*ends, pace, links)
    while not shape.usable and pace > _SHORTEST:
        pace *= _SHORTER  # the state is kept
        shape = motion.step(*ends, pace, links)
    return shape.usable and not watch.passed(before, shape)


def _sizes(rows: Any) -> Any:
    """(n,), of rows (n, 3)."""
    return np.linalg.norm(rows, axis=1)
