"""DualArmIK and the MuJoCo model that it works on."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from urdf_reference import links

from cable_shape.errors import ArgumentError, RobotError
from cable_shape.pose import Grip, Pose
from cable_shape.robots.ik import DualArmIK, IkResult
from cable_shape.robots.mujoco_model import MujocoModel
from cable_shape.robots.robot import Gripper, Robot

ROOT = Path(__file__).resolve().parents[2]
DUAL_ARM = ROOT / "config/robots/dual_arm.yaml"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(DUAL_ARM)


def random_positions(robot: Robot, random: np.random.Generator) -> np.ndarray:
    return random.uniform(np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi))


def assert_reached(robot: Robot, result: IkResult, start: Pose, end: Pose) -> None:
    """By the text of the URDF: neither by MuJoCo nor by Pinocchio."""
    frames = links(robot.urdf, dict(zip(robot.joint_names, result.q, strict=True)))
    for side, wanted in (("left", start), ("right", end)):
        reached = frames[f"{side}_tool"] @ robot.grippers[side].offset.matrix()
        np.testing.assert_allclose(reached, wanted.matrix(), atol=3e-5)
    assert (result.q >= robot.lower).all()
    assert (result.q <= robot.upper).all()


def test_random_reachable_grips_are_reached(robot: Robot) -> None:
    ik = DualArmIK(robot, attempts=10)
    random = np.random.default_rng(0)
    for _ in range(15):
        start, end = (grip.cable_frame for grip in robot.grips(random_positions(robot, random)))
        result = ik.solve(start, end)
        assert result.converged, result
        assert max(result.position_error, result.rotation_error) <= 1e-5
        assert_reached(robot, result, start, end)


def test_a_small_step_stays_near_the_posture(robot: Robot) -> None:
    ik = DualArmIK(robot)
    start, end = (grip.cable_frame for grip in robot.grips(robot.home))
    moved = Pose(start.position + np.array((0.005, -0.003, 0.004)), start.quaternion)
    result = ik.solve(moved, end, robot.home)
    assert result.converged
    assert result.iterations <= 4
    assert np.abs(result.q - robot.home).max() < 0.05
    right = [name.startswith("right") for name in robot.joint_names]
    np.testing.assert_allclose(result.q[right], robot.home[right], atol=1e-4)
    fingers = [i for i, name in enumerate(robot.joint_names) if "finger" in name]
    np.testing.assert_allclose(result.q[fingers], robot.home[fingers], atol=1e-9)


def test_a_grip_counts_with_its_own_cable_frame(robot: Robot) -> None:
    ik = DualArmIK(robot)
    start, end = robot.grips(robot.home)
    assert ik.solve(start, end).iterations == 0
    bare = ik.solve(Grip(start.cable_frame), end.cable_frame)
    assert bare.iterations == 0
    assert bare.converged


def test_out_of_reach_is_said_with_the_distance_that_is_left(robot: Robot) -> None:
    start, end = (grip.cable_frame for grip in robot.grips(robot.home))
    far = Pose((3.0, 0.35, 0.1625), start.quaternion)
    result = DualArmIK(robot, max_iterations=40).solve(far, end)
    assert not result.converged
    # from the shoulder the tool reaches no further than the sum of the links, 1.35 m
    assert 3.0 - 1.35 < result.position_error < 2.6
    start, end = robot.grips(result.q)
    assert np.linalg.norm(start.cable_frame.position - far.position) == pytest.approx(result.position_error)


def test_same_question_same_answer(robot: Robot) -> None:
    random = np.random.default_rng(7)
    start, end = (grip.cable_frame for grip in robot.grips(random_positions(robot, random)))
    answers = [DualArmIK(robot, attempts=10).solve(start, end).q for _ in range(2)]
    np.testing.assert_array_equal(*answers)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda robot: DualArmIK(robot, attempts=0), "attempts = 0"),
        (lambda robot: DualArmIK(robot, position_tolerance=-1.0), "position_tolerance = -1.0.*above 0 m"),
        (lambda robot: DualArmIK(robot).solve(Pose(), Pose(), np.zeros(3)), r"q0 = .*shape \(14,\)"),
        (lambda robot: DualArmIK(robot).solve(Pose(), None), "end = None.*Pose or a Grip"),
    ],
)
def test_arguments_that_are_refused(robot: Robot, call, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        call(robot)


def test_mujoco_and_pinocchio_agree_on_every_link(robot: Robot) -> None:
    model = MujocoModel(robot)
    data = mujoco.MjData(model.model)
    random = np.random.default_rng(99)
    for _ in range(20):
        q = random_positions(robot, random)
        data.qpos[:] = model.qpos(q)
        np.testing.assert_allclose(model.q(data.qpos), q, atol=0)
        mujoco.mj_kinematics(model.model, data)
        robot.update(q)
        poses = {**robot.link_poses(), **{f"{side}_tool": pose for side, pose in robot.gripper_poses().items()}}
        for link, pose in poses.items():
            body = data.body(link)
            np.testing.assert_allclose(body.xpos, pose.position, atol=1e-9)
            np.testing.assert_allclose(body.xmat.reshape(3, 3), pose.matrix()[:3, :3], atol=1e-9)


def test_the_comparison_leaves_the_robot_at_home(robot: Robot) -> None:
    MujocoModel(robot)
    at_construction = robot.link_poses()
    robot.update(robot.home)
    assert at_construction == robot.link_poses()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('xyz="-0.425 0 0" rpy="0 0 0"', 'xyz="-0.426 0 0" rpy="0 0 0"', r"disagree on 'left_tool': 1 mm and 0? ?"),
        ('xyz="0 0.0996 0"', 'xyz="0 0.0996 0.00001"', "disagree on 'left_tool': 0.01 mm"),
        ('axis xyz="0 0 1"', 'axis xyz="0 0 -1"', "disagree on 'left_tool'"),
        ("left_elbow_joint", "left_elbow", "no joint 'left_elbow_joint'. It has: .*left_elbow"),
        ('name="right_tool"', 'name="right_tcp"', "no body 'right_tool'"),
        (
            '<joint name="left_tool_joint" type="fixed">',
            '<joint name="extra" type="prismatic">',
            "17 positions.*has 16",
        ),
        ("<robot ", "<robott ", "MuJoCo refuses"),
    ],
)
def test_a_description_that_drifted_apart_is_refused(robot: Robot, old: str, new: str, message: str) -> None:
    assert old in robot.urdf
    changed = robot.urdf.replace(old, new, 1)
    if old == 'name="right_tool"':
        changed = robot.urdf.replace('"right_tool"', '"right_tcp"')
    with pytest.raises(RobotError, match=message):
        MujocoModel(robot, changed)


def test_an_mjcf_of_ones_own_is_compared_too(robot: Robot) -> None:
    spec = mujoco.MjSpec.from_string(robot.urdf)
    spec.compiler.fusestatic = False
    spec.compile()
    mjcf = spec.to_xml()
    assert "<mujoco" in mjcf
    MujocoModel(robot, mjcf)
    body = '<body name="right_wrist_2" pos="0 -0.0997 0"'
    assert body in mjcf
    with pytest.raises(RobotError, match="disagree on 'right_tool'"):
        MujocoModel(robot, mjcf.replace(body, '<body name="right_wrist_2" pos="0 -0.0987 0"'))


def test_links_without_inertia_and_meshes_of_any_kind_are_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / "part.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    arm = """<link name="{0}_1"><collision><geometry><mesh filename="part.obj"/></geometry></collision></link>
      <link name="{0}"/>
      <joint name="{0}_a" type="continuous"><parent link="world"/><child link="{0}_1"/><axis xyz="0 1 0"/></joint>
      <joint name="{0}_b" type="prismatic"><parent link="{0}_1"/><child link="{0}"/><axis xyz="1 0 0"/>
        <limit lower="0.2" upper="1" velocity="1" effort="1"/></joint>"""
    file = tmp_path / "plain.urdf"
    file.write_text(f'<robot name="plain"><link name="world"/>{arm.format("left")}{arm.format("right")}</robot>')
    robot = Robot(file, {"left": Gripper("left"), "right": Gripper("right")})
    assert robot.home.tolist() == [0.0, 0.2, 0.0, 0.2]
    half_turn = Pose((-0.5, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
    level = Pose((0.7, 0.0, 0.0))
    result = DualArmIK(robot, attempts=20).solve(half_turn, level)
    assert result.converged
    assert np.cos(result.q[0]) == pytest.approx(-1.0)
    np.testing.assert_allclose(result.q[[1, 2, 3]], (0.5, 0.0, 0.7), atol=1e-4)
