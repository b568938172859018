"""Recordings as motions of studies."""

import numpy as np
import pytest
from recordings import ALONG_X, BEGIN, JOINTS, LEFT, PERIOD, RIGHT, ends_at, joints_entry, motion, pose_entry, write_bag

import cable_shape as cs
from cable_shape.replay.bag_motion import motion_of_bag

SET_BACK = pose_entry(LEFT, BEGIN - 2_000_000_000, (0, 0, 0), log_time=BEGIN + 9 * PERIOD)
CABLE = {"length": 1.0, "linear_density": 0.05, "bending_stiffness": 0.02}


def test_grips_move_as_recorded(tmp_path):
    told = motion_of_bag(write_bag(tmp_path / "bag", motion(12)))
    assert told["times"] == pytest.approx(0.01 * np.arange(12), abs=1e-6)
    assert np.allclose(told["end"][:, :3], [ends_at(k)[1] for k in range(12)])
    assert np.allclose(told["start"][:, 3:], ALONG_X)
    held = {"quaternion": ALONG_X}
    study = cs.Study(cs.Cable(**CABLE), start=held, end=held, motion=told, measure=["lowest"], points=40)
    rows = study.rows([])[""]
    assert rows.usable.all()
    for k in (0, 7, 11):
        start, end = (cs.Pose(p, ALONG_X) for p in ends_at(k))
        assert np.allclose(
            rows.part(1, 3)[k], cs.predict(cs.Cable(**CABLE), start, end, points=40).positions, atol=1e-5
        )


def test_one_end_of_a_cable_and_ends_of_a_harness(tmp_path):
    bag = write_bag(tmp_path / "bag", motion(5))
    assert set(motion_of_bag(bag, {"end": RIGHT})) == {"end", "times"}
    told = motion_of_bag(bag, {"a.start": LEFT, "b.end": RIGHT})
    assert told["ends"]["b.end"].shape == (5, 7)


def test_joints_move_as_recorded(tmp_path):
    entries = [joints_entry(BEGIN + k * PERIOD, ["lift", "turn"], [0.1 * k, -0.2 * k]) for k in range(4)]
    entries.append(joints_entry(BEGIN + 4 * PERIOD, ["lift"], [0.4]))  # lacks one, and is left out
    told = motion_of_bag(write_bag(tmp_path / "bag", entries), {"joints": JOINTS})
    assert told["joints"]["names"] == ["lift", "turn"]
    assert np.allclose(told["joints"]["positions"], [(0.1 * k, -0.2 * k) for k in range(4)])
    assert len(told["times"]) == 4


def test_what_cannot_be_used_is_left_out(tmp_path):
    bad = pose_entry(RIGHT, BEGIN + 5 * PERIOD, (float("nan"), 0.0, 0.0))
    again = pose_entry(LEFT, BEGIN + 4 * PERIOD, (9.0, 0.0, 0.0))  # a stamp that was there before
    told = motion_of_bag(write_bag(tmp_path / "bag", [*motion(5), bad, again]))
    assert len(told["times"]) == 5
    assert told["start"][:, 0].max() == 0.0


@pytest.mark.parametrize(
    ("entries", "options", "words"),
    [
        (
            motion(3),
            {"topics": {"start": "/nowhere", "end": RIGHT}},
            r"no topic /nowhere .*Topics found: /left_gripper",
        ),
        (motion(3), {"topics": {"joints": LEFT}}, "of sensor_msgs/msg/JointState"),
        (motion(3), {"topics": {"joints": JOINTS, "end": RIGHT}}, "joints move all ends"),
        (motion(3, skew=3_000_000), {"max_skew": 0.001}, "nothing that can be used"),
        (motion(3), {"max_skew": -1.0}, "max_skew"),
        ([*motion(3), pose_entry(LEFT, BEGIN + 9 * PERIOD, (0, 0, 0), frame="base")], {}, "must be 'world'"),
        ([*motion(3), SET_BACK], {}, "the clock was set back"),
    ],
)
def test_what_is_no_motion_is_refused(tmp_path, entries, options, words):
    bag = write_bag(tmp_path / "bag", entries)
    with pytest.raises((cs.ArgumentError, cs.BagError), match=words):
        motion_of_bag(bag, **options)
