"""The planner beside a real node over DDS: the service, the action, and a process that dies."""

import os
import signal
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from cable_shape_msgs.action import CheckTrajectory
from cable_shape_msgs.srv import PredictShapes
from harness import ALONG_X, Goals, child_of, wait_until_gone
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import cable_shape as cs
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.robots.robot import Robot
from cable_shape.ros import planning
from cable_shape.ros.parameters import find_file
from cable_shape.ros.planning import Planner
from cable_shape.ros.serving import Gate
from cable_shape.ros.workers import PlannerSetup

CLEANUP, DEACTIVATE = 2, 4
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
POST = cs.Obstacle("post", cs.Capsule(0.02, 0.6), cs.Pose((0.4, 0.1, 0.2)))
SCENE_YAML = "obstacles:\n- {name: post, capsule: {radius: 0.02, length: 0.6}, position: [0.4, 0.1, 0.2]}\n"
ROBOT = find_file("robots/dual_arm.yaml")
ROWS = 20_000  # planner_rows


def grasps(rows):
    random = np.random.default_rng(3)
    starts = np.tile((0.0, 0.0, 0.6, *ALONG_X), (rows, 1))
    ends = np.tile((0.8, 0.0, 0.6, *ALONG_X), (rows, 1))
    ends[:, :3] += random.uniform(-0.1, 0.1, (rows, 3))
    return starts, ends


def flat(table):
    return np.asarray(table).ravel().tolist()


def sideways(waypoints, reach=0.5):
    """Both grips along y: past the post, or with a small reach not as far."""
    y = np.linspace(-reach, reach, waypoints)
    return [np.array([(x, v, 0.6, *ALONG_X) for v in y]) for x in (0.0, 0.8)]


@pytest.fixture(scope="module")
def planner(start_for_all, tmp_path_factory):
    """A node with a planner, a post and a robot."""
    scene = tmp_path_factory.mktemp("scene") / "scene.yaml"
    scene.write_text(SCENE_YAML)
    return start_for_all(
        scene_file=scene, robot_file=ROBOT, planner="true", planner_rows=ROWS, planner_time_limit=3600.0,
        model="cosserat", tolerance=1.2e-4, diagnostics_period=0.3,
    )  # fmt: skip


def shapes_of(cell, **fields):
    """The answer of PredictShapes."""
    client = cell.node.create_client(PredictShapes, "cable/predict_shapes")
    cell.until(client.service_is_ready, "predict_shapes")
    answer = cell.ask(client, PredictShapes.Request(**fields), "shapes", again=10.0)
    cell.node.destroy_client(client)
    return answer


@pytest.fixture
def check(planner):
    checker = Goals(planner, CheckTrajectory, "cable/check_trajectory")
    yield checker
    checker.client.destroy()


def test_shapes_are_those_of_predict_batch_to_the_bit(planner):
    starts, ends = grasps(300)
    starts[7, 2] = np.nan
    ends[9, 0] = 2.0  # further than the cable is long
    every = sum(getattr(PredictShapes.Request, n) for n in ("POSITIONS", "QUATERNIONS", "CURVATURE", "FORCE", "MOMENT"))
    told = shapes_of(planner, starts=flat(starts), ends=flat(ends), arrays=every)
    scene = cs.Scene(obstacles=[POST])
    own = cs.predict_batch(CABLE, starts, ends, model="cosserat", tolerance=1.2e-4, scene=scene)
    assert (told.success, told.error, told.partial, told.points) == (True, "", False, 150)
    for name in ("positions", "quaternions", "curvature", "force", "moment", "energy", "distances", "used"):
        np.testing.assert_array_equal(np.array(getattr(told, name)), getattr(own, name).ravel(), err_msg=name)
    for name in ("done", "status", "usable", "several"):
        np.testing.assert_array_equal(np.array(getattr(told, name)), getattr(own, name), err_msg=name)
    assert told.bodies == ["post"]
    assert told.done[7] == 0
    assert list(told.told) == [7, 9]
    assert "starts[7]: position = " in told.texts[0]
    assert told.status[9] == cs.Status.OVERSTRETCHED.value
    assert told.usable[9] == 0


def test_a_request_says_points_model_and_what_it_wants_back(planner):
    starts, ends = grasps(3)
    told = shapes_of(planner, starts=flat(starts), ends=flat(ends), points=20, model="catenary", arrays=1)
    own = cs.predict_batch(
        CABLE, starts, ends, points=20, model="catenary", tolerance=1.2e-4, scene=cs.Scene(obstacles=[POST])
    )
    np.testing.assert_array_equal(np.array(told.positions).reshape(3, 20, 3), own.positions)
    assert len(told.force) == 0
    assert len(shapes_of(planner, starts=flat(starts), ends=flat(ends)).positions) == 0


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"starts": [0.0] * 8}, "starts = '8 numbers' is not allowed: it must hold seven numbers"),
        ({"starts": [], "ends": []}, "starts = '0 numbers' is not allowed"),
        ({"starts": flat(grasps(2)[0])}, "ends = '1 rows' is not allowed: it must have as many as starts, 2"),
        ({"starts": [0.0] * 7 * (ROWS + 1)}, "starts = '20001 rows' is not allowed: at most planner_rows = 20000"),
        ({"cable_id": "hose"}, "cable_id: unknown key 'hose'"),
        ({"model": "spline"}, "model = 'spline' is not allowed: it must be one of catenary"),
        ({"points": 1}, "points = 1 is not allowed"),
        ({"points": 4_000_000}, "points = 4000000 is not allowed: it must be a whole number of at least 2 and at most"),
        ({"starts": flat(grasps(400)[0]), "points": 9000}, "grasps times points = 400 * 9000, at most 3000000"),
        ({"tolerance": -1.0}, "tolerance = -1.0 is not allowed: it must be at least 0 m"),
        ({"time_limit": float("nan")}, "time_limit = nan is not allowed: it must be finite"),
        ({"arrays": 64}, "arrays = 64 is not allowed: it must be a sum of the constants"),
    ],
)
def test_a_bad_request_is_answered_with_what_is_wrong(planner, fields, text):
    starts, ends = grasps(1)
    told = shapes_of(planner, **{"starts": flat(starts), "ends": flat(ends), **fields})
    assert not told.success
    assert text in told.error
    assert len(told.status) == 0


def test_beyond_its_time_limit_what_is_done_is_answered(planner):
    starts, ends = grasps(ROWS)
    ends[:, :3] += np.random.default_rng(4).uniform(-0.2, 0.1, (ROWS, 3))  # scattered: every row costs
    told = shapes_of(planner, starts=flat(starts), ends=flat(ends), points=20, time_limit=0.02, arrays=1)
    done = np.array(told.done, bool)
    assert told.success
    assert told.partial
    assert not done.all()
    positions = np.array(told.positions).reshape(ROWS, -1)
    assert np.isnan(positions[~done]).all()
    assert np.isfinite(positions[done]).all()


def test_a_motion_of_both_grips_is_checked(check):
    starts, ends = sideways(5)
    status, told = check(starts=flat(starts), ends=flat(ends), times=[0.0, 1.0, 2.0, 3.0, 4.0])
    own = cs.check_trajectory(
        CABLE, cs.Scene(obstacles=[POST]), None, cs.GripPath(starts, ends, np.arange(5.0)), tolerance=1.2e-4
    )
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert (told.success, told.valid, told.partial, told.robot_checked) == (True, False, False, False)
    first = own.first
    assert (told.first.reason, told.first.other, told.first.text) == ("clearance", "post", first.text)
    assert (told.first.place, told.first.time, told.first.value) == (first.place, first.time, first.value)
    np.testing.assert_array_equal(np.array(told.segments), own.segments)
    np.testing.assert_array_equal(np.array(told.clearance), own.clearance)
    assert list(told.wrong) == [i for i, violation in enumerate(own.waypoints) if violation]
    assert [v.text for v in told.violations] == [v.text for v in own.waypoints if v]
    assert told.solved == own.solved


def test_a_motion_far_from_all_is_valid(check):
    starts, ends = sideways(3, reach=0.02)
    starts[:, 1] -= 0.4
    ends[:, 1] -= 0.4
    status, told = check(starts=flat(starts), ends=flat(ends))
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert told.valid
    assert told.first.reason == ""
    assert list(told.segments) == [1, 1]


def joint_trajectory(steps):
    robot = Robot.from_yaml(ROBOT)
    message = JointTrajectory(joint_names=list(robot.joint_names))
    for i in range(steps):
        q = robot.home + 0.01 * i
        message.points.append(JointTrajectoryPoint(positions=q.tolist(), time_from_start=Duration(sec=i)))
    return robot, message


def test_a_joint_trajectory_is_checked_with_the_robots_links(check):
    robot, message = joint_trajectory(3)
    status, told = check(trajectory=message)
    own = cs.check_trajectory(CABLE, cs.Scene(obstacles=[POST]), robot, message, tolerance=1.2e-4)
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert told.robot_checked
    assert told.valid == own.valid
    assert told.first.text == (own.first.text if own.first else "")
    np.testing.assert_array_equal(np.array(told.clearance), own.clearance)
    assert told.solved == own.solved


def unknown_joint():
    message = joint_trajectory(2)[1]
    message.joint_names[0] = "left_elbow_of_nobody"
    return {"trajectory": message}


def back_in_time():
    message = joint_trajectory(3)[1]
    message.points[2].time_from_start.sec = 0
    return {"trajectory": message}


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        (unknown_joint(), "trajectory.joint_names: unknown key 'left_elbow_of_nobody'"),
        (back_in_time(), "times[2] = 0.0 is not allowed: it must be later than the one before"),
        ({}, "goal = 'neither' is not allowed: give either trajectory or starts and ends"),
        ({"trajectory": joint_trajectory(2)[1], "starts": [0.0] * 7}, "goal = 'both' is not allowed"),
        ({"trajectory": JointTrajectory(joint_names=["a"])}, "positions = "),
        ({"starts": [0.0] * 7 * (ROWS + 1)}, "starts = '20001 rows' is not allowed: at most planner_rows = 20000"),
        ({"starts": [float("nan")] * 7, "ends": [0.0] * 7}, "starts[0] = "),
    ],
)
def test_a_bad_goal_is_aborted_with_what_is_wrong(check, fields, text):
    status, told = check(**fields)
    assert status == GoalStatus.STATUS_ABORTED
    assert not told.success
    assert text in told.error


def long_motion():
    """Minutes of work: from one end of the reach to another, to a thousandth of the tolerance of the others."""
    random = np.random.default_rng(5)
    starts, ends = (np.tile((x, 0.0, 0.6, *ALONG_X), (ROWS, 1)) for x in (0.0, 0.8))
    for table in (starts, ends):
        table[:, :3] += random.uniform(-0.3, 0.3, (ROWS, 3))
    return {"starts": flat(starts), "ends": flat(ends), "tolerance": 1e-8}


def test_a_goal_tells_how_far_it_is_and_is_cancelled_while_the_service_answers(planner, check):
    handle = check.send(**long_motion())
    planner.until(lambda: check.feedback, "feedback")
    starts, ends = grasps(5)
    assert shapes_of(planner, starts=flat(starts), ends=flat(ends)).success  # beside the check
    planner.until(lambda: check.feedback[-1].waypoint > 2, "progress")
    assert check.feedback[-1].waypoints == ROWS
    planner.until(lambda: check.feedback[-1].violated, "a violation")
    cancelled = handle.cancel_goal_async()
    planner.until(cancelled.done, "answer to the cancellation")
    assert len(cancelled.result().goals_canceling) == 1
    status, told = check.answer(handle)
    assert status == GoalStatus.STATUS_CANCELED
    assert (told.success, told.partial, told.valid) == (True, True, False)
    assert 0 < sum(told.done) < ROWS
    assert told.first.other == "post"


def test_a_goal_beyond_its_time_limit_is_partial(check):
    status, told = check(**long_motion(), time_limit=0.3)
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert told.partial
    assert not all(told.done)
    assert list(told.done) == sorted(told.done, reverse=True)  # from the beginning, however far


def test_of_too_many_goals_one_is_refused_and_those_that_wait_are_cancelled_at_once(planner, check):
    handles = [check.send(**long_motion()) for _ in range(5)]
    answers = [handle.get_result_async() for handle in handles]
    planner.until(lambda: any(answer.done() for answer in answers), "refusal")
    (refused,) = (i for i, answer in enumerate(answers) if answer.done())
    assert answers[refused].result().status == GoalStatus.STATUS_ABORTED
    text = "goals = 5 is not allowed: at most 4 may be under way. Wait for a result, or cancel one."
    assert answers[refused].result().result.error == text
    for i in (i for i in range(5) if i != refused):
        planner.until(handles[i].cancel_goal_async().done, "answer to the cancellation")
        planner.until(answers[i].done, "result")
        told = answers[i].result().result
        assert answers[i].result().status == GoalStatus.STATUS_CANCELED
        assert (told.success, told.partial, told.valid) == (True, True, False)


def planner_pid(node):
    return child_of(node, "cable_shape.ros.planning")


@pytest.fixture
def let_go(tmp_path, monkeypatch):
    """A file; as long as it is not there, a planner that has been started does not get on."""
    file = tmp_path / "go"
    (tmp_path / "sitecustomize.py").write_text(
        "import os, sys, time\n"
        "parent = os.getppid()\n"
        "while 'cable_shape.ros.planning' in sys.orig_argv and os.getppid() == parent:\n"
        f"    if os.path.exists({str(file)!r}):\n"
        "        break\n"
        "    time.sleep(0.05)\n"
    )
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH")))))
    return file


def serving(node):
    """Waits for the planner, and for the stand-in that the node has beside it."""
    action = [f"cable/check_trajectory/_action/{name}" for name in ("send_goal", "get_result", "cancel_goal")]
    for name in ("cable/predict_shapes", *action):
        node.until(lambda name=name: node.node.count_services(name) == 2, f"planner and stand-in with {name}")


def test_a_planner_that_dies_is_told_and_started_again_and_cycles_go_on(start, let_go):
    node = start(planner="true", diagnostics_period=0.3)
    node.diagnosis("lifecycle", "the planner's process loads: its services come when it serves", b"\x01")
    let_go.touch()
    node.diagnosis("lifecycle", "active", b"\x00")
    starts, ends = grasps(3)
    assert shapes_of(node, starts=flat(starts), ends=flat(ends)).success
    serving(node)
    first = planner_pid(node)
    os.kill(first, signal.SIGKILL)
    status = node.diagnosis("lifecycle", "the planner's process has ended by signal 9 (1 times so far)", b"\x01")
    assert "It is started again after 1 s" in status.message
    node.predicted()
    second = node.until(lambda: (pid := planner_pid(node)) != first and pid, "a new process")
    node.diagnosis("lifecycle", "active", b"\x00")  # from now on it serves
    assert shapes_of(node, starts=flat(starts), ends=flat(ends)).success
    assert node.process.stop() == 0
    node_text = node.process.text()
    assert "Traceback" not in node_text
    wait_until_gone(second)


def test_whatever_is_asked_while_the_planner_starts_again_is_answered(start, let_go):
    let_go.touch()
    node = start(planner="true", planner_rows=ROWS, planner_time_limit=3600.0, diagnostics_period=0.3, model="cosserat")
    starts, ends = grasps(3)
    request = PredictShapes.Request(starts=flat(starts), ends=flat(ends))
    client = node.node.create_client(PredictShapes, "cable/predict_shapes")
    goals = Goals(node, CheckTrajectory, "cable/check_trajectory")
    node.until(client.service_is_ready, "predict_shapes")
    assert node.ask(client, request, "shapes").success
    serving(node)
    under_way = goals.send(**long_motion()).get_result_async()
    node.until(lambda: goals.feedback, "feedback")
    let_go.unlink()
    os.kill(planner_pid(node), signal.SIGKILL)
    calls, sent, results = [], [], []
    motion = goals.kind.Goal(**dict(zip(("starts", "ends"), map(flat, sideways(2, reach=0.02)), strict=True)))

    def served():
        calls.append(client.call_async(request))
        sent.append(goals.client.send_goal_async(motion))
        node.spin(0.2)
        for future in [future for future in sent if future.done()]:
            sent.remove(future)
            assert future.result().accepted
            results.append(future.result().get_result_async())
        shapes = [call.result().success for call in calls if call.done()]
        checks = [result.result().result.success for result in results if result.done()]
        if not (all(shapes) or all(checks)):  # errors of both kinds came
            let_go.touch()
        return any(shapes) and any(checks)

    node.until(served, "a shape and a check of the new process")
    node.until(under_way.done, "result of the goal under way")
    node.until(lambda: all(call.done() for call in calls), "answers to all calls")
    node.until(lambda: all(future.done() for future in sent), "answers to all goals")
    results += [future.result().get_result_async() for future in sent]
    node.until(lambda: all(future.done() for future in results), "results of all goals")
    assert under_way.result().status == GoalStatus.STATUS_ABORTED
    assert "the planner's process has ended by signal 9" in under_way.result().result.error
    told = [call.result().error for call in calls if not call.result().success]
    assert told
    reasons = ("the planner's process has ended by signal 9", "has just been started again")
    assert all(any(reason in text for reason in reasons) for text in told)
    wrong = [result.result() for result in results if result.result().status == GoalStatus.STATUS_ABORTED]
    assert wrong
    assert all(any(reason in result.result.error for reason in reasons) for result in wrong)
    assert node.process.stop() == 0


def test_the_planner_comes_and_goes_with_the_lifecycle(start):
    node = start(planner="true")
    client = node.node.create_client(PredictShapes, "cable/predict_shapes")
    node.until(client.service_is_ready, "predict_shapes")
    pid = planner_pid(node)
    assert node.transition(DEACTIVATE)
    starts, ends = grasps(1)
    assert shapes_of(node, starts=flat(starts), ends=flat(ends)).success  # it needs no input
    assert node.transition(CLEANUP)
    wait_until_gone(pid)
    node.until(lambda: not client.service_is_ready(), "service gone")
    assert node.process.stop() == 0


@pytest.mark.parametrize(
    ("kind", "module"), [("planner", "cable_shape.ros.planning"), ("calibration", "cable_shape.ros.calibrating")]
)
def test_the_workers_make_way_for_all_others(start, kind, module):
    node = start(**{kind: "true"}, workers_make_way="true")
    pid = node.until(lambda: child_of(node, module), "the process")

    def policies():
        try:
            return {os.sched_getscheduler(int(thread)) for thread in os.listdir(f"/proc/{pid}/task")}
        except ProcessLookupError:  # a thread has just ended
            return set()

    node.until(lambda: policies() == {os.SCHED_IDLE}, "SCHED_IDLE")


def test_with_profiles_large_answers_go_through_their_shared_memory_and_are_the_same(start):
    node = start(planner="true", planner_profiles="fastdds_planner.xml", model="cosserat", tolerance=1.2e-4)
    starts, ends = grasps(200)
    told = shapes_of(node, starts=flat(starts), ends=flat(ends), arrays=31)
    own = cs.predict_batch(CABLE, starts, ends, model="cosserat", tolerance=1.2e-4)
    for name in ("positions", "quaternions", "curvature", "force", "moment"):
        np.testing.assert_array_equal(np.reshape(getattr(told, name), getattr(own, name).shape), getattr(own, name))
    with open(f"/proc/{planner_pid(node)}/maps") as maps:
        sizes = [
            int(line.split("-")[1].split()[0], 16) - int(line.split("-")[0], 16) for line in maps if "fastrtps_" in line
        ]
    assert max(sizes) > 2**25


def test_profiles_that_are_not_there_are_told(start):
    node = start(active=False, planner="true", planner_profiles="nowhere.xml")
    node.diagnosis("lifecycle", "planner_profiles: nowhere.xml: no such file. Check the path", b"\x02")


def test_a_killed_node_takes_its_planner_along(start):
    node = start(planner="true")
    pid = node.until(lambda: planner_pid(node), "the planner")
    node.process.process.kill()
    node.process.process.wait()
    wait_until_gone(pid)


def test_of_several_cables_the_request_names_one(start, tmp_path):
    (tmp_path / "short.yaml").write_text("length: 1.0\nlinear_density: 0.1\nbending_stiffness: 0.01\n")
    file = tmp_path / "two.yaml"
    file.write_text(
        "cables:\n  short: short.yaml\n  long: {length: 1.2, linear_density: 0.1, bending_stiffness: 0.01}\n"
    )
    node = start(cable_file=file, planner="true", model="cosserat", active=False)
    starts, ends = grasps(2)
    lengths = {}
    for name in ("short", "long"):
        told = shapes_of(node, cable_id=name, starts=flat(starts), ends=flat(ends), arrays=1)
        lines = np.array(told.positions).reshape(2, -1, 3)
        lengths[name] = np.linalg.norm(np.diff(lines, axis=1), axis=2).sum(axis=1)
    np.testing.assert_allclose(lengths["short"], 1.0, rtol=1e-3)
    np.testing.assert_allclose(lengths["long"], 1.2, rtol=1e-3)
    told = shapes_of(node, starts=flat(starts), ends=flat(ends))
    assert "cable_id: unknown key ''" in told.error


def test_a_defect_is_answered_and_the_planner_goes_on(monkeypatch):
    """Whatever is raised below the service and the action."""
    setup = PlannerSetup(
        "p",
        "/",
        "s",
        "a",
        {"cable": CABLE.as_dict()},
        cs.Scene(),
        "",
        "auto",
        (0.0, 0.0, -9.81),
        20,
        0.0,
        10,
        1,
        5.0,
        True,
    )
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("defects", context=context)
    try:
        planner = Planner(node, setup, Gate())
        starts, ends = grasps(2)
        request = PredictShapes.Request(starts=flat(starts), ends=flat(ends))
        ended = []
        goal = SimpleNamespace(
            request=CheckTrajectory.Goal(starts=flat(starts), ends=flat(ends)),
            is_cancel_requested=False, publish_feedback=ended.append,
            abort=lambda: ended.append("aborted"), succeed=lambda: ended.append("succeeded"),
        )  # fmt: skip
        with monkeypatch.context() as patch:
            for name in ("predict_batch", "check_laid"):
                patch.setattr(planning, name, lambda *_, **__: 1 // 0)
            for error in (planner._predict(request, PredictShapes.Response()).error, planner.checks.run(goal).error):
                assert "a defect ended this request (ZeroDivisionError: " in error
        assert ended == ["aborted"]
        assert planner._predict(request, PredictShapes.Response()).success
        assert planner.checks.run(goal).success
        assert ended[-1] == "succeeded"
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_the_planner_gets_to_know_the_same_bits():
    scene = cs.Scene(
        [POST, cs.Obstacle("m", cs.Mesh(np.eye(4, 3) / 3.0, [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)]))]
    )
    setup = PlannerSetup(
        "p",
        "/",
        "s",
        "a",
        {"cable": CABLE.as_dict()},
        scene,
        "",
        "auto",
        (0.0, 0.1, -9.81),
        20,
        1 / 3,
        10,
        1,
        5.0,
        True,
    )
    assert PlannerSetup.from_json(setup.to_json()) == setup


HARNESS = cs.Harness(
    {"a": CABLE.replace(length=0.6), "b": CABLE.replace(length=0.6), "c": CABLE.replace(length=0.2)},
    [cs.Junction("fork", ("a.end", "b.start", "c.start"))],
)
BOTH = {"a.start": cs.Grip(cs.Pose()), "b.end": cs.Grip(cs.Pose(), "swivel")}


@pytest.fixture
def of_harness(monkeypatch):
    """The planner's own part of a process for a harness, and the answers it would send."""
    file = HarnessFile(HARNESS, {**BOTH, "c.end": cs.FreeEnd(mass=0.05)}, "h")
    setup = PlannerSetup(
        "p", "/", "s", "a", {}, cs.Scene(obstacles=[POST]), str(ROBOT), "auto", (0.0, 0.0, -9.81), 40, 0.0, 100, 1,
        60.0, False, {"h": file.as_dict()},
    )  # fmt: skip
    monkeypatch.setattr(planning, "Goals", lambda *_: None)
    node = SimpleNamespace(create_service=lambda *_, **__: None)
    return Planner(node, PlannerSetup.from_json(setup.to_json()), Gate())


def test_shapes_of_a_harness_are_those_of_predict_batch(of_harness):
    starts, ends = grasps(3)
    rows = np.concatenate((starts, ends), axis=1)
    request = PredictShapes.Request(starts=flat(rows), arrays=PredictShapes.Request.POSITIONS)
    told = of_harness._predict(request, PredictShapes.Response())
    assert (told.success, told.error) == (True, "")
    own = cs.predict_batch(
        HARNESS, {"a.start": starts, "b.end": ends, "c.end": cs.FreeEnd(mass=0.05)}, kinds={"b.end": "swivel"},
        points=40, scene=cs.Scene(obstacles=[POST]),
    )  # fmt: skip
    places = np.array(told.positions).reshape(3, 3, 40, 3)
    for i, name in enumerate(HARNESS.segments):
        np.testing.assert_array_equal(places[:, i], own.positions[name])
        np.testing.assert_array_equal(np.array(told.distances).reshape(3, 3, 1)[:, i], own.distances[name])
    np.testing.assert_array_equal(told.energy, own.energy)
    assert list(told.usable) == [1, 1, 1]
    for fields, said in (
        ({"starts": flat(starts)}, "2 times seven numbers"),
        ({"starts": flat(rows), "ends": flat(ends)}, "of a harness the poses of all held ends, a.start, b.end"),
        ({"starts": flat(rows), "cable_id": "g"}, "unknown key 'g'"),
    ):
        assert said in of_harness._predict(PredictShapes.Request(**fields), PredictShapes.Response()).error


def test_a_motion_of_a_harness_is_checked_by_poses_and_by_joints(of_harness):
    def checked(**fields):
        goal = SimpleNamespace(
            request=CheckTrajectory.Goal(**fields), is_cancel_requested=False, publish_feedback=lambda _: None
        )
        return of_harness._checked(goal)

    near, far = sideways(3)
    own = cs.check_trajectory(
        HARNESS, cs.Scene(obstacles=[POST]), None,
        cs.EndsPath({"a.start": near, "b.end": far, "c.end": cs.FreeEnd(mass=0.05)}), points=40,
    )  # fmt: skip
    found = checked(starts=flat(np.concatenate((near, far), axis=1)))
    assert found.valid == own.valid is False
    assert found.first.other == own.first.other
    robot = Robot.from_yaml(ROBOT)
    still = JointTrajectory(
        joint_names=list(robot.joint_names), points=[JointTrajectoryPoint(positions=robot.home.tolist())] * 2
    )
    assert checked(trajectory=still).robot_checked


def test_a_node_with_a_harness_serves_its_planner(start_for_all, tmp_path_factory):
    path = tmp_path_factory.mktemp("harness") / "h.yaml"
    HARNESS.to_yaml(path)
    ends = {"held_ends": "a.start, b.end"}
    node = start_for_all(cable_file=None, harness_file=path, planner="true", points=30, active=False, **ends)
    starts, far = grasps(2)
    told = shapes_of(node, starts=flat(np.concatenate((starts, far), axis=1)), arrays=1)
    assert (told.success, told.error, list(told.usable)) == (True, "", [1, 1])
    own = cs.predict_batch(HARNESS, {"a.start": starts, "b.end": far}, points=30)
    places = np.array(told.positions).reshape(2, 3, 30, 3)
    np.testing.assert_array_equal(places[:, 2], own.positions["c"])
