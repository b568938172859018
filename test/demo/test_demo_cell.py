"""The simulated cell of the demo: its plan, its command line and what it publishes."""

from __future__ import annotations

import importlib.util
import itertools
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest

from cable_shape.cable.cable import Cable
from cable_shape.cycle.cycle import Cycle
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.robots.robot import Robot
from cable_shape.safety.report import WarningKind
from cable_shape.scene.scene import Scene
from cable_shape.shape import Status

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "demo/demo_cell.py"
CABLE = Cable.from_yaml(ROOT / "config/cables/demo.yaml")
ORDER = ("base", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "palm", "finger")


@pytest.fixture(scope="module")
def demo() -> ModuleType:
    spec = importlib.util.spec_from_file_location("demo_cell", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(ROOT / "config/robots/dual_arm.yaml")


@pytest.fixture(scope="module")
def motion(demo: ModuleType, robot: Robot):
    return demo.plan(robot)


@pytest.fixture(scope="module")
def lift() -> float:
    """By how much the demo carries its harness higher than its cable."""
    source = (ROOT / "demo/demo_run.py").read_text()
    return float(re.search(r"^LIFT = (\S+)", source, flags=re.MULTILINE)[1])


@pytest.fixture(scope="module")
def lifted(demo: ModuleType, robot: Robot, lift: float):
    return demo.plan(robot, lift=lift)


def test_the_grips_follow_the_keys(demo: ModuleType, robot: Robot, motion) -> None:
    assert motion.duration == 20.0
    assert motion.names == robot.joint_names
    for t in np.linspace(0.0, 20.0, 173):
        key = demo.minimum_jerk(float(t))
        for grip, wanted in zip(robot.grips(motion.path(t)), demo.cable_ends(key), strict=True):
            position, rotation = grip.cable_frame.distance(wanted)
            assert position < 1e-4
            assert rotation < 1e-4
    for key in demo.KEYS:
        np.testing.assert_allclose(demo.minimum_jerk(key.time), key, atol=1e-12)


def test_the_end_is_twisted_by_a_quarter_turn(demo: ModuleType, robot: Robot, motion) -> None:
    before, after = (robot.grips(motion.path(t))[1].cable_frame for t in (7.5, 11.5))
    position, rotation = before.distance(after)
    assert position < 1e-4
    assert rotation == pytest.approx(np.pi / 2, abs=1e-4)


def test_joints_move_smoothly_and_within_their_limits(robot: Robot, motion) -> None:
    times = np.linspace(0.0, motion.duration, 4001)
    q = motion.path(times)
    assert (q >= robot.lower).all()
    assert (q <= robot.upper).all()
    step = np.abs(np.diff(q, axis=0)) / np.diff(times)[:, None]
    assert (step.max(axis=0) <= 0.8 * robot.velocity_limits).all()
    assert np.abs(motion.path(times, 2)).max() < 5.0, "rad/s^2"
    np.testing.assert_allclose(motion.path([0.0, motion.duration], 1), 0.0, atol=1e-9)


def test_the_cable_is_never_stretched(robot: Robot, motion) -> None:
    for t in np.linspace(0.0, motion.duration, 101):
        start, end = robot.grips(motion.path(t))
        assert np.linalg.norm(end.cable_frame.position - start.cable_frame.position) < 0.95 * CABLE.length


def test_resting_on_the_table_is_no_alarm(robot: Robot, motion) -> None:
    scene = Scene.from_yaml(ROOT / "config/scenes/demo.yaml")
    links = {"robot_links": robot.link_geometry, "gripping_links": robot.gripping_links}
    pressed = []
    for allow in (scene.allow, ()):
        cycle = Cycle(CABLE, scene=scene.replace(allow=allow), **links)
        others, forces = set(), [0.0]
        for k, t in enumerate(np.arange(0.5, 4.0, 0.05)):
            report = cycle.step({"cable": robot.grips(motion.path(t))}, round(5e7 * k), robot.link_poses)
            others |= {warning.other for warning in report.warnings}
            forces += [m.value for m in report.margins["cable"] if m.kind is WarningKind.CONTACT_FORCE]
        assert ("table" in others) == (not allow)
        pressed.append(max(forces))
    assert 0.5 < pressed[0] < scene.allow[0].max_force
    assert pressed[1] == 0.0


def test_the_harness_hangs_above_the_table_all_the_time(robot: Robot, lifted) -> None:
    scene = Scene.from_yaml(ROOT / "config/scenes/harness.yaml")
    file = HarnessFile.from_yaml(ROOT / "config/harnesses/demo.yaml")
    held = file.held((), scene)
    cycle = Cycle({"demo": file.harness}, scene=scene)
    nearest = []
    for k, t in enumerate(np.linspace(0.0, lifted.duration, 101)):
        start, end = robot.grips(lifted.path(t))
        report = cycle.step({"demo": {**held, "trunk.start": start, "branch.end": end}}, stamp=k * 200_000_000)
        assert report.shapes["demo"].status is Status.OK, f"{t:.2f} s: {report.shapes['demo']}"
        nearest.append({part: clearance.closest for part, clearance in report.clearance.items()})
    bodies = [{part: b.distance for part, b in one.items() if b is not None} for one in nearest]
    assert scene.error_distance < min(one.get("demo/connector", 1.0) for one in bodies) < scene.warn_distance
    assert min(one.get(part, 1.0) for one in bodies for part in ("demo/trunk", "demo/branch")) > 0.0


def adjacent(a: str, b: str) -> bool:
    """Links that are joined, or hold a gripper together, touch on purpose."""
    if a.split("_")[0] != b.split("_")[0]:
        return False
    i, j = (next(k for k, part in enumerate(ORDER) if link.split("_", 1)[1].startswith(part)) for link in (a, b))
    return abs(i - j) <= 1 or min(i, j) >= 6


@pytest.mark.parametrize(("carried", "scene"), [("motion", "demo"), ("lifted", "harness")])
def test_the_arms_touch_neither_each_other_nor_the_cell(robot: Robot, carried: str, scene: str, request) -> None:
    """By Coal, with Pinocchio's geometry and the scene's table and post."""
    motion = request.getfixturevalue(carried)
    model = pin.buildModelFromXML(robot.urdf)
    geometry = pin.buildGeomFromUrdfString(model, robot.urdf, pin.GeometryType.COLLISION)
    of_robot = len(geometry.geometryObjects)
    names = [model.frames[item.parentFrame].name for item in geometry.geometryObjects]
    for obstacle in Scene.from_yaml(ROOT / f"config/scenes/{scene}.yaml").obstacles:
        solid = obstacle.solid
        shape = pin.coal.Box(*solid.size) if hasattr(solid, "size") else pin.coal.Cylinder(solid.radius, solid.length)
        placed = pin.XYZQUATToSE3(obstacle.pose.array)
        geometry.addGeometryObject(pin.GeometryObject(obstacle.name, 0, placed, shape))
        names.append(obstacle.name)
    for i, j in itertools.combinations(range(len(names)), 2):
        standing = names[i].endswith(("_base", "_shoulder")) and names[j] == "table"
        if i < of_robot and not standing and (j >= of_robot or not adjacent(names[i], names[j])):
            geometry.addCollisionPair(pin.CollisionPair(i, j))
    data, places = model.createData(), geometry.createData()
    for t in np.linspace(0.0, motion.duration, 101):
        configuration = np.zeros(model.nq)
        for name, value in zip(robot.single_joints, robot.single_positions(motion.path(t)), strict=True):
            configuration[model.joints[model.getJointId(name)].idx_q] = value
        pin.computeDistances(model, data, geometry, places, configuration)
        distances = [result.min_distance for result in places.distanceResults]
        nearest = geometry.collisionPairs[int(np.argmin(distances))]
        assert min(distances) > 0.01, f"{t:.2f} s: {names[nearest.first]} and {names[nearest.second]}"


def run(*arguments: str, timeout: float = 300.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(SCRIPT), *arguments], capture_output=True, text=True, timeout=timeout, cwd=ROOT
    )


def test_dry_run_writes_the_same_path_every_time(tmp_path: Path, motion) -> None:
    done = run("--dry-run", str(tmp_path / "path.npz"), "--rate", "50")
    assert done.returncode == 0, done.stderr
    assert "1001 joint positions" in done.stdout
    with np.load(tmp_path / "path.npz") as path:
        assert tuple(path["names"]) == motion.names
        np.testing.assert_array_equal(path["times"], np.linspace(0.0, 20.0, 1001))
        np.testing.assert_array_equal(path["positions"], motion.path(path["times"]))


def test_too_fast_is_refused_with_the_duration_that_would_do(demo: ModuleType, capsys) -> None:
    assert demo.main(["--duration", "1", "--dry-run", "never_written.npz"]) == 1
    error = capsys.readouterr().err
    assert "of its velocity limit, at most 0.8 is allowed. Raise --duration above" in error
    assert not Path("never_written.npz").exists()


def test_arguments_that_make_no_sense(demo: ModuleType, capsys) -> None:
    with pytest.raises(SystemExit) as stopped:
        demo.main(["--rate", "-1"])
    assert stopped.value.code == 2
    assert "must be a finite number above 0" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")  # imported by a library that rclpy uses
def test_joint_states_arrive_over_dds(robot: Robot, motion) -> None:
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from sensor_msgs.msg import JointState

    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("listener", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    received: list[JointState] = []
    node.create_subscription(JointState, "/cell/joint_states", received.append, 1000)
    began = time.time()
    cell = subprocess.Popen(
        [sys.executable, str(SCRIPT), "--duration", "10", "--namespace", "cell"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        until = time.monotonic() + 300.0
        while cell.poll() is None and time.monotonic() < until:
            executor.spin_once(timeout_sec=0.1)
        out, error = cell.communicate(timeout=60.0)
        for _ in range(100):
            executor.spin_once(timeout_sec=0.0)
    finally:
        cell.kill()
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert cell.returncode == 0, error
    assert "10.0 s published at 200 Hz" in out
    assert len(received) > 2, "how many of them it can send and how soon it is heard, the machine decides"
    stamps = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in received])
    assert (np.diff(stamps) > 0.0).all()
    assert began < stamps[0] < stamps[-1] < time.time()
    q = np.array([robot.positions(m.name, m.position) for m in received])
    np.testing.assert_allclose(q[-1], motion.path(20.0), atol=1e-9)
    times = np.linspace(0.0, 20.0, 20_001)
    path = motion.path(times)
    off = [np.abs(path - row).max(axis=1).min() for row in q]
    assert max(off) < 2e-3, "every message lies on the planned path"
    speed = np.abs(np.diff(q, axis=0)) / np.diff(stamps)[:, None]
    assert np.median(speed, axis=0).max() < 3.0


def test_without_a_listener_it_gives_up() -> None:
    done = run("--wait", "0.5")
    assert done.returncode == 1
    assert "nobody subscribed to /joint_states within 0.5 s" in done.stderr


def test_a_signal_ends_it() -> None:
    cell = subprocess.Popen(
        [sys.executable, str(SCRIPT), "--wait", "0", "--duration", "600"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    timer = threading.Timer(300.0, cell.kill)
    timer.start()
    assert "moving for 600.0 s" in cell.stdout.readline()
    cell.terminate()
    _, error = cell.communicate()
    timer.cancel()
    assert cell.returncode == 1
    assert "interrupted" in error
