"""The process that shows cycles never disturbs its caller."""

from __future__ import annotations

import dataclasses
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from reports import (
    BESIDE,
    CABLE,
    LINKS,
    PERIOD,
    ROOT,
    SCENE,
    T0,
    columns,
    gone,
    last_stamp,
    report,
    wait_until,
)

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.cable.junction import Junction
from cable_shape.cycle.cycle import Cycle
from cable_shape.errors import ArgumentError
from cable_shape.pose import Pose
from cable_shape.prediction.layout import Layout
from cable_shape.safety.report import CycleReport
from cable_shape.scene.scene import Scene
from cable_shape.viewer.process import ViewerProcess


def test_last_of_many_reports_arrives(tmp_path: Path) -> None:
    with ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE, LINKS) as viewer:
        assert all(viewer.send(report(k)) for k in range(1000))
        assert wait_until(lambda: viewer.shown >= 1)
        assert viewer.close(timeout=120.0)
    assert (viewer.sent, viewer.dropped) == (1000, 0)
    assert 1 <= viewer.shown < 1000
    assert last_stamp(tmp_path / "out.rrd") == T0 + 999 * PERIOD


def test_every_report_is_shown_when_they_come_slowly(tmp_path: Path) -> None:
    robot = ROOT / "config" / "robots" / "dual_arm.yaml"
    with ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE, robot, max_rate=1000.0) as viewer:
        for k in range(5):
            assert viewer.send(report(k))
            assert wait_until(lambda k=k: viewer.shown == k + 1)
        assert viewer.close(timeout=120.0)
    held = columns(tmp_path / "out.rrd")
    assert len(held["/plots/tension/cable:Scalars:scalars"]) == 5
    assert any(name.startswith("/world/robot/left_forearm/") for name in held)


def test_what_was_edited_is_drawn_with_the_next_report(tmp_path: Path) -> None:
    """Also where the process has overlooked an edit before it."""
    moved = dataclasses.replace(SCENE.obstacles[0], pose=Pose((0.0, 0.0, 2.0)))
    with ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE, LINKS, max_rate=1000.0) as viewer:
        assert viewer.send(report(0))
        assert wait_until(lambda: viewer.shown == 1)
        for scene in (Scene(), Scene(obstacles=[moved])):
            assert viewer.edited(Layout.of(scene, {"cable": CABLE}, {}))
        assert viewer.send(report(1))
        assert viewer.close(timeout=120.0)
        assert not viewer.edited(Layout.of(Scene(), {"cable": CABLE}, {}))
    places = columns(tmp_path / "out.rrd")[f"/world/obstacles/{moved.name}:Transform3D:translation"]
    assert [t for t, _ in places] == [T0, T0 + PERIOD]
    assert places[1][1] == [pytest.approx(moved.pose.position)]


def test_a_harness_is_handed_over_as_a_cycle_reports_it(tmp_path: Path) -> None:
    along = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
    cable = Cable(length=0.5, linear_density=0.1, bending_stiffness=0.01)
    harness = Harness({"a": cable, "b": cable}, [Junction("middle", ("a.end", "b.start"))])
    ends = {"a.start": Pose((0.0, 0.0, 0.0), along), "b.end": Pose((0.9, 0.0, 0.0), along)}
    seen = Cycle({"h": harness}).step({"h": ends}, stamp=T0)
    with ViewerProcess(tmp_path / "out.rrd", {"h": harness}, Scene()) as viewer:
        assert viewer.send(seen)
        assert viewer.close(timeout=120.0)
    held = columns(tmp_path / "out.rrd")
    ((_, place),) = held["/world/harnesses/h/middle:Transform3D:translation"]
    assert place == [pytest.approx(seen.shapes["h"].junctions["middle"].position, abs=1e-6)]
    assert "/world/cables/h/b/line:LineStrips3D:strips" in held


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
        assert viewer.close(timeout=600.0) is False
        assert time.monotonic() - began < 300.0, "it does not wait for one that has ended"
    assert viewer.close() is False
    assert viewer.send(report(9)) is False


def test_stopped_viewer_is_ended_within_the_time_given(tmp_path: Path) -> None:
    viewer = ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE)
    os.kill(viewer.pid, signal.SIGSTOP)
    for k in range(70_000):  # more wake-ups than the pipe holds: still no waiting
        assert viewer.send(report(0) if k == 0 else _SMALL)
    began = time.monotonic()
    assert viewer.close(timeout=0.2) is False
    assert time.monotonic() - began < 60.0


_SMALL = CycleReport(T0, {}, None, {}, {}, ())


def test_caller_imports_no_rerun_and_when_it_dies_leaves_a_whole_recording(tmp_path: Path) -> None:
    code = (
        "import os, sys; import reports as t\n"
        "from cable_shape.viewer.process import ViewerProcess\n"
        "viewer = ViewerProcess(sys.argv[1], {'cable': t.CABLE}, t.SCENE)\n"
        "viewer.send(t.report(7))\n"
        "print(viewer.pid, *({'rerun', 'pinocchio', 'rclpy'} & set(sys.modules)), flush=True)\n"
        "os.kill(os.getpid(), 9)"
    )
    path = tmp_path / "out.rrd"
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True, timeout=300, check=False, env=BESIDE
    )
    assert done.returncode == -signal.SIGKILL
    assert wait_until(lambda: gone(int(done.stdout)))
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


def test_what_is_offered_too_soon_waits_and_the_last_report_arrives(tmp_path: Path) -> None:
    with ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE, LINKS, max_rate=0.1) as viewer:
        viewer.offer(report(0))
        for k in range(1, 50):
            viewer.offer(report(k))
        assert viewer.sent == 1
        viewer.flush()
        viewer.flush()  # nothing waits any more
        assert viewer.sent == 2
        viewer.offer(report(50))
        assert viewer.sent == 2
        assert viewer.close(timeout=120.0)
    assert viewer.sent == 3
    assert last_stamp(tmp_path / "out.rrd") == T0 + 50 * PERIOD


def test_a_caller_that_ends_leaves_the_viewer_to_write_on_but_not_a_stopped_one(tmp_path: Path) -> None:
    viewer = ViewerProcess(tmp_path / "out.rrd", {"cable": CABLE}, SCENE)
    viewer.send(report(3))
    viewer.leave(0.0)  # it has hardly been started
    assert wait_until(lambda: gone(viewer.pid))
    assert viewer.close() is True
    assert last_stamp(tmp_path / "out.rrd") == T0 + 3 * PERIOD
    stopped = ViewerProcess(tmp_path / "stopped.rrd", {"cable": CABLE}, SCENE)
    os.kill(stopped.pid, signal.SIGSTOP)
    assert wait_until(lambda: "\nState:\tT" in Path(f"/proc/{stopped.pid}/status").read_text())
    stopped.leave(0.0)
    assert wait_until(lambda: stopped.ended)
