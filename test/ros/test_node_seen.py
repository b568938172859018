"""Clouds of what is seen of the cable, over DDS: they correct the shape, late or early, and other things do not."""

from __future__ import annotations

import numpy as np
import pytest
from cable_shape_msgs.msg import CableShape
from clouds import ALONG_X, cloud
from diagnostic_msgs.msg import DiagnosticStatus
from harness import cloud_message, nanoseconds
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

import cable_shape as cs
from cable_shape.messages.fields import shape_from

GIVEN = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
START, END = cs.Pose((0.0, 0.0, 0.5), ALONG_X), cs.Pose((0.8, 0.0, 0.5), ALONG_X)
#: What hangs there instead.
TRUE = cs.predict(GIVEN.replace(bending_stiffness=0.03, rest_curvature=(0.0, 1.0, 0.0)), START, END)


@pytest.fixture
def seen(start):
    """A node that listens to clouds, and what sends them."""
    cell = start(points_seen="true", diagnostics_period=0.3)
    sensor = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = cell.node.create_publisher(PointCloud2, "cable/points_seen", sensor)
    cell.until(publisher.get_subscription_count, "subscription to cable/points_seen")

    def send(points: np.ndarray, stamp: int, frame: str = "world") -> None:
        publisher.publish(cloud_message(points, stamp, frame))

    cell.send = send
    return cell


def off(message: CableShape) -> float:
    """[m], of the shape in a message from what hangs there."""
    return float(np.linalg.norm(shape_from(message).positions - TRUE.positions, axis=1).mean())


def corrected(cell, lag: int) -> None:
    """Clouds that are so late [ns] bring the shape there."""
    before = off(cell.predicted())
    assert before > 0.015
    stamps: list[int] = []

    def publish() -> None:
        stamps.append(cell.pair())
        if len(stamps) > 1:
            cell.send(cloud(TRUE, len(stamps), hidden=(0.5, 0.8)), stamps[-2] - lag)

    def near() -> bool:
        mine = [m for m in cell.shapes[-3:] if nanoseconds(m.header.stamp) in stamps]
        return bool(mine) and off(mine[-1]) < 0.3 * before

    cell.send_until(publish, near, "shape that is corrected")


def test_what_is_seen_corrects_the_shape(seen):
    corrected(seen, 0)


def test_a_cloud_that_comes_late_is_compared_with_the_grips_of_its_time(seen):
    for _ in range(5):
        seen.predicted()
    corrected(seen, 1)


def test_strays_and_other_frames_change_nothing_and_are_told(seen):
    shape = seen.predicted()
    strays = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3))
    seen.diagnosis(
        "input", "the cable is not among the 200 points", DiagnosticStatus.WARN,
        lambda: seen.send(strays, seen.pair() - 1),
    )  # fmt: skip
    seen.diagnosis(
        "input", "header.frame_id = 'camera' is not allowed", DiagnosticStatus.WARN,
        lambda: seen.send(strays, seen.pair() - 1, "camera"),
    )  # fmt: skip
    assert off(seen.predicted()) == pytest.approx(off(shape), abs=1e-6)


def test_several_cables_are_not_tracked(start, tmp_path):
    one = "{length: 1.0, linear_density: 0.1, bending_stiffness: 0.01}"
    file = tmp_path / "two.yaml"
    file.write_text(f"cables: {{a: {one}, b: {one}}}\n")
    cell = start(cable_file=file, points_seen="true", active=False)
    cell.diagnosis(
        "lifecycle", "points_seen = True is not allowed: one cable or harness is tracked; there are 2", level=None
    )
