"""A network that settles against drag: :class:`Settling`, the road over snaps to where a cable falls."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.network import depart, motion, settle, tables
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.settle import I_DRAG, I_ENERGY, I_EXCESS, I_FORCE, I_ITERATIONS, I_TURNED, INFO
from cable_shape.kernels.network.tables import LENGTH, NOW, SOFTEST, SWINGS, TRIAL
from cable_shape.solve.plan import Whole, loose_spans, moving

#: The first step in time, the shortest and the longest, in drag length^2 / softest (softest: stiffness / length^2): the
#: slowest mode of a cantilever takes a twelfth of it to fall to 1/e.
_FIRST, _SHORTEST, _LONGEST = 1e-3, 1e-12, 30.0
#: A step that fails is tried again so much shorter; the next one is so much longer where the last was easy.
_SHORTER, _LONGER = 0.2, 4.0
#: A step is easy within so many iterations, and so little of the largest turn of a frame.
_FEW, _LITTLE = 6, 0.3


@final
class Settling:
    """A network in motion without mass, drag c [N s/m^2] its only resistance; nodes and what they are made of stay.

    ints, floats, sols: those of a network at rest (see `kernels.network.tables`), copied. Of its solution `which` it
    takes knots, rotations of the nodes and forces of the spans. Given knots may move from step to step: `poses`.
    swings: for what has mass, see `kernels.rod_element`.
    """

    def __init__(
        self, ints: Whole, floats: Array, sols: Array, which: int = TRIAL, drag: float = 1.0,
        swings: bool = False,
    ) -> None:  # fmt: skip
        self.ints = moving(ints, swings)
        self.floats, self.sols = floats.copy(), sols.copy()
        size = sols.size // 3
        self.sols[2 * size :] = sols[which * size : (which + 1) * size]
        self.work = np.zeros(tables.work_size.py_func(self.ints))
        self.moving = np.zeros(motion.motion_size.py_func(self.ints))
        self.info = np.zeros(INFO)
        self.dt = 0.0
        self.plan: tables.Plan = tables.plan_of.py_func(self.ints)
        self.model: tables.Model = tables.model_of.py_func(self.ints, self.floats)
        self.motion: motion.Motion = motion.motion_of.py_func(self.ints, self.moving)
        for j, (a, b) in enumerate(zip(self.plan.first[:-1], self.plan.first[1:], strict=True)):
            around = np.zeros(b - a + 1)
            around[:-1] += 0.5 * self.model.h[a:b]
            around[1:] += 0.5 * self.model.h[a:b]
            self.motion.drag[a + j : b + j + 1] = drag * around
        if swings:
            at_rest: tables.Plan = tables.plan_of.py_func(ints)
            for j in loose_spans(at_rest):
                self.motion.loose[self.plan.first[j + 1] + j] = 1.0
        self.motion.par[motion.LAW] = motion.AS_IT_IS if swings else motion.SEATED
        self.model.par[SWINGS] = 1.0 if swings else 0.0
        self.motion.load[...], self.motion.weight[...] = self.model.load, self.model.weight
        self.unit = drag * self.model.par[LENGTH] ** 2 / self.model.par[SOFTEST]  # s
        self.restart()
        self._place_leaves(ints)
        depart.begin(self.ints, self.floats, self.sols, self.moving)
        self.jumps = 0  # steps in which frames may have turned far
        self._moved = False  # whether a step has been taken
        self.energy = np.inf  # J, elastic energy less loads . places; not known before the first step

    def _place_leaves(self, ints: Whole) -> None:
        """Knots that nothing holds go to where their spans lead from those held."""
        rest: tables.Plan = tables.plan_of.py_func(ints)
        for j, end in rest.stripped[::-1]:
            leaf, other = rest.ends[j, end], rest.ends[j, 1 - end]
            pose = self.solution(TRIAL).pose
            pose[leaf, :3] = pose[other, :3]
            way = depart.way_of(self.ints, self.floats, self.sols, self.moving, int(j))
            pose[leaf, :3] += way if end == 1 else np.negative(way)

    def solution(self, which: int = NOW) -> tables.Solution:
        """Solution NOW, BEFORE or TRIAL."""
        found: tables.Solution = tables.solution_of.py_func(self.ints, self.sols, which)
        return found

    @property
    def poses(self) -> Array:
        """(k, 7): the knots of the next step; those that are given may be changed."""
        return self.solution(TRIAL).pose

    @property
    def places(self) -> Array:
        """(n, 3) [m], of the nodes."""
        return self.motion.origin

    def step(self, dt: float, far: float = settle.LARGEST_TURN, most: int = settle.MOST_ITERATIONS) -> bool:
        """One step in time [s]; False, and nothing has moved, if it is too long to be followed.

        far [rad]: by how much a frame may turn; most: iterations.
        """
        code = settle.step(self.ints, self.floats, self.sols, self.work, self.moving, dt, far, most, self.info)
        if code != CONVERGED:
            return False
        self.energy, self._moved = float(self.info[I_ENERGY]), True
        return True

    def advance(self) -> bool:
        """One step in time, as long as it can well be; False if none can be taken."""
        whole = shortest = self.dt
        while not self.step(self.dt):
            if self.info[I_EXCESS] < 0.0 or self.dt < _SHORTEST * self.unit:
                return self._jump(shortest if self._moved else whole)
            shortest = self.dt
            self.dt *= _SHORTER
        if self.info[I_ITERATIONS] <= _FEW and self.info[I_TURNED] <= _LITTLE * settle.LARGEST_TURN:
            self.dt = min(self.dt * _LONGER, _LONGEST * self.unit)
        return True

    def _jump(self, dt: float) -> bool:
        """A step however far frames turn in it, where they turn far in the shortest one: no drag holds twist back.

        Nor where one starts from what is no shape: spans that miss their knots, forces that are not its own.
        """
        self.dt = dt
        while not self.step(self.dt, np.inf):
            self.dt *= _SHORTER
            if self.info[I_EXCESS] < 0.0 or self.dt < _SHORTEST * self.unit:
                return False
        self.jumps += 1
        return True

    def restart(self) -> None:
        """The next step is as short as the first one was: what is given has changed."""
        self.dt = _FIRST * self.unit

    def at_rest(self, tolerance: float = 1e-9) -> bool:
        """Whether what drag still takes at any node is less than this fraction of the largest force, or of EI / L^2."""
        return bool(self.info[I_DRAG] <= tolerance * max(self.info[I_FORCE], self.model.par[SOFTEST]))

    def settle(self, most: int = 500, tolerance: float = 1e-9, each: Callable[[], None] | None = None) -> bool:
        """Steps until it is at rest, `each` called after every one; False if `most` do not do, or none can be taken."""
        for _ in range(most):
            if not self.advance():
                return False
            if each is not None:
                each()
            if self.at_rest(tolerance):
                if self.stable:
                    return True
                if not self.leave():
                    return False
        return False

    @property
    def stable(self) -> bool:
        """Whether where it is at rest no mode grows."""
        return self._excess(_LONGEST * self.unit) == 0

    def leave(self) -> bool:
        """Disturbs an unstable equilibrium along a mode that grows; False if that cannot be."""
        dt = self.dt
        while self._excess(dt) > 0 and dt > _SHORTEST * self.unit:
            dt *= _SHORTER
        self.dt = dt
        code = settle.nudge(self.ints, self.floats, self.sols, self.work, self.moving, dt)
        return bool(code == CONVERGED)

    def _excess(self, dt: float) -> int:
        """How many modes grow faster than a step dt follows, at the last shape."""
        size = self.sols.size // 3
        self.sols[2 * size :] = self.sols[:size]
        self.motion.lam[...] = self.motion.kept
        return int(settle.excess(self.ints, self.floats, self.sols, self.work, self.moving, dt))

    def hand_over(self, sols: Array) -> None:
        """Puts the shape into the trial of the same network at rest."""
        size = sols.size // 3
        sols[2 * size :] = self.sols[:size]
