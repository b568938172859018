"""The tree of transforms, without ROS."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cable_shape.errors import ArgumentError, InputError, StaleInputError
from cable_shape.messages.pairing import SECOND
from cable_shape.messages.transforms import MAX_FRAMES, TransformTree
from cable_shape.pose import IDENTITY, Pose, between

T0 = 1000 * SECOND
GAP = SECOND // 50

numbers = st.floats(-2.0, 2.0)
quaternions = st.tuples(numbers, numbers, numbers, numbers).filter(lambda q: np.linalg.norm(q) > 0.1)
poses = st.builds(
    lambda p, q: Pose(p, np.array(q) / np.linalg.norm(q)), st.tuples(numbers, numbers, numbers), quaternions
)


def tree(*frames, base="cell", static=(), moving=()):
    made = TransformTree(base, frames or ("left", "right"))
    for parent, child, pose in static:
        made.put_static(parent, child, lambda pose=pose: pose)
    for parent, child, stamp, pose in moving:
        made.put(parent, child, stamp, lambda pose=pose: pose)
    return made


def at(x):
    return Pose((x, 0.0, 0.0))


def near(pose, other):
    metres, radians = pose.distance(other)
    return metres < 1e-12 and radians < 1e-7


@given(st.lists(poses, min_size=4, max_size=4), st.booleans())
def test_a_frame_is_where_the_transforms_on_the_way_put_it(step, moving):
    """Up one branch to where it meets that of the base, and down the other."""
    edges = [("map", "cell", step[0]), ("map", "arm", step[1]), ("arm", "wrist", step[2]), ("wrist", "left", step[3])]
    if moving:
        made = tree("left", static=edges[:3], moving=[(*edges[3][:2], T0, edges[3][2])])
    else:
        made = tree("left", static=edges)
    expected = step[0].inverse() * (step[1] * step[2] * step[3])
    assert near(made.at("left", T0, GAP), expected)
    assert made.newest(["left"]) == (T0 if moving else 0)


@given(poses, poses, st.floats(0.0, 1.0))
def test_between_two_transforms_the_way_is_straight_and_the_turn_even(first, second, part):
    middle = Pose.trusted(between(first.array, second.array, part))
    assert middle.position == pytest.approx(first.position + part * (second.position - first.position), abs=1e-12)
    assert np.linalg.norm(middle.quaternion) == pytest.approx(1.0, abs=1e-12)
    whole = first.distance(second)[1]
    assert first.distance(middle)[1] == pytest.approx(part * whole, abs=1e-6)
    assert middle.distance(second)[1] == pytest.approx((1.0 - part) * whole, abs=1e-6)


def test_the_time_is_the_newest_at_which_all_are_known():
    made = tree(moving=[("cell", "left", T0, at(0.0)), ("cell", "right", T0 + 4, at(7.0))])
    assert made.newest(["left", "right"]) == T0
    made.put("cell", "left", T0 + 10, lambda: at(1.0))
    assert made.newest(["left", "right"]) == T0 + 4
    assert made.at("left", T0 + 4, GAP).position[0] == pytest.approx(0.4)
    assert made.at("right", T0 + 4, GAP) == at(7.0)
    made.prune(T0 + 4)
    assert made.at("left", T0 + 5, GAP).position[0] == pytest.approx(0.5)
    assert tree(static=[("cell", "left", IDENTITY), ("cell", "right", IDENTITY)]).newest(["left", "right"]) == 0
    assert tree(static=[("cell", "left", IDENTITY)]).newest(["left", "right"]) is None


def test_what_is_too_far_in_time_is_not_used():
    made = tree("left", moving=[("cell", "left", T0, at(0.0))])
    with pytest.raises(StaleInputError, match=r"none nearer than 0\.050 s, max_skew = 0\.02 s\. Send all transforms"):
        made.at("left", T0 + SECOND // 20, GAP)
    made.put("cell", "left", T0 + SECOND // 10, lambda: at(1.0))
    with pytest.raises(StaleInputError, match=r"none nearer than 0\.050 s"):
        made.at("left", T0 + SECOND // 20, GAP)


def test_repeats_are_passed_over_and_stamps_that_go_back_refused_or_taken_as_a_restart():
    made = tree("left", moving=[("cell", "left", T0, at(0.0)), ("cell", "left", T0, at(5.0))])
    assert made.repeated == 1
    assert made.at("left", T0, GAP) == at(0.0)
    with pytest.raises(StaleInputError, match=r"/tf: left: header.stamp = \d+ ns goes backwards"):
        made.put("cell", "left", T0 - 5, lambda: at(0.0))
    with pytest.raises(StaleInputError, match="it must be above 0"):
        made.put("cell", "left", 0, lambda: at(0.0))
    assert made.put("cell", "left", T0 - 50 * SECOND, lambda: at(3.0))
    assert made.newest(["left"]) == T0 - 50 * SECOND


def test_a_pose_that_is_none_is_refused_and_the_one_before_stays():
    made = tree("left", moving=[("cell", "left", T0, at(2.0))])
    with pytest.raises(ArgumentError, match="position"):
        made.put("cell", "left", T0 + 1, lambda: at(float("nan")))
    assert made.newest(["left"]) == T0


def test_transforms_off_the_way_are_neither_looked_at_nor_kept():
    made = tree("left", moving=[("cell", "left", T0, at(0.0)), ("cell", "camera", 0, None)])
    made.put("cell", "camera", 0, lambda: 1 / 0)
    assert made.changes_nothing("cell", "camera")
    assert not made.changes_nothing("table", "camera")
    assert not made.changes_nothing("cell", "left")
    assert not made.changes_nothing("cell", "lamp")
    assert made.newest(["left"]) == T0


def test_a_frame_with_two_parents_is_refused_one_that_moved_to_another_is_followed():
    made = tree("left", static=[("cell", "table", at(1.0))], moving=[("cell", "left", T0, at(0.0))])
    with pytest.raises(InputError, match="frame 'left' has two parents, 'cell' and 'table', within a second"):
        made.put("table", "left", T0 + 1, lambda: at(0.0))
    made.put("table", "left", T0 + 2 * SECOND, lambda: at(0.0))
    assert made.at("left", T0 + 2 * SECOND, GAP) == at(1.0)


@pytest.mark.parametrize(
    ("static", "text"),
    [
        ([], "nobody sends frame 'left'; there are none. Start its sender, or correct the name"),
        ([("cell", "lft", IDENTITY)], "nobody sends frame 'left'; there are 'cell', 'lft'."),
        (
            [("base", "left", IDENTITY)],
            "nobody sends frame 'cell', in which 'left' is wanted; there are 'base', 'left'.",
        ),
        (
            [("base", "left", IDENTITY), ("map", "cell", IDENTITY)],
            "frame 'left' hangs on 'base' and the frame of the shapes 'cell' on 'map': nobody sends a transform",
        ),
        ([("a", "left", IDENTITY), ("left", "a", IDENTITY), ("map", "cell", IDENTITY)], "frame 'left' hangs on 'a'"),
        ([("cell", "left", IDENTITY)], ""),
    ],
)
def test_what_is_missing_is_said(static, text):
    made = tree("left", static=static)
    said = made.missing("left")
    assert text in said
    assert bool(said) == bool(text)
    assert (made.newest(["left"]) is None) == bool(text)
    if text:
        with pytest.raises(StaleInputError):
            made.at("left", T0, GAP)


def test_names_that_are_none_and_too_many_frames_are_refused():
    made = tree("left", static=[("cell", "left", IDENTITY)])
    for parent, child in (("", "a"), ("a", ""), ("a", "a")):
        with pytest.raises(InputError, match="must be two different names"):
            made.put_static(parent, child, lambda: IDENTITY)
    for number in range(MAX_FRAMES - 1):
        made.put("cell", f"f{number}", T0, lambda: IDENTITY)
    with pytest.raises(InputError, match=f"is one more than the {MAX_FRAMES} frames that are kept"):
        made.put("cell", "more", T0, lambda: IDENTITY)
    assert made.at("left", T0, GAP) == IDENTITY
