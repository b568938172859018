"""The calibrator's process: action CalibrateCable, and a calibration that goes on by a topic of points.

    python -m cable_shape.ros.calibrating SETUP SERVES CLIENTS NEWS

SETUP is a descriptor of a :class:`~cable_shape.ros.workers.CalibratorSetup` in JSON; for the others see
:mod:`cable_shape.ros.serving`. Standard input, by ending, ends the process. Started by
:class:`~cable_shape.ros.worker.WorkerProcess`. Nothing here reaches the cycles.
"""

from __future__ import annotations

import dataclasses
import os
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any, final

from geometry_msgs.msg import PoseStamped
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import ok
from sensor_msgs.msg import PointCloud2

from cable_shape.cable.cable import Cable
from cable_shape.cable.cable_file import CableFile
from cable_shape.cable.harness import Harness
from cable_shape.calibration.fit import calibrate
from cable_shape.calibration.online import Gatherer
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import ArgumentError, CableShapeError, InputError, UnknownKeyError
from cable_shape.files.files import safe_output
from cable_shape.messages.pairing import SECOND, FrameGuard
from cable_shape.pose import IDENTITY, Grip, Pose
from cable_shape.prediction.layout import Layout, cable_id
from cable_shape.ros import conversions
from cable_shape.ros.calibration_messages import asked, calibration_message, file_of, look_at, points_of
from cable_shape.ros.following import Following
from cable_shape.ros.goals import Feedback, Goals
from cable_shape.ros.messages import CableCalibration, CalibrateCable
from cable_shape.ros.serving import Gate, given, leave, news, serve
from cable_shape.ros.workers import CalibratorSetup

_QUEUE = 50  # messages that wait while a fit is computed

#: By the names of cables and harnesses.
Files = dict[str, CableFile | HarnessFile]


@final
class Action:
    """CalibrateCable; one goal is worked on at a time."""

    def __init__(self, node: Node, setup: CalibratorSetup, files: Files, gate: Gate, following: Following) -> None:
        self._setup, self._files, self._following = setup, files, following
        Goals(node, CalibrateCable, setup.action, self._calibrate, {"partial": True}, gate.check)

    def _calibrate(self, goal: Any, result: Any) -> None:
        began = time.monotonic()
        result.found, result.partial = self._found(goal)
        result.success = True
        result.time = time.monotonic() - began

    def _found(self, goal: Any) -> tuple[CableCalibration, bool]:
        """The calibration, with feedback, and whether it was ended before it converged."""
        request = goal.request
        name = request.cable_id
        if not name and len(self._files) == 1:
            name = next(iter(self._files))
        if name not in self._files:
            raise UnknownKeyError.among("cable_id", name, self._files)
        harness, made = of_harness(self._files[name]), made_now(self._files[name], name, self._following)
        wanted = asked(request, self._setup, harness)
        ends = time.monotonic() + wanted.time_limit
        feedback = Feedback(goal, at_once=True)
        cut = False

        def proceed(iteration: int, scale: float) -> bool:
            nonlocal cut
            feedback.offer(lambda: CalibrateCable.Feedback(iteration=iteration, scale=float(scale)))
            cut = time.monotonic() >= ends or goal.is_cancel_requested
            return not cut

        found: Any = calibrate(
            wanted.observations, made, wanted.fit, priors=wanted.priors,
            gravity=self._setup.gravity, proceed=proceed, progress=False,
        )  # fmt: skip
        return calibration_message(name, found, len(wanted.observations), harness), cut


@final
class Online:
    """Calibrates each cable or harness again and again by the newest observations that the topics bring."""

    def __init__(self, node: Node, setup: CalibratorSetup, files: Files, following: Following) -> None:
        self._node, self._setup, self._files, self._following = node, setup, files, following
        self._done = dict.fromkeys(setup.topics, 0)  # observations taken at the last fit
        self._gatherers: dict[str, Gatherer] = {}
        self._refused: set[str] = set()
        self._heard: dict[str, Any] = {}  # topic -> subscription
        queue = QoSProfile(depth=_QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
        depth = max(1, len(files))
        latched = QoSProfile(
            depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
        )
        self._results = node.create_publisher(CableCalibration, setup.result, latched)
        group = MutuallyExclusiveCallbackGroup()
        for name, (*grips, points) in setup.topics.items():
            gatherer = self._gatherers[name] = self._gatherer(files[name])
            frame = FrameGuard("")
            for side, topic in enumerate(grips):
                take = partial(self._take_pose, gatherer, frame, side, topic)
                self._heard[topic] = node.create_subscription(PoseStamped, topic, take, queue, callback_group=group)
            take = partial(self._take_points, gatherer, frame, points)
            self._heard[points] = node.create_subscription(PointCloud2, points, take, queue, callback_group=group)
        threading.Thread(target=self._refine, daemon=True).start()

    def _gatherer(self, file: CableFile | HarnessFile) -> Gatherer:
        """Of a cable as the parameters say how it is held, or of a harness as its file does."""
        setup = self._setup
        skew = round(setup.max_skew * SECOND)
        if isinstance(file, HarnessFile):
            grips = tuple(file.grips.values())
            make, thin = partial(look_at, file), not file.markers
            return Gatherer(file.harness, grips, skew, setup.window, setup.gravity, make, thin=thin)
        start, end = (
            held.told(kind).grip(Grip(IDENTITY, offset=Pose(offset[:3], offset[3:])))
            for held, kind, offset in zip(file.held, setup.kinds, setup.offsets, strict=True)
        )
        return Gatherer(file.cable, (start, end), skew, setup.window, setup.gravity)

    def _take_pose(self, gatherer: Gatherer, frame: FrameGuard, side: int, topic: str, message: PoseStamped) -> None:
        try:
            self._alone(topic)
            frame.check(topic, message.header.frame_id)
            gatherer.pose(side, conversions.nanoseconds(message.header.stamp), conversions.pose_of(message))
        except CableShapeError as error:
            self._refuse(topic, error)

    def _take_points(self, gatherer: Gatherer, frame: FrameGuard, topic: str, message: PointCloud2) -> None:
        try:
            self._alone(topic)
            frame.check(topic, message.header.frame_id)
            points, arc_length = points_of(message)
            if not len(points):
                raise InputError("the cloud is empty.")
            gatherer.points(conversions.nanoseconds(message.header.stamp), points, arc_length)
        except CableShapeError as error:
            self._refuse(topic, error)

    def _alone(self, topic: str) -> None:
        """Observations can wait until a publisher is alone, or known to have died.

        Raises
        ------
        InputError
        """
        count = self._heard[topic].handle.get_publisher_count()
        if count > 1:
            raise InputError(f"{count} publishers are known, one is expected. End the others, or remap their topics.")

    def _refuse(self, topic: str, error: CableShapeError) -> None:
        """Says once for each topic what is wrong with its messages."""
        if topic not in self._refused:
            self._refused.add(topic)
            self._node.get_logger().warning(f"{topic}: not used: {error}")

    def _refine(self) -> None:
        """Until the process ends."""
        try:
            while ok():
                time.sleep(self._setup.period)
                for name, gatherer in self._gatherers.items():
                    if gatherer.taken > self._done[name]:
                        self._done[name] = gatherer.taken
                        self._fit(name, gatherer)
        except RuntimeError:  # rclpy's own, when the end comes while a fit is told
            if ok():
                raise

    def _fit(self, name: str, gatherer: Gatherer) -> None:
        """One fit, told on the topic and in the file."""
        stamp, seen = gatherer.observations()
        log = self._node.get_logger()
        try:
            file = self._files[name]
            made = made_now(file, name, self._following)
            found: Any = calibrate(seen, made, self._setup.fit, gravity=self._setup.gravity, progress=False)
        except CableShapeError as error:
            log.warning(f"{name}: {len(seen)} observations do not give a cable: {error}")
            return
        if isinstance(file, CableFile):
            start, end = (held.then(new) for held, new in zip(file.held, found.grips, strict=True))
            found = dataclasses.replace(found, grips=(start, end))
        message = calibration_message(name, found, len(seen), of_harness(file))
        message.header.stamp = conversions.time_of(stamp)
        self._results.publish(message)
        log.info(f"{name}, {len(seen)} observations: " + "; ".join(f"{e.name} {e}" for e in found.estimates))
        if self._setup.file and found.converged:
            try:
                write(file_of(found, of_harness(file)), self._file(name))
            except ArgumentError as error:
                log.error(f"calibration_file: {error}")
            except OSError as error:
                log.error(f"calibration_file: {error}. Make room there, or name another.")

    def _file(self, name: str) -> Path:
        """Of several cables, and harnesses, each has a file of its own."""
        file = Path(self._setup.file)
        return file if len(self._files) == 1 else file.with_stem(f"{file.stem}_{name}")


def made_now(file: CableFile | HarnessFile, name: str, following: Following) -> Cable | Harness:
    """The cable or harness of a file, with the numbers that edits have set.

    Raises
    ------
    ArgumentError
        If edits have left it in other clips, or gripped elsewhere.
    """
    if isinstance(file, CableFile):
        return following.held_as_made(name).made
    segments = {one: following.held_as_made(cable_id(name, one)).made for one in file.harness.segments}
    return file.harness.replace(segments)


def of_harness(file: CableFile | HarnessFile) -> HarnessFile | None:
    """The file, if it is a harness's."""
    return file if isinstance(file, HarnessFile) else None


def write(text: str, file: Path) -> None:
    """Writes a cable's file as a whole or not at all, and over nothing but a cable that was written so.

    Raises
    ------
    ArgumentError
        If something else is there.
    OSError
    """
    file = safe_output(file.parent, file.name, (".yaml",))
    fresh = file.with_name(f".{file.name}.{os.getpid()}.new")
    fresh.unlink(missing_ok=True)
    try:
        with open(fresh, "x", encoding="utf-8") as out:
            out.write(text)
        fresh.replace(file)
    except OSError:
        fresh.unlink(missing_ok=True)
        raise


def main() -> int:
    """Calibrates as the node asked for."""
    setup = CalibratorSetup.from_json(given())

    def make(node: Node, gate: Gate) -> str:
        files: Files = {name: CableFile.from_mapping(values) for name, values in setup.cables.items()}
        files |= {name: HarnessFile.from_mapping(values, name) for name, values in setup.harnesses.items()}
        cables, harnesses = {}, {}
        for name, file in files.items():
            if isinstance(file, CableFile):
                cables[name] = file.cable
            else:
                harnesses[name] = file.harness
        following = Following(Layout.of(setup.scene, cables, {}, harnesses), news())
        if setup.action:
            Action(node, setup, files, gate, following)
        if setup.topics:
            Online(node, setup, files, following)
        return f"calibrating {', '.join(files)}: {setup.action or 'no action'}, {setup.topics}"

    return serve(setup, make)


if __name__ == "__main__":
    leave(main())
