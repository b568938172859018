"""A harness among strands, whose segments may touch each other, themselves and others: :class:`OneHarness`."""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, final

import numpy as np

from cable_shape.cable.harness import SIDES, Harness, split_end
from cable_shape.cable.pieces import widest
from cable_shape.checks import Array
from cable_shape.kernels.contact import drive
from cable_shape.pose import Pose
from cable_shape.shape import CableShape
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import MODEL
from cable_shape.solve.touching.spot import SHORTEST, Pair
from cable_shape.solve.touching.strands import Held, at_frame, lifted
from cable_shape.solve.touching.told import Told

_MOST_FOUND = 16  #: shapes that may be found on the way from one equilibrium to the next, and come back
_PARTED = 1.5  #: times as far as straight ends that leave a junction at an angle overlap
_SHARP = 0.05  #: sine of half the angle at which two ends leave a junction, below which they never part


class HarnessSolo(Protocol):
    """What solves for a harness as if its segments could not touch each other."""

    problem: HarnessProblem

    def alone(self) -> HarnessShape:
        """The shape between the problem's ends."""

    def go_on_from(self, shape: HarnessShape) -> None:
        """Makes a shape between the problem's ends the last one, if there are bodies it may lie on."""

    def twin(self) -> HarnessSolo:
        """Once more: it goes on from the last shape, and this one stays as it is."""


@final
class OneHarness:
    """See :class:`.strands.Part`; its strands are the segments, in their order. name: before theirs, "" for none."""

    def __init__(self, solo: HarnessSolo, name: str = "") -> None:
        self.solo, self.problem, self._name = solo, solo.problem, name
        harness = self.problem.harness
        self._segments = tuple(harness.segments)
        self.names = tuple(f"{name}/{one}" if name else one for one in self._segments)
        self.cables = list(harness.segments.values())
        self._joined = joined_ends(harness)
        #: Of which the strands' shapes are the segments: the one that was accepted last, if any, and the latest ones.
        self._accepted: list[HarnessShape] = []
        self._latest: list[HarnessShape] = []

    @property
    def problems(self) -> list[Problem]:
        """See `Part`."""
        return list(self.problem.segments.values())

    def held(self, strand: int) -> Held:
        """See `Part`."""
        start, end = (self.problem.ends.get(f"{self._segments[strand]}.{side}") for side in SIDES)
        return start, end

    def joined(self, pair: Pair) -> Array:
        """See `Part`."""
        found = self._joined.get(pair)
        return np.zeros((2, 2)) if found is None else found

    def hold(self, frames: Array, links: Mapping[str, Pose] | None) -> None:
        """See `Part`."""
        rows = dict(zip(self.problem.harness.ends, frames, strict=True))
        self.problem.move({end: at_frame(held, rows[end]) for end, held in self.problem.ends.items()}, links)

    def given(self) -> Any:
        """See `Part`."""
        return dict(self.problem.ends), self.problem.links

    def give_back(self, given: Any) -> None:
        """See `Part`."""
        self.problem.move(*given)

    def higher(self, given: Any, way: Array) -> None:
        """See `Part`."""
        ends, links = given
        self.problem.move({end: lifted(held, way) for end, held in ends.items()}, links)

    def renewed(self) -> bool:
        """See `Part`."""
        before, self.problem = self.problem, self.solo.problem
        return before is not self.problem

    def levers(self, shapes: Sequence[CableShape]) -> Array:
        """See `Part`."""
        if not any(end.position.any() for joint in self.problem.harness.junctions for end in joint.frames.values()):
            return np.empty(0)
        levers: Array = self._whole(shapes).buffer[len(shapes) * shapes[0].buffer.size :]
        return levers

    def shapes(self, told: Told, rows: range) -> list[CableShape]:
        """See `Part`."""
        state, problem = told.state, self.problem
        levers = told.levers_of(rows)
        loads = np.zeros((sum(map(len, problem.clips.values())), 7))
        for row, numbers in zip(rows, problem.clips.values(), strict=True):
            loads[numbers] = told.loads_on(row)
        whole = HarnessShape(
            problem.harness,
            np.concatenate([told.buffer_of(row) for row in (*rows, *levers)]),
            problem.points,
            model=MODEL,
            status=told.status,
            detail=told.detail,
            energy=told.energy_with_masses(rows, levers),
            energies=np.array([told.energy_of(row) for row in (*rows, *levers)]),
            twists=np.array([told.twist_of(row) for row in (*rows, *levers)]),
            error_estimate=told.error_estimate,
            residual=float(state.info[drive.I_RESIDUAL]),
            iterations=told.iterations,
            solve_time=told.solve_time,
            clips=loads if len(loads) else None,
            clips_of=problem.clips,
            frictionless=told.frictionless,
            touches=told.touches[rows.start : rows.stop],
            bodies=told.bodies,
        )
        whole.weigh_sections(problem.gravity)
        return self.take(whole)

    def alone(self) -> list[CableShape]:
        """See `Part`."""
        return self.take(self.solo.alone())

    def take(self, whole: HarnessShape) -> list[CableShape]:
        """The segments' shapes of a harness's."""
        self._latest = [*self._latest[1 - _MOST_FOUND :], whole]
        return list(whole.segments.values())

    def accept(self, shapes: Sequence[CableShape]) -> None:
        """See `Part`."""
        self._accepted, self._latest = [self._whole(shapes)], []

    def _whole(self, shapes: Sequence[CableShape]) -> HarnessShape:
        """The harness's shape of which these are segments, whatever they are graded."""
        every, name = [*self._accepted, *self._latest], self._segments[0]
        return next(one for one in reversed(every) if one.segments[name].buffer is shapes[0].buffer)

    def as_one(self, shapes: Sequence[CableShape]) -> HarnessShape:
        """The shape of the harness of which these are the segments, in so far as they are graded alike."""
        first, whole = shapes[0], self._whole(shapes)
        worst = max(shapes, key=lambda shape: shape.status.value)
        if whole.status is worst.status and whole.detail == worst.detail and not first.reused:
            return whole
        other = whole.again()
        other.status, other.detail, other.reused = worst.status, worst.detail, first.reused
        other.solve_time, other.iterations = first.solve_time, first.iterations
        return other

    def go_on_from(self, shapes: Sequence[CableShape], frames: Array, links: Array) -> None:
        """See `Part`."""
        given = self.given()
        _, known = given
        there = dict(zip(self.problem.carried, map(Pose.trusted, links), strict=False))
        self.hold(frames, None if known is None else {**known, **there})
        self.solo.go_on_from(self.as_one(shapes))
        self.give_back(given)

    def learn(self, other: OneHarness) -> None:
        """See `Part`."""
        self._latest = [*self._latest, *other._accepted, *other._latest]

    def twin(self) -> OneHarness:
        """See `Part`."""
        return self.of(self.solo.twin())

    def of(self, solo: Any) -> OneHarness:
        """See `Part`."""
        other = OneHarness(solo, self._name)
        other._accepted, other._latest = list(self._accepted), list(self._latest)
        return other


def joined_ends(harness: Harness) -> dict[Pair, Array]:
    """Of pairs of segments whose ends are near each other along the harness `Strands.joined`; others have none.

    Where the ways from both ends, with what lies between them, are shorter than half a circle of the cables, it is no
    contact; at a rigid junction nor where straight ends at the angle at which these leave it overlap, or nearly do.
    """
    thick = [widest(cable) for cable in harness.segments.values()]
    ends = list(harness.ends)
    most = SHORTEST * max(thick)
    out: dict[Pair, Array] = {}
    for i, end in enumerate(ends):
        for other, way in _ways_from(harness, end, most).items():
            j = ends.index(other)
            (a, side), (b, far) = divmod(i, 2), divmod(j, 2)
            if j <= i:
                continue
            reach = 0.5 * (thick[a] + thick[b])
            least = max(SHORTEST * reach, _overlap_at(harness, end, other, reach)) - way
            rows = out.setdefault((a, b), np.zeros((2, 2)))
            rows[side, far] = max(rows[side, far], least)
    return out


def _ways_from(harness: Harness, end: str, most: float) -> dict[str, float]:
    """[m], how far the ends of other segments are along the harness, if at most `most`."""
    best: dict[str, float] = {}
    queue = [(0.0, end)]
    while queue:
        way, at = heapq.heappop(queue)
        junction = harness.junction_of(at)
        if junction is None:
            continue
        lever = float(np.linalg.norm(junction.frame(at).position))
        for other in junction.ends:
            far = way + lever + float(np.linalg.norm(junction.frame(other).position))
            if other == at or far > most or far >= best.get(other, math.inf):
                continue
            best[other] = far
            name, side = split_end(other)
            beyond = f"{name}.{'end' if side == 'start' else 'start'}"
            heapq.heappush(queue, (far + harness.segments[name].length, beyond))
    best.pop(end, None)
    return best


def _overlap_at(harness: Harness, end: str, other: str, reach: float) -> float:
    """[m], how much of two ends of a rigid junction overlaps, both together, and half as much again; 0: of no such."""
    junction = harness.junction_of(end)
    if junction is None or junction is not harness.junction_of(other) or junction.kind != "rigid":
        return 0.0
    half = math.sqrt(max(0.0, 0.5 * (1.0 - float(junction.leaving(end) @ junction.leaving(other)))))
    return _PARTED * reach / half if half > _SHARP else math.inf
