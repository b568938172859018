"""From the numbers of a harness to misses: every observation predicted by a network of its own, warm or afresh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.cable.harness import Harness, run_of
from cable_shape.calibration.harness_answers import HarnessAnswers
from cable_shape.calibration.harness_observation import HarnessObservation
from cable_shape.calibration.harness_parameters import HarnessParameters
from cable_shape.checks import Array
from cable_shape.kernels.distance.misses import changes, misses
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.solve import harness_search
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.plan import Whole

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
        self._fresh = False  # whether these are from nothing

    def shapes(self, values: Array) -> list[HarnessShape]:
        """Of each observation."""
        if self._last is None or not np.array_equal(self._last[0], values):
            found = self._solved(values, self._from)
            self._states = [state for _, state in found]
            self._last = values.copy(), [shape for shape, _ in found]
            self._fresh = all(memory is None for memory in self._from)
        return self._last[1]

    def misses(self, values: Array) -> Array:
        """(n, 3) [m]; NaN where there is no usable shape."""
        pairs = zip(self.looks, self.shapes(values), strict=True)
        return np.concatenate([missed(look, shape) for look, shape in pairs])

    def afresh(self, values: Array) -> Array:
        """`misses` of every observation predicted from nothing, as :func:`cable_shape.predict` does; from there on
        shapes are followed."""
        self._from = [None] * len(self.looks)
        if not self._fresh:
            self._last = None
        return self.misses(values)

    def jacobian(self, values: Array, now: Array) -> Array:
        """(n, 3, parameters) at `values`, where the misses are `now`; 0 where there is no shape.

        By the harness's own sensitivities. A parameter that moves points by no more than the discretisation's own noise
        moves none.
        """
        shapes = self.shapes(values)
        self._from = self._states
        answers = HarnessAnswers(self.parameters, values, partial(problem_of, **self._loads))
        longer, parts = self.parameters.longer, []
        for look, shape, memory in zip(self.looks, shapes, self._states, strict=True):
            state = memory.rod_memory if isinstance(memory, HarnessPredictor) else memory
            if shape.status and state is not None:
                parts.append(_moved(look, shape, answers.moves(state, look), longer))
            else:
                parts.append(np.zeros((sum(map(len, look.points.values())), 3, len(values))))
        out = np.concatenate(parts)
        steps = np.array([parameter.step for parameter in self.parameters.each])
        spread = steps * np.sqrt((out * out).sum(axis=(0, 1)) / len(now))
        out[:, :, spread <= NOISE * self.parameters.harness.longest] = 0.0
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
        """What makes the problem of each observation that lies on nothing; those held alike share all they can.

        A new one each time: a network tells by its problem that its harness is another one.
        """
        plain: dict[tuple[object, ...], HarnessProblem] = {}

        def made(look: HarnessObservation) -> HarnessProblem:
            key = (look.acceleration is None, *look.lengths.items(), *look.supports)
            if key not in plain:
                plain[key] = problem_of(self.parameters.make(values, look.lengths), look, **self._loads)
            own = plain[key].held_elsewhere(look.scene)
            return own if look.acceleration is None else own.moving(look.acceleration)

        return made


def lies(harness: Harness, look: HarnessObservation, **loads: Any) -> HarnessPredictor:
    """What predicts an observation of a harness that may lie on bodies, from nothing."""
    tolerance = TOLERANCE * harness.longest
    return HarnessPredictor(harness, points=POINTS, tolerance=tolerance, scene=look.scene, friction=False, **loads)


def problem_of(harness: Harness, look: HarnessObservation, **loads: Any) -> HarnessProblem:
    """The problem that an observation sets, its ends not yet held."""
    return HarnessProblem(
        harness, points=POINTS, tolerance=TOLERANCE * harness.longest, scene=look.scene, acceleration=look.acceleration,
        friction=False, **loads,
    )  # fmt: skip


def flat(look: HarnessObservation) -> Seen:
    """The points of an observation, those of one key after those of the other."""
    return Seen(
        np.concatenate(list(look.points.values())), np.concatenate(list(look.arc_length.values())), look.group
    )  # fmt: skip


def missed(look: HarnessObservation, shape: HarnessShape) -> Array:
    """(n, 3) [m]: observed points minus the shape, in the order of `flat`; NaN without a usable shape."""
    parts = []
    for key, points in look.points.items():
        part = np.full(points.shape, np.nan)
        if shape.status:
            for on in _spread(look, key, shape):
                part[on.which] = on.misses
        parts.append(part)
    return np.concatenate(parts)


class _On(NamedTuple):
    """Points that are on one segment."""

    segment: str
    before: tuple[str, ...]  # segments of the run
    which: Whole  # (m,), of those of the run
    arc_length: Array  # (m,) [m], on this segment; NaN: the closest point
    misses: Array  # (m, 3) [m]


def _spread(look: HarnessObservation, key: str, shape: HarnessShape) -> list[_On]:
    """The points on one run of segments, segment by segment."""
    points, arc = look.points[key], look.arc_length[key]
    run = tuple(run_of(key, shape.harness))
    least, owner = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
    theirs, arcs, from_here = [], [], 0.0
    for i, name in enumerate(run):
        segment = shape.segments[name]
        own, there = np.empty(points.shape), arc - from_here
        misses(segment.buffer, segment.points, points, there, own)
        size = (own * own).sum(axis=1)
        on = (i == len(run) - 1) | (there <= segment.length)
        takes = np.where(np.isnan(arc), size < least, (there >= 0.0) & on)
        least[takes], owner[takes] = size[takes], i
        theirs.append(own)
        arcs.append(there)
        from_here += segment.length
    rows = [np.flatnonzero(owner == i) for i in range(len(run))]
    return [_On(run[i], run[:i], which, arcs[i][which], theirs[i][which]) for i, which in enumerate(rows) if which.size]


def _moved(look: HarnessObservation, shape: HarnessShape, moves: Array, longer: dict[str, Array]) -> Array:
    """(n, 3, k): how the misses of `look` change where all segments' points move by `moves` (s points, 3, k), in turn.

    Points of the shape keep their share of a segment; longer (k,) [m]: by how much it grows.
    """
    firsts = {name: i * shape.points for i, name in enumerate(shape.segments)}
    parts = []
    for key, points in look.points.items():
        part = np.zeros((*points.shape, moves.shape[2]))
        for on in _spread(look, key, shape):
            segment, first = shape.segments[on.segment], firsts[on.segment]
            own = moves[first : first + shape.points]
            for known in (False, True):
                rows = np.isnan(on.arc_length) != known
                if not rows.any():
                    continue
                if known:  # there the arc length along the run stays
                    before = sum((longer[name] for name in on.before), np.zeros(moves.shape[2]))
                    grown = (segment.arc_length / segment.length)[:, None] * longer[on.segment] + before
                    own = own - segment.tangents[:, :, None] * grown[:, None]
                told = np.empty((int(rows.sum()), 3, moves.shape[2]))
                changes(segment.buffer, segment.points, points[on.which[rows]], on.arc_length[rows], own, told)
                part[on.which[rows]] = told
        parts.append(part)
    return np.concatenate(parts)
