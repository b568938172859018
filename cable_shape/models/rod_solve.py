"""One solve of the rod: warm, then in small steps along the ends' path, then from a guess; graded in the end."""

from __future__ import annotations

import math
from collections.abc import Callable
from time import perf_counter
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import planar_drive, rod_drive, rod_stability
from cable_shape.kernels.rod_drive import ENERGY, ESTIMATE, EXCESS, ITERATIONS, RESIDUAL, TURNED, TURNS, TWIST
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.models.rod_common import MODEL, straight_line
from cable_shape.models.rod_state import RodState
from cable_shape.pose import Grip, multiply
from cable_shape.problem import NAMED_TOLERANCE, Problem
from cable_shape.shape import CableShape, Status

_COLD_ITERATIONS, _WARM_ITERATIONS, _STEP_ITERATIONS = 80, 25, 12
#: A warm solve that turns a frame by more than this [rad] from its prediction is checked by small steps.
_FAR = 0.7
#: The same for one small step, and a finer mesh that turns a frame as far has left its branch. With more, steps get
#: across a fold to the shape that the cable snaps to.
_FAR_STEP = 0.3
#: Fractions of the path. Near a cusp the shape moves a thousand times as much as its ends and yet continuously.
_FIRST_STEP, _SMALLEST_STEP = 0.25, 1.0 / 4096.0
#: (kind, tilt of the handles) of the guesses of `rod_drive.guess`.
_HANGING, _NATURAL = (0, 0.0), (2, 0.0)
_FLAT, _CURVED, _MORE_CURVED, _STEEP = (1, 0.02), (1, 0.3), (1, 0.8), (1, 1.2)
_QUARTER_TURN = 0.25
#: Shapes nearer to each other than this fraction of the length are one.
_SAME = 0.02
#: So many times as stiff are cables from which next to limp ones are softened, and by this factor in one step.
_STIFFER, _SOFTENING = (8.0, 64.0, 512.0, 4096.0), 2.0
#: So many meshes are tried for one shape.
_MESHES = 12


@final
class Solve:
    """One call of :func:`solve`: warm, then in small steps along the ends' path, then from a guess."""

    __slots__ = ("before", "began", "buffer", "deadline", "info", "iterations", "late", "problem", "softened", "state")

    def __init__(self, problem: Problem, state: RodState, deadline: float, began: float) -> None:
        self.problem = problem
        self.state = state
        self.deadline = deadline
        self.began = began
        self.iterations = 0
        self.late = False
        self.softened = False  # whether a stiffer cable has been asked
        self.before: CableShape | None = None  # the last shape of a branch that ended
        self.buffer = CableShape.new_buffer(problem.points)
        self.info: list[float] = []  # of the last compiled solve

    def run(self) -> CableShape:
        """The shape, whatever comes."""
        problem, state = self.problem, self.state
        ends = state.aim(problem.start, problem.end, trial=state.history > 0)
        if state.history > 0:
            if self._call(state.history, _WARM_ITERATIONS, far=_FAR):
                return self._finish(Status.OK)
            ends = ends.copy()
        if state.width > 1 and state.stretch == 0.0:
            chord, length = math.dist(ends[7:10].tolist(), ends[:3].tolist()), problem.cable.length
            if chord >= rod_drive.STRAIGHT * length:
                detail = f"the ends are {chord - length:.3g} m further apart than the cable is long ({length:g} m). "
                return self._no_shape(Status.OVERSTRETCHED, ends, detail)
        return self._walk(ends) if state.history > 0 else self._cold(ends)

    def beside(self, frames: Callable[[Array], Array], force: Array) -> CableShape:
        """Plain Newton steps from these frames."""
        state = self.state
        ends = state.aim(self.problem.start, self.problem.end)
        _, layer = state.hanging(ends)
        q = frames(np.linspace(0.0, self.problem.cable.length, 200))
        turn = 2.0 * np.arccos(np.minimum(1.0, np.abs((q[1:] * q[:-1]).sum(axis=1)))).sum()
        state.first_mesh(layer, 2.0, turn)
        state.start_with(ends, frames, force)
        if self._call(0, _COLD_ITERATIONS, guard=False):
            return self._finish(Status.UNSTABLE)
        return self._no_shape(Status.NOT_CONVERGED, ends, "")

    def _call(self, history: int, most: int, guard: bool = True, output: bool = True, far: float = 7.0) -> bool:
        """One compiled solve; True if it found an equilibrium, a stable one if guarded."""
        state = self.state
        points = self.problem.points if output else 0
        code = planar_drive.solve(
            state.par, state.mesh, state.sol, state.work, self.buffer, state.info, state.elements, state.width, points,
            history, guard, most, far, state.plane,
        )  # fmt: skip
        self.info = state.info.tolist()
        self.iterations += int(self.info[ITERATIONS])
        return bool(code == CONVERGED)

    def _finish(self, status: Status) -> CableShape:
        """Refines the mesh until the error is within tolerance, and reports."""
        problem, state = self.problem, self.state
        if state.too_coarse(self.info):
            found = self._remesh(status)
            if found is None:
                return self._lost(state.target.copy())
            status = found
        elif state.history > 0 and status is Status.OK and state.too_fine(self.info):
            self._coarsen()  # only now: a mesh that is too fine costs if it is used again
        info = self.info
        if status is Status.OK or status is Status.UNSTABLE:
            status = Status.OK if info[EXCESS] == 0.0 else Status.UNSTABLE
        within = info[ESTIMATE] <= problem.tolerance
        state.settle()
        if status is Status.UNSTABLE:
            least = self._least_eigenvalue()
            if least >= -state.par[18]:  # the inertia was that of the last but one iterate, and a mode is neutral
                status = Status.OK
        if self.late:
            status = Status.BUDGET if within else Status.BUDGET_EXCEEDED
        elif not within:
            status = Status.NOT_CONVERGED
        if status is Status.OK:
            return self._shape(status, "")
        detail = ""
        if not within:
            detail = f"error estimate {info[ESTIMATE]:.2g} m, tolerance {problem.tolerance:.2g} m. "
        elif status is Status.UNSTABLE:
            of_bending = least * problem.cable.length**2 / state.bend
            detail = f"smallest eigenvalue of the second variation {of_bending:.3g} EI/L^2. "
        return self._shape(status, detail + status.remedy)

    def _least_eigenvalue(self) -> float:
        """[N m / m^2], of the second variation at the last solution."""
        state = self.state
        least = rod_stability.smallest_eigenvalue(
            state.par, state.mesh, state.sol, state.work, state.elements, state.width
        )
        rod_stability.refresh(state.par, state.mesh, state.sol, state.work, state.elements, state.width, True)
        return float(least)

    def _shape(self, status: Status, detail: str) -> CableShape:
        """What the last compiled solve found."""
        problem, info = self.problem, self.info
        return CableShape(
            self.buffer,
            problem.points,
            length=problem.cable.length,
            model=MODEL,
            status=status,
            detail=detail,
            energy=info[ENERGY] + self.state.energy_of_masses(),
            error_estimate=info[ESTIMATE],
            residual=info[RESIDUAL],
            iterations=self.iterations,
            turns=int(info[TURNS]),
            twist=info[TWIST],
            solve_time=perf_counter() - self.began,
            before=self.before,
        )

    def _remesh(self, status: Status) -> Status | None:
        """Solves on the mesh that the error asks for: the status then, None if the equilibrium was lost on the way."""
        state = self.state
        keep = state.history
        coarse = self._shape(Status.OK, "")
        coarse.buffer = self.buffer.copy()
        for _ in range(_MESHES):
            if self._out_of_time() or not state.next_mesh():
                break
            if not self._call(0, _COLD_ITERATIONS, guard=status is not Status.UNSTABLE) and not self._again(
                coarse.positions
            ):
                return None
            if keep > 0 and status is Status.OK and self.info[TURNED] > _FAR_STEP:
                status = Status.SNAPPED  # at a fold, which a coarse mesh puts a little further on
                self.before = coarse
            if not state.too_coarse(self.info):
                break
        state.history = min(keep, 1)
        return status

    def _again(self, coarse: Array) -> bool:
        """From the guesses to the shape whose positions (n, 3) a coarse mesh gave, on a mesh of its own."""
        state, points = self.state, self.problem.points
        ends = state.target.copy()
        force, layer = state.hanging(ends)
        for kind, sag in self._guesses(ends):
            state.first_mesh(layer, 2.0)
            state.start_from(ends, force, kind, sag)
            if self._call(0, _COLD_ITERATIONS):
                apart = self.buffer[points : 4 * points].reshape(points, 3) - coarse
                if float((apart * apart).sum(axis=1).max()) < (_SAME * self.problem.cable.length) ** 2:
                    return True
        return False

    def _coarsen(self) -> None:
        """Solves on a coarser mesh, and stays with the one at hand if that does not lead to the same shape."""
        state, buffer, info = self.state, self.buffer, self.info
        kept = state.mesh, state.sol, state.elements, state.target, state.work
        state.next_mesh()
        self.buffer = CableShape.new_buffer(self.problem.points)
        if self._call(0, _WARM_ITERATIONS, far=_FAR_STEP) and not state.too_coarse(self.info):
            state.history = 1
            return
        state.mesh, state.sol, state.elements, state.target, state.work = kept
        state.info[:] = info
        state.fewest = state.elements
        self.buffer, self.info = buffer, info

    def _no_shape(self, status: Status, ends: Array, detail: str) -> CableShape:
        """The straight line between the ends; what was solved before stays as a warm start."""
        far = ends[7:14] if self.state.width > 1 else ends[:7]
        told = detail + status.remedy
        return straight_line(self.problem, self.buffer, ends[:7], far, status, told, self.iterations, self.began)

    def _lost(self, ends: Array) -> CableShape:
        """A finer mesh did not confirm the equilibrium."""
        if self._soften(ends):
            return self._finish(Status.OK if self.before is None else Status.SNAPPED)
        self.state.history = 0
        return self._no_shape(Status.NOT_CONVERGED, ends, "the equilibrium was lost on a finer mesh. ")

    def _here(self) -> CableShape | None:
        """The last solution, wherever its ends are; None if there is none."""
        state, buffer, info = self.state, self.buffer, self.info
        if state.history == 0:
            return None
        self.buffer = CableShape.new_buffer(self.problem.points)
        state.target[:] = state.ends
        shape = self._shape(Status.OK, "") if self._call(1, _STEP_ITERATIONS, guard=False) else None
        self.buffer, self.info = buffer, info
        state.history = 1
        return shape

    def _out_of_time(self) -> bool:
        self.late = self.late or perf_counter() > self.deadline
        return self.late

    def _give_up(self, goal: Array) -> CableShape:
        """Out of time away from the goal: the shape for the ends that were reached, if any."""
        reached = self.state.ends.copy() if self.state.history else goal
        shape = self._here()
        if shape is None:
            return self._no_shape(Status.BUDGET_EXCEEDED, goal, "")
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
            if self._out_of_time():
                return self._give_up(goal)
            at = min(1.0, done + step)
            state.target[:] = between(origin, goal, at)
            if self._call(state.history, _STEP_ITERATIONS, far=_FAR_STEP, output=at == 1.0):
                state.history = 2
                done = at
                step *= 1.6
                if state.far_too_coarse(self.info) and state.next_mesh():
                    if not self._call(0, _COLD_ITERATIONS, far=_FAR_STEP, output=at == 1.0):
                        return self._snap(goal)  # at a fold, which a coarse mesh puts a little further on
                    state.history = 1
            else:
                step *= 0.4
                state.history = 1
                if step < _SMALLEST_STEP:
                    return self._snap(goal)
        return self._finish(Status.OK)

    def _snap(self, goal: Array) -> CableShape:
        """The branch ended: the stable shape that the cable falls to from the last one, or else any."""
        state = self.state
        self.before = self._here()
        state.target[:] = goal
        state.unsettle()
        if self._call(1, _COLD_ITERATIONS):
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
        problem, state = self.problem, self.state
        end = problem.end
        turns = end.cable_frame.turns if isinstance(end, Grip) and ends[14] == 0.0 else 0
        wound = ends[14] != 0.0  # the signs are already those of a winding
        if not wound and _relative_scalar(ends) < 0.0:
            ends[10:14] *= -1.0
        force, layer = state.hanging(ends)
        guesses = self._guesses(ends)
        for fineness in (1.0, 2.0):  # a coarse mesh may miss a boundary layer and find nothing
            for kind, sag in guesses:
                state.first_mesh(layer, fineness)
                state.start_from(ends, force, kind, sag)
                if self._call(0, _COLD_ITERATIONS):
                    return self._wind_up(turns) if turns else self._finish(Status.OK)
                if self._out_of_time():
                    return self._give_up(ends)
        if self._soften(ends):
            return self._wind_up(turns) if turns else self._finish(Status.OK)
        if self._out_of_time():
            return self._give_up(ends)
        for kind, sag in guesses:
            state.first_mesh(layer, 2.0)
            state.start_from(ends, force, kind, sag)
            if self._call(0, _COLD_ITERATIONS, guard=False):
                return self._finish(Status.UNSTABLE)
        state.history = 0
        return self._no_shape(Status.NOT_CONVERGED, ends, "")

    def _soften(self, ends: Array) -> bool:
        """From the shape of a stiffer cable: what is next to limp bends so sharply that no guess is near enough."""
        state = self.state
        if self.softened or state.width == 1:
            return False
        self.softened = True
        stiffness, tolerance = state.par[:3].copy(), state.tolerance
        state.tolerance = min(tolerance, NAMED_TOLERANCE * self.problem.cable.length)
        try:
            stiffer = next((f for f in _STIFFER if self._as_stiff(f * stiffness, ends)), 1.0)
            while stiffer > 1.0:
                stiffer = max(1.0, stiffer / _SOFTENING)
                state.par[:3] = stiffer * stiffness
                state.history = 1
                state.unsettle()
                if self._out_of_time() or not self._call(1, _COLD_ITERATIONS) or not self._refine():
                    return False
            return stiffer == 1.0 and state.history > 0
        finally:
            state.par[:3] = stiffness
            state.tolerance, state.history = tolerance, 0

    def _as_stiff(self, stiffness: Array, ends: Array) -> bool:
        """Whether a cable of this stiffness (3,) has a stable shape that a guess leads to."""
        state = self.state
        state.par[:3] = stiffness
        force, layer = state.hanging(ends)
        for kind, sag in (_HANGING, _CURVED):
            state.first_mesh(layer, 1.0)
            state.start_from(ends, force, kind, sag)
            if self._call(0, _COLD_ITERATIONS) and self._refine():
                return True
        return False

    def _refine(self) -> bool:
        """Meshes as fine as the error asks for, starting from the last solution; False where it is lost."""
        for _ in range(_MESHES):
            if not self.state.too_coarse(self.info) or not self.state.next_mesh():
                break
            if self._out_of_time() or not self._call(0, _COLD_ITERATIONS):
                return False
        return True

    def _guesses(self, ends: Array) -> tuple[tuple[int, float], ...]:
        """Which guesses, in which order: soft or taut cables hang, stiff ones curve."""
        state, length = self.state, self.problem.cable.length
        if state.width == 1:
            return (_NATURAL,)
        soft = state.bend < math.hypot(*state.mean_load.tolist()) * (0.3 * length) ** 3
        taut = math.dist(ends[7:10].tolist(), ends[:3].tolist()) > 0.97 * length
        if soft or taut:
            return (_HANGING, _CURVED, _MORE_CURVED, _FLAT, _STEEP)
        return (_CURVED, _HANGING, _MORE_CURVED, _FLAT, _STEEP)

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
            if self._out_of_time():
                return self._give_up(ends)
            state.target[:] = ends
            if self._call(state.history, _WARM_ITERATIONS, far=_FAR):
                state.history = 2
                if state.far_too_coarse(self.info) and state.next_mesh():
                    if not self._call(0, _COLD_ITERATIONS):
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
