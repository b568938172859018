"""Replay of a harness: as many poses as ends are held, a shape and a row of the report a segment."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path

import numpy as np
import pytest
from recordings import BEGIN, PERIOD, Entry, joints_entry, markers_entry, pose_entry, write_bag
from replays import messages, report_of

import cable_shape as cs
from cable_shape.command.cli import main
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.replay.outcome import Outcome
from cable_shape.replay.run import replay
from cable_shape.replay.settings import Settings
from cable_shape.robots.robot import Robot

ROOT = Path(__file__).resolve().parents[2]
ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
HARNESS = textwrap.dedent("""
    segments:
      a: {length: 0.6, linear_density: 0.1, bending_stiffness: 0.01, diameter: 0.008, max_tension: 0.1}
      b: {length: 0.6, linear_density: 0.1, bending_stiffness: 0.01, diameter: 0.006}
      c: {length: 0.3, linear_density: 0.05, bending_stiffness: 0.005, diameter: 0.004}
    junctions:
      - {name: fork, ends: [a.end, b.start, c.start], frames: {c.start: {quaternion: [0.0, 0.479426, 0.0, 0.877583]}}}
""")
FRAMES = 12


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "h.yaml"
    path.write_text(HARNESS)
    return path


def places(k: int) -> dict[str, tuple[float, float, float]]:
    """Of the ends at frame k of the motion."""
    return {"a.start": (0.0, 0.0, 0.5), "b.end": (0.8 + 0.002 * k, 0.1, 0.5), "c.end": (0.6, 0.05, 0.3 + 0.001 * k)}


def motion(ends: str, folder: str = "/h") -> list[Entry]:
    """Poses of these ends, each stamped one millisecond after the one before."""
    return [
        pose_entry(f"{folder}/{end.replace('.', '_')}/pose", BEGIN + k * PERIOD + i * 1_000_000, places(k)[end], ALONG)
        for k in range(FRAMES)
        for i, end in enumerate(ends.split())
    ]


def run(bag: Path, out: Path, file: Path, **options: object) -> Outcome:
    given = {"points": 60, "rrd": False, "picture": False, "harness": HarnessFile.from_yaml(file), **options}
    return replay(bag, out, Settings(**given))


@pytest.mark.parametrize("ends", ["a.start b.end c.end", "a.start b.end"])
def test_poses_of_all_held_ends_become_a_shape_of_each_segment(tmp_path: Path, file: Path, ends: str) -> None:
    bag = write_bag(tmp_path / "bag", motion(ends))
    floor = cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, 0.2)))
    run(bag, tmp_path / "out", file, held_ends=tuple(ends.split()), scene=cs.Scene(obstacles=[floor]), picture=True)
    shapes = messages(tmp_path / "out", "/cable/shape")
    harness = cs.Harness.from_yaml(file)
    assert [(time, message.cable_id) for time, message in shapes] == [
        (BEGIN + k * PERIOD, f"h/{name}") for k in range(FRAMES) for name in harness.segments
    ]
    for k in range(FRAMES):
        held = {end: cs.Pose(places(k)[end], ALONG) for end in ends.split()}
        alone = cs.predict(harness, held, points=60)
        for i, shape in enumerate(alone.segments.values()):
            message = shapes[3 * k + i][1]
            np.testing.assert_allclose(message.positions.reshape(-1, 3), shape.positions, atol=2e-5)
            assert message.usable
    report = report_of(tmp_path / "out")
    assert report["harness"]["name"] == "h"
    assert report["settings"]["held_ends"] == dict.fromkeys(ends.split(), "clamped")
    assert report["replay"]["status"] == {"OK": FRAMES}
    assert set(report["replay"]["parts"]) == {"h/a", "h/b", "h/c"}
    nearest = report["replay"]["closest_approach"]
    approaches = {name: part["closest_approach"]["distance"] for name, part in report["replay"]["parts"].items()}
    assert nearest["body"] == "floor"
    assert nearest["distance"] == approaches[nearest["cable_id"]] == min(approaches.values())
    assert {w["cable_id"] for w in report["replay"]["warnings"] if w["kind"] == "TENSION"} == {"h/a"}
    page = (tmp_path / "out" / "report.md").read_text()
    assert "| h/c | " in page
    assert "h/a: TENSION" in page
    assert (tmp_path / "out" / "report.png").read_bytes().startswith(b"\x89PNG")


def test_two_runs_give_the_same_bytes(tmp_path: Path, file: Path) -> None:
    bag = write_bag(tmp_path / "bag", motion("a.start b.end c.end"))
    for name in ("one", "two"):
        run(bag, tmp_path / name, file, rrd=True)
    one, two = ((tmp_path / name / "replay" / "replay.mcap").read_bytes() for name in ("one", "two"))
    assert one == two
    assert (tmp_path / "one" / "replay.rrd").stat().st_size > 10_000


@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_a_harness_that_swings_takes_the_steps_of_its_motion(tmp_path: Path, file: Path, contact: str) -> None:
    bag = write_bag(tmp_path / "bag", motion("a.start b.end"))
    floor = cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, 0.24)))
    scene = cs.Scene(obstacles=[floor], contact=contact)  # type: ignore[arg-type]
    for name in ("one", "two"):
        run(bag, tmp_path / name, file, held_ends=("a.start", "b.end"), motion="dynamic", scene=scene)
    one, two = ((tmp_path / name / "replay" / "replay.mcap").read_bytes() for name in ("one", "two"))
    assert one == two
    swings, most = cs.Motion(cs.Harness.from_yaml(file), scene, points=60), 0.0
    shapes = messages(tmp_path / "one", "/cable/shape")
    assert len(shapes) == 3 * FRAMES
    for k in range(FRAMES):
        held = {end: cs.Pose(places(k)[end], ALONG) for end in ("a.start", "b.end")}
        shape = swings.begin(held) if k == 0 else swings.step(held, 1e-9 * PERIOD)
        still = cs.predict(swings.harness, held, points=60, scene=scene)
        assert bool(shape.segments["c"].contacts) == (contact == "solve")
        for i, (name, part) in enumerate(shape.segments.items()):
            message = shapes[3 * k + i][1]
            np.testing.assert_allclose(message.positions.reshape(-1, 3), part.positions, atol=1e-6)
            most = max(most, float(np.abs(part.positions - still.segments[name].positions).max()))
    assert most > 1e-3  # it swings


def test_the_grippers_of_a_robot_hold_two_ends(tmp_path: Path, file: Path) -> None:
    robot = Robot.from_yaml(ROOT / "config/robots/dual_arm.yaml")
    bag = write_bag(tmp_path / "bag", [joints_entry(BEGIN, robot.joint_names, robot.home)])
    run(bag, tmp_path / "out", file, robot=robot, held_ends=("a.start", "b.end"))
    left, right = robot.grips(robot.home)
    alone = cs.predict(cs.Harness.from_yaml(file), {"a.start": left, "b.end": right}, points=60)
    for _, message in messages(tmp_path / "out", "/cable/shape"):
        shape = alone.segments[message.cable_id.removeprefix("h/")]
        np.testing.assert_allclose(message.positions.reshape(-1, 3), shape.positions, atol=2e-5)
    assert report_of(tmp_path / "out")["settings"]["grips_in_words"].startswith("a.start as the robot's file says")
    with pytest.raises(cs.ArgumentError, match=r"held_ends = \['a.start', 'b.end', 'c.end'\] .* Name 2 ends"):
        run(bag, tmp_path / "out", file, robot=robot)


def test_the_command_line_replays_a_harness(tmp_path: Path, file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Ends as the file says, and topics as they were recorded."""
    file.write_text(HARNESS + "ends: {a.start: {kind: swivel}, b.end: {}, c.end: {mass: 0.02}}\n")
    entries = [*motion("a.start", "/cell"), *motion("a.start b.end")]
    bag = write_bag(tmp_path / "bag", sorted(entries, key=lambda entry: entry.log_time))
    options = ["--harness", str(file), "--end-topic", "a.start=/cell/a_start/pose", "--points", "60"]
    assert main(["replay", str(bag), "-o", str(tmp_path / "out"), *options, "--no-rrd", "--no-picture"]) == 0
    told = capsys.readouterr().out
    assert "a.start swivel; b.end clamped" in told
    assert f"OK {FRAMES}" in told
    report = report_of(tmp_path / "out")
    assert set(report["recording"]["topics"]) == {"/cell/a_start/pose", "/h/b_end/pose"}
    held = {"a.start": cs.Grip(cs.Pose(places(0)["a.start"], ALONG), "swivel"), "c.end": cs.FreeEnd(mass=0.02)}
    alone = cs.predict(cs.Harness.from_yaml(file), {**held, "b.end": cs.Pose(places(0)["b.end"], ALONG)}, points=60)
    _, message = messages(tmp_path / "out", "/cable/shape")[2]
    np.testing.assert_allclose(message.positions.reshape(-1, 3), alone.segments["c"].positions, atol=2e-5)


SEEN = {"a+b": (0.0, 0.25, 0.55, 0.8, 1.1, 1.2), "c": (0.1, 0.2, 0.3)}
SWAY = np.array((0.0, 1.5, 0.0))  # m/s^2


def swaying(file: Path, counts: int = 9) -> list[Entry]:
    """Poses and markers of a harness that is accelerated evenly: in its own frame it is at rest."""
    harness, held = cs.Harness.from_yaml(file), ("a.start", "b.end", "c.end")
    ends = {end: cs.Pose(places(0)[end], ALONG) for end in held}
    shape = cs.predict(harness, ends, points=601, acceleration=dict.fromkeys(harness.segments, SWAY))
    points = []
    for run, arcs in SEEN.items():
        for s in arcs:
            name, at = ("b", s - 0.6) if run == "a+b" and s > 0.6 else (run[0], s)
            one = shape.segments[name]
            points.append([np.interp(at, one.arc_length, x) for x in one.positions.T])
    entries = []
    for k in range(40):
        stamp, way = BEGIN + 10_000_000 * k, 0.5 * SWAY * (0.01 * k) ** 2
        for end in held:
            topic = f"/h/{end.replace('.', '_')}/pose"
            entries.append(pose_entry(topic, stamp, tuple(places(0)[end] + way), ALONG))
        entries.append(markers_entry(stamp, (np.array(points) + way)[:counts]))
    return entries


def test_markers_are_compared_with_their_segments_and_their_motion_loads_them(tmp_path: Path, file: Path) -> None:
    bag = write_bag(tmp_path / "bag", swaying(file))
    file.write_text(HARNESS + f"markers: {{a+b: {list(SEEN['a+b'])}, c: {list(SEEN['c'])}}}\n")
    known = cs.Uncertainty({"bending_stiffness": 0.1}, misses=0.05)
    still = run(bag, tmp_path / "still", file, uncertainty=known)
    moving = run(bag, tmp_path / "moving", file, inertia=True, rrd=True, points=150)
    assert still.markers is not None
    assert moving.markers is not None
    figures = [outcome.markers.figures() for outcome in (still, moving)]
    assert [found.distances for found in figures] == [40 * 6] * 2  # three of the nine sit at grips
    assert figures[0].with_tube == 240
    assert 0.0 < figures[0].inside < 1.0
    assert moving.inertia.cycles == 40
    assert figures[0].worst > 2e-3
    assert figures[1].worst < 0.1 * figures[0].worst
    report = report_of(tmp_path / "moving")
    assert report["markers"]["frames_compared"] == 40
    assert report["inertia"]["cycles"] == 40


def test_another_number_of_markers_than_the_file_tells_is_refused(tmp_path: Path, file: Path) -> None:
    bag = write_bag(tmp_path / "bag", swaying(file, counts=8))
    file.write_text(HARNESS + f"markers: {{a+b: {list(SEEN['a+b'])}, c: {list(SEEN['c'])}}}\n")
    outcome = run(bag, tmp_path / "out", file)
    (refused,) = outcome.refusals
    assert (refused.count, refused.reason) == (40, "other number")
    assert refused.example == "8 markers came, the harness's file tells of 9"
    for markers, told in (
        ("{d: [0.1]}", "markers.d: unknown key 'd'"),
        ("{c: [0.4]}", r"markers.c = \[0.4\] .* arc lengths from 0 to 0.3 m"),
        ("[0.1]", "must be a mapping|Mapping"),
    ):
        file.write_text(HARNESS + f"markers: {markers}\n")
        with pytest.raises(cs.ArgumentError, match=told):
            HarnessFile.from_yaml(file)
    file.write_text(HARNESS + "markers: {c: [0.1]}\n")
    read = HarnessFile.from_yaml(file)
    assert HarnessFile.from_mapping(read.as_dict()).markers == read.markers == {"c": (0.1,)}


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--cable", "c.yaml"], "--cable: it is not for a harness. Leave it out"),
        (["--start-kind", "swivel"], "--start-kind: it is not for a harness. Leave it out; the key `ends`"),
        (["--held-ends", "a.end"], "ends = 'a.end' is not allowed: it is in junction 'fork'"),
        (["--end-topic", "a.start"], "--end-topic = 'a.start' is not allowed: it must be END=TOPIC"),
        (
            ["--held-ends", "a.start,b.end", "--end-topic", "c.end=/c"],
            "this end is not held. Held are: a.start, b.end.",
        ),
        (["--inertia"], "inertia = True is not allowed: the harness's file does not say where its markers are"),
        (["--held-ends", "a.start,b.end", "--model", "catenary"], "model = 'catenary' is not allowed"),
        ([], "has no topic /h/c_end/pose. Only these grippers were recorded: /h/a_start/pose, /h/b_end/pose."),
    ],
)
def test_what_a_harness_does_not_go_with(
    tmp_path: Path, file: Path, options: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag", motion("a.start b.end"))
    assert main(["replay", str(bag), "-o", str(tmp_path / "out"), "--harness", str(file), *options]) == 2
    assert told in capsys.readouterr().err
    cable = tmp_path / "c.yaml"
    cable.write_text("length: 1.0\nlinear_density: 0.1\nbending_stiffness: 0.01\n")
    assert main(["replay", str(bag), "-o", str(tmp_path / "out"), "--cable", str(cable), "--held-ends", "a.start"]) == 2
    assert "Give --harness." in capsys.readouterr().err
