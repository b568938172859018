"""Cycles, trajectories, steering and replays of cables that clips on robot links hold."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from recordings import BEGIN, PERIOD, joints_entry, motion, write_bag
from replays import messages, run

import cable_shape as cs
from cable_shape.robots.robot import Robot

ROBOT = Path(__file__).resolve().parents[2] / "config" / "robots" / "dual_arm.yaml"
ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.4, linear_density=0.05, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
START, END = cs.Pose((0, 0, 0.5), ALONG_X), cs.Pose((0.8, 0, 0.5), ALONG_X)
LINK = "left_tool"  # which has no collision geometry


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(ROBOT)


@pytest.fixture(scope="module")
def scene(robot: Robot) -> cs.Scene:
    """The cable goes from the left gripper through an eyelet and a clip that the left tool carries, to the right."""
    robot.update(robot.home)
    start, end = (grip.cable_frame.position for grip in robot.grips())
    tool = robot.link_poses()[LINK].inverse()
    way = (end - start) / np.linalg.norm(end - start)
    first, second = (tool * cs.Pose(start + far * way - (0.0, 0.0, 0.05)) for far in (0.1, 0.16))
    clips = [cs.Clip(0.2, first, kind="ball", link=LINK), cs.Clip(0.3, second, kind="ball", name="last", link=LINK)]
    return cs.Scene(clips=clips)


def arms(robot: Robot, k: float) -> np.ndarray:
    moving = np.array(["finger" not in name for name in robot.joint_names])
    return robot.home + 0.02 * k * moving


def test_a_cycle_asks_for_the_links_before_it_predicts() -> None:
    clip = cs.Clip(0.6, cs.Pose((0.0, 0.0, 0.0)), name="guide", link="tool")
    cycle = cs.Cycle(CABLE, scene=cs.Scene(clips=[clip]))
    order = []

    def links() -> dict[str, cs.Pose]:
        order.append("links")
        return {"tool": cs.Pose((0.35, 0.0, 0.3))}

    report = cycle.step({"cable": (START, END)}, 0, links, lambda shapes: order.append("shapes"))
    assert order == ["links", "shapes"]
    assert report.shapes["cable"].status is cs.Status.OK
    with pytest.raises(cs.ArgumentError, match="clip 'guide' is on link 'tool'"):
        cycle.step({"cable": (START, END)}, 1)
    assert cycle.step({"cable": (START, END)}, 2, links).shapes["cable"].status is cs.Status.OK


def test_edits_of_clips_on_links() -> None:
    """What is inserted takes the cable along from where it is; what is moved is moved in the link's frame."""
    cycle = cs.Cycle(CABLE, points=141)
    links = {"tool": cs.Pose((0.4, 0.02, 0.3), (0.0, 0.0, 0.6, 0.8))}
    cycle.step({"cable": (START, END)}, 0, links)
    assert not cycle.edit(cs.Insert(cs.Clip(0.6, cs.Pose(), link="no"))).done
    clip = cs.Clip(0.6, cs.Pose((0.0, 0.06, 0.0)), name="guide", link="tool")
    assert cycle.edit(cs.Insert(clip))
    shape = cycle.step({"cable": (START, END)}, 1, links).shapes["cable"]
    assert shape.status is cs.Status.OK
    assert shape.positions[60] == pytest.approx((links["tool"] * clip.pose).position, abs=1e-6)
    alone = cs.predict(CABLE, START, END, scene=cs.Scene(clips=[clip]), links=links, points=141)
    assert np.abs(shape.positions - alone.positions).max() < 5e-5
    assert cycle.edit(cs.Move("guide", cs.Pose((0.01, 0.05, 0.0))))
    shape = cycle.step({"cable": (START, END)}, 2, links).shapes["cable"]
    assert shape.positions[60] == pytest.approx((links["tool"] * cs.Pose((0.01, 0.05, 0.0))).position, abs=1e-6)
    links = {"tool": cs.Pose((0.42, 0.02, 0.3), (0.0, 0.0, 0.6, 0.8))}
    shape = cycle.step({"cable": (START, END)}, 3, links).shapes["cable"]
    assert shape.positions[60] == pytest.approx((links["tool"] * cs.Pose((0.01, 0.05, 0.0))).position, abs=1e-6)
    assert cycle.edit(cs.Release("guide"))
    free = cycle.step({"cable": (START, END)}, 4).shapes["cable"]
    assert np.abs(free.positions - cs.predict(CABLE, START, END, points=141).positions).max() < 5e-5


def test_a_trajectory_takes_its_clips_along(robot: Robot, scene: cs.Scene) -> None:
    """A limit that is reached only because the clip moves is found between two waypoints, as a finer path finds it."""
    left = np.array([name.startswith("left") for name in robot.joint_names])

    def at(k: float) -> np.ndarray:
        return np.where(left, arms(robot, k), robot.home)

    path = cs.JointPath(robot.joint_names, np.array([at(0.0), at(8.0)]))
    found = cs.check_trajectory(CABLE, scene, robot, path)
    assert found.valid, found
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat", tolerance=1e-4 * CABLE.length)
    tension = []
    for k in np.linspace(0.0, 8.0, 81):
        shape = predictor.predict(*robot.grips(at(k)), robot.link_poses())
        tension.append((shape.force[shape.arc_length > 0.3] * shape.tangents[shape.arc_length > 0.3]).sum(axis=1).max())
    bound = tension[0] + 0.5 * (max(tension) - tension[0])
    assert max(tension) > 1.05 * tension[0]
    strict = cs.check_trajectory(CABLE.replace(max_tension=bound), scene, robot, path)
    assert strict.first is not None
    assert strict.first.reason is cs.Reason.TENSION
    first = np.flatnonzero(np.array(tension) > bound)[0] / 80.0
    assert strict.first.place == pytest.approx(first, abs=0.04)
    table = np.tile(START.array, (2, 1))
    with pytest.raises(cs.RobotError, match="clip 'clip0' is on link 'left_tool', and no joint positions tell"):
        cs.check_trajectory(CABLE, scene, robot, cs.GripPath(table, table + np.array((0.8, 0, 0, 0, 0, 0, 0))))


def test_trajectories_of_several_cables_and_harnesses_do_so_too(robot: Robot, scene: cs.Scene) -> None:
    path = cs.JointPath(robot.joint_names, np.array([arms(robot, k) for k in (0.0, 3.0)]))
    one = cs.check_trajectory(CABLE, scene, robot, path)
    several = cs.check_trajectory(
        {"a": CABLE}, scene, robot, path, ends={"a.start": "left", "a.end": "right"}, tolerance=1e-4 * CABLE.length
    )
    assert several.valid
    assert one.valid
    halves = cs.Harness(
        {"a": CABLE.replace(length=0.7), "b": CABLE.replace(length=0.7)}, [cs.Junction("j", ("a.end", "b.start"))]
    )
    clips = [cs.Clip(c.arc_length, c.pose, segment="a", link=LINK) for c in scene.clips]
    harness = cs.check_trajectory(
        halves, cs.Scene(clips=clips), robot, path, ends={"a.start": "left", "b.end": "right"}
    )
    assert harness.valid
    for margins in zip(one.margins, several.margins, harness.margins, strict=True):
        radii = [max(m.used for m in of if m.kind is cs.WarningKind.OVERSTRETCHED) for of in margins[:2]]
        assert radii[0] == pytest.approx(radii[1], rel=1e-3)


def test_a_replay_moves_clips_with_the_joints(tmp_path: Path, robot: Robot, scene: cs.Scene) -> None:
    bag = write_bag(
        tmp_path / "bag",
        [joints_entry(BEGIN + k * PERIOD, list(robot.joint_names), arms(robot, k)) for k in range(4)],
    )
    run(bag, tmp_path / "out", robot=robot, cable=CABLE, scene=scene, points=141, model="cosserat")
    cycle = cs.Cycle(CABLE, scene=scene, points=141, model="cosserat", robot_links=robot.link_geometry)
    shapes = messages(tmp_path / "out", "/cable/shape")
    assert len(shapes) == 4
    for k, (_, message) in enumerate(shapes):
        own = cycle.step({"cable": robot.grips(arms(robot, k))}, k, robot.link_poses()).shapes["cable"]
        assert own.status is cs.Status.OK
        assert np.array_equal(message.positions, own.positions.ravel())
        there = own.positions[30]
        assert there == pytest.approx((robot.link_poses()[LINK] * scene.clips[1].pose).position, abs=1e-6)
    poses = write_bag(tmp_path / "poses", motion(2))
    with pytest.raises(cs.RobotError, match="clip 'clip0' is on link 'left_tool', and no joint positions tell"):
        run(poses, tmp_path / "none", robot=robot, cable=CABLE, scene=scene, model="cosserat")


def test_scenes_in_files_hold_them(tmp_path: Path, scene: cs.Scene) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(json.dumps(scene.as_dict()))
    assert cs.Scene.from_yaml(file) == scene
