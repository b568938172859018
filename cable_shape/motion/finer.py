"""A cable that swings goes on from one of its shapes: on the mesh of its motion, or on a finer one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cable_shape.motion.among import Lying
from cable_shape.motion.swing import Swing, load_of, spread_evenly
from cable_shape.shape import CableShape
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.seen import Seen

#: Times as many elements as where it began, at most, and how many at most.
FINEST, MOST = 4, 200
#: Elements that turn by more [rad] are too long, where a step takes more iterations than usual.
WIDE, MANY = 1.2, 5
FEWEST_DRAWN = 8  #: elements on which a cable is drawn to what was seen
#: Points of a shape that goes over to more elements, to each of these.
_SAMPLES = 8


def going_on(
    problem: Problem, shape: CableShape, elements: int, among: Callable[..., Any]
) -> tuple[Network, Swing] | None:
    """What goes on from a shape between the problem's ends, with its velocity; None: it is none of this cable.

    among: of a shape, ends and links, what makes bodies known to a network.
    """
    state = Network(problem, shape)
    poses, state.last = state.aim(problem.start, problem.end), shape
    if not state.resume(poses):
        return None
    spread_evenly(state, elements)
    bodies = among(shape, problem.start, problem.end, problem.links)
    return state, Swing(load_of(problem), state, bodies, Lying.of(shape, velocity=shape.velocity), goes_on=True)


def sampled(swing: Swing, last: CableShape, elements: int) -> CableShape:
    """The last shape with so many points that nothing is lost where it goes over to so many elements."""
    points = _SAMPLES * elements + 1
    out, velocity = CableShape.new_buffer(points), np.empty((points, 3))
    swing.tell(out, velocity, points)
    shape = last.again()
    shape.buffer, shape.points, shape.velocity = out, points, velocity
    return shape


def drawn_coarsely(
    problem: Problem, swing: Swing, shape: CableShape, seen: Seen, among: Callable[..., Any]
) -> tuple[Network, Swing] | None:
    """What is drawn to what was seen, from its shape at rest, on fewer elements, and goes on from there on as many as
    before; None: it cannot be.

    Many short ones buckle between points that are nearer to each other than the cable between them is long.
    """
    many = swing.model.h.size
    rest, count = sampled(swing, shape, many), many // 2
    while count >= FEWEST_DRAWN:
        found = going_on(problem, rest, count, among)
        if found is not None and found[1].draw_to(seen):
            return going_on(problem, sampled(found[1], shape, many), many, among)
        count //= 2
    return None
