"""Segments of a harness that touch each other and themselves: the same as one cable, balance, derivatives, joints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.solve.touching.one_harness import joined_ends

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
SOLVE = cs.Scene(contact="solve")
ARM = cs.Cable(0.5, 0.05, 0.01, 0.008, diameter=0.008)
TWISTED = cs.Cable(1.0, 0.005, 0.004, 0.003, diameter=0.008)


def posed(place, yaw=0.0):
    """A pose whose d3 is the x axis turned by an angle [degrees] about z."""
    return cs.Pose(place, (Rotation.from_euler("z", yaw, degrees=True) * ALONG_X).as_quat())


def leaving(yaw):
    """Frame of an end that leaves a junction along x at that angle."""
    turn = ALONG_X.inv() * Rotation.from_euler("z", yaw, degrees=True) * ALONG_X
    return cs.Pose((0.0, 0.0, 0.0), turn.as_quat())


def forked(cable=ARM, yaw=25.0):
    """A stem that forks into two arms."""
    frames = {"l.start": leaving(yaw), "r.start": leaving(-yaw)}
    return cs.Harness(
        dict.fromkeys(("stem", "l", "r"), cable), [cs.Junction("j", ("stem.end", *frames), frames=frames)]
    )


def crossed(height):
    """Its ends, arms led over each other, the left one that high [m]."""
    return {
        "stem.start": posed((-0.48, 0.0, 0.0)),
        "l.end": posed((0.42, -0.12, height), -35.0),
        "r.end": posed((0.42, 0.12, 0.0), 35.0),
    }


DOWN = np.linspace(0.06, -0.06, 25)


def lowered(predictor, heights=DOWN):
    """The shapes as the left arm is let down onto the right one."""
    shapes = [predictor.predict(crossed(height)) for height in heights]
    assert all(shape.status is cs.Status.OK for shape in shapes)
    return shapes


def gap(shape, one="l", other="r"):
    """[m], least distance of surfaces of two segments more than 0.1 m of cable apart."""
    a, b = (shape.segments[name] for name in (one, other))
    apart = np.linalg.norm(a.positions[:, None] - b.positions, axis=2)
    return apart[np.add.outer(a.arc_length, b.arc_length) > 0.1].min() - ARM.diameter


def test_arms_of_a_fork_lie_on_each_other_and_carry_what_they_press():
    shapes = lowered(cs.Predictor(forked(), scene=SOLVE))
    free = lowered(cs.Predictor(forked()))
    assert min(gap(shape) for shape in free) < -0.5 * ARM.diameter
    assert min(gap(shape) for shape in shapes) > -2e-5
    for shape, alone in zip(shapes, free, strict=True):
        if gap(alone) > 1e-3 and not shape.segments["l"].contacts:
            np.testing.assert_allclose(shape.buffer, alone.buffer, atol=1e-9)
    last = shapes[-1]
    (on_l,), (on_r,) = last.segments["l"].contacts, last.segments["r"].contacts
    assert (on_l.body, on_r.body) == ("r", "l")
    assert on_l.force == on_r.force > 0.05
    np.testing.assert_allclose(on_l.normal, -on_r.normal, atol=1e-12)
    weight = ARM.linear_density * ARM.length * 9.81
    for name, contact in (("l", on_l), ("r", on_r)):
        force = last.segments[name].force
        held = force[-1] - force[0] + contact.force * contact.normal
        np.testing.assert_allclose(held, (0.0, 0.0, weight), atol=1e-6)
    stem, left, right = (last.segments[name].force for name in ("stem", "l", "r"))
    np.testing.assert_allclose(left[0] + right[0] - stem[-1], 0.0, atol=1e-6)


def test_two_segments_joined_straight_touch_as_one_cable_touches_itself():
    cut = 0.37
    halves = {"a": TWISTED.replace(length=cut), "b": TWISTED.replace(length=TWISTED.length - cut)}
    harness = cs.Harness(halves, [cs.Junction("j", ("a.end", "b.start"))])
    one = cs.Predictor(TWISTED, scene=SOLVE)
    two = cs.Predictor(harness, scene=SOLVE)
    for turns in np.arange(0.3, 1.2, 0.01):
        turn = Rotation.from_rotvec((2.0 * math.pi * turns, 0.0, 0.0)) * ALONG_X
        start, end = posed((0.0, 0.0, 0.0)), cs.Pose((0.3, 0.0, 0.0), turn.as_quat())
        whole, parts = one.predict(start, end), two.predict({"a.start": start, "b.end": end})
        assert whole.status is parts.status is cs.Status.OK
        at = np.concatenate((parts.segments["a"].arc_length, cut + parts.segments["b"].arc_length))
        places = np.vstack([part.positions for part in parts.segments.values()])
        expected = np.column_stack([np.interp(at, whole.arc_length, x) for x in whole.positions.T])
        assert np.abs(places - expected).max() < 1e-4 * TWISTED.length  # compared in straight lines between points
    pressed = {name: [c.body for c in part.contacts] for name, part in parts.segments.items()}
    assert len(whole.contacts) == sum(map(len, pressed.values())) == 2
    assert sum(c.force for c in whole.contacts) == pytest.approx(
        sum(c.force for part in parts.segments.values() for c in part.contacts), rel=1e-3
    )


def test_derivatives_are_differences_where_segments_touch():
    predictor = cs.Predictor(forked(), scene=SOLVE, tolerance=1e-7)
    lowered(predictor)
    told = predictor.sensitivity(("l.end", "bending_stiffness:r"))
    assert predictor.touching
    step = 1e-4
    for axis in range(3):
        sides = []
        for sign in (-1.0, 1.0):
            ends, place = crossed(-0.06), np.zeros(3)
            place[axis] = sign * step
            pose = ends["l.end"]
            ends["l.end"] = cs.Pose(pose.position + place, pose.quaternion)
            sides.append(predictor.ahead()(ends))
        for name in ("stem", "l", "r"):
            found = (sides[1].segments[name].positions - sides[0].segments[name].positions) / (2.0 * step)
            np.testing.assert_allclose(told[name][:, :, axis], found, atol=2e-3)
    stiff = []
    for factor in (0.99, 1.01):
        segments = {**forked().segments, "r": ARM.replace(bending_stiffness=factor * 0.01)}
        beside = predictor.beside(predictor.harness.replace(segments=segments))
        stiff.append(beside.predict(crossed(-0.06)))
    for name in ("stem", "l", "r"):
        found = (stiff[1].segments[name].positions - stiff[0].segments[name].positions) / (0.02 * 0.01)
        np.testing.assert_allclose(told[name][:, :, 6], found, atol=0.03 * np.abs(told[name][:, :, 6]).max())
    shape = predictor.predict(crossed(-0.06))
    assert shape.reused  # all that was asked beside it left it as it is


def test_arms_led_back_come_free_and_nothing_is_left_of_it():
    predictor = cs.Predictor(forked(), scene=SOLVE)
    lowered(predictor)
    back = lowered(predictor, DOWN[::-1])[-1]
    assert not predictor.touching
    assert not any(part.contacts for part in back.segments.values())
    alone = cs.predict(forked(), crossed(0.06))
    np.testing.assert_allclose(back.buffer, alone.buffer, atol=1e-5)
    predictor.predict(crossed(-0.06))  # too far at once, one arm through the other
    predictor.reset()
    assert predictor.predict(crossed(0.06)).status is cs.Status.OK


def test_grips_that_hold_arms_inside_each_other_are_named():
    predictor = cs.Predictor(forked(), scene=SOLVE)
    ends = crossed(0.0)
    ends["r.end"] = cs.Pose(
        ends["l.end"].position + np.array((0.0, 0.003, 0.0)), posed((0.0, 0.0, 0.0), 35.0).quaternion
    )
    shape = predictor.predict(ends)
    assert shape.status is cs.Status.NOT_CONVERGED
    assert "grips hold cable 'l' at its end inside 'r' at its end: 0.0030 m apart, where 0.0080 m" in shape.detail


def test_what_hangs_together_does_not_touch_there():
    cable, bit = ARM, ARM.replace(length=0.01)
    harness = cs.Harness(
        {"a": cable, "b": cable, "c": cable, "bit": bit, "d": cable},
        [
            cs.Junction("j", ("a.end", "b.start", "bit.start"), frames={"b.start": leaving(90.0)}),
            cs.Junction("k", ("bit.end", "c.start"), kind="ball"),
        ],
    )
    found = joined_ends(harness)
    reach = cable.diameter
    right_angle = math.pi * reach
    assert found[0, 1] == pytest.approx(np.array(((0.0, 0.0), (right_angle, 0.0))))
    assert found[0, 2][1, 0] == pytest.approx(math.pi * reach - 0.01)  # the bit lies between
    assert found[2, 3][0, 1] == pytest.approx(math.pi * reach)
    assert all(4 not in pair for pair in found)
    sharp = joined_ends(forked(yaw=10.0))
    assert sharp[1, 2][0, 0] == pytest.approx(1.5 * reach / math.sin(math.radians(10.0)))
    assert math.isinf(joined_ends(forked(yaw=1.0))[1, 2][0, 0])


def test_arms_that_leave_at_a_sharp_angle_have_their_shape():
    """They overlap where they part, as they were made."""
    predictor = cs.Predictor(forked(yaw=8.0), scene=SOLVE)
    ends = {
        "stem.start": posed((-0.48, 0.0, 0.0)),
        "l.end": posed((0.47, 0.08, 0.0), 8.0),
        "r.end": posed((0.47, -0.08, 0.0), -8.0),
    }
    shape = predictor.predict(ends)
    assert shape.status is cs.Status.OK
    assert not predictor.touching


def test_a_cycle_keeps_segments_out_of_each_other_and_tells_the_contact():
    cycle = cs.Cycle({"h": forked()}, scene=SOLVE)
    for k, height in enumerate(DOWN):
        report = cycle.step({"h": crossed(height)}, stamp=10_000_000_000 * k)
        assert report.shapes["h"].status is cs.Status.OK
    assert gap(report.shapes["h"]) > -2e-5
    assert not report.warnings
    assert [contact.body for contact in report.shapes["h"].segments["l"].contacts] == ["h/r"]
