"""check_trajectory of a harness: no violation of any segment hides between two waypoints."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.planning.paths import EndsPath
from cable_shape.robots.robot import Robot

ROOT = Path(__file__).resolve().parents[2]
ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
CABLE = cs.Cable(length=0.6, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
FORK = cs.Junction(
    "fork", ("a.end", "b.start", "c.start"), frames={"c.start": cs.Pose(quaternion=(0, 0.48, 0, 0.8773))}
)
HARNESS = cs.Harness({"a": CABLE, "b": CABLE, "c": CABLE.replace(length=0.3)}, [FORK])
PLUG = cs.FreeEnd(mass=0.02)


def path(waypoints: int, far: float = 0.3) -> dict[str, object]:
    """Both held ends go sideways by `far` [m], and the free one hangs with a plug."""
    aside = np.linspace(0.0, far, waypoints)
    starts = np.array([(0.0, y, 0.5, *ALONG) for y in aside])
    ends = np.array([(0.8, y + 0.1, 0.5, *ALONG) for y in aside])
    return {"a.start": starts, "b.end": ends, "c.end": PLUG}


def post(y: float, radius: float = 0.01) -> cs.Obstacle:
    """A post that the plug's branch passes when both ends have gone sideways by y."""
    shape = cs.predict(HARNESS, ends_at(y))
    x, beside, _ = shape.segments["c"].positions[-1]
    return cs.Obstacle("post", cs.Cylinder(radius, 0.02), cs.Pose((x, beside, shape.segments["c"].positions[-1, 2])))


def ends_at(y: float) -> dict[str, cs.Pose | cs.FreeEnd]:
    return {"a.start": cs.Pose((0.0, y, 0.5), ALONG), "b.end": cs.Pose((0.8, y + 0.1, 0.5), ALONG), "c.end": PLUG}


def test_a_free_way_is_valid_and_told_segment_by_segment() -> None:
    found = cs.check_trajectory(HARNESS, cs.Scene(obstacles=[post(1.0)]), None, EndsPath(path(4), times=[0, 1, 2, 3]))
    assert found.valid
    assert found.done.all()
    assert found.segments.all()
    assert set(found.margins_of) == {"a", "b", "c"}
    assert all(len(of) == 4 for of in found.margins_of.values())
    assert len(found.margins[0]) == sum(len(of[0]) for of in found.margins_of.values())
    assert (found.clearance == np.inf).all()


def test_accelerations_of_segments_are_followed_and_stability_is_told() -> None:
    """At the waypoints it is what single predictions, and cycles, say."""
    moves = {"a": np.array([(0.0, 0.0, 0.0), (0.0, 4.0, 0.0), (1.0, 2.0, 0.0)]), "c": np.full((3, 2, 3), 0.5)}
    found = cs.check_trajectory(HARNESS, cs.Scene(), None, EndsPath(path(3)), acceleration=moves)
    assert found.valid, found.first
    cycle = cs.Cycle({"h": HARNESS}, tolerance=1e-4 * 0.6)
    for k, y in enumerate((0.0, 0.15, 0.3)):
        now = {name: table[k] for name, table in moves.items()}
        report = cycle.step({"h": ends_at(y)}, k * 10**9, acceleration={"h": now})
        for name, margins in found.margins_of.items():
            told = {m.kind: m.value for m in margins[k]}
            wanted = {m.kind: m.value for m in report.margins[f"h/{name}"]}
            assert told == pytest.approx(wanted, rel=2e-3)
    assert any(m.kind is cs.WarningKind.STABILITY for m in found.margins[2])
    still = cs.check_trajectory(HARNESS, cs.Scene(), None, EndsPath(path(3)))
    assert len(still.margins[1]) == len(found.margins[1])


def test_a_thin_post_between_two_waypoints_is_found_and_names_the_segment() -> None:
    """What it is hit at is where a fine walk of single predictions first comes too near."""
    scene = cs.Scene(obstacles=[post(0.16)], error_distance=0.002)
    found = cs.check_trajectory(HARNESS, scene, None, EndsPath(path(2), times=[0.0, 3.0]))
    assert not found.valid
    assert found.waypoints == (None, None)
    assert not found.segments[0]
    first = found.first
    assert (first.reason, first.segment, first.other) == (cs.Reason.CLEARANCE, "c", "post")
    assert "segment 'c'" in first.text
    assert first.time == pytest.approx(3.0 * first.place)
    cycle = cs.Cycle({"h": HARNESS}, scene=scene)
    near = []
    for k, place in enumerate(np.linspace(0.0, first.place + 0.02, 61)):
        report = cycle.step({"h": ends_at(0.3 * place)}, stamp=k)
        closest = report.clearance["h/c"].closest
        near.append((place, math.inf if closest is None else closest.distance))
    before = [place for place, distance in near if distance >= 0.002]
    beyond = [place for place, distance in near if distance < 0.002]
    assert max(before) - 1e-3 <= first.place <= min(beyond) + 0.02
    assert found.solved < 60


def test_a_limit_of_one_segment_is_its_violation() -> None:
    limit = 1.3 * float(cs.predict(HARNESS, ends_at(0.0)).segments["b"].tension.max())
    weak = HARNESS.replace(segments={**HARNESS.segments, "b": CABLE.replace(max_tension=limit)})
    apart = path(3)
    apart["b.end"][:, 0] += np.array((0.0, 0.1, 0.34))
    found = cs.check_trajectory(weak, None, None, apart)
    assert (found.first.reason, found.first.segment) == (cs.Reason.TENSION, "b")
    assert found.first.value == pytest.approx(limit, rel=0.05)
    assert found.first.limit == limit
    assert 0.0 < found.first.place < 2.0


def test_what_is_out_of_reach_is_overstretched() -> None:
    apart = path(2)
    apart["b.end"][:, 0] += np.array((0.0, 0.5))
    found = cs.check_trajectory(HARNESS, None, None, apart)
    assert found.first.reason is cs.Reason.OVERSTRETCHED
    assert 0.0 < found.first.place < 1.0


def test_the_grippers_of_a_robot_carry_it_and_its_links_are_bodies() -> None:
    robot = Robot.from_yaml(ROOT / "config/robots/dual_arm.yaml")
    scene = cs.Scene.from_yaml(ROOT / "config/scenes/harness.yaml")
    file = HarnessFile.from_yaml(ROOT / "config/harnesses/demo.yaml")
    q = robot.home
    moved = q.copy()
    moved[0] += 0.05
    ends = {"trunk.start": "left", "branch.end": "right", "connector.end": file.held((), scene)["connector.end"]}
    route = cs.JointPath(robot.joint_names, [q, moved])
    found = cs.check_trajectory(file.harness, scene, robot, route, ends=ends, points=60)
    assert found.robot_checked
    assert found.done.all()
    at = robot.grips(q)
    alone = cs.predict(file.harness, {**ends, "trunk.start": at[0], "branch.end": at[1]}, scene=scene, points=60)
    assert (found.waypoints[0] is None) == alone.usable
    with pytest.raises(cs.ArgumentError, match=r"ends = None .* a path of joints does not say"):
        cs.check_trajectory(file.harness, scene, robot, route)
    with pytest.raises(cs.ArgumentError, match="left and right gripper hold one end each"):
        cs.check_trajectory(file.harness, scene, robot, route, ends={"trunk.start": "left"})


def test_a_check_may_be_stopped() -> None:
    found = cs.check_trajectory(HARNESS, None, None, path(5), proceed=lambda told: told.done.sum() < 2)
    assert found.partial
    assert not found.valid
    assert found.done.tolist() == [True, True, False, False, False]
    assert len(found.margins) == 5


@pytest.mark.parametrize(
    ("trajectory", "change", "told"),
    [
        ({}, {}, r"ends = \[\] is not allowed: no end is held"),
        ({"a.end": path(2)["b.end"]}, {}, r"'a.end' is not allowed: it is in junction 'fork'"),
        ({**path(2), "b.end": path(3)["b.end"]}, {}, "b.end = '3 waypoints' is not allowed: a.start has 2"),
        (cs.GripPath(path(2)["a.start"], path(2)["b.end"]), {}, "the ends of a harness have names"),
        (path(2), {"ends": {"a.start": "left"}}, "the trajectory says which are held"),
        (path(2), {"acceleration": np.zeros((2, 3))}, "acceleration = .* it must be a mapping"),
        (path(2), {"acceleration": {"d": np.zeros((2, 3))}}, "acceleration: unknown key 'd'"),
        (path(2), {"acceleration": {"a": np.zeros((3, 3))}}, r"segment 'a': acceleration = 'shape \(3, 3\)'"),
    ],
)
def test_bad_arguments_are_named(trajectory: object, change: dict[str, object], told: str) -> None:
    scene = change.pop("scene", None)
    with pytest.raises(cs.ArgumentError, match=told):
        cs.check_trajectory(HARNESS, scene, None, trajectory, **change)
    with pytest.raises(cs.ArgumentError, match="a cable has a start and an end"):
        cs.check_trajectory(CABLE, None, None, cs.GripPath(path(2)["a.start"], path(2)["b.end"]), ends={})
