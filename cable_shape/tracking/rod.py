"""The rod's own shape for numbers that are not known, and how it answers them: :class:`Rod`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.calibration.answers import Answers
from cable_shape.calibration.parameters import Parameters
from cable_shape.checks import Array
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.prediction import solvers
from cable_shape.shape import CableShape
from cable_shape.solve.answers import pushed, sensitivity
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.tracking.trail import Trail
from cable_shape.tracking.unknown import Unknown

Ends = Mapping[str, Grip | FreeEnd]

#: m/s^2: that the places of the swing are nodes of the rod, whatever it is.
KINK = 1e-6
#: Answers to the material are taken anew when it has changed by this many steps of its finite differences.
ANEW = 50.0


@final
class Rod:
    """One cable between two ends, warm from shape to shape.

    Parameters
    ----------
    cable : Cable
    unknown : Unknown
        Of it.
    **options
        Keywords of :class:`cable_shape.solve.problem.Problem`, without acceleration.
    """

    def __init__(self, cable: Cable, unknown: Unknown, **options: Any) -> None:
        self.cable, self.unknown = cable, unknown
        self._options = options
        self.trail = Trail(solvers.Rod)
        self.links: Mapping[str, Pose] | None = None  #: where the robot's links are
        self._answers: Answers | None = None
        parameters = self._parameters = cast("Parameters | None", unknown.parameters)
        self._steps = np.array([] if parameters is None else [p.step for p in parameters.each])
        self._at = np.empty(0) if parameters is None else parameters.start
        self._frames: tuple[Array, Array] = (np.eye(3), np.eye(3))
        self._ends: tuple[Grip, Grip | FreeEnd]
        self._z = np.zeros(unknown.size)

        self.points = Problem(cable, **options).points
        self.length = self.longest = cable.length  # m

    @property
    def at(self) -> Array:
        """(rows,): points of the places of the swing."""
        return np.round(np.linspace(0, self.points - 1, self.unknown.rows)).astype(np.int64)

    @property
    def gaps(self) -> Array:
        """(n - 1,): whether nothing is between two points of the line, which is that of several cables."""
        return np.zeros(self.points - 1, dtype=np.bool_)

    @staticmethod
    def line(shape: CableShape) -> Array:
        """(n, 3) [m]."""
        return shape.positions

    def solve(self, z: Array, ends: Ends) -> CableShape:
        """The shape with deviations z (k,) of what is told of these ends, from the last one on."""
        start, end = ends["start"], ends["end"]
        assert isinstance(start, Grip)
        unknown = self.unknown
        parameters, cable = self._parameters, self.cable
        values = np.empty(0)
        if parameters is not None:
            values = parameters.start + z[unknown.material]
            cable = parameters.make_cable(values)
        swing = z[unknown.swing].reshape(-1, 3)
        acceleration = None
        if unknown.rows:
            acceleration = swing.copy()
            acceleration[1, 2] += KINK
        problem = Problem(cable, acceleration=acceleration, **self._options)
        near, far = displaced(start, z[:6]), end if isinstance(end, FreeEnd) else displaced(end, z[6:12])
        problem.move(near, far, self.links)
        self._z, self._ends = z, (near, far)
        self._values = values
        shape: CableShape = self.trail.solve(problem)
        return shape

    def moves(self) -> Array:
        """(n, 3, k): how the last shape moves with the deviations, at the same share of the length."""
        unknown, state, z = self.unknown, self.trail.memory, self._z
        assert state is not None
        out = np.zeros((state.problem.points, 3, unknown.size))
        ends = sensitivity(state)
        near, far = self._ends
        out[:, :, :6] = carried(ends[:, :, :6], near, z[:6])
        if isinstance(far, Grip):
            out[:, :, 6:12] = carried(ends[:, :, 6:], far, z[6:12])
        if self._parameters is not None:
            if self._answers is None or (np.abs(self._values - self._at) > ANEW * self._steps).any():
                self._answers, self._at = Answers(self._parameters, self._values), self._values
            out[:, :, unknown.material] = self._answers.moves(state, *self._ends)
        if unknown.rows:
            assert isinstance(state, Network)
            out[:, :, unknown.swing] = pushed(state, unknown.rows)
        return out


def displaced(grip: Grip, by: Array) -> Grip:
    """A grip whose cable frame is moved by by[:3] [m] and turned by the rotation vector by[3:] [rad], in itself."""
    return Grip(grip.pose, grip.kind, grip.offset * small(by), grip.curvature) if by.any() else grip


def small(by: Array) -> Pose:
    """The pose of a displacement (3,) [m] and a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(by[3:]))
    half = 0.5 if angle < 1e-9 else np.sin(0.5 * angle) / angle
    q = np.array((*(half * by[3:]), np.cos(0.5 * angle)))
    array = np.concatenate((by[:3], q))
    array.flags.writeable = False
    return Pose.trusted(array)


def carried(columns: Array, displaced_grip: Grip, by: Array) -> Array:
    """(n, 3, 6): columns by velocity and angular velocity in the world as those by `displaced`."""
    frame = displaced_grip.cable_frame.matrix()[:3, :3]
    x, y, z = by[3:].tolist()
    turn = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    square = x * x + y * y + z * z
    angle = np.sqrt(square)
    a, b = (
        (0.5, 1.0 / 6.0) if angle < 1e-4 else ((1.0 - np.cos(angle)) / square, (1.0 - np.sin(angle) / angle) / square)
    )
    out = np.empty_like(columns)
    out[:, :, :3] = columns[:, :, :3] @ (frame @ turned_back(by[3:]))
    out[:, :, 3:] = columns[:, :, 3:] @ (frame @ (np.eye(3) - a * turn + b * turn @ turn))
    return out


def turned_back(turn: Array) -> Array:
    """(3, 3): of the inverse of a rotation vector."""
    return small(np.concatenate((np.zeros(3), -turn))).matrix()[:3, :3]
