"""A snap before it happens: :func:`predicted_snap` follows a copy of the rod along the present motion of its grips."""

from __future__ import annotations

import copy
import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.pose import Grip, Pose, multiply
from cable_shape.shape import CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network

#: Solves on the way to the horizon.
STEPS = 8


def predicted_snap(state: Network, twists: Array, horizon: float) -> tuple[float, float, CableShape] | None:
    """When the cable snaps if its grips keep their speed, and the shape that it then has; None if it does not snap.

    Parameters
    ----------
    state : Network
        Of the rod, after a solve; it is left as it is.
    twists : (12,)
        Velocity [m/s] and angular velocity [rad/s] of the start, then of the end, world axes, about that cable end.
    horizon : float
        [s], how far to look.

    Returns
    -------
    no_sooner, no_later : float
        [s], the snap lies between.
    shape : CableShape
        After it, with the ends where they are at `no_later`.
    """
    ahead, problem = copied(state), copy.copy(state.problem)
    ahead.problem = problem
    start, end = problem.start, problem.end
    for k in range(1, STEPS + 1):
        time = horizon * k / STEPS
        later = moved(end, twists[6:], time) if isinstance(end, Grip) else end
        shape = cosserat.solve(problem.move(moved(start, twists[:6], time), later), ahead)
        if shape.status is Status.SNAPPED:
            return horizon * (k - 1) / STEPS, time, shape
        if not shape.status:
            return None
    return None


def copied(state: Network) -> Network:
    """The rod's memory once more, sharing only the problem, which a solve does not change."""
    return state.copied()


def moved(grip: Grip, twist: Array, time: float) -> Grip:
    """The grip whose cable end keeps its velocity [m/s] and angular velocity [rad/s] (6,) for `time` [s]."""
    frame = grip.cable_frame
    turn = 0.5 * time * twist[3:]
    half = math.sqrt(float(turn @ turn))
    q = np.append(np.sinc(half / math.pi) * turn, math.cos(half))
    there = Pose(frame.position + time * twist[:3], multiply(q, frame.quaternion), frame.turns)
    return Grip(there, grip.kind, curvature=grip.curvature)
