"""The quasistatic Cosserat rod that rests on bodies (see docs/method.md).

The plain rod, or that in clips, answers as long as its shape is clear of every body. Otherwise nodes that would be
inside a body are pressed out of it along its normal, without friction; which ones is found along with the shape.
Bodies on robot links move with them: what they push follows in steps that no body is passed in.
"""

from __future__ import annotations

import math
from time import perf_counter
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import bounds, contact_check, contact_drive, contact_near, span_stability, span_work
from cable_shape.kernels.contact_near import GRIP_EXCLUSION, NORMAL, ROUND, SPOT
from cable_shape.kernels.contact_newton import RUNNING
from cable_shape.kernels.span_defect import support_loads
from cable_shape.kernels.span_newton import CONVERGED
from cable_shape.kernels.span_work import NOW
from cable_shape.models import clipped, cosserat
from cable_shape.models.rod_common import MODEL, straight_line, turn_about
from cable_shape.models.rod_state import RodState
from cable_shape.models.span_state import SpanState
from cable_shape.models.touch_state import MOST_ELEMENTS, TouchState
from cable_shape.pose import Grip
from cable_shape.problem import Problem
from cable_shape.shape import CableShape, Status

DEEPEST = 1e-4  #: [m] a shape deeper in a body than this between nodes gets a node there
BURIED = 2e-4  #: [m] a grip deeper in a body than this has no shape
COLD_ITERATIONS, WARM_ITERATIONS, STEP_ITERATIONS = 80, 30, 20
FAR = 0.7  #: A warm solve that turns a frame by more than this [rad] from its prediction is checked by small steps.
_FIRST_STEP, _SMALLEST_STEP = 0.25, 1.0 / 512.0
ACCURACY = 5e-4  #: of the length: what a shape in contact is asked for where the tolerance is below
FINE = 1.9e-4  #: of the length: an error from contacts above this asks for a finer mesh there
_FIRST_DRAG = 3e3  #: of a sliding cable, in stiffness / length^2
_AT_REST = 0.02  #: the same, times rad in a step: a cable that is driven by less looks for its equilibrium
_SLIDES = 200  #: such steps at most
_ROUNDS = 8  #: of adding nodes where the cable dips into a body between them


def solve(problem: Problem, state: TouchState, rod: RodState | SpanState, *, deadline: float = math.inf) -> CableShape:
    """The rod between the problem's ends and in its clips, outside its bodies.

    `rod` is the memory of the rod without contact, in clips a SpanState. Never raises for a physical reason: see
    `status`.

    Raises
    ------
    ArgumentError
        If the problem's `links` lack a link that carries a body.
    """
    began = perf_counter()
    if state.problem is not problem:
        state.take(problem)
    return _Solve(problem, state, rod, deadline, began).run()


def sensitivity(state: TouchState, *, at: str = "cable") -> Array:
    """(n, 3, 12): change of the last solution's positions at fixed arc length with the poses of the two ends.

    As :func:`cable_shape.models.cosserat.sensitivity`, as long as the same points stay in contact.
    """
    problem, n = state.problem, state.elements
    h = span_work.mesh_parts(state.mesh, n)[1]
    near, on = state.near[NOW], state.on[NOW]
    spans = contact_near.supports(
        state.q[NOW], h, near, on, state.held, state.held_mask, state.where, state.mask, state.place, state.base,
        ROUND, 2.0 / float(state.par[0] + state.par[1]), True,
    )  # fmt: skip
    contact_near.forces_of(near, NORMAL, state.ends[NOW], state.where, state.base, spans, state.lam)
    out = np.empty((problem.points, 3, 12))
    sol = np.zeros(3 * span_work.slot_size(n, spans))
    q, lam, frames, _, _ = span_work.slot(sol, n, spans, NOW)
    where, mask, place = state.where[: spans + 1], state.mask[: spans + 1], state.place[: spans + 1]
    q[:], lam[:] = state.q[NOW], state.lam[:spans]
    frames[:, :3] = near[where, SPOT : SPOT + 3]
    frames[:, 3:] = q[where]
    unknown = spans + state.forces + 1 - state.held.size
    arguments = (state.par, state.mesh, sol, state.work, where, mask, place, n, unknown)
    contact_drive.refresh(
        state.par, state.mesh, n, q, lam, where, mask, place, state.base[: spans + 1], unknown, state.work
    )
    span_stability.sensitivity(*arguments, np.empty(0, dtype=np.int64), problem.points, out, np.empty((0, 12)))
    turn_about(at, problem, out)
    return out


@final
class _Solve:
    """One call of :func:`solve`: free, then warm from the last shape, then in small steps, then from nothing."""

    __slots__ = ("began", "buffer", "deadline", "iterations", "late", "links", "loads", "problem", "rod", "state")

    def __init__(
        self, problem: Problem, state: TouchState, rod: RodState | SpanState, deadline: float, began: float
    ) -> None:
        self.problem, self.state, self.rod = problem, state, rod
        self.deadline, self.began = deadline, began
        self.iterations = 0
        self.late = False
        self.links = state.link_rows(problem.links)
        self.loads: Array = np.empty((0, 7))  # on the clips
        self.buffer = CableShape.new_buffer(problem.points)

    def run(self) -> CableShape:
        """The shape, whatever comes."""
        problem, state = self.problem, self.state
        state.move_bodies(self.links)
        frames = state.aim(problem.start, problem.end)
        buried = self._buried(frames)
        if buried:
            return self._no_shape(Status.NOT_CONVERGED, buried)
        if not state.touching:
            shape = self._free(self.rod)
            if shape.status in (Status.NOT_CONVERGED, Status.OVERSTRETCHED, Status.BUDGET_EXCEEDED):
                state.free = None
                return shape
            clear = self._depth(shape.buffer) > -DEEPEST
            last = state.free
            if clear and (last is None or not self._passes(last.positions, shape.positions)):
                state.rest(shape, frames)
                return shape
            if last is None:
                return self._cold(frames, shape)
            state.start_from(last, state.free_frames)
        return self._warm(frames)

    # -- attempts

    def _free(self, rod: RodState | SpanState) -> CableShape:
        """The shape without contact."""
        if isinstance(rod, SpanState):
            return clipped.solve(self.problem, rod, deadline=self.deadline)
        return cosserat.solve(self.problem, rod, deadline=self.deadline)

    def _call(self, history: int, most: int, *, far: float = math.inf, sunk: float = 0.0, drag: float = 0.0) -> bool:
        """One compiled solve for the frames in the trial; True if it found an equilibrium outside the bodies."""
        state = self.state
        code = contact_drive.solve(
            state.par, state.mesh, state.elements, state.q, state.near, state.on, state.ends, state.grips, state.turns,
            state.held, state.held_mask, state.forces, state.where, state.mask, state.place, state.lam, state.base,
            state.bodies, state.frames, state.triangles, state.tree, state.radius, sunk, state.stack,
            self.problem.load, state.table, state.work, self.buffer, state.info, self.problem.points, history,
            True, most, far, drag,
        )  # fmt: skip
        self.iterations += int(state.info[0])
        if code != CONVERGED:
            return False
        self.loads = self._loads_of_clips()
        return True

    def _step(
        self,
        frames: Array,
        history: int,
        most: int,
        far: float,
        sunk: float = 0.0,
        *,
        jump: bool = False,
        drag: float = 0.0,
    ) -> bool:
        """From the last solution to `frames`, not inside a body between the nodes, and unless a `jump` not past one.

        drag [N]: holds the rotations back from those of the last solution.
        """
        state = self.state
        state.target(frames)
        kept = state.copy()
        before = state.positions()
        refine = not jump and drag == 0.0
        solved = self._call(history, most, far=far, sunk=sunk, drag=drag)
        if solved and self._settle(frames, sunk, drag, refine=refine):
            n = self.problem.points
            after = self.buffer[n : 4 * n].reshape(n, 3)
            if jump or before is None or not self._passes(before, after):
                state.remember(after)
                state.tidy()
                return True
        state.restore(kept)
        return False

    def _settle(self, frames: Array, sunk: float = 0.0, drag: float = 0.0, *, refine: bool = True) -> bool:
        """Adds nodes where the cable dips into a body between them and, to `refine`, where contacts are too inexact."""
        state = self.state
        fine = FINE * self.problem.cable.length
        for _ in range(_ROUNDS):
            if refine and state.info[0] > RUNNING:  # contacts that run were stopped
                state.target(frames)
                if not self._call(1, WARM_ITERATIONS, sunk=sunk):
                    return False
            arcs = self._dips(sunk)
            deep = arcs.size > 0
            if not deep and refine and state.info[16] > fine:
                arcs = state.ends_of_rows()
            if not arcs.size:
                return True
            if state.elements + arcs.size > MOST_ELEMENTS or not state.insert(arcs):
                return not deep
            state.target(frames)
            if not self._call(1, WARM_ITERATIONS, sunk=sunk, drag=drag):
                return False
        return not self._dips(sunk, 2.0 * DEEPEST).size

    def _warm(self, frames: Array) -> CableShape:
        """From the last solution."""
        state = self.state
        state.thin()
        if self._step(frames, state.history, WARM_ITERATIONS, FAR) or self._follow(frames):
            return self._finish(Status.OK)
        if self._relax(frames):
            return self._finish(Status.SNAPPED)
        state.move_bodies(self.links)
        if self.late:
            return self._no_shape(Status.BUDGET_EXCEEDED, "")
        free = self._free(SpanState(self.problem) if self.problem.clips else RodState(self.problem))
        if not free.status or free.status is Status.OVERSTRETCHED:
            return self._lost()
        return self._cold(frames, free, Status.SNAPPED)

    def _follow(self, frames: Array) -> bool:
        """Goes with supports and bodies from where they were to `frames` and `links`, in steps as small as it takes."""
        state = self.state
        kept = state.copy()
        origin, links = state.grips[NOW].copy(), state.links_then
        done, step = 0.0, _FIRST_STEP
        history = 1
        while done < 1.0:
            if self._out_of_time():
                return False
            at = min(1.0, done + step)
            state.move_bodies(between(links, self.links, at))
            if self._step(between(origin, frames, at), history, STEP_ITERATIONS, FAR):
                done, history = at, 2
                step *= 1.6
            else:
                step, history = 0.4 * step, 1
                if step < _SMALLEST_STEP:
                    return False
        state.came_from(kept)
        return True

    def _relax(self, frames: Array) -> bool:
        """Lets the cable slide, as in a thick liquid, from the last solution to where it comes to rest at `frames`."""
        state = self.state
        origin, links = state.grips[NOW].copy(), state.links_then
        softest = float(min(state.par[:3])) / self.problem.cable.length**2
        done, step, drag = 0.0, 1.0, _FIRST_DRAG * softest
        for _ in range(_SLIDES):
            if self._out_of_time() or step < _SMALLEST_STEP:
                return False
            at = min(1.0, done + step)
            state.move_bodies(between(links, self.links, at))
            if self._step(between(origin, frames, at), 1, STEP_ITERATIONS, math.inf, drag=drag):
                rests = drag * state.info[12] < _AT_REST * softest
                done, drag = at, 0.4 * drag
                if done == 1.0 and rests and self._step(frames, 1, WARM_ITERATIONS, FAR):
                    return True
            else:
                drag *= 3.0
                step = min(0.5 * step, 1.0 - done) if done < 1.0 else step
        return False

    def _cold(self, frames: Array, free: CableShape, status: Status = Status.OK) -> CableShape:
        """From the shape without contact, to which the bodies come from below, or grow, or come from above."""
        state = self.state
        if -self._depth(free.buffer) <= DEEPEST:
            state.rest(free, frames)
            if status is not Status.OK:
                free.status, free.detail = status, status.remedy
            return free
        gravity = self.problem.gravity
        size = float(np.linalg.norm(gravity))
        down = gravity / size if size > 0.0 else np.array((0.0, 0.0, -1.0))
        for attempt in (1.0, 0.0, -1.0):
            found = self._approach(frames, free, attempt * down) if attempt else self._grow(frames, free)
            state.shift(np.zeros(3))
            if found and self._settle(frames):
                return self._finish(status)
            if self.late:
                return self._no_shape(Status.BUDGET_EXCEEDED, "")
        return self._lost()

    def _approach(self, frames: Array, free: CableShape, away: Array) -> bool:
        """Takes the bodies out of the cable's way along the unit vector `away` and brings them back in steps."""
        state = self.state
        start = 0.25 * max(-self._depth(free.buffer), DEEPEST)
        far = start
        while far < 2.0 * self.problem.cable.length:
            state.shift(far * away)
            if self._depth(free.buffer) > 0.0:
                break
            far *= 1.3
        else:
            return False
        state.start_from(free, frames)
        state.remember(free.positions)
        most = 0.6 * (state.thinnest + state.radius)
        step = min(0.25 * far, most)
        done = far
        while done > 0.0:
            if self._out_of_time():
                return False
            to = done - step if done - step > 0.1 * step else 0.0
            state.shift(to * away)
            if self._step(frames, 1, WARM_ITERATIONS, math.inf, jump=True):
                done = to
                step = min(1.5 * step, most)
            else:
                step *= 0.4
                if step < far * _SMALLEST_STEP:
                    return False
        return True

    def _grow(self, frames: Array, free: CableShape) -> bool:
        """Shrinks the bodies until the cable is outside, and lets them grow again."""
        self.state.start_from(free, frames)
        self.state.remember(free.positions)
        depth = -self._depth(free.buffer)
        sunk, step = depth, 0.25 * depth
        while sunk > 0.0:
            if self._out_of_time():
                return False
            to = sunk - step if sunk - step > 0.1 * step else 0.0
            if self._step(frames, 1, WARM_ITERATIONS, math.inf, to, jump=True):
                sunk = to
                step *= 1.5
            else:
                step *= 0.4
                if step < depth * _SMALLEST_STEP:
                    return False
        return True

    def _lost(self) -> CableShape:
        self.state.forget()
        return self._no_shape(Status.NOT_CONVERGED, "no equilibrium outside the obstacles was found. ")

    def _out_of_time(self) -> bool:
        self.late = self.late or perf_counter() > self.deadline
        return self.late

    # -- what is where

    def _passes(self, before: Array, after: Array) -> bool:
        """Whether the cable may have got past a body from one shape (n, 3) to the next."""
        state, n = self.state, self.problem.points
        s = np.linspace(0.0, self.problem.cable.length, n)
        return bool(
            contact_check.passes(
                s,
                before,
                after,
                state.bodies,
                state.frames,
                state.frames_then,
                state.triangles,
                state.tree,
                state.radius,
                state.stack,
            )
        )

    def _measured(self, buffer: Array) -> Array:
        """(m, 8), as `bounds.closest_points` has it, of every body near."""
        state, n = self.state, self.problem.points
        bounds.closest_points(
            buffer[n : 4 * n].reshape(n, 3), buffer[:n], state.radius, state.horizon, GRIP_EXCLUSION, True,
            state.bodies, state.moved_links, state.triangles, state.tree, state.measured, state.counts,
        )  # fmt: skip
        return state.measured

    def _depth(self, buffer: Array) -> float:
        """The least gap [m] of a shape to any body."""
        return float(self._measured(buffer)[:, 0].min(initial=math.inf))

    def _dips(self, sunk: float, deepest: float = DEEPEST) -> Array:
        """Arc lengths where the shape in the buffer is too deep in a body."""
        found = self._measured(self.buffer)
        return np.unique(found[found[:, 0] + sunk < -deepest, 1])

    def _buried(self, frames: Array) -> str:
        """Which grip or clip is inside which body, in words; empty if none is."""
        state, length = self.state, self.problem.cable.length
        clips = self.problem.clips
        supports = [("start grip", 0.0), *((f"clips[{i}]", clip.arc_length) for i, clip in enumerate(clips))]
        for (name, arc), row in zip([*supports, ("end grip", length)], frames, strict=True):
            if arc == length and type(self.problem.end) is not Grip:
                continue
            gap, body = contact_check.depth_of(
                row[:3], arc, length, state.bodies, state.frames, state.triangles, state.tree, state.radius, state.stack
            )
            if gap < -BURIED:
                what = name.split()[-1] if arc in (0.0, length) else "clip"
                return (
                    f"the cable at the {name} is {-gap * 1e3:.1f} mm inside obstacle {state.names[body]!r}. "
                    f"Move the {what} out of it, or leave the obstacle out of the scene. "
                )
        return ""

    def _loads_of_clips(self) -> Array:
        """(k, 7), what the cable does to its clips, as `support_loads` has it."""
        state = self.state
        if state.held.size < 3:
            return self.loads
        spans = int(state.info[3])
        loads = np.empty((spans - 1, 7))
        s = span_work.mesh_parts(state.mesh, state.elements)[0]
        first = span_work.vectors(state.work, state.elements)[0]
        moments = np.hstack((-first[:, 3:6], first[:, 6:9]))
        support_loads(state.q[NOW], state.lam[:spans], moments, s, state.where[: spans + 1], loads)
        return np.asarray(loads[state.base[1:spans] >= 0])

    # -- results

    def _finish(self, status: Status) -> CableShape:
        """Grades and reports the solution in the buffer."""
        problem, state, info = self.problem, self.state, self.state.info
        if type(problem.end) is Grip:
            n = problem.points
            self.buffer[4 * n - 3 : 4 * n] = problem.end.cable_frame.position
        found = state.touches()
        state.history = 2
        state.touching = len(found) > 0
        within = bool(info[7] <= max(problem.tolerance, ACCURACY * problem.cable.length))
        if status is Status.OK and info[2] != 0.0:
            status = Status.UNSTABLE
        detail = "" if status is Status.OK else status.remedy
        if self.late:
            status = Status.BUDGET if within else Status.BUDGET_EXCEEDED
            detail = status.remedy
        elif not within:
            status = Status.NOT_CONVERGED
            detail = f"error estimate {info[7]:.2g} m in contact. {status.remedy}"
        shape = CableShape(
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
            turns=int(state.turns[NOW]),
            twist=float(info[9]),
            solve_time=perf_counter() - self.began,
            supports=self.loads,
            touches=found,
            bodies=state.names,
        )
        if not state.touching:
            state.rest(shape, state.grips[NOW].copy())
            self.rod.history = 0
            if isinstance(self.rod, SpanState):
                self.rod.last = shape
        return shape

    def _no_shape(self, status: Status, detail: str) -> CableShape:
        """The straight line; what was solved before stays as a warm start."""
        problem = self.problem
        frames = self.state.aim(problem.start, problem.end)
        told = detail + status.remedy
        return straight_line(problem, self.buffer, frames[0], frames[-1], status, told, self.iterations, self.began)


def between(origin: Array, goal: Array, at: float) -> Array:
    """Frames (k, 7) on the straight path from `origin` to `goal`: positions linear, frames along the shortest turn."""
    frames = (1.0 - at) * origin + at * goal
    for row, a, b in zip(frames, origin, goal, strict=True):
        p, q = a[3:], b[3:] if a[3:] @ b[3:] >= 0.0 else -b[3:]
        angle = math.acos(min(1.0, float(p @ q)))
        if angle > 1e-6:
            row[3:] = (math.sin((1.0 - at) * angle) * p + math.sin(at * angle) * q) / math.sin(angle)
        row[3:] /= np.linalg.norm(row[3:])
    return frames
