"""The node with a harness over DDS: a topic a grip, a shape a segment, and what every bad input leads to."""

import math
import textwrap

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from cable_shape_msgs.msg import CableMargins, CableShape, CableWarnings
from clouds import cloud
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TransformStamped
from harness import LATCHED, cloud_message, nanoseconds, values_of
from nav_msgs.msg import Path
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

import cable_shape as cs
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import ArgumentError
from cable_shape.messages.fields import shape_from
from cable_shape.robots.robot import Robot
from cable_shape.ros import conversions
from cable_shape.ros.assembly import Assembly
from cable_shape.ros.conversions import time_of
from cable_shape.ros.parameters import SPECS, Settings, find_file

WARN, ERROR = DiagnosticStatus.WARN, DiagnosticStatus.ERROR
MS = 1_000_000  # ns
ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
HARNESS = textwrap.dedent("""
    segments:
      a: {length: 0.6, linear_density: 0.1, bending_stiffness: 0.01, diameter: 0.008}
      b: {length: 0.6, linear_density: 0.1, bending_stiffness: 0.01, diameter: 0.006}
      c: {length: 0.3, linear_density: 0.05, bending_stiffness: 0.005, diameter: 0.004}
    junctions:
      - {name: fork, ends: [a.end, b.start, c.start], frames: {c.start: {quaternion: [0.0, 0.479426, 0.0, 0.877583]}}}
""")
PLACES = {"a.start": (0.0, 0.0, 0.5), "b.end": (0.8, 0.1, 0.5), "c.end": (0.6, 0.05, 0.3)}
TWO = tuple(PLACES)[:2]


class Hands:
    """Publishers of the ends that are held."""

    def __init__(self, cell, ends):
        self.cell = cell
        sensor = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        topics = {end: f"h/{end.replace('.', '_')}/pose" for end in ends}
        self.publishers = {end: cell.node.create_publisher(PoseStamped, topic, sensor) for end, topic in topics.items()}
        cell.until(lambda: cell.state() == "active", "state active")
        cell.until(lambda: all(one.get_subscription_count() for one in self.publishers.values()), "match")
        cell.until(lambda: cell.node.count_publishers("cable/shape"), "cable/shape")

    def pose(self, end, stamp, place=None, frame="world"):
        message = PoseStamped()
        message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        message.header.frame_id = frame
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = map(float, place or PLACES[end])
        q.x, q.y, q.z, q.w = ALONG
        self.publishers[end].publish(message)

    def all(self, stamp=None, **places):
        """Publishes every end under one stamp, which it returns; a_start=(..) puts one elsewhere."""
        stamp = self.cell.now() if stamp is None else stamp
        for end in self.publishers:
            self.pose(end, stamp, places.get(end.replace(".", "_")))
        return stamp

    def shapes_at(self, stamp):
        """The segments' shapes under this stamp, once all three are there."""
        found = {m.cable_id: m for m in self.cell.shapes if nanoseconds(m.header.stamp) == stamp}
        return found if len(found) == 3 else None

    def predicted(self, **places):
        """The shapes of what is published again until it is answered."""
        stamps = []
        return self.cell.send_until(
            lambda: stamps.append(self.all(**places)), lambda: stamps and self.shapes_at(stamps[-1]), "shapes"
        )


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("harness") / "h.yaml"
    path.write_text(HARNESS)
    return path


@pytest.fixture(scope="module")
def three(start_for_all, file):
    """A node whose harness is held at all of its open ends, as it is if nothing is said."""
    cell = start_for_all(
        cable_file=None, harness_file=file, active=False, stale_after=0.4, diagnostics_period=0.3, points=60
    )
    return Hands(cell, PLACES)


@pytest.fixture
def hands(three):
    """Predicting, with nothing kept from the test before."""
    three.predicted()
    three.cell.shapes.clear()
    three.cell.diagnostics.clear()
    return three


def expected(file, ends):
    """What Cycle makes of the same ends."""
    grips = {end: cs.Pose(PLACES[end], ALONG) for end in ends}
    return cs.Cycle({"h": cs.Harness.from_yaml(file)}, points=60).step({"h": grips}, stamp=0).shapes["h"]


def assert_as_predicted(messages, shape):
    assert set(messages) == {f"h/{name}" for name in shape.segments}
    for name, one in shape.segments.items():
        message = messages[f"h/{name}"]
        assert (message.status, message.usable, message.model) == (CableShape.OK, True, "cosserat")
        np.testing.assert_allclose(shape_from(message).positions, one.positions, rtol=0.0, atol=2e-5)


def test_a_pose_of_each_end_becomes_a_shape_of_each_segment(hands, file):
    messages = hands.predicted()
    assert {message.header.frame_id for message in messages.values()} == {"world"}
    assert_as_predicted(messages, expected(file, PLACES))


def test_what_is_drawn_and_warned_of_names_the_segments(hands):
    cell = hands.cell
    warnings = cell.listen(CableWarnings, "cable/warnings", LATCHED)
    margins, markers = cell.listen(CableMargins, "cable/margins"), cell.listen(MarkerArray, "cable/markers")
    paths, points = cell.listen(Path, "cable/path"), cell.listen(PointCloud2, "cable/points")
    far = {"b_end": (1.5, 0.0, 0.5)}
    cell.send_until(lambda: hands.all(**far), lambda: margins and markers and len(paths) > 2 and points, "drawings")
    assert {m.ns for m in markers[-1].markers} == {"h/a", "h/b", "h/c"}
    assert points[-1].width == 3 * 60
    told = {w.cable_id for m in warnings for w in m.warnings}
    assert told == {"h/a", "h/b", "h/c"}, "a harness that cannot reach is not to be acted on in any of its parts"
    cell.diagnosis("prediction", "h: OVERSTRETCHED", ERROR, lambda: hands.all(**far))
    assert not any(message.usable for message in cell.shapes if message.status == CableShape.OVERSTRETCHED)
    hands.predicted()


@pytest.mark.parametrize("end", PLACES)
def test_a_pose_that_is_not_finite_is_refused(hands, end):
    cell = hands.cell
    topic, name = f"h/{end.replace('.', '_')}/pose", end.replace(".", "_")
    bad = {name: (math.nan, 0.0, 0.5)}
    cell.diagnosis("input", f"{topic}: position = [nan, 0.0, 0.5] is not allowed", ERROR, lambda: hands.all(**bad))
    assert cell.shapes == []
    hands.predicted()


def test_a_stamp_going_backwards_is_refused(hands):
    cell = hands.cell
    stamp = nanoseconds(hands.predicted()["h/a"].header.stamp)
    count = len(cell.shapes)
    cell.diagnosis("input", "goes backwards, by 0.500000 s", ERROR, lambda: hands.all(stamp - 500 * MS))
    assert len(cell.shapes) == count
    hands.predicted()


def test_another_frame_is_refused(hands):
    cell = hands.cell

    def turned():
        for end in PLACES:
            hands.pose(end, cell.now(), frame="base")

    cell.diagnosis("input", "header.frame_id = 'base' is not allowed: it must be 'world'", ERROR, turned)
    assert cell.shapes == []


def test_one_end_that_falls_silent_is_named_and_nothing_is_published(hands):
    cell = hands.cell

    def without_c():
        for end in TWO:
            hands.pose(end, cell.now())
        cell.spin(0.02)
        lines = (s for m in cell.diagnostics for s in m.status if "stale: no message on h/c_end/pose for" in s.message)
        return next(lines, None)

    status = cell.until(without_c, "diagnostics about c.end only")
    assert "no message on h/a_start" not in status.message
    assert cell.shapes == []
    hands.predicted()


def test_stamps_too_far_apart_make_no_shape_and_the_text_says_so(hands):
    cell = hands.cell

    def apart():
        stamp = cell.now()
        for k, end in enumerate(PLACES):
            hands.pose(end, stamp - k * 1_000_000_000)
        cell.spin(0.02)
        lines = (s for m in cell.diagnostics for s in m.status if "no pair" in s.message)
        return next((s for s in lines if "2.000 s apart, max_skew = 0.02 s" in s.message), None)

    status = cell.until(apart, "diagnostics about stamps")
    assert "h/a_start/pose and h/b_end/pose and h/c_end/pose" in status.message
    assert cell.shapes == []


def test_a_bag_that_loops_starts_the_prediction_afresh(hands):
    back = nanoseconds(hands.predicted()["h/a"].header.stamp)

    def loop():
        nonlocal back
        back -= 100_000_000_000
        hands.all(back)

    hands.cell.diagnosis("input", "taken as a restart of the clock", WARN, loop)
    hands.predicted()
    line = hands.cell.diagnosis("prediction", "h: OK")
    assert values_of(line)["h status"] == "OK"


def test_ends_that_are_not_named_are_free(start, file):
    cell = start(cable_file=None, harness_file=file, held_ends="a.start, b.end", active=False, points=60)
    hands = Hands(cell, TWO)
    assert cell.node.count_subscribers("h/c_end/pose") == 0
    assert_as_predicted(hands.predicted(), expected(file, TWO))
    assert "held: a.start clamped, b.end clamped" in cell.process.text()


def test_the_grippers_of_a_robot_hold_two_ends(start, file):
    arguments = {"input": "joints", "robot_file": "robots/dual_arm.yaml", "held_ends": "a.start, b.end"}
    cell = start(cable_file=None, harness_file=file, active=False, points=60, **arguments)
    robot = Robot.from_yaml(find_file("robots/dual_arm.yaml"))
    message = JointState(name=list(robot.joint_names), position=robot.home.tolist())
    cell.until(lambda: cell.state() == "active", "state active")

    def move():
        message.header.stamp = cell.node.get_clock().now().to_msg()
        cell.joints.publish(message)

    cell.send_until(move, lambda: len(cell.shapes) >= 3, "shapes")
    left, right = robot.grips(robot.home)
    shape = cs.predict(cs.Harness.from_yaml(file), {"a.start": left, "b.end": right}, points=60)
    assert_as_predicted({m.cable_id: m for m in cell.shapes[:3]}, shape)


def test_transforms_hold_its_ends(start, file):
    cell = start(
        "-r", "/tf:=tf", "-r", "/tf_static:=tf_static", active=False,
        cable_file=None, harness_file=file, held_ends="a.start,b.end", input="tf", points=60,
    )  # fmt: skip
    publisher = cell.node.create_publisher(TFMessage, "tf", 100)
    cell.until(lambda: cell.state() == "active", "state active")

    def move():
        frames = []
        for end in TWO:
            frame = TransformStamped(child_frame_id=f"h/{end.replace('.', '_')}")
            frame.header.frame_id, frame.header.stamp = "world", time_of(cell.now())
            place, turn = frame.transform.translation, frame.transform.rotation
            place.x, place.y, place.z = PLACES[end]
            turn.x, turn.y, turn.z, turn.w = ALONG
            frames.append(frame)
        publisher.publish(TFMessage(transforms=frames))

    cell.send_until(move, lambda: len(cell.shapes) >= 3, "shapes")
    assert_as_predicted({m.cable_id: m for m in cell.shapes[:3]}, expected(file, TWO))


# -- files and parameters


def test_a_file_says_how_its_ends_are_held(file, tmp_path):
    path = tmp_path / "g.yaml"
    offset = "{position: [0.0, 0.0, 0.1], quaternion: [0.0, 0.0, 0.0, 1.0]}"
    path.write_text(HARNESS + f"ends:\n  a.start: {{kind: swivel, offset: {offset}}}\n  c.end: {{mass: 0.03}}\n")
    read = HarnessFile.from_yaml(path)
    assert cs.Harness.from_yaml(path) == read.harness == cs.Harness.from_yaml(file)
    held = read.held()
    assert list(held) == ["a.start", "c.end"]
    assert held["a.start"].kind == "swivel"
    assert held["a.start"].cable_frame.position.tolist() == [0.0, 0.0, 0.1]
    assert held["c.end"].mass == 0.03
    named = read.held(["a.start", "c.end"])
    assert (named["a.start"].kind, named["c.end"].kind) == ("swivel", "clamped")
    assert list(HarnessFile.from_yaml(file).held()) == list(PLACES)


@pytest.mark.parametrize(
    ("ends", "told"),
    [
        ("{a.end: {}}", r"h.yaml: ends: unknown key 'a.end'.* Known keys: a.start, b.end, c.end"),
        ("{a.start: {kind: glued}}", r"ends.a.start: kind = 'glued' is not allowed"),
        ("{a.start: {mass: 0.1, kind: pinned}}", r"ends.a.start: unknown key 'kind'"),
        ("{a.start: {mass: -1}}", r"ends.a.start: mass = -1.0 is not allowed: it must be at least 0"),
        ("{a.start: {mas: 1}}", r"Did you mean 'mass'"),
        ("{a.start: {mass: 0.1}}", r"ends = \[\] is not allowed: no gripper would hold the harness. .*a.start, b.end"),
        ("[a.start]", r"ends = \['a.start'\] is not allowed: it must be a mapping"),
    ],
)
def test_ends_that_make_no_sense_are_refused(ends, told, tmp_path):
    path = tmp_path / "h.yaml"
    path.write_text(HARNESS + f"ends: {ends}\n")
    with pytest.raises(ArgumentError, match=told):
        HarnessFile.from_yaml(path).held()


def settings(**changes):
    return Settings.of({**{spec.name: spec.default for spec in SPECS}, **changes})


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"harness_file": "h.yaml, i.yaml", "held_ends": "a.start"},
            "held_ends = 'a.start' .* one harness; there are 2",
        ),
        ({"grip_kind_left": "swivel"}, "grip_kind_left = 'swivel' is not allowed: a harness has no left and right"),
        (
            {"right_gripper.offset": [0.1, 0, 0, 0, 0, 0, 1]},
            "right_gripper.offset = .* a harness has no left and right",
        ),
        ({"calibration_fit": "stiffness:a"}, "calibration_fit: a key that is not a word. .*rest_curvature, roll, tilt"),
        ({"harness_file": "", "held_ends": "a.start", "cable_file": "c.yaml"}, "held_ends = 'a.start' .* harness_file"),
    ],
)
def test_what_a_harness_does_not_go_with(changes, told):
    with pytest.raises(ArgumentError, match=told):
        settings(**{"harness_file": "h.yaml", **changes}).complete()


def test_a_node_has_cables_and_harnesses_side_by_side(file, tmp_path):
    other = tmp_path / "other.yaml"
    other.write_text(HARNESS)
    cable = tmp_path / "cable.yaml"
    cable.write_text("{length: 1.0, linear_density: 0.1, bending_stiffness: 0.01}\n")
    names = {"cable_file": str(cable), "harness_file": f"{file}, {other}"}
    assembly = Assembly(settings(**names))
    topics = [topic for holding in assembly.holdings for topic in holding.topics]
    assert topics[:2] == ["left_gripper/pose", "right_gripper/pose"]
    assert topics[2:] == [f"{name}/{end}/pose" for name in ("h", "other") for end in ("a_start", "b_end", "c_end")]
    ends = {end: cs.Pose(place, ALONG) for end, place in PLACES.items()}
    pair = cs.Pose((0.0, 2.0, 0.5), ALONG), cs.Pose((0.8, 2.0, 0.5), ALONG)
    aside = {end: cs.Pose((place[0], place[1] + 1.0, place[2]), ALONG) for end, place in PLACES.items()}
    report = assembly.cycle.step({"cable": pair, "h": ends, "other": aside}, stamp=0)
    assert {name: shape.status.name for name, shape in report.shapes.items()} == dict.fromkeys(report.shapes, "OK")
    assert set(report.clearance) >= {"cable", "h/a", "other/c"}
    with pytest.raises(ArgumentError, match="there is a cable, or a harness, 'h' already"):
        Assembly(settings(harness_file=f"{file}, {file}"))
    names = {"cable_file": str(cable), "harness_file": str(file), "held_ends": "a.start, b.end"}
    with pytest.raises(ArgumentError, match="moves one cable or harness"):
        Assembly(settings(**names, input="joints", robot_file="robots/dual_arm.yaml"))


def test_a_node_keeps_a_cable_and_a_harness_out_of_each_other(file, tmp_path):
    cable, scene = tmp_path / "cable.yaml", tmp_path / "scene.yaml"
    cable.write_text("{length: 1.0, linear_density: 0.1, bending_stiffness: 0.01, diameter: 0.008}\n")
    scene.write_text("contact: solve\n")
    names = {"cable_file": str(cable), "harness_file": str(file), "scene_file": str(scene)}
    cycle = Assembly(settings(**names)).cycle
    ends = {end: cs.Pose(place, ALONG) for end, place in PLACES.items()}
    along_y = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    for k, height in enumerate(np.linspace(0.6, 0.42, 19)):
        pair = cs.Pose((0.2, -0.4, height), along_y), cs.Pose((0.2, 0.4, height), along_y)
        report = cycle.step({"cable": pair, "h": ends}, stamp=k * 10**9)
        assert {name: shape.status.name for name, shape in report.shapes.items()} == {"cable": "OK", "h": "OK"}
    assert {contact.body for contact in report.shapes["cable"].contacts} == {"h/a"}
    (on_a,) = report.shapes["h"].segments["a"].contacts
    assert on_a.body == "cable"
    assert report.clearance["h/a"].closest.distance == pytest.approx(0.0, abs=1e-4)


def test_a_node_with_an_uncertainty_has_a_tube_message_for_every_segment(file, tmp_path):
    known = cs.Uncertainty({"bending_stiffness:each": 0.1}, (0.001, 0.0)).save(tmp_path / "known.yaml")
    cycle = Assembly(settings(harness_file=str(file), uncertainty_file=str(known))).cycle
    report = cycle.step({"h": {end: cs.Pose(place, ALONG) for end, place in PLACES.items()}}, stamp=0)
    assert set(report.tubes) == {"h/a", "h/b", "h/c"}
    header = conversions.header_of(report.stamp, "world")
    message = conversions.tube_message("h/c", report.tubes["h/c"], header)
    assert message.cable_id == "h/c"
    assert max(message.radius) > 0.001


@pytest.mark.parametrize(
    ("name", "changes", "told"),
    [
        ("h", {"held_ends": "a.end"}, r"held_ends: ends = 'a.end' is not allowed: it is in junction 'fork'"),
        ("h", {"held_ends": "d.end"}, r"held_ends: .* Ends that may be held: a.start, b.end, c.end"),
        ("my harness", {}, r"harness_file = 'my harness' is not allowed: a name must be letters, digits and _"),
        (
            "h",
            {"input": "joints", "robot_file": "robots/dual_arm.yaml"},
            r"held_ends = '' is not allowed: input = 'joints' moves two ends, .* held are 3",
        ),
        ("h", {"model": "catenary"}, r"model = 'catenary' is not allowed"),
    ],
)
def test_what_cannot_be_held_fails_at_once(name, changes, told, tmp_path):
    path = tmp_path / f"{name}.yaml"
    path.write_text(HARNESS)
    with pytest.raises(ArgumentError, match=told):
        Assembly(settings(harness_file=str(path), **changes))


def test_what_is_seen_of_a_harness_corrects_its_shapes(start, file):
    cell = start(cable_file=None, harness_file=file, active=False, stale_after=0.4, points=41, points_seen="true")
    hands = Hands(cell, PLACES)
    sensor = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = cell.node.create_publisher(PointCloud2, "cable/points_seen", sensor)
    cell.until(publisher.get_subscription_count, "subscription to cable/points_seen")
    given = cs.Harness.from_yaml(file)
    other = given.segments["b"].replace(bending_stiffness=0.03, rest_curvature=(0.0, 1.0, 0.0))
    grips = {end: cs.Pose(place, ALONG) for end, place in PLACES.items()}
    true = cs.predict(given.replace(segments={**given.segments, "b": other}), grips, points=41)

    def off(messages):
        apart = [shape_from(messages[f"h/{n}"]).positions - one.positions for n, one in true.segments.items()]
        return float(np.linalg.norm(np.concatenate(apart), axis=1).mean())

    before = off(hands.predicted())
    assert before > 0.01
    stamps = []

    def send():
        stamps.append(hands.all())
        if len(stamps) > 1:
            clouds = [cloud(one, len(stamps), count=150) for one in true.segments.values()]
            publisher.publish(cloud_message(np.concatenate(clouds), stamps[-2]))

    def near():
        messages = next(filter(None, (hands.shapes_at(stamp) for stamp in reversed(stamps))), None)
        return messages and off(messages) < 0.3 * before

    cell.send_until(send, near, "shapes that are corrected")
