"""What may touch each other, as one list of strands: :class:`Strands`, of cables and of the segments of harnesses.

A strand is a cable with a name; its ends are held by grips, free, or in junctions. Those that hang together are a part:
a cable by itself (:class:`.one_cable.OneCable`), or all segments of a harness (:class:`.one_harness.OneHarness`). What
solves for a part as if it did not touch itself or others is its solo.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Protocol, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.scene.body_tables import carried_by, clip_frames, link_rows
from cable_shape.shape import NUMBERS_PER_POINT, CableShape
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.resume import numbered
from cable_shape.solve.touching.spot import Pair
from cable_shape.solve.touching.told import Told

_SAME = 1e-3  #: of the length: a shape found alone is the one that has come free, if it is no further away
_SIDES = ("start", "end")
Held = tuple[Grip | FreeEnd | None, Grip | FreeEnd | None]  #: None: an end is in a junction


class Part(Protocol):
    """A cable, or a harness: strands that hang together, by their numbers in it, and what solves for them alone.

    Frames (2 k, 7) are those of the ends of its k strands in turn; of an end that no grip holds anything. links (m, 7):
    where the links are that `problem.carried` names; m = 0: not known, or there are none.
    """

    names: tuple[str, ...]
    cables: list[Cable]

    @property
    def problem(self) -> Any:
        """A `Problem` or a `HarnessProblem`."""

    @property
    def problems(self) -> list[Problem]:
        """Of each strand."""

    def held(self, strand: int) -> Held:
        """What holds its start, and its end."""

    def joined(self, pair: Pair) -> Array:
        """See `Strands.joined`."""

    def hold(self, frames: Array, links: Mapping[str, Pose] | None) -> None:
        """Moves ends and links there."""

    def given(self) -> Any:
        """What `give_back` takes to have ends and links where they are now."""

    def give_back(self, given: Any) -> None:
        """See `given`."""

    def renewed(self) -> bool:
        """Whether the problem is another one than when this was asked last: it is under other loads."""

    def levers(self, shapes: Sequence[CableShape]) -> Array:
        """Beyond what these shapes tell: those of its levers, as buffers of one after the other."""

    def shapes(self, told: Told, rows: range) -> list[CableShape]:
        """Those of its strands in an equilibrium, of which these rows are its own."""

    def alone(self) -> list[CableShape]:
        """The shapes that it has whatever it touches."""

    def accept(self, shapes: Sequence[CableShape]) -> None:
        """Tells that these shapes are the last equilibrium."""

    def go_on_from(self, shapes: Sequence[CableShape], frames: Array, links: Array) -> None:
        """Makes shapes between ends in `frames` the last ones of what solves for it alone."""

    def learn(self, other: Any) -> None:
        """Takes over what a twin has found: its shapes may come back to this one."""

    def twin(self) -> Part:
        """Once more: it goes on from the last shapes, and this one stays as it is."""

    def higher(self, given: Any, way: Array) -> None:
        """Holds it a way (3,) [m] off where it was `given`."""

    def of(self, solo: Any) -> Part:
        """The same of what solves for a part almost alike, which goes on from the last shapes."""


@final
class Shapes:
    """Shapes of several strands, and of levers behind them, as what a harness's shape holds of its segments."""

    def __init__(self, shapes: Sequence[CableShape], levers: Sequence[Array]) -> None:
        self.points = shapes[0].points
        self.buffer: Array = np.concatenate([*(shape.buffer for shape in shapes), *levers])
        told = [numbered(shape.bodies) for shape in shapes]
        bodies = list(dict.fromkeys(one for names in told for one in names))
        self.bodies = tuple(name for name, _ in bodies)
        self.touches = [shape.touches.copy() for shape in shapes]
        for names, rows in zip(told, self.touches, strict=True):
            rows[:, 1] = [bodies.index(names[int(body)]) for body in rows[:, 1]]
        self.turns = np.zeros(self.buffer.size // (NUMBERS_PER_POINT * self.points), dtype=int)
        self.turns[: len(shapes)] = [shape.turns for shape in shapes]


@final
class Strands:
    """The strands of some parts, numbered through.

    Frames (n, 7) are those of the ends of all strands in turn, and of the links that carry bodies or clips, where they
    are known; of an end that no grip holds that of a grip of its strand, or of its part.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        self.parts = list(parts)
        self.names = tuple(name for part in parts for name in part.names)
        self.cables = [cable for part in parts for cable in part.cables]
        firsts = np.cumsum([0, *(len(part.cables) for part in parts)]).tolist()
        self._rows = [range(a, b) for a, b in pairwise(firsts)]
        self._of = [(part, i - own.start) for part, own in zip(parts, self._rows, strict=True) for i in own]

    @property
    def gravity(self) -> Array:
        """(3,) [m/s^2]."""
        gravity: Array = self.parts[0].problem.gravity
        return gravity

    def part_with(self, strand: int) -> Part:
        """The part that it belongs to."""
        return self._of[strand][0]

    def free(self, strand: int) -> tuple[bool, bool]:
        """Whether nothing is at its start, at its end."""
        start, end = self._held(strand)
        return isinstance(start, FreeEnd), isinstance(end, FreeEnd)

    def gripped(self, strand: int) -> tuple[bool, bool]:
        """Whether a grip holds its start, its end."""
        start, end = self._held(strand)
        return isinstance(start, Grip), isinstance(end, Grip)

    def _held(self, strand: int) -> Held:
        part, own = self._of[strand]
        return part.held(own)

    def held_at(self, strand: int) -> list[float]:
        """[m], arc lengths of its clips, ascending."""
        return [clip.arc_length for clip in self._problem_of(strand).clips]

    def _problem_of(self, strand: int) -> Problem:
        part, own = self._of[strand]
        return part.problems[own]

    def joined(self, pair: Pair) -> Array:
        """(2, 2) [m]: so much cable from an end of the first to one of the second tells nothing of contact; 0: any."""
        (part, a), (other, b) = (self._of[strand] for strand in pair)
        return part.joined((a, b)) if part is other else np.zeros((2, 2))

    def hung_together(self, strands: Iterable[int]) -> list[int]:
        """Those of which the network is that has these, ascending."""
        some = set(strands)
        return [i for own in self._rows if not some.isdisjoint(own) for i in own]

    def kinds(self) -> list[tuple[str, str]]:
        """How their ends are held."""
        pairs = [part.held(own) for part, own in self._of]
        return [(_kind(start), _kind(end)) for start, end in pairs]

    def frames(self) -> Array:
        """Those of now."""
        links: Mapping[str, Pose] | None = self.parts[0].problem.links
        carried = {} if links is None else self._carried
        out = np.empty((2 * len(self._of) + len(carried), 7))
        for part, own in zip(self.parts, self._rows, strict=True):
            ends = [[_frame(end) for end in part.held(k)] for k in range(len(own))]
            known = next((frame for pair in ends for frame in pair if frame is not None), _NOWHERE)
            for i, (start, end) in zip(own, ends, strict=True):
                out[2 * i] = _first(start, end, known)
                out[2 * i + 1] = _first(end, start, known)
        if links is not None and carried:
            out[2 * len(self._of) :] = link_rows(links, carried)
        return out

    def hold(self, frames: Array) -> None:
        """Moves ends and links there."""
        links = dict(zip(self._carried, map(Pose.trusted, frames[2 * len(self._of) :]), strict=False))
        for part, own in zip(self.parts, self._rows, strict=True):
            given = part.problem.links
            part.hold(frames[2 * own.start : 2 * own.stop], None if given is None else {**given, **links})

    def given(self) -> Any:
        """What `give_back` takes to have ends and links where they are now."""
        return [part.given() for part in self.parts]

    def give_back(self, given: Any) -> None:
        """See `given`."""
        for part, own in zip(self.parts, given, strict=True):
            part.give_back(own)

    def renewed(self) -> bool:
        """Whether problems are others than when this was asked last: they are under other loads."""
        return True in [part.renewed() for part in self.parts]

    def network(self, strands: Sequence[int]) -> HarnessProblem:
        """What is solved for these; each is the segment `key`."""
        only = self.parts[0].problem
        return only if self._is_harness else HarnessProblem.of_several(self._hung(strands))

    def follow(self, network: HarnessProblem, strands: Sequence[int]) -> None:
        """Puts the network's ends and links where they are now."""
        if not self._is_harness:
            network.follow(self._hung(strands))

    def key(self, strand: int) -> str:
        """Its name in networks."""
        return list(self.parts[0].problem.segments)[strand] if self._is_harness else f"c{strand}"

    @property
    def _is_harness(self) -> bool:
        """Whether they are the segments of a single harness."""
        return len(self.parts) == 1 and isinstance(self.parts[0].problem, HarnessProblem)

    def _hung(self, strands: Sequence[int]) -> list[tuple[Problem | HarnessProblem, list[str]]]:
        """The problems of the parts of these, and what their strands are called in networks."""
        return [(part.problem, [self.key(i) for i in own]) for part, own in self._parts_of(strands)]

    def _parts_of(self, strands: Collection[int]) -> Iterator[tuple[Part, range]]:
        """The parts of these, and the numbers of their strands."""
        some = set(strands)
        for part, own in zip(self.parts, self._rows, strict=True):
            if not some.isdisjoint(own):
                yield part, own

    def poses(self, state: HarnessTouchState, strands: Sequence[int], frames: Array) -> Array:
        """(k, 7), of the knots of the network of these strands, with ends and links in `frames`."""
        out, knots, problem = state.aimed(), state.cable.layout.knots, state.problem
        if problem.clips_move and problem.scene is not None:
            placed = clip_frames(problem.scene.clips, frames[2 * len(self._of) :], self._carried)
            out[state.cable.clip_rows] = placed
        for strand in strands:
            for side, gripped in enumerate(self.gripped(strand)):
                if gripped:
                    out[knots["end", f"{self.key(strand)}.{_SIDES[side]}"]] = frames[2 * strand + side]
        return out

    def start(self, strands: Sequence[int], shapes: Sequence[CableShape] | Mapping[int, CableShape]) -> Any:
        """The shapes of these, by their numbers, as that of their network, see `HarnessTouchState.start_from`."""
        levers = [part.levers([shapes[i] for i in own]) for part, own in self._parts_of(strands)]
        return Shapes([shapes[i] for i in strands], levers)

    def shapes(self, told: Told) -> list[CableShape]:
        """Those of the strands of an equilibrium."""
        out: list[CableShape] = []
        for part, own in self._parts_of(told.cables):
            out += part.shapes(told, range(len(out), len(out) + len(own)))
        return out

    def alone(self, held: Collection[int]) -> list[CableShape | None]:
        """The shapes that they have whatever they touch; None of those that are held."""
        out: list[CableShape | None] = []
        for part, own in zip(self.parts, self._rows, strict=True):
            out += part.alone() if set(own).isdisjoint(held) else [None] * len(own)
        return out

    def accept(self, shapes: Sequence[CableShape]) -> None:
        """Tells that these shapes are the last equilibrium."""
        for part, own in zip(self.parts, self._rows, strict=True):
            part.accept(shapes[own.start : own.stop])

    def go_on_from(self, strands: Collection[int], shapes: Sequence[CableShape], frames: Array) -> None:
        """Makes these shapes, between ends in `frames`, the last ones of what solves for these alone."""
        for part, own in self._parts_of(strands):
            self._lead_on(part, own, shapes, frames)

    def _lead_on(self, part: Part, own: range, shapes: Sequence[CableShape], frames: Array) -> None:
        """The same of one part."""
        links = frames[2 * len(self._of) :]
        order = list(self._carried) if len(links) else []
        rows = links[[order.index(name) for name in part.problem.carried]] if order else links
        part.go_on_from(shapes[own.start : own.stop], frames[2 * own.start : 2 * own.stop], rows)

    def comes_free(self, strands: Collection[int], shapes: Sequence[CableShape], frames: Array) -> bool:
        """Whether these have their shapes alone, too."""
        for part, own in self._parts_of(strands):
            self._lead_on(part, own, shapes, frames)
            if not all(map(_same_shape, part.alone(), shapes[own.start : own.stop])):
                return False
        return True

    def learn(self, other: Strands) -> None:
        """Takes over what twins of these have found."""
        for part, one in zip(self.parts, other.parts, strict=True):
            part.learn(one)

    def twin(self) -> Strands:
        """Once more: they go on from the last shapes, and these stay as they are."""
        return Strands([part.twin() for part in self.parts])

    def with_solo(self, strand: int, solo: Any) -> Strands:
        """The same, of twins of what solves for them; `solo` in place of that for the part of one strand."""
        own = self.part_with(strand)
        return Strands([part.of(solo) if part is own else part.twin() for part in self.parts])

    def higher(self, given: Strands, level: Mapping[int, int], way: Array) -> None:
        """Holds parts, by their numbers, so many times a way (3,) [m] off where `given` are."""
        for i, (part, one) in enumerate(zip(self.parts, given.parts, strict=True)):
            part.higher(one.given(), level.get(i, 0) * way)

    def part_numbers(self) -> list[int]:
        """Of each strand that of its part."""
        return [i for i, own in enumerate(self._rows) for _ in own]

    @property
    def _carried(self) -> Mapping[str, str]:
        """The links that carry bodies, and those that carry clips of any of these."""
        first: Mapping[str, str] = self.parts[0].problem.carried
        if len(self.parts) == 1:
            return first
        every = [clip for part in self.parts for one in part.problems for clip in one.clips]
        clips = [replace(clip, name=None) for clip in every]
        return carried_by(self.parts[0].problem.bodies, clips)


_NOWHERE: Array = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))


def _frame(end: Grip | FreeEnd | None) -> Array | None:
    """(7,), where a grip holds its cable."""
    return end.cable_frame.array if isinstance(end, Grip) else None


def _first(*frames: Array | None) -> Array:
    """The first that there is."""
    return next(frame for frame in frames if frame is not None)


def _kind(end: Grip | FreeEnd | None) -> str:
    """How an end is held."""
    if end is None:
        return "joined"
    return end.kind if isinstance(end, Grip) else "free"


def _same_shape(alone: CableShape, shape: CableShape) -> bool:
    """Whether a shape found alone is this one."""
    if not alone.status:
        return False
    return bool(np.abs(alone.positions - shape.positions).max() <= _SAME * shape.length)


def lifted(held: Grip | FreeEnd, way: Array) -> Grip | FreeEnd:
    """What holds an end, moved by `way` (3,) [m]; what is free stays so."""
    if not isinstance(held, Grip):
        return held
    pose = held.pose
    return held.at(Pose(pose.position + way, pose.quaternion))


def at_frame(grip: Grip | FreeEnd, frame: Array) -> Grip | FreeEnd:
    """The grip where it holds its cable by this frame (7,)."""
    if not isinstance(grip, Grip):
        return grip
    return grip.at(Pose.trusted(frame, grip.pose.turns) * grip.offset.inverse())
