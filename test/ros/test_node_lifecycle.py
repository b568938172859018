"""Lifecycle by service, signals, and the clock of a simulator."""

import os
import signal
import subprocess
import sys

import pytest
from builtin_interfaces.msg import Time
from harness import nanoseconds, viewer_of, wait_until_gone
from rosgraph_msgs.msg import Clock

CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE, INACTIVE_SHUTDOWN = 1, 2, 3, 4, 6


def test_every_transition_by_service(start):
    node = start(autostart="false", active=False)
    assert node.state() == "unconfigured"
    assert node.transition(CONFIGURE)
    assert node.state() == "inactive"
    node.until(lambda: node.node.count_publishers("cable/shape"), "topics after configure")
    node.until(lambda: all(p.get_subscription_count() for p in node.grippers), "the node on both topics")
    for _ in range(3):
        node.pair()
        node.spin(0.05)
    assert node.shapes == []  # inactive: input is not used
    node.diagnosis("input", "inactive: input is not used")
    assert node.transition(ACTIVATE)
    node.predicted()
    assert node.transition(DEACTIVATE)
    node.spin(0.1)
    node.shapes.clear()
    for _ in range(3):
        node.pair()
        node.spin(0.05)
    assert node.shapes == []
    assert node.transition(CLEANUP)
    assert node.state() == "unconfigured"
    node.until(lambda: not node.node.count_publishers("cable/shape"), "topics gone after cleanup")
    assert node.set(points=20).successful
    assert node.transition(CONFIGURE)
    assert node.transition(ACTIVATE)
    assert len(node.predicted().arc_length) == 20
    assert node.transition(DEACTIVATE)
    assert node.transition(INACTIVE_SHUTDOWN)
    assert node.state() == "finalized"
    assert node.process.stop() == 0


def test_a_transition_that_is_not_possible_is_answered_and_the_node_lives(cell):
    assert not cell.transition(CONFIGURE)
    assert not cell.transition(99)
    assert cell.state() == "active"
    cell.predicted()
    assert "transition 1 is not possible: the node is active. Possible: " in cell.process.text()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_exit_code_0(start, number):
    node = start(fresh=True)
    node.predicted()
    assert node.process.stop(number) == 0
    assert "Traceback" not in node.process.text()


def test_simulated_time_never_heard_is_told_and_followed_once_it_runs(start):
    node = start(use_sim_time="true", active=False)
    node.diagnosis("input", "nothing came on /clock", b"\x01")
    clock = node.node.create_publisher(Clock, "/clock", 1)
    stamps = []

    def stepped():
        now = 50_000_000_000 + 20_000_000 * len(stamps)
        clock.publish(Clock(clock=Time(sec=now // 10**9, nanosec=now % 10**9)))
        stamps.append(node.pair(now))
        node.spin(0.02)
        fresh = [s for m in node.diagnostics[-1:] for s in m.status if s.name.endswith(": input")]
        return node.shapes and any(s.level == b"\x00" for s in fresh)

    node.until(stepped, "shapes and diagnostics OK in simulated time")
    assert nanoseconds(node.shapes[-1].header.stamp) in stamps
    assert nanoseconds(node.diagnostics[-1].header.stamp) < 10**12  # simulated, not since 1970
    assert node.process.stop() == 0


def test_a_viewer_file_is_written_and_closed(start, tmp_path):
    file = tmp_path / "seen.rrd"
    node = start(output_folder=tmp_path, view=file)
    node.predicted()
    node.until(file.exists, "recording")
    viewer = viewer_of(node)
    assert node.process.stop() == 0
    wait_until_gone(viewer)  # it is left to write on
    assert file.read_bytes()[:4] == b"RRF2"


INTERRUPTED = """
import sys
import rclpy
from cable_shape.ros import node
create = node.CableShapeNode.__init__
def interrupted(self):
    {}
    create(self)
node.CableShapeNode.__init__ = interrupted
sys.exit(node.main())
"""


@pytest.mark.parametrize("signalled", ["rclpy.shutdown()", "raise KeyboardInterrupt"])
def test_a_signal_while_the_node_is_made_ends_it_well(signalled):
    program = INTERRUPTED.format(signalled)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, env=os.environ)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
