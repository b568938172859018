"""The road of a cable in contact: where Newton's method finds no way, it moves against drag, in front of all bodies.

Every step in time is a minimum of energy and drag together (`solve.settle`), with the planes of near bodies as part
of it (`kernels.contact.guard`): contacts are no unknowns, and nothing has to be known of what touches what. At rest the
drag is gone, and the pushes that planes have are what the solver of contact starts from.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.contact import check, knots, lay
from cable_shape.kernels.contact.between import guard_between
from cable_shape.kernels.contact.guard import guard
from cable_shape.kernels.contact.near import (
    BARE,
    NORMAL,
    PRESS,
    RUB,
    SECOND,
    SECOND_NORMAL,
    SECOND_PRESS,
    SPOT,
    THIRD_NORMAL,
    THIRD_PRESS,
    TILT,
)
from cable_shape.kernels.network import props, tables
from cable_shape.kernels.network.motion import N_PROPS
from cable_shape.kernels.network.settle import I_EXCESS, I_FORCE, I_ITERATIONS
from cable_shape.kernels.network.tables import BEFORE, NOW, SOFTEST, TRIAL
from cable_shape.kernels.network.walls import BODY, KEPT, OUT, PUSHED, STIFF, WALL, WALLS
from cable_shape.solve.search import between
from cable_shape.solve.settle import Settling
from cable_shape.solve.touching.held_along import HeldAlong, pulls
from cable_shape.solve.touching.state import TouchState

#: Of the length: what a cable that does not stretch may seem to stretch by. It gives a little, for between two contacts
#: a straight piece could not give otherwise: by 3.5e-5 under a tension of 35 times its weight, which leaves it as much
#: sag. From there on what it is stretched by is what it lacks.
TAUT = 1e-4
#: [m] bodies nearer than this to a node have a plane there. So they have at a point of an element that is nearer than
#: both of its nodes, by this part of the length.
REACH, NEARER = 0.05, 1e-4
#: Of weight times length: energy that a step may make, pushed out of planes that turn, and what it has to lose at least
#: to lead on.
_NONE, _LOWER = 1e-3, 1e-4
#: So much of what planes have let in, pushes times depths, may be energy again in the next step.
_OUT_AGAIN = 3.0
#: Of the cable's radius: so deep a step may leave it in a body between nodes, or it was deeper before.
DEEP = 0.3
#: Stiffness of planes, in that of the elements beside them against bending, EI / h^3, of which none counts as shorter
#: than this part of the mean.
_FIRM, _FINEST = 100.0, 0.05
#: Steps in time, in units of `Settling.unit`: the longest one, and the shortest one before the way is cut.
_LONGEST, _EASY, _SHORTEST = 30.0, 0.1, 1e-7
_LONGER, _SHORTER, _CEILING, _EASIER = 8.0, 0.2, 0.3, 2.0
_ITERATIONS = 60  #: of a step
_MOST, _FEWER = 300, 120  #: steps that are tried, and where an equilibrium is near
#: Of a step's way: a cable that goes back by as much in the next one goes to and fro, for planes turn as it does, or
#: what rubs changes its mind. After so many times it is at rest, if it goes no further than `TAUT`.
_TO_AND_FRO, _TURNS = 0.5, 8
#: A cable that goes more than so many times as far as what holds and pushes it, and that part of its length, snaps.
_FAR, _LITTLE = 10.0, 2e-3
#: Cosine of the angle by which a plane that pushes may turn in a step.
_TURNED = 0.9
#: What drag may still take at a node, of the largest force.
_AT_REST = 1e-7
#: A step is taken again until limits of friction are off by less than this, of the largest, and so often at most.
_LAWFUL, _LIMITS = 1e-3, 8
#: [m] nodes that are pressed are nearer to their planes than this.
_CLOSED = 2e-8
#: The same of a cable that is too short, of its length, and how much stiffer its planes become until then.
_NEARLY, _STIFFER = 1e-6, 4.0


def led_by(state: TouchState, frames: Array) -> float:
    """[m], how far supports go from the last solution to `frames` (k, 7), and bodies to where they are."""
    bodies = state.bodies
    way = float(np.linalg.norm(frames[:, :3] - state.grips[NOW][:, :3], axis=1).max())
    return way + float(np.abs(bodies.frames - bodies.frames_then).max(initial=0.0))


def is_far(before: Array, after: Array, led: float, length: float) -> bool:
    """Whether places (n, 3) [m] of a cable of this length [m] have gone much further than it was led."""
    return bool(np.linalg.norm(after - before, axis=1).max() > _FAR * led + _LITTLE * length)


@final
class Road:
    """The last solution of a cable in contact, with drag.

    links (k, 7): where the links that carry bodies are to be. out_of_time: whether to give up.
    """

    def __init__(self, state: TouchState, links: Array, out_of_time: Callable[[], bool]) -> None:
        self.state, self.links, self.out_of_time = state, links, out_of_time
        self.taken = self.iterations = 0
        self.gap = self._let_in = 0.0
        self._begin()
        self.began = self.places.copy()

    def _begin(self) -> None:
        """Takes over the last solution, on its mesh."""
        state = self.state
        lying, net = state.lying, state.net
        near, on = state.near[NOW], state.on[NOW]
        bare = np.full_like(on, BARE)
        if not lay.laid(net, lying, bare):
            knots.place_nodes(net, lying.s)
        knots.put(net, lying, NOW, near, NORMAL)
        size = 3 * int(tables.solution_size.py_func(net.ints))
        self.settling = settling = Settling(net.ints, net.floats, net.sols[:size], TRIAL)
        self.rows = np.concatenate([np.arange(a, b + 1) for a, b in self.runs])  # which of the state's nodes they are
        for j, (a, b) in enumerate(self.runs):
            pull = settling.solution(NOW).lam[j].copy()
            first = settling.plan.first[j]
            for k in range(b - 1, a - 1, -1):
                settling.motion.lam[first + k - a] = pull
                if k > a and on[k, 0] != BARE:
                    pull = pull + near[k, PRESS] * near[k, NORMAL : NORMAL + 3] + near[k, RUB : RUB + 3]
                    pull = pull + near[k, SECOND_PRESS] * near[k, SECOND_NORMAL : SECOND_NORMAL + 3]
                    pull = pull + near[k, THIRD_PRESS] * near[k, THIRD_NORMAL : THIRD_NORMAL + 3]
        settling.motion.kept[...] = settling.motion.lam
        known = near[self.rows, SPOT : SPOT + 3].any(axis=1)  # nodes are new where the mesh is finer than it was
        off, s = near[self.rows[known], SPOT : SPOT + 3] - self.places[known], settling.model.s
        for c in range(3 if known.any() else 0):
            settling.motion.origin[:, c] += np.interp(s, s[known], off[:, c])
        settling.motion.place[...] = settling.motion.origin
        self._arcs = state.nodes[self.rows]
        self.thick = state.thick[self.rows].copy()
        self._rubs = state.rubs and state.has_friction
        self._pressed = pressed_by(near[self.rows], on[self.rows])
        least = state.weight + float(settling.model.par[SOFTEST])
        rough = state.rough[self.rows], state.bodies.rough
        self.along = HeldAlong(near[self.rows], state.s[self.rows], *rough, least, state.length)
        self.wholes = np.full(self.rows.size, state.length)
        around = np.gradient(settling.model.s)
        self.stiff = _FIRM * state.bend / np.maximum(around, _FINEST * around.mean()) ** 3
        state.unfactored()

    @property
    def runs(self) -> list[tuple[int, int]]:
        """First and last of the state's nodes of each span."""
        held = self.state.held.tolist()
        return list(pairwise(held))

    @property
    def places(self) -> Array:
        """(n, 3) [m], of the network's nodes."""
        return self.settling.motion.origin

    def go(self, frames: Array, most: int) -> bool:
        """To rest between the supports `frames` and with the bodies at `links`; False where no way leads on.

        Or after so many steps that lead nowhere while bodies push the cable between nodes: see `pressed`.
        """
        state, settling, bodies = self.state, self.settling, self.state.bodies
        origin, links = state.grips[NOW].copy(), bodies.links_then
        self._then = bodies.frames_then
        self.led = led_by(state, frames)
        self.moved = not np.array_equal(origin, frames) or not np.array_equal(links, self.links)
        turns, low, was, way = 0, settling.energy, self.places.copy(), np.zeros_like(self.places)
        done, part = (0.0, 1.0) if self.moved else (1.0, 1.0)
        whole = longest = dt = _LONGEST * settling.unit
        shortest = _SHORTEST * settling.unit / max(1.0, state.pull)  # what a taut cable does, it does so much faster
        for _ in range(_FEWER if state.hasty else _MOST):
            if self.out_of_time():
                return False
            at = min(1.0, done + part)
            state.move_bodies(between(links, self.links, at))
            settling.poses[...] = between(origin, frames, at)
            if self._step(dt, at - done):
                self.taken += 1
                if settling.energy < low - _LOWER * state.weight * state.length:
                    low = settling.energy
                elif self.pressed.size:
                    most -= 1
                if most < 0:
                    return False
                done, part = at, _LONGER * part
                if at == 1.0 and settling.at_rest(_AT_REST):
                    taut = self.taut
                    if self.gap < (_NEARLY * state.length if taut else _CLOSED):
                        return True
                    self.stiff *= _STIFFER if taut else 1.0
                way, back = self.places - was, way
                if done == 1.0 and float((way * back).sum()) < -_TO_AND_FRO * float((back * back).sum()):
                    turns += 1
                    if turns == _TURNS and np.abs(way).max() < TAUT * state.length:
                        return True
                    turns %= _TURNS
                was = self.places.copy()
                dt, longest = min(_LONGER * dt, longest), min(_EASIER * longest, whole)
                continue
            longest = dt * _CEILING
            if settling.info[I_EXCESS] < 0.0:  # rounding: next to what a plane holds the nodes go too easily
                whole = longest
            dt *= _SHORTER
            if dt < _EASY * settling.unit:  # what hardly moves would be crushed at the grips
                part = min(part, 1.0 - done) * _SHORTER if done < 1.0 else part
            if dt < shortest:
                return False
        return False

    def _step(self, dt: float, part: float) -> bool:
        """One step in time [s] that passes nothing, with `part` of the way of supports and bodies.

        It makes no energy but what these do.
        """
        settling, motion, bodies = self.settling, self.settling.motion, self.state.bodies
        start, origin, then, energy = self._changes(), motion.origin.copy(), self._then, settling.energy
        let_in = self._let_in
        clear, _, deep = self._guard()
        done = self._rub(dt) if self._rubs else settling.step(dt, most=_ITERATIONS)
        self.iterations += int(settling.info[I_ITERATIONS])
        if done:
            self._told()
            way = np.linalg.norm(motion.origin - origin, axis=1).max()
            done = way <= clear and not self._passes(origin, then)
            allowed = _OUT_AGAIN * abs(let_in) + self._work(part * self.led + max(0.0, -deep))
            done = done and settling.energy <= energy + allowed
        if done:
            _, cosine, deeper = self._guard()
            done = cosine > _TURNED and deeper > min(deep, -DEEP * self.state.radius)
        if not done:
            self._take_back(start)
            settling.energy = energy
            return False
        self._then = bodies.frames.copy()
        return True

    def _work(self, way: float) -> float:
        """[J], what supports and bodies may do on so much of their way [m], or to the cable that is so deep in them."""
        force = float(self.settling.info[I_FORCE]) + self.pushes()[1].sum()
        return float(way * force + _NONE * self.state.weight * self.state.length)

    def _changes(self) -> list[Array]:
        """What a step changes, for `_take_back`."""
        return [a.copy() for a in self._changing]

    def _take_back(self, start: list[Array]) -> None:
        """Makes it what it was."""
        for array, then in zip(self._changing, start, strict=True):
            array[...] = then

    @property
    def _changing(self) -> tuple[Array, ...]:
        motion = self.settling.motion
        return self.settling.sols, motion.kept, motion.origin, motion.walls, motion.par, motion.props

    def _rub(self, dt: float) -> bool:
        """One step in time with friction, whose limits are those of the pushes after it."""
        settling, motion, frames = self.settling, self.settling.motion, self.state.bodies.frames
        start = self._changes()
        (body, push, normal), tangents = self.pushes() if self.taken else self._pressed, self._tangents
        self.along.begin(body, push)
        self.along.tell(motion.rough, push, normal, frames, tangents)
        for i in range(_LIMITS):
            if not settling.step(dt, most=_ITERATIONS):
                return False
            off = self.along.follow(*self.pushes()[:2])
            if off < _LAWFUL or i == _LIMITS - 1:
                break
            self._take_back(start)
            self.along.tell(motion.rough, push, normal, frames, tangents)
        return True

    def _guard(self) -> tuple[float, float, float]:
        """Planes where the nodes are, see `guard`, and between them, see `guard_between`; the gap is that there."""
        settling, bodies = self.settling, self.state.bodies
        kernel = bodies.kernel._replace(then=bodies.frames)
        net, of_cable = (settling.ints, settling.floats), (kernel, self.thick, self.wholes, REACH)
        clear, cosine = guard(*net, settling.moving, *of_cable, self.stiff)
        between, turned, gap = guard_between(*net, settling.sols, settling.moving, *of_cable, NEARER)
        return min(float(clear), float(between)), min(float(cosine), float(turned)), float(gap)

    def _passes(self, before: Array, then: Array) -> bool:
        """Whether a node, or the middle of an element, may have come past a body."""
        state, bodies = self.state, self.state.bodies
        s = self.settling.model.s
        arcs = np.empty(2 * s.size - 1)
        arcs[::2], arcs[1::2] = s, 0.5 * (s[1:] + s[:-1])
        found: bool = check.passes(
            arcs, _with_middles(before), _with_middles(self.places), bodies.table, bodies.frames, then,
            bodies.triangles, bodies.tree, state.radius, bodies.stack,
        )  # fmt: skip
        return found

    def pushes(self) -> tuple[Array, Array, Array]:
        """The two bodies that push each of the network's nodes most (n, 2), how hard [N], and normals (n, 2, 3).

        With friction that on which the node was comes first.
        """
        walls = self.settling.motion.walls
        rows = walls[:, 1:].reshape(-1, WALLS, WALL)
        there = np.arange(WALLS) < walls[:, :1]
        push = np.where(there, rows[:, :, PUSHED], 0.0)
        known = (rows[:, :, BODY] == self.along.mate[:, None]) & (push > 0.0) if self._rubs else False
        k = np.argsort(np.where(known, -np.inf, -push), axis=1, kind="stable")[:, :2]
        at = np.arange(len(k))[:, None]
        return rows[at, k, BODY], push[at, k], rows[at, k, OUT : OUT + 3]

    def _told(self) -> None:
        """Remembers how deep nodes are in the planes that push them [m], and pushes times that [J]."""
        walls = self.settling.motion.walls
        rows = walls[:, 1:].reshape(-1, WALLS, WALL)[np.arange(WALLS) < walls[:, :1]]
        rows = rows[rows[:, PUSHED] > 0.0]
        gaps = (rows[:, PUSHED] - rows[:, KEPT]) / rows[:, STIFF]
        self.gap, self._let_in = float(np.abs(gaps).max(initial=0.0)), float((rows[:, PUSHED] * gaps).sum())

    @property
    def pressed(self) -> Array:
        """Arc lengths [m] of the points between nodes that bodies push."""
        points = self.settling.motion.props[: int(self.settling.motion.par[N_PROPS])]
        points = points[points[:, props.PUSH] > 0.0]
        first = self.settling.plan.left[points[:, props.ELEMENT].astype(int)]
        s = self._arcs
        return np.asarray(s[first] + points[:, props.SHARE] * (s[first + 1] - s[first]))

    @property
    def far(self) -> bool:
        """Whether the cable has gone much further than what holds and pushes it."""
        return is_far(self.began, self.places, self.led, self.state.length)

    @property
    def taut(self) -> bool:
        """Whether a cable that does not stretch is too short for its way past the bodies.

        In all of its stretches, where it could run from one into the next; whose end a force pulls is not too short.
        """
        state = self.state
        if state.stretches or state.chains[-1].free[1]:
            return False
        if self.missing <= TAUT * state.length:
            return False
        h, first = self.settling.model.h, self.settling.plan.first[:-1]
        means = np.add.reduceat(self._tension * h, first) / np.add.reduceat(h, first)
        return not state.rings.size or bool(means.min() * state.stretch > TAUT)

    @property
    def _tangents(self) -> Array:
        """(n, 3) of the nodes."""
        x, y, z, w = self.settling.solution(NOW).q.T
        return np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)

    @property
    def _tension(self) -> Array:
        """(N,) [N], of the elements."""
        settling = self.settling
        force = settling.motion.load[:, 3:6] + settling.motion.lam
        q = settling.solution(NOW).q
        middles = q[settling.plan.left] + q[settling.plan.left + 1]
        x, y, z, w = (middles / np.linalg.norm(middles, axis=1, keepdims=True)).T
        along = np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
        return np.asarray((force * along).sum(axis=1))

    @property
    def missing(self) -> float:
        """[m], by how much a cable that does not stretch is stretched, and let into the planes, by its tension."""
        h = self.settling.model.h
        mean = float((self._tension * h).sum() / h.sum())
        if mean <= 0.0:
            return 0.0
        return mean * self.state.length * self.state.stretch + self._let_in / mean

    def hand_over(self) -> None:
        """Makes the shape at rest the last solution, and what was that the one before it."""
        state, settling = self.state, self.settling
        if self.moved:
            for array in (state.q, state.near, state.on, state.ends, state.grips, state.turns, state.slid):
                array[BEFORE] = array[NOW]
        now = settling.solution(NOW)
        body, push, normal = self.pushes()
        rubbed = pulls(settling.motion.rough, self.places)
        q, near, on = state.q[NOW], state.near[NOW], state.on[NOW]
        on[:, :2] = on[:, SECOND:] = BARE
        near[:, [PRESS, SECOND_PRESS, THIRD_PRESS]] = 0.0
        near[:, RUB : RUB + 3] = near[:, TILT : TILT + 3] = 0.0
        for row, k in enumerate(self.rows):
            q[k] = now.q[row]
            near[k, SPOT : SPOT + 3] = self.places[row]
            if push[row, 0] > 0.0:
                on[k, :2] = int(body[row, 0])
                near[k, PRESS], near[k, NORMAL : NORMAL + 3] = push[row, 0], normal[row, 0]
                near[k, RUB : RUB + 3] = rubbed[row]
            if push[row, 1] > 0.0:
                on[k, SECOND] = int(body[row, 1])
                near[k, SECOND_PRESS], near[k, SECOND_NORMAL : SECOND_NORMAL + 3] = push[row, 1], normal[row, 1]
        for j in range(len(self.runs)):
            state.ends[NOW, j] = settling.motion.lam[settling.plan.first[j + 1] - 1]
        state.grips[NOW], state.turns[NOW] = now.pose, now.turns
        state.history, state.untidy = 1, False
        arcs = np.linspace(0.0, state.length, state.problem.points)
        s = settling.model.s
        state.remember(np.stack([np.interp(arcs, s, column) for column in self.places.T], axis=1))
        state.unfactored()


def pressed_by(near: Array, on: Array) -> tuple[Array, Array, Array]:
    """`Road.pushes`, of rows of a solution."""
    body = on[:, [0, SECOND]].astype(float)
    push = np.where(body != BARE, near[:, [PRESS, SECOND_PRESS]], 0.0)
    normal = np.stack((near[:, NORMAL : NORMAL + 3], near[:, SECOND_NORMAL : SECOND_NORMAL + 3]), axis=1)
    return body, push, normal


def _with_middles(rows: Array) -> Array:
    """(2 n - 1, 3), rows and their means in between."""
    out = np.empty((2 * len(rows) - 1, 3))
    out[::2], out[1::2] = rows, 0.5 * (rows[1:] + rows[:-1])
    return out
