"""The node's publishers: :class:`Outputs`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import final

from nav_msgs.msg import Path
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import widest
from cable_shape.ros import conversions, messages
from cable_shape.safety.report import CycleReport
from cable_shape.shape import CableShape

#: [s], least time between the messages for drawing: a Path of 150 poses takes rclpy longer to build than a whole cycle
DRAWING_PERIOD = 0.03

LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@final
class Outputs:
    """Publishes what a cycle found, each message only while someone listens.

    Shape, warnings, margins and tubes go out every cycle, markers, path and points at most every `DRAWING_PERIOD`. The
    warnings alone are sent without a listener, too, since one who comes later gets the last ones.
    """

    def __init__(self, node: LifecycleNode, cables: Mapping[str, Cable]) -> None:
        self._node = node
        self.take(cables)
        self._drawn = -DRAWING_PERIOD
        make = node.create_lifecycle_publisher
        each = QoSProfile(depth=len(cables), reliability=ReliabilityPolicy.RELIABLE)  # a message for each cable
        self._shape: LifecyclePublisher = make(messages.CableShape, "cable/shape", each)
        self._warnings: LifecyclePublisher = make(messages.CableWarnings, "cable/warnings", LATCHED)
        self._margins: LifecyclePublisher = make(messages.CableMargins, "cable/margins", LATEST)
        self._markers: LifecyclePublisher = make(MarkerArray, "cable/markers", LATEST)
        self._path: LifecyclePublisher = make(Path, "cable/path", each)
        self._points: LifecyclePublisher = make(PointCloud2, "cable/points", LATEST)
        self._tube: LifecyclePublisher = make(messages.CableTube, "cable/tube", each)

    def take(self, cables: Mapping[str, Cable]) -> None:
        """The cables are these now."""
        self._diameters = {name: widest(cable) for name, cable in cables.items()}

    def publish_shapes(self, shapes: Mapping[str, CableShape], stamp: int, frame_id: str) -> None:
        """Sends the shapes under the `stamp` [ns] of their input."""
        if self._shape.get_subscription_count():
            header = conversions.header_of(stamp, frame_id)
            for cable_id, shape in shapes.items():
                self._shape.publish(conversions.shape_message(cable_id, shape, header))

    def publish(self, report: CycleReport, frame_id: str, lifetime: float) -> None:
        """Sends the rest of a report under the stamp of its input; markers vanish after `lifetime` [s]."""
        header = conversions.header_of(report.stamp, frame_id)
        self._warnings.publish(conversions.warnings_message(report, header))
        if self._margins.get_subscription_count():
            self._margins.publish(conversions.margins_message(report, header))
        if report.tubes and self._tube.get_subscription_count():
            for cable_id, tube in report.tubes.items():
                self._tube.publish(conversions.tube_message(cable_id, tube, header))
        now = time.monotonic()
        if now - self._drawn < DRAWING_PERIOD:
            return
        self._drawn = now
        if self._markers.get_subscription_count():
            self._markers.publish(conversions.marker_message(report, self._diameters, header, lifetime))
        if self._path.get_subscription_count():
            for shape in report.shapes.values():
                self._path.publish(conversions.path_message(shape, header))
        if self._points.get_subscription_count():
            self._points.publish(conversions.points_message(report.shapes, header))

    def destroy(self) -> None:
        """Takes the topics away."""
        drawn = (self._markers, self._path, self._points)
        for publisher in (self._shape, self._warnings, self._margins, self._tube, *drawn):
            self._node.destroy_lifecycle_publisher(publisher)
