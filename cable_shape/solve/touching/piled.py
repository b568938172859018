"""What cables that may touch each other keep from one prediction to the next: :class:`Piled`."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from cable_shape.checks import Array
from cable_shape.shape import CableShape, Status
from cable_shape.solve.rod_common import Patience
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.pile import Member, Pile
from cable_shape.solve.touching.places import Places
from cable_shape.solve.touching.rounds import Rounds
from cable_shape.solve.touching.spot import Spot, apart_from_each_other
from cable_shape.solve.touching.strands import Strands

LOST = "no equilibrium of cables that touch was found. "


class Piled:
    """The last equilibrium of some cables, the pile of those that touch in it, and what is told of them.

    Parameters
    ----------
    strands : the cables, and what solves for each alone
    time_budget : [s] of one solve, looked at between its attempts
    """

    def __init__(self, strands: Strands, time_budget: float = math.inf) -> None:
        self.strands = strands
        self._time_budget, self._deadline = time_budget, math.inf
        self._patience, self._why = Patience(), ""
        self._halvings = 0
        self._rubs = True  # whether cables go to and fro as they do, see `Pile.rubs`
        self._leaps = True  # whether another equilibrium is looked for where no way leads on
        self.afresh = True  # and from nothing, where there is none near by
        self._places = Places(strands)
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
        self.strands.accept(shapes)
        self._last = shapes, self.strands.frames(), spots, frozenset()
        self._go_on()

    def look_again(self) -> None:
        """The next solve is a new one, though no end moves."""
        self._kinds = []

    @property
    def frames(self) -> Array:
        """Those of the last equilibrium, see `Strands`; (0,) if there is none."""
        return self._frames

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

    def columns(
        self, strands: range, ends: Sequence[tuple[int, str]], clips: Sequence[tuple[int, int]]
    ) -> Array | None:
        """(s n, 3, 6 m): how these strands of a part move with ends of one, by strand and side, then with clips of it.

        Clips are told by strand and place along it. None: they have not been solved for together.
        """
        others = {strand for strand, _ in (*ends, *clips)}
        if self._group is None or not others.union(strands) <= self.touching:
            return None
        state, key = self._group.state, self.strands.key
        numbers = [state.problem.clips[key(strand)][k] for strand, k in clips]
        moved = state.sensitivities([f"{key(strand)}.{side}" for strand, side in ends], numbers)
        points = state.problem.points
        first = points * self._group.cables.index(strands[0])
        return moved[first : first + points * len(strands)]

    @property
    def state(self) -> HarnessTouchState | None:
        """The memory of those that touch; None if none do."""
        return None if self._group is None else self._group.state

    def close(self, seen: Sequence[CableShape]) -> set[int]:
        """The cables that touch another one or themselves, or nearly do, in shapes as they were seen."""
        return {cable for spot in self._places.close(seen) for cable in spot.cables}

    def overlap(self, shapes: Sequence[CableShape]) -> bool:
        """Whether shapes overlap each other or themselves."""
        return bool(self._places.overlaps(list(shapes)))

    def _piled(
        self, shapes: list[CableShape], frames: Array, spots: list[Spot], more: Collection[int] = (), finer: float = 1.0
    ) -> Pile:
        """See `Pile`."""
        return Pile(self.strands, shapes, frames, spots, more, finer, rubs=self._rubs)

    def _load(self) -> None:
        """Goes on from the last equilibrium under the loads that the problems now have."""
        self._kinds, self._reached = [], None
        if self._group is not None and self._shapes is not None:
            spots = [spot.copy() for spot in self._spots]
            self._group = self._piled(self._shapes, self._frames, spots, self._more)

    def _reported(self, free: Sequence[CableShape | None], status: Status, began: float) -> list[CableShape]:
        """The shapes of all the cables."""
        group = self._group
        shapes = list(free)
        if group is not None:
            grade = Status.UNSTABLE if status is Status.OK and not group.stable else status
            found = group.shapes(grade, "" if grade is Status.OK else grade.remedy, began)
            for i, shape in zip(group.cables, found, strict=True):
                shapes[i] = shape
        out = [shape for shape in shapes if shape is not None]
        assert len(out) == len(shapes)
        return out

    def _accept(self, shapes: list[CableShape], frames: Array) -> list[CableShape]:
        """Remembers an equilibrium; cables that have come free are let go."""
        group = self._group
        self._shapes, self._frames = shapes, frames
        if group is not None:
            self._patience.succeed()
            group.rubs = self._rubs
            for spot in group.spots:
                spot.before = spot.arcs.copy()
            lines = {i: (shape.arc_length, shape.positions) for i, shape in enumerate(shapes)}
            turned = self._places.tell_lines(group.spots, lines)
            near = [spot for spot in group.spots if spot.press > 0.0 or spot.distance < spot.near * spot.reach]
            staying = apart_from_each_other(near)
            if turned or len(staying) < len(group.spots):
                held = group.more.union(cable for spot in staying for cable in spot.cables)
                leaving = set(group.cables).difference(self.strands.hung_together(held))
                spots = staying if self.strands.comes_free(leaving, shapes, frames) else group.spots
                more = group.more
                self._group = self._piled(shapes, frames, spots, more) if spots or more else None
        self.strands.accept(shapes)
        self._last = shapes, frames, [spot.copy() for spot in self._spots], self._more
        self._reached = None
        self._rounds.begin()
        return shapes

    def _let_go(self, cables: Collection[int]) -> None:
        """Has cables go on alone from where they last were."""
        if self._shapes is not None:
            self.strands.go_on_from(cables, self._shapes, self._frames)

    def _because(self, status: Status = Status.NOT_CONVERGED) -> str:
        """Why there is no shape: grips that hold cables inside each other now, or what was found last."""
        inside = self._places.held_inside(self.strands.frames())
        return inside + status.remedy if inside else self._why

    def _alone(self, shapes: Sequence[CableShape | None]) -> list[CableShape]:
        """These, and what those have alone of which there is none."""
        known = {i for i, shape in enumerate(shapes) if shape is not None}
        alone = self.strands.alone(known) if len(known) < len(shapes) else shapes
        out = [one or other for one, other in zip(shapes, alone, strict=True)]
        return [shape for shape in out if shape is not None]

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
            self._group = self._piled(self._shapes, self._frames, spots, more)

    def _give_up(
        self, shapes: Sequence[CableShape | None], detail: str, status: Status = Status.NOT_CONVERGED
    ) -> list[CableShape]:
        """The shapes of the cables alone, those that touched or overlap so graded, and nothing to start from."""
        touching = self.touching
        self._lose()
        out = self._alone(shapes)
        if detail:
            self._patience.fail()
        self._why = (detail or LOST) + status.remedy
        why = self._because(status)
        wrong = touching | self._places.involved(out) | self._through(out)
        return [graded(shape, status, why) if shape.status and i in wrong else shape for i, shape in enumerate(out)]


def graded(shape: CableShape, status: Status, detail: str) -> CableShape:
    """The same shape with another grade."""
    other = shape.again()
    other.status, other.detail = status, detail
    other.reused, other.solve_time, other.iterations = False, shape.solve_time, shape.iterations
    return other
