"""One cable held at the points where it touches another cable, or itself: :class:`Held`."""

from __future__ import annotations

import copy
import math
from time import perf_counter
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import crossing_response, span_work
from cable_shape.models.rod_common import MODEL
from cable_shape.models.span_search import COLD_ITERATIONS, FAR, STEP_ITERATIONS, Search
from cable_shape.models.span_state import SpanState
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.problem import NAMED_TOLERANCE, Problem
from cable_shape.scene import Clip
from cable_shape.shape import CableShape, Status

#: Of the shape's tolerance, what the mesh is made for: forces at the points have to settle, which the correction of a
#: large discretisation error with factors that are not quite fresh would disturb.
FINER = 0.01
_REACH = 0.4  #: of the way from a held point to the next one, a mass or an end, that it may go in one step


@final
class Held:
    """A rod between its ends and k points, each held at a place and an arc length that are given with every solve.

    After :meth:`solve` and :meth:`respond`: `force` (k, 3) [N], world, on the cable at its points; `tangent` (k, 3);
    and their derivatives `dforce`, `dtangent` (k, 3, k, 4) in the points' places and arc lengths, those before the
    correction of the discretisation error.
    """

    def __init__(self, problem: Problem, shape: CableShape, arcs: Array, frames: Array) -> None:
        """From a shape of the cable with its ends in `frames` (2, 7); arcs (k,) [m], ascending."""
        self.problem = copy.copy(problem)
        self.problem.cache = {}
        self.tolerance = min(problem.tolerance, NAMED_TOLERANCE * problem.cable.length)  # m, asked of the shape
        self.problem.tolerance = FINER * self.tolerance
        self.problem.clips = tuple(Clip(arc, Pose()) for arc in arcs.tolist())
        self.state = SpanState(self.problem, shape)
        start = self.state.aim(problem.start, problem.end)
        start[0], start[-1] = frames
        start[1:-1, :3] = positions_at(shape, arcs)
        if not self.state.resume(start):
            self.state.history = 0
        self.search = Search(self.problem, self.state, math.inf)
        k = len(arcs)
        self.force, self.tangent = np.zeros((k, 3)), np.zeros((k, 3))
        self.dforce, self.dtangent = np.zeros((k, 3, k, 4)), np.zeros((k, 3, k, 4))
        self._corrected = self.force, self.tangent

    @property
    def arcs(self) -> Array:
        """(k,) [m], of the points."""
        return self.state.arcs[1:-1]

    @property
    def iterations(self) -> int:
        """Newton steps since this was made."""
        return self.search.iterations

    def take(self, problem: Problem) -> None:
        """The ends where they are now."""
        self.problem.start, self.problem.end = problem.start, problem.end
        self.state.aim(problem.start, problem.end)

    def keep(self) -> tuple[Array, Array, int]:
        """What :meth:`restore` takes; valid until the mesh changes."""
        return self.state.sol.copy(), self.state.arcs.copy(), self.state.history

    def restore(self, kept: tuple[Array, Array, int]) -> None:
        """Back to where `keep` was called."""
        sol, arcs, self.state.history = kept
        if not np.array_equal(arcs, self.state.arcs):
            self.state.slide_to(arcs)
        self.state.sol[:] = sol

    def room(self, arcs: Array, change: Array) -> float:
        """The fraction of a change of the arc lengths that keeps the points in order, and between their stops."""
        stops = np.sort(np.concatenate((self.state.stops, self.state.arcs[[0, -1]], arcs)))
        fraction = 1.0
        for at, by in zip(arcs.tolist(), change.tolist(), strict=True):
            i = int(np.searchsorted(stops, at))
            way = stops[i + 1] - at if by > 0.0 else at - stops[i - 1]
            if abs(by) > _REACH * way:
                fraction = min(fraction, _REACH * way / abs(by))
        return fraction

    def solve(self, frames: Array, arcs: Array, places: Array, *, again: bool, far: float = FAR) -> bool:
        """The rod with its ends in `frames` (2, 7) and its points held in `places` (k, 3); False leaves the last one.

        again: another solve for the same ends, so that the solution before stays the one that motion is told from.
        far [rad]: largest turn of a frame from its prediction.
        """
        state = self.state
        kept = state.arcs
        full = np.concatenate((kept[:1], arcs, kept[-1:]))
        if not np.array_equal(full, kept):
            state.slide_to(full)
        state.target[0], state.target[-1] = frames
        state.target[1:-1, :3] = places
        history = 1 if again else state.history
        most = STEP_ITERATIONS if history else COLD_ITERATIONS
        if not self.search.call(history, most, far=far if history else math.inf, again=again):
            if not np.array_equal(full, kept):
                state.slide_to(kept)
            return False
        state.history = max(state.history, 1) if again else min(2, state.history + 1)
        frames = span_work.vectors(state.work, state.elements)[5]  # of the nodes, corrected
        self._corrected = -self.search.loads[:, 1:4], directions(frames[state.where[1:-1]])
        return True

    def respond(self) -> None:
        """Fills forces, tangents and their derivatives."""
        state = self.state
        state.refresh()
        crossing_response.held_points(
            state.par, state.mesh, state.sol, state.work, state.where, state.mask, state.place, state.elements,
            state.forces, self.force, self.tangent, self.dforce, self.dtangent,
        )  # fmt: skip
        self.force, self.tangent = self._corrected

    def refined(self) -> bool | None:
        """Whether a new mesh was needed (None), and the last solution was found again on it."""
        state = self.state
        if not (state.too_coarse(self.search.info) or state.too_fine(self.search.info)):
            return None
        found = self.search.refine()
        state.history = min(state.history, 1)
        return found

    def shape(self, status: Status, detail: str, touches: Array, bodies: tuple[str, ...], began: float) -> CableShape:
        """The solution in the buffer, reported."""
        problem, state, info = self.problem, self.state, self.state.info
        buffer, n = self.search.buffer, problem.points
        self.search.buffer = CableShape.new_buffer(n)
        if type(problem.end) is Grip:
            buffer[4 * n - 3 : 4 * n] = problem.end.cable_frame.position
        if status and not info[7] <= self.tolerance:
            status = Status.NOT_CONVERGED
            detail = f"error estimate {info[7]:.2g} m, tolerance {self.tolerance:.2g} m. {status.remedy}"
        return CableShape(
            buffer,
            n,
            length=problem.cable.length,
            model=MODEL,
            status=status,
            detail=detail,
            energy=float(info[8]) + state.energy_of_masses(),
            error_estimate=float(info[7]),
            residual=float(info[5]),
            iterations=self.iterations,
            turns=int(state.turns[0]),
            twist=float(info[9]),
            solve_time=perf_counter() - began,
            touches=touches,
            bodies=bodies,
        )


def directions(quaternions: Array) -> Array:
    """(k, 3), d3 of frames (k, 4)."""
    x, y, z, w = quaternions.T
    return np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)


def positions_at(shape: CableShape, arcs: Array) -> Array:
    """(k, 3) [m], of the material points at arc lengths (k,)."""
    return np.stack([np.interp(arcs, shape.arc_length, column) for column in shape.positions.T], axis=1)


def end_frames(problem: Problem) -> Array:
    """(2, 7), of the ends of a cable; a free end has that of the start."""
    start, end = problem.start.cable_frame.array, problem.end
    return np.array((start, start if isinstance(end, FreeEnd) else end.cable_frame.array))
