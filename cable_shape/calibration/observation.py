"""One look at a cable between two grips: :class:`Observation`."""

from __future__ import annotations

import math
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose, as_grip


@final
class Observation:
    """Points seen on a cable at rest, or moving with a known acceleration, and where it was held.

    Parameters
    ----------
    start, end : Pose or Grip
        A bare Pose is clamped; `end` may be a FreeEnd, None is a free end without load. A grip whose roll was not
        measured is a "swivel".
    points : (m, 3) array_like
        [m], world, on the centreline, in any order; rows with NaN are left out.
    arc_length : (m,) array_like, optional
        [m], where on the cable each point is; NaN or None: not known, and the closest point is taken.
    acceleration : (3,), (k, 3) or (k, 6) array_like, optional
        [m/s^2], with the velocity [m/s] beside it if there are six columns; see :meth:`cable_shape.Predictor.predict`.
    group : int, optional
        Observations of one recording share what the model does not know, so that they are no independent evidence; give
        them the same number. Default: every observation for itself.
    planar : bool
        The points were seen in a plane only, that of a photograph: they have no scatter across it.
    time : float, optional
        [s], on any clock, of looks at a cable that swings, see `motion` of :func:`cable_shape.calibrate`; points are
        then in their order along the cable.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    __slots__ = ("acceleration", "arc_length", "end", "group", "planar", "points", "start", "time")

    start: Grip
    end: Grip | FreeEnd
    points: Array
    arc_length: Array
    acceleration: Array | None
    group: int | None
    planar: bool
    time: float | None

    def __init__(
        self,
        start: Pose | Grip,
        end: Pose | Grip | FreeEnd | None,
        points: ArrayLike,
        arc_length: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        group: int | None = None,
        planar: bool = False,
        time: float | None = None,
    ) -> None:
        self.start = as_grip("start", start)
        self.end = FreeEnd() if end is None else end if isinstance(end, FreeEnd) else as_grip("end", end)
        seen = numbers_of("points", points)
        if seen.ndim != 2 or seen.shape[1] != 3:
            raise ArgumentError.of(
                "points", f"shape {seen.shape}", "it must be (m, 3)", "Give one row x, y, z a point."
            )
        arc = np.full(len(seen), math.nan) if arc_length is None else numbers_of("arc_length", arc_length)
        if arc.shape != (len(seen),):
            remedy = "Give one number a point, NaN where it is not known."
            raise ArgumentError.of("arc_length", f"shape {arc.shape}", f"it must be ({len(seen)},)", remedy)
        if (arc < 0.0).any():
            remedy = "Arc length counts from the start grip."
            raise ArgumentError.of("arc_length", float(np.nanmin(arc)), "it must be at least 0 m", remedy)
        whole = np.isfinite(seen).all(axis=1)
        if not whole.any():
            raise ArgumentError.of(
                "points", f"shape {seen.shape}", "one point at least must be finite", "Leave it out."
            )
        self.points = np.ascontiguousarray(seen[whole])
        self.arc_length = np.ascontiguousarray(arc[whole])
        self.acceleration = None if acceleration is None else numbers_of("acceleration", acceleration)
        checks.instance("planar", planar, (bool, np.bool_), "Write True or False.")
        self.planar = bool(planar)
        self.time = None if time is None else checks.number("time", time, unit="s")
        self.group = None if group is None else checks.integer("group", group, at_least=-(2**62), at_most=2**62)


def numbers_of(name: str, value: ArrayLike) -> Array:
    """`value` as float64, NaN allowed."""
    given = checks.numbers(name, value, f"Give {name} as an array.")
    if (np.abs(given) > checks.MOST).any():
        raise ArgumentError.of(name, given.tolist(), f"no magnitude may be above {checks.MOST:g}", "Give SI units.")
    return given
