"""How the equilibrium of a harness is looked for, and graded: :func:`solve`."""

from __future__ import annotations

import math
from time import perf_counter
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.harness_problem import HarnessProblem
from cable_shape.harness_shape import HarnessShape
from cable_shape.kernels.network import drive, tables
from cable_shape.kernels.network.drive import I_ENERGY, I_ESTIMATE, I_FORCE, I_MOMENT, I_RESIDUAL, I_TURNED, INFO
from cable_shape.kernels.network.guess import CURVED, HANGING
from cable_shape.shape import NUMBERS_PER_POINT, Status
from cable_shape.solve.harness_guess import laid
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_outcome import laid_straight, out_of_reach
from cable_shape.solve.outcome import MODEL
from cable_shape.solve.search import FAR, WARM_ITERATIONS, _FAR_STEP, _SAME, Search
from cable_shape.solve.settle import Settling
from cable_shape.solve.starts import COLD_ITERATIONS

#: Guesses: share of the loads that pull the knots, kind and tilt of the spans' curves.
_GUESSES = ((1.0, HANGING, 0.0), (1.0, CURVED, 0.3), (0.1, CURVED, 0.1), (0.0, CURVED, 0.02), (10.0, HANGING, 0.0))
#: Steps in time that a guess may take to settle.
_SETTLED = 400


@final
class HarnessSearch(Search):
    """One solve of a harness; see `Search`."""

    __slots__ = ("task", "told")

    state: HarnessNetwork

    def __init__(
        self, task: HarnessProblem, state: HarnessNetwork, deadline: float, began: float, last: HarnessProblem
    ) -> None:
        self.task = task
        self.told = state.told_before  # the loads of the last solution, if they were others
        super().__init__(task, state, deadline, began, last)  # type: ignore[arg-type]

    def room(self) -> tuple[Array, Array]:
        """For the shapes of all segments, and for what they do to the knots."""
        state = self.state
        return np.empty(NUMBERS_PER_POINT * self.task.points * state.cables), np.empty((len(state.layout.knots), 7))

    def shape(self, status: Status, detail: str) -> HarnessShape:  # type: ignore[override]
        """What the last compiled solve found."""
        task, state, info = self.task, self.state, self.info
        told = np.array(info[INFO:])
        cables = state.cables
        found = HarnessShape(
            task.harness,
            self.buffer,
            task.points,
            model=MODEL,
            status=status,
            detail=detail,
            energy=info[I_ENERGY] + state.energy_of_masses(),
            energies=told[2 * cables :],
            twists=told[: 2 * cables : 2],
            error_estimate=info[I_ESTIMATE],
            force_error=info[I_FORCE],
            moment_error=info[I_MOMENT],
            residual=info[I_RESIDUAL],
            iterations=self.iterations,
            solve_time=perf_counter() - self.began,
            before=self.before,  # type: ignore[arg-type]
            clips=self.loads[state.clip_rows] if state.clip_rows else None,
            clips_of=task.clips,
        )
        return found

    def no_shape(self, status: Status, poses: Array, detail: str, missing: float = 0.0) -> HarnessShape:  # type: ignore[override]
        """Straight lines between the knots; what was solved before stays as a warm start."""
        task, state = self.task, self.state
        laid_straight(task, state, poses, self.buffer)
        told = detail if status is Status.OVERSTRETCHED else detail + status.remedy
        clips = np.zeros((len(state.clip_rows), 7))
        return HarnessShape(
            task.harness, self.buffer, task.points, model=MODEL, status=status, detail=told, iterations=self.iterations,
            solve_time=perf_counter() - self.began, missing_length=missing, clips=clips, clips_of=task.clips,
        )  # fmt: skip

    def hopeless(self, poses: Array) -> tuple[Status, Array, str, float] | None:
        """Why there is no equilibrium between `poses`; None if there may be one."""
        return out_of_reach(self.task, self.state, poses)

    def along(self, shape: Any) -> tuple[Array, Array]:
        """Arc lengths (k,) and positions (k, 3) of a shape, one segment after the other, a gap between them."""
        state = self.state
        s = [one.arc_length + gap for one, gap in zip(shape.segments.values(), state.gaps, strict=True)]
        return np.concatenate(s), np.concatenate([one.positions for one in shape.segments.values()])

    def _elsewhere(self, s: Array, coarse: Array) -> bool:
        if self.info[I_TURNED] <= _FAR_STEP:
            return False
        nodes, fine = self.state.node_positions()
        apart = np.stack([np.interp(nodes, s, x) for x in coarse.T], axis=1) - fine
        return float((apart * apart).sum(axis=1).max()) > (_SAME * self.task.harness.longest) ** 2

    def _find_again(self, coarse: object) -> bool:
        return False

    def _load(self, at: float) -> None:
        """Makes the loads those at this share of the way from the last ones, if they differ."""
        if self.told is not None:
            state = self.state
            state.take_over(state.held if at == 1.0 else (1.0 - at) * self.told + at * state.held)

    def _give_up(self, goal: Array) -> HarnessShape:  # type: ignore[override]
        """Out of time away from the goal: the shape for the supports that were reached, if any."""
        shape: Any = self._here()
        if shape is None:
            return self.no_shape(Status.BUDGET_EXCEEDED, goal, "")
        shape.status = Status.BUDGET_EXCEEDED
        shape.detail = f"the shape is that of grips on their way. {shape.status.remedy}"
        shape.error_estimate = math.inf
        return shape  # type: ignore[no-any-return]

    # -- from nothing

    def _cold(self, poses: Array, wound: float = 0.0) -> HarnessShape:  # type: ignore[override]
        """From guesses, the likeliest first; then from one that settles against drag."""
        state = self.state
        state.align(poses)
        for fineness, guesses in ((1.0, _GUESSES), (2.0, _GUESSES[:2])):
            for load, kind, sag in guesses:
                guess = self._guess(poses, load)
                state.first_mesh(guess, fineness)
                state.start_from(guess, kind, sag)
                if self.call(0, COLD_ITERATIONS):
                    return self._finish(Status.SNAPPED if self.snapped else Status.OK)  # type: ignore[return-value]
                if self.out_of_time():
                    return self._give_up(guess)
        for load, kind, sag in _GUESSES[:3]:
            guess = self._guess(poses, load)
            state.first_mesh(guess, 2.0)
            state.start_from(guess, kind, sag)
            if self._settled() and self.call(0, COLD_ITERATIONS):
                return self._finish(Status.SNAPPED if self.snapped else Status.OK)  # type: ignore[return-value]
            if self.out_of_time():
                return self._give_up(guess)
        for load, kind, sag in _GUESSES:
            guess = self._guess(poses, load)
            state.first_mesh(guess, 2.0)
            state.start_from(guess, kind, sag)
            if self.call(0, COLD_ITERATIONS, guard=False):
                return self._finish(Status.UNSTABLE)  # type: ignore[return-value]
        state.history = 0
        return self.no_shape(Status.NOT_CONVERGED, self._guess(poses, 1.0), "")

    def _guess(self, poses: Array, load: float) -> Array:
        """Poses of all knots, of which some are given."""
        return laid(self.state, poses, load)

    def _settled(self) -> bool:
        """Lets the guess in the trial come to rest against drag."""
        state = self.state
        settling = Settling(state.ints, state.floats, state.sols, tables.TRIAL)

        def each() -> None:
            if self.out_of_time():
                raise TimeoutError

        try:
            found = settling.settle(_SETTLED, 1e-4, each)
        except TimeoutError:
            return False
        settling.hand_over(state.sols)
        drive.strip(state.ints, state.floats, state.sols)
        return found or settling._moved


def solve(
    task: HarnessProblem, state: HarnessNetwork | None = None, *, deadline: float = math.inf
) -> tuple[HarnessShape, HarnessNetwork]:
    """The shape of the problem's harness between its ends, and the memory for the next one.

    As `cosserat.solve`, of which this is the case of many segments.
    """
    began = perf_counter()
    if state is None:
        state = HarnessNetwork(task)
    last = state.problem
    state.told_before = None
    if last is not task:
        state.keep_loads()
        state.take(task)
    poses = state.aim(trial=state.history > 0)
    search = HarnessSearch(task, state, deadline, began, last)
    followed = state.history > 0 and search.call(state.history, WARM_ITERATIONS, far=FAR)
    if followed and search.final:
        state.settle()
        return search.shape(Status.OK, ""), state
    return search.run(poses, followed), state  # type: ignore[return-value]


