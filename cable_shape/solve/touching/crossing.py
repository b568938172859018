"""Cables and segments that rest on each other or on themselves, frictionless, on bodies, too: docs/contact.md.

As long as no two cables overlap, and none has come past another, each is solved for alone. Otherwise those that touch
are one network, with a push where they come nearest (`pile`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from time import perf_counter
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.shape import CableShape, Status
from cable_shape.solve.problem import Problem
from cable_shape.solve.search import between
from cable_shape.solve.touching.lift import levels
from cable_shape.solve.touching.pile import Pile
from cable_shape.solve.touching.piled import LOST, Piled, graded
from cable_shape.solve.touching.spot import Spot, ordered
from cable_shape.solve.touching.strands import Strands

MOST = 96  #: contacts at a time
GROWTH = 0.3  #: of the cables' distance: by how much overlapping ones are pushed apart at a time
_FIRST_STEP, _SMALLEST_STEP = 0.25, 1.0 / 256.0
_MOST_STEPS = 60  #: on one way
_FINER, _FINEST = (1.5, 2.25), 8.0  #: times as many elements, where no way leads on; than usual, at most
_ROUNDS = 6  #: of finding places that were missed
_HALVINGS = 4  #: of a step on whose way contacts were lost
_HIGHER, _HIGHEST = 1.5, 2.0  #: times as high, until cables touch none; of the length
_WAYS = (1, 5, 25)  #: in so many steps cables are let down
_THROUGH = (
    "no way from the last shapes leads to ones between these ends but through a cable. It stays so until "
    "the ends are back where a way leads on, or until reset: then any shape is taken. "
)
_ROUND = (
    "the ends of these cables have gone round each other while they had no shape, so how they lie round each other is "
    "not known. It stays so until the ends are back the way they came, or until reset: then any shape is taken. "
)


@final
class Crossing(Piled):
    """Some cables, from one prediction to the next; `strands` and `time_budget` as of :class:`Piled`."""

    def is_of(self, problem: Problem) -> bool:
        """Whether it is of this one cable under these loads."""
        return [part.problem for part in self.strands.parts] == [problem]

    def beside(self, strand: int, solo: Any) -> Crossing:
        """Once more, with another one for the part of this strand; all here stays as it is."""
        return self.among(self.strands.with_solo(strand, solo))

    def twin(self) -> Crossing:
        """Once more: it goes on from the last equilibrium, and this one stays as it is."""
        return self.among(self.strands.twin())

    def among(self, strands: Strands) -> Crossing:
        """The same with these for its cables, which are almost alike: it goes on from the last equilibrium."""
        other = Crossing(strands, self._time_budget)
        other._last = self._last
        other._go_on()
        return other

    def solve(self) -> list[CableShape]:
        """The shapes between the problems' ends; never raises for a physical reason: see `status`."""
        began = perf_counter()
        if self._halvings == 0:
            self._deadline = began + self._time_budget
        self._places.culled = 0
        strands = self.strands
        if strands.renewed():
            self._load()
        frames, kinds = strands.frames(), strands.kinds()
        still = kinds == self._kinds and frames.tobytes() == self._frames.tobytes()
        if self._shapes is not None and still and all("free" not in kind for kind in kinds):
            return [shape.again() for shape in self._shapes]
        self._kinds = kinds
        if self._shapes is not None and len(frames) != len(self._frames):  # links are known, or not any more
            self._let_go(self.touching)
            self.reset()
        round_each_other: set[int] = set()
        if self._shapes is None and self._last is not None:
            round_each_other = self._rounds.go(self._last[1], frames)
        if self._shapes is None and self._patience.left == 0 and not round_each_other:
            self._go_on()
        if self._group is not None:
            self._group.take()
            if self._group.buried:
                return self._give_up([None] * len(strands.names), "")
        held = self.touching
        free = strands.alone(held)
        if any(shape is not None and not shape.status for shape in free):
            return self._give_up(free, "")
        given = [shape for shape in free if shape is not None]
        if self._shapes is None:
            wrong = set(round_each_other)
            if self._patience.left > 0:
                wrong |= self._places.involved(given) | self._through(given)
            if wrong:
                self._patience.left = max(0, self._patience.left - 1)
                lost = Status.NOT_CONVERGED
                why = _ROUND + lost.remedy if round_each_other else self._because()
                return [graded(shape, lost, why) if i in wrong else shape for i, shape in enumerate(given)]
            return self._cold(given, frames, Status.OK, began)
        if self._group is None and not self._places.near(given, self._shapes):
            return self._accept(given, frames)
        return self._on(free, frames, began)

    def _on(self, free: list[CableShape | None], frames: Array, began: float) -> list[CableShape]:
        """From the last shapes to these ends; free: what those have alone that touch nothing so far."""
        assert self._shapes is not None
        old = [spot.copy() for spot in self._spots]
        for left in range(_ROUNDS - 1, -1, -1):
            along = self._group is None or self._along(frames)
            if along:
                shapes = self._reported(free, Status.OK, began)
            elif any(spot.stays for spot in self._spots) and self._halvings < _HALVINGS:
                return self._by_halves(frames)  # rows of contacts grow and shrink on the way
            elif perf_counter() > self._deadline:  # what has been reached is where the next solve starts
                late = Status.BUDGET_EXCEEDED
                return [graded(shape, late, late.remedy) for shape in self._shapes]
            elif not self._leaps:
                return self._give_up([None] * len(free), LOST)
            elif self._leapt(frames):
                shapes = self._reported(free, Status.SNAPPED, began)
            else:
                return self._anew(free, frames, began)
            if not (along or self._places.overlaps(shapes, self._spots) or self._through(shapes)):
                return self._accept(shapes, frames)
            missed = self._places.missed(shapes, self._shapes, self._spots)
            if not along and (missed is None or left == 0):
                return self._anew(free, frames, began)
            if missed is None:
                return self._by_halves(frames)
            if not missed:
                return self._accept(shapes, frames)
            pairs = {spot.cables for spot in missed}
            old = [
                spot
                for spot, now in zip(old, self._spots, strict=False)
                if now.press > 0.0 or now.stays or now.cables not in pairs
            ]
            old = ordered([*old, *missed])
            if len(old) > MOST:
                return self._give_up(free, f"the cables touch in more than {MOST} places. ")
            crowded = self._places.crowded(old)
            if crowded:
                return self._give_up(free, crowded)
            spots = [spot.copy() for spot in old]
            self._group = self._piled(self._shapes, self._frames, spots, self._more)
            free = [shape if i not in self.touching else None for i, shape in enumerate(free)]
        return self._give_up(free, LOST)

    def begin(self, seen: Sequence[CableShape], more: Collection[int] = ()) -> list[CableShape]:
        """Where cables come to rest from shapes that are no equilibrium, as they were seen between the problems' ends.

        Those that touch there, or nearly do, lie over each other as there. The others, all if none do, are solved for
        alone, but for those of `more`, which come to rest from what was seen, too.
        """
        began = perf_counter()
        self.reset()
        self._deadline = began + self._time_budget
        given, spots = list(seen), self._places.close(seen)
        if not (spots or more):
            return self.solve()
        frames = self.strands.frames()
        free: list[CableShape | None] = [None] * len(given)
        for _ in range(_ROUNDS):
            if self._places.crowded(spots) or len(spots) > MOST:
                break
            spots = ordered(spots)
            for spot in spots:
                self._places.part(spot, given)
            held = {cable for spot in spots for cable in spot.cables}.union(more)
            free = self.strands.alone(held)
            if any(shape is not None and not shape.status for shape in free):
                break
            self._group = self._piled(given, frames, [spot.copy() for spot in spots], more)
            self._group.rubs = False
            if self._group.buried or not (self._group.go(frames, search=True) and self._group.refined()):
                break
            shapes = self._reported(free, Status.OK, began)
            missed = self._places.missed(shapes, given, self._spots)
            if missed is None:
                break
            if not missed:
                self._kinds = self.strands.kinds()
                return self._accept(shapes, frames)
            spots += missed
        self._forget()
        lost = Status.NOT_CONVERGED
        return [graded(shape, lost, LOST + lost.remedy) for shape in given]

    # -- attempts

    def _along(self, goal: Array) -> bool:
        """Goes with the ends from where they were to `goal` (k, 2, 7).

        Where no way leads there on the mesh as it is, on finer ones: a crossing may have come next to a contact.
        """
        usual, shapes = self._group, self._shapes
        assert usual is not None
        if self._in_steps(usual, goal):
            return True
        if shapes is None or perf_counter() > self._deadline:
            return False
        for finer in (usual.finer * factor for factor in _FINER if usual.finer * factor < _FINEST):
            spots = [spot.copy() for spot in usual.spots]
            finer_one = self._piled(shapes, self._frames, spots, self._more, finer)
            self._group = finer_one
            if self._in_steps(finer_one, goal):
                return True
        self._group = usual
        return False

    def _in_steps(self, group: Pile, goal: Array) -> bool:
        """Whether a pile goes with the ends from where they were to `goal`, in steps as small as it takes."""
        origin, kept = group.frames.copy(), group.keep()
        start, first = kept, True
        done, step = 0.0, 1.0
        for _ in range(_MOST_STEPS):
            if done == 1.0:
                if not group.refined():
                    return False
                if not (group.coarse and first):
                    return True
                group.restore(start)  # on another way, contacts may come to lie where they can be told more exactly
                done, step, first = 0.0, _FIRST_STEP, False
            if perf_counter() > self._deadline:
                return False
            at = min(1.0, done + step)
            if group.go(goal if at == 1.0 else between(origin, goal, at)):
                done, kept = at, group.keep()
                step *= 1.6
            else:
                group.restore(kept)
                step = min(0.4 * step, _FIRST_STEP)
                if step < _SMALLEST_STEP:
                    break
        return False

    def _by_halves(self, goal: Array) -> list[CableShape]:
        """By way of the ends halfway, where at once cables came through each other unseen, or no way was found."""
        if self._halvings == _HALVINGS or perf_counter() > self._deadline:
            return self._give_up([None] * len(self.strands.names), LOST)
        given = self.strands.given()
        self._go_on()
        self._let_go(range(len(self.strands.names)))
        self._halvings += 1
        self.strands.hold(between(self._frames, goal, 0.5))
        half = self.solve()
        self.strands.give_back(given)
        wrong = {i for i, shape in enumerate(half) if not shape.usable}
        shapes = self._alone([None] * len(half)) if wrong else self.solve()
        self._halvings -= 1
        if not wrong:
            snapped = Status.SNAPPED
            return [
                graded(shape, snapped, snapped.remedy) if was.status is snapped and shape.status is Status.OK else shape
                for was, shape in zip(half, shapes, strict=True)
            ]
        wrong |= self._places.involved(shapes) | self._through(shapes)
        why = self._because()
        return [
            graded(shape, Status.NOT_CONVERGED, why) if shape.status and i in wrong else shape
            for i, shape in enumerate(shapes)
        ]

    def _leapt(self, frames: Array) -> bool:
        """Whether the cables come to rest from where their branch has ended."""
        group = self._group
        assert group is not None
        kept = group.keep()
        if not group.go(frames, search=True):
            group.restore(kept)
            return False
        return group.refined()

    def _anew(self, free: list[CableShape | None], frames: Array, began: float) -> list[CableShape]:
        """The branch ended, and led nowhere from there: from nothing."""
        group = self._group
        assert group is not None
        found = group.frames.tobytes() == frames.tobytes()
        self._lose()
        if not found:
            self._reached = group
        if not self.afresh:
            return self._give_up([None] * len(free), LOST)
        alone = self._alone(free)
        if not all(shape.status for shape in alone):
            return self._give_up(alone, "")
        return self._cold(alone, frames, Status.SNAPPED, began)

    def _cold(self, shapes: list[CableShape], frames: Array, status: Status, began: float) -> list[CableShape]:
        """From the shapes alone: where they overlap they are pushed apart, the way that is nearest, or else let down.

        Those that run through each other's middle go over each other in the order of their names, or of arc length.
        """
        spots: list[Spot] = []
        given = shapes
        for _ in range(_ROUNDS):
            found = self._places.overlaps(given, self._spots)
            if perf_counter() > self._deadline:
                return self._give_up(list(shapes), "", Status.BUDGET_EXCEEDED)
            if not found:
                if self._through(given):
                    return self._give_up([None] * len(shapes), _THROUGH)
                if status is not Status.OK and self._group is None:
                    given = [graded(shape, status, status.remedy) for shape in given]
                return self._accept(given, frames)
            for spot in found:
                self._places.part(spot, given)
                spot.reach = min(spot.reach, spot.distance)
            spots = ordered([*(spot.copy() for spot in self._spots), *found])
            if len(spots) > MOST:
                break
            crowded = self._places.crowded(spots)
            if crowded:
                return self._give_up(list(shapes), crowded)
            self._group = self._piled(given, frames, spots)
            self._group.rubs = False
            if not self._grown(frames):
                let_down = self._let_down(spots, frames)
                if not let_down:
                    break
                given = let_down
            given = self._reported(list(given), status, began)
        return self._give_up(list(shapes), LOST)

    def _grown(self, frames: Array) -> bool:
        """Pushes the cables apart, little by little, until they do not overlap."""
        group = self._group
        assert group is not None
        full = np.array([self._places.reach(spot.cables) for spot in group.spots])
        reach = np.array([spot.reach for spot in group.spots])
        step = GROWTH
        while perf_counter() < self._deadline:
            kept = group.keep()
            to = np.minimum(full, reach + step * full)
            for spot, value in zip(group.spots, to.tolist(), strict=True):
                spot.reach = value
            if group.go(frames, search=True):
                reach = to
                if (reach == full).all():
                    return group.refined()
                step *= 1.5
            else:
                group.restore(kept)
                step *= 0.4
                if step < _SMALLEST_STEP:
                    break
        return False

    def _let_down(self, spots: Sequence[Spot], frames: Array) -> list[CableShape]:
        """The shapes of cables that are held higher the more others lie below them, and let down on those; none: no
        way.

        Those that touch are the group then. What is in clips is not lifted.
        """
        parts = self.strands.part_numbers()
        level = levels(spots, parts, self._places.down) if self._leaps else {}
        if not level or any(self.strands.held_at(i) for i, part in enumerate(parts) if level.get(part, 0) > 0):
            return []
        height = max(self._places.reach(spot.cables) for spot in spots)
        most = _HIGHEST * max(cable.length for cable in self.strands.cables)
        while self._held_higher(level, height) is None:
            height *= _HIGHER
            if height > most or perf_counter() > self._deadline:
                return []
        for steps in _WAYS:
            other = self._held_higher(level, height)
            shapes: list[CableShape] = []
            for k in range(steps - 1, -1, -1):
                if other is None or perf_counter() > self._deadline:
                    return []
                other._lift(self, level, height * k / steps)
                shapes = other.solve()
                if not all(shape.usable for shape in shapes) or other._places.overlaps(shapes, other._spots):
                    break
            else:
                if other is not None and self._take_over(other, shapes, frames):
                    return shapes
        return []

    def _held_higher(self, level: dict[int, int], height: float) -> Crossing | None:
        """These parts, held so many times this height [m] higher; None if they touch there, or have no shape."""
        other = Crossing(self.strands.twin(), self._time_budget)
        other._leaps = other._rubs = False
        other._lift(self, level, height)
        alone = other._alone([None] * len(other.strands.names))
        if not all(shape.usable for shape in alone) or other._places.overlaps(alone):
            return None
        return other if all(shape.usable for shape in other.solve()) else None

    def _lift(self, given: Crossing, level: dict[int, int], height: float) -> None:
        """Holds parts so many times a height [m] above where they are given."""
        self.strands.higher(given.strands, level, -height * self._places.down)

    def _take_over(self, other: Crossing, shapes: list[CableShape], frames: Array) -> bool:
        """Goes on from shapes that the same cables have elsewhere, between the same ends."""
        self.strands.learn(other.strands)
        self.strands.go_on_from(range(len(shapes)), shapes, frames)
        self._group = None
        if other.touching:
            spots = [spot.copy() for spot in other._spots]
            self._group = self._piled(shapes, frames, spots, other._more)
            self._group.rubs = False
        return self._group is None or (self._group.go(frames) and self._group.refined())
