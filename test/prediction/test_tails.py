"""Tails beyond the grips: exact free ends, their frames and rest curvature, and their clearance."""

import math

import numpy as np
import pytest
from rods import CABLE, END, START
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.safety.report import WarningKind as Kind

BOTH = {"start": 0.2, "end": 0.3}
CURVED = CABLE.replace(rest_curvature=[(0.5, -1.0, 2.0), (0.0, 0.0, 0.0), (1.5, 1.0, -2.0)])


def cycle_report(cable=CABLE, start=START, end=END, scene=None, tails=BOTH, **keywords) -> cs.CycleReport:
    cycle = cs.Cycle(cable, scene=scene, model="cosserat", tails=None if tails is None else {"cable": tails})
    return cycle.step({"cable": (start, end)}, 0, **keywords)


def test_tails_hang_from_the_grips_and_leave_along_the_cable():
    report = cycle_report()
    start, end, span = report.tails["cable", "start"], report.tails["cable", "end"], report.shapes["cable"]
    assert (start.length, end.length) == (0.2, 0.3)
    np.testing.assert_allclose(start.positions[0], START.position)
    np.testing.assert_allclose(end.positions[0], END.position)
    np.testing.assert_allclose(start.tangents[0], -span.tangents[0], atol=1e-12)
    np.testing.assert_allclose(end.tangents[0], span.tangents[-1], atol=1e-12)
    for tail, length in ((start, 0.2), (end, 0.3)):
        assert tail.status is cs.Status.OK
        weight = 0.1 * length * 9.81
        np.testing.assert_allclose(tail.force[0], (0.0, 0.0, -weight), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(tail.force[-1], 0.0, atol=1e-12)
        np.testing.assert_allclose(tail.moment[-1], 0.0, atol=1e-11)


@pytest.mark.parametrize("side", ["start", "end"])
def test_a_tail_is_the_rest_of_one_longer_free_cable(side):
    """A cable of 0.5 m hanging from a clamp is that clamp's tail; run backwards it is the tail at the other side."""
    natural = CABLE.replace(length=0.5, rest_curvature=(0.5, -1.0, 2.0))
    held = cs.Pose((0.1, 0.2, 0.3), Rotation.from_rotvec((0.3, -0.4, 0.5)).as_quat())
    tail = cs.predict_tails(natural, held, held, {side: 0.5})[side]
    if side == "end":
        whole = cs.predict(natural, held, None, model="cosserat", points=tail.points)
        np.testing.assert_allclose(tail.positions, whole.positions, atol=1e-3 * 0.5)
        np.testing.assert_allclose(tail.curvature, whole.curvature, atol=1e-3)
        return
    # the same material cable read from its free end: the frame goes with it, and no load at its own start
    forwards = natural.replace(rest_curvature=(-0.5, -1.0, 2.0))
    assert tail.status is cs.Status.OK
    turned = held * cs.Pose(quaternion=(1.0, 0.0, 0.0, 0.0))
    whole = cs.predict(forwards, turned, None, model="cosserat", points=tail.points)
    np.testing.assert_allclose(tail.positions, whole.positions, atol=1e-3 * 0.5)


def test_rest_curvature_of_the_start_tail_continues_the_natural_shape_of_the_cable():
    """Without loads the cable is its natural helix: span and tails lie on one and the same."""
    helix = cs.Cable(length=0.4, linear_density=0.0, bending_stiffness=0.01, rest_curvature=(3.0, 4.0, 2.0))
    whole = cs.predict(helix.replace(length=1.0), START, None, model="cosserat", points=1001, tolerance=1e-9)
    at = {"start": 300, "end": 700}
    grips = [cs.Pose(whole.positions[i], whole.quaternions[i]) for i in at.values()]
    tails = cs.predict_tails(helix, *grips, {"start": 0.3, "end": 0.3}, points=1000)
    backwards = tails["start"]
    for tail, points in ((tails["end"], whole.positions[700:]), (backwards, whole.positions[300::-1])):
        i = np.round(tail.arc_length / 0.001).astype(int)
        np.testing.assert_allclose(tail.positions, points[i], atol=1e-3 * 0.3 + 1e-3)
        assert np.linalg.norm(tail.positions[-1] - points[-1]) < 1e-3


def test_a_curvature_table_gives_each_tail_that_of_its_end():
    from cable_shape.prediction.tails import tail_cable

    np.testing.assert_array_equal(tail_cable(CURVED, "start", 0.1).rest_curvature, (-0.5, -1.0, 2.0))
    np.testing.assert_array_equal(tail_cable(CURVED, "end", 0.1).rest_curvature, (1.5, 1.0, -2.0))


def test_a_tail_of_a_chain_hangs_straight_down():
    chain = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.0)
    tails = cs.predict_tails(chain, START, END, BOTH)
    for side, grip in (("start", START), ("end", END)):
        shape = tails[side]
        np.testing.assert_allclose(shape.positions[:, :2], np.tile(grip.position[:2], (shape.points, 1)), atol=1e-12)
        np.testing.assert_allclose(shape.positions[:, 2], grip.position[2] - shape.arc_length, atol=1e-12)


@pytest.mark.parametrize("kind", ["swivel", "pinned"])
def test_where_the_grip_lets_go_the_tail_follows_the_span(kind):
    report = cycle_report(end=cs.Grip(END, kind=kind))
    span = report.shapes["cable"]
    np.testing.assert_allclose(report.tails["cable", "end"].tangents[0], span.tangents[-1], atol=1e-9)


def test_a_free_end_has_no_tail():
    assert list(cycle_report(end=None).tails) == [("cable", "start")]
    with pytest.raises(cs.ArgumentError, match=r"tails.end = 0.3 is not allowed: nothing holds this end"):
        cs.predict_tails(CABLE, START, None, BOTH)


def test_clearance_of_a_tail_is_told_with_its_place_beyond_the_grip():
    tails = cs.predict_tails(CABLE, START, END, BOTH)
    obstacles = []
    for name, tail in tails.items():
        tip = tail.positions[-1]
        obstacles.append(cs.Obstacle(name, cs.Sphere(0.01), cs.Pose(tip - (0.0, 0.0, 0.01 + 0.02 + 0.004))))
    low = cs.predict(CABLE, START, END, model="cosserat").positions
    obstacles.append(cs.Obstacle("middle", cs.Sphere(0.01), cs.Pose(low[75] - (0.0, 0.0, 0.04))))
    report = cycle_report(scene=cs.Scene(obstacles=obstacles))
    bodies = {b.body: b for b in report.clearance["cable"].bodies}
    assert list(bodies) == ["start", "end", "middle"], "in the order of the scene"
    assert bodies["start"].distance == pytest.approx(0.02, abs=1e-3)
    assert bodies["start"].arc_length == pytest.approx(-0.2, abs=1e-3)
    assert bodies["end"].distance == pytest.approx(0.02, abs=1e-3)
    assert bodies["end"].arc_length == pytest.approx(1.2 + 0.3, abs=1e-3)
    assert 0.0 < bodies["middle"].arc_length < 1.2
    texts = {w.other: w.text for w in report.warnings if w.kind is Kind.CLEARANCE}
    assert "on the tail, 0.200 m before the start grip" in texts["start"]
    assert "on the tail, 0.300 m beyond the end grip" in texts["end"]
    assert "from the start grip" in texts["middle"]
    without = cycle_report(scene=cs.Scene(obstacles=obstacles), tails=None)
    by_body = {b.body: b.distance for b in without.clearance["cable"].bodies}
    assert by_body["middle"] == bodies["middle"].distance
    assert all(by_body.get(name, math.inf) > bodies[name].distance for name in ("start", "end"))


def test_the_time_until_a_tail_touches_comes_from_the_last_cycles():
    tail = cs.predict_tails(CABLE, START, END, {"end": 0.3})["end"]
    post = cs.Obstacle("post", cs.Sphere(0.01), cs.Pose(tail.positions[-1] - (0.0, 0.0, 0.01 + 0.05 + 0.004)))
    cycle = cs.Cycle(CABLE, scene=cs.Scene(obstacles=[post]), model="cosserat", tails={"cable": {"end": 0.3}})
    for k in range(3):
        down = (0.0, 0.0, -0.001 * k)
        grips = [cs.Pose(p.position + down, p.quaternion) for p in (START, END)]
        report = cycle.step({"cable": tuple(grips)}, k * 10_000_000)
    (margin,) = (m for m in report.margins["cable"] if m.other == "post")
    assert margin.arc_length > 1.2
    assert margin.time_to_limit == pytest.approx((0.05 - 0.002 - 0.03) / 0.1, rel=0.02)


def test_the_cable_itself_may_have_tails_and_its_file_too(tmp_path):
    file = tmp_path / "cable.yaml"
    file.write_text("length: 1.2\nlinear_density: 0.1\nbending_stiffness: 0.01\ntails: {end: 0.3}\n")
    cable = cs.Cable.from_yaml(file)
    assert dict(cable.tails) == {"end": 0.3}
    assert cs.Cable.from_mapping(cable.as_dict()) == cable
    assert list(cycle_report(cable, tails=None).tails) == [("cable", "end")]
    assert list(cycle_report(cable, tails={"start": 0.1}).tails) == [("cable", "start")], "the cycle's come first"
    assert cycle_report(cable, tails={}).tails == {}


@pytest.mark.parametrize(
    ("tails", "says"),
    [
        ({"cable": {"left": 0.1}}, r"tails: unknown key 'left'.*Known keys: end, start"),
        ({"cable": {"end": 0.0}}, r"tails.end = 0.0 is not allowed: it must be above 0 m"),
        ({"cabel": {"end": 0.1}}, r"tails: unknown key 'cabel'. Did you mean 'cable'\?"),
    ],
)
def test_bad_tails_are_refused(tails, says):
    with pytest.raises(cs.ArgumentError, match=says):
        cs.Cycle(CABLE, tails=tails)


def test_reset_starts_the_tails_afresh_too():
    cycle = cs.Cycle(CABLE, model="cosserat", tails={"cable": BOTH})
    cycle.step({"cable": (START, END)}, 0)
    assert cycle.step({"cable": (START, END)}, 1).tails["cable", "end"].reused
    cycle.reset()
    assert not cycle.step({"cable": (START, END)}, 2).tails["cable", "end"].reused
