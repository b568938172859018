"""From parameters to misses: every observation predicted by a rod of its own, warm or from nothing."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.calibration.answers import Answers
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import Parameters, held
from cable_shape.checks import Array
from cable_shape.kernels.distance.misses import changes, misses
from cable_shape.pose import Grip
from cable_shape.prediction.solvers import Rod
from cable_shape.shape import CableShape
from cable_shape.solve.problem import Problem

#: Points of a centreline that observed points are compared with; between them it is cubic.
POINTS = 101
#: [1], of the length: discretisation error of a prediction.
TOLERANCE = 1e-6
#: [1], of the length, root mean square: what differs by less is the same.
NOISE = 1e-6


class _Followed(NamedTuple):
    """A rod with the problem that it has solved, and the shape."""

    rod: Rod
    problem: Problem
    shape: CableShape


@final
class Forward:
    """Misses of all observed points (n, 3) [m], observation by observation, and how they change with parameters.

    Between the same grips a cable may have several stable shapes. Shapes at new values are followed from those where
    the last derivatives were taken, whatever was tried in between; :meth:`afresh` predicts each from nothing. From
    one call of it to the next the load of damping stays, on which the shape of a moving cable depends, and it on that.

    loads: the keywords `gravity`, `scene` and `distributed_load` of :func:`cable_shape.predict`.
    """

    def __init__(self, parameters: Parameters, observations: Sequence[Observation], **loads: Any) -> None:
        self.parameters = parameters
        self.observations = list(observations)
        self._loads = loads
        self._from: list[_Followed | None] = [None] * len(self.observations)  # where shapes are followed from
        self._states: list[_Followed | None] = self._from.copy()  # with the last values
        self._lags: list[Array | None] = [None] * len(self.observations)  # loads of damping
        self._last: tuple[Array, list[CableShape]] | None = None  # values, and all shapes with them

    def centrelines(self, values: Array) -> list[Array]:
        """(101, 3) [m] of each observation; NaN where there is no usable shape."""
        return [
            shape.positions.copy() if shape.status else np.full((POINTS, 3), np.nan) for shape in self._shapes(values)
        ]

    def misses(self, values: Array) -> Array:
        """(n, 3) [m]; NaN where there is no usable shape."""
        return np.concatenate([self._miss(i, shape) for i, shape in enumerate(self._shapes(values))])

    def afresh(self, values: Array) -> Array:
        """`misses` of every observation predicted from nothing, as :func:`cable_shape.predict` does; from there on
        shapes are followed."""
        nothing: list[None] = [None] * len(self.observations)
        self._from, self._lags, self._last = [*nothing], [*nothing], None
        misses = self.misses(values)
        self._lags = [None if last is None else last.rod.lag for last in self._states]
        return misses

    def keep(self) -> None:
        """From now on shapes are followed from the last ones."""
        self._from = self._states

    def jacobian(self, values: Array, now: Array) -> Array:
        """(n, 3, parameters) at `values`, where the misses are `now`; 0 where there is no shape.

        By the rod's own sensitivities. A parameter that moves points by no more than the discretisation's own noise
        moves none.
        """
        shapes = self._shapes(values)
        self.keep()
        out = self._moved(values, shapes)
        steps = np.array([parameter.step for parameter in self.parameters.each])
        spread = steps * np.sqrt((out * out).sum(axis=(0, 1)) / len(out))
        out[:, :, spread <= NOISE * self.parameters.cable.length] = 0.0
        return out

    def _moved(self, values: Array, shapes: list[CableShape]) -> Array:
        """(n, 3, k): how misses change with the parameters."""
        parts, answers = [], Answers(self.parameters, values)
        for seen, last, shape in zip(self.observations, self._states, shapes, strict=True):
            part = np.zeros((*seen.points.shape, len(values)))
            state = None if last is None else last.rod.rod_state()
            if shape.status and state is not None:
                moves = answers.moves(state, seen.start, seen.end)
                changes(shape.buffer, shape.points, seen.points, seen.arc_length, moves, part)
                known = np.isfinite(seen.arc_length)
                if known.any():  # there the arc length stays, not its share of the length
                    share = shape.arc_length / shape.length
                    moves -= (share[:, None] * shape.tangents)[:, :, None] * answers.longer
                    some = np.empty((int(known.sum()), 3, len(values)))
                    changes(shape.buffer, shape.points, seen.points[known], seen.arc_length[known], moves, some)
                    part[known] = some
            parts.append(part)
        return np.concatenate(parts)

    def _shapes(self, values: Array) -> list[CableShape]:
        if self._last is not None and np.array_equal(self._last[0], values):
            return self._last[1]
        cable = self.parameters.make_cable(values)
        near, far = self.parameters.offset(values, "start"), self.parameters.offset(values, "end")
        options = {"points": POINTS, "tolerance": TOLERANCE * cable.length, "friction": False, **self._loads}
        plain = Problem(cable, **options)
        found: list[CableShape] = []
        states: list[_Followed | None] = []
        for seen, last, lag in zip(self.observations, self._from, self._lags, strict=True):
            if seen.acceleration is None:
                problem = copy.copy(plain)  # a rod tells by its problem that its cable is another one
            else:
                problem = plain.accelerated(seen.acceleration).damped(lag)
            start = held(seen.start, near)
            assert isinstance(start, Grip)
            problem.move(start, held(seen.end, far))
            rod = Rod() if last is None or not last.shape.status else last.rod.twin(last.problem, last.shape)
            found.append(rod.solve(problem))
            states.append(_Followed(rod, problem, found[-1]))
        self._states, self._last = states, (values.copy(), found)
        return found

    def _miss(self, i: int, shape: CableShape) -> Array:
        """(m, 3) [m] of observation i."""
        seen = self.observations[i]
        out = np.full(seen.points.shape, np.nan)
        if shape.status:
            misses(shape.buffer, shape.points, seen.points, seen.arc_length, out)
        return out
