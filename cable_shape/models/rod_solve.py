"""Where one warm solve of the rod is not all: small steps along the ends' path, then guesses; graded in the end."""

from __future__ import annotations

import math
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import rod_drive
from cable_shape.kernels.rod_drive import ESTIMATE, EXCESS, TURNED
from cable_shape.models.rod_call import COLD_ITERATIONS, FAR, MESHES, STEP_ITERATIONS, WARM_ITERATIONS, RodCall
from cable_shape.models.rod_cold import find_again, guesses, soften
from cable_shape.pose import Grip, multiply
from cable_shape.shape import CableShape, Status

#: As `FAR`, for one small step, and a finer mesh that turns a frame as far has left its branch. With more, steps get
#: across a fold to the shape that the cable snaps to.
_FAR_STEP = 0.3
#: Fractions of the path. Near a cusp the shape moves a thousand times as much as its ends and yet continuously.
_FIRST_STEP, _SMALLEST_STEP = 0.25, 1.0 / 4096.0
_QUARTER_TURN = 0.25


@final
class Solve:
    """What a call of :func:`cosserat.solve` does where a warm solve alone is not enough."""

    __slots__ = ("rod", "softened", "state")

    def __init__(self, rod: RodCall) -> None:
        self.rod = rod
        self.state = rod.state
        self.softened = False  # whether a stiffer cable has been asked

    def run(self, ends: Array) -> CableShape:
        """The shape between `ends` (15,), from nothing, whatever comes."""
        problem, state = self.rod.problem, self.state
        if state.width > 1 and state.stretch == 0.0:
            chord, length = math.dist(ends[7:10].tolist(), ends[:3].tolist()), problem.cable.length
            if chord >= rod_drive.STRAIGHT * length:
                detail = f"the ends are {chord - length:.3g} m further apart than the cable is long ({length:g} m). "
                return self.rod.no_shape(Status.OVERSTRETCHED, ends, detail)
        return self._cold(ends)

    def _finish(self, status: Status) -> CableShape:
        """Refines the mesh until the error is within tolerance, and reports."""
        problem, state = self.rod.problem, self.state
        if state.too_coarse(self.rod.info):
            found = self._remesh(status)
            if found is None:
                return self._lost(state.target.copy())
            status = found
        elif state.history > 0 and status is Status.OK and state.too_fine(self.rod.info):
            self._coarsen()  # only now: a mesh that is too fine costs if it is used again
        info = self.rod.info
        if status is Status.OK or status is Status.UNSTABLE:
            status = Status.OK if info[EXCESS] == 0.0 else Status.UNSTABLE
        within = info[ESTIMATE] <= problem.tolerance
        state.settle()
        if status is Status.UNSTABLE:
            least = self.rod.least_eigenvalue()
            if least >= -state.par[18]:  # the inertia was that of the last but one iterate, and a mode is neutral
                status = Status.OK
        if self.rod.late:
            status = Status.BUDGET if within else Status.BUDGET_EXCEEDED
        elif not within:
            status = Status.NOT_CONVERGED
        if status is Status.OK:
            return self.rod.shape(status, "")
        detail = ""
        if not within:
            detail = f"error estimate {info[ESTIMATE]:.2g} m, tolerance {problem.tolerance:.2g} m. "
        elif status is Status.UNSTABLE:
            of_bending = least * problem.cable.length**2 / state.bend
            detail = f"smallest eigenvalue of the second variation {of_bending:.3g} EI/L^2. "
        return self.rod.shape(status, detail + status.remedy)

    def _remesh(self, status: Status) -> Status | None:
        """Solves on the mesh that the error asks for: the status then, None if the equilibrium was lost on the way."""
        state = self.state
        keep = state.history
        coarse = self.rod.shape(Status.OK, "")
        coarse.buffer = self.rod.buffer.copy()
        for _ in range(MESHES):
            if self.rod.out_of_time() or not state.next_mesh():
                break
            if not self.rod.solve(0, COLD_ITERATIONS, guard=status is not Status.UNSTABLE) and not find_again(
                self.rod, coarse.positions
            ):
                return None
            if keep > 0 and status is Status.OK and self.rod.info[TURNED] > _FAR_STEP:
                status = Status.SNAPPED  # at a fold, which a coarse mesh puts a little further on
                self.rod.before = coarse
            if not state.too_coarse(self.rod.info):
                break
        state.history = min(keep, 1)
        return status

    def _coarsen(self) -> None:
        """Solves on a coarser mesh, and stays with the one at hand if that does not lead to the same shape."""
        state, buffer, info = self.state, self.rod.buffer, self.rod.info
        kept = state.mesh, state.sol, state.elements, state.target, state.work
        state.next_mesh()
        self.rod.buffer = CableShape.new_buffer(self.rod.problem.points)
        if self.rod.solve(0, WARM_ITERATIONS, far=_FAR_STEP) and not state.too_coarse(self.rod.info):
            state.history = 1
            return
        state.mesh, state.sol, state.elements, state.target, state.work = kept
        state.info[:] = info
        state.fewest = state.elements
        self.rod.buffer, self.rod.info = buffer, info

    def _lost(self, ends: Array) -> CableShape:
        """A finer mesh did not confirm the equilibrium."""
        if self._softened(ends):
            return self._finish(Status.OK if self.rod.before is None else Status.SNAPPED)
        self.state.history = 0
        return self.rod.no_shape(Status.NOT_CONVERGED, ends, "the equilibrium was lost on a finer mesh. ")

    def _here(self) -> CableShape | None:
        """The last solution, wherever its ends are; None if there is none."""
        state, buffer, info = self.state, self.rod.buffer, self.rod.info
        if state.history == 0:
            return None
        self.rod.buffer = CableShape.new_buffer(self.rod.problem.points)
        state.target[:] = state.ends
        shape = self.rod.shape(Status.OK, "") if self.rod.solve(1, STEP_ITERATIONS, guard=False) else None
        self.rod.buffer, self.rod.info = buffer, info
        state.history = 1
        return shape

    def _give_up(self, goal: Array) -> CableShape:
        """Out of time away from the goal: the shape for the ends that were reached, if any."""
        reached = self.state.ends.copy() if self.state.history else goal
        shape = self._here()
        if shape is None:
            return self.rod.no_shape(Status.BUDGET_EXCEEDED, goal, "")
        gap = math.dist(reached[7:10] - reached[:3], goal[7:10] - goal[:3])
        shape.status = Status.BUDGET_EXCEEDED
        shape.detail = f"the shape is that of ends {gap:.2g} m nearer to where they were. {shape.status.remedy}"
        shape.error_estimate = math.inf
        return shape

    # -- from the last solution in small steps

    def _walk(self, ends: Array) -> CableShape:
        """Follows the branch along the straight path of the ends; where it ends, the cable snaps."""
        state = self.state
        origin = state.ends.copy()
        goal = ends.copy()
        rod_drive.wind(origin, goal)
        done, step = 0.0, _FIRST_STEP
        state.history = min(state.history, 1)
        while done < 1.0:
            if self.rod.out_of_time():
                return self._give_up(goal)
            least = step < _SMALLEST_STEP  # where the cable buckles the branch goes on, but is hard to find
            at = min(1.0, done + (_SMALLEST_STEP if least else step))
            state.target[:] = between(origin, goal, at)
            most = COLD_ITERATIONS if least else STEP_ITERATIONS
            if self.rod.solve(state.history, most, far=_FAR_STEP, output=at == 1.0):
                state.history = 2
                done = at
                step = 1.6 * max(step, _SMALLEST_STEP)
                if state.far_too_coarse(self.rod.info) and state.next_mesh():
                    if not self.rod.solve(0, COLD_ITERATIONS, far=_FAR_STEP, output=at == 1.0):
                        return self._snap(goal)  # at a fold, which a coarse mesh puts a little further on
                    state.history = 1
            elif least:
                return self._snap(goal)
            else:
                step *= 0.4
                state.history = 1
        return self._finish(Status.OK)

    def _snap(self, goal: Array) -> CableShape:
        """The branch ended: the stable shape that the cable falls to from the last one, or else any."""
        state = self.state
        self.rod.before = self._here()
        state.target[:] = goal
        state.unsettle()
        if self.rod.solve(1, COLD_ITERATIONS):
            return self._finish(Status.SNAPPED)
        state.history = 0
        shape = self._cold(goal)
        if shape.status is Status.OK:
            shape.status = Status.SNAPPED
            shape.detail = Status.SNAPPED.remedy
        return shape

    # -- from a guess

    def _cold(self, ends: Array) -> CableShape:
        """From guesses, the likeliest first; windings are reached by turning the end."""
        problem, state = self.rod.problem, self.state
        end = problem.end
        turns = end.cable_frame.turns if isinstance(end, Grip) and ends[14] == 0.0 else 0
        wound = ends[14] != 0.0  # the signs are already those of a winding
        if not wound and _relative_scalar(ends) < 0.0:
            ends[10:14] *= -1.0
        force, layer = state.hanging(ends)
        tries = guesses(self.rod, ends)
        for fineness in (1.0, 2.0):  # a coarse mesh may miss a boundary layer and find nothing
            for kind, sag in tries:
                state.first_mesh(layer, fineness)
                state.start_from(ends, force, kind, sag)
                if self.rod.solve(0, COLD_ITERATIONS):
                    return self._wind_up(turns) if turns else self._finish(Status.OK)
                if self.rod.out_of_time():
                    return self._give_up(ends)
        if self._softened(ends):
            return self._wind_up(turns) if turns else self._finish(Status.OK)
        if self.rod.out_of_time():
            return self._give_up(ends)
        for kind, sag in tries:
            state.first_mesh(layer, 2.0)
            state.start_from(ends, force, kind, sag)
            if self.rod.solve(0, COLD_ITERATIONS, guard=False):
                return self._finish(Status.UNSTABLE)
        state.history = 0
        return self.rod.no_shape(Status.NOT_CONVERGED, ends, "")

    def _softened(self, ends: Array) -> bool:
        """Whether a stiffer cable, asked once, leads to a shape."""
        if self.softened:
            return False
        self.softened = True
        return soften(self.rod, ends)

    def _wind_up(self, turns: int) -> CableShape:
        """From the winding 0, which has just been solved, to `turns` by turning the end about its d3."""
        state = self.state
        state.history = 1
        origin = state.ends.copy()
        count = round(abs(turns) / _QUARTER_TURN)
        for i in range(1, count + 1):
            angle = 2.0 * math.pi * turns * i / count
            roll = np.array((0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)))
            ends = origin.copy()
            ends[10:14] = multiply(origin[10:14], roll)
            if self.rod.out_of_time():
                return self._give_up(ends)
            state.target[:] = ends
            if self.rod.solve(state.history, WARM_ITERATIONS, far=FAR):
                state.history = 2
                if state.far_too_coarse(self.rod.info) and state.next_mesh():
                    if not self.rod.solve(0, COLD_ITERATIONS):
                        return self._lost(ends)
                    state.history = 1
                continue
            shape = self._walk(ends)
            if not shape.status:
                return shape
        return self._finish(Status.OK)


def between(origin: Array, goal: Array, at: float) -> Array:
    """Ends on the straight path from `origin` to `goal`: positions linear, frames along the shortest turn."""
    ends = (1.0 - at) * origin + at * goal
    for o in (3, 10):
        p, q = origin[o : o + 4], goal[o : o + 4]
        angle = math.acos(min(1.0, max(-1.0, float(p @ q))))
        if angle > 1e-6:
            ends[o : o + 4] = (math.sin((1.0 - at) * angle) * p + math.sin(at * angle) * q) / math.sin(angle)
        ends[o : o + 4] /= np.linalg.norm(ends[o : o + 4])
    return ends


def _relative_scalar(ends: Array) -> float:
    """Scalar part of conj(start) end."""
    return float(ends[3:7] @ ends[10:14])
