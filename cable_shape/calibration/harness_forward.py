"""From the numbers of a harness to misses: every observation predicted by a network of its own, warm or afresh."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.cable.harness import Harness, run_of
from cable_shape.calibration.harness_observation import HarnessObservation
from cable_shape.calibration.harness_parameters import HarnessParameters
from cable_shape.checks import Array
from cable_shape.kernels.distance.misses import misses
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.solve import harness_search
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape

#: Points of a segment that observed points are compared with; between them it is cubic.
POINTS = 41
#: [1], of the longest segment: discretisation error of a prediction.
TOLERANCE = 1e-5
#: [1], of the longest segment, root mean square: what differs by less is the same.
NOISE = 1e-6


#: What an observation's shape is followed from: where it may lie on bodies, a predictor.
Memory = HarnessNetwork | HarnessPredictor


@final
class Seen(NamedTuple):
    """The points of one observation of a harness in one array, as a fit takes them."""

    points: Array  # (n, 3) [m]
    arc_length: Array  # (n,) [m]
    group: int | None
    planar: bool = False


@final
class HarnessForward:
    """Misses of all observed points (n, 3) [m], observation by observation, and how they change with parameters.

    Shapes at new values are followed from those where the last derivatives were taken, whatever was tried in between;
    :meth:`afresh` predicts each from nothing. loads: the keyword `gravity` of :class:`HarnessProblem`.
    """

    def __init__(self, parameters: HarnessParameters, looks: Sequence[HarnessObservation], **loads: Any) -> None:
        self.parameters = parameters
        self.looks = list(looks)
        self.observations = [flat(look) for look in self.looks]
        self._loads = loads
        self._from: list[Memory | None] = [None] * len(self.looks)  # where shapes are followed from
        self._states: list[Memory | None] = self._from.copy()  # with the last values
        self._last: tuple[Array, list[HarnessShape]] | None = None  # values, and all shapes with them

    def shapes(self, values: Array) -> list[HarnessShape]:
        """Of each observation."""
        if self._last is None or not np.array_equal(self._last[0], values):
            found = self._solved(values, self._from)
            self._states = [state for _, state in found]
            self._last = values.copy(), [shape for shape, _ in found]
        return self._last[1]

    def misses(self, values: Array) -> Array:
        """(n, 3) [m]; NaN where there is no usable shape."""
        pairs = zip(self.looks, self.shapes(values), strict=True)
        return np.concatenate([missed(look, shape) for look, shape in pairs])

    def afresh(self, values: Array) -> Array:
        """`misses` of every observation predicted from nothing, as :func:`cable_shape.predict` does; from there on
        shapes are followed."""
        self._from, self._last = [None] * len(self.looks), None
        return self.misses(values)

    def jacobian(self, values: Array, now: Array) -> Array:
        """(n, 3, parameters) at `values`, where the misses are `now`; 0 where there is no shape.

        By shapes one step beside it, each followed from the one at `values`. A parameter that moves points by no more
        than the discretisation's own noise moves none.
        """
        self.shapes(values)
        self._from = self._states
        out = np.zeros((*now.shape, len(values)))
        for j, parameter in enumerate(self.parameters.each):
            there = values.copy()
            there[j] += parameter.step
            pairs = zip(self.looks, self._solved(there, self._states), strict=True)
            moved = np.concatenate([missed(look, shape) for look, (shape, _) in pairs]) - now
            moved[np.isnan(moved)] = 0.0
            if np.sqrt((moved * moved).sum() / len(now)) > NOISE * self.parameters.harness.longest:
                out[:, :, j] = moved / parameter.step
        return out

    def _solved(self, values: Array, states: Sequence[Memory | None]) -> list[tuple[HarnessShape, Memory]]:
        """Shape and memory of each observation, followed from `states`."""
        problem_of = self._problems(values)
        found: list[tuple[HarnessShape, Memory]] = []
        for look, last in zip(self.looks, states, strict=True):
            ends = self.parameters.held(values, look.ends)
            if look.lies:
                harness = self.parameters.make(values, look.lengths)
                if isinstance(last, HarnessPredictor):
                    lying = last.beside(harness)
                else:
                    lying = lies(harness, look, **self._loads)
                found.append((lying.predict(ends, acceleration=look.acceleration), lying))
                continue
            assert not isinstance(last, HarnessPredictor)
            state: Any = None if last is None or last.history == 0 else last.copied()
            found.append(harness_search.solve(problem_of(look).move(ends), state))
        return found

    def _problems(self, values: Array) -> Callable[[HarnessObservation], HarnessProblem]:
        """What makes the problem of each observation; those of the same lengths share a harness."""
        harnesses: dict[tuple[tuple[str, float], ...], Harness] = {}
        plain: dict[tuple[tuple[str, float], ...], HarnessProblem] = {}

        def made(look: HarnessObservation) -> HarnessProblem:
            key = tuple(look.lengths.items())
            if key not in harnesses:
                harnesses[key] = self.parameters.make(values, look.lengths)
                plain[key] = problem_of(harnesses[key], **self._loads)
            if look.scene is not None:
                return problem_of(harnesses[key], look, **self._loads)
            if look.acceleration is not None:
                return plain[key].moving(look.acceleration)
            return copy.copy(plain[key])  # a network tells by its problem that its harness is another one

        return made


def lies(harness: Harness, look: HarnessObservation, **loads: Any) -> HarnessPredictor:
    """What predicts an observation of a harness that may lie on bodies, from nothing."""
    tolerance = TOLERANCE * harness.longest
    return HarnessPredictor(harness, points=POINTS, tolerance=tolerance, scene=look.scene, friction=False, **loads)


def problem_of(harness: Harness, look: HarnessObservation | None = None, **loads: Any) -> HarnessProblem:
    """The problem that an observation sets, its ends not yet held."""
    scene, acceleration = (None, None) if look is None else (look.scene, look.acceleration)
    tolerance = TOLERANCE * harness.longest
    return HarnessProblem(
        harness, points=POINTS, tolerance=tolerance, scene=scene, acceleration=acceleration, friction=False, **loads
    )  # fmt: skip


def flat(look: HarnessObservation) -> Seen:
    """The points of an observation, those of one key after those of the other."""
    return Seen(
        np.concatenate(list(look.points.values())), np.concatenate(list(look.arc_length.values())), look.group
    )  # fmt: skip


def missed(look: HarnessObservation, shape: HarnessShape) -> Array:
    """(n, 3) [m]: observed points minus the shape, in the order of `flat`; NaN without a usable shape."""
    parts = [_missed(run_of(key, shape.harness), look, key, shape) for key in look.points]
    return np.concatenate(parts)


def _missed(run: Sequence[str], look: HarnessObservation, key: str, shape: HarnessShape) -> Array:
    """(m, 3) [m], of the points on one run of segments."""
    points, arc = look.points[key], look.arc_length[key]
    out = np.full(points.shape, np.nan)
    if not shape.status:
        return out
    least, from_here = np.full(len(points), np.inf), np.zeros(len(points))
    for i, name in enumerate(run):
        segment = shape.segments[name]
        own, there = np.empty(points.shape), arc - from_here
        misses(segment.buffer, segment.points, points, there, own)
        size = (own * own).sum(axis=1)
        on = (i == len(run) - 1) | (there <= segment.length)
        takes = np.where(np.isnan(arc), size < least, (there >= 0.0) & on)
        out[takes], least[takes] = own[takes], size[takes]
        from_here += segment.length
    return out
