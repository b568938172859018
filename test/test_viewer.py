"""The viewer: what a recording holds, the newest-wins mailbox, and a process that never disturbs its caller."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cable_shape.cable import Cable
from cable_shape.cycle import Cycle
from cable_shape.errors import ArgumentError
from cable_shape.plug import PlugError
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.predictor import predict
from cable_shape.report import BodyDistance, CableWarning, Clearance, CycleReport, Margin, Severity, WarningKind
from cable_shape.scene import Box, Capsule, Clip, Cylinder, HalfSpace, Mesh, Obstacle, PointMass, Scene, Sphere
from cable_shape.shape import CableShape, Status
from cable_shape.viewer.colour import by_clearance, by_curvature, check_colouring, scale, surface_distance
from cable_shape.viewer.mailbox import SLOT_BYTES, SLOTS, Mailbox, decode, encode
from cable_shape.viewer.process import ViewerProcess
from cable_shape.viewer.text import WarningLog, state

ROOT = Path(__file__).resolve().parent.parent
RADIUS = 0.4  # m, of the arc that the test cable forms
POINTS = 60
T0 = 1_700_000_000_000_000_000  # ns
PERIOD = 20_000_000  # ns

CABLE = Cable(length=0.5 * math.pi * RADIUS, linear_density=0.1, bending_stiffness=0.01, min_bend_radius=0.2)
TRIANGLE = Mesh(np.eye(3) * 0.05, np.array([[0, 1, 2]]))
SCENE = Scene(
    obstacles=(
        Obstacle("box", Box(np.array((0.1, 0.1, 0.1))), Pose((0.0, 0.0, 0.1))),
        Obstacle("sphere", Sphere(0.05), Pose((0.3, 0.0, 0.1))),
        Obstacle("rod of steel", Cylinder(0.02, 0.2), Pose((0.3, 0.2, 0.1))),
        Obstacle("pipe", Capsule(0.02, 0.2), Pose((0.3, 0.3, 0.1))),
        Obstacle("part", TRIANGLE),
        Obstacle("table", HalfSpace()),
    ),
    clips=(Clip(0.2, Pose((0.1, 0.0, 0.4))),),
    masses=(PointMass(0.3, 0.05),),
    sockets={"port": Pose((1.0, 0.0, 0.5))},
)
LINKS = (Obstacle("hand", Box(np.array((0.05, 0.05, 0.05))), link="wrist"),)


def arc(height: float = 0.5, status: Status = Status.OK) -> CableShape:
    """A quarter circle in the x-z plane: curvature 1 / RADIUS about d2 everywhere, tension 1 N to 2 N."""
    angle = np.linspace(0.0, 0.5 * np.pi, POINTS)
    zero, half = np.zeros(POINTS), 0.5 * angle
    forward = np.stack((np.cos(angle), zero, -np.sin(angle)), axis=1)  # tangent, from +x down to -z
    positions = np.stack((RADIUS * np.sin(angle), zero, height + RADIUS * (np.cos(angle) - 1.0)), axis=1)
    # d3 = +x is a turn of 90 degrees about +y
    quaternions = np.stack((zero, np.sin(half + 0.25 * np.pi), zero, np.cos(half + 0.25 * np.pi)), axis=1)
    curvature = np.tile((0.0, 1.0 / RADIUS, 0.0), (POINTS, 1))
    force = forward * np.linspace(1.0, 2.0, POINTS)[:, None]
    parts = (angle * RADIUS, positions, quaternions, curvature, force, np.zeros((POINTS, 3)))
    return CableShape(
        np.concatenate([part.ravel() for part in parts]), POINTS, length=CABLE.length, model="test", status=status
    )


def warning(distance: float, severity: Severity = Severity.WARN) -> CableWarning:
    return CableWarning(
        cable_id="cable",
        kind=WarningKind.CLEARANCE,
        severity=severity,
        text=f"{distance * 1e3:.1f} mm to box",
        value=distance,
        limit=0.03,
        margin=distance / 0.03,
        arc_length=0.1,
        point_on_cable=np.array((0.1, 0.0, 0.2)),
        point_on_other=np.array((0.1, 0.0, 0.18)),
        other="box",
    )


def report(k: int, stamp0: int = T0) -> CycleReport:
    """Report k of a cable that goes down by 1 mm a cycle past a box; warnings from cycle 3 to cycle 5."""
    shape = arc(0.5 - 0.001 * k)
    start = Pose(shape.positions[0], shape.quaternions[0])
    end = Grip(Pose(shape.positions[-1], shape.quaternions[-1]), kind="swivel")
    distance = 0.035 - 0.002 * k
    body = BodyDistance("box", distance, 0.1, np.array((0.1, 0.0, 0.2)), np.array((0.1, 0.0, 0.2 - distance)))
    return CycleReport(
        stamp=stamp0 + k * PERIOD,
        grips={"cable": (start, end)},
        links={"wrist": start},
        shapes={"cable": shape},
        clearance={"cable": Clearance((body,), robot_checked=True)},
        warnings=(warning(distance),) if 3 <= k <= 5 else (),
        times={"predict": 1e-5, "total": 2e-4},
        skipped={"reused": 0},
    )


MARGIN = Margin(WarningKind.CLEARANCE, 0.8, 0.03, 0.036, -0.1, "box", 1.25)
PLUG = PlugError("port", Pose((1, 2, 3)), 0.05, 0.1, -0.04, 0.03)


def near_a_snap(k: int) -> CycleReport:
    """Report k with tails, margins and, from cycle 2 to cycle 3, a snap that is about to come."""
    margins = (
        MARGIN._replace(used=0.1 * k, other="sphere"),
        MARGIN._replace(used=0.2 * k),
        Margin(WarningKind.OVERSTRETCHED, 3.0, 1.0, 3.0, 0.6),
    )
    return dataclasses.replace(
        report(k),
        margins={"cable": margins},
        tails={("cable", "start"): arc(0.2)},
        after_snap={"cable": arc(0.3, Status.SNAPPED)} if k in (2, 3) else {},
        plugs={"cable": PLUG},
    )


def write(path: Path, reports: list[CycleReport], **keywords: object) -> None:
    from cable_shape.viewer.recording import RecordingWriter

    with RecordingWriter(path, {"cable": CABLE}, SCENE, LINKS, **keywords) as writer:
        for r in reports:
            writer.log(r)


def columns(path: Path) -> dict[str, list[tuple[object, object]]]:
    """Everything in a recording: column -> (time or None if static, value) in the order of time."""
    from rerun.chunk import RrdReader

    out: dict[str, list[tuple[object, object]]] = {}
    for chunk in RrdReader(str(path)).stream().to_chunks():
        batch = chunk.to_record_batch()
        names = batch.schema.names
        times = [None] * batch.num_rows if chunk.is_static else batch.column("stamp").cast("int64").to_pylist()
        for name in names:
            if name not in {"stamp", "rerun.controls.RowId"}:
                values = batch.column(name).to_pylist()
                rows = [(t, v) for t, v in zip(times, values, strict=True) if v is not None]
                out.setdefault(f"{chunk.entity_path}:{name}", []).extend(rows)
    return {name: sorted(rows, key=lambda row: row[0] or 0) for name, rows in out.items()}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[object, object]]]:
    path = tmp_path_factory.mktemp("viewer") / "out.rrd"
    write(path, [report(k) for k in range(8)])
    return columns(path)


def test_recording_has_a_row_of_every_report(recorded: dict[str, list[tuple[object, object]]]) -> None:
    stamps = [T0 + k * PERIOD for k in range(8)]
    for column in (
        "/world/cables/cable/line:LineStrips3D:strips",
        "/world/robot/wrist:Transform3D:translation",
        "/world/cables/cable/start:Transform3D:translation",
        "/world/cables/cable/end:Transform3D:translation",
        "/world/cables/cable/closest/line:LineStrips3D:labels",
        "/world/cables/cable/masses:Points3D:positions",
        "/plots/clearance/cable:Scalars:scalars",
        "/plots/bend_radius/cable:Scalars:scalars",
        "/plots/tension/cable:Scalars:scalars",
        "/state:TextDocument:text",
    ):
        assert [t for t, _ in recorded[column]] == stamps, column


def test_recording_holds_what_the_reports_say(recorded: dict[str, list[tuple[object, object]]]) -> None:
    strips = np.array(recorded["/world/cables/cable/line:LineStrips3D:strips"][4][1])
    expected = report(4).shapes["cable"].positions
    assert strips.shape == (POINTS - 1, 2, 3)
    np.testing.assert_allclose(strips[:, 0], expected[:-1], atol=1e-6)
    np.testing.assert_allclose(strips[:, 1], expected[1:], atol=1e-6)
    value = {
        plot: [v[0] for _, v in recorded[f"/plots/{plot}/cable:Scalars:scalars"]]
        for plot in ("clearance", "bend_radius", "tension")
    }
    np.testing.assert_allclose(value["clearance"], [35.0 - 2.0 * k for k in range(8)])  # mm
    np.testing.assert_allclose(value["bend_radius"], 1e3 * RADIUS)  # mm
    np.testing.assert_allclose(value["tension"], 2.0)  # N
    assert recorded["/world/cables/cable/closest/line:LineStrips3D:labels"][5][1] == ["box  25.0 mm"]
    # half the curvature that the limit of 0.2 m allows is the middle of the scale
    colour = recorded["/world/cables/cable/line:LineStrips3D:colors"][0][1][0]
    assert colour == int.from_bytes(bytes((255, 213, 79, 255)), "big")


def test_margins_tails_and_the_shape_after_a_snap_are_shown(tmp_path: Path) -> None:
    write(tmp_path / "out.rrd", [near_a_snap(k) for k in range(5)])
    held = columns(tmp_path / "out.rrd")
    stamps = [T0 + k * PERIOD for k in range(5)]
    used = held["/plots/margins/cable/clearance:Scalars:scalars"]
    assert [t for t, _ in used] == stamps
    np.testing.assert_allclose([v[0] for _, v in used], [0.0, 0.2, 0.4, 0.6, 0.8])  # of all bodies the nearest
    assert held["/plots/margins/cable/overstretched:Scalars:scalars"][0][1] == [2.0], "no more than twice the limit"
    assert {tuple(v) for _, v in held["/plots/margins/limit:Scalars:scalars"]} == {(1.0,)}
    (strip,) = held["/world/cables/cable/tails/start:LineStrips3D:strips"][0][1]
    np.testing.assert_allclose(strip, arc(0.2).positions, atol=1e-6)
    ghost = "/world/cables/cable/after_snap"
    assert [t for t, _ in held[f"{ghost}:LineStrips3D:strips"]] == stamps[2:4]
    (cleared,) = [rows for name, rows in held.items() if name.startswith(f"{ghost}:Clear")]
    assert [t for t, _ in cleared] == stamps[4:]
    assert held["/world/sockets/port:Transform3D:translation"][0] == (None, [pytest.approx([1.0, 0.0, 0.5])])
    text = held["/state:TextDocument:text"][1][1][0]
    assert "stretch 300 %, in 1.2 s" not in text
    assert "| stretch 300 % |" in text
    assert "plug to port" in text
    assert "| 50.0 mm, 5.7° |" in text


def test_what_stands_still_is_written_once(recorded: dict[str, list[tuple[object, object]]]) -> None:
    for entity, component in (
        ("box", "Boxes3D:half_sizes"),
        ("sphere", "Ellipsoids3D:half_sizes"),
        ("rod\\ of\\ steel", "Cylinders3D:radii"),
        ("pipe", "Capsules3D:radii"),
        ("part", "Mesh3D:vertex_positions"),
        ("table", "Boxes3D:half_sizes"),
    ):
        rows = recorded[f"/world/obstacles/{entity}:{component}"]
        assert [t for t, _ in rows] == [None], entity
    assert recorded["/world/obstacles/box:Boxes3D:half_sizes"][0][1] == [pytest.approx([0.05, 0.05, 0.05])]
    assert recorded["/world/robot/wrist/hand:Boxes3D:half_sizes"][0][0] is None
    assert recorded["/world/cables/cable/clips/0:Transform3D:translation"][0][1] == [pytest.approx([0.1, 0.0, 0.4])]


def test_warnings_are_told_when_they_begin_and_end(recorded: dict[str, list[tuple[object, object]]]) -> None:
    told = [(t, v[0]) for t, v in recorded["/warnings:TextLog:text"]]
    assert told == [(T0 + 3 * PERIOD, "29.0 mm to box"), (T0 + 6 * PERIOD, "cable: clearance to box is over")]
    assert [v[0] for _, v in recorded["/warnings:TextLog:level"]] == ["WARN", "INFO"]


def test_two_runs_decode_to_the_same_columns(tmp_path: Path) -> None:
    """The second run takes other times, and another process with another hash seed."""
    write(tmp_path / "a.rrd", [report(k) for k in range(6)])
    code = (
        "import sys, time, dataclasses; sys.path.insert(0, 'test'); from pathlib import Path; import test_viewer as t\n"
        "reports = [dataclasses.replace(t.report(k), times={'total': time.perf_counter()}) for k in range(6)]\n"
        "t.write(Path(sys.argv[1]), reports)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "b.rrd")], check=True, timeout=60, cwd=ROOT)
    a, b = columns(tmp_path / "a.rrd"), columns(tmp_path / "b.rrd")
    assert a.keys() == b.keys()
    for name in a:
        assert a[name] == b[name], name


def test_times_are_plotted_when_asked_for(tmp_path: Path) -> None:
    write(tmp_path / "times.rrd", [report(0)], times=True)
    write(tmp_path / "none.rrd", [report(0)])
    ((_, spent),) = columns(tmp_path / "times.rrd")["/plots/time/cycle:Scalars:scalars"]
    assert spent == pytest.approx([0.2, 0.01])  # ms
    assert not [name for name in columns(tmp_path / "none.rrd") if name.startswith("/plots/time")]


def test_clock_of_a_simulation_is_a_duration(tmp_path: Path) -> None:
    write(tmp_path / "sim.rrd", [report(k, stamp0=0) for k in range(3)])
    rows = columns(tmp_path / "sim.rrd")["/plots/clearance/cable:Scalars:scalars"]
    assert [t for t, _ in rows] == [0, PERIOD, 2 * PERIOD]


def test_markers_and_a_body_that_goes_out_of_reach(tmp_path: Path) -> None:
    from cable_shape.viewer.recording import RecordingWriter

    points = np.arange(12.0).reshape(4, 3)
    far = dataclasses.replace(report(1), clearance={"cable": Clearance(beyond=0.3)})
    with RecordingWriter(tmp_path / "out.rrd", {"cable": CABLE}, SCENE, colour="clearance") as writer:
        writer.log_markers(points, T0 - PERIOD)
        writer.log(report(0))
        writer.log(far)
        writer.log_markers(points + 1.0)
    held = columns(tmp_path / "out.rrd")
    markers = held["/world/markers:Points3D:positions"]
    assert [t for t, _ in markers] == [T0 - PERIOD, T0 + PERIOD]
    np.testing.assert_allclose(markers[1][1], points + 1.0)
    assert held["/plots/clearance/cable:Scalars:scalars"][1] == (T0 + PERIOD, [pytest.approx(300.0)])
    assert any(name.startswith("/world/cables/cable/closest") and "Clear" in name for name in held)


def test_unusable_shape_is_grey_and_told(tmp_path: Path) -> None:
    lost = dataclasses.replace(report(0), shapes={"cable": arc(status=Status.OVERSTRETCHED)})
    write(tmp_path / "out.rrd", [lost])
    held = columns(tmp_path / "out.rrd")
    assert set(held["/world/cables/cable/line:LineStrips3D:colors"][0][1]) == {
        int.from_bytes(b"\x96\x96\x9e\xff", "big")
    }
    assert "Bring them closer" in held["/state:TextDocument:text"][0][1][0]


def test_blueprint_opens_on_the_scene(tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    from cable_shape.viewer.blueprint import eye

    write(tmp_path / "out.rrd", [report(0)])
    assert len(RrdReader(str(tmp_path / "out.rrd")).blueprints()) == 1
    camera = eye(report(0), SCENE)
    middle = report(0).shapes["cable"].positions.mean(axis=0)
    sight = (camera.target - camera.position) / np.linalg.norm(camera.target - camera.position)
    away = middle - camera.position
    assert math.degrees(math.acos(sight @ away / np.linalg.norm(away))) < 20.0  # the cable is well within the picture
    assert camera.position[2] > middle[2]
    wrist_beyond = CycleReport(0, {}, {"base": Pose((0.2, 3.0, 0.0))}, {"cable": arc()}, {}, ())
    assert eye(wrist_beyond, SCENE).position[1] < 0.0  # the robot at y = 3 stands behind the cable


def solids() -> st.SearchStrategy[tuple[object, np.ndarray, np.ndarray]]:
    """(solid, a point of its surface, the unit normal there) in the solid's frame, edges and rims included."""
    size = st.floats(0.01, 1.0)
    unit = st.floats(0.0, 1.0)
    turn = st.floats(-math.pi, math.pi)

    def direction(a: float, b: float) -> np.ndarray:
        return np.array((math.cos(a) * math.sin(b), math.sin(a) * math.sin(b), math.cos(b)))

    def box(x: float, y: float, z: float, u: float, v: float, b: float) -> tuple[object, np.ndarray, np.ndarray]:
        # an edge along z at +x +y: every normal between the two faces' normals belongs to it
        b = 0.5 * math.pi * (b / math.pi * 0.5 + 0.5)
        point = np.array((0.5 * x, 0.5 * y, (u - 0.5) * z))
        if v < 0.5:  # or inside the face +x
            return Box(np.array((x, y, z))), point * (1, 2 * v - 0.5, 1), np.array((1.0, 0.0, 0.0))
        return Box(np.array((x, y, z))), point, np.array((math.cos(b), math.sin(b), 0.0))

    def cylinder(r: float, h: float, a: float, u: float, v: float) -> tuple[object, np.ndarray, np.ndarray]:
        out = np.array((math.cos(a), math.sin(a), 0.0))
        if u < 0.4:
            return Cylinder(r, h), out * r + (0, 0, (v - 0.5) * h), out
        if u < 0.7:
            return Cylinder(r, h), out * r * v + (0, 0, 0.5 * h), np.array((0.0, 0.0, 1.0))
        tilt = 0.5 * math.pi * v
        return Cylinder(r, h), out * r + (0, 0, 0.5 * h), out * math.cos(tilt) + np.array((0, 0, math.sin(tilt)))

    def capsule(r: float, h: float, a: float, b: float) -> tuple[object, np.ndarray, np.ndarray]:
        n = direction(a, b)
        return Capsule(r, h), r * n + (0, 0, math.copysign(0.5 * h, n[2])), n

    return st.one_of(
        st.builds(lambda r, a, b: (Sphere(r), r * direction(a, b), direction(a, b)), size, turn, turn),
        st.builds(box, size, size, size, unit, unit, turn),
        st.builds(cylinder, size, size, turn, unit, unit),
        st.builds(capsule, size, size, turn, turn),
        st.builds(lambda x, y: (HalfSpace(), np.array((x, y, 0.0)), np.array((0.0, 0.0, 1.0))), size, size),
    )


@settings(derandomize=True, deadline=None, max_examples=200)
@given(solids(), st.floats(0.0, 2.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_surface_distance_along_the_normal(
    case: tuple[object, np.ndarray, np.ndarray], height: float, a: float, b: float
) -> None:
    """A point `height` above the surface of a convex solid, along its normal, is exactly that far from it."""
    solid, point, normal = case
    q = np.array((math.sin(a) * math.cos(b), math.sin(a) * math.sin(b), 0.0, math.cos(a)))
    pose = Pose((a, b, 1.0), q)
    world = (pose * Pose(point + height * normal)).position
    assert surface_distance(solid, pose, world[None])[0] == pytest.approx(height, abs=1e-9)


def test_surface_distance_is_negative_inside() -> None:
    centre = np.zeros((1, 3))
    assert surface_distance(Box(np.array((0.2, 0.4, 0.6))), Pose(), centre)[0] == pytest.approx(-0.1)
    assert surface_distance(Cylinder(0.3, 0.2), Pose(), centre)[0] == pytest.approx(-0.1)
    assert surface_distance(Sphere(0.3), Pose(), centre)[0] == pytest.approx(-0.3)
    assert math.isinf(surface_distance(TRIANGLE, Pose(), centre)[0])


def test_colours() -> None:
    assert scale(np.array((-1.0, 0.0, 2.0)))[:, :3].tolist() == [[38, 198, 218], [38, 198, 218], [244, 54, 76]]
    np.testing.assert_allclose(by_curvature(CABLE, arc()), 0.2 / RADIUS)
    scene = Scene((Obstacle("table", HalfSpace()),), warn_distance=0.03, error_distance=0.01)
    # the cable's lowest point, its end, is at height - RADIUS; its surface half a diameter lower
    fraction = by_clearance(CABLE, arc(RADIUS + 0.05 + 0.5 * CABLE.diameter), scene, (), None)
    assert fraction[-1] == pytest.approx((0.09 - 0.05) / (0.09 - 0.01))
    assert fraction[0] == 0.0
    body = Obstacle("arm", Sphere(0.01), link="arm")
    middle = Pose(arc().positions[POINTS // 2])
    near = by_clearance(CABLE, arc(), Scene(), (body,), {"arm": middle})
    assert near.max() == 1.0
    gripper = by_clearance(CABLE, arc(), Scene(), (body,), {"arm": Pose(arc().positions[0])})
    assert gripper.max() == 0.0
    with pytest.raises(ArgumentError, match=r"colour = 'rainbow' is not allowed: it must be one of curvature, clear"):
        check_colouring("rainbow")


def test_warning_log_tells_changes_only() -> None:
    log = WarningLog()
    assert log.changes(()) == []
    assert log.changes((warning(0.02),)) == [(Severity.WARN, "20.0 mm to box")]
    assert log.changes((warning(0.019),)) == []
    assert log.changes((warning(0.005, Severity.ERROR), warning(0.02))) == [(Severity.ERROR, "5.0 mm to box")]
    assert log.changes(()) == [(None, "cable: clearance to box is over")]
    assert log.changes((warning(0.02),)) == [(Severity.WARN, "20.0 mm to box")]


def test_state_says_what_was_not_checked() -> None:
    unchecked = dataclasses.replace(report(0), clearance={"cable": Clearance(beyond=0.5)})
    assert "over 500.0 mm; robot not checked" in state(unchecked, "legend", times=False)
    assert "µs" not in state(report(0), "legend", times=False)
    assert "**35.0 mm** to box" in state(report(0), "legend", times=True)


def test_letters_come_out_as_they_went_in() -> None:
    k = np.int64(4)
    sent = report(int(k))
    sent = CycleReport(
        stamp=sent.stamp,
        grips={
            "cable": (Grip(Pose((1, 2, 3)), "pinned", Pose((0, 0, 0.1), (1, 0, 0, 0)), (1, 2, 3)), None),
            "other": (Pose((1, 2, 3), turns=2), Pose()),
        },
        links=None,
        shapes=sent.shapes,
        clearance=sent.clearance,
        warnings=sent.warnings,
        times={"total": float(np.float64(1e-3))},
        skipped={"reused": k},
        margins={"cable": (MARGIN, Margin(WarningKind.STABILITY, np.float64(0.1), 0.0, 9.0, 0.3))},
        tails={("cable", "end"): arc(0.2)},
        after_snap={"cable": arc(0.3, Status.SNAPPED)},
        plugs={"cable": PLUG},
    )
    got = decode(encode(sent))
    assert (got.stamp, got.links, got.times, got.skipped) == (sent.stamp, None, {"total": 1e-3}, {"reused": 4})
    start, end = got.grips["cable"]
    assert end is None
    assert (start.pose, start.kind, start.offset) == (Pose((1, 2, 3)), "pinned", Pose((0, 0, 0.1), (1, 0, 0, 0)))
    np.testing.assert_array_equal(start.curvature, (1, 2, 3))
    np.testing.assert_allclose(start.cable_frame.position, (1, 2, 3.1))
    assert got.grips["other"] == (Pose((1, 2, 3), turns=2), Pose())
    for name in CableShape.__slots__:
        np.testing.assert_array_equal(getattr(got.shapes["cable"], name), getattr(sent.shapes["cable"], name), name)
    body, expected = got.clearance["cable"].closest, sent.clearance["cable"].closest
    assert (body.body, body.distance, body.arc_length) == (expected.body, expected.distance, expected.arc_length)
    np.testing.assert_array_equal(body.point_on_body, expected.point_on_body)
    assert got.clearance["cable"].robot_checked is True
    assert (got.warnings[0].text, got.warnings[0].kind) == (sent.warnings[0].text, WarningKind.CLEARANCE)
    assert got.warnings[0].margin == sent.warnings[0].margin
    assert math.isnan(got.warnings[0].time_to_limit)
    assert got.margins["cable"][0] == MARGIN
    assert math.isnan(got.margins["cable"][1].time_to_limit)
    np.testing.assert_array_equal(got.tails["cable", "end"].buffer, arc(0.2).buffer)
    assert got.after_snap["cable"].status is Status.SNAPPED
    assert got.plugs == {"cable": PLUG}


def test_a_free_end_comes_out_as_one() -> None:
    sent = CycleReport(0, {"cable": (Pose(), FreeEnd(mass=0.1))}, None, {"cable": arc()}, {}, ())
    assert decode(encode(sent)).grips["cable"] == (Pose(), None)


@contextlib.contextmanager
def a_mailbox():
    mailbox = Mailbox(Mailbox.memory())
    try:
        yield mailbox
    finally:
        mailbox.close()


def test_mailbox_keeps_the_newest_letter() -> None:
    with a_mailbox() as mailbox:
        assert mailbox.take(0) is None
        for k in range(1, 3 * SLOTS):
            assert mailbox.put(b"letter %d" % k)
        assert mailbox.take(0) == (3 * SLOTS - 1, b"letter %d" % (3 * SLOTS - 1))
        assert mailbox.take(3 * SLOTS - 1) is None
        assert mailbox.taken == 1
        assert not mailbox.put(bytes(SLOT_BYTES + 1))
        assert mailbox.newest == 3 * SLOTS - 1


def test_reader_and_writer_at_once_tear_no_letter() -> None:
    """Another process writes as fast as it can; every letter taken is of one piece and they only go forward."""
    code = (
        "import sys, time; from cable_shape.viewer.mailbox import Mailbox\n"
        "box = Mailbox(int(sys.argv[1]))\n"
        "for k in range(20000):\n"
        "    box.put(bytes([k % 251]) * (1000 + k % 7000))\n"
        "    if k % 200 == 0: time.sleep(1e-3)\n"
    )
    with a_mailbox() as mailbox:
        writer = subprocess.Popen([sys.executable, "-c", code, str(mailbox.file)], pass_fds=[mailbox.file], cwd=ROOT)
        number, taken = 0, 0
        until = time.monotonic() + 30.0
        while number < 20000 and time.monotonic() < until:
            letter = mailbox.take(number)
            if letter is not None:
                assert letter[0] > number
                number, text = letter
                taken += 1
                k = number - 1
                assert text == bytes([k % 251]) * (1000 + k % 7000)
        assert writer.wait(30.0) == 0
    assert number == 20000
    assert taken > 2


def last_stamp(path: Path) -> object:
    return columns(path)["/plots/tension/cable:Scalars:scalars"][-1][0]


def wait_until(true: object, within: float = 20.0) -> bool:
    until = time.monotonic() + within
    while not true():  # type: ignore[operator]
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True


def test_last_of_many_reports_arrives(tmp_path: Path) -> None:
    with ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE, LINKS) as viewer:
        assert all(viewer.send(report(k)) for k in range(1000))
        assert wait_until(lambda: viewer.shown >= 1)
        assert viewer.close(timeout=20.0)
    assert (viewer.sent, viewer.dropped) == (1000, 0)
    assert 1 <= viewer.shown < 1000
    assert last_stamp(tmp_path / "out.rrd") == T0 + 999 * PERIOD


def test_every_report_is_shown_when_they_come_slowly(tmp_path: Path) -> None:
    robot = ROOT / "config" / "robots" / "dual_arm.yaml"
    with ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE, robot, max_rate=1000.0) as viewer:
        for k in range(5):
            assert viewer.send(report(k))
            assert wait_until(lambda k=k: viewer.shown == k + 1)
        assert viewer.close(timeout=20.0)
    held = columns(tmp_path / "out.rrd")
    assert len(held["/plots/tension/cable:Scalars:scalars"]) == 5
    assert any(name.startswith("/world/robot/left_forearm/") for name in held)


def test_killed_viewer_does_not_disturb_the_caller(tmp_path: Path) -> None:
    viewer = ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE)
    try:
        assert viewer.send(report(0))
        assert wait_until(lambda: viewer.shown == 1)
        os.kill(viewer.pid, signal.SIGKILL)
        assert wait_until(lambda: not viewer.send(report(1)))
        assert [viewer.send(report(k)) for k in range(2, 5)] == [False] * 3
        assert viewer.dropped == 4
        assert viewer.shown == 1
    finally:
        began = time.monotonic()
        assert viewer.close(timeout=5.0) is False
        assert time.monotonic() - began < 5.0
    assert viewer.close() is False
    assert viewer.send(report(9)) is False


def test_stopped_viewer_is_ended_within_the_time_given(tmp_path: Path) -> None:
    viewer = ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE)
    os.kill(viewer.pid, signal.SIGSTOP)
    for k in range(70_000):  # more wake-ups than the pipe holds: still no waiting
        assert viewer.send(report(0) if k == 0 else _SMALL)
    began = time.monotonic()
    assert viewer.close(timeout=0.2) is False
    assert time.monotonic() - began < 10.0


_SMALL = CycleReport(T0, {}, None, {}, {}, ())


def test_caller_imports_no_rerun_and_when_it_dies_leaves_a_whole_recording(tmp_path: Path) -> None:
    code = (
        "import os, sys, time; sys.path.insert(0, 'test'); import test_viewer as t\n"
        "viewer = t.ViewerProcess(sys.argv[1], {'cable': t.CABLE}, t.SCENE)\n"
        "viewer.send(t.report(7))\n"
        "print(viewer.pid, *({'rerun', 'pinocchio', 'rclpy'} & set(sys.modules)), flush=True)\n"
        "os.kill(os.getpid(), 9)"
    )
    path = tmp_path / "out.rrd"
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True, timeout=60, check=False, cwd=ROOT
    )
    assert done.returncode == -signal.SIGKILL
    status = Path(f"/proc/{int(done.stdout)}/status")
    assert wait_until(lambda: not status.exists() or "\nState:\tZ" in status.read_text())
    assert last_stamp(path) == T0 + 7 * PERIOD


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("picture.png",), r"mode = 'picture.png' is not allowed: it must be 'window' or end in .rrd"),
        (("nowhere/out.rrd",), r"there is no folder .*nowhere. Make the folder first"),
        (("out.rrd", {}, Scene(), None, "lots"), r"memory_limit = 'lots' is not allowed.*Write 512MB, 2GiB or 10%"),
    ],
)
def test_bad_arguments(
    arguments: tuple[object, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    mode, *rest = arguments
    with pytest.raises(ArgumentError, match=message):
        ViewerProcess(mode, *(rest or ({}, Scene())))


def test_window_needs_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(ArgumentError, match=r"neither DISPLAY nor WAYLAND_DISPLAY is set. Write a .rrd instead"):
        ViewerProcess("window", {}, Scene())


def vulkan() -> bool:
    return any(folder.is_dir() and any(folder.glob("*.json")) for folder in (Path("/usr/share/vulkan/icd.d"),))


def commands_of(pid: int) -> list[tuple[int, str]]:
    """(pid, command line) of the children of a process."""
    out = []
    for folder in Path("/proc").iterdir():
        with contextlib.suppress(OSError, ValueError):
            if folder.name.isdecimal() and int((folder / "stat").read_text().rsplit(")")[1].split()[1]) == pid:
                out.append((int(folder.name), (folder / "cmdline").read_text().replace("\0", " ")))
    return out


def shown_time(command: str) -> int | None:
    """The time [ns] that the window with this command line shows."""
    from rerun.experimental import ViewerClient

    port = command.split("--port ")[1].split()[0]
    recordings = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy").get_state().recordings
    return recordings[0].current_time if recordings else None


@pytest.mark.skipif(
    not (shutil.which("Xvfb") and vulkan()),
    reason="needs Xvfb and Mesa: apt-get install xvfb mesa-vulkan-drivers libvulkan1 libxkbcommon-x11-0",
)
def test_window_opens_under_a_memory_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    screen = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", "800x600x24", "-nolisten", "tcp"],
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    window = None
    try:
        with open(reading) as numbers:
            monkeypatch.setenv("DISPLAY", f":{numbers.readline().strip()}")
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
        viewer = ViewerProcess("window", {"cable": CABLE}, SCENE, memory_limit="64MB")
        assert viewer.send(report(0))
        assert wait_until(lambda: viewer.shown == 1, within=60.0)
        ((window, command),) = commands_of(viewer.pid)
        assert "--memory-limit 64MB --server-memory-limit 64MB" in command
        assert "--bind 127.0.0.1" in command
        assert viewer.send(report(5))
        assert wait_until(lambda: shown_time(command) == T0 + 5 * PERIOD, within=60.0)
        os.kill(window, signal.SIGKILL)  # someone closes the window
        assert wait_until(lambda: not viewer.send(report(1)))
        viewer.close(timeout=20.0)
        window = None
    finally:
        if window is not None:
            os.kill(window, signal.SIGKILL)
        screen.terminate()
        screen.wait(10.0)


@pytest.mark.skipif(not vulkan(), reason="needs a Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1")
def test_screenshot_shows_the_cable(tmp_path: Path) -> None:
    from matplotlib.image import imread

    from cable_shape.viewer.screenshot import screenshot

    write(tmp_path / "out.rrd", [report(k) for k in range(3)])
    (tmp_path / "out.png").write_bytes(screenshot(tmp_path / "out.rrd", 0.02, (800, 500), settle=2.0))
    pixels = imread(tmp_path / "out.png")[..., :3] * 255.0
    assert pixels.shape == (500, 800, 3)
    scene = pixels[60:400, :500]
    yellow = np.abs(scene - (255.0, 213.0, 79.0)).max(axis=2) < 40.0  # the arc is at the middle of the scale
    assert yellow.sum() > 300
    with pytest.raises(ArgumentError, match=r"at = 9.0 is not allowed: the recording is 0.040 s long"):
        screenshot(tmp_path / "out.rrd", 9.0)


def test_forces_of_clips_are_drawn_where_they_act_and_go_with_the_shape() -> None:
    from cable_shape.viewer.forces import Forces, arrows  # here: this module must not import rerun

    cable = Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
    scene = Scene(clips=[Clip(0.5, Pose((0.4, 0.0, 0.8)))])
    grips = Pose((0, 0, 1), (0.5, 0.5, 0.5, 0.5)), Pose((0.8, 0, 1), (0.5, 0.5, 0.5, 0.5))
    shape = predict(cable, *grips, scene=scene, points=201)
    origins, forces = arrows(shape)
    np.testing.assert_allclose(origins, [(0.4, 0.0, 0.8)], atol=1e-6)
    # clip and grips carry the weight: what the clip does is the jump of the force from after it to before it
    before, after = shape.force[shape.arc_length < 0.5][-1], shape.force[shape.arc_length > 0.5][0]
    weight_between = 0.981 * 2.0 * shape.arc_length[1]  # from the point before it to the one after it
    np.testing.assert_allclose(forces[0], before - after - (0, 0, -weight_between), atol=1e-6)
    drawn = Forces("/forces", cable)
    shown = drawn.of(shape)
    assert shown is not None
    assert "Arrows3D" in type(shown[0]).__name__
    gone = drawn.of(predict(cable, *grips))
    assert gone is not None
    assert type(gone[0]).__name__ == "Clear"
    assert drawn.of(predict(cable, *grips)) is None
    sent = CycleReport(0, {"cable": grips}, None, {"cable": shape}, {}, ())
    np.testing.assert_array_equal(decode(encode(sent)).shapes["cable"].supports, shape.supports)
    table = Scene(obstacles=[Obstacle("table", HalfSpace(), Pose((0, 0, 0.8)))], contact="solve")
    lying = predict(cable, *grips, scene=table)
    origins, forces = arrows(lying)
    assert len(origins) == len(lying.contacts) > 0
    np.testing.assert_allclose(origins[:, 2], 0.804, atol=1e-3)
    assert (forces[:, 2] > 0.0).all()
    got = decode(encode(CycleReport(0, {"cable": grips}, None, {"cable": lying}, {}, ()))).shapes["cable"]
    assert [contact.body for contact in got.contacts] == ["table"] * len(lying.contacts)


def test_margins_are_bars_that_go_when_there_is_no_margin_any_more(tmp_path: Path) -> None:
    write(tmp_path / "out.rrd", [near_a_snap(k) for k in range(5)] + [report(5)])
    held = columns(tmp_path / "out.rrd")
    bars = held["/margins/clearance:BarChart:values"]
    # only changes are written: the nearest body uses 0, 0.2, ... of its limit, and the last report knows no margin
    assert [t for t, _ in bars] == [T0 + k * PERIOD for k in range(1, 6)]
    np.testing.assert_allclose([v[0]["buffer"][0] for _, v in bars], [0.2, 0.4, 0.6, 0.8, 0.0])
    stretch = held["/margins/stretch:BarChart:values"]
    np.testing.assert_allclose([v[0]["buffer"][0] for _, v in stretch], [2.0, 0.0])
    assert held["/margins/limit:BarChart:values"][0][0] is None


def test_the_closest_pair_is_of_a_body_that_the_cable_does_not_rest_on(tmp_path: Path) -> None:
    cable = Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
    post = Obstacle("post", Sphere(0.02), Pose((0.4, 0.1, 0.82)))
    scene = Scene(obstacles=[Obstacle("table", HalfSpace(), Pose((0, 0, 0.8))), post], contact="solve")
    grips = Pose((0, 0, 1), (0.5, 0.5, 0.5, 0.5)), Pose((0.8, 0, 1), (0.5, 0.5, 0.5, 0.5))
    cycle = Cycle(cable, scene=scene)
    said = cycle.step({"cable": grips}, stamp=T0)
    assert said.clearance["cable"].closest.body == "table"
    from cable_shape.viewer.recording import RecordingWriter  # here: this module must not import rerun

    with RecordingWriter(tmp_path / "out.rrd", cycle.cables, scene) as writer:
        writer.log(said)
    ((_, label),) = columns(tmp_path / "out.rrd")["/world/cables/cable/closest/line:LineStrips3D:labels"]
    assert label[0].startswith("post  ")


def test_what_is_offered_too_soon_waits_and_the_last_report_arrives(tmp_path: Path) -> None:
    with ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE, LINKS, max_rate=0.2) as viewer:
        viewer.offer(report(0))
        for k in range(1, 50):
            viewer.offer(report(k))
        assert viewer.sent == 1
        viewer.flush()
        viewer.flush()  # nothing waits any more
        assert viewer.sent == 2
        viewer.offer(report(50))
        assert viewer.sent == 2
        assert viewer.close(timeout=30.0)
    assert viewer.sent == 3
    assert last_stamp(tmp_path / "out.rrd") == T0 + 50 * PERIOD


def test_a_caller_that_ends_leaves_the_viewer_to_write_on_but_not_a_stopped_one(tmp_path: Path) -> None:
    viewer = ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE)
    viewer.send(report(3))
    viewer.leave(0.0)  # it has hardly been started
    status = Path(f"/proc/{viewer.pid}/status")
    assert wait_until(lambda: not status.exists() or "\nState:\tZ" in status.read_text())
    assert viewer.close() is True
    assert last_stamp(tmp_path / "out.rrd") == T0 + 3 * PERIOD
    stopped = ViewerProcess(tmp_path / "stopped.rrd", {"cable": CABLE}, SCENE)
    os.kill(stopped.pid, signal.SIGSTOP)
    assert wait_until(lambda: "\nState:\tT" in Path(f"/proc/{stopped.pid}/status").read_text())
    assert stopped.leave(0.0)
    assert stopped.ended
