"""How a motion answers what holds it and what it is made of, carried along with its steps: :class:`Tangents`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.contact import held, swung_tangent
from cable_shape.kernels.network import swing_tangent, tables
from cable_shape.kernels.network.motion import PROPS, ROWS
from cable_shape.kernels.network.swinging import INFO
from cable_shape.kernels.network.walls import WALLS
from cable_shape.motion.run import Derivative, Run, weights
from cable_shape.motion.swing import Load, Swing, made_of
from cable_shape.pose import FreeEnd, Grip
from cable_shape.solve.answers import NUMBERS as AT_REST
from cable_shape.solve.answers import pair_of

#: Numbers of a cable that the derivative of a motion may be by, and what makes the rate of a grip of its pose.
NUMBERS = (*AT_REST, "retardation_time", "drag")
RATE = "velocity:"
#: [s], of a cable without retardation time: less is felt by nothing.
_QUICK = 1e-12


#: Two cables above and below, half by how much of a unit, and of how many units tangents are carried along.
Pair = tuple[tuple[Cable, Cable], float, float]


class Number(NamedTuple):
    """A number of a cable, or segment, that changes: two models (size,) and loads, `step` of it above and below."""

    models: Array
    loads: tuple[Load, Load]
    step: float
    scale: float  # of which tangents are carried along


def number_of(cable: Cable, kind: str) -> Pair:
    """Two cables that differ in one of NUMBERS, half by how much, and its scale."""
    cables, step = pair_of(cable, kind)
    value = cable.mean_bending_stiffness if kind == "bending_stiffness" else float(getattr(cable, kind))
    return cables, step, value if value > 0.0 else 1.0


def check_begun(seen: bool) -> None:
    """Refuses to carry tangents along from where they are not known."""
    if seen:
        bound = "a motion that begins as it is seen knows no derivatives of how it began"
        raise ArgumentError.of("by", "names", bound, "Begin at rest, without points.")


def traced(tangents: Tangents | None) -> Tangents:
    """The tangents that a motion has; refused where there are none."""
    if tangents is None:
        raise ArgumentError("sensitivity() needs names, and there are none. Begin with by=('start',), for example.")
    return tangents


@final
class Ways:
    """How poses move in the columns of `names`: those of poses and of their rates have 6 each, the others one.

    knots: those of the poses that names may say. ends: tells what is held, and where, at the last step.
    """

    def __init__(
        self, names: Sequence[str], knots: Mapping[str, int], count: int,
        ends: Callable[[], Mapping[str, Grip | FreeEnd]], about_gripper: bool,
    ) -> None:  # fmt: skip
        self._ends, self._about_gripper = ends, about_gripper
        self.at: dict[str, int] = {}  # the column of each number
        columns = 0
        for name in names:
            self.at[name] = columns
            columns += 6 if name.removeprefix(RATE) in knots else 1
        self._offset, self._rate = np.zeros((columns, count, 6)), np.zeros((columns, count, 6))
        self._held = {name: knot for name, knot in knots.items() if isinstance(ends().get(name), Grip)}
        for name, column in self.at.items():
            pose = name.removeprefix(RATE)
            if pose in knots and not isinstance(ends().get(pose), FreeEnd):
                rows = self._rate if name.startswith(RATE) else self._offset
                rows[column : column + 6, knots[pose]] = np.eye(6)

    def __call__(self, time: float) -> Array:
        """(p, k, 6): how the knots move, about the cable's ends, that time [s] after the beginning."""
        twists = self._offset + time * self._rate
        for name, knot in self._held.items() if self._about_gripper else ():
            end = self._ends()[name]
            if isinstance(end, Grip):
                arm = end.cable_frame.position - end.pose.position
                twists[:, knot, :3] += np.cross(twists[:, knot, 3:], arm)
        return np.asarray(twists)


@final
class Tangents:
    """The tangents of a motion at rest: p columns, along which numbers change, and knots as `moves` tells.

    numbers: by column. moves: (p, k, 6) of the time [s] since, see `Ways`.
    """

    def __init__(self, swing: Swing, numbers: Mapping[int, Number], moves: Callable[[float], Array]) -> None:
        self._swing, self._moves, self._time = swing, moves, 0.0
        moved = (moves(0.0) != 0.0).any(axis=(1, 2)) | (moves(1.0) != 0.0).any(axis=(1, 2))
        self._columns = moved.size
        self._told = np.union1d(np.flatnonzero(moved), list(numbers)).astype(np.int64)  # those that are not zero
        count = self._told.size
        self._flat = np.zeros((count, swing_tangent.tangent_size.py_func(swing.ints)))
        self._scale = np.ones(count)
        self._longer: list[tuple[int, Array, float]] = []  # column, arc lengths of the nodes above and below, 2 step
        for row, column in enumerate(self._told.tolist()):
            if column in numbers:
                self._put_number(row, numbers[column])
        self.breaks, self._met = 0, swing.among is not None and swing.among.met
        self._room = _room(swing)
        self._twists = self._move()
        arrays = (
            swing.ints, swing.floats, swing.sols, swing.work, swing.moving, swing.remembered, self._flat, self._twists,
            self._room,
        )  # fmt: skip
        if swing.among is None:
            swing_tangent.begin(*arrays)
        else:
            self._felt, self._aside = _room_among(swing, count)
            swung_tangent.begin(*arrays, swing.among.kernel, swing.among.skin, self._felt, self._aside)

    def _put_number(self, row: int, number: Number) -> None:
        """What of the network changes with a number."""
        swing = self._swing
        above, below = (tables.model_of.py_func(swing.ints, flat) for flat in number.models)
        more, less = (
            made_of(swing.plan, model, load) for model, load in zip((above, below), number.loads, strict=True)
        )
        by = 0.5 * number.scale / number.step
        t: swing_tangent.Tangent = swing_tangent.tangent_of.py_func(swing.ints, self._flat[row])
        for own in ("mass", "drag", "lever", "delay"):
            getattr(t, own)[...] = by * (getattr(more, own) - getattr(less, own))
        for own in ("rest", "section", "load", "weight", "h"):
            getattr(t, own)[...] = by * (getattr(above, own) - getattr(below, own))
        self._scale[row] = number.scale
        if t.delay.any():
            np.maximum(swing.memory.delay, _QUICK, out=swing.memory.delay)
        if (above.s != below.s).any():
            self._longer.append((row, np.stack((above.s, below.s)), 2.0 * number.step))

    def _move(self) -> Array:
        """(p, k, 6): how the knots move now."""
        return np.ascontiguousarray(self._moves(self._time)[self._told])

    def follow(self, goal: Array, dt: float) -> None:
        """Goes along with the step that the motion has just taken."""
        swing = self._swing
        self._time += dt
        before, self._twists = self._twists, self._move()
        arrays = (
            swing.ints, swing.floats, swing.sols, swing.work, swing.moving, swing.remembered, goal, dt, swing.kept,
            swing.info, swing._scratch, self._flat, before, self._twists, self._room,
        )  # fmt: skip
        among = swing.among
        if among is None:
            swing_tangent.follow(*arrays)
        else:
            self.breaks += swung_tangent.follow(*arrays, among.kernel, among.skin, self._felt, self._aside)
            self._met = self._met or among.met

    def run(self, goals: Array, steps: Array, moves: Array) -> Run:
        """:meth:`Swing.run` with tangents; moves (T, k, 6, m): of the knots, m columns more that begin with it."""
        swing, extra = self._swing, moves.shape[3]
        flat = np.concatenate((self._flat, np.zeros((extra, self._flat.shape[1]))))
        twists = np.zeros((len(steps), len(flat), *self._twists.shape[1:]))
        for there, dt, more in zip(twists, steps.tolist(), np.moveaxis(moves, 3, 1), strict=True):
            self._time += dt
            there[: len(self._flat)], there[len(self._flat) :] = self._move(), more
        begun = np.concatenate((self._twists, np.zeros((extra, *self._twists.shape[1:]))))
        told = np.empty((3, len(steps), len(swing.model.s), 3))
        found = np.empty((3, *told.shape[1:], len(flat)))
        every = np.zeros((3, *told.shape[1:], self._columns + extra))
        at = np.concatenate((self._told, self._columns + np.arange(extra)))
        arrays = (
            swing.ints, swing.floats, swing.sols, swing.work, swing.moving, swing.remembered, goals, steps, swing.kept,
            swing.info, swing._scratch, told[0], told[1], told[2], flat, begun, twists, self._room, found[0], found[1],
            found[2],
        )  # fmt: skip
        if swing.among is None:
            lost = swing_tangent.run(*arrays)
        else:
            felt = held.Felt(*(np.concatenate((a, np.zeros((extra, *a.shape[1:])))) for a in self._felt))
            lost = swung_tangent.run(*arrays, swing.among.kernel, swing.among.skin, felt, self._aside)
            self._met = self._met or swing.among.met
            self._check_met()
        every[..., at] = found / np.concatenate((self._scale, np.ones(extra)))
        longer = np.zeros((len(swing.model.s), every.shape[-1]))
        for row, s, apart in self._longer:
            longer[:, self._told[row]] = (s[0] - s[1]) / apart
        s = swing.model.s.copy()
        return Run(
            s,
            told[0],
            told[1],
            told[2],
            int(lost),
            Derivative(s, told[0], told[1], every[0], every[1], every[2], longer),
        )

    def _check_met(self) -> None:
        """Refuses to tell what is not known."""
        if self._met:
            bound = "of a motion in which cables press on each other, or on themselves, there are none"
            raise ArgumentError.of("derivatives", "asked for", bound, "Take the difference of two motions.")

    def columns(self, rates: bool = False) -> Array:
        """(c points, 3, p): change of the points of the network's cables, or their velocities, a unit of each number.

        Points keep their share of the length.

        Raises
        ------
        ArgumentError
            Where cables have pressed on each other, or on themselves: how they answer then is not carried along.
        """
        self._check_met()
        swing, memory = self._swing, self._swing.memory
        ways = ("velocity", "turning") if rates else ("place", "tangent")
        places, tangents = _weights(swing, swing.model.s)
        moves = [swing_tangent.tangent_of.py_func(swing.ints, flat) for flat in self._flat]
        out = np.zeros((len(places), 3, self._columns))
        for column, t, scale in zip(self._told.tolist(), moves, self._scale.tolist(), strict=True):
            out[:, :, column] = (places @ getattr(t, ways[0]) + tangents @ getattr(t, ways[1])) / scale
        for row, s, apart in self._longer:
            above, below = _weights(swing, s[0]), _weights(swing, s[1])
            for i, nodes in enumerate(ways):
                out[:, :, self._told[row]] += (above[i] - below[i]) / apart @ getattr(memory, nodes)
        return out


def _weights(swing: Swing, s: Array) -> tuple[Array, Array]:
    """(c points, n) each: of the places and tangents of the nodes in the points of all cables, nodes at s (n,) [m]."""
    plan, points = swing.plan, swing.points
    out = np.zeros((2, points * (len(plan.cables) - 1), s.size))
    for c, (a, b) in enumerate(pairwise(plan.cables)):
        nodes = slice(plan.first[a] + a, plan.first[b] + b)
        rows = slice(points * c, points * (c + 1))
        out[:, rows, nodes] = weights(s[nodes], np.linspace(0.0, s[nodes][-1], points))
    return out[0], out[1]


def _room(swing: Swing) -> swing_tangent.Beside:
    """For a network beside."""
    ints = swing.ints
    elements, spans, knots = (int(x) for x in ints[:3])
    nodes = elements + spans
    return swing_tangent.Beside(
        swing.floats.copy(), swing.sols.copy(), np.zeros_like(swing.work), np.zeros_like(swing.moving),
        np.zeros_like(swing.remembered), np.zeros(max(swing.remembered.size, nodes)),
        np.zeros((nodes + elements + 2 * spans + knots, 3)), np.zeros((nodes, 3)), np.zeros((nodes, 3)),
        np.zeros((elements, 6)),
    )  # fmt: skip


def _room_among(swing: Swing, count: int) -> tuple[held.Felt, swung_tangent.Aside]:
    """For what bodies have to do with, of so many tangents, and for what they do to a network beside."""
    assert swing.among is not None
    skin, nodes = swing.among.skin, swing.model.s.size
    felt = held.Felt(
        np.zeros((count, nodes * WALLS, 3)), np.zeros((count, PROPS, 3)), np.zeros((count, nodes, 3)),
        np.zeros((count, PROPS, 3)),
    )  # fmt: skip
    aside = swung_tangent.Aside(
        np.zeros_like(skin.kept), skin.rings.copy(), np.zeros(INFO), np.zeros((ROWS, ROWS + 2)), np.zeros(ROWS),
        np.zeros(swing_tangent.tangent_size.py_func(swing.ints)), np.zeros((nodes * WALLS, 3)), np.zeros((PROPS, 3)),
        np.zeros((nodes, 3)),
    )  # fmt: skip
    return felt, aside
