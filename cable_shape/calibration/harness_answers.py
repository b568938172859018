"""How the shape of a harness answers the numbers of a calibration, to first order: :class:`HarnessAnswers`."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from cable_shape.cable.harness import Harness
from cable_shape.calibration.answers import NEAR
from cable_shape.calibration.ends import rates, turned
from cable_shape.calibration.harness_observation import HarnessObservation
from cable_shape.calibration.harness_parameters import OF_ENDS, HarnessParameters, Target
from cable_shape.checks import Array
from cable_shape.pose import Grip
from cable_shape.solve.harness_answers import Answering, HarnessChanges, answers, tilts
from cable_shape.solve.harness_problem import HarnessProblem


@final
class HarnessAnswers:
    """The derivatives by all parameters, at `values` (k,).

    problem_of: makes the problem that an observation sets to a harness, its ends not yet held. What a number changes is
    told once for all observations that it changes in the same way.
    """

    def __init__(
        self,
        parameters: HarnessParameters,
        values: Array,
        problem_of: Callable[[Harness, HarnessObservation], HarnessProblem],
    ) -> None:
        self._parameters, self._values, self._problem_of = parameters, values, problem_of
        harness = parameters.harness
        self._of_grips = [
            one for one in parameters.targets if one.kind in OF_ENDS and harness.junction_of(one.of[0]) is None
        ]
        self._material = [j for one in parameters.targets if one.kind not in OF_ENDS for j in one.columns]
        kinds = {target.kind for target in parameters.targets}
        self._lengthens, self._loads = "length" in kinds, bool(kinds & {"length", "linear_density"})
        self._kept: dict[object, HarnessChanges] = {}

    def moves(self, state: Answering, look: HarnessObservation) -> Array:
        """(s points, 3, k): change of the last solution's positions, at the same share of each of the s segments."""
        problem = state.problem
        rows = problem.points * len(problem.segments)
        out = np.zeros((rows, 3, len(self._values)))
        held = {one.of[0]: look.ends[one.of[0]] for one in self._of_grips if type(problem.ends[one.of[0]]) is Grip}
        by_grips = state.sensitivities(tuple(held))[:rows]
        for target in self._of_grips:
            if target.of[0] in held:
                given = held[target.of[0]]
                grip = given if isinstance(given, Grip) else Grip(given)  # type: ignore[arg-type]
                frame = grip.cable_frame.matrix()[:3, :3]
                first = 6 * list(held).index(target.of[0]) + (0 if target.kind == "offset" else 3)
                out[:, :, target.columns] = by_grips[:, :, first : first + 3] @ (
                    frame @ _beside(target, self._parameters, self._values)
                )
        put_junctions(state, self._parameters, self._values, out)
        if self._material:
            out[:, :, self._material] = answers(state, self._changes(state, look))
        return out

    def _changes(self, state: Answering, look: HarnessObservation) -> HarnessChanges:
        """What the numbers of segments change of the model of one observation, and of those like it."""
        key = (
            state.layout.structure,
            tuple(look.lengths.items()) if self._lengthens else None,
            id(look) if self._loads and look.acceleration is not None else None,
        )
        if key not in self._kept:
            steps = NEAR * np.array([self._parameters.each[j].step for j in self._material])
            ways = steps[:, None] * np.eye(len(self._values))[self._material]
            pairs = [(self._problem(look, way), self._problem(look, -way)) for way in ways]
            self._kept[key] = HarnessChanges(self._problem(look, 0.0 * self._values), pairs, steps)
        return self._kept[key]

    def _problem(self, look: HarnessObservation, way: Array) -> HarnessProblem:
        """The problem of an observation with numbers that differ by `way`."""
        values = self._values + way
        problem = self._problem_of(self._parameters.make(values, look.lengths), look)
        return problem.move(self._parameters.held(values, look.ends))


def put_junctions(state: Answering, parameters: HarnessParameters, values: Array, out: Array) -> None:
    """Puts into out (s points, 3, k) the columns of numbers that turn ends in their junctions."""
    harness = parameters.harness
    of_junctions = [one for one in parameters.targets if one.kind in OF_ENDS and harness.junction_of(one.of[0])]
    ends = list(dict.fromkeys(target.of[0] for target in of_junctions))
    turning = tilts(state, ends)
    for target in of_junctions:
        turn, beside = _beside(target, parameters, values), parameters.beside(values, target.of[0])
        if beside is not None:  # in the end's own frame, as it is turned
            turn = beside.matrix()[:3, :3].T @ turn
        first = 3 * ends.index(target.of[0])
        out[:, :, target.columns] = turning[:, :, first : first + 3] @ turn


def _beside(target: Target, parameters: HarnessParameters, values: Array) -> Array:
    """(3, m): velocity of an offset, or angular velocity of a turn, in the frame beside which the end is put."""
    if target.kind == "offset":
        return np.eye(3)
    tilt = np.zeros(3)
    for one in parameters.targets:
        if one.of == target.of and one.kind == "tilt":
            tilt[:2] = one.of_these(values)
    return turned(tilt)[:, None] if target.kind == "roll" else rates(tilt)[:, :2]
