"""What a recording of the viewer holds."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from reports import (
    BESIDE,
    CABLE,
    PERIOD,
    POINTS,
    RADIUS,
    SCENE,
    T0,
    arc,
    columns,
    near_a_snap,
    report,
    write,
)

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.cable.junction import Junction
from cable_shape.cycle.cycle import Cycle
from cable_shape.cycle.parts import in_parts
from cable_shape.pose import FreeEnd, Pose
from cable_shape.prediction.layout import Layout
from cable_shape.prediction.predictor import predict
from cable_shape.safety.report import Clearance, CycleReport
from cable_shape.scene.scene import Allow, Box, Clip, HalfSpace, HeightField, Obstacle, PointMass, Points, Scene, Sphere
from cable_shape.shape import Status
from cable_shape.viewer.entities import ReportLogger
from cable_shape.viewer.letters import decode, encode
from cable_shape.viewer.recording import RecordingWriter, new_recording


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


def test_what_stands_still_is_written_once_and_links_for_ever(recorded: dict[str, list[tuple[object, object]]]) -> None:
    for entity, component in (
        ("box", "Boxes3D:half_sizes"),
        ("sphere", "Ellipsoids3D:half_sizes"),
        ("rod\\ of\\ steel", "Cylinders3D:radii"),
        ("pipe", "Capsules3D:radii"),
        ("part", "Mesh3D:vertex_positions"),
        ("table", "Boxes3D:half_sizes"),
    ):
        rows = recorded[f"/world/obstacles/{entity}:{component}"]
        assert [t for t, _ in rows] == [T0], entity
    assert recorded["/world/obstacles/box:Boxes3D:half_sizes"][0][1] == [pytest.approx([0.05, 0.05, 0.05])]
    assert recorded["/world/robot/wrist/hand:Boxes3D:half_sizes"][0][0] is None
    assert recorded["/world/cables/cable/clips/0:Transform3D:translation"][0][1] == [pytest.approx([0.1, 0.0, 0.4])]


def test_bodies_and_clips_are_drawn_as_edits_have_left_them(tmp_path: Path) -> None:
    """What has moved is told where it is, what has gone is cleared, what is another is drawn anew; nothing else is."""
    before = Scene(
        [Obstacle("stays", Sphere(0.02)), Obstacle("moves", Sphere(0.03)), Obstacle("goes", Sphere(0.04))],
        clips=[Clip(0.2, Pose((0.2, 0.0, 0.4)), name="first"), Clip(0.3, Pose((0.3, 0.0, 0.4)), name="second")],
    )
    after = Scene(
        [Obstacle("stays", Sphere(0.02)), Obstacle("moves", Sphere(0.03), Pose((0.5, 0.0, 0.0)))],
        clips=[Clip(0.3, Pose((0.3, 0.0, 0.4)), name="second")],
    )
    last = after.replace(obstacles=[Obstacle("moves", Box((0.1, 0.1, 0.1)))], clips=())
    for later in (True, False):
        path = tmp_path / f"{later}.rrd"
        recording = new_recording(path)
        logger = ReportLogger(recording, {"cable": CABLE}, before, later=later)
        for k, scene in enumerate((None, None, after, last)):
            if scene is not None:
                logger.edited(Layout.of(scene, {"cable": CABLE.replace(diameter=0.02)}, {}))
            logger.log(report(k))
        logger.flush()
        recording.flush()
        recording.disconnect()
        held, at = columns(path), [T0 + k * PERIOD for k in range(4)]

        def times(entity: str, component: str, held: dict[str, Any] = held) -> list[object]:
            return [
                t for name, rows in held.items() if name.startswith(f"/world/{entity}:{component}") for t, _ in rows
            ]

        assert times("obstacles/stays", "Ellipsoids3D:half_sizes") == at[:1]
        assert times("obstacles/stays", "Clear") == at[3:]
        assert times("obstacles/moves", "Transform3D:translation") == [at[0], at[2], at[3]]
        assert times("obstacles/moves", "Ellipsoids3D:half_sizes") == at[:1]
        assert times("obstacles/moves", "Boxes3D:half_sizes") == at[3:]
        assert times("obstacles/moves", "Clear") == at[3:]
        assert times("obstacles/goes", "Clear") == at[2:3]
        places = held["/world/cables/cable/clips/0:Transform3D:translation"]
        assert [t for t, _ in places] == [at[0], at[2]], "the second clip is the first one now"
        assert [row[0][0] for _, row in places] == pytest.approx([0.2, 0.3])
        assert times("cables/cable/clips/0", "Clear") == [at[2], at[3]], "drawn as wide as the cable is now, and gone"
        assert times("cables/cable/clips/1", "Clear") == at[2:3]


def test_what_is_on_a_link_moves_with_it(tmp_path: Path) -> None:
    """Clips and bodies of a scene hang below the link, whose place is written when it moves."""
    clip, body = Clip(0.2, Pose((0.1, 0.0, 0.4)), link="wrist"), Obstacle("camera", Sphere(0.02), link="wrist")
    scene = Scene(obstacles=[body], clips=[clip, Clip(0.3, Pose((0.2, 0.0, 0.4)))])
    reports = [dataclasses.replace(report(k), links={"wrist": Pose((0.0, 0.0, 0.1 * k))}) for k in range(2)]
    with RecordingWriter(tmp_path / "out.rrd", {"cable": CABLE}, scene) as writer:
        for one in reports:
            writer.log(one)
    held = columns(tmp_path / "out.rrd")
    assert held["/world/robot/wrist/cable/clips/0:Transform3D:translation"][0][1] == [pytest.approx([0.1, 0.0, 0.4])]
    assert "/world/cables/cable/clips/1:Transform3D:translation" in held
    assert "/world/cables/cable/clips/0:Transform3D:translation" not in held
    assert "/world/robot/wrist/camera:Ellipsoids3D:half_sizes" in held
    heights = [rows[0][2] for _, rows in held["/world/robot/wrist:Transform3D:translation"]]
    assert heights == pytest.approx([0.0, 0.1])


def test_a_harness_is_shown_segment_by_segment_with_its_junctions(tmp_path: Path) -> None:
    """Written by itself, and as it comes out of a letter to the viewer's process."""
    along = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
    cable = Cable(length=0.5, linear_density=0.1, bending_stiffness=0.01)
    fork = Junction("fork", ("a.end", "b.start", "c.start"), frames={"a.end": Pose((0.0, 0.0, -0.01))})
    harness = Harness({"a": cable, "b": cable, "c": cable}, [fork])
    scene = Scene(clips=[Clip(0.25, Pose((0.24, 0.0, 0.0)), segment="a")], masses=[PointMass(0.2, 0.01, segment="c")])
    cycle = Cycle({"h": harness}, scene=scene)
    ends = {"a.start": Pose((0.0, 0.0, 0.0), along), "b.end": Pose((0.9, 0.0, 0.0), along), "c.end": FreeEnd(mass=0.02)}
    seen = cycle.step({"h": ends}, stamp=T0)
    held = []
    for name, one in (("own", seen), ("letter", decode(encode(in_parts(seen))))):
        with RecordingWriter(tmp_path / f"{name}.rrd", {"h": harness}, scene) as writer:
            writer.log(one)
        held.append(columns(tmp_path / f"{name}.rrd"))
    assert held[0] == held[1]
    for segment, shape in seen.shapes["h"].segments.items():
        strips = np.array(held[0][f"/world/cables/h/{segment}/line:LineStrips3D:strips"][0][1])
        np.testing.assert_allclose(strips[:, 0], shape.positions[:-1], atol=1e-6)
        assert (f"/world/cables/h/{segment}/clips/0:Points3D:radii" in held[0]) == (segment == "a")
        assert (f"/world/cables/h/{segment}/masses:Points3D:radii" in held[0]) == (segment == "c")
    ((stamp, place),) = held[0]["/world/harnesses/h/fork:Transform3D:translation"]
    assert stamp == T0
    assert place == [pytest.approx(seen.shapes["h"].junctions["fork"].position, abs=1e-6)]
    assert len(held[0]["/world/cables/h/a/start/axes:Arrows3D:vectors"][0][1]) == 3
    assert held[0]["/world/cables/h/c/end/ball:Points3D:positions"], "the connector at the free end"
    assert "/world/cables/h/b/start/ball:Points3D:positions" not in held[0], "a junction is no grip"
    assert "**h/b**" in held[0]["/state:TextDocument:text"][0][1][0]


def test_warnings_are_told_when_they_begin_and_end(recorded: dict[str, list[tuple[object, object]]]) -> None:
    told = [(t, v[0]) for t, v in recorded["/warnings:TextLog:text"]]
    assert told == [(T0 + 3 * PERIOD, "29.0 mm to box"), (T0 + 6 * PERIOD, "cable: clearance to box is over")]
    assert [v[0] for _, v in recorded["/warnings:TextLog:level"]] == ["WARN", "INFO"]


def test_a_long_warning_is_told_whole_in_rows_that_the_log_has_room_for(tmp_path: Path) -> None:
    text = "cable: 28.9 mm from 'post' at 0.240 m from the start grip (warning below 30.0 mm). Keep away from it."
    near = report(3)
    write(
        tmp_path / "out.rrd", [dataclasses.replace(near, warnings=(dataclasses.replace(near.warnings[0], text=text),))]
    )
    rows = [v[0] for _, v in columns(tmp_path / "out.rrd")["/warnings:TextLog:text"]]
    assert " ".join(rows) == text
    assert max(map(len, rows)) <= 52


def test_two_runs_decode_to_the_same_columns(tmp_path: Path) -> None:
    """The second run takes other times, and another process with another hash seed."""
    write(tmp_path / "a.rrd", [report(k) for k in range(6)])
    code = (
        "import sys, time, dataclasses; from pathlib import Path; import reports as t\n"
        "reports = [dataclasses.replace(t.report(k), times={'total': time.perf_counter()}) for k in range(6)]\n"
        "t.write(Path(sys.argv[1]), reports)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "b.rrd")], check=True, timeout=300, env=BESIDE)
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
    columns = Mock()
    drawn = Forces("/forces", cable)
    drawn.write(shape, columns)
    assert columns.put.call_args.args[1].__name__ == "Arrows3D"
    assert columns.put.call_args.kwargs["labels"] == [f"{np.linalg.norm(forces[0]):.2g} N"]
    for _ in range(2):
        drawn.write(predict(cable, *grips), columns)
    ((_, gone),) = (call.args for call in columns.write.call_args_list)
    assert type(gone).__name__ == "Clear"
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


def test_speed_and_a_trail_that_fades_are_drawn_of_a_cable_that_swings(tmp_path: Path) -> None:
    from cable_shape.viewer.swing import SECONDS, TRAIL, Swing  # here: this module must not import rerun

    along = (0.5, 0.5, 0.5, 0.5)
    cycle = Cycle(CABLE, motion="dynamic", points=41)
    reports = []
    for k in range(60):
        y = 0.004 * min(k, 40)
        grips = Pose((0.0, y, 1.0), along), Pose((0.7 * CABLE.length, y, 1.0), along)
        reports.append(cycle.step({"cable": grips}, 10_000_000 * k))
    shape = reports[30].shapes["cable"]
    got = decode(encode(reports[30])).shapes["cable"]
    np.testing.assert_array_equal(got.velocity, shape.velocity)
    swing, put = Swing("/cable"), Mock()
    for told in reports[:31]:
        swing.write(told.shapes["cable"], CABLE.diameter, told.stamp, put)
    speed, trail = (call.kwargs for call in put.put.call_args_list[-2:])
    at = np.abs(shape.positions[:, None] - speed["origins"]).sum(axis=2).argmin(axis=0)
    np.testing.assert_allclose(speed["vectors"], SECONDS * shape.velocity[at])
    assert trail["strips"].shape == (TRAIL, 41, 3)
    assert (np.diff(trail["colors"][:, 3].astype(int)) > 0).all()
    np.testing.assert_allclose(np.diff(trail["strips"][:, 0, 1]), 0.016, atol=1e-6)  # the newest is the last
    swing.write(shape, CABLE.diameter, reports[0].stamp, put)  # a bag that begins again
    assert len(put.put.call_args.kwargs["strips"]) == 1
    for _ in range(2):
        swing.write(predict(CABLE, *grips), CABLE.diameter, 10_000_000_000, put)
    assert [type(call.args[1]).__name__ for call in put.write.call_args_list] == ["Clear", "Clear"]
    path = tmp_path / "swing.rrd"
    with RecordingWriter(path, cycle.cables, Scene()) as writer:
        for told in reports:
            writer.log(told)
    held = columns(path)
    assert {"/world/cables/cable/speed", "/world/cables/cable/trail"} <= {name.partition(":")[0] for name in held}
    assert "speed" in str(held["/state:TextDocument:text"][-1])


def test_margins_are_bars_that_go_when_there_is_no_margin_any_more(tmp_path: Path) -> None:
    from cable_shape.viewer.bars import AT_LIMIT  # here: this module must not import rerun

    write(tmp_path / "out.rrd", [near_a_snap(k) for k in range(5)] + [report(5)])
    held = columns(tmp_path / "out.rrd")
    bars, names = held["/margins/bars:LineStrips2D:strips"], held["/margins/names:Points2D:labels"]
    assert [t for t, _ in bars] == [T0 + k * PERIOD for k in range(6)]
    # the nearest body uses 0, 0.2, ... of its limit, the tension three times its own; the last report knows no margin
    reach = [[end[0] + radius for (_, end), radius in zip(v, r, strict=True)] for (_, v), (_, r) in zip(
        bars, held["/margins/bars:LineStrips2D:radii"], strict=True
    )]  # fmt: skip
    np.testing.assert_allclose(reach[:5], [[0.2 * k * AT_LIMIT, 2.0 * AT_LIMIT] for k in range(5)], atol=1e-5)
    assert reach[5] == []
    assert names[3][1] == ["clearance to box 60 %", "stretch 300 %"]
    assert held["/margins/limit:LineStrips2D:strips"][0][0] is None


def test_bars_of_many_cables_are_of_the_worst(tmp_path: Path) -> None:
    from cable_shape.viewer.recording import RecordingWriter

    one = near_a_snap(2)
    names = [f"h/s{k}" for k in range(22)]
    worst = one.margins["cable"][0]._replace(used=0.7)
    margins = dict.fromkeys(names, one.margins["cable"]) | {"h/s7": (worst,)}
    many = dataclasses.replace(
        one, shapes=dict.fromkeys(names, one.shapes["cable"]), margins=margins, grips={}, clearance={}
    )
    with RecordingWriter(tmp_path / "out.rrd", dict.fromkeys(names, CABLE), SCENE) as writer:
        writer.log(many)
    ((_, said),) = columns(tmp_path / "out.rrd")["/margins/names:Points2D:labels"]
    assert said == ["h/s7 clearance to sph… 70 %", "h/s0 stretch 300 %"]


def test_the_number_of_a_bar_with_a_long_name_is_seen(tmp_path: Path) -> None:
    long = near_a_snap(2).margins["cable"][0]._replace(other="right_finger_of_the_gripper", used=-1.62)
    write(tmp_path / "out.rrd", [dataclasses.replace(near_a_snap(2), margins={"cable": (long,)})])
    ((_, said),) = columns(tmp_path / "out.rrd")["/margins/names:Points2D:labels"]
    assert said == ["clearance to right_… -162 %"]


def test_what_may_be_touched_is_neither_the_closest_nor_plotted_as_clearance(tmp_path: Path) -> None:
    """Of a body that a stretch of the cable may touch the rest still counts."""
    for name, allow in (("all", Allow("box")), ("stretch", Allow("box", 0.0, 0.1))):
        scene = SCENE.replace(allow=[allow])
        with RecordingWriter(tmp_path / f"{name}.rrd", {"cable": CABLE}, scene) as writer:
            writer.log(report(2))
        held = columns(tmp_path / f"{name}.rrd")
        labels = held.get("/world/cables/cable/closest/line:LineStrips3D:labels", [])
        plotted = [v[0] for _, v in held.get("/plots/clearance/cable:Scalars:scalars", [])]
        nearest = [body for body in report(2).clearance["cable"].bodies if name == "stretch" or body.body != "box"]
        if nearest:
            least = min(nearest, key=lambda body: body.distance)
            assert labels[0][1][0].startswith(least.body), name
            assert plotted == pytest.approx([1e3 * least.distance])
        else:
            assert labels == []
            assert plotted == [], "the others are beyond all that is looked at"


def test_the_closest_pair_is_of_a_body_that_the_cable_does_not_rest_on(tmp_path: Path) -> None:
    cable = Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
    posts = [Obstacle(f"post{side}", Sphere(0.02), Pose((0.4, 0.1 * side, 0.82))) for side in (-1, 1)]
    scene = Scene(obstacles=[Obstacle("table", HalfSpace(), Pose((0, 0, 0.8))), *posts], contact="solve")
    grips = Pose((0, 0, 1), (0.5, 0.5, 0.5, 0.5)), Pose((0.8, 0, 1), (0.5, 0.5, 0.5, 0.5))
    cycle = Cycle(cable, scene=scene)
    said = cycle.step({"cable": grips}, stamp=T0)
    assert said.clearance["cable"].closest.body == "table"
    from cable_shape.viewer.recording import RecordingWriter  # here: this module must not import rerun

    with RecordingWriter(tmp_path / "out.rrd", cycle.cables, scene) as writer:
        writer.log(said)
    ((_, label),) = columns(tmp_path / "out.rrd")["/world/cables/cable/closest/line:LineStrips3D:labels"]
    assert label[0].startswith("post")


def test_point_clouds_and_height_fields_are_drawn() -> None:
    import rerun as rr

    from cable_shape.viewer.standing import shown  # here: this module must not import rerun

    colour = (1, 2, 3, 255)
    cloud = shown(Points([(0.0, 0.0, 0.1), (0.0, 0.2, 0.0)], 0.02), colour)
    assert isinstance(cloud, rr.Points3D)
    assert cloud.positions is not None
    assert len(cloud.positions) == 2
    field = shown(HeightField([(0.0, 0.1), (0.2, 0.3), (0.0, 0.0)], 0.05), colour)
    assert isinstance(field, rr.Mesh3D)
    assert field.triangle_indices is not None
    assert len(field.triangle_indices) == 4
