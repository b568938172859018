"""A harness's own shape for numbers that are not known, and how it answers them: :class:`HarnessRod`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np

from cable_shape.cable.harness import Harness
from cable_shape.calibration.harness_answers import put_junctions
from cable_shape.calibration.harness_parameters import OF_SEGMENTS, HarnessParameters
from cable_shape.checks import Array
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.prediction.harness_solver import HarnessSolver
from cable_shape.scene.scene import Scene
from cable_shape.scene.scene_parts import Clip, PointMass
from cable_shape.solve.harness_answers import HarnessChanges, answers
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.tracking.harness_unknown import HarnessUnknown
from cable_shape.tracking.rod import ANEW, KINK, Ends, carried, displaced
from cable_shape.tracking.trail import Trail

#: Harnesses beside one are this far from it, in steps of finite differences of whole shapes: nothing is solved there.
_NEAR = 1e-2
#: Rows of a segment's accelerations, evenly along it, and between which shares of its length it moves as its middle.
_TABLES = (3, (0.5, 0.5)), (4, (1.0 / 3.0, 2.0 / 3.0)), (6, (0.4, 0.6))
#: As far away, in shares of the length, are clips and masses to be from kinks, which longer segments have elsewhere.
_CLEAR = 0.03


@final
class HarnessRod:
    """One harness between its ends, warm from shape to shape; see :class:`.rod.Rod`.

    Parameters
    ----------
    harness : Harness
    unknown : HarnessUnknown
        Of it.
    **options
        Keywords of :class:`cable_shape.solve.harness_problem.HarnessProblem`, without acceleration.
    """

    def __init__(self, harness: Harness, unknown: HarnessUnknown, **options: Any) -> None:
        self.harness, self.unknown = harness, unknown
        self._options = {**options, "friction": False}
        self.length, self.longest = harness.length, harness.longest  # m
        self._one = HarnessProblem(harness, **self._options).points  # of each segment
        self.points = self._one * len(harness.segments)
        self.trail = Trail(HarnessSolver)
        self.links: Mapping[str, Pose] | None = None  #: where the robot's links are
        self._ends: dict[str, Grip | FreeEnd] = {}
        self._z = np.zeros(unknown.size)
        self._at: Array = np.empty(0)  # values where the changes are taken
        self._key: tuple[object, ...] | None = None
        self._changes: HarnessChanges
        self._loads: HarnessChanges
        self._tables = {name: _table(harness, name, options.get("scene")) for name in unknown.rows_of}
        known = unknown.parameters
        self._each = [] if known is None else known.each
        targets = [] if known is None else known.targets
        of_junctions = {part for one in targets if one.kind not in OF_SEGMENTS for part in one.parts}
        self._own = [j for j, p in enumerate(self._each) if p.name not in of_junctions]

    @property
    def at(self) -> Array:
        """(rows,): points of the places of the swing."""
        out: Array = np.zeros(self.unknown.rows, dtype=np.int64)
        for i, rows in enumerate(self.unknown.rows_of.values()):
            out[list(rows)] = i * self._one + np.array((0, (self._one - 1) // 2, self._one - 1))
        return out

    @property
    def gaps(self) -> Array:
        """(n - 1,): whether nothing is between two points of the line."""
        return np.asarray(np.arange(1, self.points) % self._one == 0)

    @staticmethod
    def line(shape: HarnessShape) -> Array:
        """(n, 3) [m], the points of all segments."""
        return np.concatenate([one.positions for one in shape.segments.values()])

    def solve(self, z: Array, ends: Ends) -> HarnessShape:
        """The shape with deviations z (k,) of what is told of these ends, from the last one on."""
        self._z = z
        self._ends = {
            name: displaced(end, z[self.unknown.grips[name]]) if isinstance(end, Grip) else end
            for name, end in ends.items()
        }
        shape: HarnessShape = self.trail.solve(self._problem(self._values(), z[self.unknown.swing].reshape(-1, 3)))
        return shape

    def moves(self) -> Array:
        """(n, 3, k): how the last shape moves with the deviations, at the same share of each segment."""
        unknown, state = self.unknown, self.trail.memory
        assert state is not None
        out = np.zeros((self.points, 3, unknown.size))
        grips = [name for name, end in self._ends.items() if isinstance(end, Grip)]
        moved = state.sensitivities(tuple(grips))[: self.points]
        for i, name in enumerate(grips):
            end, own = self._ends[name], unknown.grips[name]
            assert isinstance(end, Grip)
            out[:, :, own] = carried(moved[:, :, 6 * i : 6 * i + 6], end, self._z[own])
        self._look_about()
        first = unknown.material.start
        out[:, :, [first + j for j in self._own]] = answers(state, self._changes)
        out[:, :, unknown.swing] = answers(state, self._loads)
        if self.unknown.parameters is not None:
            put_junctions(state, self.unknown.parameters, self._values(), out[:, :, self.unknown.material])
        return out

    def _values(self) -> Array:
        known = self.unknown.parameters
        return np.empty(0) if known is None else known.start + self._z[self.unknown.material]

    def _problem(self, values: Array, swing: Array) -> HarnessProblem:
        """Between the ends as they are now; swing (rows, 3) [m/s^2]."""
        known: HarnessParameters | None = self.unknown.parameters
        made = self.harness if known is None else known.make(values)
        moves = {name: swing[list(rows)] for name, rows in self.unknown.rows_of.items()}
        for name, rows in moves.items():
            rows[1, 2] += KINK
            moves[name] = self._tables[name] @ rows
        return HarnessProblem(made, acceleration=moves, **self._options).move(self._ends, self.links)

    def _look_about(self) -> None:
        """Takes the changes anew where numbers, or how the ends are held, are others."""
        values = self._values()
        key = tuple(end.kind if isinstance(end, Grip) else end for end in self._ends.values())
        still = np.zeros((self.unknown.rows, 3))
        if key != self._key:
            pushes = [0.5 * one.reshape(-1, 3) for one in np.eye(still.size)]
            pairs = [(self._problem(values, push), self._problem(values, -push)) for push in pushes]
            self._loads = HarnessChanges(self._problem(values, still), pairs, np.full(still.size, 0.5))
        steps = np.array([p.step for p in self._each])
        if key != self._key or (np.abs(values - self._at) > ANEW * steps).any():
            ways = [_NEAR * step * one for step, one in zip(steps, np.eye(len(values)), strict=True)]
            pairs = [
                (self._problem(values + way, still), self._problem(values - way, still))
                for way in (ways[j] for j in self._own)
            ]
            self._changes = HarnessChanges(self._problem(values, still), pairs, _NEAR * steps[self._own])
            self._at = values
        self._key = key


def _table(harness: Harness, segment: str, scene: Scene | None) -> Array:
    """(rows, 3): how places evenly along a segment move by how its start, middle and end do."""
    length = harness.segments[segment].length
    parts: Sequence[Clip | PointMass] = () if scene is None else (*scene.clips, *scene.masses)
    others = np.array([part.arc_length / length for part in parts if part.segment == segment])

    def room(kinks: tuple[float, float]) -> float:
        return min(_CLEAR, *(float(np.abs(others - x).min(initial=1.0)) for x in kinks))

    rows, (low, high) = max(_TABLES, key=lambda table: room(table[1]))
    at, s = (0.0, low, high, 1.0), np.linspace(0.0, 1.0, rows)
    return np.stack([np.interp(s, at, one) for one in ((1, 0, 0, 0), (0, 1, 1, 0), (0, 0, 0, 1))], axis=1)
