"""Shapes of cables almost alike from the memory of a predictor, touching bodies or not: :func:`nearby`."""

from __future__ import annotations

from typing import Any

from cable_shape.prediction.predictor import Predictor
from cable_shape.shape import CableShape
from cable_shape.solve import nearby as free
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching import nearby as touching
from cable_shape.solve.touching.state import TouchState

#: What solved for a shape: of its own, or among bodies.
Memory = Network | TouchState


def memory_of(predictor: Predictor) -> Memory | None:
    """What solved for the last shape; None where it has none of its own, as of a cable that touches itself."""
    state: Any = predictor.rod_state
    if isinstance(state, TouchState):
        return state if state.touching else None
    return state if isinstance(state, Network) and state.history else None


def nearby(memory: Memory, problem: Problem) -> tuple[CableShape, Network | None] | None:
    """The shape that `problem` has to first order beside the last one, see `cable_shape.solve.nearby.nearby`.

    memory: freshly factored by `refresh`. Beside the shape, unless it touches bodies, the memory of it. None where the
    network of the problem, or a body, is another one.
    """
    if isinstance(memory, Network):
        return free.nearby(memory, problem)
    shape = touching.nearby(memory, problem)
    return None if shape is None else (shape, None)
