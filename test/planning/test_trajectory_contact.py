"""check_trajectory into, through and out of contact: what may be touched, how hard, and that nothing hides there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rods import CABLE
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.planning.paths import Motion
from cable_shape.robots.robot import Robot

ROBOT = Path(__file__).resolve().parents[2] / "config" / "robots" / "dual_arm.yaml"
ASIDE = [(Rotation.from_rotvec((0.0, 0.0, a)) * Rotation.from_quat((0.5,) * 4)).as_quat() for a in (0.4, -0.4)]
TABLE = cs.Obstacle("table", cs.Box((2.0, 2.0, 0.1)), cs.Pose((0.4, 0.0, -0.05)))
HELD = CABLE.replace(length=0.83, diameter=0.008)
LINKED = CABLE.replace(length=0.9, diameter=0.008, min_bend_radius=0.03, max_tension=10.0)


def grips(x: float, z: float) -> tuple[cs.Pose, cs.Pose]:
    """Both ends at height z, bent to one side."""
    return cs.Pose((x, 0.0, z), ASIDE[0]), cs.Pose((x + 0.8, 0.0, z), ASIDE[1])


def moved(places: list[tuple[float, float]]) -> cs.GripPath:
    """Through these (x, z)."""
    ends = [grips(x, z) for x, z in places]
    return cs.GripPath([start.array for start, _ in ends], [end.array for _, end in ends])


def pressed(x: float, z: float, scene: cs.Scene) -> float:
    """[N], by which the table holds the cable, led there from above."""
    predictor = cs.Predictor(HELD, model="cosserat", scene=scene, tolerance=1e-4 * HELD.length)
    for height in np.linspace(0.2, z, 30):
        shape = predictor.predict(*grips(x, height))
    return sum(contact.force for contact in shape.contacts)


def test_a_cable_is_laid_down_drawn_along_and_lifted_again() -> None:
    """The way along a table costs as many shapes as it has waypoints: what holds the cable out needs no bound."""
    scene = cs.Scene(obstacles=[TABLE], contact="solve", allow=[cs.Allow("table")])
    down = [(0.0, z) for z in np.linspace(0.2, 0.06, 6)]
    along = [(x, 0.06) for x in np.linspace(0.005, 0.1, 20)]
    found = cs.check_trajectory(HELD, scene, None, moved([*down, *along, *[(0.1, z) for z in (0.1, 0.2)]]))
    assert found.valid, found
    assert found.clearance[0] > 0.05
    assert found.clearance[-1] > 0.05
    assert np.abs(found.clearance[6:26]).max() < 2e-4
    assert cs.check_trajectory(HELD, scene, None, moved(along)).solved == len(along)


def test_a_cable_that_swings_is_laid_down_drawn_along_and_lifted_again() -> None:
    scene = cs.Scene(obstacles=[TABLE], contact="solve", allow=[cs.Allow("table")])
    cable = HELD.replace(retardation_time=0.05, drag=0.05)
    places = [(0.0, 0.2), (0.0, 0.06), (0.1, 0.06), (0.1, 0.2)]
    path = moved(places)
    timed = cs.GripPath(path.starts, path.ends, [0.0, 0.5, 1.0, 1.3])
    found = cs.check_trajectory(cable, scene, None, timed, motion=True)
    assert found.valid, found
    assert np.abs(found.clearance[1:3]).max() < 1e-3
    assert found.clearance[-1] > 0.02
    assert found.stops[0].settling < 2.0
    gentle = scene.replace(allow=[cs.Allow("table", max_force=1e-3)])
    pressed_hard = cs.check_trajectory(cable, gentle, None, timed, motion=True)
    assert pressed_hard.first is not None
    assert pressed_hard.first.reason is cs.Reason.CONTACT_FORCE
    assert pressed_hard.first.other == "table"
    assert 0.0 < pressed_hard.first.place <= 1.0


def test_the_first_place_where_a_body_presses_too_hard_is_told() -> None:
    most = 0.3
    scene = cs.Scene(obstacles=[TABLE], contact="solve", allow=[cs.Allow("table", max_force=most)])
    found = cs.check_trajectory(HELD, scene, None, moved([(0.0, 0.2), (0.0, 0.02)]))
    assert found.first is not None
    assert found.first.reason is cs.Reason.CONTACT_FORCE
    assert (found.first.other, found.first.limit) == ("table", most)
    assert found.first.value == pytest.approx(most, rel=0.02)
    place = found.first.place
    before, after = (pressed(0.0, 0.2 - 0.18 * at, scene) for at in (place - 0.002, place + 0.002))
    assert before < most < after


@pytest.mark.parametrize(
    ("allow", "distance"), [(cs.Allow("post"), 0.01), (cs.Allow("table", start=0.6), 0.01), (cs.Allow("table"), None)]
)
def test_only_contact_that_is_meant_is_valid(allow: cs.Allow, distance: float | None) -> None:
    """Where a scene names none, all of its obstacles may be touched."""
    post = cs.Obstacle("post", cs.Sphere(0.02), cs.Pose((0.4, 1.0, 0.1)))
    scene = cs.Scene(obstacles=[TABLE, post], contact="solve", allow=[allow])
    path = moved([(0.0, 0.2), (0.0, 0.06)])
    assert cs.check_trajectory(HELD, scene.replace(allow=()), None, path).valid
    found = cs.check_trajectory(HELD, scene, None, path)
    assert found.valid == (distance is None)
    if found.first is not None:
        assert (found.first.reason, found.first.other) == (cs.Reason.CLEARANCE, "table")
        assert found.first.value == pytest.approx(0.01, abs=2e-4)


def finer(robot: Robot, scene: cs.Scene, path: cs.JointPath) -> tuple[bool, set[str]]:
    """Whether each of the places of a path is free of errors, a hundred between two waypoints, and what is touched."""
    motion = Motion(path, robot)
    links = {"robot_links": robot.link_geometry, "gripping_links": robot.gripping_links}
    cycle = cs.Cycle(LINKED, scene=scene, model="cosserat", tolerance=9e-5, snap_horizon=0.0, **links)
    touched: set[str] = set()
    before = np.empty((0, 3))
    for k, place in enumerate(np.linspace(0.0, motion.waypoints - 1.0, 100 * (motion.waypoints - 1) + 1)):
        (start, end), placed = motion.at(place)
        report = cycle.step({"cable": (start, end)}, k, placed)
        shape = report.shapes["cable"]
        touched |= {contact.body for contact in shape.contacts}
        errors = [w for w in report.warnings if w.severity is cs.Severity.ERROR and w.kind.name != "QUASISTATIC"]
        jumped = k > 0 and np.linalg.norm(shape.positions - before, axis=1).max() > 0.02 * LINKED.length
        if shape.status is not cs.Status.OK or errors or jumped:
            return False, touched
        before = shape.positions
    return True, touched


def test_verdicts_in_contact_are_those_of_a_check_a_hundred_times_finer() -> None:
    robot = Robot.from_yaml(ROBOT)
    arms = np.array(["finger" not in name for name in robot.joint_names])
    seen, touched = [], set()
    for seed in (4, 5, 7, 14):
        random = np.random.default_rng(seed)
        knots = robot.home + random.normal(0.0, 0.14, (6, len(arms))) * arms
        path = cs.JointPath(robot.joint_names, CubicSpline(np.arange(6), knots)(np.linspace(0.0, 5.0, 6)))
        post = cs.Obstacle("post", cs.Capsule(0.02, 0.2), cs.Pose((random.uniform(0.3, 0.6), 0.0, 0.05)))
        table = cs.Obstacle("table", TABLE.solid, cs.Pose((0.4, 0.0, 0.03)))
        scene = cs.Scene(
            [table, post],
            contact="solve",
            allow=[cs.Allow("table", max_force=0.5), cs.Allow("post", 0.1, 0.8)],
            error_distance=0.002,
        )
        found = cs.check_trajectory(LINKED, scene, robot, path)
        valid, bodies = finer(robot, scene, path)
        assert found.valid == valid, (seed, found)
        seen.append(valid)
        touched |= bodies
    assert len(set(seen)) == 2  # both verdicts occur
    assert touched >= {"table", "post"}


@pytest.mark.parametrize("seed", [147, 261])
def test_links_that_may_be_touched_push_the_cable(seed: int) -> None:
    """The cable comes to lie over an arm: it is kept out of it, and touching it is wrong where that is not meant."""
    robot = Robot.from_yaml(ROBOT)
    arms = np.array(["finger" not in name for name in robot.joint_names])
    over = robot.home + np.random.default_rng(seed).normal(0.0, 0.5, len(arms)) * arms
    path = cs.JointPath(robot.joint_names, np.linspace(robot.home, over, 6))
    scene = cs.Scene(contact="solve", error_distance=0.002)
    unaware = cs.check_trajectory(LINKED, cs.Scene(), robot, path)
    assert unaware.clearance[-1] < -0.03
    refused = cs.check_trajectory(LINKED, scene, robot, path)
    assert refused.first is not None
    assert refused.first.reason is cs.Reason.CLEARANCE
    links = {body.name for body in robot.link_geometry}
    assert refused.first.other in links
    found = cs.check_trajectory(LINKED, scene.replace(allow=[cs.Allow(name) for name in links]), robot, path)
    assert found.valid, found
    assert abs(found.clearance[-1]) < 2e-4
    timed = cs.JointPath(robot.joint_names, path.positions, np.linspace(0.0, 10.0, 6))  # so slow that it hardly swings
    slow, meant = (
        LINKED.replace(retardation_time=0.1, drag=0.1),
        scene.replace(allow=[cs.Allow(name) for name in links]),
    )
    swung = cs.check_trajectory(slow, meant, robot, timed, motion=True)
    assert swung.valid, swung
    assert swung.clearance == pytest.approx(found.clearance, abs=5e-3)
    held = {"a.start": "left", "a.end": "right"}
    harness = cs.check_trajectory(cs.Harness({"a": slow}), meant, robot, timed, ends=held, motion=True)
    assert harness.valid, harness
    assert harness.clearance == pytest.approx(swung.clearance, abs=5e-4)
    before = found.clearance > 0.002  # where nothing is touched the shapes are the same
    assert found.clearance[before] == pytest.approx(unaware.clearance[before], abs=1e-6)
