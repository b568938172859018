"""The state of a network that swings: :class:`Swing`, between Python and the compiled steps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import cable_at
from cable_shape.checks import Array
from cable_shape.kernels.contact import swung
from cable_shape.kernels.network import momentum, motion, settle, swing_output, swing_run, swinging, tables
from cable_shape.kernels.network.momentum import ENERGY, KINETIC, PERIOD
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.settle import INFO
from cable_shape.kernels.network.tables import LENGTH, NOW, SOFTEST, SWINGS
from cable_shape.motion.among import Among, Lying, lay
from cable_shape.pose import FreeEnd
from cable_shape.shape import TOUCH
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.seen import Seen
from cable_shape.solve.settle import Settling

#: Default spectral radius at infinity of the steps in time: what a step cannot follow is gone after it.
RADIUS = 0.0
#: Elements of a cable, and the fewest of a span between two supports; how many boundary layers an element may be long,
#: and how many times sqrt(EI / GJ) of them where GJ, or EI across, is more than so many times EI; there are at most so
#: many elements.
ELEMENTS, FEWEST, LAYERS, BENT, STIFFER, MOST_ELEMENTS = 20, 4, 1.5, 3.0, 8.0, 400
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


class Load(NamedTuple):
    """What a network that swings has for mass, and on its free ends."""

    points: int  # of the shape of each cable
    cables: Sequence[Cable | None]  # of each cable of the network; None: one without mass
    masses: Sequence[tuple[float, float]]  # arc length on the first cable [m], and mass [kg]
    at_knots: Sequence[tuple[int, float]]  # knot, and mass [kg]
    tips: Sequence[tuple[int, FreeEnd, Array]]  # knot, what loads it, and what weighs there (3,) [m/s^2]


def load_of(problem: Problem) -> Load:
    """That of one cable."""
    end, knot = problem.end, len(problem.clips) + 1 - sum(clip.kind == "slide" for clip in problem.clips)
    masses = [(mass.arc_length, mass.mass) for mass in problem.masses]
    tips = [(knot, end, problem.end_fall)] if isinstance(end, FreeEnd) else []
    return Load(problem.points, [problem.cable], masses, [], tips)


class Made(NamedTuple):
    """Mass [kg] of the cable around each node and of what else is there, drag [N s/m], lever [m] of the mass (n,); and
    retardation time [s] of the elements (N,)."""

    mass: Array
    point: Array
    drag: Array
    lever: Array
    delay: Array


def made_of(plan: tables.Plan, model: tables.Model, load: Load) -> Made:
    """What a network is made of, besides what bends."""
    nodes = model.s.size
    made = Made(np.zeros(nodes), np.zeros(nodes), np.zeros(nodes), np.zeros(nodes), np.zeros(model.h.size))
    for c, cable in enumerate(load.cables):
        for e in range(plan.first[plan.cables[c]], plan.first[plan.cables[c + 1]]) if cable is not None else ():
            assert cable is not None
            node, h = plan.left[e], model.h[e]
            here = cable_at(cable, 0.5 * (model.s[node] + model.s[node + 1]))
            made.mass[node : node + 2] += 0.5 * here.linear_density * h
            made.drag[node : node + 2] += 0.5 * here.drag * h
            made.delay[e] = here.retardation_time
    masses, drags = made.mass.copy(), made.drag.copy()
    for j, (a, b) in enumerate(zip(plan.first[:-1], plan.first[1:], strict=True)):
        for end, inner, e in ((a + j, a + j + 1, a), (b + j, b + j - 1, b - 1)):
            made.lever[end] = (_INSIDE if inner > end else -_INSIDE) * model.h[e]
            for whole, before in ((made.mass, masses), (made.drag, drags)):
                whole[end] += 2.0 * _MORE * before[end]
                whole[inner] -= 2.0 * _MORE * before[end]
    for arc, mass in load.masses:
        made.point[np.abs(model.s - arc).argmin()] += mass
    for knot, mass in (*load.at_knots, *((knot, end.mass) for knot, end, _ in load.tips)):
        made.point[_node_at(plan, made.mass, knot)] += mass
    carried = made.mass > 0.0
    made.lever[carried] *= made.mass[carried] / (made.mass + made.point)[carried]
    made.lever[~carried] = 0.0
    return made


def _node_at(plan: tables.Plan, mass: Array, knot: int) -> int:
    """A node that is in a knot, of a cable that has mass where there is one."""
    first, ends = plan.first, plan.ends
    nodes = [first[j + i] + j for j in range(len(ends)) for i in range(2) if ends[j, i] == knot]
    return int(max(nodes, key=lambda node: mass[node]))


@final
class Swing:
    """A network with mass, on the mesh and from the shape at rest that `state` has; `alive` tells whether it is one.

    among: what makes the bodies of the problem known to it, and lets it come to rest among them. goes_on: not at rest,
    but as `lying` is, with its velocity.
    """

    def __init__(
        self,
        load: Load,
        state: Network,
        among: Callable[[Settling, Array], Among] | None = None,
        lying: Lying | None = None,
        radius: float = RADIUS,
        *,
        goes_on: bool = False,
    ) -> None:
        settling = Settling(state.ints, state.floats, state.sols, NOW, swings=True)
        self.points = load.points
        self.ints, self.floats, self.sols, self.work = settling.ints, settling.floats, settling.sols, settling.work
        self.moving, self.plan, self.model = settling.moving, settling.plan, settling.model
        self.motion: motion.Motion = settling.motion
        self.solution = settling.solution(NOW)  # the last one
        self.remembered = np.zeros(momentum.momentum_size.py_func(self.ints))
        self.memory: momentum.Momentum = momentum.momentum_of.py_func(self.ints, self.remembered)
        self.among = None if among is None else among(settling, self.remembered)
        if goes_on:
            assert lying is not None
            arcs, self.alive = lay(settling, lying), True
        elif self.among is None or lying is None:
            self.alive = settling.settle(tolerance=_AT_REST) or settling.at_rest(_NEAR_REST)
            self.motion.place[...] = settling.places  # not where a mode that might grow would have led it
        else:
            self.alive = self.among.rest(settling, self.memory, self.remembered, lying)
        whole = self.sols.size + self.remembered.size
        self.kept = np.empty(whole + (self.remembered.size if self.among is None else self.moving.size))
        self.info, self._scratch = np.zeros(swinging.INFO), np.zeros(INFO)
        self.told = np.zeros(2 * int(self.ints[tables.N_CABLES]))
        self.memory.par[momentum.RADIUS] = radius
        self.memory.rest[...], self.memory.section[...] = self.model.rest, self.model.section
        self._put_masses(load)
        if not goes_on:
            self._rest()
            return
        assert lying is not None
        self._move(*lying.moving(arcs))
        self.motion.place[...] = self.memory.place  # nothing has held the nodes yet

    def _move(self, rate: Array, slope: Array) -> None:
        """Has the nodes move (n, 3) [m/s] from where they are, slope (n, 3) [1/s] along the cable."""
        memory = self.memory
        memory.velocity[...] = rate
        self._rest()
        memory.turning[...] = slope - np.einsum("ij,ij->i", slope, memory.tangent)[:, None] * memory.tangent

    def accelerate_as(self, other: Swing) -> None:
        """Has the nodes accelerate as those of another mesh of one cable do."""
        mine, there = self.memory, other.memory
        for own, rows in ((mine.acceleration, there.acceleration), (mine.bending, there.bending)):
            for c in range(3):
                own[:, c] = np.interp(self.model.s, other.model.s, rows[:, c])

    def go_on_as(self, other: Swing) -> None:
        """Makes the state of another one of the same cables this one's, if mesh, masses and what is held are the same.

        What it touches is found anew.
        """
        pairs = (
            (self.ints, other.ints), (self.model.s, other.model.s), (self.model.h, other.model.h),
            (self.model.free, other.model.free), (self.memory.mass, other.memory.mass),
            (self.memory.point, other.memory.point),
        )  # fmt: skip
        if not all(np.array_equal(mine, there) for mine, there in pairs):
            return
        walls, props = self.motion.walls.copy(), self.motion.props.copy()
        for mine, there in (
            (self.floats, other.floats), (self.sols, other.sols), (self.moving, other.moving),
            (self.remembered, other.remembered),
        ):  # fmt: skip
            mine[...] = there
        self.motion.walls[...], self.motion.props[...] = walls, props
        self.motion.par[[motion.N_WALLED, motion.N_PROPS]] = 0.0

    def _put_masses(self, load: Load) -> None:
        """Mass, drag and damping of the cables and what they carry, at the nodes."""
        model, memory, moving = self.model, self.memory, self.motion
        made = made_of(self.plan, model, load)
        memory.mass[...], memory.point[...], memory.delay[...] = made.mass, made.point, made.delay
        moving.drag[...], moving.lever[...] = made.drag, made.lever
        self._tips = {knot: end.mass * fall + end.force for knot, end, fall in load.tips}
        memory.par[PERIOD] = (memory.mass.sum() + memory.point.sum()) * model.par[LENGTH] / model.par[SOFTEST]

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
        """Draws the nodes to a path by springs, and lets them move as it does; False if there is no way, and they stay.

        The springs are as stiff as the cable is in waves between the points. What they bend it by is let go in the
        first step.
        """
        memory, motion, s = self.memory, self.motion, self.model.s
        kept, aim = (self.sols.copy(), self.moving.copy(), self.remembered.copy()), seen.places(s)
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
        self.model.par[SWINGS] = 0.0  # nodes that are drawn together would buckle the elements between
        done = True
        for x in np.arange(1, stretches + 1) / stretches:
            motion.origin[...] = motion.aim[...] = begin + x * way
            code = settle.newton(
                self.ints, self.floats, self.sols, self.work, self.moving, np.inf, _MOST, _EASY, self._scratch
            )
            done = code == CONVERGED
            if not done:
                break
            self.sols[size : 2 * size] = self.sols[:size]
            self.sols[:size] = self.sols[2 * size :]
        self.model.par[SWINGS] = 1.0
        motion.kept[...] = motion.lam
        motion.lever[...] = levers
        self._move(seen.velocity(s), seen.velocity(s, 1))
        if not done:
            self.sols[...], self.moving[...], self.remembered[...] = kept
        return done

    def tell(self, out: Array, velocity: Array, points: int | None = None) -> None:
        """Fills `out` and velocity of the last shape, see `swing_output`, of so many points."""
        swing_output.tell(
            self.ints, self.floats, self.sols, self.work, self.moving, self.remembered, points or self.points, out,
            velocity, self.told,
        )  # fmt: skip

    def step(self, poses: Array, dt: float, out: Array, velocity: Array) -> bool:
        """One step dt [s] to the knots `poses` (k, 7); False, and nothing has changed, if it could not be taken."""
        among = self.among
        if among is None:
            code = swing_output.swing(
                self.ints, self.floats, self.sols, self.work, self.moving, self.remembered, poses, dt, self.kept,
                self.info, self._scratch, self.points, out, velocity, self.told,
            )  # fmt: skip
        else:
            code = swung.swing(
                self.ints, self.floats, self.sols, self.work, self.moving, self.remembered, poses, dt, self.kept,
                self.info, self._scratch, self.points, out, velocity, self.told, among.kernel, among.skin,
            )  # fmt: skip
        return bool(code == CONVERGED)

    def touches(self, cable: int = 0) -> Array:
        """(k, TOUCH), what bodies do to one of its cables, see `kernels.contact.check`."""
        if self.among is None:
            return np.empty((0, TOUCH))
        return self.among.touches(self.ints, self.floats, self.moving, self.remembered, cable)

    def deviation(self, touches: Array) -> float:
        """[m], how far the bodies of contacts (k, TOUCH) are at most off what they are in place of."""
        return 0.0 if self.among is None else self.among.bodies.deviation(touches)

    def run(self, goals: Array, steps: Array) -> tuple[Array, Array, Array, int]:
        """Steps (T,) [s] to the knots goals (T, k, 7), one after the other.

        Returns places, tangents and velocities (T, n, 3) of the nodes, and how many steps could not be taken.
        """
        told = np.empty((3, len(steps), len(self.model.s), 3))
        arrays = (
            self.ints, self.floats, self.sols, self.work, self.moving, self.remembered, goals, steps, self.kept,
            self.info, self._scratch, told[0], told[1], told[2],
        )  # fmt: skip
        among = self.among
        lost = swing_run.run(*arrays) if among is None else swung.run(*arrays, among.kernel, among.skin)
        return told[0], told[1], told[2], int(lost)

    @contextmanager
    def kept_as_it_is(self) -> Iterator[None]:
        """What is stepped meanwhile is forgotten."""
        state = [self.floats, self.sols, self.moving, self.remembered]
        if self.among is not None:
            state += self.among.state
        before = [array.copy() for array in state]
        yield
        for array, old in zip(state, before, strict=True):
            array[...] = old

    def load_end(self, end: FreeEnd, fall: Array, knot: int = -1) -> None:
        """Takes over what loads a free end, of the cable by default; fall (3,) [m/s^2]: of its plug."""
        knot = knot if knot >= 0 else len(self.model.force) - 1
        tip = end.mass * fall + end.force
        more = tip - self._tips[knot]
        self.model.force[knot] += more
        self.memory.par[ENERGY] -= more @ self.solution.pose[knot, :3]  # as `energy` counts it from now on
        self.model.moment[knot] = end.moment
        self._tips[knot] = tip

    @property
    def depth(self) -> float:
        """[m], how deep it is in a body between its nodes."""
        return float(self.motion.par[motion.DEPTH])

    @property
    def widest_turn(self) -> float:
        """[rad], by which an element beside what holds the cable turns from one end to the other at most."""
        first, q = self.plan.first, self.solution.q
        beside = np.concatenate((first[:-1], first[:-1] + 1, first[1:] - 2, first[1:] - 1))
        left = self.plan.left[beside]
        cosines = np.abs((q[left] * q[left + 1]).sum(axis=1))
        return float(2.0 * np.arccos(min(1.0, cosines.min())))

    @property
    def turns(self) -> int:
        """Windings of the end, counted from the start."""
        return int(self.solution.turns[0])

    @property
    def unrest(self) -> float:
        """[N], what inertia and drag take of all nodes between those held, in the last part of the last step."""
        motion = self.motion
        between = motion.lever == 0.0
        return float((motion.hold * np.linalg.norm(motion.place - motion.aim, axis=1))[between].sum())

    @property
    def energy(self) -> float:
        """[J], elastic energy less loads . places."""
        return float(self.memory.par[ENERGY])

    @property
    def kinetic_energy(self) -> float:
        """[J]."""
        return float(self.memory.par[KINETIC])
