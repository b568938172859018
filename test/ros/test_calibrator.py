"""The calibrator beside a real node over DDS: the action, the calibration by a topic of points, tubes on the node."""

import array
import math
import os
import signal
from dataclasses import replace

import numpy as np
import pytest
import yaml
from action_msgs.msg import GoalStatus
from cable_shape_msgs.action import CalibrateCable
from cable_shape_msgs.msg import CableCalibration, CableMargins, CableTube
from geometry_msgs.msg import PoseStamped
from harness import ALONG_X, LATCHED, Goals, child_of, nanoseconds, wait_until_gone
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField

import cable_shape as cs
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import InputError
from cable_shape.ros import conversions
from cable_shape.ros.calibration_messages import look_at, points_of

TRUE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.006)  # the node begins with 0.01


def line(x=0.8, y=0.0, z=0.5):
    """Points of the true cable between (0, 0, 0.5) and (x, y, z)."""
    shape = cs.predict(TRUE, cs.Pose((0.0, 0.0, 0.5), ALONG_X), cs.Pose((x, y, z), ALONG_X), model="cosserat")
    return shape.positions[10:-10:9]


def goal_fields(count=4, seed=1):
    rng = np.random.default_rng(seed)
    places = [(0.7 + 0.08 * k, 0.1 * (k % 3), 0.5) for k in range(count)]
    seen = [line(*place) + 5e-4 * rng.normal(size=line(*place).shape) for place in places]
    return {
        "starts": np.tile((0.0, 0.0, 0.5, *ALONG_X), count).tolist(),
        "ends": np.ravel([(*place, *ALONG_X) for place in places]).tolist(),
        "counts": [len(points) for points in seen],
        "points": np.concatenate(seen).ravel().tolist(),
    }


@pytest.fixture(scope="module")
def node(start_for_all):
    return start_for_all(calibration="true", diagnostics_period=0.3)


@pytest.fixture(scope="module")
def client(node):
    client = Goals(node, CalibrateCable, "cable/calibrate")
    yield client
    client.client.destroy()


def test_the_action_finds_what_the_library_finds_with_its_error_bars(client):
    fields = goal_fields()
    status, told = client(**fields, fit=["bending_stiffness", "length"], prior_names=["length"], prior_errors=[0.01])
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert (told.success, told.partial, told.error) == (True, False, "")
    begin = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
    ends, points = np.reshape(fields["ends"], (-1, 7)), np.reshape(fields["points"], (len(fields["counts"]), -1, 3))
    seen = [
        cs.Observation(cs.Pose((0.0, 0.0, 0.5), ALONG_X), cs.Pose(row[:3], row[3:]), own)
        for row, own in zip(ends, points, strict=True)
    ]
    own = cs.calibrate(seen, begin, ("bending_stiffness", "length"), priors={"length": 0.01})
    found = told.found
    assert list(found.names) == ["bending_stiffness", "length"]
    assert list(found.units) == ["N m^2", "m"]
    for name in ("value", "standard_error", "low", "high"):
        np.testing.assert_array_equal(getattr(found, f"{name}s"), [getattr(e, name) for e in own.estimates])
    assert found.lows[0] < 0.006 < found.highs[0]
    np.testing.assert_array_equal(np.reshape(found.correlation, (2, 2)), own.correlation)
    assert (found.observations, found.points, found.converged) == (4, sum(fields["counts"]), True)
    assert cs.Cable.from_mapping(yaml.safe_load(found.cable)) == own.cable
    made = cs.Uncertainty.from_mapping(yaml.safe_load(found.uncertainty))
    np.testing.assert_allclose(made.covariance, own.covariance)
    while not client.feedback:  # what the first one said may be lost
        client(**fields, fit=["bending_stiffness"])
    assert client.feedback[-1].scale > 0.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"counts": []}, "counts = '0 numbers' is not allowed"),
        ({"counts": [10, 10, 10, 2]}, "points = "),
        ({"starts": [0.0] * 6}, "starts = '6 numbers' is not allowed: it must hold 4 times 7 numbers"),
        ({"ends": [0.0] * 28}, "observation 0: quaternion"),
        ({"start_kind": "welded"}, "start_kind = 'welded' is not allowed"),
        ({"fit": ["stiffness"]}, "fit: unknown key 'stiffness'"),
        ({"prior_names": ["length"]}, "prior_errors = '0 numbers'"),
        ({"cable_id": "other"}, "cable_id: unknown key 'other'"),
        ({"time_limit": -1.0}, "time_limit = -1.0"),
    ],
)
def test_a_bad_goal_is_aborted_with_what_is_wrong(client, change, words):
    status, told = client(**{**goal_fields(), **change})
    assert status == GoalStatus.STATUS_ABORTED
    assert not told.success
    assert words in told.error


def test_a_goal_that_takes_too_long_is_partial_and_one_may_be_cancelled(client):
    fields = goal_fields(40)
    names = [
        "bending_stiffness",
        "length",
        "start_tilt",
        "end_tilt",
        "start_offset",
        "end_offset",
        "twisting_stiffness",
    ]
    status, told = client(**fields, fit=names, time_limit=1e-3)
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert (told.success, told.partial, told.found.converged) == (True, True, False)
    for count in (400, 800, 1600):  # as many as are not done before the cancellation comes
        handle = client.send(**goal_fields(count), fit=names)
        cancelled = handle.cancel_goal_async()
        client.cell.until(cancelled.done, "answer to the cancellation")
        status, told = client.answer(handle)
        if status == GoalStatus.STATUS_CANCELED:
            break
    assert status == GoalStatus.STATUS_CANCELED
    assert told.partial


def cloud(points, stamp, arc_length=None, datatype=PointField.FLOAT32):
    kind = {PointField.FLOAT32: "<f4", PointField.FLOAT64: "<f8"}[datatype]
    columns = points if arc_length is None else np.column_stack((points, arc_length))
    names = ("x", "y", "z", "arc_length")[: columns.shape[1]]
    size = np.dtype(kind).itemsize
    message = PointCloud2(height=1, width=len(points), point_step=size * len(names), row_step=size * columns.size)
    message.fields = [PointField(name=n, offset=size * i, datatype=datatype, count=1) for i, n in enumerate(names)]
    message.data = array.array("B", columns.astype(kind).tobytes())
    message.header = conversions.header_of(stamp, "world")
    return message


@pytest.mark.parametrize("datatype", [PointField.FLOAT32, PointField.FLOAT64])
def test_clouds_are_read_as_they_are_and_bad_ones_refused(datatype):
    points = line().astype(np.float32).astype(float)
    arc = np.linspace(0.1, 1.0, len(points)).astype(np.float32).astype(float)
    read, along = points_of(cloud(points, 1, arc, datatype))
    np.testing.assert_array_equal(read, points)
    np.testing.assert_array_equal(along, arc)
    assert points_of(cloud(points, 1, None, datatype))[1] is None
    organised = cloud(points[:14], 1, None, datatype)
    organised.height, organised.width, organised.row_step = 2, 7, 7 * organised.point_step
    np.testing.assert_array_equal(points_of(organised)[0], points[:14])
    short = cloud(points, 1, None, datatype)
    short.width += 1
    with pytest.raises(InputError, match="cut short"):
        points_of(short)
    nameless = cloud(points, 1, None, datatype)
    nameless.fields[2].name = "w"
    with pytest.raises(InputError, match="x, y, z must be there"):
        points_of(nameless)


def test_a_topic_of_points_refines_the_cable_and_only_the_named_file_is_written(start, tmp_path):
    file, begin = tmp_path / "found.yaml", tmp_path / "begin.yaml"
    place = "{position: [0.0, 0.0, 0.02]}"  # an earlier calibration's, which the offset makes up for
    begin.write_text(
        "length: 1.2\nlinear_density: 0.1\nbending_stiffness: 0.01\ndiameter: 0.008\n"
        f"grips: {{start: {{kind: clamped, correction: {place}}}, end: {{kind: clamped}}}}\n"
    )
    node = start(
        calibration_points="seen/points", calibration_fit="bending_stiffness,length", calibration_period=0.3,
        calibration_file=file, output_folder=tmp_path, cable_file=begin,
        left_gripper__offset=[0.0, 0.0, -0.02, 0.0, 0.0, 0.0, 1.0],
    )  # fmt: skip
    results = node.listen(CableCalibration, "cable/calibration", LATCHED)
    qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
    publisher = node.node.create_publisher(PointCloud2, "seen/points", qos)
    node.until(publisher.get_subscription_count, "the calibrator's subscription")
    node.until(lambda: node.grippers[0].get_subscription_count() == 2, "its subscription to poses")
    places = [(0.7, 0.0, 0.5), (0.78, 0.1, 0.5), (0.86, 0.0, 0.5), (0.94, 0.1, 0.5), (0.75, 0.2, 0.55)]
    rng = np.random.default_rng(4)
    seen = [line(*place) for place in places]
    k = 0

    def show():
        """Holds still at a place long enough, shows points twice there, and moves on."""
        nonlocal k
        place, points = places[k % len(places)], seen[k % len(places)]
        for step in range(30):
            stamp = node.now()
            node.pose(0, stamp)
            node.pose(1, stamp, place)
            if step in (20, 25):
                publisher.publish(cloud(points + 3e-4 * rng.normal(size=points.shape), stamp))
            node.spin(0.02)
        k += 1
        return results and results[-1].observations >= 4 and results[-1]

    found = node.until(show, "a calibration")
    assert found.converged
    assert found.observations == len({r.observations for r in results}) or found.observations >= 4
    assert found.lows[0] < found.values[0] < found.highs[0]
    assert abs(found.values[0] - 0.006) < 5.0 * found.standard_errors[0]  # which points it heard is left to chance
    assert found.standard_errors[0] < 0.1 * 0.006
    assert found.values[1] == pytest.approx(1.2, abs=0.003)
    assert nanoseconds(found.header.stamp) > 0
    node.until(file.exists, "the file")
    written = cs.CableFile.from_yaml(file)
    assert written.cable.mean_bending_stiffness == pytest.approx(0.006, rel=0.3)
    assert written.held == cs.CableFile.from_yaml(begin).held, "they still lie there"
    named = ["begin.yaml", "found.yaml"]

    def files():
        return sorted(p.name for p in tmp_path.iterdir() if p.suffix in (".yaml", ".new"))

    node.until(lambda: files() == named, "no other file")  # the next one may just be taking its place
    assert node.predicted().usable, "the cycles go on with the cable that they were given"
    assert node.process.stop() == 0
    assert "Traceback" not in node.process.text()


def test_without_a_parameter_there_is_no_calibrator(cell):
    cell.spin(0.5)
    names = [name for name, _ in cell.node.get_node_names_and_namespaces() if "calibrator" in name]
    spaces = [space for name, space in cell.node.get_node_names_and_namespaces() if "calibrator" in name]
    assert not [n for n, s in zip(names, spaces, strict=True) if s == f"/{cell.process.namespace}"]


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"calibration_fit": "stiffness", "calibration": "true"}, "calibration_fit: unknown key 'stiffness'"),
        (
            {"calibration_file": "/nowhere/cable.yaml", "calibration_points": "seen", "output_folder": "."},
            "calibration_file: output = '/nowhere/cable.yaml' is not allowed: its folder must exist",
        ),
        ({"calibration_file": "cable.yaml", "calibration_points": "seen"}, "below output_folder, which is empty"),
        ({"calibration_file": "cable.yaml"}, "it is written by what calibration_points brings"),
        ({"uncertainty_file": "nowhere.yaml"}, "no such file"),
    ],
)
def test_bad_parameters_are_told(start, parameters, words):
    node = start(active=False, **parameters)
    node.diagnosis("lifecycle", words, b"\x02")


def test_the_node_sends_tubes_and_counts_them_in_its_margins(start, tmp_path):
    known = cs.Uncertainty({"length": 0.003}, (0.002, 0.01), (0.002, 0.01))
    scene = tmp_path / "scene.yaml"
    scene.write_text("obstacles:\n- {name: floor, half_space: true}\n")
    node = start(uncertainty_file=known.save(tmp_path / "known.yaml"), scene_file=scene, model="cosserat")
    tubes = node.listen(CableTube, "cable/tube")
    margins = node.listen(CableMargins, "cable/margins")
    node.until(lambda: node.predicted() and tubes and margins, "a tube")
    stamp = nanoseconds(tubes[-1].header.stamp)
    shape = node.until(lambda: node.shape_of(stamp), "its shape")
    cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
    floor = cs.Scene(obstacles=[cs.Obstacle("floor", cs.HalfSpace())])
    cycle = cs.Cycle(cable, scene=floor, model="cosserat", uncertainty=known)
    ends = cs.Pose((0.0, 0.0, 0.5), ALONG_X), cs.Pose((0.8, 0.0, 0.5), ALONG_X)
    own = cycle.step({"cable": ends}, 0)
    assert len(tubes[-1].radius) == len(shape.arc_length) == 150
    assert tubes[-1].confidence == 0.95
    np.testing.assert_allclose(tubes[-1].radius, own.tubes["cable"].radius, rtol=1e-3)
    np.testing.assert_allclose(np.reshape(tubes[-1].covariance, (150, 3, 3)), own.tubes["cable"].covariance, atol=1e-8)
    (told,) = (m for m in margins[-1].margins if m.kind == cs.WarningKind.CLEARANCE.value)
    assert told.value == pytest.approx(own.clearance["cable"].closest.distance, abs=1e-4)
    assert not math.isnan(told.used)


def test_a_cycle_is_not_disturbed_by_a_fit(client, node):
    """Cycles answer while a long fit runs in the other process."""
    handle = client.send(**goal_fields(400), fit=["bending_stiffness", "length", "start_tilt", "end_tilt"])
    for _ in range(5):
        assert node.predicted().usable
    client.cell.until(handle.cancel_goal_async().done, "cancelled")
    client.answer(handle)


def test_a_calibrator_that_dies_is_told_and_ends_with_the_node(start):
    node = start(calibration="true", diagnostics_period=0.3)
    first = node.until(lambda: child_of(node, "cable_shape.ros.calibrating"), "the calibrator")
    os.kill(first, signal.SIGKILL)
    node.diagnosis("lifecycle", "the calibrator's process has ended by signal 9 (1 times so far)", b"\x01")
    assert node.predicted().usable
    second = node.until(
        lambda: (pid := child_of(node, "cable_shape.ros.calibrating")) != first and pid, "a new process"
    )
    assert node.process.stop() == 0
    wait_until_gone(second)  # it may just be loading, and is left to end by itself


HARNESS = """
segments:
  a: {length: 0.6, linear_density: 0.1, bending_stiffness: 0.01}
  b: {length: 0.6, linear_density: 0.1, bending_stiffness: 0.01}
  c: {length: 0.3, linear_density: 0.05, bending_stiffness: 0.005}
junctions:
  - {name: fork, ends: [a.end, b.start, c.start], frames: {c.start: {quaternion: [0.0, 0.479426, 0.0, 0.877583]}}}
ends:
  a.start: {}
  b.end: {offset: {position: [0.0, 0.0, -0.02]}}
  c.end: {mass: 0.01}
"""
MARKERS = "markers: {a+b: [0.15, 0.3, 0.5, 0.75, 0.9, 1.05], c: [0.1, 0.2, 0.3]}\n"


def seen_of_harness(file, count=4, seed=1):
    """Poses (count, 2, 7) of the grips of a harness of half the stiffnesses, and its markers (count, m, 3), one NaN."""
    true = cs.Harness({
        name: one.replace(
            bending_stiffness=0.5 * one.mean_bending_stiffness, twisting_stiffness=0.5 * one.twisting_stiffness
        )
        for name, one in file.harness.segments.items()
    }, file.harness.junctions)  # fmt: skip
    rng, poses, seen = np.random.default_rng(seed), [], []
    for k in range(count):
        grips = [cs.Pose((0.0, 0.0, 0.5), ALONG_X), cs.Pose((0.75 + 0.06 * k, 0.1 * (k % 2), 0.5), ALONG_X)]
        shape = cs.predict(true, file.at(grips), points=301)
        points = []
        for run, places in file.markers.items():
            own = [shape.segments[name] for name in run.split("+")]
            arcs = np.concatenate([one.arc_length + 0.6 * i for i, one in enumerate(own)])
            line = np.concatenate([one.positions for one in own])
            points += [[np.interp(at, arcs, x) for x in line.T] for at in places]
        poses.append([pose.array for pose in grips])
        seen.append(np.array(points) + 2e-4 * rng.normal(size=(len(points), 3)))
    seen[0][1] = np.nan
    return np.array(poses), np.array(seen)


def test_a_harness_is_calibrated_by_the_action_as_by_the_library(start, tmp_path):
    """Markers are those of its file, and what is found is a file with the same ends and markers."""
    path = tmp_path / "h.yaml"
    path.write_text(HARNESS + MARKERS)
    file = HarnessFile.from_yaml(path)
    node = start(cable_file=None, harness_file=path, active=False, calibration="true")
    client = Goals(node, CalibrateCable, "cable/calibrate")
    poses, seen = seen_of_harness(file)
    fields = {
        "starts": poses.ravel().tolist(), "counts": [len(one) for one in seen], "points": seen.ravel().tolist(),
        "groups": [0, 0, 1, 1],
    }  # fmt: skip
    names = ["bending_stiffness:each", "tilt:b.end"]
    status, told = client(**fields, fit=names, prior_names=["tilt"], prior_errors=[0.02])
    assert (status, told.error) == (GoalStatus.STATUS_SUCCEEDED, "")
    looks = [
        look_at(file, [cs.Pose(row[:3], row[3:]) for row in rows], points, group=group)
        for rows, points, group in zip(poses, seen, fields["groups"], strict=True)
    ]
    own = cs.calibrate(looks, file.harness, names, priors={"tilt": 0.02}, progress=False)
    found = told.found
    np.testing.assert_allclose(found.values, [e.value for e in own.estimates], rtol=1e-9)
    assert list(found.names)[:3] == ["bending_stiffness:a", "bending_stiffness:b", "bending_stiffness:c"]
    assert found.values[0] == pytest.approx(0.005, rel=0.2)
    assert found.points == seen.size // 3 - 1
    made = HarnessFile.from_mapping(yaml.safe_load(found.cable))
    assert made.harness.segments["b"].mean_bending_stiffness == pytest.approx(found.values[1])
    assert made.markers == file.markers
    assert made.ends["c.end"].mass == 0.01
    tilt = made.ends["b.end"].offset
    np.testing.assert_allclose(tilt.position, (0.0, 0.0, -0.02), atol=1e-12)
    assert not np.allclose(tilt.quaternion, (0.0, 0.0, 0.0, 1.0), atol=1e-6)
    assert "bending_stiffness:a" in found.uncertainty
    for change, words in (
        ({"ends": fields["starts"]}, "ends = 'given' is not allowed: starts holds the poses of all grips of a harness"),
        ({"start_kind": "swivel"}, "start_kind = 'given'"),
        ({"starts": [0.0] * 28}, "starts = '28 numbers' is not allowed: it must hold 8 times 7 numbers"),
        ({"counts": [8, 9, 9, 10]}, "observation 0: points = '8 points' is not allowed: the harness's file has 9"),
        ({"arc_length": [0.1] * 36}, "arc_length = '9 numbers' is not allowed: the file of a harness says where"),
        ({"fit": ["bending_stiffness:d"]}, "fit: bending_stiffness: unknown key 'd'"),
    ):
        status, told = client(**{**fields, **change})
        assert status == GoalStatus.STATUS_ABORTED
        assert words in told.error


def test_a_topic_of_points_refines_a_harness(start, tmp_path):
    """Without markers every point is on the segment that is nearest."""
    path, found = tmp_path / "h.yaml", tmp_path / "found.yaml"
    path.write_text(HARNESS)
    file = HarnessFile.from_yaml(path)
    node = start(
        cable_file=None, harness_file=path, active=False, calibration_points="seen/points", calibration_period=0.3,
        calibration_file=found, output_folder=tmp_path,
    )  # fmt: skip
    results = node.listen(CableCalibration, "cable/calibration", LATCHED)
    sensor = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    grips = [node.node.create_publisher(PoseStamped, f"h/{end}/pose", sensor) for end in ("a_start", "b_end")]
    publisher = node.node.create_publisher(PointCloud2, "h/seen/points", QoSProfile(depth=10))
    node.until(publisher.get_subscription_count, "the calibrator's subscription")
    node.until(lambda: all(one.get_subscription_count() == 2 for one in grips), "its subscriptions to poses")
    marked = replace(file, markers={"a+b": tuple(np.linspace(0.1, 1.1, 11)), "c": (0.1, 0.2)})
    poses, seen = seen_of_harness(marked, 5)
    seen[0][1] = seen[0][2]
    k = 0

    def show():
        nonlocal k
        rows, points = poses[k % len(poses)], seen[k % len(poses)]
        for step in range(30):
            stamp = node.now()
            for one, row in zip(grips, rows, strict=True):
                message = PoseStamped(header=conversions.header_of(stamp, "world"))
                p, q = message.pose.position, message.pose.orientation
                p.x, p.y, p.z, q.x, q.y, q.z, q.w = map(float, row)
                one.publish(message)
            if step in (20, 25):
                publisher.publish(cloud(points, stamp))
            node.spin(0.02)
        k += 1
        return results and results[-1].observations >= 3 and results[-1]

    told = node.until(show, "a calibration")
    assert told.cable_id == "h"
    assert told.values[0] == pytest.approx(0.005, rel=0.2)  # of a; the others keep their ratio to it
    node.until(found.exists, "the file")
    written = HarnessFile.from_yaml(found)
    assert written.harness.segments["c"].mean_bending_stiffness == pytest.approx(0.5 * told.values[0], rel=0.3)
    assert written.ends.keys() == file.ends.keys()
    assert node.process.stop() == 0
    assert "Traceback" not in node.process.text()
