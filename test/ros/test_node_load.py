"""Input faster than the node, a defect inside a cycle, and a node that is gone when it has ended."""

import os
import signal
import subprocess
import sys
import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from harness import ALONG_X, MOVER, TIMEOUT, child_of, values_of, viewer_of, wait_until_gone

from cable_shape.pose import Grip, Pose
from cable_shape.ros.diagnostics import Level
from cable_shape.ros.node import CableShapeNode
from cable_shape.ros.sources import Ready

BURST = 3000


def number_of(status, text):
    return sum(int(value) for key, value in values_of(status).items() if text in key)


def test_of_input_faster_than_the_node_the_newest_is_used_and_the_rest_counted(start):
    node = start(model="cosserat", points=1500, diagnostics_period=0.2)  # a cycle takes longer than to send its input
    node.predicted()
    node.spin(0.5)
    before = node.diagnosis("input", "")
    sent = node.pairs
    for _ in range(BURST):
        node.pair()
    node.predicted()
    node.shapes.clear()
    node.spin(0.5)
    assert node.shapes == []  # nothing waits in a queue
    names = ("overtaken or lost on ", "pairs", "messages without a partner")

    def counted():
        after = node.diagnosis("input", "")
        missed, pairs, alone = (number_of(after, name) - number_of(before, name) for name in names)
        counts = missed + 2 * pairs + alone, missed, pairs
        return counts if counts[0] >= 2 * (node.pairs - sent) - 64 else None  # those that wait for a partner

    counts, missed, pairs = node.until(counted, "all that was sent in the counts")
    assert counts <= 2 * (node.pairs - sent) + 16  # what was under way when the first counts were taken
    assert missed > BURST / 10
    assert pairs < BURST
    assert node.process.stop() == 0


def test_a_defect_inside_a_cycle_is_told_and_the_node_goes_on(cable_file, monkeypatch):
    rclpy.init(args=["--ros-args", "-p", f"cable_file:={cable_file}", "-r", "__ns:=/defect"])
    node = CableShapeNode()
    try:
        node.trigger_configure()
        node.trigger_activate()
        grips = {"cable": tuple(Grip(Pose((x, 0.0, 0.5), ALONG_X)) for x in (0.0, 0.8))}

        def run(k):
            node._run(Ready(10**9 + k, "world", lambda: (grips, None)))
            return next(v for v in node._health.verdicts(10**9 + k) if v.name == "input")

        with monkeypatch.context() as patch:
            patch.setattr(type(node._assembly.cycle), "step", lambda *_, **__: 1 // 0)
            verdict = run(1)
        assert verdict.level is Level.ERROR
        assert "a defect ended this cycle (ZeroDivisionError: " in verdict.message
        assert run(2).level is Level.WARN  # it ran; what was wrong stays for a while
        assert node._health.cycles == 1
    finally:
        node.close()
        node.destroy_node()
        rclpy.shutdown()


def listed(node):
    """Nodes of the namespace under test."""
    return [name for name, space in node.node.get_node_names_and_namespaces() if space == f"/{node.process.namespace}"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_has_ended_is_gone_from_the_graph_with_its_planner_and_viewer(start, tmp_path, number):
    node = start(planner="true", output_folder=tmp_path, view="seen.rrd")
    node.until(lambda: "cable_shape_node_planner" in listed(node), "planner")
    node.predicted()
    children = child_of(node, "cable_shape.ros.planning"), viewer_of(node)
    assert node.process.stop(number) == 0
    wait_until_gone(*children)
    other = subprocess.Popen([sys.executable, MOVER, f"/{node.process.namespace}"])
    try:
        end = time.monotonic() + TIMEOUT
        while "mover" not in listed(node):  # whose news came after theirs
            assert time.monotonic() < end
            time.sleep(0.05)
    finally:
        other.kill()
        other.wait()
    assert not set(listed(node)) & {"cable_shape_node", "cable_shape_node_planner"}  # without a farewell, for 20 s more


def test_a_viewer_that_is_stopped_holds_up_neither_cycles_nor_the_end(start, tmp_path):
    node = start(output_folder=tmp_path, view="seen.rrd")
    node.predicted()
    viewer = viewer_of(node)
    os.kill(viewer, signal.SIGSTOP)
    for _ in range(20):
        node.predicted()
    node.diagnosis("lifecycle", "active", DiagnosticStatus.OK)
    assert node.process.stop() == 0
    wait_until_gone(viewer)
