"""A harness that forks into two arms, and a cable across it: what tests of cables among harnesses begin with."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import cable_shape as cs

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
CABLE = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)


def posed(place: Any, yaw: float = 0.0) -> np.ndarray:
    """Pose (7,) whose d3 is the x axis turned by an angle [degrees] about z."""
    return np.array((*place, *(Rotation.from_euler("z", yaw, degrees=True) * ALONG_X).as_quat()))


def leaving(yaw: float) -> cs.Pose:
    """Frame of an end that leaves a junction along x at that angle [degrees]."""
    turn = ALONG_X.inv() * Rotation.from_euler("z", yaw, degrees=True) * ALONG_X
    return cs.Pose((0.0, 0.0, 0.0), turn.as_quat())


def forked(cable: cs.Cable) -> cs.Harness:
    """A stem that forks into two arms, thinner than a cable and half as long."""
    arm = cable.replace(length=0.5, diameter=0.006)
    frames = {"l.start": leaving(25.0), "r.start": leaving(-25.0)}
    joint = cs.Junction("j", ("stem.end", *frames), frames=frames)
    return cs.Harness(dict.fromkeys(("stem", "l", "r"), arm), [joint])


HELD = {
    "stem.start": posed((-0.48, 0.0, 0.0)),
    "l.end": posed((0.42, 0.2, 0.0), 25.0),
    "r.end": posed((0.42, -0.2, 0.0), -25.0),
}
