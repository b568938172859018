"""Plugging in: where the plug at a cable's end is against its socket, :class:`Plug` and :func:`plug_error`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np

from cable_shape import checks
from cable_shape.pose import IDENTITY, Pose, rotate
from cable_shape.shape import CableShape

_INWARDS = np.array((0.0, 0.0, 1.0))


@final
@dataclass(frozen=True, slots=True)
class Plug:
    """A plug at the end of a cable.

    Parameters
    ----------
    socket : str
        Name of the socket of the scene that it goes into.
    offset : Pose
        The plug's frame in the cable frame at the end of the cable.
    """

    socket: str
    offset: Pose = IDENTITY

    def __post_init__(self) -> None:
        checks.word("Plug.socket", self.socket)
        checks.instance("Plug.offset", self.offset, (Pose,), "Write Pose(position, quaternion).")


@final
@dataclass(frozen=True, slots=True)
class PlugError:
    """How far a plug is from being in its socket.

    pose: of the plug, in the world. position [m] and angle [rad]: between the frames of plug and socket. axial [m]:
    along the socket's z axis, which points into the socket; negative: still to go. lateral [m]: square to that axis.
    """

    socket: str
    pose: Pose
    position: float
    angle: float
    axial: float
    lateral: float


def plug_error(plug: Plug, socket: Pose, shape: CableShape) -> PlugError:
    """Of the plug at the last section of `shape`; `socket`: the frame of the plug when it is in, world."""
    pose = Pose(shape.positions[-1], shape.quaternions[-1]) * plug.offset
    position, angle = socket.distance(pose)
    axial = float(np.dot(pose.position - socket.position, rotate(socket.quaternion, _INWARDS)))
    return PlugError(
        plug.socket, pose, position, angle, axial, math.sqrt(max(0.0, (position - axial) * (position + axial)))
    )
