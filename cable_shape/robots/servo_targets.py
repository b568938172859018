"""What a cable should be brought to: the targets of :class:`cable_shape.Servo`, in numbers alone.

Each has a `weight`, of its error against that of the others (1 rad counts as 0.1 m), and a `tolerance` within which it
is reached. Positions are in the world [m], arc lengths [m] count from the start grip.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import Pose, rotate
from cable_shape.scene.scene import Clip, Scene

_NEAR, _TURNED = 1e-3, 0.02  # m, rad: reached
_APPROACH = 0.05  # m
_ACROSS = 0.5  # of a unit vector: the opening of a mouth lies so little along the cable


@final
class PointsTarget:
    """Points of the centreline go to places.

    Parameters
    ----------
    arc_length : float or (k,) array_like
        [m], which points.
    positions : (3,) or (k, 3) array_like
        [m], world: where each should be.
    weight : float
    tolerance : float
        [m], of their mean distance.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    def __init__(
        self, arc_length: ArrayLike, positions: ArrayLike, *, weight: float = 1.0, tolerance: float = _NEAR
    ) -> None:
        self.arc_length: Array = np.atleast_1d(checks.numbers("arc_length", arc_length, "Give one or several [m]."))
        if self.arc_length.ndim != 1 or not self.arc_length.size or not np.isfinite(self.arc_length).all():
            bound = "it must be a finite number [m], or several"
            raise ArgumentError.of("arc_length", self.arc_length.tolist(), bound, "Give that of each point.")
        if (self.arc_length < 0.0).any():
            raise ArgumentError.of(
                "arc_length", float(self.arc_length.min()), "it must be at least 0 m", "Count from the start grip."
            )
        self.positions = _places(positions, len(self.arc_length))
        self.weight, self.tolerance = _weight(weight), _tolerance(tolerance, "m")


@final
class CentrelineTarget:
    """The whole centreline becomes this one.

    Parameters
    ----------
    positions : (n, 3) array_like
        [m], world, at arc lengths uniform from the start grip to the end grip, n at least 2.
    weight : float
    tolerance : float
        [m], of the mean distance.
    """

    def __init__(self, positions: ArrayLike, *, weight: float = 1.0, tolerance: float = _NEAR) -> None:
        self.positions = _places(positions, None)
        self.weight, self.tolerance = _weight(weight), _tolerance(tolerance, "m")


class _Aimed:
    """A point of the cable, and a direction."""

    def __init__(
        self, arc_length: float, direction: ArrayLike, *, weight: float = 1.0, tolerance: float = _TURNED
    ) -> None:
        self.arc_length = checks.number("arc_length", arc_length, at_least=0.0, unit="m")
        self.direction = _unit("direction", direction)
        self.weight, self.tolerance = _weight(weight), _tolerance(tolerance, "rad")


@final
class TangentTarget(_Aimed):
    """The centreline's tangent at a point goes along a direction.

    Parameters
    ----------
    arc_length : float
        [m]
    direction : (3,) array_like
        World, in the sense of increasing arc length; of any length but 0.
    weight : float
    tolerance : float
        [rad]
    """


@final
class TwistTarget(_Aimed):
    """The cable is rolled about its tangent at a point, so that its frame's d1 lies towards a direction.

    The roll is that of the prediction: points that are seen do not tell it.

    Parameters
    ----------
    arc_length : float
        [m]
    direction : (3,) array_like
        World; what it has along the tangent counts for nothing.
    weight : float
    tolerance : float
        [rad]
    """


@final
class MouthTarget:
    """A point of the cable goes into the mouth of a clip: along its tangent, from outside in.

    The point is brought before the mouth, the cable turned along it there, and only as far in as both are so: within a
    funnel that narrows towards the clip.

    Parameters
    ----------
    arc_length : float
        [m], of the point that the clip is to hold.
    pose : Pose
        The cable frame in the clip, as of a :class:`Clip`: d3 is the tangent there.
    outward : (3,) array_like
        World, out of the mouth, across the cable: it opens there. What it has along d3 is left out.
    approach : float
        [m], so far before its place the point waits until it is in line.
    weight : float
    tolerance : float
        [m], of the point; the tangent must be within 0.1 rad.
    """

    def __init__(
        self,
        arc_length: float,
        pose: Pose,
        outward: ArrayLike = (0.0, 0.0, 1.0),
        *,
        approach: float = _APPROACH,
        weight: float = 1.0,
        tolerance: float = 2.0 * _NEAR,
    ) -> None:
        self.arc_length = checks.number("arc_length", arc_length, at_least=0.0, unit="m")
        checks.instance("pose", pose, (Pose,), "Write Pose(position, quaternion), d3 along the cable.")
        self.pose, self.tangent = pose, rotate(pose.quaternion, np.array((0.0, 0.0, 1.0)))
        out = _unit("outward", outward)
        along = float(out @ self.tangent)
        if abs(along) > _ACROSS:
            bound = f"{abs(along):.2g} of it is along the cable's tangent in the clip, at most {_ACROSS:g} may be"
            raise ArgumentError.of("outward", out.tolist(), bound, "Give the direction in which the mouth opens.")
        self.outward = _unit("outward", out - along * self.tangent)
        self.approach = checks.number("approach", approach, at_least=0.0, unit="m")
        self.weight, self.tolerance = _weight(weight), _tolerance(tolerance, "m")

    @classmethod
    def of(cls, clip: Clip, outward: ArrayLike = (0.0, 0.0, 1.0), **options: float) -> MouthTarget:
        """The mouth of a clip; `options` are the keywords of the class."""
        checks.instance("clip", clip, (Clip,), "Write Clip(arc_length=..., pose=...).")
        return cls(clip.arc_length, clip.pose, outward, **options)


@final
class KeepClear:
    """An inequality: the cable's surface stays further than a bound from every obstacle and link of the robot.

    Parameters
    ----------
    scene : Scene
        Its obstacles; those with a `link` move with the robot.
    minimum : float, optional
        [m], the bound. Default: the scene's `warn_distance`.
    """

    def __init__(self, scene: Scene, minimum: float | None = None) -> None:
        checks.instance("scene", scene, (Scene,), "Write Scene(obstacles=[...]).")
        self.scene = scene
        self.minimum = checks.number("minimum", scene.warn_distance if minimum is None else minimum, unit="m")


Target = PointsTarget | CentrelineTarget | TangentTarget | TwistTarget | MouthTarget | KeepClear
TARGETS = (PointsTarget, CentrelineTarget, TangentTarget, TwistTarget, MouthTarget, KeepClear)


def as_targets(targets: Target | Sequence[Target]) -> tuple[Target, ...]:
    """One target or several, as a tuple."""
    several = (targets,) if isinstance(targets, TARGETS) else targets
    remedy = f"Give a list of {', '.join(kind.__name__ for kind in TARGETS)}."
    found: tuple[Any, ...] = checks.entries("targets", several, object, remedy)
    for i, target in enumerate(found):
        checks.instance(f"targets[{i}]", target, TARGETS, remedy)
    if all(isinstance(target, KeepClear) for target in found):
        raise ArgumentError.of("targets", list(found), "nothing is to be reached", remedy)
    return found


def _places(positions: ArrayLike, count: int | None) -> Array:
    places: Array = checks.numbers("positions", positions, "Give three numbers [m] for each point.")
    places = places[None] if places.shape == (3,) and count in (1, None) else places
    asked = f"({'n' if count is None else count}, 3)"
    if places.ndim != 2 or places.shape[1] != 3 or (len(places) < 2 if count is None else len(places) != count):
        bound = f"it must have shape {asked}{', n at least 2' if count is None else ''}"
        raise ArgumentError.of("positions", f"array of shape {places.shape}", bound, "Give x, y, z [m] of each point.")
    if not np.isfinite(places).all():
        row = int(np.flatnonzero(~np.isfinite(places).all(axis=1))[0])
        where = f"positions[{row}]"
        raise ArgumentError.of(where, places[row].tolist(), "every entry must be finite", "Leave out what is unknown.")
    return places


def _unit(name: str, direction: ArrayLike) -> Array:
    along = checks.vector(name, direction, 3)
    size = float(np.linalg.norm(along))
    if not size > checks.LEAST:
        raise ArgumentError.of(name, along.tolist(), "its length must be above 0", "Give a direction in the world.")
    return along / size


def _weight(weight: float) -> float:
    return checks.number("weight", weight, above=0.0)


def _tolerance(tolerance: float, unit: str) -> float:
    return checks.number("tolerance", tolerance, above=0.0, unit=unit)
