"""Points that a camera sees correct the shape that is published: :class:`Seeing`."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, final

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from cable_shape.checks import Array
from cable_shape.cycle.dynamic import links_between
from cable_shape.cycle.seen import AsSeen
from cable_shape.errors import ArgumentError, CableShapeError, InputError
from cable_shape.messages.pairing import SECOND
from cable_shape.pose import FreeEnd, Grip, Pose, as_grip, between
from cable_shape.ros import conversions
from cable_shape.ros.assembly import Assembly
from cable_shape.ros.calibration_messages import points_of
from cable_shape.ros.diagnostics import Health
from cable_shape.ros.parameters import Settings
from cable_shape.ros.qos import SENSOR
from cable_shape.tracking.tracker import Tracker

Held = Mapping[str, Grip | FreeEnd]
Links = Mapping[str, Pose] | None

TOPIC = "cable/points_seen"
#: Cycles whose grips are kept, for clouds that come late; points of a cloud at most.
_KEPT, _MOST = 2000, 20_000


@final
class Seeing:
    """A tracker of the node's one cable or harness, which hears clouds and is asked for the shape of every cycle.

    A cloud is compared with the grips, and the robot's links, at its own stamp, between those of the cycles before and
    after; the newest one that is ahead of the grips waits for them.
    """

    def __init__(
        self, node: Node, settings: Settings, assembly: Assembly, health: Health, now: Callable[[], int]
    ) -> None:
        if len(assembly.holdings) != 1:
            bound = f"one cable or harness is tracked; there are {len(assembly.holdings)}"
            raise ArgumentError.of("points_seen", True, bound, "Leave it out, or name a file of one.")
        self._node, self._settings, self._assembly = node, settings, assembly
        self._health, self._now = health, now
        self._name = assembly.holdings[0].cable_id
        self._frame_id = ""
        self._taken = self._missed = 0
        self.take()
        self._subscription = node.create_subscription(PointCloud2, TOPIC, self._hear, SENSOR)

    @property
    def counts(self) -> dict[str, int]:
        """For the diagnostics: clouds used, those on which the cable was not, and how odd the last was, in per cent."""
        odd = self._tracker.innovation
        told = {"clouds seen": self._taken, "clouds without the cable": self._missed}
        return {**told, "innovation [%]": round(100.0 * odd)} if np.isfinite(odd) else told

    def take(self) -> None:
        """The cable, or what is around it, is another one: all begins anew."""
        cycle, known = self._assembly.cycle, self._assembly.uncertainty
        options: dict[str, Any] = {"gravity": self._settings.gravity, "points": self._settings.points}
        robot, scene = self._assembly.robot, cycle.scene
        solved = scene is not None and scene.contact == "solve"
        self._on_links = solved or any(clip.link is not None for clip in (() if scene is None else scene.clips))
        if robot is not None:
            options |= {"robot_links": robot.link_geometry, "gripping_links": robot.gripping_links}
        file = self._assembly.harnesses.get(self._name)
        what = cycle.cables[self._name] if file is None else file.harness
        self._tracker: Any = Tracker(what, cycle.scene, uncertainty=known, **options)
        self._tubes = known is not None
        self.restart()

    def restart(self) -> None:
        """The input's clock was set back."""
        self._tracker.reset()
        self._grips: deque[tuple[int, Held, Links]] = deque(maxlen=_KEPT)
        self._waiting: tuple[int, Array] | None = None

    def destroy(self) -> None:
        """Takes the topic away."""
        self._node.destroy_subscription(self._subscription)

    def seen(
        self, grips: Mapping[str, Any], stamp: int, frame_id: str, links: Callable[[], Links] | None
    ) -> dict[str, AsSeen]:
        """Of a cycle with these grips the shape by what was seen; nothing while the cable is lost.

        links: places the robot's links, if what holds or keeps out the cable is on them; None: nobody knows.
        """
        held = _held(grips[self._name])
        placed = links() if links is not None and self._on_links else None
        self._frame_id = frame_id
        self._grips.append((stamp, held, placed))
        if self._waiting is not None and self._waiting[0] <= stamp:
            seen, self._waiting = self._waiting, None
            self._look(*seen)
        if self._tracker.lost:
            return {}
        shape, tube = self._tracker.expected(stamp, tube=self._tubes, links=placed, **_keywords(held))
        return {self._name: AsSeen(shape, tube, self._tracker.rod_state)} if shape.usable else {}

    def _hear(self, message: PointCloud2) -> None:
        """A cloud came."""
        if not self._grips:
            return
        stamp = conversions.nanoseconds(message.header.stamp)
        try:
            if message.header.frame_id != self._frame_id:
                bound = f"it must be {self._frame_id!r}, that of the grips: nothing is transformed here"
                raise InputError(f"header.frame_id = {message.header.frame_id!r} is not allowed: {bound}.")
            points, _ = points_of(message)
            points = points[np.isfinite(points).all(axis=1)]
            if len(points) > _MOST:
                raise InputError(f"{len(points)} points are too many: at most {_MOST}. Cut the cable out, and thin it.")
            if stamp > self._grips[-1][0]:
                self._waiting = stamp, points
            else:
                self._look(stamp, points)
        except CableShapeError as error:
            self._health.remark(TOPIC, f"{TOPIC}: not used: {error}", self._now())

    def _look(self, stamp: int, points: Array) -> None:
        """Takes points seen at a stamp that the grips' have reached."""
        held, links = self._then(stamp)
        try:
            self._tracker.update(points, stamp=stamp, links=links, **_keywords(held))
        except CableShapeError as error:
            self._health.remark(TOPIC, f"{TOPIC}: not used: {error}", self._now())
            return
        self._taken += 1
        self._missed += self._tracker.lost
        if self._tracker.lost:
            text = f"{TOPIC}: the cable is not among the {len(points)} points; the shape is the predicted one. "
            self._health.remark(
                TOPIC, text + "Look at the segmentation, the frame and the cable's numbers.", self._now()
            )
        elif self._tracker.innovation > self._tracker.ODD:
            text = (
                f"{TOPIC}: innovation {self._tracker.innovation:.1f}, usual is 1: this is not the cable of cable_file. "
            )
            self._health.remark(TOPIC, text + "Calibrate it, or name its file.", self._now())

    def _then(self, stamp: int) -> tuple[Held, Links]:
        """The ends and links at a stamp, between two cycles on the straight way.

        Raises
        ------
        InputError
            If it is before all that is kept.
        """
        stamps = [one[0] for one in self._grips]
        i = bisect_right(stamps, stamp)
        if i == 0:
            ago = (stamps[-1] - stamp) / SECOND
            raise InputError(f"stamp {ago:.3f} s before the newest grips: older than all grips that are kept.")
        if i == len(stamps) or stamps[i - 1] == stamp:
            return self._grips[i - 1][1:]
        (before, old, left), (after, new, right) = self._grips[i - 1], self._grips[i]
        share = (stamp - before) / (after - before)
        held = {name: _between(old[name], end, share) if name in old else end for name, end in new.items()}
        if left is None or right is None:
            return held, right
        return held, links_between(left, right, share)


def _held(ends: Any) -> Held:
    """What holds each end, of a cable or of a harness."""
    if isinstance(ends, Mapping):
        return {name: _end(name, end) for name, end in ends.items()}
    start, end = ends
    return {"start": _end("start", start), "end": _end("end", end)}


def _end(name: str, end: Any) -> Grip | FreeEnd:
    return FreeEnd() if end is None else end if isinstance(end, FreeEnd) else as_grip(name, end)


def _keywords(held: Held) -> dict[str, Any]:
    """Of a tracker's methods, which takes the ends of a harness in one."""
    return dict(held) if held.keys() == {"start", "end"} else {"ends": held}


def _between(a: Grip | FreeEnd, b: Grip | FreeEnd, share: float) -> Grip | FreeEnd:
    """A grip on its way."""
    if isinstance(a, FreeEnd) or isinstance(b, FreeEnd) or a.kind != b.kind:
        return a
    return b.at(Pose.trusted(between(a.pose.array, b.pose.array, share), b.pose.turns))
