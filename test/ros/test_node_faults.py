"""What happens in a cell: processes die, clocks loop, disks fill, caches rot, homes are closed. Real nodes over DDS."""

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from cable_shape_msgs.msg import CableWarnings
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from harness import (
    ALONG_X,
    LATCHED,
    MOVER,
    TIMEOUT,
    Cell,
    NodeProcess,
    nanoseconds,
    values_of,
    viewer_of,
    wait_until_gone,
)
from rerun.chunk import RrdReader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from cable_shape.kernels import poses
from cable_shape.kernels._jit import cache_folder
from cable_shape.messages.fields import shape_from
from cable_shape.robots.robot import Robot
from cable_shape.ros.parameters import find_file

WARN, ERROR = DiagnosticStatus.WARN, DiagnosticStatus.ERROR
POSSIBLE = {"unconfigured": {1: "inactive"}, "inactive": {2: "unconfigured", 3: "active"}, "active": {4: "inactive"}}


def test_a_tracker_that_is_killed_mid_motion_and_started_again(start):
    cell = start(stale_after=0.4, diagnostics_period=0.3)
    cell.predicted()  # the cell's own publishers stay known beside the tracker's, and are silent

    def tracker():
        return subprocess.Popen([sys.executable, MOVER, f"/{cell.process.namespace}"])

    for _ in range(2):
        cell.shapes.clear()
        process = tracker()
        try:
            cell.until(lambda: len(cell.shapes) > 30, "shapes of a motion")
        finally:
            process.kill()
            process.wait()
        killed = cell.now()
        cell.diagnosis("input", "stale: no message on left_gripper/pose and right_gripper/pose", WARN)
        cell.spin(0.5)
        stamps = [nanoseconds(m.header.stamp) for m in cell.shapes]
        assert len(set(stamps)) == len(stamps)
        assert max(stamps) < killed  # nothing is published again under a new stamp


def test_a_jump_of_half_a_metre_is_followed_and_told(cell):
    stamp, y = nanoseconds(cell.predicted().header.stamp), 0.0

    def jump():  # and back, if it was not told as long as it is
        nonlocal stamp, y
        stamp, y = stamp + 10_000_000, 0.5 - y
        shape = shape_from(cell.shape_at(stamp, (0.0, y, 0.5), (0.8, y, 0.5)))
        assert shape.status
        assert shape.positions[[0, -1]] == pytest.approx(np.array(((0.0, y, 0.5), (0.8, y, 0.5))), abs=1e-9)

    status = cell.diagnosis("input", "_gripper/pose jumped by 0.500 m within", WARN, jump)
    assert any(key.startswith("remarked: ") and key.endswith(" jump") for key in values_of(status))
    cell.predicted()


def test_left_and_right_that_change_places_are_told(cell):
    stamp, places = nanoseconds(cell.predicted().header.stamp), [(0.0, 0.0, 0.5), (0.8, 0.0, 0.5)]

    def swap():
        nonlocal stamp
        stamp += 10_000_000
        places.reverse()
        cell.shape_at(stamp, *places)

    cell.diagnosis("input", "left_gripper/pose and right_gripper/pose have changed places", WARN, swap)
    cell.predicted()


def test_a_bag_that_loops_in_simulated_time(start):
    node = start(use_sim_time="true", diagnostics_period=0.2)
    clock = node.node.create_publisher(Clock, "/clock", 1)

    def play(k):
        now = 50_000_000_000 + 20_000_000 * k
        clock.publish(Clock(clock=Time(sec=now // 10**9, nanosec=now % 10**9)))
        node.spin(0.01)
        node.pair(now)
        node.spin(0.01)
        return now

    k = 5000  # so near its end that it goes back by far more than a second

    def heard():
        nonlocal k
        k += 1
        play(k)
        return node.shapes

    node.until(heard, "shapes")
    for _ in range(100):
        heard()
    node.shape_at(50_000_000_000 + 20_000_000 * (k + 1))  # nothing of the first round is under way
    node.shapes.clear()
    again = []

    def answered():
        again.append(play(len(again)))  # from the start
        return node.shapes and nanoseconds(node.shapes[-1].header.stamp) in again

    node.until(answered, "shapes of the second round")
    for k in range(len(again), len(again) + 240):
        play(k)
    status = node.diagnosis("input", "")
    assert int(values_of(status)["clock restarts"]) == 1
    assert node.process.stop() == 0


def test_lifecycle_transitions_in_any_order_a_hundred_times_leave_nothing_behind(start):
    node = start(autostart="false", active=False)
    chance = random.Random(7)
    proc = Path(f"/proc/{node.process.process.pid}")

    def held():
        memory = next(line for line in (proc / "status").read_text().splitlines() if line.startswith("VmRSS"))
        return int(memory.split()[1]), len(list((proc / "task").iterdir())), len(list((proc / "fd").iterdir()))

    def home():
        while node.state() != "unconfigured":
            assert node.transition({"active": 4, "inactive": 2}[node.state()])

    state, before = node.state(), None
    for k in range(130):
        wanted = chance.choice((1, 2, 3, 4))
        reached = POSSIBLE[state].get(wanted)
        assert node.transition(wanted) == (reached is not None)
        state = reached or state
        if k % 10 == 0:
            assert node.state() == state
        if k == 30:  # what is loaded once is loaded
            home()
            state, before = "unconfigured", held()
    home()
    node.until(lambda: all(now <= then for now, then in zip(held()[1:], before[1:], strict=True)), "threads and files")
    assert held()[0] - before[0] < 20_000, "kB"  # a leaked cycle or robot would be more than that
    assert node.transition(1)
    assert node.transition(3)
    node.predicted()
    assert node.process.stop() == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_a_recording_that_can_be_read(start, tmp_path, number):
    file = tmp_path / "seen.rrd"
    node = start(output_folder=tmp_path, view=file)

    def written():  # the viewer's process takes a moment to start
        node.pair()
        node.spin(0.02)
        return file.exists() and file.stat().st_size > 4000

    node.until(written, "recording")
    viewer = viewer_of(node)
    assert node.process.stop(number) == 0
    wait_until_gone(viewer)  # it is left to write on
    assert "Traceback" not in node.process.text()
    chunks = list(RrdReader(str(file)).stream().to_chunks())
    shown = [chunk for chunk in chunks if "cable" in chunk.entity_path and not chunk.is_static]
    assert sum(chunk.to_record_batch().num_rows for chunk in shown) > 0


TOLD_TO_END = """
import signal
from geometry_msgs.msg import PoseStamped
from cable_shape.ros import interrupt, node

def told(self, **_):  # before rclpy, which hears of the signal, too
    interrupt.Interrupts._take(signal.SIGINT, None)

PoseStamped.__init__ = told
node.run()
"""


def test_a_signal_while_a_message_is_taken_ends_it(tmp_path, cable_file):
    process = NodeProcess("taken", tmp_path, ["-p", f"cable_file:={cable_file}"], code=TOLD_TO_END)
    node = Cell(process)
    try:
        node.active()

        def ended():
            node.pair()
            node.spin(0.02)
            return not process.alive

        node.until(ended, "end of the node")
        assert process.stop() == 0, process.text()
        assert "Traceback" not in process.text()
    finally:
        process.stop()
        node.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_during_configure_ends_it(start, number, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cold"))  # configure compiles for minutes
    node = start(active=False, fresh=True)
    end = time.monotonic() + TIMEOUT
    while "configuring" not in node.process.text():
        assert time.monotonic() < end
        time.sleep(0.05)
    time.sleep(1.0)
    assert node.process.stop(number) == 0


def test_a_full_disk_ends_the_recording_not_the_node(start, tmp_path):
    file = tmp_path / "seen.rrd"
    node = start(output_folder=tmp_path, view=file, diagnostics_period=0.2)
    node.predicted()
    node.until(file.exists, "recording")
    limit = file.stat().st_size + 20_000
    resource.prlimit(viewer_of(node), resource.RLIMIT_FSIZE, (limit, limit))

    def told():
        node.pair()
        node.spin(0.02)
        return next((s for m in node.diagnostics for s in m.status if "the viewer has ended" in s.message), None)

    status = node.until(told, "diagnostics about the viewer")
    assert "disk full" in status.message
    assert file.stat().st_size <= limit
    node.predicted()
    assert node.process.stop() == 0
    assert "the recording ends early" in node.process.text()
    assert "Traceback" not in node.process.text()


def test_a_viewer_that_is_killed_is_told(start, tmp_path):
    node = start(output_folder=tmp_path, view="seen.rrd", diagnostics_period=0.2)
    node.predicted()
    os.kill(viewer_of(node), signal.SIGKILL)
    node.diagnosis("lifecycle", "the viewer has ended", WARN)
    node.predicted()
    assert node.process.stop() == 0


def test_two_nodes_of_one_name_are_told(cell, tmp_path, cable_file):
    arguments = ["-p", f"cable_file:={cable_file}", "-p", "autostart:=false"]
    second = NodeProcess(cell.process.namespace, tmp_path, arguments)
    try:
        status = cell.diagnosis("lifecycle", "another node is called", WARN)
        assert f"/{cell.process.namespace}/cable_shape_node" in status.message
    finally:
        assert second.stop() == 0
    cell.diagnosis("lifecycle", "active", DiagnosticStatus.OK)


def test_ten_cables_on_one_node(start, tmp_path):
    """Each is predicted between its own grips, all in one cycle under the oldest stamp."""
    file = tmp_path / "cables.yaml"
    one = "{length: %.2f, linear_density: 0.1, bending_stiffness: 0.01, diameter: 0.008}"
    names = [f"c{k}" for k in range(10)]
    file.write_text("cables:\n" + "".join(f"  {name}: {one % (1.2 + 0.02 * k)}\n" for k, name in enumerate(names)))
    node = start(cable_file=file, active=False)
    node.until(lambda: node.state() == "active", "state active")
    topics = [[f"{name}/{side}_gripper/pose" for side in ("left", "right")] for name in names]
    publishers = [[node.node.create_publisher(PoseStamped, topic, 1) for topic in both] for both in topics]
    warnings = node.listen(CableWarnings, "cable/warnings", LATCHED)

    last_sent = [0]

    def publish(stamp, last=10):
        for k, both in enumerate(publishers[:last]):
            for x, publisher in zip((0.0, 0.8), both, strict=True):
                message = PoseStamped()
                message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9 + k * 1000)
                message.header.frame_id = "world"
                p, q = message.pose.position, message.pose.orientation
                p.x, p.y, p.z = x, 0.1 * k, 0.5
                q.x, q.y, q.z, q.w = ALONG_X
                publisher.publish(message)

    def came(count):
        sent = []

        def all_came():
            stamp = node.now() // 10**9 * 10**9 + 1000  # the sum below stays within its second
            stamp = max(stamp, last_sent[0] + 20_000_000)
            last_sent[0] = stamp
            sent.append(stamp)
            publish(stamp, count)
            node.spin(0.1)
            for stamp in sent:
                found = {m.cable_id: m for m in node.shapes if nanoseconds(m.header.stamp) == stamp}
                if len(found) == count:
                    return found
            return None

        return all_came

    found = node.until(came(10), "ten shapes under one stamp")
    for k, name in enumerate(names):
        shape = shape_from(found[name])
        assert shape.length == pytest.approx(1.2 + 0.02 * k)
        assert shape.positions[[0, -1]] == pytest.approx(np.array(((0.0, 0.1 * k, 0.5), (0.8, 0.1 * k, 0.5))), abs=1e-9)
    stamps = [nanoseconds(m.header.stamp) for m in warnings]
    assert len(set(stamps)) == len(stamps)  # one cycle for all
    node.until(came(3), "three shapes, the others being silent")
    node.until(came(10), "ten shapes again")
    assert node.process.stop() == 0


def test_several_cables_need_poses_and_names_that_make_topics(start, tmp_path):
    file = tmp_path / "cables.yaml"
    one = "{length: 1.2, linear_density: 0.1, bending_stiffness: 0.01}"
    file.write_text(f"cables: {{a: {one}, b/c: {one}}}")
    node = start(cable_file=file, active=False)
    node.diagnosis("lifecycle", "a name must be letters, digits and _", ERROR)
    file.write_text("cables: 3")
    assert not node.transition(1)
    node.diagnosis("lifecycle", "it must map 1 to 100 names to cables", ERROR)
    file.write_text(f"cables: {{a: {one}, b: {one}}}")
    assert node.set(input="joints", robot_file="robots/dual_arm.yaml").successful
    assert not node.transition(1)
    node.diagnosis("lifecycle", "moves one cable or harness, held by the robot's two grippers", ERROR)
    assert node.process.stop() == 0


def test_a_rotten_kernel_cache_and_a_closed_home(tmp_path, cable_file):
    """HOME is a folder in which nobody can write, and the cache holds half files and rubbish."""
    warm = Path(cache_folder(Path(poses.__file__)))
    place = tmp_path / "cache" / "cable_shape"
    place.mkdir(parents=True)
    for folder in warm.parent.iterdir():
        if folder != warm:
            (place / folder.name).symlink_to(folder)
    shutil.copytree(warm, place / warm.name)
    files = sorted((place / warm.name).rglob("*.nb?"))
    assert files
    for k, file in enumerate(files):
        if k % 2:
            os.truncate(file, file.stat().st_size // 2)
        else:
            file.write_bytes(b"rubbish")
    arguments = ["-p", f"cable_file:={cable_file}"]
    closed = {"HOME": "/proc", "XDG_CACHE_HOME": str(tmp_path / "cache")}
    node = Cell(NodeProcess(f"closed{os.getpid()}", tmp_path, arguments, fresh=True, **closed))
    try:
        node.active()
        node.predicted()
        assert node.process.stop() == 0
    finally:
        node.process.stop()
        node.close()


def test_poses_with_a_robot_check_its_links_while_joint_states_come(start):
    robot = Robot.from_yaml(find_file("robots/dual_arm.yaml"))
    node = start(robot_file="robots/dual_arm.yaml", diagnostics_period=0.2, stale_after=0.4)
    warnings = node.listen(CableWarnings, "cable/warnings", LATCHED)
    node.predicted()
    status = node.diagnosis("cable", "clearance to the robot is not checked: no usable joint_states", WARN)
    assert "Start its publisher, or clear robot_file" in status.message

    def checked():
        stamp = node.now()
        state = JointState(name=list(robot.joint_names), position=robot.home.tolist())
        state.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        node.joints.publish(state)
        node.spin(0.02)
        node.pair(stamp)
        node.spin(0.02)
        return any(m.robot_checked for m in warnings)

    node.until(checked, "warnings with the robot checked")
    warnings.clear()
    node.spin(0.5)
    node.predicted()
    node.until(lambda: warnings and not warnings[-1].robot_checked, "warnings without it")
    assert node.process.stop() == 0
