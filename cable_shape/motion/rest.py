"""A cable as it comes to rest: where no equilibrium is found near the last one, it goes there as one that moves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.errors import ArgumentError
from cable_shape.motion.motion import Motion
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import MODEL
from cable_shape.solve.touching.state import TouchState
from cable_shape.solve.touching.step import Steps

#: N s/m^2 and s: what damps the way to rest, so that it is over soon and does not swing.
DRAG, RETARDATION = 0.3, 0.2
#: Elements of the whole cable, and the longest step [s], of each attempt: on one mesh contacts may come and go for ever
#: in steps of one size, on another one, or in others, they do not.
_ATTEMPTS = ((120, 0.1), (160, 0.3), (200, 0.3), (240, 0.3))
_STEP, _LONGER = 0.02, 1.15  # [s], the first step, and how much longer each next one is
_MOST, _PATIENT = 80, 1500  # steps of an attempt, and iterations of all of them: more are taken where contacts flutter
#: At rest drag and inertia take less than this part of the largest force, and retardation of the largest curvature.
_STILL, _UNBENT = 5e-6, 1e-3
_DEEP = 0.3  #: of the cable's radius: what is deeper in a body is on the way through
Where = tuple[tuple[Grip, Grip | FreeEnd], Mapping[str, Pose] | None]


def led_to_rest(
    cable: Cable, last: CableShape, then: Where, now: Where, scene: Scene | None, options: Mapping[str, Any]
) -> Iterator[CableShape]:
    """What a cable that lay like `last` comes to when its ends and links, which were `then`, are `now`.

    It moves as cables do, through no body; how long that takes, and how far it swings, is of no matter here: it is
    damped by so much that it creeps. Once for each mesh on which it comes to rest, ever finer.

    Parameters
    ----------
    cable : Cable
    last : CableShape
        At rest, of that cable.
    then, now : ((start, end), links)
        The ends, and the robot links by name; the ends are held alike.
    scene : Scene, optional
    options : mapping
        Of :class:`Motion`: gravity, loads, bodies on links.
    """
    damped, last = cable.replace(drag=DRAG, retardation_time=RETARDATION), last.again()
    last.error_estimate = 0.0  # how well it is known is of no matter where it is at rest
    for elements, longest in _ATTEMPTS:
        try:
            motion = Motion(damped, scene, points=last.points, elements=elements, **options)
            motion.take_up(last, *then[0], then[1])
            found = _at_rest(motion, _Watch(motion.problem), now, longest)
        except ArgumentError:  # a cable that does not swing
            return
        if found is not None:
            yield found


class _Watch:
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
        deep = steps.depth(after.buffer) < -_DEEP * self._state.radius
        return deep or steps.goes_through(before.positions, then, after.buffer)


def _at_rest(motion: Motion, watch: _Watch, now: Where, longest: float) -> CableShape | None:
    """Where a motion comes to rest in steps up to so long [s]; None: it does not."""
    shape, dt, iterations = motion.last, _STEP, 0
    for _ in range(_MOST):
        before = shape
        shape = motion.step(*now[0], dt, now[1])
        iterations += shape.iterations
        if not shape.usable or iterations > _PATIENT or watch.passed(before, shape):
            return None
        bent = RETARDATION * _sizes(shape.curvature - before.curvature).max() / dt
        still = motion.unrest < _STILL * _sizes(shape.force).max()
        if still and bent < _UNBENT * _sizes(shape.curvature).max():
            shape.velocity, shape.model = None, MODEL
            shape.kinetic_energy, shape.work, shape.dissipated = 0.0, 0.0, 0.0
            return shape
        dt = min(_LONGER * dt, longest)
    return None


def _sizes(rows: Any) -> Any:
    """(n,), of rows (n, 3)."""
    return np.linalg.norm(rows, axis=1)
