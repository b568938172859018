"""Shapes of cables and harnesses almost alike, from the memory of a predictor: :func:`nearby`."""

from __future__ import annotations

from typing import Any

from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.predictor import Predictor
from cable_shape.shape import CableShape
from cable_shape.solve import harness_nearby as harness
from cable_shape.solve import nearby as free
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching import nearby as touching
from cable_shape.solve.touching.state import TouchState

#: What solved for a shape: of its own, or among bodies.
Memory = Network | TouchState


def memory_of(predictor: Predictor | HarnessPredictor) -> Memory | None:
    """What solved for the last shape; None where that has none of its own, as of a cable that touches itself."""
    state: Any = predictor.state if isinstance(predictor, HarnessPredictor) else predictor.rod_state
    if isinstance(state, TouchState):
        return state if state.touching else None
    return state if isinstance(state, Network) and state.history else None


def nearby(
    memory: Memory, problem: Problem | HarnessProblem
) -> tuple[CableShape | HarnessShape, Network | None] | None:
    """The shape that `problem` has to first order beside the last one, see `cable_shape.solve.nearby.nearby`.

    memory: freshly factored by `refresh`. Beside the shape of a cable, unless it touches bodies, the memory of it. None
    where the network of the problem, or a body, is another one.
    """
    shape: CableShape | HarnessShape | None
    if isinstance(problem, HarnessProblem):
        assert isinstance(memory, HarnessNetwork)
        shape = harness.nearby(memory, problem)
    elif isinstance(memory, Network):
        return free.nearby(memory, problem)
    else:
        shape = touching.nearby(memory, problem)
    return None if shape is None else (shape, None)
