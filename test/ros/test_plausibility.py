"""Grips that jump or change places, without ROS."""

import numpy as np
import pytest

from cable_shape.pose import Pose
from cable_shape.ros.plausibility import JumpWatch

MS = 1_000_000  # ns
START, END = Pose((0.0, 0.0, 0.5)), Pose((0.8, 0.0, 0.5))


def looked(start, end, after=8 * MS):
    watch = JumpWatch(("left_gripper/pose", "right_gripper/pose"))
    assert watch.look((START, END), 1000 * MS) is None  # nothing before it
    return watch.look((start, end), 1000 * MS + after)


def test_ordinary_motion_and_noise_are_not_remarked_on():
    assert looked(Pose((0.0, 0.016, 0.5)), END) is None  # 2 m/s
    assert looked(Pose((0.0, 0.099, 0.5)), END) is None  # below the shortest jump
    assert looked(Pose((0.0, 0.5, 0.5)), END, 100 * MS) is None  # 5 m/s after lost messages


@pytest.mark.parametrize(("side", "name"), [(0, "left"), (1, "right")])
def test_a_jump_of_half_a_metre_names_side_distance_and_time(side, name):
    ends = [START, END]
    ends[side] = Pose(ends[side].position + np.array((0.0, 0.5, 0.0)))
    kind, text = looked(*ends)
    assert kind == f"{name}_gripper/pose jump"
    assert f"{name}_gripper/pose jumped by 0.500 m within 0.008 s, at most 10 m/s is plausible" in text


def test_changed_places_are_told_from_a_jump():
    kind, text = looked(Pose((0.79, 0.0, 0.5)), Pose((0.01, 0.0, 0.5)))
    assert kind == "swap"
    assert "left_gripper/pose and right_gripper/pose have changed places" in text


def test_what_came_before_can_be_forgotten_and_a_stamp_that_does_not_advance_is_not_judged():
    watch = JumpWatch(("left_gripper/pose", "right_gripper/pose"))
    watch.look((START, END), 1000 * MS)
    watch.forget()
    assert watch.look((END, START), 1008 * MS) is None
    assert watch.look((START, END), 1008 * MS) is None
