"""The quasistatic Cosserat rod: geometrically exact, fourth order, warm-started (see docs/method.md).

    r' = R V,  R' = R hat(u),  n' + f = 0,  m' + r' x n = 0,
    V = e3 + diag(1/GA, 1/GA, 1/EA) R^T n,  R^T m = diag(EI1, EI2, GJ) (u - u0)

with the frame R (columns d1, d2, d3), the Darboux vector u and the rest curvature u0 in the cable frame, and the force
n and moment m that the far side exerts, in world axes. Unknown are the rotations of the nodes and the force at the
end; positions follow. After the geometrically exact rod of Simo, and the discrete rods on quaternions of Lang, Linn
and Arnold; the element is described in :mod:`cable_shape.kernels.rod_element`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import rod_drive, rod_stability
from cable_shape.kernels.frames import straight
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.models.rod_state import RodState
from cable_shape.pose import Grip, multiply
from cable_shape.problem import Problem
from cable_shape.shape import CableShape, Status

MODEL = "cosserat"

_COLD_ITERATIONS, _WARM_ITERATIONS, _STEP_ITERATIONS = 80, 25, 12
#: A warm solve that turns a frame by more than this [rad] from its prediction is checked by small steps.
_FAR = 0.7
_FIRST_STEP, _SMALLEST_STEP = 0.25, 1.0 / 256.0
#: Chord / length from which an inextensible cable counts as overstretched.
_STRAIGHT = 1.0 - 1e-9
#: (kind, tilt of the handles) of the guesses of `rod_drive.guess`.
_HANGING, _CURVED, _MORE_CURVED, _FLAT, _NATURAL = (0, 0.0), (1, 0.3), (1, 0.8), (1, 0.02), (2, 0.0)
_QUARTER_TURN = 0.25


def solve(problem: Problem, state: RodState | None = None, *, deadline: float = math.inf) -> CableShape:
    """The rod between the problem's ends.

    Parameters
    ----------
    problem : Problem
        Its ends may have moved since the last call; it may also be another problem.
    state : RodState, optional
        Kept from the last call: warm start. It takes the new solution. None: cold.
    deadline : float
        [s], of ``time.perf_counter``: checked between attempts; after it the best shape is returned, graded BUDGET
        within tolerance and BUDGET_EXCEEDED otherwise.

    Raises
    ------
    ArgumentError
        If the bending stiffness is 0, or the scene has clips. Never for a physical reason: see `status`.
    """
    began = perf_counter()
    if problem.scene is not None and problem.scene.clips:
        raise ArgumentError.of(
            "scene.clips", len(problem.scene.clips), "no model of this version holds a cable in clips", "Remove them."
        )
    if state is None:
        state = RodState(problem)
    elif state.problem is not problem:
        state.take(problem)
    return _Solve(problem, state, deadline, began).run()


def solve_beside(
    problem: Problem, state: RodState, frames: Callable[[Array], Array], force: ArrayLike = (0.0, 0.0, 0.0)
) -> CableShape:
    """The equilibrium next to given frames, stable (OK) or not (UNSTABLE): no branch is sought.

    Parameters
    ----------
    frames : callable
        Arc lengths (k,) [m] to quaternions (k, 4), x y z w, whose signs follow one another along the cable.
    force : (3,) array_like
        [N], world: about the force at the end.
    """
    if state.problem is not problem:
        state.take(problem)
    return _Solve(problem, state, math.inf, perf_counter()).beside(frames, np.asarray(force, dtype=np.float64))


def sensitivity(state: RodState, *, at: str = "cable") -> Array:
    """(n, 3, 12): change of the last solution's positions at fixed arc length with the poses of the two ends.

    Columns: velocity (3) [m/s] and angular velocity (3) [rad/s] of the start, then of the end, world axes; rotation is
    about that cable end, or with ``at="gripper"`` about the gripper's own origin. Columns of a free end, and of
    rotations that a grip leaves free, are zero.
    """
    if state.history == 0:
        raise ArgumentError("sensitivity() is not allowed yet: there is no solution. Call predict first.")
    problem = state.problem
    out = np.empty((problem.points, 3, 12))
    rod_stability.sensitivity(
        state.par, state.mesh, state.sol, state.work, state.elements, state.width, problem.points, out
    )
    if at == "gripper":
        for column, end in ((0, problem.start), (6, problem.end)):
            if isinstance(end, Grip):
                # v_cable = v_gripper + w x arm
                x, y, z = end.cable_frame.position - end.pose.position
                arm = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))
                out[:, :, column + 3 : column + 6] += out[:, :, column : column + 3] @ arm
    elif at != "cable":
        raise ArgumentError.of("at", at, "it must be 'cable' or 'gripper'", "Choose one of these.")
    return out


def smallest_eigenvalue(state: RodState) -> float:
    """[N], of the last solution's second variation under its constraints, against the integral of |rotation|^2."""
    return float(
        rod_stability.smallest_eigenvalue(state.par, state.mesh, state.sol, state.work, state.elements, state.width)
    )


class _Solve:
    """One call of :func:`solve`: warm, then in small steps along the ends' path, then from a guess."""

    __slots__ = ("began", "buffer", "deadline", "iterations", "late", "problem", "state")

    def __init__(self, problem: Problem, state: RodState, deadline: float, began: float) -> None:
        self.problem = problem
        self.state = state
        self.deadline = deadline
        self.began = began
        self.iterations = 0
        self.late = False
        self.buffer = CableShape.new_buffer(problem.points)

    def run(self) -> CableShape:
        """The shape, whatever comes."""
        problem, state = self.problem, self.state
        ends = state.aim(problem.start, problem.end)
        if state.width > 1 and state.par[5] == 0.0:
            x, y, z = ends[7] - ends[0], ends[8] - ends[1], ends[9] - ends[2]
            chord, length = math.sqrt(x * x + y * y + z * z), problem.cable.length
            if chord >= _STRAIGHT * length:
                detail = f"the ends are {chord - length:.3g} m further apart than the cable is long ({length:g} m). "
                return self._no_shape(Status.OVERSTRETCHED, ends, detail)
        if state.history == 0:
            return self._cold(ends)
        state.target[:] = ends
        if self._call(state.history, _WARM_ITERATIONS, far=_FAR):
            return self._finish(Status.OK)
        return self._walk(ends)

    def beside(self, frames: Callable[[Array], Array], force: Array) -> CableShape:
        """Plain Newton steps from these frames."""
        state = self.state
        ends = state.aim(self.problem.start, self.problem.end)
        _, _, layer = state.hanging(ends)
        q = frames(np.linspace(0.0, self.problem.cable.length, 200))
        turn = 2.0 * np.arccos(np.minimum(1.0, np.abs((q[1:] * q[:-1]).sum(axis=1)))).sum()
        state.first_mesh(layer, turn)
        state.start_with(ends, frames, force)
        if self._call(0, _COLD_ITERATIONS, guard=False):
            return self._finish(Status.UNSTABLE)
        return self._no_shape(Status.NOT_CONVERGED, ends, "")

    def _call(self, history: int, most: int, guard: bool = True, output: bool = True, far: float = 7.0) -> bool:
        """One compiled solve; True if it found an equilibrium, a stable one if guarded."""
        state = self.state
        points = self.problem.points if output else 0
        code = rod_drive.solve(
            state.par, state.mesh, state.sol, state.work, self.buffer, state.info, state.elements, state.width, points,
            history, guard, most, far,
        )  # fmt: skip
        self.iterations += int(state.info[0])
        return bool(code == CONVERGED)

    def _out_of_time(self) -> bool:
        self.late = self.late or perf_counter() > self.deadline
        return self.late

    def _finish(self, status: Status) -> CableShape:
        """Refines the mesh until the error is within tolerance, and reports."""
        problem, state, info = self.problem, self.state, self.state.info
        if state.too_coarse() or state.too_fine():
            keep = state.history
            for _ in range(8):
                if self._out_of_time() or not state.next_mesh():
                    break
                if not self._call(0, _COLD_ITERATIONS, guard=status is not Status.UNSTABLE):
                    return self._lost(state.target.copy())
                if not state.too_coarse():
                    break
            state.history = min(keep, 1)
        if status in (Status.OK, Status.UNSTABLE):
            status = Status.OK if info[2] == 0.0 else Status.UNSTABLE
        if type(problem.end) is Grip:  # met to the closure's rounding, and exactly where the grip is
            n = problem.points
            self.buffer[4 * n - 3 : 4 * n] = problem.end.cable_frame.position
        within = bool(info[7] <= problem.tolerance)
        state.history = min(2, state.history + 1)
        detail = ""
        if self.late:
            status = Status.BUDGET if within else Status.BUDGET_EXCEEDED
            detail = status.remedy
        elif not within:
            detail = f"error estimate {info[7]:.2g} m, tolerance {problem.tolerance:.2g} m. "
            status = Status.NOT_CONVERGED
            detail += status.remedy
        elif status is Status.UNSTABLE:
            least = smallest_eigenvalue(state) * problem.cable.length**2 / state.bend
            detail = f"smallest eigenvalue of the second variation {least:.3g} EI/L^2. {status.remedy}"
        elif status is not Status.OK:
            detail = status.remedy
        return CableShape(
            self.buffer,
            problem.points,
            length=problem.cable.length,
            model=MODEL,
            status=status,
            detail=detail,
            energy=float(info[8]) + state.energy_of_masses(),
            error_estimate=float(info[7]),
            residual=float(info[5]),
            iterations=self.iterations,
            turns=int(state.ends[14]),
            twist=float(info[9]),
            solve_time=perf_counter() - self.began,
        )

    def _no_shape(self, status: Status, ends: Array, detail: str) -> CableShape:
        """The straight line between the ends; what was solved before stays as a warm start."""
        problem = self.problem
        far = ends[7:14] if self.state.width > 1 else ends[:7]
        roll = straight(ends[:7], far, problem.cable.length, problem.points, self.buffer)
        return CableShape(
            self.buffer,
            problem.points,
            length=problem.cable.length,
            model=MODEL,
            status=status,
            detail=detail + status.remedy,
            error_estimate=math.inf,
            residual=math.inf,
            iterations=self.iterations,
            solve_time=perf_counter() - self.began,
            roll_error=float(roll),
        )

    def _lost(self, ends: Array) -> CableShape:
        """A finer mesh did not confirm the equilibrium."""
        self.state.history = 0
        return self._no_shape(Status.NOT_CONVERGED, ends, "the equilibrium was lost on a finer mesh. ")

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
            state.target[:] = _between(origin, goal, at)
            if self._call(state.history, _STEP_ITERATIONS, far=_FAR, output=at == 1.0):
                state.history = 2
                done = at
                step *= 1.6
                if state.far_too_coarse() and state.next_mesh():
                    if not self._call(0, _COLD_ITERATIONS, output=at == 1.0):
                        return self._lost(goal)
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
        state.target[:] = goal
        if self._call(1, _COLD_ITERATIONS):
            return self._finish(Status.SNAPPED)
        state.history = 0
        shape = self._cold(goal)
        if shape.status is Status.OK:
            shape.status = Status.SNAPPED
            shape.detail = Status.SNAPPED.remedy
        return shape

    def _give_up(self, goal: Array) -> CableShape:
        """Out of time away from the goal."""
        return self._no_shape(Status.BUDGET_EXCEEDED, goal, "")

    # -- from a guess

    def _cold(self, ends: Array) -> CableShape:
        """From guesses, the likeliest first; windings are reached by turning the end."""
        problem, state = self.problem, self.state
        end = problem.end
        turns = end.cable_frame.turns if isinstance(end, Grip) and ends[14] == 0.0 else 0
        wound = ends[14] != 0.0  # the signs are already those of a winding
        if not wound and _relative_scalar(ends) < 0.0:
            ends[10:14] *= -1.0
        load, force, layer = state.hanging(ends)
        for kind, sag in self._guesses(ends, load):
            state.first_mesh(layer)
            state.start_from(ends, load, force, kind, sag)
            if self._call(0, _COLD_ITERATIONS):
                return self._wind_up(turns) if turns else self._finish(Status.OK)
            if self._out_of_time():
                return self._give_up(ends)
        for kind, sag in self._guesses(ends, load):
            state.first_mesh(layer)
            state.start_from(ends, load, force, kind, sag)
            if self._call(0, _COLD_ITERATIONS, guard=False):
                return self._finish(Status.UNSTABLE)
        state.history = 0
        return self._no_shape(Status.NOT_CONVERGED, ends, "")

    def _guesses(self, ends: Array, load: Array) -> tuple[tuple[int, float], ...]:
        """Which guesses, in which order: soft or taut cables hang, stiff ones curve."""
        state, length = self.state, self.problem.cable.length
        if state.width == 1:
            return (_NATURAL,)
        weight = float(np.linalg.norm(load))
        soft = state.bend < weight * (0.3 * length) ** 3
        taut = float(np.linalg.norm(ends[7:10] - ends[:3])) > 0.97 * length
        if soft or taut:
            return (_HANGING, _CURVED, _MORE_CURVED, _FLAT)
        return (_CURVED, _HANGING, _MORE_CURVED, _FLAT)

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
                if state.far_too_coarse() and state.next_mesh():
                    if not self._call(0, _COLD_ITERATIONS):
                        return self._lost(ends)
                    state.history = 1
                continue
            shape = self._walk(ends)
            if not shape.status:
                return shape
        return self._finish(Status.OK)


def _between(origin: Array, goal: Array, at: float) -> Array:
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
