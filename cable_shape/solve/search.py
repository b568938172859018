"""How an equilibrium is looked for: from the last one, along a path, from guesses; and how it is graded."""

from __future__ import annotations

import math
from time import perf_counter

import numpy as np

from cable_shape.cable.pieces import energy_of_sections
from cable_shape.checks import Array
from cable_shape.kernels.direct import Direct
from cable_shape.kernels.network import drive, start
from cable_shape.kernels.network.drive import I_ENERGY, I_ESTIMATE, I_FORCE, I_MOMENT, I_RESIDUAL, I_TURNED, INFO
from cable_shape.kernels.network.newton import CONVERGED, I_EXCESS, I_ITERATIONS
from cable_shape.pose import Grip, multiply
from cable_shape.shape import CableShape, Status
from cable_shape.solve.eyelets import Eyelets
from cable_shape.solve.network import Network
from cable_shape.solve.outcome import MODEL, no_room, straight_lines, unheld_roll
from cable_shape.solve.problem import Problem
from cable_shape.solve.starts import COLD_ITERATIONS, approached, guessed, softened

WARM_ITERATIONS, STEP_ITERATIONS = 25, 12
#: A warm solve that turns a frame by more than this [rad] from its prediction is checked by small steps.
FAR = 0.7
#: The same for one small step, and for a finer mesh. With more, steps get across a fold to what is snapped to.
_FAR_STEP = 0.3
#: So many meshes are tried for one shape.
_MESHES = 12
#: Fractions of the path. Near a cusp the shape moves a thousand times as much as its ends and yet continuously.
_FIRST_STEP, _SMALLEST_STEP, _SMALLEST_IN_CLIPS = 0.25, 1.0 / 4096.0, 1.0 / 256.0
#: Times as fine as usual are meshes in clips that are tried next: a coarse one may miss a boundary layer.
_FINER: tuple[float, ...] = (2.0, 5.0)
_QUARTER_TURN = 0.25
#: Windings beyond so many turns are refused: on the way there the cable goes through itself.
MOST_TURNS = 3
#: Shapes nearer to each other than this fraction of the length are one.
_SAME = 0.02
_NO_LOADS: Array = np.empty((0, 7))
_SOLVE = Direct(drive.solve)


class Search:
    """One solve. Methods that return True leave an equilibrium as the network's last solution.

    `buffer` and `loads` take the shape and what it does to its supports, `iterations` counts Newton steps, `late` tells
    that the deadline has passed, `info` what the last compiled solve told (see `drive`), `cold` that solutions lead to
    a start from nothing: friction does not count from them.
    """

    __slots__ = (
        "before", "began", "buffer", "cold", "deadline", "eyelets", "finer", "info", "iterations", "last", "late",
        "loads", "problem", "reached", "snapped", "softened", "state",
    )  # fmt: skip

    def __init__(
        self, problem: Problem, state: Network, deadline: float, began: float, last: Problem | None = None
    ) -> None:
        self.problem = problem
        self.last = problem if last is None else last  # whose loads the last solution is under, ...
        self.reached = 0.0  # ... or at this share of the way from there to those of the problem
        self.state = state
        self.deadline = deadline
        self.began = began
        self.iterations = 0
        self.late = self.snapped = self.softened = self.cold = False
        self.finer = _FINER if state.spans > 1 else _FINER[:1]  # of meshes that guesses are still to be tried on
        self.before: CableShape | None = None  # the last shape of a branch that ended
        self.buffer, self.loads = self.room()
        self.info: list[float] = []
        self.eyelets = Eyelets(state, self.inner, self.out_of_time) if state.rings else None

    def room(self) -> tuple[Array, Array]:
        """For a shape, and for what it does to its supports."""
        loads = np.empty((self.state.spans + 1, 7)) if self.state.spans > 1 else _NO_LOADS
        return CableShape.new_buffer(self.problem.points), loads

    # -- one compiled solve

    def call(
        self,
        history: int,
        most: int,
        guard: bool = True,
        output: bool = True,
        far: float = math.inf,
        near: bool = False,
    ) -> bool:
        """Solves for the supports in the trial; True if it found an equilibrium, a stable one if guarded.

        near: what is in the trial is next to it.
        """
        if self.eyelets is None:
            return self.inner(history, most, guard, output, far, False, False)
        return self.eyelets.call(history, most, guard, output, far, near or history > 0)

    def inner(self, history: int, most: int, guard: bool, output: bool, far: float, again: bool, sliding: bool) -> bool:
        """The same; again: for supports that it has just been solved for; sliding: the cable runs through eyelets."""
        state = self.state
        if self.cold:
            state.forget_friction()
        code = _SOLVE(
            state.ints, state.floats, state.sols, state.work, self.buffer, state.info, self.loads,
            self.problem.points if output else 0, history, again, sliding, guard, most, far,
        )  # fmt: skip
        self.info = state.info.tolist()
        self.info[I_ESTIMATE] += state.missed
        state.factored = True
        self.iterations += int(self.info[I_ITERATIONS])
        return bool(code == CONVERGED)

    def out_of_time(self) -> bool:
        self.late = self.late or perf_counter() > self.deadline
        return self.late

    @property
    def final(self) -> bool:
        """Whether the last solve found a stable shape within tolerance, on a mesh as fine as it need be."""
        info, state = self.info, self.state
        good = info[I_EXCESS] == 0.0 and not state.too_coarse(info) and not state.too_fine(info)
        return good and not state.rolls

    def shape(self, status: Status, detail: str) -> CableShape:
        """What the last compiled solve found."""
        problem, info, state = self.problem, self.info, self.state
        found = CableShape(
            self.buffer,
            problem.points,
            length=problem.cable.length,
            model=MODEL,
            status=status,
            detail=detail,
            energy=info[I_ENERGY] + state.energy_of_masses(),
            error_estimate=info[I_ESTIMATE],
            residual=info[I_RESIDUAL],
            iterations=self.iterations,
            turns=int(info[INFO + 1]),
            twist=info[INFO],
            solve_time=perf_counter() - self.began,
            before=self.before,
            force_error=info[I_FORCE],
            moment_error=info[I_MOMENT],
        )
        if state.spans > 1:
            found.supports = self.loads[1:-1]
            if state.has_friction:
                found.rubbed, found.frictionless = state.told_friction(len(found.supports))
        if problem.cable.sections:
            found.energy += energy_of_sections(problem.cable, found, problem.gravity)
        state.last = found
        return found

    def no_shape(self, status: Status, poses: Array, detail: str, missing: float = 0.0) -> CableShape:
        """Straight lines between the supports; what was solved before stays as a warm start."""
        told = detail if status is Status.OVERSTRETCHED and self.state.spans > 1 else detail + status.remedy
        shape = straight_lines(self.problem, self.state, self.buffer, poses, status, told)
        shape.iterations, shape.solve_time = self.iterations, perf_counter() - self.began
        shape.missing_length = missing
        return shape

    def hopeless(self, poses: Array) -> tuple[Status, Array, str, float] | None:
        """Why there is no equilibrium between `poses`, see `outcome.no_room`; None if there may be one."""
        return no_room(self.problem, self.state, poses)

    # -- what a call does where one warm solve is not enough

    def run(self, poses: Array, followed: bool) -> CableShape:
        """The shape between `poses`, whatever comes; followed: a warm solve has found an equilibrium there."""
        state = self.state
        if followed:
            return self._finish(Status.OK)
        if state.history > 0:
            poses = poses.copy()
        unheld = self.hopeless(poses)
        if unheld is not None:
            return self.no_shape(*unheld)
        if not self.problem.loaded_otherwise(self.last):
            self.last = self.problem
        if state.history > 0:
            return self._walk(poses)
        if state.spans > 1 and state.resume(poses):
            if self._resumed(poses) or self.follow(poses):
                return self._finish(Status.OK)
            if self.late:
                return self._give_up(poses)
            self._load(1.0)
            self.last = self.problem
        return self._cold(poses)

    def _resumed(self, poses: Array) -> bool:
        """From the shape that `resume` has taken up, on finer meshes where a coarse one has none like it."""
        state = self.state
        for fineness in _FINER:
            state.target[...] = poses
            if self.call(1, WARM_ITERATIONS, far=FAR):
                return True
            if self.out_of_time() or not state.resume(poses, fineness):
                return False
        state.target[...] = poses
        return self.call(1, WARM_ITERATIONS, far=FAR)

    def beside(self, frames: object, force: Array, fineness: float) -> CableShape:
        """Plain Newton steps from these frames, on a mesh so many times as fine as a cold start's."""
        state = self.state
        poses = state.aim(self.problem.start, self.problem.end)
        assert callable(frames)
        q = frames(np.linspace(0.0, self.problem.cable.length, 200))
        turn = 2.0 * np.arccos(np.minimum(1.0, np.abs((q[1:] * q[:-1]).sum(axis=1)))).sum()
        state.first_mesh(poses, fineness, turn)
        state.start_with(poses, frames, force)
        if self.call(0, COLD_ITERATIONS, guard=False):
            return self._finish(Status.UNSTABLE)
        return self.no_shape(Status.NOT_CONVERGED, poses, "")

    def _finish(self, status: Status) -> CableShape:
        """Refines the mesh until the error is within tolerance, grades and reports."""
        problem, state = self.problem, self.state
        if self.snapped and status is Status.OK:
            status = Status.SNAPPED
        if state.too_coarse(self.info):
            warm = state.history > 0
            found = self._remesh(status)
            if found is None:
                self.snapped = self.snapped or warm
                return self._lost(state.target.copy())
            status = found
        elif state.history > 0 and status is Status.OK and state.too_fine(self.info):
            self._coarsen()  # only now: a mesh that is too fine costs if it is used again
        info = self.info
        if status is Status.OK or status is Status.UNSTABLE:
            stable = info[I_EXCESS] == 0.0
            if stable and state.history == 0 and state.turns_freely:  # a soft mode may have changed its sign since
                stable = state.is_minimum()
            status = Status.OK if stable else Status.UNSTABLE
        within = info[I_ESTIMATE] <= problem.tolerance
        state.settle()
        least, runs = 0.0, False
        if status is Status.UNSTABLE:
            least, runs = state.smallest_eigenvalue(), state.runs_away()
            # the inertia was that of the last but one iterate, and a mode is neutral
            if least >= -state.neutral and not runs:
                status = Status.OK
        unheld = unheld_roll(problem, state, self.buffer, info[I_MOMENT]) if state.rolls else ""
        if self.late:
            status = Status.BUDGET if within else Status.BUDGET_EXCEEDED
        elif not within or unheld:
            status = Status.NOT_CONVERGED
        if status is Status.OK:
            return self.shape(status, "")
        detail = unheld
        if not within:
            detail = f"error estimate {info[I_ESTIMATE]:.2g} m, tolerance {problem.tolerance:.2g} m. "
        elif status is Status.UNSTABLE and runs:
            detail = "disturbed, the cable runs on through its eyelets. "
        elif status is Status.UNSTABLE:
            of_bending = least * state.length**2 / state.bend
            detail = f"smallest eigenvalue of the second variation {of_bending:.3g} EI/L^2. "
        return self.shape(status, detail + status.remedy)

    def _remesh(self, status: Status) -> Status | None:
        """Solves on the mesh that the error asks for: the status then, None if the equilibrium was lost on the way."""
        state = self.state
        keep = state.history
        coarse = self.shape(Status.OK, "")
        coarse.buffer = self.buffer.copy()
        for _ in range(_MESHES):
            if self.out_of_time() or not state.next_mesh():
                break
            guard = status is not Status.UNSTABLE
            if not self.call(0, COLD_ITERATIONS, guard=guard, near=True) and not self._find_again(coarse):
                return None
            if keep > 0 and status is Status.OK and self._elsewhere(*self.along(coarse)):
                status = Status.SNAPPED  # at a fold, which a coarse mesh puts a little further on
                self.before = coarse
            if not state.too_coarse(self.info):
                break
        state.history = min(keep, 1)
        return status

    def along(self, shape: CableShape) -> tuple[Array, Array]:
        """Arc lengths (k,) and positions (k, 3) of a shape."""
        return shape.arc_length, shape.positions

    def _elsewhere(self, s: Array, coarse: Array) -> bool:
        """Whether the finer mesh has led to another shape than that with positions (k, 3) at arc lengths s (k,).

        Frames alone do not tell: where they turn sharply a finer mesh turns them far.
        """
        if self.info[I_TURNED] <= _FAR_STEP:
            return False
        nodes, fine = self.state.node_positions()
        apart = np.stack([np.interp(nodes, s, x) for x in coarse.T], axis=1) - fine
        return float((apart * apart).sum(axis=1).max()) > (_SAME * self.state.length) ** 2

    def _find_again(self, coarse: CableShape) -> bool:
        """From the guesses to the shape that a coarse mesh gave, on a mesh of its own."""
        state, points = self.state, self.problem.points
        if state.spans > 1:
            return False
        poses, turns = state.target.copy(), state.turns
        for kind, sag in state.guesses(poses):
            state.first_mesh(poses, 2.0)
            state.start_from(poses, kind, sag, turns)
            if self.call(0, COLD_ITERATIONS):
                apart = self.buffer[points : 4 * points].reshape(points, 3) - coarse.positions
                if float((apart * apart).sum(axis=1).max()) < (_SAME * self.state.length) ** 2:
                    return True
        return False

    def refine(self) -> bool:
        """Meshes as fine as the error asks for, starting from the last solution; False where it is lost."""
        for _ in range(_MESHES):
            if not self.state.too_coarse(self.info) or not self.state.next_mesh():
                break
            if self.out_of_time() or not self.call(0, COLD_ITERATIONS, near=True):
                return False
        return True

    def _coarsen(self) -> None:
        """Solves on a coarser mesh, and stays with the one at hand if that does not lead to the same shape."""
        state, buffer, loads, info = self.state, self.buffer, self.loads, self.info
        kept = state.put_aside()
        state.next_mesh()
        self.buffer, self.loads = self.room()
        if self.call(0, WARM_ITERATIONS, far=_FAR_STEP, near=True) and not state.too_coarse(self.info):
            state.history = 1
            return
        state.put_back(kept)
        self.buffer, self.loads, self.info = buffer, loads, info

    def _lost(self, poses: Array) -> CableShape:
        """A finer mesh did not confirm the equilibrium."""
        if self.state.spans > 1 and self._guessed_finer(poses, self.state.turns):
            return self._finish(Status.OK)
        if softened(self, poses):
            return self._finish(Status.OK if self.before is None else Status.SNAPPED)
        self.state.history = 0
        return self.no_shape(Status.NOT_CONVERGED, poses, "the equilibrium was lost on a finer mesh. ")

    def _here(self) -> CableShape | None:
        """The last solution, wherever its supports are; None if there is none."""
        state, buffer, loads, info = self.state, self.buffer, self.loads, self.info
        if state.history == 0:
            return None
        self.buffer, self.loads = self.room()
        self._load(self.reached)
        state.target[...] = state.poses
        shape = self.shape(Status.OK, "") if self.call(1, STEP_ITERATIONS, guard=False) else None
        self.buffer, self.loads, self.info = buffer, loads, info
        state.history = 1
        return shape

    def _give_up(self, goal: Array) -> CableShape:
        """Out of time away from the goal: the shape for the supports that were reached, if any."""
        reached = self.state.poses.copy() if self.state.history else goal
        shape = self._here()
        if shape is None:
            return self.no_shape(Status.BUDGET_EXCEEDED, goal, "")
        gap = math.dist(reached[-1, :3] - reached[0, :3], goal[-1, :3] - goal[0, :3])
        shape.status = Status.BUDGET_EXCEEDED
        shape.detail = f"the shape is that of ends {gap:.2g} m nearer to where they were. {shape.status.remedy}"
        shape.error_estimate = math.inf
        return shape

    # -- from the last solution in small steps

    def _walk(self, poses: Array) -> CableShape:
        """Follows the branch along the straight path of the supports and loads; where it ends, the cable snaps."""
        if self.follow(poses):
            return self._finish(Status.OK)
        if self.late:
            return self._give_up(poses)
        state = self.state
        self.before = self._here()
        self._load(1.0)
        self.last = self.problem
        state.target[...] = poses
        state.unsettle()
        if self.call(1, COLD_ITERATIONS):
            return self._finish(Status.SNAPPED)
        state.history = 0
        self.snapped = True
        shape = self._cold(state.target.copy(), state.turns)
        if shape.status is Status.OK:
            shape.status = Status.SNAPPED
            shape.detail = Status.SNAPPED.remedy
        return shape

    def follow(self, poses: Array, snaps: bool = False) -> bool:
        """Goes with the supports from where they were to `poses`, and with the loads, in steps as small as it takes.

        snaps: where the branch ends, let the cable fall to the next stable shape and go on.
        """
        state = self.state
        origin = state.poses.copy()
        smallest = _SMALLEST_STEP if state.spans == 1 else _SMALLEST_IN_CLIPS
        done, step = 0.0, _FIRST_STEP
        state.history = min(state.history, 1)
        while done < 1.0:
            if self.out_of_time():
                return False
            least = step < smallest  # where the cable buckles the branch goes on, but is hard to find
            at = min(1.0, done + (smallest if least else step))
            self._load(at)
            state.target[...] = between(origin, poses, at)
            most = COLD_ITERATIONS if least else STEP_ITERATIONS
            if self.call(state.history, most, far=_FAR_STEP, output=at == 1.0):
                state.history = 2
                done = self.reached = at
                step = 1.6 * max(step, smallest)
                if state.far_too_coarse(self.info):
                    nodes, coarse = state.node_positions()
                    if state.next_mesh():
                        found = self.call(0, COLD_ITERATIONS, output=at == 1.0, near=True)
                        if not found or self._elsewhere(nodes, coarse):
                            return False  # at a fold, which a coarse mesh puts a little further on
                        state.history = 1
            elif least:
                if not snaps:
                    return False
                step = _FIRST_STEP * _FIRST_STEP
                done = min(1.0, done + step)
                self._load(done)
                state.target[...] = between(origin, poses, done)
                if not self.call(1, COLD_ITERATIONS):
                    return False
                self.reached = done
                state.history = 1
            else:
                step *= 0.4
                state.history = 1
        return True

    def _load(self, at: float) -> None:
        """Makes the loads those at this share of the way from the last ones, if they differ."""
        problem, state = self.problem, self.state
        if self.last is not problem:
            state.take(problem.after(self.last, at))
            state.aim(problem.start, problem.end, trial=True)

    # -- from nothing

    def _cold(self, poses: Array, wound: float = 0.0) -> CableShape:
        """From guesses, the likeliest first; windings are reached by turning the end."""
        problem, state = self.problem, self.state
        self.cold = True
        end = problem.end
        turns = end.cable_frame.turns if isinstance(end, Grip) and not self.snapped else 0
        if abs(turns) > MOST_TURNS:
            detail = (
                f"turns {turns} is not allowed from nothing: it must be within {MOST_TURNS} either way. On the way "
                "there the cable would go through itself. Start with fewer turns and turn the end from cycle to cycle. "
            )
            return self.no_shape(Status.NOT_CONVERGED, poses, detail)
        if wound == 0.0 and float(poses[state.roll, 3:] @ poses[-1, 3:]) < 0.0:
            poses[-1, 3:] *= -1.0
        if self.eyelets is not None:
            self.eyelets.spread(poses)
        found = self._started(poses, wound)
        if state.spans > 1:
            found = found or (not self.late and approached(self, poses))
        found = found or self._guessed_finer(poses, wound)
        found = found or (not self.late and softened(self, poses))
        if found:
            if turns and not self._wind_up(turns):
                if self.late:
                    return self._give_up(poses)
                detail = f"the cable does not keep {turns} turns: it goes through itself on the way there. "
                state.history = 0
                return self.no_shape(Status.NOT_CONVERGED, poses, detail)
            return self._finish(Status.SNAPPED if self.snapped else Status.OK)
        if self.late:
            return self._give_up(poses)
        if guessed(self, poses, 2.0, wound, guard=False):
            return self._finish(Status.UNSTABLE)
        state.history = 0
        return self.no_shape(Status.NOT_CONVERGED, poses, "" if self.eyelets is None else self.eyelets.why)

    def _started(self, poses: Array, wound: float) -> bool:
        """Tries the guesses on the usual mesh, and refines it, in one compiled call."""
        state = self.state
        if self.eyelets is not None:
            return guessed(self, poses, 1.0, wound)
        meshes = start.MOST_MESHES if self.deadline == math.inf else 0
        code = state.started(poses, wound, meshes, self.buffer, self.loads)
        self.info = state.info.tolist()
        self.iterations += int(self.info[I_ITERATIONS])
        if code == start.LOST:
            return not self.out_of_time() and guessed(self, poses, 1.0, wound)
        return bool(code == start.FOUND)

    def _guessed_finer(self, poses: Array, wound: float) -> bool:
        """From the guesses, on meshes finer than any that they were tried on."""
        while self.finer and not self.late:
            fineness, self.finer = self.finer[0], self.finer[1:]
            if guessed(self, poses, fineness, wound):
                return True
        return False

    def _wind_up(self, turns: int) -> bool:
        """From the winding 0, which has just been solved, to `turns` by turning the end about its d3."""
        state = self.state
        state.history = 1
        origin = state.poses.copy()
        count = round(abs(turns) / _QUARTER_TURN)
        for i in range(1, count + 1):
            half = math.pi * turns * i / count
            poses = origin.copy()
            poses[-1, 3:] = multiply(origin[-1, 3:], np.array((0.0, 0.0, math.sin(half), math.cos(half))))
            if self.out_of_time():
                return False
            state.target[...] = poses
            if self.call(state.history, WARM_ITERATIONS, far=FAR):
                state.history = 2
                if state.far_too_coarse(self.info) and state.next_mesh():
                    if not self.call(0, COLD_ITERATIONS, near=True):
                        return False
                    state.history = 1
            elif not self.follow(poses):
                state.target[...] = poses
                if self.late or not self.call(1, COLD_ITERATIONS):
                    return False
                self.snapped = True
                state.history = 1
        return True


def between(origin: Array, goal: Array, at: float) -> Array:
    """Poses (k, 7) on the straight path from `origin` to `goal`: positions linear, along the shortest turn."""
    poses = (1.0 - at) * origin + at * goal
    p, q = origin[:, 3:], goal[:, 3:].copy()
    cosine = (p * q).sum(axis=1, keepdims=True)
    q[cosine[:, 0] < 0.0] *= -1.0
    angle = np.arccos(np.minimum(1.0, np.abs(cosine)))
    sine = np.where(angle > 1e-6, np.sin(angle), 1.0)
    a = np.where(angle > 1e-6, np.sin((1.0 - at) * angle) / sine, 1.0 - at)
    b = np.where(angle > 1e-6, np.sin(at * angle) / sine, at)
    turned = a * p + b * q
    poses[:, 3:] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return np.asarray(poses)
