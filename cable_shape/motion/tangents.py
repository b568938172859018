"""How a motion answers what holds it and what it is made of, carried along with its steps: :class:`Tangents`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.network import swing_tangent, tables
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


class Number(NamedTuple):
    """A number of a cable, or segment, that changes: two models (size,) and loads, `step` of it above and below."""

    models: Array
    loads: tuple[Load, Load]
    step: float
    scale: float  # of which tangents are carried along


def number_of(cable: Cable, kind: str) -> tuple[tuple[Cable, Cable], float, float]:
    """Two cables that differ in one of NUMBERS, half by how much, and its scale."""
    cables, step = pair_of(cable, kind)
    value = cable.mean_bending_stiffness if kind == "bending_stiffness" else float(getattr(cable, kind))
    return cables, step, value if value > 0.0 else 1.0


def check_free(swing: Swing, seen: bool) -> None:
    """Refuses what no tangents go through."""
    if swing.among is not None:
        bound = "a motion in contact, or in eyelets, knows no derivatives: what touches changes from step to step"
        raise ArgumentError.of("by", "names", bound, "Leave it out, or write contact='warn'.")
    if seen:
        bound = "a motion that begins as it is seen knows no derivatives of how it began"
        raise ArgumentError.of("by", "names", bound, "Begin at rest, without points.")


def traced(tangents: Tangents | None) -> Tangents:
    """The tangents that a motion has; refused where there are none."""
    if tangents is None:
        raise ArgumentError("sensitivity() needs names, and there are none. Begin with by=('start',), for example.")
    return tangents


@final
class Tangents:
    """The tangents of a motion at rest: columns of `names` in turn, those of poses and their rates 6 each.

    knots: those of the poses that names may say. numbers: what the other names say.
    """

    def __init__(
        self, swing: Swing, names: Sequence[str], knots: Mapping[str, int], numbers: Mapping[str, Number],
        ends: Mapping[str, Grip | FreeEnd], about_gripper: bool,
    ) -> None:  # fmt: skip
        self.names, self._swing, self._about_gripper = tuple(names), swing, about_gripper
        free = {name for name in names if isinstance(ends.get(name.removeprefix(RATE)), FreeEnd)}
        wide = np.repeat([name not in free for name in names], [1 if name in numbers else 6 for name in names])
        self._told: Any = np.flatnonzero(wide)  # columns that are not zero
        self._columns, count = wide.size, self._told.size
        k, size = int(swing.ints[tables.N_KNOTS]), swing_tangent.tangent_size.py_func(swing.ints)
        self.flat = np.zeros((count, size))
        self.scale = np.ones(count)
        self._offset, self._rate = np.zeros((count, k, 6)), np.zeros((count, k, 6))
        self._ends = {name: knot for name, knot in knots.items() if name in ends}
        self._longer: list[tuple[int, Array, float]] = []  # column, arc lengths of the nodes above and below, 2 step
        column = 0
        for name in (name for name in names if name not in free):
            if name in numbers:
                self._put_number(column, numbers[name])
                column += 1
                continue
            rows = self._rate if name.startswith(RATE) else self._offset
            rows[column : column + 6, knots[name.removeprefix(RATE)]] = np.eye(6)
            column += 6
        self._time = 0.0
        self._room = _room(swing)
        self._twists = self._move(ends)
        swing_tangent.begin(
            swing.ints, swing.floats, swing.sols, swing.work, swing.moving, swing.remembered, self.flat, self._twists,
            self._room,
        )  # fmt: skip

    def _put_number(self, column: int, number: Number) -> None:
        """What of the network changes with a number."""
        swing = self._swing
        above, below = (tables.model_of.py_func(swing.ints, flat) for flat in number.models)
        more, less = (
            made_of(swing.plan, model, load) for model, load in zip((above, below), number.loads, strict=True)
        )
        by = 0.5 * number.scale / number.step
        t: swing_tangent.Tangent = swing_tangent.tangent_of.py_func(swing.ints, self.flat[column])
        for own in ("mass", "drag", "lever", "delay"):
            getattr(t, own)[...] = by * (getattr(more, own) - getattr(less, own))
        for own in ("rest", "section", "load", "weight", "h"):
            getattr(t, own)[...] = by * (getattr(above, own) - getattr(below, own))
        self.scale[column] = number.scale
        if t.delay.any():
            np.maximum(swing.memory.delay, _QUICK, out=swing.memory.delay)
        if (above.s != below.s).any():
            self._longer.append((column, np.stack((above.s, below.s)), 2.0 * number.step))

    def _move(self, ends: Mapping[str, Grip | FreeEnd]) -> Array:
        """(p, k, 6): how the knots move now, about the cable's ends."""
        twists = self._offset + self._time * self._rate
        for name, knot in self._ends.items() if self._about_gripper else ():
            end = ends[name]
            if isinstance(end, Grip):
                arm = end.cable_frame.position - end.pose.position
                twists[:, knot, :3] += np.cross(twists[:, knot, 3:], arm)
        return np.asarray(twists)

    def follow(self, goal: Array, dt: float, ends: Mapping[str, Grip | FreeEnd]) -> None:
        """Goes along with the step that the motion has just taken."""
        swing = self._swing
        self._time += dt
        before, self._twists = self._twists, self._move(ends)
        swing_tangent.follow(
            swing.ints, swing.floats, swing.sols, swing.work, swing.moving, swing.remembered, goal, dt, swing.kept,
            swing.info, swing._scratch, self.flat, before, self._twists, self._room,
        )  # fmt: skip

    def run(self, goals: Array, steps: Array, moves: Array) -> Run:
        """:meth:`Swing.run` with tangents; moves (T, k, 6, m): of the knots, m columns more that begin with it."""
        swing, extra = self._swing, moves.shape[3]
        flat = np.concatenate((self.flat, np.zeros((extra, self.flat.shape[1]))))
        twists = np.zeros((len(steps), len(flat), *self._offset.shape[1:]))
        for at, dt, there in zip(twists, steps.tolist(), np.moveaxis(moves, 3, 1), strict=True):
            self._time += dt
            at[: len(self.flat)] = self._offset + self._time * self._rate
            at[len(self.flat) :] = there
        begun = np.concatenate((self._twists, np.zeros((extra, *self._offset.shape[1:]))))
        told = np.empty((3, len(steps), len(swing.model.s), 3))
        found = np.empty((3, *told.shape[1:], len(flat)))
        every = np.zeros((3, *told.shape[1:], self._columns + extra))
        at = np.concatenate((self._told, self._columns + np.arange(extra)))
        lost = swing_tangent.run(
            swing.ints, swing.floats, swing.sols, swing.work, swing.moving, swing.remembered, goals, steps, swing.kept,
            swing.info, swing._scratch, told[0], told[1], told[2], flat, begun, twists, self._room, found[0], found[1],
            found[2],
        )  # fmt: skip
        every[..., at] = found / np.concatenate((self.scale, np.ones(extra)))
        longer = np.zeros((len(swing.model.s), every.shape[-1]))
        for column, s, apart in self._longer:
            longer[:, self._told[column]] = (s[0] - s[1]) / apart
        s = swing.model.s.copy()
        return Run(
            s,
            told[0],
            told[1],
            told[2],
            int(lost),
            Derivative(s, told[0], told[1], every[0], every[1], every[2], longer),
        )

    def columns(self, rates: bool = False) -> Array:
        """(c points, 3, p): change of the points of the network's cables, or their velocities, a unit of each number.

        Points keep their share of the length.
        """
        swing, memory = self._swing, self._swing.memory
        ways = ("velocity", "turning") if rates else ("place", "tangent")
        places, tangents = _weights(swing, swing.model.s)
        moves = [swing_tangent.tangent_of.py_func(swing.ints, flat) for flat in self.flat]
        out = np.zeros((len(places), 3, self._columns))
        for column, t, scale in zip(self._told.tolist(), moves, self.scale.tolist(), strict=True):
            out[:, :, column] = (places @ getattr(t, ways[0]) + tangents @ getattr(t, ways[1])) / scale
        for column, s, apart in self._longer:
            above, below = _weights(swing, s[0]), _weights(swing, s[1])
            for i, nodes in enumerate(ways):
                out[:, :, self._told[column]] += (above[i] - below[i]) / apart @ getattr(memory, nodes)
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
