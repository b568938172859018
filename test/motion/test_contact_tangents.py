"""Derivatives of motions that touch bodies and run through eyelets, at their nodes, each against differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.kernels.network import swing_tangent
from cable_shape.motion import among

ALONG = (0.5, 0.5, 0.5, 0.5)  # d3 along x
DT = 0.01
CABLE = cs.Cable(
    length=1.0, linear_density=0.1, bending_stiffness=1e-3, twisting_stiffness=8e-4, retardation_time=0.05, drag=0.3,
    diameter=0.01, friction=0.3,
)  # fmt: skip
NUMBERS = ("bending_stiffness", "length", "linear_density", "drag", "retardation_time")
DAMPING = NUMBERS[3:]
TABLE = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
BALL = cs.Scene(obstacles=[cs.Obstacle("ball", cs.Sphere(0.15), cs.Pose((0.35, 0.02, 0.0)))], contact="solve")
EYELET = cs.Scene(clips=[cs.Clip(0.5, cs.Pose((0.4, 0.02, -0.1), ALONG), "slide", "e")])
ARM = cs.Cable(
    length=0.5, linear_density=0.1, bending_stiffness=1e-3, retardation_time=0.03, drag=0.1, diameter=0.01,
    friction=0.3,
)  # fmt: skip
Y = cs.Harness(
    {"a": ARM, "b": ARM, "c": ARM.replace(bending_stiffness=2e-3)},
    [cs.Junction("j", ("a.end", "b.start", "c.start"))],
)
NONE = np.zeros(6)


@pytest.fixture(autouse=True)
def at_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """It begins so near to rest that differences know nothing of how near that is."""
    monkeypatch.setattr(among, "_AT_REST", 1e-11)


def at(place: Any) -> cs.Pose:
    return cs.Pose(np.asarray(place, dtype=float), ALONG)


class Case(NamedTuple):
    """A cable in a scene, whose ends go so far aside each step."""

    scene: cs.Scene
    start: tuple[float, float, float]
    end: tuple[float, float, float] | None
    ways: tuple[tuple[float, float, float], tuple[float, float, float]]
    steps: int
    cable: cs.Cable = CABLE

    def go(self, cable: cs.Cable, off: np.ndarray = NONE, by: tuple[str, ...] = ()) -> cs.Motion:
        motion = cs.Motion(cable, self.scene, points=31, elements=20)

        def ends(k: int) -> tuple[cs.Pose, cs.Pose | None]:
            start = at(self.start + off[:3] + k * np.array(self.ways[0]))
            if self.end is None:
                return start, None
            return start, at(self.end + off[3:] + k * np.array(self.ways[1]))

        shape = motion.begin(*ends(0), by=by)
        for k in range(1, self.steps + 1):
            shape = motion.step(*ends(k), DT)
        assert shape.status, shape.detail
        return motion


ASIDE, BACK, SLOW, STILL = (0.0, 0.004, 0.0), (0.0, -0.004, 0.0), (0.0, 0.002, 0.0), (0.0, 0.0, 0.0)
CASES = {
    "slides": Case(TABLE, (0.0, 0.0, 0.14), (0.9, 0.0, 0.14), (ASIDE, BACK), 14),
    "sticks": Case(TABLE, (0.0, 0.0, 0.1), (0.9, 0.0, 0.1), (SLOW, SLOW), 8, CABLE.replace(friction=2.0)),
    "two stick": Case(TABLE, (0.0, 0.0, 0.18), (0.9, 0.0, 0.18), (ASIDE, BACK), 12),
    "between nodes": Case(BALL, (0.0, 0.0, 0.25), (0.7, 0.0, 0.25), (ASIDE, ASIDE), 6),
    "eyelet": Case(EYELET, (0.0, 0.0, 0.0), (0.7, 0.0, 0.05), (ASIDE, BACK), 15),
    "free end": Case(TABLE, (0.0, 0.0, 0.6), None, ((0.004, 0.0, -0.001), STILL), 12, CABLE.replace(friction=0.4)),
}


def nodes(motion: Any) -> tuple[np.ndarray, np.ndarray]:
    """Places and velocities."""
    return motion._swing.memory.place.copy(), motion._swing.memory.velocity.copy()


def told(motion: Any, column: int) -> tuple[np.ndarray, np.ndarray]:
    """Their derivatives."""
    tangents = motion._tangents
    (row,) = np.flatnonzero(tangents._told == column)
    t: Any = swing_tangent.tangent_of.py_func(motion._swing.ints, tangents._flat[row])
    return t.place / tangents._scale[row], t.velocity / tangents._scale[row]


def check(motion: Any, column: int, moved: Callable[[float], Any], step: float, least: float = 1e-4) -> None:
    """One column is that of differences; velocities are less well known to those, by 1 / dt."""
    (above, faster), (below, slower) = nodes(moved(step)), nodes(moved(-step))
    place, velocity = told(motion, column)
    for own, there, near in ((place, above - below, least), (velocity, faster - slower, 10.0 * least)):
        found = there / (2.0 * step)
        assert np.abs(own - found).max() < near * np.abs(found).max()


@pytest.mark.parametrize("name", CASES)
def test_by_the_grips_and_numbers_of_the_cable(name: str):
    case = CASES[name]
    ends: tuple[str, ...] = ("start",) if case.end is None else ("start", "end")
    motion = case.go(case.cable, by=(*ends, *NUMBERS))
    for i in (2,) if case.end is None else (0, 2, 3, 5):
        way = np.eye(6)[i]
        check(motion, i if i < 3 else i + 3, lambda x, way=way: case.go(case.cable, x * way), 1e-6)
    for column, number in enumerate(NUMBERS, 6 * len(ends)):
        value = 1e-3 if number == "bending_stiffness" else getattr(case.cable, number)
        step = 1e-4 * value if number in DAMPING else 1e-5 * value  # which hardly tells of what is held
        check(motion, column, lambda x, n=number, v=value: case.go(case.cable.replace(**{n: v + x})), step)


def test_what_is_touched_is_what_the_cases_say():
    """Planes of nodes press in one, points between nodes in another; some slip, and some stick."""
    states = {name: case.go(case.cable, by=("drag",)) for name, case in CASES.items()}
    slips = {name: [contact.slips for contact in motion.last.contacts] for name, motion in states.items()}
    assert all(slips["slides"])
    assert len(slips["sticks"]) > 3
    assert not any(slips["sticks"])
    assert len(slips["free end"]) > 3
    walls = states["between nodes"]._swing.motion.walls  # type: ignore[union-attr]
    assert not (walls[:, 8] * (walls[:, 0] > 0.0)).any()
    assert len(slips["between nodes"]) == 2


def test_how_often_what_touches_has_changed_is_told():
    """Not where it stays, and of a motion that touches nothing never."""
    eyelet = CASES["eyelet"]
    assert eyelet.go(CABLE, by=("drag",)).breaks == 0
    assert CASES["slides"].go(CABLE, by=("drag",)).breaks > 0
    free = Case(cs.Scene(), (0.0, 0.0, 0.0), (0.7, 0.0, 0.0), (ASIDE, STILL), 5)
    assert free.go(CABLE, by=("drag",)).breaks == 0


def test_steps_are_the_same_with_derivatives_to_the_bit():
    for name in ("slides", "eyelet"):
        case = CASES[name]
        plain, traced = case.go(case.cable), case.go(case.cable, by=("drag", "start"))
        np.testing.assert_array_equal(plain.last.positions, traced.last.positions)
        np.testing.assert_array_equal(*(motion.ahead(3, DT)[-1].positions for motion in (plain, traced)))


def test_many_steps_at_once_are_the_same():
    case = CASES["slides"]
    stepped, run = case.go(CABLE, by=("drag", "start")), Case(*case[:4], 0).go(CABLE, by=("drag", "start"))
    k = np.arange(1, case.steps + 1)[:, None]
    still = np.tile(ALONG, (case.steps, 1))
    starts = np.concatenate((case.start + k * case.ways[0], still), axis=1)
    ends = np.concatenate((case.end + k * case.ways[1], still), axis=1)  # type: ignore[operator]
    found = run.run(starts, ends, np.full(case.steps, DT)).derivative
    assert found is not None
    place, velocity = told(stepped, 0)
    np.testing.assert_allclose(found.places[-1, :, :, 0], place, atol=1e-9)
    np.testing.assert_allclose(found.velocities[-1, :, :, 0], velocity, atol=1e-7)


def test_what_arrives_takes_its_derivative_along():
    """A free end comes down on a table that is smooth: impacts, which run along the cable, and what follows them."""
    cable = CABLE.replace(length=0.3, bending_stiffness=0.02, twisting_stiffness=0.02, drag=0.0, friction=0.0)

    def go(height: float, by: tuple[str, ...] = ()) -> cs.Motion:
        motion = cs.Motion(cable, TABLE, points=31)
        pin = cs.Grip(at((0.0, 0.0, 0.01 + height)), "pinned")
        motion.begin(pin, cs.FreeEnd(force=(0.2, 0.0, 0.3)), by=by)
        for _ in range(60):
            shape = motion.step(pin, cs.FreeEnd(), 0.005)
            assert shape.usable, shape.detail
        return motion

    motion = go(0.0, ("start",))
    assert motion.last.contacts
    assert motion.breaks > 0
    check(motion, 2, go, 1e-6)


def test_of_a_harness_whose_knot_lies_on_a_table():
    names = ("a.start", "b.end", "bending_stiffness:c", "length:b", "drag:a")

    def go(harness: cs.Harness, off: np.ndarray = NONE, by: tuple[str, ...] = ()) -> Any:
        motion = cs.Motion(harness, TABLE, points=11)

        def ends(k: int) -> dict[str, cs.Pose]:
            return {
                "a.start": at(off[:3] + np.array((0.0, 0.003 * k, 0.2))),
                "b.end": at(off[3:] + np.array((0.8, 0.003 * k, 0.2))),
                "c.end": at((0.4, 0.45 + 0.004 * k, 0.15)),
            }

        shape = motion.begin(ends(0), by=by)
        for k in range(1, 9):
            shape = motion.step(ends(k), DT)
            assert shape.status, shape.detail
        return motion

    motion = go(Y, by=names)
    (knot,) = np.flatnonzero(motion._swing.among.skin.knot >= 0)
    assert motion._swing.motion.walls[knot, 0] > 0.0
    assert motion._swing.motion.walls[knot, 8] > 0.0
    for i in (0, 1, 2, 5):
        way = np.eye(6)[i]
        check(motion, i if i < 3 else i + 3, lambda x, way=way: go(Y, x * way), 1e-6)
    for column, (segment, name) in enumerate((("c", "bending_stiffness"), ("b", "length"), ("a", "drag")), 12):
        cable = Y.segments[segment]
        value = cable.mean_bending_stiffness if name == "bending_stiffness" else getattr(cable, name)

        def moved(x: float, s: str = segment, n: str = name, v: float = value) -> Any:
            return go(Y.replace(segments={**Y.segments, s: Y.segments[s].replace(**{n: v + x})}))

        check(motion, column, moved, 1e-6 * value)
