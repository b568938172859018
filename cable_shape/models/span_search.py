"""How an equilibrium of a cable in clips is looked for: from the last one, along a path, from guesses."""

from __future__ import annotations

import math
from time import perf_counter
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import span_drive
from cable_shape.kernels.span_drive import ITERATIONS, TURNED
from cable_shape.kernels.span_guess import CURVED, HANGING, WAVY
from cable_shape.kernels.span_newton import CONVERGED
from cable_shape.models.span_state import SpanState
from cable_shape.problem import Problem
from cable_shape.shape import CableShape

COLD_ITERATIONS, WARM_ITERATIONS, STEP_ITERATIONS = 80, 25, 12
#: A warm solve that turns a frame by more than this [rad] from its prediction is checked by small steps.
FAR = 0.7
_MESHES = 12  #: so many are tried for one shape
_SAME = 0.02  #: shapes nearer to each other than this fraction of the length are one
#: (kind, tilt of the handles) of the guesses of `span_guess.guess`.
_HANGING, _CURVED, _MORE_CURVED, _FLAT = (HANGING, 0.0), (CURVED, 0.3), (CURVED, 0.8), (CURVED, 0.02)
_WAVY = (WAVY, 0.3)


@final
class Search:
    """The attempts of one solve; every method that returns True leaves an equilibrium as the state's last solution.

    `buffer` and `loads` take the shape and the loads on its supports, `iterations` counts Newton steps, `late` tells
    that the deadline has passed, `snapped` that the branch followed has ended on the way, `info` what the last compiled
    solve tells (see `span_drive`).
    """

    __slots__ = ("_deadline", "_problem", "_state", "buffer", "info", "iterations", "late", "loads", "snapped")

    def __init__(self, problem: Problem, state: SpanState, deadline: float) -> None:
        self._problem = problem
        self._state = state
        self._deadline = deadline
        self.iterations = 0
        self.late = self.snapped = False
        self.buffer = CableShape.new_buffer(problem.points)
        self.loads = np.empty((state.spans - 1, 7))
        self.info: list[float] = []

    def call(
        self,
        history: int,
        most: int,
        guard: bool = True,
        output: bool = True,
        far: float = math.inf,
        again: bool = False,
    ) -> bool:
        """Solves for the supports in the trial; True if it found an equilibrium, a stable one if guarded.

        again: for ends that it has just been solved for.
        """
        state = self._state
        code = span_drive.solve(
            state.par, state.mesh, state.sol, state.work, self.buffer, state.info, state.where, state.mask, state.place,
            state.knots, state.rings, state.acts, state.points, state.table, state.elements, state.forces, state.roll,
            self._problem.points if output else 0, history, again, False, guard, most, far, self.loads,
        )  # fmt: skip
        self.info = state.info.tolist()
        self.iterations += int(self.info[ITERATIONS])
        return bool(code == CONVERGED)

    def out_of_time(self) -> bool:
        """Whether the deadline has passed; checked between attempts."""
        self.late = self.late or perf_counter() > self._deadline
        return self.late

    def refine(self, guard: bool = True) -> bool:
        """New meshes until the error is within tolerance; False if a finer one loses the equilibrium."""
        state = self._state
        followed = state.history > 0
        coarse = self._positions().copy()
        for _ in range(_MESHES):
            if self.out_of_time() or not state.next_mesh():
                return True
            if not self.call(0, COLD_ITERATIONS, guard=guard) and not self._again(coarse):
                return False
            if followed and guard and self.info[TURNED] > FAR:
                self.snapped = True  # at a fold, which a coarse mesh puts a little further on
            if not state.too_coarse(self.info):
                return True
        return True

    def _again(self, coarse: Array) -> bool:
        """From the guesses to the shape whose positions (n, 3) a coarse mesh gave, on a mesh of its own."""
        state = self._state
        frames = state.target.copy()
        for kind, sag in self._guesses(frames):
            state.first_mesh(frames, 2.0)
            state.start_from(frames, kind, sag)
            if self.call(0, COLD_ITERATIONS):
                apart = self._positions() - coarse
                if float((apart * apart).sum(axis=1).max()) < (_SAME * state.par[13]) ** 2:
                    return True
        return False

    def _positions(self) -> Array:
        n = self._problem.points
        return self.buffer[n : 4 * n].reshape(n, 3)

    # -- from nothing

    def guessed(self, frames: Array, guard: bool = True, fineness: float = 1.0) -> bool:
        """Tries the guesses, the likeliest first, on meshes so many times as fine as usual."""
        state = self._state
        for kind, sag in self._guesses(frames):
            if self.out_of_time():
                return False
            state.first_mesh(frames, fineness)
            state.start_from(frames, kind, sag)
            if self.call(0, COLD_ITERATIONS, guard=guard):
                return True
        return False

    def _guesses(self, frames: Array) -> tuple[tuple[int, float], ...]:
        """Which guesses, in which order: soft or taut cables hang, stiff ones curve."""
        state = self._state
        weight = float(np.linalg.norm(self._problem.load.mean(axis=0) + state.weights.sum(axis=0) / state.par[13]))
        lengths = np.diff(state.arcs)[: state.forces]
        chords = np.linalg.norm(np.diff(frames[:, :3], axis=0), axis=1)[: state.forces]
        soft = state.bend < weight * (0.3 * lengths.max()) ** 3
        if weight == 0.0:
            return (_WAVY, _CURVED, _MORE_CURVED, _FLAT, _HANGING)
        if soft or (chords > 0.97 * lengths).any():
            return (_HANGING, _CURVED, _MORE_CURVED, _FLAT, _WAVY)
        return (_CURVED, _HANGING, _MORE_CURVED, _FLAT, _WAVY)
