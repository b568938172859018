"""The quasistatic Cosserat rod held in clips between its ends, span by span (see docs/method.md).

The equations are those of :mod:`cable_shape.models.cosserat`. In every span between two neighbouring clips the
internal force has a free constant of its own, so that a clip may push as it likes; what a clip does is the jump.
"""

from __future__ import annotations

import math
from itertools import pairwise
from time import perf_counter

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import span_guess, span_stability
from cable_shape.kernels.frames import align
from cable_shape.kernels.rod_drive import ENERGY, ESTIMATE, EXCESS, RESIDUAL, STRAIGHT, TURNS, TWIST
from cable_shape.models.rod_common import MODEL, straight_line, turn_about
from cable_shape.models.span_search import COLD_ITERATIONS, FAR, WARM_ITERATIONS, Search
from cable_shape.models.span_state import SpanState
from cable_shape.pose import Grip
from cable_shape.problem import Problem
from cable_shape.shape import CableShape, Status


def solve(problem: Problem, state: SpanState | None = None, *, deadline: float = math.inf) -> CableShape:
    """The rod between the problem's ends and in its clips; arguments as :func:`cable_shape.models.cosserat.solve`.

    Raises
    ------
    ArgumentError
        If the bending stiffness is 0. Never for a physical reason: see `status`.
    """
    began = perf_counter()
    if state is None:
        state = SpanState(problem)
    elif state.problem is not problem:
        state.take(problem)
    return _Solve(problem, state, deadline, began).run()


def sensitivity(state: SpanState, *, at: str = "cable") -> Array:
    """(n, 3, 12): change of the last solution's positions at fixed arc length with the poses of the two ends.

    As :func:`cable_shape.models.cosserat.sensitivity`; clips stand still, and the cable runs on through its eyelets.
    """
    if state.history == 0:
        raise ArgumentError("sensitivity() is not allowed yet: there is no solution. Call predict first.")
    problem = state.problem
    out, df = np.empty((problem.points, 3, 12)), np.empty((state.rings.size, 12))
    state.refresh()
    span_stability.sensitivity(
        state.par, state.mesh, state.sol, state.work, state.where, state.mask, state.place, state.elements,
        state.forces, state.rings, problem.points, out, df,
    )  # fmt: skip
    if state.rings.size:
        _, J, slid = state.eyelets(problem.points)
        out -= np.einsum("pik,kc->pic", slid, np.linalg.solve(J, df))
    turn_about(at, problem, out)
    return out


def smallest_eigenvalue(state: SpanState) -> float:
    """[N], of the last solution's second variation under its constraints, against the integral of |rotation|^2."""
    return float(
        span_stability.smallest_eigenvalue(
            state.par, state.mesh, state.sol, state.work, state.where, state.mask, state.place, state.elements,
            state.forces,
        )
    )  # fmt: skip


class _Solve:
    """One call of :func:`solve`: warm, then in small steps along the supports' path, then from a guess; graded."""

    __slots__ = ("began", "problem", "search", "state")

    def __init__(self, problem: Problem, state: SpanState, deadline: float, began: float) -> None:
        self.problem = problem
        self.state = state
        self.began = began
        self.search = Search(problem, state, deadline)

    def run(self) -> CableShape:
        """The shape, whatever comes."""
        problem, state, search = self.problem, self.state, self.search
        frames = state.aim(problem.start, problem.end)
        if state.history > 0:
            state.target[:] = frames
            if search.call(state.history, WARM_ITERATIONS, far=FAR):
                return self._finish(Status.OK)
        if state.par[5] == 0.0 and span_guess.taut(frames, state.arcs, state.forces, STRAIGHT):
            detail = self._overstretched(frames)
            if detail:
                return self._no_shape(Status.OVERSTRETCHED, frames, detail)
        fresh = state.history == 0
        if fresh:
            if not state.resume(frames):
                return self._cold(frames)
            state.target[:] = frames
            if search.call(state.history, WARM_ITERATIONS, far=FAR):
                return self._finish(Status.OK)
        if search.follow(frames):
            return self._finish(Status.OK)
        if search.late:
            return self._no_shape(Status.BUDGET_EXCEEDED, frames, "")
        return self._cold(frames) if fresh else self._snap(frames)

    def _snap(self, frames: Array) -> CableShape:
        """The branch ended: the stable shape that the cable falls to from the last one, or else any."""
        state = self.state
        state.target[:] = frames
        if self.search.call(1, COLD_ITERATIONS):
            return self._finish(Status.SNAPPED)
        state.history = 0
        self.search.snapped = True
        return self._cold(frames)

    def _cold(self, frames: Array) -> CableShape:
        """From guesses; windings are reached by turning the end."""
        state, search, end = self.state, self.search, self.problem.end
        turns = end.cable_frame.turns if isinstance(end, Grip) and not search.snapped else 0
        if search.eyelets is not None:
            search.eyelets.spread(frames)
        found = search.guessed(frames) or search.approached(frames)
        for fineness in (2.0, 5.0):  # a coarse mesh may miss a boundary layer
            found = found or search.guessed(frames, fineness=fineness)
        if found and (not turns or search.wind(turns)):
            return self._finish(Status.SNAPPED if search.snapped else Status.OK)
        if not found and search.guessed(frames, guard=False, fineness=2.0):
            return self._finish(Status.UNSTABLE)
        state.history = 0
        if search.late:
            return self._no_shape(Status.BUDGET_EXCEEDED, frames, "")
        return self._no_shape(Status.NOT_CONVERGED, frames, "" if search.eyelets is None else search.eyelets.why)

    def _finish(self, status: Status) -> CableShape:
        """Refines the mesh until the error is within tolerance, grades and reports."""
        problem, state, search = self.problem, self.state, self.search
        if state.too_coarse(search.info):
            keep = state.history
            if not search.refine(guard=status is not Status.UNSTABLE):
                state.history = 0
                detail = "the equilibrium was lost on a finer mesh. "
                return self._no_shape(Status.NOT_CONVERGED, state.target.copy(), detail)
            state.history = min(keep, 1)
            if search.snapped and status is Status.OK:
                status = Status.SNAPPED
        elif state.history > 0 and status is Status.OK and state.too_fine(search.info):
            search.coarsen()  # only now: a mesh that is too fine costs if it is used again
        info = search.info
        if status is Status.OK or status is Status.UNSTABLE:
            status = Status.OK if info[EXCESS] == 0.0 else Status.UNSTABLE
        within = info[ESTIMATE] <= problem.tolerance
        state.history = min(2, state.history + 1)
        energy = info[ENERGY] + state.energy_of_masses()
        detail = ""
        if search.late:
            status = Status.BUDGET if within else Status.BUDGET_EXCEEDED
            detail = status.remedy
        elif not within:
            status = Status.NOT_CONVERGED
            detail = f"error estimate {info[ESTIMATE]:.2g} m, tolerance {problem.tolerance:.2g} m. {status.remedy}"
        elif status is Status.UNSTABLE:
            least = smallest_eigenvalue(state) * problem.cable.length**2 / state.bend
            detail = f"smallest eigenvalue of the second variation {least:.3g} EI/L^2. {status.remedy}"
        elif status is not Status.OK:
            detail = status.remedy
        state.last = CableShape(
            search.buffer,
            problem.points,
            length=problem.cable.length,
            model=MODEL,
            status=status,
            detail=detail,
            energy=energy,
            error_estimate=info[ESTIMATE],
            residual=info[RESIDUAL],
            iterations=search.iterations,
            turns=int(info[TURNS]),
            twist=info[TWIST],
            solve_time=perf_counter() - self.began,
            supports=search.loads,
        )
        return state.last

    def _overstretched(self, frames: Array) -> str:
        """What is too far apart, in words; eyelets divide what is between the clips that hold the material."""
        state = self.state
        chords = np.linalg.norm(np.diff(frames[:, :3], axis=0), axis=1)
        holding = [j for j in range(state.spans + 1) if j not in state.rings]
        for a, b in pairwise(holding):
            if b > state.forces:
                continue
            path, length = chords[a:b].sum(), state.arcs[b] - state.arcs[a]
            if path >= STRAIGHT * length:
                through = " through the eyelets between them" if b - a > 1 else ""
                return (
                    f"{_name(a, state.spans)} and {_name(b, state.spans)} are {path:.4g} m apart{through}, "
                    f"{path - length:.3g} m more than the cable between them is long ({length:.4g} m). Bring them "
                    "closer, or let a clip hold another point of the cable; the shape is straight lines."
                )
        return ""

    def _no_shape(self, status: Status, frames: Array, detail: str) -> CableShape:
        """Straight lines through the clips; what was solved before stays as a warm start."""
        problem, state, buffer = self.problem, self.state, self.search.buffer
        n, arcs = problem.points, state.arcs
        corners = frames[:, :3].copy()
        if state.forces < state.spans:  # a free end has no place
            corners[-1] = corners[-2]
        told = detail if status is Status.OVERSTRETCHED else detail + status.remedy
        shape = straight_line(problem, buffer, frames[0], frames[-1], status, told, self.search.iterations, self.began)
        s, q = buffer[:n], frames[0, 3:].copy()
        positions, quaternions = buffer[n : 4 * n].reshape(n, 3), buffer[4 * n : 8 * n].reshape(n, 4)
        for j in range(state.spans):
            inside = (s >= arcs[j]) & (s <= arcs[j + 1])
            step = corners[j + 1] - corners[j]
            chord = float(np.linalg.norm(step))
            if chord > 0.0:
                align(q, *(step / chord))
            positions[inside] = corners[j] + np.outer((s[inside] - arcs[j]) / (arcs[j + 1] - arcs[j]), step)
            quaternions[inside] = q
        return shape


def _name(support: int, spans: int) -> str:
    """What a support is called in the scene."""
    return "the start grip" if support == 0 else "the end grip" if support == spans else f"clips[{support - 1}]"
