"""Planner and calibrator after edits: they know what the node tells on its latched scene, or say why not."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from cable_shape_msgs.action import CalibrateCable, CheckTrajectory
from cable_shape_msgs.msg import CableScene
from cable_shape_msgs.srv import EditCable, PredictShapes
from harness import ALONG_X, LATCHED, Goals

import cable_shape as cs
from cable_shape.cable.cut import stretch_of
from cable_shape.errors import ArgumentError, InputError
from cable_shape.prediction.layout import Laid, Layout
from cable_shape.ros import conversions, planning
from cable_shape.ros.following import TOO_LONG, Following
from cable_shape.ros.planning import Planner
from cable_shape.ros.serving import Gate
from cable_shape.ros.workers import PlannerSetup
from cable_shape.viewer.mailbox import Mailbox

CABLE = cs.Cable(
    length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.008, tails={"end": 0.2}, min_bend_radius=0.02
)
POST = cs.Obstacle("post", cs.Capsule(0.02, 0.6), cs.Pose((0.4, 0.6, 0.2)))
EYE = cs.Clip(1.0 / 3.0, cs.Pose((0.25, 0.0, 0.45), ALONG_X), "ball", name="eye")
NEAR = cs.Pose((1.0 / 3.0, 0.2, 0.2))


def flat(table):
    return np.asarray(table).ravel().tolist()


def grips(*places):
    """Rows of both grips, the second one at these x and y."""
    starts = np.tile((0.0, 0.0, 0.5, *ALONG_X), (len(places), 1))
    return starts, np.array([(x, y, 0.5, *ALONG_X) for x, y in places])


def edit(node, *edits):
    request = EditCable.Request(edits=[conversions.edit_message(one) for one in edits])
    answer = node.call(EditCable, "edit", request)
    assert answer.done, answer.reason
    return answer.number


def told_scene(node, scenes, number):
    """The cable and scene that the node tells after so many edits."""
    node.until(lambda: scenes and scenes[-1].number == number, "the scene as edited")
    told = scenes[-1]
    made = cs.Cable.from_mapping(json.loads(told.cables[0]))
    return stretch_of(made, told.starts[0], told.ends[0]), cs.Scene.from_mapping(json.loads(told.scene))


def test_planner_and_calibrator_follow_the_edits_of_a_node(start, tmp_path):
    file = tmp_path / "cable.yaml"
    file.write_text(json.dumps(CABLE.as_dict()))
    node = start(cable_file=file, planner="true", calibration="true", model="cosserat", points=40)
    node.predicted()
    scenes = node.listen(CableScene, "cable/scene", LATCHED)
    client = node.node.create_client(PredictShapes, "cable/predict_shapes")
    check, fit = Goals(node, CheckTrajectory, "cable/check_trajectory"), Goals(node, CalibrateCable, "cable/calibrate")
    node.until(client.service_is_ready, "predict_shapes")
    starts, ends = grips((0.8, 0.0), (0.75, 0.1))
    fields = {"starts": flat(starts), "ends": flat(ends)}

    number = edit(node, cs.Add(POST), cs.Insert(EYE))
    number = edit(node, cs.Move("post", NEAR), cs.Regrip("end", 1.3))
    cable, scene = told_scene(node, scenes, number)
    assert (cable.length, scene.clips[0].name, scene.obstacles[0].pose) == (1.3, "eye", NEAR)
    told = node.ask(client, PredictShapes.Request(**fields, arrays=1), "shapes", again=10.0)
    own = cs.predict_batch(cable, starts, ends, model="cosserat", scene=scene, points=40)
    assert (told.error, list(told.bodies)) == ("", ["post"])
    np.testing.assert_array_equal(np.reshape(told.positions, (2, 40, 3)), own.positions)
    np.testing.assert_array_equal(np.reshape(told.distances, (2, 1)), own.distances)

    status, found = check(**fields, edits=[conversions.edit_message(cs.Release("eye"))], before=[1])
    paths = [cs.GripPath(starts[i : i + 1], ends[i : i + 1]) for i in (0, 1)]
    mine = cs.check_trajectory(cable, scene, None, [paths[0], cs.Release("eye"), paths[1]], points=40)
    assert status == GoalStatus.STATUS_SUCCEEDED, found.error
    np.testing.assert_array_equal(found.clearance, mine.clearance)
    assert (found.valid, found.solved) == (mine.valid, mine.solved)

    status, refused = fit(starts=flat(starts[:1]), ends=flat(ends[:1]), counts=[3], points=[0.1, 0.0, 0.4] * 3)
    assert status == GoalStatus.STATUS_ABORTED
    assert "cable 'cable' = 'held from 0 to 1.3 m, in 1 clips' is not allowed: edits have left it" in refused.error

    edit(node, cs.Open("end"))
    told = node.ask(client, PredictShapes.Request(**fields), "shapes", again=10.0)
    assert "cable 'cable' = 'open at its end' is not allowed: an edit has opened its grip" in told.error
    for one in (check, fit):
        one.client.destroy()
    node.node.destroy_client(client)
    assert node.process.stop() == 0


@pytest.fixture
def planner(monkeypatch):
    """The planner's own part of a process, of a cable among a post, and its mailbox."""
    setup = PlannerSetup(
        "p", "/", "s", "a", {"cable": CABLE.as_dict()}, cs.Scene(obstacles=[POST]), "", "cosserat", (0.0, 0.0, -9.81),
        40, 0.0, 100, 1, 60.0, False,
    )  # fmt: skip
    monkeypatch.setattr(planning, "Goals", lambda *_: None)
    mailbox = Mailbox(Mailbox.memory())
    made = Planner(SimpleNamespace(create_service=lambda *_, **__: None), setup, Gate(), mailbox.file)
    yield made, mailbox
    mailbox.close()


def checked(planner, **fields):
    request = CheckTrajectory.Goal(**fields)
    goal = SimpleNamespace(request=request, is_cancel_requested=False, publish_feedback=lambda _: None)
    return planner._checked(goal)


def test_a_cable_that_hangs_open_is_checked_as_it_hangs(planner):
    made, mailbox = planner
    starts, ends = grips((0.8, 0.0), (0.8, 0.05))
    layout = made._following.layout.with_cable("cable", opened="end", last=1.25)
    mailbox.put(layout.as_text().encode())
    found = checked(made, starts=flat(starts), ends=flat(ends))
    assert found.valid
    assert found.solved == 2  # the grip that holds it stands still, whatever the other one does
    cable = layout.cables["cable"].cable
    hanging = cs.predict(cable, cs.Pose(starts[0, :3], starts[0, 3:]), None, model="cosserat", points=40)
    used = {margin.kind: margin.value for margin in found.margins[0]}
    sharpest = float(np.linalg.norm(hanging.curvature[:, :2], axis=1).max())
    assert used[cs.WarningKind.BEND_RADIUS] == pytest.approx(1.0 / sharpest, rel=0.02)  # the other is between points


@pytest.mark.parametrize(
    ("before", "edits", "words"),
    [
        ([], [cs.Release("eye")], "before = '0 numbers' is not allowed: there are 1 edits"),
        ([0], [cs.Release("eye")], "before = [0] is not allowed: they must be 1 to 2"),
        ([3], [cs.Release("eye")], "before = [3] is not allowed: they must be 1 to 2"),
        ([2, 1], [cs.Release("eye"), cs.Remove("post")], "never fall"),
    ],
)
def test_edits_of_no_place_on_the_way_are_refused(planner, before, edits, words):
    starts, ends = grips((0.8, 0.0), (0.8, 0.05))
    messages = [conversions.edit_message(one) for one in edits]
    with pytest.raises(ArgumentError) as raised:
        checked(planner[0], starts=flat(starts), ends=flat(ends), edits=messages, before=before)
    assert words in str(raised.value)


def test_the_edit_that_cannot_be_made_is_the_violation(planner):
    starts, ends = grips((0.8, 0.0), (0.8, 0.05))
    messages = [conversions.edit_message(cs.Release("eye"))]
    found = checked(planner[0], starts=flat(starts), ends=flat(ends), edits=messages, before=[2])
    assert found.first is not None
    assert (found.first.reason.value, found.first.place) == ("edit", 1.0)
    assert "eye" in found.first.text


def test_a_layout_is_the_same_to_the_bit_in_another_process():
    """Where it may be touched is told by arc lengths of the cable as it was made, whatever is gripped."""
    scene = cs.Scene(
        obstacles=[POST], contact="solve", allow=[cs.Allow("post", 0.1, 2.0 / 3.0, 1.0)], warn_distance=1.0 / 30.0
    )
    laid = Laid(CABLE, 1.0 / 7.0, 1.2 - 1.0 / 9.0, (EYE,), (cs.PointMass(1.0 / 11.0, 0.01),), "start")
    read = Layout.read(Layout(scene, {"cable": laid}).as_text(), {})
    assert read.cables == {"cable": laid}
    assert read.scene_of("cable").as_dict() == Layout(scene, {"cable": laid}).scene_of("cable").as_dict()
    assert read.cables["cable"].cable == laid.cable


def test_who_starts_late_knows_the_newest_and_who_cannot_know_says_so():
    mailbox = Mailbox(Mailbox.memory())
    first = Layout.of(cs.Scene(), {"cable": CABLE}, {})
    assert Following(first, mailbox.file).layout is first
    for last in (1.0, 1.1):
        mailbox.put(first.with_cable("cable", last=last).as_text().encode())
    late = Following(first, mailbox.file)
    assert late.layout.cables["cable"].last == 1.1
    with pytest.raises(ArgumentError, match=r"held from 0 to 1.1 m"):
        late.held_as_made("cable")
    mailbox.put(TOO_LONG)
    for _ in range(2):
        with pytest.raises(InputError, match="too long to be known here"):
            _ = late.layout
    mailbox.put(first.as_text().encode())
    assert late.held_as_made("cable") == first.cables["cable"]
    mailbox.close()
