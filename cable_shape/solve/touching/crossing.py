"""Cables that rest on each other or on themselves, without friction, on bodies and in clips, too: docs/contact.md.

As long as no two cables overlap, and none has come past another, each is solved for alone. Otherwise those that touch
are one network, with a push where they come nearest (`pile`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from time import perf_counter
from typing import Protocol, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.pose import Grip
from cable_shape.shape import CableShape, Status
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import Patience
from cable_shape.solve.search import between
from cable_shape.solve.touching.lift import held_at, levels, lifted
from cable_shape.solve.touching.pile import Member, Pile, all_frames, carried_of
from cable_shape.solve.touching.places import Places, Spot

MOST = 8  #: contacts at a time
GROWTH = 0.3  #: of the cables' distance: by how much overlapping ones are pushed apart at a time
_FIRST_STEP, _SMALLEST_STEP = 0.25, 1.0 / 256.0
_MOST_STEPS = 60  #: on one way
_FINER, _FINEST = (1.5, 2.25), 8.0  #: times as many elements, where no way leads on; than usual, at most
_ROUNDS = 6  #: of finding places that were missed
_HALVINGS = 4  #: of a step on whose way contacts were lost
_HIGHER, _HIGHEST = 1.5, 2.0  #: times as high, until cables touch none; of the length
_WAYS = (1, 5, 25)  #: in so many steps cables are let down
_SAME = 1e-3  #: of the length: a shape found alone is the one that has come free, if it is no further away
_LOST = "no equilibrium of cables that touch was found. "
_THROUGH = (
    "no way from the last shapes leads to ones between these ends but through a cable. It stays so until "
    "the ends are back where a way leads on, or until reset: then any shape is taken. "
)


class Solo(Protocol):
    """What solves for one cable as if there were no other."""

    problem: Problem  #: moved to the ends before every solve; may be another one, of the same cable under other loads

    def alone(self) -> CableShape:
        """The shape between the problem's ends."""

    def go_on_from(self, shape: CableShape, frames: Array, links: Array) -> None:
        """Makes a shape between the ends `frames` (2, 7) the last solution, if there are bodies it may lie on.

        links (m, 7): where the links were then that carry bodies; m = 0: not known, or there are none.
        """

    def twin(self) -> Solo:
        """Once more: it goes on from the last shape, and this one stays as it is."""


@final
class Crossing:
    """Some cables, from one prediction to the next.

    Parameters
    ----------
    names : of the cables
    solos : what solves for each alone
    time_budget : [s] of one solve, looked at between its attempts
    """

    def __init__(self, names: Sequence[str], solos: Sequence[Solo], time_budget: float = math.inf) -> None:
        self.problems = [solo.problem for solo in solos]
        self._names = tuple(names)
        self._solos = list(solos)
        self._time_budget, self._deadline = time_budget, math.inf
        self._patience, self._why = Patience(), ""
        self._halvings = 0
        self._leaps = True  # whether another equilibrium is looked for where no way leads on
        self._places = Places(names, self.problems)
        self.reset()

    def reset(self) -> None:
        """Forgets the last equilibrium, and which way cables lie over each other."""
        #: That equilibrium, and which cables were held in it though they touched none.
        self._last: tuple[list[CableShape], Array, list[Spot], frozenset[int]] | None = None
        self._reached: Pile | None = None  # how far its cables got from there to where none was found
        self._patience.succeed()
        self._forget()

    def _forget(self) -> None:
        """The next solve starts from nothing."""
        self._group: Pile | None = None
        self._shapes: list[CableShape] | None = None
        self._frames: Array = np.empty(0)
        self._kinds: list[tuple[str, str]] = []

    @property
    def last(self) -> tuple[list[CableShape], list[Spot]] | None:
        """The last equilibrium, and where the cables touched; None if there is none."""
        return None if self._last is None else (self._last[0], self._last[2])

    def take_up(self, shapes: list[CableShape], spots: list[Spot]) -> None:
        """Makes shapes between the problems' ends, that touch in these places, the last equilibrium."""
        self._last = shapes, all_frames(self.problems), spots, frozenset()
        self._go_on()

    def look_again(self) -> None:
        """The next solve is a new one, though no end moves."""
        self._kinds = []

    def beside(self, cable: int, solo: Solo) -> CableShape:
        """The shape of one cable as it would be now if it were another; all here stays as it is."""
        solos = [solo if i == cable else one.twin() for i, one in enumerate(self._solos)]
        return self.among(solos).solve()[cable]

    def twin(self) -> Crossing:
        """Once more: it goes on from the last equilibrium, and this one stays as it is."""
        return self.among([solo.twin() for solo in self._solos])

    def among(self, solos: Sequence[Solo]) -> Crossing:
        """The same with these for its cables, which are almost alike: it goes on from the last equilibrium."""
        other = Crossing(self._names, solos, self._time_budget)
        other._last = self._last
        other._go_on()
        return other

    @property
    def touching(self) -> frozenset[int]:
        """The cables that are held where they touch, or nearly do."""
        return frozenset(self._group.cables) if self._group is not None else frozenset()

    @property
    def culled(self) -> int:
        """Pairs of cables, each with itself included, that bounds ruled out in the last solve."""
        return self._places.culled

    @property
    def _more(self) -> frozenset[int]:
        return self._group.more if self._group is not None else frozenset()

    @property
    def _spots(self) -> list[Spot]:
        return self._group.spots if self._group is not None else []

    def state_of(self, cable: int, told: int | None = None) -> Member | None:
        """What has solved for a cable along with others, or itself; None if nothing has.

        told: the cable that is asked how it answers; default: the same one.
        """
        both = {cable, cable if told is None else told}
        return self._group.member(cable, told) if both <= self.touching and self._group is not None else None

    def solve(self) -> list[CableShape]:
        """The shapes between the problems' ends; never raises for a physical reason: see `status`."""
        began = perf_counter()
        if self._halvings == 0:
            self._deadline = began + self._time_budget
        self._places.culled = 0
        if any(solo.problem is not problem for solo, problem in zip(self._solos, self.problems, strict=True)):
            self._load()
        frames = all_frames(self.problems)
        kinds = self._kinds_now()
        still = kinds == self._kinds and frames.tobytes() == self._frames.tobytes()
        if self._shapes is not None and still and all(kind != "free" for _, kind in kinds):
            return [shape.again() for shape in self._shapes]
        self._kinds = kinds
        if self._shapes is not None and len(frames) != len(self._frames):  # links are known, or not any more
            self._let_go(self.touching)
            self.reset()
        if self._shapes is None and self._patience.left == 0:
            self._go_on()
        if self._group is not None:
            self._group.take()
            if self._group.buried:
                return self._give_up([None] * len(self._solos), "")
        held = self.touching
        free = [solo.alone() if i not in held else None for i, solo in enumerate(self._solos)]
        if any(shape is not None and _no_place(shape) for shape in free):
            return self._give_up(free, "")
        given = [shape for shape in free if shape is not None]
        if self._shapes is None:
            wrong = self._places.involved(given) | self._through(given) if self._patience.left > 0 else set()
            if wrong:
                self._patience.left -= 1
                return [
                    _graded(shape, Status.NOT_CONVERGED, self._why) if i in wrong else shape
                    for i, shape in enumerate(given)
                ]
            return self._cold(given, frames, Status.OK, began)
        if self._group is None and not self._places.near(given, self._shapes):
            self._shapes, self._frames = given, frames
            return given
        old = [spot.copy() for spot in self._spots]
        for _ in range(_ROUNDS):
            if self._group is None or self._along(frames):
                shapes = self._reported(free, Status.OK, began)
            else:
                return self._snap(free, frames, began)
            missed = self._places.missed(shapes, self._shapes, self._spots)
            if missed is None:
                return self._by_halves(frames)
            if not missed:
                return self._accept(shapes, frames)
            pairs = {spot.cables for spot in missed}
            old = [
                spot for spot, now in zip(old, self._spots, strict=False) if now.press > 0.0 or now.cables not in pairs
            ]
            along = self._places.along_each_other(shapes, missed)
            if along:
                return self._give_up([None] * len(shapes), along)
            old += missed
            if len(old) > MOST:
                return self._give_up(free, f"the cables touch in more than {MOST} places. ")
            crowded = self._places.crowded(old)
            if crowded:
                return self._give_up(free, crowded)
            spots = [spot.copy() for spot in old]
            self._group = Pile(self._names, self.problems, self._shapes, self._frames, spots, self._more)
            free = [shape if i not in self.touching else None for i, shape in enumerate(free)]
        return self._give_up(free, _LOST)

    def close(self, seen: Sequence[CableShape]) -> set[int]:
        """The cables that touch another one or themselves, or nearly do, in shapes as they were seen."""
        return {cable for spot in self._places.close(seen) for cable in spot.cables}

    def overlap(self, shapes: Sequence[CableShape]) -> bool:
        """Whether shapes overlap each other or themselves."""
        return bool(self._places.overlaps(list(shapes)))

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
        frames = all_frames(self.problems)
        free: list[CableShape | None] = [None] * len(given)
        for _ in range(_ROUNDS):
            wrong = self._places.along_each_other(given, spots) or self._places.crowded(spots)
            if wrong or len(spots) > MOST:
                break
            for spot in spots:
                self._places.part(spot, given)
            held = {cable for spot in spots for cable in spot.cables}.union(more)
            free = [solo.alone() if i not in held else None for i, solo in enumerate(self._solos)]
            if any(shape is not None and _no_place(shape) for shape in free):
                break
            self._group = Pile(self._names, self.problems, given, frames, [spot.copy() for spot in spots], more)
            if self._group.buried or not (self._group.go(frames, search=True) and self._group.refined()):
                break
            shapes = self._reported(free, Status.OK, began)
            missed = self._places.missed(shapes, given, self._spots)
            if missed is None:
                break
            if not missed:
                self._kinds = self._kinds_now()
                return self._accept(shapes, frames)
            spots += missed
        self._forget()
        lost = Status.NOT_CONVERGED
        return [_graded(shape, lost, _LOST + lost.remedy) for shape in given]

    def _kinds_now(self) -> list[tuple[str, str]]:
        """How the ends of the cables are held."""
        return [(problem.start.kind, getattr(problem.end, "kind", "free")) for problem in self.problems]

    def _load(self) -> None:
        """Goes on from the last equilibrium under the loads that the problems now have."""
        self.problems[:] = [solo.problem for solo in self._solos]
        self._kinds, self._reached = [], None
        if self._group is not None and self._shapes is not None:
            spots = [spot.copy() for spot in self._spots]
            self._group = Pile(self._names, self.problems, self._shapes, self._frames, spots, self._more)

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
            finer_one = Pile(self._names, self.problems, shapes, self._frames, spots, self._more, finer)
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
        """By way of the ends halfway, as cables came through each other unseen on the whole way at once."""
        if self._halvings == _HALVINGS or perf_counter() > self._deadline:
            return self._give_up([None] * len(self._solos), _LOST)
        given = [(problem.start, problem.end, problem.links) for problem in self.problems]
        self._go_on()
        self._let_go(range(len(self._solos)))
        self._halvings += 1
        held_at(self.problems, between(self._frames, goal, 0.5))
        half = self.solve()
        for problem, ends in zip(self.problems, given, strict=True):
            problem.move(*ends)
        wrong = {i for i, shape in enumerate(half) if not shape.usable}
        shapes = [solo.alone() for solo in self._solos] if wrong else self.solve()
        self._halvings -= 1
        if not wrong:
            snapped = Status.SNAPPED
            return [
                _graded(shape, snapped, snapped.remedy)
                if was.status is snapped and shape.status is Status.OK
                else shape
                for was, shape in zip(half, shapes, strict=True)
            ]
        wrong |= self._places.involved(shapes) | self._through(shapes)
        return [
            _graded(shape, Status.NOT_CONVERGED, self._why) if shape.status and i in wrong else shape
            for i, shape in enumerate(shapes)
        ]

    def _snap(self, free: list[CableShape | None], frames: Array, began: float) -> list[CableShape]:
        """The branch ended: where the cables come to rest from where it did, or else from nothing."""
        group = self._group
        assert group is not None
        assert self._shapes is not None
        late = Status.BUDGET_EXCEEDED
        if perf_counter() > self._deadline:  # what has been reached is where the next solve starts
            return [_graded(shape, late, late.remedy) for shape in self._shapes]
        if not self._leaps:
            return self._give_up([None] * len(free), _LOST)
        kept = group.keep()
        found = group.go(frames, search=True)
        if found and group.refined():
            shapes = self._reported(free, Status.SNAPPED, began)
            if not (self._places.overlaps(shapes, self._spots) or self._places.gone_through(shapes, self._shapes)):
                return self._accept(shapes, frames)
        self._lose()
        if not found:
            group.restore(kept)
            self._reached = group
        alone = [shape if shape is not None else self._solos[i].alone() for i, shape in enumerate(free)]
        if any(_no_place(shape) for shape in alone):
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
                    given = [_graded(shape, status, status.remedy) for shape in given]
                return self._accept(given, frames)
            along = self._places.along_each_other(given, found)
            if along:
                return self._give_up([None] * len(shapes), along)
            for spot in found:
                self._places.part(spot, given)
                spot.reach = min(spot.reach, spot.distance)
            spots = [spot.copy() for spot in self._spots] + found
            if len(spots) > MOST:
                break
            crowded = self._places.crowded(spots)
            if crowded:
                return self._give_up(list(shapes), crowded)
            self._group = Pile(self._names, self.problems, given, frames, spots)
            if not self._grown(frames):
                let_down = self._let_down(spots, frames)
                if not let_down:
                    break
                given = let_down
            given = self._reported(list(given), status, began)
        return self._give_up(list(shapes), _LOST)

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

        Those that touch are the group then. Cables in clips are not lifted.
        """
        level = levels(spots, self._places.down) if self._leaps else {}
        if not level or any(self.problems[i].clips for i, k in level.items() if k > 0):
            return []
        height = max(self._places.reach(spot.cables) for spot in spots)
        most = _HIGHEST * max(problem.cable.length for problem in self.problems)
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
                other._lift(self.problems, level, height * k / steps)
                shapes = other.solve()
                if not all(shape.usable for shape in shapes) or other._places.overlaps(shapes, other._spots):
                    break
            else:
                if other is not None and self._take_over(other, shapes, frames):
                    return shapes
        return []

    def _held_higher(self, level: dict[int, int], height: float) -> Crossing | None:
        """These cables, held so many times this height [m] higher; None if they touch there, or have no shape."""
        other = Crossing(self._names, [solo.twin() for solo in self._solos], self._time_budget)
        other._leaps = False
        other._lift(self.problems, level, height)
        alone = [solo.alone() for solo in other._solos]
        if not all(shape.usable for shape in alone) or other._places.overlaps(alone):
            return None
        return other if all(shape.usable for shape in other.solve()) else None

    def _lift(self, given: Sequence[Problem], level: dict[int, int], height: float) -> None:
        """Holds the cables so many times a height [m] above where they are given."""
        for i, (problem, one) in enumerate(zip(self.problems, given, strict=True)):
            way = -level.get(i, 0) * height * self._places.down
            start, end = (lifted(grip, way) if isinstance(grip, Grip) else grip for grip in (one.start, one.end))
            assert isinstance(start, Grip)
            problem.move(start, end, one.links)

    def _take_over(self, other: Crossing, shapes: list[CableShape], frames: Array) -> bool:
        """Goes on from shapes that the same cables have elsewhere, between the same ends."""
        for i, (solo, shape) in enumerate(zip(self._solos, shapes, strict=True)):
            solo.go_on_from(shape, *self._ends_and_links(i, frames))
        self._group = None
        if other.touching:
            spots = [spot.copy() for spot in other._spots]
            self._group = Pile(self._names, self.problems, shapes, frames, spots, other._more)
        return self._group is None or (self._group.go(frames) and self._group.refined())

    # -- results

    def _reported(self, free: Sequence[CableShape | None], status: Status, began: float) -> list[CableShape]:
        """The shapes of all the cables."""
        group = self._group
        out: list[CableShape] = []
        for i, shape in enumerate(free):
            if group is None or i not in group.cables:
                assert shape is not None
                out.append(shape)
                continue
            grade = Status.UNSTABLE if status is Status.OK and not group.stable else status
            detail = "" if grade is Status.OK else grade.remedy
            out.append(group.shape(i, grade, detail, began))
        return out

    def _accept(self, shapes: list[CableShape], frames: Array) -> list[CableShape]:
        """Remembers an equilibrium; cables that have come free are let go."""
        group = self._group
        self._shapes, self._frames = shapes, frames
        if group is not None:
            along = self._places.along_each_other(shapes, [spot for spot in group.spots if spot.press > 0.0])
            if along:
                return self._give_up([None] * len(shapes), along)
            self._patience.succeed()
            for spot in group.spots:
                spot.before = spot.arcs.copy()
            staying = [spot for spot in group.spots if spot.press > 0.0 or spot.distance < 2.0 * spot.reach]
            if len(staying) < len(group.spots):
                held = group.more.union(cable for spot in staying for cable in spot.cables)
                if all(self._comes_free(cable, shapes[cable]) for cable in group.cables if cable not in held):
                    more = group.more
                    kept = staying or more
                    self._group = Pile(self._names, self.problems, shapes, frames, staying, more) if kept else None
        self._last = shapes, frames, [spot.copy() for spot in self._spots], self._more
        self._reached = None
        return shapes

    def _let_go(self, cables: Collection[int]) -> None:
        """Has cables go on alone from where they last were."""
        for cable in cables:
            if self._shapes is not None:
                self._solos[cable].go_on_from(self._shapes[cable], *self._ends_and_links(cable, self._frames))

    def _ends_and_links(self, cable: int, frames: Array) -> tuple[Array, Array]:
        """The cable's ends (2, 7) and the links that carry its bodies and clips (m, 7) in `frames`."""
        links = frames[2 * len(self.problems) :]
        if len(links):
            order = list(carried_of(self.problems))
            links = links[[order.index(name) for name in self.problems[cable].carried]]
        return frames[2 * cable : 2 * cable + 2], links

    def _comes_free(self, cable: int, shape: CableShape) -> bool:
        """Whether the cable alone has this shape."""
        self._solos[cable].go_on_from(shape, *self._ends_and_links(cable, self._frames))
        alone = self._solos[cable].alone()
        if not alone.status:
            return False
        return bool(np.abs(alone.positions - shape.positions).max() <= _SAME * shape.length)

    def _through(self, shapes: list[CableShape]) -> set[int]:
        """The cables that went through another one, or themselves, since the last equilibrium."""
        return set() if self._last is None else self._places.gone_through(shapes, self._last[0])

    def _lose(self) -> None:
        """No equilibrium was found from the last one on, which is where one is looked for again."""
        self._let_go(self.touching)
        self._forget()

    def _go_on(self) -> None:
        """Makes the last equilibrium that there was, if any, the one from which the next solve starts."""
        if self._last is None:
            return
        self._shapes, self._frames, spots, more = self._last
        self._group, self._reached = self._reached, None
        if (spots or more) and self._group is None:
            spots = [spot.copy() for spot in spots]
            self._group = Pile(self._names, self.problems, self._shapes, self._frames, spots, more)

    def _give_up(
        self, shapes: Sequence[CableShape | None], detail: str, status: Status = Status.NOT_CONVERGED
    ) -> list[CableShape]:
        """The shapes of the cables alone, those that touched or overlap so graded, and nothing to start from."""
        touching = self.touching
        self._lose()
        out = [shape if shape is not None else self._solos[i].alone() for i, shape in enumerate(shapes)]
        if detail:
            self._patience.fail()
        self._why = (detail or _LOST) + status.remedy
        wrong = touching | self._places.involved(out) | self._through(out)
        return [
            _graded(shape, status, self._why) if shape.status and i in wrong else shape for i, shape in enumerate(out)
        ]


def _graded(shape: CableShape, status: Status, detail: str) -> CableShape:
    """The same shape with another grade."""
    other = shape.again()
    other.status, other.detail = status, detail
    other.reused, other.solve_time, other.iterations = False, shape.solve_time, shape.iterations
    return other


def _no_place(shape: CableShape) -> bool:
    """Whether a shape tells nothing of where its cable is."""
    return not shape.status
