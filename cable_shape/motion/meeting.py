"""Cables that touch each other, or themselves, as a motion knows them: what may, and how they lie where it begins."""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import Any, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import widest
from cable_shape.checks import Array
from cable_shape.kernels.contact.meeting import JOINED, KEEP, ONE, SHORTEST, TOUCHING, TWO
from cable_shape.shape import CableShape
from cable_shape.solve import cosserat, harness_search
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching import harness_solve, spot, touching
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.one_cable import OneCable
from cable_shape.solve.touching.one_harness import OneHarness, joined_ends
from cable_shape.solve.touching.state import TouchState
from cable_shape.solve.touching.strands import Strands

#: Diameters within which what folds does not mind itself.
_FOLD = 4.0


def may_touch(problem: Problem | HarnessProblem) -> Array:
    """(p, TOUCHING): which of its cables may touch each other, or themselves, as `kernels.contact.meeting` has it.

    One that folds within few diameters does not touch itself: it falls into a heap, for which there is no room.
    """
    if not problem.solves_crossing:
        return np.empty((0, TOUCHING))
    if isinstance(problem, Problem):
        cables, joined = [problem.cable], dict[spot.Pair, Array]()
    else:
        cables, joined = list(problem.harness.segments.values()), joined_ends(problem.harness)
    pull = float(np.linalg.norm(problem.gravity))
    folds = [_folds(cable, pull) for cable in cables]
    pairs = [(a, b) for a, b in combinations_with_replacement(range(len(cables)), 2) if a != b or not folds[a]]
    thick = [widest(cable) for cable in cables]
    out = np.zeros((len(pairs), TOUCHING))
    for row, (a, b) in zip(out, pairs, strict=True):
        row[[ONE, TWO]] = a, b
        row[KEEP], row[SHORTEST] = 0.5 * (thick[a] + thick[b]), spot.SHORTEST * thick[a]
        if (a, b) in joined:
            row[JOINED:] = joined[a, b].ravel()
    return out


def _folds(cable: Cable, pull: float) -> bool:
    """Whether it bends under its own weight within so few diameters, (EI / w)^(1/3), where it comes down on itself."""
    return cable.linear_density * pull * (_FOLD * widest(cable)) ** 3 > cable.mean_bending_stiffness


def lying(problem: Problem) -> CableShape:
    """At rest among bodies, in eyelets and on itself, without friction: how friction would hold it nothing tells.

    Where there is no such shape, that in which it does not mind itself: what overlaps in it comes apart as it swings.
    """
    alone = _Alone(problem)
    if not problem.solves_crossing:
        return alone.alone()
    shape = Crossing(Strands([OneCable("cable", alone)])).solve()[0]
    return shape if shape.status else alone.alone()


def harness_lying(problem: HarnessProblem) -> HarnessShape:
    """The same of a harness."""
    alone = _HarnessAlone(problem)
    if not problem.solves_crossing:
        return alone.alone()
    part = OneHarness(alone)
    shape = part.as_one(Crossing(Strands([part])).solve())
    return shape if shape.status else alone.alone()


@final
class _Alone:
    """Solves for a cable as if it did not touch itself, from nothing: see :class:`.one_cable.Solo`."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def alone(self) -> CableShape:
        """See `Solo`."""
        problem = self.problem
        return touching.solve(problem, TouchState(problem), None)[0] if problem.bodies else cosserat.solve(problem)

    def go_on_from(self, shape: CableShape, frames: Array, links: Array) -> None:
        """See `Solo`: it does not."""

    def twin(self) -> _Alone:
        """See `Solo`."""
        return self


@final
class _HarnessAlone:
    """The same of a harness: see :class:`.one_harness.HarnessSolo`."""

    def __init__(self, problem: HarnessProblem) -> None:
        self.problem = problem

    def alone(self) -> HarnessShape:
        """See `HarnessSolo`."""
        problem: Any = self.problem
        if problem.bodies:
            return harness_solve.solve(problem, HarnessTouchState(problem), None)[0]
        return harness_search.solve(problem)[0]

    def go_on_from(self, shape: HarnessShape) -> None:
        """See `HarnessSolo`: it does not."""

    def twin(self) -> _HarnessAlone:
        """See `HarnessSolo`."""
        return self
