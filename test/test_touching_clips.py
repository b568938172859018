"""Clips and contact in one equilibrium: against cables in parts, balances of force and moment, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.models.touching import DEEPEST

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
WEIGHT = 0.1 * 9.81
START, END = cs.Pose((0, 0, 0.3), ALONG_X), cs.Pose((0.8, 0, 0.3), ALONG_X)


def clip(kind, height=0.1, arc_length=0.5):
    return cs.Clip(arc_length, cs.Pose((0.35, 0.05, height), ALONG_X), kind)


def table(*clips, height=0.0):
    plate = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0, 0, height)))
    return cs.Scene(obstacles=[plate], clips=clips, contact="solve")


def lowered(kind, **options):
    """The shape after a motion in which the clip goes down to 0.1 m above the table."""
    predictor = cs.Predictor(CABLE, model="cosserat", **options)
    for height in np.arange(0.3, 0.095, -0.01):
        predictor.scene = table(clip(kind, height))
        shape = predictor.predict(START, END)
        assert shape.status is cs.Status.OK, (height, shape)
        assert shape.positions[:, 2].min() > 0.004 - 2.0 * DEEPEST
    assert shape.contacts
    return shape, predictor


@pytest.mark.parametrize("kind", ["ball", "hinge", "fixed"])
def test_far_from_all_bodies_it_is_the_cable_in_clips(kind):
    scene = table(clip(kind), height=-1.0)
    solved = cs.Predictor(CABLE, model="cosserat", scene=scene)
    plain = cs.Predictor(CABLE, model="cosserat", scene=scene.replace(contact="warn"))
    for height in (0.3, 0.301, 0.302):
        start = cs.Pose((0, 0, height), ALONG_X)
        a, b = plain.predict(start, END), solved.predict(start, END)
        assert np.array_equal(a.buffer, b.buffer)
        assert np.array_equal(a.supports, b.supports)


def test_beyond_a_fixed_clip_is_a_cable_of_its_own():
    whole, _ = lowered("fixed")
    rest = cs.predict(CABLE.replace(length=0.7), clip("fixed").pose, END, scene=table(), model="cosserat")
    assert rest.status is cs.Status.OK
    beyond = np.stack([np.interp(rest.arc_length + 0.5, whole.arc_length, whole.positions[:, i]) for i in range(3)], 1)
    assert np.linalg.norm(beyond - rest.positions, axis=1).max() < 5e-4 * CABLE.length
    pressed = [contact.force for contact in whole.contacts if contact.arc_length > 0.5]
    assert sum(pressed) == pytest.approx(sum(contact.force for contact in rest.contacts), rel=0.01)


@pytest.mark.parametrize("kind", ["ball", "hinge", "fixed"])
def test_clips_bodies_grips_and_weight_balance(kind):
    shape, _ = lowered(kind, points=1201)
    held = shape.clips[0]
    force = shape.force[-1] - shape.force[0] - held.force - (0, 0, WEIGHT * CABLE.length)
    moment = shape.moment[-1] - shape.moment[0] - held.moment - np.cross(clip(kind).pose.position, held.force)
    moment += np.cross(shape.positions[-1], shape.force[-1]) - np.cross(shape.positions[0], shape.force[0])
    moment += np.cross(np.trapezoid(shape.positions, shape.arc_length, axis=0), (0, 0, -WEIGHT))
    for contact in shape.contacts:
        force += contact.force * contact.normal
        moment += np.cross(contact.point, contact.force * contact.normal)
    assert force == pytest.approx((0, 0, 0), abs=1e-6)
    assert moment == pytest.approx((0, 0, 0), abs=2e-5)
    free = {"ball": np.eye(3), "hinge": np.array([(1.0, 0.0, 0.0)]), "fixed": np.zeros((0, 3))}[kind]
    assert free @ held.moment == pytest.approx(np.zeros(len(free)), abs=1e-6)  # the hinge's axis is the world's x


def test_a_fixed_clip_in_the_frame_that_a_ball_clip_leaves_changes_nothing():
    ball, _ = lowered("ball", points=1201)
    frame = cs.Pose(clip("ball").pose.position, ball.quaternions[500])
    scene = table(cs.Clip(0.5, frame, "fixed"))
    fixed = cs.predict(CABLE, START, END, scene=scene, model="cosserat", points=1201)
    assert fixed.status is cs.Status.OK
    assert np.linalg.norm(fixed.positions - ball.positions, axis=1).max() < 5e-4 * CABLE.length
    assert fixed.clips[0].force == pytest.approx(ball.clips[0].force, abs=0.01 * WEIGHT)
    assert fixed.clips[0].moment == pytest.approx((0, 0, 0), abs=2e-4)


@pytest.mark.parametrize("kind", ["hinge", "fixed"])
def test_cold_and_by_a_motion_are_the_same_shape(kind):
    shape, _ = lowered(kind)
    cold = cs.predict(CABLE, START, END, scene=table(clip(kind)), model="cosserat")
    assert cold.status is cs.Status.OK
    assert np.linalg.norm(cold.positions - shape.positions, axis=1).max() < 5e-4 * CABLE.length


def test_two_clips_with_a_mass_and_a_free_end():
    clips = (clip("ball", 0.05, 0.5), cs.Clip(0.8, cs.Pose((0.6, 0.05, 0.05), ALONG_X), "hinge"))
    scene = table(*clips).replace(masses=[cs.PointMass(0.6, 0.02), cs.PointMass(0.8, 0.01)])
    shape = cs.predict(CABLE, START, None, scene=scene, model="cosserat")
    assert shape.status is cs.Status.OK
    assert {contact.arc_length > 0.8 for contact in shape.contacts} == {False, True}
    total = sum(contact.force * contact.normal for contact in shape.contacts) - sum(c.force for c in shape.clips)
    assert total - shape.force[0] == pytest.approx((0, 0, WEIGHT * 1.2 + 0.03 * 9.81), abs=1e-5)


def test_a_clip_that_jumps_is_followed():
    predictor = cs.Predictor(CABLE, model="cosserat", scene=table(clip("ball", 0.25)))
    assert predictor.predict(START, END).contacts == ()
    predictor.scene = table(clip("ball", 0.1))
    shape = predictor.predict(START, END)
    assert shape.status is cs.Status.OK
    slow, _ = lowered("ball")
    assert np.linalg.norm(shape.positions - slow.positions, axis=1).max() < 5e-4 * CABLE.length


def test_a_clip_that_closes_keeps_the_warm_start():
    ball, predictor = lowered("ball", points=1201)
    frame = cs.Pose(clip("ball").pose.position, ball.quaternions[500])
    predictor.scene = table(cs.Clip(0.5, frame, "fixed"))
    fixed = predictor.predict(START, END)
    assert fixed.status is cs.Status.OK
    assert fixed.iterations < 10
    assert np.linalg.norm(fixed.positions - ball.positions, axis=1).max() < 1e-5 * CABLE.length


def test_sensitivity_in_clips_and_contact_is_that_of_finite_differences():
    _, predictor = lowered("ball", tolerance=1e-6)
    columns = predictor.sensitivity()
    step = 1e-4
    for axis in (0, 1, 2):
        shapes = []
        for sign in (1.0, -1.0):
            moved = END.position.copy()
            moved[axis] += sign * step
            shapes.append(predictor.predict(START, cs.Pose(moved, END.quaternion)))
        assert shapes[0].contacts
        difference = (shapes[0].positions - shapes[1].positions) / (2.0 * step)
        assert columns[:, :, 6 + axis] == pytest.approx(difference, abs=5e-3)


def test_eyelets_and_buried_clips_are_named():
    slide = clip("slide", arc_length=0.8)
    with pytest.raises(cs.ArgumentError, match=r"clips\[1\].*'slide'.*contact"):
        cs.Predictor(CABLE, model="cosserat", scene=table(clip("ball"), slide))
    predictor = cs.Predictor(CABLE, model="cosserat", scene=table(clip("ball")))
    with pytest.raises(cs.ArgumentError, match="slide"):
        predictor.scene = table(slide)
    assert predictor.scene == table(clip("ball"))
    shape = cs.predict(CABLE, START, END, scene=table(clip("ball", -0.01)), model="cosserat")
    assert shape.status is cs.Status.NOT_CONVERGED
    assert "clips[0] is 14.0 mm inside obstacle 'table'" in shape.detail
