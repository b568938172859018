"""Messages and core types: what goes in comes out, field by field."""

import array
import dataclasses
import math

import numpy as np
import pytest
from cable_shape_msgs.msg import CableMargin as CableMarginMessage
from cable_shape_msgs.msg import CableShape as CableShapeMessage
from cable_shape_msgs.msg import CableWarning as CableWarningMessage
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker

from cable_shape.errors import ArgumentError
from cable_shape.messages import fields
from cable_shape.pose import Pose
from cable_shape.ros import conversions
from cable_shape.ros.diagnostics import Complaint, Level, Verdict
from cable_shape.safety.report import CableWarning, CycleReport, Margin, Severity, WarningKind
from cable_shape.shape import CableShape, Status

STAMP = 1_700_000_000_123_456_789
HEADER = conversions.header_of(STAMP, "world")


def pose_message(pose):
    """A pose as a tracker sends it."""
    message = PoseStamped(header=HEADER)
    position, orientation = message.pose.position, message.pose.orientation
    position.x, position.y, position.z = pose.position.tolist()
    orientation.x, orientation.y, orientation.z, orientation.w = pose.quaternion.tolist()
    return message


@pytest.fixture
def shape():
    """A half circle of radius 1 in the x-z plane, with numbers that differ everywhere else."""
    n = 7
    rng = np.random.default_rng(1)
    buffer = rng.normal(size=17 * n)
    out = CableShape(
        buffer,
        n,
        length=math.pi,
        model="gradient4",
        status=Status.UNSTABLE,
        detail="why",
        energy=-1.25,
        error_estimate=1e-4,
        solve_time=2e-5,
        reused=True,
    )
    s = np.linspace(0.0, math.pi, n)
    out.arc_length[:] = s
    out.positions[:] = np.column_stack((np.cos(s), 0.0 * s, np.sin(s)))
    out.quaternions[:] /= np.linalg.norm(out.quaternions, axis=1)[:, None]
    return out


def warning(kind=WarningKind.CLEARANCE, severity=Severity.ERROR):
    return CableWarning(
        cable_id="cable",
        kind=kind,
        severity=severity,
        text="too near",
        value=0.004,
        limit=0.01,
        margin=2.5,
        arc_length=0.6,
        point_on_cable=np.array((1.0, 2.0, 3.0)),
        point_on_other=np.array((4.0, 5.0, 6.0)),
        other="box",
        time_to_limit=0.75,
    )


def report(shape, *warnings):
    return CycleReport(stamp=STAMP, grips={}, links=None, shapes={"cable": shape}, clearance={}, warnings=warnings)


def sent(message):
    """Through the wire format and back."""
    return deserialize_message(serialize_message(message), type(message))


def test_every_field_of_the_shape_message_is_filled_and_comes_back(shape):
    message = sent(conversions.shape_message("c1", shape, HEADER))
    assert set(fields.shape_fields("c1", shape)) == set(CableShapeMessage.get_fields_and_field_types()) - {"header"}
    assert conversions.nanoseconds(message.header.stamp) == STAMP
    assert message.header.frame_id == "world"
    assert (message.cable_id, message.usable) == ("c1", True)
    back = fields.shape_from(message)
    assert back.buffer.tobytes() == shape.buffer.tobytes()
    for name in ("points", "length", "model", "status", "detail", "energy", "error_estimate", "reused", "solve_time"):
        assert getattr(back, name) == getattr(shape, name), name


def test_shape_arrays_are_flat_rows_in_the_documented_order(shape):
    message = conversions.shape_message("cable", shape, HEADER)
    assert isinstance(message.positions, array.array)
    assert list(message.positions[:6]) == [*shape.positions[0], *shape.positions[1]]
    assert list(message.quaternions[4:8]) == list(shape.quaternions[1])
    assert list(message.force) == shape.force.ravel().tolist()
    assert list(message.moment) == shape.moment.ravel().tolist()
    assert list(message.curvature) == shape.curvature.ravel().tolist()


def test_the_message_does_not_follow_the_shape(shape):
    message = conversions.shape_message("cable", shape, HEADER)
    before = list(message.positions)
    shape.positions[:] = 0.0
    assert list(message.positions) == before


def test_every_field_of_a_warning_is_filled_and_comes_back(shape):
    message = sent(conversions.warnings_message(report(shape, warning()), HEADER))
    assert conversions.nanoseconds(message.header.stamp) == STAMP
    assert message.robot_checked is False
    (one,) = message.warnings
    assert set(fields.warning_fields(warning())) == set(CableWarningMessage.get_fields_and_field_types())
    assert (one.cable_id, one.other, one.text) == ("cable", "box", "too near")
    assert (one.kind, one.severity) == (CableWarningMessage.CLEARANCE, CableWarningMessage.ERROR)
    assert (one.value, one.limit, one.margin, one.arc_length) == (0.004, 0.01, 2.5, 0.6)
    assert (one.point_on_cable.x, one.point_on_cable.y, one.point_on_cable.z) == (1.0, 2.0, 3.0)
    assert (one.point_on_other.x, one.point_on_other.y, one.point_on_other.z) == (4.0, 5.0, 6.0)
    assert one.time_to_limit == 0.75


def test_every_field_of_a_margin_is_filled_and_comes_back(shape):
    margin = Margin(WarningKind.CLEARANCE, 0.8, 0.03, 0.036, -0.1, "box", math.inf)
    cables = {"a": (margin, Margin(WarningKind.STABILITY, 0.1, 0.0, 9.0, 0.6)), "b": ()}
    message = sent(conversions.margins_message(dataclasses.replace(report(shape), margins=cables), HEADER))
    assert conversions.nanoseconds(message.header.stamp) == STAMP
    one, two = message.margins
    assert set(fields.margin_fields("a", margin)) == set(CableMarginMessage.get_fields_and_field_types())
    assert (one.cable_id, one.kind, one.other) == ("a", CableMarginMessage.CLEARANCE, "box")
    assert (one.used, one.limit, one.value, one.arc_length, one.time_to_limit) == (0.8, 0.03, 0.036, -0.1, math.inf)
    assert (two.kind, two.other) == (CableMarginMessage.STABILITY, "")
    assert math.isnan(two.time_to_limit)


@pytest.mark.parametrize("member", [k for k in WarningKind if k not in (WarningKind.STATUS, WarningKind.SNAP)])
def test_margin_kinds_are_those_of_the_message(member):
    assert getattr(CableMarginMessage, member.name) == member.value


@pytest.mark.parametrize("status", list(Status))
def test_status_values_are_those_of_the_message(status):
    assert getattr(CableShapeMessage, status.name) == status.value


@pytest.mark.parametrize("member", [*WarningKind, *Severity])
def test_warning_values_are_those_of_the_message(member):
    assert getattr(CableWarningMessage, member.name) == member.value


def test_poses_come_back_and_bad_ones_are_named():
    pose = Pose((1.0, 2.0, 3.0), (0.1, -0.7, 0.1, 0.7))
    message = sent(pose_message(pose))
    assert conversions.pose_of(message) == pose
    message.pose.orientation.w *= 1.0005  # rounded: normalised to the same bits as by Pose
    q = message.pose.orientation
    assert conversions.pose_of(message) == Pose(pose.position, (q.x, q.y, q.z, q.w))
    message.pose.orientation.w *= 1.01
    with pytest.raises(ArgumentError, match=r"must be within 0\.001 of 1"):
        conversions.pose_of(message)
    zero = PoseStamped()
    zero.pose.orientation.w = 0.0
    with pytest.raises(ArgumentError, match=r"quaternion = \[0\.0, 0\.0, 0\.0, 0\.0\] .* its length is 0"):
        conversions.pose_of(zero)
    message.pose.position.x = math.nan
    with pytest.raises(ArgumentError, match=r"position = \[nan, 2\.0, 3\.0\] .* must be finite"):
        conversions.pose_of(message)


def test_a_pose_out_of_all_reach_and_a_monstrous_quaternion_are_refused():
    message = pose_message(Pose((1.0, -2e6, 3.0)))
    with pytest.raises(ArgumentError, match=r"position = \[1\.0, -2000000\.0, 3\.0\] .* within 1e\+06 m of"):
        conversions.pose_of(message)
    message.pose.orientation.w = 1e200  # its square is beyond double precision
    with pytest.raises(ArgumentError, match=r"quaternion = .* no magnitude may be above 1e\+20"):
        conversions.pose_of(message)


@pytest.mark.parametrize("stamp", [0, 1, 999_999_999, 10**9, STAMP])
def test_stamps_are_exact_to_the_nanosecond(stamp):
    assert conversions.nanoseconds(conversions.time_of(stamp)) == stamp


def test_path_holds_the_cable_frames(shape):
    path = sent(conversions.path_message(shape, HEADER))
    assert len(path.poses) == shape.points
    assert path.header == HEADER
    last = conversions.pose_of(path.poses[-1])
    assert np.array_equal(last.position, shape.positions[-1])
    assert np.allclose(last.quaternion, shape.quaternions[-1], atol=1e-15)


def test_points_hold_place_arc_length_and_tension(shape):
    cloud = sent(conversions.points_message({"a": shape, "b": shape}, HEADER))
    kinds = np.dtype([(f.name, "<f4") for f in cloud.fields])
    assert [f.offset for f in cloud.fields] == [0, 4, 8, 12, 16]
    assert (cloud.width, cloud.height, cloud.point_step) == (2 * shape.points, 1, kinds.itemsize)
    values = np.frombuffer(bytes(cloud.data), kinds)
    assert np.array_equal(values["z"][: shape.points], shape.positions[:, 2].astype("f4"))
    assert np.array_equal(values["arc_length"][shape.points :], shape.arc_length.astype("f4"))
    assert np.array_equal(values["tension"][: shape.points], shape.tension.astype("f4"))


def test_markers_draw_the_cable_and_what_is_near(shape):
    markers = sent(conversions.marker_message(report(shape, warning()), {"cable": 0.008}, HEADER, 0.5)).markers
    line, gaps, text, *others = markers
    assert [m.action for m in markers] == [Marker.ADD] * 3 + [Marker.DELETE] * len(others)
    assert (line.type, line.scale.x, len(line.points)) == (Marker.LINE_STRIP, 0.008, shape.points)
    assert line.points[3].z == shape.positions[3, 2]
    assert [(p.x, p.y, p.z) for p in gaps.points] == [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]
    assert text.text == "too near"
    assert (line.lifetime.sec, line.lifetime.nanosec) == (0, 500_000_000)
    assert line.color.r == pytest.approx(conversions.ERROR[0])


def test_markers_show_tails_and_the_shape_after_a_snap(shape):
    more = dataclasses.replace(report(shape), tails={("cable", "end"): shape}, after_snap={"cable": shape})
    *_, start, end, ghost = sent(conversions.marker_message(more, {"cable": 0.008}, HEADER, 0.5)).markers
    assert [m.action for m in (start, end, ghost)] == [Marker.DELETE, Marker.ADD, Marker.ADD]
    assert [m.type for m in (end, ghost)] == [Marker.LINE_STRIP] * 2
    for marker in (end, ghost):
        assert [(p.x, p.y, p.z) for p in marker.points] == [tuple(p) for p in shape.positions]
    assert end.color.a == 1.0
    assert 0.0 < ghost.color.a < 0.5
    assert len({(m.ns, m.id) for m in (start, end, ghost)}) == 3


def test_markers_without_warnings_take_the_old_ones_away(shape):
    line, gaps, text, *_ = conversions.marker_message(report(shape), {"cable": 0.008}, HEADER, 2.5).markers
    assert [line.action, gaps.action, text.action] == [Marker.ADD, Marker.DELETE, Marker.DELETE]
    assert line.color.r == pytest.approx(conversions.FINE[0])
    assert (line.lifetime.sec, line.lifetime.nanosec) == (2, 500_000_000)


def test_diagnostics_carry_level_text_and_values():
    verdict = Verdict("input", Level.WARN, "stale", {"rate [Hz]": "0.0"}, (Complaint("stale", Level.WARN, "stale"),))
    message = sent(conversions.diagnostics_message([verdict], "ns/cable_shape_node", STAMP))
    (status,) = message.status
    assert (status.level, status.name, status.message) == (b"\x01", "ns/cable_shape_node: input", "stale")
    assert [(v.key, v.value) for v in status.values] == [("rate [Hz]", "0.0")]
    assert conversions.nanoseconds(message.header.stamp) == STAMP
