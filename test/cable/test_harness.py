"""Harnesses: what they are made of, shapes of trees and loops, warm starts, derivatives, bad input."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from harness_random import balance, random_harness

import cable_shape as cs
from cable_shape.prediction.harness_predictor import HarnessPredictor

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
CABLE = cs.Cable(length=0.6, linear_density=0.1, bending_stiffness=(0.01, 0.012), twisting_stiffness=0.008)
START, END = cs.Pose((0.0, 0.0, 0.0), ALONG), cs.Pose((0.8, 0.1, 0.1), ALONG)


def turned(angle: float, axis: int = 0) -> cs.Pose:
    """A frame turned about d1, d2 or d3."""
    q = np.zeros(4)
    q[axis], q[3] = math.sin(0.5 * angle), math.cos(0.5 * angle)
    return cs.Pose(quaternion=q)


def fork(kind: str = "rigid", mass: float = 0.0, arm: cs.Cable | None = None) -> cs.Harness:
    """A trunk of two segments with a branch that leaves it to the side."""
    frames = {} if kind == "ball" else {"c.start": turned(1.0, 1)}
    joint = cs.Junction("fork", ("a.end", "b.start", "c.start"), kind, frames, mass)
    return cs.Harness({"a": CABLE, "b": CABLE, "c": arm or CABLE.replace(length=0.3)}, [joint])


ENDS = {"a.start": START, "b.end": END}
POINTS = np.full((3, 3), 0.1)
PLAIN = {"length": 1.0, "linear_density": 0.1, "bending_stiffness": 0.01}
ZERO = {"name": "j", "ends": ["a.start", "a.end"], "frames": {"a.end": {"quaternion": [0, 0, 0, 0]}}}


# -- shapes


@pytest.mark.parametrize("backwards", [False, True])
def test_two_arms_in_a_straight_junction_are_one_cable(backwards):
    """To 1e-9 of the length, forces and moments included; also where the second one runs the other way."""
    whole = CABLE.replace(length=1.2, rest_curvature=(0.4, 0.2, 0.3))
    half = whole.replace(length=0.6)
    second, end = half, "b.end"
    junction = cs.Junction("j", ("a.end", "b.start"))
    far = END
    if backwards:
        second = half.replace(rest_curvature=(-0.4, 0.2, 0.3))
        back = turned(math.pi)
        junction, end, far = cs.Junction("j", ("a.end", "b.end"), frames={"b.end": back}), "b.start", END * back
    harness = cs.Harness({"a": half, "b": second}, [junction])
    one = cs.predict(whole, START, END, points=301, tolerance=1e-10)
    two = cs.predict(harness, {"a.start": START, end: far}, points=151, tolerance=1e-10)
    assert two.status is cs.Status.OK
    a, b = two.segments.values()
    for name, unit in (("positions", 1.2), ("force", 0.01 / 1.44), ("moment", 0.01 / 1.2)):
        sign = -1.0 if backwards and name != "positions" else 1.0
        rest = sign * getattr(b, name)[:: -1 if backwards else 1]
        both = np.concatenate((getattr(a, name), rest[1:]))
        assert np.abs(both - getattr(one, name)).max() <= 1e-9 * unit * (1.0 if name == "positions" else 10.0)
    assert two.energy == pytest.approx(one.energy, rel=1e-9)
    assert sum(shape.energy for shape in two.segments.values()) == pytest.approx(two.energy, rel=1e-9)
    np.testing.assert_allclose(two.junctions["j"].position, one.positions[150], atol=1e-9)


@pytest.mark.parametrize("first", range(0, 80, 20))
def test_random_harnesses_are_in_balance(first):
    """Trees and loops, rigid and ball junctions: forces and moments at every one, and ends that meet there."""
    without = 0
    for seed in range(first, first + 20):
        harness, ends, scene = random_harness(np.random.default_rng(seed))
        shape = cs.predict(harness, ends, scene=scene)
        without += not shape.usable
        if shape.usable:
            force, moment, gap = balance(shape)
            strongest = max(np.abs(one.force).max() for one in shape.segments.values())
            assert force <= 1e-7 + 1e-5 * strongest + shape.force_error, seed
            assert moment <= 1e-7 + shape.moment_error, seed
            assert gap <= 1e-9, seed
    assert without <= 1


def test_a_ball_carries_no_moment_and_a_mass_hangs_on_its_junction():
    shape = cs.predict(fork("ball", 0.05), ENDS)
    assert shape.status is cs.Status.OK
    assert max(balance(shape)) < 1e-9
    for name, i in (("a", -1), ("b", 0), ("c", 0)):
        assert np.abs(shape.segments[name].moment[i]).max() < 1e-10
    carried = shape.segments["a"].force[0] - shape.segments["b"].force[-1]
    weight = sum(cable.linear_density * cable.length for cable in shape.harness.segments.values()) + 0.05
    np.testing.assert_allclose(carried, (0.0, 0.0, -9.81 * weight), atol=1e-9)
    first = shape.segments["a"]
    assert abs(shape.junctions["fork"].quaternion @ first.quaternions[-1]) == pytest.approx(1.0)


def test_an_end_may_lie_beside_the_origin_of_its_junction():
    frames = {"b.start": cs.Pose((0.02, 0.0, 0.01), (0.2, 0.0, 0.0, math.sqrt(0.96))), "c.start": turned(1.0, 1)}
    joint = cs.Junction("block", ("a.end", "b.start", "c.start"), frames=frames, mass=0.03)
    harness = cs.Harness({"a": CABLE, "b": CABLE, "c": CABLE}, [joint])
    shape = cs.predict(harness, ENDS)
    assert shape.status is cs.Status.OK
    force, moment, gap = balance(shape)
    assert max(force, moment) < 1e-8
    assert gap < shape.error_estimate < 1e-5


def test_a_loop_is_closed_and_the_end_of_a_branch_hangs_free():
    """Two ways from one junction to the other; each of them is held by the other alone."""
    ring, left, right = CABLE.replace(length=0.3), turned(0.7), turned(-0.7)
    joints = [
        cs.Junction("in", ("a.end", "up.start", "down.start"), frames={"up.start": left, "down.start": right}),
        cs.Junction("out", ("up.end", "down.end", "b.start"), frames={"up.end": right, "down.end": left}),
    ]
    harness = cs.Harness({"a": CABLE, "up": ring, "down": ring, "b": CABLE}, joints)
    assert len(harness.parts()) == 1
    shape = cs.predict(harness, {"a.start": START})
    assert shape.status is cs.Status.OK
    assert max(balance(shape)) < 1e-8
    np.testing.assert_allclose(shape.segments["b"].force[-1], 0.0, atol=1e-12)


def test_clips_and_masses_hold_and_load_the_segment_that_they_name():
    held = cs.Clip(0.15, cs.Pose((0.65, 0.0, -0.35)), "ball", name="table", segment="c")
    load = cs.PointMass(0.3, 0.05, segment="a")
    scene = cs.Scene(clips=[held], masses=[load])
    shape = cs.predict(fork(), ENDS, scene=scene, points=151)
    assert shape.status is cs.Status.OK
    assert max(balance(shape)[:2]) < 1e-8
    branch = shape.segments["c"]
    np.testing.assert_allclose(branch.positions[75], held.pose.position, atol=1e-9)
    jump = branch.force[76] - branch.force[74] - (0.0, 0.0, 2 * 0.002 * 0.1 * 9.81)
    (on_clip,) = shape.clips
    assert branch.clips[0].arc_length == on_clip.arc_length == 0.15
    np.testing.assert_allclose(on_clip.force, jump, atol=2e-2 * np.abs(jump).max() + 1e-3)
    trunk = shape.segments["a"].force
    np.testing.assert_allclose(
        trunk[76] - trunk[74] - (0.0, 0.0, 2 * 0.004 * 0.1 * 9.81), (0.0, 0.0, 0.05 * 9.81), atol=1e-9
    )
    weights = 0.1 * (0.6 + 0.6 + 0.3) + 0.05
    total = shape.segments["a"].force[0] - shape.segments["b"].force[-1] + on_clip.force
    np.testing.assert_allclose(total, (0.0, 0.0, -9.81 * weights), atol=1e-8)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("what", ["mass", "section", "acceleration"])
def test_what_changes_nothing_on_a_branch_that_hangs_free_moves_nothing(share, what):
    """A mass of nothing, a section like the rest, a table of no acceleration: each makes a knot between two spans."""
    arm = CABLE.replace(length=0.3, rest_curvature=(1.0, 0.5, 0.0))
    plain, other, keywords = fork(arm=arm), fork(arm=arm), {}
    if what == "mass":
        keywords["scene"] = cs.Scene(masses=[cs.PointMass(0.3 * share, 1e-12, segment="c")])
    elif what == "section":
        part = cs.Section(0.3 * share, 0.3 * share + 0.02, linear_density=CABLE.linear_density)
        other = fork(arm=arm.replace(sections=[part]))
    else:
        keywords["acceleration"] = {"c": ((0.0, 0.0, 0.0), (0.0, 0.0, share * 1e-9), (0.0, 0.0, 0.0))}
    one = cs.predict(plain, ENDS, tolerance=1e-8)
    two = cs.predict(other, ENDS, tolerance=1e-8, **keywords)
    assert two.status is cs.Status.OK
    for name, shape in one.segments.items():
        assert np.abs(shape.positions - two.segments[name].positions).max() < 1e-8


def test_an_accelerated_harness_feels_its_inertia():
    """Uniform: as if gravity were another. Of one segment alone: forces say so. Afterwards it is at rest again."""
    predictor = cs.Predictor(fork(mass=0.02))
    rest = predictor.predict(ENDS)
    a = np.array((1.0, -2.0, 3.0))
    moved = predictor.predict(ENDS, acceleration=dict.fromkeys("abc", a))
    other = cs.predict(fork(mass=0.02), ENDS, gravity=np.array((0.0, 0.0, -9.81)) - a)
    for name, shape in moved.segments.items():
        assert np.abs(shape.positions - other.segments[name].positions).max() < 1e-6
    table = np.array(((0.0, 0.0, 0.0), (5.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    swung = predictor.predict(ENDS, acceleration={"c": table})
    assert max(balance(swung)[:2]) < 1e-8
    np.testing.assert_allclose(swung.segments["c"].force[0, 0], -0.1 * 0.5 * 5.0 * 0.3, atol=1e-9)
    again = predictor.predict(ENDS)
    assert np.abs(again.segments["c"].positions - rest.segments["c"].positions).max() < 1e-6


def test_an_overstretched_harness_says_what_it_lacks():
    shape = cs.predict(fork(), {"a.start": START, "b.end": cs.Pose((1.5, 0.0, 0.0), ALONG)})
    assert shape.status is cs.Status.OVERSTRETCHED
    assert not shape.usable
    assert shape.missing_length == pytest.approx(0.3)
    assert "'a.start'" in shape.detail
    assert np.isfinite(shape.segments["a"].positions).all()


def test_a_loop_that_cannot_close_says_so():
    """Three grips on a fork, each two near enough, all three not."""
    arm = CABLE.replace(length=0.5)
    joint = cs.Junction("fork", ("a.end", "b.start", "c.start"), "ball")
    harness = cs.Harness({"a": arm, "b": arm, "c": arm}, [joint])
    corners = [cs.Pose((0.55 * math.cos(x), 0.55 * math.sin(x), 0.0), ALONG) for x in (0.0, 2.0944, 4.1888)]
    shape = cs.predict(harness, dict(zip(("a.start", "b.end", "c.end"), corners, strict=True)))
    assert shape.status is cs.Status.OVERSTRETCHED
    assert shape.missing_length == pytest.approx(0.15, rel=0.1)


# -- warm starts, derivatives


def path(k: int) -> dict[str, cs.Pose]:
    return {"a.start": START, "b.end": cs.Pose((0.8 - 0.01 * k, 0.1 + 0.01 * k, 0.1), ALONG)}


def test_a_predictor_goes_on_from_its_last_shape():
    predictor = cs.Predictor(fork(mass=0.02))
    shapes = [predictor.predict(path(k)) for k in range(12)]
    assert all(shape.status is cs.Status.OK for shape in shapes)
    assert max(shape.iterations for shape in shapes[2:]) <= 6
    cold = cs.predict(fork(mass=0.02), path(11))
    for name, shape in shapes[-1].segments.items():
        assert np.abs(shape.positions - cold.segments[name].positions).max() < 1e-5
    again = predictor.predict(path(11))
    assert again.reused
    assert again.iterations == 0


def test_a_grip_that_opens_lets_its_end_hang():
    predictor = cs.Predictor(fork())
    held = predictor.predict({**path(0), "c.end": cs.Grip(cs.Pose((0.55, 0.1, -0.45), ALONG), "pinned")})
    assert held.status is cs.Status.OK
    assert predictor.grips == ("a.start", "b.end", "c.end")
    free = predictor.predict(path(0))
    assert free.usable
    assert predictor.grips == ("a.start", "b.end")
    np.testing.assert_allclose(free.segments["c"].force[-1], 0.0, atol=1e-12)
    cold = cs.predict(fork(), path(0))
    assert np.abs(free.segments["c"].positions - cold.segments["c"].positions).max() < 1e-5
    plug = predictor.predict({**path(0), "c.end": cs.FreeEnd(mass=0.03)})
    np.testing.assert_allclose(plug.segments["c"].force[-1], (0.0, 0.0, -0.03 * 9.81), atol=1e-12)


@pytest.mark.parametrize("kind", ["rigid", "ball"])
def test_sensitivities_are_differences(kind):
    """By every number of both grips, one of which is a swivel, and one with an offset as seen from the gripper."""
    grip = cs.Grip(END, "swivel", offset=cs.Pose((0.0, 0.01, 0.03)))
    predictor = cs.Predictor(fork(kind), tolerance=1e-9 * 0.6, points=31)
    predictor.predict({"a.start": START, "b.end": grip})
    found = predictor.sensitivity(at="gripper")
    assert [columns.shape for columns in found.values()] == [(31, 3, 12)] * 3
    step = 1e-5
    for g, pose in enumerate((START, grip.pose)):
        for axis in range(6):
            shapes = []
            for sign in (1.0, -1.0):
                twist = np.zeros(6)
                twist[axis] = sign * step
                half = 0.5 * twist[3:]
                turn = cs.Pose(quaternion=(*half, math.sqrt(1.0 - half @ half)))
                moved = cs.Pose(pose.position + twist[:3], (turn * cs.Pose(quaternion=pose.quaternion)).quaternion)
                ends = {"a.start": moved, "b.end": grip} if g == 0 else {"a.start": START, "b.end": grip.at(moved)}
                shapes.append(predictor.predict(ends))
            for name, columns in found.items():
                one, other = (shape.segments[name].positions for shape in shapes)
                difference = (one - other) / (2.0 * step)
                np.testing.assert_allclose(columns[:, :, 6 * g + axis], difference, atol=2e-5, rtol=1e-3)


# -- cycles


def test_a_cycle_checks_every_segment_of_a_harness():
    """Against a table and against segments that it does not meet; a plain cable beside it as ever."""
    limited = CABLE.replace(length=0.3, max_tension=0.01, diameter=0.01)
    lowest = cs.predict(fork(arm=limited), path(3)).segments["c"].positions[:, 2].min()
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, lowest - 0.025)))
    cycle = cs.Cycle({"h": fork(arm=limited), "alone": CABLE}, scene=cs.Scene(obstacles=[table]))
    seen = []
    for k in range(4):
        grips = {"h": path(k), "alone": (cs.Pose((0.0, 1.0, 0.0), ALONG), cs.Pose((0.4, 1.0, 0.0), ALONG))}
        report = cycle.step(grips, stamp=10_000_000 * k, early=seen.append)
    shape = report.shapes["h"]
    assert isinstance(shape, cs.HarnessShape)
    assert shape.status is cs.Status.OK
    assert seen[-1]["h"] is shape
    assert set(report.clearance) == set(report.margins) == {"alone", "h/a", "h/b", "h/c"}
    distances = {body.body: body.distance for body in report.clearance["h/c"].bodies}
    assert distances["table"] == pytest.approx(0.02, abs=1e-4)
    assert "h/a" not in distances  # they meet
    told = {(warning.cable_id, warning.kind) for warning in report.warnings}
    assert ("h/c", cs.WarningKind.TENSION) in told
    moved = cycle.step({"h": path(3)}, stamp=50_000_000, acceleration={"h": {"c": (1.0, 0.0, 0.0)}})
    assert np.abs(moved.shapes["h"].segments["c"].positions - shape.segments["c"].positions).max() > 1e-3
    with pytest.raises(cs.ArgumentError, match="no such cable"):
        cycle.step({"x": path(0)}, stamp=60_000_000)
    cycle.reset()
    assert cycle.step({"h": path(0)}, stamp=0).shapes["h"].usable


def test_a_gripping_link_is_a_body_to_a_segment_that_no_gripper_can_hold():
    """As near to a junction as a gripper is to the end that it holds."""
    joints = [cs.Junction("j", ("a.end", "b.start")), cs.Junction("k", ("b.end", "c.start"))]
    short = CABLE.replace(length=0.3)
    harness = cs.Harness({"a": short, "b": short, "c": short}, joints)
    ends = {"a.start": START, "c.end": cs.Pose((0.8, 0.0, 0.0), ALONG)}
    joint = cs.predict(harness, ends).junctions["j"].position
    finger = cs.Obstacle("finger", cs.Sphere(0.01), link="finger")
    cycle = cs.Cycle({"h": harness}, robot_links=[finger], gripping_links=["finger"])
    report = cycle.step({"h": ends}, stamp=0, links={"finger": cs.Pose(joint + np.array((0.0, 0.0, 0.03)))})
    assert report.clearance["h/b"].closest.distance < 0.02
    (near,) = (w.text for w in report.warnings if w.cable_id == "h/b" and w.other == "finger")
    assert "m from its start (" in near, "no grip holds it there"
    assert report.clearance["h/a"].closest.distance > 0.02, "as near to the end that may be held it is no body"


def test_segments_that_do_not_meet_are_checked_against_each_other():
    """Two branches of one trunk, their ends held next to each other."""
    joints = [
        cs.Junction("one", ("a.end", "b.start", "x.start"), frames={"x.start": turned(1.2)}),
        cs.Junction("two", ("b.end", "c.start", "y.start"), frames={"y.start": turned(1.2)}),
    ]
    short = CABLE.replace(length=0.4)
    harness = cs.Harness({"a": short, "b": short, "c": short, "x": short, "y": short}, joints)
    ends = {"a.start": START, "c.end": cs.Pose((1.1, 0.0, 0.0), ALONG)}
    for name, x in (("x", 0.50), ("y", 0.52)):
        ends[f"{name}.end"] = cs.Grip(cs.Pose((x, -0.2, -0.2), ALONG), "pinned")
    report = cs.Cycle({"h": harness}).step({"h": ends}, stamp=0)
    assert report.shapes["h"].usable
    distances = {body.body: body.distance for body in report.clearance["h/x"].bodies}
    assert distances["h/y"] < 0.02
    assert "h/b" not in distances


# -- files


def test_a_harness_is_read_as_it_is_written(tmp_path):
    harness = fork(mass=0.02)
    file = tmp_path / "fork.yaml"
    harness.to_yaml(file)
    assert cs.Harness.from_yaml(file) == harness
    (tmp_path / "branch.yaml").write_text("{length: 0.3, linear_density: 0.1, bending_stiffness: 0.01}\n")
    file.write_text(
        "segments: {a: branch.yaml, b: {length: 0.3, linear_density: 0.1, bending_stiffness: 0.01}}\n"
        "junctions: [{name: j, ends: [a.end, b.start]}]\n"
    )
    read = cs.Harness.from_yaml(file)
    assert read.segments["a"] == read.segments["b"]
    file.write_text("segments: {a: branch.yaml}\njunctons: []\n")
    with pytest.raises(cs.UnknownKeyError, match=r"Did you mean .junctions."):
        cs.Harness.from_yaml(file)


# -- bad input


def joined(*ends: str, **keywords: object) -> cs.Harness:
    return cs.Harness({"a": CABLE, "b": CABLE}, [cs.Junction("j", ends, **keywords)])


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: joined("a.end", "c.start"), r"junction 'j': ends = 'c.start' .* no such end .* segments: a, b"),
        (lambda: joined("a.end", "a.end"), r"'a.end' .* in junction 'j' already"),
        (lambda: joined("a.end"), r"junction 'j': ends = \['a.end'\] .* at least two"),
        (lambda: joined("a.end", "b.start", kind="hinge"), r"junction 'j': kind = 'hinge' .* rigid, ball"),
        (lambda: joined("a.end", "b.start", mass=-1.0), r"junction 'j': mass = -1.0 .* at least 0"),
        (lambda: joined("a.end", "b.start", frames={"b.end": cs.Pose()}), r"unknown key 'b.end'"),
        (
            lambda: joined("a.end", "b.start", kind="ball", frames={"b.start": cs.Pose((0.1, 0, 0))}),
            r"a ball joins its ends in one point",
        ),
        (lambda: cs.Harness({}), r"segments = \{\}"),
        (lambda: cs.Harness({"a": "cable"}), r"segments\['a'\] = 'cable' .* must be a Cable"),
        (lambda: cs.Harness({"a/b": CABLE}), r"'/' is not allowed"),
        (
            lambda: fork().replace(segments={**fork().segments, "a": CABLE.replace(tails={"end": 0.1})}),
            r"segments\['a'\].tails = {'end': 0.1} .* a.end is in junction 'fork'",
        ),
        (lambda: cs.Harness({"a": cs.Cable(1.0, 0.1, 0.0)}), r"segments\['a'\].bending_stiffness"),
        (lambda: cs.predict(fork(), {"a.end": START}), r"'a.end' .* in junction 'fork'"),
        (lambda: cs.predict(fork(), {"d.end": START}), r"'d.end' .* no such end .* a.start, b.end, c.end"),
        (lambda: cs.predict(fork(), {}), r"nothing holds the part with the segments a, b, c"),
        (lambda: cs.predict(fork(), START), r"ends = .* must be a Mapping"),
        (lambda: cs.predict(fork(), {"a.start": (0, 0, 0)}), r"a.start = .* a Pose or Grip or FreeEnd"),
        (lambda: cs.predict(fork(), {"a.start": cs.Pose(turns=1)}), r"a.start: turns = 1"),
        (lambda: cs.predict(fork(), START, END), r"the ends of a harness are one mapping"),
        (lambda: cs.predict(CABLE, START), r"end is missing"),
        (lambda: cs.Predictor(fork()).predict(START, END), r"the ends of a harness are one mapping"),
        (lambda: cs.Predictor(CABLE).predict(ENDS), r"end is missing. Write predict\(start, end\)"),
        (lambda: cs.Motion(fork()).begin(START, END), r"the ends of a harness are one mapping"),
        (lambda: cs.Motion(CABLE).begin(ENDS), r"end is missing. Write begin\(start, end\)"),
        (
            lambda: cs.Harness.from_mapping({"segments": {"a": PLAIN}, "junctions": [ZERO]}),
            r"junctions\[0\]: frames\['a.end'\]: quaternion = .* its length is 0",
        ),
        (lambda: cs.predict(fork(), ENDS, model="gradient4"), r"model = 'gradient4'"),
        (
            lambda: cs.predict(fork(), ENDS, scene=cs.Scene(masses=[cs.PointMass(0.1, 0.1)])),
            r"masses\[0\].segment = None",
        ),
        (
            lambda: cs.predict(CABLE, START, END, scene=cs.Scene(masses=[cs.PointMass(0.1, 0.1, segment="a")])),
            r"PointMass.segment = 'a' .* a cable has no segments",
        ),
        (lambda: cs.predict(fork(), ENDS, acceleration={"x": (0, 0, 0)}), r"unknown key 'x'"),
        (lambda: cs.predict(fork(), ENDS, acceleration={"a": (0, 0)}), r"segment 'a': acceleration"),
        (lambda: cs.Predictor("cable"), r"cable = 'cable' .* a Cable or a Harness"),
        (lambda: cs.Cycle(fork()), r"a harness needs a name"),
        (lambda: cs.Predictor(fork()).sensitivity(), r"there is none yet"),
    ],
)  # fmt: skip
def test_bad_input_names_the_part(make, told):
    with pytest.raises(cs.ArgumentError, match=told):
        make()


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda h, c: cs.stress_of(h, cs.predict(c, START, END)), r"cable = Harness\(.* must be a Cable"),
        (lambda h, c: cs.stress_of(c, cs.predict(h, ENDS)), r"shape = HarnessShape\(.* must be a CableShape"),
        (lambda h, c: cs.predict_tails(h, START, END), r"cable = Harness\(.* must be a Cable"),
        (lambda h, c: cs.predict_tube(h, START, END), r"found = Harness\(.* must be a Calibration"),
        (lambda h, c: HarnessPredictor(c), r"harness = Cable\(.* must be a Harness"),
        (lambda h, c: cs.Harness({"a": h}), r"segments\['a'\] = Harness\(.* must be a Cable"),
        (lambda h, c: cs.calibrate([cs.HarnessObservation({}, {"a": POINTS})], c), r"must be a Observation"),
        (lambda h, c: cs.calibrate([cs.Observation(START, END, POINTS)], h), r"must be a HarnessObservation"),
        (lambda h, c: cs.predict_batch(h, START.array[None], END.array[None]), r"ends = .* it is known of cables only"),
        (lambda h, c: cs.predict_batch(c, {"a.start": START.array[None]}, None), r"starts = .* must be numbers"),
        (lambda h, c: cs.Cycle({"c": c}).step({"c": ENDS}, 0), r"grips\['c'\] = .* must be \(start, end\)"),
        (lambda h, c: cs.Cycle({"h": h}).step({"h": (START, END)}, 0), r"ends = .* must be a Mapping"),
        (
            lambda h, c: cs.check_trajectory(h, None, None, cs.GripPath(START.array[None], END.array[None])),
            r"the ends of a harness have names",
        ),
        (
            lambda h, c: cs.check_trajectory(c, None, None, cs.EndsPath({"a.start": START.array[None]})),
            r"trajectory = .* must be a JointPath, a GripPath",
        ),
    ],
)
def test_a_harness_where_a_cable_is_asked_and_the_reverse(make, told):
    with pytest.raises(cs.ArgumentError, match=told):
        make(fork(), CABLE)


def test_a_harness_in_two_parts_is_held_in_both():
    harness = cs.Harness({"a": CABLE, "b": CABLE})
    with pytest.raises(cs.ArgumentError, match="nothing holds the part with the segments b"):
        cs.predict(harness, {"a.start": START})
    shape = cs.predict(harness, {"a.start": START, "b.end": END})
    assert shape.status is cs.Status.OK
    alone = cs.predict(CABLE, START, None)
    np.testing.assert_allclose(shape.segments["a"].positions, alone.positions, atol=1e-5)


def test_the_command_line_predicts_a_case_of_a_harness(tmp_path, capsys):
    from cable_shape.command.cli import main

    fork(mass=0.02).to_yaml(tmp_path / "fork.yaml")
    case = tmp_path / "case.yaml"
    quaternion = list(ALONG)
    case.write_text(
        "harness: fork.yaml\nends:\n"
        f"  a.start: {{position: [0, 0, 0], quaternion: {quaternion}}}\n"
        f"  b.end: {{position: [0.8, 0.1, 0.1], quaternion: {quaternion}, kind: swivel}}\n"
        "  c.end: {mass: 0.01}\npoints: 21\n"
    )
    out = [tmp_path / "shape.json", tmp_path / "shape.csv"]
    assert main(["predict", str(case), "-o", str(out[0]), "-o", str(out[1])]) == 0
    printed = capsys.readouterr().out
    assert "junction fork" in printed
    assert "force on the grip at b.end" in printed
    told = json.loads(out[0].read_text())
    assert told["status"] == "OK"
    assert list(told["segments"]) == ["a", "b", "c"]
    assert np.loadtxt(out[1], delimiter=",", skiprows=1).shape == (63, 18)
    case.write_text("harness: fork.yaml\nends: {c.start: {position: [0, 0, 0]}}\n")
    assert main(["predict", str(case)]) != 0
    assert "it is in junction 'fork'" in capsys.readouterr().err
