"""How parameters of a calibration move the ends of the cable, as velocities: for the rod's own sensitivities."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cable_shape.calibration.parameters import Parameters
from cable_shape.checks import Array
from cable_shape.pose import FreeEnd, Grip

_AXES, _TILTS = "xyz", ("tilt_1", "tilt_2")
_ROLLS = {"start": "start_roll", "end": "roll"}


def moving(parameters: Parameters) -> list[int]:
    """Which parameters move nothing but an end."""
    names = {f"{side}_{what}" for side in ("start", "end") for what in (*_AXES, *_TILTS)} | set(_ROLLS.values())
    return [j for j, parameter in enumerate(parameters.each) if parameter.name in names]


def velocities(
    parameters: Parameters, values: Array, which: Sequence[int], start: Grip, end: Grip | FreeEnd
) -> Array:  # fmt: skip
    """(12, k): velocity and angular velocity of the cable's start, then of its end, world axes, per unit of each.

    start, end: as given with an observation, without what the parameters displace them by. A free end does not move.
    """
    now = parameters.by_name(values)
    out = np.zeros((12, len(which)))
    for first, side, given in ((0, "start", start), (6, "end", end)):
        if isinstance(given, FreeEnd):
            continue
        frame = given.cable_frame.matrix()[:3, :3]
        turn = np.array([now.get(f"{side}_{tilt}", 0.0) for tilt in _TILTS] + [0.0])
        for column, j in enumerate(which):
            name = parameters.each[j].name
            if name == _ROLLS[side]:
                out[first + 3 : first + 6, column] = frame @ turned(turn)
            elif name.startswith(f"{side}_tilt"):
                out[first + 3 : first + 6, column] = frame @ rates(turn)[:, _TILTS.index(name.removeprefix(f"{side}_"))]
            elif name.startswith(f"{side}_"):
                out[first : first + 3, column] = frame[:, _AXES.index(name[-1])]
    return out


def turned(turn: Array) -> Array:
    """(3,) third axis, turned by the rotation vector `turn`, which is across it."""
    angle = float(np.linalg.norm(turn))
    f = 1.0 if angle == 0.0 else math.sin(angle) / angle
    return np.array((f * turn[1], -f * turn[0], math.cos(angle)))


def rates(turn: Array) -> Array:
    """(3, 3): angular velocity per unit of change of a rotation vector [rad]."""
    square = float(turn @ turn)
    angle = math.sqrt(square)
    b, c = (
        (0.5, 1.0 / 6.0) if angle < 1e-4 else ((1.0 - math.cos(angle)) / square, (angle - math.sin(angle)) / angle**3)
    )
    skew = np.array(((0.0, -turn[2], turn[1]), (turn[2], 0.0, -turn[0]), (-turn[1], turn[0], 0.0)))
    out: Array = np.eye(3) + b * skew + c * skew @ skew
    return out
