"""The state of a network that swings: :class:`Swing`, between Python and the compiled steps."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import final

import numpy as np

from cable_shape.cable.pieces import cable_at
from cable_shape.checks import Array
from cable_shape.kernels.network import momentum, motion, settle, swing_output, swing_run, swinging, tables
from cable_shape.kernels.network.momentum import ENERGY, KINETIC, PERIOD
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.settle import INFO
from cable_shape.kernels.network.tables import LENGTH, NOW, SOFTEST
from cable_shape.pose import FreeEnd
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.seen import Seen
from cable_shape.solve.settle import Settling

#: Default spectral radius at infinity of the steps in time: what a step cannot follow is gone after it.
RADIUS = 0.0
#: Elements of a cable, and the fewest of a span between two supports; how many boundary layers an element may be long,
#: for which there are at most so many.
ELEMENTS, FEWEST, LAYERS, MOST_ELEMENTS = 20, 4, 1.5, 400
#: What drag may still take where a motion begins, of the largest force: asked for, and enough.
_AT_REST, _NEAR_REST = 1e-12, 1e-7
#: Springs that draw to what was seen, in terms of the stiffness of the cable between the points; how far they draw at a
#: time, in lengths; iterations for that, and when they end [rad].
_FIRM, _STRETCH, _MOST, _EASY = 10.0, 0.02, 30, 1e-6
#: Of the mass of an element: by how much the last node of a span has more than half, and its neighbour less than all;
#: and the fraction of an element by which the former lies inside.
_MORE, _INSIDE = 1.0 / 48.0, 1.0 / 5.0


def spread_evenly(state: Network, elements: int) -> None:
    """Lays the solution of `state` out on elements of equal length, as far as masses and sections let."""
    bounds = state.bounds()
    inside = np.histogram(state.stops, bounds)[0] if state.stops.size else np.zeros(state.spans, dtype=np.int64)
    counts = np.round(elements * np.diff(bounds) / bounds[-1]).astype(np.int64)
    counts = np.maximum(counts, np.maximum(FEWEST, 2 * (inside + 1)))
    pieces = [(np.array((a, b)), np.ones(2)) for a, b in pairwise(bounds)]
    state.lay_out(pieces, counts.tolist())


@final
class Swing:
    """A network with mass, on the mesh and from the shape at rest that `state` has; `alive` tells whether it is one."""

    def __init__(self, problem: Problem, state: Network, radius: float = RADIUS) -> None:
        settling = Settling(state.ints, state.floats, state.sols, NOW, swings=True)
        self.alive = settling.settle(tolerance=_AT_REST) or settling.at_rest(_NEAR_REST)
        self.points = problem.points
        self.ints, self.floats, self.sols, self.work = settling.ints, settling.floats, settling.sols, settling.work
        self.moving, self.plan, self.model = settling.moving, settling.plan, settling.model
        self.motion: motion.Motion = settling.motion
        self.remembered = np.zeros(momentum.momentum_size.py_func(self.ints))
        self.memory: momentum.Momentum = momentum.momentum_of.py_func(self.ints, self.remembered)
        self.kept = np.empty(self.sols.size + self.remembered.size)
        self.info, self._scratch = np.zeros(swinging.INFO), np.zeros(INFO)
        self.told = np.zeros(2 * int(self.ints[tables.N_CABLES]))
        self.memory.par[momentum.RADIUS] = radius
        self.memory.rest[...], self.memory.section[...] = self.model.rest, self.model.section
        self._put_masses(problem)
        self._rest()

    def _put_masses(self, problem: Problem) -> None:
        """Mass, drag and damping of the cable and what it carries, at the nodes."""
        plan, model, memory, moving = self.plan, self.model, self.memory, self.motion
        moving.drag[...] = 0.0
        for e, node in enumerate(plan.left.tolist()):
            here, h = cable_at(problem.cable, 0.5 * (model.s[node] + model.s[node + 1])), model.h[e]
            memory.mass[node : node + 2] += 0.5 * here.linear_density * h
            moving.drag[node : node + 2] += 0.5 * here.drag * h
            memory.delay[e] = here.retardation_time
        masses, drags = memory.mass.copy(), moving.drag.copy()
        for j, (a, b) in enumerate(zip(plan.first[:-1], plan.first[1:], strict=True)):
            for end, inner, e in ((a + j, a + j + 1, a), (b + j, b + j - 1, b - 1)):
                moving.lever[end] = (_INSIDE if inner > end else -_INSIDE) * model.h[e]
                for whole, before in ((memory.mass, masses), (moving.drag, drags)):
                    whole[end] += 2.0 * _MORE * before[end]
                    whole[inner] -= 2.0 * _MORE * before[end]
        for mass in problem.masses:
            memory.point[np.abs(model.s - mass.arc_length).argmin()] += mass.mass
        end = problem.end
        self._tip = np.zeros(3)
        if isinstance(end, FreeEnd):
            memory.point[-1] += end.mass
            self._tip = end.mass * problem.end_fall + end.force
        memory.par[PERIOD] = (memory.mass.sum() + memory.point.sum()) * model.par[LENGTH] / model.par[SOFTEST]
        carried = memory.mass > 0.0
        moving.lever[carried] *= memory.mass[carried] / (memory.mass + memory.point)[carried]

    def _rest(self) -> None:
        """Makes the shape one at rest."""
        memory, now = self.memory, self.solution
        x, y, z, w = now.q.T
        tangents = np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
        memory.place[...], memory.tangent[...] = self.motion.place, tangents
        self.motion.aim[...] = memory.place + self.motion.lever[:, None] * tangents
        self.motion.origin[...] = self.motion.place
        self.motion.lam[...] = self.motion.kept
        swinging.take_stock(self.ints, self.floats, self.sols, self.work, self.moving, self.remembered, 0.0)

    def draw_to(self, seen: Seen) -> bool:
        """Draws the nodes to a path by springs, and lets them move as that does; False if they cannot get there.

        The springs are as stiff as the cable is in waves between the points. What they bend it by is let go in the
        first step.
        """
        memory, motion, s = self.memory, self.motion, self.model.s
        aim = seen.places(s)
        share = memory.mass / memory.mass.sum() * self.model.par[LENGTH]
        levers = motion.lever.copy()
        motion.lever[...] = 0.0
        motion.hold[...] = (
            _FIRM * self.model.par[SOFTEST] * self.model.par[LENGTH] ** 2 * (np.pi / seen.apart) ** 4 * share
        )
        size = self.sols.size // 3
        way = aim - motion.place
        stretches = max(2, int(np.ceil(np.linalg.norm(way, axis=1).max() / (_STRETCH * self.model.par[LENGTH]))))
        begin = motion.place.copy()
        done = True
        for x in np.arange(1, stretches + 1) / stretches:
            motion.origin[...] = motion.aim[...] = begin + x * way
            code = settle.newton(
                self.ints, self.floats, self.sols, self.work, self.moving, np.inf, _MOST, _EASY, True, self._scratch
            )
            done = code == CONVERGED
            if not done:
                break
            self.sols[size : 2 * size] = self.sols[:size]
            self.sols[:size] = self.sols[2 * size :]
        motion.kept[...] = motion.lam
        motion.lever[...] = levers
        rate, slope = seen.velocity(s), seen.velocity(s, 1)
        memory.velocity[...] = rate
        self._rest()
        memory.turning[...] = slope - np.einsum("ij,ij->i", slope, memory.tangent)[:, None] * memory.tangent
        return done

    @property
    def solution(self) -> tables.Solution:
        """The last solution."""
        found: tables.Solution = tables.solution_of.py_func(self.ints, self.sols, NOW)
        return found

    def tell(self, out: Array, velocity: Array) -> None:
        """Fills `out` and velocity of the shape at rest, see `swing_output`."""
        swing_output.tell(
            self.ints, self.floats, self.sols, self.work, self.moving, self.remembered, self.points, out, velocity,
            self.told,
        )  # fmt: skip

    def step(self, poses: Array, dt: float, out: Array, velocity: Array) -> bool:
        """One step dt [s] to the knots `poses` (k, 7); False, and nothing has changed, if it could not be taken."""
        code = swing_output.swing(
            self.ints, self.floats, self.sols, self.work, self.moving, self.remembered, poses, dt, self.kept, self.info,
            self._scratch, self.points, out, velocity, self.told,
        )  # fmt: skip
        return bool(code == CONVERGED)

    def run(self, goals: Array, steps: Array) -> tuple[Array, Array, Array, int]:
        """Steps (T,) [s] to the knots goals (T, k, 7), one after the other.

        Returns places, tangents and velocities (T, n, 3) of the nodes, and how many steps could not be taken.
        """
        told = np.empty((3, len(steps), len(self.model.s), 3))
        lost = swing_run.run(
            self.ints, self.floats, self.sols, self.work, self.moving, self.remembered, goals, steps, self.kept,
            self.info, self._scratch, told[0], told[1], told[2],
        )  # fmt: skip
        return told[0], told[1], told[2], int(lost)

    @contextmanager
    def kept_as_it_is(self) -> Iterator[None]:
        """What is stepped meanwhile is forgotten."""
        state = self.floats, self.sols, self.moving, self.remembered
        before = [array.copy() for array in state]
        yield
        for array, old in zip(state, before, strict=True):
            array[...] = old

    def load_end(self, end: FreeEnd, fall: Array) -> None:
        """Takes over what loads a free end; fall (3,) [m/s^2]: of its plug."""
        self.model.force[-1] += end.mass * fall + end.force - self._tip
        self.model.moment[-1] = end.moment
        self._tip = end.mass * fall + end.force

    @property
    def turns(self) -> int:
        """Windings of the end, counted from the start."""
        return int(self.solution.turns[0])

    @property
    def energy(self) -> float:
        """[J], elastic energy less loads . places."""
        return float(self.memory.par[ENERGY])

    @property
    def kinetic_energy(self) -> float:
        """[J]."""
        return float(self.memory.par[KINETIC])
