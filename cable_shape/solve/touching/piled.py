"""What cables that may touch each other keep from one prediction to the next: :class:`Piled`."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Protocol

import numpy as np

from cable_shape.checks import Array
from cable_shape.shape import CableShape, Status
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import Patience
from cable_shape.solve.touching.pile import Member, Pile, all_frames, carried_of
from cable_shape.solve.touching.places import Places, Spot
from cable_shape.solve.touching.rounds import Rounds

_SAME = 1e-3  #: of the length: a shape found alone is the one that has come free, if it is no further away
LOST = "no equilibrium of cables that touch was found. "


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


class Piled:
    """The last equilibrium of some cables, the pile of those that touch in it, and what is told of them.

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
        self._rounds = Rounds(self._places.pairs)
        self.reset()

    def reset(self) -> None:
        """Forgets the last equilibrium, and which way cables lie over each other."""
        #: That equilibrium, and which cables were held in it though they touched none.
        self._last: tuple[list[CableShape], Array, list[Spot], frozenset[int]] | None = None
        self._reached: Pile | None = None  # how far its cables got from there to where none was found
        self._patience.succeed()
        self._rounds.begin()
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

    def close(self, seen: Sequence[CableShape]) -> set[int]:
        """The cables that touch another one or themselves, or nearly do, in shapes as they were seen."""
        return {cable for spot in self._places.close(seen) for cable in spot.cables}

    def overlap(self, shapes: Sequence[CableShape]) -> bool:
        """Whether shapes overlap each other or themselves."""
        return bool(self._places.overlaps(list(shapes)))

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

    def _reported(self, free: Sequence[CableShape | None], status: Status, began: float) -> list[CableShape]:
        """The shapes of all the cables."""
        group = self._group
        overlap = 0.0 if group is None else group.overlap
        out: list[CableShape] = []
        for i, shape in enumerate(free):
            if group is None or i not in group.cables:
                assert shape is not None
                out.append(shape)
                continue
            grade = Status.UNSTABLE if status is Status.OK and not group.stable else status
            detail = "" if grade is Status.OK else grade.remedy
            out.append(group.shape(i, grade, detail, began, overlap))
        return out

    def _accept(self, shapes: list[CableShape], frames: Array) -> list[CableShape]:
        """Remembers an equilibrium; cables that have come free are let go."""
        group = self._group
        self._shapes, self._frames = shapes, frames
        if group is not None:
            self._patience.succeed()
            for spot in group.spots:
                spot.before = spot.arcs.copy()
            staying = [spot for spot in group.spots if spot.press > 0.0 or spot.distance < spot.near * spot.reach]
            if len(staying) < len(group.spots):
                held = group.more.union(cable for spot in staying for cable in spot.cables)
                if all(self._comes_free(cable, shapes[cable]) for cable in group.cables if cable not in held):
                    more = group.more
                    kept = staying or more
                    self._group = Pile(self._names, self.problems, shapes, frames, staying, more) if kept else None
            group = self._group
            if group is not None and self._places.tell_lines(group.spots, dict(enumerate(shapes))):
                self._group = Pile(self._names, self.problems, shapes, frames, group.spots, group.more)
        self._last = shapes, frames, [spot.copy() for spot in self._spots], self._more
        self._reached = None
        self._rounds.begin()
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
        self._why = (detail or LOST) + status.remedy
        wrong = touching | self._places.involved(out) | self._through(out)
        return [
            graded(shape, status, self._why) if shape.status and i in wrong else shape for i, shape in enumerate(out)
        ]


def graded(shape: CableShape, status: Status, detail: str) -> CableShape:
    """The same shape with another grade."""
    other = shape.again()
    other.status, other.detail = status, detail
    other.reused, other.solve_time, other.iterations = False, shape.solve_time, shape.iterations
    return other
