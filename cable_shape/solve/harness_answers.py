"""How the last shape of a harness answers what it is made of, and what loads it: :func:`answers`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, final

import numpy as np

from cable_shape.cable.harness import split_end
from cable_shape.checks import Array
from cable_shape.kernels.network import respond, tables, tilting
from cable_shape.solve.answers import Solved, refreshed, run_on
from cable_shape.solve.harness_layout import Layout
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem


class Answering(Solved, Protocol):
    """The memory of a harness, in contact or not."""

    problem: Any

    @property
    def layout(self) -> Layout:
        """Knots and spans by name."""

    def sensitivities(self, ends: Sequence[str], clips: Sequence[int] = ()) -> Array:
        """See `HarnessNetwork.sensitivities`."""

    def models_beside(self, held: Array, arcs: Array) -> Array:  # type: ignore[override]
        """(c, size): models that differ by what `differences` tells, on the mesh as it is.

        What is in eyelets is where it is.
        """


@final
class HarnessChanges:
    """Directions in which a harness, or its loads, may change, each told by two problems, `steps` (k,) above and below.

    middle: the problem between them. All have the same ends, knots and spans; where grips and clips are, and how ends
    lie in their junctions, is not looked at.
    """

    def __init__(
        self, middle: HarnessProblem, pairs: Sequence[tuple[HarnessProblem, HarnessProblem]], steps: Array
    ) -> None:
        self.steps = np.array(steps, dtype=np.float64)
        self.held, self.arcs = differences(middle, [one for pair in pairs for one in pair])


def answers(state: Answering, changes: HarnessChanges) -> Array:
    """(s points, 3, k): change of the last solution's positions, of the s segments in turn, a unit of each direction.

    All that holds it stands still. Points keep their share of each segment's length, clips and masses their arc length;
    it runs on through eyelets.
    """
    points, segments = state.problem.points, len(state.problem.segments)
    count = len(changes.steps)
    out, df = np.zeros((state.sampled, 3, count)), np.empty((len(state.rings), count))
    if count:
        slides = refreshed(state)
        models = state.models_beside(changes.held, changes.arcs)
        respond.answers(state.ints, state.floats, models, changes.steps, state.sols, state.work, points, out, df)
        run_on(out, df, slides)
    return out[: segments * points]


def tilts(state: Answering, ends: Sequence[str]) -> Array:
    """(s points, 3, 3 g): change of the last solution's positions as these g ends turn in their rigid junctions.

    Three columns each, angular velocity about the axes of the end's own cable frame. Points stay at their arc length.
    """
    points, segments = state.problem.points, list(state.problem.segments)
    out, df = np.zeros((state.sampled, 3, 3 * len(ends))), np.empty((len(state.rings), 3 * len(ends)))
    if ends:
        slides = refreshed(state)
        first = tables.plan_of.py_func(state.ints).cables
        names = [(segments.index(segment), side == "end") for segment, side in map(split_end, ends)]
        which = np.array([(first[c + 1] - 1, 1) if far else (first[c], 0) for c, far in names], dtype=np.int64)
        tilting.tilts(state.ints, state.floats, state.sols, state.work, points, which, out, df)
        run_on(out, df, slides)
    return out[: len(segments) * points]


def differences(middle: HarnessProblem, others: Sequence[HarnessProblem]) -> tuple[Array, Array]:
    """What others have otherwise than the one between them: (c, size) of models with one element a span, (c, m, 2) [m]
    of arc lengths at which spans begin and end.
    """
    held, arcs = _told(middle)
    beside = [_told(other) for other in others]
    made = [np.subtract(own, held, out=np.zeros(held.size), where=own != held) for own, _ in beside]  # inf may be
    return (
        np.array(made).reshape(len(beside), held.size),
        np.array([own - arcs for _, own in beside]).reshape(len(beside), *arcs.shape),
    )


def _told(problem: HarnessProblem) -> tuple[Array, Array]:
    """A model with one element a span, no rotation free in it, and arc lengths (m, 2) [m] at which spans begin and end.

    A straight segment that nothing else holds is held in its roll, and one that is bent beside it is not.
    """
    network = HarnessNetwork(problem)
    network.aim()
    model = tables.model_of.py_func(network.bare, network.held)
    model.free[...] = model.loose[...] = 0.0
    return network.held, network.layout.arcs
