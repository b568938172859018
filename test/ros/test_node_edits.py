"""Edits of a running node over DDS: what they change, what is refused, and that a replay repeats them to the bit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cable_shape_msgs.msg import CableEdit, CableEdits, CableScene
from cable_shape_msgs.srv import EditCable
from diagnostic_msgs.msg import DiagnosticStatus
from harness import ALONG_X, LATCHED, nanoseconds, values_of
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from recordings import BEGIN, LEFT, PERIOD, RIGHT, Entry, pose_entry, write_bag
from replays import messages
from visualization_msgs.msg import Marker, MarkerArray

import cable_shape as cs
from cable_shape.messages.edits import edits_of
from cable_shape.replay.run import replay
from cable_shape.replay.settings import Settings
from cable_shape.ros import conversions

FIELDS = ("arc_length", "positions", "quaternions", "curvature", "force", "moment")
KEPT = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
CABLE_YAML = "length: 1.2\nlinear_density: 0.1\nbending_stiffness: 0.01\ndiameter: 0.008\ntails: {end: 0.2}\n"
SCENE_YAML = "contact: solve\nobstacles:\n  - {name: table, box: [2.0, 2.0, 0.1], position: [0.4, 0.0, 0.1]}\n"
POST = cs.Obstacle("post", cs.Cylinder(0.02, 0.6), cs.Pose((0.4, 0.3, 0.4)))
CLIP = cs.Clip(0.6, cs.Pose((0.4, 0.0, 1.0 / 3.0), ALONG_X), "ball", name="middle")


def request(*edits, stamp=0, frame="", cable=""):
    header = conversions.header_of(stamp, frame)
    return EditCable.Request(header=header, cable_id=cable, edits=[conversions.edit_message(e) for e in edits])


def ask(node, *edits, **header):
    return node.call(EditCable, "edit", request(*edits, **header))


def place(k):
    """Of the grips in cycle k: the right one goes round, the left one stands."""
    return (0.0, 0.0, 0.5), (0.8 + 0.03 * math.sin(0.3 * k), 0.05 * math.sin(0.2 * k), 0.5)


#: What is edited before which cycle.
PLAN = {
    3: [cs.Add(POST)],
    5: [cs.Insert(CLIP)],
    7: [cs.Move("middle", cs.Pose((0.4, 0.02, 0.34), ALONG_X)), cs.Move("post", cs.Pose((0.4, 0.25, 0.4)))],
    9: [cs.Regrip("end", 1.3), cs.Add(cs.PointMass(0.3, 0.01))],
    11: [cs.Release("middle")],
    13: [cs.Open("end")],
    15: [cs.Regrip("end", 1.2)],
    17: [cs.SetCable(cs.Cable(length=1.25, linear_density=0.11, bending_stiffness=0.012, diameter=0.008))],
    19: [cs.Remove("post")],
}


@pytest.fixture
def files(tmp_path):
    cable, scene = tmp_path / "cable.yaml", tmp_path / "scene.yaml"
    cable.write_text(CABLE_YAML)
    scene.write_text(SCENE_YAML)
    return {"cable_file": cable, "scene_file": scene}


def test_a_motion_with_edits_recorded_from_the_node_is_replayed_to_the_bit(start, tmp_path, files):
    node = start(**files)
    done = node.listen(CableEdits, "cable/edits", KEPT)
    scenes = node.listen(CableScene, "cable/scene", LATCHED)
    entries, live = [], {}
    for k in range(22):
        stamp = BEGIN + k * PERIOD
        if k in PLAN:
            answer = ask(node, *PLAN[k])
            assert answer.done, (k, answer.reason)
            assert nanoseconds(answer.stamp) == stamp - PERIOD
        live[stamp] = node.shape_at(stamp, *place(k))
        entries += [pose_entry(t, stamp, p) for t, p in zip((LEFT, RIGHT), place(k), strict=True)]
    node.until(lambda: len(done) == len(PLAN), "all edits")
    assert [message.number for message in done] == list(range(1, len(PLAN) + 1))
    node.until(lambda: scenes[-1].number == len(PLAN), "the last scene")
    assert edits_of(done[1].edits) == PLAN[5]
    assert node.process.stop() == 0

    for message in done:  # as a recorder gets them, a little later than the poses of the next cycle
        late = nanoseconds(message.header.stamp) + 3 * PERIOD // 2
        entries.append(Entry("/cable/edits", "cable_shape_msgs/msg/CableEdits", late, raw=serialize_message(message)))
    bag = write_bag(tmp_path / "bag", sorted(entries, key=lambda entry: entry.log_time))
    cable, scene = cs.Cable.from_yaml(files["cable_file"]), cs.Scene.from_yaml(files["scene_file"])
    outcome = replay(bag, tmp_path / "out", Settings(cable=cable, scene=scene, rrd=False, picture=False))
    assert outcome.problems == ()
    assert outcome.edits == len(PLAN)
    replayed = dict(messages(tmp_path / "out", "/cable/shape"))
    assert list(replayed) == list(live)
    for k, stamp in enumerate(live):
        for name in FIELDS:
            assert np.array_equal(getattr(live[stamp], name), getattr(replayed[stamp], name)), (k, name)
    again = [message for _, message in messages(tmp_path / "out", "/cable/edits")]
    assert [m.number for m in again] == [m.number for m in done]
    (_, last) = messages(tmp_path / "out", "/cable/scene")[-1]
    assert (last.scene, list(last.cables), list(last.ends)) == (scenes[-1].scene, scenes[-1].cables, [1.25])


def refused(node, *edits, **header):
    answer = ask(node, *edits, **header)
    assert not answer.done
    return answer.reason


def raw(node, cable="", **fields):
    return node.call(EditCable, "edit", EditCable.Request(cable_id=cable, edits=[CableEdit(**fields)]))


def bits(message):
    return [bytes(getattr(message, name)) for name in FIELDS]


@pytest.fixture
def edited(start, files):
    """A node with a clip, in its third cycle, at rest, and the stamp of that cycle."""
    node = start(**files, diagnostics_period=0.2)
    for k in range(2):
        node.shape_at(BEGIN + k * PERIOD, *place(0))
    assert ask(node, cs.Insert(CLIP)).done
    return node, BEGIN + 2 * PERIOD


def test_what_cannot_be_is_refused_with_its_reason_and_changes_nothing_to_the_bit(edited, start, files):
    node, stamp = edited
    twin = start(**files)  # of which nothing is asked that cannot be
    for k in range(2):
        twin.shape_at(BEGIN + k * PERIOD, *place(0))
    assert ask(twin, cs.Insert(CLIP)).done
    scenes = node.listen(CableScene, "cable/scene", LATCHED)
    node.until(lambda: scenes and scenes[-1].number == 1, "the scene")
    far = conversions.edit_message(cs.Move("table", cs.Pose()))
    far.pose.position.x = 2e6
    nan = conversions.edit_message(cs.Move("middle", cs.Pose()))
    nan.pose.position.y = math.nan
    long = conversions.edit_message(cs.Move("middle", cs.Pose()))
    long.pose.orientation.w = 2.0
    wrong = {
        "edits[0]: kind = 99 is not allowed: no such kind": {"kind": 99},
        "Remove.name = 'nothing' is not allowed: no such body or clip. Known: table, middle.": {
            "kind": CableEdit.REMOVE,
            "name": "nothing",
        },
        "Release.name = 'table' is not allowed: no such clip. Known: middle.": {
            "kind": CableEdit.RELEASE,
            "name": "table",
        },
        "Regrip.end = 'left' is not allowed": {"kind": CableEdit.REGRIP, "end": "left", "arc_length": 1.0},
        "Regrip.arc_length = nan": {"kind": CableEdit.REGRIP, "end": "end", "arc_length": math.nan},
        "Regrip.arc_length = 1.5 is not allowed: the cable goes from 0 m to 1.4 m": {
            "kind": CableEdit.REGRIP,
            "end": "end",
            "arc_length": 1.5,
        },
        "Open.end = 'middle' is not allowed": {"kind": CableEdit.OPEN, "end": "middle"},
        "position = [2000000.0, 0.0, 0.0] is not allowed: every entry must be within 1e+06 m": far,
        "position = [0.0, nan, 0.0]": nan,
        "quaternion": long,
        "PointMass.mass = -1.0": {"kind": CableEdit.ADD, "part": "{arc_length: 0.3, mass: -1.0}"},
        "Sphere.radius = -0.1": {"kind": CableEdit.ADD, "part": "{name: ball, sphere: -0.1}"},
        "no file is read for an edit": {"kind": CableEdit.ADD, "part": "{name: secret, mesh: /etc/passwd}"},
        "names must be unique": {"kind": CableEdit.ADD, "part": "{name: table, sphere: 0.1}"},
        "Insert.clip.arc_length = 2.0 is not allowed": {
            "kind": CableEdit.INSERT,
            "part": "{arc_length: 2, position: [0, 0, 0]}",
        },
        "the key 'position' is missing": {"kind": CableEdit.INSERT, "part": "{arc_length: 0.3}"},
        "unknown key 'colour'": {"kind": CableEdit.ADD, "part": "{name: x, sphere: 0.1, colour: red}"},
        "it must be a mapping of keys to values": {"kind": CableEdit.ADD, "part": "- 1"},
        "part, line 1": {"kind": CableEdit.ADD, "part": "{: }{"},
        "bending_stiffness": {
            "kind": CableEdit.SET_CABLE,
            "part": "{length: 1.0, linear_density: 0.1, bending_stiffness: -1}",
        },
    }
    for text, fields in wrong.items():
        answer = raw(node, **fields) if isinstance(fields, dict) else ask_messages(node, fields)
        assert not answer.done, text
        assert text in answer.reason, answer.reason
        assert answer.number == 1
    assert "edits = '0 edits'" in refused(node)
    assert "cable = 'other' is not allowed" in refused(node, cs.Open("end"), cable="other")
    assert "it must be 'world', that of the input" in refused(node, cs.Remove("table"), frame="map")
    # the first one can be, the second one cannot
    assert "cannot follow" in refused(
        node, cs.Add(POST), cs.Insert(cs.Clip(0.9, cs.Pose((3.0, 0.0, 0.5)), name="out of reach"))
    )
    text = "an edit was refused: "
    status = node.diagnosis("cable", text, DiagnosticStatus.WARN, lambda: refused(node, cs.Release("nothing")))
    assert values_of(status)["edits done"] == "1"
    assert int(values_of(status)["edits refused"]) > len(wrong)
    for k in range(3):
        there = place(k)
        assert bits(node.shape_at(stamp + k * PERIOD, *there)) == bits(twin.shape_at(stamp + k * PERIOD, *there)), k
    assert [message.number for message in scenes] == [1]
    for one in (node, twin):
        assert one.process.stop() == 0


def ask_messages(node, *edits):
    return node.call(EditCable, "edit", EditCable.Request(edits=list(edits)))


def test_edits_wait_for_the_stamp_of_the_input(edited):
    node, stamp = edited
    done = node.listen(CableEdits, "cable/edits", KEPT)
    client = node.clients["edit"]
    early = client.call_async(request(cs.Release("middle"), stamp=stamp + 5 * PERIOD))
    first = client.call_async(request(cs.Add(POST), stamp=stamp + PERIOD + 1))
    assert "ahead of the last cycle" in refused(node, cs.Remove("table"), stamp=stamp + 20 * 10**9)
    assert "above that of the last cycle" in refused(node, cs.Remove("table"), stamp=stamp - PERIOD)
    for k in range(2):
        node.shape_at(stamp + k * PERIOD, *place(0))
        assert not first.done()
    node.shape_at(stamp + 2 * PERIOD, *place(0))
    node.until(first.done, "answer to the first")
    assert first.result().done, first.result().reason
    assert nanoseconds(first.result().stamp) == stamp + PERIOD
    assert not early.done()
    node.shape_at(stamp + 5 * PERIOD, *place(0))
    node.until(early.done, "answer to the second")
    assert early.result().done
    node.until(lambda: len(done) == 3, "all edits")
    assert [nanoseconds(m.header.stamp) - stamp for m in done] == [-PERIOD, PERIOD, 2 * PERIOD]
    waiting = client.call_async(request(cs.Remove("post"), stamp=stamp + 9 * PERIOD))
    assert ask(node, cs.Move("post", cs.Pose((0.4, 0.3, 0.3)))).done  # those without a stamp do not wait
    assert not waiting.done()
    assert node.transition(4)  # deactivate
    node.until(waiting.done, "answer of an inactive node")
    assert "deactivated" in waiting.result().reason
    assert "only an active node takes edits" in refused(node, cs.Remove("post"))
    assert node.process.stop() == 0


@pytest.mark.parametrize("allowed", [False, True])
def test_a_locked_node_takes_edits_only_where_it_is_told_so(start, files, allowed):
    node = start(**files, lock="true", allow_edits=str(allowed).lower(), diagnostics_period=0.2)
    node.predicted()
    answer = ask(node, cs.Add(POST))
    assert answer.done == allowed
    if not allowed:
        assert "with allow_edits: true" in answer.reason
        text = "an edit was asked for by a peer and is refused"
        node.diagnosis("lifecycle", text, DiagnosticStatus.WARN, lambda: ask(node, cs.Add(POST)))
        ask(node, cs.Add(POST))
        node.until(
            lambda: int(values_of(node.diagnosis("lifecycle", ""))["turned away"]) >= 2, "both that were refused"
        )
    assert not node.set(allow_edits=True).successful
    assert node.process.stop() == 0


def test_markers_are_as_wide_as_the_cable_is_now(edited):
    node, stamp = edited
    markers = node.listen(MarkerArray, "cable/markers")
    wide = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.02)
    assert ask(node, cs.SetCable(wide)).done

    def widths():
        return {m.scale.x for message in markers for m in message.markers if m.type == Marker.LINE_STRIP}

    steps = iter(range(1000))
    node.send_until(lambda: node.shape_at(stamp + next(steps) * PERIOD, *place(0)), widths, "markers")
    assert 0.02 in widths()


def test_a_node_with_a_harness_tells_its_scene_and_says_what_an_edit_must_name(start):
    node = start(cable_file=None, harness_file="harnesses/demo.yaml", scene_file="scenes/harness.yaml", active=False)
    node.until(lambda: node.state() == "active", "state active")
    scenes = node.listen(CableScene, "cable/scene", LATCHED)
    node.until(lambda: scenes, "the scene")
    assert "clips" in scenes[0].scene
    assert scenes[0].cable_ids
    assert all(name.startswith("demo/") for name in scenes[0].cable_ids)
    assert "'demo' is a harness: it must be an end of a segment" in refused(node, cs.Open("end"))
    assert node.process.stop() == 0
