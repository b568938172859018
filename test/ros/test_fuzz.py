"""Random messages and files: refused with a text or used, never a crash of another kind.

CABLE_SHAPE_FUZZ sets how many examples of each kind are tried (300).
"""

import contextlib
import math
import os
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Transform, TransformStamped, Vector3
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.cable.junction import Junction
from cable_shape.cycle.cycle import Cycle
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import CableShapeError
from cable_shape.pose import IDENTITY, Grip
from cable_shape.robots.robot import Robot
from cable_shape.ros.assembly import load_cables
from cable_shape.ros.diagnostics import Health
from cable_shape.ros.holding import Holding
from cable_shape.ros.parameters import SPECS, Settings, find_file
from cable_shape.ros.pose_source import PoseSource
from cable_shape.ros.sources import JointSource, Sink
from cable_shape.ros.transform_source import TransformSource
from cable_shape.scene.scene import Scene

EXAMPLES = int(os.environ.get("CABLE_SHAPE_FUZZ", "300"))
fuzzed = settings(
    derandomize=True, deadline=None, max_examples=EXAMPLES, suppress_health_check=list(HealthCheck), database=None
)
NUMBERS = st.one_of(
    st.floats(-1.0, 1.0), st.floats(), st.sampled_from((0.0, 1.0, 0.5, 1e-300, 1e300, math.nan, math.inf))
)
UNIT = st.sampled_from(((0.5, 0.5, 0.5, 0.5), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, -1.0)))
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1) | st.integers(1000, 1003), st.integers(0, 2**32 - 1))
HEADERS = st.builds(
    lambda stamp, frame: Header(stamp=Time(sec=stamp[0], nanosec=stamp[1]), frame_id=frame),
    STAMPS,
    st.sampled_from(("world", "world", "world", "")) | st.text(st.characters(codec="utf-8"), max_size=8),
)
POSES = st.builds(
    lambda header, p, q: PoseStamped(
        header=header,
        pose=Pose(position=Point(x=p[0], y=p[1], z=p[2]), orientation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3])),
    ),
    HEADERS,
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
    UNIT | st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS),
)
ROBOT = Robot.from_yaml(find_file("robots/dual_arm.yaml"))
NAMES = st.lists(st.sampled_from(ROBOT.joint_names) | st.text(st.characters(codec="utf-8"), max_size=4), max_size=16)
JOINTS = st.one_of(
    st.builds(lambda h, n, q: JointState(header=h, name=n, position=q), HEADERS, NAMES, st.lists(NUMBERS, max_size=16)),
    st.builds(
        lambda h, q: JointState(header=h, name=list(ROBOT.joint_names), position=q),
        HEADERS,
        st.lists(NUMBERS, min_size=len(ROBOT.joint_names), max_size=len(ROBOT.joint_names)),
    ),
)
VALUES = {spec.name: spec.default for spec in SPECS}


def refused_or_read(read, value):
    """Any other exception fails the test."""
    with contextlib.suppress(CableShapeError):
        read(value)


class Node:
    """What a source asks of a node, without DDS: messages are handed to the callbacks by the test."""

    def __init__(self):
        self.take = []

    def create_subscription(self, kind, topic, callback, qos):
        self.take.append(callback)
        handle = SimpleNamespace(get_publisher_count=lambda: 1, take_message=lambda kind, raw: None)
        return SimpleNamespace(topic=topic, handle=handle)


CABLE = Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
ENDS = ("a.start", "b.end", "c.end")
FORK = Harness(dict.fromkeys("abc", CABLE), [Junction("fork", ("a.end", "b.start", "c.start"))])


class Fed:
    """A source, a cycle behind it, and whether every shape that came out is made of numbers."""

    def __init__(self, make, carried=CABLE, **values):
        self.node, self.health = Node(), Health(0.5)
        self.health.state = "active"
        self.cycle = Cycle(carried, points=20)
        self.source = make(self.node, Settings.of({**VALUES, **values}), self.sink())

    def sink(self):
        return Sink(self.health, lambda: 1, self.run, self.cycle.reset)

    def run(self, ready):
        try:
            grips, links = ready.ends()
            report = self.cycle.step(grips, ready.stamp, links)
        except CableShapeError as error:
            self.health.refuse("cycle", str(error), 1)
            return
        for shape in report.shapes.values():
            assert not shape.status or np.isfinite(shape.buffer).all()
        self.health.cycled(report, 1e-3, 1)

    def put(self, number, message):
        self.node.take[number](message, {})
        for verdict in self.health.verdicts(1):
            assert isinstance(verdict.message, str)


@pytest.fixture(scope="module")
def poses():
    return Fed(partial(PoseSource, robot=None, holdings=[Holding("cable")]))


@pytest.fixture(scope="module")
def joints():
    return Fed(partial(JointSource, robot=ROBOT, holding=Holding("cable")))


@fuzzed
@given(st.lists(st.tuples(st.integers(0, 1), POSES), max_size=6))
def test_random_poses(poses, messages):
    for side, message in messages:
        poses.put(side, message)


@pytest.fixture(scope="module")
def ends():
    holding = Holding.of_harness(HarnessFile(FORK, dict.fromkeys(ENDS, Grip(IDENTITY)), "h"))
    return Fed(partial(PoseSource, robot=None, holdings=[holding]), {"h": FORK}, max_skew=10.0)


@fuzzed
@given(st.lists(st.tuples(st.integers(0, 2), POSES), max_size=8))
def test_random_poses_of_a_harness(ends, messages):
    for end, message in messages:
        ends.put(end, message)


@fuzzed
@given(st.lists(JOINTS, max_size=3))
def test_random_joint_states(joints, messages):
    for message in messages:
        joints.put(0, message)


NAMED = ("world", "left", "right", "arm", "/left", "")
FRAMES = st.sampled_from(NAMED) | st.text(st.characters(codec="utf-8"), max_size=4)
TRANSFORMS = st.builds(
    lambda header, child, p, q: TransformStamped(
        header=header,
        child_frame_id=child,
        transform=Transform(
            translation=Vector3(x=p[0], y=p[1], z=p[2]), rotation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3])
        ),
    ),
    st.builds(lambda header, frame: Header(stamp=header.stamp, frame_id=frame), HEADERS, FRAMES),
    FRAMES,
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
    UNIT | st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS),
)


@pytest.fixture(scope="module")
def transforms():
    make = partial(TransformSource, robot=None, holdings=[Holding("cable")])
    return Fed(make, **{"left_gripper.frame": "left", "right_gripper.frame": "right", "max_skew": 1.0})


@fuzzed
@given(st.lists(st.tuples(st.integers(0, 1), st.lists(TRANSFORMS, max_size=2)), max_size=4))
def test_random_transforms(transforms, messages):
    for topic, entries in messages:
        transforms.put(topic, TFMessage(transforms=entries))
        assert len(transforms.health.refused) < 50  # whatever names peers make up
        assert all(isinstance(transforms.source._tree.missing(frame), str) for frame in ("left", "right"))


ATOMS = st.none() | st.booleans() | st.integers() | NUMBERS | st.text(max_size=5)
KEYS = st.sampled_from(
    ("length", "linear_density", "bending_stiffness", "diameter", "tails", "cables", "obstacles", "clips", "masses",
     "name", "box", "sphere", "cylinder", "radius", "position", "quaternion", "sockets", "plug", "rest_curvature",
     "segments", "junctions", "ends", "kind", "offset", "frames", "mass", "a", "a.start")
)  # fmt: skip
TREES = st.recursive(
    ATOMS, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS | st.text(max_size=3), inner, max_size=5)
)


@fuzzed
@given(st.dictionaries(KEYS | st.text(max_size=3), TREES, max_size=6))
def test_random_trees_as_cable_scene_and_harness(values):
    for read in (Cable.from_mapping, Scene.from_mapping, HarnessFile.from_mapping):
        refused_or_read(read, values)


@fuzzed
@given(st.dictionaries(st.sampled_from((*ENDS, "a.end", "x")), TREES, max_size=3) | TREES)
def test_random_trees_as_ends_of_a_harness(values):
    refused_or_read(lambda ends: HarnessFile.from_mapping({**FORK.as_dict(), "ends": ends}).held(), values)


@fuzzed
@given(st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode(errors="ignore")))
def test_random_bytes_as_yaml(tmp_path_factory, content):
    file = tmp_path_factory.getbasetemp() / "fuzz.yaml"
    file.write_bytes(content)
    for read in (Cable.from_yaml, Scene.from_yaml, load_cables, Robot.from_yaml, HarnessFile.from_yaml):
        refused_or_read(read, file)


@fuzzed
@given(st.fixed_dictionaries({}, optional={spec.name: ATOMS | st.lists(NUMBERS, max_size=8) for spec in SPECS}))
def test_random_parameters(changes):
    refused_or_read(Settings.of, {**VALUES, **changes})
