"""Peers that are not trusted: what a locked node refuses, where files are written, and what of a file is told."""

import os
import time

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from harness import values_of
from lifecycle_msgs.srv import ChangeState

CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE, ACTIVE_SHUTDOWN = 1, 2, 3, 4, 7
WARN, ERROR = DiagnosticStatus.WARN, DiagnosticStatus.ERROR
SECRET = "root:$6$hunter2$qwertz:19000:0:99999:7:::"  # noqa: S105, planted where the node must not tell it


def by_label(node, label):
    request = ChangeState.Request()
    request.transition.label = label
    return node.call(ChangeState, "change_state", request).success


def test_a_locked_node_that_was_active_refuses_changes_and_obeys_deactivate_and_shutdown(start):
    node = start(lock="true", autostart="false", active=False, diagnostics_period=0.2)
    assert node.set(max_skew=0.03).successful  # not yet active
    assert node.transition(CONFIGURE)
    assert node.transition(CLEANUP)
    assert node.set(points=20).successful
    assert node.transition(CONFIGURE)
    assert node.transition(ACTIVATE)
    repeats = node.repeats
    for changes in ({"max_skew": 5.0}, {"lock": False}, {"use_sim_time": True}, {"cable_file": "/dev/zero"}):
        result = node.set(**changes)
        assert not result.successful
        assert "locked (parameter lock)" in result.reason or "read-only" in result.reason, result.reason
    assert "a change of 'cable_file' was asked for by a peer and is refused" in result.reason
    assert node.get("max_skew") == 0.03
    node.set(max_skew=5.0)

    def counted():
        return int(values_of(node.diagnosis("lifecycle", ""))["turned away"]) >= 4

    node.until(counted, "four refusals in the diagnostics")
    status = node.diagnosis("lifecycle", "")
    assert 4 <= int(values_of(status)["turned away"]) <= 4 + node.repeats - repeats
    text = "a change of 'max_skew' was asked for by a peer and is refused"
    node.diagnosis("lifecycle", text, WARN, lambda: node.set(max_skew=5.0))
    assert node.transition(DEACTIVATE)
    assert not node.transition(CLEANUP)
    text = "cleanup was asked for by a peer and is refused: the node is locked"
    node.diagnosis("lifecycle", text, WARN, lambda: node.transition(CLEANUP))
    assert not by_label(node, "cleanup")
    assert not by_label(node, "configure")
    assert not node.set(max_skew=5.0).successful
    assert node.state() == "inactive"
    assert node.transition(ACTIVATE)
    assert len(node.predicted().arc_length) == 20
    assert node.transition(ACTIVE_SHUTDOWN)
    assert node.state() == "finalized"
    assert node.process.stop() == 0


def test_lock_and_output_folder_cannot_be_set_by_a_peer(cell):
    for changes in ({"lock": True}, {"output_folder": "/"}):
        result = cell.set(**changes)
        assert not result.successful
        assert "read-only" in result.reason


@pytest.fixture
def idle(start, tmp_path):
    """An unconfigured node that may write below out/."""
    (tmp_path / "out").mkdir()
    return start(output_folder=tmp_path / "out", autostart="false", active=False, diagnostics_period=0.2)


def refused(node, text, **parameters):
    """Configure fails with `text` in the diagnostics, and does not read without end."""
    assert node.set(**parameters).successful
    assert not node.transition(CONFIGURE)
    assert node.state() == "unconfigured"
    return node.diagnosis("lifecycle", text, ERROR)


def test_files_are_written_only_below_the_output_folder_and_over_their_own_kind(idle, tmp_path, cable_file):
    out, outside = tmp_path / "out", tmp_path / "outside"
    outside.mkdir()
    note = out / "note.rrd"
    note.write_text(SECRET)
    cable = out / "mine.yaml"
    cable.write_text(cable_file.read_text())
    (out / "link.rrd").symlink_to(outside / "seen.rrd")
    (out / "away").symlink_to(outside)
    for view in (outside / "seen.rrd", "../outside/seen.rrd", "away/seen.rrd"):
        refused(idle, "files are written only below", view=str(view))
    for view in ("note.rrd", "link.rrd"):
        refused(idle, "something is there that is no rrd file", view=view)
    refused(idle, "it must end in .rrd", view=str(out / "seen.txt"))
    points = {"view": "off", "calibration_points": "seen"}
    refused(idle, "files are written only below", calibration_file=str(outside / "c.yaml"), **points)
    refused(idle, "something is there that is no yaml file", calibration_file="mine.yaml", **points)
    assert list(outside.iterdir()) == []
    assert note.read_text() == SECRET
    assert cable.read_text() == cable_file.read_text()
    assert idle.set(view="new.rrd", calibration_points="", calibration_file="").successful
    new, before = out / "new.rrd", 0

    def begun():
        return new.exists() and new.stat().st_size > 0 and new.stat().st_mtime_ns > before

    for _ in range(2):  # the second time over the first
        assert idle.transition(CONFIGURE)
        assert idle.transition(ACTIVATE)
        idle.predicted()
        idle.until(begun, "recording")
        assert idle.transition(DEACTIVATE)
        assert idle.transition(CLEANUP)
        assert new.read_bytes()[:3] == b"RRF"
        before = time.time_ns()
    assert idle.process.stop() == 0


def test_without_an_output_folder_nothing_is_written(start, tmp_path):
    node = start(view="seen.rrd", active=False)
    node.diagnosis("lifecycle", "files are written only below output_folder, which is empty", ERROR)
    assert not (tmp_path / "seen.rrd").exists()


@pytest.mark.parametrize(
    "name", ["cable_file", "scene_file", "robot_file", "uncertainty_file", "planner_profiles"], ids=str
)
def test_what_is_in_a_file_that_a_peer_names_is_never_told_and_devices_and_fifos_are_refused(idle, tmp_path, name):
    others = {"planner": True} if name == "planner_profiles" else {}
    secrets = {
        "shadow": SECRET + "\n" + SECRET.replace("root", "ann"),
        "key.yaml": f"{SECRET}: {SECRET}\n- {SECRET}\n",
        "token": "hunter2hunter2",
        "ini": "password = hunter2\n[x]\n",
        "script.xml": f"<a>{SECRET}</b>",
    }
    for file, content in secrets.items():
        (tmp_path / file).write_text(content)
        refused(idle, str(tmp_path / file), **{name: str(tmp_path / file)}, **others)
    os.mkfifo(tmp_path / "fifo")
    refused(idle, "it is a FIFO, not a regular file", **{name: str(tmp_path / "fifo")}, **others)
    refused(idle, "it is a device, not a regular file", **{name: "/dev/zero"}, **others)
    refused(idle, "cannot be opened", **{name: "x" * 5000}, **others)
    refused(idle, "there is no such user's home", **{name: "~nobody-of-this-name/x.yaml"}, **others)
    told = idle.process.text() + " ".join(s.message for m in idle.diagnostics for s in m.status)
    assert "hunter2" not in told
    assert "Traceback" not in told
    assert idle.process.stop() == 0


def test_profiles_that_would_write_a_log_are_refused(idle, tmp_path):
    profiles = tmp_path / "log.xml"
    profiles.write_text(
        '<dds xmlns="http://www.eprosima.com"><log><consumer><class>FileConsumer</class></consumer></log></dds>'
    )
    refused(idle, "its <log> would write files", planner=True, planner_profiles=str(profiles))
