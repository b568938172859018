"""One cable held at the points where it touches another cable, or itself: :class:`Held`."""

from __future__ import annotations

import math
from time import perf_counter
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.network import points, tables
from cable_shape.kernels.network.drive import I_ESTIMATE
from cable_shape.pose import FreeEnd, Grip, multiply
from cable_shape.scene.body_tables import carried_by, link_rows
from cable_shape.shape import CableShape, Status
from cable_shape.solve.network import Network
from cable_shape.solve.problem import NAMED_TOLERANCE, Problem
from cable_shape.solve.search import FAR, STEP_ITERATIONS, Search
from cable_shape.solve.starts import COLD_ITERATIONS
from cable_shape.solve.touching.crossing_points import HeldPoints, directions, positions_at

#: Of the shape's tolerance, what the mesh is made for: forces at the points have to settle, which the correction of a
#: large discretisation error with factors that are not quite fresh would disturb.
FINER = 0.01
_MESHES = 12  #: so many are tried for one shape
SETTLED = 0.02  #: of the tolerance: a smaller step of the points is the last one


@final
class Held(HeldPoints[Network]):
    """A rod between its ends and k points, each held at a place and an arc length that are given with every solve.

    `dforce` and `dtangent` are those before the correction of the discretisation error.
    """

    def __init__(self, problem: Problem, shape: CableShape, arcs: Array, frames: Array) -> None:
        """From a shape of the cable with its ends in `frames` (2, 7); arcs (k,) [m], ascending."""
        super().__init__(problem, arcs, "slide")  # eyelets, through which it runs only where it is told to
        self.tolerance = min(problem.tolerance, NAMED_TOLERANCE * problem.cable.length)  # m, asked of the shape
        self.problem.tolerance = FINER * self.tolerance
        self.settled = SETTLED * self.tolerance
        self.state = Network(self.problem, shape)
        self._supports = self.state.aim(problem.start, problem.end)
        if not self.state.resume(self._placed(frames, positions_at(shape, arcs))):
            self.state.history = 0
        self.search = Search(self.problem, self.state, math.inf, 0.0)
        self._corrected = self.force, self.tangent

    @property
    def reaction(self) -> Array:
        """(k, 3) [N], world, what holds the points in the last solution."""
        return self._corrected[0]

    @property
    def iterations(self) -> int:
        """Newton steps since this was made."""
        return self.search.iterations

    def keep(self) -> tuple[Array, Array, int, tuple[Array, Array]]:
        """What :meth:`restore` takes; valid until the mesh changes."""
        return self.state.sols.copy(), self.state.bounds().copy(), self.state.history, self._corrected

    def restore(self, kept: tuple[Array, Array, int, tuple[Array, Array]]) -> None:
        """Back to where `keep` was called."""
        sols, arcs, self.state.history, self._corrected = kept
        if not np.array_equal(arcs, self.state.bounds()):
            self.state.slide_to(arcs)
        self.state.sols[:] = sols

    def solve(
        self, frames: Array, arcs: Array, places: Array, *, again: bool, far: float = FAR, links: Array | None = None
    ) -> bool:
        """The rod with its ends in `frames` (2, 7) and its points held in `places` (k, 3); False leaves the last one.

        again: another solve for the same ends, so that the solution before stays the one that motion is told from.
        far [rad]: largest turn of a frame from its prediction. links: no matter without bodies.
        """
        state = self.state
        kept = state.bounds().copy()
        full = kept.copy()
        full[self._at] = arcs
        if not np.array_equal(full, kept):
            state.slide_to(full)
        state.target[:] = self._placed(frames, places)
        history = 1 if again else state.history
        most = STEP_ITERATIONS if history else COLD_ITERATIONS
        if not self._call(history, most, far if history else math.inf, again):
            if not np.array_equal(full, kept):
                state.slide_to(kept)
            return False
        state.history = max(state.history, 1) if again else min(2, state.history + 1)
        frames = tables.work_of.py_func(state.ints, state.work).start  # of the nodes, corrected
        nodes = np.array([state.runs[at][0] for at in self._at])
        self._corrected = -self.search.loads[self._at, 1:4], directions(frames[nodes])
        return True

    def _call(self, history: int, most: int, far: float, again: bool) -> bool:
        """One compiled solve, the points staying where they are on the cable."""
        return self.search.inner(history, most, True, True, far, again, False)

    def respond(self) -> None:
        """Fills forces, tangents and their derivatives."""
        state = self.state
        state.refresh()
        points.held_points(
            state.ints, state.floats, state.sols, state.work, self._at, self.force, self.tangent, self.dforce,
            self.dtangent,
        )  # fmt: skip
        self.force, self.tangent = self._corrected

    @property
    def names(self) -> tuple[str, ...]:
        """Of the bodies that it may touch: none."""
        return ()

    def under_motion(self, motion: Array) -> tuple[Array, Array]:
        """(k, 3) each, change of `force` and `tangent` as the ends move by `motion` (2, 6) from where `respond` was."""
        state = self.state
        out = np.empty_like(self.force), np.empty_like(self.force)
        points.points_under_motion(state.ints, state.floats, state.sols, state.work, self._at, motion, *out)
        return out

    def refined(self) -> bool | None:
        """Whether a new mesh was needed (None), and the last solution was found again on it."""
        state, search = self.state, self.search
        if not (state.too_coarse(search.info) or state.too_fine(search.info)):
            return None
        found = True
        for _ in range(_MESHES):
            if not state.next_mesh():
                break
            found = self._call(0, COLD_ITERATIONS, math.inf, False)
            if not found or not state.too_coarse(search.info):
                break
        state.history = min(state.history, 1)
        return found

    def shape(self, status: Status, detail: str, touches: Array, bodies: tuple[str, ...], began: float) -> CableShape:
        """The solution in the buffer, reported."""
        problem, search = self.problem, self.search
        found = search.shape(status, detail)
        search.buffer = CableShape.new_buffer(problem.points)
        if status and not search.info[I_ESTIMATE] <= self.tolerance:
            found.status = Status.NOT_CONVERGED
            found.detail = (
                f"error estimate {search.info[I_ESTIMATE]:.2g} m, tolerance {self.tolerance:.2g} m. "
                f"{found.status.remedy}"
            )
        if type(problem.end) is Grip:
            found.buffer[4 * problem.points - 3 : 4 * problem.points] = problem.end.cable_frame.position
        found.solve_time = perf_counter() - began
        found.supports = search.loads[1 + self._clips].copy()
        found.touches, found.bodies = touches, bodies
        return found


def end_frames(problem: Problem) -> Array:
    """(2, 7), of the ends of a cable; a free end has that of the start."""
    start, end = problem.start.cable_frame.array, problem.end
    return np.array((start, start if isinstance(end, FreeEnd) else end.cable_frame.array))


def all_frames(problems: list[Problem]) -> Array:
    """(n, 7), of both ends of all the cables, and of the links that carry bodies, where they are known."""
    links = problems[0].links
    carried = {} if links is None else carried_by(problems[0].bodies)
    frames = np.empty((2 * len(problems) + len(carried), 7))
    for i, problem in enumerate(problems):
        frames[2 * i : 2 * i + 2] = end_frames(problem)
    if links is not None and carried:
        frames[2 * len(problems) :] = link_rows(links, carried)
    return frames


def twists(before: Array, after: Array) -> Array:
    """(k, 6), displacement [m] and rotation [rad], world, from frames (k, 7) to others."""
    out = np.empty((len(before), 6))
    out[:, :3] = after[:, :3] - before[:, :3]
    for row, p, q in zip(out, before[:, 3:], after[:, 3:], strict=True):
        x, y, z, w = multiply(q, np.array((-p[0], -p[1], -p[2], p[3])))
        size = math.sqrt(x * x + y * y + z * z)
        f = 2.0 if size < 1e-9 else 2.0 * math.atan2(size, abs(w)) / size
        row[3:] = math.copysign(f, w) * np.array((x, y, z))
    return out
