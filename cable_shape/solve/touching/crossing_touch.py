"""One cable that touches bodies, too, held at the points where it touches a cable: :class:`HeldAmong`."""

from __future__ import annotations

import math
from time import perf_counter
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.contact import crossing_ground
from cable_shape.kernels.contact.near import MARGIN
from cable_shape.kernels.distance import surface
from cable_shape.kernels.network import points as held_points
from cable_shape.kernels.network.tables import NOW
from cable_shape.pose import Grip
from cable_shape.shape import CableShape, Status
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import MODEL
from cable_shape.solve.touching.crossing_points import HeldPoints, positions_at
from cable_shape.solve.touching.crossing_step import Ground
from cable_shape.solve.touching.touch_state import TouchState
from cable_shape.solve.touching.touch_step import DEEPEST, WARM_ITERATIONS, Steps
from cable_shape.solve.touching.touching import ACCURACY, BURIED, inexact

_SETTLED = 1e-6  #: of the length: a smaller step of the points is the last one
_STALE = 0.05  #: of the length: where a point has run so far along the cable, the mesh is laid out anew
_FINEST = 4.0  #: times as many elements as usual, where contacts at nodes make too large an error
_REACH = 0.6  #: of half a body's thickness and the cable's: so far into a body a point may go in one step


@final
class HeldAmong(HeldPoints[TouchState]):
    """As :class:`cable_shape.solve.touching.crossing_state.Held`, outside the problem's bodies.

    Between the points the nodes are kept out of bodies along with every solve. The points are not: which bodies they
    are near is told by :meth:`grounds`.
    """

    def __init__(self, problem: Problem, shape: CableShape, arcs: Array, frames: Array, links: Array) -> None:
        """From a shape of the cable with its ends in `frames` (2, 7), the bodies' links in `links` (m, 7)."""
        super().__init__(problem, arcs, "ball")
        self.tolerance = max(problem.tolerance, ACCURACY * problem.cable.length)
        self.settled = _SETTLED * problem.cable.length
        self.state = TouchState(self.problem)
        self.state.move_bodies(links)
        self._supports = self.state.aim(problem.start, problem.end)
        self._target = self._placed(frames, positions_at(shape, arcs))
        self._finer = 1.0
        self.renew(shape)
        self.steps = Steps(self.problem, self.state, math.inf)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the bodies that it may touch."""
        return self.state.bodies.names

    @property
    def stale(self) -> bool:
        """Whether a point has run so far along the cable that the mesh is to be laid out anew."""
        return float(np.abs(self.state.arcs - self._laid_out).max()) > _STALE * self.problem.cable.length

    @property
    def lacking(self) -> bool:
        """Whether another mesh is wanted: it is stale or too coarse."""
        return self.stale or self.coarse

    @property
    def coarse(self) -> bool:
        """Whether the last solution is not within tolerance."""
        return not float(self.state.info[7]) <= self.tolerance

    def renew(self, shape: CableShape) -> None:
        """Goes on from a shape of the last solution, on a new mesh, a finer one if the last was too coarse."""
        self._finer = min(2.0 * self._finer, _FINEST) if self.coarse else 1.0
        self.state.start_from(shape, self._target, self._finer)
        self.state.remember(shape.positions)
        self._laid_out = self.state.arcs.copy()

    @property
    def reaction(self) -> Array:
        """(k, 3) [N], world, what holds the points in the last solution."""
        return np.asarray(-self.steps.loads[self._at - 1, 1:4])

    @property
    def iterations(self) -> int:
        """Newton steps since this was made."""
        return self.steps.iterations

    def take(self, problem: Problem) -> None:
        """As without bodies; nodes that are no longer needed go."""
        super().take(problem)
        self.state.thin()
        self.state.tidy()

    def buried(self) -> bool:
        """Whether a grip or a clip is inside a body, where the problem has them now."""
        state = self.state
        now = state.bodies.links
        state.move_bodies(state.bodies.link_rows(self.problem.links))
        supports = self._placed(self._supports[[0, -1]], self._target[self._at, :3])
        at = state.buried(supports, BURIED)[0]
        state.move_bodies(now)
        return at >= 0 and at not in self._at

    def keep(self) -> tuple[Any, ...]:
        """What :meth:`restore` takes."""
        state = self.state
        return state.copy(), state.arcs.copy(), state.history, state.positions, state.bodies.links, self._target

    def restore(self, kept: tuple[Any, ...]) -> None:
        """Back to where `keep` was called."""
        solutions, arcs, history, positions, links, self._target = kept
        state = self.state
        if not np.array_equal(arcs, state.arcs):
            state.slide_to(arcs)
        state.restore(solutions)
        state.history = history
        state.move_bodies(links)
        state.remember(positions)

    def solve(self, frames: Array, arcs: Array, places: Array, *, again: bool, far: float, links: Array) -> bool:
        """The rod with its ends in `frames` (2, 7) and its points held in `places` (k, 3); False leaves the last one.

        again: another solve for the same ends, so that the solution before stays the one that motion is told from.
        far [rad]: largest turn of a frame from its prediction. links: where the links are that carry bodies.
        """
        state = self.state
        state.tidy()
        kept = self.keep()
        full = state.arcs.copy()
        full[self._at] = arcs
        if not np.array_equal(full, state.arcs):
            state.slide_to(full)
        state.move_bodies(links)
        target = self._placed(frames, places)
        state.target(target)
        histories = (0,) if again else (2, 1) if state.history > 1 else (1,)
        found = any(self.steps.again(WARM_ITERATIONS, far=far, history=history) for history in histories)
        if not found or self.steps.passes(state.positions, self.steps.buffer):
            self.restore(kept)
            return False
        self._target = target
        state.history = max(state.history, 1) if again else min(2, state.history + 1)
        state.remember(self._positions)
        return True

    @property
    def _positions(self) -> Array:
        """(n, 3), of the shape in the buffer."""
        n = self.problem.points
        return self.steps.buffer[n : 4 * n].reshape(n, 3)

    def respond(self) -> None:
        """Fills forces, tangents and their derivatives, the same nodes staying in contact."""
        state, net = self.state, self.state.net
        state.refresh()
        self._behind = np.asarray(net.piece[self._at])
        held_points.held_points(
            net.ints,
            net.floats,
            net.sols,
            net.space,
            self._behind,
            self.force,
            self.tangent,
            self.dforce,
            self.dtangent,
        )

    def under_motion(self, motion: Array) -> tuple[Array, Array]:
        """(k, 3) each, change of `force` and `tangent` as the ends move by `motion` (2, 6) from where `respond` was."""
        net = self.state.net
        out = np.empty_like(self.force), np.empty_like(self.force)
        held_points.points_under_motion(net.ints, net.floats, net.sols, net.space, self._behind, motion, *out)
        return out

    def grounds(self, arc: float, place: Array, before: list[Ground]) -> list[Ground]:
        """The bodies near a point, which before were those."""
        state, bodies = self.state, self.state.bodies
        count = len(bodies.table)
        pressed, sides, out = np.zeros(count), np.zeros((count, 3)), np.empty((count, crossing_ground.GROUND))
        for ground in before:
            if ground.press > 0.0 and ground.body < count:
                pressed[ground.body], sides[ground.body] = ground.press, ground.normal
        crossing_ground.grounds(
            place, arc, self.problem.cable.length, bodies.table, bodies.frames, bodies.triangles, bodies.tree,
            state.radius, pressed, sides, bodies.stack, out,
        )  # fmt: skip
        return [
            Ground(b, float(out[b, 0]), out[b, 1:4], out[b, 4:].reshape(3, 3), float(pressed[b]))
            for b in np.flatnonzero(np.isfinite(out[:, 0])).tolist()
        ]

    def bounded(self, change: Array, grounds: list[Ground]) -> float:
        """The fraction of a change (3,) of a point's place that carries it neither into a body nor past one."""
        size = float(np.linalg.norm(change))
        fraction = MARGIN / size if size > MARGIN else 1.0
        for ground in grounds:
            way = -float(ground.normal @ change)
            thick = self.state.radius + surface.reach_of(self.state.bodies.table[ground.body])
            limit = max(ground.gap, 0.0) + _REACH * thick
            fraction = min(fraction, limit / way if way > limit else 1.0)
        return fraction

    def refined(self) -> bool | None:
        """Whether a new mesh was needed (None), and the last solution was found again on it."""
        state = self.state
        nodes, kept = state.nodes.copy(), self.keep()
        state.target(self._target)
        if not self.steps.settle(self._target):  # what is not as exact as it might be is still a shape
            self.restore(kept)
            state.target(self._target)
            found = self.steps.again(WARM_ITERATIONS)
            return None if found and self.steps.depth(self.steps.buffer) > -2.0 * DEEPEST else False
        state.remember(self._positions)
        return None if np.array_equal(nodes, state.nodes) else True

    def shape(self, status: Status, detail: str, touches: Array, bodies: tuple[str, ...], began: float) -> CableShape:
        """The solution in the buffer, reported; touches (k, 9): its points' contacts with `bodies`, `names` first."""
        problem, steps, info = self.problem, self.steps, self.state.info
        buffer, n = steps.buffer, problem.points
        steps.buffer = CableShape.new_buffer(n)
        if type(problem.end) is Grip:
            buffer[4 * n - 3 : 4 * n] = problem.end.cable_frame.position
        if status and not info[7] <= self.tolerance:
            status = Status.NOT_CONVERGED
            detail = inexact(float(info[7]), self.tolerance)
        found = np.vstack((self.state.touches(), touches))
        return CableShape(
            buffer,
            n,
            length=problem.cable.length,
            model=MODEL,
            status=status,
            detail=detail,
            energy=float(info[8]) + self.state.energy_of_masses(),
            error_estimate=float(info[7]),
            residual=float(info[5]),
            iterations=self.iterations,
            turns=int(self.state.turns[NOW, 0]),
            twist=float(info[9]),
            solve_time=perf_counter() - began,
            supports=steps.loads[self._clips],
            touches=found[np.argsort(found[:, 0], kind="stable")],
            bodies=bodies,
        )
