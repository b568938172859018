"""Which pairs of several cables share a cycle."""

from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from cable_shape.ros.assembly import load_cables
from cable_shape.ros.gathering import Gathering

ROUND = [("a", 1), ("b", 2), ("c", 3)]


def fed(gathering, entries):
    return [cycle for name, stamp in entries for cycle in gathering.put(name, stamp, f"{name}{stamp}")]


def test_one_cable_waits_for_nobody():
    assert fed(Gathering(["a"]), [("a", 1), ("a", 2)]) == [(1, {"a": "a1"}), (2, {"a": "a2"})]


def test_all_cables_share_a_cycle_under_the_oldest_stamp():
    gathering = Gathering("abc")
    assert fed(gathering, [("b", 2), ("a", 1), ("c", 3)]) == [(1, {"a": "a1", "b": "b2", "c": "c3"})]


def test_a_silent_cable_is_waited_for_once_and_joins_again():
    gathering = Gathering("abc")
    fed(gathering, ROUND)
    assert fed(gathering, [("a", 11), ("b", 12)]) == []
    assert fed(gathering, [("a", 21)]) == [(11, {"a": "a11", "b": "b12"})]
    assert fed(gathering, [("b", 22)]) == [(21, {"a": "a21", "b": "b22"})]
    assert fed(gathering, [("c", 31), ("a", 32), ("b", 33)]) == [(31, {"c": "c31", "a": "a32", "b": "b33"})]


def test_one_that_comes_back_just_after_a_cycle_shares_the_next_one_with_its_own_round():
    gathering = Gathering("abc")
    fed(gathering, [*ROUND, ("a", 11), ("b", 12), ("a", 21), ("b", 22)])
    assert fed(gathering, [("a", 31), ("b", 32)]) == [(31, {"a": "a31", "b": "b32"})]
    assert fed(gathering, [("c", 33), ("a", 41)]) == [(33, {"c": "c33"})]
    assert fed(gathering, [("b", 42), ("c", 43)]) == [(41, {"a": "a41", "b": "b42", "c": "c43"})]
    assert fed(gathering, [("a", 51), ("b", 52), ("c", 53)]) == [(51, {"a": "a51", "b": "b52", "c": "c53"})]


def test_what_is_older_than_the_cycle_before_is_left_out_and_counted():
    gathering = Gathering("ab")
    assert fed(gathering, [("a", 10), ("b", 11), ("a", 20), ("a", 30)])[1:] == [(20, {"a": "a20"}), (30, {"a": "a30"})]
    assert fed(gathering, [("b", 12)]) == []
    assert gathering.late == 1


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(1, 50)), max_size=60))
def test_cycles_never_go_back_and_use_each_entry_once(entries):
    gathering = Gathering("abc")
    cycles = fed(gathering, entries)
    stamps = [stamp for stamp, _ in cycles]
    assert stamps == sorted(stamps)
    used = sum(len(values) for _, values in cycles)
    assert used + gathering.late + len(gathering._held) == len(entries)


def test_the_shipped_file_of_several_cables_names_them():
    cables = load_cables(Path(__file__).resolve().parents[2] / "config" / "cables" / "three.yaml")
    assert list(cables) == ["front", "rear", "hose"]
    assert all(file.cable.length > 0.0 for file in cables.values())
