"""The targets of :class:`cable_shape.Servo` as tasks of mink: errors, and their exact Jacobians."""

from __future__ import annotations

import math
from typing import final

import mink
import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import rotate
from cable_shape.robots.held_cable import HeldCable
from cable_shape.robots.servo_targets import CentrelineTarget, MouthTarget, PointsTarget, TangentTarget, TwistTarget

#: m, 1 rad counts as much: a point so far away moves so much.
ARM = 0.1
_STENCIL = 5  # points of the shape through which its slope is taken
_IN_LINE = 0.1  # rad, of the tangent in a mouth
_FUNNEL = 0.5  # half width / depth of the way into a mouth
_SLACK = 5e-3  # m, so much further in than the funnel is wide nothing is held; twice as much, and nothing goes across
_INVERSE = np.array((-1.0, -1.0, -1.0, 1.0))  # times a unit quaternion
_ALONG = 1e-6  # of a unit vector: along the tangent there is no roll to speak of
_WIDE = 0.5  # of the tolerance: so far from the line of the mouth nothing holds the cable off

Reached = PointsTarget | CentrelineTarget | TangentTarget | TwistTarget | MouthTarget


def task_of(held: HeldCable, target: Reached) -> ServoTask:
    """What brings the cable to a target."""
    if isinstance(target, PointsTarget):
        return PointsTask(held, target, target.arc_length)
    if isinstance(target, CentrelineTarget):
        length = held.parts[""].length
        return PointsTask(held, target, np.linspace(0.0, length, len(target.positions)))
    if isinstance(target, TangentTarget):
        return TangentTask(held, target)
    if isinstance(target, TwistTarget):
        return TwistTask(held, target)
    return MouthTask(held, target)


class ServoTask(mink.Task):
    """A task that can say how far it is from its target, and what it is called."""

    unit = "m"

    def __init__(self, held: HeldCable, target: Reached, cost: Array) -> None:
        super().__init__(target.weight * cost)
        self.held, self.tolerance = held, target.tolerance

    def begin(self, configuration: mink.Configuration) -> None:
        """Looks at the cable before a step."""

    def off(self, configuration: mink.Configuration) -> float:
        """[m] or [rad], what is left."""
        raise NotImplementedError

    def left(self, configuration: mink.Configuration) -> float:
        """What is left, weighted: it becomes less as long as the cable comes nearer."""
        return float(np.linalg.norm(self.cost * self.compute_error(configuration)))

    def reached(self, configuration: mink.Configuration) -> bool:
        """Whether that is within the tolerance."""
        return self.off(configuration) <= self.tolerance


@final
class PointsTask(ServoTask):
    """Points of the centreline at their places: error (3 k,) [m], each its part of the mean square."""

    def __init__(self, held: HeldCable, target: PointsTarget | CentrelineTarget, arc_length: Array) -> None:
        super().__init__(held, target, np.full(3 * len(arc_length), 1.0 / math.sqrt(len(arc_length))))
        self.name = "the centreline" if isinstance(target, CentrelineTarget) else f"points at {_listed(arc_length)} m"
        self._target = target.positions
        self._weights = np.array([held.weights(on_cable(held, s)) for s in arc_length])  # (k, points)

    def _apart(self, configuration: mink.Configuration) -> Array:
        return np.asarray(self._weights @ self.held.at(configuration).part()[0].positions - self._target)

    def compute_error(self, configuration: mink.Configuration) -> Array:
        """(3 k,) [m], from the targets to the points."""
        return self._apart(configuration).ravel()

    def compute_jacobian(self, configuration: mink.Configuration) -> Array:
        """(3 k, nv)"""
        jacobian = self.held.at(configuration).jacobian
        return np.tensordot(self._weights, jacobian, 1).reshape(-1, jacobian.shape[-1])

    def off(self, configuration: mink.Configuration) -> float:
        """[m], mean distance."""
        return float(np.linalg.norm(self._apart(configuration), axis=1).mean())


@final
class TangentTask(ServoTask):
    """The tangent at a point: error (3,), what it lacks to the direction."""

    unit = "rad"

    def __init__(self, held: HeldCable, target: TangentTarget) -> None:
        super().__init__(held, target, np.full(3, ARM))
        self.name = f"the tangent at {target.arc_length:g} m"
        self._direction = target.direction
        self._slopes = held.weights(on_cable(held, target.arc_length), slope=True)

    def compute_error(self, configuration: mink.Configuration) -> Array:
        """(3,), from the direction to the tangent."""
        return tangent(self.held, configuration, self._slopes)[0] - self._direction

    def compute_jacobian(self, configuration: mink.Configuration) -> Array:
        """(3, nv)"""
        return tangent(self.held, configuration, self._slopes)[1]

    def off(self, configuration: mink.Configuration) -> float:
        """[rad], between the two."""
        return angle(tangent(self.held, configuration, self._slopes)[0], self._direction)


@final
class TwistTask(ServoTask):
    """The roll of the cable frame at a point: error (1,) [rad], from the direction to d1 about the tangent."""

    unit = "rad"

    def __init__(self, held: HeldCable, target: TwistTarget) -> None:
        super().__init__(held, target, np.full(1, ARM))
        self.name = f"the twist at {target.arc_length:g} m"
        self._arc_length, self._direction = on_cable(held, target.arc_length), target.direction

    def _seen(self, configuration: mink.Configuration) -> Array:
        """(3,), the direction in the cable frame."""
        return rotate(self.held.frame(configuration, self._arc_length) * _INVERSE, self._direction)

    def compute_error(self, configuration: mink.Configuration) -> Array:
        """(1,) [rad]"""
        x, y, _ = self._seen(configuration)
        return np.array([-math.atan2(y, x)])

    def compute_jacobian(self, configuration: mink.Configuration) -> Array:
        """(1, nv); zero where the direction is that of the tangent."""
        x, y, z = self._seen(configuration)
        turned = self.held.turning(configuration, self._arc_length)
        square = x * x + y * y
        leaning = z * (x * turned[0] + y * turned[1]) / square if square > _ALONG**2 else 0.0
        return np.asarray(turned[2] - leaning)[None]

    def off(self, configuration: mink.Configuration) -> float:
        """[rad]"""
        return abs(float(self.compute_error(configuration)[0]))


@final
class MouthTask(ServoTask):
    """A point goes into a clip: error (6,), of the point [m] from where it may be by now, and of the tangent.

    Where it may be by now, `ahead` (3,) [m] from its place, is decided by `begin` before each step: as far in as the
    funnel is wide where the cable is, and where it is further in than that, out of there first, not across.
    """

    def __init__(self, held: HeldCable, target: MouthTarget) -> None:
        super().__init__(held, target, np.concatenate((np.ones(3), np.full(3, ARM))))
        self.name = f"the mouth for {target.arc_length:g} m"
        arc_length = on_cable(held, target.arc_length)
        self._weights, self._slopes = held.weights(arc_length), held.weights(arc_length, slope=True)
        self._target = target
        self.ahead: Array = target.approach * target.outward

    def _point(self, configuration: mink.Configuration) -> Array:
        """(3,) [m], from its place in the clip to the point."""
        return np.asarray(self._weights @ self.held.at(configuration).part()[0].positions - self._target.pose.position)

    def begin(self, configuration: mink.Configuration) -> None:
        """Decides where the point may be."""
        target, apart = self._target, self._point(configuration)
        out = float(apart @ target.outward)
        aside = apart - out * target.outward
        turned = angle(tangent(self.held, configuration, self._slopes)[0], target.tangent)
        wide = max(float(np.linalg.norm(aside)), self.tolerance / _IN_LINE * turned) - _WIDE * self.tolerance
        outside = min(max(wide / _FUNNEL, 0.0), target.approach)
        stays = min(max((outside - out) / _SLACK - 1.0, 0.0), 1.0)
        self.ahead = outside * target.outward + stays * aside

    def compute_error(self, configuration: mink.Configuration) -> Array:
        """(6,), of the point [m], then of the tangent."""
        target = self._target
        place = self._point(configuration) - self.ahead
        return np.concatenate((place, tangent(self.held, configuration, self._slopes)[0] - target.tangent))

    def compute_jacobian(self, configuration: mink.Configuration) -> Array:
        """(6, nv), what is `ahead` staying as it is."""
        point = np.tensordot(self._weights, self.held.at(configuration).jacobian, 1)
        return np.concatenate((point, tangent(self.held, configuration, self._slopes)[1]))

    def off(self, configuration: mink.Configuration) -> float:
        """[m], of the point from its place in the clip."""
        return float(np.linalg.norm(self._point(configuration)))

    def left(self, configuration: mink.Configuration) -> float:
        """Weighted, on the way through where it may be by now."""
        return super().left(configuration) + float(self.cost[0] * np.linalg.norm(self.ahead))

    def reached(self, configuration: mink.Configuration) -> bool:
        """In its place, and in line with it."""
        along = tangent(self.held, configuration, self._slopes)[0]
        return super().reached(configuration) and angle(along, self._target.tangent) <= _IN_LINE


def tangent(held: HeldCable, configuration: mink.Configuration, slopes: Array) -> tuple[Array, Array]:
    """The unit tangent of the centreline (3,), and its Jacobian (3, nv)."""
    found = held.at(configuration)
    along = slopes @ found.part()[0].positions
    size = float(np.linalg.norm(along))
    unit = along / size
    turning = np.tensordot(slopes, found.jacobian, 1) / size
    return unit, turning - np.outer(unit, unit @ turning)


def angle(one: Array, other: Array) -> float:
    """[rad], between unit vectors."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def on_cable(held: HeldCable, arc_length: float) -> float:
    """Refuses what lies beyond the cable's end."""
    length = held.parts[""].length
    if arc_length > length:
        bound = f"it must be at most the cable's length, {length:g} m"
        raise ArgumentError.of("arc_length", float(arc_length), bound, "Choose a point.")
    return float(arc_length)


def _listed(arc_length: Array) -> str:
    shown = [f"{s:g}" for s in arc_length[:3]]
    return ", ".join(shown) + (", ..." if len(arc_length) > 3 else "")
