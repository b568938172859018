"""`cable-shape status`: what it shows of messages, and of real nodes over DDS."""

import json
import os
import signal
import subprocess
import sys

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from harness import TIMEOUT
from rclpy.lifecycle import LifecycleNode

from cable_shape.command.cli import main
from cable_shape.ros.status import LINES, Line, Seen, lines_of, nobody, printable


def message(name="cell/cable_shape_node", lines=LINES, **texts):
    status = [
        DiagnosticStatus(
            name=f"{name}: {line}", hardware_id=name, message=texts.get(line, "fine"),
            level=DiagnosticStatus.WARN if line in texts else DiagnosticStatus.OK,
            values=[KeyValue(key="cycles", value="7")],
        )
        for line in lines
    ]  # fmt: skip
    return DiagnosticArray(status=status)


def test_the_four_lines_of_a_node_are_told_from_those_of_others():
    ((name, lines),) = lines_of(message(input="stale"))
    assert name == "/cell/cable_shape_node"
    assert [*lines] == [*LINES]
    assert lines["input"] == Line(1, "stale", {"cycles": "7"})
    assert not [*lines_of(message(lines=("input", "cable")))]
    assert not [*lines_of(DiagnosticArray(status=[DiagnosticStatus(name="motor: input", hardware_id="drive 3")]))]


def test_what_a_peer_writes_commands_no_terminal():
    ((_, lines),) = lines_of(message(cable="\x1b]0;owned\x07 near\n post"))
    assert lines["cable"].text == "?]0;owned? near? post"
    assert printable("µ → 2 m²") == "µ → 2 m²"


def test_the_text_says_what_is_not_well_and_values_only_when_asked():
    seen = Seen("/cable_shape_node", "active", dict(next(lines_of(message(input="stale: no message")))[1]))
    assert not seen.well
    text = seen.text()
    assert text.splitlines()[0] == "/cable_shape_node: active"
    assert "  WARN  input      stale: no message" in text
    assert "  ok    cable      fine" in text
    assert "cycles" not in text
    assert "cycles: 7" in seen.text(values=True)
    silent = Seen("/cable_shape_node", "", {})
    assert "answers nothing yet. It may be configuring" in silent.text()
    assert not silent.well


def test_when_nobody_is_heard_domain_and_remedy_are_named(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    text = nobody("", ["/talker"], 5.0)
    assert (
        "no node of cable_shape was heard within 5 s on ROS_DOMAIN_ID = 42, ROS_AUTOMATIC_DISCOVERY_RANGE = SUBNET"
        in text
    )
    assert "other nodes there: /talker. Start it (cable_shape_node" in text
    assert "no other node is there, either" in nobody("", [], 5.0)


def name_of(cell):
    return f"/{cell.process.namespace}/cable_shape_node"


def status(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "cable_shape.command.cli", "status", *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ,
    )  # fmt: skip


def complaints(text):
    """What is written to standard error, but by the middleware."""
    return [line for line in text.splitlines() if "RTPS" not in line]


def test_a_node_that_predicts_is_well_and_one_without_input_is_not(cell):
    """The command runs in a process of its own, beside grips that go on coming."""

    def answered(feed):
        asked = status("--node", name_of(cell), "--timeout", "60", "--json")

        def ended():
            feed()
            return asked.poll() is not None

        cell.until(ended, "an answer of status")
        out, wrong = asked.communicate()
        assert not complaints(wrong)
        return asked.returncode, json.loads(out)[0]

    def well():
        code, node = answered(cell.pair)
        assert node["node"] == name_of(cell)
        assert (code == 0) == node["well"] == all(line["level"] == "ok" for line in node["lines"].values())
        return node if code == 0 else None

    node = cell.until(well, "a node that is well")
    assert node["state"] == "active"
    assert node["lines"]["prediction"]["message"] == "cable: OK"
    assert int(node["lines"]["input"]["values"]["cycles"]) > 0
    node = cell.until(lambda: (found := answered(lambda: None))[0] == 1 and found[1], "a node that is not well")
    assert "stale: no message on" in node["lines"]["input"]["message"]


def test_a_node_that_could_not_be_configured_says_why(start, tmp_path, capsys):
    node = start(cable_file=tmp_path / "nowhere.yaml", active=False)
    node.diagnosis("lifecycle", "configure failed")
    assert main(["status", "--node", name_of(node), "--timeout", "60"]) == 1
    said = capsys.readouterr().out
    assert f"{name_of(node)}: unconfigured" in said
    assert "  ERROR lifecycle  configure failed: " in said
    assert "nowhere.yaml: no such file" in said


def test_a_node_that_is_there_but_says_nothing_is_told(cell, capsys):
    """As one that configures: its participant is seen, nothing is answered."""
    busy = LifecycleNode("cable_shape_node", namespace="/busy", context=cell.context)
    busy.create_publisher(DiagnosticArray, "/diagnostics", 10)
    timeouts = iter(("1", "4", "16", "64"))  # for it to be found
    try:
        while main(["status", "--node", "/busy/cable_shape_node", "--timeout", next(timeouts)]) != 1:
            pass
    finally:
        busy.destroy_node()
    said = capsys.readouterr().out
    assert (
        "/busy/cable_shape_node: state unknown\n  WARN             answers nothing yet. It may be configuring" in said
    )


def test_following_tells_news_until_it_is_interrupted(cell):
    cell.predicted()
    following = status("--node", name_of(cell), "--follow", "--timeout", "60")
    try:
        first = following.stdout.readline()
        assert first.endswith(f" {name_of(cell)}: active\n")
        following.send_signal(signal.SIGINT)
        _, wrong = following.communicate(timeout=TIMEOUT)
    finally:
        following.kill()
    assert following.returncode == 130
    assert complaints(wrong) == ["cable-shape: interrupted"]


def test_a_name_that_nobody_has_and_wrong_options_are_refused(cell, capsys):
    assert main(["status", "--node", "nobody", "--timeout", "1"]) == 2
    assert "no node /nobody was heard within 1 s" in capsys.readouterr().err
    assert main(["status", "--timeout", "0"]) == 2
    assert "--timeout = 0.0 is not allowed: it must be above 0 s" in capsys.readouterr().err
    assert main(["status", "--json", "--follow"]) == 2
    assert "--json is for one answer" in capsys.readouterr().err
