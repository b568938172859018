"""Pairing, stamps and frames, without ROS."""

import itertools
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cable_shape.errors import InputError, StaleInputError
from cable_shape.messages.pairing import (
    HISTORY,
    MIXED,
    RESTART_JUMP,
    ROW,
    FrameGuard,
    MissedCount,
    Pairing,
    SpeakerGuard,
    StampGuard,
)

MS = 1_000_000  # ns


def fed(pairing, messages):
    """The pairs made of (side, stamp) messages; the value of a message is its stamp."""
    return [pair for side, stamp in messages if (pair := pairing.put(side, stamp, stamp)) is not None]


def test_equal_stamps_pair_and_the_older_stamp_goes_out():
    pairs = fed(Pairing(20 * MS), [(0, 100 * MS), (1, 103 * MS), (1, 203 * MS), (0, 200 * MS)])
    assert [(p.stamp, p.start, p.end, p.skew) for p in pairs] == [
        (100 * MS, 100 * MS, 103 * MS, 3 * MS),
        (200 * MS, 200 * MS, 203 * MS, 3 * MS),
    ]


def test_stamps_further_apart_than_max_skew_never_pair():
    pairing = Pairing(20 * MS)
    assert fed(pairing, [(0, 100 * MS), (1, 121 * MS)]) == []
    assert pairing.nearest_miss() == 21 * MS
    assert len(fed(Pairing(21 * MS), [(0, 100 * MS), (1, 121 * MS)])) == 1


def test_only_one_gripper_makes_no_pair_and_keeps_a_bounded_history():
    pairing = Pairing(20 * MS)
    assert fed(pairing, [(0, i * MS) for i in range(1, 1001)]) == []
    assert pairing.unpaired == 1000 - HISTORY
    assert pairing.nearest_miss() is None
    assert pairing.seen(0)
    assert not pairing.seen(1)


def test_a_lost_message_does_not_leave_the_streams_shifted():
    """Left 20 is lost: without waiting for the closer partner, every later pair would be one period apart."""
    messages = [(0, 10), (1, 10), (1, 20), (0, 30), (1, 30), (0, 40), (1, 40), (0, 50), (1, 50), (0, 60), (1, 60)]
    pairs = fed(Pairing(20 * MS), [(side, stamp * MS) for side, stamp in messages])
    assert [p.skew for p in pairs[-2:]] == [0, 0]
    assert pairs[-1].stamp == 60 * MS


def test_a_side_that_travels_longer_still_finds_its_partners():
    """Right arrives 50 ms after left although both are measured at the same times."""
    left = [(0, 5 * i * MS) for i in range(1, 60)]
    right = [(1, 5 * i * MS) for i in range(1, 50)]
    mixed = left[:10] + [m for both in zip(right, left[10:], strict=True) for m in both]
    pairs = fed(Pairing(20 * MS), mixed)
    assert len(pairs) == len(right)
    assert {p.skew for p in pairs} == {0}


@settings(derandomize=True, deadline=None, max_examples=400)
@given(
    st.integers(1, 4),
    st.lists(st.tuples(st.integers(0, 3), st.integers(1, 30)), min_size=1, max_size=80),
    st.integers(0, 40),
)
def test_pairs_are_within_skew_use_each_message_once_and_go_forward(sides, steps, max_skew):
    clock = [0] * sides
    messages = []
    for side, step in steps:
        clock[side % sides] += step
        messages.append((side % sides, clock[side % sides]))
    pairing = Pairing(max_skew, sides)
    pairs = fed(pairing, messages)
    assert all(max(p.values) - min(p.values) == p.skew <= max_skew for p in pairs)
    assert all(p.stamp == min(p.values) and len(p.values) == sides for p in pairs)
    for earlier, later in itertools.pairwise(pairs):
        assert all(new > old for new, old in zip(later.values, earlier.values, strict=True))
        assert later.stamp > earlier.stamp
    waiting = sum(len(w) for w in pairing._waiting)
    assert pairing.unpaired + sides * len(pairs) + waiting == len(messages)


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.integers(2, 4), st.lists(st.integers(-4, 4), min_size=20, max_size=60), st.integers(0, 9))
def test_jitter_never_starves_the_output(sides, jitter, phase):
    """All at 100 Hz with jitter and any phase: at least every second message makes a pair."""
    messages = []
    for i, j in enumerate(jitter):
        messages.append((0, 100 * (10 * i + 10)))
        messages += [(side, 100 * (10 * i + 10 + side * phase % 10) + 10 * j) for side in range(1, sides)]
    pairs = fed(Pairing(2000, sides), sorted(messages, key=lambda m: m[1]))
    assert len(pairs) >= len(jitter) // 2 - 1


def test_grippers_of_any_number_are_paired_at_one_time():
    pairs = fed(Pairing(20 * MS, 3), [(0, 100 * MS), (2, 101 * MS), (1, 102 * MS), (0, 110 * MS), (1, 140 * MS)])
    assert [(p.stamp, p.values, p.skew) for p in pairs] == [
        (100 * MS, (100 * MS, 102 * MS, 101 * MS), 2 * MS),
    ]
    assert [p.values for p in fed(Pairing(0, 1), [(0, 5), (0, 9)])] == [(5,), (9,)]
    far = Pairing(20 * MS, 3)
    assert fed(far, [(0, 100 * MS), (1, 119 * MS), (2, 121 * MS)]) == []
    assert far.nearest_miss() == 21 * MS


def test_clear_forgets_messages_but_keeps_counts():
    pairing = Pairing(20 * MS)
    fed(pairing, [(0, 100 * MS), (1, 100 * MS), (0, 110 * MS)])
    pairing.clear()
    assert pairing.put(1, 110 * MS, 0) is None
    assert (pairing.pairs, pairing.unpaired) == (1, 1)


def test_stamps_must_be_set_and_increase():
    guard = StampGuard("left_gripper/pose")
    with pytest.raises(StaleInputError, match=r"left_gripper/pose: header.stamp = 0 ns .* above 0"):
        guard.check(0)
    assert not guard.check(RESTART_JUMP * 10)
    with pytest.raises(StaleInputError, match="is repeated: every message needs a newer stamp"):
        guard.check(RESTART_JUMP * 10)
    with pytest.raises(StaleInputError, match=r"goes backwards, by 0\.500000 s"):
        guard.check(RESTART_JUMP * 10 - RESTART_JUMP // 2)
    assert not guard.check(RESTART_JUMP * 10 + 1)


def test_a_jump_back_of_more_than_a_second_is_a_restart():
    guard = StampGuard("joint_states")
    guard.check(RESTART_JUMP * 10)
    assert guard.check(RESTART_JUMP * 9 - 1)
    assert not guard.check(RESTART_JUMP * 9)


def test_the_first_used_frame_is_expected_unless_one_is_given():
    frame = FrameGuard("")
    frame.check("left_gripper/pose", "map")  # looked at, not used
    frame.check("left_gripper/pose", "world")
    frame.fix("world")
    frame.check("right_gripper/pose", "world")
    with pytest.raises(InputError, match=r"header.frame_id = 'map' is not allowed: it must be 'world'.*set frame_id"):
        frame.check("right_gripper/pose", "map")
    with pytest.raises(InputError, match="it must be 'base'"):
        FrameGuard("base").check("right_gripper/pose", "world")


def test_messages_that_were_never_read_are_counted_by_the_gaps_in_their_numbers():
    count = MissedCount()
    for number in (5, 6, 9, None, 10, 1, 2, 4):  # at 1 the publisher was started again
        count.take({"publication_sequence_number": number})
    assert count.missed == 3
    count.forget()
    count.take({"publication_sequence_number": 1000})
    count.take({})
    assert count.missed == 3


def heard(guard, messages, publishers=2):
    """Which of the (time [s], number) may be used."""
    return [guard.check(publishers, {"publication_sequence_number": number}, now) for now, number in messages]


@settings(derandomize=True, deadline=None)
@given(
    st.integers(0, 2**32), st.integers(1, 1000), st.integers(1, 1000), st.floats(5.0, 500.0), st.floats(5.0, 500.0),
    st.floats(0.0, 0.3),
)  # fmt: skip
def test_of_two_that_publish_at_the_same_time_none_is_used(seed, first, second, rate, other, lost):
    """Whatever their numbers and rates, with messages lost; one message may pass whose number happens to follow."""
    chance = random.Random(seed)
    sent = sorted(
        (start + (k + chance.uniform(0.0, 0.5)) / hertz, number + k)
        for start, number, hertz in ((0.0, first, rate), (1.0, second, other))
        for k in range(int(4.0 * hertz))
    )
    guard = SpeakerGuard()
    read = [entry for entry in sent if chance.random() >= lost]
    alone = [entry for entry in read if entry[0] < 1.0]
    assert all(heard(guard, alone, 1))
    both = [entry for entry in read if 1.0 <= entry[0] < 3.9]
    assert sum(heard(guard, both)) <= 1 + sum(1 for now, _ in both if now < 1.0 + 1.5 / other / (1.0 - lost))


def test_one_that_ends_and_one_that_takes_over():
    guard = SpeakerGuard()
    assert heard(guard, [(0.0, 100)], 1) == [True]
    assert all(heard(guard, [(0.01 * k, 100 + k) for k in range(1, 50)]))  # the other one is silent
    again = heard(guard, [(1.0 + 0.01 * k, 1 + k) for k in range(150)])  # started again, the first still known
    assert again.index(True) == pytest.approx(100 * MIXED, abs=1)
    assert all(again[again.index(True) :])
    assert all(heard(guard, [(9.0 + 0.01 * k, 1 + k) for k in range(9)], 1))  # alone: it may start again
    lost = heard(guard, [(10.0 + 0.01 * k, 50 + k) for k in range(2 * ROW)])
    assert lost == [False] * ROW + [True] * ROW
    assert not any(heard(guard, [(11.0, None), (11.1, None)]))  # a middleware that does not count
    assert all(heard(guard, [(12.0, None), (12.1, None)], 1))
    guard.forget()
    assert heard(guard, [(13.0, 7)], 1) == [True]
