"""The node over DDS, fed with transforms of several senders."""

import math
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from harness import FIRST_PATIENCE, nanoseconds, values_of
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from tf2_msgs.msg import TFMessage

from cable_shape.messages.fields import shape_from
from cable_shape.pose import Pose
from cable_shape.ros.conversions import time_of

WARN, ERROR = DiagnosticStatus.WARN, DiagnosticStatus.ERROR
STATIC = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
HALF = math.sqrt(0.5)
#: the bases of two arms that look at each other, and a frame beside them
BASES = {"left_base": Pose((0.0, 0.0, 0.5), (0.0, 0.0, HALF, HALF)), "right_base": Pose((1.0, 0.0, 0.5))}
ALONG_X = (0.5, 0.5, 0.5, 0.5)
MS = 1_000_000
CONFIGURE, ACTIVATE = 1, 3


def transform(parent, child, stamp, pose):
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, time_of(stamp)
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = map(float, pose.position)
    turn.x, turn.y, turn.z, turn.w = map(float, pose.quaternion)
    return message


class Senders:
    """A static publisher of both bases, and one for each arm, as of two drivers."""

    def __init__(self, cell, prefixes=("",)):
        self.cell, self.prefixes = cell, prefixes
        self.arms = tuple(cell.node.create_publisher(TFMessage, "tf", 100) for _ in range(2))
        self.static = cell.node.create_publisher(TFMessage, "tf_static", STATIC)
        bases = [transform("cell", base, 0, pose) for base, pose in BASES.items()]
        self.static.publish(TFMessage(transforms=bases))

    def ready(self):
        self.cell.until(lambda: self.cell.state() == "active", "state active")
        self.cell.until(lambda: all(p.get_subscription_count() for p in (*self.arms, self.static)), "match")
        self.cell.until(lambda: self.cell.node.count_publishers("cable/shape"), "cable/shape")

    def send(self, side, stamp, pose, parent=None):
        name = ("left", "right")[side]
        parent = parent or f"{name}_base"
        frames = [transform(parent, f"{prefix}{name}_tool", stamp, pose) for prefix in self.prefixes]
        self.arms[side].publish(TFMessage(transforms=frames))

    def move(self, stamp):
        """The left tool before and after `stamp`, the right one at it: 80 cm apart, both along x; `stamp` again."""
        inside = BASES["left_base"].inverse()
        for offset, x in ((-4, 0.0), (4, 0.2)):
            self.send(0, stamp + offset * MS, inside * Pose((x, 0.0, 0.5), ALONG_X))
        self.send(1, stamp, Pose((-0.1, 0.0, 0.0), ALONG_X))
        return stamp

    def predicted(self):
        """The shape of a motion that is sent again until it is answered; none of those before it is under way."""
        stamp, due, patience = self.move(self.cell.now()), time.monotonic() + FIRST_PATIENCE, FIRST_PATIENCE

        def answered():
            nonlocal stamp, due, patience
            if time.monotonic() >= due:
                patience *= 1.5
                stamp, due = self.move(self.cell.now()), time.monotonic() + patience
            return self.cell.shape_of(stamp)

        return self.cell.until(answered, "shape")


def started(start, prefixes=("",), **parameters):
    cell = start(
        "-r", "/tf:=tf", "-r", "/tf_static:=tf_static", active=False,
        input="tf", frame_id="cell", left_gripper__frame="left_tool", right_gripper__frame="/right_tool",
        stale_after=0.4, diagnostics_period=0.3, **parameters,
    )  # fmt: skip
    senders = Senders(cell, prefixes)
    senders.ready()
    return senders


@pytest.fixture(scope="module")
def arms(start_for_all):
    """The shared node; before anything has come, it says what it waits for."""
    senders = started(start_for_all)
    cell = senders.cell
    cell.diagnosis("input", "no message on /tf to left_tool and /tf to right_tool yet: nothing is", WARN)
    cell.diagnosis("input", "/tf: nobody sends frame 'left_tool'; there are", WARN)
    return senders


def test_grips_are_taken_at_one_time_from_transforms_of_several_senders(arms):
    """The left tool hangs on a static base and is between two transforms, the right one at its own."""
    message = arms.predicted()
    assert message.header.frame_id == "cell"
    shape = shape_from(message)
    assert shape.positions[0] == pytest.approx((0.1, 0.0, 0.5), abs=1e-9)
    assert shape.positions[-1] == pytest.approx((0.9, 0.0, 0.5), abs=1e-9)
    assert shape.tangents[0] == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)
    values = values_of(arms.cell.diagnosis("input", ""))
    assert int(values["frames"]) == 4
    assert int(values["pairs"]) >= 1


def test_each_time_is_predicted_once_and_never_twice(arms):
    first = arms.predicted()
    arms.cell.shapes.clear()
    last = arms.predicted()
    stamps = [nanoseconds(m.header.stamp) for m in arms.cell.shapes]
    assert nanoseconds(first.header.stamp) not in stamps
    assert len(set(stamps)) == len(stamps)
    assert stamps == sorted(stamps)
    assert stamps[-1] == nanoseconds(last.header.stamp)


def two_parents(arms, now):
    arms.send(0, now, Pose())
    arms.send(0, now + 1, Pose(), "camera")


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("/tf to 'left_tool': position = ", lambda t, now: t.send(0, now, Pose.trusted(np.full(7, np.nan)))),
        ("/tf: left_tool: header.stamp = 0 ns is not allowed", lambda t, now: t.send(0, 0, Pose())),
        (
            "/tf: frame 'left_tool' has two parents, 'left_base' and 'camera'",
            lambda t, now: t.send(0, now, Pose(), "camera"),
        ),
    ],
)
def test_what_cannot_be_used_is_refused_and_good_transforms_follow(arms, text, wrong):
    arms.predicted()
    arms.cell.diagnostics.clear()

    def told():
        wrong(arms, arms.cell.now())
        arms.cell.spin(0.05)
        lines = [s for m in arms.cell.diagnostics for s in m.status if s.name.endswith(": input")]
        return any(s.level == ERROR and text in s.message for s in lines)

    arms.cell.until(told, f"diagnostics with {text!r}")
    arms.predicted()


def test_a_silent_arm_is_told_and_a_clock_set_back_starts_afresh(arms):
    arms.predicted()

    def silent():
        arms.send(0, arms.cell.now(), BASES["left_base"].inverse() * Pose((0.1, 0.0, 0.5), ALONG_X))
        arms.cell.spin(0.05)
        lines = [s.message for m in arms.cell.diagnostics for s in m.status if s.name.endswith(": input")]
        return any("stale: no message on /tf to right_tool for" in line for line in lines)

    arms.cell.until(silent, "diagnostics that name the silent arm")
    back = arms.cell.now() - 100_000 * MS
    arms.cell.shapes.clear()
    arms.cell.diagnostics.clear()

    def again():
        nonlocal back
        back = arms.move(back + 20 * MS)
        arms.cell.spin(0.05)
        lines = [s.message for m in arms.cell.diagnostics for s in m.status if s.name.endswith(": input")]
        told = any("taken as a restart of the clock" in line for line in lines)
        return told and any(nanoseconds(m.header.stamp) <= back for m in arms.cell.shapes)

    arms.cell.until(again, "a shape after the clock was set back")


def test_several_cables_have_frames_of_their_own(start, tmp_path):
    cable = "{length: 1.2, linear_density: 0.1, bending_stiffness: 0.01}"
    (tmp_path / "two.yaml").write_text(f"cables: {{a: {cable}, b: {cable}}}\n")
    two = started(start, ("a/", "b/"), cable_file=tmp_path / "two.yaml")
    two.predicted()
    two.cell.until(lambda: {m.cable_id for m in two.cell.shapes} == {"a", "b"}, "both cables")
    assert two.cell.process.stop() == 0


def test_wrong_frames_are_refused_and_those_that_are_all_static_told(start):
    cell = start("-r", "/tf_static:=tf_static", input="tf", left_gripper__frame="left_base", active=False)
    cell.diagnosis("lifecycle", "right_gripper.frame = '' is not allowed: input = 'tf' needs the gripper's", ERROR)
    assert cell.set(right_gripper__frame="left_base").successful
    assert not cell.transition(CONFIGURE)
    cell.diagnosis("lifecycle", "it must be another one than left_gripper.frame", ERROR)
    assert cell.set(right_gripper__frame="right_base", frame_id="cell").successful
    assert cell.transition(CONFIGURE)
    assert cell.transition(ACTIVATE)
    Senders(cell)
    cell.diagnosis("input", "/tf_static: left_base and right_base hang on cell by static transforms alone", WARN)
    assert cell.process.stop() == 0
