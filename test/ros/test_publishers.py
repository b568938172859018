"""Two publishers on a gripper's topic, and publishers of another type: real nodes over DDS."""

import os
import signal
import subprocess
import sys

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from harness import MOVER, nanoseconds, values_of
from std_msgs.msg import String

WARN, ERROR = DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Peer:
    """A node of another process's kind: with a participant of its own."""

    def __init__(self, name, namespace, kind, topic):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(name, namespace=f"/{namespace}", context=self.context)
        self.publisher = self.node.create_publisher(kind, topic, 10)

    def close(self):
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def node(start):
    node = start(diagnostics_period=0.2, stale_after=0.4)
    node.predicted()
    return node


def intruded(node, side="left", kind=PoseStamped):
    peer = Peer("intruder", node.process.namespace, kind, f"{side}_gripper/pose")
    if kind is PoseStamped:
        node.until(peer.publisher.get_subscription_count, "the intruder's match")
    return peer


def test_of_two_publishers_nothing_is_used_and_both_are_named(node):
    peer = intruded(node)
    space = node.process.namespace
    names = f"left_gripper/pose: publishers /{space}/cell and /{space}/intruder mix: none of their messages is used"
    try:
        node.diagnostics.clear()

        def wrong():
            message = PoseStamped()
            stamp = node.now()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            message.header.frame_id = "world"
            message.pose.position.z, message.pose.position.y = 0.5, 0.3
            o = message.pose.orientation
            o.x = o.y = o.z = o.w = 0.5
            peer.publisher.publish(message)
            node.spin(0.02)

        def told():
            node.pair()
            wrong()  # at once, so that it is the newest while this process sleeps
            lines = [s for m in node.diagnostics for s in m.status if s.name.endswith(": input")]
            return next((line for line in lines if line.level == ERROR and names in line.message), None)

        status = node.until(told, "diagnostics about a mixture")
        began = node.now()
        for _ in range(100):
            told()
        node.spin(0.5)
        assert not [m for m in node.shapes if nanoseconds(m.header.stamp) >= began]
        assert int(values_of(status)["refused: left_gripper/pose publishers"]) > 0
    finally:
        peer.close()
    assert node.predicted().usable
    assert node.process.stop() == 0


def test_a_second_publisher_that_is_silent_is_told_and_does_no_harm(node):
    peer = intruded(node, "right")
    try:
        names = f"/{node.process.namespace}/cell and /{node.process.namespace}/intruder"
        node.diagnosis("input", f"right_gripper/pose has several publishers, {names}: used as long as", WARN)
        stamp = nanoseconds(node.predicted().header.stamp)
        assert nanoseconds(node.predicted().header.stamp) > stamp
    finally:
        peer.close()


def test_one_that_is_killed_and_started_again_is_used_before_the_first_is_forgotten(node):
    """For some 20 s the middleware takes the killed one for alive."""
    command = [sys.executable, MOVER, f"/{node.process.namespace}"]
    for publisher in node.grippers:
        node.node.destroy_publisher(publisher)

    def known():
        """How many publishers are, once the shapes of a new one come; it is killed then."""
        node.shapes.clear()
        process = subprocess.Popen(command, env=os.environ)
        try:
            node.until(lambda: len(node.shapes) > 30, "shapes of a motion")
            return node.node.count_publishers("left_gripper/pose")
        finally:
            process.send_signal(signal.SIGKILL)
            process.wait()

    known()
    node.until(lambda: known() > 1, "shapes of one while that before it is known")


def test_a_publisher_of_another_type_is_named(node):
    peer = intruded(node, "right", String)
    try:
        told = f"right_gripper/pose: /{node.process.namespace}/intruder publishes std_msgs/msg/String there, it must be"
        node.diagnosis("input", f"{told} geometry_msgs/msg/PoseStamped", ERROR)  # its name may come after its type
        assert node.predicted().usable
    finally:
        peer.close()
