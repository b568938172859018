"""Where no small steps lead on, a cable in contact slides to where it comes to rest: :class:`Sliding`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from time import perf_counter
from typing import Any, final

import numpy as np

from cable_shape.pose import Grip, Pose
from cable_shape.prediction.reuse import Ends, Links, kept
from cable_shape.prediction.solvers import Rod
from cable_shape.shape import CableShape, Status
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching.touching import ACCURACY

Where = tuple[Ends, Links]
_FEWEST_POINTS = 8  #: of a shape from which a motion goes on
_BESIDE = 0.01  #: of the length: an equilibrium further from where the cable came to rest is another one
_LONGEST_PAUSE, _PAUSE = 64, 16  #: steps that are let pass where a cable not known has come to no rest, or a taut one
_FAR = 0.02  #: of the length: a cable that comes to rest further away from where it was has snapped
_UNSEEN = (
    "the last shape leads on only over an obstacle, and the cable does not come to rest behind it as it moves there. "
    "It stays so until it does, or a way leads on past nothing, or until reset: then any shape is taken. "
)
#: Of the length, and rad: ends that have gone less far since then are where they were; and how many places of a way
#: are remembered, of more every other one.
_STRIDE, _PLACES = 2e-3, 128


@final
class Sliding:
    """The last usable shape of one cable, from which it goes on as one that moves where its `solver` is stuck.

    options: of :class:`cable_shape.Motion`: gravity, loads, bodies on links.
    """

    def __init__(self, solver: Rod, options: Mapping[str, Any]) -> None:
        self._solver, self._options = solver, options
        self._last: tuple[CableShape, Where] | None = None
        self._way: list[Where] = []  # where the ends have been since then, without a shape
        self._aside: Any = None  # the solver's memory, where what it remembers now is told by a motion
        self._waits, self._pause = 0, 1  # so many steps are let pass, and next time: what has just failed takes long

    def forget(self) -> None:
        """The next shape goes on from none."""
        self._last = self._aside = None
        self._way.clear()
        self._waits, self._pause = 0, 1

    def solve(self, problem: Problem) -> CableShape:
        """The solver's shape; where it is stuck or leaps, one where the cable comes to rest as it moves there.

        That is the equilibrium which the solver finds where a motion from the last shape ends, or, where it finds none
        there, what two meshes of the motion agree on. Its memory is of that, then, until it goes on:
        from its own last shape, or, where it has leapt from there, from the last one.
        """
        began, told = perf_counter(), self._aside is not None
        if told:
            self._solver.put_back(self._aside)
            self._aside = None
        shape = self._solver.solve(problem)
        if told and self._last is not None and shape.status is Status.OK:
            _note_snap(shape, self._last[0])  # the solver has gone on from another shape than the last one
        found = self._followed(shape, problem)
        found.solve_time = perf_counter() - began
        return found

    def _followed(self, shape: CableShape, problem: Problem) -> CableShape:
        """What becomes of a shape of the solver."""
        where, last = ((problem.start, problem.end), kept(problem.links)), self._last
        if not (self._solver.leaps and _may(last, problem)):
            return self._remember(shape, where)
        stuck = self._solver.stuck
        if stuck and self._waits > 0:
            self._waits -= 1
            return self._remember(shape, where)
        if not (stuck or (last is not None and _leaps(shape, last[0]))):
            return self._remember(shape, where)
        found = self._slid(last, where, problem, leapt=shape.usable)
        if found is None:
            self._waits = self._pause if stuck else 0
            if last is None or _drawn(last[0]):
                self._pause = min(2 * self._pause, _LONGEST_PAUSE if last is None else _PAUSE)
            if last is not None and shape.usable and _over(last[0], shape, problem):
                self._refuse(shape, *last, problem)
            return self._remember(shape, where)
        if last is None and found.status is Status.SNAPPED:  # from where it came to rest, which nobody has seen
            found.status, found.detail = Status.OK, ""
        elif last is not None and found.status is Status.OK:
            _note_snap(found, last[0])
        return self._remember(found, where)

    def _refuse(self, shape: CableShape, last: CableShape, then: Where, problem: Problem) -> None:
        """Makes a shape of the solver none, for no motion has seen it leap over a body, and has it come back."""
        status = Status.NOT_CONVERGED
        shape.status, shape.detail, shape.error_estimate = status, _UNSEEN + status.remedy, math.inf
        self._solver.go_back_to(problem, last, *then)

    def _remember(self, shape: CableShape, where: Where) -> CableShape:
        """Goes on from a shape, if it is usable; else the cable may have followed there, unless it is too short."""
        if shape.usable:
            self._last = shape, where
            self._way.clear()
            self._waits, self._pause = 0, 1
        elif self._last is not None and shape.status is not Status.OVERSTRETCHED:
            last, then = self._last
            taut = _drawn(last, self._solver.taut_from)
            if not taut and _moved(self._way[-1] if self._way else then, where, last.length):
                self._way.append(where)
            if len(self._way) == _PLACES:
                self._way = self._way[1::2]
        return shape

    def _slid(
        self, last: tuple[CableShape, Where] | None, where: Where, problem: Problem, *, leapt: bool
    ) -> CableShape | None:
        """Where the cable comes to rest, from nothing let down; None if that is not known. leapt: the solver has come
        elsewhere. What sticks creeps as it moves: of friction the shape tells no past, and one mesh may creep over a
        wall that holds the others. Two are to come to a shape behind a body.
        """
        from cable_shape.motion.rest import led_to_rest, let_down  # when first needed: it takes a while to load

        solver, coarser = self._solver, None
        behind: list[CableShape] = []
        if last is None:
            rests = let_down(problem, problem.scene, self._options)
        else:
            rests = led_to_rest(problem.cable, *last, [*self._way, where], problem.scene, self._options)
        for rest, still in rests:
            aside = solver.put_aside()
            solver.begin(problem, rest, near=True)
            found = solver.solve(problem)
            beside = _BESIDE * rest.length
            if found.usable and _apart(found, rest) < beside:
                seen = any(_apart(found, other) < beside for other in behind)
                if last is None or seen or not _over(last[0], found, problem):
                    found.frictionless = found.frictionless or solver.rough
                    return found
                behind.append(found)
            solver.put_back(aside)
            if not still:
                continue
            if coarser is not None:
                rest.error_estimate += _apart(rest, coarser)
                if rest.error_estimate <= max(problem.tolerance, ACCURACY * rest.length):
                    if leapt and last is not None:
                        solver.go_back_to(problem, last[0], *last[1])
                        aside = solver.put_aside()
                    self._aside = aside
                    solver.begin(problem, rest, near=True)
                    rest.frictionless = rest.frictionless or solver.rough
                    return rest
            coarser = rest
        return None


def _may(last: tuple[CableShape, Where] | None, problem: Problem) -> bool:
    """Whether there is a motion of the problem's cable from that shape on, or from none."""
    if last is not None and last[0].length != problem.cable.length:
        return False
    return problem.points >= _FEWEST_POINTS and problem.acceleration is None


def _moved(then: Where, now: Where, length: float) -> bool:
    """Whether ends or links have gone anywhere since then."""
    before, after = _poses(then), _poses(now)
    if before.keys() != after.keys():
        return True
    ways = (pose.distance(after[name]) for name, pose in before.items())
    return any(far > _STRIDE * length or turned > _STRIDE for far, turned in ways)


def _poses(where: Where) -> dict[str | int, Pose]:
    """Those of the ends that are held, by number, and of links, by name."""
    ends, links = where
    held: list[tuple[str | int, Pose]] = [(k, end.cable_frame) for k, end in enumerate(ends) if isinstance(end, Grip)]
    return dict([*held, *(links or {}).items()])


def _drawn(shape: CableShape, least: float = 0.0) -> bool:
    """Whether most of a shape is pulled, by more than this [N]: what does not go on from there is too short."""
    return bool(np.median((shape.force * shape.tangents).sum(axis=1)) > least)


def _leaps(shape: CableShape, last: CableShape) -> bool:
    """Whether no small steps have led to a shape of the solver: then nothing but bodies tells how it came there."""
    return shape.status is Status.SNAPPED and _apart(shape, last) > _FAR * shape.length


def _over(before: CableShape, after: CableShape, problem: Problem) -> bool:
    """Whether the straight way from a shape to one of the problem's leads through a body."""
    from cable_shape.motion.rest import Watch

    return Watch(problem).passed(before, after)


def _note_snap(shape: CableShape, last: CableShape) -> None:
    """Says so of a shape that is far from the last one."""
    if _apart(shape, last) > _FAR * shape.length:
        shape.status, shape.detail = Status.SNAPPED, Status.SNAPPED.remedy


def _apart(one: CableShape, other: CableShape) -> float:
    """[m], how far two shapes are apart at most."""
    return float(np.linalg.norm(one.positions - other.positions, axis=1).max())
