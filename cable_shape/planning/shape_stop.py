"""Moving a cable so that it hangs still when the grips stop: :func:`shape_stop`."""

from __future__ import annotations

import math
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.motion.motion import Motion
from cable_shape.planning.paths import GripPath
from cable_shape.pose import Pose, between
from cable_shape.scene.scene import Scene
from cable_shape.solve.problem import GRAVITY

#: [s], between waypoints of what is returned and steps in time; how long after the stop a cable is looked at.
STEP, AFTER = 0.01, 1.0
#: [s], of a duration at most.
LONGEST = 60.0
#: Hills of the speed in time, how high each may be, in mean speeds, and what their second differences cost, in lengths.
_HILLS, _HIGHEST, _COST = 12, 4.0, 1e-4
#: Of its duration, in which a trapezoid speeds up, and in which it slows down.
RAMP = 0.25
#: Every so many steps after the stop count.
_EVERY = 5
_POINTS = 12


@final
class ShapedStop(NamedTuple):
    """A path in time after which the cable hangs still.

    path : waypoints every 10 ms on the same way, with times from 0.
    swing : [m], how far from where it hangs a point of the cable is at most within a second after the stop.
    trapezoid : [m], the same after a trapezoid of speed of equal duration, a quarter each to speed up and slow down.
    progress : (k,), share of the way at each waypoint, from 0 to 1.
    """

    path: GripPath
    swing: float
    trapezoid: float
    progress: Array


def shape_stop(
    cable: Cable,
    path: GripPath,
    duration: float | None = None,
    *,
    scene: Scene | None = None,
    gravity: ArrayLike = GRAVITY,
) -> ShapedStop:
    """When to be where on a path of the grips, so that the cable, at rest at its start, swings least after its end.

    Found by running the motion (:class:`cable_shape.Motion`): the speed is a sum of twelve hills (quadratic B-splines
    in time), none below 0, whose heights least squares choose. Grips start and stop without a jump of speed and never
    go back. Short of about a period of the cable there may be no such way: compare `swing` with `trapezoid`.

    Parameters
    ----------
    path : GripPath
        The way; of its times only the whole duration counts. Progress is even along its waypoints' times, or from one
        waypoint to the next if it has none.
    duration : float, optional
        [s]. Default: that of the path.
    scene : Scene, optional
        What holds and loads the cable, see :class:`cable_shape.Motion`; whether the cable comes near to bodies tells
        ``check_trajectory(..., motion=True)``.

    Raises
    ------
    ArgumentError
        For wrong arguments, and if the cable has no shape at the start or the end of the path, or cannot follow it.
    """
    checks.instance("path", path, (GripPath,), "Write GripPath(starts, ends, times).")
    if duration is None:
        if path.times is None:
            raise ArgumentError.of("duration", None, "the path has no times", "Give it in s.")
        duration = float(path.times[-1] - path.times[0])
    seconds = checks.number("duration", duration, above=0.0, at_most=LONGEST, unit="s")
    if len(path.starts) < 2:
        raise ArgumentError.of("path", "1 waypoint", "two at least make a way", "Write GripPath(starts, ends, times).")
    way = _Way(Motion(cable, scene, gravity, _POINTS), path, max(8, round(seconds / STEP)), seconds)
    plain = way.swing(trapezoid(way.shares))
    progress = _least(way)
    times = way.shares * seconds
    return ShapedStop(GripPath(*way.poses(progress), times), way.swing(progress), plain, progress)


@final
class _Way:
    """A path that is run in so many even steps of time with any progress."""

    def __init__(self, motion: Motion, path: GripPath, steps: int, seconds: float) -> None:
        self.motion, self.path = motion, path
        self.shares = np.linspace(0.0, 1.0, steps + 1)
        self._dt, self._after = seconds / steps, math.ceil(AFTER / STEP)
        times = path.times
        self._at = np.linspace(0.0, 1.0, len(path.starts)) if times is None else (times - times[0]) / np.ptp(times)
        self._rest = self._begin(1.0)
        self._scale = 1.0 / math.sqrt(self._rest.size // 3 * self._after / _EVERY)

    def _begin(self, progress: float) -> Array:
        """(nodes, 3): the cable at rest there."""
        starts, ends = self.poses(np.array((progress,)))
        shape = self.motion.begin(Pose.trusted(starts[0]), Pose.trusted(ends[0]))
        if not shape.status:
            where = "end" if progress else "start"
            raise ArgumentError.of("path", f"its {where}", "the cable has no shape there", shape.detail)
        return np.array(self.motion.run(starts, ends, (1e-6,)).places[0])

    def poses(self, progress: Array) -> tuple[Array, Array]:
        """Starts and ends (k, 7) at these shares of the way."""
        out = np.empty((2, len(progress), 7))
        for k, x in enumerate(np.clip(progress, 0.0, 1.0).tolist()):
            i = int(np.clip(np.searchsorted(self._at, x, "right") - 1, 0, len(self._at) - 2))
            part = (x - self._at[i]) / (self._at[i + 1] - self._at[i])
            for j, table in enumerate(self.path.tables):
                out[j, k] = between(table[i], table[i + 1], part)
        return out[0], out[1]

    def after(self, progress: Array) -> Array:
        """(m, nodes, 3) [m]: where the cable is after the stop, at every step, less where it hangs."""
        starts, ends = self.poses(progress)
        self.motion.begin(Pose.trusted(starts[0].copy()), Pose.trusted(ends[0].copy()))
        held = [np.concatenate((table[1:], np.repeat(table[-1:], self._after, axis=0))) for table in (starts, ends)]
        dt = np.concatenate((np.full(len(progress) - 1, self._dt), np.full(self._after, STEP)))
        run = self.motion.run(held[0], held[1], dt)
        if run.lost:
            remedy = "Is it longer than the grips are apart?"
            raise ArgumentError.of("path", f"{run.lost} steps", "the cable cannot follow it", remedy)
        return np.asarray(run.places[len(progress) - 2 :] - self._rest)

    def swing(self, progress: Array) -> float:
        """[m], the most of it."""
        return float(np.linalg.norm(self.after(progress), axis=2).max())

    def misses(self, progress: Array) -> Array:
        """[m], root mean square over nodes and times."""
        return np.asarray(self._scale * self.after(progress)[::_EVERY].ravel())


def _least(way: _Way) -> Array:
    """(k,), the progress after which the cable swings least."""
    from scipy.optimize import least_squares

    hills, cost = _hills(way.shares), _COST * way.motion.cable.length

    def progress(heights: Array) -> Array:
        far = hills @ heights
        return np.asarray(far / far[-1])

    def left(heights: Array) -> Array:
        return np.concatenate((way.misses(progress(heights)), cost * np.diff(heights, 2)))

    begin = np.ones(_HILLS)
    found = least_squares(left, begin, bounds=(0.0, _HIGHEST), diff_step=1e-2, max_nfev=15, xtol=1e-3, ftol=1e-3)
    return progress(np.array(found.x))


def _hills(x: Array) -> Array:
    """(k, 12): how far quadratic B-splines of the speed, evenly spread and 0 at both ends, have led by times x (k,)."""
    from scipy.interpolate import BSpline

    knots = np.concatenate(((0.0,), np.linspace(0.0, 1.0, _HILLS + 1), (1.0,)))
    middles = 0.5 * (x[1:] + x[:-1])
    hills = [BSpline.basis_element(knots[i : i + 4], extrapolate=False) for i in range(_HILLS)]
    steps = np.nan_to_num(np.stack([hill(middles) for hill in hills], axis=1)) / len(middles)
    return np.concatenate((np.zeros((1, _HILLS)), np.cumsum(steps, axis=0)))


def trapezoid(x: Array) -> Array:
    """From 0 to 1 with even acceleration, even speed, and even deceleration."""
    top = 1.0 / (1.0 - RAMP)
    early, late = 0.5 * top / RAMP * x**2, 1.0 - 0.5 * top / RAMP * (1.0 - x) ** 2
    return np.asarray(np.where(x < RAMP, early, np.where(x > 1.0 - RAMP, late, top * (x - 0.5 * RAMP))))
