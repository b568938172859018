"""The node over DDS, fed with gripper poses: what comes out, and what every bad input leads to."""

import math
import time

import numpy as np
import pytest
from cable_shape_msgs.msg import CableMargin, CableMargins, CableShape, CableWarning, CableWarnings
from diagnostic_msgs.msg import DiagnosticStatus
from harness import ALONG_X, LATCHED, nanoseconds, values_of
from nav_msgs.msg import Path
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from cable_shape.messages.fields import shape_from
from cable_shape.pose import Pose, multiply

WARN, ERROR = DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def refused(cell, text, publish, level=ERROR):
    """`publish` leads to a diagnostics text and no shape; good input afterwards leads to a shape again."""
    cell.shapes.clear()
    status = cell.diagnosis("input", text, level, publish)
    assert cell.shapes == []
    assert cell.process.alive
    cell.predicted()
    return status


def test_a_pair_of_poses_becomes_a_shape_with_their_stamp_frame_and_ends(cell):
    start, end = (0.1, -0.2, 0.6), (0.7, 0.3, 0.4)
    stamp = cell.now() + 100_000_000  # so far after the pair before that no closer partner is waited for
    message = cell.shape_at(stamp, start, end, late=3_000_000)
    assert message.header.frame_id == "world"
    assert (message.cable_id, message.model, message.status, message.usable) == (
        "cable",
        "cosserat",
        CableShape.OK,
        True,
    )
    shape = shape_from(message)
    assert shape.points == 150
    assert shape.positions[0] == pytest.approx(start, abs=1e-9)
    assert shape.positions[-1] == pytest.approx(end, abs=1e-9)
    assert shape.tangents[0] == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)
    # the chords of the curve add up to the cable's length
    assert np.linalg.norm(np.diff(shape.positions, axis=0), axis=1).sum() == pytest.approx(1.2, rel=1e-3)
    assert shape.arc_length == pytest.approx(np.linspace(0.0, 1.2, 150), abs=1e-12)


def test_shapes_follow_the_input_one_for_each_pair(cell):
    stamps = []
    for _ in range(40):
        stamps.append(max(cell.now(), *stamps[-1:], 0) + 1)
        cell.shape_at(stamps[-1])
    answered = [nanoseconds(m.header.stamp) for m in cell.shapes]
    assert [stamp for stamp in answered if stamp >= stamps[0]] == stamps


def test_the_offset_and_kind_of_a_grip_may_change_while_running(cell):
    turned = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # 90 degrees about y: d3 from the tool's z to its x
    assert cell.set(left_gripper__offset=[0.0, 0.0, 0.1, *turned], grip_kind_right="pinned").successful
    try:
        message = cell.predicted()
        expected = Pose((0.0, 0.0, 0.5), ALONG_X) * Pose((0.0, 0.0, 0.1), turned)
        shape = shape_from(message)
        assert shape.positions[0] == pytest.approx(expected.position, abs=1e-9)
        assert abs(shape.quaternions[0] @ multiply(np.array(ALONG_X), np.array(turned))) == pytest.approx(1.0, abs=1e-6)
        assert np.linalg.norm(shape.curvature[-1]) < 1e-6  # pinned: no moment
    finally:
        assert cell.set(left_gripper__offset=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], grip_kind_right="clamped").successful


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_pose_that_is_not_finite_is_refused(cell, side, bad):
    number = ("left", "right").index(side)

    def publish():
        stamp = cell.now()
        cell.pose(number, stamp, (0.0, bad, 0.5))
        cell.pose(1 - number, stamp)

    text = f"{side}_gripper/pose: position = [0.0, {bad}, 0.5] is not allowed: every entry must be finite"
    status = refused(cell, text, publish)
    assert "Give position as 3 finite numbers in m." in status.message
    assert int(values_of(status)[f"refused: {side}_gripper/pose pose"]) >= 1


def test_a_zero_quaternion_is_refused(cell):
    text = "left_gripper/pose: quaternion = [0.0, 0.0, 0.0, 0.0] is not allowed: its length is 0"
    refused(cell, text, lambda: cell.pair(quaternion=(0.0, 0.0, 0.0, 0.0)))


def test_another_frame_is_refused(cell):
    text = "header.frame_id = 'left_base' is not allowed: it must be 'world'"
    status = refused(cell, text, lambda: cell.pair(frame="left_base"))
    assert "set frame_id" in status.message


def test_a_repeated_stamp_is_refused(cell):
    stamp = nanoseconds(cell.predicted().header.stamp)
    refused(cell, f"header.stamp = {stamp} ns is repeated", lambda: cell.pair(stamp))


def test_a_stamp_that_was_never_set_is_refused(cell):
    refused(cell, "header.stamp = 0 ns is not allowed", lambda: cell.pair(0))


def test_a_stamp_going_backwards_is_refused(cell):
    stamp = nanoseconds(cell.predicted().header.stamp)
    refused(cell, "goes backwards, by 0.500000 s", lambda: cell.pair(stamp - 500_000_000))


def test_a_bag_that_loops_starts_the_prediction_afresh(cell):
    back = nanoseconds(cell.predicted().header.stamp)

    def loop():
        nonlocal back
        back -= 100_000_000_000
        cell.shape_at(back)

    cell.diagnosis("input", "taken as a restart of the clock", WARN, loop)


def test_input_that_ends_is_reported_as_stale_and_nothing_is_published(cell):
    cell.predicted()
    cell.spin(0.05)
    count = len(cell.shapes)
    status = cell.diagnosis("input", "stale: no message on left_gripper/pose and right_gripper/pose for", WARN)
    assert "more than stale_after = 0.4 s: nothing is published" in status.message
    assert len(cell.shapes) == count
    cell.predicted()


def test_one_gripper_going_silent_is_named(cell):
    def left_only():
        cell.pose(0, cell.now())
        cell.spin(0.02)
        texts = [s for m in cell.diagnostics for s in m.status if "stale: no message on right_gripper" in s.message]
        return next(iter(texts), None)

    cell.shapes.clear()
    status = cell.until(left_only, "diagnostics about right only")
    assert status.level == WARN
    assert "no message on left" not in status.message
    assert cell.shapes == []


def test_stamps_too_far_apart_never_pair_and_the_text_says_so(cell):
    def apart():
        stamp = cell.now()
        cell.pose(0, stamp)
        cell.pose(1, stamp - 10_000_000_000)
        cell.spin(0.02)
        lines = (s for m in cell.diagnostics for s in m.status if "no pair" in s.message)
        return next((s for s in lines if "10.000 s apart" in s.message), None)  # not only left had come yet

    def wide():
        stamp = cell.now()
        cell.pose(0, stamp)
        cell.pose(1, stamp + 150_000_000)
        sent.append(stamp)
        cell.spin(0.4)  # long enough that no other two stamps are nearer
        return any(cell.shape_of(stamp) for stamp in sent)

    sent = []
    status = cell.until(apart, "diagnostics about pairs")
    assert "10.000 s apart, max_skew = 0.02 s: nothing is published" in status.message
    assert "raise max_skew" in status.message
    assert cell.shapes == []
    assert cell.set(max_skew=0.2).successful
    try:
        cell.until(wide, "shape of a wide pair")
    finally:
        assert cell.set(max_skew=0.02).successful


def test_a_chord_longer_than_the_cable_is_a_status_a_warning_and_a_straight_line(cell):
    warnings = cell.listen(CableWarnings, "cable/warnings", LATCHED)
    stamp = cell.now()
    message = cell.shape_at(stamp, (0.0, 0.0, 0.5), (1.5, 0.0, 0.5))
    assert (message.status, message.usable) == (CableShape.OVERSTRETCHED, False)
    shape = shape_from(message)
    line = np.array((0.0, 0.0, 0.5)) + np.outer(np.linspace(0.0, 1.5, 150), (1.0, 0.0, 0.0))
    assert shape.positions == pytest.approx(line, abs=1e-9)
    kinds = cell.until(
        lambda: [w.kind for m in warnings if nanoseconds(m.header.stamp) == stamp for w in m.warnings], "warning"
    )
    assert CableWarning.OVERSTRETCHED in kinds
    status = cell.diagnosis("prediction", "OVERSTRETCHED", ERROR)
    assert "closer" in status.message
    cell.predicted()


def test_warnings_reach_a_late_joiner(cell):
    early = cell.listen(CableWarnings, "cable/warnings", LATCHED)
    stamp = cell.now()
    cell.shape_at(stamp, (0.0, 0.0, 0.5), (1.5, 0.0, 0.5))
    cell.until(lambda: early and nanoseconds(early[-1].header.stamp) == stamp, "warnings")  # they follow the shape
    late = cell.listen(CableWarnings, "cable/warnings", LATCHED)
    cell.until(lambda: late, "latched warnings")
    assert nanoseconds(late[0].header.stamp) == stamp
    assert CableWarning.OVERSTRETCHED in [w.kind for w in late[0].warnings]
    assert late[0].robot_checked is False


def test_margins_come_once_someone_listens_with_the_time_to_a_limit(cell):
    margins = cell.listen(CableMargins, "cable/margins")
    cell.until(lambda: cell.predicted() and margins, "margins")  # from now on each cycle sends some
    stamp = cell.now()

    def told():
        return next((m for m in margins if nanoseconds(m.header.stamp) == stamp), None)

    for chord in np.linspace(0.7, 1.1, 200)[:10]:
        stamp += 10_000_000
        cell.shape_at(stamp, (0.0, 0.0, 0.5), (chord, 0.0, 0.5))
        message = cell.until(told, "margins of this pair")
    stretch = message.margins[0]
    assert (stretch.cable_id, stretch.kind, stretch.limit) == ("cable", CableMargin.OVERSTRETCHED, 1.2)
    assert stretch.value == pytest.approx(chord)
    assert stretch.used == pytest.approx(stretch.value / 1.2)
    speed = (1.1 - 0.7) / 199 / 0.01
    assert stretch.time_to_limit == pytest.approx((1.2 - stretch.value) / speed, rel=1e-6)
    assert CableMargin.STABILITY in [m.kind for m in message.margins]


def test_standard_messages_come_once_someone_listens(cell):
    messages = {
        kind: cell.listen(kind, topic)
        for kind, topic in ((MarkerArray, "cable/markers"), (Path, "cable/path"), (PointCloud2, "cable/points"))
    }

    def all_came():
        cell.pair()
        cell.spin(0.05)
        return all(messages.values())

    cell.until(all_came, "markers, path and points")
    assert len(messages[Path][0].poses) == 150
    assert messages[PointCloud2][0].width == 150
    assert messages[MarkerArray][0].markers[0].header.frame_id == "world"


def test_diagnostics_turn_ok_with_rate_and_cycle_time(cell):
    def steady():
        cell.pair()
        cell.spin(0.01)
        statuses = [s for m in cell.diagnostics for s in m.status if s.name.endswith(": input")]
        return next((s for s in statuses if s.level == DiagnosticStatus.OK and told(s, "rate [Hz]") > 0.0), None)

    def told(status, name):
        return float(values_of(status).get(name, "nan"))

    def timed():
        cell.pair()
        cell.spin(0.01)
        statuses = [s for m in cell.diagnostics for s in m.status if s.name.endswith(": prediction")]
        return next((s for s in statuses if told(s, "cycle time p50 [ms]") > 0.0), None)

    status = cell.until(steady, "diagnostics OK with a rate")
    assert status.message.endswith("cycles a second")
    assert int(values_of(status)["pairs"]) > 0
    status = cell.until(timed, "diagnostics with a cycle time")
    assert (status.level, status.message) == (DiagnosticStatus.OK, "cable: OK")


def test_only_one_gripper_seen_is_named(start):
    fresh = start()
    text = "no message on right_gripper/pose yet (left_gripper/pose came)"
    status = fresh.diagnosis("input", text, WARN, lambda: fresh.pose(0, fresh.now()))
    assert "Start its publisher, or remap the topic" in status.message
    assert fresh.shapes == []
    fresh.predicted()
    assert fresh.process.stop() == 0


def test_a_set_rate_uses_the_newest_pair_and_sends_nothing_twice(start):
    slow = start(rate=10)
    first = slow.predicted()
    slow.shapes.clear()
    sent = []
    began = time.monotonic()
    while time.monotonic() < began + 2.0:
        sent.append(slow.pair())
        slow.spin(0.01)
    sent.append(nanoseconds(slow.predicted().header.stamp))  # nothing is under way any more
    seconds = time.monotonic() - began
    stamps = [nanoseconds(m.header.stamp) for m in slow.shapes]
    assert nanoseconds(first.header.stamp) not in stamps
    assert len(set(stamps)) == len(stamps)
    assert len(set(stamps) - set(sent)) <= slow.pairs - len(sent)  # those that were asked for again
    assert 1 <= len(stamps) <= 10.0 * seconds + 3  # 10 Hz, on a machine that may be busy
    assert stamps == sorted(stamps)
    slow.spin(0.5)
    assert len(slow.shapes) == len(stamps)  # no new input, no new message
    back = sent[-1] - 100_000_000_000

    def looped():  # what waited for a tick is dropped
        nonlocal back
        back = slow.pair(back + 10_000_000)
        slow.spin(0.01)
        return nanoseconds(slow.shapes[-1].header.stamp) < sent[0]

    slow.until(looped, "shape after the restart")
