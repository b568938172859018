"""Derivatives of a cable in contact, by what holds it, by the body that it lies on and by its numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.solve.answers import NUMBERS

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(1.2, 0.1, (0.02, 0.01), 0.008, diameter=0.008)
START, END = cs.Pose((0.0, 0.0, 0.35), ALONG_X), cs.Pose((0.8, 0.05, 0.3), ALONG_X)
#: Under the cable's lowest part, along y: it bends over it and touches it once.
POST = cs.Pose((0.42, 0.0, -0.06), Rotation.from_euler("x", 90.0, degrees=True).as_quat())
CLIP = cs.Clip(0.2, cs.Pose((0.15, 0.0, 0.26)), "ball", "tie")


def scene(post: cs.Pose = POST, clips=()) -> cs.Scene:
    return cs.Scene(obstacles=[cs.Obstacle("post", cs.Capsule(0.03, 0.6), post)], clips=clips, contact="solve")


def predicted(cable: cs.Cable = CABLE, clips=()) -> cs.Predictor:
    predictor = cs.Predictor(cable, scene=scene(clips=clips), model="cosserat")
    shape = predictor.predict(START, END)
    assert shape.status is cs.Status.OK
    assert [contact.body for contact in shape.contacts] == ["post"]
    return predictor


@pytest.mark.parametrize("clips", [(), (CLIP,)], ids=["without clips", "in a clip"])
def test_a_body_that_moves_takes_the_cable_along_as_differences_say(clips):
    predictor = predicted(clips=clips)
    columns = predictor.sensitivity(("body:post",))
    assert columns.shape == (150, 3, 6)
    for axis in range(6):
        seen = []
        size = 1e-5
        for sign in (1.0, -1.0):
            place, turn = np.array(POST.position), Rotation.from_quat(POST.quaternion)
            if axis < 3:
                place[axis] += sign * size
            else:
                turn = Rotation.from_rotvec(sign * size * np.eye(3)[axis - 3]) * turn
            predictor.scene = scene(cs.Pose(place, turn.as_quat()), clips)
            shapes = [predictor.predict(START, END) for _ in range(3)]
            seen.append(shapes[-1].positions)
        expected = (seen[0] - seen[1]) / (2.0 * size)
        assert columns[:, :, axis] == pytest.approx(expected, abs=5e-3 * max(np.abs(columns).max(), 0.1))
        predictor.scene = scene(POST, clips)
        predictor.predict(START, END)
    assert np.abs(columns[:, :, 2]).max() > 0.3  # lifted, it lifts the cable


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_of_the_cable_change_the_shape_as_differences_say(name):
    columns = predicted().sensitivity((name,))
    value = getattr(CABLE, name)
    step, seen = 2e-3, []
    for sign in (1.0, -1.0):
        changed = np.multiply(value, 1.0 + sign * step)
        changed = tuple(changed.tolist()) if name == "bending_stiffness" else float(changed)
        predictor = predicted(CABLE.replace(**{name: changed}))
        seen.append(predictor.predict(START, END).positions)
    mean = float(np.mean(value))
    expected = (seen[0] - seen[1]) / (2.0 * step * mean)
    assert columns[:, :, 0] == pytest.approx(expected, abs=2e-2 * np.abs(columns).max() + 2e-6 / (step * mean))


def test_a_clip_that_moves_does_so_too():
    predictor = predicted(clips=(CLIP,))
    columns = predictor.sensitivity(("end", "clip:tie"))
    assert columns.shape == (150, 3, 12)
    assert columns[:, :, :6] == pytest.approx(predictor.sensitivity()[:, :, 6:], abs=1e-12)
    size = 1e-5
    for axis in range(3):
        seen = []
        for sign in (1.0, -1.0):
            place = np.array(CLIP.pose.position)
            place[axis] += sign * size
            predictor.scene = scene(clips=(cs.Clip(0.2, cs.Pose(place), "ball", "tie"),))
            seen.append([predictor.predict(START, END) for _ in range(3)][-1].positions)
        expected = (seen[0] - seen[1]) / (2.0 * size)
        assert columns[:, :, 6 + axis] == pytest.approx(expected, abs=5e-3)
    assert columns[:, :, 9:] == pytest.approx(0.0, abs=1e-12)  # a ball lets it turn


def test_bodies_that_are_not_touched_and_names_that_are_none():
    free = cs.Predictor(CABLE, scene=scene(cs.Pose((0.4, 0.0, -1.0))), model="cosserat")
    free.predict(START, END)
    assert not free.sensitivity(("body:post",)).any()
    with pytest.raises(cs.ArgumentError, match="the shape knows no derivative by it"):
        predicted().sensitivity(("body:drum",))
    assert math.isclose(float(np.abs(predicted().sensitivity(("length",))).max()), 0.0) is False
