"""How the last shape of a harness answers what it is made of, and what loads it: :func:`answers`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.network import mesh, respond, tables
from cable_shape.solve.answers import refreshed, run_on
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem


@final
class HarnessChanges:
    """Directions in which a harness, or its loads, may change, each told by two problems, `steps` (k,) above and below.

    middle: the problem between them. All have the same ends, knots and spans; where grips and clips are, and how ends
    lie in their junctions, is not looked at.
    """

    def __init__(
        self, middle: HarnessProblem, pairs: Sequence[tuple[HarnessProblem, HarnessProblem]], steps: Array
    ) -> None:
        held, arcs = _told(middle)
        beside = [_told(one) for pair in pairs for one in pair]
        self.steps = np.array(steps, dtype=np.float64)
        made = [np.subtract(own, held, out=np.zeros(held.size), where=own != held) for own, _ in beside]  # inf may be
        self.held: Array = np.array(made).reshape(len(beside), held.size)
        self.arcs: Array = np.array([own - arcs for _, own in beside]).reshape(len(beside), *arcs.shape)  # m


def answers(state: HarnessNetwork, changes: HarnessChanges) -> Array:
    """(s points, 3, k): change of the last solution's positions, of the s segments in turn, a unit of each direction.

    All that holds it stands still. Points keep their share of each segment's length, clips and masses their arc length;
    it runs on through eyelets.
    """
    return answered(state, models_of(state, changes), changes.steps)


def answered(state: Any, models: Array, steps: Array) -> Array:
    """The same by models (2 k, size) above and below, half of the way between which is `steps` (k,)."""
    points, segments = state.problem.points, len(state.problem.segments)
    count = len(steps)
    out, df = np.zeros((state.sampled, 3, count)), np.empty((len(state.rings), count))
    if count:
        slides = refreshed(state)
        respond.answers(state.ints, state.floats, models, steps, state.sols, state.work, points, out, df)
        run_on(out, df, slides)
    return out[: segments * points]


def _told(problem: HarnessProblem) -> tuple[Array, Array]:
    """A model with one element a span, and arc lengths (m, 2) [m] at which spans begin and end."""
    network = HarnessNetwork(problem)
    network.aim()
    return network.held, network.layout.arcs


def models_of(state: HarnessNetwork, changes: HarnessChanges) -> Array:
    """(2 k, size): models on the mesh as it is."""
    still = np.array((0.0, state.length))
    everywhere = np.tile(still, (len(changes.held), 1))
    models: Array = mesh.neighbours(state.bare, state.held + changes.held, state.ints, state.floats, still, everywhere)
    for model, moved in zip(models, changes.arcs, strict=True):
        if not moved.any():
            continue
        s = tables.model_of.py_func(state.ints, model).s
        for (a, b), (low, high) in zip(state.runs, moved.tolist(), strict=True):
            share = (s[a : b + 1] - s[a]) / (s[b] - s[a])
            s[a : b + 1] += low + share * (high - low)
        mesh.move_nodes(state.ints, model, still, still, model)
    return models
