"""The cheapest sufficient model: catenary, gradient cable or Cosserat rod, with hysteresis.

A closed form is taken where its distance to the rod, judged by its residual in the rod's equations
(:mod:`cable_shape.kernels.rod_judge`), and its own error together stay within the tolerance. What ``scripts/bench
cosserat`` prints of medians of the costs, at the default tolerance with 150 points, and what follows from it:

- Cold, the catenary with its judge costs a fifth of the rod where boundary layers sqrt(EI/|n|) are below 3e-4 of the
  length, and as much as the rod but for a twentieth above; the gradient cable as much as the rod above a thousandth,
  and below, where the catenary has mostly failed first, half as much again. A look at the ends rules out most of what
  is hopeless; with the rest that a cold choice tries in vain a rod costs 1.1 to 1.2 times what it costs by name.
- Warm, the rod needs the more elements the thinner its boundary layers are; closed forms do not. The catenary costs
  three quarters of the rod below 3e-4 of the length, nine tenths from there on, and at three thousandths nothing is
  gained. So a warm start beyond THICK is the rod's.
- Warm, the gradient cable costs as much as the rod or up to a tenth more: it is only taken where the catenary will not
  do, and keeps the shape that a cold choice gave. Neither is left for the other while it will do.
- The gradient cable of 6th order was never within tolerance where neither of the others was: it is not used.

Closed forms know a cable's place, not all of its loads. A cable with a limit on its twist rate is left to the rod, one
with a limit on its bend radius is not left to the catenary, and near the largest tension the rod is asked.
"""

from __future__ import annotations

import copy
import math
from time import perf_counter
from typing import Protocol, final

import numpy as np

from cable_shape.cable import Cable
from cable_shape.checks import Array
from cable_shape.kernels.prospects import prospects
from cable_shape.models import catenary, cosserat, gradient
from cable_shape.models.judge import Beside, Judge
from cable_shape.models.rod_state import RodState
from cable_shape.models.span_state import SpanState
from cable_shape.models.touch_state import TouchState
from cable_shape.pose import Grip
from cable_shape.problem import Problem
from cable_shape.shape import CableShape, Status

#: A closed form is taken instead of another model below this fraction of the tolerance, and kept up to all of it.
ENTER = 0.5
#: Solves with the rod from one attempt at a closed form to the next: at first, and at most; doubled by each failure.
SOONEST, LATEST = 8, 24
#: Fewest points on which a shape is judged.
FEWEST_POINTS = 101
#: Boundary layer / length beyond which a closed form is left for the warm rod, and below which it is taken for it.
THICK, THIN = 2.5e-3, 2e-3
#: The catenary is hopeless where the bent ends that it lacks move it by more than this times the tolerance.
_TOO_FAR = 1.0
#: The gradient cable, which knows one tension, is hopeless where slack x relative difference of the tensions at its
#: ends is more than this times the tolerance; at a tolerance of 1e-3 of the length also with more slack / length than
#: this, or ends bent by more [rad].
_TOO_UNEVEN, _TOO_SLACK, _TOO_BENT = 2.5, 0.1, 1.4
#: [rad], difference in twist beyond which two rods with the same centreline are wound differently.
_WOUND = 1.0
#: Fraction of the largest tension from which on the rod is asked.
_PULLED = 0.5
_SOLVERS = {"catenary": catenary.solve, "gradient4": gradient.solve4}


class RodSolver(Protocol):
    """The Cosserat rod with its warm start."""

    state: RodState | SpanState | None

    def solve(self, problem: Problem) -> CableShape:
        """The shape, from the last solution if there is one."""

    def go_on_from(self, problem: Problem, shape: CableShape, frames: Array) -> None:
        """Makes a shape that was found otherwise, ends in `frames` (2, 7), the last one in contact with bodies."""

    def reset(self) -> None:
        """Forgets the last solution."""

    def rod_state(self) -> RodState | SpanState | TouchState | None:
        """The memory behind the last shape."""


@final
class Auto:
    """Catenary, gradient cable and rod with their warm starts, and which of them is in use.

    Which branch and which winding a shape is on is the rod's to say: a closed form follows the rod only where both are
    the same shape, and the rod goes on from the one beside the last closed form.
    """

    __slots__ = (
        "_beside",
        "_fine",
        "_followed",
        "_in_use",
        "_judge",
        "_patience",
        "_problem",
        "_rod",
        "_wait",
        "_warm",
    )

    def __init__(self, rod: RodSolver) -> None:
        self._rod = rod
        self._judge = Judge()
        self._warm = {name: np.empty(4) for name in _SOLVERS}
        self._fine: Problem | None = None
        self._problem: Problem | None = None
        self.reset()

    def reset(self) -> None:
        """Forgets the last solution."""
        self._rod.reset()
        for warm in self._warm.values():
            warm[:] = math.nan
        self._in_use = ""  # a model; empty: cold
        self._beside: Beside | None = None  # the rod beside the last shape, while a closed form is in use
        self._followed = False  # whether the rod has been solved for there
        self._wait = self._patience = SOONEST

    def solve(self, problem: Problem) -> CableShape:
        """The shape by the cheapest sufficient model."""
        began = perf_counter()
        self._problem = problem
        rod = self._in_use == "cosserat" or _rods_own(problem)
        shape = self._by_rod(problem) if rod else self._by_closed(problem)
        shape.solve_time = perf_counter() - began
        return shape

    def go_on_from(self, problem: Problem, shape: CableShape, frames: Array) -> None:
        """As the rod does."""
        self._rod.go_on_from(problem, shape, frames)

    def rod_state(self) -> RodState | SpanState | TouchState | None:
        """The rod of the last shape, solved for now if a closed form gave it; None: no shape yet."""
        if self._beside is not None and not self._followed:
            assert self._problem is not None
            if not self._continue(self._beside):
                self._rod.solve(self._problem)
            self._followed = True
        return self._rod.rod_state()

    def _by_rod(self, problem: Problem) -> CableShape:
        """The rod, and now and then a look whether a closed form will do from the next solve on."""
        self._in_use, self._beside = "cosserat", None
        shape = self._rod.solve(problem)
        self._wait -= 1
        if self._wait <= 0:
            self._look_for_cheaper(problem, shape)
        return shape

    def _by_closed(self, problem: Problem) -> CableShape:
        """A closed form, cold the first that will do, warm that in use or, with room to spare, another; or the rod."""
        before = self._beside
        if before is None:
            names, ends = self._promising(problem), None
        else:
            names, ends = sorted(_able(problem.cable), key=lambda name: name != self._in_use), before.ends
        if before is not None and before.layer > THICK * problem.cable.length:
            names = []
        for name in names:
            room = 1.0 if before is None or name == self._in_use else ENTER
            shape = self._judged(name, problem, room * problem.tolerance, ends)
            if shape is not None:
                return shape
        self._wait = self._patience = SOONEST
        if before is not None:
            self._continue(before)
        return self._by_rod(problem)

    def _judged(self, name: str, problem: Problem, limit: float, ends: Array | None) -> CableShape | None:
        """A closed form's shape, put to use if its error estimate is at most `limit` [m]; else None."""
        fine, stride = self._finer(problem)
        shape = _SOLVERS[name](fine, self._warm[name])
        if not shape.status or _pulled(problem.cable, shape):
            return None
        if not isinstance(self._rod.state, RodState):
            self._rod.state = RodState(problem)
        error = shape.error_estimate + self._judge.estimate(problem, shape, self._rod.state, ends)
        if not error <= limit:
            return None
        shape.error_estimate = error
        if stride > 1:
            _thin_out(shape, stride)
        self._in_use, self._beside, self._followed = name, self._judge.last, False
        return shape

    def _look_for_cheaper(self, problem: Problem, shape: CableShape) -> None:
        """Puts a closed form to use if it is the same shape as the rod's."""
        state, self._wait = self._rod.state, self._patience
        if not isinstance(state, RodState) or shape.status is not Status.OK or shape.turns != 0 or _rods_own(problem):
            return
        promising = self._promising(problem)
        self._patience = min(2 * self._patience, LATEST) if promising else SOONEST
        limit = ENTER * problem.tolerance
        for name in promising:
            closed, beside = self._judged(name, problem, limit, state.ends.copy()), self._beside
            if closed is None or beside is None:
                continue
            apart = float(np.linalg.norm(closed.positions - shape.positions, axis=1).max())
            same = apart <= limit + shape.error_estimate and abs(beside.twist - shape.twist) < _WOUND
            if same and beside.layer < THIN * problem.cable.length:
                self._followed, self._patience = True, SOONEST
                return
            self._in_use, self._beside = "cosserat", None

    def _continue(self, beside: Beside) -> bool:
        """Solves for the rod beside the last closed form, between its ends; if there is none, the rod is cold."""
        problem, state = self._problem, self._rod.state
        assert problem is not None
        assert isinstance(state, RodState)
        now = problem.start, problem.end
        problem.move(beside.start, beside.end)
        fineness = 2.0 if abs(beside.twist) > _WOUND else 1.0  # a cold start's mesh tells twist to a twentieth only
        shape = cosserat.solve_beside(problem, state, beside.frames, beside.force, fineness=fineness)
        problem.move(*now)
        if shape.status is not Status.OK:
            state.history = 0
        return shape.status is Status.OK

    def _promising(self, problem: Problem) -> list[str]:
        """The closed forms that a look at the ends does not rule out, the cheaper first."""
        cable, start, end, able = problem.cable, problem.start, problem.end, _able(problem.cable)
        if not isinstance(end, Grip) or not able:
            return able
        length, near, far = cable.length, start.cable_frame.array, end.cable_frame.array
        slack = length - math.dist(near[:3].tolist(), far[:3].tolist())
        if end.cable_frame.turns != 0 or (slack <= 0.0 and cable.axial_stiffness is None):
            return []
        load: Array | None = problem.cache.get("auto")
        if load is None:
            load = problem.cache["auto"] = 0.5 * (problem.load[0] + problem.load[1])
            if len(problem.load_force):
                load += problem.load_force.sum(axis=0) / length
        seen, bend = np.empty(4), cable.mean_bending_stiffness
        if not prospects(near, far, load, length, bend, start.kind != "pinned", end.kind != "pinned", seen):
            return able
        shift, bent, uneven, layer = seen.tolist()
        if self._in_use and layer > THICK * length:
            return []
        looseness = problem.tolerance / (1e-3 * length)
        hopeless = set()
        if shift > _TOO_FAR * problem.tolerance:
            hopeless.add("catenary")
        if (
            slack * uneven > _TOO_UNEVEN * problem.tolerance
            or slack > _TOO_SLACK * looseness ** (2.0 / 3.0) * length
            or bent > _TOO_BENT * looseness ** (1.0 / 3.0)
        ):
            hopeless.add("gradient4")
        return [name for name in able if name not in hopeless]

    def _finer(self, problem: Problem) -> tuple[Problem, int]:
        """The problem with enough points for the judge, and how many of its points make one of the shape."""
        if problem.points >= FEWEST_POINTS:
            return problem, 1
        stride = math.ceil((FEWEST_POINTS - 1) / (problem.points - 1))
        if self._fine is None or self._fine.cache is not problem.cache:
            self._fine = copy.copy(problem)
            self._fine.points = stride * (problem.points - 1) + 1
        return self._fine.move(problem.start, problem.end), stride


def _able(cable: Cable) -> list[str]:
    """The closed forms that know the loads which this cable has limits of, the cheaper first."""
    if cable.max_twist_rate is not None:
        return []
    return list(_SOLVERS) if cable.min_bend_radius is None else ["gradient4"]


def _pulled(cable: Cable, shape: CableShape) -> bool:
    """Whether a shape comes near the largest tension, which closed forms know less well than the cable's place."""
    if cable.max_tension is None:
        return False
    return max(float(n @ n) for n in shape.force[[0, -1]]) > (_PULLED * cable.max_tension) ** 2


def _rods_own(problem: Problem) -> bool:
    """Whether clips, bodies or cables hold the cable, or may, or it swings, which closed forms do not know."""
    return problem.swing is not None or bool(problem.clips or problem.bodies) or problem.solves_crossing


def _thin_out(shape: CableShape, stride: int) -> None:
    """Leaves every `stride`-th point."""
    arrays = (shape.arc_length, shape.positions, shape.quaternions, shape.curvature, shape.force, shape.moment)
    shape.buffer = np.concatenate([array[::stride].ravel() for array in arrays])
    shape.points = (shape.points - 1) // stride + 1
