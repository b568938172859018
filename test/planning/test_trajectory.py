"""check_trajectory: what is wrong along a motion, and that nothing hides between two waypoints."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rods import CABLE
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.safety import advance
from cable_shape.planning.paths import MOST_WAYPOINTS, Motion
from cable_shape.robots.robot import Robot
from cable_shape.safety.clearance import ClearanceChecker

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
ROBOT = Path(__file__).resolve().parents[2] / "config" / "robots" / "dual_arm.yaml"
FREE = cs.Scene()


def row(place: tuple[float, float, float], turn: float = 0.0) -> np.ndarray:
    """A pose (7,) of the cable's end, turned about y."""
    return np.array((*place, *(Rotation.from_rotvec((0.0, turn, 0.0)) * ALONG_X).as_quat()))


def sideways(waypoints: int = 3, far: float = 0.6) -> cs.GripPath:
    """Both grips move along y, from -far to far."""
    y = np.linspace(-far, far, waypoints)
    return cs.GripPath(
        np.array([row((0.0, v, 0.0)) for v in y]), np.array([row((0.8, v, 0.0)) for v in y]), np.arange(waypoints) + 5.0
    )


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(ROBOT)


def swing(robot: Robot, wide: float = 0.05, waypoints: int = 8) -> cs.JointPath:
    """Both arms swing from home, by up to `wide` [rad] a joint."""
    arms = np.array(["finger" not in name for name in robot.joint_names])
    way = np.sin(np.linspace(0.0, np.pi, waypoints))
    return cs.JointPath(robot.joint_names, robot.home + wide * way[:, None] * arms)


def test_a_free_motion_is_valid_and_its_shapes_are_the_predictors() -> None:
    path = sideways(waypoints=7)
    found = cs.check_trajectory(CABLE, FREE, None, path)
    assert found.valid
    assert found.done.all()
    assert found.segments.all()
    assert found.waypoints == (None,) * 7
    assert not found.robot_checked
    assert (found.clearance == np.inf).all()
    assert [m.kind for m in found.margins[3]] == [cs.WarningKind.OVERSTRETCHED, cs.WarningKind.STABILITY]
    assert found.margins[3][0].used == pytest.approx(0.8 / CABLE.length)


def test_a_post_between_two_waypoints_is_found() -> None:
    """The cable sweeps 1.2 m over a post of 40 mm: it is clear of it at all three waypoints but y = 0.2 m."""
    post = cs.Obstacle("post", cs.Capsule(0.02, 1.0), cs.Pose((0.4, 0.2, -0.5)))
    found = cs.check_trajectory(CABLE, cs.Scene(obstacles=[post]), None, sideways())
    assert found.waypoints == (None, None, None)
    assert found.segments.tolist() == [True, False]
    first = found.first
    assert first is not None
    assert first.reason is cs.Reason.CLEARANCE
    assert first.other == "post"
    # the cable lies in a vertical plane at y, its surface 4 mm from it: 34 mm before the post it is too near
    radius = 0.5 * CABLE.diameter
    assert -0.6 + 0.6 * first.place == pytest.approx(0.2 - 0.02 - 0.01 - radius, abs=1e-3)
    assert first.time == pytest.approx(5.0 + first.place)
    assert "post" in repr(found)


def test_a_wire_much_thinner_than_a_step_is_found() -> None:
    wire = cs.Obstacle("wire", cs.Capsule(1e-4, 1.0), cs.Pose((0.4, 0.123, -0.5)))
    scene = cs.Scene(obstacles=[wire], error_distance=0.0, warn_distance=0.0)
    found = cs.check_trajectory(CABLE, scene, None, sideways(waypoints=2))
    assert found.first is not None
    assert found.first.other == "wire"
    assert not found.segments[0]


def test_passing_a_post_at_a_little_more_than_the_limit_is_valid() -> None:
    """The grips rise along z past a ball beside the plane of the cable."""
    z = np.linspace(-0.2, 0.8, 3)
    path = cs.GripPath([row((0.0, 0.0, v)) for v in z], [row((0.8, 0.0, v)) for v in z])
    reach = 0.02 + 0.01 + 0.5 * CABLE.diameter
    for gap, valid in ((5e-4, True), (-5e-4, False)):
        ball = cs.Obstacle("ball", cs.Sphere(0.02), cs.Pose((0.4, reach + gap, 0.1)))
        assert cs.check_trajectory(CABLE, cs.Scene(obstacles=[ball]), None, path).valid is valid


@pytest.mark.parametrize(
    ("ends", "limit", "reason"),
    [
        # past the start at equal distances: the bend is the same at both waypoints and sharpest half way
        (((0.45, -0.8), (0.45, 0.8)), "min_bend_radius", cs.Reason.BEND_RADIUS),
        (((0.9, 0.0), (1.17, 0.0)), "max_tension", cs.Reason.TENSION),
    ],
)
def test_a_load_beyond_its_limit_between_waypoints_is_found(ends: tuple, limit: str, reason: cs.Reason) -> None:
    rows = [row((x, y, 0.0)) for x, y in ends]
    path = cs.GripPath([row((0.0, 0.0, 0.0))] * 2, rows)
    predictor, motion = cs.Predictor(CABLE, model="cosserat"), Motion(path, None)
    shapes = [predictor.predict(*motion.at(place)[0]) for place in np.linspace(0.0, 1.0, 201)]
    if reason is cs.Reason.TENSION:
        loads = np.array([shape.tension.max() for shape in shapes])
        bound = 0.5 * (loads[0] + loads[-1])
    else:
        loads = -np.array([shape.bend_radius.min() for shape in shapes])
        assert loads[0] == pytest.approx(loads[-1], rel=1e-3)
        bound = -(0.1 * max(loads[0], loads[-1]) + 0.9 * loads.max())
    found = cs.check_trajectory(CABLE.replace(**{limit: abs(bound)}), FREE, None, path)
    assert found.waypoints[0] is None
    assert found.first is not None
    assert found.first.reason is reason
    over = np.flatnonzero(loads > (bound if reason is cs.Reason.TENSION else -bound))[0] / 200.0
    assert found.first.place == pytest.approx(over, abs=0.01)
    assert cs.check_trajectory(
        CABLE.replace(**{limit: abs(loads.max()) * (1.01 if reason is cs.Reason.TENSION else 0.99)}), FREE, None, path
    ).valid


def test_a_snap_on_the_way_is_told() -> None:
    """A weightless strip bent upwards is turned at both ends until it snaps through."""
    cable = cs.Cable(length=1.0, linear_density=0.0, bending_stiffness=0.02, twisting_stiffness=0.015)
    turns = np.linspace(-0.6, 0.6, 5)
    path = cs.GripPath(
        [row((0.0, 0.0, 0.0), 1.02 * turn) for turn in turns], [row((0.9, 0.0, 0.0), -turn) for turn in turns]
    )
    found = cs.check_trajectory(cable, FREE, None, path)
    assert found.first is not None
    assert found.first.reason in (cs.Reason.SNAP, cs.Reason.STABILITY)
    assert 2.0 < found.first.place < 4.0


def test_a_chord_too_long_is_told_where_it_is() -> None:
    path = cs.GripPath([row((0.0, 0.0, 0.0))] * 2, [row((v, 0.0, 0.0)) for v in (1.1, 1.3)])
    found = cs.check_trajectory(CABLE, FREE, None, path)
    assert found.first is not None
    assert found.first.reason is cs.Reason.OVERSTRETCHED
    assert 1.1 + 0.2 * found.first.place == pytest.approx(CABLE.length, abs=1e-3)
    assert found.waypoints[1] is not None


@pytest.mark.parametrize("held", ["clip", "table"])
def test_cables_in_clips_and_on_obstacles_are_checked_too(held: str) -> None:
    """A clip holds the middle, or the cable rests on a table; a ball, or the table as a mere obstacle, is too near."""
    y = np.linspace(-0.05, 0.05, 3)
    path = cs.GripPath([row((0.0, v, 0.0)) for v in y], [row((0.9, v, 0.0)) for v in y])
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.25)))
    if held == "clip":
        scene = {"clips": [cs.Clip(0.6, cs.Pose((0.45, 0.0, -0.2)))]}
    else:
        scene = {"obstacles": [table], "contact": "solve"}
    assert cs.check_trajectory(CABLE, cs.Scene(**scene), None, path).valid
    scene["obstacles"] = [*scene.get("obstacles", []), cs.Obstacle("ball", cs.Sphere(0.03), cs.Pose((0.0, 0.08, 0.0)))]
    scene["contact"] = "warn"
    found = cs.check_trajectory(CABLE, cs.Scene(**scene), None, path)
    assert found.first is not None
    assert found.first.reason is cs.Reason.CLEARANCE
    assert found.first.other == ("ball" if held == "clip" else "table")


def test_joint_paths_check_the_robots_links_and_limits(robot: Robot) -> None:
    cable = CABLE.replace(length=0.9)
    path = swing(robot)
    found = cs.check_trajectory(cable, FREE, robot, path)
    assert found.valid
    assert found.robot_checked
    assert (found.clearance < 0.1).all()
    far = path.positions.copy()
    far[4, 0] = robot.upper[0] + 0.01
    over = cs.check_trajectory(cable, FREE, robot, cs.JointPath(robot.joint_names, far)).waypoints[4]
    assert over is not None
    assert over.reason is cs.Reason.JOINT_LIMIT
    assert over.other == robot.joint_names[0]
    assert over.value == pytest.approx(robot.upper[0] + 0.01)


def test_verdicts_are_those_of_a_check_a_hundred_times_finer(robot: Robot) -> None:
    cable = CABLE.replace(length=0.9, min_bend_radius=0.03)
    seen = []
    for seed in range(6):
        random = np.random.default_rng(seed)
        path = swing(robot, wide=0.12, waypoints=4)
        near = [random.uniform((0.25, -0.3, 0.1), (0.55, 0.3, 0.5)) for _ in range(2)]
        scene = cs.Scene([cs.Obstacle(f"ball_{i}", cs.Sphere(0.03), cs.Pose(p)) for i, p in enumerate(near)])
        found = cs.check_trajectory(cable, scene, robot, path)
        motion = Motion(path, robot)
        cycle = cs.Cycle(
            cable,
            scene=scene,
            robot_links=robot.link_geometry,
            gripping_links=robot.gripping_links,
            model="cosserat",
            snap_horizon=0.0,
        )
        valid = True
        for k, place in enumerate(np.linspace(0.0, 3.0, 301)):
            (start, end), links = motion.at(place)
            report = cycle.step({"cable": (start, end)}, k, links)
            valid &= not any(w.severity is cs.Severity.ERROR for w in report.warnings)
        assert found.valid == valid, seed
        assert found.solved < 100
        seen.append(valid)
    assert len(set(seen)) == 2  # both verdicts occur


def test_messages_are_read_as_joint_paths(robot: Robot) -> None:
    path = swing(robot, waypoints=3)
    order = list(range(len(robot.joint_names)))[::-1]
    points = [
        SimpleNamespace(positions=q[order].tolist(), time_from_start=SimpleNamespace(sec=i, nanosec=500_000_000))
        for i, q in enumerate(path.positions)
    ]
    message = SimpleNamespace(joint_names=[robot.joint_names[i] for i in order], points=points)
    read = cs.JointPath.from_message(message)
    assert read.times is not None
    assert read.times.tolist() == [0.5, 1.5, 2.5]
    np.testing.assert_allclose(Motion(read, robot).joints, Motion(path, robot).joints)
    points[1].positions = [0.0]
    with pytest.raises(cs.ArgumentError, match="one position for every joint"):
        cs.JointPath.from_message(message)


def test_a_time_limit_gives_what_is_done_and_says_so() -> None:
    found = cs.check_trajectory(CABLE, FREE, None, sideways(), time_limit=1e-9)
    assert found.partial
    assert not found.valid
    assert not found.done.any()


def test_one_waypoint_is_a_trajectory() -> None:
    assert cs.check_trajectory(CABLE, None, None, sideways(waypoints=1)).valid


def test_bad_trajectories_are_named(robot: Robot) -> None:
    names, q = robot.joint_names, np.array([robot.home, robot.home])
    with pytest.raises(cs.UnknownKeyError, match="left_elbow_jont"):
        cs.check_trajectory(
            CABLE, FREE, robot, cs.JointPath([n.replace("left_elbow_joint", "left_elbow_jont") for n in names], q)
        )
    with pytest.raises(cs.ArgumentError, match="Give the Robot"):
        cs.check_trajectory(CABLE, FREE, None, cs.JointPath(names, q))
    with pytest.raises(cs.InputError, match="left_elbow_joint missing"):
        cs.check_trajectory(CABLE, FREE, robot, cs.JointPath(names[3:], q[:, 3:]))
    with pytest.raises(cs.ArgumentError, match=r"times\[2\].*later"):
        cs.GripPath(*(np.tile(row((x, 0.0, 0.0)), (3, 1)) for x in (0.0, 0.8)), times=(0.0, 1.0, 1.0))
    with pytest.raises(cs.ArgumentError, match="0 waypoints"):
        cs.JointPath(names, np.empty((0, len(names))))
    with pytest.raises(cs.ArgumentError, match=r"positions\[1\].*finite"):
        cs.JointPath(("a",), [[0.0], [np.nan]])
    with pytest.raises(cs.ArgumentError, match="Split the trajectory"):
        cs.JointPath(("a",), np.zeros((MOST_WAYPOINTS + 1, 1)))
    with pytest.raises(cs.ArgumentError, match="bending_stiffness"):
        cs.check_trajectory(CABLE.replace(bending_stiffness=0.0), FREE, None, sideways())


def test_the_reach_bounds_how_far_a_tool_is_from_a_joint_that_moves_it(robot: Robot) -> None:
    """By finite differences: a tool moves by less than reach a radian."""
    random = np.random.default_rng(0)
    arms = np.array(["finger" not in name for name in robot.joint_names])
    for _ in range(20):
        q = robot.home + random.normal(0.0, 0.5, len(arms)) * arms
        for joint in np.flatnonzero(arms):
            step = np.zeros(len(arms))
            step[joint] = 1e-5
            before, after = robot.grips(q), robot.grips(q + step)
            for a, b in zip(before, after, strict=True):
                assert np.linalg.norm(b.pose.position - a.pose.position) <= 1e-5 * robot.reach * (1.0 + 1e-6)
    assert robot.reach < 3.0


def test_the_deviation_bounds_what_the_cable_does_between() -> None:
    """On a lively motion the chord and the deviation bound every point at every place between."""
    predictor = cs.Predictor(CABLE, model="cosserat")
    path = cs.GripPath(
        [row((0.0, 0.0, 0.0)), row((0.05, 0.1, 0.0), 0.2)], [row((0.9, 0.0, 0.0)), row((0.7, 0.05, 0.1), -0.3)]
    )
    motion = Motion(path, None)
    found = []
    for place in np.linspace(0.0, 1.0, 41):
        (start, end), _ = motion.at(place)
        shape = predictor.predict(start, end)
        found.append((shape.positions, predictor.sensitivity(), np.array((start.array, end.array))))
    (p, a, ends_a), (q, b, ends_b) = found[0], found[-1]
    way, off = advance.motion(p, q, a, b, ends_a, ends_b, 0.0, 0.0)
    assert way == pytest.approx(np.linalg.norm(q - p, axis=1).max())
    apart = [
        np.linalg.norm(r - (1.0 - x) * p - x * q, axis=1).max()
        for x, (r, _, _) in zip(np.linspace(0.0, 1.0, 41), found, strict=True)
    ]
    assert max(apart) < off < 10.0 * max(apart)


def test_a_check_that_may_not_proceed_gives_what_is_done() -> None:
    seen: list[int] = []

    def proceed(found: cs.TrajectoryCheck) -> bool:
        seen.append(int(found.done.sum()))
        return seen[-1] < 2

    found = cs.check_trajectory(CABLE, FREE, None, sideways(waypoints=7), proceed=proceed)
    assert seen[0] == 0
    assert seen == sorted(seen)
    assert seen[-1] == 2
    assert found.done.tolist() == [True, True] + [False] * 5
    assert found.partial
    assert not found.valid
    assert found.first is None


PUSH = np.array((0.0, 6.0, 1.0))


def test_a_constant_acceleration_and_a_load_are_what_the_predictor_takes_them_for() -> None:
    ball = cs.Obstacle("ball", cs.Sphere(0.05), cs.Pose((0.4, 0.1, -0.3)))
    scene, path = cs.Scene(obstacles=[ball]), sideways()
    tilted = cs.check_trajectory(CABLE, scene, None, path, gravity=(0, 0, -9.81) - PUSH)
    weight = -CABLE.linear_density * np.array((PUSH, PUSH))
    assert tilted.first is not None
    for options in (
        {"acceleration": np.tile(PUSH, (3, 1))},
        {"acceleration": np.tile(PUSH, (3, 9, 1))},
        {"distributed_load": weight},
    ):
        found = cs.check_trajectory(CABLE, scene, None, path, **options)
        assert found.first is not None
        assert found.first.reason is cs.Reason.CLEARANCE
        assert found.first.place == pytest.approx(tilted.first.place, abs=2e-3)
        np.testing.assert_allclose(found.clearance, tilted.clearance, rtol=0.0, atol=1e-5)
    assert cs.check_trajectory(CABLE, scene, None, path).valid


def test_a_cable_that_swings_into_a_wire_between_waypoints_is_found() -> None:
    """The grips stand still; the cable is accelerated more and more, in its middle more than at its ends."""
    path = cs.GripPath(*(np.tile(row((x, 0.0, 0.0)), (3, 1)) for x in (0.0, 0.8)))
    table = np.zeros((3, 5, 3))
    table[1], table[2] = (0.0, 1.0, 0.0), np.outer((0.5, 1.0, 1.2, 1.0, 0.5), (0.0, -9.0, 2.0))
    predictor = cs.Predictor(CABLE, model="cosserat", tolerance=1e-4 * CABLE.length)

    def shape_at(place: float) -> cs.CableShape:
        return predictor.predict(*(cs.Pose(p[0, :3], p[0, 3:]) for p in (path.starts, path.ends)),
                                 acceleration=(2.0 - place) * table[1] + (place - 1.0) * table[2])  # fmt: skip

    middle = shape_at(1.45).positions[75]
    wire = cs.Obstacle("wire", cs.Capsule(1e-4, 0.05), cs.Pose(middle))  # upright
    scene = cs.Scene(obstacles=[wire], error_distance=0.0, warn_distance=0.0)
    found = cs.check_trajectory(CABLE, scene, None, path, acceleration=table)
    assert found.waypoints == (None, None, None)
    assert found.segments.tolist() == [True, False]
    assert found.first is not None
    assert found.first.other == "wire"
    checker = ClearanceChecker(scene, radius=0.5 * CABLE.diameter)
    distances = [
        checker.check(shape_at(place)).bodies[0].distance for place in (found.first.place, found.first.place - 2e-3)
    ]
    assert distances[0] < 1e-5 < distances[1]
    assert cs.check_trajectory(CABLE, scene, None, path, acceleration=0.3 * table).valid


def test_where_accelerations_change_the_deviation_still_bounds_what_the_cable_does() -> None:
    """As where they do not, the load being linear along the way."""
    predictor = cs.Predictor(CABLE, model="cosserat")
    for ends in ((0.7, 0.05, 0.1, -0.3), (0.9, 0.0, 0.0, 0.0)):
        path = cs.GripPath(
            [row((0.0, 0.0, 0.0)), row((0.05, 0.1, 0.0), 0.2)], [row((0.9, 0.0, 0.0)), row(ends[:3], ends[3])]
        )
        motion = Motion(path, None)
        for push in ((0.0, 3.0, 0.0), (2.0, -3.0, 4.0)):
            found = []
            for place in np.linspace(0.0, 1.0, 21):
                (start, end), _ = motion.at(place)
                shape = predictor.predict(start, end, acceleration=place * np.array(push))
                found.append((shape.positions, predictor.sensitivity(), np.array((start.array, end.array))))
            (p, a, ends_a), (q, b, ends_b) = found[0], found[-1]
            off = advance.motion(p, q, a, b, ends_a, ends_b, 0.0, 0.0)[1]
            apart = [
                np.linalg.norm(r - (1.0 - x) * p - x * q, axis=1).max()
                for x, (r, _, _) in zip(np.linspace(0.0, 1.0, 21), found, strict=True)
            ]
            assert max(apart) < off


def test_accelerations_in_contact_are_linear_along_the_cable_at_every_waypoint() -> None:
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.25)))
    scene, path = cs.Scene(obstacles=[table], contact="solve"), sideways(waypoints=3, far=0.05)
    rows = np.zeros((3, 7, 3))
    rows[:] = np.linspace((0.0, 1.0, 0.1), (0.3, -2.0, 0.7), 7)
    rows[2] = -rows[0]  # between them nothing is left but rounding
    assert cs.check_trajectory(CABLE, scene, None, path, acceleration=rows).valid
    rows[2, 3] += 1.0
    seen: list[int] = []
    with pytest.raises(cs.ArgumentError, match=r"contact='solve'.*linear"):
        cs.check_trajectory(CABLE, scene, None, path, acceleration=rows, proceed=lambda found: not seen.append(1))
    assert not seen


def test_a_cable_that_comes_to_lie_on_a_table_on_the_way_is_checked_through() -> None:
    """It bows to one side from the beginning, and so does not fall to one where it is laid down."""
    table = cs.Obstacle("table", cs.HalfSpace())
    scene, cable = cs.Scene(obstacles=[table], contact="solve"), CABLE.replace(length=0.83)
    z = np.linspace(0.16, 0.06, 5)
    aside = [(Rotation.from_rotvec((0.0, 0.0, a)) * ALONG_X).as_quat() for a in (0.4, -0.4)]
    path = cs.GripPath([(0.0, 0.0, v, *aside[0]) for v in z], [(0.8, 0.0, v, *aside[1]) for v in z])
    found = cs.check_trajectory(cable, scene, None, path)
    assert found.valid, found
    assert found.clearance[0] > 0.001 > abs(found.clearance[-1])


def test_a_cable_that_comes_to_touch_itself_on_the_way_is_checked_through() -> None:
    cable = cs.Cable(1.0, 0.005, 0.004, 0.003, diameter=0.008)
    turns = 2.0 * np.pi * np.linspace(0.9, 1.25, 8)
    ends = [(*(0.3, 0.0, 0.0), *(Rotation.from_rotvec((a, 0.0, 0.0)) * ALONG_X).as_quat()) for a in turns]
    path = cs.GripPath([row((0.0, 0.0, 0.0))] * 8, np.array(ends))
    wound = cs.Predictor(cable, model="cosserat", scene=cs.Scene(contact="solve"))
    for a in np.arange(0.0, turns[-1], 0.05):
        end = cs.Pose((0.3, 0.0, 0.0), (Rotation.from_rotvec((a, 0.0, 0.0)) * ALONG_X).as_quat())
        shape = wound.predict(cs.Pose((0.0, 0.0, 0.0), ALONG_X.as_quat()), end)
    assert shape.contacts  # wound up so far it touches itself
    found = cs.check_trajectory(cable, cs.Scene(contact="solve"), None, path, tolerance=1e-5)
    assert found.done.all()
    assert found.first is None or found.first.reason is cs.Reason.SNAP


def test_a_cable_that_has_come_off_a_body_has_a_sensitivity() -> None:
    table = cs.Obstacle("table", cs.HalfSpace())
    predictor = cs.Predictor(
        CABLE.replace(bending_stiffness=0.1), model="cosserat", scene=cs.Scene(obstacles=[table], contact="solve")
    )
    touched = 0
    for height in (*np.linspace(0.5, 0.35, 8), *np.linspace(0.35, 0.5, 16)):
        start, end = (cs.Pose((x, 0.0, height), ALONG_X.as_quat()) for x in (0.0, 0.8))
        shape = predictor.predict(start, end)
        touched += bool(shape.contacts)
        slopes = predictor.sensitivity()
        higher = slopes[:, 2, 2] + slopes[:, 2, 8]
        assert higher[0] == pytest.approx(1.0, abs=1e-3)
        if not shape.contacts:
            assert higher == pytest.approx(1.0, abs=1e-3)  # the whole cable goes with its ends
    assert touched
    assert not shape.contacts
