"""Observations from streams: which points find which poses, and which are passed over."""

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.calibration.online import MOST_POINTS, Gatherer

ALONG_X = (0.5, 0.5, 0.5, 0.5)
MS = 1_000_000
CABLE = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.004)
LEFT = cs.Pose((0.0, 0.0, 1.0), ALONG_X)
GRIPS = cs.Grip(LEFT, offset=cs.Pose((0.0, 0.0, 0.1))), cs.Grip(LEFT, "swivel")
POINTS = np.column_stack((np.linspace(0.1, 0.7, 30), np.zeros(30), np.full(30, 0.8)))


def right(x: float) -> cs.Pose:
    return cs.Pose((x, 0.0, 1.0), ALONG_X)


class Stream:
    """Poses every 10 ms and points when asked."""

    def __init__(self, window: int = 10) -> None:
        self.gatherer = Gatherer(CABLE, GRIPS, 5 * MS, window)
        self.stamp = 0

    def hold(self, x: float, cycles: int = 20, speed: float = 0.0) -> float:
        for _ in range(cycles):
            self.stamp += 10 * MS
            x += 0.01 * speed
            self.gatherer.pose(0, self.stamp, LEFT)
            self.gatherer.pose(1, self.stamp + MS, right(x))
        return x

    def see(self, late: int = 0, points: np.ndarray = POINTS) -> None:
        self.gatherer.points(self.stamp - late, points)


def test_points_find_the_poses_of_their_time_with_kind_and_offset() -> None:
    stream = Stream()
    stream.hold(0.7)
    stream.see(late=20 * MS)
    stamp, seen = stream.gatherer.observations()
    assert (stamp, len(seen)) == (stream.stamp - 20 * MS, 1)
    assert isinstance(seen[0].end, cs.Grip)
    assert (seen[0].start.kind, seen[0].end.kind) == ("clamped", "swivel")
    np.testing.assert_allclose(seen[0].start.cable_frame.position, (0.1, 0.0, 1.0))
    np.testing.assert_array_equal(seen[0].end.pose.position, (0.7, 0.0, 1.0))
    np.testing.assert_array_equal(seen[0].points, POINTS)


def test_points_wait_for_poses_that_come_later() -> None:
    stream = Stream()
    stream.hold(0.7)
    stream.see(late=-8 * MS)
    assert stream.gatherer.taken == 0
    stream.hold(0.7, 1)
    assert stream.gatherer.taken == 1


def test_what_is_passed_over_is_counted() -> None:
    stream = Stream()
    stream.hold(0.7)
    stream.see()
    stream.see()  # the same place again
    x = stream.hold(0.7, 3, speed=1.0)  # sets off
    stream.see()
    x = stream.hold(x, 30)
    stream.see()
    stream.see(late=10_000 * MS)
    stream.see(points=np.full((3, 3), np.nan))
    assert stream.gatherer.taken == 2
    assert stream.gatherer.passed == {
        "without poses of that time": 1, "while the cable moved": 1, "that show nothing new": 2,
    }  # fmt: skip


def test_the_newest_are_kept_and_large_clouds_thinned() -> None:
    stream = Stream(window=3)
    for k in range(5):
        stream.hold(0.6 + 0.05 * k, 40)
        stream.see(points=np.tile(POINTS, (20, 1)))
    _, seen = stream.gatherer.observations()
    assert [round(float(o.end.pose.position[0]), 3) for o in seen] == [0.7, 0.75, 0.8]
    assert len(seen[0].points) == MOST_POINTS
    assert stream.gatherer.taken == 5


def test_a_clock_that_was_set_back_begins_anew() -> None:
    stream = Stream()
    stream.hold(0.7)
    stream.stamp = 0
    stream.hold(0.75)
    stream.see()
    assert stream.gatherer.taken == 1
    _, seen = stream.gatherer.observations()
    assert seen[0].end.pose.position[0] == pytest.approx(0.75)


def test_three_grips_of_a_harness_make_an_observation_while_none_of_them_moves() -> None:
    """Points whose order tells what they are, are not thinned."""
    made: list[tuple[list[cs.Pose], int]] = []

    def make(poses: list[cs.Pose], points: np.ndarray, arc_length: np.ndarray | None) -> str:
        made.append((list(poses), len(points)))
        return f"look {len(made)}"

    joint = cs.Junction("j", ("a.end", "b.start", "c.start"))
    harness = cs.Harness({"a": CABLE, "b": CABLE, "c": CABLE}, [joint])
    gatherer = Gatherer(harness, [cs.Grip(LEFT)] * 3, 5 * MS, 10, make=make, thin=False)
    stamp, points = 0, np.zeros((3 * MOST_POINTS, 3))

    def hold(cycles: int, speed: float = 0.0, place: float = 0.7) -> float:
        nonlocal stamp
        for _ in range(cycles):
            stamp += 10 * MS
            place += 0.01 * speed
            for side, pose in enumerate((LEFT, right(0.5), right(place))):
                gatherer.pose(side, stamp + side * MS, pose)
        return place

    hold(20)
    gatherer.points(stamp, points)
    assert gatherer.observations() == (stamp, ["look 1"])
    ((poses, count),) = made
    assert count == len(points)
    assert [float(pose.position[0]) for pose in poses] == [0.0, 0.5, 0.7]
    place = hold(3, speed=1.0)
    gatherer.points(stamp, points)
    assert gatherer.passed["while the cable moved"] == 1
    gatherer.pose(0, stamp + 10 * MS, LEFT)  # without the others nothing is paired
    hold(30, place=place)
    gatherer.points(stamp, points)
    assert gatherer.taken == 2
