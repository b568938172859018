"""From parameters to misses of cables that were seen to swing: whole recordings, run through from their first looks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from cable_shape import checks
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import Parameters, held
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.motion.motion import Motion
from cable_shape.motion.run import STEP, Run, joined
from cable_shape.pose import FreeEnd, Grip, Pose

#: Points of the shape in which a motion begins; it is not compared with anything.
_POINTS = 12
#: Points of a centreline that points without arc length are compared with.
_DENSE = 101
#: Elements, of meshes that are not made finer though steps are lost; and after how many steps that is looked at.
_MOST, _PIECE = 100, 32
#: [1], of looks: two frames at least make a motion.
FEWEST = 3
_TIMES = "Write Observation(..., time=), in seconds."


@final
class Recording:
    """Looks at one cable, one after the other, from one group of observations.

    It begins at its second look, in which the cable moves as from the first one to it, and what comes after is
    compared. Where these two do not see the same points it begins at rest.
    """

    def __init__(self, looks: Sequence[Observation], longest: float = STEP) -> None:
        """longest [s]: no step in time is longer."""
        self.looks, self._longest = looks, longest
        self.group = looks[0].group
        self.planar = looks[0].planar
        times = np.array([look.time for look in looks], dtype=np.float64)
        self.steps = np.diff(times)
        if not (np.isfinite(times).all() and (self.steps > 0.0).all()):
            raise ArgumentError.of("time", times.tolist()[:4], "it must ascend in a recording", _TIMES)
        kinds = {(look.start.kind, look.end.kind if isinstance(look.end, Grip) else "free") for look in looks}
        if len(kinds) > 1:
            raise ArgumentError.of("ends", sorted(kinds), "a recording holds them in one way", "Make it two groups.")
        self.starts = np.array([look.start.cable_frame.array for look in looks])
        ends = [look.end.cable_frame.array for look in looks if isinstance(look.end, Grip)]
        self.ends = np.array(ends) if ends else None
        self.ways = np.maximum(1, np.ceil(self.steps[1:] / longest)).astype(np.int64)
        later = looks[2:]
        self.points = np.concatenate([look.points for look in later])
        self.arc_length = np.concatenate([look.arc_length for look in later])
        self.owners = np.repeat(np.arange(len(later)), [len(look.points) for look in later])
        rows = np.unique([look.arc_length for look in later], axis=0) if self._even(later) else np.zeros((0, 0))
        self.rows = rows[0] if len(rows) == 1 and np.isfinite(rows).all() else None

    @staticmethod
    def _even(looks: Sequence[Observation]) -> bool:
        """Whether all looks see as many points."""
        return len({len(look.points) for look in looks}) == 1

    @property
    def parts(self) -> Array:
        """[s], of the steps from the second look on: from look to look, in equal parts where that is long."""
        return np.repeat(self.steps[1:] / self.ways, self.ways)

    def parted(self, poses: Array) -> Array:
        """The poses (T, 7) of all looks after each of `parts`, on a cubic spline through them."""
        if self.ways.max() == 1:
            return poses[2:]
        looks = np.concatenate(((0.0,), np.cumsum(self.steps)))
        times = self.steps[0] + np.cumsum(self.parts)
        times[np.cumsum(self.ways) - 1] = looks[2:]
        turns = RotationSpline(looks, Rotation.from_quat(poses[:, 3:]))(times).as_quat()
        return np.hstack((CubicSpline(looks, poses[:, :3])(times), turns))

    def until(self, most: float) -> Recording:
        """Its looks of the first `most` [s]."""
        return Recording(self.looks[: max(FEWEST, 1 + int((np.cumsum(self.steps) <= most).sum()))], self._longest)

    def begin(self, motion: Motion, start: Grip, end: Grip | FreeEnd) -> bool:
        """Starts a motion at the second look, with these ends."""
        first, second = self.looks[:2]
        arc = second.arc_length if np.isfinite(second.arc_length).all() else None
        same = len(first.points) == len(second.points)
        same = same and np.array_equal(first.arc_length, second.arc_length, equal_nan=True)
        order = arc is None or bool((np.diff(arc) > 0.0).all() and arc[-1] <= motion.cable.length)
        if not (same and order):
            return bool(motion.begin(start, end).status)
        velocity = (second.points - first.points) / self.steps[0]
        return bool(motion.begin(start, end, arc, second.points, velocity).status)

    def misses(self, run: Run) -> Array:
        """(n, 3) [m], of all points from the third look on."""
        if self.rows is not None:
            return np.asarray(run.at(self.rows).reshape(-1, 3) - self.points)
        out = np.empty_like(self.points)
        dense = np.linspace(0.0, run.s[-1], _DENSE)
        lines = run.at(dense)
        for i in np.unique(self.owners):
            own = self.owners == i
            known = np.isfinite(self.arc_length[own])
            seen, part = self.points[own], np.empty((int(own.sum()), 3))
            part[~known] = _nearest(lines[i], seen[~known]) - seen[~known]
            for axis in range(3):
                part[known, axis] = np.interp(self.arc_length[own][known], dense, lines[i, :, axis])
            part[known] -= seen[known]
            out[own] = part
        return out


@final
class MotionForward:
    """Misses of all points (n, 3) [m], recording by recording, and how they change with parameters, by differences.

    Every recording is run through once for each parameter and iteration: from its first looks on nothing is known of it
    but how its ends move.
    """

    def __init__(
        self, parameters: Parameters, recordings: Sequence[Recording], most: float = np.inf,
        tick: Callable[[], None] = lambda: None, finer: bool = True, **loads: Any,
    ) -> None:  # fmt: skip
        """most [s]: of each recording that is looked at; finer: whether recordings whose steps cannot be taken are run
        through on finer meshes, too, which takes its time in a fit; loads: the keywords `gravity`, `scene` and
        `elements` of :class:`cable_shape.Motion`."""
        self.parameters, self.tick, self._refines = parameters, tick, finer
        if most < np.inf:
            recordings = [one.until(most) for one in recordings]
        self.observations = list(recordings)
        self._loads = loads
        self._last: tuple[Array, Array] | None = None
        self.lost = 0

    def run(self, values: Array, one: Recording) -> Run | None:
        """The nodes at all looks from the third one on; None: it does not begin."""
        return self._run(self._motion(values), values, one)

    def misses(self, values: Array) -> Array:
        """(n, 3) [m]; NaN of recordings that do not begin."""
        if self._last is None or not np.array_equal(self._last[0], values):
            self._last = values.copy(), self._misses(values)
        return self._last[1]

    def afresh(self, values: Array) -> Array:
        """The same: a motion has no branches."""
        return self.misses(values)

    def jacobian(self, values: Array, now: Array) -> Array:
        """(n, 3, k), by forward differences."""
        out = np.zeros((*now.shape, len(values)))
        for j, parameter in enumerate(self.parameters.each):
            there = values.copy()
            there[j] += parameter.step
            out[:, :, j] = np.nan_to_num((self._misses(there) - now) / parameter.step)
        return out

    def _misses(self, values: Array) -> Array:
        motion = self._motion(values)
        out, self.lost = [], 0
        for one in self.observations:
            run = self._run(motion, values, one)
            out.append(np.full(one.points.shape, np.nan) if run is None else one.misses(run))
            self.lost += 0 if run is None else run.lost
            self.tick()
        return np.concatenate(out)

    def _motion(self, values: Array, **finer: int) -> Motion:
        """That of the cable of these numbers."""
        return Motion(self.parameters.make_cable(values), points=_POINTS, **{**self._loads, **finer})

    def _run(self, motion: Motion, values: Array, one: Recording) -> Run | None:
        """The nodes of a recording at its looks; where steps cannot be taken on the mesh as it is, on finer ones."""
        run = self._once(motion, values, one, whole=not self._refines)
        if not self._refines or run is None:
            return run
        while run.lost and len(run.s) <= _MOST:
            finer = self._motion(values, elements=2 * (len(run.s) - 1))
            found = self._once(finer, values, one)
            if found is None:  # it does not begin there
                break
            motion, run = finer, found
        return self._once(motion, values, one, whole=True) if run.lost else run

    def _once(self, motion: Motion, values: Array, one: Recording, *, whole: bool = False) -> Run | None:
        """The same on one mesh; without the rest if steps are lost, unless it is the `whole` that is asked for."""
        near, far = self.parameters.offset(values, "start"), self.parameters.offset(values, "end")
        start, end = held(one.looks[1].start, near), held(one.looks[1].end, far)
        assert isinstance(start, Grip)
        if not one.begin(motion, start, end):
            return None
        starts, ends = one.parted(beside(one.starts, near)), None
        if one.ends is not None:
            ends = one.parted(beside(one.ends, far))
        size = len(starts) if whole else _PIECE
        runs: list[Run] = []
        for k in range(0, len(starts), size):
            own = slice(k, k + size)
            runs.append(motion.run(starts[own], None if ends is None else ends[own], one.parts[own]))
            if runs[-1].lost and not whole:
                return runs[-1]
        return joined(runs).after((np.cumsum(one.ways) - 1).tolist())


def recordings_of(seen: Sequence[Observation], longest: float = STEP) -> list[Recording]:
    """Observations, group by group, each in the order of time; longest [s]: no step between them is longer.

    Raises
    ------
    ArgumentError
        Naming what a motion needs and an observation does not have.
    """
    groups: dict[int, list[Observation]] = {}
    for look in seen:
        if look.group is None:
            raise ArgumentError.of("group", None, "a motion is one of a group", "Number the recordings from 0.")
        if look.time is None:
            raise ArgumentError.of("time", None, "a motion has looks at known times", _TIMES)
        groups.setdefault(look.group, []).append(look)
    for group, looks in groups.items():
        if len(looks) < FEWEST:
            bound = f"a motion has {FEWEST} at least"
            raise ArgumentError.of(f"looks of group {group}", len(looks), bound, "Leave the group out.")
    ordered = [sorted(looks, key=lambda look: checks.number("time", look.time)) for looks in groups.values()]
    return [Recording(looks, longest) for looks in ordered]


def beside(frames: Array, offset: Pose | None) -> Array:
    """(T, 7): frames (T, 7), each times a pose."""
    if offset is None:
        return frames
    x, y, z, w = frames[:, 3:].T
    a, b, c, d = offset.quaternion
    q = np.stack((w * a + x * d + y * c - z * b, w * b - x * c + y * d + z * a, w * c + x * b - y * a + z * d,
                  w * d - x * a - y * b - z * c), axis=1)  # fmt: skip
    u, v = frames[:, 3:6], np.broadcast_to(offset.position, (len(frames), 3))
    t = 2.0 * np.cross(u, v)
    return np.hstack((frames[:, :3] + v + w[:, None] * t + np.cross(u, t), q))


def _nearest(line: Array, points: Array) -> Array:
    """(m, 3): of a polygon (n, 3), what is nearest to each of points (m, 3)."""
    edges = np.diff(line, axis=0)
    way = points[:, None] - line[None, :-1]
    x = np.clip((way * edges).sum(axis=2) / (edges * edges).sum(axis=1), 0.0, 1.0)
    feet = line[None, :-1] + x[:, :, None] * edges
    best = ((points[:, None] - feet) ** 2).sum(axis=2).argmin(axis=1)
    return np.asarray(feet[np.arange(len(points)), best])
