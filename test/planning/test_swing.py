"""Trajectories with the cable as it swings, and ways in time after which it hangs still."""

from __future__ import annotations

import numpy as np
import pytest

import cable_shape as cs

ALONG = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, retardation_time=0.05, drag=0.05)


def grips(way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both ends (k, 7), moved by (k, 3)."""
    starts, ends = (np.tile((x, 0.0, 1.0, *ALONG), (len(way), 1)) for x in (0.0, 0.7))
    starts[:, :3] += way
    ends[:, :3] += way
    return starts, ends


def sideways(y: list[float], times: list[float]) -> cs.GripPath:
    return cs.GripPath(*grips(np.array([(0.0, one, 0.0) for one in y])), times)


def test_a_trajectory_with_its_swing_hits_what_the_cable_at_rest_does_not():
    wall = cs.Obstacle("wall", cs.Box((2.0, 0.02, 2.0)), cs.Pose((0.35, 0.45, 0.8)))
    scene = cs.Scene(obstacles=[wall])
    path = sideways([0.0, 0.3], [0.0, 0.4])
    still = cs.check_trajectory(CABLE, scene, None, path)
    swung = cs.check_trajectory(CABLE, scene, None, path, motion=True)
    assert still.valid
    assert not swung.valid
    assert swung.first is not None
    assert swung.first.reason is cs.Reason.CLEARANCE
    assert swung.first.place == 1.0  # it swings on into it when the grips have stopped
    assert not still.stops
    slow = cs.check_trajectory(CABLE, scene, None, sideways([0.0, 0.3], [0.0, 6.0]), motion=True)
    assert slow.valid
    assert slow.segments.all()
    assert slow.stops[0].swing < 0.1 * swung.stops[0].swing


def test_settling_is_told_at_each_stop():
    path = sideways([0.0, 0.2, 0.2, 0.3], [0.0, 0.5, 0.8, 1.2])
    found = cs.check_trajectory(CABLE, None, None, path, motion=True, points=41)
    assert [stop.place for stop in found.stops] == [1.0, 3.0]
    assert [stop.time for stop in found.stops] == [0.5, 1.2]
    motion = cs.Motion(CABLE, points=41)  # the same by hand
    motion.begin(*(cs.Pose(row[:3], ALONG) for row in (path.starts[0], path.ends[0])))
    times = np.concatenate((np.arange(1, 51) * 0.01, np.full(1000, 0.5)))
    places = []
    for t in times:
        y = 0.2 * t / 0.5
        places.append(motion.step(cs.Pose((0, y, 1), ALONG), cs.Pose((0.7, y, 1), ALONG), 0.01).positions)
    off = np.linalg.norm(np.array(places[49:]) - places[-1], axis=2).max(axis=1)
    assert found.stops[0].swing == pytest.approx(off.max(), rel=1e-3)
    assert found.stops[0].settling == pytest.approx(0.01 * (np.flatnonzero(off > 2e-3)[-1] + 1), abs=0.011)
    free = CABLE.replace(retardation_time=0.0, drag=0.0)
    assert cs.check_trajectory(free, None, None, path, motion=True).stops[0].settling == np.inf


def test_a_harness_with_its_swing_hits_what_it_does_not_at_rest_and_settles():
    arm = CABLE.replace(length=0.5, drag=0.3)
    harness = cs.Harness({"a": arm, "b": arm, "c": arm}, [cs.Junction("j", ("a.end", "b.start", "c.start"))])
    scene = cs.Scene(obstacles=[cs.Obstacle("wall", cs.Box((2.0, 0.02, 2.0)), cs.Pose((0.35, 0.45, 0.6)))])

    def path(seconds: float) -> cs.EndsPath:
        starts, ends = grips(np.array([(0.0, 0.0, 0.0), (0.0, 0.3, 0.0)]))
        return cs.EndsPath({"a.start": starts, "b.end": ends, "c.end": cs.FreeEnd()}, [0.0, seconds])

    still = cs.check_trajectory(harness, scene, None, path(0.4), points=41)
    swung = cs.check_trajectory(harness, scene, None, path(0.4), points=41, motion=True)
    assert still.valid
    assert swung.first is not None
    assert swung.first.reason is cs.Reason.CLEARANCE
    assert swung.first.segment in harness.segments
    assert set(swung.margins_of) == set("abc")
    slow = cs.check_trajectory(harness, scene, None, path(4.0), points=41, motion=True)
    assert slow.valid
    assert slow.stops[0].swing < 0.2 * swung.stops[0].swing
    motion = cs.Motion(harness, points=41)  # the same by hand
    for k in range(41):
        ends = {name: cs.Pose((x, 0.3 * k / 40, 1.0), ALONG) for name, x in (("a.start", 0.0), ("b.end", 0.7))}
        shape = motion.step(ends, 0.01) if k else motion.begin(ends)
    first, *rest = (
        np.concatenate([one.positions for one in part.segments.values()]) for part in (shape, *motion.ahead(1000, 0.01))
    )
    off = [np.linalg.norm(one - rest[-1], axis=1).max() for one in (first, *rest)]
    assert swung.stops[0].swing == pytest.approx(max(off), rel=1e-3)
    assert swung.stops[0].settling == pytest.approx(0.01 * (np.flatnonzero(np.array(off) > 1e-3)[-1] + 1), abs=0.011)


def test_a_trajectory_that_swings_needs_times_and_one_cable():
    path = sideways([0.0, 0.1], [0.0, 1.0])
    for given, match in (({"acceleration": [(0, 0, 0), (0, 0, 0)]}, "acceleration"),):
        with pytest.raises(cs.ArgumentError, match=match):
            cs.check_trajectory(CABLE, None, None, path, motion=True, **given)
    with pytest.raises(cs.ArgumentError, match="times"):
        cs.check_trajectory(CABLE, None, None, cs.GripPath(path.starts, path.ends), motion=True)
    with pytest.raises(cs.ArgumentError, match="one cable"):
        cs.check_trajectory({"a": CABLE}, None, None, {"a": (path.starts, path.ends)}, motion=True)
    with pytest.raises(cs.ArgumentError, match="3600 s at most"):
        cs.check_trajectory(CABLE, None, None, sideways([0.0, 0.1], [0.0, 1e9]), motion=True)
    far = cs.GripPath(path.starts, path.ends + np.array((0.5, 0, 0, 0, 0, 0, 0)), [0.0, 1.0])
    lost = cs.check_trajectory(CABLE, None, None, far, motion=True)
    assert lost.first is not None
    assert lost.first.reason is cs.Reason.OVERSTRETCHED


@pytest.mark.parametrize("cable", [CABLE, CABLE.replace(retardation_time=0.0, drag=0.0)], ids=["damped", "free"])
def test_a_shaped_stop_leaves_a_fifth_of_the_swing_of_a_trapezoid_at_most(cable: cs.Cable):
    found = cs.shape_stop(cable, sideways([0.0, 0.3], [0.0, 1.2]))
    assert found.swing < 0.2 * found.trapezoid
    assert found.path.times is not None
    assert found.path.times[-1] == pytest.approx(1.2)
    assert (np.diff(found.progress) >= -1e-12).all()
    np.testing.assert_allclose(found.progress[[0, -1]], (0.0, 1.0), atol=1e-12)
    np.testing.assert_allclose(found.path.starts[:, 1], 0.3 * found.progress, atol=1e-12)
    checked = cs.check_trajectory(
        cable, None, None, found.path, motion=True
    )  # on a finer mesh of points, and for longer
    plain = cs.check_trajectory(cable, None, None, trapezoid(0.3, 1.2), motion=True)
    assert checked.stops[-1].swing < 0.25 * plain.stops[-1].swing


def trapezoid(way: float, whole: float) -> cs.GripPath:
    """A quarter of the time to speed up, and one to slow down."""
    x = np.linspace(0.0, 1.0, 121)
    y = np.where(
        x < 0.25, 8.0 / 3.0 * x**2, np.where(x > 0.75, 1.0 - 8.0 / 3.0 * (1.0 - x) ** 2, 4.0 / 3.0 * (x - 0.125))
    )
    return sideways((way * y).tolist(), (whole * x).tolist())


def test_what_shaping_refuses():
    path = sideways([0.0, 0.1], [0.0, 1.0])
    with pytest.raises(cs.ArgumentError, match="duration"):
        cs.shape_stop(CABLE, cs.GripPath(path.starts, path.ends))
    with pytest.raises(cs.ArgumentError, match="two at least"):
        cs.shape_stop(CABLE, cs.GripPath(path.starts[:1], path.ends[:1]), 1.0)
    far = cs.GripPath(path.starts, path.ends + np.array(((0,) * 7, (0.5, 0, 0, 0, 0, 0, 0))), [0.0, 1.0])
    with pytest.raises(cs.ArgumentError, match="no shape"):
        cs.shape_stop(CABLE, far)
