"""How an equilibrium of a cable in clips is looked for: from the last one, along a path, from guesses."""

from __future__ import annotations

import math
from time import perf_counter
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import span_drive
from cable_shape.kernels.frames import align
from cable_shape.kernels.rod_drive import ITERATIONS, TURNED
from cable_shape.kernels.span_guess import CURVED, HANGING, WAVY
from cable_shape.kernels.span_newton import CONVERGED
from cable_shape.models.eyelets import Eyelets
from cable_shape.models.span_state import SpanState
from cable_shape.pose import multiply, rotate
from cable_shape.problem import Problem
from cable_shape.shape import CableShape

COLD_ITERATIONS, WARM_ITERATIONS, STEP_ITERATIONS = 80, 25, 12
#: A warm solve that turns a frame by more than this [rad] from its prediction is checked by small steps.
FAR = 0.7
_FAR_STEP = 0.3  #: the same on a coarser mesh
_MESHES = 12  #: so many are tried for one shape
_SAME = 0.02  #: shapes nearer to each other than this fraction of the length are one
_FIRST_STEP, _SMALLEST_STEP = 0.25, 1.0 / 256.0
#: (kind, tilt of the handles) of the guesses of `span_guess.guess`.
_HANGING, _CURVED, _MORE_CURVED, _FLAT = (HANGING, 0.0), (CURVED, 0.3), (CURVED, 0.8), (CURVED, 0.02)
_WAVY = (WAVY, 0.3)
_QUARTER_TURN = 0.25
_SLACK = 0.97  #: chord / length of the straight cable from which a shape is approached


@final
class Search:
    """The attempts of one solve; every method that returns True leaves an equilibrium as the state's last solution.

    `buffer` and `loads` take the shape and the loads on its supports, `iterations` counts Newton steps, `late` tells
    that the deadline has passed, `snapped` that the branch followed has ended on the way, `info` what the last compiled
    solve tells (see `rod_drive`).
    """

    __slots__ = ("_deadline", "_problem", "_state", "buffer", "eyelets", "info", "iterations", "late", "loads",
                 "snapped")  # fmt: skip

    def __init__(self, problem: Problem, state: SpanState, deadline: float) -> None:
        self._problem = problem
        self._state = state
        self._deadline = deadline
        self.iterations = 0
        self.late = self.snapped = False
        self.buffer = CableShape.new_buffer(problem.points)
        self.loads = np.empty((state.spans - 1, 7))
        self.info: list[float] = []
        self.eyelets = Eyelets(state, self._inner, self.out_of_time) if state.rings.size else None

    def call(
        self,
        history: int,
        most: int,
        guard: bool = True,
        output: bool = True,
        far: float = math.inf,
        near: bool = False,
        again: bool = False,
    ) -> bool:
        """Solves for the supports in the trial; True if it found an equilibrium, a stable one if guarded.

        near: what is in the trial is next to it. again: for ends that it has just been solved for; not with eyelets,
        which see to that themselves.
        """
        if self.eyelets is None:
            return self._inner(history, most, guard, output, far, again, False)
        return self.eyelets.call(history, most, guard, output, far, near or history > 0)

    def _inner(
        self, history: int, most: int, guard: bool, output: bool, far: float, again: bool, sliding: bool
    ) -> bool:
        """One compiled solve."""
        state = self._state
        code = span_drive.solve(
            state.par, state.mesh, state.sol, state.work, self.buffer, state.info, state.where, state.mask, state.place,
            state.knots, state.rings, state.acts, state.points, state.table, state.elements, state.forces, state.roll,
            self._problem.points if output else 0, history, again, sliding, guard, most, far, self.loads,
        )  # fmt: skip
        self.info = state.info.tolist()
        self.iterations += int(self.info[ITERATIONS])
        if code == CONVERGED and sliding:
            state.ran()
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
            if not self.call(0, COLD_ITERATIONS, guard=guard, near=True) and not self._again(coarse):
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

    def coarsen(self) -> None:
        """Solves on a coarser mesh, and stays with the one at hand if that does not lead to the same shape."""
        state, buffer, loads, info = self._state, self.buffer, self.loads, self.info
        kept, history = state.put_aside(), state.history
        state.next_mesh()
        self.buffer, self.loads = CableShape.new_buffer(self._problem.points), np.empty_like(loads)
        if self.call(0, WARM_ITERATIONS, far=_FAR_STEP, near=True) and not state.too_coarse(self.info):
            state.history = 1
            return
        state.put_back(kept)
        state.history = history
        self.buffer, self.loads, self.info = buffer, loads, info

    # -- from the last solution

    def follow(self, frames: Array, snaps: bool = False) -> bool:
        """Goes with the supports from where they were to `frames`, in steps as small as it takes.

        snaps: where the branch ends, let the cable fall to the next stable shape and go on.
        """
        state = self._state
        origin = state.frames.copy()
        done, step = 0.0, _FIRST_STEP
        state.history = min(state.history, 1)
        while done < 1.0:
            if self.out_of_time():
                return False
            at = min(1.0, done + step)
            state.target[:] = _between(origin, frames, at)
            if self.call(state.history, STEP_ITERATIONS, far=FAR, output=at == 1.0):
                state.history = 2
                done = at
                step *= 1.6
                if state.far_too_coarse(self.info) and state.next_mesh():
                    if not self.call(0, COLD_ITERATIONS, output=at == 1.0, near=True):
                        return False
                    state.history = 1
            else:
                step *= 0.4
                state.history = 1
                if step < _SMALLEST_STEP:
                    step = _FIRST_STEP * _FIRST_STEP
                    done = min(1.0, done + step)
                    state.target[:] = _between(origin, frames, done)
                    if not snaps or not self.call(1, COLD_ITERATIONS):
                        return False
        return True

    def wind(self, turns: int) -> bool:
        """From the winding 0, which has just been solved, to `turns` by turning the end about its d3."""
        state = self._state
        state.history = 1
        origin = state.frames.copy()
        count = round(abs(turns) / _QUARTER_TURN)
        for i in range(1, count + 1):
            half = math.pi * turns * i / count
            frames = origin.copy()
            frames[-1, 3:] = multiply(origin[-1, 3:], np.array((0.0, 0.0, math.sin(half), math.cos(half))))
            if self.out_of_time():
                return False
            state.target[:] = frames
            if self.call(state.history, WARM_ITERATIONS, far=FAR):
                state.history = 2
                if state.far_too_coarse(self.info) and state.next_mesh():
                    if not self.call(0, COLD_ITERATIONS, near=True):
                        return False
                    state.history = 1
            elif not self.follow(frames):
                state.target[:] = frames
                self.snapped = True
                if self.late or not self.call(1, COLD_ITERATIONS):
                    return False
        return True

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

    def approached(self, frames: Array) -> bool:
        """Starts from a straight cable and goes to `frames` in small steps: for supports that no guess suits."""
        state = self._state
        span = frames[state.forces, :3] - frames[0, :3]
        chord = float(np.linalg.norm(span))
        along = span / chord if chord > 0.1 * state.par[13] else rotate(frames[0, 3:], np.array((0.0, 0.0, 1.0)))
        origin = frames.copy()
        for j in range(state.spans + 1):
            origin[j, :3] = frames[0, :3] + _SLACK * state.arcs[j] * along
            align(origin[j, 3:], *along)
        if not self.guessed(origin, fineness=2.0):  # it has to do for all of the way
            return False
        state.history = 1
        return self.follow(frames, snaps=True)

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


def _between(origin: Array, goal: Array, at: float) -> Array:
    """Frames (m+1, 7) on the straight path from `origin` to `goal`: positions linear, along the shortest turn."""
    frames = (1.0 - at) * origin + at * goal
    p, q = origin[:, 3:], goal[:, 3:].copy()
    cosine = (p * q).sum(axis=1, keepdims=True)
    q[cosine[:, 0] < 0.0] *= -1.0
    angle = np.arccos(np.minimum(1.0, np.abs(cosine)))
    sine = np.where(angle > 1e-6, np.sin(angle), 1.0)
    a = np.where(angle > 1e-6, np.sin((1.0 - at) * angle) / sine, 1.0 - at)
    b = np.where(angle > 1e-6, np.sin(at * angle) / sine, at)
    turned = a * p + b * q
    frames[:, 3:] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return np.asarray(frames)
