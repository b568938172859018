"""Robot: forward kinematics, grips, link geometry and joint states."""

from __future__ import annotations

import array
import math
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from urdf_reference import collisions, links

from cable_shape.cable.cable_file import Held
from cable_shape.errors import ArgumentError, InputError, RobotError, UnknownKeyError
from cable_shape.pose import Pose, rotate
from cable_shape.robots.robot import Gripper, Robot
from cable_shape.scene.scene import Box, Cylinder, Mesh, Sphere

ROOT = Path(__file__).resolve().parents[2]
DUAL_ARM = ROOT / "config/robots/dual_arm.yaml"
#: the published Denavit-Hartenberg figures of the UR5e: theta is the joint, then d, a [m] and alpha [rad]
DH = (
    (0.1625, 0.0, math.pi / 2),
    (0.0, -0.425, 0.0),
    (0.0, -0.3922, 0.0),
    (0.1333, 0.0, math.pi / 2),
    (0.0997, 0.0, -math.pi / 2),
    (0.0996, 0.0, 0.0),
)
SMALL = """
<robot name="small">
  <link name="world"/>
  <joint name="a" type="continuous"><parent link="world"/><child link="la"/><axis xyz="0 0 1"/></joint>
  <link name="la"><collision><origin xyz="0.1 0 0" rpy="0.1 0.2 0.3"/><geometry>{shape}</geometry></collision></link>
  <joint name="tool_l" type="fixed"><parent link="la"/><child link="left"/><origin xyz="0.3 0 0"/></joint>
  <link name="left"/>
  <joint name="b" type="{kind}"><parent link="world"/><child link="lb"/><origin xyz="1 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" velocity="1" effort="1"/></joint>
  <link name="lb"/>
  <joint name="follower" type="prismatic"><parent link="lb"/><child link="lf"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="{leader}" multiplier="-2" offset="0.5"/></joint>
  <link name="lf"/>
  <joint name="tool_r" type="fixed"><parent link="lf"/><child link="right"/></joint>
  <link name="right"/>
</robot>
"""
GRIPPERS = {"left": Gripper("left"), "right": Gripper("right")}


def small(shape: str = '<sphere radius="0.1"/>', kind: str = "prismatic", leader: str = "b") -> str:
    return SMALL.format(shape=shape, kind=kind, leader=leader)


TYPO = {**GRIPPERS, "left": Gripper("lefd")}
NO_LIMIT = small().replace("<limit lower", "<limits lower", 1)
XACRO = (
    small()
    .replace('"small"', '"s" xmlns:xacro="http://www.ros.org/wiki/xacro"')
    .replace('<link name="la">', '<link name="la"><xacro:x/>')
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(DUAL_ARM)


def random_positions(robot: Robot, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(np.maximum(robot.lower, -7), np.minimum(robot.upper, 7))


def assert_same(pose: Pose, matrix: np.ndarray, atol: float = 1e-12) -> None:
    np.testing.assert_allclose(pose.matrix(), matrix, atol=atol, rtol=0)


def about_x(degrees: float) -> np.ndarray:
    out = np.eye(4)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    out[1:3, 1:3] = ((c, -s), (s, c))
    return out


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31))
def test_every_frame_is_where_the_text_of_the_urdf_has_it(robot: Robot, seed: int) -> None:
    q = random_positions(robot, seed)
    expected = links(robot.urdf, dict(zip(robot.joint_names, q, strict=True)))
    robot.update(q)
    for link, pose in robot.link_poses().items():
        assert_same(pose, expected[link])
    for side, pose in robot.gripper_poses().items():
        assert_same(pose, expected[f"{side}_tool"])
    for side, grip in zip(("left", "right"), robot.grips(), strict=True):
        assert_same(grip.pose, expected[f"{side}_tool"])
        # the YAML's offset turns the tool by -90 degrees about its x axis
        assert_same(grip.cable_frame, expected[f"{side}_tool"] @ about_x(-90.0))


@pytest.mark.parametrize(("side", "y"), [("left", 0.35), ("right", -0.35)])
def test_arms_have_the_published_kinematics(robot: Robot, side: str, y: float) -> None:
    q = random_positions(robot, 3)
    robot.update(q)
    arm = [i for i, name in enumerate(robot.joint_names) if name.startswith(side) and "finger" not in name]
    expected = np.diag((-1.0, -1.0, 1.0, 1.0))  # the mount: half a turn about z
    expected[1, 3] = y
    for theta, (d, a, alpha) in zip(q[arm], DH, strict=True):
        c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
        expected = expected @ np.array(
            ((c, -s * ca, s * sa, a * c), (s, c * ca, -c * sa, a * s), (0, sa, ca, d), (0, 0, 0, 1))
        )
    assert_same(robot.link_poses()[f"{side}_wrist_3"], expected)


def test_link_geometry_is_the_urdfs_collision_geometry(robot: Robot) -> None:
    wanted = {}
    for link, placed, shape in collisions(robot.urdf):
        wanted.setdefault(link, []).append((placed, shape))
    assert len(robot.link_geometry) == sum(map(len, wanted.values())) == 36
    for obstacle in robot.link_geometry:
        placed, shape = wanted[obstacle.link].pop(0)
        assert_same(obstacle.pose, placed)
        if shape["kind"] == "box":
            assert isinstance(obstacle.solid, Box)
            np.testing.assert_allclose(obstacle.solid.size, shape["size"], rtol=1e-12)
        else:
            assert isinstance(obstacle.solid, Cylinder)
            assert obstacle.solid.radius == pytest.approx(shape["radius"][0], rel=1e-12)
            assert obstacle.solid.length == pytest.approx(shape["length"][0], rel=1e-12)
    poses = list(robot.link_poses())
    assert set(poses[: len(wanted)]) == set(wanted)
    assert set(poses) - set(wanted) == {"world", "left_tool", "right_tool"}
    assert len({o.name for o in robot.link_geometry}) == 36


def test_both_arms_are_the_same_but_for_their_place(robot: Robot) -> None:
    half = random_positions(robot, 5)[:7]
    robot.update(np.concatenate((half, half)))
    poses = robot.link_poses()
    for link, pose in poses.items():
        if link.startswith("left_"):
            other = poses[link.replace("left_", "right_")]
            np.testing.assert_allclose(pose.position - other.position, (0.0, 0.7, 0.0), atol=1e-12)
            assert pose.distance(other)[1] < 1e-12


def test_a_robot_holds_a_cable_as_its_file_knows(robot: Robot) -> None:
    known = Held("swivel", correction=Pose((0.01, 0.0, 0.02), (0.0, 0.6, 0.0, 0.8)))
    held, q = robot.holding(known, Held()), robot.home + 0.1
    for (grip, before), correct in zip(zip(held.grips(q), robot.grips(q), strict=True), (known, Held()), strict=True):
        expected = correct.grip(before)
        assert grip.kind == expected.kind
        np.testing.assert_allclose(grip.cable_frame.matrix(), expected.cable_frame.matrix(), atol=1e-12)
    np.testing.assert_array_equal(held.home, robot.home)
    assert robot.holding(Held(), Held()) is robot


def test_home_holds_a_cable_between_the_grippers(robot: Robot) -> None:
    start, end = robot.grips(robot.home)
    chord = end.cable_frame.position - start.cable_frame.position
    assert 0.6 < np.linalg.norm(chord) < 0.8
    for grip in (start, end):
        tangent = rotate(grip.cable_frame.quaternion, np.array((0.0, 0.0, 1.0)))
        assert tangent @ chord > 0.8 * np.linalg.norm(chord), "d3 points from start to end at both ends"


def test_a_joint_state_in_any_order_with_strangers(robot: Robot) -> None:
    q = random_positions(robot, 8)
    names = [*robot.joint_names, "another_robots_joint", "left_finger_b_joint"]
    values = [*q, math.nan, 0.0]
    order = np.random.default_rng(0).permutation(len(names))
    shuffled = [names[i] for i in order]
    for _ in range(2):  # the second time from what is remembered
        got = robot.positions(shuffled, array.array("d", (values[i] for i in order)))
        np.testing.assert_array_equal(got, q)


def test_fingers_that_a_joint_state_leaves_out_stand_at_home(robot: Robot) -> None:
    arms = [name for name in robot.joint_names if "finger" not in name]
    q = robot.positions(arms, np.arange(12.0))
    index = robot.joint_names.index("right_finger_joint")
    assert q[index] == robot.home[index] == 0.004
    assert q[robot.joint_names.index("right_wrist_3_joint")] == 11.0


def test_many_lists_of_names_do_not_pile_up(robot: Robot) -> None:
    for i in range(50):
        robot.positions([*robot.joint_names, f"stranger_{i}"], np.zeros(len(robot.joint_names) + 1))
    assert len(robot._permutations) <= 16


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda n, v: (n[1:], v[1:]), r"left_shoulder_pan_joint missing; the grippers hang on them.*both arms"),
        (lambda n, v: (n, v[:-1]), r"13 positions for 14 names"),
        (lambda n, v: (n, []), r"0 positions for 14 names"),
        (lambda n, v: ([*n[:-1], n[0]], v), r"left_shoulder_pan_joint named more than once"),
        (lambda n, v: (n, [*v[:3], math.nan, *v[4:]]), r"'left_wrist_1_joint' is nan, it must be finite"),
        (lambda n, v: (n, [*v[:3], math.inf, *v[4:]]), r"'left_wrist_1_joint' is inf, it must be finite"),
        (lambda n, v: ([], []), r"left_shoulder_pan_joint, .* missing.*Given: none"),
    ],
)
def test_a_joint_state_that_cannot_be_used(robot: Robot, change, message: str) -> None:
    names, values = change(list(robot.joint_names), [0.0] * len(robot.joint_names))
    with pytest.raises(InputError, match=message):
        robot.positions(names, values)
    robot.positions(robot.joint_names, np.zeros(14))  # and the next one is fine


@pytest.mark.parametrize(("q", "message"), [(np.zeros(13), r"shape \(14,\)"), (np.full(14, math.nan), "finite")])
def test_update_refuses(robot: Robot, q: np.ndarray, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        robot.update(q)


def test_results_of_one_update_outlive_the_next(robot: Robot) -> None:
    robot.update(random_positions(robot, 1))
    before = {link: pose.array.copy() for link, pose in robot.link_poses().items()}
    kept = robot.link_poses()
    start, _ = robot.grips()
    place = start.cable_frame.array.copy()
    robot.update(random_positions(robot, 2))
    for link, pose in kept.items():
        np.testing.assert_array_equal(pose.array, before[link])
    np.testing.assert_array_equal(start.cable_frame.array, place)
    with pytest.raises(ValueError, match="read-only"):
        start.cable_frame.array[0] = 1.0


def test_continuous_and_mimicking_joints() -> None:
    robot = Robot(small(), GRIPPERS)
    assert robot.joint_names == ("a", "b")
    assert set(robot.single_joints) == {"a", "b", "follower"}
    assert robot.upper.tolist() == [math.inf, 2.0]
    q = robot.positions(["follower", "b", "a"], [99.0, 0.2, 100.0])  # the follower's own value does not count
    start, end = robot.grips(q)
    np.testing.assert_allclose(start.pose.position, (0.3 * math.cos(100), 0.3 * math.sin(100), 0), atol=1e-12)
    np.testing.assert_allclose(end.pose.position, (1.0, 0.2, -2 * 0.2 + 0.5), atol=1e-12)


def binary_stl(triangles: np.ndarray) -> bytes:
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *t.ravel(), 0) for t in triangles)
    return bytes(80) + struct.pack("<I", len(triangles)) + facets


TETRAHEDRON = np.array(((0, 0, 0), (100, 0, 0), (0, 200, 0), (0, 0, 300)), dtype=np.float64)
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))


@pytest.mark.parametrize("how", ["relative", "file", "ament", "beside"])
def test_meshes_are_found_and_scaled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str) -> None:
    package = tmp_path / "prefix/share/my_robot"
    for folder in ("urdf", "meshes"):
        (package / folder).mkdir(parents=True)
    mesh = package / "meshes/part.stl"
    mesh.write_bytes(binary_stl(TETRAHEDRON[np.array(FACES)]))
    name = {"relative": "../meshes/part.stl", "file": f"file://{mesh}"}.get(how, "package://my_robot/meshes/part.stl")
    text = small(f'<mesh filename="{name}" scale="0.001 0.001 0.001"/>')
    file = (tmp_path if how == "ament" else package / "urdf") / "small.urdf"
    file.write_text(text)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix") if how == "ament" else "/nowhere")
    robot = Robot(file, GRIPPERS)
    (obstacle,) = robot.link_geometry
    assert isinstance(obstacle.solid, Mesh)
    corners = obstacle.solid.vertices[obstacle.solid.faces]
    np.testing.assert_allclose(
        np.unique(corners.reshape(-1, 3), axis=0), np.unique(TETRAHEDRON * 1e-3, axis=0), atol=1e-7
    )
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(0.1 * 0.2 * 0.3 / 6, rel=1e-5)
    ((_, placed, _),) = collisions(small())
    assert_same(obstacle.pose, placed)


def test_a_sphere_and_a_named_link() -> None:
    robot = Robot(small('<sphere radius="0.07"/>'), GRIPPERS)
    (obstacle,) = robot.link_geometry
    assert obstacle.solid == Sphere(0.07)
    assert (obstacle.name, obstacle.link) == ("la", "la")


@pytest.mark.parametrize(
    ("urdf", "grippers", "message"),
    [
        (small(), TYPO, r"left gripper: the URDF has no link 'lefd'. The nearest is 'left'"),
        (small(), {**GRIPPERS, "left": Gripper("left", gripping_links=("lc",))}, r"link 'lc'. The nearest is 'l[abf]'"),
        ("<robot name='x'><link", GRIPPERS, r"not well-formed XML: .*line 1"),
        ("<mujoco/>", GRIPPERS, r"top element is <mujoco>, it must be <robot>"),
        (NO_LIMIT, GRIPPERS, r"refused by its parser: .*Joint \[b\] is of type PRISMATIC without limits"),
        (XACRO, GRIPPERS, r"this is a xacro.*Expand it first"),
        (small('<mesh filename="gone.stl"/>'), GRIPPERS, r"link 'la': mesh 'gone.stl' is not found in .*gone.stl"),
        (small('<mesh filename="package://p/m.stl"/>'), GRIPPERS, r"'package://p/m.stl' is not found.*AMENT_PREFIX"),
        (small(kind="floating"), GRIPPERS, r"mimics 'b', which is no joint that moves"),
        (small(kind="floating", leader="a"), GRIPPERS, r"right gripper: it hangs on joint 'b', which has more than"),
        (small(leader="follower"), GRIPPERS, r"'follower' mimics itself"),
        (small().replace('multiplier="-2"', 'multiplier="two"'), GRIPPERS, r"refused by its parser.*two"),
    ],
)  # fmt: skip
def test_a_description_that_does_not_fit(urdf: str, grippers: dict[str, Gripper], message: str) -> None:
    with pytest.raises(RobotError, match=message):
        Robot(urdf, grippers)


def test_what_the_parser_says_is_not_lost_on_the_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RobotError, match="limits"):
        Robot(small().replace("<limit lower", "<limits lower", 1), GRIPPERS)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ("urdf:", "urfd:", UnknownKeyError, r"unknown key 'urfd'. Did you mean 'urdf'"),
        ("  right:", "  rigth:", UnknownKeyError, r"unknown key 'rigth'. Did you mean 'right'"),
        ("frame: right_tool", "fram: right_tool", UnknownKeyError, r"grippers.right.*unknown key 'fram'"),
        ("frame: right_tool", "frame: right_tol", RobotError, r"dual.yaml: right gripper: .*nearest is 'right_tool'"),
        ("kind: clamped", "kind: welded", ArgumentError, r"kind = 'welded'.*clamped, swivel, pinned"),
        ("-0.70710678118654752", "-0.9", ArgumentError, r"grippers.left: quaternion.*within 0.001 of 1"),
        ("gripping_links: [left_palm,", "gripping_links: left_palm #", ArgumentError, r"must be a list of links"),
        (
            "left_elbow_joint:",
            "left_elbo_joint:",
            RobotError,
            r"no joint 'left_elbo_joint'. The nearest is 'left_elbow",
        ),
        ("left_elbow_joint: 1.7184", "left_elbow_joint: .nan", ArgumentError, r"home.left_elbow_joint.*finite"),
        ("urdf: dual_arm.urdf", "urdf: gone.urdf", ArgumentError, r"gone.urdf: no such file"),
        ("urdf: dual_arm.urdf", "", ArgumentError, r"the key 'urdf' is missing"),
    ],
)
def test_a_robot_file_that_is_wrong(tmp_path: Path, old: str, new: str, error: type[Exception], message: str) -> None:
    text = DUAL_ARM.read_text()
    assert old in text
    (tmp_path / "dual.yaml").write_text(text.replace(old, new, 1))
    (tmp_path / "dual_arm.urdf").write_text((DUAL_ARM.parent / "dual_arm.urdf").read_text())
    with pytest.raises(error, match=message):
        Robot.from_yaml(tmp_path / "dual.yaml")


def test_both_grippers_must_be_given() -> None:
    with pytest.raises(ArgumentError, match="left and right must both be given"):
        Robot(small(), {"left": Gripper("left")})


def test_another_pinocchio_is_refused_before_it_is_imported(tmp_path: Path) -> None:
    fake = tmp_path / "pinocchio/__init__.py"
    fake.parent.mkdir()
    fake.write_text("raise SystemExit('the wrong Pinocchio was imported')")
    code = "from cable_shape.robots.robot import Robot; Robot('<robot/>', {'left': None, 'right': None})"
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=300)
    assert run.returncode == 1
    last = run.stderr.strip().splitlines()[-1]
    assert last.startswith("cable_shape.errors.DependencyError: The wrong Pinocchio")
    assert str(fake) in last
    assert "site-packages/pinocchio/__init__.py" in last


@settings(max_examples=50, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31), small=st.sampled_from([1.0, 1e-3, 1e-8]))
def test_distance_between_poses(seed: int, small: float) -> None:
    random = np.random.default_rng(seed)
    first = Rotation.random(rng=random)
    axis = random.normal(size=3)
    angle = small * random.uniform(0.0, np.pi)
    second = first * Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    sign = random.choice((-1.0, 1.0))
    a, b = Pose((1.0, 2.0, 3.0), first.as_quat()), Pose((1.0, 2.0, 3.0 + angle), sign * second.as_quat())
    position, rotation = a.distance(b)
    assert position == pytest.approx(angle, rel=1e-9, abs=1e-15)
    assert rotation == pytest.approx(angle, rel=1e-6, abs=1e-15)
