"""The segments of a harness, which may touch each other and themselves, as strands: :class:`HarnessStrands`."""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Protocol, final

import numpy as np

from cable_shape.cable.harness import SIDES, Harness, split_end
from cable_shape.cable.pieces import widest
from cable_shape.cable.rest_form import third_axis
from cable_shape.checks import Array
from cable_shape.kernels.contact import drive
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.scene.body_tables import clip_frames, link_rows
from cable_shape.shape import CableShape
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.rod_common import MODEL
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.spot import SHORTEST, Pair
from cable_shape.solve.touching.strands import at_frame, same_shape
from cable_shape.solve.touching.told import Told

_NOWHERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_PARTED = 1.5  #: times as far as straight ends that leave a junction at an angle overlap
_SHARP = 0.05  #: sine of half the angle at which two ends leave a junction, below which they never part


class HarnessSolo(Protocol):
    """What solves for a harness as if its segments could not touch each other."""

    problem: HarnessProblem

    def alone(self) -> HarnessShape:
        """The shape between the problem's ends."""

    def go_on_from(self, shape: HarnessShape) -> None:
        """Makes a shape between the problem's ends the last one, if there are bodies it may lie on."""


@final
class HarnessStrands:
    """See :class:`.strands.Strands`; all segments are solved for together, if any."""

    def __init__(self, solo: HarnessSolo) -> None:
        self.solo = solo
        self.problem = solo.problem
        self.names = tuple(self.problem.segments)
        self.cables = list(self.problem.harness.segments.values())
        self._joined = joined_ends(self.problem.harness)
        #: Of which the strands' shapes are the segments: the one that was accepted last, if any, and the latest ones.
        self._accepted: list[HarnessShape] = []
        self._latest: list[HarnessShape] = []

    @property
    def gravity(self) -> Array:
        """See `Strands`."""
        return self.problem.gravity

    def free(self, strand: int) -> tuple[bool, bool]:
        """See `Strands`."""
        return self._are(strand, FreeEnd)

    def gripped(self, strand: int) -> tuple[bool, bool]:
        """See `Strands`."""
        return self._are(strand, Grip)

    def _are(self, strand: int, kind: type) -> tuple[bool, bool]:
        """Whether its start, its end, are of a kind."""
        start, end = (isinstance(self.problem.ends.get(f"{self.names[strand]}.{side}"), kind) for side in SIDES)
        return start, end

    def held_at(self, strand: int) -> list[float]:
        """See `Strands`."""
        return [clip.arc_length for clip in self.problem.segments[self.names[strand]].clips]

    def joined(self, pair: Pair) -> Array:
        """See `Strands`."""
        found = self._joined.get(pair)
        return np.zeros((2, 2)) if found is None else found

    def hung_together(self, strands: Iterable[int]) -> list[int]:
        """See `Strands`."""
        return list(range(len(self.names))) if set(strands) else []

    def kinds(self) -> list[tuple[str, str]]:
        """See `Strands`."""
        return [(end, getattr(held, "kind", "free")) for end, held in self.problem.ends.items()]

    def frames(self) -> Array:
        """See `Strands`."""
        problem = self.problem
        carried = problem.carried if problem.links is not None else {}
        out = np.tile(_NOWHERE, (2 * len(self.names) + len(carried), 1))
        for row, end in self._rows():
            held = problem.ends[end]
            if isinstance(held, Grip):
                out[row] = held.cable_frame.array
        if problem.links is not None and carried:
            out[2 * len(self.names) :] = link_rows(problem.links, carried)
        return out

    def _rows(self) -> list[tuple[int, str]]:
        """Rows of frames that belong to open ends."""
        ends = [f"{name}.{side}" for name in self.names for side in SIDES]
        return [(row, end) for row, end in enumerate(ends) if end in self.problem.ends]

    def hold(self, frames: Array) -> None:
        """See `Strands`."""
        problem = self.problem
        ends = {end: at_frame(problem.ends[end], frames[row]) for row, end in self._rows()}
        links = dict(zip(problem.carried, map(Pose.trusted, frames[2 * len(self.names) :]), strict=False))
        problem.move(ends, None if problem.links is None else {**problem.links, **links})

    def given(self) -> Any:
        """See `Strands`."""
        return dict(self.problem.ends), self.problem.links

    def give_back(self, given: Any) -> None:
        """See `Strands`."""
        self.problem.move(*given)

    def renewed(self) -> bool:
        """See `Strands`."""
        before, self.problem = self.problem, self.solo.problem
        return before is not self.problem

    def network(self, strands: Sequence[int]) -> HarnessProblem:
        """See `Strands`."""
        return self.problem

    def key(self, strand: int) -> str:
        """See `Strands`."""
        return self.names[strand]

    def follow(self, network: HarnessProblem, strands: Sequence[int]) -> None:
        """See `Strands`: it is the harness itself."""

    def poses(self, state: HarnessTouchState, strands: Sequence[int], frames: Array) -> Array:
        """See `Strands`."""
        problem, out = self.problem, state.aimed()
        knots = state.cable.layout.knots
        if problem.clips_move and problem.scene is not None:
            placed = clip_frames(problem.scene.clips, frames[2 * len(self.names) :], problem.carried)
            out[state.cable.clip_rows] = placed
        for row, end in self._rows():
            if isinstance(problem.ends[end], Grip):
                out[knots["end", end]] = frames[row]
        return out

    def start(self, strands: Sequence[int], shapes: Sequence[CableShape] | Mapping[int, CableShape]) -> Any:
        """See `Strands`."""
        return self._whole(shapes)

    def shapes(self, told: Told) -> list[CableShape]:
        """See `Strands`."""
        state, problem = told.state, self.problem
        turned, count = state.info[drive.INFO :], state.gaps.size
        bodies, touches = told.touches(self.names, self.cables)
        whole = HarnessShape(
            problem.harness,
            told.buffer.copy(),
            problem.points,
            model=MODEL,
            status=told.status,
            detail=told.detail,
            energy=float(state.info[drive.I_ENERGY]) + state.energy_of_masses(),
            energies=turned[2 * count :].copy(),
            twists=turned[: 2 * count : 2].copy(),
            error_estimate=told.error_estimate,
            residual=float(state.info[drive.I_RESIDUAL]),
            iterations=told.iterations,
            solve_time=told.solve_time,
            clips=told.loads if len(told.loads) else None,
            clips_of=problem.clips,
            touches=touches,
            bodies=bodies,
        )
        state.cable.weigh_sections(whole)
        return self.take(whole)

    def alone(self, held: Collection[int]) -> list[CableShape | None]:
        """See `Strands`."""
        return [None] * len(self.names) if held else list(self.take(self.solo.alone()))

    def take(self, whole: HarnessShape) -> list[CableShape]:
        """The segments' shapes of a harness's."""
        self._latest = [*self._latest[-3:], whole]
        return list(whole.segments.values())

    def accept(self, shapes: Sequence[CableShape]) -> None:
        """See `Strands`."""
        self._accepted = [self._whole(shapes)]

    def _whole(self, shapes: Sequence[CableShape] | Mapping[int, CableShape]) -> HarnessShape:
        """The harness's shape of which these are segments, whatever they are graded."""
        every, name = [*self._accepted, *self._latest], self.names[0]
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

    def go_on_from(self, strands: Collection[int], shapes: Sequence[CableShape], frames: Array) -> None:
        """See `Strands`."""
        if strands:
            given = self.given()
            self.hold(frames)
            self.solo.go_on_from(self.as_one(shapes))
            self.give_back(given)

    def comes_free(self, strands: Collection[int], shapes: Sequence[CableShape], frames: Array) -> bool:
        """See `Strands`."""
        if not strands:
            return True
        self.go_on_from(strands, shapes, frames)
        alone = self.take(self.solo.alone())
        return all(same_shape(one, shape) for one, shape in zip(alone, shapes, strict=True))

    def of(self, solo: HarnessSolo) -> HarnessStrands:
        """The same of what solves for a harness almost alike, which goes on from the last shape."""
        other = HarnessStrands(solo)
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
    ways = []
    for one in (end, other):
        axis = third_axis(junction.frame(one).quaternion[None])[0]
        ways.append(axis if split_end(one)[1] == "start" else -axis)
    half = math.sqrt(max(0.0, 0.5 * (1.0 - float(ways[0] @ ways[1]))))
    return _PARTED * reach / half if half > _SHARP else math.inf
